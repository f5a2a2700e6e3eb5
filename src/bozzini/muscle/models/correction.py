"""Gaylord's pull with corrections: of the strain, of the force, for friction (thesis 2.2.2)."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from ...checks import check_range
from ...errors import InputError
from .base import ANGLES, CatalogueModel
from .card import Card, Parameter, make_friction
from .ideal import pull_by_strain

__all__ = [
    "FAMILY",
    "FRICTION_PARAMETERS",
    "IttoDoubled",
    "IttoExponential",
    "StrainCorrected",
    "TONDU_PARAMETERS",
    "TonduLopez",
    "find_tondu_factor",
]

Floats = NDArray[np.float64]

_FACTORS = (1e-6, 1e6)
"""Legal factors of the strain: without sign change, and finite."""

_ITTO = (
    "T. Itto, K. Kogiso, Hybrid modeling of McKibben pneumatic artificial muscle systems, IEEE "
    "International Conference on Industrial Technology, 2011"
)

PRESSURE_UNIT = Parameter(
    name="pressure_unit",
    unit="MPa",
    what="unit of the pressure in the exponent, 0.1 for bar",
    source="unit",
    default=0.1,
    bounds=(1e-6, 1e3),
)
TONDU_PARAMETERS = (
    Parameter(
        name="kappa1",
        unit="",
        what="part of the strain's factor that fades with pressure",
        source="fitted",
        neutral=0.0,
        bounds=(-100.0, 100.0),
    ),
    Parameter(
        name="kappa2",
        unit="",
        what="strain's factor at high pressure",
        source="fitted",
        neutral=1.0,
        bounds=(-100.0, 100.0),
    ),
    PRESSURE_UNIT,
)
_RATE = Parameter(
    name="kappa2",
    unit="1/MPa",
    what="rate at which the strain's factor grows with pressure",
    source="fitted",
    neutral=0.0,
    bounds=(-1000.0, 1000.0),
)
FRICTION = make_friction("coefficient of friction between strands")
FRICTION_PARAMETERS = (
    FRICTION,
    Parameter(
        name="contact_scale",
        unit="",
        what="scale of the contact area; only friction / contact_scale matters",
        source="measured",
        default=1.0,
        bounds=(1e-6, 1e9),
    ),
)
"""Friction over Tondu and Lopez's contact area."""


class StrainCorrected(CatalogueModel):
    """A model whose strain is multiplied by a factor ``k(P)``: ``x = 1 - k eps`` for ``1 - eps``.

    Legal are lengths at which ``x`` is that of a braid angle in `ANGLES`: with ``x`` below, the
    parabola would rise again. A factor outside ``[1e-6, 1e6]`` is refused.
    """

    @abstractmethod
    def _find_factor(self, pressure: Floats) -> Floats:
        """The factor of the strain, ``k``."""

    def _strain_offset(self) -> float:
        """Strain that there is without contraction."""
        return 0.0

    def _find_stretch(self, pressure: Floats, length: Floats) -> Floats:
        strain = (self.braid.length - length) / self.braid.length + self._strain_offset()
        return np.asarray(1.0 - self._find_factor(pressure) * strain)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_by_strain(self.braid, pressure, self._find_stretch(pressure, length))

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        factor = self._find_factor(pressure)
        words = f"strain factor k of the model {self.name} at pressure"
        check_range(words, factor, *_FACTORS)
        rest, cosine = self.braid.length, math.cos(self.braid.angle)
        ends = self._base_lengths()
        lengths = [
            rest * (1.0 + self._strain_offset() - (1.0 - math.cos(angle) / cosine) / factor)
            for angle in ANGLES
        ]
        high, low = (np.clip(length, *ends) for length in lengths)
        if np.any(low >= high):
            index = int(np.argmax(low >= high))
            raise InputError(
                f"pressure is {pressure.flat[index]:g} MPa: the model {self.name} has no legal "
                "length there, its constants and the pressure must leave it one"
            )
        return low, high

    def _find_contact_area(self, pressure: Floats, length: Floats) -> Floats:
        """Tondu and Lopez's contact area of strands, ``S1`` [mm^2]: the lateral area at rest."""
        braid = self.braid
        stretch = self._find_stretch(pressure, length)
        cosine = math.cos(braid.angle) * stretch
        scale = 2.0 * math.pi * braid.radius * braid.length * math.sin(braid.angle)
        return np.asarray(scale / (stretch * np.sqrt((1.0 - cosine) * (1.0 + cosine))))

    def _rub(self, pressure: Floats, length: Floats) -> Floats:
        """Friction ``mu P S1 / S_scale`` [N]."""
        given = self.parameters
        share = given["friction"] / given["contact_scale"]
        return np.asarray(share * pressure * self._find_contact_area(pressure, length))


class TonduLopez(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 exp(-P) + kappa2``, and friction between the strands.

    The exponent is dimensional: ``P`` counts in `pressure_unit`, bar by default. Friction takes
    from the pull on the way up and adds to it on the way down.
    """

    card = Card(
        name="tondu-lopez",
        title="Strain factor that fades with pressure, friction of strands",
        authors="Tondu, Lopez",
        reference="B. Tondu, P. Lopez, Modeling and control of McKibben artificial muscle robot "
        "actuators, IEEE Control Systems Magazine 20(2), 2000",
        equation="(2.6)-(2.8)",
        status="fitted",
        parameters=(*TONDU_PARAMETERS, *FRICTION_PARAMETERS),
        errata=("The exponent is printed without the unit of P: it is an argument here.",),
        latex=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \mp \mu_s P \frac{S_1}{S_s}, \quad "
        r"x = 1 - \left(\kappa_1 e^{-P/P_u} + \kappa_2\right) \epsilon, \quad "
        r"S_1 = \frac{2 \pi r_0 l_0 \sin\theta_0}{x \sqrt{1 - x^2 \cos^2\theta_0}}",
    )

    def _find_factor(self, pressure: Floats) -> Floats:
        return find_tondu_factor(self.parameters, pressure)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return self._rub(pressure, length)


class IttoExponential(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 exp(kappa2 P) + kappa3``."""

    card = Card(
        name="itto-a",
        title="Strain factor of three constants",
        authors="Itto, Kogiso",
        reference=_ITTO,
        equation="(2.6)",
        status="fitted",
        parameters=(
            TONDU_PARAMETERS[0],
            _RATE,
            Parameter(
                name="kappa3",
                unit="",
                what="part of the strain's factor that is constant",
                source="fitted",
                neutral=1.0,
                bounds=(-100.0, 100.0),
            ),
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 (1 - k \epsilon)^2 - q_2\right], \quad "
        r"k = \kappa_1 e^{\kappa_2 P} + \kappa_3",
    )

    def _find_factor(self, pressure: Floats) -> Floats:
        given = self.parameters
        return np.asarray(given["kappa1"] * np.exp(given["kappa2"] * pressure) + given["kappa3"])


class IttoDoubled(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 (1 + exp(kappa2 P))``."""

    card = Card(
        name="itto-b",
        title="Strain factor of two constants",
        authors="Itto, Kogiso",
        reference=_ITTO,
        equation="(2.43)",
        status="fitted",
        parameters=(
            Parameter(
                name="kappa1",
                unit="",
                what="half the strain's factor at no pressure",
                source="fitted",
                neutral=0.5,
                bounds=(0.0, 100.0),
            ),
            _RATE,
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 \left\{1 - \kappa_1 \left(1 + e^{\kappa_2 P}\right) "
        r"\epsilon\right\}^2 - q_2\right]",
    )

    def _find_factor(self, pressure: Floats) -> Floats:
        given = self.parameters
        return np.asarray(given["kappa1"] * (1.0 + np.exp(given["kappa2"] * pressure)))


def find_tondu_factor(given: dict[str, float], pressure: Floats) -> Floats:
    """Return ``kappa1 exp(-P) + kappa2``, with ``P`` in its unit."""
    fading = np.exp(-pressure / given["pressure_unit"])
    return np.asarray(given["kappa1"] * fading + given["kappa2"])


FAMILY: tuple[type[CatalogueModel], ...] = (TonduLopez, IttoExponential, IttoDoubled)
"""The models of this module, for the registry."""
