"""How hard the tip can press.

Force of the catheter tip in each direction, held at a place.
"""

import bozzini as bz
from bozzini.effector import effector_preset
from bozzini.plot.effector import draw_force

tip = bz.Effector(effector_preset("prototype"))
figure = draw_force(tip, lateral=(2.0, 1.0))
