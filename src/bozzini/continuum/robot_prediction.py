"""What a robot predicts of points that were measured on it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_kind
from ..errors import InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, take_axes, to_plain
from .calibration import Command, RobotCalibration
from .kinematics import ContinuumRobot
from .measured import RobotMeasurements
from .observation import Observation, Observed
from .section_residual import SectionStates
from .unknowns import RobotSetup

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOTION = "motion"
"""What stands for the name of a model where rows are of a motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotPrediction(Result):
    """What a fitted robot predicts of measurements.

    Parameters
    ----------
    measured, predicted : ndarray, shape (n, m, 3)
        Points [mm]; NaN where one was not seen. Nothing is predicted of a row without a point.
    markers : tuple of str
        Names of the points.
    answered : ndarray of bool, shape (n,)
        Which rows the model has a converged shape for; the others count with the shape that it
        found, and with the span of the points if that is not finite. Rows without a point are not
        asked for.
    reason : str
        Why a row has no shape; empty if all have one.
    states : SectionStates
        What is predicted of the sections; NaN of rows without a point.
    """

    measured: Floats
    predicted: Floats
    markers: tuple[str, ...]
    answered: NDArray[np.bool_]
    reason: str
    states: SectionStates = field(repr=False)

    @property
    def seen_rows(self) -> NDArray[np.int64]:
        """Indices of the rows with a point, (k,)."""
        return np.flatnonzero(np.isfinite(self.measured).all(axis=-1).any(axis=-1))

    @property
    def converged(self) -> bool:
        """Whether all rows with a point have a shape."""
        return bool(self.answered[self.seen_rows].all())

    @property
    def distances(self) -> Floats:
        """Distance of each point (n, m) [mm]; NaN where one was not seen."""
        return np.asarray(np.linalg.norm(self.predicted - self.measured, axis=-1))

    @property
    def rms(self) -> float:
        """Root mean square distance over all points seen [mm]."""
        return float(np.sqrt(np.nanmean(self.distances**2)))

    @property
    def median(self) -> float:
        """Median distance of all points seen [mm]."""
        return float(np.nanmedian(self.distances))

    @property
    def residual(self) -> float:
        """`rms` [mm]."""
        return self.rms

    @property
    def rms_by_marker(self) -> dict[str, float]:
        """The same of each marker [mm]."""
        return {
            name: float(np.sqrt(np.nanmean(column**2)))
            for name, column in zip(self.markers, self.distances.T, strict=True)
        }

    def to_dict(self) -> Json:
        """Return the errors as plain values."""
        values = {
            "rms_mm": self.rms,
            "median_mm": self.median,
            "rms_by_marker_mm": self.rms_by_marker,
            "largest_mm": float(np.nanmax(self.distances)),
            "rows": len(self.seen_rows),
            "rows_answered": int(self.answered.sum()),
            "converged": self.converged,
            "reason": self.reason,
        }
        return {name: to_plain(value) for name, value in values.items()}

    def list_columns(self) -> dict[str, Floats]:
        """Return the columns of `to_frame`, a row for each row of the measurements."""
        columns: dict[str, Floats] = {}
        for k, name in enumerate(self.markers):
            for i, axis in enumerate("xyz"):
                columns[f"{name}_{axis}_mm"] = self.predicted[:, k, i]
            columns[f"{name}_error_mm"] = self.distances[:, k]
        return columns

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distance of each point over the rows, and return the axes."""
        axes = take_axes(ax, x="row", y="measured to predicted [mm]")
        for name, column in zip(self.markers, self.distances.T, strict=True):
            axes.plot(np.arange(1, len(column) + 1), column, ".", markersize=3, label=name)
        axes.axhline(self.rms, color="k", linewidth=0.8)
        axes.set_ylim(0.0, None)
        axes.legend()
        return axes


def fill_gaps(points: Floats, measured: Floats) -> Floats:
    """Return predicted less measured points; the span of the measured ones without a shape."""
    span = float(np.nanmax(measured) - np.nanmin(measured))
    missed = points - measured
    return np.asarray(np.where(np.isfinite(points), missed, span))


def make_observation(
    setup: RobotSetup,
    data: RobotMeasurements,
    model: str = "",
    model_options: Mapping[str, object] | None = None,
) -> Observation:
    """Return measurements of a setup by a model, that of its calibration or by default."""
    robot = setup.robot
    check_kind("robot", robot, ContinuumRobot)
    if setup.dynamics is not None:
        if not data.times.size:
            raise InputError(
                "the measurements have no times: a fit in time needs those of all rows"
            )
        return Observation(setup, data, MOTION, {}, data.seen_rows)
    name, options = choose_model(robot, data.command, model, model_options)
    return Observation(setup, data, name, options, data.seen_rows)


def choose_model(
    robot: ContinuumRobot,
    command: Command,
    model: str = "",
    model_options: Mapping[str, object] | None = None,
) -> tuple[str, dict[str, object]]:
    """Return the model of rows at rest and its options: of the calibration, or by default."""
    name = model or (robot.calibration or RobotCalibration()).model
    if not name:
        weighs = robot.has_line_weight or robot.disc_weights.any()
        rubs = robot.tendon_friction.any()
        name = "rod" if command == "tension" or weighs or rubs else "energy"
    options = dict(model_options or {})
    if robot.calibration is not None and name == robot.calibration.model:
        options = {**robot.calibration.model_options, **options}
    elif name == "energy":
        options.setdefault("segment", "channel")
    return name, options


def predict_points(
    setup: RobotSetup,
    data: RobotMeasurements,
    *,
    model: str = "",
    model_options: Mapping[str, object] | None = None,
) -> RobotPrediction:
    """Return what a robot as it is predicts of measurements.

    Parameters
    ----------
    setup : RobotSetup
        The robot, its zeros and markers; those of the data that it has not are the data's.
    data : RobotMeasurements
        Commands, and points to compare with.
    model, model_options : optional
        As of `RobotFitOptions`.

    Raises
    ------
    InputError
        If the robot has no such tendons, or the model does not take such commands.
    """
    own = {marker.name: marker for marker in setup.markers}
    markers = tuple(own.get(marker.name, marker) for marker in data.markers)
    setup = dataclasses.replace(setup, markers=markers)
    observation = make_observation(setup, data, model, model_options)
    return compare_points(observation, observation.observe(setup))


def compare_points(observation: Observation, found: Observed) -> RobotPrediction:
    """Return what is predicted of the measurements of an observation."""
    measured, rows = observation.measured, observation.rows
    reasons = found.shape.reason[~found.answered]
    missing = np.isnan(found.points) & np.isfinite(measured)
    predicted = np.full(observation.data.points.shape, np.nan)
    predicted[rows] = np.where(missing, measured + fill_gaps(found.points, measured), found.points)
    answered = np.zeros(len(predicted), dtype=np.bool_)
    answered[rows] = found.answered
    states = SectionStates.of(observation.setup, found.shape, found.points)
    return RobotPrediction(
        measured=observation.data.points,
        predicted=predicted,
        markers=tuple(marker.name for marker in observation.data.markers),
        answered=answered,
        reason=str(reasons[0]) if len(reasons) else "",
        states=states.spread(rows, len(predicted)),
    )


def measure_rms(missed: Floats) -> float:
    """Return the root mean square length of vectors (..., 3) that are there [mm]; NaN of none."""
    squares = np.sum(np.square(missed), axis=-1)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if known.size else math.nan
