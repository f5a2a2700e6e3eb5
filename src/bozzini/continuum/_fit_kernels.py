"""Numba kernels a fit is made of: nearest point of a path, room, normal equations."""

from __future__ import annotations

import math

from numba import njit

from ..duct._clearance_kernels import clearance_slope

__all__ = ["add_row", "chain_frames", "find_room", "project_on_path", "solve", "turn_rows"]


@njit(cache=True)
def turn_rows(frame, rows, turned):
    """Fill `turned` (n, 3) with vectors `rows` (n, 3) seen from outside the `frame` (3, 4)."""
    for n in range(rows.shape[0]):
        for r in range(3):
            turned[n, r] = (
                frame[r, 0] * rows[n, 0] + frame[r, 1] * rows[n, 1] + frame[r, 2] * rows[n, 2]
            )


@njit(cache=True)
def chain_frames(before, arc, after):
    """Fill the frame `after` (3, 4) an arc that ends at `arc` (3, 4) as seen from `before`."""
    for r in range(3):
        for c in range(4):
            after[r, c] = (
                before[r, 0] * arc[0, c] + before[r, 1] * arc[1, c] + before[r, 2] * arc[2, c]
            )
        after[r, 3] += before[r, 3]


@njit(cache=True)
def project_on_path(path, tangents, guess, x, y, z, foot):
    """Walk from segment `guess` to the nearest point of the path; return its segment.

    `foot` (6,) gets the point and the direction of the path there, which turns evenly from
    vertex to vertex.
    """
    k = min(max(guess, 0), path.shape[0] - 2)
    last = 0
    w = 0.0
    for _ in range(path.shape[0]):
        bx = path[k + 1, 0] - path[k, 0]
        by = path[k + 1, 1] - path[k, 1]
        bz = path[k + 1, 2] - path[k, 2]
        w = (x - path[k, 0]) * bx + (y - path[k, 1]) * by + (z - path[k, 2]) * bz
        w /= max(bx * bx + by * by + bz * bz, 1e-300)
        if w > 1.0 and last >= 0 and k < path.shape[0] - 2:
            k += 1
            last = 1
        elif w < 0.0 and last <= 0 and k > 0:
            k -= 1
            last = -1
        else:
            break
    # Beyond its ends the path goes on straight.
    if k > 0:
        w = max(w, 0.0)
    if k < path.shape[0] - 2:
        w = min(w, 1.0)
    v = min(max(w, 0.0), 1.0)
    size = 0.0
    for r in range(3):
        foot[r] = path[k, r] + w * (path[k + 1, r] - path[k, r])
        foot[3 + r] = tangents[k, r] + v * (tangents[k + 1, r] - tangents[k, r])
        size += foot[3 + r] * foot[3 + r]
    size = 1.0 / math.sqrt(size)
    for r in range(3):
        foot[3 + r] *= size
    return k


@njit(cache=True)
def find_room(duct, placing, bore, point, slope):
    """Return the estimated clearance in duct and introducer; fill `slope` (3,), its gradient.

    `placing` (4, 3) turns a point into the duct's frame: three axes, then the origin.
    """
    x = placing[3, 0]
    y = placing[3, 1]
    z = placing[3, 2]
    for r in range(3):
        x += placing[r, 0] * point[r]
        y += placing[r, 1] * point[r]
        z += placing[r, 2] * point[r]
    g, gx, gy, gz = clearance_slope(duct, x, y, z)
    for r in range(3):
        slope[r] = placing[r, 0] * gx + placing[r, 1] * gy + placing[r, 2] * gz
    if point[2] <= 0.0:
        off = math.hypot(point[0], point[1])
        if bore - off > g:
            g = bore - off
            slope[0] = -point[0] / max(off, 1e-12)
            slope[1] = -point[1] / max(off, 1e-12)
            slope[2] = 0.0
    return g


@njit(cache=True)
def add_row(row, count, residual, weight, hessian, gradient):
    """Add one weighted row of the Jacobian to the lower half of the normal equations."""
    for p in range(count):
        a = weight * row[p]
        gradient[p] += a * residual
        if a != 0.0:
            for q in range(p + 1):
                hessian[p, q] += a * row[q]


@njit(cache=True)
def solve(hessian, gradient, count):
    """Put the solution of H x = g into `gradient`, by Cholesky in place; False if H is not > 0."""
    for p in range(count):
        for q in range(p + 1):
            total = hessian[p, q]
            for r in range(q):
                total -= hessian[p, r] * hessian[q, r]
            if p == q:
                if total <= 0.0:
                    return False
                hessian[p, p] = math.sqrt(total)
            else:
                hessian[p, q] = total / hessian[q, q]
    for p in range(count):
        total = gradient[p]
        for r in range(p):
            total -= hessian[p, r] * gradient[r]
        gradient[p] = total / hessian[p, p]
    for p in range(count - 1, -1, -1):
        total = gradient[p]
        for r in range(p + 1, count):
            total -= hessian[r, p] * gradient[r]
        gradient[p] = total / hessian[p, p]
    return True
