"""A catheter tip bent by three muscles.

The pose for pressures in two of them.
"""

import bozzini as bz
from bozzini.effector import effector_preset, workspace
from bozzini.plot.effector import draw_pose

tip = bz.Effector(effector_preset("prototype"))
pose = tip.forward({"R": 0.5, "G": 0.2})  # [MPa]

print("tip at", pose.tip.round(2), "mm")
figure = draw_pose(tip, pose, workspace=workspace(tip))
