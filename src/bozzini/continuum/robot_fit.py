"""Fit a robot to measured points, and report what the data do not determine."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..checks import show_apart
from ..errors import InputError
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
from ..numeric.least_squares import describe_bounds, explain_end, weigh
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, rows_of, tabulated, to_plain
from .calibration import RobotCalibration
from .command_baselines import predict_by_commands
from .fit_search import (
    DEFAULT_OPTIONS,
    EVALUATIONS,
    FitSearch,
    FoundChanges,
    RobotFitOptions,
    find_outliers,
    frees_base,
    leave_idle,
    search_all,
)
from .kinematics import ContinuumRobot
from .left_out import (
    Folds,
    LeftOutRows,
    Validation,
    label_blocks,
    label_rows,
    leave_rows_out,
    make_folds,
    name_sections,
    predict_baselines,
    split_motions,
    try_smaller,
)
from .measured import RobotMeasurements
from .models import CONTINUUM_MODELS
from .observation import align_base
from .prediction_band import SLACK, PredictionBand, make_band
from .robot_prediction import (
    RobotPrediction,
    compare_points,
    make_observation,
    measure_rms,
    predict_points,
)
from .section_residual import SectionResidual, learn_residual
from .unknowns import Change, RobotSetup, Unknown, change_setup, parse_unknowns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POOR_SHARE = 0.05
"""Of the robot's length or the span of the points: a fit that misses by more is poor."""
POOR_RATIO = 1.2
"""A fit is poor if it misses by so many times what commands alone do, beyond chance."""
AT_BOUND = 1e-6
"""Distance from a bound that counts as none."""


@dataclass(frozen=True)
class Estimate(Shown):
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
            errors = {name: measure_rms(points - data.points[rows])
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
            "poor": self.is_poor,
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
    never = ~np.isfinite(data.points).all(axis=-1).any(axis=0)
    if never.any():
        name = data.markers[int(np.argmax(never))].name
        raise InputError(f"marker '{name}' was seen in no row: leave it out")
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
    labels = label_blocks(data, folds) if options.split == "blocks" else ()
    progress("aligning", 0.0)
    if frees_base(unknowns):
        observation = dataclasses.replace(observation, setup=align_base(observation))
    progress("fitting", 0.1)
    search = FitSearch(observation, unknowns, options.loss)
    found, search = search_all(search)
    found = leave_idle(search, found) if unknowns else found

    def leave_out(done: float) -> None:
        progress("leaving out blocks", 0.5 + 0.3 * done)

    def leave_out_fewer(done: float) -> None:
        progress("trying fewer constants", 0.8 + 0.2 * done)

    if by_motion:
        labels, folds = split_motions(search, found, options)
    validation = smaller = left = None
    if folds:
        left = leave_rows_out(search, found.changes, folds, options, leave_out)
        if unknowns:
            names = tuple(one.name for one in unknowns)
            validation = left.validate(names, left.missed, labels)
        if validation is not None and options.smaller and len(unknowns) > 1:
            smaller = try_smaller(search, found, folds, validation, options, leave_out_fewer)
    progress("fitted", 1.0)
    fit = _conclude(search, found, validation=validation, smaller=smaller)
    return fit if left is None else _conclude_left_out(fit, left, folds, options)


def _conclude(
    search: FitSearch,
    found: FoundChanges,
    *,
    validation: Validation | None,
    smaller: Validation | None,
) -> RobotFit:
    """Put the statistics together from the residuals and the Jacobian at the minimum."""
    observation, unknowns = search.observation, search.unknowns
    names = [one.name for one in unknowns]
    setup = change_setup(observation.setup, unknowns, found.changes)
    prediction = compare_points(dataclasses.replace(observation, setup=setup), found.observed)
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
        outliers=find_outliers(search, found),
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
    fit: RobotFit, left: LeftOutRows, folds: Folds, options: RobotFitOptions
) -> RobotFit:
    """Return the fit with what the rows left out tell: band, residual, and baselines beside it."""
    data, prediction = fit.data, fit.prediction
    baselines = predict_baselines(data, fit.setup.robot, folds)
    residual = corrected = None
    if options.residual:
        rows = data.seen_rows
        missed = (data.points - prediction.predicted)[rows]
        residual = learn_residual(prediction.states.select(rows), missed, label_rows(rows, folds))
        corrected = left.validate(("residual",), left.corrected)
    band, own = (
        make_band(
            np.asarray(np.linalg.norm(missed, axis=-1)),
            left.bends,
            left.blocks,
            markers=prediction.markers,
            sections=name_sections(fit.setup.robot),
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
    if band.coverage < band.level - SLACK:
        text = (
            f"of rows left out {band.coverage:.1%} are within a band for {band.level:.0%}: blocks "
            "are unlike each other, so that rows like none of them may miss by more"
        )
        fit = dataclasses.replace(fit, warnings=(*fit.warnings, text))
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


def _measure_spread(search: FitSearch, found: FoundChanges) -> FitCovariance:
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
