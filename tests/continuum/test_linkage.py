"""The linkage model: the printed optimisation, its bounds, the arc as its limit."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.continuum import ArcModel, ContinuumRobot, LinkageModel, Section, Tendon
from bozzini.continuum.arc import displacements_for
from bozzini.errors import GeometryError
from tests.continuum.reference import solve_chain, solve_segment
from tests.continuum.robots import QUARTER, THIRD, antagonistic_robots, make_robot

LENGTH, SPACING = 100.0, 4.0

# Tip errors [mm] against constant curvature, for two rods 90 degrees apart.
TABLE = {
    (4.0, 4.0): {5: 0.336, 10: 0.0835, 20: 0.0208, 40: 0.0052},
    (5.0, 2.0): {5: 0.305, 10: 0.0757, 20: 0.0189, 40: 0.0047},
    (-3.0, 4.0): {5: 0.262, 10: 0.0652, 20: 0.0163, 40: 0.0041},
    (8.0, 6.0): {5: 1.072, 10: 0.262, 20: 0.0652, 40: 0.0163},
}


def rods(*angles: float) -> ContinuumRobot:
    return make_robot(angles, length=LENGTH, offset=SPACING, pushes=True)


def tip_error(robot: ContinuumRobot, pulled: np.ndarray, segments: int) -> float:
    arc = ArcModel(robot).shape(pulled).require().tip
    return float(np.linalg.norm(LinkageModel(robot, segments=segments).shape(pulled).tip - arc))


@pytest.mark.parametrize("pulled", TABLE, ids=str)
def test_error_against_arcs_is_that_measured_before(pulled: tuple[float, float]) -> None:
    for segments, error in TABLE[pulled].items():
        got = tip_error(rods(0.0, 90.0), np.asarray(pulled), segments)
        # One per cent, and the rounding of the last digit.
        assert got == pytest.approx(error, rel=0.01, abs=5e-5)


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_order_is_two_in_the_number_of_segments(robot: ContinuumRobot, seed: int) -> None:
    bends = np.random.default_rng(seed).normal(size=(len(robot.sections), 2))
    pulled = displacements_for(robot, bends)
    errors = [tip_error(robot, pulled, segments) for segments in (40, 80)]
    if errors[1] > 1e-6:
        assert 1.9 <= math.log2(errors[0] / errors[1]) <= 2.1


@pytest.mark.parametrize("pulled", [5.0, 8.0, 12.0])
@pytest.mark.parametrize("segments", [5, 8])
def test_planar_robot_is_the_printed_optimum(pulled: float, segments: int) -> None:
    base = np.array([[0.0, 0.0], [SPACING, 0.0]])
    joints, converged = solve_chain(
        base, LENGTH / segments, [(LENGTH - pulled) / segments], segments
    )
    assert converged == segments
    points = LinkageModel(rods(0.0), segments=segments).points([pulled])
    assert not points[:, 1].any()
    assert np.allclose(points[:, [0, 2]], joints, atol=1e-3)


@pytest.mark.parametrize("pulled", [(4.0, 4.0), (8.0, 6.0)])
@pytest.mark.parametrize("last_constraint", [True, False])
def test_robot_in_space_is_the_printed_optimum(
    pulled: tuple[float, float], last_constraint: bool
) -> None:
    base = np.array([[0.0, 0.0, 0.0], [SPACING, 0.0, 0.0], [0.0, SPACING, 0.0]])
    joints, converged = solve_chain(
        base,
        LENGTH / 5,
        [(LENGTH - change) / 5 for change in pulled],
        5,
        last_constraint=last_constraint,
    )
    assert converged == 5
    assert np.allclose(LinkageModel(rods(0.0, 90.0), segments=5).points(pulled), joints, atol=1e-3)


def segment_robot(length: float, tendons: list[tuple[float, float]]) -> ContinuumRobot:
    return ContinuumRobot(
        (
            Section(
                length=length,
                radius=length * 10.0,
                discs=1,
                tendons=tuple(
                    Tendon(name=f"t{k}", offset=offset, angle=angle, pushes=True)
                    for k, (offset, angle) in enumerate(tendons)
                ),
            ),
        )
    )


def draw_segment(seed: int) -> tuple[list[tuple[float, float]], np.ndarray]:
    """Two tendons at any angles and offsets, and the sines of their half coupler angles."""
    random = np.random.default_rng(seed)
    first, opening = random.uniform(-3.0, 3.0), random.uniform(0.8, 2.2)
    one, other = random.uniform(2.0, 6.0, 2)
    return [(one, first), (other, first + opening)], random.uniform(-0.25, 0.25, 2)


@pytest.mark.parametrize("seed", range(12))
def test_segment_keeps_lengths_and_reaches_the_bound_of_each_bar_alone(seed: int) -> None:
    tendons, sines = draw_segment(seed)
    pulled = [2.0 * offset * sine for (offset, _), sine in zip(tendons, sines, strict=True)]
    shape = LinkageModel(segment_robot(20.0, tendons)).shape(pulled)
    assert np.linalg.norm(shape.tip) == pytest.approx(20.0)
    for k, (offset, _) in enumerate(tendons):
        arm, hole = shape.tendon_points[k]
        link = hole - shape.tip
        assert np.linalg.norm(link) == pytest.approx(offset)
        assert np.linalg.norm(hole - arm) == pytest.approx(20.0 - pulled[k])
        turn = math.acos(np.clip(link @ arm / offset**2, -1.0, 1.0))
        assert turn == pytest.approx(2.0 * math.asin(abs(sines[k])), abs=1e-6)


@pytest.mark.slow
def test_no_segment_of_the_optimisation_turns_less() -> None:
    converged = 0
    for seed in range(12):
        tendons, sines = draw_segment(seed)
        pulled = [2.0 * offset * sine for (offset, _), sine in zip(tendons, sines, strict=True)]
        shape = LinkageModel(segment_robot(20.0, tendons)).shape(pulled)
        base = np.vstack([np.zeros(3), *(points[0] for points in shape.tendon_points)])
        top = np.vstack([shape.tip, *(points[1] for points in shape.tendon_points)])
        lengths = [20.0 - change for change in pulled]
        found, good, cost = solve_segment(base, 20.0, lengths, last_constraint=seed % 2 == 0)
        if good:
            converged += 1
            assert cost >= np.sum((2.0 * np.arcsin(sines)) ** 2) - 1e-9
            assert np.allclose(found, top, atol=2e-3)
    assert converged >= 4


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_end_links_turn_without_twist_and_tendons_keep_their_angles(
    robot: ContinuumRobot, seed: int
) -> None:
    bends = np.random.default_rng(seed).uniform(-1.2, 1.2, (len(robot.sections), 2))
    model = LinkageModel(robot)
    shape = model.shape(displacements_for(robot, bends))
    turns = shape.frames[:, :3, :3]
    assert np.allclose(turns @ np.swapaxes(turns, -1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1.0)
    steps = np.swapaxes(turns[:-1], -1, -2) @ turns[1:]
    assert np.allclose(steps[:, 0, 1], steps[:, 1, 0], atol=1e-12)
    # The redundant last constraint of (5.10): angles between coupler links stay.
    for one in robot.tendons:
        for other in robot.tendons:
            first, second = one.place_at(0.0), other.place_at(0.0)
            ends = turns[:, :, :2] @ np.stack([first, second], axis=-1)
            assert np.allclose(np.sum(ends[..., 0] * ends[..., 1], axis=-1), first @ second)


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_drawn_lengths_are_those_commanded(robot: ContinuumRobot, seed: int) -> None:
    bends = np.random.default_rng(seed).uniform(-1.2, 1.2, (len(robot.sections), 2))
    pulled = displacements_for(robot, bends)
    shape = LinkageModel(robot).shape(pulled).require()
    assert np.allclose(np.linalg.norm(np.diff(shape.points, axis=0), axis=-1).sum(), robot.length)
    for index, points in enumerate(shape.tendon_points):
        drawn = np.linalg.norm(np.diff(points, axis=0), axis=-1).sum()
        assert drawn == pytest.approx(shape.tendon_lengths[index], abs=1e-9)
        assert drawn == pytest.approx(robot.rest_lengths[index] - pulled[index], abs=1e-9)


def test_uneven_discs_keep_lengths_and_go_to_the_same_arc() -> None:
    places = tuple(np.cumsum(np.tile([1.0, 3.0], 25)))
    tendons = rods(0.0, 90.0).sections[0].tendons
    robot = ContinuumRobot(
        (Section(length=100.0, radius=6.0, disc_positions=places, tendons=tendons),)
    )
    shape = LinkageModel(robot).shape([5.0, 2.0])
    drawn = [np.linalg.norm(np.diff(line, axis=0), axis=-1).sum() for line in shape.tendon_points]
    assert np.allclose(drawn, [95.0, 98.0])
    assert np.linalg.norm(shape.tip - ArcModel(robot).shape([5.0, 2.0]).tip) < 0.01


@given(seed=st.integers(0, 1000), angle=st.floats(-180.0, 180.0))
def test_turning_the_tendons_turns_the_robot(seed: int, angle: float) -> None:
    robot = make_robot(THIRD, QUARTER)
    turned = make_robot([a + angle for a in THIRD], [a + angle for a in QUARTER])
    bends = np.random.default_rng(seed).normal(size=(2, 2))
    pulled = displacements_for(robot, bends)
    one, other = LinkageModel(robot).points(pulled), LinkageModel(turned).points(pulled)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    assert np.allclose(other, one @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def test_points_are_those_of_the_frames_and_batch_is_pointwise() -> None:
    robot = make_robot(THIRD, QUARTER)
    bends = np.random.default_rng(5).normal(size=(4, 5, 2, 2))
    pulled = displacements_for(robot, bends)
    for model in (LinkageModel(robot), LinkageModel(robot, segments=(7, 20))):
        shape, points = model.shape(pulled), model.points(pulled)
        assert np.allclose(points, shape.points, atol=1e-12)
        assert points.shape == (4, 5, sum(model.counts) + 1, 3)
        for place in np.ndindex(4, 5):
            assert np.allclose(model.points(pulled[place]), points[place], atol=1e-12)


@pytest.mark.parametrize(
    ("pulled", "needed"), [((20.0, 0.0), 3), ((40.0, 30.0), 7), ((-40.0, 30.0), 7), ((9.0, 0.0), 2)]
)
def test_linkage_that_cannot_be_says_how_many_segments_it_needs(
    pulled: tuple[float, float], needed: int
) -> None:
    tendons = rods(0.0, 90.0).sections[0].tendons
    robot = ContinuumRobot((Section(length=100.0, radius=4.0, tendons=tendons),))
    assert needed == math.ceil(math.hypot(*pulled) / (2.0 * SPACING))
    for segments in range(1, needed):
        model = LinkageModel(robot, segments=segments)
        shape = model.shape(pulled)
        assert not shape.converged and np.isfinite(shape.frames).all()
        assert re.search(f"has {segments} segments.* at least {needed}, ", str(shape.reason))
        with pytest.raises(GeometryError, match=f"at least {needed}, "):
            model.points(pulled)
    assert LinkageModel(robot, segments=needed).shape(pulled).converged


def test_folded_limit_exists() -> None:
    shape = LinkageModel(rods(0.0, 90.0), segments=1).shape([6.4 * 0.75, 4.8])
    assert np.linalg.norm(shape.tip) == pytest.approx(100.0)


def test_the_missing_segments_are_told_by_section_and_place() -> None:
    model = LinkageModel(make_robot(THIRD, THIRD, pushes=True), segments=(8, 1))
    pulled = displacements_for(model.robot, [[[0.1, 0.0]] * 2, [[0.1, 0.0], [3.0, 0.0]]])
    with pytest.raises(GeometryError, match=r"section 2 has 1 segments.*least 2.*\[1\]"):
        model.points(pulled)
    shape = model.shape(pulled)
    assert shape.converged.tolist() == [True, False]
    assert "section 2 has 1 segments" in shape.reason[1]
    assert np.allclose(shape.points[0], model.points(pulled[0]))


def test_command_that_failed_already_does_not_stop_the_batch() -> None:
    model = LinkageModel(make_robot((0.0, 180.0), length=400.0), segments=1)
    shape = model.shape([[2.0, -2.0], [40.0, 0.0]])
    assert shape.converged.tolist() == [True, False]
    assert "would have to stretch" in shape.reason[1]
    turns = shape.frames[..., :3, :3]
    assert np.allclose(turns @ np.swapaxes(turns, -1, -2), np.eye(3), atol=1e-12)


def test_empty_batch_is_empty() -> None:
    model = LinkageModel(make_robot(THIRD))
    assert model.points(np.empty((0, 3))).shape == (0, 11, 3)
    assert model.shape(np.empty((2, 0, 3))).frames.shape == (2, 0, 11, 4, 4)
