"""Numba kernels of the flow of air through an orifice (ISO 6358)."""

from __future__ import annotations

import math

from ...numeric.compiling import kernel

LINEAR_RATIO = 0.99
"""Pressure ratio above which the flow falls linearly to zero: the ellipse ends with no slope."""


@kernel
def flow_share(ratio, critical):
    """Flow over choked flow at a ratio of downstream to upstream pressure; 1 below `critical`."""
    if ratio <= critical:
        return 1.0
    if ratio < LINEAR_RATIO:
        return math.sqrt(1.0 - ((ratio - critical) / (1.0 - critical)) ** 2)
    edge = math.sqrt(1.0 - ((LINEAR_RATIO - critical) / (1.0 - critical)) ** 2)
    return edge * (1.0 - ratio) / (1.0 - LINEAR_RATIO)


@kernel
def find_flow(choked, upstream, downstream, critical):
    """PV flow [mW] from `upstream` to `downstream` [MPa absolute]; negative when it runs back.

    `choked` is the choked flow over the upstream pressure [mm^3/s].
    """
    if upstream >= downstream:
        return choked * upstream * flow_share(downstream / upstream, critical)
    return -choked * downstream * flow_share(upstream / downstream, critical)
