"""Laws of loops on a set: what they come to on rows held out, beside baselines, and their bands."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from section import Bound

from bozzini.hysteresis import LoopComparison, LoopRuns, compare_laws
from bozzini.hysteresis.comparison import BASELINES, LAWS

LARGEST_RATIO = 1.2
"""Error of the laws chosen, by that of the best baseline."""
OUTSIDE_PERCENT = 7.0
"""Of rows held out, beyond their bands of 95 %."""


@dataclass(frozen=True)
class ComparedLoops:
    """Loops that were fitted one by one, a part of each held out."""

    found: tuple[LoopComparison, ...]

    def pool(self, errors: Iterable[float]) -> float:
        """Return the root mean square over all rows held out of errors of the loops."""
        squares = np.square(list(errors))
        return float(np.sqrt(np.average(squares, weights=self.counts)))

    @property
    def counts(self) -> list[int]:
        """Rows held out of each loop."""
        return [int(one.parts.held_out.sum()) for one in self.found]

    @property
    def errors(self) -> dict[str, float]:
        """Error of each law over all rows held out."""
        return {
            law: self.pool(next(row.held_out for row in one.rows if row.law == law)
                           for one in self.found)
            for law in LAWS
        }  # fmt: skip

    @property
    def chosen(self) -> float:
        """The same of the law that each loop chose by rows left out of the others."""
        return self.pool(one.row.held_out for one in self.found)

    @property
    def coverage(self) -> float:
        """Share of the rows held out in the bands of the laws chosen."""
        return float(np.average([one.coverage for one in self.found], weights=self.counts))

    def describe(self, what: str, unit: str) -> str:
        """Return the errors of the baselines, and of the laws chosen."""
        shown = ", ".join(f"{self.errors[law]:.2f} ({law})" for law in BASELINES)
        return (
            f"{len(self.found)} loops of {what}: {shown} {unit}; the law chosen by rows left out "
            f"{self.chosen:.2f}, {100.0 * self.coverage:.1f} % in its band of 95 %."
        )

    def list_bounds(self, what: str) -> tuple[Bound, Bound]:
        """Return what is held."""
        best = min(self.errors[law] for law in BASELINES)
        return (
            Bound(f"{what}, law chosen by the best baseline", self.chosen / best, LARGEST_RATIO,
                  "times"),
            Bound(f"{what}, held out beyond the band of 95 %", 100.0 * (1.0 - self.coverage),
                  OUTSIDE_PERCENT, "%"),
        )  # fmt: skip


def make_runs(parts: Iterable[tuple[str, np.ndarray, np.ndarray]], titles: tuple[str, str]
              ) -> LoopRuns:  # fmt: skip
    """Return runs by their labels, inputs and outputs."""
    labels, inputs, outputs = zip(*parts, strict=True)
    sizes = np.cumsum([0, *map(len, inputs)])
    return LoopRuns(
        input=np.concatenate(inputs),
        output=np.concatenate(outputs),
        time=np.arange(float(sizes[-1])),
        labels=labels,
        first=tuple(sizes[:-1].tolist()),
        input_title=titles[0],
        output_title=titles[1],
    )


def compare_loops(loops: Iterable[tuple[LoopRuns, float | tuple[str, ...]]]) -> ComparedLoops:
    """Return how laws do on loops, of each with what is held out."""
    return ComparedLoops(tuple(compare_laws(runs, hold_out=part) for runs, part in loops))
