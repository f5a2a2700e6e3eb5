"""Options of walls, robots and drives; importing them needs no extra."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from ..checks import check_fields, quantity
from ..results import Shown

COLONOSCOPE_RIGIDITY = 26_000.0
"""Least flexural rigidity along a colonoscope (Olympus CF-140S) at room temperature; the largest is
40,000 [N mm^2], and at 37 degrees C both are 17 % less. Hellier, Albermani, Evans, de Visser, Adam,
Passenger: Flexural and torsional rigidity of colonoscopes at room and body temperatures, Proc.
Inst. Mech. Eng. H 225 (2011), 389-399."""

COLONOSCOPE_TORSION = 435_000.0
"""Mean torsional rigidity along the same colonoscope at 0.86 N m, anticlockwise: 76 N cm^2/deg,
68 to 88 along it; clockwise 10 % off, at 37 degrees C 7 % less (Hellier et al.) [N mm^2]."""

WallKind = Literal["prism", "penalty"]
DriveName = Literal["plan", "tractrix", "tendons", "push"]
DRIVES: tuple[DriveName, ...] = get_args(DriveName)


@dataclass(frozen=True, kw_only=True)
class WallOptions(Shown):
    """What the wall of a lumen is in a simulation.

    Parameters
    ----------
    kind : {"penalty", "prism"}
        The lumen's own signed distance, or a convex body behind each triangle.
    stiffness : float
        Force of the wall by depth, at each place of contact [N/mm].
    damping : float
        Force of the wall by the velocity of its place, over its stiffness [s].
    friction : float
        Coefficient of Coulomb friction.
    faces : int
        Triangles of a wall of prisms, about.
    thickness : float
        Largest thickness of a prism [mm].
    mouth : float
        Faces this near to the introducer's axis are cut [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    kind: WallKind = quantity(
        "text", "What the wall is made of.", default="penalty", words=("penalty", "prism"),
        option="wall",
    )  # fmt: skip
    stiffness: float = quantity(
        "stiffness", "Of the wall, at each place of contact.", default=0.3, low=1e-4, high=1e4
    )
    damping: float = quantity(
        "time", "Of the wall, over its stiffness.", default=0.005, low=0.0, high=10.0,
        option="wall-damping",
        by_name=True,
    )  # fmt: skip
    friction: float = quantity(
        "dimensionless", "Coefficient of friction on the wall.", default=0.1, low=0.0, high=2.0
    )
    faces: int = quantity(
        help="Triangles of a wall of prisms.",
        whole=True,
        default=4000,
        low=100,
        high=100_000,
        by_name=True,
    )
    thickness: float = quantity(
        "length", "Largest thickness of a prism.", default=3.0, low=0.1, high=50.0, by_name=True
    )
    mouth: float = quantity(
        "length",
        "Faces this near to the introducer's axis are cut.",
        default=9.0,
        low=0.0,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def compliance(self) -> float:
        """Depth by force at each place of contact [mm/N]."""
        return 1.0 / self.stiffness


@dataclass(frozen=True, kw_only=True)
class ScopeOptions(Shown):
    """Gains of the planned chain, and what a pushed scope is; all assumed unless cited.

    Parameters
    ----------
    servo : float
        Gain of each joint of the planned chain [N mm/rad].
    rigidity : float
        Flexural rigidity of the pushed scope's shaft [N mm^2]; see `COLONOSCOPE_RIGIDITY`.
    torsion : float
        Torsional rigidity of the shaft in a manoeuvre [N mm^2]; see `COLONOSCOPE_TORSION`.
    tip_length : float
        Length at the tip that is bent by the operator [mm].
    tip_bend : float
        How far the tip bends at most [rad].
    tip_rate : float
        How fast it bends at most [rad/s].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    servo: float = quantity("moment", "Gain of each joint of the planned chain, per rad.",
                            default=2000.0, low=1e-3, high=1e6, by_name=True)  # fmt: skip
    rigidity: float = quantity(
        "rigidity", "Bending stiffness of the pushed scope's shaft.", default=COLONOSCOPE_RIGIDITY,
        low=1.0, high=1e9,
    )  # fmt: skip
    torsion: float = quantity(
        "rigidity", "Torsional stiffness of its shaft, in a manoeuvre.",
        default=COLONOSCOPE_TORSION, low=1.0, high=1e9,
    )  # fmt: skip
    tip_length: float = quantity(
        "length",
        "Length at the tip of the pushed scope that is steered.",
        default=60.0,
        low=1.0,
        by_name=True,
    )
    tip_bend: float = quantity(
        "angle",
        "How far it bends at most.",
        default=math.radians(180.0),
        low=0.0,
        high=6.0,
        by_name=True,
    )
    tip_rate: float = quantity(
        "dimensionless",
        "How fast it bends at most, in rad/s.",
        default=1.0,
        low=0.0,
        high=100.0,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class ExecuteOptions(Shown):
    """How a motion is driven.

    Parameters
    ----------
    drive : {"plan", "tractrix", "tendons", "push"}
        The planned chain; the same chain dragged behind its head without regard for walls; a
        tendon robot along the plan; or a scope that is pushed from outside.
    speed : float
        Of the head, or of the pushed base [mm/s].
    step : float
        Of the integration [s].
    seed : int
        Of what is drawn at random.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    drive: DriveName = quantity(
        "text", "The planned chain, the same dragged by its head, a tendon robot, a pushed scope.",
        default="plan", words=DRIVES,
    )  # fmt: skip
    speed: float = quantity(
        "speed", "Of the head, or of the pushed base.", default=20.0, low=0.1, high=1000.0
    )
    step: float = quantity(
        "time", "Step of the integration.", default=0.002, low=1e-5, high=0.02
    )  # fmt: skip
    seed: int = quantity(help="Of what is drawn at random.", whole=True, default=0, low=0)

    def __post_init__(self) -> None:
        check_fields(self)
