"""A loop identified and compensated.

Left: fitted to a record of pressure and contraction, with drift and noise; the last fifth was not
fitted. Right: how far the muscle is from wanted contractions under the pressures of the static
model, and under those of the inverse of what was fitted. The offset that is left is one of the
sensor to the fit: the record comes to rest only once.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.muscle import EnergyMuscle, preset
from bozzini.muscle.hysteresis import PrandtlIshlinskii
from bozzini.muscle.loops import LoopFitOptions, LoopRecord, fit_loop

static = EnergyMuscle(preset("effector-45"))
time = np.linspace(0.0, 100.0, 2000)
turns = [0.1, 0.7, 0.1, 0.6, 0.0, 0.7, 0.2, 0.5, 0.1]
pressure = np.interp(time, np.linspace(0.0, 100.0, len(turns)), turns)
true = PrandtlIshlinskii((0.0, 0.05, 0.1), (0.6, 0.2, 0.15))
noise = np.random.default_rng(0).normal(0.0, 0.02, len(time))
shown = static.contraction(true.apply(pressure), 0.3) + 0.002 * time + noise
record = LoopRecord(time=time, pressure=pressure, response=shown, held=0.3)
fit = fit_loop(record, "generalised", static=static, options=LoopFitOptions(hold_out=0.2))

wanted = np.interp(np.linspace(0.0, 5.0, 300), range(6), [2.0, 8.0, 4.0, 7.0, 3.0, 8.0])  # [mm]
alone = static.pressure(0.3, static.muscle.length - wanted)
given = {"static": alone, "inverse of the fit": fit.model.compensate(wanted).pressure}
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
fit.plot(left)
for name, applied in given.items():
    got = static.contraction(true.apply(applied), 0.3)
    right.plot(wanted, got - wanted, label=name)
right.set(xlabel="wanted contraction [mm]", ylabel="off by [mm]")
right.legend()
