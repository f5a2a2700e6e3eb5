"""The exact inverse: from a lateral target of the tip to the pressures of the muscles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _inverse_kernels
from ._equilibrium_kernels import OTHER
from ._pressure import find_model_pressures
from .amplitudes import Reach, find_reach
from .effector import Effector
from .forward import lateral_slope
from .projected import ProjectedInverse, project_inverse, split, take_targets

__all__ = ["InverseResult", "ProjectedInverse", "project_inverse", "solve_inverse"]

Floats = NDArray[np.float64]

TOLERANCE = 1e-6
"""Miss up to which a pressure counts as converged [mm]; a linkage that ends is that steep."""


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseResult:
    """Pressures for lateral targets, and what they deliver.

    Attributes
    ----------
    target : (..., 2) float
        Lateral position of the backbone's end that was wanted [mm].
    pressures : (..., m) float
        Pressures in the order of the design [MPa]; 0 for a muscle that is not needed.
    displacements, contraction, force : (..., m) float
        Lateral displacement by each muscle [mm], its contraction [mm] and pull [N].
    pair : (..., 2) int
        The muscles used, see `ProjectedInverse`.
    delivered : (..., 2) float
        Where the pressures lead [mm]: the target, or as far as can be in its direction.
    share : (...) float
        Length of `delivered` over that of the target; 1 for the target zero.
    reachable : (...) bool
        Whether the target can be had: `delivered` is the target, but for cubics.
    residual : (...) float
        By how much a muscle's equations miss its displacement, the largest, to first order [mm].
        Of cubics: how far `delivered` is from what was asked of the muscles.
    converged : (...) bool
        Whether `residual` is at most 1e-6 mm; of cubics, whether that of the exact inverse is.
    iterations : (...) int
        Steps of all solvers together.
    code : (...) int
        See `ProjectedInverse`.
    reach : Reach
        The amplitudes it was limited by.
    pressure_map : {"exact", "cubic"}
        Where the pressures come from; "cubic" by `steer` only.
    """

    target: Floats
    pressures: Floats
    displacements: Floats
    contraction: Floats
    force: Floats
    pair: NDArray[np.int64]
    delivered: Floats
    share: Floats
    reachable: NDArray[np.bool_]
    residual: Floats
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    code: NDArray[np.int64]
    reach: Reach
    pressure_map: str = "exact"

    @property
    def reason(self) -> NDArray[np.str_]:
        """Why a target is not reached, one sentence each; empty where it is reached."""
        lines = [self._explain(index) for index in range(self.code.size)]
        return np.array(lines, dtype=np.str_).reshape(self.code.shape)

    def _explain(self, index: int) -> str:
        code = int(self.code.flat[index])
        x, y = self.target.reshape(-1, 2)[index]
        residual = float(self.residual.flat[index])
        if not self.converged.flat[index]:
            return f"not converged: a displacement is missed by {residual:.3g} mm"
        if code == _inverse_kernels.REACHED:
            return ""
        known = self.reach
        size = math.hypot(x, y)
        goes = f"the target is {size:.4g} mm away, {self.share.flat[index] * size:.4g} mm are given"
        if code == _inverse_kernels.PEAK:
            return f"the backbone deflects by {known.peak:.4g} mm, {known.peak_reason}: {goes}"
        if code == _inverse_kernels.OUTSIDE:
            return (
                f"direction {math.degrees(math.atan2(y, x)):.4g} deg lies in a gap of half a turn "
                f"or more, {known.sectors.describe_gaps(known.names)}: {goes}"
            )
        row = self.displacements.reshape(-1, len(known.names))[index]
        full = [
            k
            for k in self.pair.reshape(-1, 2)[index]
            if k >= 0 and row[k] >= known.amplitudes[k] * (1.0 - 1e-12)
        ]
        who = " and ".join(f"{known.names[k]} ({known.amplitudes[k]:.4g} mm)" for k in full)
        most = f"its most for {known.pressure_limit:g} MPa"
        if all(known.saturated[k] for k in full):
            most = f"the backbone's largest deflection, {known.peak_reason}"
        return f"muscle {who} is at {most}: {goes}"


def solve_inverse(effector: Effector, target: ArrayLike) -> InverseResult:
    """Return the pressures that bring the backbone's end to lateral targets.

    The inverse of `pose` by superposition, exact and by roots in one unknown each: (4.13) gives the
    displacement of each of two muscles, the linkage its contraction, the beam its pull
    ``F = displacement / c``, and the muscle's model the pressure at which it pulls so there.

    A target outside the workspace is answered in its own direction, as far out as can be; a
    direction that no two muscles cover gets no pressure. A muscle that has nothing to do gets 0
    MPa. As its displacement goes to 0 its pressure goes to that at which it begins to pull, above
    the dead band: there the pressure jumps, the tip does not.

    Parameters
    ----------
    effector : Effector
        Section and muscles.
    target : (..., 2) array_like
        Lateral position of the backbone's end [mm].

    Raises
    ------
    InputError
        If the target has a wrong shape or is not finite, or a model has no answer.
    """
    targets = take_targets(target)
    known = find_reach(effector)
    found = split(known.sectors, targets, known.amplitudes, known.peak)
    shape, count = targets.shape[:-1], len(known.names)
    moves = found.displacements.reshape(-1, count)
    contractions, pressures, residual, iterations = solve_displacements(
        effector, moves, limit=known.pressure_limit
    )
    residual = residual.reshape(shape)
    return InverseResult(
        target=targets,
        pressures=pressures.reshape(*shape, count),
        displacements=found.displacements,
        contraction=contractions.reshape(*shape, count),
        force=found.displacements / effector.packed.compliance,
        pair=found.pair,
        delivered=found.delivered,
        share=found.share,
        reachable=found.reachable,
        residual=residual,
        converged=np.asarray(residual <= TOLERANCE),
        iterations=iterations.reshape(shape),
        code=found.code,
        reach=known,
    )


def solve_displacements(
    effector: Effector, displacements: Floats, *, limit: float
) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Return contractions, pressures (n, m), residuals and iterations (n,) of displacements (n, m).

    Displacements must lie between 0 and the backbone's largest deflection; a pressure that would be
    above `limit` is given as that, and the residual says so.
    """
    packed = effector.packed
    contractions, pressures = np.empty_like(displacements), np.empty_like(displacements)
    residual = np.empty(len(displacements))
    iterations = np.empty(len(displacements), dtype=np.int64)
    _inverse_kernels.place_displacements(
        packed.linkage, packed.peak.contraction, displacements, contractions, residual, iterations
    )
    _inverse_kernels.solve_pressures(
        packed.kinds,
        packed.rows,
        packed.linkage,
        packed.compliance,
        limit,
        displacements,
        contractions,
        pressures,
        residual,
        iterations,
    )
    for k in np.flatnonzero(packed.kinds == OTHER):
        pulls = displacements[:, k] / packed.compliance
        pressures[:, k], left, steps = find_model_pressures(
            effector.models[k], contractions[:, k], pulls, limit=limit
        )
        residual = np.maximum(
            residual, _find_miss(effector, int(k), contractions[:, k], pressures[:, k], left)
        )
        iterations += steps
    return contractions, pressures, residual, iterations


def _find_miss(
    effector: Effector, index: int, contractions: Floats, pressures: Floats, left_over: Floats
) -> Floats:
    """What `_inverse_kernels.measure_left_over` is, of any model that leaves over a pull [N]."""
    packed = effector.packed
    miss = np.zeros(contractions.size)
    used = np.flatnonzero(contractions > 0.0)
    slopes = lateral_slope(effector.design, contractions[used])
    stiffness = np.zeros(used.size)
    if used.size:
        stiffness = effector.models[index].stiffness(pressures[used], contractions[used])
    whole = packed.compliance * np.abs(left_over[used])
    slopes = np.maximum(slopes, 0.0)
    give = slopes + packed.compliance * np.maximum(stiffness, 0.0)
    small = whole <= _inverse_kernels.SMALL * give * contractions[used]
    share = np.where(small, slopes / np.where(give > 0.0, give, 1.0), 1.0)
    miss[used] = whole * share
    return miss
