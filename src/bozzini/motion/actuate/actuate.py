"""A plan becomes a robot's motion: tendon displacements that bend its sections along the path.

At each step the bends of all sections that have left the introducer, and the advance of the base,
are fitted to the plan's path by least squares, from the step before, within the limits of bends
and tendons; where the body comes near the wall, the wall pushes. The fit proves nothing: what is
executed between the steps of the time table is certified afterwards (`executed`), and cut where
that fails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ...checks import ceil_mm, check_number, show_apart
from ...continuum import ContinuumRobot
from ...continuum.coupling import Coupling, require_arcs
from ...duct.base import Duct
from ...errors import GeometryError, InputError
from ...numeric.arrays import Floats
from ...progress import Progress, no_progress
from ..plan import Plan, write_record
from ..space import FreeSpace
from .actuation import Actuation, check_names
from .executed import ArcCertificate, certify_arcs, find_base_frame, place_bodies

# One robot fitted to one path: the job that every attempt of `actuate_plan` shares.

PITCH = 2.5
"""Distance between the points of the backbone that are held to the path, at most [mm]."""

LOOK = 1.0
"""Distance between the points whose clearance is estimated, at most [mm]."""

ROUNDS = 8
"""Iterations per step at most."""

TRAVEL_SLACK = 1e-5
"""How far tendons are kept inside their travel [mm]; they overstep their command by less."""

FINER = (0.02, 0.005)
"""Deviations of the certified chain, tried in turn [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BendFit:
    """Bends along a path.

    Parameters
    ----------
    heads : (n,) float
        Where the tip stands along the path [mm].
    bends : (n, m, 2) float
        Of the sections [rad].
    advances : (n,) float
        Of the base [mm].
    displacements : (n, t) float
        Of the tendons [mm].
    rms, largest : (n,) float
        Off the path [mm].
    iterations : (n,) int
        Of the fit.
    """

    heads: Floats
    bends: Floats
    advances: Floats
    displacements: Floats
    rms: Floats
    largest: Floats
    iterations: NDArray[np.int64]

    @property
    def angles(self) -> Floats:
        """How far each section bends (n, m) [rad]."""
        return np.asarray(np.linalg.norm(self.bends, axis=2))

    def cut(self, end: int, *, begin: int = 0) -> BendFit:
        """Return the steps before `end`, from `begin` on."""
        rows = slice(begin, end)
        return BendFit(**{each.name: getattr(self, each.name)[rows] for each in fields(self)})


class FitJob:
    """The inputs of a fit, prepared for the kernels."""

    def __init__(
        self,
        plan: Plan,
        coupling: Coupling,
        space: FreeSpace,
        *,
        roll: float = 0.0,
    ) -> None:
        from ...numeric.polylines import measure_arc_length

        robot = cast(ContinuumRobot, coupling.robot)  # `check_robot` made it
        duct, introducer = space.duct, space.tube
        self.robot, self.coupling, self.space, self.roll = robot, coupling, space, roll
        self.introducer, self.duct = introducer, duct
        self.heads = plan.head_arc_length
        self.lengths = np.array([section.length for section in robot.sections])
        # Discs meet where the curve is as tight as the body is thick.
        meet = [section.length / section.radius for section in robot.sections]
        self.limits = np.minimum([section.max_bend for section in robot.sections], meet)
        self.samples = np.maximum(4, np.ceil(self.lengths / PITCH)).astype(np.int64)
        self.frame = find_base_frame(introducer, roll=roll)
        axes, entry = self.frame[:3, :3], introducer.entry
        lead = np.array([[0.0, 0.0, -(robot.length + 1.0)]])
        points = (plan.path - entry) @ axes
        points = points[np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-9]]
        self.path = np.ascontiguousarray(np.concatenate([lead, points]))
        self.arc = measure_arc_length(self.path)
        self.arc -= self.arc[1]
        ways = np.diff(self.path, axis=0)
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        turning = ways[:-1] + ways[1:]
        tangents = np.concatenate([ways[:1], turning, ways[-1:]])
        size = np.linalg.norm(tangents, axis=1)
        back = size < 1e-6  # the path turns back
        tangents[back], size[back] = ways[np.minimum(np.flatnonzero(back), len(ways) - 1)], 1.0
        self.tangents = np.ascontiguousarray(tangents / size[:, None])
        origin = duct.to_grid(entry)
        self.placing = np.concatenate([duct.to_grid(entry + axes.T) - origin, origin[None]])

    def fit(self, clearance: float, *, limited: bool = True) -> BendFit:
        """Fit all steps; the wall pushes where the body's clearance is less [mm]."""
        from ..kernels.actuate import fit_motion, measure_fit

        steps, sections = len(self.heads), len(self.lengths)
        bends, advances = np.zeros((steps, sections, 2)), np.zeros(steps)
        used = np.zeros(steps, dtype=np.int64)
        rms, largest = np.zeros(steps), np.zeros(steps)
        travel = self.robot.tendon_travel + TRAVEL_SLACK * np.array([1.0, -1.0])
        open_ended = np.full_like(travel, math.inf) * np.array([-1.0, 1.0])
        fit_motion(
            self.duct.pack(),
            self.placing,
            self.introducer.bore,
            self.lengths,
            self.samples,
            self.limits if limited else np.full(sections, math.inf),
            self.coupling.matrix,
            travel if limited else open_ended,
            self.path,
            self.tangents,
            self.arc,
            self.heads,
            self.robot.radius + clearance,
            ROUNDS,
            bends,
            advances,
            used,
        )
        measure_fit(
            self.lengths,
            self.samples,
            self.path,
            self.tangents,
            self.arc,
            self.heads,
            bends,
            advances,
            rms,
            largest,
        )
        return BendFit(
            heads=self.heads,
            bends=bends,
            advances=advances,
            displacements=bends.reshape(steps, -1) @ self.coupling.matrix.T,
            rms=rms,
            largest=largest,
            iterations=used,
        )

    def certify(self, fit: BendFit) -> ArcCertificate:
        """Prove the clearance of a fit's motion; look closer where that settles it."""
        proof = None
        for deviation in FINER:
            proof = certify_arcs(
                self.robot,
                fit.bends,
                fit.advances,
                self.space,
                roll=self.roll,
                deviation=deviation,
            )
            if proof.clearance >= 0.0 or proof.found + 2.0 * proof.deviation < 0.0:
                break
        if proof is None:
            raise RuntimeError("no deviation was tried")
        return proof

    def count_reached(self, fit: BendFit) -> int:
        """Return how many steps the robot is long enough for."""
        short = np.flatnonzero(fit.advances >= self.robot.length - 1e-9)
        return int(short[0]) if len(short) else len(fit.heads)

    def keep_certified(self, fit: BendFit) -> tuple[BendFit, ArcCertificate]:
        """Return the longest start of a fit that is certified, by bisection; one step at least.

        Each stretch is proved once; together they prove the whole.
        """
        proofs = [self.certify(fit.cut(1))]
        low, high = 1, len(fit.heads)
        while high - low > 1 and proofs[0].clearance >= 0.0:
            middle = (low + high) // 2
            # From the last step that is certified, so that nothing is left out between.
            proof = self.certify(fit.cut(middle, begin=low - 1))
            if proof.clearance >= 0.0:
                proofs.append(replace(proof, step=proof.step + low - 1))
                low = middle
            else:
                high = middle
        least = min(proofs, key=lambda proof: proof.clearance)
        whole = replace(
            least,
            found=min(proof.found for proof in proofs),
            deviation=max(proof.deviation for proof in proofs),
            resolved=all(proof.resolved for proof in proofs),
            chords=max(proof.chords for proof in proofs),
            instants=sum(proof.instants for proof in proofs) - len(proofs) + 1,
            evaluations=sum(proof.evaluations for proof in proofs),
        )
        return fit.cut(low), whole

    def estimate_clearance(self, fit: BendFit) -> tuple[Floats, NDArray[np.int64], Floats]:
        """Estimate the body's clearance at each step, by samples outside the introducer.

        Returns
        -------
        clearance : (n,) float
            The smallest [mm]; infinite where the robot is in the introducer.
        section : (n,) int
            On which section that is.
        place : (n, 3) float
            Where, world frame [mm].
        """
        chords = np.maximum(1, np.ceil(self.lengths / LOOK)).astype(np.int64)
        joints = place_bodies(
            self.robot,
            fit.bends,
            fit.advances,
            self.frame,
            times=np.arange(len(fit.heads)),
            chords=chords,
        )[:, ::-1]
        away = joints - self.introducer.entry
        along = away @ self.introducer.outward
        off = np.linalg.norm(away - along[..., None] * self.introducer.outward, axis=2)
        inside = (along >= 0.0) & (off <= self.introducer.bore - self.robot.radius + 1e-9)
        inside = np.logical_and.accumulate(inside, axis=1)
        gap = -self.duct.signed_distance(joints) - self.robot.radius
        gap[inside] = math.inf
        worst = np.argmin(gap, axis=1)
        rows = np.arange(len(gap))
        section = np.searchsorted(np.cumsum(chords), worst, side="left")
        return gap[rows, worst], np.minimum(section, len(chords) - 1), joints[rows, worst]


# Why a robot does not go all the way: which section or tendon, where, and by how much.


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

    def describe(self) -> dict[str, object]:
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
    """A fit with the clearance [mm] below which the wall pushed, and what is proved of it."""

    clearance: float
    fit: BendFit
    proof: ArcCertificate


def explain_length(job: FitJob, fit: BendFit) -> Shortfall:
    """State that the robot is too short, and by how many sections."""
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
    """State why an attempt is not certified beyond its first `kept` steps."""
    travel = job.robot.tendon_travel
    wall = _explain_wall(job, attempt.fit, attempt.proof)
    free = job.fit(attempt.clearance, limited=False).cut(len(attempt.fit.heads))
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


def _explain_bend(job: FitJob, free: BendFit, over: Floats) -> Shortfall:
    """State which section would have to bend farthest beyond its limit."""
    step, section = np.unravel_index(int(np.argmax(over)), over.shape)
    needs, offers = float(free.angles[step, section]), float(job.limits[section])
    meets = offers < job.robot.sections[int(section)].max_bend
    angles = show_apart(math.degrees(needs), math.degrees(offers), digits=1, form="f")
    return Shortfall(
        code="BEND_LIMIT",
        what=f"{job.robot.section_label(int(section))} would have to bend "
        f"{angles[0]} deg with the head at {free.heads[step]:.1f} mm, "
        f"{'its discs meet at' if meets else 'its limit is'} {angles[1]} deg",
        head=float(free.heads[step]),
        section=int(section),
        needs=needs,
        offers=offers,
        unit="rad",
    )


def _explain_travel(job: FitJob, free: BendFit, over: Floats) -> Shortfall:
    """State which tendon would have to move farthest beyond its travel."""
    step, tendon = np.unravel_index(int(np.argmax(over)), over.shape)
    needs = float(free.displacements[step, tendon])
    offers = float(job.robot.tendon_travel[tendon, 1 if needs > 0.0 else 0])
    ways = show_apart(needs, offers, digits=2, form="f")
    return Shortfall(
        code="TENDON_TRAVEL",
        what=f"tendon '{job.robot.tendon_names[tendon]}' would have to move {ways[0]} mm with "
        f"the head at {free.heads[step]:.1f} mm, its drive goes to {ways[1]} mm",
        head=float(free.heads[step]),
        section=int(job.robot.tendon_sections[tendon]),
        needs=needs,
        offers=offers,
    )


def _explain_wall(job: FitJob, fit: BendFit, proof: ArcCertificate) -> Shortfall:
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
        f"{ceil_mm(-proof.clearance)} mm through the wall, the estimate at the steps "
        f"{clearance[step]:.2f} mm clear of it",
        head=float(fit.heads[before]),
        section=proof.section,
        needs=job.robot.radius,
        offers=job.robot.radius + proof.clearance,
    )


PUSH_CLEARANCES_MM = (1.0, 0.5, 2.0)
"""Clearance between body and wall below which the wall pushes, tried in turn."""

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
        is cut where its certificate ends, and ``reason`` states which section, where, and by how
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
    if duct.dim != 3 or plan.path.shape[1] != 3:
        raise InputError("the plan or the duct is planar: a robot moves in 3 dimensions")
    introducer = plan.get_introducer()
    space = FreeSpace(duct, introducer=introducer)
    job = FitJob(plan, check_robot(robot), space, roll=roll)
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
    best = _try_clearances(job, progress)
    options["room_mm"] = best.clearance
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


def _try_clearances(job: FitJob, progress: Progress) -> Attempt:
    """Return the first attempt that is certified as far as the robot is long, or the best."""
    best: Attempt | None = None
    for count, clearance in enumerate(PUSH_CLEARANCES_MM):
        progress("robot", 0.8 * count / len(PUSH_CLEARANCES_MM))
        fit = job.fit(clearance)
        fit = fit.cut(max(1, job.count_reached(fit)))
        _check_tendons(job, fit)
        attempt = Attempt(clearance=clearance, fit=fit, proof=job.certify(fit))
        if best is None or attempt.proof.clearance > best.proof.clearance:
            best = attempt
        if attempt.proof.clearance >= 0.0:
            break
    if best is None:
        raise RuntimeError("no clearance was tried")
    return best


def _check_tendons(job: FitJob, fit: BendFit) -> None:
    """Raise `GeometryError` if the displacements do not bend the robot as the fit does."""
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
    fit: BendFit,
    proof: ArcCertificate,
    shortfall: Shortfall | None,
    options: dict[str, float],
) -> Actuation:
    clearance, _, _ = job.estimate_clearance(fit)
    reason = ""
    meta: dict[str, object] = {
        "options": options,
        "introducer": write_record(job.introducer),
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
