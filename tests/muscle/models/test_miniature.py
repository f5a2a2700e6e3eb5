"""Miniature muscles: dead bands, thresholds, and the form that is solved for the strain."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import find_radius, pull_ideal
from tests.muscle.models.catalogue import MUSCLE, build, find_lengths
from tests.muscle.models.relations import (
    ask_anything,
    check_model,
    find_unused,
    pull,
    recover_linear,
)
from tests.muscle.strategies import muscles

IDEAL = build("gaylord-1")
RADIUS = MUSCLE.braid_radius
NEUTRAL = {"de-volder": {"smallest_force": -1e6}, "sangian": {}, "strain-fit": {}}
SPRING = {"spring_stiffness": 0.01, "slack_length": 30.0}


@pytest.mark.parametrize("name", NEUTRAL)
def test_models_are_models(name):
    check_model(build(name, **NEUTRAL[name]), [0.1, 0.5], [0.0, 0.05])
    kind = MODELS[name]
    constants = build(name, **(SPRING if name == "de-volder" else {})).keywords
    assert find_unused(lambda muscle: kind(muscle, **constants)) == set(kind.unused)


@pytest.mark.parametrize("name", NEUTRAL)
@settings(max_examples=30)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)


# De Volder ----------------------------------------------------------------------------------------


def test_de_volder_without_corrections_is_gaylord():
    model = build("de-volder", smallest_force=-1e6)
    lengths = find_lengths(IDEAL)
    assert np.array_equal(pull(model, 0.4, lengths), pull(IDEAL, 0.4, lengths))


@settings(max_examples=50)
@given(st.floats(0.0, 1.0), st.floats(-5.0, 5.0), st.floats(-1.0, 1.0), st.floats(0.0, 1.0))
def test_de_volder_is_above_its_threshold(offset, length_offset, smallest, pressure):
    model = build("de-volder", pressure_offset=offset, length_offset=length_offset,
                 smallest_force=smallest)  # fmt: skip
    lengths = find_lengths(model)
    force = pull(model, pressure, lengths)
    assert np.all(force >= smallest)
    ideal = pull_ideal(
        model.braid, np.asarray(max(pressure - offset, 0.0)), lengths - length_offset
    )
    assert force == pytest.approx(np.maximum(ideal, smallest), rel=1e-12, abs=1e-14)
    assert model.dead_band() == offset


def test_de_volder_stops_where_it_stops_pulling():
    """The pull is flat beyond: of all lengths without load, the first on the way."""
    model = build("de-volder", pressure_offset=0.1, length_offset=0.5)
    locked = IDEAL.braid.locking_contraction - 0.5
    assert model.contraction([0.2, 0.5, 0.8]) == pytest.approx([locked] * 3, rel=1e-12)
    assert np.all(model.force(0.5, [locked + 1.0, locked + 5.0]) == 0.0)
    assert np.array_equal(model.contraction([0.0, 0.05, 0.1]), [0.0, 0.0, 0.0])
    assert np.array_equal(model.solve([0.05, 0.1]).contact_pressure, [0.0, 0.0])


def test_de_volder_spring_only_pulls():
    model = build("de-volder", spring_stiffness=0.02, slack_length=40.0)
    assert pull(model, 0.0, np.array([35.0, 40.0, 41.0, 45.0])) == pytest.approx(
        [0.0, 0.0, 0.02, 0.1], rel=1e-12
    )
    stiff = pull(model, 0.3, 44.0) - pull(build("de-volder"), 0.3, 44.0)
    assert stiff == pytest.approx(0.08, rel=1e-12)
    with pytest.raises(InputError, match="must be given slack_length"):
        build("de-volder", spring_stiffness=0.02)


def test_de_volder_as_printed_divides_by_a_length():
    lengths = np.linspace(35.0, 45.0, 5)
    printed = pull(build("de-volder", as_printed=True), 0.4, lengths)
    strand = IDEAL.braid.strand_length
    scale = 0.4 * strand**2 / (4.0 * math.pi * IDEAL.braid.turns**2)
    assert printed == pytest.approx(scale * (3.0 * lengths**2 / strand - 1.0), rel=1e-12)
    assert np.all(printed > 20.0 * pull(build("de-volder"), 0.4, lengths))
    below = build("de-volder", as_printed=True, pressure_offset=0.2, smallest_force=-1e6)
    assert below.blocked_force(0.1) < 0.0
    assert below.replace(as_printed=False).blocked_force(0.1) == 0.0


def test_de_volder_needs_a_length():
    with pytest.raises(InputError, match="^length_offset of the model de-volder is 90 mm: it must"):
        build("de-volder", length_offset=90.0)
    short = build("de-volder", length_offset=20.0)
    with pytest.raises(InputError, match=r"^contraction is 21.5 mm: at a pressure of 0.1 MPa it"):
        short.force(0.1, 21.5)


# Sangian ------------------------------------------------------------------------------------------


def test_sangian_without_bladder_and_threshold_is_gaylord():
    lengths = find_lengths(IDEAL)
    soft = build("sangian", MUSCLE.replace(modulus=1e-9))
    assert pull(soft, 0.4, lengths) == pytest.approx(pull(IDEAL, 0.4, lengths), rel=1e-8, abs=1e-8)


def test_sangian_at_rest_has_no_elastic_pressure():
    model = build("sangian", threshold_pressure=0.07)
    assert model.blocked_force([0.2, 0.5]) == pytest.approx(
        IDEAL.blocked_force([0.13, 0.43]), rel=1e-12
    )
    assert model.dead_band() == 0.07
    assert np.array_equal(model.contraction([0.0, 0.05, 0.07]), [0.0, 0.0, 0.0])
    assert model.contraction(0.1) > 0.0


def test_sangian_bladder_is_a_thin_hoop():
    """Pressure on a thin hoop of stiffness E t0 / r0^2 per widening: it is less by that."""
    model = build("sangian", threshold_pressure=0.05)
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    lengths = find_lengths(model)
    radius = find_radius(model.braid, lengths)
    hoop = MUSCLE.modulus * (radius - RADIUS) / RADIUS * thickness / RADIUS
    expected = pull_ideal(model.braid, 0.35 - hoop, lengths)
    assert pull(model, 0.4, lengths) == pytest.approx(expected, rel=1e-11, abs=1e-12)
    assert np.all(model.force(0.0, [1.0, 5.0]) < 0.0) and model.force(0.0, -1.0) > 0.0
    state = model.solve(0.4, [0.0, 0.2])
    at = find_radius(model.braid, 42.0 - state.contraction)
    hoop = MUSCLE.modulus * (at - RADIUS) / RADIUS * thickness / RADIUS
    assert state.contact_pressure == pytest.approx(0.35 - hoop, rel=1e-11)


def test_sangian_stops_at_locking_or_where_the_bladder_holds_the_pressure():
    stiff = build("sangian", MUSCLE.replace(modulus=3.0))
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    radius = RADIUS * (1.0 + 0.1 * RADIUS / (3.0 * thickness))
    assert find_radius(stiff.braid, 42.0 - stiff.contraction(0.1)) == pytest.approx(
        radius, rel=1e-10
    )
    assert stiff.contraction(5.0) == pytest.approx(IDEAL.braid.locking_contraction, rel=1e-10)


def test_sangian_as_printed_pulls_at_rest():
    """It gains 2 E t0 / r0 of pressure there, and the bladder helps."""
    printed = build("sangian", threshold_pressure=0.05, as_printed=True)
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    gained = 2.0 * MUSCLE.modulus * thickness / RADIUS
    assert printed.blocked_force(0.2) == pytest.approx(
        float(IDEAL.blocked_force(0.15 + gained)), rel=1e-12
    )
    lengths = find_lengths(printed)
    sines = np.sqrt(1.0 - (lengths / 42.0 * math.cos(MUSCLE.braid_angle)) ** 2)
    pressure = 0.15 + 0.5 * gained / math.sin(MUSCLE.braid_angle) * (
        sines + math.sin(MUSCLE.braid_angle)
    )
    assert pull(printed, 0.2, lengths) == pytest.approx(
        pull_ideal(printed.braid, pressure, lengths), rel=1e-11, abs=1e-12
    )


# The inverse form ---------------------------------------------------------------------------------


def test_gaylords_constants_make_gaylord():
    model, lengths = build("strain-fit"), find_lengths(IDEAL)
    assert pull(model, 0.4, lengths) == pytest.approx(
        pull(IDEAL, 0.4, lengths), rel=1e-11, abs=1e-13
    )
    assert model.find_strain([0.1, 0.8]) == pytest.approx(
        IDEAL.braid.locking_contraction / 42.0, rel=1e-12
    )


@settings(max_examples=50)
@given(st.floats(0.5, 2.0), st.floats(-0.2, 0.2), st.floats(0.5, 1.5), st.floats(0.2, 1.0))
def test_both_directions_of_the_form_agree(factor, offset, other, pressure):
    guess = MODELS["strain-fit"].guess_parameters(MUSCLE)
    model = build("strain-fit", kappa1=factor * guess["kappa1"], kappa2=offset,
                 kappa3=other * guess["kappa3"])  # fmt: skip
    load = np.maximum(model.force(pressure, [-2.0, 2.0, 10.0]), 0.0)
    try:
        strain = model.find_strain(pressure, load)
    except InputError as error:  # no such length: the root finder says so too
        assert "squared stretch" in str(error)
        with pytest.raises(InputError):
            model.contraction(pressure, load)
        return
    assert model.contraction(pressure, load) == pytest.approx(42.0 * strain, rel=1e-8, abs=1e-9)
    assert model.force(pressure, 42.0 * strain) == pytest.approx(load, abs=1e-11)


@settings(max_examples=20)
@given(st.floats(1.0, 50.0), st.floats(-2.0, 2.0), st.floats(-20.0, 20.0))
def test_constants_of_the_form_are_found_again(kappa1, kappa2, kappa3):
    truth = {"kappa1": kappa1, "kappa2": kappa2, "kappa3": kappa3}
    assert recover_linear("strain-fit", truth) == pytest.approx(truth, rel=1e-8, abs=1e-8)


def test_radial_strain():
    keeps = build("strain-fit")
    strain = np.array([-0.1, 0.0, 0.1, 0.25])
    # By default the volume r^2 l is kept; only the ratios of the constants matter.
    assert (1.0 + keeps.find_radial_strain(strain)) ** 2 * (1.0 - strain) == pytest.approx(
        np.ones(4), rel=1e-12
    )
    some = build("strain-fit", kappa4=-1.2, kappa5=0.6, kappa6=2.0)
    same = build("strain-fit", kappa4=-0.6, kappa5=0.3, kappa6=1.0)
    radial = some.find_radial_strain(strain)
    assert radial == pytest.approx(same.find_radial_strain(strain), rel=1e-12)
    assert radial[1] == 0.0
    volume = (1.0 + radial) ** 2 * (1.0 - strain)
    assert volume == pytest.approx(1.0 + 0.3 * strain - 0.6 * strain**2, rel=1e-12)


@pytest.mark.parametrize(
    ("question", "words"),
    [
        (lambda m: m.find_strain(0.0), r"^pressure is 0 MPa: it must lie in \["),
        (lambda m: m.find_strain([0.1, np.nan]), r"^pressure\[1\] is nan MPa: it must lie"),
        (lambda m: m.find_strain(0.1, -1.0), r"^load is -1 N: it must lie in \[0"),
        (
            lambda m: m.find_strain(0.1, 1e3),
            "^squared stretch is .*: it must lie in .* legal length$",
        ),
        (lambda m: m.find_radial_strain([0.0, 1.0]), r"^strain\[1\] is 1: it must lie in \["),
        (lambda m: m.find_radial_strain(0.9), "^strain is 0.9: the volume of .* must not be neg"),
    ],
)
def test_wrong_questions_get_one_clear_line(question, words):
    model = build("strain-fit", kappa4=-1.5, kappa5=0.0)
    with pytest.raises(InputError, match=words) as error:
        question(model)
    assert "\n" not in str(error.value)
