"""Ideal muscles, and the balance of forces that models with a wall share (thesis 2.2.1)."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from ...numeric.arrays import Floats
from ...numeric.roots import bisect
from ..design import Braid, Muscle
from .base import CatalogueModel
from .card import BRAID_FIELDS, WALL_FIELDS, Card

# The balance of forces on a thick-walled bladder in a braid, which a family of models shares.
#
# A bladder of outer radius ``r`` and thickness ``t`` bears an axial stress ``s_z`` and a hoop
# stress ``s_h``, both means over the wall. Across a lengthwise cut, bore pressure, hoop stress and
# the braid's pressure ``P_o`` balance; across the muscle, strands, wall and pressure on the bore::
#
#     P_o = (P (r - t) - s_h t) / r
#     F   = P_o l**2 / (2 pi N**2) + s_z A - P pi (r - t)**2
#
# (our derivation; the survey has it as (2.17), (2.29), (2.35) and (2.38), with one stress law or
# another). With the braid's ``4 pi**2 N**2 r**2 = b**2 - l**2`` and the area of the wall,
# ``A = pi t (2 r - t)``, that is Gaylord's pull, a term of the pressure on the wall, and the two
# stresses::
#
#     F = P (3 l**2 - b**2) / (4 pi N**2) + P (A - t l**2 / (2 pi r N**2))
#         + s_z A - s_h t l**2 / (2 pi r N**2)
#
# The second term is there because the balance takes a wall without stress. In a wall that cannot
# be compressed and resists nothing the stress is the pressure on it: with ``s_z = s_h = -P`` the
# second term goes, and Gaylord's pull is left, as from the energy of such a wall.

_OPEN_BORE_SHARE = 1e-4
"""Share of the bore's area at rest that is left at the ends of the legal lengths."""


@dataclass(frozen=True, kw_only=True)
class BladderWall:
    """A bladder that touches its braid and keeps its volume; the thickness is at rest [mm]."""

    braid: Braid
    thickness: float

    @classmethod
    def of(cls, muscle: Muscle, braid: Braid) -> BladderWall:
        """Return the wall of a muscle whose tube has grown to the braid, as thick as it was."""
        return cls(braid=braid, thickness=muscle.outer_radius - muscle.inner_radius)

    @property
    def area_at_rest(self) -> float:
        """Area of the wall's cross-section at rest [mm^2]."""
        return math.pi * self.thickness * (2.0 * self.braid.radius - self.thickness)

    @property
    def volume(self) -> float:
        """Volume of the wall, ``V_b`` [mm^3]."""
        return self.area_at_rest * self.braid.length

    @property
    def bore_at_rest(self) -> float:
        """Radius of the bore at rest [mm]."""
        return self.braid.radius - self.thickness

    def area_at(self, length: Floats) -> Floats:
        """Area of the wall's cross-section at a length [mm^2]."""
        return self.volume / length

    def thickness_at(self, length: Floats) -> Floats:
        """Thickness at a length [mm]: the root of ``pi t (2 r - t) l = V_b``.

        Written without the difference of two large numbers that the textbook form is.
        """
        radius = find_radius(self.braid, length)
        share = self.area_at(length) / math.pi
        return np.asanyarray(share / (radius + np.sqrt(np.maximum(radius**2 - share, 0.0))))

    def find_lengths(
        self, low: float, high: float, *, keeps_thickness: bool = False
    ) -> tuple[float, float]:
        """Return the part of ``[low, high]`` about the free length in which there is a bore [mm].

        It ends where 1/10,000 of the bore's area at rest is left. The wall keeps its volume, or
        else its thickness.
        """
        return _find_lengths(self, low, high, keeps_thickness)


@lru_cache(maxsize=256)
def _find_lengths(
    wall: BladderWall, low: float, high: float, keeps_thickness: bool
) -> tuple[float, float]:
    """Return the answer of `BladderWall.find_lengths`, which a fit asks for again and again."""
    left = _OPEN_BORE_SHARE * wall.bore_at_rest**2
    strand, turns = wall.braid.strand_length, wall.braid.turns
    volume, thinnest = wall.volume / math.pi, wall.thickness + math.sqrt(left)

    def spare(length: float) -> float:
        radius = math.sqrt((strand - length) * (strand + length)) / (2.0 * math.pi * turns)
        return radius - thinnest if keeps_thickness else (radius**2 - left) * length - volume

    rest = wall.braid.length
    if spare(low) < 0.0:
        low = bisect(spare, low, rest)
    if spare(high) < 0.0:
        high = bisect(lambda length: -spare(length), rest, high)
    return low, high


def find_radius(braid: Braid, length: Floats) -> Floats:
    """Return the radius of a braid at a length that is known to be legal [mm]."""
    strand, turns = braid.strand_length, braid.turns
    across = np.sqrt((strand - length) * (strand + length))
    return np.asanyarray(across / (2.0 * math.pi * turns))


def pull_ideal(braid: Braid, pressure: Floats, length: Floats) -> Floats:
    """Return Gaylord's pull ``P (3 l**2 - b**2) / (4 pi N**2)`` [N], of any pressure."""
    scale = 4.0 * math.pi * braid.turns**2
    return np.asanyarray(pressure * (3.0 * length**2 - braid.strand_length**2) / scale)


def balance_forces(
    pressure: Floats,
    length: Floats,
    *,
    braid: Braid,
    section: tuple[Floats | float, Floats | float],
    stresses: tuple[Floats | float, Floats | float],
    wall_pressure: bool = True,
) -> Floats:
    """Return the pull of the muscle by the balance of forces [N].

    The section is the wall's thickness [mm] and area [mm^2] as they are then, the stresses are
    axial and hoop, tension positive [MPa]. Some papers leave out the pressure on the wall.
    """
    (thickness, area), (axial_stress, hoop_stress) = section, stresses
    radius = find_radius(braid, length)
    slope = thickness * length**2 / (2.0 * math.pi * radius * braid.turns**2)
    pull = pull_ideal(braid, pressure, length) + axial_stress * area - hoop_stress * slope
    return np.asanyarray(pull + pressure * (area - slope) if wall_pressure else pull)


def find_contact_pressure(
    pressure: Floats,
    length: Floats,
    *,
    braid: Braid,
    thickness: Floats | float,
    hoop_stress: Floats | float,
) -> Floats:
    """Return the braid's pressure on the wall, ``P_o`` [MPa]; negative where they would part."""
    radius = find_radius(braid, length)
    return np.asanyarray((pressure * (radius - thickness) - hoop_stress * thickness) / radius)


class WalledModel(CatalogueModel):
    """A model with a wall that touches the braid: the bore must stay open at its lengths."""

    keeps_thickness: ClassVar[bool] = False
    """Whether the wall is as thick as at rest at every length, instead of keeping its volume."""

    @cached_property
    def wall(self) -> BladderWall:
        """The wall at rest."""
        return BladderWall.of(self.muscle, self.braid)

    def _base_lengths(self) -> tuple[float, float]:
        ends = super()._base_lengths()
        return self.wall.find_lengths(*ends, keeps_thickness=self.keeps_thickness)


class ForceBalanceModel(WalledModel):
    """A model that is the balance of forces with a stress law; the wall keeps its volume.

    A subclass brings `_stresses`, and may give up `wall_pressure`.
    """

    wall_pressure = True
    """Whether the balance has the term of the pressure on the wall."""

    @abstractmethod
    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        """Axial and hoop stress in the wall [MPa]."""

    def _section(self, length: Floats) -> tuple[Floats | float, Floats | float]:
        """Thickness of the wall [mm], and area that bears the axial stress [mm^2]."""
        return self.wall.thickness_at(length), self.wall.area_at(length)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return balance_forces(
            pressure,
            length,
            braid=self.braid,
            section=self._section(length),
            stresses=self._stresses(pressure, length),
            wall_pressure=self.wall_pressure,
        )

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return find_contact_pressure(
            pressure,
            length,
            braid=self.braid,
            thickness=self._section(length)[0],
            hoop_stress=self._stresses(pressure, length)[1],
        )


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

    extensile = True
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

    extensile = True
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

    extensile = True
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
        braid, thickness = self.braid, self.wall.thickness
        cosine = length / braid.strand_length
        sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length * thickness / (math.pi * braid.turns)
        wall = scale * (2.0 * sine - 1.0 / sine) - thickness**2
        return np.asanyarray(pull_ideal(braid, pressure, length) + math.pi * pressure * wall)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return find_contact_pressure(
            pressure, length, braid=self.braid, thickness=self.wall.thickness, hoop_stress=0.0
        )


def pull_by_strain(
    braid: Braid, pressure: Floats, stretch: Floats, *, factor: Floats | float = 1.0
) -> Floats:
    """Return ``factor pi r0**2 P [q1 stretch**2 - q2]`` [N]."""
    scale = factor * math.pi * braid.radius**2
    return np.asanyarray(scale * pressure * bracket(braid, stretch))


def bracket(braid: Braid, stretch: Floats | float) -> Floats:
    """Return ``q1 stretch**2 - q2`` of a braid; with stretch 1, Gaylord's at rest."""
    cotangent = 1.0 / math.tan(braid.angle)
    return np.asanyarray(3.0 * (stretch * cotangent) ** 2 - 1.0 / math.sin(braid.angle) ** 2)


def measure_ideal(muscle: Muscle) -> tuple[float, float, float]:
    """Return Gaylord's pull per pressure at rest, its ``pi r0**2 q1`` [N/MPa], its free strain."""
    braid = muscle.braid
    first = 3.0 * math.pi * braid.radius**2 / math.tan(braid.angle) ** 2
    free = braid.locking_contraction / braid.length
    return float(braid.ideal_force(1.0, braid.length)), first, free
