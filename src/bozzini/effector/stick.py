"""Thumb-stick: two raw axes to a lateral target of the tip (thesis 4.6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_points
from ..errors import InputError
from .amplitudes import find_reach
from .cubic import CubicFit, check_fit, look_up_pressures
from .effector import Effector
from .inverse import InverseResult, solve_inverse
from .pose import pose
from .projected import take_amplitudes
from .sectors import find_sectors

__all__ = ["Stick", "find_stick_scale", "steer"]


@dataclass(frozen=True, kw_only=True)
class Stick:
    """A stick of two axes as an analogue-digital converter reads it, in units of the converter.

    Axis x reads from left to right, axis y from top to bottom; the target has y up, so y changes
    its sign. The thesis gives a range of 0 to 1024; a converter of 10 bits reads 0 to 1023.

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

    centre: float = 512.0
    span: float = 512.0
    highest: float = 1023.0
    dead_zone: float = 0.0

    def __post_init__(self) -> None:
        highest = check_number("stick highest", self.highest, low=0.0, high=1e9, low_open=True)
        centre = check_number("stick centre", self.centre, low=0.0, high=highest)
        span = check_number("stick span", self.span, low=0.0, high=1e9, low_open=True)
        dead = check_number("stick dead zone", self.dead_zone, low=0.0, high=0.9 * span)
        for name, value in (
            ("highest", highest), ("centre", centre), ("span", span), ("dead_zone", dead)
        ):  # fmt: skip
            object.__setattr__(self, name, value)

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
        if readings.size and not (readings.min() >= 0.0 and readings.max() <= self.highest):
            index = int(np.argmax((readings < 0.0) | (readings > self.highest)))
            raise InputError(
                f"stick reading {'xy'[index % 2]} is {readings.flat[index]:g}: it must lie in "
                f"[0, {self.highest:g}]"
            )
        travel = (readings - self.centre) * np.array([1.0, -1.0])
        if self.dead_zone == 0.0:
            return np.asarray(travel / self.span + 0.0)  # no -0
        size = np.hypot(travel[..., :1], travel[..., 1:])
        beyond = np.maximum(size - self.dead_zone, 0.0) / (self.span - self.dead_zone)
        return np.asarray(travel / np.where(size > 0.0, size, 1.0) * beyond + 0.0)


def find_stick_scale(effector: Effector, *, amplitudes: ArrayLike | None = None) -> float:
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
    effector: Effector,
    raw: ArrayLike,
    *,
    stick: Stick | None = None,
    scale: float | None = None,
    cubics: Mapping[str, CubicFit] | None = None,
) -> InverseResult:
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
        and `residual` is how far that is from what was asked of the muscles.

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
    effector: Effector, exact: InverseResult, cubics: Mapping[str, CubicFit]
) -> InverseResult:
    check_fit(cubics, effector)
    pressures = look_up_pressures(cubics, effector.design.names, exact.displacements)
    posed = pose(effector, pressures)
    away = posed.lateral_vector - exact.delivered
    return replace(
        exact,
        pressures=pressures,
        contraction=posed.contraction,
        force=posed.force,
        delivered=posed.lateral_vector,
        residual=np.hypot(away[..., 0], away[..., 1]),
        converged=np.asarray(exact.converged & (posed.converged | posed.saturated)),
        pressure_map="cubic",
    )
