"""An end-effector as a robot: pressures to a pose, and a place of the tip to pressures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from ..checks import check_kind
from ..errors import InputError
from ..muscle import MODELS, MuscleModel
from ..results import show_briefly
from .design import PRESET_MODELS, effector_preset
from .inverse import EffectorInverse, solve_inverse
from .model import EffectorModel
from .motion import EffectorMotion, MotionState
from .pose import EffectorPose, PoseMethod, pose
from .section import MusclePull, take_pulls
from .workspace import Workspace, workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .fit import EffectorFit, EffectorFitOptions
    from .measured import EffectorMeasurements
    from .simulation import EffectorTrack
    from .view import TipView


@dataclass(frozen=True)
class Effector(EffectorModel):
    """An end-effector: a design and a model of its muscles, with forward and inverse kinematics.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    model : callable
        Gives a `MuscleModel` for a `Muscle`; `EnergyMuscle` by default.
    motion : EffectorMotion
        How it follows its commands in time, for `simulate`; at once by default.
    pulls : tuple of MusclePull, optional
        Laws of the muscles' pulls, in place of the model, for `simulate`: all muscles are in
        balance on an arc then. `forward` and `inverse` take models only.

    Raises
    ------
    InputError
        As `EffectorModel` does, or if there is not a law for each muscle.
    """

    motion: EffectorMotion = field(default_factory=EffectorMotion)
    pulls: tuple[MusclePull, ...] | None = None
    __repr__ = show_briefly

    def __post_init__(self) -> None:
        super().__post_init__()
        check_kind("motion", self.motion, EffectorMotion)
        if self.pulls is not None:
            object.__setattr__(self, "pulls", take_pulls(self.pulls, self.design.names))

    def _make_models(self) -> tuple[MuscleModel, ...]:
        return super()._make_models() if self.pulls is None else ()

    def __reduce__(self) -> tuple[type[Effector], tuple[object, ...]]:
        """Pickle what it was made of; see `EffectorModel`."""
        return type(self), (self.design, self.model, self.motion, self.pulls)

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
        self._demand_model("forward")
        return pose(self, pressures, method=method, order=order)

    def inverse(self, tip: ArrayLike) -> EffectorInverse:
        """Return the pressures for lateral places of the tip (..., 2) [mm]; see `solve_inverse`."""
        self._demand_model("inverse")
        return solve_inverse(self, tip)

    def workspace(self, *, directions: int = 360, samples: int = 2000) -> Workspace:
        """Return where the tip can go; see `bozzini.effector.workspace`."""
        self._demand_model("workspace")
        return workspace(self, directions=directions, samples=samples)

    def _demand_model(self, what: str) -> None:
        if self.pulls is not None:
            raise InputError(
                f"{what} takes a model of the muscles, and this end-effector has pulls of its own: "
                "simulate it"
            )

    def simulate(
        self,
        times: ArrayLike,
        pressures: ArrayLike | Mapping[str, ArrayLike],
        *,
        initial: MotionState | None = None,
    ) -> EffectorTrack:
        """Return the motion under pressures commanded at times; see `simulate_effector`."""
        from .simulation import simulate_effector

        return simulate_effector(self, times, pressures=pressures, initial=initial)

    def fit(
        self,
        data: EffectorMeasurements,
        *,
        free: Sequence[str],
        view: TipView | None = None,
        options: EffectorFitOptions | None = None,
    ) -> EffectorFit:
        """Fit its numbers to measurements; see `bozzini.effector.fit_effector`."""
        from .fit import fit_effector

        return fit_effector(self, data, free=free, view=view, options=options)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the workspace, seen along the axis, and return the axes."""
        return self.workspace().plot(ax)
