"""Gaylord's and Chou's pull with fitted shapes (thesis 2.2.9)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..design import Muscle
from .base import TYPICAL_PRESSURE, CatalogueModel
from .card import WALL_FIELDS, Card, Law, Parameter
from .ideal import Chou

__all__ = ["FAMILY", "Doric", "Takosoglu"]

Floats = NDArray[np.float64]


def _fading(name: str, what: str, *, linear: bool = False, neutral: float | None) -> Parameter:
    return Parameter(
        name=name,
        unit="",
        what=what,
        source="fitted",
        neutral=neutral,
        bounds=(-100.0, 100.0),
        linear=linear,
    )


def _pressure(name: str, what: str, partner: str) -> Parameter:
    return Parameter(
        name=name,
        unit="MPa",
        what=what,
        source="fitted",
        bounds=(1e-3, 1e3),
        only_with=partner,
    )


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
            Parameter(
                name="kappa6",
                unit="",
                what="q1 at high pressure",
                source="fitted",
                bounds=(-1e4, 1e4),
                linear=True,
            ),
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

    ``F = F_Chou - (1 - w / w0) kappa1 - kappa2 P eps / l0``. The survey does not say what the width
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
                name="kappa1",
                unit="N",
                what="elastic force per change of width",
                source="fitted",
                neutral=0.0,
                bounds=(-1e6, 1e6),
                linear=True,
            ),
            Parameter(
                name="kappa2",
                unit="mm^3",
                what="force of shape per pressure and strain per length",
                source="fitted",
                neutral=0.0,
                bounds=(-1e9, 1e9),
                linear=True,
            ),
        ),
        laws=(
            Law(
                name="relative_width",
                arguments=("strain of contraction",),
                unit="",
                what="the width over that at rest",
                paper="Doric et al., reference [96] of the thesis",
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


FAMILY: tuple[type[CatalogueModel], ...] = (Takosoglu, Doric)
"""The models of this module, for the registry."""
