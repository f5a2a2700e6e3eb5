"""A robot pushed into a tract, step by step, against a general optimiser on the same problem."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.optimize import minimize

from bozzini.continuum import ContactModel, ContactOptions, PointLoad, RobotDesign, Section, Tendon
from bozzini.duct import RoundCones

STIFFNESS = 500.0
"""Of the robot [N mm^2]."""

STEP_MM = 2.0
"""How far the robot is pushed in at once [mm]."""


def make_tract() -> tuple[np.ndarray, RoundCones]:
    """Return the middle line of a quarter bend and the tube of 16 mm about it."""
    angle = np.linspace(0.0, np.pi / 2.0, 25)
    bend = 40.0 * np.stack([1.0 - np.cos(angle), np.zeros(25), np.sin(angle)], axis=1)
    line = np.concatenate([[[0.0, 0.0, -30.0]], bend, [[70.0, 0.0, 40.0]]])
    return line, RoundCones(line, np.full(len(line), 8.0))


def bench_contact_step(benchmark: Any) -> None:
    line, tube = make_tract()
    tendons = tuple(Tendon(name=f"T{k}", offset=2.5, angle=k * np.pi / 2.0) for k in range(4))
    section = Section(length=120.0, radius=3.0, tendons=tendons, bending_stiffness=STIFFNESS)
    robot = RobotDesign((section,), base_position=tuple(line[0]))
    words = []
    for name, wall in (("exact", tube), ("sampled, 1 mm", tube.sample(1.0))):
        model = ContactModel(robot, wall)
        shape = model.shape(inserted=40.0)
        took, clock = [], []
        for length in np.arange(42.0, 90.0, STEP_MM):
            begin, wall_begin = time.process_time(), time.perf_counter()
            shape = model.shape(inserted=float(length), initial=shape)
            took.append(1e3 * (time.process_time() - begin))
            clock.append(1e3 * (time.perf_counter() - wall_begin))
            assert shape.converged, shape.reason
        words.append(
            f"{name}: processor {np.median(took[1:]):.1f} ms, p90 "
            f"{np.quantile(took[1:], 0.9):.1f}, "
            f"clock {np.median(clock[1:]):.1f} ms"
        )
    benchmark(model.shape, inserted=float(length) - STEP_MM, initial=shape)
    benchmark.extra_info.update(
        what=f"contact in a bent tract, 4 tendons x {len(model.stations) - 1} segments, a step of "
        f"{STEP_MM:g} mm",
        measured="; ".join(words),
        required="20 ms a step",
    )


def bench_contact_against_slsqp(benchmark: Any) -> None:
    # In a plane, tip force across a straight lumen; SLSQP has its own differences only.
    length, count, gap, load = 60.0, 20, 3.0, 0.05
    line = np.array([[0.0, 0.0, -10.0], [0.0, 0.0, 2.0 * length]])
    section = Section(length=length, radius=1.0, bending_stiffness=STIFFNESS / 5.0)
    model = ContactModel(
        RobotDesign((section,)),
        RoundCones(line, np.array([1.0 + gap] * 2)),
        loads=(PointLoad(force=(load, 0.0, 0.0)),),
        options=ContactOptions(segment_length=length / count, smoothing=1e-3),
    )
    span = length / count

    def place(turns: np.ndarray) -> np.ndarray:
        ways = np.cumsum(turns) - 0.5 * turns
        return np.cumsum(span * np.sinc(0.5 * turns / np.pi) * np.sin(ways))

    begin = time.process_time()
    found = minimize(
        lambda turns: (
            0.1 * STIFFNESS / span * float(turns @ turns) - load * float(place(turns)[-1])
        ),
        np.zeros(count),
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda turns: gap - place(turns)},
        options={"maxiter": 500, "ftol": 1e-13},
    )
    other = time.process_time() - begin
    shape = model.shape()
    np.testing.assert_allclose(shape.points[1:, 0], place(found.x), atol=1e-4)
    times = []
    for _ in range(10):
        begin = time.process_time()
        model.shape()
        times.append(time.process_time() - begin)
    own = float(np.median(times))
    benchmark(model.shape)
    benchmark.extra_info.update(
        what=f"contact of a tip in a lumen, {count} segments, from rest, against SciPy's SLSQP in "
        "a plane with a third of the unknowns",
        measured=f"{1e3 * own:.1f} ms; SLSQP {1e3 * other:.1f} ms, {other / own:.1f} x",
        required="the same shape",
    )
