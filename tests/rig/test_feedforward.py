"""Model-based feed-forward against the board's own controller, on the same plants."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bozzini.errors import InputError
from bozzini.rig import (
    Cosimulation,
    EmulatedBoard,
    Feedforward,
    Host,
    LockstepLink,
    NativeBoard,
    Plant,
    PlantDesign,
)
from bozzini.rig.demo import judge_step
from bozzini.rig.firmware import find_sources
from bozzini.rig.protocol import SetPoint
from tests.rig.loops import CHAMBER

pytestmark = pytest.mark.usefixtures("toolchain")

TRUE = PlantDesign()
WIDE, NARROW = (
    {name: share * getattr(TRUE, name) for name in ("fill_area", "bleed_area")}
    for share in (1.2, 0.8)
)
CHAMBERS = [CHAMBER] * 3
STEPS = ((0.6, 0.3, 0.1), (0.1, 0.6, 0.827))
STEP_TIME = 0.5
WRONG = {
    "wide orifices": replace(TRUE, **WIDE),
    "narrow orifices": replace(TRUE, **NARROW),
    "small line": replace(TRUE, tube_length=390.0),
    "large line": replace(TRUE, tube_length=610.0),
    "small dead zone": replace(TRUE, valve_dead_zone=0.27),
    "large dead zone": replace(TRUE, valve_dead_zone=0.33),
    "all faster": replace(TRUE, **WIDE, tube_length=390.0, valve_dead_zone=0.27),
    "all slower": replace(TRUE, **NARROW, tube_length=610.0, valve_dead_zone=0.33),
}


@cache
def run_steps(kind, *, design=TRUE, model=TRUE, rate=None, period=0.002, seed=0):
    """Return settle time [s], overshoot (300 kPa and more) and steady error [MPa]: (3, steps, 3).

    Without a model the board controls alone.
    """
    with kind() as board:
        link = LockstepLink(Cosimulation(board, Plant(CHAMBERS, design, seed=seed)))
        host = Host(link, period=period)
        known = host.connect()
        forward = model and Feedforward(model, CHAMBERS, known, period=period, rate=rate)

        def control(time, telemetry):
            wanted = STEPS[min(int(time / STEP_TIME + 1e-9), len(STEPS) - 1)]
            return (
                forward.shape(time, wanted, board=telemetry) if forward else SetPoint(wanted)
            ), {}

        run = host.run(control, STEP_TIME * len(STEPS))
    assert run.converged, run.reason
    time, pressures = link.list_pressures()
    parts = np.split(pressures[time > run.link_start + 1e-9], [round(1e3 * STEP_TIME)])
    found = np.array([judge_step(p, np.array(w), 1e-3) for p, w in zip(parts, STEPS, strict=True)])
    found[:, 1] *= np.array(STEPS) >= 0.3
    return np.moveaxis(found, 1, 0)


def find_fastest():
    """Return the times of the steps with a valve that is fully open all the way [s]."""
    times, before = np.empty((len(STEPS), 3)), (0.0, 0.0, 0.0)
    for i, wanted in enumerate(STEPS):
        for k in range(3):
            plant = Plant(CHAMBERS)
            plant.set_pressures(before[k])
            duty = np.zeros(6)
            duty[0 if wanted[k] > before[k] else 3] = 1.0
            while abs(plant.pressures[0] - wanted[k]) > 0.02 * wanted[k] + 0.004:
                plant.step(duty, 1e-4)
            times[i, k] = plant.time
        before = wanted
    return times


@pytest.mark.parametrize("kind", [NativeBoard, pytest.param(EmulatedBoard, marks=pytest.mark.slow)])
def test_feedforward_halves_the_settle_time(kind):
    alone, _, _ = run_steps(kind, model=None)
    settle, over, steady = run_steps(kind)
    assert np.median(settle) < 0.5 * np.median(alone)
    assert settle.max() < 0.5 * alone.max()
    assert over.max() < 0.01
    assert steady.max() < 0.006


def test_no_step_is_faster_than_an_open_valve_and_few_are_much_slower():
    settle, _, _ = run_steps(NativeBoard)
    fastest = find_fastest()
    assert np.all(settle > fastest - 2e-3)
    assert np.median(settle - fastest) < 0.025


def test_rate_is_the_callers():
    """At the slew rate of the board alone neither is faster."""
    alone, _, _ = run_steps(NativeBoard, model=None)
    limited, _, _ = run_steps(NativeBoard, rate=3.0)
    assert np.median(limited) == pytest.approx(np.median(alone), rel=0.15)
    assert limited.max() > 0.9 * (0.827 - 0.1 - 0.021) / 3.0


@pytest.mark.parametrize("name", ["all faster", "all slower"])
def test_wrong_model_neither_overshoots_nor_hunts(name):
    _, over, steady = run_steps(NativeBoard, design=WRONG[name], period=0.01)
    assert over.max() < 0.025
    assert steady.max() < 0.006


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.002, 0.01])
@pytest.mark.parametrize("name", WRONG)
def test_wrong_models_on_the_emulated_board(name, period):
    alone, _, _ = run_steps(EmulatedBoard, design=WRONG[name], model=None)
    settle, over, steady = run_steps(EmulatedBoard, design=WRONG[name], period=period)
    assert np.median(settle) < 0.75 * np.median(alone)
    assert over.max() < 0.025
    assert steady.max() < 0.006


@pytest.mark.slow
def test_steps_of_twelve_seeds_on_the_emulated_board():
    runs = [[run_steps(EmulatedBoard, model=m, seed=s) for s in range(12)] for m in (None, TRUE)]
    for settle, over, steady in map(lambda found: np.moveaxis(found, 1, 0), runs):
        assert settle.max() < 0.45
        assert over.max() < 0.025
        assert steady.max() < 0.006
    alone, forward = (np.array(found)[:, 0] for found in runs)
    assert np.median(forward) < 0.5 * np.median(alone)


def test_host_that_never_shuts_the_valves_is_held_near_the_largest_set_point():
    """The board takes no feed-forward to fill above it, whatever the slew limits are."""
    with NativeBoard() as board:
        link = LockstepLink(Cosimulation(board, Plant(CHAMBERS)))
        host = Host(link, period=0.002)
        known = host.connect()
        command = SetPoint((0.827,) * 3, (1.0,) * 3)
        run = host.run(lambda time, telemetry: (command, {}), 0.3)
    assert run.converged
    assert 0.827 < link.list_pressures()[1].max() < known.overpressure


def test_board_and_feedforward_do_without_the_sensor_of_the_reservoir():
    class Blind(Plant):
        def sensor_voltages(self):
            voltages = super().sensor_voltages()
            voltages[3] = 0.0
            return voltages

    with NativeBoard() as board:
        link = LockstepLink(Cosimulation(board, Blind(CHAMBERS)))
        host = Host(link, period=0.002)
        forward = Feedforward(TRUE, CHAMBERS, host.connect(), period=0.002)
        run = host.run(lambda time, board: (forward.shape(time, STEPS[0], board=board), {}), 0.3)
    assert run.converged
    settle, over, _ = judge_step(link.list_pressures()[1][-300:], np.array(STEPS[0]), 1e-3)
    assert settle.max() < 0.12
    assert over.max() < 0.015


def test_slew_limits_are_reported():
    with NativeBoard() as board:
        known = Host(LockstepLink(Cosimulation(board, Plant(CHAMBERS)))).connect()
    text = (Path(find_sources()) / "src" / "config.h").read_text(encoding="utf-8")
    limits = {
        words[1]: float(words[2])
        for words in map(str.split, text.splitlines())
        if words[:1] == ["#define"] and words[1].startswith("BZ_SLEW")
    }
    assert limits == {
        "BZ_SLEW": pytest.approx(10.0 * known.slew_rate),
        "BZ_SLEW_SHAPED": pytest.approx(10.0 * known.shaped_slew_rate),
    }


def test_illegal_options_are_refused():
    with NativeBoard() as board:
        known = Host(LockstepLink(Cosimulation(board, Plant(CHAMBERS)))).connect()
    with pytest.raises(InputError, match="rate is 11 MPa/s"):
        Feedforward(TRUE, CHAMBERS, known, period=0.002, rate=11.0)
    with pytest.raises(InputError, match="period is 0 s"):
        Feedforward(TRUE, CHAMBERS, known, period=0.0)
    with pytest.raises(InputError, match="2 chambers: there must be 3"):
        Feedforward(TRUE, CHAMBERS[:2], known, period=0.002)
    with pytest.raises(InputError, match=r"wanted has shape \(2,\)"):
        Feedforward(TRUE, CHAMBERS, known, period=0.002).shape(0.0, (0.1, 0.2), board=None)
