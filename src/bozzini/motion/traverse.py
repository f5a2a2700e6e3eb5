"""How long a rigid link may be along a duct: bounds from both sides, place by place.

Thesis 5.3.5 proposes the diameter of a circle that rolls along the wall. That test is local and
looks at one wall only (`validation/thesis/traverse_curvature.py`). Here a link of length L is a
segment with all within the radius r of it, ``d`` the clearance [mm], ``p(s)`` the centreline by its
arc length and ``t(s)`` its tangent. Three lengths bracket the longest link that gets through::

    link_low  = min over a of |p(b) - p(a)| at the first b > a for which d < r somewhere on the
                chord, or (p(b) - p(a)) . t <= 0 at one of its ends
    link_high = min over sections S of max {2 l : d(x + u q) >= r for |q| <= l, x in S, |u| = 1}
    link_head = min over s of max {l : d(p(s) + u q) >= r for 0 <= q <= l, u . t(s) <= 0},
                or link_high if that is less

- *on the line*: all shorter links, and chains of them with every joint on the centreline, pass and
  never go backwards (proved);
- *head on the line*: no longer link passes whose head stays on the centreline (proved);
- *rigid*: no longer link passes at all, for its middle comes through every section that parts the
  duct's ends (proved).

Nothing but these numbers is unknown; each is bounded on its safe side. `link_low` takes
lower bounds of ``d`` along chords of a polyline. The others take upper bounds of ``d`` on a grid
(`Ceiling`), by ``d(x) <= d(y) + |x - y|``, and branch and bound over the segment's middle in the
section and its direction, down to 1 % of the longest segment found. Near the ends links reach out
of the duct: bounds hold for ``L < valid_to`` only. The methods are ours; docs/theory/motion.md has
closed forms for a circular bend to check them by.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, check_number, describe_fields, quantity
from ..duct.base import Duct
from ..duct.centreline import Centreline
from ..duct.field import SampledField
from ..errors import InputError
from ..numeric.polylines import measure_arc_length, resample_polyline
from ..progress import Progress, no_progress
from ..results import Json, Shown
from .space import find_passage

Reals = NDArray[np.floating[Any]]

# Upper bounds of a duct's clearance, on a grid.
#
# A proof that a link does not come through needs them; a duct itself answers lower bounds.

NODES_MAX = {2: 150_000, 3: 400_000}
"""An analytic duct, planar or 3-D, is put on a grid of about this many nodes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ceiling:
    """Upper bounds of the clearance at the nodes of a grid, as negative distances.

    Parameters
    ----------
    values : (nx, ny, nz) float32
        Minus an upper bound of the clearance [mm].
    step : (3,) float
        Distance between nodes [mm].
    origin : (3,) float
        Node (0, 0, 0) in the world frame, whose axes the grid has; not used for a sampled field,
        which keeps its own grid [mm].
    floor : float
        Bounds below this only mean that the clearance is below it [mm].
    duct : Duct
    """

    values: NDArray[np.float32]
    step: NDArray[np.float64]
    origin: NDArray[np.float64]
    floor: float
    duct: Duct

    @property
    def planar(self) -> bool:
        """Whether the duct is planar."""
        return self.duct.dim == 2

    def to_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn world points (..., dim) into the grid's frame (..., 3) [mm]."""
        if isinstance(self.duct, SampledField):
            return self.duct.to_grid(points)
        if self.planar:
            points = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        return np.asarray(points - self.origin)

    def to_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn points (..., 3) of the grid's frame into world points (..., dim) [mm]."""
        if isinstance(self.duct, SampledField):
            return self.duct.to_world(points)
        return np.asarray((points + self.origin)[..., : self.duct.dim])

    def measure(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return upper bounds (n,) of the clearance at local points (n, 3) [mm]."""
        from .kernels.traverse import measure_ceilings

        result = np.empty(len(points))
        measure_ceilings(self.values, self.step, self.floor, points, result)
        return result


def make_ceiling(duct: Duct) -> Ceiling:
    """Put upper bounds of a duct's clearance on a grid.

    An exact distance is its own bound at nodes. Otherwise the distance inside may promise too
    little, in a sampled field too if it was sampled from such a one. But every point within the
    distance of a node outside is outside too, and the distance to such points bounds the clearance.
    """
    if isinstance(duct, SampledField):
        step = np.asarray(duct.spacing, dtype=np.float64)
        shape = duct.values.shape
        # Beyond the reach distances are only known to be at least that: as bounds of the clearance
        # from above these are right, but no wall can be found from there.
        beyond = max(duct.reach - duct.inflation, 0.0)
        values = _measure_outside(
            duct,
            lambda flat: duct.to_world(np.stack(np.unravel_index(flat, shape), axis=-1) * step),
            duct.values,
            step,
            inflation=duct.inflation,
            known=duct.values < np.float64(duct.reach - duct.error),
        )
        return Ceiling(
            values=_round_down(values), step=step, origin=np.zeros(3), floor=-beyond, duct=duct
        )
    low, high = duct.bounds
    dim = len(low)
    pitch = float(np.prod(high - low) / NODES_MAX[dim]) ** (1.0 / dim)
    axes = [np.arange(low[k] - 2.0 * pitch, high[k] + 3.0 * pitch, pitch) for k in range(dim)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    origin = np.zeros(3)
    origin[:dim] = nodes.reshape(-1, dim)[0]
    distance: Reals = duct.signed_distance(nodes) - duct.error
    if duct.kind != "exact" or duct.inflation > 0.0:
        points = nodes.reshape(-1, dim)
        distance = _measure_outside(duct, points.__getitem__, distance, np.full(dim, pitch))
    if dim == 2:  # two equal sheets: points of the plane are in the lower one
        distance = np.repeat(distance[..., None], 2, axis=-1)
    return Ceiling(
        values=_round_down(distance),
        step=np.full(3, pitch),
        origin=origin,
        floor=-math.inf,
        duct=duct,
    )


def _measure_outside(
    duct: Duct,
    find_nodes: Callable[[NDArray[np.int64]], NDArray[np.float64]],
    distance: Reals,
    step: NDArray[np.float64],
    inflation: float = 0.0,
    known: NDArray[np.bool_] | bool = True,
) -> Reals:
    """Return the distance where it is positive; elsewhere minus that to a point known outside.

    The array has the type of `distance`, from which the inflation is taken; nodes are asked for by
    their flat numbers. Sums are made in float64, whatever the type.

    That is the foot of the nearest node outside, on the wall or between it and the node.
    """
    from scipy import ndimage

    shift = np.float64(inflation)  # a float of Python's would be rounded to float32 first
    inside = distance <= shift
    outside = ~inside & known
    result = np.empty_like(distance)
    np.subtract(distance, shift, out=result, casting="same_kind")
    if not outside.any():
        result[inside] = -math.inf
        return result
    nearest = ndimage.distance_transform_edt(
        ~outside, sampling=tuple(step), return_distances=False, return_indices=True
    )
    found = np.ravel_multi_index(tuple(index[inside] for index in nearest), distance.shape)
    boundary, place = np.unique(found, return_inverse=True)
    points = find_nodes(boundary)
    normals = duct.gradient(points)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    feet = points - (distance.ravel()[boundary] - shift)[:, None] * normals
    nodes = find_nodes(np.flatnonzero(inside))
    result[inside] = -np.linalg.norm(nodes - feet[place], axis=-1)
    return result


def _round_down(values: Reals) -> NDArray[np.float32]:
    return np.nextafter(values.astype(np.float32, copy=False), np.float32(-np.inf))


# Which chords of a line a body fits to: the bound of its links from below.

CHORDS_MAX = 1000
"""The line is divided into about this many segments at most for its chords."""

FINE = 0.25
"""Its segments are at most this [mm], or `SPARE_FRACTION` if that is less, but for `CHORDS_MAX`."""

SPARE_FRACTION = 0.02
"""Largest segment of the line, against the clearance that the body leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ChordScan:
    """The chords of a line to which a link does not fit, the first from each place on.

    Parameters
    ----------
    start : (k, dim) float
        Where they begin [mm].
    first, last : (k,) float
        Arc length of their ends [mm].
    length : (k,) float
        Of the chords, at least [mm].
    value, by, place
        `LinkLimits.link_low`, `link_low_by` and `link_low_at`.
    """

    start: NDArray[np.float64]
    first: NDArray[np.float64]
    last: NDArray[np.float64]
    length: NDArray[np.float64]
    value: float
    by: str
    place: float

    def at(self, arc: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the shortest of them that spans each place (n,) at `points` (n, dim).

        A link that is stopped before it spans a place counts with the length that would.
        """
        distances = np.linalg.norm(points[:, None] - self.start, axis=-1)
        length = np.where(self.last < arc[:, None], np.maximum(distances, self.length), self.length)
        length = np.where(self.first <= arc[:, None], length, math.inf)
        return np.asarray(length.min(axis=1, initial=math.inf))


def scan_line(
    duct: Duct,
    points: NDArray[np.float64],
    radius: float,
    width: float,
    longest: float = math.inf,
) -> ChordScan:
    """Find the shortest chord of a line (n, dim) to which a body of some radius does not fit.

    Parameters
    ----------
    duct : Duct
    points : (n, dim) float
        World frame [mm].
    radius : float
        Of the body [mm].
    width : float
        Usual distance of the line from the wall [mm], to choose how finely to look.
    longest : float
        Longer chords are not looked at [mm]: a larger value only means that shorter ones fit.
    """
    from .kernels.traverse import TURN, scan_chords

    length = float(measure_arc_length(points)[-1])
    spare = max(width - radius, 0.1 * width)
    fine = max(min(FINE, SPARE_FRACTION * spare), length / CHORDS_MAX)
    dense = _divide(points, fine)
    count = len(dense) - 1
    stop, reason = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    reach = np.empty(count)
    local = np.ascontiguousarray(duct.to_grid(dense))
    scan_chords(duct.pack(), local, radius, longest, stop, reach, reason)
    arc = measure_arc_length(dense)
    hits = np.flatnonzero(stop < count)
    whole = float(np.linalg.norm(dense[-1] - dense[0]))
    low = ChordScan(
        start=dense[hits],
        first=arc[hits],
        last=arc[stop[hits] + 1],
        length=reach[hits],
        value=whole,
        by="length",
        place=math.inf,
    )
    if len(hits) == 0 or low.length.min() >= whole:
        return low
    worst = int(np.argmin(low.length))
    place = 0.5 * float(low.first[worst] + low.last[worst])
    if low.length[worst] == 0.0:  # not even one joint fits
        place = float(arc[int(np.argmax(duct.signed_distance(dense)))])
    return ChordScan(
        start=low.start,
        first=low.first,
        last=low.last,
        length=low.length,
        value=float(low.length[worst]),
        by="turn" if reason[hits[worst]] == TURN else "wall",
        place=place,
    )


def _divide(points: NDArray[np.float64], spacing: float) -> NDArray[np.float64]:
    """Return a polyline with every segment divided into equal parts of at most `spacing`."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.concatenate([[True], steps > 0.0])
    kept = points[keep]
    parts = [
        resample_polyline(kept[k : k + 2], float(step) / math.ceil(float(step) / spacing))[:-1]
        for k, step in enumerate(steps[steps > 0.0])
    ]
    return np.concatenate([*parts, kept[-1:]])


# The longest segment that fits with its middle in a section of a duct, bounded from above.
#
# A rigid link that comes from one end of a duct to the other has its middle in every section
# between them at some time, and lies in the lumen then. So no link is longer than the longest
# segment with its middle in one section.

SQUARES = 12
"""Squares of a section from its middle to the edge of the window, at first."""

WINDOWS = 5
"""How often the window is doubled until it holds the section."""

TOLERANCE = 0.01
"""How far the upper bounds may be above a segment that was found, as a fraction."""

CELLS_MAX = 20_000
"""Branch and bound keeps this many cells open, and 100 per square, at most."""

RAY_STEP = 0.2
"""Smallest step along a ray, in distances between nodes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """What bounds a link at a section, or behind a point.

    Parameters
    ----------
    bound : float
        No link is longer [mm]; infinite where the section gives no bound.
    valid_to : float
        The argument holds for links up to this length [mm]; longer ones would reach out of the
        duct's end there.
    ends : (2, dim) float
        A segment that comes near the bound, world frame [mm].
    """

    bound: float
    valid_to: float
    ends: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SegmentSearch:
    """The search for the longest segments of a body along a line.

    Parameters
    ----------
    ceiling : Ceiling
    line : (n, 3) float
        From the duct's start to its end, local frame [mm].
    radius : float
        Of the body [mm].
    limit : float
        Longer segments are not looked for [mm].
    tolerance : float
        How far, as a factor, a bound may be above a segment that was found.
    """

    ceiling: Ceiling
    line: NDArray[np.float64]
    radius: float
    limit: float
    tolerance: float = TOLERANCE

    def bound_through(self, index: int, width: float) -> Segment:
        """Bound the links that come through the section at a point of the line.

        `width` is the clearance at the point, to begin with [mm].
        """
        ceiling, line = self.ceiling, self.line
        axes = _find_axes(line, index, width, planar=ceiling.planar)
        centre = line[index]
        nowhere = ceiling.to_world(np.stack([centre, centre]))
        section = _cover_section(ceiling, line, centre, axes, width)
        if section is None:
            return Segment(bound=math.inf, valid_to=0.0, ends=nowhere)
        squares, half = section
        corner = half if ceiling.planar else half * math.sqrt(2.0)
        ends = line[[0, -1]]
        end_distances = [
            float(np.linalg.norm(squares - end, axis=1).min()) - corner for end in ends
        ]
        fits = ceiling.measure(squares) + corner >= self.radius
        valid_to = 2.0 * max(min(end_distances), 0.0)
        if not fits.any():
            return Segment(bound=0.0, valid_to=valid_to, ends=nowhere)
        starts = np.ascontiguousarray(squares[fits])
        return replace(self._find(starts, half, axes, back=False), valid_to=valid_to)

    def bound_behind(self, index: int, width: float) -> Segment:
        """Bound the links whose head is at a point of the line, and whose tail is behind it."""
        line = self.line
        axes = _find_axes(line, index, width, planar=self.ceiling.planar)
        found = self._find(line[index : index + 1].copy(), 0.0, axes, back=True)
        return replace(found, valid_to=float(np.linalg.norm(line[index] - line[0])))

    def _find(
        self, starts: NDArray[np.float64], half: float, axes: NDArray[np.float64], *, back: bool
    ) -> Segment:
        """Return the longest segment with its middle in squares, or backwards from points."""
        from .kernels.traverse import CELL, find_longest

        ceiling = self.ceiling
        cells = np.empty((CELLS_MAX + 100 * len(starts), CELL))
        bound, found = find_longest(
            ceiling.values, ceiling.step, ceiling.floor, starts, half, axes, ceiling.planar, back,
            self.radius, self.limit, RAY_STEP * float(ceiling.step.min()), 1.0 + self.tolerance,
            cells,
        )  # fmt: skip
        bound = math.inf if bound >= self.limit else float(bound)
        start, along = found[1:4], found[4:7] * found[0]
        ends = (start, start + along) if back else (start - 0.5 * along, start + 0.5 * along)
        return Segment(bound=bound, valid_to=0.0, ends=ceiling.to_world(np.stack(ends)))


def _find_axes(
    line: NDArray[np.float64], index: int, width: float, *, planar: bool
) -> NDArray[np.float64]:
    """Return two axes of the section and its normal, as rows; see `find_longest` if planar.

    The normal is the line's direction over places within half of `width`.
    """
    near = np.linalg.norm(line - line[index], axis=1) <= max(0.5 * width, 1e-9)
    first, last = index, index
    while first > 0 and (near[first - 1] or first == index):
        first -= 1
    while last < len(line) - 1 and (near[last + 1] or last == index):
        last += 1
    normal = line[last] - line[first]
    normal = normal / np.linalg.norm(normal)
    if planar:
        return np.stack([np.array([-normal[1], normal[0], 0.0]), normal, normal])
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    one = np.cross(normal, helper)
    one = one / np.linalg.norm(one)
    return np.stack([one, np.cross(normal, one), normal])


def _cover_section(
    ceiling: Ceiling,
    line: NDArray[np.float64],
    centre: NDArray[np.float64],
    axes: NDArray[np.float64],
    width: float,
) -> tuple[NDArray[np.float64], float] | None:
    """Return squares (k, 3) that cover the section around `centre`, and half their side.

    None if they do not part the line's ends: the line crosses them an even number of times, or
    they do not end in the largest window.
    """
    from scipy import ndimage

    side = max(width, 2.0 * float(ceiling.step.max())) * 2.0 / SQUARES
    half = 0.5 * side
    reach = half if ceiling.planar else half * math.sqrt(2.0)
    count = SQUARES
    for _ in range(WINDOWS):
        # Squares with upper bounds of the clearance above 0, connected to the one in the middle.
        indices = np.arange(-count, count + 1)
        grid = np.stack(
            np.meshgrid(indices, np.zeros(1) if ceiling.planar else indices, indexing="ij"), axis=-1
        )
        middles = centre + side * (grid[..., :1] * axes[0] + grid[..., 1:] * axes[1])
        clearance = ceiling.measure(middles.reshape(-1, 3)).reshape(middles.shape[:2])
        labels, _ = ndimage.label(clearance + reach >= 0.0, structure=np.ones((3, 3)))
        own_label = labels[count, 0 if ceiling.planar else count]
        if own_label == 0:
            return None
        inside = labels == own_label
        border = [inside[0], inside[-1]]
        if not ceiling.planar:
            border += [inside[:, 0], inside[:, -1]]
        if not any(bool(part.any()) for part in border):
            break
        count *= 2
    else:
        return None
    # How often the line goes through these squares.
    height = (line - centre) @ axes[2]
    before = np.flatnonzero((height[:-1] < 0.0) != (height[1:] < 0.0))
    fraction = height[before] / (height[before] - height[before + 1])
    crossings = line[before] + fraction[:, None] * (line[before + 1] - line[before]) - centre
    square = np.rint(crossings @ axes[:2].T / side).astype(int) + count
    if ceiling.planar:
        square[:, 1] = 0
    legal = np.all((square >= 0) & (square < inside.shape), axis=1)
    crossing_count = int(np.count_nonzero(inside[tuple(square[legal].T)]))
    return (middles[inside], half) if crossing_count % 2 == 1 else None


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkLimits(Shown):
    """What bounds the length of a link of one diameter along a duct.

    Parameters
    ----------
    diameter : float
        Of the body [mm].
    arc_length : (n,) float
        Places along the centreline [mm].
    radius : (n,) float
        Clearance of the centreline there [mm].
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

    diameter: float = quantity("length")
    link_low: float = quantity("length")
    link_low_by: str
    link_low_at: float = quantity("length")
    link_head: float = quantity("length")
    link_head_at: float = quantity("length")
    link_high: float = quantity("length")
    link_high_at: float = quantity("length")
    pose: NDArray[np.float64] = quantity("length")
    arc_length: NDArray[np.float64] = quantity("length")
    radius: NDArray[np.float64] = quantity("length")
    on_line: NDArray[np.float64] = quantity("length")
    head_on_line: NDArray[np.float64] = quantity("length")
    rigid: NDArray[np.float64] = quantity("length")

    def judge(self, link: float) -> str:
        """Return ``"passes"``, ``"too long"`` or ``"undecided"`` for a link of some length [mm].

        Undecided means longer than `link_low` but not than `link_high`: a planner that leaves the
        centreline tells (`bozzini.motion.plan_insertion`).
        """
        check_number("link", link, low=0.0, low_open=True, unit="mm")
        if link < self.link_low:
            return "passes"
        return "too long" if link > self.link_high else "undecided"

    def describe(self) -> dict[str, object]:
        """Return JSON-able values; infinite numbers stay infinite."""
        known: Json = {**describe_fields(self), "link_low_by": self.link_low_by}
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in known.items()
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

    *From below.* The chords of the line are scanned outwards from every place, until one lacks
    the clearance or is at 90 degrees to the line. All chords of the shortest such length or less
    are free, and they grow with either end, so a link moves along steadily, and so does a chain.

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
    arc_lengths = (np.arange(stations) + 0.5) / stations * line.length
    tightest = float(line.arc_length[int(np.argmin(line.radius))])
    arc_lengths = np.concatenate([arc_lengths, [tightest, min(low.place, line.length)]])
    chosen = np.unique(np.searchsorted(line.arc_length, arc_lengths).clip(0, len(points) - 1))
    through: dict[int, Segment] = {}
    behind: dict[int, Segment] = {}

    search = SegmentSearch(ceiling=ceiling, line=local, radius=radius, limit=size)

    def visit(index: int) -> None:
        if index not in through:
            width = max(float(line.radius[index]), float(ceiling.step.max()))
            through[index] = search.bound_through(index, width)
            behind[index] = search.bound_behind(index, width)

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


def _refine(found: dict[int, Segment], visit: Callable[[int], None]) -> None:
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


# How wide a body may be along a duct, with links of some length: bounds from both sides.

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

    def describe(self) -> dict[str, object]:
        """Return JSON-able values; infinite numbers stay infinite."""
        ends = {"low": self.low, "low_at": self.low_at, "high": self.high, "high_at": self.high_at}
        return {f"diameter_{name}_mm": value for name, value in ends.items()}


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
    From below by the chords of the line (`find_link_limits`), to 1 % of the clearance. From above
    by the passage (`find_passage`), and by sections: for links of a length those that limit such
    links most, and the thinnest body whose links are proved not to come through; for links of any
    length the tightest, and the thinnest body for whose middle they have no place. On a grid both
    ends know the wall to about its spacing, so that the bounds of a narrow duct lie apart by twice
    that.
    """
    check_number("link", link, low=0.0, unit="mm")
    points = np.asarray(line.points, dtype=np.float64)
    width = float(np.median(line.radius))
    tightest = int(np.argmin(line.radius))
    low, upper = 0.0, float(line.radius[tightest]) + 0.1 * width
    low_at = float(line.arc_length[tightest])
    while upper - low > RESOLUTION * max(upper, 1e-9):
        radius = 0.5 * (low + upper)
        scan = scan_line(duct, points, radius, width, longest=link)
        if scan.value > link:
            low = radius
        else:
            upper, low_at = radius, scan.place
        progress("diameter", min(0.4, 0.4 * low / max(upper, 1e-9)))
    passage = find_passage(duct, points[0], goal=points[-1])
    high = float(passage.bound)
    distances = np.linalg.norm(points - passage.place, axis=1)
    high_at = float(line.arc_length[int(np.argmin(distances))]) if math.isfinite(high) else math.inf
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
        search = SegmentSearch(
            ceiling=ceiling,
            line=local,
            radius=0.0,
            limit=4.0 * link if link > 0.0 else float(ceiling.step.min()),
            tolerance=0.005,
        )
        for place in places:
            index = min(int(np.searchsorted(line.arc_length, place)), len(points) - 1)
            width = max(float(line.radius[index]), float(ceiling.step.max()))
            lower, upper_here = low, high
            while upper_here - lower > RESOLUTION * max(upper_here, 1e-9):
                radius = 0.5 * (lower + upper_here)
                found = replace(search, radius=radius).bound_through(index, width)
                # The head of any link, however long, goes through the section.
                if found.bound == 0.0 or found.bound < min(link, found.valid_to):
                    upper_here = radius
                else:
                    lower = radius
            if upper_here < high:
                high, high_at = upper_here, float(line.arc_length[index])
    progress("diameter", 1.0)
    return DiameterLimits(
        link=float(link), low=2.0 * low, low_at=low_at, high=2.0 * high, high_at=high_at
    )


def _find_tightest(line: Centreline) -> NDArray[np.int64]:
    """Return places (k,) with the least clearance, at least as far apart as that."""
    found: list[int] = []
    for index in np.argsort(line.radius, kind="stable"):
        distances = [abs(line.arc_length[index] - line.arc_length[other]) for other in found]
        if min(distances, default=math.inf) >= line.radius[index]:
            found.append(int(index))
        if len(found) == SECTIONS:
            break
    return np.array(found)
