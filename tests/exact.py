"""Exact distances and body samples, by routes that share nothing with the package's own."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree


class VoxelWall:
    """Distance from points to the closed boxes of the voxels that are not lumen."""

    def __init__(self, mask, affine):
        mask = np.pad(np.asarray(mask, dtype=bool), 1)
        matrix = np.asarray(affine, dtype=float)
        self.scale = np.linalg.norm(matrix[:3, :3], axis=0)
        self.turn = matrix[:3, :3] / self.scale
        self.origin = matrix[:3, 3] - matrix[:3, :3] @ np.ones(3)
        rim = np.zeros_like(mask)
        for axis in range(3):
            for side in (1, -1):
                rim |= np.roll(mask, side, axis=axis)
        self.boxes = np.argwhere(rim & ~mask) * self.scale
        self.mask = mask
        self.tree = cKDTree(self.boxes)

    def clearance(self, points):
        """Return (n,) distances; 0 for points in the wall or outside the volume."""
        local = (np.asarray(points) - self.origin) @ self.turn
        node = np.rint(local / self.scale).astype(int)
        inside = np.all((node >= 0) & (node < self.mask.shape), axis=1)
        inside[inside] = self.mask[tuple(node[inside].T)]
        result = np.zeros(len(local))
        local = local[inside]
        best = np.full(len(local), np.inf)
        todo = np.arange(len(local))
        half = 0.5 * np.linalg.norm(self.scale)
        count = 16
        while len(todo):
            k = min(count, len(self.boxes))
            far, index = self.tree.query(local[todo], k=k)
            far, index = far.reshape(len(todo), k), index.reshape(len(todo), k)
            gaps = np.abs(local[todo][:, None] - self.boxes[index]) - 0.5 * self.scale
            best[todo] = np.linalg.norm(np.maximum(gaps, 0.0), axis=2).min(axis=1)
            if k == len(self.boxes):
                break
            todo = todo[far[:, -1] - half < best[todo]]
            count *= 4
        result[inside] = best
        return result


class MeshWall:
    """Distance from points to the triangles of a closed mesh; negative outside."""

    def __init__(self, vertices, faces):
        import igl

        self.igl = igl
        self.vertices = np.ascontiguousarray(vertices, dtype=float)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self.boxes = igl.AABB()
        self.boxes.init(self.vertices, self.faces)

    def clearance(self, points):
        points = np.asarray(points, dtype=float)
        order = np.lexsort(np.floor(points).T)  # neighbours are the faster one after the other
        points = np.ascontiguousarray(points[order])
        squared = self.boxes.squared_distance(self.vertices, self.faces, points)[0]
        winding = self.igl.fast_winding_number(self.vertices, self.faces, points)
        found = np.empty(len(points))
        found[order] = np.where(winding > 0.5, 1.0, -1.0) * np.sqrt(squared)
        return found


def sample_body(joints, count, random, *, steps=None, links=None):
    """Return (count, 3) points of the body at random times, and (time, link, fraction)."""
    last = joints.shape[0] - 1
    time = random.uniform(0.0, last, count) if steps is None else random.uniform(*steps, count)
    link = random.integers(1, joints.shape[1], count)
    if links is not None:
        link = random.integers(links[0], links[1] + 1, count)
    share = random.uniform(0.0, 1.0, count)
    return body_points(joints, time, link, share), time, link, share


def body_points(joints, time, link, share):
    """Points at a fraction from joint `link` to joint `link - 1`, at fractional steps."""
    before = np.minimum(time.astype(int), joints.shape[0] - 1)
    after = np.minimum(before + 1, joints.shape[0] - 1)
    part = (time - before)[:, None]
    ends = []
    for joint in (link, link - 1):
        ends.append(joints[before, joint] * (1.0 - part) + joints[after, joint] * part)
    return ends[0] + share[:, None] * (ends[1] - ends[0])


def outside_introducer(points, introducer, radius):
    """Mark (n,) the points that are not, with the body around them, in the introducer's bore."""
    away = points - introducer.entry
    along = away @ introducer.outward
    off = np.linalg.norm(away - along[:, None] * introducer.outward, axis=1)
    return (along < 0.0) | (off > introducer.bore - radius + 1e-9)


def voxelise(curve, radius, *, voxel=1.0, pad=3.0):
    """A tube of `radius` (a number, or one per point) around a curve, as (mask, affine)."""
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    fine = np.arange(0.0, steps[-1], 0.2)
    dense = np.stack([np.interp(fine, steps, column) for column in curve.T], axis=1)
    radii = np.interp(fine, steps, np.broadcast_to(np.asarray(radius, float), len(curve)))
    low = dense.min(axis=0) - radii.max() - pad
    counts = np.ceil((dense.max(axis=0) + radii.max() + pad - low) / voxel).astype(int)
    centres = low + voxel * np.indices(counts).reshape(3, -1).T
    far, index = cKDTree(dense).query(centres, distance_upper_bound=radii.max())
    near = np.isfinite(far)
    mask = np.zeros(len(centres), dtype=bool)
    mask[near] = far[near] < radii[index[near]]
    affine = np.diag([voxel, voxel, voxel, 1.0])
    affine[:3, 3] = low
    return mask.reshape(counts), affine
