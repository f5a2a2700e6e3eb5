"""What figures and reports read of a plan: its centreline, sampled motion, clearance, methods.

The summary of a run is a mapping that may lack any number: it is read here once, with the plan,
into typed objects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, floor_mm
from ..errors import InputError
from ..motion.measures import measure_displacement
from ..motion.plan import Measures, Plan
from ..motion.refusal import needs_mm
from ..numeric.arrays import Floats
from ..results import Json

if TYPE_CHECKING:
    from ..duct.field import SampledField

Record = Mapping[str, object]
"""A summary or a part of it; any number may be missing."""

# Numbers out of records that may lack them.


def read_number(values: Record, key: str) -> float | None:
    """Return a finite number from a record, None where there is none."""
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if math.isfinite(value) else None


def read_part(values: Record, key: str) -> Record:
    """Return a record inside a record, an empty one where there is none."""
    part = values.get(key)
    return part if isinstance(part, Mapping) else {}


def read_parts(values: Record, key: str) -> list[Record]:
    """Return the records in a list inside a record, [] where there is none."""
    parts = values.get(key)
    if isinstance(parts, str) or not isinstance(parts, Sequence):
        return []
    return [part for part in parts if isinstance(part, Mapping)]


# The centreline to the goal, and where on it a plan's head path and its refusal lie.
#
# A planner bends the head's path for the length of the links, and may end it before the goal.
# Places along the tract are arc lengths of the centreline, which all plans of a tract share.

_MATCHED = 800


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanCentreline:
    """The centreline of a plan from the entry to the goal.

    Parameters
    ----------
    points : (m, 3) float
        The centreline, or the head's path where the plan holds no centreline [mm].
    arc_length, radius : (m,) float
        Arc length from the entry and inscribed radius of the lumen [mm].
    path_arc_length, path_place : (n,) float
        Arc length along the head's path, and the arc length of the centreline beside it [mm].
    is_centreline : bool
        Whether this is the whole centreline.
    """

    points: Floats
    arc_length: Floats
    radius: Floats
    path_arc_length: Floats
    path_place: Floats
    is_centreline: bool

    @property
    def length(self) -> float:
        """Length of the centreline [mm]."""
        return float(self.arc_length[-1])

    def to_centreline(self, arc: ArrayLike) -> Floats:
        """Turn arc length along the head's path [mm] into that of the centreline.

        Before the entry both count alike, so what is in the introducer stays negative.
        """
        values = np.asarray(arc, dtype=np.float64)
        inside = np.interp(values, self.path_arc_length, self.path_place)
        before = values - self.path_arc_length[0] + self.path_place[0]
        return np.where(values < self.path_arc_length[0], before, inside)

    def point_at(self, place: float) -> Floats:
        """Return the world point ``(3,)`` at an arc length of the centreline [mm]."""
        return np.array([np.interp(place, self.arc_length, axis) for axis in self.points.T])

    def points_beyond(self, place: float) -> Floats:
        """Return the points ``(k, 3)`` from an arc length of the centreline [mm] to the goal."""
        rest = self.points[self.arc_length > place]
        return np.concatenate([self.point_at(place)[None], rest]) if len(rest) else rest


@dataclass(frozen=True, kw_only=True)
class RefusalMark:
    """Where a planner refused to go on.

    Parameters
    ----------
    code : str
        The reason code.
    at : float
        Arc length of the centreline [mm].
    needs, offers : float or None
        Clearance needed and clearance there, from the scope's axis to the wall [mm].
    """

    code: str
    at: float
    needs: float | None
    offers: float | None

    @property
    def text(self) -> str:
        """The refusal in a few words."""
        if self.needs is None or self.offers is None or self.needs <= self.offers:
            return f"refused at {self.at:.0f} mm"
        offers = f"{floor_mm(self.offers)} mm" if self.offers > 0.0 else "none"
        needs = needs_mm(self.needs, self.offers)
        return f"refused at {self.at:.0f} mm: needs {needs}, offers {offers}"


def find_refusal(plan: Plan, summary: Record | None = None) -> RefusalMark | None:
    """Return where and why a plan ends before the goal, None where that was not recorded."""
    if plan.status != "stopped":
        return None
    record = read_part(summary or {}, "refusal")
    own = plan.refusal
    if read_number(record, "at_mm") is None and own is not None:
        record = {
            "code": own.code, "at_mm": own.at, "needs_mm": own.needs, "offers_mm": own.offers
        }  # fmt: skip
    at = read_number(record, "at_mm")
    if at is None:
        return None
    return RefusalMark(
        code=str(record.get("code") or plan.reason_code),
        at=at,
        needs=read_number(record, "needs_mm"),
        offers=read_number(record, "offers_mm"),
    )


def share_centreline(plans: Sequence[Plan]) -> list[Plan]:
    """Give plans without a centreline that of the others, so that places mean the same."""
    lines = [plan.centreline for plan in plans if plan.centreline is not None]
    if not lines:
        return list(plans)
    return [replace(plan, centreline=plan.centreline or lines[0]) for plan in plans]


def read_centreline(plan: Plan) -> PlanCentreline:
    """Return the centreline of a plan, or else the path of its head."""
    arc = plan.path_arc_length
    line = _parse_centreline(plan)
    if line is None:
        return PlanCentreline(
            points=plan.path,
            arc_length=arc,
            radius=plan.path_radius,
            path_arc_length=arc,
            path_place=arc,
            is_centreline=False,
        )
    points, arc_length, radius = line
    chosen = _thin(len(plan.path))
    places = _match(plan.path[chosen], points, arc_length)
    return PlanCentreline(
        points=points,
        arc_length=arc_length,
        radius=radius,
        path_arc_length=arc[chosen],
        path_place=places,
        is_centreline=True,
    )


def _parse_centreline(plan: Plan) -> tuple[Floats, Floats, Floats] | None:
    line = plan.centreline
    if line is None or line.points.shape[1] != 3 or not (np.diff(line.arc_length) > 0.0).all():
        return None
    return line.points, line.arc_length, line.radius


def _thin(count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, count - 1, min(count, _MATCHED)).astype(np.int64))


def _match(path: Floats, points: Floats, arc_length: Floats) -> Floats:
    """Return the place ``(n,)`` of path points on a curve that only goes forward.

    The order-keeping assignment with the least sum of squared gaps, by dynamic programming: it
    does not jump to a neighbouring limb as the nearest point would.
    """
    chosen = _thin(len(points))
    gaps = ((path[:, None] - points[None, chosen]) ** 2).sum(axis=-1)
    cost = np.where(np.arange(len(chosen)) == 0, gaps[0], np.inf)  # both start at the entry
    before = np.zeros(gaps.shape, dtype=np.int64)
    for k in range(1, len(path)):
        best = np.minimum.accumulate(cost)
        rises = np.concatenate([[True], cost[1:] < best[:-1]])
        before[k] = np.maximum.accumulate(np.where(rises, np.arange(len(cost)), 0))
        cost = best + gaps[k]
    index = np.zeros(len(path), dtype=np.int64)
    index[-1] = int(np.argmin(cost))
    for k in range(len(path) - 1, 0, -1):
        index[k - 1] = before[k, index[k]]
    result: Floats = arc_length[chosen[index]]
    return result


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
    """Return the length of a link [mm], of the plan's scope or else of its joints."""
    if plan.scope is not None:
        return plan.scope.link_length
    return float(np.median(np.linalg.norm(np.diff(plan.joints[-1], axis=0), axis=-1)))


def find_radius(plan: Plan) -> float:
    """Return the radius of a plan's scope [mm], 0 where it is not stated."""
    return 0.0 if plan.scope is None else plan.scope.radius


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
    places = read_centreline(plan).to_centreline(
        _locate_joints(plan, joints, plan.head_arc_length[steps])
    )
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


# The clearance of a plan: proved or estimated, against which wall, and with what contact.


@dataclass(frozen=True, kw_only=True)
class WallContact:
    """How far a soft wall may be displaced, and the contact with it.

    Parameters
    ----------
    allowed, used : float
        How far the wall may be displaced, and how far it was for the motion to be proved [mm].
    contact : float
        Deepest contact: how far the body stands beyond the wall at rest [mm], 0 if nowhere.
    place : float or None
        Arc length along the tract of the deepest contact [mm].
    """

    allowed: float
    used: float
    contact: float
    place: float | None


@dataclass(frozen=True, kw_only=True)
class PlanClearance:
    """The clearance of a plan: proved or estimated, and against which wall.

    Parameters
    ----------
    certified : bool
        Whether it is proved that the body keeps off the wall at all times.
    proved : float or None
        Proved lower bound of the clearance [mm]; None where nothing is proved.
    estimate : float or None
        Smallest clearance at sampled points and recorded steps, to the wall at rest [mm].
    place : float or None
        Arc length along the tract of the estimate [mm].
    inflation : float
        How far the wall was moved outwards for all of this [mm].
    soft : WallContact or None
        Set where the wall was allowed to give way and had to.
    """

    certified: bool
    proved: float | None
    estimate: float | None
    place: float | None
    inflation: float
    soft: WallContact | None


def read_clearance(plan: Plan, summary: Record) -> PlanClearance:
    """Return the clearance of a plan by its certificate, summary and arrays.

    Parameters
    ----------
    plan : Plan
    summary : mapping
        The summary of the run; what it lacks is taken from the plan.
    """
    certified = bool(summary.get("certified", plan.certified))
    proved = read_number(summary, "clearance_certified_mm")
    if proved is None and plan.certificate is not None:
        proved = plan.certificate.clearance if math.isfinite(plan.certificate.clearance) else None
    estimate = read_number(summary, "clearance_min_mm")
    place = read_number(summary, "clearance_where_mm")
    if estimate is None:
        sample = sample_motion(plan, count=400, worst_between=True)
        row, link = sample.find_tightest()
        if sample.in_tract[row, link]:
            estimate = float(sample.clearance[row, link])
            place = max(0.0, float(sample.places[row, link : link + 2].mean()))
    soft = _read_soft_wall(plan, summary, estimate, place)
    inflation = read_number(summary, "inflation_mm")
    if inflation is None:
        inflation = plan.inflation - (0.0 if soft is None else soft.used)
    return PlanClearance(
        certified=certified,
        proved=proved if certified else None,
        estimate=estimate,
        place=place,
        inflation=max(0.0, inflation),
        soft=soft,
    )


def _read_soft_wall(
    plan: Plan, summary: Record, estimate: float | None, place: float | None
) -> WallContact | None:
    record, own = read_part(summary, "soft_wall"), plan.soft_wall
    if not record and own is not None:
        record = {
            "allowed_mm": own.allowed,
            "used_mm": own.used,
            "contact_max_mm": own.contact_max,
            "contact_where_mm": own.contact_where,
        }
    if not record:
        return None
    allowed = read_number(record, "allowed_mm") or 0.0
    used = read_number(record, "used_mm")
    used = allowed if used is None else used
    if used <= 0.0:  # the rigid wall was enough, or none of what was allowed helped
        return None
    contact = read_number(record, "contact_max_mm")
    if contact is None:
        contact = -min(0.0, estimate or 0.0)
    where = read_number(record, "contact_where_mm")
    return WallContact(
        allowed=allowed,
        used=used,
        contact=max(0.0, contact),
        place=place if where is None else where,
    )


# Methods side by side: one record of numbers for each.

METHOD_NAMES = {
    "tube": "tube",
    "follow": "follow the leader",
    "thesis": "thesis, section 5.3",
}
"""Methods in words."""


def list_methods(plans: Sequence[Plan], records: Sequence[Record] = ()) -> list[Json]:
    """Return one record for each method, with the keys of the summary's `comparison`.

    Parameters
    ----------
    plans : sequence of Plan
        What the records lack is computed from these.
    records : sequence of mapping
        Records already made; they come first and are kept as they are.
    """
    rows = [dict(record) for record in records if isinstance(record, Mapping)]
    by_method = {str(row.get("method")): row for row in rows}
    for plan in plans:
        row = by_method.setdefault(plan.method, {"method": plan.method})
        if row not in rows:
            rows.append(row)
        for key, value in _describe(plan, skip=row).items():
            row.setdefault(key, value)
    return rows


def _describe(plan: Plan, *, skip: Record) -> Json:
    """Return the record of a method by its plan alone."""
    measures = Measures() if plan.measures is None else plan.measures
    estimate, smallest = measures.clearance_min, plan.clearance_min
    return {
        "status": plan.status,
        "reason": plan.reason,
        "reason_code": plan.reason_code,
        "certified": plan.certified,
        "clearance_certified_mm": plan.proved,
        "clearance_min_mm": smallest if estimate is None and math.isfinite(smallest) else estimate,
        "inserted_mm": plan.inserted,
        "centreline_length_mm": read_centreline(plan).length,
        "joint_step_ratio_max": measures.joint_step_ratio_max,
        "joint_angle_max_rad": measures.joint_angle_max,
        "displacement_ratio": None
        if skip.get("displacement_ratio") is not None
        else _measure_displacement(plan),
    }


def _measure_displacement(plan: Plan) -> dict[str, float] | None:
    try:
        return measure_displacement(plan)
    except (InputError, KeyError, TypeError):  # the plan does not state its introducer
        return None


def read_movement(row: Record) -> dict[str, float | None]:
    """Return `step`, `tractrix` and `follow`: how joints move; None where not known."""
    moved = read_part(row, "displacement_ratio")
    if row.get("inserted_mm") == 0.0:  # a scope that does not enter moves no joint
        return {"step": None, "tractrix": None, "follow": None}
    return {
        "step": read_number(row, "joint_step_ratio_max"),
        "tractrix": read_number(moved, "tractrix"),
        "follow": read_number(moved, "follow"),
    }
