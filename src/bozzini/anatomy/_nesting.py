"""Parts of a surface: which is the wall of the lumen, and which stand in its way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from . import _mesh
from ._mesh import Faces, Integers, Mask, Vertices
from .tract import Component, Finding, count_noun, name_place, show_volume, to_point

FOLLOWS_VOLUME = 0.3
"""Share of the outer sheet's volume from which an inner one is taken for the inside of a wall."""

FOLLOWS_LENGTH = 0.8
THIN_VOLUME = 0.05
"""The same for a thick wall around a narrow lumen: of the longest side, and of the volume."""

FOLLOWS_RATIO = 2.0
"""Largest thickness of such a wall, by its smallest."""

MOST_APART = 100
"""Closed parts left out that are listed."""

TOUCHING_SHARE = 1e-6
"""Distance, by the size of the surface, below which a part touches the wall."""


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


@dataclass(frozen=True)
class PartSet:
    """Triangles in numbered parts, and how these lie to each other.

    Attributes
    ----------
    points : (n, 3) float
        [mm].
    triangles : (m, 3) int
    part : (m,) int
        The part of each triangle, from 0 on.
    """

    points: Vertices
    triangles: Faces
    part: Integers

    @cached_property
    def number(self) -> int:
        """How many parts there are."""
        return int(self.part.max()) + 1

    @cached_property
    def volume(self) -> NDArray[np.float64]:
        """Volume of each part, its triangles turned outwards [mm^3]."""
        faces = _mesh.turn_outwards(self.points, self.triangles, self.part)
        return np.abs(_mesh.measure_part_volumes(self.points, faces, self.part, self.number))

    @cached_property
    def owner(self) -> Integers:
        """The part of each corner, -1 where it has none."""
        owner = np.full(len(self.points), -1, dtype=np.int64)
        owner[self.triangles] = self.part[:, None]
        return owner

    @cached_property
    def closed(self) -> Mask:
        """Whether a part has an even number of triangles at every edge."""
        edges = _mesh.count_edges(self.triangles)
        closed = np.ones(self.number, dtype=bool)
        closed[self.owner[edges.pairs[edges.counts % 2 == 1, 0]]] = False
        return closed

    @cached_property
    def middles(self) -> Vertices:
        """Middle of each part's triangles [mm], shape (number, 3)."""
        middle = self.points[self.triangles].mean(axis=1)
        sums = [np.bincount(self.part, middle[:, axis], self.number) for axis in range(3)]
        count = np.maximum(np.bincount(self.part, minlength=self.number), 1)
        return np.asarray(np.stack(sums, axis=1) / count[:, None])

    @cached_property
    def sides(self) -> NDArray[np.float64]:
        """Sides of the box around each part [mm], shape (number, 3)."""
        pieces = _mesh.split_by(self.triangles, self.part)
        return np.array([np.ptp(self.points[piece].reshape(-1, 3), axis=0) for piece in pieces])

    def take(self, part: int) -> Faces:
        """Return the triangles of a part."""
        return np.asarray(self.triangles[self.part == part])

    def find_touching(self, wall: int) -> tuple[Mask, Mask]:
        """Say which parts cross or touch one of them, and which have a corner inside it."""
        points, part = self.points, self.part
        touching, entering = np.zeros((2, self.number), dtype=bool)
        sheet, _ = _mesh.agree(self.take(wall))
        corners = points[self.triangles]
        reach = TOUCHING_SHARE * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        low, high = points[sheet].min(axis=(0, 1)) - reach, points[sheet].max(axis=(0, 1)) + reach
        near = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
        near &= part != wall
        if not near.any():
            return touching, entering
        others, owner = self.triangles[near], part[near]
        group = np.repeat((0, 1), (len(sheet), len(others)))
        crossed = _mesh.find_crossing(points, np.concatenate((sheet, others)), group)
        touching[owner[crossed[len(sheet) :]]] = True
        rest = ~touching[owner]
        if not rest.any():
            return touching, entering
        others, owner = others[rest], owner[rest]
        used = np.unique(others)
        places = points[used]
        entering[self.owner[used[np.abs(_mesh.wind(points, sheet, places)) > 0.5]]] = True
        touching[self.owner[used[_mesh.find_nearest(points, sheet, places)[0] <= reach]]] = True
        ends = np.unique(sheet)
        low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
        ends = ends[((points[ends] >= low) & (points[ends] <= high)).all(axis=1)]
        if len(ends):
            distance, face = _mesh.find_nearest(points, others, points[ends])
            touching[owner[face[distance <= reach]]] = True
        return touching, entering

    def find_inside(self, wall: int) -> Mask:
        """Say which parts lie with all their corners inside a closed part."""
        inside = np.zeros(self.number, dtype=bool)
        if not self.closed[wall]:
            return inside
        points, owner = self.points, self.owner
        sheet, _ = _mesh.agree(self.take(wall))
        low, high = points[sheet].min(axis=(0, 1)), points[sheet].max(axis=(0, 1))
        in_box = ((points >= low) & (points <= high)).all(axis=1)
        tested = np.flatnonzero((owner >= 0) & (owner != wall) & in_box)
        if len(tested) == 0:
            return inside
        winding = np.abs(_mesh.wind(points, sheet, points[tested]))
        hits = np.bincount(owner[tested[winding > 0.5]], minlength=self.number)
        inside = hits == np.bincount(owner[owner >= 0], minlength=self.number)
        inside[wall] = False
        return np.asarray(inside)

    def find_meeting(self, asked: Mask) -> Mask:
        """Say which of the parts asked for cross another one of them or lie in it."""
        meets = np.zeros(self.number, dtype=bool)
        if int(asked.sum()) < 2:
            return meets
        some = asked[self.part]
        group = self.part[some]
        meets[group[_mesh.find_crossing(self.points, self.triangles[some], group)]] = True
        for one in np.flatnonzero(asked):
            within = self.find_inside(int(one)) & asked
            meets |= within
            meets[one] |= within.any()
        return meets


def resolve_parts(parts: PartSet, wall: int, found: list[Finding]) -> Parts:
    """Find the part that is the wall of the lumen, and keep all that stands in the lumen.

    The search begins at the part `wall`. A closed part wholly inside it is never passed over:

    - one that follows it (at least 30 % of its volume; or 80 % of its longest side, 5 % of its
      volume, and everywhere about as far from it) is the inner side of a wall with thickness, and
      becomes the wall of the lumen;
    - one as long, but not about as far everywhere, may be either: `InputError`;
    - others are bodies in the lumen.

    Where two parts side by side both follow, neither is taken for the inner side of a wall.
    Whatever else lies in the lumen, cuts the wall or touches it is wall too. Only parts wholly
    outside that do not touch the wall are left out.
    """
    points, triangles, part = parts.points, parts.triangles, parts.part
    bodies = sheets = triangles[:0]
    apart: tuple[Component, ...] = ()
    if parts.number > 1:
        chosen, inside, around = _find_wall(parts, wall, found)
        touching, entering = parts.find_touching(chosen)
        free = parts.closed & inside & ~touching
        is_body = free & ~parts.find_meeting(free)
        kept = (touching | entering) & ~is_body
        kept[chosen] = False
        _report(parts, chosen, is_body, kept, found)
        # The outer side of a wall with thickness is no lumen.
        left = parts.closed & ~kept & ~is_body & (np.arange(parts.number) != chosen) & ~around
        order = np.flatnonzero(left)[np.argsort(-parts.volume[left], kind="stable")]
        apart = tuple(
            Component(volume=float(parts.volume[k]), point=to_point(parts.middles[k]))
            for k in order[:MOST_APART]
        )
        bodies = _turn_inwards(points, triangles[is_body[part]])
        sheets = triangles[kept[part]]
        triangles = parts.take(chosen)
    used, index = np.unique(np.concatenate((triangles, bodies, sheets)), return_inverse=True)
    ends = np.cumsum((len(triangles), len(bodies)))
    one, two, three = np.split(index.reshape(-1, 3).astype(np.int64), ends)
    return Parts(points[used], wall=one, bodies=two, sheets=three, apart=apart)


def _find_wall(parts: PartSet, wall: int, found: list[Finding]) -> tuple[int, Mask, Mask]:
    """Go inwards from a part as long as one sheet follows the other; return those passed too."""
    passed = np.zeros(parts.number, dtype=bool)
    volume, sides = parts.volume, parts.sides
    while True:
        inside = parts.find_inside(wall)
        axis = int(sides[wall].argmax())
        fills = volume >= FOLLOWS_VOLUME * volume[wall]
        follows = fills | (
            (volume >= THIN_VOLUME * volume[wall])
            & (sides[:, axis] >= FOLLOWS_LENGTH * sides[wall, axis])
        )
        sheets = np.flatnonzero(inside & parts.closed & follows)
        if len(sheets) == 0:
            return wall, inside, passed
        inner = int(sheets[volume[sheets].argmax()])
        if not parts.find_inside(inner)[sheets[sheets != inner]].all():
            return wall, inside, passed
        if not fills[inner] and not _is_even(parts.points, parts.take(wall), parts.take(inner)):
            listed = (
                f"'{1 + int((volume > volume[k]).sum())}' ({show_volume(volume[k])})"
                for k in (wall, inner)
            )
            raise InputError(
                f"a closed part of {show_volume(volume[inner])} lies along the inside of one of "
                f"{show_volume(volume[wall])}: it may be a body in the lumen or the inner side "
                f"of a thick wall; choose the part that is the wall of the lumen, with --part: "
                f"{' or '.join(listed)}"
            )
        message = (
            f"a closed sheet of {show_volume(volume[inner])} lies inside one of "
            f"{show_volume(volume[wall])}: taken for a wall with thickness, the lumen is inside "
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
        gaps.append(_mesh.find_nearest(points, other, places)[0])
    distance = np.concatenate(gaps)
    return bool(distance.max() <= FOLLOWS_RATIO * distance.min())


def _turn_inwards(points: Vertices, bodies: Faces) -> Faces:
    if len(bodies) == 0:
        return bodies
    part = _mesh.label_parts(bodies, len(points))
    return _mesh.turn_outwards(points, bodies, part)[:, ::-1]


def _report(parts: PartSet, wall: int, is_body: Mask, kept: Mask, found: list[Finding]) -> None:
    part, volume = parts.part, parts.volume
    bodies = int(is_body.sum())
    if bodies:
        message = (
            f"{count_noun(bodies, 'closed part lies', 'closed parts lie')} inside the lumen "
            f"({show_volume(volume[is_body].sum())}): taken for "
            f"{'a body' if bodies == 1 else 'bodies'} the scope cannot pass"
        )
        found.append(Finding("bodies-inside", "warning", message))
    if kept.any():
        sizes = np.where(kept, np.bincount(part, minlength=parts.number), -1)
        what = ("part lies in the lumen or touches", "parts lie in the lumen or touch")
        message = (
            f"{count_noun(int(kept.sum()), *what)} its wall ({int(kept[part].sum())} triangles, "
            f"the most near {name_place(parts.middles[int(sizes.argmax())])} mm): kept as wall on "
            f"both sides"
        )
        found.append(Finding("pieces-inside", "warning", message))
    dropped = ~is_body & ~kept
    dropped[wall] = False
    if dropped.any():
        lost = float(volume[dropped].sum())
        message = (
            f"{parts.number} components: the "
            f"{'largest' if wall == volume.argmax() else 'one inside'} "
            f"({show_volume(volume[wall])}) is kept, "
            f"{count_noun(int(dropped.sum()), 'other', 'others')} with "
            f"{int(dropped[part].sum())} triangles and {show_volume(lost)}, wholly outside the "
            f"lumen and not touching it, dropped"
        )
        severity = "warning" if lost > 0.01 * max(float(volume.sum()), 1e-300) else "note"
        found.append(Finding("components-dropped", severity, message))
