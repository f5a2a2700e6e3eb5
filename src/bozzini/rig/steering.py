"""Steering: from a stick to set-points, and from measured pressures to the place of the tip."""

from __future__ import annotations

import numpy as np

from ..effector import Effector, Stick, find_stick_scale, steer
from ..results import Json
from .feedforward import Feedforward
from .hysteresis import HysteresisCompensator
from .protocol import SETPOINT_MAX, SetPoint, Telemetry
from .stick import StickSource

DEAD_ZONE_COUNTS = 12.0
"""Travel within which a stick counts as at rest."""


class Steering:
    """The thesis's loop (4.6) as a `Control`: stick, inverse kinematics, set-points; and back.

    Parameters
    ----------
    effector : Effector
        The end-effector, of three muscles in the order of the board's.
    source : StickSource
        The stick.
    feedforward : Feedforward, optional
        Opens the valves for the set-points; without, the board's controller alone does.
    compensator : HysteresisCompensator, optional
        Of muscles with hysteresis.
    """

    def __init__(
        self,
        effector: Effector,
        source: StickSource,
        *,
        feedforward: Feedforward | None = None,
        compensator: HysteresisCompensator | None = None,
    ) -> None:
        self.effector, self.source = effector, source
        self.feedforward, self.compensator = feedforward, compensator
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
        tip = self.effector.forward(measured).lateral_vector
        columns = {
            "target_x_mm": float(found.delivered[0]),
            "target_y_mm": float(found.delivered[1]),
            "tip_x_mm": float(tip[0]),
            "tip_y_mm": float(tip[1]),
        }
        if self.feedforward is not None:
            return self.feedforward.shape(time, pressures, board=board), columns
        return SetPoint(tuple(pressures.tolist())), columns
