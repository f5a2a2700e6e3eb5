"""Named regions of an organ in a label volume: lobes, segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..numeric.arrays import Floats
from .files import PathLike
from .frame import convert_frame
from .labels import check_affine, find_centres, narrow_volume
from .names import describe_label
from .volumes import read_volume

MOST_VOXELS = 1_000_000
"""Voxels that are looked at: of a larger volume every second, third ... along each axis."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Regions of an organ, which may overlap.

    Parameters
    ----------
    names : tuple of str
    places : (n, 3) float
        Centres of voxels, world frame [mm].
    inside : (r, n) bool
        Which of them lie in each region.
    """

    names: tuple[str, ...]
    places: Floats
    inside: NDArray[np.bool_]


def read_regions(path: PathLike, frame: str | None = None) -> Regions:
    """Read the labels of a volume, with the names that it or a file beside it states.

    Parameters
    ----------
    path : path-like
        As for `bozzini.anatomy.read_labels`; of several layers too.
    frame : str, optional
        Of the world that they are asked in; by default the file's own.

    Raises
    ------
    FileFormatError, InputError
        If it cannot be read, or is no label volume.
    """
    volume = read_volume(path)
    affine = check_affine(volume.affine, volume.source)
    if frame is not None and volume.frame is not None:
        affine = convert_frame(affine, volume.frame, frame)
    array = volume.array
    layers = [array[..., k] for k in range(array.shape[3])] if volume.segments else [array]
    layers = [narrow_volume(layer, volume.source) for layer in layers]
    count = int(np.count_nonzero(np.any([layer != 0 for layer in layers], axis=0)))
    if count == 0:
        raise InputError(f"{path} is empty: every voxel is 0")
    step = int(np.ceil((count / MOST_VOXELS) ** (1.0 / 3.0)))
    layers = [layer[::step, ::step, ::step] for layer in layers]
    there = np.any([layer != 0 for layer in layers], axis=0)
    values = [layer[there] for layer in layers]
    known = list(volume.segments) or [
        (describe_label(int(label), volume.names), int(label), 0)
        for label in np.unique(values[0])
        if label
    ]
    return Regions(
        names=tuple(name for name, _, _ in known),
        places=find_centres(there, affine @ np.diag([step, step, step, 1.0])),
        inside=np.stack([values[layer] == label for _, label, layer in known]),
    )
