"""Muscles with ends: without them, the balance of forces; with them, shapes that fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import (
    balance_forces,
    find_contact_pressure,
    find_radius,
    pull_ideal,
)
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

FINE = MUSCLE.replace(strand_radius=1e-6)
"""Strands without thickness."""


def no_stress(length, pressure):
    return 0.0 * pressure


def hoop_stress(length, pressure):
    return MUSCLE.modulus * (find_radius(build("chou").braid, length) / MUSCLE.braid_radius - 1.0)


def cone_length(length):
    return 4.0 + 0.0 * length


def contact_area(length, pressure):
    return 30.0 + pressure


def make(muscle=MUSCLE, **given):
    return MODELS["doumit"](muscle, **{"hoop_stress": hoop_stress, **given})


PLAIN, CONES = make(), make(cone_length=cone_length)
LENGTHS = find_lengths(PLAIN)
INNER = np.linspace(28.0, 45.0, 9)
"""Lengths at which cones of 4 mm fit."""


# Doumit -----------------------------------------------------------------------------------------


def test_doumit_is_a_model():
    for model in (PLAIN, CONES, make(friction=0.001, contact_area=contact_area)):
        edge = 0.02 if model is PLAIN else 0.3
        check_model(model, [0.1, 0.5], [0.0, 0.05], edge=edge)
    assert find_unused(lambda muscle: make(muscle, cone_length=cone_length)) == set(PLAIN.unused)


@settings(max_examples=60)
@given(muscles(), st.floats(0.01, 0.99), st.floats(1e-3, 10.0), st.floats(-1.0, 1.0))
def test_a_cylinder_of_fine_strands_is_the_balance_of_forces(muscle, share, pressure, stress):
    """With the wall as thick as at rest, a hoop stress, and no axial one."""
    muscle = muscle.replace(strand_radius=1e-6)
    model = make(muscle, hoop_stress=lambda length, pressure: stress + 0.0 * length)
    braid, thickness = model.braid, muscle.outer_radius - muscle.inner_radius
    low, high = (braid.length - x for x in model.contraction_limits[::-1])
    length = np.asarray(low + share * (high - low))
    radius = find_radius(braid, length)
    expected = balance_forces(
        pressure,
        length,
        braid=braid,
        section=(thickness, math.pi * thickness * (2.0 * radius - thickness)),
        stresses=(0.0, stress),
    )
    strands = length**2 / (2.0 * math.pi * braid.turns**2)
    scale = (pressure + abs(stress)) * float(strands + math.pi * radius**2)
    slack = 1e-9 + 1e-5 / muscle.inner_radius  # the strands' own thickness
    assert pull(model, pressure, length) == pytest.approx(float(expected), abs=slack * scale)


def test_without_wall_and_strands_it_is_gaylord():
    """First order in the thickness of what is left."""
    lengths, misses = np.linspace(25.0, 45.0, 9), []
    for share, strand in ((0.9, 1e-3), (0.99, 1e-4)):
        muscle = MUSCLE.replace(inner_radius=share * MUSCLE.outer_radius, strand_radius=strand)
        model = make(muscle, hoop_stress=no_stress)
        miss = pull(model, 0.4, lengths) - pull_ideal(model.braid, 0.4, lengths)
        misses.append(np.abs(miss).max())
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.2)


def test_signs_of_hoop_stress_and_of_the_thickness_of_strands():
    """Tension round the wall takes from the pull at any length; so do strands, which take bore."""
    soft, stiff = make(hoop_stress=no_stress), make(hoop_stress=lambda length, p: 0.1 + 0.0 * p)
    assert np.all(pull(stiff, 0.3, LENGTHS) < pull(soft, 0.3, LENGTHS))
    assert PLAIN.contraction(0.5) < make(hoop_stress=no_stress).contraction(0.5)
    bore = [make(m, hoop_stress=no_stress).solve(0.5).contact_pressure for m in (FINE, MUSCLE)]
    assert bore[1] < bore[0] < 0.5


def test_a_cone_without_slope_is_a_cylinder():
    """At the length where the clamps are as wide as the muscle; the print is not."""
    given = {"cone_length": cone_length, "clamp_ratio": 1.2}
    braid = PLAIN.braid
    level = float(braid.length_at(math.asin(1.2 * math.sin(braid.angle))))
    cones, cylinder = make(**given), make()
    assert pull(cones, 0.4, level) == pytest.approx(float(pull(cylinder, 0.4, level)), rel=1e-9)
    printed = make(**given, as_printed=True)
    assert pull(printed, 0.4, level) > 1.01 * pull(cylinder, 0.4, level)
    fine = [
        pull(make(FINE, **given, as_printed=way), 0.4, level) for way in (False, True)
    ]  # without thickness of the strands there is no difference
    assert fine[1] == pytest.approx(float(fine[0]), rel=1e-4)


def test_cones_take_from_the_free_contraction_and_are_none_at_rest():
    """Longer ones more of it; at rest the muscle is a cylinder, whatever its ends."""
    free = [
        make(cone_length=lambda length, longest=longest: longest + 0.0 * length).contraction(0.5)
        for longest in (1.0, 4.0, 8.0)
    ]
    assert PLAIN.contraction(0.5) > free[0] > free[1] > free[2] > 0.0
    assert CONES.force(0.4, 0.0) == pytest.approx(float(PLAIN.force(0.4, 0.0)), rel=1e-9)


@pytest.mark.parametrize("printed", [False, True])
def test_doumit_is_the_equation_of_its_card(printed):
    model = make(
        cone_length=cone_length, end_angle=lambda length: 0.5 + 0.001 * length, clamp_ratio=0.9,
        friction=0.01, contact_area=contact_area, as_printed=printed,
    )  # fmt: skip
    braid, pressure, length = model.braid, 0.3, INNER
    m, r_n, t0 = MUSCLE.strands, MUSCLE.strand_radius, 0.35
    r, theta, end = find_radius(braid, length), braid.angle_at(length), 0.5 + 0.001 * length
    clamp, stress = 0.9 * MUSCLE.braid_radius, hoop_stress(length, pressure)
    slope = np.arcsin((r - clamp) / 4.0)
    cylinder = length - 8.0 * np.cos(slope)
    both = r + clamp - 2.0 * t0 - (2.0 if printed else 4.0) * r_n
    inside = (
        (pressure * (r - t0 - 2.0 * r_n) - stress * t0) / (m * braid.turns * np.sin(theta))
        * cylinder
        + (pressure * both * np.cos(slope) - 2.0 * stress * t0)
        / (m * braid.turns * np.sin(0.5 * (theta + end))) * 4.0
        - pressure * (r - 2.0 * r_n - t0) ** 2 / (2.0 * m * r * np.cos(theta))
        * length / braid.turns * np.tan(theta)
    )  # fmt: skip
    static = m * inside * np.cos(slope) * np.cos(end)
    rub = 0.01 * pressure * contact_area(length, pressure)
    for way, sign in zip(WAYS, (-1.0, 0.0, 1.0), strict=True):
        expected = static + (-rub if printed else sign * rub)
        assert pull(model, pressure, length, direction=way) == pytest.approx(expected, rel=1e-9)


def test_strands_that_do_not_slip_set_the_angle_at_the_clamps():
    """Without a law it is sin(theta_c) = sin(theta) r_c / r: at r_c = r0 the angle at rest."""
    at_rest = make(
        cone_length=cone_length, end_angle=lambda length: MUSCLE.braid_angle + 0.0 * length
    )
    assert pull(at_rest, 0.4, INNER) == pytest.approx(pull(CONES, 0.4, INNER), rel=1e-12)


def test_friction_is_found_by_linear_least_squares():
    truth = {"friction": 0.0137}
    laws = {"hoop_stress": hoop_stress, "contact_area": contact_area}
    assert recover_linear("doumit", truth, **laws) == pytest.approx(truth, rel=1e-8)


def test_shapes_that_do_not_fit_are_refused():
    short = make(cone_length=lambda length: 0.01 + 0.0 * length)
    with pytest.raises(InputError, match="the model doumit has no answer there, they"):
        short.force(0.4, 10.0)
    long = make(cone_length=lambda length: 30.0 + 0.0 * length)
    with pytest.raises(InputError, match="the model doumit has no answer there"):
        long.force(0.4, 0.0)
    with pytest.raises(InputError, match="^answer of cone_length is -1 mm: it must lie in"):
        make(cone_length=lambda length: -1.0 + 0.0 * length).force(0.4, 0.0)
    with pytest.raises(InputError, match="^answer of end_angle is 2 rad: it must lie in"):
        make(cone_length=cone_length, end_angle=lambda length: 2.0 + 0.0 * length).force(0.4, 0.0)
    thick = MUSCLE.replace(inner_radius=0.0375 + 1e-9, gap=0.0, strand_radius=0.05)
    with pytest.raises(InputError, match="^muscle strand radius is 0.05 mm: for a bore in"):
        make(thick)
    # A cone that grows from nothing is none at rest.
    grown = make(cone_length=lambda length: 42.0 - length)
    assert grown.force(0.4, 0.0) == pytest.approx(float(PLAIN.force(0.4, 0.0)), rel=1e-9)


def test_doumit_wants_its_laws_and_says_where_they_are():
    with pytest.raises(MissingLawError, match=r"hoop_stress\(length .*Doumit, Fahim and Munro"):
        MODELS["doumit"](MUSCLE)
    with pytest.raises(MissingLawError, match=r"contact_area\(length .*Doumit, Fahim and Munro"):
        make(friction=0.1)


# Ends of any shape ------------------------------------------------------------------------------


KOTHERA = build("kothera-balance")


def cylinder_radius(length):
    return find_radius(KOTHERA.braid, length)


def cylinder_thickness(length):
    return KOTHERA.wall.thickness_at(np.clip(length, 20.0, 45.5))


def shape(muscle=MUSCLE, **given):
    laws = {"middle_radius": cylinder_radius, "middle_thickness": cylinder_thickness, **given}
    return MODELS["elliptic-ends"](muscle, **laws)


@pytest.mark.parametrize("pressure", [0.0, 0.4])
def test_a_cylinder_all_along_is_the_balance_of_forces(pressure):
    model, wall, lengths = shape(), KOTHERA.wall, INNER
    radius, thickness = cylinder_radius(lengths), wall.thickness_at(lengths)
    hoop = MUSCLE.modulus * (radius / MUSCLE.braid_radius - 1.0)
    expected = balance_forces(
        pressure,
        lengths,
        braid=model.braid,
        section=(thickness, wall.area_at(lengths)),
        stresses=(MUSCLE.modulus * (lengths / 42.0 - 1.0), hoop),
    )
    assert pull(model, pressure, lengths) == pytest.approx(expected, rel=1e-10, abs=1e-11)
    contact = find_contact_pressure(
        0.4, 34.0, braid=model.braid, thickness=wall.thickness_at(34.0),
        hoop_stress=MUSCLE.modulus * (float(cylinder_radius(34.0)) / MUSCLE.braid_radius - 1.0),
    )  # fmt: skip
    load = pull(model, 0.4, 34.0)
    assert model.solve(0.4, load).contact_pressure == pytest.approx(float(contact), rel=1e-9)


def test_a_middle_that_is_wider_pulls_as_its_volume_and_wall_say():
    """A soft thin wall: P times the volume that a slice of the middle gains per length."""
    soft = MUSCLE.replace(modulus=1e-9)
    for wider in (1.0, 1.1):
        model = shape(
            soft,
            middle_radius=lambda length, w=wider: w * cylinder_radius(length),
            middle_thickness=lambda length: 1e-7 + 0.0 * length,
        )
        radius = wider * cylinder_radius(INNER)
        sine = radius / MUSCLE.braid_radius * math.sin(MUSCLE.braid_angle)
        slope = (1.0 - sine**2) / sine**2

        def volume(ratio, sine=sine):  # of a slice as it gets longer by a ratio, over its length
            cosine = np.sqrt(1.0 - sine**2) * ratio
            new = MUSCLE.braid_radius * np.sqrt(1.0 - cosine**2) / math.sin(MUSCLE.braid_angle)
            return math.pi * new**2 * ratio

        expected = -0.4 * differentiate(volume, 1.0, step=1e-4)
        assert expected == pytest.approx(0.4 * math.pi * radius**2 * (2.0 * slope - 1.0), rel=1e-6)
        assert pull(model, 0.4, INNER) == pytest.approx(expected, rel=1e-5, abs=1e-5)


def test_the_bladder_resists_and_rests():
    model = shape()
    assert model.force(0.0, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert np.all(model.force(0.0, [0.5, 5.0, 15.0]) < 0.0) and model.force(0.0, -1.0) > 0.0
    check_model(model, [0.1, 0.5], [0.0, 0.05], edge=0.3)
    assert find_unused(shape) == set(model.unused)


@pytest.mark.parametrize(
    "law",
    [
        {"middle_radius": lambda length: 3.0 + 0.0 * length},  # too wide for the strands
        {"middle_radius": lambda length: -1.0 + 0.0 * length},
        {"middle_thickness": lambda length: 0.0 * length},
        {"middle_thickness": lambda length: 2.0 + 0.0 * length},
    ],
)
def test_sections_that_are_no_tube_are_refused(law):
    with pytest.raises(InputError, match="the model elliptic-ends has no answer there"):
        shape(**law).force(0.3, 1.0)


def test_the_ends_are_in_another_paper():
    with pytest.raises(MissingLawError, match=r"middle_radius\(length.*reference \[90\]") as error:
        MODELS["elliptic-ends"](MUSCLE)
    assert "\n" not in str(error.value)
    with pytest.raises(MissingLawError, match=r"middle_thickness\(length.*reference \[90\]"):
        MODELS["elliptic-ends"](MUSCLE, middle_radius=cylinder_radius)


@pytest.mark.parametrize("name", ["doumit", "elliptic-ends"])
@settings(max_examples=60)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)


@settings(max_examples=40)
@given(
    muscle=muscles(),
    pressure=st.floats(0.0, 10.0),
    share=st.floats(0.0, 1.0),
    laws=st.tuples(*[st.floats(0.0, 2.0)] * 3),
)
def test_any_shape_is_answered_or_refused(muscle, pressure, share, laws):
    """Cones and sections of any size, most of which do not fit."""
    wide, thick, cone = laws

    def radius(length):
        return wide * muscle.braid_radius + 0.0 * length

    def thickness(length):
        return thick * (muscle.outer_radius - muscle.inner_radius) + 0.0 * length

    for name, given_laws in (
        ("elliptic-ends", {"middle_radius": radius, "middle_thickness": thickness}),
        ("doumit", {"hoop_stress": no_stress, "cone_length": lambda length: cone * length,
                    "clamp_ratio": max(wide, 0.05)}),
    ):  # fmt: skip
        try:
            model = MODELS[name](muscle, **given_laws)
            low, high = model.contraction_limits
            force = model.force(pressure, low + share * (high - low))
        except InputError as error:
            assert "must" in str(error) and "\n" not in str(error)
            continue
        assert np.isfinite(force)
