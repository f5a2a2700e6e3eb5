"""From loose triangles to a checked `SurfaceTract`: closed, one part, turned outwards."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import GeometryError, InputError
from . import _mesh
from ._nesting import resolve_parts
from ._scale import check_scale
from .findings import Finding
from .tract import SurfaceTract

__all__ = ["tract_from_surface"]

FLAT = 1e-6
"""Smallest side of the box around a surface, by its longest, that is not flat."""

HOLLOW = 1e-9
"""Smallest volume, by the cube of the longest side, that is not zero."""

FARTHEST = 1e9
"""Largest coordinate that is taken for one [mm]; beyond it a file is damaged."""

WELD = 1e-5
"""Distance, by the longest side, within which the corners of an open surface are welded."""

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]


def tract_from_surface(
    vertices: ArrayLike,
    faces: ArrayLike,
    *,
    source: str = "array",
    findings: Iterable[Finding] = (),
) -> SurfaceTract:
    """Check the wall of a lumen, mend what is small, and say what was done.

    In this order: equal corners are welded; flat and doubled triangles are dropped; a surface
    still open is welded within 1e-5 of its size and its holes of three or four edges are filled;
    the largest part is kept, with the closed bodies inside it, or where a second sheet follows it
    on the inside (an organ's wall with thickness) that inner sheet; faces are turned to agree,
    outwards, those of bodies into them. Then handles, places
    where the surface touches itself (an edge of more than two triangles, a corner that joins two
    sheets) and triangles that cross (those that share no corner) are counted.

    Parameters
    ----------
    vertices : array_like, shape (n, 3)
        World [mm].
    faces : array_like of int, shape (m, 3)
    source : str
        Where it came from, for reports and messages.
    findings : iterable of Finding
        What was found before, to be kept.

    Raises
    ------
    InputError
        If a vertex is not finite, or a face points nowhere.
    GeometryError
        If the surface is flat, encloses no volume, or stays open; the message says where.
    """
    points, triangles = _check_arrays(vertices, faces, source)
    found = list(findings)
    points, triangles = _mesh.weld(points, triangles)
    triangles = _drop_bad(triangles, found)
    if len(triangles) == 0:
        raise GeometryError(f"{source} encloses no volume: all its triangles are flat")
    extent = np.ptp(points[triangles].reshape(-1, 3), axis=0)
    if extent.min() <= FLAT * extent.max():
        sides = " x ".join(f"{side:.3g}" for side in extent)
        raise GeometryError(f"{source} encloses no volume: it is flat, {sides} mm")
    if _count_open(triangles):
        points, triangles = _close(points, triangles, float(extent.max()), found)
    points, triangles, bodies = resolve_parts(points, triangles, found)
    _refuse_open(points, triangles, source)
    triangles = _orient(points, triangles, found)
    size = float(np.ptp(points, axis=0).max())
    if abs(_mesh.measure_volume(points, triangles)) <= HOLLOW * size**3:
        raise GeometryError(f"{source} encloses no volume: its two sides lie on each other")
    triangles = np.concatenate((triangles, bodies))
    found += _check_topology(triangles)
    found += _check_crossing(points, triangles)
    found += check_scale(size, hint="give the file's own unit, for example --unit m or --unit cm")
    return SurfaceTract(vertices=points, faces=triangles, source=source, findings=tuple(found))


def _check_arrays(vertices: ArrayLike, faces: ArrayLike, source: str) -> tuple[Vertices, Faces]:
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"vertices of {source} have shape {points.shape}: it must be (n, 3)")
    bad = int(np.count_nonzero(~np.isfinite(points).all(axis=1)))
    if bad:
        word = "vertex that is" if bad == 1 else "vertices that are"
        raise InputError(f"{source} has {bad} {word} not finite (NaN or infinite)")
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > FARTHEST:
        raise InputError(
            f"{source} has a coordinate of {farthest:.3g} mm: it must lie within {FARTHEST:g} mm"
        )
    if triangles.size == 0:
        raise InputError(f"{source} has no faces")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
        raise InputError(
            f"faces of {source} are {triangles.dtype} of shape {triangles.shape}: they must be "
            f"integers (m, 3)"
        )
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(
            f"faces of {source} point at vertices {triangles.min()} to {triangles.max()}: they "
            f"must lie in [0, {len(points) - 1}]"
        )
    return points, triangles.astype(np.int64)


def _drop_bad(triangles: Faces, found: list[Finding]) -> Faces:
    kept = _mesh.drop_degenerate(triangles)
    number = len(triangles) - len(kept)
    if number:
        message = f"{number} flat or doubled triangle(s) dropped"
        found.append(Finding("faces-dropped", "note", message))
    return kept


def _close(
    points: Vertices, triangles: Faces, size: float, found: list[Finding]
) -> tuple[Vertices, Faces]:
    """Weld nearly equal corners, then fill holes of three or four edges."""
    before = after = _count_open(triangles)
    welded, kept = _mesh.weld(points, triangles, tolerance=WELD * size)
    kept = _mesh.drop_degenerate(kept)
    if len(kept) and _count_open(kept) < before:
        points, triangles, after = welded, kept, _count_open(kept)
        message = f"corners within {WELD * size:.2g} mm welded: {before - after} open edges closed"
        found.append(Finding("corners-welded", "note", message))
    if after:
        points, triangles = _mesh.fill_small_holes(points, triangles)
        left = _count_open(triangles)
        if left < after:
            message = f"small holes filled: {after - left} open edges closed"
            found.append(Finding("holes-filled", "warning", message))
    return points, triangles


def _count_open(triangles: Faces) -> int:
    return int(np.count_nonzero(_mesh.count_edges(triangles).counts == 1))


def _refuse_open(points: Vertices, triangles: Faces, source: str) -> None:
    edges = _mesh.count_edges(triangles)
    open_edges = edges.pairs[edges.counts % 2 == 1]
    if len(open_edges) == 0:
        return
    loops = _mesh.label_parts(open_edges, len(points))
    middle = points[open_edges[loops == 0]].reshape(-1, 3).mean(axis=0)
    where = ", ".join(f"{value:.1f}" for value in middle)
    number = int(loops.max()) + 1
    raise GeometryError(
        f"{source} is open: {len(open_edges)} boundary edges in {number} "
        f"{'hole' if number == 1 else 'holes'}, near ({where}) mm; close it first, for example "
        f"by capping its ends"
    )


def _orient(points: Vertices, triangles: Faces, found: list[Finding]) -> Faces:
    turned, number = _mesh.agree(triangles, len(points))
    if number:
        message = f"{number} triangle(s) turned to agree with their neighbours"
        found.append(Finding("faces-turned", "note", message))
    if _mesh.measure_volume(points, turned) < 0:
        if not number:
            message = "the surface was turned inside out: all its triangles are turned outwards"
            found.append(Finding("surface-turned", "note", message))
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)


def _check_topology(triangles: Faces) -> list[Finding]:
    found = []
    edges = _mesh.count_edges(triangles)
    touching = int(np.count_nonzero(edges.counts > 2))
    fans, sheets = _mesh.count_fans(triangles)
    corners = len(np.unique(triangles))
    if touching or fans > corners:
        message = (
            f"the surface touches itself: {touching} edge(s) of more than two triangles, "
            f"{fans - corners} corner(s) that join separate sheets"
        )
        found.append(Finding("self-touching", "warning", message))
    # Taken apart where it touches itself, an edge of 2k triangles is k edges, a corner its fans.
    euler = fans - int((edges.counts // 2).sum()) + len(triangles)
    handles = sheets - euler // 2
    if handles > 0:
        word = "handle" if handles == 1 else "handles"
        message = f"{handles} {word} (the lumen closes on itself): ways around may be false"
        found.append(Finding("handles", "warning", message))
    return found


def _check_crossing(points: Vertices, triangles: Faces) -> list[Finding]:
    from ._kernels import count_crossing

    extent = np.ptp(points[triangles], axis=1).max(axis=1)
    # ... a cell of about two triangles; the kernel enlarges it where triangles differ much
    cell = max(2.0 * float(np.median(extent)), 1e-6 * float(np.ptp(points, axis=0).max()))
    number = int(np.count_nonzero(count_crossing(points, triangles, cell)))
    if not number:
        return []
    message = (
        f"the surface crosses itself: {number} triangles (only those that share no corner are "
        f"tested); inside and outside are not certain there"
    )
    return [Finding("self-crossing", "warning", message)]
