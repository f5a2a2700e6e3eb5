"""A section: a length of elastic backbone with guide discs, and the tendons that end in it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeGuard, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import Quantity, check_array, check_fields, check_word, list_quantities, quantity
from ..errors import InputError
from .checks import Floats, check_items, check_name, check_text, check_travel, take_items

# A quantity along the robot: one number, or knots of arc length and value.

ARC_LENGTH = Quantity(kind="length", help="Arc length from the base.", low=0.0)

ArcLength = Annotated[float, ARC_LENGTH]

Knots = tuple[tuple[ArcLength, float], ...]

Interpolation = Literal["linear", "cubic"]


@dataclass(frozen=True, kw_only=True)
class Helix:
    """A clocking angle that grows evenly from the robot's base to the tendon's end.

    Parameters
    ----------
    start : float
        Angle at the base [rad].
    turns : float
        Turns about +z from base to end; negative the other way round.

    Raises
    ------
    InputError
        If one is not a finite number.
    """

    start: float = quantity("angle", "Angle at the base.", default=0.0)
    turns: float = quantity("angle in turns", "Turns from base to end.")

    def __post_init__(self) -> None:
        check_fields(self, "helix ")

    def knots(self, end: float) -> Knots:
        """Return the same as knots of arc length [mm] and angle [rad]."""
        return ((0.0, self.start), (end, self.start + 2.0 * math.pi * self.turns))


Profile = float | Knots


def check_profile(name: str, given: object, known: Quantity) -> Profile:
    """Return `given` as a float or as checked knots, or raise `InputError`."""
    if not _is_row(given):
        return known.check(name, given)
    knots: list[tuple[float, float]] = []
    for index, pair in enumerate(given):
        if not _is_row(pair) or len(pair) != 2:
            raise InputError(f"{name} knot {index} is {pair!r}: it must be (arc length, value)")
        place = ARC_LENGTH.check(f"{name} knot {index} arc length", pair[0])
        value = known.check(f"{name} knot {index}", pair[1])
        if knots and place <= knots[-1][0]:
            raise InputError(
                f"{name} knot {index} stands at {place:g} mm, not after the one before it "
                f"at {knots[-1][0]:g} mm: arc lengths must increase"
            )
        knots.append((place, value))
    if len(knots) < 2:
        raise InputError(f"{name} has {len(knots)} knot(s): give a number or at least 2 knots")
    return tuple(knots)


def _is_row(given: object) -> TypeGuard[Sequence[object]]:
    if isinstance(given, np.ndarray):
        return given.ndim > 0
    return isinstance(given, Sequence) and not isinstance(given, str)


def evaluate_profile(
    profile: Profile, places: Floats, interpolation: Interpolation
) -> tuple[Floats, Floats]:
    """Return value and slope at arc lengths inside the knots.

    Straight lines between knots, or monotone cubics (Fritsch and Carlson 1980), which never
    leave the range of the knots at either side. A slope at a corner is that of the right side.
    """
    if isinstance(profile, float):
        return np.full(places.shape, profile), np.zeros(places.shape)
    knots = np.asarray(profile)
    if interpolation == "cubic":
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(knots[:, 0], knots[:, 1])
        return np.asarray(curve(places)), np.asarray(curve(places, 1))
    piece = np.clip(np.searchsorted(knots[:, 0], places, side="right") - 1, 0, len(knots) - 2)
    slopes = np.diff(knots[:, 1]) / np.diff(knots[:, 0])
    return knots[piece, 1] + slopes[piece] * (places - knots[piece, 0]), slopes[piece]


PathKnots = tuple[tuple[ArcLength, float, float], ...]
"""Knots of arc length, x and y [mm]."""


def check_path(name: str, given: object) -> PathKnots:
    """Return `given` as checked knots of arc length, x and y, or raise `InputError`."""
    if not _is_row(given):
        raise InputError(f"{name} is {given!r}: it must be knots (arc length, x, y)")
    rows = [row if _is_row(row) and len(row) == 3 else None for row in given]
    if None in rows:
        index = rows.index(None)
        raise InputError(f"{name} knot {index} is {given[index]!r}: it must be (arc length, x, y)")
    coordinate = Quantity(kind="length")
    columns = [
        check_profile(f"{name} {axis}", [(row[0], row[k]) for row in rows if row], coordinate)
        for k, axis in ((1, "x"), (2, "y"))
    ]
    pairs = zip(*(column for column in columns if not isinstance(column, float)), strict=True)
    path = tuple((place, x, y) for (place, x), (_, y) in pairs)
    if not any(x or y for _, x, y in path):
        raise InputError(f"{name} runs along the backbone's axis: it must leave it somewhere")
    return path


def evaluate_path(
    path: Sequence[Sequence[float]], places: Floats, interpolation: Interpolation
) -> tuple[Floats, Floats]:
    """Return place and slope, both (..., 2), at arc lengths inside the knots.

    Straight lines between knots, or cubic splines with two continuous derivatives.
    """
    knots = np.asarray(path)
    if interpolation == "cubic":
        from scipy.interpolate import CubicSpline

        curve = CubicSpline(knots[:, 0], knots[:, 1:])
        return np.asarray(curve(places)), np.asarray(curve(places, 1))
    columns = [
        evaluate_profile(tuple(zip(knots[:, 0], column, strict=True)), places, "linear")
        for column in knots[:, 1:].T
    ]
    return (
        np.stack([value for value, _ in columns], axis=-1),
        np.stack([slope for _, slope in columns], axis=-1),
    )


# A tendon: its path through the robot's cross-sections.

ROUND_OFF_MM = 1e-9
"""Length that is round-off [mm]."""

LEAST_LEVER = 0.1
"""Share of a tendon's largest distance from the backbone that counts as its lever at least."""


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
        Distance from the backbone [mm], positive; one number, or knots. Either this or `path`.
    angle : float or sequence of (arc length, angle) or Helix
        Clocking angle from +x about +z of the cross-section [rad]; one number, knots, or an angle
        that grows evenly up to `end`. With `offset`; 0 unless given.
    end : float, optional
        Arc length where it ends [mm]; without it, where its section ends.
    pushes : bool
        Whether it is a rod that pushes as well; otherwise it can only pull, and goes slack.
    travel : (float, float)
        Smallest and largest displacement that its drive allows [mm]; ``-inf`` and ``inf`` for no
        limit.
    interpolation : {"linear", "cubic"}
        How knots are joined. Cubics of `offset` and `angle` are monotone between knots; those of
        `path` have two continuous derivatives.
    path : sequence of (arc length, x, y)
        Knots of the place in the cross-section [mm], in place of `offset` and `angle`. It may
        cross the backbone, which a distance and an angle do not describe smoothly.
    friction : float
        Coefficient of friction in its channel, in [0, 10]; see `RodModel`.

    Raises
    ------
    InputError
        If a value is outside its legal range, or both or none of `offset` and `path` are given.
    """

    name: str
    offset: Profile | Sequence[Sequence[float]] | None = quantity(
        "length", "Distance from the backbone.", low=0.0, low_open=True, default=None
    )
    angle: Profile | Helix | Sequence[Sequence[float]] | None = quantity(
        "angle", "Clocking angle.", default=None
    )
    end: float | None = quantity(
        "length", "Arc length of the end.", low=0.0, low_open=True, default=None
    )
    pushes: bool = False
    travel: tuple[float | None, float | None] | None = quantity(
        "length", "Smallest and largest displacement.", default=(-math.inf, math.inf)
    )
    interpolation: Interpolation = "linear"
    path: PathKnots | Sequence[Sequence[float]] | None = quantity(
        "length", "Knots of arc length, x and y in the cross-section.", default=None
    )
    friction: float = quantity(
        "dimensionless", "Coefficient of friction in the channel.", low=0.0, high=10.0, default=0.0
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_name("tendon", self.name))
        label, known = f"tendon '{self.name}'", list_quantities(Tendon)
        check_word(f"{label} interpolation", self.interpolation, get_args(Interpolation))
        if not isinstance(self.pushes, bool):
            raise InputError(f"{label} pushes is {self.pushes!r}: it must be true or false")
        object.__setattr__(self, "travel", check_travel(label, self.travel))
        for name in ("end", "friction"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, known[name].check(f"{label} {name}", given))
        if self.path is not None:
            if self.offset is not None or self.angle is not None:
                raise InputError(f"{label} has a path: it takes no offset and no angle beside it")
            path = check_path(f"{label} path", self.path)
            object.__setattr__(self, "path", path)
            self._check_span("path", path[0][0], path[-1][0])
            return
        if self.offset is None:
            raise InputError(f"{label} has neither an offset nor a path: give one of them")
        if self.angle is None:
            object.__setattr__(self, "angle", 0.0)
        elif self.end is not None and isinstance(self.angle, Helix):
            object.__setattr__(self, "angle", self.angle.knots(self.end))
        for name in ("offset", "angle"):
            given = getattr(self, name)
            if isinstance(given, Helix):
                continue
            profile = check_profile(f"{label} {name}", given, known[name])
            object.__setattr__(self, name, profile)
            if not isinstance(profile, float):
                self._check_span(name, profile[0][0], profile[-1][0])

    def _check_span(self, name: str, first: float, last: float) -> None:
        """Raise `InputError` unless knots reach from the base to the end, where that is known."""
        if self.end is None or (first <= ROUND_OFF_MM and last >= self.end - ROUND_OFF_MM):
            return
        raise InputError(
            f"tendon '{self.name}' {name} has knots from {first:g} to {last:g} mm: they must reach "
            f"from 0 mm, the robot's base, to {self.end:g} mm, the tendon's end"
        )

    @property
    def is_parallel(self) -> bool:
        """Whether its place in the cross-section is the same all along."""
        if self.path is not None:
            return len({tuple(knot[1:]) for knot in self.path}) == 1
        return not isinstance(self.angle, Helix) and all(
            len({value for _, value in knots}) == 1 for knots in self._list_knots()
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
        if self.path is not None:
            return np.asarray(np.hypot(*np.moveaxis(self.place_at(arc_length), -1, 0)))
        return self._evaluate("offset", arc_length)[0]

    def angle_at(self, arc_length: ArrayLike) -> Floats:
        """Return the clocking angle [rad] at arc lengths [mm]; of a path in (-pi, pi].

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        if self.path is not None:
            x, y = np.moveaxis(self.place_at(arc_length), -1, 0)
            return np.asarray(np.arctan2(y, x))
        return self._evaluate("angle", arc_length)[0]

    def place_at(self, arc_length: ArrayLike) -> Floats:
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
        return self._evaluate_place(arc_length)[0]

    def slope_at(self, arc_length: ArrayLike) -> Floats:
        """Return the derivative of `place_at` with arc length, shape (..., 2) [1].

        At a corner of the knots it is that of the distal side.

        Raises
        ------
        InputError
            If an arc length is outside the tendon.
        """
        return self._evaluate_place(arc_length)[1]

    def corners(self) -> Floats:
        """Return the arc lengths inside the tendon where its routing is pieced together [mm]."""
        places = {place for knots in self._list_knots() for place, _ in knots}
        places |= {knot[0] for knot in self.path or ()}
        last = math.inf if self.end is None else self.end - ROUND_OFF_MM
        return np.asarray([place for place in sorted(places) if ROUND_OFF_MM < place < last])

    def _evaluate_place(self, arc_length: ArrayLike) -> tuple[Floats, Floats]:
        if self.path is not None:
            places = self._check_places(arc_length, self.path[-1][0])
            return evaluate_path(self.path, places, self.interpolation)
        offset, taper = self._evaluate("offset", arc_length)
        angle, twist = self._evaluate("angle", arc_length)
        cosine, sine = np.cos(angle), np.sin(angle)
        return (
            np.stack([offset * cosine, offset * sine], axis=-1),
            np.stack(
                [taper * cosine - offset * twist * sine, taper * sine + offset * twist * cosine],
                axis=-1,
            ),
        )

    def _list_knots(self) -> list[Knots]:
        if self.path is not None:
            return []
        profiles: list[Profile] = [self._profile("offset"), self._profile("angle")]
        return [profile for profile in profiles if not isinstance(profile, float)]

    def _profile(self, name: str) -> Profile:
        """The offset or the angle; a helix needs its end."""
        profile: Profile | Helix = getattr(self, name)
        if isinstance(profile, Helix):
            raise InputError(f"tendon '{self.name}' has no end: its helix needs one, or a robot's")
        return profile

    def _evaluate(self, name: str, arc_length: ArrayLike) -> tuple[Floats, Floats]:
        profile = self._profile(name)
        last = math.inf if isinstance(profile, float) else profile[-1][0]
        return evaluate_profile(profile, self._check_places(arc_length, last), self.interpolation)

    def _check_places(self, arc_length: ArrayLike, last: float) -> Floats:
        """Return arc lengths [mm] inside the tendon; `last` is where its knots end."""
        places = check_array("arc_length", arc_length)
        end = last if self.end is None else min(self.end, last)
        inside = (places >= -ROUND_OFF_MM) & (places <= end + ROUND_OFF_MM)
        if not inside.all():
            bad = places.flat[int(np.argmin(inside))]
            raise InputError(
                f"arc length on tendon '{self.name}' is {bad:g} mm: it must lie in [0, {end:g}] mm"
            )
        return np.clip(places, 0.0, end)


DEFAULT_DISCS = 10
"""Discs of a section whose discs are not given."""

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
        EI of the backbone, from 1e-9 to 1e15 [N mm^2]. It does not change what tendon displacements
        do to one section of parallel tendons; sections share a bend by it.
    torsional_stiffness : float
        GJ, from 1e-10 to 1e15 [N mm^2]; 0 for that of a round rod with Poisson's ratio 0.3,
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

    length: float = quantity("length", "Length.", low=0.0, high=1e5, low_open=True)
    radius: float = quantity("length", "Radius with discs.", low=0.0, high=1e4, low_open=True)
    tendons: tuple[Tendon, ...] = ()
    discs: int = quantity(
        "dimensionless", "Number of guide discs.", low=1, high=10000, whole=True, default=0
    )
    disc_positions: tuple[float, ...] = quantity("length", "Places of the discs.", default=())
    bending_stiffness: float = quantity(
        "rigidity", "EI of the backbone.", low=1e-9, high=1e15, default=200.0
    )
    torsional_stiffness: float = quantity(
        "rigidity", "GJ of the backbone.", low=1e-10, high=1e15, default=0.0
    )
    max_bend: float = quantity(
        "angle", "Largest bend angle.", low=0.0, low_open=True, default=math.inf
    )
    name: str = ""

    def __post_init__(self) -> None:
        check_fields(self, "section ", skip=("disc_positions",))
        # A round rod of Poisson's ratio nu has GJ = EI / (1 + nu).
        torsion = self.torsional_stiffness or self.bending_stiffness / (1.0 + POISSON_RATIO)
        list_quantities(Section)["torsional_stiffness"].check(
            "section torsional stiffness", torsion
        )
        places = _check_places(self.disc_positions, self.length)
        if places and self.discs not in (0, len(places)):
            raise InputError(
                f"section discs is {self.discs} but disc_positions has {len(places)}: leave one out"
            )
        for name, value in (
            ("torsional_stiffness", torsion),
            ("disc_positions", places),
            ("discs", self.discs or len(places) or DEFAULT_DISCS),
            ("tendons", check_items("section tendons", self.tendons, Tendon)),
            ("name", check_text("section name", self.name)),
        ):
            object.__setattr__(self, name, value)

    @property
    def disc_places(self) -> NDArray[np.float64]:
        """Arc length of the discs from the section's start [mm], shape (discs,)."""
        if self.disc_positions:
            return np.asarray(self.disc_positions)
        return self.length * np.arange(1, self.discs + 1) / self.discs


def _check_places(given: object, length: float) -> tuple[float, ...]:
    items = take_items("section disc_positions", given, "a sequence of arc lengths in mm")
    places: list[float] = []
    before = 0.0
    for index, item in enumerate(items):
        place = Quantity(kind="length", low=0.0, high=length).check(
            f"section disc_positions[{index}]", item
        )
        if place <= before + ROUND_OFF_MM:
            raise InputError(
                f"section disc_positions[{index}] is {place:g} mm: it must lie after {before:g} mm"
            )
        before = place
        places.append(place)
    if places and abs(places[-1] - length) > ROUND_OFF_MM:
        raise InputError(
            f"section disc_positions ends at {places[-1]:g} mm: "
            f"the last disc must stand at the section's end, {length:g} mm"
        )
    return tuple(places)
