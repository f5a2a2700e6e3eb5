"""Laws with memory fitted to runs: baselines, sums of plays, a curve over these, Bouc-Wen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from ..muscle.hysteresis.operator import fit_linear
from ..numeric.arrays import Floats
from ..numeric.least_squares import LeastSquares
from ..results import Shown
from .law import PARALLEL, Fan, LoopLaw, trace_plays, trace_state

STILL = 0.05
"""Share of the range of the inputs: a play that moves less hardly moves, and gets no weight."""

BEYOND = 0.25
"""Half ranges by which a curve goes beyond what was fitted before it goes on straight."""

_WIDTHS = (0.0, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
_RUNGS = {"few": (0.0, 0.1, 0.3), "many": tuple((0.1 * np.arange(9)).tolist())}
_STARTS = 0.125 * np.arange(16)
_AROUND = 0.25 * np.arange(-3.0, 4.0)
_FINER = 5
_MANY_RUNS = 10
"""Of so many, the starts are settled fewer times."""
_ROUNDS = 3
_GOLDEN = 12
_NEAR = 0.05
"""Shares of half the range by which half widths of plays differ."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Samples:
    """Inputs of each run, and outputs and other causes of these (N, k), all runs in one."""

    inputs: tuple[Floats, ...]
    outputs: Floats
    terms: Floats

    @property
    def slices(self) -> list[slice]:
        """Where the runs are."""
        ends = np.cumsum([len(run) for run in self.inputs]).tolist()
        return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]

    @property
    def joined(self) -> Floats:
        """All inputs (N,)."""
        return np.concatenate(self.inputs)

    def trace(
        self,
        widths: Sequence[float] | Floats,
        starts: Sequence[float],
        reach: float,
        fan: Fan = PARALLEL,
    ) -> Floats:
        """Return the positions of plays (N, k)."""
        pairs = zip(self.inputs, starts, strict=True)
        each = np.asarray(widths)
        return np.concatenate([trace_plays(u, each, s, reach, fan) for u, s in pairs])

    def find_reach(self, mask: Mask) -> float:
        """Return half of the range of the inputs of some samples."""
        return 0.5 * float(np.ptp(self.joined[mask]))


class PlayForm(NamedTuple):
    """Half widths of plays, their weights, and how they widen."""

    widths: Sequence[float]
    weights: Sequence[float] | Floats
    fan: Fan = PARALLEL


@dataclass(frozen=True, eq=False)
class Fitted(Shown):
    """A law, the start of each run, the factors of the terms, and half widths left out."""

    law: LoopLaw
    starts: tuple[float, ...]
    factors: Floats
    still: tuple[float, ...] = ()

    def predict(self, samples: Samples) -> Floats:
        """Return outputs (N,) of all samples."""
        traced = [self.law.trace(u, s) for u, s in zip(samples.inputs, self.starts, strict=True)]
        return np.concatenate(traced) + samples.terms @ self.factors


def _solve(
    inner: Floats, more: Floats, outputs: Floats, mask: Mask, degree: int
) -> tuple[Floats, float, float, Floats, float]:
    """Fit a polynomial of `inner` and factors of `more`; return also the sum of squares."""
    kept = inner[mask]
    centre, half = 0.5 * float(kept.max() + kept.min()), 0.5 * float(np.ptp(kept)) or 1.0
    powers = polynomial.polyvander((kept - centre) / half, degree)
    columns = np.hstack([powers, more[mask]])
    found: Floats = np.asarray(np.linalg.lstsq(columns, outputs[mask], rcond=1e-10)[0])
    left = outputs[mask] - columns @ found
    return found[: degree + 1], centre, half, found[degree + 1 :], float(left @ left)


def _find_straight(place: Floats) -> tuple[float, float]:
    """Return where a curve goes on straight: a little beyond what was fitted."""
    return float(place.min()) - BEYOND, float(place.max()) + BEYOND


def _make_law(
    samples: Samples,
    mask: Mask,
    plays: PlayForm,
    starts: Sequence[float],
    degree: int,
    reach: float,
) -> tuple[Fitted, float]:
    """Return the best polynomial of a sum of plays, and its sum of squares."""
    widths, weights, fan = plays
    inner = samples.trace(widths, starts, reach, fan) @ np.asarray(weights)
    found, centre, half, factors, cost = _solve(inner, samples.terms, samples.outputs, mask, degree)
    place = (inner[mask] - centre) / half
    law = LoopLaw(
        thresholds=tuple(map(float, widths)),
        weights=tuple(map(float, weights)),
        coefficients=tuple(found.tolist()),
        centre=centre,
        half=half,
        straight=_find_straight(place),
        reach=reach,
        fan=fan[0],
        apex=fan[1],
    )
    return Fitted(law, tuple(starts), factors), cost


def settle_starts(fit: Fitted, samples: Samples, mask: Mask) -> Fitted:
    """Return a fit with the starts that its law fits best, one run after the other."""
    starts = []
    rest = samples.outputs - samples.terms @ fit.factors
    grid = _STARTS if np.count_nonzero(fit.law.weights) > 1 else _STARTS[:9]
    for inputs, place, old in zip(samples.inputs, samples.slices, fit.starts, strict=True):
        own = mask[place]
        if not own.any():
            starts.append(old)
            continue
        last = int(np.flatnonzero(own)[-1]) + 1
        known, wanted = own[:last], rest[place][:last][own[:last]]
        best, step, tried = old, grid[1], np.append(grid, old)
        for _ in range(_FINER):
            traced = fit.law.trace_starts(inputs[:last], tried)[:, known]
            costs = np.square(traced - wanted).sum(axis=1)
            # An old one stays unless another is better: a start that does not matter does not move.
            k = int(np.argmin(costs))
            best = best if costs[-1] <= costs[k] else float(tried[k])
            tried = np.append((best + step * _AROUND) % 2.0, best)
            step *= 0.25
        starts.append(best)
    return replace(fit, starts=tuple(starts))


def _find_least(miss: Callable[[float], float], low: float, high: float) -> float:
    """Return the place of the least between two, by golden sections."""
    share = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = high - share * (high - low), low + share * (high - low)
    first, second = miss(a), miss(b)
    for _ in range(_GOLDEN):
        if first < second:
            high, b, second = b, a, first
            a = high - share * (high - low)
            first = miss(a)
        else:
            low, a, first = a, b, second
            b = low + share * (high - low)
            second = miss(b)
    return float(a if first < second else b)


def fit_polynomial(samples: Samples, mask: Mask, degree: int) -> Fitted:
    """Return a polynomial of the input, without memory."""
    starts = (0.0,) * len(samples.inputs)
    reach = samples.find_reach(mask)
    return _make_law(samples, mask, PlayForm((0.0,), (1.0,)), starts, degree, reach)[0]


def fit_backlash(samples: Samples, mask: Mask, before: Fitted | None = None) -> Fitted:
    """Return a cubic of one play, whose width is fitted; `before` has starts that are known."""
    reach = samples.find_reach(mask) if before is None else before.law.reach
    rounds = _ROUNDS if len(samples.inputs) < _MANY_RUNS else 1

    def fit(width: float, starts: Sequence[float]) -> tuple[float, Fitted]:
        found, cost = _make_law(samples, mask, PlayForm((width,), (1.0,)), starts, 3, reach)
        for _ in range(rounds if before is None and width else 0):
            settled = settle_starts(found, samples, mask)
            if settled.starts == found.starts:
                break
            found, cost = _make_law(
                samples, mask, PlayForm((width,), (1.0,)), settled.starts, 3, reach
            )
        return cost, found

    if before is not None:
        old = before.law.thresholds[0]
        low, high = max(0.5 * old, 0.0), min(1.5 * old, 0.95 * reach)
        best = _find_least(lambda r: fit(r, before.starts)[0], low, high) if old else 0.0
        return fit(best, before.starts)[1]
    ends: list[tuple[float, Fitted]] = []
    for share in _WIDTHS:
        known = [(0.5,) * len(samples.inputs), *([ends[-1][1].starts] if ends else [])]
        ends.append(min((fit(share * reach, starts) for starts in known), key=lambda e: e[0]))
    place = min(range(len(ends)), key=lambda k: ends[k][0])
    low = _WIDTHS[max(place - 1, 0)] * reach
    high = _WIDTHS[min(place + 1, len(_WIDTHS) - 1)] * reach
    starts = ends[place][1].starts
    width = _find_least(lambda r: fit(r, starts)[0], low, high)
    ends.append(fit(width, starts))
    return min(ends, key=lambda e: e[0])[1]


def fit_capstan(
    samples: Samples, mask: Mask, backlash: Fitted, before: Fitted | None = None
) -> Fitted:
    """Return a cubic of one play that widens away from an apex."""
    reach, inputs = backlash.law.reach, samples.joined[mask]
    middle = 0.5 * float(inputs.max() + inputs.min())
    span = float(np.ptp(samples.outputs[mask])) or 1.0

    def make(point: Floats, starts: Sequence[float]) -> tuple[Fitted, float]:
        width, share, apex = reach * float(point[0]), float(point[1]), float(point[2])
        fan = (share, middle + reach * apex) if share else PARALLEL
        return _make_law(samples, mask, PlayForm((width,), (1.0,), fan), starts, 3, reach)

    def search(point: Floats, starts: Sequence[float], evaluations: int) -> tuple[float, Floats]:
        def miss(there: Floats) -> Floats:
            found = make(there, starts)[0]
            return (found.predict(samples) - samples.outputs)[mask] / span

        end = LeastSquares(
            misfit=miss,
            bounds=(np.array([0.0, 0.0, -2.0]), np.array([0.95, 0.9, 2.0])),
            margin=1e-4, scale=np.array([0.1, 0.1, 0.5]), xtol=1e-6, ftol=1e-6, gtol=1e-12,
        ).descend(point, evaluations=evaluations)  # fmt: skip
        return end.cost, end.point

    if before is not None:
        law = before.law
        point = np.array([law.thresholds[0] / reach, law.fan, (law.apex - middle) / reach])
        if not law.fan:
            return fit_backlash(samples, mask, before)
        return make(search(point, before.starts, 15)[1], before.starts)[0]
    lone = backlash.law.thresholds[0] / reach
    ends: list[tuple[float, Floats, Fitted]] = []
    for share in (0.05, 0.15, 0.3):
        for apex in (-1.0, 0.0, 1.0, -middle / reach):
            point = np.array([max(lone - 0.5 * share, 0.0), share, np.clip(apex, -1.5, 1.5)])
            found = settle_starts(make(point, backlash.starts)[0], samples, mask)
            found, cost = make(point, found.starts)
            ends.append((cost, point, found))
    ends.sort(key=lambda end: end[0])
    best = (np.inf, backlash)
    for _, point, found in ends[:2]:
        for evaluations in (15, 30):
            _, point = search(point, found.starts, evaluations)
            found = settle_starts(make(point, found.starts)[0], samples, mask)
            found, cost = make(point, found.starts)
        best = (cost, found) if cost < best[0] else best
    left = (samples.outputs - backlash.predict(samples))[mask]
    return best[1] if best[0] < float(left @ left) else backlash


def _list_rungs(name: str, lone: float, reach: float) -> Floats:
    """Return half widths of plays: some of even steps, and a lone one in place of those near it."""
    rungs = reach * np.array(_RUNGS[name])
    far = np.abs(rungs - lone) > _NEAR * reach
    return np.unique(np.append(rungs[far | (rungs == 0.0)], lone))


def _choose_widths(
    samples: Samples, mask: Mask, starts: Sequence[float], widths: Floats, reach: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return half widths of plays that move, and those of plays that hardly do."""
    plays = samples.trace(widths, starts, reach)
    moved = np.zeros(len(widths))
    for place in samples.slices:
        own = plays[place][mask[place]]
        if len(own):
            moved = np.maximum(moved, np.ptp(own, axis=0))
    kept = moved >= STILL * 2.0 * reach
    kept[0] = True
    return tuple(widths[kept].tolist()), tuple(widths[~kept].tolist())


def fit_plays(
    samples: Samples, mask: Mask, backlash: Fitted, before: Fitted | None = None
) -> Fitted:
    """Return a line over a sum of plays (Prandtl-Ishlinskii), which lag or lead all alike."""
    reach = backlash.law.reach
    lone = backlash.law.thresholds[0]
    starts = backlash.starts if before is None else before.starts
    widths, still = _choose_widths(samples, mask, starts, _list_rungs("many", lone, reach), reach)
    best: tuple[float, Fitted] = np.inf, backlash
    for _ in range(_ROUNDS if before is None else 1):
        plays = samples.trace(widths, starts, reach)
        ends = [_fit_weights(samples, mask, widths, plays, sign) for sign in (1.0, -1.0)]
        _, weights = min(ends, key=lambda e: e[0])
        found, cost = _make_law(samples, mask, PlayForm(widths, weights), starts, 1, reach)
        if cost > best[0] * (1.0 - 1e-6):
            break
        best = cost, replace(found, still=still)
        if before is None:
            starts = settle_starts(found, samples, mask).starts
    return best[1]


def _fit_weights(
    samples: Samples, mask: Mask, widths: Sequence[float], plays: Floats, sign: float
) -> tuple[float, Floats]:
    """Return the sum of squares and weights, of sizes of sum 1, that lag (1) or lead (-1)."""
    inputs = samples.joined[:, None]
    columns = plays if sign > 0.0 else np.hstack([inputs, inputs - plays[:, 1:]])
    free = np.hstack([np.ones((len(inputs), 1)), samples.terms])[mask]
    names = [""] * columns.shape[1]
    best: tuple[float, Floats] = np.inf, np.zeros(len(widths))
    for turn in (1.0, -1.0):
        target = turn * samples.outputs[mask]
        found = fit_linear(columns[mask], target, names=names, free=free, judge=False)
        cost = float(found.residual @ found.residual)
        weights = np.array(found.values)
        if sign < 0.0:
            weights = np.append(weights.sum(), -weights[1:])
        total = float(np.abs(weights).sum())
        if not total > 0.0:
            weights = np.append(1.0, np.zeros(len(widths) - 1))
            total = 1.0
        if cost < best[0]:
            best = cost, weights / total
    return best


def fit_generalised(
    samples: Samples,
    mask: Mask,
    known: Mapping[str, Fitted],
    rungs: str,
    before: Fitted | None = None,
) -> Fitted:
    """Return a cubic of a sum of plays: the lone play of a backlash, and some of other widths."""
    backlash = known["backlash-cubic"]
    reach, lone = backlash.law.reach, backlash.law.thresholds[0]
    if before is not None:
        widths = before.law.thresholds
        return _bend_plays(
            samples, mask, widths, before.starts, np.array(before.law.weights), reach
        )
    ends = []
    for begin in (backlash, known["prandtl-ishlinskii"]):
        starts = begin.starts
        some = _list_rungs(rungs, lone, reach)
        widths, still = _choose_widths(samples, mask, starts, some, reach)
        weights = np.interp(widths, begin.law.thresholds, np.array(begin.law.weights))
        near = np.isclose(np.array(widths)[:, None], begin.law.thresholds, atol=1e-9 * reach)
        weights = np.where(near.any(axis=1), weights, 0.0)
        if not weights.any():
            continue
        best: tuple[float, Fitted] = np.inf, begin
        for _ in range(_ROUNDS):
            found = _bend_plays(samples, mask, widths, starts, weights, reach)
            left = (samples.outputs - found.predict(samples))[mask]
            cost = float(left @ left)
            if cost > best[0] * (1.0 - 1e-6):
                break
            best = cost, replace(found, still=still)
            weights = np.array(found.law.weights)
            starts = settle_starts(found, samples, mask).starts
        ends.append(best)
    return min(ends, key=lambda e: e[0])[1]


def _bend_plays(
    samples: Samples,
    mask: Mask,
    widths: tuple[float, ...],
    starts: Sequence[float],
    weights: Floats,
    reach: float,
) -> Fitted:
    """Fit weights and a cubic together, from weights on; they keep their sign."""
    plays = samples.trace(widths, starts, reach)[mask]
    weights = weights / np.abs(weights).sum()
    begin, _ = _make_law(samples, mask, PlayForm(widths, weights), starts, 3, reach)
    law = begin.law
    terms, target = samples.terms[mask], samples.outputs[mask]
    span = float(np.ptp(target)) or 1.0
    count = len(widths)
    leads = bool((weights[1:] < 0.0).any()) and widths[0] == 0.0
    low, high, ways = np.zeros(count), np.full(count, np.inf), np.ones(count)
    if leads:
        low[1:], high[1:], ways[1:] = -np.inf, 0.0, -1.0
    stiff = np.sqrt(len(target))

    def split(point: Floats) -> tuple[Floats, Floats, Floats]:
        return point[:count], point[count : count + 4], point[count + 4 :]

    def miss(point: Floats) -> Floats:
        own, curve, factors = split(point)
        place = (plays @ own - law.centre) / law.half
        model = polynomial.polyval(place, curve) + terms @ factors
        return np.append((model - target) / span, stiff * (ways @ own - 1.0))

    def slope(point: Floats) -> Floats:
        own, curve, _ = split(point)
        place = (plays @ own - law.centre) / law.half
        steep = polynomial.polyval(place, polynomial.polyder(curve)) / law.half
        rows = np.hstack([steep[:, None] * plays, polynomial.polyvander(place, 3), terms]) / span
        last = np.append(stiff * ways, np.zeros(rows.shape[1] - count))
        return np.vstack([rows, last])

    free = np.full(4 + terms.shape[1], np.inf)
    search = LeastSquares(
        misfit=miss, slope=slope, scale="jac", xtol=1e-8, ftol=1e-6, gtol=1e-12,
        bounds=(np.append(low, -free), np.append(high, free)),
    )  # fmt: skip
    point = np.concatenate([weights, law.coefficients, begin.factors])
    point[:count] = np.clip(point[:count], low + (low == 0.0) * 1e-3, high - (high == 0.0) * 1e-3)
    point[:count] /= ways @ point[:count]
    own, _, _ = split(search.descend(point, evaluations=40).point)
    own = np.where(np.abs(own) > 1e-6, own, 0.0)
    found, cost = _make_law(
        samples, mask, PlayForm(widths, own / np.abs(own).sum()), starts, 3, reach
    )
    first, before = _make_law(samples, mask, PlayForm(widths, weights), starts, 3, reach)
    return found if cost < before else first


def fit_bouc_wen(
    samples: Samples, mask: Mask, backlash: Fitted, before: Fitted | None = None
) -> Fitted:
    """Return a cubic of the input and a Bouc-Wen state of either sign."""
    reach = backlash.law.reach

    def trace(point: Floats, starts: Sequence[float]) -> Floats:
        pairs = zip(samples.inputs, starts, strict=True)
        width, share, power = reach * float(np.exp(point[0])), float(point[1]), float(point[2])
        return np.concatenate([trace_state(u, s, (width, share, power)) for u, s in pairs])

    def solve(point: Floats, starts: Sequence[float]) -> tuple[Fitted, Floats]:
        more = np.hstack([trace(point, starts)[:, None], samples.terms])
        inner = samples.joined
        found, centre, half, factors, _ = _solve(inner, more, samples.outputs, mask, 3)
        place = (inner[mask] - centre) / half
        law = LoopLaw(
            thresholds=(0.0,),
            weights=(1.0,),
            coefficients=tuple(found.tolist()),
            centre=centre,
            half=half,
            straight=_find_straight(place),
            reach=reach,
            height=float(factors[0]),
            yield_input=reach * float(np.exp(point[0])),
            beta_fraction=float(point[1]),
            exponent=float(point[2]),
        )
        left = samples.outputs - polynomial.polyval((inner - centre) / half, found) - more @ factors
        return Fitted(law, tuple(starts), factors[1:]), left[mask]

    def search(point: Floats, starts: Sequence[float], evaluations: int) -> tuple[float, Floats]:
        span = float(np.ptp(samples.outputs[mask])) or 1.0
        end = LeastSquares(
            misfit=lambda p: solve(p, starts)[1] / span,
            bounds=(np.array([-6.0, 0.0, 1.0]), np.array([2.0, 5.0, 10.0])),
            margin=1e-6, scale="jac", xtol=1e-6, ftol=1e-5, gtol=1e-12,
        ).descend(point, evaluations=evaluations)  # fmt: skip
        return end.cost, end.point

    if before is not None:
        law = before.law
        point = np.array([np.log(law.yield_input / reach), law.beta_fraction, law.exponent])
        return solve(search(point, before.starts, 10)[1], before.starts)[0]
    starts = tuple(min(start, 2.0 - start) for start in backlash.starts)
    wide = max(backlash.law.thresholds[0] / reach, 0.02)
    begins = [np.array([np.log(w), 0.6, 1.5]) for w in (wide, 2.5 * wide, 0.5)]
    trials = [search(begin, starts, 5) for begin in begins]
    point = min(trials, key=lambda e: e[0])[1]
    best: tuple[float, Fitted] = np.inf, backlash
    for _ in range(_ROUNDS):
        found = solve(point, starts)[0]
        starts = settle_starts(found, samples, mask).starts
        cost, point = search(point, starts, 25)
        found, left = solve(point, starts)
        if float(left @ left) > best[0] * (1.0 - 1e-4):
            break
        best = float(left @ left), found
    return best[1]
