"""Empirical models (thesis 2.2.7)."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from ..design import Muscle
from .base import TYPICAL_PRESSURE, CatalogueModel
from .card import SHAPE_FIELDS, WALL_FIELDS, Card, Law, Parameter
from .ideal import Chou

# Gaylord's and Chou's pull with fitted shapes (thesis 2.2.9).


Floats = NDArray[np.float64]


def _fading(name: str, what: str, *, linear: bool = False, neutral: float | None) -> Parameter:
    return Parameter(name, what, (-100.0, 100.0), neutral=neutral, linear=linear)


def _pressure(name: str, what: str, partner: str) -> Parameter:
    return Parameter(f"{name} [MPa]", what, (1e-3, 1e3), only_with=partner)


class Takosoglu(CatalogueModel):
    """Gaylord's pull whose power and first constant fade with pressure.

    ``F = pi r0**2 P [q1 (1 - eps)**n - q2]`` with ``n = kappa1 exp(-P / kappa2) + kappa3`` and
    ``q1 = kappa4 exp(-P / kappa5) + kappa6``; ``q2`` stays ``1 / sin(theta0)**2``. With ``n = 2``
    and ``q1 = 3 / tan(theta0)**2`` it is Gaylord's; as printed it is four times that.
    """

    card = Card(
        name="takosoglu",
        title="Power and constant that fade with pressure",
        authors="Takosoglu et al.",
        reference="Takosoglu et al., reference [24] of the thesis",
        equation="(2.42)",
        status="fitted",
        parameters=(
            _fading("kappa1", "part of the power that fades", neutral=0.0),
            _pressure("kappa2", "pressure over which the power fades", "kappa1"),
            _fading("kappa3", "power at high pressure", neutral=2.0),
            _fading("kappa4", "part of q1 that fades", linear=True, neutral=0.0),
            _pressure("kappa5", "pressure over which q1 fades", "kappa4"),
            Parameter("kappa6", "q1 at high pressure", (-1e4, 1e4), linear=True),
        ),
        errata=(
            "Printed 4 pi r0**2, four times Gaylord's pull with n = 2: pi r0**2.",
            "The text calls it a form of (2.6), which has a factor of the strain and no power.",
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 (1 - \epsilon)^n - q_2\right], \quad "
        r"n = \kappa_1 e^{-P / \kappa_2} + \kappa_3, \quad "
        r"q_1 = \kappa_4 e^{-P / \kappa_5} + \kappa_6",
        latex_printed=r"F = 4 \pi r_0^2 P \left[q_1 (1 - \epsilon)^n - q_2\right]",
    )

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return Gaylord's pull: nothing fades, and would over 0.5 MPa."""
        return {
            **super().guess_parameters(muscle),
            "kappa2": TYPICAL_PRESSURE,
            "kappa5": TYPICAL_PRESSURE,
            "kappa6": 3.0 / math.tan(muscle.braid_angle) ** 2,
        }

    def _fade(self, pressure: Floats, part: str, over: str, rest: str) -> Floats:
        given = self.parameters
        value = np.full(pressure.shape, given[rest])
        if given[part] != 0.0:
            value = value + given[part] * np.exp(-pressure / given[over])
        return np.asarray(value)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        power = self._fade(pressure, "kappa1", "kappa2", "kappa3")
        first = self._fade(pressure, "kappa4", "kappa5", "kappa6")
        area = math.pi * self.braid.radius**2 * (4.0 if self.as_printed else 1.0)
        shape = first * (length / self.braid.length) ** power
        return np.asarray(area * pressure * (shape - 1.0 / math.sin(self.braid.angle) ** 2))


class Doric(Chou):
    """Chou's pull less an elastic force of the braid's width, and one of pressure times strain.

    ``F = F_Chou - (1 - w / w0) kappa1 - kappa2 P eps / l0``. The survey does not define the width
    ``w`` is: the law `relative_width` is ``w / w0`` as a function of the strain of contraction.
    With ``w / w0 = 1 - eps`` the elastic force is a spring that resists contraction; a width that
    grows as the muscle contracts would help it.
    """

    card = Card(
        name="doric",
        title="Chou's pull, fitted forces of elasticity and shape",
        authors="Doric et al.",
        reference="Doric et al., reference [96] of the thesis",
        equation="(2.44)",
        status="partial",
        parameters=(
            Parameter(
                "kappa1 [N]",
                "elastic force per change of width",
                (-1e6, 1e6),
                neutral=0.0,
                linear=True,
            ),
            Parameter(
                "kappa2 [mm^3]",
                "force of shape per pressure and strain per length",
                (-1e9, 1e9),
                neutral=0.0,
                linear=True,
            ),
        ),
        laws=(
            Law(
                "relative_width",
                ("strain of contraction",),
                "the width over that at rest",
                "Doric et al., reference [96] of the thesis",
                only_with="kappa1",
            ),
        ),
        uses=WALL_FIELDS,
        latex=r"F = F_{Chou} - \left(1 - \frac{w}{w_0}\right) \kappa_1 - "
        r"\frac{P \epsilon}{l_0} \kappa_2",
        missing="what the width w is, and how it changes: Doric et al., reference [96] of the "
        "thesis. Only kappa1 needs it.",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given, rest = self.parameters, self.braid.length
        strain = np.asarray((rest - length) / rest)
        pull = super()._pull(pressure, length) - given["kappa2"] * pressure * strain / rest
        if given["kappa1"] != 0.0:
            pull = pull - given["kappa1"] * (1.0 - self._call("relative_width", strain))
        return np.asarray(pull)


# Pulls that are polynomials of strain and pressure, of fitted constants only (thesis 2.2.9).


_PAPERS = "One of the references [92] and [125]-[129] of the thesis, which gives them together"
_WHO = "several, together in the survey"


def _constant(index: int, unit: str, what: str, *, neutral: float | None = 0.0) -> Parameter:
    return Parameter(f"kappa{index} [{unit}]", what, (-1e9, 1e9), neutral=neutral, linear=True)


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
                "kappa6 [N s]",
                "pull per rate of strain, negative",
                (-1e9, 1e9),
                neutral=0.0,
                linear=True,
                only_with="strain_rate",
            ),
            Parameter(
                "strain_rate [1/s]",
                "rate of strain along a branch",
                (0.0, 1e3),
                source="measured",
                default=0.0,
                neutral=0.0,
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
                "kappa1", "factor of the blocked force", (-1e6, 1e6), neutral=1.0, linear=True
            ),
            Parameter(
                "largest_force [N]",
                "blocked force; only kappa1 times it matters",
                (0.0, 1e6),
                source="measured",
            ),
            Parameter(
                "largest_strain",
                "strain of contraction without load",
                (1e-6, 1.0),
                source="measured",
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
