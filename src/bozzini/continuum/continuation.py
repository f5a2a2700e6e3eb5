"""Continuation of equilibria past limit points, by pseudo-arc-length (Keller 1977).

*Unknowns*, in this order: rotation vectors ``w`` of the segments (3 n) [rad], tensions of the a
taut tendons of which the length is held [N], and the factor ``f`` of loads, command or both. With
residual ``g(w, T, f)`` [N mm] and lengths, a point of the path meets::

    g = 0 ,   l_k - c_k T_k - limit_k(f) = 0  of the a tendons ,   W t . W (z - z_0) = step

with the unknowns ``z``, those of the last point ``z_0``, the unit tangent ``t`` there, and weights
``W``: the root of n of every rotation, 0 of a tension, 1 over the range of the factor. Newton's
method ends with a correction below 1e-10 in that measure. The set of taut tendons is held along a
step; where a cable goes slack or taut is found by bisection, where the factor turns back by regula
falsi on its rate.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..results import Json, ReasonedResult, list_coordinates, take_axes, to_plain
from .equilibrium import Equilibrium, Factors, LoadedRod, TendonCommand
from .kernels.energy import FOLD_ANGLE
from .shape import Shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Varied = Literal["loads", "command", "both"]
"""What a path's factor multiplies."""

LARGEST_STEP = 0.2
"""Largest step along a path: rotations of all segments [rad], and the factor by its range."""

SMALLEST_STEP = 1e-7
"""Smallest step along a path."""

CORRECTIONS = 12
"""Steps of Newton's method for one point of a path."""

CLOSE = 1e-10
"""Last correction of a point of a path, in the measure of `LARGEST_STEP`."""

TURNED = 1e-7
"""Change of the factor along a path, by its range, that counts as none."""

SEARCHES = 40
"""Points that are tried to find where a path turns or a tendon goes slack."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EquilibriumPath(ReasonedResult):
    """Equilibria along a path on which a factor of loads or command changes, both ways.

    Parameters
    ----------
    shapes : Shape
        The shapes, a batch of ``p``; unstable ones are among them and count as converged.
    factors : (p,) ndarray
        What is multiplied with loads or command.
    varied : {"loads", "command", "both"}
        Which of them.
    energy : (p,) ndarray
        Elastic energy of backbone and tendons [N mm].
    limit_points : tuple of int
        Points where the factor turns back: there a robot under that load or command snaps away.
    branch_points : tuple of int
        Points before which stability changes although the factor does not turn back: another path
        crosses this one, as where a straight robot buckles.
    reason : str
        Why the path ends before the last factor; else empty.
    """

    shapes: Shape
    factors: Floats
    varied: Varied
    energy: Floats
    limit_points: tuple[int, ...]
    branch_points: tuple[int, ...]
    reason: str

    @property
    def residual(self) -> float:
        """Largest residual of the shapes [mm]."""
        return float(self.shapes.residual.max())

    @property
    def stability(self) -> Floats:
        """Stability of the shapes, shape (p,); see `Shape`."""
        return self.shapes.stability

    def to_dict(self) -> Json:
        """Return the verdict, factors, limit points and stability, and the shapes."""
        plain = {
            "converged": self.converged,
            "reason": self.reason,
            "residual_mm": self.residual,
            "varied": self.varied,
            "factors": self.factors,
            "stability": self.stability,
            "energy_N_mm": self.energy,
            "limit_factors": self.factors[list(self.limit_points)],
            "branch_factors": self.factors[list(self.branch_points)],
        }
        return dict(to_plain(plain)) | {"shapes": self.shapes.to_dict()}

    def list_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: factor, stability, tensions, tip, a point each row."""
        shapes = self.shapes
        columns: dict[str, NDArray[np.generic]] = {
            "factor": self.factors,
            "stability": self.stability,
            "stable": shapes.stable,
            "energy_N_mm": self.energy,
            "limit_point": np.isin(np.arange(len(self.factors)), self.limit_points),
        }
        for k, name in enumerate(shapes.robot.tendon_names):
            columns |= {
                f"{name}_N": shapes.tensions[:, k],
                f"{name}_mm": shapes.displacements[:, k],
            }
        return columns | list_coordinates("tip", shapes.tip)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw how far the tip moves over the factor: stable, unstable dotted, limit points."""
        axes = take_axes(ax, x=f"factor of {self.varied}", y="tip moved [mm]")
        moved = np.linalg.norm(self.shapes.tip - self.shapes.tip[0], axis=-1)
        for style, label, shown in (
            ("-", "stable", self.shapes.stable),
            (":", "unstable", ~self.shapes.stable),
        ):
            # Lines between two points of one kind, and up to the first one of the other.
            shown = shown | np.append(shown[1:], False) | np.append(False, shown[:-1])
            other = np.where(shown, moved, np.nan)
            axes.plot(self.factors, other, style, color="C0", label=label)
        turned = list(self.limit_points)
        axes.plot(self.factors[turned], moved[turned], "o", color="C3", label="limit point")
        return axes


@dataclass(frozen=True, eq=False)
class Point:
    """A point of a path: rotation vectors, all tensions, factor, and the equilibrium there."""

    rotation_vectors: Floats
    tensions: Floats
    factor: float
    found: Equilibrium
    tangent: Floats
    taut: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Tracer:
    """Steps along the equilibria of a rod as a factor changes."""

    rod: LoadedRod
    command: TendonCommand
    varied: Varied
    span: tuple[float, float]

    def trace(self, first: Equilibrium, most: int) -> tuple[list[Point], list[int], str]:
        """Return points from an equilibrium at the first factor, where they turn, and a reason."""
        start, end = self.span
        taut = self.command.held & (self.rod.pushes | (first.tensions > 0.0))
        point = self._point(first.rotation_vectors, first.tensions, start, taut)
        forward = np.zeros(point.tangent.size)
        forward[-1] = np.sign(end - start)
        point = self._orient(point, forward)
        points = [point]
        limits: list[int] = []
        step, low, high = 0.25 * LARGEST_STEP, min(start, end), max(start, end)
        while len(points) < most:
            new = self._step(point, step)
            if new is None:
                step *= 0.5
                if step < SMALLEST_STEP:
                    return points, limits, "no further point was found"
                continue
            if np.abs(new.rotation_vectors).max() > FOLD_ANGLE:
                return points, limits, "a segment folds over"
            event = self._find_event(point, new, step)
            if event is not None:
                points.append(event)
                point = event
                step = max(0.5 * step, 1e3 * SMALLEST_STEP)
                continue
            if new.tangent[-1] * point.tangent[-1] < 0.0:
                turn = self._find_turn(point, new, step)
                if turn is not None and low <= turn.factor <= high:
                    limits.append(len(points))
                    points.append(turn)
            if not low <= new.factor <= high:
                last = self._close(
                    point, new, end if abs(new.factor - end) < abs(new.factor - start) else start
                )
                if last is None:
                    step *= 0.5
                    if step < SMALLEST_STEP:
                        return points, limits, "no further point was found"
                    continue
                points.append(last)
                came = abs(last.factor - end) <= 1e-12 * max(1.0, abs(end))
                return points, limits, "" if came else "the path comes back to its first factor"
            points.append(new)
            point = new
            step = min(1.5 * step, LARGEST_STEP)
        return points, limits, f"the path is longer than {most} points"

    @property
    def _range(self) -> float:
        return abs(self.span[1] - self.span[0])

    def factors(self, factor: float) -> Factors:
        """How much of command and loads a factor stands for."""
        return Factors(
            command=1.0 if self.varied == "loads" else factor,
            loads=1.0 if self.varied == "command" else factor,
        )

    def _weights(self, taut: NDArray[np.bool_]) -> Floats:
        """Measure of a step: the root of the sum of squares, each by its weight."""
        count = self.rod.rest.size
        weights = np.zeros(count + int(taut.sum()) + 1)
        weights[:count] = np.sqrt(count / 3.0)
        weights[-1] = 1.0 / self._range
        return weights

    def _system(
        self, rotation_vectors: Floats, tensions: Floats, factor: float, taut: NDArray[np.bool_]
    ) -> tuple[Equilibrium, Floats, Floats]:
        """Equilibrium, residual (3 n + a,), and its derivative by rotations, tensions, factor."""
        rod, command = self.rod, self.command
        factors = self.factors(factor)
        found = rod.measure(factors, rotation_vectors, self._pulls(tensions, factor, taut))
        count, rows = rotation_vectors.size, found.length_gradients.reshape(len(taut), -1)
        limits = command.limits(factors)
        length_residuals = found.lengths - limits - rod.compliances * tensions
        residual = np.concatenate([found.gradient.ravel(), length_residuals[taut]])
        size = residual.size
        matrix = np.zeros((size, size + 1))
        matrix[:count, :count] = found.hessian
        matrix[:count, count:size] = rows[taut].T
        matrix[count:, :count] = rows[taut]
        matrix[count:, count:size] = -np.diag(rod.compliances[taut])
        if self.varied != "loads":
            free = ~command.held
            matrix[:count, -1] += command.pulls[free] @ rows[free]
            matrix[count:, -1] -= (command.free_lengths - command.rest_lengths)[taut]
        if self.varied != "command":
            none = rod.measure(Factors(loads=0.0), rotation_vectors, found.tensions)
            if factors.loads:
                matrix[:count, -1] += (found.gradient - none.gradient).ravel() / factors.loads
            else:
                whole = rod.measure(Factors(), rotation_vectors, found.tensions)
                matrix[:count, -1] += (whole.gradient - none.gradient).ravel()
        return found, residual, matrix

    def _pulls(self, tensions: Floats, factor: float, taut: NDArray[np.bool_]) -> Floats:
        pulls = np.where(taut, tensions, 0.0)
        given = self.factors(factor).command * self.command.pulls
        return np.where(self.command.held, pulls, given)

    def _point(
        self,
        rotation_vectors: Floats,
        tensions: Floats,
        factor: float,
        taut: NDArray[np.bool_],
        forward: Floats | None = None,
    ) -> Point:
        """A point with its tangent: along `forward`, a row of weighted steps, or either way."""
        found, _, matrix = self._system(rotation_vectors, tensions, factor, taut)
        if forward is None:
            tangent = np.linalg.svd(matrix)[2][-1]
        else:
            ahead = np.append(np.zeros(len(matrix)), 1.0)
            tangent = np.linalg.solve(np.vstack([matrix, forward]), ahead)
        tangent = tangent / np.linalg.norm(self._weights(taut) * tangent)
        return Point(
            rotation_vectors, self._pulls(tensions, factor, taut), factor, found, tangent, taut
        )

    def _orient(self, point: Point, forward: Floats) -> Point:
        """The point with its tangent along a direction, in the measure of steps."""
        weights = self._weights(point.taut) ** 2
        sign = 1.0 if point.tangent @ (weights * forward) >= 0.0 else -1.0
        return dataclasses.replace(point, tangent=sign * point.tangent)

    def _step(self, point: Point, step: float) -> Point | None:
        """The point at a step along the tangent: predicted, then corrected across it."""
        taut, count = point.taut, point.rotation_vectors.size
        weights = self._weights(taut) ** 2
        origin = np.concatenate(
            [point.rotation_vectors.ravel(), point.tensions[taut], [point.factor]]
        )
        place = origin + step * point.tangent
        row = point.tangent * weights
        for _ in range(CORRECTIONS):
            rotation_vectors, tensions, factor = self._split(place, count, point)
            _, residual, matrix = self._system(rotation_vectors, tensions, factor, taut)
            square = np.vstack([matrix, row])
            right = np.append(residual, row @ (place - origin) - step)
            try:
                move = np.linalg.solve(square, -right)
            except np.linalg.LinAlgError:
                return None
            place = place + move
            size = np.linalg.norm(np.sqrt(weights) * move)
            if not size < 1.0:
                return None
            if size < CLOSE:
                rotation_vectors, tensions, factor = self._split(place, count, point)
                return self._point(rotation_vectors, tensions, factor, taut, row)
        return None

    def _split(self, place: Floats, count: int, point: Point) -> tuple[Floats, Floats, float]:
        tensions = point.tensions.copy()
        tensions[point.taut] = place[count:-1]
        return place[:count].reshape(point.rotation_vectors.shape), tensions, float(place[-1])

    def _slackness(self, point: Point) -> Floats:
        """What must not be negative of each tendon: a cable's tension, or how slack it is."""
        over = self.command.limits(self.factors(point.factor)) - point.found.lengths
        kept = np.where(point.taut, point.tensions / self.rod.grid.stiffness.max(), over)
        kept[~self.command.held | self.rod.pushes] = np.inf
        return kept

    def _find_event(self, point: Point, new: Point, step: float) -> Point | None:
        """The point where a cable goes slack or taut on a step, if one does, with its new set."""
        if not (self._slackness(new) < -self.rod.tolerance * 1e-3).any():
            return None
        low, high, last = 0.0, step, new
        for _ in range(SEARCHES):
            middle = 0.5 * (low + high)
            other = self._step(point, middle)
            if other is None:
                break
            if (self._slackness(other) < 0.0).any():
                high, last = middle, other
            else:
                low = middle
            if high - low < CLOSE:
                break
        index = int(np.argmin(self._slackness(last)))
        taut = last.taut.copy()
        taut[index] = not taut[index]
        tensions = last.tensions.copy()
        tensions[index] = 0.0
        switched = self._point(last.rotation_vectors, tensions, last.factor, taut)
        # Along the path from here on the tendon gets slack, or gets tension.
        count = last.rotation_vectors.size
        if taut[index]:
            gain = switched.tangent[count + int(taut[:index].sum())]
        else:
            rate = switched.tangent[:count] @ last.found.length_gradients[index].ravel()
            change = self.command.free_lengths[index] - self.command.rest_lengths[index]
            grown = 0.0 if self.varied == "loads" else change * switched.tangent[-1]
            gain = grown - rate
        return switched if gain >= 0.0 else dataclasses.replace(switched, tangent=-switched.tangent)

    def _find_turn(self, point: Point, new: Point, step: float) -> Point | None:
        """The point on a step where the factor turns back."""
        low, high, best = 0.0, step, None
        rates = [point.tangent[-1], new.tangent[-1]]
        for _ in range(SEARCHES):
            middle = low + (high - low) * rates[0] / (rates[0] - rates[1])
            other = self._step(point, middle)
            if other is None:
                return best
            best, rate = other, other.tangent[-1]
            if abs(rate) < TURNED * self._range:
                break
            # Regula falsi; the end that stays counts half (Dowell and Jarratt 1971).
            if rate * rates[0] > 0.0:
                low, rates = middle, [rate, 0.5 * rates[1]]
            else:
                high, rates = middle, [0.5 * rates[0], rate]
        return best

    def _close(self, point: Point, new: Point, factor: float) -> Point | None:
        """The point at a factor, between two."""
        part = (factor - point.factor) / (new.factor - point.factor)
        rotation_vectors = point.rotation_vectors + part * (
            new.rotation_vectors - point.rotation_vectors
        )
        tensions = point.tensions + part * (new.tensions - point.tensions)
        taut, count = point.taut, point.rotation_vectors.size
        for _ in range(CORRECTIONS):
            _, residual, matrix = self._system(rotation_vectors, tensions, factor, taut)
            try:
                move = np.linalg.solve(matrix[:, :-1], -residual)
            except np.linalg.LinAlgError:
                return None
            rotation_vectors = rotation_vectors + move[:count].reshape(rotation_vectors.shape)
            tensions = tensions.copy()
            tensions[taut] += move[count:]
            if np.linalg.norm(move[:count]) < CLOSE:
                return self._orient(
                    self._point(rotation_vectors, tensions, factor, taut), point.tangent
                )
        return None
