"""Parts of a surface: which is the wall of the lumen, and which stand in its way."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from . import _mesh
from .kernels.meshes import cross_groups
from .tract import Component, Finding, name_place

__all__ = ["Parts", "find_touching", "resolve_parts"]

FOLLOWS_VOLUME = 0.3
"""Share of the outer sheet's volume from which an inner one is taken for the inside of a wall."""

FOLLOWS_LENGTH = 0.8
THIN_VOLUME = 0.05
"""The same for a thick wall around a narrow lumen: of the longest side, and of the volume."""

FOLLOWS_RATIO = 2.0
"""Largest thickness of such a wall, by its smallest."""

MOST_APART = 100
"""Closed parts left out that are listed."""

TOUCHING = 1e-6
"""Distance, by the size of the surface, below which a part touches the wall."""

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


class Parts(NamedTuple):
    """The wall of the lumen and what else bounds it.

    Attributes
    ----------
    points : (n, 3) float
        The corners in use [mm].
    wall : (m, 3) int
        The closed part that is the wall.
    bodies : (k, 3) int
        Closed parts apart from each other inside it, turned inwards: the winding number is 0 there.
    sheets : (l, 3) int
        What else touches the lumen, each triangle once.
    apart : tuple of Component
        Closed parts that are left out, the largest first.
    """

    points: Vertices
    wall: Faces
    bodies: Faces
    sheets: Faces
    apart: tuple[Component, ...] = ()


def resolve_parts(
    points: Vertices,
    triangles: Faces,
    found: list[Finding],
    *,
    part: NDArray[np.int64] | None = None,
    wall: int | None = None,
) -> Parts:
    """Choose the part that is the wall of the lumen, and keep all that stands in the lumen.

    The part of the largest volume is taken, if `wall` does not say which. A closed part wholly
    inside it is never passed over:

    - one that follows it (at least 30 % of its volume; or 80 % of its longest side, 5 % of its
      volume, and everywhere about as far from it) is the inner side of a wall with thickness, and
      becomes the wall of the lumen;
    - one as long, but not about as far everywhere, may be either: `InputError`;
    - others are bodies in the lumen.

    Where two parts side by side both follow, neither is taken for the inner side of a wall.
    Whatever else lies in the lumen, cuts the wall or touches it is wall too. Only parts wholly
    outside that do not touch the wall are left out.
    """
    if part is None:
        part = _mesh.label_parts(triangles, len(points))
    number = int(part.max()) + 1
    bodies = sheets = triangles[:0]
    apart: tuple[Component, ...] = ()
    if number > 1:
        volume = np.abs(_mesh.measure_part_volumes(points, triangles, part, number))
        closed = _find_closed(triangles, part, number)
        first = int(np.where(closed, volume, -1.0).argmax()) if wall is None else wall
        chosen, inside, around = _find_wall(points, triangles, part, volume, closed, first, found)
        touching, entering = find_touching(points, triangles, part, chosen)
        free = closed & inside & ~touching
        is_body = free & ~_find_meeting(points, triangles, part, free)
        kept = (touching | entering) & ~is_body
        kept[chosen] = False
        middles = _find_middles(points, triangles, part, number)
        _report(part, volume, chosen, is_body, kept, middles, found)
        # The outer side of a wall with thickness is no lumen.
        left = closed & ~kept & ~is_body & (np.arange(number) != chosen) & ~around
        order = np.flatnonzero(left)[np.argsort(-volume[left], kind="stable")]
        apart = tuple(
            Component(volume=float(volume[k]), point=(x, y, z))
            for k, (x, y, z) in ((int(k), middles[k].tolist()) for k in order[:MOST_APART])
        )
        bodies = _turn_inwards(points, triangles[is_body[part]])
        sheets = triangles[kept[part]]
        triangles = triangles[part == chosen]
    used, index = np.unique(np.concatenate((triangles, bodies, sheets)), return_inverse=True)
    index = index.reshape(-1, 3).astype(np.int64)
    ends = np.cumsum((len(triangles), len(bodies)))
    return Parts(points[used], index[: ends[0]], index[ends[0] : ends[1]], index[ends[1] :], apart)


def find_touching(
    points: Vertices, triangles: Faces, part: NDArray[np.int64], wall: int
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Say which parts cross or touch the wall, and which have a corner inside it, (number,)."""
    import igl

    number = int(part.max()) + 1
    touching, entering = np.zeros(number, dtype=bool), np.zeros(number, dtype=bool)
    sheet, _ = _mesh.agree(triangles[part == wall], len(points))
    sheet = np.ascontiguousarray(sheet)
    size = float(np.ptp(points[triangles].reshape(-1, 3), axis=0).max())
    reach = TOUCHING * size
    low, high = points[sheet].min(axis=(0, 1)) - reach, points[sheet].max(axis=(0, 1)) + reach
    corners = points[triangles]
    near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    near &= part != wall
    if not near.any():
        return touching, entering
    others, owner = np.ascontiguousarray(triangles[near]), part[near]
    both = np.concatenate((sheet, others))
    group = np.concatenate((np.zeros(len(sheet), np.int64), np.ones(len(others), np.int64)))
    crossed = cross_groups(points, both, _choose_cell(points, both), group)
    touching[owner[crossed[len(sheet) :]]] = True
    rest = ~touching[owner]
    if not rest.any():
        return touching, entering
    others, owner = np.ascontiguousarray(others[rest]), owner[rest]
    of_corner = np.zeros(len(points), dtype=np.int64)
    of_corner[others] = owner[:, None]
    used = np.unique(others)
    places = np.ascontiguousarray(points[used])
    winding = np.abs(igl.fast_winding_number(points, sheet, places))
    entering[of_corner[used[winding > 0.5]]] = True
    touching[of_corner[used[_measure_squared(points, sheet, places) <= reach**2]]] = True
    ends = np.unique(sheet)
    low, high = points[used].min(axis=0) - reach, points[used].max(axis=0) + reach
    ends = ends[((points[ends] >= low) & (points[ends] <= high)).all(axis=1)]
    if len(ends):
        squared, face, _ = _ask_boxes(points, others, np.ascontiguousarray(points[ends]))
        touching[owner[face[squared <= reach**2]]] = True
    return touching, entering


def _find_meeting(
    points: Vertices,
    triangles: Faces,
    part: NDArray[np.int64],
    asked: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Say which of the parts asked for cross another part or lie in it."""
    meets = np.zeros(len(asked), dtype=bool)
    some = asked[part]
    if int(asked.sum()) < 2:
        return meets
    faces, group = np.ascontiguousarray(triangles[some]), part[some]
    crossed = cross_groups(points, faces, _choose_cell(points, faces), group)
    meets[group[crossed]] = True
    for one in np.flatnonzero(asked):
        within = _find_inside(points, triangles, part, int(one), asked)
        if (within & asked).any():
            meets |= within & asked
            meets[one] = True
    return meets


def _choose_cell(points: Vertices, faces: Faces) -> float:
    extent = np.ptp(points[faces], axis=1).max(axis=1)
    return max(2.0 * float(np.median(extent)), 1e-6 * float(np.ptp(points, axis=0).max()), 1e-9)


def _ask_boxes(points: Vertices, faces: Faces, places: Vertices) -> Any:
    import igl

    boxes = igl.AABB()
    boxes.init(points, faces)
    return boxes.squared_distance(points, faces, places)


def _measure_squared(points: Vertices, faces: Faces, places: Vertices) -> NDArray[np.float64]:
    return np.asarray(_ask_boxes(points, faces, places)[0], dtype=np.float64)


def _find_middles(
    points: Vertices, triangles: Faces, part: NDArray[np.int64], number: int
) -> Vertices:
    """Return the middle of each part's triangles [mm], shape (number, 3)."""
    count = np.bincount(part, minlength=number)
    middle = points[triangles].mean(axis=1)
    sums = [np.bincount(part, weights=middle[:, axis], minlength=number) for axis in range(3)]
    return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])


def _find_wall(
    points: Vertices,
    triangles: Faces,
    part: NDArray[np.int64],
    volume: NDArray[np.float64],
    closed: NDArray[np.bool_],
    wall: int,
    found: list[Finding],
) -> tuple[int, NDArray[np.bool_], NDArray[np.bool_]]:
    """Go inwards from a part as long as one sheet follows the other; return those passed too."""
    passed = np.zeros(len(volume), dtype=bool)
    order = np.argsort(part, kind="stable")
    first = np.searchsorted(part[order], np.arange(len(volume)))
    corners = points[triangles[order]]
    sides = np.maximum.reduceat(corners.max(axis=1), first) - np.minimum.reduceat(
        corners.min(axis=1), first
    )
    while True:
        inside = _find_inside(points, triangles, part, wall, closed)
        axis = int(sides[wall].argmax())
        fills = volume >= FOLLOWS_VOLUME * volume[wall]
        follows = fills | (
            (volume >= THIN_VOLUME * volume[wall])
            & (sides[:, axis] >= FOLLOWS_LENGTH * sides[wall, axis])
        )
        sheets = np.flatnonzero(inside & closed & follows)
        if len(sheets) == 0:
            return wall, inside, passed
        inner = int(sheets[volume[sheets].argmax()])
        deeper = _find_inside(points, triangles, part, inner, closed)
        if not deeper[sheets[sheets != inner]].all():
            return wall, inside, passed
        if not fills[inner] and not _is_even(
            points, triangles[part == wall], triangles[part == inner]
        ):
            listed = (
                f"'{1 + int((volume > volume[k]).sum())}' ({volume[k] / 1000.0:.3g} mL)"
                for k in (wall, inner)
            )
            raise InputError(
                f"a closed part of {volume[inner] / 1000.0:.3g} mL lies along the inside of one of "
                f"{volume[wall] / 1000.0:.3g} mL: it may be a body in the lumen or the inner side "
                f"of a thick wall; say which part is the wall of the lumen, with --part: "
                f"{' or '.join(listed)}"
            )
        message = (
            f"a closed sheet of {volume[inner] / 1000.0:.3g} mL lies inside one of "
            f"{volume[wall] / 1000.0:.3g} mL: taken for a wall with thickness, the lumen is inside "
            f"the inner sheet; if it is not, give the surface of the lumen alone"
        )
        found.append(Finding("wall-with-thickness", "warning", message))
        passed[wall] = True
        wall = inner


def _is_even(points: Vertices, outer: Faces, inner: Faces) -> bool:
    """Whether two sheets, one in the other, are everywhere about as far from each other."""
    gaps = []
    for one, other in ((outer, inner), (inner, outer)):
        places = np.concatenate((points[np.unique(one)], points[one].mean(axis=1)))
        gaps.append(_measure_squared(points, np.ascontiguousarray(other), places))
    squared = np.concatenate(gaps)
    return bool(squared.max() <= FOLLOWS_RATIO**2 * squared.min())


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
    is_body: NDArray[np.bool_],
    kept: NDArray[np.bool_],
    middles: Vertices,
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
    pieces = int(kept.sum())
    if pieces:
        what = "1 part lies" if pieces == 1 else f"{pieces} parts lie"
        largest = int(np.where(kept, np.bincount(part, minlength=number), -1).argmax())
        message = (
            f"{what} in the lumen or touch{'es' if pieces == 1 else ''} its wall "
            f"({int(kept[part].sum())} triangles, the most near {name_place(middles[largest])} mm):"
            f" kept as wall on both sides"
        )
        found.append(Finding("pieces-inside", "warning", message))
    dropped = ~is_body & ~kept
    dropped[wall] = False
    count = int(dropped.sum())
    if not count:
        return
    lost = float(volume[dropped].sum())
    message = (
        f"{number} components: the {'largest' if wall == volume.argmax() else 'one inside'} "
        f"({volume[wall] / 1000.0:.3g} mL) is kept, {count} {'other' if count == 1 else 'others'} "
        f"with {int(dropped[part].sum())} triangles and {lost / 1000.0:.3g} mL, wholly outside the "
        f"lumen and not touching it, dropped"
    )
    severity = "warning" if lost > 0.01 * max(float(volume.sum()), 1e-300) else "note"
    found.append(Finding("components-dropped", severity, message))
