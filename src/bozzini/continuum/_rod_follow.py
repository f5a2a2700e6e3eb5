"""A rod brought to a command and its loads, at once or else in parts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ._rod_newton import Shooting
from ._rod_state import Rod, Shot, Target
from ._rod_unloaded import improve_unloaded

__all__ = ["find_play", "follow"]

SMALLEST_PART = 1.0 / 16.0
"""Smallest part, of the first one, by which it is raised where more of it fails."""

LOAD_STEP = 2.0
"""Largest part of the loads that is put on at once, against those that bend it by 1 rad."""

PLAY = 1e-4
"""Displacement of the tip that the tolerance may always make, against the rod's length."""

TIGHT = 0.1
"""Part of the tolerance that is left."""

LEVERS = 10.0
"""The same against what the tolerance makes of it over the lever of length by offset."""

PUSH_STEP = 0.5
"""Largest turn that tendons ask for at once, where there may be several equilibria [rad]."""


def follow(rod: Rod, target: Target, *, convex: bool) -> Shot:
    """Find the rod's state from the straight one on, as far as it can be followed.

    `convex` is whether there is only one without loads, whatever the way to it.
    """
    kept = rod.rest(len(target.names))
    # Little by little, where at once it may end on another branch.
    part, steps, reason = min(1.0, LOAD_STEP / max(rod.load, 1e-9)), 0, ""
    if target.command is not None and not convex:
        turn = float((np.abs(target.command) / target.reaches).max(initial=0.0))
        part = min(part, PUSH_STEP / max(turn, PUSH_STEP))
    smallest = SMALLEST_PART * part
    # As commanded to round-off; with the tolerance, and in parts, only where that cannot be.
    loose = 1e-3 * target.tolerance
    while kept.share < 1.0:
        share = min(1.0, kept.share + part)
        if share > 1.0 - 1e-9:
            share = 1.0
        if rod.load == 0.0:
            found = improve_unloaded(rod, target, share, loose, kept)
        else:
            found = Shooting(rod, target, share, loose).improve(kept)
        steps += found.iterations
        if not found.reason:
            kept = found
            continue
        reason = found.reason
        if loose < target.tolerance:
            loose = target.tolerance
        else:
            part *= 0.5
        if part < smallest:
            percent = math.floor(100.0 * kept.share)
            what = "command and loads" if rod.load > 0.0 else "the command"
            reason = f"{what} can be followed to {percent} % only: {reason}"
            break
    else:
        reason = find_play(rod, target, loose, kept)
    return dataclasses.replace(kept, iterations=steps, reason=reason)


def find_play(rod: Rod, target: Target, loose: float, found: Shot) -> str:
    """Say whether displacements that are the same within the tolerance put the tip elsewhere.

    Parallel tendons that do not stretch hold the twist so that it grows with the root of what
    they have too much: then the tolerance decides where the tip is, not the loads.
    """
    if rod.load == 0.0 or target.command is None or target.compliances.any():
        return ""
    if not target.command.size:
        return ""
    if loose == target.tolerance:  # it was needed: without most of it
        other = Shooting(rod, target, 1.0, TIGHT * loose).improve(found)
    else:
        looser = dataclasses.replace(target, command=target.command - target.tolerance)
        other = Shooting(rod, looser, 1.0, loose).improve(found)
    what = (
        "tendons that do not stretch leave the shape open under these loads: for displacements "
        f"that differ by the tolerance of {target.tolerance:g} mm"
    )
    if other.reason:
        return f"{what} no equilibrium was found; give a tendon_stiffness"
    tips = [rod.trace(shot)[0][-1, :3] for shot in (found, other)]
    play, length = float(np.linalg.norm(tips[1] - tips[0])), float(rod.grid[0][-1])
    lever = length / float(target.reaches.min())
    if play <= max(PLAY * length, LEVERS * lever * target.tolerance):
        return ""
    return f"{what} the tip is {play:.2g} mm elsewhere; give a tendon_stiffness"
