"""Random tubes with a passage planted in them, or pinched below the scope."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from bozzini.duct import field_from_mask, find_centreline
from bozzini.motion import Scope
from tests.exact import VoxelWall, voxelise

SPARE = 0.4
"""Room that the planted passage has beyond the radius [mm]."""

GRID = 0.5
"""Distance between the field's nodes; on coarser ones `SPARE` drowns in the bound's looseness."""


@dataclass(frozen=True)
class PlantedTube:
    """A voxel lumen around a random curve, and a scope for it."""

    field: object
    line: object
    wall: object
    curve: np.ndarray
    scope: Scope
    pinch: np.ndarray | None


def random_curve(random, length, bend):
    """A curve (n, 3) with 0.5 mm steps, straight for the first and last 15 mm."""
    step, straight = 0.5, 15.0
    count = int(length / step)
    knots = random.normal(size=(2, 3 + int(length / 18.0)))
    at = np.linspace(0.0, count - 1, knots.shape[1])
    bends = np.stack([np.interp(np.arange(count), at, row) for row in knots])
    size = np.linalg.norm(bends, axis=0)
    bends *= np.minimum(1.0, 1.0 / np.maximum(size, 1e-9)) / bend
    still = int(straight / step)
    bends[:, :still] = 0.0
    bends[:, -still:] = 0.0
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points = [np.zeros(3)]
    for k in range(count):
        points.append(points[-1] + step * frame[0])
        frame[0] += step * (bends[0, k] * frame[1] + bends[1, k] * frame[2])
        frame = np.linalg.qr(frame.T)[0].T * np.sign(np.diag(np.linalg.qr(frame.T)[1]))[:, None]
    return np.array(points)


def find_chords(curve, length):
    """Chords (n, 2, 3) from each point to the first point behind it at `length`."""
    chords = []
    for head in range(len(curve)):
        behind = np.flatnonzero(np.linalg.norm(curve[:head] - curve[head], axis=1) >= length)
        if len(behind):
            chords.append((curve[head], curve[behind[-1]]))
    return np.array(chords)


@cache
def plant(seed, *, pinched=False, spare=SPARE, grid=GRID):
    """Make a tube whose curve carries the scope with `spare` to spare, or a pinched one."""
    random = np.random.default_rng(seed)
    radius = random.uniform(1.5, 4.0)
    link = random.uniform(5.0, 14.0)
    while True:
        bend = random.uniform(max(9.0, 0.7 * link), 40.0)
        curve = random_curve(random, random.uniform(90.0, 170.0), bend)
        chords = find_chords(curve, link)
        u = np.linspace(0.0, 1.0, 12)[:, None, None]
        on_chords = (chords[:, 0] + u * (chords[:, 1] - chords[:, 0])).reshape(-1, 3)
        sag = float(cKDTree(curve).query(on_chords)[0].max())
        wobble = np.interp(
            np.arange(len(curve)),
            np.linspace(0, len(curve), 12),
            random.uniform(0.0, 3.0, 12),
        )
        widths = radius + spare + sag + wobble
        tree = cKDTree(curve)
        pairs = tree.query_pairs(2.0 * widths.max() + 2.0, output_type="ndarray")
        far = 0.5 * np.abs(pairs[:, 0] - pairs[:, 1]) > np.pi * widths.max()
        if not far.any():
            break
    pinch = None
    if pinched:
        at = random.uniform(0.3, 0.7) * len(curve)
        depth = (radius - 0.85) / widths
        along = (np.arange(len(curve)) - at) / random.uniform(8.0, 16.0)
        widths = widths * (1.0 - (1.0 - depth) * np.exp(-(along**2)))
        pinch = curve[int(at)]
    while True:
        mask, affine = voxelise(curve, widths)
        wall = VoxelWall(mask, affine)
        entry = int(2.0 * widths.max())
        inner = curve[entry:-entry]
        if pinched:
            break
        chords = find_chords(inner, link)
        on_chords = (chords[:, 0] + u * (chords[:, 1] - chords[:, 0])).reshape(-1, 3)
        lack = radius + spare - wall.clearance(on_chords).min()
        if lack <= 0.0:
            break
        widths = widths + max(lack, 0.05)
    field = field_from_mask(mask, affine, voxel=grid)
    line = find_centreline(field, (inner[0], inner[-1]))
    return PlantedTube(
        field=field,
        line=line,
        wall=wall,
        curve=inner,
        scope=Scope(diameter=2.0 * radius, link_length=link),
        pinch=pinch,
    )
