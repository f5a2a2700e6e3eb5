"""An end-effector that can be computed with: a design, and a model of its muscles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_range, show_value, take_named
from ..errors import InputError
from ..muscle import EnergyMuscle, Muscle, MuscleModel
from ..muscle.model import NUMBERS_LIMIT
from ..results import Shown
from .design import EffectorDesign
from .linkage import Peak, find_peak, take_linkage


@dataclass(frozen=True, eq=False)
class PackedEffector:
    """Numbers of an end-effector with m muscles, as the kernels take them.

    The linkage is offset, length and segments; the compliance is deflection per pull [mm/N].
    Functions (m, 3) are the addresses of each model's compiled functions, 0 without, and rows
    (m, n) its numbers; cosines and sines (m,) are those of the muscles' angles.
    """

    linkage: tuple[float, float, int]
    compliance: float
    peak: Peak
    functions: NDArray[np.int64]
    rows: NDArray[np.float64]
    cosines: NDArray[np.float64]
    sines: NDArray[np.float64]

    @property
    def uncompiled(self) -> list[int]:
        """The muscles whose model has no compiled functions."""
        return [j for j, start in enumerate(self.functions[:, 0]) if not start]


def pack_effector(design: EffectorDesign, models: tuple[MuscleModel, ...]) -> PackedEffector:
    """Return a design and its models as numbers."""
    functions = np.zeros((len(models), 3), dtype=np.int64)
    rows = np.zeros((len(models), NUMBERS_LIMIT))
    for j, model in enumerate(models):
        compiled = model.compiled
        if compiled is not None:
            functions[j] = compiled.start, compiled.pull, compiled.pressure
            rows[j, : len(compiled.numbers)] = compiled.numbers
    angles = design.angles
    return PackedEffector(
        linkage=take_linkage(design),
        compliance=design.compliance,
        peak=find_peak(design),
        functions=functions,
        rows=rows,
        cosines=np.cos(angles),
        sines=np.sin(angles),
    )


@dataclass(frozen=True)
class EffectorModel(Shown):
    """A design with a model of its muscles: what all functions of an end-effector take.

    `Effector` is the same with forward and inverse kinematics.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    model : callable
        Gives a `MuscleModel` for a `Muscle`: a class, or any function such as
        ``lambda muscle: ThesisMuscle(muscle, load_path="bulk")``. Models with compiled functions
        (`MuscleModel.compiled`) run compiled. Friction and hysteresis of the muscles are left out.

    Attributes
    ----------
    models : tuple of MuscleModel
        One for each muscle, in the order of the design.
    packed : PackedEffector
        The same as numbers, for the kernels.

    Raises
    ------
    InputError
        If the model does not answer what `MuscleModel` asks.
    """

    design: EffectorDesign
    model: Callable[[Muscle], MuscleModel] = EnergyMuscle
    models: tuple[MuscleModel, ...] = field(init=False, repr=False, compare=False)
    packed: PackedEffector = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.design, EffectorDesign):
            raise InputError(
                f"design is a {type(self.design).__name__}: it must be an EffectorDesign"
            )
        if not callable(self.model):
            raise InputError(f"model is {show_value(self.model)}: it must be a class or a function")
        models = self._make_models()
        for built in models:
            if not isinstance(built, MuscleModel):
                raise InputError(f"model gives a {type(built).__name__}: it must be a MuscleModel")
        object.__setattr__(self, "models", models)
        object.__setattr__(self, "packed", pack_effector(self.design, models))

    def _make_models(self) -> tuple[MuscleModel, ...]:
        return tuple(self.model(placed.muscle) for placed in self.design.muscles)

    def __reduce__(self) -> tuple[type[EffectorModel], tuple[object, ...]]:
        """Pickle design and model: addresses of compiled functions hold in one process only."""
        return type(self), (self.design, self.model)

    def take_pressures(self, pressures: ArrayLike | Mapping[str, ArrayLike]) -> NDArray[np.float64]:
        """Return pressures (..., m) [MPa] in the order of the design, checked.

        Parameters
        ----------
        pressures : array_like, shape (..., m), or mapping
            Of all muscles in order, or by name; by name, a muscle left out has none. The columns
            of a table and the labels of a series are names.

        Raises
        ------
        InputError
            If a name, a shape or a pressure is not legal.
        """
        names = self.design.names
        try:
            named = take_named("pressures", pressures)
            if named is not None:
                for name in named:
                    self.design.index(name)
                columns = [
                    check_array(f"pressure of muscle {name}", named.get(name, 0.0))
                    for name in names
                ]
                table = np.stack(np.broadcast_arrays(*columns), axis=-1)
            else:
                table = np.array(check_array("pressures", cast("ArrayLike", pressures)), order="C")
        except InputError:
            raise
        except ValueError:
            raise InputError(
                f"pressures is {pressures!r:.60}: it must be an array (..., {len(names)}), or a "
                "mapping from names to numbers or arrays of one shape"
            ) from None
        if table.ndim == 0 or table.shape[-1] != len(names):
            raise InputError(
                f"pressures has shape {table.shape}: it must be (..., {len(names)}), one for each "
                f"of {list(names)}"
            )
        limit = self.design.pressure_limit
        legal = (table >= 0.0) & (table <= limit * (1.0 + 1e-12))  # round-off of a unit
        if not legal.all():
            index = int(np.argmin(legal))
            name = f"pressure of muscle {names[index % len(names)]}"
            check_range(name, table.flat[index : index + 1].reshape(()), 0.0, limit, "MPa")
        return table
