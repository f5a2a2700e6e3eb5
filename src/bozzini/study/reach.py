"""Parts of a lumen that a centreline does not reach: components, beyond its ends, branches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import LabelTract, SurfaceTract
from ..duct import Centreline, SampledField
from ..report.verdict import SHARE_REACHED
from ..results import Json
from .ends import LANDMARK_REACH, OrientedCentreline, find_reach, measure_gap, name_landmarks

__all__ = ["Unreached", "find_unreached", "measure_unreached"]

SHARE_STATED = 0.10
"""From this share of the lumen on, or from `LENGTH_STATED` on, a part stands in the verdict."""

LENGTH_STATED = 40.0
"""How far a part that stands in the verdict reaches beyond the lumen along the centreline [mm]."""

NEAR, NEAR_SHARE = 5.0, 0.6
"""What is this near to the lumen round the line is part of it [mm]; in a narrow lumen this share of
its radius."""

SUBSAMPLE = 200_000
"""About so many nodes of the lumen are looked at."""


Kind = Literal["component", "before", "beyond", "branch", "missing", "landmark"]


@dataclass(frozen=True, kw_only=True)
class Unreached:
    """A part of the lumen that the centreline does not reach.

    Attributes
    ----------
    kind : {"component", "before", "beyond", "branch", "missing", "landmark"}
        Not joined to the lumen of the centreline; before its entry; beyond its goal; beside it;
        not in the file; a landmark far outside the lumen.
    volume : float
        [mm^3].
    share : float
        Of the volume of the whole lumen, this part and all other components included.
    point : tuple of float
        In it, farthest from the centreline, world frame [mm].
    at : float or None
        Where it leaves the centreline: arc length [mm].
    length : float or None
        How far it reaches, in a straight line, from the body of lumen along the centreline, or how
        far a landmark lies outside the lumen [mm].
    name : str
        Names of its labels, where there are any, or of a landmark.
    """

    kind: Kind
    volume: float
    share: float
    point: tuple[float, float, float]
    at: float | None = None
    length: float | None = None
    name: str = ""

    @property
    def stated(self) -> bool:
        """Whether it is large enough to stand in the verdict."""
        if self.kind in ("missing", "landmark"):
            return True
        long = self.length is None or self.length >= LENGTH_STATED
        return self.share >= SHARE_STATED or (long and self.share >= SHARE_REACHED)

    @property
    def words(self) -> str:
        """The part in a few words."""
        percent = "<1" if self.share < 0.01 else f"{100.0 * self.share:.0f}"
        size = f"{self.volume / 1000.0:.3g} mL ({percent} % of the lumen)"
        if self.kind == "landmark":
            return self.name
        if self.kind == "missing":
            return f"{self.volume / 1000.0:.3g} mL of lumen are missing in the file"
        named = f" ({self.name})" if self.name else ""
        if self.kind == "component":
            return f"a separate component{named} of {size}"
        if self.kind == "beyond":
            return f"{size} beyond the goal"
        if self.kind == "before":
            return f"{size} before the entry"
        return f"a side branch of {size} at {self.at or 0.0:.0f} mm of the centreline"

    def describe(self) -> Json:
        """Return JSON-able values."""
        return {
            "kind": self.kind,
            "volume_mm3": self.volume,
            "share": self.share,
            "point_mm": [round(value, 3) for value in self.point],
            "at_mm": self.at,
            "length_mm": self.length,
            "name": self.name,
            "stated": self.stated,
            "text": self.words,
        }


def measure_unreached(parts: Sequence[Unreached], ends: OrientedCentreline) -> float:
    """Return the share of the lumen that a way should have reached and does not.

    That is what is not reached of all of it, less what is left out on purpose: everything beside
    the way to a goal that was given, else what lies before an entry that was.
    """
    if ends.goal_given:
        return 0.0
    return sum(part.share for part in parts if not (ends.given and part.kind == "before"))


def find_unreached(
    tract: LabelTract | SurfaceTract, field: SampledField, line: Centreline
) -> tuple[Unreached, ...]:
    """Find the parts of a tract's lumen that a centreline does not reach, largest first.

    A node of the lumen belongs to the centreline if it is no farther from it than 1.5 times
    the largest inscribed radius within about that distance, and `NEAR` more: this holds the lumen
    round the line also where its section is not round. What is farther is grouped into connected
    parts. What a wall closes off from the centreline is a component. Components that are not in the
    field at all, and lumen that is missing in the file, are those that the tract lists; landmarks
    far outside the lumen come last.
    """
    from scipy import ndimage
    from scipy.spatial import cKDTree

    rest = field.inflate(-field.inflation)
    inside = rest.values < 0.0
    index = np.argwhere(inside)
    # As in the centreline's graph: what none of the 26 neighbours joins is closed off.
    component, _ = ndimage.label(inside, structure=np.ones((3, 3, 3)))
    stride = max(1, round((len(index) / SUBSAMPLE) ** (1.0 / 3.0)))
    thin = index[(index % stride == 0).all(axis=1)]
    if len(thin) < 8:
        thin, stride = index, 1
    cell = tract.volume / len(thin)
    grid = rest.to_grid(line.points)
    distance, nearest = cKDTree(grid).query(thin * rest.spacing)
    clearance = np.maximum(line.radius - field.inflation, 0.0)
    on_line = np.rint(grid / rest.spacing).astype(int)
    own = np.setdiff1d(component[tuple(on_line.T)], 0)
    closed_off = component[tuple(thin.T)]
    closed_off[np.isin(closed_off, own)] = 0
    more = min(NEAR, NEAR_SHARE * float(np.median(clearance)))
    far = distance > 1.5 * _spread(clearance, line.arc_length)[nearest] + more
    far &= closed_off == 0
    total = len(thin) * cell + sum(part.volume for part in (*tract.not_reached, *tract.missing))
    found = [
        Unreached(kind="missing", volume=part.volume, share=part.volume / total, point=part.point)
        for part in tract.missing
    ]
    found += [
        Unreached(
            kind="component",
            volume=part.volume,
            share=part.volume / total,
            point=part.point,
            name=", ".join(part.label_names),
        )
        for part in tract.not_reached
    ]
    groups = [
        (np.flatnonzero(closed_off == mark), False) for mark in np.unique(closed_off) if mark > 0
    ]
    if far.any():
        nodes = thin // stride
        low = nodes.min(axis=0)
        mask = np.zeros(tuple(nodes.max(axis=0) - low + 1), dtype=bool)
        mask[tuple((nodes[far] - low).T)] = True
        marks, count = ndimage.label(mask, structure=np.ones((3, 3, 3)))
        number = marks[tuple((nodes - low).T)]
        groups += [(np.flatnonzero(far & (number == k)), True) for k in range(1, count + 1)]
    for chosen, joined in groups:
        share = len(chosen) * cell / total
        if share < SHARE_REACHED:
            continue
        mouth, tip = chosen[np.argmin(distance[chosen])], chosen[np.argmax(distance[chosen])]
        x, y, z = (float(v) for v in rest.to_world(thin[tip] * rest.spacing))
        at = float(line.arc_length[nearest[mouth]])
        kind: Kind = "branch"
        if not joined:
            kind = "component"
        elif at <= max(more, 1.5 * clearance[0]):
            kind = "before"
        elif at >= line.length - max(more, 1.5 * clearance[-1]):
            kind = "beyond"
        found.append(
            Unreached(
                kind=kind,
                volume=len(chosen) * cell,
                share=share,
                point=(x, y, z),
                at=at,
                length=float(distance[tip] - distance[mouth]),
            )
        )
    for name, place in name_landmarks(tract).items():
        gap = measure_gap(tract, np.array(place))
        if gap > find_reach(tract, LANDMARK_REACH):
            found.append(
                Unreached(
                    kind="landmark", volume=0.0, share=0.0, point=place, length=gap, name=name
                )
            )
    return tuple(sorted(found, key=lambda part: -part.volume))


def _spread(radius: NDArray[np.float64], arc: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each point the largest radius within that radius along the line."""
    from scipy.ndimage import maximum_filter1d

    step = float(arc[-1]) / max(len(arc) - 1, 1)
    half = int(np.median(radius) / max(step, 1e-9)) + 1
    return np.asarray(maximum_filter1d(radius, 2 * half + 1))
