"""Models of miniature muscles (thesis 2.2.8)."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ...checks import add_hint, broadcast, check_array, check_range, name_at, show_apart
from ...errors import InputError
from ...numeric.arrays import Floats
from ...numeric.roots import bisect
from ..design import PRESSURE_LIMIT, Braid
from ..model import LOAD_LIMIT
from .base import ANGLES, CatalogueModel
from .card import SHAPE_FIELDS, WALL_FIELDS, Card, Choice, Law, Parameter
from .ideal import BladderWall, ForceBalanceModel, find_radius, measure_ideal, pull_ideal


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
                "pressure_offset [MPa]", "pressure of the dead band", (0.0, 1e4), neutral=0.0
            ),
            Parameter(
                "length_offset [mm]",
                "by how much the muscle is taken shorter",
                (-1e4, 1e4),
                neutral=0.0,
            ),
            Parameter(
                "smallest_force [N]",
                "threshold of the pull of the braid",
                (-1e6, 1e6),
                default=0.0,
                neutral=-1e6,
            ),
            Parameter(
                "spring_stiffness [N/mm]",
                "stiffness of the bladder",
                (0.0, 1e6),
                default=0.0,
                neutral=0.0,
                linear=True,
            ),
            Parameter(
                "slack_length [mm]",
                "length above which the bladder pulls",
                (0.0, 1e4),
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
            shown = show_apart(self.parameters["length_offset"], self.braid.strand_length)
            raise InputError(
                f"length_offset of the model de-volder is {shown[0]} mm: "
                f"it must leave the braid a length, its strands are "
                f"{shown[1]} mm long"
            )

    def _base_lengths(self) -> tuple[float, float]:
        strand, offset = self.braid.strand_length, self.parameters["length_offset"]
        shortest, longest = strand * math.cos(ANGLES[1]), strand * math.cos(ANGLES[0])
        return max(shortest, shortest + offset), min(longest, longest + offset)

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return np.asanyarray(pressure - self.dead_band())

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
        return np.asanyarray(pull)


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
                "threshold_pressure [MPa]",
                "pressure at which contraction begins",
                (0.0, 1e4),
                source="measured",
                neutral=0.0,
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
        thickness = BladderWall.of(self.muscle, braid).thickness
        radius = find_radius(braid, length)
        scale = self.muscle.modulus * thickness / braid.radius**2
        acting = pressure - self.dead_band()
        if self.as_printed:
            return np.asanyarray(acting + scale * (radius + braid.radius))
        return np.asanyarray(np.maximum(acting, 0.0) - scale * (radius - braid.radius))

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        return pull_ideal(self.braid, self._contact_pressure(pressure, length), length)


ORDERS = (1, 2, 3, 4)
"""Powers of the strain that a fitted stress has."""

MODULI = tuple(
    Parameter(
        f"modulus{i} [MPa]",
        f"stress per strain to the power of {i}",
        (-1e6, 1e6),
        default=None if i == 1 else 0.0,
        neutral=0.0,
        linear=True,
    )
    for i in ORDERS
)
_SLOPES = tuple(
    Parameter(
        f"modulus{i}_slope",
        f"growth of modulus{i} per pressure",
        (-1e6, 1e6),
        default=0.0,
        neutral=0.0,
        linear=True,
    )
    for i in ORDERS
)


class StrainStress(ForceBalanceModel):
    """A balance of forces whose stresses are polynomials of the strains along and round the muscle.

    Their coefficients may grow with the pressure.
    """

    guesses = {"modulus1": lambda muscle: muscle.modulus}

    def _find_strains(self, length: Floats) -> tuple[Floats, Floats]:
        """``l / l0 - 1`` and ``r / r0 - 1``."""
        braid = self.braid
        axial = (length - braid.length) / braid.length
        return np.asanyarray(axial), np.asanyarray(find_radius(braid, length) / braid.radius - 1.0)

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        given, strains = self.parameters, self._find_strains(length)
        totals = [np.zeros(length.shape), np.zeros(length.shape)]
        for i in reversed(ORDERS):
            factor = given[f"modulus{i}"] + given.get(f"modulus{i}_slope", 0.0) * pressure
            totals = [(total + factor) * e for total, e in zip(totals, strains, strict=True)]
        return totals[0], totals[1]


_HOCKING = (
    "E. G. Hocking, N. M. Wereley, Analysis of nonlinear elastic behavior in miniature pneumatic "
    "artificial muscles, Smart Materials and Structures 22, 2012"
)
_ENDS = Choice(
    name="ends",
    what="whether the length in the law is corrected for rounded ends",
    words=("plain", "corrected"),
)
_TURNS = "The pressure term is printed over 4 pi N, N times Gaylord's: over 4 pi N**2."
_PRINTED = r"\frac{P}{4 \pi N} (3 l^2 - b^2)"


def correct_length(braid: Braid, length: Floats) -> Floats:
    """Return ``l - 2 (pi / 2 - 1) (r - r0)``, the length of a muscle with rounded ends [mm].

    A sheath of length ``l``, measured along it, that at each end bends round a quarter of a circle
    from the fitting's radius ``r0`` to its own ``r``, is that long along the axis. The survey puts
    it into the law of the force in the place of the length.
    """
    excess = find_radius(braid, length) - braid.radius
    return np.asanyarray(length - (math.pi - 2.0) * excess)


@lru_cache(maxsize=16)  # a fit asks again and again, of the same braid
def _find_limits(braid: Braid, low: float, high: float) -> tuple[float, float]:
    """Return the lengths whose `correct_length` are `low` and `high` [mm]."""
    strand, round_it = braid.strand_length, 2.0 * math.pi * braid.turns

    def find(length: float) -> float:  # `correct_length` of one
        radius = math.sqrt((strand - length) * (strand + length)) / round_it
        return length - (math.pi - 2.0) * (radius - braid.radius)

    return (
        bisect(lambda length: find(length) - low, low, braid.length),
        bisect(lambda length: find(length) - high, braid.length, high),
    )


class HockingBase(StrainStress):
    """The balance of forces with any stresses, without the pressure on the wall.

    The stresses are laws of the strains ``l / l0 - 1`` along and ``r / r0 - 1`` round the muscle,
    tension positive. With ``ends="corrected"`` length, radius and thickness in the law are those of
    the `correct_length`.
    """

    wall_pressure = False

    card = Card(
        name="hocking-base",
        title="Balance of forces with any stresses",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.35)",
        status="corrected",
        choices=(_ENDS,),
        laws=(
            Law(
                "axial_stress [MPa]",
                ("axial strain",),
                "the stress along the muscle",
                "Hocking and Wereley (2012), as a polynomial: see the model hocking-1",
            ),
            Law(
                "hoop_stress [MPa]",
                ("hoop strain",),
                "the stress round the muscle",
                "Hocking and Wereley (2012), as a polynomial: see the model hocking-1",
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            _TURNS,
            "The text swaps the two stresses: the one over the wall's cross-section is axial.",
            "It leaves the pressure on the wall out, which the balance of forces has.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + \sigma_z \frac{V_b}{l} "
        r"- \frac{\sigma_\theta t l^2}{2 \pi N^2 r}",
        latex_printed=rf"F = {_PRINTED} + \sigma_1 \frac{{V_b}}{{l}} "
        r"- \frac{\sigma_2 t l^2}{2 \pi N^2 r}",
    )

    def _stresses(self, pressure: Floats, length: Floats) -> tuple[Floats, Floats]:
        axial, hoop = self._find_strains(length)
        return self._call("axial_stress", axial), self._call("hoop_stress", hoop)

    def _find_length(self, length: Floats) -> Floats:
        """Length in the law [mm]."""
        return length if self.keywords["ends"] == "plain" else correct_length(self.braid, length)

    def _find_pressure(self, pressure: Floats) -> Floats:
        """Pressure in the law [MPa]."""
        return pressure

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        acting, at = self._find_pressure(pressure), self._find_length(length)
        pull = super()._pull(acting, at)
        if self.as_printed:
            pull = pull + (self.braid.turns - 1.0) * pull_ideal(self.braid, acting, at)
        return pull

    def _contact_pressure(self, pressure: Floats, length: Floats) -> Floats:
        return super()._contact_pressure(self._find_pressure(pressure), self._find_length(length))

    def _base_lengths(self) -> tuple[float, float]:
        low, high = super()._base_lengths()
        if self.keywords["ends"] == "plain":
            return low, high
        return _find_limits(self.braid, low, high)


class HockingPolynomial(HockingBase):
    """The balance of forces with one polynomial of strain for both stresses.

    ``s_z = sum E_i (l / l0 - 1)**i`` and ``s_h = sum E_i (r / r0 - 1)**i``, up to the fourth power;
    the survey does not give how many the paper has. With the first alone it is a linear elastic
    bladder, the model kothera-balance but for the pressure on the wall and the hoop strain.
    """

    card = Card(
        name="hocking-1",
        title="Balance of forces, polynomial stress",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.36)",
        status="fitted",
        parameters=MODULI,
        choices=(_ENDS,),
        uses=WALL_FIELDS,
        errata=(_TURNS,),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + \frac{V_b}{l} \sum_i E_i \left("
        r"\frac{l}{l_0} - 1\right)^i - \frac{t l^2}{2 \pi N^2 r} \sum_i E_i \left("
        r"\frac{r}{r_0} - 1\right)^i",
        latex_printed=rf"F = {_PRINTED} + \frac{{V_b}}{{l}} \sum_i E_i \left("
        r"\frac{l}{l_0} - 1\right)^i - \frac{t l^2}{2 \pi N^2 r} \sum_i E_i \left("
        r"\frac{r}{r_0} - 1\right)^i",
    )

    _stresses = StrainStress._stresses


class HockingFriction(HockingPolynomial):
    """The same with a dead band, rounded ends, and friction in proportion to the pull.

    The pressure that acts is ``P - P_c``, none below the dead band. Friction is ``mu(P)`` times the
    size of the pull, and against the motion; as printed it is ``mu(P)`` times the pull, which helps
    the motion where the muscle pushes. How ``mu`` depends on the pressure is in the paper only:
    the law `friction`, in [0, 1], without which there is none.
    """

    card = Card(
        name="hocking-2",
        title="Polynomial stress, dead band, rounded ends, friction",
        authors="Hocking, Wereley",
        reference=_HOCKING,
        equation="(2.37)",
        status="fitted",
        parameters=(
            *MODULI,
            Parameter(
                "dead_band_pressure [MPa]",
                "pressure below which the muscle does not contract",
                (0.0, 1e4),
                source="measured",
                default=0.0,
                neutral=0.0,
            ),
        ),
        choices=(Choice(name=_ENDS.name, what=_ENDS.what, words=_ENDS.words[::-1]),),
        laws=(
            Law(
                "friction",
                ("pressure [MPa]",),
                "friction over pull",
                "Hocking and Wereley (2012)",
                required=False,
            ),
        ),
        uses=WALL_FIELDS,
        errata=(
            _TURNS,
            "The sign of friction is printed twice, as +- and as sgn(v).",
            "Printed friction is in proportion to the pull with its sign, and helps the motion "
            "where that is negative: its size is taken.",
            "A sheath with rounded ends is longer, not shorter, than the muscle by the amount of "
            "the correction; the length is corrected as in the survey.",
        ),
        latex=r"F = F_1 \mp \mu(P) |F_1|, \quad F_1 = F_{hocking-1}(P - P_c, l_c), \quad "
        r"l_c = l - 2 \left(\frac{\pi}{2} - 1\right) (r - r_0)",
        latex_printed=r"F = F_1 \pm \mu_f F_1 \, \mathrm{sgn}(v), \quad "
        rf"F_1 = {_PRINTED} + \dots",
        missing="how the coefficient of friction depends on the pressure: Hocking and Wereley "
        "(2012). Only friction needs it.",
    )

    def dead_band(self) -> float:
        """Return the pressure below which the muscle does not contract [MPa]."""
        return self.parameters["dead_band_pressure"]

    def _find_pressure(self, pressure: Floats) -> Floats:
        return np.asanyarray(np.maximum(pressure - self.dead_band(), 0.0))

    def _friction(self, pressure: Floats, length: Floats) -> Floats:
        if "friction" not in self.keywords:
            return np.zeros(pressure.shape)
        share = self._call("friction", pressure)
        check_range("answer of friction", share, 0.0, 1.0)
        pull = self._pull(pressure, length)
        return np.asanyarray(share * (pull if self.as_printed else np.abs(pull)))


class PressureStiffening(StrainStress):
    """The balance of forces with a polynomial stress that grows with the pressure.

    ``s = sum (E_iI + E_iS P) e**i`` of the axial strain ``l / l0 - 1`` and of the hoop strain
    ``r / r0 - 1``, up to the fourth power; the strains are positive where the wall is stretched,
    while the survey's ``epsilon`` is positive in contraction. The pressure acts on the wall as in
    the balance of forces; with a thickness that stays as it is, that term is Chou's.
    """

    card = Card(
        name="pressure-stiffening",
        title="Balance of forces, polynomial stress that grows with pressure",
        authors="unnamed in the survey",
        reference="Reference [25] of the thesis, after Hocking and Wereley (2012)",
        equation="(2.38)",
        status="fitted",
        parameters=(*MODULI, *_SLOPES),
        uses=WALL_FIELDS,
        errata=(
            "Printed with the strain epsilon of contraction; the stress resists it only as a "
            "function of strains that are positive in tension.",
        ),
        latex=r"F = \frac{P}{4 \pi N^2} (3 l^2 - b^2) + P \left(\frac{V_b}{l} - "
        r"\frac{t l^2}{2 \pi r N^2}\right) + \sigma_z \frac{V_b}{l} "
        r"- \frac{\sigma_\theta t l^2}{2 \pi N^2 r}, \quad "
        r"\sigma = \sum_i (E_{iI} + E_{iS} P) e^i",
    )


class StrainFit(CatalogueModel):
    """A pull of Gaylord's form with fitted constants, which the survey solves for the strain.

    ``F = P [kappa1 (1 - eps)**2 + kappa3] + kappa2``; `find_strain` is the closed form of (2.40).
    Gaylord's has ``kappa1 = pi r0**2 q1``, ``kappa3 = -pi r0**2 q2`` and no ``kappa2``.
    `find_radial_strain` is (2.41), of constants that come from measured radii, not forces; only
    their ratios matter, and by default the muscle keeps its volume.
    """

    card = Card(
        name="strain-fit",
        title="Gaylord's form with fitted constants, solved for the strain",
        authors="unnamed in the survey",
        reference="Reference [45] of the thesis",
        equation="(2.40)-(2.41)",
        status="fitted",
        parameters=(
            Parameter(
                "kappa1 [N/MPa]", "pull per pressure and squared stretch", (1e-9, 1e9), linear=True
            ),
            Parameter("kappa2 [N]", "pull without pressure", (-1e9, 1e9), neutral=0.0, linear=True),
            Parameter("kappa3 [N/MPa]", "pull per pressure, negative", (-1e9, 1e9), linear=True),
            Parameter(
                "kappa4",
                "volume per squared strain",
                (-1e9, 1e9),
                source="measured",
                default=0.0,
                neutral=0.0,
            ),
            Parameter(
                "kappa5",
                "volume per strain",
                (-1e9, 1e9),
                source="measured",
                default=0.0,
                neutral=0.0,
            ),
            Parameter(
                "kappa6", "volume at rest", (1e-9, 1e9), source="measured", default=1.0, neutral=1.0
            ),
        ),
        uses=SHAPE_FIELDS,
        latex=r"\epsilon = 1 - \sqrt{\frac{1}{\kappa_1} \left(\frac{F - \kappa_2}{P} - "
        r"\kappa_3\right)}, \quad \epsilon_r = \sqrt{\frac{\kappa_4 \epsilon^2 + \kappa_5 \epsilon "
        r"+ \kappa_6}{\kappa_6 (1 - \epsilon)}} - 1",
    )

    guesses = {
        "kappa1": lambda muscle: measure_ideal(muscle)[1],
        "kappa3": lambda muscle: measure_ideal(muscle)[0] - measure_ideal(muscle)[1],
    }

    def find_strain(self, pressure: ArrayLike, load: ArrayLike = 0.0) -> Floats:
        """Return the strain of contraction under a load, in closed form (2.40).

        Parameters
        ----------
        pressure : array_like
            Pressure [MPa], above 0.
        load : array_like
            Load [N]; broadcast with `pressure`.

        Raises
        ------
        InputError
            If an argument is outside its legal range, or the strain is not a legal contraction's.
        """
        given = self.parameters
        pressures, loads = check_array("pressure", pressure), check_array("load", load)
        check_range("pressure", pressures, 1e-300, PRESSURE_LIMIT, "MPa")
        check_range("load", loads, 0.0, LOAD_LIMIT, "N")
        pressures, loads = broadcast(("pressure", pressures), ("load", loads))
        with np.errstate(all="ignore"):
            square = ((loads - given["kappa2"]) / pressures - given["kappa3"]) / given["kappa1"]
        low, high = (1.0 - x / self.braid.length for x in self.contraction_limits[::-1])
        with add_hint(": pressure and load must leave a legal length"):
            check_range("squared stretch", square, low**2, high**2)
        return np.asanyarray(1.0 - np.sqrt(square))

    def find_radial_strain(self, strain: ArrayLike) -> Floats:
        """Return the strain of the radius ``(r - r0) / r0`` at a strain of contraction (2.41).

        Parameters
        ----------
        strain : array_like
            Strain of contraction, below 1.

        Raises
        ------
        InputError
            If a strain is 1 or above, or the constants have no volume there.
        """
        given, strains = self.parameters, check_array("strain", strain)
        check_range("strain", strains, -1e6, 1.0 - 1e-12)
        volume = (given["kappa4"] * strains + given["kappa5"]) * strains / given["kappa6"] + 1.0
        if volume.size and volume.min() < 0.0:
            index = int(np.argmin(volume))
            raise InputError(
                f"{name_at('strain', strains, index)} is {strains.flat[index]:g}: the volume of "
                f"(2.41) is {volume.flat[index]:g} of that at rest there, it must not be negative"
            )
        return np.asanyarray(np.sqrt(volume / (1.0 - strains)) - 1.0)

    def _pull(self, pressure: Floats, length: Floats) -> Floats:
        given = self.parameters
        stretch = length / self.braid.length
        share = given["kappa1"] * stretch**2 + given["kappa3"]
        return np.asanyarray(pressure * share + given["kappa2"])
