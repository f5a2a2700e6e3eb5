"""A field with finer nodes in bricks along a line: for passages that the coarse bound hides."""

from __future__ import annotations

from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points
from ..errors import InputError
from ..progress import Progress, no_progress
from .base import check_places
from .build import make_wall
from .field import SampledField

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from .compose import Eroded
    from .field import PlanarField
    from .kernels.clearance import BricksData

__all__ = ["RefinedField", "refine_field"]

CELLS = 8
"""A brick has so many cells along each axis, and one node more."""

BRICKS_MAX = 100_000
"""So many bricks are made at most: about 290 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RefinedField:
    """A sampled field with finer nodes in some bricks; elsewhere the field itself answers.

    Its frame, bounds and wall are those of the field it refines.

    Parameters
    ----------
    coarse : SampledField
        What answers outside the bricks; grid searches (`find_passage`) use it.
    values : (n, m, m, m) float32
        Signed distance to the wall before inflation at the bricks' nodes [mm].
    table : (a, b, c) int32
        Which brick a box of the grid's frame has; -1 for none.
    spacing : (3,) float
        Distance between the finer nodes along each grid axis [mm].
    """

    coarse: SampledField
    values: NDArray[np.float32]
    table: NDArray[np.int32]
    spacing: NDArray[np.float64]
    _rounding: float = dataclass_field(init=False, repr=False, default=0.0)

    def __post_init__(self) -> None:
        most = max(-float(self.values.min()), float(self.values.max())) * 2.0**-23
        object.__setattr__(self, "_rounding", max(most, self.coarse._rounding))

    @property
    def kind(self) -> str:
        """The answer is sampled: see `error`."""
        return "sampled"

    @property
    def error(self) -> float:
        """Largest error of the interpolant against the stated wall, outside the bricks [mm]."""
        return self.coarse.error

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return self.coarse.wall

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        return self.coarse.wall_error

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        return self.coarse.inflation

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all [mm]."""
        return self.coarse.inflation_max

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the grid, world frame [mm]."""
        return self.coarse.bounds

    def to_grid(self, points_world: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., 3) into the field's own frame [mm from node 0]."""
        return self.coarse.to_grid(points_world)

    def to_world(self, points_grid: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the field's own frame [mm from node 0] into world points."""
        return self.coarse.to_world(points_grid)

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) trilinear signed distance at world points (..., 3) [mm]."""
        from .kernels.clearance import evaluate_estimate

        return -self._ask(points, evaluate_estimate)

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the interpolant in the world frame."""
        from .kernels.clearance import evaluate_slope

        return -self._ask(points, evaluate_slope, 3) @ self.coarse.rotation.T

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the clearance at world points (..., 3) [mm]."""
        from .kernels.clearance import evaluate_bound

        return self._ask(points, evaluate_bound)

    def _ask(self, points: ArrayLike, kernel: object, *columns: int) -> NDArray[np.float64]:
        array = check_places("points", points)
        flat = np.ascontiguousarray(self.to_grid(array).reshape(-1, 3))
        result = np.empty((len(flat), *columns))
        kernel(self.pack(), flat, result)  # type: ignore[operator]
        return result.reshape((*array.shape[:-1], *columns))

    def pack(self) -> BricksData:
        """Return the field for compiled kernels."""
        from .kernels.clearance import BricksData

        return BricksData(
            self.values,
            self.table,
            self.spacing,
            self.coarse.values,
            self.coarse.spacing,
            float(self.inflation),
            self._rounding,
        )

    def inflate(self, distance: float) -> RefinedField:
        """Return the same lumen with its wall moved outwards by `distance` mm more.

        Raises
        ------
        InputError
            As `SampledField.inflate`.
        """
        return replace(self, coarse=self.coarse.inflate(distance))

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from .compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the interpolant on another grid, with nodes `voxel` mm apart (`to_field`)."""
        from .compose import to_field

        return to_field(self, voxel)


def refine_field(
    field: SampledField,
    tract: LabelTract | SurfaceTract,
    line_points_world: ArrayLike,
    *,
    voxel: float = 0.5,
    distance: float = 8.4,
    progress: Progress = no_progress,
) -> RefinedField:
    """Add finer nodes with exact distances to a field, along a line.

    Parameters
    ----------
    field : SampledField
        What `build_field` made of `tract`.
    tract : LabelTract or SurfaceTract
    line_points_world : (n, 3) float
        World frame [mm]; points on it no farther apart than `distance`.
    voxel : float
        Distance between the finer nodes, at most [mm]; the field's cells are divided evenly.
    distance : float
        All places within this of the line's points get finer nodes [mm].

    Raises
    ------
    InputError
        If a number is not legal, or the bricks would be too many.
    """
    from .kernels.nearest import fill_bricks

    points = check_points("line", line_points_world)
    check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    check_number("distance", distance, low=0.0, unit="mm")
    parts = np.ceil(field.spacing / voxel - 1e-9)
    spacing = field.spacing / parts
    corners = _find_bricks(field, field.to_grid(points), spacing * CELLS, distance)
    if len(corners) > BRICKS_MAX:
        raise InputError(
            f"voxel is {voxel:g} mm: finer nodes along the line would take {len(corners):,} "
            f"bricks, the limit is {BRICKS_MAX:,}; give a larger voxel or a smaller distance"
        )
    progress("distance", 0.0)
    wall = make_wall(tract)
    if np.abs(wall.rotation - field.rotation).max() > 1e-9:
        raise InputError("field and tract do not belong together: their frames differ")
    low = wall.rotation.T @ (field.origin - wall.origin)
    nodes = corners * CELLS
    inside = wall.find_inside(nodes, CELLS + 1, low, spacing)
    progress("distance", 0.3)
    values = np.empty(inside.shape, dtype=np.float32)
    fill_bricks(wall.tree, nodes, inside, low, spacing, float(field.reach), values)
    size = (np.array(field.values.shape) - 1) * field.spacing
    table = np.full(np.ceil(size / (spacing * CELLS) - 1e-9).astype(int), -1, dtype=np.int32)
    table[tuple(corners.T)] = np.arange(len(corners))
    progress("distance", 1.0)
    return RefinedField(coarse=field, values=values, table=table, spacing=spacing)


def _find_bricks(
    field: SampledField,
    points: NDArray[np.float64],
    side: NDArray[np.float64],
    distance: float,
) -> NDArray[np.int64]:
    """Return the bricks (n, 3) with a place within `distance` of points of the grid frame."""
    from scipy.spatial import KDTree

    size = (np.array(field.values.shape) - 1) * field.spacing
    counts = np.ceil(size / side - 1e-9).astype(int)
    half = 0.5 * float(np.linalg.norm(side))
    reach = np.ceil((distance + side) / side).astype(int)
    around = np.stack(np.meshgrid(*[np.arange(-r, r + 1) for r in reach], indexing="ij"), -1)
    home = np.unique(np.floor(points / side).astype(int), axis=0)
    bricks = np.unique((home[:, None] + around.reshape(-1, 3)).reshape(-1, 3), axis=0)
    bricks = bricks[np.all((bricks >= 0) & (bricks < counts), axis=1)]
    near = KDTree(points).query((bricks + 0.5) * side)[0] <= distance + half
    bricks = bricks[near]
    # Of these, the ones whose box itself is near enough.
    gaps = np.full(len(bricks), np.inf)
    for point in points:
        away = np.maximum(np.maximum(bricks * side - point, point - (bricks + 1) * side), 0.0)
        np.minimum(gaps, np.einsum("ij,ij->i", away, away), out=gaps)
    return np.asarray(bricks[gaps <= distance**2], dtype=np.int64)
