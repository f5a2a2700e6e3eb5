"""The scope: a chain of rigid links with a round body."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..checks import check_number

__all__ = ["Scope"]


SIZE_MIN = 0.1
"""Smallest diameter of a scope, and shortest link [mm]: less than any that was made."""

DIAMETER_MAX = 500.0
"""Widest scope [mm]: wider than any tract."""

LENGTH_MAX = 10_000.0
"""Longest scope [mm]: more than the whole bowel."""


@dataclass(frozen=True, kw_only=True)
class Scope:
    """A flexible scope as a chain of equal rigid links (thesis 5.3.1).

    Parameters
    ----------
    diameter : float
        Outer diameter of the body [mm].
    link_length : float
        Distance between neighbouring joints [mm].
    length : float, optional
        Length of the whole scope [mm]; None means long enough for the path at hand.

    Raises
    ------
    InputError
        If a dimension is below 0.1 mm or not a number, or the scope is shorter than one link.
    """

    diameter: float
    link_length: float
    length: float | None = None

    def __post_init__(self) -> None:
        check_number("scope diameter", self.diameter, low=SIZE_MIN, high=DIAMETER_MAX, unit="mm")
        check_number("link length", self.link_length, low=SIZE_MIN, high=LENGTH_MAX, unit="mm")
        if self.length is not None:
            check_number(
                "scope length", self.length, low=self.link_length, high=LENGTH_MAX, unit="mm"
            )

    @property
    def radius(self) -> float:
        """Radius of the body [mm]."""
        return 0.5 * self.diameter

    def count_links(self, path_length: float) -> int:
        """Return the number of links; for a path of `path_length` mm if the length is open."""
        length = path_length if self.length is None else self.length
        return max(1, math.ceil(length / self.link_length - 1e-9))
