"""The braid: strands that cannot stretch, wound both ways round a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_number, check_range

__all__ = ["BRAID_ANGLES", "LOCKING_ANGLE", "Braid"]

LOCKING_ANGLE = math.atan(math.sqrt(2.0))
"""The angle at which a braid of given strands holds the largest volume [rad]: 54.7356 degrees."""

BRAID_ANGLES = (math.radians(5.0), math.radians(54.0))
"""Legal angles of a braid at rest, measured from its axis [rad]: below locking, so it contracts."""

PRESSURE_LIMIT = 1e4
"""Largest legal pressure in a braid [MPa]: a limit of the arithmetic."""


@dataclass(frozen=True, kw_only=True)
class Braid:
    """An inextensible braid at rest; `length` and `radius` fix its strands (thesis eqs 2.1, 2.2).

    A strand of length ``b`` makes ``N`` turns: ``l = b cos(angle)``,
    ``2 pi r N = b sin(angle)``. Whatever the braid does, ``l**2 + (2 pi r N)**2 = b**2``.

    Parameters
    ----------
    length, radius : float
        Length and radius at rest, in [1e-6, 1e6] mm.
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
        low, high = BRAID_ANGLES
        taken = {
            "length": check_number("braid length", self.length, low=1e-6, high=1e6, unit="mm"),
            "radius": check_number("braid radius", self.radius, low=1e-6, high=1e6, unit="mm"),
            "angle": check_number("braid angle", self.angle, low=low, high=high, unit="rad"),
        }
        for name, number in taken.items():
            object.__setattr__(self, name, number)

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
        angles = check_array("braid angle", angle)
        check_range("braid angle", angles, 0.0, 0.5 * math.pi, "rad")
        return np.asarray(self.strand_length * np.cos(angles), dtype=np.float64)

    def volume_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the volume inside the braid [mm^3] at `length` [mm]; largest at locking.

        Raises
        ------
        InputError
            If the length is not in [0, strand length].
        """
        lengths = self._check(length)
        return np.asarray(math.pi * self.radius_at(lengths) ** 2 * lengths, dtype=np.float64)

    def ideal_force(self, pressure: ArrayLike, length: ArrayLike) -> NDArray[np.float64]:
        """Return Gaylord's force [N]: the pull of a braid round a tube that resists nothing.

        ``F = P b**2 / (4 pi N**2) (3 cos(angle)**2 - 1)``, which is ``-P dV/dl`` (thesis eq. 2.3).

        Parameters
        ----------
        pressure : array_like
            Pressure, in [0, 10000] MPa.
        length : array_like
            Length of the braid [mm]; broadcast with `pressure`.

        Raises
        ------
        InputError
            If a pressure is outside its range, or a length is not in [0, strand length].
        """
        pressures = check_array("pressure", pressure)
        check_range("pressure", pressures, 0.0, PRESSURE_LIMIT, "MPa")
        pressures, lengths = broadcast(
            ("pressure", pressures), ("braid length", self._check(length))
        )
        share = 3.0 * (lengths / self.strand_length) ** 2 - 1.0
        scale = self.strand_length**2 / (4.0 * math.pi * self.turns**2)
        return np.asarray(pressures * scale * share, dtype=np.float64)

    def _check(self, length: ArrayLike) -> NDArray[np.float64]:
        lengths = check_array("braid length", length)
        hint = ", the length of a strand"
        check_range("braid length", lengths, 0.0, self.strand_length, "mm", hint=hint)
        return lengths
