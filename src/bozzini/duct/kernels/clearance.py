"""Numba: what a planner and a certificate ask of a duct, whatever it is made of.

A duct is packed into a named tuple; `clearance_bound` and `clearance_slope` are compiled for each
kind (`numba.extending.overload`), so that kernels are written once. Points are in the duct's own
frame, planar ducts ignore z.

`clearance_bound` is a rigorous lower bound of the distance to the stated wall, negative or zero
where the point may be outside. `clearance_estimate` is the best estimate of it, and
`clearance_slope` the estimate with a direction, to push by.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import njit, types
from numba.extending import overload

from .family import ShapesData, family_bound, family_estimate, family_slope
from .field import field_and_gradient, field_value
from .shapes import cone_slope, nearest_cone, nearest_edge, polygon_slope


class GridData(NamedTuple):
    """A sampled field: exact signed node distances, spacings, inflation, and rounding slack."""

    values: Any
    step: Any
    inflation: float
    slack: float


class BricksData(NamedTuple):
    """Node distances in bricks, which brick a place has, spacing; then as `GridData`'s."""

    bricks: Any
    table: Any
    fine_step: Any
    values: Any
    step: Any
    inflation: float
    slack: float


class ConesData(NamedTuple):
    """A chain of round cones: cones and blocks of cones (`cones.pack_cones`), inflation, slack."""

    cones: Any
    blocks: Any
    inflation: float
    slack: float


class PolygonData(NamedTuple):
    """A simple polygon: its edges (`_shape_kernels.nearest_edge`), inflation, rounding slack."""

    edges: Any
    inflation: float
    slack: float


def clearance_bound(duct, x, y, z):
    """Return a lower bound of the clearance at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


def clearance_estimate(duct, x, y, z):
    """Return the estimated clearance at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


def clearance_slope(duct, x, y, z):
    """Return (estimated clearance, its gradient) at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


@njit(cache=True)
def nodes_bound(values, step, x, y, z):
    """Lower bound from exact node distances, before inflation and without rounding.

    With f the fractions in the cell and e^2 = sum h_k^2 f_k (1 - f_k):
    the squared distance to a closed set minus |x|^2 is a minimum of affine functions, hence
    concave, so T[d^2] - e^2 <= d^2; and any 1-Lipschitz s has |T[s] - s| <= e. A wall moved
    outwards by the inflation c is at least c + d away inside the lumen, and c - s outside it.
    """
    nx, ny, nz = values.shape
    hx, hy, hz = step[0], step[1], step[2]
    fx = x / hx
    fy = y / hy
    fz = z / hz
    cx = min(max(fx, 0.0), nx - 1.0)
    cy = min(max(fy, 0.0), ny - 1.0)
    cz = min(max(fz, 0.0), nz - 1.0)
    i = min(int(cx), nx - 2)
    j = min(int(cy), ny - 2)
    k = min(int(cz), nz - 2)
    u = cx - i
    v = cy - j
    w = cz - k
    s = 0.0
    square = 0.0
    for a in range(2):
        wa = u if a == 1 else 1.0 - u
        for b in range(2):
            wb = wa * (v if b == 1 else 1.0 - v)
            v0 = values[i + a, j + b, k]
            v1 = values[i + a, j + b, k + 1]
            w1 = wb * w
            w0 = wb - w1
            s += w0 * v0 + w1 * v1
            d0 = min(v0, 0.0)
            d1 = min(v1, 0.0)
            square += w0 * d0 * d0 + w1 * d1 * d1
    spread = hx * hx * u * (1.0 - u) + hy * hy * v * (1.0 - v) + hz * hz * w * (1.0 - w)
    best = -s - math.sqrt(spread)
    # Rounded to float32, a square may be too large by 2^-23 of itself.
    square *= 1.0 - 2.0**-22
    if square > spread:
        best = max(best, math.sqrt(square - spread))
    if cx != fx or cy != fy or cz != fz:
        dx = (fx - cx) * hx
        dy = (fy - cy) * hy
        dz = (fz - cz) * hz
        best -= math.sqrt(dx * dx + dy * dy + dz * dz)
    return best


@njit(cache=True)
def grid_bound(duct, x, y, z):
    """Lower bound from exact node distances."""
    return nodes_bound(duct.values, duct.step, x, y, z) + duct.inflation - duct.slack


@njit(cache=True)
def grid_estimate(duct, x, y, z):
    """Trilinear clearance."""
    step = duct.step
    return -field_value(duct.values, step[0], step[1], step[2], duct.inflation, x, y, z)


@njit(cache=True)
def grid_slope(duct, x, y, z):
    """Trilinear clearance and its gradient."""
    step = duct.step
    s, gx, gy, gz = field_and_gradient(
        duct.values, step[0], step[1], step[2], duct.inflation, x, y, z
    )
    return -s, -gx, -gy, -gz


@njit(cache=True)
def find_brick(duct, x, y, z):
    """Return the brick at a place, -1 for none, and the place in the brick."""
    cells = duct.bricks.shape[1] - 1
    wx = cells * duct.fine_step[0]
    wy = cells * duct.fine_step[1]
    wz = cells * duct.fine_step[2]
    i = math.floor(x / wx)
    j = math.floor(y / wy)
    k = math.floor(z / wz)
    a, b, c = duct.table.shape
    if i < 0 or j < 0 or k < 0 or i >= a or j >= b or k >= c:
        return -1, 0.0, 0.0, 0.0
    return duct.table[int(i), int(j), int(k)], x - i * wx, y - j * wy, z - k * wz


@njit(cache=True)
def bricks_bound(duct, x, y, z):
    """Lower bound from exact node distances, the finer ones where there are some."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n >= 0:
        best = nodes_bound(duct.bricks[n], duct.fine_step, u, v, w)
    else:
        best = nodes_bound(duct.values, duct.step, x, y, z)
    return best + duct.inflation - duct.slack


@njit(cache=True)
def bricks_estimate(duct, x, y, z):
    """Trilinear clearance."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n >= 0:
        step = duct.fine_step
        return -field_value(duct.bricks[n], step[0], step[1], step[2], duct.inflation, u, v, w)
    step = duct.step
    return -field_value(duct.values, step[0], step[1], step[2], duct.inflation, x, y, z)


@njit(cache=True)
def bricks_slope(duct, x, y, z):
    """Trilinear clearance and its gradient."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n >= 0:
        step = duct.fine_step
        s, gx, gy, gz = field_and_gradient(
            duct.bricks[n], step[0], step[1], step[2], duct.inflation, u, v, w
        )
    else:
        step = duct.step
        s, gx, gy, gz = field_and_gradient(
            duct.values, step[0], step[1], step[2], duct.inflation, x, y, z
        )
    return -s, -gx, -gy, -gz


@njit(cache=True)
def cones_estimate(duct, x, y, z):
    """Clearance in a chain of round cones: exact outside, a lower bound inside."""
    s, _ = nearest_cone(duct.cones, duct.blocks, x, y, z)
    return duct.inflation - s


@njit(cache=True)
def cones_bound(duct, x, y, z):
    """The same less the rounding error."""
    return cones_estimate(duct, x, y, z) - duct.slack


@njit(cache=True)
def cones_slope(duct, x, y, z):
    """Clearance in a chain of round cones, and its gradient."""
    s, i = nearest_cone(duct.cones, duct.blocks, x, y, z)
    gx, gy, gz = cone_slope(duct.cones, i, x, y, z)
    return duct.inflation - s, -gx, -gy, -gz


@njit(cache=True)
def polygon_estimate(duct, x, y, z):
    """Clearance in a polygon: exact; with inflation a lower bound inside."""
    s, _ = nearest_edge(duct.edges, x, y)
    return duct.inflation - s


@njit(cache=True)
def polygon_bound(duct, x, y, z):
    """The same less the rounding error."""
    return polygon_estimate(duct, x, y, z) - duct.slack


@njit(cache=True)
def plane_slope(duct, x, y, z):
    """Clearance in a polygon, and its gradient, which is in the plane."""
    s, i = nearest_edge(duct.edges, x, y)
    gx, gy = polygon_slope(duct.edges, i, s, x, y)
    return duct.inflation - s, -gx, -gy, 0.0


_KERNELS: dict[Any, tuple[Any, Any, Any]] = {
    GridData: (grid_bound, grid_estimate, grid_slope),
    BricksData: (bricks_bound, bricks_estimate, bricks_slope),
    ConesData: (cones_bound, cones_estimate, cones_slope),
    PolygonData: (polygon_bound, polygon_estimate, plane_slope),
    ShapesData: (family_bound, family_estimate, family_slope),
}
"""Bound, estimate and slope of each kind of packed duct."""


def _choose(duct, which):
    """Return the body of a kernel for this kind: one call less, which counts here."""
    is_packed = isinstance(duct, types.BaseNamedTuple)
    kernels = _KERNELS.get(getattr(duct, "instance_class", None)) if is_packed else None
    return None if kernels is None else kernels[which].py_func


@overload(clearance_bound)
def _overload_bound(duct, x, y, z):
    return _choose(duct, 0)


@overload(clearance_estimate)
def _overload_estimate(duct, x, y, z):
    return _choose(duct, 1)


@overload(clearance_slope)
def _overload_slope(duct, x, y, z):
    return _choose(duct, 2)


@njit(cache=True)
def evaluate_bound(duct, points, result):
    """Fill `result` (n,) with the lower bound of the clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        result[n] = clearance_bound(duct, points[n, 0], points[n, 1], points[n, 2])


@njit(cache=True)
def evaluate_estimate(duct, points, result):
    """Fill `result` (n,) with the estimated clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        result[n] = clearance_estimate(duct, points[n, 0], points[n, 1], points[n, 2])


@njit(cache=True)
def evaluate_slope(duct, points, slope):
    """Fill `slope` (n, 3) with the gradient of the estimated clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        _, slope[n, 0], slope[n, 1], slope[n, 2] = clearance_slope(
            duct, points[n, 0], points[n, 1], points[n, 2]
        )
