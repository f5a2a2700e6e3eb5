"""A robot cut into segments, as the energy model's kernels take it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _energy_kernels as kernels
from ._energy_segment_kernels import ARC, CHANNEL, CHORD
from .robot import ContinuumRobot
from .tendon import GRAIN

__all__ = ["SEGMENTS", "Grid", "place_stations"]

Floats = NDArray[np.float64]

SEGMENTS = {"chord": CHORD, "arc": ARC, "channel": CHANNEL}


def place_stations(robot: ContinuumRobot, between: int, *, corners: bool = False) -> Floats:
    """Return base, discs, points `between` and tendon ends [mm], and corners of routings."""
    places = robot.stations(between=between)
    others = list(robot.tendon_ends)
    if corners:
        others += [place for tendon in robot.tendons for place in tendon.corners()]
    for other in others:
        if np.abs(places - other).min() > GRAIN:
            places = np.append(places, other)
    return np.sort(places)


@dataclass(frozen=True)
class Grid:
    """Segments of a robot between stations, and how its tendons pass them."""

    robot: ContinuumRobot
    segment: str
    between: int

    @cached_property
    def arc_length(self) -> Floats:
        """Stations [mm], shape (n + 1,)."""
        return place_stations(self.robot, self.between, corners=self.segment == "channel")

    @cached_property
    def packed(self) -> tuple[Any, ...]:
        """What the kernels take, see `_energy_kernels`."""
        return (
            self.spans,
            self.stiffness,
            self.paths,
            self._guides,
            self.counts,
            SEGMENTS[self.segment],
        )

    @cached_property
    def spans(self) -> Floats:
        """Lengths of the segments [mm], shape (n,)."""
        return np.diff(self.arc_length)

    @cached_property
    def paths(self) -> Floats:
        """Places of the tendons in the cross-sections, shape (t, n + 1, 2); 0 past their ends."""
        paths = np.zeros((len(self.robot.tendons), len(self.arc_length), 2))
        for row, (tendon, end) in enumerate(
            zip(self.robot.tendons, self.robot.tendon_ends, strict=True)
        ):
            places = self.arc_length[self.arc_length <= end + GRAIN]
            paths[row, : len(places)] = tendon.path(np.minimum(places, end))
        return paths

    @cached_property
    def reach(self) -> Floats:
        """Distance of the tendons from the backbone [mm], shape (t, n + 1)."""
        return np.asarray(np.sqrt(np.sum(self.paths**2, axis=-1)))

    @cached_property
    def straight(self) -> Floats:
        """Length of each tendon in each segment of the straight robot [mm], shape (t, n)."""
        if self.segment == "channel":
            slopes = np.sqrt(1.0 + np.sum(self._guides[..., 2:] ** 2, axis=-1))
            long = np.asarray(self.spans * (slopes @ kernels.WEIGHTS))
        else:
            steps = np.diff(self.paths, axis=1)
            long = np.sqrt(self.spans**2 + np.sum(steps**2, axis=-1))
        return np.asarray(np.where(self._passed, long, 0.0))

    @cached_property
    def most_pull(self) -> Floats:
        """A bound on what each tendon can be pulled, shape (t,) [mm].

        A straight tendon is no shorter than the backbone's step less its two offsets.
        """
        if self.segment == "channel":
            return np.asarray(self.straight.sum(axis=1))
        # An arc of half a turn is the most bent one.
        step = self.spans if self.segment == "chord" else self.spans * (2.0 / math.pi)
        least = np.maximum(step - self.reach[:, 1:] - self.reach[:, :-1], 0.0)
        return np.asarray(np.maximum(self.straight - least, 0.0).sum(axis=1))

    @cached_property
    def give(self) -> Floats:
        """How much each tendon, alone and almost straight, gives way to tension, (t,) [mm/N].

        If the backbone were as stiff everywhere as where it is stiffest.
        """
        squares = self.reach[:, 1:] ** 2 * self._passed
        return np.asarray(np.sum(squares / self.stiffness[:, :2].max(), axis=1))

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Segments that each tendon passes, shape (t,)."""
        return np.searchsorted(self.arc_length, self.robot.tendon_ends - GRAIN).astype(np.int64)

    @cached_property
    def sections(self) -> NDArray[np.int64]:
        """Section of each segment, shape (n,)."""
        return self.robot.section_at(0.5 * (self.arc_length[1:] + self.arc_length[:-1]))

    @cached_property
    def stiffness(self) -> Floats:
        """Moment by turn of each segment about x, y and z [N mm], shape (n, 3)."""
        moduli = [
            (section.bending_stiffness, section.bending_stiffness, section.torsional_stiffness)
            for section in self.robot.sections
        ]
        return np.asarray(np.asarray(moduli)[self.sections] / self.spans[:, None])

    def place_frames(self, turns: Floats) -> Floats:
        """Frames at the stations, for turns (b, n, 3) of the segments, (b, n + 1, 4, 4)."""
        count, stations = len(turns), len(self.arc_length)
        frames = np.zeros((count, stations, 4, 4))
        frames[:, :, 3, 3] = 1.0
        rotations, points = np.empty((stations, 3, 3)), np.empty((stations, 3))
        for index in range(count):
            kernels.fill_frames(self.packed, turns[index], rotations, points)
            frames[index, :, :3, :3] = rotations
            frames[index, :, :3, 3] = points
        return frames

    def sum_bends(self, turns: Floats) -> Floats:
        """Bend of each section; none unless all tendons are parallel."""
        if not all(tendon.is_parallel for tendon in self.robot.tendons):
            return np.zeros((len(turns), 0, 2))
        bends = np.zeros((len(turns), len(self.robot.sections), 2))
        for index in range(len(self.robot.sections)):
            total = turns[:, self.sections == index].sum(axis=1)
            bends[:, index] = np.stack([total[:, 1], -total[:, 0]], axis=-1)
        return bends

    def measure_bends(self, turns: Floats) -> tuple[Floats, Floats]:
        """Angle by which each section bends, and its largest curvature, (b, m) [rad], [1/mm]."""
        angles = np.hypot(turns[..., 0], turns[..., 1])
        if self.segment == "chord":
            # As a linkage's: what the tendons see of it.
            angles = 2.0 * np.sin(0.5 * angles)
        count = len(self.robot.sections)
        bends, curvatures = np.zeros((2, len(turns), count))
        for index in range(count):
            own = self.sections == index
            bends[:, index] = angles[:, own].sum(axis=1)
            curvatures[:, index] = (angles[:, own] / self.spans[own]).max(axis=1)
        return bends, curvatures

    @cached_property
    def _passed(self) -> NDArray[np.bool_]:
        return np.asarray(np.arange(len(self.spans)) < self.counts[:, None])

    @cached_property
    def _guides(self) -> Floats:
        """Places and slopes of the tendons at the Gauss points of segments, (t, n, g, 4)."""
        guides = np.zeros((len(self.counts), len(self.spans), len(kernels.POINTS), 4))
        places = self.arc_length[:-1, None] + self.spans[:, None] * kernels.POINTS
        for row, (tendon, count) in enumerate(zip(self.robot.tendons, self.counts, strict=True)):
            guides[row, :count, :, :2] = tendon.path(places[:count])
            guides[row, :count, :, 2:] = tendon.path_slope(places[:count])
        return guides
