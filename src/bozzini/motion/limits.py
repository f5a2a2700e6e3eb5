"""When the goal is out of reach: say why, find what would fit, and go as far as it goes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import find_roomy_path
from ..duct.field import SampledField
from .passage import Passage, find_passage
from .refusal import Refusal, floor_mm
from .shape import SPACING, ShapedPath, cut_path, measure_folds, shape_path

if TYPE_CHECKING:
    from .tube import Job, TubeMotion

__all__ = ["explain_stop", "find_prefix"]

PREFIX_TRIES = 8
"""How many ways to go further are tried."""


def explain_stop(job: Job) -> Refusal:
    """Say why the goal was not reached, after every attempt at the whole way has failed."""
    from .tube import MARGINS

    radius, duct, line = job.scope.radius, job.duct, job.line
    goal = float(job.bound[-1])
    entry, slack = float(job.bound[0]), MARGINS[-1]
    passage = None
    if entry > 0.0 and (isinstance(duct, SampledField) or goal > 0.0):
        passage = job.passage or find_passage(duct, line.points[0], line.points[-1])
        at = _locate(job, passage.place)
    if entry < radius + slack:
        fits = _find_radius(job, _find_fitting(job, passage, entry))
        slack = slack if entry >= radius else 0.0
        return Refusal.at_entry(job.scope, entry, slack=slack).advise(
            diameter_max=2.0 * fits, inflate=radius - fits
        )
    if passage is not None:
        near_goal = line.length - at <= max(job.scope.diameter, 3.0)
        if passage.bound < radius and not (near_goal and goal < radius):
            level = max(passage.level, float(job.bound.min()))
            return _no_passage(job, at, level, passage.bound)
    if goal < radius + slack:
        fits = _find_radius(job, _find_fitting(job, passage, goal))
        return Refusal(
            code="GOAL_CLEARANCE",
            at=line.length,
            needs=radius + slack,
            offers=goal,
            what=f"does not fit at the goal, {line.length:.1f} mm: needs {radius + slack:.2f} mm "
            f"from the wall, the lumen offers {floor_mm(goal)} mm there",
            diameter_max=2.0 * fits,
            inflate=radius - fits,
        )
    base = job.find_base(radius + slack)
    if base is None or (base is job.widest and job.largest_link == 0.0):
        at = float(line.arc_length[int(np.argmin(job.bound))])
        if passage is not None:
            at = _locate(job, passage.place)
            return _mention_grid(job, _no_path(job, at, passage.level, passage.bound))
        return _no_path(job, at, float(job.bound.min()), float(job.bound.min()))
    if job.fold is not None:
        folds = measure_folds(job.fold, job.scope.link_length)
        at = _locate(job, duct.to_world(job.fold.points[int(np.argmin(folds))]))
        refusal = Refusal(
            code="FOLD",
            at=at,
            needs=radius,
            offers=job.fold.room,
            what=f"links of {job.scope.link_length:g} mm would fold back in the bend at "
            f"{at:.1f} mm",
        )
    elif job.failed is not None:
        at = _locate_tightest(job, job.failed)
        local = float(np.interp(at, line.arc_length, job.bound))
        refusal = Refusal(
            code="LINK_TOO_LONG",
            at=at,
            needs=radius + slack,
            offers=job.failed.room,
            what=f"links of {job.scope.link_length:g} mm do not fit at {at:.1f} mm (room on the "
            f"centreline there: at least {floor_mm(max(local, 0.0))} mm): they need "
            f"{radius + slack:.2f} mm from the wall, the best path found leaves "
            f"{floor_mm(job.failed.room)} mm",
        )
    else:
        return _unresolved(job)
    return _advise(job, _mention_grid(job, refusal))


def _mention_grid(job: Job, refusal: Refusal) -> Refusal:
    """Say so where the grid, not the lumen, may be what is too narrow."""
    if not isinstance(job.duct, SampledField) or job.duct.error < 0.25 * job.scope.radius:
        return refusal
    return replace(
        refusal,
        what=f"{refusal.what}; not proved: the grid may hide up to {job.duct.error:.2f} mm of "
        "room, a smaller --voxel tells",
    )


def _find_fitting(job: Job, passage: Passage | None, room: float) -> float:
    """Radius for which an end with `room`, and a way to it, offer enough [mm]."""
    from .tube import MARGINS

    way = float(job.bound.min())
    if passage is not None:
        way = max(way, passage.level)
    return min(room, way) - MARGINS[-1]


def find_prefix(job: Job, refusal: Refusal) -> TubeMotion:
    """Go as far as it certifiably goes.

    First along the best shape of the whole way, up to where it fails; then by bisection over the
    centreline's arc length beyond that.
    """
    from .tube import MARGINS

    room = job.scope.radius + MARGINS[-1]
    low, high = 0.0, min(job.line.length, _find_reach(job, room))
    best, blocked = None, ""
    if job.failed is not None and job.failed.clear_until > SPACING:
        shaped = cut_path(job.failed, job.failed.clear_until)
        best = job.follow(shaped, MARGINS[-1])
        if best is not None:
            low = _locate(job, best.path[-1])
    arc, tries = high, 0
    while high - low >= 2.0 and tries < PREFIX_TRIES:
        tries += 1
        base = _cut_base(job, arc, room)
        motion = None if base is None else job.try_path(base, MARGINS[-1], thorough=False)
        if motion is None:
            high, blocked = arc, _say_blocked(job)
        else:
            best, low = motion, arc
        arc = 0.5 * (low + high)
    if best is None:
        return job.stand_still(refusal.stop_at(0.0, blocked))
    if best.refusal is not None:
        return best
    return replace(best, refusal=refusal.stop_at(low, blocked))


def _say_blocked(job: Job) -> str:
    """Say what was in the way of the last attempt, if that is known."""
    failed = job.failed
    if failed is None or failed.clear:
        return ""
    at, room = _locate_tightest(job, failed), floor_mm(failed.room)
    return f", where the next narrow place is near {at:.1f} mm ({room} mm from the wall at best)"


def _find_reach(job: Job, room: float) -> float:
    """Arc length of the last point of the centreline that may be reached with `room`."""
    fits = job.bound >= room
    if not isinstance(job.duct, SampledField):
        reached = np.flatnonzero(fits)
        return float(job.line.arc_length[int(reached[-1])]) if len(reached) else 0.0
    from scipy import ndimage

    duct = job.duct
    free = (duct.inflation - duct.values >= room) & (duct.values < 0.0)
    blocks, _ = ndimage.label(free, structure=np.ones((3, 3, 3)))
    nodes = np.rint(duct.to_grid(job.line.points) / duct.spacing).astype(int)
    nodes = np.clip(nodes, 0, np.array(duct.values.shape) - 1)
    marks = blocks[tuple(nodes.T)]
    if marks[0] == 0:
        return 0.0
    reached = np.flatnonzero((marks == marks[0]) & fits)
    return float(job.line.arc_length[int(reached[-1])]) if len(reached) else 0.0


def _cut_base(job: Job, arc: float, room: float) -> NDArray[np.float64] | None:
    base = job.cut_line(arc)
    bound = job.bound[: len(base)]
    if len(base) < 3 or bound[-1] < room or bound[0] < room:
        return None
    if bound.min() >= room or not isinstance(job.duct, SampledField):
        return base
    return find_roomy_path(job.duct, base[0], base[-1], room=room)


def _locate(job: Job, place: NDArray[np.float64]) -> float:
    gaps = np.linalg.norm(job.line.points - place, axis=1)
    return float(job.line.arc_length[int(np.argmin(gaps))])


def _locate_tightest(job: Job, path: ShapedPath) -> float:
    """Arc length on the centreline of the place where a shaped path is tightest [mm]."""
    nearest = int(np.argmin(np.abs(path.arc_length - path.tightest)))
    return _locate(job, job.duct.to_world(path.points[nearest]))


def _no_passage(job: Job, at: float, level: float, bound: float) -> Refusal:
    from .tube import MARGINS

    radius = job.scope.radius
    return Refusal(
        code="NO_PASSAGE",
        at=at,
        needs=radius,
        offers=bound,
        what=f"does not fit at {at:.1f} mm: needs {radius:.2f} mm from the wall, no way through "
        f"has more than {floor_mm(bound)} mm (proved)",
        diameter_max=2.0 * (level - MARGINS[-1]),
        inflate=radius + MARGINS[-1] - level,
    )


def _no_path(job: Job, at: float, level: float, bound: float) -> Refusal:
    from .tube import MARGINS

    radius = job.scope.radius + MARGINS[-1]
    local = float(np.interp(at, job.line.arc_length, job.bound))
    return Refusal(
        code="LINK_TOO_LONG",
        at=at,
        needs=radius,
        offers=level,
        what=f"no way with {radius:.2f} mm from the wall was found at {at:.1f} mm for links of any "
        f"length: the widest found has {floor_mm(max(level, local))} mm"
        + (f", none has more than {floor_mm(bound)} mm" if math.isfinite(bound) else ""),
        diameter_max=2.0 * (level - MARGINS[-1]),
        inflate=radius - level,
    )


def _unresolved(job: Job) -> Refusal:
    certificate = job.unresolved
    remedy = ": use a smaller --voxel" if isinstance(job.duct, SampledField) else ""
    proved = float("nan") if certificate is None else certificate.clearance
    at = 0.0 if certificate is None else _locate(job, certificate.place)
    return Refusal(
        code="CERTIFICATE_UNRESOLVED",
        at=at,
        needs=job.scope.radius,
        offers=job.scope.radius + min(proved, 0.0),
        what=f"a motion was found, but near {at:.1f} mm its clearance could not be proved "
        f"(bound {proved:.2f} mm){remedy}",
    )


def _advise(job: Job, refusal: Refusal) -> Refusal:
    """Fill in the longest link and the largest diameter for which the whole way was shaped."""
    link = job.largest_link
    radius = _find_radius(job, job.scope.radius)
    return refusal.advise(
        link_max=link if link > 0.0 else None,
        diameter_max=2.0 * radius if radius > 0.0 else None,
        inflate=job.scope.radius - radius if radius > 0.0 else None,
    )


def _find_radius(job: Job, high: float) -> float:
    """Find the largest radius below `high` for which the whole way is shaped for the link [mm]."""
    from .tube import MARGINS

    margin = MARGINS[-1]
    low = 0.0
    while high - low > 0.1:
        middle = 0.5 * (low + high)
        base = job.find_base(middle + margin)
        if (
            base is not None
            and shape_path(
                job.data,
                job.intro,
                np.ascontiguousarray(job.duct.to_grid(base)),
                length=job.scope.link_length,
                room=middle + margin,
                lead=job.lead,
                thorough=False,
            ).clear
        ):
            low = middle
        else:
            high = middle
    return low
