"""Where the thesis's tube meets its braid, and what its second phase starts from."""

from __future__ import annotations

import math

from ..errors import InputError
from .design import Muscle
from .model import bisect

__all__ = ["find_contact_pressure", "meet_braid"]


def find_contact_pressure(muscle: Muscle) -> float:
    """Return the pressure at which the free tube meets the braid [MPa], eq. (3.11), no load."""
    if muscle.gap == 0.0:
        return 0.0
    state = muscle.tube.deform(1.0)  # linear: the displacements at 1 MPa scale
    radial = float(state.radial_displacement(muscle.outer_radius))
    axial = float(state.c3)
    cosine, sine = math.cos(muscle.braid_angle), math.sin(muscle.braid_angle)

    def overlap(pressure: float) -> float:
        square = max(0.0, 1.0 - (cosine * (1.0 + axial * pressure)) ** 2)
        braid = muscle.braid_radius * math.sqrt(square) / sine
        return muscle.outer_radius + radial * pressure - braid

    # The tube gets no shorter, so the braid no wider than at rest: they have met by then.
    return bisect(overlap, 0.0, muscle.gap / radial)


def meet_braid(muscle: Muscle) -> tuple[float, tuple[float, ...]]:
    """Return the pressure of contact [MPa] and the design of `_thesis_kernels` from there on.

    Raises
    ------
    InputError
        If the strands lie over each other in eq. (2.10), or there is no contact to start from.
    """
    cover = muscle.strands * muscle.strand_radius / (math.pi * muscle.outer_radius)
    if cover > 1.0:
        raise InputError(
            f"muscle strand radius is {muscle.strand_radius:g} mm: it must lie in (0, "
            f"{muscle.strand_radius / cover:g}] mm for the contact area of eq. (3.22)"
        )
    tube, contact = muscle.tube, find_contact_pressure(muscle)
    touched = tube.deform(contact)
    outer = muscle.outer_radius + float(touched.radial_displacement(muscle.outer_radius))
    inner = muscle.inner_radius + float(touched.radial_displacement(muscle.inner_radius))
    length = muscle.length + float(touched.elongation)
    cosine = length / muscle.length * math.cos(muscle.braid_angle)
    if cosine >= 1.0:
        raise InputError(
            f"muscle gap is {muscle.gap:g} mm: with a Poisson's ratio of {muscle.poisson_ratio:g} "
            "the tube pulls the braid straight before they touch"
        )
    sine = math.sqrt(1.0 - cosine * cosine)
    strands = math.pi * muscle.strand_radius**2 * muscle.strands * muscle.strand_modulus
    wall = math.cos(muscle.braid_angle) * tube.wall_area * muscle.modulus
    return contact, (
        *tube.lame_constants,
        inner,
        outer,
        length,
        sine,
        cosine,
        sine / cosine,
        0.25 * cover * cover,  # (sin cos)^2 of half the angle whose sine is the cover
        float(muscle.end_length),
        strands / (strands + wall),
    )
