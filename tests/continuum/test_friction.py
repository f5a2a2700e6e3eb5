"""Tendons with friction: the capstan law along any routing, its history, and its loops."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.continuum import (
    ArcModel,
    ContinuumRobot,
    EnergyModel,
    RodModel,
    Section,
    Shape,
    Tendon,
)
from bozzini.errors import InputError
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from tests.continuum.rods import (
    BENDING,
    LENGTH,
    TORSION,
    cross_matrix,
    cross_tendons,
    draw_robot,
    helix,
    make_robot,
    place_tendon,
    taper,
)

MU = 0.2
OFFSET = 4.0
PULL = 3.0
CROSSING = Tendon(
    name="x",
    path=[(s, 3.0 * math.cos(math.pi * s / 60.0), 1.0) for s in np.linspace(0.0, LENGTH, 41)],
    interpolation="cubic",
)


def rub(tendons, friction=MU, **fields) -> ContinuumRobot:
    tendons = [dataclasses.replace(tendon, friction=friction) for tendon in np.atleast_1d(tendons)]
    return make_robot(tendons, **fields)


def rub_sections(lists) -> ContinuumRobot:
    return make_robot(
        [[dataclasses.replace(tendon, friction=MU) for tendon in part] for part in lists],
        sections=len(lists),
    )


def straight(friction=MU) -> ContinuumRobot:
    return rub(Tendon(name="a", offset=OFFSET), friction)


def pull_in(arc_length, tension, friction=MU):
    """Tension of one straight tendon that is pulled, from ``T' = - mu T kappa, EI kappa = T r``."""
    return tension / (1.0 + friction * tension * OFFSET * arc_length / BENDING)


def turn_of_tip(shape: Shape):
    return np.arctan2(shape.tip_frame[..., 0, 2], shape.tip_frame[..., 2, 2])


# One straight tendon: closed forms.


def test_the_end_has_the_capstan_s_tension() -> None:
    shape = RodModel(straight()).shape_under_tensions([PULL]).require()
    assert shape.tensions == pytest.approx([PULL])
    wanted = PULL * np.exp(-MU * turn_of_tip(shape))
    assert shape.end_tensions == pytest.approx([wanted], rel=1e-6)
    along = pull_in(shape.arc_length, PULL)
    assert shape.tendon_tensions[0] == pytest.approx(along, rel=1e-6)
    total = math.log1p(MU * PULL * OFFSET * LENGTH / BENDING) / MU
    assert turn_of_tip(shape) == pytest.approx(total, rel=1e-6)


def test_constant_curvature_is_the_capstan() -> None:
    # A stiff backbone that is curved at rest: what tendons do to it does not matter.
    turn = 1.2
    robot = rub(
        Tendon(name="a", offset=OFFSET), stiffness=(1e8, 1e8), curvature=(0.0, turn / LENGTH, 0.0)
    )
    model = RodModel(robot, tendon_stiffness=1e3, between=3)
    pulled = model.shape_under_tensions([PULL]).require()
    along = PULL * np.exp(-MU * turn * pulled.arc_length / LENGTH)
    assert pulled.tendon_tensions[0] == pytest.approx(along, rel=1e-5)
    low = 0.5 * PULL * math.exp(-2.0 * MU * turn)
    released = model.shape_under_tensions([low], initial=pulled).require()
    along = low * np.exp(MU * turn * pulled.arc_length / LENGTH)
    # Near its end it has hardly slid back.
    assert released.tendon_tensions[0] == pytest.approx(along, rel=1e-3)


def test_angles_are_of_second_order() -> None:
    errors = []
    for steps in (20, 40, 80):
        shape = RodModel(straight(1.0), steps=steps).shape_under_tensions([PULL])
        errors.append(abs(shape.end_tensions[0] - pull_in(LENGTH, PULL, 1.0)))
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([2.0, 2.0], abs=0.1)


@pytest.mark.parametrize("released", [2.6, 1.2, 0.3])
def test_a_release_travels_from_the_base(released) -> None:
    model = RodModel(straight(), between=3)
    pulled = model.shape_under_tensions([PULL])
    shape = model.shape_under_tensions([released], initial=pulled).require()
    front = 0.5 * BENDING / (MU * OFFSET) * (1.0 / released - 1.0 / PULL)
    places = shape.arc_length
    slid = released / (1.0 - MU * released * OFFSET * places / BENDING)
    wanted = np.where(places < front, slid, pull_in(places, PULL))
    off = np.abs(shape.tendon_tensions[0] / wanted - 1.0)
    # The slip that it takes to reverse the friction rounds the front off.
    assert off[np.abs(places - front) > 6.0].max() < 1e-5
    assert off.max() < 5e-3
    # What the front has not reached is as it was.
    stuck = np.flatnonzero(places > front + 6.0)
    if stuck.size:
        ours, theirs = (one.frames[..., stuck, :, :] for one in (shape, pulled))
        turned = [np.linalg.inv(f[0]) @ f for f in (ours, theirs)]
        assert turned[0] == pytest.approx(turned[1], abs=1e-5)


# Any routing: the angle through which a tendon turns, measured on its points.


@pytest.mark.parametrize(
    "tendons",
    [[taper("a")], [helix("a", 1.0)], [CROSSING], [helix("a", 0.5), taper("b", 2.0)]],
    ids=["converging", "helix", "path across the backbone", "two"],
)
def test_a_pull_is_the_capstan_law_along_any_routing(tendons) -> None:
    model = RodModel(rub(tendons), between=9)
    shape = model.shape_under_tensions([PULL] * len(tendons)).require()
    for points, along in zip(shape.tendon_points, shape.tendon_tensions, strict=True):
        ways = np.diff(points, axis=0)
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        turns = np.linalg.norm(np.cross(ways[1:], ways[:-1]), axis=1)
        # Each chord points as the tendon does at its middle.
        whole = np.sum(np.arcsin(turns)) + 0.5 * (turns[0] + turns[-1])
        assert np.log(along[-1] / along[0]) == pytest.approx(-MU * whole, rel=2e-3)
        assert np.all(np.diff(along) <= 0.0)


def test_a_tendon_that_is_drawn_in_has_more_tension_at_its_end() -> None:
    robot = rub(cross_tendons(4))
    shape = RodModel(robot).shape_under_tensions([2.0, 0.5, 0.5, 0.5]).require()
    turn = turn_of_tip(shape)
    factors = shape.end_tensions / shape.tensions
    assert factors[[0, 2]] == pytest.approx([math.exp(-MU * turn), math.exp(MU * turn)], rel=1e-6)
    assert factors[[1, 3]] == pytest.approx([1.0, 1.0], abs=1e-4)


def turn_by(vector):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = max(float(np.linalg.norm(vector)), 1e-12)
    hat = cross_matrix(vector / angle)
    return np.eye(3) + math.sin(angle) * hat + (1.0 - math.cos(angle)) * hat @ hat


def march(robot, pulls, force, moment, steps=100):
    """Tip and end moment of a rod whose tendons all slide to the base: midpoint steps."""
    stiff, axis = np.array([BENDING, BENDING, TORSION]), np.array([0.0, 0.0, 1.0])
    h = LENGTH / steps
    place, turn, u = np.zeros(3), np.eye(3), np.zeros(3)
    tensions, ways = np.array(pulls), None
    for step in range(steps):
        routes = [place_tendon(tendon, (step + 0.5) * h)[:2] for tendon in robot.tendons]
        arms = np.array([r for r, _ in routes])
        for _ in range(60):
            half = turn @ turn_by(0.5 * h * u)
            over = half.T @ (moment - 0.5 * h * np.cross(half[:, 2], force))
            rows = np.array([axis + np.cross(u, r) + slope for r, slope in routes])
            rows /= np.linalg.norm(rows, axis=1)[:, None]
            along = rows @ half.T
            angles = 0.5 * h * np.linalg.norm(u)  # before the first one it turns as the rod does
            if ways is not None:
                angles = np.arcsin(np.linalg.norm(np.cross(ways, along), axis=1))
            now = tensions * np.exp(-MU * angles)
            u, before = (over - now @ np.cross(arms, rows)) / stiff, u
            if np.abs(u - before).max() < 1e-11:
                break
        ways, tensions = along, now
        place = place + h * half[:, 2]
        moment = moment - h * np.cross(half[:, 2], force)
        turn = turn @ turn_by(h * u)
    return place, moment


@pytest.mark.parametrize("force", [(0.0, 0.0, 0.0), (0.03, 0.02, -0.05)])
def test_another_integrator_meets_the_end(force) -> None:
    robot = rub([taper("a"), taper("b", 1.2)])
    shape = RodModel(robot, tip_force=force).shape_under_tensions([3.0, 2.0]).require()
    assert np.all(shape.end_tensions < shape.tensions)
    tip, end = march(robot, [3.0, 2.0], np.array(force), np.cross(shape.tip, force))
    assert tip == pytest.approx(shape.tip, abs=2e-3)
    assert end == pytest.approx(np.zeros(3), abs=2e-3)


# Histories.


@pytest.fixture(scope="module")
def loops():
    cycle = np.concatenate([np.linspace(0.0, PULL, 4), np.linspace(PULL, 0.5, 4)[1:]])
    history = np.concatenate([cycle, np.linspace(0.5, PULL, 4)[1:], np.linspace(PULL, 0.5, 4)[1:]])
    return {
        friction: RodModel(straight(friction)).trace_tensions(history[:, None])
        for friction in (0.0, 0.1, 0.2)
    }


def test_loops_close_after_the_first_cycle_and_grow_with_friction(loops) -> None:
    areas = []
    for friction, history in loops.items():
        assert history.converged, history.reason
        shapes = history.shapes
        assert shapes.points[6] == pytest.approx(shapes.points[12], abs=1e-8)
        assert shapes.points[3] == pytest.approx(shapes.points[9], abs=1e-8)
        areas.append(history.work[12] - history.work[6])
        # Pulled and released, the same tension is another shape.
        apart = np.linalg.norm(shapes.tip[7] - shapes.tip[5])
        assert (apart > 0.5) == (friction > 0.0)
    assert areas[0] == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < 1.5 * areas[1] < areas[2]


def test_only_the_order_counts(loops) -> None:
    few = RodModel(straight(0.2)).trace_tensions([[PULL], [0.5], [PULL], [0.5]])
    assert few.shapes.points == pytest.approx(loops[0.2].shapes.points[3::3], abs=1e-8)
    again = RodModel(straight(0.2)).shape_under_tensions(
        [0.5], initial=RodModel(straight(0.2)).shape_under_tensions([PULL])
    )
    assert again.points == pytest.approx(few.shapes.points[1], abs=1e-8)


def test_tension_falls_the_way_a_tendon_slides() -> None:
    # Distal tendons pass the first section, which other tendons bend the other way.
    tendons = [cross_tendons(3), cross_tendons(3, angle=0.5, prefix="d")]
    way = np.random.default_rng(7).uniform(0.2, 2.0, (6, 6))
    found = RodModel(rub_sections(tendons), steps=80).trace_tensions(way)
    assert found.converged, found.reason
    state = found.shapes.friction
    lengths, tensions = (a.reshape(6, -1, 6) for a in (state.lengths, state.tensions))
    slid = (lengths[:-1] - lengths[1:])[:, 1:]
    fall = -np.diff(tensions[1:], axis=1)
    for sign in (1.0, -1.0):
        here = sign * slid > 1e-3
        assert here.mean() > 0.1
        assert np.all(sign * fall[here] >= -1e-12)
    # A tendon is often held in parts, with one sign here and the other there.
    signs = [{float(s) for s in np.sign(column[np.abs(column) > 1e-3])} for column in
             np.moveaxis(slid, 1, 2).reshape(-1, slid.shape[1])]  # fmt: skip
    assert {-1.0, 1.0} in signs


def walk_fronts(history, friction, cells=800):
    """Tip of a planar robot with one tendon, in cells of constant curvature and tension.

    From the base on: a cell keeps its tension within what friction bears, else the tendon slides.
    """
    h, tensions, tips = LENGTH / cells, np.zeros(cells), []
    for pull in history:
        before = pull
        for cell in range(cells):
            # The capstan law from the cell before to this one, ``(1/T)' = +-mu r / EI``.
            wide = friction * OFFSET * h / BENDING * (0.5 if cell == 0 else 1.0)
            low, high = before / (1.0 + wide * before), before / (1.0 - wide * before)
            before = tensions[cell] = min(max(tensions[cell], low), high)
        turns = np.cumsum(tensions) * OFFSET * h / BENDING
        angles = turns - 0.5 * tensions * OFFSET * h / BENDING
        tips.append([h * np.sin(angles).sum(), 0.0, h * np.cos(angles).sum()])
    return np.array(tips)


@given(
    history=st.lists(st.floats(0.1, 3.0), min_size=2, max_size=5),
    steps=st.sampled_from([10, 40]),
    parts=st.integers(1, 5),
)
@example(history=[1.0, 0.2, 3.0, 2.0], steps=10, parts=5)
@settings(max_examples=5, deadline=None)
def test_any_loop_is_that_of_slip_fronts(history, steps, parts) -> None:
    ends = np.concatenate([[0.0], history])
    way = np.interp(np.arange(1, parts * len(history) + 1) / parts, np.arange(len(ends)), ends)
    found = RodModel(straight(0.25), steps=steps).trace_tensions(way[:, None])
    assert found.converged, found.reason
    assert found.shapes.tip[parts - 1 :: parts] == pytest.approx(
        walk_fronts(history, 0.25), abs=0.02
    )


@pytest.mark.parametrize("stiffness", [math.inf, 1e4])
def test_antagonists_settle(stiffness) -> None:
    pair = [Tendon(name=name, offset=OFFSET, angle=k * math.pi) for k, name in enumerate("ab")]
    options = {} if math.isinf(stiffness) else {"tendon_stiffness": stiffness}
    model = RodModel(rub(pair), steps=50, **options)
    for shift in (0.5, 4.0):
        shape = model.shape([shift, -shift]).require()
        alone = RodModel(straight(), steps=50, **options).shape([shift]).require()
        assert shape.tip == pytest.approx(alone.tip, abs=1e-6)
        assert shape.tensions == pytest.approx([alone.tensions[0], 0.0], abs=1e-6)
        assert shape.iterations < 100


@pytest.mark.parametrize("tendon", [taper("a"), helix("a", 1.0), CROSSING], ids=lambda t: t.name)
def test_loops_close_along_any_routing(tendon) -> None:
    way = np.array([PULL, 0.5, PULL, 1.75, 0.5])[:, None]
    shapes = RodModel(rub(tendon), steps=100).trace_tensions(way).shapes.require()
    assert shapes.points[2] == pytest.approx(shapes.points[0], abs=1e-8)
    assert shapes.points[4] == pytest.approx(shapes.points[1], abs=1e-8)
    assert np.all(shapes.end_tensions[[1, 4]] > shapes.tensions[[1, 4]])


def test_work_is_elastic_energy_and_friction() -> None:
    model = RodModel(rub([helix("a", 0.5), taper("b", 2.0)]), between=4, steps=100)
    way = np.concatenate([np.linspace(0.0, PULL, 21), np.linspace(PULL, 1.0, 16)[1:]])
    found = model.trace_tensions(way[:, None] * [1.0, 0.5])
    assert found.converged
    frames = found.shapes.frames[-1, :, :3, :3]
    turns = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]).as_rotvec()
    stiff = np.array([BENDING, BENDING, TORSION])
    energy = 0.5 * np.sum(stiff * turns**2 / np.diff(found.shapes.arc_length)[:, None])
    state = found.shapes.friction
    tensions, lengths = (a.reshape(len(way), -1, 2) for a in (state.tensions, state.lengths))
    slid = -np.diff(lengths, axis=0)[:, 1:]
    lost = -0.5 * (np.diff(tensions, axis=1)[1:] + np.diff(tensions, axis=1)[:-1])
    heat = np.sum(lost * slid)
    assert heat > 0.05 * energy
    assert found.work[-1] == pytest.approx(energy + heat, rel=5e-3)


def test_displacements_and_tensions_are_one_history() -> None:
    model = RodModel(rub([helix("a", 0.5), taper("b", 2.0)]))
    given = model.trace_tensions([[3.0, 1.0], [1.5, 1.0], [2.0, 0.4]])
    found = model.trace_displacements(given.shapes.displacements)
    assert found.converged, found.reason
    assert found.shapes.tensions == pytest.approx(given.shapes.tensions, rel=1e-7)
    assert found.shapes.points == pytest.approx(given.shapes.points, abs=1e-6)


def test_a_loaded_rod_with_stretching_tendons_takes_both() -> None:
    robot = rub(cross_tendons(3))
    model = RodModel(robot, tip_force=(0.02, -0.03, -0.05), tendon_stiffness=1e4)
    pulls = np.array([2.0, 0.3, 0.5])
    given = model.shape_under_tensions(pulls).require()
    stretches = trapezoid(given.tendon_tensions, given.arc_length) / model.tendon_stiffness
    shortened = model.natural_lengths - given.tendon_lengths
    assert given.displacements == pytest.approx(shortened + stretches, abs=1e-5)
    found = model.shape(given.displacements).require()
    assert found.tensions == pytest.approx(pulls, rel=1e-2)
    assert found.tip == pytest.approx(given.tip, abs=1e-3)


@pytest.mark.parametrize("force", [0.0, 0.02])
def test_a_tendon_that_follows_is_one_let_out(force) -> None:
    pair = [Tendon(name=name, offset=OFFSET, angle=k * math.pi) for k, name in enumerate("ab")]
    model = RodModel(rub(pair), tip_force=(0.0, force, 0.0), tendon_stiffness=1e4)
    follows, let_out = (model.shape([3.0, other]).require() for other in (math.nan, -20.0))
    assert follows.points == pytest.approx(let_out.points, abs=1e-6)
    assert follows.tensions == pytest.approx(let_out.tensions, abs=1e-6)
    assert follows.displacements[1] == pytest.approx(-3.0, abs=0.05)


def test_without_friction_nothing_changes() -> None:
    tendons = [helix("a", 0.5), taper("b", 2.0)]
    plain, none = RodModel(make_robot(tendons)), RodModel(rub(tendons, 0.0))
    pulls = [3.0, 1.0]
    one = plain.shape_under_tensions(pulls)
    assert np.array_equal(one.points, none.shape_under_tensions(pulls, initial=one).points)
    assert one.friction is None
    assert one.tendon_tensions == pytest.approx(np.repeat(np.reshape(pulls, (2, 1)), 21, axis=1))
    little = RodModel(rub(tendons, 1e-9)).shape_under_tensions(pulls)
    assert little.points == pytest.approx(one.points, abs=1e-5)


def test_operators_of_hysteresis_lag_displacements_instead() -> None:
    lag = PrandtlIshlinskii(thresholds=(0.0, 0.4), weights=(0.8, 0.2))
    acting = lag.apply(np.array([0.0, 3.0, 1.0, 3.0, 1.0]))
    model = ArcModel(make_robot(cross_tendons(2)))
    tips = model.shape(np.stack([acting, -acting], axis=1)).require().tip
    assert tips[2] == pytest.approx(tips[4])
    lower = model.shape([1.0, -1.0]).tip
    assert np.linalg.norm(tips[2] - lower) > 0.5


def test_a_pose_after_a_history_is_the_library_s(tmp_path, capsys) -> None:
    robot = rub(cross_tendons(2))
    path = ContinuumRobot(robot.sections).to_yaml(tmp_path / "robot.yaml")
    command = ["continuum", "pose", str(path), "--displacement", "t0=2mm,t1=-2mm", "--json"]
    assert main(command) == 0
    first = json.loads(capsys.readouterr().out)
    assert main([*command, "--history", "t0=5mm,t1=-5mm"]) == 0
    after = json.loads(capsys.readouterr().out)
    model = RodModel(robot)
    before = model.shape([5.0, -5.0])
    for found, shape in (
        (first, model.shape([2.0, -2.0])),
        (after, model.shape([2.0, -2.0], initial=before)),
    ):
        assert found["model"] == "rod"
        assert found["tip_mm"] == pytest.approx(shape.tip, abs=1e-6)
        assert found["tendons"]["t0"]["end_tension_N"] == pytest.approx(shape.end_tensions[0])
    assert np.linalg.norm(np.subtract(first["tip_mm"], after["tip_mm"])) > 0.5
    assert main([*command, "--history", "t0=5mm,t1=-5mm", "--model", "energy"]) == 2
    error = capsys.readouterr().err
    assert "--history has no effect on the energy model" in error and error.count("\n") == 1
    assert main([*command, "--history", "t0=60mm,t1=-60mm"]) == 1
    assert "of --history command 0" in json.loads(capsys.readouterr().out)["reason"]


# What is around it.


def test_a_batch_is_its_commands_one_by_one() -> None:
    model = RodModel(straight())
    first = model.shape_under_tensions([[3.0], [2.0]])
    both = model.shape_under_tensions([[1.8], [1.8]], initial=first)
    alone = model.shape_under_tensions([[1.8]], initial=model.shape_under_tensions([2.0]))
    assert both.points[1] == pytest.approx(alone.points[0], abs=1e-12)
    assert both.tendon_tensions.shape == (2, 1, 21)
    assert np.abs(both.tip[0] - both.tip[1]).max() > 0.1


def test_files_and_models_know_friction(tmp_path) -> None:
    robot = ContinuumRobot(straight().sections)
    assert robot.to_dict()["sections"][0]["tendons"][0]["friction"] == MU
    assert ContinuumRobot.from_yaml(robot.to_yaml(tmp_path / "robot.yaml")) == robot
    assert robot.choose_model({}) == "rod"
    assert not RodModel(robot).notes
    for model in (ArcModel(robot), EnergyModel(robot)):
        assert "leaves out the friction of tendons" in model.notes[0]
    frictionless = ContinuumRobot(straight(0.0).sections)
    assert "friction" not in frictionless.to_dict()["sections"][0]["tendons"][0]
    assert frictionless.choose_model({}) == "arc"


def test_histories_are_tables_and_pictures(loops) -> None:
    history = loops[0.2]
    frame = history.to_frame()
    assert len(frame) == 13
    assert frame["a_N"].max() == PULL
    assert (frame["a_end_N"] <= frame["a_N"] * 2.0).all()
    assert history.to_dict()["converged"] is True
    axes = history.plot()
    assert len(axes.lines) == 1
    assert axes.get_xlabel() == "tension [N]"


@pytest.mark.parametrize("friction", [-0.1, math.nan, 11.0, "x"])
def test_what_is_no_coefficient_is_refused(friction) -> None:
    with pytest.raises(InputError) as caught:
        Tendon(name="a", offset=1.0, friction=friction)
    assert "tendon 'a' friction" in str(caught.value) and "\n" not in str(caught.value)


def test_an_initial_that_does_not_fit_is_refused() -> None:
    model = RodModel(straight())
    shape = model.shape_under_tensions([1.0])
    for initial, words in (
        (3.0, "initial is of type float"),
        (ArcModel(straight()).shape([0.5]), "initial is a shape of the arc model"),
        (RodModel(straight(), steps=50).shape_under_tensions([1.0]), "steps included"),
        (model.shape_under_tensions([[1.0], [2.0]]), "it must be one shape, or one for each"),
    ):
        with pytest.raises(InputError, match=words):
            model.shape_under_tensions([1.0], initial=initial)
    with pytest.raises(InputError, match=r"history has shape \(1,\): it must be \(n, 1\)"):
        model.trace_tensions([1.0], initial=shape)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_robots_have_shapes_or_pass_a_limit(seed) -> None:
    rng = np.random.default_rng(seed)
    robot = draw_robot(rng, 0.0)
    sections = tuple(
        dataclasses.replace(
            section, tendons=tuple(dataclasses.replace(t, friction=0.1) for t in section.tendons)
        )
        for section in robot.sections
    )
    way = rng.uniform(0.1, 2.0, (5, len(robot.tendons)))
    shapes = RodModel(ContinuumRobot(sections), steps=100).trace_tensions(way).shapes
    assert all("would bend" in reason for reason in shapes.reason[~shapes.converged])


def test_contradictions_are_refused() -> None:
    shape = RodModel(rub(cross_tendons(2))).shape([3.0, 1.0])
    assert not shape.converged
    assert "would have to stretch" in str(shape.reason)
    assert "'t0'" in str(shape.reason) and "'t1'" in str(shape.reason)


def test_sections_of_two_stiffnesses() -> None:
    sections = tuple(
        Section(length=50.0, radius=5.0, bending_stiffness=stiffness, tendons=tendons)
        for stiffness, tendons in ((2000.0, ()), (400.0, (straight().sections[0].tendons[0],)))
    )
    shape = RodModel(ContinuumRobot(sections)).shape_under_tensions([PULL]).require()
    wanted = PULL * math.exp(-MU * float(turn_of_tip(shape)))
    assert shape.end_tensions == pytest.approx([wanted], rel=1e-6)


@pytest.mark.parametrize("share", [0.9, 1.5, 4.0])
def test_friction_does_not_hold_a_straight_rod_beyond_eulers_load(share) -> None:
    # A straight tendon presses on no channel, so nothing sticks.
    euler = math.pi**2 * BENDING / (4.0 * LENGTH**2)
    model = RodModel(
        make_robot(cross_tendons(2, friction=0.1)), tip_force=(0.0, 0.0, -share * euler)
    )
    shape = model.shape_under_tensions([0.2, 0.2])
    assert bool(shape.converged) == bool(shape.stable) == (share < 1.0)
    assert str(shape.reason).startswith("unstable" if share > 1.0 else "")
