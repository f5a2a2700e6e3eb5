"""Mean of inflation and deflation, and the statistics of repeated measurements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from .dataset import Measurements, RepeatStatistics

__all__ = ["average_directions", "summarise_repeats"]


def average_directions(data: Measurements) -> Measurements:
    """Return the mean of inflation and deflation; see `Measurements.mean_of_directions`."""
    known = data.direction != ""
    parts: list[tuple[Any, ...]] = [
        (p, x, f, s)
        for p, x, f, s in zip(
            data.pressure[~known],
            data.contraction[~known],
            data.load[~known],
            data.specimen[~known],
            strict=True,
        )
    ]
    notes = list(data.notes)
    for (load, specimen), rows in _group(data, data.load.round(9), data.specimen, where=known):
        branches = {}
        for name in ("inflating", "deflating"):
            branch = rows[data.direction[rows] == name]
            if not len(branch):
                raise InputError(
                    f"specimen {str(specimen)!r} at {load:g} N has no {name} row: "
                    "a mean of directions needs both"
                )
            branches[name] = _average(data.pressure[branch], data.contraction[branch])
        (up, risen), (down, fallen) = branches["inflating"], branches["deflating"]
        shared = (up >= down[0]) & (up <= down[-1])
        if not shared.any():
            raise InputError(
                f"specimen {str(specimen)!r} at {load:g} N: inflation at {up[0]:g} to "
                f"{up[-1]:g} MPa and deflation at {down[0]:g} to {down[-1]:g} MPa share none"
            )
        if not shared.all():
            notes.append(
                f"specimen {str(specimen)!r} at {load:g} N: inflation at "
                f"{', '.join(f'{p:g}' for p in up[~shared])} MPa left out, which the deflation at "
                f"{down[0]:g} to {down[-1]:g} MPa does not reach"
            )
        mean = 0.5 * (risen + np.interp(up, down, fallen))
        parts += [(p, x, load, specimen) for p, x in zip(up[shared], mean[shared], strict=True)]
    columns = list(zip(*parts, strict=True))
    return Measurements(
        pressure=np.array(columns[0]),
        contraction=np.array(columns[1]),
        load=np.array(columns[2]),
        specimen=np.array(columns[3]),
        ignored=data.ignored,
        notes=tuple(notes),
    )


def summarise_repeats(data: Measurements, tolerance: float) -> RepeatStatistics:
    """Return mean and spread of repeats; see `Measurements.repeat_statistics`."""
    check_number("tolerance", tolerance, low=0.0, unit="MPa")
    states = []
    for (load, direction), rows in _group(data, data.load.round(9), data.direction):
        rows = rows[np.argsort(data.pressure[rows], kind="stable")]
        cuts = np.flatnonzero(np.diff(data.pressure[rows]) > tolerance) + 1
        for same in np.split(rows, cuts):
            values = data.contraction[same]
            mean = float(values.mean())
            squares = float(((values - mean) ** 2).sum())
            states.append((data.pressure[same].mean(), load, direction, len(same), mean, squares))
    columns = [np.array(column) for column in zip(*states, strict=True)]
    count = columns[3]
    freedom = int((count - 1).sum())
    return RepeatStatistics(
        pressure=columns[0],
        load=columns[1],
        direction=columns[2],
        count=count,
        mean=columns[4],
        deviation=np.sqrt(columns[5] / np.maximum(count - 1, 1)),
        pooled_deviation=float(np.sqrt(columns[5].sum() / max(freedom, 1))),
        degrees_of_freedom=freedom,
    )


def _group(
    data: Measurements, *keys: NDArray[Any], where: NDArray[np.bool_] | None = None
) -> Iterator[tuple[tuple[Any, ...], NDArray[np.intp]]]:
    """Give each combination of keys, in order, and its rows."""
    groups: dict[tuple[Any, ...], list[int]] = {}
    for row in np.arange(len(data)) if where is None else np.flatnonzero(where):
        groups.setdefault(tuple(key[row].item() for key in keys), []).append(int(row))
    for name in sorted(groups):
        yield name, np.array(groups[name])


def _average(
    pressure: NDArray[np.float64], contraction: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pressures in order, each once, and the mean contraction at each."""
    levels, place = np.unique(pressure, return_inverse=True)
    return levels, np.bincount(place, weights=contraction) / np.bincount(place)
