from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq
from scipy.signal import lsim
from scipy.spatial.transform import Rotation

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    ContinuumRobot,
    DynamicsOptions,
    EnergyModel,
    LineLoad,
    PointLoad,
    RodModel,
    Section,
    Tendon,
    Wire,
    insert_robot,
    linearise,
    push_in,
    simulate,
)
from bozzini.continuum.dynamics import (
    EnergyBalance,
    MovingRod,
    _Contacts,
    _split_base,
    _take_base,
)
from bozzini.continuum.kernels import dynamics as kernels
from bozzini.duct import RoundCones
from bozzini.errors import GeometryError, InputError

LENGTH, MODULUS, DENSITY = 200.0, 200e3, 7850.0  # mm, MPa, kg/m^3
BENDING = MODULUS * math.pi / 64.0
LINE_MASS = 1e-12 * DENSITY * math.pi / 4.0  # t/mm
FIRST = 1.8751040687**2 / (2.0 * math.pi * LENGTH**2) * math.sqrt(BENDING / LINE_MASS)
"""First frequency of a cantilever [Hz]."""

FREE = DynamicsOptions(gravity=(0.0, 0.0, 0.0), segment="arc")


def make_wire(discs: int = 30) -> ContinuumRobot:
    wire = Wire(diameter=1.0, modulus=MODULUS, density=DENSITY)
    return ContinuumRobot((Section(length=LENGTH, radius=0.5, discs=discs, wire=wire),))


def make_arm(discs: int = 10, stiffness: float = 2e3) -> ContinuumRobot:
    """A robot of two sections with three tendons each, its discs heavy."""
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    return ContinuumRobot(
        tuple(
            Section(
                length=50.0,
                radius=5.0,
                discs=discs // 2,
                wire=wire,
                line_weight=1e-4,
                disc_weight=1e-3,
                tendons=tuple(
                    Tendon(
                        name=f"{part}{k}",
                        offset=4.0,
                        angle=2.0 * math.pi * k / 3.0 + 0.4 * part,
                        stiffness=stiffness,
                    )
                    for k in range(3)
                ),
            )
            for part in range(2)
        )
    )


@dataclasses.dataclass(frozen=True)
class Tub:
    """A lumen between two planes across an axis, at distances on both sides [mm]."""

    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half: float = 8.0
    dim: int = 3
    error: float = 0.0

    def signed_distance(self, points, /):
        return np.abs(np.asarray(points) @ np.asarray(self.axis)) - self.half


LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""A base that looks along x; its own x is down."""


def make_level_arm(rotation=LEVEL) -> ContinuumRobot:
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    pulled = Tendon(name="up", offset=1.5, angle=math.pi, stiffness=2e3)
    section = Section(
        length=200.0, radius=2.0, discs=29, wire=wire, line_weight=2e-4, tendons=(pulled,)
    )
    return ContinuumRobot((section,), base_rotation=rotation)


FALLING = DynamicsOptions(segment="channel", damping_time=0.05, max_step=2e-3)
SOFT = ContactOptions(wall_stiffness=0.5)
COARSE = ContactOptions(wall_stiffness=0.5, segment_length=3.0)
LIFT = [PointLoad(force=(-0.021, 0.0, 0.0))]


def fall(times, robot=None, duct=None, contact=SOFT, options=FALLING, **commands):
    found = simulate(
        robot or make_level_arm(),
        times,
        held_by=LIFT,
        options=options,
        duct=duct or Tub(),
        contact=contact,
        **commands,
    )
    assert found.converged, found.reason
    return found


def no_walls(rod: MovingRod):
    return _Contacts(rod, (), ContactOptions()).packed


def find_orders(values):
    errors = np.linalg.norm(np.diff(values, axis=0), axis=1)
    return np.log2(errors[:-1] / errors[1:])


def test_frequencies_are_those_of_a_cantilever() -> None:
    found = linearise(make_wire(), options=dataclasses.replace(FREE, damping_time=1e-3))
    assert found.frequency[:2] == pytest.approx([FIRST, FIRST], rel=1e-3)
    np.testing.assert_allclose(
        found.damping_ratio[:2], math.pi * found.frequency[:2] * 1e-3, rtol=1e-9
    )
    shear = MODULUS / 2.6
    torsion = math.sqrt(shear / (1e-12 * DENSITY)) / (4.0 * LENGTH)
    assert np.abs(found.frequency / torsion - 1.0).min() < 1e-3


def test_frequency_with_a_heavy_tip_is_that_of_a_spring() -> None:
    mass = 100.0 * LINE_MASS * LENGTH
    heavy = dataclasses.replace(FREE, tip_weight=mass * 9806.65)
    spring = 3.0 * BENDING / LENGTH**3
    exact = math.sqrt(spring / (mass + 33.0 / 140.0 * LINE_MASS * LENGTH)) / (2.0 * math.pi)
    assert linearise(make_wire(), options=heavy).frequency[0] == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("share", [-2.0, 0.5, 0.9])
def test_frequency_under_a_load_along_the_rod_is_that_of_the_beam(share: float) -> None:
    load = share * math.pi**2 * BENDING / (4.0 * LENGTH**2)
    found = linearise(make_wire(40), loads=[PointLoad(force=(0.0, 0.0, -load))], options=FREE)

    def miss(frequency: float) -> float:
        """Determinant of the ends' conditions of a beam under a load of fixed direction."""
        half = 0.5 * load / BENDING
        root = math.sqrt(half**2 + LINE_MASS * (2.0 * math.pi * frequency) ** 2 / BENDING)
        a, b = math.sqrt(root - half), math.sqrt(root + half)  # exponents, real and imaginary
        x, y = a * LENGTH, b * LENGTH
        # w = A (cosh ax - cos bx) + B (sinh ax - a/b sin bx): no moment, no force at the tip.
        moment = (
            a * a * math.cosh(x) + b * b * math.cos(y),
            a * a * math.sinh(x) + a * b * math.sin(y),
        )
        k = load / BENDING
        force = (
            a**3 * math.sinh(x) - b**3 * math.sin(y) + k * (a * math.sinh(x) + b * math.sin(y)),
            a**3 * math.cosh(x) + a * b * b * math.cos(y) + k * a * (math.cosh(x) - math.cos(y)),
        )
        return moment[0] * force[1] - moment[1] * force[0]

    exact = brentq(miss, 0.1 * FIRST, 2.5 * FIRST)
    assert found.frequency[0] == pytest.approx(exact, rel=1e-3)
    assert (exact < FIRST) == (share > 0.0)


def test_frequency_falls_to_nothing_where_the_rod_buckles() -> None:
    critical = math.pi**2 * BENDING / (4.0 * LENGTH**2)
    loads = [PointLoad(force=(0.0, 0.0, -0.999 * critical))]
    assert linearise(make_wire(), loads=loads, options=FREE).frequency[0] < 0.05 * FIRST
    loads = [PointLoad(force=(0.0, 0.0, -1.001 * critical))]
    with pytest.raises(GeometryError, match="not stable"):
        linearise(make_wire(), loads=loads, options=FREE)


def test_kernel_is_the_rate_of_the_derivatives_of_the_kinetic_energy() -> None:
    loads = (
        PointLoad(arc_length=33.0, force=(0.1, 0.2, -0.1), moment=(1.0, -2.0, 0.5)),
        LineLoad(force=(0.0, 1e-3, 0.0), start=20.0),
    )
    options = DynamicsOptions(segment="arc", drag=1e-4, damping_time=0.01, tip_weight=0.02)
    rod = MovingRod(make_arm(), options, loads)
    count, points = len(rod.grid.spans), len(rod.points.parts)
    rng = np.random.default_rng(1)
    q, rate = 0.1 * rng.standard_normal((count, 3)), rng.standard_normal((count, 3))
    place, turn = rng.standard_normal(3), Rotation.from_rotvec([0.3, -0.2, 0.5])
    speed, spin = rng.standard_normal(3) * 20.0, rng.standard_normal(3)
    forces = rod.weights + rod.load_vectors[0].sum(axis=0)
    moments = rod.load_vectors[1].sum(axis=0)

    def measure(q, rate, base):
        work = kernels.make_work(count, points)
        drive = base, forces, moments, rod.weights, no_walls(rod), np.empty((2, 0, 3))
        kernels.measure_motion(rod.packed, q, rate, drive, work[0], work[1], work[3], work[4])
        return work, kernels.measure_energies(rod.packed, q, drive, work[0])

    def move(time):
        turned = (Rotation.from_rotvec(time * spin) * turn).as_matrix()
        return turned, place + time * speed, speed, spin, np.zeros(3), np.zeros(3)

    base = move(0.0)
    work, _ = measure(q, rate, base)
    step = 1e-6
    by_q, by_rate = np.empty((2, count, 3))
    for index in np.ndindex(count, 3):
        moved = np.zeros((count, 3))
        moved[index] = step
        ends = [measure(q + sign * moved, rate, base) for sign in (1.0, -1.0)]
        by_q[index] = (ends[0][1][0] - ends[1][1][0]) / (2.0 * step)
        lost = [sum(end[1][1:3]) for end in ends]
        by_q[index] -= (lost[0] - lost[1]) / (2.0 * step)
        ends = [measure(q, rate + 1e3 * sign * moved, base) for sign in (1.0, -1.0)]
        by_rate[index] = (ends[0][1][0] - ends[1][1][0]) / (2e3 * step)
    np.testing.assert_allclose(work[3], by_rate, rtol=1e-6, atol=1e-9 * np.abs(by_rate).max())
    # What is left of the generalised force: damping, drag, and the loads beside the weight.
    jacobian = np.zeros((points, 6, count, 3))
    for index in np.ndindex(count, 3):
        one = np.zeros((count, 3))
        one[index] = 1.0
        still = base[0], base[1], *(np.zeros(3) for _ in range(4))
        state = measure(q, one, still)[0][0][2]
        jacobian[:, :3, index[0], index[1]], jacobian[:, 3:, index[0], index[1]] = state[4:6]
    velocity = work[0][2][4]
    push = rod.points.drags[:, None] * velocity - (forces - rod.weights)
    other = np.einsum("pi,pijk->jk", push, jacobian[:, :3])
    other -= np.einsum("pi,pijk->jk", moments, jacobian[:, 3:])
    other += rod.damping * rate
    np.testing.assert_allclose(work[4], other - by_q, rtol=1e-5, atol=1e-6 * np.abs(work[4]).max())


def test_chain_solves_the_dense_problem() -> None:
    pulled, load = [3.0, 1.0, 0.5, 1.0, 2.0, 0.0], [PointLoad(force=(0.02, 0.05, -0.3))]
    options = DynamicsOptions(segment="channel", drag=1e-5, damping_time=0.01, tip_weight=0.01)
    found = linearise(make_arm(), tensions=pulled, loads=load, options=options)
    rod = MovingRod(make_arm(), options, tuple(load))
    q = EnergyModel(
        make_arm(), segment="channel", loads=[*load, PointLoad(force=(0.0, 0.0, -0.01))]
    ).shape_under_tensions(pulled)
    count, points = len(rod.grid.spans), len(rod.points.parts)
    start = rod.find_equilibrium(np.array(pulled), held=False, factors=np.ones(1), turned=np.eye(3))
    np.testing.assert_allclose(start.tensions, q.tensions)
    np.testing.assert_allclose(rod.grid.place_frames(start.rotation_vectors[None])[0], q.frames)
    base = np.eye(3), *(np.zeros(3) for _ in range(5))
    forces = rod.weights + rod.load_vectors[0][0]
    none = np.empty((2, 0, 3))
    drive = base, forces, rod.load_vectors[1][0], rod.weights, no_walls(rod), none
    work, pull = kernels.make_work(count, points), kernels.make_pull(count, 6)
    vectors = start.rotation_vectors
    kernels.measure_motion(
        rod.packed, vectors, np.zeros((count, 3)), drive, work[0], work[1], work[3], work[4]
    )
    tendons = rod.compliances, False, ~rod.robot.pushes, rod.rubbing
    strings = kernels.make_strings(count, 0)
    kernels.pull_tendons(
        rod.grid.packed, tendons, np.array(pulled), vectors, True, pull, strings, work[4]
    )
    assert np.abs(work[4]).max() < 1e-6  # it is an equilibrium
    scale, right = 300.0, np.random.default_rng(2).standard_normal((count, 3))
    blocks = pull[4], np.empty((0, 3, 3))
    kernels.factor_chain(rod.packed, vectors, scale, 1.0, True, blocks, work[0], work[1], work[2])
    out = np.empty_like(right)
    kernels.solve_chain(work[2], right, out, np.empty((0, 3)))
    dense = scale**2 * found.mass + scale * found.damping + found.stiffness
    np.testing.assert_allclose(out.ravel(), np.linalg.solve(dense, right.ravel()), rtol=1e-7)


@pytest.mark.parametrize(("given", "bias"), [("tensions", 1.0), ("displacements", 0.05)])
def test_a_small_step_is_that_of_the_state_space(given: str, bias: float) -> None:
    robot, times = make_arm(), np.linspace(0.0, 0.2, 401)
    options = DynamicsOptions(
        segment="channel", damping_time=5e-3, max_step=2.5e-4, spectral_radius=1.0
    )
    rest = np.full(6, bias)
    commands = np.tile(rest, (len(times), 1))
    commands[:, 3] += 0.01 * np.minimum(times / 0.01, 1.0)
    moved = simulate(robot, times, **{given: commands}, options=options)
    found = linearise(robot, **{given: rest}, options=options)
    _, tip, _ = lsim(found.state_space(), commands - rest, times)
    assert np.abs(tip).max() > 1e-2
    np.testing.assert_allclose(moved.tip - moved.tip[0], tip, atol=2e-3 * np.abs(tip).max())


@pytest.mark.parametrize("radius", [0.0, 0.8, 1.0])
def test_error_falls_with_the_square_of_the_step(radius: float) -> None:
    times, pulls = np.array([0.0, 0.05, 0.1]), np.zeros((3, 6))
    pulls[1:, 3] = 4.0
    tips = [
        simulate(
            make_arm(),
            times,
            tensions=pulls,
            options=DynamicsOptions(damping_time=2e-3, max_step=step, spectral_radius=radius),
        ).tip[-1]
        for step in (2e-3, 1e-3, 5e-4, 2.5e-4)
    ]
    assert np.all(np.abs(find_orders(tips) - 2.0) < 0.35)


def test_error_falls_with_the_square_of_the_segments() -> None:
    held = [PointLoad(force=(0.3, 0.0, 0.0))]
    options = dataclasses.replace(FREE, damping_time=2e-3, spectral_radius=1.0, max_step=5e-4)
    tips = [
        simulate(make_wire(discs), [0.0, 0.02], held_by=held, options=options).tip[-1]
        for discs in (8, 16, 32, 64)
    ]
    assert np.all(np.abs(find_orders(tips) - 2.0) < 0.3)


def test_energy_is_kept_over_a_hundred_periods() -> None:
    options = dataclasses.replace(FREE, spectral_radius=1.0, max_step=1.0 / FIRST / 100.0)
    times = np.linspace(0.0, 100.0 / FIRST, 201)
    held = [PointLoad(force=(0.3, 0.0, 0.0))]
    moved = simulate(make_wire(10), times, held_by=held, options=options)
    assert moved.converged and moved.tip[0, 0] > 0.3 * LENGTH
    assert moved.residual < 1e-3 * moved.energy.elastic[0]
    assert moved.energy.kinetic.max() > 0.5 * moved.energy.elastic[0]


@pytest.mark.parametrize("per_period", [2, 20, 100])
def test_large_steps_of_a_planar_motion_win_no_energy(per_period: int) -> None:
    options = dataclasses.replace(FREE, spectral_radius=0.5, max_step=1.0 / FIRST / per_period)
    times = np.linspace(0.0, 5.0 / FIRST, 51)
    held = [PointLoad(force=(8.0, 0.0, 0.0))]  # the tip hangs almost sideways
    moved = simulate(make_wire(10), times, held_by=held, options=options)
    assert moved.converged
    assert np.all(np.diff(moved.energy.total) < 1e-6 * moved.energy.total[0])


WILD = [PointLoad(force=(0.1, 0.0, 0.0)), PointLoad(force=(0.0, 0.07, 0.0), arc_length=100.0)]


@pytest.mark.parametrize("radius", [0.8, 0.5])
@pytest.mark.parametrize("per_period", [2, 5, 20, 50])
@pytest.mark.parametrize("robot", ["wire", "tensions", "displacements"])
def test_wild_motions_in_space_gain_no_energy(robot: str, per_period: int, radius: float) -> None:
    # Neither linear nor planar; the roll of a thin rod is a thousand times faster than its steps.
    moved, period, commands, held = make_wire(12), 1.0 / FIRST, {}, WILD
    if robot != "wire":
        moved, period = make_arm(12), 0.1
        held = [PointLoad(force=(0.5, 0.5, 0.2)), PointLoad(arc_length=50.0, force=(-1.0, 0.5, 0))]
        size = 1.0 if robot == "tensions" else 0.2
        commands = {robot: size * np.array([2.0, 0.5, 0.0, 0.3, 1.0, 0.0])}
    times = np.arange(0.0, 10.0 * period, period / per_period)
    options = dataclasses.replace(FREE, spectral_radius=radius, max_step=period)
    found = simulate(moved, times, held_by=held, options=options, **commands)
    assert found.converged and not found.notes
    gained = found.energy.residual - np.minimum.accumulate(found.energy.residual)
    assert gained.max() < 0.011 * found.energy.total.max()


def test_a_state_of_another_robot_is_refused() -> None:
    first = simulate(make_wire(10), [0.0, 1e-3], options=FREE)
    with pytest.raises(InputError, match="initial is of another robot"):
        simulate(make_arm(10), [0.0, 1e-3], initial=first, options=FREE)


def test_tensions_may_be_given_by_name() -> None:
    robot = make_arm()
    name, pulls = robot.tendon_names[1], np.eye(6)[1]
    named, plain = (
        simulate(robot, [0.0, 0.01], tensions=one, options=FREE) for one in ({name: 1.0}, pulls)
    )
    np.testing.assert_array_equal(named.tip, plain.tip)
    named, plain = (linearise(robot, tensions=one, options=FREE) for one in ({name: 1.0}, pulls))
    np.testing.assert_array_equal(named.frequency, plain.frequency)
    with pytest.raises(InputError, match="no tendon 'zz'"):
        simulate(robot, [0.0, 0.01], tensions={"zz": 1.0})


def test_energies_too_small_to_matter_are_not_told() -> None:
    others = "elastic", "gravity", "tendons", "work", "dissipated", "walls", "friction"
    kinetic = np.array([0.0, 1e-13, 1e-9])
    tiny = EnergyBalance(kinetic=kinetic, **dict.fromkeys(others, np.zeros(3)))
    assert tiny.gain.max() < 1e-3


@pytest.mark.parametrize("segment", ["chord", "arc", "channel"])
@pytest.mark.parametrize("given", ["tensions", "displacements"])
def test_motion_ends_at_the_static_equilibrium(segment: str, given: str) -> None:
    robot = make_arm()
    pulls = [4.0, 1.0, 1.0, 1.0, 3.0, 1.0]
    command = np.array(pulls if given == "tensions" else [1.5, -1.0, -0.5, 0.3, 2.0, -1.0])
    model = EnergyModel(robot, segment=segment)
    static = (
        model.shape_under_tensions(command) if given == "tensions" else model.shape(command)
    ).require()
    times = np.linspace(0.0, 2.0, 21)
    options = DynamicsOptions(
        segment=segment, damping_time=0.05, max_step=0.01, spectral_radius=0.5
    )
    commands = np.minimum(times, 0.2)[:, None] / 0.2 * command
    moved = simulate(robot, times, **{given: commands}, options=options)
    assert np.abs(moved.tip[-1] - static.tip).max() < 1e-4 * robot.length * 0.01
    np.testing.assert_allclose(moved.tensions[-1], static.tensions, atol=1e-6)
    np.testing.assert_allclose(moved.displacements[-1], static.displacements, atol=1e-6)
    assert np.abs(moved.velocities[-1]).max() < 1e-3


def test_motion_ends_near_the_rod_model() -> None:
    robot = make_arm(30)
    pulls = np.array([4.0, 1.0, 1.0, 1.0, 3.0, 1.0])
    static = RodModel(robot).shape_under_tensions(pulls).require()
    options = DynamicsOptions(
        segment="channel", damping_time=0.05, max_step=0.02, spectral_radius=0.5
    )
    commands = np.array([0.0 * pulls, pulls, pulls])
    moved = simulate(robot, [0.0, 0.2, 2.0], tensions=commands, options=options)
    assert np.abs(moved.tip[-1] - static.tip).max() < 1e-4 * robot.length


def shake(times):
    """Frames of a base that is moved and turned about all axes."""
    base = np.tile(np.eye(4), (len(times), 1, 1))
    vectors = np.sin(np.outer(times, [9.0, 14.0, 11.0])) * [0.4, 0.3, 0.7]
    base[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    base[:, :3, 3] = np.sin(np.outer(times, [13.0, 17.0, 8.0])) * 5.0
    return base


FOLLOWING = [
    PointLoad(force=(0.2, 0.1, 0.0), moment=(0.0, 0.0, 2.0), frame="body"),
    LineLoad(force=(0.0, 1e-3, 0.0), start=20.0, frame="body"),
    PointLoad(arc_length=40.0, force=(0.0, 0.05, 0.0)),
]


@pytest.mark.parametrize("segment", ["chord", "channel"])
@pytest.mark.parametrize("step", [2e-3, 0.2])
def test_loads_that_turn_with_the_body_end_at_the_static_equilibrium(
    segment: str, step: float
) -> None:
    times, factors = np.array([0.0, 1.0, 3.0]), np.array([[0.0] * 3, [1.0] * 3, [1.0] * 3])
    options = DynamicsOptions(
        segment=segment, damping_time=0.05, max_step=step, spectral_radius=0.5
    )
    moved = simulate(make_arm(), times, loads=FOLLOWING, load_factors=factors, options=options)
    static = EnergyModel(make_arm(), segment=segment, loads=FOLLOWING)
    still = static.shape_under_tensions(np.zeros(6)).require()
    assert still.tip[0] > 20.0
    assert np.linalg.norm(moved.tip[-1] - still.tip) < 1e-4 * 100.0
    # It is at rest there from the start, too.
    rest = simulate(make_arm(), times[:2], loads=FOLLOWING, options=options)
    np.testing.assert_allclose(rest.tip[:2], [still.tip, still.tip], atol=1e-2)


def test_loads_that_turn_with_the_body_do_the_work_that_moves_it() -> None:
    times = np.linspace(0.0, 0.3, 31)
    factors = np.tile(np.sin(20.0 * times)[:, None], (1, 3))
    moved = simulate(make_arm(), times, loads=FOLLOWING, load_factors=factors, base=shake(times))
    assert moved.residual < 5e-3 * np.ptp(moved.energy.work)
    with pytest.raises(InputError, match="axes of the body"):
        linearise(make_arm(), loads=FOLLOWING)
    for frame in ("base", "world"):
        twisted = PointLoad(moment=(0.0, 0.0, 10.0), frame=frame)
        with pytest.raises(InputError, match="a load has a moment"):
            linearise(make_wire(), loads=[twisted])


FREE_FREE = 4.7300407449**2 / (2.0 * math.pi * LENGTH**2) * math.sqrt(BENDING / LINE_MASS)
"""First frequency of a rod that nothing holds [Hz]."""


def measure_momentum(moved):
    """Momentum of a wire by the velocities of its stations, and that about the origin, (k, 3)."""
    mass = LINE_MASS * np.diff(moved.arc_length)[:, None]
    speeds = 0.5 * (moved.velocities[:, 1:] + moved.velocities[:, :-1])
    places = 0.5 * (moved.points[:, 1:] + moved.points[:, :-1])
    return (mass * speeds).sum(axis=1), np.cross(places, mass * speeds).sum(axis=1)


def test_momentum_of_a_free_rod_is_kept() -> None:
    # It is hit at a place beside its middle, and flies on, turning.
    times = np.concatenate([[0.0, 0.01], np.linspace(0.02, 0.5, 49)])
    hit = [PointLoad(arc_length=150.0, force=(0.05, 0.02, 0.03))]
    factors = np.zeros((len(times), 1))
    factors[1] = 1.0
    options = dataclasses.replace(FREE, max_step=5e-4)
    known = {"loads": hit, "load_factors": factors, "options": options}
    moved = simulate(make_wire(), times, free=True, **known)
    assert moved.converged
    linear, about = measure_momentum(moved)
    impulse = 0.01 * np.array(hit[0].force)
    np.testing.assert_allclose(linear[2:], np.tile(impulse, (49, 1)), rtol=2e-3)
    np.testing.assert_allclose(about[2:], np.tile(about[2], (49, 1)), atol=2e-3 * 0.075)
    np.testing.assert_allclose(moved.state.ground[6], impulse, rtol=1e-12)
    lost = moved.energy.total[2:] - moved.energy.total[2]
    assert np.abs(lost).max() < 1e-3 * moved.energy.kinetic[2]
    assert moved.residual < 1e-2 * moved.energy.kinetic[2]
    turned = moved.frames[-1, 0, :3, :3]
    assert np.abs(turned - np.eye(3)).max() > 0.5
    # Its middle of mass flies straight.
    middle = 0.5 * (moved.points[:, 1:] + moved.points[:, :-1]).mean(axis=1)
    straight = middle[2] + (times[2:, None] - 0.02) * linear[2] / (LINE_MASS * LENGTH)
    np.testing.assert_allclose(middle[2:], straight, atol=0.01 * np.ptp(straight))
    first = simulate(make_wire(), times[:20], free=True, loads=hit, options=options,
                     load_factors=factors[:20])  # fmt: skip
    then = simulate(make_wire(), times[19:], free=True, loads=hit, options=options,
                    load_factors=factors[19:], initial=first)  # fmt: skip
    np.testing.assert_allclose(then.tip[-1], moved.tip[-1], atol=1e-3)


def test_a_rod_that_is_let_go_falls_and_swings_at_its_own_frequency() -> None:
    times = np.linspace(0.0, 6.0 / FREE_FREE, 241)
    held = [PointLoad(force=(0.01, 0.0, 0.0)), PointLoad(arc_length=100.0, force=(-0.02, 0.0, 0.0))]
    options = DynamicsOptions(segment="arc", spectral_radius=1.0, max_step=1e-4)
    moved = simulate(make_wire(), times, free=True, held_by=held, options=options)
    fallen = -0.5 * 9806.65 * times**2
    middle = 0.5 * (moved.points[:, 1:] + moved.points[:, :-1]).mean(axis=1)
    np.testing.assert_allclose(middle[:, 2] - middle[0, 2], fallen, atol=1e-2 * abs(fallen[-1]))
    ends, half = moved.points[:, [0, -1]].mean(axis=1), moved.points[:, 15]
    bend = (ends - half)[:, 0]
    phase = np.fft.rfft((bend - bend.mean()) * np.hanning(len(bend)), 16 * len(bend))
    peak = np.fft.rfftfreq(16 * len(bend), times[1])[np.abs(phase).argmax()]
    assert peak == pytest.approx(FREE_FREE, rel=0.02)
    with pytest.raises(InputError, match="no displacements"):
        simulate(make_arm(), [0.0, 0.1], displacements=np.zeros(6), free=True)
    with pytest.raises(InputError, match="other than of initial"):
        simulate(make_wire(), times, initial=moved, options=options)


def test_energy_balance_counts_all_that_acts() -> None:
    robot, times = make_arm(), np.linspace(0.0, 0.3, 31)
    loads = [
        PointLoad(arc_length=40.0, force=(0.05, 0.0, 0.0), moment=(0.0, 0.0, 3.0)),
        LineLoad(force=(0.0, 1e-3, 0.0), frame="world"),
    ]
    factors = np.stack([np.sin(20.0 * times), np.cos(15.0 * times)], axis=1)
    commands = 1.0 + np.sin(np.outer(times, [10.0, 20.0, 15.0, 12.0, 9.0, 7.0])) ** 2
    residuals = []
    for step in (1e-3, 5e-4):
        options = DynamicsOptions(
            damping_time=3e-3, drag=1e-5, max_step=step, spectral_radius=0.8, tip_weight=0.01
        )
        moved = simulate(
            robot,
            times,
            tensions=commands,
            loads=loads,
            load_factors=factors,
            base=shake(times),
            options=options,
        )
        balance = moved.energy
        assert min(balance.dissipated[-1], np.ptp(balance.work)) > 0.5
        residuals.append(moved.residual / np.ptp(balance.work))
    assert residuals[0] < 5e-3 and residuals[1] < 0.4 * residuals[0]


def test_a_base_that_falls_has_no_weight_on_it() -> None:
    times = np.linspace(0.0, 0.5, 51)
    base = np.tile(np.eye(4), (51, 1, 1))
    base[:, 0, 3] = 0.5 * 9806.65 * times**2  # it is thrown sideways as fast as things fall
    options = DynamicsOptions(segment="arc", damping_time=0.05, max_step=5e-3, spectral_radius=0.5)
    moved = simulate(make_wire(), times, base=base, options=options)
    held = [PointLoad(arc_length=LENGTH, force=(1e-9, 0.0, 0.0))]
    both = dataclasses.replace(options, gravity=(-9.80665, 0.0, -9.80665))
    rest = simulate(make_wire(), [0.0, 1.0], held_by=held, options=both)
    np.testing.assert_allclose(moved.tip[-1] - base[-1, :3, 3], rest.tip[-1], atol=1e-3)


def test_a_base_that_stops_goes_no_further() -> None:
    times = np.linspace(0.0, 2.0, 9)
    base = np.tile(np.eye(4), (9, 1, 1))
    base[:, 2, 3] = np.minimum(60.0 * times, 65.0)
    fine = np.linspace(0.0, 2.0, 401)
    moved = _split_base(times, _take_base(times, base), fine)[:, 3, 2]
    assert moved.max() < 65.0 + 1e-9 and np.all(np.diff(moved) > -1e-9)
    np.testing.assert_allclose(moved[::50], base[:-1, 2, 3])


def test_a_base_that_turns_and_a_turned_robot_see_the_same() -> None:
    turn = Rotation.from_rotvec([0.0, 0.7, 0.0])
    frame = np.eye(4)
    frame[:3, :3] = turn.as_matrix()
    held, options = [PointLoad(force=(0.1, 0.2, 0.0))], DynamicsOptions(segment="arc")
    times = np.linspace(0.0, 0.05, 6)
    turned = dataclasses.replace(make_wire(10), base_rotation=tuple(turn.as_rotvec()))
    one = simulate(turned, times, held_by=held, options=options)
    held = [PointLoad(force=tuple(turn.apply(held[0].force)))]
    other = simulate(
        make_wire(10), times, held_by=held, base=np.tile(frame, (6, 1, 1)), options=options
    )
    np.testing.assert_allclose(frame @ one.frames, other.frames, atol=1e-6)
    np.testing.assert_allclose(one.energy.kinetic, other.energy.kinetic, atol=1e-9)


def test_a_bent_rod_that_spins_whirls_at_its_own_frequency() -> None:
    # It begins at the speed of its spin; to one who stands still it swings as without it.
    times = np.linspace(0.0, 1.5 / FIRST, 151)
    speed = 0.4 * 2.0 * math.pi * FIRST
    base = np.tile(np.eye(4), (len(times), 1, 1))
    base[:, :3, :3] = Rotation.from_rotvec(np.outer(speed * times, [0.0, 0.0, 1.0])).as_matrix()
    options = dataclasses.replace(FREE, spectral_radius=1.0, max_step=2e-4)
    held = [PointLoad(force=(5e-3, 0.0, 0.0))]
    still = simulate(make_wire(12), times, held_by=held, options=options)
    spun = simulate(make_wire(12), times, held_by=held, base=base, options=options)
    amplitude = still.tip[0, 0]
    np.testing.assert_allclose(spun.tip[:, 0], still.tip[:, 0], atol=2e-3 * amplitude)
    way = speed * cumulative_trapezoid(still.tip[:, 0], times, initial=0.0)
    np.testing.assert_allclose(spun.tip[:, 1], way, atol=2e-3 * amplitude)


def test_motion_goes_on_from_where_it_was() -> None:
    times = np.linspace(0.0, 0.1, 11)
    pulls = np.outer(np.sin(30.0 * times) ** 2, [3.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    whole = simulate(make_arm(), times, tensions=pulls)
    first = simulate(make_arm(), times[:6], tensions=pulls[:6])
    second = simulate(make_arm(), times[5:], tensions=pulls[5:], initial=first)
    np.testing.assert_allclose(second.tip, whole.tip[5:], atol=1e-6)


def test_a_cable_goes_slack() -> None:
    times = np.linspace(0.0, 0.2, 21)
    moves = np.zeros((21, 6))
    moves[:, 0] = np.minimum(20.0 * times, 2.0)
    moves[:, 1:3] = -np.minimum(20.0 * times, 2.0)[:, None]
    moved = simulate(make_arm(), times, displacements=moves)
    assert moved.converged and moved.tensions.min() == 0.0 and moved.tensions[-1, 0] > 0.5


@pytest.mark.parametrize("pull", [0.0, 0.35])
def test_a_robot_that_falls_on_a_wall_rests_as_in_equilibrium(pull: float) -> None:
    found = fall(np.linspace(0.0, 3.0, 31), tensions=[pull])
    assert found.wall_sum[0] == 0.0
    robot = make_level_arm()
    model = ContactModel(
        robot, Tub(), options=dataclasses.replace(SOFT, segment_length=200.0 / 30.0 + 1e-6)
    )
    rest = model.shape_under_tensions([pull])
    tip = rest.points[-1] @ robot.base_frame[:3, :3]
    assert np.linalg.norm(found.tip[-1] - tip) < 1e-4 * 200.0
    assert rest.normal_forces.sum() > 1e-3
    assert found.wall_sum[-1] == pytest.approx(rest.normal_forces.sum(), rel=1e-3)
    assert np.abs(found.velocities[-1]).max() < 1e-3


def test_a_blow_wins_no_energy() -> None:
    options = DynamicsOptions(segment="chord", max_step=2e-3)
    found = fall(np.linspace(0.0, 0.6, 301), options=options)
    assert found.wall_sum.max() > 5.0 * found.wall_sum[-1]
    assert found.gaps.min() > -0.1
    balance = found.energy
    assert np.all(np.diff(balance.residual) < 1e-4 * balance.kinetic.max())
    np.testing.assert_allclose(balance.walls[found.wall_sum == 0.0], 0.0, atol=1e-12)


def test_friction_is_that_of_what_slides_and_holds_what_rests() -> None:
    times = np.linspace(0.0, 3.0, 121)
    base = np.tile(np.eye(4), (len(times), 1, 1))
    base[:, 2, 3] = 10.0 * np.clip(times - 1.0, 0.0, 1.0)  # it lies down, is drawn out, and rests
    contact = dataclasses.replace(SOFT, friction=0.3)
    found = fall(times, contact=contact, base=base, options=dataclasses.replace(FALLING, drag=1e-7))
    down, back = found.wall_forces[..., 0].sum(axis=1), found.wall_forces[..., 2].sum(axis=1)
    sliding = (times > 1.3) & (times < 1.9)
    np.testing.assert_allclose(back[sliding], 0.3 * down[sliding], rtol=0.02)
    assert np.all(np.abs(back) <= 0.3 * np.abs(down) * 1.05 + 1e-5)
    assert np.abs(found.velocities[-1]).max() < 1e-2
    smooth = fall(times, base=base)
    assert np.abs(smooth.wall_forces[..., 2]).max() < 1e-3 * np.abs(down).max()


def test_walls_and_robot_turned_together_see_the_same() -> None:
    times, turn = np.linspace(0.0, 0.4, 41), Rotation.from_rotvec([0.4, -0.3, 0.8])
    one = fall(times)
    options = dataclasses.replace(FALLING, gravity=tuple(turn.apply(FALLING.gravity)))
    robot = make_level_arm(turn.as_matrix() @ LEVEL)
    other = fall(times, robot, Tub(axis=tuple(turn.as_matrix()[:, 2])), options=options)
    np.testing.assert_allclose(other.tip, one.tip, atol=1e-5)
    np.testing.assert_allclose(other.wall_forces, one.wall_forces, atol=1e-5)
    # A lumen's wall is an obstacle's, seen from outside.
    floor = Tub(axis=(0.0, 0.0, 1.0), half=1e3)
    block = dataclasses.replace(floor)
    object.__setattr__(block, "signed_distance", lambda points: points[..., 2] + 8.0)
    third = simulate(
        make_level_arm(), times, held_by=LIFT, options=FALLING, obstacles=block, contact=SOFT
    )
    np.testing.assert_allclose(third.tip, one.tip, atol=1e-6)


def test_a_motion_among_walls_goes_on_from_where_it_was() -> None:
    times, contact = np.linspace(0.0, 1.0, 11), dataclasses.replace(SOFT, friction=0.3)
    whole = fall(times, contact=contact)
    first = fall(times[:6], contact=contact)
    second = simulate(
        make_level_arm(), times[5:], initial=first, options=FALLING, duct=Tub(), contact=contact
    )
    assert whole.wall_sum[5] > 0.0
    np.testing.assert_allclose(second.tip[-1], whole.tip[-1], atol=2e-3)
    np.testing.assert_allclose(second.wall_forces[0], first.wall_forces[-1], atol=1e-3)
    np.testing.assert_allclose(second.gaps[0], first.gaps[-1], atol=1e-3)
    assert second.energy.walls[0] == pytest.approx(first.energy.walls[-1], rel=1e-2)


@pytest.mark.parametrize(
    ("words", "commands"),
    [
        ("wall_stiffness", {"duct": Tub()}),
        ("is not given", {"duct": Tub(), "contact": ContactOptions()}),
        ("without a wall", {"contact": SOFT}),
        ("segment_length", {"duct": Tub(), "contact": COARSE}),
        ("must be a duct", {"obstacles": 3, "contact": SOFT}),
    ],
)  # fmt: skip
def test_walls_that_do_not_fit_are_refused(words: str, commands: dict[str, object]) -> None:
    with pytest.raises(InputError, match=words):
        simulate(make_level_arm(), [0.0, 0.1], options=FALLING, **commands)


def test_a_robot_pushed_in_slowly_ends_as_one_in_equilibrium_at_each_step() -> None:
    turn = np.linspace(0.0, 1.2, 40)
    bend = np.stack([120.0 * (1.0 - np.cos(turn)), 0.0 * turn, 60.0 + 120.0 * np.sin(turn)], axis=1)
    way = np.concatenate([np.linspace([0.0, 0.0, 0.0], bend[0], 20)[:-1], bend])
    duct, wire = (
        RoundCones(way, np.full(len(way), 8.0)),
        Wire(diameter=1.0, modulus=60e3, density=6450.0),
    )
    section = Section(length=180.0, radius=2.0, discs=29, wire=wire, line_weight=2e-4)
    contact = dataclasses.replace(SOFT, segment_length=3.0)
    model = ContactModel(ContinuumRobot((section,)), duct, options=contact)
    still = insert_robot(model, way)
    times = np.linspace(0.0, 4.0, 41)
    robot, base = push_in(model, way, times=times, speed=60.0)
    found = simulate(
        robot, times, base=base, duct=duct, contact=SOFT, introducer=180.0, options=FALLING
    )
    assert still.converged
    assert found.converged
    tip = robot.base_frame[:3, :3] @ found.tip[-1] + robot.base_frame[:3, 3]
    assert np.linalg.norm(tip - still.last.points[-1]) < 0.5
    assert found.wall_sum[-1] == pytest.approx(still.last.normal_forces.sum(), rel=0.1)
    assert found.gaps.min() > -0.5


def test_a_robot_pushed_round_a_tight_bend_gains_no_energy() -> None:
    # It snaps from wall to wall, further in a step than the wall is flat.
    turn = np.linspace(0.0, 2.5, 60)
    bend = np.stack([40.0 * (1.0 - np.cos(turn)), 0.0 * turn, 60.0 + 40.0 * np.sin(turn)], axis=1)
    way = np.concatenate([np.linspace([0.0, 0.0, 0.0], bend[0], 20)[:-1], bend])
    duct, wire = (
        RoundCones(way, np.full(len(way), 5.0)),
        Wire(diameter=1.0, modulus=60e3, density=6450.0),
    )
    section = Section(length=180.0, radius=2.0, discs=29, wire=wire, line_weight=2e-4)
    model = ContactModel(ContinuumRobot((section,)), duct, options=COARSE)
    times = np.linspace(0.0, 0.85, 18)
    robot, base = push_in(model, way, times=times, speed=120.0)
    options = dataclasses.replace(FALLING, max_step=5e-3)
    found = simulate(
        robot, times, base=base, duct=duct, contact=SOFT, introducer=180.0, options=options
    )
    balance = found.energy
    assert found.converged and balance.walls.max() > 0.5
    gained = balance.residual - np.minimum.accumulate(balance.residual)
    assert gained.max() < 0.011 * max(balance.total.max(), balance.work.max())


def test_a_robot_that_starts_a_little_in_a_wall_has_the_energy_from_it() -> None:
    times, tub = np.linspace(0.0, 0.5, 6), Tub(half=17.9)
    moved = simulate(make_level_arm(), times, options=FALLING, duct=tub, contact=SOFT)
    assert moved.energy.walls[0] > 0.01 and moved.gaps[0].min() < -0.5
    assert not moved.notes and moved.energy.gain.max() < 1e-6  # steps in a wall lose it


def test_a_robot_that_starts_in_a_wall_is_refused() -> None:
    with pytest.raises(GeometryError, match="deep in a wall"):
        simulate(make_level_arm(), [0.0, 0.1], options=FALLING, duct=Tub(half=2.0), contact=SOFT)


def test_result_is_told_in_every_way() -> None:
    moved = simulate(make_arm(), [0.0, 0.01, 0.02], tensions=[1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert len(repr(moved)) < 2000 and moved.to_dict()["tip_mm"][0] == moved.tip[0].tolist()
    table = moved.to_frame()
    assert len(table) == 3 and {"time_s", "tip_x_mm", "00_N", "work_N_mm"} <= set(table)
    assert len(moved.plot().lines) == 3
    found = linearise(make_arm())
    assert found.to_frame()["frequency_Hz"].is_monotonic_increasing
    assert len(found.plot().lines) == 6


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ("times", {"times": [0.0]}),
        (r"times\[1\] is 0 s, after 0 s", {"times": [0.0, 0.0]}),
        ("command one", {"tensions": np.zeros(6), "displacements": np.zeros(6)}),
        ("commands have shape", {"tensions": np.zeros((3, 6))}),
        ("cable does not push", {"tensions": -np.ones(6)}),
        ("load_factors", {"load_factors": np.ones((2, 3))}),
        ("base has shape", {"base": np.eye(4)}),
        ("no command 'force'", {"force": 1.0}),
        ("steps", {"options": DynamicsOptions(max_step=1e-12)}),
    ],
)
def test_what_does_not_fit_is_refused(words: str, changes: dict[str, object]) -> None:
    with pytest.raises(InputError, match=words):
        simulate(make_arm(), **{"times": [0.0, 1.0], **changes})


def test_robots_that_cannot_be_simulated_are_refused() -> None:
    light = ContinuumRobot((Section(length=10.0, radius=1.0),))
    with pytest.raises(GeometryError, match="without mass"):
        simulate(light, [0.0, 1.0])
    with pytest.raises(InputError, match="does not stretch"):
        simulate(make_arm(stiffness=math.inf), [0.0, 1.0], displacements=np.zeros(6))
    for wrong in (
        {"damping_time": -1.0},
        {"gravity": (0.0, 1.0)},
        {"spectral_radius": 1.1},
        {"max_step": 0.0},
    ):
        with pytest.raises(InputError):
            DynamicsOptions(**wrong)
