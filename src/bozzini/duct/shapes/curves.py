"""The region between two curves (thesis 5.3.2.3), by an outline whose error is stated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import broadcast, check_array, check_number, check_points, refuse_first
from ...errors import GeometryError, InputError
from ..base import DuctShape, Kind, PackedDuct
from ..checks import check_places, freeze_places, set_fields
from ..packed import ShapesData
from .quads import StitchedQuads

# Two curves drawn as chords: how many it takes, how far the curves are from them.

Curve = Callable[[NDArray[np.float64]], ArrayLike]
"""Takes parameters (n,), returns points (n, 2) [mm]."""

Points = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""The same, checked."""

PIECES_MAX = 5000
"""A curve is drawn with at most this many chords."""

PROBES = 7
"""Points of a curve between two samples where its distance from the chord is looked at."""


def take_function(name: str, curve: Curve) -> Points:
    """Return a function whose points are checked: finite, and one for each parameter."""

    def take(u: NDArray[np.float64]) -> NDArray[np.float64]:
        points = check_points(f"{name}(u)", curve(u), dim=2)
        if points.shape != (len(u), 2):
            raise InputError(
                f"{name}(u) has shape {points.shape} for {len(u)} parameters: it must be "
                f"({len(u)}, 2)"
            )
        return points

    return take


def take_samples(samples: NDArray[np.float64], low: float, high: float) -> Points:
    """Return the curve through samples (n, 2), straight between them, u from `low` to `high`."""
    nodes = np.linspace(low, high, len(samples))
    return lambda u: np.stack([np.interp(u, nodes, column) for column in samples.T], axis=1)


def draw_chords(
    curves: tuple[Points, Points],
    low: float,
    high: float,
    *,
    tolerance: float,
    curvature: float | None,
) -> tuple[NDArray[np.float64], float]:
    """Choose parameters (n,) whose chords are near to both curves.

    Returns
    -------
    parameters : (n,) float
        Evenly spaced from `low` to `high`.
    error : float
        How far the curves may be from their chords, at most the tolerance [mm]: proved where
        `curvature` bounds their second derivatives, else twice the largest distance found.

    Raises
    ------
    InputError
        If that takes more than 5000 chords.
    """
    if curvature is not None:
        pieces = 1 + int((high - low) * np.sqrt(curvature / (8.0 * tolerance)))
        _check_count(pieces, tolerance)
        error = curvature * ((high - low) / pieces) ** 2 / 8.0
        return np.linspace(low, high, pieces + 1), float(error)
    pieces = 16
    while True:
        _check_count(pieces, tolerance)
        u = np.linspace(low, high, pieces + 1)
        error = 2.0 * max(_measure_chords(curve, u) for curve in curves)
        if error <= tolerance:
            return u, error
        pieces = max(pieces + 1, int(1.1 * pieces * np.sqrt(error / tolerance)))


def _check_count(pieces: int, tolerance: float) -> None:
    if pieces > PIECES_MAX:
        raise InputError(
            f"tolerance is {tolerance:g} mm: the curves would need {pieces} chords, it must be "
            f"so large that {PIECES_MAX} are enough"
        )


def _measure_chords(curve: Points, u: NDArray[np.float64]) -> float:
    """Return the largest distance found between a curve and its chords [mm]."""
    ends = curve(u)
    worst = 0.0
    for share in np.arange(1, PROBES + 1) / (PROBES + 1.0):
        middle = curve(u[:-1] + share * np.diff(u))
        away = middle - ends[:-1]
        chord = np.diff(ends, axis=0)
        square = np.maximum(np.sum(chord * chord, axis=1), 1e-300)
        t = np.clip(np.sum(away * chord, axis=1) / square, 0.0, 1.0)
        off = np.linalg.norm(away - t[:, None] * chord, axis=1)
        worst = max(worst, float(off.max()))
    return worst


def check_rulings(
    u: NDArray[np.float64], first: NDArray[np.float64], second: NDArray[np.float64]
) -> None:
    """Raise `GeometryError` if curves through points (n, 2) meet or their rulings cross.

    They do not if the determinant of (x_u, x_v), linear in v, keeps its sign in all quads.
    """
    width = second - first
    gap = np.linalg.norm(width, axis=1)
    size = float(np.ptp(np.concatenate([first, second]), axis=0).max())
    if gap.min() <= 1e-12 * size:
        k = int(np.argmin(gap))
        raise GeometryError(
            f"the curves meet at u = {u[k]:g}, at ({first[k, 0]:g}, {first[k, 1]:g}) mm: they "
            "must stay apart"
        )
    steps = [np.diff(first, axis=0), np.diff(second, axis=0)]
    turns = np.stack(
        [
            step[:, 0] * rung[:, 1] - step[:, 1] * rung[:, 0]
            for step in steps
            for rung in (width[:-1], width[1:])
        ],
        axis=1,
    )
    sense = np.sign(turns.sum())
    wrong = (turns * sense <= 0.0).any(axis=1)
    if wrong.any():
        k = int(np.argmax(wrong))
        raise GeometryError(
            f"rulings cross between u = {u[k]:g} and {u[k + 1]:g}: the curves meet there, turn "
            "back, or are too far apart for their bend"
        )


ESTIMATED = ", error estimated"
"""Added to the name of the wall where nothing bounds how far the curves are from their chords."""


@dataclass(frozen=True)
class CurveCoordinates:
    """Where points lie between two curves.

    Attributes
    ----------
    inside : (...) bool
        Whether a solution was found; the rest is not a number where none was.
    along : (...) float
        u: the parameter of both curves.
    across : (...) float
        v in [0, 1], from the first curve to the second: a share of the ruling, no length.
    """

    inside: NDArray[np.bool_]
    along: NDArray[np.float64]
    across: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BetweenCurves(DuctShape, PackedDuct):
    """All points ``(1 - v) first(u) + v second(u)``, v in [0, 1] (thesis eq. 5.26).

    Parameters
    ----------
    first, second : callable or (n, 2) float
        Both curves, over the same parameter: functions of (n,) parameters that return (n, 2)
        points [mm], or samples, between which the curves are straight.
    span : (2,) float
        First and last parameter; needed for functions, [0, 1] for samples unless given.
    tolerance : float
        The outline may be off the curves by this much [mm].
    curvature : float, optional
        An upper bound of both curves' second derivatives, |d^2 x / du^2| [mm]. Chords over a
        step h of u then err by at most ``curvature * h^2 / 8``. Without it the error is estimated:
        twice the largest found at seven places in each chord.
    inflation, wall, wall_error
        See `DuctShape`.

    Raises
    ------
    GeometryError
        If the curves meet, or rulings cross, with the parameter where; or the region crosses
        itself.
    InputError
        If a curve does not return finite points (n, 2), or the tolerance needs too many chords.

    Notes
    -----
    The signed distance is that of the outline through samples of both curves. For samples it is
    exact; for functions `kind` is "sampled", `error` how far the curves may be from the outline,
    and `clearance_bound` has that taken off: rigorous with `curvature`, and as good as an estimate
    without, which `wall` then states. v is a share of the ruling: halfway between the
    curves is not half the width away from them.
    """

    first: Curve | ArrayLike
    second: Curve | ArrayLike
    span: tuple[float, float] | None = field(default=None, kw_only=True)
    tolerance: float = field(default=0.01, kw_only=True)
    curvature: float | None = field(default=None, kw_only=True)
    wall: str = field(default="region between two curves", kw_only=True)

    name = "curves"
    dim = 2
    unit_kinds = dict.fromkeys(("first", "second", "tolerance", "curvature"), "length")

    def __post_init__(self) -> None:
        check_number("tolerance", self.tolerance, low=0.0, low_open=True, unit="mm")
        super().__post_init__()
        if self.curvature is None and callable(self.first) and not self.wall.endswith(ESTIMATED):
            set_fields(self, wall=self.wall + ESTIMATED)
        if self.curvature is not None:
            check_number("curvature", self.curvature, low=0.0, unit="mm")
        if callable(self.first) != callable(self.second):
            raise InputError("first and second must both be functions, or both samples (n, 2)")
        if self.span is None and callable(self.first):
            raise InputError("span is missing: it must be the first and last parameter")
        if self.span is not None:
            span = check_array("span", self.span)
            if span.shape != (2,):
                raise InputError(f"span has shape {span.shape}: it must be (2,)")
            low = check_number("span[0]", float(span[0]))
            high = check_number("span[1]", float(span[1]), low=low, low_open=True)
            set_fields(self, span=(low, high))
        if not callable(self.first):
            first = freeze_places("first", self.first, 2, least=2)
            second = freeze_places("second", cast(ArrayLike, self.second), 2, least=2)
            if len(first) != len(second):
                raise InputError(
                    f"second has {len(second)} point(s): it must have as many as first, "
                    f"{len(first)}"
                )
            set_fields(self, first=first, second=second)
        _ = self.quads

    @property
    def kind(self) -> Kind:
        """Sampled from functions; exact through samples, with inflation a lower bound."""
        return "sampled" if self.error > 0.0 else self.quads.kind

    @property
    def error(self) -> float:
        """How far the curves may be from the outline [mm]; 0 for samples."""
        return self._drawn[1]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 2) corners of a box that holds the region [mm]."""
        return np.asarray(self.quads.bounds + np.array([[-self.error], [self.error]]))

    @property
    def exact_outside(self) -> bool:
        """Outside it is the distance to the outline, before inflation."""
        return self.error == 0.0

    def clearance_bound(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return (...) lower bounds of the distance to the wall [mm].

        Rigorous for samples, and for functions with a `curvature`; as good as the estimated
        `error` for functions without.
        """
        return super().clearance_bound(points)

    @property
    def parameters(self) -> NDArray[np.float64]:
        """(n,) parameters of the samples."""
        return self._drawn[0]

    @cached_property
    def quads(self) -> StitchedQuads:
        """The quadrilaterals between the samples of both curves."""
        u = self._drawn[0]
        first, second = (curve(u) for curve in self._curves)
        check_rulings(u, first, second)
        return StitchedQuads(first, second, inflation=self.inflation, wall=self.wall)

    @property
    def family_shapes(self) -> ShapesData:
        """The outline as kernels see it: what it may be off by counts as clearance not there."""
        return self.quads.pack().shift(-self.error)

    def pack(self) -> ShapesData:
        """Return the duct for compiled kernels."""
        data = self.quads.pack()
        return data._replace(slack=data.slack + self.error)

    def locate(self, along: ArrayLike, across: ArrayLike) -> NDArray[np.float64]:
        """Return the (..., 2) points at coordinates (thesis eq. 5.26) [mm]."""
        u, v = broadcast(
            ("along", check_array("along", along)), ("across", check_array("across", across))
        )
        for name, array in (("along", u), ("across", v)):
            refuse_first(~np.isfinite(array), name, array, "it must be finite")
        share = v.reshape(-1, 1)
        flat = u.reshape(-1)
        first, second = (curve(flat) for curve in self._curves)
        return np.asarray((1.0 - share) * first + share * second).reshape(*u.shape, 2)

    def coordinates(self, points: ArrayLike) -> CurveCoordinates:
        """Return the parameters of points (..., 2), by Newton's method from the nearest quad.

        Raises
        ------
        InputError
            If the points are not finite or not (..., 2).
        """
        array = check_places("points", points, dim=2)
        flat = array.reshape(-1, 2)
        nodes = self._drawn[0]
        seed = self.quads.coordinates(flat)
        found = seed.quad >= 0
        k = np.maximum(seed.quad, 0)
        u = nodes[k] + np.where(found, seed.along, 0.0) * (nodes[k + 1] - nodes[k])
        v = np.where(found, seed.across, 0.0)
        if callable(self.first):
            u, v, found = self._polish(flat, u, v, found)
        shape = array.shape[:-1]
        return CurveCoordinates(
            inside=found.reshape(shape),
            along=np.where(found, u, np.nan).reshape(shape),
            across=np.where(found, v, np.nan).reshape(shape),
        )

    def _polish(
        self,
        points: NDArray[np.float64],
        u: NDArray[np.float64],
        v: NDArray[np.float64],
        found: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Newton's steps; points beside the outline by its error start from its nearest place."""
        low, high = self._drawn[0][[0, -1]]
        found = found.copy()
        outside = np.flatnonzero(~found)
        outline = replace(self.quads.outline, inflation=0.0)
        beyond = outline.signed_distance(points[outside])
        near = beyond <= 2.0 * self.error
        close, beyond = outside[near], beyond[near] + 1e-9
        if len(close):
            inner = points[close] - beyond[:, None] * outline.gradient(points[close])
            seed = self.quads.coordinates(inner)
            hit = seed.quad >= 0
            close, k = close[hit], seed.quad[hit]
            nodes = self._drawn[0]
            u[close] = nodes[k] + seed.along[hit] * (nodes[k + 1] - nodes[k])
            v[close] = seed.across[hit]
            found[close] = True
        todo = np.flatnonzero(found)
        step = 1e-6 * (high - low)
        scale = float(np.ptp(self.quads.bounds, axis=0).max())
        for _ in range(30):
            if len(todo) == 0:
                break
            here = self.locate(u[todo], v[todo])
            off = points[todo] - here
            todo = todo[np.linalg.norm(off, axis=1) > 1e-13 * scale]
            off = points[todo] - self.locate(u[todo], v[todo])
            left, right = np.maximum(u[todo] - step, low), np.minimum(u[todo] + step, high)
            du = self.locate(right, v[todo]) - self.locate(left, v[todo])
            du /= (right - left)[:, None]
            dv = self.locate(u[todo], 1.0) - self.locate(u[todo], 0.0)
            det = du[:, 0] * dv[:, 1] - du[:, 1] * dv[:, 0]
            u[todo] += (off[:, 0] * dv[:, 1] - off[:, 1] * dv[:, 0]) / det
            v[todo] += (du[:, 0] * off[:, 1] - du[:, 1] * off[:, 0]) / det
            u[todo] = np.clip(u[todo], low, high)
        kept = np.flatnonzero(found)
        miss = np.linalg.norm(points[kept] - self.locate(u[kept], v[kept]), axis=1)
        good = (miss <= 1e-9 * scale) & (np.abs(v[kept] - 0.5) <= 0.5 + 1e-9)
        found = np.zeros(len(points), dtype=bool)
        found[kept[good]] = True
        return u, np.clip(v, 0.0, 1.0), found

    @property
    def _curves(self) -> tuple[Points, Points]:
        low, high = self._ends
        first, second = (
            take_function(name, given)
            if callable(given)
            else take_samples(np.asarray(given), low, high)
            for name, given in (("first", self.first), ("second", self.second))
        )
        return first, second

    @property
    def _ends(self) -> tuple[float, float]:
        return self.span if self.span is not None else (0.0, 1.0)

    @cached_property
    def _drawn(self) -> tuple[NDArray[np.float64], float]:
        """Parameters of the samples, and how far the curves may be from the chords [mm]."""
        low, high = self._ends
        if not callable(self.first):
            return np.linspace(low, high, len(np.asarray(self.first))), 0.0
        return draw_chords(
            self._curves, low, high, tolerance=self.tolerance, curvature=self.curvature
        )
