"""The base of all results: an answer or a reason, as a dictionary, a table or a notebook cell."""

from __future__ import annotations

import dataclasses
import math
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

from .checks import Quantity, show_value
from .errors import ConvergenceError, InputError, MissingExtraError
from .units import add_unit
from .views import find_view

if TYPE_CHECKING:
    import numpy as np
    import pandas
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

Json = dict[str, Any]
"""Values by name that JSON takes."""

DRAWN_LIMIT = 100
"""Members of a batch that one picture may show."""

SHOWN_NUMBERS = 16
"""Numbers of an array that a representation shows."""

SHOWN_ROWS = 20
"""Rows of a table that a notebook shows."""


SHOWN_LENGTH = 100
"""Characters of a field that a representation shows."""

SHOWN_TOTAL = 300
"""Characters of a representation."""


def show_briefly(self: object) -> str:
    """Return the name and the fields of a dataclass, for its `__repr__`, where not the default.

    Of a large array the shape is shown, of what is long else the type, and how many there are.
    """
    texts, left = [], SHOWN_TOTAL - len(type(self).__name__) - len("(, ...)")
    for field, value in list_changed(self):
        texts.append(f"{field.name}={_show_field(value)}")
        left -= len(texts[-1]) + len(", ")
        if left < 0:
            texts[-1] = "..."
            break
    return f"{type(self).__name__}({', '.join(texts)})"


def list_changed(item: object) -> list[tuple[dataclasses.Field[object], object]]:
    """Return the fields of a dataclass that are shown and are not the default, with their values.

    One that is unset, so that to read it is an error, is left out.
    """
    unset = getattr(item, "unset", ())
    found = []
    for field in getattr(type(item), "__dataclass_fields__", {}).values():
        if field.repr and field.name not in unset:
            value, default = getattr(item, field.name), field.default
            if not (type(value) is type(default) and value == default):
                found.append((field, value))
    return found


class Shown:
    """A dataclass that is shown briefly, as text and in a notebook."""

    def __init_subclass__(cls) -> None:
        """Show it briefly: a dataclass takes what stands in the class already."""
        super().__init_subclass__()
        if "__repr__" not in vars(cls):
            own = cls.__repr__ is not object.__repr__
            cls.__repr__ = cls.__repr__ if own else show_briefly  # type: ignore[method-assign]

    def _repr_html_(self) -> str | None:
        """Return a table of the fields that are not the default, with their units."""
        from html import escape

        rows = []
        for field, value in list_changed(self):
            known = field.metadata.get("quantity")
            unit = known.unit if isinstance(known, Quantity) else field.metadata.get("unit", "")
            shown = f"{_show_field(value)} {unit}".rstrip()
            rows.append(f"<tr><th>{field.name}</th><td>{escape(shown)}</td></tr>")
        return f"<p>{escape(type(self).__name__)}</p><table>{''.join(rows)}</table>"


def _show_field(value: object) -> str:
    if getattr(value, "size", 0) > SHOWN_NUMBERS:
        return f"<{getattr(value, 'shape', '')}>"
    text = repr(value)
    if len(text) <= SHOWN_LENGTH:
        return text
    if isinstance(value, (tuple, list)):
        return f"<{len(value)} {type(value[0]).__name__}>"
    if isinstance(value, Mapping):
        return f"<{len(value)} {type(next(iter(value.values()))).__name__}>"
    return f"<{type(value).__name__}>"


class Result(Shown):
    """An answer, or the reason why there is none.

    A subclass is a dataclass with `converged`, `reason` and `residual`, as fields or as properties.
    In a result of a batch these are arrays.

    Attributes
    ----------
    converged : bool or ndarray of bool
        Whether the answer meets its tolerance.
    reason : str or ndarray of str
        Why not, or why the answer is less than what was asked for; empty otherwise.
    residual : float or ndarray
        What is left over of the equations; the unit is in the subclass.
    """

    if TYPE_CHECKING:
        converged: Any
        reason: Any
        residual: Any

    rows_have_verdict: ClassVar[bool] = False
    """Whether each row of `to_frame` has `converged` and `reason`; `list_columns` is without."""

    def require(self) -> Self:
        """Return the result if all of it has converged.

        Raises
        ------
        ConvergenceError
            If not, with the reason.
        """
        if words := self._describe_failure():
            raise ConvergenceError(words)
        return self

    def _describe_failure(self) -> str:
        """Return that the result is no answer and why, or nothing."""
        verdict = _flatten(to_plain(self.converged))
        if all(verdict):
            return ""
        reasons = sorted({str(text) for text in _flatten(to_plain(self.reason)) if text})
        count = f" in {verdict.count(False)} of {len(verdict)}" if len(verdict) > 1 else ""
        words = f"{type(self).__name__} has not converged{count}"
        return ": ".join([words, *reasons[:1]])

    def to_dict(self) -> Json:
        """Return the result as plain values, which JSON takes; not finite numbers are None.

        Fields made by `measured` have their units in their names.
        """
        fields = [field for field in dataclasses.fields(self) if field.repr]  # type: ignore[arg-type]
        values = {
            add_unit(field.name, field.metadata.get("unit", "")): getattr(self, field.name)
            for field in fields
        }
        for name in ("converged", "reason", "residual"):
            values.setdefault(name, getattr(self, name))
        return {name: to_plain(value) for name, value in values.items()}

    def show(self, wall: object = None) -> object:
        """Return the result in 3-D, as a notebook shows it; see `bozzini.scene.show`.

        Parameters
        ----------
        wall : tract or duct, optional
            What is round it; without it a plan has the widest tube round its centreline.

        Raises
        ------
        InputError
            If there is no view of such a result.
        """
        return find_view(type(self))(self, wall)

    def to_frame(self) -> pandas.DataFrame:
        """Return the result as a table of pandas; units are in the names of the columns.

        Raises
        ------
        MissingExtraError
            If ``pandas`` is not installed.
        """
        return make_frame(self.list_table())

    def list_table(self) -> Json:
        """Return the columns of `to_frame`, with the verdict on each row where there is one."""
        import numpy

        columns: Json = dict(self.list_columns())
        if self.rows_have_verdict:
            count = max(map(numpy.size, columns.values()))
            for name in ("converged", "reason"):
                values = numpy.ravel(getattr(self, name))
                columns[name] = numpy.repeat(values, count // max(values.size, 1))
        return columns

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`: the fields made by `tabulated` and `rows_of`.

        Without any: one row, of what is a single value.
        """
        columns: Json = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if "rows" in field.metadata:
                for item in dataclasses.fields(field.metadata["rows"]):
                    if "column" in item.metadata:
                        name = _name_column(item)
                        columns[name] = [getattr(row, item.name) for row in value]
            elif "column" in field.metadata:
                columns |= self._spread(_name_column(field), value, field.metadata["over"])
        return columns or {
            name: [value]
            for name, value in self.to_dict().items()
            if not isinstance(value, (dict, list))
        }

    def _spread(self, name: str, value: ArrayLike, over: str) -> Json:
        """Return an array as columns: one, or with a gap in the name one for each last index."""
        import numpy

        if "{}" not in name:
            return {name: numpy.ravel(value)}
        names = operator.attrgetter(over)(self) if over else "xyz"
        flat = numpy.reshape(value, (-1, numpy.shape(value)[-1]))
        return {name.format(names[k]): column for k, column in enumerate(flat.T)}

    def _repr_html_(self) -> str | None:
        """Return what a notebook shows; without ``pandas`` it shows the representation."""
        from html import escape

        words = [type(self).__name__]
        reasons = [str(text) for text in _flatten(to_plain(self.reason)) if text]
        words += [] if all(_flatten(to_plain(self.converged))) else ["not converged"]
        words += sorted(set(reasons))[:3]
        try:
            table = self.to_frame().to_html(max_rows=SHOWN_ROWS)
        except MissingExtraError:
            return None
        return f"<p>{escape(': '.join(words))}</p>{table}"


def make_frame(columns: Mapping[str, object]) -> pandas.DataFrame:
    """Return columns as a table of pandas.

    Raises
    ------
    MissingExtraError
        If ``pandas`` is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise MissingExtraError("pandas", "tables") from None
    return pandas.DataFrame(columns)


class ReasonedResult(Result):
    """A result that has converged unless there is a reason against it."""

    @property
    def converged(self) -> bool:
        """Whether all is as was asked for: there is no `reason`."""
        return not self.reason


class ClosedForm(Result):
    """The result of a closed form: it always converges, and nothing is left over."""

    converged = True
    reason = ""
    residual = 0.0


def list_coordinates(name: str, points: NDArray[np.float64]) -> Json:
    """Return points (..., k) [mm] as columns, such as ``tip_x_mm``; k is 2 or 3."""
    flat = points.reshape(-1, points.shape[-1])
    start = f"{name}_" if name else ""
    return {f"{start}{axis}_mm": flat[:, k] for k, axis in enumerate("xyz"[: flat.shape[1]])}


def measured(unit: str) -> Any:
    """Return a dataclass field of a result that has a unit."""
    return dataclasses.field(metadata={"unit": unit})


def tabulated(
    unit: str = "", name: str = "", *, over: str = "", default: object = dataclasses.MISSING
) -> Any:
    """Return a dataclass field like `measured` that stands in the table too.

    Parameters
    ----------
    unit : str
        Added to the name.
    name : str
        Of the column, without the unit; that of the field if empty. With ``{}`` there is a column
        for each last index of the array, and ``{}`` stands for x, y, z.
    over : str
        The attribute of the result with the names that ``{}`` stands for instead.
    default : object
    """
    metadata = {"unit": unit, "column": name, "over": over}
    return dataclasses.field(default=default, metadata=metadata)


def rows_of(kind: type) -> Any:
    """Return a dataclass field whose items, each a dataclass, are the rows of the table."""
    return dataclasses.field(metadata={"rows": kind})


def list_row(item: object) -> Json:
    """Return the fields of a dataclass made by `tabulated` as plain values, units in the names."""
    return {
        _name_column(field): to_plain(getattr(item, field.name))
        for field in dataclasses.fields(item)  # type: ignore[arg-type]
        if "column" in field.metadata
    }


def format_rows(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for people, its columns aligned to the right but for the first."""
    table = [list(head), *(list(row) for row in rows)]
    widths = [max(len(line[i]) for line in table) for i in range(len(head))]
    lines = []
    for line in table:
        others = zip(line[1:], widths[1:], strict=True)
        cells = [line[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in others)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def _name_column(field: dataclasses.Field[object]) -> str:
    return add_unit(field.metadata["column"] or field.name, field.metadata["unit"])


def to_plain(value: object, *, unknown: Callable[[object], object] = repr) -> Any:
    """Return a value made of plain types: numbers, texts, lists, dictionaries with text as keys.

    A number that is not finite becomes None, and what has no plain form `unknown` of it: by
    default its representation.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Result):
        return to_plain(value.to_dict(), unknown=unknown)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # NumPy arrays and numbers
        return to_plain(value.tolist(), unknown=unknown)
    if isinstance(value, (list, tuple)):
        return [to_plain(item, unknown=unknown) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        unset = getattr(value, "unset", ())  # of a muscle: to read such a field is an error
        names = [field.name for field in dataclasses.fields(value) if field.repr]
        value = {name: getattr(value, name) for name in names if name not in unset}
    if isinstance(value, Mapping):
        return {str(key): to_plain(item, unknown=unknown) for key, item in value.items()}
    return unknown(value)


def _flatten(value: object) -> list[object]:
    if isinstance(value, list):
        return [item for part in value for item in _flatten(part)]
    return [value]


def check_drawn(count: int, noun: str) -> None:
    """Raise `InputError` if a batch is too large for one picture."""
    if count > DRAWN_LIMIT:
        raise InputError(f"the batch has {count} {noun}: at most {DRAWN_LIMIT} are drawn")


def take_axes(ax: Axes | None, *, x: str, y: str, equal: bool = False) -> Axes:
    """Return the axes to draw into, new ones if there are none, with labels where these are empty.

    Parameters
    ----------
    ax : Axes or None
        Axes of matplotlib.
    x, y : str
        Labels with units.
    equal : bool
        Whether both directions have one scale.
    """
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots()[1]
    if not hasattr(ax, "set_xlabel"):
        raise InputError(f"ax is {show_value(ax)}: it must be axes of matplotlib")
    ax.set_xlabel(ax.get_xlabel() or x)
    ax.set_ylabel(ax.get_ylabel() or y)
    if equal:
        ax.set_aspect("equal", adjustable="datalim")
    return ax
