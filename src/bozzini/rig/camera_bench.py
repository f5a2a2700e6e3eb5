"""A muscle characterised by a camera: a picture at each step, the lengths in them, and a fit.

This is the experiment of thesis 3.2 from one end to the other. The pressure goes in stairs under
one or several weights; at each step a camera takes a picture; the distance of two rings is measured
in it; contractions are counted from the muscle without pressure under the least weight; a model is
fitted to them. As the weight stretches the muscle from which contractions are counted, an offset is
fitted with the constants.

The stiffness at a pressure is the slope of the weight over the length, by least squares.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..io.files import write_text
from ..io.sheets import format_table, write_table
from ..muscle import Calibration, Muscle, MuscleModel, calibrate, write_muscle
from ..muscle.data import Measurements
from ..muscle.muscle_fit import FitOptions, show_estimate
from ..progress import Progress, no_progress
from ..results import Json, ReasonedResult, Shown, take_axes
from ..vision import Camera, LengthOptions, LengthSeries, RenderedSetup, StripBoard, measure_series
from ..vision.pictures import import_opencv, read_manifest, write_picture
from .characterise import Characterisation, PictureSource, characterise_muscle
from .host import Host
from .plant import Chamber
from .stairs import Stairs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FREE = ("modulus", "braid_angle", "offset")
"""What is fitted by default: tube, braid, and what contractions are counted from."""
SPREAD_95 = 1.96
"""Standard deviations that hold 95 % of a normal error either side."""
SETTLING_FRAMES = 5
"""Frames of a camera that are let go before each picture: its driver keeps some of the past."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedCamera(PictureSource):
    """Renders the muscle of a plant as it truly is at each moment.

    Parameters
    ----------
    folder : Path
    read : callable
        Returns the contraction of the muscle [mm].
    rest_length : float
        Distance of the rings at no contraction [mm].
    setup : RenderedSetup
    seed : int
        Of the noise of the first picture.
    """

    folder: Path
    read: Callable[[], float]
    rest_length: float
    setup: RenderedSetup
    seed: int = 0

    def take(self, path: Path, step: Mapping[str, str], *, idle: Callable[[], object]) -> list[str]:
        """Render a picture; see `PictureSource.take`."""
        number = int(path.name.partition("-")[0])
        picture = self.setup.render(self.rest_length - self.read(), seed=self.seed + number)
        write_picture(picture, path)
        return []


@dataclass(kw_only=True)
class VideoCamera(PictureSource):
    """A camera of this computer, or a film, by OpenCV; a context that lets go of it at its end.

    Parameters
    ----------
    folder : Path
    name : str
        Number of the camera, a film, or the address of a stream.
    size : (int, int), optional
        Columns and rows that it is asked for [px]: those that it was calibrated with.

    Raises
    ------
    InputError
        If it cannot be opened.
    """

    folder: Path
    name: str
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        cv2 = import_opencv()
        self._video = cv2.VideoCapture(int(self.name) if self.name.isdecimal() else self.name)
        if not self._video.isOpened():
            raise InputError(
                f"camera is '{self.name}': OpenCV cannot open it; give the number of a camera "
                "such as 0, a film, or 'rendered'"
            )
        if self.size is not None:
            self._video.set(cv2.CAP_PROP_FRAME_WIDTH, self.size[0])
            self._video.set(cv2.CAP_PROP_FRAME_HEIGHT, self.size[1])

    def __enter__(self) -> VideoCamera:
        return self

    def __exit__(self, *error: object) -> None:
        self._video.release()

    def take(self, path: Path, step: Mapping[str, str], *, idle: Callable[[], object]) -> list[str]:
        """Take a picture; see `PictureSource.take`."""
        if self.name.isdecimal():
            for _ in range(SETTLING_FRAMES):
                self._video.grab()
                idle()
        good, frame = self._video.read()
        if not good:
            return ["camera: no picture came"]
        good, packed = import_opencv().imencode(path.suffix, frame)
        path.write_bytes(packed.tobytes())
        return []


OpenRig = Callable[[float, Path], AbstractContextManager[tuple[Host, PictureSource]]]
"""Opens a rig whose muscle holds a weight [N], with a camera that writes into a folder."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraBench(Shown):
    """What a characterisation by a camera does.

    Parameters
    ----------
    stairs : Stairs
        The steps of pressure; its load is that of the first run.
    weights : sequence of float
        Tensions that the muscle holds, a run each [N], from the least.
    board : StripBoard
        Behind the muscle, as it is described.
    camera : Camera, optional
        Its calibration; without one `LengthOptions.distance` is needed.
    known : LengthOptions
        What is known of the muscle.
    model : callable
        Makes the model to fit from a `Muscle`.
    muscle : Muscle
        Where the fit starts.
    free : sequence of str
        What is fitted.

    Raises
    ------
    InputError
        If there is no weight, or one is given twice.
    """

    stairs: Stairs
    weights: tuple[float, ...]
    board: StripBoard
    camera: Camera | None
    known: LengthOptions
    model: Callable[[Muscle], MuscleModel]
    muscle: Muscle
    free: tuple[str, ...] = FREE

    def __post_init__(self) -> None:
        if not self.weights or len(set(self.weights)) < len(self.weights):
            given = ", ".join(f"{weight:g} N" for weight in self.weights) or "none"
            raise InputError(f"weights are {given}: give one or more, each once")

    def run(
        self, open_rig: OpenRig, folder: Path, *, progress: Progress = no_progress
    ) -> BenchReport:
        """Take all pictures into a folder, measure the lengths in them, and fit the model.

        The manifest is written into the folder, also when an interruption ends a run: what is
        there can be measured by `bozzini vision length`. Before the first picture the fit is
        tried on what the muscle that it starts from would do.

        Raises
        ------
        InputError, OutputError
            As `characterise_muscle` and `measure_series` raise them, or if these steps and weights
            cannot tell what is to be fitted.
        """
        self._rehearse()
        runs: list[Characterisation] = []

        def keep(found: Characterisation) -> None:
            if any(row.image for run in [*runs, found] for row in run.rows):
                _write_manifest([*runs, found], folder)

        for index, weight in enumerate(self.weights):
            stairs = dataclasses.replace(self.stairs, load=weight)

            def show(stage: str, share: float, index: int = index) -> None:
                progress("pictures", (index + share) / len(self.weights))

            with open_rig(weight, folder / f"weight-{index + 1}") as (host, source):
                runs.append(
                    characterise_muscle(host, stairs, camera=source, keep=keep, progress=show)
                )
            if runs[-1].end:
                break
        manifest = read_manifest(_write_manifest(runs, folder), ("image", "pressure_kpa"))
        lengths = measure_series(
            manifest, self.board, options=self.known, camera=self.camera, progress=progress
        )
        free = _find_free(lengths)
        if free is None:
            return BenchReport(
                runs=tuple(runs), lengths=lengths, fit=None, trouble="no contraction was measured"
            )
        try:
            columns, share = lengths.list_contractions(), free["u_B_mm"] / free["length_mm"]
            fit, scaled = (self._fit(columns, scale=scale) for scale in (1.0, 1.0 + share))
        except InputError as error:
            return BenchReport(runs=tuple(runs), lengths=lengths, fit=None, trouble=str(error))
        shared = {name: abs(scaled.estimates[name] - fit.estimates[name]) for name in fit.free}
        return BenchReport(runs=tuple(runs), lengths=lengths, fit=fit, shared=shared)

    def _rehearse(self) -> None:
        """Raise `InputError` if the fit is not possible."""
        steps = self.stairs.list_steps()
        pressures = np.array([setpoint for *_, setpoint in steps])
        chambers = [Chamber.from_model(self.model(self.muscle), load) for load in self.weights]
        rest = chambers[0].contraction[0]
        contractions = [np.interp(pressures, c.pressure, c.contraction) - rest for c in chambers]
        self._fit(
            {
                "pressure [kPa]": 1e3 * np.tile(pressures, len(chambers)),
                "contraction [mm]": np.concatenate(contractions),
                "load [N]": np.repeat(self.weights, len(steps)),
                "direction": [direction for _, direction, _ in steps] * len(chambers),
            }
        )

    def _fit(self, columns: Json, *, scale: float = 1.0) -> Calibration:
        """Return the fit to contractions that are all longer by a factor."""
        measurements = Measurements(
            pressure=1e-3 * np.maximum(columns["pressure [kPa]"], 0.0),
            contraction=scale * np.array(columns["contraction [mm]"]),
            load=np.array(columns["load [N]"]),
            direction=np.array(columns["direction"]),
        )
        return calibrate(
            self.model,
            self.muscle,
            data=measurements,
            free=self.free,
            options=FitOptions(response="contraction"),
        )


def _find_free(lengths: LengthSeries) -> Json | None:
    """Return the state that contractions are counted from; None without one."""
    return next((g for g in lengths.summarise() if g.get("contraction_mm") == 0.0), None)


def _write_manifest(runs: Sequence[Characterisation], folder: Path) -> Path:
    """Write the list of all pictures, and return its path."""
    columns: dict[str, list[object]] = {}
    for run in runs:
        if not any(row.image for row in run.rows):
            continue
        listed = run.list_pictures(folder)
        count = len(listed["image"])
        for name, values in listed.items():
            own = values if isinstance(values, list) else [values] * count
            columns.setdefault(name, []).extend(own)
    if not columns:
        raise InputError("no picture was taken: " + "; ".join(run.reason for run in runs))
    return write_text(folder / "manifest.csv", format_table(columns))


@dataclass(frozen=True, kw_only=True)
class MeasuredStiffness:
    """Slope of the weight over the length at a pressure.

    Attributes
    ----------
    pressure : float
        Set-point [MPa].
    direction : str
        ``"inflating"`` or ``"deflating"``.
    stiffness, uncertainty : float
        Slope, and its standard uncertainty from the scatter of the lengths [N/mm].
    """

    pressure: float
    direction: str
    stiffness: float
    uncertainty: float


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchReport(ReasonedResult):
    """A muscle's characterisation by a camera.

    Attributes
    ----------
    runs : tuple of Characterisation
        One for each weight.
    lengths : LengthSeries
        Of all pictures, in the order of the runs.
    fit : Calibration, optional
        None if the model could not be fitted.
    trouble : str
        Why not; empty if it was.
    shared : dict
        Standard uncertainty of each estimate by what all pictures share: the scale of the board
        and the height of the muscle. It is not in the intervals of the fit.
    """

    runs: tuple[Characterisation, ...] = field(repr=False)
    lengths: LengthSeries = field(repr=False)
    fit: Calibration | None
    trouble: str = ""
    shared: Mapping[str, float] = field(default_factory=dict)

    @property
    def reason(self) -> str:
        """What went wrong; empty if all steps settled, all lengths are there, and the fit holds."""
        words = [run.reason for run in self.runs] + [self.lengths.reason, self.trouble]
        if self.fit is not None:
            words += [] if self.fit.converged else [self.fit.reason]
            words += self.fit.warnings
        return "; ".join(filter(None, words))

    @property
    def residual(self) -> float:
        """Standard deviation of a contraction about the fit [mm]; NaN without one."""
        return self.fit.sigma if self.fit is not None else math.nan

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of the estimates, with what all pictures share; none without a fit."""
        if self.fit is None:
            return {}
        found = {}
        for name in self.fit.free:
            value, (low, high) = self.fit.estimates[name], self.fit.intervals[name]
            half = math.hypot(0.5 * (high - low), SPREAD_95 * self.shared.get(name, 0.0))
            found[name] = (value - half, value + half)
        return found

    def list_columns(self) -> Mapping[str, object]:
        """Return the table: the steps of all runs, with contraction and length of each picture."""
        joined: dict[str, list[object]] = {}
        for run in self.runs:
            for name, values in run.list_columns().items():
                joined.setdefault(name, []).extend(values)  # type: ignore[arg-type]
        found = iter(self.lengths.found)
        seen = [next(found) if image else None for image in joined["image"]]
        free = self.free_length
        pressure = joined.pop("pressure [MPa]")
        return {
            "pressure [MPa]": pressure,
            "contraction [mm]": [item and free - item.length for item in seen],
            **joined,
            "length [mm]": [item and item.length for item in seen],
        }

    @property
    def free_length(self) -> float:
        """The length that contractions are counted from [mm]; NaN without one."""
        free = _find_free(self.lengths)
        return math.nan if free is None else float(free["length_mm"])

    def find_stiffness(self) -> tuple[MeasuredStiffness, ...]:
        """Return the slope of the weight over the length at each set-point and direction.

        There is none with one weight alone, or where fewer than three lengths were measured.
        """
        rows = zip(self.lengths.rows, self.lengths.found, self._setpoints, strict=True)
        states: dict[tuple[float, str], list[tuple[float, float]]] = {}
        for row, item, setpoint in rows:
            if item is not None:
                states.setdefault((setpoint, row.direction), []).append((item.length, row.load_n))
        found = []
        for (setpoint, direction), pairs in sorted(states.items()):
            length, weight = np.array(pairs).T
            if len(pairs) < 3 or np.ptp(weight) == 0.0:
                continue
            # Lengths scatter, weights do not: the slope of the length over the weight, inverted.
            away = weight - weight.mean()
            slope = float(away @ length / (away @ away))
            rest = length - length.mean() - slope * away
            error = math.sqrt(float(rest @ rest) / (len(pairs) - 2) / float(away @ away))
            if slope > 0.0:
                found.append(
                    MeasuredStiffness(
                        pressure=setpoint,
                        direction=direction,
                        stiffness=1.0 / slope,
                        uncertainty=error / slope**2,
                    )
                )
        return tuple(found)

    @property
    def _setpoints(self) -> list[float]:
        return [row.setpoint for run in self.runs for row in run.rows if row.image]

    def to_dict(self) -> Json:
        """Return the runs, the lengths, the stiffness and the fit as plain values."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "residual_mm": self.residual,
            "runs": [
                {"load_N": run.stairs.load, "steps": len(run.rows), "flagged": run.flagged}
                for run in self.runs
            ],
            "lengths": self.lengths.to_dict(),
            "stiffness": [dataclasses.asdict(item) for item in self.find_stiffness()],
            "fit": self.fit and self.fit.to_dict(),
            "intervals_95": self.intervals,
        }

    def save(self, table: str | os.PathLike[str], *, force: bool = False) -> Json:
        """Write the table, and beside it the lengths and the fit; return their paths.

        Raises
        ------
        OutputError
            If a file cannot be written, or the directory of the lengths exists (without `force`).
        """
        from ..vision import write_series

        path = write_table(table, self.list_columns())
        lengths = path.with_name(f"{path.stem}-lengths")
        write_series(self.lengths, lengths, force=force)
        written: Json = {"table": path, "lengths": lengths}
        if self.fit is not None:
            written["fit"] = path.with_name(f"{path.stem}-fit.yaml")
            write_muscle(written["fit"], self.fit.to_file())
        return written

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw contractions over the pressure, up and down, and the fitted curve; return the axes.

        Bars hold the mean of the repeats with 95 %.
        """
        axes = take_axes(ax, x="pressure [kPa]", y="contraction [mm]")
        for (load, direction), groups in self._group().items():
            known = [item for item in groups if item.get("contraction_mm") is not None]
            axes.errorbar(
                [item["pressure_kpa"] for item in known],
                [item["contraction_mm"] for item in known],
                yerr=[item.get("U95_contraction_mm") or 0.0 for item in known],
                marker="v" if direction == "deflating" else "^",
                markersize=4,
                linestyle="none",
                capsize=2,
                label=f"{load:g} N, {direction}",
            )
        if self.fit is not None:
            over = np.linspace(0.0, self.runs[0].stairs.highest, 101)
            for index, run in enumerate(self.runs):
                curve = self.fit.fitted.contraction(over, run.stairs.load)
                label = "" if index else "fitted"
                axes.plot(1e3 * over, curve, color="0.4", linewidth=1.0, label=label or None)
        axes.legend(frameon=False, fontsize="small")
        return axes

    def _group(self) -> dict[tuple[float, str], list[Json]]:
        """Return the states by weight and direction."""
        lines: dict[tuple[float, str], list[Json]] = {}
        for item in self.lengths.summarise():
            if item["n"]:
                lines.setdefault((item["load_n"], item["direction"]), []).append(item)
        return lines

    def plot_hysteresis(self, ax: Axes | None = None) -> Axes:
        """Draw by how much the muscle is shorter on the way down, over the pressure [mm]."""
        axes = take_axes(ax, x="pressure [kPa]", y="shorter when deflating [mm]")
        for (load, _), groups in self._group().items():
            known = [item for item in groups if item.get("hysteresis_mm") is not None]
            if known:
                axes.errorbar(
                    [item["pressure_kpa"] for item in known],
                    [item["hysteresis_mm"] for item in known],
                    yerr=[item.get("U95_hysteresis_mm") or 0.0 for item in known],
                    marker=".",
                    capsize=2,
                    linewidth=0.8,
                    label=f"{load:g} N",
                )
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(frameon=False, fontsize="small")
        return axes

    def plot_stiffness(self, ax: Axes | None = None) -> Axes:
        """Draw the measured stiffness over the pressure, bars of 95 %, and that of the fit."""
        axes = take_axes(ax, x="pressure [kPa]", y="stiffness [N/mm]")
        found = self.find_stiffness()
        for direction in dict.fromkeys(item.direction for item in found):
            own = [item for item in found if item.direction == direction]
            axes.errorbar(
                [1e3 * item.pressure for item in own],
                [item.stiffness for item in own],
                yerr=[2.0 * item.uncertainty for item in own],
                marker="v" if direction == "deflating" else "^",
                linestyle="none",
                capsize=2,
                label=direction,
            )
        if self.fit is not None and len(self.runs) > 1:
            over = np.linspace(0.0, self.runs[0].stairs.highest, 101)
            weights = np.array([run.stairs.load for run in self.runs])
            lengths = -np.array([self.fit.fitted.contraction(over, weight) for weight in weights])
            away = (weights - weights.mean())[:, None]
            slope = (away * lengths).sum(axis=0) / (away**2).sum()
            axes.plot(1e3 * over, 1.0 / slope, color="0.4", linewidth=1.0, label="fitted")
        axes.legend(frameon=False, fontsize="small")
        return axes

    def list_estimates(self) -> list[tuple[str, str]]:
        """Return the names of what was fitted, and texts of values and intervals, angles in deg."""
        rows: list[tuple[str, str]] = []
        if self.fit is None:
            return rows
        for name, interval in self.intervals.items():
            estimate, unit = self.fit.estimates[name], self.fit.units[name]
            value, low, high, unit = show_estimate(estimate, interval, unit=unit)
            rows.append((name.replace("_", " "), f"{value} {unit} (95 %: {low} to {high})"))
        return rows
