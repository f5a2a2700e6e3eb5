"""Plays between two curves: an inverse of the same form, loops that are not symmetric, fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.hysteresis import (
    AsymmetricPrandtlIshlinskii,
    BoucWen,
    FrictionBand,
    GeneralisedPrandtlIshlinskii,
    HysteresisState,
    LoopOptions,
    MonotoneCurve,
    PrandtlIshlinskii,
    Preisach,
    UnparallelPrandtlIshlinskii,
)
from tests.muscle.hysteresis.reference import OPERATORS, list_histories

TRUTH = OPERATORS["generalised"]
INVERTIBLE = ("plays", "generalised", "asymmetric")
positive = st.floats(0.05, 2.0)


@st.composite
def list_operators(draw):
    count, corners = draw(st.integers(1, 4)), draw(st.integers(2, 4))
    steps = draw(st.lists(positive, min_size=count, max_size=count))
    curves = [
        MonotoneCurve(
            *(
                tuple(np.cumsum(draw(st.lists(positive, min_size=corners, max_size=corners))))
                for _ in "xy"
            )
        )
        for _ in range(2)
    ]
    rungs = (0.0, *np.cumsum(steps[:-1]).tolist())
    weights = tuple(draw(st.lists(positive, min_size=count, max_size=count)))
    return GeneralisedPrandtlIshlinskii(PrandtlIshlinskii(rungs, weights), *curves)


@settings(max_examples=40, deadline=None)
@given(operator=list_operators(), history=list_histories(-2.0, 2.0))
def test_the_inverse_undoes_it_and_is_undone_by_it(operator, history):
    inverse = operator.invert()
    output = operator.apply(history)
    size = 1e-9 * (1.0 + np.abs(output).max())
    assert inverse.apply(output) == pytest.approx(history, abs=1e-7)
    assert operator.apply(inverse.apply(output)) == pytest.approx(output, abs=size)
    # another route: bisection, sample by sample
    stepped = operator.invert_history(output, between=(-3.0, 3.0))
    assert stepped == pytest.approx(history, abs=1e-7)
    assert inverse.invert().plays.weights == pytest.approx(operator.plays.weights)


@settings(max_examples=40, deadline=None)
@given(operator=list_operators(), history=list_histories(-2.0, 2.0), data=st.data())
def test_it_rises_and_falls_with_its_input(operator, history, data):
    _, state = operator.run(history)
    low, high = sorted(data.draw(st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))))
    up = operator.run(np.linspace(low, high, 20), initial=state)[0]
    assert np.all(np.diff(up) >= -1e-9 * (1.0 + np.abs(up).max()))


def test_the_state_of_the_inverse_goes_on():
    wanted = TRUTH.apply([0.2, 0.7, 0.4, 0.9, 0.1])
    asked, state = TRUTH.run([0.2, 0.7])
    inverse = TRUTH.invert()
    rest = inverse.run(wanted[2:], initial=TRUTH.invert_state(state))[0]
    assert rest == pytest.approx([0.4, 0.9, 0.1], abs=1e-12)
    assert TRUTH.invert_history(wanted[2:], between=(0.0, 1.0), initial=state) == pytest.approx(
        [0.4, 0.9, 0.1], abs=1e-9
    )


@pytest.mark.parametrize("name", INVERTIBLE)
def test_what_is_out_of_reach_is_clipped_where_asked(name):
    operator = OPERATORS[name]
    history = np.array([0.0, 0.5, 1.0, 0.3, 0.8])
    wanted = operator.apply(history)
    far = np.where(history == 1.0, wanted + 5.0, wanted)
    found = operator.invert_history(far, between=(0.0, 1.0), clip=True)
    assert found == pytest.approx(history, abs=1e-9)  # as if the bound itself had been wanted
    with pytest.raises(InputError, match=r"^response\[2\] is "):
        operator.invert_history(far, between=(0.0, 1.0))


def test_an_output_curve_bends_loops_that_were_congruent():
    """Congruency is a condition for sums of plays (Mayergoyz); test_preisach has it for relays."""
    loop = [0.3, 0.5, 0.3, 0.5, 0.3]
    operator = replace(TRUTH, output=MonotoneCurve((0.0, 0.5, 0.8), (0.0, 0.2, 0.9)))
    low, high = (operator.apply([*before, *loop])[-3:] for before in ([0.3, 0.0], [1.0]))
    assert abs(np.ptp(low) - np.ptp(high)) > 0.01
    flat = operator.output.invert()
    assert np.ptp(flat.apply(low)) == pytest.approx(np.ptp(flat.apply(high)), abs=1e-12)


def grow(count=60):
    tops = [top for level in (0.3, 0.6, 0.9, 1.0, 0.7, 0.4) for top in (level, 0.1)]
    return np.interp(np.linspace(0, len(tops), count * len(tops)), range(len(tops) + 1), [0, *tops])


def test_fits_take_bent_loops_that_plays_alone_do_not():
    history = grow()
    truth = replace(TRUTH, input=MonotoneCurve())
    response = truth.apply(history)
    fit = GeneralisedPrandtlIshlinskii.identify(history, response)
    alone = PrandtlIshlinskii.identify(history, response)
    assert fit.converged and fit.deviation < 0.003 * np.ptp(response)
    assert alone.deviation > 5.0 * fit.deviation
    other = np.abs(np.sin(np.linspace(0.0, 9.0, 300) ** 1.3))
    assert fit.operator.apply(other) == pytest.approx(truth.apply(other), abs=0.02)


@pytest.mark.parametrize(
    "kind",
    [
        GeneralisedPrandtlIshlinskii,
        PrandtlIshlinskii,
        AsymmetricPrandtlIshlinskii,
        UnparallelPrandtlIshlinskii,
        BoucWen,
        Preisach,
        FrictionBand,
    ],
)
def test_a_carried_operator_is_0_at_rest_and_never_negative(kind):
    """On an asymmetric loop that is off by a constant and drifts, with noise."""
    history, random = grow(30), np.random.default_rng(3)
    time = np.linspace(0.0, 1.0, len(history))
    response = TRUTH.apply(history) - 0.07 + 0.05 * time + 0.005 * random.normal(size=len(time))
    terms = np.stack([np.ones_like(time), time], axis=-1)
    fit = kind.identify(history, response, options=LoopOptions(carried=True, terms=terms))
    assert len(fit.terms) == 2
    rebuilt = fit.operator.apply(history) + terms @ fit.terms
    assert response - rebuilt == pytest.approx(fit.residual, abs=1e-12)
    assert fit.operator.apply([0.0])[0] == pytest.approx(0.0, abs=1e-12)
    for _ in range(20):
        other = random.uniform(0.0, 1.2, 40) * (random.random(40) > 0.2)
        assert fit.operator.apply(other).min() >= -1e-12


def test_weights_and_terms_are_those_of_least_squares():
    """Weight 2 is the same as the sample twice; a term is found whatever its factor's sign."""
    history, random = grow(20), np.random.default_rng(4)
    response = OPERATORS["plays"].apply(history) + 0.02 * random.normal(size=len(history))
    plain = PrandtlIshlinskii.identify(
        np.stack([history, history]), np.stack([response, response]), count=4
    )
    doubled = PrandtlIshlinskii.identify(
        history, response, count=4, options=LoopOptions(weights=np.full(len(history), 2.0))
    )
    assert doubled.operator.weights == pytest.approx(plain.operator.weights, abs=1e-9)
    wave = np.sin(np.arange(len(history)) / 7.0)
    fit = PrandtlIshlinskii.identify(
        history, response - 0.3 * wave, count=4, options=LoopOptions(terms=wave[:, None])
    )
    assert fit.terms[0] == pytest.approx(-0.3, abs=0.01)


REFUSALS = [
    (lambda: MonotoneCurve((0.0,), (1.0,)), "inputs has 1 number", "2 or more"),
    (lambda: MonotoneCurve((0.0, 1.0), (1.0, 1.0)), "outputs[1] is 1", "above 1"),
    (lambda: GeneralisedPrandtlIshlinskii(3.0), "plays is a float", "a PrandtlIshlinskii"),
    (lambda: TRUTH.invert_state(HysteresisState(0.0, (0.0,))), "initial has last ()", "(3,)"),
    (
        lambda: GeneralisedPrandtlIshlinskii.identify([0.0, 1.0], [0.0, 1.0], thresholds=(0.1,)),
        "thresholds[0] is 0.1",
        "[0, 0]",
    ),
    (
        lambda: PrandtlIshlinskii.identify(
            [0.0, 1.0], [0.0, 1.0], options=LoopOptions(weights=[1.0])
        ),
        "weights have shape (1,)",
        "(2,)",
    ),
    (
        lambda: PrandtlIshlinskii.identify(
            [0.0, 1.0], [0.0, 1.0], options=LoopOptions(weights=[0.0, 0.0])
        ),
        "weights are 0",
        "above 0",
    ),
]


@pytest.mark.parametrize(("call", "field", "legal"), REFUSALS)
def test_refused(call, field, legal):
    with pytest.raises(InputError) as caught:
        call()
    assert field in str(caught.value) and legal in str(caught.value)
