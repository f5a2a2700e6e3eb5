"""A plan becomes a robot's motion: tendon displacements that bend its sections along the path.

At each step the bends of all sections that have left the introducer, and the advance of the base,
are fitted to the plan's path by least squares, from the step before, within the limits of bends
and tendons; where the body comes near the wall, the wall pushes. The fit proves nothing: what is
executed between the steps of the time table is certified afterwards (`executed`), and cut where
that fails.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import check_number
from ..duct.protocol import Duct, count_dimensions
from ..errors import GeometryError, InputError
from ..motion import Introducer, Plan
from ..progress import Progress, no_progress
from ._actuation_checks import check_names
from ._fit import Fit, FitJob
from ._shortfall import Attempt, Shortfall, explain_end, explain_length
from .actuation import Actuation
from .arc_certificate import ArcCertificate
from .coupling import Coupling, require_arcs
from .robot import ContinuumRobot

__all__ = ["actuate_plan", "check_robot"]

ROOMS = (1.0, 0.5, 2.0)
"""Room between body and wall below which the wall pushes, tried in turn [mm]."""

SAME = 1e-6
"""Bend by which the tendons' solution may differ from the fit [rad]."""


def actuate_plan(
    plan: Plan,
    robot: ContinuumRobot,
    duct: Duct,
    *,
    roll: float = 0.0,
    progress: Progress = no_progress,
) -> Actuation:
    """Return the tendon displacements that take a robot along a plan, and what is proved of them.

    Parameters
    ----------
    plan : Plan
        Its path, head positions and introducer are used, not its chain; a path shaped for
        a thicker scope or shorter links runs more in the middle.
    robot : ContinuumRobot
        A robot of parallel tendons that control each section's bend both ways.
    duct : Duct
        The lumen, three-dimensional.
    roll : float
        Turn of the base about the introducer's axis [rad].
    progress : Progress
        Called with stage and fraction.

    Returns
    -------
    Actuation
        Also when the robot cannot go all the way: then ``status`` is ``"stopped"``, the motion
        is cut where its certificate ends, and ``reason`` says which section, where, and by how
        much.

    Raises
    ------
    InputError
        If the duct is planar, the plan has no introducer, or a tendon is called like another
        column of the time table.
    GeometryError
        If the tendons do not control all bends, or are not parallel.
    """
    check_number("roll", roll, unit="rad")
    if count_dimensions(duct) != 3 or plan.path.shape[1] != 3:
        raise InputError("the plan or the duct is planar: a robot moves in 3 dimensions")
    if "introducer" not in plan.meta:
        raise InputError("the plan's meta has no introducer: plan it anew")
    introducer = Introducer.from_description(plan.meta["introducer"])
    job = FitJob(plan, check_robot(robot), duct, introducer, roll=roll)
    options = {"roll_rad": roll}
    if robot.radius > introducer.bore:
        short = Shortfall(
            code="INTRODUCER",
            what=f"the robot's radius is {robot.radius:.2f} mm: the introducer has a bore of "
            f"radius {introducer.bore:.2f} mm",
            head=0.0,
            needs=robot.radius,
            offers=introducer.bore,
        )
        fit = job.fit(0.0).cut(1)
        return _finish(job, fit, job.certify(fit), short, options)
    best = _try_rooms(job, progress)
    options["room_mm"] = best.room
    shortfall = None
    fit, proof = best.fit, best.proof
    if not proof.clearance >= 0.0:
        progress("robot", 0.8)
        fit, proof = job.keep_certified(best.fit)
        shortfall = explain_end(job, best, len(fit.heads))
    elif len(best.fit.heads) < len(job.heads):
        shortfall = explain_length(job, best.fit)
    elif plan.status == "stopped":
        shortfall = Shortfall(
            code="PLAN_STOPPED",
            what=f"the plan ends before the goal: {plan.reason}",
            head=float(plan.head_arc_length[-1]),
        )
    progress("robot", 1.0)
    return _finish(job, fit, proof, shortfall, options)


def check_robot(robot: ContinuumRobot) -> Coupling:
    """Return how a robot's tendons bend it, if they bend each section both ways.

    Raises
    ------
    GeometryError
        If they do not, or are not parallel.
    InputError
        If a tendon is called like another column of the time table.
    """
    check_names(robot)
    require_arcs(robot, "a motion along a plan")
    coupling = Coupling(robot)
    loose = coupling.open_directions()
    if loose:
        raise GeometryError(
            f"robot '{robot.name}' cannot follow a path in space: {'; '.join(loose)}"
        )
    return coupling


def _try_rooms(job: FitJob, progress: Progress) -> Attempt:
    """Return the first attempt that is certified as far as the robot is long, or the best."""
    best: Attempt | None = None
    for count, room in enumerate(ROOMS):
        progress("robot", 0.8 * count / len(ROOMS))
        fit = job.fit(room)
        fit = fit.cut(max(1, job.count_reached(fit)))
        _check_tendons(job, fit)
        attempt = Attempt(room=room, fit=fit, proof=job.certify(fit))
        if best is None or attempt.proof.clearance > best.proof.clearance:
            best = attempt
        if attempt.proof.clearance >= 0.0:
            break
    if best is None:
        raise RuntimeError("no room was tried")
    return best


def _check_tendons(job: FitJob, fit: Fit) -> None:
    """Raise `GeometryError` if tendons told to move so do not bend the robot so."""
    found = job.coupling.solve(fit.displacements)
    off = np.abs(found.bends - fit.bends).max(axis=(1, 2))
    bad = ~found.converged | (off > SAME)
    if bad.any():
        step = int(np.argmax(bad))
        why = str(found.reason[step]) or "a cable would have to push, and goes slack instead"
        raise GeometryError(
            f"robot '{job.robot.name}' cannot hold the shape with its head at "
            f"{fit.heads[step]:.1f} mm: {why}; give each section tendons all around, or rods"
        )


def _finish(
    job: FitJob,
    fit: Fit,
    proof: ArcCertificate,
    shortfall: Shortfall | None,
    options: dict[str, float],
) -> Actuation:
    clearance, _, _ = job.estimate_clearance(fit)
    reason = ""
    meta: dict[str, Any] = {
        "options": options,
        "introducer": job.introducer.describe(),
        "iterations_max": int(fit.iterations.max()),
    }
    if shortfall is not None:
        meta["shortfall"] = shortfall.describe()
        end = f"the certified motion ends with the head at {fit.heads[-1]:.1f} mm"
        if proof.clearance < 0.0:
            end = "no part of the motion is certified"
        reason = f"{shortfall.what}; {end}"
    return Actuation(
        robot=job.robot,
        head_arc_length=fit.heads.copy(),
        base_advance=fit.advances,
        bends=fit.bends,
        displacements=fit.displacements,
        fit_rms=fit.rms,
        fit_max=fit.largest,
        clearance=clearance,
        frame=job.frame,
        certificate=proof,
        status="complete" if shortfall is None else "stopped",
        reason_code="" if shortfall is None else shortfall.code,
        reason=reason,
        meta=meta,
    )
