"""Bends and tendon displacements that bring a robot of arcs to a wanted tip, pose or curve.

Sections have fixed lengths, so there is no closed form for two or more: damped least squares
(Levenberg and Marquardt) over ``(theta cos(phi), theta sin(phi))``, which is smooth through the
straight section, with analytic derivatives. Every step is the best one inside the limits of bends
and tendon travel, not one that is cut back to them.

A target counts as out of reach when no start came near; that is a proof only where the reason
says that the target is further away than the backbone is long, and for one section.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ._inverse_search import InverseResult, Search
from ._places import check_directions, check_frame, check_places, check_values
from .robot import ContinuumRobot
from .tendon import GRAIN

__all__ = ["InverseResult", "solve_curve", "solve_pose", "solve_tip"]

Floats = NDArray[np.float64]


def solve_tip(
    robot: ContinuumRobot,
    target: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    starts: int = 16,
    tolerance: float = 1e-6,
    angle_tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Bring the tip to a place, and if asked to look in a direction.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    target : array_like, shape (3,)
        Place in the base's frame [mm].
    direction : array_like, shape (3,), optional
        Where the tip's tangent shall point, of any length.
    initial : array_like, shape (m, 2), optional
        Bends to start from [rad]; they are moved inside the limits if they are not.
    starts : int
        Starts that may be tried, in [1, 256]: `initial`, then an arc through the target, then the
        nearest of a fixed set of bends.
    tolerance : float
        Distance [mm] at which the tip has arrived.
    angle_tolerance : float
        Angle [rad] at which the tip looks there.
    smallest_bends : bool
        Whether to use the freedom that is left for bends whose squares have a small sum.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    place = check_values("target", target, (3,), unit="mm")
    axes = np.empty((0, 3))
    if direction is not None:
        way = check_directions("direction", direction)
        if way.shape != (3,):
            raise InputError(f"direction has shape {way.shape}: it must be (3,)")
        axes = way[None]
    return Search.of_tip(robot, place, axes).run(
        initial, starts, tolerance, angle_tolerance, smallest_bends=smallest_bends
    )


def solve_pose(
    robot: ContinuumRobot,
    target: ArrayLike,
    *,
    initial: ArrayLike | None = None,
    starts: int = 32,
    tolerance: float = 1e-6,
    angle_tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Bring the tip's frame to a pose.

    A pose has six freedoms and a section two: with fewer than three sections only special poses
    can be reached. Where the pose is not reached, an angle of one radian counts like a distance
    of the robot's length by pi.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    target : array_like, shape (4, 4)
        Frame in the base's frame [mm]: columns x, y, tangent, place.
    initial, starts, tolerance, angle_tolerance, smallest_bends
        As of `solve_tip`.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range, or `target` is no frame.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    frame = check_values("target", target, (4, 4))
    check_frame("target", frame)
    axes = np.ascontiguousarray(frame[:3, :3].T[[2, 0, 1]])
    return Search.of_tip(robot, frame[:3, 3], axes).run(
        initial, starts, tolerance, angle_tolerance, smallest_bends=smallest_bends
    )


def solve_curve(
    robot: ContinuumRobot,
    points: ArrayLike,
    *,
    arc_length: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    initial: ArrayLike | None = None,
    starts: int = 4,
    tolerance: float = 1e-6,
    smallest_bends: bool = False,
) -> InverseResult:
    """Lay the whole backbone along a curve, with the least sum of squared distances.

    A curve that is not made of arcs of the sections' lengths is not met exactly: give the
    tolerance that the task allows, or look at `residual`.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    points : array_like, shape (k, 3)
        Points in the base's frame [mm], from base to tip.
    arc_length : array_like, shape (k,), optional
        Arc lengths of the backbone that belong to them [mm]; unless given, the length of the
        line through the base and the points up to each.
    weights : array_like, shape (k,), optional
        Weight of each point's distance, 1 unless given.
    initial, starts, smallest_bends
        As of `solve_tip`.
    tolerance : float
        Distance [mm] within which every point must lie.

    Returns
    -------
    InverseResult

    Raises
    ------
    InputError
        If an input has another shape or is outside its range, or the curve is longer than the
        robot.
    GeometryError
        If the robot's tendons are not parallel, or its limits leave no shape at all.
    """
    places = np.ascontiguousarray(check_places("points", points))
    if places.ndim != 2 or not len(places):
        raise InputError(f"points has shape {places.shape}: it must be (k, 3), k at least 1")
    if arc_length is None:
        steps = np.diff(places, axis=0, prepend=np.zeros((1, 3)))
        along = np.cumsum(np.linalg.norm(steps, axis=1))
    else:
        along = check_values("arc_length", arc_length, (len(places),), unit="mm")
    if along.min() < -GRAIN or along.max() > robot.length * (1.0 + 1e-9):
        raise InputError(
            f"arc_length of the points spans [{along.min():.6g}, {along.max():.6g}] mm: it must "
            f"lie in [0, {robot.length:g}] mm, the robot's length"
        )
    heavy = np.ones(len(places))
    if weights is not None:
        heavy = check_values("weights", weights, (len(places),))
        if not (heavy.min() >= 0.0 and heavy.max() > 0.0):
            raise InputError(f"weights has {heavy.min():g}: none may be negative, nor all 0")
    return Search.of_curve(robot, places, along, heavy).run(
        initial, starts, tolerance, 1.0, smallest_bends=smallest_bends
    )
