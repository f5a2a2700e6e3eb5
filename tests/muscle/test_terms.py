"""Creep and temperature: factors of the contraction, and their fits on made records."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.muscle import (
    Creep,
    EnergyMuscle,
    Measurements,
    ScaledMuscle,
    Thermal,
    calibrate,
    fit_creep,
    fit_thermal,
    preset,
)

MODEL = EnergyMuscle(preset("effector-45"))
CREEP = Creep(share=0.06, time_constant=40.0)
HEAT = Thermal(slope=-0.004)


def test_limits_of_creep():
    assert CREEP.factor([0.0, 1e9]) == pytest.approx([1.0, 1.06])
    assert CREEP.factor(40.0) == pytest.approx(1.0 + 0.06 * (1.0 - np.exp(-1.0)))
    # Its rate falls by 1/e in each time constant.
    step = np.diff(CREEP.factor([0.0, 40.0, 80.0]))
    assert step[1] / step[0] == pytest.approx(np.exp(-1.0))


def test_a_scaled_model_is_a_model():
    scaled = ScaledMuscle(MODEL, float(CREEP.factor(30.0) * HEAT.factor(37.0)))
    pressure, load = np.array([0.3, 0.6])[:, None], np.array([0.0, 0.5, 1.0])
    found = scaled.contraction(pressure, load)
    assert found == pytest.approx(scaled.factor * MODEL.contraction(pressure, load))
    assert scaled.force(pressure, found) == pytest.approx(
        np.broadcast_to(load, found.shape), abs=1e-9
    )
    slope = -(scaled.force(0.5, 4.0 + 1e-4) - scaled.force(0.5, 4.0 - 1e-4)) / 2e-4
    assert scaled.stiffness(0.5, 4.0) == pytest.approx(slope, rel=1e-5)
    assert ScaledMuscle(MODEL, 1.0).contraction(0.5, 1.0) == MODEL.contraction(0.5, 1.0)
    assert scaled.solve(0.5, 0.5).converged


def test_a_factor_is_fitted_as_any_number():
    truth = ScaledMuscle(MODEL, 1.08)
    pressure = np.linspace(0.1, 0.8, 12)
    data = Measurements(pressure=pressure, contraction=truth.contraction(pressure))
    fixed = calibrate(
        lambda muscle: ScaledMuscle(EnergyMuscle(muscle), 1.08),
        preset("effector-45", modulus=0.5),
        data=data,
        free=("modulus",),
    )
    assert fixed.estimates["modulus"] == pytest.approx(0.35, rel=1e-4)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_creep_is_found_again(noise):
    time = np.linspace(0.0, 200.0, 60)
    rows = 8.0 * CREEP.factor(time) + noise * np.random.default_rng(1).normal(size=60)
    found = fit_creep(time, rows)
    assert found.converged and not found.reason
    wanted = {"contraction": 8.0, "share": 0.06, "time_constant": 40.0}
    got = {"contraction": found.contraction, "share": found.term.share}
    got["time_constant"] = found.term.time_constant
    for name, value in wanted.items():
        assert abs(got[name] - value) <= 3.0 * found.standard_errors[name] + 1e-5 * value
    assert found.residual == pytest.approx(noise, rel=0.2, abs=1e-6)
    # On the record that follows.
    later = np.linspace(200.0, 400.0, 9)
    predicted = found.contraction * found.term.factor(later)
    assert predicted == pytest.approx(8.0 * CREEP.factor(later), abs=0.02)


def test_a_record_too_short_has_not_converged():
    time = np.linspace(0.0, 4.0, 30)
    found = fit_creep(time, 8.0 * CREEP.factor(time))
    assert not found.converged
    assert "shorter than the time constant found" in found.reason


def test_temperature_is_found_again():
    warm = np.linspace(5.0, 45.0, 9)
    found = fit_thermal(warm, 8.0 * HEAT.factor(warm))
    assert found.term.slope == pytest.approx(-0.004, rel=1e-9)
    assert found.contraction == pytest.approx(8.0)
    # Another reference is the same line.
    other = fit_thermal(warm, 8.0 * HEAT.factor(warm), reference=37.0)
    assert other.contraction * other.term.factor(warm) == pytest.approx(8.0 * HEAT.factor(warm))
    assert set(found.to_dict()) >= {"contraction_mm", "residual_mm", "converged", "term"}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Creep(share=0.1, time_constant=0.0), "creep time constant is 0 s"),
        (lambda: CREEP.factor(-1.0), "time is -1 s: it must lie in [0, inf] s"),
        (lambda: Thermal(slope=2.0), "thermal slope is 2"),
        (lambda: HEAT.factor(500.0), "temperature is 500 degC: the factor"),
        (lambda: ScaledMuscle(MODEL, 0.0), "contraction factor is 0"),
        (lambda: ScaledMuscle(3, 1.0), "model is 3: it must be a MuscleModel"),
        (lambda: fit_creep([0.0, 1.0], [1.0, 2.0]), "time has shape (2,)"),
        (lambda: fit_creep(np.ones(5), np.ones(5)), "time is 1 in all rows: they must differ"),
        (lambda: fit_creep(np.arange(5.0), -np.ones(5)), "it must be above 0"),
        (lambda: fit_thermal(np.arange(5.0), [1, 2, np.nan, 4, 5]), "contraction[2] is nan mm"),
    ],
)
def test_refused(call, message):
    with pytest.raises(InputError) as error:
        call()
    assert message in str(error.value) and "\n" not in str(error.value)
