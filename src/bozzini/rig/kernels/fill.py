"""Numba kernels of the fill of a volume from a regulated supply."""

from __future__ import annotations

import math

import numpy as np

from ...numeric.compiling import kernel

GRID = 240
"""Pressures at which the time of a fill is computed."""

NEAREST = 1e-6
"""Share of the way to the supply that is left at the last of them."""


@kernel
def regulated_flow(ratio, critical, droop):
    """Flow of an orifice behind a regulator over its choked flow without droop.

    The root of ``w = (1 - droop w) phi(ratio / (1 - droop w))`` with the ellipse of ISO 6358.
    """
    choked = 1.0 / (1.0 + droop)
    if ratio <= critical * choked:
        return choked
    rest = (1.0 - critical) ** 2
    first = rest * (1.0 - droop**2) + (critical * droop) ** 2
    second = 2.0 * droop * (rest + critical * (ratio - critical))
    third = min((ratio - critical) ** 2 - rest, 0.0)
    root = math.sqrt(max(second**2 - 4.0 * first * third, 0.0))
    return min(-2.0 * third / max(second + root, 1e-12), choked)


@kernel
def find_capacity(pressure, atmosphere, growth, middle, width):
    """``d(p V)/dp`` over the grown volume, of a volume that grows along a logistic."""
    if growth == 0.0:
        return 1.0
    grown = 1.0 / (1.0 + math.exp(-min(max((pressure - middle) / width, -60.0), 60.0)))
    rate = growth * grown * (1.0 - grown) / width
    return (1.0 + growth * grown + (pressure + atmosphere) * rate) / (1.0 + growth)


@kernel
def fill(numbers, upstream, atmosphere, times):
    """Gauge pressures at rising times along a fill [MPa].

    `numbers` are delay, time constant, start, supply, critical ratio, droop, growth and its
    pressure and width; `upstream` is whether the transducer is before the orifice.
    """
    delay, tau, start, supply, critical, droop, growth, middle, width = numbers
    whole = supply + atmosphere
    clock = np.empty(GRID)
    shown = np.empty(GRID)
    last_slope = 0.0
    last = start
    for i in range(GRID):
        # Closer together towards the supply, which is approached ever more slowly.
        left = (1.0 - i / (GRID - 1)) ** 3
        pressure = start + (supply - start) * (1.0 - max(left, NEAREST))
        flow = regulated_flow((pressure + atmosphere) / whole, critical, droop)
        capacity = find_capacity(pressure, atmosphere, growth, middle, width)
        slope = capacity / max(flow, 1e-9) / whole
        if i == 0:
            clock[0] = delay
        else:
            clock[i] = clock[i - 1] + 0.5 * tau * (slope + last_slope) * (pressure - last)
        shown[i] = whole * (1.0 - droop * flow) - atmosphere if upstream else pressure
        last_slope = slope
        last = pressure
    found = np.interp(times, clock, shown)
    for k in range(times.size):
        if times[k] < delay:
            found[k] = start
    return found


@kernel
def regulated_flows(ratios, critical, droop):
    """`regulated_flow` of many ratios."""
    found = np.empty(ratios.size)
    for i in range(ratios.size):
        found[i] = regulated_flow(ratios[i], critical, droop)
    return found
