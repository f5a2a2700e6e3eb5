"""Robots as plain data and as YAML files; one clear line for a field that is wrong."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import FileFormatError, InputError, UnitError
from ..files import write_text
from ..units import parse_quantity
from ._checks import TORSIONS
from .section import Section
from .tendon import Tendon

if TYPE_CHECKING:
    from .robot import ContinuumRobot

__all__ = ["load_robot", "read_robot", "save_robot", "write_robot"]

ROBOT_FIELDS = ("name", "sections")
SECTION_FIELDS = (
    "name",
    "length",
    "radius",
    "discs",
    "disc_positions",
    "bending_stiffness",
    "torsional_stiffness",
    "max_bend",
    "tendons",
)
TENDON_FIELDS = ("name", "offset", "angle", "end", "pushes", "travel", "interpolation")
HELIX_FIELDS = ("start", "turns")

_Built = TypeVar("_Built", Section, Tendon)


def load_robot(path: Path) -> ContinuumRobot:
    """Read a robot file; see `bozzini.continuum.ContinuumRobot.from_yaml`."""
    import yaml

    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise FileFormatError(f"cannot read {path}: it is not UTF-8 text ({error})") from None
    try:
        fields = _parse(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise FileFormatError(f"{path}{where}: not YAML: {problem}") from None
    try:
        return read_robot(fields)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def _parse(text: str) -> Any:
    """Return the data of a YAML text; a field given twice is refused, not the first one lost."""
    import yaml

    waiting = [yaml.compose(text, Loader=yaml.SafeLoader)]
    seen = set()
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            keys = [key.value for key, _ in node.value]
            for place, (key, value) in enumerate(node.value):
                if key.value in keys[:place]:
                    raise yaml.MarkedYAMLError(
                        problem=f"the field '{key.value}' is given twice",
                        problem_mark=key.start_mark,
                    )
                waiting.append(value)
        elif isinstance(node, yaml.SequenceNode):
            waiting.extend(node.value)
    return yaml.safe_load(text)


def save_robot(robot: ContinuumRobot, path: Path) -> Path:
    """Write a robot file; see `bozzini.continuum.ContinuumRobot.to_yaml`."""
    import yaml

    text = yaml.safe_dump(
        write_robot(robot), sort_keys=False, allow_unicode=True, default_flow_style=None
    )
    note = "# Lengths in mm, angles in rad, stiffnesses in N mm^2.\n"
    return write_text(path, note + text)


def read_robot(fields: Any) -> ContinuumRobot:
    """Build a robot from plain data."""
    from .robot import ContinuumRobot

    data = _take_mapping(fields, "robot", ROBOT_FIELDS, needed=("sections",))
    sections = []
    start = 0.0
    for index, item in enumerate(_take_list(data["sections"], "sections")):
        section = _read_section(item, f"sections[{index}]", start)
        sections.append(section)
        start += section.length
    name = data.get("name", "robot")
    if not isinstance(name, str):
        raise InputError(f"name is {name!r}: it must be a text")
    return ContinuumRobot(tuple(sections), name=name)


def write_robot(robot: ContinuumRobot) -> dict[str, Any]:
    """Return the plain data of a robot; what is as by default is left out."""
    return {"name": robot.name, "sections": [_write_section(item) for item in robot.sections]}


def _read_section(item: Any, field: str, start: float) -> Section:
    data = _take_mapping(item, field, SECTION_FIELDS, needed=("length", "radius"))
    values: dict[str, Any] = {}
    for key, kind in (("length", "length"), ("radius", "length"), ("max_bend", "angle")):
        if key in data:
            values[key] = _quantity(data[key], f"{field}.{key}", kind)
    for key in ("bending_stiffness", "torsional_stiffness"):
        if key in data:
            values[key] = _quantity(data[key], f"{field}.{key}", "rigidity")
    if values.get("torsional_stiffness") == 0.0:
        low, high = TORSIONS
        raise InputError(
            f"{field}.torsional_stiffness is 0 N mm^2: it must lie in [{low:g}, {high:g}] N mm^2; "
            "leave it out for that of a round rod"
        )
    for key in ("name", "discs"):
        if key in data:
            values[key] = data[key]
    if "discs" in data and data["discs"] == 0:
        raise InputError(f"{field}.discs is 0: it must lie in [1, 10000]")
    if "disc_positions" in data:
        name = f"{field}.disc_positions"
        items = _take_list(data["disc_positions"], name)
        values["disc_positions"] = tuple(
            _quantity(place, f"{name}[{index}]", "length") for index, place in enumerate(items)
        )
    section = _build(field, lambda: Section(**values))
    tendons = []
    for index, tendon in enumerate(_take_list(data.get("tendons", []), f"{field}.tendons")):
        tendons.append(_read_tendon(tendon, f"{field}.tendons[{index}]", start + section.length))
    return _build(field, lambda: Section(**values, tendons=tuple(tendons)))


def _read_tendon(item: Any, field: str, section_end: float) -> Tendon:
    data = _take_mapping(item, field, TENDON_FIELDS, needed=("name", "offset"))
    values: dict[str, Any] = {}
    for key in ("name", "pushes", "interpolation"):
        if key in data:
            values[key] = data[key]
    if "end" in data:
        values["end"] = _quantity(data["end"], f"{field}.end", "length")
    values["offset"] = _profile(data["offset"], f"{field}.offset", "length")
    angle = data.get("angle", 0.0)
    if isinstance(angle, Mapping):
        values["angle"] = _helix(angle, f"{field}.angle", values.get("end", section_end))
    else:
        values["angle"] = _profile(angle, f"{field}.angle", "angle")
    if data.get("travel") is not None:
        name = f"{field}.travel"
        pair = _take_list(data["travel"], name)
        if len(pair) != 2:
            raise InputError(
                f"{name} is {pair!r}: it must be [smallest, largest] in mm, null for no limit"
            )
        values["travel"] = tuple(
            open_end if value is None else _quantity(value, name, "length")
            for value, open_end in zip(pair, (-math.inf, math.inf), strict=True)
        )
    return _build(field, lambda: Tendon(**values))


def _profile(value: Any, field: str, kind: str) -> Any:
    """A quantity, or a list of [arc length, quantity]."""
    if not isinstance(value, list):
        return _quantity(value, field, kind)
    knots = []
    for index, knot in enumerate(value):
        name = f"{field}[{index}]"
        if not isinstance(knot, list) or len(knot) != 2:
            raise InputError(f"{name} is {knot!r}: it must be [arc length, {kind}]")
        knots.append((_quantity(knot[0], name, "length"), _quantity(knot[1], name, kind)))
    return tuple(knots)


def _helix(value: Any, field: str, end: float) -> tuple[tuple[float, float], ...]:
    data = _take_mapping(value, field, HELIX_FIELDS, needed=("turns",))
    start = _quantity(data.get("start", 0.0), f"{field}.start", "angle")
    turns = _turns(data["turns"], f"{field}.turns")
    return ((0.0, start), (end, start + 2.0 * math.pi * turns))


def _turns(value: Any, field: str) -> float:
    """A plain number of turns, or an angle with its unit."""
    try:
        return _quantity(value, field, "dimensionless")
    except InputError:
        if not isinstance(value, str):
            raise
    return _quantity(value, field, "angle") / (2.0 * math.pi)


def _quantity(value: Any, field: str, kind: str) -> float:
    if value is None or isinstance(value, (bool, list, Mapping)):
        raise InputError(f"{field} is {value!r}: it must be one {kind}, such as 1 or '1 unit'")
    try:
        return parse_quantity(value, kind)
    except UnitError as error:
        raise InputError(f"{field}: {error}") from None


def _take_mapping(
    value: Any, field: str, known: tuple[str, ...], *, needed: tuple[str, ...]
) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{field} is {_short(value)}: it must hold the fields {', '.join(known)}")
    for key in value:
        if key not in known:
            close = difflib.get_close_matches(str(key), known, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"choose from {', '.join(known)}"
            raise InputError(f"{field} has an unknown field '{key}': {hint}")
    for key in needed:
        if key not in value:
            raise InputError(f"{field} has no '{key}': it needs {', '.join(needed)}")
    return value


def _take_list(value: Any, field: str) -> list[Any]:
    if not isinstance(value, (list, tuple)):
        raise InputError(f"{field} is {_short(value)}: it must be a list")
    return list(value)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _build(field: str, make: Callable[[], _Built]) -> _Built:
    try:
        return make()
    except InputError as error:
        raise InputError(f"{field}: {error}") from None


def _write_section(section: Section) -> dict[str, Any]:
    data: dict[str, Any] = {"name": section.name} if section.name else {}
    data |= {"length": float(section.length), "radius": float(section.radius)}
    if section.disc_positions:
        data["disc_positions"] = [float(place) for place in section.disc_positions]
    else:
        data["discs"] = section.discs
    data["bending_stiffness"] = float(section.bending_stiffness)
    data["torsional_stiffness"] = float(section.torsional_stiffness)
    if math.isfinite(section.max_bend):
        data["max_bend"] = float(section.max_bend)
    data["tendons"] = [_write_tendon(tendon) for tendon in section.tendons]
    return data


def _write_tendon(tendon: Tendon) -> dict[str, Any]:
    data: dict[str, Any] = {"name": tendon.name}
    for key, profile in (("offset", tendon.offset), ("angle", tendon.angle)):
        data[key] = profile if isinstance(profile, float) else [list(knot) for knot in profile]
    if tendon.end is not None:
        data["end"] = tendon.end
    if tendon.pushes:
        data["pushes"] = True
    if tendon.travel != (-math.inf, math.inf):
        data["travel"] = [value if math.isfinite(value) else None for value in tendon.travel]
    if tendon.interpolation != "linear":
        data["interpolation"] = tendon.interpolation
    return data
