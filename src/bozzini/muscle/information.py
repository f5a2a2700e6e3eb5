"""Information criteria: how much of a better fit is owed to more parameters.

For independent normal errors of one unknown variance, with n rows, k fitted parameters and the
sum of squares S (Burnham, Anderson, Model selection and multimodel inference, 2002, section 2.2
and 6.4)::

    AICc = n ln(S / n) + 2 K + 2 K (K + 1) / (n - K - 1)
    BIC  = n ln(S / n) + K ln n             with K = k + 1, for the variance is fitted too

Only differences between models of the same rows mean something.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number
from ..errors import InputError

__all__ = ["compute_aicc", "compute_bic", "weigh_models"]


def compute_aicc(squares: float, rows: int, parameters: int) -> float:
    """Return Akaike's criterion, corrected for few rows.

    Parameters
    ----------
    squares : float
        Sum of the squared residuals.
    rows : int
        How many residuals, at least `parameters` + 3.
    parameters : int
        How many parameters were fitted, the variance not counted.

    Raises
    ------
    InputError
        If a number is outside its range.
    """
    count = check_integer("number of fitted parameters", parameters, low=0) + 1
    check_integer("number of rows", rows, low=count + 2)
    return (
        _weigh_misfit(squares, rows) + 2.0 * count + 2.0 * count * (count + 1) / (rows - count - 1)
    )


def compute_bic(squares: float, rows: int, parameters: int) -> float:
    """Return the Bayesian (Schwarz's) criterion; the arguments are those of `compute_aicc`.

    Raises
    ------
    InputError
        If a number is outside its range; 1 row is enough.
    """
    count = check_integer("number of fitted parameters", parameters, low=0) + 1
    check_integer("number of rows", rows, low=1)
    return _weigh_misfit(squares, rows) + count * math.log(rows)


def weigh_models(criteria: Sequence[float] | ArrayLike) -> NDArray[np.float64]:
    """Return Akaike's weights, ``exp(-difference / 2)`` made to sum to 1.

    Parameters
    ----------
    criteria : array_like, shape (m,)
        Values of one criterion for models of the same rows.

    Raises
    ------
    InputError
        If there is none.
    """
    values = np.atleast_1d(check_array("criteria", criteria))
    if not values.size:
        raise InputError("there are 0 models to weigh: give 1 or more")
    weights = np.exp(-0.5 * (values - values.min()))
    return np.asarray(weights / weights.sum())


def _weigh_misfit(squares: float, rows: int) -> float:
    number = check_number("sum of squares", squares, low=0.0, low_open=True)
    return rows * math.log(number / rows)
