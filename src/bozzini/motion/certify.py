"""The certificate: a proved lower bound on the clearance of the whole body, at all times.

It knows nothing of how a motion was planned: it takes joints, a duct and a radius, or a saved
plan. Proof: the distance to a wall changes no faster than a point moves, so one value bounds a
whole cell of body points and times around it; cells that do not decide are split (branch and
bound). In a sampled field the value itself is a rigorous bound (see `duct._clearance_kernels`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number
from ..duct.base import Duct, count_dimensions
from ..errors import InputError
from .introducer import Introducer
from .plan import Plan

__all__ = ["Certificate", "certify_motion", "certify_plan"]

TOLERANCE = 0.1
"""How far the bound may stay below the smallest value found [mm]."""

FINEST = 0.02
"""How far the tolerance is lowered at most, to settle whether a motion is certified [mm]."""

ROUNDING = 1e-6
"""How far a bore may lie above what the entry offers [mm]."""

BUDGET = 100_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
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

    clearance: float
    found: float
    step: float
    link: int
    place: NDArray[np.float64]
    resolved: bool
    evaluations: int
    wall: str

    @property
    def certified(self) -> bool:
        """Whether it is proved that the body, as far as it enters the duct, keeps off the wall."""
        return 0.0 <= self.clearance < np.inf


def certify_motion(
    joints: ArrayLike,
    duct: Duct,
    *,
    radius: float,
    introducer: Introducer | None = None,
    tolerance: float = TOLERANCE,
    budget: int = BUDGET,
    settle: bool = True,
) -> Certificate:
    """Prove a lower bound on the clearance of a moving chain.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm]; between steps joints move along straight lines.
    duct : Duct
        The free space, with a rigorous clearance bound.
    radius : float
        Of the body [mm].
    introducer : Introducer, optional
        A straight tube outside; links in it, from the tail on, are not held against the duct if
        they stand there from the first step on or came in through its mouth. It counts only as
        wide as the lumen is proved to be at its end. Where the scope needs more, or the bore is
        wider than the lumen can be there, the difference counts as negative clearance.
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

    array = np.asarray(joints, dtype=np.float64)
    if array.ndim != 3 or array.shape[1] < 2 or not np.all(np.isfinite(array)):
        raise InputError(f"joints of shape {array.shape} must be finite and (steps, joints, dim)")
    if array.shape[2] != count_dimensions(duct):
        raise InputError(
            f"joints have shape {array.shape}: the duct needs (steps, joints, "
            f"{count_dimensions(duct)})"
        )
    check_number("radius", radius, low=0.0, unit="mm")
    check_number("tolerance", tolerance, low=1e-4, high=10.0, unit="mm")
    packed = np.zeros(7)
    excess = 0.0
    if introducer is not None:
        packed = introducer.pack(duct)
        offered = float(duct.clearance_bound(introducer.entry))
        # What is exempt from the wall is the bore that the lumen offers, whatever is stated.
        packed[6] = min(introducer.bore, max(offered, radius))
        most = float(-duct.signed_distance(introducer.entry)) + duct.error
        if introducer.bore > max(offered, most) + ROUNDING:
            excess = introducer.bore - offered
    chains = np.ascontiguousarray(duct.to_grid(array))
    worst = np.zeros(6)
    code, bound, found, total = bound_motion(
        duct.pack(), packed, chains, float(radius), float(tolerance), int(budget), worst
    )
    while settle and code == RESOLVED and bound < radius and found - radius >= FINEST:
        tolerance = 0.8 * min(found - radius, tolerance)
        closer = worst.copy()
        code, finer, least, used = bound_motion(
            duct.pack(), packed, chains, float(radius), tolerance, int(budget) - total, closer
        )
        total += used
        if finer > bound:
            bound, found, worst = finer, least, closer
    clearance, least, place = float(bound) - radius, float(found) - radius, worst[3:6]
    if introducer is not None and excess > 0.0 and clearance > -excess:
        clearance = least = -excess
        worst[:3], place = 0.0, packed[:3]
    return Certificate(
        clearance=clearance,
        found=least,
        step=float(worst[0]),
        link=int(worst[1]),
        place=duct.to_world(place),
        resolved=code == RESOLVED,
        evaluations=int(total),
        wall=duct.wall,
    )


def certify_plan(plan: Plan, duct: Duct, **options: Any) -> Certificate:
    """Prove a lower bound on the clearance of any saved plan.

    Parameters
    ----------
    plan : Plan
        Only its joints and, from `meta`, the scope's diameter and the introducer are used.
    duct : Duct
        The free space to hold it against.
    **options
        As for `certify_motion`.

    Raises
    ------
    InputError
        If the plan's `meta` lacks the scope's diameter.
    """
    try:
        radius = 0.5 * float(plan.meta["scope"]["diameter_mm"])
    except (KeyError, TypeError, ValueError):
        raise InputError("the plan's meta has no scope diameter (scope.diameter_mm)") from None
    introducer = None
    if "introducer" in plan.meta:
        introducer = Introducer.from_description(plan.meta["introducer"])
    return certify_motion(plan.joints, duct, radius=radius, introducer=introducer, **options)
