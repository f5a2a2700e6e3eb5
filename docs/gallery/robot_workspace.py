"""Where a tendon robot reaches.

The places of the tip of a robot of two sections, and in how many directions it can point there.
"""

import bozzini as bz
from bozzini.continuum import Section, Tendon


def make_section(length, names, *, limit):
    tendons = [
        Tendon(name=name, offset=4.0, angle=2.0943951 * k) for k, name in enumerate(names)
    ]  # 120 degrees apart
    return Section(length=length, radius=5.0, tendons=tuple(tendons), max_bend=limit)


robot = bz.ContinuumRobot(
    [make_section(80.0, "ABC", limit=1.5), make_section(50.0, "DEF", limit=2.5)]
)
axes = robot.workspace().plot()
