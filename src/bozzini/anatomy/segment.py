"""The gas in a CT without labels: a lumen where a scope can go, with its limits stated.

Gas and nothing else is found: a collapsed or fluid-filled stretch is missing, and the wall is
where the image crosses a threshold. This does not replace a segmentation tool.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points, show_apart
from ..errors import GeometryError, InputError
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown
from .frame import find_axis
from .labels import Runs, Volume, Voxels, check_affine, drop_axes, measure_voxel
from .tract import Finding, Point, count_noun, show_volume, to_point

TISSUE_HU = -300.0
"""Above this a voxel is body or table [HU]."""

AIR_HU = -500.0
"""Below this a voxel is gas or lung [HU]."""

LUNG_HU = -930.0
"""A body of air whose median lies above this is lung: its air is mixed with tissue [HU]."""

LUNG_VOLUME_MM3 = 100e3
"""Smallest lung that is whole [mm^3]."""

BASE_VOLUME_MM3 = 1e3
"""Smallest base of a lung that is cut by the upper border of the image [mm^3]."""

TRACHEA_MM = 20.0
"""So far above the lungs the trachea is seen alone, at least [mm]..."""
TRACHEA_AREA_MM2 = (50.0, 800.0)
"""...with an area in this range [mm^2]."""

LUNG_SHARE = 0.25
"""Lungs fill at least this share of the body's outline in some slice..."""
SIDE_SHARE = 0.25
"""...and each side of the trachea has at least this share of them."""

TAGGED_HU = 150.0
"""Fluid above this differs from tissue [HU]."""

MUSCLE_HU = 40.0
"""The wall beside fluid [HU]."""

WALL_SHARE = 0.6
"""Where the wall lies beside fluid: this part of the way from tissue to the fluid's brightness."""

LEVEL_AREA_MM2 = 25.0
"""Smallest level between gas and fluid [mm^2]."""

MIXED_VOXELS = 3
"""Voxels from gas down to fluid, between which the image shows a mixture of both."""

NEAR_MM = 5.0
"""Largest distance of a seed from gas [mm]."""

MOST_SEGMENTS = 200

Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class GasSegment(Shown):
    """One connected body of gas (voxels joined through faces), with its fluid if bridged.

    Attributes
    ----------
    label : int
        Its number in `Segmentation.labels`.
    volume : float
        [mm^3].
    point : tuple of float
        The place inside it that is nearest to its middle, world frame [mm].
    fluid : float
        The part of its volume that is fluid [mm^3].
    at_border : bool
        Whether it reaches the border of the image, where it is cut.
    """

    label: int
    volume: float
    point: Point
    fluid: float
    at_border: bool


@dataclass(frozen=True, kw_only=True)
class Segmentation(Result):
    """What was found in a CT.

    Attributes
    ----------
    labels : ndarray of uint16, shape (nx, ny, nz)
        0 is no gas; the others are the numbers of `segments`, the largest first.
    affine : ndarray, shape (4, 4)
        Voxel index to world [mm].
    segments : tuple of GasSegment
    lungs : float
        Volume that was left out as lung [mm^3].
    threshold : float
        [HU].
    findings : tuple of Finding
        What was left out or could not be done.
    frame : str, optional
        Where the world axes point in the patient.
    source : str
    """

    labels: NDArray[np.uint16]
    affine: NDArray[np.float64]
    segments: tuple[GasSegment, ...]
    lungs: float
    threshold: float
    findings: tuple[Finding, ...]
    frame: str | None
    source: str

    reason = ""
    residual = 0.0

    @property
    def converged(self) -> bool:
        """Whether there is any gas."""
        return bool(self.segments)

    def to_dict(self) -> Json:
        """Return the segments and how they were found, as JSON-able values."""
        return {
            "source": self.source,
            "frame": self.frame,
            "threshold_hu": self.threshold,
            "segments": [
                {
                    "label": item.label,
                    "volume_ml": item.volume / 1000.0,
                    "fluid_ml": item.fluid / 1000.0,
                    "point_mm": list(item.point),
                    "at_border": item.at_border,
                }
                for item in self.segments
            ],
            "lungs_ml": self.lungs / 1000.0,
            "findings": [str(item) for item in self.findings],
        }

    def list_columns(self) -> Json:
        """Return the columns of `to_frame`: one row a segment."""
        rows = self.to_dict()["segments"]
        return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def segment_gas(
    volume: Volume,
    *,
    threshold: float = -800.0,
    smallest: float = 1000.0,
    seeds: ArrayLike | None = None,
    bridge_fluid: bool = False,
    progress: Progress = no_progress,
) -> Segmentation:
    """Find the gas inside the body of a CT.

    The body is the largest piece of tissue, its holes filled slice by slice; air outside of it is
    left out. Air inside that is mixed with tissue (median above -930 HU, a voxel from its wall) is
    lung if it has 100 mL or is cut by the upper border of the image, with the airways that open
    into it. Purer air is lung, too, if it begins as the trachea does and widens to both sides of
    it over a quarter of the body's outline. What is left below the threshold falls into segments,
    one label each.

    The threshold lies below the middle between gas and tissue (about -480 HU): the wall that is
    found is inside the true one by a part of a voxel, about 0.3 of it at -800 HU.

    Parameters
    ----------
    volume : Volume
        A CT in HU; see `bozzini.anatomy.read_volume`.
    threshold : float
        Gas lies below it [HU].
    smallest : float
        Smallest volume of a segment that is kept [mm^3].
    seeds : array_like, shape (n, 3), optional
        Points in the world [mm]: only the segments that hold one, or lie within 5 mm of one, are
        kept.
    bridge_fluid : bool
        Add fluid that lies under a flat level of gas and is brighter than tissue by contrast
        medium (above 150 HU), and join what it connects. Fluid as bright as tissue can not be
        distinguished from the wall, and is not added.
    progress : callable, optional

    Raises
    ------
    InputError
        If the image is not a CT in HU, a value is out of range, or a seed lies at no gas.
    GeometryError
        If there is no body, or no gas in it.
    """
    threshold = check_number("threshold", threshold, low=-1000.0, high=-400.0, unit="HU")
    smallest = check_number("smallest volume", smallest, low=0.0, unit="mm^3")
    image = _check_image(volume)
    affine = check_affine(volume.affine, volume.source)
    voxel = measure_voxel(affine)
    found = list(volume.findings)
    # All work is on the axes in which the voxels lie in memory.
    turned = image.flags.f_contiguous and not image.flags.c_contiguous
    axes = affine[:, [2, 1, 0, 3]] if turned else affine
    ct = np.ascontiguousarray(image.T if turned else image)
    upward, leftward = (_find_voxel_axis(volume.frame, side, axes) for side in "SL")
    if not upward[1]:
        upward = (0 if turned else 2, 0)
    progress("body", 0.0)
    body = _find_body(ct, upward[0], volume.source, progress)
    progress("gas", 0.0)
    lungs = _find_lungs(ct, body, axes, upward, leftward, found)
    gas = body & (ct < threshold) & ~lungs
    fluid = np.zeros(gas.shape if bridge_fluid else (0, 0, 0), dtype=bool)
    if bridge_fluid:
        fluid = _find_fluid(ct, gas, body, np.linalg.norm(axes[:3, :3], axis=0), found)
        gas |= fluid
    progress("gas", 0.7)
    runs = Runs.find(gas.view(np.uint8))
    if len(runs.rows) == 0:
        raise GeometryError(
            f"{volume.source} has no gas below {threshold:g} HU inside the body, lungs left out"
        )
    numbers, _ = runs.join()
    sizes = runs.sum_by(numbers)
    if seeds is None:
        wanted = np.flatnonzero(sizes * voxel >= smallest)
    else:
        wanted = _find_seeded(runs, numbers, axes, seeds)
    if len(wanted) == 0:
        raise GeometryError(
            f"{volume.source} has no gas of {smallest / 1000.0:g} mL or more inside the body: the "
            f"largest has {show_volume(sizes.max() * voxel)}"
        )
    wanted = wanted[np.argsort(-sizes[wanted], kind="stable")][:MOST_SEGMENTS]
    left = int(sizes.sum() - sizes[wanted].sum())
    if left:
        message = (
            f"{show_volume(left * voxel)} of gas in {len(sizes) - len(wanted)} other segments "
            f"left out"
        )
        found.append(Finding("gas-left-out", "note", message))
    label = np.zeros(len(sizes), dtype=np.uint16)
    label[wanted] = np.arange(1, len(wanted) + 1)
    labels = np.zeros(image.shape, dtype=np.uint16)
    target = labels.T if turned else labels
    runs.paint(target, label[numbers].astype(np.int64))
    wet = np.bincount(target[fluid] if bridge_fluid else [], minlength=len(wanted) + 1)
    progress("gas", 1.0)
    return Segmentation(
        labels=labels,
        affine=affine,
        segments=_describe_segments(runs, numbers, wanted, axes, wet),
        lungs=float(np.count_nonzero(lungs)) * voxel,
        threshold=threshold,
        findings=tuple(found),
        frame=volume.frame,
        source=volume.source,
    )


def _check_image(volume: Volume) -> Voxels:
    image = drop_axes(volume.array)
    if image.ndim != 3 or image.dtype.kind not in "iuf":
        raise InputError(f"{volume.source} is not a CT image: {image.dtype}, shape {image.shape}")
    low, high = float(image.min()), float(image.max())
    if not (np.isfinite((low, high)).all() and low < -800.0 and high > -100.0):
        raise InputError(
            f"{volume.source} has values from {low:g} to {high:g}: a CT in HU has air (-1000) and "
            f"tissue (above -100)"
        )
    return image


def _label(mask: Mask) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the number of each voxel's component (faces), and how large each is."""
    runs = Runs.find(mask.view(np.uint8))
    numbers, count = runs.join()
    result = np.zeros(mask.shape, dtype=np.int32)
    runs.paint(result, numbers + 1)
    sizes = np.zeros(count + 1, dtype=np.int64)
    if count:
        sizes[1:] = runs.sum_by(numbers)
    return result, sizes


def _find_body(ct: Voxels, slices: int, source: str, progress: Progress) -> Mask:
    """Return the largest piece of tissue, its holes filled in every slice.

    It is looked for with a voxel eroded, so that a table that touches it is not taken for it.
    """
    from scipy import ndimage

    tissue = ct > TISSUE_HU
    core = tissue.copy()
    for one, other in _list_neighbours(tissue, core):
        np.logical_and(other, one, out=other)
    numbers, sizes = _label(core)
    if len(sizes) < 2:
        raise GeometryError(f"{source} has no tissue above {TISSUE_HU:g} HU")
    np.equal(numbers, int(sizes.argmax()), out=core)
    del numbers
    body: Mask = core.copy()
    for one, other in _list_neighbours(core, body):
        np.logical_or(other, one, out=other)
    body &= tissue
    view = np.moveaxis(body, slices, 0)
    for at in range(len(view)):
        empty, count = ndimage.label(~view[at])
        edges = (empty[0], empty[-1], empty[:, 0], empty[:, -1])
        outside = np.zeros(count + 1, dtype=bool)
        outside[np.concatenate(edges)] = True
        outside[0] = False
        view[at] = ~outside[empty]
        progress("body", (at + 1) / len(view))
    return body


def _list_neighbours(mask: Mask, other: Mask) -> Iterator[tuple[Mask, Mask]]:
    """Give views of two masks, shifted by a voxel in each of the six directions."""
    for axis in range(3):
        low: list[slice] = [slice(None)] * 3
        high = low.copy()
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        yield mask[tuple(low)], other[tuple(high)]
        yield mask[tuple(high)], other[tuple(low)]


def _find_voxel_axis(frame: str | None, side: str, axes: NDArray[np.float64]) -> tuple[int, int]:
    """Return the axis of voxels that runs towards a side of the patient, and its sign.

    The sign is 0, and the axis is none, if the frame is not known.
    """
    if frame is None:
        return (-1, 0)
    along = find_axis(frame, side) @ axes[:3, :3] / np.linalg.norm(axes[:3, :3], axis=0)
    axis = int(np.abs(along).argmax())
    return axis, 1 if along[axis] > 0.0 else -1


def _find_lungs(
    ct: Voxels,
    body: Mask,
    axes: NDArray[np.float64],
    upward: tuple[int, int],
    leftward: tuple[int, int],
    found: list[Finding],
) -> Mask:
    """Return the lungs, whole or cut; `upward` is the axis of the slices and which end is up."""
    from scipy import ndimage

    voxel = measure_voxel(axes)
    air = body & (ct < AIR_HU)
    core = air.copy()
    for one, other in _list_neighbours(air, core):
        np.logical_and(other, one, out=other)
    numbers, sizes = _label(air)
    large = np.flatnonzero(sizes * voxel >= BASE_VOLUME_MM3)
    renumbered = np.zeros(len(sizes), dtype=numbers.dtype)
    renumbered[large] = np.arange(1, len(large) + 1)
    np.take(renumbered, numbers, out=numbers)
    lungs = np.zeros(ct.shape, dtype=bool)
    cut, cut_volume = 0, 0.0
    slices, sign = upward
    ends = {1: (ct.shape[slices],), -1: (0,), 0: (0, ct.shape[slices])}[sign]
    for number, box in enumerate(ndimage.find_objects(numbers), start=1):
        volume = sizes[large[number - 1]] * voxel
        part = numbers[box] == number
        inner = part & core[box]
        mixed = float(np.median(ct[box][inner if inner.any() else part])) > LUNG_HU
        at_end = any(end in (box[slices].start, box[slices].stop) for end in ends)
        whole = volume >= LUNG_VOLUME_MM3
        if mixed and (whole or at_end):
            lungs[box] |= part
            if not whole:
                cut, cut_volume = cut + 1, cut_volume + volume
        elif whole and sign:
            outline = tuple(box[k] if k == slices else slice(None) for k in range(3))
            if _has_trachea(part, body[outline], axes, upward, leftward):
                lungs[box] |= part
    if cut:
        message = (
            f"{count_noun(cut, 'piece')} of air ({show_volume(cut_volume)}), mixed with tissue and "
            f"cut by the upper border of the image, taken as base of a lung"
        )
        found.append(Finding("lung-cut", "note", message))
    return lungs


def _has_trachea(
    part: Mask,
    body: Mask,
    axes: NDArray[np.float64],
    upward: tuple[int, int],
    leftward: tuple[int, int],
) -> bool:
    """Whether air begins at its upper end as a trachea, and widens below to both its sides.

    `part` is the air in its box, `body` the whole body in the same slices.
    """
    from scipy import ndimage

    spacing = np.linalg.norm(axes[:3, :3], axis=0)
    slices = upward[0]
    down, tissue = (_turn(mask, slices, -upward[1]) for mask in (part, body))
    face = measure_voxel(axes) / spacing[slices]
    top = down[: int(np.ceil(TRACHEA_MM / spacing[slices]))]
    if len(down) <= len(top) or any(ndimage.label(each)[1] != 1 for each in top):
        return False
    areas = face * np.count_nonzero(down, axis=(1, 2))
    low, high = TRACHEA_AREA_MM2
    if not (areas[1 : len(top)] >= low).all() or areas[: len(top)].max() > high:
        return False
    share = areas / np.maximum(face * np.count_nonzero(tissue, axis=(1, 2)), face)
    widest = int(share.argmax())
    across = leftward[0] - (leftward[0] > slices)  # among the axes of a slice
    middle = np.argwhere(top[-1])[:, across].mean()
    beside = float(np.mean(np.argwhere(down[widest])[:, across] < middle))
    return bool(share[widest] >= LUNG_SHARE and SIDE_SHARE <= beside <= 1.0 - SIDE_SHARE)


def _find_fluid(
    ct: Voxels,
    gas: Mask,
    body: Mask,
    spacing: NDArray[np.float64],
    found: list[Finding],
) -> Mask:
    """Return bright fluid that lies under flat levels of gas, with the layer between.

    Down is the direction, of the six along the axes, with the largest such levels. Fluid grows
    from a level through voxels lower than it that are nearer to its own brightness than to tissue.
    """
    bright = body & (ct > TAGGED_HU)
    fluid = np.zeros(gas.shape, dtype=bool)
    best: tuple[float, int, int, list[NDArray[np.int64]]] = (0.0, 0, 1, [])
    places = np.argwhere(gas)
    for axis in range(3):
        face = float(np.prod(np.delete(spacing, axis)))
        for sign in (1, -1):
            levels = _find_levels(gas, bright, places, axis, sign, face)
            total = face * sum(len(level) for level in levels)
            if total > best[0]:
                best = (total, axis, sign, levels)
    total, axis, sign, levels = best
    if not levels:
        message = (
            f"no level of gas over fluid brighter than {TAGGED_HU:g} HU was found: nothing is "
            f"bridged (fluid without contrast medium cannot be distinguished from the wall)"
        )
        found.append(Finding("fluid-none", "warning", message))
        return fluid
    target, inside = _turn(fluid, axis, sign), _turn(body, axis, sign)
    image, below = _turn(ct, axis, sign), _turn(bright, axis, sign)
    for level in levels:
        i, j, k = level.T
        deep = np.stack([below[i + step, j, k] for step in range(1, MIXED_VOXELS + 1)])
        first = deep.argmax(axis=0) + 1
        for step in range(1, MIXED_VOXELS):
            between = step < first
            target[i[between] + step, j[between], k[between]] = True
        top = int(i.min()) + 1
        own = float(np.median(image[i + MIXED_VOXELS, j, k]))
        cut = max(TAGGED_HU, MUSCLE_HU + WALL_SHARE * (own - MUSCLE_HU))
        numbers, _ = _label(np.ascontiguousarray(inside[top:] & (image[top:] > cut)))
        seeds = numbers[i + MIXED_VOXELS - top, j, k]
        target[top:] |= np.isin(numbers, np.setdiff1d(seeds, 0))
    what = count_noun(len(levels), "level")
    message = f"{what} of {total:.0f} mm^2 between gas and bright fluid bridged"
    found.append(Finding("fluid-bridged", "note", message))
    return fluid


def _turn(array: Voxels, axis: int, sign: int) -> Voxels:
    """Return a view in which down is along the first axis."""
    return np.moveaxis(array, axis, 0)[::sign]


def _find_levels(
    gas: Mask, bright: Mask, places: NDArray[np.int64], axis: int, sign: int, face: float
) -> list[NDArray[np.int64]]:
    """Return the voxels of gas above each flat level, in the axes of `_turn`."""
    size = gas.shape[axis]
    height = places[:, axis] if sign > 0 else size - 1 - places[:, axis]
    bottom = places[height < size - MIXED_VOXELS]
    step = np.zeros(3, dtype=np.int64)
    step[axis] = sign
    bottom = bottom[~gas[tuple((bottom + step).T)]]
    wet = np.zeros(len(bottom), dtype=bool)
    for depth in range(1, MIXED_VOXELS + 1):
        wet |= bright[tuple((bottom + depth * step).T)]
    if not wet.any():
        return []
    over = np.zeros(gas.shape, dtype=bool)
    over[tuple(bottom[wet].T)] = True
    runs = Runs.find(over.view(np.uint8))
    numbers, count = runs.join(corners=True)
    voxels, numbers = runs.expand(), np.repeat(numbers, runs.ends - runs.begins)
    voxels = np.concatenate([voxels[:, axis : axis + 1], np.delete(voxels, axis, axis=1)], axis=1)
    if sign < 0:
        voxels[:, 0] = size - 1 - voxels[:, 0]
    high, low = np.full(count, -1), np.full(count, size)
    np.maximum.at(high, numbers, voxels[:, 0])
    np.minimum.at(low, numbers, voxels[:, 0])
    flat = (high - low <= 1) & (np.bincount(numbers) * face >= LEVEL_AREA_MM2)
    return [voxels[numbers == at] for at in np.flatnonzero(flat)]


def _find_seeded(
    runs: Runs, numbers: NDArray[np.int64], axes: NDArray[np.float64], seeds: ArrayLike
) -> NDArray[np.int64]:
    """Return the components nearest to points, each within `NEAR_MM`."""
    points = np.atleast_2d(check_points("seeds", seeds))
    places = np.linalg.solve(axes[:3, :3], (points - axes[:3, 3]).T).T
    i, j = runs.split_rows()
    wanted = []
    for point, place in zip(points, places, strict=True):
        along = np.clip(np.rint(place[2]), runs.begins, runs.ends - 1)
        nearest = np.stack([i, j, along], axis=1)
        distance = np.linalg.norm((nearest - place) @ axes[:3, :3].T, axis=1)
        at = int(distance.argmin())
        if distance[at] > NEAR_MM:
            text = ", ".join(f"{value:g}" for value in point)
            shown = show_apart(distance[at], NEAR_MM, digits=3)
            raise InputError(
                f"seed ({text}) mm lies {shown[0]} mm from the nearest gas that is not "
                f"lung: it must lie within {shown[1]} mm"
            )
        wanted.append(int(numbers[at]))
    return np.unique(wanted)


def _describe_segments(
    runs: Runs,
    numbers: NDArray[np.int64],
    chosen: NDArray[np.int64],
    axes: NDArray[np.float64],
    fluid: NDArray[np.int64],
) -> tuple[GasSegment, ...]:
    """Return the segments; `fluid` holds the number of voxels of fluid of each label."""
    voxel = measure_voxel(axes)
    sizes = runs.sum_by(numbers)
    places = runs.find_places(numbers, axes)
    i, j = runs.split_rows()
    edges = (i == 0) | (i == runs.shape[0] - 1) | (j == 0) | (j == runs.shape[1] - 1)
    edges |= (runs.begins == 0) | (runs.ends == runs.shape[2])
    cut = np.zeros(len(sizes), dtype=bool)
    cut[numbers[edges]] = True
    return tuple(
        GasSegment(
            label=label,
            volume=float(sizes[at]) * voxel,
            point=to_point(places[at]),
            fluid=float(fluid[label]) * voxel,
            at_border=bool(cut[at]),
        )
        for label, at in enumerate(chosen, start=1)
    )
