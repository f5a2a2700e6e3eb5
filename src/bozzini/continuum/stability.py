"""Stability of a rod: the second variation of a rod's energy, under what holds its tendons.

The form is that of a chain of steps, each by the rotations of its two ends. Under tensions that are
held, an equilibrium is stable if it is positive. Where lengths are held, or tendons stretch, let
``A`` be the form, ``B`` the lengths' gradients and ``C`` the tendons' compliances: by the inertia
of the bordered matrix there are as many negative directions as ``A`` has, less those of ``C + B
A^-1 B^T``, the flexibility of lengths under tension. That is so for rigid tendons, ``C = 0``, too.

A cable of the commanded length without tension holds what would lengthen it, and goes slack under
what shortens it. The energy falls with such cables where it does with all of them held, and where
one of the directions in which it falls without them lengthens none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from .kernels.stability import ROUND_OFF, count_below, reduce_form

Form = tuple[Floats, Floats, Floats, Floats]
Held = tuple[Floats, NDArray[np.bool_], NDArray[np.bool_]]
"""Compliances (k,) of the tendons, which hold a length (k,), and which of these are idle cables."""

MOST_PROJECTIONS = 300
"""Steps of the search for a direction that lengthens no idle cable."""

SHORTENS = 1e-3
"""Size of what is left, of 1 for each cable, above which there is such a direction."""

MOST_HALVINGS = 16
"""Steps of the search for the least eigenvalue."""

LOWEST = 1e6
"""Size of the eigenvalues below which the search ends."""


def count_negative(form: Form, tendons: Held, shift: float) -> int:
    """Return in how many directions the energy falls, less `shift` times the backbone's own.

    ``form`` is that of `fill_form`. One direction stands for all that lengthen no idle cable, which
    is one without tension.
    """
    compliances, taut, idle = tendons
    held = np.flatnonzero(taut)
    flexibility = np.empty((held.size, held.size))
    negative = int(reduce_form(form, held, shift, flexibility))
    if negative == 0 or held.size == 0:
        return negative
    compliance = np.diag(compliances[held])
    flexibility += compliance
    falling = negative - int(count_below(flexibility.copy()))
    slack, tight = idle[held], ~idle[held]
    if falling > 0 or not slack.any():
        return falling
    stiff = np.ascontiguousarray(flexibility[np.ix_(tight, tight)])
    if negative == count_below(stiff.copy()):
        return falling
    slack_flexibility = (flexibility - compliance)[np.ix_(slack, slack)]
    if tight.any():
        cross = flexibility[np.ix_(tight, slack)]
        slack_flexibility -= cross.T @ np.linalg.solve(stiff, cross)
    return 1 if may_slacken(slack_flexibility) else 0


def may_slacken(flexibility: Floats) -> bool:
    """Return whether a direction in which the energy falls lengthens no idle cable.

    ``flexibility`` (k, k) is that of their lengths under tension. By projections in turn on its
    negative eigenvectors and on lengths that all shorten, which end at 0 if only that is in both.
    """
    eigenvalues, negative_modes = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    negative_modes = negative_modes[:, eigenvalues < -ROUND_OFF * np.abs(eigenvalues).max()]
    change = np.ones(len(flexibility))
    for _ in range(MOST_PROJECTIONS):
        change = np.maximum(negative_modes @ (negative_modes.T @ change), 0.0)
    return bool((change**2).sum() > SHORTENS**2 * len(change))


def measure_stability(form: Form, tendons: Held) -> float:
    """Return the least eigenvalue of the second variation, by the backbone's elastic energy alone.

    It is 1 for a rod at rest, and falls to 0 where it buckles.
    """
    high, low = 1.0 - 1e-9, 0.0
    if count_negative(form, tendons, high) == 0:
        return 1.0
    while count_negative(form, tendons, low) > 0:
        high, low = low, 2.0 * low - 1.0
        if low < -LOWEST:
            return low
    for _ in range(MOST_HALVINGS):
        middle = 0.5 * (low + high)
        if count_negative(form, tendons, middle) > 0:
            high = middle
        else:
            low = middle
    return low
