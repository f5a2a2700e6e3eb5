"""When the goal is out of reach: say why, and go as far as it goes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import find_roomy_path, measure_arc_length
from ..progress import Progress, no_progress
from .refusal import Refusal, floor_mm
from .shape import ShapedPath, measure_folds
from .tube import MARGINS, Job, TubeMotion, grid_of

__all__ = ["explain_stop", "find_prefix"]

PREFIX_TRIES = 16
"""How many ways to go further are tried."""

GUIDE_TRIES = 3
"""How many ends of a way beside the centreline are tried."""

PREFIX_GAP = 1.0
"""The search for a way to go further ends when it could gain less than this [mm]."""


def explain_stop(job: Job) -> Refusal:
    """Say why the goal was not reached, after every attempt at the whole way has failed."""
    radius, duct, line = job.scope.radius, job.duct, job.line
    goal = float(job.bound[-1])
    entry, slack = float(job.bound[0]), MARGINS[-1]
    passage = None
    if entry > 0.0 and (job.ways.grid is not None or goal > 0.0):
        passage = job.ways.passage
        at = _locate(job, passage.place)
    if entry < radius + slack:
        return Refusal.at_entry(job.scope, entry, slack=slack if entry >= radius else 0.0)
    if passage is not None:
        near_goal = line.length - at <= max(job.scope.diameter, 3.0)
        if passage.bound < radius and not (near_goal and goal < radius):
            return Refusal(
                code="NO_PASSAGE",
                at=at,
                needs=radius,
                offers=passage.bound,
                what=f"does not fit at {at:.1f} mm of the centreline: the scope needs "
                f"{radius:.2f} mm from its axis to the wall, and no way through has more than "
                f"{floor_mm(passage.bound)} mm (proved)",
            )
    if goal < radius + slack:
        return Refusal(
            code="GOAL_CLEARANCE",
            at=line.length,
            needs=radius + slack,
            offers=goal,
            what=f"does not fit at the goal, {line.length:.1f} mm of the centreline: the scope "
            f"needs {radius + slack:.2f} mm from its axis to the wall, the lumen is sure to have "
            f"{floor_mm(goal)} mm there",
        )
    base = job.find_base(radius + slack)
    if base is None or (base is job.widest and job.largest_link == 0.0):
        if passage is not None:
            at = _locate(job, passage.place)
            return _no_path(job, at, passage.level, passage.bound)
        at = float(line.arc_length[int(np.argmin(job.bound))])
        return _no_path(job, at, float(job.bound.min()), math.inf)
    if job.crossing is not None:
        near, far = job.crossing.near, job.crossing.far
        place = ", ".join(f"{value:.1f}" for value in job.crossing.point)
        return Refusal(
            code="LIMBS_JOINED",
            at=near,
            needs=radius,
            offers=0.0,
            what=f"links of {job.scope.link_length:g} mm would pass from {near:.1f} mm to "
            f"{far:.1f} mm of the centreline through the wall between them, near ({place}) mm, "
            "which only the moved wall opens",
        )
    if job.fold is not None:
        folds = measure_folds(job.fold, job.scope.link_length)
        at = _locate(job, duct.to_world(job.fold.points[int(np.argmin(folds))]))
        return Refusal(
            code="FOLD",
            at=at,
            needs=radius,
            offers=job.fold.room,
            what=f"links of {job.scope.link_length:g} mm would fold back in the bend at "
            f"{at:.1f} mm of the centreline",
        )
    if job.failed is not None:
        at = _locate_tightest(job, job.failed)
        return Refusal(
            code="LINK_TOO_LONG",
            at=at,
            needs=radius + slack,
            offers=job.failed.room,
            what=f"links of {job.scope.link_length:g} mm do not fit at {at:.1f} mm of the "
            f"centreline: they need {radius + slack:.2f} mm from their axis to the wall, the best "
            f"path found has {floor_mm(job.failed.room)} mm{_mention_grid(job)}",
        )
    return _unresolved(job)


def _mention_grid(job: Job) -> str:
    """Say so where the grid, not the lumen, may be what is too narrow."""
    if job.ways.grid is None or job.duct.error < 0.25 * job.scope.radius:
        return ""
    return f" (not proved: the grid may hide up to {job.duct.error:.2f} mm, try a smaller --voxel)"


def find_prefix(job: Job, refusal: Refusal, *, progress: Progress = no_progress) -> TubeMotion:
    """Go as far as it certifiably goes.

    A guide leads as far as any way with clearance does. Paths along it are shaped, whole and in
    parts, and each is followed up to where it is clear, unfolded and certified; where a part ends
    is found by bisection. The path's end is free: it is cut, and its last links move back with it.
    """
    margin = MARGINS[-1]
    room = job.scope.radius + margin
    guide = _find_guide(job, room)
    if guide is None:
        return job.stand_still(refusal.stop_at(0.0))
    arcs = measure_arc_length(guide)
    best, reached, low = None, 0.0, 0.0
    arc = high = float(arcs[-1])
    shaped = job.failed
    for tries in range(PREFIX_TRIES):
        progress("plan", tries / PREFIX_TRIES)
        if shaped is None:
            count = int(np.searchsorted(arcs, arc, "right"))
            if count < 3:
                break
            shaped = job.shape(guide[:count], margin, thorough=tries == 0)
        motion, shaped, end = job.follow_until(shaped, margin), None, 0.0
        if motion is not None:
            end = _locate_on(guide, arcs, motion.path[-1])
            if best is None or end > reached:
                best, reached = motion, end
            if motion.refusal is not None:
                break
        if end < arc - PREFIX_GAP:
            high, low = arc, max(low, reached)
        else:
            low = arc
        if high - low < PREFIX_GAP:
            break
        arc = 0.5 * (low + high)
    if best is None:
        return job.stand_still(refusal.stop_at(0.0))
    if best.refusal is not None:
        return best
    if job.options.compare:
        best = job.improve(best)
    return replace(best, refusal=refusal.stop_at(_locate(job, best.path[-1])))


def _find_guide(job: Job, room: float) -> NDArray[np.float64] | None:
    """Return a way (n, dim) from the entry with `room`, as far along the centreline as any goes."""
    points = job.line.points
    fits = job.bound >= room
    grid = grid_of(job.duct)
    if grid is None:
        reached = np.flatnonzero(fits)
        return points[: reached[-1] + 1] if len(reached) and reached[-1] > 1 else None
    from scipy import ndimage

    free = (grid.inflation - grid.values >= room) & (grid.values < 0.0)
    blocks, _ = ndimage.label(free, structure=np.ones((3, 3, 3)))
    nodes = np.rint(grid.to_grid(points) / grid.spacing).astype(int)
    nodes = np.clip(nodes, 0, np.array(grid.values.shape) - 1)
    marks = blocks[tuple(nodes.T)]
    straight = len(fits) if fits.all() else int(np.argmin(fits))
    if marks[0] != 0:
        beyond = np.flatnonzero((marks == marks[0]) & fits)[::-1]
        for last in beyond[beyond >= straight][: 3 * GUIDE_TRIES : 3]:
            base = find_roomy_path(grid, points[0], points[last], room=room)
            if base is not None:
                return base
    return points[:straight] if straight > 2 else None


def _locate_on(
    guide: NDArray[np.float64], arcs: NDArray[np.float64], place: NDArray[np.float64]
) -> float:
    return float(arcs[int(np.argmin(np.linalg.norm(guide - place, axis=1)))])


def _locate(job: Job, place: NDArray[np.float64]) -> float:
    return _locate_on(job.line.points, job.line.arc_length, place)


def _locate_tightest(job: Job, path: ShapedPath) -> float:
    """Arc length on the centreline of the place where a shaped path is tightest [mm]."""
    nearest = int(np.argmin(np.abs(path.arc_length - path.tightest)))
    return _locate(job, job.duct.to_world(path.points[nearest]))


def _no_path(job: Job, at: float, level: float, bound: float) -> Refusal:
    radius = job.scope.radius + MARGINS[-1]
    local = float(np.interp(at, job.line.arc_length, job.bound))
    return Refusal(
        code="LINK_TOO_LONG",
        at=at,
        needs=radius,
        offers=level,
        what=f"no way for links of any length was found at {at:.1f} mm of the centreline: the "
        f"scope needs {radius:.2f} mm from its axis to the wall, the widest way found has "
        f"{floor_mm(max(level, local))} mm{_mention_grid(job)}",
    )


def _unresolved(job: Job) -> Refusal:
    certificate = job.unresolved
    remedy = ": use a smaller --voxel" if job.ways.grid is not None else ""
    proved = float("nan") if certificate is None else certificate.clearance
    at = 0.0 if certificate is None else _locate(job, certificate.place)
    return Refusal(
        code="CERTIFICATE_UNRESOLVED",
        at=at,
        needs=job.scope.radius,
        offers=job.scope.radius + min(proved, 0.0),
        what=f"a motion was found, but near {at:.1f} mm of the centreline its clearance could not "
        f"be proved (bound {proved:.2f} mm){remedy}",
    )
