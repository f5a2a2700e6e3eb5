"""Checks on numbers and arrays given by a user: pass the value on, or raise one clear line."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import reprlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from numbers import Real
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError
from .units import INTERNAL_UNITS, add_unit, parse_quantity

T = TypeVar("T")

_NO_NUMBERS = (str, bytes, bytearray, bool, np.bool_, complex, np.complexfloating)


_ALL_DIGITS = 16  # with one more, numbers that differ read apart
_NUMBER = r"[-+0-9.einf]+"


def show_apart(value: float, *limits: float, digits: int = 6, form: str = "g") -> list[str]:
    """Return a number and others as text, all with so many digits that it reads apart from them.

    So no message says that 15 must be above 15. They have `digits` at least; with the form "f" so
    many decimals.
    """
    numbers = [float(value), *map(float, limits)]
    while True:
        form = "g" if digits > _ALL_DIGITS else form
        shown = [f"{number:z.{digits}{form}}" for number in numbers]  # no "-0.00" beside 0.00
        pairs = zip(shown[1:], numbers[1:], strict=True)
        if digits > _ALL_DIGITS or not any(
            text == shown[0] and number != numbers[0] for text, number in pairs
        ):
            return shown
        digits += 1


def _round_to(value: float, digits: int, rounding: str) -> str:
    if not math.isfinite(value):
        return f"{value:g}"
    exact = Decimal(repr(float(value)))  # as JSON writes it
    rounded = exact.quantize(Decimal(1).scaleb(-digits), rounding=rounding)
    return f"{rounded + 0:f}"  # 0.00 is never negative


def floor_mm(value: float, digits: int = 2) -> str:
    """Write a length rounded down, as a lower bound or what is offered must be."""
    return _round_to(value, digits, ROUND_FLOOR)


def ceil_mm(value: float, digits: int = 2) -> str:
    """Write a length rounded up, as an upper bound must be; 1e-9 of the last place is rounding."""
    return _round_to(value - 10.0 ** (-digits - 9), digits, ROUND_CEILING)


def floor_beside(value: float, *others: float) -> list[str]:
    """Write a length rounded down, others rounded up: with decimals that show which is larger."""
    for digits in range(2, 12):
        shown = [floor_mm(value, digits), *(ceil_mm(other, digits) for other in others)]
        signs = [np.sign(float(text) - float(shown[0])) for text in shown[1:]]
        if signs == [np.sign(other - value) for other in others]:
            break
    return shown


def show_beside(value: float, text: str) -> str:
    """Return a number with so many digits that it reads apart from the other ones in a text."""
    limits = [
        float(word) for word in re.findall(r"(?<![\w.])-?[0-9.]*[0-9](?:e[-+]?[0-9]+)?", text)
    ]
    return show_apart(value, *limits)[0]


def restate_typed(message: str, text: str, kind: str) -> str:
    """Return the message of an error with the value as it was given, in another unit than ours.

    The legal range that follows the value is repeated in that unit.
    """
    typed, own = text.strip(), INTERNAL_UNITS[kind]
    value, unit = parse_quantity(text, kind), typed.lstrip("+-.0123456789eE ")
    if not value or not unit or unit == own:
        return message
    suffix = re.escape(f" {own}")
    form = rf" is ({_NUMBER}){suffix}:(?:.*?([\[(])({_NUMBER}), ({_NUMBER})([\])]){suffix})?"
    for match in re.finditer(form, message):
        if not math.isclose(float(match[1]), value, rel_tol=1e-5):
            continue
        if match[2] is None:
            return f"{message} ({typed} was given)"
        scale = parse_quantity(f"1{unit}", kind)
        ends = [float(match[k]) / scale for k in (3, 4)]
        _, low, high = show_apart(value / scale, *ends)
        return f"{message} ({typed} was given, {match[2]}{low}, {high}{match[5]} {unit} is legal)"
    return message


def check_number(
    name: str,
    value: float,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    low_open: bool = False,
    unit: str = "",
) -> float:
    """Return `value` as a finite float inside its legal range.

    Parameters
    ----------
    name : str
        What the value is, for the message.
    value : float
        The value received. Text and truth values are no numbers.
    low, high : float
        Legal range.
    low_open : bool
        Whether `low` itself is illegal.
    unit : str
        Unit for the message.

    Raises
    ------
    InputError
        If the value is not a finite number in the range.
    """
    suffix = f" {unit}" if unit else ""
    left = "(" if low_open or math.isinf(low) else "["
    right = ")" if math.isinf(high) else "]"
    legal = f"{left}{low:g}, {high:g}{right}{suffix}"
    given: Any = value
    if isinstance(given, np.ndarray) and given.ndim == 0:
        given = given.item()
    try:
        if isinstance(given, (*_NO_NUMBERS, np.ndarray)):
            raise TypeError
        number = float(given)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {show_value(value)}: it must be a number in {legal}") from None
    below = number <= low if low_open and not math.isinf(low) else number < low
    if not math.isfinite(number) or below or number > high:
        hint = _ask_unit(name, number, high, unit)
        shown = show_apart(number, low, high)
        legal = f"{left}{shown[1]}, {shown[2]}{right}{suffix}"
        raise InputError(f"{name} is {shown[0]}{suffix}: it must lie in {legal}{hint}")
    return number


def _ask_unit(name: str, value: float, high: float, unit: str) -> str:
    """Return a question after the unit of a pressure that would be legal in kPa."""
    return (
        "; is it in kPa?"
        if unit == "MPa" and "pressure" in name and (high < value <= 1e3 * high)
        else ""
    )


def check_integer(name: str, value: int, *, low: int | None = None, high: int | None = None) -> int:
    """Return `value` as an int inside `[low, high]`, or raise `InputError`."""
    legal = f"[{'-inf' if low is None else low}, {'inf' if high is None else high}]"
    try:
        number = int(value)
        whole = not isinstance(value, _NO_NUMBERS) and number == value
    except (TypeError, ValueError, OverflowError):
        whole = False
    if not whole:
        raise InputError(f"{name} is {show_value(value)}: it must be a whole number in {legal}")
    if (low is not None and number < low) or (high is not None and number > high):
        raise InputError(f"{name} is {number}: it must lie in {legal}")
    return number


def check_word(name: str, word: str, legal: Iterable[str]) -> str:
    """Return `word` if it is one of the legal ones, or raise `InputError`."""
    if not isinstance(word, str) or word not in legal:
        raise InputError(f"{name} is {show_value(word)}: it must be one of {', '.join(legal)}")
    return word


def choose(noun: str, name: str, known: Mapping[str, T]) -> T:
    """Return what is known by a name, or raise `InputError`; `noun` is what the name stands for."""
    if not isinstance(name, str) or name not in known:
        shown = f"'{name}'" if isinstance(name, str) else show_value(name)
        raise InputError(f"there is no {noun} {shown}: choose one of {', '.join(known)}")
    return known[name]


def check_kind(name: str, value: object, kind: type) -> None:
    """Raise `InputError` unless a value is of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIO" else "a"
        raise InputError(f"{name} is {show_value(value)}: it must be {article} {kind.__name__}")


def check_path(name: str, path: str | os.PathLike[str]) -> Path:
    """Return a path as a `Path`, or raise `InputError`."""
    if not isinstance(path, (str, os.PathLike)):
        raise InputError(f"{name} is {show_value(path)}: it must be the path of a file")
    return Path(path)


def check_array(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return `values` as an array of floats; they need not be finite.

    Raises
    ------
    InputError
        If they are text, truth values, complex, hidden by a mask, of a unit that would be dropped,
        or no array at all.
    """
    given: object = values
    if type(given) is float:
        return np.asarray(given)
    if type(given) is np.ndarray and given.dtype == np.float64:
        return given
    if isinstance(given, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(given)):
        raise _no_array(name, given, ", none of them masked")
    leaf = given
    while isinstance(leaf, (list, tuple)) and leaf:
        leaf = leaf[0]
    # Pint has `units` and astropy `unit`; NumPy would drop them.
    if hasattr(leaf, "units") or hasattr(leaf, "unit"):
        raise _no_array(name, given, " without a unit, in Bozzini's own (mm, N, MPa, rad, s)")
    try:
        array = np.asarray(values)
        kind = array.dtype.kind
        # Of Python's own big integers NumPy makes objects; of None it would make NaN.
        if kind not in "iufO" or (kind == "O" and not all(map(_is_real, array.flat))):
            raise TypeError
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise _no_array(name, given) from None


def take_named(name: str, values: object) -> Mapping[str, ArrayLike] | None:
    """Return values that have names, as a mapping; None for what has none, such as an array.

    Names are the keys of a mapping, the columns of a table or the labels of a series. Labels that
    only count, 0 to n - 1, are no names.

    Raises
    ------
    InputError
        If a table has a name twice.
    """
    if isinstance(values, Mapping):
        return values
    if isinstance(values, (np.ndarray, np.generic)):
        return None
    labels = getattr(values, "columns", None)
    if labels is None:
        keys = getattr(values, "keys", None)
        labels = keys() if callable(keys) else None
    if labels is None:
        return None
    labels = list(labels)
    if labels == list(range(len(labels))):
        return None
    if len(set(labels)) < len(labels):
        twice = next(label for k, label in enumerate(labels) if label in labels[:k])
        raise InputError(f"{name} has the name {twice!r} twice: each may be there once")
    return {label: values[label] for label in labels}  # type: ignore[index]


def _no_array(name: str, values: object, more: str = "") -> InputError:
    wrong = f"{name} is {show_value(values)}: it must be a number or an array of numbers"
    return InputError(wrong + more)


def check_range(
    name: str,
    values: NDArray[np.float64],
    low: float,
    high: float,
    unit: str = "",
    *,
    slack: float = 0.0,
) -> None:
    """Raise `InputError` that names the first of `values` outside `[low, high]`, NaN included.

    `slack` is the round-off allowed on either side.
    """
    least, most = low - slack, high + slack
    if values.size and not (values.min() >= least and values.max() <= most):
        index = int(np.argmin((values >= least) & (values <= most)))
        suffix = f" {unit}" if unit else ""
        value = float(values.flat[index])
        shown = show_apart(value, low, high)
        raise InputError(
            f"{name_at(name, values, index)} is {shown[0]}{suffix}: "
            f"it must lie in [{shown[1]}, {shown[2]}]{suffix}{_ask_unit(name, value, high, unit)}"
        )


def check_axes(
    name: str, points: NDArray[np.float64], low: float, high: float, unit: str = ""
) -> None:
    """Raise `InputError` that names the first coordinate of `points` outside `[low, high]`."""
    if points.size and not (points.min() >= low and points.max() <= high):
        for axis, values in zip("xyz", np.moveaxis(points, -1, 0), strict=False):
            check_range(f"{name} {axis}", values, low, high, unit)


@contextmanager
def add_hint(hint: str) -> Iterator[None]:
    """End the message of an `InputError` with a hint."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{error}{hint}") from None


def name_at(name: str, values: NDArray[np.generic], index: int) -> str:
    """Return the name of the `index`-th of `values`, ``load[2, 1]`` for example."""
    if values.ndim == 0:
        return name
    place = ", ".join(str(i) for i in np.unravel_index(index, values.shape))
    return f"{name}[{place}]"


def refuse_first(
    wrong: NDArray[np.bool_],
    name: str,
    values: NDArray[np.float64],
    must: str | Callable[[int], str],
    *,
    unit: str = "",
) -> None:
    """Raise `InputError` that names the first of `values` where `wrong` is true.

    `must` is what it must be; a function takes the flat index. A ``{}`` in the name is where the
    index stands.
    """
    if np.any(wrong):
        index = int(np.argmax(wrong))
        text = must if isinstance(must, str) else must(index)
        stem, _, rest = name.partition("{}")
        suffix = f" {unit}" if unit else ""
        value = f"{show_beside(float(values.flat[index]), text)}{suffix}"
        raise InputError(f"{name_at(stem, values, index)}{rest} is {value}: {text}")


def show_range(values: NDArray[np.float64], index: int, low: ArrayLike, high: ArrayLike) -> str:
    """Return the legal range of one of some values, which the value reads apart from."""
    ends = (float(np.broadcast_to(end, values.shape).flat[index]) for end in (low, high))
    _, first, last = show_apart(float(values.flat[index]), *ends)
    return f"[{first}, {last}]"


def broadcast(*named: tuple[str, NDArray[np.float64]]) -> tuple[NDArray[np.float64], ...]:
    """Return the arrays, contiguous and of one shape, or raise `InputError`.

    They may share memory with what was given: not to be written to.
    """
    given = named[0][1].shape
    if all(array.shape == given and array.flags.c_contiguous for _, array in named):
        return tuple(array for _, array in named)
    try:
        shape = np.broadcast_shapes(*(array.shape for _, array in named))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in named)
        raise InputError(f"these shapes do not go together: {shapes}") from None
    # np.ascontiguousarray would turn a single number into an array of one.
    return tuple(np.require(np.broadcast_to(array, shape), requirements="C") for _, array in named)


def check_points(name: str, points: ArrayLike, *, dim: int = 3) -> NDArray[np.float64]:
    """Return `points` as a finite float array of shape `(..., dim)`, or raise `InputError`."""
    try:
        array = check_array(name, points)
    except InputError:
        raise InputError(f"{name} must be an array of numbers of shape (..., {dim})") from None
    if array.ndim == 0 or array.shape[-1] != dim:
        raise InputError(f"{name} has shape {array.shape}: it must be (..., {dim})")
    if not np.all(np.isfinite(array)):
        bad = int(np.count_nonzero(~np.isfinite(array).all(axis=-1)))
        raise InputError(f"{name} has {bad} point(s) that are not finite (NaN or infinite)")
    return array


def _is_real(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def show_value(value: object) -> str:
    """Return a value as one short line; of much data only the beginning is looked at."""
    brief = reprlib.Repr()
    brief.maxstring = brief.maxother = brief.maxlong = 80
    try:
        text = " ".join(brief.repr(value).split())
    except ValueError:  # an integer of more digits than Python writes
        return f"a huge {type(value).__name__}"
    return text if len(text) <= 80 else f"{text[:77]}..."


Limit = float | Callable[[Any], float]
"""An end of a legal range: a number, or a function of the object whose field it is."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is known of a field of a dataclass: checks, options, fits and tables read it here.

    Attributes
    ----------
    kind : str
        A key of `bozzini.units.INTERNAL_UNITS`; for what is no number "text", "flag", "file",
        "end" or "labels".
    help : str
        What it is, in a few words.
    low, high : float or callable
        Legal range; a callable takes the object, whose fields before this one are checked.
    low_open : bool
        Whether `low` itself is illegal.
    whole : bool
        Whether it is a whole number.
    scale : float, optional
        How much of it matters to a fit; None for a tenth of where the fit starts.
    label : str
        What messages call it; by default the field's name with blanks.
    words : tuple of str
        The legal words, where it is one of a few.
    option : str
        Its option of the command line, if not ``--`` and the field's name.
    source : str
        Where the default comes from.
    example : str
        What a template shows where there is no default.
    by_name : bool
        Whether commands take it as ``--set NAME=VALUE``: a field that few change, or of a file.
    """

    kind: str = "dimensionless"
    help: str = ""
    low: Limit = -math.inf
    high: Limit = math.inf
    low_open: bool = False
    whole: bool = False
    scale: float | None = None
    label: str = ""
    words: tuple[str, ...] = ()
    option: str = ""
    source: str = ""
    example: str = ""
    by_name: bool = False

    @property
    def unit(self) -> str:
        """The unit, empty for none."""
        return INTERNAL_UNITS.get(self.kind, "")

    def describe(self, item: object = None) -> str:
        """Return what it is, its unit and its legal range in words; angles in degrees.

        Parameters
        ----------
        item : object, optional
            The dataclass, for limits that depend on its other fields; without it they are left out.
        """
        ends = [
            (math.inf if item is None else end(item)) if callable(end) else end
            for end in (self.low, self.high)
        ]
        shown = [math.degrees(end) if self.kind == "angle" else end for end in ends]
        low, high = (f"{x:.0f}" if abs(x) < 1e10 and x == round(x) else f"{x:g}" for x in shown)
        bounds = ""
        if math.isfinite(ends[0]) and math.isfinite(ends[1]):
            bounds = f"in {'(' if self.low_open else '['}{low}, {high}]"
        elif math.isfinite(ends[0]):
            bounds = f"above {low}" if self.low_open else f"{low} or more"
        elif math.isfinite(ends[1]):
            bounds = f"{high} or less"
        unit = "deg" if self.kind == "angle" else self.unit
        kinds = f"one of {', '.join(self.words)}" if self.words else "a whole number" * self.whole
        kinds = "true or false" if self.kind == "flag" else kinds
        words = ", ".join(filter(None, (unit or kinds, bounds)))
        return "; ".join(filter(None, (" ".join(self.help.split()).rstrip("."), words)))

    def is_legal(self, value: float, item: object) -> bool:
        """Whether a float is a legal value, the other fields of a dataclass being as they are."""
        low = self.low(item) if callable(self.low) else self.low
        high = self.high(item) if callable(self.high) else self.high
        inside = (low < value if self.low_open else low <= value) and value <= high
        return inside and math.isfinite(value) and not (self.words or self.whole)

    def check(self, name: str, value: Any, item: Any = None) -> float:
        """Return a legal value as a plain number, or raise `InputError`.

        Parameters
        ----------
        name : str
            What messages call it.
        value : float
            The value received.
        item : object, optional
            The dataclass, for limits that depend on its other fields.
        """
        low, high = (end(item) if callable(end) else end for end in (self.low, self.high))
        if self.whole:
            least, most = (None if math.isinf(end) else int(end) for end in (low, high))
            return check_integer(name, value, low=least, high=most)
        return check_number(name, value, low=low, high=high, low_open=self.low_open, unit=self.unit)


def quantity(kind: str = "dimensionless", help: str = "", **known: Any) -> Any:
    """Return a dataclass field that carries a `Quantity`; see `Quantity` for the keywords.

    ``default`` and ``kw_only`` are those of `dataclasses.field`.
    """
    own = {name: known.pop(name) for name in ("default", "kw_only") if name in known}
    own.setdefault("default", MISSING)
    metadata = {"quantity": Quantity(kind=kind, help=help, **known)}
    return dataclasses.field(**own, metadata=metadata)


_KNOWN: dict[type, Mapping[str, Quantity]] = {}
_DEFAULTS: dict[type, Mapping[str, object]] = {}


def list_fields(*kinds: type) -> dict[str, dataclasses.Field[object]]:
    """Return the fields of dataclasses that are made by `quantity`, by name."""
    fields = (item for kind in kinds for item in dataclasses.fields(kind))
    return {item.name: item for item in fields if "quantity" in item.metadata}


def spell_option(item: dataclasses.Field[object]) -> str:
    """Return how the command line calls a dataclass's field that carries a `Quantity`."""
    return f"--{(item.metadata['quantity'].option or item.name).replace('_', '-')}"


def list_quantities(kind: type) -> Mapping[str, Quantity]:
    """Return what is known of the fields of a dataclass that are made by `quantity`."""
    if kind not in _KNOWN:
        known = {item.name: item.metadata.get("quantity") for item in dataclasses.fields(kind)}
        _KNOWN[kind] = MappingProxyType({name: item for name, item in known.items() if item})
    return _KNOWN[kind]


def legal_range(item: object, name: str) -> tuple[float, float]:
    """Return the legal range of a field, the other fields of the object being as they are."""
    known = list_quantities(type(item))[name]
    low, high = (end(item) if callable(end) else end for end in (known.low, known.high))
    return low, high


def check_fields(item: Any, prefix: str = "", *, skip: tuple[str, ...] = ()) -> None:
    """Check the fields of a dataclass made by `quantity`, and turn them into plain numbers.

    A default outside fixed limits is legal: it means that the value is not given.

    Parameters
    ----------
    item : object
        A dataclass, frozen or not, in its ``__post_init__``.
    prefix : str
        Put before the names of fields in messages.
    skip : tuple of str
        Fields that hold more than one number; the class checks them itself.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """
    kind = type(item)
    if kind not in _DEFAULTS:
        _DEFAULTS[kind] = {field.name: field.default for field in dataclasses.fields(kind)}
    defaults, values = _DEFAULTS[kind], vars(item)
    for name, known in list_quantities(kind).items():
        if name in skip or (values[name] is None and defaults[name] is None):
            continue
        if type(values[name]) is float and known.is_legal(values[name], item):
            continue
        words = known.label or prefix + name.replace("_", " ")
        value, default = getattr(item, name), defaults[name]
        if known.words and not isinstance(value, tuple):
            check_word(words, value, known.words)
        if known.words or known.kind not in INTERNAL_UNITS:
            continue
        fixed = not callable(known.low) and not callable(known.high)
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        given = not (fixed and is_number and value == default)
        object.__setattr__(item, name, known.check(words, value, item) if given else default)


def describe_fields(item: object) -> dict[str, float]:
    """Return the fields of a dataclass made by `quantity`, with their units in the names.

    Those of a muscle that are unset are left out.
    """
    unset = getattr(item, "unset", ())
    return {
        add_unit(name, known.unit): getattr(item, name)
        for name, known in list_quantities(type(item)).items()
        if name not in unset
    }
