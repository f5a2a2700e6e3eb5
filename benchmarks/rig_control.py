"""Measure the control of the rig: steps, wrong models, runaway hosts and circles of the stick.

    python benchmarks/rig_control.py                    the emulated chip, 12 seeds (minutes)
    python benchmarks/rig_control.py --board native     the same code compiled for this computer
    python benchmarks/rig_control.py --seeds 2 steps    less of it
    python benchmarks/rig_control.py --keep             for the page of the documentation

Each controller gets the same plants with the same seeds. The tables are in Markdown; those kept are
in ``rig_control.json``, from which ``make docs`` takes them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from time import thread_time

import numpy as np

from bozzini.effector import Effector, EffectorMotion, effector_preset
from bozzini.muscle.hysteresis import MaxwellSlip
from bozzini.rig import (
    BoardStick,
    Chamber,
    Cosimulation,
    EmulatedBoard,
    Feedforward,
    Host,
    HysteresisCompensator,
    HystereticPlant,
    LockstepLink,
    NativeBoard,
    Plant,
    PlantDesign,
    ScriptedStick,
    Steering,
    make_controller,
)
from bozzini.rig.demo import VOLTS_PER_COUNT, judge_step
from bozzini.rig.firmware import find_sources
from bozzini.rig.protocol import SetPoint

KEPT = Path(__file__).with_suffix(".json")
TABLES = {}
"""What was measured: rows of cells by the name of their table, its head first."""

PARTS = ("steps", "plants", "slews", "stick", "controllers")
BOARDS = {"native": NativeBoard, "emulated": EmulatedBoard}
STEPS = ((0.6, 0.3, 0.1), (0.1, 0.6, 0.827))  # [MPa], one second each
FAST, SLOW = 0.002, 0.01  # periods of the host [s]
TRUE = PlantDesign()
WIDE, NARROW = (
    {name: share * getattr(TRUE, name) for name in ("fill_area", "bleed_area")}
    for share in (1.2, 0.8)
)
PLANTS = {
    "as modelled": TRUE,
    "orifices +20 %": replace(TRUE, **WIDE),
    "orifices -20 %": replace(TRUE, **NARROW),
    "line +20 %": replace(TRUE, dead_volume=TRUE.dead_volume + 86.0),
    "line -20 %": replace(TRUE, tube_length=390.0),
    "dead zone +3 points": replace(TRUE, valve_dead_zone=0.33),
    "dead zone -3 points": replace(TRUE, valve_dead_zone=0.27),
    "valve lag 6 ms": replace(TRUE, valve_lag=6e-3),
    "all that make it faster": replace(TRUE, **WIDE, tube_length=390.0, valve_dead_zone=0.27),
    "all that make it slower": replace(TRUE, **NARROW, dead_volume=123.0, valve_dead_zone=0.33),
}
FRICTION = MaxwellSlip((0.3, 0.2, 0.2), (0.01, 0.01, 0.01)).to_plays()  # [MPa]: loops of 60 kPa
RUBBING = EffectorMotion(play_radii=FRICTION.thresholds[1:], play_weights=FRICTION.weights[1:])
NAMES = {"static": "board alone", "feedforward": "feed-forward", "predictive": "predictive"}
EFFECTOR = Effector(effector_preset("prototype"))
CHAMBERS = [Chamber.from_model(model) for model in EFFECTOR.models]


def begin(name, *head):
    """Begin a table and print its head."""
    TABLES[name] = [list(head)]
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|", flush=True)


def add(name, *cells):
    """Add a row to a table and print it."""
    TABLES[name].append(list(cells))
    print("| " + " | ".join(cells) + " |", flush=True)


def connect(board, plant, period):
    """Return the host of a rig in lock-step, the link, and the board's configuration."""
    link = LockstepLink(Cosimulation(board, plant))
    host = Host(link, period=period)
    return host, link, host.connect()


def judge_steps(board, design, period, model, seed):
    """Return settle time, overshoot (of 300 kPa and more) and steady error: [ms], [kPa]."""
    host, link, configuration = connect(board, Plant(CHAMBERS, design, seed=seed), period)
    forward = model and Feedforward(model, CHAMBERS, configuration, period=period)

    def control(time, telemetry):
        wanted = STEPS[min(int(time + 1e-9), len(STEPS) - 1)]
        return (forward.shape(time, wanted, board=telemetry) if forward else SetPoint(wanted)), {}

    run = host.run(control, float(len(STEPS)))
    if not run.converged:
        return np.full((3, 3 * len(STEPS)), np.nan)
    time, pressures = link.list_pressures()
    time = time - run.link_start
    rows = []
    for k, wanted in enumerate(np.array(STEPS)):
        part = pressures[np.searchsorted(time, k) : np.searchsorted(time, k + 1.0)]
        settle, over, steady = 1e3 * judge_step(part, wanted, 1e-3)
        rows.append([settle, np.where(wanted >= 0.3, over, 0.0), steady])
    return np.moveaxis(rows, 1, 0).reshape(3, -1)


def add_steps(table, name, make, design, period, model, seeds):
    """Add a row of figures over the seeds."""
    found = []
    for seed in range(seeds):
        with make() as board:
            found.append(judge_steps(board, design, period, model, seed))
    settle, over, steady = np.moveaxis(found, 1, 0)
    if np.isnan(settle).any():
        add(table, name, "trips", *[""] * 4)
        return
    figures = f"{over.max():.1f}", f"{np.median(steady):.1f}", f"{steady.max():.1f}"
    add(table, name, f"{np.median(settle):.0f}", f"{settle.max():.0f}", *figures)


def begin_steps(table, first):
    """Begin a table of `add_steps`."""
    figures = "overshoot [kPa]", "steady median", "largest"
    begin(table, first, "settle median [ms]", "largest", *figures)


def compare_steps(make, seeds):
    """Both controllers on the plant that the feed-forward has as its model."""
    begin_steps("steps", "steps")
    for period in (FAST, SLOW):
        words = f", host {1e3 * period:g} ms"
        add_steps("steps", "board alone" + words, make, TRUE, period, None, seeds)
        add_steps("steps", "with feed-forward" + words, make, TRUE, period, TRUE, seeds)
    bound = find_bound()
    times = f"{np.median(bound):.0f}", f"{bound.max():.0f}"
    add("steps", "valves fully open until there", *times, *[""] * 3)


def find_bound():
    """Return the times in which valves that are open until then bring the pressures there [ms]."""
    times, before = [], (0.0, 0.0, 0.0)
    for wanted in STEPS:
        for k in range(3):
            plant = Plant(CHAMBERS)
            plant.set_pressures(before[k])
            duty = np.zeros(6)
            duty[0 if wanted[k] > before[k] else 3] = 1.0
            while abs(plant.pressures[0] - wanted[k]) > 0.02 * wanted[k] + 0.004:
                plant.step(duty, 1e-4)
            times.append(1e3 * plant.time)
        before = wanted
    return np.array(times)


def compare_plants(make, seeds):
    """Both controllers on plants that the feed-forward does not know."""
    for table, period in (("plants_fast", FAST), ("plants_slow", SLOW)):
        begin_steps(table, f"plant, host {1e3 * period:g} ms")
        for name, design in PLANTS.items():
            add_steps(table, f"{name}, board alone", make, design, period, None, seeds)
            add_steps(table, f"{name}, with feed-forward", make, design, period, TRUE, seeds)


def patch_slew(folder, slew, shaped):
    """Return sources of the firmware with other slew limits [hPa/ms]."""
    place = Path(folder) / f"firmware-{slew}-{shaped}"
    shutil.copytree(find_sources(), place, ignore=shutil.ignore_patterns("build"))
    config = place / "src" / "config.h"
    text = config.read_text(encoding="utf-8")
    for name, value in (("BZ_SLEW ", slew), ("BZ_SLEW_SHAPED ", shaped)):
        head, tail = text.split(f"#define {name}")
        text = f"{head}#define {name}{value} {tail.lstrip().split(' ', 1)[1]}"
    config.write_text(text)
    return place


def compare_slews(make, seeds):
    """Steps and runaway hosts under other slew limits."""
    short = replace(TRUE, tube_length=150.0)
    with tempfile.TemporaryDirectory() as folder:
        begin_steps("slews", "slew limit [kPa/ms]: of the board alone, with feed-forward")
        for slew in (20, 30, 50, 100):
            sources = patch_slew(folder, slew, slew)
            for name, design in (("", TRUE), (", tube of 150 mm", short)):

                def make_patched(sources=sources):
                    return make(sources=sources)

                words = f"{slew / 10:g}{name}"
                case = make_patched, design, FAST
                add_steps("slews", f"{words}, board alone", *case, None, seeds)
                add_steps("slews", f"{words}, feed-forward", *case, design, seeds)
        figures = "fastest rise [kPa/ms]", "peak [kPa]", "end"
        begin("runaway", "runaway host, reservoir 930 kPa", *figures)
        for slew in (20, 100):
            for words, design in (("", TRUE), (", tube of 150 mm", short)):
                for forward in ((), (1.0, 1.0, 1.0)):
                    with make(sources=Path(folder) / f"firmware-{slew}-{slew}") as board:
                        name = f"slew {slew / 10:g}{words}, " + (
                            "fill valves open for good" if forward else "set-point 827 kPa"
                        )
                        add_runaway(name, board, design, SetPoint((0.827,) * 3, forward))


def add_runaway(name, board, design, command):
    """Add what a host does that sends one command all the time."""
    plant = Plant(CHAMBERS, replace(design, reservoir_pressure=0.93), seed=1)
    host, link, _ = connect(board, plant, FAST)
    run = host.run(lambda time, telemetry: (command, {}), 1.0)
    _, pressures = link.list_pressures()
    rise = 1e3 * (pressures[20:] - pressures[:-20]).max() / 20.0
    end = run.reason.rpartition("(")[2].rstrip(")") or "armed"
    add("runaway", name, f"{rise:.1f}", f"{1e3 * pressures.max():.0f}", end)


def run_stick(
    board, period, name, compensate, operator, script, duration, *, effector=EFFECTOR, spent=None
):
    """Return the run, the true tip (n, 2) [mm] and the link; add what steps take [s] to spent."""
    chambers = [Chamber.from_model(model) for model in effector.models]
    plant = Plant(chambers) if operator is None else HystereticPlant(chambers, operator)
    host, link, configuration = connect(board, plant, period)
    rubs = operator is not None and name == "predictive"
    model = replace(effector, motion=RUBBING) if rubs else effector
    steering = Steering(
        model,
        BoardStick(),
        controller=make_controller(name, model, configuration, period=period),
        compensator=HysteresisCompensator(operator) if compensate else None,
    )
    acting = []

    def control(time, telemetry):
        plant.stick_voltages = script.read(time, script.readings[0]) * VOLTS_PER_COUNT
        acting.append(getattr(plant, "effective_pressures", plant.pressures))
        begin = thread_time()
        answer = steering(time, telemetry)
        if spent is not None:
            spent.append(thread_time() - begin)
        return answer

    run = host.run(control, duration)
    tip = effector.forward(np.clip(acting, 0.0, effector.design.pressure_limit)).lateral_vector
    return run, np.asarray(tip), link


def compare_circles(make):
    """The tip against where the stick wants it, by the true state of the plant."""
    figures = "error rms [mm]", "largest", "by the transducers, rms"
    begin("circle", "circle at 0.5 Hz", "host [ms]", *figures)
    script = ScriptedStick.circle(0.5, 6.5)
    for operator, words in ((None, ""), (FRICTION, "hysteresis, ")):
        for period in (FAST, SLOW):
            for name in ("static", "feedforward"):
                for compensate in (False, True) if operator else (False,):
                    with make() as board:
                        run, tip, _ = run_stick(
                            board, period, name, compensate, operator, script, 6.5
                        )
                    error, seen = measure_circle(run, tip)
                    title = words + NAMES[name] + (", compensated" if compensate else "")
                    rms, by_sensors = (np.sqrt(np.mean(e**2)) for e in (error, seen))
                    figures = f"{rms:.2f}", f"{error.max():.2f}", f"{by_sensors:.2f}"
                    add("circle", title, f"{1e3 * period:g}", *figures)


def measure_circle(run, tip):
    """Return the distances of the true tip, and of that of the transducers, on the circle [mm]."""
    table = run.to_frame()
    after = table["time_s"].to_numpy() > 0.6  # at the circle
    target = table[["target_x_mm", "target_y_mm"]].to_numpy()
    return np.hypot(*(tip - target)[after].T), run.tip_errors[after]


def compare_controllers():
    """The three controllers of ``bozzini rig run``, on the default end-effector."""
    effector = Effector.from_preset("measured")
    cases = ((0.1, None), (0.5, None), (1.0, None), (0.5, FRICTION))
    head = [f"{f:g} Hz" + (", hysteresis" if operator else "") for f, operator in cases]
    begin("controllers", "error rms [mm]", *head, "period: median [ms]", "p99 [ms]")
    for name, shown in NAMES.items():
        found, spent = [], []
        for frequency, operator in cases:
            duration = 0.5 + 1.5 / frequency
            script = ScriptedStick.circle(frequency, duration)
            with NativeBoard() as board:
                case = SLOW, name, False, operator, script, duration
                run, tip, _ = run_stick(board, *case, effector=effector, spent=spent)
            error, _ = measure_circle(run, tip)
            found.append(f"{np.sqrt(np.mean(error**2)):.2f}")
        median, late = 1e3 * np.percentile(spent[10:], [50.0, 99.0])
        add("controllers", shown, *found, f"{median:.1f}", f"{late:.1f}")


def time_stick_step(make):
    """From the stick to the first 10 kPa in a muscle."""
    begin("stick", "step of the stick", "host [ms]", "first 10 kPa after [ms]")
    script = ScriptedStick(
        [0.0, 0.3, 0.3001, 1.0], [[512, 512], [512, 512], [1023, 512], [1023, 512]]
    )
    for period in (FAST, SLOW):
        for controller in ("static", "feedforward"):
            name = NAMES[controller]
            with make() as board:
                run, _, link = run_stick(board, period, controller, False, None, script, 0.6)
            time, pressures = link.list_pressures()
            time = time - run.link_start
            risen = time[np.argmax((pressures > 0.01).any(axis=1) & (time > 0.3))]
            add("stick", name, f"{1e3 * period:g}", f"{1e3 * (risen - 0.3):.0f}")


def main():
    """Take the options and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--board", choices=BOARDS, default="emulated")
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--keep", action="store_true", help="keep what was measured")
    parser.add_argument("parts", nargs="*", default=PARTS, help=", ".join(PARTS))
    given = parser.parse_args()
    make = BOARDS[given.board]
    if "steps" in given.parts:
        compare_steps(make, given.seeds)
    if "plants" in given.parts:
        compare_plants(make, max(given.seeds // 4, 1))
    if "slews" in given.parts:
        compare_slews(make, max(given.seeds // 4, 1))
    if "stick" in given.parts:
        compare_circles(make)
        time_stick_step(make)
    if "controllers" in given.parts:
        compare_controllers()
    if given.keep:
        kept = json.loads(KEPT.read_text("utf-8")) | TABLES
        rows = {
            name: ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in table)
            for name, table in kept.items()
        }
        text = ",\n".join(f' "{name}": [\n{part}\n ]' for name, part in rows.items())
        KEPT.write_text(f"{{\n{text}\n}}\n", "utf-8")


if __name__ == "__main__":
    main()
