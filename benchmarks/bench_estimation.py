"""Shape and force from sensors: time of a step, and forces found on simulated robots."""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bozzini.continuum import (
    BodySensor,
    ContinuumRobot,
    CurvatureSensor,
    EnergyModel,
    ModelError,
    PlaceSensor,
    PointLoad,
    PoseSensor,
    Section,
    ShapeEstimator,
    Tendon,
    UnknownLoad,
)

Array = NDArray[np.float64]

LENGTH_MM, OFFSET_MM = 200.0, 4.0
GRATINGS, SHARE, LEAST = 12, 0.01, 1e-4
"""Number of gratings, their noise by the curvature, and by the largest that is commanded [1/mm]."""
ROBOTS = 200
SMALL = ModelError(curvature=2e-5, twist=2e-5, reach=40.0, stiffness=0.01, zero=0.02)
"""Errors of a model that was fitted well."""


def make_robot(stiffer: Array | float = 1.0) -> ContinuumRobot:
    """Return a robot of three sections and nine tendons, each section so many times as stiff."""
    sections = []
    for k, factor in enumerate(np.broadcast_to(stiffer, 3).tolist()):
        tendons = tuple(
            Tendon(
                name=f"T{3 * k + j + 1}",
                offset=OFFSET_MM,
                angle=2.0 * math.pi / 3.0 * j + 0.5 * k,
                stiffness=3000.0,
            )
            for j in range(3)
        )
        sections.append(
            Section(
                length=LENGTH_MM / 3.0,
                radius=5.0,
                discs=6,
                bending_stiffness=3000.0 * factor,
                torsional_stiffness=2500.0 * factor,
                tendons=tendons,
            )
        )
    return ContinuumRobot(tuple(sections), name="simulated")


def bend(angles: Array, directions: Array) -> Array:
    """Return displacements that bend the sections [rad], and pull all tendons a little."""
    clocking = 2.0 * math.pi / 3.0 * np.arange(3) + 0.5 * np.arange(3)[:, None]
    moved = OFFSET_MM * angles[:, None] * np.cos(clocking - directions[:, None])
    return np.asarray(moved.ravel() + 0.3)


def draw(estimator: ShapeEstimator, random: np.random.Generator) -> Any:
    """Return a state drawn from what is known before anything is read."""
    state = estimator.begin()
    spread = np.sqrt(np.diag(state.covariance))
    mean = state.mean + spread * random.standard_normal(len(spread))
    return dataclasses.replace(state, mean=mean)


def find_forces(stiffer: Any, error: ModelError, *, robots: int, seed: int) -> dict[str, Array]:
    """Return what gratings find of a force on robots that bend in all sections.

    The true robot has segments half as long, a curvature of its own, zeros in error, and sections
    `stiffer` (a function of a generator) times as stiff.
    """
    random = np.random.default_rng(seed)
    gratings: tuple[BodySensor, ...] = tuple(
        CurvatureSensor(
            name=f"grating {k}",
            arc_length=(k + 0.5) * LENGTH_MM / GRATINGS,
            deviation=LEAST,
            share=SHARE,
        )
        for k in range(GRATINGS)
    )
    estimator = ShapeEstimator(
        model=EnergyModel(make_robot(), segment="channel", between=2),
        sensors=gratings,
        error=error,
        loads=(UnknownLoad(),),
    )
    rows: list[list[float]] = []
    while len(rows) < robots:
        command = bend(random.uniform(0.0, 0.7, 3), random.uniform(0.0, 2.0 * math.pi, 3))
        place, size = random.uniform(0.25, 1.0) * LENGTH_MM, random.uniform(0.2, 1.0)
        angle = random.uniform(0.0, 2.0 * math.pi)
        force = (size * math.cos(angle), size * math.sin(angle), 0.0)
        load = PointLoad(arc_length=place, force=force, frame="body")
        model = EnergyModel(
            make_robot(stiffer(random)), segment="channel", between=5, loads=(load,)
        )
        known = dataclasses.replace(error, stiffness=0.0)
        truth = ShapeEstimator(model=model, sensors=gratings, error=known)
        state = draw(truth, random)
        shape = truth.estimate(command, state=state)
        if not shape.converged:  # the force is more than it can hold
            continue
        readings = truth.predict(command, state=shape.state)
        for reading in readings.values():
            noise = math.hypot(LEAST, SHARE * float(np.hypot(*reading)))
            reading += noise * random.standard_normal(2)
        found = estimator.estimate(command, readings)
        own = found.loads[0]
        inside = np.abs(found.tip - shape.tip) <= 1.96 * found.deviations[-1]
        rows.append([
            found.converged,
            abs(own.place - place) / LENGTH_MM,
            abs(own.force / size - 1.0),
            own.place_low <= place <= own.place_high,
            own.force_low <= size <= own.force_high,
            float(inside.mean()),
        ])  # fmt: skip
    names = ("converged", "place", "size", "place inside", "size inside", "tip inside")
    return dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))


def tell(found: dict[str, Array]) -> str:
    """Return the errors and coverages in words."""
    middle, far = np.percentile(100.0 * found["place"], [50.0, 95.0])
    size, large = np.percentile(100.0 * found["size"], [50.0, 95.0])
    inside = ", ".join(
        f"{name} {100.0 * found[f'{name} inside'].mean():.1f} %"
        for name in ("place", "size", "tip")
    )
    return (
        f"place p50 {middle:.1f}, p95 {far:.1f} % of the length; size p50 {size:.1f}, "
        f"p95 {large:.1f} %; in 95 % intervals: {inside}"
    )


def bench_forces(benchmark: Any) -> None:
    right = find_forces(
        lambda random: np.exp(0.01 * random.standard_normal(3)), SMALL, robots=ROBOTS, seed=1
    )
    wrong = find_forces(
        lambda random: random.choice([0.8, 1.2]),
        dataclasses.replace(SMALL, stiffness=0.2),
        robots=ROBOTS,
        seed=2,
    )
    benchmark.pedantic(
        find_forces, args=(lambda _: 1.0, SMALL), kwargs={"robots": 1, "seed": 3}, rounds=1
    )
    benchmark.extra_info.update(
        what=f"force on {ROBOTS} simulated robots by {GRATINGS} gratings with 1 % noise",
        measured=f"{tell(right)}; stiffness 20 % off: {tell(wrong)}",
        required="place within 5 % and size within 10 % at p95; coverage 93 to 97 %",
        ratio=1.0,
    )
    assert np.percentile(right["place"], 95.0) < 0.05
    assert np.percentile(right["size"], 95.0) < 0.10


def bench_step(benchmark: Any) -> None:
    random = np.random.default_rng(0)
    sensors = (
        PoseSensor(name="tip"),
        PlaceSensor(name="middle", arc_length=100.0),
        CurvatureSensor(name="first", arc_length=50.0, deviation=1e-4),
        CurvatureSensor(name="last", arc_length=150.0, deviation=1e-4),
    )
    estimator = ShapeEstimator(
        model=EnergyModel(make_robot(), segment="channel"),
        sensors=sensors,
        error=ModelError(memory=20.0),
    )
    truth = draw(estimator, random)
    commands = [
        bend(np.full(3, 0.4 + 0.02 * k), np.full(3, 0.01 * k) + [0.0, 0.6, 1.2]) for k in range(60)
    ]
    noises = {"tip": [0.5] * 3 + [0.01] * 3, "middle": [0.5] * 3, "first": [1e-4] * 2,
              "last": [1e-4] * 2}  # fmt: skip
    readings = [
        {
            name: reading + noises[name] * random.standard_normal(len(reading))
            for name, reading in estimator.predict(command, state=truth).items()
        }
        for command in commands
    ]
    found, times = estimator.estimate(commands[0], readings[0]), []
    for command, reading in zip(commands[1:], readings[1:], strict=True):
        begin = time.process_time()
        found = estimator.estimate(command, reading, state=estimator.wait(found.state, 0.05))
        times.append(time.process_time() - begin)
        assert found.converged
    middle, tail = np.percentile(times, [50.0, 95.0])
    state = estimator.wait(found.state, 0.05)
    benchmark.pedantic(
        lambda: estimator.estimate(commands[-1], readings[-1], state=state), rounds=50
    )
    benchmark.extra_info.update(
        what="step of the estimate of a robot of 200 mm, nine tendons, four sensors",
        measured=f"processor time p50 {1e3 * middle:.1f} ms, p95 {1e3 * tail:.1f} ms",
        required="at most 5 ms",
        ratio=5e-3 / middle,
    )
    assert middle < 5e-3
