"""Constant curvature: every section an arc (Gravagne and Walker; Webster and Jones 2010).

A section is described by ``(theta cos(phi), theta sin(phi))``, its bend and the plane of it, which
is smooth where the section is straight.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_integer, show_apart
from ..errors import InputError
from ..numeric.arrays import Floats
from .coupling import ParallelModel, coupling_matrix
from .kernels.arc import fill_arc_frames, fill_tip_jacobians
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .shape import Shape


@dataclass(frozen=True)
class ArcModel(ParallelModel):
    """Shape from displacements, each section an arc of constant curvature.

    Bends solve the displacements of all tendons in the least-squares sense; what they leave open
    takes least elastic energy, and a cable that would have to push goes slack.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].
    between : int
        Stations between two discs.

    Raises
    ------
    GeometryError
        If a tendon is not parallel or ends inside its section, or there is none.
    """

    name = "arc"

    between: int = field(default=1, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_integer("between", self.between, low=0, high=1000)

    @cached_property
    def arc_length(self) -> Floats:
        """Stations [mm], shape (k,)."""
        return self.robot.stations(between=self.between)

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements; see `ContinuumModel.shape`.

        They have not converged where tendons would have to stretch or a limit is passed.
        """
        found = self.solve(displacements)
        frames = _frames(self.robot, found.bends, self.arc_length)
        return self.answer(found, arc_length=self.arc_length, frames=frames)


def bend_vectors(robot: RobotDesign, displacements: ArrayLike) -> Floats:
    """Return the bends of the sections under displacements.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    displacements : array_like, shape (..., t)
        How far each tendon is pulled [mm].

    Returns
    -------
    (..., m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].

    Raises
    ------
    GeometryError
        If a tendon is not parallel, would have to stretch, or a limit is passed.
    InputError
        If there is not one finite displacement for each tendon.
    """
    return ArcModel(robot).shape(displacements).require().section_parameters


def displacements_for(robot: RobotDesign, bends: ArrayLike) -> Floats:
    """Return the tendon displacements that bend the sections so, in closed form.

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    bends : array_like, shape (..., m, 2)
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].

    Returns
    -------
    (..., t) ndarray
        Displacements [mm], ``a sum(theta_i cos(psi - phi_i))`` over the sections passed.

    Raises
    ------
    GeometryError
        If a tendon is not parallel.
    InputError
        If `bends` has another shape or is not finite.
    """
    checked = _check_bends(robot, bends)
    flat = checked.reshape(*checked.shape[:-2], 2 * len(robot.sections))
    return np.asarray(flat @ coupling_matrix(robot).T)


def arc_frames(
    robot: RobotDesign, bends: ArrayLike, *, arc_length: ArrayLike | None = None
) -> Floats:
    """Return frames along a robot of arcs.

    Parameters
    ----------
    robot : RobotDesign
        The robot; its tendons do not matter.
    bends : array_like, shape (..., m, 2)
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    arc_length : array_like, shape (k,), optional
        Where [mm], increasing; the base and all discs unless given.

    Returns
    -------
    (..., k, 4, 4) ndarray
        Frames in the base's frame [mm].

    Raises
    ------
    InputError
        If an array has another shape, is not finite, or an arc length is outside the robot.
    """
    checked = _check_bends(robot, bends)
    places = robot.stations() if arc_length is None else check_array("arc_length", arc_length)
    if places.ndim != 1 or not places.size:
        raise InputError(f"arc_length has shape {places.shape}: it must be (k,), k at least 1")
    if not (places.min() >= -ROUND_OFF_MM and places.max() <= robot.length + ROUND_OFF_MM):
        shown = show_apart(places.max(), robot.length)
        raise InputError(
            f"arc_length spans [{places.min():g}, {shown[0]}] mm: it must lie in [0, {shown[1]}] mm"
        )
    if np.any(np.diff(places) < 0.0):
        raise InputError("arc_length must not decrease")
    return _frames(robot, checked, places)


def jacobian(robot: RobotDesign, bends: ArrayLike) -> Floats:
    """Return how the tip moves and turns with the bends, the geometric Jacobian.

    Parameters
    ----------
    robot : RobotDesign
        The robot; its tendons do not matter.
    bends : array_like, shape (..., m, 2)
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].

    Returns
    -------
    (..., 6, 2 m) ndarray
        In the base's frame: velocity of the tip [mm/rad], then angular velocity, for each bend
        in the order of ``bends.ravel()``. The velocities under tendons are this times the
        velocities of the bends.

    Raises
    ------
    InputError
        If `bends` has another shape or is not finite.
    """
    checked = _check_bends(robot, bends)
    flat = np.ascontiguousarray(checked.reshape(-1, *checked.shape[-2:]))
    lengths = robot.section_lengths
    tips = np.empty((len(flat), 4, 4))
    out = np.empty((len(flat), 6, 2 * len(lengths)))
    fill_tip_jacobians(lengths, flat, tips, out)
    return out.reshape(*checked.shape[:-2], *out.shape[1:])


def _frames(robot: RobotDesign, bends: Floats, arc_length: Floats) -> Floats:
    flat = np.ascontiguousarray(bends.reshape(-1, *bends.shape[-2:]))
    lengths = robot.section_lengths
    owner = robot.section_at(arc_length)
    share = np.clip((arc_length - robot.section_starts[owner]) / lengths[owner], 0.0, 1.0)
    frames = np.empty((len(flat), len(arc_length), 4, 4))
    fill_arc_frames(lengths, owner, share, flat, frames)
    return frames.reshape(*bends.shape[:-2], *frames.shape[1:])


def _check_bends(robot: RobotDesign, bends: ArrayLike) -> Floats:
    sections = len(robot.sections)
    array = check_array("bends", bends)
    if array.shape[-2:] != (sections, 2):
        raise InputError(f"bends has shape {array.shape}: it must be (..., {sections}, 2)")
    if not np.isfinite(array).all():
        raise InputError("bends has values that are not finite (NaN or infinite)")
    return array
