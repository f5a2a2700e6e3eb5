"""The rig's pneumatics.

A muscle is filled for 60 ms, held, and vented: pressure in the muscle and at the board's sensor.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.muscle import EnergyMuscle, preset
from bozzini.rig import Chamber, Plant

plant = Plant(Chamber.from_model(EnergyMuscle(preset("fitted-45")), load=0.05), seed=1)
time = np.arange(0.0, 0.3, 0.002)
shown = np.empty((2, len(time)))
for k, now in enumerate(time):
    fill, bleed = float(now < 0.06), float(now > 0.15)
    plant.step([fill, 0, 0, bleed, 0, 0], 0.002)  # duties of the valves, for 2 ms
    shown[:, k] = plant.pressures[0], plant.design.to_pressure(plant.sensor_voltages())[0]

figure, axes = plt.subplots(layout="constrained")
axes.plot(1000.0 * time, 1000.0 * shown[1], color="0.7", label="sensor")
axes.plot(1000.0 * time, 1000.0 * shown[0], label="muscle")
axes.set(xlabel="time [ms]", ylabel="pressure [kPa]")
axes.legend()
