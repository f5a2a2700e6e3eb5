"""Numba: all analytic shapes as one family, so that a planner's kernels compile once for them.

``<kind>_value(params, first, x, y, z)`` is the signed value of a shape at a point, 1-Lipschitz:
inside (negative) never deeper than the wall is far, outside never farther than the shape.
``<kind>_slope`` is the value with its gradient. Each shape is a slice of one flat array of numbers,
laid out by the `numbers` of its class; planar ones ignore z. A new kind has a code here, and a
branch in `shape_value` and `shape_slope`.

A duct of the family (`packed.ShapesData`) is the union of its lumen shapes without its obstacles.
With v_i the value of shape i, R_i and c_i its bounding ball and

    d_i = max(v_i, |x - c_i| - R_i) - o_i

the value of the duct is ``max(min d_i over the lumen, max -d_i over the obstacles)``. Both terms
of d_i are at most the distance outside and at least minus the depth inside, so the ball may only
sharpen a bound, and a ball farther than the best so far can be passed over without any change.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from .cylinders import cylinder_chain_slope, cylinder_chain_value

SUPER_ELLIPSE = 0
CIRCLE = 2
POLYGON = 3
SUPER_ELLIPSOID = 10
CYLINDER_CHAIN = 11
HALF_SPACES = 12
ROUND_CONE = 14


@kernel
def power_norm(a, b, p):
    """(a^p + b^p)^(1/p) of two numbers >= 0, without overflow."""
    big = max(a, b)
    small = min(a, b)
    if big == 0.0:
        return 0.0
    if p == 2.0:
        return math.sqrt(big * big + small * small)
    if p == 1.0:
        return big + small
    return big * math.exp(math.log1p((small / big) ** p) / p)


@kernel
def super_ellipse_value(params, first, x, y, z):
    """Least radius times (gauge - 1).

    Slice: centre (2), cosine and sine of the angle, half axes (2), power, least radius.
    """
    dx = x - params[first]
    dy = y - params[first + 1]
    u = abs(params[first + 2] * dx + params[first + 3] * dy) / params[first + 4]
    v = abs(params[first + 2] * dy - params[first + 3] * dx) / params[first + 5]
    return params[first + 7] * (power_norm(u, v, params[first + 6]) - 1.0)


@kernel
def super_ellipse_slope(params, first, x, y, z):
    """The same with its gradient; zero at the centre, where it has all of them."""
    dx = x - params[first]
    dy = y - params[first + 1]
    c = params[first + 2]
    s = params[first + 3]
    a = params[first + 4]
    b = params[first + 5]
    p = params[first + 6]
    least = params[first + 7]
    along = c * dx + s * dy
    across = c * dy - s * dx
    u = abs(along) / a
    v = abs(across) / b
    gauge = power_norm(u, v, p)
    if gauge == 0.0:
        return -least, 0.0, 0.0, 0.0
    # d|.|_p / du = (u / |.|_p)^(p - 1); a power of 0 may be 1, which the sign of 0 undoes.
    gu = least * (u / gauge) ** (p - 1.0) / a * np.sign(along)
    gv = least * (v / gauge) ** (p - 1.0) / b * np.sign(across)
    return least * (gauge - 1.0), c * gu - s * gv, s * gu + c * gv, 0.0


@kernel
def circle_value(params, first, x, y, z):
    """Signed distance to a circle. Slice: centre (2), radius."""
    dx = x - params[first]
    dy = y - params[first + 1]
    return math.sqrt(dx * dx + dy * dy) - params[first + 2]


@kernel
def circle_slope(params, first, x, y, z):
    """The same with its gradient; zero at the centre."""
    dx = x - params[first]
    dy = y - params[first + 1]
    away = math.sqrt(dx * dx + dy * dy)
    if away < 1e-300:
        return -params[first + 2], 0.0, 0.0, 0.0
    return away - params[first + 2], dx / away, dy / away, 0.0


@kernel(inline="always")
def _nearest_edge(params, first, x, y):
    """Return (signed distance, where the nearest edge is in the slice): sign by crossings."""
    count = int(params[first])
    edges = params[first + 1 : first + 1 + 5 * count].reshape(count, 5)
    best = np.inf
    index = 0
    inside = False
    for i in range(count):
        ax = edges[i, 0]
        ay = edges[i, 1]
        ex = edges[i, 2] - ax
        ey = edges[i, 3] - ay
        wx = x - ax
        wy = y - ay
        u = min(max((wx * ex + wy * ey) * edges[i, 4], 0.0), 1.0)
        gap = (wx - u * ex) ** 2 + (wy - u * ey) ** 2
        if gap < best:
            best = gap
            index = i
        if (ay > y) != (edges[i, 3] > y):
            turn = ex * wy - ey * wx
            if (turn > 0.0) == (ey > 0.0):
                inside = not inside
    s = math.sqrt(best)
    return (-s if inside else s), first + 1 + 5 * index


@kernel(inline="always")
def outline_value(params, first, x, y, z):
    """Exact signed distance to a simple polygon, counter-clockwise.

    Slice: how many edges, then start (2), end (2) and 1 / length squared of each.
    """
    s, _ = _nearest_edge(params, first, x, y)
    return s


@kernel
def outline_slope(params, first, x, y, z):
    """The same with its gradient."""
    s, at = _nearest_edge(params, first, x, y)
    ax = params[at]
    ay = params[at + 1]
    ex = params[at + 2] - ax
    ey = params[at + 3] - ay
    if abs(s) < 1e-12:
        scale = math.sqrt(params[at + 4])
        return s, ey * scale, -ex * scale, 0.0
    wx = x - ax
    wy = y - ay
    u = min(max((wx * ex + wy * ey) * params[at + 4], 0.0), 1.0)
    return s, (wx - u * ex) / s, (wy - u * ey) / s, 0.0


@kernel
def _turn_into_frame(params, first, x, y, z):
    """Return the coordinates of a point along a super-ellipsoid's own axes."""
    dx = x - params[first]
    dy = y - params[first + 1]
    dz = z - params[first + 2]
    u = params[first + 3] * dx + params[first + 6] * dy + params[first + 9] * dz
    v = params[first + 4] * dx + params[first + 7] * dy + params[first + 10] * dz
    w = params[first + 5] * dx + params[first + 8] * dy + params[first + 11] * dz
    return u, v, w


@kernel
def super_ellipsoid_value(params, first, x, y, z):
    """Least radius times (gauge - 1).

    Slice: centre (3), axes as columns of a rotation (9, row by row), half axes (3), the inner
    power 2 / e2, the outer power 2 / e1, and the least radius.
    """
    u, v, w = _turn_into_frame(params, first, x, y, z)
    flat = power_norm(abs(u) / params[first + 12], abs(v) / params[first + 13], params[first + 15])
    gauge = power_norm(flat, abs(w) / params[first + 14], params[first + 16])
    return params[first + 17] * (gauge - 1.0)


@kernel
def super_ellipsoid_slope(params, first, x, y, z):
    """The same with its gradient; zero at the centre, where it has all of them."""
    u, v, w = _turn_into_frame(params, first, x, y, z)
    a = params[first + 12]
    b = params[first + 13]
    c = params[first + 14]
    inner = params[first + 15]
    outer = params[first + 16]
    least = params[first + 17]
    flat = power_norm(abs(u) / a, abs(v) / b, inner)
    tall = abs(w) / c
    gauge = power_norm(flat, tall, outer)
    if gauge == 0.0:
        return -least, 0.0, 0.0, 0.0
    # d|.|_p / da = (a / |.|_p)^(p - 1); a power of 0 is 1, which the sign of 0 below undoes.
    across = (flat / gauge) ** (outer - 1.0)
    gu = gv = 0.0
    if flat > 0.0:
        gu = across * (abs(u) / a / flat) ** (inner - 1.0) / a * np.sign(u)
        gv = across * (abs(v) / b / flat) ** (inner - 1.0) / b * np.sign(v)
    gw = (tall / gauge) ** (outer - 1.0) / c * np.sign(w)
    gx = params[first + 3] * gu + params[first + 4] * gv + params[first + 5] * gw
    gy = params[first + 6] * gu + params[first + 7] * gv + params[first + 8] * gw
    gz = params[first + 9] * gu + params[first + 10] * gv + params[first + 11] * gw
    return least * (gauge - 1.0), least * gx, least * gy, least * gz


@kernel
def half_spaces_value(params, first, x, y, z):
    """Largest signed distance to the planes of a convex polyhedron.

    Slice: how many planes, then outward unit normal (3) and offset of each; inside a plane is
    where normal . x + offset < 0.
    """
    best = -np.inf
    at = first + 1
    for _ in range(int(params[first])):
        best = max(best, params[at] * x + params[at + 1] * y + params[at + 2] * z + params[at + 3])
        at += 4
    return best


@kernel
def half_spaces_slope(params, first, x, y, z):
    """The same with its gradient: the normal of the plane that decides."""
    best = -np.inf
    at = first + 1
    index = at
    for _ in range(int(params[first])):
        s = params[at] * x + params[at + 1] * y + params[at + 2] * z + params[at + 3]
        if s > best:
            best = s
            index = at
        at += 4
    return best, params[index], params[index + 1], params[index + 2]


@kernel(inline="always")
def _round_cone_place(params, first, x, y, z):
    """Return (along, off, place): coordinates from the first ball, and the nearest ball's."""
    dx = x - params[first]
    dy = y - params[first + 1]
    dz = z - params[first + 2]
    along = dx * params[first + 3] + dy * params[first + 4] + dz * params[first + 5]
    ox = dx - along * params[first + 3]
    oy = dy - along * params[first + 4]
    oz = dz - along * params[first + 5]
    off = math.sqrt(ox * ox + oy * oy + oz * oz)
    return along, off, along - off * params[first + 7] / params[first + 8]


@kernel(inline="always")
def round_cone_value(params, first, x, y, z):
    """Exact signed distance to the hull of two balls.

    Slice: start (3), axis (3), length, sine and
    cosine of the half angle, both radii.
    """
    along, off, place = _round_cone_place(params, first, x, y, z)
    size = params[first + 6]
    if place <= 0.0:
        return math.sqrt(off * off + along * along) - params[first + 9]
    if place >= size:
        return math.sqrt(off * off + (along - size) ** 2) - params[first + 10]
    return off * params[first + 8] + along * params[first + 7] - params[first + 9]


@kernel
def round_cone_slope(params, first, x, y, z):
    """The same with its gradient; on the axis the mean of all that meet."""
    along, off, place = _round_cone_place(params, first, x, y, z)
    ux = params[first + 3]
    uy = params[first + 4]
    uz = params[first + 5]
    size = params[first + 6]
    sine = params[first + 7]
    cosine = params[first + 8]
    ox = x - params[first] - along * ux
    oy = y - params[first + 1] - along * uy
    oz = z - params[first + 2] - along * uz
    if 0.0 < place < size:
        radial = cosine / off if off > 1e-12 else 0.0
        value = off * cosine + along * sine - params[first + 9]
        return value, radial * ox + sine * ux, radial * oy + sine * uy, radial * oz + sine * uz
    rest = along if place <= 0.0 else along - size
    radius = params[first + 9] if place <= 0.0 else params[first + 10]
    gx = ox + rest * ux
    gy = oy + rest * uy
    gz = oz + rest * uz
    norm = math.sqrt(gx * gx + gy * gy + gz * gz)
    if norm < 1e-12:
        return norm - radius, 0.0, 0.0, 0.0
    return norm - radius, gx / norm, gy / norm, gz / norm


@kernel
def shape_value(kind, params, first, x, y, z):
    """Signed value of one shape."""
    if kind == ROUND_CONE:
        return round_cone_value(params, first, x, y, z)
    if kind == SUPER_ELLIPSE:
        return super_ellipse_value(params, first, x, y, z)
    if kind == CIRCLE:
        return circle_value(params, first, x, y, z)
    if kind == POLYGON:
        return outline_value(params, first, x, y, z)
    if kind == SUPER_ELLIPSOID:
        return super_ellipsoid_value(params, first, x, y, z)
    if kind == CYLINDER_CHAIN:
        return cylinder_chain_value(params, first, x, y, z)
    if kind == HALF_SPACES:
        return half_spaces_value(params, first, x, y, z)
    return round_cone_value(params, first, x, y, z)


@kernel
def shape_slope(kind, params, first, x, y, z):
    """Signed value of one shape with its gradient."""
    if kind == ROUND_CONE:
        return round_cone_slope(params, first, x, y, z)
    if kind == SUPER_ELLIPSE:
        return super_ellipse_slope(params, first, x, y, z)
    if kind == CIRCLE:
        return circle_slope(params, first, x, y, z)
    if kind == POLYGON:
        return outline_slope(params, first, x, y, z)
    if kind == SUPER_ELLIPSOID:
        return super_ellipsoid_slope(params, first, x, y, z)
    if kind == CYLINDER_CHAIN:
        return cylinder_chain_slope(params, first, x, y, z)
    if kind == HALF_SPACES:
        return half_spaces_slope(params, first, x, y, z)
    return round_cone_slope(params, first, x, y, z)


@kernel
def inflate_shapes(table, params, inflation):
    """Move the walls of all shapes outwards by at most `inflation`, in place.

    Where the value outside is the distance, by the inflation c. Where it is only a lower bound,
    the shape {v <= c} would reach farther than c beyond the wall; {v <= c r / R} does not, r the
    depth of v at the ball's centre and R the ball's radius, because v is convex. A chain of
    cylinders is nearer than its value by its tolerance.
    """
    for i in range(table.shape[0]):
        kind = int(table[i, 5])
        first = int(table[i, 6])
        more = inflation
        if kind == CYLINDER_CHAIN:
            more = max(inflation - params[first + 1], 0.0)
        elif kind == SUPER_ELLIPSE or kind == SUPER_ELLIPSOID or kind == HALF_SPACES:
            depth = -shape_value(kind, params, first, table[i, 0], table[i, 1], table[i, 2])
            more *= min(max(depth / table[i, 3], 0.0), 1.0)
        table[i, 4] += more


@kernel(inline="always")
def _off_ball(balls, i, x, y, z):
    """Square of the distance to the centre of a bounding ball."""
    dx = x - balls[i, 0]
    dy = y - balls[i, 1]
    dz = z - balls[i, 2]
    return dx * dx + dy * dy + dz * dz


@kernel(inline="always")
def _measure_shape(table, params, i, square, x, y, z):
    """Value of a shape with its ball and its offset; `square` is that of the ball's centre."""
    kind = int(table[i, 5])
    first = int(table[i, 6])
    if kind == ROUND_CONE:  # saves the call, which counts here
        return round_cone_value(params, first, x, y, z) - table[i, 4]
    value = shape_value(kind, params, first, x, y, z)
    return max(value, math.sqrt(square) - table[i, 3]) - table[i, 4]


@kernel
def nearest_shape(table, params, blocks, x, y, z):
    """Return (value, i): the value at a point, and the shape that decides it.

    The shape that is probably the nearest comes first: by the powers of balls, without roots.
    """
    count = blocks.shape[0]
    if table.shape[0] == 1:
        return _measure_shape(table, params, 0, _off_ball(table, 0, x, y, z), x, y, z), 0
    first = 0
    least = np.inf
    for b in range(count):
        gap = _off_ball(blocks, b, x, y, z) - blocks[b, 3] * blocks[b, 3]
        if gap < least:
            least = gap
            first = b
    start = int(blocks[first, 4])
    least = np.inf
    for i in range(start, int(blocks[first, 5])):
        gap = _off_ball(table, i, x, y, z) - table[i, 3] * table[i, 3]
        if gap < least:
            least = gap
            start = i
    best = _measure_shape(table, params, start, _off_ball(table, start, x, y, z), x, y, z)
    index = start
    for n in range(count):
        b = first + n
        if b >= count:
            b -= count
        if n > 0:
            reach = best + blocks[b, 3]
            if reach <= 0.0 or _off_ball(blocks, b, x, y, z) >= reach * reach:
                continue
        for i in range(int(blocks[b, 4]), int(blocks[b, 5])):
            square = _off_ball(table, i, x, y, z)
            reach = best + table[i, 3] + table[i, 4]
            if i == start or reach <= 0.0 or square >= reach * reach:
                continue
            value = _measure_shape(table, params, i, square, x, y, z)
            if value < best:
                best = value
                index = i
    for i in range(int(blocks[count - 1, 5]), table.shape[0]):  # the obstacles
        square = _off_ball(table, i, x, y, z)
        reach = table[i, 3] + table[i, 4] - best
        if reach <= 0.0 or square >= reach * reach:
            continue
        value = -_measure_shape(table, params, i, square, x, y, z)
        if value > best:
            best = value
            index = i
    return best, index


@kernel
def family_estimate(duct, x, y, z):
    """Clearance: never more than there is, but for rounding."""
    return -nearest_shape(duct.table, duct.params, duct.blocks, x, y, z * duct.upright)[0]


@kernel
def family_bound(duct, x, y, z):
    """The same less the rounding error."""
    value, _ = nearest_shape(duct.table, duct.params, duct.blocks, x, y, z * duct.upright)
    return -value - duct.slack


@kernel
def family_slope(duct, x, y, z):
    """Clearance and its gradient."""
    table = duct.table
    z *= duct.upright
    value, i = np.inf, 0
    if table.shape[0] > 1:
        value, i = nearest_shape(table, duct.params, duct.blocks, x, y, z)
    own, gx, gy, gz = shape_slope(int(table[i, 5]), duct.params, int(table[i, 6]), x, y, z)
    away = math.sqrt(_off_ball(table, i, x, y, z))
    if table.shape[0] == 1:
        value = max(own, away - table[i, 3]) - table[i, 4]
    if away - table[i, 3] > own:
        gx = (x - table[i, 0]) / away
        gy = (y - table[i, 1]) / away
        gz = (z - table[i, 2]) / away
    if table[i, 7] > 0.0:
        return -value, gx, gy, gz
    return -value, -gx, -gy, -gz
