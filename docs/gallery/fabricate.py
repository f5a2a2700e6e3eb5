"""Discs to print.

The discs of a robot with a winding tendon, each with its own hole, as solids for STL or STEP.
"""

import matplotlib.pyplot as plt

from bozzini.continuum import Helix, RobotDesign, Section, Tendon
from bozzini.fabricate import build_body

tendon = Tendon(name="H", offset=3.5, angle=Helix(turns=0.5))
robot = RobotDesign([Section(length=30.0, radius=5.0, discs=5, tendons=[tendon])])
places = [0.0, *robot.disc_arc_length]

axes = plt.figure(figsize=(5.0, 6.0)).add_subplot(projection="3d")
for disc, place in zip(build_body(robot), places, strict=True):
    mesh = disc.mesh(0.3)
    x, y, z = mesh.vertices.T
    axes.plot_trisurf(x, y, z - z.min() + place, triangles=mesh.faces, color="tab:cyan")
axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
