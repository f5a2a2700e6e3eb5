"""Label volumes from files: NIfTI, NRRD, MetaImage, folders of one mask per organ, DICOM series."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError, InputError, MissingExtraError
from ._files import check_file, explain, has_suffix, name_file
from ._names import find_organ, is_digestive, normalise
from ._volume_files import read_metaimage, read_nifti, read_nrrd
from .findings import Finding
from .frame import check_frame
from .labels import Labels, Volume, select_labels, tract_from_volume, wants_all
from .tract import LabelTract

__all__ = ["LABEL_SUFFIXES", "is_volume", "read_labels", "read_volume"]

_READERS: dict[tuple[str, ...], Callable[[str | os.PathLike[str]], Volume]] = {
    (".nii", ".nii.gz"): read_nifti,
    (".nrrd", ".nhdr"): read_nrrd,
    (".mha", ".mhd"): read_metaimage,
}

LABEL_SUFFIXES = tuple(suffix for suffixes in _READERS for suffix in suffixes)

SAME = 1e-3
"""Largest difference of the places of two masks' voxels [mm]."""

UNEVEN = 0.02
"""Largest departure of a distance between slices from their mean, by that mean."""


def is_volume(path: str | os.PathLike[str]) -> bool:
    """Whether a path is one that `read_labels` takes: by its suffix, or a folder."""
    return has_suffix(path, LABEL_SUFFIXES) or Path(path).is_dir()


def read_labels(
    path: str | os.PathLike[str],
    *,
    labels: Labels | None = None,
    frame: str | None = None,
) -> LabelTract:
    """Read a lumen from a label volume, in the file's own world frame in mm.

    Parameters
    ----------
    path : path-like
        A ``.nii``, ``.nii.gz``, ``.nrrd``, ``.nhdr``, ``.mha`` or ``.mhd`` file, or a folder of
        such files, one mask per organ, named by it.
    labels : sequence of int or str, optional
        The labels that make up the lumen, by number or by name (small and capital letters are
        alike), or ``"all"``. A name is that of the file, or for a file of TotalSegmentator
        without names such as ``"totalsegmentator-v1:colon"``. None takes the only label there is.
    frame : str, optional
        Where the world axes point in the patient, such as ``"LPS"``, instead of what the file
        states. Coordinates are not changed.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated, damaged (a checksum disagrees, bytes are missing
        or left over) or of another kind.
    InputError, GeometryError
        As `tract_from_labels` does.
    """
    if Path(path).is_dir() and (masks := _list_masks(Path(path))):
        volume = _read_masks(Path(path), masks, labels)
        labels = "all"
    else:
        volume = read_volume(path)
        if volume.segments:
            volume = _merge_segments(volume, labels)
            labels = "all"
    volume = _override_frame(volume, frame)
    tract = tract_from_volume(volume, labels=labels)
    stem = name_file(path).split(".")[0]
    if labels is None and not tract.label_names and find_organ([stem]) is not None:
        names = {tract.label_values[0]: stem}  # one label: the file is named after it
        return replace(tract, label_names=names, organ=find_organ([stem]))
    return tract


def read_volume(path: str | os.PathLike[str]) -> Volume:
    """Read a volume, labels or image, from a file or a folder with a DICOM series.

    Raises
    ------
    FileFormatError
        As `read_labels` does.
    MissingExtraError
        If it is a DICOM series and SimpleITK is not installed.
    """
    if Path(path).is_dir():
        return _read_dicom(Path(path))
    check_file(path)
    for suffixes, reader in _READERS.items():
        if has_suffix(path, suffixes):
            return reader(path)
    hint = ": give the folder of the series" if has_suffix(path, (".dcm",)) else ""
    raise FileFormatError(f"{path} is not named {', '.join(LABEL_SUFFIXES)}{hint}")


def _override_frame(volume: Volume, frame: str | None) -> Volume:
    if frame is None:
        return volume
    code = check_frame(frame)
    found = [item for item in volume.findings if item.code != "frame-unknown"]
    if volume.frame not in (None, code):
        message = (
            f"the file states the frame {volume.frame}, but {code} was given: taken as {code}, "
            f"coordinates are not changed"
        )
        found.append(Finding("frame-overridden", "warning", message))
    return replace(volume, frame=code, findings=tuple(found))


def _list_masks(folder: Path) -> dict[str, Path]:
    """Return the volumes in a folder by their names without suffix."""
    found = {}
    for file in sorted(folder.iterdir()):
        suffix = max(
            (s for s in LABEL_SUFFIXES if file.name.lower().endswith(s)), key=len, default=""
        )
        if suffix and file.is_file() and not file.name.startswith("."):
            found[file.name[: -len(suffix)]] = file
    return found


def _read_masks(folder: Path, masks: dict[str, Path], labels: Labels | None) -> Volume:
    """Join the masks that are asked for into one volume, numbered in the order of their names."""
    names = list(masks)
    if labels is None and len(names) > 1:
        organs = [name for name in names if is_digestive(name)]
        shown = organs if organs else names
        text = ", ".join(f"{name} ({_measure_mask(masks[name]):.3g} mL)" for name in shown[:12])
        more = f" and {len(names) - len(shown[:12])} more" if len(names) > len(shown[:12]) else ""
        raise InputError(
            f"{folder} has {len(names)} masks: choose those that are lumen by name (--labels), or "
            f"all of them (--labels all): {text}{more}"
        )
    if labels is None or wants_all(labels):
        wanted = names
    else:
        wanted = []
        for label in [labels] if isinstance(labels, str) else labels:
            same = [name for name in names if normalise(name) == normalise(str(label))]
            if not same:
                shown = sorted(names, key=lambda name: not is_digestive(name))[:12]
                more = f" and {len(names) - len(shown)} more" if len(names) > len(shown) else ""
                raise InputError(
                    f"{folder} has no mask named '{label}': it has {', '.join(shown)}{more}"
                )
            wanted += same
    joined: Volume | None = None
    array: NDArray[Any] = np.zeros(0)
    for name in dict.fromkeys(wanted):
        volume = read_volume(masks[name])
        if joined is None:
            joined = volume
            array = np.zeros(volume.array.shape[:3], dtype=np.uint16, order="F")
        _check_same_grid(joined, volume, folder)
        mask = volume.array.reshape(array.shape, order="F") != 0
        np.copyto(array, np.uint16(names.index(name) + 1), where=mask & (array == 0))
    if joined is None:
        raise InputError("no labels were given: name at least one, or 'all'")
    findings = joined.findings
    if len(wanted) < len(names):
        left = len(names) - len(set(wanted))
        what = "mask of the folder is" if left == 1 else "masks of the folder are"
        message = f"{left} other {what} not compared"
        findings += (Finding("masks-left-out", "note", message),)
    return replace(
        joined,
        array=array,
        source=folder.name,
        names={number + 1: name for number, name in enumerate(names) if name in wanted},
        findings=findings,
    )


def _measure_mask(path: Path) -> float:
    """Return the volume of a mask [mL]."""
    volume = read_volume(path)
    voxel = abs(float(np.linalg.det(volume.affine[:3, :3])))
    return float(np.count_nonzero(volume.array)) * voxel / 1000.0


def _check_same_grid(one: Volume, other: Volume, folder: Path) -> None:
    shape = np.array(one.array.shape[:3])
    corners = np.array([[0, 0, 0, 1], [*shape, 1], [shape[0], 0, 0, 1], [0, shape[1], 0, 1]])
    apart = np.abs(corners @ (one.affine - other.affine).T).max()
    if other.array.shape[:3] != one.array.shape[:3] or apart > SAME:
        raise FileFormatError(
            f"{folder}: {one.source} and {other.source} do not have the same voxels: shapes "
            f"{one.array.shape} and {other.array.shape}, up to {apart:.3g} mm apart"
        )


def _merge_segments(volume: Volume, labels: Labels | None) -> Volume:
    """Select segments of a layered segmentation, which may overlap, into one volume of labels.

    Segments are numbered from 1 in the order of the file. Where one that is not selected lies
    mostly inside the selection (a polyp), it is taken out of it.
    """
    masks = []
    for name, label, layer in volume.segments:
        if layer >= volume.array.shape[3]:
            raise FileFormatError(
                f"{volume.source} states layer {layer} for segment {name}, but has "
                f"{volume.array.shape[3]}"
            )
        masks.append(volume.array[..., layer] == label)
    names = {number: name for number, (name, _, _) in enumerate(volume.segments, start=1)}
    sizes = np.array([0, *(int(np.count_nonzero(mask)) for mask in masks)], dtype=np.int64)
    voxel = abs(float(np.linalg.det(volume.affine[:3, :3])))

    wanted = select_labels(sizes, labels, names, volume.source, voxel)
    array = np.zeros(volume.array.shape[:3], dtype=np.uint16, order="F")
    for number in wanted:
        np.copyto(array, np.uint16(number), where=masks[number - 1] & (array == 0))
    findings = list(volume.findings)
    lumen = array != 0
    for number, mask in enumerate(masks, start=1):
        overlap = 0 if number in wanted else int(np.count_nonzero(mask & lumen))
        if overlap == 0:
            continue
        inside = overlap > 0.5 * sizes[number]
        message = (
            f"segment {names[number]} is not selected and shares {overlap * voxel / 1000.0:.3g} mL "
            f"with the lumen: {'taken as wall' if inside else 'left in the lumen'}"
        )
        findings.append(Finding("segment-overlap", "warning" if inside else "note", message))
        if inside:
            array[mask] = 0
    chosen = {number: names[number] for number in wanted}
    return replace(volume, array=array, names=chosen, findings=tuple(findings), segments=())


def _read_dicom(folder: Path) -> Volume:
    """Read the series of a folder by SimpleITK, in its world frame, which is LPS, in mm."""
    if not any(_is_dicom(file) for file in sorted(folder.iterdir())):
        raise FileFormatError(
            f"{folder} is a folder without volumes: known are a DICOM series, and masks named "
            f"{', '.join(LABEL_SUFFIXES)}"
        )
    try:
        import SimpleITK
    except ImportError:
        raise MissingExtraError("SimpleITK", "ct") from None
    itk: Any = SimpleITK
    warnings = itk.ProcessObject.GetGlobalWarningDisplay()
    itk.ProcessObject.SetGlobalWarningDisplay(False)
    try:
        reader = itk.ImageSeriesReader()
        series = {
            key: list(reader.GetGDCMSeriesFileNames(os.fspath(folder), key))
            for key in reader.GetGDCMSeriesIDs(os.fspath(folder))
        }
        if not series:
            raise FileFormatError(f"{folder} holds neither masks nor a DICOM series")
        files = max(series.values(), key=len)
        origins = np.array([_read_origin(itk, file) for file in files])
        reader.SetFileNames(files)
        image = reader.Execute()
        array = itk.GetArrayFromImage(image)
        direction = np.reshape(image.GetDirection(), (3, 3))
        spacing = np.array(image.GetSpacing())
        origin = np.array(image.GetOrigin())
    except FileFormatError:
        raise
    except Exception as error:  # SimpleITK raises RuntimeError for whatever went wrong
        raise FileFormatError(f"{folder} cannot be read as DICOM: {explain(error)}") from None
    finally:
        itk.ProcessObject.SetGlobalWarningDisplay(warnings)
    if array.ndim != 3:
        raise FileFormatError(f"{folder} holds voxels of {array.ndim - 2} values: CT has one")
    affine = np.eye(4)
    affine[:3, :3] = direction * spacing
    affine[:3, 3] = origin
    if len(files) > 1:
        affine[:3, 2] = _check_slices(origins, direction, folder)
    findings: tuple[Finding, ...] = ()
    if len(series) > 1:
        message = f"the folder holds {len(series)} series: the one of most files is taken"
        findings = (Finding("series-left-out", "warning", message),)
    return Volume(array=array.T, affine=affine, source=folder.name, frame="LPS", findings=findings)


def _is_dicom(file: Path) -> bool:
    if not file.is_file():
        return False
    with file.open("rb") as handle:
        return handle.read(132)[128:] == b"DICM"


def _read_origin(itk: Any, file: str) -> tuple[float, ...]:
    reader = itk.ImageFileReader()
    reader.SetFileName(file)
    reader.ReadImageInformation()
    return tuple(reader.GetOrigin())


def _check_slices(
    origins: NDArray[np.float64], direction: NDArray[np.float64], folder: Path
) -> NDArray[np.float64]:
    """Return the mean step from slice to slice; refuse slices that are missing or slanted."""
    steps = np.diff(origins, axis=0)
    mean = steps.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < 1e-6 or np.abs(steps - mean).max() > UNEVEN * length:
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
