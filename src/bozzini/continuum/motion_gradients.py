"""How the motion of a robot depends on its numbers: stiffness, tendons, friction, damping.

By central differences of whole motions with two steps, one twice the other, whose combination is of
fourth order, or of second where a bound is near (a friction of 0); by how much they differ says how
far a derivative is to be trusted. No derivative is exact: each is one of the motion as it is
computed, with its steps of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, list_coordinates, take_axes
from .coupling import check_displacements
from .dynamics import DEFAULT_OPTIONS, DynamicsOptions, MotionCommands, ShapeHistory, simulate
from .elastic import check_tension_commands
from .kinematics import ContinuumRobot
from .profile import ROUND_OFF_MM
from .unknowns import RobotSetup, Unknown, change_setup, parse_unknowns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEP = 1e-2
"""Smaller step of the logarithm of a factor, of an angle [rad], and of other numbers."""

ROUGH = 0.05
"""Error of a derivative, by its own size, from which on it is not to be trusted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionSensitivity(Result):
    """Derivatives of a motion with respect to numbers of the robot.

    Parameters
    ----------
    history : ShapeHistory
        The motion.
    names, units : tuple of str
        Of the numbers (p,); a factor has no unit, and its derivative is by its logarithm.
    points : (k, s, 3, p) ndarray
        Derivatives of the stations' places over time, in the frame of the base [mm by unit].
    errors : (p,) ndarray
        Largest difference of the two differences that each is made of, by the largest derivative;
        of one that moves nothing by more than round-off (1e-9 mm), by that.
    """

    history: ShapeHistory = field(repr=False)
    names: tuple[str, ...]
    units: tuple[str, ...]
    points: Floats = field(repr=False)
    errors: Floats

    @property
    def tip(self) -> Floats:
        """Derivatives of the tip, shape (k, 3, p)."""
        return np.asarray(self.points[:, -1])

    @property
    def converged(self) -> bool:
        """Whether every derivative is to be trusted: its error is below 5 %."""
        return bool(np.all(self.errors <= ROUGH))

    @property
    def residual(self) -> float:
        """Largest of the errors."""
        return float(self.errors.max())

    @property
    def reason(self) -> str:
        """Which derivatives are not to be trusted; empty if all are."""
        rough = [name for name, error in zip(self.names, self.errors, strict=True) if error > ROUGH]
        return f"differences of two steps differ: {', '.join(rough)}" if rough else ""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is wrong with the motion."""
        return self.history.notes

    def to_dict(self) -> Json:
        """Return verdict, times and derivatives of the tip as plain values."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "notes": list(self.notes),
            "time_s": self.history.time.tolist(),
            "derivatives": {
                name: {"unit": unit, "error": float(error), "tip_mm": self.tip[..., k].tolist()}
                for k, (name, unit, error) in enumerate(
                    zip(self.names, self.units, self.errors, strict=True)
                )
            },
        }

    def list_columns(self) -> dict[str, Floats]:
        """Return the columns of `to_frame`: derivatives of the tip by time."""
        columns = {"time_s": self.history.time}
        for k, name in enumerate(self.names):
            columns |= list_coordinates(f"tip_by_{name}", self.tip[..., k])
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the size of the tip's derivatives over time."""
        axes = take_axes(ax, x="time [s]", y="tip by number [mm]")
        for k, name in enumerate(self.names):
            size = np.linalg.norm(self.tip[..., k], axis=1)
            axes.plot(self.history.time, size, label=name)
        axes.legend()
        return axes


def differentiate_motion(
    robot: ContinuumRobot | RobotSetup,
    times: ArrayLike,
    *,
    by: Sequence[str],
    options: DynamicsOptions = DEFAULT_OPTIONS,
    **commands: Unpack[MotionCommands],
) -> MotionSensitivity:
    """Return derivatives of a motion from rest under the first commands.

    Parameters
    ----------
    robot : ContinuumRobot or RobotSetup
        The robot; a setup has zeros, scale and play of its tendons as well.
    times, options, **commands
        As of `simulate`.
    by : sequence of str
        What is changed, as of `fit_robot`: ``sections.1.bending_stiffness``, ``tendons.*.offset``,
        ``motion.damping_time``.

    Returns
    -------
    MotionSensitivity

    Raises
    ------
    InputError
        If a name is unknown, or is of markers or the base.
    GeometryError
        If a motion that is needed does not come to the last time.
    """
    if isinstance(by, str) or not by:
        raise InputError(
            f"by is '{by}': it must be a sequence of names, such as ['{by or 'base'}']"
        )
    own = robot if isinstance(robot, RobotSetup) else RobotSetup.of(robot)
    setup = RobotSetup(own.robot, (), own.zeros, own.scale, own.backlash, options)
    unknowns = parse_unknowns(by, setup)
    for one in unknowns:
        if not one.moves_robot:
            raise InputError(f"'{one.name}' is not of the motion in the frame of the base")
    history = _move(setup, times, commands)
    points, errors = [], []
    for one in unknowns:
        (near, near_off), (far, far_off) = (
            _difference(setup, one, size, times, commands) for size in (STEP, 2.0 * STEP)
        )
        if near_off == far_off:
            found = (4.0 * near - far) / 3.0
        else:  # at a bound: without the error that is linear in where the middle is
            found = (far_off * near - near_off * far) / (far_off - near_off)
        points.append(found)
        most = max(float(np.abs(found).max()), ROUND_OFF_MM / STEP)
        errors.append(float(np.abs(near - far).max()) / most)
    return MotionSensitivity(
        history=history,
        names=tuple(one.name for one in unknowns),
        units=tuple("" if one.known.change == "factor" else one.known.unit for one in unknowns),
        points=np.stack(points, axis=-1),
        errors=np.array(errors),
    )


def _difference(
    setup: RobotSetup, one: Unknown, size: float, times: ArrayLike, commands: MotionCommands
) -> tuple[Floats, float]:
    """Return the difference of the points (k, s, 3) by a step each way, and where its middle is."""
    low, high, _ = one.limit(setup)
    up, down = min(size, high), max(-size, low)
    there, back = (
        _move(change_setup(setup, [one], np.array([step])), times, commands).points
        for step in (up, down)
    )
    return np.asarray((there - back) / (up - down)), 0.5 * (up + down)


def _move(setup: RobotSetup, times: ArrayLike, commands: MotionCommands) -> ShapeHistory:
    """Return the motion of a setup; commands come to its tendons by its zeros and play."""
    given, shape = commands.copy(), (len(np.asarray(times)), len(setup.robot.tendons))
    tensions, displacements = given.get("tensions"), given.get("displacements")
    if tensions is not None:
        pulls = check_tension_commands(setup.robot, tensions)
        given["tensions"] = setup.convert(np.array(np.broadcast_to(pulls, shape)))
    if displacements is not None:
        moves = check_displacements(setup.robot, displacements)
        given["displacements"] = setup.convert(np.array(np.broadcast_to(moves, shape)))
    options = setup.dynamics or DEFAULT_OPTIONS
    found = simulate(setup.robot, times, options=options, **given)
    if not found.converged:
        raise GeometryError(f"a motion that the derivatives need ends early: {found.reason}")
    return found
