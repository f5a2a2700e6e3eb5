# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 5 A design study on all cores
#
# Which muscles, how far from the backbone, for a tip that bends by 12 mm? From one design to many
# thousand, to the best ones, and to how sure the answer is.

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
Path("study.yaml").write_text("""
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
""")
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
# The same in commands:
#
#     bozzini study run study.yaml --out results
#     bozzini study show results --figure pareto --columns needed_pressure_MPa,-area_mm2
