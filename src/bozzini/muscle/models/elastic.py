"""Muscles with an elastic bladder, linear or hyperelastic (thesis 2.2.3, 2.2.4)."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_range
from ...numeric.arrays import Floats
from ...numeric.roots import find_between
from .card import WALL_FIELDS, Card, Choice, Law, Parameter, make_friction
from .ideal import (
    BladderWall,
    ForceBalanceModel,
    WalledModel,
    find_radius,
    pull_ideal,
)


class ConstantThickness(ForceBalanceModel):
    """A linear elastic bladder as thick as at rest, without the pressure on its wall.

    A subclass brings the section, with the area that bears the axial stress.
    """

    keeps_thickness = True
    wall_pressure = False

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        modulus, braid = self.muscle.modulus, self.braid
        hoop = find_radius(braid, length) / braid.radius - 1.0
        return np.asanyarray(modulus * (length / braid.length - 1.0)), np.asanyarray(modulus * hoop)


class Schulte(ConstantThickness):
    """The first model with a bladder: thin, linear elastic, with friction on the braid.

    The printed elastic term has no thickness and does not vanish at rest; what stands here is the
    balance of forces for a thin wall, ``s_z = E (l / l0 - 1)``, ``s_h = E (r / r0 - 1)``. Friction
    is ``mu (P - P_u) 2 pi r l0``, with the sum ``mu`` of the coefficients between strands and
    between strands and tube. It needs the pressure ``P_u`` that inflates the free tube to the
    radius ``r``, which the survey does not give: the law ``inflation_pressure``. Below it there is
    no contact and no friction. ``as_printed=True`` takes friction off at any direction.
    """

    extensile = True
    card = Card(
        name="schulte",
        title="Thin linear elastic bladder, friction on the braid",
        authors="Schulte",
        reference="H. F. Schulte, The characteristics of the McKibben artificial muscle, in: The "
        "application of external power in prosthetics and orthotics, National Academy of Sciences, "
        "Publication 874, 1961",
        equation="(2.15)",
        status="partial",
        parameters=(
            make_friction("sum of the friction coefficients of strands and of strands on tube"),
        ),
        laws=(
            Law(
                "inflation_pressure [MPa]",
                ("radius [mm]",),
                "the pressure that inflates the free tube to a radius",
                "Schulte (1961)",
                only_with="friction",
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The printed elastic term has no thickness of the wall, and is b E l0 sin(theta0) / N "
            "at rest instead of 0.",
        ),
        latex=r"F = \frac{P b^2}{4 \pi N^2} (3 \cos^2\theta - 1) + \frac{b E t_0}{N} \left["
        r"\sin\theta \left(\frac{l}{l_0} - 1\right) - \frac{\cos^2\theta}{\sin\theta} "
        r"\frac{b \sin\theta / N - 2 \pi r_0}{2 \pi r_0}\right] "
        r"\mp \frac{l_0 b}{N} (P - P_u) \mu \sin\theta",
        latex_printed=r"F = \frac{P b^2}{4 \pi N^2} (3 \cos^2\theta - 1) + \frac{b E}{N} \left["
        r"l_0 \sin\theta - \frac{\cos^2\theta}{\sin\theta} \left(\frac{b}{N} \sin\theta - "
        r"2 \pi r_0\right)\right] - \frac{l_0 b}{N} (P - P_u) \mu \sin\theta",
        missing="P_u, the pressure that inflates the free tube to the braid's radius: "
        "Schulte (1961). Only friction needs it.",
    )

    prints_one_way = True

    def _section(self, length: Floats) -> tuple[float, Floats]:
        thickness = self.wall.thickness
        return thickness, 2.0 * math.pi * find_radius(self.braid, length) * thickness

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        if not self.as_printed:
            return super()._pull(pressure, length)
        braid = self.braid
        cosine = length / braid.strand_length
        sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length / braid.turns
        round_it = scale * sine - 2.0 * math.pi * braid.radius
        wall = braid.length * sine - cosine**2 / sine * round_it
        elastic = scale * self.muscle.modulus * wall
        return np.asanyarray(pull_ideal(braid, pressure, length) + elastic)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        radius = find_radius(self.braid, length)
        excess = np.maximum(pressure - self._call("inflation_pressure", radius), 0.0)
        round_it = 2.0 * math.pi * radius * self.braid.length
        return np.asanyarray(self.parameters["friction"] * excess * round_it)


class Ferraresi(ConstantThickness):
    """A thin linear elastic bladder; the axial stress acts on the wall's area at rest.

    With the area ``2 pi r t0`` instead it is the corrected `Schulte`.
    """

    extensile = True
    card = Card(
        name="ferraresi",
        title="Thin linear elastic bladder",
        authors="Ferraresi, Franco, Manuello Bertetto",
        reference="C. Ferraresi, W. Franco, A. Manuello Bertetto, Flexible pneumatic actuators: a "
        "comparison between the McKibben and the straight fibres muscles, Journal of Robotics and "
        "Mechatronics 13(1), 2001",
        equation="(2.16)",
        status="corrected",
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The root is printed as sqrt(l**2 - b**2), imaginary for every braid: b**2 - l**2.",
            "The hoop term is printed with l, a force per length: l**2.",
            "The hoop term is printed with a minus, which makes the bladder help: plus.",
            "It vanishes at rest only with the radius it is measured at: r0 for the printed r_i.",
            "The axial term is printed E A l / l0, a pull at rest: E A (l / l0 - 1).",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + E t_0 l^2 \left("
        r"\frac{1}{N \sqrt{b^2 - l^2}} - \frac{1}{2 \pi N^2 r_0}\right) "
        r"+ E A \left(\frac{l}{l_0} - 1\right)",
        latex_printed=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) - E t_0 l \left("
        r"\frac{1}{N \sqrt{l^2 - b^2}} - \frac{1}{2 \pi N^2 r_i}\right) "
        r"+ E A \left(\frac{l}{l_0}\right)",
        unprintable="its root of l**2 - b**2 is imaginary, a braid being shorter than its strands",
    )

    def _section(self, length: Floats) -> tuple[float, float]:
        return self.wall.thickness, self.wall.area_at_rest


class KotheraBalance(ForceBalanceModel):
    """The balance of forces on a thick linear elastic bladder that keeps its volume.

    ``s_z = E (l / l0 - 1)``. The hoop term ``E l (t l - t0 l0) / (2 pi r N**2)`` is that of
    ``s_h = E (r / r0 - 1)`` in a thin wall, where ``r t l`` is constant; it is kept as printed,
    with the thickness of the thick wall.

    The pressure on a thick wall takes from the pull where the braid angle is small, so that at
    high pressure the pull can grow at first as the muscle contracts.
    """

    extensile = True
    card = Card(
        name="kothera-balance",
        title="Thick linear elastic bladder, balance of forces",
        authors="Kothera, Jangid, Sirohi, Wereley",
        reference="C. S. Kothera, M. Jangid, J. Sirohi, N. M. Wereley, Experimental "
        "characterization and static modeling of McKibben actuators, Journal of Mechanical Design "
        "131(9), 2009",
        equation="(2.17)",
        status="self-contained",
        uses=(*WALL_FIELDS, "modulus"),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + P \left(\frac{V_b}{l} - "
        r"\frac{t l^2}{2 \pi r N^2}\right) + E V_b \left(\frac{1}{l_0} - \frac{1}{l}\right) "
        r"+ \frac{E l}{2 \pi r N^2} (t l - t_0 l_0)",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        modulus, rest, wall = self.muscle.modulus, self.braid.length, self.wall
        thinning = wall.thickness * rest / (wall.thickness_at(length) * length)
        return np.asanyarray(modulus * (length / rest - 1.0)), np.asanyarray(
            modulus * (thinning - 1.0)
        )


_STRETCHES = Choice(
    name="stretches",
    what="radius of the wall at which the hoop stretch is taken",
    words=("middle", "outer"),
)
_CONSTANTS = tuple(
    Parameter(
        f"{name} [MPa]",
        f"constant of the {which} invariant; E = 6 (c10 + c01)",
        (-1e3, 1e3),
        neutral=0.0,
        linear=True,
    )
    for name, which in (("c10", "first"), ("c01", "second"))
)
_INVARIANT = (
    "The second invariant of (2.18) is right only where the product of the stretches is 1: "
    "the third is the inverse of the other two here."
)


@dataclass(frozen=True, kw_only=True)
class Stretches:
    """Stretches of a wall that keeps its volume, uniform over it; arrays of one shape.

    The radial stretch is the inverse of the product. Rates are slopes of their logarithms in the
    length, the wall touching the braid; `hoop_growth` is that of the hoop stretch in the radius, at
    one length [1/mm].
    """

    axial: Floats
    hoop: Floats
    axial_rate: Floats
    hoop_rate: Floats
    hoop_growth: Floats

    def find_slopes(self, c10: float, c01: float) -> tuple[Floats, Floats]:
        """Return the slopes of the energy density in the logarithms of both stretches [MPa]."""
        radial = 1.0 / (self.axial * self.hoop) ** 2
        along = 2.0 * (self.axial**2 - radial) * (c10 + c01 * self.hoop**2)
        across = 2.0 * (self.hoop**2 - radial) * (c10 + c01 * self.axial**2)
        return np.asanyarray(along), np.asanyarray(across)

    def find_ogden_slopes(self, modulus: float, exponent: float) -> tuple[Floats, Floats]:
        """Return the same of Ogden's energy with one term, by small-strain modulus [MPa]."""
        logs = np.log(self.axial), np.log(self.hoop)
        radial = -(logs[0] + logs[1])

        def spread(log: Floats) -> Floats:
            if exponent == 0.0:
                return np.asanyarray(log - radial)
            return np.asanyarray(
                (np.expm1(exponent * log) - np.expm1(exponent * radial)) / exponent
            )

        factor = 2.0 / 3.0 * modulus
        return factor * spread(logs[0]), factor * spread(logs[1])


def find_stretches(wall: BladderWall, length: Floats, *, at: str) -> Stretches:
    """Return the stretches of a wall at lengths [mm].

    The hoop stretch is taken at the ``"middle"``, ``(2 r - t) / (2 r0 - t0)`` of (2.19), or the
    ``"outer"`` radius, ``r / r0`` of (2.20).
    """
    braid = wall.braid
    axial = length / braid.length
    square = math.tan(braid.angle) ** -2
    wider = (1.0 - axial) * (1.0 + axial) * square  # r**2 / r0**2 - 1, with its digits near rest
    widening = np.sqrt(1.0 + wider)
    radius = braid.radius * widening
    slope = -square * axial * braid.radius / (braid.length * widening)
    if at == "outer":
        hoop, rate, growth = widening, slope / radius, 1.0 / radius
    else:
        thicker = wall.area_at_rest / math.pi * (1.0 - axial) / axial
        bore = np.sqrt(wall.bore_at_rest**2 + braid.radius**2 * wider - thicker)
        change = (radius * slope + 0.5 * wall.area_at(length) / (math.pi * length)) / bore
        hoop = (radius + bore) / (braid.radius + wall.bore_at_rest)
        rate, growth = (slope + change) / (radius + bore), 1.0 / bore
    return Stretches(
        axial=np.asanyarray(axial),
        hoop=np.asanyarray(hoop),
        axial_rate=np.asanyarray(1.0 / length),
        hoop_rate=np.asanyarray(rate),
        hoop_growth=np.asanyarray(growth),
    )


class HyperelasticModel(WalledModel):
    """A bladder with an energy ``W``, which keeps its volume ``V_b`` and fills the braid.

    Pull ``F = -P dV/dl + V_b dW/dl`` and contact pressure ``P_o = P - V_b (dW/dr) / (2 pi r l)``
    are slopes of one energy, ``V_b W - P (V - V_b)`` with ``V = pi r**2 l``. A subclass brings
    `_find_slopes` and may bring `_hoop_at`.
    """

    @abstractmethod
    def _find_slopes(self, stretches: Stretches) -> tuple[Floats, Floats]:
        """Slopes of the energy density in the logarithms of axial and hoop stretch [MPa]."""

    def _hoop_at(self) -> str:
        """Where the hoop stretch is taken, as in `find_stretches`."""
        return str(self.keywords["stretches"])

    def _pull_wall(self, length: Floats) -> Floats:
        """Slope of the energy of the wall, ``V_b dW/dl`` [N]."""
        wall = self.wall
        stretches = find_stretches(wall, length, at=self._hoop_at())
        along, across = self._find_slopes(stretches)
        slope = along * stretches.axial_rate + across * stretches.hoop_rate
        return np.asanyarray(wall.volume * slope)

    def _bear(self, length: Floats) -> Floats:
        """Pressure that the wall bears [MPa]."""
        wall = self.wall
        stretches = find_stretches(wall, length, at=self._hoop_at())
        _, across = self._find_slopes(stretches)
        lateral = 2.0 * math.pi * find_radius(self.braid, length) * length
        return np.asanyarray(wall.volume * across * stretches.hoop_growth / lateral)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(pressure - self._bear(length))


class MooneyRivlin(HyperelasticModel):
    """A bladder whose constants `c10` and `c01` are parameters; the pull is linear in them."""

    guesses = {
        "c10": lambda muscle: (1.0 - muscle.mooney_ratio) * muscle.modulus / 6.0,
        "c01": lambda muscle: muscle.mooney_ratio * muscle.modulus / 6.0,
    }

    def _find_slopes(self, stretches: Stretches) -> tuple[Floats, Floats]:
        given = self.parameters
        return stretches.find_slopes(given["c10"], given["c01"])


class Delson(MooneyRivlin):
    """Gaylord's pull and the slope of a Mooney-Rivlin energy, uniform over the wall.

    The hoop stretch is that of the wall's middle surface, (2.19), or with ``stretches="outer"``
    that of the braid, (2.20), which the survey has from another paper ([109]). The product of the
    stretches is 1 either way. ``as_printed=True`` has the pressure push.

    The wall resists contraction up to the locking angle while ``0 <= c01 <= c10``; `c01` alone does
    so near rest, and where the strands are steep.
    """

    extensile = True
    card = Card(
        name="delson",
        title="Mooney-Rivlin energy",
        authors="Delson, Hanak, Loewke, Miller",
        reference="N. Delson, T. Hanak, K. Loewke, D. N. Miller, Modeling and implementation of "
        "McKibben actuators for a hopping robot, International Conference on Advanced Robotics, "
        "2005",
        equation="(2.21)",
        status="fitted",
        parameters=_CONSTANTS,
        choices=(_STRETCHES,),
        uses=WALL_FIELDS,
        errata=(
            "The work of the pressure is printed + P dV/dl, a push: with a pull positive, "
            "- P dV/dl.",
            _INVARIANT,
        ),
        latex=r"F = -P \frac{dV}{dl} + V_b \frac{dW}{dl}, \quad W = C_{10} \left(\lambda_1^2 + "
        r"\lambda_2^2 + \lambda_3^2 - 3\right) + C_{01} \left(\lambda_1^{-2} + \lambda_2^{-2} + "
        r"\lambda_3^{-2} - 3\right), \quad \lambda_3 = \frac{1}{\lambda_1 \lambda_2}",
        latex_printed=r"F = P \frac{dV}{dl} + V_b \frac{dW}{dl}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        acting = -pressure if self.as_printed else pressure
        return np.asanyarray(pull_ideal(self.braid, acting, length) + self._pull_wall(length))


class KotheraEnergy(MooneyRivlin):
    """Gaylord's pull, the slope of a Mooney-Rivlin energy, and strands that stretch.

    A strand under the braid's pressure ``P`` is longer by
    ``P b**2 l / (2 pi**2 N**2 m r_n**2 E_b)``, and that takes
    ``P**2 b**3 l / (4 pi**3 m r_n**2 E_b N**4)`` from the pull: first order, good while a strand
    stretches little. Friction is a share of the size of the pull, and against the motion; as
    printed it is the share of the pull, which helps the motion where the muscle pushes.

    Without strands that stretch it is `Delson`; ``as_printed=True`` has the wall help contraction.
    """

    card = Card(
        name="kothera-energy",
        title="Mooney-Rivlin energy, strands that stretch, friction",
        authors="Kothera, Jangid, Sirohi, Wereley",
        reference=KotheraBalance.card.reference,
        equation="(2.22)",
        status="fitted",
        parameters=(
            *_CONSTANTS,
            make_friction("friction over pull", largest=0.99),
        ),
        choices=(_STRETCHES,),
        uses=(*WALL_FIELDS, "strands", "strand_radius", "strand_modulus"),
        errata=(
            "The term of the wall is printed with a minus, which makes it help contraction; that "
            "would be right for slopes in the contraction.",
            "The term of the strands is printed over 4 pi**2 m r_n, a force times a length: over "
            "4 pi**3 m r_n**2.",
            "The text's friction is in proportion to the pull with its sign, and helps the motion "
            "where that is negative: its size is taken.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + V_b \frac{dW}{dl} - "
        r"\frac{P^2 b^3 l}{4 \pi^3 m r_n^2 E_b N^4} \mp \mu_f |F|",
        latex_printed=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) - V_b \left(2 C_{10} "
        r"\left[\lambda_1 \lambda_1' + \dots\right] + 2 C_{01} \left[\lambda_1 (\lambda_2^2 + "
        r"\lambda_3^2) \lambda_1' + \dots\right]\right) - "
        r"\frac{P^2 b^3 l}{4 \pi^2 m r_n E_b N^4}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid, muscle = self.braid, self.muscle
        size = muscle.strand_radius if self.as_printed else math.pi * muscle.strand_radius**2
        strands = 4.0 * math.pi**2 * muscle.strands * size * muscle.strand_modulus
        softening = pressure**2 * braid.strand_length**3 * length / (strands * braid.turns**4)
        wall = self._pull_wall(length)
        ideal = pull_ideal(braid, pressure, length)
        return np.asanyarray(ideal + (-wall if self.as_printed else wall) - softening)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        pull = self._pull(pressure, length)
        return np.asanyarray(
            self.parameters["friction"] * (pull if self.as_printed else np.abs(pull))
        )


class Ogden(HyperelasticModel):
    """Gaylord's pull and the slope of Ogden's energy with one term, uniform over the wall.

    The survey has no such model. Ogden's sum, cut to one term and written with the modulus of small
    strains, ``E = 3 mu alpha / 2``, is ``W = 2 E / (3 alpha**2) (sum of lambda**alpha - 3)``. With
    the exponent 2 it is neo-Hookean, ``C10 = E / 6``: then the pull is that of `Delson` and, with
    the stretch ``"outer"``, of `Trivedi` by energy. With -2 it is the second term of Mooney-Rivlin
    alone, with 1 Varga's energy, with 0 Hencky's, quadratic in the logarithms of the stretches. A
    small exponent has a wall that resists less and less as it widens, a large one a wall that
    stiffens.
    """

    extensile = True
    card = Card(
        name="ogden",
        title="Ogden energy of one term",
        authors="Ogden",
        reference="R. W. Ogden, Large deformation isotropic elasticity: on the correlation of "
        "theory and experiment for incompressible rubberlike solids, Proceedings of the Royal "
        "Society A 326, 1972",
        equation="not in the thesis",
        status="self-contained",
        parameters=(
            Parameter(
                "exponent",
                "exponent of the stretches; 2 is neo-Hookean",
                (-10.0, 10.0),
                default=2.0,
                neutral=2.0,
            ),
        ),
        choices=(_STRETCHES,),
        uses=(*WALL_FIELDS, "modulus"),
        latex=r"F = -P \frac{dV}{dl} + V_b \frac{dW}{dl}, \quad W = \frac{2 E}{3 \alpha^2} "
        r"\left(\lambda_1^\alpha + \lambda_2^\alpha + \lambda_3^\alpha - 3\right), \quad "
        r"\lambda_3 = \frac{1}{\lambda_1 \lambda_2}",
    )

    def _find_slopes(self, stretches: Stretches) -> tuple[Floats, Floats]:
        return stretches.find_ogden_slopes(self.muscle.modulus, self.parameters["exponent"])

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(pull_ideal(self.braid, pressure, length) + self._pull_wall(length))


_NEAR_LOCKING = 1.0 - 1e-9
_TABLE = 129  # lengths between which a free length is bracketed
_TUBE_STATE = ("axial stretch", "pressure [MPa]")
_WANG = "Wang, Wereley and Pillsbury (2015)"


class Trivedi(HyperelasticModel):
    """A neo-Hookean bladder whose length without load follows from energy, and a spring about it.

    What the pressure does is what the wall stores, ``P dV = V_b dW``: that gives (2.24), the
    pressure at each length without load, `find_free_pressure`. It grows without bounds towards the
    locking angle. The survey's force (2.25), ``pi E (r0**2 - r_i**2) (lambda - 1)``, has no
    pressure, and at the stretch of (2.24) it is what pulls a contracted muscle back. We read it as
    a spring about the free length ``lambda* l0`` that the pressure makes, with the sign of a pull::

        F = pi E (r0**2 - r_i**2) (l / l0 - lambda*(P))

    With ``force="energy"`` the pull is instead ``-P dV/dl + V_b dW/dl``, the slope of the energy
    that (2.24) comes from; both vanish at the same length.

    ``volume`` is that of the gas. ``"bore"`` is printed, ``pi r_i**2 l0 lambda_1 lambda_2**2`` with
    the hoop stretch of the braid, which a wall that keeps its volume does not allow; with it the
    pressures are those of ``"outer"``, ``pi r**2 l``, times ``r0**2 / r_i**2``. The stretches are
    ``l / l0`` and ``r / r0``, uniform over the wall.

    ``as_printed=True`` has the sign of (2.24), with which the muscle lengthens, and refuses
    pressures at which that ends at no legal length.
    """

    card = Card(
        name="trivedi",
        title="Neo-Hookean energy without load, linear spring about it",
        authors="Trivedi, Lotfi, Rahn",
        reference="D. Trivedi, A. Lotfi, C. D. Rahn, Geometrically exact models for soft robotic "
        "manipulators, IEEE Transactions on Robotics, 2008",
        equation="(2.24)-(2.25)",
        status="corrected",
        choices=(
            Choice(name="volume", what="volume of the gas", words=("bore", "outer")),
            Choice(
                name="force",
                what="the spring of (2.25), or the slope of the energy",
                words=("spring", "energy"),
            ),
        ),
        uses=(*WALL_FIELDS, "modulus"),
        errata=(
            "The pressure of (2.24) is printed with the wrong sign: a muscle would lengthen.",
            "(2.25) is negative where the muscle has contracted: it is what pulls it back, and the "
            "pull of a muscle that is held is its opposite.",
            "Its volume, the bore scaled with the hoop stretch of the braid, does not go with a "
            "wall that keeps its own: volume='outer' does.",
        ),
        latex=r"F = \pi E (r_0^2 - r_i^2) \left(\frac{l}{l_0} - \lambda_*\right), \quad "
        r"P = \frac{E}{3} \left(\frac{r_0^2}{r_i^2} - 1\right) \frac{\lambda_*^4 (s^2 - c^2) "
        r"(1 - x)^2 - s^4 (1 - 2 x)}{\lambda_*^3 (1 - x)^2 (1 - 3 x)}, \quad x = \lambda_*^2 c^2, "
        r"\quad c = \cos\theta_0, \quad s = \sin\theta_0",
        latex_printed=r"F = \pi E (r_0^2 - r_i^2) (\lambda_1 - 1), \quad P = \frac{E}{3} \left("
        r"\frac{r_0^2}{r_i^2} - 1\right) \frac{\lambda_1^8 c^4 \cos 2\theta_0 - \dots}"
        r"{\lambda_1^3 (1 - 5 x + 7 x^2 - 3 x^3)}",
    )

    def find_free_pressure(self, contraction: ArrayLike) -> Floats:
        """Return the pressure at which the muscle contracts so far without load [MPa], (2.24).

        With ``as_printed=True`` it has the printed sign.

        Parameters
        ----------
        contraction : array_like
            Contraction [mm], from 0 to where the braid locks, which no pressure reaches.

        Raises
        ------
        InputError
            If a contraction is outside that range.
        """
        contractions = check_array("contraction", contraction)
        high = self.braid.locking_contraction * _NEAR_LOCKING
        check_range("contraction", contractions, 0.0, high, "mm")
        length = self.braid.length - contractions
        per_pressure = self._gas_share() * pull_ideal(self.braid, np.ones(length.shape), length)
        return np.asanyarray(-self._pull_wall(length) / per_pressure)

    def _find_slopes(self, stretches: Stretches) -> tuple[Floats, Floats]:
        return stretches.find_slopes(self.muscle.modulus / 6.0, 0.0)

    def _hoop_at(self) -> str:
        return "outer"

    def _gas_share(self) -> float:
        """Volume of the gas over that of the braid, with the sign of (2.24)."""
        bore = (self.wall.bore_at_rest / self.braid.radius) ** 2
        share = bore if self.keywords["volume"] == "bore" else 1.0
        return -share if self.as_printed else share

    def _pull_energy(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(self._pull_gas(pressure, length) + self._pull_wall(length))

    def _pull_gas(self, pressure: Floats, length: Floats) -> Floats:
        """Pull of the gas alone [N]."""
        return pull_ideal(self.braid, self._gas_share() * pressure, length)

    def _find_free_length(self, pressure: Floats) -> Floats:
        """Length without load [mm]; NaN where there is none.

        The last answer is kept: a fit asks for many contractions at the same pressures.
        """
        key = pressure.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = self._solve_free_length(pressure.ravel())
        return self._last[key].reshape(pressure.shape)

    @cached_property
    def _last(self) -> dict[bytes, Floats]:
        """The last answer of `_find_free_length`, by its pressures."""
        return {}

    def _solve_free_length(self, flat: Floats) -> Floats:
        """Return the lengths without load at pressures (n,) [mm], computed anew."""
        low, high = self.braid.locking_length, self._base_lengths()[1]

        def excess(index: NDArray[np.intp], lengths: Floats) -> Floats:
            return self._pull_energy(flat[index], lengths)

        at = np.linspace(low, min(high, 1.001 * self.braid.length), _TABLE)
        with np.errstate(all="ignore"):
            over = -self._pull_wall(at) / self._pull_gas(np.ones(at.shape), at)
        ends = np.full(flat.shape, low), np.full(flat.shape, high)
        if (np.diff(over[1:]) < 0.0).all():  # a pressure of each length: near by is a bracket
            place = np.searchsorted(-over[1:], -flat)
            ends = at[place], np.append(at, high)[place + 1]
        return find_between(excess, *ends)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        if self.keywords["force"] == "energy":
            return self._pull_energy(pressure, length)
        stretch = (length - self._find_free_length(pressure)) / self.braid.length
        return np.asanyarray(self.muscle.modulus * self.wall.area_at_rest * stretch)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(self._gas_share() * pressure - self._bear(length))


class Wang(WalledModel):
    """The balance of forces with the forces in an inflated tube, whatever its material.

    The forces are laws of the axial stretch and the pressure: along the muscle, over the whole wall
    and tension positive, and round it, per length. The wall keeps its volume and fills the braid.
    ``as_printed=True`` has the term of the strands, which is no force, with the other sign.
    """

    card = Card(
        name="wang",
        title="Balance of forces on a Mooney-Rivlin tube",
        authors="Wang, Wereley, Pillsbury",
        reference="G. Wang, N. M. Wereley, T. Pillsbury, Non-linear quasi-static model of "
        "pneumatic artificial muscle actuators, Journal of Intelligent Material Systems and "
        "Structures, 2015",
        equation="(2.26)",
        status="partial",
        laws=(
            Law(
                "axial_force [N]",
                _TUBE_STATE,
                "the force along the wall of the inflated tube",
                _WANG,
            ),
            Law(
                "hoop_force [N/mm]",
                _TUBE_STATE,
                "the force round the wall of the inflated tube, per length",
                _WANG,
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            "The term of the strands is printed with a minus: the pressure on them pulls.",
            "It is printed over r_o**2, a force per length: over r_o.",
            "The text swaps the two forces: F_z is along the muscle, F_theta round it.",
        ),
        latex=r"F = F_z - P \pi r_i^2 + \frac{(P r_i - F_\theta) l^2}{2 \pi N^2 r_o}",
        latex_printed=r"F = F_z - P \pi r_i^2 - \frac{P r_i l^2 - F_\theta l^2}{2 \pi N^2 r_o^2}",
        missing="the forces in the tube, F_z and F_theta, from its Mooney-Rivlin constants: "
        f"{_WANG}",
    )

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        braid = self.braid
        radius = find_radius(braid, length)
        bore = radius - self.wall.thickness_at(length)
        along = self._call("axial_force", length / braid.length, pressure)
        on_braid = radius * self._contact_pressure(pressure, length)
        strands = on_braid * length**2 / (2.0 * math.pi * braid.turns**2 * radius)
        if self.as_printed:
            strands = -strands / radius
        return np.asanyarray(along - math.pi * pressure * bore**2 + strands)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        radius = find_radius(self.braid, length)
        bore = radius - self.wall.thickness_at(length)
        around = self._call("hoop_force", length / self.braid.length, pressure)
        return np.asanyarray((pressure * bore - around) / radius)
