"""Numba kernels for the design of routings: curvatures under tensions, and a backbone from them.

Without loads each cross-section has its own balance (`find_curvature`), so curvatures and their
derivatives by places, slopes and tensions of the tendons are local. The backbone is the product of
exponentials of twists, of fourth order, with two Gauss points in each step (Iserles and Norsett,
On the solution of linear differential equations in Lie groups, 1999).
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, copy_vector
from ...numeric.kernels.linear_algebra import solve_three
from .rod import expand_potential, find_curvature


@kernel
def find_curvatures(stiffness, guides, present, tensions, curvatures, by_guides, by_tensions):
    """Improve curvatures (m, 3) under tensions (k,); fill their derivatives. False if none.

    ``guides`` (m, k, 4) are places and slopes, ``present`` (m, k) where tendons run; derivatives
    are (m, k, 4, 3) by the guides and (m, k, 3) by the tensions, and are left out if they are
    empty.
    """
    work, free, least = np.empty((11, 3)), np.zeros(3), np.zeros(3)
    right, solved, t = np.empty(3), np.empty(3), np.empty(3)
    matrix, change = np.empty((3, 3)), np.empty(3)
    by_component = np.empty((4, 3))
    for i in range(len(guides)):
        u = curvatures[i]
        if not find_curvature(stiffness, guides[i], present[i], tensions, free, u, work):
            return False
        if by_tensions.size == 0:
            continue
        expand_potential(
            stiffness, guides[i], present[i], tensions, free, u, False, work[3], matrix
        )
        for k in range(tensions.size):
            by_tensions[i, k] = 0.0
            by_guides[i, k] = 0.0
            if not present[i, k]:
                continue
            x, y = guides[i, k, 0], guides[i, k, 1]
            t[0] = guides[i, k, 2] - u[2] * y
            t[1] = guides[i, k, 3] + u[2] * x
            t[2] = 1.0 + u[0] * y - u[1] * x
            long = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
            for n in range(3):
                t[n] /= long
            right[0], right[1], right[2] = -t[2] * y, t[2] * x, t[0] * y - t[1] * x
            if not solve_three(matrix, right, least, solved):
                return False
            copy_vector(solved, by_tensions[i, k])
            # How the tendon's direction, before it is made a unit, depends on x, y and slopes.
            by_component[0, 0], by_component[0, 1], by_component[0, 2] = 0.0, u[2], -u[1]
            by_component[1, 0], by_component[1, 1], by_component[1, 2] = -u[2], 0.0, u[0]
            by_component[2, 0], by_component[2, 1], by_component[2, 2] = 1.0, 0.0, 0.0
            by_component[3, 0], by_component[3, 1], by_component[3, 2] = 0.0, 1.0, 0.0
            for c in range(4):
                along = 0.0
                for n in range(3):
                    along += t[n] * by_component[c, n]
                for n in range(3):
                    change[n] = (by_component[c, n] - along * t[n]) / long
                right[0] = -change[2] * y
                right[1] = change[2] * x
                right[2] = change[0] * y - change[1] * x
                if c == 0:
                    right[1] += t[2]
                    right[2] -= t[1]
                elif c == 1:
                    right[0] -= t[2]
                    right[2] += t[0]
                for n in range(3):
                    right[n] *= tensions[k]
                if not solve_three(matrix, right, least, solved):
                    return False
                copy_vector(solved, by_guides[i, k, c])
    return True


@kernel
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


GAUSS = math.sqrt(3.0) / 12.0

TERMS = 8
"""Terms of the series of the exponential's derivative; steps turn by a fraction of a radian."""


@kernel
def trace_backbone(steps, curvatures, start, points, rotations, by_rotation, by_place):
    """Fill points (n + 1, 3) and turns (n + 1, 3, 3) of a backbone, and their derivatives.

    ``steps`` (n,) are its steps' lengths, ``curvatures`` (n, 2, 3) are at their Gauss points,
    ``start`` (3, 3) is the first frame; the first point is taken as it is. If not empty,
    ``by_rotation`` and ``by_place`` (n, 2, 3, 3) are filled so that a change of the curvature's
    component c at Gauss point g of step j moves each later point x by
    ``by_place[j, g, c] + cross(by_turn[j, g, c], x)``.
    """
    w, v, side, other = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    hat, move = np.zeros((3, 3)), np.empty(3)
    turned, moved, term_w, term_v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    unit = np.zeros(3)
    copy_matrix(start, rotations[0])
    for j in range(len(steps)):
        h = steps[j]
        one, two = curvatures[j, 0], curvatures[j, 1]
        c = GAUSS * h * h
        _cross(one, two, side)
        for i in range(3):
            w[i] = 0.5 * h * (one[i] + two[i]) + c * side[i]
        v[0], v[1], v[2] = c * (one[1] - two[1]), -c * (one[0] - two[0]), h
        square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
        angle = math.sqrt(square)
        if angle < 1e-4:
            a = 1.0 - square / 6.0
            b = 0.5 - square / 24.0
            d = 1.0 / 6.0 - square / 120.0
        else:
            a = math.sin(angle) / angle
            b = (1.0 - math.cos(angle)) / square
            d = (angle - math.sin(angle)) / (angle * square)
        hat[0, 1], hat[0, 2], hat[1, 2] = -w[2], w[1], -w[0]
        hat[1, 0], hat[2, 0], hat[2, 1] = w[2], -w[1], w[0]
        _cross(w, v, side)
        _cross(w, side, other)
        for i in range(3):
            move[i] = v[i] + b * side[i] + d * other[i]
        for i in range(3):
            points[j + 1, i] = points[j, i]
            for n in range(3):
                points[j + 1, i] += rotations[j, i, n] * move[n]
        for i in range(3):
            for n in range(3):
                # I + a hat + b hat^2, where hat^2 = w w^T - |w|^2 I.
                total = 0.0
                for m in range(3):
                    entry = a * hat[m, n] + b * w[m] * w[n]
                    if m == n:
                        entry += 1.0 - b * square
                    total += rotations[j, i, m] * entry
                rotations[j + 1, i, n] = total
        if by_rotation.size == 0:
            continue
        for g in range(2):
            for k in range(3):
                unit[:] = 0.0
                unit[k] = 1.0
                if g == 0:
                    _cross(unit, two, side)
                    sign = c
                else:
                    _cross(one, unit, side)
                    sign = -c
                for i in range(3):
                    term_w[i] = 0.5 * h * unit[i] + c * side[i]
                term_v[0], term_v[1], term_v[2] = sign * unit[1], -sign * unit[0], 0.0
                copy_vector(term_w, turned)
                copy_vector(term_v, moved)
                # The body's twist: the series of (1 - exp(-ad)) / ad.
                for order in range(1, TERMS):
                    share = -1.0 / (order + 1.0)
                    _cross(w, term_v, side)
                    _cross(v, term_w, other)
                    for i in range(3):
                        term_v[i] = share * (side[i] + other[i])
                    _cross(w, term_w, side)
                    for i in range(3):
                        term_w[i] = share * side[i]
                        turned[i] += term_w[i]
                        moved[i] += term_v[i]
                for i in range(3):
                    by_rotation[j, g, k, i] = 0.0
                    by_place[j, g, k, i] = 0.0
                    for n in range(3):
                        by_rotation[j, g, k, i] += rotations[j + 1, i, n] * turned[n]
                        by_place[j, g, k, i] += rotations[j + 1, i, n] * moved[n]
                _cross(by_rotation[j, g, k], points[j + 1], side)
                for i in range(3):
                    by_place[j, g, k, i] -= side[i]
