"""Steps by second of many environments: one batch in threads, processes, one after the other."""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import numpy as np
import pytest

from bozzini.physics import environment
from bozzini.physics.environment import NAME, POLICIES, Insertion, find_phantom
from bozzini.physics.simulate import Simulation

COUNT, STEPS = 8, 60


class Stepped(Insertion):
    """The same, each of its ten steps made by MuJoCo and by Python around it."""

    def _build(self, lumen: Any) -> Simulation:
        simulation = super()._build(lumen)
        simulation.__class__ = _Slow
        return simulation


class _Slow(Simulation):
    is_compiled = False


gymnasium.register(
    id="bozzini/Stepped-v0",
    entry_point=f"{__name__}:Stepped",
    max_episode_steps=environment.MOST_STEPS,
)


@pytest.fixture(scope="module")
def actions() -> np.ndarray:
    """What follows the middle of the lumen of phantom 1, for all (steps, n, 3)."""
    env, rows = Insertion(1), []
    env.reset(seed=0)
    for _ in range(STEPS):
        rows.append(POLICIES["centre"](env))
        env.step(rows[-1])
    return np.repeat(np.array(rows)[:, None], COUNT, axis=1)


def _measure(envs: Any, actions: np.ndarray) -> float:
    """Return the steps of all environments by second of the clock."""
    envs.reset(seed=0)
    envs.step(actions[0])
    begin = time.perf_counter()
    for row in actions[1:]:
        envs.step(row)
    return COUNT * (len(actions) - 1) / (time.perf_counter() - begin)


@pytest.mark.parametrize("observe", ["clearance", "camera"])
def bench_batch(benchmark: Any, actions: np.ndarray, observe: str) -> None:
    lumen = find_phantom(1)
    kinds = {
        "vector_entry_point": NAME, "async": NAME, "sync": NAME, "before": "bozzini/Stepped-v0"
    }  # fmt: skip
    made = {
        kind: gymnasium.make_vec(
            name, COUNT, "async" if kind == "before" else kind, lumen=lumen, observe=observe
        )
        for kind, name in kinds.items()
    }
    rates = {kind: max(_measure(envs, actions) for _ in range(3)) for kind, envs in made.items()}
    benchmark.pedantic(
        _measure, args=(made["vector_entry_point"], actions), rounds=1, warmup_rounds=0
    )
    for envs in made.values():
        envs.close()
    batch = rates.pop("vector_entry_point")
    ratios = ", ".join(f"{batch / rate:.2f} x {kind}" for kind, rate in rates.items())
    benchmark.extra_info.update(
        what=f"{COUNT} environments in one batch, {observe}",
        measured=f"{batch:.0f} steps/s: {ratios}",
        required="5 x processes",
    )
