"""Plan again in a lumen that has moved: carry the last head path along with the tissue.

A path that was clear stays nearly clear when it moves with its lumen; what is missing is pushed
out by a few sweeps of the elastic band. The certificate is made anew, on the new motion in the new
lumen, and decides as always.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points, floor_beside
from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..duct.field import RefinedField, SampledField
from ..errors import InputError
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from ..progress import Progress, no_progress
from .measures import measure_body
from .plan import Plan, Replanned, SoftWall
from .planner import Motion, advise_plan, check_link, finish_plan, make_planner, plan_insertion
from .planners import PlannerOptions
from .refusal import Refusal
from .scope import Introducer, Scope, measure_bore
from .shape import HOPELESS_MM, SPACING_MM
from .space import FreeSpace
from .tube import MARGINS, Standing, Style, TubeMotion, TubeProblem, plan_in_tube

# A wall that gives way: it is displaced as little as needed, and contacts are named.

SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of the allowed displacement that are tried in turn, after none."""


SOFT_WALL_MAX_MM = 100.0
"""Largest displacement of a wall that can be allowed."""


def plan_with_soft_wall(
    space: FreeSpace,
    scope: Scope,
    *,
    soft_wall: float,
    method: str = "best",
    options: PlannerOptions | None = None,
    progress: Progress = no_progress,
) -> Plan:
    """Plan an insertion where the body may displace the wall by up to `soft_wall` mm.

    The wall is first taken as rigid, then displaced outwards by growing shares of what is allowed
    until the scope comes through; what is proved is proved for the displaced wall. The plan's
    clearances are against the wall at rest: where they are negative, the body pushes it.

    Parameters
    ----------
    space : FreeSpace
        With a sampled field, and a line.
    scope : Scope
    soft_wall : float
        Largest displacement allowed [mm].
    method, options, progress
        As for `plan_insertion`.

    Returns
    -------
    Plan
        Its ``soft_wall`` states what was allowed and used, the deepest contact, where it is, and
        the share of steps with contact.

    Raises
    ------
    InputError
        As `plan_insertion`, or if `soft_wall` is negative.
    """
    check_number("soft wall", soft_wall, low=0.0, high=SOFT_WALL_MAX_MM, unit="mm")
    duct, line, options = space.duct, space.centreline, options or PlannerOptions()
    if not isinstance(duct, (SampledField, RefinedField)):
        raise InputError(f"the duct is a {type(duct).__name__}: a soft wall takes a sampled field")

    def displace(by: float) -> Duct:
        return duct.inflate(by) if by else duct  # of which the passages may be known

    def plan_displaced(by: float) -> Plan:
        chosen = replace(options, advise=False)
        return plan_insertion(
            displace(by), line, scope=scope, method=method, options=chosen, progress=progress
        )

    # With several shares, what would fit is only sought for the one that is taken.
    best, used = plan_displaced(0.0), 0.0
    for share in SHARES if soft_wall > 0.0 else ():
        if best.status == "complete":
            break
        plan = plan_displaced(soft_wall * share)
        if plan.inserted > best.inserted + 1.0 or plan.status == "complete":
            best, used = plan, soft_wall * share
    if best.status == "stopped" and options.advise:
        best = advise_plan(best, FreeSpace(displace(used), line), progress=progress)
    if best.options is not None:
        best = replace(best, options=options)
    at_rest = FreeSpace(duct, line, best.introducer)
    clearance, worst = measure_body(at_rest, best.joints, scope)
    deepest, where, measures = 0.0, 0.0, best.measures
    if np.isfinite(worst[-1]) and measures is not None:
        deepest = max(0.0, -float(worst[-1]))
        place = worst[: line.points.shape[1]]
        where = float(line.arc_length[np.argmin(np.linalg.norm(line.points - place, axis=1))])
        measures = replace(measures, clearance_min=float(worst[-1]), clearance_where=where)
    soft = SoftWall(
        allowed=soft_wall,
        used=used,
        contact_max=deepest,
        contact_where=where if deepest > 0.0 else None,
        contact_step_share=float((clearance.min(axis=1) < 0.0).mean()),
    )
    best = replace(best, clearance=clearance, measures=measures, soft_wall=soft)
    if used == 0.0 or best.certificate is None:
        return best
    wall = f"{duct.wall}, displaced by up to {used:g} mm"
    return replace(best, wall=wall, certificate=replace(best.certificate, wall=wall))


Advect = Callable[[NDArray[np.float64]], ArrayLike]
"""Where tissue points (n, dim) of the last lumen are now: (n, dim), world frame [mm]."""

SCHEDULES: tuple[tuple[tuple[int, float], ...], ...] = (
    (),
    ((12, 0.0),),
    ((15, 0.2), (25, 0.1)),
)
"""Rounds of (sweeps, tension), tried in turn; each begins at the moved path."""


@dataclass(frozen=True, kw_only=True)
class ReplanOptions:
    """How far a motion is planned again, and from where.

    Parameters
    ----------
    step : int, optional
        The scope stands at this step of the last plan. Its body is moved with the tissue, and the
        motion goes on from there; where that fails nothing else is tried. By default the whole
        insertion is planned again, from the introducer.
    horizon : float, optional
        Plan only so far ahead of the head [mm]; by default to the goal.
    measure : bool
        Whether clearances are estimated too. Without it time is saved: every clearance of the plan
        is the certified one, `Plan.measures` is None, and the path's points are 1 mm apart instead
        of 0.5 mm.

    Raises
    ------
    InputError
        If the horizon is none, or is given without a step.
    """

    step: int | None = None
    horizon: float | None = None
    measure: bool = True

    def __post_init__(self) -> None:
        if self.horizon is not None:
            check_number("horizon", self.horizon, low=0.0, high=1e6, unit="mm")
            if self.step is None:
                raise InputError("a horizon was given, but no step at which the scope stands")


def replan(
    plan: Plan,
    duct: Duct,
    *,
    advect: Advect | None = None,
    scope: Scope | None = None,
    line: Centreline | None = None,
    options: ReplanOptions | None = None,
) -> Plan:
    """Plan an insertion again after the lumen has moved or changed.

    Entry, goal, introducer and head path of the last plan move with the tissue; the path is then
    bent where it lacks clearance, and the motion and its certificate are made anew. Where that
    fails, the insertion is planned in full. Head step, slip, angle limit and route are the last
    plan's.

    Parameters
    ----------
    plan : Plan
        The last plan, by method ``"tube"`` or ``"follow"``, also one read from a file.
    duct : Duct
        The lumen as it is now.
    advect : callable, optional
        Takes points (n, dim) of the last lumen to where their tissue is now, (n, dim), world
        frame [mm]; it is asked for points of the path, and one link length into the lumen from
        the entry. Without it the tissue at entry, goal and path stays where it was.
    scope : Scope, optional
        Another scope; by default the last one, with as many links.
    line : Centreline, optional
        The way to the goal as it is now, for a full plan; by default the moved path. It must be
        given if the last plan did not reach its goal, because such a plan knows no way there.
    options : ReplanOptions, optional
        Whether the scope stands in the lumen already, and how far ahead is planned.

    Returns
    -------
    Plan
        Its ``replan`` states whether the moved path served (``warm``), with which ``margin`` over
        the scope's radius and after how many ``sweeps`` (0: as it was), how far the path's points
        were moved with the tissue (``tissue_move``) and, if it did not serve, why (``reason``).
        The certificate holds for the lumen given, not for the time between two
        lumens: a wall that moves by up to w mm takes up to w mm off the clearance. With a horizon
        the plan is ``"stopped"`` there, with the code ``"HORIZON"``; its path leads on to the goal,
        and it can be planned again.

    Raises
    ------
    InputError
        If the plan is the thesis's, or stopped and no `line` is given, or lacks its scope or
        introducer, or has not the duct's dimensions, or if `advect` does not return as many finite
        points.
    """
    for name, value, kind in (("plan", plan, Plan), ("duct", duct, Duct)):
        if not isinstance(value, kind):
            raise InputError(f"{name} is a {type(value).__name__}: it must be a {kind.__name__}")
    again = options or ReplanOptions()
    _check(plan, duct, line, scope, again)
    links = plan.links if scope is None else 0
    scope = plan.get_scope() if scope is None else scope
    asked = plan.options or PlannerOptions()
    make_planner(plan.method).check(scope, asked)
    style = Style(freedom=0.0 if plan.method == "follow" else (plan.freedom or 1.0))
    path = _advect(advect, plan.path)
    way, rest, standing = path, path[:0], None
    if again.step is not None:
        chain = duct.to_grid(_advect(advect, plan.joints[again.step]))
        way, rest, share = cut_ahead(plan, path, again)
        standing = Standing(chain=chain, share=share)
    moved = _measure_line(way, duct)
    space = FreeSpace(duct, moved, _move_introducer(plan, advect, path[0], duct, scope))
    if standing is None:
        check_link(scope, moved)
    job = TubeProblem(
        space,
        scope,
        asked,
        style,
        links=links or scope.count_links(moved.length),
        standing=standing,
    )
    if not again.measure:
        job.spacing = SPACING_MM
    attempt = _Attempt(reason="the last plan did not reach its goal")
    if _knows_way(plan):
        attempt = _try_path(job)
    motion: Motion | None = attempt.motion
    if standing is not None:
        motion = _go_on(job, attempt, plan, again, rest)
    elif motion is None:
        if line is not None:
            space = FreeSpace.at_entry(duct, line, along=scope.link_length)
        motion = plan_in_tube(TubeProblem(space, scope, asked, style, links=job.links))
    result = finish_plan(
        space, motion, scope=scope, options=asked, asked=plan.method, measure=again.measure
    )
    note = Replanned(
        warm=attempt.motion is not None,
        margin=attempt.margin,
        sweeps=attempt.sweeps,
        tissue_move=float(np.linalg.norm(path - plan.path, axis=1).max()),
        reason=attempt.reason,
    )
    return replace(result, replan=note)


def cut_ahead(
    plan: Plan, path: NDArray[np.float64], options: ReplanOptions
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the part of a moved path up to the horizon, the rest, and where the head is in it.

    The head's place is a share of the first part's length.
    """
    arc = measure_arc_length(path)
    step = 0 if options.step is None else options.step
    head = float(np.interp(plan.head_arc_length[step], plan.path_arc_length, arc))
    end = float(arc[-1])
    if options.horizon is not None:
        end = min(end, max(head + options.horizon, float(arc[1])))
    count = int(np.searchsorted(arc, end - 1e-6))
    way = np.concatenate([path[:count], interpolate_polyline(path, arc, np.array([end]))])
    return way, path[int(np.searchsorted(arc, end + 1e-6)) :], min(head / end, 1.0)


def _go_on(
    job: TubeProblem,
    attempt: _Attempt,
    plan: Plan,
    options: ReplanOptions,
    rest: NDArray[np.float64],
) -> Motion:
    """Return the motion of a scope that stands in the lumen; if there is none, it stays."""
    motion, standing = attempt.motion, job.standing
    if motion is None:
        at = 0.0 if standing is None else standing.share * job.line.length
        step = 0 if options.step is None else options.step
        return Motion(
            joints=job.duct.to_world(standing.chain)[None] if standing else plan.joints[step][None],
            head_arc_length=np.array([at]),
            path=np.concatenate([job.line.points, rest]),
            refusal=Refusal(code="NOT_CARRIED", at=at, what=attempt.reason),
        )
    if len(rest) == 0 or motion.refusal is not None:
        return motion
    at = float(motion.head_arc_length[-1])
    stop = Refusal(code="HORIZON", at=at, what=f"planned up to {at:.1f} mm of the head's path")
    return replace(motion, path=np.concatenate([motion.path, rest]), refusal=stop)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """What came of the moved path: a motion, or why there is none."""

    motion: TubeMotion | None = None
    margin: float | None = None
    sweeps: int = 0
    reason: str = ""


def _try_path(job: TubeProblem) -> _Attempt:
    """Bend the job's line, the moved path, as little as needed, and move along it."""
    if job.bound[0] < job.scope.radius:
        return _Attempt(reason="the entry is narrower than the scope")
    base = np.ascontiguousarray(job.duct.to_grid(job.line.points))
    reason, sweeps = "", 0
    for margin in MARGINS:
        band = job.band(margin)
        for schedule in SCHEDULES:
            shaped = band.run(base, schedule)
            sweeps = sum(count for count, _ in schedule)
            if shaped.clear:
                motion = job.follow(shaped, margin)
                if motion is not None:
                    return _Attempt(motion=motion, margin=margin, sweeps=sweeps)
                reason = "the moved path was clear, but no motion along it could be certified"
                break
            shown = floor_beside(max(shaped.clearance, 0.0), band.clearance)
            reason = (
                f"the moved path leaves {shown[0]} mm after {sweeps} sweeps, "
                f"{shown[1]} mm are needed"
            )
        if shaped.clearance < band.clearance - HOPELESS_MM:
            break
    return _Attempt(sweeps=sweeps, reason=reason)


LIVE_CODES = ("HORIZON", "NOT_CARRIED")
"""A plan that stopped for one of these knows the whole way to its goal."""


def _knows_way(plan: Plan) -> bool:
    return plan.status == "complete" or plan.reason_code in LIVE_CODES


def _check(
    plan: Plan,
    duct: Duct,
    line: Centreline | None,
    scope: Scope | None,
    options: ReplanOptions,
) -> None:
    if plan.method not in ("tube", "follow"):
        raise InputError(
            f"a plan by method {plan.method!r} cannot be planned again: it must be by 'tube' or "
            "'follow' (use plan_insertion)"
        )
    if plan.path.shape[1] != duct.dim:
        raise InputError(
            f"the last plan has {plan.path.shape[1]} dimensions, the duct has "
            f"{duct.dim}: they must agree"
        )
    if options.step is not None:
        check_integer("step", options.step, low=0, high=plan.steps - 1)
        if scope is not None:
            raise InputError("another scope was given, but the last plan's stands in the lumen")
    if not _knows_way(plan) and (line is None or options.step is not None):
        raise InputError(
            f"the last plan stopped ({plan.reason_code}), it knows no way to the goal: give line"
        )


def _advect(advect: Advect | None, points: NDArray[np.float64]) -> NDArray[np.float64]:
    if advect is None:
        return points
    moved = check_points("what advect returns", advect(points.copy()), dim=points.shape[1])
    if moved.shape != points.shape:
        raise InputError(f"advect returns {moved.shape} for points {points.shape}: they must agree")
    return moved


def _move_introducer(
    plan: Plan,
    advect: Advect | None,
    entry: NDArray[np.float64],
    duct: Duct,
    scope: Scope,
) -> Introducer:
    """Carry the introducer along with the tissue around the entry: its end and its direction."""
    last = plan.get_introducer()
    inner = (last.entry - scope.link_length * last.outward)[None]
    outward = entry - _advect(advect, inner)[0]
    size = float(np.linalg.norm(outward))
    if size < 1e-6 * scope.link_length:
        raise InputError("advect folds the tissue at the entry: the introducer has no direction")
    return Introducer(entry=entry, outward=outward / size, bore=measure_bore(duct, entry))


def _measure_line(path: NDArray[np.float64], duct: Duct) -> Centreline:
    return Centreline(
        points=path, arc_length=measure_arc_length(path), radius=-duct.signed_distance(path)
    )
