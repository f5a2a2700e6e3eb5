"""Constants with intervals.

A model is fitted to a table of contractions, two constants free. Each comes with its interval, and
the curve with what it was fitted to.
"""

import numpy as np
import pandas as pd

from bozzini import muscle
from bozzini.plot.muscle import draw_contraction

truth = muscle.EnergyMuscle(muscle.preset("thesis-45", modulus=0.5, dead_length=10.0))
pressure = np.linspace(0.1, 0.8, 25)  # [MPa]
noise = np.random.default_rng(3).normal(0.0, 0.1, len(pressure))
table = {"pressure [MPa]": pressure, "load [N]": 0.0}
table["contraction [mm]"] = truth.contraction(pressure) + noise

start = muscle.preset("thesis-45")
free = ("modulus", "dead_length")
found = muscle.calibrate(muscle.EnergyMuscle, start, data=pd.DataFrame(table), free=free)
models = {"fitted": muscle.EnergyMuscle(found.muscle), "before": muscle.EnergyMuscle(start)}
axes = draw_contraction(models, pressure=0.8, lowest=0.1)
axes.plot(1000.0 * pressure, table["contraction [mm]"], "kx", label="measured")
modulus, dead = (found.intervals[name] for name in free)
axes.set_title(
    loc="right",
    label=f"{modulus[0]:.3f} to {modulus[1]:.3f} MPa,  {dead[0]:.1f} to {dead[1]:.1f} mm",
)
axes.legend()
