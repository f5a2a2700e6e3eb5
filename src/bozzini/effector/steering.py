"""Steering: the thesis's cubics, traces of the tip, and the thumb-stick (thesis 4.6)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import (
    check_array,
    check_axes,
    check_fields,
    check_integer,
    check_number,
    check_points,
    check_range,
    quantity,
)
from ..errors import InputError
from ..results import Json, Result, Shown, tabulated, take_axes, to_plain
from .equilibrium import balance
from .inverse import (
    MISS_TOLERANCE_MM,
    EffectorInverse,
    find_reach,
    find_sectors,
    solve_displacements,
    solve_inverse,
    take_amplitudes,
    take_place,
    take_targets,
)
from .model import EffectorModel
from .pose import pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_SAMPLES = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class CubicFit(Shown):
    """A cubic of pressure for the deflection by one muscle, and how far it is off.

    The thesis does not print its cubic, nor where it was fitted. The model's curve is flat
    up to the pressure at which the braid takes hold, has a kink there, and gets flat again where
    the braid locks: no cubic does all that, which is what `rms_error` and `largest_error` show.

    Attributes
    ----------
    name : str
        The muscle.
    coefficients : (4,) float
        ``c_0 + c_1 p + c_2 p^2 + c_3 p^3`` in mm and MPa.
    start, limit : float
        Pressures between which it was fitted [MPa]: up to the design's pressure limit, or to the
        pressure at which the backbone is at its largest deflection, beyond which the curve is flat.
    saturated : bool
        Whether `limit` is the second.
    rising_from : float
        Pressure from which on the cubic rises up to `limit` [MPa]; equal to `start` if it is
        monotone.
    pressure, lateral : (n,) float
        The points it was fitted to [MPa], [mm].
    rms_error, largest_error : float
        Of the cubic against the points [mm].
    """

    name: str
    coefficients: NDArray[np.float64]
    start: float
    limit: float
    saturated: bool
    rising_from: float
    pressure: NDArray[np.float64]
    lateral: NDArray[np.float64]
    rms_error: float
    largest_error: float

    def to_dict(self) -> Json:
        """Return the cubic as plain values, with units in the names."""
        return {
            "coefficients": self.coefficients.tolist(),
            "from_MPa": self.start,
            "to_MPa": self.limit,
            "saturated": self.saturated,
            "rms_error_mm": self.rms_error,
            "largest_error_mm": self.largest_error,
            "monotone": self.monotone,
        }

    @property
    def monotone(self) -> bool:
        """Whether it rises all the way from `start` to `limit`."""
        return self.rising_from <= self.start

    @property
    def lateral_range(self) -> tuple[float, float]:
        """Deflections between `rising_from` and `limit` [mm]: what `find_pressure` inverts."""
        low, high = self._evaluate(np.array([self.rising_from, self.limit]))
        return float(low), float(high)

    def find_lateral(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Return the cubic's deflection [mm] at pressures [MPa] in ``[start, limit]``.

        Raises
        ------
        InputError
            If a pressure is outside.
        """
        values = check_array("pressure", pressure)
        check_range("pressure", values, self.start, self.limit, "MPa")
        return self._evaluate(values)

    def find_pressure(self, lateral: ArrayLike) -> NDArray[np.float64]:
        """Return the pressure [MPa] at which the cubic has a deflection [mm], on its rising part.

        By bisection between `rising_from` and `limit`, where there is exactly one. 0 mm is 0 MPa.
        Deflections below the cubic's range get `rising_from`.

        Raises
        ------
        InputError
            If a deflection is negative, not finite, or above the cubic's range.
        """
        values = check_array("lateral", lateral)
        low, high = self.lateral_range
        words = f"deflection by muscle {self.name}"
        check_range(words, values, 0.0, high * (1.0 + 1e-12), "mm")
        left = np.full(values.shape, self.rising_from)
        right = np.full(values.shape, self.limit)
        for _ in range(60):
            middle = 0.5 * (left + right)
            above = self._evaluate(middle) > values
            right = np.where(above, middle, right)
            left = np.where(above, left, middle)
        pressure = np.where(values < low, self.rising_from, 0.5 * (left + right))
        return np.asarray(np.where(values == 0.0, 0.0, pressure))

    def _evaluate(self, pressure: NDArray[np.float64]) -> NDArray[np.float64]:
        first, second, third, fourth = self.coefficients
        return np.asarray(first + pressure * (second + pressure * (third + pressure * fourth)))


def fit_cubic(
    effector: EffectorModel, name: str, *, start: float = 0.0, samples: int = 200
) -> CubicFit:
    """Fit a cubic to the deflection by one muscle, in least squares.

    Parameters
    ----------
    effector : Effector
    name : str
        The muscle.
    start : float
        Pressure from which to fit, up to the design's pressure limit [MPa]. With 0 the flat part
        below the dead band is in the fit, which a cubic cannot follow.
    samples : int
        Points, equally spaced in pressure.

    Raises
    ------
    InputError
        If an argument is outside its legal range, an equilibrium was not found, or the cubic falls
        at its last pressure, so that it cannot be inverted there.
    """
    limit, saturated = _find_limit(effector, name)
    start = check_number("start", start, low=0.0, high=0.95 * limit, unit="MPa")
    samples = check_integer("samples", samples, low=4, high=MOST_SAMPLES)
    pressure = np.linspace(start, limit, samples)
    found = balance(effector, name, pressure=pressure)
    lost = np.flatnonzero(~(found.converged | found.saturated))
    if lost.size:
        at = lost[0]
        raise InputError(
            f"pressure is {pressure[at]:g} MPa: there is no cubic of muscle {name}, "
            f"{found.reason[at]}"
        )
    lateral = np.asarray(found.lateral)
    # Fitted in pressure over limit, where the columns are of one size.
    scaled = np.vander(pressure / limit, 4, increasing=True)
    solution = np.linalg.lstsq(scaled, lateral, rcond=None)[0]
    error = scaled @ solution - lateral
    coefficients = solution / limit ** np.arange(4)
    return CubicFit(
        name=name,
        coefficients=coefficients,
        start=float(start),
        limit=float(limit),
        saturated=saturated,
        rising_from=find_rise(coefficients, start, limit, name),
        pressure=pressure,
        lateral=lateral,
        rms_error=float(np.sqrt(np.mean(error * error))),
        largest_error=float(np.abs(error).max()),
    )


def look_up_pressures(
    cubics: Mapping[str, CubicFit], names: Sequence[str], *, displacements: ArrayLike
) -> NDArray[np.float64]:
    """Return pressures (..., m) [MPa] from the cubics of muscles, for displacements (..., m) [mm].

    The thesis's controller: `EffectorInverse.displacements` in, pressures out. Displacements above
    a cubic's range get its limit.

    Raises
    ------
    InputError
        If a muscle has no cubic or that of another, or a displacement is negative or not finite.
    """
    check_cubics(cubics, names)
    moves = check_array("displacements", displacements)
    if moves.ndim == 0 or moves.shape[-1] != len(names):
        raise InputError(f"displacements has shape {moves.shape}: it must be (..., {len(names)})")
    pressures = np.empty(moves.shape)
    for index, name in enumerate(names):
        cubic = cubics[name]
        most = np.minimum(moves[..., index], cubic.lateral_range[1])
        pressures[..., index] = cubic.find_pressure(most)
    return pressures


def check_cubics(
    cubics: Mapping[str, CubicFit], names: Sequence[str], *, pressure_limit: float = math.inf
) -> None:
    """Raise `InputError` unless each muscle has its own cubic, up to a legal pressure."""
    if not isinstance(cubics, Mapping):
        raise InputError(f"cubics is {cubics!r:.60}: it must be a mapping from names to CubicFit")
    for name in names:
        cubic = cubics.get(name)
        if cubic is None:
            known = ", ".join(map(str, cubics)) or "none"
            raise InputError(f"muscle {name} has no cubic: there are some for {known}")
        if not isinstance(cubic, CubicFit):
            raise InputError(f"cubic of muscle {name} is {cubic!r:.60}: it must be a CubicFit")
        if cubic.name != name:
            raise InputError(f"cubic of muscle {name} is that of {cubic.name}: fit one to each")
        if cubic.limit > pressure_limit * (1.0 + 1e-12):
            raise InputError(
                f"cubic of muscle {name} goes up to {cubic.limit:g} MPa: this design's limit is "
                f"{pressure_limit:g} MPa, so it was fitted to another"
            )


def check_fit(cubics: Mapping[str, CubicFit], effector: EffectorModel) -> None:
    """Raise `InputError` unless the cubics were fitted to this effector's muscles.

    Looked at is the deflection at the last pressure of each fit.
    """
    limit = effector.design.pressure_limit
    check_cubics(cubics, effector.design.names, pressure_limit=limit)
    for name in effector.design.names:
        cubic = cubics[name]
        here = float(balance(effector, name, pressure=min(cubic.limit, limit)).lateral)
        there = float(cubic.lateral[-1])
        if abs(here - there) > 1e-6 * max(here, there):
            raise InputError(
                f"cubic of muscle {name} was fitted to {there:.6g} mm at {cubic.limit:g} MPa: here "
                f"it is {here:.6g} mm, so it is that of another design"
            )


def _find_limit(effector: EffectorModel, name: str) -> tuple[float, bool]:
    """Return the pressure up to which the deflection grows, and whether the backbone ends it."""
    place = effector.design.index(name)
    known = find_reach(effector)
    if not known.saturated[place]:
        return known.pressure_limit, False
    move = np.zeros((1, len(known.names)))
    move[0, place] = known.peak
    _, pressures, _, _ = solve_displacements(effector, move, limit=known.pressure_limit)
    return float(pressures[0, place]), True


def find_rise(coefficients: NDArray[np.float64], start: float, limit: float, name: str) -> float:
    """Return the pressure from which on the slope is positive up to `limit`."""
    _, first, second, third = (float(value) for value in coefficients)
    if not first + limit * (2.0 * second + limit * 3.0 * third) > 0.0:
        raise InputError(
            f"the cubic of muscle {name} from {start:g} to {limit:g} MPa falls at its end, so it "
            "cannot be inverted: fit from another pressure, or use the exact inverse"
        )
    roots = np.roots([3.0 * third, 2.0 * second, first])
    turns = [
        float(root.real)
        for root in roots
        if abs(root.imag) <= 1e-12 * max(1.0, abs(root)) and start < root.real < limit
    ]
    turning = max(turns, default=start)
    return turning if math.isfinite(turning) else start


MOST_STEPS = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace(Result):
    """A path of the tip: what was wanted, the pressures, and where they lead.

    Attributes
    ----------
    kind : str
        ``"line"``, ``"circle"`` or ``"path"``.
    names : tuple of str
        The muscles, in the order of the design.
    targets : (n, 2) float
        Lateral positions wanted [mm].
    pressures : (n, m) float
        Pressures in the order of the design [MPa].
    displacements : (n, m) float
        Displacement wanted of each muscle [mm].
    achieved : (n, 2) float
        Lateral positions of the model at these pressures, by `pose` [mm].
    tip, holder_tip : (n, 3) float
        End of the backbone and of the holder at these pressures [mm].
    error : (n,) float
        Distance of `achieved` from `targets` [mm], whether these are in reach or not.
    reachable : (n,) bool
        Whether the target lies in the workspace.
    settled : (n,) bool
        Whether inverse and pose were solved, for the target or for what is given in its place.
    pressure_map : {"exact", "cubic"}
        Where the pressures come from.
    """

    kind: Literal["line", "circle", "path"]
    names: tuple[str, ...]
    targets: NDArray[np.float64] = tabulated("mm", "target_{}")
    pressures: NDArray[np.float64] = tabulated("MPa", "pressure_{}", over="names")
    displacements: NDArray[np.float64]
    achieved: NDArray[np.float64] = tabulated("mm", "achieved_{}")
    tip: NDArray[np.float64]
    holder_tip: NDArray[np.float64]
    error: NDArray[np.float64] = tabulated("mm")
    reachable: NDArray[np.bool_] = tabulated()
    settled: NDArray[np.bool_]
    pressure_map: Literal["exact", "cubic"]

    @property
    def largest_error(self) -> float:
        """Largest distance from a target [mm], those out of reach included."""
        return float(self.error.max())

    @property
    def reachable_error(self) -> float:
        """Largest distance from a target that is in reach [mm]; 0 if none is."""
        return float(self.error[self.reachable].max(initial=0.0))

    @property
    def complete(self) -> bool:
        """Whether every target lies in the workspace."""
        return bool(self.reachable.all())

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether the target is met, to 2e-6 mm: each of two muscles may miss its part by half."""
        return self.reachable & self.settled & (self.error <= 2.0 * MISS_TOLERANCE_MM)

    @property
    def reason(self) -> str:
        """How many targets are not met, why, and by how much; empty if all are."""
        kinds = {
            "out of reach": ~self.reachable,
            "not solved": self.reachable & ~self.settled,
            "missed by the cubics": self.reachable & self.settled & ~self.converged,
        }
        return "; ".join(
            f"{int(which.sum())} target(s) {kind}, by up to {self.error[which].max():.3g} mm"
            for kind, which in kinds.items()
            if which.any()
        )

    @property
    def residual(self) -> NDArray[np.float64]:
        """Distance from the targets [mm], `error`."""
        return self.error

    def to_dict(self) -> Json:
        """Return the path as plain values, `list_columns` among them; units in the names."""
        return {
            "kind": self.kind,
            "pressure_map": self.pressure_map,
            "targets": len(self.targets),
            "reachable": int(self.reachable.sum()),
            "complete": self.complete,
            "converged": self.converged.tolist(),
            "settled": self.settled.tolist(),
            "reason": self.reason,
            "residual": self.residual.tolist(),
            "largest_error_mm": self.reachable_error,
            "largest_distance_mm": self.largest_error,
            "columns": to_plain(self.list_columns()),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw targets and achieved places, seen along the axis, and return the axes."""
        axes = take_axes(ax, x="x [mm]", y="y [mm]", equal=True)
        axes.plot(*self.targets.T, "--", label="target")
        axes.plot(*self.achieved.T, ".-", label="achieved")
        axes.legend()
        return axes


def trace_path(
    effector: EffectorModel,
    targets: ArrayLike,
    *,
    cubics: Mapping[str, CubicFit] | None = None,
    kind: Literal["line", "circle", "path"] = "path",
) -> Trace:
    """Follow lateral targets one after the other.

    Parameters
    ----------
    effector : Effector
    targets : (n, 2) array_like
        Lateral positions [mm].
    cubics : mapping of str to CubicFit, optional
        A cubic for each muscle, by name: pressures come from these, as in the thesis's controller,
        and not from the exact inverse. Displacements above a cubic's range get its limit.
    kind : str
        What the path is called.

    Raises
    ------
    InputError
        If the targets are not (n, 2) and finite, or a muscle has no cubic of its own.
    """
    wanted = take_targets(targets)
    if wanted.ndim != 2 or not len(wanted):
        raise InputError(f"targets has shape {wanted.shape}: it must be (n, 2) with n of 1 or more")
    inverse = solve_inverse(effector, wanted)
    pressures = inverse.pressures
    if cubics is not None:
        check_fit(cubics, effector)
        pressures = look_up_pressures(
            cubics, effector.design.names, displacements=inverse.displacements
        )
    posed = pose(effector, pressures)
    achieved = np.asarray(posed.lateral_vector)
    return Trace(
        names=effector.design.names,
        kind=kind,
        targets=wanted,
        pressures=pressures,
        displacements=inverse.displacements,
        achieved=achieved,
        tip=np.asarray(posed.tip),
        holder_tip=np.asarray(posed.holder_tip),
        reachable=inverse.reachable,
        error=np.hypot(*(achieved - wanted).T),
        settled=np.asarray(inverse.settled & (posed.settled | posed.saturated)),
        pressure_map="exact" if cubics is None else "cubic",
    )


def trace_line(
    effector: EffectorModel,
    start: ArrayLike,
    *,
    end: ArrayLike,
    steps: int = 50,
    cubics: Mapping[str, CubicFit] | None = None,
) -> Trace:
    """Follow a straight line of lateral targets, both ends included.

    Parameters
    ----------
    effector : Effector
    start, end : (2,) array_like
        Lateral positions [mm].
    steps : int
        Targets, 2 or more, equally spaced.
    cubics : mapping of str to CubicFit, optional
        See `trace_path`.

    Raises
    ------
    InputError
        If an argument is outside its legal range.
    """
    steps = check_integer("steps", steps, low=2, high=MOST_STEPS)
    ends = [take_place("start", start), take_place("end", end)]
    return trace_path(effector, np.linspace(ends[0], ends[1], steps), cubics=cubics, kind="line")


def trace_circle(
    effector: EffectorModel,
    radius: float,
    *,
    centre: ArrayLike = (0.0, 0.0),
    steps: int = 72,
    cubics: Mapping[str, CubicFit] | None = None,
) -> Trace:
    """Follow a circle of lateral targets, from +x counter-clockwise, closed.

    Parameters
    ----------
    effector : Effector
    radius : float
        Radius [mm].
    centre : (2,) array_like
        Lateral position of the centre [mm].
    steps : int
        Targets, 3 or more, equally spaced; one more closes the circle.
    cubics : mapping of str to CubicFit, optional
        See `trace_path`.

    Raises
    ------
    InputError
        If an argument is outside its legal range.
    """
    radius = check_number("radius", radius, low=0.0, low_open=True, high=1e6, unit="mm")
    steps = check_integer("steps", steps, low=3, high=MOST_STEPS)
    middle = take_place("centre", centre)
    angle = np.linspace(0.0, 2.0 * math.pi, steps + 1)
    ring = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    return trace_path(effector, ring, cubics=cubics, kind="circle")


@dataclass(frozen=True, kw_only=True)
class Stick:
    """A stick of two axes as an analogue-digital converter reads it, in units of the converter.

    Axis x reads from left to right, axis y from top to bottom; the target has y up, so y changes
    its sign. The range is the thesis's, 0 to 1024; a converter of 10 bits ends at 1023.

    Parameters
    ----------
    centre : float
        Reading of both axes at rest.
    span : float
        Travel from the centre that counts as full, one axis alone.
    highest : float
        Largest reading; the smallest is 0.
    dead_zone : float
        Distance from the centre, in any direction, within which the stick is at rest. Beyond it
        the travel is stretched so that it begins at 0 and is full at `span`: no jump.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    highest: float = quantity(default=1024.0, low=0.0, high=1e9, low_open=True)
    centre: float = quantity(default=512.0, low=0.0, high=lambda stick: stick.highest)
    span: float = quantity(default=512.0, low=0.0, high=1e9, low_open=True)
    dead_zone: float = quantity(default=0.0, low=0.0, high=lambda stick: 0.9 * stick.span)

    def __post_init__(self) -> None:
        check_fields(self, "stick ")

    def find_travel(self, raw: ArrayLike) -> NDArray[np.float64]:
        """Return the travel from the centre, right and up, as a share of the span.

        Parameters
        ----------
        raw : (..., 2) array_like
            Readings of x and y.

        Returns
        -------
        (..., 2) ndarray
            Up to about 1 along an axis; corners of the stick go up to about sqrt(2).

        Raises
        ------
        InputError
            If a reading is outside ``[0, highest]``.
        """
        readings = check_points("stick reading", check_array("stick reading", raw), dim=2)
        check_axes("stick reading", readings, 0.0, self.highest)
        travel = (readings - self.centre) * np.array([1.0, -1.0])
        if self.dead_zone == 0.0:
            return np.asarray(travel / self.span + 0.0)  # no -0
        size = np.hypot(travel[..., :1], travel[..., 1:])
        beyond = np.maximum(size - self.dead_zone, 0.0) / (self.span - self.dead_zone)
        return np.asarray(travel / np.where(size > 0.0, size, 1.0) * beyond + 0.0)


def find_stick_scale(effector: EffectorModel, *, amplitudes: ArrayLike | None = None) -> float:
    """Return the deflection of a full stick [mm]: the largest one of the projected workspace.

    ``max(A_i, |A_i e_i + A_j e_j|)`` over the muscles and the sectors (thesis 4.6), at most the
    largest deflection of the backbone: the workspace lies inside the circle of full travel.

    Parameters
    ----------
    effector : Effector
    amplitudes : (m,) array_like, optional
        Largest displacements [mm]; by default those of `find_reach`.

    Raises
    ------
    InputError
        If the amplitudes are not numbers of 0 or more, one for each muscle.
    """
    extent = find_reach(effector)
    values = extent.amplitudes if amplitudes is None else amplitudes
    sectors = find_sectors(effector.design)
    first = take_amplitudes(effector.design, values)[sectors.order]
    second = np.roll(first, -1)
    corner = np.sqrt(first**2 + second**2 + 2.0 * first * second * np.cos(sectors.gaps))
    largest = max(float(first.max()), float(corner[sectors.covered].max(initial=0.0)))
    return min(largest, extent.peak)


def steer(
    effector: EffectorModel,
    raw: ArrayLike,
    *,
    stick: Stick | None = None,
    scale: float | None = None,
    cubics: Mapping[str, CubicFit] | None = None,
) -> EffectorInverse:
    """Turn readings of a stick into pressures: the travel times the scale is the target.

    Targets outside the workspace, which the stick has, are answered in their direction: see
    `solve_inverse`.

    Parameters
    ----------
    effector : Effector
    raw : (..., 2) array_like
        Readings of x and y.
    stick : Stick, optional
        By default one of 10 bits without dead zone.
    scale : float, optional
        Deflection of a full stick [mm]; by default `find_stick_scale`.
    cubics : mapping of str to CubicFit, optional
        A cubic for each muscle, by name, as in the thesis's controller: the pressures come from
        these. `delivered`, `contraction` and `force` are then what these pressures do, by `pose`,
        and `displacement_error` is how far that is from what was asked of the muscles.

    Raises
    ------
    InputError
        If a reading or the scale is outside its legal range, or a cubic is missing or that of
        another muscle or design.
    """
    if stick is not None and not isinstance(stick, Stick):
        raise InputError(f"stick is {stick!r:.60}: it must be a Stick")
    travel = (stick or Stick()).find_travel(raw)
    if scale is None:
        scale = find_stick_scale(effector)
    scale = check_number("stick scale", scale, low=0.0, high=1e6, low_open=True, unit="mm")
    exact = solve_inverse(effector, scale * travel)
    return exact if cubics is None else _use_cubics(effector, exact, cubics)


def _use_cubics(
    effector: EffectorModel, exact: EffectorInverse, cubics: Mapping[str, CubicFit]
) -> EffectorInverse:
    check_fit(cubics, effector)
    pressures = look_up_pressures(cubics, effector.design.names, displacements=exact.displacements)
    posed = pose(effector, pressures)
    away = posed.lateral_vector - exact.delivered
    return replace(
        exact,
        pressures=pressures,
        contraction=posed.contraction,
        force=posed.force,
        delivered=posed.lateral_vector,
        displacement_error=np.hypot(away[..., 0], away[..., 1]),
        settled=np.asarray(exact.settled & (posed.settled | posed.saturated)),
        pressure_map="cubic",
    )
