"""Miniature muscles by the balance of forces: fitted stresses, rounded ends, friction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import BladderWall, balance_forces, find_radius, pull_ideal
from bozzini.muscle.models.miniature import correct_length
from tests.muscle.models.catalogue import MUSCLE, build, differentiate, find_lengths
from tests.muscle.models.relations import (
    WAYS,
    ask_anything,
    check_model,
    find_unused,
    pull,
    recover_linear,
)
from tests.muscle.strategies import muscles

HOCKING = ["hocking-base", "hocking-1", "hocking-2"]
NAMES = [*HOCKING, "pressure-stiffening"]
IDEAL = build("gaylord-1")
RADIUS = MUSCLE.braid_radius


def linear(strain):
    return MUSCLE.modulus * strain


def mild(pressure):
    return 0.1 + 0.05 * pressure


LAWS = {
    "hocking-base": {"axial_stress": linear, "hoop_stress": linear},
    "hocking-2": {"friction": mild},
}


def make(name, muscle=MUSCLE, **changes):
    return build(name, muscle, **{**LAWS.get(name, {}), **changes})


@pytest.mark.parametrize("name", NAMES)
def test_models_are_models(name):
    check_model(make(name), [0.1, 0.5], [0.0, 0.05])
    kind, constants = MODELS[name], make(name).keywords
    assert find_unused(lambda muscle: kind(muscle, **constants)) == set(kind.unused)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)


# Hocking and Wereley ------------------------------------------------------------------------------


def none(strain):
    return 0.0 * strain


def test_hocking_without_stress_is_gaylord():
    model = make("hocking-base", axial_stress=none, hoop_stress=none)
    lengths = find_lengths(model)
    ideal = pull(IDEAL, 0.4, lengths)
    assert pull(model, 0.4, lengths) == pytest.approx(ideal, rel=1e-12)
    for name in ("hocking-1", "hocking-2"):
        plain = build(name, modulus1=0.0, ends="plain")
        assert pull(plain, 0.4, lengths) == pytest.approx(ideal, rel=1e-12)


@pytest.mark.parametrize("name", HOCKING)
def test_hocking_as_printed_has_as_many_times_the_pressure_as_turns(name):
    good, printed = make(name, ends="plain"), make(name, ends="plain", as_printed=True)
    lengths = find_lengths(good)
    more = (good.braid.turns - 1.0) * pull_ideal(good.braid, np.asarray(0.4), lengths)
    assert good.braid.turns > 5.0
    assert pull(printed, 0.4, lengths) - pull(good, 0.4, lengths) == pytest.approx(more, rel=1e-9)


def test_the_stress_over_the_cross_section_is_axial():
    """A hoop alone does the work of a hoop, a rod alone that of a rod."""
    rod = make("hocking-base", axial_stress=linear, hoop_stress=none)
    wall = rod.wall
    lengths = find_lengths(rod)

    def energy(length):  # of s_z = E (l / l0 - 1) on V_b / l
        return wall.volume * MUSCLE.modulus * (length / 42.0 - np.log(length))

    assert pull(rod, 0.0, lengths) == pytest.approx(
        differentiate(energy, lengths), rel=1e-8, abs=1e-10
    )
    hoop = make("hocking-base", axial_stress=none, hoop_stress=linear)
    radius = find_radius(hoop.braid, lengths)
    widening = differentiate(lambda at: find_radius(hoop.braid, at), lengths)
    tension = linear(radius / RADIUS - 1.0) * wall.thickness_at(lengths)
    work = tension * 2.0 * math.pi * lengths * widening
    assert pull(hoop, 0.0, lengths) == pytest.approx(work, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_stresses_resist(name):
    model = make(name)
    assert model.force(0.0, 0.0) == pytest.approx(0.0, abs=1e-14)
    assert np.all(model.force(0.0, [0.1, 3.0, 10.0]) < 0.0)
    assert np.all(model.force(0.0, [-0.1, -2.0]) > 0.0)


def test_hocking_of_one_modulus_is_kothera_without_the_pressure_on_the_wall():
    """And with the hoop strain of the radius, for that of a thin wall's volume."""
    model, kothera = make("hocking-1"), build("kothera-balance")
    lengths, braid, wall = find_lengths(model), model.braid, model.wall
    radius, thickness = find_radius(braid, lengths), wall.thickness_at(lengths)
    slope = thickness * lengths**2 / (2.0 * math.pi * braid.turns**2 * radius)
    on_wall = 0.4 * (wall.area_at(lengths) - slope)
    thinned = wall.thickness * 42.0 / (thickness * lengths) - 1.0
    hoop = MUSCLE.modulus * (thinned - (radius / RADIUS - 1.0)) * slope
    difference = pull(kothera, 0.4, lengths) - pull(model, 0.4, lengths)
    assert difference == pytest.approx(on_wall - hoop, rel=1e-9, abs=1e-12)
    assert np.array_equal(pull(model, 0.4, lengths), pull(make("hocking-base"), 0.4, lengths))


def test_polynomials_have_their_powers():
    given = {"modulus1": 0.3, "modulus2": -0.4, "modulus3": 0.5, "modulus4": 0.7}

    def law(strain):
        return 0.3 * strain - 0.4 * strain**2 + 0.5 * strain**3 + 0.7 * strain**4

    lengths = find_lengths(make("hocking-1"))
    laws = make("hocking-base", axial_stress=law, hoop_stress=law)
    assert pull(make("hocking-1", **given), 0.4, lengths) == pytest.approx(
        pull(laws, 0.4, lengths), rel=1e-12, abs=1e-13
    )


def test_rounded_ends_are_a_quarter_of_a_circle():
    """A meridian drawn point by point, and its length along the axis."""
    braid = IDEAL.braid
    for length in (30.0, 42.0, 44.0):
        wide = float(find_radius(braid, np.asarray(length))) - RADIUS
        angle = np.linspace(0.0, 0.5 * math.pi, 20001)
        arc = np.hypot(np.diff(np.sin(angle)), np.diff(np.cos(angle))).sum() * wide
        along = 2.0 * wide + (length - 2.0 * arc)  # two ends, and what is left of the meridian
        assert correct_length(braid, np.asarray(length)) == pytest.approx(along, rel=1e-9)


def test_the_correction_goes_into_the_law_and_takes_contraction():
    plain, corrected = make("hocking-1"), make("hocking-1", ends="corrected")
    lengths = find_lengths(corrected)
    at = correct_length(corrected.braid, lengths)
    assert pull(corrected, 0.4, lengths) == pytest.approx(pull(plain, 0.4, at), rel=1e-12)
    assert corrected.blocked_force(0.4) == pytest.approx(float(plain.blocked_force(0.4)))
    assert 0.0 < corrected.contraction(0.4) < plain.contraction(0.4)
    for end, other in zip(corrected.contraction_limits, plain.contraction_limits, strict=True):
        inside = correct_length(corrected.braid, np.asarray(42.0 - end))
        assert inside == pytest.approx(42.0 - other, rel=1e-9)


def test_hocking_2_has_a_dead_band_and_rounded_ends():
    model = make("hocking-2", dead_band_pressure=0.08)
    other = make("hocking-1", ends="corrected")
    lengths = find_lengths(model)
    assert pull(model, 0.5, lengths) == pytest.approx(pull(other, 0.42, lengths), rel=1e-12)
    assert model.dead_band() == 0.08
    assert model.contraction([0.0, 0.05, 0.08]) == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert model.contraction(0.09) > 0.0
    assert make("hocking-2", as_printed=True).keywords["ends"] == "corrected"


def test_hocking_friction_is_a_share_of_the_pull_against_the_motion():
    model, printed = make("hocking-2"), make("hocking-2", as_printed=True)
    rest = float(model.contraction(0.5))
    for contraction in (0.5 * rest, rest + 1.0):
        up, free, down = model.force(0.5, contraction, direction=WAYS)
        assert up == pytest.approx(free - mild(0.5) * abs(free), rel=1e-12)
        assert down == pytest.approx(free + mild(0.5) * abs(free), rel=1e-12)
    # As printed it is (1 - mu sgn v) times a pull that is negative past the end.
    end = float(printed.contraction(0.5)) + 1.0
    up, free, down = printed.force(0.5, end, direction=WAYS)
    assert free < 0.0 and up == pytest.approx(free * (1.0 - mild(0.5)), rel=1e-12) and up > down
    assert np.ptp(build("hocking-2").force(0.5, 2.0, direction=WAYS)) == 0.0


def test_a_friction_beyond_the_pull_is_refused():
    model = make("hocking-2", friction=lambda pressure: 0.5 + pressure)
    with pytest.raises(InputError, match=r"^answer of friction is 1.1: it must lie in \[0, 1\]"):
        model.force(0.6, 1.0, direction="inflating")


def test_hocking_base_needs_its_stresses():
    with pytest.raises(MissingLawError, match=r"axial_stress\(axial strain\).*hocking-1"):
        MODELS["hocking-base"](MUSCLE)
    with pytest.raises(MissingLawError, match=r"hoop_stress\(hoop strain\)"):
        MODELS["hocking-base"](MUSCLE, axial_stress=linear)


# Stress that grows with pressure ------------------------------------------------------------------


def test_stiffening_is_the_full_balance():
    given = {"modulus1": 0.3, "modulus1_slope": 0.4, "modulus2": -0.2, "modulus3_slope": 0.6}
    model = make("pressure-stiffening", **given)
    braid, wall, lengths = model.braid, model.wall, find_lengths(model)

    def stress(strain):
        return (0.3 + 0.4 * 0.5) * strain - 0.2 * strain**2 + 0.6 * 0.5 * strain**3

    force = balance_forces(
        0.5,
        lengths,
        braid=braid,
        section=(wall.thickness_at(lengths), wall.area_at(lengths)),
        stresses=(stress(lengths / 42.0 - 1.0), stress(find_radius(braid, lengths) / RADIUS - 1.0)),
    )
    assert pull(model, 0.5, lengths) == pytest.approx(force, rel=1e-11, abs=1e-12)


def test_the_pressure_on_a_wall_of_constant_thickness_is_chou():
    """What the balance adds to Gaylord's pull, with a thickness that stays: (2.5)."""
    chou = build("chou")
    thickness = BladderWall.of(MUSCLE, chou.braid).thickness
    lengths = find_lengths(chou)
    area = math.pi * thickness * (2.0 * find_radius(chou.braid, lengths) - thickness)
    force = balance_forces(
        0.4, lengths, braid=chou.braid, section=(thickness, area), stresses=(0.0, 0.0)
    )
    assert pull(chou, 0.4, lengths) == pytest.approx(force, rel=1e-10, abs=1e-12)


def test_stiffening_differs_from_hocking_by_the_pressure_on_the_wall():
    model, hocking = make("pressure-stiffening"), make("hocking-1")
    lengths = find_lengths(model)
    assert pull(model, 0.0, lengths) == pytest.approx(pull(hocking, 0.0, lengths), rel=1e-12)
    thin = MUSCLE.replace(inner_radius=0.99 * MUSCLE.outer_radius, gap=0.0)
    thick = MUSCLE.replace(inner_radius=0.9 * MUSCLE.outer_radius, gap=0.0)
    misses = []
    for muscle in (thick, thin):
        ways = [make(name, muscle, modulus1=0.0) for name in ("pressure-stiffening", "hocking-1")]
        forces = [model.force(0.4, np.linspace(-1.0, 15.0, 9)) for model in ways]
        misses.append(np.abs(forces[0] - forces[1]).max())
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.2)  # first order in the thickness


@pytest.mark.parametrize("name", ["hocking-1", "hocking-2", "pressure-stiffening"])
@settings(max_examples=10)
@given(data=st.data())
def test_moduli_are_found_again(name, data):
    names = [item.name for item in MODELS[name].card.parameters if item.linear]
    truth = {key: data.draw(st.floats(-1.0, 1.0)) for key in names}
    if name == "hocking-2":  # friction in proportion to the size of the pull is not linear
        truth |= {"dead_band_pressure": 0.05}
        found = recover_linear(name, truth, friction=None)
    else:
        found = recover_linear(name, truth)
    assert found == pytest.approx({key: truth[key] for key in names}, abs=1e-8)
