"""Shapes as plain data and as files (JSON or YAML): readable, versioned, exact."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError, OutputError
from ..files import write_text
from ._shapes_text import format_json, format_yaml, parse_json, parse_yaml
from .cones import RoundCones
from .cylinders import ConnectedCylinders
from .super_ellipsoid import SuperEllipsoids

__all__ = [
    "SUFFIXES",
    "VERSION",
    "check_shapes_target",
    "count_pieces",
    "load_shapes",
    "read_shapes",
    "save_shapes",
    "write_shapes",
]

VERSION = 1
"""Version of the file format that is written."""

SUFFIXES = (".json", ".yaml", ".yml")

FORMAT = "bozzini shapes"
FIELDS = ("format", "version", "kind", "units", "wall", "wall_error", "inflation", "note", "shapes")
NEEDED = ("format", "version", "kind", "shapes")

Shapes = RoundCones | ConnectedCylinders | SuperEllipsoids

SHAPE_FIELDS: dict[str, dict[str, int]] = {
    "cones": {"centre": 3, "radius": 1},
    "cylinders": {"centre": 3, "normal": 3, "radius": 1},
    "superellipsoids": {"centre": 3, "half_axes": 3, "e1": 1, "e2": 1, "axes": 9},
}
"""What each shape of a file holds, and how many numbers."""


def save_shapes(
    duct: Shapes, path: str | os.PathLike[str], *, note: str = "", force: bool = False
) -> Path:
    """Write shapes to a file; its suffix says whether as JSON or YAML.

    Numbers are written with all their digits: `load_shapes` gives the same shapes exactly.

    Parameters
    ----------
    duct : RoundCones, ConnectedCylinders or SuperEllipsoids
    path : path-like
        Ends in ``.json``, ``.yaml`` or ``.yml``.
    note : str
        What they are, for people.
    force : bool
        Replace a file that exists.

    Raises
    ------
    OutputError
        If the suffix is another, the file exists, or it cannot be written.
    InputError
        If the duct has no such form.
    """
    target = Path(path)
    check_shapes_target(target, force=force)
    data = write_shapes(duct, note=note)
    if target.suffix.lower() == ".json":
        return write_text(target, format_json(data))
    return write_text(target, format_yaml(data))


def check_shapes_target(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Raise `OutputError` at once if `save_shapes` would refuse this path later."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise OutputError(
            f"{target} ends in '{target.suffix}': it must end in {', '.join(SUFFIXES)}"
        )
    if not target.parent.is_dir():
        raise OutputError(f"cannot write {target}: {target.parent} is not a directory")
    if target.is_dir():
        raise OutputError(f"{target} is a directory: choose a file")
    if target.exists() and not force:
        raise OutputError(f"{target} exists already: choose another file or give --force")


def count_pieces(duct: Shapes) -> int:
    """Return how many shapes there are: cones and cylinders lie between two of their balls."""
    count = len(duct.centres)
    return count if isinstance(duct, SuperEllipsoids) else max(1, count - 1)


def load_shapes(path: str | os.PathLike[str]) -> Shapes:
    """Read shapes from a file that `save_shapes` wrote, or one like it.

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
        return read_shapes(parse(text))
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


def write_shapes(duct: Shapes, *, note: str = "") -> dict[str, Any]:
    """Return shapes as plain data.

    Raises
    ------
    InputError
        If the duct is not of a kind that has a file form.
    """
    if isinstance(duct, RoundCones):
        kind, columns = "cones", {"centre": duct.centres, "radius": duct.radii}
    elif isinstance(duct, ConnectedCylinders):
        kind = "cylinders"
        columns = {"centre": duct.centres, "normal": duct.normals, "radius": duct.radii}
    elif isinstance(duct, SuperEllipsoids):
        kind = "superellipsoids"
        columns = {
            "centre": duct.centres,
            "half_axes": duct.half_axes,
            "e1": duct.e1,
            "e2": duct.e2,
            # A row is an axis of the shape, in its own order x, y, z.
            "axes": np.swapaxes(duct.rotations, 1, 2),
        }
    else:
        raise InputError(
            f"a {type(duct).__name__} has no file form: RoundCones, ConnectedCylinders and "
            "SuperEllipsoids have"
        )
    data: dict[str, Any] = {"format": FORMAT, "version": VERSION, "kind": kind}
    data |= {"units": "mm", "wall": duct.wall, "wall_error": float(duct.wall_error)}
    data["inflation"] = float(duct.inflation)
    if note:
        data["note"] = note
    data["shapes"] = [
        {key: values[k].tolist() for key, values in columns.items()}
        for k in range(len(duct.centres))
    ]
    return data


def read_shapes(data: Any) -> Shapes:
    """Build shapes from plain data, as `write_shapes` gives it.

    Raises
    ------
    InputError, GeometryError
        If a field is missing, unknown or wrong, with its name, the shape's number and the value.
    """
    fields = _take_mapping(data, "the file", FIELDS, NEEDED)
    if fields["format"] != FORMAT:
        raise InputError(f"format is {_show(fields['format'])}: it must be '{FORMAT}'")
    version = fields["version"]
    if isinstance(version, bool) or not isinstance(version, int) or not 1 <= version <= VERSION:
        raise InputError(f"version is {_show(version)}: it must lie in [1, {VERSION}]")
    kind = fields["kind"]
    if not isinstance(kind, str) or kind not in SHAPE_FIELDS:
        raise InputError(f"kind is {_show(kind)}: it must be one of {', '.join(SHAPE_FIELDS)}")
    if fields.get("units", "mm") != "mm":
        raise InputError(f"units is {_show(fields['units'])}: it must be 'mm'")
    options: dict[str, Any] = {}
    for name in ("wall_error", "inflation"):
        if name in fields:
            options[name] = float(_take_numbers(fields[name], name, 1)[0])
    if "wall" in fields:
        if not isinstance(fields["wall"], str):
            raise InputError(f"wall is {_show(fields['wall'])}: it must be text")
        options["wall"] = fields["wall"]
    items = fields["shapes"]
    if not isinstance(items, (list, tuple)) or not items:
        raise InputError(f"shapes is {_show(items)}: it must be a list of 1 or more")
    names = SHAPE_FIELDS[kind]
    rows: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    for index, item in enumerate(items):
        field = f"shapes[{index}]"
        shape = _take_mapping(item, field, tuple(names), tuple(names))
        for name, count in names.items():
            values = _take_numbers(shape[name], f"{field}.{name}", count)
            if name == "radius" and values[0] <= 0.0:
                raise InputError(f"{field}.radius is {values[0]:g} mm: it must lie in (0, inf) mm")
            rows[name].append(values)
    table = {name: np.array(values) for name, values in rows.items()}
    return _build(kind, table, options)


def _build(kind: str, table: dict[str, NDArray[np.float64]], options: dict[str, Any]) -> Shapes:
    if kind == "cones":
        return RoundCones(table["centre"], table["radius"][:, 0], **options)
    if kind == "cylinders":
        return ConnectedCylinders(
            table["centre"], table["normal"], table["radius"][:, 0], **options
        )
    return SuperEllipsoids(
        table["centre"],
        table["half_axes"],
        e1=table["e1"][:, 0],
        e2=table["e2"][:, 0],
        rotations=np.swapaxes(table["axes"].reshape(-1, 3, 3), 1, 2),
        **options,
    )


def _take_mapping(
    value: Any, field: str, known: tuple[str, ...], needed: tuple[str, ...]
) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{field} is {_show(value)}: it must hold the fields {', '.join(known)}")
    for key in value:
        if key not in known:
            raise InputError(f"{field} has an unknown field '{key}': known are {', '.join(known)}")
    for key in needed:
        if key not in value:
            raise InputError(f"{field} has no '{key}': it needs {', '.join(needed)}")
    return value


def _take_numbers(value: Any, field: str, count: int) -> NDArray[np.float64]:
    """Return `count` finite numbers; nine of them may be three rows of three."""
    flat = [value] if count == 1 else value
    if count == 9 and isinstance(value, (list, tuple)):
        flat = [item for row in value for item in (row if isinstance(row, (list, tuple)) else [])]
    legal = isinstance(flat, (list, tuple)) and len(flat) == count
    if not legal or not all(_is_number(item) for item in flat):
        form = {1: "a number", 3: "3 numbers", 9: "3 rows of 3 numbers"}[count]
        raise InputError(f"{field} is {_show(value)}: it must be {form}, all finite")
    return np.array(flat, dtype=np.float64)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _show(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
