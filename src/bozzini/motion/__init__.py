"""Motion: how a scope moves through a duct (thesis 5.3), and what is proved about it."""

from __future__ import annotations

from .certify import Certificate, certify_motion, certify_plan
from .insertion import METHODS, plan_insertion
from .introducer import Introducer
from .largest import Largest, find_largest
from .link import LinkPlacement, place_tail
from .passage import Passage, find_passage
from .plan import Plan
from .refusal import REASON_CODES, Refusal
from .replan import plan_with_soft_wall, replan
from .scope import Scope
from .tractrix import move_free_chain
from .traverse import LinkLimits, find_diameter_limits, find_link_limits
from .traverse_bend import Bend
from .tube import TubeOptions
from .verify import Verification, verify_file, verify_plan

__all__ = [
    "METHODS",
    "REASON_CODES",
    "Bend",
    "Certificate",
    "Introducer",
    "Largest",
    "LinkLimits",
    "LinkPlacement",
    "Passage",
    "Plan",
    "Refusal",
    "Scope",
    "TubeOptions",
    "Verification",
    "certify_motion",
    "certify_plan",
    "find_diameter_limits",
    "find_largest",
    "find_link_limits",
    "find_passage",
    "move_free_chain",
    "place_tail",
    "plan_insertion",
    "plan_with_soft_wall",
    "replan",
    "verify_file",
    "verify_plan",
]
