"""Made-up muscles with hysteresis, and records of them as a testing machine would write them."""

from __future__ import annotations

import numpy as np

from bozzini.muscle import EnergyMuscle, preset
from bozzini.muscle.hysteresis import Preisach
from bozzini.muscle.loops import LoopRecord

STATIC = EnergyMuscle(preset("effector-45"))
LOAD = 0.3
TIME = 300.0
OFFSET, DRIFT, NOISE = 0.8, 0.4, 0.03
TURNS = (0.2, 0.55, 0.12, 0.7, 0.02, 0.6, 0.2, 0.68, 0.05, 0.45, 0.15, 0.7, 0.0, 0.7, 0.02, 0.65,
         0.1, 0.5, 0.2, 0.6, 0.05)  # fmt: skip


def make_relays(steps=120):
    """Relays whose loops are wider at higher pressures, which no plays are."""
    levels = np.linspace(0.0, 0.75, steps + 1)
    on, off = np.tril_indices(steps)
    width = levels[on + 1] - levels[off]
    weights = np.exp(-0.5 * (width / 0.08) ** 2) * (0.3 + levels[on + 1]) + (on == off)
    weights *= 0.31 / weights.sum()
    return Preisach(tuple(levels), tuple(weights), offset=float(weights.sum()))


class Plant:
    """A muscle that was used before the record and creeps while it is made."""

    def __init__(self, operator, static=STATIC, load=LOAD):
        self.operator, self.static, self.load = operator, static, load

    def run(self, pressure, before=(0.0, 0.55)):
        """Contractions [mm] along pressures, after some before."""
        acting = self.operator.apply([*before, *pressure])[len(before) :]
        return self.static.contraction(np.maximum(acting, 0.0), self.load)


def drift(time):
    """What the sensor shows beside the contraction [mm]."""
    return OFFSET + DRIFT * np.log1p(time) / np.log1p(TIME)


def make_record(plant, count=3000, seed=0, turns=TURNS):
    """Return a noisy record that does not start at rest, and what the sensor would show without."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, TIME, count)
    pressure = np.interp(time, np.linspace(0.0, TIME, len(turns)), turns)
    shown = plant.run(pressure) + drift(time)
    record = LoopRecord(
        time=time,
        pressure=pressure + 0.0008 * random.normal(size=count) - 0.001,
        response=shown + NOISE * random.normal(size=count),
        held=plant.load,
    )
    return record, pressure, shown
