"""How well shapes stand for a duct: what they lose, what they gain, how far they reach outside."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_integer, check_number, check_range, show_apart
from ...errors import GeometryError, InputError
from ...numeric.polylines import carry_frames, interpolate_polyline
from ...progress import Progress, no_progress
from ..base import Duct
from ..centreline import Centreline, find_tangents
from ..search import Highest, find_highest
from ..shapes.quads import Polygon
from .points import fit_circle

# Rays from inside a duct to its wall, many at a time.

STEP = 0.1
"""Smallest step of a ray [mm]: a wall thinner than this may be passed over."""

PLACE = 1e-11
"""How exactly the wall is found [mm]."""


def cast_rays(
    duct: Duct, starts: NDArray[np.float64], directions: NDArray[np.float64], *, reach: float
) -> NDArray[np.float64]:
    """Return (n,) how far rays go from `starts` until they first leave the duct [mm].

    A ray advances by its clearance, so it passes over no wall that is thicker than
    `STEP`; then the wall is found by bisection.

    Parameters
    ----------
    duct : Duct
    starts : (n, dim) float
        A ray that starts outside the duct has length 0.
    directions : (n, dim) float
        Unit vectors.
    reach : float
        A ray ends here at the latest [mm].
    """
    # The interpolant of a sampled distance is steeper than the distance, by up to sqrt(3).
    slope = math.sqrt(3.0) if duct.kind == "sampled" else 1.0
    last = np.zeros(len(starts))  # still inside
    ahead = np.zeros(len(starts))  # to be asked; in the end outside
    going = np.arange(len(starts))
    while len(going):
        points = starts[going] + ahead[going, None] * directions[going]
        clearance = -duct.signed_distance(points)
        inside = clearance > 0.0
        going, clearance = going[inside], clearance[inside]
        last[going] = ahead[going]
        ahead[going] += np.maximum(clearance / slope, STEP)
        gone = ahead[going] >= reach
        last[going[gone]] = ahead[going[gone]] = reach
        going = going[~gone]
    going = np.flatnonzero(ahead > last)
    while len(going):
        middle = 0.5 * (last[going] + ahead[going])
        inside = duct.signed_distance(starts[going] + middle[:, None] * directions[going]) < 0.0
        last[going[inside]] = middle[inside]
        ahead[going[~inside]] = middle[~inside]
        going = going[(ahead[going] - last[going] > PLACE) & (middle > last[going] - PLACE)]
    return last


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
        rays across the centreline [mm]: negative where clearance is lost.
    clearance_loss : (7,) float
        The same percentiles of how much clearance a planner loses on the centreline: the distance
        to the true wall less what the fitted duct has [mm]. Not so near the ends that these are
        the nearest wall: where a duct ends is a convention.
    clearance_loss_place : float
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
    clearance_loss: NDArray[np.float64]
    clearance_loss_place: float

    @property
    def kept(self) -> float:
        """Share of the true volume that is kept."""
        return self.volume_kept / self.volume_true


def measure_fit(
    fitted: Duct,
    duct: Duct,
    centreline: Centreline,
    *,
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
        Along which walls and clearance are compared.
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
    How far outside a point lies is the distance of `duct`: exact for meshes, balls and round cones,
    and within `error` for sampled fields. A union of super-ellipsoids as the true duct gives less
    than that.
    """
    check_number("max error", max_error, low=0.0, unit="mm")
    for name, one in (("fitted duct", fitted), ("duct", duct)):
        if one.dim != 3:
            raise InputError(f"the {name} has 2 dimensions: it must have 3")
    progress("measure", 0.0)
    cuts = cut_sections(duct, centreline) if sections is None else sections
    rays = cuts.directions.reshape(-1, 3)
    starts = np.repeat(cuts.centres, cuts.directions.shape[1], axis=0)
    reach = 2.0 * float(cuts.lengths.max())
    across = cast_rays(fitted, starts, rays, reach=reach) - cuts.lengths.reshape(-1)
    clearance = -duct.signed_distance(cuts.centres)
    inner = find_inner(cuts.arc_length, clearance)
    loss = (clearance + fitted.signed_distance(cuts.centres))[inner]
    arc = cuts.arc_length[inner]
    progress("measure", 0.3)
    highest = find_outside(fitted, duct, max_error=max_error)
    progress("measure", 0.7)
    volumes, error = _measure_volumes(fitted, duct)
    kept, lost, gained = (float(volume) for volume in volumes)
    progress("measure", 1.0)
    return FitReport(
        pieces=fitted.shape_count,
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
        clearance_loss=np.percentile(loss, PERCENTS),
        clearance_loss_place=float(arc[int(np.argmax(loss))]),
    )


def find_inner(
    arc_length: NDArray[np.float64], clearance: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which places (n,) have no end of the line as near as their wall; all, if none has."""
    inner = np.minimum(arc_length, arc_length[-1] - arc_length) >= clearance
    return inner if inner.any() else np.full(len(clearance), True)


ROUND_OFF_MM = 1e-6
"""By how much more clearance may be lost: rounding of distances [mm]."""


def explain_shortfall(report: FitReport, max_error: float, *, free: bool) -> str:
    """Return what an error is exceeded by, with `free` on the centreline too; else nothing."""
    if report.outside > max_error:
        shown = show_apart(report.outside, max_error, digits=2, form="f")
        return f"a point of the fitted lumen is {shown[0]} mm outside, more than {shown[1]} mm"
    if report.outside_bound > max_error:
        shown = show_apart(report.outside_bound, report.outside, max_error, digits=2, form="f")
        return f"none is found more than {shown[1]} mm outside, but only {shown[0]} mm is proved"
    if free and report.clearance_loss[-1] > max_error + ROUND_OFF_MM:
        shown = show_apart(report.clearance_loss[-1], max_error)
        return (
            f"{shown[0]} mm of the clearance on the centreline is lost at "
            f"{report.clearance_loss_place:.1f} mm, more than {shown[1]} mm"
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
    settled by two points each at random, whose difference gives the error.
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


# Sections of a duct normal to its centreline: the wall, and the circles that fit it.

SECTION_TOLERANCE = 1e-3
"""How far the radius of an inscribed circle may be below the largest [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionCircles:
    """Circles in the planes of sections.

    Attributes
    ----------
    centres : (n, 3) float
        World frame [mm].
    radii : (n,) float
        [mm].
    residuals : (n,) float
        Root mean square distance of the wall from the circle [mm].
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    residuals: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sections:
    """The wall of a duct around points of its centreline, in planes normal to it.

    Attributes
    ----------
    arc_length : (n,) float
        Along the centreline [mm].
    centres : (n, 3) float
        The points of the centreline [mm].
    frames : (n, 3, 3) float
        Columns are two axes across the centreline, carried along without twist, and the one
        along it.
    directions : (n, k, 3) float
        Unit vectors of rays in the plane, at equal angles from the first axis on.
    lengths : (n, k) float
        How far the wall is from the centre along the rays [mm]. What lies behind a fold is not
        seen.
    """

    arc_length: NDArray[np.float64]
    centres: NDArray[np.float64]
    frames: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]

    @property
    def wall(self) -> NDArray[np.float64]:
        """(n, k, 3) points of the wall [mm]."""
        return self.centres[:, None] + self.lengths[..., None] * self.directions

    @property
    def areas(self) -> NDArray[np.float64]:
        """(n,) areas of the polygons through the wall points [mm^2]."""
        angle = 2.0 * np.pi / self.lengths.shape[1]
        return np.asarray(
            0.5 * np.sin(angle) * (self.lengths * np.roll(self.lengths, -1, axis=1)).sum(axis=1)
        )

    def flatten(self) -> NDArray[np.float64]:
        """Return the wall points (n, k, 2) in each section's own plane, about its centre [mm]."""
        return np.asarray(
            np.einsum("nkj,nji->nki", self.wall - self.centres[:, None], self.frames[:, :, :2])
        )

    def fit_circles(self) -> SectionCircles:
        """Fit circles by least squares of the distances of the wall (not of their squares).

        Every mm of the polygon through the wall points counts the same, whether near or far.
        Such a circle reaches outside the wall: it is for looking at. Plan with the inscribed one.
        """
        fits = [
            fit_circle(points, weights=share_wall(points), around=True) for points in self.flatten()
        ]
        return SectionCircles(
            centres=self._lift(np.array([fit.centre for fit in fits])),
            radii=np.array([fit.radius for fit in fits]),
            residuals=np.array([fit.residual for fit in fits]),
        )

    def inscribe_circles(self, *, progress: Progress = no_progress) -> SectionCircles:
        """Find the largest circle inside the polygon through each section's wall points.

        Its radius is at most 0.001 mm below the largest. In the plane of the section only: along
        the duct the wall may come nearer, which the centreline's own radius knows.
        """
        flat = self.flatten()
        found = []
        for index, points in enumerate(flat):
            found.append(_inscribe(points, index))
            progress("inscribed circles", (index + 1) / len(flat))
        centres = np.array([centre for centre, _ in found])
        radii = np.array([radius for _, radius in found])
        off = np.linalg.norm(flat - centres[:, None], axis=2) - radii[:, None]
        return SectionCircles(
            centres=self._lift(centres), radii=radii, residuals=np.sqrt((off**2).mean(axis=1))
        )

    def _lift(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.centres + np.einsum("ni,nji->nj", points, self.frames[:, :, :2]))


def cut_sections(
    duct: Duct,
    centreline: Centreline,
    *,
    spacing: float = 2.0,
    stations: ArrayLike | None = None,
    rays: int = 72,
) -> Sections:
    """Cut sections normal to a centreline.

    Parameters
    ----------
    duct : Duct
        Of three dimensions.
    centreline : Centreline
    spacing : float
        Distance between sections [mm]; both ends of the centreline have one.
    stations : (n,) float, optional
        Arc lengths of the sections instead, ascending [mm].
    rays : int
        Wall points of a section.

    Raises
    ------
    InputError
        If an argument is not legal.
    GeometryError
        If the centreline leaves the duct, with the place.
    """
    if duct.dim != 3:
        raise InputError("the duct has 2 dimensions: sections are cut of one that has 3")
    check_number("spacing", spacing, low=0.0, low_open=True, unit="mm")
    check_integer("rays", rays, low=8, high=10_000)
    if stations is None:
        arc = np.linspace(0.0, centreline.length, max(2, round(centreline.length / spacing) + 1))
    else:
        arc = check_array("stations", stations).copy()
        if arc.ndim != 1 or len(arc) == 0 or (np.diff(arc) <= 0.0).any():
            raise InputError(f"stations have shape {arc.shape}: (n,) ascending arc lengths")
        check_range("stations", arc, 0.0, centreline.length, "mm", slack=1e-9)
    centres = interpolate_polyline(centreline.points, centreline.arc_length, arc)
    outside = duct.signed_distance(centres)
    if outside.max() >= 0.0:
        index = int(np.argmax(outside))
        place = ", ".join(f"{value:.1f}" for value in centres[index])
        raise GeometryError(
            f"the centreline leaves the duct at ({place}) mm, by {outside[index]:.2f} mm"
        )
    frames = carry_frames(find_tangents(centreline, arc))
    angles = 2.0 * np.pi * np.arange(rays) / rays
    spokes = np.stack([np.cos(angles), np.sin(angles)])
    directions = np.einsum("nji,ik->nkj", frames[:, :, :2], spokes)
    reach = float(np.linalg.norm(np.diff(duct.bounds, axis=0)))
    lengths = cast_rays(
        duct, np.repeat(centres, rays, axis=0), directions.reshape(-1, 3), reach=reach
    )
    return Sections(
        arc_length=arc,
        centres=centres,
        frames=frames,
        directions=directions,
        lengths=lengths.reshape(len(arc), rays),
    )


def share_wall(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (k,) length of a closed polygon that each point (k, 2) stands for."""
    sides = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    return np.asarray(0.5 * (sides + np.roll(sides, 1)))


def _inscribe(points: NDArray[np.float64], index: int) -> tuple[NDArray[np.float64], float]:
    try:
        polygon = Polygon(points)
    except InputError as error:
        raise GeometryError(f"section {index} is no area: {error}") from None

    def measure(places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        clearance = -polygon.signed_distance(places)
        return clearance, clearance

    found = find_highest(
        measure, polygon.signed_distance, polygon.bounds, ceiling=0.0, tolerance=SECTION_TOLERANCE
    )
    return found.place, found.value
