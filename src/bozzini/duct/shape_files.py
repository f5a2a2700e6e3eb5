"""Shapes as plain data and as files (JSON or YAML): readable, versioned, exact."""

from __future__ import annotations

import json
import math
import os
import re
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError
from ..io.files import check_new_file, write_text
from .shapes.cones import RoundCones
from .shapes.cylinders import ConnectedCylinders
from .shapes.super_ellipses import SuperEllipsoids

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
TEXTS = ("wall", "fit", "note")
FIELDS = (
    *("format", "version", "kind", "units", "wall", "wall_error", "inflation", "fit", "note"),
    "shapes",
)
NEEDED = ("format", "version", "kind", "shapes")

Shapes = RoundCones | ConnectedCylinders | SuperEllipsoids

SHAPE_FIELDS: dict[str, dict[str, int]] = {
    "cones": {"centre": 3, "radius": 1},
    "cylinders": {"centre": 3, "normal": 3, "radius": 1},
    "superellipsoids": {"centre": 3, "half_axes": 3, "e1": 1, "e2": 1, "axes": 9},
}
"""What each shape of a file holds, and how many numbers."""

_ARGUMENTS = {
    "centres": "centre",
    "normals": "normal",
    "radii": "radius",
    "half axes": "half_axes",
    "half_axes": "half_axes",
    "e1": "e1",
    "e2": "e2",
    "rotations": "axes",
}
"""What a shape's field is called where shapes are built."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapesFile:
    """What a file of shapes holds.

    Parameters
    ----------
    shapes : RoundCones, ConnectedCylinders or SuperEllipsoids
    fit : str
        How they were fitted to a tract, one of `FITS`; empty if they were not, or that is not
        known. What is proved to pass shapes that are inscribed passes the tract, but for their
        `wall_error`; what does not pass them may pass the tract, of which they leave out a part.
    note : str
        What they are, for people.
    """

    shapes: Shapes
    fit: str = ""
    note: str = ""


def save_shapes(
    duct: Shapes,
    path: str | os.PathLike[str],
    *,
    fit: str = "",
    note: str = "",
    force: bool = False,
) -> Path:
    """Write shapes to a file; its suffix says whether as JSON or YAML.

    Numbers are written with all their digits: `load_shapes` gives the same shapes exactly.

    Parameters
    ----------
    duct : RoundCones, ConnectedCylinders or SuperEllipsoids
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


def count_pieces(duct: Shapes) -> int:
    """Return how many shapes there are: cones and cylinders lie between two of their balls."""
    count = len(duct.centres)
    return count if isinstance(duct, SuperEllipsoids) else max(1, count - 1)


def load_shapes(path: str | os.PathLike[str]) -> Shapes:
    """Read shapes from a file that `save_shapes` wrote, or one like it.

    Raises
    ------
    FileFormatError
        As `load_shapes_file` does.
    """
    return load_shapes_file(path).shapes


def load_shapes_file(path: str | os.PathLike[str]) -> ShapesFile:
    """Read shapes from a file, and what it says about them.

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


def write_shapes(duct: Shapes, *, fit: str = "", note: str = "") -> dict[str, Any]:
    """Return shapes as plain data; `fit` and `note` as for `save_shapes`.

    Raises
    ------
    InputError
        If the duct is not of a kind that has a file form, or `fit` is not one of `FITS`.
    """
    _check_fit(fit)
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
    data |= {name: text for name, text in (("fit", fit), ("note", note)) if text}
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
    return _read_file(data).shapes


def _read_file(data: Any) -> ShapesFile:
    fields = take_mapping(data, "the file", FIELDS, NEEDED)
    if fields["format"] != FORMAT:
        raise InputError(f"format is {show_value(fields['format'])}: it must be '{FORMAT}'")
    version = fields["version"]
    if isinstance(version, bool) or not isinstance(version, int) or not 1 <= version <= VERSION:
        raise InputError(f"version is {show_value(version)}: it must lie in [1, {VERSION}]")
    kind = fields["kind"]
    if not isinstance(kind, str) or kind not in SHAPE_FIELDS:
        raise InputError(f"kind is {show_value(kind)}: it must be one of {', '.join(SHAPE_FIELDS)}")
    if fields.get("units", "mm") != "mm":
        raise InputError(f"units is {show_value(fields['units'])}: it must be 'mm'")
    options: dict[str, Any] = {}
    for name in ("wall_error", "inflation"):
        if name in fields:
            options[name] = float(take_numbers(fields[name], name, 1)[0])
    texts = {name: fields[name] for name in TEXTS if name in fields}
    for name, text in texts.items():
        if not isinstance(text, str):
            raise InputError(f"{name} is {show_value(text)}: it must be text")
    if "wall" in texts:
        options["wall"] = texts.pop("wall")
    _check_fit(texts.get("fit", ""))
    items = fields["shapes"]
    if not isinstance(items, (list, tuple)) or not items:
        raise InputError(f"shapes is {show_value(items)}: it must be a list of 1 or more")
    if kind == "cylinders" and len(items) < 2:
        raise InputError("shapes holds 1 circle: cylinders lie between 2 or more")
    names = SHAPE_FIELDS[kind]
    rows: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    for index, item in enumerate(items):
        field = f"shapes[{index}]"
        shape = take_mapping(item, field, tuple(names), tuple(names))
        for name, count in names.items():
            values = take_numbers(shape[name], f"{field}.{name}", count)
            if name == "radius" and values[0] <= 0.0:
                raise InputError(f"{field}.radius is {values[0]:g} mm: it must lie in (0, inf) mm")
            rows[name].append(values)
    table = {name: np.array(values) for name, values in rows.items()}
    try:
        return ShapesFile(shapes=_build(kind, table, options), **texts)
    except InputError as error:
        raise type(error)(_name_field(str(error))) from None


def _name_field(message: str) -> str:
    """Return a constructor's message with the file's name of what it is about."""
    names = "|".join(_ARGUMENTS)
    return re.sub(
        rf"^({names})\[(\d+)(?:, (\d+))?\]",
        lambda m: f"shapes[{m[2]}].{_ARGUMENTS[m[1]]}" + (f"[{m[3]}]" if m[3] else ""),
        message,
        count=1,
    )


def _check_fit(fit: str) -> None:
    if fit not in ("", *FITS):
        raise InputError(f"fit is {show_value(fit)}: it must be one of {', '.join(FITS)}")


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
