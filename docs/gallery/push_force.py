"""The force that pushes a robot in.

An elastic robot is pushed round a bend of 40 mm; each place of the wall presses back.
"""

import numpy as np

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    DriveTable,
    RobotDesign,
    Section,
    Tendon,
    insert_robot,
)
from bozzini.duct import RoundCones

turn = np.linspace(0.0, np.pi / 2.0, 25)
bend = 40.0 * np.stack([1.0 - np.cos(turn), 0.0 * turn, np.sin(turn)], axis=1)
path = np.concatenate([[[0.0, 0.0, -30.0]], bend, [[70.0, 0.0, 40.0]]])
lumen = RoundCones(path, np.full(len(path), 8.0))

tendons = tuple(Tendon(name=f"T{k}", offset=2.5, angle=k * np.pi / 2.0) for k in range(4))
section = Section(length=70.0, radius=3.0, tendons=tendons, bending_stiffness=500.0)
robot = RobotDesign((section,))
model = ContactModel(robot, lumen, options=ContactOptions(segment_length=5.0))
found = insert_robot(model, path, drives=DriveTable.passive(robot, 60.0), step=2.0)
axes = found.plot_force()
