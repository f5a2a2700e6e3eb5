"""Multiple shooting: moments, turns and tensions for which a rod and its tendons are as asked."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ._energy_tension_kernels import solve_bounded
from ._rod_kernels import differentiate_piece, turn_quaternion
from ._rod_state import Rod, Shot, Target

__all__ = ["Shooting"]

Floats = NDArray[np.float64]

MOST_STEPS = 25
"""Newton steps for one part of a command."""

TURN_LIMIT = 0.5
"""Largest turn between two pieces in one step [rad]."""

RIDGE = 1e-8
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""

SHARING = 1e-5
"""The same where the tensions are shared out: above what differences leave of such directions."""

DIFFERENCE = 1e-4
"""Step of the differences, against the size of what is changed."""


@dataclass
class Shooting:
    """Newton's method for one share of command and loads.

    ``loose`` is by how much cables may be longer than asked [mm].
    """

    rod: Rod
    target: Target
    share: float
    loose: float
    give: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def improve(self, start: Shot) -> Shot:
        """Return the state from `start` on, or where it stopped and why."""
        rod, target = self.rod, self.target
        tensions, turns, moments = start.tensions.copy(), start.turns.copy(), start.moments.copy()
        solves = target.command is not None
        if target.tensions is not None:
            tensions = self.share * target.tensions

        def stop(count: int, reason: str) -> Shot:
            return Shot(
                tensions=tensions,
                turns=turns,
                moments=moments,
                share=self.share,
                iterations=count,
                reason=reason,
            )

        gaps = np.zeros(0)
        for count in range(MOST_STEPS + 1):
            system = self._linearise(tensions, turns, moments)
            if system is None:
                return stop(count, "Newton's method fails beyond it")
            off, matrix, by_tension, lengths, length_slope = system
            gaps = target.gaps(lengths, tensions, self.share, self.loose)
            scale = rod.moment_scale + float(np.abs(moments).max())
            size = float(np.abs(off).max()) / scale
            if size <= 1e-10 and np.abs(gaps).max(initial=0.0) <= self.loose:
                if solves and len(tensions):
                    tensions = self._share_tensions(tensions, turns, moments, scale)
                return stop(count, "")
            if count == MOST_STEPS:
                break
            inverse = self._invert(matrix, scale)
            if inverse is None:
                return stop(count, "the rod is about to buckle beyond it")
            wanted = tensions
            if solves and len(tensions):
                wanted, why = self._pull(
                    lengths, tensions, off, inverse @ by_tension, inverse @ off, length_slope
                )
                if why:
                    return stop(count, why)
            move = -inverse @ (off + by_tension @ (wanted - tensions))
            part = self._move(turns, moments, move)
            tensions = tensions + part * (wanted - tensions)
        worst = int(np.argmax(np.abs(gaps))) if solves and len(gaps) else -1
        where = (
            f", tendon '{target.names[worst]}' misses by {abs(gaps[worst]):.3g} mm"
            if worst >= 0 and gaps[worst] != 0.0
            else ""
        )
        stiff = solves and rod.load > 0.0 and not target.compliances.any()
        advice = "; give a tendon_stiffness" if stiff else ""
        return stop(MOST_STEPS, f"no equilibrium was found beyond it{where}{advice}")

    def _invert(self, matrix: Floats, scale: float) -> Floats | None:
        # Turns in radians, moments in their own unit: one size for all.
        units = np.ones(6 * self.rod.pieces - 3)
        units[:3] = scale
        for index in range(1, self.rod.pieces):
            units[6 * index : 6 * index + 3] = scale
        try:
            return np.asarray(np.linalg.inv(matrix / units) / units[:, None])
        except np.linalg.LinAlgError:
            return None

    def _linearise(
        self, tensions: Floats, turns: Floats, moments: Floats
    ) -> tuple[Floats, Floats, Floats, Floats, Floats] | None:
        """Jumps between pieces, and lengths, with derivatives by unknowns and by tensions.

        Unknowns are the first piece's moment, then turn and moment of every other one's start.
        """
        rod, tendons, pieces = self.rod, len(tensions), self.rod.pieces
        cuts = rod.cuts
        size = 6 * pieces - 3
        off, matrix = np.zeros(size), np.zeros((size, size))
        by_tension = np.zeros((size, tendons))
        lengths, slope = np.zeros(tendons), np.zeros((tendons, size + tendons))
        states = np.zeros((len(rod.grid[0]), 10 + tendons))
        bends = np.zeros((len(rod.grid[0]), 3))
        values, local = np.zeros(6 + tendons), np.zeros((6 + tendons, 6 + tendons))
        end_moment = self.share * rod.tip_moment
        for index in range(pieces):
            final = index == pieces - 1
            states[cuts[index]] = 0.0
            states[cuts[index], 3:7], states[cuts[index], 7:10] = turns[index], moments[index]
            good = differentiate_piece(
                cuts[index],
                cuts[index + 1],
                rod.grid,
                tensions,
                (self.share * rod.tip_force, self.share * rod.line_force),
                states,
                bends,
                turns[index] if final else turns[index + 1],
                DIFFERENCE * rod.moment_scale,
                DIFFERENCE * max(rod.unit_tension, float(np.abs(tensions).max(initial=0.0))),
                values,
                local,
            )
            if not good:
                return None
            # Rows of this piece's end, columns of its start: the base does not turn.
            rows = np.arange(3, 6) if final else np.arange(6)
            first = slice(6 * index, 6 * index + len(rows))
            inputs = np.arange(3, 6) if index == 0 else np.arange(6)
            begin = 0 if index == 0 else 6 * index - 3
            columns = slice(begin, begin + len(inputs))
            matrix[first, columns] = local[np.ix_(rows, inputs)]
            by_tension[first] = local[rows, 6:]
            slope[:, columns] += local[6:][:, inputs]
            slope[:, size:] += local[6:, 6:]
            lengths += values[6:]
            off[first] = values[rows]
            if final:
                off[first] -= end_moment
            else:
                off[6 * index + 3 : 6 * index + 6] -= moments[index + 1]
                following = slice(begin + len(inputs), begin + len(inputs) + 6)
                matrix[first, following] = -np.eye(6)
        return off, matrix, by_tension, lengths, slope

    def _pull(
        self,
        lengths: Floats,
        tensions: Floats,
        off: Floats,
        carried: Floats,
        straightened: Floats,
        length_slope: Floats,
    ) -> tuple[Floats, str]:
        """Tensions of the linear problem, or why there are none."""
        target = self.target
        size = len(off)
        exact = np.diag(target.compliances) - length_slope[:, size:]
        exact += length_slope[:, :size] @ carried
        give = 0.5 * (exact + exact.T)
        self.give = give
        largest = float(np.abs(np.diag(give)).max())
        strongest = self.rod.strongest
        centred = lengths - target.compliances * tensions - length_slope[:, :size] @ straightened
        room = target.limit(self.share, self.loose) - centred
        vector = room - give @ tensions
        low, high = np.where(target.pushes, -strongest, 0.0), np.full(len(give), strongest)
        wanted, right = np.zeros(len(give)), vector
        for _ in range(2):
            # The second pass takes out what the ridge did to the first.
            if not solve_bounded(
                give + RIDGE * largest * np.eye(len(give)), right, low, high, wanted
            ):
                return tensions, "no equilibrium was found beyond it"
            right = vector - RIDGE * largest * wanted
        held = np.flatnonzero(np.abs(wanted) >= strongest)
        if held.size:
            names = ", ".join(f"'{target.names[k]}'" for k in held)
            return tensions, (
                f"{names} would have to stretch beyond it; let out tendons on the other side, or "
                "give a tendon_stiffness"
            )
        free = (wanted > low) & (wanted < high)
        if np.abs(exact - give).max() > 1e-6 * largest and free.any():
            # A moment of fixed direction has no potential: the problem is not symmetric.
            block = exact[np.ix_(free, free)] + RIDGE * largest * np.eye(int(free.sum()))
            moved = wanted[~free] - tensions[~free]
            change = np.linalg.solve(block, -room[free] - exact[np.ix_(free, ~free)] @ moved)
            trial = tensions[free] + change
            if np.all((trial > low[free]) & (trial < high[free])):
                wanted[free] = trial
        return wanted, ""

    def _move(self, turns: Floats, moments: Floats, move: Floats) -> float:
        """Take a step, cut short where it turns too far; returns the part that was taken."""
        inner = np.concatenate([np.zeros(3), move]).reshape(-1, 6)
        widest = float(np.linalg.norm(inner[:, :3], axis=1).max())
        part = min(1.0, TURN_LIMIT / widest) if widest > 0.0 else 1.0
        moments += part * inner[:, 3:]
        out = np.empty(4)
        for index in range(1, len(turns)):
            turn_quaternion(turns[index], part * inner[index, :3], out)
            turns[index] = out / np.linalg.norm(out)
        return part

    def _share_tensions(
        self, tensions: Floats, turns: Floats, moments: Floats, scale: float
    ) -> Floats:
        """Take the least tensions that do the same, where redundant ones differ."""
        if not self.give.size or self.target.compliances.any():
            return tensions
        taut = tensions != 0.0
        shared = tensions.copy()
        size = float(np.abs(tensions).max())
        ridge = SHARING * float(np.abs(np.diag(self.give)).max())
        vector = -self.give @ tensions
        right = vector
        for _ in range(3):
            low = np.where(self.target.pushes, -size, 0.0) * taut
            matrix = self.give + ridge * np.eye(len(taut))
            if not solve_bounded(matrix, right, low, size * taut, shared):
                return tensions
            right = vector - ridge * shared
        # The same to first order only: it must hold of the lengths and joints themselves.
        shot = Shot(tensions=shared, turns=turns, moments=moments, share=self.share)
        states, jumps, good = self.rod.trace_jumps(shot)
        off, lengths = float(np.abs(jumps).max()), states[-1, 10:]
        gaps = self.target.gaps(lengths, shared, self.share, self.loose)
        fits = good and off <= 1e-9 * scale and np.abs(gaps).max(initial=0.0) <= self.loose
        return shared if fits else tensions
