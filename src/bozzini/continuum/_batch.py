"""What the models for parallel tendons share: bends from displacements, limits, the result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coupling import BendSolution, Coupling, check_displacements, reason_array
from .robot import ContinuumRobot
from .shape import Shape

# What every model asks of a shape before it counts: lengths met, and the robot's limits kept.

Verdict = tuple[NDArray[np.bool_], NDArray[np.str_]]

MOST_CONTRAST = 1e6
"""Ratio of sections' stiffnesses up to which digits suffice."""

EVEN = 1e-3
"""By how much a curvature that counts as even may differ."""

GRAIN = 1e-11
"""Error of a tendon's length that is round-off, against the robot's."""


@dataclass(frozen=True)
class _Limit:
    """Values that must lie in a range, and what to say of one that does not, by its place."""

    values: Floats
    low: float
    high: float
    tell: Callable[[tuple[int, ...]], str]


def _limit_travel(robot: ContinuumRobot, index: int, moved: Floats) -> _Limit:
    low, high = (float(value) for value in robot.tendon_travel[index])

    def tell(place: tuple[int, ...]) -> str:
        return (
            f"tendon '{robot.tendon_names[index]}' is moved {moved[place]:.4g} mm: its travel is "
            f"[{low:g}, {high:g}] mm"
        )

    return _Limit(moved, low, high, tell)


def _limit_bend(robot: ContinuumRobot, index: int, bends: Floats, round_off: float) -> _Limit:
    most = robot.sections[index].max_bend

    def tell(place: tuple[int, ...]) -> str:
        return (
            f"{robot.section_label(index)} would bend {math.degrees(bends[place]):.4g} deg: its "
            f"largest bend is {math.degrees(most):.4g} deg"
        )

    return _Limit(bends, 0.0, most * (1.0 + round_off), tell)


def _limit_curvature(
    robot: ContinuumRobot, index: int, bends: Floats, curvatures: Floats, round_off: float
) -> _Limit:
    """The curve may not be tighter than the body is thick."""
    section = robot.sections[index]

    def tell(place: tuple[int, ...]) -> str:
        bend, curvature = float(bends[place]), float(curvatures[place])
        words = f"{robot.section_label(index)} would bend {math.degrees(bend):.4g} deg"
        discs = f"its discs, of radius {section.radius:g} mm, meet"
        if curvature * section.length <= bend * (1.0 + EVEN):
            return f"{words}: {discs} at {math.degrees(section.length / section.radius):.4g} deg"
        return f"{words}, to a radius of {1.0 / curvature:.4g} mm where it is tightest: {discs}"

    return _Limit(curvatures, 0.0, (1.0 + round_off) / section.radius, tell)


def check_limits(
    robot: ContinuumRobot,
    displacements: Floats,
    bends: Floats,
    verdict: Verdict,
    *,
    curvatures: Floats | None = None,
    round_off: float = 1e-9,
) -> Verdict:
    """Mark what passes the drives' travel, the sections' largest bends, or lets discs meet.

    `bends` (..., m) are the angles through which the sections bend [rad], and `curvatures`
    (..., m) the largest of each [1/mm], unless it is the same all along. `verdict` is whether
    there is a shape so far, and why not.
    """
    converged, reason = verdict
    lengths = np.asarray([section.length for section in robot.sections])
    sharp = bends / lengths if curvatures is None else curvatures
    limits = [_limit_travel(robot, k, displacements[..., k]) for k in range(len(robot.tendons))]
    for k in range(len(robot.sections)):
        limits.append(_limit_bend(robot, k, bends[..., k], round_off))
        limits.append(_limit_curvature(robot, k, bends[..., k], sharp[..., k], round_off))
    reasons: dict[tuple[int, ...], str] = {}
    for limit in limits:
        values = limit.values
        if not values.size or (values.min() >= limit.low and values.max() <= limit.high):
            continue
        bad = converged & ((values < limit.low) | (values > limit.high))
        for index in np.argwhere(bad):
            place = tuple(int(i) for i in index)
            reasons.setdefault(place, limit.tell(place))
    if not reasons:
        return verdict
    passed = reason_array(reason.shape, reasons)
    return converged & (passed == ""), np.where(converged, passed, reason)


def check_numbers(
    robot: ContinuumRobot, frames: Floats, residual: Floats, tolerance: float, verdict: Verdict
) -> Verdict:
    """Mark shapes that are not finite, or miss their command by more than the tolerance [mm]."""
    converged, reason = verdict
    finite = np.asarray(np.isfinite(frames).all(axis=(-3, -2, -1)))
    met = residual <= 1.1 * tolerance + GRAIN * robot.length
    bad = converged & ~(finite & met)
    reasons: dict[tuple[int, ...], str] = {}
    for index in np.argwhere(bad):
        place = tuple(int(i) for i in index)
        missed = f"the shape that was found misses the command by {residual[place]:.3g} mm"
        words = missed if finite[place] else "the shape that was found is not finite"
        reasons[place] = words + explain_contrast(robot)
    if not reasons:
        return verdict
    passed = reason_array(reason.shape, reasons)
    return converged & ~bad, np.where(bad, passed, reason)


def explain_contrast(robot: ContinuumRobot) -> str:
    """Return what to add to a reason where stiffnesses differ too much; else nothing."""
    values = [
        value
        for section in robot.sections
        for value in (section.bending_stiffness, section.torsional_stiffness)
    ]
    ratio = max(values) / min(values)
    if ratio <= MOST_CONTRAST:
        return ""
    return (
        f"; the backbone's stiffnesses differ by a factor of {ratio:.2g}, and from "
        f"{MOST_CONTRAST:g} on digits may not suffice"
    )


Floats = NDArray[np.float64]


class ParallelModel:
    """Base of the models in which displacements are linear in the bends of the sections."""

    name = ""

    def __init__(self, robot: ContinuumRobot, *, tolerance: float = 1e-6) -> None:
        self.coupling = Coupling(robot, model=self.name, tolerance=tolerance)

    @property
    def robot(self) -> ContinuumRobot:
        """The robot."""
        return self.coupling.robot

    @property
    def notes(self) -> tuple[str, ...]:
        """Bends that no tendon controls, a sentence each; least elastic energy decides them."""
        return self.coupling.open_directions()

    def solve(self, displacements: ArrayLike) -> BendSolution:
        """Return the bends of the sections under `displacements`, shape (..., t) [mm].

        Raises
        ------
        InputError
            If there is not one finite displacement for each tendon.
        """
        commanded = check_displacements(self.robot, displacements)
        found = self.coupling.solve(commanded)
        bends = np.hypot(found.bends[..., 0], found.bends[..., 1])
        verdict = (found.converged, found.reason)
        converged, reason = check_limits(self.robot, commanded, bends, verdict)
        return dataclasses.replace(found, converged=converged, reason=reason)

    def _make_shape(
        self,
        displacements: ArrayLike,
        found: BendSolution,
        *,
        arc_length: Floats,
        disc_arc_length: Floats,
        frames: Floats,
    ) -> Shape:
        robot = self.robot
        flat = found.bends.reshape(*found.bends.shape[:-2], 2 * len(robot.sections))
        return Shape(
            robot=robot,
            model=self.name,
            arc_length=arc_length,
            disc_arc_length=disc_arc_length,
            frames=frames,
            displacements=check_displacements(robot, displacements).copy(),
            tendon_lengths=robot.tendon_ends - flat @ self.coupling.matrix.T,
            section_parameters=found.bends,
            tensions=np.empty((*found.residual.shape, 0)),
            slack=found.slack,
            residual=found.residual,
            iterations=np.zeros(found.residual.shape, dtype=np.int64),
            converged=found.converged,
            reason=found.reason,
        )
