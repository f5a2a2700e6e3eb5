"""The introducer: the straight tube through which the scope enters the lumen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..errors import InputError

__all__ = ["Introducer", "measure_bore"]


def measure_bore(duct: Duct, entry: NDArray[np.float64]) -> float:
    """Return the widest bore [mm] that an introducer ending at `entry` may have.

    It is the proved clearance there, whatever the scope: a wider one would end in the wall.
    """
    return max(float(duct.clearance_bound(entry)), 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Introducer:
    """A straight round tube that ends in the lumen at the entry.

    Its free space is everything within `bore` of the ray from `entry` along `outward`; the round
    end fits into the lumen, because `bore` is at most the inscribed radius at the entry.

    Parameters
    ----------
    entry : (dim,) float
        Where it ends, world frame [mm].
    outward : (dim,) float
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

    @classmethod
    def at_entry(cls, duct: Duct, line: Centreline, *, along: float) -> Introducer:
        """Put an introducer before a centreline, as wide as is proved that the lumen is there."""
        return cls.at_start(line, bore=measure_bore(duct, line.points[0]), along=along)

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> Introducer:
        """Read an introducer from the JSON-able values that `describe` gives.

        Raises
        ------
        InputError
            If a value is missing or has the wrong form.
        """
        try:
            return cls(
                entry=np.asarray(description["entry_mm"], dtype=np.float64),
                outward=np.asarray(description["outward"], dtype=np.float64),
                bore=float(description["bore_mm"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"not an introducer: {description!r} ({error})") from None

    def place_chain(self, joints: int, length: float) -> NDArray[np.float64]:
        """Return the straight chain (joints, dim) whose head stands at the entry."""
        return self.entry + np.arange(joints)[:, None] * length * self.outward

    def pack(self, duct: Duct) -> NDArray[np.float64]:
        """Return entry, direction and bore in the duct's own frame, for the kernels: (7,)."""
        entry = duct.to_grid(self.entry)
        outward = duct.to_grid(self.entry + self.outward) - entry
        return np.concatenate([entry, outward, [self.bore]])

    def describe(self) -> dict[str, Any]:
        """Return the introducer as JSON-able values."""
        return {
            "entry_mm": [float(v) for v in self.entry],
            "outward": [float(v) for v in self.outward],
            "bore_mm": float(self.bore),
        }
