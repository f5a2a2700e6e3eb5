"""Super-ellipsoids fitted to a duct: large ones inside it, chosen so that few cover much.

Each candidate is about the largest that the rays from its centre to the wall leave room for; the
balls that touch the wall around points of the centreline are candidates too. Of these some are
taken that a way can go through, and then those that add most volume.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...errors import GeometryError
from ...progress import Progress, no_progress
from ..base import Duct
from ..centreline import Centreline
from ..shapes.super_ellipses import SuperEllipsoids
from .measure import Sections, cast_rays, find_tangents, spread_directions
from .points import fit_super_ellipsoid, join_powers

# Chains along a centreline: which of its points to keep, so that few balls stand for all.

SPACING = 1.0
"""Distance between the places that may be kept [mm]; longer on long centrelines."""

PLACES_MAX = 500

STEP = 0.5
"""A cone is checked at balls this far apart [mm]."""

PATIENCE = 6
"""So many longer cones in turn must fail before no longer one is tried."""

BLOCK = 8
"""Cones from one place that are measured at once."""

SPAN_MAX = 120
"""A cone passes over this many places at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
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
        Proved room at each [mm].
    """

    arc_length: NDArray[np.float64]
    centres: NDArray[np.float64]
    tangents: NDArray[np.float64]
    radii: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """Cones between two places of a chain.

    Attributes
    ----------
    ends : (m, 2) int
        First and last place.
    loss : (m,) float
        How much less room than the duct the cone has at most, at places between [mm].
    """

    ends: NDArray[np.int64]
    loss: NDArray[np.float64]


def place_chain(duct: Duct, centreline: Centreline) -> Chain:
    """Return a ball at every place that may be kept.

    Raises
    ------
    GeometryError
        If there is no proved room at a place.
    """
    count = min(max(2, round(centreline.length / SPACING) + 1), PLACES_MAX)
    arc = np.linspace(0.0, centreline.length, count)
    centres = np.stack(
        [np.interp(arc, centreline.arc_length, c) for c in centreline.points.T], axis=1
    )
    radii = duct.clearance_bound(centres)
    if radii.min() <= 0.0:
        index = int(np.argmin(radii))
        place = ", ".join(f"{value:.1f}" for value in centres[index])
        raise GeometryError(
            f"there is no proved room at ({place}) mm of the centreline, at {arc[index]:.1f} mm: "
            "no shape can be put there; use a smaller voxel"
        )
    return Chain(
        arc_length=arc, centres=centres, tangents=find_tangents(centreline, arc), radii=radii
    )


def measure_edges(
    duct: Duct,
    chain: Chain,
    *,
    allowance: float,
    cylinders: bool = False,
    progress: Progress = no_progress,
) -> Edges:
    """Return the cones between places that reach outside the duct by `allowance` mm at most.

    A ball reaches outside by no more than its radius exceeds the room at its centre; that is
    asked of balls along the cone, `STEP` apart.

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
                apart = not cylinders or _lie_apart(chain, i, j)
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
    return Edges(ends=np.array(ends, dtype=np.int64).reshape(-1, 2), loss=np.array(losses))


def choose_chain(
    edges: Edges, count: int, *, max_loss: float, pieces: int | None
) -> tuple[list[int], float]:
    """Return the places to keep, and the most room that is lost between them [mm].

    Parameters
    ----------
    edges : Edges
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
                f"max error is {max_loss:g} mm: the room lost between neighbouring places of the "
                "centreline is more already; give a larger one, or the number of pieces"
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
    duct: Duct, chain: Chain, i: int, others: list[int]
) -> list[tuple[float, float]]:
    """Return how far the cones from ball i reach outside, and what room they lose."""
    parts, sizes = [], []
    for j in others:
        step = chain.centres[j] - chain.centres[i]
        t = np.linspace(0.0, 1.0, max(3, int(np.ceil(np.linalg.norm(step) / STEP)) + 1))
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
            room = (radii - away).max(axis=1)
            loss = max(0.0, float((chain.radii[i + 1 : j] - room).max()))
        found.append((float(excess[1:-1].max()), loss))
    return found


def _lie_apart(chain: Chain, i: int, j: int) -> bool:
    """Whether the circles across the centreline at both places neither meet nor turn back."""
    d = chain.centres[j] - chain.centres[i]
    one, other = chain.tangents[i], chain.tangents[j]
    sine = float(np.linalg.norm(np.cross(one, other)))
    if float(one @ other) <= 0.0:
        return False
    room = min(float(one @ d) - chain.radii[j] * sine, float(other @ d) - chain.radii[i] * sine)
    return bool(room > 1e-6 * float(np.linalg.norm(d)))


def _find_shortest(edges: Edges, count: int, most: float) -> list[int] | None:
    """Return the fewest places from first to last, of those the chain with the least loss."""
    good = edges.loss <= most
    before: list[list[tuple[int, float]]] = [[] for _ in range(count)]
    for (i, j), loss in zip(edges.ends[good].tolist(), edges.loss[good].tolist(), strict=True):
        before[j].append((i, loss))
    best: list[tuple[float, float]] = [(0.0, 0.0)] + [(np.inf, np.inf)] * (count - 1)
    came = [-1] * count
    for j in range(1, count):
        for i, loss in before[j]:
            cost = (best[i][0] + 1.0, best[i][1] + loss)
            if cost < best[j]:
                best[j], came[j] = cost, i
    if not np.isfinite(best[-1][0]):
        return None
    path = [count - 1]
    while path[-1] > 0:
        path.append(came[path[-1]])
    return path[::-1]


def _worst(edges: Edges, path: list[int]) -> float:
    table = {(i, j): loss for (i, j), loss in zip(edges.ends.tolist(), edges.loss, strict=True)}
    return float(max(table[i, j] for i, j in zip(path[:-1], path[1:], strict=True)))


# Large super-ellipsoids inside a duct: candidates of which a fit chooses some.

RAYS = 500
"""Rays of a candidate."""

EVALUATIONS = 700
"""So many forms are tried for a candidate."""

CHECKS = 2000
"""Points of a candidate's wall where it is checked."""

STRETCH = 3.0
"""Distance of candidates on the centreline [mm]."""

OTHERS = 200
"""Candidates elsewhere in the lumen."""

EXPONENTS = (0.1, 2.0)


@dataclass(frozen=True)
class Block:
    """One super-ellipsoid: centre, half axes, exponents, axes as columns."""

    centre: NDArray[np.float64]
    half: NDArray[np.float64]
    e1: float
    e2: float
    rotation: NDArray[np.float64]

    def gauge(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gauge of world points: 1 on the surface."""
        return _gauge((points - self.centre) @ self.rotation, self.half, self.e1, self.e2)

    def scale(self, factor: float) -> Block:
        """Return the block with its half axes scaled."""
        return Block(self.centre, factor * self.half, self.e1, self.e2, self.rotation)


def make_candidates(
    draft: Duct, chain: Chain, *, allowance: float, progress: Progress
) -> list[Block]:
    """Return candidates on the centreline, and all over the lumen.

    Raises
    ------
    GeometryError
        If there is none.
    """
    spacing = float(chain.arc_length[-1]) / max(1, round(float(chain.arc_length[-1]) / STRETCH))
    wanted = np.arange(0.0, float(chain.arc_length[-1]) + 0.5 * spacing, spacing)
    places = np.unique(
        np.searchsorted(chain.arc_length, wanted - 1e-9).clip(0, len(chain.radii) - 1)
    )
    centres = np.concatenate([chain.centres[places], _spread_centres(draft)])
    directions = spread_directions(RAYS)
    reach = float(np.linalg.norm(np.diff(draft.bounds, axis=0)))
    checks = spread_directions(CHECKS)
    blocks = []
    for index, centre in enumerate(centres):
        lengths = cast_rays(draft, np.repeat(centre[None], RAYS, axis=0), directions, reach=reach)
        if lengths.min() > 0.0:
            block = _draw_in(
                draft, _inscribe(centre, directions * lengths[:, None]), checks, allowance
            )
            if block is not None:
                blocks.append(block)
        progress("super-ellipsoids", (index + 1) / len(centres))
    if not blocks:
        raise GeometryError("no super-ellipsoid was found inside the duct")
    return blocks


def _inscribe(centre: NDArray[np.float64], wall: NDArray[np.float64]) -> Block:
    """Return about the largest block with a centre that holds none of the points `wall` about it.

    All blocks of one form are alike but for their size, so that the largest of a form is known,
    and the form is searched (Nelder and Mead's method, as the largest has corners).
    """
    from scipy.optimize import minimize

    from ..kernels.fit import least_gauge, turn_matrix

    _, axes = np.linalg.eigh(wall.T @ wall)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    local = np.ascontiguousarray(wall @ axes)

    def shape(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
        half = np.exp(np.clip(x[:3] - x[:3].mean(), -4.0, 4.0))
        low, high = EXPONENTS
        e1, e2 = low + (high - low) / (1.0 + np.exp(-np.clip(x[3:5], -30.0, 30.0)))
        return half, float(e1), float(e2)

    def cost(x: NDArray[np.float64]) -> float:
        half, e1, e2 = shape(x)
        size = least_gauge(local, half, e1, e2, turn_matrix(x[5], x[6], x[7]))
        return -_log_volume(e1, e2) - float(np.log(half).sum()) - 3.0 * math.log(size)

    start = np.zeros(8)
    start[:3] = np.log(np.percentile(np.abs(local), 80, axis=0) + 1e-9)
    found = minimize(
        cost,
        start,
        method="Nelder-Mead",
        options={
            "maxfev": EVALUATIONS,
            "xatol": 1e-3,
            "fatol": 1e-3,
            "initial_simplex": np.concatenate([start[None], start + 0.3 * np.eye(8)]),
        },
    )
    half, e1, e2 = shape(found.x)
    left, _, right = np.linalg.svd(axes @ turn_matrix(*found.x[5:8]))
    rotation = left @ right
    return Block(
        centre, float(_gauge(wall @ rotation, half, e1, e2).min()) * half, e1, e2, rotation
    )


def _draw_in(
    duct: Duct, block: Block, directions: NDArray[np.float64], allowance: float
) -> Block | None:
    """Return the block made smaller until its wall is not outside by more than `allowance`."""
    # Directions in its own scaled frame: boxes have as many points on each side as they are wide.
    own = directions * block.half
    wall = own / _gauge(own, block.half, block.e1, block.e2)[:, None] @ block.rotation.T
    for _ in range(60):
        outside = duct.signed_distance(block.centre + wall)
        if outside.max() <= allowance:
            return block
        wall = 0.96 * wall
        block = block.scale(0.96)
    return None


def _spread_centres(duct: Duct) -> NDArray[np.float64]:
    """Return centres all over the lumen, moved to where there is more room."""
    centres = sample_lumen(duct, OTHERS, seed=1)
    for _ in range(20):
        moved = centres - 0.5 * duct.gradient(centres)
        better = duct.signed_distance(moved) < duct.signed_distance(centres)
        centres = np.where(better[:, None], moved, centres)
    return centres


def sample_lumen(duct: Duct, count: int, *, seed: int = 0) -> NDArray[np.float64]:
    """Return (count, 3) points of a lumen at random, evenly by volume."""
    random = np.random.default_rng(seed)
    low, high = duct.bounds
    found: list[NDArray[np.float64]] = []
    total = 0
    for _ in range(1000):
        points = random.uniform(low, high, (max(4 * count, 1000), 3))
        points = points[duct.signed_distance(points) < 0.0]
        found.append(points)
        total += len(points)
        if total >= count:
            return np.concatenate(found)[:count]
    raise GeometryError("the lumen fills too little of its box for a sample of it")


def _gauge(
    local: NDArray[np.float64], half: NDArray[np.float64], e1: float, e2: float
) -> NDArray[np.float64]:
    scaled = np.abs(local) / half
    flat = join_powers(scaled[:, 0], scaled[:, 1], 2.0 / e2)
    return join_powers(flat, scaled[:, 2], 2.0 / e1)


def _log_volume(e1: float, e2: float) -> float:
    """Logarithm of the volume of the super-ellipsoid with half axes 1."""
    gamma = math.lgamma
    section = 2.0 * gamma(0.5 * e2) - gamma(e2)
    profile = gamma(0.5 * e1 + 1.0) + gamma(e1) - gamma(1.5 * e1 + 1.0)
    return math.log(2.0 * e1 * e2) + section + profile


SAMPLES = 40_000
"""Points of the lumen by which volume is counted."""


def cover_blocks(
    draft: Duct,
    chain: Chain,
    *,
    pieces: int | None,
    max_loss: float,
    allowance: float,
    progress: Progress = no_progress,
) -> SuperEllipsoids:
    """Return super-ellipsoids inside a duct that the centreline goes through.

    Parameters
    ----------
    draft : Duct
        Asked at very many points: better a sampled field. What it errs, `shrink_blocks` mends.
    pieces : int, optional
        Half of them at most, and as many as it takes, go to the way: so that as little room as
        may be is lost on the centreline. The rest add volume. Without it the way is the fewest
        that lose no more than `max_loss`, and pieces are added that each add 0.3 % of the volume.

    Raises
    ------
    GeometryError
        If so few cannot cover the way.
    """
    blocks = make_candidates(draft, chain, allowance=allowance, progress=progress)
    # Few at a bend or a narrow place leave all the room there is; balls do.
    blocks += [
        Block(centre, np.full(3, radius), 1.0, 1.0, np.eye(3))
        for centre, radius in zip(chain.centres, chain.radii, strict=True)
    ]
    samples = sample_lumen(draft, SAMPLES)
    held = np.array([block.gauge(samples) <= 1.0 for block in blocks])
    room = np.array([_room(block, chain.centres) for block in blocks])
    chosen = _choose_way(room, chain.radii, pieces=pieces, max_loss=max_loss)
    got = held[chosen].any(axis=0)
    while pieces is None or len(chosen) < pieces:
        gain = (held & ~got).sum(axis=1)
        best = int(np.argmax(gain))
        least = 0.003 * len(samples) if pieces is None else 1.0
        if gain[best] < least:
            break
        if (held[best] & got).any():
            chosen.append(best)
            got |= held[best]
        else:
            held[best] = False
    return _join_blocks([blocks[k] for k in chosen])


def add_balls(
    blocks: SuperEllipsoids,
    duct: Duct,
    places: NDArray[np.float64],
    room: NDArray[np.float64],
    *,
    max_loss: float,
) -> SuperEllipsoids:
    """Return blocks, and balls at those of the places (n, 3) where more room is lost than that.

    Parameters
    ----------
    blocks : SuperEllipsoids
    duct : Duct
        The true one.
    places : (n, 3) float
        Inside it [mm].
    room : (n,) float
        That it has there [mm].
    max_loss : float
        [mm].
    """
    for _ in range(len(places)):
        loss = room + blocks.signed_distance(places)
        worst = int(np.argmax(loss))
        radius = float(duct.clearance_bound(places[worst]))
        # No ball does better than the blocks where less is proved of the duct than it says.
        if loss[worst] <= max_loss or room[worst] - radius >= loss[worst]:
            break
        blocks = _build(
            np.concatenate([blocks.centres, places[worst][None]]),
            np.concatenate([blocks.half_axes, np.full((1, 3), radius)]),
            np.append(blocks.e1, 1.0),
            np.append(blocks.e2, 1.0),
            np.concatenate([blocks.rotations, np.eye(3)[None]]),
        )
    return blocks


def shrink_blocks(blocks: SuperEllipsoids, places: NDArray[np.float64]) -> SuperEllipsoids:
    """Return blocks drawn in so that none holds any of the places (k, 3)."""
    least = np.minimum(blocks.evaluate_gauge(places).min(axis=0), 1.0)
    factor = np.where(least < 1.0, np.maximum(least - 1e-6, 0.5), 1.0)
    return _build(
        blocks.centres, blocks.half_axes * factor[:, None], blocks.e1, blocks.e2, blocks.rotations
    )


def fit_blocks(
    sections: Sections, pieces: int, *, progress: Progress = no_progress
) -> SuperEllipsoids:
    """Fit super-ellipsoids to the wall points of sections, each to a stretch of equal length.

    Bounded least squares of radial distances. The half axis along the duct is 0.75 of the length
    of a stretch and not fitted: walls without ends do not tell it.
    """
    total = float(sections.arc_length[-1])
    length = total / pieces
    found = []
    for k in range(pieces):
        middle = (k + 0.5) * length
        reach = max(0.75 * length, 1.01 * float(sections.arc_length[1]))
        near = np.abs(sections.arc_length - middle) <= reach
        own = int(np.argmin(np.abs(sections.arc_length - middle)))
        fit = fit_super_ellipsoid(
            sections.wall[near].reshape(-1, 3),
            frame=sections.frames[own],
            centre=sections.centres[own],
            half_length=0.75 * length,
        )
        found.append(Block(fit.centre, fit.half_axes, fit.e1, fit.e2, fit.rotation))
        progress("super-ellipsoids", (k + 1) / pieces)
    return _join_blocks(found)


def _choose_way(
    room: NDArray[np.float64],
    wanted: NDArray[np.float64],
    *,
    pieces: int | None,
    max_loss: float,
) -> list[int]:
    """Return few blocks that leave room on the whole centreline, the loss as small as it can be.

    Whatever the loss, a share of the room must be left, so that neighbours overlap.
    """
    most = int(np.ceil(0.5 * pieces)) if pieces is not None else len(room)
    best: list[int] | None = None
    low, high = max_loss if pieces is None else 0.0, float(wanted.max())
    for loss in (low, *np.linspace(low, high, 33)[1:]):
        covers = room >= np.maximum(wanted - loss, 0.1 * wanted)
        chosen = _cover(covers)
        if chosen is not None and len(chosen) <= most:
            return chosen
        if chosen is not None and (best is None or len(chosen) < len(best)):
            best = chosen
    if best is None:
        raise GeometryError("the super-ellipsoids found do not cover the centreline")
    if pieces is not None and len(best) > pieces:
        raise GeometryError(
            f"{pieces} pieces cannot cover the centreline with overlaps: it takes {len(best)}"
        )
    return best


def _cover(covers: NDArray[np.bool_]) -> list[int] | None:
    """Return the fewest runs of stations that reach from first to last, each meeting the next."""
    count = covers.shape[1]
    chosen: list[int] = []
    at = 0
    while True:
        ends = np.where(covers[:, at], _run_end(covers, at), -1)
        best = int(np.argmax(ends))
        if ends[best] < 0 or (chosen and ends[best] == at and at < count - 1):
            return None
        chosen.append(best)
        if ends[best] >= count - 1:
            return chosen
        at = int(ends[best])


def _run_end(covers: NDArray[np.bool_], at: int) -> NDArray[np.int64]:
    """Return the last station of each block's run from `at` on."""
    gaps = ~covers[:, at:]
    first = np.where(gaps.any(axis=1), gaps.argmax(axis=1), gaps.shape[1])
    return np.asarray(at + first - 1, dtype=np.int64)


def _room(block: Block, points: NDArray[np.float64]) -> NDArray[np.float64]:
    one = _build(
        block.centre[None],
        block.half[None],
        np.array([block.e1]),
        np.array([block.e2]),
        block.rotation[None],
    )
    return -one.signed_distance(points)


def _join_blocks(blocks: list[Block]) -> SuperEllipsoids:
    return _build(
        np.array([block.centre for block in blocks]),
        np.array([block.half for block in blocks]),
        np.array([block.e1 for block in blocks]),
        np.array([block.e2 for block in blocks]),
        np.array([block.rotation for block in blocks]),
    )


def _build(
    centres: NDArray[np.float64],
    half_axes: NDArray[np.float64],
    e1: NDArray[np.float64],
    e2: NDArray[np.float64],
    rotations: NDArray[np.float64],
) -> SuperEllipsoids:
    # Whether they hang together is asked once, of those that a fit ends with.
    return SuperEllipsoids(centres, half_axes, e1=e1, e2=e2, rotations=rotations, connected=False)
