"""A tract that breathes.

The clearance field is built once. As breathing sways the tract, the motion is planned and proved
anew in each frame, on a lumen bounded from the one at rest.
"""

import matplotlib.pyplot as plt

import bozzini as bz
from bozzini.anatomy import Breathing
from bozzini.duct import MovingField, carry_tissue
from bozzini.motion import ReplanOptions, replan

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
plan = bz.plan_insertion(
    field, bz.find_centreline(field), scope=bz.Scope(diameter=8.0, link_length=10.0), method="tube"
)
breath = Breathing(amplitude=6.0, wavelength=200.0, direction=(1, 0, 0), along=(0, 0, 1))
moving, last = MovingField(field), breath.at(0.0)
times = [0.25 * k for k in range(17)]  # [s]
clearances = []
for time in times:
    now = breath.at(time)
    path = carry_tissue(plan.path, last, now=now)
    bounds = {"gradient_bound": now.gradient_bound, "second_bound": now.second_bound}
    lumen = moving.update(now, **bounds, path=path, radius=plan.scope.radius)
    move = lambda points, a=last, b=now: carry_tissue(points, a, now=b)  # noqa: E731
    plan = replan(plan, lumen, advect=move, options=ReplanOptions(measure=False))
    clearances.append(plan.certificate.clearance)
    last = now

figure, axes = plt.subplots(layout="constrained")
axes.plot(times, clearances, "o-")
axes.set(xlabel="time [s]", ylabel="certified clearance [mm]", ylim=(0.0, None))
