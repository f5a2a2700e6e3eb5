"""Checks of a robot's motion when it is built, from a fit or from a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_range
from ..errors import InputError
from ._places import check_frame
from .arc_certificate import ArcCertificate
from .coupling import coupling_matrix
from .robot import ContinuumRobot, check_robot

if TYPE_CHECKING:
    from .actuation import Actuation

__all__ = ["check_arrays", "check_names", "check_words"]

Floats = NDArray[np.float64]

COLUMNS = ("step", "head_arc_length_mm", "base_advance_mm")
"""Columns of a time table before those of the tendons."""

ROUND_OFF = 1e-6
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
    check_range("base_advance", arrays["base_advance"], 0.0, robot.length, "mm", slack=ROUND_OFF)
    check_frame("frame", arrays["frame"])
    told = arrays["bends"].reshape(steps[0], -1) @ coupling_matrix(robot).T
    off = np.abs(arrays["displacements"] - told)
    if not off.max(initial=0.0) <= ROUND_OFF * (1.0 + np.abs(told).max(initial=0.0)):
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
            raise InputError(f"certificate {name} is {value:g}: it must lie in [0, {high:g}]")


def _reserved() -> list[str]:
    return [name.removesuffix("_mm") for name in COLUMNS if name.endswith("_mm")]
