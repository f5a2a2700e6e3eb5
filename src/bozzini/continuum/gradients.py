"""How shapes change with commands, loads and stiffnesses: derivatives of an elastic model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .checks import Floats

Held = Literal["displacements", "tensions"]
"""What of the tendons stays while a load or a stiffness changes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeJacobian:
    """Derivatives of the frames of shapes at their stations.

    Rows of a derivative are the rotation [rad] and the motion of the point [mm] of a station, in
    the base's frame. ``...`` is the shape of the batch; ``k`` counts stations, ``t`` tendons, ``m``
    sections.

    Parameters
    ----------
    arc_length : (k,) ndarray
        Arc length of the stations [mm].
    held : {"displacements", "tensions"}
        What of the tendons stays where a load or a stiffness changes.
    by_displacement : (..., k, 6, t) ndarray
        By the displacements of tendons [1/mm]; 0 of a tendon without tension, which follows.
    by_tension : (..., k, 6, t) ndarray
        By the tensions, where tensions are commanded [1/N].
    by_tip_wrench : (..., k, 6, 6) ndarray
        By a moment [N mm] and a force [N] on the tip in the base's frame. At the tip it is the
        compliance, symmetric where all loads have a potential.
    by_stiffness : (..., k, 6, m, 2) ndarray
        By the relative change of EI and of GJ of each section.
    tensions_by_displacement : (..., t, t) ndarray
        Tensions by displacements [N/mm].
    """

    arc_length: Floats
    held: Held
    by_displacement: Floats
    by_tension: Floats
    by_tip_wrench: Floats
    by_stiffness: Floats
    tensions_by_displacement: Floats
