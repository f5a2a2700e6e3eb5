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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_integer, quantity
from ..errors import InputError
from ..numeric.arrays import Floats
from .coupling import BendSolution, ParallelModel
from .kernels.arc import fill_linkage_frames, fill_linkage_points
from .model import write_reasons
from .robot import RobotDesign
from .shape import Shape, require_all

MOST_SEGMENTS = 1_000_000


@dataclass(frozen=True)
class LinkageModel(ParallelModel):
    """Shape from displacements, the robot a chain of rigid links between its discs.

    Each segment takes a part of its section's tendon displacements in proportion to its length.
    As segments get shorter the shape goes to that of `ArcModel`, with an error of ``1 / n^2``.
    ``section_parameters`` of its shapes are ``n`` times twice the link's side components
    ``(m_x, m_y)``, which are the arc's bends; the links turn by slightly more, ``2 n asin(|m|)``.
    Bends that the tendons leave open are those of `ArcModel` too.

    Parameters
    ----------
    robot : RobotDesign
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
    checked_by_class = ("segments",)

    segments: int | Sequence[int] | None = quantity(
        help="Segments in each section (default: one ends at each disc).",
        low=1,
        high=MOST_SEGMENTS,
        whole=True,
        default=None,
        kw_only=True,
        by_name=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "segments", _check_segments(self.robot, self.segments))

    @cached_property
    def _ends(self) -> list[Floats]:
        """Arc lengths where the segments of each section end [mm]."""
        ends = []
        for index, section in enumerate(self.robot.sections):
            places = section.disc_places
            if isinstance(self.segments, tuple):
                count = self.segments[index]
                places = section.length * np.arange(1, count + 1) / count
            ends.append(self.robot.section_starts[index] + places)
            ends[-1][-1] = self.robot.section_ends[index]
        return ends

    @cached_property
    def arc_length(self) -> Floats:
        """Stations: base and joints [mm], shape (k + 1,)."""
        return np.concatenate([[0.0], *self._ends])

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Segments of each section."""
        return tuple(len(places) for places in self._ends)

    @cached_property
    def _chain(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Of each segment its section, its share of the section's length, and its length [mm]."""
        owner = np.repeat(np.arange(len(self._ends)), self.counts)
        lengths = np.diff(self.arc_length)
        shares = lengths / self.robot.section_lengths[owner]
        if self.segments is not None:  # exactly equal: the kernel computes each turn once
            shares = 1.0 / np.asarray(self.counts, dtype=np.float64)[owner]
        return owner, shares, lengths

    def shape(self, displacements: ArrayLike) -> Shape:
        """Return the shapes under tendon displacements; see `ContinuumModel.shape`.

        They have not converged where tendons would have to stretch, a limit is passed, or
        linkages would need more segments to exist: the reason states how many.
        """
        found = self._require_segments(self.solve(displacements))
        bends = self._flat_bends(found)
        frames = np.empty((len(bends), len(self.arc_length), 4, 4))
        fill_linkage_frames(*self._chain, bends, frames)
        return self.answer(
            found,
            arc_length=self.arc_length,
            discs=self.arc_length[1:],
            frames=frames,
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
        found = self._require_segments(self.solve(displacements))
        require_all(found.converged, found.reason)
        bends = self._flat_bends(found)
        points = np.empty((len(bends), len(self.arc_length), 3))
        fill_linkage_points(*self._chain, bends, points)
        return points.reshape(*found.residual.shape, *points.shape[1:])

    @cached_property
    def _largest(self) -> Floats:
        """Largest share of its section's bend that one segment takes, shape (m,)."""
        owner, shares, _ = self._chain
        largest = np.zeros(len(self.counts))
        np.maximum.at(largest, owner, shares)
        return largest

    def _require_segments(self, found: BendSolution) -> BendSolution:
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
            bend, count = float(sizes[place][section]), self.counts[section]
            even = self._largest[section] * count < 1.0 + 1e-9
            reasons[place] = (
                f"{self.robot.section_label(section)} has {count} segments: these displacements "
                f"need at least {math.ceil(0.5 * bend)}{'' if even else ', evenly spaced'}, half "
                f"of its bend of {bend:.4g} rad, for the linkages to exist"
            )
        reason = np.where(bad, write_reasons(bad.shape, reasons), found.reason)
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


def _check_segments(
    robot: RobotDesign, segments: int | Sequence[int] | None
) -> tuple[int, ...] | None:
    """Return segments for each section; None for those between discs."""
    count = len(robot.sections)
    if segments is None:
        return None
    if not isinstance(segments, (tuple, list)):
        return (check_integer("segments", segments, low=1, high=MOST_SEGMENTS),) * count  # type: ignore[arg-type]
    if len(segments) != count:
        raise InputError(
            f"segments has {len(segments)} numbers: give one, or {count}, one a section"
        )
    return tuple(
        check_integer(f"segments[{index}]", number, low=1, high=MOST_SEGMENTS)
        for index, number in enumerate(segments)
    )
