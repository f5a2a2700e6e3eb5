"""A continuum robot with its forward and inverse kinematics."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_kind, take_named
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import show_briefly
from .arc import ArcModel
from .calibration import RobotCalibration, convert_commands
from .coupling import check_displacements, find_crooked
from .elastic import ElasticModel
from .elastic_inverse import solve_elastic
from .gradients import ShapeJacobian
from .inverse import (
    ContinuumInverse,
    InverseOptions,
    check_pose_target,
    check_tip_target,
    solve_curve,
    solve_pose,
    solve_tip,
)
from .model import ContinuumModel, list_features
from .models import CONTINUUM_MODELS
from .robot import RobotDesign
from .shape import Shape
from .workspace import ContinuumWorkspace, measure_workspace, sample_workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOADS = ("tip_force", "tip_moment", "distributed_force", "loads")
"""Options that only a model with loads has."""


@dataclass(frozen=True)
class ContinuumRobot(RobotDesign):
    """A robot of sections in series, base first; see `RobotDesign` for its base and its rest.

    Parameters
    ----------
    sections : sequence of Section
        At least one, from base to tip.
    name : str
        Name of the robot.
    base_position : (x, y, z)
        Where the base stands in the world [mm].
    base_rotation : (x, y, z) or (3, 3) array_like
        How the base is turned in the world: a rotation vector [rad], or a matrix whose columns
        are the base's axes; kept as a vector.

    Raises
    ------
    InputError
        If names are used twice, a tendon does not end in its section or leaves the body, or the
        base's pose is none.
    """

    # Holds mappings: equal robots have equal hashes without it.
    calibration: RobotCalibration | None = field(default=None, kw_only=True, hash=False)
    __repr__ = show_briefly

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.calibration is not None:
            check_kind("calibration", self.calibration, RobotCalibration)
            self.calibration.order_zeros(self.tendon_names)
            band = self.calibration.band
            if band is not None and len(band.sections) != len(self.sections):
                raise InputError(
                    f"the calibration's band has {len(band.sections)} sections: the robot has "
                    f"{len(self.sections)}"
                )

    def to_displacements(self, commands: ArrayLike, *, in_time: bool = False) -> Floats:
        """Return the displacements that commands of the tendons come to.

        Parameters
        ----------
        commands : array_like, shape (..., t)
            Displacements as they are commanded [mm]; those of a robot without a calibration.
        in_time : bool
            Whether they are rows (n, t) in the order of time, as backlash needs it; else each
            tendon is in the middle of its play.
        """
        known = self.calibration
        if known is None or known.command != "displacement":
            return check_array("displacements", commands)
        return convert_commands(
            check_displacements(self, commands, may_follow=True),
            scale=known.scale,
            zeros=known.order_zeros(self.tendon_names),
            backlash=known.backlash if in_time else 0.0,
        )

    def to_tensions(self, commands: ArrayLike) -> Floats:
        """Return the tensions (..., t) that commanded ones come to [N]."""
        known = self.calibration
        scale = known.scale if known is not None and known.command == "tension" else 1.0
        return scale * check_array("tensions", commands)

    def to_commands(self, values: Floats) -> Floats:
        """Return what to command for displacements [mm] or tensions [N] (..., t), as calibrated."""
        known = self.calibration or RobotCalibration()
        return np.asarray((values - known.order_zeros(self.tendon_names)) / known.scale)

    def forward(
        self,
        displacements: ArrayLike | Mapping[str, ArrayLike] | None = None,
        *,
        tensions: ArrayLike | Mapping[str, ArrayLike] | None = None,
        model: str | None = None,
        **options: object,
    ) -> Shape:
        """Return the shapes under displacements or tensions of the tendons, as they are commanded.

        A calibrated robot converts them, and is modelled as it was fitted.

        Parameters
        ----------
        displacements : array_like, shape (..., t), or mapping
            How far each tendon is pulled [mm]; or by the tendons' names, numbers or arrays of one
            shape. The columns of a table and the labels of a series are names. A tendon that is
            NaN or left out follows the others.
        tensions : array_like, shape (..., t), or mapping
            Instead, the tension of each tendon at the base [N]; or by names, 0 for those left out.
        model : str, optional
            Name in `CONTINUUM_MODELS`. Unless given that of the calibration; without one arc for
            parallel tendons and energy for others; rod under loads or tensions, with friction of
            tendons, and for robots with weight, curvature at rest or pretension.
        **options
            Options of the model, such as ``tip_force`` of the rod.

        Raises
        ------
        InputError
            If an input has another shape, there is no such model or option, or not one of
            displacements and tensions.
        GeometryError
            If the model does not take such a robot.
        """
        self._check_given(displacements, tensions)
        if tensions is not None and model is None:
            model = self.choose_model(options, pulled=True)
        default = model is None and not options
        chosen = self._default_model if default else self.model(model, **options)
        return self._solve(chosen, displacements, tensions)

    @staticmethod
    def _check_given(displacements: object, tensions: object) -> None:
        if (displacements is None) == (tensions is None):
            raise InputError("forward takes either displacements or tensions: give one of them")

    def _solve(
        self,
        model: ContinuumModel,
        displacements: ArrayLike | Mapping[str, ArrayLike] | None,
        tensions: ArrayLike | Mapping[str, ArrayLike] | None,
    ) -> Shape:
        """Return the shapes of a model under displacements or tensions as they are commanded."""
        if tensions is not None:
            pulls = self._take("tensions", tensions, self.order_tensions)
            return model.shape_under_tensions(self.to_tensions(pulls))
        pulled = self._take("displacements", displacements, self.order_displacements)
        return model.find_shape(self.to_displacements(pulled))

    @staticmethod
    def _take(
        name: str, given: object, order: Callable[[Mapping[str, ArrayLike]], Floats]
    ) -> ArrayLike:
        named = take_named(name, given)
        return cast("ArrayLike", given) if named is None else order(named)

    def inverse(
        self,
        tip: ArrayLike,
        *,
        direction: ArrayLike | None = None,
        model: str | ContinuumModel = "arc",
        **options: Unpack[InverseOptions],
    ) -> ContinuumInverse:
        """Return what brings the tip to a target: bends and displacements, or tensions.

        Parameters
        ----------
        tip : array_like
            A place of the tip, shape (3,); its frame, shape (4, 4); or points along the whole
            backbone, the tip among them, shape (k, 3) [mm].
        direction : array_like, shape (3,), optional
            Where the tip's tangent shall point; with a place only.
        model : str or ContinuumModel
            ``"arc"`` for parallel tendons; ``"energy"``, ``"rod"`` or such a model of this robot,
            with its loads, for any. Of tensions that meet the target those are taken whose
            squares have the least sum, and the displacements are those of the shape under them.
        **options
            See `InverseOptions`. With tensions `initial` is tensions (t,) [N], there is no
            `smallest_bends`, and the defaults are 8 starts, 1e-4 mm and 1e-5 rad.

        Raises
        ------
        InputError
            If an input has another shape or is outside its range.
        GeometryError
            If the tendons are not parallel, or the limits leave no shape at all.
        """
        shape = check_array("target", tip).shape
        if model != "arc" and not isinstance(model, ArcModel):
            chosen = self.model(model) if isinstance(model, str) else model
            pose = shape == (4, 4) and direction is None
            goal = check_pose_target(tip) if pose else check_tip_target(tip, direction)
            return solve_elastic(chosen, *goal, options)
        if shape == (3,):
            return solve_tip(self, tip, direction=direction, **options)
        if shape != (4, 4) and (len(shape) != 2 or shape[1] != 3):
            raise InputError(f"target has shape {shape}: it must be (3,), (4, 4) or (k, 3)")
        if direction is not None:
            raise InputError(f"target has shape {shape}: a direction goes with a place, (3,), only")
        return (solve_pose if shape == (4, 4) else solve_curve)(self, tip, **options)

    def jacobian(
        self,
        displacements: ArrayLike | Mapping[str, ArrayLike] | None = None,
        *,
        tensions: ArrayLike | Mapping[str, ArrayLike] | None = None,
        model: str | None = None,
        **options: object,
    ) -> ShapeJacobian:
        """Return how the robot moves and turns, all along it, with tendons, loads and stiffness.

        What is given is held while others change. By bends: `bozzini.continuum.jacobian`.

        Parameters
        ----------
        displacements, tensions, model, **options
            As `forward` takes them; the model is ``"energy"`` or ``"rod"``.

        Raises
        ------
        InputError
            As `forward` does, or if the model has no such derivatives.
        GeometryError
            If there is no shape under them.
        """
        self._check_given(displacements, tensions)
        if model is None:
            known = self.choose_model(options, pulled=tensions is not None)
            model = "energy" if known == "arc" else known
        elastic = self.model(model, **options)
        if not isinstance(elastic, ElasticModel):
            raise InputError(f"the {model} model has no derivatives: it must be energy or rod")
        shape = self._solve(elastic, displacements, tensions)
        return elastic.jacobian(
            shape, held="tensions" if displacements is None else "displacements"
        )

    def workspace(self, count: int = 20_000, *, seed: int = 0) -> ContinuumWorkspace:
        """Return where the tip can go; see `sample_workspace` and `measure_workspace`."""
        return measure_workspace(sample_workspace(self, count, seed=seed))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the robot at rest, and return the axes."""
        return self._default_model.find_shape(np.zeros(len(self.tendons))).plot(ax)

    @cached_property
    def _default_model(self) -> ContinuumModel:
        return self.model()

    def model(self, name: str | None = None, **options: Any) -> ContinuumModel:
        """Return a model of this robot, with its options; see `forward`.

        It takes displacements of the tendons, those of `to_displacements`. The model of the
        calibration has the options that were fitted with, unless they are given.
        """
        name = self.choose_model(options) if name is None else name
        if self.calibration is not None and name == self.calibration.model:
            options = {**self.calibration.model_options, **options}
        kind = CONTINUUM_MODELS.choose(name)
        known = [field.name for field in dataclasses.fields(kind) if field.name != "robot"]
        for option in options:
            if option not in known:
                listed = ", ".join(known)
                raise InputError(f"the {name} model has no option '{option}': it has {listed}")
        return kind(self, **options)

    def choose_model(self, options: Mapping[str, object], *, pulled: bool = False) -> str:
        """Return the model that suits this robot: as fitted, or by loads, what it has, and routing.

        Whether its tendons are `pulled` by tensions, which arcs do not take.
        """
        if self.calibration is not None and self.calibration.model:
            return self.calibration.model
        loaded = any(options.get(load) is not None for load in LOADS)
        if pulled or loaded or self.tendon_friction.any():
            return "rod"
        features = set(list_features(self))
        names = ["energy"] if find_crooked(self) else ["arc", "energy"]
        return next((name for name in names if features <= CONTINUUM_MODELS[name].heeds), "rod")
