"""One link in a duct: the tail that moves least, with what is proved about it (thesis 5.3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points, check_range
from ..duct.base import Duct, check_duct, count_dimensions
from ..errors import InputError

if TYPE_CHECKING:
    from .introducer import Introducer

__all__ = ["LinkPlacement", "bound_slope", "place_tail"]

STATUSES = ("free", "wall", "searched", "infeasible")

FINEST = 1e-4
"""Half the side of the smallest square of directions looked at for the proof, at most [rad]."""
BUDGET = 1_000_000
CLOSE = 0.01
"""Where no room is found, the search goes on until none has this share of the slack to spare."""
FARTHEST = 1e6
"""Largest coordinate of a joint, and largest length and clearance [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkPlacement:
    """Where the tail of one link goes.

    Parameters
    ----------
    status : str
        ``"free"``: straight towards the old tail, no wall is met (the tractrix step).
        ``"wall"``: at the wall, found at once. ``"searched"``: at the wall, found by the search of
        all directions. ``"infeasible"``: no direction was found that has the room asked for, and
        none has `slack` more.
    tail : (dim,) float
        The tail, at one link length from the head [mm]; if infeasible the one with the most room.
    turn : float
        Angle between the link and the direction to the old tail [rad].
    move : float
        Distance from the old tail [mm].
    clearance : float
        Clearance of the tail as the duct states it [mm].
    turn_bound : float
        No direction that turns less has the room asked for and `slack` more [rad]. Infinite if
        infeasible.
    slack : float
        See `turn_bound` [mm].
    clearance_bound : float
        No direction at all has more clearance than this [mm]; infinite unless infeasible. Below
        the clearance asked for and `slack`, unless the search ran out, which `reason` then says.
    reason : str
        Why it is infeasible, else empty.
    """

    status: str
    tail: NDArray[np.float64]
    turn: float
    move: float
    clearance: float
    turn_bound: float
    slack: float
    clearance_bound: float = math.inf
    reason: str = ""

    @property
    def found(self) -> bool:
        """Whether the link has a place."""
        return self.status != "infeasible"


def place_tail(
    duct: Duct,
    head: ArrayLike,
    old_tail: ArrayLike,
    *,
    length: float,
    clearance: float = 0.0,
    introducer: Introducer | None = None,
    gap: float = 1e-3,
) -> LinkPlacement:
    """Place the tail of a link whose head has moved, so that it moves least (thesis eq. 5.15).

    Minimise ``|x - old_tail|`` subject to ``|x - head| = length`` and `clearance` from x to the
    wall. All candidates lie on a sphere around the head, so this is the nearest direction that
    has room. In the plane it is found by marching both ways; in space by a local step, held
    against a search of all directions, so that the answer is the nearest of all, not of those
    around; that takes most of the time, and chains do without it where the step goes a short way.
    Only the tail is looked at, as in the thesis; the link between may cut the wall.

    Parameters
    ----------
    duct : Duct
        Any duct, 2-D or 3-D.
    head, old_tail : (dim,) float
        The head where it is now, the tail where it was [mm].
    length : float
        Of the link [mm].
    clearance : float
        What the tail must keep from the wall [mm].
    introducer : Introducer, optional
        A straight tube before the entry that is free space too.
    gap : float
        In space, by how much the turn may exceed the least one [rad]: the search goes on until
        that is proved, or for a million values of the duct.

    Returns
    -------
    LinkPlacement
        Also when no direction has room.

    Raises
    ------
    InputError
        If a number is out of range, or the head is on the old tail: then every tail moves alike.

    Notes
    -----
    The proof uses that a duct's value changes by at most 1 per mm (an analytic duct) or
    ``sqrt(3)`` per mm (the interpolant of a sampled one); it is about that value, which for a
    sampled field may differ from the true distance by the field's `error`.
    """
    from .kernels import chain as directions
    from .kernels import chain as links

    check_duct("duct", duct)
    dim = count_dimensions(duct)
    planar = dim == 2
    ends = [_check_point("head", head, dim), _check_point("old tail", old_tail, dim)]
    length = check_number("length", length, low=1e-6, high=FARTHEST, unit="mm")
    clearance = check_number("clearance", clearance, low=0.0, high=FARTHEST, unit="mm")
    gap = check_number("gap", gap, low=1e-5, high=0.1, unit="rad")
    if np.linalg.norm(ends[1] - ends[0]) < 1e-9 * length:
        raise InputError(
            f"the head is on the old tail, {ends[0].tolist()} mm: the direction to it must be "
            "known, use a head step shorter than the link"
        )
    start, old = (np.ascontiguousarray(duct.to_grid(end)) for end in ends)
    data, slope = duct.pack(), bound_slope(duct)
    tube = np.zeros(7) if introducer is None else introducer.pack(duct)
    work, frame, tail = np.empty((6, 5)), np.empty((3, 3)), np.empty(3)
    code, lack = links.place_tail(
        data, tube, start, old, length, clearance, slope, planar, work, tail
    )
    links.make_frame(start, old, planar, frame)
    finest = min(FINEST, 0.1 * gap)
    slack = slope * (0.5 * directions.MARCH if planar else length * math.sqrt(2.0) * finest)
    most, least = math.inf, 0.0
    if code == links.INFEASIBLE:
        lack, least = directions.find_roomiest(
            *(data, tube, start, frame, length, clearance, slope, planar, CLOSE * slack),
            *(BUDGET, tail),
        )
        if lack <= 0.0:  # after all: this search is finer
            code = links.SEARCHED
        else:
            most = clearance - float(least)
    turn = turn_bound = _measure_turn(start, tail, frame)
    if code == links.INFEASIBLE:
        turn_bound = math.inf
    elif code == links.FREE:
        turn_bound, slack = 0.0, 0.0
    elif not planar:
        found, turn, turn_bound = _prove(
            data, tube, start, frame, length, clearance, slope, turn, gap, finest, tail
        )
        code = links.SEARCHED if found else code
    value = float(directions.duct_value(data, tube, tail[0], tail[1], tail[2]))
    world = duct.to_world(tail)
    reason = ""
    if code == links.INFEASIBLE:
        at = ", ".join(f"{v:.4g}" for v in ends[0])
        reason = (
            f"no tail at {length:g} mm from the head ({at}) has {clearance:g} mm from the wall, "
            f"the best found lacks {lack:.2g} mm"
        )
        if least <= 0.0:
            reason += f"; others may have {-least:.2g} mm to spare, which was not proved to be none"
    return LinkPlacement(
        status=STATUSES[code],
        tail=world,
        turn=float(turn),
        move=float(np.linalg.norm(world - ends[1])),
        clearance=-value,
        turn_bound=float(turn_bound),
        slack=slack,
        clearance_bound=most,
        reason=reason,
    )


def _prove(
    data: object,
    tube: NDArray[np.float64],
    head: NDArray[np.float64],
    frame: NDArray[np.float64],
    length: float,
    clearance: float,
    slope: float,
    turn: float,
    gap: float,
    finest: float,
    tail: NDArray[np.float64],
) -> tuple[bool, float, float]:
    """Look for a nearer direction than the one found: (whether there is one, turn, bound)."""
    from .kernels import chain as directions

    place = np.zeros(2)
    found, turn, bound, _ = directions.search_sphere(
        data, tube, head, frame, length, clearance, slope, turn, gap, finest, BUDGET, place
    )
    if found:
        directions.point_tail(head, frame, length, place[0], place[1], tail)
    return bool(found), float(turn), float(bound)


def _check_point(name: str, point: ArrayLike, dim: int) -> NDArray[np.float64]:
    array = check_points(name, point, dim=dim)
    if array.ndim != 1:
        raise InputError(f"{name} has shape {array.shape}: it must be one point, ({dim},)")
    check_range(name, array, -FARTHEST, FARTHEST, "mm")
    return array


def bound_slope(duct: Duct) -> float:
    """Return by how much the value of a duct in compiled code changes per mm at most."""
    from .kernels.chain import bound_packed_slope

    return bound_packed_slope(duct.pack())


def _measure_turn(
    head: NDArray[np.float64], tail: NDArray[np.float64], frame: NDArray[np.float64]
) -> float:
    """Return the angle between the link and the old direction [rad]."""
    away = tail - head
    ahead = float(away @ frame[0])
    aside = float(np.linalg.norm(away - ahead * frame[0]))
    return math.atan2(aside, ahead)
