"""Commands at some samples ahead, which those between follow in straight lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from .arrays import Floats


@dataclass(frozen=True)
class Knots:
    """Samples ahead at which a plan has knots.

    Parameters
    ----------
    samples : tuple of int
        From 0 up to the horizon.
    period : float
        Between samples [s].

    Raises
    ------
    InputError
        If they do not begin at 0, or do not increase.
    """

    samples: tuple[int, ...]
    period: float

    def __post_init__(self) -> None:
        if self.samples[:1] != (0,) or min(np.diff(self.samples), default=1) < 1:
            raise InputError(f"knots are {self.samples}: they must begin at 0 and increase")

    @cached_property
    def spread(self) -> Floats:
        """Commands (n,) at samples from now on, from those at the knots (k,)."""
        return self._interpolate(np.arange(self.samples[-1] + 1.0))

    @cached_property
    def shift(self) -> Floats:
        """Commands at the knots of the next sample, from those of this one."""
        return self._interpolate(np.array(self.samples) + 1.0)

    def _interpolate(self, samples: Floats) -> Floats:
        rows = np.eye(len(self.samples))
        return np.stack([np.interp(samples, self.samples, row) for row in rows], axis=1)

    @cached_property
    def rates(self) -> Floats:
        """Changes of the commands per second from knot to knot, from those at the knots."""
        count = len(self.samples)
        gaps = self.period * np.diff(self.samples, prepend=-1.0)
        return np.asarray((np.eye(count) - np.eye(count, k=-1)) / gaps[:, None])
