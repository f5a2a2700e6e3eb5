"""Model-based feed-forward: the valve openings that bring the pressures to their set-points."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_number, check_range
from ..errors import InputError
from ..numeric.arrays import Floats
from .kernels import plant as kernels
from .plant import MUSCLES, Chamber, PlantDesign
from .pneumatics import ATMOSPHERE
from .protocol import SETPOINT_MAX, Configuration, Notice, SetPoint, Telemetry

LINE_DELAY = 3e-3
"""From a measurement through the host to the opening that answers it [s], without the waiting:
frames both ways and two ticks of the board."""
APPROACH_TIME = 0.007
"""Within this time the predicted pressure approaches its set-point exponentially [s]."""
FAR, NEAR = 15e-3, 4e-3
"""Distances from the set-point [MPa] at which a move begins, and is left to the board."""
SMALLEST_REFERENCE = 1e-4
"""Above 0 [MPa], at which the board opens the bleed valve."""
CORRECTION_SHARE = 0.3
"""Of the difference between measurement and model, taken over from each telemetry."""
CLOCK_DRIFT = 0.01
"""Largest relative drift between the clocks of board and host; a resonator has 0.005."""
OPENINGS = 12
"""Duties of each valve that are tried."""


class Feedforward:
    """Opens the valves by a model of the plant, and gives the board the pressure to expect.

    Each period a model of valves, lines and muscles is moved on under the duties that were sent,
    and corrected by the measurement, compared with what the model had a delay before. From there
    it is predicted where the pressures come to rest if the valves get a duty for one period and are
    shut then: lag, play and dead zone of the valves, the flow at the pressures at hand and the
    volume of the muscle are in it. The duty is chosen that lets them come to rest nearer to the
    set-points, and at them in the end. The board gets the duty as its feed-forward and the model's
    pressure as its set-point: its own controller, which has no delay, corrects the difference.
    Near a set-point only the changes of this are fed forward, and the rest is left to the board, or
    both would hunt about the dead zone of the valves. One object serves one run.

    Parameters
    ----------
    design : PlantDesign
        The model of the plant.
    chambers : sequence of 3 Chamber
        The model of the muscles.
    board : Configuration
        The board's limits.
    period : float
        Of the host [s].
    rate : float, optional
        Largest rate of the pressures [MPa/s]; by default the board's `shaped_slew_rate`.

    Raises
    ------
    InputError
        If there are not three chambers, or the period or the rate is not legal.
    """

    def __init__(
        self,
        design: PlantDesign,
        chambers: Sequence[Chamber],
        board: Configuration,
        *,
        period: float,
        rate: float | None = None,
    ) -> None:
        most = board.shaped_slew_rate
        given = most if rate is None else rate
        self.rate = check_number("rate", given, low=0.0, low_open=True, high=most, unit="MPa/s")
        self.period = check_number("period", period, low=1e-3, high=0.05, unit="s")
        if len(chambers) != MUSCLES:
            raise InputError(f"there are {len(chambers)} chambers: there must be {MUSCLES}")
        self._dead = board.error_dead
        self._jump = board.jump / board.pwm_counts
        self._lowest_reservoir = design.compressor_on
        self._half_play = 0.5 * design.valve_hysteresis
        self._packed = tuple(map(float, design.pack(float(chambers[0].pressure[1]))))
        self._volumes = np.array([chamber.volume for chamber in chambers])
        self._step = 2.0 * design.find_step(chambers)
        shutting = max(design.valve_dead_zone - self._half_play, 0.05)
        self._coast = 1e-3 - design.valve_lag * math.log(shutting)
        self._tries = np.concatenate(
            [[0.0], np.linspace(self._jump + 1.0 / board.pwm_counts, 1.0, OPENINGS)]
        )
        self._channels = np.zeros((MUSCLES, kernels.CHANNEL_COLUMNS))
        self._supply = np.zeros(kernels.SUPPLY_COLUMNS)
        self._supply[kernels.SUPPLY_SPOOL] = 1.0
        self._duty = np.zeros(2 * MUSCLES)
        self._is_moving = np.zeros(MUSCLES, dtype=bool)
        self._target = np.zeros(MUSCLES)
        self._past: deque[tuple[float, Floats]] = deque(maxlen=64)
        self._offset = math.inf
        self._heard = -math.inf

    def shape(self, time: float, wanted: ArrayLike, *, board: Telemetry) -> SetPoint:
        """Return the set-points of a period and the feed-forward for them.

        Parameters
        ----------
        time : float
            Time of the run [s]; it must grow from call to call.
        wanted : (3,) array_like
            Pressures to go to [MPa].
        board : Telemetry
            The last telemetry.

        Raises
        ------
        InputError
            If the pressures are not three, or outside [0, 0.827] MPa.
        """
        target = check_array("wanted", wanted)
        if target.shape != (MUSCLES,):
            raise InputError(f"wanted has shape {target.shape}: it must be ({MUSCLES},)")
        check_range("wanted", target, 0.0, SETPOINT_MAX, "MPa")
        self._follow(time, board)
        stops = self._predict_stops()
        rest = stops[:, 0]
        away = target - rest
        self._is_moving = np.abs(away) > np.where(self._is_moving, NEAR, FAR)
        most = self.rate * self.period
        share = -math.expm1(-self.period / APPROACH_TIME)
        move = np.clip(np.where(self._is_moving, share * away, target - self._target), -most, most)
        self._target = target
        duty = self._find_duties(stops, rest + move)
        middle = self._channels.copy()
        self._advance(middle, self._supply.copy(), duty, self._volumes, 0.5 * self.period)
        # What is not left to the valves is left to the board, at rest with a reference at rest.
        reference = middle[:, kernels.SENSOR] + np.where(self._is_moving, 0.0, away - move)
        is_held = ~self._is_moving & (np.abs(reference - target) < self._dead)
        reference = np.where(is_held, target, reference)
        reference = np.clip(reference, SMALLEST_REFERENCE, SETPOINT_MAX)
        is_empty = (target == 0.0) & ~self._is_moving
        reference[is_empty] = 0.0  # the board opens the bleed valve
        duty[:MUSCLES][is_empty], duty[MUSCLES:][is_empty] = 0.0, 1.0
        self._duty = duty
        beyond = np.maximum(duty - self._jump, 0.0)
        return SetPoint(
            tuple(reference.tolist()), tuple((beyond[:MUSCLES] - beyond[MUSCLES:]).tolist())
        )

    def _find_duties(self, stops: Floats, goal: Floats) -> Floats:
        """Return the duties (6,) that let the pressures come to rest at a goal [MPa]."""
        duty = np.zeros(2 * MUSCLES)
        for k, (row, end) in enumerate(zip(stops, goal, strict=True)):
            if end == row[0]:
                continue
            if end > row[0]:
                index, reached = k, row[: OPENINGS + 1]
            else:
                index, end = MUSCLES + k, -end
                reached = -np.delete(row, slice(1, OPENINGS + 1))
            found = float(np.interp(end, reached, self._tries))
            if found < self._tries[1]:  # the board gives the jump or nothing
                found = self._tries[1] if 2.0 * found > self._tries[1] else 0.0
            duty[index] = found
        return duty

    def _follow(self, time: float, board: Telemetry) -> None:
        """Move the model on to a time, and correct it by the telemetry."""
        measured = np.array(board.pressures)
        if not self._past:
            self._start(board)
        else:
            self._advance(
                self._channels, self._supply, self._duty, self._volumes, time - self._past[-1][0]
            )
        self._past.append((time, self._channels[:, kernels.SENSOR].copy()))
        is_known = Notice.RESERVOIR_SENSOR not in board.warnings
        reservoir = board.reservoir_pressure if is_known else self._lowest_reservoir
        self._supply[kernels.RESERVOIR] = reservoir + ATMOSPHERE
        drift = CLOCK_DRIFT * (time - self._past[-2][0]) if len(self._past) > 1 else 0.0
        self._offset = min(self._offset + drift, time - board.time)
        if board.time <= self._heard:
            return
        self._heard = board.time
        then = board.time + self._offset - LINE_DELAY
        times = [entry[0] for entry in self._past]
        expected = [np.interp(then, times, [entry[1][k] for entry in self._past]) for k in range(3)]
        change = CORRECTION_SHARE * (measured - expected)
        self._channels[:, [kernels.LINE, kernels.MUSCLE, kernels.SENSOR]] += change[:, None]
        for _, sensor in self._past:
            sensor += change

    def _start(self, board: Telemetry) -> None:
        """Put the model at the state that the telemetry shows."""
        self._target = np.array(board.pressures)
        channels = self._channels
        channels[:, kernels.SENSOR] = board.pressures
        channels[:, [kernels.LINE, kernels.MUSCLE]] = (
            np.array(board.pressures)[:, None] + ATMOSPHERE
        )
        channels[:, kernels.FILL_SPOOL] = board.fill
        channels[:, kernels.BLEED_SPOOL] = board.bleed
        for spool, play in (
            (kernels.FILL_SPOOL, kernels.FILL_PLAY),
            (kernels.BLEED_SPOOL, kernels.BLEED_PLAY),
        ):
            channels[:, play] = np.maximum(channels[:, spool] - self._half_play, 0.0)

    def _predict_stops(self) -> Floats:
        """Return where pressures come to rest [MPa], (3, 1 + 2 n): shut, filled, bled."""
        count = 2 * OPENINGS + 1
        many = np.repeat(self._channels, count, axis=0)
        fill, bleed = np.zeros((2, MUSCLES, count))
        fill[:, 1 : OPENINGS + 1] = self._tries[1:]
        bleed[:, OPENINGS + 1 :] = self._tries[1:]
        duty = np.concatenate([fill.ravel(), bleed.ravel()])
        volumes = np.repeat(self._volumes, count, axis=0)
        supply = self._supply.copy()
        self._advance(many, supply, duty, volumes, self.period)
        self._advance(many, supply, np.zeros_like(duty), volumes, self._coast)
        return np.asarray(many[:, kernels.LINE].reshape(MUSCLES, count) - ATMOSPHERE)

    def _advance(
        self, channels: Floats, supply: Floats, duty: Floats, volumes: Floats, span: float
    ) -> None:
        """Move channels on by a time [s] without faults."""
        count = math.ceil(span / self._step)
        if count > 0:
            faults = np.tile([-1.0, 0.0, 1.0], (len(channels), 1))
            kernels.advance(
                channels,
                supply,
                np.append(duty, 1.0),  # the supply valve is open
                faults,
                volumes,
                self._packed,
                count,
                span / count,
            )
