"""Whether an equilibrium of the discrete rod is stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._energy_grid import Grid
from ._energy_kernels import measure_lengths

__all__ = ["is_stable"]

Floats = NDArray[np.float64]


def is_stable(
    grid: Grid, turns: Floats, tensions: Floats, taut: NDArray[np.bool_], compliances: Floats
) -> bool:
    """Whether the energy is a minimum among the shapes of the same tendon lengths.

    In channels every segment has to be one by itself. `compliances` (t,) are the tendons' [mm/N].
    """
    tendons, segments = len(taut), len(turns)
    slopes = np.empty((tendons, segments, 3))
    positive, whole = np.empty((2, segments, 3, 3))
    measure_lengths(grid.packed, turns, tensions, np.empty(tendons), slopes, positive, whole)
    scale = 1.0 / np.sqrt(grid.stiffness)
    if grid.segment == "channel":
        # In finer and finer segments, one that gives way alone is enough.
        blocks = whole * scale[:, :, None] * scale[:, None, :] + np.eye(3)
        return bool(np.linalg.eigvalsh(blocks).min() > -1e-9)
    hessian = np.zeros((segments, 3, segments, 3))
    index = np.arange(segments)
    hessian[index, :, index, :] = whole * scale[:, :, None] * scale[:, None, :]
    size = 3 * segments
    hessian = hessian.reshape(size, size) + np.eye(size)
    rows = (slopes * scale).reshape(tendons, size)[taut]
    if compliances.any():
        # Lengths are not held, but cost energy.
        hessian += rows.T @ (rows / compliances[taut, None])
        rows = rows[:0]
    _, sizes, ways = np.linalg.svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(sizes > 1e-9 * sizes.max(initial=0.0)))
    free = ways[rank:]
    return bool(np.linalg.eigvalsh(free @ hessian @ free.T).min(initial=1.0) > -1e-9)
