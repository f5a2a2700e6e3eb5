"""A muscle model that is none of Bozzini's: a spring, for tests that any model will do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bozzini.muscle import Muscle, MuscleState


@dataclass(frozen=True)
class SpringMuscle:
    """``force = stiffness * (gain * (P - contact) - x)``; `EFFECTOR` asks for nothing else."""

    muscle: Muscle
    spring: float = 2.0
    gain: float = 12.0
    contact: float = 0.05

    name = "spring"

    def free_contraction(self, pressure):
        return self.gain * (np.asarray(pressure, dtype=np.float64) - self.contact)

    def force(self, pressure, contraction, *, direction=None):
        return self.spring * (self.free_contraction(pressure) - np.asarray(contraction))

    def contraction(self, pressure, load=0.0, *, direction=None):
        return self.free_contraction(pressure) - np.asarray(load) / self.spring

    def stiffness(self, pressure, contraction):
        return np.full(np.broadcast(pressure, contraction).shape, self.spring)

    def blocked_force(self, pressure):
        return self.force(pressure, 0.0)

    def dead_band(self) -> float:
        return self.contact

    def braid_angle(self, pressure, load=0.0):
        return np.zeros(np.broadcast(pressure, load).shape)

    def solve(self, pressure, load=0.0, *, direction=None) -> MuscleState:
        raise NotImplementedError
