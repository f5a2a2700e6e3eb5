"""Steering: from a stick to set-points, and from measured pressures to the place of the tip.

Three controllers make set-points of where the tip is wanted, see `make_controller`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks import choose
from ..effector import Effector, Stick, find_stick_scale, steer
from ..effector.files import open_effector
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json
from .choices import CONTROLLERS
from .feedforward import Feedforward
from .hysteresis import HysteresisCompensator, MotionObserver
from .plant import MUSCLES, Chamber, PlantDesign
from .predictive import PredictiveSteering
from .protocol import SETPOINT_MAX, Configuration, SetPoint, Telemetry
from .stick import StickSource

DEAD_ZONE_COUNTS = 12.0
"""Travel within which a stick counts as at rest."""


Controller = Feedforward | PredictiveSteering | None


def make_controller(
    name: str, effector: Effector, board: Configuration, *, period: float
) -> Controller:
    """Return a controller by its name, for one run.

    Parameters
    ----------
    name : {"static", "feedforward", "predictive"}
        The set-points are the pressures of the inverse, and the board does the rest (None); the
        valves are opened by a model of the plant; or the model of the section is looked ahead in.
    effector : Effector
    board : Configuration
    period : float
        Of the host [s].

    Raises
    ------
    InputError
        If there is no such controller, or the muscles have no volume that it needs.
    """
    choose("controller", name, dict.fromkeys(CONTROLLERS))
    if name == "feedforward":
        chambers = [Chamber.from_model(model) for model in effector.models]
        return Feedforward(PlantDesign(), chambers, board, period=period)
    if name == "predictive":
        return PredictiveSteering(effector, board, period=period)
    return None


def find_set_points(
    controller: Controller,
    time: float,
    *,
    place: Floats,
    pressures: ArrayLike,
    board: Telemetry,
) -> SetPoint:
    """Return what a controller sends for a place (2,) [mm], and pressures (3,) of it [MPa]."""
    if isinstance(controller, PredictiveSteering):
        return controller.shape(time, place, board=board)
    setpoints = np.clip(pressures, 0.0, SETPOINT_MAX)
    if controller is not None:
        return controller.shape(time, setpoints, board=board)
    return SetPoint(tuple(setpoints.tolist()))


def open_rig_effector(name: str) -> Effector:
    """Return an end-effector that a rig can have: of a preset, or of a file.

    Raises
    ------
    InputError
        If it has not three muscles, or these have laws of pull and so no volume, stick or pose.
    """
    effector = open_effector(name)
    if effector.pulls is not None:
        raise InputError(
            f"{name} has laws of pull, without the inverse and the volume of its muscles that a "
            "rig needs: give a preset, or a file of 'bozzini effector fit' without --pulls"
        )
    if len(effector.design.muscles) != MUSCLES:
        raise InputError(f"{name} has {len(effector.design.muscles)} muscles: a board has 3")
    return effector


class Steering:
    """The thesis's loop (4.6) as a `Control`: stick, inverse kinematics, set-points; and back.

    Parameters
    ----------
    effector : Effector
        The end-effector, of three muscles in the order of the board's.
    source : StickSource
        The stick.
    controller : Feedforward or PredictiveSteering, optional
        Of `make_controller`; without, the board's own alone follows the inverse.
    compensator : HysteresisCompensator, optional
        Of muscles with hysteresis; without, the tip follows from the plays and the creep of the
        effector's motion, if it has any.
    """

    def __init__(
        self,
        effector: Effector,
        source: StickSource,
        *,
        controller: Controller = None,
        compensator: HysteresisCompensator | None = None,
    ) -> None:
        self.effector, self.source = effector, source
        self.controller, self.compensator = controller, compensator
        self._observer, self._time = MotionObserver(effector.motion), 0.0
        self.stick = Stick(dead_zone=DEAD_ZONE_COUNTS)
        self.limit = effector.design.pressure_limit
        self.scale = find_stick_scale(effector)

    def __call__(self, time: float, board: Telemetry) -> tuple[SetPoint, Json]:
        """Return the set-points, and where the tip is wanted and where it is."""
        raw = self.source.read(time, np.array(board.stick, dtype=np.float64))
        found = steer(self.effector, raw, stick=self.stick, scale=self.scale)
        pressures = np.clip(found.pressures, 0.0, SETPOINT_MAX)
        measured = np.clip(board.pressures, 0.0, self.limit)
        if self.compensator is not None:
            measured = self.compensator.observe(measured)
            pressures = self.compensator.compensate(pressures)
        else:
            acting = self._observer.observe(time - self._time, measured)
            measured, self._time = np.clip(acting, 0.0, self.limit), time
        tip = self.effector.forward(measured).lateral_vector
        columns = {
            "target_x_mm": float(found.delivered[0]),
            "target_y_mm": float(found.delivered[1]),
            "tip_x_mm": float(tip[0]),
            "tip_y_mm": float(tip[1]),
        }
        sent = find_set_points(
            self.controller, time, place=found.delivered, pressures=pressures, board=board
        )
        return sent, columns
