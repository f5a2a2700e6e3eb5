"""A muscle model that is none of Bozzini's: a spring, for tests that any model will do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bozzini.muscle import Muscle, MuscleModel


@dataclass(frozen=True)
class SpringMuscle(MuscleModel):
    """``force = stiffness * (gain * (P - contact) - x)``."""

    muscle: Muscle
    spring: float = 2.0
    gain: float = 12.0
    contact: float = 0.05

    name = "spring"

    def force(self, pressure, contraction, *, direction=None):
        return self.spring * (self.contraction(pressure) - np.asarray(contraction))

    def contraction(self, pressure, load=0.0, *, direction=None):
        free = self.gain * (np.asarray(pressure, dtype=np.float64) - self.contact)
        return free - np.asarray(load) / self.spring

    def stiffness(self, pressure, contraction, *, direction=None):
        return np.full(np.broadcast(pressure, contraction).shape, self.spring)

    def dead_band(self) -> float:
        return self.contact
