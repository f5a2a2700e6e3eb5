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
