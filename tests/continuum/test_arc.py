"""The constant-curvature model: published forms, lengths, limits, symmetries, Jacobian."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.continuum import ArcModel, ContinuumRobot, Section, Tendon
from bozzini.continuum.arc import arc_frames, bend_vectors, displacements_for, jacobian
from bozzini.errors import GeometryError
from tests.continuum.robots import QUARTER, THIRD, antagonistic_robots, make_robot


def draw_bends(robot: ContinuumRobot, seed: int, size: float = 2.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(len(robot.sections), 2)) * size / 2.0


def turn_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@given(one=st.floats(-6.0, 6.0), two=st.floats(-6.0, 6.0))
def test_three_tendons_as_published(one: float, two: float) -> None:
    # Webster and Jones 2010, section 3.1: tendons at 90, 210 and 330 degrees.
    spacing, length = 4.0, 100.0
    pulled = np.array([one, two, -one - two])
    l1, l2, l3 = length - pulled
    square = l1 * l1 + l2 * l2 + l3 * l3 - l1 * l2 - l1 * l3 - l2 * l3
    if square < 1e-6:
        return
    curvature = 2.0 * math.sqrt(square) / (spacing * (l1 + l2 + l3))
    phi = math.atan2(math.sqrt(3.0) * (l2 + l3 - 2.0 * l1), 3.0 * (l2 - l3))
    theta = curvature * (l1 + l2 + l3) / 3.0
    shape = ArcModel(make_robot((90.0, 210.0, 330.0))).shape(pulled).require()
    bend = theta * np.array([math.cos(phi), math.sin(phi)])
    assert np.allclose(shape.section_parameters, bend, atol=1e-9)
    across = (1.0 - math.cos(theta)) / curvature
    tip = [across * math.cos(phi), across * math.sin(phi), math.sin(theta) / curvature]
    assert np.allclose(shape.tip, tip, atol=1e-6)


def test_two_crossed_tendons_as_published() -> None:
    # Gravagne and Walker: kappa L = sqrt(da^2 + db^2) / a in the plane atan2(db, da).
    bends = bend_vectors(make_robot((0.0, 90.0), pushes=True), [-3.0, 4.0])
    assert np.allclose(bends, [[-0.75, 1.0]])


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_bends_to_displacements_and_back(robot: ContinuumRobot, seed: int) -> None:
    bends = draw_bends(robot, seed)
    assert np.allclose(bend_vectors(robot, displacements_for(robot, bends)), bends, atol=1e-9)


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_lengths_along_the_drawn_tendons_are_those_commanded(
    robot: ContinuumRobot, seed: int
) -> None:
    pulled = displacements_for(robot, draw_bends(robot, seed))
    shapes = [ArcModel(robot, between=between).shape(pulled) for between in (30, 61)]
    assert np.allclose(robot.rest_lengths - shapes[0].tendon_lengths, pulled, atol=1e-9)
    for index in range(len(robot.tendons)):
        drawn = []
        for shape in shapes:
            steps = np.diff(shape.tendon_points[index], axis=0)
            drawn.append(float(np.linalg.norm(steps, axis=-1).sum()))
        # Chords are short by an error of second order: twice the pieces, a quarter of it.
        limit = (4.0 * drawn[1] - drawn[0]) / 3.0
        assert limit == pytest.approx(shapes[0].tendon_lengths[index], abs=1e-4)


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_frames_are_frames_and_stations_their_arc_length_apart(
    robot: ContinuumRobot, seed: int
) -> None:
    shape = ArcModel(robot, between=20).shape(displacements_for(robot, draw_bends(robot, seed)))
    turns = shape.frames[:, :3, :3]
    assert np.allclose(turns @ np.swapaxes(turns, -1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1.0)
    steps = np.diff(shape.points, axis=0)
    arcs = np.diff(shape.arc_length)
    assert np.all(np.linalg.norm(steps, axis=-1) <= arcs * (1.0 + 1e-12))
    assert np.linalg.norm(steps, axis=-1).sum() == pytest.approx(robot.length, rel=1e-2)
    # The tangent is the backbone's direction, midway on either side.
    middle = turns[1:, :, 2] + turns[:-1, :, 2]
    cosine = np.sum(steps * middle, axis=-1) / np.linalg.norm(steps, axis=-1)
    assert np.allclose(cosine / np.linalg.norm(middle, axis=-1), 1.0, atol=1e-9)


@given(seed=st.integers(0, 1000), angle=st.floats(-3.0, 3.0))
def test_turning_the_tendons_turns_the_robot(seed: int, angle: float) -> None:
    robot = make_robot(THIRD, QUARTER)
    turned = make_robot(
        [a + math.degrees(angle) for a in THIRD], [a + math.degrees(angle) for a in QUARTER]
    )
    pulled = displacements_for(robot, draw_bends(robot, seed))
    one, other = ArcModel(robot).shape(pulled), ArcModel(turned).shape(pulled)
    turn = turn_z(angle)
    assert np.allclose(other.points, one.points @ turn.T, atol=1e-9)
    assert np.allclose(other.frames[:, :3, :3], turn @ one.frames[:, :3, :3] @ turn.T, atol=1e-9)


def test_straight_robot_is_straight() -> None:
    shape = ArcModel(make_robot(THIRD, THIRD)).shape(np.zeros(6)).require()
    assert np.allclose(shape.points[:, 2], shape.arc_length)
    assert np.allclose(shape.frames[:, :3, :3], np.eye(3))
    assert np.allclose(shape.tendon_lengths, shape.robot.rest_lengths)


@given(size=st.floats(-12.0, -1.0), phi=st.floats(-3.0, 3.0))
def test_straight_limit_is_smooth(size: float, phi: float) -> None:
    robot = make_robot(THIRD)
    bend = 10.0**size * np.array([[math.cos(phi), math.sin(phi)]])
    tip = arc_frames(robot, bend)[-1, :3, 3]
    first = jacobian(robot, np.zeros((1, 2)))[:3] @ bend[0]
    # Off the tangent by second order only; L theta^2 / 6 along the axis.
    assert np.linalg.norm(tip - [0.0, 0.0, 100.0] - first) <= 100.0 * 10.0 ** (2 * size) / 5 + 1e-13


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000), size=st.sampled_from([0.0, 0.1, 3]))
def test_jacobian_is_the_central_difference(robot: ContinuumRobot, seed: int, size: float) -> None:
    bends = draw_bends(robot, seed, size)
    step = 1e-5
    exact = jacobian(robot, bends)
    tip = arc_frames(robot, bends)[-1]
    measured = np.empty_like(exact)
    for column in range(bends.size):
        change = np.zeros(bends.size)
        change[column] = step
        change = change.reshape(bends.shape)
        rate = arc_frames(robot, bends + change)[-1] - arc_frames(robot, bends - change)[-1]
        rate /= 2.0 * step
        spin = rate[:3, :3] @ tip[:3, :3].T
        measured[:, column] = [*rate[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    assert np.abs(exact[3:] - measured[3:]).max() < 1e-6
    assert np.abs(exact[:3] - measured[:3]).max() < 1e-6 * robot.length


def test_batch_is_pointwise() -> None:
    robot = make_robot(THIRD, QUARTER)
    random = np.random.default_rng(3)
    bends = random.normal(size=(4, 5, 2, 2))
    pulled = displacements_for(robot, bends)
    model = ArcModel(robot)
    batch = model.shape(pulled)
    assert batch.frames.shape == (4, 5, 41, 4, 4)
    assert jacobian(robot, bends).shape == (4, 5, 6, 4)
    for place in np.ndindex(4, 5):
        alone = model.shape(pulled[place])
        assert np.allclose(batch.frames[place], alone.frames, atol=1e-12)
        assert np.allclose(batch.tendon_lengths[place], alone.tendon_lengths, atol=1e-12)
        assert np.array_equal(jacobian(robot, bends)[place], jacobian(robot, bends[place]))


def test_an_arc_cut_in_two_is_the_same_arc() -> None:
    whole = arc_frames(make_robot(THIRD), [[1.2, -0.7]], arc_length=[0.0, 50.0, 100.0])
    parts = arc_frames(
        make_robot(THIRD, THIRD, length=50.0),
        [[0.6, -0.35], [0.6, -0.35]],
        arc_length=[0.0, 50.0, 100.0],
    )
    assert np.allclose(whole, parts)


def test_limits_are_told() -> None:
    tendons = tuple(
        Tendon(name=f"t{k}", offset=4.0, angle=math.radians(a), travel=(-5.0, 5.0))
        for k, a in enumerate(THIRD)
    )
    robot = ContinuumRobot(
        (Section(length=100.0, radius=6.0, tendons=tendons, max_bend=1.0, name="arm"),)
    )
    shape = ArcModel(robot).shape([[3.0, -1.5, -1.5], [4.4, -2.2, -2.2], [6.0, -3.0, -3.0]])
    assert shape.converged.tolist() == [True, False, False]
    assert shape.reason[0] == ""
    assert "section 1 'arm' would bend 63.03 deg: its largest bend is 57.3 deg" in shape.reason[1]
    assert "'t0' is moved 6 mm: its travel is [-5, 5] mm" in shape.reason[2]
    with pytest.raises(GeometryError, match=re.escape(shape.reason[1])):
        shape.require()


def test_bend_as_tight_as_the_body_is_refused() -> None:
    robot = make_robot(THIRD)  # radius 6, length 100
    most = 100.0 / 6.0 * 4.0
    good = ArcModel(robot).shape(np.array([1.0, -0.5, -0.5]) * most * 0.999)
    bad = ArcModel(robot).shape(np.array([1.0, -0.5, -0.5]) * most * 1.001)
    assert good.converged
    assert not bad.converged
    assert "discs, of radius 6 mm, meet" in str(bad.reason)
