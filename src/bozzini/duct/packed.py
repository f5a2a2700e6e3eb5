"""Ducts as compiled kernels see them: named tuples of arrays and numbers."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ROUNDING = 64.0 * 2.0**-52
"""Rounding error of a distance, as a fraction of the largest coordinate."""

OUTWARD = 1.0 + 1e-12
"""Bounding balls are larger by this factor: the sums of their tests are rounded too."""


class GridData(NamedTuple):
    """A sampled field: exact signed node distances, spacings, inflation, and rounding slack."""

    values: NDArray[np.float32]
    step: Floats
    inflation: float
    slack: float


class BricksData(NamedTuple):
    """Node distances in bricks, which brick a place has, spacing; then as `GridData`'s."""

    bricks: NDArray[np.float32]
    table: NDArray[np.int32]
    fine_step: Floats
    values: NDArray[np.float32]
    step: Floats
    inflation: float
    slack: float


class ShapesData(NamedTuple):
    """Shapes: those of the lumen, then the obstacles in it.

    Parameters
    ----------
    kinds : (n,) int
        Codes of `kernels.shapes`.
    first : (n,) int
        Where each shape's numbers begin in `params`.
    params : (m,) float
    boxes : (n, 4) float
        Bounding balls: centre and radius [mm].
    obstacles : (n,) bool
        Which shapes are taken away.
    offsets : (n,) float
        How far each shape's wall is moved outwards [mm].
    blocks : (b, 6) float
        Balls around runs of shapes of the lumen, with their offsets: centre, radius [mm], first
        shape, last + 1.
    upright : float
        1, or 0 for planar shapes: their kernels take z times this.
    slack : float
        Rounding error of a distance [mm].
    """

    kinds: NDArray[np.int64]
    first: NDArray[np.int64]
    params: Floats
    boxes: Floats
    obstacles: NDArray[np.bool_]
    offsets: Floats
    blocks: Floats
    upright: float
    slack: float

    def shift(self, distance: float) -> ShapesData:
        """Return the shapes with the wall of the duct `distance` mm farther out (in, if < 0)."""
        offsets = self.offsets + np.where(self.obstacles, -distance, distance)
        return self._replace(offsets=offsets).bound()

    def bound(self) -> ShapesData:
        """Return the shapes with blocks that fit their balls and offsets."""
        count = int(np.count_nonzero(~self.obstacles))
        run = max(1, math.isqrt(count))
        blocks = []
        for start in range(0, count, run):
            stop = min(start + run, count)
            places, radii = self.boxes[start:stop, :3], self.boxes[start:stop, 3:]
            centre = 0.5 * ((places - radii).min(axis=0) + (places + radii).max(axis=0))
            reach = np.linalg.norm(places - centre, axis=1) + radii[:, 0]
            reach = reach * OUTWARD + self.offsets[start:stop]
            blocks.append([*centre, float(reach.max()), start, stop])
        return self._replace(blocks=np.array(blocks).reshape(-1, 6))


Packed: TypeAlias = GridData | BricksData | ShapesData
"""What kernels of this package take; other packages may register tuples of their own."""


def pack_shapes(
    code: int, numbers: list[Floats], balls: Floats, *, planar: bool = False
) -> ShapesData:
    """Return shapes of one kind from the numbers of each and their bounding balls (k, 4) [mm]."""
    sizes = [len(row) for row in numbers]
    boxes = balls * np.array([1.0, 1.0, 1.0, OUTWARD])
    return ShapesData(
        kinds=np.full(len(sizes), code, dtype=np.int64),
        first=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        params=np.concatenate(numbers),
        boxes=np.ascontiguousarray(boxes),
        obstacles=np.zeros(len(sizes), dtype=np.bool_),
        offsets=np.zeros(len(sizes)),
        blocks=np.empty((0, 6)),
        upright=0.0 if planar else 1.0,
        slack=measure_slack(boxes),
    ).bound()


def measure_slack(boxes: Floats) -> float:
    """Return the rounding error of distances to shapes in these balls [mm]."""
    return ROUNDING * float((np.abs(boxes[:, :3]) + boxes[:, 3:]).max())


def join_shapes(lumen: list[ShapesData], obstacles: list[ShapesData]) -> ShapesData | None:
    """Return the union of `lumen` without `obstacles`; None if it cannot be packed.

    Obstacles inside one part of a union of several are taken away from that part only, and
    those inside an obstacle are holes in it; neither can be packed.
    """
    holes = [bool(data.obstacles.any()) for data in lumen]
    if (len(lumen) > 1 and any(holes)) or any(data.obstacles.any() for data in obstacles):
        return None
    parts = [*lumen, *(data._replace(obstacles=~data.obstacles) for data in obstacles)]
    starts = np.concatenate([[0], np.cumsum([len(data.params) for data in parts])[:-1]])
    boxes = np.concatenate([data.boxes for data in parts])
    return (
        parts[0]
        ._replace(
            kinds=np.concatenate([data.kinds for data in parts]),
            first=np.concatenate([d.first + int(s) for d, s in zip(parts, starts, strict=True)]),
            params=np.concatenate([data.params for data in parts]),
            boxes=boxes,
            obstacles=np.concatenate([data.obstacles for data in parts]),
            offsets=np.concatenate([data.offsets for data in parts]),
            slack=max(measure_slack(boxes), *(data.slack for data in parts)),
        )
        .bound()
    )


def shift_wall(data: Packed, distance: float) -> Packed:
    """Return a packed duct with its wall `distance` mm farther out (in, if negative)."""
    if isinstance(data, ShapesData):
        return data.shift(distance)
    # All others answer their inflation less the distance.
    return data._replace(inflation=data.inflation + distance)
