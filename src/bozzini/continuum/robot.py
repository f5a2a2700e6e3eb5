"""A tendon robot: sections in series, whose distal tendons pass through the proximal ones."""

from __future__ import annotations

import difflib
import math
import os
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer
from ..errors import FileFormatError, InputError, UnitError
from ..io.files import write_text
from ..units import parse_quantity
from ._common import TORSIONS, take_items
from .section import GRAIN, Section, Tendon

# Robots as plain data and as YAML files; one clear line for a field that is wrong.

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


Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ContinuumRobot:
    """A robot of sections in series, base first, straight along +z at rest.

    Parameters
    ----------
    sections : sequence of Section
        At least one, from base to tip.
    name : str
        Name of the robot.

    Raises
    ------
    InputError
        If names are used twice, or a tendon does not end in its section or leaves the body.
    """

    sections: tuple[Section, ...]
    name: str = "robot"

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"robot name is {self.name!r}: it must be a text")
        object.__setattr__(self, "name", str(self.name))
        sections = take_items("a robot's sections", self.sections, "a sequence of Section")
        if not sections:
            raise InputError("a robot needs at least 1 section, got none")
        for section in sections:
            if not isinstance(section, Section):
                raise InputError(f"a robot's sections hold {section!r}: each must be a Section")
        object.__setattr__(self, "sections", sections)
        for what, names in (
            ("tendons", [tendon.name for section in sections for tendon in section.tendons]),
            ("sections", [section.name for section in sections if section.name]),
        ):
            twice = [name for name, count in Counter(names).items() if count > 1]
            if twice:
                raise InputError(f"two {what} are called '{twice[0]}': names must differ")
        for tendon in self.tendons:
            self._check_inside(tendon)

    @cached_property
    def tendons(self) -> tuple[Tendon, ...]:
        """All tendons, those of the first section first, each with the arc length of its end."""
        return tuple(
            self._resolve(tendon, index)
            for index, section in enumerate(self.sections)
            for tendon in section.tendons
        )

    @property
    def tendon_names(self) -> tuple[str, ...]:
        """Names of the tendons, in the order of `tendons`."""
        return tuple(tendon.name for tendon in self.tendons)

    @cached_property
    def tendon_sections(self) -> NDArray[np.int64]:
        """Index of the section where each tendon ends, shape (t,)."""
        return np.repeat(
            np.arange(len(self.sections)), [len(section.tendons) for section in self.sections]
        )

    @cached_property
    def tendon_ends(self) -> Floats:
        """Arc length where each tendon ends [mm], shape (t,)."""
        return np.asarray([_end(tendon) for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def tendon_travel(self) -> Floats:
        """Smallest and largest displacement of each tendon [mm], shape (t, 2); may be infinite."""
        travel = [tendon.travel for tendon in self.tendons]
        return np.asarray(travel, dtype=np.float64).reshape(-1, 2)

    @cached_property
    def rest_lengths(self) -> Floats:
        """Length of each tendon in the straight robot, as a smooth curve [mm], shape (t,)."""
        return np.asarray([_rest_length(tendon) for tendon in self.tendons], dtype=np.float64)

    @cached_property
    def section_ends(self) -> Floats:
        """Arc length where each section ends [mm], shape (m,)."""
        return np.cumsum([section.length for section in self.sections])

    @cached_property
    def section_starts(self) -> Floats:
        """Arc length where each section starts [mm], shape (m,)."""
        return np.concatenate([[0.0], self.section_ends[:-1]])

    @property
    def length(self) -> float:
        """Length of the backbone [mm]."""
        return float(self.section_ends[-1])

    @property
    def radius(self) -> float:
        """Largest radius of the body [mm]."""
        return max(section.radius for section in self.sections)

    @cached_property
    def disc_arc_length(self) -> Floats:
        """Arc length of all discs from the base [mm], shape (d,); none stands at the base."""
        places = []
        for start, end, section in zip(
            self.section_starts, self.section_ends, self.sections, strict=True
        ):
            discs = start + section.disc_places
            discs[-1] = end
            places.append(discs)
        return np.concatenate(places)

    def section_at(self, arc_length: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the section at arc lengths [mm]; an end belongs to its section."""
        places = check_array("arc_length", arc_length)
        index = np.searchsorted(self.section_ends, places - GRAIN, side="left")
        return np.minimum(index, len(self.sections) - 1).astype(np.int64)

    def section_label(self, index: int) -> str:
        """Return how messages call a section: ``section 1`` is the first, by its name if any."""
        name = self.sections[index].name
        return f"section {index + 1}" + (f" '{name}'" if name else "")

    def stations(self, *, between: int = 0) -> Floats:
        """Return arc lengths of base and discs, and of points evenly `between` two discs [mm].

        Raises
        ------
        InputError
            If `between` is not a whole number in [0, 1000].
        """
        parts = check_integer("between", between, low=0, high=1000) + 1
        discs = np.concatenate([[0.0], self.disc_arc_length])
        steps = np.arange(parts) / parts
        inner = discs[:-1, None] + np.diff(discs)[:, None] * steps
        return np.append(inner.ravel(), discs[-1])

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> ContinuumRobot:
        """Build a robot from plain data, as a YAML file holds it (see `from_yaml`).

        Raises
        ------
        InputError
            One line that names the field, its value and what is legal.
        """
        return read_robot(fields)

    def to_dict(self) -> dict[str, Any]:
        """Return the robot as plain data that `from_dict` reads."""
        return write_robot(self)

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> ContinuumRobot:
        """Read a robot from a YAML file; quantities may carry units, ``20 mm`` or ``36 deg``.

        Raises
        ------
        FileFormatError
            One line that names the file, the field, its value and what is legal.
        """
        return load_robot(Path(path))

    def to_yaml(self, path: str | os.PathLike[str]) -> Path:
        """Write the robot as a YAML file, whole or not at all, and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        return save_robot(self, Path(path))

    def _resolve(self, tendon: Tendon, index: int) -> Tendon:
        start, end = float(self.section_starts[index]), float(self.section_ends[index])
        if tendon.end is None:
            return tendon.ending_at(end)
        if not start + GRAIN < tendon.end <= end + GRAIN:
            raise InputError(
                f"tendon '{tendon.name}' end is {tendon.end:g} mm: it belongs to "
                f"{self.section_label(index)} and must lie in ({start:g}, {end:g}] mm"
            )
        return tendon.ending_at(min(tendon.end, end))

    def _check_inside(self, tendon: Tendon) -> None:
        for index, section in enumerate(self.sections):
            start = float(self.section_starts[index])
            end = min(float(self.section_ends[index]), _end(tendon))
            if start >= end:
                break
            corners = tendon.corners()
            # Between corners the offset is monotone.
            places = np.concatenate([[start, end], corners[(corners > start) & (corners < end)]])
            most = float(tendon.offset_at(places).max())
            if most > section.radius * (1.0 + 1e-12):
                raise InputError(
                    f"tendon '{tendon.name}' offset is {most:g} mm in "
                    f"{self.section_label(index)}: it must lie in (0, {section.radius:g}] mm, "
                    "inside the body's radius"
                )


def check_robot(robot: Any) -> None:
    """Raise `InputError` unless `robot` is one."""
    if not isinstance(robot, ContinuumRobot):
        raise InputError(f"robot is of type {type(robot).__name__}: it must be a ContinuumRobot")


def _end(tendon: Tendon) -> float:
    return np.inf if tendon.end is None else tendon.end


def _rest_length(tendon: Tendon) -> float:
    if tendon.is_parallel:
        return _end(tendon)
    nodes, weights = np.polynomial.legendre.leggauss(32)
    edges = np.concatenate([[0.0], tendon.corners(), [_end(tendon)]])
    half = 0.5 * np.diff(edges)[:, None]
    slopes = tendon.path_slope(edges[:-1, None] + half * (1.0 + nodes))
    return float(np.sum(half * weights * np.sqrt(1.0 + np.sum(slopes**2, axis=-1))))
