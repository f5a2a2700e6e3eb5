"""Measurements of a muscle as one checked table: pressure, contraction, load, direction, specimen.

Here are the table itself, the mean of inflation and deflation, and the statistics of repeats; how
files are read is in the module beside.
"""

from __future__ import annotations

import math
import os
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ..errors import InputError
from ._columns import take_index, take_numbers, take_row_numbers, take_words

if TYPE_CHECKING:
    from .design import Muscle

__all__ = ["Measurements", "RepeatStatistics", "read_measurements", "write_measurements"]

DIRECTIONS = ("inflating", "deflating", "")
"""What a row's direction may be; empty means that it is not known or does not matter."""

PRESSURE_LIMIT = 100.0
"""A pressure above this [MPa] is taken for a wrong unit."""

LOAD_LIMIT = 1e6
"""A load above this [N] is taken for a wrong unit."""

_RANGES = {
    "pressure": (0.0, PRESSURE_LIMIT, "MPa"),
    "contraction": (-math.inf, math.inf, "mm"),
    "load": (0.0, LOAD_LIMIT, "N"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurements:
    """Measured states of one kind of muscle, a row each. The arrays are read-only.

    A blocked muscle is a row as well: its contraction is 0 and its force is the load.

    Parameters
    ----------
    pressure : array_like, shape (n,)
        Gauge pressure, 0 to 100 [MPa].
    contraction : array_like, shape (n,)
        Free length less length [mm].
    load : array_like, shape (n,), optional
        Axial tension that the muscle holds, 0 to 1e6 [N]; one number counts for all rows. A muscle
        cannot push.
    direction : sequence of str, optional
        ``"inflating"``, ``"deflating"`` or ``""``; one text counts for all rows.
    specimen : sequence of str, optional
        Which muscle, without control characters; one text counts for all rows. Blanks at its ends
        are dropped.
    ignored : tuple of str
        Columns of the file that were not used.
    numbers : array_like of int, shape (n,), optional
        Row of each in its file, by which messages name it; by default counted from 1.
    source : str
        Name of the file, for messages.
    notes : tuple of str
        What `mean_of_directions` left out.

    Raises
    ------
    InputError
        If there is no row, or a value is not finite or outside its range; the row is named.
    """

    pressure: NDArray[np.float64]
    contraction: NDArray[np.float64]
    load: NDArray[np.float64] = field(default_factory=lambda: np.zeros(()))
    direction: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    specimen: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    ignored: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        pressure = take_numbers("pressure", self.pressure)
        count = len(pressure)
        if count == 0:
            raise InputError("the measurements have 0 rows: there must be 1 or more")
        _set(self, pressure=pressure, numbers=take_row_numbers(self.numbers, count))
        _set(
            self,
            contraction=take_numbers("contraction", self.contraction, count=count),
            load=take_numbers("load", self.load, count=count),
            direction=take_words("direction", self.direction, count=count),
            specimen=take_words("specimen", self.specimen, count=count),
        )
        for name in ("pressure", "contraction", "load"):
            self._check_column(name)
        for index, (direction, specimen) in enumerate(
            zip(self.direction.tolist(), self.specimen.tolist(), strict=True)
        ):
            if direction not in DIRECTIONS:
                raise InputError(
                    f"{self.name_row(index)}: direction is {direction!r}: it must be inflating, "
                    "deflating or empty"
                )
            if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in specimen):
                raise InputError(
                    f"{self.name_row(index)}: specimen is {specimen!r}: it must be text without "
                    "control characters"
                )

    def _check_column(self, name: str) -> None:
        values = getattr(self, name)
        low, high, unit = _RANGES[name]
        legal = (values >= low) & (values <= high) & np.isfinite(values)
        if not legal.all():
            index = int(np.argmin(legal))
            check_number(
                f"{self.name_row(index)}: {name}",
                float(values[index]),
                low=low,
                high=high,
                unit=unit,
            )

    def name_row(self, index: int) -> str:
        """Return how messages name the row of an index, such as ``data.csv: row 3``."""
        where = f"{self.source}: " if self.source else ""
        return f"{where}row {self.numbers[index]}"

    def __len__(self) -> int:
        return len(self.pressure)

    @property
    def largest_contraction(self) -> float:
        """Largest measured contraction [mm], what percentages are of."""
        return float(self.contraction.max())

    @property
    def has_load(self) -> bool:
        """Whether the rows were measured under more than one load."""
        return bool(np.ptp(self.load) > 1e-9)

    @property
    def has_both_directions(self) -> bool:
        """Whether there are rows of inflation and rows of deflation."""
        return {"inflating", "deflating"} <= set(self.direction.tolist())

    def select(self, rows: ArrayLike) -> Measurements:
        """Return the rows of a mask or of indices.

        Raises
        ------
        InputError
            If no row is left, a mask has another length, or there is no row of an index.
        """
        index = take_index(rows, len(self))
        return Measurements(
            pressure=self.pressure[index],
            contraction=self.contraction[index],
            load=self.load[index],
            direction=self.direction[index],
            specimen=self.specimen[index],
            ignored=self.ignored,
            numbers=self.numbers[index],
            source=self.source,
            notes=self.notes,
        )

    def check_lengths(self, muscle: Muscle, *, braid_angle: float | None = None) -> None:
        """Check that every measured length lies between 0 and the length of the strand.

        Parameters
        ----------
        muscle : Muscle
        braid_angle : float, optional
            In place of the muscle's [rad]: strands of a larger angle are longer.

        Raises
        ------
        InputError
            If one does not; the row is named.
        """
        strand = muscle.braid.strand_length
        if braid_angle is not None:
            strand = muscle.length / math.cos(braid_angle)
        for index, value in enumerate(self.contraction.tolist()):
            check_length(f"{self.name_row(index)}: ", muscle.length - value, strand)

    def mean_of_directions(self) -> Measurements:
        """Return the mean of inflation and deflation, per specimen and load.

        At each pressure of the inflation that the deflation reaches as well, the deflation is
        interpolated linearly and averaged with it; repeats at one pressure are averaged first.
        Rows without a direction are kept as they are. Rows of the inflation that the deflation does
        not reach, such as the turning point, are left out; `Measurements.notes` says so. (There
        friction still holds one way: the mean curve is not known.)

        Raises
        ------
        InputError
            If a specimen at a load has only one direction, or the two share no pressure.
        """
        from ._repeats import average_directions

        return average_directions(self)

    def repeat_statistics(self, *, tolerance: float = 1e-6) -> RepeatStatistics:
        """Return mean and spread of the rows that repeat a state.

        Rows repeat each other if they have the same load and direction, and their pressures,
        in order, lie within `tolerance` of the next one. All specimens count together.

        Parameters
        ----------
        tolerance : float
            Difference of pressures that counts as none [MPa].

        Raises
        ------
        InputError
            If the tolerance is negative.
        """
        from ._repeats import summarise_repeats

        return summarise_repeats(self, tolerance)


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatStatistics:
    """Mean and spread of repeated measurements, an entry for each state.

    Parameters
    ----------
    pressure, load : ndarray, shape (k,)
        The state [MPa], [N].
    direction : ndarray of str, shape (k,)
    count : ndarray of int, shape (k,)
        How many rows.
    mean : ndarray, shape (k,)
        Mean contraction [mm].
    deviation : ndarray, shape (k,)
        Standard deviation with n - 1 [mm]; 0 where there is one row.
    pooled_deviation : float
        Standard deviation of a single measurement, from all repeats together [mm].
    degrees_of_freedom : int
        Of `pooled_deviation`; 0 means that nothing was repeated and the deviation says nothing.
    """

    pressure: NDArray[np.float64]
    load: NDArray[np.float64]
    direction: NDArray[np.str_]
    count: NDArray[np.int64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    pooled_deviation: float
    degrees_of_freedom: int


def read_measurements(
    path: str | os.PathLike[str],
    *,
    muscle: Muscle | None = None,
    units: Mapping[str, str] | None = None,
) -> Measurements:
    """Read measurements from a CSV or Parquet file.

    Columns: `pressure`; `contraction`, or `length`, which needs the muscle; if there, `load`
    (or `force`), `direction` and `specimen`. The unit of a column stands in its name, as in
    ``pressure [kPa]``, ``length (mm)`` or ``load_N``, or in `units`. A CSV file is UTF-8 with
    ``,``, ``;`` or tabs between columns and a decimal point; a line that begins with ``#`` is a
    comment. Other columns are ignored, and named in `Measurements.ignored`.

    Parameters
    ----------
    path : path-like
        A file ending in .csv, .tsv, .txt, .parquet or .pq; Parquet needs the extra ``parquet``.
    muscle : Muscle, optional
        The muscle measured: turns length into contraction, and lengths are checked against its
        strand.
    units : mapping, optional
        Unit of a column whose name has none, such as ``{"pressure": "kPa"}``.

    Raises
    ------
    FileFormatError
        If the file cannot be read as such a table. The row is named: the line of a CSV file, the
        record of a Parquet file counted from 1.
    UnitError
        If a column has no unit, two, or a wrong one.
    InputError
        If a value is outside its range.
    MissingExtraError
        If a Parquet file is given and ``pyarrow`` is not installed.
    """
    from ._table import read_table

    return read_table(Path(path), muscle=muscle, units=units or {})


def write_measurements(path: str | os.PathLike[str], data: Measurements) -> Path:
    """Write measurements as a CSV file that `read_measurements` reads back exactly.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    from ._table import write_table

    return write_table(Path(path), data)


def check_length(where: str, length: float, strand: float) -> float:
    """Return a measured length if a muscle of such strands can have it, or raise `InputError`."""
    if length > strand:
        raise InputError(
            f"{where}length is {length:g} mm, longer than the strand: "
            f"it must lie in (0, {strand:g}] mm"
        )
    return check_number(f"{where}length", length, low=0.0, low_open=True, high=strand, unit="mm")


def _set(data: Measurements, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(data, name, value)
