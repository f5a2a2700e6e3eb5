"""What the models for parallel tendons share: bends from displacements, limits, the result."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._limits import check_limits
from .coupling import BendSolution, Coupling, check_displacements
from .robot import ContinuumRobot
from .shape import Shape

__all__ = ["ParallelModel"]

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
