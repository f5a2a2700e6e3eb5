"""Measured curves of pressure over time, from MATLAB and CSV files and from tables."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_array, check_number, check_range
from ..errors import FileFormatError, InputError
from ..io.matlab import Matrix, read_matrices
from ..io.sheets import Sheet, find_suffix, read_sheet, split_title, take_frame, take_numbers
from ..numeric.arrays import Floats
from ..results import ClosedForm, measured, take_axes
from ..units import parse_unit
from .pneumatics import PRESSURE_LIMIT

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

LEAST_ROWS = 12
"""Fewest rows of a curve."""

COUNTS = "count"
"""Unit of readings of a converter, which only ratios are known of."""

SUPPLY = 0.62
"""Gauge pressure [MPa] that the highest of readings in counts is taken for, by default."""

SUFFIXES = (".mat", ".csv")


@dataclass(frozen=True, kw_only=True, eq=False)
class PressureCurve(ClosedForm):
    """Pressure over time, in the order of time.

    Attributes
    ----------
    name : str
        What messages and tables call it.
    time : (n,) ndarray
        Time, not falling [s].
    pressure : (n,) ndarray
        Gauge pressure [MPa].
    supply : float or None
        Gauge pressure of the supply where it was measured too: the median [MPa].
    notes : tuple of str
        What was assumed when the curve was read.

    Raises
    ------
    InputError
        If there are fewer than `LEAST_ROWS` rows, or a value is not a finite number, or the time
        falls, or a pressure is not in [-0.101325, 100] MPa.
    """

    name: str
    time: Floats = measured("s")
    pressure: Floats = measured("MPa")
    supply: float | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time, pressure = (
            np.array(check_array(f"{self.name}: {word}", values))
            for word, values in (("time", self.time), ("pressure", self.pressure))
        )
        if time.ndim != 1 or time.shape != pressure.shape or time.size < LEAST_ROWS:
            raise InputError(
                f"{self.name} has times of shape {time.shape} and pressures of shape "
                f"{pressure.shape}: there must be as many of both, at least {LEAST_ROWS}"
            )
        check_range(f"{self.name}: time", time, -1e9, 1e9, "s")
        check_range(f"{self.name}: pressure", pressure, -0.15, PRESSURE_LIMIT, "MPa")
        if np.any(np.diff(time) < 0.0) or time[0] == time[-1]:
            raise InputError(f"{self.name}: the time must rise from row to row")
        for word, values in (("time", time), ("pressure", pressure)):
            values.flags.writeable = False
            object.__setattr__(self, word, values)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the pressure over the time, and return the axes."""
        axes = take_axes(ax, x="time [s]", y="pressure [kPa]")
        axes.plot(self.time, 1e3 * self.pressure, ".", markersize=2, label=self.name)
        return axes


def read_curve(
    path: str | os.PathLike[str], *, unit: str | None = None, supply: float = SUPPLY
) -> PressureCurve:
    """Return the curve in a file.

    A ``.mat`` file (MATLAB 5 to 7.2) has a matrix ``data``, or one matrix only, whose columns are
    time and pressure, or time, whether the valve is open, and pressure. A ``.csv`` file is a table
    as `take_curve` takes it. Of a file with a valve column the rows with the valve shut are taken:
    the leak.

    Parameters
    ----------
    path : path-like
        The file.
    unit : str, optional
        Unit of pressures without one: one of pressure, or ``"count"``. By default whole numbers
        are counts, and others kPa.
    supply : float
        Of counts, the gauge pressure of the highest one [MPa]; the lowest is taken for 0.

    Raises
    ------
    FileFormatError
        If the file is not of such a form.
    InputError
        If the values are no curve.
    """
    path = Path(path)
    if not os.path.isfile(path):
        words = "it is a directory" if os.path.isdir(path) else "there is no such file"
        raise FileFormatError(f"cannot read {path}: {words}")
    if find_suffix(path) == ".csv":
        return _take_sheet(read_sheet(path), path.name, unit, supply)
    if path.suffix.lower() != ".mat":
        raise FileFormatError(f"{path} ends in '{path.suffix}': it must end in .mat or .csv")
    return _take_matrix(_read_matrix(path), path.name, unit, supply)


def _read_matrix(path: Path) -> Matrix:
    found = read_matrices(path)
    wide = [
        name
        for name, item in found.items()
        if item is not None and item.ndim == 2 and min(item.shape) in (2, 3)
    ]
    chosen = "data" if "data" in found else wide[0] if len(wide) == 1 else ""
    if not chosen:
        raise FileFormatError(
            f"{path} has {_count(found)}, none of them 'data' and not one matrix of two or three "
            "columns"
        )
    matrix = found[chosen]
    if matrix is None:
        raise FileFormatError(f"{path}: its variable '{chosen}' holds no real numbers")
    return matrix


def _count(names: Mapping[str, object]) -> str:
    return f"the variables {', '.join(names)}" if names else "no variables"


def _take_matrix(matrix: Matrix, name: str, unit: str | None, supply: float) -> PressureCurve:
    if matrix.ndim == 2 and matrix.shape[1] not in (2, 3) and matrix.shape[0] in (2, 3):
        matrix = matrix.T
    if matrix.ndim != 2 or matrix.shape[1] not in (2, 3):
        raise FileFormatError(
            f"{name}: its data have shape {matrix.shape}, not (n, 2) or (n, 3): time, (valve,) "
            "pressure"
        )
    whole = matrix.dtype.kind in "iu"
    valve = matrix[:, 1] if matrix.shape[1] == 3 else None
    return _make_curve(
        name, matrix[:, 0], matrix[:, -1], valve, unit or (COUNTS if whole else "kPa"), supply
    )


def take_curve(
    table: pandas.DataFrame,
    *,
    name: str = "table",
    unit: str | None = None,
    supply: float = SUPPLY,
) -> PressureCurve:
    """Return the curve in a table.

    Its columns are ``time``, ``pressure`` and, if there, ``supply`` and ``valve``, with units in
    brackets, as in ``pressure [kPa]``. Without a unit times are in s (whole numbers far apart: ms),
    and pressures as in `read_curve`, which has the other parameters.

    Raises
    ------
    FileFormatError
        If a column is missing, or a unit is none.
    InputError
        If the values are no curve.
    """
    return _take_sheet(take_frame(table), name, unit, supply)


_COLUMNS = ("time", "pressure", "supply", "valve")
_WHOLE = re.compile(r"\s*[-+]?[0-9]+\s*")


def _take_sheet(sheet: Sheet, name: str, unit: str | None, supply: float) -> PressureCurve:
    found: dict[str, tuple[Floats, str]] = {}
    whole = False
    for place, title in enumerate(sheet.titles):
        word, own = split_title(title)
        word = word.lower()
        if word not in _COLUMNS:
            continue
        if word in found:
            raise FileFormatError(f"{name}: two columns are '{word}'")
        found[word] = take_numbers(sheet, place, where=f"{name}: "), own
        if word == "pressure":
            whole = all(_WHOLE.fullmatch(str(row[place])) for row in sheet.rows)
    for word in ("time", "pressure"):
        if word not in found:
            raise FileFormatError(f"{name} has no column '{word}': it has {list(sheet.titles)}")
    times, time_unit = found["time"]
    pressures, own_unit = found["pressure"]
    chosen = own_unit or unit or (COUNTS if whole else "kPa")
    if time_unit:
        times = times * _find_factor(name, time_unit, "time")
    curve = _make_curve(
        name,
        times,
        pressures,
        found["valve"][0] if "valve" in found else None,
        chosen,
        supply,
        timed=bool(time_unit),
    )
    if "supply" in found:
        values, supply_unit = found["supply"]
        if (supply_unit or chosen) == COUNTS:
            raise FileFormatError(f"{name}: the supply must have a unit of pressure")
        middle = np.median(values) * _find_factor(name, supply_unit or chosen, "pressure")
        curve = dataclasses.replace(curve, supply=float(middle))
    return curve


def _find_factor(name: str, unit: str, kind: str) -> float:
    try:
        return parse_unit(unit, kind)
    except InputError as error:
        raise FileFormatError(f"{name}: {error}") from None


def _make_curve(
    name: str,
    time: Matrix,
    pressure: Matrix,
    valve: Matrix | None,
    unit: str,
    supply: float,
    *,
    timed: bool = False,
) -> PressureCurve:
    check_number("supply", supply, low=0.0, low_open=True, high=PRESSURE_LIMIT, unit="MPa")
    notes: list[str] = []
    values, highest = pressure.astype(np.float64), float(np.max(pressure, initial=0.0))
    if valve is not None:
        shut = valve == np.min(valve)
        if shut.all():
            raise InputError(f"{name}: the valve never moves, so that no leak begins")
        time, values = time[shut], values[shut]
        notes.append(f"only the {int(shut.sum())} rows with the valve shut are used")
    times = time.astype(np.float64)
    if times.size and not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise InputError(f"{name} has values that are not finite (NaN or infinite)")
    step = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    if not timed and step >= 5.0 and np.all(times == np.round(times)):
        times = 1e-3 * times
        notes.append("times are whole numbers far apart: taken in ms")
    if unit == COUNTS:
        if not highest > 0.0:
            raise InputError(f"{name}: no reading is above 0")
        values = supply * values / highest
        notes.append(f"counts: {highest:g}, the highest, taken for {1e3 * supply:g} kPa, 0 for 0")
    else:
        values = values * _find_factor(name, unit, "pressure")
    return PressureCurve(name=name, time=times, pressure=values, notes=tuple(notes))
