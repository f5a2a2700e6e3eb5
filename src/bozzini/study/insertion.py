"""The main job in one call: tract -> field -> centreline -> plan, and the directory it writes."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..anatomy.findings import Finding
from ..anatomy.tract import LabelTract, SurfaceTract
from ..continuum import ContinuumRobot
from ..continuum.actuate import actuate_plan
from ..continuum.actuation import Actuation
from ..duct import Centreline, SampledField, build_field
from ..duct.refined import RefinedField, refine_field
from ..files import new_directory, write_text
from ..motion import (
    METHODS,
    Largest,
    Passage,
    Plan,
    Scope,
    TubeOptions,
    find_largest,
    find_passage,
    plan_insertion,
    plan_with_soft_wall,
)
from ..motion.refusal import floor_mm
from ..progress import Progress, no_progress
from ._robot import find_robot_trouble, write_robot
from .ends import End, Way, find_introducer_crossing, find_way, resolve_places, turn_way
from .exports import write_centreline, write_volumes
from .inputs import check_options, explain_scale
from .reach import Unreached, find_unreached

__all__ = ["InsertionStudy", "run_insertion"]


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionStudy:
    """Everything from one run of the main job.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    field : SampledField
        The lumen.
    way : Way
        The way that is planned: its centreline, and how its ends were chosen.
    plan : Plan
        The motion.
    seconds : dict
        Wall-clock time by stage [s].
    passage : Passage, optional
        The widest way through.
    largest : Largest, optional
        The largest scope that fits, if it was asked for.
    comparison : tuple of Plan
        Plans of every method, if they were asked for.
    robot : Actuation, optional
        What a tendon robot is told to go this way, if one was given.
    findings : tuple of Finding
        What the checks of the tract found, and what finding the centreline did.
    unreached : tuple of Unreached
        Parts of the lumen that the way does not reach, largest first.
    entries : tuple of dict
        Of an organ that is not known: what came of entering at either end, the better one first.
    label_error : float, optional
        How far the labels or the surface may be from the true wall, as the user states it [mm].
    """

    tract: LabelTract | SurfaceTract
    field: SampledField
    way: Way
    plan: Plan
    seconds: dict[str, float]
    passage: Passage | None = None
    largest: Largest | None = None
    comparison: tuple[Plan, ...] = ()
    robot: Actuation | None = None
    findings: tuple[Finding, ...] = ()
    unreached: tuple[Unreached, ...] = ()
    entries: tuple[dict[str, Any], ...] = ()
    label_error: float | None = None

    @property
    def line(self) -> Centreline:
        """The centreline from the entry to the goal."""
        return self.way.line

    @property
    def fits(self) -> bool:
        """Whether the scope, or the robot if there is one, is proved to reach the end clear.

        That is the end which the user can see: given, or of the whole lumen. Where no end was
        given and a large part of the lumen is closed off from the way or beyond it, that is False.
        With a stated label error also whether the proof covers it.
        """
        if not self.way.given and any(part.stated and part.cut_off for part in self.unreached):
            return False
        if not self._covers_label_error():
            return False
        if self.robot is not None:
            return self.plan.status == "complete" and self.robot.fits
        return self.plan.status == "complete" and bool(self.plan.meta["certified"])

    def _covers_label_error(self) -> bool:
        if self.label_error is None:
            return True
        proof = self.plan.meta.get("certificate") or {}
        return bool(self.plan.meta["certified"]) and proof["clearance_mm"] >= self.label_error

    def summarise(self) -> dict[str, Any]:
        """Return the summary: what ``--json`` prints and ``summary.json`` holds."""
        from .summary import summarise_plan

        summary = summarise_plan(self.plan, self.field, self.line)
        summary["fits"] = self.fits
        if self.passage is not None:
            bound = self.passage.bound
            summary["passage_mm"] = bound if np.isfinite(bound) else None
            summary["passage_found_mm"] = max(self.passage.level, 0.0)
        if self.largest is not None:
            summary["largest"] = self.largest.describe()
        if self.comparison:
            summary["comparison"] = [
                summarise_plan(plan, self.field, self.line) for plan in self.comparison
            ]
        if self.robot is not None:
            summary["robot"] = self.robot.summarise()
        summary |= {
            "organ": self.tract.organ,
            "frame": self.tract.frame,
            "entry": {
                "point_mm": np.round(self.line.points[0], 3).tolist(),
                "basis": self.way.basis,
            },
            "goal": {
                "point_mm": np.round(self.line.points[-1], 3).tolist(),
                "name": self.way.goal,
                "given": self.way.given,
                "chosen": self.way.goal_given,
            },
            "ends": [candidate.describe() for candidate in self.way.candidates],
            "unreached": [part.describe() for part in self.unreached],
            "label_error_mm": self.label_error,
        }
        if self.entries:
            summary["entries"] = list(self.entries)
        summary["findings"] = [
            {"code": item.code, "severity": item.severity, "message": item.message}
            for item in self.findings
        ]
        summary["seconds"] = {key: round(value, 4) for key, value in self.seconds.items()}
        return summary

    def write(
        self,
        directory: str | os.PathLike[str],
        *,
        force: bool = False,
        export: bool = False,
        progress: Progress = no_progress,
    ) -> dict[str, Any]:
        """Write the plan, the report, pictures, the scene, the centreline and the summary.

        These are plan.npz, report.html, picture.png, scene.glb, summary.json, centreline.mrk.json
        (3D Slicer) and centreline.vtp (VTK). With a robot also tendons.csv, tendons.parquet if
        ``pyarrow`` is there, robot.npz and robot.png; with `export` the distance field and the
        lumen as volumes, field.nii.gz and labels.nii.gz. Nothing is left behind if any of them
        fails.

        Returns
        -------
        dict
            The summary that was written.

        Raises
        ------
        OutputError
            If the directory exists (without `force`) or cannot be written.
        """
        from ..view import draw_overview, write_report, write_scene

        with new_directory(directory, force=force) as folder:
            progress("report", 0.0)
            self.plan.save(folder / "plan.npz")
            for other in self.comparison:
                other.save(folder / f"plan-{other.method}.npz")
            if self.robot is not None:
                write_robot(self.robot, folder)
            frame = self.tract.frame or "RAS"
            write_centreline(self.line, folder, frame=frame)
            if export:
                with _clock(self.seconds, "export"):
                    write_volumes(self.field, self.tract, folder, frame=frame)
            progress("report", 0.2)
            with _clock(self.seconds, "scene"):
                write_scene(
                    folder / "scene.glb",
                    surface=self._draw_surface(),
                    joints=self._draw_joints(),
                    diameter=self._draw_diameter(),
                    path=self.plan.path,
                    title=f"Insertion: {Path(self.tract.source).name}",
                )
            progress("report", 0.6)
            with _clock(self.seconds, "report"):
                draw_overview(self.plan, self.field, path=folder / "picture.png")
                write_report(
                    folder / "report.html",
                    plan=self.plan,
                    field=self.field,
                    summary=self.summarise(),
                    findings=self.findings,
                    comparison=self.comparison,
                )
            progress("report", 1.0)
            self.seconds["total"] = sum(v for k, v in self.seconds.items() if k != "total")
            # The names are what --force may remove later, see `bozzini.files.new_directory`.
            files = [path for path in folder.rglob("*") if path.is_file()]
            names = {path.relative_to(folder).as_posix() for path in files} | {"summary.json"}
            summary = self.summarise() | {"files": sorted(names)}
            text = json.dumps(summary, indent=2, allow_nan=False)
            write_text(folder / "summary.json", text + "\n")
        return summary

    def _draw_joints(self) -> NDArray[np.float64]:
        """Return the body to look at: the robot's arcs, or the scope's chain."""
        if self.robot is None:
            return self.plan.joints
        return self.robot.place_body(np.arange(self.robot.steps), pitch=5.0)

    def _draw_diameter(self) -> float:
        if self.robot is None:
            return float(self.plan.meta["scope"]["diameter_mm"])
        return 2.0 * self.robot.robot.radius

    def _draw_surface(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the wall to look at: the surface itself, or the level set of the field."""
        if isinstance(self.tract, SurfaceTract) and self.field.inflation == 0.0:
            return self.tract.vertices, self.tract.faces
        from skimage.measure import marching_cubes

        vertices, faces, _, _ = marching_cubes(
            self.field.values, level=self.field.inflation, spacing=tuple(self.field.spacing)
        )
        outward = faces if np.linalg.det(self.field.rotation) > 0.0 else faces[:, ::-1]
        return self.field.to_world(vertices), np.asarray(outward, dtype=np.int64)


def run_insertion(
    tract: LabelTract | SurfaceTract,
    *,
    scope: Scope,
    start: End = None,
    end: End = None,
    via: Sequence[End] = (),
    reverse: bool = False,
    voxel: float | None = None,
    inflate: float = 0.0,
    method: str = "best",
    head_step: float = 0.25,
    slip: float = 0.0,
    angle_limit: float | None = None,
    route: Sequence[float] = (1.0,),
    soft_wall: float = 0.0,
    label_error: float | None = None,
    largest: bool = False,
    compare: bool = False,
    robot: ContinuumRobot | None = None,
    inputs: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    progress: Progress = no_progress,
) -> InsertionStudy:
    """Run the main job: sample the lumen, find its centreline, plan the insertion.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        What `bozzini.anatomy.read_tract` or `make_phantom` gives.
    scope : Scope
    start, end : (3,) float, int, str or None
        Ends of the way: a point in the world frame [mm], a label by number or name (the end lies
        in it), the name of a landmark or of an opening of the tract, ``"largest-opening"``, or
        None to find it. Where neither is given the organ of the tract says which end is the
        entry; of an unknown organ both are tried, and the one is taken from which the scope gets
        farther, or with more clearance proved.
    via : sequence
        Places that the way goes through, in this order; each as `start`.
    reverse : bool
        Insert from the other end.
    voxel, inflate : float
        See `bozzini.duct.build_field`.
    method, head_step, slip, angle_limit, route
        See `bozzini.motion.plan_insertion`.
    soft_wall : float
        See `bozzini.motion.plan_with_soft_wall` [mm].
    label_error : float, optional
        How far the given wall may be from the true one [mm]: the result states whether the proof
        covers it.
    largest : bool
        Also find the largest diameter and the longest link that fit.
    compare : bool
        Also plan by every other method, for comparison.
    robot : ContinuumRobot, optional
        A tendon robot that goes the planned way; see `bozzini.continuum.actuate_plan`.
    inputs : mapping, optional
        What the tract was read from, kept in the plan.
    seconds : mapping, optional
        Times of earlier stages, kept.
    progress : Progress

    Raises
    ------
    BozziniError
        If an input is not legal; a scope that does not fit is a result, not an error.
    """
    times = dict(seconds or {})
    check_options(
        scope=scope,
        voxel=voxel,
        inflate=inflate,
        method=method,
        head_step=head_step,
        slip=slip,
        angle_limit=angle_limit,
        route=route,
        soft_wall=soft_wall,
        label_error=label_error,
    )
    places = resolve_places(tract, start, end, via)
    options: dict[str, Any] = {
        "head_step": head_step,
        "slip": slip,
        "angle_limit": angle_limit,
        "route": tuple(route),
    }
    with explain_scale(tract):
        with _clock(times, "distance"):
            field = build_field(
                tract, voxel=voxel, inflate=inflate, reach=inflate + soft_wall, progress=progress
            )
        with _clock(times, "centreline"):
            way = find_way(tract, field, places, reverse=reverse, progress=progress)

        def make_plan(along: Centreline, duct: SampledField | RefinedField = field) -> Plan:
            return plan_with_soft_wall(
                duct,  # type: ignore[arg-type]
                along,
                scope=scope,
                soft_wall=soft_wall,
                method=method,
                progress=progress,
                **options,
            )

        entries: tuple[dict[str, Any], ...] = ()
        with _clock(times, "plan"):
            if way.decided:
                plan = make_plan(way.line)
            else:
                way, plan, entries = _try_both_ends(tract, way, make_plan, reverse=reverse)
        line = way.line
        finer: tuple[Finding, ...] = ()
        if _may_profit(plan, field):
            with _clock(times, "refine"):
                # About the points that the plan states, so that the same nodes can be made again.
                points = _round(line.points)
                fine = refine_field(
                    field, tract, points, voxel=FINE, distance=CORRIDOR, progress=progress
                )
                plan, finer = _choose_finer(plan, make_plan(line, fine))
    with _clock(times, "unreached"):
        unreached = find_unreached(tract, field, line)
    crossing = find_introducer_crossing(field, plan, places[1] if reverse else places[0])
    findings = (*tract.findings, *way.findings, *_find_other_entry(entries), *finer, *crossing)
    moved = None
    if robot is not None:
        with _clock(times, "robot"):
            soft = plan.meta.get("soft_wall") or {}
            lumen = field.inflate(float(soft.get("used_mm", 0.0)))
            moved = actuate_plan(plan, robot, lumen, progress=progress)
        findings = (*findings, *find_robot_trouble(moved))
    with _clock(times, "passage"):
        passage = find_passage(field, line.points[0], line.points[-1])
    found = None
    if largest:
        with _clock(times, "largest"):
            found = find_largest(
                field,
                line,
                scope=scope,
                options=TubeOptions(
                    head_step=head_step,
                    freedom=0.0 if method == "follow" else 1.0,
                    slip=slip,
                    angle_limit=angle_limit,
                    route=tuple(route),
                ),
                progress=progress,
            )
    comparison: list[Plan] = []
    if compare:
        with _clock(times, "compare"):
            others = [name for name in METHODS if name != "best"]
            for other in others:
                plain = {"head_step": head_step} if other == "thesis" else options
                comparison.append(plan_insertion(field, line, scope=scope, method=other, **plain))
                progress("compare", len(comparison) / len(others))
    given: dict[str, Any] = {"source": tract.source, **(inputs or {})}
    for name, place in (("start", places[0]), ("end", places[1])):
        if place is not None:
            given[name] = place.given
    if places[2]:
        given["via"] = [place.given for place in places[2]]
    shared = {
        "input": given,
        "ends": [candidate.describe() for candidate in way.candidates],
        "findings": [f"{item.severity}: {item.message}" for item in findings],
        "centreline": {
            "points_mm": _round(line.points).tolist(),
            "arc_length_mm": np.round(line.arc_length, 3).tolist(),
            "radius_mm": np.round(line.radius, 3).tolist(),
        },
    }
    return InsertionStudy(
        tract=tract,
        field=field,
        way=way,
        plan=replace(plan, meta=plan.meta | shared),
        seconds=times,
        passage=passage,
        largest=found,
        comparison=tuple(replace(other, meta=other.meta | shared) for other in comparison),
        robot=moved,
        findings=findings,
        unreached=unreached,
        entries=entries,
        label_error=label_error,
    )


FINE, CORRIDOR = 0.5, 8.4
"""Spacing of a finer grid, and how far from the centreline it reaches [mm]."""

GRID_CODES = ("LINK_TOO_LONG", "CERTIFICATE_UNRESOLVED", "GOAL_CLEARANCE", "ENTRY_CLEARANCE")
"""Refusals that may be the grid's, not the lumen's. A proved one (NO_PASSAGE) is not."""


def _round(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(points, 3)


def _may_profit(plan: Plan, field: SampledField) -> bool:
    """Whether a plan fails by so little that a finer grid may show that it fits."""
    if plan.status == "complete" or plan.method == "thesis" or field.spacing.max() <= FINE:
        return False
    refusal = plan.meta.get("refusal") or {}
    if plan.reason_code not in GRID_CODES:
        return False
    lack = float(refusal.get("needs_mm", 0.0)) - float(refusal.get("offers_mm", 0.0))
    return plan.reason_code == "CERTIFICATE_UNRESOLVED" or lack <= field.error


def _choose_finer(plan: Plan, fine: Plan) -> tuple[Plan, tuple[Finding, ...]]:
    """Return the better of a plan and its repetition on a finer grid, and a note on that."""
    near = f"a grid of {FINE:g} mm within {CORRIDOR:g} mm of the centreline"
    if _is_better(fine, plan):
        grid = {**fine.meta["field"], "fine_spacing_mm": FINE, "fine_distance_mm": CORRIDOR}
        note = f"planned and proved on {near}: on the coarser one it ended: {plan.reason}"
        return replace(fine, meta={**fine.meta, "field": grid}), (
            Finding("finer-grid", "note", note),
        )
    note = f"tried again on {near}, which did not help"
    return plan, (Finding("finer-grid", "note", note),)


def _try_both_ends(
    tract: LabelTract | SurfaceTract,
    way: Way,
    make_plan: Callable[[Centreline], Plan],
    *,
    reverse: bool,
) -> tuple[Way, Plan, tuple[dict[str, Any], ...]]:
    """Plan from either end of a way; the better result, and both in short.

    Better is: fits, proved; else gets farther; else the larger certified clearance. Of equal
    results that of the higher end is taken, which comes first. With `reverse` it is the other one.
    """
    turned = turn_way(tract, way, way.basis)
    pair = [(way, make_plan(way.line)), (turned, make_plan(turned.line))]
    if reverse:
        pair.reverse()  # the way came reversed: the higher end first again
    (first, plan), (second, other) = pair
    if _is_better(other, plan):
        basis = "the organ is not known: the end from which the scope gets farther"
        pair = [(second, other), (first, plan)]
        if _judge(other)[:2] == _judge(plan)[:2]:
            basis = "the organ is not known: the end from which more clearance is proved"
    else:
        basis = "the organ is not known: both ends do alike, and this is the higher one"
        if _is_better(plan, other):
            basis = "the organ is not known: the end from which the scope does better"
    if reverse:
        pair.reverse()
        basis = f"reversed ({basis}, was the other one)"
    entries = tuple(
        {
            "point_mm": np.round(each.line.points[0], 3).tolist(),
            "status": result.status,
            "certified": bool(result.meta["certified"]),
            "clearance_certified_mm": result.meta["certificate"]["clearance_mm"]
            if result.meta["certified"]
            else None,
            "inserted_mm": result.inserted,
            "reason": result.reason,
        }
        for each, result in pair
    )
    chosen, plan = pair[0]
    return replace(chosen, basis=basis), plan, entries


def _judge(plan: Plan) -> tuple[bool, float, float]:
    certified = bool(plan.meta["certified"])
    clearance = plan.meta["certificate"]["clearance_mm"] if certified else None
    # A path along which links pass is a few mm longer or shorter from the one end or the other.
    inserted = np.inf if plan.status == "complete" else 10.0 * round(0.1 * plan.inserted)
    return (
        plan.status == "complete" and certified,
        inserted,
        round(-1.0 if clearance is None else clearance, 1),
    )


def _is_better(plan: Plan, other: Plan) -> bool:
    return _judge(plan) > _judge(other)


def _find_other_entry(entries: Sequence[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Return a warning that names both results where both ends were tried."""
    if not entries:
        return ()
    places, results = [], []
    for entry in entries:
        places.append(f"({', '.join(f'{value:.0f}' for value in entry['point_mm'])}) mm")
        proved = entry["clearance_certified_mm"]
        result = "reaches the other end" if entry["status"] == "complete" else "stops"
        result += f" after {entry['inserted_mm']:.0f} mm of the head's path"
        if proved is not None:
            result += f", {floor_mm(proved)} mm of clearance proved"
        elif entry["status"] == "complete":
            result += ", not proved"
        results.append(result)
    if results[0] == results[1]:
        text = f"the same from either end, {' or '.join(places)}: the scope {results[0]}"
    else:
        pairs = zip(places, results, strict=True)
        text = "; ".join(f"entered at {place} the scope {result}" for place, result in pairs)
    message = (
        f"the organ is not known, so both ends were tried: {text}. The first is reported here: "
        "give --organ, --start or --reverse to choose"
    )
    return (Finding("organ-unknown", "warning", message),)


@contextmanager
def _clock(times: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    times[stage] = time.perf_counter() - begin
