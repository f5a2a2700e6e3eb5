# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 3 A tendon robot: file, fit, workspace, motion along a tract
#
# You have a robot pulled by tendons, and points that you saw on it. You get its constants, where it
# reaches, and the tendon displacements that take it along a duct, as a table. It needs no extra.

# %%
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import bozzini as bz
from bozzini.continuum import RobotFitOptions, fit_robot, read_robot_measurements
from bozzini.continuum.arc import displacements_for
from bozzini.duct import Centreline, RoundCones
from bozzini.motion.actuate import actuate_plan

# %% [markdown]
# ## The robot as a file
#
# Three sections, three tendons each, which pass through the sections before theirs.
# `bozzini new robot` writes a file to begin with.

# %%
SECTION = """
  - length: 40 mm
    radius: 3 mm
    bending_stiffness: 600 N mm^2
    max_bend: 90 deg
    tendons:
"""
text = "name: mine\nsections:"
for k in range(3):
    text += SECTION
    for i in range(3):
        angle = 120 * i + 40 * k
        text += f"      - {{name: T{3 * k + i + 1}, offset: 2.5 mm, angle: {angle} deg}}\n"
Path("robot.yaml").write_text(text, encoding="utf-8")
robot = bz.ContinuumRobot.from_yaml("robot.yaml")
print(robot.tendon_names, robot.length, "mm")

# %% [markdown]
# ## Points that were seen
#
# A row for each pose: displacements of all tendons, and where the tip was. Here they are made up,
# of a robot whose last section is 2 mm longer, seen by a camera that is 5 mm off and errs by
# 0.2 mm.

# %%
random = np.random.default_rng(2)
last = replace(robot.sections[2], length=42.0)
real = bz.ContinuumRobot([*robot.sections[:2], last])
commands = displacements_for(real, random.uniform(-0.7, 0.7, (60, 3, 2)))
tips = real.forward(commands).tip + [5.0, 0.0, 0.0] + random.normal(0.0, 0.2, (60, 3))
table = pd.DataFrame(commands, columns=[f"{n} displacement [mm]" for n in robot.tendon_names])
for axis, values in zip("xyz", tips.T, strict=True):
    table[f"tip {axis} [mm]"] = values
table.to_csv("rows.csv", index=False)

# %% [markdown]
# ## The fit
#
# Where the base is in the camera's world, and the length of each section. Rows are left out in
# blocks and predicted; that error, not the fit's, is what to expect of new rows.

# %%
data = read_robot_measurements("rows.csv", robot=robot)
fit = fit_robot(
    robot,
    data,
    free=["base", "sections.each.length"],
    options=RobotFitOptions(model="arc", smaller=False),
)
print(fit.format_table())

# %%
fit.plot()

# %%
fit.robot.to_yaml("fitted.yaml")
fitted = bz.ContinuumRobot.from_yaml("fitted.yaml")

# %% [markdown]
# The last section is 42 mm and the camera 5 mm off in x, as made up; each interval tells how sure
# that is. 0.35 mm in rows left out is the camera's 0.2 mm in three directions: nothing is missing.
#
# ## Where it reaches
#
# Right: from how many directions the tip can come to a place.

# %%
fitted.workspace().plot()

# %% [markdown]
# ## Along a tract
#
# A duct of 14 mm with two bends; `bz.read_tract` reads one of yours. The plan is made for a chain
# of links; then the robot is laid along it, and proved to keep off the wall, between
# steps as well.

# %%
turn = np.linspace(0.0, 0.9, 30)
rise = 55.0 * np.stack([1.0 - np.cos(turn), np.sin(turn)], axis=1)
back = rise[-1] + (rise[-1] - rise[::-1])
x, z = np.concatenate([[[0.0, -15.0]], rise, back[1:]]).T
way = np.stack([x, 0.0 * x, z], axis=1)
duct = RoundCones(way, np.full(len(way), 7.0))
line = Centreline.from_points(way, duct)
scope = bz.Scope(diameter=6.0, link_length=5.0, length=fitted.length)
plan = bz.plan_insertion(duct, line, scope=scope)
print(plan.status, plan.reason)

# %%
motion = actuate_plan(plan, fitted, duct)
print("fits:", motion.fits, motion.reason, "certified:", motion.certified)
assert motion.fits
motion.plot()

# %%
motion.write_csv("tendons.csv")
pd.read_csv("tendons.csv").tail(3)

# %% [markdown]
# The same in commands:
#
#     bozzini continuum fit robot.yaml rows.csv --free base,sections.each.length --out fit.yaml
#     bozzini continuum workspace fit.yaml --out space.png
#     bozzini plan your_tract.stl --robot fit.yaml --out motion
#
# The robot has to be as long as the tract: else the motion ends where it is wholly inserted, and
# the verdict tells how many sections more it needs.
