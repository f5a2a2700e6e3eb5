"""A tendon robot of two sections.

Its shape from the displacements of six tendons, by constant curvature.
"""

import numpy as np

import bozzini as bz
from bozzini.continuum import Section, Tendon


def tendons(names, first):
    angles = first + np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
    return tuple(Tendon(name=n, offset=4.0, angle=a) for n, a in zip(names, angles, strict=True))


robot = bz.ContinuumRobot(
    [
        Section(length=60.0, radius=5.0, tendons=tendons(["T1", "T2", "T3"], 0.0)),
        Section(length=40.0, radius=5.0, tendons=tendons(["T4", "T5", "T6"], np.pi / 6.0)),
    ]
)
shape = robot.forward([3.0, -1.5, -1.5, -2.0, 3.0, 4.0])
axes = shape.plot()
