"""Sums of plays: virgin curve, symmetry, and the inverse in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.muscle.hysteresis import PrandtlIshlinskii
from tests.muscle.hysteresis.reference import list_histories, run_plays


@st.composite
def play_sums(draw, signed=False):
    """Sums of plays with an inverse."""
    gaps = draw(st.lists(st.floats(0.01, 0.5), max_size=5))
    slopes = [draw(st.floats(0.1, 10.0))]
    for _ in gaps:
        more = st.floats(0.1, 10.0) if signed else st.floats(0.0, 5.0).map(lambda w: slopes[-1] + w)
        slopes.append(draw(more))
    thresholds = np.concatenate([[0.0], np.cumsum(gaps)])
    number = st.floats(-1.0, 1.0)
    return PrandtlIshlinskii(
        thresholds, np.diff(slopes, prepend=0.0), origin=draw(number), offset=draw(number)
    )


@settings(max_examples=100, deadline=None)
@given(st.booleans().flatmap(lambda signed: play_sums(signed=signed)), list_histories(-2.0, 2.0))
def test_inverse_gives_the_history_back(operator, history):
    inverse = operator.invert()
    assert inverse.apply(operator.apply(history)) == pytest.approx(history, abs=1e-9)
    assert operator.apply(inverse.apply(history)) == pytest.approx(history, abs=1e-9)
    again = inverse.invert()
    assert again.thresholds == pytest.approx(operator.thresholds, abs=1e-9)
    assert again.weights == pytest.approx(operator.weights, rel=1e-9, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(play_sums(), list_histories(-2.0, 2.0), list_histories(-2.0, 2.0))
def test_inverse_goes_on_from_the_state_that_belongs(operator, before, history):
    state = operator.run(before)[1]
    output = operator.run(history, initial=state)[0]
    belongs = operator.invert_state(state)
    assert operator.invert().run(output, initial=belongs)[0] == pytest.approx(history, abs=1e-9)
    _, mirrored = operator.invert().run(operator.apply(before))
    assert belongs.memory == pytest.approx(mirrored.memory, abs=1e-9)
    assert belongs.last == pytest.approx(mirrored.last, abs=1e-9)


@given(list_histories(-2.0, 2.0))
def test_a_play_of_no_width_is_the_input(history):
    assert np.array_equal(PrandtlIshlinskii((0.0,), (1.0,)).apply(history), history)
    twice = PrandtlIshlinskii((0.0,), (2.0,), origin=0.5, offset=-1.0).apply(history)
    assert twice == pytest.approx(2.0 * (history - 0.5) - 1.0)


def test_virgin_curve_and_its_slopes():
    operator = PrandtlIshlinskii((0.0, 0.2, 0.5), (1.0, 0.5, 0.25), origin=0.1, offset=3.0)
    way = np.linspace(0.0, 1.0, 41)
    for sign in (1.0, -1.0):
        assert operator.apply(0.1 + sign * way) == pytest.approx(
            operator.load_virgin(0.1 + sign * way), abs=1e-12
        )
    assert operator.load_virgin(0.1) == 3.0
    assert np.gradient(operator.apply(0.1 + way), way)[[4, 14, 35]] == pytest.approx(
        operator.slopes
    )


def test_loops_are_symmetric_under_a_half_turn():
    operator = PrandtlIshlinskii((0.0, 0.2, 0.5), (1.0, 0.5, 0.25))
    up = np.linspace(-1.0, 1.0, 31)
    output = operator.apply(np.concatenate([up[::-1], up, up[::-1], up]))
    assert output[62:93] == pytest.approx(-output[93:], abs=1e-12)


def run_printed(operator, history):
    """(2.54) as printed: every play is moved on from the whole output before it."""
    total, output = 0.0, []
    for p in history:
        pairs = zip(operator.weights, operator.thresholds, strict=True)
        total = sum(w * max(p - r, min(p + r, total)) for w, r in pairs)
        output.append(total)
    return np.array(output)


def test_the_printed_memory_is_right_for_one_play_of_weight_one_only():
    up = np.linspace(0.0, 1.0, 11)
    history = np.concatenate([up, up[::-1], up])
    one = PrandtlIshlinskii((0.2,), (1.0,))
    assert run_printed(one, history) == pytest.approx(one.apply(history), abs=1e-12)
    two = PrandtlIshlinskii((0.0, 0.2), (0.5, 0.4))
    assert run_plays(two, history) == pytest.approx(two.apply(history), abs=1e-12)
    assert abs(run_printed(two, history) - two.apply(history)).max() > 0.02
    # and the printed one is not rate independent: holding the input still goes on moving it
    held = np.concatenate([history, [history[-1]] * 5])
    assert np.ptp(two.apply(held)[-6:]) == 0.0
    held = np.concatenate([up, [0.9] * 5])
    three = PrandtlIshlinskii((0.05, 0.2), (0.5, 0.4))
    assert np.ptp(run_printed(three, held)[-5:]) > 1e-3
