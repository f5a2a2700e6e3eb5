"""Sections of a duct normal to its centreline: the wall, and the circles that fit it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number, check_range
from ..errors import GeometryError, InputError
from ..progress import Progress, no_progress
from ._fit_planar import fit_circle
from ._fit_rays import cast_rays
from ._fit_search import find_highest
from .centreline import Centreline
from .polygon import Polygon
from .protocol import Duct, count_dimensions

__all__ = ["SectionCircles", "Sections", "cut_sections"]

WINDOW = 2.0
"""The direction of a centreline is taken over this much on either side [mm]."""

TOLERANCE = 1e-3
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
    if count_dimensions(duct) != 3:
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
    centres = _look_up(centreline, arc)
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


def find_tangents(centreline: Centreline, arc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 3) directions of a centreline at arc lengths (n,), over a short stretch."""
    window = min(WINDOW, 0.5 * centreline.length)
    ahead = _look_up(centreline, np.minimum(arc + window, centreline.length))
    back = _look_up(centreline, np.maximum(arc - window, 0.0))
    sizes = np.linalg.norm(ahead - back, axis=1)
    if sizes.min() <= 0.0:
        index = int(np.argmin(sizes))
        raise GeometryError(f"the centreline turns back on itself at {arc[index]:.1f} mm")
    return np.asarray((ahead - back) / sizes[:, None])


def carry_frames(tangents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n, 3, 3) frames with the tangents as third column, turned no more than they do."""
    frames = np.empty((len(tangents), 3, 3))
    axis = np.eye(3)[int(np.argmin(np.abs(tangents[0])))]
    for index, tangent in enumerate(tangents):
        if index > 0:
            # The smallest rotation from one tangent to the next.
            before = tangents[index - 1]
            turn = 1.0 + float(before @ tangent)
            if turn > 1e-9:
                axis = axis - (axis @ tangent) / turn * (before + tangent)
        axis = axis - (axis @ tangent) * tangent
        axis = axis / np.linalg.norm(axis)
        frames[index] = np.stack([axis, np.cross(tangent, axis), tangent], axis=1)
    return frames


def _look_up(centreline: Centreline, arc: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack(
        [np.interp(arc, centreline.arc_length, column) for column in centreline.points.T], axis=1
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
        room = -polygon.signed_distance(places)
        return room, room

    found = find_highest(
        measure, polygon.signed_distance, polygon.bounds, ceiling=0.0, tolerance=TOLERANCE
    )
    return found.place, found.value
