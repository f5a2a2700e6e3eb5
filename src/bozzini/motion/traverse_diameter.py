"""How wide a body may be along a duct, with links of some length: bounds from both sides."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_number
from ..duct.centreline import Centreline
from ..duct.protocol import Duct
from ..progress import Progress, no_progress
from ._traverse_ceiling import make_ceiling
from ._traverse_chords import scan_line
from ._traverse_section import bound_through
from .passage import find_passage
from .traverse import find_link_limits

__all__ = ["DiameterLimits", "find_diameter_limits"]

RESOLUTION = 0.01
"""Diameters are found to this fraction."""

SECTIONS = 3
"""The upper bound is sought at this many of the places that limit links most."""


@dataclass(frozen=True, kw_only=True)
class DiameterLimits:
    """What bounds the diameter of a body along a duct.

    Parameters
    ----------
    link : float
        Length of its links [mm]; 0 for links of any length, however short.
    low, low_at : float
        Thinner bodies pass, with all joints on the centreline [mm], and the place along the
        centreline that limits them [mm]; proved. The place is infinite if the link is as long as
        the way.
    high, high_at : float
        No thicker body passes [mm], and where; proved. Infinite where nothing is known.
    """

    link: float
    low: float
    low_at: float
    high: float
    high_at: float

    def describe(self) -> dict[str, Any]:
        """Return JSON-able values; infinite numbers stay infinite."""
        return {
            "diameter_low_mm": self.low,
            "diameter_low_at_mm": self.low_at,
            "diameter_high_mm": self.high,
            "diameter_high_at_mm": self.high_at,
        }


def find_diameter_limits(
    duct: Duct,
    line: Centreline,
    *,
    link: float = 0.0,
    stations: int = 40,
    progress: Progress = no_progress,
) -> DiameterLimits:
    """Bound the largest diameter from below and above.

    Parameters
    ----------
    duct, line
        As for `find_link_limits`.
    link : float
        Length of the links [mm]; 0: as short as one likes.
    stations : int
        Places at which links are bounded, to find those that limit them.
    progress : Progress

    Returns
    -------
    DiameterLimits

    Notes
    -----
    From below by the chords of the line (`find_link_limits`), to 1 % of the room. From above by
    the passage (`find_passage`), and by sections: for links of a length those that limit such links
    most, and the thinnest body whose links are proved not to come through; for links of any length
    the tightest, and the thinnest body for whose middle they have no place. On a grid both ends
    know the wall to about its spacing, so that the bounds of a narrow duct lie apart by twice that.
    """
    check_number("link", link, low=0.0, unit="mm")
    points = np.asarray(line.points, dtype=np.float64)
    room = float(np.median(line.radius))
    tight = int(np.argmin(line.radius))
    low, top = 0.0, float(line.radius[tight]) + 0.1 * room
    low_at = float(line.arc_length[tight])
    while top - low > RESOLUTION * max(top, 1e-9):
        middle = 0.5 * (low + top)
        scan = scan_line(duct, points, middle, room, longest=link)
        if scan.value > link:
            low = middle
        else:
            top, low_at = middle, scan.place
        progress("diameter", min(0.4, 0.4 * low / max(top, 1e-9)))
    passage = find_passage(duct, points[0], points[-1])
    high = float(passage.bound)
    gaps = np.linalg.norm(points - passage.place, axis=1)
    high_at = float(line.arc_length[int(np.argmin(gaps))]) if math.isfinite(high) else math.inf
    if math.isfinite(high):
        ceiling = make_ceiling(duct)
        local = ceiling.to_local(points)
        if link > 0.0:
            limits = find_link_limits(
                duct, line, diameter=2.0 * low, stations=stations, ceiling=ceiling
            )
            places = limits.arc_length[np.argsort(limits.rigid, kind="stable")[:SECTIONS]]
        else:
            places = line.arc_length[_find_tightest(line)]
        for place in places:
            index = min(int(np.searchsorted(line.arc_length, place)), len(points) - 1)
            least, most = low, high
            while most - least > RESOLUTION * max(most, 1e-9):
                middle = 0.5 * (least + most)
                found = bound_through(
                    ceiling,
                    local,
                    index,
                    radius=middle,
                    width=max(float(line.radius[index]), float(ceiling.step.max())),
                    limit=4.0 * link if link > 0.0 else float(ceiling.step.min()),
                    tolerance=0.005,
                )
                # The head of any link, however long, goes through the section.
                if found.bound == 0.0 or found.bound < min(link, found.valid_to):
                    most = middle
                else:
                    least = middle
            if most < high:
                high, high_at = most, float(line.arc_length[index])
    progress("diameter", 1.0)
    return DiameterLimits(
        link=float(link), low=2.0 * low, low_at=low_at, high=2.0 * high, high_at=high_at
    )


def _find_tightest(line: Centreline) -> NDArray[np.int64]:
    """Return places (k,) with the least room, at least as far apart as there is room."""
    found: list[int] = []
    for index in np.argsort(line.radius, kind="stable"):
        gaps = [abs(line.arc_length[index] - line.arc_length[other]) for other in found]
        if min(gaps, default=math.inf) >= line.radius[index]:
            found.append(int(index))
        if len(found) == SECTIONS:
            break
    return np.array(found)
