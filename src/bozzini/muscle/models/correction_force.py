"""Gaylord's pull scaled to a measured blocked force and free contraction (thesis 2.2.2, 2.2.7)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...checks import check_range
from ..design import Muscle
from .base import TYPICAL_PRESSURE, CatalogueModel
from .card import BRAID_FIELDS, SHAPE_FIELDS, Card, Parameter
from .correction import FRICTION_PARAMETERS, StrainCorrected
from .ideal import bracket

__all__ = ["FAMILY", "Andrikopoulos", "AndrikopoulosThermal", "Meller"]

Floats = NDArray[np.float64]

_ANDRIKOPOULOS = (
    "G. Andrikopoulos, G. Nikolakopoulos, S. Manesis, Novel considerations on static force "
    "modeling of pneumatic muscle actuators, IEEE/ASME Transactions on Mechatronics 21(6), 2016"
)
_MEASURED = (
    Parameter(
        name="largest_force",
        unit="N",
        what="pull at the free length under the test pressure",
        source="fitted",
        bounds=(0.0, 1e6),
        linear=True,
    ),
    Parameter(
        name="largest_contraction",
        unit="mm",
        what="contraction without load under the test pressure",
        source="fitted",
        bounds=(1e-6, 1e4),
    ),
    Parameter(
        name="test_pressure",
        unit="MPa",
        what="pressure of the test; only largest_force / test_pressure matters",
        source="measured",
        bounds=(1e-6, 1e4),
    ),
)


def locking_strain(model: CatalogueModel) -> float:
    """Strain at which the braid locks, ``1 - 1 / (sqrt(3) cos(theta0))``."""
    return model.braid.locking_contraction / model.braid.length


class Meller(StrainCorrected):
    """Gaylord's pull stretched to two measured curves, blocked force and free strain.

    The blocked force is ``kappa1 P + kappa2``, the free strain ``kappa3 ln(P)`` with ``P`` in
    `pressure_unit`, which it has to exceed. The unit that the paper fitted in is not in the
    survey; kilopascal is taken here, so that the law holds above 1 kPa. A blocked force below 0 is
    refused.
    """

    card = Card(
        name="meller",
        title="Scaled to curves of blocked force and free strain",
        authors="Meller, Bryant, Garcia",
        reference="M. A. Meller, M. Bryant, E. Garcia, Reconsidering the McKibben muscle: "
        "energetics, operating fluid, and bladder material, Journal of Intelligent Material "
        "Systems and Structures 25(18), 2014",
        equation="(2.13)",
        status="fitted",
        parameters=(
            Parameter(
                name="kappa1",
                unit="N/MPa",
                what="blocked force per pressure",
                source="fitted",
                bounds=(-1e6, 1e6),
                linear=True,
            ),
            Parameter(
                name="kappa2",
                unit="N",
                what="blocked force extrapolated to no pressure",
                source="fitted",
                neutral=0.0,
                bounds=(-1e6, 1e6),
                linear=True,
            ),
            Parameter(
                name="kappa3",
                unit="",
                what="free strain per logarithm of the pressure",
                source="fitted",
                bounds=(1e-6, 10.0),
            ),
            Parameter(
                name="pressure_unit",
                unit="MPa",
                what="unit of the pressure in the logarithm, 0.001 for kPa",
                source="unit",
                default=0.001,
                bounds=(1e-6, 1e3),
            ),
        ),
        uses=SHAPE_FIELDS,
        errata=("The logarithm is printed without the unit of P: it is an argument here.",),
        latex=r"F = \pi r_0^2 P k_f \left[q_1 (1 - k_\epsilon \epsilon)^2 - q_2\right], \quad "
        r"k_f = \frac{\kappa_1 P + \kappa_2}{\pi r_0^2 P (q_1 - q_2)}, \quad k_\epsilon = "
        r"\frac{1}{\kappa_3 \ln (P / P_u)} \left(1 - \frac{1}{\sqrt{3} \cos\theta_0}\right)",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's blocked force, and its free strain at 0.5 MPa."""
        guess = super().guess_parameters(muscle)
        braid = muscle.braid
        guess["kappa1"] = float(braid.ideal_force(1.0, braid.length))
        strain = braid.locking_contraction / braid.length
        guess["kappa3"] = max(1e-6, strain / math.log(TYPICAL_PRESSURE / guess["pressure_unit"]))
        return guess

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures [MPa]: above the unit, so that the free strain is positive."""
        low, high = super().pressure_limits
        return max(low, 1.001 * self.parameters["pressure_unit"]), high

    def _find_factor(self, pressure: Floats) -> Floats:
        given = self.parameters
        free = given["kappa3"] * np.log(pressure / given["pressure_unit"])
        return np.asarray(locking_strain(self) / free)

    def _find_blocked(self, pressure: Floats) -> Floats:
        given = self.parameters
        return np.asarray(given["kappa1"] * pressure + given["kappa2"])

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        words = "blocked force kappa1 P + kappa2 at pressure"
        check_range(words, self._find_blocked(pressure), 0.0, math.inf, "N")
        return super()._length_limits(pressure)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        shape = bracket(self.braid, self._find_stretch(pressure, length))
        return np.asarray(self._find_blocked(pressure) * shape / bracket(self.braid, 1.0))


class Andrikopoulos(StrainCorrected):
    """Gaylord's pull stretched to one test: a blocked force and a free contraction.

    The factor of the force is the same at all pressures, and so is the free contraction.
    """

    card = Card(
        name="andrikopoulos",
        title="Scaled to one blocked force and one free contraction",
        authors="Andrikopoulos, Nikolakopoulos, Manesis",
        reference=_ANDRIKOPOULOS,
        equation="(2.14)",
        status="fitted",
        parameters=_MEASURED,
        uses=SHAPE_FIELDS,
        latex=r"F = \pi r_0^2 P k_f \left[q_1 (1 - k_\epsilon \epsilon)^2 - q_2\right], \quad "
        r"k_f = \frac{F_{max}}{\pi r_0^2 P_{test} (q_1 - q_2)}, \quad "
        r"k_\epsilon = \frac{l_0}{x_{max}} \left(1 - \sqrt{q_2 / q_1}\right)",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return the test that Gaylord's muscle would give at 0.5 MPa."""
        guess = super().guess_parameters(muscle)
        guess["test_pressure"] = TYPICAL_PRESSURE
        guess["largest_force"] = float(muscle.braid.ideal_force(TYPICAL_PRESSURE, muscle.length))
        share = muscle.active_length / muscle.length
        guess["largest_contraction"] = share * muscle.braid.locking_contraction
        return guess

    def _find_factor(self, pressure: Floats) -> Floats:
        most = self.parameters["largest_contraction"]
        return np.full(pressure.shape, self.braid.length / most * locking_strain(self))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        shape = bracket(self.braid, self._find_stretch(pressure, length))
        blocked = given["largest_force"] / given["test_pressure"] * pressure
        return np.asarray(blocked * shape / bracket(self.braid, 1.0))


class AndrikopoulosThermal(Andrikopoulos):
    """`Andrikopoulos` with the bladder's thermal strain, and Tondu and Lopez's friction.

    The strain ``alpha dT`` adds to that of contraction. (2.32) prints two factors of the strain,
    one in each term; that of (2.14) is taken in both.
    """

    card = Card(
        name="andrikopoulos-thermal",
        title="Scaled to one test, with heat and friction",
        authors="Andrikopoulos, Nikolakopoulos, Manesis",
        reference=_ANDRIKOPOULOS,
        equation="(2.32)",
        status="fitted",
        parameters=(
            *_MEASURED,
            *FRICTION_PARAMETERS,
            Parameter(
                name="temperature_change",
                unit="K",
                what="by how much the bladder is warmer than in the test",
                source="measured",
                default=0.0,
                neutral=0.0,
                bounds=(-300.0, 300.0),
            ),
            Parameter(
                name="expansion",
                unit="1/K",
                what="coefficient of linear thermal expansion of the bladder",
                source="material",
                bounds=(-1e-2, 1e-2),
                only_with="temperature_change",
            ),
        ),
        uses=BRAID_FIELDS,
        errata=("The friction term prints another strain factor than the static one.",),
        latex=r"F = \pi r_0^2 P k_f \left[q_1 x^2 - q_2\right] - \mu_s P \frac{S_1}{S_s} "
        r"\mathrm{sgn}(v), \quad x = 1 - k_\epsilon (\epsilon + \alpha_l \Delta T), \quad "
        r"S_1 = \frac{2 \pi r_0 l_0 \sin\theta_0}{x \sqrt{1 - x^2 \cos^2\theta_0}}",
    )

    def _strain_offset(self) -> float:
        given = self.parameters
        if given["temperature_change"] == 0.0:
            return 0.0
        return given["expansion"] * given["temperature_change"]

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return self._rub(pressure, length)


FAMILY: tuple[type[CatalogueModel], ...] = (Meller, Andrikopoulos, AndrikopoulosThermal)
"""The models of this module, for the registry."""
