"""A cubic from pressure to deflection, as the thesis uses in its controller (Fig. 4.16)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_integer, check_number, check_range
from ..errors import InputError
from .amplitudes import find_reach
from .effector import Effector
from .equilibrium import balance
from .inverse import solve_displacements

__all__ = ["CubicFit", "fit_cubic", "look_up_pressures"]

MOST_SAMPLES = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class CubicFit:
    """A cubic of pressure for the deflection by one muscle, and how far it is off.

    The thesis does not print its cubic, nor say from where it was fitted. The model's curve is flat
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


def fit_cubic(effector: Effector, name: str, *, start: float = 0.0, samples: int = 200) -> CubicFit:
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
    found = balance(effector, name, pressure)
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
        rising_from=_find_rise(coefficients, start, limit, name),
        pressure=pressure,
        lateral=lateral,
        rms_error=float(np.sqrt(np.mean(error * error))),
        largest_error=float(np.abs(error).max()),
    )


def look_up_pressures(
    cubics: Mapping[str, CubicFit], names: Sequence[str], displacements: ArrayLike
) -> NDArray[np.float64]:
    """Return pressures (..., m) [MPa] from the cubics of muscles, for displacements (..., m) [mm].

    The thesis's controller: `InverseResult.displacements` in, pressures out. Displacements above a
    cubic's range get its limit.

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


def check_fit(cubics: Mapping[str, CubicFit], effector: Effector) -> None:
    """Raise `InputError` unless the cubics were fitted to this effector's muscles.

    Looked at is the deflection at the last pressure of each fit.
    """
    limit = effector.design.pressure_limit
    check_cubics(cubics, effector.design.names, pressure_limit=limit)
    for name in effector.design.names:
        cubic = cubics[name]
        here = float(balance(effector, name, min(cubic.limit, limit)).lateral)
        there = float(cubic.lateral[-1])
        if abs(here - there) > 1e-6 * max(here, there):
            raise InputError(
                f"cubic of muscle {name} was fitted to {there:.6g} mm at {cubic.limit:g} MPa: here "
                f"it is {here:.6g} mm, so it is that of another design"
            )


def _find_limit(effector: Effector, name: str) -> tuple[float, bool]:
    """Return the pressure up to which the deflection grows, and whether the backbone ends it."""
    place = effector.design.index(name)
    known = find_reach(effector)
    if not known.saturated[place]:
        return known.pressure_limit, False
    move = np.zeros((1, len(known.names)))
    move[0, place] = known.peak
    _, pressures, _, _ = solve_displacements(effector, move, limit=known.pressure_limit)
    return float(pressures[0, place]), True


def _find_rise(coefficients: NDArray[np.float64], start: float, limit: float, name: str) -> float:
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
