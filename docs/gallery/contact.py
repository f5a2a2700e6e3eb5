"""Soft and stiff rods in a bulb.

A rod is pushed through a bulb with an exit opposite, against a small resistance. The soft one is
caught in it, the stiff one passes.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.continuum import (
    ContactModel,
    ContactOptions,
    PointLoad,
    RobotDesign,
    Section,
    insert_robot,
)  # fmt: skip
from bozzini.duct import RoundCones, Union

way = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
path = np.array([[0, 0, -40.0], [0, 0, -28.0], [0, 0, 0], 28.0 * way, 110.0 * way])
bulb = RoundCones(np.array([[0, 0, 0], [0, 0, 0.01]]), [30.0, 30.0])
lumen = Union((RoundCones(path[:2], [4.0, 4.0]), bulb, RoundCones(path[2:], [8.0] * 3)))
resistance = PointLoad(force=(0.01, 0.005, -0.1), frame="world")  # [N]

figure, both = plt.subplots(2, 1, figsize=(8.0, 6.0), layout="constrained")
for axes, stiffness in zip(both, (50.0, 2000.0), strict=True):
    rod = RobotDesign((Section(length=140.0, radius=2.0, bending_stiffness=stiffness),))
    options = ContactOptions(segment_length=4.0)
    model = ContactModel(rod, lumen, loads=(resistance,), options=options)
    insert_robot(model, path, step=4.0).plot(axes)
    axes.set(title=f"EI {stiffness:g} N mm²", adjustable="box", ylim=(-45.0, 45.0))
