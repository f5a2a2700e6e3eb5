"""What `bozzini execute` does: a plan in its tract, drives side by side, and their files."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..anatomy.tract import LabelTract, SurfaceTract
from ..checks import check_word
from ..duct.base import Duct
from ..errors import InputError
from ..io.files import write_text
from ..io.mcap import has_mcap
from ..io.sheets import write_table
from ..motion.actuate.actuation import Actuation
from ..motion.plan import Plan
from ..motion.scope import Scope
from ..motion.verify import rebuild_field
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, tabulated, to_plain
from ..scene import write_scene
from ..scene.make_view import draw_wall
from ..scene.page import render_page
from ..scene.view import Body, Chart, Mark, Surface, View
from .execute import Execution, execute
from .log import write_execution_log
from .manoeuvre import Manoeuvre
from .options import DRIVES, DriveName, ExecuteOptions, ScopeOptions, WallOptions
from .robots import Drive, ManoeuvreDrive, PlanDrive, PushDrive, TendonDrive, drag_chain
from .simulate import Dynamics
from .walls import Floats, LumenWall

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..scene.scene import TractMesh

PUSHED_LENGTH = 1.5
"""Length of a pushed scope over the way's: it is pushed on where its tip stands still."""

SLACK_MM = 0.5
"""Between a pushed scope and its introducer."""

START_ANGLE_RAD = 0.05
"""Standard deviation of the head's three joints at a start after the first."""

DRAWN = {"haste": (0.7, 1.3), "friction": (0.0, 0.3), "servo": (0.5, 2.0)}
"""What else is drawn for it, evenly: a factor of the speed, the coefficient of friction and a
factor of the gain of the servos."""

_COLOURS = ("#f3c66b", "#e8862d", "#c0392b")  # of the force map: a third of the largest force each


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenery(Shown):
    """A plan in its tract, ready to be driven.

    Parameters
    ----------
    plan : Plan
    duct : Duct
        The lumen that it was made in.
    tract : LabelTract or SurfaceTract, optional
        From which the triangles of a wall are made; by default the duct.
    actuation : Actuation, optional
        The motion of a tendon robot along it.
    scope : ScopeOptions
    wall : WallOptions
    haste : float
        Factor of the speed.
    manoeuvre : Manoeuvre, optional
        Steps of the pushed scope; by default it is pushed on.
    aside : (6,) float
        By how much the head's joints are off at the start [rad].
    """

    plan: Plan
    duct: Duct
    tract: LabelTract | SurfaceTract | None = None
    actuation: Actuation | None = None
    scope: ScopeOptions = field(default_factory=ScopeOptions)
    wall: WallOptions = field(default_factory=WallOptions)
    haste: float = 1.0
    manoeuvre: Manoeuvre | None = None
    aside: Floats = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def from_plan(
        cls, plan: Plan, tract: LabelTract | SurfaceTract, *, duct: Duct | None = None
    ) -> Scenery:
        """Return a plan in its tract; the lumen is sampled as the plan states, unless given."""
        duct = rebuild_field(plan, tract) if duct is None else duct
        return cls(plan=plan, duct=duct, tract=None if plan.inflation > 0.0 else tract)

    @property
    def line(self) -> Floats:
        """The way: the head's path."""
        return self.plan.path

    def make_drive(self, name: DriveName, speed: float) -> Drive:
        """Return a drive.

        Raises
        ------
        InputError
            If there is no motion of a tendon robot.
        """
        check_word("drive", name, DRIVES)
        plan = self.plan
        if name == "plan":
            return PlanDrive(plan, speed, self.scope)
        if name == "tractrix":
            return PlanDrive(drag_chain(plan), speed, self.scope, name)
        if name == "tendons":
            if self.actuation is None:
                raise InputError(
                    "there is no motion of a tendon robot: give --robot, or a plan that was made "
                    "with one, with its robot.npz beside it"
                )
            goals = interpolate_polyline(
                plan.path, plan.path_arc_length, self.actuation.head_arc_length
            )
            return TendonDrive(self.actuation, speed, goals)
        line = plan.path if plan.centreline is None else plan.centreline.points
        length = float(measure_arc_length(line)[-1])
        scope = plan.get_scope()
        kind: Callable[..., PushDrive] = PushDrive
        if self.manoeuvre is not None:
            kind = partial(ManoeuvreDrive, manoeuvre=self.manoeuvre)
        return kind(
            line=line,
            introducer=plan.get_introducer(),
            diameter=scope.diameter,
            length=PUSHED_LENGTH * length,
            link=scope.link_length,
            speed=speed,
            options=self.scope,
        )

    def make_wall(self, name: DriveName) -> LumenWall:
        """Return the wall; a pushed scope's introducer is as narrow as it."""
        radius = self.plan.get_scope().radius
        return LumenWall(
            duct=self.duct,
            surface=self.tract,
            introducer=self.plan.get_introducer(),
            guide=radius + SLACK_MM if name == "push" else None,
            options=self.wall,
        )

    def _draw_start(self, options: ExecuteOptions, repeat: int) -> Scenery:
        """Return the same with another start, speed, friction and gain."""
        random = np.random.default_rng((options.seed, repeat))
        drawn = {name: float(random.uniform(low, high)) for name, (low, high) in DRAWN.items()}
        return dataclasses.replace(
            self,
            aside=START_ANGLE_RAD * random.standard_normal(6),
            haste=drawn["haste"],
            scope=dataclasses.replace(self.scope, servo=drawn["servo"] * self.scope.servo),
            wall=dataclasses.replace(self.wall, friction=drawn["friction"]),
        )

    def run(
        self,
        options: ExecuteOptions,
        *,
        repeat: int = 0,
        progress: Progress = no_progress,
    ) -> Execution:
        """Drive once; starts after the first are drawn by the seed, as `DRAWN` says."""
        if repeat:
            return self._draw_start(options, repeat).run(options, progress=progress)
        drive = self.make_drive(options.drive, self.haste * options.speed)
        drive.start = drive.start.copy()
        head = drive.start[1:][-len(self.aside) :]
        head += self.aside[: len(head)]
        way = drive.line if isinstance(drive, PushDrive) else self.line
        return execute(
            drive,
            self.make_wall(options.drive),
            line=way,
            dynamics=Dynamics(step=options.step),
            progress=progress,
        )


CHECKED = (
    "normal_peak_N", "normal_sum_N", "resultant_N", "push_force_N", "tip_error_mm", "clearance_mm"
)  # fmt: skip
FRICTIONS = (0.0, 0.3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Convergence:
    """What half the step changes, and other coefficients of friction.

    Parameters
    ----------
    values : mapping
        Largest forces [N] and errors [mm].
    others : mapping of str to mapping
        The same with ``half_step``, and with ``friction_0`` and ``friction_0.3``.
    """

    values: Mapping[str, float]
    others: Mapping[str, Mapping[str, float]]

    def describe(self) -> Json:
        """Return both and by how much they differ, for each setting."""
        return {
            setting: {
                name: {"value": value, "there": found[name], "change": found[name] - value}
                for name, value in self.values.items()
            }
            for setting, found in self.others.items()
        }


def check_setting(
    scenery: Scenery,
    options: ExecuteOptions,
    found: Execution,
    *,
    progress: Progress = no_progress,
) -> Convergence:
    """Drive again with half the step, and with other friction, and compare."""
    halved = dataclasses.replace(options, step=0.5 * options.step)
    others = {"half_step": scenery.run(halved, progress=progress)}
    for friction in FRICTIONS:
        wall = dataclasses.replace(scenery.wall, friction=friction)
        others[f"friction_{friction:g}"] = dataclasses.replace(scenery, wall=wall).run(
            options, progress=progress
        )
    first = found.summarise()
    names = [name for name in CHECKED if first[name] is not None]
    return Convergence(
        values={name: first[name] for name in names},
        others={
            setting: {name: row[name] for name in names}
            for setting, row in ((key, each.summarise()) for key, each in others.items())
        },
    )


COMPARED = (
    ("complete", "comes through"),
    ("tip_progress_mm", "tip comes to [mm]"),
    ("looped_at_mm", "loops with [mm] pushed in"),
    ("normal_peak_N", "largest force of one place [N]"),
    ("normal_sum_N", "sum of normal forces [N]"),
    ("resultant_N", "resultant [N]"),
    ("push_force_N", "force at the mouth [N]"),
    ("tip_error_mm", "tip error [mm]"),
    ("clearance_mm", "least clearance [mm]"),
    ("work_N_mm", "work of the drives [N mm]"),
)
"""What is compared between drives, and in which words."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExecutionStudy(Result):
    """Motions through one tract side by side, the one that was asked for first.

    Parameters
    ----------
    scenery : Scenery
    options : ExecuteOptions
    executions : tuple of Execution
    convergence : Convergence, optional
    """

    scenery: Scenery
    options: ExecuteOptions
    executions: tuple[Execution, ...]
    convergence: Convergence | None = None

    @property
    def converged(self) -> bool:
        """Whether the motion came through."""
        return self.executions[0].converged

    @property
    def reason(self) -> str:
        """Why not."""
        return self.executions[0].reason

    @property
    def residual(self) -> float:
        """How far its tip is from the end of the way [mm]."""
        return self.executions[0].residual

    def to_dict(self) -> Json:
        """Return the summary."""
        first, *others = self.executions
        wall = self.scenery.wall
        summary: Json = {
            **first.summarise(),
            "wall": to_plain(wall),
            "scope": to_plain(self.scenery.scope),
            "options": to_plain(self.options),
            "units": "mm, kg, s in scenes (forces in mN); N in this file",
            "findings": list(first.findings),
        }
        if others:
            summary["compared"] = [other.summarise() for other in others]
        if self.convergence is not None:
            summary["checked"] = self.convergence.describe()
        return dict(to_plain(summary))

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of `to_frame`: what is compared, a row each drive."""
        rows = [each.summarise() for each in self.executions]
        return {
            "drive": [row["drive"] for row in rows],
            **{name: [row[name] for row in rows] for name, _ in COMPARED},
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the forces of all over the insertion, and return the axes."""
        for each in self.executions:
            ax = each.plot(ax)
        if ax is None:
            raise InputError("there is no motion to draw")
        return ax

    def draw_map(self) -> Figure:
        """Draw where the wall is pressed how much, from two sides."""
        from matplotlib.figure import Figure

        mesh, _ = draw_wall(self.scenery.tract or self.scenery.duct, most_faces=20_000)
        figure = Figure(figsize=(9.0, 4.5 * len(self.executions)), layout="constrained")
        panels = figure.subplots(len(self.executions), 2, squeeze=False)
        for row, each in zip(panels, self.executions, strict=True):
            forces = each.map_forces(mesh.vertices)
            order = np.argsort(forces)
            most = max(float(forces.max()), 1e-6)
            for axes, (right, up) in zip(row, ((0, 2), (1, 2)), strict=True):
                points = axes.scatter(
                    *mesh.vertices[order][:, [right, up]].T, c=forces[order], s=2.0, vmin=0.0,
                    vmax=most, cmap="YlOrRd",
                )  # fmt: skip
                axes.set_aspect("equal")
                axes.set_xlabel(f"{'xyz'[right]} [mm]")
                axes.set_ylabel(f"{'xyz'[up]} [mm]")
                axes.set_title(each.drive)
            figure.colorbar(points, ax=row, label="largest normal force [N]")
        return figure

    @cached_property
    def drawn_wall(self) -> tuple[TractMesh, tuple[str, ...]]:
        """The wall as it is drawn, and notes on that."""
        return draw_wall(self.scenery.tract or self.scenery.duct)

    def make_page(self) -> View:
        """Return the page: wall, body at each row, the pressed places by force."""
        first = self.executions[0]
        mesh, notes = self.drawn_wall
        forces = first.map_forces(mesh.vertices)
        most = float(forces.max())
        faces = forces[mesh.faces].max(axis=1)
        surfaces = [Surface(vertices=mesh.vertices, faces=mesh.faces)]
        for k, colour in enumerate(_COLOURS):
            low, high = most * k / 3.0, most * (k + 1) / 3.0
            on = (faces > low) & (faces <= high)
            if on.any():
                surfaces.append(
                    Surface(
                        vertices=mesh.vertices, faces=mesh.faces[on], color=colour, opacity=0.9,
                        name=f"pressed with {1e3 * low:.3g} to {1e3 * high:.3g} mN",
                    )
                )  # fmt: skip
        marks = [Mark(place=self.scenery.line[-1], text="goal", kind="goal")]
        if math.isfinite(first.looped_at):
            marks.append(Mark(place=first.looped_place, text="loops", kind="refused"))
        charts = (
            Chart(name="force at the mouth", unit="N", values=first.push_force, kind="angle"),
            Chart(name="sum of forces", unit="N", values=first.normal_sum, kind="angle"),
        )
        return View(
            title=f"Driven: {first.drive}",
            surfaces=tuple(surfaces),
            bodies=(Body(joints=first.joints, radius=first.radius, insertion=first.inserted),),
            marks=tuple(marks),
            charts=charts,
            notes=notes,
        )

    def write(self, folder: Path) -> Json:
        """Write tables, figures, the animated scene and the page into a directory.

        Where mcap-ros2-support is installed, logs of ROS 2 messages, too.

        Returns
        -------
        dict
            The summary that was written, with the files' names.
        """
        import trimesh

        from .. import plot

        mesh, _ = self.drawn_wall
        for each in self.executions:
            name = each.drive
            write_table(folder / f"{name}.csv", each.list_table())
            write_table(folder / f"{name}_contacts.csv", each.list_contacts())
            if each.steps:
                rows = [step.to_dict() for step in each.steps]
                table = {key: [row[key] for row in rows] for key in rows[0]}
                write_table(folder / "manoeuvre.csv", table)
            write_scene(
                folder / f"{name}.glb",
                surface=(mesh.vertices, mesh.faces),
                joints=each.joints,
                diameter=2.0 * each.radius,
                path=self.scenery.line,
            )
            if has_mcap():
                write_execution_log(each, folder / f"{name}.mcap", wall=(mesh.vertices, mesh.faces))
        pressed, _ = self.executions[0].displace_wall((mesh.vertices, mesh.faces))
        trimesh.Trimesh(pressed, mesh.faces, process=False).export(folder / "wall.ply")
        plot.write_figure(self.plot(), folder / "force.png")
        plot.write_figure(self.draw_map(), folder / "map.png")
        write_table(folder / "comparison.csv", self.list_table())
        write_text(folder / "view.html", render_page(self.make_page()))
        names = {path.name for path in folder.iterdir()} | {"summary.json"}
        summary = self.to_dict() | {"files": sorted(names)}
        write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False))
        return summary


def study_execution(
    scenery: Scenery,
    options: ExecuteOptions,
    *,
    compare: bool = False,
    check: bool = False,
    progress: Progress = no_progress,
) -> ExecutionStudy:
    """Drive a plan; if asked the pushed scope beside it, and again with other step and friction."""
    found = [scenery.run(options, progress=progress)]
    if compare and options.drive != "push":
        found.append(scenery.run(dataclasses.replace(options, drive="push"), progress=progress))
    convergence = check_setting(scenery, options, found[0], progress=progress) if check else None
    return ExecutionStudy(
        scenery=scenery, options=options, executions=tuple(found), convergence=convergence
    )


# Many tracts: how often a motion comes through.


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials(Result):
    """Motions through many phantoms, several starts each.

    ``r`` counts the runs; those of a phantom that the planner refuses are not among them.

    Attributes
    ----------
    seed, repeat : (r,) ndarray
        Phantom and start of each run.
    complete : (r,) ndarray
        Whether it came through.
    normal_peak, normal_sum, push_force : (r,) ndarray
        Largest of each run [N].
    tip_error : (r,) ndarray
        Largest of each run [mm]; NaN for a scope that is pushed.
    reasons : tuple of str
        Of each run.
    refused : mapping
        Seeds that the planner refused, and why.
    """

    seed: Floats = tabulated()
    repeat: Floats = tabulated()
    complete: Floats = tabulated()
    normal_peak: Floats = tabulated("N")
    normal_sum: Floats = tabulated("N")
    push_force: Floats = tabulated("N")
    tip_error: Floats = tabulated("mm")
    reasons: tuple[str, ...] = tabulated(name="reason")
    refused: Mapping[int, str]

    @property
    def share(self) -> float:
        """Share of the runs that came through; NaN without any."""
        return float(np.mean(self.complete)) if len(self.complete) else math.nan

    @property
    def converged(self) -> bool:
        """Whether all came through."""
        return bool(np.all(self.complete)) and len(self.complete) > 0

    @property
    def reason(self) -> str:
        """Why the first one did not."""
        if not self.reasons:
            return "the planner refused all phantoms"
        return next((why for why in self.reasons if why), "")

    @property
    def residual(self) -> float:
        """Share of the runs that did not come through."""
        return 1.0 - self.share

    def to_dict(self) -> Json:
        """Return the completion, the largest forces, and who was refused."""
        peak = self.normal_peak if len(self.normal_peak) else np.full(1, math.nan)
        return dict(
            to_plain(
                {
                    "runs": len(self.complete),
                    "completed": int(np.sum(self.complete)),
                    "share": self.share,
                    "normal_peak_N": float(peak.max()),
                    "normal_peak_median_N": float(np.median(peak)),
                    "refused": dict(self.refused),
                    "converged": self.converged,
                    "reason": self.reason,
                }
            )
        )


def run_trials(
    seeds: range,
    scope: Scope,
    *,
    repeats: int = 1,
    options: ExecuteOptions | None = None,
    setting: tuple[WallOptions, ScopeOptions] | None = None,
    progress: Progress = no_progress,
) -> Trials:
    """Plan a motion through the phantom of each seed, and drive it from several starts.

    Parameters
    ----------
    seeds : range
        Of the phantoms.
    scope : Scope
    repeats : int
        Starts of each.
    options : ExecuteOptions, optional
    setting : WallOptions, ScopeOptions, optional
    progress : Progress
    """
    options = ExecuteOptions() if options is None else options
    wall, gains = (WallOptions(), ScopeOptions()) if setting is None else setting
    rows: list[tuple[float, ...]] = []
    reasons: list[str] = []
    refused: dict[int, str] = {}
    for k, seed in enumerate(seeds):
        progress("trials", k / len(seeds))
        plan, duct = plan_phantom(seed, scope)
        if plan.status != "complete" or not plan.certified:
            refused[seed] = plan.reason or "its clearance is not proved"
            continue
        scenery = Scenery(plan=plan, duct=duct, scope=gains, wall=wall)
        drawn = dataclasses.replace(options, seed=seed)
        for repeat in range(repeats):
            found = scenery.run(drawn, repeat=repeat)
            error = found.summarise()["tip_error_mm"]
            rows.append(
                (
                    seed, repeat, found.converged, found.normal_peak.max(), found.normal_sum.max(),
                    np.abs(found.push_force).max(), math.nan if error is None else error,
                )
            )  # fmt: skip
            reasons.append(found.reason)
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return Trials(
        seed=table[:, 0],
        repeat=table[:, 1],
        complete=table[:, 2],
        normal_peak=table[:, 3],
        normal_sum=table[:, 4],
        push_force=table[:, 5],
        tip_error=table[:, 6],
        reasons=tuple(reasons),
        refused=refused,
    )


PHANTOM_VOXEL_MM = 1.5
"""Voxels of a phantom that is planned in."""


def plan_phantom(seed: int, scope: Scope) -> tuple[Plan, Duct]:
    """Plan an insertion through the phantom of a seed; return the plan and the lumen."""
    from ..study import run_insertion
    from ..study.case import open_phantom

    inputs = {"file": "phantom", "seed": seed, "voxel_mm": PHANTOM_VOXEL_MM}
    study = run_insertion(open_phantom(seed=seed, voxel=PHANTOM_VOXEL_MM), scope, inputs=inputs)
    return study.plan, study.duct.inflate(study.plan.displaced)
