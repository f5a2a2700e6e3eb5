"""Roots of many functions at once: those that SciPy finds one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from bozzini.numeric.roots import bisect, find_between


@given(st.lists(st.floats(0.01, 3.0), min_size=1, max_size=20))
def test_many_roots_are_those_of_brentq(shifts):
    shift = np.array(shifts)

    def excess(index, x):
        return np.sinh(x) + 0.1 * x - shift[index]

    ends = np.full(shift.shape, -4.0), np.full(shift.shape, 4.0)
    found = find_between(excess, *ends)
    for i, root in enumerate(found):
        one = brentq(lambda x, i=i: float(excess(i, x)), -4.0, 4.0, xtol=1e-15)
        assert root == pytest.approx(one, rel=1e-12, abs=1e-13)
        bisected = bisect(lambda x, i=i: float(excess(i, x)), -4.0, 4.0)
        assert bisected == pytest.approx(root, rel=1e-12, abs=1e-13)


def test_no_change_of_sign_is_no_root():
    found = find_between(lambda index, x: x**2 + 1.0, np.array([-1.0]), np.array([1.0]))
    assert np.isnan(found).all()
