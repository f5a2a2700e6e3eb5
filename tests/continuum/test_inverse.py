"""The inverse of many sections: round trips through the arc model, limits, nearest places."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.continuum import ArcModel, ContinuumRobot, Section, Tendon
from bozzini.continuum.arc import arc_frames, displacements_for, jacobian
from bozzini.continuum.coupling import find_limits
from bozzini.continuum.inverse import (
    ContinuumInverse,
    solve_curve,
    solve_pose,
    solve_section,
    solve_tip,
)
from bozzini.continuum.kernels.arc import fill_chain, place_point
from bozzini.continuum.kernels.inverse import (
    EMPTY,
    SOLVED,
    add_curvature,
    evaluate,
    make_work,
    step_inside,
)
from bozzini.errors import GeometryError
from bozzini.numeric.kernels.linear_algebra import factor_cholesky


def make_robot(
    sections: int,
    *,
    max_bend: float = math.pi,
    tendons: int = 3,
    spread: float = 2.0 * math.pi,
    turn: float = 0.3,
    lengths: tuple[float, ...] = (30.0, 24.0, 40.0, 30.0, 20.0, 36.0),
    travel: tuple[float, float] = (-math.inf, math.inf),
    pushes: bool = False,
) -> ContinuumRobot:
    """Sections with evenly spread tendons, turned a little from section to section."""
    return ContinuumRobot(
        tuple(
            Section(
                length=lengths[i],
                radius=2.5,
                max_bend=max_bend,
                tendons=tuple(
                    Tendon(
                        name=f"s{i + 1}t{j + 1}",
                        offset=2.0,
                        angle=spread * j / tendons + turn * i,
                        travel=travel,
                        pushes=pushes,
                    )
                    for j in range(tendons)
                ),
            )
            for i in range(sections)
        )
    )


def draw_bends(seed: int, count: int, sections: int, largest: float) -> np.ndarray:
    """Bends evenly in discs."""
    random = np.random.default_rng(seed)
    angle = random.uniform(-math.pi, math.pi, (count, sections))
    size = largest * np.sqrt(random.uniform(0.0, 1.0, (count, sections)))
    return np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1)


def tip_frames(robot: ContinuumRobot, bends: np.ndarray) -> np.ndarray:
    return arc_frames(robot, bends, arc_length=[robot.length])[..., -1, :, :]


def solve(
    kind: str, robot: ContinuumRobot, frame: np.ndarray, **options: object
) -> ContinuumInverse:
    if kind == "pose":
        return solve_pose(robot, frame, **options)
    direction = frame[:3, 2] if kind == "direction" else None
    return solve_tip(robot, frame[:3, 3], direction=direction, **options)


# --- kernels ---------------------------------------------------------------------------------


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), sections=st.integers(1, 4), size=st.sampled_from([0.0, 1e-7, 2]))
def test_a_point_of_the_chain_moves_as_its_derivative_says(
    seed: int, sections: int, size: float
) -> None:
    random = np.random.default_rng(seed)
    lengths = random.uniform(10.0, 50.0, sections)
    bends = size * random.normal(size=(sections, 2))
    owner, share = int(random.integers(sections)), float(random.choice([0.0, 0.37, 1.0]))

    def place(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        frames = np.zeros((sections + 1, 3, 4))
        frames[0, :, :3] = np.eye(3)
        slopes, turns = np.empty((sections, 2, 3)), np.empty((sections, 2, 3))
        point, rows = np.empty(3), np.empty((2 * sections, 3))
        fill_chain(lengths, at, frames, slopes, turns)
        place_point(lengths, at, frames, slopes, turns, owner, share, point, rows)
        return point, rows

    _, rows = place(bends)
    step = 1e-5
    for column in range(2 * sections):
        change = np.zeros(2 * sections)
        change[column] = step
        change = change.reshape(sections, 2)
        central = (place(bends + change)[0] - place(bends - change)[0]) / (2.0 * step)
        np.testing.assert_allclose(rows[column], central, atol=1e-6)


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), sections=st.integers(1, 6), count=st.integers(0, 8))
def test_a_limited_step_is_the_lowest_point_inside(seed: int, sections: int, count: int) -> None:
    # Variational inequality: no way into the convex set leads down.
    random = np.random.default_rng(seed)
    n = 2 * sections
    root = random.normal(size=(n, n))
    matrix = root @ root.T + 10.0 ** random.uniform(-4.0, 1.0) * np.eye(n)
    limits = random.uniform(0.3, 3.0, sections)
    rows = random.normal(size=(count, n))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    low, high = -random.uniform(0.1, 2.0, count), random.uniform(0.1, 2.0, count)
    factor = np.zeros((n, n))
    assert factor_cholesky(matrix, len(matrix), 0.0, 1e-14, factor)
    free = 4.0 * random.normal(size=n)
    x = free.copy()
    assert step_inside(factor, x, limits, rows, low, high) == SOLVED
    assert np.all(np.hypot(x[::2], x[1::2]) <= limits + 1e-10)
    assert np.all((rows @ x >= low - 1e-10) & (rows @ x <= high + 1e-10))
    slope = matrix @ (x - free)
    others = draw_bends(seed, 200, sections, 1.0).reshape(200, n) * np.repeat(limits, 2)
    values = others @ rows.T
    shrink = np.minimum(
        1.0,
        np.minimum(
            np.where(values > high, high / values, 1.0), np.where(values < low, low / values, 1.0)
        ).min(axis=1, initial=1.0),
    )
    others *= shrink[:, None]
    scale = np.linalg.norm(slope) * limits.sum() + 1e-12
    assert np.min((others - x) @ slope) >= -1e-5 * scale


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10**6),
    sections=st.integers(1, 4),
    axes=st.sampled_from([0, 1, 3]),
    size=st.sampled_from([1e-4, 0.1, 1.0]),
)
def test_second_derivatives_are_those_of_the_first(
    seed: int, sections: int, axes: int, size: float
) -> None:
    random = np.random.default_rng(seed)
    n, points = 2 * sections, 3
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    goal = (
        random.uniform(10.0, 40.0, sections),
        random.integers(0, sections, points),
        np.array([1.0, 0.0, random.uniform()]),
        30.0 * random.normal(size=(points, 3)),
        random.uniform(0.5, 2.0, points),
        np.ascontiguousarray(turn[:axes]),
        20.0,
        0.3,
    )
    work = make_work(sections)

    def slope(at: np.ndarray) -> np.ndarray:
        gradient = np.empty(n)
        evaluate(goal, at, work, gradient, matrix)
        return gradient

    matrix = np.empty((n, n))
    bends = size * random.normal(size=(sections, 2))
    central = np.empty((n, n))
    step = 1e-5
    for column in range(n):
        change = np.zeros(n)
        change[column] = step
        change = change.reshape(sections, 2)
        central[column] = (slope(bends + change) - slope(bends - change)) / (2.0 * step)
    slope(bends)
    add_curvature(goal, bends, work, matrix)
    np.testing.assert_allclose(np.tril(matrix), np.tril(central), atol=1e-7 * np.abs(central).max())


def test_a_step_with_nothing_inside_says_so() -> None:
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]])
    low, high = np.array([0.5, 0.5]), np.array([9.0, 9.0])
    x = np.array([3.0, 1.0])
    assert step_inside(np.eye(2), x, np.array([9.0]), rows, low, high) == EMPTY


# --- round trips -----------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["place", "direction", "pose"])
@pytest.mark.parametrize("sections", [1, 2, 3, 4, 5, 6])
def test_reachable_targets_are_reached(kind: str, sections: int) -> None:
    count = 1000 if kind == "place" else 250
    robot = make_robot(sections)
    bends = draw_bends(sections, count, sections, math.pi)
    frames = tip_frames(robot, bends)
    results = [solve(kind, robot, frame) for frame in frames]
    solved = np.array([result.converged for result in results])
    assert solved.mean() >= 0.99
    assert all(result.reason for result in results if not result.converged)
    # Back through the forward model, from the displacements alone.
    shape = ArcModel(robot).shape([result.displacements for result in results]).require()
    assert np.linalg.norm(shape.tip - frames[:, :3, 3], axis=1)[solved].max() < 1e-6
    if kind != "place":
        columns = slice(2, 3) if kind == "direction" else slice(0, 3)
        apart = shape.tip_frame[:, :3, columns] - frames[:, :3, columns]
        assert np.abs(apart[solved]).max() < 1.5e-6


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), sections=st.integers(1, 6), straight=st.integers(0, 6))
def test_chains_with_straight_sections_are_reached_too(
    seed: int, sections: int, straight: int
) -> None:
    robot = make_robot(sections)
    bends = draw_bends(seed, 1, sections, 2.0)[0]
    bends[:straight] = 0.0
    result = solve_tip(robot, tip_frames(robot, bends)[:3, 3])
    assert result.converged, result.reason


def test_travel_that_holds_the_target_does_not_hide_it() -> None:
    robot = make_robot(4, travel=(-6.0, 6.0))
    bends = draw_bends(3, 2000, 4, math.pi)
    bends = bends[np.abs(displacements_for(robot, bends)).max(axis=1) <= 6.0][:150]
    assert len(bends) == 150
    solved = 0
    for frame in tip_frames(robot, bends):
        result = solve("direction", robot, frame)
        solved += result.converged
        assert np.abs(result.displacements).max() <= 6.0
    assert solved >= 0.99 * len(bends)


@settings(max_examples=30)
@given(seed=st.integers(0, 10**6), turn=st.floats(-math.pi, math.pi), sections=st.integers(1, 4))
def test_a_turned_target_has_turned_bends(seed: int, turn: float, sections: int) -> None:
    # Tendons do not matter to a robot without limits of travel.
    robot = make_robot(sections)
    target = tip_frames(robot, draw_bends(seed, 1, sections, 1.5)[0])[:3, 3]
    cosine, sine = math.cos(turn), math.sin(turn)
    about_z = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    here, there = solve_tip(robot, target), solve_tip(robot, about_z @ target)
    assert here.converged and there.converged
    if here.starts == there.starts == 1:
        np.testing.assert_allclose(there.bends, here.bends @ about_z[:2, :2].T, atol=1e-6)


# --- starts and preferences ------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["place", "direction", "pose"])
def test_a_start_at_the_answer_is_the_answer(kind: str) -> None:
    robot = make_robot(5)
    bends = draw_bends(8, 1, 5, 2.0)[0]
    result = solve(kind, robot, tip_frames(robot, bends), initial=bends, starts=1)
    assert result.converged and result.iterations == 0 and result.starts == 1
    np.testing.assert_allclose(result.bends, bends, atol=1e-9)


def test_a_warm_start_stays_beside_its_start() -> None:
    robot = make_robot(4)
    bends = draw_bends(2, 1, 4, 1.5)[0]
    for _ in range(20):
        target = tip_frames(robot, bends)[:3, 3] + (0.1, -0.05, 0.02)
        result = solve_tip(robot, target, initial=bends, starts=1).require()
        assert np.abs(result.bends - bends).max() < 0.05
        assert result.iterations <= 4
        bends = result.bends


def test_answers_are_the_same_each_time() -> None:
    robot = make_robot(3, max_bend=1.2)
    for target in ((20.0, 30.0, 40.0), (300.0, 0.0, 0.0)):
        one, two = solve_tip(robot, target), solve_tip(robot, target)
        assert np.array_equal(one.bends, two.bends) and one.reason == two.reason


@pytest.mark.parametrize("seed", range(6))
def test_smallest_bends_are_smallest(seed: int) -> None:
    # At the least sum of squares the bends are a combination of the rows of the Jacobian.
    robot = make_robot(5)
    target = tip_frames(robot, draw_bends(seed, 1, 5, 1.0)[0])[:3, 3]
    plain, small = solve_tip(robot, target), solve_tip(robot, target, smallest_bends=True)
    assert plain.converged and small.converged
    assert np.sum(small.bends**2) <= np.sum(plain.bends**2) + 1e-9
    rows = jacobian(robot, small.bends)[:3]
    flat = small.bends.ravel()
    inside = rows.T @ np.linalg.lstsq(rows.T, flat, rcond=None)[0]
    assert np.linalg.norm(flat - inside) < 1e-4 * np.linalg.norm(flat)


# --- limits and targets out of reach ---------------------------------------------------------


@settings(max_examples=40)
@given(
    target=st.tuples(*[st.floats(-150.0, 150.0)] * 3),
    sections=st.integers(1, 5),
    limit=st.floats(0.2, 2.0),
    travel=st.floats(0.5, 6.0),
)
def test_every_answer_is_inside_the_limits(
    target: tuple[float, float, float], sections: int, limit: float, travel: float
) -> None:
    robot = make_robot(sections, max_bend=limit, travel=(-travel, 0.7 * travel))
    result = solve_tip(robot, target)
    assert np.hypot(*result.bends.T).max() <= limit
    assert result.displacements.min() >= -travel and result.displacements.max() <= 0.7 * travel
    tip = tip_frames(robot, result.bends)[:3, 3]
    assert math.isclose(math.dist(tip, target), result.residual, abs_tol=1e-9)
    assert result.converged == (result.residual <= 1e-6) == (result.reason == "")
    assert ArcModel(robot).shape(result.displacements).converged


@pytest.mark.parametrize("sections", [1, 2, 4])
def test_no_drawn_tip_is_nearer_than_the_nearest(sections: int) -> None:
    robot = make_robot(sections, max_bend=1.0)
    drawn = draw_bends(1, 20_000, sections, 1.0)
    tips = tip_frames(robot, drawn)[:, :3, 3]
    for target in np.random.default_rng(4).normal(size=(15, 3)) * robot.length:
        result = solve_tip(robot, target)
        nearest = np.linalg.norm(tips - target, axis=1).min()
        assert result.residual <= nearest + 1e-9
        assert result.settled


@pytest.mark.parametrize("sections", [1, 3])
def test_no_small_change_comes_nearer_to_a_pose_out_of_reach(sections: int) -> None:
    robot = make_robot(sections, max_bend=1.2)
    random = np.random.default_rng(5)
    for _ in range(10):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        frame = np.eye(4)
        frame[:3, :3] = turn * np.linalg.det(turn)
        frame[:3, 3] = random.normal(size=3) * robot.length
        result = solve_pose(robot, frame)
        assert not result.converged and result.settled

        def cost(bends: np.ndarray, frame: np.ndarray = frame) -> np.ndarray:
            apart = tip_frames(robot, bends)[..., :3, :] - frame[:3]
            turned = 0.5 * np.sum(apart[..., :3] ** 2, axis=(-2, -1))
            return np.sum(apart[..., 3] ** 2, axis=-1) + (robot.length / math.pi) ** 2 * turned

        near = result.bends + 1e-3 * random.normal(size=(400, sections, 2))
        size = np.linalg.norm(near, axis=-1, keepdims=True)
        near *= np.minimum(1.0, 1.2 / size)
        assert cost(near).min() >= cost(result.bends) * (1.0 - 1e-7)


def test_one_section_agrees_with_its_closed_form() -> None:
    robot = make_robot(1, max_bend=2.5)
    for target in np.random.default_rng(6).normal(size=(60, 3)) * 25.0:
        many, one = solve_tip(robot, target), solve_section(30.0, target, max_bend=2.5)
        assert math.isclose(many.residual, one.residual, rel_tol=1e-6, abs_tol=1e-6)
        np.testing.assert_allclose(many.tip, one.tip, atol=2e-3)


def test_reasons_name_distance_and_limits() -> None:
    far = solve_tip(make_robot(2, max_bend=1.0), (200.0, 0.0, 0.0))
    assert not far.converged
    assert "200 mm from the base, out of reach of a backbone of 54 mm" in far.reason
    assert f"{far.residual:.6g} mm from the target" in far.reason
    assert "section 2 is at 57.3 deg, its largest bend" in far.reason
    with pytest.raises(GeometryError, match=re.escape(far.reason)):
        far.require()
    held = solve_tip(make_robot(2, travel=(-1.0, 1.0)), (30.0, 0.0, 20.0))
    assert "is at the end of its travel, " in held.reason
    few = solve_tip(make_robot(1), (5.0, 0.0, 20.0), direction=(1.0, 0.0, 0.0))
    assert "1 section(s) have 2 freedoms, the target 5" in few.reason
    meets = solve_tip(make_robot(1, max_bend=30.0, lengths=(5.0,)), (0.0, 1.0, -4.0))
    assert "114.6 deg, where its discs meet" in meets.reason


def test_only_a_target_that_is_met_has_converged() -> None:
    robot = make_robot(2)
    near = solve_tip(robot, tip_frames(robot, draw_bends(3, 1, 2, 1.0)[0])[:3, 3])
    assert near.converged and near.settled and near.reason == "" and near.require() is near
    far = solve_tip(robot, (0.0, 40.0, 100.0))
    assert not far.converged and far.settled
    assert math.isclose(far.residual, math.dist(far.tip, (0.0, 40.0, 100.0)), rel_tol=1e-12)
    assert f"{far.residual:.6g} mm from the target" in far.reason
    alone, beyond = (solve_section(30.0, (0.0, 0.0, z)) for z in (30.0, 31.0))
    assert alone.converged and not beyond.converged and math.isclose(beyond.residual, 1.0)


def test_the_end_of_a_travel_at_rest_is_no_slack() -> None:
    robot = make_robot(1)
    first, *others = robot.sections[0].tendons
    held = dataclasses.replace(first, travel=(0.0, math.inf))
    section = dataclasses.replace(robot.sections[0], tendons=(held, *others))
    found = solve_tip(ContinuumRobot((section,)), (-15.0, 0.0, 20.0))
    assert found.at_limits == ("tendon 's1t1' is at the end of its travel, 0 mm",)
    assert not found.converged and np.allclose(found.displacements[0], 0.0, atol=1e-6)


# --- robots that cannot bend every way -------------------------------------------------------


def test_a_planar_robot_stays_in_its_plane() -> None:
    robot = make_robot(3, tendons=2, turn=0.0)
    bends = draw_bends(1, 1, 3, 1.5)[0]
    bends[:, 1] = 0.0
    assert solve_tip(robot, tip_frames(robot, bends)[:3, 3]).converged
    aside = solve_tip(robot, (20.0, 5.0, 60.0))
    assert not aside.converged
    assert math.isclose(aside.residual, 5.0, rel_tol=1e-9)
    np.testing.assert_allclose(aside.bends[:, 1], 0.0, atol=1e-9)
    assert "is not controlled" in aside.reason


@pytest.mark.parametrize("seed", range(4))
def test_cables_that_cannot_push_are_only_pulled(seed: int) -> None:
    # Two cables at right angles bend one way each, and those that pass bend the proximal section.
    robot = make_robot(2, tendons=2, spread=math.pi, turn=0.0, max_bend=2.0)
    random = np.random.default_rng(seed)
    stiffness = np.repeat([s.bending_stiffness / s.length for s in robot.sections], 2)
    tensions = random.uniform(0.0, 2.0, 4)
    bends = (find_limits(robot).coupling.matrix.T @ tensions / stiffness).reshape(2, 2)
    assert np.hypot(*bends.T).max() < 2.0
    target = tip_frames(robot, bends)[:3, 3]
    result = solve_tip(robot, target)
    assert result.converged, result.reason
    shape = ArcModel(robot).shape(result.displacements).require()
    assert not shape.slack.any()
    np.testing.assert_allclose(shape.tip, target, atol=1e-5)
    back = solve_tip(robot, target * (-1.0, -1.0, 1.0))
    assert not back.converged and "is about to go slack" in back.reason
    rods = make_robot(2, tendons=2, spread=math.pi, turn=0.0, max_bend=2.0, pushes=True)
    assert solve_tip(rods, target * (-1.0, -1.0, 1.0)).converged


@pytest.mark.parametrize("scale", [1e-200, 1e-13, 1.0, 1e300])
def test_the_length_of_a_direction_does_not_matter(scale: float) -> None:
    robot = make_robot(3)
    frame = tip_frames(robot, draw_bends(2, 1, 3, 1.0)[0])
    result = solve_tip(robot, frame[:3, 3], direction=scale * frame[:3, 2])
    assert result.converged
    np.testing.assert_allclose(result.tip_frame[:3, 2], frame[:3, 2], atol=1e-6)


def test_the_farthest_target_is_pointed_at() -> None:
    way = np.array([0.6, 0.0, 0.8])
    far = solve_tip(make_robot(4), 1e9 * way)
    assert not far.converged and far.settled
    np.testing.assert_allclose(
        far.tip @ way, solve_tip(make_robot(4), 1e4 * way).tip @ way, rtol=1e-3
    )


# --- curves ----------------------------------------------------------------------------------


@pytest.mark.parametrize("sections", [1, 2, 4, 6])
def test_the_curve_of_a_robot_gives_its_bends(sections: int) -> None:
    robot = make_robot(sections)
    for bends in draw_bends(sections, 15, sections, 2.0):
        along = np.linspace(0.0, robot.length, 40)
        points = arc_frames(robot, bends, arc_length=along)[:, :3, 3]
        result = solve_curve(robot, points, arc_length=along)
        assert result.converged, result.reason
        np.testing.assert_allclose(result.bends, bends, atol=1e-6)


def test_a_curve_by_points_alone_is_followed() -> None:
    # A helix is made of no arcs: the fit is near, says how near, and improves with sections.
    turn = np.linspace(0.0, 2.5, 200)
    points = np.stack([30 - 30 * np.cos(turn), 4 * turn**2, 30 * np.sin(turn)], axis=-1)
    misses = []
    for sections in (2, 3, 6):
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / sections
        robot = make_robot(sections, lengths=(length,) * sections)
        result = solve_curve(robot, points, tolerance=10.0)
        assert result.converged and result.settled
        misses.append(result.residual)
        strict = solve_curve(robot, points)
        assert not strict.converged
        assert "mm away, at arc length" in strict.reason
    assert misses[2] < 0.3 * misses[1] < 0.3 * misses[0]


def test_weights_pull_the_curve() -> None:
    robot = make_robot(2)
    points = np.array([[20.0, 0.0, 10.0], [0.0, 15.0, 40.0]])
    along = np.array([20.0, 50.0])
    miss = [
        np.linalg.norm(arc_frames(robot, result.bends, arc_length=along)[:, :3, 3] - points, axis=1)
        for result in (
            solve_curve(robot, points, arc_length=along, weights=weights)
            for weights in ((1.0, 1.0), (10.0, 1.0), (1.0, 10.0))
        )
    ]
    assert miss[1][0] < miss[0][0] < miss[2][0]
    assert miss[2][1] < miss[0][1] < miss[1][1]
