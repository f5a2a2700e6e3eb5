"""Traces: the tip along a line or round a circle (as in thesis Figs 4.23-4.24)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, check_number, check_points
from ..errors import InputError
from .cubic import CubicFit, look_up_pressures
from .effector import Effector
from .inverse import solve_inverse
from .pose import pose

__all__ = ["Trace", "trace_circle", "trace_line", "trace_path"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """A path of the tip: what was wanted, the pressures, and where they lead.

    Parameters
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
        Distance of `achieved` from `targets` [mm].
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
    pressure_map: str

    @property
    def largest_error(self) -> float:
        """Largest distance from a target [mm], those out of reach included."""
        return float(self.error.max())

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
        If the targets are not (n, 2) and finite, or a muscle has no cubic.
    """
    wanted = check_points("targets", targets, dim=2)
    if wanted.ndim != 2 or not len(wanted):
        raise InputError(f"targets has shape {wanted.shape}: it must be (n, 2) with n of 1 or more")
    inverse = solve_inverse(effector, wanted)
    pressures = inverse.pressures
    if cubics is not None:
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
    check_integer("steps", steps, low=2)
    ends = [check_points(name, value, dim=2) for name, value in (("start", start), ("end", end))]
    for name, point in zip(("start", "end"), ends, strict=True):
        if point.shape != (2,):
            raise InputError(f"{name} has shape {point.shape}: it must be (2,)")
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
    check_number("radius", radius, low=0.0, low_open=True, high=1e6, unit="mm")
    check_integer("steps", steps, low=3)
    middle = check_points("centre", centre, dim=2)
    if middle.shape != (2,):
        raise InputError(f"centre has shape {middle.shape}: it must be (2,)")
    angle = np.linspace(0.0, 2.0 * math.pi, steps + 1)
    ring = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring[-1] = ring[0]
    return trace_path(effector, ring, cubics=cubics, kind="circle")
