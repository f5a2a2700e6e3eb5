"""Hysteresis operators: compiled, against the same recursion in plain Python; and fits.

The plain Python is that of the tests, timed on the first samples of the same history. Bouc-Wen has
no recursion as printed: there it is SciPy's `solve_ivp` from sample to sample, a general solver at
a tolerance of its own, against a closed form for an exponent of 1. Nothing is required of either.
Fits are those of a record of a muscle: of the operator itself to all samples, and of the operator
that a static model carries to the samples that `fit_loop` keeps.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from bozzini.muscle.hysteresis import LoopOptions, PrandtlIshlinskii
from bozzini.muscle.loops import OPERATORS as KINDS
from bozzini.muscle.loops import LoopFitOptions, fit_loop
from tests.muscle.hysteresis.reference import OPERATORS, PLAIN
from tests.muscle.loops.plants import STATIC, Plant, make_record, make_relays

COUNT = 100_000
REQUIRED = 5.0
"""Longest time of the processor for a fit [s]."""


def draw_history() -> np.ndarray:
    """Samples between 0 and 1 of a walk with some thousand return points."""
    walk = np.cumsum(np.random.default_rng(1).normal(size=COUNT)) * 0.01
    return np.asarray(0.5 + 0.5 * np.sin(walk))


@pytest.mark.parametrize("name", OPERATORS)
def bench_operator(benchmark: Any, name: str) -> None:
    history = draw_history()
    operator = OPERATORS[name]
    few = 200 if name.startswith("bouc-wen") else 5000
    begin = time.perf_counter()
    expected = PLAIN[name](operator, history[:few])
    plain = (time.perf_counter() - begin) / few
    output = benchmark(operator.apply, history)
    assert abs(output[:few] - expected).max() < 1e-7
    each = benchmark.stats.stats.mean / COUNT
    against = "SciPy's solve_ivp" if name.startswith("bouc-wen") else "plain Python"
    benchmark.extra_info.update(
        what=f"hysteresis: {name}, {operator.memory_size} inner variables",
        measured=f"{1e9 * each:.0f} ns a sample, {against} {1e6 * plain:.1f} us: "
        f"{plain / each:.0f} times",
    )


def bench_identify(benchmark: Any) -> None:
    history = draw_history()[:10_000]
    truth = OPERATORS["plays"]
    noise = 0.01 * np.random.default_rng(2).normal(size=len(history))
    response = truth.apply(history) + noise
    fit = benchmark(PrandtlIshlinskii.identify, history, response, origin=0.05)
    assert fit.converged
    benchmark.extra_info.update(
        what="hysteresis: 10 plays fitted to 10,000 samples",
        measured=f"{1e3 * benchmark.stats.stats.mean:.0f} ms",
    )


@pytest.mark.parametrize("name", KINDS)
def bench_fit(benchmark: Any, name: str) -> None:
    record, _, _ = make_record(Plant(make_relays()), count=10_000)
    options = LoopOptions(carried=True)
    fit_loop(record, name, static=STATIC, options=LoopFitOptions(samples=60))  # compiles

    def fit() -> tuple[float, float]:
        begin = time.process_time()
        KINDS[name].identify(record.pressure, record.response, options=options)
        middle = time.process_time()
        fit_loop(record, name, static=STATIC, options=LoopFitOptions(drift="log"))
        return middle - begin, time.process_time() - middle

    alone, carried = benchmark.pedantic(fit, rounds=1)
    benchmark.extra_info.update(
        what=f"hysteresis: {name} fitted to 10,000 samples of a muscle",
        measured=f"{alone:.2f} s; carried by a static model {carried:.2f} s",
        required=f"under {REQUIRED:g} s of the processor",
    )
    assert max(alone, carried) < REQUIRED
