"""The plan: what a motion planner returns, what a file holds, and what others can re-check.

A plan file is a NumPy ``.npz``: plain arrays, and one JSON text ``meta`` with every input and
version, so that the clearance can be recomputed by anybody without this package. In memory all of
that is typed; the JSON exists where a plan is saved or read.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import os
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import Quantity, check_number, check_path, name_at, quantity, show_apart
from ..duct.centreline import Centreline
from ..errors import FileFormatError, InputError
from ..io import records, schema
from ..io.files import write_atomically
from ..io.inputs import note_input
from ..numeric.arrays import Floats
from ..results import Json, Result, take_axes, to_plain
from ..units import add_unit
from .certify import Certificate
from .planners import PlannerOptions
from .refusal import Refusal
from .scope import Introducer, Scope

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAN_FORMAT = "bozzini-plan-1"

FILE_SIZE_MAX = 2**31
"""Bytes that a plan file unpacks to, at most."""

COORDINATE_MAX_MM = 1e6
"""Largest length or coordinate in a plan file."""

LENGTH_ROUND_OFF_MM = 1e-4
"""How far a link may be off its length."""

ROUND_OFF_MM = 1e-3
"""How far a file may be off what it claims, by rounding."""

_ARRAYS = ("joints", "head_arc_length", "clearance", "path", "path_arc_length", "path_radius")
_TEXTS = ("method", "status", "reason_code", "reason")

Status = Literal["complete", "stopped"]


_OMITTED = {"omitted": True}
"""A field that is left out of a file where it is None."""


def _length(
    help: str, *, low: float = 0.0, default: float | None = None, omitted: bool = False
) -> Any:  # as `dataclasses.field`
    """Return the field of a length that may be lacking, from 0 mm up; `omitted` if it lacks."""
    known = Quantity(kind="length", help=help, low=low, high=COORDINATE_MAX_MM)
    return field(default=default, metadata={"quantity": known, "omitted": omitted})


@dataclass(frozen=True, kw_only=True)
class FieldSummary:
    """What is known of the distance field that a plan was made in; see `bozzini.duct.Duct`.

    Parameters
    ----------
    kind : str
        ``"exact"``, ``"bound"`` or ``"sampled"``.
    spacing, nodes : tuple, optional
        Of the grid, per axis [mm]; None without a grid.
    inflation : float
        How far the wall was moved outwards [mm].
    interpolation_error, wall_error, sampling_error, clearance_error : float or None
        By how much a distance, the wall, a sampled link and an estimated clearance may be wrong
        [mm]; None where that is not known.
    fine_spacing, fine_distance : float, optional
        Of the finer grid, and how far from the centreline it reaches [mm].
    """

    kind: str = ""
    spacing: tuple[float, ...] | None = field(
        default=None, metadata={**_OMITTED, "key": "spacing_mm"}
    )
    nodes: tuple[int, ...] | None = field(default=None, metadata=_OMITTED)
    inflation: float = _length("Inflation.", default=0.0)
    interpolation_error: float | None = _length("Error of a distance.")
    wall_error: float | None = _length("Error of the wall.")
    sampling_error: float | None = _length("Error of a sampled link.")
    clearance_error: float | None = _length("Error of an estimated clearance.")
    fine_spacing: float | None = _length("Spacing of the finer grid.", omitted=True)
    fine_distance: float | None = _length("Reach of the finer grid.", omitted=True)


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of a motion.

    Parameters
    ----------
    joint_step_max, joint_step_ratio_max : float
        Largest move of a joint in a step [mm], and over the head's.
    joint_angle_max : float
        Largest angle between neighbouring links [rad].
    joint_travel : float
        Sum of all moves of all joints [mm].
    clearance_min, clearance_where, clearance_insertion : float or None
        Smallest estimated clearance, where that is along the centreline, and the head's arc length
        then [mm]; infinite (None in a file) where the scope never leaves the introducer.
    """

    joint_step_max: float | None = _length("Largest move of a joint in a step.")
    joint_step_ratio_max: float | None = quantity(default=None)
    joint_angle_max: float | None = quantity("angle", default=None)
    joint_travel: float | None = _length("Sum of all moves.")
    clearance_min: float | None = _length("Smallest clearance.", low=-math.inf)
    clearance_where: float | None = _length("Where that is.", low=-math.inf)
    clearance_insertion: float | None = _length("The head then.", low=-math.inf)


@dataclass(frozen=True, kw_only=True)
class CandidateMotion:
    """A motion that was compared for a plan, as `bozzini.motion.plan_insertion` does it.

    Parameters
    ----------
    freedom : float
        Share of the free tube that joints may use: 0 follows the leader.
    margin : float
        Clearance beyond the radius that its path was shaped for [mm].
    clearance : float
        Certified [mm].
    joint_step_ratio : float
        Largest step of a joint over the head's.
    """

    freedom: float = quantity(low=0.0, high=1.0)
    margin: float = quantity("length")
    clearance: float = quantity("length", default=math.inf)
    joint_step_ratio: float = quantity(low=0.0, default=0.0)


@dataclass(frozen=True, kw_only=True)
class SoftWall:
    """What a wall that gives way was displaced by; see `bozzini.motion.plan_with_soft_wall`.

    Parameters
    ----------
    allowed, used : float
        Displacement allowed and used [mm].
    contact_max, contact_where : float, optional
        Deepest contact, and where along the centreline [mm].
    contact_step_share : float
        Share of the steps with contact.
    """

    allowed: float = _length("Displacement allowed.", default=0.0)
    used: float = _length("Displacement used.", default=0.0)
    contact_max: float | None = _length("Deepest contact.")
    contact_where: float | None = _length("Where that is.", low=-math.inf)
    contact_step_share: float = quantity(default=0.0, low=0.0, high=1.0)


@dataclass(frozen=True, kw_only=True)
class Replanned:
    """How a plan was made from the one before; see `bozzini.motion.replan`.

    Parameters
    ----------
    warm : bool
        Whether the path that moved with the tissue served.
    margin : float, optional
        Clearance over the scope's radius that it was shaped for [mm].
    sweeps : int
        After how many sweeps of the band; 0: as it was.
    tissue_move : float
        How far the path's points were moved with the tissue, at most [mm].
    reason : str
        Why it did not serve.
    """

    warm: bool
    margin: float | None = _length("Margin.")
    sweeps: int = quantity(whole=True, low=0, high=10**9, default=0)
    tissue_move: float = _length("Move of the tissue.", default=0.0)
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class TractInput:
    """From which file a plan was made, and how that was read: enough to read it again.

    Parameters
    ----------
    source, file, sha256 : str, optional
        What was read, the name of the file and its hash.
    labels, part, unit, frame, repair
        As for `bozzini.anatomy.read_tract`.
    organ : str, optional
    voxel, inflate : float, optional
        As for `bozzini.duct.build_field` [mm].
    more : mapping
        Anything else that JSON takes: how start and end were given, for example.
    """

    source: str | None = field(default=None, metadata=_OMITTED)
    file: str | None = field(default=None, metadata=_OMITTED)
    sha256: str | None = field(default=None, metadata=_OMITTED)
    labels: tuple[int | str, ...] | None = None
    part: int | str | tuple[int | str, ...] | None = None
    unit: str | None = None
    frame: str | None = None
    repair: bool | None = None
    organ: str | None = None
    voxel: float | None = _length("Voxel of the field.")
    inflate: float | None = _length("Inflation.")
    more: Mapping[str, object] = field(default_factory=dict, metadata={"recorded": False})

    @classmethod
    def read(cls, given: Mapping[str, object]) -> TractInput:
        """Read JSON-able values, lengths with their unit in the name: ``voxel_mm``.

        Raises
        ------
        InputError
            If a value has the wrong type or range.
        """
        return read_record(cls, dict(given), "input")

    def describe(self) -> dict[str, object]:
        """Return the JSON-able values that `read` takes."""
        record = write_record(self)
        if self.sha256 is None:  # only the commands state all of a file
            record = {key: value for key, value in record.items() if value is not None}
        return {**record, **self.more}


Kind = TypeVar("Kind")


def _name_key(item: dataclasses.Field[object]) -> str:
    known = item.metadata.get("quantity")
    name = item.name if known is None else add_unit(item.name, known.unit)
    return str(item.metadata.get("key", name))


def write_record(item: object) -> dict[str, object]:
    """Return the fields of a dataclass as JSON takes them, their units in the keys."""
    record = {}
    for each in dataclasses.fields(item):  # type: ignore[arg-type]
        value = getattr(item, each.name)
        if each.metadata.get("recorded", True):
            empty = value is None or (isinstance(value, str) and not value)
            if not (empty and each.metadata.get("omitted", False)):
                record[_name_key(each)] = to_plain(value)
    return record


def read_record(kind: type[Kind], given: object, place: str) -> Kind:
    """Read a dataclass from what `write_record` gives; what is null or lacks takes its default."""
    if not isinstance(given, dict):
        raise InputError(f"{place} is {_show(given)}: it must be an object")
    items = {_name_key(item): item for item in dataclasses.fields(kind)}  # type: ignore[arg-type]
    values: dict[str, object] = {}
    for key, item in items.items():
        value = given.get(key)
        if isinstance(value, str) and "quantity" in item.metadata:
            raise InputError(f"{place}.{key} is {_show(value)}: it must be a number")
        if value is not None and item.metadata.get("recorded", True):
            values[item.name] = value
    try:
        record = records.read_record(values, kind, name=place)
    except InputError as error:
        names = {item.name: f"{place}.{key}" for key, item in items.items()}
        words = re.sub(r"^\w+(?=[ .[])", lambda name: names.get(name[0], name[0]), str(error))
        raise type(error)(words if words.startswith(place) else f"{place}: {words}") from None
    if isinstance(record, TractInput):
        more = {key: value for key, value in given.items() if key not in items}
        return dataclasses.replace(record, more=more)
    return record


_PARTS: Mapping[str, type] = {
    "scope": Scope,
    "introducer": Introducer,
    "certificate": Certificate,
    "field": FieldSummary,
    "measures": Measures,
    "refusal": Refusal,
    "soft_wall": SoftWall,
    "replan": Replanned,
}
"""Parts of ``meta`` that are read and written field by field."""


def make_plan_schema() -> Json:
    """Return the JSON Schema of what a plan file states beside its arrays, the text ``meta``."""
    numbers = {"type": "array", "items": {"type": "number"}}
    words = {"type": "string"}
    return {
        "$schema": schema.DRAFT,
        "title": "Bozzini plan, the text 'meta' of the archive",
        "type": "object",
        "properties": {
            "format": {"const": PLAN_FORMAT},
            **dict.fromkeys(_TEXTS, words),
            "status": {"enum": list(get_args(Status))},
            **{name: _describe_part(kind) for name, kind in _PARTS.items()},
            "input": _describe_part(TractInput),
            "candidates": {"type": "array", "items": _describe_part(CandidateMotion)},
            "findings": {"type": "array", "items": words},
            "wall": words,
            "certified": {"type": "boolean"},
            "head_step_mm": {"type": "number", "exclusiveMinimum": 0},
            "options": {
                "type": "object",
                "properties": {
                    "slip": {"type": "number", "minimum": 0, "maximum": 1},
                    "angle_limit_rad": {"type": ["number", "null"]},
                    "route": numbers,
                    "asked": words,
                    "freedom": {"type": "number", "minimum": 0, "maximum": 1},
                },
            },
            "centreline": {
                "type": "object",
                "properties": {
                    "points_mm": {"type": "array", "items": numbers, "minItems": 2},
                    "arc_length_mm": numbers,
                    "radius_mm": numbers,
                },
                "required": ["points_mm", "arc_length_mm", "radius_mm"],
            },
            "versions": {"type": "object", "additionalProperties": words},
        },
        "required": ["format", *_TEXTS],
    }


def _describe_part(kind: type) -> Json:
    """Return the schema of what `write_record` gives; what is not known is null."""
    described = schema.describe_fields(kind, text=False)
    return {
        "type": "object",
        "properties": {
            _name_key(item): {"anyOf": [described[item.name], {"type": "null"}]}
            for item in dataclasses.fields(kind)
            if item.metadata.get("recorded", True)
        },
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan(Result):
    """A motion of a scope, step by step, and what is known about it.

    Parameters
    ----------
    joints : (steps, joints, 3) float
        Joint positions in the world frame [mm]; joint 0 is the head. Joints that have not
        entered the tract yet stand in the introducer, the straight tube before the entry.
    head_arc_length : (steps,) float
        Arc length of the head along the path at each step [mm].
    clearance : (steps, joints - 1) float
        Estimated distance from the scope's surface to the wall, the smallest over each link
        [mm]; negative is through the wall.
    path : (m, 3) float
        The path that the head follows, world frame [mm].
    path_arc_length, path_radius : (m,) float
        Arc length [mm] and inscribed radius of the lumen [mm] along the path.
    method : str
        The planner that made it.
    status : {"complete", "stopped"}
        Whether the head came to the end of the path.
    reason_code, reason : str
        Why the motion stopped, as a code and as one sentence; "" if it is complete.
    scope : Scope, optional
        This and what follows is None, or empty, where a plan does not state it.
    introducer : Introducer, optional
    options : PlannerOptions, optional
    asked : str
        The planner that was asked for: "best" compares several.
    freedom : float, optional
        Share of the free tube that the best motion uses.
    candidates : tuple of CandidateMotion, optional
        The motions that were compared for it.
    wall : str
        What the wall is.
    certificate : Certificate, optional
        What is proved. A plan that is read from a file claims this: see `verify_plan`.
    field : FieldSummary, optional
    measures : Measures, optional
    refusal : Refusal, optional
        Why the goal is not reached, in numbers.
    soft_wall : SoftWall, optional
    replan : Replanned, optional
    input : TractInput, optional
    centreline : Centreline, optional
        The whole way to the goal.
    findings : tuple of str
        What the checks of the tract found.
    versions : mapping
        Of the software, by name.
    more : mapping
        What else the file holds; JSON-able.

    Raises
    ------
    InputError
        If arrays do not have these shapes, or the status is another word.
    """

    joints: Floats
    head_arc_length: Floats
    clearance: Floats
    path: Floats
    path_arc_length: Floats
    path_radius: Floats
    method: str
    status: Status
    reason_code: str = ""
    reason: str = ""
    scope: Scope | None = None
    introducer: Introducer | None = None
    options: PlannerOptions | None = None
    asked: str = ""
    freedom: float | None = None
    candidates: tuple[CandidateMotion, ...] | None = None
    wall: str = ""
    certificate: Certificate | None = None
    field: FieldSummary | None = None
    measures: Measures | None = None
    refusal: Refusal | None = None
    soft_wall: SoftWall | None = None
    replan: Replanned | None = None
    input: TractInput | None = None
    centreline: Centreline | None = None
    findings: tuple[str, ...] = ()
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    more: Mapping[str, object] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = self.joints.shape
        if len(shape) != 3 or shape[0] < 1 or shape[1] < 2 or shape[2] not in (2, 3):
            raise InputError(
                f"joints has shape {shape}: it must be (steps, joints, dim) with at least "
                "1 step, 2 joints and 2 or 3 dimensions"
            )
        steps, count, dim = shape
        if self.path.ndim != 2 or self.path.shape[0] < 2 or self.path.shape[1] != dim:
            raise InputError(
                f"path has shape {self.path.shape}: it must be (m, {dim}) with m at least 2"
            )
        wanted = {
            "path_arc_length": (len(self.path),),
            "path_radius": (len(self.path),),
            "clearance": (steps, count - 1),
            "head_arc_length": (steps,),
        }
        for name, right in wanted.items():
            if getattr(self, name).shape != right:
                raise InputError(
                    f"{name} has shape {getattr(self, name).shape}: it must be {right}"
                )
        if self.status not in get_args(Status):
            raise InputError(f"status is {self.status!r}: it must be 'complete' or 'stopped'")

    @property
    def steps(self) -> int:
        """Number of recorded steps."""
        return int(self.joints.shape[0])

    @property
    def links(self) -> int:
        """Number of links of the chain."""
        return int(self.joints.shape[1] - 1)

    @property
    def clearance_min(self) -> float:
        """Smallest estimated clearance of the whole body over the motion [mm]."""
        return float(self.clearance.min())

    @property
    def inserted(self) -> float:
        """How far the head got along the path at most [mm]."""
        return float(self.head_arc_length.max())

    @property
    def certified(self) -> bool:
        """Whether the certificate claims a clearance of 0 mm or more."""
        return self.certificate is not None and self.certificate.certified

    @property
    def proved(self) -> float | None:
        """The clearance that is certified [mm]; None if none is."""
        proof = self.certificate
        return proof.clearance if proof is not None and proof.certified else None

    @property
    def inflation(self) -> float:
        """How far the wall was moved outwards, a soft wall's displacement included [mm]."""
        return 0.0 if self.field is None else self.field.inflation

    @property
    def displaced(self) -> float:
        """How much of that is the displacement of a soft wall [mm]."""
        return 0.0 if self.soft_wall is None else self.soft_wall.used

    @property
    def route(self) -> tuple[float, ...]:
        """Fractions of the path that the head was to go to in turn."""
        return PlannerOptions.route if self.options is None else self.options.route

    @property
    def converged(self) -> bool:
        """Whether the head came to the goal."""
        return self.status == "complete"

    @property
    def residual(self) -> float:
        """How near the head came to the goal [mm]; NaN where a stopped plan does not state it."""
        if self.centreline is None:
            return 0.0 if self.converged else math.nan
        gaps = np.linalg.norm(self.joints[:, 0] - self.centreline.points[-1], axis=1)
        return float(gaps.min())

    def get_scope(self) -> Scope:
        """Return the scope; without one `InputError` is raised."""
        if self.scope is None:
            raise InputError("the plan has no scope: scope diameter and link length are not stated")
        return self.scope

    def get_introducer(self) -> Introducer:
        """Return the introducer; without one `InputError` is raised."""
        if self.introducer is None:
            raise InputError("the plan has no introducer")
        return self.introducer

    @property
    def meta(self) -> Json:
        """What the file states beside the arrays, as JSON takes it."""
        record: Json = {**self.more}
        for name, value in (("wall", self.wall), ("findings", list(self.findings))):
            if value:
                record[name] = value
        for name in _PARTS:
            part = getattr(self, name)
            if part is not None:
                record[name] = write_record(part)
        if self.certificate is not None:
            record["certified"] = self.certified
        if self.options is not None:
            record["head_step_mm"] = self.options.head_step
            record["options"] = {
                "slip": self.options.slip,
                "angle_limit_rad": self.options.angle_limit,
                "route": list(self.options.route),
                "asked": self.asked,
                **({} if self.freedom is None else {"freedom": self.freedom}),
            }
        if self.candidates is not None:
            record["candidates"] = [write_record(each) for each in self.candidates]
        if self.input is not None:
            record["input"] = self.input.describe()
        if self.centreline is not None:
            record["centreline"] = {
                "points_mm": self.centreline.points.tolist(),
                "arc_length_mm": self.centreline.arc_length.tolist(),
                "radius_mm": self.centreline.radius.tolist(),
            }
        if self.versions:
            record["versions"] = dict(self.versions)
        return record

    @classmethod
    def from_meta(cls, meta: Mapping[str, object], **known: object) -> Plan:
        """Return a plan of what a file states beside the arrays.

        Parameters
        ----------
        meta : mapping
            As `meta` gives it.
        **known
            Arrays and texts of the plan, and whatever is not in `meta`.

        Raises
        ------
        InputError
            If a value in `meta` has the wrong type or is out of range.
        """
        return cls(**{**_read_meta(meta), **known})  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, object]:
        """Return the plan without its arrays as plain values, which JSON takes."""
        texts = {name: getattr(self, name) for name in _TEXTS}
        counts = {"steps": self.steps, "links": self.links, "inserted_mm": self.inserted}
        result = {"converged": self.converged, "residual": self.residual}
        values: dict[str, object] = to_plain({**texts, **result, **counts, **self.meta})
        return values

    def list_columns(self) -> Mapping[str, Floats]:
        """Return the columns of `to_frame`: a row per step."""
        return {
            "step": np.arange(self.steps),
            "head_arc_length_mm": self.head_arc_length,
            "clearance_mm": self.clearance.min(axis=1),
            "closest_link": np.argmin(self.clearance, axis=1) + 1,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the smallest clearance over the head's way, and return the axes."""
        axes = take_axes(ax, x="head along its path [mm]", y="smallest clearance [mm]")
        least = self.clearance.min(axis=1)
        shown = np.where(np.isfinite(least), least, np.nan)
        axes.plot(self.head_arc_length, shown, label=f"estimated, {self.method}")
        if self.proved is not None:
            axes.axhline(self.proved, color="0.4", linestyle="--", label="certified")
        axes.axhline(0.0, color="0.0", linewidth=0.8)
        axes.legend()
        return axes

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the plan as a compressed ``.npz`` and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        texts = {name: getattr(self, name) for name in _TEXTS}
        meta = {**self.meta, "format": PLAN_FORMAT, **texts}
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        text = np.array(json.dumps(meta, allow_nan=False))

        def write(temporary: Path) -> None:
            with temporary.open("wb") as stream:
                np.savez_compressed(stream, meta=text, **arrays)

        return write_atomically(path, write)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Plan:
        """Read a plan file, and refuse one that contradicts itself.

        What the file claims about the wall is not proved anew: see `bozzini.motion.verify_plan`.

        Raises
        ------
        FileFormatError
            If the file is missing, damaged, or not a plan; if a number is not finite or an array
            has the wrong shape; if ``status``, ``certified`` or the certificate is not what the
            rest of the file allows.
        """
        source = check_path("plan", path)
        note_input(source)
        meta, arrays = _read_archive(source)
        try:
            texts = {name: meta.pop(name, None) for name in _TEXTS}
            for key, text in texts.items():
                if not isinstance(text, str):
                    raise InputError(f"{key} is {_show(text)}: it must be text")
            if not str(texts["method"]).strip():
                raise InputError("method is empty: it must name the planner")
            certified = meta.pop("certified", None)
            plan = cls.from_meta(meta, **arrays, **texts)
            _check_numbers(plan)
            _check_parts(plan)
            _check_status(plan)
            _check_claim(plan, certified)
        except InputError as error:
            raise FileFormatError(f"{source}: {error}") from None
        return plan


def _read_meta(meta: Mapping[str, object]) -> dict[str, object]:
    """Return the fields of a plan that are in the meta of a file."""
    rest = {name: value for name, value in meta.items() if value is not None}
    rest.pop("certified", None)
    values: dict[str, object] = {}
    for name, kind in _PARTS.items():
        if name in rest:
            values[name] = read_record(kind, rest.pop(name), f"meta.{name}")
    if "input" in rest:
        values["input"] = read_record(TractInput, rest.pop("input"), "meta.input")
    if "candidates" in rest:
        values["candidates"] = tuple(
            read_record(CandidateMotion, each, "meta.candidates")
            for each in _pop_list(rest, "candidates")
        )
    if "findings" in rest:
        values["findings"] = tuple(map(str, _pop_list(rest, "findings")))
    if "wall" in rest:
        values["wall"] = str(rest.pop("wall"))
    if isinstance(rest.get("versions"), dict):
        values["versions"] = rest.pop("versions")
    if "centreline" in rest:
        values["centreline"] = _read_line(rest.pop("centreline"))
    options = rest.pop("options", {})
    if not isinstance(options, dict):
        raise InputError(f"meta.options is {_show(options)}: it must be an object")
    step = rest.pop("head_step_mm", None)
    if options or step is not None:
        values["options"] = _read_options(options, step)
        values["asked"] = str(options.get("asked", ""))
        freedom = options.get("freedom")
        if freedom is not None:
            values["freedom"] = check_number("meta.options.freedom", freedom, low=0.0, high=1.0)
    values["more"] = {name: value for name, value in rest.items() if name != "format"}
    return values


def _pop_list(rest: dict[str, object], name: str) -> Iterable[object]:
    given = rest.pop(name)
    if not isinstance(given, list):
        raise InputError(f"meta.{name} is {_show(given)}: it must be a list")
    return given


def _read_options(given: Mapping[str, object], step: object) -> PlannerOptions:
    route = given.get("route", [1.0])
    if not isinstance(route, list) or not route:
        raise InputError(f"meta.options.route is {_show(route)}: it must be a list of fractions")
    known = {"slip": given.get("slip"), "angle_limit": given.get("angle_limit_rad")}
    stated = {name: value for name, value in known.items() if value is not None}
    if step is not None:
        stated["head_step"] = step
    try:
        return PlannerOptions(route=tuple(route), **stated)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"meta.options: {error}") from None


def _read_line(given: object) -> Centreline:
    """Read a centreline that a file states, all in mm."""
    if not isinstance(given, dict):
        raise InputError(f"meta.centreline is {_show(given)}: it must be an object")
    named = (("points", 2), ("arc_length", 1), ("radius", 1))
    arrays = {}
    for name, dim in named:
        where = f"meta.centreline.{name}_mm"
        try:
            array = np.asarray(given.get(f"{name}_mm"), dtype=np.float64)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.ndim != dim or len(array) < 2 or not np.isfinite(array).all():
            raise InputError(
                f"{where} must be an array of at least 2 finite rows, as for points_mm"
            )
        arrays[name] = array
    count = len(arrays["points"])
    if not len(arrays["arc_length"]) == len(arrays["radius"]) == count:
        raise InputError(
            f"meta.centreline.points_mm has {count} rows: the others must have as many"
        )
    return Centreline(**arrays)  # type: ignore[arg-type]


def _read_archive(source: Path) -> tuple[dict[str, object], dict[str, Floats]]:
    """Read the arrays and the meta of an archive, without trusting any size that it states."""
    try:
        with zipfile.ZipFile(source) as archive:
            members = archive.infolist()
            size = sum(item.file_size for item in members)
            if len(members) > 100 or size > FILE_SIZE_MAX:
                raise ValueError(
                    f"{len(members)} arrays of {size / 2**20:,.0f} MiB unpacked: a plan has at "
                    f"most 100 of {FILE_SIZE_MAX / 2**20:,.0f} MiB"
                )
            names = [item.filename for item in members]
            if len(set(names)) != len(names):
                raise ValueError("two arrays have the same name")
            lacking = [name for name in ("meta", *_ARRAYS) if f"{name}.npy" not in names]
            if lacking:
                raise ValueError(f"it has no {', '.join(lacking)}")
            text = _read_array(archive, "meta")
            if text.shape != () or text.dtype.kind != "U":
                raise ValueError(f"meta is {text.dtype} of shape {text.shape}: it must be one text")
            meta = records.parse_json(str(text))
            arrays = {name: _read_array(archive, name) for name in _ARRAYS}
    except FileNotFoundError:
        raise FileFormatError(f"no such file: {source}") from None
    except IsADirectoryError:
        raise FileFormatError(
            f"{source} is a directory: give the plan in it, such as plan.npz"
        ) from None
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        zlib.error,
        RuntimeError,  # encrypted, unknown compression; a meta nested too deep
        OverflowError,
        MemoryError,
    ) as error:
        problem = " ".join(str(error).split())[:160] or type(error).__name__
        raise FileFormatError(f"{source} is not a Bozzini plan: {problem}") from None
    if not isinstance(meta, dict) or meta.get("format") != PLAN_FORMAT:
        raise FileFormatError(f"{source} is not a plan of format {PLAN_FORMAT!r}")
    place = _find_infinite(meta)
    if place is not None:
        raise FileFormatError(f"{source}: meta{place} is not a finite number")
    for name, array in arrays.items():
        if array.dtype.kind not in "fiu":
            raise FileFormatError(
                f"{source}: {name} is {array.dtype}: it must be an array of numbers"
            )
    return meta, {name: array.astype(np.float64) for name, array in arrays.items()}


def _read_array(archive: zipfile.ZipFile, name: str) -> NDArray[np.generic]:
    """Read one array whose header states exactly as much as there is; never a pickle."""
    with archive.open(f"{name}.npy") as stream:
        content = stream.read()
    buffer = io.BytesIO(content)
    version = np.lib.format.read_magic(buffer)
    if version == (1, 0):
        header = np.lib.format.read_array_header_1_0(buffer)
    else:
        header = np.lib.format.read_array_header_2_0(buffer)
    shape, _, dtype = header
    stated = dtype.itemsize * math.prod(shape)
    if dtype.hasobject or min(shape, default=0) < 0 or stated != len(content) - buffer.tell():
        raise ValueError(f"{name} is not {dtype} of shape {shape}")
    buffer.seek(0)
    array: NDArray[np.generic] = np.lib.format.read_array(buffer, allow_pickle=False)
    return array


def _find_infinite(value: object, place: str = "") -> str | None:
    """Return where in a JSON value a number is not finite, or None."""
    if isinstance(value, float):
        return None if math.isfinite(value) else place
    items: Iterable[tuple[str, object]] = ()
    if isinstance(value, dict):
        items = ((f".{key}", item) for key, item in value.items())
    elif isinstance(value, list):
        items = ((f"[{k}]", item) for k, item in enumerate(value))
    found = (_find_infinite(item, place + name) for name, item in items)
    return next((each for each in found if each is not None), None)


def _check_numbers(plan: Plan) -> None:
    """Raise `InputError` for an array with a value that no plan can have."""
    for name in _ARRAYS:
        array = getattr(plan, name)
        # A link that is wholly in the introducer has an infinite clearance.
        bad = np.isnan(array) | (np.isneginf(array) if name == "clearance" else np.isinf(array))
        if bad.any():
            index = int(np.flatnonzero(bad.ravel())[0])
            raise InputError(
                f"{name_at(name, array, index)} is {array.flat[index]:g}: it must be finite"
            )
        top = np.abs(array[np.isfinite(array)]).max(initial=0.0)
        if top > COORDINATE_MAX_MM:
            shown = show_apart(top, COORDINATE_MAX_MM)
            raise InputError(f"{name} reaches {shown[0]} mm: it must lie within {shown[1]} mm")
    if (np.diff(plan.path_arc_length) < 0.0).any() or plan.path_arc_length[0] != 0.0:
        raise InputError("path_arc_length must begin at 0 and never fall")


def _check_parts(plan: Plan) -> None:
    """Raise `InputError` for parts of a description that do not agree."""
    soft, tube, dim = plan.soft_wall, plan.introducer, plan.joints.shape[2]
    if soft is not None and soft.used > min(soft.allowed, plan.inflation) + 1e-9:
        raise InputError(
            f"meta.soft_wall.used_mm is {soft.used:g} mm: it must be at most what is allowed and "
            "part of meta.field.inflation_mm"
        )
    if tube is None:
        return
    for name, point in (("entry_mm", tube.entry), ("outward", tube.outward)):
        if point.shape != (dim,):
            raise InputError(f"meta.introducer.{name} has shape {point.shape}: it must be ({dim},)")
    size = float(np.linalg.norm(tube.outward))
    if abs(size - 1.0) > 1e-6:
        raise InputError(f"meta.introducer.outward has length {size:g}: it must be 1")


def _check_status(plan: Plan) -> None:
    """Raise `InputError` if a plan is called complete whose head never got to the end."""
    if plan.status != "complete":
        return
    if plan.reason_code or plan.reason:
        raise InputError(
            f"status is 'complete', but a reason to stop is given ({_show(plan.reason_code)}): "
            "one of them is wrong"
        )
    goal = max(plan.route) * float(plan.path_arc_length[-1])
    if plan.inserted < goal - ROUND_OFF_MM:
        shown = show_apart(plan.inserted, goal)
        raise InputError(
            f"status is 'complete', but the head gets to {shown[0]} mm of its path: it must "
            f"get to {shown[1]} mm"
        )
    step = int(np.argmax(plan.head_arc_length))
    end = np.array([np.interp(goal, plan.path_arc_length, column) for column in plan.path.T])
    miss = float(np.linalg.norm(plan.joints[step, 0] - end))
    if miss > ROUND_OFF_MM:
        shown = show_apart(miss, ROUND_OFF_MM)
        raise InputError(
            f"status is 'complete', but the head's joint stays {shown[0]} mm from the end of its "
            f"path: it must be within {shown[1]} mm"
        )


def _check_claim(plan: Plan, certified: object) -> None:
    """Raise `InputError` if a plan claims more of its clearance than its own numbers allow."""
    if certified is not None and not isinstance(certified, bool):
        raise InputError(f"meta.certified is {_show(certified)}: it must be true or false")
    proof = plan.certificate
    if certified and not plan.certified:
        bound = math.inf if proof is None else proof.clearance
        what = f"a clearance of {bound:g} mm" if math.isfinite(bound) else "no clearance"
        raise InputError(
            f"meta.certified is true, but the certificate has {what}: it must be at least 0 mm"
        )
    if proof is None or not proof.certified:
        return
    # The certificate is a lower bound, so no estimate may lie below it by more than its error.
    error = plan.field.clearance_error if plan.field is not None else None
    highest = plan.clearance_min + plan.displaced + (error or 0.0)
    if proof.clearance > highest + ROUND_OFF_MM:
        raise InputError(
            f"the certificate's clearance is {proof.clearance:g} mm: the clearances at the steps "
            f"allow at most {highest:g} mm"
        )


def _show(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
