"""What a planner may ask of a duct."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError

__all__ = ["Duct", "check_duct", "count_dimensions"]


@runtime_checkable
class Duct(Protocol):
    """Anything with a signed distance: negative inside, in millimetres.

    It changes by at most 1 mm per mm (1-Lipschitz), the interpolant of a sampled duct by at most
    sqrt(3). ``signed_distance`` must never promise more room than there is by more than
    ``error``, and ``clearance_bound`` never by anything, but where `error` is an estimate itself
    (`BetweenCurves` without `curvature`). A duct is 3-D or planar; ``bounds`` says which.

    A duct whose distances outside, before inflation, are exact though `kind` is "bound" says so by
    a property ``exact_outside``: its samples may then be inflated.
    """

    @property
    def kind(self) -> str:
        """``"exact"``, ``"bound"`` (never more room than there is) or ``"sampled"``."""
        ...

    @property
    def error(self) -> float:
        """By how much the distance may promise too much room [mm]; 0 unless sampled."""
        ...

    @property
    def wall(self) -> str:
        """What the wall is, in words."""
        ...

    @property
    def wall_error(self) -> float | None:
        """How far the true wall may be from the stated one [mm]; None where it is not known."""
        ...

    @property
    def inflation(self) -> float:
        """By how much the wall was moved outwards [mm]."""
        ...

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, dim) corners of a box that holds the duct [mm]."""
        ...

    def signed_distance(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return (...) signed distances at points (..., dim) [mm]."""
        ...

    def gradient(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return the (..., dim) gradient of the signed distance."""
        ...

    def clearance_bound(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Return (...) rigorous lower bounds of the distance to the wall [mm]."""
        ...

    def pack(self) -> Any:
        """Return the duct as a named tuple for compiled kernels (`duct._clearance_kernels`)."""
        ...

    def to_grid(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the kernels' frame (..., 3) [mm], isometrically."""
        ...

    def to_world(self, points: ArrayLike, /) -> NDArray[np.float64]:
        """Turn points (..., 3) of the kernels' frame into world points (..., dim) [mm]."""
        ...


def check_duct(name: str, duct: object) -> None:
    """Raise `InputError` unless `duct` answers what a planner asks most."""
    asked = ("signed_distance", "clearance_bound")
    if not all(callable(getattr(duct, each, None)) for each in asked):
        raise InputError(f"{name} is a {type(duct).__name__}: it must be a duct")


def count_dimensions(duct: Duct) -> int:
    """Return 3, or 2 for a planar duct."""
    return int(duct.bounds.shape[1])
