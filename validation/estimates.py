"""What estimates from sensors come to on rows that nothing was fitted to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from bozzini.continuum import (
    AheadPrediction,
    EnergyModel,
    ModelError,
    PlaceSensor,
    RobotMeasurements,
    RobotSetup,
    SensorRecord,
    ShapeEstimator,
    fit_model_error,
    follow_record,
)

AHEAD = (1, 5, 20)
"""Rows ahead that are predicted."""
APART_S = 1e6
"""Time in which all but constants is forgotten [s]."""


def make_estimator(
    setup: RobotSetup, data: RobotMeasurements, error: ModelError, deviation: float
) -> ShapeEstimator:
    """Return an estimator that sees the markers of a setup."""
    sensors = tuple(
        PlaceSensor(
            name=one.name, arc_length=one.arc_length, offset=one.offset, deviation=deviation
        )
        for one in (setup.markers or data.markers)
    )
    return ShapeEstimator(
        model=EnergyModel(setup.robot, segment="channel"),
        sensors=sensors,
        error=error,
        command=data.command,
    )


def make_record(
    setup: RobotSetup, data: RobotMeasurements, times: NDArray[np.float64]
) -> SensorRecord:
    """Return a recording with the commands that reach the tendons of a setup."""
    return SensorRecord(
        times=times,
        commands=setup.convert(data.order_commands(setup.robot)),
        readings={one.name: data.points[:, k] for k, one in enumerate(data.markers)},
    )


def predict_ahead(
    data: RobotMeasurements,
    times: NDArray[np.float64],
    fit: Callable[[NDArray[np.bool_]], RobotSetup],
    *,
    error: ModelError,
    blocks: int,
    wanted: Sequence[int],
) -> dict[int, tuple[AheadPrediction, float]]:
    """Return predictions of the blocks of rows wanted, each by what was fitted to the others.

    Beside each, the share within 95 % intervals that the rows fitted have widened (conformal).
    """
    block = np.arange(len(data)) * blocks // len(data)
    parts: dict[int, list[AheadPrediction]] = {steps: [] for steps in AHEAD}
    inside: dict[int, list[float]] = {steps: [] for steps in AHEAD}
    for k in wanted:
        setup = fit(block != k)
        record = make_record(setup, data, times)
        estimator = make_estimator(setup, data, error, 0.5)
        found = fit_model_error(estimator, record.select(block != k), ahead=AHEAD)
        estimator = dataclasses.replace(estimator, error=found.error)
        known = follow_record(estimator, record.select(block != k)).state
        history = follow_record(
            estimator,
            record.select(block == k),
            ahead=AHEAD,
            state=estimator.wait(known, APART_S),
        )
        for one in history.predictions:
            parts[one.ahead].append(one)
            inside[one.ahead].append(one.measure_coverage(found.widenings[one.ahead]))
    return {
        steps: (
            AheadPrediction(
                ahead=steps,
                misses=np.concatenate([one.misses for one in parts[steps]]),
                deviations=np.concatenate([one.deviations for one in parts[steps]]),
            ),
            float(np.mean(inside[steps])),
        )
        for steps in AHEAD
    }


@dataclasses.dataclass(frozen=True)
class Seen:
    """Some markers from others, on rows left out."""

    rms: float
    """With the others read [mm]."""
    alone: float
    """By the model alone [mm]."""
    coverage: float
    """Share of coordinates within 95 % intervals."""


def see_markers(
    data: RobotMeasurements,
    fit: Callable[[NDArray[np.bool_]], RobotSetup],
    wanted: Sequence[Sequence[int]],
    *,
    error: ModelError,
    free: Sequence[str],
    blocks: int,
) -> list[Seen]:
    """Return how well markers of a pose are known from its other ones, for each set wanted."""
    block = np.arange(len(data)) * blocks // len(data)
    names = [one.name for one in data.markers]
    misses: list[list[NDArray[np.float64]]] = [[] for _ in wanted]
    for k in range(blocks):
        setup = fit(block != k)
        record = make_record(setup, data, 100.0 * np.arange(len(data), dtype=np.float64))
        estimator = make_estimator(setup, data, error, 1.0)
        found = fit_model_error(estimator, record.select(block != k), free=free, ahead=(1,))
        estimator = make_estimator(setup, data, found.error, found.noise)
        for row in np.flatnonzero(block == k):
            for own, kept in zip(wanted, misses, strict=True):
                command, reading = record.commands[row], record.read(int(row))
                given = {name: reading[name] for j, name in enumerate(names) if j not in own}
                after = estimator.estimate(command, given).state
                both = [
                    np.reshape(estimator.miss(command, reading, state=state), (2, -1, 3))[:, own]
                    for state in (after, estimator.begin())
                ]
                kept.append(np.stack(both))
    seen = []
    for kept in misses:
        whole = np.concatenate(kept, axis=2)  # (state, miss or deviation, marker, axis)
        rms, alone = (math.sqrt(float(np.mean(np.sum(one[0] ** 2, axis=-1)))) for one in whole)
        inside = np.abs(whole[0, 0]) <= 1.96 * whole[0, 1]
        seen.append(Seen(rms, alone, float(np.mean(inside))))
    return seen
