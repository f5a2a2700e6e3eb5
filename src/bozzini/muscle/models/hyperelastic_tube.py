"""Muscles from the inflation of a hyperelastic tube (thesis 2.2.4)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_range
from ._root import find_between
from .base import CatalogueModel
from .card import WALL_FIELDS, Card, Choice, Law
from .force_balance import WalledModel, find_radius, pull_ideal
from .hyperelastic import HyperelasticModel

__all__ = ["FAMILY", "Trivedi", "Wang"]

Floats = NDArray[np.float64]

_NEAR_LOCKING = 1.0 - 1e-9
_WANG = "Wang, Wereley and Pillsbury (2015)"


class Trivedi(HyperelasticModel):
    """A neo-Hookean bladder whose length without load follows from energy, and a spring about it.

    What the pressure does is what the wall stores, ``P dV = V_b dW``: that gives (2.24), the
    pressure at each length without load, `find_free_pressure`. It grows without bounds towards the
    locking angle. The survey's force (2.25), ``pi E (r0**2 - r_i**2) (lambda - 1)``, has no
    pressure, and at the stretch of (2.24) it is what pulls a contracted muscle back. We read it as
    a spring about the free length ``lambda* l0`` that the pressure makes, with the sign of a pull::

        F = pi E (r0**2 - r_i**2) (l / l0 - lambda*(P))

    With ``force="energy"`` the pull is instead ``-P dV/dl + V_b dW/dl``, the slope of the energy
    that (2.24) comes from; both vanish at the same length.

    ``volume`` is that of the gas. ``"bore"`` is printed, ``pi r_i**2 l0 lambda_1 lambda_2**2`` with
    the hoop stretch of the braid, which a wall that keeps its volume does not allow; with it the
    pressures are those of ``"outer"``, ``pi r**2 l``, times ``r0**2 / r_i**2``. The stretches are
    ``l / l0`` and ``r / r0``, uniform over the wall.

    ``as_printed=True`` has the sign of (2.24), with which the muscle lengthens, and refuses
    pressures at which that ends at no legal length.
    """

    card = Card(
        name="trivedi",
        title="Neo-Hookean energy without load, linear spring about it",
        authors="Trivedi, Lotfi, Rahn",
        reference="D. Trivedi, A. Lotfi, C. D. Rahn, Geometrically exact models for soft robotic "
        "manipulators, IEEE Transactions on Robotics, 2008",
        equation="(2.24)-(2.25)",
        status="corrected",
        choices=(
            Choice(name="volume", what="volume of the gas", words=("bore", "outer")),
            Choice(
                name="force",
                what="the spring of (2.25), or the slope of the energy",
                words=("spring", "energy"),
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The pressure of (2.24) is printed with the wrong sign: a muscle would lengthen.",
            "(2.25) is negative where the muscle has contracted: it is what pulls it back, and the "
            "pull of a muscle that is held is its opposite.",
            "Its volume, the bore scaled with the hoop stretch of the braid, does not go with a "
            "wall that keeps its own: volume='outer' does.",
        ),
        latex=r"F = \pi E (r_0^2 - r_i^2) \left(\frac{l}{l_0} - \lambda_*\right), \quad "
        r"P = \frac{E}{3} \left(\frac{r_0^2}{r_i^2} - 1\right) \frac{\lambda_*^4 (s^2 - c^2) "
        r"(1 - x)^2 - s^4 (1 - 2 x)}{\lambda_*^3 (1 - x)^2 (1 - 3 x)}, \quad x = \lambda_*^2 c^2, "
        r"\quad c = \cos\theta_0, \quad s = \sin\theta_0",
        latex_printed=r"F = \pi E (r_0^2 - r_i^2) (\lambda_1 - 1), \quad P = \frac{E}{3} \left("
        r"\frac{r_0^2}{r_i^2} - 1\right) \frac{\lambda_1^8 c^4 \cos 2\theta_0 - \dots}"
        r"{\lambda_1^3 (1 - 5 x + 7 x^2 - 3 x^3)}",
    )

    def find_free_pressure(self, contraction: ArrayLike) -> Floats:
        """Return the pressure at which the muscle contracts so far without load [MPa], (2.24).

        With ``as_printed=True`` it has the printed sign.

        Parameters
        ----------
        contraction : array_like
            Contraction [mm], from 0 to where the braid locks, which no pressure reaches.

        Raises
        ------
        InputError
            If a contraction is outside that range.
        """
        contractions = check_array("contraction", contraction)
        high = self.braid.locking_contraction * _NEAR_LOCKING
        check_range("contraction", contractions, 0.0, high, "mm")
        length = self.braid.length - contractions
        per_pressure = self._gas_share() * pull_ideal(self.braid, np.ones(length.shape), length)
        return np.asarray(-self._pull_wall(length) / per_pressure)

    def _find_constants(self) -> tuple[float, float]:
        return self.muscle.modulus / 6.0, 0.0

    def _hoop_at(self) -> str:
        return "outer"

    def _gas_share(self) -> float:
        """Volume of the gas over that of the braid, with the sign of (2.24)."""
        bore = (self.wall.bore_at_rest / self.braid.radius) ** 2
        share = bore if self.keywords["volume"] == "bore" else 1.0
        return -share if self.as_printed else share

    def _pull_energy(self, pressure: Floats, length: Floats) -> Floats:
        ideal = pull_ideal(self.braid, self._gas_share() * pressure, length)
        return np.asarray(ideal + self._pull_wall(length))

    def _find_free_length(self, pressure: Floats) -> Floats:
        """Length without load [mm]; NaN where there is none."""
        flat = pressure.ravel()
        low, high = self.braid.locking_length, self._base_lengths()[1]

        def excess(index: NDArray[np.intp], lengths: Floats) -> Floats:
            return self._pull_energy(flat[index], lengths)

        ends = np.full(flat.shape, low), np.full(flat.shape, high)
        return find_between(excess, *ends).reshape(pressure.shape)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        if self.keywords["force"] == "energy":
            return self._pull_energy(pressure, length)
        stretch = (length - self._find_free_length(pressure)) / self.braid.length
        return np.asarray(self.muscle.modulus * self.wall.area_at_rest * stretch)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asarray(self._gas_share() * pressure - self._bear(length))


class Wang(WalledModel):
    """The balance of forces with the forces in an inflated tube, whatever its material.

    The forces are laws of the axial stretch and the pressure: along the muscle, over the whole wall
    and tension positive, and round it, per length. The wall keeps its volume and fills the braid.
    ``as_printed=True`` has the term of the strands, which is no force, with the other sign.
    """

    card = Card(
        name="wang",
        title="Balance of forces on a Mooney-Rivlin tube",
        authors="Wang, Wereley, Pillsbury",
        reference="G. Wang, N. M. Wereley, T. Pillsbury, Non-linear quasi-static model of "
        "pneumatic artificial muscle actuators, Journal of Intelligent Material Systems and "
        "Structures, 2015",
        equation="(2.26)",
        status="partial",
        laws=(
            Law(
                name="axial_force",
                arguments=("axial stretch", "pressure [MPa]"),
                unit="N",
                what="the force along the wall of the inflated tube",
                paper=_WANG,
            ),
            Law(
                name="hoop_force",
                arguments=("axial stretch", "pressure [MPa]"),
                unit="N/mm",
                what="the force round the wall of the inflated tube, per length",
                paper=_WANG,
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            "The term of the strands is printed with a minus: the pressure on them pulls.",
            "It is printed over r_o**2, a force per length: over r_o.",
            "The text swaps the two forces: F_z is along the muscle, F_theta round it.",
        ),
        latex=r"F = F_z - P \pi r_i^2 + \frac{(P r_i - F_\theta) l^2}{2 \pi N^2 r_o}",
        latex_printed=r"F = F_z - P \pi r_i^2 - \frac{P r_i l^2 - F_\theta l^2}{2 \pi N^2 r_o^2}",
        missing="the forces in the tube, F_z and F_theta, from its Mooney-Rivlin constants: "
        f"{_WANG}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        radius = find_radius(braid, length)
        bore = radius - self.wall.thickness_at(length)
        along = self._call("axial_force", length / braid.length, pressure)
        on_braid = radius * self._contact_pressure(pressure, length)
        strands = on_braid * length**2 / (2.0 * math.pi * braid.turns**2 * radius)
        if self.as_printed:
            strands = -strands / radius
        return np.asarray(along - math.pi * pressure * bore**2 + strands)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        radius = find_radius(self.braid, length)
        bore = radius - self.wall.thickness_at(length)
        around = self._call("hoop_force", length / self.braid.length, pressure)
        return np.asarray((pressure * bore - around) / radius)


FAMILY: tuple[type[CatalogueModel], ...] = (Trivedi, Wang)
"""The models of this module, for the registry."""
