"""Air through an orifice (ISO 6358), and how long it takes to fill and to vent a volume."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_fields, check_number, check_range, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from .kernels.orifice import LINEAR_RATIO

ATMOSPHERE = 0.101325
"""Pressure of the surroundings [MPa absolute]; pressures are otherwise gauge."""
GAS_CONSTANT = 287.05
"""Of dry air [J/(kg K)]."""
TEMPERATURE = 293.15
"""Of the air everywhere [K]."""
HEAT_RATIO = 1.4
"""Ratio of the specific heats of air: the exponent of an adiabatic change of state."""
REFERENCE_DENSITY = 1.185
"""Of air at 100 kPa, 20 °C and 65 % humidity, to which ISO 6358 refers [kg/m^3]."""
NOZZLE_RATIO = 0.528
"""Critical pressure ratio of an ideal nozzle; valves have 0.2 to 0.5."""
PRESSURE_LIMIT = 100.0
"""Largest legal gauge pressure [MPa]."""


def _find_nozzle_speed() -> float:
    g = HEAT_RATIO
    share = math.sqrt(g) * (2.0 / (g + 1.0)) ** ((g + 1.0) / (2.0 * (g - 1.0)))
    return float(1e3 * math.sqrt(GAS_CONSTANT * TEMPERATURE) * share)


NOZZLE_SPEED = _find_nozzle_speed()
"""Choked pV flow per effective area and absolute upstream pressure [mm/s]: 198 630."""

AREA_PER_CONDUCTANCE = 1e7 * REFERENCE_DENSITY * GAS_CONSTANT * TEMPERATURE * 1e-6 / NOZZLE_SPEED
"""Effective area [mm^2] of a sonic conductance of 1 dm^3/(s bar): 5.020."""


@dataclass(frozen=True, kw_only=True)
class Orifice:
    """A restriction of the flow of air by ISO 6358: an effective area and a critical ratio.

    With ``p1`` upstream, ``p2`` downstream (absolute) and ``v`` = `NOZZLE_SPEED` the flow of
    pressure times volume at `TEMPERATURE`, ``q = (mass flow) R T`` [MPa mm^3/s = mW], is ::

        q = area v p1 phi(p2 / p1)
        phi(r) = 1                                   r <= b
                 sqrt(1 - ((r - b) / (1 - b))**2)    b < r < 0.99
                 linear to phi(1) = 0                above

    The linear end, in place of the ellipse's vertical one, is laminar flow at small differences.
    For ``b = 0.528`` the ellipse is that of an isentropic nozzle to 0.0017 of the choked flow.

    Parameters
    ----------
    area : float
        Effective area, discharge coefficient times area [mm^2].
    critical_ratio : float
        Ratio of the absolute pressures ``b`` below which the flow is choked, in [0.01, 0.95].

    Raises
    ------
    InputError
        If a value is outside its legal range; in methods, if a pressure is.
    """

    area: float = quantity("area", "Effective area.", low=0.0, low_open=True, high=1e4)
    critical_ratio: float = quantity(
        help="Critical pressure ratio.", default=NOZZLE_RATIO, low=0.01, high=0.95
    )

    def __post_init__(self) -> None:
        check_fields(self, "orifice ")

    @classmethod
    def from_conductance(cls, conductance: float, critical_ratio: float = NOZZLE_RATIO) -> Orifice:
        """Return the orifice of a sonic conductance C [dm^3/(s bar)], as data sheets give it.

        Raises
        ------
        InputError
            If a value is outside its legal range.
        """
        given = check_number(
            "conductance", conductance, low=0.0, low_open=True, high=1e3, unit="dm^3/(s bar)"
        )
        return cls(area=given * AREA_PER_CONDUCTANCE, critical_ratio=critical_ratio)

    @property
    def conductance(self) -> float:
        """Sonic conductance C [dm^3/(s bar)]."""
        return self.area / AREA_PER_CONDUCTANCE

    def flow(self, upstream: ArrayLike, downstream: ArrayLike) -> Floats:
        """Return the pV flow [mW] between gauge pressures [MPa]; negative when it runs back.

        Raises
        ------
        InputError
            If a pressure is not in (-0.101325, 100] MPa.
        """
        first, second = _take("upstream", upstream), _take("downstream", downstream)
        high, low = np.maximum(first, second), np.minimum(first, second)
        size = self.area * NOZZLE_SPEED * high * self.find_share(low / high)
        return np.asarray(np.where(first >= second, size, -size))

    def find_share(self, ratio: ArrayLike) -> Floats:
        """Return the flow over the choked flow at ratios of absolute pressures in [0, 1]."""
        ratios = check_array("ratio", ratio)
        check_range("ratio", ratios, 0.0, 1.0)
        b = self.critical_ratio
        along = np.clip((ratios - b) / (1.0 - b), 0.0, 1.0)
        curve = np.sqrt(1.0 - along**2)
        line = self._edge * (1.0 - ratios) / (1.0 - LINEAR_RATIO)
        return np.asarray(np.where(ratios < LINEAR_RATIO, curve, line))

    @property
    def _edge(self) -> float:
        """Share of the choked flow where the linear end begins."""
        b = self.critical_ratio
        return math.sqrt(1.0 - ((LINEAR_RATIO - b) / (1.0 - b)) ** 2)

    @property
    def _slope(self) -> float:
        return self._edge / (1.0 - LINEAR_RATIO)

    def time_constant(self, volume: float, *, exponent: float = 1.0) -> float:
        """Return ``volume / (exponent area v)`` [s]: the time scale of a fixed volume [mm^3].

        ``exponent`` is that of the change of state: 1 isothermal, `HEAT_RATIO` adiabatic.

        Raises
        ------
        InputError
            If a value is not positive.
        """
        size = check_number("volume", volume, low=0.0, low_open=True, high=1e12, unit="mm^3")
        power = check_number("exponent", exponent, low=1.0, high=HEAT_RATIO)
        return size / (power * self.area * NOZZLE_SPEED)

    def fill_time(
        self,
        volume: float,
        supply: float,
        *,
        end: ArrayLike,
        start: float = 0.0,
        exponent: float = 1.0,
    ) -> Floats:
        """Return the time to fill a fixed volume from a constant supply, in closed form [s].

        With ``r = p / supply`` (absolute): ``tau r`` while choked, then
        ``tau (1 - b) asin((r - b)/(1 - b))``, and an exponential at the linear end. The ellipse
        alone would reach the supply in a finite time, 1.16 tau from vacuum at b = 0.528.

        Parameters
        ----------
        volume : float
            Volume [mm^3].
        supply : float
            Gauge pressure of the supply [MPa].
        end : array_like
            Gauge pressure reached, in [start, supply) [MPa].
        start : float
            Gauge pressure at the beginning [MPa].
        exponent : float
            As in `time_constant`.

        Raises
        ------
        InputError
            If a value is outside its legal range.
        """
        highest = float(_take("supply", supply))
        first, last = _take("start", start), _take("end", end)
        check_range("start", first, 0.0, highest, "MPa absolute")
        check_range("end", last, float(first), highest, "MPa absolute")
        if np.any(last == highest):
            raise InputError(
                f"end is {supply:g} MPa: it must be below the supply of {supply:g} MPa"
            )
        tau = self.time_constant(volume, exponent=exponent)
        return np.asarray(
            tau * (self._fill_clock(last / highest) - self._fill_clock(first / highest))
        )

    def _fill_clock(self, ratio: Floats) -> Floats:
        """Time from vacuum over the time constant."""
        b = self.critical_ratio
        along = np.clip((np.minimum(ratio, LINEAR_RATIO) - b) / (1.0 - b), 0.0, 1.0)
        tail = np.log((1.0 - LINEAR_RATIO) / (1.0 - np.maximum(ratio, LINEAR_RATIO))) / self._slope
        return np.asarray(np.minimum(ratio, b) + (1.0 - b) * np.arcsin(along) + tail)

    def vent_time(
        self, volume: float, start: float, *, end: ArrayLike, exponent: float = 1.0
    ) -> Floats:
        """Return the time to vent a fixed volume into the surroundings, in closed form [s].

        ``tau log(p0 / p)`` while choked; then, with ``sin(th) = (pa/p - b) / (1 - b)``, the
        integral of ``tau (1 - b) / (b + (1 - b) sin(th))``; an exponential at the linear end.

        Parameters
        ----------
        volume : float
            Volume [mm^3].
        start : float
            Gauge pressure at the beginning [MPa].
        end : array_like
            Gauge pressure reached, in (0, start] [MPa].
        exponent : float
            As in `time_constant`.

        Raises
        ------
        InputError
            If a value is outside its legal range.
        """
        first, last = _take("start", start), _take("end", end)
        check_range("end", last, ATMOSPHERE, float(first), "MPa absolute")
        if np.any(last == ATMOSPHERE):
            raise InputError("end is 0 MPa: it must be more, as the last of the air leaves slowly")
        tau = self.time_constant(volume, exponent=exponent)
        return np.asarray(tau * (self._vent_clock(last) - self._vent_clock(first)))

    def _vent_clock(self, pressure: Floats) -> Floats:
        """Time over the time constant, from the lowest choked pressure; negative above it."""
        b = self.critical_ratio
        ratio = ATMOSPHERE / pressure
        choked = np.log(np.minimum(ratio, b) / b)
        sine = np.clip((np.minimum(ratio, LINEAR_RATIO) - b) / (1.0 - b), 0.0, 1.0)
        # The tangent of half the angle; the difference of two arcus is taken as one.
        half = sine / (1.0 + np.sqrt(1.0 - sine**2))
        begin = 1.0 - b
        here = b * half + begin
        spread = 2.0 * b - 1.0
        span = (here - begin) / (here * begin + spread)
        width = math.sqrt(abs(spread))
        if width > 0.0:
            span = (np.arctan if spread > 0.0 else np.arctanh)(width * span) / width
        edge = ATMOSPHERE / LINEAR_RATIO - ATMOSPHERE
        tail = np.log(edge / np.minimum(pressure - ATMOSPHERE, edge)) / self._slope
        return np.asarray(choked + 2.0 * (1.0 - b) * span + tail)


def _take(name: str, pressure: ArrayLike) -> Floats:
    """Return gauge pressures as absolute ones."""
    pressures = check_array(name, pressure)
    check_range(name, pressures, -ATMOSPHERE, PRESSURE_LIMIT, "MPa")
    return np.asarray(pressures + ATMOSPHERE)
