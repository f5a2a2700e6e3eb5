"""Linear least squares with linear inequalities."""

from __future__ import annotations

import numpy as np

from .arrays import Floats


def solve_limited(matrix: Floats, target: Floats, sides: Floats, floors: Floats) -> Floats:
    """Return x (n,) that makes ``|matrix x - target|`` least with ``sides x >= floors``.

    Turned into a least distance, and that into least squares of factors of 0 or more (C. L. Lawson,
    R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23): exact, whichever limits bind.

    Parameters
    ----------
    matrix : ndarray, shape (k, n)
        Of rank n.
    target : ndarray, shape (k,)
    sides, floors : ndarray, shapes (c, n) and (c,)
        Limits that some x keeps to.

    Raises
    ------
    ValueError
        If no x does.
    """
    from scipy.linalg import qr, solve_triangular
    from scipy.optimize import nnls

    whole, upper = qr(matrix, mode="economic", check_finite=False)
    start = whole.T @ target
    free = solve_triangular(upper, start, check_finite=False)
    # Limits in the size of their own rows.
    turned = solve_triangular(upper, sides.T, trans="T", check_finite=False)
    sizes = np.sqrt(np.square(turned).sum(axis=0))
    short = (floors - sides @ free) / sizes
    if short.max() <= 0.0:
        return np.asarray(free)
    system = np.vstack([turned / sizes, short])
    goal = np.zeros(len(system))
    goal[-1] = 1.0
    factors, left = nnls(system, goal, maxiter=20 * system.shape[1])
    if left <= 1e-10:
        raise ValueError("the limits contradict each other")
    miss = system @ factors - goal
    return np.asarray(free + solve_triangular(upper, -miss[:-1] / miss[-1], check_finite=False))
