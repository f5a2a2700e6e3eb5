"""What estimates from sensors come to on rows that nothing was fitted to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence

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
from bozzini.continuum.energy import Segment

AHEAD = (1, 5, 20)
"""Rows ahead that are predicted."""
CARRIED = 0.95
"""Share of what a model missed rows before that the plainest prediction adds to it."""
APART_S = 1e6
"""Time in which all but constants is forgotten [s]."""


def make_estimator(
    setup: RobotSetup,
    data: RobotMeasurements,
    error: ModelError,
    deviation: float,
    segment: Segment = "channel",
) -> ShapeEstimator:
    """Return an estimator that sees the markers of a setup."""
    sensors = tuple(
        PlaceSensor(
            name=one.name, arc_length=one.arc_length, offset=one.offset, deviation=deviation
        )
        for one in (setup.markers or data.markers)
    )
    return ShapeEstimator(
        model=EnergyModel(setup.robot, segment=segment),
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


@dataclasses.dataclass(frozen=True)
class Ahead:
    """Rows predicted some rows ahead, of blocks that nothing was fitted to."""

    rms: float
    """With what was read until then [mm]."""
    alone: float
    """By the model alone [mm]."""
    carried: float
    """By the model and so much of what it missed that many rows before [mm]."""
    coverage: float
    """Share of coordinates within 95 % intervals."""
    corrected: float
    """Share within intervals that the rows fitted have widened (conformal)."""


def predict_ahead(
    data: RobotMeasurements,
    times: NDArray[np.float64],
    fit: Callable[[NDArray[np.bool_]], RobotSetup],
    *,
    error: ModelError,
    wanted: Sequence[int],
    segment: Segment = "channel",
) -> dict[int, Ahead]:
    """Return predictions of the quarters of rows wanted, each by what was fitted to the others."""
    block = np.arange(len(data)) * 4 // len(data)
    parts: dict[int, list[AheadPrediction]] = {steps: [] for steps in AHEAD}
    inside: dict[int, list[float]] = {steps: [] for steps in AHEAD}
    left: list[NDArray[np.float64]] = []
    for k in wanted:
        setup = fit(block != k)
        record = make_record(setup, data, times)
        estimator = make_estimator(setup, data, error, 0.5, segment)
        found = fit_model_error(estimator, record.select(block != k), ahead=AHEAD)
        estimator = dataclasses.replace(estimator, error=found.error)
        known = follow_record(estimator, record.select(block != k)).state
        own = record.select(block == k)
        history = follow_record(estimator, own, ahead=AHEAD, state=estimator.wait(known, APART_S))
        for one in history.predictions:
            parts[one.ahead].append(one)
            inside[one.ahead].append(one.measure_coverage(found.widenings[one.ahead]))
        bare = [np.concatenate(list(estimator.predict(row).values())) for row in own.commands]
        left.append(np.concatenate(list(own.readings.values()), axis=1) - bare)
    found_ahead = {}
    for steps in AHEAD:
        whole = AheadPrediction(
            ahead=steps,
            misses=np.concatenate([one.misses for one in parts[steps]]),
            deviations=np.concatenate([one.deviations for one in parts[steps]]),
        )
        carried = [rows[steps:] - CARRIED * rows[:-steps] for rows in left]
        found_ahead[steps] = Ahead(
            rms=whole.rms,
            alone=find_rms(left),
            carried=find_rms(carried),
            coverage=whole.measure_coverage(),
            corrected=float(np.mean(inside[steps])),
        )
    return found_ahead


def find_rms(parts: Sequence[NDArray[np.float64]]) -> float:
    """Return the root mean square length of rows, of those without NaN."""
    squares = np.sum(np.concatenate(parts) ** 2, axis=1)
    return math.sqrt(float(np.nanmean(squares)))


def describe_ahead(ahead: dict[int, Ahead]) -> str:
    """Return how far rows ahead are missed, and by plainer predictions."""

    def join(values: Iterable[float], places: int) -> str:
        return ", ".join(f"{value:.{places}f}" for value in values)

    every = list(ahead.values())
    return (
        f"{join((x.rms for x in every), 2)} mm {', '.join(map(str, ahead))} rows ahead (model "
        f"alone {every[0].alone:.2f}; with {CARRIED} of its last miss "
        f"{join((x.carried for x in every), 2)}); 95 % intervals, corrected by the other quarters, "
        f"hold {join((100.0 * x.corrected for x in every), 1)} %."
    )


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
