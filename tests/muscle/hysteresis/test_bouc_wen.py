"""Bouc-Wen: bound, closed forms, limits, and where it would run away."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.hysteresis import BoucWen
from tests.muscle.hysteresis.reference import list_histories, run_bouc_wen


def inner(operator, history):
    """The state h, from the output."""
    output = (operator.apply(history) - operator.offset) / operator.scale
    return operator.slope * np.asarray(history) - output


@st.composite
def bouc_wens(draw):
    beta = draw(st.floats(0.0, 20.0))
    return BoucWen(
        slope=0.0,
        alpha=draw(st.floats(0.01, 20.0)),
        beta=beta,
        gamma=draw(st.floats(0.01, 20.0)) - 0.99 * beta,
        exponent=draw(st.one_of(st.sampled_from([1.0, 2.0]), st.floats(1.0, 20.0))),
    )


@settings(max_examples=100, deadline=None)
@given(bouc_wens(), list_histories(-5.0, 5.0))
def test_the_state_is_bounded(operator, history):
    state = inner(operator, history)
    assert np.all(np.abs(state) <= operator.bound * (1.0 + 1e-12))
    assert inner(operator, [1e9])[0] == pytest.approx(operator.bound, rel=1e-9)


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(0.0, 3.0))
def test_first_branch_in_closed_form(alpha, both, way):
    first = BoucWen(slope=0.0, alpha=alpha, beta=0.6 * both, gamma=0.4 * both, exponent=1.0)
    assert inner(first, [way])[0] == pytest.approx(
        alpha / both * -math.expm1(-both * way), rel=1e-12, abs=1e-12
    )
    second = BoucWen(slope=0.0, alpha=alpha, beta=0.6 * both, gamma=0.4 * both, exponent=2.0)
    root = math.sqrt(alpha * both)
    assert inner(second, [way])[0] == pytest.approx(
        math.sqrt(alpha / both) * math.tanh(root * way), rel=1e-10, abs=1e-12
    )


def test_exponent_one_is_the_limit_of_those_above():
    rest = {"slope": 1.0, "alpha": 0.9, "beta": 3.0, "gamma": -1.0}
    history = np.random.default_rng(3).uniform(-1.0, 1.0, 50)
    near, at = (BoucWen(exponent=n, **rest).apply(history) for n in (1.0 + 1e-9, 1.0))
    assert near == pytest.approx(at, abs=1e-7)


def test_without_beta_there_is_no_loop():
    up = np.linspace(0.0, 1.0, 21)
    for beta, gap in ((0.0, 0.0), (0.5, 0.02)):
        for exponent in (1.0, 1.7):
            operator = BoucWen(slope=0.0, alpha=1.0, beta=beta, gamma=2.0 - beta, exponent=exponent)
            output = operator.apply(np.concatenate([up, up[::-1]]))
            apart = abs(output[21:][::-1] - output[:21]).max()
            assert apart <= 1e-9 if gap == 0.0 else apart > gap


def test_another_scale_of_the_state_changes_nothing():
    one = BoucWen(slope=2.0, alpha=0.9, beta=6.0, gamma=-2.0, exponent=1.5)
    size = 3.0
    two = BoucWen(
        slope=2.0 * size,
        scale=1.0 / size,
        alpha=0.9 * size,
        beta=6.0 * size ** (1.0 - 1.5),
        gamma=-2.0 * size ** (1.0 - 1.5),
        exponent=1.5,
    )
    history = np.random.default_rng(4).uniform(0.0, 1.0, 50)
    assert two.apply(history) == pytest.approx(one.apply(history), abs=1e-10)


def test_minor_loops_do_not_close():
    """What the operator cannot do, and the guide says so."""
    operator = BoucWen(slope=1.0, alpha=0.9, beta=6.0, gamma=-2.0)
    output = operator.apply([0.0, 1.0, 0.5, 1.0])
    assert abs(output[3] - output[1]) > 1e-3


def test_a_negative_beta_would_run_away():
    """The printed bound needs more than gamma + beta > 0: the equation itself, by SciPy."""

    class Wild:
        slope, scale, offset = 0.0, 1.0, 0.0
        alpha, beta, gamma, exponent = 1.0, -1.0, 2.0, 1.0

    bound = (Wild.alpha / (Wild.beta + Wild.gamma)) ** (1.0 / Wild.exponent)
    assert abs(run_bouc_wen(Wild, [5.0, 0.0, 5.0])).max() > 3.0 * bound
    with pytest.raises(InputError, match=r"^beta is -1: it must lie in \[0, "):
        BoucWen(slope=0.0, alpha=1.0, beta=-1.0, gamma=2.0)
