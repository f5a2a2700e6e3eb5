"""The whole way to the goal, and where on it a plan's head path and its refusal lie.

A planner bends the head's path for the length of the links, and may end it before the goal. Places
along the tract are told on the centreline, which every plan of the same tract shares.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..motion.plan import Plan
from ..motion.refusal import floor_mm
from .records import read_number

__all__ = ["RefusalMark", "Way", "find_refusal", "find_way", "share_centreline"]

Floats = NDArray[np.float64]

_MATCHED = 800


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """The way from the entry to the goal.

    Parameters
    ----------
    points : (m, 3) float
        The centreline, or the head's path where the plan holds no centreline [mm].
    arc_length, radius : (m,) float
        Arc length from the entry and inscribed radius of the lumen [mm].
    path_arc_length, path_place : (n,) float
        Arc length along the head's path, and the arc length of the way beside it [mm].
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
        """Length of the way [mm]."""
        return float(self.arc_length[-1])

    def place(self, arc: ArrayLike) -> Floats:
        """Turn arc length along the head's path [mm] into that of the way.

        Before the entry both count alike, so what is in the introducer stays negative.
        """
        values = np.asarray(arc, dtype=np.float64)
        inside = np.interp(values, self.path_arc_length, self.path_place)
        before = values - self.path_arc_length[0] + self.path_place[0]
        return np.where(values < self.path_arc_length[0], before, inside)

    def locate(self, place: float) -> Floats:
        """Return the world point ``(3,)`` at an arc length of the way [mm]."""
        return np.array([np.interp(place, self.arc_length, axis) for axis in self.points.T])

    def cut_rest(self, place: float) -> Floats:
        """Return the points ``(k, 3)`` of the way from an arc length [mm] to the goal."""
        rest = self.points[self.arc_length > place]
        return np.concatenate([self.locate(place)[None], rest]) if len(rest) else rest


@dataclass(frozen=True, kw_only=True)
class RefusalMark:
    """Where a planner refused to go on.

    Parameters
    ----------
    code : str
        The reason code.
    at : float
        Arc length of the way [mm].
    needs, offers : float or None
        Room needed and room there, from the scope's axis to the wall [mm].
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
        return f"refused at {self.at:.0f} mm: needs {self.needs:.2f}, offers {offers}"


def find_refusal(plan: Plan, summary: Mapping[str, Any] | None = None) -> RefusalMark | None:
    """Return where and why a plan ends before the goal, None where that was not recorded."""
    if plan.status != "stopped":
        return None
    for record in ((summary or {}).get("refusal"), plan.meta.get("refusal")):
        if isinstance(record, Mapping) and (at := read_number(record, "at_mm")) is not None:
            return RefusalMark(
                code=str(record.get("code") or plan.reason_code),
                at=at,
                needs=read_number(record, "needs_mm"),
                offers=read_number(record, "offers_mm"),
            )
    return None


def share_centreline(plans: Sequence[Plan]) -> list[Plan]:
    """Give plans without a centreline that of the others, so that places mean the same."""
    lines = [plan.meta["centreline"] for plan in plans if plan.meta.get("centreline")]
    if not lines:
        return list(plans)
    return [
        replace(plan, meta={**plan.meta, "centreline": plan.meta.get("centreline") or lines[0]})
        for plan in plans
    ]


def find_way(plan: Plan) -> Way:
    """Return the whole way of a plan: its centreline, or else the path of its head."""
    arc = plan.path_arc_length
    line = _read_centreline(plan)
    if line is None:
        return Way(
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
    return Way(
        points=points,
        arc_length=arc_length,
        radius=radius,
        path_arc_length=arc[chosen],
        path_place=places,
        is_centreline=True,
    )


def _read_centreline(plan: Plan) -> tuple[Floats, Floats, Floats] | None:
    record = plan.meta.get("centreline")
    if not isinstance(record, Mapping):
        return None
    try:
        points, arc, radius = (
            np.asarray(record[key], dtype=np.float64)
            for key in ("points_mm", "arc_length_mm", "radius_mm")
        )
    except (KeyError, TypeError, ValueError):
        return None
    fits = points.ndim == 2 and points.shape[1] == 3 and len(points) >= 2
    if not fits or arc.shape != (len(points),) or radius.shape != arc.shape:
        return None
    finite = all(np.isfinite(values).all() for values in (points, arc, radius))
    return (points, arc, radius) if finite and (np.diff(arc) > 0.0).all() else None


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
