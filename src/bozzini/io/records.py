"""Records: frozen dataclasses as plain data, as YAML and as JSON, with units and paths in messages.

Reading and writing are built on cattrs. It calls the dataclass as it stands, so that the checks
of the class are the checks of the file, and it takes a reader for each field, which here comes
from the field's `bozzini.checks.Quantity`. Of the alternatives, msgspec converts numbers itself
and has no hook where ``100 psi`` could become one, and pydantic wants the checks in its own
annotations, needs compiled code and takes twice as long to import. cattrs is pure Python, so that
it runs on every version that Python has.

A wrong field is one line, such as ``sections[2].length is 5 km: it must lie in ...``.
"""

from __future__ import annotations

import dataclasses
import difflib
import functools
import json
import math
import operator
import os
import sys
import types
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, check_path, check_points, list_quantities, restate_typed, show_value
from ..errors import FileFormatError, InputError
from ..results import Json, to_plain
from ..units import FULL_TURN_RAD, check_bare_angle, parse_quantity
from .files import write_text
from .inputs import note_input

if TYPE_CHECKING:
    from cattrs import Converter

_Reader = Callable[[object, object], Any]

_Record = TypeVar("_Record")


def read_record(data: object, record: type[_Record], *, name: str = "") -> _Record:
    """Build a record from plain data, as `write_record` gives it.

    Quantities may be text with a unit, such as ``"20 mm"``; bare numbers are in Bozzini's units.

    Parameters
    ----------
    data : mapping
        Fields by name; lists stand for tuples.
    record : type
        A dataclass. Fields that are dataclasses, or tuples of them, are records as well.
    name : str
        What messages call the whole; empty for "the record".

    Raises
    ------
    InputError
        One line with the path of the field, such as ``sections[2].length``, its value and what is
        legal.
    """
    return _structure(data, record, name, from_file=False)


def _structure(data: object, record: type[_Record], name: str, *, from_file: bool) -> _Record:
    from cattrs import BaseValidationError

    try:
        return _converter(from_file=from_file).structure(data, record)
    except (InputError, BaseValidationError) as error:
        path, first = _find_first(error)
        words = str(first)
        if not isinstance(first, InputError):
            words = f" cannot be read ({type(first).__name__}: {words})"
        if words.startswith(" "):  # it goes on from the name of what it is about
            words = (path or name or "the record") + words
        elif path:
            words = f"{path}: {words}"
        kind = type(first) if isinstance(first, InputError) else InputError
        raise kind(words) from None


def write_record(record: Any, *, with_units: bool = False) -> Json:
    """Return a record as plain data that `read_record` reads.

    Quantities that are legal, words to choose from among them, are always there, other fields where
    they differ from their default, and those that are unset never. Numbers that are not finite are
    None.

    Parameters
    ----------
    record : dataclass
    with_units : bool
        Whether quantities become text with their unit, angles in degrees where that is exact.
    """
    return _write_record(record, with_units=with_units)


def _write_record(record: Any, *, with_units: bool = False, to_file: bool = False) -> Json:
    known = list_quantities(record.__class__)
    unset = getattr(record, "unset", ())
    written: Json = {}
    for field in dataclasses.fields(record):
        if field.name in unset:
            continue
        value = getattr(record, field.name)
        plain = _write_value(value, with_units=with_units, to_file=to_file)
        item = known.get(field.name)
        if value != field.default or _is_legal(item, plain, record):
            if with_units and item is not None and isinstance(plain, (int, float)):
                plain = _add_unit(plain, item)
            if to_file and item is not None and item.kind == "angle":
                plain = _spell_turns(plain)
            written[field.name] = plain
    return written


def _add_unit(value: float, known: Quantity) -> object:
    """Return a quantity as text with its unit, which reads as the same number."""
    if known.kind == "angle":
        degrees = f"{math.degrees(value):.15g} deg"
        if parse_quantity(degrees, "angle") == value:
            return degrees
    return f"{value!r} {known.unit}" if known.unit else value


def _is_legal(known: Quantity | None, plain: object, record: object) -> bool:
    """Whether a default is a legal number or word, and not one that stands for none given."""
    if known is None or not isinstance(plain, (int, float)):
        return known is not None and plain in known.words
    try:
        known.check("", plain, record)
    except InputError:
        return False
    return True


def _spell_turns(plain: object) -> object:
    """Return angles, or knots of arc length and angles, with their unit beyond a full turn."""
    if not isinstance(plain, list):
        turned = isinstance(plain, (int, float)) and abs(plain) > FULL_TURN_RAD
        return f"{plain!r} rad" if turned else plain
    if plain and isinstance(plain[0], list):
        return [[place, *map(_spell_turns, rest)] for place, *rest in plain]
    return [_spell_turns(item) for item in plain]


def _write_value(value: object, *, with_units: bool = False, to_file: bool = False) -> object:
    if isinstance(value, (list, tuple)):
        return [_write_value(item, with_units=with_units, to_file=to_file) for item in value]
    if dataclasses.is_dataclass(value):
        return _write_record(value, with_units=with_units, to_file=to_file)
    return to_plain(value)


def load_record(path: str | os.PathLike[str], record: type[_Record], *, name: str = "") -> _Record:
    """Read a record from a file: JSON if it ends in ``.json``, YAML otherwise.

    An angle beyond a full turn needs its unit there.

    Raises
    ------
    FileFormatError
        One line that names the file, and the line or the field.
    """
    source = check_path("path", path)
    try:
        return _structure(load_data(source), record, name, from_file=True)
    except FileFormatError:
        raise
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


def save_record(
    record: object,
    path: str | os.PathLike[str],
    *,
    note: str = "",
    with_units: bool = False,
) -> Path:
    """Write a record to a file: JSON if it ends in ``.json``, YAML otherwise.

    Parameters
    ----------
    record : dataclass
    path : path-like
    note : str
        A comment on the first line of a YAML file.
    with_units : bool
        As in `write_record`.

    Raises
    ------
    OutputError
        If the file cannot be written; then there is none.
    """
    target = check_path("path", path)
    data = _write_record(record, with_units=with_units, to_file=True)
    if target.suffix.lower() == ".json":
        return write_text(target, json.dumps(data, indent=2) + "\n")
    return write_text(target, (f"# {note}\n" if note else "") + format_yaml(data))


def load_data(path: str | os.PathLike[str]) -> object:
    """Read plain data from a file: JSON if it ends in ``.json``, YAML otherwise.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is neither, gives a field twice, or refers to itself.
    """
    source = check_path("path", path)
    note_input(source)
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"cannot read {source}: {error.strerror or error}") from None
    except ValueError as error:
        raise FileFormatError(f"cannot read {source}: it is not UTF-8 text ({error})") from None
    try:
        return parse_json(text) if source.suffix.lower() == ".json" else parse_yaml(text)
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


DEPTH_MAX = 50
"""How many lists and objects of a file may lie in each other: what follows a tree calls itself."""


def parse_json(text: str | bytes) -> object:
    """Return what a JSON text holds, or raise `InputError` in one line."""
    try:
        data = json.loads(text, object_pairs_hook=_take_pairs)
    except InputError:
        raise
    except RecursionError:
        raise _too_deep() from None
    except ValueError as error:
        raise InputError(f"not JSON: {error}") from None
    return check_depth(data)


def check_depth(data: object) -> object:
    """Return plain data, or raise `InputError` if it is nested more than `DEPTH_MAX` deep."""
    level = [data]
    for _ in range(DEPTH_MAX + 1):
        holders = [item for item in level if isinstance(item, (dict, list, tuple))]
        if not holders:
            return data
        level = [
            part for item in holders for part in (item.values() if isinstance(item, dict) else item)
        ]
    raise _too_deep()


def _too_deep() -> InputError:
    return InputError(f"it is nested more than {DEPTH_MAX} lists or objects deep")


def parse_yaml(text: str) -> object:
    """Return what a YAML text holds, or raise `InputError` in one line."""
    import yaml

    try:
        data = yaml.load(text, Loader=_yaml_loader())
    except InputError:
        raise
    except RecursionError:
        raise _too_deep() from None
    except (yaml.YAMLError, ValueError, TypeError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"not YAML{where}: {problem}") from None
    return check_depth(data)


def format_yaml(data: Mapping[str, object]) -> str:
    """Return plain data as YAML with its fields in order."""
    import yaml

    return str(
        yaml.safe_dump(
            dict(data), sort_keys=False, allow_unicode=True, default_flow_style=None, width=100
        )
    )


def _take_pairs(pairs: list[tuple[str, object]], lines: list[int] | None = None) -> Json:
    found: Json = {}
    for index, (key, value) in enumerate(pairs):
        if key in found:
            where = f"line {lines[index]}: " if lines else ""
            raise InputError(f"{where}the field {show_value(key)} is given twice")
        found[key] = value
    return found


@cache
def _yaml_loader() -> Any:
    """Return a loader that refuses fields given twice, and references."""
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        def compose_node(self, parent: object, index: object) -> object:
            # A few lines of references to references can stand for more than fits in memory.
            if self.check_event(yaml.AliasEvent):
                event = self.peek_event()
                raise InputError(
                    f"line {event.start_mark.line + 1} refers to '&{event.anchor[:40]}': write it "
                    "out, references are not read"
                )
            return super().compose_node(parent, index)

        def construct_once(self, node: Any) -> Json:
            pairs = [
                (self.construct_object(key, deep=True), self.construct_object(value, deep=True))
                for key, value in node.value
            ]
            return _take_pairs(pairs, [key.start_mark.line + 1 for key, _ in node.value])

    Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, Loader.construct_once)
    return Loader


def _find_first(error: BaseException) -> tuple[str, BaseException]:
    """Return the first of the errors that cattrs gathers, and the path of what it is about."""
    from cattrs.errors import AttributeValidationNote, IterableValidationNote

    path = ""
    while True:
        for note in reversed(getattr(error, "__notes__", [])):
            if isinstance(note, IterableValidationNote):
                path += f"[{note.index}]"
            elif isinstance(note, AttributeValidationNote):
                path += f".{note.name}" if path else note.name
        if not isinstance(error, BaseExceptionGroup):
            return path, error
        error = error.exceptions[0]


# How each type is read. A message that starts with a blank goes on from the field's path.


@cache
def _converter(*, from_file: bool) -> Converter:
    from cattrs import BaseValidationError, Converter
    from cattrs.errors import IterableValidationNote

    converter = Converter()

    def read_list(data: object, kind: object) -> object:
        members = get_args(kind)
        count = None if members[-1] is Ellipsis else len(members)
        if not isinstance(data, (list, tuple)) or count not in (None, len(data)):
            wanted = "a list" if count is None else f"a list of {count}"
            raise InputError(f" is {show_value(data)}: it must be {wanted}")
        items = []
        for index, item in enumerate(data):
            member = members[0 if count is None else index]
            try:
                items.append(converter.structure(item, member))
            except (InputError, BaseValidationError) as error:
                error.add_note(IterableValidationNote("", index, member))
                raise
        return tuple(items)

    def read_union(data: object, kind: object) -> object:
        """Choose by what the data is: nothing, a mapping, a list (of lists), or a plain value."""
        if data is None and type(None) in get_args(kind):
            return None
        listed, mapped = isinstance(data, (list, tuple)), isinstance(data, Mapping)
        members = [member for member in get_args(kind) if member is not type(None)]
        if type(data) in members:
            return converter.structure(data, type(data))
        fitting = [
            member
            for member in members
            if listed == (get_origin(member) is tuple)
            and mapped == dataclasses.is_dataclass(member)
        ]
        if listed and len(fitting) > 1:
            nested = bool(data) and isinstance(data[0], (list, tuple))  # type: ignore[index]
            fitting.sort(key=lambda kind: (get_origin(get_args(kind)[0]) is tuple) != nested)
        if fitting:
            return converter.structure(data, fitting[0])
        return converter.structure(data, members[0])

    simple: tuple[tuple[type, _Reader], ...] = (
        (float, _read_number),
        (int, _read_count),
        (str, _read_text),
        (bool, _read_truth),
    )
    for kind, read in simple:
        converter.register_structure_hook(kind, read)
    chosen: tuple[tuple[Callable[[Any], bool], _Reader], ...] = (
        (is_quantity, _read_file_quantity if from_file else _read_quantity),
        (lambda kind: bool(get_origin(kind) is Literal), _read_choice),
        (lambda kind: bool(get_origin(kind) is tuple), read_list),
        (is_union, read_union),
        (lambda kind: get_origin(kind) is np.ndarray, _read_point),
    )
    for is_kind, read in chosen:
        converter.register_structure_hook_func(is_kind, read)
    converter.register_structure_hook_factory(
        dataclasses.is_dataclass, lambda record: _make_reader(record, converter)
    )
    return converter


def _make_reader(record: Any, converter: Converter) -> _Reader:
    """Return what builds a record; it names a field that is unknown or missing."""
    from cattrs.gen import make_dict_structure_fn, override

    fields = {field.name: field for field in dataclasses.fields(record) if field.init}
    kinds, known = get_type_hints(record, include_extras=True), list_quantities(record)
    needed = [
        name
        for name, field in fields.items()
        if field.default is field.default_factory is dataclasses.MISSING
    ]

    def read_field(kind: Any, optional: bool) -> _Reader:
        numbers = any(map(is_quantity, (kind, *get_args(kind))))

        def read(data: object, _: object) -> object:
            try:
                return converter.structure(data, kind)
            except InputError as error:
                if optional and numbers and str(error).startswith(" "):
                    raise type(error)(f"{error}, or leave it out") from None
                raise

        return read

    readers = {
        name: override(
            struct_hook=read_field(
                annotate_quantity(kinds[name], known[name]) if name in known else kinds[name],
                name not in needed and fields[name].default is not None,
            )
        )
        for name in fields
    }
    build = make_dict_structure_fn(record, converter, **readers)  # type: ignore[arg-type]
    names = ", ".join(fields)

    def read_record_fields(data: object, _: object) -> object:
        if not isinstance(data, Mapping):
            raise InputError(f" is {show_value(data)}: it must hold the fields {names}")
        for key in data:
            if key not in fields:
                close = difflib.get_close_matches(str(key), fields, n=1)
                hint = f"did you mean '{close[0]}'?" if close else f"choose from {names}"
                raise InputError(f" has an unknown field {show_value(key)}: {hint}")
        for name in needed:
            if name not in data:
                raise InputError(f" has no '{name}': it needs {', '.join(needed)}")
        return build(data, record)

    return read_record_fields


def annotate_quantity(kind: Any, known: Quantity) -> Any:
    """Return the type of a field with its quantity in the place of plain numbers."""
    if kind in (float, int):
        return Annotated[kind, known]
    members: Any = tuple(annotate_quantity(member, known) for member in get_args(kind))
    if get_origin(kind) is tuple:
        return types.GenericAlias(tuple, members)
    return functools.reduce(operator.or_, members) if is_union(kind) else kind


def is_quantity(kind: object) -> bool:
    """Whether a type is a number with what is known of it, as `annotate_quantity` makes it."""
    return get_origin(kind) is Annotated and isinstance(get_args(kind)[1], Quantity)


def is_union(kind: object) -> bool:
    """Whether a type is one of several."""
    return get_origin(kind) in (Union, types.UnionType)


def _read_quantity(data: object, kind: Any) -> float:
    known: Quantity = kind.__metadata__[0]
    if known.whole:
        return known.check("", data)
    if data is None or isinstance(data, (bool, list, tuple, Mapping)):
        article = "an" if known.kind[0] in "aeiou" else "a"
        raise InputError(f" is {show_value(data)}: it must be {article} {known.kind}")
    number = parse_quantity(data, known.kind)  # type: ignore[arg-type]  # it checks itself
    if callable(known.low) or callable(known.high):
        return number
    try:
        return known.check("", number)
    except InputError as error:
        if not isinstance(data, str):
            raise
        raise type(error)(restate_typed(str(error), data, known.kind)) from None


def _read_file_quantity(data: object, kind: Any) -> float:
    known: Quantity = kind.__metadata__[0]
    if known.kind == "angle" and isinstance(data, (int, float)) and not isinstance(data, bool):
        check_bare_angle(data, f"{data:g}")
    return _read_quantity(data, kind)


_PLAIN_NUMBER = Quantity(kind="dimensionless", help="A number.")


def _read_number(data: object, _: object) -> float:
    return _read_quantity(data, Annotated[float, _PLAIN_NUMBER])


def _read_count(data: object, _: object) -> int:
    return int(Quantity(whole=True, low=-sys.maxsize, high=sys.maxsize).check("", data))


def _read_point(data: object, _: object) -> NDArray[np.float64]:
    if not isinstance(data, (list, tuple)) or not data:
        raise InputError(f" is {show_value(data)}: it must be a list of numbers")
    return check_points("", data, dim=len(data))


def _read_text(data: object, _: object) -> str:
    if not isinstance(data, str):
        raise InputError(f" is {show_value(data)}: it must be text")
    return data


def _read_truth(data: object, _: object) -> bool:
    if not isinstance(data, bool):
        raise InputError(f" is {show_value(data)}: it must be true or false")
    return data


def _read_choice(data: object, kind: object) -> object:
    if data not in get_args(kind):
        raise InputError(f" is {show_value(data)}: choose one of {', '.join(get_args(kind))}")
    return data
