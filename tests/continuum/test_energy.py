from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from bozzini.continuum import ContinuumRobot, Section, Shape, Tendon
from bozzini.continuum.coupling import Coupling
from bozzini.continuum.energy import SEGMENTS, EnergyModel
from bozzini.continuum.kernels import energy as kernels
from bozzini.continuum.kernels.energy import ARC, CHANNEL, CHORD, solve_bounded
from bozzini.continuum.rod import RodModel
from bozzini.errors import GeometryError
from tests.continuum.rods import (
    LENGTH,
    ROUTINGS,
    chain_linkage,
    cross_tendons,
    draw_command,
    draw_robot,
    helix,
    make_robot,
    taper,
)

TIP_ERRORS = {
    "parallel pair": 0.01,
    "taper": 0.003,
    "taper pair": 0.10,
    "quarter-turn pair": 0.07,
    "full-turn helix": 0.175,
    "full-turn pair": 0.15,
    "straight and full turn": 0.09,
}
"""Largest error of the tip against the rod with 40 segments [mm]."""


@pytest.fixture(scope="module", params=list(ROUTINGS))
def routed(request):
    """A routing's name and tendons, and the rod's shape under its tensions."""
    tendons, tensions = ROUTINGS[request.param]
    return request.param, tendons, RodModel(make_robot(tendons)).shape_under_tensions(tensions)


@pytest.mark.parametrize("segment", ["chord", "channel"])
def test_tip_and_tensions_are_those_of_the_rod(routed, segment) -> None:
    name, tendons, rod = routed
    coarse = EnergyModel(make_robot(tendons, discs=40), segment=segment).shape(rod.displacements)
    assert coarse.converged
    limit = TIP_ERRORS[name] if segment == "chord" else max(TIP_ERRORS[name], 0.004)
    assert np.linalg.norm(coarse.tip - rod.tip) < limit
    fine = EnergyModel(make_robot(tendons, discs=40), between=1, segment=segment)
    assert fine.shape(rod.displacements).tensions == pytest.approx(rod.tensions, rel=5e-3)


def test_channels_give_tensions_to_two_in_a_thousand(routed) -> None:
    _, tendons, rod = routed
    model = EnergyModel(make_robot(tendons, discs=40), segment="channel")
    assert model.shape(rod.displacements).tensions == pytest.approx(rod.tensions, rel=2e-3)


@pytest.mark.parametrize("segment", list(SEGMENTS))
def test_converges_to_the_rod_with_second_order(routed, segment) -> None:
    name, tendons, rod = routed
    errors = []
    for count in (20, 40, 80):
        model = EnergyModel(make_robot(tendons, discs=count), segment=segment)
        errors.append(np.linalg.norm(model.shape(rod.displacements).tip - rod.tip))
    if segment == "channel" and name == "parallel pair":
        assert max(errors) < 1e-6  # exact
        return
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)


@pytest.mark.parametrize("shortening", [(4.0, 4.0), (5.0, 2.0), (-3.0, 4.0), (8.0, 6.0)])
@pytest.mark.parametrize("count", [5, 20])
def test_chords_with_parallel_tendons_are_the_linkage(shortening, count) -> None:
    commands = [*shortening, -shortening[0], -shortening[1]]
    shape = EnergyModel(make_robot(cross_tendons(), discs=count)).shape(commands)
    assert shape.tip == pytest.approx(chain_linkage(shortening, count), abs=1e-7)
    assert not shape.slack.any()


@given(
    st.lists(st.floats(-1.5, 1.5), min_size=4, max_size=4),
    st.integers(1, 7),
    st.floats(0.0, 6.0),
)
def test_channels_with_parallel_tendons_are_constant_curvature(bends, discs, angle) -> None:
    tendons = [cross_tendons(3), cross_tendons(4, angle=angle, prefix="d")]
    robot = make_robot(tendons, discs=discs, sections=2)
    commands = Coupling(robot).matrix @ bends
    shape = EnergyModel(robot, segment="channel").shape(commands)
    assert shape.converged, shape.reason
    assert shape.section_parameters.ravel() == pytest.approx(bends, abs=1e-6)
    place, frame = np.zeros(3), np.eye(3)
    for x, y in np.reshape(bends, (2, 2)):
        turn = Rotation.from_rotvec([-y, x, 0.0])
        nodes, weights = np.polynomial.legendre.leggauss(12)
        parts = Rotation.from_rotvec(0.5 * (1.0 + nodes)[:, None] * turn.as_rotvec())
        place = place + frame @ (0.25 * LENGTH * weights @ parts.as_matrix()[..., 2])
        frame = frame @ turn.as_matrix()
    assert shape.tip == pytest.approx(place, abs=1e-5)
    assert shape.tip_frame[:3, :3] == pytest.approx(frame, abs=1e-6)


@pytest.mark.parametrize("segment", list(SEGMENTS))
def test_energy_is_least_by_another_solver(segment) -> None:
    tendons = (helix("a", 0.4), taper("b", 2.0), helix("c", -0.3, 4.0, 3.0))
    robot = make_robot(tendons, discs=3)
    commands = np.array([6.0, -1.0, -8.0])
    shape = EnergyModel(robot, segment=segment).shape(commands)
    stiff = np.array([1000.0, 1000.0, 770.0]) * 3.0 / LENGTH
    stations = np.linspace(0.0, LENGTH, 4)
    nodes, weights = np.polynomial.legendre.leggauss(3)

    def measure(turns):
        lengths = np.zeros(3)
        for j, w in enumerate(turns.reshape(3, 3)):
            h = LENGTH / 3.0
            turn = Rotation.from_rotvec(w).as_matrix()
            angle = np.linalg.norm(w)
            axis = w / angle if angle > 0.0 else w
            along = axis[2] * axis
            if segment == "chord":
                step = h * Rotation.from_rotvec(0.5 * w).as_matrix()[:, 2]
            else:
                ratio = np.sinc(angle / math.pi)
                half = 0.5 * angle * np.sinc(0.5 * angle / math.pi) ** 2
                across = np.cross(axis, [0.0, 0.0, 1.0])
                step = h * (ratio * (np.array([0, 0, 1.0]) - along) + along + half * across)
            for k, tendon in enumerate(tendons):
                if segment == "channel":
                    places = stations[j] + 0.5 * h * (1.0 + nodes)
                    r = np.column_stack([tendon.place_at(places), np.zeros(3)])
                    slope = np.column_stack([tendon.slope_at(places), np.ones(3)])
                    rate = np.linalg.norm(np.cross(w / h, r) + slope, axis=1)
                    lengths[k] += 0.5 * h * weights @ rate
                else:
                    one, two = (np.append(tendon.place_at(s), 0.0) for s in stations[j : j + 2])
                    lengths[k] += np.linalg.norm(step + turn @ two - one)
        return lengths

    limits = measure(np.zeros(9)) - commands
    found = minimize(
        lambda turns: 0.5 * np.sum(stiff * turns.reshape(3, 3) ** 2) / 100.0,
        np.full(9, 0.01),
        constraints={"type": "ineq", "fun": lambda turns: limits - measure(turns)},
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert found.success
    axes = shape.frames[:, :3, :3]
    turns = Rotation.from_matrix(np.swapaxes(axes[:-1], 1, 2) @ axes[1:]).as_rotvec()
    assert turns.ravel() == pytest.approx(found.x, abs=2e-5)
    assert shape.slack.tolist() == (limits - measure(found.x) > 1e-4).tolist()
    assert shape.slack.any() and not shape.slack.all()


@pytest.mark.parametrize("size", [0.0, 1e-5, 0.3, 2.0])
@pytest.mark.parametrize("segment", [CHORD, ARC, CHANNEL])
def test_derivatives_of_lengths_are_those_of_differences(size, segment) -> None:
    rng = np.random.default_rng(3)
    segments, tendons = 4, 3
    turns = size * rng.normal(size=(segments, 3))
    spans, counts = rng.uniform(3.0, 8.0, segments), np.array([4, 3, 2])
    paths = 3.0 * rng.normal(size=(tendons, segments + 1, 2))
    guides = rng.normal(size=(tendons, segments, 3, 4))
    tensions = np.array([1.0, 2.0, -0.5])

    def measure(turns):
        lengths, slopes = np.empty(tendons), np.empty((tendons, segments, 3))
        positive, whole = np.empty((2, segments, 3, 3))
        grid = (spans, np.ones((segments, 3)), paths, guides, counts, segment)
        kernels.measure_lengths(grid, turns, tensions, lengths, slopes, positive, whole)
        return lengths, slopes, whole

    _, slopes, whole = measure(turns)
    step = 1e-5
    for j in range(segments):
        for i in range(3):
            change = np.zeros_like(turns)
            change[j, i] = step
            (up, up_slopes, _), (down, down_slopes, _) = (
                measure(turns + change),
                measure(turns - change),
            )
            assert slopes[:, j, i] == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-7)
            rate = np.tensordot(tensions, up_slopes - down_slopes, 1)[j] / (2 * step)
            assert whole[j, :, i] == pytest.approx(rate, rel=1e-6, abs=1e-6)


@given(st.integers(1, 7), st.integers(1, 7), st.integers(0, 2**31), st.booleans())
def test_tensions_meet_their_conditions(count, rank, seed, push) -> None:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(count, rank))
    matrix, vector = half @ half.T + 1e-6 * np.eye(count), rng.normal(size=count)
    low, high = np.full(count, -3.0 if push else 0.0), np.full(count, 5.0)
    tensions = rng.uniform(-1.0, 1.0, count)
    assert solve_bounded(matrix, vector, low, high, tensions)
    slope = matrix @ tensions + vector
    assert np.all((tensions >= low) & (tensions <= high))
    assert np.all(slope[tensions < high] > -1e-6) and np.all(slope[tensions > low] < 1e-6)


def check_sound(model: EnergyModel, shape: Shape) -> None:
    """What holds of every shape: rigid frames, no pushing cable, none too long, no loose pull."""
    frames = shape.frames[..., :3, :3]
    assert np.swapaxes(frames, -1, -2) @ frames == pytest.approx(
        np.broadcast_to(np.eye(3), frames.shape), abs=1e-9
    )
    gaps = model.natural_lengths - shape.displacements - shape.tendon_lengths
    assert np.all(shape.tensions >= 0.0)
    assert np.all(gaps > -1.1 * model.tolerance)
    assert np.all(shape.tensions[shape.slack] == 0.0)
    assert np.all(shape.slack == (gaps > model.tolerance))


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 6.2), st.floats(-1.0, 1.0), st.floats(1.0, 6.0), st.floats(1.0, 6.0)
        ),
        min_size=1,
        max_size=5,
    ),
    st.integers(1, 12),
    st.floats(0.3, 1.2),
    st.lists(st.floats(-6.0, 6.0), min_size=5, max_size=5),
    st.sampled_from(list(SEGMENTS)),
)
def test_any_command_has_a_sound_shape_or_a_reason(routes, discs, twist, pulls, segment) -> None:
    tendons = [
        Tendon(
            name=f"t{index}",
            offset=((0.0, near), (LENGTH, far)),
            angle=((0.0, start), (LENGTH, start + 2.0 * math.pi * turns)),
        )
        for index, (start, turns, near, far) in enumerate(routes)
    ]
    robot = make_robot(tendons, discs=discs, stiffness=(1000.0, 1000.0 * twist))
    model = EnergyModel(robot, segment=segment)
    shape = model.shape(pulls[: len(tendons)])
    if shape.converged:
        assert shape.reason == ""
        check_sound(model, shape)
    else:
        words = str(shape.reason)
        assert any(what in words for what in ("tendon", "segment", "discs")), words
        with pytest.raises(GeometryError):
            shape.require()


@given(st.integers(0, 2**31), st.floats(-math.pi, math.pi))
def test_turning_all_tendons_turns_the_shape(seed, angle) -> None:
    pulls = np.random.default_rng(seed).uniform(-3.0, 3.0, 2)
    shapes = [
        EnergyModel(make_robot((helix("a", 0.6, turn), taper("b", 1.0 + turn)), discs=6)).shape(
            pulls
        )
        for turn in (0.0, angle)
    ]
    turned = Rotation.from_rotvec([0.0, 0.0, angle]).apply(shapes[0].points)
    assert shapes[1].points == pytest.approx(turned, abs=1e-6)
    assert shapes[1].tensions == pytest.approx(shapes[0].tensions, abs=1e-6)


def test_mirrored_routing_mirrors_the_shape() -> None:
    left = EnergyModel(make_robot((helix("a", 0.7, 0.4), taper("b", 1.0)))).shape([5.0, 2.0])
    right = EnergyModel(make_robot((helix("a", -0.7, -0.4), taper("b", -1.0)))).shape([5.0, 2.0])
    assert right.points == pytest.approx(left.points * [1.0, -1.0, 1.0], abs=1e-7)


def test_stiffness_scales_tensions_and_leaves_the_shape() -> None:
    tendons = (helix("a", 0.7), taper("b", 1.0))
    soft, hard = (
        EnergyModel(make_robot(tendons, stiffness=(k * 1000.0, k * 770.0))).shape([5.0, 2.0])
        for k in (1.0, 7.0)
    )
    assert hard.points == pytest.approx(soft.points, abs=1e-7)
    assert hard.tensions == pytest.approx(7.0 * soft.tensions, rel=1e-8)


def test_a_batch_is_its_commands_one_by_one() -> None:
    model = EnergyModel(make_robot((helix("a", 0.4), taper("b", 2.0), helix("c", -0.3, 4.0))))
    commands = np.random.default_rng(0).uniform(-4.0, 4.0, (2, 5, 3))
    batch = model.shape(commands)
    assert batch.frames.shape[:2] == (2, 5)
    for place in np.ndindex(2, 5):
        one = model.shape(commands[place])
        assert np.array_equal(one.frames, batch.frames[place])
        assert np.array_equal(one.tensions, batch.tensions[place])
        assert one.reason == batch.reason[place]


def test_without_command_it_stands_straight() -> None:
    shape = EnergyModel(make_robot((helix("a", 1.0), taper("b")))).shape([0.0, 0.0])
    assert shape.tip == pytest.approx([0.0, 0.0, LENGTH], abs=1e-7)
    assert shape.tensions == pytest.approx(0.0, abs=1e-6)
    assert not shape.slack.any()


def test_letting_out_leaves_it_straight_and_slack() -> None:
    shape = EnergyModel(make_robot(cross_tendons())).shape([-1.0, -2.0, -3.0, 0.0])
    assert shape.tip == pytest.approx([0.0, 0.0, LENGTH])
    assert shape.slack.tolist() == [True, True, True, False]


def test_slack_tendons_come_taut_when_pulled_in() -> None:
    model = EnergyModel(make_robot(cross_tendons()))
    loose, taut = model.shape([4.0, 1.0, -6.0, -1.0]), model.shape([4.0, 1.0, -4.0, -1.0])
    assert loose.slack.tolist() == [False, False, True, False]
    assert not taut.slack.any()
    assert loose.points == pytest.approx(taut.points, abs=1e-7)


def test_rods_that_push_share_the_load_with_cables_half_and_half() -> None:
    cables = EnergyModel(make_robot(cross_tendons())).shape([4.0, 0.0, -4.0, 0.0])
    rods = EnergyModel(make_robot(cross_tendons(pushes=True))).shape([4.0, 0.0, -4.0, 0.0])
    assert rods.points == pytest.approx(cables.points, abs=1e-7)
    pull = cables.tensions[0]
    assert cables.tensions == pytest.approx([pull, 0.0, 0.0, 0.0], abs=1e-6)
    assert rods.tensions == pytest.approx([pull / 2, 0.0, -pull / 2, 0.0], abs=1e-6)


@pytest.mark.parametrize("segment", list(SEGMENTS))
def test_redundant_cables_take_the_least_tensions(segment) -> None:
    tendons = cross_tendons(8)
    bend = np.array([1.0, 0.4])
    robot = make_robot(tendons, discs=1 if segment == "channel" else 400)
    commands = Coupling(robot).matrix @ bend
    if segment != "channel":
        commands[commands < 0.0] -= 1.0
    shape = EnergyModel(robot, segment=segment, tolerance=1e-3).shape(commands)
    assert shape.converged, shape.reason
    moment = 1000.0 * bend / LENGTH
    directions = Coupling(robot).matrix[commands > -0.5]
    held = shape.tensions[commands > -0.5]
    assert held @ directions == pytest.approx(moment, rel=2e-3)
    others = minimize(
        lambda pulls: pulls @ pulls,
        held,
        bounds=[(0.0, None)] * len(held),
        constraints={"type": "eq", "fun": lambda pulls: pulls @ directions - held @ directions},
        options={"ftol": 1e-13},
    )
    if segment == "channel":
        assert held == pytest.approx(others.x, abs=1e-4)


def test_tendons_that_stretch_turn_a_contradiction_into_tension() -> None:
    robot = make_robot(cross_tendons(2))
    contradiction = [3.0, 1.0]
    refused = EnergyModel(robot).shape(contradiction)
    assert not refused.converged
    assert "would have to stretch by 2 mm" in str(refused.reason)
    assert "'t0'" in str(refused.reason) and "'t1'" in str(refused.reason)
    model = EnergyModel(robot, tendon_stiffness=5000.0, segment="channel")
    shape = model.shape(contradiction)
    assert shape.converged
    # Two springs against each other: mean 2 mm each, and the difference bends.
    stretch = shape.tensions * LENGTH / 5000.0
    assert stretch.sum() == pytest.approx(4.0, abs=1e-6)
    moment = 4.0 * (shape.tensions[0] - shape.tensions[1])
    assert shape.section_parameters[0, 0] == pytest.approx(moment * LENGTH / 1000.0, rel=1e-6)


def test_stiff_tendons_are_the_limit_of_those_that_stretch() -> None:
    robot = make_robot((helix("a", 0.5), taper("b", 2.0)))
    rigid = EnergyModel(robot).shape([5.0, 2.0])
    errors = [
        np.abs(EnergyModel(robot, tendon_stiffness=ea).shape([5.0, 2.0]).tip - rigid.tip).max()
        for ea in (1e5, 1e6, 1e7)
    ]
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx([10.0, 10.0], rel=0.05)


def test_too_much_pull_is_refused_with_the_limit() -> None:
    shape = EnergyModel(make_robot(cross_tendons(2), discs=5, radius=6.0)).shape([60.0, -200.0])
    assert not shape.converged
    assert "tendon 't0' is pulled 60 mm" in str(shape.reason)
    assert "40 mm" in str(shape.reason)  # 5 segments of 2 times the offset
    assert (
        EnergyModel(make_robot(cross_tendons(2), discs=10, radius=6.0))
        .shape([60.0, -200.0])
        .converged
    )


def test_a_distal_tendon_bends_what_it_passes() -> None:
    tendons = [cross_tendons(4), cross_tendons(4, prefix="d")]
    robot = make_robot(tendons, sections=2, discs=10)
    free = [0.0, 0.0, 0.0, 0.0]
    held = EnergyModel(robot).shape([*free, 4.0, 0.0, -4.0, 0.0])
    assert held.section_parameters[0] == pytest.approx(0.0, abs=1e-6)
    assert held.section_parameters[1, 0] == pytest.approx(1.0, rel=1e-3)
    loose = EnergyModel(robot).shape([-9.0, -9.0, -9.0, -9.0, 4.0, 0.0, -4.0, 0.0])
    assert loose.section_parameters[:, 0] == pytest.approx([0.5, 0.5], rel=1e-3)


def test_sections_of_equal_tendons_share_a_bend_by_their_stiffness() -> None:
    sections = tuple(
        Section(
            length=50.0,
            radius=5.0,
            bending_stiffness=stiffness,
            tendons=tuple(tendons),
        )
        for stiffness, tendons in ((1000.0, ()), (250.0, cross_tendons(2)))
    )
    shape = EnergyModel(ContinuumRobot(sections), segment="channel").shape([4.0, -4.0])
    assert shape.section_parameters[:, 0] == pytest.approx([0.2, 0.8], rel=1e-6)


def test_uneven_discs_converge_to_the_same_shape() -> None:
    tendons = (helix("a", 0.5), taper("b", 2.0))
    uneven = tuple(100.0 * (np.arange(1, 161) / 160.0) ** 1.4)
    robot = ContinuumRobot(
        (
            Section(
                length=100.0,
                radius=10.0,
                tendons=tendons,
                disc_positions=uneven,
                bending_stiffness=1000.0,
                torsional_stiffness=770.0,
            ),
        )
    )
    even = EnergyModel(make_robot(tendons, discs=160)).shape([5.0, 2.0])
    assert EnergyModel(robot).shape([5.0, 2.0]).tip == pytest.approx(even.tip, abs=0.05)


def test_a_tendon_may_end_between_discs() -> None:
    tendons = (Tendon(name="a", offset=4.0, end=55.0), Tendon(name="b", offset=4.0, angle=2.0))
    model = EnergyModel(make_robot(tendons, discs=10))
    assert 55.0 in model.arc_length
    shape = model.shape([3.0, -10.0])
    last = shape.frames[shape.arc_length >= 55.0][:, :3, 2]
    assert last == pytest.approx(np.broadcast_to(last[0], last.shape), abs=1e-9)
    assert shape.tendon_points[0].shape == (7, 3)


def test_recomputed_lengths_are_those_of_the_drawn_tendons(routed) -> None:
    _, tendons, rod = routed
    shape = EnergyModel(make_robot(tendons)).shape(rod.displacements)
    for points, length in zip(shape.tendon_points, shape.tendon_lengths, strict=True):
        drawn = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert drawn == pytest.approx(length, abs=1e-9)


@given(st.integers(0, 2**31), st.floats(0.0, 1.0))
def test_lengths_in_channels_are_convex(seed, share) -> None:
    rng = np.random.default_rng(seed)
    grid = (
        rng.uniform(3.0, 8.0, 4),
        np.ones((4, 3)),
        np.zeros((2, 5, 2)),
        rng.normal(size=(2, 4, 3, 4)),
        np.array([4, 3]),
        CHANNEL,
    )
    lengths, slopes = np.empty((3, 2)), np.empty((2, 4, 3))
    positive, whole = np.empty((2, 4, 3, 3))
    ends = rng.normal(size=(2, 4, 3))
    for row, part in enumerate((0.0, 1.0, share)):
        turns = (1.0 - part) * ends[0] + part * ends[1]
        kernels.measure_lengths(grid, turns, np.zeros(2), lengths[row], slopes, positive, whole)
    assert np.all(lengths[2] <= (1.0 - share) * lengths[0] + share * lengths[1] + 1e-12)


@pytest.mark.parametrize("index", [13, 58])
def test_rods_that_push_are_followed_from_the_straight_one(index) -> None:
    # At once, Newton's method ends on another branch for some parts of such a command.
    rng = np.random.default_rng(11)
    for _ in range(index + 1):
        robot = draw_robot(rng, 0.2)
        command = draw_command(rng, robot)
    model = EnergyModel(robot, segment="channel", between=2)
    shapes = model.shape(command * np.linspace(0.05, 0.7, 14)[:, None])
    # Where discs meet it is no shape, but still the way there.
    assert all(not words or "meet" in words for words in shapes.reason), shapes.reason
    assert np.linalg.norm(np.diff(shapes.tip, axis=0), axis=1).max() < 10.0
