"""What a planner may ask of a duct."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Duct"]


@runtime_checkable
class Duct(Protocol):
    """Anything with a signed distance: negative inside, millimetres, 1-Lipschitz.

    ``signed_distance`` must never promise more room than there is by more than ``error``.
    """

    @property
    def kind(self) -> str:
        """``"exact"``, ``"bound"`` or ``"sampled"``."""
        ...

    @property
    def error(self) -> float:
        """By how much the distance may promise too much room [mm]; 0 unless sampled."""
        ...

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""
        ...

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) signed distances at points (..., dim) [mm]."""
        ...

    def gradient(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""
        ...
