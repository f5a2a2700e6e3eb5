"""Muscles with ends, layers and strands of their own (thesis 2.2.5, 2.2.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...checks import check_range, show_apart
from ...errors import InputError, MissingLawError
from ...numeric.arrays import Floats
from .base import CatalogueModel
from .card import BRAID_FIELDS, WALL_FIELDS, Card, Law, Parameter, make_friction
from .ideal import BladderWall, WalledModel, find_radius, pull_ideal

_LENGTH = ("length [mm]",)
_STATE = ("length [mm]", "pressure [MPa]")
_STRETCHES = ("axial stretch", "hoop stretch")
_DOUMIT = "Doumit, Fahim and Munro (2009)"
_TOROID = "reference [90] of the thesis"
_CONE_TOLERANCE = 1e-9  # of the clamp's radius: a cone of no length may miss so much


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
                "clamp_ratio",
                "radius of the braid at the clamps over the braid's radius at rest",
                (0.05, 10.0),
                source="geometry",
                default=1.0,
                neutral=1.0,
            ),
            make_friction("coefficient of friction between strands"),
        ),
        laws=(
            Law(
                "hoop_stress [MPa]",
                _STATE,
                "the hoop stress in the wall, tension positive",
                _DOUMIT,
            ),
            Law(
                "cone_length [mm]",
                _LENGTH,
                "the slant length of the cone at each end",
                _DOUMIT,
                required=False,
            ),
            Law(
                "end_angle [rad]", _LENGTH, "the braid angle at the clamps", _DOUMIT, required=False
            ),
            Law(
                "contact_area [mm^2]",
                _STATE,
                "the area of contact between strands, of Hertz's cylinders",
                _DOUMIT,
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

    prints_one_way = True

    def _check(self) -> None:
        space = self.muscle.braid_radius - self.muscle.outer_radius + self.muscle.inner_radius
        if 2.0 * self.muscle.strand_radius >= space:
            shown = show_apart(self.muscle.strand_radius, 0.5 * space)
            raise InputError(
                f"muscle strand radius is {shown[0]} mm: for a bore in the "
                f"model doumit it must be below {shown[1]} mm"
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
        none = (slant == 0.0) & (np.abs(narrower) <= _CONE_TOLERANCE * clamp)
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
        return np.asanyarray(tension * cone.cosine * np.cos(cone.angle))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        area = self._call("contact_area", length, pressure)
        return np.asanyarray(self.parameters["friction"] * pressure * area)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        outside = find_radius(self.braid, length) - 2.0 * self.muscle.strand_radius
        wall = self._call("hoop_stress", length, pressure) * self._thickness
        return np.asanyarray((pressure * (outside - self._thickness) - wall) / outside)

    def _base_lengths(self) -> tuple[float, float]:
        lost = self._thickness + 2.0 * self.muscle.strand_radius
        wall = BladderWall(braid=self.braid, thickness=lost)
        return wall.find_lengths(*super()._base_lengths(), keeps_thickness=True)


class EllipticEnds(CatalogueModel):
    """The balance of forces across the middle of a muscle with ends of any shape.

    The survey describes how the ends are found, as sections of an elliptic toroid, but has no
    equation. The shape makes a difference to the pull only by the radius and the thickness that it
    leaves the middle at a length: these are the laws. The rest is the balance of forces of a linear
    elastic bladder, on a braid whose crossings do not slip,
    ``sin(theta) = sin(theta0) r / r0``::

        F = 2 pi r**2 P_o / tan(theta)**2 + s_z pi t (2 r - t) - P pi (r - t)**2
        P_o = (P (r - t) - s_h t) / r,  s_z = E (l / l0 - 1),  s_h = E (r / r0 - 1)

    With the radius of a braid that is a cylinder all along it is the balance of forces as it is in
    `balance_forces`. `MuscleState.braid_angle` is that of a cylinder of the same length.
    """

    card = Card(
        name="elliptic-ends",
        title="Ends that are elliptic toroids, linear elastic bladder",
        authors="unnamed in the survey",
        reference="Reference [90] of the thesis",
        equation="prose of 2.2.5",
        status="partial",
        laws=(
            Law("middle_radius [mm]", _LENGTH, "the outer radius of the middle", _TOROID),
            Law(
                "middle_thickness [mm]", _LENGTH, "the thickness of the wall in the middle", _TOROID
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
        return np.asanyarray(math.pi * (pull - pressure * (radius - thickness) ** 2))

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        radius, thickness = self._find_section(length)
        hoop = self.muscle.modulus * (radius / self.braid.radius - 1.0)
        return np.asanyarray((pressure * (radius - thickness) - hoop * thickness) / radius)


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
                "membrane_modulus [N/mm]",
                "modulus of the membrane, a force per length",
                (1e-9, 1e6),
                source="material",
                linear=True,
            ),
        ),
        laws=(
            Law("radial_stretch", _STATE, "the radius in the middle over the radius at rest", _LIU),
            Law(
                "axial_stress",
                _STATE,
                "the stress along the muscle in the middle, of membrane and strands, over the "
                "modulus",
                _LIU,
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
        return np.asanyarray(math.pi * (4.0 * modulus * radius * stress / stretch - thrust))


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
                "n_layers",
                "number of layers, whole",
                (1.0, 1000.0),
                source="geometry",
                default=10.0,
                whole=True,
            ),
            make_friction("friction per effective pressure", unit="mm^2", largest=1e6),
        ),
        laws=(
            Law(
                "axial_stress [MPa]",
                _STRETCHES,
                "the stress along a layer less the radial stress; neo-Hookean without it",
                _BALL,
                required=False,
            ),
            Law(
                "hoop_stress [MPa]",
                _STRETCHES,
                "the stress round a layer less the radial stress; neo-Hookean without it",
                _BALL,
                required=False,
            ),
            Law(
                "effective_pressure [MPa]",
                _STATE,
                "the pressure that friction is in proportion to",
                _BALL,
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
        return np.asanyarray(shear * (axial**2 - radial)), np.asanyarray(shear * (hoop**2 - radial))

    def _go_outwards(self, length: Floats) -> tuple[Floats, Floats]:
        """Pressure that the wall bears [MPa], and what it pulls along the muscle [N].

        The latter is relative to a stress of minus the pressure in the bore, or as printed to none.
        """
        step = max(1, _BLOCK // int(self.parameters["n_layers"]))
        parts = np.array_split(length.ravel(), range(step, length.size, step))
        borne, along = np.concatenate([self._cross_layers(part) for part in parts], axis=-1)
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
        return np.asanyarray(pull)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        acting = self._call("effective_pressure", length, pressure)
        return np.asanyarray(self.parameters["friction"] * acting)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(pressure - self._go_outwards(length)[0])


_CHEN = "Chen et al., reference [121] of the thesis"


def _moment(name: str, what: str) -> Law:
    return Law(
        f"{name} [N mm]", ("pressure [MPa]", "braid angle [rad]"), what, _CHEN, required=False
    )


_FRICTION = ("strand_friction_moment", "bladder_friction_moment")
_ELASTIC = ("bending_moment", "bulging_moment")


class Chen(CatalogueModel):
    """Gaylord's pull less what moments at the crossings of the strands take.

    A moment acts on the angle ``2 theta`` between two strands that cross, and there are
    ``m**2 N / 2`` crossings, with half of the ``m`` strands each way: the work is
    ``m**2 N M d(theta)``, and since ``dl = -b sin(theta) d(theta)`` the force is
    ``m**2 N M / (b sin(theta))``. The print has four times as much, the crossings of ``m`` strands
    each way; ``as_printed=True`` has it too. How the paper defines and counts its moments is not in
    the survey: those given here are of one crossing.

    The moments of friction, of strand on strand and of strand on bladder, change their sign with
    the direction; those of bending the strands and of the bladder that bulges between them do not,
    and resist contraction. All four are laws of pressure and braid angle that only the paper has:
    those not given are left out, and one must be given.
    """

    card = Card(
        name="chen",
        title="Moments at the crossings of the strands",
        authors="Chen et al.",
        reference=_CHEN,
        equation="(2.30)-(2.31)",
        status="partial",
        laws=(
            _moment("strand_friction_moment", "moment of friction at one crossing of strands"),
            _moment("bending_moment", "moment that bends the strands, at one crossing"),
            _moment("bulging_moment", "moment of the bladder that bulges, at one crossing"),
            _moment(
                "bladder_friction_moment", "moment of friction on the bladder, at one crossing"
            ),
        ),
        uses=(*BRAID_FIELDS, "strands"),
        errata=(
            "The factor 4 m**2 N is of m strands each way; with m strands both ways together, as "
            "the survey has it in (2.10), the work at the crossings gives m**2 N.",
        ),
        latex=r"F = \frac{P b^2}{4 \pi N^2} \left(3 \cos^2\theta - 1\right) "
        r"- \frac{m^2 N}{b \sin\theta} \left[M_d + M_r \pm (M_f + M_{tr})\right]",
        latex_printed=r"F = \frac{\pi P}{4} \left(\frac{b}{N \pi}\right)^2 "
        r"\left(3 \cos^2\theta - 1\right) \mp \frac{4 m^2 N}{b \sin\theta} "
        r"\left(M_f \pm M_d \pm M_r + M_{tr}\right)",
        missing=f"the moments of friction, bending and bulging: {_CHEN}",
    )

    def _check(self) -> None:
        given = self.keywords
        if not any(law.name in given for law in self.card.laws):
            names = ", ".join(law.name for law in self.card.laws)
            raise MissingLawError(
                f"the model chen must be given one at least of the laws {names} (pressure [MPa], "
                f"braid angle [rad]), in N mm at one crossing: they are in {_CHEN}"
            )

    def _sum_moments(self, names: tuple[str, str], pressure: Floats, length: Floats) -> Floats:
        """Force that the given ones of some moments take [N]."""
        angle = np.arccos(length / self.braid.strand_length)
        moments = [self._call(name, pressure, angle) for name in names if name in self.keywords]
        scale = self.muscle.strands**2 * self.braid.turns / self.braid.strand_length
        total = np.sum(moments, axis=0) if moments else np.zeros(pressure.shape)
        return np.asanyarray((4.0 if self.as_printed else 1.0) * scale * total / np.sin(angle))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        ideal = pull_ideal(self.braid, pressure, length)
        return np.asanyarray(ideal - self._sum_moments(_ELASTIC, pressure, length))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        return self._sum_moments(_FRICTION, pressure, length)


class BraidTension(CatalogueModel):
    """The pull of the strands alone, which forgets the pressure on the ends of the muscle.

    ``F = P l**2 / (2 pi N**2)`` is the axial part of the strands' tension at whatever radius the
    braid has; Gaylord's pull is that less ``P pi r**2``. So it never ends: without load there is no
    equilibrium above zero length, and no locking. It is the estimate from which the cited work set
    its finite-element analysis, and is kept for that.
    """

    card = Card(
        name="braid-tension",
        title="Tension of the strands alone, a first estimate",
        authors="unnamed in the survey",
        reference="Reference [122] of the thesis, on muscles for parachutes",
        equation="(2.33)",
        status="self-contained",
        errata=(
            "It leaves out the pressure on the ends, P pi r**2: the pull is too large by it, and "
            "has no locking angle.",
        ),
        latex=r"F = \frac{2 \pi r_0^2 P}{\tan^2\theta_0} (1 - \epsilon)^2 "
        r"\quad \Leftrightarrow \quad "
        r"\epsilon = 1 - \sqrt{\frac{F \tan^2\theta_0}{2 \pi r_0^2 P}}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(pressure * length**2 / (2.0 * math.pi * self.braid.turns**2))
