"""`EnergyMuscle` without ends: against quadrature and minimisation, its limits, and its numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from bozzini.muscle import LOCKING_ANGLE, EnergyMuscle, preset
from bozzini.muscle.design import PRESSURE_LIMIT
from bozzini.muscle.kernels import energy as kernels
from bozzini.muscle.models.energy import pack_design
from tests.muscle import reference
from tests.muscle.strategies import SHARES, muscles, pressures

TABLE = np.array([0.6894, 0.5516, 0.4136])


def build(outer_radius: float = 0.55, **changes: float) -> EnergyMuscle:
    return EnergyMuscle(preset("thesis-45", outer_radius=outer_radius, **changes))


def largest_load(model: EnergyMuscle, pressure: float, direction: str = "") -> float:
    return float(model.force(pressure, model.contraction_limits[0], direction=direction))


@given(muscles(), SHARES, st.floats(-0.9, 10.0))
def test_wall_energy_against_quadrature(muscle, share, swell):
    design = pack_design(muscle)
    stretch = 0.6 + 0.6 * share
    swell *= muscle.inner_radius**2
    expected = reference.wall_energy(muscle, stretch, swell)
    # The closed form is a small difference of large parts near rest: 1e-12 of those.
    parts = muscle.modulus * (muscle.outer_radius**2 - muscle.inner_radius**2)
    found = kernels.wall_energy(design, stretch, swell)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-13 * parts)


@pytest.mark.parametrize("mooney_ratio", [0.0, 0.4])
@pytest.mark.parametrize("outer_radius", [0.55, 0.75])
def test_force_is_the_slope_of_the_energy(outer_radius, mooney_ratio):
    """Through gap, contact and beyond the free contraction, by an independent minimisation."""
    model = build(outer_radius, mooney_ratio=mooney_ratio, dead_length=3.0)
    cases = [(0.0, -1.5), (0.0, 0.0), (0.02, -0.3), (0.03, -1.0), (0.045, -1.4), (0.2, 0.0)]
    cases += [(0.2, 4.0), (0.6894, -1.5), (0.6894, 7.0), (2.0, 10.0)]
    gap = 0
    for pressure, contraction in cases:
        expected = reference.pull(model.muscle, pressure, contraction)
        found = model.force(pressure, contraction)
        size = max(abs(expected), math.pi * outer_radius**2 * pressure, 0.01)
        assert found == pytest.approx(expected, abs=1e-6 * size), (pressure, contraction)
        if found >= 0.0:
            gap += not model.solve(pressure, found).in_contact
    assert gap >= 1


def test_force_is_the_slope_of_the_energy_across_contact():
    """On both sides of the kink, close to it."""
    model = build()
    pressure = 0.03
    stretch = brentq(
        lambda z: kernels.find_force(model.compiled.numbers[:11], pressure, z, 0.0)[2] - 1e-9,
        1.0,
        pack_design(model.muscle)[10],
    )
    for shift in (-0.3, -0.05, 0.05, 0.3):
        contraction = 45.0 * (1.0 - stretch) + shift
        expected = reference.pull(model.muscle, pressure, contraction)
        assert model.force(pressure, contraction) == pytest.approx(expected, abs=1e-7)


def test_contraction_against_a_plain_root():
    model = build(0.75, mooney_ratio=0.2)
    for pressure, load in [(0.02, 0.01), (0.1, 0.0), (0.4136, 1.32), (0.6894, 0.5)]:
        expected = brentq(
            lambda x, p=pressure, f=load: reference.pull(model.muscle, p, x) - f, -1.5, 12.0
        )
        assert model.contraction(pressure, load) == pytest.approx(expected, abs=2e-5)


@given(muscles(mooney_ratio=0.0, friction_length=0.0), st.floats(0.0, 1.0))
def test_vanishing_tube_is_gaylord(muscle, share):
    muscle = muscle.replace(modulus=1e-9, dead_length=0.0)
    model = EnergyMuscle(muscle)
    pressure = 1.0
    length = muscle.braid.locking_length * (1.0 - share) + muscle.length * share
    expected = muscle.braid.ideal_force(pressure, length)
    scale = float(muscle.braid.ideal_force(pressure, muscle.length)) + 1e-300
    found = model.force(pressure, muscle.length - length)
    assert found == pytest.approx(expected, abs=2e-7 * scale)
    free = EnergyMuscle(muscle).free_contraction(pressure)
    assert free == pytest.approx(muscle.braid.locking_contraction, rel=1e-4)


@given(muscles())
def test_locks_from_below(muscle):
    model = EnergyMuscle(muscle.replace(modulus=2e-7))
    angles = model.braid_angle([2e-4, 0.02, 0.2, 20.0])
    assert np.all(np.diff(angles) >= -1e-12)
    assert np.all(angles <= LOCKING_ANGLE + 1e-12)
    assert angles[-1] == pytest.approx(LOCKING_ANGLE, abs=1e-6)


def test_locks_from_below_in_degrees():
    # Worked out for 0.35 MPa at 5, 50 and 100 MPa: the angle is one of pressure over modulus.
    angles = np.degrees(build(modulus=0.07).braid_angle([1.0, 10.0, 20.0]))
    assert angles == pytest.approx([54.52, 54.714, 54.725], abs=5e-3)
    assert np.all(angles < 54.7356)


@given(muscles())
def test_zero_at_rest(muscle):
    model = EnergyMuscle(muscle)
    assert model.contraction(0.0) == pytest.approx(0.0, abs=1e-12 * muscle.length)
    assert model.force(0.0, 0.0) == pytest.approx(
        0.0, abs=1e-13 * muscle.modulus * muscle.outer_radius**2
    )


@given(muscles(), st.data())
def test_more_pressure_contracts_more_after_contact(muscle, data):
    model = EnergyMuscle(muscle)
    values = sorted(data.draw(st.lists(pressures(muscle), min_size=2, max_size=6)))
    state = model.solve(values)
    after = state.in_contact[:-1]
    assert np.all(np.diff(state.contraction)[after] >= -1e-11 * muscle.length)


@given(muscles(), st.data())
def test_more_load_contracts_less(muscle, data):
    model = EnergyMuscle(muscle)
    pressure = data.draw(pressures(muscle))
    for direction in ("", "inflating", "deflating"):
        most = largest_load(model, pressure, direction)
        least = max(0.0, float(model.force(pressure, model.contraction_limits[1])))
        loads = least + (most - least) * np.linspace(0.0, 0.999, 9)
        contraction = model.contraction(pressure, loads, direction=direction)
        assert np.all(np.diff(contraction) <= 1e-12 * muscle.length)
        stiffness = model.stiffness(pressure, contraction)
        if direction == "":
            assert np.all(stiffness > 0.0)


@given(muscles(), st.data())
def test_force_and_contraction_are_inverse(muscle, data):
    model = EnergyMuscle(muscle)
    pressure = data.draw(pressures(muscle))
    direction = data.draw(st.sampled_from(["", "inflating", "deflating"]))
    load = data.draw(SHARES) * 0.999 * largest_load(model, pressure, direction)
    contraction = model.contraction(pressure, load, direction=direction)
    again = model.contraction(
        pressure, model.force(pressure, contraction, direction=direction), direction=direction
    )
    assert again == pytest.approx(contraction, abs=1e-10 * muscle.length)
    state = model.solve(pressure, load, direction=direction)
    # A step of the last bit in the stretch is worth this much force.
    grain = 4e-15 * muscle.active_length * float(model.stiffness(pressure, contraction))
    assert state.residual == pytest.approx(0.0, abs=1e-11 * load + 100 * grain + 1e-300)
    assert bool(state.converged)


def test_force_and_contraction_are_inverse_to_1e_10():
    model = build(0.75)
    pressure, load = np.meshgrid(np.linspace(0.0, 0.83, 40), np.linspace(0.0, 1.9, 30))
    contraction = model.contraction(pressure, load)
    assert np.abs(model.force(pressure, contraction) - load).max() < 1e-10
    back = model.contraction(pressure, model.force(pressure, contraction))
    assert np.abs(back - contraction).max() < 1e-10


@given(muscles(friction_length=0.0), st.data())
def test_stiffness_is_the_slope_of_the_force(muscle, data):
    model = EnergyMuscle(muscle)
    pressure = data.draw(pressures(muscle))
    low, high = model.contraction_limits
    share = data.draw(st.floats(0.2, 0.9))
    contraction = low + share * (high - low)
    step = 1e-5 * (high - low)
    places = contraction + step * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    force = model.force(pressure, places)
    slope = (8.0 * (force[3] - force[1]) - (force[4] - force[0])) / (12.0 * step)
    stiffness = model.stiffness(pressure, places)
    if abs(stiffness[4] - stiffness[0]) < 1e-2 * abs(stiffness[2]):  # no kink in between
        assert -slope == pytest.approx(
            stiffness[2], rel=1e-4, abs=1e-9 * np.abs(force).max() / step
        )


@given(muscles(), st.data())
def test_friction_holds_against_the_motion(muscle, data):
    model = EnergyMuscle(muscle)
    pressure = data.draw(pressures(muscle))
    low, high = model.contraction_limits
    contraction = low + data.draw(SHARES) * (high - low)
    up = float(model.force(pressure, contraction, direction="inflating"))
    mean = float(model.force(pressure, contraction))
    down = float(model.force(pressure, contraction, direction="deflating"))
    assert up <= mean <= down
    near = 1e-9 * (abs(up) + abs(down)) + 1e-300
    assert 0.5 * (up + down) == pytest.approx(mean, abs=near)


def test_friction_is_the_work_at_the_crossings():
    """(8 pi / 3) a P_o r cot(angle), from the state and not the kernel's coefficient."""
    model = build(friction_length=0.05)
    state = model.solve(0.5, 0.7)
    radius = model.muscle.braid.radius_at(model.muscle.length - state.contraction)
    expected = 8.0 * math.pi / 3.0 * 0.05 * state.contact_pressure * radius
    expected /= np.tan(state.braid_angle)
    gap = model.force(0.5, state.contraction, direction="deflating") - 0.7
    assert gap == pytest.approx(expected, rel=1e-9)


@given(muscles())
def test_tube_meets_the_braid_at_the_dead_band(muscle):
    model = EnergyMuscle(muscle)
    edge = model.dead_band()
    if muscle.gap == 0.0:
        assert edge == 0.0
    elif 1e-9 * muscle.modulus < edge < 0.99 * PRESSURE_LIMIT:
        # Near a vanishing dead band the wall's stress cancels to about 1e-16 of its modulus.
        step = 1e-6 * edge + 1e-10 * muscle.modulus
        state = model.solve(np.array([max(edge - step, 0.0), edge + step]))
        assert state.in_contact.tolist() == [False, True]
        assert state.contraction[0] <= 1e-9 * muscle.length


def test_dead_bands_worked_out_elsewhere():
    assert [1e3 * build(r).dead_band() for r in (0.55, 0.75)] == pytest.approx(
        [35.3, 48.8], abs=0.05
    )
    # The muscle is longer there, and back at its free length a little later.
    for radius, back in ((0.55, 41.85), (0.75, 58.35)):
        model = build(radius)
        assert -0.45 < model.free_contraction(model.dead_band()) < -0.25
        found = brentq(lambda p, m=model: float(m.free_contraction(p)), 0.03, 0.1)
        assert 1e3 * found == pytest.approx(back, abs=0.05)


@pytest.mark.parametrize(
    ("outer_radius", "changes", "expected"),
    [
        (0.55, {}, [11.65, 11.34, 10.82]),
        (0.75, {}, [11.30, 10.88, 10.17]),
        (0.55, {"dead_length": 10.0}, [9.06, 8.82, 8.41]),
        (0.75, {"dead_length": 10.0}, [8.79, 8.46, 7.91]),
        (0.75, {"modulus": 0.56, "dead_length": 11.7}, [7.61, 7.09, 6.21]),
    ],
)
def test_numbers_worked_out_elsewhere(outer_radius, changes, expected):
    """To 0.01 mm; half of it is the rounding of the numbers."""
    found = build(outer_radius, **changes).free_contraction(TABLE)
    assert found == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("outer_radius", "changes", "expected"),
    [
        (0.55, {"modulus": 1.25}, [8.39, 7.28, 5.51]),
        (0.75, {"modulus": 0.91}, [8.50, 7.32, 5.43]),
        (0.55, {"dead_length": 17.1}, [7.21, 7.02, 6.70]),
        (0.75, {"dead_length": 15.9}, [7.31, 7.04, 6.58]),
        (0.55, {"modulus": 0.77, "dead_length": 11.2}, [7.61, 7.08, 6.21]),
    ],
)
def test_numbers_of_rounded_fits(outer_radius, changes, expected):
    """The same, where the parameters were rounded as well."""
    found = build(outer_radius, **changes).free_contraction(TABLE)
    assert found == pytest.approx(expected, abs=0.035)


def test_fitted_muscle_meets_the_thesis():
    found = EnergyMuscle(preset("fitted-45")).free_contraction(TABLE)
    assert found == pytest.approx([7.6, 7.1, 6.2], abs=0.02)
    assert build(0.75).contraction(0.6894, 1.69) == pytest.approx(5.00, abs=0.01)
    # The weight that keeps the thesis's muscle straight stretches it.
    assert build(0.55).contraction(0.0, 0.05) == pytest.approx(-2.2, abs=0.05)
    assert build(0.75).contraction(0.0, 0.05) == pytest.approx(-1.6, abs=0.05)


@settings(max_examples=20)
@given(muscles(friction_length=0.0), st.data())
def test_maxwells_relation(muscle, data):
    """dl/dP under a load is dV/dF at a pressure; l and V are slopes of the potential."""
    muscle = muscle.replace(modulus=min(muscle.modulus, 1.0))  # below 100 MPa
    model = EnergyMuscle(muscle.replace(length=1.0, dead_length=0.0, end_length=0.0))
    pressure = 10.0 * model.dead_band() + muscle.modulus * data.draw(st.floats(0.01, 3.0))
    pressure = min(pressure, 90.0)
    load = 0.2 * float(model.blocked_force(pressure))
    near = np.array([-2.0, -1.0, 1.0, 2.0])
    rule = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0
    high, pull_step = 3e-3 * pressure, 3e-3 * load
    by_pressure, by_load = pressure + high * near, load + pull_step * near
    length = 1.0 - model.contraction(by_pressure, load)
    volume = model.volume(pressure, by_load)
    left, right = rule @ length / high, rule @ volume / pull_step
    assert left == pytest.approx(right, rel=1e-4)
    potential = model.potential(by_pressure, load)
    noise = 1e-13 * np.abs(potential).max()
    assert -(rule @ potential) / high == pytest.approx(
        model.volume(pressure, load), rel=1e-5, abs=noise / high
    )
    potential = model.potential(pressure, by_load)
    assert -(rule @ potential) / pull_step == pytest.approx(
        1.0 - model.contraction(pressure, load), rel=1e-5, abs=noise / pull_step
    )
