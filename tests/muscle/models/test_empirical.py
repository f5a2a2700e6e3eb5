"""Empirical pulls: Gaylord's is one of them where it can be, and constants are found again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle.models import MODELS
from tests.muscle.models.catalogue import MUSCLE, build, find_lengths
from tests.muscle.models.relations import (
    WAYS,
    ask_anything,
    check_model,
    find_unused,
    pull,
    recover_linear,
)
from tests.muscle.strategies import muscles

NAMES = [
    "takosoglu", "doric", "quartic-strain", "quadratic-strain", "damped-strain", "linear-strain",
]  # fmt: skip
IDEAL = build("gaylord-1")
LOCKED = IDEAL.braid.locking_contraction
AREA = math.pi * MUSCLE.braid_radius**2
Q1 = 3.0 / math.tan(MUSCLE.braid_angle) ** 2
Q2 = 1.0 / math.sin(MUSCLE.braid_angle) ** 2


@pytest.mark.parametrize("name", NAMES)
def test_models_are_models(name):
    check_model(build(name), [0.1, 0.5], [0.0, 0.05])
    kind, constants = MODELS[name], build(name).keywords
    assert find_unused(lambda muscle: kind(muscle, **constants)) == set(kind.unused)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)


@pytest.mark.parametrize("name", ["takosoglu", "quartic-strain"])
@settings(max_examples=30)
@given(muscles(), st.floats(0.0, 1.0), st.floats(0.0, 10.0))
def test_gaylord_is_one_of_them(name, muscle, share, pressure):
    model, ideal = build(name, muscle), build("gaylord-1", muscle)
    low, high = ideal.contraction_limits
    contraction = low + share * (high - low)
    scale = abs(float(ideal.blocked_force(pressure)))
    constant = 3.0 * math.pi * muscle.braid_radius**2 / math.tan(muscle.braid_angle) ** 2
    assert model.force(pressure, contraction) == pytest.approx(
        float(ideal.force(pressure, contraction)),
        abs=1e-11 * (scale + pressure * constant) + 1e-300,
    )


@pytest.mark.parametrize("name", ["quadratic-strain", "damped-strain", "linear-strain"])
def test_guesses_have_gaylords_ends(name):
    """Blocked force and free strain at a pressure of 0.5 MPa."""
    model = build(name)
    assert model.blocked_force(0.5) == pytest.approx(float(IDEAL.blocked_force(0.5)), rel=1e-12)
    assert model.free_contraction(0.5) == pytest.approx(LOCKED, rel=1e-10)


# Takosoglu ----------------------------------------------------------------------------------------


def fading(power=2.5, **changes):
    given = {"kappa1": 0.6, "kappa2": 0.3, "kappa3": power, "kappa4": 1.2, "kappa5": 0.2,
             "kappa6": Q1}  # fmt: skip
    return build("takosoglu", **{**given, **changes})


def test_takosoglu_is_the_equation_of_its_card():
    model, lengths = fading(), find_lengths(IDEAL)
    for pressure in (0.0, 0.1, 0.6):
        power = 0.6 * math.exp(-pressure / 0.3) + 2.5
        first = 1.2 * math.exp(-pressure / 0.2) + Q1
        expected = AREA * pressure * (first * (lengths / 42.0) ** power - Q2)
        assert pull(model, pressure, lengths) == pytest.approx(expected, rel=1e-11, abs=1e-13)
    free = 42.0 * (1.0 - (Q2 / (1.2 * math.exp(-3.0) + Q1)) ** (1.0 / (0.6 * math.exp(-2.0) + 2.5)))
    assert model.free_contraction(0.6) == pytest.approx(free, rel=1e-11)


def test_takosoglu_as_printed_is_four_times_that():
    lengths = find_lengths(IDEAL)
    assert pull(fading(as_printed=True), 0.4, lengths) == pytest.approx(
        4.0 * pull(fading(), 0.4, lengths), rel=1e-12
    )


def test_takosoglu_needs_what_fades_only_if_it_fades():
    MODELS["takosoglu"](MUSCLE, kappa1=0.0, kappa3=2.0, kappa4=0.0, kappa6=Q1)
    with pytest.raises(InputError, match="must be given kappa2, kappa5: the survey"):
        MODELS["takosoglu"](MUSCLE, kappa1=1.0, kappa3=2.0, kappa4=1.0, kappa6=Q1)


TAKOSOGLU = st.tuples(
    st.floats(0.3, 1.5), st.floats(0.15, 0.5), st.floats(1.5, 3.0), st.floats(0.5, 3.0),
    st.floats(0.15, 0.5), st.floats(4.0, 7.0),
)  # fmt: skip


@settings(max_examples=15)
@given(TAKOSOGLU)
def test_takosoglus_constants_are_found_again(values):
    """By bounded least squares from the first guess, in which nothing fades."""
    from scipy.optimize import least_squares

    kind = MODELS["takosoglu"]
    names = [f"kappa{i + 1}" for i in range(6)]
    truth = dict(zip(names, values, strict=True))
    pressure, contraction = np.linspace(0.05, 0.8, 12)[:, None], np.linspace(-2.0, 18.0, 15)

    def forces(x):
        return kind(MUSCLE, **dict(zip(names, x, strict=True))).force(pressure, contraction).ravel()

    guess = kind.guess_parameters(MUSCLE)
    measured = forces(values)
    fit = least_squares(lambda x: forces(x) - measured, [guess[name] for name in names],
                        x_scale="jac", bounds=np.transpose([item.bounds for item in
                        kind.card.parameters]), xtol=1e-15, ftol=1e-15, gtol=1e-15)  # fmt: skip
    assert dict(zip(names, fit.x, strict=True)) == pytest.approx(truth, abs=1e-8)


@settings(max_examples=15)
@given(st.floats(-3.0, 3.0), st.floats(2.0, 9.0))
def test_takosoglus_linear_constants_are_found_again(kappa4, kappa6):
    given = {"kappa1": 0.6, "kappa2": 0.3, "kappa3": 2.5, "kappa5": 0.2}
    truth = {"kappa4": kappa4, "kappa6": kappa6}
    assert recover_linear("takosoglu", truth | given) == pytest.approx(truth, abs=1e-8)


# Doric --------------------------------------------------------------------------------------------


def test_doric_without_constants_is_chou():
    chou, lengths = build("chou"), find_lengths(build("chou"))
    assert np.array_equal(pull(build("doric"), 0.4, lengths), pull(chou, 0.4, lengths))
    assert build("doric").contraction_limits == chou.contraction_limits


def test_doric_takes_a_force_of_width_and_one_of_pressure_and_strain():
    def width(strain):
        return 1.0 - strain

    model, chou = build("doric", kappa1=0.8, kappa2=60.0, relative_width=width), build("chou")
    lengths = find_lengths(chou)
    strain = 1.0 - lengths / 42.0
    taken = 0.8 * strain + 60.0 * 0.4 * strain / 42.0
    assert pull(chou, 0.4, lengths) - pull(model, 0.4, lengths) == pytest.approx(taken, rel=1e-9)
    assert model.blocked_force(0.4) == pytest.approx(float(chou.blocked_force(0.4)), rel=1e-12)
    assert model.contraction(0.4) < chou.contraction(0.4)
    # A spring of kappa1 / l0 without pressure.
    assert model.stiffness(0.0, [0.0, 5.0]) == pytest.approx([0.8 / 42.0] * 2, rel=1e-8)
    grows = build("doric", kappa1=0.8, relative_width=lambda strain: 1.0 + strain)
    assert grows.force(0.4, 5.0) > chou.force(0.4, 5.0)


def test_doric_needs_the_width_only_for_its_force():
    build("doric", kappa2=10.0)
    with pytest.raises(MissingLawError, match=r"relative_width\(strain of contraction\).*\[96\]"):
        build("doric", kappa1=1.0)


# Polynomials --------------------------------------------------------------------------------------


def test_polynomials_are_the_equations_of_their_cards():
    k = dict(zip([f"kappa{i}" for i in range(1, 9)],
                 [1.2, -2.1, 0.7, 0.3, -0.4, 0.6, -1.1, 2.3], strict=True))  # fmt: skip
    contraction = 42.0 - find_lengths(IDEAL)
    e, p = contraction / 42.0, 0.6
    k1, k2, k3, k4, k5, k6, k7, k8 = k.values()
    five = {name: k[name] for name in list(k)[:5]}
    for name, constants, expected in (
        ("quartic-strain", k, (k1 + k2 * e + k3 * e**2) * p
         + k4 + k5 * e + k6 * e**2 + k7 * e**3 + k8 * e**4),
        ("quadratic-strain", five, k1 + k2 * e + k3 * e**2 + k4 * p + k5 * e * p),
        ("damped-strain", five, (k1 * p**2 + k2 * p + k3) * e + k4 * p + k5),
    ):  # fmt: skip
        model = build(name, **constants)
        assert model.force(p, contraction) == pytest.approx(expected, rel=1e-11, abs=1e-12)


def test_damping_is_of_the_rate_of_strain():
    model = build("damped-strain", kappa6=-2.0, strain_rate=0.05)
    up, free, down = model.force(0.4, 3.0, direction=WAYS)
    assert (up - free, down - free) == pytest.approx((-0.1, 0.1), rel=1e-11)
    still = build("damped-strain", kappa6=-2.0)
    assert np.ptp(still.force(0.4, 3.0, direction=WAYS)) == 0.0
    up, free, down = model.contraction(0.4, 0.3, direction=WAYS)
    assert up < free < down


def test_the_line_ends_at_the_largest_strain():
    model = build("linear-strain", kappa1=0.7, largest_force=2.0, largest_strain=0.2)
    assert model.force([0.0, 0.4, 2.0], 0.0) == pytest.approx([1.4, 1.4, 1.4])
    assert model.free_contraction(0.4) == pytest.approx(0.2 * 42.0, rel=1e-12)
    assert model.stiffness(0.4, 3.0) == pytest.approx(1.4 / 8.4, rel=1e-9)


LINEAR = {
    "quartic-strain": ({f"kappa{i}": 1.0 for i in range(1, 9)}, {}),
    "quadratic-strain": ({f"kappa{i}": 1.0 for i in range(1, 6)}, {}),
    "damped-strain": ({f"kappa{i}": 1.0 for i in range(1, 7)}, {"strain_rate": 0.1}),
    "linear-strain": ({"kappa1": 1.0}, {}),
    "doric": ({"kappa1": 1.0, "kappa2": 100.0}, {"relative_width": lambda e: 1.0 - e}),
}


@pytest.mark.parametrize("name", LINEAR)
@settings(max_examples=15)
@given(data=st.data())
def test_linear_constants_are_found_again(name, data):
    scales, fixed = LINEAR[name]
    truth = {key: scale * data.draw(st.floats(-5.0, 5.0)) for key, scale in scales.items()}
    linear = {item.name for item in MODELS[name].card.parameters if item.linear}
    assert linear == set(truth)
    found = recover_linear(name, truth, **fixed)
    for key, value in truth.items():
        assert found[key] == pytest.approx(value, abs=1e-8 * scales[key])


def test_constants_have_to_be_given():
    for name, missing in (
        ("takosoglu", "kappa1, kappa3, kappa4, kappa6"), ("doric", "kappa1, kappa2"),
        ("quartic-strain", "kappa1, kappa2, kappa3, kappa4, kappa5, kappa6, kappa7, kappa8"),
        ("damped-strain", "kappa1, kappa2, kappa3, kappa4, kappa5"),
        ("linear-strain", "kappa1, largest_force, largest_strain"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"must be given {missing}: the survey has no values"):
            MODELS[name](MUSCLE)
