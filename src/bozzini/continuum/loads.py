"""Loads on a robot: forces and moments at points, forces along it, and weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_fields, check_word, quantity, show_apart, show_value
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .checks import check_values, take_items
from .profile import ROUND_OFF_MM
from .robot import ZERO, RobotDesign, Vector

LoadFrame = Literal["base", "world", "body"]
"""Axes in which a load is given; those of the body turn with the cross-section: a follower."""

DEAD, BODY = 0, 1
"""Codes of packed loads: of one direction in the base's frame, and of one in the body's."""


@dataclass(frozen=True, kw_only=True)
class PointLoad(Shown):
    """A force and a moment on one cross-section.

    Parameters
    ----------
    arc_length : float, optional
        Where [mm]; the tip unless given.
    force : (x, y, z)
        Force at the backbone [N].
    moment : (x, y, z)
        Moment [N mm].
    frame : {"base", "world", "body"}
        Axes of both; those of the body turn with the cross-section.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    arc_length: float | None = quantity("length", "Where it acts.", low=0.0, default=None)
    force: Vector = quantity("force", "Force.", default=ZERO)
    moment: Vector = quantity("moment", "Moment.", default=ZERO)
    frame: LoadFrame = "base"

    def __post_init__(self) -> None:
        check_fields(self, "load's ", skip=("force", "moment"))
        for name, unit in (("force", "N"), ("moment", "N mm")):
            vector = check_values(f"load's {name}", getattr(self, name), (3,), unit=unit)
            object.__setattr__(self, name, tuple(vector.tolist()))
        check_word("load's frame", self.frame, get_args(LoadFrame))


@dataclass(frozen=True, kw_only=True)
class LineLoad(Shown):
    """A force per length along a part of the backbone.

    Parameters
    ----------
    force : (x, y, z)
        Force per length [N/mm].
    start, end : float
        Arc lengths where it starts and ends [mm]; the whole robot unless given.
    frame : {"base", "world", "body"}
        Axes of the force; those of the body turn with the cross-sections.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    force: Vector = quantity("line force", "Force per length.")
    start: float = quantity("length", "Where it starts.", low=0.0, default=0.0)
    end: float | None = quantity("length", "Where it ends.", low=0.0, low_open=True, default=None)
    frame: LoadFrame = "base"

    def __post_init__(self) -> None:
        check_fields(self, "load's ", skip=("force",))
        vector = check_values("load's force", self.force, (3,), unit="N/mm")
        object.__setattr__(self, "force", tuple(vector.tolist()))
        check_word("load's frame", self.frame, get_args(LoadFrame))
        if self.end is not None and self.end <= self.start:
            shown = show_apart(self.end, self.start)
            raise InputError(
                f"load's end is {shown[0]} mm: it must lie after its start, {shown[1]} mm"
            )


Load = PointLoad | LineLoad


class PackedLoads(NamedTuple):
    """Loads and weights as arrays for kernels, in the base's frame or the body's.

    Attributes
    ----------
    points : (p,) ndarray
        Arc lengths of point loads [mm], not sorted; discs with weight are among them.
    forces, moments : (p, 3) ndarray
        Forces [N] and moments [N mm] of point loads.
    frames : (p,) ndarray of int
        `DEAD`, in the base's frame, or `BODY`.
    line_spans : (l, 2) ndarray
        Arc lengths where line loads start and end [mm].
    line_forces : (l, 3) ndarray
        Forces per length [N/mm].
    line_frames : (l,) ndarray of int
        As `frames`.
    down : (3,) ndarray
        Direction of weight in the base's frame; zero if the backbone has none.
    """

    points: Floats
    forces: Floats
    moments: Floats
    frames: NDArray[np.int64]
    line_spans: Floats
    line_forces: Floats
    line_frames: NDArray[np.int64]
    down: Floats

    @property
    def is_empty(self) -> bool:
        """Whether there is no load and no weight."""
        return not (self.points.size or self.line_spans.size or self.down.any())

    def line_forces_at(self, robot: RobotDesign, arc_length: ArrayLike) -> tuple[Floats, Floats]:
        """Return the forces per length, weight included, at arc lengths.

        Parameters
        ----------
        robot : RobotDesign
            The robot of these loads.
        arc_length : array_like, shape (...)
            Where [mm]; middles of steps, for at the ends of a load its force jumps.

        Returns
        -------
        dead, body : (..., 3) ndarray
            Forces per length [N/mm] in the base's frame, and in that of the cross-section.
        """
        places = check_array("arc_length", arc_length)
        dead = robot.weight_at(places)[..., None] * self.down
        body = np.zeros_like(dead)
        for (start, end), force, code in zip(
            self.line_spans, self.line_forces, self.line_frames, strict=True
        ):
            here = ((places > start) & (places <= end))[..., None]
            (body if code == BODY else dead)[...] += np.where(here, force, 0.0)
        return dead, body


def check_loads(robot: RobotDesign, loads: object) -> tuple[Load, ...]:
    """Return loads as a tuple, their places checked against the robot.

    Raises
    ------
    InputError
        If one is no load, or is not on the robot.
    """
    found = take_items("loads", loads, "a sequence of PointLoad and LineLoad")
    for index, load in enumerate(found):
        if not isinstance(load, Load):
            raise InputError(
                f"loads hold {show_value(load)}: each must be a PointLoad or a LineLoad"
            )
        point = isinstance(load, PointLoad)
        place = load.arc_length if isinstance(load, PointLoad) else load.end
        if place is not None and place > robot.length + ROUND_OFF_MM:
            shown = show_apart(place, robot.length)
            raise InputError(
                f"loads[{index}] {'arc_length' if point else 'end'} is {shown[0]} mm: it must lie "
                f"in [0, {shown[1]}] mm, the robot's length"
            )
        if isinstance(load, LineLoad) and load.start >= robot.length:
            shown = show_apart(load.start, robot.length)
            raise InputError(
                f"loads[{index}] start is {shown[0]} mm: it must lie in "
                f"[0, {shown[1]}) mm, the robot's length"
            )
    return found


def pack_loads(
    robot: RobotDesign,
    loads: Sequence[Load] = (),
    *,
    tip_force: Vector = ZERO,
    tip_moment: Vector = ZERO,
    distributed_force: Vector = ZERO,
) -> PackedLoads:
    """Return loads and the robot's weights as arrays.

    Parameters
    ----------
    robot : RobotDesign
        The robot, whose base's pose and weights count.
    loads : sequence of PointLoad or LineLoad
        Loads.
    tip_force, tip_moment : (x, y, z)
        At the tip in the base's frame [N], [N mm].
    distributed_force : (x, y, z)
        Along the whole backbone in the base's frame [N/mm].

    Raises
    ------
    InputError
        If a load is not on the robot.
    """
    given = check_loads(robot, loads)
    points = [load for load in given if isinstance(load, PointLoad)]
    lines = [load for load in given if isinstance(load, LineLoad)]
    if any(tip_force) or any(tip_moment):
        points.append(PointLoad(force=tip_force, moment=tip_moment))
    if any(distributed_force):
        lines.append(LineLoad(force=distributed_force))
    into_base = robot.base_frame[:3, :3].T
    down = -into_base[:, 2]
    for place, weight in zip(robot.disc_arc_length, robot.disc_weights, strict=True):
        if weight:
            points.append(PointLoad(arc_length=place, force=(0.0, 0.0, -weight), frame="world"))

    def turn(vector: Vector, frame: LoadFrame) -> Floats:
        return into_base @ vector if frame == "world" else np.asarray(vector)

    return PackedLoads(
        points=_array([_place(load.arc_length, robot) for load in points]),
        forces=_array([turn(load.force, load.frame) for load in points], 3),
        moments=_array([turn(load.moment, load.frame) for load in points], 3),
        frames=_encode(points),
        line_spans=_array([(load.start, _place(load.end, robot)) for load in lines], 2),
        line_forces=_array([turn(load.force, load.frame) for load in lines], 3),
        line_frames=_encode(lines),
        down=down if robot.has_line_weight else np.zeros(3),
    )


def _place(arc_length: float | None, robot: RobotDesign) -> float:
    return robot.length if arc_length is None else min(arc_length, robot.length)


def _array(rows: Sequence[object], *shape: int) -> Floats:
    return np.asarray(rows, dtype=np.float64).reshape(len(rows), *shape)


def _encode(loads: Sequence[Load]) -> NDArray[np.int64]:
    return np.asarray([BODY if load.frame == "body" else DEAD for load in loads], dtype=np.int64)
