"""Where a robot of arcs gets with its tip, drawn at random, and the tendon travel that it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_word
from ..errors import InputError
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import (
    ClosedForm,
    Json,
    Result,
    Shown,
    list_coordinates,
    measured,
    tabulated,
    take_axes,
    to_plain,
)
from .arc import displacements_for, jacobian
from .checks import MAX_COORDINATE_MM, check_cell, check_places, check_values
from .coupling import find_limits, require_arcs
from .inverse import solve_tip
from .kernels.arc import fill_tip_jacobians
from .kernels.inverse import draw_bends, move_inside
from .robot import RobotDesign

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FLAT_THICKNESS_RATIO = 1e-9
"""Thickness over width below which a set of points has no volume."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkspaceSample(ClosedForm):
    """Legal shapes of a robot, drawn evenly in the bends, which is not evenly in space.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    bends : (n, m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    displacements : (n, t) ndarray
        Displacements of the tendons [mm].
    tip_frames : (n, 4, 4) ndarray
        Frames of the tip [mm].
    jacobians : (n, 6, 2 m) ndarray
        Tip Jacobians by the bends, as of `bozzini.continuum.arc.jacobian`.
    """

    robot: RobotDesign
    bends: Floats = measured("rad")
    displacements: Floats = tabulated("mm", "displacement_{}", over="robot.tendon_names")
    tip_frames: Floats
    jacobians: Floats

    @property
    def tips(self) -> Floats:
        """Places of the tip [mm], shape (n, 3)."""
        return self.tip_frames[:, :3, 3]

    @property
    def tangents(self) -> Floats:
        """Directions in which the tip looks, shape (n, 3)."""
        return self.tip_frames[:, :3, 2]

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each shape."""
        return {**list_coordinates("tip", self.tips), **super().list_columns()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tips by distance from the axis and height, and return the axes."""
        axes = take_axes(ax, x="distance from the axis [mm]", y="z [mm]", equal=True)
        x, y, z = self.tips.T
        axes.plot(np.hypot(x, y), z, ".", markersize=2.0)
        return axes


@dataclass(frozen=True, kw_only=True)
class WorkspaceVolume(ClosedForm):
    """The volume that the tips of a sample take.

    Parameters
    ----------
    hull : float
        Volume of the tips' convex hull [mm^3]; hollows count in full.
    occupied : float
        Volume of the cells that hold a tip [mm^3].
    cell : float
        Edge of a cell [mm].
    cells : int
        Cells that hold a tip.
    coverage : float
        Chance that one more tip falls in a cell that holds one already (Good 1953): near 1 the
        sample is large enough for its cells, otherwise `occupied` is too small.
    reach : float
        Largest distance of a tip from the base [mm].
    """

    hull: float = measured("mm3")
    occupied: float = measured("mm3")
    cell: float = measured("mm")
    cells: int
    coverage: float
    reach: float = measured("mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class TendonTravel(Shown):
    """Displacements that tendons need over a set of bends.

    Parameters
    ----------
    names : tuple of str
        Names of the tendons.
    low, high : (t,) ndarray
        Smallest and largest displacement [mm]; the rest, 0, counts as one of the bends.
    allowed : (t, 2) ndarray
        What their drives allow [mm].
    """

    names: tuple[str, ...]
    low: Floats
    high: Floats
    allowed: Floats

    @property
    def stroke(self) -> Floats:
        """Length of travel of each tendon [mm]."""
        return self.high - self.low


def sample_workspace(
    robot: RobotDesign, count: int = 20_000, *, seed: int = 0, bend_cap: float = math.pi
) -> WorkspaceSample:
    """Draw legal shapes, evenly in the bends within all limits of sections and tendons.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    count : int
        How many, in [1, 10 million].
    seed : int
        Of the random numbers: one seed, one sample.
    bend_cap : float
        Largest bend [rad] that is drawn where a section allows more.

    Returns
    -------
    WorkspaceSample

    Raises
    ------
    InputError
        If a number is outside its range.
    GeometryError
        If the tendons are not parallel, or the limits leave no shape at all.
    """
    check_integer("count", count, low=1, high=10_000_000)
    seed = check_integer("seed", seed, low=0)
    cap = check_number("bend_cap", bend_cap, low=0.0, low_open=True, unit="rad")
    limits = find_limits(robot)
    discs, rows, low, high = limits.kernel
    bounds = (np.minimum(discs, cap), rows, low, high)
    start = np.zeros((len(limits.lengths), 2))
    if not move_inside(bounds, start):
        raise limits.explain_empty()
    drawn = np.empty((count, start.size))
    if len(limits.basis):
        thin = 4 * start.size
        random = np.random.default_rng(seed)
        # Walk away from the start before the first sample counts.
        draw_bends(random, start.ravel(), limits.basis, *bounds, 50 * thin, drawn[:1])
        draw_bends(random, drawn[0].copy(), limits.basis, *bounds, thin, drawn)
    else:
        drawn[:] = start.ravel()
    bends = drawn.reshape(count, *start.shape)
    frames = np.empty((count, 4, 4))
    jacobians = np.empty((count, 6, start.size))
    fill_tip_jacobians(limits.lengths, bends, frames, jacobians)
    return WorkspaceSample(
        robot=robot,
        bends=bends,
        displacements=drawn @ limits.coupling.matrix.T,
        tip_frames=frames,
        jacobians=jacobians,
    )


def measure_volume(tips: ArrayLike, *, cell: float) -> WorkspaceVolume:
    """Measure the volume that tips take.

    Parameters
    ----------
    tips : array_like, shape (n, 3)
        Places of the tip [mm].
    cell : float
        Edge of the cubes that are counted [mm].

    Returns
    -------
    WorkspaceVolume

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    """
    points = check_places("tips", tips)
    if points.ndim != 2 or not len(points):
        raise InputError(f"tips has shape {points.shape}: it must be (n, 3), n at least 1")
    edge = check_number("cell", cell, low=1e-6, high=MAX_COORDINATE_MM, unit="mm")
    _, counts = np.unique(np.floor(points / edge).astype(np.int64), axis=0, return_counts=True)
    return WorkspaceVolume(
        hull=_hull_volume(points),
        occupied=len(counts) * edge**3,
        cell=edge,
        cells=len(counts),
        coverage=1.0 - float(np.count_nonzero(counts == 1)) / len(points),
        reach=float(np.linalg.norm(points, axis=1).max()),
    )


def tendon_travel(robot: RobotDesign, bends: ArrayLike) -> TendonTravel:
    """Return the displacements that a set of bends asks of each tendon.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    bends : array_like, shape (..., m, 2)
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].

    Returns
    -------
    TendonTravel

    Raises
    ------
    InputError
        If `bends` has another shape or is not finite.
    GeometryError
        If the tendons are not parallel.
    """
    require_arcs(robot, "a workspace")
    moved = displacements_for(robot, bends).reshape(-1, len(robot.tendons))
    return TendonTravel(
        names=robot.tendon_names,
        low=moved.min(axis=0, initial=0.0),
        high=moved.max(axis=0, initial=0.0),
        allowed=robot.tendon_travel,
    )


def _hull_volume(points: Floats) -> float:
    from scipy.spatial import ConvexHull

    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[2] <= FLAT_THICKNESS_RATIO * spread[0]:
        return 0.0
    return float(ConvexHull(points).volume)


# How well a robot of arcs moves and turns its tip: manipulability, and directions at a place.

Part = Literal["position", "rotation", "pose"]
"""Which motion of the tip."""

PARTS: dict[Part, slice] = {"position": slice(0, 3), "rotation": slice(3, 6), "pose": slice(0, 6)}

SINGULAR_VALUE_RATIO = 1e-12
"""Ratio of singular values that counts as 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Manipulability(Shown):
    """How a change of the bends moves the tip.

    Parameters
    ----------
    part : str
        What of the tip's motion: position, rotation or pose.
    singular_values : (..., r) ndarray
        Of the Jacobian, largest first: mm/rad for position, rad/rad for rotation.
    """

    part: Part
    singular_values: Floats

    @property
    def measure(self) -> Floats:
        """Product of the singular values, ``sqrt(det(J J^T))`` (Yoshikawa 1985).

        With fewer freedoms than the part has, it is ``sqrt(det(J^T J))``.
        """
        return np.asarray(np.prod(self.singular_values, axis=-1))

    @property
    def condition(self) -> Floats:
        """Largest over smallest singular value, at least 1; infinite where singular."""
        most, least = self.singular_values[..., 0], self.singular_values[..., -1]
        regular = least > SINGULAR_VALUE_RATIO * most
        return np.where(regular, most / np.where(regular, least, 1.0), math.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class Dexterity(Shown):
    """Directions in which the tip can look from one place.

    Parameters
    ----------
    place : (3,) ndarray
        The place [mm].
    directions : (k, 3) ndarray
        Directions that were tried, evenly over the sphere.
    reached : (k,) ndarray of bool
        Whether the tip can be there and look so.
    """

    place: Floats
    directions: Floats
    reached: NDArray[np.bool_]

    @property
    def share(self) -> float:
        """Share of the directions that are reached, from 0 to 1."""
        return float(np.mean(self.reached))


@dataclass(frozen=True, kw_only=True, eq=False)
class DexterityMap(ClosedForm):
    """Cells of space with the tips of a sample in them.

    Parameters
    ----------
    cell : float
        Edge of a cell [mm].
    centres : (c, 3) ndarray
        Centres of the cells that hold a tip [mm]; with ``half_plane`` y is 0.
    counts : (c,) ndarray of int
        Tips in each.
    direction_share : (c,) ndarray
        Share of directions in which a tip in the cell looks: a lower bound that grows with the
        sample.
    manipulability : (c,) ndarray
        Mean measure for the position in the cell [mm^r/rad^r], ``r`` at most 3.
    condition : (c,) ndarray
        Smallest condition number for the position in the cell.
    half_plane : bool
        Whether cells are rings about the base's axis, by their distance from it (x) and z.
    rank : int
        ``r``, singular values that the measure is the product of.
    """

    cell: float = measured("mm")
    centres: Floats = measured("mm")
    counts: NDArray[np.int64]
    direction_share: Floats
    manipulability: Floats
    condition: Floats
    half_plane: bool
    rank: int = 3

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the cells as columns, units in the names."""
        columns: dict[str, NDArray[np.generic]] = {
            "from_axis_mm" if self.half_plane else "x_mm": self.centres[:, 0],
            "y_mm": self.centres[:, 1],
            "z_mm": self.centres[:, 2],
            "tips": self.counts,
            "direction_share": self.direction_share,
            "manipulability": self.manipulability,
            "condition": self.condition,
        }
        if self.half_plane:
            del columns["y_mm"]
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the share of directions in each cell, seen along y, and return the axes."""
        across = "distance from the axis" if self.half_plane else "x"
        axes = take_axes(ax, x=f"{across} [mm]", y="z [mm]", equal=True)
        order = np.argsort(self.direction_share)
        x, _, z = self.centres[order].T
        drawn = axes.scatter(x, z, c=self.direction_share[order], s=9.0, vmin=0.0)
        axes.figure.colorbar(drawn, ax=axes, label="share of directions")
        return axes

    @property
    def most_directions(self) -> tuple[Floats, float]:
        """Centre of the cell with the most directions [mm], and its share of them."""
        best = int(self.direction_share.argmax())
        return self.centres[best], float(self.direction_share[best])


def manipulability(
    robot: RobotDesign,
    bends: ArrayLike,
    *,
    part: Part = "position",
    turn_length: float | None = None,
) -> Manipulability:
    """Return how the tip moves with the bends that the tendons control.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    bends : array_like, shape (..., m, 2)
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    part : {"position", "rotation", "pose"}
        Which motion of the tip.
    turn_length : float, optional
        Length by which rotation is multiplied in the pose [mm]; the robot's length by pi unless
        given. It has to be chosen: a pose has no natural unit.

    Returns
    -------
    Manipulability

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    GeometryError
        If the tendons are not parallel.
    """
    check_word("part", part, PARTS)
    scale = check_number(
        "turn_length",
        robot.length / math.pi if turn_length is None else turn_length,
        low=0.0,
        low_open=True,
        unit="mm",
    )
    return _measure(robot, jacobian(robot, bends), part, scale)


def _measure(
    robot: RobotDesign, jacobians: Floats, part: Part, turn_length: float
) -> Manipulability:
    rows = jacobians[..., PARTS[part], :] @ find_limits(robot).basis.T
    if part == "pose":
        rows[..., 3:, :] *= turn_length
    if not rows.shape[-1]:
        return Manipulability(part=part, singular_values=np.zeros((*rows.shape[:-2], 1)))
    values = np.linalg.svd(rows, compute_uv=False)
    return Manipulability(part=part, singular_values=np.asarray(values, dtype=np.float64))


def measure_dexterity(
    robot: RobotDesign,
    place: ArrayLike,
    *,
    directions: int = 100,
    starts: int = 8,
    progress: Progress = no_progress,
) -> Dexterity:
    """Try directions, evenly over the sphere, in which the tip may look from a place.

    Each is tried by the inverse, so a share of 0.3 means that 30 % were reached; more `starts`
    can only find more.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    place : array_like, shape (3,)
        Where the tip shall be [mm].
    directions : int
        How many, in [1, 100000].
    starts : int
        Starts of the inverse for each.
    progress : callable
        Called with the share that is done.

    Returns
    -------
    Dexterity

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    GeometryError
        If the tendons are not parallel, or the limits leave no shape at all.
    """
    check_integer("directions", directions, low=1, high=100_000)
    target = check_values("place", place, (3,), unit="mm")
    ways = spread_directions(directions)
    reached = np.zeros(directions, dtype=bool)
    for index, way in enumerate(ways):
        reached[index] = solve_tip(robot, target, direction=way, starts=starts).converged
        progress("directions", (index + 1) / directions)
    return Dexterity(place=target, directions=ways, reached=reached)


def map_dexterity(
    sample: WorkspaceSample, *, cell: float, directions: int = 100, half_plane: bool = False
) -> DexterityMap:
    """Sort a sample's tips into cells, and measure how freely they look and move there.

    Parameters
    ----------
    sample : WorkspaceSample
        Tips of a robot.
    cell : float
        Edge of a cell [mm], at least a thousandth of the robot's length.
    directions : int
        Patches of the sphere that directions are sorted into, in [1, 100000].
    half_plane : bool
        Whether to turn all tips about the base's axis into one half-plane first, which suits a
        robot that bends alike every way.

    Returns
    -------
    DexterityMap

    Raises
    ------
    InputError
        If a number is outside its range.
    """
    from scipy.spatial import KDTree

    edge = check_cell(cell, sample.robot.length)
    check_integer("directions", directions, low=1, high=100_000)
    tips, tangents = sample.tips, sample.tangents
    if half_plane:
        tips, tangents = _turn_to_half_plane(tips, tangents)
    cells, where, counts = np.unique(
        np.floor(tips / edge).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    where = where.ravel()
    _, patch = KDTree(spread_directions(directions)).query(tangents)
    seen = np.unique(where * directions + patch) // directions
    values = _measure(sample.robot, sample.jacobians, "position", 1.0)
    condition = np.full(len(cells), math.inf)
    np.minimum.at(condition, where, values.condition)
    centres = np.asarray((cells + 0.5) * edge, dtype=np.float64)
    if half_plane:
        centres[:, 1] = 0.0
    return DexterityMap(
        cell=edge,
        centres=centres,
        counts=counts,
        direction_share=np.bincount(seen, minlength=len(cells)) / directions,
        manipulability=np.bincount(where, values.measure, len(cells)) / counts,
        condition=condition,
        half_plane=half_plane,
        rank=values.singular_values.shape[-1],
    )


def spread_directions(count: int) -> Floats:
    """Return unit vectors evenly over the sphere, a Fibonacci lattice, shape (count, 3)."""
    turn = math.pi * (3.0 - math.sqrt(5.0))
    index = np.arange(check_integer("count", count, low=1, high=1_000_000))
    z = 1.0 - (2.0 * index + 1.0) / count
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn * index), across * np.sin(turn * index), z], axis=-1)


def _turn_to_half_plane(tips: Floats, tangents: Floats) -> tuple[Floats, Floats]:
    across = np.hypot(tips[:, 0], tips[:, 1])
    far = across > 0.0
    unit = np.where(far[:, None], tips[:, :2] / np.where(far, across, 1.0)[:, None], (1.0, 0.0))
    along = np.sum(tangents[:, :2] * unit, axis=1)
    aside = unit[:, 0] * tangents[:, 1] - unit[:, 1] * tangents[:, 0]
    turned = np.stack([across, np.zeros_like(across), tips[:, 2]], axis=-1)
    return turned, np.stack([along, aside, tangents[:, 2]], axis=-1)


CELLS_ALONG_ROBOT = 30.0
"""Cells along the robot's length, where no size is asked for."""

ENOUGH_COVERAGE = 0.9
"""Coverage from which a sample is large enough for its cells."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinuumWorkspace(Result):
    """Where the tip gets, in how many directions, and the tendon travel that it takes.

    Parameters
    ----------
    sample : WorkspaceSample
        Shapes drawn at random.
    volume : WorkspaceVolume
        The volume that their tips take.
    travel : TendonTravel
        The displacements that they need.
    map : DexterityMap
        Directions and manipulability, cell by cell.
    """

    sample: WorkspaceSample
    volume: WorkspaceVolume
    travel: TendonTravel
    map: DexterityMap

    @property
    def converged(self) -> bool:
        """Whether the sample is large enough for its cells: its coverage is 0.9 or more."""
        return self.volume.coverage >= ENOUGH_COVERAGE

    @property
    def reason(self) -> str:
        """What to do otherwise."""
        return "" if self.converged else "take more shapes or larger cells"

    @property
    def residual(self) -> float:
        """Chance that one more shape falls in a cell that is not known."""
        return 1.0 - self.volume.coverage

    def to_dict(self) -> Json:
        """Return the workspace as plain values, units in the names."""
        place, share = self.map.most_directions
        travel, volume = self.travel, self.volume
        plain = to_plain(
            {
                "converged": self.converged,
                "reason": self.reason,
                "residual": self.residual,
                "reach_mm": volume.reach,
                "hull_mm3": volume.hull,
                "occupied_mm3": volume.occupied,
                "cell_mm": volume.cell,
                "coverage": volume.coverage,
                "tendons": {
                    name: {
                        "low_mm": travel.low[k],
                        "high_mm": travel.high[k],
                        "stroke_mm": travel.stroke[k],
                        "allowed_mm": travel.allowed[k],
                    }
                    for k, name in enumerate(travel.names)
                },
                "most_directions": {"place_mm": place, "share": share},
                "map": self.list_columns(),
                "manipulability_unit": f"mm^{self.map.rank}/rad^{self.map.rank}",
            }
        )
        return dict(plain)

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: the map, a cell each row."""
        return self.map.list_columns()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the map and the robot at rest, and return the axes; see `DexterityMap.plot`."""
        axes = self.map.plot(ax)
        axes.plot([0.0, 0.0], [0.0, self.sample.robot.length], "k", linewidth=2.0)
        return axes


def measure_workspace(
    sample: WorkspaceSample,
    *,
    cell: float | None = None,
    directions: int = 100,
    half_plane: bool = True,
) -> ContinuumWorkspace:
    """Measure volume, dexterity and tendon travel of a sample.

    Parameters
    ----------
    sample : WorkspaceSample
        Of `sample_workspace`.
    cell : float, optional
        Edge of a cell [mm]; a thirtieth of the robot's length unless given.
    directions, half_plane
        As of `map_dexterity`.

    Raises
    ------
    InputError
        If a number is outside its range.
    """
    edge = sample.robot.length / CELLS_ALONG_ROBOT if cell is None else cell
    dexterity = map_dexterity(sample, cell=edge, directions=directions, half_plane=half_plane)
    return ContinuumWorkspace(
        sample=sample,
        volume=measure_volume(sample.tips, cell=edge),
        travel=tendon_travel(sample.robot, sample.bends),
        map=dexterity,
    )
