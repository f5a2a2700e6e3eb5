"""How well a robot of arcs moves and turns its tip: manipulability, and directions at a place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from ..progress import Progress, no_progress
from ._bend_limits import find_limits
from .arc import jacobian
from .checks import check_cell, check_values
from .inverse import solve_tip
from .robot import ContinuumRobot
from .workspace import WorkspaceSample

__all__ = [
    "Dexterity",
    "DexterityMap",
    "Manipulability",
    "check_cell",
    "manipulability",
    "map_dexterity",
    "measure_dexterity",
    "spread_directions",
]

Floats = NDArray[np.float64]

PARTS = {"position": slice(0, 3), "rotation": slice(3, 6), "pose": slice(0, 6)}

SINGULAR = 1e-12
"""Ratio of singular values that counts as 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Manipulability:
    """How a change of the bends moves the tip.

    Parameters
    ----------
    part : str
        What of the tip's motion: position, rotation or pose.
    singular_values : (..., r) ndarray
        Of the Jacobian, largest first: mm/rad for position, rad/rad for rotation.
    """

    part: str
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
        regular = least > SINGULAR * most
        return np.where(regular, most / np.where(regular, least, 1.0), math.inf)


@dataclass(frozen=True, kw_only=True, eq=False)
class Dexterity:
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
class DexterityMap:
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
        Whether cells are rings about the base's axis, told by distance from it (x) and z.
    rank : int
        ``r``, singular values that the measure is the product of.
    """

    cell: float
    centres: Floats
    counts: NDArray[np.int64]
    direction_share: Floats
    manipulability: Floats
    condition: Floats
    half_plane: bool
    rank: int = 3


def manipulability(
    robot: ContinuumRobot,
    bends: ArrayLike,
    *,
    part: str = "position",
    turn_length: float | None = None,
) -> Manipulability:
    """Return how the tip moves with the bends that the tendons control.

    Parameters
    ----------
    robot : ContinuumRobot
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
    if part not in PARTS:
        raise InputError(f"part is {part!r}: choose one of {tuple(PARTS)}")
    scale = check_number(
        "turn_length",
        robot.length / math.pi if turn_length is None else turn_length,
        low=0.0,
        low_open=True,
        unit="mm",
    )
    return _measure(robot, jacobian(robot, bends), part, scale)


def _measure(
    robot: ContinuumRobot, jacobians: Floats, part: str, turn_length: float
) -> Manipulability:
    rows = jacobians[..., PARTS[part], :] @ find_limits(robot).basis.T
    if part == "pose":
        rows[..., 3:, :] *= turn_length
    if not rows.shape[-1]:
        return Manipulability(part=part, singular_values=np.zeros((*rows.shape[:-2], 1)))
    values = np.linalg.svd(rows, compute_uv=False)
    return Manipulability(part=part, singular_values=np.asarray(values, dtype=np.float64))


def measure_dexterity(
    robot: ContinuumRobot,
    place: ArrayLike,
    *,
    directions: int = 100,
    starts: int = 8,
    progress: Progress = no_progress,
) -> Dexterity:
    """Try directions, evenly over the sphere, in which the tip may look from a place.

    Each is tried by the inverse, so a share of 0.3 says that 30 % were reached; more `starts`
    can only find more.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    place : array_like, shape (3,)
        Where the tip shall be [mm].
    directions : int
        How many, in [1, 100000].
    starts : int
        Starts of the inverse for each.
    progress : callable
        Told the share that is done.

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
        reached[index] = solve_tip(robot, target, direction=way, starts=starts).success
        progress("directions", (index + 1) / directions)
    return Dexterity(place=target, directions=ways, reached=reached)


def map_dexterity(
    sample: WorkspaceSample, *, cell: float, directions: int = 100, half_plane: bool = False
) -> DexterityMap:
    """Sort a sample's tips into cells, and say how freely they look and move there.

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
