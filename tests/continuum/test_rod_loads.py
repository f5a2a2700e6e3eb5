"""The rod under loads of every kind: weight, followers, stretch, buckling, and derivatives."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from bozzini.continuum import (
    ContinuumRobot,
    EnergyModel,
    LineLoad,
    PointLoad,
    RodModel,
    Section,
    Tendon,
    Wire,
)
from bozzini.errors import GeometryError, InputError
from tests.continuum.rods import (
    BENDING,
    LENGTH,
    ROUTINGS,
    cross_tendons,
    draw_robot,
    helix,
    integrate_published,
    make_robot,
    taper,
)

EULER = math.pi**2 * BENDING / (4.0 * LENGTH**2)
"""Buckling load of the cantilever without tension [N]."""

PAIR = [helix("a", 0.4), taper("b", 2.0)]
SOFT = {"stretch_stiffness": 2000.0, "shear_stiffness": 500.0}
LOADS = (
    PointLoad(arc_length=60.0, force=(0.03, 0.02, 0.0), moment=(0.5, 0.0, 1.0), frame="body"),
    LineLoad(force=(0.0, 1e-3, 0.0), frame="body", start=20.0, end=70.0),
    LineLoad(force=(5e-4, 0.0, -1e-3)),
)


def bare(**fields) -> ContinuumRobot:
    """A robot without tendons."""
    return ContinuumRobot((Section(length=LENGTH, radius=5.0, **fields),))


# Loads and what the rod is made of.


@pytest.mark.parametrize("name", ["taper pair", "full-turn helix"])
def test_shear_and_stretch_are_those_of_the_published_equations(name) -> None:
    tendons, tensions = ROUTINGS[name]
    robot = make_robot(tendons, **SOFT)
    shape = RodModel(robot, stretches=True).shape_under_tensions(tensions).require()
    zero = np.zeros(3)
    tip, _, _ = integrate_published(tendons, tensions, zero, zero, zero, axial=2e3, shear=500.0)
    assert shape.tip == pytest.approx(tip, abs=2e-3)
    assert np.linalg.norm(shape.tip - RodModel(robot).shape_under_tensions(tensions).tip) > 0.1


def test_a_hanging_rod_is_longer_by_its_weight() -> None:
    wire = Wire(diameter=2.0, modulus=10.0, density=1e5)
    weight = bare(wire=wire).weight_at(1.0)
    robot = ContinuumRobot(bare(wire=wire).sections, base_rotation=(math.pi, 0.0, 0.0))
    shape = RodModel(robot, stretches=True).shape_under_tensions([]).require()
    area = math.pi
    longer = weight * LENGTH**2 / (2.0 * 10.0 * area)
    assert shape.tip[2] - LENGTH == pytest.approx(longer, rel=1e-6)


def test_weight_is_a_line_load_and_discs_are_points() -> None:
    robot = ContinuumRobot(
        bare(bending_stiffness=BENDING, line_weight=1e-4, disc_weight=0.002, discs=5).sections,
        base_rotation=(0.0, math.pi / 2.0, 0.0),
    )
    loads = [LineLoad(force=(1e-4, 0.0, 0.0))]
    loads += [PointLoad(arc_length=20.0 * k, force=(0.002, 0.0, 0.0)) for k in range(1, 6)]
    plain = bare(bending_stiffness=BENDING, discs=5)
    shapes = [
        model.shape_under_tensions([]).require()
        for model in (RodModel(robot), RodModel(plain, loads=loads))
    ]
    assert shapes[0].points == pytest.approx(shapes[1].points, abs=1e-9)


def test_a_follower_at_the_tip_bends_as_its_direction_there() -> None:
    robot = bare(bending_stiffness=BENDING)
    force = (0.1, 0.0, 0.0)
    turned = RodModel(robot, loads=[PointLoad(force=force, frame="body")])
    shape = turned.shape_under_tensions([]).require()
    dead = tuple(shape.tip_frame[:3, :3] @ force)
    again = RodModel(robot, tip_force=dead).shape_under_tensions([]).require()
    assert again.points == pytest.approx(shape.points, abs=1e-7)


@pytest.mark.parametrize("frame", ["base", "body"])
def test_a_moment_on_the_tip_bends_to_a_circle_that_is_stable(frame) -> None:
    # Given the loads on the tip there is one shape only: it cannot diverge.
    bend = 1.2 * math.pi
    moment = PointLoad(moment=(0.0, bend * BENDING / LENGTH, 0.0), frame=frame)
    robot = make_robot(cross_tendons(2))
    shape = RodModel(robot, loads=[moment]).shape_under_tensions([0.0, 0.0]).require()
    radius = LENGTH / bend
    circle = (radius * (1.0 - math.cos(bend)), 0.0, radius * math.sin(bend))
    assert shape.tip == pytest.approx(circle, abs=1e-5)
    assert shape.stability > 0.9


def test_followers_bend_two_sections_as_from_the_tip() -> None:
    # From the tip, where force and moment are known in its frame, back to the base.
    stiffness = ((200.0, 200.0, 154.0), (90.0, 90.0, 60.0))
    robot = ContinuumRobot(
        tuple(
            Section(length=long, radius=5.0, bending_stiffness=own[0], torsional_stiffness=own[2])
            for long, own in zip((60.0, 40.0), stiffness, strict=True)
        )
    )
    force, moment = (0.05, -0.04, -0.02), (1.0, 2.0, -1.5)
    state = np.concatenate([force, moment, np.zeros(3), np.eye(3).ravel()])

    def go_back(place, now, own):
        axes, strain = now[9:].reshape(3, 3), now[3:6] / own
        forces, moments = np.cross(strain, now[:3]), np.cross(strain, now[3:6])
        moments += np.cross([0.0, 0.0, 1.0], now[:3])
        return np.concatenate([forces, moments, -axes[:, 2], np.cross(strain, axes).ravel()])

    for length, own in ((40.0, stiffness[1]), (60.0, stiffness[0])):
        way = solve_ivp(go_back, (0.0, length), state, args=(own,), rtol=1e-10, atol=1e-11)
        state = way.y[:, -1]
    base = state[9:].reshape(3, 3).T
    loads = [PointLoad(force=force, moment=moment, frame="body")]
    shape = RodModel(robot, loads=loads).shape_under_tensions([]).require()
    assert shape.tip == pytest.approx(-base @ state[6:9], abs=1e-5)
    assert shape.tip_frame[:3, :3] == pytest.approx(base, abs=1e-7)


@pytest.mark.parametrize("share", [0.5, 1.3])
def test_stability_under_followers_is_that_of_energy(share) -> None:
    robot = make_robot(cross_tendons(2, stiffness=2000.0), discs=30)
    loads = [
        PointLoad(force=(0.0, 0.01, -share * EULER)),
        PointLoad(arc_length=60.0, force=(0.05, 0.0, 0.0), moment=(0.0, 0.0, 2.0), frame="body"),
        LineLoad(force=(1e-3, 0.0, 0.0), frame="body"),
    ]
    models = RodModel(robot, loads=loads), EnergyModel(robot, loads=loads, segment="channel")
    pulled = [model.shape_under_tensions([1.5, 0.0]).require() for model in models]
    held = [model.shape([0.5, -0.4]).require() for model in models]
    for shapes in (pulled, held):
        stability = [float(shape.stability) for shape in shapes]
        assert stability[0] == pytest.approx(stability[1], rel=0.02)


@pytest.mark.parametrize("pull", [0.0, 0.6])
def test_a_straight_rod_buckles_at_the_load_that_is_named(pull) -> None:
    # A force P that pushes and a part of it that pulls along the tip, whose own direction holds it
    # back: EI y'''' + (1 - pull) P y'' = 0, and EI y''' + P y' = 0 = y'' at the tip.
    def miss(share):
        push = share * EULER / BENDING
        root = math.sqrt((1.0 - pull) * push)
        c, s = math.cos(root * LENGTH), math.sin(root * LENGTH)
        ends = (root**2 * s - push * s, push * (c - 1.0) - root**2 * c)
        return c * ends[1] - s * ends[0]

    load = 2.0 * EULER
    loads = [PointLoad(force=(0.0, 0.0, -load))]
    loads += [PointLoad(force=(0.0, 0.0, pull * load), frame="body")] if pull else []
    model = RodModel(make_robot(cross_tendons(2)), loads=loads)
    named = re.search(r"buckles at ([\d.]+) %", str(model.shape_under_tensions([0.0, 0.0]).reason))
    assert 0.02 * float(named[1]) == pytest.approx(brentq(miss, 0.2, 1.9), rel=3e-3)


@pytest.mark.parametrize("stiffness", [50.0, 5000.0])
def test_stability_changes_sign_where_a_column_held_by_cables_buckles(stiffness) -> None:
    # Cables of held length turn the tip back by 2 a^2 EA / L of its turn, without a force aside:
    # EI b cos(b L) + 2 a^2 EA / L sin(b L) = 0 for the load EI b^2.
    length, bending, offset = 100.0, 200.0, 4.0
    back = 2.0 * offset**2 * stiffness / length

    def miss(b):
        return bending * b * math.cos(b * length) + back * math.sin(b * length)

    load = bending * brentq(miss, 1.001 * math.pi / 2.0 / length, math.pi / length) ** 2
    tendons = tuple(
        Tendon(
            name=f"T{k}",
            offset=offset,
            angle=k * math.pi / 2.0,
            stiffness=stiffness,
            pretension=1.0,
        )
        for k in range(4)
    )
    robot = ContinuumRobot(
        (Section(length=length, radius=5.0, bending_stiffness=bending, tendons=tendons),)
    )
    found = []
    for share in (0.9995, 1.0005):
        shape = RodModel(robot, tip_force=(0.0, 0.0, -share * load)).shape([0.0] * 4)
        straight = bool(np.hypot(*shape.tip[:2]) < 1e-3)
        found.append((bool(shape.stable), straight))
    assert found[0] == (True, True)
    assert found[1] != (True, True)


def test_curvature_at_rest_is_the_shape_without_loads() -> None:
    u = (0.004, 0.0, 0.02)
    shape = RodModel(bare(bending_stiffness=BENDING, curvature=u)).shape_under_tensions([])
    turn = Rotation.from_rotvec(np.multiply(LENGTH, u)).as_matrix()
    assert shape.tip_frame[:3, :3] == pytest.approx(turn, abs=1e-8)


def test_a_tapered_rod_is_many_even_ones() -> None:
    knots = ((0.0, 2000.0), (LENGTH, 500.0))
    parts = 50
    pieces = tuple(
        Section(
            length=LENGTH / parts,
            radius=5.0,
            discs=1,
            bending_stiffness=2000.0 - 1500.0 * (k + 0.5) / parts,
        )
        for k in range(parts)
    )
    tips = [
        RodModel(robot, tip_force=(0.3, 0.0, 0.0)).shape_under_tensions([]).require().tip
        for robot in (bare(bending_stiffness=knots), ContinuumRobot(pieces))
    ]
    assert tips[0] == pytest.approx(tips[1], abs=5e-3)


def test_a_tendon_without_a_command_follows() -> None:
    robot = make_robot(cross_tendons(2))
    model = RodModel(robot, tip_force=(0.01, 0.0, -0.02))
    shape = model.shape([2.0, math.nan]).require()
    assert shape.slack[1] and shape.tensions[1] == 0.0
    assert shape.displacements[1] < -1.5
    pulled = make_robot(
        [dataclasses.replace(t, stiffness=1e4, pretension=0.5) for t in cross_tendons(2)]
    )
    shape = RodModel(pulled, tip_force=(0.01, 0.0, -0.02)).shape([2.0, math.nan]).require()
    assert shape.tensions[1] == pytest.approx(0.5)
    both = RodModel(pulled, tip_force=(0.01, 0.0, -0.02)).shape(shape.displacements).require()
    assert both.points == pytest.approx(shape.points, abs=1e-5)


# Stability.


@pytest.mark.parametrize("share", [0.5, 0.98])
def test_stability_falls_to_zero_at_eulers_load(share) -> None:
    model = RodModel(make_robot(cross_tendons()), tip_force=(0.0, 0.0, -share * EULER))
    shape = model.shape_under_tensions(np.zeros(4)).require()
    assert shape.stability == pytest.approx(1.0 - share, abs=2e-3)
    beyond = dataclasses.replace(model, tip_force=(0.0, 0.0, -EULER / share))
    shape = beyond.shape_under_tensions(np.zeros(4))
    assert not shape.converged and not shape.stable
    assert "unstable: the robot buckles at" in str(shape.reason)


@pytest.mark.parametrize(
    ("angles", "free"), [((0.0,), True), ((0.0, 0.5), True), ((0.0, 2 / 3, 4 / 3), False)]
)
def test_cables_without_tension_hold_only_what_lengthens_one(angles, free) -> None:
    # One or two on one side let the rod buckle towards them, as without; three around do not:
    # then its ends stay parallel, and it bears four times as much.
    robot = make_robot([Tendon(name=f"t{a}", offset=4.0, angle=math.pi * a) for a in angles])
    for share in (0.5, 2.0):
        model = RodModel(robot, tip_force=(0.0, 0.0, -share * EULER))
        shape = model.shape([0.0] * len(angles))
        limit = 1.0 if free else 4.0
        assert bool(shape.converged) == bool(shape.stable) == (share < limit), shape.reason
        if shape.converged:
            assert shape.stability == pytest.approx(1.0 - share / limit, abs=5e-3)


def test_a_buckled_rod_is_the_elastica() -> None:
    load = 2.0 * EULER
    robot = make_robot(cross_tendons(2))
    near = RodModel(robot, tip_force=(0.02, 0.0, -load)).shape_under_tensions([0.0, 0.0])
    model = RodModel(robot, tip_force=(0.0, 0.0, -load))
    shape = model.shape_under_tensions([0.0, 0.0], initial=near).require()
    k = brentq(lambda k: ellipk(k * k) - 0.5 * math.pi * math.sqrt(2.0), 0.1, 0.999, xtol=1e-14)
    rate = math.sqrt(load / BENDING)
    tip = [2.0 * k / rate, 0.0, (2.0 * ellipe(k * k) - ellipk(k * k)) / rate]
    assert shape.tip == pytest.approx(tip, abs=1e-6)
    assert shape.stability > 0.0


@pytest.mark.parametrize("across", [(1e-4, 0.0), (-1e-6, 0.0), (3e-3, -4e-3)])
@pytest.mark.parametrize("load", [1.2, 4.0])
def test_beyond_buckling_it_leans_with_the_force_across(load, across) -> None:
    force = np.array([*across, -load * EULER])
    model = RodModel(make_robot(cross_tendons(2)), tip_force=tuple(force))
    shape = model.shape_under_tensions([0.0, 0.0]).require()
    # The elastica by its angle from the force: sin(angle / 2) = k sin(phase).
    rate = math.sqrt(np.linalg.norm(force) / BENDING)
    tilt = math.atan2(math.hypot(*across), load * EULER)

    def start(k):
        return math.asin(min(1.0, math.sin(0.5 * tilt) / k))

    k = brentq(
        lambda k: ellipk(k * k) - ellipkinc(start(k), k * k) - rate * LENGTH,
        math.sin(0.5 * tilt),
        1.0 - 1e-12,
        xtol=1e-15,
    )
    along = 2.0 * (ellipe(k * k) - ellipeinc(start(k), k * k)) / rate - LENGTH
    aside = 2.0 * k * math.cos(start(k)) / rate
    axial = math.cos(tilt) * along + math.sin(tilt) * aside
    sideways = math.cos(tilt) * aside - math.sin(tilt) * along
    way = np.array(across) / math.hypot(*across)
    assert shape.tip == pytest.approx([*(sideways * way), axial], abs=1e-6)
    assert shape.stability > 0.0


def test_lengths_that_are_held_carry_more_than_eulers_load() -> None:
    robot = make_robot(cross_tendons(), stiffness=(200.0, 154.0))
    model = RodModel(robot, tip_force=(0.0, 0.0, -0.07), tendon_stiffness=1e4)
    shape = model.shape([3.0, 0.0, -3.0, 0.0]).require()
    assert shape.tip == pytest.approx([49.03, 0.0, 83.90], abs=0.02)
    assert shape.stability > 0.0


@pytest.mark.slow
def test_its_verdict_is_that_of_the_energy() -> None:
    rng = np.random.default_rng(0)
    both = 0
    for _ in range(40):
        robot = draw_robot(rng, 0.0)
        stiffness = min(section.bending_stiffness for section in robot.sections)
        force = rng.normal(size=3) * stiffness / robot.length**2 * rng.choice([0.3, 1.0, 3.0])
        pulls = rng.uniform(0.0, 0.2, len(robot.tendons)) * stiffness / robot.length
        rod = RodModel(robot, tip_force=tuple(force)).shape_under_tensions(pulls)
        energy = EnergyModel(robot, segment="channel", between=2, tip_force=tuple(force))
        other = energy.shape_under_tensions(pulls)
        if not (rod.converged and other.converged):
            continue
        both += 1
        assert np.linalg.norm(rod.tip - other.tip) < 0.01 * robot.length
        assert rod.stability == pytest.approx(float(other.stability), abs=0.02)
    assert both > 25


# Derivatives.


def difference(shapes, step):
    """Derivative of frames (k, 6) from two shapes either side."""
    one, other = shapes
    turns = one.frames[:, :3, :3] @ np.swapaxes(other.frames[:, :3, :3], 1, 2)
    turned = Rotation.from_matrix(turns).as_rotvec()
    return np.concatenate([turned, one.points - other.points], axis=1) / (2.0 * step)


@pytest.mark.parametrize("held", ["tensions", "displacements"])
@pytest.mark.parametrize("stretches", [False, True])
def test_derivatives_are_differences(held, stretches) -> None:
    robot = make_robot(PAIR, discs=4, **SOFT)
    model = RodModel(
        robot,
        tip_force=(0.05, 0.03, -0.05),
        loads=LOADS,
        stretches=stretches,
        tendon_stiffness=1e3,
        steps=100,
    )
    command = np.array([4.0, 6.0])

    def solve(model, change=0.0):
        solver = model.shape_under_tensions if held == "tensions" else model.shape
        return solver(command + change).require()

    shape = solve(model)
    found = model.jacobian(shape, held=held)
    step = 1e-3
    by_command = found.by_tension if held == "tensions" else found.by_displacement
    for k in range(2):
        change = step * np.eye(2)[k]
        wanted = difference((solve(model, change), solve(model, -change)), step)
        assert by_command[..., k] == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max() + 1e-6)
    for k in range(3):
        pair = [
            solve(dataclasses.replace(model, tip_force=tuple(model.tip_force + way)))
            for way in (step * np.eye(3)[k], -step * np.eye(3)[k])
        ]
        wanted = difference(pair, step)
        rows = found.by_tip_wrench[..., 3 + k]
        assert rows == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max() + 1e-6)
    for k, name in enumerate(("bending_stiffness", "torsional_stiffness")):
        pair = []
        for sign in (1.0, -1.0):
            section = robot.sections[0]
            value = getattr(section, name) * (1.0 + sign * step)
            changed = ContinuumRobot((dataclasses.replace(section, **{name: value}),))
            pair.append(solve(dataclasses.replace(model, robot=changed)))
        wanted = difference(pair, step)
        rows = found.by_stiffness[..., 0, k]
        assert rows == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max() + 1e-6)


def test_compliance_is_symmetric_where_loads_have_a_potential() -> None:
    model = RodModel(make_robot(PAIR), tip_force=(0.05, 0.03, -0.05), tendon_stiffness=1e4)
    for held in ("tensions", "displacements"):
        tip = model.jacobian(model.shape([2.0, 1.5]).require(), held=held).by_tip_wrench[-1]
        assert tip == pytest.approx(tip.T, abs=1e-5 * np.abs(tip).max())


# Refusals.


def test_what_the_rod_does_not_take_is_refused() -> None:
    rubbed = make_robot([Tendon(name="a", offset=4.0, friction=0.1)])
    with pytest.raises(InputError, match="stretches is true, and tendons have friction"):
        RodModel(rubbed, stretches=True)
    with pytest.raises(InputError, match="no section has a finite stretch_stiffness"):
        RodModel(make_robot(cross_tendons(2)), stretches=True)
    with pytest.raises(InputError, match="derivatives depend on the direction"):
        model = RodModel(rubbed)
        model.jacobian(model.shape_under_tensions([1.0]))
    model = RodModel(make_robot(cross_tendons(2)))
    with pytest.raises(GeometryError, match="would have to stretch"):
        model.jacobian(model.shape([3.0, 1.0]))
    tense = make_robot([Tendon(name="a", offset=4.0, pretension=1.0)])
    with pytest.raises(InputError, match="'a' has a pretension, and does not stretch"):
        RodModel(tense).shape([1.0])
