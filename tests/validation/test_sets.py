"""What is validated on measured data keeps its bounds; `make validate` runs the same functions."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "validation"
SETS = sorted(
    {path.stem for path in FOLDER.glob("*.py")} - {"report", "section", "estimates", "loops"}
)

FORMS = {
    "festo10": lambda module: (module.ANCHORED, module.MEAN),
    "tentacle": lambda module: (module.CHOSEN[:2], module.CHOSEN),
    "three_section_robot": lambda module: dict(list(module.FORMS.items())[1:4]),
    "three_muscle_arm": lambda module: {"all": module.FORMS["all"]},
}
"""Of sets that compare many forms those with a bound; `make validate` fits the others, too."""

LOOPS = {"festo10": lambda module: 1, "three_section_robot": lambda module: module.LOOPS[:1]}
"""Of sets with loops how many, or which, are compared here."""


@pytest.fixture(scope="module")
def load():
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module
    sys.path.remove(str(FOLDER))


@pytest.mark.slow(100)
@pytest.mark.parametrize("name", SETS)
def test_errors_keep_their_bounds(name, load, data_dir, tmp_path, monkeypatch):
    module = load(name)
    if name in FORMS:
        monkeypatch.setattr(module, "FORMS", FORMS[name](module))
    if name == "three_muscle_arm":
        monkeypatch.setattr(module, "FREQUENCIES", module.FREQUENCIES[-1:])
    if name in LOOPS:
        monkeypatch.setattr(module, "LOOPS", LOOPS[name](module))
    section = module.validate(data_dir(name), tmp_path)
    assert section.bounds
    for bound in section.bounds:
        assert bound.is_kept, bound
    if name == "three_cable_robot":  # of a form with a factor of the command, too
        assert "commands.scale" in " ".join(section.text)


def test_the_page_has_all_of_them(load):
    assert sorted(load("report").SETS) == SETS
