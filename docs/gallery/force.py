"""Force over contraction.

What a muscle still pulls when it has contracted, at three pressures.
"""

from bozzini import muscle
from bozzini.plot.muscle import draw_force

model = muscle.EnergyMuscle(muscle.preset("effector-45"))
axes = draw_force(model, [0.3, 0.5, 0.8])
