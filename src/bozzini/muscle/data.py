"""Measurements of muscles: a checked table and its statistics."""

from __future__ import annotations

import dataclasses
import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_word, list_quantities, show_apart
from ..errors import InputError
from ..results import Json, Shown, make_frame, take_axes
from ..units import parse_quantity
from .design import PRESSURE_LIMIT, Muscle

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


DIRECTIONS = ("inflating", "deflating", "")
"""What a row's direction may be; empty means that it is not known or does not matter."""

LOAD_LIMIT = 1e6
"""A load above this [N] is taken for a wrong unit."""

COLUMNS = ("pressure", "contraction", "load", "direction", "specimen")
_Value = TypeVar("_Value", bound=np.generic)

MEASURED = ("pressure", "contraction", "load")
"""The columns that hold measured quantities, in MPa, mm and N."""

GEOMETRY = list_quantities(Muscle)
"""What a table may hold of each specimen: the fields of a `Muscle`."""

_HELD_SHARE = 0.01  # of the largest value: smaller differences are one level of what is held
_RANGES = {
    "pressure": (0.0, PRESSURE_LIMIT, "MPa"),
    "contraction": (-math.inf, math.inf, "mm"),
    "load": (-LOAD_LIMIT, LOAD_LIMIT, "N"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurements(Shown):
    """Measured states of one kind of muscle, a row each. The arrays are read-only.

    A blocked muscle is a row as well: its contraction is 0 and its force is the load.

    Parameters
    ----------
    pressure : array_like, shape (n,)
        Gauge pressure, 0 to 20 [MPa].
    contraction : array_like, shape (n,)
        Free length less length [mm].
    load : array_like, shape (n,), optional
        Axial tension that the muscle holds, at most 1e6 either way [N]; one number counts for all
        rows. A muscle that pushes has a negative load: only a force can be compared with it, unless
        the muscle gets longer under pressure.
    direction : sequence of str, optional
        ``"inflating"``, ``"deflating"`` or ``""``; one text counts for all rows.
    specimen : sequence of str, optional
        Which muscle, without control characters; one text counts for all rows. Blanks at its ends
        are dropped.
    geometry : mapping of str to array_like, shape (n,), optional
        Fields of `Muscle` that were measured of each specimen, in the units of the fields, such as
        ``{"length": ...}``; constant within a specimen. One number counts for all rows.
    errors : mapping of str to array_like, shape (n,), optional
        Standard error of each row's pressure [MPa], contraction [mm] or load [N], above 0. One
        number counts for all rows.
    free_lengths : mapping of float to array_like, shape (n,), optional
        Length [mm] of each row's specimen without load at a pressure [MPa], by the pressure: from
        it follows the zero of the specimen's contractions, see `bozzini.muscle.ends`. Constant
        within a specimen.
    ignored : tuple of str
        Columns of the file that were not used.
    numbers : array_like of int, shape (n,), optional
        Row of each in its file, by which messages name it; by default counted from 1.
    source : str
        Name of the file, for messages.
    notes : tuple of str
        What reading the table changed, and what `mean_of_directions` left out.

    Raises
    ------
    InputError
        If there is no row, a value is not finite or outside its range, or the geometry of a
        specimen is not constant; the row is named.
    """

    pressure: NDArray[np.float64]
    contraction: NDArray[np.float64]
    load: NDArray[np.float64] = field(default_factory=lambda: np.zeros(()))
    direction: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    specimen: NDArray[np.str_] = field(default_factory=lambda: np.array(""))
    geometry: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    errors: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    free_lengths: Mapping[float, NDArray[np.float64]] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = np.size(self.pressure)
        if np.ndim(self.pressure) == 1 and count == 0:
            raise InputError("the measurements have 0 rows: there must be 1 or more")
        for name in MEASURED:
            array = np.array(check_array(name, getattr(self, name)))  # a copy
            self._keep(name, array, "(n,)" if name == "pressure" else "")
        numbers = np.array(self.numbers)
        numbers = numbers if numbers.size else np.arange(1, count + 1)
        if numbers.dtype.kind not in "iu":
            raise InputError("numbers must be whole numbers, one for each row")
        self._keep("numbers", numbers.astype(np.int64))
        for name in ("direction", "specimen"):
            self._keep(name, np.char.strip(np.array(getattr(self, name), dtype=np.str_)))
        for name, (low, high, unit) in _RANGES.items():
            values = getattr(self, name)
            legal = (values >= low) & (values <= high) & np.isfinite(values)
            if not legal.all():
                index = int(np.argmin(legal))
                words = f"{self.name_row(index)}: {name}"
                check_number(words, float(values[index]), low=low, high=high, unit=unit)
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
        self._keep_errors()
        self._keep_free_lengths()
        self._keep_geometry()

    def _keep_errors(self) -> None:
        """Keep the standard errors, which must be above 0."""
        kept = self._take_columns("errors", MEASURED)
        for name, values in kept.items():
            for index in np.flatnonzero(~((values > 0.0) & np.isfinite(values)))[:1].tolist():
                words = f"{self.name_row(index)}: {name} error"
                unit = _RANGES[name][2]
                check_number(words, float(values[index]), low=0.0, low_open=True, unit=unit)
        object.__setattr__(self, "errors", kept)

    def _keep_free_lengths(self) -> None:
        """Keep the lengths without load, which must be legal and constant within a specimen."""
        _, first, group = np.unique(self.specimen, return_index=True, return_inverse=True)
        kept = {}
        for pressure, given in self.free_lengths.items():
            at = check_number(
                "pressure of free lengths", pressure, low=0.0, high=PRESSURE_LIMIT, unit="MPa"
            )
            name = name_free_length(at)
            values = self._spread(name, np.array(check_array(name, given)))
            wrong = (values <= 0.0) | (values != values[first][group])
            for index in np.flatnonzero(wrong)[:1].tolist():
                raise InputError(
                    f"{self.name_row(index)}: {name} is {values[index]:g} mm: it must be above 0, "
                    "and one value for each specimen"
                )
            kept[at] = values
        object.__setattr__(self, "free_lengths", kept)

    def _keep_geometry(self) -> None:
        """Keep the geometry, which must be constant within a specimen."""
        kept = self._take_columns("geometry", tuple(GEOMETRY))
        _, first, group = np.unique(self.specimen, return_index=True, return_inverse=True)
        for name, values in kept.items():
            known, model = GEOMETRY[name], values[first][group]
            near = np.isfinite(values) & (np.abs(values - model) <= 1e-9 * np.abs(model))
            for index in np.flatnonzero(~near)[:1].tolist():
                words = f"{self.name_row(index)}: {describe_field(name)}"
                value = check_number(words, float(values[index]), unit=known.unit)
                other = self.name_row(int(first[group[index]]))
                shown = [f"{x:g} {known.unit}".rstrip() for x in (value, model[index])]
                hint = "" if (self.specimen != "").any() else "; name the specimens in a column"
                raise InputError(
                    f"{words} is {shown[0]}: it must be {shown[1]}, as in {other} of the specimen "
                    f"{str(self.specimen[index])!r}{hint}"
                )
        object.__setattr__(self, "geometry", kept)

    def _take_columns(self, name: str, legal: tuple[str, ...]) -> dict[str, NDArray[np.float64]]:
        """Return a mapping's arrays, as long as the table."""
        given, kept = getattr(self, name), {}
        if not isinstance(given, Mapping):
            raise InputError(f"{name} is a {type(given).__name__}: it must be a mapping of columns")
        for key, values in given.items():
            check_word(f"a name in {name}", key, legal)
            kept[key] = self._spread(f"{name}[{key!r}]", np.array(check_array(key, values)))
        return kept

    def _keep(self, name: str, array: NDArray[np.generic], wanted: str = "") -> None:
        """Keep a read-only column."""
        object.__setattr__(self, name, self._spread(name, array, wanted))

    def _spread(self, name: str, array: NDArray[_Value], wanted: str = "") -> NDArray[_Value]:
        """Return a read-only column; what is one value counts for all rows."""
        count = np.size(self.pressure)
        if array.ndim == 0 and not wanted and name != "numbers":
            array = np.full(count, array)
        if array.ndim != 1 or len(array) != count:
            wanted = wanted or f"({count},), one for each pressure"
            raise InputError(f"{name} has shape {array.shape}: it must be {wanted}")
        array.flags.writeable = False
        return array

    def name_row(self, index: int) -> str:
        """Return how messages name the row of an index, such as ``data.csv: row 3``."""
        where = f"{self.source}: " if self.source else ""
        return f"{where}row {self.numbers[index]}"

    def __len__(self) -> int:
        return len(self.pressure)

    @property
    def branch(self) -> NDArray[np.str_] | None:
        """The directions, as models take them; None if no row has one."""
        return self.direction if (self.direction != "").any() else None

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

    @property
    def response(self) -> Literal["force", "contraction"]:
        """What was measured while the rest was held.

        What is held takes few values, what answers takes many. The levels of the loads and of the
        contractions are counted within each specimen; values that are equal to 1 % of the largest
        are one level. With at most half as many loads as contractions the loads were held
        (isotonic): the response is the contraction. With at most half as many contractions as
        loads the lengths were held (isometric): it is the force. Otherwise it is the force if the
        pressures have at most half as many levels as the loads (isobaric), else the contraction.
        """
        load, contraction, pressure = (
            self._count_levels(name) for name in ("load", "contraction", "pressure")
        )
        if 2 * load <= contraction:
            return "contraction"
        if 2 * contraction <= load or 2 * pressure <= load:
            return "force"
        return "contraction"

    def _count_levels(self, name: str) -> int:
        """Return how many levels a column has, within each specimen."""
        values = getattr(self, name)
        levels = np.round(values / (_HELD_SHARE * np.abs(values).max() or 1.0))
        _, group = np.unique(self.specimen, return_inverse=True)
        return len(np.unique(np.stack([group, levels]), axis=1).T)

    def list_specimens(self) -> tuple[str, ...]:
        """Return the names of the specimens, in the order of their first rows."""
        return tuple(dict.fromkeys(self.specimen.tolist()))

    def muscle_of(self, specimen: str, muscle: Muscle) -> Muscle:
        """Return a muscle with the measured geometry of a specimen.

        Raises
        ------
        InputError
            If there is no such specimen, or such a muscle is not legal.
        """
        check_word("specimen", specimen, self.list_specimens())
        row = int(np.argmax(self.specimen == specimen))
        known = {name: float(values[row]) for name, values in self.geometry.items()}
        whole = {n: int(x) for n, x in known.items() if GEOMETRY[n].whole and x == int(x)}
        try:
            return muscle.replace(**{**known, **whole})
        except InputError as error:
            raise InputError(f"specimen {specimen!r}: {error}") from None

    def to_frame(self) -> pandas.DataFrame:
        """Return the table, units in the names of the columns; `take_measurements` goes back.

        Raises
        ------
        MissingExtraError
            If ``pandas`` is not installed.
        """
        return make_frame(self.list_table())

    def list_table(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`."""
        units = {name: unit for name, (_, _, unit) in _RANGES.items()}
        units |= {f"{name} error": unit for name, unit in units.items()}
        units |= {name: known.unit for name, known in GEOMETRY.items()}
        units |= {name_free_length(at): "mm" for at in self.free_lengths}
        return {
            f"{describe_field(name)} [{unit}]"
            if (unit := units.get(name))
            else describe_field(name): values
            for name, values in self._list_columns().items()
        }

    def _list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return all columns by name: those of `COLUMNS`, geometry, errors, free lengths."""
        more = {f"{name} error": values for name, values in self.errors.items()}
        more |= {name_free_length(at): values for at, values in self.free_lengths.items()}
        return {**{name: getattr(self, name) for name in COLUMNS}, **self.geometry, **more}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw contraction over pressure, by direction, and return the axes."""
        axes = take_axes(ax, x="pressure [MPa]", y="contraction [mm]")
        for direction in np.unique(self.direction).tolist():
            rows = self.direction == direction
            label = direction or "measured"
            axes.plot(self.pressure[rows], self.contraction[rows], "o", label=label)
        axes.legend()
        return axes

    def select(self, rows: ArrayLike) -> Measurements:
        """Return the rows of a mask or of indices.

        Raises
        ------
        InputError
            If no row is left, a mask has another length, or there is no row of an index.
        """
        count, index = len(self), np.atleast_1d(np.asarray(rows))
        if index.size == 0:
            index = np.zeros(0, dtype=np.int64)
        elif index.ndim != 1 or index.dtype.kind not in "biu":
            raise InputError(
                f"rows has dtype {index.dtype}: it must be a mask or whole numbers (k,)"
            )
        elif index.dtype.kind == "b" and len(index) != count:
            raise InputError(f"the mask of rows has {len(index)} entries: it must have {count}")
        elif index.dtype.kind != "b" and not (-count <= index.min() and index.max() < count):
            wrong = index[(index < -count) | (index >= count)][0]
            raise InputError(f"row index is {wrong}: it must lie in [{-count}, {count - 1}]")
        columns = {name: values[index] for name, values in self._list_columns().items()}
        return dataclasses.replace(self, **sort_columns(columns), numbers=self.numbers[index])

    def check_lengths(self, muscle: Muscle, *, braid_angle: float | None = None) -> None:
        """Check that every measured length lies between 0 and the length of the strand, if known.

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
        if braid_angle is not None:
            muscle = muscle.replace(braid_angle=braid_angle)
        for specimen in self.list_specimens():
            own = self.muscle_of(specimen, muscle)
            strand = own.braid.strand_length if "braid_angle" in own.given else math.inf
            for index in np.flatnonzero(self.specimen == specimen).tolist():
                length = own.length - float(self.contraction[index])
                check_length(f"{self.name_row(index)}: ", length, strand)

    def mean_of_directions(self) -> Measurements:
        """Return the mean of inflation and deflation, per specimen and load.

        At each pressure of the inflation that the deflation reaches as well, the deflation is
        interpolated linearly and averaged with it; repeats at one pressure are averaged first.
        The errors of the two are taken as independent. Rows without a direction are kept as they
        are. Rows of the inflation that the deflation does
        not reach, such as the turning point, are left out; `Measurements.notes` names them. (There
        friction still holds one way: the mean curve is not known.)

        Raises
        ------
        InputError
            If a specimen at a load has only one direction, or the two share no pressure.
        """
        columns, notes = self._list_columns(), list(self.notes)
        loads = self.load.round(9)  # equal but for round-off
        columns["load"] = loads
        averaged = ["contraction", *(f"{name} error" for name in self.errors)]
        known = self.direction != ""
        parts = [{name: values[~known] for name, values in columns.items()}]
        for load, specimen in sorted(set(zip(loads[known], self.specimen[known], strict=True))):
            words = f"specimen {str(specimen)!r} at {load:g} N"
            rows = known & (loads == load) & (self.specimen == specimen)
            branches = []
            for name in ("inflating", "deflating"):
                own = rows & (self.direction == name)
                if not own.any():
                    raise InputError(f"{words} has no {name} row: a mean of directions needs both")
                at, state, count = np.unique(
                    self.pressure[own], return_inverse=True, return_counts=True
                )
                means = {n: np.bincount(state, columns[n][own]) / count for n in averaged}
                branches.append((at, means))
            (up, risen), (down, fallen) = branches
            shared = (up >= down[0]) & (up <= down[-1])
            reached = f"deflation at {down[0]:g} to {down[-1]:g} MPa"
            if not shared.any():
                raise InputError(
                    f"{words}: inflation at {up[0]:g} to {up[-1]:g} MPa and {reached} share none"
                )
            if not shared.all():
                lost = ", ".join(f"{p:g}" for p in up[~shared])
                notes.append(
                    f"{words}: inflation at {lost} MPa left out, which the {reached} does not reach"
                )
            part = {name: values[rows][:1].repeat(shared.sum()) for name, values in columns.items()}
            part |= {"pressure": up[shared], "direction": np.full(shared.sum(), "")}
            for name in averaged:
                both = risen[name], np.interp(up, down, fallen[name])
                mean = 0.5 * (both[0] + both[1] if name == "contraction" else np.hypot(*both))
                part[name] = mean[shared]
            parts.append(part)
        return Measurements(
            **sort_columns({n: np.concatenate([part[n] for part in parts]) for n in columns}),
            ignored=self.ignored,
            notes=tuple(notes),
        )

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
        check_number("tolerance", tolerance, low=0.0, unit="MPa")
        order = np.lexsort((self.pressure, self.direction, self.load.round(9)))
        pressure, load = self.pressure[order], self.load.round(9)[order]
        direction, measured = self.direction[order], self.contraction[order]
        fresh = np.ones(len(self), dtype=np.bool_)
        fresh[1:] = (np.diff(pressure) > tolerance) | (np.diff(load) != 0.0)
        fresh[1:] |= direction[1:] != direction[:-1]
        state = np.cumsum(fresh) - 1
        count = np.bincount(state)
        mean = np.bincount(state, measured) / count
        squares = np.bincount(state, (measured - mean[state]) ** 2)
        freedom = int((count - 1).sum())
        return RepeatStatistics(
            pressure=np.bincount(state, pressure) / count,
            load=load[fresh],
            direction=direction[fresh],
            count=count,
            mean=mean,
            deviation=np.sqrt(squares / np.maximum(count - 1, 1)),
            pooled_deviation=float(np.sqrt(squares.sum() / max(freedom, 1))),
            degrees_of_freedom=freedom,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class RepeatStatistics(Shown):
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
        Of `pooled_deviation`; 0 means that nothing was repeated and the deviation is meaningless.
    """

    pressure: NDArray[np.float64]
    load: NDArray[np.float64]
    direction: NDArray[np.str_]
    count: NDArray[np.int64]
    mean: NDArray[np.float64]
    deviation: NDArray[np.float64]
    pooled_deviation: float
    degrees_of_freedom: int


def check_length(where: str, length: float, strand: float) -> float:
    """Return a measured length if a muscle of such strands can have it, or raise `InputError`."""
    if length > strand:
        shown = show_apart(length, strand)
        raise InputError(
            f"{where}length is {shown[0]} mm, longer than the strand: "
            f"it must lie in (0, {shown[1]}] mm"
        )
    return check_number(f"{where}length", length, low=0.0, low_open=True, high=strand, unit="mm")


def describe_field(name: str) -> str:
    """Return how tables call a field of a muscle, or a column."""
    return "rest length" if name == "length" else name.replace("_", " ")


_FREE_LENGTH = re.compile(r"\s*(?:free )?length at ([^\[(]+?)\s*(?:[\[(].*)?", re.IGNORECASE)


def name_free_length(pressure: float) -> str:
    """Return the name of a column of lengths without load at a pressure [MPa]."""
    return f"length at {1e3 * pressure:.10g} kPa"


def parse_free_length(title: str) -> float | None:
    """Return the pressure [MPa] of a column such as ``length at 620 kPa [mm]``, None of others."""
    match = _FREE_LENGTH.fullmatch(title)
    return parse_quantity(match[1], "pressure") if match else None


def sort_columns(columns: Mapping[str, NDArray[np.generic]]) -> Json:
    """Return the arguments of `Measurements` from columns by name, errors as ``load error``."""
    errors = {name: f"{name} error" for name in MEASURED if f"{name} error" in columns}
    return {
        **{name: columns[name] for name in COLUMNS if name in columns},
        "errors": {name: columns[title] for name, title in errors.items()},
        "geometry": {name: columns[name] for name in GEOMETRY if name in columns},
        "free_lengths": {
            at: x for name, x in columns.items() if (at := parse_free_length(name)) is not None
        },
    }
