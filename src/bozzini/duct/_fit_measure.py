"""How well shapes stand for a duct: what they lose, what they gain, how far they reach outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from ..progress import Progress, no_progress
from ._fit_rays import cast_rays
from ._fit_search import Highest, find_highest
from .centreline import Centreline
from .protocol import Duct, count_dimensions
from .sections import Sections, cut_sections

__all__ = [
    "PERCENTS",
    "FitReport",
    "explain_shortfall",
    "find_inner",
    "find_outside",
    "measure_fit",
]

PERCENTS = (0, 5, 25, 50, 75, 95, 100)
"""The percentiles of a report."""

TOLERANCE = 0.02
"""How far the bound may be above what was found outside [mm]."""

CELLS = 96
"""Volumes are measured with about this many cells along the longest side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FitReport:
    """What a fitted duct keeps of the true one.

    Attributes
    ----------
    pieces : int
        Number of shapes.
    outside, outside_bound : float
        How far a point of the fitted lumen was found to lie outside the true one, and what no
        point exceeds [mm]; 0 where it all lies inside.
    outside_place : (dim,) float
        Where the farthest was found [mm].
    volume_true, volume_fitted : float
        Of both lumens [mm^3]; areas [mm^2] of planar ones.
    volume_kept, volume_lost, volume_gained : float
        In both, in the true one only, in the fitted one only.
    volume_error : float
        Two standard errors of the largest of these.
    wall : (7,) float
        Percentiles `PERCENTS` of how much farther the fitted wall is than the true one along
        rays across the centreline [mm]: negative where room is lost.
    room_loss : (7,) float
        The same percentiles of how much room a planner loses on the centreline: the distance to
        the true wall less what the fitted duct says [mm]. Not so near the ends that these are
        the nearest wall: where a duct ends is a convention.
    room_loss_place : float
        Arc length of the centreline where most is lost [mm].
    """

    pieces: int
    outside: float
    outside_bound: float
    outside_place: NDArray[np.float64]
    volume_true: float
    volume_fitted: float
    volume_kept: float
    volume_lost: float
    volume_gained: float
    volume_error: float
    wall: NDArray[np.float64]
    room_loss: NDArray[np.float64]
    room_loss_place: float

    @property
    def kept(self) -> float:
        """Share of the true volume that is kept."""
        return self.volume_kept / self.volume_true


def measure_fit(
    fitted: Duct,
    duct: Duct,
    centreline: Centreline,
    *,
    pieces: int,
    max_error: float = 0.0,
    sections: Sections | None = None,
    progress: Progress = no_progress,
) -> FitReport:
    """Measure what `fitted` keeps of `duct`.

    Parameters
    ----------
    fitted, duct : Duct
        Of three dimensions.
    centreline : Centreline
        Along which walls and room are compared.
    pieces : int
        How many shapes there are, for the report.
    max_error : float
        How far outside points of the fitted lumen may be: if none is found farther, the bound is
        not made any tighter than this [mm].
    sections : Sections, optional
        Of `duct`, if they are there already.

    Raises
    ------
    InputError
        If a duct is planar, or an argument is not legal.

    Notes
    -----
    How far outside a point lies is what `duct` says: exact for meshes, balls and round cones, and
    within `error` for sampled fields. A union of super-ellipsoids as the true duct says less than
    that.
    """
    check_number("max error", max_error, low=0.0, unit="mm")
    for name, one in (("fitted duct", fitted), ("duct", duct)):
        if count_dimensions(one) != 3:
            raise InputError(f"the {name} has 2 dimensions: it must have 3")
    progress("measure", 0.0)
    cuts = cut_sections(duct, centreline) if sections is None else sections
    rays = cuts.directions.reshape(-1, 3)
    starts = np.repeat(cuts.centres, cuts.directions.shape[1], axis=0)
    reach = 2.0 * float(cuts.lengths.max())
    across = cast_rays(fitted, starts, rays, reach=reach) - cuts.lengths.reshape(-1)
    room = -duct.signed_distance(cuts.centres)
    inner = find_inner(cuts.arc_length, room)
    loss = (room + fitted.signed_distance(cuts.centres))[inner]
    arc = cuts.arc_length[inner]
    progress("measure", 0.3)
    highest = find_outside(fitted, duct, max_error=max_error)
    progress("measure", 0.7)
    volumes, error = _measure_volumes(fitted, duct)
    kept, lost, gained = (float(volume) for volume in volumes)
    progress("measure", 1.0)
    return FitReport(
        pieces=pieces,
        outside=max(highest.value, 0.0),
        outside_bound=max(highest.bound, 0.0),
        outside_place=highest.place,
        volume_true=kept + lost,
        volume_fitted=kept + gained,
        volume_kept=kept,
        volume_lost=lost,
        volume_gained=gained,
        volume_error=2.0 * error,
        wall=np.percentile(across, PERCENTS),
        room_loss=np.percentile(loss, PERCENTS),
        room_loss_place=float(arc[int(np.argmax(loss))]),
    )


def find_inner(arc_length: NDArray[np.float64], room: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which places (n,) have no end of the way as near as their wall; all, if none has."""
    inner = np.minimum(arc_length, arc_length[-1] - arc_length) >= room
    return inner if inner.any() else np.full(len(room), True)


def explain_shortfall(report: FitReport, max_error: float, *, free: bool) -> str:
    """Return what an error is exceeded by, with `free` on the centreline too; else nothing."""
    if report.outside > max_error:
        return (
            f"a point of the fitted lumen is {report.outside:.2f} mm outside, more than "
            f"{max_error:g} mm"
        )
    if report.outside_bound > max_error:
        return (
            f"none is found more than {report.outside:.2f} mm outside, but only "
            f"{report.outside_bound:.2f} mm is proved"
        )
    if free and report.room_loss[-1] > max_error:
        return (
            f"{report.room_loss[-1]:.2f} mm of the room on the centreline is lost at "
            f"{report.room_loss_place:.1f} mm, more than {max_error:g} mm"
        )
    return ""


def find_outside(fitted: Duct, duct: Duct, *, max_error: float) -> Highest:
    """Return how far points of `fitted` lie outside `duct` [mm], found and bounded.

    The search cuts cubes until none can hold a point of the fitted lumen that is farther outside;
    it rests on both distances being 1-Lipschitz, and is rigorous.
    """
    exact = duct.kind != "sampled"

    def measure(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        distance = duct.signed_distance(points)
        return distance, distance if exact else -duct.clearance_bound(points)

    return find_highest(
        measure,
        fitted.signed_distance,
        fitted.bounds,
        ceiling=max_error,
        tolerance=TOLERANCE,
        slack=fitted.error,
    )


def _measure_volumes(fitted: Duct, duct: Duct) -> tuple[NDArray[np.float64], float]:
    """Return the volumes in both, in `duct` only, in `fitted` only, and their standard error.

    Cells that lie on one side of both walls count as a whole, others are cut; the smallest are
    settled by two points each at random, whose difference tells the error.
    """
    both = np.stack([fitted.bounds, duct.bounds])
    low, high = both[:, 0].min(axis=0), both[:, 1].max(axis=0)
    levels = 3
    edge = float((high - low).max()) / CELLS * 2.0**levels
    counts = np.maximum(np.ceil((high - low) / edge).astype(int), 1)
    axes = [low[k] + edge * (np.arange(counts[k]) + 0.5) for k in range(3)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    parts = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    volumes = np.zeros(3)
    for level in range(levels + 1):
        reach = 0.5 * edge * 3.0**0.5
        one, other = fitted.signed_distance(cells), duct.signed_distance(cells)
        done = (np.abs(one) > reach + fitted.error) & (np.abs(other) > reach + duct.error)
        volumes += edge**3 * _count(one[done] < 0.0, other[done] < 0.0).sum(axis=0)
        cells = cells[~done]
        if level < levels:
            edge *= 0.5
            cells = (cells[:, None] + edge * parts).reshape(-1, 3)
    random = np.random.default_rng(0)
    guesses = []
    for _ in range(2):
        points = cells + edge * random.uniform(-0.5, 0.5, cells.shape)
        inside = fitted.signed_distance(points) < 0.0, duct.signed_distance(points) < 0.0
        guesses.append(edge**3 * _count(*inside))
    volumes += 0.5 * (guesses[0] + guesses[1]).sum(axis=0)
    variance = 0.25 * ((guesses[0] - guesses[1]) ** 2).sum(axis=0)
    return volumes, float(np.sqrt(variance.max()))


def _count(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.stack([one & other, other & ~one, one & ~other], axis=1).astype(np.float64)
