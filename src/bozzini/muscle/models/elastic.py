"""Muscles with a linear elastic bladder, all from the balance of forces (thesis 2.2.3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .base import CatalogueModel
from .card import WALL_FIELDS, Card, Law, make_friction
from .force_balance import (
    ForceBalanceModel,
    WalledModel,
    balance_forces,
    find_contact_pressure,
    find_radius,
    pull_ideal,
)

__all__ = ["FAMILY", "ConstantThickness", "Ferraresi", "KotheraBalance", "Schulte"]

Floats = NDArray[np.float64]


class ConstantThickness(WalledModel):
    """A linear elastic bladder as thick as at rest, without the pressure on its wall.

    A subclass brings the area of the cross-section that bears the axial stress.
    """

    keeps_thickness = True

    def _find_area(self, length: Floats) -> Floats | float:
        """Area that bears the axial stress [mm^2]."""
        raise NotImplementedError

    def _find_hoop_stress(self, length: Floats) -> Floats:
        braid = self.braid
        return np.asarray(self.muscle.modulus * (find_radius(braid, length) / braid.radius - 1.0))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return balance_forces(
            pressure,
            length,
            braid=self.braid,
            thickness=self.wall.thickness,
            area=self._find_area(length),
            axial_stress=self.muscle.modulus * (length / self.braid.length - 1.0),
            hoop_stress=self._find_hoop_stress(length),
            wall_pressure=False,
        )

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return find_contact_pressure(
            pressure,
            length,
            braid=self.braid,
            thickness=self.wall.thickness,
            hoop_stress=self._find_hoop_stress(length),
        )


class Schulte(ConstantThickness):
    """The first model with a bladder: thin, linear elastic, with friction on the braid.

    The printed elastic term has no thickness and does not vanish at rest; what stands here is the
    balance of forces for a thin wall, ``s_z = E (l / l0 - 1)``, ``s_h = E (r / r0 - 1)``. Friction
    is ``mu (P - P_u) 2 pi r l0``, with the sum ``mu`` of the coefficients between strands and
    between strands and tube. It needs the pressure ``P_u`` that inflates the free tube to the
    radius ``r``, which the survey does not give: the law ``inflation_pressure``. Below it there is
    no contact and no friction. ``as_printed=True`` takes friction off at any direction.
    """

    card = Card(
        name="schulte",
        title="Thin linear elastic bladder, friction on the braid",
        authors="Schulte",
        reference="H. F. Schulte, The characteristics of the McKibben artificial muscle, in: The "
        "application of external power in prosthetics and orthotics, National Academy of Sciences, "
        "Publication 874, 1961",
        equation="(2.15)",
        status="partial",
        parameters=(
            make_friction("sum of the friction coefficients of strands and of strands on tube"),
        ),
        laws=(
            Law(
                name="inflation_pressure",
                arguments=("radius [mm]",),
                unit="MPa",
                what="the pressure that inflates the free tube to a radius",
                paper="Schulte (1961)",
                only_with="friction",
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The printed elastic term has no thickness of the wall, and is b E l0 sin(theta0) / N "
            "at rest instead of 0.",
        ),
        latex=r"F = \frac{P b^2}{4 \pi N^2} (3 \cos^2\theta - 1) + \frac{b E t_0}{N} \left["
        r"\sin\theta \left(\frac{l}{l_0} - 1\right) - \frac{\cos^2\theta}{\sin\theta} "
        r"\frac{b \sin\theta / N - 2 \pi r_0}{2 \pi r_0}\right] "
        r"\mp \frac{l_0 b}{N} (P - P_u) \mu \sin\theta",
        latex_printed=r"F = \frac{P b^2}{4 \pi N^2} (3 \cos^2\theta - 1) + \frac{b E}{N} \left["
        r"l_0 \sin\theta - \frac{\cos^2\theta}{\sin\theta} \left(\frac{b}{N} \sin\theta - "
        r"2 \pi r_0\right)\right] - \frac{l_0 b}{N} (P - P_u) \mu \sin\theta",
        missing="P_u, the pressure that inflates the free tube to the braid's radius: "
        "Schulte (1961). Only friction needs it.",
    )

    def _find_area(self, length: Floats) -> Floats:
        radius = find_radius(self.braid, length)
        return np.asarray(2.0 * math.pi * radius * self.wall.thickness)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        if not self.as_printed:
            return super()._pull(pressure, length)
        braid = self.braid
        cosine = length / braid.strand_length
        sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length / braid.turns
        round_it = scale * sine - 2.0 * math.pi * braid.radius
        wall = braid.length * sine - cosine**2 / sine * round_it
        elastic = scale * self.muscle.modulus * wall
        return np.asarray(
            pull_ideal(braid, pressure, length) + elastic - self._rub(pressure, length)
        )

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return np.zeros(pressure.shape) if self.as_printed else self._rub(pressure, length)

    def _rub(self, pressure: Floats, length: Floats) -> Floats:
        friction = self.parameters["friction"]
        if friction == 0.0:
            return np.zeros(pressure.shape)
        radius = find_radius(self.braid, length)
        excess = np.maximum(pressure - self._call("inflation_pressure", radius), 0.0)
        return np.asarray(friction * excess * 2.0 * math.pi * radius * self.braid.length)


class Ferraresi(ConstantThickness):
    """A thin linear elastic bladder; the axial stress acts on the wall's area at rest.

    With the area ``2 pi r t0`` instead it is the corrected `Schulte`.
    """

    card = Card(
        name="ferraresi",
        title="Thin linear elastic bladder",
        authors="Ferraresi, Franco, Manuello Bertetto",
        reference="C. Ferraresi, W. Franco, A. Manuello Bertetto, Flexible pneumatic actuators: a "
        "comparison between the McKibben and the straight fibres muscles, Journal of Robotics and "
        "Mechatronics 13(1), 2001",
        equation="(2.16)",
        status="corrected",
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The root is printed as sqrt(l**2 - b**2), imaginary for every braid: b**2 - l**2.",
            "The hoop term is printed with l, a force per length: l**2.",
            "The hoop term is printed with a minus, which makes the bladder help: plus.",
            "It vanishes at rest only with the radius it is measured at: r0 for the printed r_i.",
            "The axial term is printed E A l / l0, a pull at rest: E A (l / l0 - 1).",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + E t_0 l^2 \left("
        r"\frac{1}{N \sqrt{b^2 - l^2}} - \frac{1}{2 \pi N^2 r_0}\right) "
        r"+ E A \left(\frac{l}{l_0} - 1\right)",
        latex_printed=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) - E t_0 l \left("
        r"\frac{1}{N \sqrt{l^2 - b^2}} - \frac{1}{2 \pi N^2 r_i}\right) "
        r"+ E A \left(\frac{l}{l_0}\right)",
        unprintable="its root of l**2 - b**2 is imaginary, a braid being shorter than its strands",
    )

    def _find_area(self, length: Floats) -> float:
        return self.wall.area_at_rest


class KotheraBalance(ForceBalanceModel):
    """The balance of forces on a thick linear elastic bladder that keeps its volume.

    ``s_z = E (l / l0 - 1)``. The hoop term ``E l (t l - t0 l0) / (2 pi r N**2)`` is that of
    ``s_h = E (r / r0 - 1)`` in a thin wall, where ``r t l`` is constant; it is kept as printed,
    with the thickness of the thick wall.

    The pressure on a thick wall takes from the pull where the braid angle is small, so that at
    high pressure the pull can grow at first as the muscle contracts.
    """

    card = Card(
        name="kothera-balance",
        title="Thick linear elastic bladder, balance of forces",
        authors="Kothera, Jangid, Sirohi, Wereley",
        reference="C. S. Kothera, M. Jangid, J. Sirohi, N. M. Wereley, Experimental "
        "characterization and static modeling of McKibben actuators, Journal of Mechanical Design "
        "131(9), 2009",
        equation="(2.17)",
        status="self-contained",
        uses=(*WALL_FIELDS, "modulus"),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + P \left(\frac{V_b}{l} - "
        r"\frac{t l^2}{2 \pi r N^2}\right) + E V_b \left(\frac{1}{l_0} - \frac{1}{l}\right) "
        r"+ \frac{E l}{2 \pi r N^2} (t l - t_0 l_0)",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        modulus, rest, wall = self.muscle.modulus, self.braid.length, self.wall
        thinning = wall.thickness * rest / (wall.thickness_at(length) * length)
        return np.asarray(modulus * (length / rest - 1.0)), np.asarray(modulus * (thinning - 1.0))


FAMILY: tuple[type[CatalogueModel], ...] = (Schulte, Ferraresi, KotheraBalance)
"""The models of this module, for the registry."""
