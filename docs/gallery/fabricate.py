"""Discs to print.

The discs of a robot with a winding tendon, each with its own hole, as solids for STL or STEP. Here
their upper faces, seen from the tip.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.continuum import Helix, RobotDesign, Section, Tendon
from bozzini.fabricate import build_body

tendon = Tendon(name="H", offset=3.5, angle=Helix(turns=0.5))
robot = RobotDesign([Section(length=30.0, radius=5.0, discs=5, tendons=[tendon])])
discs = build_body(robot)

figure, panels = plt.subplots(2, 3, figsize=(9.0, 6.0), layout="constrained")
for disc, place, axes in zip(discs, [0.0, *robot.disc_arc_length], panels.flat, strict=True):
    mesh = disc.mesh(0.1)
    top = mesh.faces[mesh.face_normals[:, 2] > 0.9]
    axes.tripcolor(*mesh.vertices.T[:2], top, np.zeros(len(top)), cmap="BuGn", vmin=-1.0, vmax=1.0)
    axes.set(title=f"at {place:g} mm", xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
