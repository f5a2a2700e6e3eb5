"""Traces: the tip along a line or round a circle (as in thesis Figs 4.23-4.24)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number
from ..errors import InputError
from .cubic import CubicFit, check_fit, look_up_pressures
from .effector import Effector
from .inverse import solve_inverse
from .pose import pose
from .projected import take_place, take_targets

__all__ = ["Trace", "trace_circle", "trace_line", "trace_path"]

MOST_STEPS = 1_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A path of the tip: what was wanted, the pressures, and where they lead.

    Attributes
    ----------
    kind : str
        ``"line"``, ``"circle"`` or ``"path"``.
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
    reachable : (n,) bool
        Whether the target lies in the workspace.
    error : (n,) float
        Distance of `achieved` from `targets` [mm], whether these are in reach or not.
    converged : (n,) bool
        Whether inverse and pose were found, in reach or not.
    pressure_map : {"exact", "cubic"}
        Where the pressures come from.
    """

    kind: str
    targets: NDArray[np.float64]
    pressures: NDArray[np.float64]
    displacements: NDArray[np.float64]
    achieved: NDArray[np.float64]
    tip: NDArray[np.float64]
    holder_tip: NDArray[np.float64]
    reachable: NDArray[np.bool_]
    error: NDArray[np.float64]
    converged: NDArray[np.bool_]
    pressure_map: str

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


def trace_path(
    effector: Effector,
    targets: ArrayLike,
    *,
    cubics: Mapping[str, CubicFit] | None = None,
    kind: str = "path",
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
        pressures = look_up_pressures(cubics, effector.design.names, inverse.displacements)
    posed = pose(effector, pressures)
    achieved = np.asarray(posed.lateral_vector)
    return Trace(
        kind=kind,
        targets=wanted,
        pressures=pressures,
        displacements=inverse.displacements,
        achieved=achieved,
        tip=np.asarray(posed.tip),
        holder_tip=np.asarray(posed.holder_tip),
        reachable=inverse.reachable,
        error=np.hypot(*(achieved - wanted).T),
        converged=np.asarray(inverse.converged & (posed.converged | posed.saturated)),
        pressure_map="exact" if cubics is None else "cubic",
    )


def trace_line(
    effector: Effector,
    start: ArrayLike,
    end: ArrayLike,
    *,
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
    effector: Effector,
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
