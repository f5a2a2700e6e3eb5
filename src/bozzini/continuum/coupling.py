"""How tendon displacements and the bends of all sections go together, for parallel tendons.

A tendon at offset ``a`` and angle ``psi`` gets shorter by ``a (cos psi, sin psi) . b`` in a
section that bends by ``b = theta (cos phi, sin phi)``, and a distal one so in every section that it
passes: the displacements are linear in the bends. Where tendons leave a bend open the backbone
takes the shape of least elastic energy; where a cable would have to push, it goes slack.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, take_named
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..results import Shown
from .model import (
    BendMeasure,
    ContinuumModel,
    advise_contradiction,
    check_limits,
    write_reasons,
)
from .profile import ROUND_OFF_MM
from .robot import RobotDesign, check_robot
from .shape import Shape

RANK_RATIO = 1e-9
"""Ratio of singular values below which directions count as one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BendSolution(Shown):
    """Bends of the sections under tendon displacements.

    Attributes
    ----------
    displacements : (..., t) ndarray
        Displacements [mm]; of tendons that follow those that they have.
    bends : (..., m, 2) ndarray
        ``(theta cos(phi), theta sin(phi))`` of each section [rad].
    misfit : (..., t) ndarray
        Commanded displacement less that of the bends [mm]; negative where a tendon is loose.
    residual : (...) ndarray
        Largest misfit of the tendons that are not slack [mm].
    slack : (..., t) ndarray of bool
        Cables that are slack.
    converged : (...) ndarray of bool
        Whether the bends give what was commanded.
    reason : (...) ndarray of str
        Which tendon does not go, and by how much; empty where converged.
    """

    displacements: Floats
    bends: Floats
    misfit: Floats
    residual: Floats
    slack: NDArray[np.bool_]
    converged: NDArray[np.bool_]
    reason: NDArray[np.str_]


def check_displacements(
    robot: RobotDesign, displacements: ArrayLike, *, may_follow: bool = False
) -> Floats:
    """Return displacements as an array of shape (..., t) [mm]; see `ContinuumRobot.forward`.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    displacements : array_like, shape (..., t), or mapping
        Displacements [mm].
    may_follow : bool
        Whether they may be NaN, for tendons that follow; those that a mapping leaves out do then,
        otherwise they are held at 0.

    Raises
    ------
    InputError
        If there is not one displacement for each tendon, or one is not finite.
    """
    count = len(robot.tendons)
    named = take_named("displacements", displacements)
    array = (
        check_array("displacements", displacements)
        if named is None
        else robot.order_displacements(named, missing=math.nan if may_follow else 0.0)
    )
    if array.ndim == 0 or array.shape[-1] != count:
        raise InputError(
            f"displacements has shape {array.shape}: it must be (..., {count}), one for each of "
            f"the tendons {list(robot.tendon_names)}"
        )
    wrong = np.isinf(array) if may_follow else ~np.isfinite(array)
    if wrong.any():
        place = np.argwhere(wrong)[0]
        name = robot.tendon_names[place[-1]]
        raise InputError(f"displacement of tendon '{name}' is {array[tuple(place)]}: not finite")
    return array


def coupling_matrix(robot: RobotDesign, *, model: str = "arc") -> Floats:
    """Return the matrix from bends to displacements, shape (t, 2 m) [mm/rad].

    Parameters
    ----------
    robot : RobotDesign
        A robot of parallel tendons.
    model : str
        Model that messages name.

    Raises
    ------
    GeometryError
        If a tendon is not parallel to the backbone or does not end at its section's end.
    """
    check_robot(robot)
    if not robot.tendons:
        raise GeometryError(f"robot '{robot.name}' has no tendons: nothing can move it")
    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: the {model} model takes tendons parallel to the backbone up to the end of "
            "their section; take the energy or the rod model"
        )
    matrix = np.zeros((len(robot.tendons), len(robot.sections), 2))
    for row, tendon in enumerate(robot.tendons):
        matrix[row, : int(robot.tendon_sections[row]) + 1] = tendon.place_at(0.0)
    return matrix.reshape(len(matrix), -1)


def find_crooked(robot: RobotDesign) -> str:
    """Return which tendon is not parallel to the backbone up to its section's end; else empty."""
    for row, tendon in enumerate(robot.tendons):
        end = float(robot.section_ends[int(robot.tendon_sections[row])])
        if not tendon.is_parallel:
            what = "offset or angle" if tendon.path is None else "place in the cross-section"
            return f"tendon '{tendon.name}' changes its {what} on its way"
        if robot.tendon_ends[row] < end - ROUND_OFF_MM:
            where = f"{robot.tendon_ends[row]:g} mm, before its section does at {end:g} mm"
            return f"tendon '{tendon.name}' ends at {where}"
    return ""


def require_arcs(robot: RobotDesign, user: str) -> None:
    """Raise `GeometryError`, in the words of one who needs arcs, unless all tendons are parallel.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    user : str
        Who takes sections that bend in arcs only.
    """
    check_robot(robot)
    crooked = find_crooked(robot)
    if crooked:
        raise GeometryError(
            f"{crooked}: {user} takes sections that bend in arcs, by tendons parallel to the "
            "backbone up to the end of their section"
        )


class Coupling:
    """Bends from displacements, and back, for one robot of parallel tendons.

    Parameters
    ----------
    robot : RobotDesign
        The robot.
    model : str
        Model that messages speak of.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    GeometryError
        If a tendon is not parallel.
    """

    def __init__(self, robot: RobotDesign, *, model: str = "arc", tolerance: float = 1e-6) -> None:
        self.robot = robot
        self.tolerance = check_number(
            "tolerance", tolerance, low=0.0, high=1.0, low_open=True, unit="mm"
        )
        self._scale = 1.0 / np.sqrt(_stiffness(robot))
        self._parts: dict[bytes, Coupling] = {}
        self._hold(coupling_matrix(robot, model=model), np.ones(len(robot.tendons), dtype=np.bool_))

    def _hold(self, matrix: Floats, held: NDArray[np.bool_]) -> None:
        """Take the tendons that are `held`; the others follow."""
        self.matrix = matrix[held]
        self._pushes = self.robot.pushes[held]
        self._names = tuple(np.asarray(self.robot.tendon_names, dtype=object)[held])
        self._scaled = self.matrix * self._scale
        inverse = np.linalg.pinv(self._scaled, rcond=RANK_RATIO)
        self.inverse = self._scale[:, None] * inverse
        self._tension = inverse.T @ inverse
        self._always_taut = bool(self._pushes.all()) or self._can_be_preloaded()

    def solve(self, displacements: Floats) -> BendSolution:
        """Return the bends under checked displacements of shape (..., t).

        Where one is NaN the tendon follows the bends of least energy that the others leave.
        """
        follows = np.isnan(displacements)
        if follows.any():
            return self._solve_following(displacements, follows)
        bends = displacements @ self.inverse.T
        misfit = displacements - bends @ self.matrix.T
        fits = np.abs(misfit).max(axis=-1, initial=0.0) <= self.tolerance
        slack = np.zeros(displacements.shape, dtype=bool)
        reasons: dict[tuple[int, ...], str] = {}
        good = fits.copy()
        if not self._always_taut:
            tensions = displacements @ self._tension.T
            least = np.where(self._pushes, 0.0, tensions).min(axis=-1)
            good &= least >= -RANK_RATIO * np.abs(tensions).max(axis=-1)
        converged = np.array(good)
        for index in np.argwhere(~good):
            place = tuple(int(i) for i in index)
            found = self._solve_slack(displacements[place])
            if found is None:
                reasons[place] = self._explain(misfit[place])
                continue
            bends[place] = found
            misfit[place] = displacements[place] - self.matrix @ found
            slack[place] = ~self._pushes & (misfit[place] < -self.tolerance)
            converged[place] = True
        sections = len(self.robot.sections)
        return BendSolution(
            displacements=displacements,
            bends=bends.reshape(*bends.shape[:-1], sections, 2),
            misfit=misfit,
            residual=np.where(slack, 0.0, np.abs(misfit)).max(axis=-1, initial=0.0),
            slack=slack,
            converged=converged,
            reason=write_reasons(fits.shape, reasons),
        )

    def _solve_following(self, displacements: Floats, follows: NDArray[np.bool_]) -> BendSolution:
        """Solve the commands of each set of tendons that are held, and gather the answers."""
        batch, count = displacements.shape[:-1], displacements.shape[-1]
        rows, loose = displacements.reshape(-1, count), follows.reshape(-1, count)
        bends = np.zeros((len(rows), len(self.robot.sections), 2))
        misfit, filled = np.zeros(rows.shape), np.array(rows)
        slack, converged = np.zeros(rows.shape, dtype=bool), np.zeros(len(rows), dtype=bool)
        residual = np.zeros(len(rows))
        reasons: dict[tuple[int, ...], str] = {}
        for pattern in np.unique(loose, axis=0):
            own = np.flatnonzero((loose == pattern).all(axis=1))
            held = np.flatnonzero(~pattern)
            found = self._without(pattern).solve(rows[np.ix_(own, held)])
            bends[own], residual[own] = found.bends, found.residual
            converged[own] = found.converged
            misfit[np.ix_(own, held)] = found.misfit
            slack[np.ix_(own, held)] = found.slack
            moved = found.bends.reshape(len(own), -1) @ self.matrix.T
            filled[own] = np.where(pattern, moved, rows[own])
            for row, reason in zip(own, found.reason, strict=True):
                if reason:
                    reasons[(int(row),)] = str(reason)
        return BendSolution(
            displacements=filled.reshape(displacements.shape),
            bends=bends.reshape(*batch, *bends.shape[1:]),
            misfit=misfit.reshape(displacements.shape),
            residual=residual.reshape(batch),
            slack=slack.reshape(displacements.shape),
            converged=converged.reshape(batch),
            reason=write_reasons((len(rows),), reasons).reshape(batch),
        )

    def _without(self, follows: NDArray[np.bool_]) -> Coupling:
        """Return the same for the tendons that do not follow."""
        key = follows.tobytes()
        if key not in self._parts:
            self._parts[key] = part = copy.copy(self)
            part._hold(self.matrix, ~follows)
        return self._parts[key]

    def open_directions(self) -> tuple[str, ...]:
        """Return one sentence for each section whose own tendons do not bend it every way."""
        words = []
        for index, section in enumerate(self.robot.sections):
            label = self.robot.section_label(index)
            if not section.tendons:
                words.append(f"{label} has no tendons of its own: no bend of it is controlled")
                continue
            own = self.matrix[self.robot.tendon_sections == index][:, 2 * index : 2 * index + 2]
            _, sizes, ways = np.linalg.svd(own)
            if len(sizes) < 2 or sizes[1] < RANK_RATIO * sizes[0]:
                angle = np.degrees(np.arctan2(ways[1, 1], ways[1, 0])) % 180.0
                words.append(
                    f"{label} has tendons in one plane only: its bend towards {angle:.4g} deg "
                    "is not controlled"
                )
        return tuple(words)

    def _can_be_preloaded(self) -> bool:
        """Whether every cable can be tight at once without bending anything."""
        rods = self._scaled[self._pushes]
        columns = np.vstack([self._scaled, -rods]).T
        size = float(np.abs(columns).max())
        load = -self._scaled[~self._pushes].sum(axis=0) / size
        if np.linalg.norm(load) < 1e-9:
            return True  # equal tensions bend nothing
        from scipy.optimize import nnls

        return bool(nnls(columns / size, load)[1] < 1e-9)

    def _solve_slack(self, displacements: Floats) -> Floats | None:
        """Return the bends of least energy that no cable is too short for, or None if none.

        Least-distance programming by non-negative least squares (Lawson and Hanson 1974, ch. 23).
        """
        from scipy.optimize import nnls

        rods = self._pushes
        sign = np.concatenate([np.ones(len(rods)), -np.ones(int(rods.sum()))])
        rows = np.vstack([self._scaled, self._scaled[rods]]) * sign[:, None]
        short = np.concatenate([displacements, displacements[rods]]) * sign
        size, reach = float(np.abs(rows).max()), float(np.abs(short).max())
        system = np.vstack([rows.T / size, short / reach])
        target = np.zeros(len(system))
        target[-1] = 1.0
        weights, _ = nnls(system, target)
        left = system @ weights - target
        if -left[-1] < 1e-12:
            return None
        bends = self._scale * (left[:-1] / -left[-1]) * (reach / size)
        missed = displacements - self.matrix @ bends
        if missed.max() > self.tolerance or -missed[rods].min(initial=0.0) > self.tolerance:
            return None
        return np.asarray(bends)

    def _explain(self, misfit: Floats) -> str:
        names = self._names
        worst = int(np.argmax(np.where(self._pushes, np.abs(misfit), misfit)))
        amount = float(misfit[worst])
        if amount > 0.0:
            return (
                f"tendon '{names[worst]}' is pulled {amount:.4g} mm more than the nearest shape "
                "gives way: it would have to stretch (let out those on the other side); "
                f"{advise_contradiction(self.tolerance)}, in the energy or rod model"
            )
        return (
            f"rod '{names[worst]}' is pushed {-amount:.4g} mm more than the nearest shape gives "
            "way: it would have to be squeezed (pull those on the other side)"
        )


@dataclass(frozen=True)
class ParallelModel(ContinuumModel):
    """Base of the models in which displacements are linear in the bends of the sections."""

    lets_follow = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.coupling  # noqa: B018  # it refuses robots that have none

    @cached_property
    def coupling(self) -> Coupling:
        """Displacements from bends, and back."""
        return Coupling(self.robot, model=self.name, tolerance=self.tolerance)

    @property
    def notes(self) -> tuple[str, ...]:
        """Bends that no tendon controls, a sentence each; least elastic energy decides them."""
        return (*super().notes, *self.coupling.open_directions())

    def solve(self, displacements: ArrayLike) -> BendSolution:
        """Return the bends of the sections under `displacements`, shape (..., t) [mm].

        Where one is NaN the tendon follows.

        Raises
        ------
        InputError
            If there is not one finite displacement for each tendon.
        """
        found = self.coupling.solve(check_displacements(self.robot, displacements, may_follow=True))
        measure = BendMeasure(bends=np.hypot(found.bends[..., 0], found.bends[..., 1]))
        verdict = (found.converged, found.reason)
        converged, reason = check_limits(self.robot, found.displacements, measure, verdict)
        return dataclasses.replace(found, converged=converged, reason=reason)

    def answer(self, found: BendSolution, **stations: Floats) -> Shape:
        """Return the shapes of bends, given the stations and the frames there."""
        bends = found.bends.reshape(*found.bends.shape[:-2], 2 * len(self.robot.sections))
        return self.make_shape(
            found.displacements,
            tendon_lengths=self.robot.tendon_ends - bends @ self.coupling.matrix.T,
            section_parameters=found.bends,
            slack=found.slack,
            residual=found.residual,
            verdict=(found.converged, found.reason),
            **stations,
        )


# Which bends a robot can take: its sections' limits, its tendons' travel, what they control.

LIMIT_INSET_RAD = 1e-10
"""Distance that is kept from each limit, so that round-off does not pass it [rad]."""

AT_LIMIT_RAD = 1e-6
"""Distance from a limit that counts as at it [rad]."""

PROBE_BEND_RAD = 1e-2
"""Bend by which it is tried whether tendons stay tight [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BendLimits:
    """The legal bends of a robot, a convex set: discs, and linear rows in ranges.

    Parameters
    ----------
    coupling : Coupling
        Displacements from bends.
    lengths : (m,) ndarray
        Lengths of the sections [mm].
    discs : (m,) ndarray
        Largest bend of each section [rad]: its `max_bend`, or where its discs meet.
    rows : (c, 2 m) ndarray
        Rows of length 1.
    low, high : (c,) ndarray
        Range of each row times the bends.
    names : tuple of str
        Tendon whose displacement or tension a row is, or empty.
    tensions : (c,) ndarray of bool
        Whether a row is a tension.
    """

    coupling: Coupling
    lengths: Floats
    discs: Floats
    rows: Floats
    low: Floats
    high: Floats
    names: tuple[str, ...]
    tensions: NDArray[np.bool_]

    @property
    def robot(self) -> RobotDesign:
        """The robot."""
        return self.coupling.robot

    @property
    def kernel(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Discs, rows, low, high, a little drawn in: what the kernels take."""
        inset = np.minimum(LIMIT_INSET_RAD, 0.25 * (self.high - self.low))
        discs = self.discs - np.minimum(LIMIT_INSET_RAD, 0.25 * self.discs)
        return discs, self.rows, self.low + inset, self.high - inset

    @cached_property
    def basis(self) -> Floats:
        """Orthonormal rows that span the bends the tendons control, shape (p, 2 m)."""
        fixed = self.rows[self.high - self.low <= 4.0 * LIMIT_INSET_RAD]
        if not len(fixed):
            return np.eye(self.rows.shape[1])
        _, sizes, ways = np.linalg.svd(fixed)
        return np.ascontiguousarray(ways[int(np.count_nonzero(sizes > RANK_RATIO * sizes[0])) :])

    def describe_limits(self, bends: Floats) -> tuple[str, ...]:
        """Return a sentence for each limit that `bends`, shape (m, 2), lie at."""
        words = []
        for index, size in enumerate(np.hypot(bends[:, 0], bends[:, 1])):
            if size < self.discs[index] - AT_LIMIT_RAD:
                continue
            section = self.robot.sections[index]
            meets = section.length / section.radius <= section.max_bend
            cause = "where its discs meet" if meets else "its largest bend"
            label, most = self.robot.section_label(index), math.degrees(self.discs[index])
            words.append(f"{label} is at {most:.4g} deg, {cause}")
        values = self.rows @ bends.ravel()
        names = self.robot.tendon_names
        for row, name in enumerate(self.names):
            low, high = self.low[row] + AT_LIMIT_RAD, self.high[row] - AT_LIMIT_RAD
            if not name or low < values[row] < high:
                continue
            if self.tensions[row]:
                words.append(f"tendon '{name}' is about to go slack")
                continue
            end = 0 if values[row] <= low else 1
            travel = self.robot.tendon_travel[names.index(name), end]
            words.append(f"tendon '{name}' is at the end of its travel, {travel:g} mm")
        return tuple(words)

    def explain_empty(self) -> GeometryError:
        """Return the error of a robot that has no legal bends."""
        travel = self.robot.tendon_travel
        moved = [
            f"'{name}' in [{low:g}, {high:g}] mm"
            for name, (low, high) in zip(self.robot.tendon_names, travel, strict=True)
            if not low <= 0.0 <= high
        ]
        return GeometryError(
            f"robot '{self.robot.name}' has no legal shape: no bends within its limits move "
            f"all its tendons within their travel ({', '.join(moved)})"
        )


@functools.lru_cache(maxsize=32)
def find_limits(robot: RobotDesign) -> BendLimits:
    """Return the legal bends of a robot of parallel tendons.

    Raises
    ------
    GeometryError
        If a tendon is not parallel, or there is none.
    """
    require_arcs(robot, "the inverse, like the workspace,")
    coupling = Coupling(robot)
    sections = robot.sections
    moved, tight = [*_travel_rows(coupling), *_open_rows(coupling)], _tight_rows(coupling)
    blocks = [*moved, *tight]
    rows = np.array([block[0] for block in blocks]).reshape(-1, 2 * len(sections))
    size = np.linalg.norm(rows, axis=1)
    most = [min(section.max_bend, section.length / section.radius) for section in sections]
    return BendLimits(
        coupling=coupling,
        lengths=robot.section_lengths,
        discs=np.array(most, dtype=np.float64),
        rows=np.ascontiguousarray(rows / size[:, None]),
        low=np.array([block[1] for block in blocks], dtype=np.float64) / size,
        high=np.array([block[2] for block in blocks], dtype=np.float64) / size,
        names=tuple(block[3] for block in blocks),
        tensions=np.arange(len(blocks)) >= len(moved),
    )


_Row = tuple[Floats, float, float, str]


def _travel_rows(coupling: Coupling) -> list[_Row]:
    robot = coupling.robot
    travel = zip(robot.tendon_names, robot.tendon_travel, strict=True)
    return [
        (row, float(low), float(high), name)
        for row, (name, (low, high)) in zip(coupling.matrix, travel, strict=True)
        if math.isfinite(low) or math.isfinite(high)
    ]


def _open_rows(coupling: Coupling) -> list[_Row]:
    """Return rows that are 0 where the bends that no tendon controls take least energy."""
    matrix = coupling.matrix
    _, sizes, ways = np.linalg.svd(matrix)
    rank = int(np.count_nonzero(sizes > RANK_RATIO * sizes[0]))
    stiffness = _stiffness(coupling.robot)
    return [(way * stiffness, 0.0, 0.0, "") for way in ways[rank:]]


def _tight_rows(coupling: Coupling) -> list[_Row]:
    """Return the tensions of cables that the bends need, where they do not hold each other.

    Rows are exact where no tendon is one too many; otherwise they ask for the smallest tensions
    to be positive, which is more than is needed.
    """
    matrix = coupling.matrix
    _, sizes, ways = np.linalg.svd(matrix, full_matrices=False)
    basis = ways[sizes > RANK_RATIO * sizes[0]] / _stiffness(coupling.robot)
    basis /= np.linalg.norm(basis, axis=1, keepdims=True)
    probes = PROBE_BEND_RAD * np.concatenate([basis, -basis])
    found = coupling.solve(probes @ matrix.T)
    bends = found.bends.reshape(probes.shape)
    # A convex cone that holds a basis and its opposite is everything.
    if found.converged.all() and np.abs(bends - probes).max() < 1e-3 * PROBE_BEND_RAD:
        return []
    needs = np.linalg.pinv(matrix.T, rcond=RANK_RATIO) * _stiffness(coupling.robot)
    tendons = zip(coupling.robot.tendons, needs, strict=True)
    return [(row, 0.0, math.inf, tendon.name) for tendon, row in tendons if not tendon.pushes]


def _stiffness(robot: RobotDesign) -> Floats:
    """Return the bending stiffness of each bend [N mm/rad], shape (2 m,)."""
    return np.repeat(robot.section_stiffness[:, 0] / robot.section_lengths, 2)
