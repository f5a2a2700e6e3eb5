"""``bozzini demo``: the main job on a tract that the package makes itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bozzini import Plan
from bozzini.cli.main import main
from tests.cli.plan_cases import list_all

FILES = {"plan.npz", "summary.json", "report.html", "picture.png", "scene.glb"}
FILES |= {"centreline.mrk.json", "centreline.vtp"}


def run_demo(place: Path, *options: str) -> tuple[int, dict[str, Any]]:
    # Coarse, to be quick; the pylorus of so coarse a phantom has no room for the default scope.
    code = main(
        ["demo", "--voxel", "3mm", "--diameter", "6mm", "--quiet", *options, "--out", str(place)]
    )
    return code, json.loads((place / "summary.json").read_text("utf-8"))


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, dict[str, Any]]:
    place = tmp_path_factory.mktemp("demo") / "first"
    return place, *run_demo(place)


def test_the_scope_travels_through_the_whole_phantom(
    demo: tuple[Path, int, dict[str, Any]],
) -> None:
    place, code, summary = demo
    assert {path.name for path in place.iterdir()} == FILES
    assert summary["status"] == "complete"
    assert code == (0 if summary["fits"] else 1)
    assert summary["inserted_mm"] == pytest.approx(summary["centreline_length_mm"], rel=0.02)
    # Oesophagus, stomach and duodenum: longer than half a metre, no longer than a gastroscope.
    assert 400.0 < summary["centreline_length_mm"] < 1100.0


def test_the_input_is_on_record(demo: tuple[Path, int, dict[str, Any]]) -> None:
    place, _, summary = demo
    expected = {"file": "phantom", "seed": 0, "voxel_mm": 3.0}
    assert expected.items() <= summary["input"].items()
    assert expected.items() <= Plan.load(place / "plan.npz").meta["input"].items()
    assert "phantom" in summary["seconds"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_plan_and_another_seed_another(
    demo: tuple[Path, int, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = Plan.load(demo[0] / "plan.npz")
    capsys.readouterr()
    _, summary = run_demo(tmp_path / "again", "--seed", "0", "--json")
    assert json.loads(capsys.readouterr().out) == summary
    again = Plan.load(tmp_path / "again" / "plan.npz")
    assert np.array_equal(first.joints, again.joints)
    _, other = run_demo(tmp_path / "other", "--seed", "3")
    assert other["centreline_length_mm"] != pytest.approx(first.path_arc_length[-1], abs=1.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seed", "-1"], ["seed", "-1", "[0"]),
        (["--seed", "one"], ["--seed", "'one'"]),
        (["--voxel", "0"], ["voxel", "0"]),
        (["--voxel", "1um"], ["voxel", "0.001"]),
        (["--voxel", "1m"], ["1000"]),
        (["--diameter", "-9mm"], ["diameter", "-9", "[0.1, 500]"]),
        (["--link", "3m"], ["link", "3000", "at most"]),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_bad_options_are_one_line_and_leave_nothing(
    options: list[str],
    words: list[str],
    as_json: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    place = tmp_path / "demo"
    coarse = [] if "--voxel" in options else ["--voxel", "3mm"]
    assert main(["demo", *coarse, *options, *["--json"] * as_json, "--out", str(place)]) == 2
    out, err = capsys.readouterr()
    assert err.startswith("bozzini: error: ") and err.count("\n") == 1
    assert all(word in err for word in words), err
    if as_json:
        assert err == f"bozzini: error: {json.loads(out)['error']['message']}\n"
    else:
        assert out == ""
    assert list_all(tmp_path) == set()


def test_a_directory_that_exists_is_not_touched(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--out", str(tmp_path)]) == 2
    assert "--force" in capsys.readouterr().err
    assert list_all(tmp_path) == set()
