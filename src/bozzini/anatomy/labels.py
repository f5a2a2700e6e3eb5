"""From an array of labels to a checked `LabelTract`: what is wrong is said, never passed over."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_points
from ..errors import GeometryError, InputError
from ._scale import check_scale
from .findings import Finding
from .frame import measure_shift
from .tract import LabelTract

__all__ = ["tract_from_labels"]

PADDING = 2
"""Voxels of zero around the lumen."""

MAX_LABEL = 65535
MAX_SHEAR = 1e-3
"""Largest cosine between two voxel axes that is taken for rounding, not shear."""

SHIFT = 0.05
"""Move of the wall by squaring the voxel axes that is worth a note [mm]."""

COARSE = 3.0
"""Voxel size above which small lumens are lost [mm]."""

ANISOTROPIC = 2.0
MANY_LABELS = 256

Voxels = NDArray[np.uint16]
Matrix = NDArray[np.float64]


def tract_from_labels(
    array: ArrayLike,
    affine: ArrayLike,
    *,
    labels: Sequence[int | str] | str | None = None,
    source: str = "array",
    findings: Iterable[Finding] = (),
) -> LabelTract:
    """Check a label volume and keep the lumen that is asked for.

    The lumen is the union of the labels. Voxels are connected through their faces only (a scope
    does not pass through an edge or a corner), and the largest component is kept. The array is
    cropped to it, with a border of two voxels, and the affine moves with it.

    Parameters
    ----------
    array : array_like, shape (nx, ny, nz)
        Whole numbers; trailing axes of length 1 are dropped. 0 is not lumen.
    affine : array_like, shape (4, 4)
        Voxel index (centre of the voxel) to world [mm], without shear.
    labels : sequence of int, optional
        The labels that make up the lumen; by default every value but 0.
    source : str
        Where it came from, for reports and messages.
    findings : iterable of Finding
        What was found before, to be kept.

    Returns
    -------
    LabelTract

    Raises
    ------
    InputError
        If the array is not three-dimensional or holds no whole numbers, a label is not there, or
        the affine is singular, sheared or not finite.
    GeometryError
        If the lumen is empty.
    """
    volume = _check_volume(np.asarray(array), source)
    matrix = _check_affine(affine, source)
    found = list(findings)
    selected = _select(volume, labels, source, found)
    found += _check_voxels(matrix)
    found += _check_border(selected)
    kept, start = _keep_largest(selected, matrix, source, found)
    matrix = matrix.copy()
    matrix[:3, 3] += matrix[:3, :3] @ (start - PADDING)
    kept = np.pad(kept, PADDING)
    found += _check_topology(kept != 0)
    index = np.argwhere(kept)
    size = (np.ptp(index, axis=0) + 1) * np.linalg.norm(matrix[:3, :3], axis=0)
    found += _check_shear(matrix, size)
    found += check_scale(float(size.max()), hint="check the voxel size in the file's header")
    return LabelTract(labels=kept, affine=matrix, source=source, findings=tuple(found))


def _check_volume(volume: NDArray[np.generic], source: str) -> NDArray[np.generic]:
    shape = volume.shape
    while volume.ndim > 3 and volume.shape[-1] == 1:
        volume = volume[..., 0]
    if volume.ndim != 3:
        raise InputError(
            f"{source} has {len(shape)} dimensions, shape {shape}: a label volume has 3"
        )
    if volume.size == 0:
        raise InputError(f"{source} has shape {shape}: it holds no voxels")
    if volume.dtype.kind == "f":
        _check_whole(volume, source)
    elif volume.dtype.kind not in "iub":
        raise InputError(f"{source} holds {volume.dtype} values: labels are whole numbers")
    return volume


def _check_whole(volume: NDArray[np.generic], source: str) -> None:
    values = volume.reshape(-1)
    for begin in range(0, values.size, 1 << 24):  # in pieces: a CT may not fit twice in memory
        piece = values[begin : begin + (1 << 24)]
        if not np.isfinite(piece).all():
            raise InputError(f"{source} has voxels that are not finite: labels are whole numbers")
        whole = piece == np.rint(piece)
        if not whole.all():
            raise InputError(
                f"{source} has the voxel value {piece[~whole][0]:g}: labels are whole numbers "
                f"(this looks like an image, not a label volume)"
            )


def _check_affine(affine: ArrayLike, source: str) -> Matrix:
    matrix = check_points(f"the affine of {source}", affine, dim=4)
    if matrix.shape != (4, 4) or not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-9):
        raise InputError(f"the affine of {source} is not a 4 x 4 matrix with last row 0 0 0 1")
    axes = matrix[:3, :3]
    size = np.linalg.norm(axes, axis=0)
    if not (size > 1e-9).all():
        raise InputError(
            f"the affine of {source} is singular: voxel sizes {_join(size)} mm must be above 0"
        )
    unit = axes / size
    if abs(np.linalg.det(unit)) < 1e-6:
        raise InputError(f"the affine of {source} is singular: its voxel axes lie in a plane")
    cosine = float(np.abs(unit.T @ unit - np.eye(3)).max())
    if cosine > MAX_SHEAR:
        raise InputError(
            f"the affine of {source} is sheared (cosine {cosine:.3g} between two voxel axes, at "
            f"most {MAX_SHEAR:g} is legal): resample the volume first"
        )
    return matrix


def _check_shear(matrix: Matrix, size: NDArray[np.float64]) -> list[Finding]:
    shape = tuple(int(v) for v in np.rint(size / np.linalg.norm(matrix[:3, :3], axis=0)))
    shift = measure_shift(matrix, shape)
    if shift <= SHIFT:
        return []
    message = (
        f"the voxel axes are not quite at right angles: taken as if they were, which moves the "
        f"wall by up to {shift:.2g} mm"
    )
    return [Finding("axes-squared", "note", message)]


def _select(
    volume: NDArray[np.generic],
    labels: Sequence[int | str] | str | None,
    source: str,
    found: list[Finding],
) -> Voxels:
    low, high = float(volume.min()), float(volume.max())
    if low < 0 or high > MAX_LABEL:
        raise InputError(
            f"{source} has voxel values from {low:g} to {high:g}: labels lie in [0, {MAX_LABEL}] "
            f"(this looks like an image, not a label volume)"
        )
    values = volume.astype(np.uint16, copy=False)
    count = np.bincount(values.reshape(-1))
    count[0] = 0
    there = np.flatnonzero(count)
    if len(there) == 0:
        raise GeometryError(f"{source} is empty: every voxel is 0")
    if labels is None:
        if len(there) > MANY_LABELS:
            message = f"{len(there)} different labels are all taken as lumen: give the labels"
            found.append(Finding("many-labels", "warning", message))
        return values
    wanted = _check_labels(labels)
    missing = [value for value in wanted if value >= len(count) or count[value] == 0]
    if missing:
        shown = ", ".join(str(value) for value in there[:20])
        more = f" and {len(there) - 20} more" if len(there) > 20 else ""
        word = "label" if len(missing) == 1 else "labels"
        raise InputError(
            f"{source} has no voxel of {word} {', '.join(map(str, missing))}: it has {shown}{more}"
        )
    keep = np.zeros(len(count), dtype=bool)
    keep[wanted] = True
    left = [int(value) for value in there if not keep[value]]
    if left:
        shown = ", ".join(map(str, left[:10])) + (" …" if len(left) > 10 else "")
        word = "label" if len(left) == 1 else "labels"
        found.append(Finding("labels-left-out", "note", f"{word} not selected: {shown}"))
    return np.where(keep[values], values, np.uint16(0))


def _check_labels(labels: Sequence[int | str] | str) -> list[int]:
    wanted: list[int] = []
    for value in labels:
        if isinstance(value, bool) or value != int(value) or not 1 <= value <= MAX_LABEL:
            raise InputError(f"label is {value!r}: it must be a whole number in [1, {MAX_LABEL}]")
        wanted.append(int(value))
    if not wanted:
        raise InputError("no labels were given: name at least one, or leave them out for all")
    return wanted


def _check_voxels(matrix: Matrix) -> list[Finding]:
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    found = []
    ratio = size.max() / size.min()
    if ratio > ANISOTROPIC:
        message = (
            f"voxels of {_join(size)} mm are {ratio:.1f} times longer than wide: distances are "
            f"no better than the long side"
        )
        found.append(Finding("voxels-anisotropic", "warning", message))
    if size.max() > COARSE:
        message = f"voxels of {_join(size)} mm are coarse: lumens thinner than two are lost"
        found.append(Finding("voxels-coarse", "warning", message))
    return found


def _check_border(selected: Voxels) -> list[Finding]:
    ends = []
    for axis, name in enumerate("ijk"):
        for index, side in ((0, "low"), (-1, "high")):
            if selected.take(index, axis=axis).any():
                ends.append(f"{side} {name}")
    if not ends:
        return []
    message = f"the lumen reaches the border of the volume ({', '.join(ends)} end): it is cut there"
    return [Finding("lumen-cut", "note", message)]


def _keep_largest(
    selected: Voxels, matrix: Matrix, source: str, found: list[Finding]
) -> tuple[Voxels, NDArray[np.int64]]:
    """Return the largest component cropped to its box, and the index of the box's first voxel."""
    from scipy import ndimage

    first = _find_box(selected)
    selected = selected[first]
    components, number = ndimage.label(selected)  # default structure: neighbours through faces
    start = np.array([part.start for part in first], dtype=np.int64)
    if number == 1:
        return selected, start
    counts = np.bincount(components.reshape(-1))
    counts[0] = 0
    largest = int(counts.argmax())
    dropped = int(counts.sum() - counts[largest])
    voxel = abs(float(np.linalg.det(matrix[:3, :3])))
    message = (
        f"{number} components (neighbours through faces): the largest is kept, "
        f"{_count_voxels(dropped)} ({dropped * voxel / 1000.0:.3g} mL) in {number - 1} "
        f"{'other' if number == 2 else 'others'} {'is' if dropped == 1 else 'are'} dropped"
    )
    if number > 2:
        message += f", the largest of them {_count_voxels(int(np.sort(counts)[-2]))}"
    share = dropped / counts.sum()
    found.append(Finding("components-dropped", "warning" if share > 0.01 else "note", message))
    kept = np.where(components == largest, selected, np.uint16(0))
    lost = sorted(set(np.unique(selected).tolist()) - set(np.unique(kept).tolist()))
    if lost:
        words = ("label", "lies") if len(lost) == 1 else ("labels", "lie")
        where = "component" if number == 2 else "components"
        message = f"{words[0]} {', '.join(map(str, lost))} {words[1]} wholly in the {where} dropped"
        found.append(Finding("label-dropped", "warning", message))
    second = _find_box(kept)
    return kept[second], start + [part.start for part in second]


def _find_box(voxels: Voxels) -> tuple[slice, slice, slice]:
    box = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        there = np.flatnonzero(voxels.any(axis=others))
        box.append(slice(int(there[0]), int(there[-1]) + 1))
    return box[0], box[1], box[2]


def _check_topology(mask: NDArray[np.bool_]) -> list[Finding]:
    """Count handles and cavities of one component from its Euler number.

    For voxels joined through faces: Euler number = components - handles + cavities.
    """
    import skimage.measure
    from scipy import ndimage

    measure: Any = skimage.measure

    _, outside = ndimage.label(~mask, structure=np.ones((3, 3, 3), dtype=int))
    cavities = int(outside) - 1
    handles = 1 + cavities - int(measure.euler_number(mask, connectivity=1))
    found = []
    if cavities:
        word = "cavity" if cavities == 1 else "cavities"
        message = f"{cavities} closed {word} inside the lumen: counted as wall"
        found.append(Finding("cavities", "warning", message))
    if handles:
        word = "handle" if handles == 1 else "handles"
        message = f"{handles} {word} (the lumen closes on itself): ways around may be false"
        found.append(Finding("handles", "warning", message))
    return found


def _count_voxels(number: int) -> str:
    return f"{number} voxel{'' if number == 1 else 's'}"


def _join(size: NDArray[np.float64]) -> str:
    return " x ".join(f"{value:.3g}" for value in size)
