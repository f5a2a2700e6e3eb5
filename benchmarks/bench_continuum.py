"""Continuum robots: the linkage in closed form against the printed optimisation by SLSQP."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bozzini.continuum import ArcModel, LinkageModel
from tests.continuum.reference import solve_chain
from tests.continuum.robots import make_robot

COUNT = 100_000
SEGMENTS = 20
LENGTH, SPACING = 100.0, 4.0
PULLED = (8.0, 6.0)


def draw_commands() -> np.ndarray:
    """Displacements of two rods 90 degrees apart [mm]: bends up to two right angles."""
    return np.random.default_rng(1).uniform(-8.0, 8.0, (COUNT, 2))


def time_printed() -> float:
    """Time of one shape by SLSQP, where every segment converges [s]: best of three."""
    base = np.array([[0.0, 0.0, 0.0], [SPACING, 0.0, 0.0], [0.0, SPACING, 0.0]])
    lengths = [(LENGTH - change) / SEGMENTS for change in PULLED]
    took = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        joints, converged = solve_chain(base, LENGTH / SEGMENTS, lengths, SEGMENTS)
        took = min(took, time.perf_counter() - begin)
    assert converged == SEGMENTS
    # It is the same problem: the answers agree.
    model = LinkageModel(make_robot((0.0, 90.0), pushes=True), segments=SEGMENTS)
    assert np.abs(model.points(PULLED) - joints).max() < 0.05
    return took


def bench_linkage_points(benchmark: Any) -> None:
    model = LinkageModel(make_robot((0.0, 90.0), pushes=True), segments=SEGMENTS)
    commands = draw_commands()
    points = benchmark.pedantic(model.points, args=(commands,), rounds=10, warmup_rounds=1)
    assert points.shape == (COUNT, SEGMENTS + 1, 3)
    ours = benchmark.stats.stats.min / COUNT
    theirs = time_printed()
    benchmark.extra_info.update(
        what=f"backbone of {SEGMENTS} linkages from displacements, in a batch on one core, checks "
        "included; SciPy's SLSQP on (5.9)-(5.10)",
        measured=f"{ours * 1e6:.2f} us each; {theirs / ours:,.0f} times ({theirs:.2f} s)",
        required="under 1 us each, and at least 100,000 times",
        ratio=theirs / ours,
    )
    assert ours < 1e-6
    assert theirs / ours >= 1e5


def bench_linkage_shapes(benchmark: Any) -> None:
    model = LinkageModel(make_robot((0.0, 90.0), pushes=True), segments=SEGMENTS)
    benchmark.pedantic(model.shape, args=(draw_commands(),), rounds=5, warmup_rounds=1)
    each = benchmark.stats.stats.min / COUNT
    benchmark.extra_info.update(
        what=f"whole shape of {SEGMENTS} linkages: frames, tendon lengths, slack, reasons",
        measured=f"{each * 1e6:.2f} us each",
    )


def bench_arc_shapes(benchmark: Any) -> None:
    """Two sections of three cables, 10 discs each."""
    thirds = (0.0, 120.0, 240.0)
    model = ArcModel(make_robot(thirds, thirds), between=0)
    bends = np.random.default_rng(2).normal(size=(COUNT, 4))
    commands = bends @ model.coupling.matrix.T
    shape = benchmark.pedantic(model.shape, args=(commands,), rounds=5, warmup_rounds=1)
    assert shape.converged.all()
    each = benchmark.stats.stats.min / COUNT
    benchmark.extra_info.update(
        what="whole shape of two sections of constant curvature, 21 frames",
        measured=f"{each * 1e6:.2f} us each",
    )


def bench_one_shape(benchmark: Any) -> None:
    """One command in, one shape out: what a loop in Python pays."""
    thirds = (0.0, 120.0, 240.0)
    model = ArcModel(make_robot(thirds, thirds))
    benchmark(model.shape, [2.0, -1.0, -1.0, 1.0, -0.5, -0.5])
    benchmark.extra_info.update(
        what="one shape of two sections of constant curvature, through the checks",
        measured=f"{benchmark.stats.stats.median * 1e6:.0f} us",
    )
