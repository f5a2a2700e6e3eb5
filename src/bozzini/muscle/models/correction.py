"""Gaylord's pull corrected: of the strain, of the force, for friction (thesis 2.2.2)."""

from __future__ import annotations

import math
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from ...checks import check_range, show_apart
from ...errors import InputError
from ...numeric.arrays import Floats
from .base import ANGLES, TYPICAL_PRESSURE, CatalogueModel
from .card import BRAID_FIELDS, SHAPE_FIELDS, Card, Choice, Parameter, make_friction
from .ideal import bracket, measure_ideal, pull_by_strain

_FACTORS = (1e-6, 1e6)
"""Legal factors of the strain: without sign change, and finite."""

_ITTO = (
    "T. Itto, K. Kogiso, Hybrid modeling of McKibben pneumatic artificial muscle systems, IEEE "
    "International Conference on Industrial Technology, 2011"
)
_ANDRIKOPOULOS = (
    "G. Andrikopoulos, G. Nikolakopoulos, S. Manesis, Novel considerations on static force "
    "modeling of pneumatic muscle actuators, IEEE/ASME Transactions on Mechatronics 21(6), 2016"
)
_WIDE = (-100.0, 100.0)
_FADING = Parameter(
    "kappa1", "part of the strain's factor that fades with pressure", _WIDE, neutral=0.0
)
_TONDU = (
    _FADING,
    Parameter("kappa2", "strain's factor at high pressure", _WIDE, neutral=1.0),
    Parameter(
        "pressure_unit [MPa]",
        "unit of the pressure in the exponent, 0.1 for bar",
        (1e-6, 1e3),
        source="unit",
        default=0.1,
    ),
)
_RATE = Parameter(
    "kappa2 [1/MPa]",
    "rate at which the strain's factor grows with pressure",
    (-1000.0, 1000.0),
    neutral=0.0,
)
_FRICTION = make_friction("coefficient of friction between strands")
_CONTACT_FRICTION = (
    _FRICTION,
    Parameter(
        "contact_scale",
        "scale of the contact area; only friction / contact_scale matters",
        (1e-6, 1e9),
        source="measured",
        default=1.0,
    ),
)
_MEASURED = (
    Parameter(
        "largest_force [N]",
        "pull at the free length under the test pressure",
        (0.0, 1e6),
        linear=True,
    ),
    Parameter(
        "largest_contraction [mm]", "contraction without load under the test pressure", (1e-6, 1e4)
    ),
    Parameter(
        "test_pressure [MPa]",
        "pressure of the test; only largest_force / test_pressure matters",
        (1e-6, 1e4),
        source="measured",
    ),
)


class StrainCorrected(CatalogueModel):
    """A model whose strain is multiplied by a factor ``k(P)``: ``x = 1 - k eps`` for ``1 - eps``.

    Legal are lengths at which ``x`` is that of a braid angle in `ANGLES`: with ``x`` below, the
    parabola would rise again. A factor outside ``[1e-6, 1e6]`` is refused. Friction is
    ``mu P S1 / S_scale``, if the model has it.
    """

    @abstractmethod
    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain, ``k``."""

    def _strain_offset(self) -> float:
        """Strain that there is without contraction."""
        return 0.0

    def _find_stretch(self, pressure: Floats, length: Floats) -> Floats:
        strain = (self.braid.length - length) / self.braid.length + self._strain_offset()
        return np.asanyarray(1.0 - self.find_factor(pressure) * strain)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_by_strain(self.braid, pressure, self._find_stretch(pressure, length))

    def _scale(self, blocked: Floats, pressure: Floats, length: Floats) -> Floats:
        """Return Gaylord's pull scaled to a blocked force [N]."""
        shape = bracket(self.braid, self._find_stretch(pressure, length))
        return np.asanyarray(blocked * shape / bracket(self.braid, 1.0))

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        factor = self.find_factor(pressure)
        words = f"strain factor k of the model {self.name} at pressure"
        check_range(words, factor, *_FACTORS)
        low, high = self._find_lengths(pressure)
        if np.any(low >= high):
            index = int(np.argmax(low >= high))
            raise InputError(
                f"pressure is {pressure.flat[index]:g} MPa: the model {self.name} has no legal "
                "length there, its constants and the pressure must leave it one"
            )
        return low, high

    def _holds(self, pressure: Floats) -> NDArray[np.bool_]:
        factor = self.find_factor(pressure)
        low, high = self._find_lengths(pressure)
        return np.asarray((factor >= _FACTORS[0]) & (factor <= _FACTORS[1]) & (low < high))

    def _find_lengths(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        factor = self.find_factor(pressure)
        rest, cosine = self.braid.length, math.cos(self.braid.angle)
        high, low = (
            np.clip(
                rest * (1.0 + self._strain_offset() - (1.0 - math.cos(angle) / cosine) / factor),
                *self._base_lengths(),
            )
            for angle in ANGLES
        )
        return low, high

    def find_contact_area(self, pressure: Floats, length: Floats) -> Floats:
        """Return the contact area of the strands [mm^2], here Tondu and Lopez's ``S1``.

        At rest it is the lateral area.
        """
        braid = self.braid
        stretch = self._find_stretch(pressure, length)
        cosine = math.cos(braid.angle) * stretch
        scale = 2.0 * math.pi * braid.radius * braid.length * math.sin(braid.angle)
        return np.asanyarray(scale / (stretch * np.sqrt((1.0 - cosine) * (1.0 + cosine))))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        if "contact_scale" not in given:
            return super()._friction(pressure, length)
        share = given["friction"] / given["contact_scale"]
        return np.asanyarray(share * pressure * self.find_contact_area(pressure, length))


class TonduLopez(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 exp(-P) + kappa2``, and friction between the strands.

    The exponent is dimensional: ``P`` counts in `pressure_unit`, bar by default. Friction takes
    from the pull on the way up and adds to it on the way down.
    """

    card = Card(
        name="tondu-lopez",
        title="Strain factor that fades with pressure, friction of strands",
        authors="Tondu, Lopez",
        reference="B. Tondu, P. Lopez, Modeling and control of McKibben artificial muscle robot "
        "actuators, IEEE Control Systems Magazine 20(2), 2000",
        equation="(2.6)-(2.8)",
        status="fitted",
        parameters=(*_TONDU, *_CONTACT_FRICTION),
        errata=("The exponent is printed without the unit of P: it is an argument here.",),
        latex=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \mp \mu_s P \frac{S_1}{S_s}, \quad "
        r"x = 1 - \left(\kappa_1 e^{-P/P_u} + \kappa_2\right) \epsilon, \quad "
        r"S_1 = \frac{2 \pi r_0 l_0 \sin\theta_0}{x \sqrt{1 - x^2 \cos^2\theta_0}}",
    )

    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain."""
        given = self.parameters
        fading = np.exp(-pressure / given["pressure_unit"])
        return np.asanyarray(given["kappa1"] * fading + given["kappa2"])


class IttoExponential(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 exp(kappa2 P) + kappa3``."""

    card = Card(
        name="itto-a",
        title="Strain factor of three constants",
        authors="Itto, Kogiso",
        reference=_ITTO,
        equation="(2.6)",
        status="fitted",
        parameters=(
            _FADING,
            _RATE,
            Parameter("kappa3", "part of the strain's factor that is constant", _WIDE, neutral=1.0),
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 (1 - k \epsilon)^2 - q_2\right], \quad "
        r"k = \kappa_1 e^{\kappa_2 P} + \kappa_3",
    )

    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain."""
        given = self.parameters
        return np.asanyarray(given["kappa1"] * np.exp(given["kappa2"] * pressure) + given["kappa3"])


class IttoDoubled(StrainCorrected):
    """Gaylord's pull with ``k = kappa1 (1 + exp(kappa2 P))``."""

    card = Card(
        name="itto-b",
        title="Strain factor of two constants",
        authors="Itto, Kogiso",
        reference=_ITTO,
        equation="(2.43)",
        status="fitted",
        parameters=(
            Parameter(
                "kappa1", "half the strain's factor at no pressure", (0.0, 100.0), neutral=0.5
            ),
            _RATE,
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 \left\{1 - \kappa_1 \left(1 + e^{\kappa_2 P}\right) "
        r"\epsilon\right\}^2 - q_2\right]",
    )

    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain."""
        given = self.parameters
        return np.asanyarray(given["kappa1"] * (1.0 + np.exp(given["kappa2"] * pressure)))


class DavisCaldwell(TonduLopez):
    """Tondu and Lopez's pull, its friction over the area at which the strands lie side by side.

    The contact area of flat strands is that of the whole cylinder at the smallest braid angle
    ``theta_m``, and falls from there; round strands touch on less of it, by Hertz's contact of two
    spheres of a strand's radius under the load ``P (2 r_n)**2``.

    What is mended can be had back by two choices. ``minimum_angle``: ``"geometric"`` has strands
    of one family, ``4 pi r cos(theta) / m`` apart, at ``2 r_n``; ``"thesis"`` is (2.10) as
    printed, right only if its ``r0`` is the radius at 90 degrees. ``scale``: ``"areas"`` is the
    ratio of areas ``(r_n / a)**2`` that the text announces, with the contact's radius ``a``;
    ``"radii"`` is the printed (2.11), ``r_n / a``. ``as_printed=True`` has the printed ones, and
    ``S2`` with sine and cosine instead of their squares, so that it is no area of the cylinder.

    The strands' radius, number and modulus are the muscle's.
    """

    card = Card(
        name="davis-caldwell",
        title="Strain factor, friction of round strands",
        authors="Davis, Caldwell",
        reference="S. Davis, D. G. Caldwell, Braid effects on contractile range and friction "
        "modeling in pneumatic muscle actuators, International Journal of Robotics Research "
        "25(4), 2006",
        equation="(2.9)-(2.12)",
        status="fitted",
        parameters=(
            *_TONDU,
            _FRICTION,
            Parameter(
                "strand_poisson_ratio",
                "Poisson's ratio of a strand",
                (0.0, 0.5),
                source="material",
                only_with="friction",
            ),
        ),
        choices=(
            Choice(
                name="minimum_angle",
                what="angle at which the strands lie side by side",
                words=("geometric", "thesis"),
                printed="thesis",
            ),
            Choice(
                name="scale",
                what="ratio of flat to round contact",
                words=("areas", "radii"),
                printed="radii",
            ),
        ),
        uses=(*BRAID_FIELDS, "strands", "strand_radius", "strand_modulus"),
        errata=(
            "(2.9) prints sin(theta_m) cos(theta_m): only its square is the cylinder's lateral "
            "area at theta = theta_m.",
            "(2.10) lacks sin(theta0): strands of one family are 4 pi r cos(theta) / m apart.",
            "(2.11) is a ratio of radii, in the text of areas; its 1.442 is 3**(1/3).",
            "The exponent of the strain factor is printed without the unit of P.",
        ),
        latex=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \mp \mu_s P \frac{S_2}{S_s}, \quad "
        r"S_2 = \frac{b^2 \sin^2\theta_m \cos^2\theta_m}{N \sin\theta \cos\theta}, \quad "
        r"\sin 2\theta_m = \frac{m r_n \sin\theta_0}{\pi r_0}, \quad "
        r"S_s = \left(3 P \frac{1 - \nu_n^2}{E_n}\right)^{-2/3}",
        latex_printed=r"F = \pi r_0^2 P \left[q_1 x^2 - q_2\right] \pm \mu_s P \frac{S_2}{S_s}, "
        r"\quad S_2 = \frac{b^2 \sin\theta_m \cos\theta_m}{N \sin\theta \cos\theta}, \quad "
        r"\theta_m = \frac{1}{2} \sin^{-1} \frac{r_n m}{\pi r_0}, \quad S_s = "
        r"\frac{r_n}{1.442 \left[P r_n^3 (1 - \nu_n^2) / E_n\right]^{1/3}}",
    )

    @property
    def _cover(self) -> float:
        return self.muscle.strand_radius * self.muscle.strands / (math.pi * self.braid.radius)

    @property
    def smallest_angle(self) -> float:
        """Braid angle at which the strands lie side by side [rad], by `minimum_angle`."""
        geometric = self.keywords["minimum_angle"] == "geometric"
        share = self._cover * (math.sin(self.braid.angle) if geometric else 1.0)
        return 0.5 * math.asin(min(share, 1.0))

    def _check(self) -> None:
        if self.keywords["minimum_angle"] == "thesis" and self._cover > 1.0:
            most = math.pi * self.braid.radius / self.muscle.strands
            shown = show_apart(self.muscle.strand_radius, most)
            raise InputError(
                f"muscle strand radius is {shown[0]} mm: for (2.10) as printed "
                f"it must be at most {shown[1]} mm"
            )

    def find_share(self, pressure: Floats) -> Floats:
        """Return round contact over flat contact, by `scale`."""
        ratio = self.parameters["strand_poisson_ratio"]
        strain = pressure * (1.0 - ratio**2) / self.muscle.strand_modulus
        radii = (1.442 if self.as_printed else math.cbrt(3.0)) * np.cbrt(strain)
        return np.asanyarray(radii if self.keywords["scale"] == "radii" else radii**2)

    def find_contact_area(self, pressure: Floats, length: Floats) -> Floats:
        """Return the contact area of the strands [mm^2]."""
        braid, least = self.braid, self.smallest_angle
        top = math.sin(least) * math.cos(least)
        cosine = length / braid.strand_length
        bottom = cosine * np.sqrt((1.0 - cosine) * (1.0 + cosine))
        scale = braid.strand_length**2 / braid.turns
        return np.asanyarray(scale * (top if self.as_printed else top**2) / bottom)

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        area = self.find_contact_area(pressure, length)
        return np.asanyarray(
            self.parameters["friction"] * pressure * area * self.find_share(pressure)
        )


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
            Parameter("kappa1 [N/MPa]", "blocked force per pressure", (-1e6, 1e6), linear=True),
            Parameter(
                "kappa2 [N]",
                "blocked force extrapolated to no pressure",
                (-1e6, 1e6),
                neutral=0.0,
                linear=True,
            ),
            Parameter("kappa3", "free strain per logarithm of the pressure", (1e-6, 10.0)),
            Parameter(
                "pressure_unit [MPa]",
                "unit of the pressure in the logarithm, 0.001 for kPa",
                (1e-6, 1e3),
                source="unit",
                default=0.001,
            ),
        ),
        uses=SHAPE_FIELDS,
        errata=("The logarithm is printed without the unit of P: it is an argument here.",),
        latex=r"F = \pi r_0^2 P k_f \left[q_1 (1 - k_\epsilon \epsilon)^2 - q_2\right], \quad "
        r"k_f = \frac{\kappa_1 P + \kappa_2}{\pi r_0^2 P (q_1 - q_2)}, \quad k_\epsilon = "
        r"\frac{1}{\kappa_3 \ln (P / P_u)} \left(1 - \frac{1}{\sqrt{3} \cos\theta_0}\right)",
    )
    guesses = {
        "kappa1": lambda muscle: measure_ideal(muscle)[0],
        "kappa3": lambda muscle: max(
            1e-6, measure_ideal(muscle)[2] / math.log(TYPICAL_PRESSURE / 0.001)
        ),
    }

    @property
    def pressure_limits(self) -> tuple[float, float]:
        """Legal pressures [MPa]: above the unit, so that the free strain is positive."""
        low, high = super().pressure_limits
        return max(low, 1.001 * self.parameters["pressure_unit"]), high

    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain."""
        given = self.parameters
        free = given["kappa3"] * np.log(pressure / given["pressure_unit"])
        return np.asanyarray(measure_ideal(self.muscle)[2] / free)

    def _find_blocked(self, pressure: Floats) -> Floats:
        given = self.parameters
        return np.asanyarray(given["kappa1"] * pressure + given["kappa2"])

    def _length_limits(self, pressure: Floats) -> tuple[Floats | float, Floats | float]:
        words = "blocked force kappa1 P + kappa2 at pressure"
        check_range(words, self._find_blocked(pressure), 0.0, math.inf, "N")
        return super()._length_limits(pressure)

    def _holds(self, pressure: Floats) -> NDArray[np.bool_]:
        return np.asarray(super()._holds(pressure) & (self._find_blocked(pressure) >= 0.0))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return self._scale(self._find_blocked(pressure), pressure, length)


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
    guesses = {
        "test_pressure": TYPICAL_PRESSURE,
        "largest_force": lambda muscle: TYPICAL_PRESSURE * measure_ideal(muscle)[0],
        "largest_contraction": lambda muscle: muscle.active_length * measure_ideal(muscle)[2],
    }

    def find_factor(self, pressure: Floats) -> Floats:
        """Return the factor of the strain."""
        most = self.parameters["largest_contraction"]
        return np.full(pressure.shape, self.braid.locking_contraction / most)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        blocked = given["largest_force"] / given["test_pressure"] * pressure
        return self._scale(blocked, pressure, length)


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
            *_CONTACT_FRICTION,
            Parameter(
                "temperature_change [K]",
                "by how much the bladder is warmer than in the test",
                (-300.0, 300.0),
                source="measured",
                default=0.0,
                neutral=0.0,
            ),
            Parameter(
                "expansion [1/K]",
                "coefficient of linear thermal expansion of the bladder",
                (-1e-2, 1e-2),
                source="material",
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
        return given["temperature_change"] * given.get("expansion", 0.0)
