"""Measures of a motion: how far joints move and turn, and where the body comes closest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import Centreline

if TYPE_CHECKING:
    from .plan import Plan

__all__ = ["measure_angles", "measure_displacement", "measure_plan", "measure_step_ratio"]


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


def measure_step_ratio(joints: NDArray[np.float64], head_arc_length: NDArray[np.float64]) -> float:
    """Return the largest step of any joint over the head's, of the steps where it moves."""
    heads = np.abs(np.diff(head_arc_length))
    moving = heads > 1e-9
    if not moving.any():
        return 0.0
    moves = np.linalg.norm(np.diff(joints, axis=0), axis=2).max(axis=1)
    return float((moves[moving] / heads[moving]).max())


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
    near = int(np.argmin(np.linalg.norm(line.points - worst[:3], axis=1)))
    step = int(np.unravel_index(int(np.argmin(clearance)), clearance.shape)[0])
    angles = measure_angles(joints) if joints.shape[1] > 2 else np.zeros(1)
    return {
        "joint_step_max_mm": float(moves.max()) if len(moves) else 0.0,
        "joint_step_ratio_max": measure_step_ratio(joints, head_arc_length),
        "joint_angle_max_rad": float(angles.max()),
        "joint_travel_mm": float(moves.sum()),
        "clearance_min_mm": float(worst[3]),
        "clearance_where_mm": float(line.arc_length[near]),
        "clearance_insertion_mm": float(head_arc_length[step]),
    }


def measure_displacement(plan: Plan) -> dict[str, float]:
    """Compare how far the joints travel with two motions on the same head path.

    Returns
    -------
    dict
        ``tractrix``: total joint displacement over that of a free chain pulled along the path
        (thesis eq. 5.13), which no wall holds back; ``follow``: over that of a chain whose joints
        all stay on the path. 1 where nothing moves.

    Raises
    ------
    InputError
        If the plan's `meta` lacks the introducer or the scope.
    """
    from ._measure_kernels import total_travel, tractrix_travel
    from ._tube_kernels import move_in_tube
    from .introducer import Introducer

    introducer = Introducer.from_description(plan.meta["introducer"])
    length = float(plan.meta["scope"]["link_length_mm"])
    heads = plan.head_arc_length
    own = float(total_travel(np.ascontiguousarray(plan.joints)))
    if own == 0.0:
        return {"tractrix": 1.0, "follow": 1.0}
    dim = plan.path.shape[1]
    path = np.pad(plan.path, ((0, 0), (0, 3 - dim)))
    outward = np.pad(introducer.outward, (0, 3 - dim))
    back = np.arange(plan.links + 1) * length
    chain = path[0] + back[:, None] * outward
    lead = np.arange(back[-1] + 2.0 * length, 0.0, -1.0)
    points = np.concatenate([path[0] + lead[:, None] * outward, path])
    arc = np.concatenate([-lead, plan.path_arc_length])
    joints = np.empty((len(heads), plan.links + 1, 3))
    move_in_tube(
        points, arc, np.zeros(len(arc)), heads, length, 0.0, 0.0, 0.0, chain.copy(), -back, joints
    )
    follow = float(total_travel(joints))
    free = float(tractrix_travel(joints[:, 0].copy(), chain, length))
    return {"tractrix": own / free, "follow": own / follow}
