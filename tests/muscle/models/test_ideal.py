"""Ideal muscles: one function in two forms, the energy behind it, and what a wall adds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.muscle import LOCKING_ANGLE, EnergyMuscle
from bozzini.muscle.models import MODELS
from tests.muscle.models.catalogue import MUSCLE, build, differentiate, find_lengths
from tests.muscle.strategies import muscles


def pull(model, pressure, length):
    return model.force(pressure, model.braid.length - length)


def test_gaylord_is_pressure_times_the_volume_gained():
    model = build("gaylord-1")
    lengths = find_lengths(model)
    slope = differentiate(model.braid.volume_at, lengths)
    assert pull(model, 0.3, lengths) == pytest.approx(-0.3 * slope, rel=1e-9, abs=1e-9)


@settings(max_examples=50)
@given(muscles(), st.floats(0.0, 1.0), st.floats(0.0, 20.0))
def test_both_forms_of_gaylord_are_one(muscle, share, pressure):
    angle, strain = (MODELS[name](muscle) for name in ("gaylord-1", "gaylord-2"))
    low, high = angle.contraction_limits
    contraction = low + share * (high - low)
    force = angle.force(pressure, contraction)
    scale = abs(float(angle.blocked_force(pressure)))
    assert strain.force(pressure, contraction) == pytest.approx(
        force, rel=1e-11, abs=1e-11 * scale + 1e-300
    )
    length = angle.braid.length - contraction
    same = angle.braid.ideal_force(pressure, min(length, angle.braid.strand_length))
    assert force == pytest.approx(same, rel=1e-9, abs=1e-9 * scale + 1e-300)


@pytest.mark.parametrize("name", ["gaylord-1", "gaylord-2"])
def test_gaylord_locks_and_is_linear_in_pressure(name):
    model = build(name)
    locked = model.braid.locking_contraction
    assert model.force([0.1, 0.8], locked) == pytest.approx([0.0, 0.0], abs=1e-14)
    assert model.force(0.5, locked - 0.1) > 0.0 > model.force(0.5, locked + 0.1)
    assert model.free_contraction([0.1, 0.8]) == pytest.approx([locked, locked], rel=1e-12)
    assert model.braid_angle(0.4) == pytest.approx(LOCKING_ANGLE, rel=1e-12)
    assert model.force(0.6, 5.0) == pytest.approx(3.0 * model.force(0.2, 5.0))
    lengths = find_lengths(model)
    stiff = 6.0 * 0.5 * lengths / (4.0 * math.pi * model.braid.turns**2)
    assert model.stiffness(0.5, model.braid.length - lengths) == pytest.approx(stiff, rel=1e-9)
    angle = MUSCLE.braid_angle
    blocked = math.pi * MUSCLE.braid_radius**2 * (3.0 * math.cos(angle) ** 2 - 1.0)
    assert model.blocked_force(1.0) == pytest.approx(blocked / math.sin(angle) ** 2, rel=1e-12)


def test_gaylord_has_a_closed_contraction():
    """The inverse of (2.4): eps = 1 - sqrt((F / (pi r0^2 P) + q2) / q1)."""
    model = build("gaylord-2")
    load, pressure = np.meshgrid([0.0, 0.5, 1.5, 3.0], [0.4, 0.8])
    q1, q2 = 3.0 / math.tan(MUSCLE.braid_angle) ** 2, 1.0 / math.sin(MUSCLE.braid_angle) ** 2
    area = math.pi * MUSCLE.braid_radius**2
    strain = 1.0 - np.sqrt((load / (area * pressure) + q2) / q1)
    assert model.contraction(pressure, load) == pytest.approx(42.0 * strain, rel=1e-10, abs=1e-11)


def test_the_recommended_model_without_a_wall_is_gaylord():
    soft = MUSCLE.replace(modulus=1e-7, gap=0.0)
    load = [0.0, 0.5]
    ideal = build("gaylord-1", soft).contraction(0.5, load)
    assert EnergyMuscle(soft).contraction(0.5, load) == pytest.approx(ideal, rel=1e-5)


def test_chou_is_pressure_times_the_bore_gained_at_constant_thickness():
    model = build("chou")
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    lengths = find_lengths(model)

    def bore(length):
        return math.pi * (model.braid.radius_at(length) - thickness) ** 2 * length

    assert pull(model, 0.3, lengths) == pytest.approx(
        -0.3 * differentiate(bore, lengths), rel=1e-8, abs=1e-9
    )


def test_a_wall_that_keeps_its_volume_makes_gaylord_of_chou():
    """The warning of the card: incompressible, the bore lacks a constant."""
    model = build("chou")
    wall = math.pi * (MUSCLE.braid_radius**2 - 0.45**2) * 42.0
    lengths = find_lengths(model)
    slope = differentiate(lambda length: model.braid.volume_at(length) - wall, lengths)
    assert pull(build("gaylord-1"), 0.3, lengths) == pytest.approx(-0.3 * slope, rel=1e-9, abs=1e-9)


def test_chou_without_thickness_is_gaylord():
    lengths = find_lengths(build("chou"), edge=0.1)
    misses = []
    for share in (0.9, 0.99):
        thin = MUSCLE.replace(inner_radius=share * MUSCLE.outer_radius)
        ideal = pull(build("gaylord-1", thin), 0.3, lengths)
        misses.append(np.abs(pull(build("chou", thin), 0.3, lengths) - ideal).max())
    assert misses[1] == pytest.approx(0.1 * misses[0], rel=0.1)  # first order in the thickness


def test_chou_pulls_at_the_locking_angle():
    model = build("chou")
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    scale = model.braid.strand_length / (math.pi * model.braid.turns * math.sqrt(6.0))
    force = math.pi * 0.5 * thickness * (scale - thickness)
    assert model.force(0.5, model.braid.locking_contraction) == pytest.approx(force, rel=1e-12)
    assert force > 0.0
    assert model.free_contraction(0.5) > model.braid.locking_contraction


def test_chou_ends_where_the_bore_closes():
    model = build("chou")
    thickness = MUSCLE.outer_radius - MUSCLE.inner_radius
    longest = model.braid.length - model.contraction_limits[0]
    left = float(model.braid.radius_at(longest)) - thickness
    assert left == pytest.approx(0.01 * 0.45, rel=1e-6)


def test_the_prints_are_right():
    for name in ("gaylord-1", "gaylord-2", "chou"):
        assert np.array_equal(
            build(name, as_printed=True).contraction(0.5), build(name).contraction(0.5)
        )
        assert MODELS[name].card.latex_printed is None
