"""Super-ellipsoids fitted to a duct: large ones inside it, chosen so that few cover much.

Each candidate is about the largest that the rays from its centre to the wall leave room for. Of
many candidates some are taken that a way can go through, and then those that add most volume.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ..progress import Progress, no_progress
from ._fit_chain import Chain
from ._fit_points import _join, fit_super_ellipsoid
from ._fit_rays import cast_rays, spread_directions
from .protocol import Duct
from .sections import Sections
from .super_ellipsoid import SuperEllipsoids

__all__ = ["cover_blocks", "fit_blocks", "shrink_blocks"]

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

SAMPLES = 40_000
"""Points of the lumen by which volume is counted."""

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
        return _gauge((points - self.centre) @ self.rotation, self.half, self.e1, self.e2)

    def scale(self, factor: float) -> Block:
        return Block(self.centre, factor * self.half, self.e1, self.e2, self.rotation)


def cover_blocks(
    duct: Duct,
    chain: Chain,
    *,
    pieces: int | None,
    max_loss: float,
    allowance: float,
    draft: Duct,
    progress: Progress = no_progress,
) -> SuperEllipsoids:
    """Return super-ellipsoids inside a duct that the centreline goes through.

    Parameters
    ----------
    pieces : int, optional
        Half of them at most, and as many as it takes, go to the way: so that as little room as
        may be is lost on the centreline. The rest add volume. Without it the way loses no more
        than `max_loss` if candidates can do that, and pieces are added that each add 0.3 % of the
        volume.
    draft : Duct
        Stands for `duct` where very many points are asked.

    Raises
    ------
    GeometryError
        If so few cannot cover the way.
    """
    blocks = _make_candidates(duct, chain, allowance=allowance, draft=draft, progress=progress)
    samples = _sample_lumen(draft, SAMPLES)
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


def _make_candidates(
    duct: Duct, chain: Chain, *, allowance: float, draft: Duct, progress: Progress
) -> list[Block]:
    spacing = float(chain.arc_length[-1]) / max(1, round(float(chain.arc_length[-1]) / STRETCH))
    wanted = np.arange(0.0, float(chain.arc_length[-1]) + 0.5 * spacing, spacing)
    places = np.unique(np.searchsorted(chain.arc_length, wanted - 1e-9).clip(0, len(chain.radii) - 1))
    centres = np.concatenate([chain.centres[places], _spread_centres(draft)])
    directions = spread_directions(RAYS)
    reach = float(np.linalg.norm(np.diff(draft.bounds, axis=0)))
    checks = spread_directions(CHECKS)
    blocks = []
    for index, centre in enumerate(centres):
        lengths = cast_rays(draft, np.repeat(centre[None], RAYS, axis=0), directions, reach=reach)
        if lengths.min() > 0.0:
            block = _draw_in(duct, _inscribe(centre, directions * lengths[:, None]), checks, allowance)
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

    from ._fit_kernels import least_gauge, turn_matrix

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
    return Block(centre, float(_gauge(wall @ rotation, half, e1, e2).min()) * half, e1, e2, rotation)


def _draw_in(
    duct: Duct, block: Block, directions: NDArray[np.float64], allowance: float
) -> Block | None:
    """Return the block made smaller until its wall is outside by `allowance` nowhere it is asked."""
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


def _spread_centres(duct: Duct) -> NDArray[np.float64]:
    """Return centres all over the lumen, moved to where there is more room."""
    centres = _sample_lumen(duct, OTHERS, seed=1)
    for _ in range(20):
        moved = centres - 0.5 * duct.gradient(centres)
        better = duct.signed_distance(moved) < duct.signed_distance(centres)
        centres = np.where(better[:, None], moved, centres)
    return centres


def _sample_lumen(duct: Duct, count: int, *, seed: int = 0) -> NDArray[np.float64]:
    """Return (count, 3) points of the lumen at random, evenly by volume."""
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
    return SuperEllipsoids(centres, half_axes, e1=e1, e2=e2, rotations=rotations)


def _gauge(
    local: NDArray[np.float64], half: NDArray[np.float64], e1: float, e2: float
) -> NDArray[np.float64]:
    scaled = np.abs(local) / half
    flat = _join(scaled[:, 0], scaled[:, 1], 2.0 / e2)
    return _join(flat, scaled[:, 2], 2.0 / e1)


def _log_volume(e1: float, e2: float) -> float:
    """Logarithm of the volume of the super-ellipsoid with half axes 1."""
    gamma = math.lgamma
    section = 2.0 * gamma(0.5 * e2) - gamma(e2)
    profile = gamma(0.5 * e1 + 1.0) + gamma(e1) - gamma(1.5 * e1 + 1.0)
    return math.log(2.0 * e1 * e2) + section + profile
