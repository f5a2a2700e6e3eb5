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
    start, stop = curve[:-1], curve[1:]
    radii = np.broadcast_to(np.asarray(radius, dtype=float), len(start))

    def distance(points):
        points = np.asarray(points)
        best = np.full(points.shape[:-1], np.inf)
        for a, b, r in zip(start, stop, radii, strict=True):
            along = b - a
            t = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
            gap = np.linalg.norm(points - a - t[..., None] * along, axis=-1)
            best = np.minimum(best, gap - r)
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
