"""Inverse of robots of 1 to 6 sections: time of each target, share that is solved, and the nearest.

Targets are tips of random legal shapes, so all can be reached; the solver starts without a hint.
A target out of reach costs all its starts, and its own line.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

from bozzini.continuum import ContinuumRobot, Section, Tendon
from bozzini.continuum.arc import arc_frames
from bozzini.continuum.inverse import ContinuumInverse, solve_pose, solve_tip
from bozzini.continuum.workspace import sample_workspace

COUNT = 1000


def make_robot(sections: int, travel: float = math.inf) -> ContinuumRobot:
    """Sections of 30 mm that bend up to 180 deg, with three tendons each."""
    return ContinuumRobot(
        tuple(
            Section(
                length=30.0,
                radius=2.5,
                max_bend=math.pi,
                tendons=tuple(
                    Tendon(
                        name=f"s{i}t{j}",
                        offset=2.0,
                        angle=2.0 * math.pi * (j / 3 + i / 3 / sections),
                        travel=(-travel, travel),
                    )
                    for j in range(3)
                ),
            )
            for i in range(sections)
        )
    )


def solve(robot: ContinuumRobot, kind: str, frame: np.ndarray) -> ContinuumInverse:
    if kind == "pose":
        return solve_pose(robot, frame)
    return solve_tip(robot, frame[:3, 3], direction=frame[:3, 2] if kind == "direction" else None)


def time_all(
    robot: ContinuumRobot, kind: str, frames: np.ndarray
) -> tuple[np.ndarray, list[ContinuumInverse]]:
    solve(robot, kind, frames[0])
    took, results = [], []
    for frame in frames:
        begin = time.perf_counter()
        results.append(solve(robot, kind, frame))
        took.append(time.perf_counter() - begin)
    return np.array(took), results


@pytest.mark.parametrize("kind", ["place", "direction", "pose"])
@pytest.mark.parametrize("sections", [1, 2, 3, 4, 5, 6])
def bench_inverse(benchmark: Any, sections: int, kind: str) -> None:
    robot = make_robot(sections)
    frames = sample_workspace(robot, COUNT, seed=sections).tip_frames
    took, results = time_all(robot, kind, frames)
    benchmark.pedantic(solve, args=(robot, kind, frames[0]), rounds=5)
    solved = np.mean([result.converged for result in results])
    late = np.percentile(took, 99)
    steps = np.mean([result.iterations for result in results])
    benchmark.extra_info.update(
        what=f"inverse to a {kind}, {sections} section(s), {COUNT} reachable targets",
        measured=f"{100 * solved:.1f} % solved, median {1e3 * np.median(took):.2f} ms, "
        f"99 % within {1e3 * late:.2f} ms, {steps:.1f} steps",
        required="99 % solved within 1e-6 mm; 6 sections: 99 % within 5 ms",
    )
    assert solved >= 0.99
    assert all(result.reason for result in results if not result.converged)
    assert late < 5e-3


def bench_inverse_inside_travel(benchmark: Any) -> None:
    robot = make_robot(6, travel=6.0)
    frames = sample_workspace(robot, COUNT).tip_frames
    took, results = time_all(robot, "direction", frames)
    benchmark.pedantic(solve, args=(robot, "direction", frames[0]), rounds=5)
    solved = np.mean([result.converged for result in results])
    benchmark.extra_info.update(
        what=f"inverse to a direction, 6 sections, travel of 6 mm, {COUNT} reachable targets",
        measured=f"{100 * solved:.1f} % solved, median {1e3 * np.median(took):.2f} ms, "
        f"99 % within {1e3 * np.percentile(took, 99):.2f} ms",
    )
    assert solved >= 0.99


def bench_inverse_out_of_reach(benchmark: Any) -> None:
    robot = make_robot(6, travel=6.0)
    random = np.random.default_rng(1)
    places = random.normal(size=(200, 3))
    places *= 1.2 * robot.length / np.linalg.norm(places, axis=1, keepdims=True)
    frames = arc_frames(robot, np.zeros((200, 6, 2)), arc_length=[robot.length])[:, 0].copy()
    frames[:, :3, 3] = places
    took, results = time_all(robot, "place", frames)
    benchmark.pedantic(solve, args=(robot, "place", frames[0]), rounds=3)
    benchmark.extra_info.update(
        what="inverse to a place out of reach, 6 sections, 16 starts",
        measured=f"median {1e3 * np.median(took):.1f} ms, "
        f"99 % within {1e3 * np.percentile(took, 99):.1f} ms",
    )
    assert not any(result.converged for result in results)
    assert all(result.settled and "out of reach" in result.reason for result in results)


def bench_workspace_sample(benchmark: Any) -> None:
    robot = make_robot(3)
    sample_workspace(robot, 10)
    benchmark.pedantic(sample_workspace, args=(robot, 100_000), rounds=3)
    benchmark.extra_info.update(
        what="workspace sample of 100,000 shapes, 3 sections, frames and Jacobians",
        measured=f"{benchmark.stats.stats.min:.2f} s",
    )
