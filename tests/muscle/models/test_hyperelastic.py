"""Pulls that are slopes of a Mooney-Rivlin energy, or of Ogden's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import BladderWall, find_radius, pull_ideal
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

MOONEY = {"c10": 0.05, "c01": 0.02}
ENERGIES = ["delson", "kothera-energy"]
STIFF = MUSCLE.replace(strand_modulus=1e6)
DELSON = MODELS["delson"](MUSCLE, **MOONEY)
LENGTHS = find_lengths(DELSON)


def thin(share=0.99):
    return MUSCLE.replace(inner_radius=share * MUSCLE.outer_radius)


def find_density(model, length, *, at):
    """Mooney-Rivlin energy of (2.18) and the stretches of (2.19) or (2.20), as they are printed."""
    braid, wall = model.braid, BladderWall.of(model.muscle, model.braid)
    radius, thickness = find_radius(braid, length), wall.thickness_at(length)
    across = (2.0 * radius - thickness) / (2.0 * braid.radius - wall.thickness)
    axial, hoop = length / braid.length, radius / braid.radius if at == "outer" else across
    radial = thickness / wall.thickness if at == "middle" else 1.0 / (axial * hoop)
    squares = [stretch**2 for stretch in (axial, hoop, radial)]
    first, second = sum(squares) - 3.0, sum(1.0 / square for square in squares) - 3.0
    given = model.parameters
    return given["c10"] * first + given["c01"] * second


# Energies ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ENERGIES)
def test_energies_are_models(name):
    for changes in ({}, {"stretches": "outer"}, {"friction": 0.1}):
        if "friction" in changes and name == "delson":
            continue
        check_model(build(name, **changes), [0.0, 0.1, 0.5], [0.0, 0.05])
    kind = MODELS[name]
    assert find_unused(lambda muscle: kind(muscle, **MOONEY)) == set(kind.unused)


@pytest.mark.parametrize("at", ["middle", "outer"])
@pytest.mark.parametrize("name", ENERGIES)
def test_the_pull_is_the_slope_of_the_potential(name, at):
    model = MODELS[name](STIFF, **MOONEY, stretches=at)
    braid, volume = model.braid, BladderWall.of(STIFF, model.braid).volume

    def potential(length):
        gas = math.pi * find_radius(braid, length) ** 2 * length - volume
        return volume * find_density(model, length, at=at) - 0.3 * gas

    lengths = find_lengths(model, edge=0.05)
    slope = differentiate(potential, lengths)
    strands = 0.0
    if name == "kothera-energy":
        strands = 0.3**2 * braid.strand_length**3 * lengths / braid.turns**4
        strands /= 4.0 * math.pi**3 * STIFF.strands * STIFF.strand_radius**2 * STIFF.strand_modulus
    force = pull(model, 0.3, lengths)
    assert force == pytest.approx(slope - strands, rel=1e-8, abs=1e-8 * np.abs(force).max())


@pytest.mark.parametrize("at", ["middle", "outer"])
def test_pull_and_contact_pressure_balance(at):
    """Across the muscle: strands, wall at one radius, and the pressure on all of the section."""
    model = MODELS["delson"](MUSCLE, **MOONEY, stretches=at)
    braid, wall = model.braid, model.wall
    state = model.solve(0.5, [0.1, 0.5, 1.0])
    length = braid.length - state.contraction
    radius = find_radius(braid, length)

    def density(at_length):
        axial = at_length / braid.length
        if at == "outer":
            hoop = radius / braid.radius
        else:
            bore = np.sqrt(radius**2 - wall.volume / (math.pi * at_length))
            hoop = (radius + bore) / (braid.radius + wall.bore_at_rest)
        squares = axial**2, hoop**2, 1.0 / (axial * hoop) ** 2
        return MOONEY["c10"] * sum(squares) + MOONEY["c01"] * sum(1.0 / s for s in squares)

    strands = state.contact_pressure * length**2 / (2.0 * math.pi * braid.turns**2)
    along = wall.volume * differentiate(density, length) - 0.5 * math.pi * radius**2
    assert strands + along == pytest.approx(state.force, rel=1e-8)


@pytest.mark.parametrize("at", ["middle", "outer"])
@pytest.mark.parametrize("name", ENERGIES)
def test_without_constants_it_is_gaylord(name, at):
    muscle = STIFF if name == "kothera-energy" else MUSCLE
    ideal = pull(build("gaylord-1", muscle), 0.4, LENGTHS)
    soft = MODELS[name](muscle, c10=0.0, c01=0.0, stretches=at)
    slack = 1e-4 if name == "kothera-energy" else 1e-14  # the strands still stretch a little
    assert pull(soft, 0.4, LENGTHS) == pytest.approx(ideal, rel=slack, abs=slack)
    assert np.all(soft.solve(0.4, [0.0, 0.5]).contact_pressure == 0.4)


def test_strands_that_stretch_less_come_to_delson():
    lengths = LENGTHS
    for at in ("middle", "outer"):
        delson = pull(MODELS["delson"](MUSCLE, **MOONEY, stretches=at), 0.4, lengths)
        misses = [
            np.abs(pull(MODELS["kothera-energy"](MUSCLE.replace(strand_modulus=stiff), **MOONEY,
                                                    stretches=at), 0.4, lengths) - delson).max()
            for stiff in (1e5, 1e6)
        ]  # fmt: skip
        assert misses[1] == pytest.approx(0.1 * misses[0], rel=1e-6)


def test_the_term_of_the_strands_is_what_their_stretch_takes():
    """Elastic strands under the gas alone: equilibrium of their length, then the braid's pull."""
    model = MODELS["kothera-energy"](MUSCLE, c10=0.0, c01=0.0)
    braid, pressure = model.braid, 0.05
    section = MUSCLE.strands * math.pi * MUSCLE.strand_radius**2 * MUSCLE.strand_modulus
    misses = []
    for share in (1.0, 0.1):
        acting = share * pressure
        strand = np.full(LENGTHS.shape, braid.strand_length)
        for _ in range(100):
            tension = acting * strand * LENGTHS / (2.0 * math.pi * braid.turns**2)
            strand = braid.strand_length * (1.0 + tension / section)
        turned = 4.0 * math.pi * braid.turns**2
        exact = acting * (3.0 * LENGTHS**2 - strand**2) / turned
        taken = pull_ideal(braid, acting, LENGTHS) - exact
        miss = pull(model, acting, LENGTHS) - exact
        misses.append(float(np.abs(miss / taken).max()))
    assert misses[0] < 1e-2
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.05)  # first order in the pressure


def test_the_term_of_the_strands_grows_with_the_square_of_the_pressure():
    model = build("kothera-energy", c10=0.0, c01=0.0)
    taken = [pull(model, p, LENGTHS) - pull_ideal(model.braid, p, LENGTHS) for p in (0.2, 0.4)]
    assert np.all(taken[0] < 0.0)
    assert taken[1] == pytest.approx(4.0 * taken[0], rel=1e-9)


@pytest.mark.parametrize("at", ["middle", "outer"])
@pytest.mark.parametrize("name", ENERGIES)
@settings(max_examples=20)
@given(muscle=muscles(), share=st.floats(0.02, 0.98), mix=st.floats(0.0, 0.5))
def test_the_wall_resists(name, at, muscle, share, mix):
    """At any contraction up to locking and any lengthening, with c01 <= c10; nothing at rest."""
    model = MODELS[name](muscle, c10=1.0 - mix, c01=mix, stretches=at)
    low, high = model.contraction_limits[0], model.braid.locking_contraction
    scale = float(model.wall.area_at_rest)
    assert model.force(0.0, 0.0) == pytest.approx(0.0, abs=1e-12 * scale)
    assert model.force(0.0, share * high) < 0.0 < model.force(0.0, share * low)


def test_the_second_constant_alone_need_not_resist():
    """It does near rest; with strands that lie flat it may push on from there."""
    flat = MUSCLE.replace(braid_angle=math.radians(8.0))
    for at in ("middle", "outer"):
        model = MODELS["delson"](flat, c10=0.0, c01=0.05, stretches=at)
        force = model.force(0.0, np.linspace(0.01, 1.0, 100) * model.braid.locking_contraction)
        assert force[0] < 0.0 < force.max()


def test_a_small_strain_is_linear_elastic():
    """E = 6 (C10 + C01): the spring of a thin sheet that may get thinner."""
    cotangent = math.tan(MUSCLE.braid_angle) ** -2  # - d ln r / d ln l
    shape = 1.0 - cotangent + cotangent**2
    for name in ENERGIES:
        for constants in (MOONEY, {"c10": 0.07, "c01": 0.0}, {"c10": 0.0, "c01": 0.07}):
            misses = []
            for share in (0.9, 0.99):
                model = MODELS[name](thin(share), **constants)
                rest = 4.0 / 3.0 * 6.0 * 0.07 * model.wall.area_at_rest / model.braid.length
                misses.append(model.stiffness(0.0, 0.0) / (rest * shape) - 1.0)
            assert abs(misses[1]) < 0.02 and misses[1] == pytest.approx(0.1 * misses[0], rel=0.3)


def test_middle_and_outer_stretch_differ_by_the_thickness():
    misses = []
    for share in (0.9, 0.99):
        one, other = (MODELS["delson"](thin(share), **MOONEY, stretches=at)
                      for at in ("middle", "outer"))  # fmt: skip
        forces = [pull(model, 0.0, np.linspace(25.0, 45.0, 9)) for model in (one, other)]
        misses.append(np.abs(forces[0] - forces[1]).max() / np.abs(forces[0]).max())
    assert 0.0 < misses[1] == pytest.approx(0.1 * misses[0], rel=0.3)


def test_delson_as_printed_is_pushed_by_the_pressure():
    printed = MODELS["delson"](MUSCLE, **MOONEY, as_printed=True)
    ideal = pull_ideal(DELSON.braid, 0.4, LENGTHS)
    assert pull(DELSON, 0.4, LENGTHS) - pull(printed, 0.4, LENGTHS) == pytest.approx(
        2.0 * ideal, rel=1e-12, abs=1e-12
    )
    assert printed.blocked_force(0.4) < 0.0 < DELSON.blocked_force(0.4)
    assert np.array_equal(pull(printed, 0.0, LENGTHS), pull(DELSON, 0.0, LENGTHS))


def test_kothera_as_printed_is_helped_by_the_wall():
    mended, printed = (build("kothera-energy", as_printed=way, **MOONEY) for way in (False, True))
    assert np.array_equal(pull(printed, 0.0, LENGTHS), -pull(mended, 0.0, LENGTHS))
    ideal = pull_ideal(mended.braid, 0.4, LENGTHS)
    soft = [build("kothera-energy", as_printed=way, c10=0.0, c01=0.0) for way in (False, True)]
    taken = [ideal - pull(model, 0.4, LENGTHS) for model in soft]
    assert taken[1] == pytest.approx(math.pi * MUSCLE.strand_radius * taken[0], rel=1e-9)


def test_friction_is_a_share_of_the_pull_and_against_the_motion():
    model, printed = (
        build("kothera-energy", friction=0.2, as_printed=way, **MOONEY) for way in (False, True)
    )
    for pressure, contraction in ((0.4, 2.0), (0.0, 5.0)):  # pulls, and pushes
        up, free, down = model.force(pressure, contraction, direction=WAYS)
        assert (up, down) == pytest.approx((free - 0.2 * abs(free), free + 0.2 * abs(free)))
    up, free, down = printed.force(0.0, -3.0, direction=WAYS)
    assert free < 0.0 and up == pytest.approx(0.8 * free) and down == pytest.approx(1.2 * free)


@pytest.mark.parametrize("at", ["middle", "outer"])
def test_constants_are_found_by_linear_least_squares(at):
    truth = {"c10": 0.0437, "c01": -0.0121}
    for name in ENERGIES:
        assert recover_linear(name, truth, stretches=at) == pytest.approx(truth, rel=1e-8)
    rubbing, plain = (build("kothera-energy", friction=x, stretches=at) for x in (0.13, 0.0))
    up, free = (pull(model, 0.4, LENGTHS, direction="inflating") for model in (rubbing, plain))
    unit = pull(plain.replace(friction=0.5), 0.4, LENGTHS, direction="inflating") - free
    found = np.linalg.lstsq(2.0 * unit[:, None], up - free, rcond=None)[0]
    assert found == pytest.approx([0.13], rel=1e-8)


def test_a_guess_has_the_modulus_of_the_tube():
    muscle = MUSCLE.replace(mooney_ratio=0.3)
    for name in ENERGIES:
        guess = MODELS[name].guess_parameters(muscle)
        assert 6.0 * (guess["c10"] + guess["c01"]) == pytest.approx(muscle.modulus)
        assert guess["c01"] == pytest.approx(0.3 * (guess["c10"] + guess["c01"]))
        with pytest.raises(InputError, match=f"the model {name} must be given c10, c01"):
            MODELS[name](muscle)


@pytest.mark.parametrize("name", ENERGIES)
@settings(max_examples=40)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)


# Ogden ------------------------------------------------------------------------------------------


def ogden(exponent, at, muscle=MUSCLE):
    return MODELS["ogden"](muscle, exponent=exponent, stretches=at)


@pytest.mark.parametrize("exponent", [-3.0, 0.0, 1.5])
def test_ogden_is_a_model(exponent):
    for at in ("middle", "outer"):
        check_model(ogden(exponent, at), [0.0, 0.1, 0.5], [0.0, 0.05])
    kind = MODELS["ogden"]
    assert find_unused(lambda muscle: kind(muscle, exponent=exponent)) == set(kind.unused)


@pytest.mark.parametrize("at", ["middle", "outer"])
def test_ogden_has_mooney_rivlins_terms_as_limits(at):
    for exponent, constants in ((2.0, ("c10", "c01")), (-2.0, ("c01", "c10"))):
        given = dict(zip(constants, (MUSCLE.modulus / 6.0, 0.0), strict=True))
        mooney, model = MODELS["delson"](MUSCLE, **given, stretches=at), ogden(exponent, at)
        expected = pull(mooney, 0.4, LENGTHS)
        slack = 1e-12 * np.abs(expected).max()
        assert pull(model, 0.4, LENGTHS) == pytest.approx(expected, rel=1e-11, abs=slack)
        contacts = [each.solve(0.4, [0.0, 0.3]).contact_pressure for each in (mooney, model)]
        assert contacts[0] == pytest.approx(contacts[1], rel=1e-9)


def test_neo_hookean_ogden_is_trivedi_by_energy():
    trivedi = MODELS["trivedi"](MUSCLE, force="energy", volume="outer")
    expected = pull(trivedi, 0.4, LENGTHS)
    slack = 1e-12 * np.abs(expected).max()
    assert pull(ogden(2.0, "outer"), 0.4, LENGTHS) == pytest.approx(expected, rel=1e-11, abs=slack)


@pytest.mark.parametrize("at", ["middle", "outer"])
@pytest.mark.parametrize("exponent", [-4.0, -0.5, 0.0, 1e-7, 1.0, 6.0])
def test_the_pull_of_ogden_is_the_slope_of_its_energy(exponent, at):
    model = ogden(exponent, at)
    braid, wall = model.braid, model.wall

    def potential(length):
        radius = find_radius(braid, length)
        axial, hoop = length / braid.length, radius / braid.radius
        if at == "middle":
            thickness = wall.thickness_at(length)
            hoop = (2.0 * radius - thickness) / (2.0 * braid.radius - wall.thickness)
        logs = np.log([axial, hoop, 1.0 / (axial * hoop)])
        # sum of (lambda**a - 1) / a**2 is that of log**2 / 2 at a = 0: the logarithms' sum is zero
        small = abs(exponent) < 1e-3
        terms = logs**2 / 2.0 if small else np.expm1(exponent * logs) / exponent**2
        energy = 2.0 / 3.0 * MUSCLE.modulus * terms.sum(axis=0)
        return wall.volume * energy - 0.3 * math.pi * radius**2 * length

    lengths = find_lengths(model, edge=0.05)
    force = pull(model, 0.3, lengths)
    assert force == pytest.approx(
        differentiate(potential, lengths), rel=1e-6, abs=1e-6 * np.abs(force).max()
    )


def test_the_exponent_makes_no_difference_to_a_small_strain():
    forces = [ogden(a, "middle").force(0.0, [0.0, 1e-5]) for a in (-5.0, 0.0, 2.0, 7.0)]
    for rest, near in forces:
        assert rest == 0.0 and near < 0.0
        assert near == pytest.approx(forces[0][1], rel=1e-3)


def test_a_larger_exponent_stiffens_the_wall_that_widens():
    """Round the muscle; along it a wall that shortens is the softer, the larger the exponent."""
    held = [0.1, 0.5, 1.0]
    bears = [0.4 - ogden(a, "outer").solve(0.4, held).contact_pressure for a in (0.0, 2.0, 4.0)]
    assert np.all(np.diff(bears, axis=0) > 0.0)


@settings(max_examples=40)
@given(data=st.data(), muscle=muscles())
def test_any_question_to_ogden_is_answered_or_refused(data, muscle):
    ask_anything(data, "ogden", muscle)
