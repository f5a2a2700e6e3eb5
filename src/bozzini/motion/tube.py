"""The default planner: shape the path for the link, then move joints freely inside a proved tube.

Section 5.3 of the thesis moves each joint least and looks at joints only; it cuts walls, locks,
and jumps. Here (a) the head path is bent until every chord of link length is clear, (b) it is
tabulated how far joints may stray from it with all links still clear, (c) joints take the
tractrix step inside that tube: no lock, bounded motion, exact lengths, no field query. The
certificate is made afterwards, on the motion itself, and decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..duct.centreline import Centreline, find_roomy_path
from ..duct.field import SampledField
from ..duct.protocol import Duct
from ..progress import Progress, no_progress
from .certify import Certificate, certify_motion
from .introducer import Introducer
from .measures import measure_angles
from .passage import Passage, find_passage
from .refusal import Refusal
from .scope import Scope
from .shape import ShapedPath, continue_length, measure_folds, shape_path

__all__ = ["TubeMotion", "TubeOptions", "move_in_tube", "plan_in_tube"]

MARGINS = (0.25, 0.12, 0.05)
"""Room beyond the radius that the path is shaped for, tried in turn [mm]."""

MARGIN_HOPE = 0.1
"""A margin is skipped if the last shape lacks more than this even for it [mm]."""

FOLD_COSINE = 0.25
"""Below this the chain would amplify the head's motion more than fourfold: a fold."""

DEVIATION_CAP = 0.3
"""Joints stray from the path by at most this fraction of a link."""

TUBE_SLOPE = 0.1
"""How fast the tube may widen along the path."""


@dataclass(frozen=True, kw_only=True)
class TubeOptions:
    """Options of the planner.

    Parameters
    ----------
    head_step : float
        How far the head moves per step [mm].
    freedom : float
        1: joints stray as far as the tube allows; 0: they follow the leader.
    slip : float
        Share of the head's move that a tail makes before it is pulled, 0 to 1 (Appendix C).
    angle_limit : float, optional
        Largest angle between neighbouring links [rad].
    route : sequence of float
        Fractions of the way that the head goes to in turn; (1,) is in, (1, 0, 1) in, out, in.
    """

    head_step: float = 0.25
    freedom: float = 1.0
    slip: float = 0.0
    angle_limit: float | None = None
    route: Sequence[float] = (1.0,)


@dataclass(frozen=True, kw_only=True, eq=False)
class TubeMotion:
    """A planned motion, and what is proved about it.

    Parameters
    ----------
    joints : (steps, joints, dim) float
        World frame [mm].
    head_arc_length : (steps,) float
        Along `path` [mm].
    path : (n, dim) float
        The shaped head path from the entry to where it ends, world frame [mm].
    certificate : Certificate
    refusal : Refusal or None
        Why it does not reach the goal.
    shaped : ShapedPath or None
        The path in the duct's own frame, to plan again from.
    """

    joints: NDArray[np.float64]
    head_arc_length: NDArray[np.float64]
    path: NDArray[np.float64]
    certificate: Certificate
    refusal: Refusal | None = None
    shaped: ShapedPath | None = field(default=None, repr=False)


def plan_in_tube(
    duct: Duct,
    line: Centreline,
    *,
    scope: Scope,
    introducer: Introducer,
    links: int,
    options: TubeOptions,
    progress: Progress = no_progress,
) -> TubeMotion:
    """Plan a certified motion as far as it goes, and say why it ends where it does."""
    from .limits import explain_stop, find_prefix

    job = Job(duct, line, scope, introducer, links, options)
    progress("plan", 0.0)
    room = float(duct.clearance_bound(line.points[0]))
    if room < scope.radius:
        return job.stand_still(explain_stop(job))
    motion = job.try_whole_way()
    progress("plan", 0.5)
    if motion is None:
        refusal = explain_stop(job)
        progress("plan", 0.7)
        motion = find_prefix(job, refusal)
    progress("plan", 1.0)
    return motion


class Job:
    """One planning job: the packed inputs, and the steps that every attempt shares."""

    def __init__(
        self,
        duct: Duct,
        line: Centreline,
        scope: Scope,
        introducer: Introducer,
        links: int,
        options: TubeOptions,
    ) -> None:
        self.duct, self.line, self.scope = duct, line, scope
        self.introducer, self.links, self.options = introducer, links, options
        self.data: Any = duct.pack()
        self.intro = introducer.pack(duct)
        self.lead = (links + 2) * scope.link_length
        self.bound = duct.clearance_bound(line.points)
        self.failed: ShapedPath | None = None
        self.fold: ShapedPath | None = None
        self.largest_link = 0.0
        self.unresolved: Certificate | None = None
        self.passage: Passage | None = None
        self.widest: NDArray[np.float64] | None = None
        self.bases: list[tuple[float, NDArray[np.float64]]] = []

    def try_whole_way(self) -> TubeMotion | None:
        """Plan to the goal with the largest margin that works, or return None."""
        for margin in MARGINS:
            base = self.find_base(self.scope.radius + margin)
            thorough = margin == MARGINS[-1]
            if not thorough and self.failed is not None:
                if self.failed.room < self.scope.radius + margin - MARGIN_HOPE:
                    continue
            motion = None if base is None else self.try_path(base, margin, thorough=thorough)
            if motion is not None:
                return motion
        base = self.find_base(self.scope.radius + MARGINS[-1])
        if base is None:
            return None
        shaped, self.largest_link = continue_length(
            self.data,
            self.intro,
            np.ascontiguousarray(self.duct.to_grid(base)),
            length=self.scope.link_length,
            room=self.scope.radius + MARGINS[-1],
            lead=self.lead,
        )
        return None if shaped is None else self.follow(shaped, MARGINS[-1])

    def find_base(self, room: float) -> NDArray[np.float64] | None:
        """Return a way to the goal whose points have `room`: the centreline, or another."""
        if self.bound[0] < room or self.bound[-1] < room:
            return None
        if self.bound.min() >= room:
            return self.line.points
        duct = self.duct
        if not isinstance(duct, SampledField):
            return self.line.points
        for level, known in self.bases:
            if level >= room:
                return known
        ends = self.line.points[0], self.line.points[-1]
        if self.passage is None:
            self.passage = find_passage(duct, *ends)
        if self.passage.level >= room:
            base = find_roomy_path(duct, *ends, room=room)
            if base is not None:
                self.bases.append((room, base))
                return base
        # The widest way along nodes: there may be room between them.
        if self.widest is None and self.passage.level > 0.0 and self.passage.bound >= room:
            self.widest = find_roomy_path(duct, *ends, room=self.passage.level - 1e-6)
        return self.widest if self.passage.bound >= room else None

    def try_path(
        self, base: NDArray[np.float64], margin: float, *, thorough: bool = True
    ) -> TubeMotion | None:
        """Shape `base`, move along it, certify; None (with the reason kept) where that fails."""
        shaped = shape_path(
            self.data,
            self.intro,
            np.ascontiguousarray(self.duct.to_grid(base)),
            length=self.scope.link_length,
            room=self.scope.radius + margin,
            lead=self.lead,
            thorough=thorough,
        )
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
            motion = replace(motion, certificate=self.certify(motion.joints, settle=True))
        if not motion.certificate.certified:
            self.unresolved = motion.certificate
            return None
        return motion

    def certify(self, joints: NDArray[np.float64], *, settle: bool) -> Certificate:
        """Certify a motion of this scope."""
        return certify_motion(
            joints,
            self.duct,
            radius=self.scope.radius,
            introducer=self.introducer,
            settle=settle,
        )

    def move(
        self, shaped: ShapedPath, margin: float, *, freedom: float | None = None
    ) -> TubeMotion:
        """Move the chain along a shaped path, and certify what comes out."""
        heads = spread_heads(shaped.length, self.options)
        joints = move_in_tube(
            self.data,
            self.intro,
            shaped,
            heads,
            length=self.scope.link_length,
            links=self.links,
            room=self.scope.radius + margin,
            freedom=self.options.freedom if freedom is None else freedom,
            slip=self.options.slip,
        )
        world = self.duct.to_world(joints)
        refusal = None
        limit = self.options.angle_limit
        if limit is not None and self.links > 1:
            over = np.flatnonzero(measure_angles(world).max(axis=1) > limit)
            if len(over):
                refusal = Refusal.at_angle(limit, float(heads[over[0]]))
                keep = max(1, int(over[0]))
                world, heads = world[:keep], heads[:keep]
        certificate = self.certify(world, settle=False)
        return TubeMotion(
            joints=world,
            head_arc_length=heads,
            path=self.duct.to_world(shaped.points[shaped.first :]),
            certificate=certificate,
            refusal=refusal,
            shaped=shaped,
        )

    def stand_still(self, refusal: Refusal) -> TubeMotion:
        """Return the motion that does not begin."""
        joints = self.introducer.place_chain(self.links + 1, self.scope.link_length)[None]
        certificate = self.certify(joints, settle=False)
        return TubeMotion(
            joints=joints,
            head_arc_length=np.zeros(1),
            path=self.line.points[:2],
            certificate=certificate,
            refusal=refusal,
        )

    def cut_line(self, arc: float) -> NDArray[np.float64]:
        """Return the centreline's points up to an arc length."""
        keep = int(np.searchsorted(self.line.arc_length, arc, "right"))
        return self.line.points[: max(keep, 2)]


def spread_heads(length: float, options: TubeOptions) -> NDArray[np.float64]:
    """Return the head's arc length at each step of the route."""
    parts = [np.zeros(1)]
    for share in options.route:
        last, target = float(parts[-1][-1]), share * length
        count = max(1, int(np.ceil(abs(target - last) / options.head_step - 1e-9)))
        parts.append(last + (target - last) * np.arange(1, count + 1) / count)
    return np.concatenate(parts)


def move_in_tube(
    data: Any,
    intro: NDArray[np.float64],
    shaped: ShapedPath,
    heads: NDArray[np.float64],
    *,
    length: float,
    links: int,
    room: float,
    freedom: float = 1.0,
    slip: float = 0.0,
) -> NDArray[np.float64]:
    """Move a chain with its head at `heads` along a shaped path; (steps, links + 1, 3).

    All in the duct's own frame. The chain starts straight in the introducer.
    """
    from ._path_kernels import tabulate_tube
    from ._tube_kernels import move_in_tube as move

    tube = np.zeros(len(shaped.points))
    if freedom > 0.0:
        tabulate_tube(
            data,
            intro,
            shaped.points,
            shaped.first,
            length,
            room,
            DEVIATION_CAP * length,
            TUBE_SLOPE,
            tube,
        )
    back = np.arange(links + 1) * length
    chain = shaped.points[shaped.first] + back[:, None] * intro[3:6]
    joints = np.empty((len(heads), links + 1, 3))
    move(
        shaped.points,
        shaped.arc_length,
        tube,
        heads,
        float(length),
        DEVIATION_CAP,
        float(slip),
        float(freedom),
        chain,
        -back.astype(np.float64),
        joints,
    )
    return joints
