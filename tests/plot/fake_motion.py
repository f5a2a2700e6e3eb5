"""A straight round tract along a chosen direction, and a scope that slides down its middle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bozzini.duct.field import SampledField
from bozzini.motion.plan import Plan

START, END = np.array([10.0, -20.0, 60.0]), np.array([10.0, -20.0, -20.0])


def make_field(
    *,
    start: NDArray[np.float64] = START,
    end: NDArray[np.float64] = END,
    radius: float = 6.0,
    rotation: NDArray[np.float64] | None = None,
    spacing: tuple[float, float, float] = (1.5, 1.5, 1.5),
    inflation: float = 0.0,
) -> SampledField:
    """Return the field of a capsule from `start` to `end`, on a grid of any orientation."""
    rotation = np.eye(3) if rotation is None else rotation
    step = np.array(spacing)
    ends = np.stack([start, end]) @ rotation
    low, high = ends.min(axis=0) - radius - 12.0, ends.max(axis=0) + radius + 12.0
    count = np.ceil((high - low) / step).astype(int) + 1
    nodes = low + step * np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1)
    along = ends[1] - ends[0]
    share = np.clip((nodes - ends[0]) @ along / (along @ along), 0.0, 1.0)
    distance = np.linalg.norm(nodes - ends[0] - share[..., None] * along, axis=-1) - radius
    return SampledField(
        values=distance.astype(np.float32),
        spacing=step,
        origin=rotation @ low,
        rotation=rotation,
        inflation=inflation,
        wall="a drawn capsule",
    )


def make_plan(
    *,
    radius: float = 2.0,
    link_length: float = 8.0,
    links: int = 10,
    steps: int = 41,
    reach: float = 80.0,
    first: float = 0.0,
    dent: float = 0.0,
    status: str = "complete",
    meta: dict[str, object] | None = None,
) -> Plan:
    """Return a scope on the axis of the capsule; `dent` takes clearance away at 40 mm."""
    direction = (END - START) / np.linalg.norm(END - START)
    head = np.linspace(first, reach, steps) if steps > 1 else np.array([reach])
    place = head[:, None] - link_length * np.arange(links + 1)
    joints = START + place[..., None] * direction
    covers = (place[:, :-1] >= 40.0) & (place[:, 1:] < 40.0)
    clearance = np.where(covers, 6.0 - radius - dent, 6.0 - radius)
    clearance[place[:, :-1] <= 0.0] = np.inf
    arc = np.linspace(0.0, 80.0, 81)
    stopped = status == "stopped"
    meta = {"scope": {"diameter_mm": 2.0 * radius, "link_length_mm": link_length}, **(meta or {})}
    return Plan.from_meta(
        meta,
        joints=joints,
        head_arc_length=head,
        clearance=clearance,
        path=START + arc[:, None] * direction,
        path_arc_length=arc,
        path_radius=np.full(81, 6.0),
        method="thesis",
        status=status,
        reason_code="LOCKED" if stopped else "",
        reason="link 3 is locked" if stopped else "",
    )


def make_line(reach: float = 80.0) -> dict[str, object]:
    """Return the whole centreline as a plan's file holds it; it narrows to 1 mm at 70 mm."""
    arc = np.linspace(0.0, reach, int(reach) + 1)
    direction = (END - START) / np.linalg.norm(END - START)
    return {
        "points_mm": (START + arc[:, None] * direction).tolist(),
        "arc_length_mm": arc.tolist(),
        "radius_mm": np.where(np.abs(arc - 70.0) < 3.0, 1.0, 6.0).tolist(),
    }


def make_stopped(reach: float = 50.0, **changes: object) -> Plan:
    """Return a certified plan that ends on the way, its path cut there, refused at 70 mm."""
    meta = {
        "certified": True,
        "certificate": {"clearance_mm": 3.456},
        "centreline": make_line(),
        "refusal": {"code": "NO_PASSAGE", "at_mm": 70.0, "needs_mm": 2.0, "offers_mm": 1.0},
        **changes,
    }
    plan = make_plan(reach=reach, status="stopped", meta=meta)
    keep = plan.path_arc_length <= reach
    return replace(
        plan,
        method="tube",
        path=plan.path[keep],
        path_arc_length=plan.path_arc_length[keep],
        path_radius=plan.path_radius[keep],
    )


def make_summary(plan: Plan) -> dict[str, object]:
    """Return what the command prints for such a plan."""
    return {
        "method": plan.method,
        "status": plan.status,
        "reason": plan.reason,
        "certified": False,
        "stopped_at_mm": plan.inserted if plan.status == "stopped" else None,
        "centreline_length_mm": 80.0,
        "inserted_mm": plan.inserted,
        "steps": plan.steps,
        "links": plan.links,
        "clearance_min_mm": plan.clearance_min,
        "clearance_where_mm": 40.0,
        "joint_step_max_mm": 0.437,
        "head_step_mm": 0.25,
        "joint_angle_max_rad": 0.5,
        "seconds": {"read": 0.25, "plan": 1.5},
    }
