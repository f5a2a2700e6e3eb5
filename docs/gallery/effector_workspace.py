"""Where the catheter tip can go.

All places that pressures of up to 827 kPa reach, and how far in each direction.
"""

import bozzini as bz
from bozzini.effector import effector_preset, workspace
from bozzini.plot.effector import draw_workspace

tip = bz.Effector(effector_preset("prototype"))
figure = draw_workspace(tip, workspace(tip))
