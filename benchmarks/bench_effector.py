"""The end-effector: one pose against the thesis's own formulation, batches, and single calls.

The printed formulation is the thesis's iteration: the muscle's system by SciPy's fsolve, the
section segment by segment as a constrained minimum by SLSQP, and again until the deflection stands.
The thesis gives 1.0 s for it, on a 2.0 GHz PC with MATLAB (section 4.4).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import fsolve

from bozzini.effector import Effector, balance, bend, effector_preset
from bozzini.effector.pose import pose
from bozzini.muscle import ThesisMuscle
from bozzini.muscle import preset as muscle_preset
from tests.effector.reference import iterate_printed
from tests.effector.reference import solve_printed as solve_section
from tests.muscle.printed import solve_printed as solve_muscle

COUNT = 100_000
CALLS = 20_000
PRESSURE = 0.6894


def draw_pressures(count: int) -> np.ndarray:
    return np.random.default_rng(1).uniform(0.0, 0.827, (count, 3))


def time_calls(call: Callable[[int], Any]) -> np.ndarray:
    """Times of single calls [s], after some to warm up."""
    for i in range(200):
        call(i)
    took = np.empty(CALLS)
    for i in range(CALLS):
        begin = time.perf_counter()
        call(i)
        took[i] = time.perf_counter() - begin
    return took


def build_thesis() -> Effector:
    design = effector_preset("prototype")
    muscle = muscle_preset("effector-45")
    placed = tuple(
        type(one)(name=one.name, muscle=muscle, angle=one.angle) for one in design.muscles
    )
    return Effector(
        design.replace(muscles=placed), lambda muscle: ThesisMuscle(muscle, load_path="bulk")
    )


def time_printed(effector: Effector, objective: str) -> tuple[float, list[tuple[float, ...]]]:
    """Time of one pose by the thesis's iteration [s], and its rows."""
    design, model = effector.design, effector.models[0]

    def contract(pressure: float, load: float) -> float:
        _, free, residual = solve_muscle(model.muscle, pressure, fsolve)
        assert residual < 1e-8
        return free - load / model.load_stiffness

    def deflect(contraction: float) -> float:
        backbone, _ = solve_section(4.0, 45.0, 15, contraction, objective=objective)
        return float(backbone[-1, 0])

    begin = time.perf_counter()
    rows = iterate_printed(contract, deflect, design.compliance, PRESSURE)
    return time.perf_counter() - begin, rows


def bench_pose_against_printed(benchmark: Any) -> None:
    """Each of a batch, and single calls; the square of the norm has a derivative at its minimum."""
    effector = build_thesis()
    theirs, rows = min(time_printed(effector, "squared") for _ in range(3))
    assert abs(rows[-1][2] - balance(effector, "R", pressure=PRESSURE).lateral) < 1e-3

    pressures = np.zeros((COUNT, 3))
    pressures[:, 0] = np.linspace(0.9, 1.0, COUNT) * PRESSURE
    found = benchmark.pedantic(pose, args=(effector, pressures), rounds=5, warmup_rounds=1)
    assert found.converged.all()
    assert abs(found.lateral[-1] - rows[-1][2]) < 1e-3
    ours = benchmark.stats.stats.min / COUNT
    single = float(np.median(time_calls(lambda i: pose(effector, pressures[i]))))
    benchmark.extra_info.update(
        what="pose of one muscle with equilibrium; SLSQP on the squared norm, and fsolve",
        measured=f"each, in a batch: {1e6 * ours:.2f} us, {theirs / ours:,.0f} times; a single "
        f"call: {1e6 * single:.0f} us, {theirs / single:,.0f} times ({1e3 * theirs:.0f} ms, "
        f"{len(rows)} steps)",
        required="at least 10,000 times in a batch, 2,000 times in a single call",
        ratio=theirs / ours,
        ratio_single=theirs / single,
    )
    assert theirs / ours >= 10_000.0
    assert theirs / single >= 2_000.0


def bench_pose_against_the_printed_norm(benchmark: Any) -> None:
    """The objective to the letter, which has no derivative at its minimum; timed once."""
    effector = build_thesis()
    theirs, rows = time_printed(effector, "norm")
    assert abs(rows[-1][2] - balance(effector, "R", pressure=PRESSURE).lateral) < 1e-3
    pressures = np.array([PRESSURE, 0.0, 0.0])
    benchmark.pedantic(pose, args=(effector, pressures), rounds=1000, warmup_rounds=5)
    single = benchmark.stats.stats.median
    benchmark.extra_info.update(
        what="pose of one muscle with equilibrium; SLSQP on the norm as printed, and fsolve",
        measured=f"a single call: {1e6 * single:.0f} us, {theirs / single:,.0f} times "
        f"({1e3 * theirs:.0f} ms, once, {len(rows)} steps)",
        required="at least 2,000 times in a single call",
        ratio_single=theirs / single,
    )
    assert theirs / single >= 2_000.0


def bench_pose_batch(benchmark: Any) -> None:
    effector, pressures = Effector(effector_preset("prototype")), draw_pressures(COUNT)
    found = benchmark.pedantic(pose, args=(effector, pressures), rounds=5, warmup_rounds=1)
    assert found.converged.all() and not found.saturated.any()
    ours = benchmark.stats.stats.min / COUNT
    benchmark.extra_info.update(
        what="full pose from three pressures, in a batch on one core",
        measured=f"{1e6 * ours:.2f} us each",
        required="under 10 us",
    )
    assert ours < 10e-6


def bench_pose_single(benchmark: Any) -> None:
    effector, pressures = Effector(effector_preset("prototype")), draw_pressures(CALLS)
    took = time_calls(lambda i: pose(effector, pressures[i]))
    middle, tail = np.percentile(took, [50.0, 99.0])
    benchmark.pedantic(pose, args=(effector, pressures[0]), rounds=1000)
    benchmark.extra_info.update(
        what="full pose from three pressures, one call",
        measured=f"p50 {1e6 * middle:.0f} us, p99 {1e6 * tail:.0f} us",
        required="p99 under 100 us",
        p99=float(tail),
    )
    assert tail < 100e-6


def bench_bend_batch(benchmark: Any) -> None:
    design, contractions = effector_preset("prototype"), np.linspace(0.0, 14.0, COUNT)
    benchmark.pedantic(bend, args=(design, contractions), rounds=5, warmup_rounds=1)
    benchmark.extra_info.update(
        what="backbone, muscle and angles at a contraction, in a batch on one core",
        measured=f"{1e6 * benchmark.stats.stats.min / COUNT:.2f} us each",
    )
