"""What force acts on the wall.

Two motions along the same path, driven in a simulator whose wall presses back: the certified plan
does not touch; a chain that is dragged without regard for walls does, until a link is pressed
through it.
"""

import matplotlib.pyplot as plt

import bozzini as bz
from bozzini.physics import ExecuteOptions, Scenery

tract = bz.make_phantom(seed=4).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=20.0))

scenery = Scenery.from_plan(plan, tract, duct=field)
figure, axes = plt.subplots(layout="constrained")
for drive in ("plan", "tractrix"):
    run = scenery.run(ExecuteOptions(drive=drive, speed=80.0, step=0.004))
    axes.plot(run.inserted, run.normal_sum, label=drive)
axes.set(xlabel="inserted [mm]", ylabel="sum of normal forces [N]")
axes.legend()
