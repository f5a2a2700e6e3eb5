"""A membrane, and layers that come to the thick wall as they get thinner."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle import EnergyMuscle
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import (
    balance_forces,
    find_contact_pressure,
    find_radius,
    pull_ideal,
)
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

BALL = build("ball")
LENGTHS = find_lengths(BALL)
SHEAR = MUSCLE.modulus / 3.0


def find_thick_wall(model, pressure, length):
    """Pull and contact pressure of a thick neo-Hookean wall, by integration of its stresses."""
    braid, wall = model.braid, model.wall
    shear, stretch = model.muscle.modulus / 3.0, length / braid.length
    outside = float(find_radius(braid, np.asarray(length)))
    inside = math.sqrt(outside**2 - wall.area_at_rest / (math.pi * stretch))

    def find(radius):  # stresses round and along it less the radial one
        rest = math.sqrt(braid.radius**2 - (outside**2 - radius**2) * stretch)
        hoop = radius / rest
        radial = 1.0 / (hoop * stretch) ** 2
        return shear * (hoop**2 - radial), shear * (stretch**2 - radial)

    borne = quad(lambda r: find(r)[0] / r, inside, outside, epsrel=1e-12)[0]

    def inner(radius):
        return quad(lambda r: find(r)[0] / r, inside, radius, epsrel=1e-12)[0]

    along = quad(
        lambda r: 2.0 * math.pi * r * (find(r)[1] - pressure + inner(r)), inside, outside,
        epsrel=1e-11,
    )[0]  # fmt: skip
    strands = (pressure - borne) * length**2 / (2.0 * math.pi * braid.turns**2)
    return strands + along - pressure * math.pi * inside**2, pressure - borne


def effective(length, pressure):
    return 0.8 * pressure


def hooke(axial, hoop):
    return MUSCLE.modulus * (axial - 1.0)


def hooke_round(axial, hoop):
    return MUSCLE.modulus * (hoop - 1.0)


# Ball -------------------------------------------------------------------------------------------


def test_ball_is_a_model():
    kind = MODELS["ball"]
    for model in (
        kind(MUSCLE, n_layers=1), BALL, kind(MUSCLE, axial_stress=hooke, hoop_stress=hooke_round)
    ):  # fmt: skip
        check_model(model, [0.0, 0.1, 0.5], [0.0, 0.05])
    assert find_unused(kind) == set(kind.unused)


def test_layers_come_to_the_thick_wall():
    """With an error that falls with the square of their number."""
    exact = [find_thick_wall(BALL, 0.3, length) for length in LENGTHS[1:-1:2]]
    misses = []
    for layers in (10, 20, 40):
        model = BALL.replace(n_layers=layers)
        force = pull(model, 0.3, LENGTHS[1:-1:2])
        misses.append(np.abs(force - [value[0] for value in exact]).max())
    assert misses[0] == pytest.approx(4.0 * misses[1], rel=0.1)
    assert misses[1] == pytest.approx(4.0 * misses[2], rel=0.1)
    assert misses[2] < 1e-4 * np.abs([value[0] for value in exact]).max()


def test_many_layers_are_our_own_model():
    """The slope of a thick wall's energy, without a gap; Richardson's limit of 100 and 200."""
    muscle = MUSCLE.replace(gap=0.0)
    contraction = np.linspace(-1.0, 11.5, 7)
    own = EnergyMuscle(muscle)
    half, full = (MODELS["ball"](muscle, n_layers=n) for n in (100, 200))
    limit = (4.0 * full.force(0.5, contraction) - half.force(0.5, contraction)) / 3.0
    assert limit == pytest.approx(own.force(0.5, contraction), rel=1e-6, abs=1e-8)
    contact = [model.solve(0.5, 0.3).contact_pressure for model in (full, own)]
    assert contact[0] == pytest.approx(float(contact[1]), rel=1e-4)


@settings(max_examples=60)
@given(muscles(modulus=1e-9), st.integers(1, 40), st.floats(0.0, 1.0), st.floats(1e-3, 10.0))
def test_a_wall_that_resists_nothing_is_gaylord_with_any_layers(muscle, layers, share, pressure):
    """As printed the pressure on the wall is missing along the muscle: P V_b / l more."""
    model = MODELS["ball"](muscle, n_layers=layers)
    low, high = (model.braid.length - x for x in model.contraction_limits[::-1])
    length = np.asarray(low + share * (high - low))
    ideal, area = pull_ideal(model.braid, pressure, length), model.wall.area_at(length)
    strands = length**2 / (2.0 * math.pi * model.braid.turns**2)
    # Far from rest layers close to the bore are stretched a lot.
    slack = 1e-7 * pressure * float(strands + area + find_radius(model.braid, length) ** 2)
    soft = 1e-9 * (1e4 + (length / model.braid.length) ** -4) * float(strands + area)
    assert pull(model, pressure, length) == pytest.approx(float(ideal), abs=slack + soft)
    if length > 0.5 * model.braid.length:
        printed = pull(model.replace(as_printed=True), pressure, length) - ideal
        assert printed == pytest.approx(float(pressure * area), abs=slack + soft)


def test_one_layer_is_the_balance_of_forces_with_its_whole_stresses():
    model = BALL.replace(n_layers=1)
    braid, wall, pressure = model.braid, model.wall, 0.4
    radius, thickness = find_radius(braid, LENGTHS), wall.thickness_at(LENGTHS)
    axial, middle = LENGTHS / 42.0, radius - 0.5 * thickness
    hoop = middle / (MUSCLE.braid_radius - 0.5 * wall.thickness)
    radial = (1.0 / (axial * hoop)) ** 2
    assert thickness / wall.thickness == pytest.approx(np.sqrt(radial), rel=1e-9)
    along, around = SHEAR * (axial**2 - radial), SHEAR * (hoop**2 - radial)
    mean = pressure - 0.5 * around * thickness / middle
    stresses = {"axial_stress": along - mean, "hoop_stress": around - mean}
    expected = balance_forces(
        pressure,
        LENGTHS,
        braid=braid,
        section=(thickness, wall.area_at(LENGTHS)),
        stresses=(stresses["axial_stress"], stresses["hoop_stress"]),
    )
    assert pull(model, pressure, LENGTHS) == pytest.approx(expected, rel=1e-9, abs=1e-10)
    contact = find_contact_pressure(
        pressure, LENGTHS, braid=braid, thickness=thickness, hoop_stress=stresses["hoop_stress"]
    )
    assert pressure - around * thickness / middle == pytest.approx(contact, rel=1e-9)


@settings(max_examples=40)
@given(muscle=muscles(), layers=st.integers(1, 20), share=st.floats(0.02, 0.98))
def test_the_wall_resists(muscle, layers, share):
    model = MODELS["ball"](muscle, n_layers=layers)
    scale = float(model.wall.area_at_rest) * muscle.modulus / math.tan(muscle.braid_angle) ** 4
    assert model.force(0.0, 0.0) == pytest.approx(0.0, abs=1e-11 * scale)
    low, high = model.contraction_limits[0], model.braid.locking_contraction
    assert model.force(0.0, share * high) < 0.0 < model.force(0.0, share * low)


def test_stresses_can_be_given():
    kind = MODELS["ball"]
    own = kind(
        MUSCLE,
        axial_stress=lambda axial, hoop: SHEAR * (axial**2 - 1.0 / (axial * hoop) ** 2),
        hoop_stress=lambda axial, hoop: SHEAR * (hoop**2 - 1.0 / (axial * hoop) ** 2),
    )
    assert pull(own, 0.4, LENGTHS) == pytest.approx(pull(BALL, 0.4, LENGTHS), rel=1e-12)
    linear = kind(MUSCLE, axial_stress=hooke, hoop_stress=hooke_round)
    plain = kind(MUSCLE, axial_stress=hooke, hoop_stress=lambda axial, hoop: 0.0 * hoop)
    assert linear.contraction(0.4) < plain.contraction(0.4)
    for alone, other in (("axial_stress", "hoop_stress"), ("hoop_stress", "axial_stress")):
        with pytest.raises(
            MissingLawError, match=f"the law {alone} alone: it must be given {other}"
        ):
            kind(MUSCLE, **{alone: hooke})


def test_ball_as_printed_is_the_equation_letter_by_letter():
    printed = MODELS["ball"](MUSCLE, n_layers=1, as_printed=True)
    braid, wall, length = printed.braid, printed.wall, LENGTHS
    r, t = find_radius(braid, length), wall.thickness_at(length)
    axial = length / 42.0
    hoop = (2.0 * r - t) / (2.0 * MUSCLE.braid_radius - wall.thickness)
    radial = (1.0 / (axial * hoop)) ** 2
    along, around = SHEAR * (axial**2 - radial), SHEAR * (hoop**2 - radial)
    b, turns, volume = braid.strand_length, braid.turns, wall.volume
    root = np.sqrt((b**2 - length**2) / (turns * math.pi) ** 2 - 4.0 * volume / (math.pi * length))
    assert root == pytest.approx(2.0 * (r - t), rel=1e-7)  # the diameter of the bore
    on_braid = 0.4 - around * wall.thickness / (axial * hoop * root)
    expected = on_braid * length**2 / (2.0 * math.pi * turns**2) + along * volume / length
    expected -= 0.4 * ((b**2 - length**2) / (4.0 * math.pi * turns**2) - volume / length)
    assert pull(printed, 0.4, length) == pytest.approx(expected, rel=1e-8, abs=1e-9)
    assert np.all(pull(printed, 0.4, length[:5]) > pull(BALL, 0.4, length[:5]))


def test_friction_needs_the_pressure_of_the_paper():
    with pytest.raises(MissingLawError, match=r"effective_pressure\(length .*Ball and Garcia"):
        build("ball", friction=0.1)

    model = build("ball", friction=0.1, effective_pressure=effective)
    up, free, down = model.force(0.5, 2.0, direction=WAYS)
    assert (free - up, down - free) == pytest.approx((0.04, 0.04), rel=1e-9)
    check_model(model, [0.1, 0.5], [0.0, 0.05])
    truth = {"friction": 0.0137}
    found = recover_linear("ball", truth, effective_pressure=effective)
    assert found == pytest.approx(truth, rel=1e-8)


def test_a_large_batch_is_its_members():
    """Layers are crossed by blocks of lengths."""
    model = BALL.replace(n_layers=200)
    contraction = np.linspace(0.0, 10.0, 3000).reshape(3, 1000)
    force = model.force(0.4, contraction)
    assert force.shape == (3, 1000)
    for index in ((0, 0), (1, 310), (1, 311), (2, 999)):
        assert force[index] == pytest.approx(float(model.force(0.4, contraction[index])), rel=1e-12)


@pytest.mark.parametrize("layers", [0, 2.5, 1001, math.nan, "many"])
def test_layers_are_a_whole_number(layers):
    with pytest.raises(InputError, match="^n_layers of the model ball is .*: it must") as error:
        build("ball", n_layers=layers)
    assert "\n" not in str(error.value)


# Liu --------------------------------------------------------------------------------------------


def widen(length, pressure):
    return find_radius(BALL.braid, length) / MUSCLE.braid_radius


def strands(length, pressure, modulus=0.2):
    """Axial stress of strands that do not stretch, in a membrane of no strength of its own."""
    radius = find_radius(BALL.braid, length)
    slope = 1.0 / np.tan(BALL.braid.angle_at(length)) ** 2
    scale = 2.0 * modulus * MUSCLE.braid_radius
    return pressure * widen(length, pressure) * radius**2 * slope / scale


def make_liu(muscle=MUSCLE, *, modulus=0.2, **given):
    laws = {"radial_stretch": widen, "axial_stress": strands, **given}
    return MODELS["liu"](muscle, membrane_modulus=modulus, **laws)


def test_strands_alone_make_gaylord():
    lengths = find_lengths(build("gaylord-1"))
    for modulus in (0.1, 2.0):
        own = functools.partial(strands, modulus=modulus)
        force = pull(make_liu(modulus=modulus, axial_stress=own), 0.4, lengths)
        ideal = pull_ideal(BALL.braid, 0.4, lengths)
        assert force == pytest.approx(ideal, rel=1e-9, abs=1e-10)


def test_the_pressure_of_liu_is_the_thrust_on_the_middle():
    plain = make_liu(axial_stress=lambda length, pressure: 0.1 + 0.0 * pressure)
    change = plain.force(0.4, 3.0) - plain.force(0.1, 3.0)
    radius = float(find_radius(BALL.braid, np.asarray(39.0)))
    assert change == pytest.approx(-0.3 * math.pi * radius**2, rel=1e-10)
    more = make_liu(axial_stress=lambda length, pressure: 0.2 + 0.0 * pressure)
    assert more.force(0.4, 3.0) > plain.force(0.4, 3.0)
    pulls = 4.0 * math.pi * 0.2 * MUSCLE.braid_radius * 0.1 / (radius / MUSCLE.braid_radius)
    assert plain.force(0.0, 3.0) == pytest.approx(pulls, rel=1e-10)


def test_liu_is_a_model():
    check_model(make_liu(), [0.1, 0.5], [0.0, 0.05], edge=0.1)
    assert find_unused(make_liu) == set(MODELS["liu"].unused)


def test_the_modulus_of_a_membrane_is_found_by_linear_least_squares():
    truth = {"membrane_modulus": 0.237}
    laws = {"radial_stretch": widen, "axial_stress": strands}
    assert recover_linear("liu", truth, **laws) == pytest.approx(truth, rel=1e-8)


def test_liu_wants_its_laws_and_says_where_they_are():
    kind = MODELS["liu"]
    for laws, law in (({}, "radial_stretch"), ({"radial_stretch": widen}, "axial_stress")):
        with pytest.raises(
            MissingLawError, match=rf"the law {law}\(length .*Liu and Rahn \(2003\)"
        ):
            kind(MUSCLE, membrane_modulus=0.2, **laws)
    with pytest.raises(InputError, match="the model liu must be given membrane_modulus"):
        kind(MUSCLE, radial_stretch=widen, axial_stress=widen)
    with pytest.raises(InputError, match="liu cannot be evaluated as printed: its P E / r0"):
        make_liu(as_printed=True)
    with pytest.raises(InputError, match="the model liu has no answer there"):
        make_liu(radial_stretch=lambda length, pressure: 0.0 * length).force(0.3, 1.0)


@pytest.mark.parametrize("name", ["ball", "liu"])
@settings(max_examples=50)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)
