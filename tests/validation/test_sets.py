"""What is validated on measured data keeps its bounds; `make validate` does the same on more."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "validation"
SETS = sorted(
    {path.stem for path in FOLDER.glob("*.py")} - {"report", "section", "estimates", "loops"}
)

LESS = {
    "festo10": lambda module: {"FORMS": (module.ANCHORED, module.MEAN), "LOOPS": 1},
    "tentacle": lambda module: {"FORMS": (module.CHOSEN[:2], module.CHOSEN), "OTHER_FOLDS": 0},
    "three_section_robot": lambda module: {
        "FORMS": {module.CHOSEN: module.FORMS[module.CHOSEN]},
        "QUARTERS": module.QUARTERS[1:2],
        "LOOPS": module.LOOPS[:1],
    },
    "three_muscle_arm": lambda module: {
        "FORMS": {"all": module.FORMS["all"]},
        "FREQUENCIES": module.FREQUENCIES[-1:],
        "ARMS": 25,
        "PLANTS": 3,
    },
}
"""What has a bound, and of what is repeated a part; `make validate` runs the rest, too."""


@pytest.fixture(scope="module")
def load():
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module
    sys.path.remove(str(FOLDER))


@pytest.mark.slow(100)
@pytest.mark.parametrize("name", SETS)
def test_errors_keep_their_bounds(name, load, data_dir, tmp_path, monkeypatch):
    module = load(name)
    for attribute, less in LESS.get(name, lambda _: {})(module).items():
        monkeypatch.setattr(module, attribute, less)
    section = module.validate(data_dir(name), tmp_path)
    assert section.bounds
    for bound in section.bounds:
        assert bound.is_kept, bound
    if name == "three_cable_robot":  # of a form with a factor of the command, too
        assert "commands.scale" in " ".join(section.text)


def test_the_page_has_all_of_them(load):
    assert sorted(load("report").SETS) == SETS
