"""What all operators of hysteresis have in common."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle import EnergyMuscle, Hysteresis, preset
from bozzini.muscle.hysteresis import HysteresisState, MaxwellSlip, PrandtlIshlinskii
from tests.muscle.hysteresis.reference import OPERATORS, PLAIN, list_histories, refine

NAMES = sorted(OPERATORS)
CLOSED = [name for name in NAMES if not name.startswith("bouc-wen")]
"""Operators whose minor loops close; those of Bouc-Wen do not."""


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25, deadline=None)
@given(history=list_histories(longest=12))
def test_compiled_is_the_plain_recursion(name, history):
    plain = PLAIN[name](OPERATORS[name], history)
    assert OPERATORS[name].apply(history) == pytest.approx(plain, rel=0.0, abs=1e-8)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25, deadline=None)
@given(history=list_histories(), count=st.integers(2, 7))
def test_more_samples_on_the_way_change_nothing(name, history, count):
    operator = OPERATORS[name]
    fine, places = refine(history, operator.rest_input, count)
    assert operator.apply(fine)[places] == pytest.approx(operator.apply(history), abs=1e-9)
    still = np.repeat(history, 3)
    assert np.array_equal(operator.apply(still)[::3], operator.apply(history))


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25, deadline=None)
@given(history=list_histories(), data=st.data())
def test_memory_goes_on_where_it_ended(name, history, data):
    operator = OPERATORS[name]
    cut = data.draw(st.integers(0, len(history)))
    whole, last = operator.run(history)
    first, state = operator.run(history[:cut])
    second, end = operator.run(history[cut:], initial=state)
    assert np.concatenate([first, second]) == pytest.approx(whole, abs=1e-12)
    assert end.last == last.last == history[-1]
    assert end.memory == pytest.approx(last.memory, abs=1e-12)
    # nothing stays behind from one call to the next
    assert np.array_equal(operator.apply(history), whole)


@pytest.mark.parametrize("name", NAMES)
def test_histories_of_a_batch_do_not_touch_each_other(name):
    operator = OPERATORS[name]
    batch = np.random.default_rng(2).uniform(0.0, 1.0, (3, 4, 20))
    output, state = operator.run(batch)
    assert output.shape == batch.shape
    assert state.last.shape == (3, 4) and state.memory.shape == (3, 4, operator.memory_size)
    assert np.array_equal(output[1, 2], operator.apply(batch[1, 2]))
    again = operator.run(batch, initial=state)[0]
    own = HysteresisState(state.last[1, 2], state.memory[1, 2])
    assert np.array_equal(again[1, 2], operator.run(batch[1, 2], initial=own)[0])
    shared = operator.run(batch, initial=own)[0]
    assert np.array_equal(shared[0, 0], operator.run(batch[0, 0], initial=own)[0])
    assert operator.apply(np.empty((2, 0))).shape == (2, 0)


@pytest.mark.parametrize("name", CLOSED)
@settings(max_examples=25, deadline=None)
@given(history=list_histories(longest=8), inner=st.floats(0.0, 1.0))
def test_minor_loops_close_and_are_forgotten(name, history, inner):
    operator = OPERATORS[name]
    low, high = sorted(history[-2:]) if len(history) > 1 else (0.0, history[0])
    middle = low + inner * (high - low)
    base = [*history, low, high]
    loop = operator.apply([*base, middle, high, 1.0, 0.4])
    bare = operator.apply([*base, high, high, 1.0, 0.4])
    assert loop[-2:] == pytest.approx(bare[-2:], abs=1e-12)
    if name != "band" or middle == high:
        assert loop[-3] == pytest.approx(loop[len(base) - 1], abs=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_there_is_a_loop(name):
    up = np.linspace(0.05, 0.95, 10)  # on no level, where relays jump
    history = np.concatenate([[0.0], up, [1.0], up[::-1]])
    output = OPERATORS[name].apply(history)
    apart = output[12:][::-1] - output[1:11]
    sign = -1.0 if name == "slips" else 1.0  # the force resists, the others lag
    assert np.all(sign * apart[1:-1] > 1e-3)


@pytest.mark.parametrize("name", sorted(set(NAMES) - {"slips", "relays"}))
def test_a_muscle_carries_it(name):
    operator = OPERATORS[name]
    assert isinstance(operator, Hysteresis)
    muscle = preset("effector-45")
    up = np.linspace(0.0, 0.8, 9)
    history = np.concatenate([up, up[-2::-1]])
    traced = EnergyMuscle(muscle, hysteresis=operator).trace_contraction(history, 0.2)
    plain = EnergyMuscle(muscle).contraction(operator.apply(history), 0.2)
    assert traced == pytest.approx(plain, abs=1e-12)
    assert np.all(traced[9:-1] > traced[7:0:-1])  # lags: shorter on the way down than up


def test_a_muscle_carries_maxwell_slip_as_the_pressure_that_is_left():
    friction = MaxwellSlip((0.5, 0.2), (0.02, 0.03))
    acting = friction.to_plays()
    up = np.linspace(0.0, 0.8, 9)
    history = np.concatenate([up, up[-2::-1]])
    assert acting.apply(history) == pytest.approx(history - friction.apply(history), abs=1e-12)
    model = EnergyMuscle(preset("effector-45"), hysteresis=acting)
    expected = EnergyMuscle(model.muscle).contraction(history - friction.apply(history))
    assert model.trace_contraction(history) == pytest.approx(expected, abs=1e-9)
    with pytest.raises(InputError, match=r"pressure from the hysteresis\[1\] is -0.2 MPa"):
        EnergyMuscle(model.muscle, hysteresis=PrandtlIshlinskii((0.0,), (-2.0,))).trace_contraction(
            [0.0, 0.1]
        )


def test_operators_are_values():
    assert {OPERATORS[name]: name for name in NAMES} == {v: k for k, v in OPERATORS.items()}
    state = OPERATORS["slips"].run([0.1])[1]
    with pytest.raises(ValueError):
        state.memory[0] = 0.0
