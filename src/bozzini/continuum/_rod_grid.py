"""A robot cut into steps, as the rod's kernels take it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ._energy_grid import place_stations
from .robot import ContinuumRobot
from .tendon import GRAIN

__all__ = ["RodGrid"]

Floats = NDArray[np.float64]

NUDGE = 1e-9
"""How far inside a smooth piece its ends are evaluated, against its length."""


@dataclass(frozen=True)
class RodGrid:
    """Steps of a robot, at least `steps` of them, and how its tendons pass them."""

    robot: ContinuumRobot
    between: int
    steps: int

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base, discs, tendon ends and points between [mm], shape (k,)."""
        return place_stations(self.robot, self.between)

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the straight robot [mm], shape (t,)."""
        slopes = np.sqrt(1.0 + np.sum(self.guides[..., 2:] ** 2, axis=-1)) * self.present[:, None]
        means = (slopes[:, 0] + 4.0 * slopes[:, 1] + slopes[:, 2]) / 6.0
        return np.asarray(np.sum(means * np.diff(self.places)[:, None], axis=0))

    @property
    def packed(self) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
        """What the kernels take, see `integrate_rod`."""
        return self.places, self.stiffness, self.guides, self.present

    @cached_property
    def places(self) -> Floats:
        """Ends of the steps [mm], shape (n + 1,): stations and corners of tendons among them."""
        corners = [place for tendon in self.robot.tendons for place in tendon.corners()]
        breaks = np.unique(np.concatenate([self.arc_length, corners]))
        breaks = breaks[np.concatenate([[True], np.diff(breaks) > GRAIN])]
        widest = self.robot.length / self.steps
        pieces = [
            np.linspace(start, end, math.ceil((end - start) / widest - 1e-9) + 1)[1:]
            for start, end in zip(breaks[:-1], breaks[1:], strict=True)
        ]
        return np.concatenate([[0.0], *pieces])

    @cached_property
    def middles(self) -> Floats:
        """Middles of the steps [mm], shape (n,)."""
        return np.asarray(0.5 * (self.places[1:] + self.places[:-1]))

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Whether each tendon runs in each step, shape (n, t)."""
        return np.asarray(self.middles[:, None] < self.robot.tendon_ends)

    @cached_property
    def guides(self) -> Floats:
        """Places and slopes of tendons at start, middle and end of steps, shape (n, 3, t, 4)."""
        guides = np.zeros((len(self.middles), 3, len(self.robot.tendons), 4))
        # Inside the step, where corners do not matter.
        edge = (0.5 - NUDGE) * np.diff(self.places)
        places = np.stack([self.middles - edge, self.middles, self.middles + edge], axis=1)
        for row, tendon in enumerate(self.robot.tendons):
            here = self.present[:, row]
            guides[here, :, row, :2] = tendon.path(places[here])
            guides[here, :, row, 2:] = tendon.path_slope(places[here])
        return guides

    @cached_property
    def stiffness(self) -> Floats:
        """EI, EI and GJ of the backbone in each step [N mm^2], shape (n, 3)."""
        sections = [
            (section.bending_stiffness, section.bending_stiffness, section.torsional_stiffness)
            for section in self.robot.sections
        ]
        return np.asarray(sections, dtype=np.float64)[self.robot.section_at(self.middles)]

    @cached_property
    def reaches(self) -> Floats:
        """Least distance of each tendon from the backbone [mm], shape (t,)."""
        offsets = np.sqrt(np.sum(self.guides[..., :2] ** 2, axis=-1))
        offsets = np.where(self.present[:, None], offsets, math.inf)
        return np.asarray(offsets.min(axis=(0, 1)))
