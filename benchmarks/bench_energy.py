"""The energy model on one robot of two sections, and how far it is from the rod."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, Section
from bozzini.continuum.coupling import Coupling
from bozzini.continuum.energy import EnergyModel
from bozzini.continuum.rod import RodModel
from tests.continuum.rods import ROUTINGS, cross_tendons, helix, make_robot

BATCH = 200


def make_double(discs: int = 20) -> ContinuumRobot:
    return ContinuumRobot(
        tuple(
            Section(
                length=50.0,
                radius=5.0,
                discs=discs,
                bending_stiffness=stiffness,
                tendons=tuple(cross_tendons(4, angle=angle, prefix=prefix)),
            )
            for stiffness, angle, prefix in ((1000.0, 0.0, "p"), (500.0, 0.3, "d"))
        )
    )


@pytest.mark.parametrize("segment", ["chord", "arc", "channel"])
def bench_energy(benchmark: Any, segment: str) -> None:
    robot = make_double()
    model = EnergyModel(robot, segment=segment)
    bends = np.random.default_rng(0).uniform(-1.2, 1.2, (BATCH, 4))
    commands = bends @ Coupling(robot).matrix.T
    # Straight tendons on an arc are a little shorter on either side: they need some slack.
    commands = commands - (0.2 if segment == "arc" else 0.0)
    assert model.shape(commands).converged.all()
    took = np.empty(BATCH)
    for index, command in enumerate(commands):
        begin = time.perf_counter()
        model.shape(command)
        took[index] = time.perf_counter() - begin
    shapes = benchmark(model.shape, commands)
    each = benchmark.stats.stats.mean / BATCH
    benchmark.extra_info.update(
        what=f"energy ({segment}), 2 sections x 4 tendons x 20 segments",
        measured=f"{1e3 * each:.2f} ms each of {BATCH}; alone median {1e3 * np.median(took):.2f}, "
        f"p99 {1e3 * np.quantile(took, 0.99):.2f} ms; {shapes.iterations.mean():.1f} steps",
        required="under 1 ms",
    )
    assert each < 1e-3


@pytest.mark.parametrize("discs", [10, 20, 40])
def bench_loaded_energy(benchmark: Any, discs: int) -> None:
    robot = make_robot(cross_tendons(4), discs=discs)
    model = EnergyModel(robot, tip_force=(0.05, 0.02, -0.1), tendon_stiffness=1e4)
    command = [3.0, 1.0, -3.0, -1.0]
    shape = model.shape(command)
    assert shape.converged and shape.stable
    warm = measure(lambda: model.shape(command, initial=shape))
    benchmark(model.shape, command)
    benchmark.extra_info.update(
        what=f"energy (chord) under a tip force, 4 tendons x {discs} segments, with its stability",
        measured=f"{1e3 * benchmark.stats.stats.median:.2f} ms from rest, {warm:.2f} ms from "
        "the shape before",
    )


def measure(call: Callable[[], object], count: int = 30) -> float:
    """Least processor time of a call [ms]."""
    times = []
    for _ in range(count):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)


@pytest.mark.parametrize("kind", ["chord", "channel", "rod"])
def bench_jacobian(benchmark: Any, kind: str) -> None:
    """By displacements, tensions, tip wrench, stiffness, routing and base, at all stations."""
    robot = make_robot([helix(f"h{k}", 0.5, 0.5 * k * np.pi) for k in range(4)], disc_weight=1e-3)
    loads = {"tip_force": (0.05, 0.02, -0.1), "tendon_stiffness": 1e4}
    model = RodModel(robot, **loads) if kind == "rod" else EnergyModel(robot, segment=kind, **loads)
    command = model.shape_under_tensions([1.0, 0.5, 0.0, 0.3]).require().displacements
    shape = model.shape(command).require()
    benchmark(model.jacobian, shape)
    took = measure(lambda: model.jacobian(shape))
    rest = measure(lambda: model.shape(command))
    warm = measure(lambda: model.shape(command, initial=shape))
    benchmark.extra_info.update(
        what=f"jacobian, {kind}: 4 helical tendons, 20 discs, tip force and weight",
        measured=f"{took:.2f} ms; a shape {rest:.2f} ms from rest, {warm:.2f} ms from the one "
        f"before; {took / rest:.2f} x a shape",
        required="at most 2 x a shape",
    )
    assert took <= 2.0 * rest


@pytest.mark.parametrize("name", list(ROUTINGS))
def bench_energy_against_rod(benchmark: Any, name: str) -> None:
    tendons, tensions = ROUTINGS[name]
    rod = RodModel(make_robot(tendons)).shape_under_tensions(tensions)
    words = []
    for segment in ("chord", "arc", "channel"):
        errors = []
        for discs in (10, 20, 40):
            shape = EnergyModel(make_robot(tendons, discs=discs), segment=segment).shape(
                rod.displacements
            )
            errors.append(f"{np.linalg.norm(shape.tip - rod.tip):.3f}")
        wrong = 100.0 * np.abs(shape.tensions / np.asarray(tensions) - 1.0).max()
        words.append(f"{segment} {'/'.join(errors)} mm, {wrong:.2f} %")
    benchmark(RodModel(make_robot(tendons)).shape, rod.displacements)
    benchmark.extra_info.update(
        what=f"energy against rod: {name}, 10/20/40 segments, tensions at 40",
        measured="; ".join(words) + f"; rod {1e3 * benchmark.stats.stats.mean:.0f} ms",
    )


@pytest.mark.parametrize("given", ["displacements", "tensions"])
def bench_loaded_rod(benchmark: Any, given: str) -> None:
    robot = make_robot(cross_tendons(4))
    model = RodModel(robot, tip_force=(0.05, 0.02, -0.1), tendon_stiffness=1e4)
    call, command = {
        "displacements": (model.shape, [3.0, 1.0, -3.0, -1.0]),
        "tensions": (model.shape_under_tensions, [3.0, 1.0, 0.0, 0.0]),
    }[given]
    assert call(command).stable
    benchmark(call, command)
    benchmark.extra_info.update(
        what=f"rod under a tip force, {given} of 4 tendons, 200 steps, with its stability",
        measured=f"{1e3 * benchmark.stats.stats.median:.2f} ms from rest",
        required="at most 2 ms",
    )
