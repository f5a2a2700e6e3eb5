"""Made-up plants with memory, and records of them: bipolar, off rest, offset, in windows, noisy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bozzini.hysteresis import LoopRuns
from bozzini.muscle.hysteresis import BoucWen, PrandtlIshlinskii
from bozzini.numeric.arrays import Floats

WIDTH = 1.7
BOUC_WEN = BoucWen(slope=1.0, alpha=0.6, beta=0.36, gamma=0.24, exponent=1.5, scale=2.0)
OFFSET = -300.0


def bend(inner: Floats) -> Floats:
    """A cubic."""
    return 3.0 * inner + 0.05 * inner**2 - 0.01 * inner**3


PLANTS: dict[str, Callable[[Floats], Floats]] = {
    "backlash": lambda u: bend(PrandtlIshlinskii((WIDTH,), (1.0,)).apply(u)),
    "plays": PrandtlIshlinskii((0.0, 0.5, 1.5, 3.0), (1.0, 0.5, 0.6, 0.4)).apply,
    "slips": PrandtlIshlinskii((0.0, 1.0, 2.0), (2.0, -0.5, -0.5)).apply,  # what leads
    "bouc-wen": BOUC_WEN.apply,
}
"""Outputs along inputs from rest."""
CONTAINS = {
    "backlash": ("backlash-cubic", "capstan", "generalised"),
    "plays": ("prandtl-ishlinskii", "generalised"),
    "slips": ("prandtl-ishlinskii", "generalised"),
    "bouc-wen": ("bouc-wen",),
}
"""The laws that can represent a plant."""


@dataclass(frozen=True)
class Record:
    """A record and the standard deviation of its noise."""

    runs: LoopRuns
    noise: float


def make_record(
    plant: str,
    *,
    seed: int = 0,
    count: int = 900,
    windows: int = 1,
    turn: float = 1.0,
    drift: float = 0.0,
    noise: float = 0.01,
) -> Record:
    """Return loops of inputs of both signs after others, that are not in the record.

    Parameters
    ----------
    turn : float
        Times the output.
    drift, noise : float
        In spans of the output.
    """
    random = np.random.default_rng(seed)
    inputs, outputs = [], []
    for _ in range(windows):
        size = random.uniform(3.0, 10.0, size=2 + 12 // windows)
        turns = size * np.where(np.arange(len(size)) % 2, 1.0, -1.0)
        turns[0] = random.uniform(-3.0, 3.0)
        way = np.append(0.0, np.cumsum(np.abs(np.diff(turns))))
        input_ = np.interp(np.linspace(0.0, way[-1], count // windows), way, turns)
        before = np.interp(np.linspace(0.0, 3.0, 150), range(4), [0.0, 9.0, -4.0, input_[0]])
        inputs.append(input_)
        outputs.append(turn * PLANTS[plant](np.append(before, input_))[150:])
    output = np.concatenate(outputs)
    span, total = float(np.ptp(output)), len(output)
    output = output + OFFSET + drift * span * np.linspace(0.0, 1.0, total)
    output = output + noise * span * random.normal(size=total)
    sizes = np.cumsum([0, *map(len, inputs)]).tolist()
    runs = LoopRuns(
        input=np.concatenate(inputs),
        output=output,
        time=0.1 * np.arange(total),
        labels=tuple("abcdef"[:windows]),
        first=tuple(sizes[:-1]),
        input_title="wheel [deg]",
        output_title="probe [counts]",
        time_title="time [s]",
    )
    return Record(runs, noise * span)
