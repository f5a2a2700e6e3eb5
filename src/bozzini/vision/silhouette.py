"""The silhouette of a bright tube on a dark ground: its centreline in one picture, and its rings.

The tube carries a dark ring near both ends, which cut the silhouette. What lies between them is the
tube; pieces of it that something else separates are joined again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError, MissingExtraError
from ..numeric.arrays import Floats
from ..numeric.polylines import measure_arc_length, resample_polyline
from .pictures import Grey, Picture, import_opencv

LEAST_CONTRAST = 5.0
"""Brightness of the tube over the ground, in standard deviations of the ground's noise."""
BLURRED_CONTRAST = 10.0
"""Below this the picture is blurred before it is measured."""

BLUR = 1.5
"""Standard deviation of the blur for that, and before the threshold [px]."""

_THUMB = 14.0
"""Width of the tube in the reduced picture that is thinned to a skeleton [px]."""
_PART = 1.2
"""A piece is a part of the tube if it is this many times as long as it is wide."""
_REACH = 1.7
"""How far beyond the silhouette's end a ring is looked for, in widths."""
_QUANTUM = 0.5 / 255.0
"""Least noise: half a step of 8 bits."""


@dataclass(frozen=True, eq=False)
class Silhouette:
    """A tube in one picture.

    Attributes
    ----------
    line : ndarray, shape (n, 2)
        Its centreline, a point each few pixels, on beyond its ends [px].
    width : float
        Median width [px].
    rings : ndarray, shape (2,)
        Where on the line the rings at its start and end are [px]; NaN where there is none.
    ends : ndarray, shape (2,)
        Where on the line the silhouette starts and ends [px].
    parts : int
        Pieces it was made of.
    contrast : float
        Brightness over the ground, in standard deviations of the noise.
    noise : float
        Standard deviation of the ground.
    saturated : float
        Share of the tube's pixels with the largest value possible.
    lit : ndarray of bool, shape (n,)
        Where the line is on the silhouette: not on a ring, or what covers the tube.
    blurred : bool
        Whether the picture must be blurred before it is measured: its contrast is low.
    """

    line: Floats
    width: float
    rings: Floats
    ends: Floats
    parts: int
    contrast: float
    noise: float
    saturated: float
    lit: NDArray[np.bool_]
    blurred: bool

    def reverse(self) -> Silhouette:
        """Return the same with the line from its end to its start."""
        total = measure_arc_length(self.line)[-1]
        return Silhouette(
            self.line[::-1],
            self.width,
            total - self.rings[::-1],
            total - self.ends[::-1],
            self.parts,
            self.contrast,
            self.noise,
            self.saturated,
            self.lit[::-1],
            self.blurred,
        )


def find_silhouette(picture: Picture) -> Silhouette:
    """Find the centreline of the tube in a picture.

    Raises
    ------
    GeometryError
        If there is no bright, long thing on a dark ground.
    """
    cv2 = import_opencv()
    try:
        from skimage.filters import threshold_otsu
    except ImportError:
        raise MissingExtraError("scikit-image", "vision") from None
    values = picture.values
    smooth = cv2.GaussianBlur(values, (0, 0), BLUR)
    if np.ptp(smooth) < 4.0 * _QUANTUM:
        raise GeometryError(f"{picture.name}: no silhouette: the picture has no contrast")
    level = float(threshold_otsu(smooth))
    mask = cv2.morphologyEx(
        (smooth > level).astype(np.uint8), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8)
    )
    contrast, noise = _measure_contrast(values, mask)
    blurred = contrast < BLURRED_CONTRAST
    if blurred:
        contrast, noise = _measure_contrast(smooth, mask)
    if contrast < LEAST_CONTRAST:
        raise GeometryError(
            f"{picture.name}: no silhouette: the contrast is {contrast:.1f} times the noise, at "
            f"least {LEAST_CONTRAST:g} is needed"
        )
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    areas = boxes[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < 100:
        raise GeometryError(f"{picture.name}: no silhouette: nothing bright is large enough")
    pieces = []
    for k in 1 + np.argsort(-areas):
        if areas[k - 1] < 0.02 * areas.max():
            break
        x, y, w, h = boxes[k, :4]
        piece = _trace_part(labels[y : y + h, x : x + w] == k)
        if piece is not None:
            line, width = piece
            pieces.append(_centre_line(smooth, line + (x, y), width))
    if not pieces:
        raise GeometryError(f"{picture.name}: no silhouette: nothing bright is long and thin")
    line, parts = _join_parts(pieces)
    width = float(np.median(pieces[0][1]))
    line, ends = _extend(line, width)
    rings = np.array([_find_ring(smooth, level, line[::-1], width), 0.0])
    rings[1] = measure_arc_length(line)[-1] - _find_ring(smooth, level, line, width)
    full = 1.0 - 0.5 / (2**picture.bits - 1)
    saturated = float(np.mean(picture.values[mask > 0] >= full))
    lit = sample_values(mask, line) > 0.5
    return Silhouette(line, width, rings, ends, parts, contrast, noise, saturated, lit, blurred)


def _measure_contrast(values: Grey, mask: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the brightness over the ground, in standard deviations of its noise, and those."""
    if not 0 < int(mask.sum()) < mask.size:
        return 0.0, _QUANTUM
    ground = values[mask == 0]
    middle = float(np.median(ground))
    noise = max(1.4826 * float(np.median(np.abs(ground - middle))), _QUANTUM)
    return (float(np.median(values[mask > 0])) - middle) / noise, noise


def _trace_part(mask: NDArray[np.bool_]) -> tuple[Floats, float] | None:
    """Return the longest way through a piece, without its ends, and its width; None if short."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from skimage.morphology import skeletonize

    cv2 = import_opencv()
    padded = np.pad(mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    step = max(1, int(2.0 * depth.max() / _THUMB))
    rows, columns = (n // step * step for n in mask.shape)
    if min(rows, columns) == 0:
        return None
    cells = mask[:rows, :columns].reshape(rows // step, step, columns // step, step)
    thin = skeletonize(np.pad(cells.mean(axis=(1, 3)) > 0.5, 1))[1:-1, 1:-1]
    places = np.argwhere(thin)
    if len(places) < 3:
        return None
    number = np.full((thin.shape[0] + 2, thin.shape[1] + 2), -1)
    number[places[:, 0] + 1, places[:, 1] + 1] = np.arange(len(places))
    links = []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = number[places[:, 0] + 1 + dy, places[:, 1] + 1 + dx]
        near = np.flatnonzero(other >= 0)
        links.append(np.stack([near, other[near], np.full(len(near), math.hypot(dy, dx))]))
    first, second, length = np.concatenate(links, axis=1)
    ends = first.astype(np.int32), second.astype(np.int32)  # SciPy 1.13 takes no other
    graph = coo_array((length, ends), (len(places),) * 2).tocsr()
    far = dijkstra(graph, directed=False, indices=0)
    start = int(np.argmax(np.where(np.isfinite(far), far, -1.0)))
    far, back = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    at = int(np.argmax(np.where(np.isfinite(far), far, -1.0)))
    way = [at]
    while back[at] >= 0:
        at = int(back[at])
        way.append(at)
    line: Floats = (places[way][:, ::-1].astype(float) + 0.5) * step - 0.5
    inner = np.round(line[len(line) // 4 : -(len(line) // 4) or None]).astype(int)
    inner = np.minimum(inner, np.array(mask.shape[::-1]) - 1)
    width = 2.0 * float(np.median(depth[inner[:, 1], inner[:, 0]]))
    arc = measure_arc_length(line)
    kept = line[(arc > 0.6 * width) & (arc < arc[-1] - 0.6 * width)]
    if arc[-1] + 0.5 * width < _PART * width or len(kept) < 4:
        return None
    return kept, width


def _smooth(line: Floats, length: float, spacing: float) -> Floats:
    """Return a line smoothed over a length, its ends extended so that they do not shrink."""
    from scipy.ndimage import gaussian_filter1d

    reach = max(1, min(math.ceil(2.0 * length / spacing), len(line) - 1))
    head = 2.0 * line[0] - line[reach:0:-1]
    tail = 2.0 * line[-1] - line[-2 : -reach - 2 : -1]
    both = gaussian_filter1d(np.vstack([head, line, tail]), length / spacing, axis=0)
    return np.asarray(both[reach : reach + len(line)])


def _normals(line: Floats) -> Floats:
    """Return unit normals (n, 2) of a line, to the left of its way in a picture with y down."""
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def sample_values(values: NDArray[np.floating], pixels: Floats, order: int = 1) -> Floats:
    """Return the values of a picture at pixels (..., 2); outside, those of its border."""
    from scipy.ndimage import map_coordinates

    flat = pixels.reshape(-1, 2)
    found = map_coordinates(
        values, [flat[:, 1], flat[:, 0]], order=order, mode="nearest", prefilter=False
    )
    return np.asarray(found, dtype=float).reshape(pixels.shape[:-1])


def _centre_line(smooth: Grey, line: Floats, width: float) -> tuple[Floats, Floats]:
    """Return a line moved to the middle between both edges, a point each 3 px, and its widths."""
    spacing = 3.0
    line = _smooth(resample_polyline(line, spacing), 0.5 * width, spacing)
    offsets = np.arange(0.2 * width, 0.85 * width, 0.5)
    for _ in range(3):
        line = resample_polyline(line, spacing)
        normals = _normals(line)
        sides = [
            _find_fall(
                sample_values(smooth, line[:, None] + offsets[:, None] * sign * normals[:, None])
            )
            * 0.5
            + offsets[0]
            for sign in (1.0, -1.0)
        ]
        widths = sides[0] + sides[1]
        middle = float(np.median(widths))
        good = np.abs(widths - middle) < 0.05 * middle
        known = np.flatnonzero(good)
        if len(known) < 4:
            return line, np.full(len(line), width)
        shift = np.interp(np.arange(len(line)), known, 0.5 * (sides[0] - sides[1])[known])
        moved = (line + shift[:, None] * normals)[known[0] : known[-1] + 1]
        line = _smooth(moved, 0.15 * width, spacing)
    return line, widths[known[0] : known[-1] + 1]


def _find_fall(profiles: Floats) -> Floats:
    """Return the index, with a fraction, of the steepest fall of each profile (n, m)."""
    fall = profiles[:, :-1] - profiles[:, 1:]
    at = np.clip(fall.argmax(axis=1), 1, fall.shape[1] - 2)
    i = np.arange(len(fall))
    low, mid, high = fall[i, at - 1], fall[i, at], fall[i, at + 1]
    curve = low - 2.0 * mid + high
    shift = np.divide(0.5 * (low - high), curve, where=curve < 0.0, out=np.zeros(len(i)))
    return np.asarray(at + 0.5 + np.clip(shift, -1.0, 1.0))


def _join_parts(pieces: list[tuple[Floats, Floats]]) -> tuple[Floats, int]:
    """Return one line through the largest piece and those that go on from it, and their count."""
    line, widths = pieces[0]
    width = float(np.median(widths))
    left = [piece for piece, own in pieces[1:] if abs(np.median(own) / width - 1.0) < 0.4]
    count = 1
    while left:
        best = None
        for k, piece in enumerate(left):
            for turned in (False, True):
                for front in (False, True):
                    chain = line[::-1] if front else line
                    other = piece[::-1] if turned else piece
                    gap = other[0] - chain[-1]
                    size = float(np.linalg.norm(gap))
                    out = chain[-1] - chain[-min(len(chain), 8)]
                    into = other[min(len(other), 8) - 1] - other[0]
                    straight = min(_cosine(out, gap), _cosine(gap, into))
                    if straight > 0.7 and size < 6.0 * width and (best is None or size < best[0]):
                        best = size, k, chain, other
        if best is None:
            break
        _, k, chain, other = best
        del left[k]
        line, count = np.vstack([chain, other]), count + 1
    if count > 1:
        line = _smooth(resample_polyline(line, 3.0), 0.3 * width, 3.0)
    return line, count


def _cosine(a: Floats, b: Floats) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0.0 else 1.0


def _extend(line: Floats, width: float) -> tuple[Floats, Floats]:
    """Return a line continued at both ends, and where its silhouette started and ended on it."""
    spacing, reach = 3.0, _REACH * width
    grown = []
    for end in (line[::-1], line):
        arc = measure_arc_length(end)
        part = arc > arc[-1] - 1.5 * width
        local = arc[part] - arc[-1]
        degree = 2 if part.sum() > 6 else 1
        beyond = np.arange(spacing, reach, spacing)
        grown.append(
            np.stack(
                [
                    end[-1, k] + np.polyval(fit, beyond) - np.polyval(fit, 0.0)
                    for k in range(2)
                    for fit in [np.polyfit(local, end[part, k], degree)]
                ],
                axis=1,
            )
        )
    whole = np.vstack([grown[0][::-1], line, grown[1]])
    arc = measure_arc_length(whole)
    first, last = len(grown[0]), len(grown[0]) + len(line) - 1
    return whole, arc[[first, last]] + np.array([-0.5, 0.5]) * width


def _find_ring(smooth: Grey, level: float, line: Floats, width: float) -> float:
    """Return how far from the end of a line a ring is, the middle of a dark band [px], or NaN."""
    fine = resample_polyline(line, 0.5)
    arc = measure_arc_length(fine)
    start = arc[-1] - _REACH * width - 0.3 * width
    part = arc > start
    points, normals = fine[part], _normals(fine)[part]
    offsets = 0.2 * width * np.linspace(-1.0, 1.0, 5)
    profile = sample_values(smooth, points[:, None] + offsets[:, None] * normals[:, None]).mean(
        axis=1
    )
    dark = profile < level
    if dark[0] or not dark.any():
        return math.nan
    first = int(dark.argmax())
    again = int((~dark[first:]).argmax())
    if again == 0:
        return math.nan
    along = arc[part]
    wide = along[first + again] - along[first]
    if not 0.05 * width < wide < 0.9 * width:
        return math.nan
    return float(arc[-1] - 0.5 * (along[first + again] + along[first]))
