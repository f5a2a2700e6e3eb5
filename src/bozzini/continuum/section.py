"""A section: a length of elastic backbone with guide discs, and the tendons that end in it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from ._checks import STIFFNESSES, TORSIONS, check_limit, take_items
from .tendon import GRAIN, Tendon

__all__ = ["Section"]

DISCS = 10

POISSON_RATIO = 0.3
"""Of a backbone whose torsional stiffness is not given."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """One section of a continuum robot, straight at rest.

    Parameters
    ----------
    length : float
        Length along the backbone [mm].
    radius : float
        Radius of the body with its discs [mm]; no tendon runs outside it.
    tendons : sequence of Tendon
        The tendons that end in this section; they pass through the sections before it.
    discs : int
        Guide discs, evenly spaced, the last one at the section's end; 10 unless given.
    disc_positions : sequence of float
        Their places from the section's start [mm], for uneven spacing; the last is `length`.
    bending_stiffness : float
        EI of the backbone, in [1e-9, 1e15] [N mm^2]. It does not change what tendon displacements
        do to one section of parallel tendons; sections share a bend by it.
    torsional_stiffness : float
        GJ, in [1e-10, 1e15] [N mm^2]; 0 for that of a round rod with Poisson's ratio 0.3,
        ``EI / 1.3``.
    max_bend : float
        Largest bend angle [rad].
    name : str
        Name for messages, may be empty.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    length: float
    radius: float
    tendons: tuple[Tendon, ...] = ()
    discs: int = 0
    disc_positions: tuple[float, ...] = ()
    bending_stiffness: float = 200.0
    torsional_stiffness: float = 0.0
    max_bend: float = math.inf
    name: str = ""

    def __post_init__(self) -> None:
        length = check_number(
            "section length", self.length, low=0.0, high=1e5, low_open=True, unit="mm"
        )
        radius = check_number(
            "section radius", self.radius, low=0.0, high=1e4, low_open=True, unit="mm"
        )
        low, high = STIFFNESSES
        bending = check_number(
            "section bending_stiffness", self.bending_stiffness, low=low, high=high, unit="N mm^2"
        )
        least, most = TORSIONS
        torsion = check_number(
            "section torsional_stiffness",
            self.torsional_stiffness,
            low=0.0,
            high=most,
            unit="N mm^2",
        )
        # A round rod of Poisson's ratio nu has GJ = EI / (1 + nu).
        torsion = torsion or bending / (1.0 + POISSON_RATIO)
        if torsion < least:
            raise InputError(
                f"section torsional_stiffness is {torsion:g} N mm^2: it must be 0, for that of a "
                f"round rod, or lie in [{least:g}, {most:g}] N mm^2"
            )
        largest = check_limit("section max_bend", self.max_bend, unit="rad")
        if not isinstance(self.name, str):
            raise InputError(f"section name is {self.name!r}: it must be a text")
        places = _check_places(self.disc_positions, length)
        discs = check_integer("section discs", self.discs, low=0, high=10000)
        if places and discs not in (0, len(places)):
            raise InputError(
                f"section discs is {discs} but disc_positions has {len(places)}: leave one out"
            )
        tendons = take_items("section tendons", self.tendons, "a sequence of Tendon")
        for tendon in tendons:
            if not isinstance(tendon, Tendon):
                raise InputError(f"section tendons holds {tendon!r}: each must be a Tendon")
        object.__setattr__(self, "disc_positions", places)
        object.__setattr__(self, "discs", discs or len(places) or DISCS)
        object.__setattr__(self, "tendons", tendons)
        object.__setattr__(self, "name", str(self.name))
        object.__setattr__(self, "length", length)
        object.__setattr__(self, "radius", radius)
        object.__setattr__(self, "bending_stiffness", bending)
        object.__setattr__(self, "torsional_stiffness", torsion)
        object.__setattr__(self, "max_bend", largest)

    @property
    def disc_places(self) -> NDArray[np.float64]:
        """Arc length of the discs from the section's start [mm], shape (discs,)."""
        if self.disc_positions:
            return np.asarray(self.disc_positions)
        return self.length * np.arange(1, self.discs + 1) / self.discs


def _check_places(given: Any, length: float) -> tuple[float, ...]:
    items = take_items("section disc_positions", given, "a sequence of arc lengths in mm")
    places: list[float] = []
    before = 0.0
    for index, item in enumerate(items):
        place = check_number(
            f"section disc_positions[{index}]", item, low=0.0, high=length, unit="mm"
        )
        if place <= before + GRAIN:
            raise InputError(
                f"section disc_positions[{index}] is {place:g} mm: it must lie after {before:g} mm"
            )
        before = place
        places.append(place)
    if places and abs(places[-1] - length) > GRAIN:
        raise InputError(
            f"section disc_positions ends at {places[-1]:g} mm: "
            f"the last disc must stand at the section's end, {length:g} mm"
        )
    return tuple(places)
