"""What the 3-D page shows, as plain arrays, and the one container in which it travels.

The page is the same for a report, for ``bozzini show`` and for a session: its scripts are in
``scene/web``. A `View` holds what there is to see, in mm; `encode_view` makes bytes of it that
``scene_data.js`` reads.

Container, little-endian: ``u32`` magic, ``u32`` length of the header, the header (JSON, padded with
blanks to 4 bytes), then the arrays, each at a multiple of 4 bytes. Where a header has
``{"at", "shape", "step", "low", "bytes", "order"}`` the array is of whole numbers: the values over
their step, less the lowest along the last axis; then `order` differences along the first axis;
then signs folded in (0, -1, 1, -2 become 0, 1, 2, 3); then byte by byte, all lowest bytes first. So
a motion that hardly changes from step to step is mostly zeros, which gzip takes away.
"""

from __future__ import annotations

import json
import math
import re
import struct
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..anatomy.frame import check_frame, find_axis
from ..checks import check_number, check_points, check_word
from ..errors import InputError
from ..numeric.arrays import Floats
from ..plot.style import ClearanceScale, list_clearance_colors
from ..results import Json, Shown

MarkKind = Literal["start", "goal", "tight", "refused", "place"]
Role = Literal["scope", "line"]

MAGIC = 0x31565A42
"""The letters BZV1."""

JOINT_STEP = 0.02
"""To what joints are kept [mm]."""

VERTEX_STEP = 0.01
"""To what the vertices of surfaces are kept [mm]."""

CLEARANCE_STEP = 0.01
"""To what clearances are kept [mm]."""

_OUTSIDE = -32768  # a clearance that there is not
_KINDS = ("start", "goal", "tight", "refused", "place")


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Triangles: a wall, a tube, a holder.

    Parameters
    ----------
    vertices : (n, 3) float
        World [mm].
    faces : (m, 3) int
        Corners of each triangle.
    name : str
    color : str
        As ``#rrggbb``.
    opacity : float
        0 to 1; 1 hides what is behind.
    """

    vertices: Floats
    faces: NDArray[np.int64]
    name: str = "wall"
    color: str = "#d9958a"
    opacity: float = 0.3

    def __post_init__(self) -> None:
        check_points(f"vertices of {self.name}", self.vertices)
        _check_color(self.color)
        check_number("opacity", self.opacity, low=0.0, high=1.0)
        if self.faces.ndim != 2 or self.faces.shape[1] != 3 or self.faces.dtype.kind not in "iu":
            raise InputError(
                f"faces of {self.name} has shape {self.faces.shape} and type {self.faces.dtype}: "
                "it must be (m, 3) whole numbers"
            )
        last = len(self.vertices) - 1
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() <= last:
            raise InputError(f"faces of {self.name} must have indices in [0, {last}]")


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """A chain of capsules, at each step of a motion: a scope, a backbone, a centreline.

    Parameters
    ----------
    joints : (steps, links + 1, 3) float
        World [mm]; joint 0 is the head. One step where poses arrive later, frame by frame.
    radius : float
        Of the capsules [mm].
    clearance : (steps, links) float, optional
        [mm], NaN for a link that is not in the tract: grey. Without it the body has one colour.
    insertion : (k,) float, optional
        How far the head is in at each step [mm]: k is `steps`, or any where `joints` has one.
    name : str
    color : str
        Where there is no clearance.
    role : {"scope", "line"}
        The first scope moves, carries the camera of the tip and is what the slider is about; the
        first line is the way along which lengths are measured.
    """

    joints: Floats
    radius: float
    clearance: Floats | None = None
    insertion: Floats | None = None
    name: str = "scope"
    color: str = "#4f7cac"
    role: Role = "scope"

    def __post_init__(self) -> None:
        shape = self.joints.shape
        if len(shape) != 3 or shape[0] < 1 or shape[1] < 2 or shape[2] != 3:
            raise InputError(
                f"joints of {self.name} has shape {shape}: it must be (steps, links + 1, 3) with "
                "at least 1 step and 1 link"
            )
        check_points(f"joints of {self.name}", self.joints)
        check_number(f"radius of {self.name}", self.radius, low=0.0, low_open=True, unit="mm")
        check_word("role", self.role, ("scope", "line"))
        _check_color(self.color)
        right = (shape[0], shape[1] - 1)
        if self.clearance is not None and self.clearance.shape != right:
            raise InputError(
                f"clearance of {self.name} has shape {self.clearance.shape}: it must be {right}"
            )
        if self.insertion is not None and shape[0] > 1 and self.insertion.shape != shape[:1]:
            raise InputError(
                f"insertion of {self.name} has shape {self.insertion.shape}: it must be "
                f"({shape[0]},)"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """Points: tips of a workspace.

    Parameters
    ----------
    points : (n, 3) float
        World [mm].
    color : str
    name : str
    """

    points: Floats
    color: str = "#d99a2b"
    name: str = "points"

    def __post_init__(self) -> None:
        check_points(f"points of {self.name}", self.points)
        _check_color(self.color)


@dataclass(frozen=True, kw_only=True, eq=False)
class Mark:
    """A place with a label.

    Parameters
    ----------
    place : (3,) float
        World [mm].
    text : str
    kind : {"start", "goal", "tight", "refused", "place"}
    step : int, optional
        When it is of interest: the page goes to this step with it.
    """

    place: Floats
    text: str
    kind: MarkKind = "place"
    step: int | None = None

    def __post_init__(self) -> None:
        check_points("place of a mark", self.place)
        check_word("kind of a mark", self.kind, _KINDS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart:
    """A value at each step.

    Parameters
    ----------
    name, unit : str
    values : (steps,) float
        NaN where there is none.
    kind : {"clearance", "angle"}
        A clearance is drawn in the colours of its scale.
    """

    name: str
    unit: str
    values: Floats
    kind: Literal["clearance", "angle"] = "clearance"

    def __post_init__(self) -> None:
        check_word("kind of a chart", self.kind, ("clearance", "angle"))


@dataclass(frozen=True, kw_only=True, eq=False)
class View(Shown):
    """What a page shows.

    Parameters
    ----------
    title : str
    surfaces, bodies, points, marks, charts : tuple
    axes : str, optional
        Where the world's axes point in the patient, such as "RAS"; without it they are x, y, z.
    scale : ClearanceScale, optional
        Colours of clearance.
    notes : tuple of str
        What is not exactly as computed, and what is left out, in sentences.
    """

    title: str
    surfaces: tuple[Surface, ...] = ()
    bodies: tuple[Body, ...] = ()
    points: tuple[Cloud, ...] = ()
    marks: tuple[Mark, ...] = ()
    charts: tuple[Chart, ...] = ()
    axes: str | None = None
    scale: ClearanceScale | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.axes is not None:
            check_frame(self.axes)
        if not (self.surfaces or self.bodies or self.points):
            raise InputError("the view is empty: it must have a surface, a body or points")


def encode_view(view: View) -> bytes:
    """Return a view as one container; the same view gives the same bytes."""
    pack = _Packer()
    scale = view.scale or ClearanceScale(low=-1.0, high=4.0)
    header: Json = {
        "title": view.title,
        "axes": _name_axes(view.axes),
        "patient": view.axes is not None,
        "scale": {
            "low": scale.low,
            "high": scale.high,
            # 0.05 mm a colour: the break at 0 then lies between two of them.
            "colors": list_clearance_colors(scale, round(20.0 * (scale.high - scale.low))),
        },
        "notes": list(view.notes),
        "surfaces": [
            {
                "name": item.name,
                "color": item.color,
                "opacity": item.opacity,
                "vertices": pack.add(item.vertices, VERTEX_STEP, order=1),
                "faces": pack.add(item.faces, 1.0, order=1),
            }
            for item in view.surfaces
        ],
        "bodies": [
            {
                "name": item.name,
                "color": item.color,
                "role": item.role,
                "radius": item.radius,
                "joints": pack.add(item.joints, JOINT_STEP, order=2),
                "clearance": pack.add_clearance(item.clearance),
                "insertion": _list_numbers(item.insertion),
            }
            for item in view.bodies
        ],
        "clouds": [
            {
                "name": item.name,
                "color": item.color,
                "points": pack.add(item.points, VERTEX_STEP, order=0),
            }
            for item in view.points
        ],
        "marks": [
            {
                "place": _list_numbers(item.place),
                "text": item.text,
                "kind": item.kind,
                "step": item.step,
            }
            for item in view.marks
        ],
        "charts": [
            {
                "name": item.name,
                "unit": item.unit,
                "kind": item.kind,
                "values": _list_numbers(item.values),
            }
            for item in view.charts
        ],
    }
    text = json.dumps(header, allow_nan=False, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    return b"".join([struct.pack("<II", MAGIC, len(text)), text, *pack.chunks])


class _Packer:
    """Arrays one after the other, each with the words in the header that describe it."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self._length = 0

    def add(self, values: NDArray[np.generic], step: float, *, order: int) -> Json:
        """Store numbers (n, ..., 3), or faces (m, 3), as whole steps above their lowest."""
        flat = np.asarray(values, dtype=np.float64)
        low = flat.reshape(-1, flat.shape[-1]).min(axis=0) if flat.size else np.zeros(3)
        span = float((flat - low).max(initial=0.0))
        if span > 0:  # coarser only if 30 bits were not enough
            step = max(step, step * 2.0 ** math.ceil(math.log2(span / step / 2**29)))
        return self._put(np.rint((flat - low) / step), order, step=step, low=low.tolist())

    def add_clearance(self, values: Floats | None) -> Json | None:
        """Store clearances (steps, links) [mm], NaN as one number that no clearance has."""
        if values is None:
            return None
        whole = np.clip(np.rint(values / CLEARANCE_STEP), _OUTSIDE + 1, -_OUTSIDE)
        whole = np.where(np.isnan(whole), _OUTSIDE, whole)
        return self._put(whole, 1, step=CLEARANCE_STEP, none=_OUTSIDE)

    def _put(self, values: Floats, order: int, **more: object) -> Json:
        whole = values.astype(np.int64)
        for _ in range(order):
            whole[1:] -= whole[:-1].copy()
        folded = np.where(whole < 0, -2 * whole - 1, 2 * whole).astype("<u4").ravel()
        top = int(folded.max(initial=0))
        count = max(1, (top.bit_length() + 7) // 8)
        planes = folded.view(np.uint8).reshape(-1, 4)[:, :count].T.tobytes()
        at = self._length
        planes += bytes(-len(planes) % 4)
        self.chunks.append(planes)
        self._length += len(planes)
        return {"at": at, "shape": list(values.shape), "bytes": count, "order": order, **more}


def _list_numbers(values: Floats | None) -> list[float | None] | None:
    """Return numbers for JSON to six digits after the comma, None where there is none."""
    if values is None:
        return None
    return [round(float(value), 6) if math.isfinite(value) else None for value in values]


def _name_axes(frame: str | None) -> list[Json]:
    """Return the six directions of the world with their letters, the two of an axis together."""
    if frame is None:
        units = np.eye(3)
        return [
            {"letter": sign + "xyz"[k], "way": (units[k] * (1 if sign == "+" else -1)).tolist()}
            for k in range(3)
            for sign in ("+", "-")
        ]
    return [{"letter": side, "way": find_axis(frame, side).tolist()} for side in "RLAPSI"]


def _check_color(color: str) -> None:
    if re.fullmatch(r"#[0-9a-f]{6}", color) is None:
        raise InputError(f"color is '{color}': it must be #rrggbb in small letters")
