"""Workspace of the tip: in the plane across the section, and the surface that it is in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_points
from ._inverse_kernels import PEAK
from .amplitudes import Reach, find_reach
from .design import EffectorDesign
from .effector import Effector
from .forward import bend, contraction_for_lateral, find_peak
from .projected import split
from .sectors import Sectors

__all__ = ["Workspace", "place_tips", "workspace"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Workspace:
    """Where the tip can go by superposition, with the two muscles of a sector at a time.

    In the plane it is a parallelogram ``A_i e_i``, ``A_j e_j`` for each sector, cut by the circle
    of the backbone's largest deflection. With three muscles that leave no gap of half a turn these
    make one convex hexagon, which is all that the three can reach. In space the tip has one height
    for each distance from the axis, so the workspace is a piece of a surface of revolution.

    Attributes
    ----------
    boundary : (k, 2) float
        Polygon round the workspace, counter-clockwise, not closed [mm]. Corners are exact; arcs of
        the circle of largest deflection are not. Across a gap of half a turn or more it goes
        through the origin.
    boundary_tip, boundary_holder_tip : (k, 3) float
        End of the backbone and of the holder there [mm].
    interior : (n, 2) float
        A square grid of lateral positions in the workspace; a line if it is one [mm].
    tip, holder_tip : (n, 3) float
        End of the backbone and of the holder there [mm].
    area : float
        Of the polygon [mm^2].
    tip_area : float
        Of the surface on which the end of the backbone lies [mm^2].
    inner_radius : float
        Largest deflection that can be had in every direction [mm]; 0 with a gap.
    outer_radius : float
        Largest deflection in any direction [mm].
    sector_corners : (m, 2) float
        ``A_i e_i + A_j e_j`` of each sector, in the order of `Sectors`, without the limit of the
        backbone; ``A_i e_i`` alone where the sector is not covered [mm].
    limited : (k,) bool
        Whether the backbone's largest deflection is what limits there, and not a muscle.
    reach : Reach
        Amplitudes of the muscles.
    """

    boundary: Floats
    boundary_tip: Floats
    boundary_holder_tip: Floats
    interior: Floats
    tip: Floats
    holder_tip: Floats
    area: float
    tip_area: float
    inner_radius: float
    outer_radius: float
    sector_corners: Floats
    limited: NDArray[np.bool_]
    reach: Reach


def workspace(effector: Effector, *, directions: int = 360, samples: int = 2000) -> Workspace:
    """Return the workspace of an end-effector.

    Parameters
    ----------
    effector : Effector
    directions : int
        Directions in which to look for the boundary, besides those of its corners.
    samples : int
        About how many points there are inside; fewer in a narrow workspace.

    Raises
    ------
    InputError
        If an argument is outside its legal range, or a model has no answer at the pressure limit.
    """
    directions = check_integer("directions", directions, low=12, high=1_000_000)
    samples = check_integer("samples", samples, low=1, high=10_000_000)
    design = effector.design
    known = find_reach(effector)
    sectors = known.sectors
    amplitudes = known.amplitudes[sectors.order]
    corners = _find_corners(sectors, amplitudes)
    units = _list_directions(sectors, corners, directions)
    far = 2.0 * (amplitudes.sum() + known.peak)
    found = split(sectors, units * far, known.amplitudes, known.peak)
    boundary, kept = _drop_repeats(found.delivered, 1e-9 * far)
    area = _measure_polygon(boundary)
    inner, outer = _measure_radii(boundary, sectors)
    interior = _fill(boundary, area, samples)
    inside = split(sectors, interior, known.amplitudes, known.peak).reachable
    interior = interior[inside]
    tip, holder_tip = place_tips(design, interior)
    boundary_tip, boundary_holder_tip = place_tips(design, boundary)
    return Workspace(
        boundary=boundary,
        boundary_tip=boundary_tip,
        boundary_holder_tip=boundary_holder_tip,
        interior=interior,
        tip=tip,
        holder_tip=holder_tip,
        area=area,
        tip_area=_measure_surface(design, boundary),
        inner_radius=inner,
        outer_radius=outer,
        sector_corners=corners,
        limited=np.asarray(found.code[kept] == PEAK),
        reach=known,
    )


def place_tips(design: EffectorDesign, lateral: ArrayLike) -> tuple[Floats, Floats]:
    """Return the ends of backbone and holder (..., 3) [mm] for lateral positions (..., 2) [mm].

    Raises
    ------
    InputError
        If a position is further out than the backbone's largest deflection.
    """
    positions = check_points("lateral position", check_array("lateral position", lateral), dim=2)
    radius = np.hypot(positions[..., 0], positions[..., 1])
    peak = find_peak(design).lateral
    # Round-off of a saturated target.
    radius = np.where((radius > peak) & (radius <= peak * (1.0 + 1e-9)), peak, radius)
    bent = bend(design, contraction_for_lateral(design, radius))
    unit = positions / np.where(radius > 0.0, radius, 1.0)[..., np.newaxis]
    return (
        np.concatenate([positions, bent.tip[..., 1:]], axis=-1),
        np.concatenate([unit * bent.holder_tip[..., :1], bent.holder_tip[..., 1:]], axis=-1),
    )


def _find_corners(sectors: Sectors, amplitudes: Floats) -> Floats:
    edges = amplitudes[:, np.newaxis] * np.stack([sectors.cosines, sectors.sines], axis=1)
    return np.asarray(edges + sectors.covered[:, np.newaxis] * np.roll(edges, -1, axis=0))


def _list_directions(sectors: Sectors, corners: Floats, directions: int) -> Floats:
    """Unit vectors (k, 2) by angle: a circle, the muscles and the corners."""
    sizes = np.hypot(*corners.T)
    corners = corners[sizes > 0.0] / sizes[sizes > 0.0, np.newaxis]
    angle = np.linspace(0.0, 2.0 * math.pi, directions, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    muscles = np.stack([sectors.cosines, sectors.sines], axis=1)
    units = np.concatenate([muscles, corners, circle])
    return units[np.argsort(np.mod(np.arctan2(units[:, 1], units[:, 0]), 2.0 * math.pi))]


def _drop_repeats(points: Floats, slack: float) -> tuple[Floats, NDArray[np.int64]]:
    """Leave out points like the one before; return which are left."""
    moved = np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > slack
    kept = np.flatnonzero(moved) if moved.any() else np.array([0])
    return points[kept], kept


def _measure_polygon(polygon: Floats) -> float:
    x, y = polygon.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _measure_radii(boundary: Floats, sectors: Sectors) -> tuple[float, float]:
    """Smallest distance from the origin to the boundary's edges, and largest to its corners."""
    outer = float(np.hypot(*boundary.T).max())
    if not sectors.covers_all or len(boundary) < 3:
        return 0.0, outer
    step = np.roll(boundary, -1, axis=0) - boundary
    along = -np.einsum("ij,ij->i", boundary, step) / np.einsum("ij,ij->i", step, step)
    nearest = boundary + np.clip(along, 0.0, 1.0)[:, np.newaxis] * step
    return float(np.hypot(*nearest.T).min()), outer


def _fill(boundary: Floats, area: float, samples: int) -> Floats:
    """A square grid through the origin, with about so many points to the boundary's area.

    Without an area: points from the origin to the boundary.
    """
    low, high = boundary.min(axis=0), boundary.max(axis=0)
    box = float(np.prod(high - low))
    if not area > 1e-9 * float(np.sum((high - low) ** 2)):
        share = np.linspace(0.0, 1.0, math.ceil(samples / len(boundary)))
        rays = share[:, np.newaxis, np.newaxis] * boundary
        return np.unique(rays.reshape(-1, 2), axis=0)
    # A narrow workspace gets fewer points, rather than a grid of millions.
    step = math.sqrt(max(area, box / 50.0) / samples)
    axes = [
        step * np.arange(math.ceil(a / step - 1e-9), math.floor(b / step + 1e-9) + 1)
        for a, b in zip(low, high, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def _measure_surface(design: EffectorDesign, boundary: Floats) -> float:
    """Area of the surface of revolution over a star-shaped polygon [mm^2].

    ``integral of G(radius(angle))`` with ``G = integral of radius ds`` along the tip's planar
    curve, by the trapezoidal rule.
    """
    radius = np.hypot(*boundary.T)
    if len(boundary) < 3:
        return 0.0
    furthest = min(float(radius.max()), find_peak(design).lateral)
    contraction = np.linspace(0.0, float(contraction_for_lateral(design, furthest)), 2000)
    lateral, axial = bend(design, contraction).tip.T
    length = np.hypot(np.diff(lateral), np.diff(axial))
    swept = np.concatenate([[0.0], np.cumsum(0.5 * (lateral[1:] + lateral[:-1]) * length)])
    # Each edge is cut into pieces that are short beside the radius.
    share = np.linspace(0.0, 1.0, 9)
    nearby = (
        boundary[:, np.newaxis]
        + share[:, np.newaxis] * (np.roll(boundary, -1, axis=0) - boundary)[:, np.newaxis]
    )
    x, y = nearby[..., 0], nearby[..., 1]
    first, second = (slice(None), slice(None, -1)), (slice(None), slice(1, None))
    turn = np.arctan2(
        x[first] * y[second] - x[second] * y[first], x[first] * x[second] + y[first] * y[second]
    )
    value = np.interp(np.hypot(x, y), lateral, swept)
    return float(np.sum(0.5 * (value[first] + value[second]) * turn))
