"""How far do errors move the tip?

Errors of the pressures and of the muscles' modulus, as an ellipse of 95 % of them beside exact
draws. The error of the model itself is not in it.
"""

import bozzini as bz
from bozzini.effector import effector_preset
from bozzini.study import effector_tip_error

tip = bz.Effector(effector_preset("prototype"))
found = effector_tip_error(
    tip,
    {"R": 0.5, "G": 0.35},  # [MPa]
    pressure_sd=0.005,
    parameter_sd={"muscle.modulus": 0.005},
)
figure = found.draw()
