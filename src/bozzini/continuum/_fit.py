"""One robot fitted to one path: the job that every attempt of `actuate_plan` shares."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..duct.protocol import Duct
from ..motion import Introducer, Plan
from .arc_certificate import ArcCertificate
from .coupling import Coupling
from .executed import certify_arcs, find_base_frame, place_bodies

__all__ = ["Fit", "FitJob"]

Floats = NDArray[np.float64]

PITCH = 2.5
"""Distance between the points of the backbone that are held to the path, at most [mm]."""

LOOK = 1.0
"""Distance between the points whose clearance is estimated, at most [mm]."""

ROUNDS = 8
"""Iterations per step at most."""

TRAVEL_SLACK = 1e-5
"""How far tendons are kept inside their travel [mm]; they overstep what they are told by less."""

FINER = (0.02, 0.005)
"""Deviations of the certified chain, tried in turn [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
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

    def cut(self, end: int, *, begin: int = 0) -> Fit:
        """Return the steps before `end`, from `begin` on."""
        rows = slice(begin, end)
        return Fit(
            heads=self.heads[rows],
            bends=self.bends[rows],
            advances=self.advances[rows],
            displacements=self.displacements[rows],
            rms=self.rms[rows],
            largest=self.largest[rows],
            iterations=self.iterations[rows],
        )


class FitJob:
    """The inputs of a fit, prepared for the kernels."""

    def __init__(
        self,
        plan: Plan,
        coupling: Coupling,
        duct: Duct,
        introducer: Introducer,
        *,
        roll: float = 0.0,
    ) -> None:
        from ..duct.centreline import measure_arc_length

        robot = coupling.robot
        self.robot, self.coupling, self.duct, self.roll = robot, coupling, duct, roll
        self.introducer = introducer
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
        back = size < 1e-6  # the path turns on its heel
        tangents[back], size[back] = ways[np.minimum(np.flatnonzero(back), len(ways) - 1)], 1.0
        self.tangents = np.ascontiguousarray(tangents / size[:, None])
        origin = duct.to_grid(entry)
        self.placing = np.concatenate([duct.to_grid(entry + axes.T) - origin, origin[None]])

    def fit(self, room: float, *, limited: bool = True) -> Fit:
        """Fit all steps; the wall pushes where the body's room is less than `room` [mm]."""
        from ._actuate_kernels import fit_motion, measure_fit

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
            self.robot.radius + room,
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
        return Fit(
            heads=self.heads,
            bends=bends,
            advances=advances,
            displacements=bends.reshape(steps, -1) @ self.coupling.matrix.T,
            rms=rms,
            largest=largest,
            iterations=used,
        )

    def certify(self, fit: Fit) -> ArcCertificate:
        """Prove the clearance of a fit's motion; look closer where that settles it."""
        proof = None
        for deviation in FINER:
            proof = certify_arcs(
                self.robot,
                fit.bends,
                fit.advances,
                self.duct,
                introducer=self.introducer,
                roll=self.roll,
                deviation=deviation,
            )
            if proof.clearance >= 0.0 or proof.found + 2.0 * proof.deviation < 0.0:
                break
        if proof is None:
            raise RuntimeError("no deviation was tried")
        return proof

    def count_reached(self, fit: Fit) -> int:
        """Return how many steps the robot is long enough for."""
        short = np.flatnonzero(fit.advances >= self.robot.length - 1e-9)
        return int(short[0]) if len(short) else len(fit.heads)

    def keep_certified(self, fit: Fit) -> tuple[Fit, ArcCertificate]:
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

    def estimate_clearance(self, fit: Fit) -> tuple[Floats, NDArray[np.int64], Floats]:
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
