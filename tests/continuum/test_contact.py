"""An elastic robot against walls: closed forms of beams, buckling in tubes, energy and friction."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    ContactShape,
    ContinuumRobot,
    EnergyModel,
    LineLoad,
    PointLoad,
    RobotDesign,
    Section,
    Tendon,
)
from bozzini.duct import Circles, Duct, RoundCones, SuperEllipses
from bozzini.errors import InputError


@dataclass(frozen=True, eq=False)
class Floor(Duct):
    """All above a height."""

    height: float = 0.0

    @property
    def bounds(self) -> NDArray[np.float64]:
        return np.array([[-1e3, -1e3, self.height], [1e3, 1e3, 1e3]])

    def signed_distance(self, points: ArrayLike, /) -> NDArray[np.float64]:
        return self.height - np.asarray(points)[..., 2]


@dataclass(frozen=True, eq=False)
class Tube(Duct):
    """An endless tube along x."""

    radius: float

    @property
    def bounds(self) -> NDArray[np.float64]:
        return np.array([[-1e4, -self.radius, -self.radius], [1e4, self.radius, self.radius]])

    def signed_distance(self, points: ArrayLike, /) -> NDArray[np.float64]:
        return np.hypot(*np.moveaxis(np.asarray(points)[..., 1:], -1, 0)) - self.radius


ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Base that looks along x."""


def make_rod(length: float, stiffness: float, *, weight: float = 0.0) -> RobotDesign:
    section = Section(length=length, radius=1.0, bending_stiffness=stiffness, line_weight=weight)
    return RobotDesign((section,), base_rotation=ALONG_X)


def make_rod_with_tendons() -> RobotDesign:
    tendons = tuple(Tendon(name=f"T{k}", offset=1.0, angle=k * np.pi) for k in range(2))
    section = Section(length=100.0, radius=1.5, tendons=tendons, bending_stiffness=1000.0)
    return RobotDesign((section,))


def check_balance(shape: ContactShape) -> None:
    assert shape.converged, shape.reason
    assert shape.imbalance < 1e-6
    assert shape.residual < 1e-6


@pytest.mark.slow
def test_a_heavy_beam_lies_down_as_the_linear_beam_does() -> None:
    # Clamped at height h over a floor: lifted over a = (72 EI h / w)^(1/4), with w a / 3 at the
    # place of touch-down (EI y'''' = -w, and y = y' = y'' = 0 there).
    stiffness, weight, free = 1000.0, 0.002, 100.0
    height = weight * free**4 / (72.0 * stiffness)
    robot = replace(
        make_rod(200.0, stiffness, weight=weight), base_position=(0.0, 0.0, height + 1.0)
    )
    model = ContactModel(robot, Floor(), options=ContactOptions(segment_length=2.0))
    shape = model.shape()
    check_balance(shape)
    first = shape.arc_length[np.argmax(shape.normal_forces > 0.0)]
    assert first == pytest.approx(free, abs=3.0)
    assert shape.base_force[2] == pytest.approx(2.0 / 3.0 * weight * free, rel=0.02)
    assert shape.resultant[2] == pytest.approx(weight * (200.0 - 2.0 / 3.0 * free), rel=0.01)
    np.testing.assert_allclose(shape.base_force + shape.loads + shape.resultant, 0.0, atol=1e-12)
    far = shape.arc_length > 130.0
    assert np.all(np.abs(shape.gaps[far]) < 1e-6)


def test_the_base_carries_how_the_energy_changes_with_its_place() -> None:
    # The base's force is stated from the sum of all others; the energy knows nothing of that.
    load = np.array([0.0, 0.0, -0.05])
    robot = make_rod(100.0, 300.0)

    def press(height: float) -> tuple[ContactShape, float]:
        placed = replace(robot, base_position=(0.0, 0.0, height))
        model = ContactModel(placed, Floor(), loads=(PointLoad(force=tuple(load), frame="world"),))
        shape = model.shape()
        check_balance(shape)
        return shape, shape.energy - float(load @ shape.tip)

    middle, _ = press(5.0)
    low, high = press(4.99)[1], press(5.01)[1]
    assert middle.resultant[2] > 0.02
    assert middle.base_force[2] == pytest.approx((high - low) / 0.02, rel=1e-4)


def test_a_tube_stops_the_tip_of_a_cantilever() -> None:
    stiffness, length, load = 200.0, 100.0, 0.05
    load_at = PointLoad(force=(0.0, load, 0.0), frame="world")
    robot = make_rod(length, stiffness)
    shape = ContactModel(robot, Tube(2.0), loads=(load_at,)).shape()
    check_balance(shape)
    # The gap of 1 mm takes 3 EI g / L^3, the wall the rest.
    wanted = load - 3.0 * stiffness * 1.0 / length**3
    assert shape.normal_forces[-1] == pytest.approx(wanted, rel=1e-3)
    assert shape.resultant[1] == pytest.approx(-wanted, rel=1e-3)


def test_a_soft_wall_is_as_deep_as_its_stiffness_says() -> None:
    weight, wall = 0.01, 0.5
    robot = replace(make_rod(60.0, 5.0, weight=weight), base_position=(0.0, 0.0, 1.0))
    options = ContactOptions(wall_stiffness=wall, segment_length=1.5)
    shape = ContactModel(robot, Floor(), options=options).shape()
    check_balance(shape)
    inner = (shape.arc_length > 25.0) & (shape.arc_length < 45.0)
    np.testing.assert_allclose(-shape.gaps[inner], weight / wall, rtol=1e-2)


def find_critical_load(stiffness: float, weight: float, gap: float) -> float:
    """Load at which a long rod on the floor of a tube buckles: its stability goes to zero."""
    wave = 2.0 * np.pi * (stiffness * gap / weight) ** 0.25
    length = 4.0 * wave
    robot = make_rod(length, stiffness)
    robot = replace(robot, base_position=(0.0, 0.0, -gap))
    # A much heavier end keeps the tip from swinging, as a neighbour in an endless rod would.
    heavy = LineLoad(force=(0.0, 0.0, -30.0 * weight), start=0.95 * length, frame="world")
    even = LineLoad(force=(0.0, 0.0, -weight), frame="world")
    options = ContactOptions(segment_length=wave / 16.0)
    shape: ContactShape | None = None

    def lean(load: float) -> float:
        nonlocal shape
        push = PointLoad(force=(-load, 0.0, 0.0), frame="world")
        model = ContactModel(robot, Tube(gap + 1.0), loads=(heavy, even, push), options=options)
        shape = model.shape(initial=shape)
        check_balance(shape)
        straight = np.abs(shape.points[:, 1]).max() < 1e-3 * gap
        return shape.stability if straight else -1.0

    scale = 2.0 * np.sqrt(stiffness * weight / gap)
    shape = None
    below, above = 0.8 * scale, 1.3 * scale
    assert lean(below) > 0.0
    for _ in range(7):
        middle, before = 0.5 * (below + above), shape
        if lean(middle) > 0.0:
            below = middle
        else:
            above, shape = middle, before
    return 0.5 * (below + above)


@pytest.mark.slow
def test_a_rod_in_a_tube_buckles_sideways_at_the_load_of_paslay_and_dawson() -> None:
    # Dawson and Paslay 1984, J. Petroleum Technology 36(10), 1734: 2 sqrt(EI w / r).
    stiffness, weight, gap = 500.0, 0.01, 2.0
    found = find_critical_load(stiffness, weight, gap)
    assert found == pytest.approx(2.0 * np.sqrt(stiffness * weight / gap), rel=0.05)


def make_helix(length: float, stiffness: float, bend: float, rate: float) -> RobotDesign:
    """A rod along x that wants to wind by ``rate`` [rad/mm], with ``bend`` [1/mm] after a turn."""
    places = np.linspace(0.0, length, 200)
    bends = bend * np.minimum(1.0, rate * places / (2.0 * np.pi))
    ways = rate * places
    table = np.stack([places, bends * np.cos(ways), bends * np.sin(ways), 0.0 * places], axis=1)
    (section,) = make_rod(length, stiffness).sections
    bent = replace(section, curvature=tuple(map(tuple, table.tolist())))
    return RobotDesign((bent,), base_rotation=ALONG_X)


@pytest.mark.slow(60)
def test_a_rod_in_a_tube_winds_to_a_helix_at_the_load_of_chen_lin_and_cheatham() -> None:
    # Chen, Lin and Cheatham 1990, J. Energy Resources Technology 112(3), 176: at 2 sqrt(2 EI w / r)
    # the helix has the energy of the rod that lies on the floor; Lubinski et al. 1962, J. Petroleum
    # Technology 14(6), 655: it winds by sqrt(F / 2 EI); Mitchell 1988, SPE Drilling Engineering
    # 3(3), 303: it presses by r F^2 / 4 EI per length.
    stiffness, weight, gap, wall = 500.0, 0.01, 2.0, 5.0
    critical = np.sqrt(8.0 * stiffness * weight / gap)
    pitch = 2.0 * np.pi * np.sqrt(2.0 * stiffness / critical)
    options = ContactOptions(segment_length=pitch / 20.0, wall_stiffness=wall)
    even = LineLoad(force=(0.0, 0.0, -weight), frame="world")

    def raise_energy(load: float, length: float) -> float:
        """Energy of the helix above that of the straight rod on the floor [N mm]."""
        push = PointLoad(force=(-load, 0.0, 0.0), frame="world")
        rate = np.sqrt(0.5 * load / stiffness)
        shape: ContactShape | None = None
        # The bend that it is made with is taken away.
        for share in (1.3, 0.4, 0.0):
            robot = make_helix(length, stiffness, share * gap * rate**2, rate)
            model = ContactModel(robot, Tube(gap + 1.0), loads=(even, push), options=options)
            # Each call takes at most so many steps; the helix turns round far.
            for _ in range(4):
                shape = model.shape(initial=shape)
                if shape.converged:
                    break
            assert shape is not None and shape.converged, shape
        check_balance(shape)
        inner = (shape.arc_length > pitch) & (shape.arc_length < length - pitch)
        places = shape.arc_length[inner]
        turned = np.unwrap(np.arctan2(*shape.points[inner, :0:-1].T))
        winds = (turned[-1] - turned[0]) / (places[-1] - places[0])
        assert winds == pytest.approx(rate, rel=0.03)
        spacing = float(np.diff(shape.arc_length)[0])
        pressed = shape.normal_forces[inner].mean() / spacing
        assert pressed == pytest.approx(0.25 * gap * load**2 / stiffness, rel=0.05)
        heights = 0.5 * (shape.points[1:, 2] + shape.points[:-1, 2])
        lifted = weight * spacing * float(np.sum(heights + gap))
        sunk = 0.5 * float(np.sum(shape.normal_forces**2)) / (wall * spacing)
        return float(shape.energy + lifted + sunk - load * (length - shape.tip[0]))

    # Two turns more leave out what the ends do.
    loads = critical * np.array([0.95, 1.02])
    low, high = (raise_energy(f, 5.0 * pitch) - raise_energy(f, 3.0 * pitch) for f in loads)
    assert low > 0.0 > high
    found = loads[0] + (loads[1] - loads[0]) * low / (low - high)
    assert found == pytest.approx(critical, rel=0.03)


def solve_chain(
    links: int, length: float, offset: float, pull: float, circle: tuple[float, float, float]
) -> NDArray[np.float64]:
    """Joints (links + 1, 2) of the thesis's linkage in a plane, around a circle.

    Least sum of squared coupler angles, as in the thesis's (5.7), for one cable as long in all as
    commanded, with (5.14)'s ``(x - xc)^2 + (y - yc)^2 - r^2 >= 0`` at each joint.
    """
    step = length / links
    x, y, radius = circle

    def place(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        ways = np.cumsum(angles) - 0.5 * angles
        ends = step * np.stack([np.cos(ways), np.sin(ways)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(ends, axis=0)])

    found = minimize(
        lambda angles: float(np.sum(angles**2)),
        np.full(links, pull / offset / links),
        jac=lambda angles: 2.0 * angles,
        method="SLSQP",
        constraints=(
            # A cable at the offset a is shorter by 2 a sin(angle / 2) in each link.
            {"type": "eq", "fun": lambda a: 2.0 * offset * np.sum(np.sin(0.5 * a)) - pull},
            {
                "type": "ineq",
                "fun": lambda a: np.sum((place(a)[1:] - (x, y)) ** 2, axis=1) - radius**2,
            },
        ),
        options={"maxiter": 500, "ftol": 1e-12},
    )
    assert found.success, found.message
    return place(found.x)


@pytest.mark.slow
def test_around_a_circle_it_is_the_chain_of_the_thesis() -> None:
    length, offset, pull, radius = 100.0, 4.0, 4.0, 1.0
    circle = (55.0, 22.0, 12.0)
    tendon = Tendon(name="T1", offset=offset, angle=np.pi / 2.0)
    section = Section(length=length, radius=radius, tendons=(tendon,), bending_stiffness=300.0)
    # Bending towards +y about a circle there; the free shape would run through it.
    robot = RobotDesign((replace(section, radius=4.0),), base_rotation=ALONG_X)
    wall = Circles(np.array([circle[:2]]), np.array([circle[2]]))
    options = ContactOptions(segment_length=2.5)
    shape = ContactModel(robot, obstacles=(wall,), options=options).shape({"T1": pull})
    check_balance(shape)
    assert shape.normal_forces.max() > 0.0
    # The body's radius is added to the circle's, as the chain has none.
    chain = solve_chain(40, length, offset, pull, (*circle[:2], circle[2] + 4.0))
    np.testing.assert_allclose(shape.points[:, :2], chain, atol=0.01 * length)
    np.testing.assert_allclose(shape.points[:, 2], 0.0, atol=1e-6)
    away = np.hypot(*(shape.points[:, :2] - circle[:2]).T) - circle[2] - 4.0
    assert away.min() == pytest.approx(0.0, abs=1e-4)


def test_without_contact_it_is_the_shape_of_energy() -> None:
    tendons = tuple(
        Tendon(name=f"t{k}", offset=3.0, angle=0.5 * np.pi * k, stiffness=1e4) for k in range(4)
    )
    section = Section(
        length=80.0,
        radius=4.0,
        discs=20,
        tendons=tendons,
        curvature=((0.0, 0.004, 0.0, 0.0), (80.0, 0.01, 0.005, 0.002)),
        line_weight=1e-4,
    )
    robot = ContinuumRobot((section,), base_rotation=ALONG_X)
    pulled = [2.0, 0.0, np.nan, np.nan]
    free = EnergyModel(robot, segment="channel").shape(pulled).require()
    found = ContactModel(robot, Tube(500.0), options=ContactOptions(segment_length=4.0))
    shape = found.shape(pulled)
    check_balance(shape)
    np.testing.assert_allclose(shape.tip, free.world_points[-1], atol=1e-4)
    np.testing.assert_allclose(shape.tensions, free.tensions, atol=1e-4)


def make_tensed(**options: float) -> RobotDesign:
    robot = make_cabled()
    (section,) = robot.sections
    tendons = tuple(replace(tendon, **options) for tendon in section.tendons)
    return replace(robot, sections=(replace(section, tendons=tendons),))


FAR = Circles(np.array([[1e3, 0.0]]), np.array([10.0]))
PUSHED = (PointLoad(force=(0.02, 0.03, -0.02)),)
COARSE = ContactOptions(segment_length=3.0)


@pytest.mark.parametrize("pulled", [[np.nan] * 3, [0.4, np.nan, -0.1]])
def test_pretension_is_that_of_energy(pulled: list[float]) -> None:
    robot = make_tensed(stiffness=2e3, pretension=0.7)
    free = EnergyModel(robot, segment="channel", loads=PUSHED).shape(pulled).require()
    shape = ContactModel(robot, obstacles=(FAR,), loads=PUSHED, options=COARSE).shape(pulled)
    check_balance(shape)
    np.testing.assert_allclose(shape.tip, free.world_points[-1], atol=1e-5)
    np.testing.assert_allclose(shape.tensions, free.tensions, atol=1e-5)
    rigid = ContactModel(make_tensed(pretension=0.7), obstacles=(FAR,))
    with pytest.raises(InputError, match="'T0' has a pretension, and does not stretch"):
        rigid.shape([0.1, np.nan, np.nan])


@pytest.mark.parametrize(
    ("travel", "most", "reason"),
    [
        ((-1.0, 1.0), np.inf, "tendon 't0' is moved 2 mm: its travel is [-1, 1] mm"),
        ((-np.inf, np.inf), 0.4, "its largest bend is"),
    ],
)
def test_limits_of_drives_and_sections_hold_among_walls(travel, most, reason) -> None:
    tendon = Tendon(name="t0", offset=3.0, angle=0.0, stiffness=1e4, travel=travel)
    section = Section(
        length=80.0, radius=4.0, tendons=(tendon,), bending_stiffness=300.0, max_bend=most
    )
    shape = ContactModel(RobotDesign((section,)), Floor(-200.0)).shape([2.0])
    assert not shape.converged and shape.settled
    assert reason in shape.reason


def test_a_tension_beyond_its_limit_has_not_converged() -> None:
    robot = make_tensed(tension_limit=1.0)
    model = ContactModel(robot, obstacles=(FAR,), options=COARSE)
    assert model.shape_under_tensions([1.0, 0.0, 0.0]).converged
    over = model.shape_under_tensions([1.0, 1.2, 0.0])
    assert not over.converged
    free = EnergyModel(robot, segment="channel").shape_under_tensions([1.0, 1.2, 0.0])
    assert over.reason == str(free.reason)


@pytest.mark.parametrize(
    "pulled", [[0.5, -0.5, 0.0], pytest.param([0.5, -0.25, -0.25], marks=pytest.mark.slow)]
)
def test_exact_lengths_of_all_tendons_take_the_least_tensions(pulled: list[float]) -> None:
    robot = make_cabled()
    free = EnergyModel(robot, segment="channel").shape(pulled).require()
    shape = ContactModel(robot, obstacles=(FAR,), options=COARSE).shape(pulled)
    check_balance(shape)
    np.testing.assert_allclose(shape.tip, free.world_points[-1], atol=1e-4)
    np.testing.assert_allclose(shape.tensions, free.tensions, atol=1e-4)
    # Under a load that twists it there is no finite tension that holds them.
    locked = ContactModel(robot, obstacles=(FAR,), loads=PUSHED, options=COARSE).shape(pulled)
    assert not locked.converged
    found = re.search(r"with a stiffness of (\S+) N", locked.reason)
    assert found is not None
    soft = make_tensed(stiffness=float(found[1]))
    free = EnergyModel(soft, segment="channel", loads=PUSHED).shape(pulled).require()
    shape = ContactModel(soft, obstacles=(FAR,), loads=PUSHED, options=COARSE).shape(pulled)
    check_balance(shape)
    np.testing.assert_allclose(shape.tip, free.world_points[-1], atol=1e-4)


def solve_by_slsqp(
    robot: RobotDesign, load: NDArray[np.float64], segments: int, radius: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tip and the wall's force on it of a chain of arcs in a plane under a tip force, by SciPy.

    Turns about z of arcs in the plane of x and y from a base that looks along x; each joint within
    ``radius`` of the axis of x.
    """
    section = robot.sections[0]
    span = section.length / segments
    stiff = section.bending_stiffness / span

    def place(turns: NDArray[np.float64]) -> NDArray[np.float64]:
        before = np.concatenate([[0.0], np.cumsum(turns)[:-1]])
        chord = span * np.sinc(0.5 * turns / np.pi)
        ways = before + 0.5 * turns
        return np.cumsum(chord[:, None] * np.stack([np.cos(ways), np.sin(ways)], axis=1), axis=0)

    found = minimize(
        lambda turns: 0.5 * stiff * float(turns @ turns) - float(load @ place(turns)[-1]),
        np.zeros(segments),
        method="SLSQP",
        constraints=(
            {"type": "ineq", "fun": lambda turns: radius - place(turns)[:, 1]},
            {"type": "ineq", "fun": lambda turns: radius + place(turns)[:, 1]},
        ),
        options={"maxiter": 500, "ftol": 1e-13},
    )
    assert found.success, found.message
    return found.x, place(found.x)


def test_a_general_optimiser_finds_the_same_shape() -> None:
    load, segments, gap = np.array([-0.02, 0.05]), 10, 3.0
    robot = make_rod(60.0, 100.0)
    force = PointLoad(force=(*load, 0.0), frame="world")
    options = ContactOptions(segment_length=6.0, smoothing=1e-3)
    shape = ContactModel(robot, Tube(gap + 1.0), loads=(force,), options=options).shape()
    check_balance(shape)
    turns, places = solve_by_slsqp(robot, load, segments, gap)
    np.testing.assert_allclose(shape.points[1:, :2], places, atol=1e-4)
    energy = 0.5 * 100.0 / 6.0 * float(turns @ turns)
    assert shape.energy == pytest.approx(energy, rel=1e-4)
    assert np.count_nonzero(shape.normal_forces) == np.count_nonzero(
        np.abs(places[:, 1]) > gap - 1e-6
    )


FOLLOWERS = (
    PointLoad(force=(0.03, 0.02, -0.02), moment=(1.0, 0.5, 0.7), frame="body"),
    PointLoad(arc_length=33.0, moment=(0.0, 1.0, 0.0), frame="world"),
    LineLoad(force=(0.0, 0.0005, 0.0), frame="body"),
)
"""Loads without a potential."""


def make_cabled(stiffness: float = 200.0, length: float = 60.0) -> RobotDesign:
    tendons = tuple(Tendon(name=f"T{k}", offset=0.8, angle=k * 2 * np.pi / 3) for k in range(3))
    section = Section(
        length=length, radius=1.0, tendons=tendons, bending_stiffness=stiffness, discs=20
    )
    return RobotDesign((section,), base_rotation=ALONG_X)


@pytest.mark.parametrize("loads", [FOLLOWERS, (PointLoad(force=(0.05, 0.0, -0.1)),)])
def test_far_from_walls_it_is_the_energy_model(loads: tuple[PointLoad | LineLoad, ...]) -> None:
    robot = make_cabled()
    far = Circles(np.array([[1e3, 0.0]]), np.array([10.0]))
    options = ContactOptions(segment_length=3.0)
    shape = ContactModel(robot, obstacles=(far,), loads=loads, options=options).shape({"T0": 1.0})
    free = EnergyModel(robot, segment="channel", loads=loads).shape([np.nan] * 3)
    pulled = EnergyModel(robot, segment="channel", loads=loads).shape([1.0, np.nan, np.nan])
    check_balance(shape)
    np.testing.assert_allclose(shape.tip, pulled.world_points[-1], atol=1e-5)
    np.testing.assert_allclose(shape.tensions, pulled.tensions, atol=1e-4)
    shape = ContactModel(robot, obstacles=(far,), loads=loads, options=options).shape()
    np.testing.assert_allclose(shape.tip, free.world_points[-1], atol=1e-6)
    assert shape.stability == pytest.approx(float(free.stability), rel=1e-5)


def check_contact(shape: ContactShape, walls: tuple[Duct, ...], obstacles: bool) -> None:
    """What holds of every shape that has converged on rigid walls without friction."""
    check_balance(shape)
    size = np.abs(shape.normal_forces).max(initial=0.0) + 1e-12
    assert np.all(shape.gaps > -1e-6)
    # Complementarity: a force only where there is no gap, and along the wall's normal.
    assert np.all(shape.normal_forces * np.clip(shape.gaps, 0.0, 1.0) <= 1e-6 * size)
    for wall in walls:
        sign = 1.0 if obstacles else -1.0
        distance = sign * wall.signed_distance(shape.points[:, : wall.dim]) - shape.robot.radius
        assert np.all(distance > -0.1 * shape.robot.radius)
        on = shape.normal_forces > 1e-3 * size
        ahead = wall.signed_distance((shape.points + 1e-3 * shape.forces / size)[on][:, : wall.dim])
        # It never pulls: along the force the wall gets farther away.
        assert np.all(sign * ahead - shape.robot.radius > distance[on])
    total = shape.base_force + shape.loads + shape.resultant
    np.testing.assert_allclose(total, 0.0, atol=1e-6 * (size + np.abs(shape.loads).max()))


def test_the_base_holds_the_moment_of_all_forces_as_it_is_bent() -> None:
    # The moment by the forces' arms, and that by the backbone's bend in its first segment.
    robot, step = make_rod(80.0, 150.0), 2.0
    loads = (PointLoad(force=(0.01, 0.06, 0.02), moment=(0.0, 0.0, 1.0), frame="body"),)
    options = ContactOptions(segment_length=step)
    shape = ContactModel(robot, Tube(4.0), loads=loads, options=options).shape()
    check_contact(shape, (Tube(4.0),), obstacles=False)
    assert shape.normal_forces.max() > 0.01
    arm = 0.5 * (shape.points[1] - shape.points[0])
    moment = shape.base_moment - np.cross(arm, shape.base_force)
    bend = np.cross(shape.tangents[0], shape.tangents[1]) * 150.0 / step
    np.testing.assert_allclose(-moment[1:], bend[1:], atol=1e-2 * np.linalg.norm(bend))
    # The tip's axis, about which the moment acts there, is almost that of the base.
    assert abs(moment[0]) == pytest.approx(1.0, rel=1e-3)


@settings(max_examples=4, derandomize=True, deadline=None)
@given(
    stiffness=st.floats(50.0, 500.0),
    gap=st.floats(0.5, 4.0),
    load=st.tuples(*[st.floats(-0.08, 0.08)] * 3),
    pull=st.floats(0.0, 0.6),
    follows=st.booleans(),
)
def test_no_shape_in_a_tube_that_has_converged_is_in_its_wall(
    stiffness: float, gap: float, load: tuple[float, float, float], pull: float, follows: bool
) -> None:
    check_random_tube(stiffness, gap, load, pull, follows)


def check_random_tube(
    stiffness: float, gap: float, load: tuple[float, float, float], pull: float, follows: bool
) -> None:
    robot, tube = make_cabled(stiffness), Tube(1.0 + gap)
    force = PointLoad(force=load, frame="body" if follows else "world")
    options = ContactOptions(segment_length=3.0)
    shape = ContactModel(robot, tube, loads=(force,), options=options).shape({"T1": pull})
    if shape.converged:
        check_contact(shape, (tube,), obstacles=False)
    else:
        assert shape.reason


@pytest.mark.slow
@settings(max_examples=30, derandomize=True, deadline=None)
@given(
    stiffness=st.floats(20.0, 1000.0),
    gap=st.floats(0.2, 6.0),
    load=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    pull=st.floats(0.0, 1.5),
    follows=st.booleans(),
)
def test_no_shape_in_any_tube_that_has_converged_is_in_its_wall(
    stiffness: float, gap: float, load: tuple[float, float, float], pull: float, follows: bool
) -> None:
    check_random_tube(stiffness, gap, load, pull, follows)


@pytest.mark.slow
@settings(max_examples=30, derandomize=True, deadline=None)
@given(
    stiffness=st.floats(50.0, 500.0),
    place=st.tuples(st.floats(15.0, 70.0), st.floats(4.0, 14.0)),
    axes=st.tuples(st.floats(0.3, 8.0), st.floats(0.3, 8.0)),
    pull=st.floats(0.0, 1.5),
    segment=st.floats(1.0, 6.0),
)
def test_no_shape_about_a_super_ellipse_that_has_converged_is_in_it(
    stiffness: float,
    place: tuple[float, float],
    axes: tuple[float, float],
    pull: float,
    segment: float,
) -> None:
    tendon = Tendon(name="T1", offset=0.8, angle=np.pi / 2.0)
    section = Section(length=60.0, radius=1.0, tendons=(tendon,), bending_stiffness=stiffness)
    robot = RobotDesign((section,), base_rotation=ALONG_X)
    wall = SuperEllipses(
        np.array([place]), np.array([axes]), powers=np.array([4.0]), angles=np.array([0.3])
    )
    if wall.signed_distance(np.zeros(2)) < 1.0:
        return
    options = ContactOptions(segment_length=segment)
    shape = ContactModel(robot, obstacles=(wall,), options=options).shape({"T1": pull})
    if shape.converged:
        check_contact(shape, (wall,), obstacles=True)
        assert shape.depth <= 0.1
    else:
        assert shape.reason


def test_a_thin_wall_between_stations_is_not_passed_silently() -> None:
    # A needle of 0.2 mm on the free shape, between two stations that are 6 mm apart.
    robot, pull = make_rod(60.0, 100.0), PointLoad(force=(0.0, 0.02, 0.0), frame="world")

    def meet(centre: NDArray[np.float64], step: float) -> ContactShape:
        needle = Circles(centre[None], np.array([0.1]))
        options = ContactOptions(segment_length=step)
        return ContactModel(robot, obstacles=(needle,), loads=(pull,), options=options).shape()

    free = meet(np.array([1e3, 0.0]), 6.0)
    between = free.points[8:10, :2].mean(axis=0)
    rough, fine = meet(between, 6.0), meet(between, 1.0)
    assert fine.converged and fine.normal_forces.max() > 0.0 and fine.depth < 0.1
    assert not rough.converged
    assert rough.depth > 0.5 and "take a smaller segment_length" in rough.reason


def test_a_base_outside_the_lumen_is_said_to_stand_in_the_wall() -> None:
    def place(height: float) -> ContactShape:
        robot = replace(make_rod(60.0, 100.0), base_position=(0.0, 0.0, height))
        return ContactModel(robot, Tube(3.0), options=ContactOptions(segment_length=3.0)).shape()

    assert place(1.9).converged
    for height in (2.5, 6.0, 500.0):
        shape = place(height)
        assert not shape.converged
        words = f"the base stands in a wall: at (0, 0, {height:g}) mm the body, of radius 1 mm, is "
        assert shape.reason == f"{words}{height - 2.0:.3g} mm in it"


def test_the_argument_that_is_wrong_is_named() -> None:
    model = ContactModel(make_rod_with_tendons(), obstacles=(FAR,))
    for solve, name in ((model.shape, "displacement"), (model.shape_under_tensions, "tension")):
        with pytest.raises(InputError, match=rf"{name}s have shape \(1,\): they must be \(2,\)"):
            solve([1.0])
        for infinite in ([np.inf, 0.0], {"T0": np.inf}):
            with pytest.raises(InputError, match=rf"{name} of tendon 'T0' is inf: it must be fin"):
                solve(infinite)
    with pytest.raises(InputError, match="tension of tendon 'T1' is nan"):
        model.shape_under_tensions([1.0, np.nan])


def test_friction_is_in_its_cone_and_against_the_slip() -> None:
    robot, share = make_rod(60.0, 100.0), 0.3
    options = ContactOptions(segment_length=3.0, friction=share)

    def press(side: float, before: ContactShape | None) -> ContactShape:
        load = PointLoad(force=(0.0, 0.08 - side, side), frame="world")
        shape = ContactModel(robot, Tube(3.0), loads=(load,), options=options).shape(initial=before)
        assert shape.converged, shape.reason
        return shape

    first = press(0.0, None)
    second = press(0.05, first)
    on = second.normal_forces > 0.0
    assert on.any()
    outward = second.points[on] * (0.0, 1.0, 1.0)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    normal = np.sum(second.forces[on] * outward, axis=1)
    rub = second.forces[on] - normal[:, None] * outward
    assert np.all(-normal > 0.0)
    assert np.all(np.linalg.norm(rub, axis=1) <= share * -normal * (1.0 + 1e-3) + 1e-9)
    slip = (second.points - first.points)[on]
    slip -= np.sum(slip * outward, axis=1)[:, None] * outward
    slides = np.linalg.norm(slip, axis=1) > options.slip
    assert slides.any()
    assert np.all(np.sum(rub * slip, axis=1) <= 0.0)
    sizes = np.linalg.norm(rub[slides], axis=1) * np.linalg.norm(slip[slides], axis=1)
    np.testing.assert_allclose(np.sum(rub * slip, axis=1)[slides], -sizes, rtol=1e-3)


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_scene_that_is_moved_by_metres_has_the_same_forces(friction: float) -> None:
    section = make_rod_with_tendons().sections[0]
    options = ContactOptions(segment_length=5.0, friction=friction)

    def press(turn: NDArray[np.float64], shift: NDArray[np.float64]) -> ContactShape:
        robot = RobotDesign(
            (section,),
            base_position=turn @ (10.0, 5.0, 3.0) + shift,
            base_rotation=turn @ ALONG_X,
        )
        line = np.array([[-100.0, 5.0, 3.0], [300.0, 5.0, 3.0]]) @ turn.T + shift
        load = PointLoad(
            arc_length=50.0, force=tuple(turn @ np.array([0.0, 0.01, -0.09])), frame="world"
        )
        tube = RoundCones(line, np.full(2, 2.5))
        model = ContactModel(robot, tube, loads=(load,), options=options)
        first = model.shape_under_tensions({"T0": 0.5})
        check_balance(first)
        second = model.shape_under_tensions({"T0": 2.0}, initial=first)
        check_balance(second)
        return second

    near = press(np.eye(3), np.zeros(3))
    assert near.normal_forces.max() > 0.01
    turn = Rotation.from_rotvec([0.3, 1.1, -0.7]).as_matrix()
    # What is left of a turn is that of the lattice on which the wall is made smooth.
    for turned, close in ((np.eye(3), 1e-7), (turn, 1e-4)):
        far = press(turned, np.array([0.0, 5000.0, -3000.0]))
        largest = float(near.normal_forces.max())
        np.testing.assert_allclose(far.normal_forces, near.normal_forces, atol=close * largest)
        np.testing.assert_allclose(far.forces @ turned, near.forces, atol=10 * close * largest)
        assert far.stability == pytest.approx(near.stability, rel=close)
        assert far.push_force == pytest.approx(near.push_force, abs=1e-3 * largest)


def test_a_wall_holds_a_rod_that_would_buckle() -> None:
    # Clamped and free it buckles at 2.47 EI / L^2; on a wall that it is pressed against, its tip
    # cannot leave that way, and the stability is that of the motions that are left.
    stiffness, length = 100.0, 60.0
    euler = 0.25 * np.pi**2 * stiffness / length**2
    robot = make_rod(length, stiffness)
    push = PointLoad(force=(-1.5 * euler, 0.0, 0.0), frame="world")
    side = PointLoad(force=(0.0, 0.02, 0.0), frame="world")
    options = ContactOptions(segment_length=3.0)
    free, pushed = (
        ContactModel(robot, Tube(2.0), loads=loads, options=options).shape()
        for loads in ((side,), (side, push))
    )
    check_balance(free)
    assert free.stable and pushed.stable == pushed.converged
    # A bend alone, without load: as stiff as at rest. Pressed in, it is less.
    assert free.stability > pushed.stability > 0.0


def test_a_body_that_meets_itself_is_reported() -> None:
    section = replace(make_rod(120.0, 50.0).sections[0], curvature=(0.06, 0.0, 0.0))
    robot = RobotDesign((section,), base_rotation=ALONG_X)
    options = ContactOptions(segment_length=4.0)
    shape = ContactModel(robot, obstacles=(FAR,), options=options).shape()
    assert shape.self_distance < 0.0
    assert not shape.converged and "meets itself" in shape.reason
    apart = np.linalg.norm(
        np.diff([np.interp(shape.self_places, shape.arc_length, x) for x in shape.points.T], axis=1)
    )
    assert apart - 2.0 == pytest.approx(shape.self_distance, abs=1e-6)
