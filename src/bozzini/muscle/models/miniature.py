"""Miniature muscles: Gaylord's pull with dead band, threshold and a thin bladder (2.2.8)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .base import ANGLES, CatalogueModel
from .card import WALL_FIELDS, Card, Parameter
from .force_balance import Wall, find_radius, pull_ideal

__all__ = ["FAMILY", "DeVolder", "Sangian"]

Floats = NDArray[np.float64]


class DeVolder(CatalogueModel):
    """Gaylord's pull at a corrected pressure and length, above a threshold, and a spring.

    The spring pulls where the muscle is longer than `slack_length`. The threshold
    `smallest_force` is there so that the muscle does not push, so it is 0 unless given; at or below
    it the muscle rests, at the first length on its way. Below `pressure_offset` no pressure acts;
    as printed a negative one does, which pulls beyond the locking angle.

    Lengths are those that contract, `Muscle.active_length` at rest. Legal are those at which the
    corrected one is a braid's.
    """

    card = Card(
        name="de-volder",
        title="Corrected pressure and length, threshold, spring",
        authors="de Volder et al.",
        reference="de Volder et al., reference [38] of the thesis",
        equation="(2.34)",
        status="fitted",
        parameters=(
            Parameter(
                name="pressure_offset",
                unit="MPa",
                what="pressure of the dead band",
                source="fitted",
                neutral=0.0,
                bounds=(0.0, 1e4),
            ),
            Parameter(
                name="length_offset",
                unit="mm",
                what="by how much the muscle is taken shorter",
                source="fitted",
                neutral=0.0,
                bounds=(-1e4, 1e4),
            ),
            Parameter(
                name="smallest_force",
                unit="N",
                what="threshold of the pull of the braid",
                source="fitted",
                default=0.0,
                neutral=-1e6,
                bounds=(-1e6, 1e6),
            ),
            Parameter(
                name="spring_stiffness",
                unit="N/mm",
                what="stiffness of the bladder",
                source="fitted",
                default=0.0,
                neutral=0.0,
                bounds=(0.0, 1e6),
                linear=True,
            ),
            Parameter(
                name="slack_length",
                unit="mm",
                what="length above which the bladder pulls",
                source="fitted",
                bounds=(0.0, 1e4),
                only_with="spring_stiffness",
            ),
        ),
        errata=(
            "Printed 3 (l - l_corr)**2 / b, a length, less 1: over b**2.",
            "The brackets of the first maximum enclose two factors as if they were arguments; it "
            "is of F_min and their product.",
        ),
        latex=r"F = \max\left[F_{min}, \frac{(P - P_c) b^2}{4 \pi N^2} \left("
        r"\frac{3 (l - l_c)^2}{b^2} - 1\right)\right] + \max\left[0, k_b (l - l_{b0})\right]",
        latex_printed=r"F = \max\left[\left(F_{min}, \frac{(P - P_c) b^2}{4 \pi N^2}\right) \left("
        r"\frac{3 (l - l_c)^2}{b} - 1\right)\right] + \max\left[0, k_b (l - l_{b0})\right]",
    )

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]."""
        return self.parameters["pressure_offset"]

    def _check(self) -> None:
        low, high = self._base_lengths()
        if low >= high:
            raise InputError(
                f"length_offset of the model de-volder is {self.parameters['length_offset']:g} mm: "
                f"it must leave the braid a length, its strands are "
                f"{self.braid.strand_length:g} mm long"
            )

    def _base_lengths(self) -> tuple[float, float]:
        strand, offset = self.braid.strand_length, self.parameters["length_offset"]
        shortest, longest = strand * math.cos(ANGLES[1]), strand * math.cos(ANGLES[0])
        return max(shortest, shortest + offset), min(longest, longest + offset)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asarray(pressure - self.dead_band())

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given, braid = self.parameters, self.braid
        acting, at = pressure - given["pressure_offset"], length - given["length_offset"]
        if self.as_printed:
            scale = acting * braid.strand_length**2 / (4.0 * math.pi * braid.turns**2)
            pull = scale * (3.0 * at**2 / braid.strand_length - 1.0)
        else:
            pull = pull_ideal(braid, np.maximum(acting, 0.0), at)
        pull = np.maximum(pull, given["smallest_force"])
        if given["spring_stiffness"] > 0.0:
            stretch = np.maximum(length - given["slack_length"], 0.0)
            pull = pull + given["spring_stiffness"] * stretch
        return np.asarray(pull)


class Sangian(CatalogueModel):
    """Gaylord's pull of what pressure is left above a threshold and the hoop stress of the bladder.

    A thin elastic bladder that widens from ``r0`` to ``r`` holds ``E t0 (r - r0) / r0**2`` of the
    pressure, which is ``E t0 b (sin(theta) - sin(theta0)) / (2 pi N r0**2)``. Below the threshold
    no pressure acts; as printed a negative one does, so that a muscle at rest pushes.
    """

    card = Card(
        name="sangian",
        title="Threshold pressure, hoop stress of a thin bladder",
        authors="Sangian et al.",
        reference="Sangian et al., reference [124] of the thesis",
        equation="(2.39)",
        status="corrected",
        parameters=(
            Parameter(
                name="threshold_pressure",
                unit="MPa",
                what="pressure at which contraction begins",
                source="measured",
                neutral=0.0,
                bounds=(0.0, 1e4),
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The elastic pressure is printed as + {sin(theta) + sin(theta0)}, which pulls, at rest "
            "too: - {sin(theta) - sin(theta0)}.",
            "Below the threshold the printed pressure is negative: none acts here.",
        ),
        latex=r"F = \pi r_0^2 \left[q_1 (1 - \epsilon)^2 - q_2\right] \left[P - \bar P - "
        r"\frac{E t_0 b}{2 \pi N r_0^2} \left(\sin\theta - \sin\theta_0\right)\right]",
        latex_printed=r"F = \pi r_0^2 \left[q_1 (1 - \epsilon)^2 - q_2\right] \left[P - \bar P + "
        r"\frac{E t_0 b}{2 \pi N r_0^2} \left\{\left(1 - \frac{l^2}{l_0^2} \cos^2\theta_0\right)"
        r"^{1/2} + \sin\theta_0\right\}\right]",
    )

    def dead_band(self) -> float:
        """Return the pressure at which contraction begins [MPa]."""
        return self.parameters["threshold_pressure"]

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        thickness = Wall.of(self.muscle, braid).thickness
        radius = find_radius(braid, length)
        scale = self.muscle.modulus * thickness / braid.radius**2
        acting = pressure - self.dead_band()
        if self.as_printed:
            return np.asarray(acting + scale * (radius + braid.radius))
        return np.asarray(np.maximum(acting, 0.0) - scale * (radius - braid.radius))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_ideal(self.braid, self._contact_pressure(pressure, length), length)


FAMILY: tuple[type[CatalogueModel], ...] = (DeVolder, Sangian)
"""The models of this module, for the registry."""
