"""A muscle that lags.

Braid friction makes a loop: contraction depends on what the pressure was before. An operator
describes it, and its inverse takes it out.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.muscle import EnergyMuscle, preset
from bozzini.muscle.hysteresis import PrandtlIshlinskii

lag = PrandtlIshlinskii(thresholds=(0.0, 0.02, 0.05), weights=(0.7, 0.15, 0.1))
model = EnergyMuscle(preset("effector-45"), hysteresis=lag)
turns = [0.0, 0.7, 0.1, 0.6, 0.2, 0.5, 0.0]
pressure = np.interp(np.linspace(0.0, 6.0, 600), range(7), turns)  # [MPa]
contraction = model.trace_contraction(pressure, load=0.2)

figure, axes = plt.subplots(layout="constrained")
axes.plot(1000.0 * pressure, contraction)
axes.set(xlabel="pressure [kPa]", ylabel="contraction [mm]")
