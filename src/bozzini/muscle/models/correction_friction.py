"""Tondu and Lopez's muscle with the contact area of round strands (thesis 2.2.2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .base import CatalogueModel
from .card import BRAID_FIELDS, Card, Choice, Parameter
from .correction import FRICTION, TONDU_PARAMETERS, StrainCorrected, find_tondu_factor

__all__ = ["FAMILY", "DavisCaldwell"]

Floats = NDArray[np.float64]


class DavisCaldwell(StrainCorrected):
    """Tondu and Lopez's pull, its friction over the area at which the strands lie side by side.

    The contact area of flat strands is that of the whole cylinder at the smallest braid angle
    ``theta_m``, and falls from there; round strands touch on less of it, by Hertz's contact of two
    spheres of a strand's radius under the load ``P (2 r_n)**2``.

    What is mended can be had back by two choices. ``minimum_angle``: ``"geometric"`` has strands
    of one family, ``4 pi r cos(theta) / m`` apart, at ``2 r_n``; ``"thesis"`` is (2.10) as
    printed, right only if its ``r0`` is the radius at 90 degrees. ``scale``: ``"areas"`` is the
    ratio of areas ``(r_n / a)**2`` that the text announces, with the contact's radius ``a``;
    ``"radii"`` is the printed (2.11), ``r_n / a``. ``as_printed=True`` has the printed ones, and
    ``S2`` with sine and cosine instead of their squares, so that it is no area of the cylinder.

    The strands' radius, number and modulus are the muscle's.
    """

    card = Card(
        name="davis-caldwell",
        title="Strain factor, friction of round strands",
        authors="Davis, Caldwell",
        reference="S. Davis, D. G. Caldwell, Braid effects on contractile range and friction "
        "modeling in pneumatic muscle actuators, International Journal of Robotics Research "
        "25(4), 2006",
        equation="(2.9)-(2.12)",
        status="fitted",
        parameters=(
            *TONDU_PARAMETERS,
            FRICTION,
            Parameter(
                name="strand_poisson_ratio",
                unit="",
                what="Poisson's ratio of a strand",
                source="material",
                bounds=(0.0, 0.5),
                only_with="friction",
            ),
        ),
        choices=(
            Choice(
                name="minimum_angle",
                what="angle at which the strands lie side by side",
                words=("geometric", "thesis"),
                printed="thesis",
            ),
            Choice(
                name="scale",
                what="ratio of flat to round contact",
                words=("areas", "radii"),
                printed="radii",
            ),
        ),
        uses=(*BRAID_FIELDS, "strands", "strand_radius", "strand_modulus"),
        errata=(
            "(2.9) prints sin(theta_m) cos(theta_m): only its square is the cylinder's lateral "
            "area at theta = theta_m.",
            "(2.10) lacks sin(theta0): strands of one family are 4 pi r cos(theta) / m apart.",
            "(2.11) is a ratio of radii, the text says of areas; its 1.442 is 3**(1/3).",
            "The exponent of the strain factor is printed without the unit of P.",
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \mp \mu_s P \frac{S_2}{S_s}, \quad "
        r"S_2 = \frac{b^2 \sin^2\theta_m \cos^2\theta_m}{N \sin\theta \cos\theta}, \quad "
        r"\sin 2\theta_m = \frac{m r_n \sin\theta_0}{\pi r_0}, \quad "
        r"S_s = \left(3 P \frac{1 - \nu_n^2}{E_n}\right)^{-2/3}",
        latex_printed=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \pm \mu_s P \frac{S_2}{S_s}, "
        r"\quad S_2 = \frac{b^2 \sin\theta_m \cos\theta_m}{N \sin\theta \cos\theta}, \quad "
        r"\theta_m = \frac{1}{2} \sin^{-1} \frac{r_n m}{\pi r_0}, \quad S_s = "
        r"\frac{r_n}{1.442 \left[P r_n^3 (1 - \nu_n^2) / E_n\right]^{1/3}}",
    )

    @property
    def smallest_angle(self) -> float:
        """Braid angle at which the strands lie side by side [rad], by `minimum_angle`."""
        share = self.muscle.strand_radius * self.muscle.strands / (math.pi * self.braid.radius)
        if self.keywords["minimum_angle"] == "geometric":
            share *= math.sin(self.braid.angle)
        return 0.5 * math.asin(min(share, 1.0))

    def find_scale(self, pressure: Floats) -> Floats:
        """Return how much more flat strands touch than round ones, by `scale`; not at 0 MPa.

        Parameters
        ----------
        pressure : ndarray
            Pressure [MPa].
        """
        return np.asarray(1.0 / self._find_share(pressure))

    def _check(self) -> None:
        share = self.muscle.strand_radius * self.muscle.strands / (math.pi * self.braid.radius)
        if self.keywords["minimum_angle"] == "thesis" and share > 1.0:
            most = math.pi * self.braid.radius / self.muscle.strands
            raise InputError(
                f"muscle strand radius is {self.muscle.strand_radius:g} mm: for (2.10) as printed "
                f"it must be at most {most:g} mm"
            )

    def _find_factor(self, pressure: Floats) -> Floats:
        return find_tondu_factor(self.parameters, pressure)

    def _find_share(self, pressure: Floats) -> Floats:
        """Round contact over flat contact."""
        ratio = self.parameters["strand_poisson_ratio"]
        strain = pressure * (1.0 - ratio**2) / self.muscle.strand_modulus
        factor = 1.442 if self.as_printed else math.cbrt(3.0)
        radii = factor * np.cbrt(strain)
        return np.asarray(radii if self.keywords["scale"] == "radii" else radii**2)

    def _find_contact_area(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        least = self.smallest_angle
        top = math.sin(least) * math.cos(least)
        cosine = length / braid.strand_length
        bottom = cosine * np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length**2 / braid.turns
        return np.asarray(scale * (top if self.as_printed else top**2) / bottom)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        friction = self.parameters["friction"]
        if friction == 0.0:
            return np.zeros(pressure.shape)
        area = self._find_contact_area(pressure, length)
        return np.asarray(friction * pressure * area * self._find_share(pressure))


FAMILY: tuple[type[CatalogueModel], ...] = (DavisCaldwell,)
"""The models of this module, for the registry."""
