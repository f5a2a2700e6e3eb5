"""Ideal muscles: a braid round a bladder that resists nothing (thesis 2.2.1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..braid import Braid
from .base import CatalogueModel
from .card import BRAID_FIELDS, WALL_FIELDS, Card
from .force_balance import WalledModel, find_contact_pressure, pull_ideal

__all__ = ["FAMILY", "Chou", "GaylordAngle", "GaylordStrain", "bracket", "pull_by_strain"]

Floats = NDArray[np.float64]

_PATENT = (
    "R. H. Gaylord, Fluid actuated motor system and stroking device, US patent 2,844,126, 1958"
)
_LOCKING = (
    "The text after (2.3) has the pull largest at 54.7 degrees; there it is zero, and the volume "
    "largest."
)


class GaylordAngle(CatalogueModel):
    """Gaylord's pull by the braid's angle: the pressure times the volume it gains per length.

    ``F = P b**2 / (4 pi N**2) (3 cos(theta)**2 - 1)`` is ``-P dV/dl`` of the cylinder inside the
    braid, ``V = pi r**2 l``. It is zero at the locking angle, and the same as `GaylordStrain`.
    """

    card = Card(
        name="gaylord-1",
        title="Ideal braid, by the braid's angle",
        authors="Gaylord",
        reference=_PATENT,
        equation="(2.3)",
        status="self-contained",
        uses=BRAID_FIELDS,
        errata=(_LOCKING,),
        latex=r"F = \frac{P b^2}{4 \pi N^2} \left(3 \cos^2\theta - 1\right)",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_ideal(self.braid, pressure, length)


class GaylordStrain(CatalogueModel):
    """Gaylord's pull by the strain ``eps = (l0 - l) / l0``.

    ``F = pi r0**2 P [q1 (1 - eps)**2 - q2]`` with ``q1 = 3 / tan(theta0)**2``,
    ``q2 = 1 / sin(theta0)**2``: the same function as `GaylordAngle`, in other symbols.
    """

    card = Card(
        name="gaylord-2",
        title="Ideal braid, by the strain",
        authors="Gaylord",
        reference=_PATENT,
        equation="(2.4)",
        status="self-contained",
        uses=BRAID_FIELDS,
        errata=(_LOCKING,),
        latex=r"F = \pi r_0^2 P \left[q_1 (1 - \epsilon)^2 - q_2\right], \quad "
        r"q_1 = \frac{3}{\tan^2\theta_0}, \quad q_2 = \frac{1}{\sin^2\theta_0}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_by_strain(self.braid, pressure, length / self.braid.length)


class Chou(WalledModel):
    """Gaylord's pull with the bore's volume instead of the braid's, the wall as thick as at rest.

    It is ``-P dV/dl`` with ``V = pi (r - t0)**2 l``. A wall that cannot be compressed gets thinner
    as the braid gets wider; with it the bore lacks a constant volume, and the pull is Gaylord's
    for any thickness. The pull at the locking angle is not zero but
    ``pi P t0 (b / (pi N sqrt(6)) - t0)``.
    """

    keeps_thickness = True

    card = Card(
        name="chou",
        title="Ideal braid round a wall of constant thickness",
        authors="Chou, Hannaford",
        reference="C.-P. Chou, B. Hannaford, Measurement and modeling of McKibben pneumatic "
        "artificial muscles, IEEE Transactions on Robotics and Automation 12(1), 1996",
        equation="(2.5)",
        status="self-contained",
        uses=WALL_FIELDS,
        errata=(
            "It keeps the wall's thickness, not its volume: with the volume kept, the pull is "
            "Gaylord's for any thickness.",
        ),
        latex=r"F = \frac{P b^2}{4 \pi N^2} \left(3 \cos^2\theta - 1\right) + \pi P \left["
        r"\frac{b t_0}{\pi N} \left(2 \sin\theta - \frac{1}{\sin\theta}\right) - t_0^2\right]",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        thickness = self.muscle.outer_radius - self.muscle.inner_radius
        cosine = length / braid.strand_length
        sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length * thickness / (math.pi * braid.turns)
        wall = scale * (2.0 * sine - 1.0 / sine) - thickness**2
        return np.asarray(pull_ideal(braid, pressure, length) + math.pi * pressure * wall)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        thickness = self.muscle.outer_radius - self.muscle.inner_radius
        return find_contact_pressure(
            pressure, length, braid=self.braid, thickness=thickness, hoop_stress=0.0
        )


def pull_by_strain(
    braid: Braid, pressure: Floats, stretch: Floats, *, factor: Floats | float = 1.0
) -> Floats:
    """Return ``factor pi r0**2 P [q1 stretch**2 - q2]`` [N]."""
    scale = factor * math.pi * braid.radius**2
    return np.asarray(scale * pressure * bracket(braid, stretch))


def bracket(braid: Braid, stretch: Floats | float) -> Floats:
    """Return ``q1 stretch**2 - q2`` of a braid; with stretch 1, Gaylord's at rest."""
    cotangent = 1.0 / math.tan(braid.angle)
    return np.asarray(3.0 * (stretch * cotangent) ** 2 - 1.0 / math.sin(braid.angle) ** 2)


FAMILY: tuple[type[CatalogueModel], ...] = (GaylordAngle, GaylordStrain, Chou)
"""The models of this module, for the registry."""
