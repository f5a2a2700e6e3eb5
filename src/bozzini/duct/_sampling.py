"""From any duct to a sampled field, with a rigorous error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..errors import InputError
from .protocol import Duct, check_duct, count_dimensions

if TYPE_CHECKING:
    from .field import SampledField
    from .planar_field import PlanarField

__all__ = ["choose_voxel", "to_field"]

NODES_MAX = 400_000_000
"""A sampled grid may have this many nodes."""

NODES_WANTED = 4_000_000
"""And has about this many where nobody says how fine it should be."""

MARGIN = 2.0
"""How far the grid reaches beyond the duct [nodes]."""


def to_field(duct: Duct, voxel: float) -> SampledField | PlanarField:
    """Sample the signed distance of a duct on a grid with nodes `voxel` mm apart.

    Parameters
    ----------
    duct : Duct
        Planar or 3-D.
    voxel : float
        Distance between nodes [mm].

    Returns
    -------
    SampledField or PlanarField
        Its ``error`` bounds how far its answer is from the duct's value, itself made larger by
        the duct's own ``error`` (for a sampled duct sqrt(3) times that does); its
        ``clearance_bound`` is rigorous for the duct's wall.

    Raises
    ------
    InputError
        If `voxel` is not positive, or the grid would have more than 400 million nodes.

    Notes
    -----
    The interpolant T of a 1-Lipschitz value s is within e of it, e^2 = sum h_k^2 f_k (1 - f_k) at
    the fractions f_k of the cell (Jensen). The bound by squares holds too, though a node's value
    may be a lower bound b of the distance d: T[b^2] - e^2 <= T[d^2] - e^2 <= d^2.
    """
    from .field import SampledField
    from .planar_field import PlanarField

    check_duct("duct", duct)
    check_number("voxel", voxel, low=0.0, low_open=True, unit="mm")
    dim = count_dimensions(duct)
    size = np.ptp(duct.bounds, axis=0)
    least = (float(size.prod()) / NODES_MAX) ** (1.0 / dim)
    if voxel < 1e-3 * least:  # the number of nodes might overflow
        raise InputError(
            f"voxel is {voxel:g} mm: the grid would have far too many nodes, it must be at least "
            f"about {least:.2g} mm"
        )
    low, high = duct.bounds + MARGIN * voxel * np.array([[-1.0], [1.0]])
    counts = np.ceil((high - low) / voxel) + 1.0
    if counts.prod() > NODES_MAX:
        least = voxel * (counts.prod() / NODES_MAX) ** (1.0 / dim)
        raise InputError(
            f"voxel is {voxel:g} mm: the grid would have {counts.prod():.3g} nodes, it must "
            f"be at least about {least:.2g} mm"
        )
    axes = [low[k] + voxel * np.arange(int(counts[k])) for k in range(dim)]
    # The field takes its inflation off again.
    more = duct.error + duct.inflation
    origin = np.zeros(3)
    origin[:dim] = low
    spacing = np.full(3, float(voxel))
    if dim == 2:
        sheet = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        layer = (duct.signed_distance(sheet) + more).astype(np.float32)
        values = np.repeat(layer[..., None], 2, axis=-1)
    else:
        values = np.empty(tuple(len(axis) for axis in axes), dtype=np.float32)
        sheet = np.stack(np.meshgrid(axes[1], axes[2], indexing="ij"), axis=-1)
        for index, x in enumerate(axes[0]):
            points = np.concatenate([np.full((*sheet.shape[:-1], 1), x), sheet], axis=-1)
            values[index] = duct.signed_distance(points) + more
    # An interpolant is not exact; at its nodes only it may be.
    known_outside = duct.kind == "exact" or (
        duct.kind != "sampled" and bool(getattr(duct, "exact_outside", False))
    )
    sampled = SampledField(
        values=values,
        spacing=spacing,
        origin=origin,
        rotation=np.eye(3),
        inflation=duct.inflation,
        wall=f"{duct.wall}, sampled every {voxel:g} mm",
        wall_error=duct.wall_error,
        reach=math.inf if known_outside else 0.0,
        exact_outside=known_outside,
    )
    return PlanarField(sampled) if dim == 2 else sampled


def choose_voxel(bounds: NDArray[np.float64], parts: tuple[Duct, ...]) -> float:
    """Return the spacing of the finest sampled part, or one that makes about 4 million nodes [mm].

    A part with a field of its own but finer than that limit allows is sampled more coarsely.
    """
    from .field import SampledField

    size = bounds[1] - bounds[0]
    least = float((size.prod() / (16.0 * NODES_WANTED)) ** (1.0 / len(size)))
    own = [float(part.spacing.min()) for part in parts if isinstance(part, SampledField)]
    if own:
        return max(min(own), least)
    return float((size.prod() / NODES_WANTED) ** (1.0 / len(size)))
