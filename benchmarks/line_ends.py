"""Ends of 60 made tubes and Ys at 6 voxels and 3 scales: the same each time, at the known places.

    python -m benchmarks.line_ends [COUNT]

A tube is a planar curve with a round section; a Y has a trunk and two branches, of which the longer
one ends the longest way. An end is right within a voxel's diagonal of the middle of the cap that
closes the lumen there; the exit code is 1 where one is off by more and by half a radius, too.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.spatial import cKDTree

from bozzini.duct import SampledField, find_centreline
from bozzini.errors import BozziniError
from bozzini.numeric.arrays import Floats
from bozzini.numeric.polylines import resample_polyline

COUNT = 60
VOXELS = (0.12, 0.15, 0.2, 0.25, 0.3, 0.35)
"""Shares of the radius."""

SCALES = (0.1, 1.0, 4.0)


def make_legs(seed: int) -> tuple[list[Floats], Floats]:
    """Return the middles of a tube's or a Y's legs for a radius of 1, and its ends (2, 3)."""
    random = np.random.default_rng(seed)
    turn = np.linspace(0.0, random.uniform(0.3, 3.0), 60)
    size = random.uniform(4.0, 8.0)
    arc = size * np.stack([np.sin(turn), 1.0 - np.cos(turn), np.zeros(60)], axis=1)
    if seed % 2 == 0:
        return [arc], arc[[0, -1]]
    trunk = np.array([[0.0, 0.0, 0.0], [random.uniform(8.0, 12.0), 0.0, 0.0]])
    angles = np.array([random.uniform(0.3, 0.6), -random.uniform(0.7, 1.2)])
    lengths = np.array([random.uniform(8.0, 10.0), random.uniform(5.0, 6.5)])
    ways = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles), np.zeros(2)], axis=1)
    legs = [trunk, *(np.stack([trunk[1], trunk[1] + way]) for way in ways)]
    return legs, np.stack([trunk[0], legs[1][1]])


def sample_legs(legs: list[Floats], voxel: float, scale: float, shift: Floats) -> SampledField:
    """Return the field of round legs of radius `scale` [mm]; nodes are shifted in their cells."""
    points = scale * np.concatenate([resample_polyline(leg, 0.05) for leg in legs])
    step = voxel * scale
    low = points.min(axis=0) - 1.4 * scale - shift * step
    counts = np.ceil((points.max(axis=0) + 1.4 * scale - low) / step).astype(int) + 1
    nodes = low + step * np.indices(counts).reshape(3, -1).T
    values = cKDTree(points).query(nodes)[0] - scale
    return SampledField(
        values=values.reshape(counts).astype(np.float32),
        spacing=np.full(3, step),
        origin=low,
        rotation=np.eye(3),
    )


FAR = 0.5
"""An end so many radii from its place, and more than a voxel's diagonal, is another end."""


def measure_miss(seed: int, voxel: float, scale: float) -> tuple[float, Floats]:
    """Return how far the ends found are off [diagonals of a voxel], and the ends in radii."""
    legs, ends = make_legs(seed)
    shift = np.random.default_rng(seed).uniform(size=3)
    line = find_centreline(sample_legs(legs, voxel, scale, shift)).points[[0, -1]] / scale
    misses = [float(np.linalg.norm(p - ends, axis=1).max()) for p in (line, line[::-1])]
    ordered = line if misses[0] <= misses[1] else line[::-1]
    return min(misses) / (np.sqrt(3.0) * voxel), ordered


def main(count: int) -> int:
    """Print how far ends are off, and return the exit code."""
    misses, spreads, wrong, beyond = [], [], 0, 0
    for seed in range(count):
        for scale in SCALES:
            found = []
            for voxel in VOXELS:
                try:
                    miss, line = measure_miss(seed, voxel, scale)
                except BozziniError as error:
                    print(f"shape {seed}, scale {scale:g}, voxel {voxel:g}: {error}")
                    wrong += 1
                    continue
                found.append(line)
                misses.append(miss)
                if miss > 1.0:
                    print(f"shape {seed}, scale {scale:g}, voxel {voxel:g}: off by {miss:.2f}")
                    beyond += 1
                    wrong += miss * np.sqrt(3.0) * voxel > FAR
            spreads.append(float(np.ptp(found, axis=0).max()))
    print(
        f"{len(misses)} lines of {count} shapes at {len(VOXELS)} voxels and {len(SCALES)} scales: "
        f"{wrong} with another end, {beyond} off by more than a diagonal; ends off by "
        f"{np.median(misses):.2f} diagonals of a voxel in the median, {max(misses):.2f} at most; "
        f"apart by {max(spreads):.2f} radii at most"
    )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else COUNT))
