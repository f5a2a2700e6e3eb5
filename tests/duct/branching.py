"""Random trees of tapering tubes whose branches, ends and radii are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bozzini.duct import SampledField, field_from_mask
from bozzini.numeric.arrays import Floats


@dataclass(frozen=True)
class KnownTree:
    """Straight tubes with round ends: tube k from `start[k]` to `end[k]`, as wide all along."""

    start: Floats
    end: Floats
    radius: Floats
    parent: tuple[int, ...]

    @property
    def ends(self) -> list[int]:
        """The tubes that nothing leaves."""
        return [k for k in range(len(self.parent)) if k not in self.parent]

    def measure(self, points: Floats, tubes: list[int] | None = None) -> Floats:
        """Signed distance (n,) to the wall of all tubes, or of some."""
        return np.min(
            [
                _measure(points, self.start[k], self.end[k]) - self.radius[k]
                for k in (range(len(self.radius)) if tubes is None else tubes)
            ],
            axis=0,
        )

    def rasterise(self, voxel: float, offset: float = 0.0) -> SampledField:
        """Return the field of the voxels whose middle is inside."""
        return field_from_mask(*self.label(voxel, offset))

    def label(self, voxel: float, offset: float = 0.0) -> tuple[NDArray[np.bool_], Floats]:
        """Return the voxels whose middle is inside, and their affine."""
        corners = np.concatenate([self.start, self.end])
        low = corners.min(axis=0) - self.radius.max() - 2.0 * voxel + offset
        count = np.ceil((np.ptp(corners, axis=0) + 2.0 * self.radius.max()) / voxel).astype(int) + 5
        mask = np.zeros(count, dtype=bool)
        for k in range(len(self.radius)):  # each in its own box
            ends = np.stack([self.start[k], self.end[k]])
            first = np.floor((ends.min(axis=0) - self.radius[k] - low) / voxel).astype(int)
            last = np.ceil((ends.max(axis=0) + self.radius[k] - low) / voxel).astype(int) + 1
            box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
            places = np.stack(np.mgrid[box], axis=-1) * voxel + low
            mask[box] |= _measure(places, self.start[k], self.end[k]) <= self.radius[k]
        affine = np.diag([voxel, voxel, voxel, 1.0])
        affine[:3, 3] = low
        return mask, affine


def _measure(points: Floats, one: Floats, two: Floats) -> Floats:
    way = two - one
    share = np.clip((points - one) @ way / (way @ way), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - one - share[..., None] * way, axis=-1))


def grow(seed: int, splits: int = 6, *, radius: float = 5.0) -> KnownTree:
    """Return a random tree of `splits` branchings into two; tubes touch only where they meet."""
    random = np.random.default_rng(seed)
    start, end = [np.zeros(3)], [np.array([0.0, 0.0, -5.0 * radius])]
    radii, parent = [radius], [-1]
    waiting = [0]
    for _ in range(200 * splits):
        if len(parent) >= 2 * splits + 1:
            break
        one = waiting[0]
        way = end[one] - start[one]
        way /= np.linalg.norm(way)
        side = np.cross(way, random.normal(size=3))
        side /= np.linalg.norm(side)
        new = []
        for sign in (1.0, -1.0):
            lean = random.uniform(0.5, 0.9)
            size = radii[one] * random.uniform(0.65, 0.8)
            long = size * random.uniform(6.0, 9.0) + radii[one]
            new.append((end[one] + long * (np.cos(lean) * way + sign * np.sin(lean) * side), size))
        tree = KnownTree(np.array(start), np.array(end), np.array(radii), tuple(parent))
        away = [k for k in range(len(parent)) if k != one]
        if away and any(_crosses(tree, away, end[one], tip, size) for tip, size in new):
            waiting.append(waiting.pop(0))
            continue
        waiting.pop(0)
        for tip, size in new:
            waiting.append(len(parent))
            start.append(end[one])
            end.append(tip)
            radii.append(size)
            parent.append(one)
    return KnownTree(np.array(start), np.array(end), np.array(radii), tuple(parent))


def _crosses(tree: KnownTree, others: list[int], one: Floats, two: Floats, size: float) -> bool:
    share = np.linspace(0.25, 1.0, 30)[:, None]
    return bool(
        (tree.measure(one + share * (two - one), others) < size + 0.5 * tree.radius[0]).any()
    )
