"""What the models for parallel tendons share: bends from displacements, limits, the result."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .coupling import BendSolution, Coupling, check_displacements, reason_array
from .robot import ContinuumRobot
from .shape import Shape

__all__ = ["ParallelModel"]

Floats = NDArray[np.float64]

ROUND_OFF = 1e-9
"""Share of a limit that is round-off."""


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
        return _check_limits(self.robot, commanded, found)

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


@dataclass(frozen=True)
class _Limit:
    """Values that must lie in a range, and what to say around one that does not."""

    values: Floats
    low: float
    high: float
    before: str
    after: str


def _limits(robot: ContinuumRobot, commanded: Floats, found: BendSolution) -> Iterator[_Limit]:
    for index, name in enumerate(robot.tendon_names):
        low, high = (float(value) for value in robot.tendon_travel[index])
        after = f"mm: its travel is [{low:g}, {high:g}] mm"
        yield _Limit(commanded[..., index], low, high, f"tendon '{name}' is moved", after)
    bends = np.degrees(np.hypot(found.bends[..., 0], found.bends[..., 1]))
    for index, section in enumerate(robot.sections):
        before = f"{robot.section_label(index)} would bend"
        most = math.degrees(section.max_bend)
        yield _Limit(
            bends[..., index],
            0.0,
            most * (1.0 + ROUND_OFF),
            before,
            f"deg: its largest bend is {most:.4g} deg",
        )
        # The curve is as tight as the body is thick.
        meet = math.degrees(section.length / section.radius)
        yield _Limit(
            bends[..., index],
            0.0,
            meet,
            before,
            f"deg: its discs, of radius {section.radius:g} mm, meet at {meet:.4g} deg",
        )


def _check_limits(robot: ContinuumRobot, commanded: Floats, found: BendSolution) -> BendSolution:
    """Mark what passes the drives' travel, the sections' largest bends, or lets discs meet."""
    reasons: dict[tuple[int, ...], str] = {}
    for limit in _limits(robot, commanded, found):
        values = limit.values
        if not values.size or (values.min() >= limit.low and values.max() <= limit.high):
            continue
        bad = found.converged & ((values < limit.low) | (values > limit.high))
        for index in np.argwhere(bad):
            place = tuple(int(i) for i in index)
            words = f"{limit.before} {values[place]:.4g} {limit.after}"
            reasons.setdefault(place, words)
    if not reasons:
        return found
    reason = reason_array(found.reason.shape, reasons)
    return dataclasses.replace(
        found,
        reason=np.where(found.converged, reason, found.reason),
        converged=found.converged & (reason == ""),
    )
