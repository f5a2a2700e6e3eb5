"""A chain of 4-bar (7-bar) linkages that turn as little as they can, in closed form (thesis 5.2).

The thesis finds each segment by minimising the angles of its coupler links, (5.7) and (5.9)-(5.10).
The minimum is known: a linkage whose tendon is shorter by ``c`` than its backbone cannot turn its
coupler by less than ``2 asin(|c| / 2 a)`` (Cauchy-Schwarz), and one segment reaches that bound
for all its tendons at once. The last constraint of (5.10) then holds by itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer
from ..errors import GeometryError, InputError
from ._batch import ParallelModel
from .coupling import BendSolution, reason_array
from .kernels.linkage import fill_linkage_frames, fill_linkage_points
from .robot import ContinuumRobot
from .shape import Shape

__all__ = ["LinkageModel"]

Floats = NDArray[np.float64]

MOST_SEGMENTS = 1_000_000


class LinkageModel(ParallelModel):
    """Shape from displacements, the robot a chain of rigid links between its discs.

    Each segment takes a part of its section's tendon displacements in proportion to its length.
    As segments get shorter the shape goes to that of `ArcModel`, with an error of ``1 / n^2``.
    ``section_parameters`` of its shapes are ``n`` times twice the link's side components
    ``(m_x, m_y)``, which are the arc's bends; the links turn by slightly more, ``2 n asin(|m|)``.
    Bends that the tendons leave open are those of `ArcModel` too.

    Parameters
    ----------
    robot : ContinuumRobot
        A robot of parallel tendons.
    segments : int or sequence of int, optional
        Segments of equal length in each section; without it, a segment ends at each disc.
    tolerance : float
        Displacement by which a command may miss being consistent [mm], in (0, 1].

    Raises
    ------
    GeometryError
        If a tendon is not parallel or ends inside its section, or there is none.
    InputError
        If `segments` is not one whole number from 1, or one for each section.
    """

    name = "linkage"

    def __init__(
        self,
        robot: ContinuumRobot,
        *,
        segments: int | Sequence[int] | None = None,
        tolerance: float = 1e-6,
    ) -> None:
        super().__init__(robot, tolerance=tolerance)
        counts = _read_segments(robot, segments)
        ends = []
        for index, section in enumerate(robot.sections):
            places = section.disc_places
            if counts:
                places = section.length * np.arange(1, counts[index] + 1) / counts[index]
            ends.append(robot.section_starts[index] + places)
            ends[-1][-1] = robot.section_ends[index]
        self.segments = tuple(len(places) for places in ends)
        self.arc_length = np.concatenate([[0.0], *ends])
        self._owner = np.repeat(np.arange(len(ends)), self.segments)
        self._lengths = np.concatenate(
            [
                np.diff(places, prepend=start)
                for places, start in zip(ends, robot.section_starts, strict=True)
            ]
        )
        sizes = np.asarray([section.length for section in robot.sections])
        self._shares = self._lengths / sizes[self._owner]
        if counts:  # exactly equal, so that the kernel computes each section's turn once
            self._shares = 1.0 / np.asarray(self.segments, dtype=np.float64)[self._owner]

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements.

        Parameters
        ----------
        displacements : array_like, shape (..., t)
            How far each tendon is pulled [mm].

        Returns
        -------
        Shape
            Not converged, with a reason, where tendons would have to stretch, a limit is passed,
            or linkages would need more segments to exist: the reason says how many.

        Raises
        ------
        InputError
            If there is not one finite displacement for each tendon.
        """
        found = self._check_segments(self.solve(displacements))
        bends = self._flat_bends(found)
        frames = np.empty((len(bends), len(self.arc_length), 4, 4))
        fill_linkage_frames(self._owner, self._shares, self._lengths, bends, frames)
        return self._make_shape(
            displacements,
            found,
            arc_length=self.arc_length,
            disc_arc_length=self.arc_length[1:],
            frames=frames.reshape(*found.residual.shape, *frames.shape[1:]),
        )

    def points(self, displacements: ArrayLike) -> Floats:
        """Return only the joints of the backbone, shape (..., k, 3) [mm]: the fast way in bulk.

        Raises
        ------
        GeometryError
            If displacements have no shape, for any reason that `shape` would give.
        InputError
            If there is not one finite displacement for each tendon.
        """
        found = self._check_segments(self.solve(displacements))
        if not found.converged.all():
            place = np.unravel_index(int(np.argmin(found.converged)), found.converged.shape)
            where = f" (displacements {[int(i) for i in place]})" if place else ""
            raise GeometryError(f"{found.reason[place]}{where}")
        bends = self._flat_bends(found)
        points = np.empty((len(bends), len(self.arc_length), 3))
        fill_linkage_points(self._owner, self._shares, self._lengths, bends, points)
        return points.reshape(*found.residual.shape, *points.shape[1:])

    @cached_property
    def _largest(self) -> Floats:
        """Largest share of its section's bend that one segment takes, shape (m,)."""
        largest = np.zeros(len(self.segments))
        np.maximum.at(largest, self._owner, self._shares)
        return largest

    def _check_segments(self, found: BendSolution) -> BendSolution:
        """Mark bends for which linkages do not exist."""
        sizes = np.hypot(found.bends[..., 0], found.bends[..., 1])
        over = 0.5 * sizes * self._largest
        worst = over.max(axis=-1)
        bad = found.converged & (worst > 1.0)
        if not bad.any():
            return found
        reasons: dict[tuple[int, ...], str] = {}
        for index in np.argwhere(bad):
            place = tuple(int(i) for i in index)
            section = int(np.argmax(over[place]))
            bend, count = float(sizes[place][section]), self.segments[section]
            even = self._largest[section] * count < 1.0 + 1e-9
            reasons[place] = (
                f"{self.robot.section_label(section)} has {count} segments: these displacements "
                f"need at least {math.ceil(0.5 * bend)}{'' if even else ', evenly spaced'}, half "
                f"of its bend of {bend:.4g} rad, for the linkages to exist"
            )
        reason = np.where(bad, reason_array(bad.shape, reasons), found.reason)
        return dataclasses.replace(found, converged=found.converged & ~bad, reason=reason)

    def _flat_bends(self, found: BendSolution) -> Floats:
        """Return bends of shape (n, m, 2), those that are none folded at the most."""
        bends = found.bends
        failed = ~found.converged
        if failed.any():
            over = 0.5 * np.hypot(bends[..., 0], bends[..., 1]) * self._largest
            least = np.where(failed[..., None], np.maximum(over, 1.0), 1.0)
            bends = bends / least[..., None]
        return np.ascontiguousarray(bends.reshape(-1, *bends.shape[-2:]))


def _read_segments(robot: ContinuumRobot, segments: Any) -> tuple[int, ...]:
    """Return segments for each section; empty for those between discs."""
    if segments is None:
        return ()
    count = len(robot.sections)
    if not isinstance(segments, (tuple, list)):
        return (check_integer("segments", segments, low=1, high=MOST_SEGMENTS),) * count
    if len(segments) != count:
        raise InputError(
            f"segments has {len(segments)} numbers: give one, or {count}, one a section"
        )
    return tuple(
        check_integer(f"segments[{index}]", number, low=1, high=MOST_SEGMENTS)
        for index, number in enumerate(segments)
    )
