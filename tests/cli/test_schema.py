"""JSON Schemas: files that the package writes keep them, and the reader refuses what they do."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from bozzini.cli.main import main
from bozzini.cli.schema import SCHEMAS
from bozzini.continuum import ContinuumRobot
from bozzini.duct.shape_files import read_shapes, save_shapes
from bozzini.errors import InputError
from bozzini.io.records import load_data, parse_yaml, read_record
from bozzini.motion.plan import Plan
from bozzini.muscle import EndEffects, MuscleFile, preset, write_muscle
from bozzini.physics.manoeuvre import Manoeuvre
from bozzini.study import StudySpec
from tests.duct.test_registry import OWN
from tests.muscle.test_files import FIT
from tests.plot.fake_motion import make_plan, make_stopped

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ROBOTS = ("two_sections", "helical", "gastroscope", "colonoscope", "converging")


def _check(kind: str, data: object) -> list[str]:
    schema = json.loads(json.dumps(SCHEMAS[kind]()))
    return [error.message for error in Draft202012Validator(schema).iter_errors(data)]


@pytest.mark.parametrize("kind", SCHEMAS)
def test_a_schema_is_one_and_is_written(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["schema", kind, "--json"]) == 0
    schema = json.loads(capsys.readouterr().out)
    Draft202012Validator.check_schema(schema)
    assert main(["schema", kind, "--out", str(tmp_path / "schema.json")]) == 0
    assert json.loads((tmp_path / "schema.json").read_text(encoding="utf-8")) == schema


@pytest.mark.parametrize("kind", ["plan", "muscle", "robot", "head", "study", "manoeuvre"])
def test_new_files_keep_the_schema(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "new.yaml"
    assert main(["new", kind, "--out", str(path)]) == 0
    assert _check("options" if kind == "plan" else kind, load_data(path)) == []


@pytest.mark.parametrize("name", ROBOTS)
def test_robots_keep_the_schema(name: str, tmp_path: Path) -> None:
    path = EXAMPLES / f"{name}.yaml"
    again = ContinuumRobot.from_yaml(path).to_yaml(tmp_path / "robot.yaml")
    assert _check("robot", load_data(path)) == _check("robot", load_data(again)) == []


@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_a_fitted_muscle_keeps_the_schema(suffix: str, tmp_path: Path) -> None:
    file = MuscleFile(
        muscle=preset("effector-45"),
        model="tondu-lopez",
        constants={"kappa1": 0.1},
        ends=EndEffects(offset=0.3, slack_force=8.0),
        fit=FIT,
    )
    path = write_muscle(tmp_path / f"muscle.{suffix}", file)
    assert _check("muscle", load_data(path)) == []


@pytest.mark.parametrize("kind", OWN)
def test_shapes_keep_the_schema(kind: str, tmp_path: Path) -> None:
    path = save_shapes(OWN[kind], tmp_path / "shapes.yaml", fit="inscribed", note="of a test")
    assert _check("shapes", load_data(path)) == []


@pytest.mark.parametrize("make", [make_plan, make_stopped])
def test_plans_keep_the_schema(make: Callable[[], Plan], tmp_path: Path) -> None:
    plan = make()
    with np.load(plan.save(tmp_path / "plan.npz")) as archive:
        meta = json.loads(str(archive["meta"]))
    assert _check("plan", meta) == []
    for name, value in (("status", "fast"), ("format", "plan"), ("scope", {"diameter_mm": "5 mm"})):
        assert _check("plan", {**meta, name: value})


@pytest.mark.parametrize(
    ("page", "kind", "mark"),
    [
        ("measurements", "muscle", "muscle"),
        ("continuum", "robot", "sections"),
        ("studies", "study", "factors"),
    ],
)
def test_files_in_the_guide_keep_the_schema(page: str, kind: str, mark: str) -> None:
    text = (EXAMPLES.parent / "docs" / "guide" / f"{page}.md").read_text(encoding="utf-8")
    blocks = map(parse_yaml, re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S))
    files = [block for block in blocks if isinstance(block, dict) and mark in block]
    assert files
    assert [_check(kind, file) for file in files] == [[]] * len(files)


def _damage(data: Any) -> list[tuple[str, Any]]:
    """Return copies of a file, each with a field that is wrong at the top or below it."""
    places = [(), *((key,) for key, value in data.items() if isinstance(value, dict))]
    places += [
        (key, 0)
        for key, value in data.items()
        if isinstance(value, list) and value and isinstance(value[0], dict)
    ]
    found = []
    for place in places:
        for name, value in (("no such field", 1), (None, [[]])):
            damaged = copy.deepcopy(data)
            inner = damaged
            for key in place:
                inner = inner[key]
            inner[name or next(iter(inner))] = value
            found.append((f"{place} {name}", damaged))
    return found


def _make(kind: str, path: Path) -> tuple[Any, Callable[[Any], object]]:
    """Return the content of a file, and what reads it."""
    if kind == "shapes":
        save_shapes(OWN["cones"], path)
    else:
        assert main(["new", kind, "--out", str(path)]) == 0
    readers: dict[str, Callable[[Any], object]] = {
        "muscle": lambda data: read_record(data, MuscleFile),
        "robot": lambda data: read_record(data, ContinuumRobot),
        "study": lambda data: read_record(data, StudySpec),
        "manoeuvre": lambda data: read_record(data, Manoeuvre),
        "shapes": read_shapes,
    }
    return load_data(path), readers[kind]


@pytest.mark.parametrize(
    ("kind", "field"),
    [("robot", "sections"), ("study", "factors"), ("shapes", "shapes"), ("manoeuvre", "steps")],
)
def test_what_needs_one_may_not_be_empty(kind: str, field: str, tmp_path: Path) -> None:
    data, read = _make(kind, tmp_path / "file.yaml")
    data[field] = type(data[field])()
    assert _check(kind, data)
    with pytest.raises(InputError):
        read(data)


@pytest.mark.parametrize("kind", ["muscle", "robot", "study", "shapes", "manoeuvre"])
def test_what_the_schema_refuses_the_reader_refuses(kind: str, tmp_path: Path) -> None:
    data, read = _make(kind, tmp_path / "file.yaml")
    read(data)
    refused = 0
    for what, damaged in _damage(data):
        wrong = bool(_check(kind, damaged))
        refused += wrong
        if wrong:
            with pytest.raises(InputError):
                read(damaged)
        else:  # a mapping whose keys are free
            assert "no such field" not in damaged, what
    assert refused >= 3
