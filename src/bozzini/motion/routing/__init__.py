"""Robots designed for a tract: routings that hold one shape, what the way in takes, sections."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .design import RoutingDesign, design_routing
    from .options import InsertionRankOptions, RobotSearch
    from .rank import InsertionRank, insertion_rank
    from .tract import TractRobot, design_robot

__all__ = [
    "InsertionRank",
    "InsertionRankOptions",
    "RobotSearch",
    "RoutingDesign",
    "TractRobot",
    "design_robot",
    "design_routing",
    "insertion_rank",
]

_PLACES = {
    "design": ("RoutingDesign", "design_routing"),
    "options": ("InsertionRankOptions", "RobotSearch"),
    "rank": ("InsertionRank", "insertion_rank"),
    "tract": ("TractRobot", "design_robot"),
}
"""Modules and the public names in them: none is loaded before it is asked for."""


def __getattr__(name: str) -> object:
    """Load a public name when it is first asked for (PEP 562)."""
    for module, names in _PLACES.items():
        if name in names:
            value: object = getattr(import_module(f".{module}", __name__), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
