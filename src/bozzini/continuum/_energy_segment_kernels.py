"""Numba kernels of one segment of the discrete rod: tendon length, its gradient and its Hessian.

Everything is a sum of ``d . f(w) r`` with ``f(w) = f_n I + f_(n+1) [w] + f_(n+2) w w^T`` and the
entire functions ``f_n(q) = sum_k (-q)^k / (2 k + n)!`` of ``q = |w|^2``: the rotation itself is
n = 0, and the integral of rotations along an arc is n = 1. They are smooth at ``w = 0``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = [
    "fill_functions",
    "fill_rotation",
    "measure_channel",
    "measure_length",
    "move_forward",
]

CHORD = 0
ARC = 1
CHANNEL = 2

FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0])


@njit(cache=True)
def fill_functions(q, f):
    """Fill ``f`` (8,) with ``f_n(q)``: the two last by their series, then down from them."""
    for n in (6, 7):
        term = 1.0 / FACTORIALS[n]
        total = term
        for k in range(1, 40):
            term *= -q / ((2 * k + n) * (2 * k + n - 1))
            total += term
            if abs(term) < 1e-17 * abs(total):
                break
        f[n] = total
    for n in range(5, -1, -1):
        f[n] = 1.0 / FACTORIALS[n] - q * f[n + 2]


@njit(cache=True)
def fill_rotation(w, f, rotation):
    """Rotation matrix (3, 3) of the rotation vector ``w``, given its functions ``f``."""
    for i in range(3):
        for k in range(3):
            rotation[i, k] = f[2] * w[i] * w[k]
        rotation[i, i] += f[0]
    rotation[0, 1] -= f[1] * w[2]
    rotation[0, 2] += f[1] * w[1]
    rotation[1, 0] += f[1] * w[2]
    rotation[1, 2] -= f[1] * w[0]
    rotation[2, 0] -= f[1] * w[1]
    rotation[2, 1] += f[1] * w[0]


@njit(cache=True)
def add_form(w, f, n, r0, r1, r2, scale, inner, value, slope):
    """Add ``scale f(inner w) r`` to ``value`` and its derivative by ``w`` to ``slope`` (3, 3).

    ``f`` are the functions of ``inner w``.
    """
    w0, w1, w2 = inner * w[0], inner * w[1], inner * w[2]
    along = w0 * r0 + w1 * r1 + w2 * r2
    c0, c1, c2 = w1 * r2 - w2 * r1, w2 * r0 - w0 * r2, w0 * r1 - w1 * r0
    value[0] += scale * (f[n] * r0 + f[n + 1] * c0 + f[n + 2] * along * w0)
    value[1] += scale * (f[n] * r1 + f[n + 1] * c1 + f[n + 2] * along * w1)
    value[2] += scale * (f[n] * r2 + f[n + 1] * c2 + f[n + 2] * along * w2)
    # Twice the derivatives by q: 2 f_n' = n f_(n+2) - f_(n+1).
    p0 = n * f[n + 2] - f[n + 1]
    p1 = (n + 1) * f[n + 3] - f[n + 2]
    p2 = (n + 2) * f[n + 4] - f[n + 3]
    s = scale * inner
    e0 = s * (p0 * r0 + p1 * c0 + p2 * along * w0)
    e1 = s * (p0 * r1 + p1 * c1 + p2 * along * w1)
    e2 = s * (p0 * r2 + p1 * c2 + p2 * along * w2)
    a, b = s * f[n + 1], s * f[n + 2]
    slope[0, 0] += e0 * w0 + b * (along + w0 * r0)
    slope[0, 1] += e0 * w1 + a * r2 + b * w0 * r1
    slope[0, 2] += e0 * w2 - a * r1 + b * w0 * r2
    slope[1, 0] += e1 * w0 - a * r2 + b * w1 * r0
    slope[1, 1] += e1 * w1 + b * (along + w1 * r1)
    slope[1, 2] += e1 * w2 + a * r0 + b * w1 * r2
    slope[2, 0] += e2 * w0 + a * r1 + b * w2 * r0
    slope[2, 1] += e2 * w1 - a * r0 + b * w2 * r1
    slope[2, 2] += e2 * w2 + b * (along + w2 * r2)


@njit(cache=True)
def add_form_hessian(w, f, n, r0, r1, r2, d, scale, inner, hessian):
    """Add to ``hessian`` (3, 3) the second derivative by ``w`` of ``scale d . f(inner w) r``."""
    w0, w1, w2 = inner * w[0], inner * w[1], inner * w[2]
    d0, d1, d2 = d[0], d[1], d[2]
    x0, x1, x2 = r1 * d2 - r2 * d1, r2 * d0 - r0 * d2, r0 * d1 - r1 * d0
    dot = d0 * r0 + d1 * r1 + d2 * r2
    turn = w0 * x0 + w1 * x1 + w2 * x2
    wr = w0 * r0 + w1 * r1 + w2 * r2
    wd = w0 * d0 + w1 * d1 + w2 * d2
    p0 = n * f[n + 2] - f[n + 1]
    p1 = (n + 1) * f[n + 3] - f[n + 2]
    p2 = (n + 2) * f[n + 4] - f[n + 3]
    # Four times the second derivatives by q.
    t0 = f[n + 2] - (2 * n + 1) * f[n + 3] + n * (n + 2) * f[n + 4]
    t1 = f[n + 3] - (2 * n + 3) * f[n + 4] + (n + 1) * (n + 3) * f[n + 5]
    t2 = f[n + 4] - (2 * n + 5) * f[n + 5] + (n + 2) * (n + 4) * f[n + 6]
    s = scale * inner * inner
    first = s * (p0 * dot + p1 * turn + p2 * wr * wd)
    second = s * (t0 * dot + t1 * turn + t2 * wr * wd)
    g0 = s * (p1 * x0 + p2 * (wd * r0 + wr * d0)) + 0.5 * second * w0
    g1 = s * (p1 * x1 + p2 * (wd * r1 + wr * d1)) + 0.5 * second * w1
    g2 = s * (p1 * x2 + p2 * (wd * r2 + wr * d2)) + 0.5 * second * w2
    b = s * f[n + 2]
    hessian[0, 0] += first + 2.0 * (w0 * g0 + b * r0 * d0)
    hessian[1, 1] += first + 2.0 * (w1 * g1 + b * r1 * d1)
    hessian[2, 2] += first + 2.0 * (w2 * g2 + b * r2 * d2)
    h01 = w0 * g1 + w1 * g0 + b * (r0 * d1 + r1 * d0)
    h02 = w0 * g2 + w2 * g0 + b * (r0 * d2 + r2 * d0)
    h12 = w1 * g2 + w2 * g1 + b * (r1 * d2 + r2 * d1)
    hessian[0, 1] += h01
    hessian[1, 0] += h01
    hessian[0, 2] += h02
    hessian[2, 0] += h02
    hessian[1, 2] += h12
    hessian[2, 1] += h12


@njit(cache=True)
def move_forward(w, f, half, length, backbone, value, slope):
    """Step of the backbone over a segment (3,) and its derivative by ``w`` (3, 3).

    A chord of the segment's length half-way between its two tangents, or the arc of that length.
    ``f`` are the functions of ``w``, ``half`` those of ``w / 2``.
    """
    value[:] = 0.0
    slope[:] = 0.0
    if backbone == CHORD:
        add_form(w, half, 0, 0.0, 0.0, 1.0, length, 0.5, value, slope)
    else:
        add_form(w, f, 1, 0.0, 0.0, 1.0, length, 1.0, value, slope)


@njit(cache=True)
def measure_length(
    w, f, half, length, backbone, start, end, step, step_slope, tension, work, slope, psd, full
):
    """Length of one tendon over a segment [mm], straight between the discs.

    ``start`` and ``end`` are its places (2,) in the two discs. Fills its gradient ``slope`` (3,)
    and adds ``tension`` times its Hessian to ``full``, and the part of the Hessian that cannot be
    negative to ``psd``. ``work`` is (5, 3).
    """
    value, matrix = work[0], work[1:4]
    for i in range(3):
        value[i] = step[i]
        for k in range(3):
            matrix[i, k] = step_slope[i, k]
    add_form(w, f, 0, end[0], end[1], 0.0, 1.0, 1.0, value, matrix)
    value[0] -= start[0]
    value[1] -= start[1]
    size = math.sqrt(value[0] ** 2 + value[1] ** 2 + value[2] ** 2)
    way = work[4]
    for i in range(3):
        way[i] = value[i] / size
    for k in range(3):
        slope[k] = way[0] * matrix[0, k] + way[1] * matrix[1, k] + way[2] * matrix[2, k]
    if tension == 0.0:
        return size
    share = tension / size
    for i in range(3):
        for k in range(3):
            square = (
                matrix[0, i] * matrix[0, k]
                + matrix[1, i] * matrix[1, k]
                + matrix[2, i] * matrix[2, k]
            )
            part = share * (square - slope[i] * slope[k])
            full[i, k] += part
            if tension > 0.0:
                psd[i, k] += part
    add_form_hessian(w, f, 0, end[0], end[1], 0.0, way, tension, 1.0, full)
    if backbone == CHORD:
        add_form_hessian(w, half, 0, 0.0, 0.0, 1.0, way, tension * length, 0.5, full)
    else:
        add_form_hessian(w, f, 1, 0.0, 0.0, 1.0, way, tension * length, 1.0, full)
    return size


@njit(cache=True)
def measure_channel(w, length, guides, weights, tension, slope, psd, full):
    """Length of one tendon in a smooth channel of a segment of constant curvature and twist [mm].

    ``guides`` (g, 4) are place and slope of the channel at Gauss points of ``weights`` (g,), which
    add up to 1. Fills and adds as `measure_length`; this length is convex in ``w``.
    """
    total = 0.0
    slope[:] = 0.0
    u0, u1, u2 = w[0] / length, w[1] / length, w[2] / length
    for g in range(weights.size):
        x, y = guides[g, 0], guides[g, 1]
        v0 = guides[g, 2] - u2 * y
        v1 = guides[g, 3] + u2 * x
        v2 = 1.0 + u0 * y - u1 * x
        size = math.sqrt(v0 * v0 + v1 * v1 + v2 * v2)
        total += weights[g] * length * size
        m0, m1, m2 = v2 * y / size, -v2 * x / size, (v1 * x - v0 * y) / size
        slope[0] += weights[g] * m0
        slope[1] += weights[g] * m1
        slope[2] += weights[g] * m2
        if tension == 0.0:
            continue
        share = tension * weights[g] / (length * size)
        h00, h01, h02 = share * (y * y - m0 * m0), share * (-x * y - m0 * m1), -share * m0 * m2
        h11, h12 = share * (x * x - m1 * m1), -share * m1 * m2
        h22 = share * (x * x + y * y - m2 * m2)
        for part in range(2 if tension > 0.0 else 1):
            matrix = full if part == 0 else psd
            matrix[0, 0] += h00
            matrix[1, 1] += h11
            matrix[2, 2] += h22
            matrix[0, 1] += h01
            matrix[1, 0] += h01
            matrix[0, 2] += h02
            matrix[2, 0] += h02
            matrix[1, 2] += h12
            matrix[2, 1] += h12
    return total
