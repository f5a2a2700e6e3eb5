"""Many designs at once: what a sweep states of each, by one compiled function."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from ..checks import list_quantities
from ..muscle import EnergyMuscle, Muscle
from ..muscle.design import BRAID_ANGLES
from ..muscle.models.energy import PAST_LOCKING
from ..numeric.arrays import Floats
from .design import BEAM_FACTORS, EffectorDesign
from .inverse import MISS_TOLERANCE_MM, UNCOVERED_GAP_RAD
from .kernels import sweep as kernels
from .model import EffectorModel

HIGHEST_PRESSURE_MPA = 10.0
"""Pressure up to which one is looked for [MPa]: the largest that a design may have as limit."""

REASONS = {
    kernels.FEASIBLE: "",
    kernels.NOT_BUILT: "no such design can be built: a value is not legal beside the others",
    kernels.ABOVE_LIMIT: "it needs more than its pressure limit",
    kernels.UNREACHED: "a muscle does not reach the deflection at any pressure up to "
    f"{HIGHEST_PRESSURE_MPA:g} MPa",
    kernels.BEYOND_PEAK: "the backbone does not deflect so far",
    kernels.NO_MODEL_ANSWER: "the model of the muscles has no answer at the pressure limit",
}
"""What the codes of `DesignBatch` mean; `explain_design` states more of one design."""

_MUSCLE_FIELDS = (
    "inner_radius",
    "outer_radius",
    "braid_angle",
    "gap",
    "modulus",
    "mooney_ratio",
    "friction_length",
    "length",
    "dead_length",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignBatch:
    """What is known of n designs; NaN where a design has no such number.

    Attributes
    ----------
    code : (n,) int8
        Key of `REASONS`; 0 where the design can be built and, if a deflection was asked for,
        reaches it within its pressure limit.
    least_amplitude, largest_amplitude, inner_radius : (n,) float
        As in `SweepRow` [mm].
    area : (n,) float
        As in `SweepRow` [mm^2].
    needed_pressure : (n,) float
        As in `SweepRow` [MPa].
    """

    code: NDArray[np.int8]
    least_amplitude: Floats
    largest_amplitude: Floats
    inner_radius: Floats
    area: Floats
    needed_pressure: Floats


def can_batch(effector: EffectorModel, names: tuple[str, ...]) -> bool:
    """Whether `measure_designs` takes this effector's model and these parameters."""
    plain = all(
        type(model) is EnergyMuscle and model.ends == "none" and model.hysteresis is None
        for model in effector.models
    )
    both = "length" in names and ("backbone_length" in names or "muscle.length" in names)
    return plain and effector.model is EnergyMuscle and "muscles" not in names and not both


def measure_designs(
    effector: EffectorModel, columns: Mapping[str, NDArray[np.generic]], *, deflection: float = 0.0
) -> DesignBatch:
    """Return what a sweep states of n designs, some 20 microseconds each.

    Parameters
    ----------
    effector : Effector
        Its design is what is changed; of the model `EnergyMuscle`, see `can_batch`.
    columns : mapping of str to array
        Parameters as in `change_design`, each (n,); angles (n, m).
    deflection : float
        Deflection that every muscle alone must reach [mm]; 0 for none.
    """
    count = len(next(iter(columns.values())))
    design = effector.design
    legal = np.ones(count, dtype=np.bool_)
    section: dict[str, Floats] = {
        name: np.asarray(columns.get(name, getattr(design, name)), dtype=np.float64)
        for name in list_quantities(EffectorDesign)
    }
    if "length" in columns:
        section["backbone_length"] = np.asarray(columns["length"], dtype=np.float64)
    _check_legal(EffectorDesign, section, legal)
    legal &= np.isin(section["beam_factor"], BEAM_FACTORS)
    length, offset = section["backbone_length"], section["offset"]
    alike = all(placed.muscle == design.muscles[0].muscle for placed in design.muscles)
    muscles = np.empty((count, 1 if alike else len(design.muscles), len(_MUSCLE_FIELDS)))
    for k in range(muscles.shape[1]):
        fields = {
            name: np.asarray(columns.get(f"muscle.{name}", value), dtype=np.float64)
            for name, value in _list_fields(design.muscles[k].muscle, columns).items()
        }
        if "length" in columns:
            fields["length"] = length
        _check_legal(Muscle, fields, legal)
        legal &= fields["braid_angle"] <= BRAID_ANGLES[1]
        legal &= ~(np.abs(fields["length"] - length) > 1e-9 * length)
        for j, name in enumerate(_MUSCLE_FIELDS):
            muscles[:, k, j] = fields[name]
    with np.errstate(all="ignore"):
        legal &= ~(offset < 0.5 * length / section["segments"])
    angles = np.asarray(columns.get("angles", design.angles[np.newaxis]), dtype=np.float64)
    for i in range(angles.shape[1]):
        for j in range(i):
            turn = np.abs(np.remainder(angles[:, i] - angles[:, j] + math.pi, math.tau) - math.pi)
            legal &= turn > 1e-9
    turned = np.mod(angles, math.tau)
    order = np.argsort(turned, axis=1, kind="stable")
    turned = np.take_along_axis(turned, order, axis=1)
    gaps = np.diff(turned, append=turned[:, :1] + math.tau, axis=1)
    packed = np.empty((count, 6))
    rigidity = section["flexural_rigidity"] + section["catheter_rigidity"]
    for j, values in enumerate(
        (offset, length, section["segments"], rigidity, section["beam_factor"])
    ):
        packed[:, j] = values
    packed[:, 5] = section["pressure_limit"]
    out, codes = np.empty((count, 5)), np.empty(count, dtype=np.int8)
    kernels.sweep_designs(
        effector.packed.functions[0],
        muscles,
        packed,
        np.cos(turned),
        np.sin(turned),
        order,
        gaps < UNCOVERED_GAP_RAD,
        legal,
        float(deflection),
        HIGHEST_PRESSURE_MPA,
        MISS_TOLERANCE_MM,
        PAST_LOCKING,
        alike,
        out,
        codes,
    )
    names = [item.name for item in dataclasses.fields(DesignBatch)][1:]
    return DesignBatch(code=codes, **dict(zip(names, out.T, strict=True)))


def _list_fields(muscle: Muscle, columns: Mapping[str, object]) -> dict[str, float]:
    """Return the fields of a muscle that are set or varied."""
    varied = (name.removeprefix("muscle.") for name in columns if name.startswith("muscle."))
    return {**dict.fromkeys(varied, math.nan), **muscle.given}


def _check_legal(kind: type, fields: Mapping[str, Floats], legal: NDArray[np.bool_]) -> None:
    """Clear ``legal`` where a field is outside its range, the others being as they are.

    The limits of a field may be functions of a dataclass; they get the fields as arrays.
    """
    item = SimpleNamespace(**fields)
    if kind is Muscle:
        item.braid_radius = fields["outer_radius"] + fields["gap"]
    for name, known in list_quantities(kind).items():
        if name not in fields:
            continue
        values = fields[name]
        low, high = (end(item) if callable(end) else end for end in (known.low, known.high))
        with np.errstate(invalid="ignore"):
            legal &= (low < values) if known.low_open else (low <= values)
            legal &= (values <= high) & np.isfinite(values)
            if known.whole:
                legal &= values == np.round(values)
