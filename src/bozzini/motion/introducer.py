"""The introducer: the straight tube through which the scope enters the lumen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import Centreline
from ..duct.field import SampledField

__all__ = ["Introducer"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Introducer:
    """A straight round tube that ends in the lumen at the entry.

    Its free space is everything within `bore` of the ray from `entry` along `outward`; the round
    end fits into the lumen, because `bore` is at most the inscribed radius at the entry.

    Parameters
    ----------
    entry : (3,) float
        Where it ends, world frame [mm].
    outward : (3,) float
        Unit vector out of the tract.
    bore : float
        Inner radius [mm].
    """

    entry: NDArray[np.float64]
    outward: NDArray[np.float64]
    bore: float

    @classmethod
    def at_start(cls, line: Centreline, *, bore: float, along: float) -> Introducer:
        """Put an introducer before a centreline, in line with its first `along` mm."""
        stop = max(2, int(np.searchsorted(line.arc_length, along)) + 1)
        chord = line.points[0] - line.points[:stop].mean(axis=0)
        return cls(entry=line.points[0], outward=chord / np.linalg.norm(chord), bore=bore)

    def place_chain(self, joints: int, length: float) -> NDArray[np.float64]:
        """Return the straight chain (joints, 3) whose head stands at the entry."""
        return self.entry + np.arange(joints)[:, None] * length * self.outward

    def pack(self, field: SampledField) -> NDArray[np.float64]:
        """Return entry, direction and bore in the field's own frame, for the kernels: (7,)."""
        outward = self.outward @ field.rotation
        return np.concatenate([field.to_grid(self.entry), outward, [self.bore]])

    def describe(self) -> dict[str, Any]:
        """Return the introducer as JSON-able values."""
        return {
            "entry_mm": [float(v) for v in self.entry],
            "outward": [float(v) for v in self.outward],
            "bore_mm": float(self.bore),
        }
