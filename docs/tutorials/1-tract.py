# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 1 A CT or a surface to a certified motion
#
# You have a label volume of a tract (NIfTI, NRRD, DICOM) or its surface (STL, PLY, OBJ, VTK). You
# get the motion of a flexible scope through it, with a proved distance from the wall.
#
# Each tutorial is a script of `docs/tutorials`: run it cell by cell in an editor, or as a
# notebook (`jupytext --to notebook 1-tract.py`). Run as a script, its pictures need `plt.show()`.
# It needs no extra.

# %%
import bozzini as bz
from bozzini.anatomy import write_tract
from bozzini.motion import Plan, find_diameter_limits, verify_plan
from bozzini.motion.verify import build_wall
from bozzini.plot import draw_clearance, draw_overview

# %% [markdown]
# ## Your file
#
# Here a phantom of the upper tract stands for your segmentation. Skip this cell and name your own
# file below.

# %%
phantom = bz.make_phantom(seed=3).to_labels(voxel=2.0)
_ = write_tract("my_labels.nii.gz", phantom, force=True)

# %% [markdown]
# `labels` are the numbers that belong to the lumen; left out, the message lists what there is.
# Everything is in mm. What looks wrong in a file, such as a second piece or a hole, is a finding.

# %%
tract = bz.read_tract("my_labels.nii.gz", labels=(1, 2, 3))
for finding in tract.findings:
    print(finding)

# %% [markdown]
# ## The duct
#
# The signed distance to the wall, and the way that stays far from it. Nodes are 2 mm apart here,
# to be quick; leave `voxel` out for those of your file. Ends that are found at the wrong place
# are given with `ends=([x, y, z], [x, y, z])`.

# %%
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
print(f"{line.length:.0f} mm, narrowest radius {line.radius.min():.1f} mm")
line.plot()

# %% [markdown]
# How wide may a scope be, before any planning? Both of these are proved; between them planning
# decides.

# %%
limits = find_diameter_limits(field, line, link=12.0)
print(f"of links of 12 mm, what is thinner than {limits.low:.1f} mm passes")
print(f"what is thicker than {limits.high:.1f} mm does not, at {limits.high_at:.0f} mm of the line")

# %% [markdown]
# ## The motion
#
# A chain of rigid links, 12 mm long and 9 mm thick. Every joint at every step is in the plan.

# %%
scope = bz.Scope(diameter=9.0, link_length=12.0)
plan = bz.plan_insertion(field, line, scope=scope)
print(plan.status, plan.reason)
if plan.certified:
    print(f"{plan.inserted:.0f} mm in, at least {plan.certificate.clearance:.2f} mm from the wall")
print(f"The wall itself is known to within {field.wall_error:.2f} mm.")

# %% [markdown]
# `complete` and certified: all the way, and between the steps too, the whole body is proved to
# keep that far off the stated wall. A proof that is smaller than what the wall is known to says
# nothing of the organ: take a finer file, a smaller `voxel`, or a thinner scope.

# %%
draw_overview(plan, field)

# %%
draw_clearance(plan)

# %% [markdown]
# If it does not fit, `plan.reason` and `plan.refusal` say where and why, and often what would; see
# [Traversability](../guide/traversability.md).
#
# ## Keep it, and let someone else check it
#
# `verify_plan` holds the motion against the wall again, by code that shares nothing with the
# planner. Its second check lies above the proof: the proof is what is sure on this grid.

# %%
plan.save("plan.npz")
again = verify_plan(Plan.load("plan.npz"), field, wall=build_wall(tract))
for check in again.checks:
    print("ok" if check.ok else "FAILED", check.name, check.message)

# %% [markdown]
# The command line does all of this at once, writes a report, and states in the plan from which
# file it was made and by which command, so that others make it again, and `bozzini certify` reads
# the file:
#
#     bozzini plan my_labels.nii.gz --labels 1,2,3 --diameter 9mm --link 12mm --out result
#     bozzini certify result/plan.npz my_labels.nii.gz --independent
