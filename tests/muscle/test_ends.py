"""Trellis ends: against a boundary value problem, the soft limit, and Maxwell's relations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle import EnergyMuscle, preset
from tests.muscle import reference
from tests.muscle.strategies import SHARES, muscles, pressures

RULE = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0
NEAR = np.array([-2.0, -1.0, 1.0, 2.0])


def pair(name: str = "thesis-45", **changes: float) -> tuple[EnergyMuscle, EnergyMuscle]:
    muscle = preset(name, **changes)
    return EnergyMuscle(muscle), EnergyMuscle(muscle, ends="trellis")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "pressure", "load"),
    [("thesis-45", 0.7, 0.0), ("thesis-45", 0.7, 1.0), ("effector-45", 0.3, 0.4)],
)
def test_taper_against_a_boundary_value_problem(name, pressure, load):
    plain, ended = pair(name)
    contraction = float(plain.contraction(pressure, load))
    stretch = 1.0 - contraction / plain.muscle.length
    expected = reference.taper(plain.muscle, pressure, load, stretch)
    found = 0.5 * (float(ended.contraction(pressure, load)) - contraction)
    assert found == pytest.approx(expected, abs=2e-6)
    assert -0.1 < found < -0.03


@pytest.mark.parametrize("angle", [25.0, 36.0, 48.0])
def test_soft_taper_decays_as_in_closed_form(angle):
    """Close to rest the taper is exponential: radius cot(angle)^2 / sqrt(3) along the axis."""
    muscle = preset("thesis-45", length=100.0, braid_angle=math.radians(angle), modulus=1e-9)
    plain, ended = EnergyMuscle(muscle), EnergyMuscle(muscle, ends="trellis")
    shrink = 1e-4
    load = float(plain.force(1.0, shrink * muscle.length))
    difference = 0.5 * float(ended.contraction(1.0, load) - plain.contraction(1.0, load))
    cosine, sine = math.cos(muscle.braid_angle), math.sin(muscle.braid_angle)
    # Along the taper the strands' cosine differs from the cylinder's by shrink cos exp(-z / decay).
    expected = -shrink * ended.taper_length
    assert difference == pytest.approx(expected, rel=2e-3)
    assert ended.taper_length == pytest.approx(
        muscle.braid_radius * (cosine / sine) ** 2 / math.sqrt(3.0)
    )


def test_cost_of_the_ends():
    for name in ("thesis-45", "effector-45"):
        plain, ended = pair(name)
        pressure, load = np.meshgrid([0.3, 0.5, 0.7], [0.0, 0.3])
        cost = plain.contraction(pressure, load) - ended.contraction(pressure, load)
        assert np.all((cost > 0.05) & (cost < 0.19))


@pytest.mark.parametrize("changes", [{}, {"mooney_ratio": 0.3}, {"dead_length": 11.7}])
def test_maxwells_relations(changes):
    _, ended = pair(**changes)
    for pressure, load in [(0.02, 0.002), (0.1, 0.05), (0.4, 0.3), (0.7, 1.0), (2.0, 0.5)]:
        step, pull_step = 1e-4, 1e-4
        by_pressure, by_load = pressure + step * NEAR, load + pull_step * NEAR
        length = ended.muscle.length - ended.contraction(pressure, load)
        volume = ended.volume(pressure, load)
        slope = RULE @ ended.potential(pressure, by_load) / pull_step
        assert -slope == pytest.approx(length, rel=1e-7)
        slope = RULE @ ended.potential(by_pressure, load) / step
        assert -slope == pytest.approx(volume, rel=1e-7)
        left = -(RULE @ ended.contraction(by_pressure, load)) / step
        right = RULE @ ended.volume(pressure, by_load) / pull_step
        assert left == pytest.approx(right, rel=1e-7)


def test_stiffness_is_the_slope_of_the_force():
    _, ended = pair("effector-45")
    for pressure, load in [(0.02, 0.002), (0.3, 0.2), (0.7, 1.0), (0.7, 3.4)]:
        contraction = float(ended.contraction(pressure, load))
        slope = RULE @ ended.force(pressure, contraction + 1e-3 * NEAR) / 1e-3
        assert -slope == pytest.approx(ended.stiffness(pressure, contraction), rel=1e-6)


def test_no_taper_where_the_muscle_is_not_shorter():
    plain, ended = pair()
    assert ended.contraction(0.0) == plain.contraction(0.0) == 0.0
    assert ended.contraction(0.03) == plain.contraction(0.03)
    assert ended.contraction(0.1, 0.4) == plain.contraction(0.1, 0.4) < 0.0
    # The ends begin where the muscle passes its free length, without a jump.
    loads = plain.force(0.7, np.array([-1e-5, 0.0, 1e-7, 1e-5, 1e-4]))
    cost = plain.contraction(0.7, loads) - ended.contraction(0.7, loads)
    assert cost[:2] == pytest.approx(0.0, abs=1e-15)
    assert np.all(np.diff(cost[1:]) > 0.0)
    assert cost[-1] < 1e-4


@settings(max_examples=60)
@given(muscles(), st.data())
def test_finite_or_refused(muscle, data):
    muscle = muscle.replace(end_length=0.0, dead_length=0.0)
    muscle = muscle.replace(length=min(1e4, 400.0 * muscle.braid_radius))
    pressure = data.draw(pressures(muscle))
    direction = data.draw(st.sampled_from(["", "inflating", "deflating"]))
    load = data.draw(SHARES) * float(EnergyMuscle(muscle).blocked_force(pressure))
    assume(load >= 0.0)
    try:
        ended = EnergyMuscle(muscle, ends="trellis")
        contraction = ended.contraction(pressure, load, direction=direction)
    except InputError as error:
        words = str(error)
        friction = muscle.friction_length > 0.0 and direction == "deflating"
        assert "muscle active length is" in words or (friction and "must be less" in words)
        return
    assert np.isfinite(contraction)
    force = ended.force(pressure, contraction, direction=direction)
    if direction == "":
        grain = 1e-12 * muscle.length * float(ended.stiffness(pressure, contraction))
        assert force == pytest.approx(load, abs=1e-9 * load + grain + 1e-300)
        assert grain > 0.0
    again = ended.contraction(pressure, max(float(force), 0.0), direction=direction)
    assert again == pytest.approx(contraction, abs=1e-9 * muscle.length)


def test_force_and_contraction_are_inverse_to_1e_10():
    _, ended = pair("effector-45", friction_length=0.02)
    pressure, load = np.meshgrid(np.linspace(0.0, 0.83, 12), np.linspace(0.0, 1.9, 10))
    for direction in ("", "inflating", "deflating"):
        contraction = ended.contraction(pressure, load, direction=direction)
        force = ended.force(pressure, contraction, direction=direction)
        assert np.abs(force - load).max() < 1e-10


def test_refusals():
    with pytest.raises(InputError, match="ends is 'cone': it must be one of"):
        EnergyMuscle(preset("thesis-45"), ends="cone")
    with pytest.raises(InputError, match="muscle active length is 3 mm: with trellis ends"):
        EnergyMuscle(preset("thesis-45", length=3.0, end_length=0.0), ends="trellis")
    _, ended = pair()
    free = float(ended.free_contraction(0.5))
    assert ended.force(0.5, free) == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InputError, match=r"contraction\[1\] is 11.5 mm: with trellis ends at a"):
        ended.force(0.5, [free, 11.5])
    with pytest.raises(InputError, match="must be at most the free contraction, or 0 mm"):
        ended.force(0.01, 0.5)
