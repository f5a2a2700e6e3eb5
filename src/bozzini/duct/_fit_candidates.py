"""Large super-ellipsoids inside a duct: candidates of which a fit chooses some."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from ..progress import Progress
from ._fit_chain import Chain
from ._fit_points import join_powers
from ._fit_rays import cast_rays, spread_directions
from .protocol import Duct

__all__ = ["Block", "make_candidates", "sample_lumen"]

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
        return _gauge((points - self.centre) @ self.rotation, self.half, self.e1, self.e2)

    def scale(self, factor: float) -> Block:
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
