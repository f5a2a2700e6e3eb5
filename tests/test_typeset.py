"""Equations of the documentation can be typeset."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bozzini.muscle import MODELS
from tests.muscle.models.catalogue import SURVEY

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "```math" in path.read_text("utf-8"))


def load_hook():
    spec = importlib.util.spec_from_file_location("typeset", DOCS / "typeset.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", SURVEY)
def test_the_equations_of_a_model_leave_no_latex_behind(name):
    card = MODELS[name].card
    for latex in filter(None, (card.latex, card.latex_printed)):
        text = load_hook().typeset(latex)
        (block,) = ElementTree.fromstring(text)
        assert block.tag.endswith("math")
        assert "\\" not in "".join(block.itertext())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_keeps_all_but_its_fences(page):
    text = page.read_text("utf-8")
    made = load_hook().on_page_markdown(text)
    assert "```math" not in made
    assert made.count("<math") == text.count("```math")
    assert re.sub(r"<div class=\"equation\">.*?</div>", "", made, flags=re.S) == re.sub(
        r"```math.*?```", "", text, flags=re.S
    )
