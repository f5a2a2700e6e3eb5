"""Numba kernels for a whole chain: advance it along the path, and look at its whole body."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..duct._clearance_kernels import clearance_estimate
from ._direction_kernels import duct_value
from ._link_kernels import INFEASIBLE, place_tail

__all__ = ["advance_chain", "measure_body"]

DONE = 0
BUFFER_FULL = 1
HEAD_BLOCKED = 2
LINK_INFEASIBLE = 3
LINK_LOCKED = 4


@njit(cache=True)
def _point_on_path(path, arc, s, where, point):
    """Fill `point` with the path's point at arc length `s`; `where` is the last segment used."""
    n = arc.shape[0]
    while where < n - 2 and arc[where + 1] < s:
        where += 1
    span = arc[where + 1] - arc[where]
    u = min(max((s - arc[where]) / span, 0.0), 1.0)
    for k in range(3):
        point[k] = path[where, k] + u * (path[where + 1, k] - path[where, k])
    return where


@njit(cache=True)
def advance_chain(
    duct,
    intro,
    path,
    arc,
    length,
    room,
    slope,
    planar,
    head_step,
    jump,
    chain,
    state,
    out,
    trail,
):
    """Advance the head along the path and let every next joint follow (thesis 5.3, corrected).

    A joint that would move by more than `jump` has its head step halved, down to 1/64; if the
    jump does not shrink below `jump` then, the link is locked.

    Parameters
    ----------
    duct : named tuple
        The packed duct.
    slope, planar
        As for `place_tail`.
    chain : (joints, 3) float
        The chain, updated in place to the last accepted step.
    state : (4,) float
        In and out: head arc length of the last accepted step, link index, value (how much room
        lacks, or jump), and where the head was in the step that failed.
    out : (rows, joints, 3) float
        Filled with accepted steps.
    trail : (rows,) float
        Filled with the head's arc length at each.

    Returns
    -------
    code : int
        Why it returned.
    rows : int
        How many rows were filled.
    """
    joints = chain.shape[0]
    trial = np.empty_like(chain)
    work = np.empty((6, 5))
    where = 0
    rows = 0
    end = arc[-1]
    s = state[0]
    size = head_step
    floor = head_step / 64.0
    while s < end - 1e-12:
        if rows == out.shape[0]:
            state[0] = s
            return BUFFER_FULL, rows
        target = min(s + size, end)
        where = _point_on_path(path, arc, target, where, trial[0])
        depth = duct_value(duct, intro, trial[0, 0], trial[0, 1], trial[0, 2])
        if depth + room > 0.0:
            if size > floor:
                size *= 0.5
                where = 0
                continue
            state[0] = s
            state[2] = depth
            state[3] = target
            return HEAD_BLOCKED, rows
        code = 0
        value = 0.0
        link = 0
        for j in range(1, joints):
            code, value = place_tail(
                duct, intro, trial[j - 1], chain[j], length, room, slope, planar, work, trial[j]
            )
            move = math.sqrt(
                (trial[j, 0] - chain[j, 0]) ** 2
                + (trial[j, 1] - chain[j, 1]) ** 2
                + (trial[j, 2] - chain[j, 2]) ** 2
            )
            if code == INFEASIBLE:
                link = j
                break
            if move > jump:
                code = LINK_LOCKED
                value = move
                link = j
                break
        if code >= LINK_INFEASIBLE:
            if size > floor:
                size *= 0.5
                where = 0
                continue
            state[0] = s
            state[1] = link
            state[2] = value
            state[3] = target
            return code, rows
        s = target
        for j in range(joints):
            for k in range(3):
                chain[j, k] = trial[j, k]
                out[rows, j, k] = trial[j, k]
        trail[rows] = s
        rows += 1
        size = min(2.0 * size, head_step)
    state[0] = s
    return DONE, rows


@njit(cache=True)
def measure_body(duct, intro, chains, radius, pitch, clearance, worst):
    """Estimate the clearance of every link of every step by samples along the links.

    The tail end of the chain that still is in the introducer is left out: from the tail towards
    the head, everything up to the first sample that is ahead of the entry or outside the bore.

    Parameters
    ----------
    duct : named tuple
        The packed duct.
    chains : (steps, joints, 3) float
    radius : float
        Of the body [mm].
    pitch : float
        Largest distance between samples [mm].
    clearance : (steps, joints - 1) float
        Filled; infinite for links wholly in the introducer.
    worst : (4,) float
        Filled with the place (3,) of the smallest clearance, and its value.
    """
    worst[3] = np.inf
    for t in range(chains.shape[0]):
        waiting = intro[6] > 0.0
        for j in range(chains.shape[1] - 1, 0, -1):
            ax, ay, az = chains[t, j, 0], chains[t, j, 1], chains[t, j, 2]
            dx = chains[t, j - 1, 0] - ax
            dy = chains[t, j - 1, 1] - ay
            dz = chains[t, j - 1, 2] - az
            size = math.sqrt(dx * dx + dy * dy + dz * dz)
            parts = max(1, int(math.ceil(size / pitch - 1e-6)))
            least = np.inf
            skip = 0
            for m in range(parts + 1):
                if skip > 0:
                    # The interpolant falls by at most sqrt(3) per mm: nothing less can be here.
                    skip -= 1
                    continue
                u = m / parts
                x = ax + u * dx
                y = ay + u * dy
                z = az + u * dz
                if waiting:
                    px = x - intro[0]
                    py = y - intro[1]
                    pz = z - intro[2]
                    t_out = px * intro[3] + py * intro[4] + pz * intro[5]
                    px -= t_out * intro[3]
                    py -= t_out * intro[4]
                    pz -= t_out * intro[5]
                    off = math.sqrt(px * px + py * py + pz * pz)
                    if t_out >= 0.0 and off <= intro[6]:
                        continue
                    waiting = False
                room = clearance_estimate(duct, x, y, z) - radius
                skip = int(max(room - least, 0.0) * parts / (1.7321 * max(size, 1e-9)))
                if room < least:
                    least = room
                    if room < worst[3]:
                        worst[0] = x
                        worst[1] = y
                        worst[2] = z
                        worst[3] = room
            clearance[t, j - 1] = least
