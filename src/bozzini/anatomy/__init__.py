"""Tracts: read from CT labels or surfaces, made as a phantom, or fetched from public sources.

Everything is in mm, in the frame of the file (RAS+ for NIfTI: +x to the patient's right, +y to the
front, +z to the head; LPS for DICOM and MetaImage).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .fetch import CATALOGUE, FetchResult, PublicData, fetch_data
    from .files import write_tract
    from .labels import tract_from_labels
    from .phantom import Phantom, make_phantom
    from .read import read_surface, read_tract
    from .segment import GasSegment, Segmentation, segment_gas
    from .surface import tract_from_surface
    from .tissue import Breathing, Peristalsis, RecordedMotion, TissueFrame, TissueMotion
    from .tract import Component, Finding, LabelTract, Opening, Organ, SurfaceTract
    from .volumes import read_labels, read_volume

__all__ = [
    "CATALOGUE",
    "Breathing",
    "Component",
    "FetchResult",
    "Finding",
    "GasSegment",
    "LabelTract",
    "Opening",
    "Organ",
    "Peristalsis",
    "Phantom",
    "PublicData",
    "RecordedMotion",
    "Segmentation",
    "SurfaceTract",
    "TissueFrame",
    "TissueMotion",
    "fetch_data",
    "make_phantom",
    "read_labels",
    "read_surface",
    "read_tract",
    "read_volume",
    "segment_gas",
    "tract_from_labels",
    "tract_from_surface",
    "write_tract",
]

_MODULES = {
    name: module
    for module, names in {
        "fetch": ("CATALOGUE", "FetchResult", "PublicData", "fetch_data"),
        "files": ("write_tract",),
        "labels": ("tract_from_labels",),
        "phantom": ("Phantom", "make_phantom"),
        "read": ("read_surface", "read_tract"),
        "segment": ("GasSegment", "Segmentation", "segment_gas"),
        "surface": ("tract_from_surface",),
        "tissue": (
            "Breathing",
            "Peristalsis",
            "RecordedMotion",
            "TissueFrame",
            "TissueMotion",
        ),
        "tract": (
            "Component",
            "Finding",
            "LabelTract",
            "Opening",
            "Organ",
            "SurfaceTract",
        ),
        "volumes": ("read_labels", "read_volume"),
    }.items()
    for name in names
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
