"""What is proved about an executed motion of a robot of arcs; `executed` proves it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

__all__ = ["ArcCertificate"]

Floats = NDArray[np.float64]


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
            found = {
                name: math.inf if description[f"{name}_mm"] is None else description[f"{name}_mm"]
                for name in ("clearance", "found")
            }
            values = {name: description[name] for name in _PLAIN}
            place = np.asarray(description["place_mm"], dtype=np.float64)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"not a certificate of arcs: {description!r} ({error})") from None
        return cls(**values, clearance=found["clearance"], found=found["found"], place=place)


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
