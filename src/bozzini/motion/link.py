"""One link in a duct, and a free chain of links in none (thesis 5.3.1).

In a duct the tail moves least, and what is proved about that is stated. In a free chain a link's
tail moves along the link only: the tractrix. With slip (Appendix C) it also takes a share of its
head's move. Only its head moves the chain: no wall, no contact, no weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points, check_range, check_word
from ..duct.base import Duct, check_duct
from ..errors import InputError
from ..results import Shown
from .space import FreeSpace

STATUSES = ("free", "wall", "searched", "infeasible")

FINEST_RAD = 1e-4
"""Half the side of the smallest square of directions looked at for the proof, at most."""
BUDGET = 1_000_000
"""Values of the duct looked at for the proof, at most."""

CLOSE = 0.01
"""Where nothing feasible is found, the search goes on until no direction may have this share of
the slack to spare."""
COORDINATE_MAX_MM = 1e6
"""Largest coordinate of a joint, and largest length and clearance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkPlacement(Shown):
    """Where the tail of one link goes.

    Parameters
    ----------
    status : str
        ``"free"``: straight towards the old tail, no wall is met (the tractrix step).
        ``"wall"``: at the wall, found at once. ``"searched"``: at the wall, found by the search of
        all links. ``"infeasible"``: no direction was found that has the clearance asked for,
        and none has `slack` more.
    tail : (dim,) float
        The tail, at one link length from the head [mm]; if infeasible the one with the
        most clearance.
    turn : float
        Angle between the link and the direction to the old tail [rad].
    move : float
        Distance from the old tail [mm].
    clearance : float
        Clearance of the tail as the duct states it [mm].
    turn_bound : float
        No direction that turns less has the clearance asked for and `slack` more [rad]. Infinite
        if infeasible.
    slack : float
        See `turn_bound` [mm].
    clearance_bound : float
        No direction at all has more clearance than this [mm]; infinite unless infeasible. Below
        the clearance asked for and `slack`, unless the search ran out, which `reason` then states.
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
    space: FreeSpace | Duct,
    head: ArrayLike,
    *,
    old_tail: ArrayLike,
    length: float,
    clearance: float = 0.0,
    gap: float = 1e-3,
) -> LinkPlacement:
    """Place the tail of a link whose head has moved, so that it moves least (thesis eq. 5.15).

    Minimise ``|x - old_tail|`` subject to ``|x - head| = length`` and `clearance` from x to the
    wall. All candidates lie on a sphere around the head, so this is the nearest direction that
    keeps it. In the plane it is found by marching both ways; in space by a local step, held
    against a search of all directions, so that the answer is the nearest of all, not of those
    around; that takes most of the time, and chains do without it where the step goes a short way.
    Only the tail is looked at, as in the thesis; the link between may cut the wall.

    Parameters
    ----------
    space : FreeSpace or Duct
        Any free space, 2-D or 3-D; an introducer is free too.
    head, old_tail : (dim,) float
        The head where it is now, the tail where it was [mm].
    length : float
        Of the link [mm].
    clearance : float
        What the tail must keep from the wall [mm].
    gap : float
        In space, by how much the turn may exceed the least one [rad]: the search goes on until
        that is proved, or for a million values of the duct.

    Returns
    -------
    LinkPlacement
        Also when no direction is feasible.

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
    from ..duct.kernels.clearance import space_estimate
    from .kernels import chain as links

    space = space if isinstance(space, FreeSpace) else FreeSpace(space)
    duct = space.duct
    check_duct("duct", duct)
    dim = duct.dim
    planar = dim == 2
    ends = [_check_point("head", head, dim), _check_point("old tail", old_tail, dim)]
    length = check_number("length", length, low=1e-6, high=COORDINATE_MAX_MM, unit="mm")
    clearance = check_number("clearance", clearance, low=0.0, high=COORDINATE_MAX_MM, unit="mm")
    gap = check_number("gap", gap, low=1e-5, high=0.1, unit="rad")
    if np.linalg.norm(ends[1] - ends[0]) < 1e-9 * length:
        raise InputError(
            f"the head is on the old tail, {ends[0].tolist()} mm: the direction to it must be "
            "known, use a head step shorter than the link"
        )
    start, old = (np.ascontiguousarray(duct.to_grid(end)) for end in ends)
    data, slope = space.pack(), bound_slope(duct)
    work, frame, tail = np.empty((6, 5)), np.empty((3, 3)), np.empty(3)
    code, lack = links.place_tail(data, start, old, length, clearance, slope, planar, work, tail)
    links.make_frame(start, old, planar, frame)
    finest = min(FINEST_RAD, 0.1 * gap)
    slack = slope * (0.5 * links.MARCH if planar else length * math.sqrt(2.0) * finest)
    most, least = math.inf, 0.0
    if code == links.INFEASIBLE:
        lack, least = links.find_clearest(
            data, start, frame, length, clearance, slope, planar, CLOSE * slack, BUDGET, tail
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
        # Is there a direction nearer than the one found?
        place = np.zeros(2)
        found, turn, turn_bound, _ = links.search_sphere(
            data, start, frame, length, clearance, slope, turn, gap, finest, BUDGET, place
        )
        if found:
            links.point_tail(start, frame, length, place[0], place[1], tail)
            code = links.SEARCHED
    kept = float(space_estimate(data, tail[0], tail[1], tail[2]))
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
        clearance=kept,
        turn_bound=float(turn_bound),
        slack=slack,
        clearance_bound=most,
        reason=reason,
    )


def _check_point(name: str, point: ArrayLike, dim: int) -> NDArray[np.float64]:
    array = check_points(name, point, dim=dim)
    if array.ndim != 1:
        raise InputError(f"{name} has shape {array.shape}: it must be one point, ({dim},)")
    check_range(name, array, -COORDINATE_MAX_MM, COORDINATE_MAX_MM, "mm")
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


SCHEMES = ("exact", "least")
"""Closed form of the tractrix, or the thesis's least move of each tail per head step."""

SUBSTEP = 0.1
"""The closed form is applied to moves of at most this share of the shortest link."""


def move_free_chain(
    joints: ArrayLike,
    head_path: ArrayLike,
    *,
    slip: float = 0.0,
    scheme: str = "exact",
    substep: float | None = None,
) -> NDArray[np.float64]:
    """Move a free chain by moving its head along a polyline.

    Parameters
    ----------
    joints : (joints, dim) float
        Where the chain is before the motion, head first [mm]; dim is 2 or 3. Its links keep the
        lengths that they have here.
    head_path : (steps, dim) float
        Where the head goes in turn, along straight lines [mm].
    slip : float
        nu, 0 to 1: the share of its head's move that a tail takes on as it is. 0 is the tractrix,
        1 a chain that is shifted without turning. Thesis Appendix C reads 0.95 off a bicycle chain
        on photo paper and 0.86 on gravel.
    scheme : {"exact", "least"}
        ``"exact"``: the closed form of a link whose head moves along a straight line. It is exact
        for the first link and second order in `substep` for those behind, whose heads move along
        curves. ``"least"``: each tail moves once per step, least (thesis eq. 5.13, with slip
        6.6); first order in the length of the steps.
    substep : float, optional
        Longest straight move at a time for ``"exact"`` [mm], at most the shortest link; by
        default a tenth of that.

    Returns
    -------
    (steps, joints, dim) float
        The chain when its head is at each point of `head_path` [mm].

    Raises
    ------
    InputError
        If a shape or number is out of range, or a link has no length.

    Notes
    -----
    With w the unit vector from head to tail, e that of the head's move of length s, c = w.e and
    sigma = (1 - nu) s / L, the new w is ``(w - c e) + (c cosh sigma - sinh sigma) e``, normalised:
    slip is a tractrix with the link L / (1 - nu). The tangent of half the angle between link and
    move shrinks by exp(-sigma). A tail never moves farther than its head.

    Appendix C prints the slip vector as nu X_h, with X_h the head's **position**, which depends on
    where the origin is; here it is nu times the head's **displacement**, nu (x_h - X_h).
    """
    from .kernels.tractrix import pull_chain

    chain = np.array(joints, dtype=np.float64)
    if chain.ndim != 2 or chain.shape[0] < 2 or chain.shape[1] not in (2, 3):
        raise InputError(f"joints have shape {chain.shape}: it must be (joints >= 2, 2 or 3)")
    check_points("joints", chain, dim=chain.shape[1])
    heads = check_points("head path", head_path, dim=chain.shape[1])
    if heads.ndim != 2 or len(heads) < 1:
        raise InputError(f"head path has shape {heads.shape}: it must be (steps >= 1, dim)")
    lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    shortest = float(lengths.min())
    if shortest <= 0.0:
        raise InputError(f"link {int(np.argmin(lengths)) + 1} has length 0: it must be above 0 mm")
    check_number("slip", slip, low=0.0, high=1.0)
    check_word("scheme", scheme, SCHEMES)
    pitch = 0.0
    if scheme == "exact":
        pitch = SUBSTEP * shortest if substep is None else substep
        check_number("substep", pitch, low=0.0, high=shortest, low_open=True, unit="mm")
    elif substep is not None:
        raise InputError("scheme 'least' knows no substep: give a finer head path")
    result = np.empty((len(heads), *chain.shape))
    step, link = pull_chain(
        chain, lengths, np.ascontiguousarray(heads), float(slip), float(pitch), result
    )
    if step >= 0:
        raise InputError(
            f"head step {step}: link {link}'s head lands on the old place of its tail, which "
            "leaves the link no direction; use shorter steps"
        )
    return result
