"""Measures of a motion: how far joints move and turn, and where the body comes closest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .certify import find_waiting
from .link import move_free_chain
from .plan import FieldSummary, Measures, Plan
from .scope import Scope
from .space import FreeSpace, grid_of

CROSSING_SPAN = 1.75
"""A link that spans more of the centreline than so many times its length may cut a fold short."""

CROSSING_SAMPLES = 1_000_000
"""About so many points of the body are looked at."""


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A link that passes through the wall between two limbs of a tract.

    Attributes
    ----------
    near, far : float
        Arc length of the centreline at its two ends [mm].
    point : tuple of float
        Where it is outside the lumen at rest, world frame [mm].
    """

    near: float
    far: float
    point: tuple[float, float, float]


def find_crossing(
    joints: NDArray[np.float64], space: FreeSpace, *, radius: float
) -> Crossing | None:
    """Find a link that passes between two limbs which only the inflation has joined.

    A wall moved outwards by c opens what is thinner than 2 c between two limbs of a tract, and the
    clearance of the moved wall knows nothing of that. Such a link leaves the lumen at rest, spans
    much more of the centreline than its length, and its two ends are not joined by the lumen at
    rest beside it. Steps are looked at in samples.

    Parameters
    ----------
    joints : (steps, joints, 3) float
        World frame [mm].
    space : FreeSpace
        With the inflated lumen. What stands in the introducer is not looked at.
    radius : float
        Of the body [mm].

    Returns
    -------
    Crossing or None
        None where no link does, as always without inflation or a grid.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    field, line, introducer = grid_of(space.duct), space.centreline, space.tube
    if field is None or field.inflation <= 0.0:
        return None
    rest = field.inflate(-field.inflation)
    length = float(np.linalg.norm(joints[0, 1] - joints[0, 0]))
    count = max(3, int(np.ceil(length / (0.5 * float(rest.spacing.min())))) + 1)
    stride = max(1, -(-joints[..., 0].size * count // CROSSING_SAMPLES))
    rows = np.append(np.arange(0, len(joints) - 1, stride), len(joints) - 1)
    chains, waiting = joints[rows], find_waiting(joints, space, radius=radius)[rows]
    behind = np.arange(joints.shape[1]) >= waiting[:, None]
    arcs = line.arc_length[cKDTree(line.points).query(chains)[1]]
    arcs[behind] = 0.0
    spans = np.abs(np.diff(arcs, axis=1)) > CROSSING_SPAN * length + 2.0 * rest.error
    parts = np.linspace(0.0, 1.0, count)[:, None]
    for step, link in np.argwhere(spans & ~behind[:, :-1]):
        head, tail = chains[step, link], chains[step, link + 1]
        body = head + parts * (tail - head)
        depth = -rest.signed_distance(body)
        if behind[step, link + 1]:
            depth[((body - introducer.entry) @ introducer.outward) >= 0.0] = np.inf
        if depth.min() >= rest.error:
            continue
        ends = rest.to_grid(np.stack([head, tail])) / rest.spacing
        # Lumen that the link only leaves towards the inside of a bend is this near to it.
        margin = np.ceil((field.inflation + 2.0 * rest.error) / rest.spacing)
        low = np.maximum(np.floor(ends.min(axis=0) - margin), 0).astype(int)
        high = np.ceil(ends.max(axis=0) + margin).astype(int) + 1
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        # Between neighbouring nodes that are both deeper than this there is no wall.
        blocks, _ = ndimage.label(rest.values[box] < -rest.error, structure=np.ones((3, 3, 3)))
        free = np.argwhere(blocks > 0)
        if len(free) == 0:
            continue
        feet = free[cKDTree(free).query(ends - low)[1]]
        first, second = blocks[tuple(feet.T)]
        if first != second:
            x, y, z = (float(v) for v in body[int(np.argmin(depth))])
            one, other = sorted((float(arcs[step, link]), float(arcs[step, link + 1])))
            return Crossing(near=one, far=other, point=(x, y, z))
    return None


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


def measure_moves(
    joints: NDArray[np.float64], head_arc_length: NDArray[np.float64]
) -> dict[str, float]:
    """Return the measures of a motion (steps, joints, dim) that are about its moves, by name."""
    from .kernels.chain import measure_moves as measure

    largest, ratio, travel, angle = measure(
        np.ascontiguousarray(joints), np.ascontiguousarray(head_arc_length)
    )
    return {
        "joint_step_max": float(largest),
        "joint_step_ratio_max": float(ratio),
        "joint_angle_max": float(angle),
        "joint_travel": float(travel),
    }


def measure_body(
    space: FreeSpace, joints: NDArray[np.float64], scope: Scope
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Estimate the clearance of the whole body at every step, by samples along the links.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm].

    Returns
    -------
    clearance : (steps, joints - 1) float
        Scope surface to wall, the least over samples of each link [mm]; infinite for links wholly
        in the introducer, which is taken as wide as the scope where it is narrower.
    worst : (dim + 1,) float
        The place of the smallest clearance in the world frame, and its value [mm].
    """
    from .kernels.chain import measure_body as measure

    chains = np.ascontiguousarray(space.duct.to_grid(joints))
    clearance = np.empty((joints.shape[0], joints.shape[1] - 1))
    worst = np.zeros(4)
    packed = space.pack(bore=max(space.tube.bore, scope.radius))
    measure(packed, chains, scope.radius, space.pitch, clearance, worst)
    return clearance, np.append(space.duct.to_world(worst[:3]), worst[3])


def measure_motion(
    space: FreeSpace,
    joints: NDArray[np.float64],
    head_arc_length: NDArray[np.float64],
    scope: Scope,
) -> tuple[NDArray[np.float64], Measures]:
    """Return the clearances (steps, joints - 1) of a motion as `measure_body`, and its measures."""
    clearance, worst = measure_body(space, joints, scope)
    # Planar motions are measured in the kernels' frame too, which is 3-D and isometric.
    points, place = space.duct.to_grid(space.centreline.points), space.duct.to_grid(worst[:-1])
    near = int(np.argmin(np.linalg.norm(points - place, axis=1)))
    step = int(np.unravel_index(int(np.argmin(clearance)), clearance.shape)[0])
    return clearance, Measures(
        **measure_moves(joints, head_arc_length),
        clearance_min=float(worst[-1]),
        clearance_where=float(space.centreline.arc_length[near]),
        clearance_insertion=float(head_arc_length[step]),
    )


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
        If the plan lacks the introducer or the scope.
    """
    from .kernels.tractrix import move_in_tube

    introducer, length = plan.get_introducer(), plan.get_scope().link_length
    heads = plan.head_arc_length
    own = _measure_travel(plan.joints)
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
    free = move_free_chain(chain, joints[:, 0], scheme="least")
    return {"tractrix": own / _measure_travel(free), "follow": own / _measure_travel(joints)}


def _measure_travel(joints: NDArray[np.float64]) -> float:
    """Return how far all joints move in all steps [mm]."""
    return float(np.linalg.norm(np.diff(joints, axis=0), axis=2).sum())


def summarise_field(space: FreeSpace) -> FieldSummary:
    """Return what a plan states of the field that it was made in."""
    duct, grid = space.duct, grid_of(space.duct)
    return FieldSummary(
        kind=duct.kind,
        spacing=None if grid is None else tuple(float(h) for h in grid.spacing),
        nodes=None if grid is None else tuple(int(n) for n in grid.values.shape),
        inflation=duct.inflation,
        interpolation_error=duct.error,
        wall_error=duct.wall_error,
        sampling_error=0.5 * space.pitch,
        clearance_error=duct.error + 0.5 * space.pitch,
    )
