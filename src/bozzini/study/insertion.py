"""The main job in one call: tract -> field -> centreline -> plan, and the directory it writes."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..anatomy.files import encode_volume
from ..anatomy.polylines import format_curves
from ..anatomy.tract import Finding, LabelTract, SurfaceTract
from ..continuum import ContinuumRobot
from ..duct import Centreline, SampledField
from ..duct.field import RefinedField
from ..errors import PluginError
from ..io.files import has_parquet, new_directory, write_bytes, write_text
from ..io.vtp import format_polylines
from ..motion import (
    PLANNERS,
    Largest,
    Passage,
    Plan,
    PlannerOptions,
    Scope,
    plan_insertion,
)
from ..motion.actuate.actuate import actuate_plan
from ..motion.actuate.actuation import Actuation
from ..motion.measures import measure_displacement
from ..motion.plan import FieldSummary, Measures, write_record
from ..numeric.level_sets import find_level_set
from ..progress import Progress, no_progress
from ..report.verdict import MISSING, SHARE_REACHED, Verdict, judge_plan
from ..results import Json, Result
from .case import Case, clock, round_points
from .ends import (
    OrientedCentreline,
    find_introducer_crossing,
)
from .options import InsertionOptions
from .reach import Unreached, measure_unreached

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# The summary of a plan: what ``--json`` prints and ``summary.json`` holds.


def summarise_plan(plan: Plan, field: SampledField, line: Centreline) -> Json:
    """Return a plan's summary as JSON-able values.

    Parameters
    ----------
    plan : Plan
    field : SampledField
        The lumen it was made in.
    line : Centreline
        From the entry to the goal.
    """
    measures = plan.measures or Measures()
    inside = bool(np.isfinite(plan.clearance).any())
    narrow = int(np.argmin(line.radius))
    summary: Json = {
        "method": plan.method,
        "status": plan.status,
        "reason": plan.reason,
        "reason_code": plan.reason_code,
        "certified": plan.certified,
        # A bound below zero proves nothing, and is loose outside the lumen: no number to quote.
        "clearance_certified_mm": plan.proved,
        "stopped_at_mm": plan.inserted if plan.status == "stopped" else None,
        "centreline_length_mm": line.length,
        "inserted_mm": plan.inserted,
        "steps": plan.steps,
        "links": plan.links,
        "clearance_min_mm": measures.clearance_min if inside else None,
        "clearance_where_mm": measures.clearance_where if inside else None,
        "clearance_insertion_mm": measures.clearance_insertion if inside else None,
        "clearance_error_mm": (plan.field or FieldSummary()).clearance_error,
        "joint_step_max_mm": measures.joint_step_max,
        "joint_step_ratio_max": measures.joint_step_ratio_max,
        "head_step_mm": (plan.options or PlannerOptions()).head_step,
        "joint_angle_max_rad": measures.joint_angle_max,
        "joint_travel_mm": measures.joint_travel,
        "displacement_ratio": measure_displacement(plan),
        "radius_min_mm": float(line.radius[narrow]),
        "radius_min_where_mm": float(line.arc_length[narrow]),
        "wall": plan.wall,
        "wall_error_mm": field.wall_error,
        "voxel_mm": [float(h) for h in field.spacing],
        "inflation_mm": field.inflation,
        "scope": write_record(plan.get_scope()),
    }
    for name, part in (("refusal", plan.refusal), ("soft_wall", plan.soft_wall)):
        if part is not None:
            summary[name] = write_record(part)
    if plan.candidates is not None:
        summary["candidates"] = [write_record(each) for each in plan.candidates]
    if plan.input is not None:
        summary["input"] = plan.input.describe()
    return summary


# Results in the formats of other tools: 3D Slicer markups, VTK poly data, NIfTI volumes.
#
# Coordinates stay in the frame of the input [mm]. Slicer's markups name that frame, RAS or LPS; a
# NIfTI file's world is RAS+ by its standard, so there the axes are turned.


def write_centreline(line: Centreline, folder: Path, *, frame: str) -> None:
    """Write centreline.mrk.json and centreline.vtp into a folder.

    Parameters
    ----------
    frame : str
        Of the line's coordinates, such as ``"RAS"``. Markups know RAS and LPS only: coordinates
        in any other frame are turned to RAS there.
    """
    curve = format_curves([""], [line.points], [None], frame=frame)
    write_text(folder / "centreline.mrk.json", curve)
    values = {"MaximumInscribedSphereRadius": line.radius, "ArcLength": line.arc_length}
    write_text(folder / "centreline.vtp", format_polylines([line.points], values))


def write_volumes(
    field: SampledField, tract: LabelTract | SurfaceTract, folder: Path, *, frame: str
) -> None:
    """Write the distance field and the lumen as field.nii.gz and labels.nii.gz.

    The field is the signed distance to the (inflated) wall [mm], negative inside. The lumen has
    the labels of the tract, cropped to it as the tract is; of a surface it is 1 at the nodes of
    the field that lie inside.
    """
    axes = np.eye(4)
    axes[:3, :3] = field.rotation * field.spacing
    axes[:3, 3] = field.origin
    values = np.asarray(field.values, dtype=np.float32) - np.float32(field.inflation)
    volumes: dict[str, Json] = {"field": {"values": values, "affine": axes}}
    if isinstance(tract, LabelTract):
        volumes["labels"] = {
            "values": tract.labels, "affine": tract.affine, "names": tract.label_names
        }  # fmt: skip
    else:
        inside = np.asarray(field.values < 0.0).astype(np.uint8)
        volumes["labels"] = {"values": inside, "affine": axes}
    for name, volume in volumes.items():
        path = folder / f"{name}.nii.gz"
        write_bytes(path, encode_volume(path, **volume, frame=frame))


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionStudy(Result):
    """Everything from one run of the main job.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
    field : SampledField
        The lumen on the first grid.
    duct : SampledField or RefinedField
        The lumen that the plan is proved in: the same, or with finer nodes about the centreline.
    centreline : OrientedCentreline
        The centreline that is planned along, and how its ends were chosen.
    plan : Plan
        The motion.
    seconds : dict
        Wall-clock time by stage [s].
    passage : Passage, optional
        The widest passage through the lumen.
    largest : Largest, optional
        The largest scope that fits, if it was asked for.
    comparison : tuple of Plan
        Plans of every method, if they were asked for.
    robot : Actuation, optional
        The motion of a tendon robot along the plan, if one was given.
    findings : tuple of Finding
        What the checks of the tract found, and what finding the centreline did.
    unreached : tuple of Unreached
        Parts of the lumen that the centreline does not reach, largest first.
    entries : tuple of dict
        Of an organ that is not known: what came of entering at either end, the better one first.
    label_error : float, optional
        How far the labels or the surface may be from the true wall, as the user states it [mm].
    """

    tract: LabelTract | SurfaceTract
    field: SampledField
    duct: SampledField | RefinedField
    centreline: OrientedCentreline
    plan: Plan
    seconds: dict[str, float]
    passage: Passage | None = None
    largest: Largest | None = None
    comparison: tuple[Plan, ...] = ()
    robot: Actuation | None = None
    findings: tuple[Finding, ...] = ()
    unreached: tuple[Unreached, ...] = ()
    entries: tuple[Json, ...] = ()
    label_error: float | None = None

    @property
    def line(self) -> Centreline:
        """The centreline from the entry to the goal."""
        return self.centreline.line

    @property
    def unreached_share(self) -> float:
        """Share of the lumen that the centreline should have reached and does not."""
        return measure_unreached(self.unreached, self.centreline)

    @property
    def fits(self) -> bool:
        """Whether the scope, or the robot if there is one, is proved to reach the end clear.

        That is the end which was given, or of the whole lumen: where more than `SHARE_REACHED` of
        it is not reached, or any is missing in the file, that is False. With a stated label error
        also whether the proof covers it.
        """
        missing = any(part.kind == MISSING for part in self.unreached)
        if self.unreached_share > SHARE_REACHED or missing and not self.centreline.goal_given:
            return False
        bound = self.plan.proved
        if self.label_error is not None and (bound is None or bound < self.label_error):
            return False
        proved = self.plan.certified if self.robot is None else self.robot.fits
        return self.plan.status == "complete" and proved

    @property
    def verdict(self) -> Verdict:
        """The same in words, with its colour: what commands, report and page state."""
        summary = self._summarise()
        return judge_plan(self.plan, summary, error=self.residual)

    @property
    def converged(self) -> bool:
        """Whether the scope fits."""
        return self.fits

    @property
    def reason(self) -> str:
        """Why the motion of the scope, or else of the robot, ends before the goal."""
        robot = "" if self.robot is None else self.robot.reason
        return self.plan.reason or robot

    @property
    def residual(self) -> float:
        """Largest error of the clearance between the nodes of the grid [mm]."""
        field = self.plan.field
        return 0.0 if field is None else field.clearance_error or 0.0

    def to_dict(self) -> Json:
        """Return the summary: what ``--json`` prints and ``summary.json`` holds."""
        verdict = asdict(self.verdict)
        return self._summarise() | {"verdict": verdict | {"notes": list(verdict["notes"])}}

    def _summarise(self) -> Json:
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
            summary["robot"] = self.robot.to_dict()
        ends = self.centreline
        summary |= {
            "organ": self.tract.organ,
            "frame": self.tract.frame,
            "entry": {"point_mm": round_points(self.line.points[0]).tolist(), "basis": ends.basis},
            "goal": {
                "point_mm": round_points(self.line.points[-1]).tolist(),
                "name": ends.goal,
                "given": ends.given,
                "chosen": ends.goal_given,
            },
            "ends": [candidate.describe() for candidate in ends.candidates],
            "unreached": [part.describe() for part in self.unreached],
            "unreached_share": self.unreached_share,
            "label_error_mm": self.label_error,
        }
        source_error = getattr(self.tract, "source_error", None)
        if source_error is not None:
            summary["source_error_mm"] = source_error
        if self.entries:
            summary["entries"] = list(self.entries)
        if "command" in self.plan.more:
            summary["command"] = self.plan.more["command"]
        summary["findings"] = [asdict(item) for item in self.findings]
        summary["seconds"] = {key: round(value, 4) for key, value in self.seconds.items()}
        return summary

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the smallest clearance over the insertion, and return the axes."""
        return self.plan.plot(ax)

    def write(
        self,
        directory: str | os.PathLike[str],
        *,
        force: bool = False,
        export: bool = False,
        progress: Progress = no_progress,
    ) -> Json:
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
        from .. import plot, report

        with new_directory(directory, force=force) as folder:
            progress("report", 0.0)
            self.plan.save(folder / "plan.npz")
            for other in self.comparison:
                other.save(folder / f"plan-{other.method}.npz")
            if self.robot is not None:
                _write_robot(self.robot, folder)
            frame = self.tract.frame or "RAS"
            write_centreline(self.line, folder, frame=frame)
            if export:
                with clock(self.seconds, "export"):
                    write_volumes(self.field, self.tract, folder, frame=frame)
            progress("report", 0.2)
            with clock(self.seconds, "scene"):
                self._write_scene(folder / "scene.glb")
            progress("report", 0.6)
            with clock(self.seconds, "report"):
                plot.draw_overview(self.plan, self.field, path=folder / "picture.png")
                report.write_report(
                    folder / "report.html",
                    plan=self.plan,
                    field=self.field,
                    summary=self.to_dict(),
                    findings=self.findings,
                    comparison=self.comparison,
                )
            progress("report", 1.0)
            self.seconds["total"] = sum(v for k, v in self.seconds.items() if k != "total")
            # The names are what --force may remove later, see `bozzini.io.files.new_directory`.
            files = [path for path in folder.rglob("*") if path.is_file()]
            names = {path.relative_to(folder).as_posix() for path in files} | {"summary.json"}
            summary = self.to_dict() | {"files": sorted(names)}
            text = json.dumps(summary, indent=2, allow_nan=False)
            write_text(folder / "summary.json", text + "\n")
        return summary

    def _write_scene(self, target: Path) -> None:
        """Write the wall and the body: the robot's arcs, or the scope's chain."""
        from .. import scene

        joints, radius = self.place_body()
        scene.write_scene(
            target,
            surface=self.find_surface(),
            joints=joints,
            diameter=2.0 * radius,
            path=self.plan.path,
            options=scene.SceneOptions(title=f"Insertion: {Path(self.tract.source).name}"),
        )

    def place_body(self) -> tuple[NDArray[np.float64], float]:
        """Return points on the robot, else the scope's joints, at each step, and the radius [mm].

        Shape (steps, points, 3), the head first.
        """
        robot = self.robot
        if robot is None:
            return self.plan.joints, self.plan.get_scope().radius
        return robot.place_body(np.arange(robot.steps), pitch=5.0), robot.robot.radius

    def find_surface(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the wall to look at: the surface itself, or the level set of the field."""
        if isinstance(self.tract, SurfaceTract) and self.field.inflation == 0.0:
            return self.tract.vertices, self.tract.faces
        index, faces = find_level_set(self.field.values, self.field.inflation)
        outward = faces if np.linalg.det(self.field.rotation) > 0.0 else faces[:, ::-1]
        return self.field.to_world(index * self.field.spacing), outward


def _write_robot(actuation: Actuation, folder: Path) -> None:
    """Write time tables, figure and everything else of a robot's motion into a directory."""
    from .. import plot

    actuation.write_csv(folder / "tendons.csv")
    if has_parquet():
        actuation.write_parquet(folder / "tendons.parquet")
    actuation.save(folder / "robot.npz")
    plot.write_figure(plot.draw_robot_motion(actuation), folder / "robot.png")


def run_insertion(
    tract: LabelTract | SurfaceTract,
    scope: Scope,
    *,
    options: InsertionOptions | None = None,
    robot: ContinuumRobot | None = None,
    inputs: Mapping[str, object] | None = None,
    progress: Progress = no_progress,
) -> InsertionStudy:
    """Run the main job: sample the lumen, find its centreline, plan the insertion.

    Parameters
    ----------
    tract : LabelTract or SurfaceTract
        What `bozzini.anatomy.read_tract` or `make_phantom` gives.
    scope : Scope
    options : InsertionOptions, optional
    robot : ContinuumRobot, optional
        A tendon robot that follows the plan; see `bozzini.motion.actuate.actuate.actuate_plan`.
    inputs : mapping, optional
        What the tract was read from, kept in the plan.
    progress : Progress

    Raises
    ------
    BozziniError
        If an input is not legal; a scope that does not fit is a result, not an error.
    """
    options = InsertionOptions() if options is None else options
    case = Case(tract=tract, options=options, inputs=inputs or {}, progress=progress)
    return run_case(case, scope, robot=robot)


def run_case(case: Case, scope: Scope, *, robot: ContinuumRobot | None = None) -> InsertionStudy:
    """Run the main job in a case; see `run_insertion`."""
    found, options, progress = case.plan(scope), case.options, case.progress
    plan, field, line, times = found.plan, case.field, found.line, case.seconds
    entry = case.end if options.reverse else case.start
    findings = (
        *case.tract.findings,
        *found.centreline.findings,
        *found.findings,
        *find_introducer_crossing(field, plan, entry),
    )
    moved = None
    if robot is not None:
        with clock(times, "robot"):
            moved = actuate_plan(plan, robot, found.duct.inflate(plan.displaced), progress=progress)
        if moved.status != "complete":
            message = f"the robot '{robot.name}' does not get there: {moved.reason}"
            findings = (*findings, Finding("robot", "warning", message))
    largest = case.find_largest(scope, line) if options.largest else None
    comparison: list[Plan] = []
    if options.compare:
        with clock(times, "compare"):
            others = [name for name in PLANNERS if name != "best"]
            for other in others:
                try:
                    ignored = getattr(PLANNERS[other], "ignored", ())
                    plain = {name: getattr(PlannerOptions(), name) for name in ignored}
                    chosen = replace(options.motion, **plain)
                    comparison.append(
                        plan_insertion(field, line, scope=scope, method=other, options=chosen)
                    )
                except PluginError as error:
                    findings = (*findings, Finding("plugin", "warning", str(error)))
                progress("compare", len(comparison) / len(others))

    def state(each: Plan) -> Plan:
        return case.state(each, centreline=found.centreline, findings=findings)

    return InsertionStudy(
        tract=case.tract,
        field=field,
        duct=found.duct,
        centreline=found.centreline,
        plan=state(plan),
        seconds=times,
        passage=found.passage,
        largest=largest,
        comparison=tuple(map(state, comparison)),
        robot=moved,
        findings=findings,
        unreached=found.unreached,
        entries=found.entries,
        label_error=options.label_error,
    )
