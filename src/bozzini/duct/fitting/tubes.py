"""Round cones and connected cylinders fitted to a duct along a chosen chain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..base import Duct
from ..shapes.cones import RoundCones
from ..shapes.cylinders import ConnectedCylinders
from .blocks import Chain
from .measure import carry_frames, cast_rays, share_wall
from .planar import fit_circle

RAYS = 48
STATIONS = 9
"""The wall of a cylinder is checked on so many rulings, at so many places each."""

SHRINK = 0.97
EVALUATIONS = 40
RADIUS_MIN = 1e-3
"""Smallest radius that a fit gives [mm]."""


def inscribe_cylinders(
    duct: Duct, chain: Chain, places: list[int], *, allowance: float
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
    room = cast_rays(duct, np.repeat(centres, RAYS, axis=0), rays.reshape(-1, 3), reach=reach)
    radii = np.maximum(least, room.reshape(-1, RAYS).min(axis=1))
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


def _find_apart(
    centres: NDArray[np.float64], normals: NDArray[np.float64], radii: NDArray[np.float64]
) -> NDArray[np.bool_]:
    d = np.diff(centres, axis=0)
    sine = np.linalg.norm(np.cross(normals[:-1], normals[1:]), axis=1)
    first = np.einsum("ij,ij->i", normals[:-1], d) - radii[1:] * sine
    second = np.einsum("ij,ij->i", normals[1:], d) - radii[:-1] * sine
    return np.asarray(np.minimum(first, second) > 1e-6 * np.linalg.norm(d, axis=1))


def fit_cylinder_chain(
    chain: Chain, places: list[int], walls: NDArray[np.float64]
) -> ConnectedCylinders:
    """Return cylinders whose circles fit wall points (n, k, 3) of sections by least squares.

    The sections are those across the chain at the places. Circles that would meet, or stand
    across the way between them, are drawn back to the balls of the chain until they do not.
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
    points: NDArray[np.float64], centres: NDArray[np.float64], radii: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Return (n,) distances of points from a chain of cones, and which ball is nearest.

    The ball is ``t`` of the way from ball ``index`` to the next.
    """
    from ..kernels.fit import find_balls

    best = np.empty(len(points))
    index = np.zeros(len(points), dtype=np.int64)
    place = np.zeros(len(points))
    find_balls(np.ascontiguousarray(points), centres, radii, best, index, place)
    return best, index, place


def fit_cone_chain(
    points: NDArray[np.float64], centres: NDArray[np.float64], radii: NDArray[np.float64]
) -> RoundCones:
    """Fit a chain of round cones to wall points (m, 3), by least squares of distances.

    Centres move across the chain, and along it by 0.4 of the way to the next at most: where the
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
    ways = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    frames = carry_frames(ways / np.linalg.norm(ways, axis=1, keepdims=True))

    def split(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        table = x.reshape(count, 4)
        return centres + np.einsum("ni,nji->nj", table[:, :3], frames), table[:, 3]

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return measure_cone_chain(points, *split(x))[0]

    def slopes(x: NDArray[np.float64]) -> csr_matrix:
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
