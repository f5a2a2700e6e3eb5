"""Shapes of the family in Python: gathered from ducts, moved, and put together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._analytic import ROUNDING, AnalyticDuct

if TYPE_CHECKING:
    from ._family_kernels import ShapesData
    from .protocol import Duct

__all__ = ["collect_shapes", "join_shapes", "make_shapes", "move_shapes", "shift_shapes"]


def make_shapes(
    kind: int,
    numbers: list[NDArray[np.float64]],
    balls: NDArray[np.float64],
    *,
    inflation: float = 0.0,
) -> ShapesData:
    """Return shapes of one kind from the numbers of each and their bounding balls (k, 4) [mm]."""
    from ._family_kernels import ShapesData, inflate_shapes

    sizes = [len(row) for row in numbers]
    # The sums of a ball's test are rounded too.
    boxes = balls * np.array([1.0, 1.0, 1.0, 1.0 + 1e-12])
    made = ShapesData(
        kinds=np.full(len(sizes), kind, dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        params=np.concatenate(numbers),
        boxes=np.ascontiguousarray(boxes),
        obstacles=np.zeros(len(sizes), dtype=np.bool_),
        offsets=np.zeros(len(sizes)),
        slack=measure_slack(boxes),
    )
    if inflation > 0.0:
        inflate_shapes(made, float(inflation))
    return made


def measure_slack(boxes: NDArray[np.float64]) -> float:
    """Return the rounding error of distances to shapes in these balls [mm]."""
    return ROUNDING * float((np.abs(boxes[:, :3]) + boxes[:, 3:]).max())


def collect_shapes(duct: Duct) -> ShapesData | None:
    """Return the shapes that a duct is made of, in the world frame; None if it is not of such."""
    shapes = getattr(duct, "family_shapes", None)
    if shapes is not None or not isinstance(duct, AnalyticDuct):
        return shapes
    from ._clearance_kernels import ConesData, PolygonData
    from ._family_kernels import POLYGON, ROUND_CONE, ShapesData

    data: Any = duct.pack()
    if isinstance(data, ShapesData):
        return data
    if isinstance(data, ConesData):
        rows = data.cones
        made = make_shapes(ROUND_CONE, [row[:11].copy() for row in rows], rows[:, 11:15])
    elif isinstance(data, PolygonData):
        made = make_shapes(POLYGON, [pack_outline(data.edges)], bound_outline(data.edges)[None])
    else:
        return None
    # What a sampled wall may be off by counts as room that is not there.
    return shift_shapes(made, float(duct.inflation) - duct.error)


def pack_outline(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the numbers of a polygon for `outline_value` from its edges (n, 5)."""
    return np.concatenate([[float(len(edges))], edges.reshape(-1)])


def bound_outline(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a bounding ball (4,) of a polygon from its edges (n, 5) [mm]."""
    corners = edges[:, :2]
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    reach = float(np.linalg.norm(corners - middle, axis=1).max())
    return np.array([*middle, 0.0, reach])


def shift_shapes(data: ShapesData, distance: float) -> ShapesData:
    """Return the shapes with the wall of the duct `distance` mm further out (in, if negative)."""
    more = np.where(data.obstacles, -distance, distance)
    return data._replace(offsets=data.offsets + more)


def join_shapes(lumen: list[ShapesData], obstacles: list[ShapesData]) -> ShapesData | None:
    """Return the union of `lumen` without `obstacles`; None if that is no duct of the family.

    Obstacles inside one part of a union of several are taken away from that part only, and
    those inside an obstacle are holes in it; neither is the family's.
    """
    holes = [bool(data.obstacles.any()) for data in lumen]
    if (len(lumen) > 1 and any(holes)) or any(data.obstacles.any() for data in obstacles):
        return None
    parts = [*lumen, *(data._replace(obstacles=~data.obstacles) for data in obstacles)]
    starts = np.concatenate([[0], np.cumsum([len(data.params) for data in parts])[:-1]])
    boxes = np.concatenate([data.boxes for data in parts])
    return parts[0]._replace(
        kinds=np.concatenate([data.kinds for data in parts]),
        first=np.concatenate([d.first + int(s) for d, s in zip(parts, starts, strict=True)]),
        params=np.concatenate([data.params for data in parts]),
        boxes=boxes,
        obstacles=np.concatenate([data.obstacles for data in parts]),
        slack=max(measure_slack(boxes), *(data.slack for data in parts)),
        offsets=np.concatenate([data.offsets for data in parts]),
    )


def move_shapes(
    data: ShapesData, rotation: NDArray[np.float64], shift: NDArray[np.float64]
) -> ShapesData | None:
    """Return the shapes moved by ``x -> rotation x + shift`` (3-D); None if a kind cannot be."""
    from . import _family_kernels as family

    params = data.params.copy()
    angle = np.arctan2(rotation[1, 0], rotation[0, 0])

    def turn(at: int) -> None:
        params[at : at + 3] = rotation @ params[at : at + 3]

    def carry(at: int, dim: int = 3) -> None:
        params[at : at + dim] = rotation[:dim, :dim] @ params[at : at + dim] + shift[:dim]

    for kind, at in zip(data.kinds.tolist(), data.first.tolist(), strict=True):
        if kind == family.SUPER_ELLIPSE:
            carry(at, 2)
            total = np.arctan2(params[at + 3], params[at + 2]) + angle
            params[at + 2 : at + 4] = np.cos(total), np.sin(total)
        elif kind == family.CIRCLE:
            carry(at, 2)
        elif kind == family.POLYGON:
            for edge in range(int(params[at])):
                carry(at + 1 + 5 * edge, 2)
                carry(at + 3 + 5 * edge, 2)
        elif kind == family.SUPER_ELLIPSOID:
            carry(at)
            axes = params[at + 3 : at + 12].reshape(3, 3)
            params[at + 3 : at + 12] = (rotation @ axes).reshape(-1)
        elif kind == family.HALFSPACES:
            for plane in range(int(params[at])):
                k = at + 1 + 4 * plane
                turn(k)
                params[k + 3] -= params[k : k + 3] @ shift
        elif kind == family.BALL:
            carry(at)
        elif kind == family.ROUND_CONE:
            carry(at)
            turn(at + 3)
        else:
            return None
    boxes = data.boxes.copy()
    boxes[:, :3] = boxes[:, :3] @ rotation.T + shift
    # The numbers are rounded once more.
    slack = data.slack + 2.0 * measure_slack(boxes)
    return data._replace(params=params, boxes=boxes, slack=slack)
