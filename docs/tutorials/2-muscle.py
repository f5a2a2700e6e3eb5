# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 2 Measurements of a muscle to a model with intervals
#
# You have measured a pneumatic muscle: pressures, loads and contractions. You get the model that
# predicts it best, its constants with intervals, and a prediction with a band. It needs no extra.

# %%
import numpy as np
import pandas as pd

from bozzini import muscle
from bozzini.plot.muscle import draw_contraction, draw_ranking

# %% [markdown]
# ## Your table
#
# A row for each measurement; the unit is in the title. `kPa`, `psi`, `N`, `g` and `%` are
# converted. Here a muscle is made up, with known constants and errors of 0.05 mm.

# %%
truth = muscle.EnergyMuscle(muscle.preset("thesis-45", modulus=0.5, dead_length=8.0))
pressure, load = (grid.ravel() for grid in np.meshgrid(np.linspace(100, 800, 15), [0.0, 0.5]))
noise = np.random.default_rng(1).normal(0.0, 0.05, len(pressure))
contraction = truth.contraction(pressure / 1000.0, load) + noise
table = pd.DataFrame(
    {"pressure [kPa]": pressure, "load [N]": load, "contraction [mm]": contraction}
)
table.to_csv("my_muscle.csv", index=False)
table.head()

# %% [markdown]
# ## What the muscle is
#
# Dimensions as built: length, radius of the braid, braid angle, wall. `bozzini muscle
# presets` lists some to begin with.

# %%
mine = muscle.preset("thesis-45")
data = muscle.read_measurements("my_muscle.csv", muscle=mine)
print(len(data), "rows")
print(mine)

# %% [markdown]
# ## Which model?
#
# Each is fitted to the table and judged by rows that were left out. All models of the catalogue
# take a minute or two, so here are four.

# %%
some = {
    "energy": muscle.EnergyMuscle,
    "thesis": muscle.ThesisMuscle,
    "tondu-lopez": muscle.TonduLopez,
    "kothera-energy": muscle.KotheraEnergy,
}
ranking = muscle.rank(data, mine, models=some)
print(ranking.format_table())
draw_ranking(ranking)

# %% [markdown]
# Look at `left out` first: the error of rows that a fit did not see. `energy` errs by as much as
# the readings do, 0.05 mm, so there is nothing left to explain; the next is ten times worse.
# `weight` is its share of the evidence. `thesis` has no answer for the rows with a load.
#
# ## Its constants
#
# Two are free here. A constant that the data do not tell is named, rather than given.

# %%
fit = muscle.calibrate(muscle.EnergyMuscle, mine, data=data, free=("modulus", "dead_length"))
print(fit.format_table())
assert fit.intervals["modulus"][0] < 0.5 < fit.intervals["modulus"][1]  # the truth above

# %%
axes = draw_contraction(
    {"fitted": fit.fitted, "before": muscle.EnergyMuscle(mine)}, pressure=0.8, lowest=0.1
)
bare = table[table["load [N]"] == 0.0]
axes.plot(bare["pressure [kPa]"], bare["contraction [mm]"], "kx", label="measured")
axes.legend()
axes.figure

# %% [markdown]
# ## A prediction
#
# The fitted muscle is a file, for other commands as well. It is asked for states that it was not
# fitted to; the bar is where 95 % of new readings should be.

# %%
muscle.write_muscle("my_muscle.yaml", fit.to_file())
asked = pd.DataFrame({"pressure [kPa]": np.linspace(150, 750, 9), "load [N]": 0.25})
prediction = muscle.predict(muscle.read_muscle("my_muscle.yaml"), asked)
prediction.plot()
prediction.to_frame()

# %% [markdown]
# The same in commands:
#
#     bozzini muscle compare thesis-45 my_muscle.csv --model energy --model chou --fit
#     bozzini muscle fit thesis-45 my_muscle.csv \
#       --free modulus,dead-length --out fit.yaml --figure fit.png
#     bozzini muscle predict fit.yaml my_muscle.csv --out prediction.png
#
# Of a muscle that you bought, braid angle, wall and modulus are often unknown; they are fitted. A
# machine that holds the length measures forces, and the fit then predicts forces:
#
#     bozzini muscle fit festo-10 forces.csv --set inner_radius=4mm \
#       --free braid-angle,modulus,offset,compliance,slack-force --out festo.yaml
#     bozzini muscle predict festo.yaml --pressure 300kPa --contraction 5mm
