"""What a fit finds of a robot besides its parts: how commands reach its tendons, what is seen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from ..checks import check_fields, check_word, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .checks import check_items, check_name, check_values
from .prediction_band import PredictionBand

Command = Literal["displacement", "tension"]
"""What is commanded of the tendons."""


@dataclass(frozen=True, kw_only=True)
class Marker(Shown):
    """A point that is seen, fixed to a cross-section of the body.

    Parameters
    ----------
    name : str
        As in the columns, ``marker_1`` of ``marker_1 x [mm]``.
    arc_length : float, optional
        Where its cross-section is, from the base [mm]; without it, at the tip.
    offset : (x, y, z)
        Where it is in the frame of the cross-section [mm]; z along the backbone.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    name: str
    arc_length: float | None = quantity("length", "Arc length.", low=0.0, default=None)
    offset: tuple[float, float, float] = quantity(
        "length", "Place in the cross-section's frame.", default=(0.0, 0.0, 0.0)
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", check_name("marker", self.name))
        label = f"marker '{self.name}' "
        skip = ("offset",) if self.arc_length is not None else ("offset", "arc_length")
        check_fields(self, label, skip=skip)
        offset = check_values(f"{label}offset", self.offset, (3,), unit="mm")
        object.__setattr__(self, "offset", tuple(offset.tolist()))


@dataclass(frozen=True, kw_only=True)
class RobotCalibration(Shown):
    """How a robot's commands reach its tendons, by which model it was fitted, and how well.

    Parameters
    ----------
    command : {"displacement", "tension"}
        What was commanded, and is converted.
    zeros : mapping of str to float
        What is added to the displacement of each tendon [mm]; 0 for those that are not named.
    scale : float
        By what commands are multiplied.
    backlash : float
        Half the play between a command and its tendon [mm]. Nothing is known of it before the first
        command of a history: that one is taken to act in full, in the middle of its play.
    markers : tuple of Marker
        Where the points seen are on the body.
    model : str
        Name of the model that was fitted; empty if the robot's own choice holds.
    model_options : mapping
        Options of that model; loads are none of the robot's.
    values : mapping of str to float
        What was fitted, in mm, N, MPa and rad; factors have no unit.
    rms : float
        Root mean square distance of the rows that were fitted [mm].
    validation_rms : float
        The same of rows left out [mm]; 0 if none were.
    rows : int
        How many rows were fitted.
    source : str
        Name of the file of measurements.
    band : PredictionBand, optional
        How far predictions miss, if rows were left out.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    command: Command = "displacement"
    zeros: Mapping[str, float] = field(default_factory=dict)
    scale: float = quantity(default=1.0, low=0.0, low_open=True)
    backlash: float = quantity("length", default=0.0, low=0.0)
    markers: tuple[Marker, ...] = ()
    model: str = ""
    model_options: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    rms: float = 0.0
    validation_rms: float = 0.0
    rows: int = 0
    source: str = ""
    band: PredictionBand | None = None

    def __post_init__(self) -> None:
        check_word("command", self.command, get_args(Command))
        check_fields(self, "calibration ")
        object.__setattr__(self, "markers", check_items("markers", self.markers, Marker))
        for name, value in self.zeros.items():
            if not math.isfinite(value):
                raise InputError(f"calibration zero of tendon '{name}' is {value}: it must be "
                                 "finite")  # fmt: skip

    def order_zeros(self, names: Sequence[str]) -> Floats:
        """Return the zeros of all tendons (t,) [mm].

        Raises
        ------
        InputError
            If there is no tendon of a name.
        """
        for name in self.zeros:
            if name not in names:
                raise InputError(
                    f"the calibration has a zero of tendon '{name}': the tendons are "
                    f"{', '.join(names) or 'none'}"
                )
        return np.array([self.zeros.get(name, 0.0) for name in names])


def convert_commands(
    commands: Floats, *, scale: float, zeros: Floats | None = None, backlash: float = 0.0
) -> Floats:
    """Return what reaches the tendons of commands (..., t); with backlash (n, t), over time."""
    moved = scale * commands
    if backlash > 0.0:
        moved = play(moved, backlash)
    return moved if zeros is None else moved + zeros


def play(commands: Floats, width: float) -> Floats:
    """Return what follows commands (n, t) in time, with a play of `width` each way.

    The first command acts in full, as nothing is known of the play before it.
    """
    followed = np.empty_like(commands)
    at, gaps = commands[0], bool(np.isnan(commands).any())
    for row, (low, high) in enumerate(zip(commands - width, commands + width, strict=True)):
        moved = np.minimum(np.maximum(at, low), high)
        at = np.where(np.isnan(moved), commands[row], moved) if gaps else moved
        followed[row] = at
    return followed
