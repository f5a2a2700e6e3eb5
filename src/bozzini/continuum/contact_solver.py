"""The shape of least energy of a discrete rod outside walls: Newton's method on a Lagrangian.

Backbone, tendons and loads are those of `energy.EnergyModel` with ``channel`` segments, each with a
rotation vector ``w_j`` [rad], ``u_j`` at rest; ``x_i(w)`` are the stations, of radius ``rho_i``,
and ``c_i = -d(x_i) - rho_i`` their gaps to a wall by its smoothed signed distance::

    minimise   1/2 sum_j (w_j - u_j) . K_j (w_j - u_j) - work of the loads + potential of friction
    such that  c_i + e_i f_i >= 0 ,   sum_j l_kj - e_k T_k <= limit_k

with ``K_j = diag(EI, EI, GJ) / h_j`` and the compliances ``e`` of wall and tendons [mm/N]; equality
for rods that push, and tensions instead of lengths where these are commanded. The first frame is
fixed at the introducer's end. docs/theory/contact.md has the assumptions.

*Unknowns*: ``w`` (n, 3), base first, about x, y, z of the frame where the segment begins. Beside
them multipliers: forces ``f`` of w walls on n stations (w, n) [N], tensions ``T`` (t,) [N].

*Method*: an augmented Lagrangian. With the compliance ``r`` of the penalty and the last multiplier
``f0``, the force is the positive root of ``f (c + e f + r (f - f0)) = width^2 / (e + r)``, which
for width 0 is ``max(0, (r f0 - c) / (e + r))``. Each step is Newton's, with the contact stiffness
of a primal-dual method, a Hessian that is shifted until it is positive, and a line search; five
stages make penalty and width smaller. Loads without a potential take the tangent as it is. Coulomb
friction on the motion s since the last shape has the potential ``mu f (s - d / 2)``, and ``mu f s^2
/ 2 d`` below a slip d, with ``f`` held and updated in rounds.

*Ends* with a step that moves no station by 1e-7 mm and a gradient below 1e-8 of the moments that
act, or one that falls no more. `check_solution` takes it where the last step is at most 3e-4 mm,
gaps and lengths are within the tolerance, the gradient is below 1e-6, and the least eigenvalue of
the second variation is positive among motions that hold lengths and contacts.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from .energy import Grid, Segment
from .equilibrium import LumpedLoads, find_least_eigenvalue, vary_twice
from .kernels.contact import add_contacts, press_walls
from .kernels.energy import POINTS, fill_frames, measure_lengths
from .kernels.equilibrium import make_state, measure_equilibrium
from .kernels.loads import locate_stations, measure_loads
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .walls import Boundary, ContactOptions, Touched

SHIFT = 1e-4
"""Part of the first segment by which it is made longer for the derivative of the energy."""

SHORTEST = 0.3
"""A first segment shorter than this part of the next one is joined with it."""

ROTATION_LIMIT = 0.3
"""Largest rotation of a segment in one step of Newton's method [rad]."""

MOST_STEPS = 100
"""Steps of Newton's method for one shape."""

ROUGH_MM, STEP_MM = 0.02, 1e-7
"""Step below which the multipliers are taken over, and the last one [mm]."""

STILL_MM = 3e-4
"""Last step above which no equilibrium was found, where `STEP_MM` was not reached [mm]."""

BALANCED = 1e-8
"""Moment out of balance at which a shape is one of equilibrium, against the largest."""

WRONG = 1e-6
"""Moment out of balance at which it is none, against those that act."""

UNFELT = 1e-6
"""Force that counts as none, against the largest."""

STALE = 4
"""Steps without progress of the balance after which the rest of it is round-off."""

NEAR_MM = 0.02
"""What gaps and lengths may miss where the penalty is made harder [mm]."""

TENDON_SHARE = 1e-3
"""Compliance by which a tendon's length is held in a step, against the backbone's to its pull."""

FRICTION_ROUNDS = 40
"""Rounds in which the normal forces of friction settle."""

FRICTION_SHARE = 1e-5
"""Change of the normal forces at which they have settled, against the largest."""

FAR = 5.0
"""Radii of the body beyond which a step is not taken, but a shorter one, of a shifted Hessian."""

PERTURBATION_MM, PERTURBATION_RAD = 0.03, 0.03
"""Step below which an unstable shape is left, and the largest rotation by which it is."""

CHECKS, DEEP = 4, 0.1
"""Places of a segment where its depth in walls is checked, and the most, by the body's radius."""

SHIFTS = (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4)
"""Shares of the backbone's stiffness that are added where the energy is not convex."""


@dataclass(frozen=True, eq=False)
class FreePart(Grid):
    """The part of a robot beyond an introducer, cut into segments.

    `cut` is the arc length where it begins [mm], `stations` are those of the whole robot, `whole`
    is the grid on these, and `idle` are the tendons that have no tension.
    """

    segment: Segment = "channel"
    between: int = 0
    stations: Floats = field(kw_only=True)
    cut: float = field(default=0.0, kw_only=True)
    whole: FreePart | None = field(default=None, kw_only=True)
    idle: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_), kw_only=True)

    @cached_property
    def first(self) -> int:
        """Index of the first station beyond the cut that ends a segment."""
        index = int(np.searchsorted(self.stations, self.cut + ROUND_OFF_MM))
        last = len(self.stations) - 1
        if index < last:
            gap = self.stations[index] - self.cut
            if gap < SHORTEST * (self.stations[index + 1] - self.stations[index]):
                index += 1
        return min(index, last)

    @cached_property
    def arc_length(self) -> Floats:
        """Ends of the segments [mm], shape (n + 1,)."""
        return np.concatenate([[self.cut], self.stations[self.first :]])

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Segments that each tendon passes; not one that it ends in, shape (t,); 0 of idle ones."""
        ends = self.robot.tendon_ends + ROUND_OFF_MM
        counts = np.searchsorted(self.arc_length[1:], ends, "right").astype(np.int64)
        return np.where(self.idle, 0, counts) if len(self.idle) else counts

    @cached_property
    def paths(self) -> Floats:
        """Places of tendons in cross-sections: channels have `_guides` instead."""
        return np.zeros((len(self.counts), len(self.arc_length), 2))

    @cached_property
    def _guides(self) -> Floats:
        if self.whole is None:
            return super()._guides
        guides = self.whole._guides[:, self.first - 1 :].copy()
        guides[:, :1] = self.shifted[1]._guides
        return guides

    @cached_property
    def stiffness(self) -> Floats:
        """Moment by rotation of each segment about x, y and z [N mm/rad], shape (n, 3)."""
        if self.whole is None:
            return super().stiffness
        return np.concatenate([self.shifted[1].stiffness, self.whole.stiffness[self.first :]])

    @cached_property
    def rest(self) -> Floats:
        """Turns of the segments at rest, shape (n, 3) [rad]."""
        if self.whole is None:
            return super().rest
        return np.concatenate([self.shifted[1].rest, self.whole.rest[self.first :]])

    @cached_property
    def shifted(self) -> tuple[FreePart, ...]:
        """The first segment alone, from a cut a little before, at, and a little after its own."""
        step, ends = SHIFT * self.spans[0], self.arc_length[:2]
        cuts = self.cut + step * np.array([-1.0, 0.0, 1.0])
        parts = tuple(FreePart(self.robot, stations=ends, cut=float(cut)) for cut in cuts)
        spans, middles = (ends[1] - cuts)[:, None], 0.5 * (ends[1] + cuts)
        stiffness = self.robot.stiffness_at(middles)[:, None, 3:] / spans[:, None]
        rest = self.robot.curvature_at(middles)[:, None] * spans[:, None]
        places = cuts[:, None] + spans * POINTS
        guides = np.zeros((3, len(self.counts), 1, len(POINTS), 4))
        for row, (tendon, count) in enumerate(zip(self.robot.tendons, self.counts, strict=True)):
            if count > 0:
                guides[:, row, 0, :, :2] = tendon.place_at(places)
                guides[:, row, 0, :, 2:] = tendon.slope_at(places)
        for part, *own in zip(parts, guides, stiffness, rest, strict=True):
            part.__dict__.update(zip(("_guides", "stiffness", "rest"), own, strict=True))
            part.__dict__["counts"] = np.minimum(self.counts, 1)
        return parts

    @cached_property
    def middles(self) -> Floats:
        """Middles of the segments from the cut on [mm], shape (n,)."""
        return 0.5 * (self.arc_length[1:] + self.arc_length[:-1]) - self.cut

    @cached_property
    def tributary_lengths(self) -> Floats:
        """Tributary length of each station but the first [mm], shape (n,)."""
        tributary_lengths = 0.5 * self.spans
        tributary_lengths[:-1] += 0.5 * self.spans[1:]
        return tributary_lengths

    @cached_property
    def radii(self) -> Floats:
        """Radius of the body at the points but the first [mm], shape (n,)."""
        return measure_radii(self.robot, self.arc_length[1:])

    @cached_property
    def flexibility(self) -> Floats:
        """Flexibility of each tendon's length where nothing else holds the robot, (t,) [mm/N]."""
        reach = np.mean(np.sum(self._guides[..., :2] ** 2, axis=-1), axis=-1)
        return np.asarray(np.sum(reach / self.stiffness[:, 0], axis=-1))

    @cached_property
    def penalty(self) -> Floats:
        """Compliance by which a point's contact is first tried, (n,) [mm/N]."""
        return np.asarray(0.25 * self.spans**2 / self.stiffness[:, 0])


@dataclass(eq=False)
class ContactState:
    """Rotation vectors (n, 3) and multipliers: contact forces (w, n) [N], tensions (t,) [N].

    `expected` (w, n) are the forces that the last step predicts here [N].
    """

    rotation_vectors: Floats
    forces: Floats
    tensions: Floats
    expected: Floats


Contacts = tuple[NDArray[np.int64], Touched]
"""The walls of contacts, and their smooth gaps."""


class Stage(NamedTuple):
    """How hard the penalty is against that of a segment, and where contact begins softly [mm]."""

    softness: float
    width: float


WIDTHS_MM = (0.02, 2e-3, 1e-4, 1e-6, 1e-9)
"""Distances over which contact begins, stage by stage of the solver [mm]."""

LEAST_SOFT = 10.0
"""Least compliance of the penalty in the first stage, against a segment's."""

SOFT_SHARE = 0.3
"""Share of the body's radius by which all loads press it in in the first stage."""

HARDNESS = (0.3, 0.03)
"""Compliance of the penalty against a segment's in the last two stages."""

WARM = 2
"""The stage at which a shape begins that follows another one."""


@dataclass(frozen=True, eq=False)
class Slip:
    """Where the points were before, (n, 3), and the contacts on which they rub, as of `locate`."""

    before: Floats
    normals: Floats
    forces: Floats


class WallReaction(NamedTuple):
    """Reactions of w walls on n stations, as `press_walls` fills them.

    Attributes
    ----------
    forces, stiffnesses : (w, n) ndarray
        Normal forces [N], and how they fall with the gap [N/mm].
    gap_gradients : (w, n, 3) ndarray
        Normals of the smooth walls, towards the inside, in world axes.
    body, expected_body : (n, 3) ndarray
        Force on each station, and that of the predicted forces [N].
    bare, blocks : (n, 3, 3) ndarray
        Stiffness against motion of the stations without and with that of the contacts [N/mm].
    gaps : (n,) ndarray
        Least gaps [mm].
    """

    forces: Floats
    stiffnesses: Floats
    gap_gradients: Floats
    body: Floats
    expected_body: Floats
    bare: Floats
    blocks: Floats
    gaps: Floats

    @classmethod
    def make(cls, walls: int, points: int) -> WallReaction:
        """Return arrays for so many walls and points."""
        forces, stiffnesses = np.empty((2, walls, points))
        body, expected_body = np.empty((2, points, 3))
        bare, blocks = np.empty((2, points, 3, 3))
        gap_gradients = np.empty((walls, points, 3))
        return cls(
            forces, stiffnesses, gap_gradients, body, expected_body, bare, blocks, np.empty(points)
        )


@dataclass(frozen=True, eq=False)
class Measure:
    """Energy with penalties at a shape, and what follows from it.

    `violation` is by how much gaps and lengths miss their conditions [mm], `length_gradients`
    (t, 3 n), gradient (3 n,) and Hessian (3 n, 3 n) are by the rotation vectors.
    """

    value: float
    points: Floats
    reaction: WallReaction
    friction_forces: Floats
    tensions: Floats
    length_gradients: Floats
    violation: float
    gradient: Floats
    hessian: Floats

    @property
    def body_forces(self) -> Floats:
        """Forces of walls on the points, friction included [N], world, (n, 3)."""
        return self.reaction.body + self.friction_forces

    def predict_forces(self, motion: Floats) -> Floats:
        """Return the contact forces to first order where the stations have moved by (n, 3)."""
        reaction = self.reaction
        change = reaction.stiffnesses * np.sum(reaction.gap_gradients * motion, axis=-1)
        return np.asarray(np.maximum(reaction.forces - change, 1e-3 * reaction.forces))


@dataclass(frozen=True, eq=False)
class ContactProblem:
    """What is minimised: elastic energy and potential, lengths of tendons, gaps to walls.

    Multipliers of an augmented Lagrangian: with gap c, compliance e of wall or tendon and that of
    the penalty r, the force is ``max(0, (r f - c) / (e + r))`` about the last one f. Rod, tendons
    and loads are those of `EnergyModel`; walls are asked for at each step, one call for all points.
    """

    part: FreePart
    lumped_loads: LumpedLoads
    boundaries: tuple[Boundary, ...]
    limits: Floats
    compliances: Floats
    options: ContactOptions
    slip: Slip | None = None

    @cached_property
    def base(self) -> Floats:
        """Frame of the first point in the world, (4, 4)."""
        return self.part.robot.base_frame

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Stages of the solver: the first so soft that loads press in part of the body's radius.

        A penalty that is hard from the start has a narrow valley for its least energy.
        """
        part, lumped_loads = self.part, self.lumped_loads
        length = float(part.spans.sum())
        load = (
            self.bend
            + lumped_loads.reach
            + float(np.linalg.norm(lumped_loads.moments, axis=1).sum()) / length
        )
        soft = float(part.radii.min()) / load / float(np.median(part.penalty))
        soft = min(max(SOFT_SHARE * soft, LEAST_SOFT), 1e3)
        return tuple(map(Stage, (soft, math.sqrt(soft), 1.0, *HARDNESS), WIDTHS_MM))

    @cached_property
    def bend(self) -> float:
        """A force across the part that bends it much [N]."""
        spans = self.part.spans
        return float((self.part.stiffness[:, 0] * spans).max() / spans.sum() ** 2)

    def find_felt(self, forces: Floats) -> NDArray[np.bool_]:
        """Return which forces of walls are not those of the smoothed beginning alone."""
        largest = max(float(forces.max(initial=0.0)), UNFELT * self.bend)
        return np.asarray(forces > UNFELT * largest)

    @cached_property
    def wall_compliance(self) -> Floats:
        """Of the wall at the points [mm/N], (n,)."""
        if self.options.wall_stiffness is None:
            return np.zeros(len(self.part.tributary_lengths))
        return np.asarray(1.0 / (self.options.wall_stiffness * self.part.tributary_lengths))

    @cached_property
    def tendon_penalty(self) -> Floats:
        """Compliance by which tendons are held in a step, (t,) [mm/N]."""
        return np.asarray(TENDON_SHARE * self.part.flexibility + 1e-15)

    @cached_property
    def stations(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """The points but the first, as kernels take them."""
        n = len(self.part.spans)
        return np.arange(n), np.ones(n), np.zeros((n, 3))

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Which tendons have a length, (t,); the others a tension."""
        return ~np.isnan(self.limits)

    @cached_property
    def cables(self) -> NDArray[np.bool_]:
        """Which of them only pull, (t,)."""
        return self.held & ~self.part.robot.pushes

    @cached_property
    def loaded_stations(self) -> tuple[tuple[NDArray[np.generic], ...], Floats, NDArray[np.bool_]]:
        """Stations where loads and walls act, moments there, and which forces follow the body."""
        lumped_loads, n = self.lumped_loads, len(self.part.spans)
        own = lumped_loads.segments, lumped_loads.parts, lumped_loads.offsets
        places = tuple(map(np.concatenate, zip(own, self.stations, strict=True)))
        moments = np.concatenate([lumped_loads.moments, np.zeros((n, 3))])
        return places, moments, np.concatenate([lumped_loads.follows, np.zeros(n, dtype=np.bool_)])

    def locate(self, rotation_vectors: Floats) -> Floats:
        """Return the points but the first from the base in the world's axes, (n, 3) [mm]."""
        n = len(self.part.spans)
        rotations, points = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
        fill_frames(self.part.packed, rotation_vectors, rotations, points)
        return np.asarray(points[1:] @ self.base[:3, :3].T)

    def find_contacts(self, points: Floats, held: Floats) -> Contacts:
        """Return walls and places of the smooth gaps that are small, or have a force (w, n)."""
        margin = float(self.part.radii.max())
        found = [
            wall.measure_near(points, self.part.radii, row > 0.0, margin)
            for wall, row in zip(self.boundaries, held, strict=True)
        ]
        rows = np.repeat(np.arange(len(found)), [len(item.places) for item in found])
        return rows, Touched(*map(np.concatenate, zip(*found, strict=True)))

    def measure(
        self,
        state: ContactState,
        stage: Stage,
        contacts: Contacts | None = None,
        *,
        bare: bool = False,
    ) -> Measure:
        """Return energy, forces and derivatives about the multipliers of `state`.

        `contacts` are those found before. The Hessian is that of the Lagrangian with the predicted
        forces; if `bare`, without the stiffness of tendons and contacts.
        """
        part, rotation_vectors = self.part, state.rotation_vectors
        n, count = len(part.spans), len(self.limits)
        rotation, points = self.base[:3, :3], self.locate(rotation_vectors)
        # Walls: forces, their potential and stiffness, then friction on them.
        rows, touched = self.find_contacts(points, state.forces) if contacts is None else contacts
        reaction = WallReaction.make(len(self.boundaries), n)
        value, violation = press_walls(
            (rows, *touched),
            (state.forces, state.expected),
            (self.wall_compliance, stage.softness * part.penalty),
            stage.width,
            reaction,
        )
        expected, blocks = reaction.expected_body, reaction.bare if bare else reaction.blocks
        friction_forces = np.zeros((n, 3))
        if self.slip is not None:
            potential, friction_forces, stiff = self._measure_friction(self.slip, points)
            value += potential
            expected, blocks = expected + friction_forces, blocks + stiff
        # Backbone, tendons and loads, the walls' predicted forces among these.
        filled = make_state(n, count)
        lengths, tensions, length_gradients, _, _, gradient, hessian = filled
        held = self.tendon_penalty
        tendons = self.compliances, self.held, self.cables, state.tensions, held
        places, moments, follows = self.loaded_stations
        loads = np.concatenate([self.lumped_loads.forces, expected @ rotation]), moments, follows
        rod = part.packed, part.rest, tendons, places, loads
        value += measure_equilibrium(rod, self.limits, rotation_vectors, state.tensions, filled)
        # The walls act as dead forces in the rod's kernel: their own potential is in their place.
        value += float(np.sum(expected * points))
        violation = max(
            violation, float(np.max(np.abs(held * (state.tensions - tensions)), initial=0.0))
        )
        # What the walls do beside those forces: their error, and the contacts' stiffness.
        errors = (expected - reaction.body - friction_forces) @ rotation
        add_contacts(
            part.packed, rotation_vectors, rotation.T @ blocks @ rotation, errors, gradient, hessian
        )
        rows = length_gradients.reshape(count, 3 * n)
        if not bare:
            taut = self.held & ((tensions > 0.0) | ~self.cables)
            hold = 1.0 / (self.compliances + held)[taut]
            hessian += rows[taut].T @ (hold[:, None] * rows[taut])
        return Measure(
            value=value,
            points=points,
            reaction=reaction,
            friction_forces=friction_forces,
            tensions=tensions,
            length_gradients=rows,
            violation=violation,
            gradient=gradient.ravel(),
            hessian=hessian,
        )

    def update_tensions(
        self, state: ContactState, found: Measure, rotation_vectors: Floats
    ) -> Floats:
        """Return the tensions (t,) that Newton's method on the lengths themselves takes."""
        hold = self.compliances + self.tendon_penalty
        taut = self.held & ((found.tensions > 0.0) | ~self.cables)
        change = np.where(
            taut, found.length_gradients @ rotation_vectors.ravel() / np.where(taut, hold, 1.0), 0.0
        )
        tensions = np.where(self.held, found.tensions + change, state.tensions)
        return np.where(self.cables, np.maximum(tensions, 0.0), tensions)

    def measure_nonconservative_gradient(self, rotation_vectors: Floats) -> Floats:
        """Return the part of the gradient that loads without a potential have, (3 n,)."""
        lumped_loads = self.lumped_loads
        gradient = np.zeros((len(rotation_vectors), 3))
        if not lumped_loads.have_potential:
            hessian = np.empty((rotation_vectors.size, rotation_vectors.size))
            forces = np.where(lumped_loads.follows[:, None], lumped_loads.forces, 0.0)
            places = lumped_loads.segments, lumped_loads.parts, lumped_loads.offsets
            loads = forces, lumped_loads.moments, lumped_loads.follows
            measure_loads(self.part.packed, rotation_vectors, places, loads, gradient, hessian)
        return gradient.ravel()

    def measure_loads(self, rotation_vectors: Floats) -> tuple[Floats, Floats, Floats]:
        """Return places [mm], forces [N] and moments [N mm] of all loads in the world, (p, 3)."""
        lumped_loads = self.lumped_loads
        count = len(lumped_loads.parts)
        places, axes = np.empty((count, 3)), np.empty((count, 3, 3))
        jacobians = np.empty((count, 6, rotation_vectors.size))
        kept = lumped_loads.segments, lumped_loads.parts, lumped_loads.offsets
        locate_stations(self.part.packed, rotation_vectors, kept, places, axes, jacobians)
        axes[~lumped_loads.follows] = np.eye(3)
        axes = self.base[:3, :3] @ axes
        forces, moments = (
            (axes @ item[..., None])[..., 0] for item in (lumped_loads.forces, lumped_loads.moments)
        )
        return places @ self.base[:3, :3].T + self.base[:3, 3], forces, moments

    def measure_stability(self, state: ContactState, found: Measure) -> float:
        """Return the least eigenvalue of the second variation, as `LoadedRod` does.

        Among motions that keep the tendons' lengths and the contacts that have a force, or press
        into a wall that gives way.
        """
        n = len(self.part.spans)
        reaction = found.reaction
        settled = dataclasses.replace(state, tensions=found.tensions, expected=reaction.forces)
        # Hessian without the penalties, then what is held: taut tendons, contacts along normals.
        bare = self.measure(settled, self.stages[-1], bare=True)
        taut = self.held & ((found.tensions != 0.0) | self.part.robot.pushes)
        walls, places = np.nonzero(self.find_felt(reaction.forces))
        stations = tuple(np.ascontiguousarray(item[places]) for item in self.stations)
        jacobians = np.empty((len(places), 6, 3 * n))
        spare = np.empty((len(places), 3)), np.empty((len(places), 3, 3))
        locate_stations(self.part.packed, state.rotation_vectors, stations, *spare, jacobians)
        gap_gradients = reaction.gap_gradients[walls, places] @ self.base[:3, :3]
        rows = np.concatenate(
            [found.length_gradients[taut], np.einsum("ci,cij->cj", gap_gradients, jacobians[:, 3:])]
        )
        compliances = np.concatenate([self.compliances[taut], self.wall_compliance[places]])
        matrix = vary_twice(bare.hessian, self.part.stiffness.ravel(), rows, compliances)
        return find_least_eigenvalue(matrix, symmetric=self.lumped_loads.have_potential)

    def _measure_friction(self, slip: Slip, points: Floats) -> tuple[float, Floats, Floats]:
        """Return potential, forces (n, 3) and stiffnesses (n, 3, 3) of friction.

        Of the motion across the normals, see the module; beyond the slip the stiffness along the
        motion is 0.
        """
        small = self.options.slip
        move = points - slip.before
        move -= slip.normals * np.sum(slip.normals * move, axis=1, keepdims=True)
        size = np.sqrt(np.sum(move**2, axis=1))
        limit = self.options.friction * slip.forces
        sticks = size < small
        long = np.maximum(size, small)
        across = np.eye(3) - slip.normals[:, :, None] * slip.normals[:, None, :]
        way = move / long[:, None]
        turned = across - np.where(sticks, 0.0, 1.0)[:, None, None] * way[:, :, None] * way[:, None]
        potential = limit * np.where(sticks, 0.5 * size**2 / small, size - 0.5 * small)
        stiff = (limit / long)[:, None, None] * turned
        return float(np.sum(potential)), -(limit / long)[:, None] * move, stiff


@dataclass(eq=False)
class Solution:
    """Where the solver ends: state, its measure, steps, and what is known of stability."""

    state: ContactState
    found: Measure
    steps: int = 0
    moved: float = math.inf
    perturbed: bool = False
    stability: float = 0.0
    imbalance: float = math.inf
    rounds: int = 0


def factor(hessian: Floats, stiffness: Floats, start: int = 0) -> tuple[Floats, int]:
    """Return a Cholesky factor of the Hessian, and the index of the shift that it needs."""
    from scipy.linalg.lapack import dpotrf

    diagonal = np.arange(len(hessian))
    for index in range(start, len(SHIFTS)):
        shifted = 0.5 * (hessian + hessian.T)
        shifted[diagonal, diagonal] += SHIFTS[index] * stiffness
        lower, info = dpotrf(shifted, lower=1, overwrite_a=1)
        if info == 0:
            return lower, index
    return np.diag(np.sqrt(stiffness * SHIFTS[-1])), len(SHIFTS)


@dataclass(eq=False)
class ContactStep:
    """A step: rotation vectors (n, 3), largest motion of a station [mm], index of the shift."""

    rotation_vectors: Floats
    motion: float
    shift: int
    perturbed: bool = False


def find_step(task: ContactProblem, state: ContactState, found: Measure) -> ContactStep:
    """Return the step of Newton's method, of a Hessian that is made convex."""
    from scipy.linalg.lapack import dpotrs

    stiffness, radius = task.part.stiffness.ravel(), float(task.part.radii.min())

    def reach(rotation_vectors: Floats, shift: int) -> ContactStep:
        return ContactStep(
            rotation_vectors,
            measure_motion(task, state.rotation_vectors + rotation_vectors, found.points),
            shift,
        )

    if not task.lumped_loads.have_potential:
        # The tangent is not symmetric: as it is, where the step goes downwards or not far.
        rotation_vectors = np.asarray(
            -np.linalg.solve(found.hessian, found.gradient), dtype=np.float64
        )
        step = reach(rotation_vectors.reshape(-1, 3), 0)
        if step.motion < PERTURBATION_MM or (
            rotation_vectors @ found.gradient < 0.0 and step.motion < FAR * radius
        ):
            return step
    step = ContactStep(state.rotation_vectors, math.inf, -1)
    while step.motion > FAR * radius and step.shift < len(SHIFTS) - 1:
        # Almost singular: the quadratic model does not hold so far away.
        lower, shift = factor(found.hessian, stiffness, step.shift + 1)
        step = reach(-dpotrs(lower, found.gradient, lower=1)[0].reshape(-1, 3), shift)
    if step.shift > 0 and step.motion < PERTURBATION_MM and task.lumped_loads.have_potential:
        # Almost stationary, not a minimum: along the mode in which the energy is most concave.
        step = reach(find_descent_mode(found, stiffness), step.shift)
        step.perturbed = True
    return step


def minimise(task: ContactProblem, start: ContactState, first: int = 0) -> Solution:
    """Return the stable equilibrium that is reached from a state, by Newton's method."""
    state = start
    stages = task.stages
    index, last = first, len(stages) - 1
    found = task.measure(state, stages[index])
    solution = Solution(state, found)
    longest, stalled = float(task.part.radii.min()), 0
    for step in range(1, MOST_STEPS + 1):
        solution.steps = step
        stage = stages[index]
        # Newton's step, no longer than the quadratic model holds.
        newton_step = find_step(task, state, found)
        solution.perturbed |= newton_step.perturbed
        solution.moved = moved = newton_step.motion
        directional_derivative = float(newton_step.rotation_vectors.ravel() @ found.gradient)
        step_length = min(
            1.0, ROTATION_LIMIT / max(float(np.abs(newton_step.rotation_vectors).max()), 1e-300)
        )
        step_length = min(step_length, longest / max(moved, 1e-300))
        # Below round-off of the energy only the gradient is of use.
        below_round_off = newton_step.shift == 0 and -directional_derivative < 1e-10 * (
            abs(found.value) + 1e-9
        )
        # Loads without a potential stay as they are in the line search.
        nonconservative_derivative = float(
            newton_step.rotation_vectors.ravel()
            @ task.measure_nonconservative_gradient(state.rotation_vectors)
        )
        tensions = task.update_tensions(state, found, newton_step.rotation_vectors)
        # Line search on the augmented Lagrangian (Armijo).
        while True:
            rotation_vectors = state.rotation_vectors + step_length * newton_step.rotation_vectors
            points = task.locate(rotation_vectors)
            expected = found.predict_forces(points - found.points)
            tried = dataclasses.replace(state, rotation_vectors=rotation_vectors, expected=expected)
            contacts = task.find_contacts(points, state.forces)
            after = task.measure(tried, stage, contacts)
            value = after.value + step_length * nonconservative_derivative
            if (
                below_round_off
                or value <= found.value + 1e-4 * step_length * directional_derivative
                or step_length < 1e-9
            ):
                break
            step_length *= 0.5
        state, found = tried, after
        # After a whole step the multipliers follow, and the next stage begins.
        if step_length == 1.0 and newton_step.shift == 0:
            state = dataclasses.replace(state, tensions=tensions)
            if moved < ROUGH_MM:
                state = dataclasses.replace(state, forces=after.reaction.forces)
                if after.violation < NEAR_MM:
                    index = min(index + 1, last)
            if moved < ROUGH_MM or task.held.any():
                found = task.measure(state, stages[index], contacts)
        before, solution.imbalance = solution.imbalance, measure_imbalance(task, state, found)
        stalled = 0 if solution.imbalance < 0.5 * before else stalled + 1
        settled = solution.imbalance < BALANCED or stalled >= STALE
        violation = max(found.violation, after.violation)
        if moved < STEP_MM and index == last and settled and violation < task.options.tolerance:
            break
    solution.state, solution.found = state, found
    solution.stability = task.measure_stability(state, found)
    return solution


def measure_motion(task: ContactProblem, rotation_vectors: Floats, points: Floats) -> float:
    """Return the largest motion of a station to other rotations [mm]; infinite if far off."""
    if not np.abs(rotation_vectors).max() < math.pi:
        return math.inf
    return float(np.sqrt(np.max(np.sum((task.locate(rotation_vectors) - points) ** 2, axis=1))))


def find_descent_mode(found: Measure, stiffness: Floats) -> Floats:
    """Return rotations (n, 3) along which the energy is most concave, downwards."""
    from scipy.linalg import eigh

    scale = 1.0 / np.sqrt(stiffness)
    matrix = scale[:, None] * found.hessian * scale
    _, ways = eigh(matrix, subset_by_index=(0, 0), overwrite_a=True)
    way = scale * ways[:, 0]
    way *= PERTURBATION_RAD / np.abs(way).max()
    return np.asarray((-way if way @ found.gradient > 0.0 else way).reshape(-1, 3))


def measure_imbalance(task: ContactProblem, state: ContactState, found: Measure) -> float:
    """Return the moment by which a segment is out of balance, against those that act."""
    stiffness, lumped_loads = task.part.stiffness, task.lumped_loads
    arms = np.linalg.norm(found.points, axis=1)
    acting = float(np.linalg.norm(found.body_forces, axis=1) @ arms)
    acting += float(np.linalg.norm(lumped_loads.forces, axis=1) @ arms[lumped_loads.segments])
    acting += float(np.linalg.norm(lumped_loads.moments, axis=1).sum())
    bends = state.rotation_vectors - task.part.rest
    largest = max(float(np.abs(stiffness * bends).max()), acting)
    return float(np.abs(found.gradient).max()) / max(largest, 1e-6 * float(stiffness.max()))


def settle_friction(
    task: ContactProblem, start: ContactState, before: Floats | None, first: int
) -> Solution:
    """Return the equilibrium from a state, after the normal forces of friction have settled."""
    solution = minimise(task, start, first)
    if task.options.friction == 0.0 or before is None:
        return solution
    steps = solution.steps
    for round_ in range(FRICTION_ROUNDS):
        normals = solution.found.reaction.body
        size = np.sqrt(np.sum(normals**2, axis=1))
        slip = Slip(before, normals / np.maximum(size, 1e-300)[:, None], size)
        solution = minimise(dataclasses.replace(task, slip=slip), solution.state, WARM)
        steps += solution.steps
        solution.steps, solution.rounds = steps, round_ + 1
        change = np.abs(np.sqrt(np.sum(solution.found.reaction.body**2, axis=1)) - size)
        if change.max() <= FRICTION_SHARE * max(float(size.max()), 1e-9):
            return solution
    solution.rounds = FRICTION_ROUNDS + 1
    return solution


def check_solution(task: ContactProblem, solution: Solution) -> tuple[bool, str]:
    """Return whether a solution is an equilibrium, and else why not."""
    found, part = solution.found, task.part
    reaction = found.reaction
    if not np.isfinite(found.value):
        return False, "the shape that was found is not finite"
    deep = np.where(np.isfinite(reaction.gaps), reaction.gaps, 0.0)
    deep = deep + np.where(reaction.forces.max(axis=0) > 0, task.wall_compliance, 0.0) * np.sqrt(
        np.sum(reaction.body**2, axis=1)
    )
    worst = int(np.argmin(deep))
    if found.violation > task.options.tolerance and -deep[worst] > task.options.tolerance:
        return False, (
            f"there is no equilibrium outside the wall: at {part.arc_length[1 + worst]:.4g} mm the "
            f"body, of radius {part.radii[worst]:g} mm, is {-deep[worst]:.3g} mm in it"
        )
    if solution.moved > STILL_MM:
        return False, (
            f"no equilibrium in {solution.steps} steps: the last moved the body by "
            f"{solution.moved:.3g} mm"
        )
    if found.violation > task.options.tolerance:
        what = "a wall or a tendon's length" if task.held.any() else "a wall"
        return False, f"{what} is missed by {found.violation:.3g} mm"
    if solution.rounds > FRICTION_ROUNDS:
        return False, f"the forces of friction do not settle in {FRICTION_ROUNDS} rounds"
    if solution.imbalance > WRONG:
        return False, f"a segment is out of balance by a share of {solution.imbalance:.2g}"
    if solution.stability <= 0.0:
        return False, "unstable: the shape that was found buckles"
    return True, ""


def measure_depth(task: ContactProblem, solution: Solution) -> tuple[float, str]:
    """Return how deep the body is in a wall [mm], and what is wrong with that.

    Between points too, without smoothing, and beyond what the wall's compliance allows.
    """
    part, found = task.part, solution.found
    n, parts = len(part.spans), np.arange(1, CHECKS + 1) / CHECKS
    segments, parts = np.repeat(np.arange(n), CHECKS), np.tile(parts, n)
    places = part.arc_length[segments] + parts * part.spans[segments]
    points, axes = np.empty((len(parts), 3)), np.empty((len(parts), 3, 3))
    stations = segments, parts, np.zeros((len(parts), 3))
    locate_stations(
        part.packed,
        solution.state.rotation_vectors,
        stations,
        points,
        axes,
        np.empty((0, 6, 3 * n)),
    )
    points = points @ task.base[:3, :3].T + task.base[:3, 3]
    yielded = task.wall_compliance * np.sqrt(np.sum(found.reaction.body**2, axis=1))
    yielded = np.maximum(yielded, np.append(0.0, yielded[:-1]))[segments]
    radii = measure_radii(part.robot, places)
    deepest, words = 0.0, ""
    for wall in task.boundaries:
        depth = -wall.measure(points, radii) - yielded
        worst = int(np.argmax(depth))
        if depth[worst] > deepest:
            deepest = float(depth[worst])
            if deepest > DEEP * radii[worst] + float(wall.duct.error):
                words = (
                    f"at {places[worst]:.4g} mm the body, of radius {radii[worst]:g} mm, is "
                    f"{deepest:.3g} mm in a wall that its points miss: take a smaller "
                    "segment_length or smoothing"
                )
    return deepest, words


def measure_push(task: ContactProblem, solution: Solution) -> float:
    """Return how the least energy changes with the inserted length [N]: multipliers stay.

    Only the first segment changes; what is beyond it moves with its end.
    """
    part, found, rotation_vectors = task.part, solution.found, solution.state.rotation_vectors[:1]
    rotation = task.base[:3, :3]
    _, forces, _ = task.measure_loads(solution.state.rotation_vectors)
    beyond = task.lumped_loads.segments > 0
    force = (found.body_forces.sum(axis=0) + forces[beyond].sum(axis=0)) @ rotation
    inner = np.flatnonzero(~beyond)
    places = part.arc_length[0] + task.lumped_loads.parts[inner] * part.spans[0]
    count, values = len(task.limits), []
    for own in part.shifted[::2]:
        bent = rotation_vectors - own.rest
        value = 0.5 * float(np.sum(own.stiffness * bent**2))
        rotations, points = np.empty((2, 3, 3)), np.empty((2, 3))
        fill_frames(own.packed, rotation_vectors, rotations, points)
        value -= float(force @ points[1])
        if len(inner):
            stations = np.zeros(len(inner), dtype=np.int64), (places - own.cut) / own.spans[0]
            at, axes = np.empty((len(inner), 3)), np.empty((len(inner), 3, 3))
            jacobians = np.empty((len(inner), 6, 3))
            locate_stations(
                own.packed, rotation_vectors, (*stations, np.zeros_like(at)), at, axes, jacobians
            )
            value -= float(np.sum((forces[inner] @ rotation) * at))
        if count:
            lengths, length_gradients = np.empty(count), np.empty((count, 1, 3))
            full, spare = np.empty((2, 1, 3, 3))
            measure_lengths(
                own.packed, rotation_vectors, found.tensions, lengths, length_gradients, spare, full
            )
            value += float(np.sum(found.tensions * (lengths - own.straight.sum(axis=1))))
        values.append(value)
    return (values[0] - values[1]) / (2.0 * SHIFT * float(part.spans[0]))


def measure_radii(robot: RobotDesign, places: Floats) -> Floats:
    """Return the radius of the body at arc lengths [mm]."""
    radii = np.array([section.radius for section in robot.sections])
    return np.asarray(radii[robot.section_at(places)])
