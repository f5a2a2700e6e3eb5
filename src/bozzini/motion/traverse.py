"""How long a rigid link may be along a duct: bounds from both sides, place by place.

Thesis 5.3.5 proposes the diameter of a circle that rolls along the wall. That test is local and
looks at one wall only (`bozzini.duct.traverse_curvature`). Here a link is a segment with a body
around it, and three lengths bracket the longest one that gets through:

- *on the line*: all shorter links, and chains of them with every joint on the centreline, pass and
  never go backwards (proved);
- *head on the line*: no longer link passes whose head stays on the centreline (proved);
- *rigid*: no longer link passes at all (proved).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number
from ..duct.centreline import Centreline
from ..duct.protocol import Duct
from ..errors import InputError
from ..progress import Progress, no_progress
from ._traverse_ceiling import Ceiling, make_ceiling
from ._traverse_chords import scan_line
from ._traverse_section import Segment, bound_behind, bound_through

__all__ = ["LinkLimits", "find_link_limits"]

TOLERANCE = 0.01
"""How far the upper bounds may be above a segment that was found, as a fraction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkLimits:
    """What bounds the length of a link of one diameter along a duct.

    Parameters
    ----------
    diameter : float
        Of the body [mm].
    arc_length : (n,) float
        Places along the centreline [mm].
    radius : (n,) float
        Room on the centreline there [mm].
    on_line : (n,) float
        Shorter links pass there with both joints on the centreline [mm]; infinite where nothing
        on the way limits them.
    head_on_line : (n,) float
        No longer link passes there with its head on the centreline [mm]; infinite where that is
        not known, as near the entry.
    rigid : (n,) float
        No longer link passes there at all [mm]; infinite where that is not known, as near the
        ends.
    link_low : float
        Links shorter than this pass the whole duct, joints on the centreline [mm]; proved.
    link_low_by : str
        What limits it: ``"wall"``, ``"turn"`` (a tail would go backwards) or ``"length"`` (a
        longer link is longer than the way).
    link_low_at : float
        Where [mm]; infinite if it is the length.
    link_head, link_head_at : float
        No longer link passes with its head on the centreline [mm], and where; proved. Both are
        infinite if nothing limits it.
    link_high, link_high_at : float
        No longer link passes at all [mm], and where; proved. Both are infinite if nothing limits
        it.
    pose : (2, dim) float
        A segment that comes near `link_high` there, world frame [mm].
    """

    diameter: float
    arc_length: NDArray[np.float64]
    radius: NDArray[np.float64]
    on_line: NDArray[np.float64]
    head_on_line: NDArray[np.float64]
    rigid: NDArray[np.float64]
    link_low: float
    link_low_by: str
    link_low_at: float
    link_head: float
    link_head_at: float
    link_high: float
    link_high_at: float
    pose: NDArray[np.float64]

    def judge(self, link: float) -> str:
        """Return ``"passes"``, ``"too long"`` or ``"undecided"`` for a link of some length [mm].

        Undecided means longer than `link_low` but not than `link_high`: a planner that leaves the
        centreline tells (`bozzini.motion.plan_insertion`).
        """
        check_number("link", link, low=0.0, low_open=True, unit="mm")
        if link < self.link_low:
            return "passes"
        return "too long" if link > self.link_high else "undecided"

    def describe(self) -> dict[str, Any]:
        """Return JSON-able values; infinite numbers stay infinite."""
        return {
            "diameter_mm": self.diameter,
            "link_low_mm": self.link_low,
            "link_low_by": self.link_low_by,
            "link_low_at_mm": self.link_low_at,
            "link_head_mm": self.link_head,
            "link_head_at_mm": self.link_head_at,
            "link_high_mm": self.link_high,
            "link_high_at_mm": self.link_high_at,
            "pose_mm": self.pose.tolist(),
            "arc_length_mm": self.arc_length.tolist(),
            "radius_mm": self.radius.tolist(),
            "on_line_mm": self.on_line.tolist(),
            "head_on_line_mm": self.head_on_line.tolist(),
            "rigid_mm": self.rigid.tolist(),
        }


def find_link_limits(
    duct: Duct,
    line: Centreline,
    *,
    diameter: float,
    stations: int = 60,
    ceiling: Ceiling | None = None,
    progress: Progress = no_progress,
) -> LinkLimits:
    """Bound the longest link from below and above, place by place along a duct.

    Parameters
    ----------
    duct : Duct
        3-D or planar.
    line : Centreline
        From where links enter to where they go.
    diameter : float
        Of the body [mm].
    stations : int
        Places at which the upper bounds are computed.
    ceiling : Ceiling, optional
        Upper bounds of the clearance, if `make_ceiling` was called for the duct already.
    progress : Progress

    Returns
    -------
    LinkLimits

    Raises
    ------
    InputError
        If the diameter or the number of stations is not legal, or the line is too short.

    Notes
    -----
    A link is a capsule: a segment between its joints, and everything within half the diameter. It
    enters at the line's start, and its head goes to the line's end.

    *From below.* The chords of the line are scanned outwards from every place, until one has not
    the room or is at 90 degrees to the line. All chords of the shortest such length or less are
    free, and they grow with either end, so a link moves along steadily, and so does a chain.

    *From above.* A link that comes through has its middle in every section that parts the duct's
    ends. The longest segment with its middle in a section is found by branch and bound on upper
    bounds of the clearance, to 1 %. A section parts the ends if the line crosses it an odd number
    of times; that takes a lumen without side loops. Near the ends a link may reach out of the duct,
    and no bound is stated. The head's bound takes it that the tail comes after the head.

    On a sampled field all this is about its stated wall; see `SampledField.wall_error`.
    """
    check_number("diameter", diameter, low=0.0, unit="mm")
    check_integer("stations", stations, low=1)
    points = np.asarray(line.points, dtype=np.float64)
    if len(points) < 2 or line.length <= 0.0:
        raise InputError("the centreline has no length: no link can go along it")
    radius = 0.5 * diameter
    progress("chords", 0.0)
    low = scan_line(duct, points, radius, float(np.median(line.radius)))
    progress("sections", 0.0)
    ceiling = make_ceiling(duct) if ceiling is None else ceiling
    local = ceiling.to_local(points)
    size = 2.0 * float(np.linalg.norm(duct.bounds[1] - duct.bounds[0]))
    share = (np.arange(stations) + 0.5) / stations * line.length
    tight = float(line.arc_length[int(np.argmin(line.radius))])
    share = np.concatenate([share, [tight, min(low.place, line.length)]])
    chosen = np.unique(np.searchsorted(line.arc_length, share).clip(0, len(points) - 1))
    through: dict[int, Segment] = {}
    behind: dict[int, Segment] = {}

    def visit(index: int) -> None:
        if index in through:
            return
        room = max(float(line.radius[index]), float(ceiling.step.max()))
        for bound, found in ((bound_through, through), (bound_behind, behind)):
            found[index] = bound(
                ceiling,
                local,
                index,
                radius=radius,
                width=room,
                limit=size,
                tolerance=TOLERANCE,
            )

    for count, index in enumerate(chosen):
        visit(int(index))
        progress("sections", (count + 1) / (len(chosen) + 8))
    for found in (through, behind):
        _refine(found, visit)
    progress("sections", 1.0)
    places = np.array(sorted(through))
    rigid = np.array([_valid_bound(through[k]) for k in places])
    head = np.array([_valid_bound(behind[k]) for k in places])
    arc = line.arc_length[places]
    head = np.minimum(head, rigid)
    best, best_head = int(np.argmin(rigid)), int(np.argmin(head))
    return LinkLimits(
        diameter=float(diameter),
        arc_length=arc,
        radius=np.asarray(line.radius, dtype=np.float64)[places],
        on_line=low.at(arc, points[places]),
        head_on_line=head,
        rigid=rigid,
        link_low=low.value,
        link_low_by=low.by,
        link_low_at=low.place,
        link_head=float(head[best_head]),
        link_head_at=_place(head, arc),
        link_high=float(rigid[best]),
        link_high_at=_place(rigid, arc),
        pose=through[int(places[best])].ends,
    )


def _place(bounds: NDArray[np.float64], arc: NDArray[np.float64]) -> float:
    """Return where the smallest bound is; infinite if there is none."""
    best = int(np.argmin(bounds))
    return float(arc[best]) if math.isfinite(bounds[best]) else math.inf


def _valid_bound(segment: Segment) -> float:
    """Return the bound, or infinity where links that long reach out of the duct's end."""
    return segment.bound if segment.bound < segment.valid_to else math.inf


def _refine(found: dict[int, Segment], visit: Any) -> None:
    """Visit places between the best one and its neighbours, while there are any (at most 8)."""
    for _ in range(4):
        places = sorted(found)
        best = min(range(len(places)), key=lambda k: _valid_bound(found[places[k]]))
        if not math.isfinite(_valid_bound(found[places[best]])):
            return
        sides = places[max(best - 1, 0) : best + 2]
        middles = {(a + b) // 2 for a, b in zip(sides, sides[1:], strict=False)}
        fresh = middles - set(places)
        if not fresh:
            return
        for index in fresh:
            visit(index)
