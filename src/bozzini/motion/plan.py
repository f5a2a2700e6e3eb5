"""The plan: what a motion planner returns, what a file holds, and what others can re-check.

A plan file is a NumPy ``.npz``: plain arrays, and one JSON text ``meta`` with every input and
version, so that the clearance can be recomputed by anybody without this package.
"""

from __future__ import annotations

import json
import os
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError
from ..files import write_atomically

__all__ = ["PLAN_FORMAT", "Plan"]

PLAN_FORMAT = "bozzini-plan-1"

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
        if joints.ndim != 3 or joints.shape[0] < 1 or joints.shape[1] < 2:
            raise InputError(f"joints has shape {joints.shape}: it must be (steps, joints, dim)")
        steps, count, _ = joints.shape
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
        """Read a plan file.

        Raises
        ------
        FileFormatError
            If the file is missing, damaged, or not a plan.
        """
        source = Path(path)
        try:
            with np.load(source, allow_pickle=False) as data:
                meta = json.loads(str(data["meta"]))
                arrays: dict[str, Any] = {
                    name: np.asarray(data[name], dtype=np.float64) for name in _ARRAYS
                }
        except FileNotFoundError:
            raise FileFormatError(f"no such file: {source}") from None
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
            raise FileFormatError(f"{source} is not a Bozzini plan: {error}") from None
        if not isinstance(meta, dict) or meta.get("format") != PLAN_FORMAT:
            raise FileFormatError(f"{source} is not a plan of format {PLAN_FORMAT!r}")
        texts = {key: meta[key] for key in ("method", "status", "reason_code", "reason")}
        return cls(**arrays, **texts, meta=meta)
