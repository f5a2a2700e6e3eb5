"""The design of a miniature pneumatic muscle: a tube, a braid round it, and their materials."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from ..checks import check_integer, check_number
from ..errors import InputError
from .braid import BRAID_ANGLES, Braid
from .tube import Tube

__all__ = ["Muscle"]

# In an order in which each range needs only fields before it.
_UNITS = {
    "length": "mm",
    "outer_radius": "mm",
    "inner_radius": "mm",
    "braid_angle": "rad",
    "gap": "mm",
    "friction_length": "mm",
    "strand_radius": "mm",
    "end_length": "mm",
    "dead_length": "mm",
    "modulus": "MPa",
    "poisson_ratio": "",
    "strand_modulus": "MPa",
    "mooney_ratio": "",
}


@dataclass(frozen=True, kw_only=True)
class Muscle:
    """A miniature pneumatic muscle at rest (thesis 3.2), in mm, MPa and rad.

    The defaults are those of the captions of the thesis's Figs 3.11-3.16.

    Parameters
    ----------
    length : float
        Free length between the fittings, in [0.001, 10000] mm.
    outer_radius, inner_radius : float
        Radii of the tube [mm]; the inner one is 0.05 to 0.99 of the outer one.
    braid_angle : float
        Angle between strands and axis at rest [rad], 5 to 54 degrees.
    gap : float
        Gap between tube and braid [mm], at most half the inner radius.
    strands : int
        Strands of the braid, both ways together.
    strand_radius : float
        Radius of a strand [mm], so that all strands fit round the braid; the captions have 0.04,
        the thesis's section 3.2 about 0.05.
    end_length : float
        Length of each conical end, ``phi`` [mm]; used by `ThesisMuscle` only.
    dead_length : float
        Length that does not contract, both ends together [mm]; used by `EnergyMuscle` only.
    modulus : float
        Young's modulus of the tube, in [1e-9, 1000] MPa.
    poisson_ratio : float
        Poisson's ratio of the tube; `EnergyMuscle` takes the wall as incompressible instead.
    strand_modulus : float
        Young's modulus of a strand [MPa].
    mooney_ratio : float
        ``C01 / (C10 + C01)`` of the wall's strain energy, in [0, 0.5]; 0 is neo-Hookean.
    friction_length : float
        Friction at the crossings, coefficient times arm [mm]; at most a quarter of the braid's
        radius and half the inner radius; 0 for none.

    Raises
    ------
    InputError
        If a value is outside its `legal_range`.
    """

    length: float
    outer_radius: float
    inner_radius: float = 0.25
    braid_angle: float = math.radians(36.0)
    gap: float = 0.04
    strands: int = 30
    strand_radius: float = 0.04
    end_length: float = 5.0
    dead_length: float = 0.0
    modulus: float = 0.35
    poisson_ratio: float = 0.499
    strand_modulus: float = 3000.0
    mooney_ratio: float = 0.0
    friction_length: float = 0.0

    def __post_init__(self) -> None:
        strands = check_integer("muscle strands", self.strands, low=2, high=10000)
        object.__setattr__(self, "strands", strands)
        for name, unit in _UNITS.items():
            words = f"muscle {name.replace('_', ' ')}"
            low, high = self.legal_range(name)
            number = check_number(words, getattr(self, name), low=low, high=high, unit=unit)
            object.__setattr__(self, name, number)

    def legal_range(self, name: str) -> tuple[float, float]:
        """Return the smallest and largest legal value of a field, the others being as they are.

        Raises
        ------
        InputError
            If `name` is not a field that takes any number.
        """
        if name not in _UNITS:
            raise InputError(f"'{name}' has no legal range: choose one of {list(_UNITS)}")
        match name:
            case "length":
                return 1e-3, 1e4
            case "outer_radius":
                return 1e-3, 1e3
            case "inner_radius":
                return 0.05 * self.outer_radius, 0.99 * self.outer_radius
            case "braid_angle":
                return BRAID_ANGLES
            case "gap":  # across a wider one the tube would balloon before it meets the braid
                return 0.0, 0.5 * self.inner_radius
            case "friction_length":  # with more, a thick tube has several contractions at one load
                return 0.0, min(0.25 * self.braid_radius, 0.5 * self.inner_radius)
            case "strand_radius":  # strands of one family lie 4 pi r cos(angle) / strands apart
                room = 2.0 * math.pi * self.braid_radius * math.cos(self.braid_angle)
                return 1e-6, room / self.strands
            case "end_length":
                return 0.0, 0.499 * self.length
            case "dead_length":
                return 0.0, 0.99 * self.length
            case "modulus":
                return 1e-9, 1e3
            case "poisson_ratio":
                return 0.0, 0.499999
            case "strand_modulus":
                return 1e-9, 1e6
        return 0.0, 0.5  # of mooney_ratio: above, an inflated free tube gets shorter

    @property
    def braid_radius(self) -> float:
        """Radius of the braid at rest [mm]."""
        return self.outer_radius + self.gap

    @property
    def active_length(self) -> float:
        """Length that contracts [mm]."""
        return self.length - self.dead_length

    @property
    def braid(self) -> Braid:
        """The braid at rest, over the whole length."""
        return Braid(length=self.length, radius=self.braid_radius, angle=self.braid_angle)

    @property
    def tube(self) -> Tube:
        """The tube at rest, over the whole length."""
        return Tube(
            length=self.length,
            inner_radius=self.inner_radius,
            outer_radius=self.outer_radius,
            modulus=self.modulus,
            poisson_ratio=self.poisson_ratio,
        )

    def replace(self, **changes: Any) -> Muscle:
        """Return this muscle with some fields changed.

        Raises
        ------
        InputError
            If a field is not one of a muscle's, or a value is outside its legal range.
        """
        names = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in names:
                raise InputError(f"a muscle has no field '{name}': its fields are {names}")
        return dataclasses.replace(self, **changes)
