# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 6 A figure for a paper
#
# Two columns wide, in your journal's font size, as a vector file, from results that another person
# can compute again. It needs no extra.

# %%
import matplotlib.pyplot as plt
import numpy as np

import bozzini as bz
from bozzini import muscle
from bozzini.plot import write_figure

# %% [markdown]
# Anything with a `.plot` draws into axes that you give it, so that a figure is composed by
# matplotlib as you are used to. Colours, labels and limits are yours to change.

# %%
plt.rcParams.update({"font.size": 8, "axes.linewidth": 0.6, "lines.linewidth": 1.0})
figure, (left, right) = plt.subplots(1, 2, figsize=(6.5, 2.6), layout="constrained")

# %% [markdown]
# Left: the clearance along a certified plan in a phantom.

# %%
tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=12.0))
frame = plan.to_frame()
print(list(frame.columns))
left.plot(frame["head_arc_length_mm"], frame["clearance_mm"], color="tab:blue")
left.axhline(plan.certificate.clearance, color="k", linestyle=":")
left.set(xlabel="insertion [mm]", ylabel="clearance [mm]", title="(a)")

# %% [markdown]
# Right: a muscle, with the scatter of its constants.

# %%
random = np.random.default_rng(0)
pressure = np.linspace(0.05, 0.8, 60)
curves = [
    muscle.EnergyMuscle(muscle.preset("thesis-45", modulus=random.normal(0.5, 0.02))).contraction(
        pressure
    )
    for _ in range(200)
]
low, middle, high = np.percentile(curves, [2.5, 50.0, 97.5], axis=0)
right.fill_between(1000.0 * pressure, low, high, alpha=0.3, linewidth=0.0)
right.plot(1000.0 * pressure, middle)
right.set(xlabel="pressure [kPa]", ylabel="contraction [mm]", title="(b)")

# %% [markdown]
# (a) The clearance at each step, and what is proved for all times between (dotted). (b) The
# middle and 95 % of muscles whose modulus scatters by 4 %.

# %%
write_figure(figure, "figure.pdf")
figure

# %% [markdown]
# ## So that others can repeat it
#
# Put this script and the plan beside the figure: the plan holds the scope, the options and the
# versions. One by `bozzini plan` also holds the hash of the tract's file and the command that
# makes it again. A seed makes the scatter the same each time. Please cite Bozzini as
# `CITATION.cff` states.

# %%
plan.save("figure_a.npz")
bz.Plan.load("figure_a.npz").versions
