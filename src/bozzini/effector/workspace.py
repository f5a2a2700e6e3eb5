"""Workspace of the tip, and what the tip withstands and presses with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_points
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import ClosedForm, Json, measured, tabulated, take_axes
from .design import EffectorDesign
from .equilibrium import settle_muscles
from .inverse import Reach, Sectors, find_reach, solve_inverse, split, take_place
from .kernels.inverse import PEAK
from .linkage import bend, contraction_for_lateral, find_peak, lateral_slope
from .model import EffectorModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True, eq=False)
class Workspace(ClosedForm):
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

    boundary: Floats = tabulated("mm", "{}")
    boundary_tip: Floats = tabulated("mm", "tip_{}")
    boundary_holder_tip: Floats = tabulated("mm", "holder_tip_{}")
    interior: Floats = measured("mm")
    tip: Floats = measured("mm")
    holder_tip: Floats = measured("mm")
    area: float = measured("mm2")
    tip_area: float = measured("mm2")
    inner_radius: float = measured("mm")
    outer_radius: float = measured("mm")
    sector_corners: Floats
    limited: NDArray[np.bool_]
    reach: Reach

    @property
    def reason(self) -> str:  # type: ignore[override]
        """Which directions no two muscles cover; empty if none."""
        return self.reach.sectors.describe_gaps(self.reach.names)

    def to_dict(self) -> Json:
        """Return the workspace as plain values, units in the names, muscles by theirs."""
        known = self.reach
        return super().to_dict() | {
            "amplitudes_mm": dict(zip(known.names, known.amplitudes.tolist(), strict=True)),
            "saturated": dict(zip(known.names, known.saturated.tolist(), strict=True)),
            "largest_deflection_mm": known.peak,
            "gaps": self.reason,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the workspace, seen along the axis, and return the axes."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        axes.fill(*self.boundary.T, alpha=0.3)
        axes.plot(*np.vstack([self.boundary, self.boundary[:1]]).T)
        return axes


def workspace(effector: EffectorModel, *, directions: int = 360, samples: int = 2000) -> Workspace:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class TipForce(ClosedForm):
    """The largest force with which the tip presses on something that holds it.

    Attributes
    ----------
    direction : (..., 2) float
        Unit vectors of the force that the tip exerts.
    lateral_vector : (2,) float
        Where the tip is held [mm].
    force : (...) float
        The force [N]; 0 where there is no force exactly in this direction.
    pulls : (m,) float
        Pull of each muscle at the pressure limit with the tip held there [N].
    """

    direction: Floats
    lateral_vector: Floats
    force: Floats
    pulls: Floats

    def list_columns(self) -> dict[str, Floats]:
        """Return the columns of `to_frame`, a row for each direction."""
        x, y = self.direction.reshape(-1, 2).T
        return {
            "direction_rad": np.mod(np.arctan2(y, x), math.tau),
            "force_N": np.ravel(self.force),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the force as an arrow's end in each direction, and return the axes."""
        axes = take_axes(ax, x="force along x [N]", y="force along y [N]", equal=True)
        axes.plot(*(self.direction * self.force[..., None]).reshape(-1, 2).T)
        return axes


def passive_stiffness(design: EffectorDesign) -> float:
    """Return ``3 EI / L**3`` [N/mm]: the tip's lateral stiffness while muscles keep their pull."""
    return 3.0 * design.rigidity / design.backbone_length**3


def tip_stiffness(
    effector: EffectorModel, pressures: ArrayLike | Mapping[str, ArrayLike]
) -> Floats:
    """Return the lateral stiffness of the tip (..., 2, 2) [N/mm] at constant pressures.

    A lateral force ``f`` at the tip deflects the section, as a beam, by ``s f`` with
    ``s = L**3 / (3 EI)``, and a deflection ``v`` changes the pull of an active muscle by
    ``-k_i (e_i . v) / slope_i``, with its own stiffness ``k_i`` and ``slope = d lateral / d
    contraction``. From ``v = s f + c sum(change of pull_i e_i)``::

        K = (1 + c sum(k_i / slope_i  e_i e_i^T)) / s

    It is exact in the model for one muscle in its own plane. That several muscles are stretched
    each by the part of the deflection along it is an assumption, as superposition is. Muscles
    that do not pull are left out. The linkage hardly moves at small contractions (`bend`), so that
    there a muscle looks too stiff.

    Parameters
    ----------
    effector : Effector
    pressures : array_like, shape (..., m), or mapping
        Pressures [MPa], as in `pose`.

    Raises
    ------
    InputError
        If a pressure is outside its legal range or a model has no stiffness.
    """
    design = effector.design
    table = effector.take_pressures(pressures)
    flat = table.reshape(-1, table.shape[-1])
    settled = settle_muscles(effector, flat)
    passive = passive_stiffness(design)
    units = np.stack([effector.packed.cosines, effector.packed.sines], axis=-1)
    gain = np.zeros(flat.shape)
    slopes = lateral_slope(design, settled.contraction)
    for index, model in enumerate(effector.models):
        active = (settled.contraction[:, index] > 0.0) & (slopes[:, index] > 0.0)
        if np.any(active):
            stiffness = model.stiffness(flat[active, index], settled.contraction[active, index])
            gain[active, index] = design.compliance * stiffness / slopes[active, index]
    matrix = np.eye(2) + np.einsum("nk,ki,kj->nij", gain, units, units)
    return np.asarray(passive * matrix.reshape(*table.shape[:-1], 2, 2))


def tip_force(
    effector: EffectorModel, direction: ArrayLike, *, lateral: ArrayLike = (0.0, 0.0)
) -> TipForce:
    """Return the largest force that the tip exerts in a direction while something holds it.

    Held at ``v``, the tip presses with ``(c sum(F_i e_i) - v) / s``, ``s = L**3 / (3 EI)``: by how
    much further the pulls would deflect it, over the section's compliance. Every pull may be any
    from 0 to that of `MuscleModel.force` at the pressure limit, at the contraction for the part of
    ``v`` along the muscle (none for muscles on the other side). The answer is the largest ``t``
    with ``t direction`` among these forces, all muscles together.

    With ``beam_factor`` 2 and a straight section the reaction of one muscle is ``3 a F / (2 L)``:
    that of a beam clamped at one end and held at the other under an end moment ``a F``.

    Assumed are small deflections from a beam, as everywhere in this model, a backbone that follows
    the tip, and that muscles do not hinder each other. A real section that is held may buckle away.

    Parameters
    ----------
    effector : Effector
    direction : (..., 2) array_like
        Directions of the force of the tip, of any length but zero.
    lateral : (2,) array_like
        Where the tip is held [mm]; 0 is the straight section.

    Raises
    ------
    InputError
        If a direction is zero, the muscles cannot bring the tip to `lateral`, or a model has no
        pull.
    """
    design = effector.design
    vectors = check_points("direction", check_array("direction", direction), dim=2)
    sizes = np.hypot(vectors[..., :1], vectors[..., 1:])
    if np.any(sizes == 0.0):
        raise InputError("direction is (0, 0): it must be a vector of any length but zero")
    toward = vectors / sizes
    place = take_place("lateral", lateral)
    held = solve_inverse(effector, place)
    if not held.reachable:
        raise InputError(
            f"lateral is ({place[0]:g}, {place[1]:g}) mm: the tip cannot be there, {held.reason}"
        )
    pulls = _measure_pulls(effector, held.contraction)
    units = np.stack([effector.packed.cosines, effector.packed.sines], axis=-1)
    amplitudes = design.compliance * pulls
    normals, widths = _find_strips(units, amplitudes)
    space = np.maximum(widths - normals @ place, 0.0)
    rate = toward @ normals.T
    away = rate > 1e-12  # a strip's edge that the direction is not parallel to
    ways = np.where(away, space / np.where(away, rate, 1.0), np.inf)
    distance = ways.min(axis=-1)
    return TipForce(
        direction=toward,
        lateral_vector=place,
        force=np.asarray(passive_stiffness(design) * distance),
        pulls=pulls,
    )


def _measure_pulls(effector: EffectorModel, contraction: Floats) -> Floats:
    """Pull of each muscle at the pressure limit and contractions (m,) [N], 0 if it is slack."""
    limit = effector.design.pressure_limit
    pulls = np.zeros(len(effector.models))
    for index, model in enumerate(effector.models):
        if model.free_contraction(limit) > contraction[index]:
            pulls[index] = max(0.0, float(model.force(limit, contraction[index])))
    return pulls


def _find_strips(units: Floats, amplitudes: Floats) -> tuple[Floats, Floats]:
    """Normals (k, 2) and distances (k,) of the edges of ``{sum a_i e_i, 0 <= a_i <= A_i}``.

    Its edges are parallel to the ``e_i``. If all of these lie on one line the two ends of that
    line's segment are added.
    """
    across = np.stack([-units[:, 1], units[:, 0]], axis=-1)
    normals = np.concatenate([across, -across, units, -units])
    widths = np.maximum(normals @ units.T, 0.0) @ amplitudes
    return normals, widths
