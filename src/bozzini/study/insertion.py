"""The main job in one call: tract -> field -> centreline -> plan, and the directory it writes."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
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
from ..duct import Centreline, SampledField, build_field, find_centreline
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
from ..progress import Progress, no_progress
from ._inputs import End, check_options, describe_end, explain_scale, find_branches, sort_ends
from ._robot import find_robot_trouble, write_robot

__all__ = ["InsertionStudy", "run_insertion"]


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionStudy:
    """Everything from one run of the main job.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    field : SampledField
        The lumen.
    line : Centreline
        The path of the head.
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
    """

    tract: LabelTract | SurfaceTract
    field: SampledField
    line: Centreline
    plan: Plan
    seconds: dict[str, float]
    passage: Passage | None = None
    largest: Largest | None = None
    comparison: tuple[Plan, ...] = ()
    robot: Actuation | None = None
    findings: tuple[Finding, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether the scope, or the robot if there is one, is proved to reach the end clear."""
        if self.robot is not None:
            return self.plan.status == "complete" and self.robot.fits
        return self.plan.status == "complete" and bool(self.plan.meta["certified"])

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
        progress: Progress = no_progress,
    ) -> dict[str, Any]:
        """Write plan.npz, scene.glb, report.html, picture.png and summary.json.

        With a robot also tendons.csv, tendons.parquet if ``pyarrow`` is there, robot.npz and
        robot.png. Nothing is left behind if any of them fails.

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
            summary = self.summarise()
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
    reverse: bool = False,
    voxel: float | None = None,
    inflate: float = 0.0,
    method: str = "tube",
    head_step: float = 0.25,
    slip: float = 0.0,
    angle_limit: float | None = None,
    route: Sequence[float] = (1.0,),
    soft_wall: float = 0.0,
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
    start, end : (3,) float, int or None
        Ends of the centreline: a point in the world frame [mm], a label (the end lies in it), or
        None to find it. See `bozzini.duct.find_centreline`.
    reverse : bool
        Insert from the other end.
    voxel, inflate : float
        See `bozzini.duct.build_field`.
    method, head_step, slip, angle_limit, route
        See `bozzini.motion.plan_insertion`.
    soft_wall : float
        See `bozzini.motion.plan_with_soft_wall` [mm].
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
    )
    points, regions = sort_ends(tract, start, end)
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
            line = find_centreline(field, points, regions=regions, progress=progress)
            if reverse:
                line = line.reverse()
        with _clock(times, "plan"):
            plan = plan_with_soft_wall(
                field,
                line,
                scope=scope,
                soft_wall=soft_wall,
                method=method,
                progress=progress,
                **options,
            )
    findings = (*tract.findings, *find_branches(line))
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
            for other in METHODS:
                plain = {"head_step": head_step} if other == "thesis" else options
                comparison.append(plan_insertion(field, line, scope=scope, method=other, **plain))
                progress("compare", len(comparison) / len(METHODS))
    given: dict[str, Any] = {"source": tract.source, **(inputs or {})}
    for name, chosen in (("start", start), ("end", end)):
        if chosen is not None:
            given[name] = describe_end(chosen)
    meta = {
        **plan.meta,
        "input": given,
        "findings": [f"{item.severity}: {item.message}" for item in findings],
        "centreline": {
            "points_mm": np.round(line.points, 3).tolist(),
            "arc_length_mm": np.round(line.arc_length, 3).tolist(),
            "radius_mm": np.round(line.radius, 3).tolist(),
        },
    }
    return InsertionStudy(
        tract=tract,
        field=field,
        line=line,
        plan=replace(plan, meta=meta),
        seconds=times,
        passage=passage,
        largest=found,
        comparison=tuple(comparison),
        robot=moved,
        findings=findings,
    )


@contextmanager
def _clock(times: dict[str, float], stage: str) -> Iterator[None]:
    begin = time.perf_counter()
    yield
    times[stage] = time.perf_counter() - begin
