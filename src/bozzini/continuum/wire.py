"""A round wire or tube as a backbone: its stiffnesses and its weight follow from its section."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_fields, list_quantities, quantity, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .profile import Profile, check_profile, evaluate_profile, smallest_of

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2] (3rd CGPM, 1901)."""

CUBIC_METRE = 1e9
"""A cubic metre [mm^3]."""


@dataclass(frozen=True, kw_only=True)
class Wire(Shown):
    """A round wire, or a tube, of one material.

    With ``A = pi/4 (D^2 - d^2)`` and ``I = pi/64 (D^4 - d^4)`` it has ``EI = E I``,
    ``GJ = 2 G I``, ``EA = E A`` and ``GA = k G A``, where ``G = E / (2 (1 + nu))`` and k is the
    shear coefficient of Cowper (1966) for a hollow circle, ``m = d / D``::

        k = 6 (1 + nu) (1 + m^2)^2 / ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2)

    Parameters
    ----------
    diameter : float or sequence of (arc length, diameter)
        Outer diameter [mm]: one number, or knots from the section's start, linear between.
    modulus : float
        Young's modulus E [MPa].
    poisson_ratio : float
        nu, in (-1, 0.5].
    density : float
        [kg/m^3]; without it the wire has no weight.
    inner_diameter : float
        Of a tube [mm]; 0 for a wire.

    Raises
    ------
    InputError
        If a value is outside its legal range.

    References
    ----------
    Cowper, G. R. (1966). The shear coefficient in Timoshenko's beam theory. Journal of Applied
    Mechanics 33(2), 335-340.
    """

    diameter: Profile | Sequence[Sequence[float]] = quantity(
        "length", "Outer diameter.", low=1e-3, high=1e4
    )
    modulus: float = quantity("pressure", "Young's modulus.", low=1e-6, high=1e7)
    poisson_ratio: float = quantity(
        "dimensionless", "Poisson's ratio.", low=-1.0, high=0.5, low_open=True, default=0.3
    )
    density: float = quantity("density", "Density.", low=0.0, high=1e5, default=0.0)
    inner_diameter: float = quantity("length", "Inner diameter of a tube.", low=0.0, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "wire ", skip=("diameter",))
        known = list_quantities(Wire)["diameter"]
        diameter = check_profile("wire diameter", self.diameter, known)
        object.__setattr__(self, "diameter", diameter)
        least = smallest_of(diameter)
        if not self.inner_diameter < least:
            shown = show_apart(self.inner_diameter, least)
            raise InputError(
                f"wire inner diameter is {shown[0]} mm: it must lie in "
                f"[0, {shown[1]}) mm, inside the wire"
            )

    @property
    def unset(self) -> tuple[str, ...]:
        """Fields that are not written to files: none was given."""
        return tuple(name for name in ("density", "inner_diameter") if not getattr(self, name))

    def stiffness_at(self, places: ArrayLike) -> Floats:
        """Return GA, GA, EA [N], EI, EI, GJ [N mm^2] at arc lengths [mm], shape (..., 6)."""
        outer, inner = self.diameter_at(places), self.inner_diameter
        area = 0.25 * math.pi * (outer**2 - inner**2)
        second = math.pi / 64.0 * (outer**4 - inner**4)
        shear = 0.5 * self.modulus / (1.0 + self.poisson_ratio)
        across, bending = self._shear(outer) * shear * area, self.modulus * second
        along = self.modulus * area
        return np.stack([across, across, along, bending, bending, 2.0 * shear * second], axis=-1)

    def weight_at(self, places: ArrayLike) -> Floats:
        """Return the weight per length [N/mm] at arc lengths [mm], shape (...)."""
        area = 0.25 * math.pi * (self.diameter_at(places) ** 2 - self.inner_diameter**2)
        return np.asarray(self.density / CUBIC_METRE * GRAVITY * area)

    def diameter_at(self, places: ArrayLike) -> Floats:
        """Return the outer diameter [mm] at arc lengths [mm] from the section's start."""
        return evaluate_profile(self.profile, check_array("places", places), "linear")[0]

    @property
    def profile(self) -> Profile:
        """The outer diameter [mm], checked."""
        profile: Profile = self.diameter  # type: ignore[assignment]  # checked when built
        return profile

    def _shear(self, outer: Floats) -> Floats:
        nu, square = self.poisson_ratio, (self.inner_diameter / outer) ** 2
        ring = (1.0 + square) ** 2
        return np.asarray(
            6.0 * (1.0 + nu) * ring / ((7.0 + 6.0 * nu) * ring + (20.0 + 12.0 * nu) * square)
        )
