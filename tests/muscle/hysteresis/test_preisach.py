"""Preisach: wiping out, congruency, saturation; the pleated muscle of (2.50)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.muscle.hysteresis import Preisach, PreisachForce
from tests.muscle.hysteresis.reference import LEVELS, OPERATORS, list_histories

RELAYS = OPERATORS["relays"]


@settings(max_examples=100, deadline=None)
@given(list_histories(longest=15), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_larger_extremes_wipe_smaller_ones_out(history, one, two):
    low, high = sorted((one, two))
    inside = low + (high - low) * history
    state = RELAYS.run([low, high, *inside, low, high])[1]
    bare = RELAYS.run([low, high])[1]
    assert np.array_equal(state.memory, bare.memory)


@settings(max_examples=100, deadline=None)
@given(
    list_histories(longest=15), list_histories(longest=15), st.floats(0.0, 1.0), st.floats(0.0, 1.0)
)
def test_loops_between_two_inputs_are_congruent(first, second, one, two):
    low, high = sorted((one, two))
    loop = np.concatenate([np.linspace(low, high, 20), np.linspace(high, low, 20)])
    # from the first visit of both on, what was before only shifts the loop
    a, b = (RELAYS.apply([*before, low, high, low, *loop])[-40:] for before in (first, second))
    assert a - a[0] == pytest.approx(b - b[0], abs=1e-10)


def test_saturation_and_the_major_loop():
    low, high = RELAYS.saturation
    assert RELAYS.apply([-5.0, 5.0, -5.0]) == pytest.approx([low, high, low])
    inputs = np.concatenate([LEVELS, np.linspace(-0.2, 1.2, 41)]).reshape(5, 10)
    rising, falling = RELAYS.trace_major(inputs)
    up = RELAYS.apply(inputs[..., None])[..., 0]
    down = RELAYS.apply(np.stack([np.full(inputs.shape, 2.0), inputs], axis=-1))[..., 1]
    assert rising == pytest.approx(up, abs=1e-12)
    assert falling == pytest.approx(down, abs=1e-12)
    assert np.all(falling >= rising - 1e-12)  # no weight is negative
    assert Preisach((0.0, 1.0), (2.0,), offset=1.0).saturation == (-1.0, 3.0)


def test_finer_levels_come_to_one_curve():
    """An even density over the triangle: the branch up is a parabola, x**2."""
    inside = np.linspace(0.0, 1.0, 333)
    errors = []
    for steps in (10, 40, 160):
        count = steps * (steps + 1) // 2
        even = Preisach(np.linspace(0.0, 1.0, steps + 1), np.full(count, 0.5 / count), offset=0.5)
        errors.append(abs(even.apply(inside) - inside**2).max())
    assert errors[1] < 0.4 * errors[0] and errors[2] < 0.4 * errors[1] and errors[2] < 0.02


def make_muscle(scale):
    relays = Preisach(np.linspace(0.05, 0.35, 9), OPERATORS["relays"].weights)
    return PreisachForce(
        length=100.0, coefficients=(0.05, -0.1, 0.4, -0.2, 0.1), scale=scale, relays=relays
    )


def test_pleated_muscle_without_scale_is_its_mean_curve():
    strain = 0.05 + 0.3 * np.random.default_rng(1).uniform(0.0, 1.0, 30)
    mean = make_muscle(0.0)
    by_hand = 0.05 / strain - 0.1 + 0.4 * strain - 0.2 * strain**2 + 0.1 * strain**3
    assert mean.force(0.2, strain) == pytest.approx(0.2 * 100.0**2 * by_hand)


def test_pleated_muscle_has_its_mean_curve_in_the_middle_of_the_loop():
    lagging, mean = make_muscle(0.01), make_muscle(0.0)
    up = np.linspace(0.05, 0.35, 50)[:-1]
    forces = lagging.force(0.2, np.concatenate([up, [0.35], up[::-1]]))
    rising, falling = forces[:49], forces[50:][::-1]
    assert 0.5 * (rising + falling) == pytest.approx(mean.force(0.2, up))
    # it pulls less as it contracts, more as it is drawn out
    assert np.all((falling - rising)[5:-5] > 0.0)
