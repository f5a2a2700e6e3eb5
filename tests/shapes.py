"""Analytic lumens, sampled: what the tests of ducts and motion share."""

from __future__ import annotations

import numpy as np

from bozzini.duct import Centreline, SampledField
from bozzini.numeric.polylines import measure_arc_length


def sample_field(function, low, high, voxel, **options):
    """Sample ``function(points) -> signed distance`` on a grid over a box."""
    low = np.asarray(low, dtype=float)
    counts = np.ceil((np.asarray(high) - low) / voxel).astype(int) + 1
    axes = [low[k] + voxel * np.arange(counts[k]) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return SampledField(
        values=np.ascontiguousarray(function(points), dtype=np.float32),
        spacing=np.full(3, float(voxel)),
        origin=low,
        rotation=np.eye(3),
        **options,
    )


def ball_distance(centre, radius):
    return lambda points: np.linalg.norm(points - np.asarray(centre), axis=-1) - radius


def curve_distance(curve, radius):
    """Signed distance to the tube of `radius` (a number, or one per segment) around a polyline."""
    start, along = curve[:-1], np.diff(curve, axis=0)
    squares = np.einsum("sk,sk->s", along, along)
    radii = np.broadcast_to(np.asarray(radius, dtype=float), len(start))

    def measure(points, near):
        """Distances (segments, points) to the tubes of the segments `near`."""
        off = points.T[:, None] - start[near].T[..., None]
        ahead = along[near].T[..., None]
        t = np.clip(np.sum(off * ahead, axis=0) / squares[near, None], 0.0, 1.0)
        return np.sqrt(np.sum((off - t * ahead) ** 2, axis=0)) - radii[near, None]

    def fill(best, index, points, near):
        """Put the distances of points close together, to which few segments can be nearest."""
        low, high = points.min(axis=0), points.max(axis=0)
        gap = measure(0.5 * (low + high)[None], near)[:, 0]
        near = near[gap <= gap.min() + np.linalg.norm(high - low) + 1e-9]
        half = len(points) // 2
        if half < 200 or len(near) < 4:
            best[index] = measure(points, near).min(axis=0)
            return
        order = np.argpartition(points[:, np.argmax(high - low)], half)
        for part in (order[:half], order[half:]):
            fill(best, index[part], points[part], near)

    def distance(points):
        points = np.asarray(points, dtype=float)
        best = np.empty(points.shape[:-1])
        flat = points.reshape(-1, 3)
        fill(best.reshape(-1), np.arange(len(flat)), flat, np.arange(len(start)))
        return best

    return distance


def bend_curve(bend_radius, angle, limb, spacing=1.0):
    """A straight limb, an arc in the x-z plane, a straight limb: points (n, 3)."""
    straight = np.arange(-limb, 0.0, spacing)
    first = np.stack([np.zeros_like(straight), np.zeros_like(straight), straight], axis=1)
    turns = np.linspace(0.0, angle, max(3, round(bend_radius * angle / spacing)) + 1)
    arc = np.stack(
        [bend_radius * (1 - np.cos(turns)), 0 * turns, bend_radius * np.sin(turns)], axis=1
    )
    ahead = np.array([np.sin(angle), 0.0, np.cos(angle)])
    last = arc[-1] + np.arange(spacing, limb + spacing / 2, spacing)[:, None] * ahead
    return np.concatenate([first, arc, last])


def tube_lumen(curve, radius, voxel=1.0, **options):
    """The field of a tube around a curve, and the curve as its centreline."""
    low = curve.min(axis=0) - radius - 3.0
    high = curve.max(axis=0) + radius + 3.0
    field = sample_field(curve_distance(curve, radius), low, high, voxel, **options)
    line = Centreline(
        points=curve,
        arc_length=measure_arc_length(curve),
        radius=-field.signed_distance(curve),
    )
    return field, line
