"""A still camera beside one on the tip.

A distal head stands in the stomach of a phantom, and a script touches five places of its wall with
the instrument. The head's camera stands still; one on the tip, as scopes have it, turns with it.
"""

import matplotlib.pyplot as plt
import numpy as np

import bozzini as bz
from bozzini.head import Head, compare_cameras, list_touches, stand_head

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=12.0))

head, stand = Head(), stand_head(plan, 275.0)
targets = list_touches(head, stand, duct=field).choose(5)
found = compare_cameras(head, stand, touches=targets, duct=field)

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.2), layout="constrained")
found.plot(left)
left.set_title("picture of the still camera")
names = [f"camera: {row.camera}" for row in found.rows]
turns = np.degrees([row.turn for row in found.rows])
right.bar_label(right.bar(names, turns, color=["C2", "C1"]), fmt="%.0f deg")
right.set_ylabel("turned while five places are touched [deg]")
for row in found.rows:
    print(f"{row.camera}: {row.turn_most:.2f} rad at most, target moved {row.shift:.0f} px")
