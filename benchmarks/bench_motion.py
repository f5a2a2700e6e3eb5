"""The thesis's scheme: its constrained link step, a whole chain, and how the cost grows."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from numba import njit

from benchmarks.ring import (
    LINK,
    ROOM,
    advance,
    constrained_share,
    draw_links,
    make_ring,
    settle,
)
from bozzini.duct import Centreline, SampledField
from bozzini.duct.kernels.clearance import space_estimate
from bozzini.motion import FreeSpace, Introducer, Scope
from bozzini.motion.kernels.chain import place_tail
from bozzini.motion.thesis import move_by_thesis
from bozzini.numeric.polylines import measure_arc_length, resample_polyline
from tests.shapes import tube_lumen


@pytest.fixture(scope="module")
def ring() -> SampledField:
    return make_ring()


@njit
def place_all(space, heads, olds, length, room, slope, tails, codes):
    """Every link of a batch: a compiled loop, so that no call from Python is timed."""
    work = np.empty((6, 5))
    for n in range(heads.shape[0]):
        codes[n], _ = place_tail(
            space, heads[n], olds[n], length, room, slope, False, work, tails[n]
        )


def solve_slsqp(field: SampledField, head: np.ndarray, old: np.ndarray, *, squared: bool) -> Any:
    """Equation 5.15 by SciPy's SLSQP: numeric gradients, its default options, compiled field.

    The printed objective is the distance to the old tail; `squared` is the kinder, smooth form.
    """
    from scipy.optimize import minimize

    space = FreeSpace(field).pack()

    def objective(x: np.ndarray) -> float:
        away = x - old
        return away @ away if squared else np.sqrt(away @ away)

    def keep_length(x: np.ndarray) -> float:
        away = x - head
        return np.sqrt(away @ away) - LINK

    def keep_inside(x: np.ndarray) -> float:
        return space_estimate(space, x[0], x[1], x[2]) - ROOM

    constraints = [{"type": "eq", "fun": keep_length}, {"type": "ineq", "fun": keep_inside}]
    return minimize(objective, old, constraints=constraints, method="SLSQP")


def time_slsqp(
    field: SampledField, heads: np.ndarray, olds: np.ndarray, *, squared: bool
) -> tuple[float, np.ndarray]:
    """Median time of a link, each the best of three tries [s], and the answers (n, 3)."""
    took, answers = [], []
    for head, old in zip(heads, olds, strict=True):
        best = np.inf
        for _ in range(3):
            begin = time.perf_counter()
            result = solve_slsqp(field, head, old, squared=squared)
            best = min(best, time.perf_counter() - begin)
        took.append(best)
        answers.append(result.x if result.success else np.full(3, np.nan))
    return float(np.median(took)), np.array(answers)


@pytest.mark.parametrize("form", ["printed", "squared"])
def bench_link_step_against_slsqp(benchmark: Any, ring: SampledField, form: str) -> None:
    heads, olds = draw_links(ring, 2000)
    tails, codes = np.empty_like(heads), np.empty(len(heads), dtype=np.int64)
    arguments = (FreeSpace(ring).pack(), heads, olds, LINK, ROOM, 3**0.5, tails, codes)
    benchmark.pedantic(place_all, args=arguments, rounds=15, warmup_rounds=1)
    ours = benchmark.stats.stats.min / len(heads)
    some = slice(0, None, 10)
    theirs, answers = time_slsqp(ring, heads[some], olds[some], squared=form == "squared")
    assert (codes == 1).all()
    # It is the same problem: where SLSQP finds a feasible answer, ours is as near or nearer.
    found = np.isfinite(answers).all(axis=1)
    answers[~found] = heads[some][~found]
    found &= ring.signed_distance(ring.to_world(answers)) + ROOM <= 1e-5
    found &= np.abs(np.linalg.norm(answers - heads[some], axis=1) - LINK) <= 1e-5
    assert found.mean() >= 0.5
    gap = np.linalg.norm((tails - olds)[some], axis=1) - np.linalg.norm(
        answers - olds[some], axis=1
    )
    assert np.mean(gap[found] <= 1e-3) >= 0.95
    ratio = theirs / ours
    name = "as printed" if form == "printed" else "with the distance squared"
    benchmark.extra_info.update(
        what=f"one link at the wall, SLSQP's time over ours, {name}",
        measured=f"{ratio:,.0f} times ({theirs * 1e3:.2f} ms over {ours * 1e6:.2f} µs)",
    )
    if form == "printed":
        benchmark.extra_info["required"] = "at least 1,000 times"
        assert ratio >= 1000.0


def winding_tube() -> tuple[SampledField, Centreline]:
    """Half a metre of winding tube, 10 mm wide all round its middle line."""
    x = np.linspace(0.0, 700.0, 4000)
    curve = np.stack(
        [x, 25.0 * np.sin(2.0 * np.pi * x / 160.0), 12.0 * np.sin(1.0 + 2.0 * np.pi * x / 230.0)],
        axis=1,
    )
    curve = resample_polyline(curve[measure_arc_length(curve) <= 500.0], 4.0)
    return tube_lumen(curve, 10.0, 2.0)


def bench_forty_links_two_thousand_steps(benchmark: Any) -> None:
    field, line = winding_tube()
    scope = Scope(diameter=9.0, link_length=12.5)
    introducer = Introducer.at_start(line, bore=9.0, along=12.5)
    motion = benchmark.pedantic(
        move_by_thesis,
        args=(FreeSpace(field, line, introducer), scope),
        kwargs={"links": 40, "head_step": line.length / 2000.0},
        rounds=9,
        warmup_rounds=1,
    )
    took = benchmark.stats.stats.median
    assert not motion.reason_code
    assert motion.joints.shape[0] >= 2000
    assert motion.joints.shape[1] == 41
    share = np.mean(np.abs(field.signed_distance(motion.joints[:, 1:]) + scope.radius) < 1e-6)
    benchmark.extra_info.update(
        what="40 links x 2,000 steps, an insertion into a winding tube",
        measured=f"{took * 1e3:.0f} ms, with {100 * share:.0f} % of the links at the wall",
        required="under 100 ms",
    )
    assert took < 0.1


def bench_nearly_all_links_at_the_wall(benchmark: Any, ring: SampledField) -> None:
    chain, angle = settle(ring, 40)
    motion = benchmark.pedantic(advance, args=(ring, chain, angle, 2000), rounds=7, warmup_rounds=1)
    took = benchmark.stats.stats.median
    share = constrained_share(ring, motion.joints)
    assert motion.code == 0
    assert motion.steps >= 2000
    assert share > 0.8
    benchmark.extra_info.update(
        what="40 links x 2,000 steps, the dear case of a tight ring",
        measured=f"{took * 1e3:.0f} ms, with {100 * share:.0f} % of the links at the wall",
    )


def fit_slope(ring: SampledField, cases: list[tuple[int, int]]) -> float:
    """Exponent of the cost in links x steps, from the best of five runs of each case."""
    product, cost = [], []
    for links, steps in cases:
        chain, angle = settle(ring, links)
        best = np.inf
        for _ in range(5):
            begin = time.perf_counter()
            motion = advance(ring, chain, angle, steps)
            best = min(best, time.perf_counter() - begin)
            assert motion.code == 0
        product.append(links * motion.steps)
        cost.append(best)
    assert max(product) >= 90 * min(product)
    return float(np.polyfit(np.log(product), np.log(cost), 1)[0])


@pytest.mark.parametrize(
    ("varied", "cases"),
    [
        ("links", [(n, 500) for n in (6, 19, 60, 190, 600)]),
        ("steps", [(40, n) for n in (50, 158, 500, 1580, 5000)]),
    ],
)
def bench_cost_is_linear(
    benchmark: Any, ring: SampledField, varied: str, cases: list[tuple[int, int]]
) -> None:
    slope = benchmark.pedantic(fit_slope, args=(ring, cases), rounds=1)
    benchmark.extra_info.update(
        what=f"exponent of the cost in the number of {varied}, over two decades",
        measured=f"{slope:.2f}",
        required="0.85 to 1.15",
    )
    assert 0.85 <= slope <= 1.15
