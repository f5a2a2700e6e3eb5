"""Miniature muscles by the balance of forces, with stresses fitted to strain (thesis 2.2.8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..design import Muscle
from .base import CatalogueModel
from .card import WALL_FIELDS, Card, Parameter
from .force_balance import ForceBalanceModel, find_radius

__all__ = ["FAMILY", "MODULI", "ORDERS", "PressureStiffening", "StrainStress", "sum_powers"]

Floats = NDArray[np.float64]

ORDERS = (1, 2, 3, 4)
"""Powers of the strain that a fitted stress has."""

MODULI = tuple(
    Parameter(
        name=f"modulus{i}",
        unit="MPa",
        what=f"stress per strain to the power of {i}",
        source="fitted",
        default=None if i == 1 else 0.0,
        neutral=0.0,
        bounds=(-1e6, 1e6),
        linear=True,
    )
    for i in ORDERS
)
_SLOPES = tuple(
    Parameter(
        name=f"modulus{i}_slope",
        unit="",
        what=f"growth of modulus{i} per pressure",
        source="fitted",
        default=0.0,
        neutral=0.0,
        bounds=(-1e6, 1e6),
        linear=True,
    )
    for i in ORDERS
)


class StrainStress(ForceBalanceModel):
    """A balance of forces whose stresses follow the strains along and round the muscle."""

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return a linear elastic bladder of the tube's modulus."""
        guess = super().guess_parameters(muscle)
        return {name: muscle.modulus if name == "modulus1" else guess[name] for name in guess}

    def _find_strains(self, length: Floats) -> tuple[Floats, Floats]:
        """``l / l0 - 1`` and ``r / r0 - 1``."""
        braid = self.braid
        axial = (length - braid.length) / braid.length
        return np.asarray(axial), np.asarray(find_radius(braid, length) / braid.radius - 1.0)


class PressureStiffening(StrainStress):
    """The balance of forces with a polynomial stress that grows with the pressure.

    ``s = sum (E_iI + E_iS P) e**i`` of the axial strain ``l / l0 - 1`` and of the hoop strain
    ``r / r0 - 1``, up to the fourth power; the strains are positive where the wall is stretched,
    while the survey's ``epsilon`` is positive in contraction. The pressure acts on the wall as in
    the balance of forces; with a thickness that stays as it is, that term is Chou's.
    """

    card = Card(
        name="pressure-stiffening",
        title="Balance of forces, polynomial stress that grows with pressure",
        authors="unnamed in the survey",
        reference="Reference [25] of the thesis, after Hocking and Wereley (2012)",
        equation="(2.38)",
        status="fitted",
        parameters=(*MODULI, *_SLOPES),
        uses=WALL_FIELDS,
        errata=(
            "Printed with the strain epsilon of contraction; the stress resists it only as a "
            "function of strains that are positive in tension.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + P \left(\frac{V_b}{l} - "
        r"\frac{t l^2}{2 \pi r N^2}\right) + \sigma_z \frac{V_b}{l} "
        r"- \frac{\sigma_\theta t l^2}{2 \pi N^2 r}, \quad "
        r"\sigma = \sum_i (E_{iI} + E_{iS} P) e^i",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        given = self.parameters
        factors = [
            np.asarray(given[f"modulus{i}"] + given[f"modulus{i}_slope"] * pressure) for i in ORDERS
        ]
        axial, hoop = (sum_powers(strain, factors) for strain in self._find_strains(length))
        return axial, hoop


def sum_powers(strain: Floats, factors: Sequence[Floats | float]) -> Floats:
    """Return the sum of ``factors[i] strain**(i + 1)``."""
    total: Floats = np.zeros(strain.shape)
    for factor in reversed(factors):
        total = (total + factor) * strain
    return total


FAMILY: tuple[type[CatalogueModel], ...] = (PressureStiffening,)
"""The models of this module, for the registry."""
