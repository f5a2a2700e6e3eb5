"""Numba kernels that fit the bends of a robot's sections to a path, step after step.

All in the introducer's frame: the entry is the origin, z points into the tract, the robot's base
stands on the axis at ``z = advance - length`` and looks along it. A Gauss-Newton step solves for
the advance and for the bends of all sections that have left the introducer, at once.
"""

from __future__ import annotations

import math

import numpy as np

from ...continuum.kernels.arc import fill_arc, put_arc
from ...duct.kernels.clearance import clearance_slope
from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_matrix, set_identity

# Numba kernels a fit is made of: nearest point of a path, clearance, normal equations.


@kernel
def turn_rows(frame, rows, turned):
    """Fill `turned` (n, 3) with vectors `rows` (n, 3) seen from outside the `frame` (3, 4)."""
    for n in range(rows.shape[0]):
        for r in range(3):
            turned[n, r] = (
                frame[r, 0] * rows[n, 0] + frame[r, 1] * rows[n, 1] + frame[r, 2] * rows[n, 2]
            )


@kernel
def chain_frames(before, arc, after):
    """Fill the frame `after` (3, 4) an arc that ends at `arc` (3, 4) as seen from `before`."""
    for r in range(3):
        for c in range(4):
            after[r, c] = (
                before[r, 0] * arc[0, c] + before[r, 1] * arc[1, c] + before[r, 2] * arc[2, c]
            )
        after[r, 3] += before[r, 3]


@kernel
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


@kernel
def find_clearance(duct, placing, bore, point, slope):
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


@kernel
def add_row(row, count, residual, weight, hessian, gradient):
    """Add one weighted row of the Jacobian to the lower half of the normal equations."""
    for p in range(count):
        a = weight * row[p]
        gradient[p] += a * residual
        if a != 0.0:
            for q in range(p + 1):
                hessian[p, q] += a * row[q]


@kernel
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


# Numba kernels of the executed motion: points of arcs between steps, and how fast they bend.


@kernel
def bound_bending(lengths, bends, curving):
    """Fill `curving` (steps - 1,): bounds of the second derivative in time of any body point.

    Time counts steps. With A(s) the change of bend from the base to s, added up, it is the
    integral of A^2 over the body; A grows evenly in a section.
    """
    for step in range(bends.shape[0] - 1):
        total = 0.0
        near = 0.0
        for i in range(lengths.size):
            change = math.hypot(
                bends[step + 1, i, 0] - bends[step, i, 0], bends[step + 1, i, 1] - bends[step, i, 1]
            )
            far = near + change
            total += lengths[i] * (near * near + near * far + far * far) / 3.0
            near = far
        curving[step] = total


@kernel
def fill_bodies(lengths, chords, frame, outward, total, bends, advances, steps, shares, joints):
    """Fill chains of points on the arcs at times between steps, tip first.

    Parameters
    ----------
    chords : (m,) int
        Chords of each section.
    frame : (4, 4) float
        The robot's base when wholly inserted.
    outward : (3,) float
        The way it is drawn back.
    total : float
        Length of the robot [mm].
    steps, shares : (n,) int, (n,) float
        Times: a share of the way from a step to the next.
    joints : (n, sum of chords + 1, 3) float
        Filled.
    """
    before = np.empty((4, 4))
    after = np.empty((4, 4))
    last = joints.shape[1] - 1
    for n in range(steps.size):
        step = steps[n]
        f = shares[n]
        following = min(step + 1, bends.shape[0] - 1)
        back = total - advances[step] - f * (advances[following] - advances[step])
        copy_matrix(frame, before)
        for r in range(3):
            before[r, 3] += back * outward[r]
            joints[n, last, r] = before[r, 3]
        k = last
        for i in range(lengths.size):
            x = bends[step, i, 0] + f * (bends[following, i, 0] - bends[step, i, 0])
            y = bends[step, i, 1] + f * (bends[following, i, 1] - bends[step, i, 1])
            for c in range(chords[i]):
                share = (c + 1.0) / chords[i]
                put_arc(before, share * lengths[i], share * x, share * y, after)
                k -= 1
                for r in range(3):
                    joints[n, k, r] = after[r, 3]
            copy_matrix(after, before)


WALL_WEIGHT = 10.0
"""Weight of a missing millimetre of clearance against one beside the path."""

TIP_WEIGHT = 20.0
"""Weight of the tip's place along the path [mm]."""

STIFFNESS = 0.02
"""How much a section that has left the introducer only in part resists bending."""

LIMIT_WEIGHT = 1e10
"""Weight of a limit of bend or travel that is overstepped: a constraint in all but name."""

STEP_CAP = 0.25
"""Largest change of a bend in one iteration [rad]."""

SETTLED = 1e-5
"""Change below which an iteration is the last [rad, mm]."""

ENTERED = 1e-6
"""Length out of the introducer from which a section is bent [mm]."""


@kernel
def _assemble(
    duct,
    placing,
    bore,
    lengths,
    samples,
    path,
    tangents,
    arc,
    head,
    needed,
    bends,
    advance,
    first,
    hessian,
    gradient,
    frames,
    guesses,
):
    """Fill the normal equations of path and wall for the sections from `first` on.

    Unknowns are the advance and the bends of these sections; returns their number.
    """
    sections = lengths.size
    count = 1 + 2 * (sections - first)
    for p in range(count):
        gradient[p] = 0.0
        for q in range(count):
            hessian[p, q] = 0.0
    start = advance
    for i in range(first, sections):
        start -= lengths[i]
    set_identity(frames[first])
    frames[first, 2, 3] = start
    moves = np.empty((sections, 2, 3))
    turns = np.empty((sections, 2, 3))
    own_move = np.empty((2, 3))
    local = np.empty((2, 3))
    whirl = np.empty((2, 3))
    end = np.empty((3, 4))
    point = np.empty((3, 4))
    foot = np.empty(6)
    slope = np.empty(3)
    columns = np.zeros((count, 3))
    row = np.empty(count)
    place = np.empty(3)
    columns[0, 2] = 1.0
    for i in range(first, sections):
        x = bends[i, 0]
        y = bends[i, 1]
        fill_arc(lengths[i], x, y, end, local, whirl)
        chain_frames(frames[i], end, frames[i + 1])
        turn_rows(frames[i], local, moves[i])
        turn_rows(frames[i], whirl, turns[i])
        pitch = lengths[i] / samples[i]
        for n in range(samples[i]):
            share = (n + 1.0) / samples[i]
            fill_arc(share * lengths[i], share * x, share * y, end, local, whirl)
            chain_frames(frames[i], end, point)
            turn_rows(frames[i], local, own_move)
            for r in range(3):
                place[r] = point[r, 3]
            for j in range(first, i):
                ax = place[0] - frames[j + 1, 0, 3]
                ay = place[1] - frames[j + 1, 1, 3]
                az = place[2] - frames[j + 1, 2, 3]
                for c in range(2):
                    p = 1 + 2 * (j - first) + c
                    t = turns[j, c]
                    columns[p, 0] = moves[j, c, 0] + t[1] * az - t[2] * ay
                    columns[p, 1] = moves[j, c, 1] + t[2] * ax - t[0] * az
                    columns[p, 2] = moves[j, c, 2] + t[0] * ay - t[1] * ax
            used = 1 + 2 * (i - first) + 2
            for c in range(2):
                for r in range(3):
                    columns[used - 2 + c, r] = share * own_move[c, r]
            k = project_on_path(path, tangents, guesses[i, n], place[0], place[1], place[2], foot)
            guesses[i, n] = k
            # Two directions across the path.
            tx, ty, tz = foot[3], foot[4], foot[5]
            if abs(tx) < 0.6:
                ux, uy, uz = 0.0, tz, -ty
            else:
                ux, uy, uz = -tz, 0.0, tx
            size = 1.0 / math.sqrt(ux * ux + uy * uy + uz * uz)
            ux, uy, uz = ux * size, uy * size, uz * size
            for side in range(2):
                if side == 1:
                    ux, uy, uz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
                miss = (
                    ux * (place[0] - foot[0])
                    + uy * (place[1] - foot[1])
                    + uz * (place[2] - foot[2])
                )
                for p in range(used):
                    row[p] = columns[p, 0] * ux + columns[p, 1] * uy + columns[p, 2] * uz
                add_row(row, used, miss, pitch, hessian, gradient)
            if needed > 0.0:
                g = find_clearance(duct, placing, bore, place, slope)
                if g < needed:
                    for p in range(used):
                        row[p] = -(
                            columns[p, 0] * slope[0]
                            + columns[p, 1] * slope[1]
                            + columns[p, 2] * slope[2]
                        )
                    add_row(row, used, needed - g, WALL_WEIGHT * pitch, hessian, gradient)
    # The tip stands at the head's arc length.
    k = min(max(np.searchsorted(arc, head) - 1, 0), path.shape[0] - 2)
    w = (head - arc[k]) / (arc[k + 1] - arc[k])
    miss = 0.0
    for r in range(3):
        foot[r] = path[k, r] + w * (path[k + 1, r] - path[k, r])
        foot[3 + r] = (path[k + 1, r] - path[k, r]) / (arc[k + 1] - arc[k])
        miss += foot[3 + r] * (frames[sections, r, 3] - foot[r])
    for p in range(count):
        row[p] = columns[p, 0] * foot[3] + columns[p, 1] * foot[4] + columns[p, 2] * foot[5]
    add_row(row, count, miss, TIP_WEIGHT, hessian, gradient)
    return count


@kernel
def _add_limits(lengths, limits, coupling, travel, bends, advance, first, hessian, gradient):
    """Add what resists: sections partly in the introducer, bends and tendons past their limits."""
    sections = lengths.size
    count = 1 + 2 * (sections - first)
    row = np.zeros(count)
    end = advance
    for i in range(sections - 1, first - 1, -1):
        out = min(end, lengths[i])
        end -= lengths[i]
        p = 1 + 2 * (i - first)
        stiff = STIFFNESS * lengths[i] ** 3 * min((lengths[i] / out) ** 2 - 1.0, 1e8)
        # A trace for a section whose bend nothing shows.
        stiff = max(stiff, 1e-9 * lengths[i] ** 3)
        for c in range(2):
            hessian[p + c, p + c] += stiff
            gradient[p + c] += stiff * bends[i, c]
        size = math.hypot(bends[i, 0], bends[i, 1])
        if size > limits[i]:
            row[:] = 0.0
            row[p] = bends[i, 0] / size
            row[p + 1] = bends[i, 1] / size
            add_row(row, p + 2, size - limits[i], LIMIT_WEIGHT, hessian, gradient)
    for t in range(coupling.shape[0]):
        if travel[t, 0] == -np.inf and travel[t, 1] == np.inf:
            continue
        pulled = 0.0
        for i in range(first, sections):
            pulled += coupling[t, 2 * i] * bends[i, 0] + coupling[t, 2 * i + 1] * bends[i, 1]
        over = max(pulled - travel[t, 1], 0.0) + min(pulled - travel[t, 0], 0.0)
        if over != 0.0:
            row[0] = 0.0
            for p in range(1, count):
                row[p] = coupling[t, 2 * first + p - 1]
            add_row(row, count, over, LIMIT_WEIGHT, hessian, gradient)


@kernel(nogil=True)
def fit_motion(
    duct,
    placing,
    bore,
    lengths,
    samples,
    limits,
    coupling,
    travel,
    path,
    tangents,
    arc,
    heads,
    needed,
    rounds,
    bends,
    advances,
    used,
):
    """Fit all steps in turn, each from the one before.

    Parameters
    ----------
    placing : (4, 3) float
        Axes and origin of the introducer's frame in the duct's.
    samples : (m,) int
        Points of each section that are held to the path.
    limits : (m,) float
        Largest bends [rad].
    coupling, travel : (t, 2 m), (t, 2) float
        Tendon displacements per bend, and their limits [mm].
    path, tangents, arc : (n, 3), (n, 3), (n,) float
        The path, from inside the introducer to the goal; arc length is 0 at the entry.
    needed : float
        Clearance of the backbone below which the wall pushes [mm]; 0 for none.
    rounds : int
        Iterations per step at most.
    bends, advances, used : (steps, m, 2), (steps,), (steps,)
        Filled; `used` are the iterations.
    """
    sections = lengths.size
    total = lengths.sum()
    most = 1 + 2 * sections
    hessian = np.empty((most, most))
    gradient = np.empty(most)
    frames = np.empty((sections + 1, 3, 4))
    current = np.zeros((sections, 2))
    guesses = np.zeros((sections, samples.max()), np.int64)
    advance = 0.0
    before = 0.0
    for step in range(heads.size):
        head = heads[step]
        advance = min(max(advance + head - before, 0.0), total)
        before = head
        end = total
        for i in range(sections - 1, -1, -1):
            for n in range(samples[i]):
                back = lengths[i] * (1.0 - (n + 1.0) / samples[i]) + total - end
                guesses[i, n] = np.searchsorted(arc, head - back) - 1
            end -= lengths[i]
        used[step] = rounds
        for trial in range(rounds):
            first = sections
            end = 0.0
            while first > 0 and advance - end > ENTERED:
                first -= 1
                end += lengths[first]
            current[:first] = 0.0
            if first == sections:
                advance = head
                used[step] = trial
                break
            count = _assemble(
                duct,
                placing,
                bore,
                lengths,
                samples,
                path,
                tangents,
                arc,
                head,
                needed,
                current,
                advance,
                first,
                hessian,
                gradient,
                frames,
                guesses,
            )
            _add_limits(
                lengths, limits, coupling, travel, current, advance, first, hessian, gradient
            )
            if not solve(hessian, gradient, count):
                break
            largest = 0.0
            for p in range(1, count):
                largest = max(largest, abs(gradient[p]))
            scale = min(1.0, STEP_CAP / max(largest, 1e-300))
            moved = advance
            advance = min(max(advance - scale * gradient[0], 0.0), total)
            for p in range(1, count):
                current[first + (p - 1) // 2, (p - 1) % 2] -= scale * gradient[p]
            if max(largest, abs(advance - moved)) < SETTLED:
                used[step] = trial + 1
                break
        advances[step] = advance
        for i in range(sections):
            size = math.hypot(current[i, 0], current[i, 1])
            # Rounding must not take it past its limit.
            scale = min(1.0, (1.0 - 1e-12) * limits[i] / max(size, 1e-300))
            for c in range(2):
                bends[step, i, c] = scale * current[i, c]


@kernel
def measure_fit(lengths, samples, path, tangents, arc, heads, bends, advances, rms, largest):
    """Fill `rms` and `largest` (steps,): how far the body outside the introducer is off the path.

    Distances [mm] of samples of the backbone from the nearest point of the path.
    """
    sections = lengths.size
    total = lengths.sum()
    frame = np.empty((4, 4))
    after = np.empty((4, 4))
    foot = np.empty(6)
    for step in range(heads.size):
        set_identity(frame)
        frame[2, 3] = advances[step] - total
        square = 0.0
        weight = 0.0
        largest[step] = 0.0
        end = 0.0
        for i in range(sections):
            pitch = lengths[i] / samples[i]
            for n in range(samples[i]):
                share = (n + 1.0) / samples[i]
                put_arc(
                    frame,
                    share * lengths[i],
                    share * bends[step, i, 0],
                    share * bends[step, i, 1],
                    after,
                )
                back = total - end - share * lengths[i]
                if advances[step] - back <= 0.0:
                    continue
                guess = np.searchsorted(arc, heads[step] - back) - 1
                x, y, z = after[0, 3], after[1, 3], after[2, 3]
                project_on_path(path, tangents, guess, x, y, z, foot)
                d = (x - foot[0]) ** 2 + (y - foot[1]) ** 2 + (z - foot[2]) ** 2
                square += pitch * d
                weight += pitch
                largest[step] = max(largest[step], math.sqrt(d))
            copy_matrix(after, frame)
            end += lengths[i]
        rms[step] = math.sqrt(square / weight) if weight > 0.0 else 0.0
