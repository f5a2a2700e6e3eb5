"""Speed of driven motions: simulated over processor time, steps of the environment by minute."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import pytest

from bozzini.anatomy import read_tract
from bozzini.motion import Scope
from bozzini.physics import ExecuteOptions, Insertion, Scenery, WallOptions
from bozzini.physics.environment import follow_centre
from bozzini.study import run_insertion


@pytest.fixture(scope="module")
def human(upper_gi_dir: Path) -> Scenery:
    tract = read_tract(upper_gi_dir / "upper_gi_mc1mm.stl")
    study = run_insertion(tract, Scope(diameter=6.0, link_length=10.0))
    return Scenery(plan=study.plan, duct=study.field, tract=tract)


@pytest.mark.parametrize("kind", ["penalty", "prism"])
def bench_real_time_factor(benchmark: Any, human: Scenery, kind: Any) -> None:
    scenery = dataclasses.replace(human, wall=WallOptions(kind=kind, faces=4000))
    found = benchmark.pedantic(scenery.run, args=(ExecuteOptions(),), rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(
        what=f"certified plan, upper tract, {kind}",
        measured=f"{found.speed_ratio:.1f} x real time",
        required="2 x",
    )


@pytest.mark.parametrize("robot", ["leader", "pushed"])
def bench_environment(benchmark: Any, robot: Any) -> None:
    env = Insertion(1, robot=robot)
    env.reset(seed=0)

    def run() -> float:
        env.reset(seed=0)
        begin = time.process_time()
        for _ in range(200):
            env.step(follow_centre(env))
        return 200.0 / (time.process_time() - begin) * 60.0

    rate = benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    benchmark.extra_info.update(
        what=f"environment, {robot}", measured=f"{rate:.0f} steps/min on one core", required="10000"
    )
