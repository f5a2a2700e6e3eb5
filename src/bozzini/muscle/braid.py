"""The braid: strands that cannot stretch, wound both ways round a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ..errors import InputError

__all__ = ["BRAID_ANGLES", "LOCKING_ANGLE", "Braid"]

LOCKING_ANGLE = math.atan(math.sqrt(2.0))
"""The angle at which a braid of given strands holds the largest volume [rad]: 54.7356 degrees."""

BRAID_ANGLES = (math.radians(5.0), math.radians(54.0))
"""Legal angles of a braid at rest, measured from its axis [rad]: below locking, so it contracts."""


@dataclass(frozen=True, kw_only=True)
class Braid:
    """An inextensible braid at rest; `length` and `radius` fix its strands (thesis eqs 2.1, 2.2).

    A strand of length ``b`` makes ``N`` turns: ``l = b cos(angle)``,
    ``2 pi r N = b sin(angle)``. Whatever the braid does, ``l**2 + (2 pi r N)**2 = b**2``.

    Parameters
    ----------
    length : float
        Length at rest [mm].
    radius : float
        Radius at rest [mm].
    angle : float
        Angle between strands and axis at rest [rad], within `BRAID_ANGLES`.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    length: float
    radius: float
    angle: float

    def __post_init__(self) -> None:
        check_number("braid length", self.length, low=0.0, low_open=True, unit="mm")
        check_number("braid radius", self.radius, low=0.0, low_open=True, unit="mm")
        low, high = BRAID_ANGLES
        check_number("braid angle", self.angle, low=low, high=high, unit="rad")

    @property
    def strand_length(self) -> float:
        """Length of one strand [mm]; the braid is never longer."""
        return self.length / math.cos(self.angle)

    @property
    def turns(self) -> float:
        """Turns of one strand round the axis."""
        return self.strand_length * math.sin(self.angle) / (2.0 * math.pi * self.radius)

    @property
    def locking_length(self) -> float:
        """Length at the locking angle [mm]: pressure alone shortens the braid no further."""
        return self.strand_length / math.sqrt(3.0)

    @property
    def locking_contraction(self) -> float:
        """How much shorter than at rest the locked braid is [mm]."""
        return self.length - self.locking_length

    def angle_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the angle [rad] of the braid at `length` [mm].

        Raises
        ------
        InputError
            If the length is not in [0, strand length].
        """
        return np.asarray(np.arccos(self._check(length) / self.strand_length), dtype=np.float64)

    def radius_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the radius [mm] of the braid at `length` [mm].

        Raises
        ------
        InputError
            If the length is not in [0, strand length].
        """
        across = np.sqrt(self.strand_length**2 - self._check(length) ** 2)
        return np.asarray(across / (2.0 * math.pi * self.turns), dtype=np.float64)

    def length_at(self, angle: ArrayLike) -> NDArray[np.float64]:
        """Return the length [mm] of the braid at `angle` [rad], which must be in [0, pi/2].

        Raises
        ------
        InputError
            If an angle is outside that range.
        """
        angles = np.asarray(angle, dtype=np.float64)
        if not np.all((angles >= 0.0) & (angles <= 0.5 * math.pi)):
            bad = angles[~((angles >= 0.0) & (angles <= 0.5 * math.pi))].flat[0]
            raise InputError(f"braid angle is {bad:g} rad: it must lie in [0, {0.5 * math.pi:g}]")
        return np.asarray(self.strand_length * np.cos(angles), dtype=np.float64)

    def volume_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the volume inside the braid [mm^3] at `length` [mm]; largest at locking."""
        lengths = self._check(length)
        return np.asarray(math.pi * self.radius_at(lengths) ** 2 * lengths, dtype=np.float64)

    def ideal_force(self, pressure: ArrayLike, length: ArrayLike) -> NDArray[np.float64]:
        """Return Gaylord's force [N]: the pull of a braid round a tube that resists nothing.

        ``F = P b**2 / (4 pi N**2) (3 cos(angle)**2 - 1)``, which is ``-P dV/dl`` (thesis eq. 2.3).

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa].
        length : array_like
            Length of the braid [mm]; broadcast with `pressure`.

        Raises
        ------
        InputError
            If a length is not in [0, strand length].
        """
        share = 3.0 * (self._check(length) / self.strand_length) ** 2 - 1.0
        scale = self.strand_length**2 / (4.0 * math.pi * self.turns**2)
        return np.asarray(np.asarray(pressure, dtype=np.float64) * scale * share, dtype=np.float64)

    def _check(self, length: ArrayLike) -> NDArray[np.float64]:
        lengths = np.asarray(length, dtype=np.float64)
        legal = (lengths >= 0.0) & (lengths <= self.strand_length)
        if not np.all(legal):
            bad = lengths[~legal].flat[0]
            raise InputError(
                f"braid length is {bad:g} mm: it must lie in [0, {self.strand_length:g}] mm, "
                "the length of a strand"
            )
        return lengths
