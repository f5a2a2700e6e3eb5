"""What a model asks of a hysteresis operator."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Hysteresis"]


@runtime_checkable
class Hysteresis(Protocol):
    """An operator with memory, from a history of pressures to the pressures that act.

    A model that carries one uses it in `StaticModel.trace_contraction` only; `force`, `contraction`
    and `solve` have no history and leave it alone.
    """

    def apply(self, pressure: NDArray[np.float64], /) -> NDArray[np.float64]:
        """Return the pressures (n,) [MPa] that act, given the pressures (n,) in order of time.

        The operator starts anew at each call: its memory lives inside one history.
        """
        ...
