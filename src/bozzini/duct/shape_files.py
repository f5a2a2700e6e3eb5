"""Shapes as plain data and as files (JSON or YAML): readable, versioned, exact."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import MISSING, Field, dataclass, fields, make_dataclass
from functools import cache
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, cast

import numpy as np

from ..checks import Quantity, check_path, check_word, list_quantities, quantity
from ..errors import FileFormatError, InputError
from ..io.files import check_new_file, write_text
from ..io.records import format_yaml, load_data, read_record
from ..io.schema import describe_type, make_schema
from ..results import Json
from ..units import INTERNAL_UNITS, parse_quantity
from .base import Duct, Form
from .shapes import DUCT_SHAPES

VERSION = 1
"""Version of the file format that is written."""

SUFFIXES = (".json", ".yaml", ".yml")

FITS = ("inscribed", "least squares")
"""How shapes were fitted to a tract: inside its wall but for `wall_error`, or through it too."""

FORMAT = "bozzini shapes"
OPTIONS = ("wall", "wall_error", "inflation")


@dataclass(frozen=True)
class _Record:
    """What any file of shapes holds."""

    format: Literal["bozzini shapes"]
    kind: str
    shapes: tuple[Any, ...]
    version: int = quantity(whole=True, low=1, high=VERSION)
    units: Literal["mm"] = "mm"
    wall: str = ""
    wall_error: float = quantity("length", low=0.0, default=0.0)
    inflation: float = quantity("length", low=0.0, default=0.0)
    fit: str = ""
    note: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapesFile:
    """What a file of shapes holds.

    Parameters
    ----------
    shapes : Duct
        Of a class in `DUCT_SHAPES`.
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
        Of a class in `DUCT_SHAPES`.
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
    target = check_path("path", path)
    check_shapes_target(target, force=force)
    data = write_shapes(duct, fit=fit, note=note)
    if target.suffix.lower() == ".json":
        return write_text(target, _format_json(data))
    return write_text(target, format_yaml(data))


def check_shapes_target(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Raise `OutputError` at once if `save_shapes` would refuse this path later."""
    check_new_file(path, SUFFIXES, force=force)


def load_shapes(path: str | os.PathLike[str]) -> Duct:
    """Read shapes from a file that `save_shapes` wrote, or one like it.

    Raises
    ------
    InputError, FileFormatError
        As `load_shapes_file` does.
    """
    return load_shapes_file(path).shapes


def load_shapes_file(path: str | os.PathLike[str]) -> ShapesFile:
    """Read shapes from a file, and what it states about them.

    Raises
    ------
    InputError
        If `path` is no path.
    FileFormatError
        If the file is missing, is not JSON or YAML, is of a later version, or holds a shape that
        is none: the message names its number and the value.
    """
    source = check_path("path", path)
    if source.suffix.lower() not in SUFFIXES:
        raise FileFormatError(
            f"{source} ends in '{source.suffix}': shapes are in {', '.join(SUFFIXES)}"
        )
    data = load_data(source)
    try:
        return _read_file(data)
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


def write_shapes(duct: Duct, *, fit: str = "", note: str = "") -> Json:
    """Return shapes as plain data; `fit` and `note` as for `save_shapes`.

    Raises
    ------
    InputError
        If the duct's class has no file form, or `fit` is not one of `FITS`.
    """
    _check_fit(fit)
    kind = str(getattr(duct, "name", ""))
    if kind not in DUCT_SHAPES or DUCT_SHAPES[kind] is not type(duct):
        raise InputError(f"a {type(duct).__name__} has no file form: {', '.join(DUCT_SHAPES)} have")
    data: Json = {"format": FORMAT, "version": VERSION, "kind": kind, "units": "mm"}
    stated = {name for name in OPTIONS if name in _list_fields(type(duct))}
    data |= {key: _to_plain(getattr(duct, key)) for key in OPTIONS if key in stated}
    data |= {name: text for name, text in (("fit", fit), ("note", note)) if text}
    data = {key: value for key, value in data.items() if value is not None}
    if duct.columns:
        rows = {key: getattr(duct, name) for key, (name, _) in duct.columns.items()}
        if "axes" in rows:  # a row is an axis of the shape, in its own order x, y, z
            rows["axes"] = np.swapaxes(rows["axes"], 1, 2)
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


def read_shapes(data: object) -> Duct:
    """Build shapes from plain data, as `write_shapes` gives it.

    Raises
    ------
    InputError, GeometryError
        If a field is missing, unknown or wrong, with its name, the shape's number and the value.
    """
    return _read_file(data).shapes


def make_shapes_schema() -> Json:
    """Return the JSON Schema of a file of shapes: what each kind's shapes hold, others' too."""
    kinds = [name for name in DUCT_SHAPES if name not in DUCT_SHAPES.broken]
    chosen = [
        {
            "if": {"properties": {"kind": {"const": name}}},
            "then": {"properties": describe_type(_make_pieces(DUCT_SHAPES[name]))["properties"]},
        }
        for name in kinds
    ]
    schema = make_schema(_Record, "Bozzini shapes")
    schema["properties"]["kind"] = {"enum": kinds}
    schema["properties"]["fit"] = {"enum": ["", *FITS]}
    schema["properties"]["shapes"]["minItems"] = 1
    return {**schema, "allOf": chosen}


def _read_file(data: object) -> ShapesFile:
    record = read_record(data, _Record, name="the file")
    check_word("kind", record.kind, DUCT_SHAPES)
    _check_fit(record.fit)
    if not record.shapes:
        raise InputError("shapes is []: it must be a list of 1 or more")
    given = cast(Json, data)
    options = {name: getattr(record, name) for name in OPTIONS if name in given}
    shapes = _build(DUCT_SHAPES[record.kind], given["shapes"], options)
    return ShapesFile(shapes=shapes, fit=record.fit, note=record.note)


def _build(kind: type[Duct], items: Sequence[Json], options: Json) -> Duct:
    """Return the shapes of one kind from the pieces of a file."""
    for name in options:
        if name not in _list_fields(kind):
            raise InputError(f"{name} is given: a {kind.__name__} has none")
    pieces = read_record({"shapes": items}, _make_pieces(kind)).shapes
    given: Json = {}
    if not kind.columns:
        if len(items) != 1:
            raise InputError(f"shapes has {len(items)} items: a {kind.__name__} has 1")
        given = {
            key: _read_units(value, _find_kind(kind, key), f"shapes[0].{key}")
            for key, value in vars(pieces[0]).items()
            if key in items[0]
        }
    for key, (name, form) in kind.columns.items():
        table = np.array([getattr(piece, key) for piece in pieces])
        given[name] = np.swapaxes(table, 1, 2) if form == "axes" else table
    try:
        return kind(**given, **options)
    except InputError as error:
        raise type(error)(_name_field(kind, str(error))) from None
    except (TypeError, ValueError) as error:  # another package's need not check
        raise InputError(f"shapes cannot be made a {kind.__name__}: {error}") from None


@cache
def _make_pieces(kind: type[Duct]) -> Any:
    """Return the record of a file's pieces: by the columns of a class, or its fields."""
    dim = getattr(kind, "dim", 3)
    size = dim if isinstance(dim, int) else 3
    columns: list[Any] = [(key, _find_type(form, size)) for key, (_, form) in kind.columns.items()]
    if not columns:
        own = [item for item in fields(kind) if item.init and item.name not in OPTIONS]  # type: ignore[arg-type]
        columns = [(i.name, Any) if _is_needed(i) else (i.name, Any, None) for i in own]
    piece = make_dataclass("Piece", columns, kw_only=True)
    return make_dataclass("Pieces", [("shapes", tuple[piece, ...])])  # type: ignore[valid-type]


def _find_kind(kind: type[Duct], name: str) -> str | tuple[str, ...]:
    """Return of which kind a field's numbers are, empty where text has no unit."""
    known = list_quantities(kind).get(name)
    return kind.unit_kinds.get(name, "") if known is None else known.kind


def _read_units(value: object, kind: str | tuple[str, ...], where: str) -> object:
    """Return numbers, nested as they are, with text such as "10 mm" as the number it stands for."""
    if isinstance(value, (list, tuple)):
        row = isinstance(kind, tuple) and len(value) == len(kind) and _is_flat(value)
        return [
            _read_units(item, kind[k] if row else kind, f"{where}[{k}]")
            for k, item in enumerate(value)
        ]
    if not isinstance(value, str) or kind not in INTERNAL_UNITS:
        return value
    try:
        return parse_quantity(value, str(kind))
    except InputError as error:
        raise type(error)(f"{where}: {error}") from None


def _is_flat(values: Sequence[object]) -> bool:
    return not any(isinstance(item, (list, tuple)) for item in values)


def _find_type(form: Form, dim: int) -> Any:
    """Return the type of a piece's field."""
    if form == "axes":
        return GenericAlias(tuple, (_find_type("numbers", dim),) * dim)
    if form in ("lengths", "numbers"):
        return GenericAlias(
            tuple, (_find_type("length" if form == "lengths" else "number", dim),) * dim
        )
    return Annotated[float, Quantity(kind="dimensionless" if form == "number" else form)]


def _list_fields(kind: type[Duct]) -> list[str]:
    return [item.name for item in fields(kind) if item.init]  # type: ignore[arg-type]


def _is_needed(item: Field[object]) -> bool:
    return item.init and item.default is MISSING and item.default_factory is MISSING


def _to_plain(value: object) -> object:
    if isinstance(value, (tuple, list)):
        return [_to_plain(item) for item in value]
    if callable(value):
        raise InputError("a curve that is a function has no file form: give its samples")
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


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
    if fit:
        check_word("fit", fit, FITS)


def _format_json(data: Json) -> str:
    """Return JSON with one shape a line."""
    head = json.dumps({key: value for key, value in data.items() if key != "shapes"}, indent=2)
    rows = ",\n".join(f"    {json.dumps(shape)}" for shape in data["shapes"])
    return f'{head[:-2]},\n  "shapes": [\n{rows}\n  ]\n}}\n'
