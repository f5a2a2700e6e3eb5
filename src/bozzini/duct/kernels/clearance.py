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

from numba import types
from numba.extending import overload

from ...errors import InputError
from ...numeric.compiling import kernel
from ..packed import BricksData, GridData, ShapesData
from .shapes import family_bound, family_estimate, family_slope


def clearance_bound(duct, x, y, z):
    """Return a lower bound of the clearance at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


def clearance_estimate(duct, x, y, z):
    """Return the estimated clearance at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


def clearance_slope(duct, x, y, z):
    """Return (estimated clearance, its gradient) at a point; compiled code only."""
    raise NotImplementedError("only callable from compiled code")


# The sampled field, in its own frame (mm from node 0): the trilinear interpolant of the nodes'
# values less the inflation. Outside the grid it is the value at the nearest point of the grid plus
# the distance to it, which keeps it an upper bound of the lesser of distance and reach.


@kernel(inline="always")
def _find_cell(values, hx, hy, hz, x, y, z):
    """Return the cell of a point, the fractions in it, and how far the point is off the grid."""
    nx, ny, nz = values.shape
    fx = x / hx
    fy = y / hy
    fz = z / hz
    cx = min(max(fx, 0.0), nx - 1.0)
    cy = min(max(fy, 0.0), ny - 1.0)
    cz = min(max(fz, 0.0), nz - 1.0)
    i = min(int(cx), nx - 2)
    j = min(int(cy), ny - 2)
    k = min(int(cz), nz - 2)
    return i, j, k, cx - i, cy - j, cz - k, (fx - cx) * hx, (fy - cy) * hy, (fz - cz) * hz


@kernel
def field_value(values, hx, hy, hz, inflation, x, y, z):
    """Signed distance at one point."""
    i, j, k, u, v, w, dx, dy, dz = _find_cell(values, hx, hy, hz, x, y, z)
    c00 = values[i, j, k] * (1.0 - w) + values[i, j, k + 1] * w
    c01 = values[i, j + 1, k] * (1.0 - w) + values[i, j + 1, k + 1] * w
    c10 = values[i + 1, j, k] * (1.0 - w) + values[i + 1, j, k + 1] * w
    c11 = values[i + 1, j + 1, k] * (1.0 - w) + values[i + 1, j + 1, k + 1] * w
    s = (c00 * (1.0 - v) + c01 * v) * (1.0 - u) + (c10 * (1.0 - v) + c11 * v) * u
    if dx != 0.0 or dy != 0.0 or dz != 0.0:
        s += math.sqrt(dx * dx + dy * dy + dz * dz)
    return s - inflation


@kernel
def field_and_gradient(values, hx, hy, hz, inflation, x, y, z):
    """Signed distance at one point, and the gradient of the interpolant there."""
    i, j, k, u, v, w, dx, dy, dz = _find_cell(values, hx, hy, hz, x, y, z)
    v000 = float(values[i, j, k])
    v001 = float(values[i, j, k + 1])
    v010 = float(values[i, j + 1, k])
    v011 = float(values[i, j + 1, k + 1])
    v100 = float(values[i + 1, j, k])
    v101 = float(values[i + 1, j, k + 1])
    v110 = float(values[i + 1, j + 1, k])
    v111 = float(values[i + 1, j + 1, k + 1])
    c00 = v000 * (1.0 - w) + v001 * w
    c01 = v010 * (1.0 - w) + v011 * w
    c10 = v100 * (1.0 - w) + v101 * w
    c11 = v110 * (1.0 - w) + v111 * w
    c0 = c00 * (1.0 - v) + c01 * v
    c1 = c10 * (1.0 - v) + c11 * v
    s = c0 * (1.0 - u) + c1 * u
    gx = (c1 - c0) / hx
    gy = ((c01 - c00) * (1.0 - u) + (c11 - c10) * u) / hy
    g0 = (v001 - v000) * (1.0 - v) + (v011 - v010) * v
    g1 = (v101 - v100) * (1.0 - v) + (v111 - v110) * v
    gz = (g0 * (1.0 - u) + g1 * u) / hz
    if dx != 0.0 or dy != 0.0 or dz != 0.0:
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        s += distance
        gx = dx / distance if dx != 0.0 else gx
        gy = dy / distance if dy != 0.0 else gy
        gz = dz / distance if dz != 0.0 else gz
    return s - inflation, gx, gy, gz


@kernel
def nodes_bound(values, step, x, y, z):
    """Lower bound from exact node distances, before inflation and without rounding.

    With f the fractions in the cell and e^2 = sum h_k^2 f_k (1 - f_k):
    the squared distance to a closed set minus |x|^2 is a minimum of affine functions, hence
    concave, so T[d^2] - e^2 <= d^2; and any 1-Lipschitz s has |T[s] - s| <= e. A wall moved
    outwards by the inflation c is at least c + d away inside the lumen, and c - s outside it.
    """
    hx, hy, hz = step[0], step[1], step[2]
    i, j, k, u, v, w, dx, dy, dz = _find_cell(values, hx, hy, hz, x, y, z)
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
    if dx != 0.0 or dy != 0.0 or dz != 0.0:
        best -= math.sqrt(dx * dx + dy * dy + dz * dz)
    return best


@kernel
def grid_bound(duct, x, y, z):
    """Lower bound from exact node distances."""
    return nodes_bound(duct.values, duct.step, x, y, z) + duct.inflation - duct.slack


@kernel
def grid_estimate(duct, x, y, z):
    """Trilinear clearance."""
    step = duct.step
    return -field_value(duct.values, step[0], step[1], step[2], duct.inflation, x, y, z)


@kernel
def grid_slope(duct, x, y, z):
    """Trilinear clearance and its gradient."""
    step = duct.step
    s, gx, gy, gz = field_and_gradient(
        duct.values, step[0], step[1], step[2], duct.inflation, x, y, z
    )
    return -s, -gx, -gy, -gz


@kernel
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


@kernel
def bricks_bound(duct, x, y, z):
    """Lower bound from exact node distances, the finer ones where there are some."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n >= 0:
        best = nodes_bound(duct.bricks[n], duct.fine_step, u, v, w)
    else:
        best = nodes_bound(duct.values, duct.step, x, y, z)
    return best + duct.inflation - duct.slack


@kernel
def bricks_estimate(duct, x, y, z):
    """Trilinear clearance."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n < 0:
        return grid_estimate(duct, x, y, z)
    step = duct.fine_step
    return -field_value(duct.bricks[n], step[0], step[1], step[2], duct.inflation, u, v, w)


@kernel
def bricks_slope(duct, x, y, z):
    """Trilinear clearance and its gradient."""
    n, u, v, w = find_brick(duct, x, y, z)
    if n < 0:
        return grid_slope(duct, x, y, z)
    step = duct.fine_step
    s, gx, gy, gz = field_and_gradient(
        duct.bricks[n], step[0], step[1], step[2], duct.inflation, u, v, w
    )
    return -s, -gx, -gy, -gz


# Free space: the lumen united with the introducer (`duct.packed.SpaceData`). It is compiled into
# its callers: a call more counts, for every link asks a few times.


@kernel
def split_along(introducer, x, y, z):
    """Return how far a point is along the introducer's axis from its inner end, and off it."""
    dx, dy, dz = x - introducer[0], y - introducer[1], z - introducer[2]
    along = dx * introducer[3] + dy * introducer[4] + dz * introducer[5]
    dx, dy, dz = dx - along * introducer[3], dy - along * introducer[4], dz - along * introducer[5]
    return along, math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel(inline="always")
def _leave_ray(introducer, x, y, z):
    """Return the distance of a point from the introducer's ray, and the vector from there."""
    dx, dy, dz = x - introducer[0], y - introducer[1], z - introducer[2]
    t = max(dx * introducer[3] + dy * introducer[4] + dz * introducer[5], 0.0)
    dx, dy, dz = dx - t * introducer[3], dy - t * introducer[4], dz - t * introducer[5]
    return math.sqrt(dx * dx + dy * dy + dz * dz), dx, dy, dz


@kernel(inline="always")
def space_bound(space, x, y, z):
    """Lower bound of the clearance in free space."""
    introducer = space.introducer
    best = clearance_bound(space.lumen, x, y, z)
    if introducer[6] > 0.0:
        best = max(best, introducer[6] - _leave_ray(introducer, x, y, z)[0])
    return best


@kernel(inline="always")
def space_estimate(space, x, y, z):
    """Estimated clearance in free space."""
    introducer = space.introducer
    best = clearance_estimate(space.lumen, x, y, z)
    if introducer[6] > 0.0:
        best = max(best, introducer[6] - _leave_ray(introducer, x, y, z)[0])
    return best


@kernel(inline="always")
def space_slope(space, x, y, z):
    """Estimated clearance in free space, and its gradient."""
    introducer = space.introducer
    best, gx, gy, gz = clearance_slope(space.lumen, x, y, z)
    if introducer[6] > 0.0:
        off, dx, dy, dz = _leave_ray(introducer, x, y, z)
        if introducer[6] - off > best:
            scale = -1.0 / max(off, 1e-12)
            best, gx, gy, gz = introducer[6] - off, scale * dx, scale * dy, scale * dz
    return best, gx, gy, gz


_KERNELS = {
    GridData: (grid_bound, grid_estimate, grid_slope),
    BricksData: (bricks_bound, bricks_estimate, bricks_slope),
    ShapesData: (family_bound, family_estimate, family_slope),
}
"""Bound, estimate and slope of each kind of packed duct."""


def register_kernels(packed, *, bound, estimate, slope):
    """Let planners evaluate another kind of packed duct: a shape of another package.

    Parameters
    ----------
    packed : type
        The named tuple that the duct's `pack` returns. It has fields `inflation` and `slack`
        [mm], which the kernels add to the clearance and take off the bound.
    bound, estimate : njit function
        ``(duct, x, y, z) -> float``: a lower bound of the clearance, and the best estimate [mm].
    slope : njit function
        ``(duct, x, y, z) -> (estimate, gx, gy, gz)``: with its gradient.

    Notes
    -----
    Call it where the kernels are defined. Numba keeps the compiled planners on disk, and does not
    see that a kernel they call has changed: clear its cache then.
    """
    for given in (bound, estimate, slope):
        code = given.py_func.__code__
        names = code.co_varnames[: code.co_argcount]
        if names != ("duct", "x", "y", "z"):
            raise InputError(f"a kernel takes ({', '.join(names)}): it must take (duct, x, y, z)")
    _KERNELS[packed] = (bound, estimate, slope)


def _choose(duct, which):
    """Return the body of a kernel for this kind: one call less, which counts here."""
    is_packed = isinstance(duct, types.BaseNamedTuple)
    kernels = _KERNELS.get(duct.instance_class) if is_packed else None
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


@kernel
def evaluate_bound(duct, points, result):
    """Fill `result` (n,) with the lower bound of the clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        result[n] = clearance_bound(duct, points[n, 0], points[n, 1], points[n, 2])


@kernel
def evaluate_estimate(duct, points, result):
    """Fill `result` (n,) with the estimated clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        result[n] = clearance_estimate(duct, points[n, 0], points[n, 1], points[n, 2])


@kernel
def evaluate_slope(duct, points, slope):
    """Fill `slope` (n, 3) with the gradient of the estimated clearance at `points` (n, 3)."""
    for n in range(points.shape[0]):
        _, slope[n, 0], slope[n, 1], slope[n, 2] = clearance_slope(
            duct, points[n, 0], points[n, 1], points[n, 2]
        )
