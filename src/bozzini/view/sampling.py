"""Steps of a plan worth drawing, and where along the tract each joint stands at them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..errors import InputError
from ..motion.plan import Plan
from .way import find_way

if TYPE_CHECKING:
    from ..duct.field import SampledField

__all__ = [
    "MotionSample",
    "check_plan",
    "find_link_length",
    "find_radius",
    "place_tightest",
    "sample_motion",
]


@dataclass(frozen=True, kw_only=True)
class MotionSample:
    """Some steps of a plan.

    Parameters
    ----------
    steps : (k,) int
        Which steps, in order.
    insertion : (k,) float
        Arc length of the head [mm].
    joints : (k, j, 3) float
        Joint positions [mm].
    clearance : (k, j - 1) float
        Clearance of each link [mm]: at the step, or the smallest since the step before.
    places : (k, j) float
        Arc length of the tract at which each joint stands [mm], along the centreline if the plan
        holds it; negative in the introducer.
    in_tract : (k, j - 1) bool
        Links whose front joint has entered the tract and whose clearance is known.
    """

    steps: NDArray[np.int64]
    insertion: NDArray[np.float64]
    joints: NDArray[np.float64]
    clearance: NDArray[np.float64]
    places: NDArray[np.float64]
    in_tract: NDArray[np.bool_]

    @property
    def visible(self) -> NDArray[np.float64]:
        """Clearance ``(k, j - 1)`` [mm] of the links in the tract, infinite elsewhere."""
        return np.where(self.in_tract, self.clearance, np.inf)

    @property
    def smallest(self) -> NDArray[np.float64]:
        """Smallest clearance ``(k,)`` [mm] over the links in the tract; infinite if none is."""
        result: NDArray[np.float64] = self.visible.min(axis=1)
        return result

    def find_tightest(self) -> tuple[int, int]:
        """Return row and link of the smallest clearance in the tract."""
        row, link = np.unravel_index(int(np.argmin(self.visible)), self.visible.shape)
        return int(row), int(link)


def check_plan(plan: Plan) -> None:
    """Raise `InputError` if the arrays of a plan are not finite or do not fit each other."""
    if plan.joints.shape[2] != 3:
        raise InputError(f"joints has shape {plan.joints.shape}: pictures need (steps, joints, 3)")
    count = len(plan.path)
    if plan.path.shape != (count, 3) or count < 2:
        raise InputError(f"path has shape {plan.path.shape}: it must be (m, 3) with m at least 2")
    for name in ("path_arc_length", "path_radius"):
        shape = getattr(plan, name).shape
        if shape != (count,):
            raise InputError(f"{name} has shape {shape}: it must be ({count},), one per path point")
    for name in ("joints", "head_arc_length", "path", "path_arc_length"):
        bad = int(np.count_nonzero(~np.isfinite(getattr(plan, name))))
        if bad:
            raise InputError(f"{name} of the plan has {bad} value(s) that are NaN or infinite")
    unknown = int(np.count_nonzero(np.isnan(plan.clearance) | np.isneginf(plan.clearance)))
    if unknown:
        raise InputError(f"clearance of the plan has {unknown} value(s) that are NaN or -infinite")


def find_link_length(plan: Plan) -> float:
    """Return the link length [mm], from the plan's record or else from its joints."""
    stated = _read_scope(plan).get("link_length_mm")
    if isinstance(stated, (int, float)) and stated > 0:
        return float(stated)
    return float(np.median(np.linalg.norm(np.diff(plan.joints[-1], axis=0), axis=-1)))


def find_radius(plan: Plan) -> float:
    """Return the scope's radius [mm] from the plan's record, 0 where it is not recorded."""
    stated = _read_scope(plan).get("diameter_mm")
    return 0.5 * float(stated) if isinstance(stated, (int, float)) and stated > 0 else 0.0


def _read_scope(plan: Plan) -> dict[str, object]:
    scope = plan.meta.get("scope")
    return scope if isinstance(scope, dict) else {}


def sample_motion(plan: Plan, *, count: int = 300, worst_between: bool = False) -> MotionSample:
    """Return at most about `count` steps of a plan, always with the first, last and tightest.

    Parameters
    ----------
    plan : Plan
    count : int
        Steps wanted, at least 2.
    worst_between : bool
        Give as clearance the smallest since the sampled step before, so that nothing is lost.

    Raises
    ------
    InputError
        If the plan's arrays do not fit each other, or `count` is below 2.
    """
    check_plan(plan)
    check_integer("count of sampled steps", count, low=2)
    steps = np.unique(np.linspace(0, plan.steps - 1, min(count, plan.steps)).astype(np.int64))
    entered = (
        plan.head_arc_length[:, None] - find_link_length(plan) * np.arange(plan.links) >= -1e-9
    )
    visible = np.where(entered, plan.clearance, np.inf)
    tightest = int(np.argmin(visible.min(axis=1)))
    steps = np.union1d(steps, [tightest])
    joints = plan.joints[steps]
    places = find_way(plan).place(_locate_joints(plan, joints, plan.head_arc_length[steps]))
    clearance = plan.clearance[steps]
    if worst_between:
        starts = np.concatenate([[0], steps[:-1] + 1])
        clearance = np.minimum.reduceat(plan.clearance, starts, axis=0)
    in_tract = (places[:, :-1] >= -1e-9) & np.isfinite(clearance)
    return MotionSample(
        steps=steps,
        insertion=plan.head_arc_length[steps],
        joints=joints,
        clearance=clearance,
        places=places,
        in_tract=in_tract,
    )


def place_tightest(sample: MotionSample, field: SampledField) -> NDArray[np.float64]:
    """Return where along the tract ``(k,)`` [mm] the tightest link of each step is tightest.

    The plan holds one clearance a link; the place on the link is looked up in the field.
    """
    rows = np.arange(len(sample.steps))
    link = np.argmin(sample.visible, axis=1)
    fractions = np.linspace(0.0, 1.0, 33)
    ends = (sample.joints[rows, link], sample.joints[rows, link + 1])
    points = ends[0][:, None] + fractions[:, None] * (ends[1] - ends[0])[:, None]
    front, back = sample.places[rows, link], sample.places[rows, link + 1]
    places = front[:, None] + fractions * (back - front)[:, None]
    distance = np.where(places >= 0.0, field.signed_distance(points), -np.inf)
    worst = np.argmax(distance, axis=1)
    result: NDArray[np.float64] = np.maximum(places[rows, worst], 0.0)
    return result


def _locate_joints(
    plan: Plan, joints: NDArray[np.float64], head: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the arc length nearest to each joint, each searched a little behind the one before.

    A chain cuts corners, so counting link lengths back from the head drifts; looking for the
    nearest point of the whole path could jump to a neighbouring limb.
    """
    length = find_link_length(plan)
    spacing = length / 10.0
    first = min(0.0, float(head.min())) - length * (joints.shape[1] + 2)
    arc = np.arange(first, float(plan.path_arc_length[-1]) + spacing, spacing)
    curve = np.stack(
        [np.interp(arc, plan.path_arc_length, plan.path[:, k]) for k in range(3)], axis=-1
    )
    behind = arc < plan.path_arc_length[0]
    curve[behind] = plan.path[0] + np.outer(
        plan.path_arc_length[0] - arc[behind], _find_entry_direction(plan, length)
    )
    window = np.arange(-30, 1)  # up to three link lengths back
    places = np.empty(joints.shape[:2])
    places[:, 0] = head
    last = np.clip(np.rint((head - first) / spacing).astype(np.int64), 0, len(arc) - 1)
    for k in range(1, joints.shape[1]):
        candidates = np.maximum(last[:, None] + window, 0)
        gap = ((curve[candidates] - joints[:, k, None, :]) ** 2).sum(axis=-1)
        last = candidates[np.arange(len(last)), np.argmin(gap, axis=1)]
        places[:, k] = arc[last]
    return places


def _find_entry_direction(plan: Plan, length: float) -> NDArray[np.float64]:
    """Return the unit vector out of the tract along the introducer."""
    outward = plan.joints[0, -1] - plan.path[0]
    if plan.head_arc_length[0] > length or not np.linalg.norm(outward) > 0.0:
        outward = plan.path[0] - plan.path[1]
    norm = float(np.linalg.norm(outward))
    return outward / norm if norm > 0.0 else np.array([0.0, 0.0, 1.0])
