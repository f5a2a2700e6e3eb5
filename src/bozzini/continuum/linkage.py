"""A chain of 4-bar (7-bar) linkages that turn as little as they can, in closed form (thesis 5.2).

The thesis finds each segment by minimising the angles of its coupler links, (5.7) and (5.9)-(5.10).
The minimum is known: a linkage whose tendon is shorter by ``c`` than its backbone cannot turn its
coupler by less than ``2 asin(|c| / 2 a)`` (Cauchy-Schwarz), and one segment reaches that bound
for all its tendons at once. The last constraint of (5.10) then holds by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer
from ..errors import GeometryError, InputError
from ._linkage_kernels import fill_linkage_frames, fill_linkage_points
from ._parallel import ParallelModel
from .coupling import BendSolution
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
        Displacement by which a command may miss being consistent [mm], in [0, 1].

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
            Not converged, with a reason, where tendons would have to stretch or a limit is
            passed.

        Raises
        ------
        GeometryError
            If a linkage would need more segments to exist; the message says how many.
        InputError
            If there is not one finite displacement for each tendon.
        """
        found = self.solve(displacements)
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
        found = self.solve(displacements)
        if not found.converged.all():
            raise GeometryError(str(found.reason.flat[int(np.argmin(found.converged))]))
        bends = self._flat_bends(found)
        points = np.empty((len(bends), len(self.arc_length), 3))
        fill_linkage_points(self._owner, self._shares, self._lengths, bends, points)
        return points.reshape(*found.residual.shape, *points.shape[1:])

    def _flat_bends(self, found: BendSolution) -> Floats:
        """Return bends of shape (n, m, 2) that the linkages can make, or raise."""
        largest = np.zeros(len(self.segments))
        np.maximum.at(largest, self._owner, self._shares)
        bends = found.bends
        sizes = np.hypot(bends[..., 0], bends[..., 1])
        over = 0.5 * sizes * largest
        failed = ~found.converged
        if failed.any():  # these have their reason already: draw them folded at the most
            bends = np.where(
                failed[..., None, None], bends / np.maximum(over, 1.0)[..., None], bends
            )
            over = np.where(failed[..., None], 0.0, over)
        if over.max(initial=0.0) > 1.0:
            place = np.unravel_index(int(np.argmax(over)), over.shape)
            section = int(place[-1])
            label = self.robot.section_label(section)
            needed = math.ceil(0.5 * float(sizes[place]))
            spacing = (
                "" if largest[section] * self.segments[section] < 1.0 + 1e-9 else ", evenly spaced"
            )
            where = f" (displacements {[int(i) for i in place[:-1]]})" if len(place) > 1 else ""
            raise GeometryError(
                f"{label} has {self.segments[section]} segments: these displacements need at least "
                f"{needed}{spacing}, half of its bend of {float(sizes[place]):.4g} rad, for the "
                f"linkages to exist{where}"
            )
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
