"""Super-ellipsoids fitted to a duct: large ones inside it, chosen so that few cover much.

Each candidate is about the largest that the rays from its centre to the wall leave room for; the
balls that touch the wall around points of the centreline are candidates too. Of these some are
taken that a way can go through, and then those that add most volume.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ..progress import Progress, no_progress
from ._fit_candidates import Block, make_candidates, sample_lumen
from ._fit_chain import Chain
from ._fit_points import fit_super_ellipsoid
from .protocol import Duct
from .sections import Sections
from .super_ellipsoid import SuperEllipsoids

__all__ = ["add_balls", "cover_blocks", "fit_blocks", "shrink_blocks"]

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
