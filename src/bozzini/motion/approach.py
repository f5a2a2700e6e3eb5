"""From which branches of a tree a target is near, and which way a camera takes to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_number, check_points
from ..duct.tree import Branch, LumenTree
from ..numeric.arrays import Floats
from ..numeric.polylines import carry_frames, interpolate_polyline, measure_arc_length
from ..results import Shown, tabulated

if TYPE_CHECKING:
    from .branches import TreeReach

STEP = 0.25
"""Between places of a centreline from which a target is looked at [mm]."""

DIRECTIONS = (
    "up", "up and right", "right", "down and right", "down", "down and left", "left",
    "up and left",
)  # fmt: skip
"""In a camera's picture, by turns of 45 degrees."""


@dataclass(frozen=True, kw_only=True)
class Approach(Shown):
    """A way to a target from one branch.

    Parameters
    ----------
    diameter : float
        Of the scope [mm].
    branch : str
    depth : float
        How far the head is in, from the root [mm].
    needle : float
        From the tip, straight, to the target's surface [mm]; 0 if the tip is in it.
    angle : float
        Between the scope's axis and the needle [rad].
    clearance : float
        Certified clearance of the motion [mm].
    vessels : float or None
        Distance of the needle's axis from vessels [mm]; None where they are not known.
    route : str
        Where the scope turns on the way, as its camera sees it, see `describe_routes`.
    """

    diameter: float = tabulated("mm")
    branch: str = tabulated()
    depth: float = tabulated("mm")
    needle: float = tabulated("mm")
    angle: float = tabulated("rad")
    clearance: float = tabulated("mm")
    vessels: float | None = tabulated("mm")
    route: str = tabulated()


def find_approaches(
    reached: TreeReach,
    target: ArrayLike,
    *,
    radius: float = 0.0,
    most: float = math.pi,
    vessels: Floats | None = None,
    vessel_radius: float = 0.0,
) -> tuple[Approach, ...]:
    """Find from which branches a target is near, the shortest needle first.

    Of every branch that a scope enters, places of its centreline `STEP` apart are looked at, as far
    as the head gets; the scope's axis is the centreline's. The needle goes straight, through walls.

    Parameters
    ----------
    reached : TreeReach
    target : (3,) or (k, 3) float
        Its middle, or places of it that it is full of, world frame [mm].
    radius : float
        Of the target about each of these [mm].
    most : float
        The largest angle between the scope's axis and the needle [rad].
    vessels : (n, 3) float, optional
        Places that vessels are full of, world frame [mm].
    vessel_radius : float
        Of the vessels about each of these: of voxels half their diagonal [mm].

    Raises
    ------
    InputError
        If the target is no point, or a number is out of range.
    """
    from scipy.spatial import cKDTree

    places = np.atleast_2d(check_points("target", target))
    check_number("target radius", radius, low=0.0, high=1e3, unit="mm")
    check_number("needle angle", most, low=0.0, high=math.pi, unit="rad")
    cloud = cKDTree(places)
    tree = reached.tree
    found = []
    for row in reached.rows:
        if row.reached <= 0.0:
            continue
        branch = tree.branches[tree.find_branch(row.branch)]
        arcs = np.linspace(0.0, row.reached, 1 + math.ceil(row.reached / STEP))
        along = measure_arc_length(branch.points)
        tips = interpolate_polyline(branch.points, along, arcs)
        ways = np.gradient(branch.points, along, axis=0)
        ways = interpolate_polyline(ways, along, arcs)
        distance, near = cloud.query(tips)
        away = (places[near] - tips) / np.maximum(distance, 1e-12)[:, None]
        cosine = (away * ways).sum(axis=1) / np.linalg.norm(ways, axis=1)
        angle = np.where(distance > radius, np.arccos(np.clip(cosine, -1.0, 1.0)), 0.0)
        fits = np.flatnonzero(angle <= most)
        if len(fits) == 0:
            continue
        k = int(fits[np.argmin(distance[fits])])
        end = tips[k] + max(distance[k] - radius, 0.0) * away[k]
        found.append(
            Approach(
                diameter=row.diameter,
                branch=row.branch,
                depth=row.depth - row.reached + float(arcs[k]),
                needle=max(float(distance[k]) - radius, 0.0),
                angle=float(angle[k]),
                clearance=row.clearance,
                vessels=_clear_needle(tips[k], end, vessels, vessel_radius),
                route=row.route,
            )
        )
    return tuple(sorted(found, key=lambda each: (-each.diameter, each.needle)))


def _clear_needle(
    start: Floats, end: Floats, vessels: Floats | None, radius: float
) -> float | None:
    """Return how far a needle stays from balls about places at least [mm]; None without any."""
    if vessels is None:
        return None
    along = end - start
    squared = max(float(along @ along), 1e-12)
    share = np.clip((vessels - start) @ along / squared, 0.0, 1.0)
    gap = np.linalg.norm(start + share[:, None] * along - vessels, axis=1).min() - radius
    return max(float(gap), 0.0)


def describe_routes(tree: LumenTree, *, up: ArrayLike = (0.0, 1.0, 0.0)) -> list[str]:
    """Return for each branch which way a camera has to take at each branching on the way there.

    The camera looks along the scope; it is not turned about its axis on the way in.

    Parameters
    ----------
    tree : LumenTree
    up : (3,) float
        What is up in its picture at the root, world frame.
    """
    frames: list[Floats] = []
    routes: list[str] = []
    for number, branch in enumerate(tree.branches):
        steps = np.diff(branch.points, axis=0)
        tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
        if branch.parent < 0:
            frames.append(_carry(_look(tangents[0], np.asarray(up, dtype=np.float64)), tangents))
            routes.append("")
            continue
        before = frames[branch.parent]
        frames.append(_carry(before, tangents))
        sisters = [
            _find_way(other)
            for k, other in enumerate(tree.branches)
            if other.parent == branch.parent and k != number
        ]
        apart = _find_way(branch) - np.mean(sisters, axis=0)
        right, rise, _ = apart @ before
        turn = round(math.degrees(math.atan2(right, rise)) / 45.0) % len(DIRECTIONS)
        word = f"{DIRECTIONS[turn]} at {tree.begins[number]:.0f} mm"
        routes.append(", ".join(filter(None, [routes[branch.parent], word])))
    return routes


def _look(way: Floats, up: Floats) -> Floats:
    """Return the axes (3, 3) of a camera, right, up and ahead in its columns."""
    up = up - (up @ way) * way
    if np.linalg.norm(up) < 1e-6:  # it looks up itself
        up = np.eye(3)[int(np.argmin(np.abs(way)))]
        up = up - (up @ way) * way
    up /= np.linalg.norm(up)
    return np.stack([np.cross(way, up), up, way], axis=1)


def _carry(frame: Floats, tangents: Floats) -> Floats:
    """Return the axes of a camera carried along a line without twist."""
    carried = carry_frames(np.concatenate([frame[:, 2][None], tangents]))
    return np.asarray(carried[-1] @ (carried[0].T @ frame))


def _find_way(branch: Branch) -> Floats:
    """Return the unit vector from the beginning of a branch to its end, or to 3 radii from it."""
    away = branch.points - branch.points[0]
    far = np.flatnonzero(np.linalg.norm(away, axis=1) >= 3.0 * branch.mean_radius)
    way = away[far[0] if len(far) else -1]
    return np.asarray(way / np.linalg.norm(way))
