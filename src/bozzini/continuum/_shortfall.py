"""Why a robot does not go all the way: which section or tendon, where, and by how much."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._fit import Fit, FitJob
from .arc_certificate import ArcCertificate

__all__ = ["Attempt", "Shortfall", "explain_end", "explain_length"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Shortfall:
    """Why a robot does not go all the way.

    Parameters
    ----------
    code : str
        A key of `ACTUATION_CODES`.
    what : str
        One sentence.
    head : float
        Where the tip is then, along the path [mm].
    section : int, optional
        Which section, 0 the first.
    needs, offers : float, optional
        What it would need and what there is, in `unit`.
    unit : str
        ``"mm"`` or ``"rad"``.
    """

    code: str
    what: str
    head: float
    section: int | None = None
    needs: float | None = None
    offers: float | None = None
    unit: str = "mm"

    def describe(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return {
            "code": self.code,
            "head_mm": self.head,
            "section": self.section,
            "needs": self.needs,
            "offers": self.offers,
            "unit": self.unit,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempt:
    """A fit with a room that the wall was given [mm], and what is proved of it."""

    room: float
    fit: Fit
    proof: ArcCertificate


def explain_length(job: FitJob, fit: Fit) -> Shortfall:
    """Say that the robot is shorter than the way, and by how many sections."""
    way = float(job.heads.max())
    missing = way - float(fit.heads[-1])
    last = job.robot.sections[-1].length
    return Shortfall(
        code="ROBOT_TOO_SHORT",
        what=f"the robot is {job.robot.length:g} mm long and wholly inserted with its tip at "
        f"{fit.heads[-1]:.1f} mm of {way:.1f} mm: it needs {math.ceil(missing / last)} more "
        f"section(s) of {last:g} mm",
        head=float(fit.heads[-1]),
        needs=way,
        offers=job.robot.length,
    )


def explain_end(job: FitJob, attempt: Attempt, kept: int) -> Shortfall:
    """Say why an attempt is not certified beyond its first `kept` steps."""
    travel = job.robot.tendon_travel
    wall = _explain_wall(job, attempt.fit, attempt.proof)
    free = job.fit(attempt.room, limited=False).cut(len(attempt.fit.heads))
    bend_over = free.angles - job.limits
    pull_over = np.maximum(free.displacements - travel[:, 1], travel[:, 0] - free.displacements)
    # A limit decides if it is overstepped before the motion ends; else the wall does.
    early = slice(0, kept + 1)
    if bend_over[early].max() > 0.0 or pull_over[early].max() <= 0.0 < bend_over.max():
        limit, decides = _explain_bend(job, free, bend_over), bend_over[early].max() > 0.0
    elif pull_over.max() > 0.0:
        limit, decides = _explain_travel(job, free, pull_over), pull_over[early].max() > 0.0
    else:
        return wall
    if not decides:
        return replace(wall, what=f"{wall.what}; also {limit.what}")
    proof = job.certify(free)
    if proof.clearance >= 0.0:
        return limit
    beyond = _explain_wall(job, free, proof)
    return replace(limit, what=f"{limit.what}; without the limit, {beyond.what}")


def _explain_bend(job: FitJob, free: Fit, over: Floats) -> Shortfall:
    """Say which section would have to bend farthest beyond its limit."""
    step, section = np.unravel_index(int(np.argmax(over)), over.shape)
    needs, offers = float(free.angles[step, section]), float(job.limits[section])
    meets = offers < job.robot.sections[int(section)].max_bend
    return Shortfall(
        code="BEND_LIMIT",
        what=f"{job.robot.section_label(int(section))} would have to bend "
        f"{math.degrees(needs):.1f} deg with the head at {free.heads[step]:.1f} mm, "
        f"{'its discs meet at' if meets else 'its limit is'} {math.degrees(offers):.1f} deg",
        head=float(free.heads[step]),
        section=int(section),
        needs=needs,
        offers=offers,
        unit="rad",
    )


def _explain_travel(job: FitJob, free: Fit, over: Floats) -> Shortfall:
    """Say which tendon would have to move farthest beyond its travel."""
    step, tendon = np.unravel_index(int(np.argmax(over)), over.shape)
    needs = float(free.displacements[step, tendon])
    offers = float(job.robot.tendon_travel[tendon, 1 if needs > 0.0 else 0])
    return Shortfall(
        code="TENDON_TRAVEL",
        what=f"tendon '{job.robot.tendon_names[tendon]}' would have to move {needs:.2f} mm with "
        f"the head at {free.heads[step]:.1f} mm, its drive goes to {offers:.2f} mm",
        head=float(free.heads[step]),
        section=int(job.robot.tendon_sections[tendon]),
        needs=needs,
        offers=offers,
    )


def _explain_wall(job: FitJob, fit: Fit, proof: ArcCertificate) -> Shortfall:
    clearance, section, place = job.estimate_clearance(fit)
    step = int(np.argmin(clearance))
    if clearance[step] < 0.0:
        label, depth = job.robot.section_label(int(section[step])), -float(clearance[step])
        where = ", ".join(f"{value:.1f}" for value in place[step])
        share = float((clearance < 0.0).mean())
        return Shortfall(
            code="WALL",
            what=f"{label} goes through the wall by {depth:.2f} mm with the head at "
            f"{fit.heads[step]:.1f} mm, at ({where}) mm, in {100.0 * share:.1f} % of the steps; "
            "shorter sections or a thinner body come closer to the path",
            head=float(fit.heads[step]),
            section=int(section[step]),
            needs=job.robot.radius,
            offers=job.robot.radius - depth,
        )
    before = min(int(proof.step), len(fit.heads) - 1)
    return Shortfall(
        code="CERTIFICATE_UNRESOLVED",
        what=f"it could not be proved that {job.robot.section_label(proof.section)} keeps off the "
        f"wall with the head at {fit.heads[before]:.1f} mm: the bound is "
        f"{-proof.clearance:.2f} mm through the wall, the estimate at the steps "
        f"{clearance[step]:.2f} mm clear of it",
        head=float(fit.heads[before]),
        section=proof.section,
        needs=job.robot.radius,
        offers=job.robot.radius + proof.clearance,
    )
