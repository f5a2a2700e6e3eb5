"""From loose triangles to a checked tract: closed, one lumen, turned outwards."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..checks import ceil_mm
from ..errors import GeometryError
from . import _mesh
from ._mesh import Faces, Integers, Vertices
from ._nesting import PartSet, resolve_parts
from ._solidify import (
    SheetChoice,
    choose_sheets,
    find_missing,
    find_openings,
    measure_width,
    report_holes,
    solidify,
)
from .tract import (
    Component,
    Finding,
    LabelTract,
    Opening,
    SurfaceTract,
    check_mesh,
    check_scale,
    count_noun,
    name_place,
    report_handles,
)

FLAT_SHARE = 1e-6
"""Smallest side of the box around a surface, by its longest, that is not flat."""

HOLLOW_SHARE = 1e-9
"""Smallest volume, by the cube of the longest side, that is not zero."""

WELD_SHARE = 1e-5
"""Distance, by the longest side, within which the corners of an open surface are welded."""

REPAIR_WELD_SHARE = 1e-3
"""The same with `repair`."""

SAME_SHARE = 1e-7
"""Differences of two surfaces, by their size, that are none but of rounding."""

MOST_OPEN_SHARE = 0.3
"""Largest area of the holes of an open sheet, by its own, that are ends to be capped."""

MOST_DEVIATION = 0.5
"""Farthest of a hole's border from a plane, by the hole's radius, that is capped unasked."""

LEAST_ROUND = 0.4
"""Smallest circumference of the circle of a hole's area, by the length of the hole's border."""


def tract_from_surface(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    source: str = "array",
    findings: Iterable[Finding] = (),
    repair: bool = False,
) -> SurfaceTract | LabelTract:
    """Check the wall of a lumen, mend what is small, and report what was done.

    In this order: equal corners are welded; flat and doubled triangles are dropped; a surface
    still open is welded within 1e-5 of its size and its holes of three or four edges are filled.

    - A closed part: the largest is kept, or where a second sheet follows it on the inside (an
      organ's wall with thickness) that inner sheet. Whatever stands in the lumen, cuts the wall or
      touches it stays as wall; only parts wholly outside are left out.
    - One open sheet: its ends are capped flat and become `openings`.
    - Several open sheets, in pairs or one behind the other: those that bound the lumen are united
      to a `LabelTract` of voxels, and a finding states how far its wall is from the triangles.

    Faces are turned to agree, outwards, those of bodies in the lumen into them. Then handles,
    places where the surface touches itself (an edge of more than two triangles, a corner that joins
    two sheets) and triangles that cross (those that share no corner) are counted.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        World [mm].
    faces : array_like of int, shape (m, 3)
    source : str
        Where it came from, for reports and messages.
    findings : iterable of Finding
        What was found before, to be kept.
    repair : bool
        Also weld corners within 1e-3 of the size where that closes edges, fill small and ragged
        holes, and split the corners where the surface touches itself.

    Raises
    ------
    InputError
        If a vertex is not finite, or a face points nowhere; if a closed part that lies along the
        inside of another may be a body in its lumen as well as the inner side of its wall.
    GeometryError
        If the surface is flat, encloses no volume, or is open so that it is not certain what is
        inside; the message names the place.
    """
    points, triangles = check_mesh(vertices, faces, source)
    found = list(findings)
    points, triangles = _mesh.weld(points, triangles)
    triangles = _drop_bad(triangles, found)
    if len(triangles) == 0:
        raise GeometryError(f"{source} encloses no volume: all its triangles are flat")
    extent = np.ptp(points[triangles].reshape(-1, 3), axis=0)
    if extent.min() <= FLAT_SHARE * extent.max():
        sides = " x ".join(f"{side:.3g}" for side in extent)
        raise GeometryError(f"{source} encloses no volume: it is flat, {sides} mm")
    if _count_open(triangles):
        points, triangles = _close(points, triangles, float(extent.max()), found, repair=repair)
    part = _mesh.label_parts(triangles, len(points))
    pieces = _mesh.split_by(triangles, part)
    wall = 0
    if len(pieces) > 1:
        wall = int(np.argmax([_mesh.measure_sheets(points, piece) for piece in pieces]))
    openings: tuple[Opening, ...] = ()
    missing: tuple[Component, ...] = ()
    if (_mesh.count_edges(pieces[wall]).counts % 2 == 1).any():
        choice = choose_sheets(points, triangles)
        if not choice.kept:
            raise GeometryError(f"{source} is open and encloses no volume")
        if len(choice.kept) > 1:
            return solidify(points, choice, source=source, found=found)
        points, triangles, part, openings, missing = _cap_sheet(
            points, choice, source, found, repair
        )
        wall = 0
    parts = resolve_parts(PartSet(points, triangles, part), wall, found)
    points, triangles = parts.points, _orient(parts.points, parts.wall, found)
    size = float(np.ptp(points[triangles].reshape(-1, 3), axis=0).max())
    if abs(_mesh.measure_volume(points, triangles)) <= HOLLOW_SHARE * size**3:
        raise GeometryError(f"{source} encloses no volume: its two sides lie on each other")
    triangles = np.concatenate((triangles, parts.bodies))
    found += _check_topology(points, triangles)
    found += _check_crossing(points, triangles)
    voxels = _mesh.find_voxels(points[np.unique(triangles)])
    half = None if voxels is None else 0.5 * float(np.linalg.norm(voxels))
    if voxels is not None:
        sides = " x ".join(f"{step:.3g}" for step in voxels)
        message = (
            "the corners lie on the edges of a grid, as marching cubes leave them: the surface "
            f"was made from voxels of {sides} mm, of which half a diagonal is {half:.2f} mm"
        )
        found.append(Finding("voxel-surface", "note", message))
    found += check_scale(size, hint="give the file's own unit, for example --unit m or --unit cm")
    # Each triangle of a sheet both ways: it bounds, and winds about nothing.
    sheets = np.concatenate((parts.sheets, parts.sheets[:, ::-1]))
    if repair:
        points, triangles, sheets = _split_corners(points, triangles, sheets, found)
    triangles = np.concatenate((triangles, sheets))
    wall_text = "triangles of the file, open ends capped flat" if openings else ""
    made = SurfaceTract(
        vertices=points,
        faces=triangles,
        source=source,
        findings=tuple(found),
        openings=openings,
        not_reached=parts.apart,
        missing=missing,
        wall=wall_text,
        source_error=half,
    )
    if repair:
        return replace(made, findings=(*found, *_compare_unrepaired(made, vertices, faces)))
    return made


def _compare_unrepaired(
    made: SurfaceTract, vertices: ArrayLike, faces: ArrayLike
) -> tuple[Finding, ...]:
    """Return a warning on what `repair` made of a surface that is also read without it."""
    try:
        plain = tract_from_surface(vertices, faces, source=made.source)
    except GeometryError:  # refused without: what was mended stands in its own findings
        return ()
    changes = []
    if isinstance(plain, SurfaceTract):
        for name, before, after in (
            ("corners", len(plain.vertices), len(made.vertices)),
            ("triangles", len(plain.faces), len(made.faces)),
        ):
            if before != after:
                changes.append(f"{before} {name} became {after}")
        farthest = max(_measure_distance(made, plain), _measure_distance(plain, made))
        if farthest > SAME_SHARE * float(np.ptp(plain.vertices, axis=0).max()):
            changes.append(f"the wall moved by up to {ceil_mm(farthest)} mm")
    else:
        changes.append("it is voxels without, and a surface with")
    if abs(made.volume - plain.volume) > SAME_SHARE * plain.volume:
        volumes = [tract.volume / 1000.0 for tract in (plain, made)]
        changes.append("the volume of {:.6g} mL became {:.6g} mL".format(*volumes))
    if not changes:
        return ()
    message = f"repair changed a surface that is read without it too: {', '.join(changes)}"
    return (Finding("repaired", "warning", message),)


def _measure_distance(one: SurfaceTract, other: SurfaceTract) -> float:
    """Return how far a corner of one surface lies from the other at most [mm]."""
    import igl

    boxes = igl.AABB()
    boxes.init(other.vertices, other.faces)
    squared = boxes.squared_distance(other.vertices, other.faces, one.vertices)[0]
    return float(np.sqrt(np.max(squared)))


def unite_parts(
    parts: Sequence[tuple[str, Vertices, Faces]],
    obstacles: Sequence[tuple[str, Vertices, Faces]] = (),
    *,
    source: str = "array",
    findings: Iterable[Finding] = (),
) -> LabelTract:
    """Unite closed or open parts that touch or overlap to one lumen of voxels, a label each.

    Parameters
    ----------
    parts : sequence of (str, (n, 3) float, (m, 3) int)
        Name, corners [mm] and triangles.
    obstacles : sequence of the same
        What is wall where it stands in the lumen.
    source, findings
        As for `tract_from_surface`.

    Raises
    ------
    InputError
        If a vertex is not finite, or a face points nowhere.
    GeometryError
        If a part encloses nothing, or inside is ambiguous.
    """
    found = list(findings)
    welded: list[tuple[Vertices, Faces]] = []
    start = 0
    for name, vertices, faces in (*parts, *obstacles):
        points, triangles = check_mesh(vertices, faces, f"{source}, part '{name}'")
        points, triangles = _mesh.weld(points, triangles)
        welded.append((points, _drop_bad(triangles, found) + start))
        start += len(points)
    corners = np.concatenate([points for points, _ in welded])
    names: list[str] = []
    union = SheetChoice([], [], [], [])
    for (name, _, _), (_, triangles) in zip(parts, welded, strict=False):
        choice = (
            choose_sheets(corners, triangles) if len(triangles) else SheetChoice([], [], [], [])
        )
        if not choice.kept:
            raise GeometryError(f"{source}, part '{name}' encloses no volume: it is flat")
        names += [name] * len(choice.kept)
        union = SheetChoice(*(one + more for one, more in zip(union, choice, strict=True)))
    for _, triangles in welded[len(parts) :]:
        if len(triangles):
            for sheets in choose_sheets(corners, triangles):
                union.others.extend(sheets)
    return solidify(corners, union, source=source, found=found, names=names)


def _cap_sheet(
    points: Vertices, choice: SheetChoice, source: str, found: list[Finding], repair: bool
) -> tuple[Vertices, Faces, Integers, tuple[Opening, ...], tuple[Component, ...]]:
    """Cap the one sheet that bounds the lumen; the other sheets become parts beside it."""
    sheet = choice.kept[0]
    width = measure_width(points, sheet.faces, sheet.holes)
    openings, small = find_openings(sheet.holes, width)
    area = sum(math.pi * hole.radius**2 for hole in sheet.holes)
    bad = [hole for hole in sheet.holes if not _is_flat(hole)]
    number = sum(len(hole.edges) for hole in sheet.holes)
    holes = count_noun(len(sheet.holes), "hole")
    what = f"{source} is open: {number} boundary edges in {holes}"
    if area > MOST_OPEN_SHARE * sheet.area:
        hole = sheet.holes[0]
        raise GeometryError(
            f"{what}, near {name_place(hole.point)} mm, of {100 * area / sheet.area:.0f} % of its "
            f"area: what is inside is ambiguous; close it first"
        )
    if (small or bad) and not repair:
        hole = (bad or small)[0]
        kind = "a small one" if not bad else "one whose border is not flat"
        raise GeometryError(
            f"{what}, {kind} near {name_place(hole.point)} mm; close it first, or give --repair to "
            f"cap it"
        )
    corners, closed = sheet.close(points)
    caps = np.arange(len(closed)) >= len(sheet.faces)
    crossed = _mesh.find_crossing(corners, closed, caps.astype(np.int64))
    if (crossed & caps).any():
        place = corners[closed[int(np.argmax(crossed & caps))]].mean(axis=0)
        raise GeometryError(
            f"{what}; a flat cap would cross the surface near {name_place(place)} mm: close it "
            f"there first"
        )
    found += report_holes(openings, small)
    missing, lacks = find_missing(points, choice.outer, sheet.faces)
    found += lacks
    others = [s.faces for s in (*choice.outer, *choice.copies, *choice.others)]
    part = np.repeat(np.arange(1 + len(others)), [len(closed), *(len(faces) for faces in others)])
    return corners, np.concatenate((closed, *others)), part, openings, missing


def _is_flat(hole: _mesh.Hole) -> bool:
    return (
        hole.deviation <= MOST_DEVIATION * hole.radius
        and hole.radius * 2.0 * math.pi >= LEAST_ROUND * hole.length
    )


def _drop_bad(triangles: Faces, found: list[Finding]) -> Faces:
    kept = _mesh.drop_degenerate(triangles)
    number = len(triangles) - len(kept)
    if number:
        message = f"{number} flat or doubled triangle(s) dropped"
        found.append(Finding("faces-dropped", "note", message))
    return kept


def _close(
    points: Vertices, triangles: Faces, size: float, found: list[Finding], *, repair: bool
) -> tuple[Vertices, Faces]:
    """Weld nearly equal corners, then fill holes of three or four edges."""
    for share in (WELD_SHARE, REPAIR_WELD_SHARE) if repair else (WELD_SHARE,):
        edges = _find_open(triangles)
        before = len(edges)
        if not before:
            break
        # By its size alone a surface with one corner far away would be welded to nothing.
        sides = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        tolerance = min(share * size, 0.5 * float(np.median(sides)))
        # The rest of the surface stays as it is.
        welded, kept = _mesh.weld(points, triangles, tolerance=tolerance, among=np.unique(edges))
        moved = np.linalg.norm(welded[kept] - points[triangles], axis=2)
        kept = _mesh.drop_degenerate(kept)
        if len(kept) and _count_open(kept) < before:
            place = points[edges].mean(axis=(0, 1))
            points, triangles, after = welded, kept, _count_open(kept)
            message = (
                f"corners within {tolerance:.2g} mm welded, near {name_place(place)} mm: "
                f"{before - after} open edges closed, corners moved by up to {moved.max():.2g} mm"
            )
            found.append(Finding("corners-welded", "note", message))
    if _count_open(triangles):
        whole, filled = _mesh.fill_small_holes(points, triangles)
        if filled:
            triangles = whole
            message = (
                f"small holes filled: {sum(len(hole.edges) for hole in filled)} open edges closed, "
                f"near {name_place(filled[0].point)} mm"
            )
            found.append(Finding("holes-filled", "warning", message))
    return points, triangles


def _find_open(triangles: Faces) -> Integers:
    edges = _mesh.count_edges(triangles)
    return np.asarray(edges.pairs[edges.counts == 1])


def _count_open(triangles: Faces) -> int:
    return len(_find_open(triangles))


def _orient(points: Vertices, triangles: Faces, found: list[Finding]) -> Faces:
    turned, number = _mesh.agree(triangles)
    if number:
        place = name_place(points[triangles[(turned != triangles).any(axis=1)][0]].mean(axis=0))
        message = f"{number} triangle(s) turned to agree with their neighbours, one near {place} mm"
        found.append(Finding("faces-turned", "note", message))
    outwards = _mesh.turn_outwards(points, turned, np.zeros(len(turned), dtype=np.int64))
    changed = (outwards != turned).any(axis=1)
    if changed.any() and not (changed.all() and number):
        what, which = "the surface was", "all its triangles"
        if not changed.all():
            what, which = "a sheet that touches the rest was", f"{int(changed.sum())} triangles"
        message = f"{what} turned inside out: {which} are turned outwards"
        found.append(Finding("surface-turned", "note", message))
    return np.ascontiguousarray(outwards)


def _check_topology(points: Vertices, triangles: Faces) -> list[Finding]:
    found = []
    edges = _mesh.count_edges(triangles)
    touching = int(np.count_nonzero(edges.counts > 2))
    fan, sheet = _mesh.label_fans(triangles)
    corner, joints = _find_joints(triangles, fan)
    corners = len(np.unique(triangles))
    if touching or len(joints):
        message = (
            f"the surface touches itself: {touching} edge(s) of more than two triangles, "
            f"{len(corner) - corners} corner(s) that join separate sheets, near "
            f"{name_place(points[joints[0]])} mm"
        )
        found.append(Finding("self-touching", "warning", message))
    # Taken apart where it touches itself, an edge of 2k triangles is k edges, a corner its fans.
    euler = len(corner) - int((edges.counts // 2).sum()) + len(triangles)
    return found + report_handles(int(sheet.max()) + 1 - euler // 2)


def _find_joints(triangles: Faces, fan: Faces) -> tuple[Integers, Integers]:
    """Return the vertex of each fan, and the vertices of several fans."""
    corner = np.zeros(int(fan.max()) + 1, dtype=np.int64)
    corner[fan] = triangles
    return corner, np.flatnonzero(np.bincount(corner) > 1)


def _split_corners(
    points: Vertices, triangles: Faces, sheets: Faces, found: list[Finding]
) -> tuple[Vertices, Faces, Faces]:
    """Give each fan of triangles a corner of its own: sheets that touch are then apart."""
    fan, _ = _mesh.label_fans(triangles)
    corner, joints = _find_joints(triangles, fan)
    if len(joints) == 0:
        return points, triangles, sheets
    message = (
        f"{len(joints)} corner(s) where the surface touches itself split, near "
        f"{name_place(points[joints[0]])} mm: each sheet has its own, the wall is where it was"
    )
    found.append(Finding("corners-split", "note", message))
    used, index = np.unique(sheets, return_inverse=True)
    sheets = index.reshape(-1, 3).astype(np.int64) + len(corner)
    return np.concatenate((points[corner], points[used])), fan, sheets


def _check_crossing(points: Vertices, triangles: Faces) -> list[Finding]:
    crossed = _mesh.find_crossing(points, triangles)
    number = int(np.count_nonzero(crossed))
    if not number:
        return []
    place = points[triangles[int(np.argmax(crossed))]].mean(axis=0)
    message = (
        f"the surface crosses itself: {number} triangles (only those that share no corner are "
        f"tested), near {name_place(place)} mm; inside and outside are not certain there"
    )
    return [Finding("self-crossing", "warning", message)]
