"""Displacements and bends: what couples, what goes slack, what cannot be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from bozzini.continuum import ArcModel, ContinuumRobot, RodModel
from bozzini.continuum.arc import displacements_for
from bozzini.continuum.coupling import Coupling
from tests.continuum.robots import QUARTER, THIRD, antagonistic_robots, make_robot


def bend_energy(robot: ContinuumRobot, bends: np.ndarray) -> float:
    stiffness = [section.bending_stiffness / section.length for section in robot.sections]
    return 0.5 * float(np.sum(np.repeat(stiffness, 2) * np.square(np.ravel(bends))))


def solve_by_program(robot: ContinuumRobot, pulled: np.ndarray) -> tuple[np.ndarray, bool]:
    """Least energy with no cable shorter than its path, by a general solver."""
    matrix = Coupling(robot).matrix
    scale = bend_energy(robot, np.full(matrix.shape[1], 1.0))
    done = minimize(
        lambda b: bend_energy(robot, b) / scale,
        np.linalg.pinv(matrix) @ pulled,
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda b: matrix @ b - pulled},
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return done.x.reshape(-1, 2), bool(done.success)


def test_distal_tendons_pass_through_proximal_sections() -> None:
    robot = make_robot(THIRD, THIRD)
    pulled = displacements_for(robot, [[0.5, 0.0], [0.0, 0.0]])
    assert np.allclose(pulled[:3], pulled[3:])  # the second section stays straight by moving
    pulled = displacements_for(robot, [[0.0, 0.0], [0.5, 0.0]])
    assert not pulled[:3].any()


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_a_consistent_command_is_met_with_no_slack(robot: ContinuumRobot, seed: int) -> None:
    bends = np.random.default_rng(seed).normal(size=(6, len(robot.sections), 2))
    found = Coupling(robot).solve(displacements_for(robot, bends))
    assert found.converged.all()
    assert not found.slack.any()
    assert found.residual.max() < 1e-9
    assert np.allclose(found.bends, bends)


@given(
    robot=antagonistic_robots(),
    seed=st.integers(0, 1000),
    loose=st.floats(0.01, 3.0),
    which=st.integers(0, 100),
)
def test_a_tendon_let_out_further_goes_slack_by_that(
    robot: ContinuumRobot, seed: int, loose: float, which: int
) -> None:
    bends = np.random.default_rng(seed).normal(size=(len(robot.sections), 2))
    pulled = displacements_for(robot, bends)
    index = which % len(pulled)
    pulled[index] -= loose
    found = Coupling(robot).solve(pulled)
    assert found.converged
    # All others are met, or loose; none would have to be longer than it is.
    assert found.misfit.max() < 1e-6
    assert np.array_equal(found.slack, found.misfit < -1e-6)
    assert found.slack.any()
    assert bend_energy(robot, found.bends) <= bend_energy(robot, bends) * (1.0 + 1e-9)


@given(
    robot=antagonistic_robots(),
    seed=st.integers(0, 1000),
)
def test_slack_tendons_leave_least_energy(robot: ContinuumRobot, seed: int) -> None:
    random = np.random.default_rng(seed)
    bends = random.normal(size=(len(robot.sections), 2))
    pulled = displacements_for(robot, bends) - random.uniform(0.0, 2.0, len(robot.tendons))
    found = Coupling(robot).solve(pulled)
    other, good = solve_by_program(robot, pulled)
    assert found.converged
    if good:
        energy = bend_energy(robot, found.bends)
        assert energy <= bend_energy(robot, other) * (1.0 + 1e-6) + 1e-9
        assert np.allclose(found.bends, other, atol=2e-3)


@pytest.mark.parametrize(
    ("angles", "pulled", "bend", "slack"),
    [
        ((0.0, 90.0), (-3.0, 4.0), (0.0, 1.0), (True, False)),
        ((0.0, 180.0), (5.0, -10.0), (1.25, 0.0), (False, True)),
        ((0.0,), (5.0,), (1.25, 0.0), (False,)),
        ((0.0,), (-5.0,), (0.0, 0.0), (True,)),
        (QUARTER, (3.0, 1.0, -3.0, -4.0), (0.75, 0.25), (False, False, False, True)),
        (QUARTER, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0), (False, False, False, False)),
    ],
)
def test_cables_cannot_push(
    angles: tuple[float, ...],
    pulled: tuple[float, ...],
    bend: tuple[float, float],
    slack: tuple[bool, ...],
) -> None:
    shape = ArcModel(make_robot(angles)).shape(pulled).require()
    assert np.allclose(shape.section_parameters, [bend])
    assert tuple(shape.slack.tolist()) == slack
    loose = shape.robot.rest_lengths - np.asarray(pulled) - shape.tendon_lengths
    assert np.all(loose[shape.slack] > 0.1)
    assert np.allclose(loose[~shape.slack], 0.0, atol=1e-9)


def test_rods_push() -> None:
    shape = ArcModel(make_robot((0.0, 90.0), pushes=True)).shape([-3.0, 4.0]).require()
    assert np.allclose(shape.section_parameters, [[-0.75, 1.0]])
    assert not shape.slack.any()


def test_one_bad_command_does_not_spoil_a_batch() -> None:
    model = ArcModel(make_robot(THIRD))
    good = [2.0, -1.0, -1.0]
    shape = model.shape([good, [1.0, 1.0, 1.0], good, [2.0, -1.0, -4.0]])
    assert shape.converged.tolist() == [True, False, True, True]
    assert [bool(text) for text in shape.reason] == [False, True, False, False]
    assert np.array_equal(shape.frames[0], model.shape(good).frames)
    assert shape.slack.any(axis=-1).tolist() == [False, False, False, True]


def test_section_in_one_plane_says_so_and_bends_in_it() -> None:
    model = ArcModel(make_robot((30.0, 210.0)))
    (note,) = model.notes
    assert "towards 120 deg is not controlled" in note
    bend = model.shape([2.0, -2.0]).require().section_parameters[0]
    assert np.degrees(np.arctan2(bend[1], bend[0])) == pytest.approx(30.0)
    assert not ArcModel(make_robot(THIRD)).notes


def test_section_without_tendons_shares_the_bend_by_stiffness() -> None:
    one = make_robot((), length=40.0).sections[0]
    other = make_robot(THIRD, length=80.0, bending_stiffness=50.0).sections[0]
    robot = ContinuumRobot((one, other))
    model = ArcModel(robot)
    assert "no tendons of its own" in model.notes[0]
    bends = model.shape([2.0, -1.0, -1.0]).require().section_parameters
    # One moment through both: bends as length over stiffness, and the tendon's 2 mm in all.
    assert bends[1, 0] / bends[0, 0] == pytest.approx((80.0 / 50.0) / (40.0 / 200.0))
    assert 4.0 * bends[:, 0].sum() == pytest.approx(2.0)


@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_what_can_be_is_what_a_linear_program_says(robot: ContinuumRobot, seed: int) -> None:
    random = np.random.default_rng(seed)
    pulled = random.uniform(-3.0, 2.0, len(robot.tendons))
    coupling = Coupling(robot)
    # By how much each cable would have to stretch at least.
    count = coupling.matrix.shape[1]
    done = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=-np.column_stack([coupling.matrix, np.ones(len(pulled))]),
        b_ub=-pulled,
        bounds=[(None, None)] * (count + 1),
    )
    found = coupling.solve(pulled)
    if abs(done.fun) > 1e-5:
        assert bool(found.converged) == (done.fun < 0.0)
    assert bool(found.converged) == (found.reason == "")


@pytest.mark.parametrize("seed", range(4))
def test_open_and_slack_bends_are_those_of_the_elastic_rod(seed: int) -> None:
    """A planar proximal section, distal cables through it, some let out too far."""
    random = np.random.default_rng(seed)
    soft = make_robot((20.0, 200.0), length=60.0, bending_stiffness=50.0).sections[0]
    robot = ContinuumRobot((soft, make_robot((), THIRD, length=80.0).sections[1]))
    pulled = displacements_for(robot, random.normal(size=(2, 2)) * 0.7)
    pulled -= random.choice([0.0, 1.5], size=len(pulled))
    arc = ArcModel(robot).shape(pulled).require()
    rod = RodModel(robot).shape(pulled).require()
    assert np.array_equal(arc.slack, rod.slack)
    assert np.allclose(arc.tip, rod.tip, atol=1e-3)


def test_tolerance_lets_a_small_inconsistency_through() -> None:
    pulled = [2.0, -1.0, -0.999]
    robot = make_robot(THIRD)
    assert not ArcModel(robot).shape(pulled).converged
    shape = ArcModel(robot, tolerance=1e-3).shape(pulled)
    assert shape.converged
    assert 1e-4 < shape.residual < 1e-3


@given(size=st.floats(1e-3, 1e3))
def test_slack_shape_scales_with_the_command(size: float) -> None:
    coupling = Coupling(make_robot(QUARTER))
    pulled = np.array([0.3, 0.1, -0.9, -0.1])
    one, other = coupling.solve(pulled), coupling.solve(size * pulled)
    assert one.slack.tolist() == other.slack.tolist() == [False, False, True, False]
    assert np.allclose(other.bends, size * one.bends, rtol=1e-9, atol=1e-12 * size)


@settings(max_examples=15)
@given(robot=antagonistic_robots(), seed=st.integers(0, 1000))
def test_tendons_that_follow_are_where_least_energy_has_them(
    robot: ContinuumRobot, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    # Of tendons on one side of one section, so that none has to push.
    row = int(rng.integers(len(robot.tendons)))
    pulled = np.full(len(robot.tendons), np.nan)
    pulled[row] = rng.uniform(0.1, 0.5)
    found = Coupling(robot).solve(pulled)
    matrix = Coupling(robot).matrix
    assert found.converged
    assert matrix @ found.bends.ravel() == pytest.approx(found.displacements)
    assert found.displacements[row] == pulled[row]
    # What follows, commanded, changes nothing.
    assert Coupling(robot).solve(found.displacements).bends == pytest.approx(found.bends, abs=1e-9)
    # And no bends with the same displacement of that tendon have less energy.
    free = np.linalg.svd(matrix[row : row + 1])[2][1:]
    least = bend_energy(robot, found.bends)
    for way in free:
        assert bend_energy(robot, found.bends.ravel() + 1e-3 * way) > least


def test_names_left_out_follow_and_all_left_out_stay_straight() -> None:
    robot = make_robot(QUARTER)
    shape = robot.forward({"t00": 2.0, "t01": [0.0, 1.0]}, model="arc")
    assert shape.converged.all()
    assert shape.displacements == pytest.approx(
        np.array([[2.0, 0.0, -2.0, 0.0], [2.0, 1.0, -2.0, -1.0]])
    )
    assert not robot.forward({}, model="linkage").section_parameters.any()
    alone = robot.forward({"t00": 2.0}, model="linkage")
    assert alone.displacements == pytest.approx([2.0, 0.0, -2.0, 0.0])
    # A cable that is let out alone goes slack, and nothing bends.
    loose = robot.forward({"t00": -2.0}, model="arc")
    assert loose.converged and loose.slack.tolist() == [True, False, False, False]
    assert not loose.section_parameters.any()


def test_travel_holds_for_tendons_that_follow() -> None:
    robot = make_robot(QUARTER)
    tight = dataclasses.replace(robot.sections[0].tendons[2], travel=(-1.0, 1.0))
    tendons = (*robot.sections[0].tendons[:2], tight, robot.sections[0].tendons[3])
    section = dataclasses.replace(robot.sections[0], tendons=tendons)
    shape = ContinuumRobot((section,)).forward({"t00": 2.0}, model="arc")
    assert not shape.converged
    assert str(shape.reason) == "tendon 't02' is moved -2 mm: its travel is [-1, 1] mm"
