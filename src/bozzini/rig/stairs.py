"""Pressure in stairs: what a characterisation asks for, and when a step has settled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..checks import check_fields, quantity
from ..errors import InputError
from ..results import Shown
from .protocol import SETPOINT_MAX


@dataclass(frozen=True, kw_only=True)
class Stairs(Shown):
    """Pressure in equal steps from none to the highest and back, a few times, each step held.

    A step has settled if the pressure measured over the last part of the hold has its mean near
    the set-point and a small deviation.

    Parameters
    ----------
    highest : float
        Gauge pressure of the highest step [MPa].
    steps, repeats : int
        Steps from no pressure to the highest; times up and down.
    hold, window : float
        Time at each step [s], and the share of it, at its end, over which the pressure is averaged.
    tolerance, deviation : float
        Largest difference of the mean from the set-point, and largest standard deviation, of a
        step that has settled [MPa].
    muscle : int
        Which muscle of the rig, 1 to 3; the others stay without pressure.
    load : float
        Tension that the muscle holds [N], the weight that hangs from it.
    specimen : str
        Name of the muscle in the table.

    Raises
    ------
    InputError
        If a value is outside its legal range, or the name has control characters.
    """

    highest: float = quantity(
        "pressure", "Highest step.", default=0.8, low=0.0, low_open=True, high=SETPOINT_MAX
    )
    steps: int = quantity(
        help="Steps from no pressure to the highest.", default=8, low=1, high=1000, whole=True
    )
    repeats: int = quantity(
        help="Times up and down.",
        default=5,
        low=1,
        high=1000,
        whole=True,
        source="thesis 3.2: at least 5 sets",
    )
    hold: float = quantity("time", "Time at each step.", default=2.0, low=0.1, high=3600.0)
    window: float = quantity(
        help="Share of the hold, at its end, over which the pressure is averaged.",
        default=0.25,
        low=0.05,
        high=1.0,
        by_name=True,
    )
    tolerance: float = quantity(
        "pressure",
        "Largest difference of the mean pressure from the set-point.",
        default=6e-3,
        low=1e-4,
        high=0.1,
        source="steady error of the firmware's controller: 5 kPa at most",
        by_name=True,
    )
    deviation: float = quantity(
        "pressure",
        "Largest standard deviation of the pressure.",
        default=4e-3,
        low=1e-4,
        high=0.1,
        source="controller 1 kPa and transducer 1.5 kPa, doubled",
        by_name=True,
    )
    muscle: int = quantity(
        help="Which muscle of the rig, 1 to 3.",
        default=1,
        low=1,
        high=3,
        whole=True,
        option="channel",
    )
    load: float = quantity(
        "force",
        "Tension that the muscle holds.",
        default=0.05,
        low=0.0,
        high=1e3,
        source="thesis 3.2: a weight of 5 gram",
    )
    specimen: str = quantity("text", "Name of the muscle in the table.", default="")

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.specimen.isprintable():
            raise InputError(
                f"specimen is {self.specimen!r}: it must be text without control characters"
            )

    def list_steps(self) -> list[tuple[int, str, float]]:
        """Return the steps in their order: repeat from 1, direction, set-point [MPa]."""
        up = np.linspace(0.0, self.highest, self.steps + 1).tolist()
        once = [("inflating", p) for p in up] + [("deflating", p) for p in up[-2::-1]]
        return [(k, *step) for k in range(1, self.repeats + 1) for step in once]
