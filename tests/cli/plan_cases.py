"""What the tests of ``bozzini plan`` share: a small tract in every form, and a way to run it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import trimesh

from tests.shapes import bend_curve

SCOPE = ["--diameter", "5mm", "--link", "8mm", "--head-step", "1mm"]
CURVE = bend_curve(25.0, 1.4, 22.0)


def write_volume(path: Path, array: np.ndarray, spacing: float | tuple[float, ...] = 1.5) -> Path:
    image = nibabel.Nifti1Image(array, np.diag([*np.broadcast_to(spacing, 3), 1.0]))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


@dataclass(frozen=True)
class Tracts:
    """One bent tube of 8 mm radius in every form.

    Of one label in `volume`; in `halves` and `labels` the lower half is label 1, the upper 2.
    """

    folder: Path
    mesh: trimesh.Trimesh
    labels: np.ndarray

    @property
    def volume(self) -> Path:
        return self.folder / "tube.nii.gz"

    @property
    def halves(self) -> Path:
        return self.folder / "halves.nii.gz"

    @property
    def surface(self) -> Path:
        return self.folder / "tube.stl"


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str

    @property
    def result(self) -> dict[str, Any]:
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


Run = Callable[..., Outcome]


def list_all(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}
