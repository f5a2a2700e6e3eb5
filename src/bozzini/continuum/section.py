"""A section: a length of elastic backbone with guide discs, and the tendons that end in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
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
        EI of the backbone [N mm^2]. It does not change what tendon displacements do to one
        section of parallel tendons; sections share a bend by it.
    torsional_stiffness : float
        GJ [N mm^2]; 0 for that of a round rod with Poisson's ratio 0.3, ``EI / 1.3``.
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
        check_number("section length", self.length, low=0.0, high=1e5, low_open=True, unit="mm")
        check_number("section radius", self.radius, low=0.0, high=1e4, low_open=True, unit="mm")
        stiffness = check_number(
            "section bending_stiffness",
            self.bending_stiffness,
            low=0.0,
            low_open=True,
            unit="N mm^2",
        )
        torsion = check_number(
            "section torsional_stiffness", self.torsional_stiffness, low=0.0, unit="N mm^2"
        )
        if self.max_bend != math.inf:
            check_number("section max_bend", self.max_bend, low=0.0, low_open=True, unit="rad")
        if not isinstance(self.name, str):
            raise InputError(f"section name is {self.name!r}: it must be a text")
        places = tuple(self.disc_positions)
        _check_places(places, self.length)
        discs = check_integer("section discs", self.discs, low=0, high=10000)
        if places and discs not in (0, len(places)):
            raise InputError(
                f"section discs is {discs} but disc_positions has {len(places)}: leave one out"
            )
        tendons = tuple(self.tendons)
        for tendon in tendons:
            if not isinstance(tendon, Tendon):
                raise InputError(f"section tendons holds {tendon!r}: each must be a Tendon")
        object.__setattr__(self, "disc_positions", places)
        object.__setattr__(self, "discs", discs or len(places) or DISCS)
        object.__setattr__(self, "tendons", tendons)
        # A round rod of Poisson's ratio nu has GJ = EI / (1 + nu).
        torsion = torsion or stiffness / (1.0 + POISSON_RATIO)
        object.__setattr__(self, "torsional_stiffness", torsion)
        for field in ("length", "radius", "bending_stiffness", "max_bend"):
            object.__setattr__(self, field, float(getattr(self, field)))

    @property
    def disc_places(self) -> NDArray[np.float64]:
        """Arc length of the discs from the section's start [mm], shape (discs,)."""
        if self.disc_positions:
            return np.asarray(self.disc_positions)
        return self.length * np.arange(1, self.discs + 1) / self.discs


def _check_places(places: tuple[float, ...], length: float) -> None:
    before = 0.0
    for index, place in enumerate(places):
        check_number(f"section disc_positions[{index}]", place, low=0.0, high=length, unit="mm")
        if place <= before + GRAIN:
            raise InputError(
                f"section disc_positions[{index}] is {place:g} mm: it must lie after {before:g} mm"
            )
        before = place
    if places and abs(places[-1] - length) > GRAIN:
        raise InputError(
            f"section disc_positions ends at {places[-1]:g} mm: "
            f"the last disc must stand at the section's end, {length:g} mm"
        )
