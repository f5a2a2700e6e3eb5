"""Open surfaces: which sheets bound the lumen, which are the other side of its wall."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import _mesh

__all__ = ["Choice", "Sheet", "choose_sheets", "close_sheet"]

LEAST_VOLUME = 0.01
"""Smallest volume of a sheet, by the largest one's, that can bound a part of the lumen."""

LEAST_DEPTH = 2e-3
"""Smallest volume of such a sheet by its area to the power 1.5: a plate encloses nothing."""

NESTED = 0.5
"""Share of a sheet's corners inside another from which it is the inner side of a wall."""

ALIKE = 0.1
"""Largest difference of area and of volume of two copies of one sheet."""

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Triangles that agree in their turn, joined by edges that have no third triangle.

    Attributes
    ----------
    faces : (m, 3) int
    holes : list of Hole
        Where it is open.
    volume : float
        With flat caps, positive where the triangles turn outwards [mm^3].
    area : float
        Without caps [mm^2].
    """

    faces: Faces
    holes: list[_mesh.Hole]
    volume: float
    area: float

    def move(self, start: int) -> Sheet:
        """Return the same with corners numbered from `start`."""
        holes = [hole._replace(edges=hole.edges + start) for hole in self.holes]
        return replace(self, faces=self.faces + start, holes=holes)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What the sheets of an open surface are.

    Attributes
    ----------
    kept : list of Sheet
        Those that bound the lumen, turned outwards.
    outer : list of Sheet
        The outer side of the wall.
    copies : list of Sheet
        Second copies of sheets kept.
    others : list of Sheet
        Too small or too flat to bound a part of the lumen: obstacles.
    """

    kept: list[Sheet]
    outer: list[Sheet]
    copies: list[Sheet]
    others: list[Sheet]

    def move(self, start: int) -> Choice:
        """Return the same with corners numbered from `start`."""
        kept, outer, copies, others = (
            [sheet.move(start) for sheet in sheets]
            for sheets in (self.kept, self.outer, self.copies, self.others)
        )
        return Choice(kept=kept, outer=outer, copies=copies, others=others)


def close_sheet(points: Vertices, faces: Faces, holes: list[_mesh.Hole]) -> tuple[Vertices, Faces]:
    """Close holes by triangles from their border to its middle."""
    middles = [hole.point for hole in holes]
    caps = [
        np.column_stack((hole.edges, np.full(len(hole.edges), len(points) + k)))
        for k, hole in enumerate(holes)
    ]
    if not holes:
        return points, faces
    return np.concatenate((points, middles)), np.concatenate((faces, *caps)).astype(np.int64)


def choose_sheets(points: Vertices, faces: Faces) -> Choice:
    """Split a surface where more than two triangles meet, and say what each sheet is.

    The wall of a published organ is often a pair of sheets, the outer one turned outwards and the
    inner one turned inwards. Where such pairs are found, the inner sheets bound the lumen; else all
    do but those that have another one inside.
    """
    number, label = _mesh.label_sheets(faces)
    order = np.argsort(label, kind="stable")
    pieces = np.split(faces[order], np.cumsum(np.bincount(label, minlength=number))[:-1])
    sheets = [_measure_sheet(points, piece) for piece in pieces]
    largest = max(abs(sheet.volume) for sheet in sheets)
    main = [sheet for sheet in sheets if _can_bound(sheet, largest)]
    others = [sheet for sheet in sheets if not _can_bound(sheet, largest)]
    main, copies = _drop_copies(points, main)
    encloses = _find_nested(points, main)
    inner = [
        k
        for k, sheet in enumerate(main)
        if sheet.volume < 0.0
        and any(encloses[j, k] and main[j].volume > 0.0 for j in range(len(main)))
    ]
    if inner:  # pairs of sheets: those that turn inwards bound the lumen
        kept = [sheet for sheet in main if sheet.volume < 0.0]
        outer = [sheet for sheet in main if sheet.volume > 0.0]
    else:
        kept = [sheet for k, sheet in enumerate(main) if not encloses[k].any()]
        outer = [sheet for k, sheet in enumerate(main) if encloses[k].any()]
    return Choice(
        kept=[_turn_outwards(sheet) for sheet in kept], outer=outer, copies=copies, others=others
    )


def _measure_sheet(points: Vertices, faces: Faces) -> Sheet:
    turned, _ = _mesh.agree(faces, len(points))
    holes = _mesh.find_holes(points, turned)
    volume = _mesh.measure_volume(*close_sheet(points, turned, holes))
    corners = points[turned]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * float(np.linalg.norm(normals, axis=1).sum())
    return Sheet(faces=turned, holes=holes, volume=volume, area=area)


def _can_bound(sheet: Sheet, largest: float) -> bool:
    size = abs(sheet.volume)
    return size > LEAST_VOLUME * largest and size > LEAST_DEPTH * sheet.area**1.5


def _turn_outwards(sheet: Sheet) -> Sheet:
    if sheet.volume >= 0.0:
        return sheet
    holes = [hole._replace(edges=hole.edges[:, ::-1]) for hole in sheet.holes]
    faces = np.ascontiguousarray(sheet.faces[:, ::-1])
    return Sheet(faces=faces, holes=holes, volume=-sheet.volume, area=sheet.area)


def _drop_copies(points: Vertices, sheets: list[Sheet]) -> tuple[list[Sheet], list[Sheet]]:
    """Take the smaller of two sheets that lie on each other and turn the same way."""
    from scipy.spatial import cKDTree

    kept: list[Sheet] = []
    copies: list[Sheet] = []
    for sheet in sorted(sheets, key=lambda sheet: abs(sheet.volume)):
        own = points[np.unique(sheet.faces)]
        reach = float(
            np.median(np.linalg.norm(np.diff(points[sheet.faces[:, :2]], axis=1), axis=2))
        )
        copy = False
        for other in kept:
            if (
                other.volume * sheet.volume > 0.0
                and abs(sheet.area - other.area) < ALIKE * sheet.area
                and abs(sheet.volume - other.volume) < ALIKE * abs(sheet.volume)
            ):
                theirs = points[np.unique(other.faces)]
                there, _ = cKDTree(theirs).query(own)
                back, _ = cKDTree(own).query(theirs)
                copy |= max(np.quantile(there, 0.95), np.quantile(back, 0.95)) < reach
        (copies if copy else kept).append(sheet)
    return kept, copies


def _find_nested(points: Vertices, sheets: list[Sheet]) -> NDArray[np.bool_]:
    """Say whether sheet j, closed, encloses sheet k, shape (n, n)."""
    import igl

    nested = np.zeros((len(sheets), len(sheets)), dtype=bool)
    for j, one in enumerate(sheets):
        corners, solid = close_sheet(points, one.faces, one.holes)
        low, high = corners[solid].min(axis=(0, 1)), corners[solid].max(axis=(0, 1))
        for k, other in enumerate(sheets):
            places = points[np.unique(other.faces)]
            boxed = places[((places >= low) & (places <= high)).all(axis=1)]
            if j == k or len(boxed) < NESTED * len(places) or abs(other.volume) > abs(one.volume):
                continue
            winding = igl.fast_winding_number(
                np.ascontiguousarray(corners), np.ascontiguousarray(solid), boxed
            )
            nested[j, k] = np.count_nonzero(np.abs(winding) > 0.5) > NESTED * len(places)
    return nested
