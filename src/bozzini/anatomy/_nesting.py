"""Closed parts of a surface inside one another: an organ's wall with thickness, or bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import _mesh
from .findings import Finding

__all__ = ["resolve_parts"]

FOLLOWS_VOLUME = 0.3
"""Share of the outer sheet's volume from which an inner one is taken for the inside of a wall."""

FOLLOWS_LENGTH = 0.8
THIN_VOLUME = 0.05
"""The same for a thick wall around a narrow lumen: of the longest side, and of the volume."""

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


def resolve_parts(
    points: Vertices, triangles: Faces, found: list[Finding]
) -> tuple[Vertices, Faces, Faces]:
    """Choose the part that is the wall of the lumen, and the bodies that stand inside it.

    The part of the largest volume is taken. A closed part wholly inside it is never passed over:

    - one that follows it (at least 30 % of its volume; or 80 % of its longest side and 5 % of its
      volume) is the inner side of a wall with thickness, and becomes the wall of the lumen;
    - others are bodies in the lumen.

    Where two parts side by side both follow, neither is taken for the inner side of a wall.

    Returns
    -------
    points : (n, 3) float
        The corners in use [mm].
    wall : (m, 3) int
    bodies : (k, 3) int
        Turned inwards, so that the winding number inside them is 0.
    """
    part = _mesh.label_parts(triangles, len(points))
    number = int(part.max()) + 1
    bodies = triangles[:0]
    if number > 1:
        volume = np.abs(_mesh.measure_part_volumes(points, triangles, part, number))
        wall, inside = _find_wall(points, triangles, part, volume, found)
        is_body = _find_closed(triangles, part, number) & inside
        _report(part, volume, wall, inside, is_body, found)
        bodies = _turn_inwards(points, triangles[is_body[part]])
        triangles = triangles[part == wall]
    used, index = np.unique(np.concatenate((triangles, bodies)), return_inverse=True)
    index = index.reshape(-1, 3).astype(np.int64)
    return points[used], index[: len(triangles)], index[len(triangles) :]


def _find_wall(
    points: Vertices,
    triangles: Faces,
    part: NDArray[np.int64],
    volume: NDArray[np.float64],
    found: list[Finding],
) -> tuple[int, NDArray[np.bool_]]:
    """Go inwards from the largest part as long as one sheet follows the other."""
    closed = _find_closed(triangles, part, len(volume))
    order = np.argsort(part, kind="stable")
    first = np.searchsorted(part[order], np.arange(len(volume)))
    corners = points[triangles[order]]
    sides = np.maximum.reduceat(corners.max(axis=1), first) - np.minimum.reduceat(
        corners.min(axis=1), first
    )
    wall = int(volume.argmax())
    while True:
        inside = _find_inside(points, triangles, part, wall, closed)
        axis = int(sides[wall].argmax())
        follows = (volume >= FOLLOWS_VOLUME * volume[wall]) | (
            (volume >= THIN_VOLUME * volume[wall])
            & (sides[:, axis] >= FOLLOWS_LENGTH * sides[wall, axis])
        )
        sheets = np.flatnonzero(inside & closed & follows)
        if len(sheets) == 0:
            return wall, inside
        inner = int(sheets[volume[sheets].argmax()])
        deeper = _find_inside(points, triangles, part, inner, closed)
        if not deeper[sheets[sheets != inner]].all():
            return wall, inside
        message = (
            f"a closed sheet of {volume[inner] / 1000.0:.3g} mL lies inside one of "
            f"{volume[wall] / 1000.0:.3g} mL: taken for a wall with thickness, the lumen is inside "
            f"the inner sheet; if it is not, give the surface of the lumen alone"
        )
        found.append(Finding("wall-with-thickness", "warning", message))
        wall = inner


def _find_closed(triangles: Faces, part: NDArray[np.int64], number: int) -> NDArray[np.bool_]:
    """Say which parts have an even number of triangles at every edge, shape (number,)."""
    edges = _mesh.count_edges(triangles)
    of_corner = np.zeros(int(triangles.max()) + 1, dtype=np.int64)
    of_corner[triangles] = part[:, None]
    closed = np.ones(number, dtype=bool)
    closed[of_corner[edges.pairs[edges.counts % 2 == 1, 0]]] = False
    return closed


def _find_inside(
    points: Vertices,
    triangles: Faces,
    part: NDArray[np.int64],
    wall: int,
    closed: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Say which parts lie with all their corners inside one closed part, by winding number."""
    import igl

    number = len(closed)
    inside = np.zeros(number, dtype=bool)
    if not closed[wall]:
        return inside
    of_corner = np.full(len(points), -1, dtype=np.int64)
    of_corner[triangles] = part[:, None]
    sheet, _ = _mesh.agree(triangles[part == wall], len(points))
    low, high = points[sheet].min(axis=(0, 1)), points[sheet].max(axis=(0, 1))
    in_box = ((points >= low) & (points <= high)).all(axis=1)
    tested = np.flatnonzero((of_corner >= 0) & (of_corner != wall) & in_box)
    if len(tested) == 0:
        return inside
    winding = np.abs(
        igl.fast_winding_number(
            np.ascontiguousarray(points),
            np.ascontiguousarray(sheet),
            np.ascontiguousarray(points[tested]),
        )
    )
    hits = np.bincount(of_corner[tested[winding > 0.5]], minlength=number)
    corners = np.bincount(of_corner[of_corner >= 0], minlength=number)
    inside = hits == corners
    inside[wall] = False
    return np.asarray(inside)


def _turn_inwards(points: Vertices, bodies: Faces) -> Faces:
    if len(bodies) == 0:
        return bodies
    bodies, _ = _mesh.agree(bodies, len(points))
    part = _mesh.label_parts(bodies, len(points))
    volume = _mesh.measure_part_volumes(points, bodies, part, int(part.max()) + 1)
    outwards = (volume > 0.0)[part]
    return np.where(outwards[:, None], bodies[:, ::-1], bodies)


def _report(
    part: NDArray[np.int64],
    volume: NDArray[np.float64],
    wall: int,
    inside: NDArray[np.bool_],
    is_body: NDArray[np.bool_],
    found: list[Finding],
) -> None:
    number, bodies = len(volume), int(is_body.sum())
    if bodies:
        what = "1 closed part lies" if bodies == 1 else f"{bodies} closed parts lie"
        taken = "a body" if bodies == 1 else "bodies"
        message = (
            f"{what} inside the lumen ({volume[is_body].sum() / 1000.0:.3g} mL): taken for {taken} "
            f"the scope cannot pass"
        )
        found.append(Finding("bodies-inside", "warning", message))
    loose = int((inside & ~is_body).sum())
    if loose:
        what = "1 open piece lies" if loose == 1 else f"{loose} open pieces lie"
        message = f"{what} inside the lumen: not closed, so left out; the scope may cross there"
        found.append(Finding("open-pieces-inside", "warning", message))
    dropped = ~is_body
    dropped[wall] = False
    count = int(dropped.sum())
    if not count:
        return
    lost = float(volume[dropped].sum())
    message = (
        f"{number} components: the {'largest' if wall == volume.argmax() else 'one inside'} "
        f"({volume[wall] / 1000.0:.3g} mL) is kept, {count} {'other' if count == 1 else 'others'} "
        f"with {int(dropped[part].sum())} triangles and {lost / 1000.0:.3g} mL dropped"
    )
    severity = "warning" if lost > 0.01 * max(float(volume.sum()), 1e-300) else "note"
    found.append(Finding("components-dropped", severity, message))
