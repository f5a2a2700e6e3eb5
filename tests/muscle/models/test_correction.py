"""Gaylord's pull with corrections: it is found again without them, and each does what it is for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.models import MODELS
from tests.muscle.models.catalogue import MUSCLE, build, find_lengths

NAMES = [
    "tondu-lopez", "itto-a", "itto-b", "davis-caldwell", "meller", "andrikopoulos",
    "andrikopoulos-thermal",
]  # fmt: skip
FRICTION = ["tondu-lopez", "davis-caldwell", "andrikopoulos-thermal"]
WAYS = ["inflating", "", "deflating"]
STRANDS = {"davis-caldwell": {"strand_poisson_ratio": 0.4}}
LOCKED = build("gaylord-1").braid.locking_contraction


def rub(name, friction=0.02, **changes):
    return build(name, friction=friction, **STRANDS.get(name, {}), **changes)


def halve(model, contraction):
    """Half the width of the loop of friction at a pressure of 0.5 MPa."""
    up, _, down = model.force(0.5, contraction, direction=WAYS)
    return 0.5 * float(down - up)


@pytest.mark.parametrize("name", [name for name in NAMES if name != "meller"])
def test_neutral_constants_make_gaylord(name):
    model, ideal = build(name), build("gaylord-2")
    contraction = 42.0 - find_lengths(model)
    for pressure in (0.0, 0.5):
        for way in WAYS:
            assert model.force(pressure, contraction, direction=way) == pytest.approx(
                ideal.force(pressure, contraction), rel=1e-12, abs=1e-13
            )


def test_meller_with_ideal_curves_is_gaylord():
    ideal = build("gaylord-2")
    contraction = np.linspace(-2.0, 20.0, 12)
    for pressure in (0.1, 0.5, 2.0):
        strain = LOCKED / 42.0 / math.log(pressure / 0.001)
        model = build("meller", kappa3=strain)
        assert model.force(pressure, contraction) == pytest.approx(
            ideal.force(pressure, contraction), rel=1e-12, abs=1e-13
        )


@pytest.mark.parametrize(
    ("name", "constants", "find_factor"),
    [
        ("tondu-lopez", (0.4, 1.1), lambda p, a, b: a * math.exp(-10.0 * p) + b),
        ("davis-caldwell", (0.4, 1.1), lambda p, a, b: a * math.exp(-10.0 * p) + b),
        ("itto-a", (0.3, -2.0, 1.2), lambda p, a, b, c: a * math.exp(b * p) + c),
        ("itto-b", (0.6, -0.3), lambda p, a, b: a * (1.0 + math.exp(b * p))),
    ],
)
def test_the_pull_ends_at_the_locking_strain_over_the_factor(name, constants, find_factor):
    given = {f"kappa{i + 1}": value for i, value in enumerate(constants)}
    model = build(name, **given)
    for pressure in (0.1, 0.7):
        factor = find_factor(pressure, *constants)
        assert model.free_contraction(pressure) == pytest.approx(LOCKED / factor, rel=1e-12)
        # Strain by strain it is Gaylord's pull at so many times the strain.
        ideal = build("gaylord-2").force(pressure, factor * np.array([-1.0, 2.0, 8.0]))
        assert model.force(pressure, [-1.0, 2.0, 8.0]) == pytest.approx(ideal, rel=1e-11)
    assert model.blocked_force(0.3) == pytest.approx(build("gaylord-2").blocked_force(0.3))


def test_the_unit_of_the_exponent_counts():
    bar = build("tondu-lopez", kappa1=0.4)
    pascal = build("tondu-lopez", kappa1=0.4, pressure_unit=1e-6)
    megapascal = build("tondu-lopez", kappa1=0.4, pressure_unit=1.0)
    assert pascal.free_contraction(0.1) == pytest.approx(LOCKED, rel=1e-12)
    assert bar.free_contraction(0.1) == pytest.approx(LOCKED / (1.0 + 0.4 / math.e), rel=1e-12)
    assert megapascal.free_contraction(1.0) == pytest.approx(bar.free_contraction(0.1), rel=1e-12)


def test_a_factor_of_the_other_sign_is_refused():
    for model, words in (
        (build("tondu-lopez", kappa2=-1.0), "tondu-lopez at pressure is -1: it must lie in"),
        (build("itto-a", kappa1=1.0, kappa2=1000.0), r"itto-a at pressure\[1\] is inf"),
        (build("itto-b", kappa1=0.0), "itto-b at pressure.* is 0: it must lie in"),
    ):
        with pytest.raises(InputError, match=f"^strain factor k of the model {words}"):
            model.contraction(0.5 if "pressure is" in words else [0.0, 0.9])


def test_lengths_end_where_the_parabola_would_rise_again():
    """With k = 3 the corrected strain is 1 at a third of the length: beyond is no answer."""
    model = build("tondu-lopez", kappa2=3.0)
    model.force(0.5, 13.6)
    with pytest.raises(
        InputError, match=r"contraction is 14.1 mm: at .*it must lie in \[-3\..*, 13"
    ):
        model.force(0.5, 14.1)
    assert model.stiffness(0.5, 13.6) > 0.0


# Friction ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FRICTION)
def test_friction_is_even_about_the_pull_and_linear_in_its_coefficient(name):
    model = rub(name)
    up, free, down = model.force(0.5, 5.0, direction=WAYS)
    assert up < free < down
    assert down - free == pytest.approx(free - up, rel=1e-12)
    assert free == build(name).force(0.5, 5.0)
    assert halve(rub(name, 0.06), 5.0) == pytest.approx(3.0 * halve(model, 5.0), rel=1e-12)
    up, free, down = rub(name, 0.002).contraction(0.5, 0.3, direction=WAYS)
    assert up < free < down
    assert np.array_equal(model.force(0.0, 5.0, direction=WAYS), [0.0, 0.0, 0.0])


@pytest.mark.parametrize("name", ["tondu-lopez", "andrikopoulos-thermal"])
def test_tondu_friction_is_that_of_the_cylinder_at_rest(name):
    """With k = 1, S1 = b^2 sin^2 cos^2 (theta0) / (N sin cos (theta)): all of it at theta0."""
    model = rub(name, contact_scale=4.0)
    braid = model.braid
    assert halve(model, 0.0) == pytest.approx(
        0.02 * 0.5 * 2.0 * math.pi * braid.radius * braid.length / 4.0, rel=1e-12
    )
    rest = math.sin(braid.angle) * math.cos(braid.angle)
    for contraction in (-2.0, 6.0, 15.0):
        angle = float(braid.angle_at(42.0 - contraction))
        area = braid.strand_length**2 * rest**2 / (braid.turns * math.sin(angle) * math.cos(angle))
        assert halve(model, contraction) == pytest.approx(0.02 * 0.5 * area / 4.0, rel=1e-11)


def test_tondu_friction_has_the_corrected_strain_in_it():
    plain, stretched = rub("tondu-lopez"), rub("tondu-lopez", kappa2=1.5)
    assert halve(stretched, 4.0) == pytest.approx(halve(plain, 6.0), rel=1e-12)


def test_davis_contact_is_the_cylinder_where_the_strands_lie_side_by_side():
    model = rub("davis-caldwell")
    braid, least = model.braid, model.smallest_angle
    length = np.asarray(braid.length_at(least))
    lateral = 2.0 * math.pi * braid.radius_at(length) * length
    assert model.find_contact_area(0.5, length) == pytest.approx(float(lateral), rel=1e-12)
    # Strands of one family lie 4 pi r cos(angle) / m apart: two radii there.
    apart = 4.0 * math.pi * float(braid.radius_at(length)) * math.cos(least) / MUSCLE.strands
    assert apart == pytest.approx(2.0 * MUSCLE.strand_radius, rel=1e-12)


def test_davis_scale_is_hertz_contact_of_two_spheres():
    """a^3 = 3 F R / (4 E*), with the load P (2 r_n)^2, R = r_n / 2, E* = E / (2 (1 - nu^2))."""
    pressure = np.array([0.1, 0.8])
    radius, modulus = MUSCLE.strand_radius, MUSCLE.strand_modulus / (2.0 * (1.0 - 0.4**2))
    contact = np.cbrt(3.0 * pressure * (2.0 * radius) ** 2 * 0.5 * radius / (4.0 * modulus))
    ratio = 1.0 / rub("davis-caldwell", scale="radii").find_share(pressure)
    assert ratio == pytest.approx(radius / contact, rel=1e-12)
    assert ratio[0] / ratio[1] == pytest.approx(2.0, rel=1e-12)  # goes as P^(-1/3)
    areas = 1.0 / rub("davis-caldwell").find_share(pressure)
    assert areas == pytest.approx(ratio**2, rel=1e-12)


def test_davis_as_printed_shows_each_erratum():
    good, printed = rub("davis-caldwell"), rub("davis-caldwell", as_printed=True)
    mended = rub("davis-caldwell", as_printed=True, minimum_angle="geometric", scale="areas")
    least = good.smallest_angle
    # (2.9) without the square, and 1.442 for the cube root of 3.
    ratio = (1.442 / math.cbrt(3.0)) ** 2 / (math.sin(least) * math.cos(least))
    assert halve(mended, 5.0) == pytest.approx(ratio * halve(good, 5.0), rel=1e-12)
    # (2.10) without sin(theta0).
    assert math.sin(2.0 * printed.smallest_angle) * math.sin(MUSCLE.braid_angle) == pytest.approx(
        math.sin(2.0 * least), rel=1e-12
    )
    assert halve(printed, 5.0) > halve(mended, 5.0) > halve(good, 5.0)
    assert np.array_equal(printed.contraction(0.5), good.contraction(0.5))  # friction only


def test_davis_printed_angle_may_not_exist():
    thick = MUSCLE.replace(strand_radius=0.1)
    assert build("davis-caldwell", thick).smallest_angle > 0.0
    with pytest.raises(InputError, match="^muscle strand radius is 0.1 mm: for .* at most 0.0837"):
        build("davis-caldwell", thick, as_printed=True)


def test_davis_needs_the_strands_poisson_ratio_only_with_friction():
    build("davis-caldwell")
    with pytest.raises(InputError, match="must be given strand_poisson_ratio"):
        build("davis-caldwell", friction=0.1)


# Measured ends ----------------------------------------------------------------------------------


@settings(max_examples=50)
@given(st.floats(0.1, 20.0), st.floats(0.0, 2.0), st.floats(0.01, 0.06), st.floats(0.01, 2.0))
def test_meller_meets_its_two_curves(kappa1, kappa2, kappa3, pressure):
    model = build("meller", kappa1=kappa1, kappa2=kappa2, kappa3=kappa3)
    assert model.blocked_force(pressure) == pytest.approx(kappa1 * pressure + kappa2, rel=1e-12)
    free = 42.0 * kappa3 * math.log(pressure / 0.001)
    assert model.free_contraction(pressure) == pytest.approx(free, rel=1e-9)


def test_meller_wants_a_pressure_above_its_unit_and_a_pull():
    model = build("meller", pressure_unit=0.1)
    for pressure in (0.0, 0.1):
        with pytest.raises(
            InputError, match=rf"^pressure is {pressure:g} MPa: it must lie in \[0.1001"
        ):
            model.contraction(pressure)
    with pytest.raises(InputError, match=r"kappa2 at pressure\[0\] is -0.9 N: it must lie in"):
        build("meller", kappa1=1.0, kappa2=-1.0).contraction([0.1, 1.5])


@settings(max_examples=50)
@given(st.floats(0.1, 20.0), st.floats(1.0, 20.0), st.floats(0.01, 2.0), st.floats(0.01, 2.0))
def test_andrikopoulos_meets_its_test(force, contraction, test, pressure):
    model = build("andrikopoulos", largest_force=force, largest_contraction=contraction,
                  test_pressure=test)  # fmt: skip
    assert model.blocked_force(test) == pytest.approx(force, rel=1e-12)
    assert model.blocked_force(pressure) == pytest.approx(force * pressure / test, rel=1e-12)
    assert model.free_contraction(pressure) == pytest.approx(contraction, rel=1e-9)


def test_andrikopoulos_factor_of_strain_is_the_printed_one():
    """sqrt(q2 / q1) = 1 / (sqrt(3) cos(theta0))."""
    q1, q2 = 3.0 / math.tan(MUSCLE.braid_angle) ** 2, 1.0 / math.sin(MUSCLE.braid_angle) ** 2
    model = build("andrikopoulos", largest_contraction=8.0)
    factor = 42.0 / 8.0 * (1.0 - math.sqrt(q2 / q1))
    assert model.find_factor(np.array(0.5)) == pytest.approx(factor, rel=1e-12)


def test_heat_takes_contraction_away_and_none_is_the_plain_model():
    plain = build("andrikopoulos", largest_contraction=8.0)
    cold = build("andrikopoulos-thermal", largest_contraction=8.0)
    hot = build("andrikopoulos-thermal", largest_contraction=8.0, temperature_change=10.0,
                expansion=2e-4)  # fmt: skip
    load = [0.0, 0.2, 0.5]
    assert cold.contraction(0.5, load) == pytest.approx(plain.contraction(0.5, load), rel=1e-12)
    shift = 42.0 * 2e-3
    assert hot.contraction(0.5, load) == pytest.approx(
        plain.contraction(0.5, load) - shift, rel=1e-11
    )
    assert hot.force(0.5, 3.0) == pytest.approx(plain.force(0.5, 3.0 + shift), rel=1e-12)
    with pytest.raises(InputError, match="must be given expansion"):
        build("andrikopoulos-thermal", temperature_change=10.0)


def test_heat_that_leaves_no_length_is_refused():
    model = build("andrikopoulos-thermal", largest_contraction=1e-3, temperature_change=300.0,
                  expansion=1e-2)  # fmt: skip
    with pytest.raises(InputError, match="no legal length there"):
        model.contraction(0.5)


def test_constants_have_to_be_given():
    for name, missing in (
        ("tondu-lopez", "kappa1, kappa2"), ("itto-a", "kappa1, kappa2, kappa3"),
        ("itto-b", "kappa1, kappa2"), ("davis-caldwell", "kappa1, kappa2"),
        ("meller", "kappa1, kappa2, kappa3"),
        ("andrikopoulos", "largest_force, largest_contraction, test_pressure"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"must be given {missing}: the survey has no values"):
            MODELS[name](MUSCLE)
