"""Numba kernels: the union of balls along a line, triangles that cross, columns of voxels."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel


@kernel
def _cone_distance(px, py, pz, a, b, first, second):
    """Smallest ``|p - c| - r`` over the balls between two centres with linear radius.

    The expression is convex in the place s along the axis, so its free minimum, clamped to the
    segment, is the minimum.
    """
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = px - a[0], py - a[1], pz - a[2]
    length2 = ux * ux + uy * uy + uz * uz
    fall = second - first
    t = 0.0
    if length2 > fall * fall:
        length = math.sqrt(length2)
        along = (qx * ux + qy * uy + qz * uz) / length
        across2 = qx * qx + qy * qy + qz * qz - along * along
        slope = fall / length
        place = along + math.sqrt(max(across2, 0.0)) * slope / math.sqrt(1.0 - slope * slope)
        t = min(max(place / length, 0.0), 1.0)
    elif second > first:  # one ball holds the other: only the larger one counts
        t = 1.0
    dx, dy, dz = qx - t * ux, qy - t * uy, qz - t * uz
    return math.sqrt(dx * dx + dy * dy + dz * dz) - (first + t * fall)


@kernel
def measure_distance(points, centres, radii):
    """Return ``min(|p - c| - r)`` over all balls along the line, shape (n,)."""
    result = np.empty(len(points))
    for k in range(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        best = np.inf
        for j in range(len(centres) - 1):
            value = _cone_distance(x, y, z, centres[j], centres[j + 1], radii[j], radii[j + 1])
            best = min(best, value)
        result[k] = best
    return result


@kernel
def fill_distance(shape, origin, step, centres, radii, reach):
    """Sample the distance on a grid, within `reach` of the balls.

    Returns
    -------
    field : ndarray of float32, `shape`
        Distance, at most `reach`.
    owner : ndarray of int32, `shape`
        The piece of the line that is nearest in this distance, -1 beyond `reach`.
    """
    field = np.full(shape, np.float32(reach))
    owner = np.full(shape, np.int32(-1))
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for j in range(len(centres) - 1):
        for axis in range(3):
            near = min(centres[j, axis] - radii[j], centres[j + 1, axis] - radii[j + 1]) - reach
            far = max(centres[j, axis] + radii[j], centres[j + 1, axis] + radii[j + 1]) + reach
            low[axis] = max(math.ceil((near - origin[axis]) / step), 0)
            high[axis] = min(math.floor((far - origin[axis]) / step) + 1, shape[axis])
        a, b, first, second = centres[j], centres[j + 1], radii[j], radii[j + 1]
        for i0 in range(low[0], high[0]):
            x = origin[0] + i0 * step
            for i1 in range(low[1], high[1]):
                y = origin[1] + i1 * step
                for i2 in range(low[2], high[2]):
                    value = _cone_distance(x, y, origin[2] + i2 * step, a, b, first, second)
                    if value < field[i0, i1, i2]:
                        field[i0, i1, i2] = value
                        owner[i0, i1, i2] = j
    return field, owner


@kernel
def _volume(a, b, c, d):
    """Six times the signed volume of a tetrahedron."""
    bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    dx, dy, dz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return bx * (cy * dz - cz * dy) - by * (cx * dz - cz * dx) + bz * (cx * dy - cy * dx)


@kernel
def _edge_pierces(p, q, a, b, c):
    """Whether the open edge p-q crosses the inside of the triangle a-b-c."""
    if _volume(a, b, c, p) * _volume(a, b, c, q) >= 0.0:
        return False
    first, second, third = _volume(p, q, a, b), _volume(p, q, b, c), _volume(p, q, c, a)
    return (first > 0 and second > 0 and third > 0) or (first < 0 and second < 0 and third < 0)


@kernel
def _faces_cross(vertices, one, other):
    for i in range(3):
        for j in range(3):
            if one[i] == other[j]:
                return False
    for i in range(3):
        p, q = vertices[one[i]], vertices[one[(i + 1) % 3]]
        if _edge_pierces(p, q, vertices[other[0]], vertices[other[1]], vertices[other[2]]):
            return True
        p, q = vertices[other[i]], vertices[other[(i + 1) % 3]]
        if _edge_pierces(p, q, vertices[one[0]], vertices[one[1]], vertices[one[2]]):
            return True
    return False


@kernel
def _corners_along(vertices, face, axis):
    return vertices[face[0], axis], vertices[face[1], axis], vertices[face[2], axis]


@kernel
def _cell_ranges(vertices, faces, low, cell):
    ranges = np.empty((len(faces), 6), np.int64)
    total = 0
    for f in range(len(faces)):
        number = 1
        for axis in range(3):
            a, b, c = _corners_along(vertices, faces[f], axis)
            ranges[f, axis] = int((min(a, b, c) - low[axis]) / cell)
            ranges[f, 3 + axis] = int((max(a, b, c) - low[axis]) / cell) + 1
            number *= ranges[f, 3 + axis] - ranges[f, axis]
        total += number
    return ranges, total


@kernel
def cross_groups(vertices, faces, cell, group):
    """Return which triangles are crossed by one of another group (m,) that shares no corner.

    Triangles are sorted into the cells of a grid that their boxes meet; those that share a cell
    are compared. Touching and lying in one plane are not crossing.
    """
    low = np.array([vertices[:, axis].min() for axis in range(3)])
    high = np.array([vertices[:, axis].max() for axis in range(3)])
    ranges, total = _cell_ranges(vertices, faces, low, cell)
    while total > 16 * len(faces) + 1024:
        cell *= 1.5
        ranges, total = _cell_ranges(vertices, faces, low, cell)
    ny = int((high[1] - low[1]) / cell) + 2
    nz = int((high[2] - low[2]) / cell) + 2
    keys = np.empty(total, np.int64)
    items = np.empty(total, np.int64)
    n = 0
    for f in range(len(faces)):
        for i in range(ranges[f, 0], ranges[f, 3]):
            for j in range(ranges[f, 1], ranges[f, 4]):
                for k in range(ranges[f, 2], ranges[f, 5]):
                    keys[n] = (i * ny + j) * nz + k
                    items[n] = f
                    n += 1
    order = np.argsort(keys)
    least = np.empty((len(faces), 3))
    most = np.empty((len(faces), 3))
    for f in range(len(faces)):
        for axis in range(3):
            a, b, c = _corners_along(vertices, faces[f], axis)
            least[f, axis] = min(a, b, c)
            most[f, axis] = max(a, b, c)
    crossed = np.zeros(len(faces), np.bool_)
    begin = 0
    while begin < total:
        end = begin
        while end < total and keys[order[end]] == keys[order[begin]]:
            end += 1
        for i in range(begin, end):
            one = items[order[i]]
            for j in range(i + 1, end):
                other = items[order[j]]
                if (crossed[one] and crossed[other]) or group[one] == group[other]:
                    continue
                apart = False
                for axis in range(3):
                    if least[one, axis] > most[other, axis] or least[other, axis] > most[one, axis]:
                        apart = True
                        break
                if not apart and _faces_cross(vertices, faces[one], faces[other]):
                    crossed[one] = True
                    crossed[other] = True
        begin = end
    return crossed


@kernel
def _side(ax, ay, bx, by, x, y):
    """Return on which side of an edge a place lies, the same for both triangles of the edge."""
    turn = 1
    if ax > bx or (ax == bx and ay > by):
        ax, ay, bx, by = bx, by, ax, ay
        turn = -1
    return turn if (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0 else -turn


@kernel
def add_windings(corners, low, voxel, steps):
    """Add to each voxel how much the winding number changes on the way up to its centre.

    The sum along the last axis is the winding number of closed triangles about the centres.

    Parameters
    ----------
    corners : (m, 3, 3) float
        Triangles, outward [mm].
    low : (3,) float
        Centre of voxel (0, 0, 0) [mm].
    voxel
        Size of the voxels [mm].
    steps : (nx, ny, nz) int16
        Changed in place.
    """
    nx, ny, nz = steps.shape
    for f in range(len(corners)):
        ax, ay, az = corners[f, 0]
        bx, by, bz = corners[f, 1]
        cx, cy, cz = corners[f, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        first_x = max(int(math.floor((min(ax, bx, cx) - low[0]) / voxel)), 0)
        last_x = min(int(math.ceil((max(ax, bx, cx) - low[0]) / voxel)), nx - 1)
        first_y = max(int(math.floor((min(ay, by, cy) - low[1]) / voxel)), 0)
        last_y = min(int(math.ceil((max(ay, by, cy) - low[1]) / voxel)), ny - 1)
        bottom, top = min(az, bz, cz), max(az, bz, cz)
        for i in range(first_x, last_x + 1):
            x = low[0] + i * voxel
            for j in range(first_y, last_y + 1):
                y = low[1] + j * voxel
                side = _side(ax, ay, bx, by, x, y)
                if _side(bx, by, cx, cy, x, y) != side or _side(cx, cy, ax, ay, x, y) != side:
                    continue
                u = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                v = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                z = min(max(az + u * (bz - az) + v * (cz - az), bottom), top)
                k = min(max(int(math.ceil((z - low[2]) / voxel)), 0), nz - 1)
                steps[i, j, k] -= side
