"""What would fit: the largest scope, the longest link, the least inflation; each one planned.

A value is only named if a certified plan of the whole way was made for it, in the way that a new
run with that value makes it: same method, same centreline, an introducer as wide as the entry.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ..checks import describe_fields, quantity
from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..errors import BozziniError
from ..progress import Progress, no_progress
from .planner import check_size
from .planners import PlannerOptions
from .refusal import Refusal
from .scope import SIZE_MIN_MM, Scope
from .shape import SHORTEST_MM, measure_folds
from .space import FreeSpace
from .tube import FOLD_COSINE, MARGINS, Style, TubeMotion, TubeProblem

DIAMETER_STEP_MM, LINK_STEP_MM, INFLATION_STEP_MM = 0.05, 0.25, 0.1
"""Values that are tried are multiples of these, so that they are printed as they are."""

INFLATION_SPARE_MM = 0.2
"""An inflation is named that is this much more than the least one found, and passes too.

A new run builds its field for the inflation given, with other nodes in a surface's field.
"""

INFLATION_MORE_MM = 6.0
"""No inflation by more than this beyond the lumen's own is sought."""

NEAR = 0.02
"""Advice is sought to this fraction: a value nearer to what was refused may pass, too."""


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

    diameter: float = quantity("length")
    link: float = quantity("length")
    link_tested: float = quantity("length")
    diameter_tested: float = quantity("length")
    plans: int = 0

    def describe(self) -> dict[str, float]:
        """Return JSON-able values."""
        return {**describe_fields(self), "plans": self.plans}


def find_largest(
    duct: Duct,
    line: Centreline,
    *,
    scope: Scope,
    options: PlannerOptions | None = None,
    freedom: float = 1.0,
    progress: Progress = no_progress,
) -> Largest:
    """Find the largest diameter for the scope's link, and the longest link for its diameter.

    Parameters
    ----------
    duct, line, scope
        As for `plan_insertion`.
    options : PlannerOptions, optional
        As for `plan_insertion`.
    freedom : float
        1: joints stray as far as the free tube allows; 0: they follow the leader.

    Returns
    -------
    Largest
        Diameter to 0.05 mm, link to 0.25 mm.
    """
    space = FreeSpace(duct, line)
    trials = _Trials(space, options or PlannerOptions(), Style(freedom=freedom), thorough=True)
    trials.progress = lambda count: progress("largest", min(0.95, count / 24.0))

    def passes(diameter: float, link: float) -> bool:
        if min(diameter, link) < SIZE_MIN_MM:
            return False
        return trials.pass_with(Scope(diameter=diameter, link_length=link, length=scope.length))

    widest = 2.0 * float(min(line.radius[0], line.radius[-1]))
    longest = min(line.length, scope.length or line.length)
    diameter = _find_last(
        lambda d: passes(d, scope.link_length), scope.diameter, widest, DIAMETER_STEP_MM
    )
    link = _find_last(
        lambda length: passes(scope.diameter, length), scope.link_length, longest, LINK_STEP_MM
    )
    progress("largest", 1.0)
    return Largest(
        diameter=diameter,
        link=link,
        link_tested=scope.link_length,
        diameter_tested=scope.diameter,
        plans=trials.count,
    )


def certify_scope(
    space: FreeSpace, scope: Scope, *, options: PlannerOptions | None = None
) -> float | None:
    """Return the certified clearance of a motion along the whole way [mm]; None if none is found.

    That is the answer of ``plan_insertion(method="tube")`` alone: why there is none is not sought,
    nor how far the scope gets, nor what would fit, which takes far longer.

    Parameters
    ----------
    space : FreeSpace
        With its line.
    scope : Scope
    options : PlannerOptions, optional
        As for `plan_insertion`.
    """
    motion = _Trials(
        space, options or PlannerOptions(), Style(freedom=1.0), thorough=True
    ).find_motion(scope)
    return None if motion is None else float(motion.certificate.clearance)


def find_advice(job: TubeProblem, refusal: Refusal, *, progress: Progress = no_progress) -> Refusal:
    """Add to a refusal what a certified plan of the whole way is found for.

    A smaller diameter, shorter links, or a lumen inflated by more, each with all else as it was.
    Without any the refusal gets the diameter above which it is proved that nothing passes.
    """
    scope = job.scope
    trials = _Trials(job.space, job.options, job.style)
    trials.progress = lambda count: progress("advice", min(0.95, count / 20.0))
    passage = job.passages.passage if min(job.bound[0], job.bound[-1]) > 0.0 else None
    level = float(job.bound.min())
    if passage is not None:
        level = max(level, min(passage.level, float(job.bound[0]), float(job.bound[-1])))
    if refusal.code == "LINK_TOO_LONG" and refusal.offers is not None:
        level = min(level, refusal.offers)
    fits = max(level - MARGINS[1], 0.0)

    def widen(value: float) -> Scope:
        return replace(scope, diameter=value)

    def link(value: float) -> Scope:
        return replace(scope, link_length=value)

    diameter = _find_certified(
        lambda value: 2.0 * trials.measure_lack(widen(value)),
        lambda value: trials.pass_with(widen(value)),
        2.0 * fits,
        refused=scope.diameter,
        last=SIZE_MIN_MM,
        step=DIAMETER_STEP_MM,
    )
    length = None
    if refusal.code in ("LINK_TOO_LONG", "FOLD", "CERTIFICATE_UNRESOLVED", "ANGLE"):
        length = _find_certified(
            # How much shorter a link must be does not follow from the clearance that lacks.
            lambda value: math.nan if trials.measure_lack(link(value)) else 0.0,
            lambda value: trials.pass_with(link(value)),
            refusal.link_shaped or 0.5 * scope.link_length,
            refused=scope.link_length,
            last=SHORTEST_MM,
            step=LINK_STEP_MM,
        )
    inflation = _find_inflation(job, scope.radius - fits, trials)
    progress("advice", 1.0)
    bound = None if passage is None or not math.isfinite(passage.bound) else 2.0 * passage.bound
    return replace(
        refusal, diameter_max=diameter, link_max=length, inflate=inflation, diameter_bound=bound
    )


def _find_inflation(job: TubeProblem, lack: float, trials: _Trials) -> float | None:
    """Return a small inflation, all of it, for which the whole way is planned [mm]."""
    duct, scope = job.duct, job.scope
    # Beyond its reach a field does not know how far the wall is outside the lumen.
    last = min(duct.inflation_max, duct.inflation + INFLATION_MORE_MM) - INFLATION_SPARE_MM
    if last <= duct.inflation:
        return None

    def inflate(value: float) -> _Trials:
        return trials.move_to(job.space.moved_to(duct.inflate(value - duct.inflation)))

    def certify(value: float) -> bool:
        return inflate(value + INFLATION_SPARE_MM).pass_with(scope)

    found = _find_certified(
        lambda value: inflate(value).measure_lack(scope),
        certify,
        duct.inflation + max(lack, 0.0),
        refused=duct.inflation,
        last=last,
        step=INFLATION_STEP_MM,
    )
    return None if found is None else round(found + INFLATION_SPARE_MM, 6)


class _Trials:
    """Scopes tried in one space, each as `plan_insertion` would plan it."""

    def __init__(
        self, space: FreeSpace, options: PlannerOptions, style: Style, *, thorough: bool = False
    ) -> None:
        self.space, self.options, self.style, self.thorough = space, options, style, thorough
        self.count = 0
        self.progress: Callable[[int], None] = lambda count: None

    def move_to(self, space: FreeSpace) -> _Trials:
        """Go on in another space."""
        self.space = space
        return self

    def pass_with(self, scope: Scope) -> bool:
        """Whether a certified plan of the whole way is found for a scope."""
        return self.find_motion(scope) is not None

    def measure_lack(self, scope: Scope) -> float:
        """Return how much clearance a path for a scope lacks [mm]: 0 if one is found.

        NaN if none is found for another reason. Without a path there is no motion; whether what
        moves along it can be certified is not looked at.
        """
        job = self._pose(scope)
        base = None if job is None else job.find_base(scope.radius + MARGINS[1])
        if job is None or base is None:
            return math.nan
        shaped = job.shape(base, MARGINS[1])
        if not shaped.clear:
            return scope.radius + MARGINS[1] - shaped.clearance
        folds = measure_folds(shaped, scope.link_length).min() < FOLD_COSINE
        return math.nan if folds else 0.0

    def find_motion(self, scope: Scope) -> TubeMotion | None:
        """Return a certified motion of a scope along the whole way; None if none is found."""
        job = self._pose(scope)
        motion = None if job is None else job.try_whole_way(thorough=self.thorough)
        return motion if motion is not None and motion.refusal is None else None

    def _pose(self, scope: Scope) -> TubeProblem | None:
        """Return the planning of a scope, or None if that is not legal or the entry too narrow."""
        self.count += 1
        self.progress(self.count)
        line = self.space.centreline
        if self.space.passages.bound[0] < scope.radius or scope.link_length > line.length:
            return None
        try:
            check_size(scope, line, self.options)
        except BozziniError:
            return None
        space = self.space.for_link(scope.link_length)
        return TubeProblem(space, scope, self.options, self.style)


def _find_certified(
    measure: Callable[[float], float],
    certify: Callable[[float], bool],
    guess: float,
    *,
    refused: float,
    last: float,
    step: float,
) -> float | None:
    """Return a multiple of `step` that is certified, near to `refused`; None if none is found.

    It is what `_find_near` finds. If that is not certified, a path tells too little here, and each
    value beyond it is certified in turn.
    """
    found = _find_near(measure, guess, refused=refused, last=last, step=step)
    if found is None or certify(found):
        return found

    def measure_motion(value: float) -> float:
        return 0.0 if certify(value) else math.nan

    return _find_near(measure_motion, found, refused=found, last=last, step=step)


def _find_near(
    measure: Callable[[float], float], guess: float, *, refused: float, last: float, step: float
) -> float | None:
    """Return a multiple of `step` that passes, near to `refused`; None if none is found.

    `measure` gives 0 for a value that passes, else by how much more it must differ, or NaN if that
    is not known. From a guess the search goes that far, and farther each time, up to `last`; or
    back, if the guess passes. Then the gap is halved down to `NEAR` of the value.
    """
    sign = 1 if last > refused else -1
    # Counted from the refused value on: 1 is the first multiple beyond it.
    origin = math.floor(refused / step + 1e-9) if sign > 0 else math.ceil(refused / step - 1e-9)

    def value(k: int) -> float:
        return round((origin + sign * k) * step, 6)

    def spread(k: int) -> int:
        return max(1, math.floor(NEAR * value(k) / step))

    most = math.floor(sign * (last / step - origin) + 1e-9)
    if most >= 1 and value(most) <= 0.0:
        most -= 1
    if most < 1:
        return None
    bad, k = 0, min(max(math.ceil(sign * (guess / step - origin) - 1e-9), 1), most)
    stride = spread(k)
    while lack := measure(value(k)):
        if k == most:
            return None
        farther = 0 if math.isnan(lack) else math.ceil(lack / step - 1e-9)
        bad, k, stride = k, min(k + max(stride, farther), most), 2 * stride
    good, back = k, 2 * spread(k)
    while bad == 0 and good > 1:
        k, back = max(good - back, 1), 2 * back
        if measure(value(k)):
            bad = k
        else:
            good = k
    while good - bad > spread(good):
        k = (good + bad) // 2
        if measure(value(k)):
            bad = k
        else:
            good = k
    return value(good)


def _find_last(passes: Callable[[float], bool], start: float, high: float, step: float) -> float:
    """Return the largest multiple of `step` in (0, high] that passes: grow from a guess, halve."""
    most = math.floor(high / step + 1e-9)
    good, bad = 0, most + 1
    k = min(max(math.floor(start / step + 1e-9), 1), most)
    while bad - good > 1:
        if passes(round(k * step, 6)):
            good = k
            grown = math.ceil(1.5 * k)
            k = min(grown, most) if bad > most else (good + bad) // 2
        else:
            bad = k
            k = (good + bad) // 2
    return round(good * step, 6)
