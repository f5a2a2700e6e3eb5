"""Numba: rays of a lens, and where they meet a board and tubes."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel

_STEPS = 12
_TRACE_STEPS = 200
_BLOCK = 16  # rays, each way, that are looked at together


@kernel
def undistort_grid(xs, ys, k1, k2, p1, p2, k3):
    """Return the undistorted (h, w, 2) points of a grid of distorted x (w,) and y (h,)."""
    out = np.empty((ys.size, xs.size, 2), np.float32)
    for i in range(ys.size):
        for j in range(xs.size):
            tx, ty = xs[j], ys[i]
            x, y = tx, ty
            for _ in range(_STEPS):
                r = x * x + y * y
                radial = 1.0 + r * (k1 + r * (k2 + r * k3))
                slope = 2.0 * (k1 + r * (2.0 * k2 + 3.0 * r * k3))
                ex = tx - (x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x))
                ey = ty - (y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y)
                xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
                xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
                yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
                size = xx * yy - xy * xy
                dx, dy = (yy * ex - xy * ey) / size, (xx * ey - xy * ex) / size
                x, y = x + dx, y + dy
                if dx * dx + dy * dy < 1e-20:
                    break
            out[i, j, 0], out[i, j, 1] = x, y
    return out


@kernel
def _square(points, i, x, y, z):
    return (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 + (points[i, 2] - z) ** 2


@kernel
def _nearest(points, x, y, z, stride, first, last):
    """Return (squared distance, segment, share of it) of the nearest point of a polyline.

    Looked at are the points `first` to `last`.
    """
    best, at = math.inf, first
    for i in range(first, last + 1, stride):
        d = _square(points, i, x, y, z)
        if d < best:
            best, at = d, i
    step = stride // 2
    while step > 0:  # halve the stride around the best point
        for i in (at - step, at + step):
            if first <= i <= last:
                d = _square(points, i, x, y, z)
                if d < best:
                    best, at = d, i
        step //= 2
    best, where, part = math.inf, 0, 0.0
    for i in range(max(at - 1, first), min(at + 1, last)):
        ax, ay, az = points[i, 0], points[i, 1], points[i, 2]
        bx, by, bz = points[i + 1, 0] - ax, points[i + 1, 1] - ay, points[i + 1, 2] - az
        u = ((x - ax) * bx + (y - ay) * by + (z - az) * bz) / (bx * bx + by * by + bz * bz)
        u = min(max(u, 0.0), 1.0)
        d = (ax + u * bx - x) ** 2 + (ay + u * by - y) ** 2 + (az + u * bz - z) ** 2
        if d < best:
            best, where, part = d, i, u
    return best, where, part


@kernel
def _bound(points, reach, origin, ray, stride, part):
    """Return where a ray may meet a tube: distances along it, and points of the polyline.

    The first distance is infinity if it does not meet it. `reach` is the radius and half the length
    between points a `stride` apart: what is met is in a ball about one of them. Looked at is a
    `part` of the balls, by number.
    """
    start, end, first, last = math.inf, 0.0, points.shape[0], 0
    n = points.shape[0]
    for ball in range(part[0], part[1]):
        k = min(ball * stride, n - 1)
        x, y, z = points[k, 0] - origin[0], points[k, 1] - origin[1], points[k, 2] - origin[2]
        along = x * ray[0] + y * ray[1] + z * ray[2]
        room = reach * reach - (x * x + y * y + z * z - along * along)
        if room > 0.0:
            half = math.sqrt(room)
            start, end = min(start, along - half), max(end, along + half)
            first, last = min(first, k), k
    return start, end, max(first - stride, 0), min(last + stride, n - 1)


@kernel
def _bound_block(points, reach, origin, corners, stride):
    """Return which balls of `_bound` a block of rays may meet: the first, and that after the last.

    `corners` (4, 3) are its outer rays, of length 1: the others are in a cone about their middle.
    """
    x, y, z = corners[:, 0].sum(), corners[:, 1].sum(), corners[:, 2].sum()
    size = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / size, y / size, z / size
    narrow = 1.0
    for k in range(4):
        narrow = min(narrow, x * corners[k, 0] + y * corners[k, 1] + z * corners[k, 2])
    angle = math.acos(narrow) + 1e-4
    n = points.shape[0]
    balls = (n + 2 * stride - 2) // stride
    first, last = balls, 0
    for ball in range(balls):
        k = min(ball * stride, n - 1)
        u, v, w = points[k, 0] - origin[0], points[k, 1] - origin[1], points[k, 2] - origin[2]
        away = math.sqrt(u * u + v * v + w * w)
        if away > reach:
            off = math.acos(min(max((u * x + v * y + w * z) / away, -1.0), 1.0))
            if off > angle + math.asin(reach / away):
                continue
        first, last = min(first, ball), ball + 1
    return first, last


@kernel
def _trace(points, radius, origin, ray, bounds, stride):
    """Return (distance along the ray, or infinity; segment; share of it) of the first hit.

    `bounds` is what `_bound` returns. Along a ray the distance from a straight tube is convex:
    Newton's steps reach its limb, too. None is longer than the gap and half a radius, so that no
    more than the limb of another part is passed over; what was passed is come back to.
    """
    t, end, first, last = bounds
    for _ in range(_TRACE_STEPS):
        x, y, z = origin[0] + t * ray[0], origin[1] + t * ray[1], origin[2] + t * ray[2]
        square, where, part = _nearest(points, x, y, z, stride, first, last)
        away = math.sqrt(square)
        gap = away - radius
        if abs(gap) < 1e-5:
            return t, where, part
        slope = 0.0
        for k, place in enumerate((x, y, z)):
            axis = points[where, k] + part * (points[where + 1, k] - points[where, k])
            slope += (place - axis) * ray[k] / away
        most = abs(gap) + 0.5 * radius
        t += math.copysign(most if slope * most > -abs(gap) else gap / slope, gap)
        if t > end:
            break
    return math.inf, 0, 0.0


@kernel
def _shade(albedo, point, normal, origin, light):
    """Return the light that a point sends to `origin`.

    `light` holds its place (3), the ambient and the diffuse part, the gloss and its exponent.
    """
    lx, ly, lz = light[0] - point[0], light[1] - point[1], light[2] - point[2]
    size = math.sqrt(lx * lx + ly * ly + lz * lz)
    lx, ly, lz = lx / size, ly / size, lz / size
    cosine = max(normal[0] * lx + normal[1] * ly + normal[2] * lz, 0.0)
    value = albedo * (light[3] + light[4] * cosine)
    if light[5] > 0.0 and cosine > 0.0:
        vx, vy, vz = origin[0] - point[0], origin[1] - point[1], origin[2] - point[2]
        size = math.sqrt(vx * vx + vy * vy + vz * vz)
        hx, hy, hz = lx + vx / size, ly + vy / size, lz + vz / size
        size = math.sqrt(hx * hx + hy * hy + hz * hz)
        half = (normal[0] * hx + normal[1] * hy + normal[2] * hz) / size
        value += light[5] * max(half, 0.0) ** light[6]
    return value


@kernel
def _cover(x, first, second):
    """Return the share of a rectangle, its middle at `x`, that is beyond a straight edge at 0.

    `first` and `second` are what its sides measure along the normal of the edge.
    """
    wide, narrow = max(first, second), min(first, second)
    if narrow < 1e-3 * wide:
        return min(max(x / max(wide, 1e-12) + 0.5, 0.0), 1.0)
    far, near = 0.5 * (wide + narrow), 0.5 * (wide - narrow)
    area = max(x + far, 0.0) ** 2 - max(x + near, 0.0) ** 2
    area += max(x - far, 0.0) ** 2 - max(x - near, 0.0) ** 2
    return min(max(0.5 * area / (wide * narrow), 0.0), 1.0)


@kernel
def render_plane(grid, turn, origin, texture, place, light, radiance, depth):
    """Draw the plane z = 0 into `radiance` and `depth` (h, w).

    `grid` (h, w, 2) are x/z and y/z of the rays, `turn` is the camera's rotation, `origin` its
    centre. `place` holds x and y of the texture's first texel and its texels a mm. Outside the
    texture there is nothing.
    """
    point, normal = np.zeros(3), np.zeros(3)
    normal[2] = math.copysign(1.0, origin[2])
    rows, columns = texture.shape
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            a, b = grid[i, j]
            z = a * turn[0, 2] + b * turn[1, 2] + turn[2, 2]
            if z * origin[2] >= 0.0:
                continue
            t = -origin[2] / z
            if t >= depth[i, j]:
                continue
            point[0] = origin[0] + t * (a * turn[0, 0] + b * turn[1, 0] + turn[2, 0])
            point[1] = origin[1] + t * (a * turn[0, 1] + b * turn[1, 1] + turn[2, 1])
            x, y = (point[0] - place[0]) * place[2], (point[1] - place[1]) * place[2]
            if not (0.0 <= x < columns - 1 and 0.0 <= y < rows - 1):
                continue
            c, r = int(x), int(y)
            u, v = x - c, y - r
            albedo = (1.0 - v) * ((1.0 - u) * texture[r, c] + u * texture[r, c + 1]) + v * (
                (1.0 - u) * texture[r + 1, c] + u * texture[r + 1, c + 1]
            )
            radiance[i, j] = _shade(albedo, point, normal, origin, light)
            depth[i, j] = t


@kernel
def render_tube(grid, region, turn, origin, points, lengths, radius, bands, light, radiance, depth):
    """Draw a tube about a polyline into `radiance` and `depth` (h, w), where it is nearer.

    `region` (y0, y1, x0, x1) is the part of the grid looked at.
    `bands` (m, 3) are ranges of arc length and their albedo, the first the tube's own. The edges of
    bands are exact: a ray counts the share of its cell of the grid that is within a band.
    """
    stride = 1
    while 24 * stride < points.shape[0]:
        stride *= 2
    near = radius
    for k in range(0, points.shape[0] - 1, stride):
        last = min(k + stride, points.shape[0] - 1)
        near = max(near, radius + 0.5 * (lengths[last] - lengths[k]))
    corners, balls = np.empty((4, 3)), (stride, near)
    for top in range(region[0], region[1], _BLOCK):
        for left in range(region[2], region[3], _BLOCK):
            block = top, min(top + _BLOCK, region[1]), left, min(left + _BLOCK, region[3])
            for k in range(4):
                a, b = grid[top if k < 2 else block[1] - 1, left if k % 2 else block[3] - 1]
                size = math.sqrt(a * a + b * b + 1.0)
                for m in range(3):
                    corners[k, m] = (a * turn[0, m] + b * turn[1, m] + turn[2, m]) / size
            part = _bound_block(points, near, origin, corners, stride)
            if part[0] < part[1]:
                tube = points, lengths, radius, bands
                _render_block(grid, block, turn, origin, tube, balls, part, light, radiance, depth)


@kernel
def _render_block(grid, block, turn, origin, tube, balls, part, light, radiance, depth):
    """Draw what a `block` of rays sees of a tube, which is in a `part` of its balls."""
    points, lengths, radius, bands = tube
    stride, near = balls
    ray, point, normal, along = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    rows, columns = grid.shape[:2]
    for i in range(block[0], block[1]):
        for j in range(block[2], block[3]):
            a, b = grid[i, j]
            size = math.sqrt(a * a + b * b + 1.0)
            for k in range(3):
                ray[k] = (a * turn[0, k] + b * turn[1, k] + turn[2, k]) / size
            bounds = _bound(points, near, origin, ray, stride, part)
            if not bounds[0] / size < depth[i, j]:
                continue
            t, where, share = _trace(points, radius, origin, ray, bounds, stride)
            if not t / size < depth[i, j]:
                continue
            piece = lengths[where + 1] - lengths[where]
            for k in range(3):
                point[k] = origin[k] + t * ray[k]
                along[k] = (points[where + 1, k] - points[where, k]) / piece
                axis = points[where, k] + share * piece * along[k]
                normal[k] = (point[k] - axis) / radius
            s = lengths[where] + share * piece
            # How far a cell of the grid reaches along the tube, on the plane that touches it.
            row, column = min(i, rows - 2), min(j, columns - 2)
            x = grid[row, column + 1, 0] - grid[row, column, 0]
            y = grid[row + 1, column, 1] - grid[row, column, 1]
            across, slope = 0.0, 0.0
            for k in range(3):
                across += normal[k] * ray[k]
                slope += along[k] * ray[k]
            slope /= min(across, -0.05)
            wide, high = 0.0, 0.0
            for k in range(3):
                wide += (along[k] - slope * normal[k]) * turn[0, k]
                high += (along[k] - slope * normal[k]) * turn[1, k]
            wide, high = abs(wide * x * t / size), abs(high * y * t / size)
            albedo = bands[0, 2]
            for k in range(1, bands.shape[0]):
                within = _cover(s - bands[k, 0], wide, high) - _cover(s - bands[k, 1], wide, high)
                albedo += within * (bands[k, 2] - albedo)
            radiance[i, j] = _shade(albedo, point, normal, origin, light)
            depth[i, j] = t / size
