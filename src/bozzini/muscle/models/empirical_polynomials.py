"""Pulls that are polynomials of strain and pressure, of fitted constants only (thesis 2.2.9)."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from ..design import Muscle
from .base import TYPICAL_PRESSURE, CatalogueModel
from .card import SHAPE_FIELDS, Card, Parameter

__all__ = ["FAMILY", "DampedStrain", "LinearStrain", "QuadraticStrain", "QuarticStrain"]

Floats = NDArray[np.float64]

_PAPERS = "One of the references [92] and [125]-[129] of the thesis, which gives them together"
_WHO = "several, together in the survey"


def _constant(index: int, unit: str, what: str, *, neutral: float | None = 0.0) -> Parameter:
    return Parameter(
        name=f"kappa{index}",
        unit=unit,
        what=what,
        source="fitted",
        neutral=neutral,
        bounds=(-1e9, 1e9),
        linear=True,
    )


def _ideal(muscle: Muscle) -> tuple[float, float, float]:
    """Gaylord's pull per pressure at rest [N/MPa], its ``pi r0**2 q1``, and its locking strain."""
    braid = muscle.braid
    first = 3.0 * math.pi * braid.radius**2 / math.tan(braid.angle) ** 2
    return (
        float(braid.ideal_force(1.0, braid.length)),
        first,
        braid.locking_contraction / braid.length,
    )


class StrainPolynomial(CatalogueModel):
    """A pull that is a sum of constants ``kappa`` times terms of pressure and strain."""

    @abstractmethod
    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        """What ``kappa1``, ``kappa2`` and so on are multiplied by."""

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        strain = np.asarray((self.braid.length - length) / self.braid.length)
        pull = np.zeros(pressure.shape)
        for i, term in enumerate(self._find_terms(pressure, strain), start=1):
            pull = pull + given[f"kappa{i}"] * term
        return pull


class QuarticStrain(StrainPolynomial):
    """A quadratic of strain times pressure, and a quartic of strain: Gaylord's pull is one."""

    card = Card(
        name="quartic-strain",
        title="Quadratic of strain times pressure, plus a quartic",
        authors=_WHO,
        reference=_PAPERS,
        equation="(2.45)",
        status="fitted",
        parameters=(
            *(_constant(i, "N/MPa", f"pull per pressure, strain^{i - 1}") for i in (1, 2, 3)),
            *(_constant(i, "N", f"pull, strain^{i - 4}") for i in (4, 5, 6, 7, 8)),
        ),
        uses=SHAPE_FIELDS,
        latex=r"F = (\kappa_1 + \kappa_2 \epsilon + \kappa_3 \epsilon^2) P + (\kappa_4 + "
        r"\kappa_5 \epsilon + \kappa_6 \epsilon^2 + \kappa_7 \epsilon^3 + \kappa_8 \epsilon^4)",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's pull."""
        blocked, first, _ = _ideal(muscle)
        guess = {"kappa1": blocked, "kappa2": -2.0 * first, "kappa3": first}
        return {**super().guess_parameters(muscle), **guess}

    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        return (
            *(pressure * strain**k for k in range(3)),
            *(strain**k for k in range(5)),
        )


class QuadraticStrain(StrainPolynomial):
    """A quadratic of strain, plus pressure times a linear function of strain."""

    card = Card(
        name="quadratic-strain",
        title="Linear in pressure, quadratic in strain",
        authors=_WHO,
        reference=_PAPERS,
        equation="(2.46)",
        status="fitted",
        parameters=(
            *(_constant(i, "N", f"pull, strain^{i - 1}") for i in (1, 2, 3)),
            _constant(4, "N/MPa", "pull per pressure"),
            _constant(5, "N/MPa", "pull per pressure and strain"),
        ),
        uses=SHAPE_FIELDS,
        latex=r"F = \kappa_1 + \kappa_2 \epsilon + \kappa_3 \epsilon^2 + \kappa_4 P "
        r"+ \kappa_5 \epsilon P",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's blocked force and free strain, with a line between."""
        blocked, _, locking = _ideal(muscle)
        guess = {"kappa4": blocked, "kappa5": -blocked / locking}
        return {**super().guess_parameters(muscle), **guess}

    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        return 1.0, strain, strain**2, pressure, strain * pressure


class DampedStrain(StrainPolynomial):
    """A stiffness quadratic in pressure, a blocked force linear in it, and damping.

    The rate of strain is the parameter `strain_rate`, positive: the muscle contracts at it on the
    way up, extends on the way down, and rests without direction.
    """

    card = Card(
        name="damped-strain",
        title="Stiffness quadratic in pressure, damping",
        authors=_WHO,
        reference=_PAPERS,
        equation="(2.47)",
        status="fitted",
        parameters=(
            _constant(1, "N/MPa^2", "pull per strain and squared pressure"),
            _constant(2, "N/MPa", "pull per strain and pressure"),
            _constant(3, "N", "pull per strain"),
            _constant(4, "N/MPa", "pull per pressure"),
            _constant(5, "N", "pull without pressure and strain"),
            Parameter(
                name="kappa6",
                unit="N s",
                what="pull per rate of strain, negative",
                source="fitted",
                neutral=0.0,
                bounds=(-1e9, 1e9),
                linear=True,
                only_with="strain_rate",
            ),
            Parameter(
                name="strain_rate",
                unit="1/s",
                what="rate of strain along a branch",
                source="measured",
                default=0.0,
                neutral=0.0,
                bounds=(0.0, 1e3),
            ),
        ),
        uses=SHAPE_FIELDS,
        latex=r"F = (\kappa_1 P^2 + \kappa_2 P + \kappa_3) \epsilon + \kappa_4 P + \kappa_5 "
        r"+ \kappa_6 \dot\epsilon",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's blocked force and free strain, with a line between."""
        blocked, _, locking = _ideal(muscle)
        guess = {"kappa2": -blocked / locking, "kappa4": blocked}
        return {**super().guess_parameters(muscle), **guess}

    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        return pressure**2 * strain, pressure * strain, strain, pressure, 1.0

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        rate = given["strain_rate"]
        return np.full(pressure.shape, -given["kappa6"] * rate if rate else 0.0)


class LinearStrain(CatalogueModel):
    """A pull that falls in a line from a blocked force to none at the largest strain.

    It is of one pressure, at which both ends are measured; any other makes no difference.
    """

    card = Card(
        name="linear-strain",
        title="A line from blocked force to largest strain, at one pressure",
        authors=_WHO,
        reference=_PAPERS,
        equation="(2.48)",
        status="fitted",
        parameters=(
            Parameter(
                name="kappa1",
                unit="",
                what="factor of the blocked force",
                source="fitted",
                neutral=1.0,
                bounds=(-1e6, 1e6),
                linear=True,
            ),
            Parameter(
                name="largest_force",
                unit="N",
                what="blocked force; only kappa1 times it matters",
                source="measured",
                bounds=(0.0, 1e6),
            ),
            Parameter(
                name="largest_strain",
                unit="",
                what="strain of contraction without load",
                source="measured",
                bounds=(1e-6, 1.0),
            ),
        ),
        uses=SHAPE_FIELDS,
        latex=r"F = \kappa_1 F_{max} \left(1 - \frac{\epsilon}{\epsilon_{max}}\right)",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's blocked force at 0.5 MPa, and its free strain."""
        blocked, _, locking = _ideal(muscle)
        guess = {"largest_force": TYPICAL_PRESSURE * blocked, "largest_strain": locking}
        return {**super().guess_parameters(muscle), **guess}

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given, rest = self.parameters, self.braid.length
        share = 1.0 - (rest - length) / rest / given["largest_strain"]
        return np.asarray(given["kappa1"] * given["largest_force"] * share)


FAMILY: tuple[type[CatalogueModel], ...] = (
    QuarticStrain,
    QuadraticStrain,
    DampedStrain,
    LinearStrain,
)
"""The models of this module, for the registry."""
