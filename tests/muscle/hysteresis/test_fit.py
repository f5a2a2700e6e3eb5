"""Fits to loops: exact on exact data, close on noisy data, honest on poor data."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.hysteresis import (
    AsymmetricPrandtlIshlinskii,
    BoucWen,
    FrictionBand,
    LoopOptions,
    MaxwellFriction,
    MaxwellSlip,
    PrandtlIshlinskii,
    Preisach,
    UnparallelPrandtlIshlinskii,
)
from bozzini.muscle.hysteresis.operator import fit_linear
from tests.muscle.hysteresis.reference import LEVELS, OPERATORS


def grow(tops=(0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0), count=40):
    """Loops from 0 that grow."""
    return np.concatenate([[0.0], *(_loop(top, count) for top in tops)])


def _loop(top, count):
    up = np.linspace(0.0, top, count + 1)
    return np.concatenate([up[1:], up[-2::-1]])


HISTORY = grow()
CASES = {
    "plays": (PrandtlIshlinskii, {"thresholds": (0.0, 0.1, 0.25), "origin": 0.05}),
    "asymmetric": (AsymmetricPrandtlIshlinskii, {"thresholds": (0.05, 0.2)}),
    "unparallel": (UnparallelPrandtlIshlinskii, {"thresholds": (0.0, 0.15, 0.3)}),
    "slips": (MaxwellSlip, {"yields": (0.05, 0.2, 0.4)}),
    "maxwell-slip": (MaxwellFriction, {"yields": (0.05, 0.2, 0.4)}),
    "bouc-wen": (BoucWen, {}),
    "relays": (Preisach, {"levels": LEVELS}),
    "band": (FrictionBand, {}),
}
TRUTHS = OPERATORS | {
    # the scale of h that `identify` chooses: a bound of 1
    "bouc-wen": BoucWen(
        slope=4.0, scale=0.5, alpha=4.0, beta=6.0, gamma=-2.0, exponent=1.5, offset=0.1
    ),
    "unparallel": UnparallelPrandtlIshlinskii(
        (0.0, 0.15, 0.3), (0.5, 0.3, 0.2), (1.0, 1.0, 1.0), (1.0, 1.4, 1.4)
    ),
}
COUNTS = {"plays": 4, "asymmetric": 9, "unparallel": 5, "slips": 3, "maxwell-slip": 4,
          "bouc-wen": 7, "relays": 37, "band": 2}  # fmt: skip
"""How many numbers are fitted."""


def list_numbers(operator):
    parts = [np.atleast_1d(value) for value in vars(operator).values()]
    return np.concatenate(parts).astype(float)


@pytest.mark.parametrize("name", CASES)
def test_exact_loops_give_the_operator_back(name):
    kind, options = CASES[name]
    truth = TRUTHS[name]
    fit = kind.identify(HISTORY, truth.apply(HISTORY), **options)
    assert fit.converged and fit.reason == "" and fit.undetermined == ()
    assert fit.deviation < 1e-9
    assert fit.residual == pytest.approx(truth.apply(HISTORY) - fit.operator.apply(HISTORY))
    assert list_numbers(fit.operator) == pytest.approx(list_numbers(truth), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("name", CASES)
def test_noisy_loops_give_the_operator_nearly_back(name):
    """Bound: the curve is missed by at most twice what linear theory expects of so many numbers."""
    kind, options = CASES[name]
    truth = TRUTHS[name].apply(HISTORY)
    sigma = 0.01 * np.ptp(truth)
    noise = sigma * np.random.default_rng(7).normal(size=len(HISTORY))
    fit = kind.identify(HISTORY, truth + noise, **options)
    assert fit.converged
    expected = sigma * np.sqrt(COUNTS[name] / len(HISTORY))
    missed = np.sqrt(np.mean((fit.operator.apply(HISTORY) - truth) ** 2))
    assert missed < 2.0 * expected
    assert fit.deviation == pytest.approx(sigma, rel=0.1)
    # and on a history that was not fitted
    other = np.concatenate([[0.0], np.random.default_rng(8).uniform(0.05, 1.0, 200)])
    apart = fit.operator.apply(other) - TRUTHS[name].apply(other)
    assert np.sqrt(np.mean(apart**2)) < 10.0 * expected


def test_default_rungs_come_close_without_being_those_of_the_truth():
    truth = OPERATORS["plays"]
    response = truth.apply(HISTORY)
    for count, share in ((5, 0.02), (20, 0.006)):
        fit = PrandtlIshlinskii.identify(HISTORY, response, count=count, origin=0.05)
        assert fit.deviation < share * np.ptp(response)
        assert len(fit.operator.thresholds) == count and min(fit.operator.weights) >= 0.0
    for kind in (MaxwellSlip, UnparallelPrandtlIshlinskii, AsymmetricPrandtlIshlinskii):
        fit = kind.identify(HISTORY, truth.apply(HISTORY) if kind is not MaxwellSlip
                            else OPERATORS["slips"].apply(HISTORY))  # fmt: skip
        assert fit.deviation < 0.03 * np.ptp(response)


def test_what_the_history_does_not_tell_is_named():
    up = np.linspace(0.0, 0.5, 20)
    fit = Preisach.identify(up, OPERATORS["relays"].apply(up), levels=LEVELS)
    assert fit.deviation < 1e-9
    # never turned on, or on together: one rise tells the sum of each row
    assert len(fit.undetermined) == 36 - 1
    assert "weights[0]" not in fit.undetermined
    wide = PrandtlIshlinskii.identify([0.0, 1.0, 0.5], [0.0, 1.0, 0.9], thresholds=(0.0, 3.0))
    assert wide.undetermined == ("weights[1]",)
    assert wide.operator.weights[1] == 0.0


def test_skip_leaves_the_first_branch_out():
    truth = PrandtlIshlinskii((0.0, 0.1, 0.25), (0.6, 0.3, 0.2))
    loop = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(1.0, 0.0, 50)[1:]])
    history = np.concatenate([loop, loop])
    response = truth.apply(history)
    response[:50] += 0.2  # the muscle was not at rest before
    options = {"thresholds": truth.thresholds}
    fit = PrandtlIshlinskii.identify(history, response, options=LoopOptions(skip=50), **options)
    assert fit.operator.weights == pytest.approx(truth.weights, abs=1e-9)
    assert fit.deviation < 1e-9 and fit.residual[0] == pytest.approx(0.2)
    spoilt = PrandtlIshlinskii.identify(history, response, **options)
    assert spoilt.deviation > 0.01


def test_batches_of_loops_are_fitted_together():
    truth = OPERATORS["slips"]
    batch = np.random.default_rng(9).uniform(-1.0, 1.0, (2, 3, 40))
    fit = MaxwellSlip.identify(batch, truth.apply(batch), yields=(0.05, 0.2, 0.4))
    assert fit.residual.shape == batch.shape
    assert fit.operator.limits == pytest.approx(truth.limits, abs=1e-9)


def test_weights_keep_their_bounds_unless_signed():
    truth = PrandtlIshlinskii((0.0, 0.1, 0.25), (1.0, -0.3, 0.2))
    response = truth.apply(HISTORY)
    bounded, signed = (
        PrandtlIshlinskii.identify(HISTORY, response, thresholds=truth.thresholds, signed=signed)
        for signed in (False, True)
    )
    assert min(bounded.operator.weights) == 0.0 and bounded.deviation > 1e-3
    assert signed.operator.weights == pytest.approx(truth.weights, abs=1e-9)
    friction = FrictionBand.identify(HISTORY, 1.1 * HISTORY)  # no friction is that helpful
    assert np.all(friction.operator.friction([0.0, 1.0]) >= 0.0)


def test_bouc_wen_with_a_known_exponent_and_without_a_loop():
    truth = OPERATORS["bouc-wen"]
    fit = BoucWen.identify(HISTORY, truth.apply(HISTORY), exponent=1.5)
    assert fit.operator.exponent == 1.5 and fit.deviation < 1e-9
    line = BoucWen.identify(HISTORY, 2.0 * HISTORY + 1.0)
    assert line.deviation < 1e-6
    assert set(line.undetermined) >= {"beta", "gamma", "exponent"}


@pytest.mark.parametrize("size", [1e-4, 1e4])
@pytest.mark.parametrize("name", ["plays", "relays", "bouc-wen"])
def test_fits_do_not_depend_on_the_unit_of_the_response(name, size):
    kind, options = CASES[name]
    response = TRUTHS[name].apply(HISTORY)
    fit = kind.identify(HISTORY, size * response, **options)
    assert fit.deviation < 1e-9 * size
    assert fit.operator.apply(HISTORY) == pytest.approx(size * response, abs=1e-8 * size)


def test_asymmetric_with_a_known_envelope():
    truth = OPERATORS["asymmetric"]
    options = {"thresholds": truth.thresholds, "envelope": truth.envelope}
    fit = AsymmetricPrandtlIshlinskii.identify(HISTORY, truth.apply(HISTORY), **options)
    assert list_numbers(fit.operator) == pytest.approx(list_numbers(truth), abs=1e-9)
    with pytest.raises(InputError, match=r"^history\[\d+\] is 1: there the envelope falls"):
        AsymmetricPrandtlIshlinskii.identify(
            HISTORY, HISTORY, **(options | {"envelope": (0.1, 1.0, -1.0)})
        )


def test_the_shape_of_plays_is_told_only_where_there_are_plays():
    """A line is made by none; what was given was not fitted."""
    line, rungs = 2.0 * HISTORY + 0.1, (0.05, 0.2)
    fit = AsymmetricPrandtlIshlinskii.identify(HISTORY, line, thresholds=rungs)
    assert "envelope" in fit.undetermined
    fit = AsymmetricPrandtlIshlinskii.identify(
        HISTORY, line, thresholds=rungs, envelope=(0.0, 1.0, 0.0)
    )
    assert "envelope" not in fit.undetermined
    fit = UnparallelPrandtlIshlinskii.identify(HISTORY, line, thresholds=(0.0, *rungs))
    assert "descending_slopes" in fit.undetermined


@pytest.mark.parametrize("name", sorted(set(CASES) - {"slips", "maxwell-slip"}))
@settings(max_examples=4, deadline=None)
@given(data=st.data())
def test_any_loops_have_a_fit_that_is_finite(name, data):
    size = data.draw(st.integers(3, 20))
    low = 0.0 if name == "band" else -1.0
    numbers = st.lists(st.floats(low, 1.0), min_size=size, max_size=size)
    history, response = data.draw(numbers), data.draw(numbers)
    history[0], history[1] = 0.0, 0.75
    fit = CASES[name][0].identify(history, response)
    assert np.all(np.isfinite(fit.residual)) and np.isfinite(fit.deviation)
    # no worse than a constant; the band has none and may lose all of the pressure only
    worst = np.abs(history).max() if name == "band" else 1e-6
    assert fit.deviation <= np.sqrt(np.mean(np.square(response))) + worst


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 5), st.integers(0, 1000))
def test_bounded_least_squares_meets_its_conditions(count, seed):
    """Karush, Kuhn and Tucker: no gradient inside, the right sign at a bound."""
    random = np.random.default_rng(seed)
    columns, target = random.normal(size=(30, count)), random.normal(size=30) + 3.0
    found = fit_linear(
        columns, target, names="abcde"[:count], limits=(0.0, 0.1), free=np.ones((30, 1))
    )
    values = np.array(found.values)
    gradient = -columns.T @ found.residual
    assert found.residual.sum() == pytest.approx(0.0, abs=1e-9)
    inside = (values > 0.0) & (values < 0.1)
    assert gradient[inside] == pytest.approx(0.0, abs=1e-7)
    assert np.all(gradient[values == 0.0] > -1e-7) and np.all(gradient[values == 0.1] < 1e-7)
