"""Super-ellipsoids fitted to a duct: large ones inside it, chosen so that few cover much.

Each candidate is about the largest that the rays from its centre to the wall leave place for; the
balls that touch the wall around points of the centreline are candidates too. Of these some are
taken that cover the centreline, and then those that add most volume. A candidate is a duct of one
super-ellipsoid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...errors import GeometryError
from ...numeric.arrays import Floats
from ...numeric.vectors import nearest_rotation, spread_directions
from ...progress import Progress, no_progress
from ..base import Duct
from ..shapes.super_ellipses import EXPONENT_MAX, EXPONENT_MIN, SuperEllipsoids
from .chain import BallChain
from .measure import Sections, cast_rays
from .points import fit_super_ellipsoid

RAYS = 500
"""Rays of a candidate."""

EVALUATIONS = 700
"""So many forms are tried for a candidate."""

CHECKS = 2000
"""Points of a candidate's wall where it is checked."""

STRETCH_MM = 3.0
"""Distance of candidates on the centreline."""

OTHERS = 200
"""Candidates elsewhere in the lumen."""

SAMPLES = 40_000
"""Points of the lumen by which volume is counted."""

SHRINK = 0.96
"""By how much a candidate that reaches outside is made smaller, again and again."""


def make_block(
    centre: Floats, half_axes: Floats, e1: float, e2: float, rotation: Floats
) -> SuperEllipsoids:
    """Return one super-ellipsoid as a duct."""
    return SuperEllipsoids(
        centre[None],
        half_axes[None],
        e1=np.array([e1]),
        e2=np.array([e2]),
        rotations=rotation[None],
        connected=False,
    )


def join_blocks(blocks: Sequence[SuperEllipsoids]) -> SuperEllipsoids:
    """Return the union; whether it is connected is asked once, of the one that a fit ends with."""
    return SuperEllipsoids(
        np.concatenate([block.centres for block in blocks]),
        np.concatenate([block.half_axes for block in blocks]),
        e1=np.concatenate([block.e1 for block in blocks]),
        e2=np.concatenate([block.e2 for block in blocks]),
        rotations=np.concatenate([block.rotations for block in blocks]),
        connected=False,
    )


def make_candidates(
    draft: Duct, chain: BallChain, *, allowance: float, progress: Progress
) -> list[SuperEllipsoids]:
    """Return candidates on the centreline, and all over the lumen.

    Raises
    ------
    GeometryError
        If there is none.
    """
    spacing = float(chain.arc_length[-1]) / max(1, round(float(chain.arc_length[-1]) / STRETCH_MM))
    wanted = np.arange(0.0, float(chain.arc_length[-1]) + 0.5 * spacing, spacing)
    places = np.unique(
        np.searchsorted(chain.arc_length, wanted - 1e-9).clip(0, len(chain.radii) - 1)
    )
    centres = np.concatenate([chain.centres[places], _spread_centres(draft)])
    directions, checks = spread_directions(RAYS), spread_directions(CHECKS)
    reach = float(np.linalg.norm(np.diff(draft.bounds, axis=0)))
    blocks = []
    for index, centre in enumerate(centres):
        lengths = cast_rays(draft, np.repeat(centre[None], RAYS, axis=0), directions, reach=reach)
        if lengths.min() > 0.0:
            block = _inscribe(centre, directions * lengths[:, None])
            blocks += _shrink_inside(draft, block, checks, allowance)
        progress("super-ellipsoids", (index + 1) / len(centres))
    if not blocks:
        raise GeometryError("no super-ellipsoid was found inside the duct")
    return blocks


def _inscribe(centre: Floats, wall: Floats) -> SuperEllipsoids:
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

    def shape(x: Floats) -> tuple[Floats, float, float]:
        half = np.exp(np.clip(x[:3] - x[:3].mean(), -4.0, 4.0))
        share = 1.0 / (1.0 + np.exp(-np.clip(x[3:5], -30.0, 30.0)))
        e1, e2 = EXPONENT_MIN + (EXPONENT_MAX - EXPONENT_MIN) * share
        return half, float(e1), float(e2)

    def cost(x: Floats) -> float:
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
    rotation = nearest_rotation(axes @ turn_matrix(*found.x[5:8]))
    block = make_block(centre, half, e1, e2, rotation)
    return _scale(block, float(block.evaluate_gauge(centre + wall).min()))


def _shrink_inside(
    duct: Duct, block: SuperEllipsoids, directions: Floats, allowance: float
) -> list[SuperEllipsoids]:
    """Return the block made smaller until its wall is not outside by more than `allowance`."""
    # Directions in its own scaled frame: boxes have as many points on each side as they are wide.
    own = (directions * block.half_axes) @ block.rotations[0].T
    wall = own / block.evaluate_gauge(block.centres + own)
    for power in range(60):
        if duct.signed_distance(block.centres + SHRINK**power * wall).max() <= allowance:
            return [_scale(block, SHRINK**power)]
    return []


def _scale(block: SuperEllipsoids, factor: float) -> SuperEllipsoids:
    return replace(block, half_axes=factor * block.half_axes)


def _spread_centres(duct: Duct) -> Floats:
    """Return centres all over the lumen, moved to where the clearance is larger."""
    centres = sample_lumen(duct, OTHERS, seed=1)
    for _ in range(20):
        moved = centres - 0.5 * duct.gradient(centres)
        better = duct.signed_distance(moved) < duct.signed_distance(centres)
        centres = np.where(better[:, None], moved, centres)
    return centres


def sample_lumen(duct: Duct, count: int, *, seed: int = 0) -> Floats:
    """Return (count, 3) points of a lumen at random, evenly by volume."""
    random = np.random.default_rng(seed)
    low, high = duct.bounds
    found: list[Floats] = []
    total = 0
    for _ in range(1000):
        points = random.uniform(low, high, (max(4 * count, 1000), 3))
        points = points[duct.signed_distance(points) < 0.0]
        found.append(points)
        total += len(points)
        if total >= count:
            return np.concatenate(found)[:count]
    raise GeometryError("the lumen fills too little of its box for a sample of it")


def _log_volume(e1: float, e2: float) -> float:
    """Logarithm of the volume of the super-ellipsoid with half axes 1."""
    gamma = math.lgamma
    section = 2.0 * gamma(0.5 * e2) - gamma(e2)
    profile = gamma(0.5 * e1 + 1.0) + gamma(e1) - gamma(1.5 * e1 + 1.0)
    return math.log(2.0 * e1 * e2) + section + profile


def cover_blocks(
    draft: Duct,
    chain: BallChain,
    *,
    pieces: int | None,
    max_loss: float,
    allowance: float,
    progress: Progress = no_progress,
) -> SuperEllipsoids:
    """Return super-ellipsoids inside a duct that the centreline runs through.

    Parameters
    ----------
    draft : Duct
        Asked at very many points: better a sampled field. `shrink_blocks` mends its errors.
    pieces : int, optional
        Half of them at most, and as many as it takes, cover the centreline, so that as little
        clearance as can be is lost on it. The rest add volume. Without it the fewest cover it that
        lose no more than `max_loss`, and pieces are added that each add 0.3 % of the volume.

    Raises
    ------
    GeometryError
        If so few cannot cover the centreline.
    """
    blocks = make_candidates(draft, chain, allowance=allowance, progress=progress)
    # Few at a bend or a narrow place leave all the clearance there is; balls do.
    blocks += [
        make_block(centre, np.full(3, radius), 1.0, 1.0, np.eye(3))
        for centre, radius in zip(chain.centres, chain.radii, strict=True)
    ]
    samples = sample_lumen(draft, SAMPLES)
    held = np.array([block.evaluate_gauge(samples)[:, 0] <= 1.0 for block in blocks])
    clearance = np.array([-block.signed_distance(chain.centres) for block in blocks])
    chosen = _cover_line(clearance, chain.radii, pieces=pieces, max_loss=max_loss)
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
    return join_blocks([blocks[k] for k in chosen])


def add_balls(
    blocks: SuperEllipsoids,
    duct: Duct,
    places: Floats,
    clearance: Floats,
    *,
    max_loss: float,
) -> SuperEllipsoids:
    """Return blocks, and balls at those of the places (n, 3) where more clearance is lost.

    Parameters
    ----------
    blocks : SuperEllipsoids
    duct : Duct
        The true one.
    places : (n, 3) float
        Inside it [mm].
    clearance : (n,) float
        That it has there [mm].
    max_loss : float
        [mm].
    """
    for _ in range(len(places)):
        loss = clearance + blocks.signed_distance(places)
        worst = int(np.argmax(loss))
        radius = float(duct.clearance_bound(places[worst]))
        # No ball does better than the blocks where less is proved of the duct than its distance.
        if loss[worst] <= max_loss or clearance[worst] - radius >= loss[worst]:
            break
        ball = make_block(places[worst], np.full(3, radius), 1.0, 1.0, np.eye(3))
        blocks = join_blocks([blocks, ball])
    return blocks


def shrink_blocks(blocks: SuperEllipsoids, places: Floats) -> SuperEllipsoids:
    """Return blocks drawn in so that none holds any of the places (k, 3)."""
    least = np.minimum(blocks.evaluate_gauge(places).min(axis=0), 1.0)
    factor = np.where(least < 1.0, np.maximum(least - 1e-6, 0.5), 1.0)
    return replace(blocks, half_axes=blocks.half_axes * factor[:, None])


def fit_blocks(
    sections: Sections, pieces: int, *, progress: Progress = no_progress
) -> SuperEllipsoids:
    """Fit super-ellipsoids to the wall points of sections, each to a stretch of equal length.

    Bounded least squares of radial distances. The half axis along the duct is 0.75 of the length
    of a stretch and not fitted: walls without ends do not determine it.
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
        found.append(fit.to_duct())
        progress("super-ellipsoids", (k + 1) / pieces)
    return join_blocks(found)


def _cover_line(
    clearance: Floats,
    wanted: Floats,
    *,
    pieces: int | None,
    max_loss: float,
) -> list[int]:
    """Return few blocks that leave clearance all along the centreline, losing as little as can be.

    Whatever the loss, a share of the clearance must be left, so that neighbours overlap.
    """
    most = int(np.ceil(0.5 * pieces)) if pieces is not None else len(clearance)
    best: list[int] | None = None
    low, high = max_loss if pieces is None else 0.0, float(wanted.max())
    for loss in (low, *np.linspace(low, high, 33)[1:]):
        covers = clearance >= np.maximum(wanted - loss, 0.1 * wanted)
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
