"""The file of a robot's motion: a compressed NumPy archive, arrays and one JSON text."""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileFormatError
from ..files import write_atomically
from .actuation import Actuation
from .arc_certificate import ArcCertificate
from .robot import ContinuumRobot

__all__ = ["ACTUATION_FORMAT", "load_actuation", "save_actuation"]

ACTUATION_FORMAT = "bozzini-actuation-1"

ARRAYS = (
    "head_arc_length",
    "base_advance",
    "bends",
    "displacements",
    "fit_rms",
    "fit_max",
    "clearance",
    "frame",
)

_DAMAGED = (
    OSError,
    ValueError,
    KeyError,
    TypeError,
    EOFError,
    NotImplementedError,
    RecursionError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What NumPy, zip and JSON raise on a damaged file."""


def save_actuation(actuation: Actuation, path: Path) -> Path:
    """Write a motion; see `Actuation.save`."""
    record = {
        "format": ACTUATION_FORMAT,
        "robot": actuation.robot.to_dict(),
        "certificate": actuation.certificate.describe(),
        "status": actuation.status,
        "reason_code": actuation.reason_code,
        "reason": actuation.reason,
        "meta": actuation.meta,
    }
    text = np.array(json.dumps(record, allow_nan=False))
    arrays = {name: getattr(actuation, name) for name in ARRAYS}

    def write(temporary: Path) -> None:
        with temporary.open("wb") as stream:
            np.savez_compressed(stream, record=text, **arrays)

    return write_atomically(path, write)


def load_actuation(path: Path) -> Actuation:
    """Read a motion; see `Actuation.load`."""
    try:
        with np.load(path, allow_pickle=False) as data:
            record = json.loads(str(data["record"]))
            if not isinstance(record, dict) or record.get("format") != ACTUATION_FORMAT:
                raise FileFormatError(f"{path} is not an actuation of format {ACTUATION_FORMAT!r}")
            arrays: dict[str, Any] = {name: data[name] for name in ARRAYS}
        texts = {key: record[key] for key in ("status", "reason_code", "reason", "meta")}
        return Actuation(
            robot=ContinuumRobot.from_dict(record["robot"]),
            certificate=ArcCertificate.from_description(record["certificate"]),
            **arrays,
            **texts,
        )
    except FileNotFoundError:
        raise FileFormatError(f"no such file: {path}") from None
    except FileFormatError:
        raise
    except _DAMAGED as error:
        words = " ".join(str(error).split())
        raise FileFormatError(f"{path} is not a Bozzini actuation: {words}") from None
