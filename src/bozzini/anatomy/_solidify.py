"""From several sheets or parts to one lumen: voxels about whose centres the sheets wind."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from . import _mesh
from ._mesh import Faces, Integers, Mask, SurfaceSheet, Vertices
from .kernels.meshes import add_windings
from .labels import tract_from_labels
from .tract import (
    Component,
    Finding,
    LabelTract,
    Opening,
    count_noun,
    name_place,
    show_volume,
    to_point,
)

# Open surfaces: which sheets bound the lumen, which are the other side of its wall.

LEAST_VOLUME = 0.01
"""Smallest volume of a sheet, by the largest one's, that can bound a part of the lumen."""

LEAST_DEPTH = 2e-3
"""Smallest volume of such a sheet by its area to the power 1.5: a plate encloses nothing."""

NESTED_SHARE = 0.5
"""Share of a sheet's corners inside another from which it is the inner side of a wall."""

ALIKE_SHARE = 0.1
"""Largest difference of area and of volume of two copies of one sheet."""


class SheetChoice(NamedTuple):
    """What the sheets of an open surface are.

    Attributes
    ----------
    kept : list of SurfaceSheet
        Those that bound the lumen, turned outwards.
    outer : list of SurfaceSheet
        The outer side of the wall.
    copies : list of SurfaceSheet
        Second copies of sheets kept.
    others : list of SurfaceSheet
        Too small or too flat to bound a part of the lumen: obstacles.
    """

    kept: list[SurfaceSheet]
    outer: list[SurfaceSheet]
    copies: list[SurfaceSheet]
    others: list[SurfaceSheet]


def choose_sheets(points: Vertices, faces: Faces) -> SheetChoice:
    """Split a surface where more than two triangles meet, and find what each sheet is.

    The wall of a published organ is often a pair of sheets, the outer one turned outwards and the
    inner one turned inwards. Where such pairs are found, the inner sheets bound the lumen; else all
    do but those that have another one inside.
    """
    pieces = _mesh.split_by(faces, _mesh.label_sheets(faces))
    sheets = [SurfaceSheet.find(points, piece) for piece in pieces]
    largest = max(abs(sheet.volume) for sheet in sheets)
    main = [sheet for sheet in sheets if _can_bound(sheet, largest)]
    others = [sheet for sheet in sheets if not _can_bound(sheet, largest)]
    main, copies = _drop_copies(points, main)
    encloses = _find_nested(points, main)
    outwards = np.array([sheet.volume > 0.0 for sheet in main], dtype=bool)
    # In pairs of sheets those that turn inwards bound the lumen.
    paired = (encloses & outwards[:, None] & ~outwards).any()
    bounds = np.atleast_1d(~outwards if paired else ~encloses.any(axis=1))
    kept = [main[k].turn_outwards() for k in np.flatnonzero(bounds)]
    outer = [main[k] for k in np.flatnonzero(~bounds)]
    return SheetChoice(kept=kept, outer=outer, copies=copies, others=others)


def _can_bound(sheet: SurfaceSheet, largest: float) -> bool:
    size = abs(sheet.volume)
    return size > LEAST_VOLUME * largest and size > LEAST_DEPTH * sheet.area**1.5


def _drop_copies(
    points: Vertices, sheets: list[SurfaceSheet]
) -> tuple[list[SurfaceSheet], list[SurfaceSheet]]:
    """Take the smaller of two sheets that lie on each other and turn the same way."""
    from scipy.spatial import cKDTree

    kept: list[SurfaceSheet] = []
    copies: list[SurfaceSheet] = []
    for sheet in sorted(sheets, key=lambda sheet: abs(sheet.volume)):
        own = points[np.unique(sheet.faces)]
        sides = np.diff(points[sheet.faces[:, :2]], axis=1)
        reach = float(np.median(np.linalg.norm(sides, axis=2)))
        copy = False
        for other in kept:
            if (
                other.volume * sheet.volume > 0.0
                and abs(sheet.area - other.area) < ALIKE_SHARE * sheet.area
                and abs(sheet.volume - other.volume) < ALIKE_SHARE * abs(sheet.volume)
            ):
                theirs = points[np.unique(other.faces)]
                there, _ = cKDTree(theirs).query(own)
                back, _ = cKDTree(own).query(theirs)
                copy |= max(np.quantile(there, 0.95), np.quantile(back, 0.95)) < reach
        (copies if copy else kept).append(sheet)
    return kept, copies


def _find_nested(points: Vertices, sheets: list[SurfaceSheet]) -> Mask:
    """Return whether sheet j, closed, encloses sheet k, shape (n, n)."""
    nested = np.zeros((len(sheets), len(sheets)), dtype=bool)
    for j, one in enumerate(sheets):
        corners, solid = one.close(points)
        low, high = corners[solid].min(axis=(0, 1)), corners[solid].max(axis=(0, 1))
        for k, other in enumerate(sheets):
            places = points[np.unique(other.faces)]
            boxed = places[((places >= low) & (places <= high)).all(axis=1)]
            if (
                j == k
                or len(boxed) < NESTED_SHARE * len(places)
                or abs(other.volume) > abs(one.volume)
            ):
                continue
            inside = np.abs(_mesh.wind(corners, solid, boxed)) > 0.5
            nested[j, k] = np.count_nonzero(inside) > NESTED_SHARE * len(places)
    return nested


VOXEL_MM = 1.0
"""Voxel of a solidified surface [mm], smaller for a small one."""

FEWEST_VOXELS = 200
"""Voxels along the longest side, at least."""

MOST_VOXELS = 30_000_000
"""Voxels of the box around it, at most."""

PADDING_VOXELS = 3
OPENING_SHARE = 0.15
"""Radius of a hole, by twice the volume over the area, from which it is an open end."""

AMBIGUOUS_SHARE = 0.2
"""Largest share of the lumen about which the triangles alone wind neither 0 nor 1."""

ASKED_VOXELS = 20_000
"""Voxels about which the winding number of the triangles alone is asked."""

DEEP_VOXELS = 1.0
"""Depth in the lumen from which a triangle counts as inside it [voxels]."""

FINEST_PIECES = 200
"""Pieces into which the side of a triangle is cut to look for its depth, at most."""

COARSE_VOXELS = 3
"""Voxels in which missing lumen is looked for, by those of the lumen."""


class _Grid:
    """Voxels around a surface, and about which of their centres closed triangles wind."""

    def __init__(self, points: Vertices, faces: Faces, voxel: float | None = None) -> None:
        low, high = points[faces].min(axis=(0, 1)), points[faces].max(axis=(0, 1))
        size = high - low
        wanted = min(VOXEL_MM, float(size.max()) / FEWEST_VOXELS) if voxel is None else voxel
        self.voxel = max(
            wanted, float(np.prod(np.maximum(size, wanted)) / MOST_VOXELS) ** (1.0 / 3.0)
        )
        # Not on the whole millimetres on which corners often lie.
        self.low = low - (PADDING_VOXELS + 0.2887) * self.voxel
        self.shape = tuple(int(n) for n in np.ceil(size / self.voxel) + 2 * PADDING_VOXELS + 1)

    def wind(self, points: Vertices, faces: Faces) -> Mask:
        """Return where closed triangles, all together, wind at least once."""
        steps = np.zeros(self.shape, dtype=np.int16)
        add_windings(np.ascontiguousarray(points[faces]), self.low, self.voxel, steps)
        np.cumsum(steps, axis=2, out=steps)
        return steps > 0

    def place(self, index: Integers) -> Vertices:
        return np.asarray(self.low + self.voxel * index, dtype=np.float64)

    def find(self, places: Vertices) -> tuple[Integers, ...]:
        index = np.rint((places - self.low) / self.voxel).astype(np.int64)
        return tuple(np.clip(index, 0, np.array(self.shape) - 1).T)


def measure_width(points: Vertices, faces: Faces, holes: list[_mesh.Hole]) -> float:
    """Return twice the volume over the area [mm]: the radius of a long tube."""
    volume = abs(_mesh.measure_volume(*_mesh.close_holes(points, faces, holes)))
    return 2.0 * volume / max(_mesh.measure_area(points, faces), 1e-300)


def find_openings(
    holes: Sequence[_mesh.Hole], width: float
) -> tuple[tuple[Opening, ...], list[_mesh.Hole]]:
    """Split holes into open ends, the largest first, and small ones for the surface's width."""
    ends = [hole for hole in holes if hole.radius >= OPENING_SHARE * width]
    small = [hole for hole in holes if hole.radius < OPENING_SHARE * width]
    openings = tuple(
        Opening(point=to_point(hole.point), radius=hole.radius, name=f"opening {k}")
        for k, hole in enumerate(ends, start=1)
    )
    return openings, small


def solidify(
    points: Vertices,
    choice: SheetChoice,
    *,
    source: str,
    found: list[Finding],
    names: Sequence[str] = (),
) -> LabelTract:
    """Unite sheets into one lumen of voxels.

    Parameters
    ----------
    points : (n, 3) float
        World [mm].
    choice : SheetChoice
        The sheets, open ends included: these are capped flat.
    source : str
    found : list of Finding
        What was found before.
    names : sequence of str
        Of the sheets kept, where they are parts of a scene: each becomes a label.

    Raises
    ------
    GeometryError
        If inside is ambiguous for more than a fifth of the lumen, with where.
    """
    found = list(found)
    kept = np.concatenate([sheet.faces for sheet in choice.kept])
    holes = _mesh.find_holes(points, kept)
    corners, closed = _mesh.close_holes(points, kept, holes)
    grid = _Grid(corners, closed)
    lumen = grid.wind(corners, closed)
    ends = [hole for hole in holes if not _leads_inside(points, hole, lumen, grid)]
    openings, small = find_openings(ends, measure_width(points, kept, holes))
    if not lumen.any():
        raise GeometryError(
            f"{source} encloses no volume that a voxel of {grid.voxel:.2g} mm shows"
        )
    if holes:
        found += _check_ambiguous(points, kept, lumen, grid, source)
    found += report_holes(openings, small)
    lumen = _carve(points, choice, lumen, grid, found)
    missing, lacks = find_missing(points, choice.outer, kept)
    found += lacks
    volume = lumen.astype(np.uint16)
    if len(names) > 1:
        for k, sheet in reversed(list(enumerate(choice.kept))):
            volume[grid.wind(*sheet.close(points)) & lumen] = k + 1
    affine = np.diag([grid.voxel, grid.voxel, grid.voxel, 1.0])
    affine[:3, 3] = grid.low
    tract = tract_from_labels(volume, affine, source=source, findings=found)
    sheets = np.concatenate((kept, *(sheet.faces for sheet in choice.copies)))
    caps = closed[len(kept) :]
    off = _measure_deviation(corners, sheets, caps, tract)
    message = (
        f"{count_noun(len(choice.kept), 'sheet')} united to one lumen of voxels of "
        f"{grid.voxel:.2g} mm: its wall is within {off.shares[0]:.2f} mm (95 %), "
        f"{off.shares[1]:.2f} mm (99 %) and {off.farthest:.1f} mm (all) of the triangles, farthest "
        f"near {name_place(off.place)} mm, {'on a flat cap' if off.at_cap else 'where sheets meet'}"
    )
    found = [*tract.findings, Finding("sheets-solidified", "warning", message)]
    return replace(
        tract,
        findings=tuple(found),
        openings=openings,
        # One label stands for the whole lumen here: it is no name of a part.
        not_reached=tuple(
            part if len(names) > 1 else replace(part, label_names=()) for part in tract.not_reached
        ),
        missing=missing,
        label_names={k + 1: name for k, name in enumerate(names) if k + 1 in tract.label_values},
        wall=f"faces of voxels of {grid.voxel:.2g} mm of the solidified surface",
        wall_error=float(0.5 * np.sqrt(3.0) * grid.voxel + off.shares[1]),
    )


def _leads_inside(points: Vertices, hole: _mesh.Hole, lumen: Mask, grid: _Grid) -> bool:
    """Return whether lumen goes on beyond the cap of a hole, in another sheet."""
    start, end = points[hole.edges[:, 0]], points[hole.edges[:, 1]]
    outward = np.cross(start - hole.point, end - hole.point).sum(axis=0)
    size = float(np.linalg.norm(outward))
    if size == 0.0:
        return False
    beyond = hole.point + max(2.0 * grid.voxel, hole.deviation) * outward / size
    return bool(lumen[grid.find(beyond[None])][0])


def report_holes(openings: Sequence[Opening], small: Sequence[_mesh.Hole]) -> list[Finding]:
    """Return findings on open ends that were capped and on holes that were filled."""
    found = []
    if openings:
        where = ", ".join(
            f"{o.name} of radius {o.radius:.1f} mm near {name_place(o.point)}" for o in openings[:6]
        )
        more = f" and {len(openings) - 6} more" if len(openings) > 6 else ""
        found.append(Finding("ends-capped", "warning", f"open ends capped flat: {where}{more} mm"))
    if small:
        message = (
            f"{len(small)} small hole(s) filled, the largest near {name_place(small[0].point)} mm"
        )
        found.append(Finding("holes-filled", "warning", message))
    return found


def _check_ambiguous(
    points: Vertices, kept: Faces, lumen: Mask, grid: _Grid, source: str
) -> list[Finding]:
    """Find how often the triangles without caps wind about places in the lumen."""
    index = np.flatnonzero(lumen)
    index = index[:: max(1, len(index) // ASKED_VOXELS)]
    places = grid.place(np.stack(np.unravel_index(index, lumen.shape), axis=1))
    winding = _mesh.wind(points, kept, places)
    unclear = np.abs(winding - np.rint(winding)) > 0.3
    unclear |= winding < 0.3
    share = float(unclear.mean())
    if share == 0.0:
        return []
    where = name_place(np.median(places[unclear], axis=0))
    if share > AMBIGUOUS_SHARE:
        raise GeometryError(
            f"{source} is open: what is inside is ambiguous for {100 * share:.0f} % of what its "
            f"flat caps enclose, near {where} mm; close it first"
        )
    message = (
        f"inside is ambiguous for {100 * share:.1f} % of the lumen, at open ends near {where} mm"
    )
    return [Finding("inside-ambiguous", "warning", message)]


def _carve(
    points: Vertices, choice: SheetChoice, lumen: Mask, grid: _Grid, found: list[Finding]
) -> Mask:
    """Take out of the lumen each voxel that a small part fills or another sheet touches."""
    obstacles = [sheet.faces for sheet in choice.others]
    obstacles += [
        sheet.faces[_find_deep(points, sheet.faces, lumen, grid)] for sheet in choice.outer
    ]
    before = int(lumen.sum())
    for sheet in choice.others:
        if sheet.volume:
            side = 1 if sheet.volume > 0.0 else -1
            corners, closed = sheet.close(points)
            lumen &= ~grid.wind(corners, closed[:, ::side])
    for faces in obstacles:
        if len(faces):
            _carve_touched(points, faces, lumen, grid)
    used = [faces for faces in obstacles if len(faces)]
    lost = before - int(lumen.sum())
    if used and lost:
        number = sum(len(faces) for faces in used)
        place = points[np.concatenate(used)].mean(axis=(0, 1))
        message = (
            f"{number} triangles of small parts or of outer sheets stand in the lumen, near "
            f"{name_place(place)} mm: the {lost} voxels that they touch or fill are wall"
        )
        found.append(Finding("pieces-inside", "warning", message))
    within = [
        sheet.faces[_find_deep(points, sheet.faces, lumen, grid)]
        for sheet in (*choice.kept, *choice.copies)
    ]
    inner = np.concatenate(within)
    if len(inner):
        message = (
            f"{len(inner)} triangles lie inside the lumen where sheets overlap, near "
            f"{name_place(points[inner].mean(axis=(0, 1)))} mm: they are no wall of the union"
        )
        found.append(Finding("sheets-overlap", "warning", message))
    return lumen


def _find_deep(points: Vertices, faces: Faces, lumen: Mask, grid: _Grid) -> Mask:
    """Return which triangles reach deeper into the lumen than `DEEP_VOXELS` voxels."""
    corners = points[faces]
    deep = np.zeros(len(faces), dtype=bool)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.clip(np.ceil(sides / grid.voxel), 1, FINEST_PIECES).astype(np.int64)
    for number in np.unique(parts):
        some = np.flatnonzero(parts == number)
        a, b = np.mgrid[0 : number + 1, 0 : number + 1].reshape(2, -1)
        a, b = a[a + b <= number] / number, b[a + b <= number] / number
        weights = np.stack((a, b, 1.0 - a - b), axis=1)
        for begin in range(0, len(some), 1 + 1_000_000 // len(weights)):
            chosen = some[begin : begin + 1 + 1_000_000 // len(weights)]
            places = (weights @ corners[chosen]).reshape(-1, 3)
            hits = lumen[grid.find(places)]
            for way in itertools.product((-DEEP_VOXELS, 0.0, DEEP_VOXELS), repeat=3):
                hits[hits] = lumen[grid.find(places[hits] + grid.voxel * np.array(way))]
            deep[chosen] = hits.reshape(len(chosen), -1).any(axis=1)
    return deep


def _carve_touched(points: Vertices, faces: Faces, lumen: Mask, grid: _Grid) -> None:
    """Take out each voxel whose centre is within half a voxel's diagonal of triangles."""
    reach = 0.5 * np.sqrt(3.0) * grid.voxel
    low = grid.find(points[faces].min(axis=(0, 1))[None] - 2.0 * grid.voxel)
    high = grid.find(points[faces].max(axis=(0, 1))[None] + 2.0 * grid.voxel)
    box = tuple(slice(int(a[0]), int(b[0]) + 1) for a, b in zip(low, high, strict=True))
    index = np.argwhere(lumen[box]) + np.array([part.start for part in box])
    if not len(index):
        return
    distance, _ = _mesh.find_nearest(points, faces, grid.place(index))
    lumen[tuple(index[distance <= reach].T)] = False


def find_missing(
    points: Vertices, outer: Sequence[SurfaceSheet], kept: Faces
) -> tuple[tuple[Component, ...], list[Finding]]:
    """Find where an outer sheet encloses a place that no inner one does, and report it."""
    from scipy import ndimage
    from scipy.spatial import cKDTree

    if not outer:
        return (), []
    faces = np.concatenate((kept, *(sheet.faces for sheet in outer)))
    grid = _Grid(points, faces, COARSE_VOXELS * _Grid(points, kept).voxel)
    step = grid.voxel
    corners, closed = _mesh.close_holes(points, kept, _mesh.find_holes(points, kept))
    inside = grid.wind(corners, closed)
    enclosed = np.zeros_like(inside)
    for sheet in outer:
        corners, closed = sheet.close(points)
        enclosed |= grid.wind(corners, closed if sheet.volume > 0.0 else closed[:, ::-1])
    theirs = points[np.unique(np.concatenate([sheet.faces for sheet in outer]))]
    thick, _ = cKDTree(theirs).query(points[np.unique(kept)])
    away = ndimage.distance_transform_edt(~inside, sampling=step)
    lacking = enclosed & (away > 2.0 * np.quantile(thick, 0.95) + step)
    label, number = ndimage.label(lacking)
    if not number:
        return (), []
    sizes = np.bincount(label.reshape(-1))[1:] * step**3
    largest = int(sizes.argmax())
    if sizes[largest] < 0.005 * float(inside.sum()) * step**3:
        return (), []
    place = grid.place(np.argwhere(label == largest + 1)).mean(axis=0)
    message = (
        f"only an outer sheet is there round {show_volume(sizes.sum())}, the most near "
        f"{name_place(place)} mm: that lumen is missing"
    )
    part = Component(volume=float(sizes.sum()), point=to_point(place))
    return (part,), [Finding("lumen-missing", "warning", message)]


class _Deviation(NamedTuple):
    """How far the faces of voxels are from triangles.

    Attributes
    ----------
    shares : (2,) float
        95 % and 99 % of the distances to the triangles and caps [mm].
    farthest : float
        The largest distance to the triangles alone [mm].
    place : (3,) float
        Where that is.
    at_cap : bool
        Whether a cap is nearer there than any triangle.
    """

    shares: NDArray[np.float64]
    farthest: float
    place: NDArray[np.float64]
    at_cap: bool


def _measure_deviation(
    points: Vertices, faces: Faces, caps: Faces, tract: LabelTract
) -> _Deviation:
    places = []
    for axis in range(3):
        index = np.argwhere(np.diff(tract.mask, axis=axis)).astype(np.float64)
        index[:, axis] += 0.5
        places.append(index)
    middles = np.concatenate(places) @ tract.affine[:3, :3].T + tract.affine[:3, 3]
    distance, nearest = _mesh.find_nearest(points, np.concatenate((faces, caps)), middles)
    shares = np.quantile(distance, (0.95, 0.99))
    at_cap = nearest >= len(faces)
    if at_cap.any():
        distance[at_cap] = _mesh.find_nearest(points, faces, middles[at_cap])[0]
    most = int(distance.argmax())
    return _Deviation(shares, float(distance[most]), middles[most], bool(at_cap[most]))
