"""Quasi-static insertion: an elastic robot is pushed into a lumen, step by step.

With the inserted length ``S`` [mm] and the displacements ``q`` of the tendons from a table, each
step finds the shape of least energy ``E(S, q)`` of the part beyond the introducer
(`contact_solver`), from the shape before it: the unknowns are those of that solver, and what
remains from step to step are curvatures, contact forces, tensions, and places for friction. The
*push force* is ``dE/dS`` [N] with multipliers, loads and walls held (`measure_push`). A step
without an equilibrium is halved, down to 1/16, and tried once more from a shape between soft walls
of stiffness ``4 EI / (6 rho)^4``, rho being the body's radius.

*Buckled* and *looped* are read off the shapes: the body moves by more than 5 steps at once, by more
than 2 from a shape that lost its stability; it runs back along the path, or its tip goes on by
less than 5 % of the base's way. docs/theory/contact.md has the closed forms it is checked against.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..checks import check_array, check_number, check_path, check_points, check_range, show_apart
from ..errors import FileFormatError, InputError
from ..io.sheets import read_sheet, take_numbers
from ..numeric.arrays import Floats
from ..numeric.polylines import carry_frames, interpolate_polyline, measure_arc_length
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, measured, take_axes, to_plain
from .checks import check_frame, check_values
from .contact import ContactModel, ContactShape, draw_shapes
from .robot import RobotDesign

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ADVANCE_COLUMN = "base_advance_mm"
"""Column of a planner's table of drives: how far the base is moved in."""

STALLED = 0.05
"""A tip that goes on by less than this part of the base's way does not advance."""

STALLED_RADII = 2.0
"""Length over which that must be so, in radii of the body."""

ENTRY_RADII = 4.0
"""Length of the path that gives the direction of the introducer, in radii of the body."""

SMALLEST_STEP = 1.0 / 16.0
"""Smallest part of a step that is tried where the whole one has no equilibrium."""

SOFT_RADII = 6.0
"""Length over which a body gives way on a soft wall, in its radii: (4 EI / k)^(1/4)."""

JUMP, UNSTABLE_JUMP = 5.0, 2.0
"""A body that moves by more than this many steps at once has jumped: it has buckled.

The second one is for a shape whose predecessor lost its stability on the way.
"""

SHOWN_SHAPES = 12
"""Shapes of an insertion in one picture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveTable(Shown):
    """Commands of an insertion: how far the base is in, and the tendons, one row after another.

    Parameters
    ----------
    inserted : (r,) array_like
        Length of the robot beyond the introducer [mm].
    displacements : (r, t) array_like
        Of the tendons [mm]; between rows they change evenly. NaN follows without tension.
    frame : (4, 4) array_like, optional
        Base frame in the world where the introducer ends, as in a planner's ``robot.npz`` [mm]; by
        default the first point of the path and its direction.

    Raises
    ------
    InputError
        If the arrays do not go together.
    """

    inserted: Floats
    displacements: Floats
    frame: Floats | None = None

    def __post_init__(self) -> None:
        inserted = check_array("inserted", self.inserted)
        displacements = check_array("displacements", self.displacements)
        if inserted.ndim != 1 or not len(inserted) or len(displacements) != len(inserted):
            raise InputError(
                f"inserted has shape {inserted.shape} and displacements "
                f"{displacements.shape}: they must be (rows,) and (rows, tendons), rows from 1"
            )
        check_range("inserted", inserted, 0.0, np.finfo(np.float64).max, "mm")
        object.__setattr__(self, "inserted", inserted)
        object.__setattr__(self, "displacements", displacements)
        if self.frame is not None:
            frame = check_values("frame", self.frame, (4, 4))
            check_frame("frame", frame)
            object.__setattr__(self, "frame", frame)

    @classmethod
    def passive(cls, robot: RobotDesign, to: float) -> DriveTable:
        """Return an insertion to a length [mm] whose tendons follow without tension."""
        check_number("inserted", to, low=0.0, low_open=True, unit="mm")
        return cls(inserted=np.array([to]), displacements=np.full((1, len(robot.tendons)), np.nan))

    @classmethod
    def from_csv(cls, path: str | os.PathLike[str], robot: RobotDesign) -> DriveTable:
        """Read a planner's ``tendons.csv``: ``base_advance_mm``, and ``NAME_mm`` per tendon.

        Raises
        ------
        FileFormatError
            If it is no such table of this robot.
        """
        file = check_path("path", path)
        names = [ADVANCE_COLUMN, *(f"{name}_mm" for name in robot.tendon_names)]
        sheet = read_sheet(file)
        titles = [title.strip() for title in sheet.titles]
        missing = [name for name in names if name not in titles]
        if missing:
            raise FileFormatError(
                f"{file} has no column '{missing[0]}': a table of drives for robot "
                f"'{robot.name}' has {', '.join(names)}"
            )
        if not sheet.rows:
            raise FileFormatError(f"{file} has no rows")
        columns = [take_numbers(sheet, titles.index(name), where=f"{file}: ") for name in names]
        return cls(inserted=columns[0], displacements=np.stack(columns[1:], axis=-1))

    def list_steps(self, start: float, step: float) -> Iterator[tuple[float, Floats]]:
        """Give inserted lengths and displacements, at most `step` apart, from a length on [mm].

        Of rows nearer to each other, those are left out between which length goes on one way. Rows
        at lengths below `start` are passed over but for their displacements.
        """
        lengths, rows = np.maximum(self.inserted, start), self.displacements
        moved = np.nan_to_num(np.abs(np.diff(rows, axis=0))).max(axis=1, initial=0.0)
        ways = np.maximum(np.abs(np.diff(lengths)), moved)
        turns = np.append(np.diff(lengths[1:]) * np.diff(lengths[:-1]) < 0.0, True)
        before, held, way = start, rows[0], lengths[0] - start
        for index in range(len(rows)):
            last = index == len(rows) - 1
            if not last and way + ways[index] <= step and not (index and turns[index - 1]):
                way += ways[index]
                continue
            target, row = float(lengths[index]), rows[index]
            parts = max(1, math.ceil(way / step - 1e-9))
            known = np.isnan(held) | np.isnan(row)
            for part in range(1, parts + 1):
                fraction = part / parts
                between = np.where(known, row, held + fraction * (row - held))
                yield before + fraction * (target - before), between
            before, held, way = target, row, 0.0 if last else float(ways[index])


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionResult(Result):
    """A robot pushed into a lumen, in equilibrium at each step.

    Attributes
    ----------
    inserted : (s,) ndarray
        Length of the robot beyond the introducer [mm].
    push_force : (s,) ndarray
        Force on the base along the introducer [N]; see `ContactShape.push_force`.
    contact_force : (s,) ndarray
        Sum of the sizes of the walls' normal forces [N].
    largest_force : (s,) ndarray
        Largest force of a station [N].
    energy : (s,) ndarray
        Elastic energy of the backbone [N mm].
    stability : (s,) ndarray
        See `ContactShape.stability`.
    tip_progress : (s,) ndarray
        Where the tip stands along the path: arc length of its nearest place [mm].
    jump : (s,) ndarray
        Largest way of a point of the body in the step, against the step.
    buckled_at : float
        Inserted length where the body jumps to another shape for the first time [mm]; NaN if
        it does not.
    buckled_place : (3,) ndarray
        Where on the body, in the world, it moves most [mm]; NaN if it does not.
    looped_at : float
        Inserted length where the body first runs back along the path, or the tip no longer
        advances [mm]; NaN if it does not.
    shapes : tuple of ContactShape
        All steps.
    converged : bool
        Whether every step has an equilibrium, and the body neither buckles, loops nor meets
        itself.
    reason : str
    residual : float
        Largest of the shapes [mm].
    """

    robot: RobotDesign = field(repr=False)
    inserted: Floats = measured("mm")
    push_force: Floats = measured("N")
    contact_force: Floats = measured("N")
    largest_force: Floats = measured("N")
    energy: Floats = measured("N mm")
    stability: Floats = field()
    tip_progress: Floats = measured("mm")
    jump: Floats = field()
    buckled_at: float = measured("mm")
    buckled_place: Floats = measured("mm")
    looped_at: float = measured("mm")
    converged: bool = True
    reason: str = ""
    residual: float = measured("mm")
    shapes: tuple[ContactShape, ...] = field(repr=False)

    @property
    def last(self) -> ContactShape:
        """The last shape."""
        return self.shapes[-1]

    def list_columns(self) -> Mapping[str, NDArray[np.generic]]:
        """Return the columns of `to_frame`: a row for each step."""
        tips = np.array([shape.tip for shape in self.shapes])
        columns: dict[str, NDArray[np.generic]] = {
            "inserted_mm": self.inserted,
            "push_force_N": self.push_force,
            "contact_force_N": self.contact_force,
            "largest_force_N": self.largest_force,
            "energy_N_mm": self.energy,
            "stability": self.stability,
            "tip_progress_mm": self.tip_progress,
        }
        columns |= {f"tip_{axis}_mm": tips[:, k] for k, axis in enumerate("xyz")}
        for k, name in enumerate(self.robot.tendon_names):
            columns[f"{name}_N"] = np.array([shape.tensions[k] for shape in self.shapes])
        return columns

    def list_contacts(self) -> Mapping[str, NDArray[np.generic]]:
        """Return a table of all contact forces: a row for each touching station of each step."""
        parts: list[Floats] = []
        for shape in self.shapes:
            on = np.flatnonzero(shape.normal_forces > 0.0)
            first = np.full(len(on), shape.inserted)
            parts.append(
                np.column_stack(
                    [first, shape.arc_length[on], shape.points[on], shape.normal_forces[on],
                     shape.forces[on]]
                )
            )  # fmt: skip
        table = np.concatenate(parts)
        names = ["inserted_mm", "arc_length_mm", "x_mm", "y_mm", "z_mm", "normal_force_N"]
        names += [f"force_{axis}_N" for axis in "xyz"]
        return dict(zip(names, table.T, strict=True))

    def to_dict(self) -> Json:
        """Return the insertion as plain values; units are in the names. The last shape is whole."""
        return {**super().to_dict(), **to_plain({"last": self.last})}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw shapes on the way, the walls, and the forces on the last one; return the axes."""
        pick = np.unique(np.linspace(0, len(self.shapes) - 1, SHOWN_SHAPES).astype(np.int64))
        return draw_shapes([self.shapes[k] for k in pick], ax)

    def plot_force(self, ax: Axes | None = None) -> Axes:
        """Draw the force on the base and the walls' over the inserted length; return the axes."""
        axes = take_axes(ax, x="inserted [mm]", y="force [N]")
        axes.plot(self.inserted, self.push_force, label="on the base")
        axes.plot(self.inserted, self.contact_force, label="of the walls, sum of sizes")
        for place, word in ((self.buckled_at, "buckles"), (self.looped_at, "loops")):
            if math.isfinite(place):
                axes.axvline(place, color="C3", linestyle="--", label=word)
        axes.legend()
        return axes


def insert_robot(
    model: ContactModel,
    path: ArrayLike,
    *,
    drives: DriveTable | None = None,
    step: float | None = None,
    progress: Progress = no_progress,
) -> InsertionResult:
    """Push a robot into a lumen along a path, in equilibrium at each step.

    What is not inserted is straight in an introducer that ends at the first point of the path and
    has its direction there. Each step starts from the shape before it, which friction remembers.

    Parameters
    ----------
    model : ContactModel
        Robot and walls; the robot's own base pose is not used.
    path : (p, 3) array_like
        Points of the way into the lumen, such as its centreline, the entry first [mm].
    drives : DriveTable, optional
        Inserted lengths and tendon displacements; without it the whole robot is inserted, or as
        much as the path is long, and its tendons follow without tension.
    step : float, optional
        Largest step [mm]; by default the length of two segments.
    progress : Progress

    Returns
    -------
    InsertionResult
        It ends at the first step without an equilibrium, or where the body loops; where it buckles
        it goes on from the shape that it jumps to.

    Raises
    ------
    InputError
        If the path, the step or the table is not legal, or the body does not fit at the entry.
    """
    points = check_points("path", check_array("path", path))
    if points.ndim != 2 or len(points) < 2 or not np.linalg.norm(points[1] - points[0]) > 0.0:
        raise InputError(f"path has shape {points.shape}: it must be (p, 3), different points")
    placed = place_at_entry(model, points, None if drives is None else drives.frame)
    robot, arc = placed.robot, measure_arc_length(points)
    segment = float(np.diff(placed.stations).max())
    size = 2.0 * segment if step is None else check_number("step", step, low=1e-3, unit="mm")
    if drives is None:
        drives = DriveTable.passive(robot, min(robot.length, float(arc[-1])))
    if drives.displacements.shape[1] != len(robot.tendons):
        raise InputError(
            f"displacements have {drives.displacements.shape[1]} columns: robot '{robot.name}' has "
            f"{len(robot.tendons)} tendons"
        )
    most = float(drives.inserted.max())
    if most > robot.length * (1.0 + 1e-9):
        shown = show_apart(most, robot.length)
        raise InputError(
            f"inserted is {shown[0]} mm: it must be at most {shown[1]} mm, the robot's length"
        )
    return _Insertion(placed, points, size).run(drives, segment, progress)


def place_at_entry(model: ContactModel, points: Floats, frame: Floats | None) -> ContactModel:
    """Return the model with its base in a frame, or at the entry along the beginning of the path.

    Its x is then the world's axis most across that, as the planner's.
    """
    from scipy.spatial.transform import Rotation

    radius = model.robot.sections[-1].radius
    if frame is None:
        first = measure_arc_length(points) <= ENTRY_RADII * radius
        first[1] = True
        way = points[first].mean(axis=0) - points[0]
        frame = np.eye(4)
        frame[:3, :3] = carry_frames(way[None] / np.linalg.norm(way))[0]
        frame[:3, 3] = points[0]
    place = frame[:3, 3]
    turn = tuple(Rotation.from_matrix(frame[:3, :3]).as_rotvec().tolist())
    robot = dataclasses.replace(model.robot, base_position=tuple(place), base_rotation=turn)
    for wall in model.walls:
        gap = float(wall.measure(place[None], np.array([radius]))[0])
        if gap < 0.0:
            raise InputError(
                f"the path begins {radius + gap:.3g} mm from the wall: the body, of radius "
                f"{radius:g} mm, needs as much there"
            )
    return dataclasses.replace(model, robot=robot)


@dataclass(eq=False)
class _Insertion:
    """An insertion under way."""

    model: ContactModel
    points: Floats
    step: float
    shapes: list[ContactShape] = field(default_factory=list)
    jumps: list[float] = field(default_factory=list)
    reached: list[float] = field(default_factory=list)
    reason: str = ""
    buckled: tuple[float, Floats] = (math.nan, np.full(3, np.nan))
    looped: float = math.nan

    def run(self, drives: DriveTable, start: float, progress: Progress) -> InsertionResult:
        """Take all steps of a table."""
        steps = list(drives.list_steps(start, self.step))
        for index, (length, displacements) in enumerate(steps):
            progress("insert", index / len(steps))
            if not self._advance(length, displacements):
                break
        progress("insert", 1.0)
        return self._finish()

    def _advance(self, length: float, displacements: Floats) -> bool:
        """Take one step, in parts if the whole one fails; return whether to go on."""
        before = self.shapes[-1] if self.shapes else None
        reached, increment = 0.0, 1.0
        while True:
            fraction = min(1.0, reached + increment)
            there = length
            command = displacements
            if before is not None:
                there = before.inserted + fraction * (length - before.inserted)
                held = np.where(np.isnan(before.displacements), displacements, before.displacements)
                command = held + fraction * (displacements - held)
            shape = self._solve(command, there)
            good = shape.converged or shape.self_distance < 0.0
            if not (good or shape.locked or before is None) and increment > SMALLEST_STEP:
                increment *= 0.5
                continue
            self._keep(shape)
            reached = fraction
            if self.reason or reached == 1.0:
                return not self.reason

    def _solve(self, displacements: Floats, inserted: float) -> ContactShape:
        """Return the next shape; where it is not found at once, through one between soft walls."""
        model, initial = self.model, self.shapes[-1] if self.shapes else None
        shape = model.shape(displacements, inserted=inserted, initial=initial)
        met = shape.converged or shape.self_distance < 0.0
        if met or shape.locked or initial is None or model.options.friction > 0.0:
            return shape
        robot = model.robot
        bending = float(robot.stiffness_at(shape.arc_length)[:, 3].max())
        soft = 4.0 * bending / (SOFT_RADII * robot.radius) ** 4
        options = dataclasses.replace(model.options, wall_stiffness=soft)
        between = dataclasses.replace(model, options=options)
        initial = between.shape(displacements, inserted=inserted, initial=initial)
        if not initial.converged:
            return shape
        return model.shape(displacements, inserted=inserted, initial=initial)

    def _keep(self, shape: ContactShape) -> None:
        """Add a shape, and look for a jump, a loop, and a tip that stands still."""
        here = shape.inserted
        tips = self._project(shape.points[-1:])
        jump, worst = self._measure_jump(shape)
        self.shapes.append(shape)
        self.jumps.append(jump)
        self.reached.append(float(tips[0]))
        if not shape.converged:
            self.reason = f"at {here:.4g} mm: {shape.reason}"
        far = JUMP if not shape.left_unstable else UNSTABLE_JUMP
        if math.isnan(self.buckled[0]) and jump > far:
            self.buckled = here, shape.points[worst]
        if not math.isnan(self.looped) or self.reason:
            return
        words = self._find_loop(shape)
        if words:
            self.looped, self.reason = here, f"at {here:.4g} mm: {words}"

    def _measure_jump(self, shape: ContactShape) -> tuple[float, int]:
        """Return the largest way of a point against the step, and which point it is."""
        if not self.shapes:
            return 0.0, 0
        old = self.shapes[-1]
        before = np.stack(
            [np.interp(shape.arc_length, old.arc_length, row) for row in old.points.T], axis=1
        )
        motions = np.linalg.norm(shape.points - before, axis=1)
        worst = int(np.argmax(motions))
        pulled = np.nan_to_num(np.abs(shape.displacements - old.displacements)).max(initial=0.0)
        size = max(abs(shape.inserted - old.inserted), float(pulled), 0.1 * self.step)
        return float(motions[worst]) / size, worst

    def _find_loop(self, shape: ContactShape) -> str:
        """Return what is wrong where the body runs back, or its tip stands still."""
        inside = shape.arc_length >= shape.robot.length - shape.inserted
        points, tangents = shape.points[inside], shape.tangents[inside]
        places = self._project(points)
        arc = measure_arc_length(self.points)
        ahead = interpolate_polyline(self.points, arc, np.minimum(places + 0.5, arc[-1]))
        back = interpolate_polyline(self.points, arc, np.maximum(places - 0.5, 0.0))
        along = np.sum((ahead - back) * tangents, axis=1)
        turned = np.flatnonzero(along[:-1] < 0.0)
        folded = np.maximum.accumulate(places) - places
        radius = shape.robot.radius
        if len(turned) and folded.max() > STALLED_RADII * radius:
            first = int(turned[0])
            return (
                f"the body loops: at {shape.arc_length[inside][first]:.4g} mm of its length it "
                f"runs back along the path, {places[first]:.4g} mm from the entry"
            )
        base = np.array([item.inserted for item in self.shapes])
        span = STALLED_RADII * radius + 2.0 * self.step
        earlier = np.flatnonzero(base <= shape.inserted - span)
        arrived = self.reached[-1] >= arc[-1] - radius
        if len(earlier) and not arrived and np.all(np.diff(base[earlier[-1] :]) > 0.0):
            way = self.reached[-1] - self.reached[int(earlier[-1])]
            if way < STALLED * (shape.inserted - base[int(earlier[-1])]):
                return (
                    f"the tip no longer advances: it stays {self.reached[-1]:.4g} mm from the entry"
                )
        return ""

    def _project(self, points: Floats) -> Floats:
        """Return the arc lengths of the path's places nearest to points [mm]."""
        arc = measure_arc_length(self.points)
        start, directions = self.points[:-1], np.diff(self.points, axis=0)
        square = np.maximum(np.sum(directions**2, axis=1), 1e-300)
        fraction = np.einsum("psk,sk->ps", points[:, None] - start[None], directions) / square
        fraction = np.clip(fraction, 0.0, 1.0)
        near = start[None] + fraction[..., None] * directions[None]
        best = np.argmin(np.sum((points[:, None] - near) ** 2, axis=-1), axis=1)
        row = np.arange(len(points))
        return np.asarray(arc[best] + fraction[row, best] * np.sqrt(square[best]))

    def _finish(self) -> InsertionResult:
        shapes = self.shapes
        if not self.reason and math.isfinite(self.buckled[0]):
            place = ", ".join(f"{value:.4g}" for value in self.buckled[1])
            self.reason = (
                f"at {self.buckled[0]:.4g} mm: the body buckles: it jumps to another shape, most "
                f"at ({place}) mm"
            )
        return InsertionResult(
            robot=self.model.robot,
            inserted=np.array([shape.inserted for shape in shapes]),
            push_force=np.array([shape.push_force for shape in shapes]),
            contact_force=np.array([shape.normal_forces.sum() for shape in shapes]),
            largest_force=np.array([shape.normal_forces.max() for shape in shapes]),
            energy=np.array([shape.energy for shape in shapes]),
            stability=np.array([shape.stability for shape in shapes]),
            tip_progress=np.array(self.reached),
            jump=np.array(self.jumps),
            buckled_at=self.buckled[0],
            buckled_place=self.buckled[1],
            looped_at=self.looped,
            converged=not self.reason,
            reason=self.reason,
            residual=max(shape.residual for shape in shapes),
            shapes=tuple(shapes),
        )
