"""What all models share: arrays in and out, refusals in one clear line, and the history hook."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.checks import list_quantities
from bozzini.errors import InputError
from bozzini.muscle import (
    MODELS,
    ConvergenceError,
    EnergyMuscle,
    Hysteresis,
    Muscle,
    MuscleModel,
    MuscleState,
    ThesisMuscle,
    preset,
)
from bozzini.muscle.design import BRAID_ANGLES
from bozzini.muscle.kernels import (
    ends as _end_kernels,
)
from bozzini.muscle.kernels import (
    energy as _kernels,
)
from bozzini.muscle.kernels import (
    thesis as _thesis_kernels,
)
from tests.muscle.models.catalogue import OWN
from tests.muscle.strategies import muscles

BUILDS = {
    "energy": lambda muscle, **rest: EnergyMuscle(muscle, **rest),
    "trellis": lambda muscle, **rest: EnergyMuscle(muscle, ends="trellis", **rest),
    "thesis": lambda muscle, **rest: ThesisMuscle(muscle, load_path="bulk", **rest),
}


@pytest.fixture(params=BUILDS)
def model(request):
    return BUILDS[request.param](preset("effector-45", friction_length=0.02))


def test_models_by_name():
    for name in OWN:
        kind = MODELS[name]
        built = kind(preset("effector-45"))
        assert built.name == name
        assert built.muscle == preset("effector-45")
        assert isinstance(built, MuscleModel)


@pytest.mark.parametrize("name", OWN)
def test_unused_fields_make_no_difference_and_the_others_do(name):
    muscle = preset("effector-45", end_length=4.0, friction_length=0.01, poisson_ratio=0.49)

    def answer(muscle):
        return float(MODELS[name](muscle).contraction(0.5, direction="inflating"))

    changes = {field: 1.01 * getattr(muscle, field) for field in list_quantities(Muscle)}
    changes |= {"strands": 28, "dead_length": 2.0, "mooney_ratio": 0.1}
    unused = {field for field, value in changes.items()
              if answer(muscle.replace(**{field: value})) == answer(muscle)}  # fmt: skip
    assert unused == set(MODELS[name].unused)


def test_a_batch_is_its_members(model):
    pressure = np.array([[0.0], [0.05], [0.3], [0.8]])
    load = np.array([0.0, 0.02, 0.4])
    contraction = model.contraction(pressure, load)
    state = model.solve(pressure, load)
    assert contraction.shape == (4, 3)
    for i in range(4):
        for j in range(3):
            one = model.contraction(float(pressure[i, 0]), float(load[j]))
            assert one.shape == ()
            assert one == contraction[i, j] == state.contraction[i, j]
    force = model.force(pressure, np.minimum(contraction, 0.0))
    assert force.shape == (4, 3)
    assert force[2, 1] == model.force(0.3, min(contraction[2, 1], 0.0))
    assert model.stiffness(pressure, np.minimum(contraction, 0.0)).shape == (4, 3)
    assert model.contraction([], []).shape == (0,)


def test_states_fit_together(model):
    pressure, load = np.meshgrid(np.linspace(0.0, 0.8, 7), [0.0, 0.3])
    state = model.solve(pressure, load)
    assert isinstance(state, MuscleState)
    assert state.length + state.contraction == pytest.approx(model.muscle.length)
    assert state.force == pytest.approx(load, abs=1e-9)
    assert state.converged.all()
    assert np.all(state.reason == "")
    assert np.all(np.abs(state.residual) < 1e-9)
    assert np.all(state.in_contact == (state.contact_pressure > 0.0))
    assert np.all(state.contact_pressure[0] <= pressure[0])
    assert np.array_equal(model.braid_angle(pressure, load), state.braid_angle)
    for values in vars(state).values():
        assert values.shape == pressure.shape


def test_blocked_and_free(model):
    pressure = np.array([0.3, 0.6])
    free = model.free_contraction(pressure)
    assert np.array_equal(free, model.contraction(pressure, 0.0))
    assert model.force(pressure, free) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.array_equal(model.blocked_force(pressure), model.force(pressure, 0.0))
    assert np.all(model.blocked_force(pressure) > 0.0)
    assert 0.0 < model.dead_band() < 0.15


def test_directions(model):
    words = ["inflating", "", "deflating"]
    together = model.contraction(0.6, 0.1, direction=words)
    for word, contraction in zip(words, together, strict=True):
        assert model.contraction(0.6, 0.1, direction=word) == contraction
    assert model.contraction(0.6, 0.1, direction=None) == together[1]
    assert model.contraction([0.6] * 3, 0.1, direction=np.array(words)) == pytest.approx(together)
    assert np.all(np.diff(together) > 0.0) or model.name == "thesis"
    with pytest.raises(InputError, match="direction is 'up': it must be 'inflating', 'deflating'"):
        model.contraction(0.6, direction="up")
    with pytest.raises(InputError, match="direction is 'down'"):
        model.force(0.6, 0.0, direction=["inflating", "down"])


@pytest.mark.parametrize(
    ("pressure", "load", "words"),
    [
        (-0.1, 0.0, r"^pressure is -0\.1 MPa: it must lie in \[0, [12]0\] MPa"),
        (700, 0.0, r"^pressure is 700 MPa: it must lie in \[0, [12]0\] MPa"),
        ([0.1, math.nan], 0.0, r"^pressure\[1\] is nan MPa: it must lie in \[0, [12]0\] MPa"),
        ([[0.1, 0.2], [0.3, math.inf]], 0.0, r"^pressure\[1, 1\] is inf MPa: it must lie in"),
        (0.5, [0.0, -0.2], r"^load\[1\] is -0\.2 N: it must lie in \[0, "),
        (0.5, math.nan, r"^load is nan N: it must lie in \[0, "),
        (0.5, [1.0, 1e6], r"^load\[1\] is 1e\+06 N: at a pressure of 0\.5 MPa it must lie in \["),
        ([0.1, 0.2], [0.0, 0.0, 0.0], r"^these shapes do not go together: pressure \(2,\), load"),
        ("high", 0.0, r"^pressure is 'high': it must be a number"),
        (0.5, ["much", "little"], r"^load is \['much', 'little'\]: it must be a number"),
        ("0.5", 0.0, r"^pressure is '0\.5': it must be a number"),
        ([["0.5", "0.6"], ["0.7", "0.8"]], 0.0, r"^pressure is \[\['0\.5', '0\.6'\]"),
        (np.full((30, 2), "x"), 0.0, r"^pressure is array\("),
        (0.5 + 0.1j, 0.0, r"^pressure is \(0\.5\+0\.1j\)"),
        (np.array([0.5 + 0.1j]), 0.0, "^pressure is array"),
        (True, 0.0, "^pressure is True"),
        (np.ma.masked_greater([0.5, 5.0], 1.0), 0.0, "none of them masked"),
        (pint.Quantity(100.0, "psi"), 0.0, "^pressure is .* without a unit"),
        ([pint.Quantity(100.0, "psi")] * 2, 0.0, "^pressure is .* without a unit"),
        ([10**400], 0.0, "^pressure is .* it must be a number"),
    ],
)
def test_wrong_inputs_get_one_clear_line(model, pressure, load, words):
    for answer in (model.contraction, model.solve, model.braid_angle):
        with pytest.raises(InputError, match=words) as error:
            answer(pressure, load)
        assert "\n" not in str(error.value)


def test_a_mask_that_hides_nothing_is_no_mask(model):
    pressure = np.ma.masked_greater([0.5, 0.6], 1.0)
    assert np.array_equal(model.contraction(pressure), model.contraction([0.5, 0.6]))


def run_slowly(monkeypatch, name, limit):
    """Let the solver give up after `limit` iterations."""
    modules = (_thesis_kernels,) if name == "thesis" else (_kernels, _end_kernels)
    for module in modules:
        for function in list(vars(module).values()):
            if hasattr(function, "py_func"):
                monkeypatch.setattr(module, function.__name__, function.py_func)
        monkeypatch.setattr(module, "MAX_ITERATIONS", limit)


def test_a_solver_that_gives_up_says_so(model, monkeypatch):
    pressure = np.array([0.0, 0.6])  # without pressure there is nothing to solve
    good = model.solve(pressure)
    run_slowly(monkeypatch, model.name, 2)
    state = model.solve(pressure)
    assert state.converged.tolist() == [True, False]
    assert state.reason.tolist() == ["", "the tolerance was not met within 2 iterations"]
    assert state.contraction[0] == good.contraction[0]
    assert abs(state.residual[1]) > abs(good.residual[1])
    questions = [lambda: model.contraction(pressure)]
    if model.name == "thesis":
        questions.append(lambda: model.force(pressure, 0.0))
    else:
        questions += [lambda: model.volume(pressure), lambda: model.potential(pressure)]
        if model.ends == "trellis":
            questions.append(lambda: model.force(pressure, [0.0, 5.0]))
    for question in questions:
        with pytest.raises(ConvergenceError, match=r"\[1\] = .* within 2 iterations"):
            question()


def test_stiffness_along_a_branch_is_the_slope_of_its_force(model):
    step = 1e-4
    for direction in ("inflating", "deflating", ""):
        ends = model.force(0.5, 5.0 + step * np.array([-1.0, 1.0]), direction=direction)
        stiffness = model.stiffness(0.5, 5.0, direction=direction)
        assert stiffness == pytest.approx(-float(np.diff(ends)[0]) / (2.0 * step), rel=1e-5)


def test_the_largest_forces_are_loads_too():
    """What a legal muscle pulls, it can be asked to hold."""
    huge = preset(
        "thesis-45", length=1e4, outer_radius=1e3, inner_radius=990.0, braid_angle=BRAID_ANGLES[0]
    )
    for name in ("energy", "thesis"):  # too short for trellis ends
        strong = BUILDS[name](huge.replace(modulus=1e3))
        pressure = 20.0 if strong.name == "energy" else 10.0
        force = strong.blocked_force(pressure)
        assert strong.contraction(pressure, force) == pytest.approx(0.0, abs=1e-5)
    assert EnergyMuscle(huge).blocked_force(20.0) > 2e9


@pytest.mark.parametrize("contraction", [-30.0, 40.0, math.nan])
def test_wrong_contractions_get_one_clear_line(model, contraction):
    for answer in (model.force, model.stiffness):
        with pytest.raises(InputError, match=rf"contraction\[1\] is {contraction:g} mm: .*must"):
            answer(0.3, [0.0, contraction])


@settings(max_examples=100)
@given(muscles(), st.floats(), st.floats(), st.sampled_from(["force", "contraction", "solve"]))
def test_any_float_is_answered_or_refused(muscle, pressure, other, question):
    for name, build in BUILDS.items():
        try:
            answer = getattr(build(muscle), question)(pressure, other)
        except InputError as error:
            assert "must" in str(error) or "no answer" in str(error) or "pulls" in str(error), name
            continue
        values = vars(answer).values() if question == "solve" else [answer]
        for value in values:
            assert value.dtype.kind == "U" or np.isfinite(value).all()


def test_models_are_values(model):
    again = pickle.loads(pickle.dumps(model))
    assert again == model
    assert again.contraction(0.5) == model.contraction(0.5)
    with pytest.raises(AttributeError):
        model.muscle = preset("thesis-45")


class Lag:
    """A play operator: the pressure that acts follows at a distance."""

    def apply(self, pressure, /):
        acting, history = 0.0, []
        for value in pressure:
            acting = min(max(acting, value - 0.05), value + 0.05)
            history.append(max(acting, 0.0))
        return np.array(history)


@pytest.mark.parametrize("name", BUILDS)
def test_hysteresis_that_is_none_is_refused(name):
    class Halving(Lag):
        def apply(self, pressure, /):
            return pressure[::2]

    class Lost(Lag):
        def apply(self, pressure, /):
            return np.full(len(pressure), math.nan)

    build = BUILDS[name]
    muscle = preset("effector-45")
    with pytest.raises(InputError, match="hysteresis is a float: it must have a method 'apply'"):
        build(muscle, hysteresis=0.3)
    with pytest.raises(InputError, match=r"shape \(2,\): it must be \(4,\)"):
        build(muscle, hysteresis=Halving()).trace_contraction(np.zeros(4))
    with pytest.raises(InputError, match="from the hysteresis.* is nan MPa"):
        build(muscle, hysteresis=Lost()).trace_contraction(np.zeros(4))
    with pytest.raises(InputError, match=r"pressure has shape \(2, 2\): a history has \(n,\)"):
        build(muscle, hysteresis=Lag()).trace_contraction(np.zeros((2, 2)))


@pytest.mark.parametrize("name", BUILDS)
def test_hysteresis_acts_along_a_history_only(name):
    assert isinstance(Lag(), Hysteresis)
    plain, lagging = (
        BUILDS[name](preset("effector-45"), hysteresis=operator) for operator in (None, Lag())
    )
    up = np.linspace(0.0, 0.8, 9)
    history = np.concatenate([up, up[-2::-1]])
    traced = lagging.trace_contraction(history)
    assert plain.trace_contraction(history) == pytest.approx(plain.contraction(history))
    assert traced == pytest.approx(plain.contraction(Lag().apply(history)))
    assert np.all(traced[9:-1] > traced[:8][::-1][:-1])  # longer on the way down than up
    assert np.array_equal(lagging.contraction(history), plain.contraction(history))
