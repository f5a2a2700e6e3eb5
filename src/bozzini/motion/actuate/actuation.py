"""A robot's motion along a plan: displacements, what is proved, and why it ends."""

from __future__ import annotations

import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_number, check_range, show_apart
from ...continuum import ContinuumRobot
from ...continuum.checks import check_frame
from ...continuum.coupling import coupling_matrix
from ...continuum.robot import check_robot
from ...errors import FileFormatError, InputError
from ...io.files import check_parquet, write_atomically, write_parquet, write_text
from ...io.inputs import note_input
from ...io.records import parse_json
from ...io.sheets import format_table
from ...numeric.arrays import Floats
from ...results import Json, Result, take_axes, to_plain
from .executed import ArcCertificate, place_bodies

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Checks of a robot's motion when it is built, from a fit or from a file.

COLUMNS = ("step", "head_arc_length_mm", "base_advance_mm")
"""Columns of a time table before those of the tendons."""

_RANGE_SLACK = 1e-6
"""Displacement or advance that is round-off [mm]."""


def check_names(robot: ContinuumRobot) -> None:
    """Raise `InputError` if a tendon's column in a time table would be called like another one."""
    check_robot(robot)
    for name in robot.tendon_names:
        if f"{name}_mm" in COLUMNS:
            raise InputError(
                f"tendon '{name}' of robot '{robot.name}' has a name that the time table needs "
                f"itself: call it otherwise than {', '.join(_reserved())}"
            )


def check_arrays(given: Actuation) -> dict[str, Floats]:
    """Return the arrays of an actuation by name, or raise `InputError` if they are wrong."""
    robot, steps = given.robot, np.shape(given.head_arc_length)
    check_robot(robot)
    if len(steps) != 1 or steps[0] < 1:
        raise InputError(f"head_arc_length has shape {steps}: it must be (steps,), steps from 1")
    shapes = {
        "head_arc_length": steps,
        "base_advance": steps,
        "bends": (*steps, len(robot.sections), 2),
        "displacements": (*steps, len(robot.tendons)),
        "fit_rms": steps,
        "fit_max": steps,
        "clearance": steps,
        "frame": (4, 4),
    }
    arrays = {}
    for name, shape in shapes.items():
        array = check_array(name, getattr(given, name))
        if array.shape != shape:
            raise InputError(f"{name} has shape {array.shape}: it must be {shape}")
        # Infinite where all of the robot is in the introducer.
        high = math.inf if name == "clearance" else np.finfo(np.float64).max
        check_range(name, array, -np.finfo(np.float64).max, high)
        arrays[name] = array
    for name in ("fit_rms", "fit_max"):
        check_range(name, arrays[name], 0.0, math.inf, "mm")
    check_range(
        "base_advance",
        arrays["base_advance"],
        0.0,
        robot.length,
        "mm",
        slack=_RANGE_SLACK,
    )
    check_frame("frame", arrays["frame"])
    commanded = arrays["bends"].reshape(steps[0], -1) @ coupling_matrix(robot).T
    off = np.abs(arrays["displacements"] - commanded)
    if not off.max(initial=0.0) <= _RANGE_SLACK * (1.0 + np.abs(commanded).max(initial=0.0)):
        step, tendon = np.unravel_index(int(np.argmax(off)), off.shape)
        raise InputError(
            f"displacements miss those of the bends by {off[step, tendon]:.3g} mm, tendon "
            f"'{robot.tendon_names[tendon]}' at step {step}: they must belong together"
        )
    return arrays


def check_words(given: Actuation, codes: Mapping[str, str]) -> None:
    """Raise `InputError` if status, reason, meta and certificate do not go with the rest."""
    status, code = given.status, given.reason_code
    if status not in ("complete", "stopped"):
        raise InputError(f"status is {status!r}: it must be 'complete' or 'stopped'")
    for name in ("reason_code", "reason"):
        if not isinstance(getattr(given, name), str):
            raise InputError(f"{name} is {getattr(given, name)!r}: it must be a text")
    if (code in codes) != (status == "stopped") or bool(given.reason) != (status == "stopped"):
        raise InputError(
            f"reason_code is {code!r} and reason {given.reason!r} with status {status!r}: a motion "
            f"that is stopped has a reason and one of {', '.join(codes)}, a complete one none"
        )
    if not isinstance(given.meta, Mapping):
        raise InputError(f"meta is {given.meta!r}: it must be a mapping")
    proof, robot = given.certificate, given.robot
    if not isinstance(proof, ArcCertificate):
        raise InputError(f"certificate is a {type(proof).__name__}: it must be an ArcCertificate")
    most = (
        ("step", proof.step, len(given.head_arc_length) - 1.0),
        ("section", proof.section, len(robot.sections) - 1),
        ("arc_length", proof.arc_length, robot.length),
    )
    for name, value, high in most:
        if value > high * (1.0 + 1e-12):
            shown = show_apart(value, high)
            raise InputError(f"certificate {name} is {shown[0]}: it must lie in [0, {shown[1]}]")


def _reserved() -> list[str]:
    return [name.removesuffix("_mm") for name in COLUMNS if name.endswith("_mm")]


ACTUATION_CODES = {
    "PLAN_STOPPED": "the plan itself ends before the goal",
    "INTRODUCER": "the robot is thicker than the introducer's bore",
    "ROBOT_TOO_SHORT": "the robot is wholly inserted before the goal",
    "BEND_LIMIT": "a section would have to bend more than it can",
    "TENDON_TRAVEL": "a tendon would have to be pulled or let out farther than its drive goes",
    "WALL": "the arcs of the sections go through the wall",
    "CERTIFICATE_UNRESOLVED": "a motion was found, but its clearance could not be proved",
}
"""Every reason code and its meaning."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuation(Result):
    """Tendon displacements and base advance at each step, and what is known of the motion.

    Between steps all displacements and the advance move evenly, together; the certificate is for
    that motion, of a body of arcs. A motion that cannot go all the way is cut where its
    certificate ends.

    Parameters
    ----------
    robot : ContinuumRobot
        The robot.
    head_arc_length : (steps,) float
        Where the tip stands along the plan's path [mm].
    base_advance : (steps,) float
        How far the base has been moved in along the introducer [mm]. At 0 the tip of the
        straight robot stands at the entry, at the robot's length the base does.
    bends : (steps, m, 2) float
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    displacements : (steps, t) float
        Of each tendon, positive pulled [mm].
    fit_rms, fit_max : (steps,) float
        How far the backbone outside the introducer is off the path, at each step [mm].
    clearance : (steps,) float
        Estimated distance from body to wall at each step, the smallest over samples [mm];
        infinite where all of the robot is in the introducer.
    frame : (4, 4) float
        The base when wholly inserted, world frame; z is the way in.
    certificate : ArcCertificate
        What is proved of the motion between these steps.
    status : {"complete", "stopped"}
        Whether the tip comes to the end of the plan.
    reason_code, reason : str
        A key of `ACTUATION_CODES` and one sentence; empty if complete.
    meta : dict
        JSON-able: plan, options, what was found on the part of the way that was cut off.

    Raises
    ------
    InputError
        If an array has another shape, is not finite (but for the clearance) or out of range,
        displacements are not those of the bends, or the rest does not go with them; if a
        tendon's column would be called like another one.
    """

    robot: ContinuumRobot
    head_arc_length: Floats
    base_advance: Floats
    bends: Floats
    displacements: Floats
    fit_rms: Floats
    fit_max: Floats
    clearance: Floats
    frame: Floats
    certificate: ArcCertificate
    status: str
    reason_code: str = ""
    reason: str = ""
    meta: dict[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, array in check_arrays(self).items():
            object.__setattr__(self, name, array)
        check_names(self.robot)
        check_words(self, ACTUATION_CODES)

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.head_arc_length)

    @property
    def certified(self) -> bool:
        """Whether the motion between these steps is proved to keep off the wall."""
        return self.certificate.certified

    @property
    def fits(self) -> bool:
        """Whether the robot reaches the end of the plan, proved clear of the wall."""
        return self.status == "complete" and self.certified

    @property
    def converged(self) -> bool:
        """Whether the tip comes to the end of the plan."""
        return self.status == "complete"

    @property
    def residual(self) -> float:
        """How far the backbone is off the path, at most [mm]."""
        return float(self.fit_max.max())

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the time table's columns."""
        names = (f"{name}_mm" for name in self.robot.tendon_names)
        return (*COLUMNS, *names)

    def place_body(self, times: ArrayLike, *, pitch: float = 2.0) -> Floats:
        """Return points of the backbone at any times.

        Parameters
        ----------
        times : (n,) array_like
            In steps, from 0 to ``steps - 1``; fractions are between steps.
        pitch : float
            Distance between points at most [mm], at least 0.001 mm.

        Returns
        -------
        (n, k, 3) ndarray
            World frame [mm], tip first.

        Raises
        ------
        InputError
            If `times` has another shape or a time before the motion begins or after it ends, or
            `pitch` is out of range.
        """
        check_number("pitch", pitch, low=1e-3, unit="mm")
        chords = [max(1, math.ceil(section.length / pitch)) for section in self.robot.sections]
        return place_bodies(
            self.robot, self.bends, self.base_advance, self.frame, times=times, chords=chords
        )

    def to_dict(self) -> Json:
        """Return the robot's part of ``summary.json``: plain JSON types."""
        angle = np.linalg.norm(self.bends, axis=2)
        step, section = np.unravel_index(int(np.argmax(angle)), angle.shape)
        off = int(np.argmax(self.fit_max))
        ways = np.abs(np.diff(self.head_arc_length))
        moving = ways > 1e-9
        rates = np.zeros(len(self.robot.tendons))
        base_rate = 0.0
        if moving.any():
            change = np.abs(np.diff(self.displacements, axis=0))[moving]
            rates = (change / ways[moving, None]).max(axis=0)
            base_rate = float((np.abs(np.diff(self.base_advance))[moving] / ways[moving]).max())
        proof = self.certificate.describe()
        if not self.certified:  # below zero nothing is proved: no number to quote
            proof["clearance_mm"] = None
        return {
            "name": self.robot.name,
            "status": self.status,
            "fits": self.fits,
            "certified": self.certified,
            "reason_code": self.reason_code,
            "reason": self.reason,
            "sections": len(self.robot.sections),
            "length_mm": self.robot.length,
            "radius_mm": self.robot.radius,
            "steps": self.steps,
            "inserted_mm": float(self.head_arc_length.max()),
            "certificate": proof,
            "clearance_estimated_mm": to_plain(float(self.clearance.min())),
            "fit": {
                "rms_median_mm": float(np.median(self.fit_rms)),
                "rms_max_mm": float(self.fit_rms.max()),
                "max_mm": float(self.fit_max[off]),
                "max_head_mm": float(self.head_arc_length[off]),
            },
            "bend": {
                "max_rad": float(angle[step, section]),
                "section": self.robot.section_label(int(section)),
                "head_mm": float(self.head_arc_length[step]),
            },
            "base": {"max_mm": float(self.base_advance.max()), "rate_max": base_rate},
            "tendons": {
                name: {
                    "min_mm": float(self.displacements[:, k].min()),
                    "max_mm": float(self.displacements[:, k].max()),
                    "rate_max": float(rates[k]),
                }
                for k, name in enumerate(self.robot.tendon_names)
            },
            **{key: self.meta[key] for key in ("shortfall",) if key in self.meta},
        }

    def write_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write the time table as CSV, numbers in full, and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        return write_text(path, format_table(self.list_table()))

    def write_parquet(self, path: str | os.PathLike[str]) -> Path:
        """Write the time table as Parquet, the same columns, and return its path.

        Raises
        ------
        MissingExtraError
            If ``pyarrow`` is not installed.
        OutputError
            If the file cannot be written.
        """
        check_parquet()
        return write_parquet(path, self.to_frame())

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write everything as a compressed ``.npz`` and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        return save_actuation(self, Path(path))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Actuation:
        """Read a file that `save` wrote.

        Raises
        ------
        FileFormatError
            If the file is missing, damaged, or something else. It is checked for being
            whole and consistent, not proved anew: that takes the duct, and `certify_arcs`.
        """
        return load_actuation(Path(path))

    def list_columns(self) -> Mapping[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`, the time table: a row per step."""
        moves = (self.head_arc_length, self.base_advance, *self.displacements.T)
        return dict(zip(self.columns, (np.arange(self.steps), *moves), strict=True))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tendon displacements over the insertion, and return the axes."""
        axes = take_axes(ax, x="tip along the plan's path [mm]", y="tendon displacement [mm]")
        axes.plot(self.head_arc_length, self.displacements, label=self.robot.tendon_names)
        axes.legend()
        return axes


# The file of a robot's motion: a compressed NumPy archive, arrays and one JSON text.

ACTUATION_FORMAT = "bozzini-actuation-1"

ARRAYS = (
    "head_arc_length",
    "base_advance",
    "bends",
    "displacements",
    "fit_rms",
    "fit_max",
    "clearance",
    "frame",
)

_DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    NotImplementedError,
    RecursionError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy, zip and JSON raise on a damaged file."""


def save_actuation(actuation: Actuation, path: Path) -> Path:
    """Write a motion; see `Actuation.save`."""
    record = {
        "format": ACTUATION_FORMAT,
        "robot": actuation.robot.to_dict(),
        "certificate": actuation.certificate.describe(),
        "status": actuation.status,
        "reason_code": actuation.reason_code,
        "reason": actuation.reason,
        "meta": actuation.meta,
    }
    text = np.array(json.dumps(record, allow_nan=False))
    arrays = {name: getattr(actuation, name) for name in ARRAYS}

    def write(temporary: Path) -> None:
        with temporary.open("wb") as stream:
            np.savez_compressed(stream, record=text, **arrays)

    return write_atomically(path, write)


def load_actuation(path: Path) -> Actuation:
    """Read a motion; see `Actuation.load`."""
    note_input(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            record = parse_json(str(data["record"]))
            if not isinstance(record, dict) or record.get("format") != ACTUATION_FORMAT:
                raise FileFormatError(f"{path} is not an actuation of format {ACTUATION_FORMAT!r}")
            arrays: Json = {name: data[name] for name in ARRAYS}
        texts = {key: record[key] for key in ("status", "reason_code", "reason", "meta")}
        return Actuation(
            robot=ContinuumRobot.from_dict(record["robot"]),
            certificate=ArcCertificate.from_description(record["certificate"]),
            **arrays,
            **texts,
        )
    except FileNotFoundError:
        raise FileFormatError(f"no such file: {path}") from None
    except FileFormatError:
        raise
    except _DAMAGED as error:
        words = " ".join(str(error).split())
        raise FileFormatError(f"{path} is not a Bozzini actuation: {words}") from None
