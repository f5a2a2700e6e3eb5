"""`ThesisMuscle`: against its printed equations, and the numbers of the thesis's chapter 4."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import fsolve

from bozzini.errors import InputError
from bozzini.muscle import ThesisMuscle, preset
from tests.muscle.printed import solve_printed
from tests.muscle.strategies import SHARES, muscles

TABLE = np.array([0.6894, 0.5516, 0.4136])
# Pressure [MPa], load [N] and contraction [mm]: Tables 4.1 to 4.4, and 1.79 N from the text.
LOADED = np.array(
    [
        (0.6894, 1.69, 6.9),
        (0.6894, 1.51, 6.9),
        (0.6894, 1.79, 6.8),
        (0.6894, 1.40, 7.0),
        (0.6894, 1.46, 6.9),
        (0.6894, 1.43, 6.9),
        (0.5516, 1.57, 6.4),
        (0.5516, 1.37, 6.4),
        (0.4136, 1.32, 5.6),
        (0.4136, 1.13, 5.7),
        (0.4136, 1.17, 5.7),
    ]
)


def test_contractions_of_chapter_4():
    model = ThesisMuscle(preset("effector-45"))
    assert model.free_contraction(TABLE) == pytest.approx([7.6, 7.1, 6.2], abs=0.05)


def test_the_captions_tube_does_not_give_them():
    """So chapter 4 cannot have used it, in this reading."""
    model = ThesisMuscle(preset("thesis-45"))
    assert np.all(model.free_contraction(TABLE) > [10.0, 10.0, 9.0])


def test_dead_bands():
    found = [1e3 * ThesisMuscle(preset(name)).dead_band() for name in ("thesis-45", "effector-45")]
    assert found == pytest.approx([64.944, 99.225], rel=1e-3)
    # For an incompressible wall (2 E gap / 3 r_o) (r_o^2 - r_i^2) / r_i^2, nearly.
    for radius, pressure in zip((0.55, 0.75), found, strict=True):
        closed = 2.0 * 0.35 * 0.04 / (3.0 * radius) * (radius**2 - 0.0625) / 0.0625
        assert pressure == pytest.approx(1e3 * closed, rel=5e-3)


def test_loaded_rows_with_the_added_load_path():
    model = ThesisMuscle(preset("effector-45"), load_path="bulk")
    error = model.contraction(LOADED[:, 0], LOADED[:, 1]) - LOADED[:, 2]
    assert math.sqrt(np.mean(error**2)) <= 0.10
    assert model.free_contraction(TABLE) == pytest.approx(
        ThesisMuscle(preset("effector-45")).free_contraction(TABLE), abs=1e-12
    )


@pytest.mark.parametrize("name", ["thesis-40", "thesis-60", "effector-45"])
@pytest.mark.parametrize("pressure", [0.11, 0.4136, 0.827])
def test_against_the_printed_system(name, pressure):
    """Five unknowns at once by SciPy, with the errata: the kernel eliminates to one."""
    model = ThesisMuscle(preset(name))
    contact, contraction, residual = solve_printed(model.muscle, pressure, fsolve)
    assert residual < 1e-9
    assert model.dead_band() == pytest.approx(contact, rel=1e-8)
    assert model.free_contraction(pressure) == pytest.approx(contraction, abs=1e-6)


def test_gap_phase_is_the_tube_alone():
    model = ThesisMuscle(preset("effector-45"))
    pressure = np.array([0.0, 0.02, 0.09])
    state = model.solve(pressure)
    assert state.contraction == pytest.approx(-model.muscle.tube.deform(pressure).elongation)
    assert not state.in_contact.any()
    assert state.contraction[0] == 0.0


@given(muscles(), SHARES)
def test_contraction_is_continuous_at_contact(muscle, share):
    try:
        model = ThesisMuscle(muscle)
        edge = model.dead_band()
        if edge > 9.0:
            return
        ends = model.free_contraction([edge * (1.0 - 1e-9), edge * (1.0 + 1e-9) + 1e-300])
    except InputError:
        return
    assert ends[0] == pytest.approx(ends[1], abs=1e-5 * muscle.length)


@pytest.mark.parametrize("name", ["thesis-45", "effector-45"])
def test_angle_peaks_below_locking_and_is_refused_beyond(name):
    """The thesis's Fig. 3.17 approaches 54.7 degrees; the equations as printed turn round."""
    model = ThesisMuscle(preset(name))
    with pytest.raises(InputError, match=r"is 10 MPa: it must lie in \[0, [\d.]+\] MPa") as refused:
        model.braid_angle(10.0)
    limit = float(str(refused.value).partition("[0, ")[2].partition("]")[0])
    assert 2.0 < limit < 4.0
    pressure = np.linspace(model.dead_band(), 0.99 * limit, 400)
    angle = np.degrees(model.braid_angle(pressure))
    assert angle[-1] == pytest.approx(49.35 if name == "effector-45" else 53.5, abs=0.05)
    assert np.all(np.diff(angle) >= 0.0)
    # The slope is gone there: it is the peak, and not some other end.
    slope = np.diff(angle) / np.diff(pressure)
    assert slope[-1] < 1e-2 * slope.max()
    with pytest.raises(InputError, match="must lie in"):
        model.braid_angle(1.001 * limit)


def test_added_load_path_is_a_spring():
    model = ThesisMuscle(preset("effector-45"), load_path="bulk")
    assert model.load_stiffness == pytest.approx(2.03, abs=0.005)
    assert ThesisMuscle(preset("thesis-45")).load_stiffness == pytest.approx(0.98, abs=0.005)
    contraction = np.linspace(-5.0, 12.0, 7)
    force = model.force(0.5, contraction)
    assert np.diff(force) / np.diff(contraction) == pytest.approx(-model.stiffness(0.5, 0.0))
    assert model.stiffness([0.1, 0.7], 3.0) == pytest.approx([model.load_stiffness] * 2)
    held = force >= 0.0
    assert model.contraction(0.5, force[held]) == pytest.approx(contraction[held], abs=1e-10)
    assert model.blocked_force(0.5) == pytest.approx(
        model.free_contraction(0.5) * model.load_stiffness
    )


def test_a_taper_that_grows_with_the_load_stiffens():
    """Fig. 3.16 has it soften, to 0.63 N/mm: by (3.22) that needs a taper that shrinks."""
    specimen = preset("thesis-45")
    column = ThesisMuscle(specimen, load_path="bulk").load_stiffness

    def find_slope(scale):
        """Load per contraction lost with tapers phi (1 + F / scale) and the column."""
        loads = np.array([0.0, 0.01])
        ends = specimen.end_length * (1.0 + loads / scale)
        free = [ThesisMuscle(specimen.replace(end_length=e)).contraction(0.758) for e in ends]
        return 0.01 / (0.01 / column - float(free[1] - free[0]))

    assert find_slope(1e6) == pytest.approx(column, rel=1e-3)
    assert find_slope(20.0) > 1.05 * column and find_slope(5.0) > find_slope(20.0)
    assert find_slope(-2.16) == pytest.approx(0.63, abs=0.005)


@given(muscles(), st.floats(0.0, 10.0), SHARES)
def test_finite_or_refused(muscle, pressure, share):
    for load_path in ("none", "bulk"):
        try:
            model = ThesisMuscle(muscle, load_path=load_path)
            free = float(model.free_contraction(pressure))
            load = 0.0
            if load_path == "bulk":
                load = share * (free - model.contraction_limits[0]) * model.load_stiffness
            state = model.solve(pressure, load)
        except InputError as error:
            assert "must lie in" in str(error) or "no answer" in str(error) or "pulls" in str(error)
            continue
        for values in (state.contraction, state.braid_angle, state.contact_pressure):
            assert np.isfinite(values)
        assert state.contraction >= model.contraction_limits[0] - 1e-9 * muscle.length
        bore = math.pi * muscle.outer_radius**2
        assert abs(state.residual) <= 1e-8 * bore * (pressure + muscle.modulus)
