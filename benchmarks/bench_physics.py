"""Speed of driven motions: simulated over processor time, steps of the environment by minute."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Any

import pytest

from bozzini.anatomy import read_tract
from bozzini.motion import Scope
from bozzini.physics import Dynamics, ExecuteOptions, Insertion, Scenery, Simulation, WallOptions
from bozzini.physics.environment import POLICIES
from bozzini.study import run_insertion

SPAN_S = 12.0


@pytest.fixture(scope="module")
def human(upper_gi_dir: Path) -> Scenery:
    tract = read_tract(upper_gi_dir / "upper_gi_mc1mm.stl")
    study = run_insertion(tract, Scope(diameter=6.0, link_length=10.0))
    return Scenery(plan=study.plan, duct=study.field, tract=tract)


@pytest.mark.parametrize("drive", ["plan", "tractrix"])
@pytest.mark.parametrize("kind", ["penalty", "prism"])
def bench_real_time_factor(benchmark: Any, human: Scenery, kind: Any, drive: Any) -> None:
    scenery = dataclasses.replace(human, wall=WallOptions(kind=kind, faces=4000))
    found = benchmark.pedantic(
        scenery.run, args=(ExecuteOptions(drive=drive),), rounds=3, warmup_rounds=1
    )
    word = "clear" if drive == "plan" else "touching"
    benchmark.extra_info.update(
        what=f"upper tract, {kind}, {word}",
        measured=f"{found.speed_ratio:.1f} x real time",
        required="2 x",
    )


def _spend(scenery: Scenery, *, own: bool) -> float:
    """Return the processor time of the first seconds, with MuJoCo's own contact or ours [s]."""
    drive = scenery.make_drive("tractrix", 20.0)
    simulation = Simulation(drive.chain, scenery.make_wall("tractrix"), Dynamics())
    if own:
        simulation.wall = None
        simulation.model.geom_margin[:] = 0.0
        simulation.model.geom_gap[:] = 0.0
    simulation.place(drive.start)
    step = simulation.dynamics.step
    begin = time.process_time()
    for k in range(1, round(SPAN_S / step) + 1):
        simulation.step(*drive.command(k * step, simulation))
    return time.process_time() - begin


def bench_against_mujocos_own_contact(benchmark: Any, human: Scenery) -> None:
    scenery = dataclasses.replace(human, wall=WallOptions(kind="prism", faces=4000))
    ours = benchmark.pedantic(
        _spend, args=(scenery,), kwargs={"own": False}, rounds=3, warmup_rounds=1
    )
    theirs = min(_spend(scenery, own=True) for _ in range(3))
    benchmark.extra_info.update(
        what="prisms, touching: stated stiffness over MuJoCo's own contact, processor time",
        measured=f"{ours / theirs:.2f} ({SPAN_S / theirs:.1f} x real time there)",
    )


@pytest.mark.parametrize("policy", ["random", "centre"])
@pytest.mark.parametrize(
    ("robot", "observe"), [("leader", "clearance"), ("pushed", "clearance"), ("leader", "camera")]
)
def bench_environment(benchmark: Any, robot: Any, observe: Any, policy: str) -> None:
    env = Insertion(1, robot=robot, observe=observe)
    env.reset(seed=0)

    def run() -> float:
        env.reset(seed=0)
        begin = time.process_time()
        for _ in range(300):
            over = env.step(POLICIES[policy](env))[2]
            if over:
                env.reset()
        return 300.0 / (time.process_time() - begin) * 60.0

    rate = benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    info = {"what": f"environment, {robot}, {observe}, {policy}"}
    if (robot, observe) == ("leader", "clearance"):
        info["required"] = "10000"
    benchmark.extra_info.update(measured=f"{rate:.0f} steps/min on one core", **info)
