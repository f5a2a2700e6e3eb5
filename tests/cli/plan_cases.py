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
from skimage.measure import marching_cubes

from tests.shapes import bend_curve, curve_distance

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


def write_tracts(folder: Path) -> Tracts:
    low, high = CURVE.min(axis=0) - 12.0, CURVE.max(axis=0) + 12.0
    axes = [np.arange(a, b, 1.5) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = curve_distance(CURVE, 8.0)(points)
    vertices, faces, _, _ = marching_cubes(distance, level=0.0, spacing=(1.5,) * 3)
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.export(folder / "tube.stl")
    labels = np.where(distance < 0.0, np.where(points[..., 2] < 10.0, 1, 2), 0).astype(np.uint8)
    write_volume(folder / "halves.nii.gz", labels)
    write_volume(folder / "tube.nii.gz", np.minimum(labels, 1))
    return Tracts(folder, mesh, labels)


def write_scan(path: Path, step: float = 3.0) -> Path:
    """Write the CT of a block of tissue in air, with two tubes of gas of different width."""
    x, y, z = np.meshgrid(*[np.arange(n) * step for n in (40, 40, 50)], indexing="ij")
    ct = np.full(x.shape, -1000, dtype=np.int16)
    ct[3:-3, 3:-3] = 40
    for place, radius in ((40.0, 12.0), (85.0, 9.0)):
        tube = np.hypot(x - place, y - 60.0) < radius
        ct[tube & (z > 20.0) & (z < 120.0)] = -1000
    return write_volume(path, ct, step)


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
