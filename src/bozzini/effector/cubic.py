"""A cubic from pressure to deflection, as the thesis uses in its controller (Fig. 4.16)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from .effector import Effector
from .equilibrium import balance

__all__ = ["CubicFit", "fit_cubic", "look_up_pressures"]


@dataclass(frozen=True, kw_only=True, eq=False)
class CubicFit:
    """A cubic of pressure for the deflection by one muscle, and how far it is off.

    The thesis does not print its cubic, nor say from where it was fitted. The model's curve is flat
    up to the pressure at which the braid takes hold, has a kink there, and gets flat again where
    the braid locks: no cubic does all that, which is what `rms_error` and `largest_error` show.

    Parameters
    ----------
    name : str
        The muscle.
    coefficients : (4,) float
        ``c_0 + c_1 p + c_2 p^2 + c_3 p^3`` in mm and MPa.
    start, limit : float
        Pressures between which it was fitted [MPa].
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
        values = np.asarray(pressure, dtype=np.float64)
        for value in values.ravel():
            check_number("pressure", value, low=self.start, high=self.limit, unit="MPa")
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
        values = np.asarray(lateral, dtype=np.float64)
        low, high = self.lateral_range
        for value in values.ravel():
            check_number(
                f"deflection by muscle {self.name}",
                value,
                low=0.0,
                high=high * (1.0 + 1e-12),
                unit="mm",
            )
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
        If an argument is outside its legal range, or the cubic falls at the pressure limit, so
        that it cannot be inverted there.
    """
    limit = effector.design.pressure_limit
    check_number("start", start, low=0.0, high=0.95 * limit, unit="MPa")
    check_integer("samples", samples, low=4)
    pressure = np.linspace(start, limit, samples)
    lateral = np.asarray(balance(effector, name, pressure).lateral)
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
        If a muscle has no cubic, or a displacement is negative or not finite.
    """
    moves = np.asarray(displacements, dtype=np.float64)
    if moves.ndim == 0 or moves.shape[-1] != len(names):
        raise InputError(f"displacements has shape {moves.shape}: it must be (..., {len(names)})")
    pressures = np.empty(moves.shape)
    for index, name in enumerate(names):
        if name not in cubics:
            raise InputError(f"muscle {name} has no cubic: there are some for {sorted(cubics)}")
        cubic = cubics[name]
        most = np.minimum(moves[..., index], cubic.lateral_range[1])
        pressures[..., index] = cubic.find_pressure(most)
    return pressures


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
