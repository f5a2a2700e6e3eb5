"""A miniature pneumatic muscle: its braid, its tube, the design of both, and named designs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    add_hint,
    broadcast,
    check_array,
    check_fields,
    check_range,
    check_word,
    choose,
    legal_range,
    list_quantities,
    quantity,
    show_apart,
    show_value,
)
from ..errors import InputError
from ..results import Shown

if TYPE_CHECKING:
    from .model import MuscleModel

LOCKING_ANGLE = math.atan(math.sqrt(2.0))
"""The angle at which a braid of given strands holds the largest volume [rad]: 54.7356 degrees."""

BRAID_ANGLES = (math.radians(5.0), math.radians(54.0))
"""Angles of a braid at rest that contracts, measured from its axis [rad]: below locking."""

EXTENSILE_ANGLE = math.radians(85.0)
"""Largest legal angle of a braid at rest [rad]: above locking it gets longer under pressure."""

PRESSURE_LIMIT = 20.0
"""Largest legal pressure [MPa], above that of hydraulic muscles: more is likely one in kPa."""


@dataclass(frozen=True, kw_only=True)
class Braid:
    """An inextensible braid at rest; `length` and `radius` fix its strands (thesis eqs 2.1, 2.2).

    A strand of length ``b`` makes ``N`` turns: ``l = b cos(angle)``,
    ``2 pi r N = b sin(angle)``. Whatever the braid does, ``l**2 + (2 pi r N)**2 = b**2``.

    Parameters
    ----------
    length, radius : float
        Length and radius at rest, in [1e-6, 1e6] mm.
    angle : float
        Angle between strands and axis at rest [rad], 5 to 85 degrees.

    Raises
    ------
    InputError
        If a value is outside its legal range; in methods, if a length is not in [0, strand length].
    """

    length: float = quantity("length", low=1e-6, high=1e6)
    radius: float = quantity("length", low=1e-6, high=1e6)
    angle: float = quantity("angle", low=BRAID_ANGLES[0], high=EXTENSILE_ANGLE)

    def __post_init__(self) -> None:
        check_fields(self, "braid ")

    @property
    def strand_length(self) -> float:
        """Length of one strand [mm]; the braid is never longer."""
        return self.length / math.cos(self.angle)

    @property
    def turns(self) -> float:
        """Turns of one strand round the axis."""
        return self.strand_length * math.sin(self.angle) / (2.0 * math.pi * self.radius)

    @property
    def locking_length(self) -> float:
        """Length at the locking angle [mm]: pressure alone shortens the braid no further."""
        return self.strand_length / math.sqrt(3.0)

    @property
    def locking_contraction(self) -> float:
        """How much shorter than at rest the locked braid is [mm]."""
        return self.length - self.locking_length

    def angle_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the angle [rad] of the braid at `length` [mm]."""
        return np.asarray(np.arccos(self._check(length) / self.strand_length), dtype=np.float64)

    def radius_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the radius [mm] of the braid at `length` [mm]."""
        across = np.sqrt(self.strand_length**2 - self._check(length) ** 2)
        return np.asarray(across / (2.0 * math.pi * self.turns), dtype=np.float64)

    def length_at(self, angle: ArrayLike) -> NDArray[np.float64]:
        """Return the length [mm] of the braid at `angle` [rad], which must be in [0, pi/2].

        Raises
        ------
        InputError
            If an angle is outside that range.
        """
        angles = check_array("braid angle", angle)
        check_range("braid angle", angles, 0.0, 0.5 * math.pi, "rad")
        return np.asarray(self.strand_length * np.cos(angles), dtype=np.float64)

    def volume_at(self, length: ArrayLike) -> NDArray[np.float64]:
        """Return the volume inside the braid [mm^3] at `length` [mm]; largest at locking."""
        lengths = self._check(length)
        return np.asarray(math.pi * self.radius_at(lengths) ** 2 * lengths, dtype=np.float64)

    def ideal_force(self, pressure: ArrayLike, length: ArrayLike) -> NDArray[np.float64]:
        """Return Gaylord's force [N]: the pull of a braid round a tube that resists nothing.

        ``F = P b**2 / (4 pi N**2) (3 cos(angle)**2 - 1)``, which is ``-P dV/dl`` (thesis eq. 2.3).

        Parameters
        ----------
        pressure : array_like
            Pressure, in [0, 20] MPa.
        length : array_like
            Length of the braid [mm]; broadcast with `pressure`.

        Raises
        ------
        InputError
            If a pressure is outside its range, or a length is not in [0, strand length].
        """
        pressures = check_array("pressure", pressure)
        check_range("pressure", pressures, 0.0, PRESSURE_LIMIT, "MPa")
        pressures, lengths = broadcast(
            ("pressure", pressures), ("braid length", self._check(length))
        )
        share = 3.0 * (lengths / self.strand_length) ** 2 - 1.0
        scale = self.strand_length**2 / (4.0 * math.pi * self.turns**2)
        return np.asarray(pressures * scale * share, dtype=np.float64)

    def _check(self, length: ArrayLike) -> NDArray[np.float64]:
        lengths = check_array("braid length", length)
        with add_hint(", the length of a strand"):
            check_range("braid length", lengths, 0.0, self.strand_length, "mm")
        return lengths


STRESS_LIMIT = 1e6
"""Largest legal pressure or stress on a tube [MPa], either way: a limit of the arithmetic."""

LEAST_RADIUS_RATIO = 1.0001
"""Smallest legal outer radius over the inner one: the wall's area is the difference of squares."""


@dataclass(frozen=True)
class TubeState:
    """A tube under load: ``u_r = c1 r + c2 / r`` and ``u_z = c3 z`` (thesis eq. 3.2).

    Attributes
    ----------
    tube : Tube
        The tube.
    c1, c2, c3 : (...) ndarray
        Constants of the displacements; `c2` in mm^2, the others without unit.

    Raises
    ------
    InputError
        In methods, if a radius is outside the wall or the shapes do not go together.
    """

    tube: Tube
    c1: NDArray[np.float64]
    c2: NDArray[np.float64]
    c3: NDArray[np.float64]

    def radial_displacement(self, radius: ArrayLike) -> NDArray[np.float64]:
        """Return the outward displacement [mm] of the wall at `radius` [mm]."""
        r, c1, c2, _ = self._place(radius)
        return np.asarray(c1 * r + c2 / r, dtype=np.float64)

    @property
    def elongation(self) -> NDArray[np.float64]:
        """By how much the tube is longer [mm]."""
        return np.asarray(self.c3 * self.tube.length, dtype=np.float64)

    def stresses(
        self, radius: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the radial, hoop and axial stress [MPa] at `radius` [mm], tension positive."""
        r, c1, c2, c3 = self._place(radius)
        first, second = self.tube.lame_constants
        swell = first * (2.0 * c1 + c3)
        bend = c2 / r**2
        radial = swell + 2.0 * second * (c1 - bend)
        hoop = swell + 2.0 * second * (c1 + bend)
        axial = swell + 2.0 * second * c3
        return np.asarray(radial), np.asarray(hoop), np.asarray(axial)

    def _place(self, radius: ArrayLike) -> tuple[NDArray[np.float64], ...]:
        """Radii in the wall and the constants, of one shape."""
        radii = check_array("radius", radius)
        low, high = self.tube.inner_radius, self.tube.outer_radius
        check_range("radius", radii, low, high, "mm", slack=1e-9 * high)
        return broadcast(("radius", radii), ("c1", self.c1), ("c2", self.c2), ("c3", self.c3))


@dataclass(frozen=True, kw_only=True)
class Tube:
    """A thick-walled elastic tube at rest (thesis 3.3.2).

    Parameters
    ----------
    length : float
        Length, in [1e-6, 1e6] mm.
    inner_radius, outer_radius : float
        Radii of the wall, in [1e-6, 1e6] mm; the outer one is 1.0001 times the inner one or more.
    modulus : float
        Young's modulus, in [1e-12, 1e6] MPa.
    poisson_ratio : float
        Poisson's ratio, in [0, 0.499999]: the linear tube needs a finite bulk modulus.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    length: float = quantity("length", low=1e-6, high=1e6)
    inner_radius: float = quantity("length", low=1e-6, high=1e6)
    outer_radius: float = quantity(
        "length", low=lambda tube: LEAST_RADIUS_RATIO * tube.inner_radius, high=1e6
    )
    modulus: float = quantity("pressure", low=1e-12, high=1e6)
    poisson_ratio: float = quantity(low=0.0, high=0.499999, default=0.499, label="Poisson's ratio")

    def __post_init__(self) -> None:
        check_fields(self, "tube ")

    @property
    def lame_constants(self) -> tuple[float, float]:
        """Lamé's first constant and the shear modulus [MPa]."""
        ratio = self.poisson_ratio
        first = self.modulus * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
        return first, self.modulus / (2.0 * (1.0 + ratio))

    @property
    def wall_area(self) -> float:
        """Area of the wall's cross-section [mm^2]."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2)

    @property
    def bore_share(self) -> float:
        """Area of the bore over the area of the wall."""
        return self.inner_radius**2 / (self.outer_radius**2 - self.inner_radius**2)

    def deform(
        self,
        inner_pressure: ArrayLike,
        *,
        outer_pressure: ArrayLike = 0.0,
        end_stress: ArrayLike | None = None,
    ) -> TubeState:
        """Return the tube under pressure.

        The constants are derived here from ``s_rr(inner) = -P_i``, ``s_rr(outer) = -P_o``,
        ``s_zz = end_stress``. The thesis's (3.3) prints ``+P_o`` in ``c1``, which fails these
        conditions; its ``c2`` and ``c3`` agree with ours.

        Parameters
        ----------
        inner_pressure : array_like
            Pressure in the bore [MPa].
        outer_pressure : array_like
            Pressure on the outside [MPa].
        end_stress : array_like, optional
            Axial stress in the wall [MPa], tension positive; None means closed ends under the
            inner pressure.

        Raises
        ------
        InputError
            If a pressure or stress is not in [-1e6, 1e6] MPa, or the shapes do not go together.
        """
        first, second = self.lame_constants
        bore = self.bore_share
        inner, outer = (
            _take_stress(name, values)
            for name, values in (
                ("inner pressure", inner_pressure),
                ("outer pressure", outer_pressure),
            )
        )
        axial = inner * bore if end_stress is None else _take_stress("end stress", end_stress)
        inner, outer, axial = broadcast(
            ("inner pressure", inner), ("outer pressure", outer), ("end stress", axial)
        )
        across = inner * bore - outer * (bore + 1.0)
        bulk = second * (3.0 * first + 2.0 * second)
        c1 = ((first + 2.0 * second) * across - first * axial) / (2.0 * bulk)
        c2 = (inner - outer) * bore * self.outer_radius**2 / (2.0 * second)
        c3 = ((first + second) * axial - first * across) / bulk
        return TubeState(self, np.asarray(c1), np.asarray(c2), np.asarray(c3))


def _take_stress(name: str, values: ArrayLike) -> NDArray[np.float64]:
    stresses = check_array(name, values)
    check_range(name, stresses, -STRESS_LIMIT, STRESS_LIMIT, "MPa")
    return stresses


class _Given:
    """A field that is unset until it is given: to read it before is an `InputError`.

    It is the default of the dataclass's field, which makes it a descriptor of the class. A value
    that is given stands in the instance, where Python finds it first.
    """

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, muscle: Muscle | None, owner: type) -> object:
        if muscle is None:
            return self
        raise InputError(f"the muscle has no {self.name.replace('_', ' ')}: give it")


def _limit_by_bore(muscle: Muscle) -> float:
    """Return half the inner radius, or of the outer one while that is unset [mm]."""
    return 0.5 * vars(muscle).get("inner_radius", muscle.outer_radius)  # type: ignore[no-any-return]


def _limit_strand(muscle: Muscle) -> float:
    """Return the radius at which the strands lie side by side [mm].

    Those of one family are ``4 pi r cos(angle) / strands`` apart.
    """
    known = vars(muscle)
    cosine = np.cos(known.get("braid_angle", 0.0))
    return 2.0 * math.pi * muscle.braid_radius * cosine / known.get("strands", 2)  # type: ignore[no-any-return]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Muscle(Shown):
    """A pneumatic muscle at rest (thesis 3.2), in mm, MPa and rad.

    Length and outer radius are always there. What else is not known may be left unset: to read it
    is an error then, and a model that needs it refuses the muscle. Gap, ends, friction and the
    Mooney ratio have neutral defaults instead, and Poisson's ratio that of rubber.

    Parameters
    ----------
    length : float
        Free length between the fittings, in [0.001, 10000] mm.
    outer_radius, inner_radius : float
        Radii of the tube [mm]; the inner one is 0.05 to 0.99 of the outer one, and may be unset.
    braid_angle : float, optional
        Angle between strands and axis at rest [rad], 5 to 85 degrees. Above the locking angle of
        54.7 degrees the muscle gets longer under pressure, and pushes: few models hold there.
    gap : float
        Gap between tube and braid [mm], at most half the inner radius.
    strands : int, optional
        Strands of the braid, both ways together.
    strand_radius : float, optional
        Radius of a strand [mm], so that all strands fit round the braid.
    end_length : float
        Length of each conical end, ``phi`` [mm]; used by `ThesisMuscle` only.
    dead_length : float
        Length that does not contract, both ends together [mm]; not used by `ThesisMuscle`.
    modulus : float, optional
        Young's modulus of the tube, in [1e-9, 1000] MPa.
    poisson_ratio : float
        Poisson's ratio of the tube; `EnergyMuscle` takes the wall as incompressible instead.
    strand_modulus : float, optional
        Young's modulus of a strand [MPa].
    mooney_ratio : float
        ``C01 / (C10 + C01)`` of the wall's strain energy, in [0, 0.5]; 0 is neo-Hookean.
    friction_length : float
        Friction at the crossings, coefficient times arm [mm]; at most a quarter of the braid's
        radius and half the inner radius; 0 for none.

    Raises
    ------
    InputError
        If a value is outside its `legal_range`; where a field is read that is unset.
    """

    length: float = quantity(
        "length", "Free length between the fittings.", low=1e-3, high=1e4, by_name=True
    )
    outer_radius: float = quantity(
        "length", "Outer radius of the tube.", low=1e-3, high=1e3, by_name=True
    )
    inner_radius: float = quantity(
        "length",
        "Inner radius of the tube.",
        default=_Given(),
        low=lambda muscle: 0.05 * muscle.outer_radius,
        high=lambda muscle: 0.99 * muscle.outer_radius,
        by_name=True,
    )
    braid_angle: float = quantity(
        "angle",
        "Angle between strands and axis at rest.",
        default=_Given(),
        scale=0.03,
        low=BRAID_ANGLES[0],
        high=EXTENSILE_ANGLE,
        by_name=True,
    )
    # Across a wider gap the tube would balloon before it meets the braid.
    gap: float = quantity(
        "length",
        "Gap between tube and braid.",
        default=0.0,
        scale=0.02,
        low=0.0,
        high=_limit_by_bore,
        by_name=True,
    )
    strands: int = quantity(
        help="Number of strands.", default=_Given(), low=2, high=10_000, whole=True, by_name=True
    )
    strand_radius: float = quantity(
        "length",
        "Radius of a strand.",
        default=_Given(),
        low=1e-6,
        high=_limit_strand,
        by_name=True,
    )
    end_length: float = quantity(
        "length",
        "Length of each conical end (thesis).",
        default=0.0,
        low=0.0,
        high=lambda muscle: 0.499 * muscle.length,
        by_name=True,
    )
    dead_length: float = quantity(
        "length",
        "Length that does not contract (energy).",
        default=0.0,
        scale=2.0,
        low=0.0,
        high=lambda muscle: 0.99 * muscle.length,
        by_name=True,
    )
    modulus: float = quantity(
        "pressure",
        "Young's modulus of the tube.",
        default=_Given(),
        scale=0.1,
        low=1e-9,
        high=1e3,
        by_name=True,
    )
    poisson_ratio: float = quantity(
        help="Poisson's ratio of the tube (thesis).",
        default=0.499,
        scale=0.01,
        low=0.0,
        high=0.499999,
        by_name=True,
    )
    strand_modulus: float = quantity(
        "pressure",
        "Young's modulus of a strand (thesis).",
        default=_Given(),
        low=1e-9,
        high=1e6,
        by_name=True,
    )
    # Above 0.5 an inflated free tube gets shorter.
    mooney_ratio: float = quantity(
        help="C01 / (C10 + C01) of the wall (energy).",
        default=0.0,
        scale=0.3,
        low=0.0,
        high=0.5,
        by_name=True,
    )
    # With more friction a thick tube has several contractions at one load.
    friction_length: float = quantity(
        "length",
        "Friction at the crossings (energy).",
        default=0.0,
        scale=0.02,
        low=0.0,
        high=lambda muscle: np.minimum(0.25 * muscle.braid_radius, _limit_by_bore(muscle)),
        by_name=True,
    )

    def __post_init__(self) -> None:
        known = vars(self)
        for name in _STARTS:
            if known[name] is None or isinstance(known[name], _Given):
                del known[name]
        check_fields(self, "muscle ", skip=self.unset)

    def __eq__(self, other: object) -> bool:
        return self.given == other.given if isinstance(other, Muscle) else NotImplemented

    def __hash__(self) -> int:
        return hash(tuple(self.given.items()))

    def __repr__(self) -> str:
        return f"Muscle({', '.join(f'{name}={value!r}' for name, value in self.given.items())})"

    @property
    def given(self) -> dict[str, float]:
        """The fields that are set, by name."""
        known = vars(self)
        return {name: known[name] for name in list_quantities(Muscle) if name in known}

    @property
    def unset(self) -> tuple[str, ...]:
        """The names of the fields that are not set."""
        known = vars(self)
        return tuple(name for name in _STARTS if name not in known)

    def legal_range(self, name: str) -> tuple[float, float]:
        """Return the smallest and largest legal value of a field, the others being as they are.

        Raises
        ------
        InputError
            If `name` is not a field that takes any number.
        """
        names = [known for known in list_quantities(Muscle) if known != "strands"]
        return legal_range(self, check_word("field", name, names))

    @property
    def braid_radius(self) -> float:
        """Radius of the braid at rest [mm]."""
        return self.outer_radius + self.gap

    @property
    def active_length(self) -> float:
        """Length that contracts [mm]."""
        return self.length - self.dead_length

    @cached_property
    def braid(self) -> Braid:
        """The braid at rest, over the whole length."""
        return Braid(length=self.length, radius=self.braid_radius, angle=self.braid_angle)

    @cached_property
    def tube(self) -> Tube:
        """The tube at rest, over the whole length."""
        return Tube(
            length=self.length,
            inner_radius=self.inner_radius,
            outer_radius=self.outer_radius,
            modulus=self.modulus,
            poisson_ratio=self.poisson_ratio,
        )

    def replace(self, **changes: Any) -> Muscle:
        """Return this muscle with some fields changed.

        Raises
        ------
        InputError
            If a field is not one of a muscle's, or a value is outside its legal range.
        """
        names = list(list_quantities(Muscle))
        for name in changes:
            if name not in names:
                raise InputError(f"a muscle has no field '{name}': its fields are {names}")
        return Muscle(**{**self.given, **changes})

    def fill(self, names: Iterable[str] | None = None) -> Muscle:
        """Return this muscle with typical values in fields that are unset: where a fit may start.

        They are of McKibben muscles of 10 to 40 mm: a wall of a fifth of the radius, strands at 25
        degrees that cover half the braid, rubber of 1 MPa, polyamide of 3 GPa.

        Parameters
        ----------
        names : iterable of str, optional
            Fields to set where they are unset; by default all of them.
        """
        wanted = self.unset if names is None else tuple(names)
        muscle = self
        for name in self.unset:  # in the order of the fields, each legal beside those before it
            if name in wanted:
                muscle = muscle.replace(**{name: _STARTS[name](muscle)})
        return muscle


_STARTS: Mapping[str, Callable[[Muscle], float]] = {
    "inner_radius": lambda muscle: 0.8 * muscle.outer_radius,
    "braid_angle": lambda muscle: math.radians(25.0),
    "strands": lambda muscle: 100,
    "strand_radius": lambda muscle: 0.5 * _limit_strand(muscle),
    "modulus": lambda muscle: 1.0,
    "strand_modulus": lambda muscle: 3000.0,
}


@dataclass(frozen=True)
class Preset:
    """A muscle by name, and where its numbers come from. What no source gives is unset."""

    muscle: Muscle
    source: str


_MINIATURE = Muscle(
    length=45.0,
    outer_radius=0.55,
    inner_radius=0.25,
    braid_angle=math.radians(36.0),
    gap=0.04,
    strands=30,
    strand_radius=0.04,
    end_length=5.0,
    modulus=0.35,
    strand_modulus=3000.0,
)
_CAPTION = "the thesis, caption of Fig. {}; its section 3.2 has strands of about 0.05 mm radius"
_CHAPTER_4 = (
    "the thesis, chapter 4, which does not give the tube: with 1.5 mm outer diameter ThesisMuscle "
    "reproduces its contractions; the rest as in the captions of chapter 3"
)
_FESTO = (
    "Festo, data sheet of the Fluidic Muscle DMSP/MAS: nominal diameter {} mm, sold in lengths of "
    "40 to 9000 mm: give yours. The nominal diameter is that of the bore and stands here for the "
    "tube; braid angle, wall and material are not published: fit or measure them"
)
PRESETS: dict[str, Preset] = {
    "thesis-40": Preset(_MINIATURE.replace(length=40.0), _CAPTION.format("3.11")),
    "thesis-45": Preset(_MINIATURE, _CAPTION.format("3.16")),
    "thesis-60": Preset(_MINIATURE.replace(length=60.0), _CAPTION.format("3.12")),
    "effector-45": Preset(_MINIATURE.replace(outer_radius=0.75), _CHAPTER_4),
    "fitted-45": Preset(
        _MINIATURE.replace(outer_radius=0.75, modulus=0.56, dead_length=11.7),
        "as effector-45; modulus and dead length fitted, so that EnergyMuscle meets the three "
        "contractions without load of chapter 4",
    ),
    "measured-45": Preset(
        _MINIATURE.replace(
            outer_radius=0.75, modulus=0.152, braid_angle=math.radians(35.05), dead_length=10.0
        ),
        "as effector-45, with the dead ends of 5 mm that the captions have; modulus, braid angle "
        "fitted, so that EnergyMuscle on a section meets the deflections of Tables 4.1, 4.3, 4.4",
    ),
    **{
        f"festo-{bore}": Preset(Muscle(length=250.0, outer_radius=0.5 * bore), _FESTO.format(bore))
        for bore in (10, 20, 40)
    },
}
"""Muscles by name, each with its source; `preset` returns one of them."""


def check_muscle(muscle: object, model: MuscleModel | None = None) -> None:
    """Raise `InputError` if a model cannot be made of this, lacks a field, or does not contract."""
    if not isinstance(muscle, Muscle):
        hint = f", such as preset({muscle!r})" if isinstance(muscle, str) else ""
        raise InputError(f"muscle is {show_value(muscle)}: it must be a Muscle{hint}")
    if model is None:
        return
    missing = [name.replace("_", "-") for name in muscle.unset if name not in model.unused]
    if missing:
        fitted = ",".join(name for name in missing if name != "strands")
        raise InputError(
            f"the model {model.name} needs the muscle's {', '.join(missing)}: give "
            f"{' '.join(f'--{name}' for name in missing)}, or write it into the muscle's file"
            + (f", or fit it: add {fitted} to the names of --free" if fitted else "")
        )
    if "braid_angle" in model.unused or model.extensile or muscle.braid_angle <= BRAID_ANGLES[1]:
        return
    angle, *ends = (math.degrees(value) for value in (muscle.braid_angle, *BRAID_ANGLES))
    shown = show_apart(angle, ends[0], ends[1])
    raise InputError(
        f"muscle braid angle is {shown[0]} deg: it must lie in [{shown[1]}, {shown[2]}] deg for "
        f"the model {model.name}, which does not hold for a muscle that gets longer"
    )


def preset(name: str, **overrides: object) -> Muscle:
    """Return a muscle of `PRESETS`, with some fields changed.

    Raises
    ------
    InputError
        If there is no such preset, or a field or its value is not legal.
    """
    return choose("muscle preset", name, PRESETS).muscle.replace(**overrides)
