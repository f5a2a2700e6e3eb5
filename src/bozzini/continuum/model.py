"""Models of a continuum robot: the base class of all, and what each asks of a shape."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_fields, quantity
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .robot import RobotDesign, check_robot
from .shape import Shape

Verdict = tuple[NDArray[np.bool_], NDArray[np.str_]]
"""Whether each shape of a batch has converged, and why not."""

Feature = Literal[
    "weight", "curvature at rest", "stiffness of tendons", "pretension", "tension limits"
]
"""What a robot may have and a model leave out."""

LARGEST_STIFFNESS_RATIO = 1e6
"""Ratio of sections' stiffnesses up to which digits suffice."""

TENSION_ROUND_OFF = 1e-9
"""Share by which a tension may pass its limit."""

EVEN_CURVATURE_SHARE = 1e-3
"""By how much a curvature that counts as even may differ, as a share."""

PLAY = 1e-4
"""Displacement of the tip that the tolerance may always make, against the robot's length."""

LEVERS = 10.0
"""The same against what the tolerance makes of it over the lever of length by offset."""

ROUND_OFF_LENGTH_SHARE = 1e-11
"""Error of a tendon's length that is round-off, as a share of the robot's length."""


@dataclass(frozen=True)
class ContinuumModel(Shown, ABC):
    """A model that turns tendon displacements into shapes.

    A model is a frozen dataclass: its fields are its options, and `bozzini.checks.quantity` states
    what each is, for checks and for the command line. A subclass sets `name` and defines `shape`,
    which ends with `make_shape`. Another package adds one by an entry point of the group
    ``bozzini.continuum``.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    InputError
        If an option is outside its legal range.
    GeometryError
        If the model does not take such a robot.
    """

    robot: RobotDesign
    tolerance: float = quantity(
        "length",
        "By how much a command may miss being consistent.",
        low=0.0,
        high=1.0,
        low_open=True,
        default=1e-6,
        kw_only=True,
    )

    name: ClassVar[str]
    """The model's name in `CONTINUUM_MODELS`."""
    takes_friction: ClassVar[bool] = False
    """Whether it heeds the friction of tendons."""
    heeds: ClassVar[frozenset[Feature]] = frozenset()
    """What else of a robot it heeds; what it leaves out stands in its `notes`."""
    lets_follow: ClassVar[bool] = False
    """Whether a displacement may be NaN, for a tendon that follows the others."""
    checked_by_class: ClassVar[tuple[str, ...]] = ()
    """Options that are no single numbers, which the class checks itself."""

    def __post_init__(self) -> None:
        check_robot(self.robot)
        check_fields(self, skip=self.checked_by_class)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the model with this robot, a sentence each."""
        notes = []
        if self.robot.tendon_friction.any() and not self.takes_friction:
            notes.append(
                f"the {self.name} model leaves out the friction of tendons: the rod model has it"
            )
        left = [feature for feature in list_features(self.robot) if feature not in self.heeds]
        if left:
            notes.append(f"the {self.name} model leaves out the robot's {', '.join(left)}")
        return tuple(notes)

    @abstractmethod
    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How far each tendon is pulled [mm], negative where it is let out. Where it is NaN the
            tendon follows what the others do, if the model `lets_follow`.

        Returns
        -------
        Shape
            Not converged, with a reason, where there is none.

        Raises
        ------
        InputError
            If there is not one finite displacement for each tendon.
        """

    def find_shape(self, displacements: ArrayLike) -> Shape:
        """Return the answer of `shape`; tendons that a model does not let follow are held at 0."""
        if not self.lets_follow:
            moved = check_array("displacements", displacements)
            displacements = np.where(np.isnan(moved), 0.0, moved)
        return self.shape(displacements)

    def shape_under_tensions(self, tensions: ArrayLike, *, initial: Shape | None = None) -> Shape:
        """Return the shapes under tensions, of a model that takes them; see `ElasticModel`.

        Raises
        ------
        InputError
            If the model takes none.
        """
        raise InputError(
            f"the {self.name} model takes displacements only: tensions need a model of forces, "
            "such as the rod"
        )

    def make_shape(
        self,
        displacements: Floats,
        *,
        arc_length: Floats,
        frames: Floats,
        discs: Floats | None = None,
        verdict: Verdict | None = None,
        **known: NDArray[np.generic],
    ) -> Shape:
        """Return the answer of `shape`.

        Parameters
        ----------
        displacements : (..., t) ndarray
            Displacements, checked [mm].
        arc_length : (k,) ndarray
            Stations [mm], discs among them.
        frames : (n, k, 4, 4) ndarray
            Frames at the stations, the batch in one row [mm].
        discs : (d,) ndarray, optional
            Arc length of the discs [mm]; those of the robot unless given.
        verdict : (ndarray of bool, ndarray of str), optional
            Whether each shape has converged, and why not; all have unless given.
        **known
            Further fields of `Shape` that the model knows, the batch in one row or as it is.

        Raises
        ------
        GeometryError
            If the last frame of a converged shape is not finite.
        """
        batch = displacements.shape[:-1]
        if verdict is None:
            verdict = np.ones(batch, dtype=np.bool_), np.zeros(batch, dtype="<U1")
        if "tensions" in known and np.isfinite(self.robot.tension_limits).any():
            verdict = check_tensions(self.robot, known["tensions"], verdict)
        fields = known | {"converged": verdict[0], "reason": verdict[1]}
        if "tendon_lengths" not in fields:
            fields["tendon_lengths"] = self.robot.rest_lengths - displacements
        for name, shape, kind in (
            ("section_parameters", (0, 2), np.float64),
            ("tensions", (0,), np.float64),
            ("slack", displacements.shape[-1:], np.bool_),
            ("residual", (), np.float64),
            ("iterations", (), np.int64),
        ):
            if name not in fields:
                fields[name] = np.zeros((*batch, *shape), dtype=kind)
        fields["frames"] = frames
        own = {"frames": 3, "section_parameters": 2, "tendon_lengths": 1, "tensions": 1, "slack": 1}
        shaped = {}
        for name, given in fields.items():
            values = np.asarray(given)
            shaped[name] = values.reshape((*batch, *values.shape[values.ndim - own.get(name, 0) :]))
        made = Shape(
            robot=self.robot,
            model=self.name,
            arc_length=arc_length,
            displacements=displacements.copy(),
            disc_arc_length=self.robot.disc_arc_length if discs is None else discs,
            friction=None,
            **shaped,
        )
        # Frames are products from the base on: the last one is not finite if any is not.
        if not np.isfinite(made.frames[..., -1, :, :][made.converged]).all():
            raise GeometryError(f"frames of the model {self.name} are not finite")
        return made


def list_features(robot: RobotDesign) -> tuple[Feature, ...]:
    """Return what a robot has that not all models heed."""
    has: dict[Feature, bool] = {
        "weight": robot.has_line_weight or bool(robot.disc_weights.any()),
        "curvature at rest": not robot.is_straight,
        "stiffness of tendons": bool(np.isfinite(robot.tendon_stiffness).any()),
        "pretension": bool(robot.pretensions.any()),
        "tension limits": bool(np.isfinite(robot.tension_limits).any()),
    }
    return tuple(feature for feature, present in has.items() if present)


def choose_stiffness(robot: RobotDesign, other: float) -> Floats:
    """Return EA of each tendon [N], shape (t,): its own, or `other` where it has none."""
    own = robot.tendon_stiffness
    return np.where(np.isfinite(own), own, other)


def check_tensions(robot: RobotDesign, tensions: NDArray[np.generic], verdict: Verdict) -> Verdict:
    """Mark shapes where a tension (..., t) [N] passes its tendon's limit."""
    converged, reason = verdict
    size = np.abs(np.asarray(tensions, dtype=np.float64)).reshape(*converged.shape, -1)
    over = size > robot.tension_limits * (1.0 + TENSION_ROUND_OFF)
    bad = converged & over.any(axis=-1)
    reasons: dict[tuple[int, ...], str] = {}
    for index in np.argwhere(bad):
        place = tuple(int(i) for i in index)
        worst = int(np.argmax(np.where(over[place], size[place] / robot.tension_limits, 0.0)))
        reasons[place] = (
            f"tendon '{robot.tendon_names[worst]}' has a tension of {size[place][worst]:.4g} N: "
            f"its limit is {robot.tension_limits[worst]:g} N"
        )
    if not reasons:
        return verdict
    return converged & ~bad, np.where(bad, write_reasons(reason.shape, reasons), reason)


def write_reasons(shape: tuple[int, ...], reasons: dict[tuple[int, ...], str]) -> NDArray[np.str_]:
    """Return an array of texts, empty but at the places given."""
    width = max((len(text) for text in reasons.values()), default=1)
    array = np.zeros(shape, dtype=f"<U{width}")
    for place, text in reasons.items():
        array[place] = text
    return array


@dataclass(frozen=True, kw_only=True, eq=False)
class BendMeasure:
    """Angles through which the sections of shapes bend, and how tightly.

    Parameters
    ----------
    bends : (..., m) ndarray
        Angle of each section [rad].
    curvatures : (..., m) ndarray, optional
        Largest curvature of each section [1/mm], unless it is the same all along.
    round_off : float
        Share of a limit that is an error of the solver.
    """

    bends: Floats
    curvatures: Floats | None = None
    round_off: float = 1e-9


def check_limits(
    robot: RobotDesign, displacements: Floats, measure: BendMeasure, verdict: Verdict
) -> Verdict:
    """Mark what passes the drives' travel, the sections' largest bends, or lets discs meet."""
    converged, reason = verdict
    bends, slack = measure.bends, 1.0 + measure.round_off
    sharp = bends / robot.section_lengths if measure.curvatures is None else measure.curvatures
    # Values, their range, and the message for a place of the batch, limit by limit.
    reasons: dict[tuple[int, ...], str] = {}

    def mark(values: Floats, low: float, high: float) -> list[tuple[int, ...]]:
        if not values.size or (values.min() >= low and values.max() <= high):
            return []
        bad = np.argwhere(converged & ((values < low) | (values > high)))
        places = [tuple(int(i) for i in index) for index in bad]
        return [place for place in places if place not in reasons]

    for k, (low, high) in enumerate(robot.tendon_travel.tolist()):
        for place in mark(displacements[..., k], low, high):
            reasons[place] = (
                f"tendon '{robot.tendon_names[k]}' is moved {displacements[..., k][place]:.4g} mm: "
                f"its travel is [{low:g}, {high:g}] mm"
            )
    for k, section in enumerate(robot.sections):
        own, most = bends[..., k], section.max_bend
        label = robot.section_label(k)
        for place in mark(own, 0.0, most * slack):
            reasons[place] = (
                f"{label} would bend {math.degrees(own[place]):.4g} deg: its largest bend is "
                f"{math.degrees(most):.4g} deg"
            )
        # The curve may not be tighter than the body is thick.
        for place in mark(sharp[..., k], 0.0, slack / section.radius):
            bend, curvature = float(own[place]), float(sharp[..., k][place])
            words = f"{label} would bend {math.degrees(bend):.4g} deg"
            discs = f"its discs, of radius {section.radius:g} mm, meet"
            reasons[place] = (
                f"{words}: {discs} at {math.degrees(section.length / section.radius):.4g} deg"
                if curvature * section.length <= bend * (1.0 + EVEN_CURVATURE_SHARE)
                else f"{words}, to a radius of {1.0 / curvature:.4g} mm where it is tightest: "
                f"{discs}"
            )
    if not reasons:
        return verdict
    passed = write_reasons(reason.shape, reasons)
    return converged & (passed == ""), np.where(converged, passed, reason)


def check_numbers(
    model: ContinuumModel, frames: Floats, residual: Floats, verdict: Verdict
) -> Verdict:
    """Mark shapes that are not finite, or miss their command by more than the tolerance."""
    converged, reason = verdict
    finite = np.asarray(np.isfinite(frames).all(axis=(-3, -2, -1)))
    met = residual <= 1.1 * model.tolerance + ROUND_OFF_LENGTH_SHARE * model.robot.length
    bad = converged & ~(finite & met)
    reasons: dict[tuple[int, ...], str] = {}
    for index in np.argwhere(bad):
        place = tuple(int(i) for i in index)
        missed = f"the shape that was found misses the command by {residual[place]:.3g} mm"
        words = missed if finite[place] else "the shape that was found is not finite"
        reasons[place] = words + explain_contrast(model.robot)
    if not reasons:
        return verdict
    return converged & ~bad, np.where(bad, write_reasons(reason.shape, reasons), reason)


def advise_contradiction(tolerance: float) -> str:
    """Return what helps where measured displacements contradict each other."""
    return (
        f"if they were measured, raise the tolerance of {tolerance:g} mm or give the tendons their "
        "stiffness"
    )


def explain_play(model_tolerance: float, play: float, *, length: float, lever: float) -> str:
    """Return what is wrong where displacements within the tolerance move the tip; else nothing.

    Parallel tendons that do not stretch hold the twist so that it grows with the root of what
    they have too much: then the tolerance decides where the tip is, not the loads.

    Parameters
    ----------
    model_tolerance : float
        By how much displacements may differ [mm].
    play : float
        Motion of the tip that they make [mm]; infinite where no equilibrium is found.
    length, lever : float
        Length of the robot and least lever of a tendon [mm].
    """
    if play <= max(PLAY * length, LEVERS * length / lever * model_tolerance):
        return ""
    found = f"the tip is {play:.2g} mm elsewhere" if play < math.inf else "no equilibrium was found"
    return (
        "tendons that do not stretch leave the shape open under these loads: for displacements "
        f"that differ by the tolerance of {model_tolerance:g} mm {found}; give a tendon_stiffness"
    )


def explain_contrast(robot: RobotDesign) -> str:
    """Return what to add to a reason where stiffnesses differ too much; else nothing."""
    ratio = robot.section_stiffness.max() / robot.section_stiffness.min()
    if ratio <= LARGEST_STIFFNESS_RATIO:
        return ""
    return (
        f"; the backbone's stiffnesses differ by a factor of {ratio:.2g}, and from "
        f"{LARGEST_STIFFNESS_RATIO:g} on digits may not suffice"
    )
