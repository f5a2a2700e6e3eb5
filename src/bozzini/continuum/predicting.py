"""What a fitted robot predicts of commands, and how far that may be off: the band of its fit."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import quantity
from ..errors import InputError
from ..io.sheets import parse_columns
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes, to_plain
from ..task import Task
from .calibration import Marker
from .kinematics import ContinuumRobot
from .measured import TIP, RobotRows, read_robot_rows
from .observation import convert_rows, place_markers, solve_rows
from .prediction_band import SLACK
from .robot_prediction import choose_model
from .section_residual import measure_bends
from .shape import Shape
from .unknowns import RobotSetup

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WORLD = "world"
"""Frame of markers: the one that the fit's measurements are in."""


class BandAtRows(NamedTuple):
    """What the band of a fit says of rows.

    Attributes
    ----------
    kinds : (n,) ndarray of str
        Kinds of motion, by the sections that move; empty of a row without a shape.
    radii : (n, m) ndarray
        Distances that predictions of the markers stay within [mm]; NaN where no row of the fit was
        of this kind, of a marker that was not fitted, and of a row without a shape.
    level : float
        Share of predictions that do.
    coverage : float
        Share of the points left out of the fit that a band made without their block held.
    """

    kinds: NDArray[np.str_]
    radii: Floats
    level: float
    coverage: float


def find_band(robot: ContinuumRobot, shape: Shape, markers: Sequence[str]) -> BandAtRows | None:
    """Return what the band of a robot's fit says of shapes (n,), or of a single one as n = 1.

    None without a band.
    """
    band = None if robot.calibration is None else robot.calibration.band
    if band is None:
        return None
    bends = np.atleast_2d(measure_bends(robot, shape))
    kinds = band.name_kinds(bends)
    known = band.find_radii(kinds)
    radii = np.full((len(bends), len(markers)), np.nan)
    for k, name in enumerate(markers):
        if name in band.markers:
            radii[:, k] = known[:, band.markers.index(name)]
    without = ~(np.isfinite(bends).all(axis=-1) & np.ravel(shape.converged))
    radii[band.find_unseen(kinds) | without] = np.nan
    return BandAtRows(np.where(without, "", kinds), radii, band.level, band.coverage)


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictedRows(Result):
    """Where markers of a robot are predicted, in the order of the commands.

    Attributes
    ----------
    rows : RobotRows
        Commands, and where markers were seen.
    markers : tuple of str
    predicted : (n, m, 3) ndarray
        In the world [mm]; NaN of rows without a shape.
    answered : (n,) ndarray of bool
        Which rows have a converged shape.
    reason : str
        Why the first row without one has none.
    band : BandAtRows, optional
        None of a robot whose fit left no rows out.
    notes : tuple of str
    """

    rows: RobotRows
    markers: tuple[str, ...]
    predicted: Floats
    answered: NDArray[np.bool_]
    reason: str
    band: BandAtRows | None
    notes: tuple[str, ...]

    @property
    def converged(self) -> bool:
        """Whether all rows have a shape."""
        return bool(self.answered.all())

    @property
    def distances(self) -> Floats:
        """From predicted to measured (n, m) [mm]; NaN where a marker was not seen."""
        return np.asarray(np.linalg.norm(self.predicted - self.rows.points, axis=-1))

    @property
    def rms(self) -> float:
        """Root mean square distance of the points seen [mm]; NaN if none was."""
        seen = self.distances[np.isfinite(self.distances)]
        return float(np.sqrt(np.mean(np.square(seen)))) if seen.size else math.nan

    @property
    def residual(self) -> float:
        """`rms` [mm], 0 if no point was seen."""
        return 0.0 if math.isnan(self.rms) else self.rms

    @property
    def coverage(self) -> float:
        """Share of the points seen that are within the band, of kinds that it has; NaN if none."""
        if self.band is None:
            return math.nan
        known = np.isfinite(self.band.radii + self.distances)
        return (
            float(np.mean((self.distances <= self.band.radii)[known])) if known.any() else math.nan
        )

    @property
    def outside(self) -> dict[str, int]:
        """Rows of each kind of motion that no row of the fit was of."""
        if self.band is None:
            return {}
        strange = np.isnan(self.band.radii).all(axis=1) & (self.band.kinds != "")
        kinds, counts = np.unique(self.band.kinds[strange], return_counts=True)
        return dict(zip(kinds.tolist(), counts.tolist(), strict=True))

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`, a row for each row of the commands."""
        columns: Json = {"row": np.arange(1, len(self.predicted) + 1)}
        for k, name in enumerate(self.markers):
            for i, axis in enumerate("xyz"):
                columns[f"{name}_{axis}_mm"] = self.predicted[:, k, i]
            if self.band is not None:
                columns[f"{name}_within_mm"] = self.band.radii[:, k]
            if np.isfinite(self.distances[:, k]).any():
                columns[f"{name}_error_mm"] = self.distances[:, k]
        if self.band is not None:
            columns["moved"] = self.band.kinds
        return columns | {"converged": self.answered}

    def to_dict(self) -> Json:
        """Return the prediction as plain values, with the table."""
        values = {
            "frame": WORLD,
            "markers": self.markers,
            "level": None if self.band is None else self.band.level,
            "outside": self.outside,
            "points_seen": int(np.isfinite(self.distances).sum()),
            "rms_mm": self.rms,
            "coverage": self.coverage,
            "coverage_left_out": None if self.band is None else self.band.coverage,
            "notes": self.notes,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "columns": self.list_columns(),
        }
        return {name: to_plain(value) for name, value in values.items()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw where the first marker is, with its band, over the rows; return the axes."""
        axes = take_axes(ax, x="row", y=f"{self.markers[0]} [mm]")
        row = np.arange(1, len(self.predicted) + 1)
        for i, axis in enumerate("xyz"):
            places = self.predicted[:, 0, i]
            (line,) = axes.plot(row, places, label=axis)
            if self.band is not None:
                ends = places - self.band.radii[:, 0], places + self.band.radii[:, 0]
                axes.fill_between(row, *ends, alpha=0.2, color=line.get_color(), linewidth=0.0)
            axes.plot(row, self.rows.points[:, 0, i], ".", color=line.get_color(), markersize=3)
        axes.legend()
        return axes


def list_markers(robot: ContinuumRobot) -> tuple[Marker, ...]:
    """Return the markers of a robot's fit; of one without, the tip."""
    own = () if robot.calibration is None else robot.calibration.markers
    return own or (Marker(name=TIP),)


def predict_rows(robot: ContinuumRobot, rows: RobotRows) -> PredictedRows:
    """Return where a robot's markers are under commands in the order of time.

    Parameters
    ----------
    robot : ContinuumRobot
        A fitted one is modelled as it was fitted.
    rows : RobotRows
        Points are those of `list_markers`.

    Raises
    ------
    InputError
        If the robot was fitted to other commands.
    """
    known = robot.calibration
    if known is not None and known.command != rows.command:
        raise InputError(
            f"the commands are {rows.command}s: robot '{robot.name}' was fitted to {known.command}s"
        )
    setup = dataclasses.replace(RobotSetup.of(robot), markers=list_markers(robot))
    pulled = rows.command == "tension"
    name, options = choose_model(robot, rows.command)
    model = robot.model(name, **options)
    every = np.arange(len(rows.commands))
    shape = solve_rows(
        model, convert_rows(setup, rows.commands, pulled=pulled), pulled=pulled, rows=every
    )
    points = place_markers(setup, shape)
    names = tuple(marker.name for marker in setup.markers)
    answered = np.asarray(shape.converged)
    points[~answered] = np.nan
    reasons = shape.reason[~answered]
    return PredictedRows(
        rows=rows,
        markers=names,
        predicted=points,
        answered=answered,
        reason=f"row {int(np.argmin(answered)) + 1}: {reasons[0]}" if len(reasons) else "",
        band=find_band(robot, shape, names),
        notes=(*rows.notes, *model.notes),
    )


@dataclass(frozen=True, kw_only=True)
class RobotPredicting(Task):
    """Predict where the markers of a fitted robot are, row by row, and how far they may be off.

    ROBOT is what 'bozzini continuum fit --out' wrote; TABLE has commands in the order of time, as
    that reads them, and perhaps the markers, to be compared. Places are in the world. The band, the
    distance that 95 % of predictions stay within, is that of rows left out of the fit, of the same
    kind of motion: the sections that move. Rows of a kind that no row of the fit was of have none,
    and are counted.

    Exit code 0: done; 1: a row has no shape; 2: bad input.
    """

    name = "predict"
    group = "continuum"
    result = PredictedRows

    robot: str = quantity("file", "A robot file.")
    table: str = quantity("file", "Commands over time.")
    column: tuple[str, ...] = quantity(
        "text",
        "TITLE=OLD: a title to read in place of one in the file; can be repeated.",
        default=(),
        example="T1 tension [N]=load cell 1",
    )

    def run(self, progress: Progress = no_progress) -> PredictedRows:
        """Return the prediction."""
        robot = ContinuumRobot.from_yaml(self.robot)
        columns = parse_columns(self.column)
        rows = read_robot_rows(self.table, robot, markers=list_markers(robot), columns=columns)
        return predict_rows(robot, rows)

    def describe(self, found: PredictedRows) -> str:
        """Return how far predictions are off, as it is known and as it was measured."""
        head = f"{len(found.predicted)} rows, {', '.join(found.markers)} in the {WORLD}"
        lines = [head] if found.converged else [f"{head}, {found.answered.sum()} with a shape"]
        if found.band is None:
            lines.append("how far predictions miss is not known: no rows were left out of a fit")
        else:
            kinds, first = np.unique(found.band.kinds, return_index=True)
            shown = ", ".join(
                f"{kind} {'/'.join(f'{value:.3g}' for value in found.band.radii[row])}"
                for kind, row in zip(kinds.tolist(), first.tolist(), strict=True)
                if kind and kind not in found.outside
            )
            lines.append(
                f"{found.band.level:.0%} of predictions are within [mm], by the sections that "
                f"move: {shown or 'none known'}; of rows left out of the fit "
                f"{found.band.coverage:.1%} were"
            )
        if not math.isnan(found.rms):
            count = int(np.isfinite(found.distances).sum())
            lines.append(f"{count} points seen: {found.rms:.3g} mm rms")
            if found.band is not None and not math.isnan(found.coverage):
                lines[-1] += f", {found.coverage:.1%} of those with a band within it"
                if found.coverage < found.band.level - SLACK:
                    lines.append(
                        "warning: far fewer than the band promises: these rows are unlike those of "
                        "the fit, in direction for example, which the kinds do not tell"
                    )
        if found.outside:
            shown = ", ".join(f"{kind} ({count} rows)" for kind, count in found.outside.items())
            lines.append(
                f"warning: sections move together, or as far, as in no row of the fit: {shown}; "
                "how far predictions miss there is not known"
            )
        return "\n".join([*lines, *(f"note: {note}" for note in found.notes),
                          *filter(None, [found.reason])])  # fmt: skip
