"""The inverse in the projected workspace: a lateral target to displacements of two muscles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_points, check_range
from ..errors import InputError
from . import _inverse_kernels
from .design import EffectorDesign
from .sectors import Sectors, find_sectors

__all__ = ["INVERSE_OUTCOMES", "ProjectedInverse", "project_inverse"]

INVERSE_OUTCOMES = ("reached", "muscle limit", "largest deflection", "gap")
"""What the codes 0 to 3 of an inverse mean."""

FURTHEST = 1e9
"""Largest legal coordinate of a target [mm]: a limit of the arithmetic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ProjectedInverse:
    """Displacements of the two muscles on either side of a target (thesis 4.10-4.16).

    Attributes
    ----------
    target : (..., 2) float
        Lateral position wanted [mm].
    displacements : (..., m) float
        Displacement by each muscle in its own direction, in the order of the design [mm]; at most
        two are not zero.
    pair : (..., 2) int
        The two muscles as indices in the design; -1 where there is none. The second is the next
        one by angle. A target along a muscle has that muscle and a neighbour, with 0 mm.
    share : (...) float
        Share of the target that is delivered, ``R / |v|``.
    delivered : (..., 2) float
        ``share * target``: where the displacements lead [mm].
    code : (...) int
        Index into `INVERSE_OUTCOMES`. 0: reached; 1: a muscle at its amplitude; 2: the largest
        deflection of the backbone; 3: a direction in a gap between muscles of half a turn or more.
    """

    target: NDArray[np.float64]
    displacements: NDArray[np.float64]
    pair: NDArray[np.int64]
    share: NDArray[np.float64]
    delivered: NDArray[np.float64]
    code: NDArray[np.int64]

    @property
    def reachable(self) -> NDArray[np.bool_]:
        """Whether the whole target is delivered."""
        return np.asarray(self.code == _inverse_kernels.REACHED)


def project_inverse(
    design: EffectorDesign,
    target: ArrayLike,
    *,
    amplitudes: ArrayLike,
    peak: float = math.inf,
) -> ProjectedInverse:
    """Split lateral targets between the two muscles of the sector they lie in.

    The sector is the one where neither displacement is negative, which is the thesis's angle test
    with the gap taken modulo 2 pi and without its exact equality. Beyond the amplitudes the
    direction is kept: ``t = min(1, A_i / a_i, A_j / a_j)`` is (4.15) and (4.16) in one. Only the
    two neighbours are used, as in the thesis; with four muscles or more, three at once could reach
    further.

    Parameters
    ----------
    design : EffectorDesign
    target : (..., 2) array_like
        Lateral positions [mm].
    amplitudes : () or (m,) array_like
        Largest displacement by each muscle, in the order of the design [mm].
    peak : float
        Largest deflection of the backbone, whatever the muscles [mm].

    Raises
    ------
    InputError
        If an argument has a wrong shape, or a value is not finite or negative.
    """
    targets = take_targets(target)
    sectors = find_sectors(design)
    limit = check_number("peak", 1e12 if peak == math.inf else peak, low=0.0, high=1e12, unit="mm")
    return split(sectors, targets, take_amplitudes(design, amplitudes)[sectors.order], limit)


def take_targets(target: ArrayLike) -> NDArray[np.float64]:
    """Return lateral targets as (..., 2) floats, or raise `InputError`."""
    return _take_places("target", target)


def take_place(name: str, place: ArrayLike) -> NDArray[np.float64]:
    """Return one lateral place as (2,) floats, or raise `InputError`."""
    point = _take_places(name, place)
    if point.shape != (2,):
        raise InputError(f"{name} has shape {point.shape}: it must be (2,)")
    return point


def _take_places(name: str, places: ArrayLike) -> NDArray[np.float64]:
    targets = check_points(name, check_array(name, places), dim=2)
    if targets.size and not np.abs(targets).max() <= FURTHEST:
        index = int(np.argmax(np.abs(targets)))
        raise InputError(
            f"{name} {'xy'[index % 2]} is {targets.flat[index]:g} mm: it must lie in "
            f"[{-FURTHEST:g}, {FURTHEST:g}] mm"
        )
    return targets


def take_amplitudes(design: EffectorDesign, amplitudes: ArrayLike) -> NDArray[np.float64]:
    """Return amplitudes as (m,) floats, or raise `InputError`."""
    count = len(design.muscles)
    values = check_array("amplitudes", amplitudes)
    if values.shape not in ((), (count,)):
        raise InputError(f"amplitudes has shape {values.shape}: it must be () or ({count},)")
    check_range("amplitude", values, 0.0, 1e12, "mm")
    return np.array(np.broadcast_to(values, (count,)))


def split(
    sectors: Sectors,
    targets: NDArray[np.float64],
    amplitudes: NDArray[np.float64],
    peak: float,
) -> ProjectedInverse:
    """Return the inverse of checked targets; `amplitudes` in the order of the sectors."""
    shape, count = targets.shape[:-1], sectors.order.size
    flat = np.ascontiguousarray(targets).reshape(-1, 2)
    rows = len(flat)
    displacements = np.empty((rows, count))
    pair = np.empty((rows, 2), dtype=np.int64)
    share = np.empty(rows)
    code = np.empty(rows, dtype=np.int64)
    _inverse_kernels.split_targets(
        sectors.order,
        sectors.cosines,
        sectors.sines,
        sectors.covered,
        amplitudes,
        peak,
        flat,
        displacements,
        pair,
        share,
        code,
    )
    return ProjectedInverse(
        target=targets,
        displacements=displacements.reshape(*shape, count),
        pair=pair.reshape(*shape, 2),
        share=share.reshape(shape),
        delivered=share.reshape(*shape, 1) * targets,
        code=code.reshape(shape),
    )
