"""Motion of a tendon robot in time: how much faster than real time, and beside other packages."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

from benchmarks.compare_motion import BOUNDS, measure_motions
from bozzini.continuum import (
    ContactOptions,
    ContinuumRobot,
    DynamicsOptions,
    Section,
    ShapeHistory,
    Tendon,
    Wire,
    simulate,
)
from bozzini.duct import RoundCones

TIMES = np.linspace(0.0, 2.0, 101)
ON_ONE_CORE = pytest.mark.benchmark(timer=time.process_time)
"""Times are the processor's."""
OPTIONS = DynamicsOptions(segment="chord", damping_time=5e-3, max_step=2e-3)


def make_robot() -> ContinuumRobot:
    """Return a robot of 200 mm: 30 elements, and nine tendons in three sections."""
    wire = Wire(diameter=1.0, modulus=60e3, density=6450.0)
    sections = []
    for part in range(3):
        tendons = tuple(
            Tendon(name=f"T{part}{k}", offset=4.0, angle=2.0 * math.pi * k / 3.0 + 0.7 * part)
            for k in range(3)
        )
        sections.append(
            Section(
                length=200.0 / 3.0, radius=5.0, discs=10, wire=wire, disc_weight=2e-3,
                tendons=tendons,
            )
        )  # fmt: skip
    return ContinuumRobot(tuple(sections))


def move(robot: ContinuumRobot, **walls: Any) -> ShapeHistory:
    """Return its motion while all tendons are pulled."""
    speeds = np.linspace(4.0, 12.0, 9)
    pulls = 1.5 * np.sin(np.outer(TIMES, speeds)) ** 2
    found = simulate(robot, TIMES, tensions=pulls, options=OPTIONS, **walls)
    assert found.converged, found.reason
    return found


@ON_ONE_CORE
def bench_free(benchmark: Any) -> None:
    robot = make_robot()
    benchmark.pedantic(move, args=(robot,), rounds=5, warmup_rounds=1)
    factor = TIMES[-1] / benchmark.stats.stats.min
    benchmark.extra_info.update(
        what="motion of a robot of 200 mm, 9 tendons, 30 elements, steps of 2 ms",
        measured=f"{factor:.1f} times real time",
        required="at least 5",
        ratio=factor,
    )
    assert factor >= 5.0


@ON_ONE_CORE
def bench_contact(benchmark: Any) -> None:
    robot = make_robot()
    tube = RoundCones(np.array([[0.0, 0.0, -50.0], [0.0, 0.0, 300.0]]), np.array([8.0, 8.0]))
    contact = ContactOptions(wall_stiffness=0.5, friction=0.1)
    found = move(robot, duct=tube, contact=contact)
    assert np.mean(found.wall_sum > 0.0) > 0.5
    walls = {"duct": tube, "contact": contact}
    benchmark.pedantic(move, args=(robot,), kwargs=walls, rounds=5, warmup_rounds=1)
    factor = TIMES[-1] / benchmark.stats.stats.min
    benchmark.extra_info.update(
        what="the same in a tube 16 mm wide, with friction",
        measured=f"{factor:.1f} times real time",
        required="at least 1",
        ratio=factor,
    )
    assert factor >= 1.0


def bench_peers(benchmark: Any) -> None:
    ratios = benchmark.pedantic(measure_motions, rounds=1)
    told = ", ".join(
        f"{tool} takes {ratio:.0f} times as long" if math.isfinite(ratio) else f"{tool} was not run"
        for tool, ratio in ratios.items()
    )
    benchmark.extra_info.update(
        what="a wire in time beside other packages, tip within 0.5 % of the length",
        measured=told,
        required=" and ".join(f"{tool} at least {least:g}" for tool, least in BOUNDS.items()),
    )
    assert all(not ratios[tool] < least for tool, least in BOUNDS.items())
