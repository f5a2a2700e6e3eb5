"""Drive a robot through a lumen, and say what forces act, where, and whether it came through."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import name_place
from ..checks import check_points
from ..numeric.arrays import Floats
from ..numeric.polylines import follow_way, measure_arc_length
from ..progress import Progress, no_progress
from ..results import Json, Result, measured, tabulated, take_axes
from .manoeuvre import LIMITS, StepReport
from .robots import Drive, ManoeuvreDrive
from .simulate import Dynamics, Simulation, Touch
from .walls import LumenWall, find_normals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RECORD_S = 0.05
"""Time between rows of a record; forces in a row are the largest since the row before."""

SETTLE_S = 0.3
"""Time after the end of a motion in which the robot comes to rest."""

STALLED = 0.05
"""A tip that goes on by less than this share of the base's way does not advance."""

STALLED_DIAMETERS = 3.0
"""Length over which that must be so, in diameters of the body."""

ON_MM = 40.0
"""How far a scope is pushed on after a loop [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Execution(Result):
    """A motion that was driven with contact.

    ``s`` counts the rows of the record, ``c`` the contacts in all rows.

    Attributes
    ----------
    drive : str
        ``"plan"``, ``"tractrix"``, ``"tendons"`` or ``"push"``.
    time : (s,) ndarray
        [s].
    inserted : (s,) ndarray
        How far the base has been moved in [mm].
    push_force : (s,) ndarray
        Force of the drive that moves the base, at the mouth, on average since the row before [N].
    resultant : (s,) ndarray
        Size of the vector sum of all forces of the wall [N].
    normal_sum : (s,) ndarray
        Sum of the normal forces [N]: in a groove more than the resultant.
    normal_peak : (s,) ndarray
        Largest normal force of one contact [N].
    clearance : (s,) ndarray
        Least distance between the body and the wall [mm]; negative where it is pressed in.
    tip_error : (s,) ndarray
        How far the tip is from where it is to be [mm]; NaN for a scope that is pushed.
    tip_progress : (s,) ndarray
        Arc length of the way's place nearest to the tip [mm].
    work : (s,) ndarray
        Work of all drives since the start [N mm].
    contacts : (s,) ndarray
        How many places touch.
    complete : bool
        Whether the tip came to the end of the way.
    looped_at : float
        How far the base was in when the body first ran back along the way, or the tip no longer
        advanced [mm]; NaN if it did not.
    looped_place : (3,) ndarray
        Where the body was farthest off the way then, world [mm].
    speed_ratio : float
        Simulated time over the processor's time that it took.
    compliance : float
        Of the wall, at each place of contact [mm/N].
    converged : bool
        Whether it is complete, no link was outside the lumen, and no loop was made; of a
        manoeuvre, whether all its steps were made with no link outside.
    reason : str
    residual : float
        How far the tip is from the end of the way [mm].
    steps : tuple of StepReport
        Of a manoeuvre.
    """

    drive: str
    time: Floats = tabulated("s")
    inserted: Floats = tabulated("mm")
    push_force: Floats = tabulated("N")
    resultant: Floats = tabulated("N")
    normal_sum: Floats = tabulated("N")
    normal_peak: Floats = tabulated("N")
    clearance: Floats = tabulated("mm")
    tip_error: Floats = tabulated("mm")
    tip_progress: Floats = tabulated("mm")
    work: Floats = tabulated("N mm")
    contacts: NDArray[np.int64] = tabulated()
    complete: bool
    outside: bool
    looped_at: float = measured("mm")
    looped_place: Floats = measured("mm")
    speed_ratio: float
    compliance: float = measured("mm/N")
    converged: bool
    reason: str
    residual: float = measured("mm")
    findings: tuple[str, ...] = ()
    steps: tuple[StepReport, ...] = ()
    joints: Floats = field(repr=False)
    radius: float = field(repr=False)
    touched: Floats = field(repr=False)
    """(c, 9): row, link, place [mm], force [N], normal force [N]."""

    def list_contacts(self) -> Mapping[str, Floats]:
        """Return a table of contacts: in each row of the record, when the largest force acted."""
        rows = self.touched[:, 0].astype(np.int64)
        names = ["link", "x_mm", "y_mm", "z_mm", "force_x_N", "force_y_N", "force_z_N"]
        table = dict(zip([*names, "normal_force_N"], self.touched[:, 1:].T, strict=True))
        return {"time_s": self.time[rows], "inserted_mm": self.inserted[rows], **table}

    def summarise(self) -> Json:
        """Return the largest values and the verdict."""
        errors = self.tip_error[np.isfinite(self.tip_error)]
        made = [step.to_dict() for step in self.steps]
        manoeuvre = {"manoeuvre": made, "limits": list(LIMITS)} if made else {}
        return {
            "drive": self.drive,
            "complete": self.complete,
            "outside": self.outside,
            "inserted_mm": float(self.inserted.max()),
            "tip_progress_mm": float(self.tip_progress.max()),
            "normal_peak_N": float(self.normal_peak.max()),
            "normal_sum_N": float(self.normal_sum.max()),
            "resultant_N": float(self.resultant.max()),
            "push_force_N": float(np.abs(self.push_force).max()),
            "tip_error_mm": float(errors.max()) if len(errors) else None,
            "clearance_mm": float(self.clearance.min()),
            "work_N_mm": float(self.work[-1]),
            "looped_at_mm": self.looped_at if math.isfinite(self.looped_at) else None,
            "looped_place_mm": (
                self.looped_place.tolist() if math.isfinite(self.looped_at) else None
            ),
            "speed_ratio": self.speed_ratio,
            "compliance_mm/N": self.compliance,
            "converged": self.converged,
            "reason": self.reason,
            **manoeuvre,
        }

    def map_forces(self, vertices: Floats, *, reach: float = 4.0) -> Floats:
        """Return the largest normal force (n,) near each vertex (n, 3) over the motion [N].

        Parameters
        ----------
        vertices : (n, 3) float
            Of a wall [mm].
        reach : float
            A contact shows on vertices this near [mm].
        """
        from scipy.spatial import KDTree

        points = check_points("vertices", vertices)
        forces = np.zeros(len(points))
        tree = KDTree(points)
        for place, force in zip(self.touched[:, 2:5], self.touched[:, 8], strict=True):
            near = tree.query_ball_point(place, reach) or [int(tree.query(place)[1])]
            forces[near] = np.maximum(forces[near], force)
        return forces

    def displace_wall(
        self, surface: tuple[Floats, NDArray[np.int64]], *, spread: float = 5.0
    ) -> tuple[Floats, Floats]:
        """Return a wall (n, 3) pressed outwards by the motion, and by how much (n,) [mm].

        A first step, no model of tissue: each vertex moves along its normal by the largest force
        near it over the wall's stiffness, smoothed along the surface over `spread` [mm]. Places do
        not hold each other, volume and thickness are not kept, and the motion was not changed.

        Parameters
        ----------
        surface : (n, 3) float, (m, 3) int
            The wall [mm], turned outwards.
        spread : float
            Standard deviation of the smoothing [mm].
        """
        from scipy.sparse import coo_matrix, diags

        vertices, faces = surface
        forces = self.map_forces(vertices)
        sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ones = np.ones(len(sides))
        graph = coo_matrix((ones, sides.T), shape=(len(vertices),) * 2).tocsr()
        graph = ((graph + graph.T) > 0).astype(np.float64)
        average = diags(1.0 / np.maximum(graph.sum(axis=1).A1, 1.0)) @ graph
        edge = float(np.linalg.norm(np.diff(vertices[sides], axis=1), axis=2).mean())
        moved = self.compliance * forces
        for _ in range(round((spread / edge) ** 2)):  # steps of diffusion, of one edge each
            moved = 0.5 * (moved + average @ moved)
        return vertices + moved[:, None] * find_normals(vertices, faces), moved

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the forces over the insertion, and return the axes."""
        axes = take_axes(ax, x="base moved in [mm]", y="force [N]")
        axes.plot(self.inserted, self.push_force, label=f"{self.drive}: at the mouth")
        axes.plot(self.inserted, self.normal_sum, label=f"{self.drive}: of the wall, sum")
        axes.plot(self.inserted, self.normal_peak, label=f"{self.drive}: largest of one place")
        if math.isfinite(self.looped_at):
            axes.axvline(self.looped_at, color="C3", linestyle="--", label=f"{self.drive}: loops")
        axes.legend()
        return axes


def execute(
    drive: Drive,
    wall: LumenWall,
    *,
    line: Floats,
    dynamics: Dynamics | None = None,
    progress: Progress = no_progress,
) -> Execution:
    """Drive a robot through a lumen, step by step.

    Parameters
    ----------
    drive : Drive
        `PlanDrive`, `TendonDrive`, `PushDrive` or `ManoeuvreDrive`.
    wall : LumenWall
    line : (m, 3) float
        The way through the lumen, the entry first [mm].
    dynamics : Dynamics, optional
    progress : Progress

    Returns
    -------
    Execution
        It ends early where a link leaves the lumen.

    Raises
    ------
    InputError
        If the simulation is not stable.
    """
    dynamics = Dynamics() if dynamics is None else dynamics
    simulation = Simulation(drive.chain, wall, dynamics)
    simulation.place(drive.start)
    return _Run(drive, simulation, np.asarray(line, dtype=np.float64)).run(progress)


@dataclass(eq=False)
class _Run:
    """A motion under way."""

    drive: Drive
    simulation: Simulation
    line: Floats

    def __post_init__(self) -> None:
        self.arc = measure_arc_length(self.line)
        self.rows: list[tuple[float, ...]] = []
        self.joints: list[Floats] = []
        self.touched: list[Floats] = []
        self.largest = np.zeros(4)  # resultant, sum, peak, count since the last row
        self.least = math.inf
        self.touch: Touch | None = None
        self.push, self.noted = 0.0, 0
        self.progress = 0.0
        self.looped = math.nan, np.full(3, math.nan)
        self.why = ""
        self.findings: list[str] = []

    def run(self, progress: Progress) -> Execution:
        """Make all steps."""
        import time as clock

        simulation, drive = self.simulation, self.drive
        step = simulation.dynamics.step
        total = drive.duration + SETTLE_S
        steps, every = math.ceil(total / step), max(1, round(RECORD_S / step))
        begin, outside = clock.process_time(), False
        for k in range(1, steps + 1):
            control, rates = drive.command(k * step, simulation)
            simulation.step(control, rates)
            self._note()
            outside = simulation.least + drive.chain.radius < 0.0
            if k % every == 0 or k == steps or outside:
                self._record(k * step)
                progress("execute", k / steps)
                if self._is_over():
                    break
            if outside:
                self.why = (
                    f"a link is outside the lumen after {k * step:.2f} s, near "
                    f"{name_place(simulation.tightest)} mm"
                )
                break
        spent = clock.process_time() - begin
        return self._finish(outside, simulation.data.time / max(spent, 1e-9))

    def _is_over(self) -> bool:
        """Whether a motion without a time table has come to its end, or goes on after a loop."""
        timed = isinstance(self.drive, ManoeuvreDrive)
        if timed or self.drive.find_goal(self.rows[-1][0]) is not None:
            return False
        diameter = 2.0 * self.drive.chain.radius
        there = float(np.linalg.norm(self.joints[-1][0] - self.line[-1])) <= diameter
        return there or self.rows[-1][1] > self.looped[0] + ON_MM

    def _note(self) -> None:
        """Keep the largest forces since the last row."""
        simulation = self.simulation
        self.least = min(self.least, simulation.least)
        self.push += simulation.push_force
        self.noted += 1
        touch = simulation.touch
        if not len(touch.links):
            return
        found = np.array(
            [
                float(np.linalg.norm(touch.forces.sum(axis=0))),
                float(touch.normals.sum()),
                float(touch.normals.max()),
                float(len(touch.links)),
            ]
        )
        if self.touch is None or found[2] > self.largest[2]:
            self.touch = touch
        self.largest = np.maximum(self.largest, found)

    def _record(self, time: float) -> None:
        simulation = self.simulation
        joints = simulation.joints
        goal = self.drive.find_goal(time)
        error = math.nan if goal is None else float(np.linalg.norm(joints[0] - goal))
        self.progress = follow_way(self.line, self.arc, joints[0], before=self.progress)
        self.joints.append(joints)
        self.rows.append(
            (
                time, simulation.inserted, self.push / self.noted, *self.largest, self.least, error,
                self.progress, simulation.work,
            )
        )  # fmt: skip
        if self.touch is not None:
            touch = self.touch
            first = np.full(len(touch.links), len(self.rows) - 1.0)
            self.touched.append(
                np.column_stack([first, touch.links, touch.places, touch.forces, touch.normals])
            )
        self.largest, self.least, self.touch = np.zeros(4), math.inf, None
        self.push, self.noted = 0.0, 0
        if math.isnan(self.looped[0]):
            self._find_loop(joints)

    def _find_loop(self, joints: Floats) -> None:
        """Look for a tip that stands still while the base goes on, and for a body that runs back.

        A body runs back where a link in the lumen points against the way at its place, and lies
        behind what it passed before.
        """
        inserted, reached = self.rows[-1][1], self.progress
        chain = self.drive.chain
        span = STALLED_DIAMETERS * 2.0 * chain.radius
        table = np.array(self.rows)
        earlier = np.flatnonzero(table[:, 1] <= inserted - span)
        arrived = reached >= self.arc[-1] - 4.0 * chain.radius
        word = ""
        if len(earlier) and not arrived:
            before = table[int(earlier[-1])]
            going = np.diff(table[int(earlier[-1]) :, 1]).min() >= 0.0
            if going and reached - before[9] < STALLED * (inserted - before[1]):
                word = f"the tip no longer advances: it stays {reached:.0f} mm from the entry"
        depth = np.cumsum(np.concatenate([[0.0], chain.lengths[::-1]]))
        inside = depth[1:] < max(inserted - span, 0.0)
        if inside.any() and not word:
            middles = 0.5 * (joints[1:] + joints[:-1])[inside]
            ways = (joints[:-1] - joints[1:])[inside]
            gaps = np.linalg.norm(middles[:, None] - self.line[None], axis=2)
            place = np.argmin(gaps, axis=1)
            ahead = self.line[np.minimum(place + 1, len(self.line) - 1)]
            back = self.line[np.maximum(place - 1, 0)]
            along = np.sum((ahead - back) * ways, axis=1)
            arcs = self.arc[place][::-1]  # from the base to the tip
            folded = (np.maximum.accumulate(arcs) - arcs)[::-1]
            turned = np.flatnonzero((along < 0.0) & (folded > 4.0 * chain.radius))
            if len(turned):
                where = arcs[::-1][turned[-1]]
                word = f"the body runs back along the way, {where:.0f} mm from the entry"
        if word:
            inner = joints[: max(2, int(np.count_nonzero(depth < inserted)))]
            gaps = np.linalg.norm(inner[:, None] - self.line[None], axis=2).min(axis=1)
            self.looped = inserted, inner[int(np.argmax(gaps))].copy()
            self.why = self.why or (
                f"with {inserted:.0f} mm pushed in {word}; it is farthest off the way near "
                f"{name_place(self.looped[1])} mm"
            )

    def _finish(self, outside: bool, ratio: float) -> Execution:
        table = np.array(self.rows)
        wall, chain = self.simulation.wall, self.drive.chain
        last = float(np.linalg.norm(self.joints[-1][0] - self.line[-1]))
        complete = last <= 2.0 * chain.radius and not outside
        reason = self.why
        drive, converged = self.drive, complete and not math.isfinite(self.looped[0])
        steps: tuple[StepReport, ...] = ()
        if isinstance(drive, ManoeuvreDrive):
            steps, converged = tuple(drive.reports), not outside
        if not complete and not reason and not steps:
            reason = f"the tip ends {last:.1f} mm from the end of the way"
        if wall is not None and wall.options.kind == "prism":
            self.findings += wall.prisms.findings
        if self.simulation.unsettled:
            self.findings.append(
                f"the contact forces of {self.simulation.unsettled} steps did not settle: compare "
                "with a smaller step"
            )
        names = ("time", "inserted", "push_force", "resultant", "normal_sum", "normal_peak")
        columns = dict(zip(names, table.T[:6], strict=True))
        return Execution(
            drive=self.drive.name,
            **columns,
            contacts=table[:, 6].astype(np.int64),
            clearance=table[:, 7],
            tip_error=table[:, 8],
            tip_progress=table[:, 9],
            work=table[:, 10],
            complete=complete,
            outside=outside,
            looped_at=self.looped[0],
            looped_place=self.looped[1],
            speed_ratio=ratio,
            compliance=0.0 if wall is None else wall.options.compliance,
            converged=converged,
            reason=reason,
            residual=last,
            findings=tuple(self.findings),
            steps=steps,
            joints=np.array(self.joints),
            radius=chain.radius,
            touched=np.concatenate(self.touched) if self.touched else np.zeros((0, 9)),
        )
