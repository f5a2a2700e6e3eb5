"""Plan the insertion of a scope: check the input, call the method, measure the result."""

from __future__ import annotations

import functools
import platform
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..duct.base import Duct, count_dimensions
from ..duct.centreline import Centreline
from ..errors import InputError
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from .certify import Certificate, certify_motion
from .introducer import Introducer
from .largest import find_advice
from .measures import measure_plan
from .plan import Plan
from .refusal import Refusal
from .scope import Scope
from .thesis import move_by_thesis
from .tube import Job, TubeMotion, TubeOptions, grid_of, plan_in_tube

__all__ = ["METHODS", "check_link", "check_options", "plan_insertion"]

METHODS = ("best", "tube", "follow", "thesis")
"""The planners: the best of the next two, joints in a tube, joints on the path, the thesis's."""


def plan_insertion(
    duct: Duct,
    line: Centreline,
    *,
    scope: Scope,
    method: str = "best",
    head_step: float = 0.25,
    slip: float = 0.0,
    angle_limit: float | None = None,
    route: Sequence[float] = (1.0,),
    advise: bool = True,
    progress: Progress = no_progress,
) -> Plan:
    """Plan how a scope moves along a centreline into a lumen.

    Parameters
    ----------
    duct : Duct
        The lumen: a sampled field, or an analytic one; in 2-D or 3-D.
    line : Centreline
        The way from the entry to the goal.
    scope : Scope
        The scope; without a length it is made long enough for the whole line.
    method : {"best", "tube", "follow", "thesis"}
        ``"best"``: ``"tube"``, ``"follow"`` and a motion between them, also along a path shaped
        for more clearance; the one with the most certified clearance, of those whose joints step
        at most four times as far as the head. ``"tube"``: the whole body stays inside, proved,
        and joints move little. ``"follow"``: the same, with every joint on the head's path.
        ``"thesis"``: section 5.3, each next joint moves least with the link length kept and the
        **joints** kept one scope radius inside the wall; the links between them are not.
    head_step : float
        How far the head moves per step [mm].
    slip : float
        Thesis Appendix C, corrected: 0 tractrix ... 1 the tail moves like the head. Not for
        ``"thesis"``.
    angle_limit : float, optional
        Largest angle between neighbouring links [rad]; the motion stops before it.
    route : sequence of float
        Fractions of the way that the head goes to in turn: ``(1,)`` in, ``(1, 0)`` in and out,
        ``(1, 0, 1)`` in, out, in. Not for ``"thesis"``.
    advise : bool
        Whether to seek what would fit where the scope does not; that takes seconds.

    Returns
    -------
    Plan
        Also when the scope does not fit: then ``status`` is ``"stopped"``, the motion goes as far
        as it certifiably can, and ``reason`` says why it ends there and what would fit: scopes
        and inflations for which a certified plan of the whole way was made. Every plan carries
        its certificate in ``meta``; only ``meta["certified"]`` is a proof. ``method`` is the one
        that made it; with ``"best"`` ``meta["candidates"]`` lists what was compared.

    Raises
    ------
    InputError
        If the method is unknown, the link is longer than the tract, a number is out of range, or
        the motion would have more than `POSITIONS_MAX` positions of joints.
    """
    check_options(
        scope=scope,
        method=method,
        head_step=head_step,
        slip=slip,
        angle_limit=angle_limit,
        route=route,
    )
    check_link(scope, line)
    dim = count_dimensions(duct)
    if line.points.shape[1] != dim:
        raise InputError(
            f"the centreline's points have shape {line.points.shape}: this duct needs (n, {dim})"
        )
    way = line
    short = scope.length is not None and scope.length < line.length - 1e-6
    if short:
        # It gets in as far as it is long.
        way = line.cut(float(scope.length or 0.0))
    check_size(scope, way, head_step=head_step, route=route)
    options = TubeOptions(
        head_step=head_step,
        freedom=0.0 if method == "follow" else 1.0,
        slip=slip,
        angle_limit=angle_limit,
        route=tuple(route),
        compare=method == "best",
    )
    outcome: tuple[str, str, str] | None = None
    if method == "thesis":
        links = scope.count_links(way.length)
        introducer = Introducer.at_entry(duct, way, along=scope.link_length)
        thesis = move_by_thesis(
            duct,
            way,
            scope=scope,
            introducer=introducer,
            links=links,
            head_step=head_step,
            progress=progress,
        )
        progress("certify", 0.0)
        certificate = certify_motion(
            thesis.joints, duct, radius=scope.radius, introducer=introducer
        )
        planned = TubeMotion(
            joints=thesis.joints,
            head_arc_length=thesis.head_arc_length,
            path=way.points,
            certificate=certificate,
        )
        outcome = (thesis.status, thesis.reason_code, thesis.reason)
    else:
        job = Job(duct, way, scope, options)
        introducer = job.introducer
        planned = plan_in_tube(job, progress=progress)
        if planned.refusal is not None and advise and not short:
            refusal = find_advice(job, planned.refusal, progress=progress)
            planned = replace(planned, refusal=refusal)
    if short and (outcome[0] == "complete" if outcome else planned.refusal is None):
        refusal = _explain_short(scope, line)
        planned, outcome = replace(planned, refusal=refusal), None
    plan = finish_plan(
        duct,
        planned,
        line=way,
        scope=scope,
        introducer=introducer,
        method=method,
        options=options,
        outcome=outcome,
    )
    progress("certify", 1.0)
    return plan


def _explain_short(scope: Scope, line: Centreline) -> Refusal:
    length = float(scope.length or 0.0)
    return Refusal(
        code="SCOPE_TOO_SHORT",
        at=length,
        needs=line.length,
        offers=length,
        what=f"the scope is {length:g} mm long and wholly inserted: the goal is at "
        f"{line.length:.1f} mm of the centreline",
    )


def finish_plan(
    duct: Duct,
    motion: TubeMotion,
    *,
    line: Centreline,
    scope: Scope,
    introducer: Introducer,
    method: str,
    options: TubeOptions,
    outcome: tuple[str, str, str] | None = None,
) -> Plan:
    """Measure a motion and put it, with all it was made from, into a plan.

    Parameters
    ----------
    method : str
        What was asked for; the plan names what it comes to.
    outcome : (str, str, str), optional
        Status, reason code and reason; by default what the motion's refusal says.
    """
    refusal, path = motion.refusal, motion.path
    if outcome is None:
        outcome = ("complete", "", "")
        if refusal is not None:
            outcome = ("stopped", refusal.code, refusal.reason)
    clearance, worst = measure_body(duct, motion.joints, scope=scope, introducer=introducer)
    # Planar motions are measured in the kernels' frame too, which is 3-D and isometric.
    measures = measure_plan(
        motion.joints,
        motion.head_arc_length,
        clearance,
        line=replace(line, points=duct.to_grid(line.points)),
        worst=np.append(duct.to_grid(worst[:-1]), worst[-1]),
    )
    meta = _describe(duct, scope, introducer, options.head_step, measures, motion.certificate)
    meta["options"] = {
        "slip": options.slip,
        "angle_limit_rad": options.angle_limit,
        "route": [float(share) for share in options.route],
        "asked": method,
    }
    if method == "best":
        method = "follow" if motion.freedom == 0.0 else "tube"
        meta["options"]["freedom"] = motion.freedom
        meta["candidates"] = list(motion.candidates)
    if refusal is not None:
        meta["refusal"] = refusal.describe()
    return Plan(
        joints=motion.joints,
        head_arc_length=motion.head_arc_length,
        clearance=clearance,
        path=path,
        path_arc_length=measure_arc_length(path),
        path_radius=-duct.signed_distance(path),
        method=method,
        status=outcome[0],
        reason_code=outcome[1],
        reason=outcome[2],
        meta=meta,
    )


LINKS_MAX = 10_000
"""A scope has at most as many links."""

POSITIONS_MAX = 10_000_000
"""A plan holds at most as many positions: of all joints, at all steps. They take 240 MB."""


def check_size(scope: Scope, line: Centreline, *, head_step: float, route: Sequence[float]) -> None:
    """Raise `InputError` if a motion along `line` would be too large to hold."""
    joints = scope.count_links(line.length) + 1
    travel = float(np.abs(np.diff([0.0, *route])).sum()) * line.length
    if joints * (travel / head_step + 1.0) > POSITIONS_MAX:
        least = travel * joints / POSITIONS_MAX
        raise InputError(
            f"head step is {head_step:g} mm: it must be at least {least * 1.01:.3g} mm for "
            f"{joints} joints on a way of {travel:.0f} mm, or give longer links"
        )


def check_options(
    *,
    scope: Scope,
    method: str,
    head_step: float,
    slip: float,
    angle_limit: float | None,
    route: Sequence[float],
) -> None:
    """Raise `InputError` for any option of `plan_insertion` that is not legal for every tract."""
    if method not in METHODS:
        raise InputError(f"method is {method!r}: it must be one of {', '.join(METHODS)}")
    if scope.length is not None and scope.length > LINKS_MAX * scope.link_length:
        raise InputError(
            f"scope length is {scope.length:g} mm: it must be at most "
            f"{LINKS_MAX * scope.link_length:g} mm, {LINKS_MAX} links of {scope.link_length:g} mm"
        )
    check_number("head step", head_step, low=1e-3, high=scope.link_length, unit="mm")
    check_number("slip", slip, low=0.0, high=1.0)
    if angle_limit is not None:
        check_number("angle limit", angle_limit, low=0.0, high=np.pi, low_open=True, unit="rad")
    for share in route:
        check_number("route", share, low=0.0, high=1.0)
    if max(route, default=0.0) <= 0.0:
        raise InputError(f"route is {tuple(route)}: one of its fractions must lie in (0, 1]")
    if method == "thesis" and (slip != 0.0 or angle_limit is not None or tuple(route) != (1.0,)):
        raise InputError(
            "method 'thesis' has no slip, angle limit or route: leave them out, or use one of "
            f"{', '.join(m for m in METHODS if m != 'thesis')}"
        )


def check_link(scope: Scope, line: Centreline) -> None:
    """Raise `InputError` if a link is longer than the way."""
    if scope.link_length > line.length:
        raise InputError(
            f"link length is {scope.link_length:g} mm: it must be at most the tract's "
            f"centreline, {line.length:.1f} mm"
        )


BODY_PITCH = 0.25
"""`body_pitch` of an analytic duct [mm]."""


def body_pitch(duct: Duct) -> float:
    """Distance between the samples along a link in the body check [mm]."""
    grid = grid_of(duct)
    return BODY_PITCH if grid is None else 0.5 * float(np.min(grid.spacing))


def measure_body(
    duct: Duct,
    joints: NDArray[np.float64],
    *,
    scope: Scope,
    introducer: Introducer,
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

    chains = np.ascontiguousarray(duct.to_grid(joints))
    clearance = np.empty((joints.shape[0], joints.shape[1] - 1))
    worst = np.zeros(4)
    introducer = replace(introducer, bore=max(introducer.bore, scope.radius))
    measure(
        duct.pack(),
        introducer.pack(duct),
        chains,
        scope.radius,
        body_pitch(duct),
        clearance,
        worst,
    )
    return clearance, np.append(duct.to_world(worst[:3]), worst[3])


def _describe(
    duct: Duct,
    scope: Scope,
    introducer: Introducer,
    head_step: float,
    measures: dict[str, float],
    certificate: Certificate,
) -> dict[str, Any]:
    return {
        "scope": {"diameter_mm": scope.diameter, "link_length_mm": scope.link_length},
        "introducer": introducer.describe(),
        "head_step_mm": head_step,
        "wall": duct.wall,
        "certified": certificate.certified,
        "certificate": {
            "clearance_mm": _finite(certificate.clearance),
            "found_mm": _finite(certificate.found),
            "step": certificate.step,
            "link": certificate.link,
            "place_mm": [float(v) for v in certificate.place],
            "resolved": certificate.resolved,
            "evaluations": certificate.evaluations,
            "wall": certificate.wall,
        },
        "field": {
            "kind": duct.kind,
            **_describe_grid(duct),
            "inflation_mm": duct.inflation,
            "interpolation_error_mm": duct.error,
            "wall_error_mm": duct.wall_error,
            "sampling_error_mm": 0.5 * body_pitch(duct),
            "clearance_error_mm": duct.error + 0.5 * body_pitch(duct),
        },
        "measures": {name: _finite(value) for name, value in measures.items()},
        "versions": dict(_list_versions()),
    }


def _describe_grid(duct: Duct) -> dict[str, Any]:
    grid = grid_of(duct)
    if grid is None:
        return {}
    return {"spacing_mm": [float(h) for h in grid.spacing], "nodes": list(grid.values.shape)}


@functools.cache
def _list_versions() -> tuple[tuple[str, str], ...]:
    from importlib.metadata import version

    from .. import __version__ as bozzini_version

    return (
        ("bozzini", bozzini_version),
        ("python", platform.python_version()),
        *((name, version(name)) for name in ("numpy", "scipy", "numba")),
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
