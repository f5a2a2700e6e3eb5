"""Fit and rank all muscle models on made-up tables, cross-validation included."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from bozzini.muscle import MODELS, Measurements, preset, rank

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
