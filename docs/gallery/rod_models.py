"""Three models of one loaded robot.

A force of 0.05 N across the tip: constant curvature knows nothing of it, `energy` and the rod do.
"""

import numpy as np

from bozzini.continuum import ArcModel, EnergyModel, RobotDesign, RodModel, Section, Tendon
from bozzini.plot.continuum import draw_comparison

tendons = tuple(Tendon(name=f"T{i + 1}", offset=4.0, angle=2.0 * np.pi * i / 3.0) for i in range(3))
robot = RobotDesign(
    (
        Section(
            length=120.0,
            radius=5.0,
            tendons=tendons,
            discs=8,
            bending_stiffness=800.0,
            torsional_stiffness=600.0,
        ),
    )
)
across = (0.05, 0.0, 0.0)  # [N]
pulled = [5.0, -2.5, -2.5]  # [mm]
shapes = {
    "arc": ArcModel(robot).shape(pulled),
    "energy": EnergyModel(robot, tip_force=across).shape(pulled),
    "rod": RodModel(robot, tip_force=across).shape(pulled),
}
figure = draw_comparison(shapes)
