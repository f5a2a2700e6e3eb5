"""The largest scope that fits: by diameter at a given link, by link at a given diameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ..duct.centreline import Centreline
from ..duct.field import SampledField
from ..progress import Progress, no_progress
from .introducer import Introducer
from .scope import Scope
from .tube import Job, TubeOptions

__all__ = ["Largest", "find_largest"]


@dataclass(frozen=True, kw_only=True)
class Largest:
    """What fits at most, each found by planning and certifying.

    Parameters
    ----------
    diameter : float
        Largest diameter that came through with `link_tested` [mm]; 0 if none did.
    link : float
        Longest link that came through with `diameter_tested` [mm]; 0 if none did.
    link_tested, diameter_tested : float
        What the scope asked for [mm].
    plans : int
        Plans made.

    Notes
    -----
    Both are lower bounds: a larger one was not found, which is no proof that there is none.
    """

    diameter: float
    link: float
    link_tested: float
    diameter_tested: float
    plans: int

    def describe(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "diameter_mm": self.diameter,
            "link_mm": self.link,
            "link_tested_mm": self.link_tested,
            "diameter_tested_mm": self.diameter_tested,
            "plans": self.plans,
        }


def find_largest(
    duct: SampledField,
    line: Centreline,
    *,
    scope: Scope,
    options: TubeOptions | None = None,
    progress: Progress = no_progress,
) -> Largest:
    """Find the largest diameter for the scope's link, and the longest link for its diameter.

    Parameters
    ----------
    duct, line, scope
        As for `plan_insertion`.
    options : TubeOptions, optional
        Of the planner.

    Returns
    -------
    Largest
        Diameter to 0.05 mm, link to 0.25 mm.
    """
    count = 0
    options = options or TubeOptions()

    def passes(diameter: float, link: float) -> bool:
        nonlocal count
        count += 1
        progress("largest", min(0.95, count / 24.0))
        trial = Scope(diameter=diameter, link_length=link, length=scope.length)
        bore = float(duct.clearance_bound(line.points[0]))
        if bore < trial.radius:
            return False
        introducer = Introducer.at_start(line, bore=bore, along=link)
        links = trial.count_links(line.length)
        motion = Job(duct, line, trial, introducer, links, options).try_whole_way()
        return motion is not None and motion.refusal is None

    widest = 2.0 * float(min(line.radius[0], line.radius[-1]))
    diameter = _bisect(lambda d: passes(d, scope.link_length), scope.diameter, widest, 0.05)
    longest = min(line.length, scope.length or line.length)
    link = _bisect(lambda length: passes(scope.diameter, length), scope.link_length, longest, 0.25)
    progress("largest", 1.0)
    return Largest(
        diameter=diameter,
        link=link,
        link_tested=scope.link_length,
        diameter_tested=scope.diameter,
        plans=count,
    )


def _bisect(passes: Callable[[float], bool], start: float, high: float, resolution: float) -> float:
    """Return the largest value in (0, high] that passes: grow from a guess, then halve."""
    low = 0.0
    trial = min(start, high)
    factor = 1.5
    while trial < high:
        if passes(trial):
            low = trial
            trial = min(high, trial * factor)
        else:
            high = trial
            break
    while high - low > resolution:
        trial = 0.5 * (low + high)
        if passes(trial):
            low = trial
        else:
            high = trial
    return low
