"""A section: a length of elastic backbone with guide discs, and the tendons that end in it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    Quantity,
    check_array,
    check_fields,
    check_word,
    list_quantities,
    quantity,
    show_apart,
    show_value,
)
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .checks import check_items, check_name, check_text, check_travel, take_items
from .profile import (
    ROUND_OFF_MM,
    CurvatureKnots,
    Interpolation,
    Knots,
    PathKnots,
    Profile,
    check_curvature,
    check_path,
    check_profile,
    check_span,
    evaluate_path,
    evaluate_profile,
    largest_of,
)
from .wire import Wire


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


# A tendon: its path through the robot's cross-sections.

LEAST_LEVER = 0.1
"""Share of a tendon's largest distance from the backbone that counts as its lever at least."""


@dataclass(frozen=True, kw_only=True)
class Tendon(Shown):
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
    stiffness : float
        EA of the tendon [N]; infinite unless given: it does not stretch.
    pretension : float
        Tension in the straight robot at rest [N]: the tendon's free length is shorter by
        ``pretension length / EA``.
    tension_limit : float
        Largest tension that it bears [N]; a shape beyond has not converged.

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
    stiffness: float = quantity(
        "force", "EA of the tendon.", low=0.0, low_open=True, default=math.inf
    )
    pretension: float = quantity("force", "Tension in the straight robot.", low=0.0, default=0.0)
    tension_limit: float = quantity(
        "force", "Largest tension.", low=0.0, low_open=True, default=math.inf
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_name("tendon", self.name))
        label, known = f"tendon '{self.name}'", list_quantities(Tendon)
        check_word(f"{label} interpolation", self.interpolation, get_args(Interpolation))
        if not isinstance(self.pushes, bool):
            raise InputError(f"{label} pushes is {self.pushes!r}: it must be true or false")
        object.__setattr__(self, "travel", check_travel(label, self.travel))
        for name in ("end", "friction", "stiffness", "pretension", "tension_limit"):
            given = getattr(self, name)
            if given is not None and not _is_unlimited(given, known[name]):
                words = f"{label} {name.replace('_', ' ')}"
                object.__setattr__(self, name, known[name].check(words, given))
        if self.pretension > self.tension_limit:
            shown = show_apart(self.pretension, self.tension_limit)
            raise InputError(
                f"{label} pretension is {shown[0]} N: it must lie in "
                f"[0, {shown[1]}] N, up to its tension limit"
            )
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
        shown = show_apart(last, self.end)
        raise InputError(
            f"tendon '{self.name}' {name} has knots from {first:g} to {shown[0]} mm: they must "
            f"reach from 0 mm, the robot's base, to {shown[1]} mm, the tendon's end"
        )

    @property
    def unset(self) -> tuple[str, ...]:
        """Fields that are not written to files: none was given."""
        return tuple(name for name in ("friction", "pretension") if not getattr(self, name))

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
            shown = show_apart(bad, end)
            raise InputError(
                f"arc length on tendon '{self.name}' is {shown[0]} mm: it must lie in "
                f"[0, {shown[1]}] mm"
            )
        return np.clip(places, 0.0, end)


def _is_unlimited(given: object, known: Quantity) -> bool:
    """Whether a value is infinite, where that stands for no limit."""
    return known.low_open and isinstance(given, float) and given == math.inf


DEFAULT_DISCS = 10
"""Discs of a section whose discs are not given."""

DEFAULT_BENDING_STIFFNESS = 200.0
"""EI of a backbone that is not given [N mm^2]."""

POISSON_RATIO = 0.3
"""Of a backbone whose torsional stiffness is not given."""

STIFFNESSES = ("bending_stiffness", "torsional_stiffness", "stretch_stiffness", "shear_stiffness")
"""Fields in whose place a wire may be given."""

MEAN_POINTS = 4
"""Gauss points of a piece of a profile, exact for EI of a wire that tapers evenly."""

RADIUS_SLACK = 1e-12
"""Share by which a wire may be wider than the body: round-off."""


@dataclass(frozen=True, kw_only=True)
class Section(Shown):
    """One section of a continuum robot, straight at rest unless it has a curvature of its own.

    Profiles are knots of arc length from the section's start and value, linear between; they
    reach from 0 to the section's length.

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
    bending_stiffness : float or sequence of (arc length, EI)
        EI of the backbone, from 1e-9 to 1e15 [N mm^2]; 200 unless given, None with a `wire`. It
        does not change what tendon displacements do to one section of parallel tendons; sections
        share a bend by it.
    torsional_stiffness : float or sequence of (arc length, GJ)
        GJ, from 1e-10 to 1e15 [N mm^2]; 0 for that of a round rod with Poisson's ratio 0.3,
        ``EI / 1.3``.
    max_bend : float
        Largest bend angle [rad].
    name : str
        Name for messages, may be empty.
    stretch_stiffness : float or sequence of (arc length, EA)
        EA of the backbone [N]; infinite unless given.
    shear_stiffness : float or sequence of (arc length, GA)
        GA of the backbone with its shear coefficient [N]; infinite unless given.
    wire : Wire, optional
        The backbone as a round wire, from which the four stiffnesses follow, in their place.
    curvature : (ux, uy, uz) or sequence of (arc length, ux, uy, uz)
        Curvature about x and y and twist about z at rest, in the section's own axes [rad/mm].
    line_weight : float
        Weight per length [N/mm], besides that of the `wire`.
    disc_weight : float
        Weight of each disc [N].

    Raises
    ------
    InputError
        If a value is outside its legal range, or a stiffness is given beside a wire.
    """

    length: float = quantity("length", "Length.", low=0.0, high=1e5, low_open=True)
    radius: float = quantity("length", "Radius with discs.", low=0.0, high=1e4, low_open=True)
    tendons: tuple[Tendon, ...] = ()
    discs: int = quantity(
        "dimensionless", "Number of guide discs.", low=1, high=10000, whole=True, default=0
    )
    disc_positions: tuple[float, ...] = quantity("length", "Places of the discs.", default=())
    bending_stiffness: Profile | Sequence[Sequence[float]] | None = quantity(
        "rigidity", "EI of the backbone.", low=1e-9, high=1e15, default=None
    )
    torsional_stiffness: Profile | Sequence[Sequence[float]] = quantity(
        "rigidity", "GJ of the backbone.", low=1e-10, high=1e15, default=0.0
    )
    max_bend: float = quantity(
        "angle", "Largest bend angle.", low=0.0, low_open=True, default=math.inf
    )
    name: str = ""
    stretch_stiffness: Profile | Sequence[Sequence[float]] = quantity(
        "force", "EA of the backbone.", low=0.0, low_open=True, default=math.inf
    )
    shear_stiffness: Profile | Sequence[Sequence[float]] = quantity(
        "force", "GA of the backbone.", low=0.0, low_open=True, default=math.inf
    )
    wire: Wire | None = None
    curvature: tuple[float, float, float] | CurvatureKnots | Sequence[Sequence[float]] = quantity(
        "curvature", "Curvature and twist at rest.", default=(0.0, 0.0, 0.0)
    )
    line_weight: float = quantity("line force", "Weight per length.", low=0.0, default=0.0)
    disc_weight: float = quantity("force", "Weight of each disc.", low=0.0, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "section ", skip=("disc_positions", "curvature", *STIFFNESSES))
        places = _check_places(self.disc_positions, self.length)
        if places and self.discs not in (0, len(places)):
            raise InputError(
                f"section discs is {self.discs} but disc_positions has {len(places)}: leave one out"
            )
        known = list_quantities(Section)
        curvature = check_curvature("section curvature", self.curvature, known["curvature"])
        check_span("section curvature", curvature, self.length)
        bend = float(np.hypot(*np.atleast_2d(curvature)[:, -3:-1].T).max())
        if bend * self.radius >= 1.0:
            shown = show_apart(bend, 1.0 / self.radius)
            raise InputError(
                f"section curvature is {shown[0]} rad/mm: it must lie in [0, {shown[1]}) "
                "rad/mm, for the body is not to meet itself"
            )
        for name, value in (
            ("disc_positions", places),
            ("discs", self.discs or len(places) or DEFAULT_DISCS),
            ("tendons", check_items("section tendons", self.tendons, Tendon)),
            ("name", check_text("section name", self.name)),
            ("curvature", curvature),
        ):
            object.__setattr__(self, name, value)
        if self.wire is None:
            self._check_stiffnesses()
        else:
            self._check_wire(self.wire)

    def _check_stiffnesses(self) -> None:
        known = list_quantities(Section)
        if self.bending_stiffness is None:
            object.__setattr__(self, "bending_stiffness", DEFAULT_BENDING_STIFFNESS)
        for name in STIFFNESSES:
            given, words = getattr(self, name), f"section {name.replace('_', ' ')}"
            if name == "torsional_stiffness" and isinstance(given, (int, float)) and given == 0.0:
                # A round rod of Poisson's ratio nu has GJ = EI / (1 + nu).
                given = _divide(self._profile("bending_stiffness"), 1.0 + POISSON_RATIO)
            if not _is_unlimited(given, known[name]):
                profile = check_profile(words, given, known[name])
                check_span(words, profile, self.length)
                object.__setattr__(self, name, profile)

    def _check_wire(self, wire: object) -> None:
        if not isinstance(wire, Wire):
            raise InputError(f"section wire is {show_value(wire)}: it must be a Wire")
        defaults = {field.name: field.default for field in dataclasses.fields(Section)}
        for name in STIFFNESSES:
            given = getattr(self, name)
            if given is not None and not (isinstance(given, float) and given == defaults[name]):
                raise InputError(
                    f"section has a wire and a {name.replace('_', ' ')}: leave one out, for the "
                    "stiffnesses follow from the wire"
                )
        check_span("wire diameter", wire.profile, self.length)
        if 2.0 * self.radius < largest_of(wire.profile) * (1.0 - RADIUS_SLACK):
            shown = show_apart(largest_of(wire.profile), 2.0 * self.radius)
            raise InputError(
                f"wire diameter is {shown[0]} mm: it must lie in "
                f"(0, {shown[1]}] mm, inside the section's body"
            )

    def _profile(self, name: str) -> Profile:
        """A stiffness, checked when built."""
        profile: Profile = getattr(self, name)
        return profile

    @property
    def unset(self) -> tuple[str, ...]:
        """Fields that are not written to files: none was given, or others state them."""
        names = [name for name in ("line_weight", "disc_weight") if not getattr(self, name)]
        return (*names, "discs") if self.disc_positions else tuple(names)

    def stiffness_at(self, places: ArrayLike) -> Floats:
        """Return the backbone's stiffnesses at arc lengths from the section's start.

        Parameters
        ----------
        places : array_like, shape (...)
            Arc lengths [mm]; those outside the section get the values of its ends.

        Returns
        -------
        (..., 6) ndarray
            GA, GA, EA [N], EI, EI, GJ [N mm^2]: shear along x and y, stretch, bend about x and
            y, twist.
        """
        inside = np.clip(check_array("places", places), 0.0, self.length)
        if self.wire is not None:
            return self.wire.stiffness_at(inside)
        bending, torsion, along, across = (
            evaluate_profile(self._profile(name), inside, "linear")[0] for name in STIFFNESSES
        )
        return np.stack([across, across, along, bending, bending, torsion], axis=-1)

    @cached_property
    def mean_stiffness(self) -> Floats:
        """EI, EI and GJ, the means over the section [N mm^2], shape (3,)."""
        profiles = (
            [self._profile(name) for name in STIFFNESSES[:2]]
            if self.wire is None
            else [self.wire.profile]
        )
        if all(isinstance(profile, float) for profile in profiles):
            return np.asarray(self.stiffness_at(0.0)[3:])
        knots = [knot for profile in profiles if not isinstance(profile, float) for knot in profile]
        edges = sorted({0.0, self.length} | {place for place, _ in knots if place < self.length})
        nodes, weights = np.polynomial.legendre.leggauss(MEAN_POINTS)
        half = 0.5 * np.diff(edges)[:, None]
        values = self.stiffness_at(np.asarray(edges)[:-1, None] + half * (1.0 + nodes))[..., 3:]
        sums = np.sum(half[..., None] * weights[:, None] * values, axis=(0, 1))
        return np.asarray(sums / self.length)

    def curvature_at(self, places: ArrayLike) -> Floats:
        """Return curvature and twist at rest at arc lengths from the section's start.

        Parameters
        ----------
        places : array_like, shape (...)
            Arc lengths [mm]; those outside the section get the values of its ends.

        Returns
        -------
        (..., 3) ndarray
            ``(ux, uy, uz)`` [rad/mm].
        """
        inside = np.clip(check_array("places", places), 0.0, self.length)
        knots = np.asarray(self.curvature)
        if knots.ndim == 1:
            return np.broadcast_to(knots, (*inside.shape, 3)).copy()
        return np.stack([np.interp(inside, knots[:, 0], knots[:, k]) for k in (1, 2, 3)], axis=-1)

    def weight_at(self, places: ArrayLike) -> Floats:
        """Return the weight per length [N/mm] at arc lengths from the section's start [mm]."""
        inside = np.clip(check_array("places", places), 0.0, self.length)
        own = np.full(inside.shape, self.line_weight)
        return own if self.wire is None else own + self.wire.weight_at(inside)

    @property
    def disc_places(self) -> NDArray[np.float64]:
        """Arc length of the discs from the section's start [mm], shape (discs,)."""
        if self.disc_positions:
            return np.asarray(self.disc_positions)
        return self.length * np.arange(1, self.discs + 1) / self.discs


def _divide(profile: Profile, by: float) -> Profile:
    if isinstance(profile, float):
        return profile / by
    return tuple((place, value / by) for place, value in profile)


def _check_places(given: object, length: float) -> tuple[float, ...]:
    items = take_items("section disc_positions", given, "a sequence of arc lengths in mm")
    places: list[float] = []
    before = 0.0
    for index, item in enumerate(items):
        place = Quantity(kind="length", low=0.0, high=length).check(
            f"section disc_positions[{index}]", item
        )
        if place <= before + ROUND_OFF_MM:
            shown = show_apart(place, before)
            raise InputError(
                f"section disc_positions[{index}] is {shown[0]} mm: it must lie after {shown[1]} mm"
            )
        before = place
        places.append(place)
    if places and abs(places[-1] - length) > ROUND_OFF_MM:
        shown = show_apart(places[-1], length)
        raise InputError(
            f"section disc_positions ends at {shown[0]} mm: "
            f"the last disc must stand at the section's end, {shown[1]} mm"
        )
    return tuple(places)
