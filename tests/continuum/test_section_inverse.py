"""Closed forms of one section: round trips through the arc, and the ends of their ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from bozzini.continuum import ContinuumRobot, Section
from bozzini.continuum.arc import arc_frames
from bozzini.continuum.inverse import solve_section
from validation.thesis.section_arc import solve_direction, solve_extensible, solve_joints


def end_frame(length: float, bend: np.ndarray) -> np.ndarray:
    robot = ContinuumRobot((Section(length=length, radius=1e-3),))
    return arc_frames(robot, np.reshape(bend, (1, 2)), arc_length=[length])[0]


bend_angles = st.one_of(st.floats(0.0, 6.2), st.floats(0.0, 1e-6))
planes = st.floats(-math.pi, math.pi)
lengths = st.floats(1.0, 200.0)


@given(length=lengths, angle=bend_angles, plane=planes)
def test_extensible_section_round_trip(length: float, angle: float, plane: float) -> None:
    bend = angle * np.array([math.cos(plane), math.sin(plane)])
    arc = solve_extensible(end_frame(length, bend)[:3, 3])
    np.testing.assert_allclose(arc.lengths, length, rtol=1e-9)
    np.testing.assert_allclose(arc.bends, bend, atol=1e-9)
    np.testing.assert_allclose(arc.angle, angle, atol=1e-9)
    np.testing.assert_allclose(arc.curvature, angle / length, atol=1e-9)


@given(point=st.tuples(*[st.floats(-50.0, 50.0)] * 3))
def test_extensible_section_ends_at_any_place(point: tuple[float, float, float]) -> None:
    if math.hypot(*point[:2]) < 1e-3:
        return
    arc = solve_extensible(point)
    frame = end_frame(float(arc.lengths), arc.bends)
    np.testing.assert_allclose(frame[:3, 3], point, atol=1e-8)
    # As published: curvature 2 rho / (rho^2 + z^2), and angle acos(1 - kappa rho) in front.
    rho, z = math.hypot(*point[:2]), point[2]
    np.testing.assert_allclose(arc.curvature, 2.0 * rho / (rho**2 + z**2), rtol=1e-9)
    if z > 1.0:
        np.testing.assert_allclose(math.cos(arc.angle), 1.0 - arc.curvature * rho, atol=1e-9)


def test_a_batch_of_places_equals_one_after_another() -> None:
    places = np.random.default_rng(1).normal(size=(4, 5, 3))
    arcs = solve_extensible(places)
    assert arcs.bends.shape == (4, 5, 2) and arcs.lengths.shape == (4, 5)
    one = solve_extensible(places[2, 3])
    np.testing.assert_array_equal(arcs.bends[2, 3], one.bends)
    np.testing.assert_array_equal(arcs.direction[2, 3], one.direction)


@given(sections=st.lists(st.tuples(lengths, st.floats(0.0, 3.0), planes), min_size=1, max_size=5))
def test_sections_through_chosen_joints_round_trip(
    sections: list[tuple[float, float, float]],
) -> None:
    bends = np.array([[a * math.cos(p), a * math.sin(p)] for _, a, p in sections])
    wanted = np.array([length for length, _, _ in sections])
    robot = ContinuumRobot(tuple(Section(length=length, radius=1e-3) for length in wanted))
    joints = arc_frames(robot, bends, arc_length=robot.section_ends)[:, :3, 3]
    found = solve_joints(joints)
    np.testing.assert_allclose(found.lengths, wanted, rtol=1e-8)
    np.testing.assert_allclose(found.bends, bends, atol=1e-8)


@given(angle=st.floats(0.0, 3.1), plane=planes, size=st.floats(1e-3, 1e3))
def test_direction_round_trip(angle: float, plane: float, size: float) -> None:
    bend = angle * np.array([math.cos(plane), math.sin(plane)])
    found = solve_direction(size * end_frame(10.0, bend)[:3, 2])
    np.testing.assert_allclose(found, bend, atol=1e-7)


def test_straight_back_bends_half_a_turn() -> None:
    np.testing.assert_allclose(solve_direction((0.0, 0.0, -1.0)), (math.pi, 0.0))


@given(length=lengths, angle=st.floats(0.0, 6.2), plane=planes)
@example(length=18.38990643965334, angle=5e-324, plane=2.281920468786123)
def test_fixed_section_reaches_its_surface(length: float, angle: float, plane: float) -> None:
    bend = angle * np.array([math.cos(plane), math.sin(plane)])
    result = solve_section(length, end_frame(length, bend)[:3, 3])
    assert result.converged and result.reason == ""
    np.testing.assert_allclose(end_frame(length, result.bend)[:3, 3], result.tip, atol=1e-9)
    np.testing.assert_allclose(result.needed_length, length, rtol=1e-6)


@given(
    point=st.tuples(*[st.floats(-60.0, 60.0)] * 3),
    most=st.floats(0.1, 2.0 * math.pi),
)
def test_fixed_section_gives_the_nearest_place(
    point: tuple[float, float, float], most: float
) -> None:
    result = solve_section(30.0, point, max_bend=most)
    assert np.hypot(*result.bend) <= most + 1e-12
    assert math.isclose(math.dist(result.tip, point), result.residual, abs_tol=1e-9)
    plane = math.atan2(point[1], point[0])
    for angle in np.linspace(0.0, most, 2000):
        half = angle / 2
        chord = 30.0 * np.sinc(half / math.pi)
        aside, along = chord * math.sin(half), chord * math.cos(half)
        tip = (aside * math.cos(plane), aside * math.sin(plane), along)
        assert result.residual <= math.dist(tip, point) + 1e-9
    if not result.converged:
        assert f"{result.residual:.6g} mm from the target" in result.reason


@given(aside=st.floats(1e-6, 50.0), along=st.floats(-50.0, 50.0))
def test_the_needed_length_leads_to_the_target(aside: float, along: float) -> None:
    needed = solve_section(30.0, (aside, 0.0, along)).needed_length
    assert math.hypot(aside, along) <= needed * (1.0 + 1e-12)
    if needed < 1e4:  # near a full turn round-off in the bend moves the tip by the length's share
        found = solve_section(needed, (aside, 0.0, along))
        assert found.residual < 1e-9 * needed
        arc = solve_extensible((aside, 0.0, along))
        np.testing.assert_allclose(arc.lengths, needed, rtol=1e-6)


@pytest.mark.parametrize("hair", [0.0, 5e-324, 1e-300, 1e-12])
def test_straight_behind_no_length_is_named(hair: float) -> None:
    result = solve_section(30.0, (hair, 0.0, -20.0))
    assert math.isinf(result.needed_length) and not result.converged
    assert "which an arc of" not in result.reason
    # The nearest tip is the same as without the hair.
    assert math.isclose(result.residual, solve_section(30.0, (0.0, 0.0, -20.0)).residual)
    ahead = solve_section(30.0, (hair, 0.0, 20.0))
    assert math.isclose(ahead.needed_length, 20.0)
    assert math.isinf(solve_section(30.0, (0.0, 0.0, 0.0)).needed_length)


@pytest.mark.parametrize("scale", [1e-300, 1e-13, 1e300])
def test_directions_of_any_length_count(scale: float) -> None:
    way = np.array([0.6, -0.3, 0.2])
    np.testing.assert_allclose(solve_direction(scale * way), solve_direction(way))
