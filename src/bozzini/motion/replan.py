"""Plan again in a lumen that has moved: carry the last head path along with the tissue.

A path that was clear stays nearly clear when it moves with its lumen; what is missing is pushed
out by a few sweeps of the elastic band. The certificate is made anew, on the new motion in the new
lumen, and decides as always.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_number, check_points
from ..duct.base import Duct, count_dimensions
from ..duct.centreline import Centreline
from ..duct.field import SampledField
from ..errors import InputError
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from .insertion import check_link, check_options, finish_plan, measure_body, plan_insertion
from .introducer import Introducer, measure_bore
from .plan import Plan
from .scope import Scope
from .shape import HOPELESS, _run
from .tube import MARGINS, Job, TubeMotion, TubeOptions, plan_in_tube

# A wall that gives way: let it be displaced as little as needed, and say where it is touched.

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the allowed displacement that are tried in turn."""


def plan_with_soft_wall(
    duct: SampledField, line: Centreline, *, scope: Scope, soft_wall: float, **options: Any
) -> Plan:
    """Plan an insertion where the body may displace the wall by up to `soft_wall` mm.

    The wall is first taken as rigid, then displaced outwards by growing shares of what is allowed
    until the scope comes through; what is proved is proved for the displaced wall. The plan's
    clearances are against the wall at rest: where they are negative, the body pushes it.

    Parameters
    ----------
    soft_wall : float
        Largest displacement allowed [mm].
    **options
        As for `plan_insertion`.

    Returns
    -------
    Plan
        ``meta["soft_wall"]`` says what was allowed and used, the deepest contact, where it is,
        and the share of steps with contact.

    Raises
    ------
    InputError
        As `plan_insertion`, or if `soft_wall` is negative.
    """
    check_number("soft wall", soft_wall, low=0.0, high=100.0, unit="mm")
    best: Plan | None = None
    used = 0.0
    for share in SHARES:
        trial = soft_wall * share
        # With several shares, what would fit is only sought for the one that is taken.
        advise = soft_wall == 0.0
        plan = plan_insertion(duct.inflate(trial), line, scope=scope, advise=advise, **options)
        if best is None or plan.inserted > best.inserted + 1.0 or plan.status == "complete":
            best, used = plan, trial
        if plan.status == "complete" or soft_wall == 0.0:
            break
    if best is None:
        raise RuntimeError("no share was tried")
    if best.status == "stopped" and soft_wall > 0.0:
        best = plan_insertion(duct.inflate(used), line, scope=scope, **options)
    introducer = Introducer.from_description(best.meta["introducer"])
    clearance, worst = measure_body(duct, best.joints, scope=scope, introducer=introducer)
    inside = bool(np.isfinite(worst[-1]))
    deepest = max(0.0, -float(worst[-1])) if inside else 0.0
    place = worst[: line.points.shape[1]]
    near = int(np.argmin(np.linalg.norm(line.points - place, axis=1)))
    where = float(line.arc_length[near])
    measures = {**best.meta["measures"]}
    if inside:
        measures |= {"clearance_min_mm": float(worst[-1]), "clearance_where_mm": where}
    meta = {
        **best.meta,
        "measures": measures,
        "soft_wall": {
            "allowed_mm": soft_wall,
            "used_mm": used,
            "contact_max_mm": deepest,
            "contact_where_mm": where if deepest > 0.0 else None,
            "contact_step_share": float((clearance.min(axis=1) < 0.0).mean()),
        },
    }
    if used > 0.0:
        meta["wall"] = f"{duct.wall}, displaced by up to {used:g} mm"
        meta["certificate"] = {**best.meta["certificate"], "wall": meta["wall"]}
    return replace(best, clearance=clearance, meta=meta)


Advect = Callable[[NDArray[np.float64]], ArrayLike]
"""Where tissue points (n, dim) of the last lumen are now: (n, dim), world frame [mm]."""

SCHEDULES: tuple[tuple[tuple[int, float], ...], ...] = (
    (),
    ((12, 0.0),),
    ((15, 0.2), (25, 0.1)),
)
"""Rounds of (sweeps, tension), tried in turn; each begins at the moved path."""


def replan(
    plan: Plan,
    duct: Duct,
    *,
    advect: Advect | None = None,
    scope: Scope | None = None,
    line: Centreline | None = None,
    progress: Progress = no_progress,
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
    progress : Progress

    Returns
    -------
    Plan
        ``meta["replan"]`` says whether the moved path served (``warm``), with which ``margin_mm``
        over the scope's radius and after how many ``sweeps`` (0: as it was), how far the path's
        points were moved with the tissue (``tissue_move_mm``) and, if it did not serve, why
        (``reason``). The certificate holds for the lumen given, not for the time between two
        lumens: a wall that moves by up to w mm takes up to w mm off the clearance.

    Raises
    ------
    InputError
        If the plan is the thesis's, or stopped and no `line` is given, or lacks its scope or
        introducer, or has not the duct's dimensions, or if `advect` does not return as many finite
        points.
    """
    _check(plan, duct, line)
    links = plan.links if scope is None else 0
    scope = _read_scope(plan) if scope is None else scope
    options = _read_options(plan)
    path = _advect(advect, plan.path)
    introducer = _move_introducer(plan, advect, path[0], duct, scope)
    moved = _measure_line(path, duct)
    check_options(
        scope=scope,
        method=plan.method,
        head_step=options.head_step,
        slip=options.slip,
        angle_limit=options.angle_limit,
        route=options.route,
    )
    check_link(scope, moved)
    links = links or scope.count_links(moved.length)
    progress("plan", 0.0)
    attempt = _Attempt(reason="the last plan did not reach its goal")
    if plan.status == "complete":
        attempt = _try_path(Job(duct, moved, scope, options, introducer=introducer, links=links))
    motion = attempt.motion
    if motion is None:
        if line is not None:
            introducer = Introducer.at_entry(duct, line, along=scope.link_length)
        job = Job(
            duct,
            moved if line is None else line,
            scope,
            options,
            introducer=introducer,
            links=links,
        )
        motion = plan_in_tube(job, progress=progress)
    result = finish_plan(
        duct,
        motion,
        line=moved if line is None else line,
        scope=scope,
        introducer=introducer,
        method=plan.method,
        options=options,
    )
    progress("certify", 1.0)
    note = {
        "warm": attempt.motion is not None,
        "margin_mm": attempt.margin,
        "sweeps": attempt.sweeps,
        "tissue_move_mm": float(np.linalg.norm(path - plan.path, axis=1).max()),
        "reason": attempt.reason,
    }
    return replace(result, meta={**result.meta, "replan": note})


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """What came of the moved path: a motion, or why there is none."""

    motion: TubeMotion | None = None
    margin: float | None = None
    sweeps: int = 0
    reason: str = ""


def _try_path(job: Job) -> _Attempt:
    """Bend the job's line, the moved path, as little as needed, and move along it."""
    if job.bound[0] < job.scope.radius:
        return _Attempt(reason="the entry is narrower than the scope")
    base = np.ascontiguousarray(job.duct.to_grid(job.line.points))
    length, reason, sweeps = job.scope.link_length, "", 0
    for margin in MARGINS:
        room = job.scope.radius + margin
        for schedule in SCHEDULES:
            shaped = _run(job.data, job.intro, base, schedule, length, room, job.lead)
            sweeps = sum(count for count, _ in schedule)
            if shaped.clear:
                motion = job.follow(shaped, margin)
                if motion is not None:
                    return _Attempt(motion=motion, margin=margin, sweeps=sweeps)
                reason = "the moved path was clear, but no motion along it could be certified"
                break
            reason = (
                f"the moved path leaves {max(shaped.room, 0.0):.2f} mm after {sweeps} sweeps, "
                f"{room:.2f} mm are needed"
            )
        if shaped.room < room - HOPELESS:
            break
    return _Attempt(sweeps=sweeps, reason=reason)


def _check(plan: Plan, duct: Duct, line: Centreline | None) -> None:
    if plan.method not in ("tube", "follow"):
        raise InputError(
            f"a plan by method {plan.method!r} cannot be planned again: it must be by 'tube' or "
            "'follow' (use plan_insertion)"
        )
    if plan.path.shape[1] != count_dimensions(duct):
        raise InputError(
            f"the last plan has {plan.path.shape[1]} dimensions, the duct has "
            f"{count_dimensions(duct)}: they must agree"
        )
    if plan.status != "complete" and line is None:
        raise InputError(
            f"the last plan stopped ({plan.reason_code}), it knows no way to the goal: give line"
        )


def _read_scope(plan: Plan) -> Scope:
    try:
        given = plan.meta["scope"]
        return Scope(
            diameter=float(given["diameter_mm"]), link_length=float(given["link_length_mm"])
        )
    except (KeyError, TypeError, ValueError):
        raise InputError(
            "the plan's meta has no scope (scope.diameter_mm, scope.link_length_mm): give scope"
        ) from None


def _read_options(plan: Plan) -> TubeOptions:
    given: dict[str, Any] = plan.meta.get("options", {})
    return TubeOptions(
        head_step=plan.meta.get("head_step_mm", TubeOptions.head_step),
        freedom=0.0 if plan.method == "follow" else given.get("freedom", TubeOptions.freedom),
        slip=given.get("slip", TubeOptions.slip),
        angle_limit=given.get("angle_limit_rad", TubeOptions.angle_limit),
        route=given.get("route", TubeOptions.route),
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
    try:
        last = Introducer.from_description(plan.meta["introducer"])
    except KeyError:
        raise InputError("the plan's meta has no introducer") from None
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
