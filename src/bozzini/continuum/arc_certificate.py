"""What is proved about an executed motion of a robot of arcs; `executed` proves it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_integer, check_number, check_points
from ..errors import InputError

__all__ = ["ArcCertificate"]

Floats = NDArray[np.float64]

ROUND_OFF = 1e-9
"""Clearance that is round-off [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArcCertificate:
    """What is proved about an executed motion.

    Parameters
    ----------
    clearance : float
        No point of the body's surface ever comes nearer to the wall than this [mm], steps and
        all times between included; negative: nothing is proved but that it goes through by no
        more than this. Infinite if the robot never leaves the introducer.
    found : float
        The smallest lower bound met at a point of the body's surface [mm].
    step : float
        When that was, a fraction of a step.
    section : int
        On which section that was, 0 the first.
    arc_length : float
        Where on the robot, middle of the chord, from its base [mm].
    place : (3,) float
        Where, world frame [mm].
    deviation : float
        How far the chain that was certified is off the body at most [mm]; it is taken off.
    resolved : bool
        Whether the search ended within its tolerance.
    chords, instants : int
        Size of the chain: links, and times.
    evaluations : int
        How often the field was asked.
    wall : str
        The wall that the bound is for.

    Raises
    ------
    InputError
        If a value is no number or out of range, or the bound is larger than the value found.
    """

    clearance: float
    found: float
    step: float
    section: int
    arc_length: float
    place: Floats
    deviation: float
    resolved: bool
    chords: int
    instants: int
    evaluations: int
    wall: str

    def __post_init__(self) -> None:
        for name in ("clearance", "found"):
            bound = check_array(f"certificate {name}", getattr(self, name))
            if bound.ndim or np.isnan(bound):
                raise InputError(f"certificate {name} is {bound}: it must be a number")
            object.__setattr__(self, name, float(bound))
        if self.clearance > self.found + ROUND_OFF:
            raise InputError(
                f"certificate clearance is {self.clearance:g} mm: it cannot be more than the "
                f"smallest value found, {self.found:g} mm"
            )
        for name in ("step", "arc_length", "deviation"):
            value = check_number(f"certificate {name}", getattr(self, name), low=0.0)
            object.__setattr__(self, name, value)
        for name in ("section", "chords", "instants", "evaluations"):
            whole = check_integer(f"certificate {name}", getattr(self, name), low=0)
            object.__setattr__(self, name, whole)
        place = check_points("certificate place", check_array("certificate place", self.place))
        if place.shape != (3,):
            raise InputError(f"certificate place has shape {place.shape}: it must be (3,)")
        object.__setattr__(self, "place", place)
        if not isinstance(self.resolved, (bool, np.bool_)):
            raise InputError(f"certificate resolved is {self.resolved!r}: it must be true or false")
        object.__setattr__(self, "resolved", bool(self.resolved))
        if not isinstance(self.wall, str):
            raise InputError(f"certificate wall is {self.wall!r}: it must be a text")

    @property
    def certified(self) -> bool:
        """Whether it is proved that the body, as far as it leaves the introducer, is clear."""
        return 0.0 <= self.clearance < math.inf

    def describe(self) -> dict[str, Any]:
        """Return the certificate as JSON-able values; infinite numbers are None."""
        values = {name: getattr(self, name) for name in _PLAIN}
        for name in ("clearance", "found"):
            values[f"{name}_mm"] = _finite(getattr(self, name))
        values["place_mm"] = [float(value) for value in self.place]
        return values

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> ArcCertificate:
        """Read a certificate from what `describe` gives.

        Raises
        ------
        InputError
            If a value is missing or has the wrong form.
        """
        try:
            values = {name: description[name] for name in _PLAIN}
            for name in ("clearance", "found"):
                given = description[f"{name}_mm"]
                values[name] = math.inf if given is None else given
            values["place"] = description["place_mm"]
        except (KeyError, TypeError) as error:
            raise InputError(f"not a certificate of arcs, it lacks a value: {error}") from None
        return cls(**values)


_PLAIN = (
    "step",
    "section",
    "arc_length",
    "deviation",
    "resolved",
    "chords",
    "instants",
    "evaluations",
    "wall",
)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
