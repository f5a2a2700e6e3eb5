"""Model-based feed-forward: valve openings for a rate of pressure, from a model of the plant."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number
from .plant import MUSCLES, Chamber, PlantDesign
from .pneumatics import ATMOSPHERE
from .protocol import FEEDFORWARD_COUNTS, Configuration, SetPoint, Telemetry

Floats = NDArray[np.float64]

USED_SHARE = 0.9
"""Of the fastest rate that a valve gives; the rest is left to the board's controller."""
APPROACH_TIME = 0.01
"""Within this time of their end set-points approach it exponentially [s]."""
LINE_DELAY = 4e-3
"""Between a measurement and the opening that answers it [s]: frames both ways, two ticks."""
CORRECTION_TIME = 0.05
"""Time within which an error between set-point and pressure is to be made up for [s]."""
SMALLEST_FLOW = 1e-6
"""pV flow [MPa mm^3/s] below which a valve counts as unable to move the pressure."""


class Feedforward:
    """Shapes set-points into ramps and adds the valve openings that the ramps need.

    The flow that a rate of pressure needs follows from the volumes of line and muscle, and the
    change of the muscle's volume; the opening from the flow through an ISO 6358 orifice between
    the pressures at hand; the duty from the valve's dead zone, play and lag. What the model does
    not know the board's own controller corrects.

    Parameters
    ----------
    design : PlantDesign
        The model of the plant.
    chambers : sequence of 3 Chamber
        The model of the muscles.
    board : Configuration
        The board's limits.
    rate : float, optional
        Largest rate of the set-points [MPa/s], at most the board's slew rate, which is the default.

    Raises
    ------
    InputError
        If the rate is not legal.
    """

    def __init__(
        self,
        design: PlantDesign,
        chambers: Sequence[Chamber],
        board: Configuration,
        *,
        rate: float | None = None,
    ) -> None:
        most = board.slew_rate
        given = most if rate is None else rate
        self.rate = check_number("rate", given, low=0.0, low_open=True, high=most, unit="MPa/s")
        self.design, self.chambers = design, tuple(chambers)
        self._dead = board.error_dead
        self._jump = board.jump / board.pwm_counts
        self._reference: Floats | None = None
        self._time = 0.0
        self.delay = design.valve_lag + design.sensor_lag + LINE_DELAY
        self._past: deque[tuple[float, Floats]] = deque()

    def shape(self, time: float, wanted: ArrayLike, board: Telemetry) -> SetPoint:
        """Return the set-points of a period and the feed-forward for them.

        Parameters
        ----------
        time : float
            Time of the run [s]; it must grow from call to call.
        wanted : (3,) array_like
            Pressures to go to [MPa].
        board : Telemetry
            The last telemetry.
        """
        target = check_array("wanted", wanted)
        if self._reference is None:
            self._reference, self._time = np.maximum(board.pressures, 0.0), time
            self._past.append((time, self._reference))
        span = max(time - self._time, 1e-4)
        fastest = self.find_rates(self._reference, board.reservoir_pressure)
        limits = np.minimum(USED_SHARE * fastest, self.rate)
        rates = np.clip(
            (target - self._reference) / max(span, APPROACH_TIME), -limits[1], limits[0]
        )
        error = self._recall(time - self.delay) - np.array(board.pressures)
        rates_asked = rates + np.where(np.abs(error) > self._dead, error / CORRECTION_TIME, 0.0)
        shares = self._find_shares(rates_asked / np.where(rates_asked >= 0.0, *fastest))
        self._reference = self._reference + rates * span
        self._time = time
        self._past.append((time, self._reference))
        return SetPoint(tuple(self._reference.tolist()), tuple(shares.tolist()))

    def _recall(self, time: float) -> Floats:
        """Return the reference at a past time [s], or the oldest that is kept."""
        while len(self._past) > 1 and self._past[1][0] <= time:
            self._past.popleft()
        return self._past[0][1]

    def find_rates(self, pressures: ArrayLike, supply: float) -> Floats:
        """Return how fast pressures rise and fall through a valve that is fully open.

        Parameters
        ----------
        pressures : (3,) array_like
            Gauge pressures [MPa].
        supply : float
            Gauge pressure of the reservoir [MPa].

        Returns
        -------
        (2, 3) ndarray
            Rates of rise and of fall, both positive [MPa/s].
        """
        design = self.design
        at = check_array("pressures", pressures)
        inside = at + ATMOSPHERE
        volume, slope = np.array(
            [_look_up(chamber, value) for chamber, value in zip(self.chambers, at, strict=True)]
        ).T
        capacity = (design.line_volume + volume) / design.exponent + inside * slope
        flows = [
            design.fill_valve.flow(np.full(MUSCLES, supply + ATMOSPHERE), inside),
            design.bleed_valve.flow(inside, np.full(MUSCLES, ATMOSPHERE)),
        ]
        return np.asarray(np.maximum(flows, SMALLEST_FLOW) / capacity)

    def _find_shares(self, opening: Floats) -> Floats:
        """Return the feed-forward as the board takes it: duty beyond the jump, signed."""
        design = self.design
        duty = np.abs(opening) * (1.0 - design.valve_dead_zone) + design.valve_dead_zone
        duty += 0.5 * design.valve_hysteresis
        share = np.clip(duty, self._jump + 1.0 / FEEDFORWARD_COUNTS, 1.0) - self._jump
        return np.asarray(np.where(opening == 0.0, 0.0, np.sign(opening) * share))


def _look_up(chamber: Chamber, pressure: float) -> tuple[float, float]:
    """Return the volume [mm^3] and its slope [mm^3/MPa] at a gauge pressure [MPa]."""
    cell = chamber.pressure[1]
    low, high = np.interp(
        [pressure - 0.5 * cell, pressure + 0.5 * cell], chamber.pressure, chamber.volume
    )
    return 0.5 * (low + high), (high - low) / cell
