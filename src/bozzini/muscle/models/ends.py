"""Muscles whose ends are no cylinders (thesis 2.2.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...checks import check_range
from ...errors import InputError
from .base import CatalogueModel
from .card import BRAID_FIELDS, WALL_FIELDS, Card, Law, Parameter, make_friction
from .force_balance import Wall, find_radius

__all__ = ["FAMILY", "Doumit", "EllipticEnds"]

Floats = NDArray[np.float64]

_DOUMIT = "Doumit, Fahim and Munro (2009)"
_TOROID = "reference [90] of the thesis"
_SLACK = 1e-9  # of the clamp's radius: a cone of no length may miss so much


@dataclass(frozen=True, kw_only=True)
class _Cone:
    """An end of a muscle: slant length [mm], cosine of its slope, and the braid's angle there."""

    slant: Floats
    cosine: Floats
    angle: Floats


class Doumit(CatalogueModel):
    """The balance of forces with conical ends and the thickness of the strands.

    The tension of the strands holds the pressure on the cylinder and on the two cones; the pull is
    its part along the axis at the clamps, less the thrust of the pressure on the bore, which the
    source scales in the same way. The wall is as thick as at rest and bears a hoop stress, but no
    axial one. `Muscle.braid_radius` is the radius of the middle of the braid here, so that the bore
    is thinner by two radii of a strand than elsewhere.

    The survey has neither the hoop stress nor the shape. What is not given is chosen by us: without
    `cone_length` there are no cones; their slope follows from it and the radii,
    ``sin(beta) = (r - r_c) / l_cone``, and what they leave of the length is the cylinder; without
    `end_angle` the strands do not slip, ``sin(theta_c) = sin(theta) r_c / r``.

    Without cones, wall and thickness of the strands it is Gaylord's pull. Friction takes
    ``mu P S`` from the pull on the way up, and adds it on the way down; ``as_printed=True`` takes
    it off at any direction.
    """

    card = Card(
        name="doumit",
        title="Conical ends, thickness and friction of the strands",
        authors="Doumit, Fahim, Munro",
        reference="M. Doumit, A. Fahim, M. Munro, Analytical modeling and experimental validation "
        "of the braided pneumatic muscle, IEEE Transactions on Robotics, 2009",
        equation="(2.27)",
        status="partial",
        parameters=(
            Parameter(
                name="clamp_ratio",
                unit="",
                what="radius of the braid at the clamps over the braid's radius at rest",
                source="geometry",
                default=1.0,
                neutral=1.0,
                bounds=(0.05, 10.0),
            ),
            make_friction("coefficient of friction between strands"),
        ),
        laws=(
            Law(
                name="hoop_stress",
                arguments=("length [mm]", "pressure [MPa]"),
                unit="MPa",
                what="the hoop stress in the wall, tension positive",
                paper=_DOUMIT,
            ),
            Law(
                name="cone_length",
                arguments=("length [mm]",),
                unit="mm",
                what="the slant length of the cone at each end",
                paper=_DOUMIT,
                required=False,
            ),
            Law(
                name="end_angle",
                arguments=("length [mm]",),
                unit="rad",
                what="the braid angle at the clamps",
                paper=_DOUMIT,
                required=False,
            ),
            Law(
                name="contact_area",
                arguments=("length [mm]", "pressure [MPa]"),
                unit="mm^2",
                what="the area of contact between strands, of Hertz's cylinders",
                paper=_DOUMIT,
                only_with="friction",
            ),
        ),
        uses=(*WALL_FIELDS, "strand_radius"),
        errata=(
            "The cones are printed with 2 r_n where cylinders of twice their length have 4 r_n: a "
            "cone without slope is a cylinder only with the latter.",
            "The end's braid angle is printed t_c once, and the strand's radius r_-.",
            "The thrust on the bore is scaled with cos(beta) cos(theta_c) / cos(theta), as if it "
            "were borne by the strands: kept, it is 1 without cones.",
        ),
        latex=r"F = m \left[\frac{P (r - t_0 - 2 r_n) - \sigma_1 t_0}{m N \sin\theta} l_{cyl} + "
        r"\frac{P (r + r_c - 2 t_0 - 4 r_n) \cos\beta - 2 \sigma_1 t_0}"
        r"{m N \sin((\theta + \theta_c) / 2)} l_{cone} - \frac{P (r - 2 r_n - t_0)^2}"
        r"{2 m r \cos\theta} \frac{l}{N} \tan\theta\right] \cos\beta \cos\theta_c \mp P S \mu_s",
        latex_printed=r"F = m \left[\frac{P (r - t_0 - 2 r_n) - \sigma_1 t_0}{m N \sin\theta} "
        r"l_{cyl} + \frac{P (r + r_c - 2 t_0 - 2 r_n) \cos\beta - 2 \sigma_1 t_0}"
        r"{m N \sin((\theta + t_c) / 2)} l_{cone} - \frac{P (r - 2 r_- - t_0)^2}"
        r"{2 m r \cos\theta} \frac{l}{N} \tan\theta\right] \cos\beta \cos\theta_c - P S \mu_s",
        missing="the hoop stress, the shape of the cones, and the area of contact that friction "
        f"needs: {_DOUMIT}",
    )

    def _check(self) -> None:
        room = self.muscle.braid_radius - self.muscle.outer_radius + self.muscle.inner_radius
        if 2.0 * self.muscle.strand_radius >= room:
            raise InputError(
                f"muscle strand radius is {self.muscle.strand_radius:g} mm: for a bore in the "
                f"model doumit it must be below {0.5 * room:g} mm"
            )

    @property
    def _thickness(self) -> float:
        """Thickness of the wall [mm]."""
        return self.muscle.outer_radius - self.muscle.inner_radius

    def _find_cone(self, length: Floats, angle: Floats, radius: Floats) -> _Cone:
        if "cone_length" not in self.keywords:
            return _Cone(slant=np.zeros(length.shape), cosine=np.ones(length.shape), angle=angle)
        slant = self._call("cone_length", length)
        check_range("answer of cone_length", slant, 0.0, 1e6, "mm")
        clamp = self.parameters["clamp_ratio"] * self.braid.radius
        narrower = radius - clamp
        none = (slant == 0.0) & (np.abs(narrower) <= _SLACK * clamp)
        sine = np.where(none, 0.0, narrower / np.where(none, 1.0, slant))
        # A cone that is shorter than it has to narrow makes NaN, and the pull is refused.
        cosine = np.sqrt((1.0 - sine) * (1.0 + sine))
        if "end_angle" in self.keywords:
            there = self._call("end_angle", length)
            check_range("answer of end_angle", there, 0.0, 0.5 * math.pi, "rad")
        else:
            there = np.arcsin(np.sin(angle) * clamp / radius)
        return _Cone(slant=slant, cosine=cosine, angle=there)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid, thickness = self.braid, self._thickness
        angle = np.arccos(length / braid.strand_length)
        radius = find_radius(braid, length)
        cone = self._find_cone(length, angle, radius)
        cylinder = length - 2.0 * cone.slant * cone.cosine
        cylinder = np.where(cylinder >= 0.0, cylinder, np.nan)
        clamp = self.parameters["clamp_ratio"] * braid.radius
        strand = self.muscle.strand_radius
        bore = radius - thickness - 2.0 * strand
        wall = self._call("hoop_stress", length, pressure) * thickness
        both = radius + clamp - 2.0 * thickness - (2.0 if self.as_printed else 4.0) * strand
        on_cylinder = (pressure * bore - wall) / np.sin(angle) * cylinder
        middle = np.sin(0.5 * (angle + cone.angle))
        on_cones = (pressure * both * cone.cosine - 2.0 * wall) / middle * cone.slant
        # m times (l / N) tan(angle) / (2 m r cos(angle)) is pi / cos(angle).
        thrust = math.pi * pressure * bore**2 * braid.strand_length / length
        tension = (on_cylinder + on_cones) / braid.turns - thrust
        pull = tension * cone.cosine * np.cos(cone.angle)
        if self.as_printed:
            pull = pull - self._rub(pressure, length)
        return np.asarray(pull)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return np.zeros(pressure.shape) if self.as_printed else self._rub(pressure, length)

    def _rub(self, pressure: Floats, length: Floats) -> Floats:
        friction = self.parameters["friction"]
        if friction == 0.0:
            return np.zeros(pressure.shape)
        return np.asarray(friction * pressure * self._call("contact_area", length, pressure))

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        outside = find_radius(self.braid, length) - 2.0 * self.muscle.strand_radius
        wall = self._call("hoop_stress", length, pressure) * self._thickness
        return np.asarray((pressure * (outside - self._thickness) - wall) / outside)

    def _base_lengths(self) -> tuple[float, float]:
        lost = self._thickness + 2.0 * self.muscle.strand_radius
        wall = Wall(braid=self.braid, thickness=lost)
        return wall.find_lengths(*super()._base_lengths(), keeps_thickness=True)


class EllipticEnds(CatalogueModel):
    """The balance of forces across the middle of a muscle with ends of any shape.

    The survey tells how the ends are found, as sections of an elliptic toroid, but has no equation.
    The shape makes a difference to the pull only by the radius and the thickness that it leaves the
    middle at a length: these are the laws. The rest is the balance of forces of a linear elastic
    bladder, on a braid whose crossings do not slip, ``sin(theta) = sin(theta0) r / r0``::

        F = 2 pi r**2 P_o / tan(theta)**2 + s_z pi t (2 r - t) - P pi (r - t)**2
        P_o = (P (r - t) - s_h t) / r,  s_z = E (l / l0 - 1),  s_h = E (r / r0 - 1)

    With the radius of a braid that is a cylinder all along it is the balance of forces as it is in
    `force_balance`. `MuscleState.braid_angle` is that of a cylinder of the same length.
    """

    card = Card(
        name="elliptic-ends",
        title="Ends that are elliptic toroids, linear elastic bladder",
        authors="unnamed in the survey",
        reference="Reference [90] of the thesis",
        equation="prose of 2.2.5",
        status="partial",
        laws=(
            Law(
                name="middle_radius",
                arguments=("length [mm]",),
                unit="mm",
                what="the outer radius of the middle",
                paper=_TOROID,
            ),
            Law(
                name="middle_thickness",
                arguments=("length [mm]",),
                unit="mm",
                what="the thickness of the wall in the middle",
                paper=_TOROID,
            ),
        ),
        uses=(*BRAID_FIELDS, "modulus"),
        latex=r"F = \frac{2 \pi r^2 P_o}{\tan^2\theta} + \sigma_z \pi t (2 r - t) - "
        r"P \pi (r - t)^2, \quad P_o = \frac{P (r - t) - \sigma_\theta t}{r}, \quad "
        r"\sin\theta = \frac{r}{r_0} \sin\theta_0",
        missing="how eccentricity and radius of the toroid, and from them the length of a strand, "
        f"follow from the muscle's length: {_TOROID}",
    )

    def _find_section(self, length: Floats) -> tuple[Floats, Floats]:
        """Radius and thickness in the middle [mm]; NaN where they make no tube."""
        radius, thickness = (self._call(law.name, length) for law in self.card.laws)
        tube = (thickness > 0.0) & (thickness < radius)
        return np.where(tube, radius, np.nan), np.where(tube, thickness, np.nan)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        radius, thickness = self._find_section(length)
        sine = radius / braid.radius * math.sin(braid.angle)
        on_braid = self._contact_pressure(pressure, length)
        # Beyond a sine of 1 the strands are no hoops but broken: NaN, and the pull is refused.
        strands = np.where(sine <= 1.0, (1.0 - sine) * (1.0 + sine) / sine**2, np.nan)
        along = self.muscle.modulus * (length / braid.length - 1.0)
        pull = 2.0 * strands * radius**2 * on_braid + along * thickness * (2.0 * radius - thickness)
        return np.asarray(math.pi * (pull - pressure * (radius - thickness) ** 2))

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        radius, thickness = self._find_section(length)
        hoop = self.muscle.modulus * (radius / self.braid.radius - 1.0)
        return np.asarray((pressure * (radius - thickness) - hoop * thickness) / radius)


FAMILY: tuple[type[CatalogueModel], ...] = (Doumit, EllipticEnds)
"""The models of this module, for the registry."""
