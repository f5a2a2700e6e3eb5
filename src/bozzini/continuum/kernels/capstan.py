"""Numba kernels of tendons with friction on the discrete rod: tensions along them, for one shape.

A tendon has a tension ``T_i`` in each segment that it passes, i from the base, and ``T_-1`` at its
drive. Where it comes from one segment into the next it turns by ``phi_i``, between the middles of
the two in a channel, at the disc between straight pieces; at the base it turns from the way of its
channel there. What lies beyond has the length ``E_i = sum (l_m - c_m T_m)`` over m >= i without
tension, with lengths ``l`` and compliances ``c`` of its pieces. Capstan law and Dahl's, as of
`kernels.friction`, with memory and length of the step before::

    T_i = T_i-1 exp(-mu phi_i sigma_i sign T) ,   sigma_i = clip(trial_i, -1, 1)
    trial_i = memory_i + (E_before_i - E_i) / delta

The tension at the drive is given, or the length ``E_0``; a cable that is too short for it is
slack, and has no tension anywhere. With the tensions of a shape the rod is pulled by ``-sum T_i
dl_i/dq``, whose work is that of the drive, of what stretches, and of friction.

*For one shape* the laws are one chain for each tendon: more tension stretches a tendon, which
slides on, and has less tension beyond. So there is one answer. Newton's method on the shares
``sigma`` eliminates it from the tip, ``dT_i = f_i dT_i-1 + g_i``, ``sum_(m >= i) c_m dT_m = w_i
dT_i + v_i+1``; contacts that stick are those with a share within (-1, 1), and one that slides
sticks before it slides back. What tensions change by lengths follows by the same elimination.
"""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel
from ...numeric.kernels.copies import copy_vector
from .energy import (
    CHANNEL,
    fill_functions,
    fill_rotation,
    measure_channel,
    measure_length,
    move_forward,
)
from .friction import measure_angle
from .loads import rotate_back

MOST_ITERATIONS = 80
"""Steps of Newton's method for the tensions of a tendon."""

WHOLE_STEPS = 20
"""Those that change shares in full; further ones are halved, against cycles."""

STUCK = 1.0 - 1e-9
"""Share of the friction at which a contact that slid begins to stick."""

SHARE_TOLERANCE = 2e-9
"""Change of a share at which tensions are found; more than it is from stuck to sliding."""

STRETCH_TOLERANCE = 1e-10
"""What the last change of a drive's tension may stretch the tendon [mm]."""


@kernel
def make_strings(n, k):
    """Empty arrays of k tendons along n segments.

    ``now`` are lengths, angles, tensions, shares, shares that are not clipped, and lengths without
    tension to the end, (k, n). ``before`` are tensions (k, n + 1), that of the drive first, shares
    and lengths without tension (k, n) of the step before. ``last`` are clipped shares and others
    of the shape looked at before, (k, n). Then six arrays of one tendon (n,), and the matrix of
    all rotations.
    """
    now = (
        np.zeros((k, n)),
        np.zeros((k, n)),
        np.zeros((k, n)),
        np.zeros((k, n)),
        np.zeros((k, n)),
        np.zeros((k, n)),
    )
    before = np.zeros((k, n + 1)), np.zeros((k, n)), np.zeros((k, n))
    last = np.zeros((k, n)), np.zeros((k, n))
    size = 3 * n if k > 0 else 0
    dense = np.empty((size, size)), np.empty(size, dtype=np.int64), np.empty((size, 1))
    return now, before, last, np.empty((6, n)), dense


@kernel
def measure_strings(grid, starts, q, bending, pull, now):
    """Fill the lengths of tendons in segments, their gradients (k, n, 3), and angles of contacts.

    And, if ``bending``, the second derivatives (n, 3, 3) with the tensions of ``now``. ``starts``
    (k, 3) are the ways of the tendons in the base.
    """
    spans, _, paths, guides, counts, kind = grid
    gradients, psd, blocks = pull[2:]
    lengths, angles, tensions = now[:3]
    f, half, step, slope = np.empty(8), np.empty(8), np.empty(3), np.empty((3, 3))
    work, turn, inner = np.empty((5, 3)), np.empty((3, 3)), np.empty(3)
    way, here, ahead = np.empty(3), np.empty(3), starts.copy()
    if bending:
        blocks[:] = 0.0
    for j in range(spans.size):
        w = q[j]
        square = w[0] ** 2 + w[1] ** 2 + w[2] ** 2
        fill_functions(square, f)
        fill_functions(0.25 * square, half)
        if kind == CHANNEL:
            for i in range(3):
                inner[i] = 0.5 * w[i]
            fill_rotation(inner, half, turn)
        else:
            move_forward(w, f, half, spans[j], kind, step, slope)
            fill_rotation(w, f, turn)
        backbone = w, f, half, spans[j], kind, step, slope
        for m in range(counts.size):
            if j >= counts[m]:
                continue
            tension, own = tensions[m, j] if bending else 0.0, gradients[m, j]
            if kind == CHANNEL:
                lengths[m, j] = measure_channel(
                    w, spans[j], guides[m, j], tension, own, psd[j], blocks[j]
                )
                guide = guides[m, j, guides.shape[2] // 2]
                way[0] = guide[2] - w[2] / spans[j] * guide[1]
                way[1] = guide[3] + w[2] / spans[j] * guide[0]
                way[2] = 1.0 + (w[0] * guide[1] - w[1] * guide[0]) / spans[j]
                for i in range(3):
                    here[i] = turn[i, 0] * way[0] + turn[i, 1] * way[1] + turn[i, 2] * way[2]
                angles[m, j] = measure_angle(ahead[m], here)
                rotate_back(turn, way, ahead[m])
            else:
                lengths[m, j] = measure_length(
                    backbone, paths[m, j : j + 2], tension, work, own, psd[j], blocks[j]
                )
                angles[m, j] = measure_angle(ahead[m], work[4])
                rotate_back(turn, work[4], ahead[m])


@kernel
def _compare(m, count, compliances, delta, now, before):
    """Fill lengths to the end and shares that are not clipped; returns the stretch in all."""
    lengths, _, tensions, _, trials, beyond = now
    left, stretch = 0.0, 0.0
    for i in range(count - 1, -1, -1):
        stretched = compliances[m, i] * tensions[m, i]
        left += lengths[m, i] - stretched
        stretch += stretched
        beyond[m, i] = left
        trials[m, i] = before[1][m, i] + (before[2][m, i] - left) / delta
    return stretch


@kernel
def settle_tensions(m, count, rubbing, told, drives, strings):
    """Find the tensions of tendon m of ``count`` segments, for lengths and angles that are known.

    ``rubbing`` are coefficients of friction (k,), ways in the base, compliances of the pieces (k,
    n), and the slip at which friction acts in full. ``told`` are the tension or length of the
    drive, which of both, and whether the tendon only pulls. Tensions of the ``drives`` (k,) and
    shares are where it starts. Returns whether they were found.
    """
    friction, _, compliances, delta = rubbing
    target, held, one_sided = told
    now, before, _, spare, _ = strings
    lengths, angles, tensions, shares, trials, _ = now
    factors, shifts, widths, offsets = spare[0], spare[1], spare[2], spare[3]
    gap, flexible = -target, 0.0
    for i in range(count):
        gap += lengths[m, i]
        flexible += compliances[m, i]
    wanted = gap if held else target
    if wanted == 0.0 or (held and one_sided and wanted < 0.0):
        drives[m] = 0.0
        for i in range(count):
            tensions[m, i] = 0.0
        _compare(m, count, compliances, delta, now, before)
        for i in range(count):
            shares[m, i] = min(1.0, max(-1.0, trials[m, i]))
        return True
    sign = 1.0 if wanted > 0.0 else -1.0
    rub = friction[m] * sign
    if not held:
        drives[m] = target
    elif drives[m] * sign <= 0.0:
        drives[m] = gap / flexible
    for iteration in range(MOST_ITERATIONS):
        tension = drives[m]
        for i in range(count):
            tension *= math.exp(-rub * angles[m, i] * shares[m, i])
            tensions[m, i] = tension
        stretch = _compare(m, count, compliances, delta, now, before)
        width, offset, above = 0.0, 0.0, 0.0
        for i in range(count - 1, -1, -1):
            bound = rub * angles[m, i]
            tension, above = tensions[m, i], math.exp(-bound * shares[m, i])
            by_share, missing = 0.0, 0.0
            if abs(shares[m, i]) < 1.0:
                by_share = tension * bound / delta
                missing = tension * bound * (trials[m, i] - shares[m, i])
            offsets[i], widths[i] = offset, compliances[m, i] + width
            whole = 1.0 + by_share * widths[i]
            factors[i] = above / whole
            shifts[i] = -(missing + by_share * offset) / whole
            width = widths[i] * factors[i]
            offset += widths[i] * shifts[i]
        change = (gap - stretch - offset) / width if held else 0.0
        if (drives[m] + change) * sign <= 0.0:
            change = -0.9 * drives[m]
        moved, good = change, abs(change) * flexible <= STRETCH_TOLERANCE
        drives[m] += change
        for i in range(count):
            moved = factors[i] * moved + shifts[i]
            trial = trials[m, i] + (widths[i] * moved + offsets[i]) / delta
            share = shares[m, i]
            if abs(share) < 1.0:
                wish = min(1.0, max(-1.0, trial))
            else:
                wish = share if trial * share >= 1.0 else STUCK * share
            part = 1.0 if iteration < WHOLE_STEPS else 0.5
            good = good and abs(wish - share) <= SHARE_TOLERANCE
            shares[m, i] = share + part * (wish - share)
        if good:
            return True
    return False


@kernel
def keep_shares(now, last):
    """Remember the shares of the shape that was looked at."""
    shares, trials = now[3], now[4]
    for m in range(len(shares)):
        for i in range(shares.shape[1]):
            last[0][m, i], last[1][m, i] = shares[m, i], trials[m, i]


@kernel
def add_tendon(m, count, rubbing, held, drive, gradients, first, strings):
    """Add what tendon m's tensions change by lengths, of which ``gradients`` (n, 3), to the matrix.

    Shares change with slip as they did since the shape looked at before, but at the ``first``.
    """
    friction, _, compliances, delta = rubbing
    now, _, last, spare, dense = strings
    angles, tensions, shares, trials = now[1:5]
    factors, widths, wholes, by_slips = spare[0], spare[2], spare[3], spare[4]
    matrix, shifts = dense[0], spare[1]
    if drive == 0.0:
        return
    rub, width = friction[m] * (1.0 if drive > 0.0 else -1.0), 0.0
    for i in range(count - 1, -1, -1):
        bound = rub * angles[m, i]
        slope = 1.0 if abs(shares[m, i]) < 1.0 else 0.0
        way = trials[m, i] - last[1][m, i]
        if not first and abs(way) > 1e-6:
            slope = (shares[m, i] - last[0][m, i]) / way
        by_slips[i] = tensions[m, i] * bound * slope / delta
        widths[i] = compliances[m, i] + width
        wholes[i] = 1.0 + by_slips[i] * widths[i]
        factors[i] = math.exp(-bound * shares[m, i]) / wholes[i]
        width = widths[i] * factors[i]
    for p in range(count):
        offset = 0.0
        for i in range(p, -1, -1):
            shifts[i] = by_slips[i] * (1.0 - offset) / wholes[i]
            offset += widths[i] * shifts[i]
        moved = (1.0 - offset) / width if held else 0.0
        own = gradients[p]
        for i in range(count):
            moved = factors[i] * moved + (shifts[i] if i <= p else 0.0)
            if moved == 0.0:
                continue
            for a in range(3):
                for b in range(3):
                    matrix[3 * i + a, 3 * p + b] += moved * gradients[i, a] * own[b]


@kernel
def begin_strings(grid, rubbing, drives, strings):
    """Let tendons hold the tensions of their drives (k,) evenly, where lengths are known."""
    now, before = strings[:2]
    for m in range(drives.size):
        count = grid[4][m]
        for i in range(count):
            now[2][m, i], before[0][m, i] = drives[m], drives[m]
            now[3][m, i], before[1][m, i] = 0.0, 0.0
        before[0][m, count] = drives[m]
        _compare(m, count, rubbing[2], rubbing[3], now, before)
        copy_vector(now[5][m], before[2][m])


@kernel
def return_strings(drives, strings):
    """Go back to the tensions and shares of the step before."""
    now, before = strings[:2]
    for m in range(drives.size):
        drives[m] = before[0][m, 0]
        for i in range(now[2].shape[1]):
            now[2][m, i], now[3][m, i] = before[0][m, i + 1], before[1][m, i]


@kernel
def keep_strings(rubbing, drives, strings):
    """Make what a step has found what the next one starts from; returns what friction took [N mm].

    What is slid further than a contact yields before it slides, with the mean of the friction at
    the step's ends.
    """
    now, before = strings[:2]
    _, _, tensions, shares, trials, beyond = now
    lost = 0.0
    for m in range(drives.size):
        ahead, ahead_before = drives[m], before[0][m, 0]
        before[0][m, 0] = ahead
        for i in range(tensions.shape[1]):
            tension, tension_before = tensions[m, i], before[0][m, i + 1]
            slid = abs(trials[m, i] - shares[m, i]) * rubbing[3]
            lost += 0.5 * slid * (abs(ahead - tension) + abs(ahead_before - tension_before))
            ahead, ahead_before = tension, tension_before
            before[0][m, i + 1], before[1][m, i] = tension, shares[m, i]
            before[2][m, i] = beyond[m, i]
    return lost
