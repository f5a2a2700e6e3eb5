"""Fit a robot to measured points, and report what the data do not determine."""

from __future__ import annotations

import dataclasses
import math
import multiprocessing
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_kind, check_word, show_apart
from ..errors import BozziniError, InputError
from ..numeric.arrays import Floats
from ..numeric.estimation import (
    FitCovariance,
    describe_lost,
    determine,
    find_lost,
    judge_fit,
    make_blocks,
    measure_spread,
)
from ..numeric.least_squares import (
    ROBUST,
    LeastSquares,
    Loss,
    describe_bounds,
    explain_end,
    measure_scatter,
    weigh,
)
from ..progress import Progress, no_progress
from ..results import Json, Result, rows_of, tabulated, take_axes, to_plain
from .calibration import Command, RobotCalibration
from .command_baselines import predict_by_commands
from .dynamics import DynamicsOptions
from .kinematics import ContinuumRobot
from .measured import RobotMeasurements
from .models import CONTINUUM_MODELS
from .observation import Observation, Observed, align_base
from .prediction_band import PredictionBand, make_band, name_kinds
from .section_residual import SectionResidual, SectionStates, learn_residual
from .unknowns import FIELDS, Change, RobotSetup, Unknown, change_setup, parse_unknowns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Split = Literal["blocks", "random", "kinds", "amplitude"]

MOTION = "motion"
"""What stands for the name of a model where rows are of a motion."""

EVALUATIONS = 60
"""Largest number of evaluations of one search, derivatives apart."""
FEWEST_OF_KIND = 10
"""Rows of a kind of motion from which on it is left out as a block."""
POOR_SHARE = 0.05
"""Of the robot's length or the span of the points: a fit that misses by more is poor."""
POOR_RATIO = 1.2
"""A fit is poor if it misses by so many times what commands alone do, beyond chance."""
AT_BOUND = 1e-6
"""Distance from a bound that counts as none."""
FLAT = 1e-3
"""Gradient of half the sum of squares that counts as none [mm^2]."""
NEARLY_NONE = 1e-3
"""Largest change from which a search begins as from none: its first step is as large as that."""
HALF = 0.5
"""Weight of a coordinate below which its row is reported."""
LEAST_SCATTER_MM = 1e-4
"""Scatter below which all misfits count alike [mm]."""
IDLE = 0.01
"""Share of the scatter: a number that moves points by less, all over its range, has no effect."""


@dataclass(frozen=True, kw_only=True)
class RobotFitOptions:
    """How a robot is fitted, and validated.

    Parameters
    ----------
    model : str, optional
        Name of the model; by default ``energy`` for displacements of a robot without weight,
        ``rod`` otherwise.
    model_options : mapping
        Options of the model; ``segment="channel"`` unless given, for the energy model.
    loss : {"soft_l1", "huber", "linear"}
        What of each coordinate's misfit is summed, as of `scipy.optimize.least_squares`. The
        robust ones count a misfit above 1.5 times the scatter less than by its square.
    folds : int
        Blocks of rows that are left out in turn, and predicted; 0 for none. Where nothing is free
        there is nothing to leave out of.
    split : {"blocks", "random", "kinds", "amplitude"}
        Whether blocks are runs of rows, drawn at random, the kinds of motion: the sections that
        bend together, or by how far sections bend: of the last block, the furthest, the error is
        that of an extrapolation. A random split is refused where rows that follow each other
        are alike: there it tests no prediction. Labels of the data, if there are any, take the
        place of runs.
    residual : bool
        Whether what the fit leaves over is learned on top of it, see `SectionResidual`.
    smaller : bool
        Whether fits of fewer constants are tried on the blocks left out.
    jobs : int
        Processes at the same time.
    dynamics : DynamicsOptions, optional
        How the robot moves, for rows of a motion from rest under the first command; None of shapes
        at rest.
    """

    model: str = ""
    model_options: Mapping[str, object] = field(default_factory=dict)
    loss: Loss = "soft_l1"
    folds: int = 4
    split: Split = "blocks"
    residual: bool = False
    smaller: bool = True
    jobs: int = 1
    dynamics: DynamicsOptions | None = None

    def __post_init__(self) -> None:
        if self.dynamics is not None:
            check_kind("dynamics", self.dynamics, DynamicsOptions)
            if self.model or self.model_options:
                raise InputError(
                    "a model of shapes at rest is given for a fit in time: leave it out"
                )
        check_word("loss", self.loss, get_args(Loss))
        check_word("split", self.split, get_args(Split))
        check_integer("jobs", self.jobs, low=1)
        if check_integer("folds", self.folds, low=0) == 1:
            raise InputError("folds is 1: it must be 2 or more, or 0 for none")
        if self.residual and not self.folds:
            raise InputError(
                "folds is 0: a residual is chosen by blocks left out, which must be 2 or more"
            )


DEFAULT_OPTIONS = RobotFitOptions()


@dataclass(frozen=True)
class Estimate:
    """A fitted number.

    Parameters
    ----------
    name : str
        What was fitted.
    value, low, high : float
        The number, and the ends of its 95 % interval; infinite where the data do not determine it.
        That of a friction, a pretension or a backlash is cut where these are not legal.
    unit : str
        Its unit; empty for a number without one, such as a factor on what is in the robot file.
    standard_error : float
        Standard deviation, of a factor on its own value.
    change : {"factor", "shift"}
        Whether the number of the robot file was multiplied or moved.
    """

    name: str = tabulated()
    value: float = tabulated()
    low: float = tabulated()
    high: float = tabulated()
    unit: str = tabulated()
    standard_error: float = tabulated()
    change: Change = "factor"


@dataclass(frozen=True)
class Validation:
    """Blocks of rows left out in turn, and predicted by the fit to the others.

    Parameters
    ----------
    names : tuple of str
        What was fitted.
    rms : float
        Root mean square distance over all rows, each left out once [mm].
    blocks : tuple of float
        The same of each block.
    labels : tuple of str
        What each block is; empty for runs of rows.
    """

    names: tuple[str, ...]
    rms: float
    blocks: tuple[float, ...]
    labels: tuple[str, ...] = ()

    def beats(self, other: Validation) -> bool:
        """Return whether its errors of the same blocks are less than those of another.

        The mean of the blocks' differences must be above its standard error, which is their
        standard deviation over the root of their number; and the error over all rows no larger.
        """
        gains = np.subtract(other.blocks, self.blocks)
        error = float(np.std(gains, ddof=1)) / math.sqrt(len(gains))
        return self.rms <= other.rms and bool(gains.mean() > error)


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


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFit(Result):
    """What a fit of a robot found, and how far it can be trusted.

    Parameters
    ----------
    setup : RobotSetup
        The robot with the fitted numbers, its zeros and markers.
    estimates : tuple of Estimate
        The fitted numbers.
    correlations : ndarray, shape (k, k)
        Of the covariance that the intervals are of.
    condition : float
        Condition number of the Jacobian with columns of length 1.
    interval_rule : str
        Which rows the intervals take as independent; empty where nothing is fitted.
    prediction : RobotPrediction
        The rows that were fitted.
    validation : Validation, optional
        Blocks of rows left out; None if there are no folds.
    smaller : Validation, optional
        The best of fewer constants, where that predicts rows left out better by more than the
        blocks scatter (`Validation.beats`); None otherwise.
    baselines : tuple of Validation
        What commands alone predict of the same blocks, see `predict_by_commands`.
    section_residual : SectionResidual, optional
        What was learned on top of the fit, if that was asked for.
    corrected : Validation, optional
        The rows left out with the residual that the others give.
    band : PredictionBand, optional
        How far predictions miss, by kind of motion: with the residual if there is one.
    model_band : PredictionBand, optional
        The same without the residual, which the robot itself does not have.
    undetermined : tuple of str
        Sets of numbers that the data do not determine, a sentence each. One without any effect
        stays where it was.
    warnings : tuple of str
        What the estimates suffer from.
    outliers : tuple of int
        Rows with a coordinate that a robust loss gave less than half the weight of a small misfit.
    data : RobotMeasurements
        What was fitted to.
    model : str
        Name of the model.
    model_options : mapping
        Options of the model.
    converged : bool
        Whether the fit ended at a minimum.
    reason : str
        Why the fit ended.
    evaluations : int
        How often all rows were solved, derivatives apart.
    """

    setup: RobotSetup
    estimates: tuple[Estimate, ...] = rows_of(Estimate)
    correlations: Floats
    condition: float
    interval_rule: str
    prediction: RobotPrediction
    validation: Validation | None
    smaller: Validation | None
    baselines: tuple[Validation, ...]
    section_residual: SectionResidual | None
    corrected: Validation | None
    band: PredictionBand | None
    model_band: PredictionBand | None
    undetermined: tuple[str, ...]
    warnings: tuple[str, ...]
    outliers: tuple[int, ...]
    data: RobotMeasurements
    model: str
    model_options: Mapping[str, object]
    converged: bool
    reason: str
    evaluations: int

    @cached_property
    def robot(self) -> ContinuumRobot:
        """The robot with the fitted numbers, and with its calibration."""
        return dataclasses.replace(self.setup.robot, calibration=self._calibrate())

    @property
    def rms(self) -> float:
        """Root mean square distance over all points fitted [mm]."""
        return self.prediction.rms

    @property
    def residual(self) -> float:
        """`rms` [mm]."""
        return self.rms

    @property
    def is_poor(self) -> bool:
        """Whether it is far off, or commands alone are `better` than what was fitted."""
        return self.is_far or self.better is not None

    @property
    def is_far(self) -> bool:
        """Whether rows left out, or fitted, are missed by more than 5 % of the robot or the span.

        It is of the shorter of the robot's length and the span of the points. A comparison with
        points that all coincide has no span to be judged by, and is not far off.
        """
        return self.data.span > 0.0 and not self.error <= POOR_SHARE * min(self._sizes)

    @property
    def better(self) -> Validation | None:
        """The best of the baselines, if the rows left out are missed by more than 1.2 times its.

        They must be so beyond the scatter of the blocks (`Validation.beats`), with the residual if
        there is one. A robot of which nothing was fitted is not judged: baselines are fitted.
        """
        own = self.corrected or self.validation
        best = min(self.baselines, key=lambda one: one.rms, default=None)
        if own is None or best is None or not self.estimates:
            return None
        return best if own.rms > POOR_RATIO * best.rms and best.beats(own) else None

    @property
    def _sizes(self) -> tuple[float, float]:
        return self.setup.robot.length, self.data.span

    @property
    def error(self) -> float:
        """Root mean square distance of rows left out [mm], of those fitted if none were."""
        return self.rms if self.validation is None else self.validation.rms

    def describe_error(self) -> str:
        """Return the error as a share of what it is judged by, and from which one on it is poor."""
        if self.data.span == 0.0:
            return f"all points coincide: there is no span to judge {self.error:.3g} mm rms by"
        of = "rms of the rows" if self.validation is None else "rms of rows left out"
        length, span = self._sizes
        what = "the points' span" if span <= length else "the robot's length"
        return (
            f"{self.error:.3g} mm {of} is {100.0 * self.error / min(length, span):.2g} % of {what} "
            f"of {min(length, span):.3g} mm; above {100.0 * POOR_SHARE:.0f} % it is poor"
        )

    def predict(self, data: RobotMeasurements) -> RobotPrediction:
        """Return what the fitted robot predicts of other measurements.

        Raises
        ------
        InputError
            If they have other tendons, or a marker that was not described.
        """
        return predict_points(self.setup, data, model=self.model, model_options=self.model_options)

    def correct(self, prediction: RobotPrediction) -> RobotPrediction:
        """Return a prediction of this fit with the residual added; as it is if there is none."""
        if self.section_residual is None:
            return prediction
        points = prediction.predicted + self.section_residual.shift(prediction.states)
        return dataclasses.replace(prediction, predicted=points)

    def check(self, data: RobotMeasurements) -> RobotCheck:
        """Compare other measurements with what the fit, its band and the baselines predict.

        Raises
        ------
        InputError
            As `predict` does.
        """
        prediction, rows = self.predict(data), data.seen_rows
        best, known = self.correct(prediction), self.data.seen_rows
        errors: dict[str, float] = {}
        held = beyond = math.nan
        unseen: tuple[tuple[str, int], ...] = ()
        if [marker.name for marker in data.markers] == list(self.prediction.markers):
            there = predict_by_commands(
                self.data.order_commands(self.robot)[known],
                self.data.points[known],
                data.order_commands(self.robot)[rows],
            )
            errors = {name: _measure_rms(points - data.points[rows])
                      for name, points in there.items()}  # fmt: skip
            if self.band is not None:
                kinds = self.band.name_kinds(prediction.states.bends[rows])
                seen = np.isfinite(best.distances[rows])
                within = best.distances[rows] <= self.band.find_radii(kinds)
                held = float(within[seen].mean())
                strange = self.band.find_unseen(kinds)
                if seen[strange].any():
                    beyond = float(within[strange][seen[strange]].mean())
                new, counts = np.unique(kinds[strange], return_counts=True)
                unseen = tuple(zip(new.tolist(), counts.tolist(), strict=True))
        return RobotCheck(
            prediction=prediction,
            corrected=None if self.section_residual is None else best,
            baselines=errors,
            coverage=held,
            coverage_unseen=beyond,
            unseen=unseen,
        )

    def _calibrate(self) -> RobotCalibration:
        model, options = self.model, self.model_options
        if self.setup.dynamics is not None:  # at rest the same segments are in equilibrium
            model = "energy"
            kept = "segment", "between", "tendon_stiffness"
            options = {name: getattr(self.setup.dynamics, name) for name in kept}
        zeros = dict(zip(self.setup.robot.tendon_names, self.setup.zeros, strict=False))
        plain = {
            name: value
            for name, value in options.items()
            if isinstance(value, (float, int, str, bool))
        }
        return RobotCalibration(
            command=self.data.command,
            zeros={name: value for name, value in zeros.items() if value},
            scale=self.setup.scale,
            backlash=self.setup.backlash,
            markers=self.setup.markers,
            model=model,
            model_options=plain,
            values={one.name: one.value for one in self.estimates},
            rms=self.rms,
            validation_rms=0.0 if self.validation is None else self.validation.rms,
            rows=len(self.data.seen_rows),
            source=self.data.source,
            band=self.model_band,
        )

    def to_dict(self) -> Json:
        """Return the fit as plain values."""
        values: Json = {
            "model": self.model,
            "command": self.data.command,
            "estimates": {
                one.name: {
                    "value": one.value,
                    "unit": one.unit,
                    "standard_error": one.standard_error,
                    "interval_95": [one.low, one.high],
                }
                for one in self.estimates
            },
            "correlations": self.correlations,
            "condition": self.condition,
            "interval_rule": self.interval_rule,
            "fit": self.prediction.to_dict(),
            "validation": _describe_validation(self.validation),
            "smaller": _describe_validation(self.smaller),
            "baselines_mm": {one.names[0]: one.rms for one in self.baselines},
            "with_residual": _describe_validation(self.corrected),
            "band": None if self.band is None else self.band.to_dict(),
            "model_band": None if self.model_band is None else self.model_band.to_dict(),
            "undetermined": self.undetermined,
            "warnings": self.warnings,
            "outliers": [row + 1 for row in self.outliers],
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
        }
        return {name: to_plain(value) for name, value in values.items()}

    def format_table(self) -> str:
        """Return the estimates as text, angles in degrees, and what to know of them."""
        wide = max([16, *(len(one.name) + 1 for one in self.estimates)])
        lines = []
        for one in self.estimates:
            values, unit = [one.value, one.low, one.high], one.unit
            if unit == "rad":
                values, unit = [math.degrees(value) for value in values], "deg"
            unit = unit or ("times" if one.change == "factor" else "")
            value, low, high = show_apart(*values, digits=4)
            determined = math.isfinite(values[2] - values[1])
            interval = f"95 %: {low} to {high}" if determined else "not determined"
            lines.append(f"{one.name:<{wide}}{value:>11} {unit:<7} {interval}")
        lines += [self.interval_rule] if self.interval_rule else []
        rows = len(self.prediction.seen_rows)
        held = int(self.prediction.answered.sum())
        share = "" if held == rows else f", {held} of {rows} with a converged shape,"
        lines.append(
            f"fitted {rows} rows{share} with {len(self.estimates)} constants: {self.rms:.3g} mm "
            f"rms, {self.prediction.median:.3g} mm median"
        )
        if self.outliers:
            lines.append(
                f"the robust loss gave {len(self.outliers)} of {rows} rows less than half weight; "
                "the rms counts them in full"
            )
        by_marker = self.prediction.rms_by_marker
        if len(by_marker) > 1:
            shown = ", ".join(f"{name} {value:.3g}" for name, value in by_marker.items())
            lines.append(f"by marker [mm]: {shown}")
        if self.validation is not None:
            lines.append(_format_validation(self.validation))
        if self.corrected is not None and self.section_residual is not None:
            lines.append(
                f"with a residual on top, {self.corrected.rms:.3g} mm: "
                f"{self.section_residual.describe()}"
            )
        if self.baselines:
            shown = ", ".join(f"{one.names[0]} {one.rms:.3g}" for one in self.baselines)
            lines.append(f"from commands alone the same rows are predicted to [mm]: {shown}")
        if self.band is not None:
            with_it = "" if self.section_residual is None else "with the residual, "
            lines.append(with_it + self.band.describe())
        if self.data.span > 0.0 and not self.is_far:  # else a warning says it
            lines.append(self.describe_error())
        if self.smaller is not None and self.validation is not None:
            lines.append(
                f"fewer constants predict better: {len(self.smaller.names)} in place of "
                f"{len(self.estimates)} give {self.smaller.rms:.3g} mm on rows left out; "
                f"take --free {','.join(self.smaller.names)}"
            )
        lines.append(f"{'converged' if self.converged else 'not converged'}: {self.reason}")
        lines += [f"not determined: {text}" for text in self.undetermined]
        return "\n".join([*lines, *(f"warning: {text}" for text in self.warnings)])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distance of each fitted point over the rows, and return the axes."""
        return self.prediction.plot(ax)


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotCheck(Result):
    """What a fit makes of measurements that it was not fitted to.

    Parameters
    ----------
    prediction : RobotPrediction
        Of the fitted robot.
    corrected : RobotPrediction, optional
        With the residual, if there is one.
    baselines : mapping of str to float
        Root mean square distances of what commands alone predict [mm].
    coverage, coverage_unseen : float
        Share of the points within the band of the fit, and of those in rows of kinds of motion
        that it has not, where the widest radius stands for it; NaN without one.
    unseen : tuple of (str, int)
        Kinds of motion that the fit has not, and their rows.
    """

    prediction: RobotPrediction
    corrected: RobotPrediction | None
    baselines: Mapping[str, float]
    coverage: float
    coverage_unseen: float
    unseen: tuple[tuple[str, int], ...]

    @property
    def converged(self) -> bool:
        """Whether all rows with a point have a shape."""
        return self.prediction.converged

    @property
    def reason(self) -> str:
        """Why a row has no shape; empty if all have one."""
        return self.prediction.reason

    @property
    def residual(self) -> float:
        """Root mean square distance of the best that the fit has [mm]."""
        return (self.corrected or self.prediction).rms

    def to_dict(self) -> Json:
        """Return the errors as plain values."""
        return self.prediction.to_dict() | {
            "with_residual_mm": None if self.corrected is None else self.corrected.rms,
            "baselines_mm": dict(self.baselines),
            "band_coverage": to_plain(self.coverage),
            "band_coverage_unseen": to_plain(self.coverage_unseen),
            "unseen_kinds": dict(self.unseen),
        }

    def format_lines(self, name: str) -> list[str]:
        """Return what a reader should know, a line each."""
        own, rows = self.prediction, len(self.prediction.seen_rows)
        more = "" if self.corrected is None else f", {self.corrected.rms:.3g} mm with the residual"
        lines = [
            f"{name}: {rows} rows predicted to {own.rms:.3g} mm rms{more}, {own.median:.3g} mm "
            "median"
        ]
        if self.baselines:
            shown = ", ".join(f"{kind} {rms:.3g}" for kind, rms in self.baselines.items())
            lines.append(f"  from commands alone [mm]: {shown}")
        if math.isfinite(self.coverage):
            lines.append(f"  {self.coverage:.1%} of the points are within the band of the fit")
        if self.unseen:
            shown = ", ".join(f"{kind} ({count} rows)" for kind, count in self.unseen)
            lines.append(
                f"  warning: sections move together, or as far, as in no row of the fit: {shown}; "
                f"the band promises nothing of these, {self.coverage_unseen:.1%} are within its "
                "widest radius"
            )
        return lines


def _describe_validation(found: Validation | None) -> Json | None:
    if found is None:
        return None
    return {
        "names": found.names,
        "rms_mm": found.rms,
        "blocks_mm": found.blocks,
        "labels": found.labels,
    }


def _format_validation(found: Validation) -> str:
    labels = found.labels or ("",) * len(found.blocks)
    blocks = ", ".join(
        f"{label} {value:.3g}".strip() for label, value in zip(labels, found.blocks, strict=True)
    )
    return f"rows left out, {len(found.blocks)} blocks: {found.rms:.3g} mm rms ({blocks})"


# The search.


@dataclass(frozen=True)
class _Search:
    """Unknowns of an observation, where they are looked for from, and what is made small."""

    observation: Observation
    unknowns: tuple[Unknown, ...]
    loss: Loss
    scale: float = 1.0

    def miss(self, found: Observed) -> Floats:
        """Return predicted less measured coordinates that were seen, as one row [mm]."""
        return fill_gaps(found.points, self.observation.measured)[self.seen]

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which coordinates were seen, (n, m, 3)."""
        return np.asarray(np.isfinite(self.observation.measured))

    @property
    def limits(self) -> tuple[Floats, Floats, Floats]:
        """Bounds of the changes, and where a search begins, (k,) each."""
        rows = [one.limit(self.observation.setup) for one in self.unknowns]
        low, high, begin = np.asarray(rows, dtype=np.float64).reshape(-1, 3).T
        return low, high, begin

    def run(self, start: Floats, *, loss: Loss, limit: int = EVALUATIONS) -> _Found:
        """Return where the search ends."""
        low, high, _ = self.limits
        last: list[tuple[Floats, Observed]] = []

        def observe(changes: Floats) -> Observed:
            if not last or not np.array_equal(last[0][0], changes):
                last[:] = [(changes.copy(), self.observation.change(self.unknowns, changes))]
            return last[0][1]

        def slope(changes: Floats) -> Floats:
            rates = self.observation.differentiate(self.unknowns, changes, observe(changes))
            return np.nan_to_num(rates[self.seen])

        if self.unknowns and np.abs(start).max() < NEARLY_NONE:
            start = np.zeros_like(start)
        if not self.unknowns:
            found = observe(start)
            return _Found(start, found, np.zeros((int(self.seen.sum()), 0)), 1, 1)
        search = LeastSquares(
            misfit=lambda changes: self.miss(observe(changes)),
            slope=slope,
            bounds=(low, high),
            scale="jac",
            loss=loss,
            loss_scale=self.scale,
            xtol=1e-6,
            ftol=1e-6,
            gtol=FLAT,
        )
        end = search.descend(np.clip(start, low, high), evaluations=limit)
        return _Found(end.point, observe(end.point), slope(end.point), end.status, end.evaluations)


@dataclass(frozen=True)
class _Found:
    """Where a search ended: changes, what they predict, and derivatives."""

    changes: Floats
    observed: Observed
    jacobian: Floats
    status: int
    evaluations: int


def fill_gaps(points: Floats, measured: Floats) -> Floats:
    """Return predicted less measured points; the span of the measured ones without a shape."""
    span = float(np.nanmax(measured) - np.nanmin(measured))
    missed = points - measured
    return np.asarray(np.where(np.isfinite(points), missed, span))


def _search_all(search: _Search) -> tuple[_Found, _Search]:
    """Return the best fit to all rows, and how it was searched for at the end."""
    start = search.limits[2]
    first = search.run(start, loss="linear")
    scatter = measure_scatter(search.miss(first.observed))
    if search.loss == "linear" or not search.unknowns or scatter < LEAST_SCATTER_MM:
        return first, dataclasses.replace(search, loss="linear")
    robust = dataclasses.replace(search, scale=ROBUST * scatter)
    found = robust.run(first.changes, loss=search.loss)
    evaluations = found.evaluations + first.evaluations
    return dataclasses.replace(found, evaluations=evaluations), robust


def _leave_idle(search: _Search, found: _Found) -> _Found:
    """Return the fit with numbers that have no effect as they were, their derivatives 0.

    Such derivatives are round-off of the model: they would be scaled to length 1.
    """
    low, high, _ = search.limits
    width = np.where(np.isfinite(high - low), 0.5 * (high - low), search.observation.data.span)
    scatter = float(np.sqrt(np.mean(search.miss(found.observed) ** 2)))
    least = max(IDLE * scatter, LEAST_SCATTER_MM)
    moved = width * np.sqrt(np.mean(found.jacobian**2, axis=0))
    for index in np.flatnonzero(moved <= least):
        changes, jacobian = found.changes.copy(), found.jacobian.copy()
        changes[index], jacobian[:, index] = 0.0, 0.0
        observed = search.observation.change(search.unknowns, changes)
        both = observed.answered & found.observed.answered
        apart = (observed.points - found.observed.points)[search.seen & both[:, None, None]]
        if np.linalg.norm(apart) <= least * np.sqrt(apart.size):  # else it acts elsewhere
            found = dataclasses.replace(
                found, changes=changes, observed=observed, jacobian=jacobian
            )
    return found


def _find_outliers(search: _Search, found: _Found) -> tuple[int, ...]:
    """Return the rows of the data with a coordinate of less than half weight."""
    weight, _ = weigh(search.miss(found.observed) / search.scale, search.loss)
    rows = np.broadcast_to(search.observation.rows[:, None, None], search.seen.shape)
    return tuple(np.unique(rows[search.seen][weight < HALF]).tolist())


def fit_robot(
    robot: ContinuumRobot | RobotSetup,
    data: RobotMeasurements,
    *,
    free: Sequence[str],
    options: RobotFitOptions = DEFAULT_OPTIONS,
    progress: Progress = no_progress,
) -> RobotFit:
    """Fit numbers of a robot so that points of its body are where they were measured.

    The sum of squared distances is made small, or that of a robust loss, over all points seen. If
    all of ``base`` is free the base begins where the points fit best as they are. A row without a
    converged shape counts with the shape that was found.

    The intervals are of a jackknife of blocks: rows that follow each other are not taken as
    independent, but in at most 10 runs, or by the labels of the data if there are 5 or more (see
    `bozzini.numeric.estimation`). They hold if the model is right for the rows: other motions of
    the same robot can ask for other constants.

    Blocks of rows are left out in turn and predicted. Fits with fewer of the names are tried in the
    same way: first all of them with the model linearised at the fit, then the best one as it is.

    Parameters
    ----------
    robot : ContinuumRobot or RobotSetup
        Where the fit begins, and all that is not free; a setup has zeros of the tendons as well.
    data : RobotMeasurements
        What was measured; its markers are those of the fit.
    free : sequence of str
        Names of what is fitted, see `bozzini.continuum.unknowns.parse_unknowns`; with none of
        them the robot is compared as it is.
    options : RobotFitOptions
        Model, loss and validation.
    progress : callable
        Is called with what is done, and how much of it.

    Returns
    -------
    RobotFit

    Raises
    ------
    InputError
        If a name is unknown, there are fewer numbers than constants, a random split tests no
        prediction, or the model does not take such commands.
    """
    if isinstance(free, str):
        raise InputError(f"free is '{free}': it must be a sequence of names, such as ['{free}']")
    setup = robot if isinstance(robot, RobotSetup) else RobotSetup.of(robot)
    setup = dataclasses.replace(setup, markers=data.markers, dynamics=options.dynamics)
    unknowns = parse_unknowns(free, setup)
    rubs = any(one.field == "friction" for one in unknowns)
    moves = options.dynamics is not None
    named = options.model or ("rod" if rubs and not moves else "")
    observation = make_observation(setup, data, named, options.model_options)
    if rubs and not moves and not CONTINUUM_MODELS.choose(observation.model).takes_friction:
        raise InputError(
            f"the {observation.model} model leaves out the friction of tendons, which is free: "
            "take the rod model"
        )
    seen = int(np.isfinite(data.points).sum())
    if seen <= len(unknowns):
        raise InputError(f"{seen} coordinate(s) are too few for {len(unknowns)} constant(s)")
    if unknowns and data.span == 0.0:
        place = ", ".join(f"{value:g}" for value in data.points[data.seen_rows[0]].T[:, 0])
        raise InputError(
            f"all points of {len(data.seen_rows)} row(s) coincide at ({place}) mm: a fit asks for "
            "points that move"
        )
    by_motion = options.split in ("kinds", "amplitude") and options.folds > 0
    enough = bool(unknowns) or len(data.seen_rows) >= max(options.folds, 2)
    folds = make_folds(data, options) if enough and not by_motion else ()
    labels = _label_blocks(data, folds) if options.split == "blocks" else ()
    progress("aligning", 0.0)
    if _frees_base(unknowns):
        observation = dataclasses.replace(observation, setup=align_base(observation))
    progress("fitting", 0.1)
    search = _Search(observation, unknowns, options.loss)
    found, search = _search_all(search)
    found = _leave_idle(search, found) if unknowns else found

    def leave_out(done: float) -> None:
        progress("leaving out blocks", 0.5 + 0.3 * done)

    def leave_out_fewer(done: float) -> None:
        progress("trying fewer constants", 0.8 + 0.2 * done)

    if by_motion:
        labels, folds = _split_motions(search, found, options)
    validation = smaller = left = None
    if folds:
        left = _leave_rows_out(search, found.changes, folds, options, leave_out)
        if unknowns:
            names = tuple(one.name for one in unknowns)
            validation = left.validate(names, left.missed, labels)
        if validation is not None and options.smaller and len(unknowns) > 1:
            smaller = _try_smaller(search, found, folds, validation, options, leave_out_fewer)
    progress("fitted", 1.0)
    fit = _conclude(search, found, validation=validation, smaller=smaller)
    return fit if left is None else _conclude_left_out(fit, left, folds, options)


def _frees_base(unknowns: Sequence[Unknown]) -> bool:
    """Return whether all of the base's pose is free."""
    return sum(one.group == "base" for one in unknowns) == len(FIELDS["base"])


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
    return _compare(observation, observation.observe(setup))


def _compare(observation: Observation, found: Observed) -> RobotPrediction:
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


# Validation.

Folds = tuple[NDArray[np.int64], ...]
"""The rows of each block that is left out."""


def make_folds(data: RobotMeasurements, options: RobotFitOptions) -> Folds:
    """Return the rows of each block that is left out.

    Raises
    ------
    InputError
        If there are too few rows or labels, or a random split tests no prediction.
    """
    if not options.folds:
        return ()
    rows = data.seen_rows
    labels = np.unique(data.blocks[rows])
    if options.split == "random":
        if data.is_ordered:
            raise InputError(
                "a random split tests no prediction of rows in time order, whose neighbours are "
                "alike: leave out blocks"
            )
        rows = np.random.default_rng(0).permutation(rows)
    elif len(labels) > 1:
        return tuple(rows[data.blocks[rows] == label] for label in labels)
    if len(rows) < options.folds:
        legal = f"2 to {len(rows)}, or 0 for none" if len(rows) > 1 else "0 for none"
        raise InputError(
            f"{len(rows)} row(s) are too few for {options.folds} folds: --folds must be {legal}"
        )
    return tuple(np.sort(part) for part in np.array_split(rows, options.folds))


def _name_sections(robot: ContinuumRobot) -> tuple[str, ...]:
    return tuple(section.name or str(k + 1) for k, section in enumerate(robot.sections))


def _label_blocks(data: RobotMeasurements, folds: Folds) -> tuple[str, ...]:
    """Return the labels that the data give the rows of each block; none if these are runs."""
    labels = tuple(str(data.blocks[fold[0]]) for fold in folds)
    return labels if len(set(labels)) > 1 else ()


def _split_motions(
    search: _Search, found: _Found, options: RobotFitOptions
) -> tuple[tuple[str, ...], Folds]:
    """Return blocks of rows by their motion, as the fit bends the sections, and what they are."""
    observation, rows = search.observation, search.observation.rows
    setup = change_setup(observation.setup, search.unknowns, found.changes)
    states = SectionStates.of(setup, found.observed.shape, found.observed.points)
    bends = np.nan_to_num(states.bends)
    largest = bends.max(axis=0)
    if options.split == "amplitude":
        far = np.max(bends / np.where(largest > 0.0, largest, np.inf), axis=-1)
        parts = np.array_split(np.argsort(far, kind="stable"), options.folds)
        if len(rows) < options.folds or not far.any():
            raise InputError(
                f"{len(rows)} row(s) in which sections bend by up to {largest.max():.3g} rad are "
                f"too few, or bend too little, for {options.folds} blocks by amplitude"
            )
        labels = tuple(f"to {far[part].max():.0%}" for part in parts)
        return labels, tuple(np.sort(rows[part]) for part in parts)
    kinds = name_kinds(bends, largest, _name_sections(setup.robot))
    blocks = {str(kind): rows[kinds == kind] for kind in np.unique(kinds)}
    kept = {kind: block for kind, block in blocks.items() if len(block) >= FEWEST_OF_KIND}
    if len(kept) < 2:
        raise InputError(
            f"there is {len(kept)} kind of motion with {FEWEST_OF_KIND} rows or more: to leave "
            "kinds out the rows must have 2"
        )
    return tuple(kept), tuple(kept.values())


class _LeftOut(NamedTuple):
    """What fits to other rows predict of those left out: predicted less measured [mm]."""

    rows: NDArray[np.int64]
    blocks: NDArray[np.int64]
    missed: Floats
    corrected: Floats
    bends: Floats

    def validate(
        self, names: tuple[str, ...], missed: Floats, labels: tuple[str, ...] = ()
    ) -> Validation:
        """Return the errors of these misses."""
        blocks = [_measure_rms(missed[self.blocks == k]) for k in np.unique(self.blocks)]
        return Validation(names, _measure_rms(missed), tuple(blocks), labels)


def _measure_rms(missed: Floats) -> float:
    """Return the root mean square length of vectors (..., 3) that are there [mm]; NaN of none."""
    squares = np.sum(np.square(missed), axis=-1)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if known.size else math.nan


def _leave_rows_out(
    search: _Search,
    start: Floats,
    folds: Folds,
    options: RobotFitOptions,
    progress: Callable[[float], None],
) -> _LeftOut:
    """Return what fits to the other rows, which begin at `start`, predict of each block."""
    progress(0.0)
    todo = [_Task(search, start, folds, k, options.residual) for k in range(len(folds))]
    parts: list[_LeftOut] = []
    jobs = options.jobs
    for one in _leave_out_apart(todo, jobs) if jobs > 1 else map(_leave_out, todo):
        parts.append(one)
        progress(len(parts) / len(todo))
    return _LeftOut(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


class _Task(NamedTuple):
    """A block to leave out."""

    search: _Search
    start: Floats
    folds: Folds
    left: int
    residual: bool


def _leave_out_apart(todo: Sequence[_Task], jobs: int) -> Iterator[_LeftOut]:
    """Yield what `_leave_out` returns, in processes of their own."""
    # A forked process would inherit the locks of the threads of compiled loops.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        min(jobs, len(todo)),
        mp_context=context,
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),  # this process ends them
    )
    try:
        yield from pool.map(_leave_out, todo)
    except BrokenProcessPool:
        raise BozziniError(
            "a process of the fit ended: it was out of memory, or a script calls fit_robot outside "
            "of \"if __name__ == '__main__':\"; with 1 job there are no processes"
        ) from None
    except BaseException:  # an interrupt must not wait for the blocks that are left
        for process in pool._processes.values():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_out(todo: _Task) -> _LeftOut:
    """Return what a fit to the other rows predicts of a block."""
    search, fold = todo.search, todo.folds[todo.left]
    observation = search.observation
    kept = np.setdiff1d(observation.rows, fold)
    inside = dataclasses.replace(search, observation=dataclasses.replace(observation, rows=kept))
    found = inside.run(todo.start, loss=search.loss)
    outside = dataclasses.replace(observation, rows=fold)
    setup = change_setup(observation.setup, search.unknowns, found.changes)
    there = outside.observe(setup)
    missed = fill_gaps(there.points, outside.measured)
    states = SectionStates.of(setup, there.shape, there.points)
    corrected = missed
    if todo.residual:
        own = SectionStates.of(setup, found.observed.shape, found.observed.points)
        left = -fill_gaps(found.observed.points, inside.observation.measured)
        residual = learn_residual(own, left, _label(kept, todo.folds))
        corrected = missed + residual.shift(states)
    return _LeftOut(fold, np.full(len(fold), todo.left), missed, corrected, states.bends)


def _label(rows: NDArray[np.int64], folds: Folds) -> NDArray[np.int64]:
    """Return the number of the block of each row; one more for rows of none."""
    labels = np.full(len(rows), len(folds))
    for k, fold in enumerate(folds):
        labels[np.isin(rows, fold)] = k
    return labels


def _predict_baselines(data: RobotMeasurements, robot: ContinuumRobot, folds: Folds
                       ) -> tuple[Validation, ...]:  # fmt: skip
    """Return what commands alone predict of each block from the others."""
    commands = data.order_commands(robot)
    parts: dict[str, list[Floats]] = {}
    for fold in folds:
        kept = np.setdiff1d(data.seen_rows, fold)
        there = predict_by_commands(commands[kept], data.points[kept], commands[fold])
        for name, points in there.items():
            parts.setdefault(name, []).append(points - data.points[fold])
    return tuple(
        Validation(
            names=(name,),
            rms=_measure_rms(np.concatenate(missed)),
            blocks=tuple(_measure_rms(one) for one in missed),
        )
        for name, missed in parts.items()
    )


def _try_smaller(
    search: _Search,
    found: _Found,
    folds: Folds,
    validation: Validation,
    options: RobotFitOptions,
    progress: Callable[[float], None],
) -> Validation | None:
    """Return the validation of fewer constants, where that is better beyond chance.

    One set after the other is left out, the one without which rows left out are predicted best by
    the model linearised at the fit.
    """
    # A base that is free in all was aligned: as it was before it predicts nothing.
    aligned = _frees_base(search.unknowns)
    families: dict[str, list[int]] = {}
    for index, one in enumerate(search.unknowns):
        if aligned and one.group == "base":
            continue
        key = f"{one.group}.{one.field}" if one.group != "base" else one.field.partition(".")[0]
        families.setdefault(key, []).append(index)
    linear = _Linear.make(search, found, folds)
    kept = list(range(len(search.unknowns)))
    best, least = kept, linear.measure(kept)
    while len(families) + aligned > 1:
        trials = [
            (linear.measure([i for i in kept if i not in members]), name)
            for name, members in families.items()
        ]
        error, name = min(trials)
        left = families.pop(name)
        kept = [i for i in kept if i not in left]
        if error < least * (1.0 + 1e-3):
            best, least = kept, min(error, least)
    if len(best) == len(search.unknowns):
        return None
    fewer = dataclasses.replace(search, unknowns=tuple(search.unknowns[i] for i in best))
    again = fewer.run(found.changes[best], loss=search.loss)
    plain = dataclasses.replace(options, residual=False)
    there = _leave_rows_out(fewer, again.changes, folds, plain, progress)
    other = there.validate(tuple(one.name for one in fewer.unknowns), there.missed)
    return other if other.beats(validation) else None


@dataclass(frozen=True)
class _Linear:
    """A fit with the model linearised at its end."""

    jacobian: Floats
    target: Floats
    folds: tuple[NDArray[np.bool_], ...]

    @classmethod
    def make(cls, search: _Search, found: _Found, folds: Folds) -> _Linear:
        """Return it from where a search ended."""
        seen = search.seen
        row = np.broadcast_to(search.observation.rows[:, None, None], seen.shape)[seen]
        target = found.jacobian @ found.changes - search.miss(found.observed)
        return cls(found.jacobian, target, tuple(np.isin(row, fold) for fold in folds))

    def measure(self, kept: Sequence[int]) -> float:
        """Return the sum of squares at rows left out, with some of the unknowns."""
        total = 0.0
        for out in self.folds:
            columns = self.jacobian[:, kept]
            values = np.linalg.lstsq(columns[~out], self.target[~out], rcond=1e-9)[0]
            total += float(np.sum((self.target[out] - columns[out] @ values) ** 2))
        return total


# What is reported.


def _conclude(
    search: _Search,
    found: _Found,
    *,
    validation: Validation | None,
    smaller: Validation | None,
) -> RobotFit:
    """Put the statistics together from the residuals and the Jacobian at the minimum."""
    observation, unknowns = search.observation, search.unknowns
    names = [one.name for one in unknowns]
    setup = change_setup(observation.setup, unknowns, found.changes)
    prediction = _compare(dataclasses.replace(observation, setup=setup), found.observed)
    known = determine(found.jacobian) if unknowns else None
    estimates: tuple[Estimate, ...] = ()
    undetermined: list[str] = []
    warnings: list[str] = []
    correlations, rule = np.zeros((0, 0)), ""
    if known is not None:
        lost = {i for members, _ in find_lost(known) for i in members}
        spread = _measure_spread(search, found)
        deviations, rule = spread.deviations, spread.describe()
        setups = observation.setup, setup
        estimates = tuple(
            _estimate(one, setups, float(change), math.inf if i in lost else float(s), spread)
            for i, (one, change, s) in enumerate(
                zip(unknowns, found.changes, deviations, strict=True)
            )
        )
        correlations = known.correlations
        if not lost and deviations.all():
            correlations = spread.covariance / np.outer(deviations, deviations)
        undetermined = describe_lost(names, known)
        if any(one.field == "friction" for one in unknowns):
            warnings.append(
                "intervals are lower bounds where friction is free: shapes after a history jump "
                "with its coefficient"
            )
        if not undetermined:
            warnings += judge_fit(names, known.correlations, known.condition)
        low, high, _ = search.limits
        inside = (low + AT_BOUND < found.changes) & (found.changes < high - AT_BOUND)
        warnings += describe_bounds(names, ~inside)
    if setup.backlash > 0.0 and observation.data.commands[0].any():
        warnings.append(
            "the play before the first row is unknown: its command is taken to act in full; if the "
            "recording began at rest, begin the table with a row of zero commands and no point"
        )
    if not prediction.converged:
        warnings.append(
            f"{int((~found.observed.answered).sum())} of {len(observation.rows)} rows have no "
            f"converged shape: {prediction.reason}"
        )
    fit = RobotFit(
        setup=setup,
        estimates=estimates,
        correlations=correlations,
        condition=1.0 if known is None else known.condition,
        interval_rule=rule,
        prediction=prediction,
        validation=validation,
        smaller=smaller,
        baselines=(),
        section_residual=None,
        corrected=None,
        band=None,
        model_band=None,
        undetermined=tuple(undetermined),
        warnings=tuple(warnings),
        outliers=_find_outliers(search, found),
        data=observation.data,
        model=observation.model,
        model_options=observation.options,
        converged=found.status > 0,
        reason=explain_end(found.status, EVALUATIONS, what="constants"),
        evaluations=found.evaluations,
    )
    if fit.data.span == 0.0:
        return dataclasses.replace(fit, warnings=(*fit.warnings, fit.describe_error()))
    if fit.is_far:
        poor = f"the fit is poor: {fit.describe_error()}"
        return dataclasses.replace(fit, warnings=(*fit.warnings, poor))
    return fit


def _conclude_left_out(
    fit: RobotFit, left: _LeftOut, folds: Folds, options: RobotFitOptions
) -> RobotFit:
    """Return the fit with what the rows left out tell: band, residual, and baselines beside it."""
    data, prediction = fit.data, fit.prediction
    baselines = _predict_baselines(data, fit.setup.robot, folds)
    residual = corrected = None
    if options.residual:
        rows = data.seen_rows
        missed = (data.points - prediction.predicted)[rows]
        residual = learn_residual(prediction.states.select(rows), missed, _label(rows, folds))
        corrected = left.validate(("residual",), left.corrected)
    band, own = (
        make_band(
            np.asarray(np.linalg.norm(missed, axis=-1)),
            left.bends,
            left.blocks,
            markers=prediction.markers,
            sections=_name_sections(fit.setup.robot),
        )
        for missed in (left.corrected, left.missed)
    )
    fit = dataclasses.replace(
        fit,
        baselines=baselines,
        section_residual=residual,
        corrected=corrected,
        band=band,
        model_band=own,
    )
    better = min(baselines, key=lambda one: one.rms, default=None)
    error = fit.error if corrected is None else corrected.rms
    if better is None or not better.rms < error:
        return fit
    poor = "" if fit.better is None else "the fit is poor: "
    hint = "" if options.residual else ": learn a residual on top of the model"
    text = (
        f"{poor}{better.names[0]} predicts rows left out better, {better.rms:.3g} mm against "
        f"{error:.3g} mm{hint}"
    )
    return dataclasses.replace(fit, warnings=(*fit.warnings, text))


def _estimate(
    one: Unknown,
    setups: tuple[RobotSetup, RobotSetup],
    change: float,
    error: float,
    spread: FitCovariance,
) -> Estimate:
    """Return a number, of setups before and after, with its interval.

    That of a factor is even in its logarithm. A base that is turned has the rotation vector of
    where it ends.
    """
    half = spread.factor * error
    before, after = setups
    start = one.read(before)
    if one.known.change == "shift":
        value = change + (start or 0.0)
        if one.field.startswith("rotation"):
            value = after.robot.base_rotation["xyz".index(one.field[-1])]
        low, high = value - half, value + half
        if one.known.begin and math.isfinite(half):
            lowest, highest, _ = one.limit(before)
            low, high = max(low, lowest + (start or 0.0)), min(high, highest + (start or 0.0))
        return Estimate(one.name, value, low, high, one.known.unit, error, "shift")
    factor, unit = (1.0, "") if start is None else (start, one.known.unit)
    value = factor * math.exp(change)
    low, high = (
        (0.0, math.inf) if half > 50.0 else (value * math.exp(-half), value * math.exp(half))
    )
    return Estimate(one.name, value, low, high, unit, value * error)


def _measure_spread(search: _Search, found: _Found) -> FitCovariance:
    """Return the covariance of the changes."""
    data, rows = search.observation.data, search.observation.rows
    misfit, seen = search.miss(found.observed), search.seen
    row = np.broadcast_to(np.arange(len(seen))[:, None, None], seen.shape)[seen]
    return measure_spread(
        found.jacobian,
        misfit,
        make_blocks(data.blocks[rows]),
        rows=row,
        weights=weigh(misfit / search.scale, search.loss),
    )
