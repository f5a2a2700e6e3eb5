"""``bozzini plan``: what it answers and what it writes."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from bozzini import Plan
from bozzini.cli.main import main
from tests.cli.plan_cases import CURVE, SCOPE, Outcome, Run, Tracts

FILES = {
    "plan.npz",
    "summary.json",
    "report.html",
    "picture.png",
    "scene.glb",
    "centreline.mrk.json",
    "centreline.vtp",
}

KEYS: dict[str, type | tuple[type, ...]] = {
    "method": str,
    "status": str,
    "reason": str,
    "certified": bool,
    "stopped_at_mm": (float, type(None)),
    "centreline_length_mm": float,
    "inserted_mm": float,
    "steps": int,
    "links": int,
    "clearance_min_mm": float,
    "clearance_where_mm": float,
    "joint_step_max_mm": float,
    "head_step_mm": float,
    "joint_angle_max_rad": float,
    "seconds": dict,
}
"""What ``--json`` promises."""


@pytest.fixture(scope="module")
def good(tracts: Tracts, tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, Path]:
    """One run with ``--json``, output caught where the tests below can share it."""
    place = tmp_path_factory.mktemp("good") / "deep" / "plan"
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["plan", str(tracts.volume), *SCOPE, "--json", "--out", str(place)])
    return Outcome(code, out.getvalue(), err.getvalue()), place


def test_json_is_what_was_promised(good: tuple[Outcome, Path]) -> None:
    result = good[0].result
    for key, kind in KEYS.items():
        assert isinstance(result[key], kind), key
        assert not (kind is int and isinstance(result[key], bool)), key
    assert result["status"] == "complete"
    assert result["stopped_at_mm"] is None
    assert result["inserted_mm"] == pytest.approx(result["centreline_length_mm"], rel=0.02)
    assert {"read", "distance", "centreline", "plan", "report"} <= set(result["seconds"])
    assert all(0.0 <= value < 300.0 for value in result["seconds"].values())


def test_exit_code_says_whether_it_fits(good: tuple[Outcome, Path]) -> None:
    assert good[0].code == (0 if good[0].result["fits"] else 1)
    result = good[0].result
    assert result["fits"] == (result["status"] == "complete" and result["certified"])


def test_stderr_holds_no_result(good: tuple[Outcome, Path]) -> None:
    assert all(line.startswith("bozzini: ") for line in good[0].err.splitlines())
    assert "{" not in good[0].err


def test_files_are_written_and_nothing_else(good: tuple[Outcome, Path]) -> None:
    outcome, place = good
    assert {path.name for path in place.iterdir()} == FILES
    assert [path.name for path in place.parent.iterdir()] == [place.name]
    assert json.loads((place / "summary.json").read_text("utf-8")) == outcome.result


def test_plan_file_and_summary_say_the_same(good: tuple[Outcome, Path]) -> None:
    outcome, place = good
    plan, result = Plan.load(place / "plan.npz"), outcome.result
    assert (plan.method, plan.status, plan.reason) == (
        result["method"],
        result["status"],
        result["reason"],
    )
    assert (plan.steps, plan.links) == (result["steps"], result["links"])
    assert plan.inserted == pytest.approx(result["inserted_mm"])
    assert plan.clearance_min == pytest.approx(result["clearance_min_mm"])
    moves = np.linalg.norm(np.diff(plan.joints, axis=0), axis=2)
    assert moves.max() == pytest.approx(result["joint_step_max_mm"])
    assert np.linalg.norm(np.diff(plan.joints, axis=1), axis=2) == pytest.approx(8.0, abs=1e-6)
    assert plan.input.file == "tube.nii.gz"
    assert len(plan.input.sha256) == 64


def test_without_json_people_get_sentences(tracts: Tracts, run: Run, tmp_path: Path) -> None:
    outcome = run(tracts.volume, *SCOPE, "--out", tmp_path / "plan")
    assert outcome.code in (0, 1)
    assert str(tmp_path / "plan" / "report.html") in outcome.out
    with pytest.raises(json.JSONDecodeError):
        json.loads(outcome.out)


@pytest.mark.slow
def test_a_scope_that_is_too_thick_is_an_answer_not_an_error(
    tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    outcome = run(
        tracts.volume, "--diameter", "18mm", "--link", "8mm", "--json", "--out", tmp_path / "plan"
    )
    assert outcome.code == 1
    result = outcome.result
    assert (result["status"], result["fits"], result["inserted_mm"]) == ("stopped", False, 0.0)
    assert result["stopped_at_mm"] == result["inserted_mm"]
    assert result["reason"] and result["reason_code"]
    assert {path.name for path in (tmp_path / "plan").iterdir()} == FILES


def test_the_answer_is_told_before_what_would_fit_is_sought(
    tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    options = (tracts.volume, "--diameter", "18mm", "--link", "8mm", "--organ", "colon")
    told = run(*options, "--out", tmp_path / "told")
    assert "stopped: does not fit at the entry" in told.err and "Would fit" in told.out
    bare = run(*options, "--no-advice", "--out", tmp_path / "bare")
    assert "looking for" not in bare.err and "Would fit" not in bare.out
    assert told.out.split(". Would fit")[0] in bare.out
    folders = (tmp_path / "told", tmp_path / "bare")
    commands = [json.loads((folder / "summary.json").read_text())["command"] for folder in folders]
    assert [command.endswith(" --no-advice") for command in commands] == [False, True]


def test_inflation_makes_room(
    good: tuple[Outcome, Path], tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    wide = run(tracts.volume, *SCOPE, "--inflate", "2mm", "--json", "--out", tmp_path / "p").result
    assert wide["radius_min_mm"] == pytest.approx(good[0].result["radius_min_mm"] + 2.0, abs=1e-6)
    assert wide["clearance_min_mm"] > good[0].result["clearance_min_mm"]


def test_reverse_enters_at_the_other_end(
    good: tuple[Outcome, Path], tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    assert run(tracts.volume, *SCOPE, "--reverse", "--json", "--out", tmp_path / "p").code in (0, 1)
    forth, back = Plan.load(good[1] / "plan.npz"), Plan.load(tmp_path / "p" / "plan.npz")
    assert back.path[0] == pytest.approx(forth.path[-1], abs=2.0)
    assert back.path[-1] == pytest.approx(forth.path[0], abs=2.0)


@pytest.mark.slow
def test_ends_given_as_points_and_as_labels(tracts: Tracts, run: Run, tmp_path: Path) -> None:
    low = CURVE.min(axis=0) - 12.0
    start, end = CURVE[3] - low, CURVE[-4] - low
    text = [",".join(f"{value:.3f}mm" for value in point) for point in (start, end)]
    given = ["--start", text[0], "--end", text[1]]
    points = run(tracts.volume, *SCOPE, *given, "--json", "--out", tmp_path / "p")
    plan = Plan.load(tmp_path / "p" / "plan.npz")
    assert points.code in (0, 1)
    assert plan.path[0] == pytest.approx(start, abs=1e-3)
    assert plan.path[-1] == pytest.approx(end, abs=1e-3)
    labels = run(
        tracts.halves,
        *SCOPE,
        "--labels",
        "all",
        "--start",
        "2",
        "--end",
        "1",
        "--json",
        "--out",
        tmp_path / "l",
    )
    plan = Plan.load(tmp_path / "l" / "plan.npz")
    ends = [tracts.labels[tuple(np.rint(plan.path[k] / 1.5).astype(int))] for k in (0, -1)]
    assert ends == [2, 1]
    assert labels.result["input"]["start"] == 2


def test_length_of_the_scope_is_kept(tracts: Tracts, run: Run, tmp_path: Path) -> None:
    result = run(
        tracts.volume, *SCOPE, "--length", "2.4cm", "--json", "--out", tmp_path / "p"
    ).result
    assert result["links"] == 3
    assert Plan.load(tmp_path / "p" / "plan.npz").joints.shape[1] == 4


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb"])
def test_every_kind_of_surface_gives_the_same_plan(
    tracts: Tracts, run: Run, tmp_path: Path, suffix: str
) -> None:
    source = tmp_path / f"tube.{suffix}"
    tracts.mesh.export(source)
    unit = ["--unit", "mm"] if suffix == "glb" else []  # its standard says metres
    outcome = run(source, *SCOPE, *unit, "--json", "--out", tmp_path / "p")
    assert outcome.code in (0, 1)
    expected = np.linalg.norm(np.diff(CURVE, axis=0), axis=1).sum()
    assert outcome.result["status"] == "complete"
    assert outcome.result["centreline_length_mm"] == pytest.approx(expected, abs=8.0)
    assert outcome.result["wall"] == "triangles of the surface"


@pytest.mark.slow
def test_unit_of_a_surface(tracts: Tracts, run: Run, tmp_path: Path) -> None:
    metres = tracts.mesh.copy()
    metres.apply_scale(1e-3)
    metres.export(tmp_path / "tube.ply")
    small = run(tmp_path / "tube.ply", *SCOPE, "--unit", "m", "--json", "--out", tmp_path / "m")
    large = run(tracts.surface, *SCOPE, "--json", "--out", tmp_path / "mm")
    for key in ("centreline_length_mm", "radius_min_mm"):
        assert small.result[key] == pytest.approx(large.result[key], rel=1e-2)


@pytest.mark.slow
def test_force_replaces_a_result_as_a_whole_but_no_files_of_the_user(
    tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    place = tmp_path / "plan"
    command = (tracts.volume, *SCOPE, "--force", "--quiet", "--out", place)
    assert run(*command).code in (0, 1)
    summary = json.loads((place / "summary.json").read_text(encoding="utf-8"))
    assert set(summary["files"]) == FILES
    (place / "robot.png").write_text("of an earlier run with other options")
    (place / "summary.json").write_text(json.dumps({"files": [*FILES, "robot.png"]}))
    assert run(*command).code in (0, 1)
    assert {path.name for path in place.iterdir()} == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["plan"]
    (place / "mine.txt").write_text("mine")
    before = (place / "summary.json").read_bytes()
    outcome = run(*command)
    assert (outcome.code, outcome.out) == (2, "")
    assert "holds 'mine.txt'" in outcome.err and outcome.err.count("\n") == 1
    assert (place / "mine.txt").read_text(encoding="utf-8") == "mine"
    assert (place / "summary.json").read_bytes() == before


def test_a_name_that_is_not_utf8_goes_through(tracts: Tracts, run: Run, tmp_path: Path) -> None:
    source = tmp_path / "\udcff é.stl"
    try:
        source.write_bytes(tracts.surface.read_bytes())
    except (OSError, UnicodeError):
        pytest.skip("this file system takes UTF-8 only")
    place = tmp_path / "out\udcfe"
    outcome = run(source, *SCOPE, "--quiet", "--json", "--out", place)
    assert outcome.code in (0, 1), outcome.err
    summary = json.loads((place / "summary.json").read_text("ascii"))
    assert summary["input"]["file"] == outcome.result["input"]["file"] == source.name
    assert "\\udcff é.stl" in (place / "report.html").read_text("utf-8")


def test_warnings_stand_on_stderr_once_and_notes_are_counted(
    tracts: Tracts, run: Run, tmp_path: Path
) -> None:
    outcome = run(tracts.halves, *SCOPE, "--labels", "2", "--quiet", "--out", tmp_path / "plan")
    assert outcome.code in (0, 1)
    summary = json.loads((tmp_path / "plan" / "summary.json").read_text("utf-8"))
    notes = [item for item in summary["findings"] if item["severity"] == "note"]
    warnings = [item for item in summary["findings"] if item["severity"] == "warning"]
    assert notes and warnings
    count = f"{len(notes)} note" + "s" * (len(notes) > 1)
    assert outcome.err.splitlines() == [
        *(f"bozzini: warning: {item['message']}" for item in warnings),
        f"bozzini: note: and {count}: see the report",
    ]
    report = (tmp_path / "plan" / "report.html").read_text("utf-8")
    assert all(item["message"] in report for item in notes)
    assert not any(item["message"] in outcome.out for item in summary["findings"])
