"""The balance of forces, and the linear elastic bladders that are made of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import (
    BladderWall,
    balance_forces,
    find_contact_pressure,
    find_radius,
    pull_ideal,
)
from tests.muscle.models.catalogue import MUSCLE, build, differentiate, find_lengths
from tests.muscle.strategies import muscles

NAMES = ["schulte", "ferraresi", "kothera-balance"]
KOTHERA = build("kothera-balance")
LENGTHS = find_lengths(KOTHERA)
STRESSES = st.floats(-5.0, 5.0)


def pull(model, pressure, length):
    return model.force(pressure, model.braid.length - length)


def thin(share=0.99, **changes):
    return MUSCLE.replace(inner_radius=share * MUSCLE.outer_radius, **changes)


# The balance ------------------------------------------------------------------------------------


@settings(max_examples=100)
@given(muscles(), st.floats(0.0, 1.0), st.floats(0.0, 10.0), STRESSES, STRESSES)
def test_both_forms_of_the_balance_are_one(muscle, share, pressure, axial, hoop):
    """Through the braid's pressure, and collected by terms."""
    model = MODELS["kothera-balance"](muscle)
    braid, wall = model.braid, model.wall
    low, high = (braid.length - x for x in model.contraction_limits[::-1])
    length = np.asarray(low + share * (high - low))
    radius, thickness = find_radius(braid, length), wall.thickness_at(length)
    contact = find_contact_pressure(
        pressure, length, braid=braid, thickness=thickness, hoop_stress=hoop
    )
    strands = contact * length**2 / (2.0 * math.pi * braid.turns**2)
    bore = pressure * math.pi * (radius - thickness) ** 2
    assert contact * radius + hoop * thickness == pytest.approx(
        pressure * (radius - thickness), rel=1e-9, abs=1e-12 * radius
    )
    other = strands + axial * wall.area_at(length) - bore
    force = balance_forces(
        pressure,
        length,
        braid=braid,
        section=(thickness, wall.area_at(length)),
        stresses=(axial, hoop),
    )
    scale = abs(strands) + abs(axial) * wall.area_at(length) + bore
    assert force == pytest.approx(other, abs=1e-9 * float(scale))


def test_a_wall_that_only_passes_pressure_on_makes_gaylord():
    """Incompressible and without shear, the stress in the wall is the pressure on it."""
    wall = KOTHERA.wall
    force = balance_forces(
        0.4,
        LENGTHS,
        braid=KOTHERA.braid,
        section=(wall.thickness_at(LENGTHS), wall.area_at(LENGTHS)),
        stresses=(-0.4, -0.4),
    )
    assert force == pytest.approx(pull_ideal(KOTHERA.braid, 0.4, LENGTHS), rel=1e-11)


def test_the_wall_keeps_its_volume():
    wall, braid = KOTHERA.wall, KOTHERA.braid
    radius, thickness = find_radius(braid, LENGTHS), wall.thickness_at(LENGTHS)
    volume = math.pi * thickness * (2.0 * radius - thickness) * LENGTHS
    assert volume == pytest.approx(np.full(9, wall.volume), rel=1e-12)
    assert thickness == pytest.approx(
        radius - np.sqrt(radius**2 - wall.volume / (math.pi * LENGTHS)), rel=1e-9
    )
    assert wall.thickness_at(np.asarray(braid.length)) == pytest.approx(wall.thickness, rel=1e-12)


def test_lengths_end_where_the_bore_closes():
    wall, braid = KOTHERA.wall, KOTHERA.braid
    for contraction in KOTHERA.contraction_limits:
        length = np.asarray(braid.length - contraction)
        bore = float(find_radius(braid, length) - wall.thickness_at(length))
        assert bore == pytest.approx(0.01 * wall.bore_at_rest, rel=1e-6)
    kept = wall.find_lengths(1.0, braid.strand_length, keeps_thickness=True)
    assert kept[0] == 1.0  # the bore only gets wider
    left = float(find_radius(braid, np.asarray(kept[1]))) - wall.thickness
    assert left == pytest.approx(0.01 * wall.bore_at_rest, rel=1e-6)


def test_a_very_thin_wall_loses_no_digits():
    wall = BladderWall(braid=KOTHERA.braid, thickness=1e-9)
    radius = find_radius(KOTHERA.braid, LENGTHS)
    expected = 1e-9 * KOTHERA.braid.radius * 42.0 / (radius * LENGTHS)
    assert wall.thickness_at(LENGTHS) == pytest.approx(expected, rel=1e-7)


# The bladders -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_without_pressure_the_muscle_rests_and_resists(name):
    model = build(name)
    assert model.force(0.0, 0.0) == pytest.approx(0.0, abs=1e-14)
    assert model.contraction(0.0) == pytest.approx(0.0, abs=1e-12)
    assert np.all(model.force(0.0, [0.1, 3.0, 10.0]) < 0.0)
    assert np.all(model.force(0.0, [-0.1, -3.0]) > 0.0)


@pytest.mark.parametrize("name", ["schulte", "ferraresi"])
def test_without_a_modulus_thin_bladders_are_gaylord(name):
    soft = build(name, MUSCLE.replace(modulus=1e-9))
    contraction = np.linspace(-2.0, 20.0, 12)
    ideal = build("gaylord-1").force(0.4, contraction)
    assert soft.force(0.4, contraction) == pytest.approx(ideal, rel=1e-7, abs=1e-7)


def test_kothera_without_modulus_and_thickness_is_gaylord():
    contraction = np.linspace(-2.0, 20.0, 12)
    misses = []
    for share in (0.9, 0.99):
        muscle = thin(share, modulus=1e-9)
        ideal = build("gaylord-1", muscle).force(0.4, contraction)
        misses.append(
            np.abs(build("kothera-balance", muscle).force(0.4, contraction) - ideal).max()
        )
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.2)  # first order in the thickness


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(muscle=muscles(), share=st.floats(0.01, 0.99), more=st.floats(1.01, 3.0))
def test_a_stiffer_bladder_contracts_less(name, muscle, share, more):
    """The elastic term takes from the pull at any contraction, and adds at any lengthening."""
    model = MODELS[name](muscle)
    stiffer = MODELS[name](muscle.replace(modulus=min(more * muscle.modulus, 1e3)))
    low, high = model.contraction_limits
    for contraction, sign in ((share * high, -1.0), (share * low, 1.0)):
        change = sign * (stiffer.force(0.0, contraction) - model.force(0.0, contraction))
        assert change >= -1e-12 * abs(model.force(0.0, contraction))


@pytest.mark.parametrize("name", NAMES)
def test_the_pull_falls_as_the_muscle_contracts(name):
    model = build(name, thin(0.9))
    for pressure in (0.0, 0.3, 0.8):
        force = model.force(pressure, np.linspace(-3.0, 20.0, 200))
        assert np.all(np.diff(force) < 0.0)


def test_a_thick_wall_makes_the_pull_grow_at_first():
    """The term of the pressure on the wall; thin bladders of the same thickness do not have it."""
    assert KOTHERA.stiffness(0.8, -3.0) < 0.0 < KOTHERA.stiffness(0.0, -3.0)
    assert build("ferraresi").stiffness(0.8, -3.0) > 0.0


def test_kothera_is_its_print():
    braid, wall, modulus = KOTHERA.braid, KOTHERA.wall, MUSCLE.modulus
    b, turns, rest = braid.strand_length, braid.turns, braid.length
    r, t, volume = find_radius(braid, LENGTHS), wall.thickness_at(LENGTHS), wall.volume
    slope = LENGTHS / (2.0 * math.pi * r * turns**2)
    printed = (
        0.3 * (3.0 * LENGTHS**2 - b**2) / (4.0 * math.pi * turns**2)
        + 0.3 * (volume / LENGTHS - t * LENGTHS * slope)
        + modulus * volume * (1.0 / rest - 1.0 / LENGTHS)
        + modulus * slope * (t * LENGTHS - wall.thickness * rest)
    )
    assert pull(KOTHERA, 0.3, LENGTHS) == pytest.approx(printed, rel=1e-10, abs=1e-11)


def test_kothera_is_the_slope_of_an_energy_where_the_wall_is_thin():
    """Work of s = E (stretch - 1) in the wall: V E (stretch - 1 - ln(stretch)), both ways."""
    lengths = np.linspace(25.0, 45.0, 9)
    misses = []
    for share in (0.9, 0.99):
        model = build("kothera-balance", thin(share))
        braid, wall = model.braid, model.wall

        def energy(length, braid=braid, wall=wall):
            stretches = length / braid.length, find_radius(braid, length) / braid.radius
            return wall.volume * MUSCLE.modulus * sum(s - 1.0 - np.log(s) for s in stretches)

        slope = differentiate(energy, lengths)
        misses.append(np.abs(pull(model, 0.0, lengths) - slope).max() / np.abs(slope).max())
    assert misses[0] < 0.2
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.2)  # thickness over radius


def test_ferraresi_is_the_slope_of_its_energy():
    """A rod of the area at rest, and a hoop at constant thickness worked by the braid."""
    from scipy.integrate import quad

    model = build("ferraresi")
    braid, modulus = model.braid, MUSCLE.modulus
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    area = math.pi * (MUSCLE.braid_radius**2 - 0.45**2)

    def work(length):
        stress = modulus * (float(find_radius(braid, np.asarray(length))) / braid.radius - 1.0)
        widening = differentiate(lambda at: find_radius(braid, np.asarray(at)), length)
        return stress * thickness * 2.0 * math.pi * length * widening

    def energy(length):
        rod = 0.5 * modulus * area * (length - 42.0) ** 2 / 42.0
        return rod + quad(work, 42.0, length, epsabs=1e-12)[0]

    for length in (30.0, 38.0, 46.0):
        slope = differentiate(energy, length, step=1e-2)
        ideal = float(pull_ideal(braid, 0.3, np.asarray(length)))
        assert pull(model, 0.3, length) == pytest.approx(ideal + slope, rel=1e-7)


def test_schulte_and_ferraresi_differ_by_the_area_that_pulls():
    schulte, ferraresi = build("schulte"), build("ferraresi")
    lengths = find_lengths(schulte)
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    deformed = 2.0 * math.pi * find_radius(schulte.braid, lengths) * thickness
    at_rest = math.pi * (MUSCLE.braid_radius**2 - 0.45**2)
    share = MUSCLE.modulus * (lengths / 42.0 - 1.0)
    difference = pull(schulte, 0.3, lengths) - pull(ferraresi, 0.3, lengths)
    assert difference == pytest.approx(share * (deformed - at_rest), rel=1e-9, abs=1e-12)


def test_schulte_is_the_equation_of_its_card():
    model = build("schulte")
    braid, lengths = model.braid, find_lengths(model)
    angle, thickness = braid.angle_at(lengths), MUSCLE.outer_radius - MUSCLE.inner_radius
    b, turns, around = braid.strand_length, braid.turns, 2.0 * math.pi * braid.radius
    wall = np.sin(angle) * (b * np.cos(angle) / 42.0 - 1.0)
    wall -= np.cos(angle) ** 2 / np.sin(angle) * (b * np.sin(angle) / turns - around) / around
    expected = pull_ideal(braid, 0.3, lengths) + b * MUSCLE.modulus * thickness / turns * wall
    assert pull(model, 0.3, lengths) == pytest.approx(expected, rel=1e-11, abs=1e-12)


def test_schulte_as_printed_pulls_at_rest():
    printed = build("schulte", as_printed=True)
    braid = printed.braid
    rest = braid.strand_length * MUSCLE.modulus * braid.length * math.sin(braid.angle) / braid.turns
    assert printed.force(0.0, 0.0) == pytest.approx(rest, rel=1e-12)
    assert rest > 10.0 * build("gaylord-1").blocked_force(0.5)
    ideal = build("gaylord-1").force(0.4, 5.0)
    soft = build("schulte", MUSCLE.replace(modulus=1e-9), as_printed=True)
    assert soft.force(0.4, 5.0) == pytest.approx(ideal, rel=1e-6)


def test_schulte_friction_needs_the_law_of_the_paper():
    with pytest.raises(MissingLawError, match=r"inflation_pressure\(radius \[mm\]\).*Schulte"):
        build("schulte", friction=0.1)
    law = lambda radius: 0.2 * (radius - MUSCLE.braid_radius)  # noqa: E731 - a law in one line
    model = build("schulte", friction=0.1, inflation_pressure=law)
    printed = build("schulte", friction=0.1, inflation_pressure=law, as_printed=True)
    radius = float(find_radius(model.braid, np.asarray(37.0)))
    rub = 0.1 * (0.4 - law(radius)) * 2.0 * math.pi * radius * 42.0
    up, free, down = model.force(0.4, 5.0, direction=["inflating", "", "deflating"])
    assert (free - up, down - free) == pytest.approx((rub, rub), rel=1e-11)
    # The print takes it off whatever the direction.
    without = build("schulte", as_printed=True).force(0.4, 5.0)
    for way in ("inflating", "", "deflating"):
        assert printed.force(0.4, 5.0, direction=way) == pytest.approx(without - rub, rel=1e-11)


def test_schulte_friction_ends_with_contact():
    model = build("schulte", friction=0.1, inflation_pressure=lambda radius: 0.3 + 0.0 * radius)
    up, free, down = model.force([[0.2], [0.31]], 1.0, direction=["inflating", "", "deflating"]).T
    assert up[0] == free[0] == down[0]
    assert up[1] < free[1] < down[1]


def test_ferraresi_as_printed_has_no_value():
    with pytest.raises(InputError, match="ferraresi cannot be evaluated as printed: its root"):
        build("ferraresi", as_printed=True)


def test_contact_is_pressure_less_what_the_wall_bears():
    for name in NAMES:
        state = build(name).solve([0.1, 0.4, 0.8])
        assert np.all(state.contact_pressure < [0.1, 0.4, 0.8])
        assert np.all(np.diff(state.contact_pressure) > 0.0)
        assert build(name).solve(0.0).contact_pressure == pytest.approx(0.0, abs=1e-12)
