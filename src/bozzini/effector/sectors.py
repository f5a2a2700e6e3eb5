"""Sectors of the lateral plane: between one muscle and the next, by angle (thesis 4.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .design import EffectorDesign

__all__ = ["HALF_TURN", "Sectors", "find_sectors"]

HALF_TURN = math.pi - 1e-9
"""Gap from which two muscles no longer cover the directions between them [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sectors:
    """The sectors between neighbouring muscles, in the order of their angles.

    Attributes
    ----------
    order : (m,) int
        Indices of the muscles in the design, by angle in [0, 2 pi).
    angles : (m,) float
        Angles in that order [rad].
    gaps : (m,) float
        Angle from muscle ``order[k]`` to the next, the last to the first [rad]; they add up to
        2 pi.
    covered : (m,) bool
        Whether the two muscles reach the directions between them: the gap is less than half a turn.
    """

    order: NDArray[np.int64]
    angles: NDArray[np.float64]
    gaps: NDArray[np.float64]
    covered: NDArray[np.bool_]
    cosines: NDArray[np.float64]
    sines: NDArray[np.float64]

    @property
    def covers_all(self) -> bool:
        """Whether every direction lies between two muscles less than half a turn apart."""
        return bool(self.covered.all())

    def describe_gaps(self, names: tuple[str, ...]) -> str:
        """Return the gaps that are not covered as text, such as ``from G to B (200 deg)``."""
        count = self.order.size
        return ", ".join(
            f"from {names[self.order[k]]} to {names[self.order[(k + 1) % count]]} "
            f"({math.degrees(self.gaps[k]):g} deg)"
            for k in np.flatnonzero(~self.covered)
        )


def find_sectors(design: EffectorDesign) -> Sectors:
    """Return the sectors between the muscles of a design."""
    angles = np.mod(np.asarray(design.angles, dtype=np.float64), 2.0 * math.pi)
    order = np.argsort(angles, kind="stable")
    angles = angles[order]
    gaps = np.diff(angles, append=angles[0] + 2.0 * math.pi)
    return Sectors(
        order=order,
        angles=angles,
        gaps=gaps,
        covered=gaps < HALF_TURN,
        cosines=np.cos(angles),
        sines=np.sin(angles),
    )
