"""Circles: obstacles in the plane (thesis eq. 5.14, made metric), or a duct of discs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ...checks import check_number
from ..base import check_counts, check_radii, check_wall, freeze_array, freeze_places, set_fields
from .common import ShapeUnion, Slices


@dataclass(frozen=True, eq=False)
class Circles(ShapeUnion):
    """The union of discs: what `without` takes away from a planar duct.

    Parameters
    ----------
    centres : (n, 2) float
        Of the discs [mm].
    radii : (n,) float
        Of the discs [mm].
    inflation : float
        The wall is moved outwards by this much [mm].
    wall : str
        What the wall is, in words.
    wall_error : float
        How far the true wall may be from the stated one [mm].

    Raises
    ------
    InputError
        If a radius is not positive.

    Notes
    -----
    ``|x - c| - r`` of the nearest disc: exact outside, and inside a lower bound of the depth,
    exact in one disc. Eq. 5.14's ``|x - c|^2 - r^2`` is an area. The discs need not hang
    together.
    """

    centres: NDArray[np.float64]
    radii: NDArray[np.float64]
    inflation: float = field(default=0.0, kw_only=True)
    wall: str = field(default="union of discs", kw_only=True)
    wall_error: float = field(default=0.0, kw_only=True)

    dim = 2

    def __post_init__(self) -> None:
        centres = freeze_places("centres", self.centres, 2)
        radii = freeze_array("radii", self.radii, ())
        check_counts(len(centres), {"radii": radii})
        check_radii(radii)
        check_wall(self.inflation, self.wall_error)
        set_fields(self, centres=centres, radii=radii)

    @property
    def exact_outside(self) -> bool:
        """Outside it is the distance, before inflation."""
        return True

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the box around the discs [mm]."""
        reach = (self.radii + self.inflation)[:, None]
        return np.stack([(self.centres - reach).min(axis=0), (self.centres + reach).max(axis=0)])

    def guard_links(self, length: float, *, radius: float = 0.0) -> Circles:
        """Return discs so much larger that no link between joints outside them cuts the old ones.

        A joint outside each disc does not keep a link outside: a chord with both ends at least
        ``sqrt((r + radius)^2 + length^2 / 4)`` from the centre stays ``r + radius`` away.

        Parameters
        ----------
        length : float
            Of a link [mm].
        radius : float
            Of its body [mm].
        """
        check_number("length", length, low=0.0, unit="mm")
        check_number("radius", radius, low=0.0, unit="mm")
        grown = [math.hypot(float(r) + radius, 0.5 * length) for r in self.radii]
        return replace(self, radii=np.array(grown))

    def _slice(self) -> Slices:
        from ..kernels.family import CIRCLE

        numbers = np.concatenate([self.centres, self.radii[:, None]], axis=1)
        flat = np.zeros((len(self.radii), 1))
        balls = np.concatenate([self.centres, flat, self.radii[:, None]], axis=1)
        return Slices(CIRCLE, list(numbers), balls)
