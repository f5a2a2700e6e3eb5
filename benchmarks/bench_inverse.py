"""The inverse of the end-effector: one target, as in a control loop, and batches."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
import pytest

from bozzini.effector.design import effector_preset
from bozzini.effector.effector import Effector
from bozzini.effector.inverse import solve_inverse
from bozzini.effector.pose import pose
from bozzini.effector.steering import Stick, find_stick_scale, steer
from bozzini.muscle import EnergyMuscle, ThesisMuscle

MODELS = {"energy": EnergyMuscle, "thesis": partial(ThesisMuscle, load_path="bulk")}
CALLS = 10_000


def draw_targets(count: int) -> np.ndarray:
    """Targets in and out of the workspace."""
    return np.random.default_rng(2).uniform(-20.0, 20.0, (count, 2))


def time_calls(call: Any, arguments: Any) -> np.ndarray:
    """Time of each call [us]."""
    took = np.empty(len(arguments))
    for n, argument in enumerate(arguments):
        begin = time.perf_counter()
        call(argument)
        took[n] = time.perf_counter() - begin
    return 1e6 * took


@pytest.mark.parametrize("name", list(MODELS))
def bench_one_target(benchmark: Any, name: str) -> None:
    effector = Effector(effector_preset("prototype"), MODELS[name])
    targets = draw_targets(CALLS)
    solve_inverse(effector, targets[0])
    took = time_calls(lambda target: solve_inverse(effector, target), targets)
    benchmark.pedantic(solve_inverse, args=(effector, targets[0]), rounds=200, warmup_rounds=5)
    middle, late = np.percentile(took, [50.0, 99.0])
    benchmark.extra_info.update(
        what=f"pressures of one target, {name} model, checks included: median, 99th percentile",
        measured=f"{middle:.1f} us, {late:.1f} us",
        required="99th percentile under 200 us",
        p99_us=float(late),
    )
    assert late < 200.0


@pytest.mark.parametrize("name", list(MODELS))
def bench_many_targets(benchmark: Any, name: str) -> None:
    effector = Effector(effector_preset("prototype"), MODELS[name])
    targets = draw_targets(50_000)
    found = benchmark.pedantic(solve_inverse, args=(effector, targets), rounds=5, warmup_rounds=1)
    each = 1e6 * benchmark.stats.stats.min / len(targets)
    posed = pose(effector, found.pressures[::50])
    off = np.abs(posed.lateral_vector - found.delivered[::50]).max()
    assert off < 1e-8
    benchmark.extra_info.update(
        what=f"pressures of 50,000 targets, {name} model, each; largest error of the pose there",
        measured=f"{each:.2f} us; {off:.1e} mm",
        required="far below one alone; 1e-8 mm",
    )
    assert each < 20.0


def bench_stick(benchmark: Any) -> None:
    effector = Effector(effector_preset("prototype"))
    stick, scale = Stick(dead_zone=20.0), find_stick_scale(effector)
    raw = np.random.default_rng(3).integers(0, 1024, (CALLS, 2))
    took = time_calls(lambda r: steer(effector, r, stick=stick, scale=scale), raw)
    benchmark(steer, effector, raw[0], stick=stick, scale=scale)
    middle, late = np.percentile(took, [50.0, 99.0])
    benchmark.extra_info.update(
        what="stick readings to pressures, one at a time: median, 99th percentile",
        measured=f"{middle:.1f} us, {late:.1f} us",
        required="99th percentile under 200 us",
        p99_us=float(late),
    )
    assert late < 200.0
