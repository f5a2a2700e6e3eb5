"""Motion: how a scope moves through a duct (thesis 5.3), and what is proved about it."""

from __future__ import annotations

from .certify import Certificate, certify_motion, certify_plan
from .insertion import METHODS, plan_insertion
from .introducer import Introducer
from .largest import Largest, find_largest
from .passage import Passage, find_passage
from .plan import Plan
from .refusal import REASON_CODES, Refusal
from .replan import replan
from .scope import Scope
from .soft import plan_with_soft_wall
from .tractrix import move_free_chain
from .tube import TubeOptions

__all__ = [
    "METHODS",
    "REASON_CODES",
    "Certificate",
    "Introducer",
    "Largest",
    "Passage",
    "Plan",
    "Refusal",
    "Scope",
    "TubeOptions",
    "certify_motion",
    "certify_plan",
    "find_largest",
    "find_passage",
    "move_free_chain",
    "plan_insertion",
    "plan_with_soft_wall",
    "replan",
]
