"""From an array of labels to a checked `LabelTract`: what is wrong is reported, never ignored."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import ceil_mm, check_points
from ..errors import GeometryError, InputError
from ._version import check_version, guess_names, name_version
from .frame import check_frame, find_axis, measure_shift
from .names import (
    VERSIONS,
    describe_label,
    find_organ,
    find_version,
    is_digestive,
    match_name,
    normalise,
    split_version,
    spread_version,
)
from .tract import (
    Component,
    Finding,
    LabelTract,
    Organ,
    TractSource,
    check_scale,
    count_noun,
    report_handles,
    show_volume,
    to_point,
)

_ABOVE = (
    ("esophagus", "S", "duodenum"),
    ("esophagus", "S", "stomach"),
    ("trachea", "S", "colon"),
    ("stomach", "L", "duodenum"),
    ("stomach", "L", "liver"),
    ("spleen", "L", "liver"),
)
"""Pairs of organs of which the first lies towards that side of the patient, centre to centre."""

Labels = Sequence[int | str] | str
"""Labels by number or name, or ``"all"``."""

PADDING_VOXELS = 2
"""Voxels of zero around the lumen."""

MAX_LABEL = 65535
MAX_SHEAR = 1e-3
"""Largest cosine between two voxel axes that is taken for rounding, not shear."""

NOTED_SHIFT_MM = 0.05
"""Move of the wall by squaring the voxel axes that is worth a note [mm]."""

COARSE_VOXEL_MM = 3.0
"""Voxel size above which small lumens are lost [mm]."""

NOTED_ASPECT = 2.0
LARGEST_ASPECT = 100.0
"""A voxel's longest side by its shortest: what is remarked, and what is refused."""

MANY_LABELS = 256

MOST_LISTED = 12
"""Labels that a message lists."""

MANY_COMPONENTS = 100
"""Components that are kept as not reached; those beyond are counted."""

ENCLOSED_SHARE = 0.5
"""Share of a label's faces that touch the lumen, above which it lies inside the lumen."""

HOLLOW_VOXELS = 1e6
"""A label is tried for being a wall with at most about so many voxels."""
HOLLOW_SHARE = 0.1
"""A wall encloses at least this share of its own volume in its slices..."""
HOLLOW_DEPTH = 2.5
"""...with room for a ball at least so many times as deep as..."""
HOLLOW_MOST = 0.9
"""...this share of the wall's voxels lies in it."""

Voxels = NDArray[Any]
"""Voxels of any type of number."""

Matrix = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Volume:
    """A volume as a file holds it, before its lumen is selected.

    Attributes
    ----------
    array : ndarray, shape (nx, ny, nz)
    affine : ndarray, shape (4, 4)
        Voxel index (centre of the voxel) to world [mm].
    source : str
        Where it came from, for reports and messages.
    names : mapping of int to str
        Names of labels, as far as the file states them.
    frame : str, optional
        Where the world axes point in the patient; see `LabelTract`.
    findings : tuple of Finding
        What was found while reading.
    segments : tuple of (name, label, layer)
        What a file of several layers holds, in which segments may overlap: then the array has a
        fourth axis, one entry per layer.
    """

    array: Voxels
    affine: NDArray[np.float64]
    source: str
    names: Mapping[int, str] = field(default_factory=dict)
    frame: str | None = None
    findings: tuple[Finding, ...] = ()
    segments: tuple[tuple[str, int, int], ...] = ()


_Framed = TypeVar("_Framed", bound=TractSource | Volume)
_Tract = TypeVar("_Tract", bound=TractSource)


def override_frame(item: _Framed, frame: str | None) -> _Framed:
    """Return a tract or volume with the frame that was given, if any, and not that of its file."""
    if frame is None:
        return item
    code = check_frame(frame)
    found = [one for one in item.findings if one.code not in ("frame-unknown", "frame-assumed")]
    if item.frame not in (None, code) and len(found) == len(item.findings):
        message = (
            f"the file states the frame {item.frame}, but {code} was given: taken as {code}, "
            f"coordinates are not changed"
        )
        found.append(Finding("frame-overridden", "warning", message))
    return replace(item, frame=code, findings=tuple(found))


def override_organ(tract: _Tract, organ: Organ | None) -> _Tract:
    """Return a tract with the organ that was given, if any, and not that of its file's names."""
    if organ is None:
        return tract
    found = tract.findings
    if tract.organ not in (None, organ):
        message = f"the file's names are those of the organ {tract.organ}, but {organ} was given"
        found += (Finding("organ-overridden", "warning", f"{message}: taken as {organ}"),)
    return replace(tract, organ=organ, findings=found)


def tract_from_labels(
    array: ArrayLike,
    affine: ArrayLike,
    *,
    labels: Labels | None = "all",
    names: Mapping[int, str] | None = None,
    source: str = "array",
    findings: Iterable[Finding] = (),
) -> LabelTract:
    """Check a label volume and keep the lumen that is asked for.

    The lumen is the union of the labels. Voxels are connected through their faces only (a scope
    does not pass through an edge or a corner), and the largest component is kept; the others are
    listed in ``not_reached``. Everything that is not kept is wall, other labels too. The array is
    cropped to the lumen, with a border of two voxels, and the affine moves with it.

    Parameters
    ----------
    array : array_like, shape (nx, ny, nz)
        Whole numbers; trailing axes of length 1 are dropped. 0 is not lumen.
    affine : array_like, shape (4, 4)
        Voxel index (centre of the voxel) to world [mm], without shear.
    labels : sequence of int or str, optional
        The labels that make up the lumen, by number or name; ``"all"`` (the default) is every
        value but 0, None the only one there is.
    names : mapping of int to str, optional
        Names of labels.
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
        If the array is not three-dimensional or holds no whole numbers, a label is not there, the
        affine is singular, sheared or not finite, or `labels` is None and there are several.
    GeometryError
        If the lumen is empty.
    """
    volume = Volume(
        array=np.asarray(array),
        affine=np.asarray(affine, dtype=np.float64),
        source=source,
        names={} if names is None else names,
        findings=tuple(findings),
    )
    return tract_from_volume(volume, labels=labels)


def tract_from_volume(volume: Volume, *, labels: Labels | None = None) -> LabelTract:
    """Check a volume and keep the lumen that is asked for; see `tract_from_labels`.

    Parameters
    ----------
    volume : Volume
    labels : sequence of int or str, optional
        The labels that make up the lumen; None takes the only one there is.

    Raises
    ------
    InputError, GeometryError
        As `tract_from_labels` does.
    """
    source = volume.source
    frame = None if volume.frame is None else check_frame(volume.frame)
    values = narrow_volume(volume.array, source)
    matrix = check_affine(volume.affine, source)
    found = list(volume.findings)
    # Runs lie along the axis that is contiguous in memory.
    turned = values.flags.f_contiguous and not values.flags.c_contiguous
    voxels = np.ascontiguousarray(values.T if turned else values)
    axes = matrix[:, [2, 1, 0, 3]] if turned else matrix
    runs = Runs.find(voxels)
    sizes = runs.sum_by(runs.labels)
    if len(sizes) == 0:
        raise GeometryError(f"{source} is empty: every voxel is 0")
    voxel = measure_voxel(matrix)
    assumed: list[Finding] = []
    names = volume.names
    if labels is not None and not wants_all(labels):
        labels = spread_version([labels] if isinstance(labels, str) else labels)
        if not names:
            labels, assumed = name_version(labels, runs=runs, axes=axes)
    elif labels is None and not names and np.count_nonzero(sizes) > 1:
        names = guess_names(runs, axes)  # to be listed
    wanted = select_labels(sizes, labels, names, source, voxel)
    asked = find_version([labels] if isinstance(labels, str) else labels or ())
    if asked is not None:
        # One that was assumed has been judged.
        found += assumed or check_version(*asked, runs=runs, axes=axes, source=source)
        known = {number: organ for organ, number in VERSIONS[asked[0]].items()}
        volume = replace(volume, names={**known, **volume.names})
    others = np.setdiff1d(np.flatnonzero(sizes), wanted)
    if len(others):
        shown = ", ".join(f"{v} {volume.names.get(int(v), '')}".strip() for v in others[:10])
        word = "label" if len(others) == 1 else "labels"
        message = f"{word} not selected: {shown}{' …' if len(others) > 10 else ''}"
        found.append(Finding("labels-left-out", "note", message))
    elif len(wanted) > MANY_LABELS:
        message = f"{len(wanted)} different labels are all taken as lumen: give the labels"
        found.append(Finding("many-labels", "warning", message))
    if frame is not None and volume.names:
        found += _check_sides(runs, axes, volume.names, frame)
    found += _check_voxels(matrix)
    selected = runs.keep(np.isin(runs.labels, wanted))
    found += _check_border(selected, voxels.shape, turned)
    kept, missed = _split(selected, axes, volume.names, found)
    lumen, corner = kept.crop(turned=turned)
    matrix = matrix.copy()
    matrix[:3, 3] += axes[:3, :3] @ (corner - PADDING_VOXELS)
    found += _check_topology(lumen, matrix) + _check_hollow(lumen, matrix)
    if len(others):
        found += _check_inside(runs, voxels, lumen.T if turned else lumen, corner, axes, volume)
    there = np.flatnonzero(kept.sum_by(kept.labels))
    names = {int(v): volume.names[int(v)] for v in there if int(v) in volume.names}
    size = (np.array(lumen.shape) - 2 * PADDING_VOXELS) * np.linalg.norm(matrix[:3, :3], axis=0)
    found += _check_shear(matrix, size)
    found += check_scale(float(size.max()), hint="check the voxel size in the file's header")
    return LabelTract(
        labels=lumen,
        affine=matrix,
        source=source,
        findings=tuple(found),
        label_names=names,
        organ=find_organ(names.values()),
        not_reached=missed,
        frame=frame,
    )


@dataclass(frozen=True, kw_only=True)
class Runs:
    """Stretches of voxels of one label along the last axis, in the order of the rows."""

    shape: tuple[int, ...]
    rows: Integers
    begins: Integers
    ends: Integers
    labels: Integers

    @staticmethod
    def find(voxels: Voxels) -> Runs:
        """Find the runs of an array that is contiguous in memory."""
        from .kernels.voxels import find_runs

        _, rows, begins, ends, labels = find_runs(voxels)
        return Runs(shape=voxels.shape, rows=rows, begins=begins, ends=ends, labels=labels)

    def keep(self, which: NDArray[np.bool_]) -> Runs:
        """Return some of the runs."""
        rows, begins, ends = self.rows[which], self.begins[which], self.ends[which]
        return replace(self, rows=rows, begins=begins, ends=ends, labels=self.labels[which])

    def sum_by(self, groups: Integers) -> Integers:
        """Return the number of voxels of each group."""
        lengths = self.ends - self.begins
        counts = np.bincount(groups, weights=lengths) if len(groups) else np.zeros(0)
        return np.rint(counts).astype(np.int64)

    def join(self, *, corners: bool = False) -> tuple[Integers, int]:
        """Return the number of each run's component, and how many components there are."""
        from .kernels.voxels import join_runs

        nx, ny, _ = self.shape
        first = np.searchsorted(self.rows, np.arange(nx * ny + 1))
        result: tuple[Integers, int] = join_runs(first, self.begins, self.ends, ny, corners)
        return result

    def expand(self) -> Integers:
        """Return the index of every voxel, shape (n, 3)."""
        lengths = self.ends - self.begins
        before = np.repeat(np.cumsum(lengths) - lengths, lengths)
        along = np.arange(int(lengths.sum())) - before + np.repeat(self.begins, lengths)
        i, j = self.split_rows()
        return np.stack([np.repeat(i, lengths), np.repeat(j, lengths), along], axis=1)

    def split_rows(self) -> tuple[Integers, Integers]:
        """Return the first and the second index of each run."""
        return self.rows // self.shape[1], self.rows % self.shape[1]

    def paint(self, target: Voxels, values: Integers, shift: ArrayLike = (0, 0, 0)) -> None:
        """Write each run's value into an array whose voxel 0 lies at voxel ``-shift``."""
        from .kernels.voxels import paint_runs

        move = np.asarray(shift, dtype=np.int64)
        values = values.astype(np.int64, copy=False)
        paint_runs(target, self.rows, self.begins, self.ends, values, self.shape[1], move)

    def crop(self, *, turned: bool) -> tuple[Voxels, Integers]:
        """Return the labels with zeros around, and the first voxel of their box."""
        i, j = self.split_rows()
        low = np.array([i.min(), j.min(), self.begins.min()], dtype=np.int64)
        high = np.array([i.max() + 1, j.max() + 1, self.ends.max()], dtype=np.int64)
        shape = tuple(int(length) for length in high - low + 2 * PADDING_VOXELS)
        lumen = np.zeros(shape[::-1] if turned else shape, dtype=np.uint16)
        self.paint(
            lumen.T if turned else lumen, self.labels.astype(np.uint16), PADDING_VOXELS - low
        )
        return lumen, low

    def find_middles(self, groups: Integers) -> NDArray[np.float64]:
        """Return the mean voxel index of each group, shape (n, 3)."""
        lengths = self.ends - self.begins
        total = np.maximum(np.bincount(groups, weights=lengths), 1.0)
        places = (*self.split_rows(), 0.5 * (self.begins + self.ends - 1))
        sums = [np.bincount(groups, weights=lengths * place) / total for place in places]
        return np.stack(sums, axis=1)

    def find_places(self, groups: Integers, axes: Matrix) -> NDArray[np.float64]:
        """Return the voxel of each group that is nearest to the group's middle, in the world."""
        middle = self.find_middles(groups)[groups]
        along = np.clip(np.rint(middle[:, 2]), self.begins, self.ends - 1)
        nearest = np.stack([*self.split_rows(), along], axis=1)
        distance = np.linalg.norm((nearest - middle) @ axes[:3, :3].T, axis=1)
        order = np.lexsort((distance, groups))
        first = np.searchsorted(groups[order], np.arange(groups.max() + 1))
        chosen = nearest[order[np.minimum(first, len(order) - 1)]]
        return np.asarray(chosen @ axes[:3, :3].T + axes[:3, 3])


def drop_axes(array: Voxels) -> Voxels:
    """Return an array without trailing axes of length 1 beyond the third."""
    while array.ndim > 3 and array.shape[-1] == 1:
        array = array[..., 0]
    return array


def _check_volume(given: Voxels, source: str) -> Voxels:
    volume = drop_axes(given)
    if volume.ndim != 3:
        raise InputError(
            f"{source} has {given.ndim} dimensions, shape {given.shape}: a label volume has 3"
        )
    if volume.size == 0:
        raise InputError(f"{source} has shape {given.shape}: it holds no voxels")
    if volume.dtype.kind not in "iubf":
        raise InputError(f"{source} holds {volume.dtype} values: labels are whole numbers")
    return volume


def narrow_volume(given: Voxels, source: str) -> Voxels:
    """Return voxels of labels as uint8 or uint16 in the same order of axes.

    There is no copy if that is possible. Large volumes are checked and converted in pieces: a CT
    may not fit twice in memory.

    Raises
    ------
    InputError
        If they are no labels.
    """
    volume = _check_volume(np.asarray(given), source)
    if volume.dtype.kind == "b":
        return volume.view(np.uint8)
    flat = volume.ravel(order="K")
    if volume.dtype.kind == "f":
        _check_whole(flat, source)
    low, high = float(flat.min()), float(flat.max())
    if low < 0 or high > MAX_LABEL:
        raise InputError(
            f"{source} has voxel values from {low:g} to {high:g}: labels lie in [0, {MAX_LABEL}] "
            f"(this looks like an image, not a label volume; bozzini segment finds the gas in a "
            f"CT image)"
        )
    if volume.dtype.itemsize <= 2 and volume.dtype.kind in "iu" and volume.dtype.isnative:
        return volume.view(f"u{volume.dtype.itemsize}")
    return volume.astype(np.uint8 if high < 256 else np.uint16, order="K")


def _check_whole(values: Voxels, source: str) -> None:
    for begin in range(0, values.size, 1 << 22):
        piece = values[begin : begin + (1 << 22)]
        if not np.isfinite(piece).all():
            raise InputError(f"{source} has voxels that are not finite: labels are whole numbers")
        whole = piece == np.rint(piece)
        if not whole.all():
            raise InputError(
                f"{source} has the voxel value {piece[~whole][0]:g}: labels are whole numbers "
                f"(this looks like an image, not a label volume)"
            )


def check_affine(affine: ArrayLike, source: str) -> Matrix:
    """Return a 4 x 4 affine; `InputError` if it is not finite, singular or sheared."""
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
    if shift <= NOTED_SHIFT_MM:
        return []
    message = (
        f"the voxel axes are not quite at right angles: taken as if they were, which moves the "
        f"wall by up to {ceil_mm(shift)} mm"
    )
    return [Finding("axes-squared", "note", message)]


def find_centres(mask: NDArray[np.bool_], affine: Matrix) -> NDArray[np.float64]:
    """Return the centres (k, 3) of the voxels in a mask, world frame [mm]."""
    return np.asarray(np.argwhere(mask) @ affine[:3, :3].T + affine[:3, 3])


def measure_voxel(affine: Matrix) -> float:
    """Return the volume of a voxel [mm^3]."""
    return abs(float(np.linalg.det(affine[:3, :3])))


def wants_all(labels: Labels) -> bool:
    """Whether labels are ``"all"``, or a sequence of just that."""
    given = [labels] if isinstance(labels, str) else list(labels)
    return len(given) == 1 and str(given[0]).strip().lower() == "all"


def select_labels(
    sizes: Integers,
    labels: Labels | None,
    names: Mapping[int, str],
    source: str,
    voxel: float,
) -> list[int]:
    """Return the numbers of the labels that are asked for, or raise `InputError`.

    `sizes` are the voxels of each label, from label 0; `voxel` is the volume of one [mm^3].
    """
    there = [int(value) for value in np.flatnonzero(sizes)]
    if labels is None:
        if len(there) == 1:
            return there
        raise InputError(
            f"{source} has {len(there)} labels: choose those that are lumen by number or name "
            f"(--labels), or all of them (--labels all): "
            f"{_list_labels(there, sizes, names, voxel)}"
        )
    if wants_all(labels):
        return there
    wanted = _find_labels([labels] if isinstance(labels, str) else labels, there, names, source)
    missing = [value for value in wanted if value not in set(there)]
    if missing:
        word = "label" if len(missing) == 1 else "labels"
        raise InputError(
            f"{source} has no voxel of {word} {', '.join(map(str, missing))}: it has "
            f"{_list_labels(there, sizes, names, voxel)}"
        )
    return wanted


def _list_labels(
    there: Sequence[int], sizes: Integers, names: Mapping[int, str], voxel: float
) -> str:
    """Return number, name and volume of labels: hollow organs first, then the largest."""

    def rank(label: int) -> tuple[bool, int]:
        return not is_digestive(names.get(label, "")), -int(sizes[label])

    shown = sorted(there, key=rank)[:MOST_LISTED]
    shown = sorted(shown, key=lambda label: (rank(label)[0], label))
    text = ", ".join(
        f"{label}{f' {names[label]}' if label in names else ''} "
        f"({show_volume(sizes[label] * voxel)})"
        for label in shown
    )
    more = len(there) - len(shown)
    return f"{text} and {more} more" if more else text


def _find_labels(
    labels: Iterable[int | str], there: Sequence[int], names: Mapping[int, str], source: str
) -> list[int]:
    """Return the numbers of labels given by number or name."""
    wanted: list[int] = []
    for value in labels:
        if isinstance(value, str) and not value.strip().isdecimal():
            wanted += _find_name(value, there, names, source)
            continue
        number = value if isinstance(value, bool) else float(value)
        if isinstance(number, bool) or number != int(number) or not 1 <= number <= MAX_LABEL:
            raise InputError(
                f"label is {value!r}: it must be a name, or a whole number in [1, {MAX_LABEL}]"
            )
        wanted.append(int(number))
    if not wanted:
        raise InputError("no labels were given: name at least one, or 'all'")
    return list(dict.fromkeys(wanted))


def _find_name(name: str, there: Sequence[int], names: Mapping[int, str], source: str) -> list[int]:
    versioned = split_version(name)
    if versioned is not None:
        return [_check_stated(*versioned, there, names, source)]
    text = normalise(name)
    words = match_name(name, [names[label] for label in there if label in names], source)
    if words:
        return [label for label in there if names.get(label) in words]
    known_names = sorted(names[label] for label in there if label in names)
    if known_names:
        shown = sorted(known_names, key=lambda item: not is_digestive(item))[:MOST_LISTED]
        more = len(known_names) - len(shown)
        raise InputError(
            f"{source} has no label named '{name}': it has {', '.join(shown)}"
            f"{f' and {more} more' if more else ''}"
        )
    hint = ""
    if any(text == normalise(word) for word in VERSIONS["totalsegmentator-v2"]):
        hint = (
            f"; for a file of TotalSegmentator give totalsegmentator-v1:{text.replace(' ', '_')} "
            f"or totalsegmentator-v2:{text.replace(' ', '_')}"
        )
    raise InputError(f"label is '{name}', but {source} states no names: give numbers{hint}")


def _check_stated(
    version: str, organ: str, there: Sequence[int], names: Mapping[int, str], source: str
) -> int:
    """Return an organ's number in a version; refuse it where the file's names say otherwise."""
    number = VERSIONS[version][organ]
    stated = names.get(number, "")
    others = [label for label in there if normalise(names.get(label, "")) == normalise(organ)]
    if number not in others and (stated or others):
        says = [f"label {number} is {stated}"] if stated else []
        says += [f"{organ} is label {label}: give {organ}" for label in others]
        raise InputError(
            f"label is '{version}:{organ}', which is {number}, but {source} states that "
            f"{' and '.join(says)}"
        )
    return number


def _check_sides(runs: Runs, axes: Matrix, names: Mapping[int, str], frame: str) -> list[Finding]:
    """Warn where organs with names do not lie to each other as in a patient."""
    middles = runs.find_middles(runs.labels) @ axes[:3, :3].T
    by_name = {
        normalise(name): middles[label]
        for label, name in names.items()
        if label < len(middles) and np.any(runs.labels == label)
    }
    for one, side, two in _ABOVE:
        if one in by_name and two in by_name:
            ahead = float((by_name[one] - by_name[two]) @ find_axis(frame, side))
            if ahead < -10.0:
                word = {"S": "above", "L": "to the patient's left of"}[side]
                message = (
                    f"{one} should lie {word} {two}, but by frame {frame} it lies {-ahead:.0f} mm "
                    f"on the other side: the axes of the file may be wrong, check --frame"
                )
                return [Finding("frame-doubtful", "warning", message)]
    return []


def _check_voxels(matrix: Matrix) -> list[Finding]:
    size = np.linalg.norm(matrix[:3, :3], axis=0)
    found = []
    ratio = size.max() / size.min()
    if ratio > LARGEST_ASPECT:
        raise GeometryError(
            f"voxels of {_join(size)} mm are {ratio:.3g} times longer than wide: at most "
            f"{LARGEST_ASPECT:g} times is read; check the voxel size in the file's header"
        )
    if ratio > NOTED_ASPECT:
        message = (
            f"voxels of {_join(size)} mm are {ratio:.1f} times longer than wide: distances are "
            f"no better than the long side"
        )
        found.append(Finding("voxels-anisotropic", "warning", message))
    if size.max() > COARSE_VOXEL_MM:
        message = f"voxels of {_join(size)} mm are coarse: lumens thinner than two are lost"
        found.append(Finding("voxels-coarse", "warning", message))
    return found


def _check_border(runs: Runs, shape: tuple[int, ...], turned: bool) -> list[Finding]:
    places = (*runs.split_rows(), runs.begins, runs.ends - 1)
    ends = []
    for axis, name in enumerate("ijk"):
        at = 2 - axis if turned else axis
        low, high = (places[2], places[3]) if at == 2 else (places[at], places[at])
        if np.any(low == 0):
            ends.append(f"low {name}")
        if np.any(high == shape[at] - 1):
            ends.append(f"high {name}")
    if not ends:
        return []
    message = f"the lumen reaches the border of the volume ({', '.join(ends)} end): it is cut there"
    return [Finding("lumen-cut", "note", message)]


def _split(
    runs: Runs, axes: Matrix, names: Mapping[int, str], found: list[Finding]
) -> tuple[Runs, tuple[Component, ...]]:
    """Return the runs of the largest component, and the other components, largest first."""
    numbers, count = runs.join()
    if count == 1:
        return runs, ()
    sizes = runs.sum_by(numbers)
    largest = int(sizes.argmax())
    voxel = measure_voxel(axes)
    places = runs.find_places(numbers, axes)
    order = [int(at) for at in np.argsort(-sizes, kind="stable") if at != largest]
    order = order[:MANY_COMPONENTS]
    named: dict[int, list[str]] = {at: [] for at in order}
    for pair in np.unique(numbers * (MAX_LABEL + 1) + runs.labels):
        at, label = divmod(int(pair), MAX_LABEL + 1)
        if at in named:
            named[at].append(describe_label(label, names))
    missed = tuple(
        Component(
            volume=float(sizes[at] * voxel),
            point=to_point(places[at]),
            label_names=tuple(named[at]),
        )
        for at in order
    )
    wide, _ = runs.join(corners=True)
    kept = numbers == largest
    touching = len(np.unique(numbers[(wide == wide[kept][0]) & ~kept]))
    lost = np.setdiff1d(runs.labels, runs.labels[kept])
    found += _describe_split(missed, sizes, voxel, touching)
    if len(lost):
        words = ("label", "lies") if len(lost) == 1 else ("labels", "lie")
        where = "component" if count == 2 else "components"
        message = (
            f"{words[0]} {', '.join(map(str, lost))} {words[1]} wholly in the {where} not reached"
        )
        found.append(Finding("label-dropped", "warning", message))
    return runs.keep(kept), missed


def _describe_split(
    missed: Sequence[Component], sizes: Integers, voxel: float, touching: int
) -> list[Finding]:
    number = len(sizes) - 1
    dropped = int(sizes.sum() - sizes.max())
    shown = "; ".join(
        f"{show_volume(item.volume)} near {_place(item.point)} ({', '.join(item.label_names)})"
        for item in missed[:3]
    )
    message = (
        f"{number + 1} components (voxels joined through faces): the largest is kept, "
        f"{count_noun(number, 'other is', 'others are')} not reached and counted as wall, "
        f"{count_noun(dropped, 'voxel')} ({show_volume(dropped * voxel)}): "
        f"{shown}{' …' if number > 3 else ''}"
    )
    if touching:
        word = "meets" if touching == 1 else "meet"
        message += f"; {touching} of them {word} the lumen along an edge or in a corner only"
    share = dropped / sizes.sum()
    return [Finding("components-dropped", "warning" if share > 0.01 else "note", message)]


def _check_topology(lumen: Voxels, affine: Matrix) -> list[Finding]:
    """Count handles and cavities of one component from its Euler number.

    For voxels joined through faces: Euler number = components - handles + cavities.
    """
    from .kernels.voxels import count_euler

    outside = Runs.find((lumen == 0).view(np.uint8))
    numbers, count = outside.join(corners=True)
    cavities = count - 1
    handles = 1 + cavities - int(count_euler(lumen))
    found = []
    if cavities:
        sizes = outside.sum_by(numbers)
        sizes[numbers[0]] = 0  # the outside begins at the first voxel
        places = outside.find_places(numbers, affine)
        volume = float(sizes.sum()) * measure_voxel(affine)
        message = (
            f"{count_noun(cavities, 'closed cavity', 'closed cavities')} inside the lumen "
            f"({show_volume(volume)}, near {_place(places[int(sizes.argmax())])}): counted as wall"
        )
        found.append(Finding("cavities", "warning", message))
    return found + report_handles(handles)


def _check_hollow(lumen: Voxels, affine: Matrix) -> list[Finding]:
    """Warn of labels that are the wall of a tube: rings in the slices, wide inside and thin.

    Voxels are joined to larger ones until they are few. What the slices across one axis enclose is
    compared with the label: in volume, and by the largest ball in it. Where a solid tube closes a
    ring in its slices, what these enclose is no deeper than the tube is thick.
    """
    from scipy.ndimage import distance_transform_edt, generate_binary_structure, label

    step = math.ceil((lumen.size / HOLLOW_VOXELS) ** (1.0 / 3.0))
    coarse = lumen != 0
    for axis, size in enumerate(lumen.shape):
        coarse = np.bitwise_or.reduceat(coarse, np.arange(0, size, step), axis=axis)
    spacing = step * np.linalg.norm(affine[:3, :3], axis=0)
    for axis in range(3):
        across = generate_binary_structure(3, 1)
        np.moveaxis(across, axis, 0)[[0, 2]] = False
        parts, count = label(~coarse, across)
        outside = np.zeros(count + 1, dtype=bool)
        outside[0] = True  # the label itself
        for side in np.delete(np.arange(3), axis):
            outside[np.take(parts, (0, -1), axis=int(side))] = True
        inner = ~outside[parts]
        ratio = np.count_nonzero(inner) / np.count_nonzero(coarse)
        if ratio < HOLLOW_SHARE:
            continue
        depth = float(distance_transform_edt(inner, sampling=spacing).max())
        depths = distance_transform_edt(coarse, sampling=spacing)[coarse]
        thick = float(np.quantile(depths, HOLLOW_MOST))
        if depth >= HOLLOW_DEPTH * thick:
            message = (
                f"the label is hollow: most of it is less than {2.0 * thick:.1f} mm thick, round a "
                f"space of {2.0 * depth:.1f} mm: a wall, and not the lumen in it? Give the label "
                "of the lumen, or fill it"
            )
            return [Finding("hollow", "warning", message)]
    return []


def _check_inside(
    runs: Runs,
    voxels: Voxels,
    lumen: Voxels,
    corner: Integers,
    axes: Matrix,
    volume: Volume,
) -> list[Finding]:
    """Warn of labels that are not selected and lie inside the lumen: they are wall."""
    from .kernels.voxels import count_faces

    low = np.maximum(corner - 1, 0)
    high = np.minimum(corner + np.array(lumen.shape) - 2 * PADDING_VOXELS + 1, voxels.shape)
    box = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    at = low - corner + PADDING_VOXELS
    inner = tuple(slice(int(a), int(a + b)) for a, b in zip(at, high - low, strict=True))
    outer, touching = count_faces(voxels[box], lumen[inner], int(runs.labels.max()))
    found = []
    for label in np.flatnonzero(touching > ENCLOSED_SHARE * outer):
        part = runs.keep(runs.labels == label)
        place = part.find_places(np.zeros(len(part.rows), dtype=np.int64), axes)[0]
        size = int((part.ends - part.begins).sum()) * measure_voxel(axes)
        message = (
            f"{describe_label(int(label), volume.names)} ({show_volume(size)} near "
            f"{_place(place)}) is not selected and lies inside the lumen: counted as wall"
        )
        found.append(Finding("label-inside", "warning", message))
    return found


def _place(point: Sequence[float] | NDArray[np.float64]) -> str:
    return f"({', '.join(f'{value:.0f}' for value in point)}) mm"


def _join(size: NDArray[np.float64]) -> str:
    return " x ".join(f"{value:.3g}" for value in size)
