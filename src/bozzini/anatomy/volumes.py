"""Label volumes from files (NIfTI)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ._files import check_file, explain, has_suffix, name_file
from ._quiet import quiet_libraries
from .findings import Finding
from .labels import tract_from_labels
from .tract import LabelTract

__all__ = ["LABEL_SUFFIXES", "read_labels"]

LABEL_SUFFIXES = (".nii", ".nii.gz")

_SCALE_TO_MM = {"mm": 1.0, "meter": 1000.0, "micron": 0.001}


def read_labels(
    path: str | os.PathLike[str],
    *,
    labels: Sequence[int | str] | str | None = None,
    frame: str | None = None,
) -> LabelTract:
    """Read a label volume from a NIfTI file, in its world frame (RAS+) in mm.

    Parameters
    ----------
    path : path-like
        A ``.nii`` or ``.nii.gz`` file.
    labels : sequence of int, optional
        The labels that make up the lumen; by default every value but 0.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated or not NIfTI.
    InputError, GeometryError
        As `tract_from_labels` does.
    """
    check_file(path)
    if not has_suffix(path, LABEL_SUFFIXES):
        raise FileFormatError(f"{path} is not named .nii or .nii.gz")
    array, affine, found = _read_nifti(path)
    return tract_from_labels(array, affine, labels=labels, source=name_file(path), findings=found)


def _read_nifti(
    path: str | os.PathLike[str],
) -> tuple[NDArray[Any], NDArray[np.float64], list[Finding]]:
    import nibabel

    with quiet_libraries():
        try:
            image: Any = nibabel.load(os.fspath(path), mmap=False)
            header: Any = image.header
            unit = header.get_xyzt_units()[0]
            framed = int(header["qform_code"]) > 0 or int(header["sform_code"]) > 0
            affine = np.array(image.affine, dtype=np.float64)
        except Exception as error:  # nibabel and gzip raise many kinds on a broken file
            raise FileFormatError(f"{path} is not a NIfTI volume: {explain(error)}") from None
        _check_dimensions(path, tuple(int(length) for length in image.shape))
        try:
            array = np.asarray(image.dataobj)
        except MemoryError:
            raise FileFormatError(
                f"{path} does not fit in memory: its shape is {image.shape}"
            ) from None
        except Exception as error:  # as above
            raise FileFormatError(
                f"{path} is truncated or damaged: its voxels cannot be read ({explain(error)})"
            ) from None
    found = []
    if unit in _SCALE_TO_MM:
        affine[:3] *= _SCALE_TO_MM[unit]
    if unit == "unknown":
        message = "the file states no unit of length: taken as mm"
        found.append(Finding("unit-unknown", "note", message))
    elif unit != "mm":
        message = f"the file is in {unit}: converted to mm"
        found.append(Finding("unit-converted", "note", message))
    if not framed:
        message = (
            "the file states no world frame (qform and sform codes are 0): the origin is the "
            "middle of the volume, left and right are by NIfTI's default"
        )
        found.append(Finding("frame-unknown", "warning", message))
    return array, affine, found


def _check_dimensions(path: str | os.PathLike[str], shape: tuple[int, ...]) -> None:
    """Refuse a series of volumes before its voxels are read."""
    extra = [length for length in shape[3:] if length != 1]
    if len(shape) < 3 or extra:
        raise FileFormatError(
            f"{path} has {len(shape)} dimensions, shape {shape}: a label volume has 3"
        )
