"""The summary of a plan: what ``--json`` prints and ``summary.json`` holds."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..duct import Centreline, SampledField
from ..motion import Plan
from ..motion.measures import measure_displacement

__all__ = ["summarise_plan"]


def summarise_plan(plan: Plan, field: SampledField, line: Centreline) -> dict[str, Any]:
    """Return a plan's summary as JSON-able values.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen it was made in.
    line : Centreline
        The way to the goal.
    """
    measures, certificate = plan.meta["measures"], plan.meta["certificate"]
    inside = bool(np.isfinite(plan.clearance).any())
    narrow = int(np.argmin(line.radius))
    summary: dict[str, Any] = {
        "method": plan.method,
        "status": plan.status,
        "reason": plan.reason,
        "reason_code": plan.reason_code,
        "certified": bool(plan.meta["certified"]),
        # A bound below zero proves nothing, and is loose outside the lumen: no number to quote.
        "clearance_certified_mm": certificate["clearance_mm"] if plan.meta["certified"] else None,
        "stopped_at_mm": plan.inserted if plan.status == "stopped" else None,
        "centreline_length_mm": line.length,
        "inserted_mm": plan.inserted,
        "steps": plan.steps,
        "links": plan.links,
        "clearance_min_mm": measures["clearance_min_mm"] if inside else None,
        "clearance_where_mm": measures["clearance_where_mm"] if inside else None,
        "clearance_insertion_mm": measures["clearance_insertion_mm"] if inside else None,
        "clearance_error_mm": plan.meta["field"]["clearance_error_mm"],
        "joint_step_max_mm": measures["joint_step_max_mm"],
        "joint_step_ratio_max": measures["joint_step_ratio_max"],
        "head_step_mm": plan.meta["head_step_mm"],
        "joint_angle_max_rad": measures["joint_angle_max_rad"],
        "joint_travel_mm": measures["joint_travel_mm"],
        "displacement_ratio": measure_displacement(plan),
        "radius_min_mm": float(line.radius[narrow]),
        "radius_min_where_mm": float(line.arc_length[narrow]),
        "wall": plan.meta["wall"],
        "wall_error_mm": field.wall_error,
        "voxel_mm": [float(h) for h in field.spacing],
        "inflation_mm": field.inflation,
        "scope": plan.meta["scope"],
    }
    for key in ("refusal", "soft_wall", "candidates", "input"):
        if key in plan.meta and plan.meta[key] is not None:
            summary[key] = plan.meta[key]
    return summary
