"""Muscles whose pull is the slope of a Mooney-Rivlin energy (thesis 2.2.4)."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..design import Muscle
from .base import CatalogueModel
from .card import WALL_FIELDS, Card, Choice, Parameter, make_friction
from .elastic import KotheraBalance
from .force_balance import Wall, WalledModel, find_radius, pull_ideal

__all__ = [
    "FAMILY",
    "Delson",
    "HyperelasticModel",
    "KotheraEnergy",
    "MooneyRivlin",
    "Stretches",
    "find_stretches",
]

Floats = NDArray[np.float64]

_STRETCHES = Choice(
    name="stretches",
    what="radius of the wall at which the hoop stretch is taken",
    words=("middle", "outer"),
)
_CONSTANTS = tuple(
    Parameter(
        name=name,
        unit="MPa",
        what=f"constant of the {which} invariant; E = 6 (c10 + c01)",
        source="fitted",
        neutral=0.0,
        bounds=(-1e3, 1e3),
        linear=True,
    )
    for name, which in (("c10", "first"), ("c01", "second"))
)
_INVARIANT = (
    "The second invariant of (2.18) is right only where the product of the stretches is 1: "
    "the third is the inverse of the other two here."
)


@dataclass(frozen=True, kw_only=True)
class Stretches:
    """Stretches of a wall that keeps its volume, uniform over it; arrays of one shape.

    Attributes
    ----------
    axial, hoop : ndarray
        Stretches; the radial one is the inverse of their product.
    axial_rate, hoop_rate : ndarray
        Slopes of their logarithms in the length, the wall touching the braid [1/mm].
    hoop_growth : ndarray
        Slope of the logarithm of the hoop stretch in the radius, at one length [1/mm].
    """

    axial: Floats
    hoop: Floats
    axial_rate: Floats
    hoop_rate: Floats
    hoop_growth: Floats

    def find_slopes(self, c10: float, c01: float) -> tuple[Floats, Floats]:
        """Return the slopes of the energy density in the logarithms of both stretches [MPa]."""
        radial = 1.0 / (self.axial * self.hoop) ** 2
        along = 2.0 * (self.axial**2 - radial) * (c10 + c01 * self.hoop**2)
        across = 2.0 * (self.hoop**2 - radial) * (c10 + c01 * self.axial**2)
        return np.asarray(along), np.asarray(across)


def find_stretches(wall: Wall, length: Floats, *, at: str) -> Stretches:
    """Return the stretches of a wall at a length.

    Parameters
    ----------
    wall : Wall
    length : ndarray
        Length [mm].
    at : str
        Where the hoop stretch is taken: ``"middle"``, ``(2 r - t) / (2 r0 - t0)`` of (2.19), or
        ``"outer"``, ``r / r0`` of (2.20).
    """
    braid = wall.braid
    axial = length / braid.length
    square = math.tan(braid.angle) ** -2
    wider = (1.0 - axial) * (1.0 + axial) * square  # r**2 / r0**2 - 1, with its digits near rest
    widening = np.sqrt(1.0 + wider)
    radius = braid.radius * widening
    slope = -square * axial * braid.radius / (braid.length * widening)
    if at == "outer":
        hoop, rate, growth = widening, slope / radius, 1.0 / radius
    else:
        thicker = wall.area_at_rest / math.pi * (1.0 - axial) / axial
        bore = np.sqrt(wall.bore_at_rest**2 + braid.radius**2 * wider - thicker)
        change = (radius * slope + 0.5 * wall.area_at(length) / (math.pi * length)) / bore
        hoop = (radius + bore) / (braid.radius + wall.bore_at_rest)
        rate, growth = (slope + change) / (radius + bore), 1.0 / bore
    return Stretches(
        axial=np.asarray(axial),
        hoop=np.asarray(hoop),
        axial_rate=np.asarray(1.0 / length),
        hoop_rate=np.asarray(rate),
        hoop_growth=np.asarray(growth),
    )


class HyperelasticModel(WalledModel):
    """A bladder with a Mooney-Rivlin energy, which keeps its volume ``V_b`` and fills the braid.

    Pull ``F = -P dV/dl + V_b dW/dl`` and contact pressure ``P_o = P - V_b (dW/dr) / (2 pi r l)``
    are slopes of one energy, ``V_b W - P (V - V_b)`` with ``V = pi r**2 l``. A subclass brings
    `_find_constants` and may bring `_hoop_at`.
    """

    @abstractmethod
    def _find_constants(self) -> tuple[float, float]:
        """``C10`` and ``C01`` [MPa]."""

    def _hoop_at(self) -> str:
        """Where the hoop stretch is taken, as in `find_stretches`."""
        return str(self.keywords["stretches"])

    def _pull_wall(self, length: Floats) -> Floats:
        """Slope of the energy of the wall, ``V_b dW/dl`` [N]."""
        wall = self.wall
        stretches = find_stretches(wall, length, at=self._hoop_at())
        along, across = stretches.find_slopes(*self._find_constants())
        slope = along * stretches.axial_rate + across * stretches.hoop_rate
        return np.asarray(wall.volume * slope)

    def _bear(self, length: Floats) -> Floats:
        """Pressure that the wall bears [MPa]."""
        wall = self.wall
        stretches = find_stretches(wall, length, at=self._hoop_at())
        _, across = stretches.find_slopes(*self._find_constants())
        lateral = 2.0 * math.pi * find_radius(self.braid, length) * length
        return np.asarray(wall.volume * across * stretches.hoop_growth / lateral)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asarray(pressure - self._bear(length))


class MooneyRivlin(HyperelasticModel):
    """A bladder whose constants `c10` and `c01` are parameters; the pull is linear in them."""

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return the constants of the tube, from its modulus and Mooney ratio."""
        sum_of_both, share = muscle.modulus / 6.0, muscle.mooney_ratio
        own = {"c10": (1.0 - share) * sum_of_both, "c01": share * sum_of_both}
        return {**super().guess_parameters(muscle), **own}

    def _find_constants(self) -> tuple[float, float]:
        given = self.parameters
        return given["c10"], given["c01"]


class Delson(MooneyRivlin):
    """Gaylord's pull and the slope of a Mooney-Rivlin energy, uniform over the wall.

    The hoop stretch is that of the wall's middle surface, (2.19), or with ``stretches="outer"``
    that of the braid, (2.20), which the survey has from another paper ([109]). The product of the
    stretches is 1 either way. ``as_printed=True`` has the pressure push.

    The wall resists contraction up to the locking angle while ``0 <= c01 <= c10``; `c01` alone does
    so near rest, and where the strands are steep.
    """

    card = Card(
        name="delson",
        title="Mooney-Rivlin energy",
        authors="Delson, Hanak, Loewke, Miller",
        reference="N. Delson, T. Hanak, K. Loewke, D. N. Miller, Modeling and implementation of "
        "McKibben actuators for a hopping robot, International Conference on Advanced Robotics, "
        "2005",
        equation="(2.21)",
        status="fitted",
        parameters=_CONSTANTS,
        choices=(_STRETCHES,),
        uses=WALL_FIELDS,
        errata=(
            "The work of the pressure is printed + P dV/dl, a push: with a pull positive, "
            "- P dV/dl.",
            _INVARIANT,
        ),
        latex=r"F = -P \frac{dV}{dl} + V_b \frac{dW}{dl}, \quad W = C_{10} \left(\lambda_1^2 + "
        r"\lambda_2^2 + \lambda_3^2 - 3\right) + C_{01} \left(\lambda_1^{-2} + \lambda_2^{-2} + "
        r"\lambda_3^{-2} - 3\right), \quad \lambda_3 = \frac{1}{\lambda_1 \lambda_2}",
        latex_printed=r"F = P \frac{dV}{dl} + V_b \frac{dW}{dl}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        acting = -pressure if self.as_printed else pressure
        return np.asarray(pull_ideal(self.braid, acting, length) + self._pull_wall(length))


class KotheraEnergy(MooneyRivlin):
    """Gaylord's pull, the slope of a Mooney-Rivlin energy, and strands that stretch.

    A strand under the braid's pressure ``P`` is longer by
    ``P b**2 l / (2 pi**2 N**2 m r_n**2 E_b)``, and that takes
    ``P**2 b**3 l / (4 pi**3 m r_n**2 E_b N**4)`` from the pull: first order, good while a strand
    stretches little. Friction is a share of the size of the pull, and against the motion; as
    printed it is the share of the pull, which helps the motion where the muscle pushes.

    Without strands that stretch it is `Delson`; ``as_printed=True`` has the wall help contraction.
    """

    card = Card(
        name="kothera-energy",
        title="Mooney-Rivlin energy, strands that stretch, friction",
        authors="Kothera, Jangid, Sirohi, Wereley",
        reference=KotheraBalance.card.reference,
        equation="(2.22)",
        status="fitted",
        parameters=(
            *_CONSTANTS,
            make_friction("friction over pull", largest=0.99),
        ),
        choices=(_STRETCHES,),
        uses=(*WALL_FIELDS, "strands", "strand_radius", "strand_modulus"),
        errata=(
            "The term of the wall is printed with a minus, which makes it help contraction; that "
            "would be right for slopes in the contraction.",
            "The term of the strands is printed over 4 pi**2 m r_n, a force times a length: over "
            "4 pi**3 m r_n**2.",
            "The text's friction is in proportion to the pull with its sign, and helps the motion "
            "where that is negative: its size is taken.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + V_b \frac{dW}{dl} - "
        r"\frac{P^2 b^3 l}{4 \pi^3 m r_n^2 E_b N^4} \mp \mu_f |F|",
        latex_printed=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) - V_b \left(2 C_{10} "
        r"\left[\lambda_1 \lambda_1' + \dots\right] + 2 C_{01} \left[\lambda_1 (\lambda_2^2 + "
        r"\lambda_3^2) \lambda_1' + \dots\right]\right) - "
        r"\frac{P^2 b^3 l}{4 \pi^2 m r_n E_b N^4}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid, muscle = self.braid, self.muscle
        size = muscle.strand_radius if self.as_printed else math.pi * muscle.strand_radius**2
        strands = 4.0 * math.pi**2 * muscle.strands * size * muscle.strand_modulus
        softening = pressure**2 * braid.strand_length**3 * length / (strands * braid.turns**4)
        wall = self._pull_wall(length)
        ideal = pull_ideal(braid, pressure, length)
        return np.asarray(ideal + (-wall if self.as_printed else wall) - softening)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        pull = self._pull(pressure, length)
        return np.asarray(self.parameters["friction"] * (pull if self.as_printed else np.abs(pull)))


FAMILY: tuple[type[CatalogueModel], ...] = (Delson, KotheraEnergy)
"""The models of this module, for the registry."""
