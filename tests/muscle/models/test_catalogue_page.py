"""The page of the catalogue is that of the models' cards, and the README counts them."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

from bozzini.muscle.models import count_statuses
from tests.muscle.models.catalogue import SURVEY

ROOT = Path(__file__).resolve().parents[3]

HEAD = (ROOT / "docs" / "theory" / "catalogue.md").read_text("utf-8")
_spec = importlib.util.spec_from_file_location("make_catalogue", ROOT / "docs/make_catalogue.py")
catalogue = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(catalogue)


def test_the_readme_counts_the_models():
    assert f" {len(SURVEY)} models of the literature" in (ROOT / "README.md").read_text("utf-8")


def test_every_model_has_a_section_with_its_equation_and_its_source():
    page = catalogue.format_catalogue()
    for name, kind in SURVEY.items():
        _, section = page.split(f"\n## {name}\n")
        section = section.split("\n## ")[0]
        card = kind.card
        assert f"```math\n{card.latex}\n```" in section
        assert card.equation.lower() in section.lower()
        assert card.reference.rstrip(".") in section
        assert (card.latex_printed is not None) == ("As printed:" in section)
        for word in (*card.keywords, *card.errata, card.missing):
            assert word in section
        (used,) = re.findall(r"^- Of the muscle: (.+)\.$", section, re.M)
        group, *others = used.split(", ")
        assert {*catalogue.GROUPS[group], *(word.strip("`") for word in others)} == set(card.uses)
        assert f"(#{name})" in page


def test_groups_of_fields_are_told_as_they_are():
    head = HEAD.partition("## All models")[0].partition("**Fields of the muscle**")[2]
    told, known = {}, set()
    for group, text in re.findall(r"\*(\w+)\* is\s(.+?)[;.]", head, re.S):
        known |= set(re.findall(r"`(\w+)`", text))
        told[group] = set(known)
    assert told == {group: set(fields) for group, fields in catalogue.GROUPS.items()}


def test_counts_add_up():
    counts = count_statuses([kind.card for kind in SURVEY.values()])
    assert sum(counts.values()) == len(SURVEY)
    table = catalogue.format_counts()
    for status, count in counts.items():
        (line,) = re.findall(rf"^\| {status} \|.*$", table, re.M)
        assert f"| {count} |" in line
        assert line.count("`") == 2 * count


def test_tables_have_as_many_cells_as_their_head():
    for table in re.findall(r"(?:^\|.*\n)+", catalogue.format_catalogue(), re.M):
        cells = {line.count("|") for line in table.splitlines()}
        assert len(cells) == 1, table


def test_the_upper_sign_is_that_of_inflating():
    """Friction takes from the pull on the way up: a minus above, or a plus in what is taken off."""
    assert "the upper one is of the way up, inflating" in " ".join(HEAD.split())
    for name, kind in SURVEY.items():
        signs = re.findall(r"\\(?:mp|pm)\b", kind.card.latex)
        assert signs == ([] if not signs else [r"\pm"] if name == "chen" else [r"\mp"]), name
