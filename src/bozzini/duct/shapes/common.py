"""What unions of shapes of one kind share: their slices of the family's kernel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_number
from ...errors import GeometryError
from ..base import check_places

if TYPE_CHECKING:
    from ..base import Duct
    from ..compose import Eroded
    from ..field import PlanarField, SampledField
    from ..kernels.clearance import GridData
    from ..kernels.family import ShapesData

# What the analytic ducts share: they answer through the same kernels that planners use.

ROUNDING = 64.0 * 2.0**-52
"""Rounding error of a distance, as a fraction of the largest coordinate."""


class AnalyticDuct(ABC):
    """A duct given by formulas, without a sampling error; public kinds are frozen dataclasses."""

    dim: ClassVar[int]
    inflation: float
    wall: str
    wall_error: float

    @property
    @abstractmethod
    def kind(self) -> str:
        """``"exact"`` or ``"bound"`` (never more room than there is)."""

    @property
    def error(self) -> float:
        """The distance never promises too much room."""
        return 0.0

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of the box around the duct [mm]."""

    @abstractmethod
    def pack(self) -> Any:
        """Return the duct for compiled kernels."""

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., dim) into the kernels' frame (..., 3): planar ones get z = 0."""
        array = np.asarray(points, dtype=np.float64)
        if self.dim == 3:
            return array
        return np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into points (..., dim)."""
        return np.asarray(points, dtype=np.float64)[..., : self.dim]

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., dim).
        """
        from ..kernels.clearance import evaluate_estimate

        return -self._evaluate(evaluate_estimate, points)

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm].

        The negative signed distance, less the rounding error.
        """
        from ..kernels.clearance import evaluate_bound

        return self._evaluate(evaluate_bound, points)

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance.

        Where it has several (the middle of a ball, equally near walls) one of them, or their mean.
        """
        from ..kernels.clearance import evaluate_slope

        array, flat = self._flatten(points)
        slope = np.empty((len(flat), 3))
        evaluate_slope(self.pack(), flat, slope)
        return self.to_world(-slope).reshape(array.shape)

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def erode(self, clearance: float) -> Any:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from ..compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float) -> SampledField | PlanarField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart (`compose.to_field`)."""
        from ..compose import to_field

        return to_field(self, voxel)

    def _flatten(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        array = check_places("points", points, dim=self.dim)
        return array, np.array(self.to_grid(array).reshape(-1, 3), order="C")

    def _evaluate(self, kernel: Any, points: ArrayLike) -> NDArray[np.float64]:
        array, flat = self._flatten(points)
        result = np.empty(len(flat))
        kernel(self.pack(), flat, result)
        return result.reshape(array.shape[:-1])


# Shapes of the family in Python: gathered from ducts, moved, and put together.


def make_shapes(
    kind: int,
    numbers: list[NDArray[np.float64]],
    balls: NDArray[np.float64],
    *,
    inflation: float = 0.0,
) -> ShapesData:
    """Return shapes of one kind from the numbers of each and their bounding balls (k, 4) [mm]."""
    from ..kernels.family import ShapesData, inflate_shapes

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
    from ..kernels.clearance import ConesData, PolygonData
    from ..kernels.family import POLYGON, ROUND_CONE, ShapesData

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
    from ..kernels import family

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


# What ducts share whose walls are measured: kernels get them as a sampled field.

CROWD = 1000
"""Fewer points than this are asked as they come."""


class Nearest(NamedTuple):
    """The signed distance before inflation (n,) [mm], and its gradient (n, 3) if asked for."""

    distance: NDArray[np.float64]
    gradient: NDArray[np.float64]


class MeasuredDuct(ABC):
    """A 3-D duct that answers points itself, and kernels through a sampled field.

    A frozen dataclass with `inflation`, `wall` and `wall_error`. The field is sampled when first
    asked for.
    """

    inflation: float
    wall: str
    wall_error: float | None

    @property
    def kind(self) -> str:
        """What the distance is."""
        return "bound"

    @property
    def error(self) -> float:
        """The distance never promises too much room."""
        return 0.0

    @property
    @abstractmethod
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) corners of the box around the duct [mm]."""

    @abstractmethod
    def _measure(self, points: NDArray[np.float64], *, with_gradient: bool) -> Nearest:
        """Return the signed distance before inflation at points (n, 3), and its gradient."""

    @abstractmethod
    def _sample(self, voxel: float | None) -> SampledField:
        """Sample the signed distance, with inflation; by default with a spacing that suits."""

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (...) signed distance at points (..., 3) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., 3).
        """
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        return (
            self._measure(flat, with_gradient=False).distance.reshape(array.shape[:-1])
            - self.inflation
        )

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return -self.signed_distance(points) - ROUNDING * float(np.abs(self.bounds).max())

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 3) gradient of the signed distance; where there are several, one."""
        array = check_places("points", points)
        flat = np.array(array.reshape(-1, 3), order="C")
        return self._measure(flat, with_gradient=True).gradient.reshape(array.shape)

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def erode(self, clearance: float) -> Eroded:
        """Return the duct of all places with at least `clearance` mm to the wall."""
        from ..compose import Eroded

        return Eroded(self, clearance)

    def sample(self, voxel: float | None = None) -> SampledField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart.

        The field's `clearance_bound` is rigorous for the same wall.
        """
        if voxel is not None:
            check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
        return self._sample(voxel)

    def pack(self) -> GridData:
        """Return the duct for compiled kernels: sampled, with a rigorous bound."""
        return self._field.pack()

    def to_grid(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn world points (..., 3) into the sampled field's frame [mm]."""
        return self._field.to_grid(points)

    def to_world(self, points: ArrayLike) -> NDArray[np.float64]:
        """Turn points (..., 3) of the sampled field's frame into world points [mm]."""
        return self._field.to_world(points)

    @cached_property
    def _field(self) -> SampledField:
        return self._sample(None)


def order_points(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the order (n,) in which points (n, 3) lie near to each other: by cubes, in rows.

    Searches from one to the next then find what they need in the cache, or start near the goal.
    """
    if len(points) < CROWD:
        return np.arange(len(points))
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cubes = ((points - points.min(axis=0)) * (63.0 / size)).astype(np.int64)
    cubes[:, 1] = np.where(cubes[:, 0] % 2, 63 - cubes[:, 1], cubes[:, 1])
    row = (cubes[:, 0] << 6) | cubes[:, 1]
    last = np.where(row % 2, 63 - cubes[:, 2], cubes[:, 2])
    return np.argsort((row << 6) | last, kind="stable")


# Whether shapes overlap and hang together, and how deep two overlap.
#
# Depth is found by branch and bound on a function with bounded slope.

CELLS_MAX = 400_000
"""The search ends when this many boxes are open."""


class Least(NamedTuple):
    """The least value found, where, and a bound below which there is none."""

    value: float
    place: NDArray[np.float64]
    bound: float


def find_least(
    function: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    *,
    tolerance: float,
    enough: float = -np.inf,
    slope: float = 1.0,
) -> Least:
    """Search a box for the least value of a function.

    Parameters
    ----------
    function : callable
        Takes points (n, dim), returns (n,) values that change by at most `slope` per mm.
    low, high : (dim,) float
        Corners of the box [mm].
    tolerance : float
        The search ends when the value is known this well.
    enough : float
        It ends also at a value this low, and when there can be none.
    slope : float
        Lipschitz constant.

    Notes
    -----
    Each box is halved along its longer sides; one whose value at the middle less `slope` times
    half its diagonal is above the best so far is dropped.
    """
    dim = len(low)
    centres = 0.5 * (low + high)[None]
    half = 0.5 * (high - low)
    values = function(centres)
    best = float(values[0])
    place = centres[0]
    while True:
        reach = slope * float(np.linalg.norm(half))
        bound = float(values.min()) - reach
        done = best <= enough or bound > enough > -np.inf or best - bound <= tolerance
        if done or len(centres) > CELLS_MAX or reach <= 1e-15 * (1.0 + abs(best)):
            return Least(best, place, min(bound, best))
        cut = half > 0.6 * half.max()
        steps = [np.array([-0.5, 0.5]) * half[a] if cut[a] else np.zeros(1) for a in range(dim)]
        shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, dim)
        half = np.where(cut, 0.5 * half, half)
        centres = (centres[:, None] + shifts[None]).reshape(-1, dim)
        values = function(centres)
        index = int(np.argmin(values))
        if values[index] < best:
            best, place = float(values[index]), centres[index]
        keep = values - slope * float(np.linalg.norm(half)) <= best
        if not keep.any():
            keep[index] = True
        centres, values = centres[keep], values[keep]


def check_connected(
    name: str,
    gaps: NDArray[np.float64],
    meet: Callable[[int, int], bool],
    *,
    links: NDArray[np.bool_] | None = None,
    far: NDArray[np.bool_] | None = None,
) -> None:
    """Raise `GeometryError` if shapes do not hang together; see `find_split`.

    Parameters
    ----------
    name : str
        What one of the shapes is called.
    """
    split = find_split(gaps, meet, links=links, far=far)
    if split is not None:
        raise GeometryError(tell_split(name, split))


def tell_split(name: str, split: tuple[int, int]) -> str:
    """Return the words for a union that falls apart."""
    a, b = split
    return f"the union falls apart: {name} {a} and {name} {b} come nearest, and do not overlap"


def find_split(
    gaps: NDArray[np.float64],
    meet: Callable[[int, int], bool],
    *,
    links: NDArray[np.bool_] | None = None,
    far: NDArray[np.bool_] | None = None,
) -> tuple[int, int] | None:
    """Return two shapes between which a union falls apart; None if it hangs together.

    Parameters
    ----------
    gaps : (n, n) float
        How far apart two shapes are about [mm]: the nearest are asked first, and named.
    meet : callable
        Takes two indices, returns whether these shapes overlap. It is only asked of shapes that
        do not hang together already, neighbours in order first, until all do.
    links : (n, n) bool, optional
        Pairs that are known to overlap.
    far : (n, n) bool, optional
        Pairs that are known not to.

    Returns
    -------
    (int, int) or None
        The nearest two shapes of which one hangs together with the first shape.
    """
    from scipy.sparse.csgraph import connected_components

    links = np.zeros(gaps.shape, dtype=bool) if links is None else links
    part = connected_components(links, directed=False)[1]
    if part.max() == 0:
        return None
    ask = part[:, None] != part
    if far is not None:
        ask &= ~far
    first, second = np.nonzero(np.triu(ask, 1))
    order = np.lexsort((gaps[first, second], second - first > 1))
    for a, b in zip(first[order].tolist(), second[order].tolist(), strict=True):
        if part[a] != part[b] and meet(a, b):
            part[part == part[b]] = part[a]
            if np.all(part == part[0]):
                return None
    inside, outside = np.flatnonzero(part == part[0]), np.flatnonzero(part != part[0])
    table = gaps[np.ix_(inside, outside)]
    i, j = np.unravel_index(int(np.argmin(table)), table.shape)
    a, b = sorted((int(inside[i]), int(outside[j])))
    return a, b


def link_gauges(
    centres: NDArray[np.float64], gauges: NDArray[np.float64], levels: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Say which convex shapes surely overlap, by what they hold of the lines between centres.

    Parameters
    ----------
    centres : (n, dim) float
        Of the shapes [mm].
    gauges : (n, n) float
        Gauge of shape k at the centre of shape i.
    levels : (n,) float
        A shape is where its gauge is at most this.

    Returns
    -------
    links : (n, n) bool
        Whether the line between two centres has a point in both, so that they overlap. They may
        without.
    gaps : (n, n) float
        How far apart they are along that line [mm]; negative where they overlap.
    """
    away = np.linalg.norm(centres[:, None] - centres, axis=-1)
    # From its centre shape i holds the line to centre k up to the share levels[i] / gauges[k, i].
    held = np.maximum(levels, 0.0) / np.where(gauges > 0.0, gauges, 1.0)
    share = np.where(gauges > 0.0, held, 1.0)
    total = share + share.T
    legal = (levels >= 0.0)[:, None] & (levels >= 0.0)
    return (total >= 1.0) & legal, away * (1.0 - total)


class Slices(NamedTuple):
    """Shapes for compiled kernels: kind, numbers of each, and bounding balls (k, 4) [mm]."""

    kind: int
    numbers: list[NDArray[np.float64]]
    balls: NDArray[np.float64]


class ShapeUnion(AnalyticDuct):
    """A union of shapes of one kind; a frozen dataclass with `inflation` and `wall_error`."""

    dim = 3

    @abstractmethod
    def _slice(self) -> Slices:
        """Return the shapes' numbers."""

    @property
    def kind(self) -> str:
        """The distance is a lower bound of the room."""
        return "bound"

    def pack(self) -> ShapesData:
        """Return the duct for compiled kernels."""
        return self._data

    @cached_property
    def _data(self) -> ShapesData:

        slices = self._slice()
        return make_shapes(
            slices.kind, slices.numbers, slices.balls, inflation=float(self.inflation)
        )
