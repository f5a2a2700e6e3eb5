"""The inflation of a tube: its length without load, and its forces in the balance of forces."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle import EnergyMuscle, preset
from bozzini.muscle.design import PRESSURE_LIMIT
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import BladderWall, find_radius, pull_ideal
from bozzini.numeric.roots import find_between
from tests.muscle.models.catalogue import MUSCLE, build, differentiate, find_lengths
from tests.muscle.models.relations import (
    ask_anything,
    check_model,
    find_unused,
    pull,
)
from tests.muscle.strategies import muscles

WALL = build("kothera-balance").wall
LENGTHS = find_lengths(build("delson"))


def thin(share=0.99):
    return MUSCLE.replace(inner_radius=share * MUSCLE.outer_radius)


# Trivedi ----------------------------------------------------------------------------------------


def print_pressure(muscle, stretch):
    """(2.24), letter by letter."""
    cosine = math.cos(muscle.braid_angle)
    double = math.cos(2.0 * muscle.braid_angle)
    outer, inner = muscle.braid_radius, muscle.braid_radius - muscle.outer_radius
    inner = inner + muscle.inner_radius
    top = (
        stretch**8 * cosine**4 * double - 2.0 * stretch**6 * cosine**2 * double
        + stretch**4 * double + 2.0 * stretch**2 * cosine**2 * double
        - double - 2.0 * stretch**2 * cosine**6 + cosine**4
    )  # fmt: skip
    x = (stretch * cosine) ** 2
    bottom = stretch**3 * (1.0 - 5.0 * x + 7.0 * x**2 - 3.0 * x**3)
    return muscle.modulus / 3.0 * ((outer / inner) ** 2 - 1.0) * top / bottom


READINGS = [{"volume": v, "force": f} for v in ("bore", "outer") for f in ("spring", "energy")]


@pytest.mark.parametrize("reading", READINGS)
def test_trivedi_is_a_model(reading):
    kind = MODELS["trivedi"]
    check_model(kind(MUSCLE, **reading), [0.0, 0.1, 0.5], [0.0, 0.005])
    assert find_unused(lambda muscle: kind(muscle, **reading), 0.01) == set(kind.unused)


def test_the_zero_load_pressure_is_the_print_but_for_the_sign():
    for angle in (10.0, 36.0, 50.0):
        muscle = MUSCLE.replace(braid_angle=math.radians(angle))
        model = MODELS["trivedi"](muscle)
        contraction = np.linspace(0.1, 0.95, 9) * model.braid.locking_contraction
        pressure = model.find_free_pressure(contraction)
        expected = print_pressure(muscle, 1.0 - contraction / 42.0)
        assert np.all(pressure > 0.0) and np.all(np.diff(pressure) > 0.0)
        assert pressure == pytest.approx(-expected, rel=1e-7)
        printed = MODELS["trivedi"](muscle, as_printed=True).find_free_pressure(contraction)
        assert printed == pytest.approx(expected, rel=1e-7)


def test_two_numbers_of_the_zero_load_pressure():
    """Worked by hand: theta0 = 36 deg, stretch 0.9, E = 0.35 MPa, radii 0.25 and 0.55 mm."""
    muscle = preset("thesis-40", inner_radius=0.25, gap=0.0)
    bore, outer = (
        MODELS["trivedi"](muscle, volume=word).find_free_pressure(4.0) for word in ("bore", "outer")
    )
    assert bore == pytest.approx(0.1770796, rel=1e-6)
    assert outer == pytest.approx(0.03658669, rel=1e-6)
    assert bore / outer == pytest.approx((0.55 / 0.25) ** 2, rel=1e-12)


def test_the_zero_load_pressure_is_work_over_volume():
    """P dV = V_b dW for both volumes."""
    model = MODELS["trivedi"](MUSCLE)
    braid, wall = model.braid, model.wall
    lengths = 42.0 - np.linspace(0.1, 0.95, 9) * braid.locking_contraction

    def energy(length):
        axial, hoop = length / braid.length, find_radius(braid, length) / braid.radius
        return MUSCLE.modulus / 6.0 * wall.volume * (axial**2 + hoop**2 + (axial * hoop) ** -2.0)

    for word, area in (("bore", wall.bore_at_rest**2), ("outer", braid.radius**2)):

        def gas(length, area=area):
            hoop = find_radius(braid, length) / braid.radius
            return math.pi * area * length * hoop**2

        expected = differentiate(energy, lengths) / differentiate(gas, lengths)
        pressure = MODELS["trivedi"](MUSCLE, volume=word).find_free_pressure(42.0 - lengths)
        assert pressure == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("reading", READINGS)
@settings(max_examples=20)
@given(muscle=muscles(), share=st.floats(1e-3, 0.999))
def test_without_load_it_contracts_as_the_pressure_says(reading, muscle, share):
    model = MODELS["trivedi"](muscle, **reading)
    contraction = share * model.braid.locking_contraction
    pressure = model.find_free_pressure(contraction)
    if pressure > PRESSURE_LIMIT:
        return
    assert model.contraction(pressure) == pytest.approx(contraction, rel=1e-6)


def test_the_pressure_grows_without_bounds_towards_locking():
    model = MODELS["trivedi"](MUSCLE)
    lock = model.braid.locking_contraction
    near = model.find_free_pressure(lock * (1.0 - np.array([1e-3, 1e-4, 1e-5])))
    assert near[1:] == pytest.approx(10.0 * near[:-1], rel=1e-2)
    assert model.contraction(PRESSURE_LIMIT) < lock
    assert model.find_free_pressure(0.0) == pytest.approx(0.0, abs=1e-14)
    for wrong in (-0.1, lock, math.nan):
        with pytest.raises(InputError, match=r"^contraction is .* mm: it must lie"):
            model.find_free_pressure(wrong)


@pytest.mark.parametrize("volume", ["bore", "outer"])
def test_the_spring_is_that_of_the_print_with_the_sign_of_a_pull(volume):
    """(2.25) at the stretch without load, and zero at that length; one slope everywhere."""
    model = MODELS["trivedi"](MUSCLE, volume=volume)
    area = MUSCLE.braid_radius**2 - model.wall.bore_at_rest**2
    for pressure in (0.1, 0.5):
        stretch = 1.0 - model.contraction(pressure) / 42.0
        printed = math.pi * MUSCLE.modulus * area * (stretch - 1.0)
        assert printed < 0.0
        assert model.blocked_force(pressure) == pytest.approx(-printed, rel=1e-10)
    slope = math.pi * MUSCLE.modulus * area / 42.0
    assert model.stiffness(0.3, [-1.0, 0.0, 4.0]) == pytest.approx(np.full(3, slope), rel=1e-8)
    at_rest = MODELS["trivedi"](MUSCLE).force(0.0, [-1.0, 0.0, 1.0])
    assert at_rest == pytest.approx([slope, 0.0, -slope], abs=1e-12)


def test_the_energy_of_all_the_volume_is_delson_with_outer_stretches():
    model = MODELS["trivedi"](MUSCLE, volume="outer", force="energy")
    other = MODELS["delson"](MUSCLE, c10=MUSCLE.modulus / 6.0, c01=0.0, stretches="outer")
    assert pull(model, 0.4, LENGTHS) == pytest.approx(pull(other, 0.4, LENGTHS), rel=1e-12)
    states = [each.solve([0.1, 0.4]) for each in (model, other)]
    assert states[0].contact_pressure == pytest.approx(states[1].contact_pressure, rel=1e-12)
    soft = MODELS["trivedi"](MUSCLE.replace(modulus=1e-9), volume="outer", force="energy")
    ideal = pull(build("gaylord-1"), 0.4, LENGTHS)
    assert pull(soft, 0.4, LENGTHS) == pytest.approx(ideal, rel=1e-6, abs=1e-7)


def test_a_bracket_without_a_change_of_sign_has_no_root():
    at = np.array([1.0, 3.0, -1.0, 2.0])  # inside, beyond, below, and at an end

    def excess(index, lengths):
        return lengths**3 - at[index] ** 3

    found = find_between(excess, np.zeros(4), np.full(4, 2.0))
    assert found == pytest.approx([1.0, math.nan, math.nan, 2.0], rel=1e-12, nan_ok=True)
    assert find_between(excess, np.zeros(0), np.zeros(0)).shape == (0,)


def test_trivedi_as_printed_lengthens():
    for force in ("spring", "energy"):
        printed = MODELS["trivedi"](MUSCLE, as_printed=True, force=force)
        contraction = printed.contraction([0.0, 0.02, 0.05])
        assert contraction[0] == pytest.approx(0.0, abs=1e-12)
        assert np.all(np.diff(contraction) < 0.0)
        stretch = 1.0 - contraction[1:] / 42.0
        assert print_pressure(MUSCLE, stretch) == pytest.approx([0.02, 0.05], rel=1e-7)
        with pytest.raises(InputError, match="must"):
            printed.contraction(100.0)


# Wang -------------------------------------------------------------------------------------------


def find_resultants(muscle, *, first, second):
    """Forces in a thick Mooney-Rivlin tube in a braid, by integration of its exact stresses."""
    braid = MODELS["gaylord-1"](muscle).braid
    wall = BladderWall.of(muscle, braid)

    def place(stretch):
        outside = float(find_radius(braid, np.asarray(stretch * braid.length))) ** 2

        def shear(radius, which):  # stress along or round less the radial one
            rest = math.sqrt(braid.radius**2 - (outside - radius**2) * stretch)
            hoop = radius / rest
            radial = 1.0 / (hoop * stretch)
            other = {"axial": stretch, "hoop": hoop}[which]
            return 2.0 * first * (other**2 - radial**2) - 2.0 * second * (
                other**-2.0 - radial**-2.0
            )

        inside = math.sqrt(outside - wall.area_at_rest / (math.pi * stretch))
        return shear, inside, math.sqrt(outside)

    def along(stretch, pressure):
        shear, inside, outside = place(stretch)
        drop = quad(lambda r: shear(r, "hoop") * (outside**2 - r**2) / r, inside, outside)[0]
        pulls = quad(lambda r: 2.0 * r * shear(r, "axial"), inside, outside)[0]
        return math.pi * (drop + pulls - pressure * (outside**2 - inside**2))

    def around(stretch, pressure):
        shear, inside, outside = place(stretch)
        borne = quad(lambda r: shear(r, "hoop") / r, inside, outside)[0]
        return pressure * inside - (pressure - borne) * outside

    return {"axial_force": np.vectorize(along), "hoop_force": np.vectorize(around)}


def none(stretch, pressure):
    return 0.0 * pressure


def test_the_exact_forces_in_a_tube_make_our_own_model():
    """Wang's balance with a thick tube's stresses is the slope of that tube's energy."""
    muscle = MUSCLE.replace(gap=0.0, mooney_ratio=0.3, dead_length=0.0)
    first, second = 0.7 * muscle.modulus / 6.0, 0.3 * muscle.modulus / 6.0
    model = MODELS["wang"](muscle, **find_resultants(muscle, first=first, second=second))
    own, contraction = EnergyMuscle(muscle), np.linspace(-0.5, 12.0, 6)
    assert model.force(0.6, contraction) == pytest.approx(
        own.force(0.6, contraction), rel=1e-8, abs=1e-9
    )
    assert model.contraction(0.6) == pytest.approx(own.contraction(0.6), rel=1e-8)
    assert model.solve(0.6, 0.5).contact_pressure == pytest.approx(
        own.solve(0.6, 0.5).contact_pressure, rel=1e-8
    )


def test_linear_stresses_make_kothera_and_none_leave_the_pressure_on_the_wall():
    kothera = build("kothera-balance")
    wall, lengths = kothera.wall, find_lengths(kothera)

    def along(stretch, pressure):
        return MUSCLE.modulus * (stretch - 1.0) * wall.area_at(stretch * 42.0)

    def around(stretch, pressure):
        hoop = wall.thickness / (wall.thickness_at(stretch * 42.0) * stretch) - 1.0
        return MUSCLE.modulus * hoop * wall.thickness_at(stretch * 42.0)

    model = MODELS["wang"](MUSCLE, axial_force=along, hoop_force=around)
    assert pull(model, 0.3, lengths) == pytest.approx(
        pull(kothera, 0.3, lengths), rel=1e-10, abs=1e-12
    )
    soft = MODELS["wang"](thin(), axial_force=none, hoop_force=none)
    misses = [
        np.abs(pull(MODELS["wang"](thin(share), axial_force=none, hoop_force=none), 0.3, lengths)
               - pull_ideal(soft.braid, 0.3, lengths)).max() for share in (0.9, 0.99)
    ]  # fmt: skip
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.2)


def test_wang_without_shear_is_gaylord():
    """A wall that only passes the pressure on: its stress is the pressure, all round."""
    model = MODELS["wang"](
        MUSCLE,
        axial_force=lambda stretch, pressure: -pressure * WALL.area_at(stretch * 42.0),
        hoop_force=lambda stretch, pressure: -pressure * WALL.thickness_at(stretch * 42.0),
    )
    ideal = pull(build("gaylord-1"), 0.4, LENGTHS)
    assert pull(model, 0.4, LENGTHS) == pytest.approx(ideal, rel=1e-11, abs=1e-12)
    assert model.solve(0.4, 0.5).contact_pressure == pytest.approx(0.4, rel=1e-12)


def test_signs_of_the_forces_in_the_tube():
    """Tension along it pulls; tension round it takes pressure from the braid."""
    plain = MODELS["wang"](MUSCLE, axial_force=none, hoop_force=none)
    along = plain.replace(axial_force=lambda stretch, pressure: 0.1 + none(stretch, pressure))
    around = plain.replace(hoop_force=lambda stretch, pressure: 0.1 + none(stretch, pressure))
    assert pull(along, 0.4, LENGTHS) - pull(plain, 0.4, LENGTHS) == pytest.approx(np.full(9, 0.1))
    assert np.all(pull(around, 0.4, LENGTHS) < pull(plain, 0.4, LENGTHS))


def test_wang_as_printed_is_the_equation_letter_by_letter():
    laws = find_resultants(MUSCLE, first=0.05, second=0.01)
    printed = MODELS["wang"](MUSCLE, as_printed=True, **laws)
    braid, wall = printed.braid, printed.wall
    outer, length = find_radius(braid, LENGTHS), LENGTHS
    inner = outer - wall.thickness_at(length)
    along, around = (laws[name](length / 42.0, 0.3) for name in ("axial_force", "hoop_force"))
    expected = along - 0.3 * math.pi * inner**2
    expected -= (0.3 * inner * length**2 - around * length**2) / (
        2.0 * math.pi * braid.turns**2 * outer**2
    )
    assert pull(printed, 0.3, length) == pytest.approx(expected, rel=1e-10)
    assert printed.blocked_force(0.3) < 0.0 < printed.replace(as_printed=False).blocked_force(0.3)


def test_wang_wants_its_laws_and_says_where_they_are():
    for laws, law in (({}, "axial_force"), ({"axial_force": none}, "hoop_force")):
        with pytest.raises(
            MissingLawError, match=rf"the law {law}\(axial stretch, .*Wang, Wereley and Pillsbury"
        ) as error:
            MODELS["wang"](MUSCLE, **laws)
        assert "\n" not in str(error.value)
    assert find_unused(
        lambda muscle: MODELS["wang"](muscle, axial_force=none, hoop_force=none)
    ) == set(MODELS["wang"].unused)


def along_and_pressure(stretch, pressure):
    return stretch - 1.0 - 0.1 * pressure


def test_wang_is_a_model():
    check_model(
        MODELS["wang"](MUSCLE, axial_force=along_and_pressure, hoop_force=none),
        [0.1, 0.5], [0.0, 0.05],
    )  # fmt: skip


@pytest.mark.parametrize("name", ["trivedi", "wang"])
@settings(max_examples=40)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)
