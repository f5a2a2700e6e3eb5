"""The two ends of a centreline: those that were named, those of the file, and the entry of them.

The shape of a lumen does not show its entry: "the higher end" is wrong on every colon, "the wider
end" and "the end from which a scope gets farther" are wrong or tied on some. The organ decides.
Where it is not known, both ends are tried.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..anatomy.frame import find_axis
from ..anatomy.labels import find_centres
from ..anatomy.tract import Finding, LabelTract, Opening, SurfaceTract, name_place
from ..checks import check_points
from ..duct import Centreline, LumenTree, SampledField, find_centreline
from ..duct.field import INFLATION_MAX
from ..duct.groups import CREST_AHEAD, CREST_NEXT
from ..errors import GeometryError, InputError
from ..motion import Plan
from ..progress import Progress, no_progress
from ..results import Json

__all__ = [
    "CandidateEnd",
    "OrientedCentreline",
    "Place",
    "find_introducer_crossing",
    "list_branches",
    "measure_gap",
    "name_landmarks",
    "orient_centreline",
    "resolve_places",
    "turn_centreline",
]

Tract = LabelTract | SurfaceTract
Point = NDArray[np.float64]
End = ArrayLike | int | str | None
"""An end of the centreline: a point (3,) [mm], a label (number or name), the name of a landmark or
of an opening, ``"largest-opening"``, or None to find it."""

TREES = ("airway", "vessel")
"""Organs that branch: a way is sought in all their branches, from the widest end."""

ENTRY_LANDMARKS = {
    "colon": re.compile(r"\b(anus|anal)\b"),
    "upper-tract": re.compile(r"\b(mouth|incisors?)\b|pharyn(x|geal)"),
    "small-bowel": re.compile(r"\b(gastro-?duodenal|pylor(us|ic))\b"),
}
"""What the name of a landmark at the entry of an organ contains, as words."""

OPENING_RADIUS = 3.0
"""A smaller opening is not taken for an end of the tract [mm]."""

OPENING_REACH = 25.0
"""An opening this near to an end that was found is that end [mm], or within two radii of it."""

LANDMARK_REACH = 25.0
"""A landmark may lie this far outside the lumen [mm]."""

SIZE_SHARE, OPENING_SHARE = 0.25, 0.04
"""These reaches, and `OPENING_RADIUS`, are no more than these shares of a tract's longest side."""


USUAL_REACH = 2.5
"""The widest place within so many radii of an end is how wide it is."""


def find_reach(tract: Tract, most: float, share: float = SIZE_SHARE) -> float:
    """Return a length that is `most` [mm] in an organ, and less in a small tract."""
    if isinstance(tract, SurfaceTract):
        sides = np.ptp(tract.vertices, axis=0)
    else:
        sides = np.array(tract.labels.shape) * tract.spacing
    return min(most, share * float(sides.max()))


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """A place that was named: a point, or the voxels of a label.

    Attributes
    ----------
    name : str
        For people.
    given : list of float, int or str
        What was given, as JSON-able values.
    kind : {"point", "label", "landmark", "opening"}
    points : ndarray
        One point (3,), or the centres of voxels (k, 3); world frame [mm].
    radius : float
        Of an opening [mm], else 0.
    """

    name: str
    given: list[float] | int | str
    kind: Literal["point", "label", "landmark", "opening"]
    points: Point
    radius: float = 0.0


@dataclass(frozen=True, kw_only=True)
class CandidateEnd:
    """A place of the tract where a centreline could begin or end.

    Attributes
    ----------
    kind : {"end", "opening", "landmark"}
        An end of the lumen that was found, an opening of the file's surface, or a named place.
    name : str
    point : tuple of float
        World frame [mm].
    role : {"entry", "goal", ""}
        What it was taken for.
    radius : float or None
        Of an opening [mm].
    length : float or None
        Of the centreline from its opposite end to here, for an end that was not taken [mm].
    """

    kind: Literal["end", "opening", "landmark"]
    name: str
    point: tuple[float, float, float]
    role: Literal["entry", "goal", ""] = ""
    radius: float | None = None
    length: float | None = None

    def describe(self) -> Json:
        """Return JSON-able values."""
        return {
            "kind": self.kind,
            "name": self.name,
            "point_mm": [round(value, 3) for value in self.point],
            "role": self.role,
            "radius_mm": self.radius,
            "length_mm": self.length,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientedCentreline:
    """A centreline from the entry on, and how that entry was chosen.

    Attributes
    ----------
    line : Centreline
    basis : str
        Why this end is the entry, in words.
    decided : bool
        Whether that is known; otherwise the other end may be the entry as well.
    goal : str
        The name of its end: of an opening or of what was given, else ``"the far end"``.
    candidates : tuple of CandidateEnd
    findings : tuple of Finding
    given : bool
        Whether an end was given; else the centreline is to lead through the whole lumen.
    goal_given : bool
        Whether the goal was given: then what lies beyond it is left out on purpose.
    """

    line: Centreline
    basis: str
    decided: bool
    goal: str
    candidates: tuple[CandidateEnd, ...]
    findings: tuple[Finding, ...] = ()
    given: bool = False
    goal_given: bool = False


def resolve_places(
    tract: Tract, start: End, end: End, via: Sequence[End] = ()
) -> tuple[Place | None, Place | None, tuple[Place, ...]]:
    """Turn what was given into places, before any long work.

    Raises
    ------
    InputError
        If a name, label or point is none of the tract's; the legal ones are named.
    GeometryError
        If a place lies far outside the lumen.
    """
    stops = tuple(filter(None, (_resolve(tract, "via", chosen) for chosen in via)))
    first, last = _resolve(tract, "start", start), _resolve(tract, "end", end)
    named = [("start", first), ("end", last), *(("via", place) for place in stops)]
    for option, place in named:
        if place is not None and place.kind != "label":
            _check_near(tract, option, place)
    return first, last, stops


def orient_centreline(
    tract: Tract,
    field: SampledField,
    places: tuple[Place | None, Place | None, tuple[Place, ...]],
    *,
    reverse: bool = False,
    progress: Progress = no_progress,
) -> OrientedCentreline:
    """Find the centreline of a tract, from the end that is its entry to the other.

    The entry is what was given; else the organ's: a colon is entered from its lower end, every
    other organ from its higher one, in the axes of the patient, or at a landmark that marks the
    entry. Of an unknown organ the higher end is taken, and the result is marked as not decided.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    field : SampledField
        Its distance field.
    places : tuple
        As `resolve_places` returns them.
    reverse : bool
        Enter at the other end.
    progress : Progress
    """
    start, end, _ = places
    line = _find_line(tract, field, places, progress)
    findings: tuple[Finding, ...] = ()
    basis, decided = "it was given", True
    if start is None and end is None:
        line, basis, decided, assumed = _orient(tract, line)
        if assumed:
            message = (
                f"which end is the {assumed} one was judged with +z to the patient's head: the "
                "file does not state its axes; give --frame"
            )
            findings = (Finding("frame-assumed", "warning", message),)
    elif start is None:
        basis = "it is the far end from the end that was given"
    if reverse:
        line, basis = line.reverse(), f"reversed ({basis})"
    goal = start if reverse else end
    candidates = _list_candidates(tract, line)
    return OrientedCentreline(
        line=line,
        basis=basis,
        decided=decided,
        goal=_name_goal(candidates) if goal is None else f"the given end ({goal.name})",
        candidates=candidates,
        findings=(*findings, *list_branches(line)),
        given=start is not None or end is not None,
        goal_given=goal is not None,
    )


def _find_line(
    tract: Tract,
    field: SampledField,
    places: tuple[Place | None, Place | None, tuple[Place, ...]],
    progress: Progress,
) -> Centreline:
    """Return the centreline between the given places, or between the ends that are found."""
    *ends, via = places
    points: list[Point | None] = [None, None]
    regions: list[Point | None] = [None, None]
    named: dict[int, Place] = {}
    if not any(ends) and not via:
        points = list(_find_two_openings(tract, field) or points)
    for k, place in enumerate(ends):
        if place is None:
            continue
        if place.kind == "label":
            regions[k] = place.points
        elif place.kind == "point":
            points[k] = place.points
        else:
            named[k] = place
    if named:
        found, whole = _find_named_ends(tract, field, named)
        for k, point in found.items():
            points[k] = point
        if (
            whole is not None
            and not via
            and all(k in named or not place for k, place in enumerate(ends))
        ):
            return whole
    stops = [p.points if p.kind == "label" else _step_inside(field, p) for p in via]
    return find_centreline(
        field, (points[0], points[1]), regions=(regions[0], regions[1]), via=stops,
        progress=progress,
    )  # fmt: skip


def find_introducer_crossing(
    field: SampledField, plan: Plan, start: Place | None
) -> tuple[Finding, ...]:
    """Return a warning if the introducer goes through the wall elsewhere than at the entry.

    Rays along it are sampled in the lumen before inflation; each may leave it once. An entry that
    was given must lie at an end of the lumen.
    """
    tube = plan.get_introducer()
    rest = field.inflate(-field.inflation)
    step = 0.5 * float(rest.spacing.min())
    box = np.array(rest.values.shape) * rest.spacing
    along = np.arange(0.0, float(np.linalg.norm(box)) + step, step)
    side = np.linalg.svd(tube.outward[None])[2][1:]
    sides = np.concatenate([np.zeros((1, 3)), 0.5 * tube.bore * side, -0.5 * tube.bore * side])
    rays = tube.entry + sides[:, None] + along[:, None] * tube.outward
    grid = rest.to_grid(rays)
    inside = np.asarray(((grid >= 0.0) & (grid <= box - rest.spacing)).all(axis=2))
    inside[inside] = rest.signed_distance(rays[inside]) < 0.0
    crossing: tuple[str, Point] | None = None
    for ray, filled in zip(rays, inside, strict=True):
        left = int(np.argmin(filled)) if not filled.all() else len(filled)
        again = np.flatnonzero(filled[left:])
        if len(again) > 1:  # not by a corner of the wall alone
            crossing = ("lumen of the tract again", ray[left + again[0]])
            break
    if crossing is None and start is not None:
        beyond = _measure_behind(rest, plan, tube.entry, tip=start.kind == "label")
        if beyond > 0.0:
            what = f"the wall of lumen that goes on for {beyond:.0f} mm or more behind the entry,"
            crossing = (what, rays[0, int(np.argmin(inside[0]))])
    if crossing is None:
        return ()
    message = (
        f"the introducer, a straight tube outwards from the entry, crosses {crossing[0]} at "
        f"{name_place(crossing[1])} mm; the part of the scope in it is not checked"
    )
    return (Finding("introducer-crosses", "warning", message),)


def _measure_behind(rest: SampledField, plan: Plan, entry: Point, *, tip: bool) -> float:
    """Return how far lumen goes on from an entry otherwise than along the path [mm]; 0 at an end.

    That is lumen which a ball of 1.3 radii about the entry parts from the path, as far as it
    reaches one radius out of the ball. An entry found in a label may have a tip behind it, see
    `bozzini.duct.find_centreline`.
    """
    from scipy import ndimage

    spacing = rest.spacing
    depth = -rest.signed_distance(plan.path)
    usual = float(np.median(depth))
    near = depth[plan.path_arc_length <= USUAL_REACH * usual]
    radius = float(max(near.max(), spacing.max()))
    ball = 1.3 * radius
    most = ball + radius + 2.0 * float(spacing.max())
    if tip:
        crest = max(2.0 * radius, CREST_AHEAD * usual) + CREST_NEXT * usual
        most = max(most, crest + 2.0 * float(spacing.max()))
    half = np.ceil((most + radius) / spacing).astype(int)
    middle = np.rint(rest.to_grid(entry) / spacing).astype(int)
    low = np.maximum(middle - half, 0)
    high = np.minimum(middle + half + 1, rest.values.shape)
    box = rest.values[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] < 0.0
    nodes = (np.indices(box.shape).reshape(3, -1).T + low) * spacing
    distance = np.linalg.norm(nodes - rest.to_grid(entry), axis=1).reshape(box.shape)
    marks, _ = ndimage.label(box & (distance > ball))
    touching = np.unique(marks[distance <= ball + 1.8 * float(spacing.max())])
    away = np.linalg.norm(plan.path - entry, axis=1) > ball + float(spacing.max())
    on_path = np.rint(rest.to_grid(plan.path[away][:10]) / spacing).astype(int) - low
    on_path = on_path[((on_path >= 0) & (on_path < box.shape)).all(axis=1)]
    own = set(marks[tuple(on_path.T)].tolist()) | {0}
    others = [mark for mark in touching.tolist() if mark not in own and len(own) > 1]
    reach = max((float(distance[marks == mark].max()) for mark in others), default=0.0)
    return reach if reach > most else 0.0


def turn_centreline(tract: Tract, ends: OrientedCentreline) -> OrientedCentreline:
    """Return the same centreline, whose ends were found, from its other end."""
    line = ends.line.reverse()
    others = tuple(item for item in ends.findings if item.code != "branches")
    candidates = _list_candidates(tract, line)
    return replace(
        ends,
        line=line,
        goal=_name_goal(candidates),
        candidates=candidates,
        findings=(*others, *list_branches(line)),
    )


def _find_two_openings(tract: Tract, field: SampledField) -> tuple[Point, Point] | None:
    """Return the ends of a tract with two wide openings: such a file is clear about its ends."""
    least = find_reach(tract, OPENING_RADIUS, OPENING_SHARE)
    wide = [o for o in tract.openings if o.radius >= least]
    if len(wide) != 2:
        return None
    first, second = (_step_inside(field, _take_opening(opening)) for opening in wide)
    return first, second


def _find_named_ends(
    tract: Tract, field: SampledField, named: dict[int, Place]
) -> tuple[dict[int, Point], Centreline | None]:
    """Return a point in the lumen for landmarks and openings, by the numbers of their ends.

    A name at an end that is found without it means that end, and gives the same point. If all
    names are such ends, the centreline that was found is the second value.
    """
    line: Centreline | None = None
    own: Sequence[Point] = _find_two_openings(tract, field) or ()
    try:
        if not own:
            line = find_centreline(field)
            own = tuple(line.points[[0, -1]])
    except GeometryError:  # no tube: the name has to do alone
        pass
    gaps = {
        (k, n): float(np.linalg.norm(end - place.points))
        for k, place in named.items()
        for n, end in enumerate(own)
    }
    taken: dict[int, int] = {}
    for k, n in sorted(gaps, key=lambda pair: gaps[pair]):
        reach = find_reach(tract, OPENING_REACH if named[k].kind == "opening" else LANDMARK_REACH)
        if (
            k not in taken
            and n not in taken.values()
            and gaps[k, n] <= max(reach, 2.0 * named[k].radius)
        ):
            taken[k] = n
    found = {
        k: np.array(own[taken[k]]) if k in taken else _step_inside(field, place)
        for k, place in named.items()
    }
    if line is None or len(taken) < len(named):
        return found, None
    line = line if all(k == n for k, n in taken.items()) else line.reverse()
    open_ends = {name for k, name in enumerate(("start", "end")) if k not in named}
    others = tuple(other for other in line.other_ends if other.end in open_ends)
    return found, replace(line, other_ends=others)


def _check_near(tract: Tract, option: str, place: Place) -> None:
    """Raise `GeometryError` if a place is so far outside the lumen that no end can be there."""
    reach = max(find_reach(tract, LANDMARK_REACH), 2.0 * place.radius)
    reach = INFLATION_MAX if place.kind == "point" else reach
    gap = measure_gap(tract, place.points)
    if gap > reach:
        raise GeometryError(
            f"{option} is {place.name}, which lies outside the lumen by {gap:.0f} mm"
            f"{_explain_gap(tract)}: give a point inside it"
        )


def _explain_gap(tract: Tract) -> str:
    volume = sum(part.volume for part in tract.missing)
    return f" ({volume / 1000.0:.3g} mL of lumen are missing in the file)" if volume else ""


def measure_gap(tract: Tract, point: Point) -> float:
    """Return how far a point lies outside a lumen [mm], to half a voxel; 0 inside."""
    if isinstance(tract, SurfaceTract):
        import igl

        asked = np.ascontiguousarray(point[None])
        if float(igl.fast_winding_number(tract.vertices, tract.faces, asked)[0]) > 0.5:
            return 0.0
        boxes = igl.AABB()
        boxes.init(tract.vertices, tract.faces)
        squared = boxes.squared_distance(tract.vertices, tract.faces, asked)[0]
        return float(np.sqrt(np.ravel(squared)[0]))
    axes = tract.affine[:3, :3]
    index = np.rint(np.linalg.solve(axes, point - tract.affine[:3, 3])).astype(np.int64)
    inside = bool(((index >= 0) & (index < tract.labels.shape)).all())
    if inside and tract.labels[tuple(index)]:
        return 0.0
    gap = np.inf
    for k, layer in enumerate(tract.labels):  # one at a time: indices take much memory
        places = np.argwhere(layer) @ axes[:, 1:].T + (tract.affine[:3, 3] + k * axes[:, 0] - point)
        gap = min(gap, float((places**2).sum(axis=1).min(initial=np.inf)))
    return float(np.sqrt(gap))


def _name_goal(candidates: Sequence[CandidateEnd]) -> str:
    """Return what an end is called that was found: its opening, if it has one."""
    names = [c.name for c in candidates if c.kind == "opening" and c.role == "goal"]
    return names[0] if names else "the far end"


def name_landmarks(tract: Tract) -> dict[str, tuple[float, float, float]]:
    """Return the landmarks of a tract, each place once: by the first of its names."""
    named: dict[tuple[float, float, float], str] = {}
    for name, point in tract.landmarks.items():
        x, y, z = point
        named.setdefault((x, y, z), name)
    return {name: point for point, name in named.items()}


def _step_inside(field: SampledField, place: Place) -> Point:
    """Return a point in the lumen for a place that may lie on the wall: a cap, a landmark.

    It is the nearest node in line of sight that has about the opening's radius of clearance (at a
    landmark 5 mm, or less where the lumen is narrow); if none has, that with the most.
    """
    point = np.array(place.points, dtype=np.float64)
    if place.kind == "point":
        return point
    from scipy.spatial import cKDTree

    rest = field.inflate(-field.inflation)
    deepest = float(-rest.values.min())
    enough = 0.9 * place.radius if place.kind == "opening" else min(5.0, 0.8 * deepest)
    if -float(rest.signed_distance(point)) >= enough:
        return point
    nodes = rest.to_world(np.argwhere(rest.values < 0.0) * rest.spacing)
    tree = cKDTree(nodes)
    _, nearest = tree.query(point)
    first = nodes[nearest]
    near = nodes[tree.query_ball_point(first, 2.0 * enough)]
    near = near[np.argsort(np.linalg.norm(near - first, axis=1), kind="stable")]
    clearance = -rest.signed_distance(near)
    share = np.linspace(0.0, 1.0, 21)[:, None, None]
    seen = (rest.signed_distance(first + share * (near - first)) < 0.0).all(axis=0)
    wide = np.flatnonzero(seen & (clearance >= enough))
    return np.asarray(
        near[wide[0]] if len(wide) else near[np.argmax(np.where(seen, clearance, 0.0))]
    )


def find_entry(tract: Tract, tree: LumenTree) -> tuple[Place, str]:
    """Return the root of a tree as the place of an entry, and why it is that."""
    point = tree.branches[0].points[0]
    basis = f"{_article(tract.organ or 'tree')} is entered at its widest end"
    return Place(name="the widest end", given=point.tolist(), kind="point", points=point), basis


def choose_branch(
    tract: Tract, tree: LumenTree, branch: str | None, *, start: Place | None
) -> OrientedCentreline:
    """Return the way from the root of a tree to the end of a branch, by default the farthest end.

    Raises
    ------
    InputError
        If the tree has no such branch.
    """
    findings: tuple[Finding, ...] = ()
    if branch is None:
        branch = tree.branches[max(tree.tips, key=lambda tip: tree.path(tip).length)].name
        message = (
            f"the lumen branches: the way is that to its farthest end, branch {branch}; give "
            "--branch to choose, 'bozzini tree' lists them, 'bozzini reach' tries all"
        )
        findings = (Finding("branches", "warning", message),)
    line = tree.path(branch)
    return OrientedCentreline(
        line=line,
        basis="it was given" if start else find_entry(tract, tree)[1],
        decided=True,
        goal=f"the end of branch {branch}",
        candidates=_list_candidates(tract, line),
        findings=findings,
        given=True,
        goal_given=True,
    )


def find_root(field: SampledField, place: Place) -> Point:
    """Return a point in the lumen for the root of a tree: of a label the place with most room."""
    if place.kind != "label":
        return _step_inside(field, place)
    return np.asarray(place.points[np.argmin(field.signed_distance(place.points))])


def _orient(tract: Tract, line: Centreline) -> tuple[Centreline, str, bool, str]:
    """Turn a line so that it begins at the organ's entry.

    Returns the line, why, whether that is known, and "lower", "higher" or "rear" where a frame had
    to be assumed for it. Rear is the end nearer to the patient's back, of a colon whose ends are
    about level.
    """
    ends = line.points[[0, -1]]
    organ = tract.organ or _guess_organ(tract)
    for name, place in tract.landmarks.items():
        if organ in ENTRY_LANDMARKS and _marks_entry(name, organ):
            gaps = np.linalg.norm(ends - np.array(place), axis=1)
            turned = line.reverse() if gaps[1] < gaps[0] else line
            return turned, f"the landmark '{name}' marks the entry of the {organ}", True, ""
    head = find_axis(tract.frame or "RAS", "S")
    heights = ends @ head
    which = "lower" if organ == "colon" else "higher"
    if organ == "colon" and abs(heights[0] - heights[1]) < 0.1 * np.ptp(line.points @ head):
        # About level: the rectum lies in front of the sacrum, behind everything else.
        which, heights = "rear", ends @ find_axis(tract.frame or "RAS", "P")
    first = int(np.argmin(heights)) if which == "lower" else int(np.argmax(heights))
    turned = line.reverse() if first == 1 else line
    if organ is None:
        return turned, "the organ is not known: the higher end", False, ""
    named = {"lower": "lower", "higher": "higher", "rear": "rear (both are about level)"}[which]
    return (
        turned,
        f"{_article(organ)} is entered at its {named} end",
        True,
        which if tract.frame is None else "",
    )


def _article(organ: str) -> str:
    name = organ.replace("-", " ")
    return f"an {name}" if name.startswith(("upper", "airway")) else f"a {name}"


def _guess_organ(tract: Tract) -> str | None:
    """Return the organ whose entry is among the landmarks, if that is only one."""
    found = [
        organ
        for organ in ENTRY_LANDMARKS
        if any(_marks_entry(name, organ) for name in tract.landmarks)
    ]
    return found[0] if len(found) == 1 else None


def _marks_entry(name: str, organ: str) -> bool:
    return bool(ENTRY_LANDMARKS[organ].search(name.lower().replace("_", " ")))


def _list_candidates(tract: Tract, line: Centreline) -> tuple[CandidateEnd, ...]:
    """Return the two ends of the line, the others that were found, openings and landmarks."""
    found: list[CandidateEnd] = []
    openings = sorted(tract.openings, key=lambda opening: -opening.radius)
    reach = find_reach(tract, OPENING_REACH)
    roles: dict[str, Literal["entry", "goal"]] = {}
    ends: tuple[tuple[Literal["entry", "goal"], int], ...] = (("entry", 0), ("goal", -1))
    for role, at in ends:
        point = line.points[at]
        near = [
            (float(np.linalg.norm(point - np.array(o.point))), o.name)
            for o in openings
            if o.name not in roles
            and np.linalg.norm(point - np.array(o.point)) <= max(reach, 2.0 * o.radius)
        ]
        if near:
            roles[min(near)[1]] = role
        x, y, z = (float(v) for v in point)
        name = f"{role}, at the opening '{min(near)[1]}'" if near else role
        found.append(CandidateEnd(kind="end", name=name, point=(x, y, z), role=role))
    found += [
        CandidateEnd(
            kind="end",
            name=f"further end, could be the {'entry' if other.end == 'start' else 'goal'}",
            point=other.point,
            length=other.distance,
        )
        for other in line.other_ends
    ]
    found += [
        CandidateEnd(
            kind="opening", name=o.name, point=o.point, role=roles.get(o.name, ""), radius=o.radius
        )
        for o in openings
    ]
    found += [
        CandidateEnd(kind="landmark", name=name, point=place)
        for name, place in name_landmarks(tract).items()
    ]
    return tuple(found)


MOST_BRANCHES = 3
"""Other ends that have a warning each."""


def list_branches(line: Centreline) -> tuple[Finding, ...]:
    """Return a warning for other ends that the centreline could have had, and one for the rest."""
    found = []
    for other in line.other_ends[:MOST_BRANCHES]:
        place = ", ".join(f"{value:.0f}" for value in other.point)
        opposite = "start" if other.end == "end" else "end"
        message = (
            f"another end was found near ({place}) mm, about {other.distance:.0f} mm of centreline "
            f"from the {opposite}: give --{other.end} to choose; 'bozzini tree' lists all branches"
        )
        found.append(Finding("branches", "warning", message))
    if (more := len(line.other_ends) - MOST_BRANCHES) > 0:
        message = f"{more} more {'end was' if more == 1 else 'ends were'} found: see 'bozzini tree'"
        found.append(Finding("branches", "warning", message))
    return tuple(found)


def _resolve(tract: Tract, option: str, chosen: End) -> Place | None:
    if chosen is None:
        return None
    if isinstance(chosen, (bool, np.bool_)):
        raise InputError(
            f"{option} is {bool(chosen)}: it must be a point (x, y, z) in mm, a name, or the "
            "number of a label"
        )
    if isinstance(chosen, Integral):
        return _find_label(tract, option, int(chosen))
    if isinstance(chosen, str):
        return _find_name(tract, option, chosen)
    point = check_points(option, chosen)
    if point.shape != (3,):
        raise InputError(f"{option} has shape {point.shape}: it must be (3,)")
    place = ", ".join(f"{value:g}" for value in point)
    return Place(name=f"({place}) mm", given=point.tolist(), kind="point", points=point)


def _find_label(tract: Tract, option: str, label: int) -> Place:
    if not isinstance(tract, LabelTract):
        raise InputError(f"{option} is label {label}, but a surface has no labels: give a point")
    there = tract.label_values
    if label not in there:
        raise InputError(
            f"{option} is label {label}, which is not in the lumen: it must be one of "
            f"{', '.join(str(v) for v in there)}"
        )
    centres = find_centres(tract.labels == label, tract.affine)
    named = tract.label_names.get(label)
    name = f"label {label}" + (f", {named}" if named else "")
    return Place(name=name, given=label, kind="label", points=centres)


def _find_name(tract: Tract, option: str, chosen: str) -> Place:
    wanted = " ".join(chosen.split()).lower()
    if isinstance(tract, LabelTract):
        for label, name in tract.label_names.items():
            if name.lower() == wanted and label in tract.label_values:
                place = _find_label(tract, option, label)
                return Place(name=place.name, given=name, kind="label", points=place.points)
    for name, point in tract.landmarks.items():
        if name.lower() == wanted:
            return Place(
                name=f"landmark '{name}'", given=name, kind="landmark", points=np.array(point)
            )
    openings = sorted(tract.openings, key=lambda opening: -opening.radius)
    for k, opening in enumerate(openings):
        if opening.name.lower() == wanted or (k == 0 and wanted == "largest-opening"):
            return _take_opening(opening)
    raise InputError(
        f"{option} is '{chosen}', which names nothing in this tract: it must be a point "
        f"x,y,z{_list_names(tract)}"
    )


def _take_opening(opening: Opening) -> Place:
    return Place(
        name=f"opening '{opening.name}'",
        given=opening.name,
        kind="opening",
        points=np.array(opening.point),
        radius=opening.radius,
    )


def _list_names(tract: Tract, most: int = 12) -> str:
    """Return the names that an end may have, as what follows "a point x,y,z"."""
    names: list[str] = []
    if isinstance(tract, LabelTract):
        for label in tract.label_values:
            named = tract.label_names.get(label)
            if named or len(tract.label_values) > 1:  # else it is the whole lumen
                names.append(f"{label} ({named})" if named else f"{label}")
    names += [f"'{name}'" for name in name_landmarks(tract)]
    if tract.openings:
        names += ["'largest-opening'", *(f"'{opening.name}'" for opening in tract.openings)]
    if not names:
        return "; it has no labels, landmarks or openings"
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f", or one of {', '.join(names[:most])}{more}"
