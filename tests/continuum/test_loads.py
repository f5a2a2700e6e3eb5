"""Loads as arrays: frames of loads, weight in a turned base, shapes in the world."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bozzini.continuum import ContinuumRobot, LineLoad, PointLoad, Section, Tendon, pack_loads
from bozzini.errors import InputError

TURN = (0.4, -1.1, 0.7)


def make(*, discs: int = 4, **base: object) -> ContinuumRobot:
    tendons = tuple(Tendon(name=f"T{k}", offset=3.0, angle=k * math.pi / 2.0) for k in range(4))
    section = Section(
        length=60.0, radius=4.0, discs=discs, tendons=tendons, line_weight=0.002, disc_weight=0.05
    )
    return ContinuumRobot((section,), **base)  # type: ignore[arg-type]


def test_all_weight_is_packed_and_turns_with_the_base() -> None:
    straight, turned = pack_loads(make()), pack_loads(make(base_rotation=TURN))
    places = (np.arange(600) + 0.5) / 10.0
    for packed, robot in ((straight, make()), (turned, make(base_rotation=TURN))):
        dead, body = packed.line_forces_at(robot, places)
        whole = 0.1 * dead.sum(axis=0) + packed.forces.sum(axis=0)
        assert not body.any()
        assert robot.base_frame[:3, :3] @ whole == pytest.approx([0.0, 0.0, -0.002 * 60.0 - 0.2])
    back = Rotation.from_rotvec(TURN).as_matrix()
    assert turned.forces @ back.T == pytest.approx(straight.forces)
    assert back @ turned.down == pytest.approx(straight.down)


def test_loads_of_the_world_are_those_of_the_base_turned_back() -> None:
    robot = make(base_rotation=TURN)
    force, moment = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    back = robot.base_frame[:3, :3].T
    world = pack_loads(robot, [PointLoad(force=force, moment=moment, frame="world")])  # type: ignore[arg-type]
    base = pack_loads(robot, tip_force=tuple(back @ force), tip_moment=tuple(back @ moment))
    for name in ("points", "forces", "moments", "frames"):
        assert getattr(world, name) == pytest.approx(getattr(base, name))
    line = pack_loads(
        robot, [LineLoad(force=(0.0, 0.0, -1.0), frame="world", start=10.0, end=20.0)]
    )
    dead, _ = line.line_forces_at(robot, [5.0, 15.0, 25.0])
    assert dead - dead[0] == pytest.approx(np.outer([0.0, 1.0, 0.0], line.down))


def test_followers_stay_in_the_axes_of_the_body() -> None:
    robot = make(base_rotation=TURN)
    packed = pack_loads(robot, [LineLoad(force=(1.0, 0.0, 0.0), frame="body")])
    _, body = packed.line_forces_at(robot, [30.0])
    assert body.tolist() == [[1.0, 0.0, 0.0]]


def test_shapes_stand_in_the_world() -> None:
    robot = make(base_rotation=TURN, base_position=(10.0, 0.0, -3.0))
    shape = robot.forward([1.0, 0.0, -1.0, 0.0], model="arc")
    inside = shape.world_points - shape.world_points[0]
    assert shape.world_points[0].tolist() == [10.0, 0.0, -3.0]
    assert inside @ robot.base_frame[:3, :3] == pytest.approx(shape.points, abs=1e-12)
    assert shape.stable and shape.stability == np.inf


def test_a_model_notes_what_it_leaves_out() -> None:
    (note,) = make().model("arc").notes
    assert note == "the arc model leaves out the robot's weight"


def test_a_tension_beyond_its_limit_is_no_shape() -> None:
    tendons = tuple(
        Tendon(name=f"T{k}", offset=3.0, angle=k * math.pi, tension_limit=limit)
        for k, limit in enumerate((2.0, math.inf))
    )
    section = Section(length=60.0, radius=4.0, tendons=tendons, bending_stiffness=900.0)
    pulls = np.array([1.0, 2.0])[:, None] * [1.0, -1.0]
    tight = ContinuumRobot((section,)).forward(pulls, model="energy")
    # The tension's moment bends the backbone: T a = EI / L d / a.
    assert tight.tensions[:, 0] == pytest.approx(900.0 / 60.0 / 9.0 * pulls[:, 0], rel=0.05)
    assert tight.converged.tolist() == [True, False]
    assert "tendon 'T0' has a tension of" in str(tight.reason[1])
    assert "its limit is 2 N" in str(tight.reason[1])


def test_loads_are_refused() -> None:
    for loads, line in (
        ([PointLoad(arc_length=61.0)], r"loads\[0\] arc_length is 61 mm: it must lie in \[0, 60\]"),
        ([LineLoad(force=(1, 0, 0), start=60.0)], r"start is 60 mm: it must lie in \[0, 60\) mm"),
        ([(1, 2, 3)], "loads hold"),
        (3, "loads is 3"),
    ):
        with pytest.raises(InputError, match=line):
            pack_loads(make(), loads)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="load's end is 2 mm: it must lie after its start, 3 mm"):
        LineLoad(force=(1.0, 0.0, 0.0), start=3.0, end=2.0)
    with pytest.raises(InputError, match="load's frame is 'tool'"):
        PointLoad(frame="tool")  # type: ignore[arg-type]
