"""A rod to shoot, what is asked of it, and a state of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._rod_kernels import find_turn, integrate_rod

__all__ = ["Rod", "Shot", "Target", "rotate"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A rod cut into steps, as the kernels take it, and how many pieces to shoot.

    Attributes
    ----------
    grid : tuple of ndarray
        Steps' ends, stiffness, places of tendons, and where they run, see `integrate_rod`.
    tip_force, tip_moment, line_force : (3,) ndarray
        Loads [N], [N mm], [N/mm].
    pieces : int
        Pieces of the shooting.
    moment_scale, load : float
        Moment that bends the robot by about 1 rad [N mm], and the loads against it.
    unit_tension, strongest : float
        Tension that bends it by about 1 rad, and the one at which a command is impossible [N].
    """

    grid: tuple[Floats, Floats, Floats, NDArray[np.bool_]]
    tip_force: Floats
    tip_moment: Floats
    line_force: Floats
    pieces: int
    moment_scale: float
    load: float
    unit_tension: float
    strongest: float

    @property
    def cuts(self) -> NDArray[np.int64]:
        """First step of every piece, and the last one's end, shape (pieces + 1,)."""
        cuts = np.linspace(0.0, len(self.grid[0]) - 1.0, self.pieces + 1)
        return np.round(cuts).astype(np.int64)

    def rest(self, tendons: int, reason: str = "") -> Shot:
        """Return the straight rod under none of its command."""
        turns = np.zeros((self.pieces, 4))
        turns[:, 0] = 1.0
        return Shot(
            tensions=np.zeros(tendons),
            turns=turns,
            moments=np.zeros((self.pieces, 3)),
            share=0.0,
            reason=reason,
        )

    def trace(self, shot: Shot) -> tuple[Floats, Floats, bool]:
        """Return the states and bends at all places, and whether it got through."""
        states, bends, _, good = self._pass(shot)
        return states, bends, good

    def trace_jumps(self, shot: Shot) -> tuple[Floats, Floats, bool]:
        """Return the states, the jumps between pieces (pieces, 6), and whether it got through.

        The last row is the end against the load on it, without a turn.
        """
        states, _, jumps, good = self._pass(shot)
        return states, jumps, good

    def _pass(self, shot: Shot) -> tuple[Floats, Floats, Floats, bool]:
        states = np.zeros((len(self.grid[0]), 10 + len(shot.tensions)))
        bends = np.zeros((len(self.grid[0]), 3))
        jumps = np.zeros((self.pieces, 6))
        good = True
        cuts = self.cuts
        for index, (first, last) in enumerate(zip(cuts[:-1], cuts[1:], strict=True)):
            if index > 0:
                find_turn(shot.turns[index], states[first, 3:7], jumps[index - 1, :3])
                jumps[index - 1, 3:] = states[first, 7:10] - shot.moments[index]
            states[first, 3:7], states[first, 7:10] = shot.turns[index], shot.moments[index]
            good = good and integrate_rod(
                first,
                last,
                self.grid,
                shot.tensions,
                (shot.share * self.tip_force, shot.share * self.line_force),
                states,
                bends,
            )
        jumps[-1, 3:] = states[-1, 7:10] - shot.share * self.tip_moment
        return states, bends, jumps, bool(good)


@dataclass(frozen=True, kw_only=True)
class Target:
    """What is asked of the tendons.

    Attributes
    ----------
    names : tuple of str
        Their names.
    pushes : (t,) ndarray of bool
        Which of them are rods.
    compliances : (t,) ndarray
        How much they stretch by their tension [mm/N].
    tolerance : float
        Error of their lengths that is let through [mm].
    natural, command : (t,) ndarray
        Their lengths in the straight robot, and the displacements asked for [mm].
    reaches : (t,) ndarray
        Their least distances from the backbone [mm].
    tensions : (t,) ndarray
        Tensions [N], in place of displacements.
    """

    names: tuple[str, ...]
    pushes: NDArray[np.bool_]
    compliances: Floats
    tolerance: float
    natural: Floats
    reaches: Floats
    command: Floats | None = None
    tensions: Floats | None = None

    def limit(self, share: float, loose: float) -> Floats:
        """Return the lengths of the cables for a share of the command [mm]; inf if not asked."""
        if self.command is None:
            return np.full(len(self.names), math.inf)
        return np.asarray(self.natural - share * self.command + loose * ~self.pushes)

    def gaps(self, lengths: Floats, tensions: Floats, share: float, loose: float) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        if self.command is None:
            return np.zeros(len(self.names))
        gaps = lengths - self.compliances * tensions - self.limit(share, loose)
        free = ~self.pushes & (tensions == 0.0)
        return np.asarray(np.where(free, np.maximum(gaps, 0.0), gaps))


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A state of the rod: tensions, and quaternion and moment at the start of every piece.

    `share` is the part of command and loads that it holds for; `reason` says why it is not all.
    """

    tensions: Floats
    turns: Floats
    moments: Floats
    share: float = 1.0
    iterations: int = 0
    reason: str = ""


def rotate(quaternions: Floats) -> Floats:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4), scalar first."""
    w, x, y, z = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.asarray(rows), -1, 0)
