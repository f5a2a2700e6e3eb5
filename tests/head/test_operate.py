"""A scripted operator touches targets, seen by a still camera and by one on the tip."""

from __future__ import annotations

import csv
import json
import math

import numpy as np
import pytest

from bozzini.cli.main import main
from bozzini.errors import InputError
from bozzini.head import Head, compare_cameras, list_touches, stand_head
from bozzini.head.operate import TOLERANCE, TargetTask, look_from_tip
from tests.head.test_reach import TURNS, files, make_tube  # noqa: F401


def find_touches(name: str = "none"):
    duct, plan = make_tube(turn=TURNS[name])
    stand = stand_head(plan, 100.0)
    return stand, list_touches(Head(), stand, duct=duct, samples=200), duct


def test_only_the_camera_on_the_tip_moves_and_by_the_section_s_bend() -> None:
    stand, touches, duct = find_touches()
    chosen = touches.choose(5)
    found = compare_cameras(Head(), stand, touches=chosen, duct=duct)
    still, tip = found.rows
    assert found.converged and len(found.touches) == 5 and found.error < 0.1
    assert (still.turn, still.turn_most, still.shift) == (0.0, 0.0, 0.0)
    poses = Head().effectors[0].shape(chosen.bends)
    leans = np.arccos(poses.direction[:, 2])
    assert tip.turn_most == pytest.approx(leans.max(), abs=1e-3)
    # There and at least to the nearest lean back.
    assert tip.turn >= np.abs(np.diff(np.append(0.0, leans))).sum() - 1e-6
    assert tip.shift > 100.0
    assert (still.time, still.path) == (tip.time, tip.path)
    assert still.path == pytest.approx(np.linalg.norm(np.diff(found.tip, axis=0), axis=1).sum())
    fast = compare_cameras(Head(), stand, touches=chosen, duct=duct, speed=20.0)
    assert fast.rows[0].time == pytest.approx(0.5 * still.time)
    assert fast.rows[1].turn == tip.turn


def test_touches_are_on_the_wall_where_the_instrument_is() -> None:
    stand, touches, duct = find_touches()
    poses = Head().effectors[0].shape(touches.bends)
    tips = poses.holder_tip + touches.out[:, None] * poses.direction
    assert stand.origin + tips @ stand.frame.T == pytest.approx(touches.place)
    assert np.abs(duct.signed_distance(touches.place)).max() < 0.05
    few = touches.choose(3)
    assert few.place == pytest.approx(touches.choose(5).place[:3])
    with pytest.raises(InputError, match=f"touches the wall at {len(touches.place)} of the places"):
        touches.choose(100)


def test_turning_the_tract_turns_nothing_that_is_seen() -> None:
    answers = []
    for name in ("none", "axes"):
        stand, touches, duct = find_touches(name)
        answers.append(compare_cameras(Head(), stand, touches=touches.choose(4), duct=duct))
    one, other = answers
    for name in ("time", "turn", "turn_most", "shift", "share_in_view"):
        assert getattr(one.rows[1], name) == pytest.approx(getattr(other.rows[1], name), rel=1e-6)


def test_camera_on_the_tip_has_the_instrument_in_its_middle_and_does_not_roll() -> None:
    placed = Head().effectors[0]
    poses = placed.shape(np.array([[0.0, 0.0], [12.0, 0.0], [0.0, 9.0], [5.0, -8.0]]))
    for k in range(4):
        camera = look_from_tip(Head(), poses, k)
        assert camera.project(poses.tip[k]) == pytest.approx([239.5, 239.5], abs=1e-6)
    straight, bent = (look_from_tip(Head(), poses, k).rotation for k in (0, 3))
    turn = bent.T @ straight
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    assert axis[2] == pytest.approx(0.0, abs=1e-9)  # the section bends without twist
    lean = math.acos(float(poses.direction[3, 2]))
    assert math.acos(0.5 * (np.trace(turn) - 1.0)) == pytest.approx(lean)


def test_a_touch_counts_once_for_the_target_of_the_turn() -> None:
    task = TargetTask(np.array([[0.0, 0.0, 10.0], [0.0, 5.0, 10.0]]))
    task.take(0.0, np.zeros(3), touches=False)
    task.take(7.0, np.zeros(3), touches=False)  # nothing has moved: it has not begun
    task.take(8.0, np.array([0.0, 0.0, 4.0]), touches=False)
    task.take(9.0, np.array([0.0, 1.0, 10.0]), touches=True)
    task.take(9.5, np.array([0.0, 1.0, 10.0]), touches=True)
    task.take(10.0, np.array([0.0, 1.0, 9.0]), touches=False)
    task.take(11.0, np.array([0.0, 5.5 + TOLERANCE, 10.0]), touches=True)  # of something else
    (row,) = task.rows
    assert row.error == pytest.approx(1.0)
    assert row.path == pytest.approx(4.0 + math.hypot(1.0, 6.0))
    assert row.time == pytest.approx(2.0)
    task.take(12.0, np.array([0.0, 5.0, 9.0]), touches=False)
    task.take(13.0, np.array([0.0, 5.0, 10.0]), touches=True)
    assert task.is_done and task.rows[1].time == pytest.approx(4.0)


def test_the_command_compares(files, tmp_path, capsys) -> None:  # noqa: F811
    table, picture = tmp_path / "rows.csv", tmp_path / "way.png"
    given = ["head", "compare", str(files / "tube.npz"), str(files / "tube.stl")]
    near = ["--at", "100mm", "--samples", "100"]
    assert main([*given, *near, "--json", "--out", str(table)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert [row["camera"] for row in answer["rows"]] == ["still", "tip"]
    assert answer["rows"][0]["shift_px"] == 0.0 < answer["rows"][1]["shift_px"]
    with table.open() as file:
        assert len(list(csv.DictReader(file))) == 2
    assert main([*given, *near, "--targets", "2", "--out", str(picture)]) == 0
    assert "2 of 2 targets touched" in capsys.readouterr().out
    assert main([*given, *near, "--targets", "100"]) == 2
    assert "targets is 100" in capsys.readouterr().err
