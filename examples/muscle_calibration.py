"""Calibrate a muscle model from a table of measurements, and see what the table cannot tell.

    python examples/muscle_calibration.py              measurements made up here, truth known
    python examples/muscle_calibration.py data.csv     your own, of a 45 mm muscle

There are no public measurements of such muscles, so the table is made up: inflation and deflation
of three specimens without load, with braid friction, and errors of 0.1 mm.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bozzini.errors import InputError
from bozzini.muscle import (
    EnergyMuscle,
    FitOptions,
    Measurements,
    ThesisMuscle,
    calibrate,
    compare_models,
    preset,
    read_measurements,
    write_measurements,
)

TRUTH = preset("thesis-45", modulus=0.5, dead_length=10.0, friction_length=0.02)
NOISE = 0.1  # standard deviation of a length [mm]


def make_up(path, *, seed=1):
    """Write the table: 20 pressures up and down, three specimens."""
    random = np.random.default_rng(seed)
    pressures = np.linspace(0.0, 0.827, 20)
    model = EnergyMuscle(TRUTH)
    columns = {name: [] for name in ("pressure", "contraction", "direction", "specimen")}
    for specimen in "ABC":
        for direction, order in (("inflating", pressures), ("deflating", pressures[::-1])):
            measured = model.contraction(order, direction=direction)
            columns["pressure"].append(order)
            columns["contraction"].append(measured + NOISE * random.normal(size=len(order)))
            columns["direction"].append(np.full(len(order), direction))
            columns["specimen"].append(np.full(len(order), specimen))
    write_measurements(path, Measurements(**{k: np.concatenate(v) for k, v in columns.items()}))


def print_fit(title, found):
    """Print estimates with their intervals, and warnings."""
    print(f"{title}: residuals {found.sigma:.3f} mm, condition {found.condition:.1f}")
    for name in found.free:
        low, high = found.intervals[name]
        print(f"    {name:16s}{found.estimates[name]:9.4f}   95 %: {low:.4f} to {high:.4f}")
    for line in found.warnings:
        print(f"    warning: {line}")


def main(arguments=None):
    """Run the example."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="?", type=Path, help="your own table (.csv, .parquet)")
    parser.add_argument("--out", type=Path, default=Path("muscle_calibration.png"))
    given = parser.parse_args(arguments)
    start = preset("thesis-45")
    table = given.data
    if table is None:
        table = given.out.with_suffix(".csv")
        make_up(table)
    data = read_measurements(table, muscle=start)
    repeats = data.repeat_statistics()
    print(f"{len(data)} rows; a repeat is off by {repeats.pooled_deviation:.3f} mm")

    free = ("modulus", "dead_length", "friction_length")
    mean = calibrate(EnergyMuscle, start, data=data.mean_of_directions())
    print_fit("mean of both directions", mean)
    both = calibrate(EnergyMuscle, start, data=data, free=free)
    print_fit("both directions", both)
    up = data.select(data.direction == "inflating")
    try:
        calibrate(EnergyMuscle, start, data=up, free=free)
    except InputError as error:
        print(f"inflation alone: refused: {error}")
    lost = calibrate(EnergyMuscle, start, data=up, free=free, options=FitOptions(force=True))
    print_fit("inflation alone, forced", lost)

    printed = calibrate(ThesisMuscle, start, data=data, free=("modulus", "end_length"))
    models = {
        "energy, 3 fitted": EnergyMuscle(both.muscle),
        "energy, as designed": EnergyMuscle(start),
        "thesis, 2 fitted": ThesisMuscle(printed.muscle),
        "thesis, as designed": ThesisMuscle(start),
    }
    counts = {"energy, 3 fitted": 3, "thesis, 2 fitted": 2}
    comparison = compare_models(models, data, fitted=counts)
    print(comparison.format_table())

    from bozzini.plot import write_figure
    from bozzini.plot.muscle import draw_models

    write_figure(draw_models(comparison, models), given.out)
    return {"mean": mean, "both": both, "lost": lost, "comparison": comparison}


if __name__ == "__main__":
    main()
