"""A design study.

Two thousand catheter tips: which offset of the muscles and which rigidity need which pressure.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from bozzini.plot.study import draw_map
from bozzini.study import Engine, Study, run_study

STUDY = """
format: bozzini-study-1
job: effector-design
fixed: {preset: prototype, deflection: 12 mm, pressure_limit: 0.827 MPa}
factors:
  offset: {range: [2.5 mm, 4.5 mm], levels: 40}
  flexural_rigidity: {range: [50 N mm^2, 400 N mm^2], levels: 50}
sampling: {method: grid}
outputs: [needed_pressure]
"""
with TemporaryDirectory() as folder:
    file = Path(folder) / "study.yaml"
    file.write_text(STUDY)
    rows = run_study(Study.load(file), Path(folder) / "rows", engine=Engine(workers=1)).read()
figure = draw_map(rows, ["offset_mm", "flexural_rigidity_Nmm2", "needed_pressure_MPa"])
