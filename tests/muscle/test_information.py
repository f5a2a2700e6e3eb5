"""Information criteria: known differences, limits, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.muscle.ranking import compute_aicc, compute_bic, weigh_models

squares = st.floats(1e-12, 1e12)


def log_likelihood(residuals):
    """Largest log-likelihood of normal residuals of one unknown variance."""
    n = len(residuals)
    variance = residuals @ residuals / n
    terms = -0.5 * np.log(2.0 * math.pi * variance) - residuals**2 / (2.0 * variance)
    return float(terms.sum())


@given(st.integers(0, 5), st.integers(10, 200), st.integers(0, 10_000))
def test_they_are_twice_the_log_likelihood_and_a_charge(parameters, rows, seed):
    residuals = np.random.default_rng(seed).normal(size=rows)
    other = 2.0 * residuals
    count = parameters + 1
    charge = 2.0 * count * rows / (rows - count - 1)  # the usual form of the corrected one
    for compute, fee in ((compute_aicc, charge), (compute_bic, count * math.log(rows))):
        constant = rows * (math.log(2.0 * math.pi) + 1.0)
        for values in (residuals, other):
            expected = -2.0 * log_likelihood(values) + fee - constant
            assert compute(float(values @ values), rows, parameters) == pytest.approx(expected)


@given(squares, st.integers(1, 6))
def test_a_parameter_that_gains_nothing_costs(total, parameters):
    for compute in (compute_aicc, compute_bic):
        assert compute(total, 40, parameters) > compute(total, 40, parameters - 1)
    few, many = (compute_aicc(total, rows, parameters) - compute_aicc(total, rows, 0)
                 for rows in (parameters + 4, 10**6))  # fmt: skip
    assert few > many == pytest.approx(2.0 * parameters, rel=1e-3)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=9), st.floats(-1e3, 1e3))
def test_weights_sum_to_one_and_only_differences_count(values, shift):
    weights = weigh_models(values)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[np.argmin(values)] == weights.max()
    moved = weigh_models([value + shift for value in values])
    assert moved == pytest.approx(weights, abs=1e-6)


def test_two_models_two_apart():
    one, other = weigh_models([10.0, 12.0])
    assert one / other == pytest.approx(math.e)
