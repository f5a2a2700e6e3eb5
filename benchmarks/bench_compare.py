"""Fit and rank all muscle models on made-up tables, cross-validation included."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pytest

from bozzini.muscle import MODELS, Measurements, RankOptions, preset, rank

REQUIRED = 60.0
"""Longest time of the processor for all models [s]."""


@pytest.mark.parametrize("rows", [40, 300])
def bench_rank_all_models(benchmark: Any, rows: int) -> None:
    muscle = preset("effector-45")
    pressure = np.repeat(np.linspace(0.15, 0.8, rows // 2), 2)
    load = np.tile([0.0, 0.2], rows // 2)
    contraction = MODELS["kothera-balance"](muscle).contraction(pressure, load)
    error = 0.05 * np.random.default_rng(1).normal(size=pressure.size)
    data = Measurements(pressure=pressure, contraction=contraction + error, load=load)

    begin = time.process_time()
    ranking = benchmark.pedantic(rank, args=(data, muscle), rounds=1)
    took = time.process_time() - begin
    assert ranking.models[0].name == "kothera-balance"
    assert took < REQUIRED
    benchmark.extra_info["what"] = (
        f"fit, rank and cross-validate all muscle models on {len(data)} rows"
    )
    benchmark.extra_info["measured"] = (
        f"{took:.0f} s: {len(ranking.models)} fitted, {len(ranking.refusals)} refused with a reason"
    )
    benchmark.extra_info["required"] = f"under {REQUIRED:.0f} s"


def bench_rank_all_models_on_forces(benchmark: Any) -> None:
    """Blocked forces of four lengths of a muscle, as many rows as a published set of them has."""
    random = np.random.default_rng(1)
    lengths = np.repeat([83.0, 132.0, 182.0, 233.0], 312)[:1245]
    muscle = preset("festo-10")
    pressure = random.uniform(0.1, 0.62, lengths.size)
    contraction = random.integers(0, 4, lengths.size) * 0.04 * lengths
    load = np.empty(lengths.size)
    for length in np.unique(lengths):
        own = muscle.replace(length=float(length)).fill()
        rows = lengths == length
        load[rows] = MODELS["kothera-balance"](own).force(pressure[rows], contraction[rows])
    data = Measurements(
        pressure=pressure,
        contraction=contraction,
        load=load + random.normal(size=load.size),
        specimen=np.array([f"{length:.0f} mm" for length in lengths]),
        geometry={"length": lengths},
    )

    begin, before = time.perf_counter(), os.times()
    ranking = benchmark.pedantic(
        rank, args=(data, muscle), kwargs={"options": RankOptions(jobs=2)}, rounds=1
    )
    took, after = time.perf_counter() - begin, os.times()
    spent = sum(after[:4]) - sum(before[:4])
    assert ranking.models[0].name == "kothera-balance"
    assert took < REQUIRED
    benchmark.extra_info["what"] = (
        f"fit, rank and cross-validate all muscle models on {len(data):,} blocked forces, 2 cores"
    )
    benchmark.extra_info["measured"] = (
        f"{took:.0f} s, {spent:.0f} s of the processor: {len(ranking.models)} fitted, "
        f"{len(ranking.refusals)} refused with a reason"
    )
    benchmark.extra_info["required"] = f"under {REQUIRED:.0f} s"
