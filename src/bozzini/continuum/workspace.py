"""Where a robot of arcs gets with its tip, drawn at random, and the tendon travel that it takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from ._bend_limits import find_limits
from .arc import displacements_for
from .checks import FARTHEST, check_places
from .coupling import require_arcs
from .kernels.arc import fill_tip_jacobians
from .kernels.inverse import move_inside
from .kernels.workspace import draw_bends
from .robot import ContinuumRobot

__all__ = [
    "TendonTravel",
    "WorkspaceSample",
    "WorkspaceVolume",
    "measure_volume",
    "sample_workspace",
    "tendon_travel",
]

Floats = NDArray[np.float64]

FLAT = 1e-9
"""Thickness over width below which a set of points has no volume."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkspaceSample:
    """Legal shapes of a robot, drawn evenly in the bends, which is not evenly in space.

    Parameters
    ----------
    robot : ContinuumRobot
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

    robot: ContinuumRobot
    bends: Floats
    displacements: Floats
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


@dataclass(frozen=True, kw_only=True)
class WorkspaceVolume:
    """How much room the tips of a sample take.

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

    hull: float
    occupied: float
    cell: float
    cells: int
    coverage: float
    reach: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TendonTravel:
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

    @property
    def exceeded(self) -> tuple[str, ...]:
        """A sentence for each tendon that needs more than its drive allows."""
        words = []
        for index, name in enumerate(self.names):
            low, high = self.allowed[index]
            if self.low[index] < low or self.high[index] > high:
                words.append(
                    f"tendon '{name}' needs [{self.low[index]:.4g}, {self.high[index]:.4g}] mm: "
                    f"its travel is [{low:g}, {high:g}] mm"
                )
        return tuple(words)


def sample_workspace(
    robot: ContinuumRobot, count: int = 20_000, *, seed: int = 0, bend_cap: float = math.pi
) -> WorkspaceSample:
    """Draw legal shapes, evenly in the bends within all limits of sections and tendons.

    Parameters
    ----------
    robot : ContinuumRobot
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
    check_integer("seed", seed, low=0)
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
    """Measure the room that tips take.

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
    edge = check_number("cell", cell, low=1e-6, high=FARTHEST, unit="mm")
    _, counts = np.unique(np.floor(points / edge).astype(np.int64), axis=0, return_counts=True)
    return WorkspaceVolume(
        hull=_hull_volume(points),
        occupied=len(counts) * edge**3,
        cell=edge,
        cells=len(counts),
        coverage=1.0 - float(np.count_nonzero(counts == 1)) / len(points),
        reach=float(np.linalg.norm(points, axis=1).max()),
    )


def tendon_travel(robot: ContinuumRobot, bends: ArrayLike) -> TendonTravel:
    """Return the displacements that a set of bends asks of each tendon.

    Parameters
    ----------
    robot : ContinuumRobot
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
    if len(points) < 4 or spread[2] <= FLAT * spread[0]:
        return 0.0
    return float(ConvexHull(points).volume)
