"""Moments at crossings do the work of virtual displacements; the first estimate has no ends."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError, MissingLawError
from bozzini.muscle.models import MODELS
from bozzini.muscle.models.ideal import find_radius
from tests.muscle.models.catalogue import MUSCLE, build, differentiate, find_lengths
from tests.muscle.models.relations import WAYS, ask_anything, check_model, find_unused, pull
from tests.muscle.strategies import muscles

LAWS = ["strand_friction_moment", "bending_moment", "bulging_moment", "bladder_friction_moment"]


def press(pressure, angle):
    return 1e-5 * pressure * np.sin(angle)


def turn(pressure, angle):
    return 2e-5 * (angle - MUSCLE.braid_angle)


def chen(muscle=MUSCLE, **changes):
    return MODELS["chen"](muscle, **{name: press for name in LAWS} | changes)


def test_models_are_models():
    check_model(chen(bending_moment=turn), [0.1, 0.5], [0.0, 0.05])
    check_model(build("braid-tension"), [0.1, 0.5], [0.1, 0.5])
    assert find_unused(chen) == set(MODELS["chen"].unused)
    assert find_unused(lambda muscle: build("braid-tension", muscle)) == set(
        MODELS["braid-tension"].unused
    )


def test_no_moments_make_gaylord():
    lengths = find_lengths(build("gaylord-1"))
    ideal = pull(build("gaylord-1"), 0.4, lengths)
    for name in LAWS:
        model = MODELS["chen"](MUSCLE, **{name: lambda pressure, angle: 0.0 * angle})
        for way in WAYS:
            assert np.array_equal(pull(model, 0.4, lengths, direction=way), ideal)


def test_friction_has_a_direction_and_elasticity_has_none():
    """(F1 + F2) / 2 has the elastic moments, (F2 - F1) / 2 those of friction."""
    lengths = find_lengths(build("gaylord-1"))
    ideal = pull(build("gaylord-1"), 0.4, lengths)
    for name in LAWS:
        model = MODELS["chen"](MUSCLE, **{name: press})
        up, free, down = (pull(model, 0.4, lengths, direction=way) for way in WAYS)
        assert 0.5 * (up + down) == pytest.approx(free, rel=1e-12)
        if "friction" in name:
            assert np.array_equal(free, ideal) and np.all(up < free) and np.all(free < down)
        else:
            assert np.array_equal(up, down) and np.all(free < ideal)


def test_moments_of_one_kind_add_up():
    lengths = find_lengths(build("gaylord-1"))
    ideal = pull(build("gaylord-1"), 0.4, lengths)
    one = MODELS["chen"](MUSCLE, bending_moment=press)
    all_four = chen()
    taken = ideal - pull(one, 0.4, lengths)
    up, free, down = (pull(all_four, 0.4, lengths, direction=way) for way in WAYS)
    assert ideal - free == pytest.approx(2.0 * taken, rel=1e-9)
    assert down - up == pytest.approx(4.0 * taken, rel=1e-9)
    assert ideal - up == pytest.approx(4.0 * taken, rel=1e-9)  # (2.30): all four against it


def test_a_moment_works_on_the_angle_at_every_crossing():
    """A spring at each crossing: its energy, counted crossing by crossing, gives the force."""
    stiff = 3e-5

    def spring(pressure, angle):
        return stiff * (angle - MUSCLE.braid_angle) * 2.0

    model = MODELS["chen"](MUSCLE, bending_moment=spring)
    each_way = MUSCLE.strands // 2
    crossings = each_way**2 * 2.0 * model.braid.turns  # N turns one way and N the other

    def energy(length):  # of springs at the angle 2 theta
        opening = 2.0 * (model.braid.angle_at(length) - MUSCLE.braid_angle)
        return crossings * 0.5 * stiff * opening**2

    lengths = find_lengths(model, edge=0.1)
    assert pull(model, 0.0, lengths) == pytest.approx(
        differentiate(energy, lengths), rel=1e-7, abs=1e-9
    )


def test_chen_as_printed_has_four_times_the_moments():
    lengths = find_lengths(build("gaylord-1"))
    ideal = pull(build("gaylord-1"), 0.4, lengths)
    for way in WAYS:
        mended = pull(chen(), 0.4, lengths, direction=way)
        printed = pull(chen(as_printed=True), 0.4, lengths, direction=way)
        assert printed - ideal == pytest.approx(4.0 * (mended - ideal), rel=1e-9, abs=1e-13)


def test_chen_wants_a_law_and_says_where_it_is():
    with pytest.raises(MissingLawError, match="one at least of the laws strand_friction_moment.*"
                       r"they are in Chen et al., reference \[121\]") as error:  # fmt: skip
        MODELS["chen"](MUSCLE)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="^answer of bending_moment.* is nan"):
        MODELS["chen"](MUSCLE, bending_moment=lambda p, angle: np.nan * angle).force(0.1, 1.0)


# The first estimate -------------------------------------------------------------------------------


@settings(max_examples=50)
@given(muscles(), st.floats(0.0, 1.0), st.floats(1e-3, 10.0))
def test_strands_alone_lack_the_pressure_on_the_ends(muscle, share, pressure):
    model, ideal = MODELS["braid-tension"](muscle), MODELS["gaylord-1"](muscle)
    low, high = (model.braid.length - x for x in model.contraction_limits[::-1])
    length = low + share * (high - low)
    ends = pressure * math.pi * find_radius(model.braid, np.asarray(length)) ** 2
    force = pull(model, pressure, length)
    assert force - ends == pytest.approx(
        float(pull(ideal, pressure, length)), abs=1e-9 * float(force + ends)
    )


def test_the_estimate_is_the_equation_of_its_card():
    """(2.33): eps = 1 - sqrt(F tan^2 / (2 pi r0^2 P)); none at F = 2 pi r0^2 P / tan^2."""
    model, load = build("braid-tension"), np.array([0.1, 0.5, 1.0, 2.0])
    scale = 2.0 * math.pi * MUSCLE.braid_radius**2 * 0.4 / math.tan(MUSCLE.braid_angle) ** 2
    strain = 1.0 - np.sqrt(load / scale)
    assert model.contraction(0.4, load) == pytest.approx(42.0 * strain, rel=1e-11)
    assert model.blocked_force(0.4) == pytest.approx(scale, rel=1e-12)
    assert model.contraction(0.4, scale) == pytest.approx(0.0, abs=1e-12)


def test_the_estimate_never_locks():
    model = build("braid-tension")
    locked = model.braid.locking_contraction
    assert model.force(0.4, [locked, locked + 5.0]).min() > 0.0
    assert model.contraction(0.4, 0.01) > locked
    with pytest.raises(InputError, match="^load is 0 N: at a pressure of 0.4 MPa it must lie in"):
        model.free_contraction(0.4)


@pytest.mark.parametrize("name", ["chen", "braid-tension"])
@settings(max_examples=30)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle)
