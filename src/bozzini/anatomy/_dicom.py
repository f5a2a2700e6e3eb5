"""DICOM: a series as a volume, by SimpleITK, its slices compared; a segmentation, by highdicom."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, MissingExtraError
from ._statements import SAME_SHARE, SAME_SPACING, compare_spacing
from .files import explain, quiet_libraries, read_number
from .frame import compare_affines
from .labels import Volume
from .tract import Finding

LARGEST_UNEVENNESS = 0.02
"""Largest departure of a distance between slices from their mean, by that mean."""

SMALL_SERIES = 0.5
"""Files of another series by those of the largest, up to which it is only left out."""

_SEGMENTATION = b"1.2.840.10008.5.1.4.1.1.66.4"
"""Class of a segmentation; surfaces are 66.5."""


def read_dicom(folder: Path, suffixes: tuple[str, ...]) -> Volume:
    """Read the series, or else the segmentation, of a folder, in its world frame, LPS, in mm."""
    files = [file for file in sorted(folder.iterdir()) if _is_dicom(file)]
    if not files:
        raise FileFormatError(
            f"{folder} is a folder without volumes: known are a DICOM series, and masks named "
            f"{', '.join(suffixes)}"
        )
    segmentations = [file for file in files if is_segmentation(file)]
    if len(segmentations) == len(files):
        if len(files) > 1:
            names = ", ".join(file.name for file in files)
            raise FileFormatError(f"{folder} holds several segmentations: give one of {names}")
        return read_segmentation(files[0])
    try:
        import SimpleITK
    except ImportError:
        raise MissingExtraError("SimpleITK", "ct") from None
    warnings = SimpleITK.ProcessObject.GetGlobalWarningDisplay()
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        reader = SimpleITK.ImageSeriesReader()
        series = {
            key: list(reader.GetGDCMSeriesFileNames(os.fspath(folder), key))
            for key in reader.GetGDCMSeriesIDs(os.fspath(folder))
        }
        series = {
            key: each
            for key, each in series.items()
            if not all(Path(file) in segmentations for file in each)
        }
        if not series:
            raise FileFormatError(f"{folder} holds neither masks nor a DICOM series")
        chosen, *others = sorted(series.values(), key=len, reverse=True)
        rest = ", ".join(map(_name_series, others))
        if others and len(others[0]) > SMALL_SERIES * len(chosen):
            raise FileFormatError(
                f"{folder} holds {len(series)} series, {_name_series(chosen)}, {rest}: give a "
                "folder with one of them"
            )
        heads = [_read_slice(file) for file in chosen]
        origins = np.array([head.affine[:3, 3] for head in heads])
        reader.SetFileNames(chosen)
        image = reader.Execute()
        array = SimpleITK.GetArrayFromImage(image)
        direction = np.reshape(image.GetDirection(), (3, 3))
        spacing = np.array(image.GetSpacing())
        origin = np.array(image.GetOrigin())
    except FileFormatError:
        raise
    except Exception as error:  # SimpleITK raises RuntimeError for whatever went wrong
        raise FileFormatError(f"{folder} cannot be read as DICOM: {explain(error)}") from None
    finally:
        SimpleITK.ProcessObject.SetGlobalWarningDisplay(warnings)
    if array.ndim != 3:
        raise FileFormatError(f"{folder} holds voxels of {array.ndim - 2} values: CT has one")
    affine = np.eye(4)
    affine[:3, :3] = direction * spacing
    affine[:3, 3] = origin
    found: list[Finding] = []
    if len(chosen) > 1:
        _check_heads(heads, folder)
        affine[:3, 2] = _check_slices(origins, direction, folder)
        found += _compare_steps(heads[0], affine, array.T.shape)
    if others:
        message = f"series of the folder left out, as another has more files: {rest}"
        found.append(Finding("series-left-out", "warning", message))
    if segmentations:
        names = ", ".join(file.name for file in segmentations)
        message = f"segmentations left out, give the file to read one: {names}"
        found.append(Finding("series-left-out", "note", message))
    return Volume(
        array=array.T, affine=affine, source=folder.name, frame="LPS", findings=tuple(found)
    )


def _name_series(files: list[str]) -> str:
    """Return the description of a series, its first file, and how many there are."""
    import SimpleITK

    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(files[0])
    reader.ReadImageInformation()
    tag = "0008|103e"
    name = str(reader.GetMetaData(tag)).strip() if reader.HasMetaDataKey(tag) else ""
    return f"'{name}' ({Path(files[0]).name} and {len(files) - 1} more)"


def is_segmentation(file: Path) -> bool:
    """Whether a file is a DICOM segmentation, by the class in its header."""
    if not _is_dicom(file):
        return False
    with file.open("rb") as handle:
        return _SEGMENTATION in handle.read(4096)


def read_segmentation(file: Path) -> Volume:
    """Read a DICOM segmentation by highdicom, with the names of its segments, in LPS in mm.

    Where segments overlap the volume has a layer for each.
    """
    if not is_segmentation(file):
        what = "a slice: give the folder of the series" if _is_dicom(file) else "not DICOM"
        raise FileFormatError(f"{file} is no DICOM segmentation, but {what}")
    try:
        from highdicom.seg import segread
    except ImportError:
        raise MissingExtraError("highdicom", "ct") from None
    segments: tuple[tuple[str, int, int], ...] = ()
    volume = None
    try:
        with quiet_libraries():
            found = segread(os.fspath(file))
            numbers = found.segment_numbers
            names = {n: str(found.get_segment_description(n).segment_label) for n in numbers}
            with suppress(RuntimeError):  # segments overlap
                volume = found.get_volume(combine_segments=True)
            if volume is None:
                volume = segread(os.fspath(file)).get_volume(rescale_fractional=False)
                segments = tuple((name, 1, layer) for layer, name in enumerate(names.values()))
    except Exception as error:  # highdicom and pydicom raise many kinds
        raise FileFormatError(f"{file} cannot be read: {explain(error)}") from None
    return Volume(
        array=np.asarray(volume.array),
        affine=np.array(volume.affine, dtype=np.float64),
        source=file.name,
        names=names,
        frame="LPS",
        segments=segments,
    )


def _is_dicom(file: Path) -> bool:
    if not file.is_file():
        return False
    with file.open("rb") as handle:
        return handle.read(132)[128:] == b"DICM"


@dataclass(frozen=True, kw_only=True)
class _Slice:
    """What the file of a slice states: its affine, and two lengths along it [mm], NaN if none."""

    file: str
    affine: NDArray[np.float64]
    shape: tuple[int, ...]
    between: float
    thickness: float


def _read_slice(file: str) -> _Slice:
    import SimpleITK

    reader = SimpleITK.ImageFileReader()
    reader.SetFileName(file)
    reader.ReadImageInformation()

    def read(tag: str) -> str:
        return str(reader.GetMetaData(tag)).strip() if reader.HasMetaDataKey(tag) else ""

    affine = np.eye(4)
    affine[:3, :3] = np.reshape(reader.GetDirection(), (3, 3)) * reader.GetSpacing()
    affine[:3, 3] = reader.GetOrigin()
    return _Slice(
        file=Path(file).name,
        affine=affine,
        shape=tuple(reader.GetSize()),
        between=read_number(read("0018|0088")),
        thickness=read_number(read("0018|0050")),
    )


def _check_heads(heads: list[_Slice], folder: Path) -> None:
    """Refuse slices whose axes or pixels are not those of the first."""
    first = heads[0]
    for head in heads[1:]:
        moved = head.affine.copy()
        moved[:3, 3] = first.affine[:3, 3]
        moved[:3, 2] = first.affine[:3, 2]
        gap = compare_affines(first.affine, moved, first.shape, frame="LPS")
        if gap.farthest > SAME_SHARE * float(np.linalg.norm(first.affine[:3, :2], axis=0).min()):
            raise FileFormatError(
                f"{folder}: the axes or pixels of {first.file} and {head.file} differ {gap}: they "
                f"are not of one volume"
            )


def _compare_steps(
    head: _Slice, affine: NDArray[np.float64], shape: tuple[int, ...]
) -> list[Finding]:
    """Compare what a slice states of its distance and thickness with the step of its places."""
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    stated = np.array([sizes[0], sizes[1], head.between])
    what = "SpacingBetweenSlices"
    found = compare_spacing(what, "ImagePositionPatient", affine, stated, shape)
    thick = head.thickness
    if thick > 0.0 and abs(thick - sizes[2]) > SAME_SPACING * sizes[2]:
        how = "overlap" if thick > sizes[2] else "leave gaps"
        message = f"slices are {thick:.4g} mm thick and {sizes[2]:.4g} mm apart: they {how}"
        found.append(Finding("slices-apart", "note" if thick > sizes[2] else "warning", message))
    return found


def _check_slices(
    origins: NDArray[np.float64], direction: NDArray[np.float64], folder: Path
) -> NDArray[np.float64]:
    """Return the mean step from slice to slice; refuse slices that are missing or slanted."""
    steps = np.diff(origins, axis=0)
    mean = steps.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 1e-6 or np.abs(steps - mean).max() > LARGEST_UNEVENNESS * length:
        lengths = np.linalg.norm(steps, axis=1)
        raise FileFormatError(
            f"{folder}: its {len(origins)} slices are not evenly spaced, {lengths.min():.3g} to "
            f"{lengths.max():.3g} mm apart: slices are missing or doubled"
        )
    if abs(float(mean @ direction[:, 2])) < 0.999 * length:
        raise FileFormatError(
            f"{folder}: its slices are slanted (gantry tilt): resample the series first"
        )
    return np.asarray(mean)
