"""A tendon: where it runs in the robot's cross-sections, and where it ends."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from ..errors import InputError
from ._checks import check_name, check_travel
from ._profile import INTERPOLATIONS, Knots, Profile, evaluate_profile, read_profile

__all__ = ["Tendon"]

Floats = NDArray[np.float64]

GRAIN = 1e-9
"""Length that is round-off [mm]."""


@dataclass(frozen=True, kw_only=True)
class Tendon:
    """A tendon that runs through holes in the guide discs (thesis 5.2; Rucker and Webster 2011).

    Arc length is measured along the backbone from the robot's base, whatever section the tendon
    belongs to. Displacements of a tendon are positive when it is pulled out of the robot.

    Parameters
    ----------
    name : str
        Name, one of a kind in the robot; without ``,`` and ``=``.
    offset : float or sequence of (arc length, offset)
        Distance from the backbone [mm], positive; one number, or knots.
    angle : float or sequence of (arc length, angle)
        Clocking angle from +x about +z of the cross-section [rad]; one number, or knots. Two
        knots one full turn apart make a helix.
    end : float, optional
        Arc length where it ends [mm]; without it, where its section ends.
    pushes : bool
        Whether it is a rod that pushes as well; otherwise it can only pull, and goes slack.
    travel : (float, float)
        Smallest and largest displacement that its drive allows [mm]; ``-inf`` and ``inf`` for no
        limit.
    interpolation : {"linear", "cubic"}
        How knots are joined; cubics are monotone between knots.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    name: str
    offset: Profile | Sequence[Sequence[float]]
    angle: Profile | Sequence[Sequence[float]] = 0.0
    end: float | None = None
    pushes: bool = False
    travel: tuple[float, float] = (-math.inf, math.inf)
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_name("tendon", self.name))
        label = f"tendon '{self.name}'"
        if not isinstance(self.interpolation, str) or self.interpolation not in INTERPOLATIONS:
            raise InputError(
                f"{label} interpolation is {self.interpolation!r}: choose one of {INTERPOLATIONS}"
            )
        if not isinstance(self.pushes, bool):
            raise InputError(f"{label} pushes is {self.pushes!r}: it must be true or false")
        offset = read_profile(f"{label} offset", self.offset, low=0.0, low_open=True, unit="mm")
        angle = read_profile(
            f"{label} angle", self.angle, low=-math.inf, low_open=False, unit="rad"
        )
        object.__setattr__(self, "offset", offset)
        object.__setattr__(self, "angle", angle)
        object.__setattr__(self, "travel", check_travel(label, self.travel))
        if self.end is not None:
            end = check_number(f"{label} end", self.end, low=0.0, low_open=True, unit="mm")
            object.__setattr__(self, "end", end)
            for what, knots in self._knots():
                _check_span(f"{label} {what}", knots, end)

    @classmethod
    def helix(
        cls, name: str, offset: float, *, turns: float, end: float, angle: float = 0.0, **other: Any
    ) -> Tendon:
        """Return a tendon that turns evenly about the backbone, from the base to `end`.

        Parameters
        ----------
        name, offset, angle, end
            As of a `Tendon`; `angle` is that at the base.
        turns : float
            Turns about +z from base to end; negative the other way round.
        **other
            Further fields.

        Raises
        ------
        InputError
            As `Tendon` does.
        """
        check_number(f"tendon '{name}' turns", turns)
        check_number(f"tendon '{name}' angle", angle, unit="rad")
        last = angle + 2.0 * math.pi * turns
        return cls(name=name, offset=offset, angle=((0.0, angle), (end, last)), end=end, **other)

    @property
    def is_parallel(self) -> bool:
        """Whether offset and angle are the same all along."""
        return all(
            isinstance(profile, float) or len({value for _, value in _as_knots(profile)}) == 1
            for profile in (self.offset, self.angle)
        )

    def ending_at(self, end: float) -> Tendon:
        """Return this tendon with its `end`, checked against its knots.

        Raises
        ------
        InputError
            If the knots do not reach from the base to `end`.
        """
        return dataclasses.replace(self, end=end)

    def offset_at(self, arc_length: ArrayLike) -> Floats:
        """Return the distance from the backbone [mm] at arc lengths [mm].

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        return self._evaluate(self.offset, arc_length)[0]

    def angle_at(self, arc_length: ArrayLike) -> Floats:
        """Return the clocking angle [rad] at arc lengths [mm].

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        return self._evaluate(self.angle, arc_length)[0]

    def path(self, arc_length: ArrayLike) -> Floats:
        """Return where the tendon crosses the cross-sections, x and y.

        Parameters
        ----------
        arc_length : array_like, shape (...)
            Arc lengths from the robot's base [mm], in ``[0, end]``.

        Returns
        -------
        (..., 2) ndarray
            Place in the frame of the cross-section [mm].

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        offset, angle = self.offset_at(arc_length), self.angle_at(arc_length)
        return np.stack([offset * np.cos(angle), offset * np.sin(angle)], axis=-1)

    def path_slope(self, arc_length: ArrayLike) -> Floats:
        """Return the derivative of `path` with arc length, shape (..., 2) [1].

        At a corner of the knots it is that of the distal side.

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        offset, taper = self._evaluate(self.offset, arc_length)
        angle, twist = self._evaluate(self.angle, arc_length)
        cosine, sine = np.cos(angle), np.sin(angle)
        return np.stack(
            [taper * cosine - offset * twist * sine, taper * sine + offset * twist * cosine],
            axis=-1,
        )

    def corners(self) -> Floats:
        """Return the arc lengths inside the tendon where its routing is not smooth [mm]."""
        places = sorted({place for _, knots in self._knots() for place, _ in knots})
        last = math.inf if self.end is None else self.end - GRAIN
        return np.asarray([place for place in places if GRAIN < place < last])

    def _knots(self) -> list[tuple[str, Knots]]:
        pairs = (("offset", self.offset), ("angle", self.angle))
        return [(what, _as_knots(given)) for what, given in pairs if not isinstance(given, float)]

    def _evaluate(self, profile: Any, arc_length: ArrayLike) -> tuple[Floats, Floats]:
        places = check_array("arc_length", arc_length)
        end = math.inf if self.end is None else self.end
        if not isinstance(profile, float):
            end = min(end, profile[-1][0])
        inside = (places >= -GRAIN) & (places <= end + GRAIN)
        if not inside.all():
            bad = places.flat[int(np.argmin(inside))]
            raise InputError(
                f"arc length on tendon '{self.name}' is {bad:g} mm: it must lie in [0, {end:g}] mm"
            )
        return evaluate_profile(profile, np.clip(places, 0.0, end), self.interpolation)


def _as_knots(profile: Any) -> Knots:
    # What __post_init__ put there.
    return () if isinstance(profile, float) else tuple(profile)


def _check_span(name: str, knots: Knots, end: float) -> None:
    first, last = knots[0][0], knots[-1][0]
    if first > GRAIN or last < end - GRAIN:
        raise InputError(
            f"{name} has knots from {first:g} to {last:g} mm: they must reach from 0 mm, the "
            f"robot's base, to {end:g} mm, the tendon's end"
        )
