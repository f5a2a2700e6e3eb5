"""The thesis's optimisation as printed, (5.7) and (5.9)-(5.10), by SciPy's SLSQP.

``arccos`` has no slope at the straight start and the constraints are dependent at the optimum, so
it starts slightly bent; even so it does not always converge, and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

__all__ = ["solve_chain", "solve_segment"]

START = 0.05
"""Angle by which the first guess is bent [rad]."""


def angle_between(one: np.ndarray, other: np.ndarray) -> float:
    cosine = one @ other / np.sqrt((one @ one) * (other @ other))
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def solve_segment(
    base: np.ndarray,
    backbone: float,
    tendons: Sequence[float],
    *,
    last_constraint: bool = True,
    toward: np.ndarray | None = None,
) -> tuple[np.ndarray, bool, float]:
    """Solve one segment.

    Parameters
    ----------
    base : (1 + t, dim) float
        ``X_0, X_a, X_b, ...``: backbone and tendons at the base link.
    backbone, tendons : float
        ``l_0``, and ``l_a``, ``l_b``, ...
    last_constraint : bool
        Whether two tendons keep their angle, the last line of (5.10), read with the top link.
    toward : (dim,) float
        Sideways direction of the first guess; by default that of the tendons' shortening.

    Returns
    -------
    (1 + t, dim) ndarray, bool, float
        The top link, whether it converged, and the objective there.
    """
    count, dim = base.shape
    arms = base[1:] - base[0]
    sizes = np.linalg.norm(arms, axis=1)
    if dim == 2:
        axis = np.asarray([-arms[0, 1], arms[0, 0]]) / sizes[0]
    elif count == 2:
        raise ValueError("one tendon in space leaves the plane open: give points in the plane")
    else:
        axis = np.cross(arms[0], arms[1])
        axis /= np.linalg.norm(axis)
    if toward is None:
        toward = arms.T @ ((backbone - np.asarray(tendons)) / sizes)
    toward = toward / np.linalg.norm(toward)

    def cost(x: np.ndarray) -> float:
        top = x.reshape(count, dim)
        turns = [angle_between(arm, top[1 + k] - top[0]) for k, arm in enumerate(arms)]
        return turns[0] if count == 2 else float(np.sum(np.square(turns)))

    def length(i: int, target: float, j: int | None) -> Callable[[np.ndarray], float]:
        def gap(x: np.ndarray) -> float:
            top = x.reshape(count, dim)
            other = base[i] if j is None else top[j]
            return float(np.linalg.norm(top[i] - other) - target)

        return gap

    gaps: list[Any] = [length(0, backbone, None)]
    gaps += [length(1 + k, target, None) for k, target in enumerate(tendons)]
    gaps += [length(1 + k, size, 0) for k, size in enumerate(sizes)]
    if last_constraint and count == 3:
        opening = angle_between(arms[0], arms[1])
        gaps.append(
            lambda x: (
                angle_between(*(x.reshape(count, dim)[1:] - x.reshape(count, dim)[0])) - opening
            )
        )
    # Slightly bent: the link leans, the coupler turns by twice that.
    lean = np.cos(START) * axis + np.sin(START) * toward
    turned = arms - 2.0 * np.outer(arms @ toward, np.sin(START) * axis)
    guess = np.vstack([base[0] + backbone * lean, base[0] + backbone * lean + turned])
    done = minimize(
        cost,
        guess.ravel(),
        method="SLSQP",
        constraints=[{"type": "eq", "fun": gap} for gap in gaps],
        options={"ftol": 1e-12, "maxiter": 300},
    )
    top = done.x.reshape(count, dim)
    missed = max(abs(gap(done.x)) for gap in gaps)
    return top, bool(done.success and missed < 1e-7), float(done.fun)


def solve_chain(
    base: np.ndarray, backbone: float, tendons: Sequence[float], segments: int, **options: Any
) -> tuple[np.ndarray, int]:
    """Solve all segments from the base on; joints (segments + 1, dim), and how many converged."""
    joints = [base[0]]
    converged = 0
    for _ in range(segments):
        base, good, _ = solve_segment(base, backbone, tendons, **options)
        joints.append(base[0])
        converged += good
    return np.asarray(joints), converged
