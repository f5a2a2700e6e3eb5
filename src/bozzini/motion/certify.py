"""The certificate: a proved lower bound on the clearance of the whole body, at all times.

It knows nothing of how a motion was planned: it takes joints, a free space and a radius. Proof:
the distance to a wall changes no faster than a point moves, so one value bounds a whole cell of
body points and times around it; cells that do not decide are split (branch and bound). In a
sampled field the value itself is a rigorous bound (see `duct.kernels.clearance`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, quantity
from ..duct.base import Duct
from ..errors import InputError
from ..results import Shown
from .space import FreeSpace

TOLERANCE_MM = 0.1
"""How far the bound may stay below the smallest value found."""

FINEST_MM = 0.02
"""How far the tolerance is lowered at most, to settle whether a motion is certified."""

ROUND_OFF_MM = 1e-6
"""How far a bore may lie above what the entry offers."""

BUDGET = 100_000_000
"""Evaluations of the field at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate(Shown):
    """What is proved about a motion.

    Parameters
    ----------
    clearance : float
        No point of the scope's surface ever comes nearer to the wall than this [mm], joints
        moving straight between recorded steps; negative: nothing is proved. Infinite if the
        scope never leaves the introducer.
    found : float
        The smallest lower bound met at a point [mm]: the clearance lies between, up to the
        looseness of the field's bound there.
    step, link : float, int
        When (fraction of a recorded step) and on which link that was; link j joins joints j-1, j.
    place : (dim,) float
        Where, world frame [mm].
    resolved : bool
        Whether the search ended within its tolerance; else `clearance` is valid but loose.
    evaluations : int
        How often the field was asked.
    wall : str
        The wall that the bound is for.
    """

    clearance: float = quantity("length", default=math.inf)
    found: float = quantity("length", default=math.inf)
    step: float = 0.0
    link: int = 0
    place: NDArray[np.float64] = field(
        default_factory=lambda: np.zeros(3), metadata={"key": "place_mm"}
    )
    resolved: bool = True
    evaluations: int = 0
    wall: str = ""

    @property
    def certified(self) -> bool:
        """Whether it is proved that the body, as far as it enters the duct, keeps off the wall."""
        return 0.0 <= self.clearance < np.inf


def certify_motion(
    joints: ArrayLike,
    space: FreeSpace | Duct,
    *,
    radius: float,
    tolerance: float = TOLERANCE_MM,
    budget: int = BUDGET,
    settle: bool = True,
) -> Certificate:
    """Prove a lower bound on the clearance of a moving chain.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm]; between steps joints move along straight lines.
    space : FreeSpace or Duct
        The free space, with a rigorous clearance bound. Links in its introducer, from the tail on,
        are not compared with the duct if they stand there from the first step on or came in
        through its mouth. It counts only as wide as the lumen is proved to be at its end. Where
        the scope needs more, or the bore is wider than the lumen can be there, the difference
        counts as negative clearance.
    radius : float
        Of the body [mm].
    tolerance : float
        How far the bound may stay below the smallest value found [mm].
    budget : int
        Evaluations at most.
    settle : bool
        Where the bound is negative and the value found is not, look again with a smaller
        tolerance, down to 0.02 mm.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    from .kernels.certify import RESOLVED, bound_motion

    space = space if isinstance(space, FreeSpace) else FreeSpace(space)
    duct, introducer = space.duct, space.introducer
    array = check_array("joints", joints)
    if array.ndim != 3 or array.shape[1] < 2 or not np.all(np.isfinite(array)):
        raise InputError(f"joints of shape {array.shape} must be finite and (steps, joints, dim)")
    if array.shape[2] != duct.dim:
        raise InputError(
            f"joints have shape {array.shape}: the duct needs (steps, joints, {duct.dim})"
        )
    check_number("radius", radius, low=0.0, unit="mm")
    check_number("tolerance", tolerance, low=1e-4, high=10.0, unit="mm")
    packed, excess = space.pack_exempt(radius), 0.0
    if introducer is not None:
        offered = float(duct.clearance_bound(introducer.entry))
        most = float(-duct.signed_distance(introducer.entry)) + duct.error
        if introducer.bore > max(offered, most) + ROUND_OFF_MM:
            excess = introducer.bore - offered
    chains = np.ascontiguousarray(duct.to_grid(array))

    def bound(
        tolerance: float, budget: int, worst: NDArray[np.float64]
    ) -> tuple[int, float, float, int]:
        code, least, found, used = bound_motion(
            packed, chains, float(radius), float(tolerance), budget, worst
        )
        return int(code), float(least) - radius, float(found) - radius, int(used)

    worst = np.zeros(6)
    code, clearance, found, total = bound(tolerance, budget, worst)
    while settle and code == RESOLVED and clearance < 0.0 and found >= FINEST_MM:
        tolerance = 0.8 * min(found, tolerance)
        closer = worst.copy()
        code, finer, least, used = bound(tolerance, budget - total, closer)
        total += used
        if finer > clearance:
            clearance, found, worst = finer, least, closer
    place = worst[3:6]
    if excess > 0.0 and clearance > -excess:
        clearance = found = -excess
        worst[:3], place = 0.0, packed.introducer[:3]
    return Certificate(
        clearance=clearance,
        found=found,
        step=float(worst[0]),
        link=int(worst[1]),
        place=duct.to_world(place),
        resolved=code == RESOLVED,
        evaluations=total,
        wall=duct.wall,
    )


def find_waiting(
    joints: NDArray[np.float64], space: FreeSpace, *, radius: float
) -> NDArray[np.int64]:
    """Find which joints the certificate takes to stand in the introducer.

    A joint does if the body around it is in the bore, all joints behind it stand there too, and it
    was there from the first step on or came in through the mouth. To lie past the entry plane is
    not enough: a tract that turns back leads the head there again.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm]; joint 0 is the head.
    space : FreeSpace
    radius : float
        Of the body [mm].

    Returns
    -------
    (steps,) int
        From this joint on they do; the number of joints where none does.
    """
    from .kernels.certify import mark_introduced

    waiting = np.empty(len(joints), dtype=np.int64)
    chains = np.ascontiguousarray(space.duct.to_grid(joints))
    mark_introduced(chains, space.pack_exempt(radius).introducer, float(radius), waiting)
    return waiting
