"""One constrained link in every representation of a duct, against SLSQP on the same duct.

In space twice: by the local step with the search of all directions only where it fails or turns
far, which is what a chain needs and what the bound is about; and with every link held against that
search, so that it is proved the nearest of all, which is what `bozzini.motion.place_tail` answers.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numba import njit

from bozzini.duct.base import Duct
from bozzini.duct.kernels.clearance import space_estimate
from bozzini.motion import FreeSpace
from bozzini.motion.kernels.chain import make_frame, place_tail, search_sphere
from bozzini.motion.link import bound_slope
from tests.motion.pipes import NAMES, make_pipes

LINK = 8.0
"""Link length [mm]."""
ROOM = 3.0
"""What the tail keeps from the wall [mm]."""
HEAD_STEP = 0.25
"""[mm]."""


@njit
def place_all(space, heads, olds, length, room, slope, planar, tails, codes):
    """Every link of a batch, by the march or the local step with its fallback."""
    work = np.empty((6, 5))
    for n in range(heads.shape[0]):
        codes[n], _ = place_tail(
            space, heads[n], olds[n], length, room, slope, planar, work, tails[n]
        )


@njit
def prove_all(space, heads, olds, length, room, slope, tails, turns, bounds):
    """Every link of a batch in space, each held against a search of all directions."""
    work = np.empty((6, 5))
    frame = np.empty((3, 3))
    spare = np.empty(2)
    for n in range(heads.shape[0]):
        place_tail(space, heads[n], olds[n], length, room, slope, False, work, tails[n])
        make_frame(heads[n], olds[n], False, frame)
        ahead = 0.0
        for k in range(3):
            ahead += frame[0, k] * (tails[n, k] - heads[n, k])
        turn = math.acos(min(max(ahead / length, -1.0), 1.0))
        _, turns[n], bounds[n], _ = search_sphere(
            space, heads[n], frame, length, room, slope, turn, 1e-3, 1e-4, 100_000, spare
        )


@dataclass(frozen=True)
class Links:
    """Links at the wall: moved heads and old tails (n, 3) in the duct's own frame."""

    heads: np.ndarray
    olds: np.ndarray


def draw_links(duct: Duct, count: int) -> Links:
    """Random heads with room, their tails placed from anywhere, the heads then moved one step."""
    random = np.random.default_rng(2)
    planar, slope, data = duct.dim == 2, bound_slope(duct), FreeSpace(duct).pack()
    work, tail, start = np.empty((6, 5)), np.empty(3), np.empty(3)
    heads: list[np.ndarray] = []
    olds: list[np.ndarray] = []
    given = (LINK, ROOM, slope, planar, work)
    while len(heads) < count:
        head = random.uniform(*duct.bounds)
        away, step = random.normal(size=(2, len(head)))
        if duct.signed_distance(head) > -ROOM:
            continue
        first = duct.to_grid(head)
        code, _ = place_tail(data, first, duct.to_grid(head + away), *given, start)
        if code == 3:
            continue
        moved = duct.to_grid(head + HEAD_STEP * step / np.linalg.norm(step))
        code, _ = place_tail(data, moved, start, *given, tail)
        if code in (1, 2):
            heads.append(moved)
            olds.append(start.copy())
    return Links(np.array(heads), np.array(olds))


def solve_slsqp(data: Any, head: np.ndarray, old: np.ndarray, *, planar: bool) -> np.ndarray:
    """Equation 5.15 by SciPy's SLSQP: its default options, on the same compiled duct."""
    from scipy.optimize import minimize

    size = 2 if planar else 3
    head, old, height = head[:size], old[:size], float(head[2])

    def objective(x: np.ndarray) -> float:
        away = x - old
        return np.sqrt(away @ away)

    def keep_length(x: np.ndarray) -> float:
        away = x - head
        return np.sqrt(away @ away) - LINK

    def keep_inside(x: np.ndarray) -> float:
        z = height if planar else x[2]
        return read_clearance(data, x[0], x[1], z) - ROOM

    constraints = [{"type": "eq", "fun": keep_length}, {"type": "ineq", "fun": keep_inside}]
    result = minimize(objective, old, constraints=constraints, method="SLSQP")
    answer = np.full(3, np.nan)
    if result.success:
        answer[:size] = result.x
        answer[size:] = height
    return answer


@njit
def read_clearance(space, x, y, z):
    return space_estimate(space, x, y, z)


@pytest.mark.parametrize("name", NAMES)
def bench_one_link(benchmark: Any, name: str) -> None:
    duct = make_pipes()[name]
    planar, slope, data = duct.dim == 2, bound_slope(duct), FreeSpace(duct).pack()
    links = draw_links(duct, 400)
    tails, codes = np.empty_like(links.heads), np.empty(len(links.heads), dtype=np.int64)
    given = (data, links.heads, links.olds, LINK, ROOM, slope)
    benchmark.pedantic(place_all, args=(*given, planar, tails, codes), rounds=9, warmup_rounds=1)
    ours = benchmark.stats.stats.min / len(tails)
    assert set(codes) <= {1, 2}
    took, answers, some = [], [], slice(0, None, 8)
    for head, old in zip(links.heads[some], links.olds[some], strict=True):
        best = math.inf
        for _ in range(3):
            begin = time.perf_counter()
            answer = solve_slsqp(data, head, old, planar=planar)
            best = min(best, time.perf_counter() - begin)
        answers.append(answer)
        took.append(best)
    theirs = float(np.median(took))
    compare_answers(data, links, tails, np.array(answers), some)
    how = "march both ways" if planar else "step, searched on need"
    measured = f"{how}: {theirs / ours:,.0f} times ({theirs * 1e3:.2f} ms over {ours * 1e6:.1f} µs)"
    if not planar:
        turns, bounds = np.empty(len(tails)), np.empty(len(tails))
        begin = time.perf_counter()
        prove_all(*given, tails, turns, bounds)
        begin = time.perf_counter()
        prove_all(*given, tails, turns, bounds)
        proved = (time.perf_counter() - begin) / len(tails)
        assert np.all(turns - bounds <= 1.001e-3)
        measured += f"; each proved the nearest of all: {theirs / proved:,.0f} times"
    least = 1000 if name == "sampled field" else 10
    benchmark.extra_info.update(
        what=f"one link at the wall, {name}: SLSQP's time over ours",
        measured=measured,
        required=f"at least {least:,} times" + ("" if planar else " (the step)"),
    )
    assert theirs / ours >= least


def compare_answers(
    data: Any, links: Links, tails: np.ndarray, answers: np.ndarray, some: slice
) -> None:
    """Where SLSQP finds a feasible answer, ours is as near or nearer."""
    heads, olds = links.heads[some], links.olds[some]
    found = np.isfinite(answers).all(axis=1)
    answers[~found] = heads[~found]
    clearance = np.array([read_clearance(data, *x) for x in answers])
    found &= ROOM - clearance <= 1e-5
    found &= np.abs(np.linalg.norm(answers - heads, axis=1) - LINK) <= 1e-5
    assert found.mean() >= 0.5
    gap = np.linalg.norm(tails[some] - olds, axis=1) - np.linalg.norm(answers - olds, axis=1)
    assert np.mean(gap[found] <= 1e-3) >= 0.95
