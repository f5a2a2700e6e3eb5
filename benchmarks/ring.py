"""A closed ring of tube with an analytic wall, in which a chain can be as long as one likes.

The thesis's scheme knows no contact of the scope with itself, so the head may go round and round.
A pulled chain slides to the inner wall: in a steady ring nearly every link is constrained, which
is the dear case.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bozzini.duct import SampledField
from bozzini.motion import FreeSpace
from bozzini.motion.kernels.chain import advance_chain
from tests.shapes import sample_field

RING = 30.0
"""Radius of the ring's middle line [mm]."""
LUMEN = 6.0
"""Radius of the lumen [mm]."""
ROOM = 2.5
"""Radius of the scope: what joints keep from the wall [mm]."""
LINK = 8.0
"""Link length [mm]."""
HEAD_STEP = 0.25
"""[mm]."""

SLOPE = 3**0.5
"""How fast the interpolant changes per mm at most."""


def ring_distance(points: np.ndarray) -> np.ndarray:
    """Exact signed distance to the wall of the ring."""
    out = np.hypot(points[..., 0], points[..., 1]) - RING
    return np.hypot(out, points[..., 2]) - LUMEN


def make_ring() -> SampledField:
    box = np.array([RING + LUMEN + 3.0] * 2 + [LUMEN + 3.0])
    return sample_field(ring_distance, -box, box, 1.0)


def ring_points(angle: np.ndarray) -> np.ndarray:
    return RING * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)


@dataclass(frozen=True)
class Motion:
    """One run of the chain kernel: it returns its code, and how many steps it made."""

    code: int
    steps: int
    joints: np.ndarray


def advance(field: SampledField, chain: np.ndarray, angle: float, steps: int) -> Motion:
    """Move a chain (joints, 3) whose head is at `angle` on by `steps` head steps."""
    travel = steps * HEAD_STEP
    count = max(3, math.ceil(travel) + 1)
    path = np.ascontiguousarray(
        field.to_grid(ring_points(np.linspace(angle, angle + travel / RING, count)))
    )
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    out = np.empty((steps + 2, len(chain), 3))
    code, rows = advance_chain(
        FreeSpace(field).pack(),
        path,
        arc,
        LINK,
        ROOM,
        SLOPE,
        False,
        HEAD_STEP,
        4.0 * HEAD_STEP,
        field.to_grid(chain),
        np.zeros(4),
        out,
        np.empty(len(out)),
    )
    return Motion(int(code), int(rows), field.to_world(out[:rows]))


def settle(field: SampledField, links: int) -> tuple[np.ndarray, float]:
    """A chain that has been pulled until it slides along the inner wall, and its head's angle."""
    turn = 2.0 * math.asin(0.5 * LINK / RING)
    chain = ring_points(-turn * np.arange(links + 1))
    # Joints reach the wall about one after the other: let the head go two turns, and a length.
    steps = int(4.0 * math.pi * RING / HEAD_STEP)
    motion = advance(field, chain, 0.0, steps)
    if motion.code != 0:
        raise RuntimeError(f"the chain stopped with code {motion.code}")
    return motion.joints[-1], steps * HEAD_STEP / RING


def constrained_share(field: SampledField, joints: np.ndarray) -> float:
    """Share of followers that lie at the wall."""
    value = field.signed_distance(joints[..., 1:, :]) + ROOM
    return float(np.mean(np.abs(value) < 1e-6))


def draw_links(field: SampledField, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Moved heads and old tails (count, 3) of random links at the wall, in the grid's frame."""
    from bozzini.motion.kernels.chain import place_tail

    random = np.random.default_rng(2)
    heads: list[np.ndarray] = []
    olds: list[np.ndarray] = []
    work, tail, start = np.empty((6, 5)), np.empty(3), np.empty(3)
    space = FreeSpace(field).pack()
    while len(heads) < count:
        turn = random.uniform(0.0, 2.0 * np.pi)
        radial, height = random.uniform(-LUMEN + ROOM, LUMEN - ROOM, size=2)
        head = ring_points(np.asarray(turn)) * (1.0 + radial / RING) + [0.0, 0.0, height]
        old = head + random.normal(size=3)
        if field.signed_distance(head) + ROOM > 0.0:
            continue
        head_g, old_g = field.to_grid(head), field.to_grid(old)
        code, _ = place_tail(space, head_g, old_g, LINK, ROOM, SLOPE, False, work, start)
        if code == 3:
            continue
        step = random.normal(size=3)
        moved = head_g + HEAD_STEP * step / np.linalg.norm(step)
        code, _ = place_tail(space, moved, start, LINK, ROOM, SLOPE, False, work, tail)
        if code == 1:
            heads.append(moved)
            olds.append(start.copy())
    return np.array(heads), np.array(olds)
