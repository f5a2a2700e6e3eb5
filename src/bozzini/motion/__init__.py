"""Motion: how a scope moves through a duct (thesis 5.3), and what is proved about it."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .certify import Certificate, certify_motion
    from .largest import Largest, find_largest
    from .link import LinkPlacement, move_free_chain, place_tail
    from .live import LiveFrame, LiveOptions, LiveRun, follow_tissue
    from .moving import ReplanOptions, plan_with_soft_wall, replan
    from .plan import Plan
    from .planner import Motion, Planner, plan_insertion
    from .planners import PLANNERS, PlannerOptions
    from .refusal import REASON_CODES, Refusal
    from .scope import Introducer, Scope
    from .space import FreeSpace, Passage, find_passage
    from .traverse import LinkLimits, find_diameter_limits, find_link_limits
    from .verify import Verification, certify_plan, verify_file, verify_plan

__all__ = [
    "PLANNERS",
    "REASON_CODES",
    "Certificate",
    "FreeSpace",
    "Introducer",
    "Largest",
    "LinkLimits",
    "LinkPlacement",
    "LiveFrame",
    "LiveOptions",
    "LiveRun",
    "Motion",
    "Passage",
    "Plan",
    "Planner",
    "PlannerOptions",
    "Refusal",
    "ReplanOptions",
    "Scope",
    "Verification",
    "certify_motion",
    "certify_plan",
    "find_diameter_limits",
    "find_largest",
    "find_link_limits",
    "find_passage",
    "follow_tissue",
    "move_free_chain",
    "place_tail",
    "plan_insertion",
    "plan_with_soft_wall",
    "replan",
    "verify_file",
    "verify_plan",
]

_PLACES = {
    "certify": ("Certificate", "certify_motion"),
    "largest": ("Largest", "find_largest"),
    "live": ("LiveFrame", "LiveOptions", "LiveRun", "follow_tissue"),
    "link": ("LinkPlacement", "move_free_chain", "place_tail"),
    "plan": ("Plan",),
    "planner": ("Motion", "Planner", "plan_insertion"),
    "planners": ("PLANNERS", "PlannerOptions"),
    "refusal": ("REASON_CODES", "Refusal"),
    "moving": ("ReplanOptions", "plan_with_soft_wall", "replan"),
    "scope": ("Introducer", "Scope"),
    "space": ("FreeSpace", "Passage", "find_passage"),
    "traverse": ("LinkLimits", "find_diameter_limits", "find_link_limits"),
    "verify": ("Verification", "certify_plan", "verify_file", "verify_plan"),
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
