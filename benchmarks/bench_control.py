"""Control of an end-effector in time: steps of the predictive controller, and what it gains."""

from __future__ import annotations

from typing import Any

import numpy as np

from bozzini.effector import CONTROLLERS, PredictiveControl, StaticInverse, run_control
from bozzini.effector.control import PERIOD
from bozzini.tracking import trace_places
from tests.effector.test_control import MOTION, make_arm


def bench_controllers(benchmark: Any) -> None:
    arm = make_arm(MOTION)
    wanted = trace_places("circle", radius=5.0, frequency=0.5, period=PERIOD)
    half = len(wanted) // 2

    def track(kind: type[Any], seen: bool) -> tuple[float, np.ndarray]:
        run = run_control(kind(effector=arm), wanted, plant=arm, seen=seen)
        off = (run.tip - wanted)[half:]
        return float(np.sqrt(np.square(off).sum(axis=1).mean())), run.step_times[1:]

    track(PredictiveControl, False)  # compiled
    found = {name: track(*chosen) for name, chosen in CONTROLLERS.items()}
    static, _ = found["static inverse"]
    best, steps = found["predictive"]
    middle, tail = np.percentile(steps, [50.0, 99.0])
    controller = PredictiveControl(effector=arm)
    state = controller.begin(StaticInverse(effector=arm).rest_at(wanted[0]))
    _, state = controller.step(state, wanted[1:26])
    benchmark.pedantic(controller.step, args=(state, wanted[2:27]), rounds=200)
    errors = ", ".join(f"{name} {rms:.3f}" for name, (rms, _) in found.items())
    benchmark.extra_info.update(
        what="tip of a simulated end-effector round a circle of 5 mm at 0.5 Hz",
        measured=f"rms [mm]: {errors}; a step of the predictive one p50 {1e3 * middle:.1f} ms, "
        f"p99 {1e3 * tail:.1f} ms",
        required="predictive at least 2 times better than the static inverse; p99 under 10 ms",
        ratio=static / best,
    )
    assert static >= 2.0 * best
    assert tail < 10e-3
