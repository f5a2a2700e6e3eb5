"""Which parameters of a muscle can be told from which data.

The rules were found by fits to synthetic data of `EnergyMuscle`, where the truth is known: 20
pressures up to 827 kPa, errors of 0.1 mm. There the modulus and the dead length are told by one
curve (to 0.006 MPa and 0.17 mm); the braid angle is lost in the dead length unless there are rows
under load or blocked, and so is friction unless there are both directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .dataset import Measurements

__all__ = [
    "CONDITION_LIMIT",
    "CORRELATION_LIMIT",
    "GAP_PRESSURES",
    "GAP_SPAN",
    "judge_fit",
    "judge_parameters",
    "judge_repeats",
]

CONDITION_LIMIT = 30.0
"""Above this condition of the Jacobian, its columns scaled to length 1, a warning is given."""
CORRELATION_LIMIT = 0.98
"""Above this correlation of two parameters a warning is given."""
GAP_PRESSURES = 3
GAP_SPAN = 3.0
"""A free gap needs so many pressures, above none and below `GAP_SPAN` times that of contact."""


def judge_parameters(
    free: Sequence[str], data: Measurements, *, contact_pressure: float = 0.0
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Say which of these parameters such data cannot tell, before anything is fitted.

    Parameters
    ----------
    free : sequence of str
    data : Measurements
    contact_pressure : float
        Pressure at which the tube meets the braid [MPa].

    Returns
    -------
    never : tuple of str
        Sets that must not be fitted together: on one curve their effects are the same.
    doubts : tuple of str
        Parameters that the data hardly tell.
    """
    never, doubts = [], []
    if "braid_angle" in free and not data.has_load:
        reason = "needs rows at a second load, or forces of the blocked muscle"
        if "dead_length" in free:
            never.append(f"braid_angle and dead_length do the same to one curve: this {reason}")
        else:
            doubts.append(f"braid_angle {reason}: other errors of length hide in it")
    if "friction_length" in free and not data.has_both_directions:
        reason = "needs rows of inflation and of deflation"
        if "dead_length" in free:
            never.append(f"friction_length and dead_length do the same to one curve: this {reason}")
        else:
            doubts.append(f"friction_length {reason}: other losses hide in it")
    if "gap" in free:
        span = GAP_SPAN * contact_pressure
        low = len(np.unique(data.pressure[(data.pressure > 0.0) & (data.pressure < span)]))
        if low < GAP_PRESSURES:
            doubts.append(
                f"gap has {low} pressure(s) above 0 and below {1e3 * span:.0f} kPa, {GAP_SPAN:g} "
                f"times the contact pressure: it needs {GAP_PRESSURES}"
            )
    return tuple(never), tuple(doubts)


def judge_fit(
    free: Sequence[str], correlations: NDArray[np.float64], condition: float
) -> list[str]:
    """Return warnings on what a fit could not tell, after it.

    Parameters
    ----------
    free : sequence of str
    correlations : ndarray, shape (k, k)
        Of the estimates.
    condition : float
        Of the Jacobian with columns of length 1.
    """
    warnings = []
    if condition > CONDITION_LIMIT:
        warnings.append(
            f"the data tell the parameters poorly: condition {condition:.0f} is above "
            f"{CONDITION_LIMIT:.0f}"
        )
    for i, j in combinations(range(len(free)), 2):
        if abs(correlations[i, j]) > CORRELATION_LIMIT:
            warnings.append(
                f"{free[i]} and {free[j]} cannot be told apart: correlation "
                f"{correlations[i, j]:+.3f}"
            )
    return warnings


def judge_repeats(
    data: Measurements, residuals: NDArray[np.float64], *, parameters: int
) -> list[str]:
    """Return a warning if a fit misses the data by more than the data miss each other.

    The F-test of lack of fit at 0.1 %: it needs rows that repeat a state.

    Parameters
    ----------
    data : Measurements
    residuals : ndarray, shape (n,)
        Of the fit [mm].
    parameters : int
        How many parameters were fitted.
    """
    from scipy.stats import f as fisher

    repeats = data.repeat_statistics()
    states, freedom = len(repeats.count), repeats.degrees_of_freedom
    pure = freedom * repeats.pooled_deviation**2
    lack = float(residuals @ residuals) - pure
    if freedom < 1 or states <= parameters or lack <= 0.0:
        return []
    limit = float(fisher.ppf(0.999, states - parameters, freedom))
    if lack / (states - parameters) <= limit * pure / freedom:
        return []
    rest = float(np.sqrt(residuals @ residuals / (len(data) - parameters)))
    return [
        f"the model does not fit: it is off by {rest:.3g} mm, repeats by "
        f"{repeats.pooled_deviation:.3g} mm; the intervals are too sure"
    ]
