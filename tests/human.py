"""The human upper tract of the tests, read and searched once a process."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

from bozzini.anatomy import LabelTract, SurfaceTract, read_tract
from bozzini.duct import Centreline, SampledField, build_field, find_centreline

FILES = {"labels": "upper_gi_labels_1mm.nii.gz", "surface": "upper_gi_mc1mm.stl"}


class Human(NamedTuple):
    """A tract with the field and the centreline that a run makes of it."""

    tract: LabelTract | SurfaceTract
    field: SampledField
    line: Centreline


@cache
def load_human(folder: Path, kind: str, voxel: float | None = None) -> Human:
    """Return the upper tract of a folder, of the kind "labels" or "surface"."""
    tract = _read(folder / FILES[kind], "all" if kind == "labels" else None)
    field = build_field(tract, voxel=voxel)
    return Human(tract, field, find_centreline(field))


@cache
def _read(path: Path, labels: str | None) -> LabelTract | SurfaceTract:
    return read_tract(path, labels=labels)
