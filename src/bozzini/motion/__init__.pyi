from .approach import Approach, find_approaches
from .branches import TreeReach, TreeReachOptions, reach_tree
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
    "Approach",
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
    "TreeReach",
    "TreeReachOptions",
    "Verification",
    "certify_motion",
    "certify_plan",
    "find_approaches",
    "find_diameter_limits",
    "find_largest",
    "find_link_limits",
    "find_passage",
    "follow_tissue",
    "move_free_chain",
    "place_tail",
    "plan_insertion",
    "plan_with_soft_wall",
    "reach_tree",
    "replan",
    "verify_file",
    "verify_plan",
]
