"""What a fitted robot leaves over, learned as small motions of its sections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..results import Shown
from .command_baselines import list_monomials
from .kinematics import ContinuumRobot
from .observation import interpolate_frames
from .shape import Shape
from .unknowns import RobotSetup

MOTIONS = 4
"""Of a section: it turns about the three axes of its start, and its end moves along the chord."""
DEGREES = (1, 2, 3)
FEWEST_BLOCKS = 4
"""Runs of rows that choose the form where there are no blocks."""
RIDGES = (1e-4, 1e-3, 1e-2, 1e-1)
"""Weights of the squares of the coefficients that are tried, in numbers of coordinates."""


def _list_ends(robot: ContinuumRobot) -> tuple[Floats, Floats]:
    """Return where the sections start and end along a robot (s,) [mm]."""
    starts = np.asarray(robot.section_starts, dtype=np.float64)
    return starts, starts + np.array([section.length for section in robot.sections])


def _measure_turns(first: Floats, last: Floats) -> Floats:
    """Return the rotation vectors (..., 3) from frames (..., 4, 4) to others; NaN of unknown."""
    from scipy.spatial.transform import Rotation

    turns = np.swapaxes(first[..., :3, :3], -1, -2) @ last[..., :3, :3]
    found = np.asarray(np.isfinite(turns).all(axis=(-1, -2)))
    turns = np.where(found[..., None, None], turns, np.eye(3))
    vectors = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(*found.shape, 3)
    return np.where(found[..., None], vectors, np.nan)


def measure_bends(robot: ContinuumRobot, shape: Shape) -> Floats:
    """Return how far each section of shapes (...) turns (..., s) [rad]; NaN without a shape."""
    starts, ends = _list_ends(robot)
    wanted = np.minimum(np.concatenate([starts, ends]), robot.length)
    frames = interpolate_frames(shape, wanted)
    first, last = frames[..., : len(starts), :, :], frames[..., len(starts) :, :, :]
    return np.asarray(np.linalg.norm(_measure_turns(first, last)[..., :2], axis=-1))


@dataclass(frozen=True)
class SectionStates:
    """What a model predicts of the sections of a robot, and how points move with them.

    Parameters
    ----------
    values : ndarray, shape (n, s, 3)
        Bends about x and y of each section's start [rad], mean tension of its tendons [N].
    rates : ndarray, shape (n, m, 3, s, 4)
        How markers move with each motion of a section [mm per rad, mm per mm].
    """

    values: Floats
    rates: Floats

    @property
    def bends(self) -> Floats:
        """How far each section turns (n, s) [rad]."""
        return np.asarray(np.linalg.norm(self.values[..., :2], axis=-1))

    @classmethod
    def of(cls, setup: RobotSetup, shape: Shape, points: Floats) -> SectionStates:
        """Return the states of shapes (n,) whose markers are at points (n, m, 3) of the world."""
        robot = setup.robot
        starts, ends = _list_ends(robot)
        tip = robot.length
        places = np.array([tip if m.arc_length is None else m.arc_length for m in setup.markers])
        share = np.clip((places[:, None] - starts) / (ends - starts), 0.0, 1.0)
        middles = starts + 0.5 * share * (ends - starts)
        wanted = np.minimum(np.concatenate([starts, ends, middles.ravel()]), tip)
        frames = robot.base_frame @ interpolate_frames(shape, wanted)
        count = len(starts)
        first, last = frames[:, :count], frames[:, count : 2 * count]
        pivots = frames[:, 2 * count :, :3, 3].reshape(len(frames), *middles.shape, 3)
        bends = _measure_turns(first, last)[..., :2]
        tensions = np.nan_to_num(np.maximum(shape.tensions, 0.0))
        own = [np.flatnonzero(robot.tendon_sections == k) for k in range(count)]
        pulls = np.zeros((len(frames), count))
        for k, which in enumerate(own):
            if len(which) and tensions.size:
                pulls[:, k] = tensions[:, which].mean(axis=1)
        pulls = np.where(np.isnan(bends[..., 0]), np.nan, pulls)
        values = np.concatenate([bends, pulls[..., None]], axis=-1)
        arms = points[:, :, None] - pivots
        axes = np.swapaxes(first[..., :3, :3], -1, -2)[:, None]  # rows are x, y, z
        rates = np.empty((*points.shape[:2], count, MOTIONS, 3))
        rates[..., :3, :] = np.cross(axes, arms[..., None, :])
        chords = last[..., :3, 3] - first[..., :3, 3]
        rates[..., 3, :] = (chords / np.linalg.norm(chords, axis=-1, keepdims=True))[:, None]
        rates *= share[..., None, None]
        return cls(values, np.moveaxis(rates, -1, 2))

    def select(self, rows: NDArray[np.generic]) -> SectionStates:
        """Return those of some of the rows."""
        return SectionStates(self.values[rows], self.rates[rows])

    def spread(self, rows: NDArray[np.int64], count: int) -> SectionStates:
        """Return the states of `count` rows, of which these are known and the others NaN."""
        wide = [np.full((count, *part.shape[1:]), np.nan) for part in (self.values, self.rates)]
        wide[0][rows], wide[1][rows] = self.values, self.rates
        return SectionStates(*wide)


@dataclass(frozen=True)
class SectionResidual(Shown):
    """Small motions of sections that are added to what a model predicts.

    Each section turns and stretches by a polynomial of its own state as the model predicts it,
    its two bends and, where that helps, the mean tension of its tendons; states outside those
    that it was learned from are cut to them. All points are moved by the same three numbers as
    well. The polynomials are linear in their coefficients, which have a ridge; degree, tension
    and ridge are those that predict blocks of rows left out best.

    Parameters
    ----------
    degree : int
        Of the polynomials; 0 for none at all, where nothing predicts better.
    tension : bool
        Whether they depend on the tension.
    ridge : float
        Weight of the squares of the coefficients, in numbers of coordinates.
    low, high, middle, scale : ndarray, shape (s, 3)
        Range of the states, their means and deviations.
    coefficients : ndarray, shape (k,)
        Three of the shift [mm], then of each section, motion and term.
    """

    degree: int
    tension: bool
    ridge: float
    low: Floats
    high: Floats
    middle: Floats
    scale: Floats
    coefficients: Floats

    def shift(self, states: SectionStates) -> Floats:
        """Return what is added to the points (n, m, 3) [mm]; 0 of rows without a shape."""
        count, markers = states.rates.shape[:2]
        if self.degree == 0:
            return np.zeros((count, markers, 3))
        moved = self._build(states) @ self.coefficients
        return np.nan_to_num(moved.reshape(count, markers, 3))

    def describe(self) -> str:
        """Return its form in words."""
        if self.degree == 0:
            return "none, as none predicts rows left out better"
        of = "bends and tension" if self.tension else "bends"
        return (
            f"each section turns and stretches by a polynomial of degree {self.degree} of its own "
            f"{of}, {len(self.coefficients)} coefficients with a ridge"
        )

    def _build(self, states: SectionStates) -> Floats:
        """Return the matrix (n m 3, k) from coefficients to shifts."""
        columns = 3 if self.tension else 2
        cut = np.clip(states.values, self.low, self.high)
        plain = ((cut - self.middle) / self.scale)[..., :columns]
        terms = np.stack(
            [list_monomials(plain[:, k], self.degree) for k in range(plain.shape[1])], axis=1
        )
        parts = states.rates[..., None] * terms[:, None, None, :, None, :]
        rows = parts.shape[0] * parts.shape[1]
        shifts = np.tile(np.eye(3), (rows, 1))
        return np.concatenate([shifts, parts.reshape(rows * 3, -1)], axis=1)


def learn_residual(
    states: SectionStates, missed: Floats, blocks: NDArray[np.generic]
) -> SectionResidual:
    """Return the residual of points missed (n, m, 3) [mm], measured less predicted.

    Parameters
    ----------
    states : SectionStates
    missed : ndarray, shape (n, m, 3)
        NaN where a point was not seen.
    blocks : ndarray, shape (n,)
        Labels of rows that are left out together to choose the form.
    """
    there = np.asarray(np.isfinite(states.values).all(axis=(1, 2)))
    values = states.values[there] if there.any() else np.zeros((1, *states.values.shape[1:]))
    scale = values.std(axis=0)
    frame = SectionResidual(
        degree=0, tension=False, ridge=0.0, low=values.min(axis=0), high=values.max(axis=0),
        middle=values.mean(axis=0), scale=np.where(scale > 1e-12, scale, 1.0),
        coefficients=np.zeros(0),
    )  # fmt: skip
    if not np.isfinite(missed[there]).any():
        return frame
    if len(np.unique(np.asarray(blocks)[there])) < 2:  # runs of rows, then
        blocks = np.arange(len(missed)) * FEWEST_BLOCKS // max(len(missed), 1)
    labels = np.broadcast_to(np.asarray(blocks)[:, None, None], missed.shape).ravel()
    missed = np.where(there[:, None, None], missed, np.nan)
    best, least = frame, float(np.nansum(np.square(missed)))
    for degree, tension in product(DEGREES, (False, True)):
        form = replace(frame, degree=degree, tension=tension)
        matrix = form._build(states)
        seen = np.isfinite(missed).ravel() & np.isfinite(matrix).all(axis=1)
        parts = _Parts.of(matrix[seen], missed.ravel()[seen], labels[seen])
        for ridge in RIDGES:
            error = parts.leave_out(ridge)
            if error < least:
                least = error
                best = replace(form, ridge=ridge, coefficients=parts.solve(ridge))
    return best


@dataclass(frozen=True)
class _Parts:
    """Normal equations of blocks of a linear problem, its columns scaled."""

    matrices: Sequence[Floats]
    targets: Sequence[Floats]
    squares: Floats
    products: Floats
    scale: Floats

    @classmethod
    def of(cls, matrix: Floats, target: Floats, labels: NDArray[np.generic]) -> _Parts:
        scale = np.sqrt(np.mean(np.square(matrix), axis=0))
        scale = np.where(scale > 1e-12, scale, 1.0)
        which = [labels == label for label in np.unique(labels)]
        matrices = [matrix[one] / scale for one in which]
        targets = [target[one] for one in which]
        squares = np.stack([one.T @ one for one in matrices])
        products = np.stack([one.T @ two for one, two in zip(matrices, targets, strict=True)])
        return cls(matrices, targets, squares, products, scale)

    def _solve(self, square: Floats, product: Floats, ridge: float, count: int) -> Floats:
        return np.asarray(np.linalg.solve(square + ridge * count * np.eye(len(square)), product))

    def solve(self, ridge: float) -> Floats:
        """Return the coefficients fitted to all blocks."""
        count = sum(map(len, self.targets))
        found = self._solve(self.squares.sum(axis=0), self.products.sum(axis=0), ridge, count)
        return np.asarray(found / self.scale)

    def leave_out(self, ridge: float) -> float:
        """Return the sum of squares of blocks, each predicted by the others."""
        square, product = self.squares.sum(axis=0), self.products.sum(axis=0)
        whole, total = sum(map(len, self.targets)), 0.0
        for k, (matrix, target) in enumerate(zip(self.matrices, self.targets, strict=True)):
            count = whole - len(target)
            if not count:
                return np.inf
            found = self._solve(square - self.squares[k], product - self.products[k], ridge, count)
            total += float(np.square(target - matrix @ found).sum())
        return total
