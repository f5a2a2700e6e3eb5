"""A robot cut into steps, as the rod's kernels take it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from .loads import PackedLoads
from .profile import ROUND_OFF_MM
from .robot import RobotDesign
from .section import LEAST_LEVER, Section

NUDGE_MM = 10.0 * ROUND_OFF_MM
"""How far inside a step its ends are evaluated [mm]."""

EDGE = 2.0 * ROUND_OFF_MM
"""Distance at which a place counts as a step's end [mm]."""

RIGID = 1e10
"""Stiffness that stands for an infinite one, against bending stiffness by the length's square."""

Packed = tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]


def measure_rest_rates(packed: Packed) -> Floats:
    """Return the length of tendons per length of the backbone at rest, shape (n, 3, t)."""
    _, _, rest, guides, present = packed
    return np.asarray(np.linalg.norm(find_ways(rest, guides, 1.0), axis=-1) * present[:, None])


def find_ways(rest: Floats, guides: Floats, along: float) -> Floats:
    """Return ``along e_z + u x r + r'`` of tendons at rest, shape (n, 3, t, 3)."""
    x, y, slope_x, slope_y = np.moveaxis(guides, -1, 0)
    u_x, u_y, twist = np.moveaxis(rest[:, :, None], -1, 0)
    ways = slope_x - twist * y, slope_y + twist * x, along + u_x * y - u_y * x
    return np.stack(ways, axis=-1)


@dataclass(frozen=True)
class RodGrid:
    """Steps of a robot, and how its tendons pass them.

    `places` (n + 1,) are the steps' ends [mm]; wherever something jumps is one of them.
    """

    robot: RobotDesign
    places: Floats

    @classmethod
    def cut(cls, robot: RobotDesign, stations: Floats, steps: int) -> RodGrid:
        """Return at least so many steps, with stations and corners of tendons among their ends."""
        corners = [place for tendon in robot.tendons for place in tendon.corners()]
        breaks = _unique(np.concatenate([stations, corners]))
        widest = robot.length / steps
        pieces = [
            np.linspace(start, end, math.ceil((end - start) / widest - 1e-9) + 1)[1:]
            for start, end in zip(breaks[:-1], breaks[1:], strict=True)
        ]
        return cls(robot, np.concatenate([[0.0], *pieces]))

    def find(self, stations: Floats) -> NDArray[np.int64]:
        """Return the indices of places at stations; a cluster of places was kept as its first."""
        return np.minimum(np.searchsorted(self.places, stations - EDGE), len(self.places) - 1)

    def thin(self, breaks: Floats, steps: int) -> RodGrid:
        """Return about so many of these steps, joined between breaks."""
        kept, widest = [0], self.robot.length / steps * (1.0 + 1e-9)
        fixed = np.isin(np.arange(len(self.places)), self.find(breaks))
        for index in range(1, len(self.places) - 1):
            if fixed[index] or self.places[index + 1] - self.places[kept[-1]] > widest:
                kept.append(index)
        return RodGrid(self.robot, self.places[[*kept, -1]])

    @cached_property
    def natural_lengths(self) -> Floats:
        """Length of each tendon in the robot at rest, without loads [mm], shape (t,)."""
        rates = measure_rest_rates(self.packed)
        means = (rates[:, 0] + 4.0 * rates[:, 1] + rates[:, 2]) / 6.0
        return np.asarray(np.sum(means * np.diff(self.places)[:, None], axis=0))

    @cached_property
    def rest_changes(self) -> Floats:
        """Natural lengths by relative changes of offset, and by clocking [mm], shape (t, 2)."""
        ways, changes = find_ways(self.rest, self.guides, 1.0), []
        ways = ways / np.linalg.norm(ways, axis=-1, keepdims=True)
        clocked = self.guides[..., [1, 0, 3, 2]] * [-1.0, 1.0, -1.0, 1.0]
        for moved in (self.guides, clocked):
            rates = np.sum(ways * find_ways(self.rest, moved, 0.0), axis=-1)
            means = (rates[:, 0] + 4.0 * rates[:, 1] + rates[:, 2]) / 6.0
            changes.append(np.sum(means * np.diff(self.places)[:, None], axis=0))
        return np.stack(changes, axis=-1)

    @property
    def packed(self) -> Packed:
        """What the kernels take, see `integrate_rod`."""
        return self.places, self.stiffness, self.rest, self.guides, self.present

    @cached_property
    def inner_places(self) -> Floats:
        """Start, middle and end of the steps [mm], inside of them, shape (n, 3)."""
        middles = 0.5 * (self.places[1:] + self.places[:-1])
        width = np.diff(self.places)
        edge = np.maximum(0.5 * width - NUDGE_MM, 0.25 * width)
        return np.stack([middles - edge, middles, middles + edge], axis=1)

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """Whether each tendon runs in each step, shape (n, t)."""
        return np.asarray(self.inner_places[:, 1, None] < self.robot.tendon_ends)

    @cached_property
    def guides(self) -> Floats:
        """Places and slopes of tendons at start, middle and end of steps, shape (n, 3, t, 4)."""
        guides = np.zeros((len(self.places) - 1, 3, len(self.robot.tendons), 4))
        for row, tendon in enumerate(self.robot.tendons):
            here = self.present[:, row]
            guides[here, :, row, :2] = tendon.place_at(self.inner_places[here])
            guides[here, :, row, 2:] = tendon.slope_at(self.inner_places[here])
        return guides

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffnesses of the backbone as of `RobotDesign.stiffness_at`, shape (n, 3, 6)."""
        found = self.robot.stiffness_at(self.inner_places)
        rigid = RIGID * found[..., 3:].max() / self.robot.length**2
        return np.ascontiguousarray(np.where(np.isfinite(found), found, rigid))

    @cached_property
    def rest(self) -> Floats:
        """Curvatures and twist at rest [1/mm], shape (n, 3, 3)."""
        return np.ascontiguousarray(self.robot.curvature_at(self.inner_places))

    @cached_property
    def reaches(self) -> Floats:
        """Least distance of each tendon from the backbone, as a lever [mm], shape (t,).

        Of a tendon that comes near to the backbone, or crosses it, a share of its largest.
        """
        offsets = np.sqrt(np.sum(self.guides[..., :2] ** 2, axis=-1))
        most = offsets.max(axis=(0, 1))
        offsets = np.where(self.present[:, None], offsets, math.inf)
        return np.asarray(np.maximum(offsets.min(axis=(0, 1)), LEAST_LEVER * most))


def _unique(places: Floats) -> Floats:
    """Return sorted places, those that differ by round-off once."""
    ordered = np.unique(places)
    return np.asarray(ordered[np.concatenate([[True], np.diff(ordered) > ROUND_OFF_MM])])


def list_breaks(robot: RobotDesign, loads: PackedLoads) -> Floats:
    """Return the arc lengths inside a robot where its sections, tendons or loads change [mm]."""
    corners = [place for tendon in robot.tendons for place in tendon.corners()]
    knots = [
        start + knot
        for start, section in zip(robot.section_starts, robot.sections, strict=True)
        for knot in list_knots(section)
    ]
    found = _unique(
        np.concatenate(
            [
                robot.section_ends,
                robot.tendon_ends,
                corners,
                knots,
                loads.points,
                loads.line_spans.ravel(),
            ]
        )
    )
    return found[(found > ROUND_OFF_MM) & (found < robot.length - ROUND_OFF_MM)]


def list_knots(section: Section) -> list[float]:
    """Return the places of all knots of a section's profiles, from its start [mm]."""
    profiles: list[object] = [
        section.bending_stiffness,
        section.torsional_stiffness,
        section.stretch_stiffness,
        section.shear_stiffness,
        section.line_weight,
        section.curvature,
        section.wire.diameter if section.wire else None,
    ]
    rows = [row for profile in profiles if isinstance(profile, tuple) for row in profile]
    return [float(row[0]) for row in rows if isinstance(row, tuple)]
