"""Chains along a centreline: few of its points that stand for all, as cones or cylinders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import GeometryError
from ...numeric.arrays import Floats
from ...numeric.polylines import carry_frames, interpolate_polyline
from ...numeric.vectors import settle_layout
from ...progress import Progress, no_progress
from ..base import Duct
from ..centreline import Centreline, find_tangents
from ..shapes.cones import RoundCones
from ..shapes.cylinders import ConnectedCylinders, measure_gaps
from .measure import cast_rays, share_wall
from .points import fit_circle

SPACING_MM = 1.0
"""Distance between the places that may be kept [mm]; longer on long centrelines."""

PLACES_MAX = 500
"""A chain is chosen from this many places at most."""

STEP_MM = 0.5
"""A cone is checked at balls this far apart [mm]."""

PATIENCE = 6
"""So many longer cones in turn must fail before no longer one is tried."""

BLOCK = 8
"""Cones from one place that are measured at once."""

SPAN_MAX = 120
"""A cone passes over this many places at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BallChain:
    """Balls along a centreline that lie inside the duct.

    Attributes
    ----------
    arc_length : (n,) float
        Along the centreline [mm].
    centres : (n, 3) float
        [mm].
    tangents : (n, 3) float
        Unit vectors along it.
    radii : (n,) float
        Proved clearance at each [mm].
    """

    arc_length: Floats
    centres: Floats
    tangents: Floats
    radii: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class ChainCones:
    """Cones between two places of a chain.

    Attributes
    ----------
    ends : (m, 2) int
        First and last place.
    loss : (m,) float
        How much less clearance than the duct the cone has at most, at places between [mm].
    """

    ends: NDArray[np.int64]
    loss: Floats


def place_chain(duct: Duct, centreline: Centreline) -> BallChain:
    """Return a ball at every place that may be kept.

    Raises
    ------
    GeometryError
        If there is no proved clearance at a place.
    """
    count = min(max(2, round(centreline.length / SPACING_MM) + 1), PLACES_MAX)
    arc = np.linspace(0.0, centreline.length, count)
    centres = interpolate_polyline(centreline.points, centreline.arc_length, arc)
    radii = duct.clearance_bound(centres)
    if radii.min() <= 0.0:
        index = int(np.argmin(radii))
        place = ", ".join(f"{value:.1f}" for value in centres[index])
        raise GeometryError(
            f"there is no proved clearance at ({place}) mm of the centreline, at "
            f"{arc[index]:.1f} mm: no shape can be put there; use a smaller voxel"
        )
    return BallChain(
        arc_length=arc, centres=centres, tangents=find_tangents(centreline, arc), radii=radii
    )


def measure_edges(
    duct: Duct,
    chain: BallChain,
    *,
    allowance: float,
    cylinders: bool = False,
    progress: Progress = no_progress,
) -> ChainCones:
    """Return the cones between places that reach outside the duct by `allowance` mm at most.

    A ball reaches outside by no more than its radius exceeds the clearance at its centre; that is
    asked of balls along the cone, `STEP_MM` apart.

    Parameters
    ----------
    cylinders : bool
        Leave out cones whose end circles, across the centreline, would meet.
    """
    count = len(chain.radii)
    ends, losses = [], []
    for i in range(count - 1):
        failed = 0
        last = min(count, i + 1 + SPAN_MAX)
        for block in range(i + 1, last, BLOCK):
            others = list(range(block, min(block + BLOCK, last)))
            found = _measure_cones(duct, chain, i, others)
            for j, (excess, loss) in zip(others, found, strict=True):
                apart = not cylinders or bool(
                    _find_apart(chain.centres[[i, j]], chain.tangents[[i, j]], chain.radii[[i, j]])
                )
                # Neighbours are always joined where they can be, so that there is a chain at all.
                if apart and (j == i + 1 or excess <= allowance):
                    failed = 0
                    ends.append((i, j))
                    losses.append(loss)
                elif j > i + 1:
                    failed += 1
            if failed >= PATIENCE:
                break
        progress("chain", (i + 1) / (count - 1))
    return ChainCones(ends=np.array(ends, dtype=np.int64).reshape(-1, 2), loss=np.array(losses))


def choose_chain(
    edges: ChainCones, count: int, *, max_loss: float, pieces: int | None
) -> tuple[list[int], float]:
    """Return the places to keep, and the most clearance that is lost between them [mm].

    Parameters
    ----------
    edges : ChainCones
    count : int
        Number of places.
    max_loss : float
        Without `pieces`: the fewest cones that lose no more than this.
    pieces : int, optional
        So many cones at most, losing as little as they can.

    Raises
    ------
    GeometryError
        If no chain is so short.
    """
    if pieces is None:
        path = _find_shortest(edges, count, max(max_loss, 0.0))
        if path is None:
            raise GeometryError(
                f"max error is {max_loss:g} mm: between neighbouring places of the centreline more "
                "clearance is lost already; give a larger one, or the number of pieces"
            )
        return path, _worst(edges, path)
    levels = np.unique(edges.loss)
    path = _find_shortest(edges, count, float(levels[-1]))
    if path is None:
        raise GeometryError(
            "no chain of shapes goes along the centreline: it bends too sharply for circles "
            "across it"
        )
    if len(path) - 1 > pieces:
        raise GeometryError(
            f"{pieces} pieces cannot follow the centreline inside the duct: it takes "
            f"{len(path) - 1} at least"
        )
    low, high = 0, len(levels) - 1
    while low < high:
        middle = (low + high) // 2
        shorter = _find_shortest(edges, count, float(levels[middle]))
        if shorter is not None and len(shorter) - 1 <= pieces:
            high, path = middle, shorter
        else:
            low = middle + 1
    return path, _worst(edges, path)


def _measure_cones(
    duct: Duct, chain: BallChain, i: int, others: list[int]
) -> list[tuple[float, float]]:
    """Return how far the cones from ball i reach outside, and what clearance they lose."""
    parts, sizes = [], []
    for j in others:
        step = chain.centres[j] - chain.centres[i]
        t = np.linspace(0.0, 1.0, max(3, int(np.ceil(np.linalg.norm(step) / STEP_MM)) + 1))
        parts.append(chain.centres[i] + t[:, None] * step)
        sizes.append(chain.radii[i] + t * (chain.radii[j] - chain.radii[i]))
    outside = duct.signed_distance(np.concatenate(parts)) + np.concatenate(sizes)
    marks = np.cumsum([len(part) for part in parts])[:-1]
    found = []
    for j, centres, radii, excess in zip(
        others, parts, sizes, np.split(outside, marks), strict=True
    ):
        loss = 0.0
        if j > i + 1:
            away = np.linalg.norm(chain.centres[i + 1 : j, None] - centres[None], axis=2)
            clearance = (radii - away).max(axis=1)
            loss = max(0.0, float((chain.radii[i + 1 : j] - clearance).max()))
        found.append((float(excess[1:-1].max()), loss))
    return found


def _find_shortest(edges: ChainCones, count: int, most: float) -> list[int] | None:
    """Return the fewest places from first to last, of those the chain with the least loss."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import dijkstra

    good = edges.loss <= most
    # All the losses of a chain together weigh less than one more place.
    weights = 1.0 + edges.loss[good] / (1.0 + edges.loss.max(initial=0.0)) / (2.0 * count)
    graph = csr_matrix((weights, tuple(edges.ends[good].T)), shape=(count, count))
    costs, before = dijkstra(graph, indices=0, return_predecessors=True)
    if not np.isfinite(costs[-1]):
        return None
    path = [count - 1]
    while path[-1] > 0:
        path.append(int(before[path[-1]]))
    return path[::-1]


def _worst(edges: ChainCones, path: list[int]) -> float:
    table = {(i, j): loss for (i, j), loss in zip(edges.ends.tolist(), edges.loss, strict=True)}
    return float(max(table[i, j] for i, j in zip(path[:-1], path[1:], strict=True)))


# Round cones and connected cylinders along a chosen chain.

RAYS = 48
STATIONS = 9
"""The wall of a cylinder is checked on so many rulings, at so many places each."""

SHRINK = 0.97
EVALUATIONS = 40
RADIUS_MIN = 1e-3
"""Smallest radius that a fit gives [mm]."""


def inscribe_cylinders(
    duct: Duct, chain: BallChain, places: list[int], *, allowance: float
) -> ConnectedCylinders:
    """Return cylinders through the places that reach outside by about `allowance` at most.

    Circles begin as large as their planes allow. Where the wall between two comes to lie too far
    outside, both are drawn in, down to the balls at their centres: in the hull of these every
    ruling lies.
    """
    centres, normals = chain.centres[places], chain.tangents[places]
    least = chain.radii[places]
    frames = carry_frames(normals)
    angles = 2.0 * np.pi * np.arange(RAYS) / RAYS
    spokes = np.stack([np.cos(angles), np.sin(angles)])
    rays = np.einsum("nji,ik->nkj", frames[:, :, :2], spokes)
    reach = float(np.linalg.norm(np.diff(duct.bounds, axis=0)))
    clearance = cast_rays(duct, np.repeat(centres, RAYS, axis=0), rays.reshape(-1, 3), reach=reach)
    radii = np.maximum(least, clearance.reshape(-1, RAYS).min(axis=1))
    t = np.linspace(0.0, 1.0, STATIONS)[:, None, None]
    while True:
        wall = centres[:, None] + radii[:, None, None] * rays
        between = (1.0 - t) * wall[:-1, None] + t * wall[1:, None]
        outside = duct.signed_distance(between).max(axis=(1, 2))
        bad = (outside > allowance) | ~_find_apart(centres, normals, radii)
        drawn = np.zeros(len(radii), dtype=bool)
        drawn[:-1] |= bad
        drawn[1:] |= bad
        drawn &= radii > least
        if not drawn.any():
            break
        radii = np.where(drawn, np.maximum(least, SHRINK * radii), radii)
    return ConnectedCylinders(centres, normals, radii)


def _find_apart(centres: Floats, normals: Floats, radii: Floats) -> NDArray[np.bool_]:
    """Whether circles (n,) meet neither the next one nor turn back from it: (n - 1,)."""
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    ahead = np.einsum("ij,ij->i", normals[:-1], normals[1:]) > 0.0
    gaps = measure_gaps(centres, normals, radii)
    return np.asarray(ahead & (gaps > 1e-6 * steps))


def fit_cylinder_chain(chain: BallChain, places: list[int], walls: Floats) -> ConnectedCylinders:
    """Return cylinders whose circles fit wall points (n, k, 3) of sections by least squares.

    The sections are those across the chain at the places. Circles that would meet, or stand
    across the line between them, are drawn back to the balls of the chain until they do not.
    """
    centres, normals, least = chain.centres[places], chain.tangents[places], chain.radii[places]
    frames = carry_frames(normals)
    flat = np.einsum("nkj,nji->nki", walls - centres[:, None], frames[:, :, :2])
    fits = [fit_circle(points, weights=share_wall(points), around=True) for points in flat]
    shift = np.einsum("ni,nji->nj", np.array([fit.centre for fit in fits]), frames[:, :, :2])
    more = np.array([fit.radius for fit in fits]) - least
    share = np.ones(len(fits))
    while True:
        middles, radii = centres + share[:, None] * shift, least + share * more
        d = np.diff(middles, axis=0)
        bad = ~_find_apart(middles, normals, radii)
        bad |= np.einsum("ij,ij->i", normals[:-1], d) <= 0.0
        bad |= np.einsum("ij,ij->i", normals[1:], d) <= 0.0
        drawn = (np.append(bad, False) | np.append(False, bad)) & (share > 0.0)
        if not drawn.any():
            return ConnectedCylinders(middles, normals, radii)
        share[drawn] = np.where(share[drawn] > 0.05, 0.8 * share[drawn], 0.0)


def measure_cone_chain(
    points: Floats, centres: Floats, radii: Floats
) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Return (n,) distances of points from a chain of cones, and which ball is nearest.

    The ball is ``t`` of the step from ball ``index`` to the next.
    """
    from ..kernels.fit import find_balls

    best = np.empty(len(points))
    index = np.zeros(len(points), dtype=np.int64)
    place = np.zeros(len(points))
    given = (settle_layout(array) for array in (points, centres, radii))
    find_balls(*given, best, index, place)
    return best, index, place


def fit_cone_chain(points: Floats, centres: Floats, radii: Floats) -> RoundCones:
    """Fit a chain of round cones to wall points (m, 3), by least squares of distances.

    Centres move across the chain, and along it by 0.4 of the step to the next at most: where the
    chain neither bends nor tapers, the wall does not tell where they are. A radius stays positive.

    Parameters
    ----------
    points : (m, 3) float
        On the wall [mm].
    centres : (n, 3) float
        Where to begin [mm].
    radii : (n,) float
        The same [mm].
    """
    from scipy.optimize import least_squares
    from scipy.sparse import csr_matrix

    count = len(centres)
    steps = np.diff(centres, axis=0)
    directions = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    frames = carry_frames(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def split(x: Floats) -> tuple[Floats, Floats]:
        table = x.reshape(count, 4)
        return centres + np.einsum("ni,nji->nj", table[:, :3], frames), table[:, 3]

    def residuals(x: Floats) -> Floats:
        return measure_cone_chain(points, *split(x))[0]

    def slopes(x: Floats) -> csr_matrix:
        # The nearest ball is where the distance is least: its place does not count (envelope).
        middles, sizes = split(x)
        _, index, t = measure_cone_chain(points, middles, sizes)
        ball = (1.0 - t)[:, None] * middles[index] + t[:, None] * middles[index + 1]
        away = points - ball
        norm = np.linalg.norm(away, axis=1, keepdims=True)
        unit = away / np.where(norm > 0.0, norm, 1.0)
        values, columns = [], []
        for end, weight in ((index, 1.0 - t), (index + 1, t)):
            across = np.einsum("mj,mji->mi", unit, frames[end])
            values += [-weight * across[:, part] for part in range(3)] + [-weight]
            columns += [4 * end + part for part in range(4)]
        rows = np.arange(0, 8 * len(points) + 1, 8)
        flat = np.stack(values, axis=1).reshape(-1), np.stack(columns, axis=1).reshape(-1)
        return csr_matrix((*flat, rows), shape=(len(points), 4 * count))

    start = np.concatenate([np.zeros((count, 3)), radii[:, None]], axis=1).reshape(-1)
    wide = 2.0 * float(radii.max())
    sizes = np.linalg.norm(steps, axis=1)
    along = 0.4 * np.minimum(np.append(sizes, np.inf), np.append(np.inf, sizes))
    low = np.tile([-wide, -wide, 0.0, RADIUS_MIN], (count, 1))
    high = np.tile([wide, wide, 0.0, 10.0 * wide], (count, 1))
    low[:, 2], high[:, 2] = -along, along
    found = least_squares(
        residuals,
        start,
        jac=slopes,
        tr_solver="lsmr",
        bounds=(low.reshape(-1), high.reshape(-1)),
        xtol=1e-13,
        ftol=1e-10,
        gtol=1e-13,
        max_nfev=EVALUATIONS,
    )
    return RoundCones(*split(found.x))
