"""Measures of a motion: how far joints move and turn, and where the body comes closest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import Centreline

__all__ = ["measure_angles", "measure_plan"]


def measure_angles(joints: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (..., joints - 2) angles between neighbouring links (..., joints, dim) [rad]."""
    links = np.diff(joints, axis=-2)
    links = links / np.linalg.norm(links, axis=-1, keepdims=True)
    first, second = links[..., :-1, :], links[..., 1:, :]
    # Of unit vectors: keeps full accuracy near 0 and pi.
    return np.asarray(
        2.0
        * np.arctan2(
            np.linalg.norm(first - second, axis=-1), np.linalg.norm(first + second, axis=-1)
        )
    )


def measure_plan(
    joints: NDArray[np.float64],
    head_arc_length: NDArray[np.float64],
    clearance: NDArray[np.float64],
    *,
    line: Centreline,
    worst: NDArray[np.float64],
) -> dict[str, float]:
    """Measure a motion.

    Returns
    -------
    dict
        ``joint_step_max_mm``, ``joint_step_ratio_max`` (joint move over head move),
        ``joint_angle_max_rad``, ``joint_travel_mm`` (sum over joints and steps),
        ``clearance_min_mm``, ``clearance_where_mm`` (arc length along the path of the place of
        the smallest clearance) and ``clearance_insertion_mm`` (the head's arc length then).
    """
    moves = np.linalg.norm(np.diff(joints, axis=0), axis=2)
    heads = np.diff(head_arc_length)
    moving = heads > 1e-9
    ratio = moves[moving].max(axis=1) / heads[moving] if moving.any() else np.zeros(1)
    near = int(np.argmin(np.linalg.norm(line.points - worst[:3], axis=1)))
    step = int(np.unravel_index(int(np.argmin(clearance)), clearance.shape)[0])
    angles = measure_angles(joints) if joints.shape[1] > 2 else np.zeros(1)
    return {
        "joint_step_max_mm": float(moves.max()) if len(moves) else 0.0,
        "joint_step_ratio_max": float(ratio.max()),
        "joint_angle_max_rad": float(angles.max()),
        "joint_travel_mm": float(moves.sum()),
        "clearance_min_mm": float(worst[3]),
        "clearance_where_mm": float(line.arc_length[near]),
        "clearance_insertion_mm": float(head_arc_length[step]),
    }
