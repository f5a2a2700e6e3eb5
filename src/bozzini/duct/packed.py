"""Ducts as compiled kernels see them: named tuples of arrays and numbers."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats

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
    table : (n, 8) float
        Of each shape: the bounding ball's centre and radius [mm], how far the wall is moved
        outwards [mm], the code of `kernels.shapes`, where its numbers begin in `params`, and
        whether it is taken away (1) or not (0).
    params : (m,) float
        The numbers of all shapes.
    blocks : (b, 6) float
        Balls around runs of shapes of the lumen, with their offsets: centre, radius [mm], first
        shape, last + 1.
    upright : float
        1, or 0 for planar shapes: their kernels take z times this.
    slack : float
        Rounding error of a distance [mm].
    """

    table: Floats
    params: Floats
    blocks: Floats
    upright: float
    slack: float

    @property
    def boxes(self) -> Floats:
        """(n, 4) bounding balls: centre and radius [mm]."""
        return self.table[:, :4]

    @property
    def offsets(self) -> Floats:
        """(n,) how far each shape's wall is moved outwards [mm]."""
        return self.table[:, 4]

    @property
    def kinds(self) -> NDArray[np.int64]:
        """(n,) codes of `kernels.shapes`."""
        return self.table[:, 5].astype(np.int64)

    @property
    def first(self) -> NDArray[np.int64]:
        """(n,) where each shape's numbers begin in `params`."""
        return self.table[:, 6].astype(np.int64)

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """(n,) which shapes are taken away."""
        return self.table[:, 7] > 0.0

    def shift(self, distance: float) -> ShapesData:
        """Return the shapes with the wall of the duct `distance` mm farther out (in, if < 0)."""
        table = self.table.copy()
        table[:, 4] += np.where(self.obstacles, -distance, distance)
        return self._replace(table=table).bound()

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


class SpaceData(NamedTuple):
    """A lumen united with the introducer before it, all within a radius of a ray: a capsule.

    Parameters
    ----------
    lumen : named tuple
        A packed duct.
    introducer : (7,) float
        Its inner end, the unit vector out of the lumen, and its bore [mm]; of 0 or less: none.
    """

    lumen: Packed
    introducer: Floats


Packed: TypeAlias = GridData | BricksData | ShapesData
"""What kernels of this package take; other packages may register tuples of their own."""


def pack_shapes(
    code: int, numbers: list[Floats], balls: Floats, *, planar: bool = False
) -> ShapesData:
    """Return shapes of one kind from the numbers of each and their bounding balls (k, 4) [mm]."""
    table = np.zeros((len(numbers), 8))
    table[:, :4] = balls * np.array([1.0, 1.0, 1.0, OUTWARD])
    table[:, 5] = code
    table[1:, 6] = np.cumsum([len(row) for row in numbers[:-1]])
    return ShapesData(
        table=table,
        params=np.concatenate(numbers),
        blocks=np.empty((0, 6)),
        upright=0.0 if planar else 1.0,
        slack=measure_slack(table[:, :4]),
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
    tables, start = [], 0
    for data in (*lumen, *obstacles):
        table = data.table.copy()
        table[:, 6] += start
        start += len(data.params)
        tables.append(table)
    for table in tables[len(lumen) :]:
        table[:, 7] = 1.0
    parts = [*lumen, *obstacles]
    table = np.concatenate(tables)
    return (
        parts[0]
        ._replace(
            table=table,
            params=np.concatenate([data.params for data in parts]),
            slack=max(measure_slack(table[:, :4]), *(data.slack for data in parts)),
        )
        .bound()
    )


def shift_wall(data: Packed, distance: float) -> Packed:
    """Return a packed duct with its wall `distance` mm farther out (in, if negative)."""
    if isinstance(data, ShapesData):
        return data.shift(distance)
    # All others answer their inflation less the distance.
    return data._replace(inflation=data.inflation + distance)
