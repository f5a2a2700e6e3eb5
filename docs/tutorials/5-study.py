# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 5 A design study on all cores
#
# Which pressure does a tip need that bends by 12 mm, how far from the backbone should its muscles
# be, and how stiff may that be? From a file to many thousand designs, and to the best of them.
# This needs the extra `tables`: `pip install 'bozzini[tables]'`.

# %%
from pathlib import Path

from bozzini.plot.study import draw_map, draw_parallel, draw_pareto
from bozzini.study import Engine, Study, run_study

# %% [markdown]
# ## The study file
#
# What is fixed, what varies, and what is kept. `bozzini new study` writes one with comments;
# `bozzini study jobs` lists what a row can be.

# %%
Path("study.yaml").write_text(
    """
format: bozzini-study-1
job: effector-design
fixed: {preset: prototype, deflection: 12 mm, pressure_limit: 0.827 MPa}
factors:
  offset: {range: [2.5 mm, 4.5 mm]}
  flexural_rigidity: {range: [50 N mm^2, 400 N mm^2], scale: log}
  muscle.braid_angle: {normal: [36 deg, 0.5 deg], clip: [34 deg, 38 deg]}
  muscle.modulus: {normal: [0.56 MPa, 0.03 MPa], clip: [0.4 MPa, 0.7 MPa]}
sampling: {method: sobol, count: 16384, seed: 7}
outputs: [needed_pressure, area, inner_radius]
constraints: {inner_radius: {at_least: 5 mm}}
""",
    encoding="utf-8",
)
study = Study.load("study.yaml")
print(study.rows, "rows:", ", ".join(study.columns))

# %% [markdown]
# ## Run it
#
# A process for each core, or `Engine(cluster="scheduler.json")` for a Dask cluster. Rows do not
# depend on it. What is interrupted goes on by the same call.

# %%
result = run_study(study, "results", engine=Engine())
print(result.done, "rows,", result.feasible, "feasible")
result.plot()

# %% [markdown]
# ## Look
#
# The results are Parquet files, which pandas and Polars read as they are.

# %%
rows = result.read()
rows.describe()

# %%
draw_map(rows, ["offset_mm", "flexural_rigidity_Nmm2", "needed_pressure_MPa"])

# %%
draw_pareto(rows, ["needed_pressure_MPa", "-area_mm2"])

# %%
draw_parallel(rows.head(400), ["offset_mm", "flexural_rigidity_Nmm2", "needed_pressure_MPa"])

# %% [markdown]
# ## The answer
#
# A design is good if its pressure is enough also where the muscles come out badly. So the designs
# are put into classes of offset and rigidity; in each the muscles scatter, and one that is not
# feasible needs an infinite pressure.

# %%
offset = (2.0 * rows["offset_mm"]).round() / 2.0
rigidity = (rows["flexural_rigidity_Nmm2"] / 50.0).round() * 50.0
pressure = rows["needed_pressure_MPa"].where(rows["feasible"], float("inf"))
needed = pressure.groupby([offset, rigidity]).quantile(0.95, interpolation="higher").unstack()
axes = needed.plot(marker="o")
axes.set(xlabel="offset of the muscles [mm]", ylabel="pressure enough for 95 % [MPa]")
needed

# %% [markdown]
# So the rigidity decides, and the offset hardly: a soft backbone wants its muscles near, a
# stiffer one at 3 to 4 mm, and one of 300 N mm² or more is too stiff. What of the scatter comes
# from modulus and what from braid angle is told by [`bozzini
# uncertainty`](../guide/studies.md#what-an-output-is-uncertain-by).
#
# The same in commands:
#
#     bozzini study run study.yaml --out results
#     bozzini study show results --figure pareto \
#       --columns needed_pressure_MPa,-area_mm2 --out front.png
