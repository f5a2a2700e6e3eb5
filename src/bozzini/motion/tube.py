"""The default planner: shape the path for the link, then move joints freely inside a proved tube.

Section 5.3 of the thesis moves each joint least and looks at joints only; it cuts walls, locks,
and jumps. Here (a) the head path is bent until every chord of link length is clear, (b) it is
tabulated how far joints may stray from it with all links still clear, (c) joints take the
tractrix step inside that tube: no lock, bounded motion, exact lengths, no field query. The
certificate is made afterwards, on the motion itself, and decides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..checks import ceil_mm, floor_beside, floor_mm
from ..duct.centreline import find_clear_path
from ..numeric.polylines import measure_arc_length
from ..progress import Progress, no_progress
from .certify import Certificate, certify_motion
from .measures import Crossing, find_crossing, measure_angles, measure_moves
from .plan import CandidateMotion
from .planner import Motion
from .planners import PlannerOptions
from .refusal import NEAR_MM, Bind, Refusal, tell_needs
from .scope import Scope
from .shape import Band, ShapedPath, cut_path, measure_folds
from .space import FreeSpace

MARGINS = (0.25, 0.12, 0.05)
"""Clearance beyond the radius that the path is shaped for, tried in turn [mm]."""

MARGIN_HOPE_MM = 0.1
"""A margin is skipped if the last shape lacks more than this even for it."""

FOLD_COSINE = 0.25
"""Below this the chain would amplify the head's motion more than fourfold: a fold."""

STEP_RATIO_MAX = 1.0 / FOLD_COSINE
"""A joint's step over the head's, above which a motion is taken only if there is no calmer one.

It is the limit that a path is called folded by. Beyond it the joints, not the head, set the pace,
and what is proved between two recorded steps is proved for large moves.
"""

FREEDOMS = (1.0, 0.5, 0.0)
"""Shares of the tube that are compared for the best motion; 0 follows the leader."""

WIDER = (0.8, 0.4)
"""Shares of the centreline's spare clearance that wider paths are shaped for, tried in turn."""

DEVIATION_CAP = 0.3
"""Joints stray from the path by at most this fraction of a link."""

CUTS = 8
"""How often a path is cut at most where what moves along it could not be certified."""

TUBE_SLOPE = 0.1
"""How fast the tube may widen along the path."""


@dataclass(frozen=True, kw_only=True)
class Style:
    """How joints move in the tube.

    Parameters
    ----------
    freedom : float
        1: joints stray as far as the tube allows; 0: they follow the leader.
    compare : bool
        Whether wider paths and other freedoms are tried too, and the best certified motion kept.
    """

    freedom: float = 1.0
    compare: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeMotion(Motion):
    """A motion in a tube, and what it was made from.

    Parameters
    ----------
    certificate : Certificate
    shaped : ShapedPath or None
        The path in the duct's own frame, to plan again from.
    margin : float
        Clearance beyond the radius that the path was shaped for [mm].
    """

    certificate: Certificate
    shaped: ShapedPath | None = field(default=None, repr=False)
    margin: float = 0.0

    @cached_property
    def step_ratio(self) -> float:
        """Largest step of a joint over the head's."""
        return measure_moves(self.joints, self.head_arc_length)["joint_step_ratio_max"]

    def summarise(self) -> CandidateMotion:
        """Return what it is compared by."""
        return CandidateMotion(
            freedom=1.0 if self.freedom is None else self.freedom,
            margin=self.margin,
            clearance=float(self.certificate.clearance),
            joint_step_ratio=self.step_ratio,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """A scope that stands in the lumen when its motion begins.

    Parameters
    ----------
    chain : (joints, 3) float
        Its joints, in the duct's own frame; links may be stretched, as tissue is.
    share : float
        Of the path, where the head is.
    """

    chain: NDArray[np.float64]
    share: float

    def spread(self, length: float, step: float) -> NDArray[np.float64]:
        """Return the head's arc length at each step to the end of a path."""
        begin = self.share * length
        return np.linspace(begin, length, int(np.ceil((length - begin) / step - 1e-6)) + 1)


def plan_in_tube(job: TubeProblem, *, progress: Progress = no_progress) -> TubeMotion:
    """Plan a certified motion as far as it goes, and state why it ends there."""
    progress("plan", 0.0)
    if float(job.bound[0]) < job.scope.radius:
        return job.stand_still(explain_stop(job))
    motion = job.try_whole_way()
    progress("plan", 0.4)
    if motion is None:
        refusal = explain_stop(job)
        if not job.options.reach:
            return job.stand_still(refusal)
        progress("plan", 0.5)
        motion = find_prefix(
            job, refusal, progress=lambda _, share: progress("plan", 0.5 + 0.4 * share)
        )
        motion = _stop_before_goal(job, motion)
    elif job.style.compare:
        motion = job.improve(motion)
    progress("plan", 1.0)
    return motion


class TubeProblem:
    """One planning job: its inputs, and the steps that every attempt shares.

    Parameters
    ----------
    space : FreeSpace
        With line and introducer.
    scope, options, style
    links : int, optional
        By default what the scope's length, or the line's, takes.
    standing : Standing, optional
        By default the scope begins in the introducer.
    """

    spacing = Band.spacing
    """Distance between the points of a shaped path [mm]."""

    def __init__(
        self,
        space: FreeSpace,
        scope: Scope,
        options: PlannerOptions,
        style: Style,
        *,
        links: int | None = None,
        standing: Standing | None = None,
    ) -> None:
        self.standing = standing
        self.space, self.scope, self.options, self.style = space, scope, options, style
        self.duct, self.line, self.passages = space.duct, space.centreline, space.passages
        self.links = links or scope.count_links(self.line.length)
        self.bound = self.passages.bound
        self.failed: ShapedPath | None = None
        self.fold: ShapedPath | None = None
        self.largest_link = 0.0
        self.unresolved: Certificate | None = None
        self.crossing: Crossing | None = None
        self.bind: Bind | None = None
        self.widest: NDArray[np.float64] | None = None
        self.bases: list[tuple[float, NDArray[np.float64]]] = []

    def band(self, margin: float) -> Band:
        """Return the band for the scope's radius and a margin beyond it."""
        return Band(
            space=self.space,
            length=self.scope.link_length,
            clearance=self.scope.radius + margin,
            lead=(self.links + 2) * self.scope.link_length,
            spacing=self.spacing,
        )

    def try_whole_way(self, *, thorough: bool = True) -> TubeMotion | None:
        """Plan to the goal with the largest margin that works, or return None.

        What succeeds with ``thorough=False`` also succeeds, in the same way, with True.
        """
        for margin in MARGINS:
            base = self.find_base(self.scope.radius + margin)
            last = margin == MARGINS[-1]
            if not last and self.failed is not None:
                if self.failed.clearance < self.scope.radius + margin - MARGIN_HOPE_MM:
                    continue
            motion = None
            if base is not None:
                motion = self.try_path(base, margin, thorough=thorough and last)
            if motion is not None:
                return motion
        base = self.find_base(self.scope.radius + MARGINS[-1])
        if base is None or not thorough:
            return None
        points = np.ascontiguousarray(self.duct.to_grid(base))
        shaped, self.largest_link = self.band(MARGINS[-1]).grow_link(points)
        return None if shaped is None else self.follow(shaped, MARGINS[-1])

    def find_base(self, clearance: float) -> NDArray[np.float64] | None:
        """Return a way to the goal whose points have this clearance: the centreline, or another."""
        if self.bound[0] < clearance or self.bound[-1] < clearance:
            return None
        if self.bound.min() >= clearance or self.passages.grid is None:
            return self.line.points
        for level, known in self.bases:
            if level >= clearance:
                return known
        passage = self.passages.passage
        if passage.level >= clearance:
            base = self.passages.find_path(clearance)
            if base is not None:
                self.bases.append((clearance, base))
                return base
        # The widest way along nodes: between them there may be a wider one.
        if self.widest is None and passage.level > 0.0 and passage.bound >= clearance:
            self.widest = self.passages.find_path(passage.level - 1e-6)
        return self.widest if passage.bound >= clearance else None

    def improve(self, motion: TubeMotion) -> TubeMotion:
        """Return the motion with the most certified clearance of a few as far as this one.

        Joints that stray less from the same path, and paths shaped for more clearance; of those
        whose joints move at most `STEP_RATIO_MAX` as far as the head, if there are any.
        """
        if motion.shaped is None or motion.refusal is not None:
            return motion
        tried = [motion]
        shaped, margin = motion.shaped, motion.margin
        bound = min(self.bound[0], self.bound[-1], float(np.quantile(self.bound, 0.02)))
        for share in WIDER:
            wider = share * (bound - self.scope.radius)
            if wider <= 1.5 * motion.margin:
                break
            path = self.shape(self.duct.to_world(shaped.points[shaped.first :]), wider)
            if path.clear:
                if measure_folds(path, self.scope.link_length).min() >= FOLD_COSINE:
                    shaped, margin = path, wider
                break
        for freedom in FREEDOMS:
            if shaped is motion.shaped and freedom == motion.freedom:
                continue
            other = self.move(shaped, margin, freedom=freedom)
            if other.certificate.certified and other.refusal is None:
                if find_crossing(other.joints, self.space, radius=self.scope.radius) is None:
                    tried.append(other)
        calm = [one for one in tried if one.step_ratio <= STEP_RATIO_MAX]
        if calm:
            best = max(calm, key=lambda one: one.certificate.clearance)
        else:
            best = min(tried, key=lambda one: one.step_ratio)
        return replace(best, candidates=tuple(one.summarise() for one in tried))

    def shape(
        self, base: NDArray[np.float64], margin: float, *, thorough: bool = False
    ) -> ShapedPath:
        """Shape a way in the world frame for the scope's radius and a margin beyond it."""
        points = np.ascontiguousarray(self.duct.to_grid(base))
        return self.band(margin).shape(points, thorough=thorough)

    def try_path(
        self, base: NDArray[np.float64], margin: float, *, thorough: bool = True
    ) -> TubeMotion | None:
        """Shape `base`, move along it, certify; None (with the reason kept) where that fails."""
        shaped = self.shape(base, margin, thorough=thorough)
        if not shaped.clear:
            self.failed = shaped
            return None
        return self.follow(shaped, margin)

    def follow(self, shaped: ShapedPath, margin: float) -> TubeMotion | None:
        """Move along a shaped path and certify; None (with the reason kept) where that fails."""
        if measure_folds(shaped, self.scope.link_length).min() < FOLD_COSINE:
            self.fold = shaped
            return None
        motion = self.move(shaped, margin)
        if not motion.certificate.certified or motion.refusal is not None:
            # Joints on the path turn less and stay clearer, though they move more.
            other = self.move(shaped, margin, freedom=0.0)
            if other.certificate.certified and (
                other.refusal is None
                or not motion.certificate.certified
                or len(other.joints) > len(motion.joints)
            ):
                motion = other
        if not motion.certificate.certified:
            motion = self.prove(motion)
        if not motion.certificate.certified:
            self.unresolved = motion.certificate
            return None
        crossing = find_crossing(motion.joints, self.space, radius=self.scope.radius)
        if crossing is not None:
            self.crossing = crossing
            return None
        return motion

    def follow_until(self, shaped: ShapedPath, margin: float) -> TubeMotion | None:
        """Move along a shaped path as far as it is clear, unfolded and certified.

        What cuts it off is kept in `bind`.
        """
        for _ in range(CUTS):
            arc = shaped.clear_until
            if arc < shaped.length:
                self.bind = self._bind_link(shaped, margin)
            folded = np.flatnonzero(measure_folds(shaped, self.scope.link_length) < FOLD_COSINE)
            if len(folded) and float(shaped.arc_length[folded[0] - 1]) < arc:
                arc = float(shaped.arc_length[folded[0] - 1])
                self.bind = self._bind_fold()
            if arc <= self.options.head_step:
                return None
            shaped = cut_path(shaped, arc)
            motion = self.follow(shaped, margin)
            if motion is None and self.crossing is not None:
                self.bind = self._bind_crossing(self.crossing)
            if motion is not None or self.unresolved is None:
                return motion
            self.bind = self._bind_proof(self.unresolved)
            # Cut where the certificate fails; the chain there may stand anywhere on its way.
            heads = spread_heads(shaped.length, self.options)
            reached = float(heads[: int(self.unresolved.step) + 1].max())
            shaped = cut_path(shaped, min(reached, shaped.length) - 1.0)
        return None

    def _bind_link(self, shaped: ShapedPath, margin: float) -> Bind:
        what = (
            f"link 1, that of the head, does not fit there with its {self.scope.link_length:g} "
            f"mm: it needs {tell_needs(self.scope.radius, shaped.lacks, margin)}, the best "
            f"path found has {floor_mm(shaped.lacks)} mm"
        )
        return Bind(code="LINK_TOO_LONG", what=what)

    def _bind_fold(self) -> Bind:
        limit = math.degrees(math.acos(FOLD_COSINE))
        what = (
            f"link 1, that of the head, of {self.scope.link_length:g} mm, would stand across its "
            f"path by more than {limit:.0f} deg in the bend there"
        )
        return Bind(code="FOLD", what=what)

    def _bind_crossing(self, crossing: Crossing) -> Bind:
        what = f"a link would pass through the wall there, to {crossing.far:.1f} mm of the line"
        return Bind(code="LIMBS_JOINED", what=what)

    def _bind_proof(self, proof: Certificate) -> Bind:
        behind = max(proof.link - 1, 0) * self.scope.link_length
        what = (
            f"the clearance of link {proof.link}, {behind:g} mm behind the head, could not be "
            f"proved farther (bound {floor_mm(proof.clearance)} mm)"
        )
        return Bind(code="CERTIFICATE_UNRESOLVED", what=what)

    def bind_lumen(self, beyond: float = 0.0) -> Bind:
        """Return where the lumen is too narrow beyond a place of the line, for whatever link."""
        radius, margin, arc = self.scope.radius, MARGINS[-1], self.line.arc_length
        what = f"no way was found beyond that is wide enough for a diameter of {2.0 * radius:g} mm"
        narrow = np.flatnonzero((self.bound < radius + margin) & (arc >= beyond))
        if len(narrow):
            offers = float(self.bound[narrow[0]])
            what += (
                f": the scope needs {tell_needs(radius, offers, margin)}, at "
                f"{arc[narrow[0]]:.1f} mm of the centreline the lumen has {floor_mm(offers)} mm"
            )
        return Bind(code="HEAD_CLEARANCE", what=what)

    def prove(self, motion: TubeMotion) -> TubeMotion:
        """Return a motion with its certificate settled as far as that can be."""
        proof = certify_motion(motion.joints, self.space, radius=self.scope.radius)
        return replace(motion, certificate=proof)

    def move(
        self, shaped: ShapedPath, margin: float, *, freedom: float | None = None
    ) -> TubeMotion:
        """Move the chain along a shaped path, and certify what comes out."""
        freedom = self.style.freedom if freedom is None else freedom
        band, standing = self.band(margin), self.standing
        if standing is None:
            heads = spread_heads(shaped.length, self.options)
            back = np.arange(self.links + 1) * band.length
            chain = shaped.points[shaped.first] + back[:, None] * self.space.pack().introducer[3:6]
        else:
            heads, chain = standing.spread(shaped.length, self.options.head_step), standing.chain
        joints = np.empty((len(heads), self.links + 1, 3))
        joints[0] = chain
        move_in_tube(band, shaped, heads, joints, freedom=freedom, slip=self.options.slip)
        world = self.duct.to_world(joints)
        refusal = None
        limit = self.options.angle_limit
        if limit is not None and self.links > 1:
            angles = measure_angles(world)
            over = np.flatnonzero(angles.max(axis=1) > limit)
            if len(over):
                joint = int(np.argmax(angles[over[0]])) + 1
                head = world[over[0], 0]
                near = int(np.argmin(np.linalg.norm(self.line.points - head, axis=1)))
                refusal = Refusal.at_angle(
                    limit, float(heads[over[0]]), at=float(self.line.arc_length[near]), joint=joint
                )
                keep = max(1, int(over[0]))
                world, heads = world[:keep], heads[:keep]
        motion = self._make(world, heads, self.duct.to_world(shaped.points[shaped.first :]))
        return replace(motion, refusal=refusal, shaped=shaped, freedom=freedom, margin=margin)

    def stand_still(self, refusal: Refusal) -> TubeMotion:
        """Return the motion that does not begin."""
        joints = self.space.tube.place_chain(self.links + 1, self.scope.link_length)[None]
        motion = self._make(joints, np.zeros(1), self.line.points[:2])
        return replace(motion, refusal=refusal, freedom=1.0)

    def _make(
        self, joints: NDArray[np.float64], heads: NDArray[np.float64], path: NDArray[np.float64]
    ) -> TubeMotion:
        proof = certify_motion(joints, self.space, radius=self.scope.radius, settle=False)
        return TubeMotion(joints=joints, head_arc_length=heads, path=path, certificate=proof)


def spread_heads(length: float, options: PlannerOptions) -> NDArray[np.float64]:
    """Return the head's arc length at each step of the route."""
    parts = [np.zeros(1)]
    for share in options.route:
        last, target = float(parts[-1][-1]), share * length
        count = max(1, int(np.ceil(abs(target - last) / options.head_step - 1e-9)))
        parts.append(last + (target - last) * np.arange(1, count + 1) / count)
    return np.concatenate(parts)


def move_in_tube(
    band: Band,
    shaped: ShapedPath,
    heads: NDArray[np.float64],
    joints: NDArray[np.float64],
    *,
    freedom: float = 1.0,
    slip: float = 0.0,
) -> None:
    """Fill `joints` (steps, joints, 3) with a chain whose head is at `heads` on a shaped path.

    All in the duct's own frame. It starts from the chain in `joints[0]`, which is replaced.
    """
    from .kernels.path import tabulate_tube
    from .kernels.tractrix import move_in_tube as move

    space, length = band.space.pack(), float(band.length)
    points, first, cap = shaped.points, shaped.first, DEVIATION_CAP * length
    tube = np.zeros(len(points))
    if freedom > 0.0:
        tabulate_tube(space, points, first, length, band.clearance, cap, TUBE_SLOPE, tube)
    arc, chain, places = shaped.arc_length, joints[0].copy(), np.empty(joints.shape[1])
    move(
        points, arc, tube, heads, length, DEVIATION_CAP, float(slip), float(freedom), chain,
        places, joints,
    )  # fmt: skip


# When the goal is out of reach: why, and how far a motion goes.

PREFIX_TRIES = 16
"""How many ways to go further are tried."""

GUIDE_TRIES = 3
"""How many ends of a way beside the centreline are tried."""

PREFIX_GAP_MM = 1.0
"""The search for a way to go further ends when it could gain less than this."""


def explain_stop(job: TubeProblem) -> Refusal:
    """State why the goal was not reached, after every attempt at the whole way has failed."""
    radius, duct, line = job.scope.radius, job.duct, job.line
    goal = float(job.bound[-1])
    entry, slack = float(job.bound[0]), MARGINS[-1]
    passage = None
    if entry > 0.0 and (job.passages.grid is not None or goal > 0.0):
        passage = job.passages.passage
        at = _locate(job, passage.place)
    if entry < radius + slack:
        return Refusal.at_entry(job.scope, entry, slack=slack if entry >= radius else 0.0)
    if passage is not None:
        near_goal = line.length - at <= max(job.scope.diameter, 3.0)
        if passage.bound < radius and not (near_goal and goal < radius):
            shown = floor_beside(radius, passage.bound)
            return Refusal(
                code="NO_PASSAGE",
                at=at,
                needs=radius,
                offers=passage.bound,
                what=f"does not fit at {at:.1f} mm of the centreline: the scope needs "
                f"{shown[0]} mm from its axis to the wall, and no way through has more than "
                f"{shown[1]} mm (proved)",
            )
    if goal < radius + slack:
        return Refusal(
            code="GOAL_CLEARANCE",
            at=line.length,
            needs=radius + slack,
            offers=goal,
            what=f"does not fit at the goal, {line.length:.1f} mm of the centreline: the scope "
            f"needs {tell_needs(radius, goal, slack)}, the lumen is "
            f"sure to have "
            f"{floor_mm(goal)} mm there",
        )
    base = job.find_base(radius + slack)
    if base is None or (base is job.widest and job.largest_link == 0.0):
        if passage is not None:
            at = _locate(job, passage.place)
            return _no_path(job, at, passage.level, passage.bound)
        at = float(line.arc_length[int(np.argmin(job.bound))])
        return _no_path(job, at, float(job.bound.min()), math.inf)
    if job.crossing is not None:
        near, far = job.crossing.near, job.crossing.far
        place = ", ".join(f"{value:.1f}" for value in job.crossing.point)
        return Refusal(
            code="LIMBS_JOINED",
            at=near,
            needs=radius,
            offers=0.0,
            what=f"links of {job.scope.link_length:g} mm would pass from {near:.1f} mm to "
            f"{far:.1f} mm of the centreline through the wall between them, near ({place}) mm, "
            "which only the moved wall opens",
        )
    if job.fold is not None:
        folds = measure_folds(job.fold, job.scope.link_length)
        at = _locate(job, duct.to_world(job.fold.points[int(np.argmin(folds))]))
        return Refusal(
            code="FOLD",
            at=at,
            needs=radius,
            offers=job.fold.clearance,
            what=f"links of {job.scope.link_length:g} mm would fold back in the bend at "
            f"{at:.1f} mm of the centreline",
        )
    if job.failed is not None:
        at = _locate_tightest(job, job.failed)
        return Refusal(
            code="LINK_TOO_LONG",
            at=at,
            needs=radius + slack,
            offers=job.failed.clearance,
            link_shaped=job.largest_link or None,
            what=f"links of {job.scope.link_length:g} mm do not fit at {at:.1f} mm of the "
            f"centreline: they need {tell_needs(radius, job.failed.clearance, slack, 'their')}, "
            f"the best path found has {floor_mm(job.failed.clearance)} mm{_mention_grid(job)}",
        )
    return _unresolved(job)


def _mention_grid(job: TubeProblem) -> str:
    """Return a remark where the grid, not the lumen, may be what is too narrow."""
    if job.passages.grid is None or job.duct.error < 0.25 * job.scope.radius:
        return ""
    hidden = ceil_mm(job.duct.error)
    return f" (not proved: the grid may hide up to {hidden} mm, try a smaller --voxel)"


def find_prefix(
    job: TubeProblem, refusal: Refusal, *, progress: Progress = no_progress
) -> TubeMotion:
    """Go as far as it certifiably goes.

    A guide leads as far as any way with clearance does. Paths along it are shaped, whole and in
    parts, and each is followed up to where it is clear, unfolded and certified; where a part ends
    is found by bisection. The path's end is free: it is cut, and its last links move back with it.
    """
    margin = MARGINS[-1]
    guide = _find_guide(job, job.scope.radius + margin)
    if guide is None:
        return job.stand_still(refusal.stop_at(0.0, job.bind_lumen()))
    arcs = measure_arc_length(guide)
    best, reached, low = None, 0.0, 0.0
    arc = high = float(arcs[-1])
    shaped, bind = job.failed, None
    beyond = job.bind_lumen(_locate(job, guide[-1]))  # what ends a way that is longer
    for tries in range(PREFIX_TRIES):
        progress("plan", tries / PREFIX_TRIES)
        if shaped is None:
            count = int(np.searchsorted(arcs, arc, "right"))
            if count < 3:
                break
            shaped = job.shape(guide[:count], margin, thorough=tries == 0)
        job.bind = job.crossing = None
        motion, shaped, end = job.follow_until(shaped, margin), None, 0.0
        if motion is not None:
            end = _locate_on(guide, arcs, motion.path[-1])
            if best is None or end > reached:
                best, reached, bind = motion, end, job.bind
            if motion.refusal is not None:
                break
        if end < arc - PREFIX_GAP_MM:
            beyond = job.bind or beyond
            high, low = arc, max(low, reached)
        else:
            low = arc
        if high - low < PREFIX_GAP_MM:
            break
        arc = 0.5 * (low + high)
    if best is None:
        return job.stand_still(refusal.stop_at(0.0, beyond))
    if best.refusal is not None:
        return best
    if job.style.compare:
        best = job.improve(best)
    return replace(best, refusal=refusal.stop_at(_locate(job, best.path[-1]), bind or beyond))


def _stop_before_goal(job: TubeProblem, motion: TubeMotion) -> TubeMotion:
    """Return a motion that ends far from a goal that is too narrow, with what stops it there.

    The way up to where the lumen is wide enough again is tried by itself: if it can be gone, that
    is the motion.
    """
    refusal = motion.refusal
    if refusal is None or refusal.code != "GOAL_CLEARANCE" or refusal.ends_at is None:
        return motion
    wide = np.flatnonzero(job.bound >= job.scope.radius + MARGINS[-1])
    arc = float(job.line.arc_length[wide[-1]]) if len(wide) else 0.0
    if arc - refusal.ends_at <= NEAR_MM:
        return motion
    space = FreeSpace(job.duct, job.line.cut(arc), job.space.introducer)
    before = TubeProblem(space, job.scope, job.options, job.style, links=job.links)
    farther = before.try_whole_way()
    if farther is None:
        bind = Bind(code=refusal.ends_code, what=refusal.ends_what)
        return replace(motion, refusal=explain_stop(before).stop_at(refusal.ends_at, bind))
    if job.style.compare:
        farther = before.improve(farther)
    bind = job.bind_lumen(arc)
    return replace(farther, refusal=refusal.stop_at(_locate(job, farther.path[-1]), bind))


def _find_guide(job: TubeProblem, clearance: float) -> NDArray[np.float64] | None:
    """Return the way (n, dim) with a clearance that goes farthest along the centreline."""
    points = job.line.points
    fits = job.bound >= clearance
    grid = job.passages.grid
    if grid is None:
        reached = np.flatnonzero(fits)
        return points[: reached[-1] + 1] if len(reached) and reached[-1] > 1 else None
    from scipy import ndimage

    free = (grid.inflation - grid.values >= clearance) & (grid.values < 0.0)
    blocks, _ = ndimage.label(free, structure=np.ones((3, 3, 3)))
    nodes = np.rint(grid.to_grid(points) / grid.spacing).astype(int)
    nodes = np.clip(nodes, 0, np.array(grid.values.shape) - 1)
    marks = blocks[tuple(nodes.T)]
    straight = len(fits) if fits.all() else int(np.argmin(fits))
    if marks[0] != 0:
        beyond = np.flatnonzero((marks == marks[0]) & fits)[::-1]
        for last in beyond[beyond >= straight][: 3 * GUIDE_TRIES : 3]:
            base = find_clear_path(grid, points[0], points[last], clearance=clearance)
            if base is not None:
                return base
    return points[:straight] if straight > 2 else None


def _locate_on(
    guide: NDArray[np.float64], arcs: NDArray[np.float64], place: NDArray[np.float64]
) -> float:
    return float(arcs[int(np.argmin(np.linalg.norm(guide - place, axis=1)))])


def _locate(job: TubeProblem, place: NDArray[np.float64]) -> float:
    return _locate_on(job.line.points, job.line.arc_length, place)


def _locate_tightest(job: TubeProblem, path: ShapedPath) -> float:
    """Arc length on the centreline of the place where a shaped path is tightest [mm]."""
    nearest = int(np.argmin(np.abs(path.arc_length - path.tightest)))
    return _locate(job, job.duct.to_world(path.points[nearest]))


def _no_path(job: TubeProblem, at: float, level: float, bound: float) -> Refusal:
    radius, margin = job.scope.radius, MARGINS[-1]
    local = float(np.interp(at, job.line.arc_length, job.bound))
    return Refusal(
        code="HEAD_CLEARANCE",
        at=at,
        needs=radius + margin,
        offers=level,
        what=f"no way for links of any length was found at {at:.1f} mm of the centreline: the "
        f"scope needs {tell_needs(radius, max(level, local), margin)}, the "
        f"widest way found has "
        f"{floor_mm(max(level, local))} mm{_mention_grid(job)}",
    )


def _unresolved(job: TubeProblem) -> Refusal:
    certificate = job.unresolved
    remedy = ": use a smaller --voxel" if job.passages.grid is not None else ""
    proved = float("nan") if certificate is None else certificate.clearance
    at = 0.0 if certificate is None else _locate(job, certificate.place)
    return Refusal(
        code="CERTIFICATE_UNRESOLVED",
        at=at,
        needs=job.scope.radius,
        offers=job.scope.radius + min(proved, 0.0),
        what=f"a motion was found, but near {at:.1f} mm of the centreline its clearance could not "
        f"be proved (bound {floor_mm(proved)} mm){remedy}",
    )
