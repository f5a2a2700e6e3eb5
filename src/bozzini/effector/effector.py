"""An end-effector as a robot: pressures to a pose, and a place of the tip to pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from ..muscle import MODELS
from .design import PRESET_MODELS, effector_preset
from .inverse import EffectorInverse, solve_inverse
from .model import EffectorModel
from .pose import EffectorPose, PoseMethod, pose
from .workspace import Workspace, workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Effector(EffectorModel):
    """An end-effector: a design and a model of its muscles, with forward and inverse kinematics.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    model : callable
        Gives a `MuscleModel` for a `Muscle`; `EnergyMuscle` by default.

    Raises
    ------
    InputError
        As `EffectorModel` does.
    """

    @classmethod
    def from_preset(cls, name: str, **overrides: object) -> Effector:
        """Return an end-effector of `EFFECTOR_PRESETS`, with the model that it is made for.

        Raises
        ------
        InputError
            If there is no such preset, or a field or its value is not legal.
        """
        design = effector_preset(name, **overrides)
        if name not in PRESET_MODELS:
            return cls(design)
        model, choices = PRESET_MODELS[name]
        return cls(design, partial(MODELS[model], **choices))

    def forward(
        self,
        pressures: ArrayLike | Mapping[str, ArrayLike],
        *,
        method: PoseMethod = "superposition",
        order: Sequence[str] | None = None,
    ) -> EffectorPose:
        """Return the pose under a pressure for each muscle [MPa]; see `bozzini.effector.pose`."""
        return pose(self, pressures, method=method, order=order)

    def inverse(self, tip: ArrayLike) -> EffectorInverse:
        """Return the pressures for lateral places of the tip (..., 2) [mm]; see `solve_inverse`."""
        return solve_inverse(self, tip)

    def workspace(self, *, directions: int = 360, samples: int = 2000) -> Workspace:
        """Return where the tip can go; see `bozzini.effector.workspace`."""
        return workspace(self, directions=directions, samples=samples)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the workspace, seen along the axis, and return the axes."""
        return self.workspace().plot(ax)
