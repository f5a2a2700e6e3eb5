"""Lengths of muscles over a series of pictures: repeats, contraction, hysteresis, and their files.

What differs from picture to picture falls with the number of repeats; what the set-up brings (scale
of the print, height and tilt of the axis, flatness) is the same share of every length, so that of a
contraction only that share of the contraction is left.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import FileFormatError, InputError
from ..io.files import new_directory
from ..io.sheets import write_table
from ..muscle.table import BRANCHES
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes
from .board import StripBoard
from .camera import Camera
from .length import LengthOptions, MuscleLength, measure_length
from .pictures import (
    BLUE,
    YELLOW,
    Manifest,
    Stroke,
    measure_each,
    read_picture,
    write_overlay,
    write_summary,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEW_REPEATS = 5
"""Repeats below which a mean is flagged."""

RING_CHANGE = 0.05
"""Share by which a ring differs from its median over the pictures of a specimen, flagged above."""

HARMLESS = ("colour",)
"""Flags that say nothing against a length."""

_WORDS = {**BRANCHES, "inflate": "inflating", "deflate": "deflating", "none": ""}
_OVERRIDES = ("override_x1", "override_y1", "override_x2", "override_y2")
_STATE = ("specimen", "load_n", "pressure_kpa", "direction")


@dataclass(frozen=True)
class SeriesRow:
    """A row of a manifest: which state, which picture, and marks that a person has set.

    The set-point is the pressure that was asked for, by which repeats belong together.
    """

    specimen: str
    load_n: float
    pressure_kpa: float
    direction: str
    picture: Path
    setpoint_kpa: float
    marks: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class LengthSeries(Result):
    """Lengths of a series of pictures.

    Attributes
    ----------
    rows : tuple of SeriesRow
        What was measured.
    found : tuple of MuscleLength or None
        The length of each row; None where it failed.
    reasons : tuple of str
        Why it failed; empty otherwise.
    manifest : Manifest
        The table that the rows are from.
    options : LengthOptions
    """

    rows: tuple[SeriesRow, ...]
    found: tuple[MuscleLength | None, ...]
    reasons: tuple[str, ...]
    manifest: Manifest
    options: LengthOptions

    @property
    def status(self) -> tuple[str, ...]:
        """For each row "ok", "flagged" or "failed"."""
        return tuple(
            "failed" if item is None else "flagged" if set(item.flags) - {*HARMLESS} else "ok"
            for item in self.found
        )

    @property
    def converged(self) -> bool:
        """Whether all rows have a length."""
        return None not in self.found

    @property
    def reason(self) -> str:
        """Why not; empty if none failed."""
        failed = [k for k, item in enumerate(self.found) if item is None]
        if not failed:
            return ""
        return (
            f"{len(failed)} of {len(self.rows)} pictures failed (row {failed[0] + 1}: "
            f"{self.reasons[failed[0]]})"
        )

    @property
    def residual(self) -> float:
        """Residuals of the corners of the board, rms over the pictures [px]."""
        misses = [item.plane_miss for item in self.found if item]
        return float(np.sqrt(np.mean(np.square(misses)))) if misses else math.nan

    def list_columns(self) -> Json:
        """Return a row for each picture: the manifest's columns, length, uncertainty, status."""
        empty: Json = {}
        values = [item.to_dict() if item else empty for item in self.found]
        names = list(dict.fromkeys(name for value in values for name in value))
        own = {name: [value.get(name) for value in values] for name in names if name != "flags"}
        copied = {
            (f"manifest_{name}" if name in names else name): [row[name] for row in self.table]
            for name in self.manifest.columns
        }
        return {
            **copied,
            **own,
            "status": list(self.status),
            "flags": [value.get("flags", "") for value in values],
            "reason": list(self.reasons),
        }

    @property
    def table(self) -> tuple[dict[str, str], ...]:
        """The rows of the manifest."""
        return self.manifest.rows

    def summarise(self) -> list[Json]:
        """Return a row for each state: mean length, contraction and hysteresis, with uncertainty.

        A state is a specimen, a load, a pressure (the set-point, where the table has one) and a
        direction: inflation and deflation are not pooled. Contractions are from the specimen's rows
        without pressure, at its least load. Standard uncertainties begin with ``u_``; ``U95`` is
        half the interval of 95 % by Student's factor for the effective degrees of freedom (Welch
        and Satterthwaite; GUM, annex G).
        """
        groups = [_take_mean(state, self) for state in dict.fromkeys(map(_get_state, self.rows))]
        for group in groups:
            group |= _compare(group, self._find_reference(group, groups), "contraction")
            group |= _compare(_find_partner(group, groups), group, "hysteresis", sign=-1.0)
        return groups

    def _find_reference(self, group: Json, groups: Sequence[Json]) -> Json | None:
        """Return the state without pressure that contractions of a state are counted from."""
        order = ("inflating", "", "deflating")
        free = [
            item
            for item in groups
            if item["specimen"] == group["specimen"] and item["pressure_kpa"] == 0.0 and item["n"]
        ]
        key = [(item["load_n"], order.index(item["direction"])) for item in free]
        return free[key.index(min(key))] if free else None

    def list_contractions(self) -> Json:
        """Return the columns that `bozzini.muscle.read_measurements` reads, a row for each picture.

        The rows that contractions are counted from are left out.
        """
        groups = self.summarise()
        by_state = {tuple(item[name] for name in _STATE): item for item in groups}
        lines = []
        for row, item in zip(self.rows, self.found, strict=True):
            free = self._find_reference(by_state[_get_state(row)], groups)
            if item is None or free is None or by_state[_get_state(row)] is free:
                continue
            contraction = free["length_mm"] - item.length
            lines.append((row.pressure_kpa, contraction, row.load_n, row.direction, row.specimen))
        names = ("pressure [kPa]", "contraction [mm]", "load [N]", "direction", "specimen")
        return {name: [line[k] for line in lines] for k, name in enumerate(names)}

    def to_dict(self) -> Json:
        """Return the counts and the states as plain values."""
        return {
            "converged": self.converged,
            "reason": self.reason,
            "pictures": len(self.rows),
            **{word: self.status.count(word) for word in ("ok", "flagged", "failed")},
            "rms_px": self.residual if math.isfinite(self.residual) else None,
            "states": self.summarise(),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw mean lengths over pressure, bars of 95 %; return the axes."""
        ax = take_axes(ax, x="pressure [kPa]", y="length [mm]")
        groups = [item for item in self.summarise() if item["n"]]
        lines = dict.fromkeys((g["specimen"], g["load_n"], g["direction"]) for g in groups)
        for specimen, load, direction in lines:
            own = [
                g
                for g in groups
                if (g["specimen"], g["load_n"], g["direction"]) == (specimen, load, direction)
            ]
            ax.errorbar(
                [g["pressure_kpa"] for g in own],
                [g["length_mm"] for g in own],
                yerr=[g["U95_mm"] for g in own],
                marker=".",
                capsize=2,
                linewidth=0.8,
                label=f"{specimen} {load:g} N {direction}".strip(),
            )
        if lines:
            ax.legend(loc="best", title="bars: 95 %")
        return ax


_State = tuple[str, float, float, str]


def _get_state(row: SeriesRow) -> _State:
    return row.specimen, row.load_n, row.setpoint_kpa, row.direction


def _take_mean(state: _State, series: LengthSeries) -> Json:
    """Return mean, spread and uncertainty of the length in a state."""
    own = [k for k, row in enumerate(series.rows) if _get_state(row) == state]
    found = [item for k in own if (item := series.found[k])]
    count = len(found)
    group: Json = {
        **dict(zip(_STATE, state, strict=True)),
        "n": count,
        "failed": len(own) - count,
        "flagged": sum(series.status[k] == "flagged" for k in own),
        "flags": "few_repeats" if count < FEW_REPEATS else "",
    }
    if not count:
        return group | dict.fromkeys(
            ("length_mm", "s_mm", "u_A_mm", "u_B_mm", "u_mm", "nu_eff", "U95_mm", "u_common")
        )
    lengths = np.array([item.length for item in found])
    mean = float(lengths.mean())
    spread = float(lengths.std(ddof=1)) if count > 1 else None
    # By chance repeats agree better than a picture can be read: not less than that is claimed.
    read = math.sqrt(float(np.mean([item.independent**2 for item in found])))
    random = max(spread or 0.0, read) / math.sqrt(count)
    common = float(np.mean([item.common for item in found]))
    freedom = count - 1 if (spread or 0.0) > read else math.inf
    return group | {
        "length_mm": mean,
        "s_mm": spread,
        "u_A_mm": random,
        "u_B_mm": mean * common,
        **_combine([(random, freedom), (mean * common, math.inf)]),
        "u_common": common,
        "_freedom": freedom,
    }


def _combine(parts: Sequence[tuple[float, float]], name: str = "") -> Json:
    """Return the combined uncertainty of parts (standard uncertainty, degrees of freedom)."""
    from scipy.stats import t

    whole = math.hypot(*(part for part, _ in parts))
    low = sum(part**4 / freedom for part, freedom in parts)
    freedom = whole**4 / low if low > 0.0 else math.inf
    factor = float(t.ppf(0.975, freedom)) if whole > 0.0 else 0.0
    end = f"_{name}" if name else ""
    return {
        f"u{end}_mm": whole,
        f"nu_eff{end}": freedom if math.isfinite(freedom) else None,
        f"U95{end}_mm": factor * whole,
    }


def _compare(group: Json | None, free: Json | None, name: str, sign: float = 1.0) -> Json:
    """Return the difference of two states of one set-up, of which the shared part cancels."""
    blank = dict.fromkeys((f"{name}_mm", f"u_{name}_mm", f"nu_eff_{name}", f"U95_{name}_mm"))
    if group is None or free is None or not group["n"] or not free["n"]:
        return blank
    if group is free:
        return {**blank, f"{name}_mm": 0.0, f"u_{name}_mm": 0.0, f"U95_{name}_mm": 0.0}
    change = free["length_mm"] - group["length_mm"]
    parts = [
        (group["u_A_mm"], group["_freedom"]),
        (free["u_A_mm"], free["_freedom"]),
        (abs(change) * group["u_common"], math.inf),
    ]
    return {f"{name}_mm": sign * change, **_combine(parts, name)}


def _find_partner(group: Json, groups: Sequence[Json]) -> Json | None:
    """Return the state of the inflation that a state of the deflation belongs to."""
    wanted = (group["specimen"], group["load_n"], group["pressure_kpa"], "inflating")
    if group["direction"] != "deflating":
        return None
    return next((g for g in groups if tuple(g[name] for name in _STATE) == wanted), None)


def read_series(manifest: Manifest) -> tuple[SeriesRow, ...]:
    """Return the rows of a table of pictures.

    It needs the columns ``image`` and ``pressure_kpa``; ``specimen``, ``load_n``, ``direction``
    (inflate, deflate or none), ``setpoint_kpa`` and ``override_x1``, ``override_y1``,
    ``override_x2``, ``override_y2`` [px] are used where they are there. Others are kept as they
    are. Without a set-point the pressure is taken for one.

    Raises
    ------
    FileFormatError
        One line that names the row and what is wrong.
    """
    rows = []
    for number, row in enumerate(manifest.rows, start=1):
        where = f"{manifest.path}: row {number}"
        word = row.get("direction", "").lower()
        if word not in _WORDS:
            raise FileFormatError(
                f"{where}: direction is '{word}': it must be inflate, deflate or none"
            )
        marks = [row.get(name, "") for name in _OVERRIDES]
        if any(marks) and not all(marks):
            raise FileFormatError(f"{where}: give all of {', '.join(_OVERRIDES)}, or none")
        pressure = _read_number(where, row, "pressure_kpa")
        load = _read_number(where, row, "load_n") if row.get("load_n") else 0.0
        asked = _read_number(where, row, "setpoint_kpa") if row.get("setpoint_kpa") else pressure
        given = tuple(_read_number(where, row, name) for name in _OVERRIDES) if all(marks) else ()
        specimen = row.get("specimen", "")
        picture = manifest.find_picture(row, "image")
        rows.append(SeriesRow(specimen, load, pressure, _WORDS[word], picture, asked, given))
    return tuple(rows)


def _read_number(where: str, row: dict[str, str], column: str) -> float:
    try:
        number = float(row[column])
    except ValueError:
        number = math.nan
    if not (0.0 <= number < 1e6):
        text = row[column][:40]
        raise FileFormatError(f"{where}: {column} is '{text}': it must be a number in [0, 1e6)")
    return number


def measure_series(
    manifest: Manifest,
    board: StripBoard,
    *,
    options: LengthOptions,
    camera: Camera | None = None,
    jobs: int = 1,
    progress: Progress = no_progress,
) -> LengthSeries:
    """Measure the lengths of a table of pictures; one that fails is a row with its reason.

    Parameters
    ----------
    manifest : Manifest
        See `read_series` for its columns.
    board : StripBoard
    options : LengthOptions
    camera : Camera, optional
    jobs : int
        Pictures at the same time.
    progress : callable

    Raises
    ------
    FileFormatError
        If the table is wrong.
    InputError
        If there is neither a camera nor its distance.
    """
    if camera is None and not options.distance:
        raise InputError("without a calibrated camera the distance from the board must be given")
    rows = read_series(manifest)
    work = partial(_measure_row, board=board, options=options, camera=camera)
    found = measure_each(rows, work, jobs=jobs, stage="lengths", progress=progress)
    return LengthSeries(
        rows=rows,
        found=_flag_rings(rows, [row.get("found") for row in found]),
        reasons=tuple(row["reason"] for row in found),
        manifest=manifest,
        options=options,
    )


def _flag_rings(
    rows: Sequence[SeriesRow], found: Sequence[MuscleLength | None]
) -> tuple[MuscleLength | None, ...]:
    """Flag where a ring is longer or shorter than in most pictures of its specimen: part hidden."""
    widths = np.array([item.rings if item else (np.nan, np.nan) for item in found])
    changed = np.zeros(len(rows), bool)
    for specimen in {row.specimen for row in rows}:
        own = np.array([row.specimen == specimen for row in rows])
        known = own & np.isfinite(widths).all(axis=1)
        if known.sum() >= FEW_REPEATS:
            usual = np.median(widths[known], axis=0)
            changed |= known & (np.abs(widths / usual - 1.0) > RING_CHANGE).any(axis=1)
    return tuple(
        dataclasses.replace(item, flags=(*item.flags, "ring_changed")) if item and off else item
        for item, off in zip(found, changed.tolist(), strict=True)
    )


def _measure_row(
    row: SeriesRow, *, board: StripBoard, options: LengthOptions, camera: Camera | None
) -> Json:
    marks = np.array(row.marks).reshape(2, 2) if row.marks else None
    picture = read_picture(row.picture)
    return {"found": measure_length(picture, board, options=options, camera=camera, marks=marks)}


def write_series(
    found: LengthSeries,
    directory: str | os.PathLike[str],
    *,
    inputs: Sequence[Path] = (),
    force: bool = False,
) -> Json:
    """Write a series into a new directory and return its summary.

    It holds ``lengths.csv`` (a row for each picture), ``summary.csv`` (a row for each state),
    ``contractions.csv`` (what `bozzini muscle fit` and `rank` read), ``picture.png``,
    ``summary.json``, and ``overlays`` of the pictures with the axis and both rings.

    Raises
    ------
    OutputError
        If the directory exists (without `force`) or cannot be written.
    """
    from matplotlib.figure import Figure

    groups = [
        {name: value for name, value in group.items() if not name.startswith("_")}
        for group in found.summarise()
    ]
    figure = Figure(figsize=(7.0, 5.0))
    found.plot(figure.add_subplot())
    contractions = found.list_contractions()
    with new_directory(directory, force=force) as folder:
        write_table(folder / "lengths.csv", found.list_columns(), digits=9)
        columns = {name: [group.get(name) for group in groups] for name in groups[0]}
        write_table(folder / "summary.csv", columns, digits=9)
        if contractions["direction"]:
            write_table(folder / "contractions.csv", contractions, digits=9)
        figure.savefig(folder / "picture.png", dpi=150.0)
        (folder / "overlays").mkdir()
        for k, row in enumerate(found.rows):
            _write_overlay(folder / "overlays" / f"{k + 1:04d}.jpg", row, found, k)
        return write_summary(
            folder,
            settings=found.options,
            inputs=[*inputs, *(row.picture for row in found.rows)],
            result=found.to_dict() | {"states": groups},
        )


def _write_overlay(target: Path, row: SeriesRow, found: LengthSeries, index: int) -> None:
    """Draw axis, edges and rings over a picture, if it can be read."""
    try:
        picture = read_picture(row.picture)
    except FileFormatError:
        return
    item = found.found[index]
    if item is None:
        write_overlay(target, picture, [], [found.reasons[index]], refused=True)
        return
    strokes = [
        Stroke(item.marks, BLUE),
        Stroke(item.edges, YELLOW, crosses=True),
        Stroke(item.marks, crosses=True),
    ]
    text = [f"{item.length:.3f} mm, u {item.uncertainty:.3f} mm", *item.flags]
    write_overlay(target, picture, strokes, text)
