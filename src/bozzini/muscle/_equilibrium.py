"""Batches of equilibria of `EnergyMuscle`: kernels in, arrays or one clear line out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from . import _end_kernels, _kernels
from .design import Muscle
from .model import ConvergenceError, describe_stop, name_at

__all__ = ["Equilibrium"]

Floats = NDArray[np.float64]

PAST_LOCKING = 0.35
"""Cosine of the braid angle at which a muscle with friction ends."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A muscle as the kernels take it; all methods take float arrays of one shape.

    Attributes
    ----------
    design : tuple of float
        See `_kernels`; the last two are the legal stretches.
    active : float
        Length that contracts [mm].
    tapered : bool
        Whether the ends are trellis nets.
    """

    design: tuple[float, ...]
    active: float
    tapered: bool

    @classmethod
    def of(cls, muscle: Muscle, *, tapered: bool) -> Equilibrium:
        """Return a muscle's equilibria."""
        cosine, sine = math.cos(muscle.braid_angle), math.sin(muscle.braid_angle)
        shear = float(muscle.modulus) / 6.0
        crossing = 8.0 * math.pi / 3.0 * muscle.braid_radius * cosine / sine
        design = (
            cosine,
            sine,
            float(muscle.braid_radius),
            float(muscle.inner_radius) ** 2,
            float(muscle.outer_radius) ** 2,
            math.log(muscle.outer_radius / muscle.inner_radius),
            shear * (1.0 - float(muscle.mooney_ratio)),
            shear * float(muscle.mooney_ratio),
            crossing * float(muscle.friction_length),
        )
        low = locked = 1.0 / (math.sqrt(3.0) * cosine)
        if muscle.friction_length > 0.0:
            low = _kernels.find_closed_bore(design, locked, PAST_LOCKING / cosine)
        high = _kernels.find_closed_bore(design, 1.0, 1.0 / cosine)
        return cls((*design, float(low), float(high)), float(muscle.active_length), tapered)

    @property
    def stretches(self) -> tuple[float, float]:
        """The legal stretches."""
        return self.design[9], self.design[10]

    def find(
        self, pressures: Floats, loads: Floats, signs: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the stretches under loads and the iterations, or raise `InputError`.

        One that did not converge took `_kernels.MAX_ITERATIONS`.
        """
        stretches = np.empty(pressures.shape)
        iterations = np.empty(pressures.shape, dtype=np.int64)
        code, index = _kernels.find_stretches(
            self.design,
            pressures.ravel(),
            loads.ravel(),
            signs.ravel(),
            stretches.reshape(-1),
            iterations.reshape(-1),
        )
        if code != _kernels.CONVERGED:
            pressure, sign = float(pressures.flat[index]), float(signs.flat[index])
            low, high = (
                _kernels.find_force(self.design, pressure, stretch, sign)[0]
                for stretch in self.stretches
            )
            raise InputError(
                f"{name_at('load', loads, index)} is {loads.flat[index]:g} N: at a pressure of "
                f"{pressure:g} MPa it must lie in [{max(0.0, low):.6g}, {high:.6g}] N, above "
                "which the braid squeezes the bore shut"
            )
        return stretches, iterations

    def place(self, pressures: Floats, contractions: Floats, signs: Floats) -> Floats:
        """Return the stretches at given contractions, or raise an error."""
        low, high = self.stretches
        if not self.tapered:
            return np.clip(1.0 - contractions / self.active, low, high)
        stretches = np.empty(pressures.shape)
        code, index = _end_kernels.find_ended_stretches(
            self.design,
            self.active,
            pressures.ravel(),
            contractions.ravel(),
            signs.ravel(),
            stretches.reshape(-1),
        )
        if code != _kernels.CONVERGED:
            name = name_at("contraction", contractions, index)
            if code == _kernels.STOPPED:
                raise ConvergenceError(
                    f"no taper of the energy model at {name} = {contractions.flat[index]:g} mm: "
                    f"{describe_stop(_kernels.MAX_ITERATIONS)}"
                )
            raise InputError(
                f"{name} is {contractions.flat[index]:g} mm: with trellis ends at a pressure of "
                f"{pressures.flat[index]:g} MPa it must be at most the free contraction, or 0 mm "
                "below the dead band"
            )
        return np.clip(stretches, low, high)

    def shorten(self, pressures: Floats, stretches: Floats) -> Floats:
        """Return the contractions at given stretches of the cylinder."""
        contraction = self.active * (1.0 - stretches)
        if self.tapered:
            contraction = contraction + 2.0 * self.measure_ends(pressures, stretches)[0]
        return np.asarray(contraction)

    def evaluate(self, pressures: Floats, stretches: Floats, signs: Floats) -> Floats:
        """Return pull, its slope in the stretch, contact pressure and swell, (4, ...)."""
        out = np.empty((4, *pressures.shape))
        _kernels.find_forces(
            self.design, pressures.ravel(), stretches.ravel(), signs.ravel(), out.reshape(4, -1)
        )
        return out

    def measure_wall(self, stretches: Floats, swells: Floats) -> Floats:
        """Return the strain energy of the wall [N mm]."""
        energy = np.empty(stretches.shape)
        _kernels.fill_energies(self.design, stretches.ravel(), swells.ravel(), energy.reshape(-1))
        return 2.0 * math.pi * self.active * energy

    def measure_ends(self, pressures: Floats, stretches: Floats) -> Floats:
        """Return by how much an end is shorter, holds less and has more potential, (3, ...)."""
        out = np.zeros((3, *pressures.shape))
        if not self.tapered:
            return out
        code, index = _end_kernels.fill_ends(
            self.design, pressures.ravel(), stretches.ravel(), out.reshape(3, -1)
        )
        if code != _kernels.CONVERGED:
            raise InputError(
                f"{name_at('pressure', pressures, index)} is {pressures.flat[index]:g} MPa: "
                "friction leaves the tapered ends no tension; it must be less, or the ends 'none'"
            )
        return out
