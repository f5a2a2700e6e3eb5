"""Orifice flow and its closed forms: against an integrator, data-sheet units, limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bozzini.errors import InputError
from bozzini.rig.pneumatics import (
    AREA_PER_CONDUCTANCE,
    ATMOSPHERE,
    GAS_CONSTANT,
    HEAT_RATIO,
    NOZZLE_SPEED,
    REFERENCE_DENSITY,
    TEMPERATURE,
    Orifice,
)

RATIOS = (0.1, 0.3, 0.49999, 0.5, 0.528, 0.8)
SUPPLY = 0.827
VOLUME = 150.0


def integrate(orifice, duration, *, filling, exponent=1.0):
    def rate(_, state):
        ends = (SUPPLY, state[0]) if filling else (state[0], 0.0)
        flow = float(orifice.flow(*ends))
        return [exponent * (flow if filling else -flow) / VOLUME]

    start = 0.0 if filling else SUPPLY
    steps = {"rtol": 1e-12, "atol": 1e-13, "max_step": duration / 60}
    return solve_ivp(rate, (0.0, duration), [start], **steps).y[0, -1]


@pytest.mark.parametrize("critical", RATIOS)
@pytest.mark.parametrize("end", [0.3, 0.78, 0.826])
def test_filling_and_venting_take_as_long_as_an_integrator_says(critical, end) -> None:
    orifice = Orifice(area=0.03, critical_ratio=critical)
    filled = float(orifice.fill_time(VOLUME, SUPPLY, end=end, exponent=HEAT_RATIO))
    assert integrate(orifice, filled, filling=True, exponent=HEAT_RATIO) == pytest.approx(
        end, rel=1e-8
    )
    left = SUPPLY - end + 2e-4
    vented = float(orifice.vent_time(VOLUME, SUPPLY, end=left))
    assert integrate(orifice, vented, filling=False) == pytest.approx(left, rel=1e-8)


def test_times_add_up_and_scale() -> None:
    orifice = Orifice(area=0.03)
    whole = orifice.fill_time(VOLUME, SUPPLY, end=0.8)
    parts = orifice.fill_time(VOLUME, SUPPLY, end=0.4) + orifice.fill_time(
        VOLUME, SUPPLY, end=0.8, start=0.4
    )
    assert whole == pytest.approx(parts, rel=1e-12)
    assert orifice.vent_time(VOLUME, SUPPLY, end=0.01) == pytest.approx(
        orifice.vent_time(VOLUME, SUPPLY, end=0.3) + orifice.vent_time(VOLUME, 0.3, end=0.01),
        rel=1e-12,
    )
    double = Orifice(area=0.06)
    assert double.fill_time(2 * VOLUME, SUPPLY, end=0.8) == pytest.approx(whole, rel=1e-12)


def test_choked_limits_are_a_line_and_an_exponential() -> None:
    orifice = Orifice(area=0.03)
    tau = orifice.time_constant(VOLUME)
    assert tau == pytest.approx(VOLUME / (0.03 * NOZZLE_SPEED))
    assert orifice.fill_time(VOLUME, SUPPLY, end=0.2) == pytest.approx(
        tau * 0.2 / (SUPPLY + ATMOSPHERE), rel=1e-12
    )
    assert orifice.vent_time(VOLUME, SUPPLY, end=0.2) == pytest.approx(
        tau * math.log((SUPPLY + ATMOSPHERE) / (0.2 + ATMOSPHERE)), rel=1e-12
    )


def test_closed_forms_of_the_vent_agree_across_half() -> None:
    times = [
        float(Orifice(area=0.03, critical_ratio=b).vent_time(VOLUME, SUPPLY, end=0.02))
        for b in (0.5 - 1e-9, 0.5, 0.5 + 1e-9)
    ]
    assert times == pytest.approx([times[1]] * 3, rel=1e-7)


def test_conductance_is_flow_of_reference_air_per_upstream_pressure() -> None:
    orifice = Orifice.from_conductance(2.0, 0.3)
    assert orifice.conductance == pytest.approx(2.0, rel=1e-12)
    # Choked at 7 bar absolute: 14 dm^3/s of reference air, 14e-3 times its density in kg/s.
    mass = 14e-3 * REFERENCE_DENSITY
    flow = float(orifice.flow(0.7 - ATMOSPHERE, 0.0))
    assert flow * 1e-3 == pytest.approx(mass * GAS_CONSTANT * TEMPERATURE, rel=1e-9)
    assert 1.0 / AREA_PER_CONDUCTANCE == pytest.approx(0.1992, abs=1e-4)


def test_ellipse_is_close_to_the_isentropic_nozzle() -> None:
    ratios = np.linspace(0.0, 0.99, 400)
    g = HEAT_RATIO
    highest = math.sqrt(g) * (2 / (g + 1)) ** ((g + 1) / (2 * (g - 1)))
    within = np.maximum(ratios, (2 / (g + 1)) ** (g / (g - 1)))
    nozzle = np.sqrt(2 * g / (g - 1) * (within ** (2 / g) - within ** ((g + 1) / g))) / highest
    found = Orifice(area=1.0, critical_ratio=0.528).find_share(ratios)
    assert np.abs(found - nozzle).max() < 0.0018


def test_flow_is_odd_monotone_and_continuous() -> None:
    orifice = Orifice(area=0.03, critical_ratio=0.3)
    over = np.linspace(-0.1, 1.0, 2001)
    flow = orifice.flow(0.5, over)
    assert np.all(np.diff(flow) <= 0.0)
    assert np.abs(np.diff(flow)).max() < 0.02 * flow.max()
    assert flow == pytest.approx(-orifice.flow(over, 0.5))
    assert float(orifice.flow(0.4, 0.4)) == 0.0


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda o: Orifice(area=0.0), "orifice area"),
        (lambda o: Orifice(area=1.0, critical_ratio=1.0), "orifice critical ratio"),
        (lambda o: Orifice.from_conductance(-1.0), "conductance is -1"),
        (lambda o: o.flow(200.0, 0.0), "upstream is 200"),
        (lambda o: o.fill_time(0.0, 0.8, end=0.1), "volume is 0"),
        (lambda o: o.fill_time(1.0, 0.8, end=0.8), "end is 0.8"),
        (lambda o: o.fill_time(1.0, 0.8, end=0.1, start=0.2), "end is"),
        (lambda o: o.vent_time(1.0, 0.8, end=0.0), "end is 0"),
        (lambda o: o.vent_time(1.0, 0.8, end=0.9), "end is"),
    ],
)
def test_wrong_input_is_one_line(call, words) -> None:
    with pytest.raises(InputError, match=words) as caught:
        call(Orifice(area=0.03))
    assert "\n" not in str(caught.value)
