"""An elastic robot against walls: closed forms of beams, buckling in tubes, energy and friction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    ContactShape,
    LineLoad,
    PointLoad,
    RobotDesign,
    Section,
    Tendon,
)
from bozzini.duct import Circles, Duct


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
