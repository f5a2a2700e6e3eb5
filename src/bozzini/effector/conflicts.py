"""Where the parts of an end-effector are in each other's way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..muscle import Muscle
from ..muscle.braid import LOCKING_ANGLE
from . import _linkage_kernels
from .design import EffectorDesign
from .forward import find_peak, take_linkage

__all__ = ["find_conflicts"]

SAMPLES = 400


def find_conflicts(design: EffectorDesign) -> tuple[str, ...]:
    """Return one line for each pair of parts that do not fit; none of them is an error.

    They are findings and not errors because the thesis's own tables need an offset of 4 mm, which
    its 9 mm holder has no room for. Looked at are the holes in the holder, neighbouring muscles at
    rest, the muscle against the coil as it drifts inwards and gets thicker, and whether every
    segment closes at every contraction.

    Parameters
    ----------
    design : EffectorDesign
        The section.
    """
    found = []
    low = 0.5 * (design.bore_diameter + design.hole_diameter)
    high = 0.5 * (design.holder_diameter - design.hole_diameter)
    if not low <= design.offset <= high:
        found.append(
            f"offset is {design.offset:g} mm: a {design.holder_diameter:g} mm holder with a "
            f"{design.bore_diameter:g} mm bore and {design.hole_diameter:g} mm holes has room for "
            f"[{low:g}, {high:g}] mm"
        )
    placed = design.muscles
    for i, one in enumerate(placed):
        for other in placed[:i]:
            apart = 2.0 * design.offset * abs(math.sin(0.5 * (one.angle - other.angle)))
            need = one.muscle.braid_radius + other.muscle.braid_radius
            if apart < need:
                found.append(
                    f"muscles {other.name} and {one.name} are {apart:g} mm apart: their radii "
                    f"need {need:g} mm"
                )
    for one in placed:
        contraction = _find_contact(design, one.muscle)
        if contraction is not None:
            found.append(
                f"muscle {one.name} touches the {design.coil_diameter:g} mm coil from a "
                f"contraction of {contraction:.3g} mm on"
            )
    end = _linkage_kernels.find_end(take_linkage(design))
    if end < design.backbone_length:
        found.append(
            f"offset is {design.offset:g} mm: from a contraction of {end:.4g} mm on not every "
            f"segment closes; the section is used up to {find_peak(design).contraction:.4g} mm"
        )
    return tuple(found)


def _find_contact(design: EffectorDesign, muscle: Muscle) -> float | None:
    """Contraction from which muscle and coil overlap, to a sample; None if they do not."""
    cosine = math.cos(muscle.braid_angle)
    locked = muscle.active_length * (1.0 - math.cos(LOCKING_ANGLE) / cosine)
    contraction = np.linspace(0.0, min(find_peak(design).contraction, locked), SAMPLES)
    stretch = 1.0 - contraction / muscle.active_length
    radius = muscle.braid_radius * np.sqrt(1.0 - (stretch * cosine) ** 2)
    radius /= math.sin(muscle.braid_angle)
    touching = _measure_spacing(design, contraction) < 0.5 * design.coil_diameter + radius
    return float(contraction[np.argmax(touching)]) if touching.any() else None


def _measure_spacing(
    design: EffectorDesign, contraction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Least distance from the muscle's joints to the backbone's lines [mm]: at the last joint."""
    linkage = take_linkage(design)
    sines = [_linkage_kernels.measure_lag(linkage, x, design.segments) for x in contraction]
    return design.offset * np.sqrt(1.0 - np.minimum(sines, 1.0) ** 2)
