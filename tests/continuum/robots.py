"""Robots that the tests of continuum robots share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from hypothesis import strategies as st

from bozzini.continuum import ContinuumRobot, Section, Tendon

__all__ = ["QUARTER", "ROBOT_FILE", "THIRD", "antagonistic_robots", "make_robot"]

QUARTER = (0.0, 90.0, 180.0, 270.0)
THIRD = (0.0, 120.0, 240.0)

ROBOT_FILE = """\
name: two sections
sections:
  - name: base
    length: 6 cm
    radius: 7 mm
    discs: 6
    bending_stiffness: 1e-3 N m^2
    max_bend: 120 deg
    tendons:
      - {name: a1, offset: 5 mm, angle: 0 deg, travel: [-10 mm, null]}
      - {name: a2, offset: 5 mm, angle: 120 deg}
      - {name: a3, offset: 0.5 cm, angle: 240 deg}
  - length: 40
    radius: 6
    disc_positions: [10, 2.5 cm, 40]
    tendons:
      - {name: h, offset: [[0, 6 mm], [10 cm, 2 mm]], angle: {start: 10 deg, turns: 1}}
      - {name: b, offset: 5mm, angle: 90deg, pushes: true, end: 80, interpolation: cubic}
"""


def make_robot(
    *sections: Sequence[float],
    length: float = 100.0,
    offset: float = 4.0,
    pushes: bool = False,
    **fields: Any,
) -> ContinuumRobot:
    """A robot of equal sections, each given by its tendons' angles in degrees."""
    return ContinuumRobot(
        tuple(
            Section(
                length=length,
                radius=1.5 * offset,
                tendons=tuple(
                    Tendon(name=f"t{i}{k}", offset=offset, angle=math.radians(angle), pushes=pushes)
                    for k, angle in enumerate(angles)
                ),
                **fields,
            )
            for i, angles in enumerate(sections)
        )
    )


@st.composite
def antagonistic_robots(draw: st.DrawFn) -> ContinuumRobot:
    """Robots of 1 to 4 sections with 3 or 4 tendons each, of any stiffness and offset."""
    sections = []
    for index in range(draw(st.integers(1, 4))):
        count = draw(st.sampled_from([3, 4]))
        first = draw(st.floats(-180.0, 180.0))
        offsets = [draw(st.floats(1.0, 5.0)) for _ in range(count)]
        sections.append(
            Section(
                length=draw(st.floats(20.0, 150.0)),
                radius=5.0,
                discs=draw(st.integers(1, 8)),
                bending_stiffness=draw(st.floats(10.0, 1e4)),
                tendons=tuple(
                    Tendon(
                        name=f"t{index}{k}",
                        offset=offsets[k],
                        angle=math.radians(first + 360.0 * k / count),
                    )
                    for k in range(count)
                ),
            )
        )
    return ContinuumRobot(tuple(sections))
