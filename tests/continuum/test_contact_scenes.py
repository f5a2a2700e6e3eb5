"""Rods in tubes: the pitch of a helix, and the load from which a heavy rod winds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    ContactShape,
    LineLoad,
    PointLoad,
)
from tests.continuum.test_contact import Tube, check_balance, make_rod

STIFFNESS = 500.0
"""Of the rods in tubes [N mm^2]."""


@dataclass(frozen=True)
class Wave:
    """An angle around the tube's axis over the length: a helix, or to and fro."""

    length: float
    amplitude: float | None = None

    def angle_at(self, place: float) -> float:
        phase = 2.0 * np.pi * place / self.length
        return phase if self.amplitude is None else self.amplitude * float(np.sin(phase))

    def press(self, size: float, end: float) -> tuple[LineLoad, ...]:
        """Return forces of a size [N/mm] that press a rod outwards along the wave."""
        count = round(8 * end / self.length)
        edges = np.linspace(0.0, end, count + 1).tolist()
        loads = []
        for a, b in zip(edges[:-1], edges[1:], strict=True):
            angle = self.angle_at(0.5 * (a + b))
            force = (0.0, size * float(np.sin(angle)), -size * float(np.cos(angle)))
            loads.append(LineLoad(force=force, start=a, end=b, frame="world"))
        return tuple(loads)


def measure_angles(shape: ContactShape) -> NDArray[np.float64]:
    """Return the angle around the tube's axis, 0 at the bottom, growing from the base."""
    return np.unwrap(np.arctan2(shape.points[:, 1], -shape.points[:, 2]))


@pytest.mark.slow
@pytest.mark.parametrize("load", [1.0, 3.0])
def test_a_rod_without_weight_winds_with_the_pitch_of_lubinski(load: float) -> None:
    # Lubinski, Althouse and Logan 1962, J. Petroleum Technology 14(6), 655: F = 8 pi^2 EI / p^2.
    # Energy per length 1/2 EI (r q^2)^2 - 1/2 F (r q)^2, q = 2 pi / p, is least there.
    gap = 1.5
    pitch = np.pi * np.sqrt(8.0 * STIFFNESS / load)
    robot = replace(make_rod(3.0 * pitch, STIFFNESS), base_position=(0.0, 0.0, -gap))
    # Force of the wall per length: F r q^2 - EI r q^4.
    pressure = load**2 * gap / (4.0 * STIFFNESS)
    shape: ContactShape | None = None
    push = PointLoad(force=(-load, 0.0, 0.0), frame="world")
    guide = Wave(1.1 * pitch)  # a wrong pitch, which is let go
    for size, axial in ((5.0, ()), (5.0, (push,)), (1.0, (push,)), (0.2, (push,)), (0.0, (push,))):
        loads = (*axial, *(guide.press(size * pressure, 3.0 * pitch) if size else ()))
        model = ContactModel(
            robot, Tube(gap + 1.0), loads=loads, options=ContactOptions(segment_length=pitch / 24.0)
        )
        shape = model.shape(initial=shape)
        assert shape.converged, shape.reason
    assert shape is not None
    check_balance(shape)
    np.testing.assert_allclose(
        shape.resultant + shape.base_force + (-load, 0.0, 0.0), 0.0, atol=1e-6
    )
    middle = (shape.arc_length > pitch) & (shape.arc_length < 2.0 * pitch)
    rate = np.polyfit(shape.arc_length[middle], measure_angles(shape)[middle], 1)[0]
    assert 2.0 * np.pi / abs(rate) == pytest.approx(pitch, rel=0.01)
    found = shape.normal_forces[middle].mean() / np.diff(shape.arc_length).mean()
    assert found == pytest.approx(pressure, rel=0.02)


def find_density(load: float, weight: float, gap: float, guide: Wave, turns: int) -> float:
    """Return the potential of a rod in a tube per length, against that of a straight one, by w r.

    The guide, as much as the weight in the end, keeps it from changing over. Its work is not
    counted.
    """
    length = 1.05 * turns * guide.length
    robot = replace(make_rod(length, STIFFNESS), base_position=(0.0, 0.0, -gap))
    even = LineLoad(force=(0.0, 0.0, -weight), frame="world")
    heavy = LineLoad(force=(0.0, 0.0, -30.0 * weight), start=0.97 * length, frame="world")
    push = PointLoad(force=(-load, 0.0, 0.0), frame="world")
    shape: ContactShape | None = None
    for size, wall in product((20.0, 5.0, 1.0), (0.3, None)):
        loads = (even, heavy, push, *guide.press(size * weight, 0.97 * length))
        options = ContactOptions(segment_length=guide.length / 16.0, wall_stiffness=wall)
        model = ContactModel(robot, Tube(gap + 1.0), loads=loads, options=options)
        shape = model.shape(initial=shape)
        assert shape.converged, shape.reason
    assert shape is not None
    check_balance(shape)
    # Elastic energy and work from the points alone.
    places, points = shape.arc_length, shape.points
    ways = np.diff(points, axis=0) / np.diff(places)[:, None]
    inner, spans = places[1:-1], 0.5 * (places[2:] - places[:-2])
    bent = np.sum((np.diff(ways, axis=0) / spans[:, None]) ** 2, axis=1)
    value = 0.5 * STIFFNESS * bent + weight * (points[1:-1, 2] + gap)
    value += load * (0.5 * (ways[1:, 0] + ways[:-1, 0]) - 1.0)
    # Over whole waves away from the ends.
    angle = measure_angles(shape)
    if guide.amplitude is None:
        angle = np.abs(angle - angle[0])
        start, end = np.interp([2.0 * np.pi, 2.0 * np.pi * (turns - 1)], angle, places)
    else:
        up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
        zeros = places[up] - angle[up] * np.diff(places)[up] / np.diff(angle)[up]
        zeros = zeros[(zeros > 0.15 * length) & (zeros < 0.85 * length)]
        start, end = zeros[0], zeros[-1]
    grid = np.linspace(start, end, 4001)
    return float(trapezoid(np.interp(grid, inner, value), grid) / (end - start) / (weight * gap))


@pytest.mark.slow
def test_a_heavy_rod_in_a_tube_winds_up_at_the_load_of_chen_lin_and_cheatham() -> None:
    # Chen, Lin and Cheatham 1990, J. Energy Resources Technology 112(2), 140: 2 sqrt(2) sqrt(EI w /
    # r), where the mean potential of an even helix, EI r^2 q^4 / 2 - F r^2 q^2 / 2 + w r with q^2 =
    # F / (2 EI), is that of the straight rod. Weight makes the helix uneven, which takes 1.3 % off;
    # with that, it is that of the sinusoid at 2.90 (Fourier series of the angle).
    weight, gap = 0.01, 1.0
    unit = np.sqrt(STIFFNESS * weight / gap)
    scale = 2.0 * np.pi * (STIFFNESS * gap / weight) ** 0.25
    helix, sine = Wave(scale / 1.17), Wave(scale / 0.973, 0.85)
    loads = np.array([2.7, 2.9]) * unit
    wound = np.array([find_density(load, weight, gap, helix, 4) for load in loads])
    swung = np.array([find_density(load, weight, gap, sine, 4) for load in loads])

    def cross(values: NDArray[np.float64]) -> float:
        return float(loads[0] - values[0] * np.diff(loads)[0] / np.diff(values)[0])

    wanted = 2.0 * np.sqrt(2.0) * unit
    assert cross(wound) == pytest.approx(wanted, rel=0.05)
    # Against the sinusoid, which is the lower one by then.
    assert cross(wound - swung) == pytest.approx(wanted, rel=0.05)
    assert cross(wound - swung) > cross(wound)
