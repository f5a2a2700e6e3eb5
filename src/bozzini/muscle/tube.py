"""The tube: a thick-walled cylinder of a linear elastic material (Lamé)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number

__all__ = ["Tube", "TubeState"]


@dataclass(frozen=True)
class TubeState:
    """A tube under load: ``u_r = c1 r + c2 / r`` and ``u_z = c3 z`` (thesis eq. 3.2).

    Attributes
    ----------
    tube : Tube
        The tube.
    c1, c2, c3 : (...) ndarray
        Constants of the displacements; `c2` in mm^2, the others without unit.
    """

    tube: Tube
    c1: NDArray[np.float64]
    c2: NDArray[np.float64]
    c3: NDArray[np.float64]

    def radial_displacement(self, radius: ArrayLike) -> NDArray[np.float64]:
        """Return the outward displacement [mm] of the wall at `radius` [mm]."""
        r = np.asarray(radius, dtype=np.float64)
        return np.asarray(self.c1 * r + self.c2 / r, dtype=np.float64)

    @property
    def elongation(self) -> NDArray[np.float64]:
        """By how much the tube is longer [mm]."""
        return np.asarray(self.c3 * self.tube.length, dtype=np.float64)

    def stresses(
        self, radius: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the radial, hoop and axial stress [MPa] at `radius` [mm], tension positive."""
        r = np.asarray(radius, dtype=np.float64)
        first, second = self.tube.lame_constants
        swell = first * (2.0 * self.c1 + self.c3)
        bend = self.c2 / r**2
        radial = swell + 2.0 * second * (self.c1 - bend)
        hoop = swell + 2.0 * second * (self.c1 + bend)
        axial = swell + 2.0 * second * self.c3 + 0.0 * r
        return np.asarray(radial), np.asarray(hoop), np.asarray(axial)


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A thick-walled elastic tube at rest (thesis 3.3.2).

    Parameters
    ----------
    length : float
        Length [mm].
    inner_radius, outer_radius : float
        Radii of the wall [mm].
    modulus : float
        Young's modulus [MPa].
    poisson_ratio : float
        Poisson's ratio, in [0, 0.499999]: the linear tube needs a finite bulk modulus.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    length: float
    inner_radius: float
    outer_radius: float
    modulus: float
    poisson_ratio: float = 0.499

    def __post_init__(self) -> None:
        check_number("tube length", self.length, low=0.0, low_open=True, unit="mm")
        check_number("tube inner radius", self.inner_radius, low=0.0, low_open=True, unit="mm")
        check_number(
            "tube outer radius", self.outer_radius, low=self.inner_radius, low_open=True, unit="mm"
        )
        check_number("tube modulus", self.modulus, low=0.0, low_open=True, unit="MPa")
        check_number("Poisson's ratio", self.poisson_ratio, low=0.0, high=0.499999)

    @property
    def lame_constants(self) -> tuple[float, float]:
        """Lamé's first constant and the shear modulus [MPa]."""
        ratio = self.poisson_ratio
        first = self.modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
        return first, self.modulus / (2.0 * (1.0 + ratio))

    @property
    def wall_area(self) -> float:
        """Area of the wall's cross-section [mm^2]."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def bore_share(self) -> float:
        """Area of the bore over the area of the wall."""
        return self.inner_radius**2 / (self.outer_radius**2 - self.inner_radius**2)

    def deform(
        self,
        inner_pressure: ArrayLike,
        *,
        outer_pressure: ArrayLike = 0.0,
        end_stress: ArrayLike | None = None,
    ) -> TubeState:
        """Return the tube under pressure.

        The constants are derived here from ``s_rr(inner) = -P_i``, ``s_rr(outer) = -P_o``,
        ``s_zz = end_stress``. The thesis's (3.3) prints ``+P_o`` in ``c1``, which fails these
        conditions; its ``c2`` and ``c3`` agree with ours.

        Parameters
        ----------
        inner_pressure : array_like
            Pressure in the bore [MPa].
        outer_pressure : array_like
            Pressure on the outside [MPa].
        end_stress : array_like, optional
            Axial stress in the wall [MPa], tension positive; None means closed ends under the
            inner pressure.
        """
        first, second = self.lame_constants
        inner = np.asarray(inner_pressure, dtype=np.float64)
        outer = np.asarray(outer_pressure, dtype=np.float64)
        bore = self.bore_share
        across = inner * bore - outer * (bore + 1.0)
        axial = inner * bore if end_stress is None else np.asarray(end_stress, dtype=np.float64)
        bulk = second * (3.0 * first + 2.0 * second)
        c1 = ((first + 2.0 * second) * across - first * axial) / (2.0 * bulk)
        c2 = (inner - outer) * bore * self.outer_radius**2 / (2.0 * second)
        c3 = ((first + second) * axial - first * across) / bulk
        return TubeState(self, np.asarray(c1), np.asarray(c2), np.asarray(c3))
