"""How shapes change with commands, loads and stiffnesses: derivatives of an elastic model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..numeric.arrays import Floats
from ..results import Shown

Held = Literal["displacements", "tensions"]
"""What of the tendons stays while a load, a stiffness, the routing or the base changes."""


def move_rigidly(points: Floats) -> Floats:
    """Return how points (k, 3) move with a turn and a motion of the base, (k, 6, 6)."""
    moved = np.tile(np.eye(6), (len(points), 1, 1))
    moved[:, 3:, :3] = -np.cross(points[:, None], np.eye(3)).swapaxes(1, 2)
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeJacobian(Shown):
    """Derivatives of the frames of shapes at their stations.

    Rows of a derivative are the rotation [rad] and the motion of the point [mm] of a station, in
    the base's frame. ``...`` is the shape of the batch; ``k`` counts stations, ``t`` tendons, ``m``
    sections.

    Parameters
    ----------
    arc_length : (k,) ndarray
        Arc length of the stations [mm].
    held : {"displacements", "tensions"}
        What of the tendons stays where a load, a stiffness, the routing or the base changes.
    by_displacement : (..., k, 6, t) ndarray
        By the displacements of tendons [1/mm]; 0 of a tendon without tension, which follows.
    by_tension : (..., k, 6, t) ndarray
        By the tensions, where tensions are commanded [1/N].
    by_tip_wrench : (..., k, 6, 6) ndarray
        By a moment [N mm] and a force [N] on the tip in the base's frame. At the tip it is the
        compliance, symmetric where all loads have a potential.
    by_stiffness : (..., k, 6, m, 2) ndarray
        By the relative change of EI and of GJ of each section.
    by_routing : (..., k, 6, t, 2) ndarray
        By the relative change of the offset of each tendon, all along it, and by an angle of its
        clocking [1/rad]. Displacements count from the lengths in the changed robot at rest.
    by_base : (..., k, 6, 6) ndarray
        Of the stations in the world, by a turn [rad] and a motion [mm] of the base, all in the
        base's frame: with the rigid motion, and the sag under weight and loads of the world.
    tensions_by_displacement : (..., t, t) ndarray
        Tensions by displacements [N/mm].
    """

    arc_length: Floats
    held: Held
    by_displacement: Floats
    by_tension: Floats
    by_tip_wrench: Floats
    by_stiffness: Floats
    by_routing: Floats
    by_base: Floats
    tensions_by_displacement: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """How one shape changes while tensions are held.

    The others are a wrench on the tip (6), stiffnesses (2 m), routing (2 t) and a turn of the base
    as it changes the loads (3).

    Parameters
    ----------
    by_tension : (k, 6, t) ndarray
        Frames of the stations by the tensions.
    by_others : (k, 6, o) ndarray
        The same by the others.
    give : (t, t) ndarray
        Lengths of the tendons by the tensions.
    longer : (t, o) ndarray
        The same by the others.
    rest : (t, 2) ndarray
        Lengths at rest, each by the routing of its tendon.
    """

    by_tension: Floats
    by_others: Floats
    give: Floats
    longer: Floats
    rest: Floats
