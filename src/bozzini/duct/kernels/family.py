"""Numba: all analytic shapes as one family, so that a planner's kernels compile once for them.

A duct of the family is the union of its lumen shapes without its obstacles. With v_i the value of
shape i (the 1-Lipschitz kernels of `_planar_kernels`, `_solid_kernels`, `_cylinder_kernels`), R_i
and c_i its bounding ball and

    d_i = max(v_i, |x - c_i| - R_i) - o_i

the value of the duct is ``max(min d_i over the lumen, max -d_i over the obstacles)``. Both terms
of d_i are at most the distance outside and at least minus the depth inside, so the ball may only
sharpen a bound, and a ball farther than the best so far can be passed over without any change.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from .cylinders import cylinder_chain_slope, cylinder_chain_value
from .solids import (
    ball_slope,
    ball_value,
    circle_slope,
    circle_value,
    half_spaces_slope,
    half_spaces_value,
    outline_slope,
    outline_value,
    round_cone_slope,
    round_cone_value,
    super_ellipse_slope,
    super_ellipse_value,
    super_ellipsoid_slope,
    super_ellipsoid_value,
)

SUPER_ELLIPSE = 0
CIRCLE = 2
POLYGON = 3
SUPER_ELLIPSOID = 10
CYLINDER_SEGMENT = 11
HALFSPACES = 12
BALL = 13
ROUND_CONE = 14


class ShapesData(NamedTuple):
    """Shapes of the family for compiled kernels; all arrays contiguous and writable.

    Attributes
    ----------
    kinds, first : (k,) int64
        Kind of each shape, and where its slice of `params` begins.
    params : (m,) float64
        The numbers of all shapes; the kernels say how a slice is laid out.
    boxes : (k, 4) float64
        Bounding ball of each shape: centre and radius [mm].
    obstacles : (k,) bool
        Whether a shape is taken away from the lumen.
    offsets : (k,) float64
        o_i: how far each shape's value is lowered, its wall moved outwards [mm].
    slack : float
        Rounding error of a value [mm].
    """

    kinds: Any
    first: Any
    params: Any
    boxes: Any
    obstacles: Any
    offsets: Any
    slack: float


@njit(cache=True)
def shape_value(kind, params, first, x, y, z):
    """Signed value of one shape."""
    if kind == SUPER_ELLIPSE:
        return super_ellipse_value(params, first, x, y, z)
    if kind == CIRCLE:
        return circle_value(params, first, x, y, z)
    if kind == POLYGON:
        return outline_value(params, first, x, y, z)
    if kind == SUPER_ELLIPSOID:
        return super_ellipsoid_value(params, first, x, y, z)
    if kind == CYLINDER_SEGMENT:
        return cylinder_chain_value(params, first, x, y, z)
    if kind == HALFSPACES:
        return half_spaces_value(params, first, x, y, z)
    if kind == BALL:
        return ball_value(params, first, x, y, z)
    return round_cone_value(params, first, x, y, z)


@njit(cache=True)
def shape_slope(kind, params, first, x, y, z):
    """Signed value of one shape with its gradient."""
    if kind == SUPER_ELLIPSE:
        return super_ellipse_slope(params, first, x, y, z)
    if kind == CIRCLE:
        return circle_slope(params, first, x, y, z)
    if kind == POLYGON:
        return outline_slope(params, first, x, y, z)
    if kind == SUPER_ELLIPSOID:
        return super_ellipsoid_slope(params, first, x, y, z)
    if kind == CYLINDER_SEGMENT:
        return cylinder_chain_slope(params, first, x, y, z)
    if kind == HALFSPACES:
        return half_spaces_slope(params, first, x, y, z)
    if kind == BALL:
        return ball_slope(params, first, x, y, z)
    return round_cone_slope(params, first, x, y, z)


@njit(cache=True)
def inflate_shapes(shapes, inflation):
    """Lower the values of all shapes so that their walls move outwards by at most `inflation`.

    Where the value outside is the distance, by the inflation c. Where it is only a lower bound,
    the shape {v <= c} would reach farther than c beyond the wall; {v <= c r / R} does not, r the
    depth of v at the ball's centre and R the ball's radius, because v is convex. A chain of
    cylinders is nearer than its value says by its tolerance.
    """
    for i in range(shapes.kinds.shape[0]):
        kind = shapes.kinds[i]
        first = shapes.first[i]
        more = inflation
        if kind == CYLINDER_SEGMENT:
            more = max(inflation - shapes.params[first + 1], 0.0)
        elif kind == SUPER_ELLIPSE or kind == SUPER_ELLIPSOID or kind == HALFSPACES:
            ball = shapes.boxes[i]
            depth = -shape_value(kind, shapes.params, first, ball[0], ball[1], ball[2])
            more *= min(max(depth / ball[3], 0.0), 1.0)
        shapes.offsets[i] += more


@njit(cache=True)
def _off_ball(boxes, i, x, y, z):
    """Return the square of the distance to the centre of a bounding ball."""
    dx = x - boxes[i, 0]
    dy = y - boxes[i, 1]
    dz = z - boxes[i, 2]
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def nearest_shape(shapes, x, y, z):
    """Return (value, i): the value at a point, and the shape that decides it."""
    boxes = shapes.boxes
    count = shapes.kinds.shape[0]
    start = 0
    least = np.inf
    for i in range(count):
        if shapes.obstacles[i]:
            continue
        gap = math.sqrt(_off_ball(boxes, i, x, y, z)) - boxes[i, 3]
        if gap < least:
            least = gap
            start = i
    best = np.inf
    index = start
    for n in range(count):
        i = start + n
        if i >= count:
            i -= count
        if shapes.obstacles[i]:
            continue
        square = _off_ball(boxes, i, x, y, z)
        reach = best + boxes[i, 3] + shapes.offsets[i]
        if reach <= 0.0 or square >= reach * reach:
            continue
        value = shape_value(shapes.kinds[i], shapes.params, shapes.first[i], x, y, z)
        value = max(value, math.sqrt(square) - boxes[i, 3]) - shapes.offsets[i]
        if value < best:
            best = value
            index = i
    for i in range(count):
        if not shapes.obstacles[i]:
            continue
        square = _off_ball(boxes, i, x, y, z)
        reach = boxes[i, 3] + shapes.offsets[i] - best
        if reach <= 0.0 or square >= reach * reach:
            continue
        value = shape_value(shapes.kinds[i], shapes.params, shapes.first[i], x, y, z)
        value = shapes.offsets[i] - max(value, math.sqrt(square) - boxes[i, 3])
        if value > best:
            best = value
            index = i
    return best, index


@njit(cache=True)
def family_estimate(duct, x, y, z):
    """Clearance: never more than there is, but for rounding."""
    value, _ = nearest_shape(duct, x, y, z)
    return -value


@njit(cache=True)
def family_bound(duct, x, y, z):
    """The same less the rounding error."""
    return family_estimate(duct, x, y, z) - duct.slack


@njit(cache=True)
def family_slope(duct, x, y, z):
    """Clearance and its gradient."""
    value, i = nearest_shape(duct, x, y, z)
    own, gx, gy, gz = shape_slope(duct.kinds[i], duct.params, duct.first[i], x, y, z)
    away = math.sqrt(_off_ball(duct.boxes, i, x, y, z))
    if away - duct.boxes[i, 3] > own:
        gx = (x - duct.boxes[i, 0]) / away
        gy = (y - duct.boxes[i, 1]) / away
        gz = (z - duct.boxes[i, 2]) / away
    if duct.obstacles[i]:
        return -value, gx, gy, gz
    return -value, -gx, -gy, -gz
