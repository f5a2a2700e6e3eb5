"""Workspace, travel and dexterity: even draws, volumes that are known, symmetric robots."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.continuum import ContinuumRobot, RobotCalibration, Section, Tendon
from bozzini.continuum.arc import arc_frames, displacements_for, jacobian
from bozzini.continuum.inverse import solve_tip
from bozzini.continuum.workspace import (
    manipulability,
    map_dexterity,
    measure_dexterity,
    measure_volume,
    sample_workspace,
    spread_directions,
    tendon_travel,
)


def make_robot(
    lengths: tuple[float, ...],
    *,
    max_bend: float = 1.5,
    tendons: int = 3,
    travel: tuple[float, float] = (-math.inf, math.inf),
    radius: float = 2.5,
) -> ContinuumRobot:
    return ContinuumRobot(
        tuple(
            Section(
                length=length,
                radius=radius,
                max_bend=max_bend,
                tendons=tuple(
                    Tendon(
                        name=f"s{i + 1}t{j + 1}",
                        offset=2.0,
                        angle=2.0 * math.pi * j / tendons,
                        travel=travel,
                    )
                    for j in range(tendons)
                ),
            )
            for i, length in enumerate(lengths)
        )
    )


def turn_about_z(angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


# --- drawing ---------------------------------------------------------------------------------


def test_bends_are_drawn_evenly_in_their_discs() -> None:
    count = 20_000
    bends = sample_workspace(make_robot((30.0, 20.0)), count, seed=3).bends
    size = np.hypot(bends[..., 0], bends[..., 1]) / 1.5
    assert size.max() <= 1.0
    # The square of the radius, and the angle, are even; errors of a few standard deviations.
    slack = 6.0 / math.sqrt(count)
    for section in range(2):
        for share in (0.1, 0.5, 0.9):
            assert abs(np.mean(size[:, section] ** 2 < share) - share) < slack
        angle = np.arctan2(bends[:, section, 1], bends[:, section, 0])
        assert np.abs(np.mean(np.exp(1j * angle * np.arange(1, 4)[:, None]), axis=1)).max() < slack


def test_limited_draws_are_those_that_rejection_keeps() -> None:
    robot = make_robot((30.0, 30.0), travel=(-2.0, 3.0))
    drawn = sample_workspace(robot, 20_000)
    assert drawn.displacements.min() >= -2.0 and drawn.displacements.max() <= 3.0
    free = sample_workspace(make_robot((30.0, 30.0)), 60_000, seed=9).bends
    moved = displacements_for(robot, free)
    kept = free[((moved >= -2.0) & (moved <= 3.0)).all(axis=1)]
    assert len(kept) > 5000
    for power in (1, 2):
        np.testing.assert_allclose(
            np.mean(drawn.bends**power, axis=0), np.mean(kept**power, axis=0), atol=0.04
        )


def test_a_seed_is_a_sample() -> None:
    robot = make_robot((30.0, 30.0))
    one, same, other = (sample_workspace(robot, 50, seed=seed) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.bends, same.bends)
    assert not np.any(one.bends == other.bends)


@given(seed=st.integers(0, 1000), sections=st.integers(1, 4))
@settings(max_examples=15)
def test_a_sample_is_consistent(seed: int, sections: int) -> None:
    robot = make_robot((25.0,) * sections)
    sample = sample_workspace(robot, 20, seed=seed)
    frames = arc_frames(robot, sample.bends, arc_length=[robot.length])[:, 0]
    np.testing.assert_allclose(sample.tip_frames, frames, atol=1e-10)
    np.testing.assert_allclose(sample.jacobians, jacobian(robot, sample.bends), atol=1e-10)
    np.testing.assert_allclose(sample.displacements, displacements_for(robot, sample.bends))
    assert solve_tip(robot, sample.tips[0]).converged


def test_one_section_stays_on_its_surface() -> None:
    sample = sample_workspace(make_robot((40.0,), max_bend=2.0), 500)
    angle = np.hypot(sample.bends[:, 0, 0], sample.bends[:, 0, 1])
    reach = 40.0 * np.sinc(0.5 * angle / math.pi)
    np.testing.assert_allclose(np.linalg.norm(sample.tips, axis=1), reach)
    np.testing.assert_allclose(sample.tangents[:, 2], np.cos(angle))


def test_the_cap_holds_where_a_section_allows_more() -> None:
    robot = make_robot((60.0,), max_bend=20.0)
    bends = sample_workspace(robot, 2000, bend_cap=0.4).bends
    assert 0.38 < np.hypot(bends[..., 0], bends[..., 1]).max() <= 0.4


def test_a_planar_robot_is_drawn_in_its_plane() -> None:
    sample = sample_workspace(make_robot((30.0, 30.0), tendons=2), 2000)
    assert np.abs(sample.tips[:, 1]).max() < 1e-9
    assert np.ptp(sample.tips[:, 0]) > 30.0
    assert measure_volume(sample.tips, cell=1.0).hull == 0.0


# --- volume ----------------------------------------------------------------------------------


def test_volume_of_a_box_is_known() -> None:
    points = np.random.default_rng(0).uniform((0, 0, 0), (4, 3, 2), (20_000, 3))
    volume = measure_volume(points, cell=0.5)
    assert volume.cells == 8 * 6 * 4
    assert math.isclose(volume.occupied, 24.0)
    assert 0.98 * 24.0 < volume.hull <= 24.0
    assert volume.coverage == 1.0
    thin = measure_volume(points[:200], cell=0.5)
    assert thin.occupied < 20.0
    assert abs(thin.coverage - thin.cells / 192) < 0.15  # estimated from singles against known


@given(scale=st.floats(1.0, 10.0))
@settings(max_examples=10)
def test_room_grows_with_the_cube_of_the_length(scale: float) -> None:
    small, large = (
        sample_workspace(make_robot((30.0 * k, 20.0 * k), radius=2.1 * k), 3000).tips
        for k in (1.0, scale)
    )
    np.testing.assert_allclose(large, scale * small, rtol=1e-9, atol=1e-7)
    ratio = measure_volume(large, cell=4.0 * scale).hull / measure_volume(small, cell=4.0).hull
    assert math.isclose(ratio, scale**3, rel_tol=1e-6)


def test_occupied_room_is_part_of_the_hull_and_of_the_reach() -> None:
    sample = sample_workspace(make_robot((30.0, 30.0)), 30_000)
    volume = measure_volume(sample.tips, cell=4.0)
    assert volume.coverage > 0.95
    assert volume.occupied < volume.hull < 4.0 / 3.0 * math.pi * volume.reach**3
    assert volume.reach <= 60.0


# --- travel ----------------------------------------------------------------------------------


def test_travel_tends_to_offset_times_all_bends() -> None:
    # A distal tendon passes both sections: its travel adds up.
    robot = make_robot((30.0, 30.0), travel=(-4.0, 4.0))
    bends = sample_workspace(make_robot((30.0, 30.0)), 20_000).bends
    travel = tendon_travel(robot, bends)
    for index, passed in enumerate((1, 1, 1, 2, 2, 2)):
        bound = 2.0 * 1.5 * passed
        assert 0.9 * bound < travel.high[index] <= bound
        assert 0.9 * bound < -travel.low[index] <= bound
    np.testing.assert_allclose(travel.stroke, travel.high - travel.low)
    exceeded = (travel.low < travel.allowed[:, 0]) | (travel.high > travel.allowed[:, 1])
    assert exceeded.tolist() == [False] * 3 + [True] * 3


def test_travel_counts_the_rest() -> None:
    robot = make_robot((30.0,))
    travel = tendon_travel(robot, [[0.5, 0.0]])
    np.testing.assert_allclose(travel.high, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(travel.low, [0.0, -0.5, -0.5])


# --- manipulability --------------------------------------------------------------------------


def test_a_straight_section_moves_alike_every_way() -> None:
    found = manipulability(make_robot((40.0,)), [[0.0, 0.0]])
    np.testing.assert_allclose(found.measure, 20.0**2)
    np.testing.assert_allclose(found.condition, 1.0)
    turning = manipulability(make_robot((40.0,)), [[0.0, 0.0]], part="rotation")
    np.testing.assert_allclose(turning.singular_values, [1.0, 1.0])


@given(seed=st.integers(0, 10**6), turn=st.floats(-3.0, 3.0), sections=st.integers(2, 5))
@settings(max_examples=25)
def test_manipulability_is_the_root_of_a_determinant(seed: int, turn: float, sections: int) -> None:
    robot = make_robot((25.0,) * sections)
    bends = np.random.default_rng(seed).normal(size=(3, sections, 2))
    rows = jacobian(robot, bends)[:, :3]
    found = manipulability(robot, bends)
    expected = np.sqrt(np.linalg.det(rows @ rows.swapaxes(-1, -2)))
    np.testing.assert_allclose(found.measure, expected, rtol=1e-6)
    np.testing.assert_allclose(found.condition, np.linalg.cond(rows), rtol=1e-6)
    # It does not matter which way is x.
    turned = manipulability(robot, bends @ turn_about_z(turn)[:2, :2].T)
    np.testing.assert_allclose(turned.singular_values, found.singular_values, rtol=1e-6)


def test_straight_robots_are_singular_along_their_axis() -> None:
    found = manipulability(make_robot((30.0, 30.0)), np.zeros((2, 2)))
    assert found.measure == 0.0 and math.isinf(found.condition)
    planar = manipulability(make_robot((30.0, 30.0), tendons=2), np.zeros((2, 2)))
    assert np.count_nonzero(planar.singular_values > 1e-9) == 1


def test_the_pose_needs_a_length() -> None:
    robot = make_robot((30.0, 20.0, 30.0))
    bends = np.random.default_rng(2).normal(size=(3, 2))
    one, two = (
        manipulability(robot, bends, part="pose", turn_length=length) for length in (10.0, 20.0)
    )
    np.testing.assert_allclose(two.measure, 8.0 * one.measure)


# --- dexterity -------------------------------------------------------------------------------


def test_directions_are_spread_over_the_sphere() -> None:
    ways = spread_directions(500)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1.0)
    np.testing.assert_allclose(ways.T @ ways / 500, np.eye(3) / 3.0, atol=1e-3)
    # No hole: a patch's share of the sphere is a disc of radius 2/sqrt(n).
    probes = np.random.default_rng(0).normal(size=(2000, 3))
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    assert np.arccos((probes @ ways.T).max(axis=1)).max() < 2.0 * 2.0 / math.sqrt(500)


def test_directions_of_one_section_are_one() -> None:
    robot = make_robot((40.0,))
    tip = arc_frames(robot, [[0.8, 0.3]], arc_length=[40.0])[0]
    looks = solve_tip(robot, tip[:3, 3], direction=tip[:3, 2])
    assert looks.converged
    assert measure_dexterity(robot, tip[:3, 3], directions=60).share == 0.0
    assert measure_dexterity(robot, (0.0, 0.0, 90.0), directions=20).share == 0.0


def test_what_is_reached_is_reached_and_more_sections_reach_more() -> None:
    place = (12.0, 0.0, 40.0)
    shares = []
    told: list[float] = []
    for count in (2, 3, 4):
        robot = make_robot((60.0 / count,) * count, max_bend=2.5)
        found = measure_dexterity(
            robot, place, directions=60, progress=lambda stage, share: told.append(share)
        )
        for way in found.directions[found.reached][:5]:
            result = solve_tip(robot, place, direction=way).require()
            np.testing.assert_allclose(result.tip_frame[:3, 2], way, atol=2e-6)
            np.testing.assert_allclose(result.tip, place, atol=2e-6)
        shares.append(found.share)
    assert shares[0] < shares[1] < shares[2]
    assert told[-1] == 1.0 and len(told) == 180


@pytest.mark.parametrize("half_plane", [False, True])
def test_the_map_counts_every_tip_once(half_plane: bool) -> None:
    robot = make_robot((30.0, 30.0))
    sample = sample_workspace(robot, 20_000)
    found = map_dexterity(sample, cell=6.0, directions=50, half_plane=half_plane)
    assert found.counts.sum() == 20_000
    assert np.all((found.direction_share > 0.0) & (found.direction_share <= 1.0))
    assert np.all(found.direction_share * 50 <= found.counts + 1e-9)
    measure = manipulability(robot, sample.bends).measure
    mean = np.sum(found.manipulability * found.counts) / found.counts.sum()
    np.testing.assert_allclose(mean, measure.mean())
    assert found.condition.min() == manipulability(robot, sample.bends).condition.min()
    assert found.rank == 3
    assert map_dexterity(sample_workspace(make_robot((30.0,)), 9), cell=6.0).rank == 2
    if half_plane:
        assert np.all(found.centres[:, 1] == 0.0) and np.all(found.centres[:, 0] > 0.0)


def test_the_half_plane_map_does_not_mind_turning() -> None:
    robot = make_robot((30.0, 30.0))
    sample = sample_workspace(robot, 2000)
    spun = sample.tip_frames.copy()
    for index, angle in enumerate(np.random.default_rng(1).uniform(-3.0, 3.0, len(spun))):
        spun[index, :3] = turn_about_z(angle) @ spun[index, :3]
    turned = type(sample)(
        robot=robot,
        bends=sample.bends,
        displacements=sample.displacements,
        tip_frames=spun,
        jacobians=sample.jacobians,
    )
    one, two = (map_dexterity(s, cell=7.3, half_plane=True) for s in (sample, turned))
    np.testing.assert_array_equal(one.counts, two.counts)
    np.testing.assert_allclose(one.direction_share, two.direction_share, atol=0.011)


def test_the_inverse_reaches_what_the_map_shows() -> None:
    # The map sees only the directions that were drawn: the inverse finds at least those.
    robot = make_robot((20.0, 20.0, 20.0), max_bend=2.0)
    found = map_dexterity(sample_workspace(robot, 40_000), cell=8.0, directions=40)
    best = int(np.argmax(found.counts))
    exact = measure_dexterity(robot, found.centres[best], directions=40)
    assert exact.share >= found.direction_share[best] - 0.15


def test_a_calibration_does_not_change_where_a_robot_reaches() -> None:
    robot = make_robot((40.0, 30.0))
    calibrated = dataclasses.replace(
        robot, calibration=RobotCalibration(zeros={robot.tendon_names[0]: 0.5}, scale=1.1)
    )
    assert calibrated != robot
    ours, theirs = (one.workspace(200, seed=3).to_frame() for one in (robot, calibrated))
    assert ours.equals(theirs)
