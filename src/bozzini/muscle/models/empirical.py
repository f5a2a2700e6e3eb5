"""Empirical models: pulls with fitted constants (thesis 2.2.9)."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np

from ...numeric.arrays import Floats
from ..design import Muscle
from .base import TYPICAL_PRESSURE, CatalogueModel
from .card import SHAPE_FIELDS, WALL_FIELDS, Card, Law, Parameter
from .ideal import Chou, measure_ideal

_PAPERS = "One of the references [92] and [125]-[129] of the thesis, which gives them together"
_WHO = "several, together in the survey"
_HUGE = (-1e9, 1e9)


def _pressure(name: str, what: str, partner: str) -> Parameter:
    return Parameter(f"{name} [MPa]", what, (1e-3, 1e3), only_with=partner)


def _constant(index: int, unit: str, what: str, *, only_with: str = "") -> Parameter:
    name = f"kappa{index} [{unit}]"
    return Parameter(name, what, _HUGE, neutral=0.0, linear=True, only_with=only_with)


class Takosoglu(CatalogueModel):
    """Gaylord's pull whose power and first constant fade with pressure.

    With ``n = 2`` and ``q1 = 3 / tan(theta0)**2`` it is Gaylord's; as printed it is four times
    that. ``q2`` stays ``1 / sin(theta0)**2``.
    """

    card = Card(
        name="takosoglu",
        title="Power and constant that fade with pressure",
        authors="Takosoglu et al.",
        reference="Takosoglu et al., reference [24] of the thesis",
        equation="(2.42)",
        status="fitted",
        parameters=(
            Parameter("kappa1", "part of the power that fades", (-100.0, 100.0), neutral=0.0),
            _pressure("kappa2", "pressure over which the power fades", "kappa1"),
            Parameter("kappa3", "power at high pressure", (-100.0, 100.0), neutral=2.0),
            Parameter("kappa4", "part of q1 that fades", (-100.0, 100.0), linear=True, neutral=0.0),
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
    guesses = {
        "kappa2": TYPICAL_PRESSURE,
        "kappa5": TYPICAL_PRESSURE,
        "kappa6": lambda muscle: 3.0 / math.tan(muscle.braid_angle) ** 2,
    }

    def _fade(self, pressure: Floats, part: str, over: str, rest: str) -> Floats:
        given = self.parameters
        fading = np.exp(-pressure / given[over]) if given[part] != 0.0 else np.zeros(pressure.shape)
        return np.asanyarray(given[part] * fading + given[rest])

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        power = self._fade(pressure, "kappa1", "kappa2", "kappa3")
        first = self._fade(pressure, "kappa4", "kappa5", "kappa6")
        area = math.pi * self.braid.radius**2 * (4.0 if self.as_printed else 1.0)
        shape = first * (length / self.braid.length) ** power
        return np.asanyarray(area * pressure * (shape - 1.0 / math.sin(self.braid.angle) ** 2))


class Doric(Chou):
    """Chou's pull less an elastic force of the braid's width, and one of pressure times strain.

    The survey does not define the width ``w``: the law `relative_width` is ``w / w0`` as a function
    of the strain of contraction. With ``w / w0 = 1 - eps`` the elastic force is a spring that
    resists contraction; a width that grows as the muscle contracts would help it.
    """

    extensile = False
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
                _HUGE,
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
        strain = np.asanyarray((rest - length) / rest)
        pull = super()._pull(pressure, length) - given["kappa2"] * pressure * strain / rest
        if given["kappa1"] != 0.0:
            pull = pull - given["kappa1"] * (1.0 - self._call("relative_width", strain))
        return np.asanyarray(pull)


class StrainPolynomial(CatalogueModel):
    """A pull that is a sum of constants ``kappa`` times terms of pressure and strain."""

    @abstractmethod
    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        """What ``kappa1``, ``kappa2`` and so on are multiplied by."""

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        strain = np.asanyarray((self.braid.length - length) / self.braid.length)
        pull = np.zeros(pressure.shape)
        for i, term in enumerate(self._find_terms(pressure, strain), start=1):
            pull = pull + self.parameters[f"kappa{i}"] * term
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
    guesses = {
        "kappa1": lambda muscle: measure_ideal(muscle)[0],
        "kappa2": lambda muscle: -2.0 * measure_ideal(muscle)[1],
        "kappa3": lambda muscle: measure_ideal(muscle)[1],
    }

    def _find_terms(self, pressure: Floats, strain: Floats) -> tuple[Floats | float, ...]:
        return (*(pressure * strain**k for k in range(3)), *(strain**k for k in range(5)))


def _fall(muscle: Muscle) -> float:
    """Fall of Gaylord's pull per pressure and strain, along a line to the free strain."""
    blocked, _, locking = measure_ideal(muscle)
    return -blocked / locking


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
    guesses = {"kappa4": lambda muscle: measure_ideal(muscle)[0], "kappa5": _fall}

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
            _constant(6, "N s", "pull per rate of strain, negative", only_with="strain_rate"),
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
    guesses = {"kappa2": _fall, "kappa4": lambda muscle: measure_ideal(muscle)[0]}

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
    guesses = {
        "largest_force": lambda muscle: TYPICAL_PRESSURE * measure_ideal(muscle)[0],
        "largest_strain": lambda muscle: measure_ideal(muscle)[2],
    }

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given, rest = self.parameters, self.braid.length
        share = 1.0 - (rest - length) / rest / given["largest_strain"]
        return np.asanyarray(given["kappa1"] * given["largest_force"] * share)
