from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.continuum import ContinuumRobot, Section
from bozzini.continuum.energy import EnergyModel
from bozzini.continuum.rod import RodModel
from bozzini.errors import GeometryError
from tests.continuum.rods import (
    BENDING,
    LENGTH,
    ROUTINGS,
    TORSION,
    bend_cantilever,
    cross_tendons,
    follow_law,
    helix,
    integrate_published,
    make_robot,
    taper,
)

NO_PULL = np.zeros(4)


@pytest.mark.parametrize("name", list(ROUTINGS))
def test_without_load_it_is_the_algebraic_law(name) -> None:
    tendons, tensions = ROUTINGS[name]
    tip, displacements = follow_law(tendons, tensions)
    model = RodModel(make_robot(tendons))
    given = model.shape_under_tensions(tensions)
    assert given.tip == pytest.approx(tip, abs=1e-6)
    assert given.displacements == pytest.approx(displacements, abs=1e-8)
    found = model.shape(displacements)
    assert found.converged
    assert found.tip == pytest.approx(tip, abs=1e-6)
    assert found.tensions == pytest.approx(tensions, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "force", "moment"),
    [
        ("taper pair", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ("taper pair", (0.05, 0.02, -0.1), (5.0, 3.0, 2.0)),
        ("full-turn helix", (0.05, 0.02, -0.1), (5.0, 3.0, 2.0)),
    ],
)
def test_it_solves_the_published_equations(name, force, moment) -> None:
    tendons, tensions = ROUTINGS[name]
    model = RodModel(make_robot(tendons), tip_force=force, tip_moment=moment)
    shape = model.shape_under_tensions(tensions)
    base = np.add(moment, np.cross(shape.tip, force))
    tip, force_off, moment_off = integrate_published(
        tendons, tensions, np.array(force), np.array(moment), base
    )
    # What shear and stretch make out, which the published rod has.
    assert shape.tip == pytest.approx(tip, abs=2e-3)
    assert np.abs(force_off).max() < 1e-4
    assert np.abs(moment_off).max() < 2e-3


@pytest.mark.parametrize("force", [0.02, 0.3, 1.0, 5.0])
def test_cantilever_is_the_elastica(force) -> None:
    sideways, axial = bend_cantilever(force)
    model = RodModel(make_robot(cross_tendons()), tip_force=(force, 0.0, 0.0))
    shape = model.shape_under_tensions(NO_PULL)
    assert shape.converged
    assert shape.tip == pytest.approx([sideways, 0.0, axial], abs=1e-6)


def test_steps_are_of_fourth_order() -> None:
    sideways, _ = bend_cantilever(1.0)
    errors = []
    for steps in (50, 100, 200):
        model = RodModel(make_robot(cross_tendons(), discs=10), tip_force=(1.0, 0, 0), steps=steps)
        errors.append(abs(model.shape_under_tensions(NO_PULL).tip[0] - sideways))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders == pytest.approx([4.0, 4.0], abs=0.2)


def test_small_loads_bend_it_as_a_beam() -> None:
    robot = make_robot(cross_tendons())
    line, force, moment = 1e-6, 1e-4, 1e-2
    bent = [
        RodModel(robot, **{name: (value, 0.0, 0.0)}).shape_under_tensions(NO_PULL).tip[0]
        for name, value in (("tip_force", force), ("distributed_force", line))
    ]
    bent.append(RodModel(robot, tip_moment=(0.0, moment, 0.0)).shape_under_tensions(NO_PULL).tip[0])
    beam = [
        force * LENGTH**3 / (3.0 * BENDING),
        line * LENGTH**4 / (8.0 * BENDING),
        moment * LENGTH**2 / (2.0 * BENDING),
    ]
    assert bent == pytest.approx(beam, rel=1e-4)


def test_end_moments_bend_it_into_an_arc_and_twist_it() -> None:
    turn = 2.0
    model = RodModel(make_robot(cross_tendons()), tip_moment=(0.0, turn * BENDING / LENGTH, 0.0))
    tip = model.shape_under_tensions(NO_PULL).tip
    radius = LENGTH / turn
    assert tip == pytest.approx(
        [radius * (1 - math.cos(turn)), 0, radius * math.sin(turn)], abs=1e-7
    )
    model = RodModel(make_robot(cross_tendons()), tip_moment=(0.0, 0.0, turn * TORSION / LENGTH))
    frame = model.shape_under_tensions(NO_PULL).tip_frame[:3, :3]
    assert Rotation.from_matrix(frame).as_rotvec() == pytest.approx([0.0, 0.0, turn], abs=1e-8)


def test_it_buckles_at_eulers_load() -> None:
    critical = math.pi**2 * BENDING / (4.0 * LENGTH**2)
    side = 1e-6
    below, above = (
        RodModel(make_robot(cross_tendons()), tip_force=(side, 0.0, -part * critical))
        .shape_under_tensions(NO_PULL)
        .tip[0]
        for part in (0.5, 0.95)
    )
    # A sideways load grows by 1 / (1 - load / critical), nearly.
    plain = side * LENGTH**3 / (3.0 * BENDING)
    assert below / plain == pytest.approx(2.0, rel=0.05)
    assert above / plain == pytest.approx(20.0, rel=0.05)


def test_given_tensions_and_their_displacements_are_one_shape() -> None:
    tendons = [cross_tendons(3), cross_tendons(3, angle=0.5, prefix="d")]
    robot = make_robot(tendons, sections=2)
    loads = {
        "tip_force": (0.02, -0.03, -0.05),
        "tip_moment": (1.0, 2.0, 0.0),
        "distributed_force": (-1e-3, 0.0, 5e-4),
    }
    tensions = np.array([2.0, 1.0, 0.5, 1.5, 0.7, 2.0])
    model = RodModel(robot, **loads)
    given = model.shape_under_tensions(tensions)
    found = model.shape(given.displacements)
    assert found.converged, found.reason
    assert found.points == pytest.approx(given.points, abs=1e-4)
    # Tendons of one length more or less twist it only: rigid ones leave their sum nearly open.
    assert found.tensions == pytest.approx(tensions, abs=0.1)
    stiff = RodModel(robot, **loads, tendon_stiffness=1e4)
    stretched = stiff.shape(given.displacements + tensions * model.natural_lengths / 1e4)
    assert stretched.tensions == pytest.approx(tensions, rel=1e-4)


@settings(max_examples=15)
@given(st.integers(0, 2**31), st.floats(-math.pi, math.pi))
def test_turning_robot_and_loads_turns_the_shape(seed, angle) -> None:
    rng = np.random.default_rng(seed)
    loads = {
        "tip_force": rng.uniform(-0.05, 0.05, 3),
        "tip_moment": rng.uniform(-3.0, 3.0, 3),
        "distributed_force": rng.uniform(-1e-3, 1e-3, 3),
    }
    pulls = rng.uniform(0.0, 3.0, 2)
    turn = Rotation.from_rotvec([0.0, 0.0, angle])
    plain = RodModel(make_robot((helix("a", 0.6), taper("b", 1.0))), **loads)
    turned = RodModel(
        make_robot((helix("a", 0.6, angle), taper("b", 1.0 + angle))),
        **{name: turn.apply(load) for name, load in loads.items()},
    )
    before, after = plain.shape_under_tensions(pulls), turned.shape_under_tensions(pulls)
    assert before.converged and after.converged
    assert after.points == pytest.approx(turn.apply(before.points), abs=1e-6)


def test_energy_falls_by_the_work_of_the_tendons() -> None:
    # Reciprocity: a tendon's displacement by another's tension is that the other way round.
    tendons, tensions = ROUTINGS["straight and full turn"]
    model = RodModel(make_robot(tendons), tip_force=(0.05, 0.02, -0.1))
    step = 1e-3
    slopes = np.empty((2, 2))
    for index in range(2):
        change = np.zeros(2)
        change[index] = step
        up, down = (model.shape_under_tensions(tensions + sign * change) for sign in (1.0, -1.0))
        slopes[:, index] = (up.displacements - down.displacements) / (2.0 * step)
    assert slopes[0, 1] == pytest.approx(slopes[1, 0], rel=1e-5)
    assert np.linalg.eigvalsh(slopes).min() > 0.0


def test_it_agrees_with_the_energy_model_about_slack() -> None:
    robot = make_robot(cross_tendons())
    commands = [4.0, 1.0, -6.0, -1.0]
    rod = RodModel(robot).shape(commands)
    energy = EnergyModel(robot, segment="channel").shape(commands)
    assert rod.slack.tolist() == energy.slack.tolist() == [False, False, True, False]
    assert rod.points == pytest.approx(energy.points, abs=1e-6)
    assert rod.tensions == pytest.approx(energy.tensions, abs=1e-6)
    assert rod.section_parameters == pytest.approx(energy.section_parameters, abs=1e-7)


def test_sections_and_stiffness_change_along_it() -> None:
    sections = tuple(
        Section(length=length, radius=5.0, bending_stiffness=stiffness, tendons=tuple(tendons))
        for length, stiffness, tendons in (
            (30.0, 2000.0, cross_tendons(3)),
            (70.0, 400.0, cross_tendons(3, angle=0.7, prefix="d")),
        )
    )
    robot = ContinuumRobot(sections)
    commands = [1.0, -5.0, -5.0, 3.0, 1.0, -8.0]
    rod, energy = (
        RodModel(robot).shape(commands),
        EnergyModel(robot, segment="channel").shape(commands),
    )
    assert rod.converged and energy.converged
    assert rod.points == pytest.approx(energy.points, abs=1e-5)


def test_contradictions_are_refused_by_name() -> None:
    shape = RodModel(make_robot(cross_tendons(2))).shape([3.0, 1.0])
    assert not shape.converged
    assert "would have to stretch" in str(shape.reason)
    assert "'t0'" in str(shape.reason) or "'t1'" in str(shape.reason)
    with pytest.raises(GeometryError, match=re.escape(str(shape.reason))):
        shape.require()


def test_stiff_tendons_hold_against_a_load() -> None:
    robot = make_robot(cross_tendons())
    force = (0.02, 0.0, 0.0)
    free = RodModel(robot, tip_force=force).shape_under_tensions(NO_PULL).tip[0]
    held = [
        RodModel(robot, tip_force=force, tendon_stiffness=ea).shape(NO_PULL).tip[0]
        for ea in (1e2, 1e3, 1e4)
    ]
    assert free > held[0] > held[1] > held[2] > 0.0


def test_a_batch_is_its_commands_one_by_one() -> None:
    model = RodModel(make_robot((helix("a", 0.4), taper("b", 2.0))), tip_force=(0.01, 0.0, -0.02))
    commands = np.array([[1.0, 2.0], [3.0, -1.0], [0.0, 0.0]])
    batch = model.shape(commands)
    for index, command in enumerate(commands):
        assert np.array_equal(model.shape(command).points, batch.points[index])


def test_a_rod_is_pushed() -> None:
    rods = make_robot(cross_tendons(2, pushes=True))
    assert RodModel(rods).shape_under_tensions([1.0, -1.0]).converged


def test_without_tendons_it_is_a_cantilever() -> None:
    robot = ContinuumRobot((Section(length=LENGTH, radius=5.0, bending_stiffness=BENDING),))
    sideways, axial = bend_cantilever(0.3)
    model = RodModel(robot, tip_force=(0.3, 0.0, 0.0))
    for shape in (model.shape([]), model.shape_under_tensions([])):
        assert shape.converged, shape.reason
        assert shape.tip == pytest.approx([sideways, 0.0, axial], abs=1e-6)
    assert model.shape(np.zeros((3, 0))).tip.shape == (3, 3)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-5, 1e-4, 1e-3])
def test_a_twist_that_tendons_lock_is_refused(tolerance) -> None:
    # The tip moves by millimetres from one tolerance to the next: none of them is the answer.
    robot = make_robot([cross_tendons(3), cross_tendons(3, angle=1.0, prefix="d")], sections=2)
    commands = [3.0, -1.5, -1.5, 5.0, -1.0, -4.0]
    load = {"tip_force": (0.0, 0.05, 0.0)}
    shape = RodModel(robot, tolerance=tolerance, **load).shape(commands)
    assert not shape.converged
    assert "give a tendon_stiffness" in str(shape.reason)
    stretchy = RodModel(robot, tolerance=tolerance, tendon_stiffness=1e4, **load).shape(commands)
    assert stretchy.converged, stretchy.reason


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4])
def test_a_load_in_the_plane_of_the_bend_needs_no_stretch(tolerance) -> None:
    robot = make_robot(cross_tendons())
    tips = [
        RodModel(robot, tip_force=(0.05, 0.0, -0.02), tolerance=tolerance, **options)
        .shape([3.0, 0.0, -3.0, 0.0])
        .require()
        .tip
        for options in ({}, {"tendon_stiffness": 1e7})
    ]
    assert tips[0] == pytest.approx(tips[1], abs=max(1e-3, 30.0 * tolerance))


def test_what_converged_misses_no_more_than_the_tolerance() -> None:
    # Redundant tendons that share their load must not lose the command for it.
    tendons = [cross_tendons(4), cross_tendons(4, angle=0.3, prefix="d")]
    robot = make_robot(tendons, sections=2)
    for tolerance in (1e-6, 1e-4):
        for force in ((0.02, 0.0, 0.0), (0.0, 0.0, 0.05)):
            model = RodModel(robot, tip_force=force, tolerance=tolerance)
            shape = model.shape([2.0, 0.0, -2.0, 0.0, 2.0, 0.0, -2.0, 0.0])
            assert not shape.converged or shape.residual <= 1.1 * tolerance
