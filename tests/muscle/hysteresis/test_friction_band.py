"""The band of friction of (2.49): signs, the force itself, range."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from bozzini.errors import InputError
from bozzini.muscle import preset
from bozzini.muscle.hysteresis import FrictionBand
from bozzini.muscle.models import MODELS
from tests.muscle.hysteresis.reference import OPERATORS, list_histories

BAND = OPERATORS["band"]


def test_friction_opposes_the_motion():
    pressure = np.array([0.0, 0.2, 0.4, 0.4, 0.2, 0.0, 0.1])
    forces = BAND.force(10.0, pressure) / 10.0 - 1.0
    mu = BAND.friction(pressure)
    assert mu == pytest.approx(0.1 + 0.05 * pressure)
    assert forces == pytest.approx(np.array([0.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0]) * mu)


@settings(deadline=None)
@given(list_histories())
def test_in_proportion_to_pressure_both_ways_agree(history):
    assert BAND.apply(history) == pytest.approx(BAND.force(history, history), abs=1e-12)
    assert np.array_equal(FrictionBand(0.0).apply(history), history)
    both = BAND.force(np.ones((2, 1)), np.stack([history, history]))
    assert np.array_equal(both[0], both[1])


def test_on_an_ideal_muscle_it_is_the_equation_as_printed():
    """Gaylord's force is in proportion to the pressure: F_stat + (kappa1 + kappa2 P) F_stat."""
    ideal = MODELS["gaylord-1"](preset("effector-45"))
    history = np.array([0.1, 0.3, 0.6])
    acting = ideal.force(BAND.apply(history), 1.0)
    static = ideal.force(history, 1.0)
    assert acting == pytest.approx(static * (1.0 + BAND.kappa1 + BAND.kappa2 * history))
    assert acting == pytest.approx(BAND.force(static, history))


def test_a_friction_that_helps_is_refused_by_the_value():
    band = FrictionBand(-0.1, 0.2)
    band.apply([0.0, 0.5])
    with pytest.raises(InputError, match=r"^history\[1\] is 0.6: .* is -0.02: .* \[0, 1\]$"):
        band.apply([0.0, 0.6])
    with pytest.raises(InputError, match=r"^history\[0\] is 0: .* is 1.1: "):
        FrictionBand(-1.1).force([1.0], [0.0])
    with pytest.raises(InputError, match="^kappa1 is nan"):
        FrictionBand(np.nan)
