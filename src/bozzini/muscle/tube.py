"""The tube: a thick-walled cylinder of a linear elastic material (Lamé)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import broadcast, check_array, check_number, check_range

__all__ = ["Tube", "TubeState"]

STRESS_LIMIT = 1e6
"""Largest legal pressure or stress on a tube [MPa], either way: a limit of the arithmetic."""

THINNEST = 1.0001
"""Smallest legal outer radius over the inner one: the wall's area is the difference of squares."""


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
        """Return the outward displacement [mm] of the wall at `radius` [mm].

        Raises
        ------
        InputError
            If a radius is outside the wall, or the shapes do not go together.
        """
        r, c1, c2, _ = self._place(radius)
        return np.asarray(c1 * r + c2 / r, dtype=np.float64)

    @property
    def elongation(self) -> NDArray[np.float64]:
        """By how much the tube is longer [mm]."""
        return np.asarray(self.c3 * self.tube.length, dtype=np.float64)

    def stresses(
        self, radius: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the radial, hoop and axial stress [MPa] at `radius` [mm], tension positive.

        Raises
        ------
        InputError
            If a radius is outside the wall, or the shapes do not go together.
        """
        r, c1, c2, c3 = self._place(radius)
        first, second = self.tube.lame_constants
        swell = first * (2.0 * c1 + c3)
        bend = c2 / r**2
        radial = swell + 2.0 * second * (c1 - bend)
        hoop = swell + 2.0 * second * (c1 + bend)
        axial = swell + 2.0 * second * c3
        return np.asarray(radial), np.asarray(hoop), np.asarray(axial)

    def _place(self, radius: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """Radii in the wall and the constants, of one shape."""
        radii = check_array("radius", radius)
        low, high = self.tube.inner_radius, self.tube.outer_radius
        check_range("radius", radii, low, high, "mm", slack=1e-9 * high)
        return broadcast(("radius", radii), ("c1", self.c1), ("c2", self.c2), ("c3", self.c3))


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A thick-walled elastic tube at rest (thesis 3.3.2).

    Parameters
    ----------
    length : float
        Length, in [1e-6, 1e6] mm.
    inner_radius, outer_radius : float
        Radii of the wall, in [1e-6, 1e6] mm; the outer one is 1.0001 times the inner one or more.
    modulus : float
        Young's modulus, in [1e-12, 1e6] MPa.
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
        inner = check_number("tube inner radius", self.inner_radius, low=1e-6, high=1e6, unit="mm")
        taken = {
            "length": check_number("tube length", self.length, low=1e-6, high=1e6, unit="mm"),
            "inner_radius": inner,
            "outer_radius": check_number(
                "tube outer radius", self.outer_radius, low=THINNEST * inner, high=1e6, unit="mm"
            ),
            "modulus": check_number("tube modulus", self.modulus, low=1e-12, high=1e6, unit="MPa"),
            "poisson_ratio": check_number(
                "Poisson's ratio", self.poisson_ratio, low=0.0, high=0.499999
            ),
        }
        for name, number in taken.items():
            object.__setattr__(self, name, number)

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

        Raises
        ------
        InputError
            If a pressure or stress is not in [-1e6, 1e6] MPa, or the shapes do not go together.
        """
        first, second = self.lame_constants
        bore = self.bore_share
        inner, outer = (
            _take_stress(name, values)
            for name, values in (
                ("inner pressure", inner_pressure),
                ("outer pressure", outer_pressure),
            )
        )
        axial = inner * bore if end_stress is None else _take_stress("end stress", end_stress)
        inner, outer, axial = broadcast(
            ("inner pressure", inner), ("outer pressure", outer), ("end stress", axial)
        )
        across = inner * bore - outer * (bore + 1.0)
        bulk = second * (3.0 * first + 2.0 * second)
        c1 = ((first + 2.0 * second) * across - first * axial) / (2.0 * bulk)
        c2 = (inner - outer) * bore * self.outer_radius**2 / (2.0 * second)
        c3 = ((first + second) * axial - first * across) / bulk
        return TubeState(self, np.asarray(c1), np.asarray(c2), np.asarray(c3))


def _take_stress(name: str, values: ArrayLike) -> NDArray[np.float64]:
    stresses = check_array(name, values)
    check_range(name, stresses, -STRESS_LIMIT, STRESS_LIMIT, "MPa")
    return stresses
