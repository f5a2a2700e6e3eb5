"""The rod without loads: minima of energy, also where rods push or stiffnesses differ."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import minimize

from bozzini.continuum import ArcModel, ContinuumRobot, Helix, RodModel, Section, Tendon
from bozzini.continuum.energy import EnergyModel
from bozzini.continuum.kernels.rod import expand_potential, find_curvature, measure_unloaded
from bozzini.continuum.profile import ROUND_OFF_MM
from bozzini.continuum.rod_grid import RodGrid
from tests.continuum.rods import cross_tendons, draw_command, draw_robot, make_robot

THIRDS = [2.0, -1.0, -1.0, 3.0, -2.0, -1.0]


def expand(stiffness, guides, tensions, moment, u, pushing=1.0):
    right, matrix = np.empty(3), np.empty((3, 3))
    present = np.ones(len(tensions), dtype=np.bool_)
    value, _ = expand_potential(
        stiffness, guides, present, tensions, moment, u, pushing, right, matrix
    )
    return value, right, np.tril(matrix) + np.tril(matrix, -1).T


@given(st.integers(0, 2**31), st.floats(-1.0, 6.0), st.booleans())
@example(seed=5369, strength=2.0, push=True)
def test_curvature_is_a_minimum_of_the_potential(seed, strength, push) -> None:
    # Tensions far above the stiffness: where undamped steps went astray. Not so pushes.
    strength = min(strength, 2.0) if push else strength
    rng = np.random.default_rng(seed)
    stiffness = rng.uniform(0.5, 2.0, 3)
    guides = rng.normal(size=(4, 4)) * [1.0, 1.0, 0.3, 0.3]
    tensions = 10.0**strength * rng.uniform(-1.0 if push else 0.0, 1.0, 4)
    moment = 10.0 ** min(strength, 1.0) * rng.normal(size=3)
    u = np.zeros(3)
    present = np.ones(4, dtype=np.bool_)
    found = find_curvature(stiffness, guides, present, tensions, moment, u, np.empty((11, 3)))
    value, right, matrix = expand(stiffness, guides, tensions, moment, u)
    if not found:
        # Tendons that pull may draw a cross-section to where one of them has no length.
        rates = np.column_stack(
            [
                guides[:, 2] - u[2] * guides[:, 1],
                guides[:, 3] + u[2] * guides[:, 0],
                1.0 + u[0] * guides[:, 1] - u[1] * guides[:, 0],
            ]
        )
        assert np.linalg.norm(rates, axis=1).min() < 0.05
        return
    scale = np.abs(tensions).max() + np.abs(moment).max() + 1.0
    # Near to where a tendon has no length only the next step tells: the slope is round-off there.
    step = np.linalg.solve(matrix, right)
    still = np.abs(step).max() < 1e-8 * (1.0 + np.abs(u).max())
    assert np.abs(right).max() < 1e-7 * scale or still
    assert np.linalg.eigvalsh(matrix).min() > -1e-6 * scale
    assert value <= expand(stiffness, guides, tensions, moment, np.zeros(3))[0] + 1e-9 * scale
    if not push:
        start = u + 0.3 * rng.normal(size=3)
        other = minimize(
            lambda x: expand(stiffness, guides, tensions, moment, x)[0] / scale,
            start,
            jac=lambda x: -expand(stiffness, guides, tensions, moment, x)[1] / scale,
            method="BFGS",
        )
        assert value <= other.fun * scale + 1e-9 * scale


def test_lengths_and_flexibility_are_derivatives_of_the_dual() -> None:
    robot = draw_robot(np.random.default_rng(4), 0.3)
    grid = RodGrid.cut(robot, RodModel(robot).arc_length, 40).packed
    count = len(robot.tendons)
    tensions = np.random.default_rng(5).uniform(0.1, 2.0, count)

    def measure(tensions):
        lengths, give = np.empty(count), np.empty((count, count))
        return measure_unloaded(grid, tensions, lengths, give), lengths, give

    _, lengths, give = measure(tensions)
    step = 1e-4
    for k in range(count):
        change = np.zeros(count)
        change[k] = step
        (up, up_lengths, _), (down, down_lengths, _) = (
            measure(tensions + change),
            measure(tensions - change),
        )
        assert (up - down) / (2 * step) == pytest.approx(lengths[k], rel=1e-7)
        assert -(up_lengths - down_lengths) / (2 * step) == pytest.approx(give[k], abs=1e-6)


@pytest.mark.parametrize(("seed", "pushes"), [(11, 0.2), (1, 0.5), (2, 0.5), (3, 1.0)])
def test_with_rods_that_push_it_is_the_energys_shape_or_says_how_far_it_went(seed, pushes) -> None:
    rng = np.random.default_rng(seed)
    both = 0
    for _ in range(20):
        robot = draw_robot(rng, pushes)
        command = draw_command(rng, robot)
        rod = RodModel(robot, between=2).shape(command)
        energy = EnergyModel(robot, segment="channel", between=2).shape(command)
        if not rod.converged:
            assert rod.reason
            continue
        assert energy.converged, energy.reason
        assert np.linalg.norm(rod.tip - energy.tip) < 0.3
        assert rod.residual <= 1.1e-6
        both += 1
    assert both >= 16


def test_its_curvatures_are_stable_under_its_tensions() -> None:
    rng = np.random.default_rng(11)
    for _ in range(5):
        robot = draw_robot(rng, 0.5)
        model = RodModel(robot, between=2)
        shape = model.shape(draw_command(rng, robot))
        if not shape.converged:
            continue
        grid = RodGrid.cut(robot, model.arc_length, model.steps)
        _, stiffness, _, guides, present = grid.packed
        stiffness = stiffness[:, 1, 3:]
        u, work = np.zeros(3), np.empty((11, 3))
        for n in range(len(stiffness)):
            args = (stiffness[n], guides[n, 1], present[n], shape.tensions, np.zeros(3))
            assert find_curvature(*args, u, work)
            here = present[n]
            _, _, matrix = expand(
                stiffness[n], guides[n, 1][here], shape.tensions[here], np.zeros(3), u
            )
            assert np.linalg.eigvalsh(matrix).min() > -1e-9 * stiffness[n].max()


def make_double(first, second):
    return ContinuumRobot(
        tuple(
            Section(
                length=60.0,
                radius=5.0,
                bending_stiffness=stiffness,
                tendons=tuple(cross_tendons(3, prefix=prefix)),
            )
            for stiffness, prefix in ((first, "p"), (second, "d"))
        )
    )


@pytest.mark.parametrize("contrast", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_flexible_and_stiff_sections_bend_as_arcs(contrast) -> None:
    robot = make_double(100.0, 100.0 * contrast)
    arc = ArcModel(robot).shape(THIRDS)
    for model in (RodModel(robot), EnergyModel(robot, segment="channel")):
        shape = model.shape(THIRDS)
        assert shape.converged, shape.reason
        assert shape.tip == pytest.approx(arc.tip, abs=1e-4)


def test_a_solver_that_fails_does_not_blame_a_tendon() -> None:
    robot = make_double(1e-9, 1e15)
    for model in (RodModel(robot), EnergyModel(robot)):
        reason = str(model.shape(THIRDS).reason)
        assert "stretch" not in reason and "break" not in reason
        assert "stiffnesses differ by a factor of 1.3e+24" in reason


@pytest.mark.parametrize("stiffness", [1e-9, 1e-3, 1e15])
def test_the_shape_does_not_know_the_unit_of_stiffness(stiffness) -> None:
    tendons = (
        Tendon(name="h", offset=4.0, angle=Helix(turns=0.5), end=60.0),
        Tendon(name="t", offset=((0.0, 4.0), (60.0, 2.0)), angle=2.0),
    )
    one, other = (
        RodModel(
            ContinuumRobot(
                (Section(length=60.0, radius=5.0, bending_stiffness=size, tendons=tendons),)
            )
        ).shape([1.0, 0.5])
        for size in (100.0, stiffness)
    )
    assert other.converged, other.reason
    assert other.points == pytest.approx(one.points, abs=1e-6)
    assert other.tensions / stiffness == pytest.approx(one.tensions / 100.0, rel=1e-5)


def test_tension_of_a_bent_rod_is_that_of_the_arc() -> None:
    robot = ContinuumRobot(
        (
            Section(
                length=60.0,
                radius=5.0,
                bending_stiffness=300.0,
                tendons=(Tendon(name="a", offset=4.0),),
            ),
        )
    )
    # Shortened by a theta under T a = EI theta / L.
    shape = RodModel(robot).shape([4.0])
    assert shape.section_parameters[0] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert shape.tensions[0] == pytest.approx(300.0 / 60.0 / 4.0, rel=1e-9)
    assert shape.tip[0] == pytest.approx(60.0 * (1.0 - math.cos(1.0)), abs=1e-6)


def test_a_station_of_a_cluster_is_found_at_the_place_that_was_kept():
    robot = make_robot(cross_tendons())
    for length in np.random.default_rng(1).uniform(0.5, 1.0, 200) * robot.length:
        close = length - ROUND_OFF_MM * np.array([1.8, 0.9, 0.0])
        grid = RodGrid.cut(robot, np.concatenate([[0.0], close]), 10)
        assert grid.places[grid.find(close)] == pytest.approx(close, abs=2.0 * ROUND_OFF_MM)
