"""How far a robot's model may be wrong, and what may push it: all that an estimate looks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checks import check_fields, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Shown


@dataclass(frozen=True, kw_only=True)
class ModelError(Shown):
    """How far the elastic model may be wrong, as standard deviations, and how long it is.

    Parameters
    ----------
    curvature, twist : float
        Of the curvature that the model does not have, and of the twist [rad/mm].
    reach : float
        Length over which that curvature is alike [mm].
    stiffness : float
        Of the stiffness of each section, as a share.
    zero : float
        Of what is added to the displacement of each tendon [mm].
    pull : float
        Of what is added to each tension where tensions are commanded [N].
    coupling : float
        Of how far each tendon acts on each, itself too, as a share of its displacement.
    position, rotation : float
        Of the base, along and about each axis [mm], [rad].
    memory : float, optional
        Time after which curvature, zeros, and the position of the base have forgotten 63 % of what
        they were [s]; never unless given. The others are constants.
    drift : float
        How far constants move in a second, by their standard deviation.
    """

    curvature: float = quantity(
        "curvature", "Unknown curvature.", low=0.0, default=5e-4, by_name=True
    )
    twist: float = quantity("curvature", "Unknown twist.", low=0.0, default=1e-4, by_name=True)
    reach: float = quantity(
        "length",
        "Over which it is alike; a segment at least.",
        low=1e-3,
        default=50.0,
        by_name=True,
    )
    stiffness: float = quantity(
        help="Of a section, as a share.", low=0.0, default=0.05, high=2.0, by_name=True
    )
    zero: float = quantity("length", "Of a tendon's zero.", low=0.0, default=0.2, by_name=True)
    pull: float = quantity("force", "Of a commanded tension.", low=0.0, default=0.1, by_name=True)
    coupling: float = quantity(help="Of a tendon on another.", low=0.0, default=0.0, by_name=True)
    position: float = quantity("length", "Of the base.", low=0.0, default=0.0, by_name=True)
    rotation: float = quantity("angle", "Of the base.", low=0.0, default=0.0, by_name=True)
    memory: float | None = quantity(
        "time",
        "After which errors are forgotten (default: never).",
        low=0.0,
        low_open=True,
        default=None,
        by_name=True,
    )
    drift: float = quantity(
        help="Of constants, in a second.", low=0.0, high=1e3, default=0.0, by_name=True
    )

    def __post_init__(self) -> None:
        check_fields(self, "model error ")


@dataclass(frozen=True, kw_only=True)
class UnknownLoad:
    """A force on the body that is not known: its size, and maybe its place.

    Parameters
    ----------
    arc_length : float, optional
        Where it acts [mm]; unknown unless given.
    force : float
        Standard deviation of the force along each axis across the body [N].
    along : float
        Of the force along the body [N].
    moment : float
        Of the moment about each axis [N mm].
    memory : float
        Time after which force and place have forgotten 63 % of what they were [s]; 0 is a load
        that is new at each moment.
    """

    arc_length: float | None = quantity("length", "Where it acts.", low=0.0, default=None)
    force: float = quantity("force", "Across the body.", low=0.0, default=1.0)
    along: float = quantity("force", "Along the body.", low=0.0, default=0.0)
    moment: float = quantity(help="About each axis [N mm].", low=0.0, default=0.0)
    memory: float = quantity("time", "After which it is forgotten.", low=0.0, default=0.0)

    def __post_init__(self) -> None:
        check_fields(self, "load ", skip=() if self.arc_length is not None else ("arc_length",))
        if not (self.force or self.along or self.moment):
            raise InputError("load has no force and no moment: one must be above 0")

    @property
    def deviations(self) -> Floats:
        """Of force and moment in the body's axes, (6,)."""
        return np.array([self.force, self.force, self.along, *(self.moment,) * 3])
