"""Manoeuvres of a pushed scope, step by step; importing them needs no extra."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from typing import Literal

from ..checks import check_fields, quantity
from ..errors import InputError
from ..io.records import load_record
from ..results import Json, Shown

MOVES = ("push", "pull", "twist", "bend")
"""What a step may be."""

LIMITS = (
    "the wall is held in place: that hooking and pulling back gathers the bowel is not modelled; "
    "scope inside over way reached says what of the scope is straightened",
    "the shaft is evenly elastic in bending and in torsion, and does not stretch",
    "friction acts in the introducer and on the wall, not in the tip's cables",
)
"""What a driven manoeuvre leaves out."""


@dataclass(frozen=True, kw_only=True)
class Step(Shown):
    """One thing that the operator does: exactly one of push, pull, twist and bend.

    Parameters
    ----------
    push, pull : float, optional
        How far the shaft is moved in or out [mm]. While it is pushed the tip is steered towards
        the way ahead, otherwise it keeps its bend.
    twist : float, optional
        By how much the handle is turned, clockwise as seen by the operator [rad].
    bend : float, optional
        How far the tip is bent then, from straight [rad].
    direction : float, optional
        With a bend: to which side of the tip, from its x towards its y [rad]; 0 if left out.
    speed : float, optional
        Of a push or a pull [mm/s]; that of the command if left out.

    Raises
    ------
    InputError
        If not exactly one is given, a value is not legal, or has no effect.
    """

    push: float | None = quantity("length", "How far it is pushed in.", default=None, low=0.0)
    pull: float | None = quantity("length", "How far it is pulled back.", default=None, low=0.0)
    twist: float | None = quantity(
        "angle", "By how much the handle is turned, clockwise as the operator sees it.",
        default=None, low=-math.radians(1440.0), high=math.radians(1440.0),
    )  # fmt: skip
    bend: float | None = quantity(
        "angle", "How far the tip is bent then.", default=None, low=0.0, high=6.0
    )
    direction: float | None = quantity(
        "angle", "To which side of the tip it is bent, from its x towards its y.", default=None,
        low=-math.radians(360.0), high=math.radians(360.0),
    )  # fmt: skip
    speed: float | None = quantity(
        "speed", "Of a push or a pull; --speed if left out.", default=None, low=0.1, high=1000.0
    )

    def __post_init__(self) -> None:
        given = [name for name in MOVES if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f" has {' and '.join(given) or 'none of these'}: give one of {', '.join(MOVES)}"
            )
        check_fields(self, ".")
        if self.direction is not None and self.bend is None:
            raise InputError(f" has direction with {given[0]}: only bend has it")
        if self.speed is not None and given[0] not in ("push", "pull"):
            raise InputError(f" has speed with {given[0]}: only push and pull have it")

    @property
    def move(self) -> str:
        """What is done, one of `MOVES`."""
        return next(name for name in MOVES if getattr(self, name) is not None)

    @property
    def amount(self) -> float:
        """By how much [mm] or [rad]."""
        return float(getattr(self, self.move))

    def describe(self) -> str:
        """Return it as it is written in a file."""
        if self.move in ("push", "pull"):
            return f"{self.move} {self.amount:g} mm"
        return f"{self.move} {math.degrees(self.amount):g} deg"


@dataclass(frozen=True, kw_only=True)
class Manoeuvre(Shown):
    """What a file of a manoeuvre holds; the tip stands at the entry before the first step.

    Parameters
    ----------
    kind : str
        ``"bozzini-manoeuvre"``, by which the file is known.
    version : int
        Of the format: 1.
    steps : tuple of Step

    Raises
    ------
    InputError
        If there is no step, or one pulls farther back than the scope is in.
    """

    kind: Literal["bozzini-manoeuvre"] = field(default_factory=lambda: "bozzini-manoeuvre")
    version: int = quantity(default=1, low=1, high=1, whole=True)
    steps: tuple[Step, ...]

    def __post_init__(self) -> None:
        if not self.steps:
            raise InputError("steps is empty: give 1 or more")
        for k, (step, inside) in enumerate(zip(self.steps, self.insertions, strict=True)):
            if inside < -1e-9:
                raise InputError(
                    f"steps[{k}].pull is {step.amount:g} mm: it must be at most the "
                    f"{inside + step.amount:g} mm that are in"
                )

    @property
    def insertions(self) -> tuple[float, ...]:
        """How far the base is in after each step [mm]."""
        inside, found = 0.0, []
        for step in self.steps:
            inside += (step.push or 0.0) - (step.pull or 0.0)
            found.append(inside)
        return tuple(found)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Manoeuvre:
        """Read a file: JSON if it ends in ``.json``, YAML otherwise.

        Raises
        ------
        FileFormatError
            One line that names the file and the field.
        """
        return load_record(path, cls, name="the manoeuvre")


@dataclass(kw_only=True)
class StepReport(Shown):
    """What came of a step.

    Attributes
    ----------
    step : str
        What was done.
    base_moved : float
        [mm]; negative outwards.
    tip_moved : float
        Distance between the tip's places before and after [mm].
    tip_progress : float
        How far the tip is along the way after it [mm].
    tip_turned : float
        Of the tip about its axis, against a frame that is carried along the body without twist
        [rad].
    twist_arrived : float
        That over the twist of the handle; NaN for another step.
    torque : float
        Largest at the handle [N mm].
    normal_peak : float
        Largest normal force of one place of the wall [N].
    inside_over_reached : float
        Length of the scope inside over the length of the way that its tip has reached; NaN while
        that is less than the diameter.
    """

    step: str
    base_moved: float = 0.0
    tip_moved: float = 0.0
    tip_progress: float = 0.0
    tip_turned: float = 0.0
    twist_arrived: float = math.nan
    torque: float = 0.0
    normal_peak: float = 0.0
    inside_over_reached: float = math.nan

    def to_dict(self) -> Json:
        """Return it with units in the names, angles in degrees; None for what it has not."""
        return {
            "step": self.step,
            "base_moved_mm": self.base_moved,
            "tip_moved_mm": self.tip_moved,
            "tip_progress_mm": self.tip_progress,
            "tip_turned_deg": math.degrees(self.tip_turned),
            "twist_arrived": None if math.isnan(self.twist_arrived) else self.twist_arrived,
            "torque_N_mm": self.torque,
            "normal_peak_N": self.normal_peak,
            "inside_over_reached": (
                None if math.isnan(self.inside_over_reached) else self.inside_over_reached
            ),
        }
