"""Routings of tendons for which a rod without loads takes a given shape.

The rod's own law without loads, ``K u + sum T_k r_k x t_k(u) = 0``, is local: in each cross-section
curvature and twist follow from places, slopes and tensions of the tendons. To first order, with
``kappa = (u_y, -u_x)``, the vector towards which it bends::

    EI kappa = sum T_k p_k ,   u_z = - sum T_k r_k^2 theta_k' / (GJ + sum T_k r_k^2)

so that one tendon, ``p = EI kappa / T`` in a frame that turns with the twist, can hold any one
shape; and so can two of equal tension and constant offset, at angles on both sides of the
curvature. These are starts; the exact law is then fitted to the curve's points.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity
from ..errors import GeometryError
from ..numeric.arrays import Floats
from ..numeric.least_squares import LeastSquares
from ..numeric.polylines import carry_frames, interpolate_polyline, measure_arc_length
from .kernels.routing import find_curvatures, trace_backbone

STEP_MM = 2.0
"""Steps of a backbone, at most; each has two Gauss points."""

COEFFICIENT_MM = 9.0
"""Length of a curve for each coefficient of its curvature and of routings."""

EMPTY: Floats = np.empty((0, 0, 0, 0))


@dataclass(frozen=True, kw_only=True)
class RoutingLimits:
    """What a routing has to keep to.

    Parameters
    ----------
    offset_max : float
        Largest distance of a tendon from the backbone [mm].
    core_radius : float
        Least one [mm]; with 0 a tendon may cross the backbone.
    slope_max : float
        Largest slope of a tendon against the backbone.
    gap_min : float
        Least distance between the middles of two tendons in a cross-section [mm].
    error_max : float
        Largest distance of the backbone from the curve [mm].

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    offset_max: float = quantity(
        "length",
        "Largest distance from the backbone.",
        low=0.01,
        high=1e3,
        default=2.0,
        by_name=True,
    )
    core_radius: float = quantity(
        "length",
        "Least distance from the backbone.",
        low=0.0,
        high=lambda limits: limits.offset_max,
        default=0.0,
        by_name=True,
    )
    slope_max: float = quantity(
        "dimensionless",
        "Largest slope.",
        low=0.0,
        high=3.0,
        low_open=True,
        default=0.4,
        by_name=True,
    )
    gap_min: float = quantity(
        "length",
        "Least distance between two tendons.",
        low=0.0,
        high=lambda limits: 2.0 * limits.offset_max,
        default=1.2,
        by_name=True,
    )
    error_max: float = quantity(
        "length",
        "Largest distance from the curve.",
        low=0.0,
        high=1e3,
        low_open=True,
        default=1.0,
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)


# A backbone in steps, traced from its curvature.


@dataclass(frozen=True, kw_only=True, eq=False)
class BackboneTrace:
    """A backbone: its points (n + 1, 3), frames (n + 1, 3, 3), and what moves them."""

    points: Floats
    turns: Floats
    by_turn: Floats
    by_place: Floats

    def move(self, changes: Floats) -> Floats:
        """Return how points move, (n + 1, 3, q), with changes of curvature (n, 2, 3, q)."""
        turn = np.zeros((len(self.points), 3, changes.shape[-1]))
        place = np.zeros_like(turn)
        n, q = len(changes), changes.shape[-1]
        flat = changes.reshape(n, 6, q)
        for into, by in ((turn, self.by_turn), (place, self.by_place)):
            np.cumsum(by.reshape(n, 6, 3).transpose(0, 2, 1) @ flat, axis=0, out=into[1:])
        return place + np.cross(turn, self.points[:, :, None], axis=1)


@dataclass(frozen=True)
class BackboneSteps:
    """Even steps of a backbone, with two Gauss points in each.

    Parameters
    ----------
    length : float
        Of the backbone [mm].
    count : int
        Number of steps.
    """

    length: float
    count: int

    @classmethod
    def cut(cls, length: float) -> BackboneSteps:
        """Return the steps of a length, of at most 2 mm."""
        return cls(length, max(2, math.ceil(length / STEP_MM)))

    @cached_property
    def ends(self) -> Floats:
        """Ends of the steps [mm], shape (count + 1,)."""
        return np.linspace(0.0, self.length, self.count + 1)

    @cached_property
    def places(self) -> Floats:
        """Gauss points [mm], shape (2 n,)."""
        shares = 0.5 + np.array([-0.5, 0.5]) / math.sqrt(3.0)
        return (self.ends[:-1, None] + np.diff(self.ends)[:, None] * shares).ravel()

    def make_basis(self, count: int) -> tuple[Floats, Floats]:
        """Return `count` cubic B-splines and their slopes at the Gauss points, (2 n, count)."""
        splines = make_splines(self.length, count)
        return np.asarray(splines(self.places)), np.asarray(splines(self.places, 1))

    def trace(self, curvatures: Floats, frame: Floats, *, moves: bool = False) -> BackboneTrace:
        """Return the backbone of curvatures (2 n, 3) from a frame (4, 4) on."""
        n = self.count
        points, turns = np.empty((n + 1, 3)), np.empty((n + 1, 3, 3))
        by_turn, by_place = np.empty((2, n, 2, 3, 3)) if moves else (EMPTY, EMPTY)
        points[0] = frame[:3, 3]
        start = np.ascontiguousarray(frame[:3, :3])
        bends = np.ascontiguousarray(curvatures.reshape(n, 2, 3))
        trace_backbone(np.diff(self.ends), bends, start, points, turns, by_turn, by_place)
        return BackboneTrace(points=points, turns=turns, by_turn=by_turn, by_place=by_place)


def make_splines(length: float, count: int) -> Callable[..., Floats]:
    """Return `count` cubic B-splines over a length, as one spline of that many columns."""
    from scipy.interpolate import BSpline

    inner = np.linspace(0.0, length, count - 2)
    knots = np.concatenate([[0.0] * 3, inner, [length] * 3])
    splines: Callable[..., Floats] = BSpline(knots, np.eye(count), 3)
    return splines


def count_coefficients(length: float) -> int:
    """Return how many coefficients a curvature or a routing of a length has."""
    return max(6, round(length / COEFFICIENT_MM))


# Least squares of a backbone's points, by parameters of its curvature and the base's rotation.

FAR_MM = 1e3
"""Residual of a trial that has no curvature."""


class BackboneFit(ABC):
    """A backbone whose curvature has parameters, fitted to points of a curve.

    Parameters ``x`` (q,) of a subclass are followed by the base's rotation vector (3,).
    """

    def __init__(self, steps: BackboneSteps, targets: Floats, frame: Floats) -> None:
        self.steps, self.targets, self.frame = steps, targets, frame
        self._known: tuple[bytes, Floats, Floats] | None = None

    @abstractmethod
    def bend(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return curvatures (2 n, 3), their derivatives (2 n, 3, q), penalties and theirs."""

    def place_base(self, rotation: Floats) -> Floats:
        """Return the base's frame (4, 4) for a rotation vector."""
        from scipy.spatial.transform import Rotation

        frame = self.frame.copy()
        frame[:3, :3] = Rotation.from_rotvec(rotation).as_matrix() @ self.frame[:3, :3]
        return frame

    def evaluate(self, x: Floats) -> tuple[Floats, Floats]:
        """Return residuals and their Jacobian."""
        key = x.tobytes()
        if self._known is not None and self._known[0] == key:
            return self._known[1:]
        try:
            curvatures, changes, penalties, slopes = self.bend(x[:-3])
        except GeometryError:
            if self._known is None:
                raise
            # A trial far beyond what a rod does: worse than any other.
            return np.full_like(self._known[1], FAR_MM), self._known[2]
        trace = self.steps.trace(curvatures, self.place_base(x[-3:]), moves=True)
        n, q = self.steps.count, len(x)
        moves = np.empty((n + 1, 3, q))
        moves[..., :-3] = trace.move(changes.reshape(n, 2, 3, q - 3))
        away = trace.points - trace.points[0]
        for k, column in enumerate(_turn_axes(x[-3:]).T):
            moves[..., q - 3 + k] = np.cross(column, away)
        residuals = np.concatenate([(trace.points - self.targets).ravel(), penalties])
        jacobian = np.zeros((len(residuals), q))
        jacobian[: moves.shape[0] * 3] = moves.reshape(-1, q)
        jacobian[moves.shape[0] * 3 :, :-3] = slopes
        self._known = key, residuals, jacobian
        return residuals, jacobian

    def improve(self, x: Floats, *, low: Floats | None = None, most: int = 60) -> Floats:
        """Return better parameters; `low` (q,) are their lower bounds."""
        from scipy.optimize import least_squares

        bounds = (-np.inf if low is None else np.append(low, [-np.inf] * 3), np.inf)
        found = least_squares(
            lambda x: self.evaluate(x)[0],
            np.append(x, np.zeros(3)) if len(x) == self.size else x,
            jac=lambda x: self.evaluate(x)[1],
            bounds=bounds,
            x_scale="jac",
            max_nfev=most,
            ftol=1e-7,
            xtol=1e-7,
        )
        return np.asarray(found.x)

    def measure(self, x: Floats) -> float:
        """Return the distance from the curve, rms [mm]."""
        off = self.evaluate(x)[0][: self.targets.size].reshape(-1, 3)
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of parameters, without the rotation."""


def _turn_axes(rotation: Floats) -> Floats:
    """Return (3, 3) how a rotation matrix turns, in space, with its rotation vector."""
    angle = float(np.linalg.norm(rotation))
    x, y, z = rotation
    hat = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) + 0.5 * hat)
    b, d = (1.0 - math.cos(angle)) / angle**2, (angle - math.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + b * hat + d * hat @ hat)


# The curve as a curvature without twist (Bishop's frame).

BEND_PENALTY = 3.0
"""Weight of differences between coefficients of the curvature, mm for 1/mm."""


class CurvatureFit(BackboneFit):
    """A backbone without twist, whose curvature is a spline in both directions."""

    def __init__(self, steps: BackboneSteps, targets: Floats, frame: Floats, count: int) -> None:
        super().__init__(steps, targets, frame)
        self.basis, self.slopes = steps.make_basis(count)
        self.count = count
        self._changes = np.zeros((len(self.basis), 3, 2 * count))
        self._changes[:, 1, :count] = self.basis
        self._changes[:, 0, count:] = -self.basis
        self._rough = np.asarray(
            BEND_PENALTY * np.kron(np.eye(2), np.diff(np.eye(count), axis=0)), dtype=np.float64
        )

    @property
    def size(self) -> int:
        """Number of parameters, without the rotation."""
        return 2 * self.count

    def bend(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return curvatures, their derivatives, penalties and theirs."""
        return self._changes @ x, self._changes, np.asarray(self._rough @ x), self._rough


@dataclass(frozen=True, kw_only=True, eq=False)
class BendTarget:
    """A curve as a rod without twist.

    Parameters
    ----------
    steps : BackboneSteps
    points : (n + 1, 3) ndarray
        Of the curve, at the steps' ends [mm].
    frame : (4, 4) ndarray
        Of the base [mm].
    curvature, slope : (2 n, 2) ndarray
        The vector towards which it bends, in Bishop's frame, and its derivative [1/mm], [1/mm^2].
    residual : float
        Distance of such a rod from the curve, rms [mm].
    """

    steps: BackboneSteps
    points: Floats
    frame: Floats
    curvature: Floats
    slope: Floats
    residual: float

    @property
    def sharpest(self) -> float:
        """Largest curvature [1/mm]."""
        return float(np.hypot(*self.curvature.T).max())


def fit_bend(points: Floats) -> BendTarget:
    """Return a curve (m, 3) [mm] as a rod without twist, by least squares of its places.

    Raises
    ------
    GeometryError
        If the curve turns back on itself at a point.
    """
    from scipy.interpolate import make_lsq_spline

    arc = measure_arc_length(points)
    length = float(arc[-1])
    steps = BackboneSteps.cut(length)
    targets = interpolate_polyline(points, arc, steps.ends)
    count = count_coefficients(length)
    # Smoothed positions, for a start: from a straight rod the fit would end in folds.
    places = np.linspace(0.0, length, 4 * len(steps.ends))
    inner = np.linspace(0.0, length, count - 2)
    knots = np.concatenate([[0.0] * 3, inner, [length] * 3])
    smooth = make_lsq_spline(places, interpolate_polyline(points, arc, places), knots)
    tangents = smooth(steps.places, 1)
    sizes = np.linalg.norm(tangents, axis=1)
    if sizes.min() < TURNS_BACK:
        place = float(steps.places[int(np.argmin(sizes))])
        raise GeometryError(f"the curve turns back at {place:.1f} mm: no rod takes that shape")
    first = smooth(0.0, 1)
    frames = carry_frames(
        np.concatenate([[first / np.linalg.norm(first)], tangents / sizes[:, None]])
    )
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = frames[0], targets[0]
    bends = np.einsum("ia,iak->ik", smooth(steps.places, 2), frames[1:, :, :2])
    fit = CurvatureFit(steps, targets, frame, count)
    start = np.linalg.lstsq(fit.basis, bends, rcond=None)[0]
    found = fit.improve(start.T.ravel())
    coefficients = found[:-3].reshape(2, count)
    return BendTarget(
        steps=steps,
        points=targets,
        frame=fit.place_base(found[-3:]),
        curvature=fit.basis @ coefficients.T,
        slope=fit.slopes @ coefficients.T,
        residual=fit.measure(found),
    )


TURNS_BACK = 0.2
"""A smoothed curve moves on by at least this for each mm of its length."""


# Closed forms: one tendon, and two of constant offset.


def _integrate(places: Floats, rates: Floats) -> Floats:
    """Return the integral from 0 of rates at increasing places."""
    from scipy.integrate import cumulative_trapezoid

    inner = cumulative_trapezoid(rates, places, initial=0.0)
    return np.asarray(inner + places[0] * rates[0])


def route_one(target: BendTarget, stiffness: Floats, tension: float) -> Floats:
    """Return the path (2 n, 2) of one tendon that holds a curve, to first order [mm].

    `stiffness` is (EI, EI, GJ) [N mm^2]. With ``beta = (EI / GJ) kappa r / (1 - kappa r)`` the rod
    turns by ``psi' = -beta theta'`` against Bishop's frame, and ``p = EI / T R(-psi) kappa``. The
    tendon is on the inside of the bend, where it is shorter by ``1 - kappa r``, and so steeper.
    """
    bending, torsional = stiffness[0], stiffness[2]
    x, y = target.curvature.T
    inside = 1.0 - bending / tension * (x**2 + y**2)
    turning = (x * target.slope[:, 1] - y * target.slope[:, 0]) / inside  # kappa^2 theta'
    twist = _integrate(target.steps.places, -(bending**2) / (torsional * tension) * turning)
    cosine, sine = np.cos(twist), np.sin(twist)
    path = np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)
    return np.asarray(bending / tension * path)


DIRECTIONS = 72
"""Directions of the plane in which the pair of tendons is sought."""

TURN_WEIGHT = 0.02
"""What a turn of that direction costs, see `find_directions`."""


def find_directions(target: BendTarget, weight: float = TURN_WEIGHT) -> Floats:
    """Return smooth angles (2 n,) [rad] along which, one way or the other, a curve bends.

    The best of all sequences of directions, by dynamic programming: at an inflection the direction
    goes on while the curvature changes its sign. `weight` is that of a squared turn by 1 rad/mm,
    against a squared share of the curvature off the plane.
    """
    angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    x, y = target.curvature.T / target.sharpest
    off = (x[:, None] * np.sin(angles) - y[:, None] * np.cos(angles)) ** 2
    spans = np.diff(target.steps.places)
    apart = (np.arange(DIRECTIONS)[:, None] - np.arange(DIRECTIONS)) % DIRECTIONS
    apart = np.minimum(apart, DIRECTIONS - apart)
    turns = weight * (apart * (2.0 * math.pi / DIRECTIONS)) ** 2
    cost, came = off[0], np.zeros((len(off), DIRECTIONS), dtype=np.int64)
    for row in range(1, len(off)):
        total = cost[:, None] + turns / spans[row - 1] ** 2
        came[row] = np.argmin(total, axis=0)
        cost = total[came[row], np.arange(DIRECTIONS)] + off[row]
    chosen = np.empty(len(off), dtype=np.int64)
    chosen[-1] = int(np.argmin(cost))
    for row in range(len(off) - 1, 0, -1):
        chosen[row - 1] = came[row, chosen[row]]
    return np.asarray(np.unwrap(angles[chosen]))


def route_pair(
    target: BendTarget,
    stiffness: Floats,
    limits: RoutingLimits,
    *,
    start: tuple[float, float],
    tendons: int = 2,
) -> tuple[Floats, Floats]:
    """Return angles (2 n, k) [rad] of tendons at `offset_max`, and their tensions (k,) [N].

    Two bundles at ``theta + delta`` and ``theta - delta``, each of the moment
    ``T r = EI kappa / (2 cos delta)``: of two tendons one each, of more half of them, side by side
    at the distance `gap_min`. `T` is the least at which the bundles keep apart where the curvature
    is largest, times the second of `start`; the first is the weight of `find_directions`.
    """
    bending, torsional = stiffness[0], stiffness[2]
    radius = limits.offset_max
    # Half the angle between neighbours, and how far each tendon is from the middle of its bundle.
    half = math.asin(min(limits.gap_min / (2.0 * radius), 1.0))
    sizes = (tendons + 1) // 2, tendons // 2
    fans = [half * (2.0 * np.arange(size) - (size - 1)) for size in sizes]
    share = max(math.cos(min(0.5 * tendons * half, 0.5 * math.pi)), LEAST_SHARE)
    tension = start[1] * bending * target.sharpest / (2.0 * radius * share)
    angles = find_directions(target, start[0])
    along = np.sum(target.curvature * np.stack([np.cos(angles), np.sin(angles)], axis=1), axis=1)
    apart = np.arccos(np.clip(bending * along / (2.0 * tension * radius), -0.98, 0.98))
    turning = np.gradient(angles, target.steps.places)
    twist = _integrate(target.steps.places, -2.0 * tension * radius**2 / torsional * turning)
    bundles = zip((angles + apart - twist, angles - apart - twist), fans, strict=True)
    return (
        np.concatenate([middle[:, None] + fan for middle, fan in bundles], axis=1),
        np.concatenate([np.full(len(fan), tension / np.cos(fan).sum()) for fan in fans]),
    )


LEAST_SHARE = 0.25
"""Share of its largest moment that a pair gives at least, for a start."""


# Routings with parameters, fitted by the exact law.

SLOPE_WEIGHT, PLACE_WEIGHT, TENSION_WEIGHT = 20.0, 3.0, 0.03
"""Weights, in mm, of a slope of 1, a place of 1 mm beyond its limit, and of a tension of 1 N."""

TIGHTENINGS, TIGHTER = 3, 4.0
"""Fits of one start, whose limits weigh more each time, and by what."""

NEAR, NEAR_MM = 1.5, 0.02
"""A start serves that is as near to the curve as this, against a rod without tendons, and more."""

INSIDE_SLOPE, INSIDE_MM = 0.01, 0.02
"""How far inside its limits a fit aims: a share of the slope, and a length [mm]."""

LEAST_TENSION_SHARE = 1e-3
"""Least tension of a fit, against that of its start."""


class RoutingFit(BackboneFit):
    """A rod under tendons, whose routing has coefficients of splines; the last are tensions."""

    def __init__(self, target: BendTarget, stiffness: Floats, limits: RoutingLimits) -> None:
        super().__init__(target.steps, target.points, target.frame)
        self.stiffness, self.limits = stiffness, limits
        self.count = count_coefficients(target.steps.length)
        self.basis, self.slopes = target.steps.make_basis(self.count)
        splines = make_splines(target.steps.length, self.count)
        looked = np.linspace(0.0, target.steps.length, 2 * target.steps.count + 1)
        self._looked = np.asarray(splines(looked)), np.asarray(splines(looked, 1))
        self._bends = np.zeros((len(self.basis), 3))
        self.weight = 1.0

    tendons: int
    constant_offset: bool

    @property
    def size(self) -> int:
        """Number of parameters, without the rotation."""
        return (self.count * (1 if self.constant_offset else 2) + 1) * self.tendons

    @abstractmethod
    def guide(self, x: Floats, basis: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Return places and slopes (m, k, 4) and their derivatives (m, k, 4, q)."""

    def bend(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return curvatures, their derivatives, penalties and theirs."""
        guides, changes = self.guide(x, self.basis, self.slopes)
        curvatures, by_guides, by_tensions = find_bends(
            self.stiffness, guides, x[-self.tendons :], start=self._bends
        )
        self._bends = curvatures
        moved = np.einsum("mkcu,mkcq->muq", by_guides, changes, optimize=True)
        moved[:, :, -self.tendons :] += by_tensions.transpose(0, 2, 1)
        penalties = list(self._penalise(*self.guide(x, *self._looked)))
        pull = np.zeros((self.tendons, self.size))
        pull[:, -self.tendons :] = TENSION_WEIGHT * np.eye(self.tendons)
        penalties.append((pull @ x, pull))
        return (
            curvatures,
            moved,
            np.concatenate([value for value, _ in penalties]),
            np.concatenate([slope for _, slope in penalties]),
        )

    @abstractmethod
    def list_starts(self, target: BendTarget) -> Iterator[Floats]:
        """Give parameters of the closed form, one start after the other."""

    def settle(self, target: BendTarget) -> Floats:
        """Return the parameters that keep the limits, near to the curve, with the least tensions.

        If no start leads to such, those of the one that is nearest to that. To take the first one
        would depend on the processor: whether a start leads there may hang on rounding.
        """
        best, least = np.empty(0), (math.inf, math.inf)
        for start in self.list_starts(target):
            self.weight = 1.0
            found = self._tighten(start)
            beyond = self.measure_beyond(found)
            off = max(self.measure(found) - NEAR * target.residual - NEAR_MM, 0.0)
            value = beyond + off, float(found[: self.size][-self.tendons :].sum())
            if value < least:
                best, least = found, value
        return best

    def _tighten(self, start: Floats) -> Floats:
        found, low = start, np.full(self.size, -np.inf)
        low[-self.tendons :] = LEAST_TENSION_SHARE * start[-self.tendons :]
        for _ in range(TIGHTENINGS):
            self._known = None
            found = self.improve(found, low=low)
            if self.measure_beyond(found) == 0.0:
                break
            self.weight *= TIGHTER
        return found

    def measure_beyond(self, x: Floats) -> float:
        """Return by how much limits are passed, weighted; 0 if they are kept."""
        penalties = self._penalise(*self.guide(x[:-3], *self._looked), inside=0.0)
        return max((float(value.max()) for value, _ in penalties), default=0.0) / self.weight

    def _penalise(
        self, guides: Floats, changes: Floats, inside: float = 1.0
    ) -> Iterator[tuple[Floats, Floats]]:
        """Give values (m,) beyond limits, weighted, and their derivatives (m, q).

        With `inside` 1 limits are drawn in by what a fit keeps from them.
        """
        limits, margin = self.limits, inside * INSIDE_MM
        for k in range(self.tendons):
            steep, by = _measure(guides[:, k, 2:], changes[:, k, 2:])
            yield _hinge(
                steep - (1.0 - inside * INSIDE_SLOPE) * limits.slope_max,
                by,
                self.weight * SLOPE_WEIGHT,
            )
            if not self.constant_offset:
                far, by = _measure(guides[:, k, :2], changes[:, k, :2])
                yield _hinge(far - limits.offset_max + margin, by, self.weight * PLACE_WEIGHT)
                if limits.core_radius > 0.0:
                    yield _hinge(limits.core_radius + margin - far, -by, self.weight * PLACE_WEIGHT)
        for one, two in combinations(range(self.tendons), 2):
            gap, by = _measure(
                guides[:, one, :2] - guides[:, two, :2], changes[:, one, :2] - changes[:, two, :2]
            )
            yield _hinge(limits.gap_min + margin - gap, -by, self.weight * PLACE_WEIGHT)


def _measure(vectors: Floats, changes: Floats) -> tuple[Floats, Floats]:
    """Return the lengths (m,) of vectors (m, 2), and their derivatives (m, q)."""
    sizes = np.linalg.norm(vectors, axis=1)
    ways = vectors / np.maximum(sizes, 1e-12)[:, None]
    return sizes, np.asarray(np.einsum("ma,maq->mq", ways, changes))


def _hinge(beyond: Floats, by: Floats, weight: float) -> tuple[Floats, Floats]:
    over = beyond > 0.0
    return weight * beyond * over, weight * by * over[:, None]


def find_bends(
    stiffness: Floats, guides: Floats, tensions: Floats, *, start: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return curvatures (m, 3), and their derivatives by guides and tensions, by the exact law.

    Raises
    ------
    GeometryError
        If there is no curvature.
    """
    m, k, _ = guides.shape
    bends = start.copy()
    by_guides, by_tensions = np.empty((m, k, 4, 3)), np.empty((m, k, 3))
    present = np.ones((m, k), dtype=np.bool_)
    good = find_curvatures(stiffness, guides, present, tensions, bends, by_guides, by_tensions)
    if not good:
        raise GeometryError("no curvature was found under these tensions")
    return bends, by_guides, by_tensions


class PathFit(RoutingFit):
    """One tendon whose x and y are splines: it may cross the backbone."""

    tendons, constant_offset = 1, False

    def guide(self, x: Floats, basis: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Return places and slopes, and their derivatives."""
        changes = np.zeros((len(basis), 1, 4, self.size))
        for axis in range(2):
            columns = slice(axis * self.count, (axis + 1) * self.count)
            changes[:, 0, axis, columns] = basis
            changes[:, 0, 2 + axis, columns] = slopes
        return changes @ x, changes

    def list_starts(self, target: BendTarget) -> Iterator[Floats]:
        """Give the closed form, at a tension that keeps offset and slope."""
        tension = self.stiffness[0] * target.sharpest / self.limits.offset_max
        for _ in range(TENSIONS_TRIED):
            path = route_one(target, self.stiffness, tension)
            coefficients = np.linalg.lstsq(self.basis, path, rcond=None)[0]
            steep = float(np.hypot(*(self.slopes @ coefficients).T).max())
            if steep <= self.limits.slope_max:
                break
            tension *= min(2.0, max(1.05, steep / self.limits.slope_max))
        yield np.append(coefficients.T.ravel(), tension)


TENSIONS_TRIED = 20
"""Tensions tried for a start that keeps the slope."""


class AngleFit(RoutingFit):
    """Two tendons or more at `offset_max` from the backbone, whose angles are splines."""

    constant_offset = True

    def __init__(
        self, target: BendTarget, stiffness: Floats, limits: RoutingLimits, tendons: int
    ) -> None:
        super().__init__(target, stiffness, limits)
        self.tendons = tendons

    def guide(self, x: Floats, basis: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Return places and slopes, and their derivatives."""
        radius, count = self.limits.offset_max, self.count
        changes = np.zeros((len(basis), self.tendons, 4, self.size))
        guides = np.empty((len(basis), self.tendons, 4))
        for k in range(self.tendons):
            columns = slice(k * count, (k + 1) * count)
            angles, twists = basis @ x[columns], slopes @ x[columns]
            across = radius * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
            inwards = -radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            guides[:, k, :2] = -inwards
            guides[:, k, 2:] = across * twists[:, None]
            changes[:, k, :2, columns] = across[:, :, None] * basis[:, None]
            changes[:, k, 2:, columns] = (
                across[:, :, None] * slopes[:, None]
                + (inwards * twists[:, None])[:, :, None] * basis[:, None]
            )
        return guides, changes

    def list_starts(self, target: BendTarget) -> Iterator[Floats]:
        """Give the closed form, with other turns of the direction and larger tensions."""
        smooth = np.concatenate([self.basis, SMOOTHING * np.diff(np.eye(self.count), 2, axis=0)])
        for start in PAIR_STARTS:
            angles, tensions = route_pair(
                target, self.stiffness, self.limits, start=start, tendons=self.tendons
            )
            values = np.concatenate([angles, np.zeros((self.count - 2, self.tendons))])
            coefficients = np.linalg.lstsq(smooth, values, rcond=None)[0]
            yield np.concatenate([coefficients.T.ravel(), tensions])


PAIR_STARTS = ((0.02, 1.0), (0.1, 1.1), (0.5, 1.3), (0.004, 1.2))
"""Starts of a pair: what turns of its direction cost, and its tension against the least."""

SMOOTHING = 1.0
"""Weight of second differences of coefficients, for the start of the angles."""


# Straight tendons, each with its own end: what a routing is compared with.


@dataclass(frozen=True, kw_only=True, eq=False)
class StraightTendons:
    """Straight tendons: angles [rad], ends [mm], tensions [N], each (k,), and the base's frame."""

    angles: Floats
    ends: Floats
    tensions: Floats
    frame: Floats


def fit_straight(
    target: BendTarget, stiffness: Floats, *, offset: float, tendons: int
) -> StraightTendons:
    """Return the straight tendons at an offset [mm] whose rod is nearest to a curve.

    Between two ends the rod is an arc. Ends are those of the best steps of the curvature, and even
    ones, from which angles, tensions and ends are fitted to the curve's points.
    """
    length = target.steps.length
    fit = _Arcs(target, stiffness, offset)
    starts = []
    even = length * np.arange(1, tendons + 1) / tendons
    for ends in (split_curvature(target, tendons), even):
        edges = np.concatenate([[0.0], ends])
        means = [
            target.curvature[(target.steps.places > low) & (target.steps.places <= high)]
            for low, high in pairwise(edges)
        ]
        levels = np.array([rows.mean(axis=0) if len(rows) else (0.0, 0.0) for rows in means])
        moments = stiffness[0] * (levels - np.concatenate([levels[1:], np.zeros((1, 2))]))
        starts.append(np.concatenate([moments.ravel(), ends, np.zeros(3)]))
    low, high = np.full(len(starts[0]), -np.inf), np.full(len(starts[0]), np.inf)
    among = slice(2 * tendons, 3 * tendons)
    low[among], high[among] = min(1.0, 0.01 * length), length
    search = LeastSquares(misfit=fit.place, bounds=(low, high), scale="jac", ftol=1e-6)
    best = search.search([np.clip(start, low, high) for start in starts], evaluations=60)
    moments, ends, rotation = fit.split(best.point)
    order = np.argsort(ends)
    return StraightTendons(
        angles=np.arctan2(moments[order, 1], moments[order, 0]),
        ends=ends[order],
        tensions=np.linalg.norm(moments[order], axis=1) / offset,
        frame=fit.place_base(rotation),
    )


def split_curvature(target: BendTarget, pieces: int) -> Floats:
    """Return the ends (pieces,) of the best pieces of even curvature, in the mean square [mm]."""
    edges = np.concatenate([target.steps.places, [target.steps.length]])
    places = edges[split_rows(target.curvature, pieces)[1:]]
    places[-1] = target.steps.length
    return np.asarray(places)


def split_rows(
    rows: Floats, pieces: int, *, power: float = 0.0, least: int = 1
) -> NDArray[np.int64]:
    """Return the edges (pieces + 1,) of pieces of rows (m, q) that vary least from their means.

    By dynamic programming; the squares of a piece of n rows, at least `least`, weigh n to `power`.
    """
    sums = np.concatenate([np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum(np.sum(rows**2, axis=1))])
    index = np.arange(len(sums))
    many = index[None] - index[:, None]
    size = np.maximum(many, 1)
    inner = sums @ sums.T
    own = np.diag(inner)
    costs = squares[None] - squares[:, None] - (own[None] + own[:, None] - 2.0 * inner) / size
    costs *= size.astype(np.float64) ** power
    costs[many < least] = np.inf
    total, came = costs[0], []
    for _ in range(pieces - 1):
        trial = total[:, None] + costs
        came.append(np.argmin(trial, axis=0))
        total = np.min(trial, axis=0)
    ends = [len(rows)]
    for back in reversed(came):
        ends.append(int(back[ends[-1]]))
    return np.array([0, *ends[::-1]])


class _Arcs(CurvatureFit):
    """A rod under straight tendons; parameters are moments (k, 2), ends (k,), rotation (3,)."""

    def __init__(self, target: BendTarget, stiffness: Floats, offset: float) -> None:
        super().__init__(target.steps, target.points, target.frame, 6)
        self.stiffness, self.offset = stiffness, offset

    def split(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return moments, ends and rotation."""
        tendons = (len(x) - 3) // 3
        return x[: 2 * tendons].reshape(-1, 2), x[2 * tendons : -3], x[-3:]

    def place(self, x: Floats) -> Floats:
        """Return how far the points are from the curve, each coordinate."""
        moments, ends, rotation = self.split(x)
        tensions = np.linalg.norm(moments, axis=1) / self.offset
        ways = moments / np.maximum(tensions, 1e-12)[:, None]
        places = np.unique(np.concatenate([self.steps.ends, ends]))
        middles = 0.5 * (places[1:] + places[:-1])
        present = middles[:, None] < ends
        rows, back = np.unique(present, axis=0, return_inverse=True)
        guides = np.zeros((len(rows), len(ends), 4))
        guides[..., :2] = ways
        bends = np.zeros((len(rows), 3))
        none = np.empty((0, 0, 0, 0)), np.empty((0, 0, 0))
        if not find_curvatures(self.stiffness, guides, rows, tensions, bends, *none):
            return np.full(3 * len(self.targets), 1e3)
        curvatures = np.repeat(bends[back.ravel()][:, None], 2, axis=1)
        points, turns = np.empty((len(places), 3)), np.empty((len(places), 3, 3))
        frame = self.place_base(rotation)
        points[0] = frame[:3, 3]
        start = np.ascontiguousarray(frame[:3, :3])
        trace_backbone(np.diff(places), curvatures, start, points, turns, EMPTY, EMPTY)
        index = np.searchsorted(places, self.steps.ends)
        return np.asarray((points[index] - self.targets).ravel())
