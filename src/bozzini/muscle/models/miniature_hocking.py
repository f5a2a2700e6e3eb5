"""Miniature muscles of Hocking and Wereley: balance of forces with fitted stress (2.2.8)."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ...checks import check_range
from ..braid import Braid
from ..model import bisect
from .base import CatalogueModel
from .card import WALL_FIELDS, Card, Choice, Law, Parameter
from .force_balance import find_radius, pull_ideal
from .miniature_stress import MODULI, ORDERS, StrainStress, sum_powers

__all__ = ["FAMILY", "HockingBase", "HockingFriction", "HockingPolynomial", "correct_length"]

Floats = NDArray[np.float64]

_HOCKING = (
    "E. G. Hocking, N. M. Wereley, Analysis of nonlinear elastic behavior in miniature pneumatic "
    "artificial muscles, Smart Materials and Structures 22, 2012"
)
_ENDS = Choice(
    name="ends",
    what="whether the length in the law is corrected for rounded ends",
    words=("plain", "corrected"),
)
_TURNS = "The pressure term is printed over 4 pi N, N times Gaylord's: over 4 pi N**2."
_PRINTED = r"\frac{P}{4 \pi N} (3 l^2 - b^2)"


def correct_length(braid: Braid, length: Floats) -> Floats:
    """Return ``l - 2 (pi / 2 - 1) (r - r0)``, the length of a muscle with rounded ends [mm].

    A sheath of length ``l`` from fitting to fitting, measured along it, that at each end bends
    round a quarter of a circle from the fitting's radius ``r0`` to its own ``r``, is that long
    along the axis. The survey puts it into the law of the force in the place of the length.

    Parameters
    ----------
    braid : Braid
    length : ndarray
        Length [mm], known to be legal.
    """
    excess = find_radius(braid, length) - braid.radius
    return np.asarray(length - (math.pi - 2.0) * excess)


@lru_cache(maxsize=16)  # a fit asks again and again, of the same braid
def _find_limits(braid: Braid, low: float, high: float) -> tuple[float, float]:
    """Return the lengths whose `correct_length` are `low` and `high` [mm]."""

    def find(length: float) -> float:
        return float(correct_length(braid, np.asarray(length)))

    return (
        bisect(lambda length: find(length) - low, low, braid.length),
        bisect(lambda length: find(length) - high, braid.length, high),
    )


class HockingBase(StrainStress):
    """The balance of forces with any stresses, without the pressure on the wall.

    The stresses are laws of the strains ``l / l0 - 1`` along and ``r / r0 - 1`` round the muscle,
    tension positive. With ``ends="corrected"`` length, radius and thickness in the law are those of
    the `correct_length`.
    """

    wall_pressure = False

    card = Card(
        name="hocking-base",
        title="Balance of forces with any stresses",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.35)",
        status="corrected",
        choices=(_ENDS,),
        laws=(
            Law(
                name="axial_stress",
                arguments=("axial strain",),
                unit="MPa",
                what="the stress along the muscle",
                paper="Hocking and Wereley (2012), as a polynomial: see the model hocking-1",
            ),
            Law(
                name="hoop_stress",
                arguments=("hoop strain",),
                unit="MPa",
                what="the stress round the muscle",
                paper="Hocking and Wereley (2012), as a polynomial: see the model hocking-1",
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            _TURNS,
            "The text swaps the two stresses: the one over the wall's cross-section is axial.",
            "It leaves the pressure on the wall out, which the balance of forces has.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + \sigma_z \frac{V_b}{l} "
        r"- \frac{\sigma_\theta t l^2}{2 \pi N^2 r}",
        latex_printed=rf"F = {_PRINTED} + \sigma_1 \frac{{V_b}}{{l}} "
        r"- \frac{\sigma_2 t l^2}{2 \pi N^2 r}",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        axial, hoop = self._find_strains(length)
        return self._call("axial_stress", axial), self._call("hoop_stress", hoop)

    def _find_length(self, length: Floats) -> Floats:
        """Length in the law [mm]."""
        return length if self.keywords["ends"] == "plain" else correct_length(self.braid, length)

    def _find_pressure(self, pressure: Floats) -> Floats:
        """Pressure in the law [MPa]."""
        return pressure

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        acting, at = self._find_pressure(pressure), self._find_length(length)
        pull = super()._pull(acting, at)
        if self.as_printed:
            pull = pull + (self.braid.turns - 1.0) * pull_ideal(self.braid, acting, at)
        return pull

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return super()._contact_pressure(self._find_pressure(pressure), self._find_length(length))

    def _base_lengths(self) -> tuple[float, float]:
        low, high = super()._base_lengths()
        if self.keywords["ends"] == "plain":
            return low, high
        return _find_limits(self.braid, low, high)


class HockingPolynomial(HockingBase):
    """The balance of forces with one polynomial of strain for both stresses.

    ``s_z = sum E_i (l / l0 - 1)**i`` and ``s_h = sum E_i (r / r0 - 1)**i``, up to the fourth power;
    the survey does not say how many the paper has. With the first alone it is a linear elastic
    bladder, the model kothera-balance but for the pressure on the wall and the hoop strain.
    """

    card = Card(
        name="hocking-1",
        title="Balance of forces, polynomial stress",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.36)",
        status="fitted",
        parameters=MODULI,
        choices=(_ENDS,),
        uses=WALL_FIELDS,
        errata=(_TURNS,),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + \frac{V_b}{l} \sum_i E_i \left("
        r"\frac{l}{l_0} - 1\right)^i - \frac{t l^2}{2 \pi N^2 r} \sum_i E_i \left("
        r"\frac{r}{r_0} - 1\right)^i",
        latex_printed=rf"F = {_PRINTED} + \frac{{V_b}}{{l}} \sum_i E_i \left("
        r"\frac{l}{l_0} - 1\right)^i - \frac{t l^2}{2 \pi N^2 r} \sum_i E_i \left("
        r"\frac{r}{r_0} - 1\right)^i",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        given = self.parameters
        factors = [given[f"modulus{i}"] for i in ORDERS]
        axial, hoop = (sum_powers(strain, factors) for strain in self._find_strains(length))
        return axial, hoop


class HockingFriction(HockingPolynomial):
    """The same with a dead band, rounded ends, and friction in proportion to the pull.

    The pressure that acts is ``P - P_c``, none below the dead band. Friction is ``mu(P)`` times the
    size of the pull, and against the motion; as printed it is ``mu(P)`` times the pull, which helps
    the motion where the muscle pushes. How ``mu`` depends on the pressure is in the paper only:
    the law `friction`, in [0, 1], without which there is none.
    """

    card = Card(
        name="hocking-2",
        title="Polynomial stress, dead band, rounded ends, friction",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.37)",
        status="fitted",
        parameters=(
            *MODULI,
            Parameter(
                name="dead_band_pressure",
                unit="MPa",
                what="pressure below which the muscle does not contract",
                source="measured",
                default=0.0,
                neutral=0.0,
                bounds=(0.0, 1e4),
            ),
        ),
        choices=(Choice(name=_ENDS.name, what=_ENDS.what, words=_ENDS.words[::-1]),),
        laws=(
            Law(
                name="friction",
                arguments=("pressure [MPa]",),
                unit="",
                what="friction over pull",
                paper="Hocking and Wereley (2012)",
                required=False,
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            _TURNS,
            "The sign of friction is printed twice, as +- and as sgn(v).",
            "Printed friction is in proportion to the pull with its sign, and helps the motion "
            "where that is negative: its size is taken.",
            "A sheath with rounded ends is longer, not shorter, than the muscle by the amount of "
            "the correction; the length is corrected as the survey says.",
        ),
        latex=r"F = F_1 \mp \mu(P) |F_1|, \quad F_1 = F_{hocking-1}(P - P_c, l_c), \quad "
        r"l_c = l - 2 \left(\frac{\pi}{2} - 1\right) (r - r_0)",
        latex_printed=r"F = F_1 \pm \mu_f F_1 \, \mathrm{sgn}(v), \quad "
        rf"F_1 = {_PRINTED} + \dots",
        missing="how the coefficient of friction depends on the pressure: Hocking and Wereley "
        "(2012). Only friction needs it.",
    )

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]."""
        return self.parameters["dead_band_pressure"]

    def _find_pressure(self, pressure: Floats) -> Floats:
        return np.asarray(np.maximum(pressure - self.dead_band(), 0.0))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        if "friction" not in self.keywords:
            return np.zeros(pressure.shape)
        share = self._call("friction", pressure)
        check_range("answer of friction", share, 0.0, 1.0)
        pull = self._pull(pressure, length)
        return np.asarray(share * (pull if self.as_printed else np.abs(pull)))


FAMILY: tuple[type[CatalogueModel], ...] = (HockingBase, HockingPolynomial, HockingFriction)
"""The models of this module, for the registry."""
