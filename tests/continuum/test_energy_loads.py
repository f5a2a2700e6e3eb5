from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipk

from bozzini.continuum import ContinuumRobot, Section, Tendon
from bozzini.continuum.energy import EnergyModel
from bozzini.continuum.loads import LineLoad, PointLoad
from bozzini.continuum.rod import RodModel
from bozzini.errors import GeometryError, InputError
from tests.continuum.rods import (
    BENDING,
    LENGTH,
    ROUTINGS,
    bend_cantilever,
    cross_tendons,
    make_robot,
)

EULER = math.pi**2 * BENDING / (4.0 * LENGTH**2)
"""Load at which the straight rod, clamped at its base, buckles [N]."""

NO_PULL = np.zeros(4)


def load(robot=None, *, discs=12, **options):
    """A model of a robot with four parallel cables unless another is given."""
    return EnergyModel(robot or make_robot(cross_tendons(), discs=discs), **options)


def find_orders(errors):
    return np.log2(np.divide(errors[:-1], errors[1:]))


@pytest.mark.parametrize("segment", ["chord", "channel"])
@pytest.mark.parametrize("name", ["taper pair", "full-turn pair"])
def test_converges_to_the_loaded_rod_with_second_order(name, segment) -> None:
    tendons, tensions = ROUTINGS[name]
    options = {"tip_force": (0.05, 0.02, -0.05), "distributed_force": (0.0, -5e-4, 0.0)}
    rod = RodModel(make_robot(tendons), **options).shape_under_tensions(tensions)
    errors = []
    for discs in (8, 16, 32):
        model = load(make_robot(tendons, discs=discs), segment=segment, **options)
        shape = model.shape_under_tensions(tensions)
        assert shape.converged and shape.stable
        errors.append(np.linalg.norm(shape.tip - rod.tip))
    assert find_orders(errors) == pytest.approx([2.0, 2.0], abs=0.15)


def test_stability_is_that_of_the_rod() -> None:
    tendons, tensions = ROUTINGS["full-turn pair"]
    options = {"tip_force": (0.02, 0.01, -0.3)}
    rod = RodModel(make_robot(tendons), **options).shape_under_tensions(tensions)
    found = []
    for discs in (10, 20, 40):
        model = load(make_robot(tendons, discs=discs), **options)
        found.append(float(model.shape_under_tensions(tensions).stability))
    assert found[-1] == pytest.approx(float(rod.stability), abs=1e-3)
    first, second = np.diff(found)
    assert math.log2(first / second) == pytest.approx(2.0, abs=0.3)


def test_euler_load_converges_with_second_order() -> None:
    errors = []
    for discs in (5, 10, 20):
        shape = load(discs=discs, tip_force=(0.0, 0.0, -0.5 * EULER)).shape_under_tensions(NO_PULL)
        assert shape.converged
        # The second variation is linear in the load of a straight rod.
        errors.append(abs(0.5 / (1.0 - float(shape.stability)) - 1.0))
    assert find_orders(errors) == pytest.approx([2.0, 2.0], abs=0.05)


def test_buckled_rod_is_the_elastica_of_elliptic_integrals() -> None:
    m = math.sin(0.5 * 1.2) ** 2  # the tip has turned by 1.2 rad
    force = EULER * (2.0 * ellipk(m) / math.pi) ** 2
    axial = LENGTH * (2.0 * ellipe(m) / ellipk(m) - 1.0)
    sideways = 2.0 * LENGTH * math.sqrt(m) / ellipk(m)
    errors = []
    for discs in (5, 10, 20):
        model = load(discs=discs, segment="channel", tip_force=(1e-9, 0.0, -force))
        shape = model.shape_under_tensions(NO_PULL)
        assert shape.converged and shape.stable
        errors.append(np.linalg.norm(shape.tip - [sideways, 0.0, axial]))
    assert find_orders(errors) == pytest.approx([2.0, 2.0], abs=0.1)


def test_force_across_is_the_elastica() -> None:
    sideways, axial = bend_cantilever(0.3)
    errors = [
        np.linalg.norm(
            load(discs=discs, tip_force=(0.3, 0.0, 0.0)).shape_under_tensions(NO_PULL).tip
            - [sideways, 0.0, axial]
        )
        for discs in (5, 10, 20)
    ]
    assert find_orders(errors) == pytest.approx([2.0, 2.0], abs=0.1)


@pytest.mark.parametrize("segment", ["chord", "arc", "channel"])
def test_beyond_the_buckling_load_it_is_stable_or_refused(segment) -> None:
    leaning = load(segment=segment, tip_force=(1e-4, 0.0, -4.0 * EULER))
    shape = leaning.shape_under_tensions(NO_PULL)
    assert shape.converged and shape.stable
    assert shape.tip[0] > 0.5 * LENGTH
    straight = load(segment=segment, tip_force=(0.0, 0.0, -4.0 * EULER))
    refused = straight.shape_under_tensions(NO_PULL)
    assert not refused.converged and not refused.stable
    assert "buckles at 0.25" in str(refused.reason)


@pytest.mark.parametrize("stiffness", [1e4, math.inf])
def test_cables_without_tension_hold_the_turn_of_the_tip(stiffness) -> None:
    # All bends but those between two parallel ends would stretch one: four times Euler's load.
    for share in (0.5, 0.9):
        model = load(tip_force=(0.0, 0.0, -4.0 * share * EULER), tendon_stiffness=stiffness)
        shape = model.shape(NO_PULL)
        assert shape.converged, shape.reason
        assert float(shape.stability) == pytest.approx(1.0 - share, abs=0.02)
        assert shape.tip == pytest.approx([0.0, 0.0, LENGTH], abs=1e-3)
    model = load(tip_force=(0.0, 0.0, -5.0 * EULER), tendon_stiffness=stiffness)
    named = re.search(r"buckles at ([\d.]+) of the load", str(model.shape(NO_PULL).reason))
    assert named and float(named[1]) == pytest.approx(0.8, abs=0.01)


def test_loaded_tendons_find_the_equilibrium_that_is_there() -> None:
    robot = make_robot(cross_tendons(), discs=40, stiffness=(200.0, 154.0))
    model = EnergyModel(robot, tip_force=(0.0, 0.0, -0.07), tendon_stiffness=1e4)
    shape = model.shape([3.0, 0.0, -3.0, 0.0])
    assert shape.converged and shape.stable
    assert shape.tip == pytest.approx([49.03, 0.0, 83.90], abs=0.02)


@pytest.mark.parametrize("kind", [EnergyModel, RodModel])
def test_rigid_antagonists_are_refused_where_the_tolerance_would_decide(kind) -> None:
    robot = make_robot(cross_tendons(), stiffness=(200.0, 154.0))
    tips = []
    for tolerance in (1e-4, 1e-3):
        shape = kind(robot, tip_force=(0.0, 0.01, 0.0), tolerance=tolerance).shape(
            [3.0, 0.0, -3.0, 0.0]
        )
        assert not shape.converged and "\n" not in str(shape.reason)
        assert "leave the shape open" in str(shape.reason) and "stiffness" in str(shape.reason)
        tips.append(shape.tip)
    assert np.linalg.norm(tips[0] - tips[1]) > 0.1
    # Along the plane of the bend there is nothing to twist, and loose ones do not lock.
    for force, command in (
        ((0.0, 0.0, -0.07), [3.0, 0.0, -3.0, 0.0]),
        ((0.0, 0.01, 0.0), [3.0, math.nan, math.nan, math.nan]),
    ):
        assert kind(robot, tip_force=force).shape(command).converged


def test_reason_has_the_stiffness_with_which_there_is_an_equilibrium() -> None:
    robot = make_robot(cross_tendons(), stiffness=(200.0, 154.0))
    command = [3.0, 0.0, -3.0, 0.0]
    shape = EnergyModel(robot, tip_force=(0.0, 0.01, 0.0)).shape(command)
    found = re.search(r"lock the backbone .*, with ([\d.e+]+) N there is", str(shape.reason))
    assert not shape.converged and found
    softer = EnergyModel(robot, tip_force=(0.0, 0.01, 0.0), tendon_stiffness=float(found[1]))
    assert softer.shape(command).converged


def test_displacements_and_tensions_lead_to_the_same_shape() -> None:
    tendons = [
        dataclasses.replace(tendon, stiffness=2e3, pretension=0.2) for tendon in cross_tendons()
    ]
    robot = make_robot(tendons, discs=10)
    model = EnergyModel(robot, tip_force=(0.02, 0.01, -0.1), loads=[LineLoad(force=(0, 1e-3, 0))])
    given = model.shape([2.0, 1.0, -2.5, -1.0])
    assert given.converged, given.reason
    back = model.shape_under_tensions(given.tensions)
    assert back.tip == pytest.approx(given.tip, abs=1e-7)
    pulled = given.tensions > 0.0
    assert back.displacements[pulled] == pytest.approx(given.displacements[pulled], abs=1e-7)
    again = model.shape(given.displacements, initial=given)
    assert again.tip == pytest.approx(given.tip, abs=1e-7)


def test_no_commands_have_no_shapes() -> None:
    model = EnergyModel(make_robot(cross_tendons()), tip_force=(0.01, 0.0, 0.0))
    for shapes in (model.shape(np.zeros((0, 4))), model.shape_under_tensions(np.zeros((0, 4)))):
        assert shapes.tip.shape == (0, 3) and shapes.converged.shape == (0,)


def test_rest_has_the_pretension() -> None:
    tendons = [dataclasses.replace(t, stiffness=2e3, pretension=0.2) for t in cross_tendons()]
    shape = EnergyModel(make_robot(tendons)).shape(NO_PULL)
    assert shape.tensions == pytest.approx(0.2, rel=1e-7)


def test_tendon_that_follows_is_slack() -> None:
    model = load(tip_force=(0.01, 0.0, 0.0))
    free = model.shape([3.0, 0.0, np.nan, 0.0])
    let_out = model.shape([3.0, 0.0, -20.0, 0.0])
    assert free.tip == pytest.approx(let_out.tip, abs=1e-7)
    assert free.slack[2] and free.tensions[2] == 0.0
    assert free.displacements[2] == pytest.approx(
        model.natural_lengths[2] - free.tendon_lengths[2], abs=1e-9
    )
    unloaded = load()
    assert unloaded.shape([3.0, 0.0, np.nan, 0.0]).tip == pytest.approx(
        unloaded.shape([3.0, 0.0, -20.0, 0.0]).tip, abs=1e-5
    )


def test_weight_turns_with_the_base() -> None:
    turn = Rotation.from_rotvec([0.4, -1.1, 0.3])
    section = Section(
        length=LENGTH,
        radius=5.0,
        discs=10,
        tendons=cross_tendons(),
        line_weight=2e-4,
        disc_weight=1e-3,
    )
    robot = ContinuumRobot((section,), base_rotation=turn.as_rotvec())
    light = dataclasses.replace(section, line_weight=0.0, disc_weight=0.0)
    down = turn.inv().apply([0.0, 0.0, -1.0])
    discs = [
        PointLoad(arc_length=place, force=tuple(1e-3 * down)) for place in robot.disc_arc_length
    ]
    other = EnergyModel(
        ContinuumRobot((light,)), distributed_force=tuple(2e-4 * down), loads=discs
    ).shape_under_tensions([0.3, 0.0, 0.0, 0.1])
    shape = EnergyModel(robot).shape_under_tensions([0.3, 0.0, 0.0, 0.1])
    assert shape.converged
    assert shape.tip == pytest.approx(other.tip, abs=1e-7)
    whole = 2e-4 * LENGTH + 10 * 1e-3
    lifted = EnergyModel(
        ContinuumRobot((light,)), tip_force=tuple(whole * down)
    ).shape_under_tensions([0.3, 0.0, 0.0, 0.1])
    assert np.linalg.norm(lifted.tip - shape.tip) > 1.0


def test_following_force_is_the_dead_one_of_where_it_ends() -> None:
    body = load(loads=[PointLoad(force=(0.2, 0.0, -0.1), arc_length=80.0, frame="body")])
    shape = body.shape_under_tensions([0.5, 0.2, 0.0, 0.0])
    assert shape.converged, shape.reason
    at = np.flatnonzero(np.isclose(shape.arc_length, 75.0))[0]
    body = load(loads=[PointLoad(force=(0.2, 0.0, -0.1), arc_length=75.0, frame="body")])
    shape = body.shape_under_tensions([0.5, 0.2, 0.0, 0.0])
    force = tuple(shape.frames[at, :3, :3] @ [0.2, 0.0, -0.1])
    dead = load(loads=[PointLoad(force=force, arc_length=75.0)])
    same = dead.shape_under_tensions([0.5, 0.2, 0.0, 0.0], initial=shape)
    assert same.tip == pytest.approx(shape.tip, abs=1e-6)


def test_robot_of_natural_curvature_rests_in_it() -> None:
    bent = make_robot(cross_tendons(), discs=10, curvature=(0.0, 0.01, 0.002))
    model = EnergyModel(bent, segment="channel")
    rest = model.shape(NO_PULL)
    assert rest.converged
    assert rest.tensions == pytest.approx(0.0, abs=1e-9)
    frames = Rotation.from_rotvec([0.0, 0.01 * LENGTH, 0.002 * LENGTH])
    assert rest.tip_frame[:3, :3] == pytest.approx(frames.as_matrix(), abs=1e-7)
    # A moment that undoes it.
    stiff = np.array([BENDING, BENDING, 770.0])
    moment = PointLoad(moment=tuple(-stiff * [0.0, 0.01, 0.002]), frame="body")
    undone = EnergyModel(bent, segment="channel", loads=[moment]).shape_under_tensions(NO_PULL)
    assert undone.tip == pytest.approx([0.0, 0.0, LENGTH], abs=1e-5)


@pytest.mark.parametrize("pulled", [NO_PULL, (3.0, 0.0, -3.0, 0.0), (2.0, *[math.nan] * 3)])
def test_displacements_count_from_the_shape_at_rest(pulled) -> None:
    curvature = ((0.0, 0.0, 0.0, 0.0), (LENGTH, 0.01, 0.004, 0.002))
    robots = [
        make_robot(
            [dataclasses.replace(t, friction=mu) for t in cross_tendons()], curvature=curvature
        )
        for mu in (0.0, 1e-7)
    ]
    found = EnergyModel(robots[0], segment="channel", tendon_stiffness=1e4, between=3).shape(pulled)
    for robot in robots:
        rod = RodModel(robot, tendon_stiffness=1e4).shape(pulled)
        assert rod.converged
        assert rod.tip == pytest.approx(found.tip, abs=5e-3)
        assert rod.tensions == pytest.approx(found.tensions, abs=1e-3)
    with pytest.raises(InputError, match=r"it must lie in \[0, 0.2\) rad/mm"):
        dataclasses.replace(robots[0].sections[0], radius=5.0, curvature=(0.0, 0.3, 0.0))
    with pytest.raises(InputError, match=r"turns a segment by 200 rad"):
        EnergyModel(make_robot(cross_tendons(), discs=10, curvature=(0.0, 0.0, 20.0)))


def test_limit_of_a_tension_is_named() -> None:
    tendons = [dataclasses.replace(t, tension_limit=0.5) for t in cross_tendons()]
    shape = load(make_robot(tendons), tip_force=(-0.1, 0.0, 0.0)).shape([5.0, 0.0, -5.0, 0.0])
    assert not shape.converged
    assert "limit is 0.5 N" in str(shape.reason)


@pytest.mark.parametrize("held", ["displacements", "tensions"])
@pytest.mark.parametrize("segment", ["chord", "channel"])
def test_derivatives_are_those_of_differences(segment, held) -> None:
    robot = make_robot([ROUTINGS["taper pair"][0], cross_tendons(3)], discs=5, sections=2)
    model = EnergyModel(
        robot,
        segment=segment,
        tip_force=(0.03, 0.05, -0.1),
        tendon_stiffness=5e3,
        loads=[LineLoad(force=(1e-3, 0.0, 0.0), frame="world")],
    )
    tensions = np.array([0.5, 0.3, 0.4, 0.2, 0.1])
    shape = model.shape_under_tensions(tensions)

    def solve(model, command):
        if held == "tensions":
            return model.shape_under_tensions(command, initial=shape)
        return model.shape(command, initial=shape)

    command = tensions if held == "tensions" else shape.displacements
    found = model.jacobian(shape, held=held)
    by_command = found.by_tension if held == "tensions" else found.by_displacement

    def agree(derivative, change, step):
        up, down = change(step), change(-step)
        motion = (up.points - down.points) / (2.0 * step)
        # The solver's steps end at 1e-10 rad.
        floor = 1e-5 * np.abs(motion).max() + 2e-9 / step
        assert derivative[:, 3:] == pytest.approx(motion, rel=1e-4, abs=floor)
        spin = (up.frames - down.frames)[:, :3, :3] / (2.0 * step)
        spin = spin @ np.swapaxes(shape.frames[:, :3, :3], -1, -2)
        spins = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
        floor = 1e-5 * np.abs(spins).max() + 5e-11 / step
        assert derivative[:, :3] == pytest.approx(spins, rel=1e-4, abs=floor)

    for k in range(5):
        unit = np.eye(5)[k]
        agree(by_command[..., k], lambda h, unit=unit: solve(model, command + h * unit), 1e-4)
    for k in range(3):
        unit = np.eye(3)[k]

        def push(h, unit=unit):
            force = tuple(model.tip_force + h * unit)
            return solve(dataclasses.replace(model, tip_force=force), command)

        agree(found.by_tip_wrench[..., 3 + k], push, 1e-4)

        def turn(h, unit=unit):
            return solve(dataclasses.replace(model, tip_moment=tuple(h * unit)), command)

        agree(found.by_tip_wrench[..., k], turn, 1e-2)
    for m in range(2):
        for kind, name in enumerate(("bending_stiffness", "torsional_stiffness")):

            def stiffen(h, m=m, name=name):
                own = robot.sections[m]
                others = {"torsional_stiffness": own.torsional_stiffness}
                changed = others | {name: getattr(own, name) * (1.0 + h)}
                sections = list(robot.sections)
                sections[m] = dataclasses.replace(own, **changed)
                other = dataclasses.replace(robot, sections=tuple(sections))
                return solve(dataclasses.replace(model, robot=other), command)

            agree(found.by_stiffness[..., m, kind], stiffen, 1e-3)
    # Maxwell and Betti: what a wrench at the tip does on another is the same the other way round.
    compliance = found.by_tip_wrench[-1]
    assert compliance == pytest.approx(compliance.T, abs=1e-9 * np.abs(compliance).max())


def bend_planar(rate, force):
    """Turn and moment at the tip of the elastica that starts with a curvature [1/mm]."""

    def rates(s, y):
        return [y[1], -force * math.sin(y[0]) / BENDING]

    done = solve_ivp(rates, (0.0, LENGTH), [0.0, rate], rtol=1e-10, atol=1e-13)
    return done.y[0, -1], BENDING * done.y[1, -1]


def test_path_turns_where_the_elastica_does() -> None:
    force = 1.5 * EULER
    # Moments at the tip that hold the buckled rod against the force: the least one is the limit.
    turned = brentq(lambda rate: bend_planar(rate, force)[1], 0.02, 0.06)
    limit = -minimize_scalar(
        lambda rate: bend_planar(rate, force)[1], bounds=(0.0, turned), method="bounded"
    ).fun
    tendons = [Tendon(name="a", offset=4.0, pushes=True)]
    errors = []
    for discs in (4, 8):
        model = EnergyModel(
            make_robot(tendons, discs=discs), segment="channel", tip_force=(0.0, 0.0, -force)
        )
        path = model.trace_path(
            [1.0], given="tensions", varied="command", factors=(3.0, -3.0), most_points=300
        )
        assert path.converged, path.reason
        assert len(path.limit_points) == 2
        down, up = 4.0 * path.factors[list(path.limit_points)]
        assert down == pytest.approx(-up, rel=1e-6)
        errors.append(abs(abs(down) - limit))
        assert errors[-1] < 0.2 * limit
    assert find_orders(errors) == pytest.approx([2.0], abs=0.3)
    # What the backbone holds is what force and tendon have done.
    shapes = path.shapes
    lengths, pulls = shapes.tendon_lengths[:, 0], shapes.tensions[:, 0]
    work = -0.5 * (pulls[1:] + pulls[:-1]) * np.diff(lengths) - force * np.diff(shapes.tip[:, 2])
    gained = np.diff(path.energy)
    assert gained.sum() == pytest.approx(work.sum(), abs=1e-2 * np.abs(gained).sum())
    middle = path.stability[slice(*(index + 1 for index in path.limit_points))]
    assert (middle[:-1] < 0.0).all()
    # The table has a row for each point; the picture marks the limits.
    frame = path.to_frame()
    assert frame["limit_point"].sum() == 2 and len(frame) == len(path.factors)
    axes = path.plot()
    assert len(axes.lines[-1].get_xdata()) == 2


def test_path_crosses_the_one_of_a_buckled_rod() -> None:
    model = load(discs=10, tip_force=(0.0, 0.0, -4.0 * EULER))
    path = model.trace_path(NO_PULL, given="tensions")
    assert path.converged and not path.limit_points
    before, after = (path.factors[path.branch_points[0] - k] for k in (1, 0))
    assert before < 0.25 < after
    assert path.shapes.converged.all() and not path.shapes.stable[-1]


def test_path_goes_on_where_a_cable_goes_slack() -> None:
    model = load(discs=10, tip_force=(0.4, 0.0, 0.0))
    path = model.trace_path([3.0, 0.0, -30.0, 0.0])
    assert path.converged, path.reason
    assert not path.shapes.slack[0, 0] and path.shapes.slack[-1, 0]
    end = model.shape([3.0, 0.0, -30.0, 0.0])
    assert path.shapes.tip[-1] == pytest.approx(end.tip, abs=1e-6)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: load(tip_force=(1.0, 2.0)), "tip_force has shape (2,)"),
        (lambda: load(loads=[3.0]), "each must be a PointLoad or a LineLoad"),
        (lambda: load().shape_under_tensions([-1.0, 0, 0, 0]), "a cable does not push"),
        (lambda: load().shape(NO_PULL, initial=3), "initial is of type int"),
        (lambda: load().trace_path(NO_PULL, factors=(1.0, 1.0)), "they must differ"),
        (lambda: load().trace_path(np.zeros((2, 4))), "command has shape (2, 4)"),
    ],
)
def test_wrong_input_is_named(call, words) -> None:
    with pytest.raises((InputError, GeometryError)) as caught:
        call()
    assert words in str(caught.value)
