"""Which dimension matters?

Sobol indices of the area that a catheter tip reaches: the share of its variance that comes of each
dimension, alone and with all others.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from bozzini.study import Engine, Study, analyse_study

STUDY = """
format: bozzini-study-1
job: effector-design
fixed: {preset: prototype}
factors:
  offset: {range: [3 mm, 4 mm]}
  flexural_rigidity: {range: [100 N mm^2, 200 N mm^2]}
  muscle.braid_angle: {range: [35 deg, 37 deg]}
  muscle.modulus: {range: [0.5 MPa, 0.6 MPa]}
sampling: {method: saltelli, count: 1024, seed: 1}
outputs: [area]
"""
with TemporaryDirectory() as folder:
    file = Path(folder) / "study.yaml"
    file.write_text(STUDY)
    found = analyse_study(Study.load(file), Path(folder) / "rows", engine=Engine(workers=1))
figure = found.draw_indices()
