"""The thesis's chapter 4 as it is printed, for SciPy's solvers; mm, N, MPa."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

# Delta and delta_e of all rows of Tables 4.1 to 4.4 [mm], and F* of those that have one [N].
ROWS = np.array(
    [
        (7.6, 22.8, 1.69),
        (7.1, 21.2, 1.57),
        (6.9, 20.4, 1.51),
        (6.7, 19.7, 1.46),
        (6.6, 19.3, 1.43),
        (6.5, 18.9, 1.40),
        (6.4, 18.5, 1.37),
        (6.2, 17.9, 1.32),
        (5.7, 15.8, 1.17),
        (5.6, 15.2, 1.13),
    ]
)

# Pressure [MPa] and rows of F, Delta, delta_e, F* of Tables 4.1, 4.3 and 4.4.
TABLES = {
    0.6894: [(0.0, 7.6, 22.8, 1.69), (1.69, 6.9, 20.4, 1.51), (1.51, 6.9, 20.4, 1.51)],
    0.5516: [(0.0, 7.1, 21.2, 1.57), (1.57, 6.4, 18.5, 1.37), (1.37, 6.4, 18.5, 1.37)],
    0.4136: [
        (0.0, 6.2, 17.9, 1.32),
        (1.32, 5.6, 15.2, 1.13),
        (1.13, 5.7, 15.8, 1.17),
        (1.17, 5.7, 15.8, 1.17),
    ],
}


def solve_printed(
    offset: float, length: float, segments: int, contraction: float, *, objective: str = "squared"
) -> tuple[np.ndarray, np.ndarray]:
    """Backbone and muscle (n + 1, 2) by (4.1) to (4.4) with SLSQP, segment by segment.

    ``objective`` is ``"squared"`` or ``"norm"``, which is what is printed and has no derivative at
    its least value, zero.
    """
    rest, short = length / segments, (length - contraction) / segments
    backbone, muscle = [np.zeros(2)], [np.array([offset, 0.0])]
    ahead = np.array([0.0, 1.0])
    for i in range(segments):
        if i > 0:
            ahead = (backbone[-1] - backbone[-2]) / np.linalg.norm(backbone[-1] - backbone[-2])
        base, end = backbone[-1], muscle[-1]
        target_b, target_a = base + rest * ahead, end + short * ahead

        def miss(x, target_a=target_a):
            gap = x[2:] - target_a
            return gap @ gap if objective == "squared" else math.sqrt(gap @ gap)

        constraints = [
            {"type": "eq", "fun": lambda x, base=base: np.linalg.norm(x[:2] - base) - rest},
            {"type": "eq", "fun": lambda x, end=end: np.linalg.norm(x[2:] - end) - short},
            {"type": "eq", "fun": lambda x: np.linalg.norm(x[:2] - x[2:]) - offset},
        ]
        found = minimize(
            miss,
            np.concatenate([target_b, target_a]),
            method="SLSQP",
            constraints=constraints,
            options={"ftol": 1e-12 if objective == "squared" else 1e-6, "maxiter": 300},
        )
        backbone.append(found.x[:2])
        muscle.append(found.x[2:])
    return np.array(backbone), np.array(muscle)


def intersect_circles(
    offset: float, length: float, segments: int, contraction: float
) -> tuple[np.ndarray, np.ndarray]:
    """The same by plane geometry: the backbone's joint where two circles meet, uncrossed."""
    rest, short = length / segments, (length - contraction) / segments
    backbone, muscle = [np.zeros(2)], [np.array([offset, 0.0])]
    ahead = np.array([0.0, 1.0])
    for _ in range(segments):
        end = muscle[-1] + short * ahead
        gap = end - backbone[-1]
        apart = np.linalg.norm(gap)
        along = (apart**2 + rest**2 - offset**2) / (2.0 * apart)
        aside = math.sqrt(rest**2 - along**2)
        unit = gap / apart
        joint = backbone[-1] + along * unit + aside * np.array([-unit[1], unit[0]])
        ahead = (joint - backbone[-1]) / rest
        backbone.append(joint)
        muscle.append(end)
    return np.array(backbone), np.array(muscle)


def iterate_printed(
    contract: Callable[[float, float], float],
    deflect: Callable[[float], float],
    compliance: float,
    pressure: float,
    *,
    rounded: bool = False,
) -> list[tuple[float, float, float, float]]:
    """The thesis's iteration; ``rounded``: contractions to 0.1 mm, loads to 0.01 N, as printed."""
    rows, load = [], 0.0
    while not rows or (abs(rows[-1][3] - rows[-1][0]) > 1e-4 and len(rows) < 50):
        contraction = contract(pressure, load)
        if rounded:
            contraction = round(contraction, 1)
        lateral = deflect(contraction)
        needed = lateral / compliance
        if rounded:
            needed = round(needed, 2)
        rows.append((load, contraction, lateral, needed))
        load = needed
    return rows


def turn(points: np.ndarray, angle: float) -> np.ndarray:
    """Points (..., 3) turned about +z."""
    cos, sin = math.cos(angle), math.sin(angle)
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return points @ matrix.T


def turn_about(axis: np.ndarray, angle: float, vector: np.ndarray) -> np.ndarray:
    """Rodrigues's formula, the thesis's R(q, beta); the axis is made a unit vector."""
    size = np.linalg.norm(axis)
    if size == 0.0:
        return vector
    unit = axis / size
    return (
        vector * math.cos(angle)
        + np.cross(unit, vector) * math.sin(angle)
        + unit * (unit @ vector) * (1.0 - math.cos(angle))
    )


def combine_printed(first: np.ndarray, second: np.ndarray, resultant: np.ndarray) -> np.ndarray:
    """Steps 3 to 8 of section 4.4 on two backbones (n + 1, 3), with ``resultant`` (l_r, m_r)."""
    up = np.array([0.0, 0.0, 1.0])
    normal = np.array([resultant[1], -resultant[0], 0.0])
    piece = np.linalg.norm(first[1] - first[0])
    joints = [np.zeros(3)]
    for k in range(1, len(first)):
        base = k * piece * up
        tangent = (first[k] - first[k - 1]) / piece
        beta = math.acos(np.clip(tangent @ up, -1.0, 1.0))
        turned = turn_about(np.cross(up, tangent), beta, second[k] - base)
        share = -(normal @ (first[k] - base)) / (normal @ turned)
        joints.append(first[k] + share * turned)
    return np.array(joints)
