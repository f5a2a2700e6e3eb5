"""Chains along a centreline: which of its points to keep, so that few balls stand for all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ..progress import Progress, no_progress
from .centreline import Centreline
from .protocol import Duct
from .sections import find_tangents

__all__ = ["Chain", "Edges", "choose_chain", "measure_edges", "place_chain"]

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
