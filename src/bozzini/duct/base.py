"""What every duct is, its sampled form, and its eroded form."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace
from dataclasses import field as dataclass_field
from functools import cached_property, partial
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_fields, check_number, check_points, show_apart
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Shown, show_briefly, take_axes
from .checks import (
    check_counts,
    check_places,
    check_rotation,
    check_wall,
    freeze_array,
    set_fields,
)
from .packed import ROUNDING, GridData, Packed, ShapesData, shift_wall
from .search import find_least

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Kind = Literal["exact", "bound", "sampled"]
Form = Literal["length", "angle", "number", "lengths", "numbers", "axes"]

GRADIENT_STEP_MM = 1e-4
"""Step of the central differences by which a duct has a gradient that does not bring its own."""

NODES_MAX = 400_000_000
"""A sampled grid has at most this many nodes."""

NODES_WANTED = 4_000_000
"""A sampled grid has about this many nodes where no spacing is given."""

ROUND_OFF_SLOPE, ROUND_OFF_DISTANCE_MM = 1e-6, 1e-6
"""By how much a distance may be steeper than 1, and wrong [mm], by round-off."""

MARGIN_NODES = 2.0
"""How far a sampled grid reaches beyond the duct."""

PLOT_CELLS = 160, 72
"""Cells along the longest side of a picture: of a planar duct, and of one in space."""


class Duct(Shown, ABC):
    """A lumen, as planners see it: a signed distance to its wall, negative inside [mm].

    A shape of one's own derives from this class, or from `DuctShape`, as a frozen dataclass, and
    brings `bounds` and `signed_distance`, as arrays. All else follows, and a shape that knows
    better overrides it: the clearance bound from the distance, the gradient by differences, and
    what compiled kernels see from a sampled field, which is checked and whose error is stated. With
    kernels of its own it derives from `PackedDuct` too. A class-level `name` is its name in files.

    The signed distance changes by at most 1 mm per mm (1-Lipschitz), the interpolant of a sampled
    duct by at most sqrt(3). `signed_distance` must never promise more clearance than there is by
    more than `error`, and `clearance_bound` never by anything, but where `error` is an estimate
    itself (`BetweenCurves` without `curvature`). A duct is 3-D or planar; `bounds` shows which.
    """

    columns: ClassVar[dict[str, tuple[str, Form]]] = {}
    """What a file holds of each piece: the field that it is from, and in which form.

    Without columns a file holds all fields of the dataclass, as one piece.
    """

    unit_kinds: ClassVar[dict[str, str | tuple[str, ...]]] = {}
    """Fields of several numbers whose text may have units in a file, and of which kind each is.

    A tuple has one kind for each number of a row. Fields made by `quantity` state theirs.
    """

    joined: ClassVar[bool] = False
    """Whether the shapes lie between two pieces of a file each, like cones between balls."""

    @property
    def kind(self) -> Kind:
        """``"exact"``, ``"bound"`` (never more clearance than there is) or ``"sampled"``."""
        return "bound"

    @property
    def error(self) -> float:
        """By how much the distance may promise too much clearance [mm]; 0 unless sampled."""
        return 0.0

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return f"wall of a {type(self).__name__}"

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        return None

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        return 0.0

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all [mm]."""
        return math.inf if "inflation" in _list_fields(self) else self.inflation

    @property
    def exact_outside(self) -> bool:
        """Whether distances outside, before inflation, are exact: samples may then be inflated."""
        return self.kind == "exact"

    @property
    @abstractmethod
    def bounds(self) -> Floats:
        """(2, dim) corners of a box that holds the duct [mm]."""

    @property
    def dim(self) -> int:
        """3, or 2 for a planar duct."""
        return int(self.bounds.shape[1])

    @property
    def shape_count(self) -> int:
        """How many shapes it is made of: cones and cylinders lie between two of their balls."""
        if not self.columns:
            return 1
        count = len(getattr(self, next(iter(self.columns.values()))[0]))
        return max(1, count - 1) if self.joined else count

    @property
    def family_shapes(self) -> ShapesData | None:
        """The shapes of this package's kernels that it is made of; None if it is not."""
        return None

    @abstractmethod
    def signed_distance(self, points: ArrayLike, /) -> Floats:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., dim).
        """

    def clearance_bound(self, points: ArrayLike, /) -> Floats:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        slack = self.error + ROUNDING * float(np.abs(self.bounds).max())
        return np.asarray(-self.signed_distance(points) - slack)

    def gradient(self, points: ArrayLike, /) -> Floats:
        """Return the (..., dim) gradient of the signed distance; where it has several, one."""
        array = check_places("points", points, dim=self.dim)
        steps = GRADIENT_STEP_MM * np.eye(self.dim)
        ahead, back = (self.signed_distance(array[..., None, :] + s * steps) for s in (1.0, -1.0))
        return np.asarray((ahead - back) / (2.0 * GRADIENT_STEP_MM))

    def pack(self) -> Packed:
        """Return the duct as a named tuple for compiled kernels (`duct.kernels.clearance`)."""
        return self._core.pack()

    def to_grid(self, points: ArrayLike, /) -> Floats:
        """Turn world points (..., dim) into the kernels' frame (..., 3) [mm], isometrically."""
        return self._core.to_grid(points)

    def to_world(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim) [mm]."""
        return self._core.to_world(points)

    def inflate(self, distance: float) -> Self:
        """Return the same duct with its wall moved outwards by `distance` mm more.

        Raises
        ------
        InputError
            If `distance` is negative, or the wall cannot be moved.
        """
        if "inflation" not in _list_fields(self):
            raise InputError(f"the wall of a {type(self).__name__} cannot be moved outwards")
        check_number("distance", distance, low=0.0, unit="mm")
        return replace(self, inflation=self.inflation + distance)  # type: ignore[type-var]

    def erode(self, clearance: float) -> Duct:
        """Return the duct of all places with at least `clearance` mm to the wall: see `Eroded`."""
        return Eroded(self, clearance)

    def sample(self, voxel: float | None = None) -> SampledField | PlanarField:
        """Sample the signed distance on a grid with nodes `voxel` mm apart.

        Parameters
        ----------
        voxel : float, optional
            Distance between nodes [mm]. By default about 4 million nodes.

        Returns
        -------
        SampledField or PlanarField
            Its `error` bounds how far its answer is from the duct's value, itself made larger by
            the duct's own `error` (for a sampled duct sqrt(3) times that does); its
            `clearance_bound` is rigorous for the duct's wall.

        Raises
        ------
        InputError
            If `voxel` is not positive, or the grid would have more than 400 million nodes.
        GeometryError
            If the signed distance is none: it is not finite, of another shape than the points,
            steeper than 1 between nodes, or negative outside `bounds`.

        Notes
        -----
        The interpolant T of a 1-Lipschitz value s is within e of it,
        e^2 = sum h_k^2 f_k (1 - f_k) at the fractions f_k of the cell (Jensen). The bound by
        squares holds too, though a node's value may be a lower bound b of the distance d:
        T[b^2] - e^2 <= T[d^2] - e^2 <= d^2.
        """
        spacing = self._default_voxel if voxel is None else voxel
        check_number("voxel", spacing, low=0.0, low_open=True, unit="mm")
        low, counts = self._lay_grid(spacing)
        dim = len(low)
        axes = [low[k] + spacing * np.arange(counts[k]) for k in range(dim)]
        values = np.empty(tuple(counts), dtype=np.float32)
        sheet = np.stack(np.meshgrid(*axes[1:], indexing="ij"), axis=-1)
        before = None
        for index, x in enumerate(axes[0]):
            points = np.concatenate([np.full((*sheet.shape[:-1], 1), x), sheet], axis=-1)
            distance = np.asarray(self.signed_distance(points))
            self._check_distance(points, distance, before, spacing)
            before = distance
            # The field takes its inflation off again.
            values[index] = distance + (self.error + self.inflation)
        # An interpolant is not exact; at its nodes only it may be.
        known_outside = self.kind != "sampled" and self.exact_outside
        sampled = SampledField(
            values=values if dim == 3 else np.repeat(values[..., None], 2, axis=-1),
            spacing=np.full(3, float(spacing)),
            origin=np.append(low, np.zeros(3 - dim)),
            rotation=np.eye(3),
            inflation=self.inflation,
            wall=f"{self.wall}, sampled every {spacing:g} mm",
            wall_error=self.wall_error,
            reach=math.inf if known_outside else 0.0,
            exact_outside=known_outside,
        )
        return PlanarField(sampled) if dim == 2 else sampled

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the duct and return the axes: its wall, and the clearance inside in colour.

        A planar duct as it is; one in space is seen along the shortest side of its box, in
        colour the most clearance on each line of sight.
        """
        low, high = self.bounds
        across = int(np.argmin(high - low)) if self.dim == 3 else 2
        right, up = (axis for axis in range(3) if axis != across)
        step = float((high - low).max()) / PLOT_CELLS[self.dim - 2]
        axes = [np.arange(a - step, b + 1.5 * step, step) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        clearance = -self.signed_distance(nodes)
        if self.dim == 3:
            clearance = clearance.max(axis=across)
        names = "xyz"
        ax = take_axes(ax, x=f"{names[right]} [mm]", y=f"{names[up]} [mm]", equal=True)
        inside = np.ma.masked_less(clearance.T, 0.0)
        picture = ax.pcolormesh(axes[right], axes[up], inside, shading="gouraud", cmap="Blues")
        ax.contour(axes[right], axes[up], clearance.T, levels=[0.0], colors="black", linewidths=1.0)
        ax.figure.colorbar(picture, ax=ax, label="clearance [mm]")
        return ax

    def _check_distance(
        self, points: Floats, distance: Floats, before: Floats | None, voxel: float
    ) -> None:
        """Raise `GeometryError` unless the values on a sheet of nodes are a signed distance.

        `before` has the values on the sheet before. Between neighbours in all directions of the
        grid, diagonals too, a distance changes by no more than they are apart.
        """
        what = f"signed distance of a {type(self).__name__}"
        check_values(what, points, distance)
        refuse = partial(_refuse, what, points, distance)
        if self.kind != "sampled":  # its wall may be moved beyond the grid
            low, high = self.bounds
            inside = distance < -self.error - ROUND_OFF_DISTANCE_MM
            inside[inside] = ((points[inside] < low) | (points[inside] > high)).any(axis=-1)
            refuse(inside, "is {:g} mm", "bounds must be a box that holds the whole duct")
        pairs = [(distance, shift) for shift in _list_shifts(self.dim - 1, half=True)]
        if before is not None:
            pairs += [(before, shift) for shift in _list_shifts(self.dim - 1)]
        for other, shift in pairs:
            apart = voxel * math.sqrt(sum(map(abs, shift)) + (other is before))
            here = tuple(slice(max(-n, 0), -n if n > 0 else None) for n in shift)
            there = tuple(slice(max(n, 0), n if n < 0 else None) for n in shift)
            rise = distance[here] - other[there]
            most = apart * self._lipschitz * (1.0 + ROUND_OFF_SLOPE) + ROUND_OFF_DISTANCE_MM
            if max(rise.max(), -rise.min()) > most:
                steep = np.zeros(distance.shape, dtype=np.bool_)
                steep[here] = np.abs(rise) > most
                refuse(
                    steep,
                    f"changes by more than {most:.3g} mm within {apart:.3g} mm, to {{:g}} mm",
                    f"it must change by at most {self._lipschitz:.3g} mm per mm",
                )

    def _lay_grid(self, voxel: float) -> tuple[Floats, NDArray[np.int64]]:
        """Return the first node of a grid around the duct, and how many there are per axis."""
        size = np.ptp(self.bounds, axis=0)
        least = (float(size.prod()) / NODES_MAX) ** (1.0 / len(size))
        if voxel < 1e-3 * least:  # the number of nodes might overflow
            shown = show_apart(voxel, least, digits=2)
            raise InputError(
                f"voxel is {shown[0]} mm: the grid would have far too many nodes, it must be at "
                f"least about {shown[1]} mm"
            )
        low, high = self.bounds + MARGIN_NODES * voxel * np.array([[-1.0], [1.0]])
        counts = np.ceil((high - low) / voxel) + 1.0
        if counts.prod() > NODES_MAX:
            least = voxel * (counts.prod() / NODES_MAX) ** (1.0 / len(size))
            shown = show_apart(voxel, least, digits=2)
            raise InputError(
                f"voxel is {shown[0]} mm: the grid would have {counts.prod():.3g} nodes, it must "
                f"be at least about {shown[1]} mm"
            )
        return low, counts.astype(np.int64)

    @property
    def _default_voxel(self) -> float:
        """Spacing of the nodes where none is given [mm]."""
        size = np.ptp(self.bounds, axis=0)
        return float((size.prod() / NODES_WANTED) ** (1.0 / len(size)))

    @property
    def _lipschitz(self) -> float:
        """By how much the signed distance changes per mm, at most."""
        return 3.0**0.5 if self.kind == "sampled" else 1.0

    @cached_property
    def _core(self) -> Duct:
        """What kernels see of a duct that does not pack itself."""
        return self.sample()


def check_values(what: str, points: ArrayLike, values: ArrayLike) -> Floats:
    """Return values of a shape at points (..., dim) as an array, or raise `GeometryError`."""
    try:
        array = check_array(what, values)
    except InputError as error:
        raise GeometryError(f"the {error}") from None
    if array.shape != np.shape(points)[:-1] or not np.isfinite(array).all():
        places = check_points("points", points, dim=max(np.shape(points)[-1:], default=3))
        if array.shape != places.shape[:-1]:
            raise GeometryError(
                f"the {what} has shape {array.shape} at points of shape {places.shape}: it must be "
                f"{places.shape[:-1]}"
            )
        _refuse(what, places, array, ~np.isfinite(array), "is {}", "it must be finite")
    return array


def _refuse(
    what: str, points: Floats, values: Floats, wrong: NDArray[np.bool_], found: str, legal: str
) -> None:
    """Raise `GeometryError` that names the first of `points` where `wrong` is true."""
    if wrong.any():
        index = int(np.argmax(wrong))
        place = ", ".join(f"{x:.4g}" for x in points.reshape(-1, points.shape[-1])[index])
        value = float(values.flat[index])
        raise GeometryError(f"the {what} {found.format(value)} at ({place}) mm: {legal}")


def check_duct(name: str, duct: object) -> None:
    """Raise `InputError` unless `duct` is a `Duct`."""
    if not isinstance(duct, Duct):
        raise InputError(f"{name} is a {type(duct).__name__}: it must be a duct")


def _list_shifts(dim: int, *, half: bool = False) -> list[tuple[int, ...]]:
    """Return the steps to neighbours in a sheet, or of each pair of opposite ones one."""
    shifts = list(itertools.product((-1, 0, 1), repeat=dim))
    return shifts[len(shifts) // 2 + 1 :] if half else shifts


def _list_fields(duct: Duct) -> set[str]:
    return {item.name for item in fields(duct) if item.init} if is_dataclass(duct) else set()


@dataclass(frozen=True, kw_only=True, eq=False)
class DuctShape(Duct):
    """A duct that is given by numbers of its own, and not by other ducts.

    Parameters
    ----------
    inflation : float
        The wall is moved outwards by this much [mm].
    wall : str
        What the wall is, in words.
    wall_error : float or None
        How far the true wall may be from the stated one [mm]; 0 if the shape is the lumen itself,
        None where it is not known.
    """

    inflation: float = 0.0
    wall: str = ""
    wall_error: float | None = 0.0

    def __post_init__(self) -> None:
        """Check the inflation, the wall error, and the fields made by `quantity`.

        Of another package's shape also the fields of `columns`, which become arrays: as many rows
        in each, in space unless the class has ``dim = 2``. A class that checks more calls this too.
        """
        check_wall(self.inflation, self.wall_error)
        check_fields(self)
        if self.columns and not type(self).__module__.startswith(f"{__name__.partition('.')[0]}."):
            self._take_columns()

    def _take_columns(self) -> None:
        size = getattr(type(self), "dim", 3)
        size = size if isinstance(size, int) else 3
        shapes = {"lengths": (size,), "numbers": (size,), "axes": (size, size)}
        found = {
            name: freeze_array(name, getattr(self, name), shapes.get(form, ()))
            for name, form in self.columns.values()
        }
        first = next(iter(found))
        check_counts(len(found[first]), found, per=f"row of {first}")
        set_fields(self, **found)


class PackedDuct(Duct):
    """A duct that compiled kernels evaluate: it brings `pack`, a named tuple.

    The tuple is one of this package's, or one of its own whose kernels are registered
    (`duct.kernels.clearance.register_kernels`). It has fields `inflation` and `slack`.
    """

    @abstractmethod
    def pack(self) -> Packed:
        """Return the duct as a named tuple for compiled kernels."""

    def signed_distance(self, points: ArrayLike, /) -> Floats:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside.

        Raises
        ------
        InputError
            If the points are not finite or not (..., dim).
        """
        from .kernels.clearance import evaluate_estimate

        return -self._evaluate(evaluate_estimate, points)

    def clearance_bound(self, points: ArrayLike, /) -> Floats:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        from .kernels.clearance import evaluate_bound

        return self._evaluate(evaluate_bound, points)

    def gradient(self, points: ArrayLike, /) -> Floats:
        """Return the (..., dim) gradient of the signed distance.

        Where it has several (the middle of a ball, equally near walls) one of them, or their mean.
        """
        from .kernels.clearance import evaluate_slope

        slope = -self._evaluate(evaluate_slope, points, 3)
        return self.to_world(slope) - self.to_world(np.zeros(3))

    def to_grid(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., dim) into the kernels' frame (..., 3): planar ones get z = 0."""
        array = np.asarray(points, dtype=np.float64)
        return array if array.shape[-1] == 3 else _lift(array)

    def to_world(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 3) of the kernels' frame into points (..., dim)."""
        return np.asarray(points, dtype=np.float64)[..., : self.dim]

    def _evaluate(self, kernel: Callable[..., None], points: ArrayLike, *columns: int) -> Floats:
        array = check_places("points", points, dim=self.dim)
        # Writable, as kernels are compiled anew for arrays that are not.
        flat = np.require(self.to_grid(array).reshape(-1, 3), requirements=["C", "W"])
        result = np.empty((len(flat), *columns))
        kernel(self.pack(), flat, result)
        return result.reshape((*array.shape[:-1], *columns))


def _lift(points: Floats) -> Floats:
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


# The sampled field: signed distance on a regular grid, in the scanner's world frame.

SPACING_MAX_MM = 1e6
"""Nodes are at most this far apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledField(PackedDuct):
    """Signed distance to a wall, exact at the nodes of a grid and interpolated between them.

    Parameters
    ----------
    values : (nx, ny, nz) float32
        Signed distance at the nodes to the wall before inflation [mm], negative inside.
    spacing : (3,) float
        Distance between nodes along each grid axis [mm].
    origin : (3,) float
        World position of node (0, 0, 0) [mm].
    rotation : (3, 3) float
        Columns are the grid axes in the world frame: orthonormal, a reflection is allowed.
    inflation : float
        The wall is moved outwards by this much [mm]: the field answers ``values - inflation``.
        Moved outwards means that all points within `inflation` of the lumen become lumen, so the
        answer is a lower bound of the clearance inside the moved wall.
    wall : str
        What the wall is, in words.
    wall_error : float or None
        How far the true wall may be from the stated one [mm]: half a voxel's diagonal for labels;
        None where it is not known, as for a surface from a file.
    reach : float
        Distances outside the lumen are exact up to this value [mm]; farther out the field has this
        value or another lower bound of the distance, so `inflate` must stay below it.
    exact_outside : bool
        Whether the wall may be moved outwards: distances outside the lumen are as `reach` states,
        and no body stands in the lumen, which would not move with the wall. Otherwise `inflate` is
        refused: it would promise too much.
    frame : str, optional
        Where the world's axes point in the patient, such as "RAS"; None where it is not known.

    Notes
    -----
    `error` is how far the trilinear interpolant of a 1-Lipschitz function can be from it: half
    the diagonal of a cell (by Jensen's inequality), plus the rounding of float32.
    `clearance_bound` is from the squared node distances inside the lumen, and from the slope bound
    of a distance elsewhere.

    Beyond the grid the distance is that at the grid's nearest point and the distance from there.
    So it never promises clearance that there is not. Where the lumen lies in the grid, it is too
    large by no more than the smaller of the two, besides the error; the gradient is its slope.
    """

    __repr__ = show_briefly

    values: NDArray[np.float32]
    spacing: Floats
    origin: Floats
    rotation: Floats
    inflation: float = 0.0
    wall: str = "sampled wall"
    wall_error: float | None = None
    reach: float = math.inf
    exact_outside: bool = True
    frame: str | None = None
    _rounding: float = dataclass_field(init=False, repr=False, default=0.0)

    kind = "sampled"
    dim = 3

    def __post_init__(self) -> None:
        values = self.values
        if not isinstance(values, np.ndarray) or values.dtype not in (np.float32, np.float64):
            kind = getattr(values, "dtype", type(values).__name__)
            raise InputError(f"field values are {kind}: they must be an array of float32")
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise InputError(
                f"field values have shape {self.values.shape}: it must be (nx, ny, nz), each >= 2"
            )
        low, high = float(self.values.min()), float(self.values.max())
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("field values are not all finite")
        check_wall(self.inflation, self.wall_error)
        spacing, rotation = (
            check_array(f"field {name}", values)
            for name, values in (("spacing", self.spacing), ("rotation", self.rotation))
        )
        if spacing.shape != (3,) or not (spacing.min() > 0.0 and spacing.max() <= SPACING_MAX_MM):
            raise InputError(
                f"field spacing is {spacing} mm: three lengths in (0, {SPACING_MAX_MM:g}] mm"
            )
        if rotation.shape != (3, 3):
            raise InputError(f"field rotation has shape {rotation.shape}: it must be (3, 3)")
        check_rotation("field rotation", rotation, reflection=True)
        origin = check_places("field origin", self.origin)
        if origin.shape != (3,):
            raise InputError(f"field origin has shape {origin.shape}: it must be one point, (3,)")
        check_number("reach", min(self.reach, np.finfo(float).max), low=0.0, unit="mm")
        rounding = max(-low, high) * 2.0**-23
        set_fields(self, spacing=spacing, rotation=rotation, origin=origin, _rounding=rounding)

    @property
    def error(self) -> float:
        """Largest error of the interpolant against the stated wall [mm]."""
        return 0.5 * float(np.linalg.norm(self.spacing)) + self._rounding

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box around the grid, world frame [mm]."""
        size = (np.array(self.values.shape) - 1) * self.spacing
        corners = np.array(np.meshgrid(*[(0.0, s) for s in size], indexing="ij")).reshape(3, -1).T
        world = self.to_world(corners)
        return np.stack([world.min(axis=0), world.max(axis=0)])

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all: two cells less than the reach [mm]."""
        if not self.exact_outside:
            return self.inflation
        return self.reach - 2.0 * float(self.spacing.max())

    def to_grid(self, points: ArrayLike, /) -> Floats:
        """Turn world points (..., 3) into the field's own frame [mm from node 0]."""
        return np.asarray((np.asarray(points, dtype=np.float64) - self.origin) @ self.rotation)

    def to_world(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 3) of the field's own frame [mm from node 0] into world points."""
        world = np.asarray(points, dtype=np.float64) @ self.rotation.T
        world += self.origin
        return world

    def pack(self) -> GridData:
        """Return the field for compiled kernels."""
        return GridData(self.values, self.spacing, float(self.inflation), self._rounding)

    def inflate(self, distance: float) -> SampledField:
        """Return the same lumen with its wall moved outwards by `distance` mm more.

        Raises
        ------
        InputError
            If that is beyond `inflation_max`, or distances outside the lumen are not exact: inflate
            the duct before it is sampled.
        """
        check_number("distance", distance, unit="mm")
        if not self.exact_outside and distance > 0.0:
            raise InputError(
                f"distance is {distance:g} mm: it must be 0 mm, because this field only has lower "
                "bounds of the distance outside, or bodies in its lumen; inflate the duct before "
                "it is sampled"
            )
        most = self.inflation_max - self.inflation
        if distance > 0.0 and distance > most * (1.0 + 1e-12):
            shown = show_apart(distance, max(most, 0.0), self.reach)
            raise InputError(
                f"distance is {shown[0]} mm: it must be at most {shown[1]} mm, because "
                f"distances outside this field's lumen are known up to {shown[2]} mm; build "
                "the field with a larger reach or inflation"
            )
        return replace(self, inflation=self.inflation + distance)


# A duct around one other: its wall moved inwards, a frame changed, a field refined.

EMPTY_SHARE = 1e-4
"""A place with more clearance by this share of the duct's half width is found."""


class Wrapped(Duct):
    """A duct around one other, in the same kernels."""

    @property
    @abstractmethod
    def _inner(self) -> Duct:
        """The other duct."""

    @property
    def kind(self) -> Kind:
        """The distance is a lower bound of the clearance, or sampled."""
        return "sampled" if self._inner.kind == "sampled" else "bound"

    @property
    def error(self) -> float:
        """By how much the distance may promise too much clearance [mm]."""
        return self._inner.error

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return self._inner.wall

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        return self._inner.wall_error

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        return self._inner.inflation

    @property
    def inflation_max(self) -> float:
        """How far the wall can be moved outwards, in all [mm]."""
        return self._inner.inflation_max

    @property
    def bounds(self) -> Floats:
        """(2, dim) corners of a box that holds the duct [mm]."""
        return self._inner.bounds

    @property
    def dim(self) -> int:
        """3, or 2 for a planar duct."""
        return self._inner.dim

    def to_grid(self, points: ArrayLike, /) -> Floats:
        """Turn world points (..., dim) into the kernels' frame (..., 3)."""
        return self._inner.to_grid(points)

    def to_world(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim)."""
        return self._inner.to_world(points)


@dataclass(frozen=True, eq=False)
class PlanarField(Wrapped, PackedDuct):
    """Signed distance in the plane, known at the nodes of a grid and interpolated between them.

    Parameters
    ----------
    layer : SampledField
        A field whose values are the same at both nodes across the plane; `Duct.sample` makes one.
    """

    layer: SampledField

    kind = "sampled"
    dim = 2

    def __post_init__(self) -> None:
        layer = self.layer
        if not isinstance(layer, SampledField):
            raise InputError(f"layer is a {type(layer).__name__}: it must be a SampledField")
        values = layer.values
        if values.shape[2] != 2 or not np.array_equal(values[..., 0], values[..., 1]):
            raise InputError(
                f"layer has values of shape {values.shape}: it must have two equal sheets, "
                "(nx, ny, 2)"
            )
        if np.abs(layer.rotation[2]).tolist() != [0.0, 0.0, 1.0]:
            raise InputError("layer is tilted: its third axis must be across the plane")

    @property
    def _inner(self) -> SampledField:
        return self.layer

    @property
    def error(self) -> float:
        """Largest error of the interpolant against the stated wall [mm]."""
        return 0.5 * float(np.linalg.norm(self.layer.spacing[:2])) + self.layer._rounding

    @property
    def bounds(self) -> Floats:
        """(2, 2) corners of the box around the grid [mm]."""
        return self.layer.bounds[:, :2]

    @property
    def exact_outside(self) -> bool:
        """Whether the wall may be moved outwards, as in the layer."""
        return self.layer.exact_outside

    def to_grid(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 2) into the field's own frame (..., 3)."""
        return self.layer.to_grid(_lift(np.asarray(points, dtype=np.float64)))

    def to_world(self, points: ArrayLike, /) -> Floats:
        """Turn points (..., 3) of the field's own frame into points (..., 2)."""
        return self.layer.to_world(points)[..., :2]

    def pack(self) -> GridData:
        """Return the field for compiled kernels."""
        return self.layer.pack()

    def inflate(self, distance: float) -> PlanarField:
        """Return the same duct with its wall moved outwards by `distance` mm more."""
        return replace(self, layer=self.layer.inflate(distance))


@dataclass(frozen=True, eq=False)
class Eroded(Wrapped):
    """All places of a duct with at least some distance to its wall.

    Parameters
    ----------
    duct : Duct
        Whose wall is moved inwards.
    clearance : float
        By how much [mm].

    Raises
    ------
    InputError
        If the clearance is negative or more than half the duct's box.
    GeometryError
        If no place is left, with the largest clearance found.

    Notes
    -----
    The value is that of the duct plus the clearance: where the duct's is a lower bound of the
    clearance, the places are some of those with the clearance, never others.
    """

    duct: Duct
    clearance: float

    def __post_init__(self) -> None:
        check_duct("duct", self.duct)
        check_number("clearance", self.clearance, low=0.0, unit="mm")
        low, high = self.duct.bounds
        size = float((high - low).min())
        if 2.0 * self.clearance >= size:
            shown = show_apart(self.clearance, 0.5 * size)
            raise InputError(
                f"clearance is {shown[0]} mm: nothing is left of a duct whose box is "
                f"{size:g} mm across, it must lie in [0, {shown[1]}) mm"
            )
        if self.clearance == 0.0:
            return
        least = find_least(
            self.signed_distance,
            low,
            high,
            tolerance=0.5 * EMPTY_SHARE * size,
            enough=0.0,
            slope=self.duct._lipschitz,
        )
        if least.value > 0.0:
            most, place = self.clearance - least.value, ", ".join(f"{x:.4g}" for x in least.place)
            raise GeometryError(
                f"clearance is {self.clearance:g} mm: nothing is left, the largest clearance found "
                f"is {most:.4g} mm, at ({place}) mm"
            )

    @property
    def _inner(self) -> Duct:
        return self.duct

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        return f"{self.duct.wall}, {self.clearance:g} mm inside"

    @property
    def bounds(self) -> Floats:
        """(2, dim) corners of a box that holds the duct [mm]."""
        return np.asarray(self.duct.bounds + np.array([[self.clearance], [-self.clearance]]))

    @property
    def family_shapes(self) -> ShapesData | None:
        """The shapes of this package's kernels that it is made of; None if it is not."""
        shapes = self.duct.family_shapes
        return None if shapes is None else shapes.shift(-self.clearance)

    def signed_distance(self, points: ArrayLike, /) -> Floats:
        """Return the (...) signed distance at points (..., dim) [mm], negative inside."""
        return self.duct.signed_distance(points) + self.clearance

    def gradient(self, points: ArrayLike, /) -> Floats:
        """Return the (..., dim) gradient of the signed distance."""
        return self.duct.gradient(points)

    def clearance_bound(self, points: ArrayLike, /) -> Floats:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        return self.duct.clearance_bound(points) - self.clearance

    def pack(self) -> Packed:
        """Return the duct for compiled kernels."""
        return self._packed

    @cached_property
    def _packed(self) -> Packed:
        return shift_wall(self.duct.pack(), -self.clearance)

    def inflate(self, distance: float) -> Eroded:
        """Return the same with the wall of the duct moved outwards by `distance` mm more."""
        return replace(self, duct=self.duct.inflate(distance))
