"""A shape of another package, as its user writes it: NumPy only, and with compiled kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from bozzini.duct import Duct, PackedDuct
from bozzini.duct.kernels.clearance import register_kernels


@dataclass(frozen=True, eq=False)
class Torus(Duct):
    """A ring about the z axis, of round section: exact on both sides."""

    ring: float
    section: float
    inflation: float = 0.0

    name = "torus"

    @property
    def bounds(self):
        reach = self.section + self.inflation
        high = np.array([self.ring + reach, self.ring + reach, reach])
        return np.stack([-high, high])

    def signed_distance(self, points):
        x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
        return np.hypot(np.hypot(x, y) - self.ring, z) - self.section - self.inflation


class TorusData(NamedTuple):
    ring: float
    section: float
    inflation: float
    slack: float


@njit
def estimate(duct, x, y, z):
    off = math.sqrt(x * x + y * y) - duct.ring
    return duct.section + duct.inflation - math.sqrt(off * off + z * z)


@njit
def bound(duct, x, y, z):
    return estimate(duct, x, y, z) - duct.slack


@njit
def slope(duct, x, y, z):
    far = math.sqrt(x * x + y * y)
    off = far - duct.ring
    away = max(math.sqrt(off * off + z * z), 1e-12)
    out = -off / away / max(far, 1e-12)
    return estimate(duct, x, y, z), out * x, out * y, -z / away


register_kernels(TorusData, bound=bound, estimate=estimate, slope=slope)


@dataclass(frozen=True, eq=False)
class PackedTorus(PackedDuct):
    """The same, evaluated by its own kernels."""

    ring: float
    section: float
    inflation: float = 0.0

    name = "packed-torus"
    bounds = Torus.bounds

    def pack(self):
        return TorusData(self.ring, self.section, self.inflation, 1e-12)
