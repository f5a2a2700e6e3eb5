"""Muscles whose bladder is a membrane, or many (thesis 2.2.6)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...errors import MissingLawError
from .base import CatalogueModel
from .card import BRAID_FIELDS, WALL_FIELDS, Card, Law, Parameter, make_friction
from .force_balance import WalledModel, find_radius, pull_ideal

__all__ = ["FAMILY", "Ball", "Liu"]

Floats = NDArray[np.float64]

_LIU = "Liu and Rahn (2003)"
_BALL = "Ball and Garcia (2016)"
_BLOCK = 2**18  # lengths times layers at once: a limit of memory


class Liu(CatalogueModel):
    """A membrane with strands embedded in it: balance of forces across the middle.

    Membrane and strands together pull with ``4 pi E r0 s_2 / lambda_2`` there, with a modulus ``E``
    per length and a stress ``s_2`` that has no unit: the printed term, whose argument 0 we read as
    the middle. The printed term of the pressure is impossible; what stands here is the thrust on
    the cross-section, ``P pi (r0 lambda_2)**2``. `MuscleState.contact_pressure` is the pressure.
    Radial stretch and axial stress in the middle are laws of length and pressure. In the paper they
    come from the shape of the whole membrane, by trial: its length at rest, the integral of (2.28)
    over the meridian, has to be the muscle's. Meridian and stresses are not in the survey.

    Strands that do not stretch, on a cylinder, make ``P lambda_2 r**2 / (2 E r0 tan(theta)**2)`` of
    ``s_2``, and with that alone it is Gaylord's pull.
    """

    card = Card(
        name="liu",
        title="Membrane with embedded strands",
        authors="Liu, Rahn",
        reference="W. Liu, C. R. Rahn, Fiber-reinforced membrane models of McKibben actuators, "
        "Journal of Applied Mechanics, 2003",
        equation="(2.28)",
        status="partial",
        parameters=(
            Parameter(
                name="membrane_modulus",
                unit="N/mm",
                what="modulus of the membrane, a force per length",
                source="material",
                bounds=(1e-9, 1e6),
                linear=True,
            ),
        ),
        laws=(
            Law(
                name="radial_stretch",
                arguments=("length [mm]", "pressure [MPa]"),
                unit="",
                what="the radius in the middle over the radius at rest",
                paper=_LIU,
            ),
            Law(
                name="axial_stress",
                arguments=("length [mm]", "pressure [MPa]"),
                unit="",
                what="the stress along the muscle in the middle, of membrane and strands, over the "
                "modulus",
                paper=_LIU,
            ),
        ),
        uses=BRAID_FIELDS,
        errata=(
            "The term of the pressure is printed P E / r0 in a bracket of numbers: the balance of "
            "forces across the middle has P r0 lambda_2**2 / (2 E).",
            "The length is printed without r0, and from the middle to one end is half a muscle's.",
        ),
        latex=r"F = 2 \pi E r_0 \left(\frac{2 \sigma_2(0)}{\lambda_2(0)} - "
        r"\frac{P r_0 \lambda_2(0)^2}{2 E}\right)",
        latex_printed=r"F = 2 \pi E r_0 \left(\frac{2 \sigma_2(0)}{\lambda_2(0)} - "
        r"\frac{P E}{r_0}\right), \quad l_0 = -\int_{\lambda_2(0)}^1 "
        r"\frac{d\lambda_2}{\lambda_1 \sin\gamma(\lambda_2)}",
        unprintable="its P E / r0 is subtracted from a number",
        missing="the stresses of membrane and embedded strands and the slope of the meridian, from "
        f"which the radial stretch follows: {_LIU}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        radius, modulus = self.braid.radius, self.parameters["membrane_modulus"]
        stretch = self._call("radial_stretch", length, pressure)
        stretch = np.where(stretch > 0.0, stretch, np.nan)
        stress = self._call("axial_stress", length, pressure)
        thrust = pressure * (radius * stretch) ** 2
        return np.asarray(math.pi * (4.0 * modulus * radius * stress / stretch - thrust))


class Ball(WalledModel):
    """Thin layers, one in the other, from the bore outwards.

    The wall keeps its volume and fills the braid; it is cut into `n_layers`, equally thick at rest.
    A layer whose stretches are ``l / l0`` and that of its middle radius has stresses ``s_1`` along
    and ``s_2`` round it, relative to the radial stress. It leaves to the next one the pressure
    ``P - s_2 t / r`` with its thickness and middle radius. Radial stress is minus the mean of the
    pressures on its faces, and ``s_1`` counts from there too::

        F = P_o l**2 / (2 pi N**2) - P pi r_i**2 + sum (s_1 - P_k) A_k

    As many layers as you like make the thick wall, with an error that falls with the square of
    their number; a wall that resists nothing makes Gaylord's pull with any. The stresses are
    neo-Hookean, ``E / 3 (lambda**2 - lambda_3**2)``, unless given, both together.

    ``as_printed=True`` takes half the loss of pressure, at the inner radius, and the stresses as
    absolute: with a wall that resists nothing the pull is larger than Gaylord's by ``P V_b / l``.
    """

    card = Card(
        name="ball",
        title="Nested thin layers",
        authors="Ball, Garcia",
        reference="E. Ball, E. Garcia, Effects of bladder geometry in pneumatic artificial "
        "muscles, Journal of Medical Devices 10(4), 2016",
        equation="(2.29)",
        status="partial",
        parameters=(
            Parameter(
                name="n_layers",
                unit="",
                what="number of layers, whole",
                source="geometry",
                default=10.0,
                bounds=(1.0, 1000.0),
                whole=True,
            ),
            make_friction("friction per effective pressure", unit="mm^2", largest=1e6),
        ),
        laws=(
            Law(
                name="axial_stress",
                arguments=("axial stretch", "hoop stretch"),
                unit="MPa",
                what="the stress along a layer less the radial stress; neo-Hookean without it",
                paper=_BALL,
                required=False,
            ),
            Law(
                name="hoop_stress",
                arguments=("axial stretch", "hoop stretch"),
                unit="MPa",
                what="the stress round a layer less the radial stress; neo-Hookean without it",
                paper=_BALL,
                required=False,
            ),
            Law(
                name="effective_pressure",
                arguments=("length [mm]", "pressure [MPa]"),
                unit="MPa",
                what="the pressure that friction is in proportion to",
                paper=_BALL,
                only_with="friction",
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The root in P_o is the diameter of the bore: the loss of pressure is printed half of "
            "what it is. With the middle radius in its place it is right to second order.",
            "The stresses are printed as if absolute; with those of a thin tube, relative to the "
            "radial stress, the pressure on the wall is missing along the muscle.",
            "N is printed n in the root.",
        ),
        latex=r"F = \frac{P_o l^2}{2 \pi N^2} - P_i \left(\frac{b^2 - l^2}{4 \pi N^2} - "
        r"\frac{V_b}{l}\right) + \sum_k \left(\sigma_{1,k} - \bar P_k\right) A_k "
        r"\mp \mu_f P_{eff}, \quad P_{k+1} = P_k - \frac{\sigma_{2,k} t_k}{r_k}, \quad "
        r"\bar P_k = \frac{P_k + P_{k+1}}{2}",
        latex_printed=r"F = \frac{P_o l^2}{2 \pi N^2} - P_i \left(\frac{b^2 - l^2}{4 \pi N^2} - "
        r"\frac{V_b}{l}\right) + \frac{\sigma_1 V_b}{l} \pm \mu_f P_{eff}, \quad P_o = P_i - "
        r"\frac{\sigma_2 (r_0 - r_i)}{\lambda_1 \lambda_2 \sqrt{\frac{b^2 - l^2}{n^2 \pi^2} - "
        r"\frac{4}{\pi} \frac{V_b}{l}}}",
        missing=f"the stresses of the rubber, and the pressure that friction needs: {_BALL}",
    )

    def _check(self) -> None:
        given = [law for law in self.card.laws[:2] if law.name in self.keywords]
        if len(given) == 1:
            other = next(law for law in self.card.laws[:2] if law not in given)
            raise MissingLawError(
                f"the model ball is given the law {given[0].name} alone: it must be given "
                f"{other.name}({', '.join(other.arguments)}) too, {other.what}"
            )

    def _find_stresses(self, axial: Floats, hoop: Floats) -> tuple[Floats, Floats]:
        """Stresses along and round a layer less the radial stress [MPa]."""
        if "axial_stress" in self.keywords:
            return self._call("axial_stress", axial, hoop), self._call("hoop_stress", axial, hoop)
        shear, radial = self.muscle.modulus / 3.0, 1.0 / (axial * hoop) ** 2
        return np.asarray(shear * (axial**2 - radial)), np.asarray(shear * (hoop**2 - radial))

    def _go_outwards(self, length: Floats) -> tuple[Floats, Floats]:
        """Pressure that the wall bears [MPa], and what it pulls along the muscle [N].

        The latter is relative to a stress of minus the pressure in the bore, or as printed to none.
        """
        flat = length.ravel()
        step = max(1, _BLOCK // int(self.parameters["n_layers"]))
        blocks = [
            self._cross_layers(flat[start : start + step])
            for start in range(0, max(flat.size, 1), step)
        ]
        borne, along = np.concatenate(blocks, axis=-1)
        return borne.reshape(length.shape), along.reshape(length.shape)

    def _cross_layers(self, length: Floats) -> Floats:
        """The same (2, n) of lengths (n,), with layers along the first axis of all arrays."""
        braid, wall = self.braid, self.wall
        layers = int(self.parameters["n_layers"])
        rest = np.linspace(wall.bore_at_rest, braid.radius, layers + 1)[:, None]
        stretch = length / braid.length
        inside = (
            find_radius(braid, length) ** 2
            - (braid.radius - rest) * (braid.radius + rest) / stretch
        )
        radius = np.sqrt(inside)
        axial = np.broadcast_to(stretch, (layers, length.size))
        hoop = (radius[1:] + radius[:-1]) / (rest[1:] + rest[:-1])
        first, second = self._find_stresses(axial, hoop)
        thickness = (rest[1:] - rest[:-1]) / (axial * hoop)
        area = math.pi * (rest[1:] - rest[:-1]) * (rest[1:] + rest[:-1]) / axial
        if self.as_printed:
            lost = 0.5 * second * thickness / radius[:-1]
            return np.stack([lost.sum(axis=0), (first * area).sum(axis=0)])
        lost = 2.0 * second * thickness / (radius[1:] + radius[:-1])
        borne = np.cumsum(lost, axis=0)
        return np.stack([borne[-1], ((first + borne - 0.5 * lost) * area).sum(axis=0)])

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        borne, along = self._go_outwards(length)
        strands = borne * length**2 / (2.0 * math.pi * self.braid.turns**2)
        pull = pull_ideal(self.braid, pressure, length) - strands + along
        if self.as_printed:
            pull = pull + pressure * self.wall.area_at(length)
        return np.asarray(pull)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        friction = self.parameters["friction"]
        if friction == 0.0:
            return np.zeros(pressure.shape)
        return np.asarray(friction * self._call("effective_pressure", length, pressure))

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asarray(pressure - self._go_outwards(length)[0])


FAMILY: tuple[type[CatalogueModel], ...] = (Liu, Ball)
"""The models of this module, for the registry."""
