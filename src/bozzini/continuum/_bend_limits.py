"""Which bends a robot can take: its sections' limits, its tendons' travel, what they control."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..errors import GeometryError
from .coupling import Coupling, require_arcs
from .robot import ContinuumRobot

__all__ = ["BendLimits", "find_limits"]

Floats = NDArray[np.float64]

INSET = 1e-10
"""Distance that is kept from each limit, so that round-off does not pass it [rad]."""

AT_LIMIT = 1e-6
"""Distance from a limit that counts as at it [rad]."""

PROBE = 1e-2
"""Bend by which it is tried whether tendons stay tight [rad]."""

THIN = 1e-9


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
        What each row is: a tendon's name, or empty.
    """

    coupling: Coupling
    lengths: Floats
    discs: Floats
    rows: Floats
    low: Floats
    high: Floats
    names: tuple[str, ...]

    @property
    def robot(self) -> ContinuumRobot:
        """The robot."""
        return self.coupling.robot

    @property
    def kernel(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Discs, rows, low, high, a little drawn in: what the kernels take."""
        inset = np.minimum(INSET, 0.25 * (self.high - self.low))
        discs = self.discs - np.minimum(INSET, 0.25 * self.discs)
        return discs, self.rows, self.low + inset, self.high - inset

    @cached_property
    def basis(self) -> Floats:
        """Orthonormal rows that span the bends the tendons control, shape (p, 2 m)."""
        fixed = self.rows[self.high - self.low <= 4.0 * INSET]
        if not len(fixed):
            return np.eye(self.rows.shape[1])
        _, sizes, ways = np.linalg.svd(fixed)
        return np.ascontiguousarray(ways[int(np.count_nonzero(sizes > THIN * sizes[0])) :])

    def describe_limits(self, bends: Floats) -> tuple[str, ...]:
        """Return a sentence for each limit that `bends`, shape (m, 2), lie at."""
        words = []
        for index, size in enumerate(np.hypot(bends[:, 0], bends[:, 1])):
            if size < self.discs[index] - AT_LIMIT:
                continue
            section = self.robot.sections[index]
            meets = section.length / section.radius <= section.max_bend
            cause = "where its discs meet" if meets else "its largest bend"
            label, most = self.robot.section_label(index), math.degrees(self.discs[index])
            words.append(f"{label} is at {most:.4g} deg, {cause}")
        values = self.rows @ bends.ravel()
        names = self.robot.tendon_names
        for row, name in enumerate(self.names):
            if not name or self.low[row] + AT_LIMIT < values[row] < self.high[row] - AT_LIMIT:
                continue
            if not math.isfinite(self.high[row]) and self.low[row] == 0.0:
                words.append(f"tendon '{name}' is about to go slack")
                continue
            end = 0 if values[row] <= self.low[row] + AT_LIMIT else 1
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
def find_limits(robot: ContinuumRobot) -> BendLimits:
    """Return the legal bends of a robot of parallel tendons.

    Raises
    ------
    GeometryError
        If a tendon is not parallel, or there is none.
    """
    require_arcs(robot, "the inverse, like the workspace,")
    coupling = Coupling(robot)
    sections = robot.sections
    blocks = [*_travel_rows(coupling), *_open_rows(coupling), *_tight_rows(coupling)]
    rows = np.array([block[0] for block in blocks]).reshape(-1, 2 * len(sections))
    size = np.linalg.norm(rows, axis=1)
    most = [min(section.max_bend, section.length / section.radius) for section in sections]
    return BendLimits(
        coupling=coupling,
        lengths=np.array([section.length for section in sections], dtype=np.float64),
        discs=np.array(most, dtype=np.float64),
        rows=np.ascontiguousarray(rows / size[:, None]),
        low=np.array([block[1] for block in blocks], dtype=np.float64) / size,
        high=np.array([block[2] for block in blocks], dtype=np.float64) / size,
        names=tuple(block[3] for block in blocks),
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
    rank = int(np.count_nonzero(sizes > THIN * sizes[0]))
    stiffness = _stiffness(coupling.robot)
    return [(way * stiffness, 0.0, 0.0, "") for way in ways[rank:]]


def _tight_rows(coupling: Coupling) -> list[_Row]:
    """Return the tensions of cables that the bends need, where they do not hold each other.

    Rows are exact where no tendon is one too many; otherwise they ask for the smallest tensions
    to be positive, which is more than is needed.
    """
    matrix = coupling.matrix
    _, sizes, ways = np.linalg.svd(matrix, full_matrices=False)
    basis = ways[sizes > THIN * sizes[0]] / _stiffness(coupling.robot)
    basis /= np.linalg.norm(basis, axis=1, keepdims=True)
    probes = PROBE * np.concatenate([basis, -basis])
    found = coupling.solve(probes @ matrix.T)
    bends = found.bends.reshape(probes.shape)
    # A convex cone that holds a basis and its opposite is everything.
    if found.converged.all() and np.abs(bends - probes).max() < 1e-3 * PROBE:
        return []
    needs = np.linalg.pinv(matrix.T, rcond=THIN) * _stiffness(coupling.robot)
    tendons = zip(coupling.robot.tendons, needs, strict=True)
    return [(row, 0.0, math.inf, tendon.name) for tendon, row in tendons if not tendon.pushes]


def _stiffness(robot: ContinuumRobot) -> Floats:
    """Return the bending stiffness of each bend [N mm/rad], shape (2 m,)."""
    return np.repeat([section.bending_stiffness / section.length for section in robot.sections], 2)
