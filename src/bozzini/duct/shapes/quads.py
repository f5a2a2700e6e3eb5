"""Stitched quadrilaterals (thesis 5.3.2.2): an outline, and coordinates along and across it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, refuse_first
from ...errors import GeometryError, InputError
from ...numeric.vectors import cross_planar
from ..base import DuctShape, Kind, PackedDuct
from ..checks import check_places, freeze_places, set_fields
from ..packed import ShapesData
from .base import ShapeUnion

# A simple polygon: the planar duct, with exact signed distance.


@dataclass(frozen=True, eq=False)
class Polygon(ShapeUnion):
    """The inside of a closed polygon that does not cross itself.

    Parameters
    ----------
    vertices : (n, 2) float
        In order, either way round [mm]; edge k joins vertices k and k + 1, the last one closes.
        The first vertex may be repeated at the end. Kept counter-clockwise.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    GeometryError
        If two edges cross or touch, or an edge has no length, with the numbers of the edges.
    InputError
        If there are fewer than 3 vertices, or one is not finite.

    Notes
    -----
    The signed distance is exact on both sides; with inflation it is exact outside and a lower
    bound of the depth inside.
    """

    vertices: NDArray[np.float64]
    wall: str = field(default="polygon", kw_only=True)

    name = "polygon"
    unit_kinds = {"vertices": "length"}
    code = 3
    dim = 2
    exact_outside = True

    def __post_init__(self) -> None:
        vertices = freeze_places("vertices", self.vertices, 2, least=3)
        if len(vertices) > 3 and np.array_equal(vertices[0], vertices[-1]):
            vertices = vertices[:-1]
        super().__post_init__()
        check_simple(vertices)
        if measure_area(vertices) < 0.0:
            vertices = vertices[::-1].copy()
            vertices.flags.writeable = False
        set_fields(self, vertices=vertices)

    @property
    def kind(self) -> Kind:
        """Exact; with inflation a lower bound of the clearance."""
        return "bound" if self.inflation > 0.0 else "exact"

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the box around the polygon [mm]."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return np.stack([low - self.inflation, high + self.inflation])

    @property
    def area(self) -> float:
        """Area before inflation [mm^2]."""
        return measure_area(self.vertices)

    def numbers(self) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
        """Return the numbers of the polygon, and its bounding ball [mm].

        How many edges, then start (2), end (2) and 1 / length squared of each.
        """
        start, stop = self.vertices, np.roll(self.vertices, -1, axis=0)
        square = np.sum((stop - start) ** 2, axis=1, keepdims=True)
        edges = np.concatenate([start, stop, 1.0 / square], axis=1)
        middle = 0.5 * (start.min(axis=0) + start.max(axis=0))
        reach = float(np.linalg.norm(start - middle, axis=1).max())
        row = np.concatenate([[float(len(edges))], edges.reshape(-1)])
        return [row], np.array([[*middle, 0.0, reach]])

    @staticmethod
    def move(
        row: NDArray[np.float64], rotation: NDArray[np.float64], shift: NDArray[np.float64]
    ) -> bool:
        """Move the ends of the edges."""
        edges = row[1:].reshape(-1, 5)
        for ends in (edges[:, :2], edges[:, 2:4]):
            ends[:] = ends @ rotation[:2, :2].T + shift[:2]
        return True


def measure_area(vertices: NDArray[np.float64]) -> float:
    """Return the signed area of a closed polygon (n, 2), positive if counter-clockwise [mm^2]."""
    shifted = vertices - vertices[0]
    x, y = shifted[:, 0], shifted[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def check_simple(vertices: NDArray[np.float64]) -> None:
    """Raise `GeometryError` if edges of a closed polygon (n, 2) have no length, cross or touch."""
    along = np.roll(vertices, -1, axis=0) - vertices
    count = len(vertices)
    flat = np.flatnonzero(np.all(along == 0.0, axis=1))
    if len(flat):
        k = int(flat[0])
        raise GeometryError(
            f"edge {k} of the polygon has no length: vertices {k} and {(k + 1) % count} are both "
            f"({vertices[k, 0]:g}, {vertices[k, 1]:g}) mm"
        )
    after = np.roll(along, -1, axis=0)
    back = (cross_planar(along, after) == 0.0) & (np.sum(along * after, axis=1) < 0.0)
    if back.any():
        k = int(np.argmax(back))
        raise GeometryError(
            f"edges {k} and {(k + 1) % count} of the polygon fold back on each other"
        )
    crossing = find_crossing(vertices)
    if crossing is not None:
        raise GeometryError(
            f"edges {crossing[0]} and {crossing[1]} of the polygon cross or touch: it must be "
            "simple"
        )


def find_crossing(vertices: NDArray[np.float64]) -> tuple[int, int] | None:
    """Return the first two edges of a polygon that are no neighbours and cross or touch, if any."""
    start, stop = vertices, np.roll(vertices, -1, axis=0)
    for i in range(len(vertices)):
        others = np.arange(i + 2, len(vertices) if i > 0 else len(vertices) - 1)
        a, b, c, d = start[i], stop[i], start[others], stop[others]
        side_c, side_d = cross_planar(b - a, c - a), cross_planar(b - a, d - a)
        side_a, side_b = cross_planar(d - c, a - c), cross_planar(d - c, b - c)
        apart = (side_c * side_d > 0.0) | (side_a * side_b > 0.0)
        apart |= np.any((np.minimum(c, d) > np.maximum(a, b)), axis=1)
        apart |= np.any((np.maximum(c, d) < np.minimum(a, b)), axis=1)
        if not apart.all():
            return i, int(others[np.argmin(apart)])
    return None


EDGE = 1e-12
"""A point this far beyond the side of a quad, in its coordinates, still counts as inside."""

BATCH = 1_000_000
"""Points times quads that are looked at in one go."""


@dataclass(frozen=True)
class QuadCoordinates:
    """Where points lie in a duct of quads.

    Attributes
    ----------
    quad : (...) int
        Index of the quad; -1 where the point is in none, and the rest is not a number there.
    along : (...) float
        s in [0, 1], from rung ``quad`` to rung ``quad + 1``.
    across : (...) float
        v in [0, 1], from the left side to the right: a share of the width there, no length.
    discriminant : (...) float
        Of the quadratic in s [mm^4]: the square of the Jacobian's determinant.
    """

    quad: NDArray[np.int64]
    along: NDArray[np.float64]
    across: NDArray[np.float64]
    discriminant: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StitchedQuads(DuctShape, PackedDuct):
    """Convex quadrilaterals, each sharing a rung with the next.

    Quad k has the corners ``left[k], left[k + 1], right[k + 1], right[k]``.

    Parameters
    ----------
    left : (n + 1, 2) float
        Points along one side: P of thesis eq. 5.21 [mm].
    right : (n + 1, 2) float
        Points along the other: Q [mm].
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    GeometryError
        If a quad crosses itself, is not convex or is turned over, with its index and corner; or
        if quads that are no neighbours overlap.
    InputError
        If there are fewer than two points on a side, or not as many on the other.

    Notes
    -----
    The signed distance is that of the outline, exact on both sides; with inflation it is exact
    outside and a lower bound of the depth inside. The first and last rung are walls. Clearance is
    in mm, unlike the thesis's margin on v, which is a share of the local width.
    """

    left: NDArray[np.float64]
    right: NDArray[np.float64]
    wall: str = field(default="stitched quadrilaterals", kw_only=True)

    name = "quads"
    unit_kinds = {"left": "length", "right": "length"}
    dim = 2
    exact_outside = True

    def __post_init__(self) -> None:
        left = freeze_places("left", self.left, 2, least=2)
        right = freeze_places("right", self.right, 2, least=2)
        if len(left) != len(right):
            raise InputError(
                f"right has {len(right)} point(s): it must have as many as left, {len(left)}"
            )
        super().__post_init__()
        check_quads(left, right)
        set_fields(self, left=left, right=right)
        crossing = find_crossing(np.concatenate([left, right[::-1]]))
        if crossing is not None:
            count = len(left) - 1
            # Edges of the outline: the left side, the last rung, the right side, the first rung.
            first, second = (
                k if k < count else min(max(2 * count - k, 0), count - 1) for k in crossing
            )
            raise GeometryError(
                f"quads {min(first, second)} and {max(first, second)} overlap or touch: a planar "
                "duct must not cross itself"
            )

    @property
    def kind(self) -> Kind:
        """Exact; with inflation a lower bound of the clearance."""
        return self.outline.kind

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of the box around the duct [mm]."""
        return self.outline.bounds

    @cached_property
    def outline(self) -> Polygon:
        """The polygon along the left side and back along the right."""
        corners = np.concatenate([self.left, self.right[::-1]])
        return Polygon(corners, inflation=self.inflation, wall=self.wall)

    @property
    def family_shapes(self) -> ShapesData:
        """The outline as kernels see it."""
        return self.pack()

    def pack(self) -> ShapesData:
        """Return the duct for compiled kernels."""
        return self.outline.pack()

    def locate(
        self, quad: ArrayLike, along: ArrayLike, *, across: ArrayLike
    ) -> NDArray[np.float64]:
        """Return the (..., 2) points at coordinates: thesis eq. 5.21 with weights that sum to 1.

        Raises
        ------
        InputError
            If there is no such quad, or a coordinate is not finite.
        """
        k = np.asarray(quad)
        if k.dtype.kind not in "iu" or np.any((k < 0) | (k > len(self.left) - 2)):
            wrong = k if k.dtype.kind not in "iu" else k[(k < 0) | (k > len(self.left) - 2)].flat[0]
            raise InputError(
                f"quad is {wrong}: it must be a whole number in [0, {len(self.left) - 2}]"
            )
        s, v = (check_array(n, x) for n, x in (("along", along), ("across", across)))
        for name, array in (("along", s), ("across", v)):
            refuse_first(~np.isfinite(array), name, array, "it must be finite")
        s, v = s[..., None], v[..., None]
        left = (1.0 - s) * self.left[k] + s * self.left[k + 1]
        right = (1.0 - s) * self.right[k] + s * self.right[k + 1]
        return np.asarray((1.0 - v) * left + v * right)

    def coordinates(self, points: ArrayLike) -> QuadCoordinates:
        """Return in which quad points (..., 2) lie, and where; on a rung in the first.

        Raises
        ------
        InputError
            If the points are not finite or not (..., 2).
        """
        array = check_places("points", points, dim=2)
        flat = array.reshape(-1, 2)
        rows = max(1, BATCH // (len(self.left) - 1))
        parts = [self._find(flat[k : k + rows]) for k in range(0, max(len(flat), 1), rows)]
        quad, along, across, discriminant = (
            np.concatenate(values).reshape(array.shape[:-1]) for values in zip(*parts, strict=True)
        )
        return QuadCoordinates(quad=quad, along=along, across=across, discriminant=discriminant)

    def _find(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return quad, along, across and discriminant of points (n, 2)."""
        s, v, discriminant = invert_quads(self.left, self.right, points)
        real = (s.imag == 0.0) & (v.imag == 0.0) & np.isfinite(s.real) & np.isfinite(v.real)
        off = np.maximum(np.abs(s.real - 0.5), np.abs(v.real - 0.5)) - 0.5
        off = np.where(real, off, np.inf)  # (n, quads, 2)
        root = off.argmin(axis=-1)
        inside = np.take_along_axis(off, root[..., None], axis=-1)[..., 0] <= EDGE
        hit = inside.any(axis=1)
        k = inside.argmax(axis=1)
        row = np.arange(len(points))
        along, across = (
            np.where(hit, np.clip(values[row, k, root[row, k]].real, 0.0, 1.0), np.nan)
            for values in (s, v)
        )
        square = np.where(hit, discriminant[row, k], np.nan)
        return np.where(hit, k, -1), along, across, square


def invert_quads(
    left: NDArray[np.float64], right: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
    """Solve x = (1 - v) [(1 - s) P0 + s P1] + v [(1 - s) Q0 + s Q1] for s and v.

    Parameters
    ----------
    left, right : (n + 1, 2) float
        P and Q [mm].
    points : (m, 2) float
        x [mm].

    Returns
    -------
    s, v : (m, n, 2) complex
        Both solutions in each quad; complex past the envelope of its rungs, infinite where there
        is only one.
    discriminant : (m, n) float
        B^2 - 4 A C of A s^2 + B s + C = 0 [mm^4].

    Notes
    -----
    With E = P1 - P0, G = Q0 - P0, K = Q1 - P1 - G, H = x - P0 and ^ the planar cross product,
    A = -E ^ K, B = H ^ K - E ^ G, C = H ^ G. The roots are taken as q / A and C / q with
    q = -(B + sgn(B) sqrt(B^2 - 4 A C)) / 2, so that nothing cancels and A may vanish.
    """
    e = left[1:] - left[:-1]
    g = right[:-1] - left[:-1]
    k = right[1:] - left[1:] - g
    h = points[:, None] - left[:-1]
    a = -cross_planar(e, k) + np.zeros(len(points))[:, None]
    b = cross_planar(h, k) - cross_planar(e, g)
    c = cross_planar(h, g)
    discriminant = b * b - 4.0 * a * c
    # On the envelope rounding may leave a negative square.
    noise = 16.0 * np.finfo(float).eps * (b * b + np.abs(4.0 * a * c))
    root = np.sqrt(np.where(np.abs(discriminant) <= noise, 0.0, discriminant).astype(complex))
    q = -0.5 * (b + np.where(b < 0.0, -1.0, 1.0) * root)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.stack([q / a, np.where(q != 0.0, c / q, 0.0)], axis=-1)
        s = np.where(np.isfinite(s), s, np.inf)
        rung = g[:, None] + s[..., None] * k[:, None]
        away = h[:, :, None] - s[..., None] * e[:, None]
        # By the larger of the two coordinates: no conjugate, so that it holds for complex s.
        pick = np.abs(rung).argmax(axis=-1)[..., None]
        top = np.take_along_axis(away, pick, axis=-1)[..., 0]
        low = np.take_along_axis(rung, pick, axis=-1)[..., 0]
        v = np.where(np.isfinite(s), top / low, np.inf)
    return s, v, discriminant


def check_quads(left: NDArray[np.float64], right: NDArray[np.float64]) -> None:
    """Raise `GeometryError` unless all quads are convex and the same way round."""
    corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    sides = np.roll(corners, -1, axis=1) - corners
    turns = cross_planar(np.roll(sides, 1, axis=1), sides)  # (n, 4), at each corner
    names = ("left[{0}]", "left[{1}]", "right[{1}]", "right[{0}]")
    turn_sign = 0.0
    for k, turn in enumerate(turns):
        signs = np.sign(turn)
        total = float(signs.sum())
        if abs(total) < 4.0:
            if total == 0.0 and np.all(signs != 0.0):
                raise GeometryError(f"quad {k} crosses itself: its sides must not meet")
            odd = int(np.argmax(signs != (1.0 if total > 0.0 else -1.0)))
            name = names[odd].format(k, k + 1)
            x, y = corners[k, odd]
            raise GeometryError(
                f"quad {k} is not convex at corner {name} ({x:g}, {y:g}) mm: all its corners must "
                "turn the same way"
            )
        if turn_sign * total < 0.0:
            raise GeometryError(f"quad {k} is turned over: left and right change sides at rung {k}")
        turn_sign = total
