"""A loop identified and compensated.

Fitted to a record of pressure and contraction, with drift and noise; the last fifth was not fitted.
"""

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
axes = fit.plot()
