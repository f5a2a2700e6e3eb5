"""An end-effector and its muscle models as the kernels take them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..muscle import EnergyMuscle, MuscleModel, ThesisMuscle
from ..muscle.thesis import ANGLE_LIMIT
from . import _equilibrium_kernels
from .design import EffectorDesign
from .forward import Peak, find_peak, take_linkage

__all__ = ["PackedEffector", "pack_effector"]

COLUMNS = 17


@dataclass(frozen=True, eq=False)
class PackedEffector:
    """Numbers of an end-effector; see `_linkage_kernels` and `_equilibrium_kernels`.

    Attributes
    ----------
    linkage : tuple
        Offset, length, segments.
    compliance : float
        Deflection per pull [mm/N].
    peak : Peak
        End of the rising branch.
    kinds : (m,) ndarray of int
        Kind of each muscle's model; `_equilibrium_kernels.OTHER` where there is no kernel for it.
    rows : (m, COLUMNS) ndarray
        Numbers of each muscle's model.
    cosines, sines : (m,) ndarray
        Of the muscles' angles.
    """

    linkage: tuple[float, float, int]
    compliance: float
    peak: Peak
    kinds: NDArray[np.int64]
    rows: NDArray[np.float64]
    cosines: NDArray[np.float64]
    sines: NDArray[np.float64]


def pack_effector(design: EffectorDesign, models: tuple[MuscleModel, ...]) -> PackedEffector:
    """Return a design and its models as numbers."""
    kinds = np.full(len(models), _equilibrium_kernels.OTHER, dtype=np.int64)
    rows = np.zeros((len(models), COLUMNS))
    for j, model in enumerate(models):
        # Exact types: a subclass may answer differently.
        if type(model) is EnergyMuscle and model.ends == "none":
            kinds[j] = _equilibrium_kernels.ENERGY
            rows[j, :11] = model.packed_design
            rows[j, 11] = model.muscle.active_length
        elif type(model) is ThesisMuscle:
            blind = model.load_path == "none"
            kinds[j] = _equilibrium_kernels.BLIND if blind else _equilibrium_kernels.BULK
            rows[j, :11] = model.packed_design
            rows[j, 11:] = (
                model.dead_band(),
                model.muscle.length,
                model.muscle.tube.deform(1.0).c3,  # linear, so that the strain at 1 MPa scales
                0.5 * math.acos(model.packed_design[6]),
                ANGLE_LIMIT,
                0.0 if blind else model.load_stiffness,
            )
    angles = design.angles
    return PackedEffector(
        linkage=take_linkage(design),
        compliance=design.compliance,
        peak=find_peak(design),
        kinds=kinds,
        rows=rows,
        cosines=np.cos(angles),
        sines=np.sin(angles),
    )
