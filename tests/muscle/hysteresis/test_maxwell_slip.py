"""Maxwell slip: elements against return points, Masing's rule, saturation, plays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bozzini.muscle.hysteresis import MaxwellSlip
from tests.muscle.hysteresis.reference import follow_return_points, list_histories

NUMBERS = st.floats(0.05, 5.0)


@st.composite
def slips(draw):
    count = draw(st.integers(1, 6))
    pairs = [draw(st.lists(NUMBERS, min_size=count, max_size=count)) for _ in range(2)]
    return MaxwellSlip(*pairs)


@settings(max_examples=150, deadline=None)
@given(slips(), list_histories(-3.0, 3.0, longest=60))
def test_elements_and_return_points_agree(operator, history):
    forces = operator.apply(history)
    assert follow_return_points(operator, history) == pytest.approx(forces, abs=1e-10)
    assert follow_return_points(operator, -history) == pytest.approx(-forces, abs=1e-10)
    assert np.all(np.abs(forces) <= operator.saturation + 1e-12)


@settings(max_examples=50, deadline=None)
@given(slips(), st.floats(0.1, 3.0))
def test_branches_are_the_virgin_curve_twice_as_large(operator, top):
    """Masing: after the return point at the top, until the mirror image of it."""
    down = np.linspace(top, -top, 41)
    forces = operator.apply(np.concatenate([[0.0], down]))[1:]
    expected = operator.load_virgin(top) - 2.0 * operator.load_virgin(0.5 * (top - down))
    assert forces == pytest.approx(expected, abs=1e-9)
    assert forces[-1] == pytest.approx(-operator.load_virgin(top), abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(slips(), list_histories(-3.0, 3.0))
def test_elements_are_input_less_plays(operator, history):
    left = operator.to_plays(slope=2.0).apply(history)
    assert left == pytest.approx(2.0 * history - operator.apply(history), abs=1e-9)


def test_saturates_when_all_slip():
    operator = MaxwellSlip((2.0, 1.0), (0.1, 0.4))
    assert operator.apply([0.4, 5.0, 4.0]) == pytest.approx([0.5, 0.5, -0.5])
    assert operator.saturation == 0.5


@settings(max_examples=50, deadline=None)
@given(slips())
def test_virgin_curve_gives_the_elements_back(operator):
    yields = np.unique(np.array(operator.limits) / operator.stiffnesses)
    assume(np.all(np.diff(yields) > 1e-9))  # nearer ones are alike in double precision
    again = MaxwellSlip.from_virgin_curve(yields, operator.load_virgin(yields))
    line = np.linspace(-2.0 * yields[-1], 2.0 * yields[-1], 101)
    assert again.load_virgin(line) == pytest.approx(operator.load_virgin(line), abs=1e-8)
