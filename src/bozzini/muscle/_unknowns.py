"""The unknowns of a fit: fields of a muscle and constants of a model, their bounds and scales."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from .braid import BRAID_ANGLES

if TYPE_CHECKING:
    from .design import Muscle
    from .models.card import Parameter

__all__ = ["PARAMETER_UNITS", "choose_bounds", "choose_scale"]

PARAMETER_UNITS = {
    "modulus": "MPa",
    "dead_length": "mm",
    "gap": "mm",
    "braid_angle": "rad",
    "friction_length": "mm",
    "mooney_ratio": "",
    "outer_radius": "mm",
    "inner_radius": "mm",
    "end_length": "mm",
    "poisson_ratio": "",
    "strand_radius": "mm",
    "strand_modulus": "MPa",
}
"""The parameters of a `Muscle` that may be fitted, and their units.

The free length is not one of them: a table of lengths becomes contractions by it, so it has to be
measured.
"""

_SCALES = {
    "modulus": 0.1,
    "dead_length": 2.0,
    "gap": 0.02,
    "braid_angle": 0.03,
    "friction_length": 0.02,
    "mooney_ratio": 0.3,
    "poisson_ratio": 0.01,
}


def choose_scale(name: str, start: float, *, own: bool) -> float:
    """Return how much of an unknown matters.

    Parameters
    ----------
    name : str
    start : float
        Where its search starts.
    own : bool
        Whether it is a constant of the model, not a field of the muscle.
    """
    scale = 0.1 * abs(start) or 0.1
    return scale if own else _SCALES.get(name, scale)


def choose_bounds(
    free: Sequence[str],
    muscle: Muscle,
    bounds: Mapping[str, tuple[float, float]],
    own: Mapping[str, Parameter] | None = None,
) -> NDArray[np.float64]:
    """Return the bounds of the free parameters, shape (k, 2): those given, or wide ones.

    Parameters
    ----------
    free : sequence of str
    muscle : Muscle
    bounds : mapping
        Those given.
    own : mapping of str to Parameter, optional
        The constants of the model, which have bounds of their own.

    Raises
    ------
    InputError
        If bounds are given for a parameter that is not free, are no pair, lie outside what the
        muscle may have, or low is not below high.
    """
    radius = muscle.outer_radius
    wide = {
        "modulus": (0.01, 20.0),
        "dead_length": (0.0, 0.8 * muscle.length),
        "gap": (0.0, 0.5 * radius),
        "braid_angle": (math.radians(15.0), BRAID_ANGLES[1]),
        "friction_length": (0.0, 0.25 * radius),
        "mooney_ratio": (0.0, 1.0),
        "inner_radius": (0.05 * radius, 0.95 * radius),
        "outer_radius": (1.05 * muscle.inner_radius, 3.0 * radius),
        "end_length": (0.0, 0.4 * muscle.length),
        "poisson_ratio": (0.3, 0.4999),
    }
    if not isinstance(bounds, Mapping):
        raise InputError(
            f"bounds must be a mapping from names to pairs: it is a {type(bounds).__name__}"
        )
    for name in bounds:
        if name not in free:
            raise InputError(f"bounds are given for {name}: the free ones are {', '.join(free)}")
    table = []
    for name in free:
        constant = (own or {}).get(name)
        least, most = muscle.legal_range(name) if constant is None else constant.bounds
        unit = PARAMETER_UNITS[name] if constant is None else constant.unit
        if name in bounds:
            low, high = _take_pair(name, bounds[name], least, most, unit)
        elif constant is not None:
            low, high = constant.bounds
        else:
            value = float(getattr(muscle, name))
            # Inside the legal range, with room for the steps of numeric differences.
            low, high = wide.get(name, (0.2 * value, 5.0 * value))
            low, high = max(low, least), min(high, most - 1e-4 * (most - least))
        table.append((low, high))
    return np.array(table, dtype=np.float64)


def _take_pair(
    name: str, pair: object, least: float, most: float, unit: str
) -> tuple[float, float]:
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise InputError(f"bounds of {name} is {pair!r:.60}: it must be a pair (low, high)")
    low = check_number(f"lower bound of {name}", pair[0], low=least, high=most, unit=unit)
    high = check_number(
        f"upper bound of {name}", pair[1], low=low, high=most, low_open=True, unit=unit
    )
    return low, high
