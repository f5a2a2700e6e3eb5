"""Asymmetric and unparallel play sums: what they reduce to, where they are defined, inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.hysteresis import (
    AsymmetricPrandtlIshlinskii,
    PrandtlIshlinskii,
    UnparallelPrandtlIshlinskii,
)
from tests.muscle.hysteresis.reference import OPERATORS, list_histories

ASYMMETRIC, UNPARALLEL = OPERATORS["asymmetric"], OPERATORS["unparallel"]


@settings(deadline=None)
@given(list_histories(-2.0, 2.0))
def test_with_a_straight_envelope_it_is_a_play_sum(history):
    bent = AsymmetricPrandtlIshlinskii(1.5, (0.1, 0.4), (0.1, 0.2), (0.3, 0.4), offset=0.3)
    plain = PrandtlIshlinskii((0.0, 0.1, 0.4), (0.5, 0.4, 0.6), offset=0.3)
    assert bent.apply(history) == pytest.approx(plain.apply(history), abs=1e-12)


@settings(deadline=None)
@given(list_histories(-2.0, 2.0))
def test_with_slopes_of_one_it_is_a_play_sum(history):
    thresholds, weights, ones = (0.0, 0.1, 0.4), (0.5, 0.4, 0.6), (1.0, 1.0, 1.0)
    even = UnparallelPrandtlIshlinskii(thresholds, weights, ones, ones, offset=0.3)
    plain = PrandtlIshlinskii(thresholds, weights, offset=0.3)
    assert even.apply(history) == pytest.approx(plain.apply(history), abs=1e-12)


@settings(deadline=None)
@given(list_histories())
def test_only_ratios_of_slopes_matter(history):
    scaled = UnparallelPrandtlIshlinskii(
        UNPARALLEL.thresholds,
        np.array(UNPARALLEL.weights) * UNPARALLEL.ascending_slopes,
        (1.0, 1.0, 1.0),
        np.array(UNPARALLEL.descending_slopes) / UNPARALLEL.ascending_slopes,
    )
    assert scaled.apply(history) == pytest.approx(UNPARALLEL.apply(history), abs=1e-12)


@pytest.mark.parametrize("operator", [ASYMMETRIC, UNPARALLEL], ids=lambda o: type(o).__name__)
@settings(max_examples=40, deadline=None)
@given(history=list_histories(), before=list_histories())
def test_inverse_gives_the_history_back(operator, history, before):
    output = operator.apply(history)
    assert operator.invert_history(output, between=(0.0, 1.0)) == pytest.approx(history, abs=1e-9)
    state = operator.run(before)[1]
    output = operator.run(np.stack([history, history]), initial=operator.rest())[0]
    both = operator.invert_history(output, between=(0.0, 1.0))
    assert both[1] == pytest.approx(history, abs=1e-9)
    output = operator.run(history, initial=state)[0]
    found = operator.invert_history(output, between=(0.0, 1.0), initial=state)
    assert found == pytest.approx(history, abs=1e-9)


@pytest.mark.parametrize(
    ("operator", "symmetric"),
    [(ASYMMETRIC, False), (UNPARALLEL, False), (OPERATORS["plays"], True)],
    ids=lambda value: type(value).__name__,
)
def test_only_plain_plays_have_symmetric_loops(operator, symmetric):
    up = np.linspace(0.0, 1.0, 41)
    output = operator.apply(np.concatenate([up, up[::-1], up, up[::-1]]))
    rising, falling = output[82:123], output[123:]
    turned = rising[0] + falling[0] - rising
    apart = abs(turned - falling).max()
    assert apart < 1e-12 if symmetric else apart > 1e-3


def test_edges_that_cross_are_refused_by_the_value():
    steep = UnparallelPrandtlIshlinskii((0.1,), (1.0,), (2.0,), (1.0,))
    # al (P - r) <= be (P + r) up to P = r (al + be) / (al - be) = 0.3
    steep.apply([0.0, 0.3])
    with pytest.raises(InputError, match=r"^history\[1\] is 0.4: .* of play 0 is 0.6, .* 0.5"):
        steep.apply([0.0, 0.4, 0.3])
    with pytest.raises(InputError, match=r"^history\[1, 0\] is 0.4"):
        steep.apply([[0.1, 0.2], [0.4, 0.3]])
    steep = UnparallelPrandtlIshlinskii((0.0, 0.1), (1.0, 1.0), (1.0, 2.0), (1.0, 1.0))
    with pytest.raises(InputError, match=r"^history\[1\] is 0.4: .* edge of play 1 is 0.6"):
        steep.invert_history([0.1], between=(0.0, 0.4))


def test_envelopes_that_fall_or_cross_are_refused_by_the_value():
    falling = AsymmetricPrandtlIshlinskii(1.0, (0.1,), (0.1,), (0.1,), (0.0, 1.0, -1.0))
    falling.apply([0.0, 0.4])
    with pytest.raises(InputError, match=r"^history\[2\] is 0.6: there the envelope falls.* -0.2"):
        falling.apply([0.0, 0.2, 0.6])
    low = AsymmetricPrandtlIshlinskii(1.0, (0.1,), (0.1,), (0.1,), (0.0, 0.0, 1.0))
    low.apply([0.0, 0.2])
    with pytest.raises(InputError, match="^history comes by 0.5: there the envelope is 0.25"):
        low.apply([0.0, 0.9])  # at 0.9 the envelope is back at 0.81 > 0.9 - 0.2


@given(st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.floats(-0.1, 0.1), list_histories())
@settings(max_examples=60, deadline=None)
def test_a_legal_envelope_keeps_the_plays_between_their_edges(first, last, least, history):
    a2 = 0.5 * (last - first)
    operator = AsymmetricPrandtlIshlinskii(1.0, (0.05,), (0.0,), (1.0,), (least, first, a2))
    try:
        output = operator.apply(history)  # is H_d itself
    except InputError:
        line = np.linspace(history.min(), history.max(), 2001)
        assert (least + first * line + a2 * line**2 - line).min() < -0.1 + 1e-6
        return
    envelope = least + first * history + a2 * history**2
    assert np.all(output >= history - 0.05 - 1e-9)
    assert np.all(output <= envelope + 0.05 + 1e-9)
