"""Files to make a robot from: discs, sleeves, holders and fittings as STL and STEP.

Surfaces are closed by construction and need no other library. STEP files are made by Open CASCADE
(the extra ``cad``), which is loaded where it is used.
"""

from __future__ import annotations

from .effector import HolderOptions, build_holders, draw_template
from .files import write_body, write_holders
from .part import Channel, Part
from .robot import BodyOptions, Routing, build_body, tabulate_routing
from .step import write_step

__all__ = [
    "BodyOptions",
    "Channel",
    "HolderOptions",
    "Part",
    "Routing",
    "build_body",
    "build_holders",
    "draw_template",
    "tabulate_routing",
    "write_body",
    "write_holders",
    "write_step",
]


def __dir__() -> list[str]:
    return sorted(__all__)
