"""Displacements made of random waves, with bounds of their derivatives."""

from __future__ import annotations

import numpy as np


class Waves:
    """``u = sum a_k d_k cos(w_k . x + p_k)``, whose gradient is at most `steepness`."""

    def __init__(self, random, steepness, *, count=4, shortest=60.0):
        length = random.uniform(shortest, 4.0 * shortest, count)
        along, self.direction = (self._draw(random, count) for _ in range(2))
        self.wave = 2.0 * np.pi / length[:, None] * along
        size = np.linalg.norm(self.wave, axis=1)
        share = random.dirichlet(np.ones(count))
        self.amplitude = steepness * share / size
        self.phase = random.uniform(0.0, 2.0 * np.pi, count)
        self.gradient_bound = float((self.amplitude * size).sum())
        self.second_bound = float((self.amplitude * size**2).sum())

    @staticmethod
    def _draw(random, count):
        vectors = random.normal(size=(count, 3))
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    @property
    def bounds(self):
        return {"gradient_bound": self.gradient_bound, "second_bound": self.second_bound}

    def __call__(self, points):
        heights = self.amplitude * np.cos(points @ self.wave.T + self.phase)
        return heights @ self.direction

    def gradient(self, points):
        """Return D u (n, 3, 3)."""
        steep = -self.amplitude * np.sin(points @ self.wave.T + self.phase)
        return np.einsum("nk,ki,kj->nij", steep, self.direction, self.wave)
