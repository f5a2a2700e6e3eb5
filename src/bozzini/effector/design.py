"""The design of a flexible end-effector: muscles round a backbone, and how stiff it is."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import (
    check_fields,
    check_number,
    choose,
    describe_fields,
    list_quantities,
    quantity,
    show_apart,
)
from ..errors import GeometryError, InputError
from ..muscle import Muscle
from ..muscle import preset as muscle_preset
from ..results import Json, Shown

BEAM_FACTORS = (2.0, 3.0)
"""``k`` of the tip's deflection ``M L**2 / (k EI)`` under an end moment: derived, as printed."""

_SAME_ANGLE_RAD = 1e-9


@dataclass(frozen=True, kw_only=True)
class PlacedMuscle(Shown):
    """A muscle and where it sits round the backbone.

    Parameters
    ----------
    name : str
        What it is called, ``"R"`` for example; no blanks, commas or equals signs.
    muscle : Muscle
        Its design.
    angle : float
        Direction from the backbone to it, from +x about +z [rad].

    Raises
    ------
    InputError
        If a value is not legal.
    """

    name: str
    muscle: Muscle
    angle: float

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or set(self.name) & set(" ,=\t\n"):
            raise InputError(
                f"muscle name is {self.name!r}: it must be a word without blanks, ',' or '='"
            )
        if not isinstance(self.muscle, Muscle):
            raise InputError(
                f"muscle {self.name} is a {type(self.muscle).__name__}: it must be a Muscle"
            )
        name = f"angle of muscle {self.name}"
        angle = check_number(name, self.angle, low=-1e6, high=1e6, unit="rad")
        object.__setattr__(self, "angle", angle)


@dataclass(frozen=True, kw_only=True)
class EffectorDesign(Shown):
    """A bending section: muscles at a fixed distance round a backbone (thesis 4.2-4.4).

    The base is the plane z = 0 and the straight backbone the z axis. The defaults are the numbers
    that reproduce the thesis's Tables 4.1-4.4; of these it prints only the length and 15 segments.

    Parameters
    ----------
    muscles : tuple of PlacedMuscle
        1 to 12, with different names and angles, each as long as the backbone.
    offset : float
        Distance from backbone to muscle, ``a`` [mm]; at least half a segment.
    backbone_length : float
        Length of the backbone between the holders, ``L`` [mm].
    segments : int
        Turns of the outer spring, which hold the muscle at `offset`, 1 to 1000. This is a part of
        the hardware and not a refinement: the deflection depends on it (at a contraction of 6.9 mm
        20.5 mm for 15 turns, 25.9 mm for 50, and 30.1 mm, a circle, without end).
    flexural_rigidity : float
        ``EI`` of the section without catheter [N mm^2]; see `rigidity_from_test`.
    catheter_rigidity : float
        ``EI`` of a catheter inside [N mm^2], which adds.
    holder_length : float
        Straight holder beyond the backbone [mm].
    pressure_limit : float
        Highest legal pressure, at most 10 MPa.
    beam_factor : float
        3 for ``delta = M L**2 / (3 EI)`` as printed, which is the formula of a force ``M / L`` at
        the end; 2 for that of the end moment ``M``, which is what a muscle applies. Both are for
        small deflections.
    holder_diameter, bore_diameter, hole_diameter, coil_diameter : float
        Of the holder, of the catheter's hole in it, of a muscle's hole, and of the coil round which
        the section bends [mm] (thesis 4.2); for `find_conflicts` and `bozzini.fabricate`.

    Raises
    ------
    InputError
        If a value is not legal.
    GeometryError
        If the first segment cannot close at every contraction.
    """

    muscles: tuple[PlacedMuscle, ...]
    offset: float = quantity(
        "length",
        "Distance of the muscles from the axis (measured: 4 mm).",
        default=4.0,
        low=1e-3,
        high=1e3,
        by_name=True,
    )
    backbone_length: float = quantity(
        "length",
        "Length of the backbone and of the muscles (measured: 45 mm).",
        default=45.0,
        low=1e-2,
        high=1e4,
        by_name=True,
    )
    segments: int = quantity(
        help="Turns of the outer spring: part of the design, no mesh (measured: 15).",
        default=15,
        low=1,
        high=1000,
        whole=True,
        by_name=True,
    )
    flexural_rigidity: float = quantity(
        "rigidity",
        "Flexural rigidity without a catheter (measured: 200 N mm^2).",
        default=200.0,
        low=1e-6,
        high=1e12,
        by_name=True,
    )
    catheter_rigidity: float = quantity(
        "rigidity",
        "Flexural rigidity of the catheter; adds (measured: 0).",
        default=0.0,
        low=0.0,
        high=1e12,
        by_name=True,
    )
    holder_length: float = quantity(
        "length",
        "Length of the straight holder beyond the backbone (measured: 10 mm).",
        default=10.0,
        low=0.0,
        high=1e4,
        by_name=True,
    )
    pressure_limit: float = quantity(
        "pressure",
        "Largest pressure of a muscle (measured: 0.827 MPa).",
        default=0.827,
        low=1e-6,
        high=10.0,
        by_name=True,
    )
    beam_factor: float = quantity(
        help="Of the formula M L^2 / (factor E I): 3 as printed, 2 as derived (measured: 2).",
        default=3.0,
        low=2.0,
        high=3.0,
        by_name=True,
    )
    holder_diameter: float = quantity(
        "length",
        "Diameter of the holders (measured: 9 mm).",
        default=9.0,
        low=1e-3,
        high=1e4,
        by_name=True,
    )
    bore_diameter: float = quantity(
        "length",
        "Catheter's hole in them (measured: 3.5 mm).",
        default=3.5,
        low=0.0,
        high=1e4,
        by_name=True,
    )
    hole_diameter: float = quantity(
        "length",
        "A muscle's hole in them (measured: 2 mm).",
        default=2.0,
        low=0.0,
        high=1e4,
        by_name=True,
    )
    coil_diameter: float = quantity(
        "length",
        "Coil in the middle (measured: 4 mm).",
        default=4.0,
        low=0.0,
        high=1e4,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)
        if self.beam_factor not in BEAM_FACTORS:
            raise InputError(
                f"beam factor is {self.beam_factor:g}: it must be 3 (as printed) or 2 (derived)"
            )
        self._check_muscles()
        # With l = L/n and m the muscle's part: the first segment closes if (l^2 - m^2)/(2 a l) < 1.
        least = 0.5 * self.backbone_length / self.segments
        if self.offset < least:
            shown = show_apart(self.offset, least)
            raise GeometryError(
                f"offset is {shown[0]} mm: with {self.segments} segments of a "
                f"{self.backbone_length:g} mm backbone it must be at least {shown[1]} mm, half a "
                "segment, or the first segment cannot close at every contraction"
            )

    def _check_muscles(self) -> None:
        try:
            muscles = tuple(self.muscles)
        except TypeError:
            muscles = ()
        if not 1 <= len(muscles) <= 12 or not all(isinstance(m, PlacedMuscle) for m in muscles):
            raise InputError(f"muscles is {self.muscles!r:.60}: it must be 1 to 12 PlacedMuscle")
        object.__setattr__(self, "muscles", muscles)
        for i, placed in enumerate(muscles):
            for other in muscles[:i]:
                if other.name == placed.name:
                    raise InputError(f"two muscles are called '{placed.name}': names must differ")
                if abs(math.remainder(placed.angle - other.angle, math.tau)) <= _SAME_ANGLE_RAD:
                    raise InputError(
                        f"muscles {other.name} and {placed.name} are both at {placed.angle:g} rad "
                        f"({math.degrees(placed.angle):g} deg): angles must differ"
                    )
            length = placed.muscle.length
            if abs(length - self.backbone_length) > 1e-9 * self.backbone_length:
                shown = show_apart(length, self.backbone_length)
                raise InputError(
                    f"muscle {placed.name} is {shown[0]} mm long: it must be as long as the "
                    f"backbone, {shown[1]} mm (EffectorDesign.resize changes both)"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the muscles, in order."""
        return tuple(placed.name for placed in self.muscles)

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angles of the muscles (m,), in order [rad]."""
        return np.array([placed.angle for placed in self.muscles], dtype=np.float64)

    @property
    def rigidity(self) -> float:
        """``EI`` with the catheter [N mm^2]."""
        return self.flexural_rigidity + self.catheter_rigidity

    @cached_property
    def compliance(self) -> float:
        """Lateral deflection per pull of a muscle, ``a L**2 / (k EI)`` [mm/N]."""
        return self.offset * self.backbone_length**2 / (self.beam_factor * self.rigidity)

    def index(self, name: str) -> int:
        """Return the place of a muscle in the order.

        Raises
        ------
        InputError
            If there is no such muscle.
        """
        return choose("muscle", name, {known: k for k, known in enumerate(self.names)})

    def replace(self, **changes: Any) -> EffectorDesign:
        """Return this design with some fields changed.

        Raises
        ------
        InputError
            If a field is not one of a design's, or a value is not legal.
        """
        names = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in names:
                raise InputError(f"an effector has no field '{name}': its fields are {names}")
        return dataclasses.replace(self, **changes)

    def to_dict(self) -> Json:
        """Return the design as plain values, with units in the names."""
        fields = {k: v for k, v in describe_fields(self).items() if "diameter" not in k}
        return {
            "muscles": {
                placed.name: {"angle_rad": placed.angle, **describe_fields(placed.muscle)}
                for placed in self.muscles
            },
            **fields,
            "compliance_mm_per_N": self.compliance,
        }

    def resize(self, length: float) -> EffectorDesign:
        """Return this design with backbone and muscles of another length [mm], all else the same.

        Raises
        ------
        InputError
            If the length is not legal for the backbone or a muscle.
        """
        muscles = tuple(
            dataclasses.replace(placed, muscle=placed.muscle.replace(length=length))
            for placed in self.muscles
        )
        return self.replace(backbone_length=length, muscles=muscles)


def rigidity_from_test(force: float, deflection: float, *, length: float) -> float:
    """Return ``EI = F L**3 / (3 delta)`` [N mm^2] from a load across the end of a cantilever.

    The thesis's 0.1 N, "approximately" 15 mm and 45 mm give 202.5; its tables were made with 200.

    Parameters
    ----------
    force : float
        Load [N].
    deflection : float
        Lateral deflection where the load acts [mm].
    length : float
        From the clamp to the load [mm].

    Raises
    ------
    InputError
        If an argument is not a positive number, or the rigidity is none that a design may have.
    """
    load = check_number("force", force, low=0.0, high=1e6, low_open=True, unit="N")
    moved = check_number("deflection", deflection, low=0.0, high=1e4, low_open=True, unit="mm")
    arm = check_number("length", length, low=0.0, high=1e4, low_open=True, unit="mm")
    rigidity = load * arm * arm * arm / (3.0 * moved)
    known = list_quantities(EffectorDesign)["flexural_rigidity"]
    return known.check("flexural rigidity of the test", rigidity)


def _place_muscles(name: str, *, beam_factor: float = 3.0) -> EffectorDesign:
    """Return the thesis's section with muscles of a preset."""
    muscle = muscle_preset(name)
    return EffectorDesign(
        muscles=tuple(
            PlacedMuscle(name=name, muscle=muscle, angle=math.radians(degrees))
            for name, degrees in (("R", 307.5), ("G", 219.0), ("B", 75.0))
        ),
        beam_factor=beam_factor,
    )


DEFAULT_PRESET = "measured"
"""The end-effector that commands have by default."""

EFFECTOR_PRESETS: dict[str, EffectorDesign] = {
    "measured": _place_muscles("measured-45", beam_factor=2.0),
    "prototype": _place_muscles("fitted-45"),
    "thesis": _place_muscles("effector-45"),
}
"""End-effectors by name.

- ``measured``: the section of ``prototype`` with the derived beam formula and the muscle
  ``measured-45``, fitted to the deflections that the thesis measured: 20.4, 18.5 and 15.8 mm at
  689.4, 551.6 and 413.6 kPa. It is the default of all commands.
- ``prototype``: the thesis's, with muscles R, G and B at 307.5, 219 and 75 degrees (Fig. 4.9). Its
  offset of 4 mm and its ``EI`` of 200 N mm^2 are those that Tables 4.1-4.4 were computed with. The
  drawn holder leaves no space for a muscle so far out (`find_conflicts`). Its muscle is fitted to
  contractions without load, not to the section: 12.5 mm at 689.4 kPa.
- ``thesis``: the same with the muscle ``effector-45``, for which the thesis's own model meets
  Tables 4.1, 4.3 and 4.4: 20.4 mm at 689.4 kPa (`PRESET_MODELS`, `Effector.from_preset`).
"""

PRESET_MODELS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "thesis": ("thesis", {"load_path": "bulk"}),
}
"""Model and choices of a preset that is made for another model than `EnergyMuscle`."""


def effector_preset(name: str, **overrides: object) -> EffectorDesign:
    """Return an end-effector of `EFFECTOR_PRESETS`, with some fields changed.

    Raises
    ------
    InputError
        If there is no such preset, or a field or its value is not legal.
    """
    return choose("effector preset", name, EFFECTOR_PRESETS).replace(**overrides)
