"""The command ``continuum fit``, and what the other commands make of the file that it writes."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.continuum import (
    ContinuumRobot,
    DynamicsOptions,
    Marker,
    RobotMeasurements,
    RobotSetup,
    Section,
    Tendon,
    Wire,
    predict_points,
)
from bozzini.continuum import simulate as simulate_motion

ZERO, BACKLASH, OFFSET = 0.2, 0.1, 4.4
FREE = ("--free", "tendons.a.zero,tendons.*.offset")
MARKER = "--marker=m-1=20mm,5mm,0mm,0mm"
NAMES = ("a", "b", "c")


def make_robot(offset: float = 4.0) -> ContinuumRobot:
    tendons = tuple(
        Tendon(name=name, offset=offset, angle=2.0 * np.pi / 3.0 * k, stiffness=1e3)
        for k, name in enumerate(NAMES)
    )
    section = Section(length=40.0, radius=6.0, discs=1, bending_stiffness=500.0, tendons=tendons)
    return ContinuumRobot((section,))


def write_rows(path: Path, rows: range, *, noise: float = 0.0) -> None:
    path.write_text(simulate(rows, noise), encoding="utf-8")


@functools.cache
def simulate(rows: range, noise: float) -> str:
    """Return what a robot with zeros and backlash does, some rows of a sweep in time."""
    markers = (Marker(name="tip"), Marker(name="m-1", arc_length=20.0, offset=(5.0, 0.0, 0.0)))
    truth = RobotSetup(make_robot(OFFSET), markers, (ZERO, 0.0, 0.0), backlash=BACKLASH)
    time_rad = 0.3 * np.arange(rows.stop)[:, None] + 2.0 * np.pi / 3.0 * np.arange(3)
    commands = 2.0 * np.cos(time_rad) * np.sin(0.2 * time_rad[:, :1])
    data = RobotMeasurements(
        command="displacement",
        tendons=NAMES,
        commands=commands,
        markers=truth.markers,
        points=np.zeros((len(commands), 2, 3)),
    )
    points = predict_points(truth, data).predicted
    points += np.random.default_rng(0).normal(0.0, noise, points.shape)
    table = np.column_stack([commands, points.reshape(len(points), -1)])[rows.start :]
    titles = [f"{name} displacement [mm]" for name in NAMES]
    titles += [f"{name} {axis} [mm]" for name in ("tip", "m-1") for axis in "xyz"]
    lines = [",".join(titles), *(",".join(map(repr, row)) for row in table.tolist())]
    return "\n".join(lines) + "\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    robot = make_robot()
    robot.to_yaml("robot.yaml")
    write_rows(tmp_path / "rows.csv", range(16))
    return tmp_path


def fit(*words: str, json_: bool = True) -> int:
    return main(["continuum", "fit", *words, *(["--json"] if json_ else [])])


@pytest.mark.parametrize("more", ["", ",commands.scale"])
def test_a_number_without_effect_stays_and_is_named(folder, capsys, more):
    """An arc's shape does not ask for its stiffness: the derivatives are round-off."""
    name = "sections.1.bending_stiffness"
    options = ("--model", "arc", "--folds", "0", MARKER, "--free", name + more)
    code = fit("robot.yaml", "rows.csv", "--out", "fitted.yaml", *options)
    found = json.loads(capsys.readouterr().out)
    assert code == 1 and found["converged"]
    assert found["undetermined"] == [f"{name} has no effect at these rows: it is not determined"]
    assert found["estimates"][name]["value"] == 500.0
    assert all(found["estimates"][one]["standard_error"] for one in more.split(",")[1:])
    section = ContinuumRobot.from_yaml("fitted.yaml").sections[0]
    assert section.bending_stiffness == 500.0


def test_rows_without_a_converged_shape_are_counted_apart(folder, capsys):
    """The tendons of an arc cannot stretch: pulled all at once they have no shape."""
    rows = (folder / "rows.csv").read_text(encoding="utf-8").splitlines()
    rows[-1] = ",".join(["2", "2", "2", *rows[-1].split(",")[3:]])
    (folder / "rows.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    robot = make_robot()
    tendons = tuple(dataclasses.replace(one, stiffness=math.inf) for one in robot.tendons)
    section = dataclasses.replace(robot.sections[0], tendons=tendons)
    ContinuumRobot((section,)).to_yaml("rigid.yaml")
    fit("rigid.yaml", "rows.csv", "--model", "arc", "--folds", "0", MARKER, json_=False)
    out = capsys.readouterr().out
    held = re.search(r"(\d+) of 16 rows have no converged shape", out)
    assert held and f"fitted 16 rows, {16 - int(held[1])} of 16 with a converged shape" in out


def test_a_fit_writes_a_robot_a_picture_and_a_table(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rows(folder / "more.csv", range(16, 24))
    words = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.a.zero,commands.backlash,"
             "tendons.*.offset", "--check", "more.csv")  # fmt: skip
    assert fit(*words, "--out", "fitted.yaml", "--figure", "errors.png", "--folds", "2") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["estimates"]["tendons.*.offset"]["value"] == pytest.approx(OFFSET, rel=1e-3)
    assert found["estimates"]["tendons.a.zero"]["value"] == pytest.approx(ZERO, abs=1e-3)
    assert found["fit"]["rms_mm"] < 1e-2
    # The rows to check come later in the sweep, with a memory of their own.
    assert found["checks"]["more.csv"]["rms_mm"] < 0.2
    assert (folder / "errors.png").stat().st_size > 1000
    assert fit("fitted.yaml", "rows.csv", "--folds", "0", json_=False) == 0
    assert "fitted 16 rows with 0 constants" in capsys.readouterr().out
    assert fit("fitted.yaml", "rows.csv", "--folds", "0") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["fit"]["rms_mm"] == pytest.approx(found["fit"]["rms_mm"], rel=1e-6)


def test_pose_of_a_fitted_robot_is_what_the_fit_predicts(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.a.zero,commands.backlash")
    assert fit(*words, "--out", "fitted.yaml", "--folds", "0") == 0
    capsys.readouterr()
    rows = np.genfromtxt("rows.csv", delimiter=",", skip_header=1)
    robot = ContinuumRobot.from_yaml("fitted.yaml")
    data = RobotMeasurements(
        command="displacement",
        tendons=NAMES,
        commands=rows[:, :3],
        markers=RobotSetup.of(robot).markers,
        points=rows[:, 3:].reshape(-1, 2, 3),
    )
    predicted = predict_points(RobotSetup.of(robot), data).predicted
    spell = [",".join(f"{name}={value!r}mm" for name, value in zip(NAMES, row, strict=True))
             for row in rows[:, :3].tolist()]  # fmt: skip
    for index in (0, 5):
        before = [word for text in spell[:index] for word in ("--history", text)]
        command = ["continuum", "pose", "fitted.yaml", "--displacement", spell[index], *before]
        assert main([*command, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["model"] == "energy"
        seen = [found["markers_world_mm"][name] for name in ("tip", "m-1")]
        assert np.asarray(seen) == pytest.approx(predicted[index], abs=1e-6)
    assert main(["continuum", "pose", "fitted.yaml", "--displacement", spell[5]]) == 0
    assert "marker m-1 in the world at" in capsys.readouterr().out


def test_what_reach_commands_is_what_pose_takes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.a.zero,commands.scale")
    assert fit(*words, "--out", "fitted.yaml", "--folds", "0") == 0
    capsys.readouterr()
    target = ("--to", "6mm,4mm,37mm")
    assert main(["continuum", "reach", "fitted.yaml", *target, "--json"]) in (0, 1)
    found = json.loads(capsys.readouterr().out)
    commands = ",".join(f"{name}={value!r}mm" for name, value in found["commands_mm"].items())
    assert main(["continuum", "pose", "fitted.yaml", "--displacement", commands, "--json"]) == 0
    posed = json.loads(capsys.readouterr().out)
    assert posed["tip_mm"] == pytest.approx(found["tip_mm"], abs=1e-3)


def test_the_jacobian_of_a_fitted_robot_is_of_its_commands(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.a.zero,commands.scale")
    assert fit(*words, "--out", "fitted.yaml", "--folds", "0") == 0
    tips = []
    for pull in (1.5, 1.501):
        command = ("pose", "fitted.yaml", "--displacement", f"a={pull}mm,b=0.5mm,c=0.5mm")
        capsys.readouterr()
        assert main(["continuum", *command, "--json"]) == 0
        tips.append(json.loads(capsys.readouterr().out)["tip_mm"])
    assert main(["continuum", "jacobian", *command[1:], "--json"]) == 0
    rates = json.loads(capsys.readouterr().out)["by_displacement"]["a"][3:]
    assert np.subtract(tips[1], tips[0]) / 1e-3 == pytest.approx(np.asarray(rates), abs=1e-2)


@pytest.mark.slow
def test_processes_make_no_difference(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rows(folder / "rows.csv", range(16), noise=0.2)
    answers = []
    for jobs in ("1", "2"):
        assert fit("robot.yaml", "rows.csv", MARKER, *FREE, "--folds", "2", "--jobs", jobs) == 0
        answers.append(json.loads(capsys.readouterr().out))
    assert answers[0] == answers[1]


def test_blocks_are_the_labels_of_a_column(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header, *rows = Path("rows.csv").read_text(encoding="utf-8").splitlines()
    labels = ["first"] * 4 + ["second"] * 5 + ["third"] * 7
    lines = [f"{row},{label}" for row, label in zip(rows, labels, strict=True)]
    Path("labelled.csv").write_text("\n".join([f"{header},phase", *lines]) + "\n", encoding="utf-8")
    words = ("robot.yaml", "labelled.csv", MARKER, "--free", "tendons.*.zero")
    assert fit(*words, "--blocks", "phase") == 0
    assert len(json.loads(capsys.readouterr().out)["validation"]["blocks_mm"]) == 3


@pytest.mark.slow
def test_fewer_constants_that_predict_better_are_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rows(folder / "rows.csv", range(12), noise=1.0)
    free = "tendons.*.offset,tendons.each.zero,base.position"
    words = ("robot.yaml", "rows.csv", MARKER, "--free", free, "--folds", "4")
    assert fit(*words, json_=False) in (0, 1)
    said = capsys.readouterr().out
    assert "fewer constants predict better" in said
    better = said.partition("take --free ")[2].splitlines()[0]
    assert fit("robot.yaml", "rows.csv", MARKER, "--free", better, "--folds", "4") in (0, 1)
    alone = json.loads(capsys.readouterr().out)
    assert fit(*words) in (0, 1)
    both = json.loads(capsys.readouterr().out)
    assert both["smaller"]["rms_mm"] <= both["validation"]["rms_mm"]
    assert alone["validation"]["rms_mm"] == pytest.approx(both["smaller"]["rms_mm"], rel=0.02)


def change_cell(path: Path, row: int, column: int, text: str) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    cells = lines[row].split(",")
    cells[column] = text
    lines[row] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("cell", "words", "said"),
    [
        ((0, 0, "a displacement"), (), "column 'a displacement' has no unit"),
        ((0, 0, "a displacement [N]"), (), "column 'a displacement [N]'"),
        ((0, 0, "d displacement [mm]"), (), "there is no tendon 'd'"),
        ((0, 0, "pull of a [mm]"), (), "there is no column 'a displacement [mm]'"),
        ((0, 3, "tip w [mm]"), (), "there is no column 'tip x [mm]'"),
        ((3, 0, "nan"), (), "row 4"),
        ((3, 0, "much"), (), "row 4"),
        ((3, 3, "inf"), (), "row 4"),
        (None, ("--split", "random"), "a random split tests no prediction"),
        (
            None,
            ("--folds", "17"),
            "16 row(s) are too few for 17 folds: --folds must be 2 to 16, or 0",
        ),
        (None, ("--folds", "1"), "folds is 1: it must be 2 or more, or 0 for none"),
        (None, ("--jobs", "0"), "jobs is 0"),
        (None, ("--marker", "m-1=20mm,5mm,0mm,0mm", "--loss", "cubic"), "--loss"),
        (None, ("--blocks", "phase"), "there is no column 'phase'"),
        (None, ("--column", "tip x [mm]=x"), "there is no column 'x'"),
        (None, ("--free", "tendons.*.colour"), "'tendons.*.colour' cannot be fitted"),
        (None, ("--free", "tendons.*.friction", "--model", "energy"), "take the rod model"),
        (None, ("--set", "colour=red"), "--set names 'colour': the options are"),
        (None, ("--model", "energy", "--set", "segment=wrong"), "segment is 'wrong'"),
        (None, ("--marker", "n=1mm,2mm"), "--marker is 'n=1mm,2mm': it must be NAME=ARC"),
        (None, ("--check", "none.csv"), "none.csv"),
    ],
)
def test_wrong_input_is_one_line_and_nothing_is_written(
    cell: tuple[int, int, str] | None,
    words: tuple[str, ...],
    said: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if cell is not None:
        change_cell(folder / "rows.csv", *cell)
    before = sorted(folder.iterdir())
    files = ("--out", "fitted.yaml", "--figure", "errors.png")
    asked = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.*.zero", *files, *words)
    assert fit(*asked, json_=False) == 2
    out, err = capsys.readouterr()
    assert said in err and err.startswith("bozzini: error: ") and err.count("\n") == 1
    assert not out
    assert sorted(folder.iterdir()) == before


def test_too_few_rows_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_rows(folder / "rows.csv", range(1))
    words = ("robot.yaml", "rows.csv", MARKER, "--free", "tendons.each.zero,base", "--folds", "0")
    assert fit(*words) == 2
    assert "6 coordinate(s) are too few for 9 constant(s)" in capsys.readouterr().err


def test_points_that_all_coincide_are_refused_by_a_fit_and_not_judged_by_a_comparison(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header, *rows = Path("rows.csv").read_text(encoding="utf-8").splitlines()
    titles = ",".join(header.split(",")[:6])
    still = [",".join([*row.split(",")[:3], "1", "2", "40.5"]) for row in rows]
    Path("still.csv").write_text("\n".join([titles, *still]) + "\n", encoding="utf-8")
    assert fit("robot.yaml", "still.csv", "--free", "base", json_=False) == 2
    err = capsys.readouterr().err
    assert "all points of 16 row(s) coincide at (1, 2, 40.5) mm" in err and err.count("\n") == 1
    assert fit("robot.yaml", "still.csv", json_=False) == 0
    assert "all points coincide: there is no span" in capsys.readouterr().out


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_few_rows_are_predicted(
    rows: int, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_rows(folder / "rows.csv", range(rows))
    assert fit("robot.yaml", "rows.csv", MARKER) in (0, 1)
    found = json.loads(capsys.readouterr().out)
    assert found["fit"]["rows"] == rows and found["validation"] is None
    assert fit("robot.yaml", "rows.csv", MARKER, "--free", "commands.scale") == 2
    legal = "0 for none" if rows == 1 else f"2 to {rows}, or 0 for none"
    assert f"too few for 4 folds: --folds must be {legal}" in capsys.readouterr().err


def test_a_table_may_lack_a_marker_of_the_robot_file_but_none_that_is_typed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = (MARKER, "--free", "tendons.*.offset", "--folds", "0", "--out", "fitted.yaml")
    assert fit("robot.yaml", "rows.csv", *words) == 0
    lines = Path("rows.csv").read_text(encoding="utf-8").splitlines()
    Path("tips.csv").write_text(
        "\n".join(",".join(row.split(",")[:6]) for row in lines) + "\n", encoding="utf-8"
    )
    capsys.readouterr()
    assert fit("fitted.yaml", "tips.csv") in (0, 1)
    tips = json.loads(capsys.readouterr().out)
    assert "markers of the robot without columns are left out: m-1" in tips["notes"]
    assert fit("fitted.yaml", "rows.csv") in (0, 1)
    both = json.loads(capsys.readouterr().out)
    assert set(tips["fit"]["rms_by_marker_mm"]) == {"tip"}
    same = [found["fit"]["rms_by_marker_mm"]["tip"] for found in (tips, both)]
    assert same[0] == pytest.approx(same[1], rel=1e-9)
    assert fit("fitted.yaml", "tips.csv", MARKER) == 2
    assert "there is no column 'm-1 x [mm]' of 'm-1'" in capsys.readouterr().err


def test_a_calibration_of_other_tendons_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = Path("robot.yaml").read_text(encoding="utf-8") + "calibration: {zeros: {z: 0.1}}\n"
    Path("other.yaml").write_text(robot, encoding="utf-8")
    assert main(["continuum", "pose", "other.yaml", "--displacement", "a=1mm"]) == 2
    err = capsys.readouterr().err
    assert "zero of tendon 'z': the tendons are a, b, c" in err and err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals are others there")
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_an_interrupt_leaves_nothing(folder: Path, jobs: str) -> None:
    # So many rows that no machine is done when it first speaks of blocks, after ten seconds.
    write_rows(folder / "rows.csv", range(1600), noise=0.5)
    before = sorted(folder.iterdir())
    words = ["continuum", "fit", "robot.yaml", "rows.csv", MARKER, "--free",
             "base,tendons.each.zero,tendons.*.offset", "--folds", "40", "--jobs", jobs,
             "--out", "fitted.yaml"]  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, "-m", "bozzini", *words],
        stderr=subprocess.PIPE,
        text=True,
        bufsize=1,
        # Where the tests run in the background, interrupts are ignored unless one asks for them.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "leaving out blocks" in line:
            break
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err and err.endswith("bozzini: interrupted\n")
    assert sorted(folder.iterdir()) == before


def test_a_record_in_time_is_fitted_through_its_motion(folder, capsys):
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    tendons = make_robot().sections[0].tendons
    section = Section(
        length=40.0, radius=6.0, discs=4, disc_weight=5e-3, wire=wire, tendons=tendons
    )
    robot = ContinuumRobot((section,))
    robot.to_yaml("moving.yaml")
    times = np.linspace(0.0, 0.3, 31)
    pulls = 2.0 + 2.0 * np.sin(np.outer(times, [20.0, 40.0, 70.0]))
    options = DynamicsOptions(damping_time=3e-3, max_step=5e-3)
    tip = simulate_motion(robot, times, tensions=pulls, options=options).tip
    titles = [
        "time [s]",
        *(f"{name} tension [N]" for name in NAMES),
        *map("tip {} [mm]".format, "xyz"),
    ]
    rows = np.column_stack([times, pulls, tip]).tolist()
    text = "\n".join([",".join(titles), *(",".join(map(repr, row)) for row in rows)])
    (folder / "record.csv").write_text(text + "\n")
    words = ["moving.yaml", "record.csv", "--in-time", "--max-step=5ms", "--damping-time=1ms"]
    more = ["--free=motion.damping_time", "--folds=0", "--out=fitted.yaml", "--check=record.csv"]
    assert fit(*words, *more) == 0
    found = json.loads(capsys.readouterr().out)
    damping = found["estimates"]["motion.damping_time"]
    assert damping["value"] == pytest.approx(3e-3, rel=1e-3) and damping["unit"] == "s"
    assert found["model"] == "motion" and found["checks"]["record.csv"]["rms_mm"] < 1e-3
    assert main(["continuum", "pose", "fitted.yaml", "--tension", "a=2N", "--json"]) == 0
    assert main(["continuum", "fit", "moving.yaml", "record.csv", "--damping-time=1ms"]) == 2
    assert "without --in-time" in capsys.readouterr().err
