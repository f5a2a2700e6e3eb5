"""Tendons: where they run, their slopes, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.continuum import Helix, Tendon

KNOTS = ((0.0, 3.0), (30.0, 5.0), (70.0, 2.0), (100.0, 2.5))
TURNS = ((0.0, 0.2), (40.0, 1.0), (100.0, -2.0))


def test_constant_tendon_stays_where_it_is() -> None:
    tendon = Tendon(name="a", offset=4, angle=math.radians(30.0))
    places = np.linspace(0.0, 500.0, 7)
    assert np.allclose(tendon.place_at(places), [4.0 * math.cos(math.pi / 6), 2.0])
    assert not tendon.slope_at(places).any()
    assert tendon.is_parallel
    assert tendon.corners().size == 0


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_knots_are_met_and_never_left(interpolation: str) -> None:
    tendon = Tendon(name="a", offset=KNOTS, angle=0.3, interpolation=interpolation)
    for place, value in KNOTS:
        assert tendon.offset_at(place) == pytest.approx(value)
    for (start, one), (end, other) in zip(KNOTS, KNOTS[1:], strict=False):
        between = tendon.offset_at(np.linspace(start, end, 50))
        assert between.min() >= min(one, other) - 1e-12
        assert between.max() <= max(one, other) + 1e-12


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@given(place=st.floats(0.1, 99.9))
def test_slope_is_the_derivative_of_the_path(interpolation: str, place: float) -> None:
    tendon = Tendon(name="a", offset=KNOTS, angle=TURNS, interpolation=interpolation)
    if np.abs(tendon.corners() - place).min() < 1e-3:
        return
    step = 1e-5
    measured = (tendon.place_at(place + step) - tendon.place_at(place - step)) / (2.0 * step)
    assert np.allclose(tendon.slope_at(place), measured, atol=1e-7)


def test_slope_at_a_corner_is_that_of_the_distal_side() -> None:
    tendon = Tendon(name="a", offset=((0.0, 4.0), (50.0, 4.0), (100.0, 2.0)))
    assert np.allclose(tendon.slope_at([49.9, 50.0, 100.0])[:, 0], [0.0, -0.04, -0.04])


@given(turns=st.floats(-3.0, 3.0), angle=st.floats(-3.0, 3.0))
def test_helix_has_its_pitch_everywhere(turns: float, angle: float) -> None:
    tendon = Tendon(name="h", offset=4.0, angle=Helix(turns=turns, start=angle), end=80.0)
    speed = np.linalg.norm(tendon.slope_at(np.linspace(0.0, 80.0, 9)), axis=-1)
    assert np.allclose(speed, 4.0 * 2.0 * math.pi * abs(turns) / 80.0)
    assert np.allclose(tendon.angle_at([0.0, 80.0]), [angle, angle + 2.0 * math.pi * turns])


def test_knots_of_one_value_are_parallel() -> None:
    assert Tendon(name="a", offset=((0.0, 4.0), (9.0, 4.0))).is_parallel
    assert not Tendon(name="a", offset=((0.0, 4.0), (9.0, 3.0))).is_parallel
    assert not Tendon(name="h", offset=4.0, angle=Helix(turns=0.1), end=9.0).is_parallel


def test_a_drive_without_limits_is_free_both_ways() -> None:
    assert Tendon(name="a", offset=1.0, travel=(-math.inf, 2)).travel == (-math.inf, 2.0)
    assert Tendon(name="a", offset=1.0, travel=np.array([-1.0, math.inf])).travel[1] == math.inf
