"""Shapes as plain data and as files (JSON or YAML): readable, versioned, exact."""

from __future__ import annotations

import json
import math
import os
import re
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError
from ..io.files import check_new_file, write_text
from .base import Duct
from .shapes import SHAPES

# Fields of plain data as it was read: what they must be, in one line that names them.


def take_mapping(
    value: Any, field: str, known: tuple[str, ...], needed: tuple[str, ...]
) -> Mapping[str, Any]:
    """Return a mapping that has only known fields and all that it needs, or raise `InputError`."""
    if not isinstance(value, Mapping):
        raise InputError(
            f"{field} is {show_value(value)}: it must hold the fields {', '.join(known)}"
        )
    for key in value:
        if key not in known:
            raise InputError(
                f"{field} has an unknown field {show_value(key)}: known are {', '.join(known)}"
            )
    for key in needed:
        if key not in value:
            raise InputError(f"{field} has no '{key}': it needs {', '.join(needed)}")
    return value


def take_numbers(value: Any, field: str, count: int) -> NDArray[np.float64]:
    """Return `count` finite numbers, or raise; nine of them may be three rows of three."""
    flat = [value] if count == 1 else value
    if count == 9 and isinstance(value, (list, tuple)):
        flat = [item for row in value for item in (row if isinstance(row, (list, tuple)) else [])]
    legal = isinstance(flat, (list, tuple)) and len(flat) == count
    if not legal or not all(_is_number(item) for item in flat):
        form = {1: "a number", 3: "3 numbers", 9: "3 rows of 3 numbers"}[count]
        hint = _explain_text(flat) if legal else ""
        raise InputError(f"{field} is {show_value(value)}: it must be {form}, all finite{hint}")
    return np.array(flat, dtype=np.float64)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _explain_text(values: Any) -> str:
    """Return a hint for numbers that were read as text."""
    for value in values:
        if isinstance(value, str):
            try:
                float(value)
            except ValueError:
                continue
            return "; it is text: write it without quotes, and in YAML 1.0e-3 for 1e-3"
    return ""


def show_value(value: Any) -> str:
    """Return a value as one short line; of much data only the beginning is looked at."""
    brief = reprlib.Repr()
    brief.maxstring = brief.maxother = brief.maxlong = 60
    try:
        text = " ".join(brief.repr(value).split())
    except ValueError:  # an integer of more digits than Python writes
        return f"a huge {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


# Plain data of shapes as JSON and YAML text, and back; a field given twice is refused.


def format_json(data: Mapping[str, Any]) -> str:
    """Return JSON with one shape a line."""
    head = json.dumps({key: value for key, value in data.items() if key != "shapes"}, indent=2)
    rows = ",\n".join(f"    {json.dumps(shape)}" for shape in data["shapes"])
    return f'{head[:-2]},\n  "shapes": [\n{rows}\n  ]\n}}\n'


def format_yaml(data: Mapping[str, Any]) -> str:
    """Return YAML with its fields in order."""
    import yaml

    return str(
        yaml.safe_dump(
            dict(data), sort_keys=False, allow_unicode=True, default_flow_style=None, width=1000
        )
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if key in found:
            raise InputError(f"the field {reprlib.repr(key)} is given twice")
        found[key] = value
    return found


def parse_json(text: str) -> Any:
    """Return what a JSON text holds, or raise `InputError` in one line."""
    try:
        return json.loads(text, object_pairs_hook=_once)
    except InputError:
        raise
    except RecursionError:
        raise InputError("not JSON that can be read: it is nested too deeply") from None
    except ValueError as error:
        raise InputError(f"not JSON: {error}") from None


def parse_yaml(text: str) -> Any:
    """Return what a YAML text holds, or raise `InputError` in one line."""
    import yaml

    class Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
        def compose_node(self, parent: Any, index: Any) -> Any:
            # A few lines of references to references can stand for more than fits in memory.
            if self.check_event(yaml.AliasEvent):
                event = self.peek_event()
                raise InputError(
                    f"line {event.start_mark.line + 1} refers to '&{event.anchor[:40]}': write it "
                    "out, references are not read"
                )
            return super().compose_node(parent, index)

    def construct(loader: Any, node: Any) -> dict[str, Any]:
        return _once(
            [
                (loader.construct_object(key, deep=True), loader.construct_object(value, deep=True))
                for key, value in node.value
            ]
        )

    Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, construct)
    load: Callable[..., Any] = yaml.load
    try:
        return load(text, Loader=Loader)
    except InputError:
        raise
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"not YAML{where}: {problem}") from None


VERSION = 1
"""Version of the file format that is written."""

SUFFIXES = (".json", ".yaml", ".yml")

FITS = ("inscribed", "least squares")
"""How shapes were fitted to a tract: inside its wall but for `wall_error`, or through it too."""

FORMAT = "bozzini shapes"
OPTIONS = ("wall", "wall_error", "inflation")
FIELDS = ("format", "version", "kind", "units", *OPTIONS, "fit", "note", "shapes")
NEEDED = ("format", "version", "kind", "shapes")


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapesFile:
    """What a file of shapes holds.

    Parameters
    ----------
    shapes : Duct
        Of a class in `SHAPES`.
    fit : str
        How they were fitted to a tract, one of `FITS`; empty if they were not, or that is not
        known. What is proved to pass shapes that are inscribed passes the tract, but for their
        `wall_error`; what does not pass them may pass the tract, of which they leave out a part.
    note : str
        What they are, for people.
    """

    shapes: Duct
    fit: str = ""
    note: str = ""


def save_shapes(
    duct: Duct,
    path: str | os.PathLike[str],
    *,
    fit: str = "",
    note: str = "",
    force: bool = False,
) -> Path:
    """Write shapes to a file, as JSON or YAML by its suffix.

    Numbers are written with all their digits: `load_shapes` gives the same shapes exactly.

    Parameters
    ----------
    duct : Duct
        Of a class in `SHAPES`.
    path : path-like
        Ends in ``.json``, ``.yaml`` or ``.yml``.
    fit : str
        One of `FITS` if they were fitted to a tract.
    note : str
        What they are, for people.
    force : bool
        Replace a file that exists.

    Raises
    ------
    OutputError
        If the suffix is another, the file exists, or it cannot be written.
    InputError
        If the duct has no such form, or `fit` is another.
    """
    target = Path(path)
    check_shapes_target(target, force=force)
    data = write_shapes(duct, fit=fit, note=note)
    if target.suffix.lower() == ".json":
        return write_text(target, format_json(data))
    return write_text(target, format_yaml(data))


def check_shapes_target(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Raise `OutputError` at once if `save_shapes` would refuse this path later."""
    check_new_file(path, SUFFIXES, force=force)


def count_pieces(duct: Duct) -> int:
    """Return how many shapes there are: cones and cylinders lie between two of their balls."""
    if not duct.columns:
        return 1
    count = len(getattr(duct, next(iter(duct.columns.values()))[0]))
    return max(1, count - 1) if duct.joined else count


def load_shapes(path: str | os.PathLike[str]) -> Duct:
    """Read shapes from a file that `save_shapes` wrote, or one like it.

    Raises
    ------
    FileFormatError
        As `load_shapes_file` does.
    """
    return load_shapes_file(path).shapes


def load_shapes_file(path: str | os.PathLike[str]) -> ShapesFile:
    """Read shapes from a file, and what it states about them.

    Raises
    ------
    FileFormatError
        If the file is missing, is not JSON or YAML, is of a later version, or holds a shape that
        is none: the message names its number and the value.
    """
    source = Path(path)
    if source.suffix.lower() not in SUFFIXES:
        raise FileFormatError(
            f"{source} ends in '{source.suffix}': shapes are in {', '.join(SUFFIXES)}"
        )
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"cannot read {source}: {error.strerror or error}") from None
    except ValueError as error:
        raise FileFormatError(f"cannot read {source}: it is not UTF-8 text ({error})") from None
    parse = parse_json if source.suffix.lower() == ".json" else parse_yaml
    try:
        return _read_file(parse(text))
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


def write_shapes(duct: Duct, *, fit: str = "", note: str = "") -> dict[str, Any]:
    """Return shapes as plain data; `fit` and `note` as for `save_shapes`.

    Raises
    ------
    InputError
        If the duct's class has no file form, or `fit` is not one of `FITS`.
    """
    _check_fit(fit)
    kind = str(getattr(duct, "name", ""))
    if kind not in SHAPES or SHAPES[kind] is not type(duct):
        raise InputError(f"a {type(duct).__name__} has no file form: {', '.join(SHAPES)} have")
    data: dict[str, Any] = {"format": FORMAT, "version": VERSION, "kind": kind, "units": "mm"}
    stated = {name for name in OPTIONS if name in _list_fields(type(duct))}
    data |= {key: _to_plain(getattr(duct, key)) for key in OPTIONS if key in stated}
    data |= {name: text for name, text in (("fit", fit), ("note", note)) if text}
    data = {key: value for key, value in data.items() if value is not None}
    if duct.columns:
        rows = {
            key: np.swapaxes(table, 1, 2) if count == 9 else table
            for key, (table, count) in (
                (key, (getattr(duct, name), count)) for key, (name, count) in duct.columns.items()
            )
        }
        data["shapes"] = [
            dict(zip(rows, (values.tolist() for values in row), strict=True))
            for row in zip(*rows.values(), strict=True)
        ]
    else:
        own = {name: _to_plain(getattr(duct, name)) for name in _list_fields(type(duct))}
        data["shapes"] = [
            {key: value for key, value in own.items() if value is not None and key not in stated}
        ]
    return data


def read_shapes(data: Any) -> Duct:
    """Build shapes from plain data, as `write_shapes` gives it.

    Raises
    ------
    InputError, GeometryError
        If a field is missing, unknown or wrong, with its name, the shape's number and the value.
    """
    return _read_file(data).shapes


def _read_file(data: Any) -> ShapesFile:
    given = take_mapping(data, "the file", FIELDS, NEEDED)
    if given["format"] != FORMAT:
        raise InputError(f"format is {show_value(given['format'])}: it must be '{FORMAT}'")
    version = given["version"]
    if isinstance(version, bool) or not isinstance(version, int) or not 1 <= version <= VERSION:
        raise InputError(f"version is {show_value(version)}: it must lie in [1, {VERSION}]")
    kind = given["kind"]
    if not isinstance(kind, str) or kind not in SHAPES:
        raise InputError(f"kind is {show_value(kind)}: it must be one of {', '.join(SHAPES)}")
    if given.get("units", "mm") != "mm":
        raise InputError(f"units is {show_value(given['units'])}: it must be 'mm'")
    options: dict[str, Any] = {}
    for name in ("wall_error", "inflation"):
        if name in given:
            options[name] = float(take_numbers(given[name], name, 1)[0])
    texts = {name: given[name] for name in ("wall", "fit", "note") if name in given}
    for name, text in texts.items():
        if not isinstance(text, str):
            raise InputError(f"{name} is {show_value(text)}: it must be text")
    if "wall" in texts:
        options["wall"] = texts.pop("wall")
    _check_fit(texts.get("fit", ""))
    items = given["shapes"]
    if not isinstance(items, (list, tuple)) or not items:
        raise InputError(f"shapes is {show_value(items)}: it must be a list of 1 or more")
    return ShapesFile(shapes=_build(SHAPES[kind], items, options), **texts)


def _build(kind: type[Duct], items: Sequence[Any], options: dict[str, Any]) -> Duct:
    """Return the shapes of one kind from the pieces of a file."""
    known = {name: None for name in _list_fields(kind)}
    for name in options:
        if name not in known:
            raise InputError(f"{name} is given: a {kind.__name__} has none")
    try:
        if kind.columns:
            return kind(**_read_columns(kind, items), **options)
        if len(items) != 1:
            raise InputError(f"shapes has {len(items)} items: a {kind.__name__} has 1")
        own = tuple(name for name in known if name not in OPTIONS)
        needed = tuple(item.name for item in fields(kind) if _is_needed(item))  # type: ignore[arg-type]
        return kind(**take_mapping(items[0], "shapes[0]", own, needed), **options)
    except InputError as error:
        raise type(error)(_name_field(kind, str(error))) from None
    except (TypeError, ValueError) as error:  # a class of another package need not check
        raise InputError(f"shapes cannot be made a {kind.__name__}: {error}") from None


def _read_columns(kind: type[Duct], items: Sequence[Any]) -> dict[str, NDArray[np.float64]]:
    rows: dict[str, list[NDArray[np.float64]]] = {key: [] for key in kind.columns}
    for index, item in enumerate(items):
        shape = take_mapping(item, f"shapes[{index}]", tuple(rows), tuple(rows))
        for key, (_, count) in kind.columns.items():
            rows[key].append(take_numbers(shape[key], f"shapes[{index}].{key}", count))
    made = {}
    for key, (name, count) in kind.columns.items():
        table = np.array(rows[key])
        # A row of a file is an axis of the shape, in its own order x, y, z.
        axes = np.swapaxes(table.reshape(-1, 3, 3), 1, 2) if count == 9 else table
        made[name] = table[:, 0] if count == 1 else axes
    return made


def _list_fields(kind: type[Duct]) -> list[str]:
    return [item.name for item in fields(kind) if item.init]  # type: ignore[arg-type]


def _is_needed(item: Field[Any]) -> bool:
    return item.init and item.default is MISSING and item.default_factory is MISSING


def _to_plain(value: Any) -> Any:
    if isinstance(value, (tuple, list)):
        return [_to_plain(item) for item in value]
    if callable(value):
        raise InputError("a curve that is a function has no file form: give its samples")
    return value.tolist() if hasattr(value, "tolist") else value


def _name_field(kind: type[Duct], message: str) -> str:
    """Return a constructor's message with the file's name of what it is about."""
    keys = {name: key for key, (name, _) in kind.columns.items()}
    keys |= {name.replace("_", " "): key for name, key in keys.items()}
    return re.sub(
        rf"^({'|'.join(keys) or '(?!)'})\[(\d+)(?:, (\d+))?\]",
        lambda m: f"shapes[{m[2]}].{keys[m[1]]}" + (f"[{m[3]}]" if m[3] else ""),
        message,
        count=1,
    )


def _check_fit(fit: str) -> None:
    if fit not in ("", *FITS):
        raise InputError(f"fit is {show_value(fit)}: it must be one of {', '.join(FITS)}")
