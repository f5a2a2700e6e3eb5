"""What moves and where it enters: the scope, and the introducer before the entry."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, check_fields, quantity
from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..results import Shown

SIZE_MIN_MM = 0.1
"""Smallest diameter of a scope, and shortest link: less than any that was made."""

DIAMETER_MAX_MM = 500.0
"""Widest scope: wider than any tract."""

LENGTH_MAX_MM = 10_000.0
"""Longest scope: more than the whole bowel."""


@dataclass(frozen=True, kw_only=True)
class Scope:
    """A flexible scope as a chain of equal rigid links (thesis 5.3.1).

    Parameters
    ----------
    diameter : float
        Outer diameter of the body, in [0.1, 500] mm.
    link_length : float
        Distance between neighbouring joints, in [0.1, 10000] mm.
    length : float, optional
        Length of the whole scope, at least one link [mm]; None means long enough for the path.

    Raises
    ------
    InputError
        If a dimension is outside its range or not a number.
    """

    diameter: float = quantity(
        "length",
        "Outer diameter of the scope.",
        low=SIZE_MIN_MM,
        high=DIAMETER_MAX_MM,
        label="scope diameter",
    )
    link_length: float = quantity(
        "length",
        "Length of a rigid link.",
        low=SIZE_MIN_MM,
        high=LENGTH_MAX_MM,
        label="link length",
    )
    length: float | None = field(
        default=None,
        metadata={
            "quantity": Quantity(
                kind="length",
                help="Length of the scope.",
                low=lambda scope: scope.link_length,
                high=LENGTH_MAX_MM,
                label="scope length",
            ),
            "omitted": True,  # from a plan's file, if there is none
        },
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def radius(self) -> float:
        """Radius of the body [mm]."""
        return 0.5 * self.diameter

    def count_links(self, path_length: float) -> int:
        """Return the number of links; for a path of `path_length` mm if the length is open."""
        length = path_length if self.length is None else self.length
        return max(1, math.ceil(length / self.link_length - 1e-9))


@dataclass(frozen=True, kw_only=True, eq=False)
class Introducer(Shown):
    """A straight round tube that ends in the lumen at the entry.

    Its free space is everything within `bore` of the ray from `entry` along `outward`; the round
    end fits into the lumen, because `bore` is at most the inscribed radius at the entry.

    Parameters
    ----------
    entry : (dim,) float
        The inner end, world frame [mm].
    outward : (dim,) float
        Unit vector out of the tract.
    bore : float
        Inner radius [mm].
    """

    entry: NDArray[np.float64] = field(metadata={"key": "entry_mm"})
    outward: NDArray[np.float64]
    bore: float = quantity("length", "Inner radius.", low=0.0, high=1e6, low_open=True)

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

    def place_chain(self, joints: int, length: float) -> NDArray[np.float64]:
        """Return the straight chain (joints, dim) whose head stands at the entry."""
        return self.entry + np.arange(joints)[:, None] * length * self.outward

    def exempt_bore(self, offered: float, *, radius: float) -> float:
        """Return the bore that is exempt from the wall: what the lumen offers, whatever is stated.

        Parameters
        ----------
        offered : float
            Proved clearance at the entry [mm].
        radius : float
            Of the body, which is in it as a whole [mm].
        """
        return min(self.bore, max(offered, radius))

    def pack(self, duct: Duct) -> NDArray[np.float64]:
        """Return entry, direction and bore in the duct's own frame, for the kernels: (7,)."""
        entry = duct.to_grid(self.entry)
        outward = duct.to_grid(self.entry + self.outward) - entry
        return np.concatenate([entry, outward, [self.bore]])


def measure_bore(duct: Duct, entry: NDArray[np.float64]) -> float:
    """Return the widest bore [mm] that an introducer ending at `entry` may have.

    It is the proved clearance there, whatever the scope: a wider one would end in the wall.
    """
    return max(float(duct.clearance_bound(entry)), 0.0)
