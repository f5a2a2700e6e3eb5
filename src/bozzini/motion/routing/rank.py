"""How many tendons the whole way in takes, where one pose takes two.

A robot that follows its leader has, with its head at d, the curvature of the path shifted along it:
``kappa_d(s) = kappa(d - L + s)``. These curvatures are the columns of a matrix. With k tendons of
any routing they are, to first order, ``P T`` of rank k, so that in the mean square of the curvature
none is nearer than what the singular values beyond k leave (Eckart and Young 1936). That bounds the
curvature, in the linear law; positions are integrals of it, and small waves of curvature cost
little there. So positions are fitted too: with the singular vectors as routings, with routings
fitted to the positions, in the exact law, and with sections that bend evenly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...continuum.routing import (
    BackboneSteps,
    BackboneTrace,
    BendTarget,
    find_bends,
    fit_bend,
)
from ...errors import GeometryError, InputError
from ...progress import Progress, no_progress
from ...results import ClosedForm, Json, take_axes, to_plain
from ..plan import Plan
from .design import take_curve
from .options import InsertionRankOptions

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...numeric.arrays import Floats

WaySource = Literal["curvature", "positions", "sections"]
"""Where routings come from: singular vectors of the curvature, a fit of positions, or sections."""

MODE_MM = 8.0
"""Length of the robot for each coefficient of a routing."""

SLOPE_WEIGHT = 2.0
"""Weight of the slope of a mode, against places: mm for 1/mm."""

MOST_STEPS = 30
"""Steps of the fit of a pose."""

STRAIGHT_MM = 1e-3
"""A path within so much of a straight line asks for no routing [mm]."""

SETTLED = 1e-5
"""Change of a sum of squares, as a share, at which a fit ends."""

AMPLITUDE_WEIGHT = 3.0
"""Weight of amplitudes, the curvature that a routing gives, against places: mm for 1/mm."""


@dataclass(frozen=True, kw_only=True)
class Way:
    """How well a robot of some routings follows the whole way in.

    Parameters
    ----------
    source : {"curvature", "positions", "sections"}
        Where the routings come from.
    count : int
        Routings, or sections.
    cables : int
        Cables that take it: two a routing, three a section.
    bound : float
        Share of the curvature, in the mean square, that no routings of that number leave out less
        of; of sections the same for their two freedoms each.
    rms, largest : float
        Distance from the path [mm], in the linear law; in the mean square each pose counts alike.
    projected_rms, projected_largest : float, optional
        The same where the curvature, not the places, is nearest to the path's [mm].
    exact_rms, exact_largest : float, optional
        The same as `rms` in the exact law, and `tension_sum`, the largest sum of tensions on the
        way [N], and `slope`, the largest of a cable.
    """

    source: WaySource
    count: int
    cables: int
    bound: float
    rms: float
    largest: float
    projected_rms: float | None = None
    projected_largest: float | None = None
    exact_rms: float | None = None
    exact_largest: float | None = None
    tension_sum: float | None = None
    slope: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionRank(ClosedForm):
    """What the whole way in takes of a robot.

    Parameters
    ----------
    matrix : (2 m, poses) ndarray
        Curvature along the robot, x then y, for each pose of the head [1/mm].
    singular_values : (r,) ndarray
        Of the matrix [1/mm].
    insertions : (poses,) ndarray
        Where the head stands [mm].
    length : float
        Of the path and of the robot [mm].
    ways : tuple of Way
        What was tried.
    """

    matrix: Floats = field(repr=False)
    singular_values: Floats
    insertions: Floats = field(repr=False)
    length: float
    ways: tuple[Way, ...]

    @cached_property
    def tails(self) -> Floats:
        """For 0, 1, ... routings the least root sum of squares of curvature left out [1/mm]."""
        squares = np.append(np.cumsum(self.singular_values[::-1] ** 2)[::-1], 0.0)
        return np.asarray(np.sqrt(squares))

    @property
    def bounds(self) -> Floats:
        """The same as shares of the whole."""
        return np.asarray(self.tails / self.tails[0])

    def to_dict(self) -> Json:
        """Return the table as plain values."""
        return dict(
            to_plain(
                {
                    "length_mm": self.length,
                    "bound_share": self.bounds[: MOST_SHOWN + 1],
                    "ways": [_describe(way) for way in self.ways],
                    "scope": SCOPE,
                }
            )
        )

    def list_columns(self) -> dict[str, list[object]]:
        """Return the columns of `to_frame`, a row each way."""
        rows = [_describe(way) for way in self.ways]
        return {name: [row[name] for row in rows] for name in (rows[0] if rows else {})}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the distance from the path over the number of cables, and return the axes."""
        axes = take_axes(ax, x="cables", y="distance from the path, rms [mm]")
        for source, label in LABELS.items():
            own = [way for way in self.ways if way.source == source]
            if own:
                axes.plot([w.cables for w in own], [w.rms for w in own], "o-", label=label)
            own = [way for way in own if way.exact_rms is not None]
            if own:
                exact = [w.exact_rms for w in own if w.exact_rms is not None]
                axes.plot([w.cables for w in own], exact, "x--", label=f"{label}, exact law")
        axes.set_yscale("log")
        if self.ways:
            axes.legend(fontsize="small")
        return axes


LABELS: dict[WaySource, str] = {
    "curvature": "routings by singular vectors",
    "positions": "routings fitted to positions",
    "sections": "even sections",
}

MOST_SHOWN = 40
"""Numbers of routings whose bound a file states."""

SCOPE = (
    "The bound is on the mean square of curvature over all poses, in the linear law: no routings "
    "of that number do better there. It is no bound on positions."
)


def _describe(way: Way) -> Json:
    return {
        "source": way.source,
        "count": way.count,
        "cables": way.cables,
        "bound_share": way.bound,
        "rms_mm": way.rms,
        "max_mm": way.largest,
        "projected_rms_mm": way.projected_rms,
        "projected_max_mm": way.projected_largest,
        "exact_rms_mm": way.exact_rms,
        "exact_max_mm": way.exact_largest,
        "tension_sum_N": way.tension_sum,
        "slope_max": way.slope,
    }


def insertion_rank(
    curve: ArrayLike | Plan,
    *,
    options: InsertionRankOptions | None = None,
    progress: Progress = no_progress,
) -> InsertionRank:
    """Return how many tendons the whole way in takes, against sections with as many cables.

    Parameters
    ----------
    curve : (m, 3) array_like or Plan
        A path from the entry on, world frame [mm]; of a plan it is the head's. A robot as long as
        the path follows it.
    options : InsertionRankOptions, optional
    progress : Progress

    Returns
    -------
    InsertionRank

    Raises
    ------
    InputError
        If the curve is no curve in space, or more modes are asked for than there are coefficients
        or poses.
    GeometryError
        If the curve turns back at a point, or is straight.
    """
    options = options or InsertionRankOptions()
    target = fit_bend(take_curve(curve))
    if target.sharpest * target.steps.length**2 < 8.0 * STRAIGHT_MM:
        raise GeometryError(
            f"the curve is within {STRAIGHT_MM:g} mm of a straight line: no routing is needed"
        )
    job = _Insertion(target, options)
    values = np.linalg.svd(job.matrix, compute_uv=False)
    found = InsertionRank(
        matrix=job.matrix,
        singular_values=np.asarray(values, dtype=np.float64),
        insertions=target.steps.ends[job.heads],
        length=target.steps.length,
        ways=(),
    )
    most = min(job.basis.shape[1], len(job.heads))
    if max(options.modes, default=0) > most:
        raise InputError(
            f"modes is {max(options.modes)}: it must lie in [1, {most}] on this path of "
            f"{len(job.heads)} poses"
        )
    ways = []
    total = len(options.modes) + len(options.sections)
    for index, count in enumerate(options.modes):
        progress("rank", index / total)
        first = job.take_modes(count)
        ways.append(job.measure(first, "curvature", found.bounds, options))
        if options.rounds:
            better, poses = job.fit_routings(first, LinearLaw, options.rounds)
            if options.exact:
                law = partial(ExactLaw, options=options)
                better = min((first, better), key=lambda modes: job.sum_costs(law(modes)))
                better, poses = job.fit_routings(better, law, options.rounds)
            way = job.measure(better, "positions", found.bounds, options, poses)
            ways.append(job.take_nearer(way, poses) if options.exact else way)
    for index, count in enumerate(options.sections):
        progress("rank", (len(options.modes) + index) / total)
        modes = job.take_sections(count)
        ways.append(job.measure(modes, "sections", found.bounds, replace(options, exact=False)))
    progress("rank", 1.0)
    order = {source: index for index, source in enumerate(LABELS)}
    ways.sort(key=lambda way: order[way.source])
    return replace(found, ways=tuple(ways))


@dataclass(frozen=True, kw_only=True, eq=False)
class Modes:
    """Curvatures (2 m, 2, k) that amplitudes scale, x and y at the robot's Gauss points."""

    values: Floats
    slopes: Floats
    coefficients: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """One pose's fit: amplitudes (k,), rotation (3, 3) of its base, distances (j + 1, 3) [mm]."""

    amplitudes: Floats
    turn: Floats
    off: Floats
    trace: BackboneTrace
    slopes: Floats

    @property
    def cost(self) -> float:
        """Sum of squares of places and weighted amplitudes [mm^2]."""
        ridge = AMPLITUDE_WEIGHT * self.amplitudes
        return float(np.sum(self.off**2) + ridge @ ridge)


def shift_curvature(target: BendTarget, heads: NDArray[np.int64]) -> Floats:
    """Return the curvature along the robot, x then y, (4 n, poses), its head at these steps."""
    count = target.steps.count
    matrix = np.zeros((4 * count, len(heads)))
    for column, head in enumerate(heads):
        inside = target.curvature[: 2 * head]
        matrix[2 * (count - head) : 2 * count, column] = inside[:, 0]
        matrix[2 * (2 * count - head) :, column] = inside[:, 1]
    return matrix


class _Insertion:
    """The poses of a way in, whose curvature is the path's, shifted by whole steps."""

    def __init__(self, target: BendTarget, options: InsertionRankOptions) -> None:
        self.target, self.steps, stride = target, target.steps, options.stride
        self.scale = options.stiffness / options.offset_max
        self.count = count = target.steps.count
        self.heads = np.arange(count, 0, -stride)[::-1]
        self.matrix = shift_curvature(target, self.heads)
        self.coefficients = max(6, round(self.steps.length / MODE_MM))
        self.basis, self.slopes = self.steps.make_basis(self.coefficients)
        self.rough = SLOPE_WEIGHT**2 * self.slopes.T @ self.slopes

    def take_modes(self, count: int) -> Modes:
        """Return the first left singular vectors, as splines."""
        left = np.linalg.svd(self.matrix, full_matrices=False)[0][:, :count]
        rows = left.reshape(2, -1, count).transpose(1, 0, 2)
        flat = np.linalg.lstsq(self.basis, rows.reshape(len(rows), -1), rcond=None)[0]
        return self.make_modes(flat.reshape(-1, 2, count))

    def make_modes(self, coefficients: Floats) -> Modes:
        """Return modes of coefficients (c, 2, k), each scaled to at most 1."""
        values = np.einsum("mc,cak->mak", self.basis, coefficients)
        size = np.hypot(values[:, 0], values[:, 1]).max(axis=0)
        return Modes(
            values=values / size,
            slopes=np.einsum("mc,cak->mak", self.slopes, coefficients) / size,
            coefficients=coefficients / size,
        )

    def take_sections(self, count: int) -> Modes:
        """Return the modes of even sections, cut at whole steps."""
        edges = np.round(np.linspace(0, self.count, count + 1)).astype(int)
        values = np.zeros((2 * self.count, 2, 2 * count))
        for index in range(count):
            own = slice(2 * edges[index], 2 * edges[index + 1])
            values[own, 0, 2 * index] = values[own, 1, 2 * index + 1] = 1.0
        return Modes(values=values, slopes=np.zeros_like(values), coefficients=np.empty((0, 2, 0)))

    def measure(
        self,
        modes: Modes,
        source: WaySource,
        bounds: Floats,
        options: InsertionRankOptions,
        before: Sequence[Pose] = (),
    ) -> Way:
        """Return how near the poses come, in the linear law and in the exact one."""
        poses = self.fit_poses(LinearLaw(modes), before)
        rms, largest = _measure(poses)
        freedoms = modes.values.shape[2]
        count = freedoms // 2 if source == "sections" else freedoms
        way = Way(
            source=source,
            count=count,
            cables=(3 if source == "sections" else 2) * count,
            bound=float(bounds[min(freedoms, len(bounds) - 1)]),
            rms=rms,
            largest=largest,
        )
        if source == "curvature":
            rms, largest = _measure(self.project(modes))
            way = replace(way, projected_rms=rms, projected_largest=largest)
        if not options.exact or source == "sections":
            return way
        law = ExactLaw(modes, options)
        exact = self.fit_poses(law, poses)
        rms, largest = _measure(exact)
        tensions = [float(np.abs(pose.amplitudes).sum()) * law.scale for pose in exact]
        return replace(
            way,
            exact_rms=rms,
            exact_largest=largest,
            tension_sum=max(tensions),
            slope=options.offset_max * float(np.hypot(*np.moveaxis(modes.slopes, 1, 0)).max()),
        )

    def take_nearer(self, way: Way, poses: Sequence[Pose]) -> Way:
        """Return a way with the poses in which its routings were fitted, if these are nearer."""
        rms, largest = _measure(poses)
        if way.exact_rms is not None and way.exact_rms <= rms:
            return way
        sums = [float(np.abs(pose.amplitudes).sum()) for pose in poses]
        return replace(
            way, exact_rms=rms, exact_largest=largest, tension_sum=self.scale * max(sums)
        )

    def fit_poses(self, law: LinearLaw, before: Sequence[Pose] = ()) -> list[Pose]:
        """Return the fits of all poses, from those before."""
        if before:
            pairs = zip(self.heads, before, strict=True)
            return [self.fit_pose(law, head, pose.amplitudes, pose.turn) for head, pose in pairs]
        turn = self.target.frame[:3, :3]
        poses = [self.fit_pose(law, head, self._begin(law, head), turn) for head in self.heads]
        # From its neighbours on, a pose may come nearer than from the curvature.
        for step in (1, -1):
            rows = range(len(poses))[::step]
            for last, row in pairwise(rows):
                start = poses[last]
                other = self.fit_pose(law, self.heads[row], start.amplitudes, start.turn)
                poses[row] = min(poses[row], other, key=lambda pose: pose.cost)
        return poses

    def _begin(self, law: LinearLaw, head: int, ridge: float = 1e-3) -> Floats:
        """Return the amplitudes whose curvature is nearest to the path's."""
        rows = law.slopes[2 * (self.count - head) :, :2].reshape(4 * head, -1)
        wanted = self.target.curvature[: 2 * head, ::-1] * (-1.0, 1.0)
        both = np.vstack([rows, ridge * math.sqrt(len(rows)) * np.eye(rows.shape[1])])
        right = np.append(wanted.ravel(), np.zeros(rows.shape[1]))
        return np.asarray(np.linalg.lstsq(both, right, rcond=None)[0])

    def project(self, modes: Modes) -> list[Pose]:
        """Return the poses of nearest curvature over the whole robot, turned onto the path."""
        law = LinearLaw(modes)
        flat = np.concatenate([modes.values[:, 0], modes.values[:, 1]])
        amplitudes = np.linalg.lstsq(flat, self.matrix, rcond=None)[0]
        poses = []
        for head, column in zip(self.heads, amplitudes.T, strict=True):
            pose = self.place(law, head, column, self.target.frame[:3, :3])
            away = pose.trace.points - pose.trace.points[0]
            left, _, right = np.linalg.svd(away.T @ (away - pose.off))
            flip = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
            poses.append(replace(pose, off=away @ (left @ flip @ right) - (away - pose.off)))
        return poses

    def fit_pose(self, law: LinearLaw, head: int, amplitudes: Floats, turn: Floats) -> Pose:
        """Return amplitudes and the base's rotation that are nearest to the path's points."""
        pose = self._place_first(law, head, amplitudes, turn)
        damping = 1e-6
        for _ in range(MOST_STEPS):
            columns = self.differentiate(pose, pose.slopes)
            matrix = columns.T @ columns
            right = -columns.T @ pose.off.ravel()
            ridge = np.full(len(right), AMPLITUDE_WEIGHT**2)
            ridge[-3:] = 0.0
            right[:-3] -= ridge[:-3] * pose.amplitudes
            diagonal = np.diag(matrix) + ridge
            matrix[np.diag_indices_from(matrix)] = diagonal * (1.0 + damping)
            move = np.linalg.solve(matrix, right)
            try:
                turned = _turn(np.asarray(move[-3:], dtype=np.float64)) @ pose.turn
                trial = self.place(law, head, pose.amplitudes + move[:-3], turned)
                gain = pose.cost - trial.cost
            except GeometryError:  # far beyond what a rod does
                gain = -math.inf
            if gain < 0.0:
                damping = max(1e-4, 10.0 * damping)
                if damping > 1e6:
                    break
                continue
            damping = max(0.1 * damping, 1e-9)
            settled = gain <= SETTLED * pose.cost
            pose = trial
            if settled:
                break
        return pose

    def _place_first(self, law: LinearLaw, head: int, amplitudes: Floats, turn: Floats) -> Pose:
        """Return a pose of these amplitudes, or of as much of them as there is a curvature for."""
        for part in 0.5 ** np.arange(MOST_STEPS):
            try:
                return self.place(law, head, part * amplitudes, turn)
            except GeometryError:
                continue
        return self.place(law, head, 0.0 * amplitudes, turn)

    def place(self, law: LinearLaw, head: int, amplitudes: Floats, turn: Floats) -> Pose:
        """Return a pose of amplitudes and a rotation."""
        inside = slice(2 * (self.count - head), None)
        bends, slopes = law.bend(inside, amplitudes)
        frame = self.target.frame.copy()
        frame[:3, :3] = turn
        part = BackboneSteps(float(self.steps.ends[head]), int(head))
        trace = part.trace(bends, frame, moves=True)
        return Pose(
            amplitudes=amplitudes,
            turn=turn,
            off=trace.points - self.target.points[: head + 1],
            trace=trace,
            slopes=slopes,
        )

    def differentiate(self, pose: Pose, slopes: Floats) -> Floats:
        """Return how all coordinates move with curvatures (2 j, 3, q) and the rotation."""
        head = len(pose.off) - 1
        moves = pose.trace.move(slopes.reshape(head, 2, 3, -1))
        away = pose.trace.points - pose.trace.points[0]
        turns = np.cross(np.eye(3)[:, None], away[None]).transpose(1, 2, 0)
        return np.concatenate([moves, turns], axis=2).reshape(3 * (head + 1), -1)

    def fit_routings(
        self, modes: Modes, make_law: Callable[[Modes], LinearLaw], rounds: int
    ) -> tuple[Modes, list[Pose]]:
        """Return modes that are nearer in position, amplitudes of all poses free, and the poses.

        Gauss and Newton's method on the coefficients, after the amplitudes and rotations of every
        pose are eliminated from its linear system (Golub and Pereyra 1973; Kaufman 1975).
        """
        law = make_law(modes)
        poses = self.fit_poses(law, self.fit_poses(LinearLaw(modes)))
        cost = sum(pose.cost for pose in poses) + self.measure_rough(modes)
        damping = 1e-3
        system = self._assemble(law, poses)
        for _ in range(rounds):
            matrix, right = system
            rough = np.kron(self.rough, np.eye(2 * modes.coefficients.shape[2]))
            matrix = matrix + rough
            right = right - rough @ modes.coefficients.ravel()
            diagonal = np.diag(matrix)
            added = np.diag(damping * diagonal + 1e-9 * diagonal.max())
            move = np.linalg.solve(matrix + added, right).reshape(modes.coefficients.shape)
            trial = self.make_modes(modes.coefficients + move)
            tried = self.fit_poses(make_law(trial), poses)
            gain = cost - sum(pose.cost for pose in tried) - self.measure_rough(trial)
            if gain <= 0.0:
                damping *= 10.0
                continue
            damping = max(0.2 * damping, 1e-8)
            modes, poses, cost = trial, tried, cost - gain
            if gain < SETTLED * cost:
                break
            law = make_law(modes)
            system = self._assemble(law, poses)
        return modes, poses

    def sum_costs(self, law: LinearLaw) -> float:
        """Return the sum of squares of all poses in a law."""
        return sum(pose.cost for pose in self.fit_poses(law, self.fit_poses(LinearLaw(law.modes))))

    def measure_rough(self, modes: Modes) -> float:
        """Return the weighted sum of squared slopes of modes."""
        return float(np.sum((SLOPE_WEIGHT * modes.slopes) ** 2))

    def _assemble(self, law: LinearLaw, poses: Sequence[Pose]) -> tuple[Floats, Floats]:
        """Return the normal equations of the coefficients (c, 2, k) of all modes."""
        k = len(poses[0].amplitudes)
        width = 2 * self.coefficients * k
        matrix, right = np.zeros((width, width)), np.zeros(width)
        for head, pose in zip(self.heads, poses, strict=True):
            own = self.differentiate(pose, pose.slopes)
            own = np.vstack([own, AMPLITUDE_WEIGHT * np.eye(k, k + 3)])
            basis = np.linalg.qr(own)[0]
            off = np.append(pose.off.ravel(), AMPLITUDE_WEIGHT * pose.amplitudes)
            inside = slice(2 * (self.count - head), None)
            changes, spread = law.vary(
                inside, pose.amplitudes, (self.basis[inside], self.slopes[inside])
            )
            by = self.differentiate(pose, changes)[:, :-3]
            by = np.vstack([by, np.zeros((k, by.shape[1]))])
            by -= basis @ (basis.T @ by)
            matrix += spread(by.T @ by)
            right -= spread(by.T @ off)
        return matrix, right


def _turn(rotation: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(rotation).as_matrix())


def _measure(poses: Sequence[Pose]) -> tuple[float, float]:
    """Return the rms, in which each pose counts alike, and the largest distance [mm]."""
    squares = [np.sum(pose.off**2, axis=1) for pose in poses]
    mean = np.mean([rows.mean() for rows in squares])
    return float(np.sqrt(mean)), math.sqrt(max(rows.max() for rows in squares))


Variation = tuple["Floats", Callable[["Floats"], "Floats"]]
"""Derivatives of curvatures (2 j, 3, q), and what spreads products of them over coefficients."""


class LinearLaw:
    """The curvature is the sum of modes times amplitudes, without twist."""

    def __init__(self, modes: Modes) -> None:
        self.modes = modes
        values = modes.values
        self.slopes = np.zeros((len(values), 3, values.shape[2]))
        self.slopes[:, 1], self.slopes[:, 0] = values[:, 0], -values[:, 1]

    def bend(self, inside: slice, amplitudes: Floats) -> tuple[Floats, Floats]:
        """Return curvatures (2 j, 3) and their derivatives by amplitudes (2 j, 3, k)."""
        slopes = self.slopes[inside]
        return slopes @ amplitudes, slopes

    def vary(self, inside: slice, amplitudes: Floats, basis: tuple[Floats, Floats]) -> Variation:
        """Return how curvatures depend on coefficients, and what makes products of all of them.

        The curvature is linear in coefficients times amplitudes: what is known for one mode of
        amplitude 1 is known for all.
        """
        rows, _ = basis
        changes = np.zeros((len(rows), 3, rows.shape[1], 2))
        changes[:, 1, :, 0], changes[:, 0, :, 1] = rows, -rows

        def spread(product: Floats) -> Floats:
            scaled = np.multiply.outer(product, amplitudes)
            if product.ndim == 1:
                return np.asarray(scaled.ravel())
            both = np.multiply.outer(scaled, amplitudes).transpose(0, 2, 1, 3)
            size = len(product) * len(amplitudes)
            return np.asarray(both.reshape(size, size))

        return changes.reshape(len(rows), 3, -1), spread


class ExactLaw(LinearLaw):
    """The rod's law, with a cable on each side for every mode: only one of the two is taut."""

    def __init__(self, modes: Modes, options: InsertionRankOptions) -> None:
        super().__init__(modes)
        self.offset = options.offset_max
        self.guides = options.offset_max * np.concatenate(
            [modes.values, modes.slopes], axis=1
        ).transpose(0, 2, 1)
        self.scale = options.stiffness / options.offset_max
        self.stiffness = options.stiffness * np.array([1.0, 1.0, 1.0 / 1.3])

    def bend(self, inside: slice, amplitudes: Floats) -> tuple[Floats, Floats]:
        """Return curvatures (2 j, 3) and their derivatives by amplitudes (2 j, 3, k)."""
        ways = np.where(amplitudes < 0.0, -1.0, 1.0)
        guides = np.ascontiguousarray(self.guides[inside] * ways[:, None])
        start = np.ascontiguousarray(self.slopes[inside] @ amplitudes)
        tensions = self.scale * np.abs(amplitudes)
        bends, _, by_tensions = find_bends(self.stiffness, guides, tensions, start=start)
        return bends, by_tensions.transpose(0, 2, 1) * (self.scale * ways)

    def vary(self, inside: slice, amplitudes: Floats, basis: tuple[Floats, Floats]) -> Variation:
        """Return how curvatures depend on the coefficients of all modes."""
        ways = np.where(amplitudes < 0.0, -1.0, 1.0)
        guides = np.ascontiguousarray(self.guides[inside] * ways[:, None])
        start = np.ascontiguousarray(self.slopes[inside] @ amplitudes)
        tensions = self.scale * np.abs(amplitudes)
        _, by_guides, _ = find_bends(self.stiffness, guides, tensions, start=start)
        by = self.offset * ways[:, None, None] * by_guides
        changes = np.einsum("mkau,mc->mucak", by[:, :, :2], basis[0])
        changes += np.einsum("mkau,mc->mucak", by[:, :, 2:], basis[1])
        return changes.reshape(*changes.shape[:2], -1), np.asarray
