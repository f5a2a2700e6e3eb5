"""The plan: what a motion planner returns, what a file holds, and what others can re-check.

A plan file is a NumPy ``.npz``: plain arrays, and one JSON text ``meta`` with every input and
version, so that the clearance can be recomputed by anybody without this package.
"""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number, check_points, name_at
from ..errors import FileFormatError, InputError
from ..io.files import write_atomically

__all__ = ["PLAN_FORMAT", "Plan", "read_route"]

PLAN_FORMAT = "bozzini-plan-1"

LARGEST = 2**31
"""Bytes that a plan file unpacks to, at most."""

FARTHEST = 1e6
"""Largest length or coordinate in a plan file [mm]."""

SLACK = 1e-3
"""How far a file may be off what it claims, by rounding [mm]."""

_ARRAYS = ("joints", "head_arc_length", "clearance", "path", "path_arc_length", "path_radius")


@dataclass(frozen=True, kw_only=True)
class Plan:
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
        The planner.
    status : {"complete", "stopped"}
        Whether the head came to the end of the path.
    reason_code, reason : str
        Why the motion stopped, as a code and as one sentence; "" if it is complete.
    meta : dict
        JSON-able: scope, introducer, wall, field errors, inputs, versions, measures.
    """

    joints: NDArray[np.float64]
    head_arc_length: NDArray[np.float64]
    clearance: NDArray[np.float64]
    path: NDArray[np.float64]
    path_arc_length: NDArray[np.float64]
    path_radius: NDArray[np.float64]
    method: str
    status: str
    reason_code: str = ""
    reason: str = ""
    meta: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        joints = self.joints
        if (
            joints.ndim != 3
            or joints.shape[0] < 1
            or joints.shape[1] < 2
            or joints.shape[2] not in (2, 3)
        ):
            raise InputError(
                f"joints has shape {joints.shape}: it must be (steps, joints, dim) with at least "
                "1 step, 2 joints and 2 or 3 dimensions"
            )
        steps, count, dim = joints.shape
        if self.path.ndim != 2 or self.path.shape[0] < 2 or self.path.shape[1] != dim:
            raise InputError(
                f"path has shape {self.path.shape}: it must be (m, {dim}) with m at least 2"
            )
        for name in ("path_arc_length", "path_radius"):
            if getattr(self, name).shape != (len(self.path),):
                raise InputError(
                    f"{name} has shape {getattr(self, name).shape}: it must be ({len(self.path)},)"
                )
        if self.clearance.shape != (steps, count - 1):
            raise InputError(
                f"clearance has shape {self.clearance.shape}: it must be ({steps}, {count - 1})"
            )
        if self.head_arc_length.shape != (steps,):
            raise InputError(
                f"head_arc_length has shape {self.head_arc_length.shape}: it must be ({steps},)"
            )
        if self.status not in ("complete", "stopped"):
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

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the plan as a compressed ``.npz`` and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        meta = {
            **self.meta,
            "format": PLAN_FORMAT,
            "method": self.method,
            "status": self.status,
            "reason_code": self.reason_code,
            "reason": self.reason,
        }
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
        source = Path(path)
        meta, arrays = _read_archive(source)
        texts = {}
        for key in ("method", "status", "reason_code", "reason"):
            if not isinstance(meta.get(key), str):
                raise FileFormatError(f"{source}: {key} is {_show(meta.get(key))}: it must be text")
            texts[key] = meta[key]
        if not texts["method"].strip():
            raise FileFormatError(f"{source}: method is empty: it must name the planner")
        try:
            plan = cls(**arrays, **texts, meta=meta)  # type: ignore[arg-type]
            _check_numbers(plan)
            _check_meta(plan)
            _check_status(plan)
            _check_claim(plan)
        except FileFormatError:
            raise
        except InputError as error:
            raise FileFormatError(f"{source}: {error}") from None
        return plan


def _read_archive(source: Path) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
    """Read the arrays and the meta of an archive, without trusting any size that it states."""
    try:
        with zipfile.ZipFile(source) as archive:
            members = archive.infolist()
            size = sum(item.file_size for item in members)
            if len(members) > 100 or size > LARGEST:
                raise ValueError(
                    f"{len(members)} arrays of {size / 2**20:,.0f} MiB unpacked: a plan has at "
                    f"most 100 of {LARGEST / 2**20:,.0f} MiB"
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
            meta = json.loads(str(text))
            arrays = {name: _read_array(archive, name) for name in _ARRAYS}
    except FileNotFoundError:
        raise FileFormatError(f"no such file: {source}") from None
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


def _read_array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
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
    array: NDArray[Any] = np.lib.format.read_array(buffer, allow_pickle=False)
    return array


def _find_infinite(value: Any, place: str = "") -> str | None:
    """Return where in a JSON value a number is not finite, or None."""
    if isinstance(value, float):
        return None if math.isfinite(value) else place
    items: Any = ()
    if isinstance(value, dict):
        items = ((f".{key}", item) for key, item in value.items())
    elif isinstance(value, list):
        items = ((f"[{k}]", item) for k, item in enumerate(value))
    for name, item in items:
        found = _find_infinite(item, place + name)
        if found is not None:
            return found
    return None


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
        if top > FARTHEST:
            raise InputError(f"{name} reaches {top:g} mm: it must lie within {FARTHEST:g} mm")
    if (np.diff(plan.path_arc_length) < 0.0).any() or plan.path_arc_length[0] != 0.0:
        raise InputError("path_arc_length must begin at 0 and never fall")


def _read_part(meta: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return an object of the meta, empty where it is not there."""
    part = meta.get(key)
    if part is None:
        return {}
    if not isinstance(part, dict):
        raise InputError(f"meta.{key} is {_show(part)}: it must be an object")
    return part


def _check_part(
    meta: Mapping[str, Any], key: str, name: str, *, low: float, low_open: bool = False
) -> float | None:
    """Return a number of the meta inside its range; None where it is not there or null."""
    value = _read_part(meta, key).get(name)
    if value is None:
        return None
    return check_number(
        f"meta.{key}.{name}", value, low=low, high=FARTHEST, low_open=low_open, unit="mm"
    )


def _check_meta(plan: Plan) -> None:
    """Raise `InputError` for a description that no scope, introducer or wall can have."""
    meta = plan.meta
    _check_part(meta, "scope", "diameter_mm", low=0.0, low_open=True)
    _check_part(meta, "scope", "link_length_mm", low=0.0, low_open=True)
    inflation = _check_part(meta, "field", "inflation_mm", low=0.0)
    _check_part(meta, "field", "clearance_error_mm", low=0.0)
    _check_part(meta, "measures", "joint_step_max_mm", low=0.0)
    if meta.get("head_step_mm") is not None:
        check_number("meta.head_step_mm", meta["head_step_mm"], low=0.0, low_open=True, unit="mm")
    used = _check_part(meta, "soft_wall", "used_mm", low=0.0)
    allowed = _check_part(meta, "soft_wall", "allowed_mm", low=0.0)
    if used is not None and (
        allowed is None or used > allowed + 1e-9 or used > (inflation or 0.0) + 1e-9
    ):
        raise InputError(
            f"meta.soft_wall.used_mm is {used:g} mm: it must be at most what is allowed and part "
            "of meta.field.inflation_mm"
        )
    for key in ("options", "input", "certificate"):
        _read_part(meta, key)
    if meta.get("introducer") is None:
        return
    tube = _read_part(meta, "introducer")
    check_number(
        "meta.introducer.bore_mm",
        tube.get("bore_mm"),  # type: ignore[arg-type]
        low=0.0,
        high=FARTHEST,
        low_open=True,
        unit="mm",
    )
    dim = plan.joints.shape[2]
    for name in ("entry_mm", "outward"):
        point = check_points(f"meta.introducer.{name}", tube.get(name), dim=dim)  # type: ignore[arg-type]
        if point.shape != (dim,):
            raise InputError(f"meta.introducer.{name} has shape {point.shape}: it must be ({dim},)")
        size = float(np.linalg.norm(point))
        if name == "outward" and abs(size - 1.0) > 1e-6:
            raise InputError(f"meta.introducer.outward has length {size:g}: it must be 1")


def read_route(plan: Plan) -> tuple[float, ...]:
    """Return the fractions of the path that the head was to go to in turn.

    Raises
    ------
    InputError
        If the plan's `meta` states anything else.
    """
    route = _read_part(plan.meta, "options").get("route")
    if route is None:
        return (1.0,)
    if not isinstance(route, list) or not route:
        raise InputError(f"meta.options.route is {_show(route)}: it must be a list of fractions")
    return tuple(check_number("meta.options.route", v, low=0.0, high=1.0) for v in route)


def _check_status(plan: Plan) -> None:
    """Raise `InputError` if a plan calls itself complete whose head never got to the end."""
    share = max(read_route(plan))
    if plan.status != "complete":
        return
    if plan.reason_code or plan.reason:
        raise InputError(
            f"status is 'complete', but a reason to stop is given ({_show(plan.reason_code)}): "
            "one of them is wrong"
        )
    goal = share * float(plan.path_arc_length[-1])
    if plan.inserted < goal - SLACK:
        raise InputError(
            f"status is 'complete', but the head gets to {plan.inserted:g} mm of its path: it must "
            f"get to {goal:g} mm"
        )
    step = int(np.argmax(plan.head_arc_length))
    end = np.array([np.interp(goal, plan.path_arc_length, column) for column in plan.path.T])
    miss = float(np.linalg.norm(plan.joints[step, 0] - end))
    if miss > SLACK:
        raise InputError(
            f"status is 'complete', but the head's joint stays {miss:g} mm from the end of its "
            f"path: it must be within {SLACK:g} mm"
        )


def _check_claim(plan: Plan) -> None:
    """Raise `InputError` if a plan claims more of its clearance than its own numbers allow."""
    certified = plan.meta.get("certified")
    if certified is not None and not isinstance(certified, bool):
        raise InputError(f"meta.certified is {_show(certified)}: it must be true or false")
    claimed = _check_part(plan.meta, "certificate", "clearance_mm", low=-FARTHEST)
    if certified and (claimed is None or claimed < 0.0):
        told = "no clearance" if claimed is None else f"a clearance of {claimed:g} mm"
        raise InputError(
            f"meta.certified is true, but the certificate has {told}: it must be at least 0 mm"
        )
    if claimed is None or claimed < 0.0:
        return
    # The certificate is a lower bound, so no estimate may lie below it by more than its error.
    error = _check_part(plan.meta, "field", "clearance_error_mm", low=0.0)
    used = _check_part(plan.meta, "soft_wall", "used_mm", low=0.0) or 0.0
    highest = plan.clearance_min + used + (0.0 if error is None else error)
    if claimed > highest + SLACK:
        raise InputError(
            f"the certificate's clearance is {claimed:g} mm: the clearances at the steps allow at "
            f"most {highest:g} mm"
        )


def _show(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
