"""The linear tube: its boundary conditions, against the differential equations, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.muscle import Tube

tubes = st.builds(
    lambda outer, share, **rest: Tube(outer_radius=outer, inner_radius=share * outer, **rest),
    outer=st.floats(0.1, 50.0),
    share=st.floats(0.05, 0.95),
    length=st.floats(1.0, 100.0),
    modulus=st.floats(0.01, 100.0),
    poisson_ratio=st.floats(0.0, 0.4999),
)
pressures = st.floats(-2.0, 2.0, allow_subnormal=False).map(lambda p: round(p, 9))


@given(tubes, pressures, pressures, pressures)
def test_stresses_meet_the_boundary(tube, inner, outer, end):
    """The condition on the outside is what the thesis's (3.3), with +P_o in c1, fails."""
    state = tube.deform(inner, outer_pressure=outer, end_stress=end)
    radii = np.linspace(tube.inner_radius, tube.outer_radius, 5)
    radial, hoop, axial = state.stresses(radii)
    size = abs(inner) + abs(outer) + abs(end)
    near = (
        1e-11
        * size
        / (1.0 - 2.0 * tube.poisson_ratio)
        / (1.0 - tube.inner_radius / tube.outer_radius)
        + 1e-300
    )
    assert radial[0] == pytest.approx(-inner, abs=near)
    assert radial[-1] == pytest.approx(-outer, abs=near)
    assert axial == pytest.approx(np.full(5, end), abs=near)
    # Lame: the sum of radial and hoop stress is the same everywhere.
    assert radial + hoop == pytest.approx(np.full(5, radial[0] + hoop[0]), abs=20 * near)


@given(tubes, pressures, pressures)
def test_stresses_are_in_balance(tube, inner, outer):
    """d(s_rr)/dr + (s_rr - s_tt)/r = 0, by central differences."""
    state = tube.deform(inner, outer_pressure=outer)
    middle = 0.5 * (tube.inner_radius + tube.outer_radius)
    step = 1e-4 * middle
    slope = (state.stresses(middle + step)[0] - state.stresses(middle - step)[0]) / (2.0 * step)
    radial, hoop, _ = state.stresses(middle)
    size = (abs(inner) + abs(outer) + 1e-9) / (1.0 - 2.0 * tube.poisson_ratio)
    assert slope * middle + radial - hoop == pytest.approx(0.0, abs=1e-6 * size)


@given(tubes, pressures)
def test_pressure_from_all_sides_shrinks_by_the_bulk_modulus(tube, pressure):
    state = tube.deform(pressure, outer_pressure=pressure, end_stress=-pressure)
    strain = -pressure * (1.0 - 2.0 * tube.poisson_ratio) / tube.modulus
    near = 1e-12 * abs(pressure) / tube.modulus + 1e-300
    assert state.c1 == pytest.approx(strain, abs=near)
    assert state.c3 == pytest.approx(strain, abs=near)
    assert state.c2 == pytest.approx(0.0, abs=near * tube.outer_radius**2)
    assert state.elongation == pytest.approx(strain * tube.length, abs=near * tube.length)


@given(tubes, pressures)
def test_pull_alone_is_youngs_modulus(tube, stress):
    state = tube.deform(0.0, end_stress=stress)
    near = 1e-11 * abs(stress) / tube.modulus + 1e-300
    assert state.c3 == pytest.approx(stress / tube.modulus, abs=near)
    assert state.radial_displacement(tube.outer_radius) == pytest.approx(
        -tube.poisson_ratio * stress / tube.modulus * tube.outer_radius,
        abs=near * tube.outer_radius,
    )


@given(tubes, st.floats(0.01, 1.0))
def test_closed_tube_in_youngs_modulus_and_poissons_ratio(tube, pressure):
    state = tube.deform(pressure)
    scale = pressure * tube.bore_share / tube.modulus
    assert state.c3 == pytest.approx(scale * (1.0 - 2.0 * tube.poisson_ratio), abs=1e-10 * scale)
    assert state.radial_displacement(tube.outer_radius) == pytest.approx(
        scale * (2.0 - tube.poisson_ratio) * tube.outer_radius, rel=1e-9
    )


def test_thin_tube_is_a_boiler():
    tube = Tube(length=1.0, inner_radius=0.999, outer_radius=1.0, modulus=1.0, poisson_ratio=0.3)
    _, hoop, axial = tube.deform(1e-3).stresses(0.9995)
    assert hoop == pytest.approx(1.0, rel=2e-3)
    assert axial == pytest.approx(0.5, rel=2e-3)


def test_deform_takes_arrays():
    tube = Tube(length=45.0, inner_radius=0.25, outer_radius=0.55, modulus=0.35)
    state = tube.deform(np.linspace(0.0, 0.1, 4), outer_pressure=np.zeros((3, 1)))
    assert state.c1.shape == (3, 4)
    assert state.elongation.shape == (3, 4)
    assert tube.wall_area == pytest.approx(math.pi * 0.24)
