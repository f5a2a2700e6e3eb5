"""Live planning: a process of its own that plans anew whenever a window asks for it.

It is a process and no thread: compiled planning keeps Python's lock for up to a second, in which
neither frames would be sent nor a rig be given its set-points. A new request ends the work on the
one before at the next sign of progress.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..anatomy.frame import find_axis
from ..checks import check_number, floor_mm
from ..errors import BozziniError, InputError
from ..numeric.arrays import Floats
from ..progress import Progress
from ..results import Json
from ..study.options import InsertionOptions, PathOptions, ReadOptions
from .session import Outline, ShownPlan
from .wire import Change

if TYPE_CHECKING:
    from ..anatomy.tissue import TissueMotion
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..continuum import ContinuumRobot
    from ..duct import Centreline
    from ..duct.field import SampledField
    from ..motion import Plan, Scope
    from ..scene.view import View
    from ..study.case import Case, CasePlan

MOST_JOINTS = 1_000_000
"""Joints of all steps of a plan; beyond that the head steps farther."""
FRAME_RATE = 5.0
"""Of a tract that moves [Hz]."""
MOST_INFLATION = 10.0
"""By which the wall may be moved outwards in the page [mm]."""
MOST_WALLS = 4
"""Fields and drawings of the wall, differently inflated, that are kept."""
PATIENCE = 1.0
"""Time after which the windows are told that planning takes longer [s]."""
MOVED = {
    "held": "certified up to the next frame",
    "now": "certified now",
    "lost": "not certified",
    "refused": "not followed",
}
"""What is so of a plan while the tract moves, for people."""
CLICK_REACH = 1.0
"""A place this near to the wall, or a voxel farther, is a click on it [mm]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanningRequest:
    """What is planned for.

    Attributes
    ----------
    source : Path or None
        File of the tract; None for the phantom.
    reading : ReadOptions
    options : PathOptions
    scope : Scope
    robot : ContinuumRobot, optional
        A tendon robot that follows the plan.
    moving : str, optional
        How the tissue moves: ``"breathing"``, ``"peristalsis"`` or a file of displacements.
    """

    source: Path | None = None
    reading: ReadOptions
    options: PathOptions
    scope: Scope
    robot: ContinuumRobot | None = None
    moving: str | None = None

    def read(self) -> LabelTract | SurfaceTract:
        """Return the tract."""
        if self.source is not None:
            return self.reading.read(self.source)
        from ..study.case import open_phantom

        return open_phantom(seed=0)


class Superseded(Exception):  # noqa: N818  (no error, but a way out)
    """Something else is asked for by now."""


class Bench:
    """What plans of one tract share: its case, with what was changed in the page.

    Parameters
    ----------
    job : PlanningRequest
    progress : Progress
    """

    def __init__(self, job: PlanningRequest, progress: Progress) -> None:
        from ..study.case import Case

        progress("read", 0.0)
        self.job, self.tract = job, job.read()
        bodies = any(item.code == "cavities" for item in self.tract.findings)
        self.most = 0.0 if bodies else max(MOST_INFLATION, job.options.inflate)
        self._hear = progress
        options = InsertionOptions(**vars(job.options) | {"inflate": 0.0})
        self.rest = Case(tract=self.tract, options=options, progress=self._tell)
        _ = self.rest.field
        self.asked = Change(
            diameter=job.scope.diameter, link=job.scope.link_length, inflate=job.options.inflate
        )
        self._case_for: tuple[object, ...] = ()
        self._case = self.rest
        self._found: CasePlan | None = None
        self._whole: Centreline | None = None
        self._moved: tuple[Floats, Floats] | None = None
        self._beside = ThreadPoolExecutor(1)
        self._number = 0
        self._robot: tuple[Future[Json], Callable[[], ShownPlan]] | None = None
        self._inflated: dict[float, Case] = {}
        self._walls: dict[float, View] = {}
        self._sent: float | None = None
        self.refused: tuple[str, ...] = ()

    def _tell(self, stage: str, fraction: float) -> None:
        """Tell whoever waits for a plan how far it is."""
        self._hear(stage, fraction)

    @property
    def title(self) -> str:
        """What stands over the picture."""
        return f"Cockpit: {self.tract.source}"

    def _keep_legal(self, change: Change) -> Change:
        """Return what is legal of a change; `refused` says why the rest is not.

        Raises
        ------
        BozziniError
            If nothing of it is legal.
        """
        self.refused = ()
        try:
            self._prepare(merge(self.asked, change))
        except BozziniError as error:
            rest, legal, before = _list_given(change), Change(), None
            reasons: dict[str, str] = {"": str(error)}
            while rest and legal != before:  # what is legal may make more of it so
                before, reasons = legal, {}
                for name, value in rest.items():
                    tried = replace(legal, **{name: value})
                    try:
                        self._prepare(merge(self.asked, tried))
                    except BozziniError as reason:
                        reasons[name] = str(reason)
                    else:
                        legal = tried
                rest = {name: rest[name] for name in reasons}
            if legal == Change():
                raise InputError("; ".join(reasons.values())) from None
            self.refused = tuple(reasons.values())
            return legal
        return change

    def _prepare(self, asked: Change) -> tuple[Case, Scope]:
        """Return what is planned with; raise `BozziniError` if something of it is not legal."""
        from ..motion import Scope
        from ..motion.planner import check_link

        scope = Scope(
            diameter=asked.diameter or 0.0,
            link_length=asked.link or 0.0,
            length=self.job.scope.length,
        )
        case = self._find_case(asked)
        check_link(scope, case.line)
        joints = scope.count_links(case.line.length) + 1
        step = max(case.options.head_step, case.line.length * joints / MOST_JOINTS)
        return case.change(head_step=min(step, scope.link_length)), scope

    def plan(self, change: Change, progress: Progress) -> Iterator[ShownPlan]:
        """Plan for what is asked; give the plan, and again once more of it is known.

        What is not legal stays as it was asked before: `refused` then says why.

        Raises
        ------
        BozziniError
            If nothing of the change is legal.
        """
        begin, self._hear = time.perf_counter(), progress
        asked = merge(self.asked, self._keep_legal(self._settle(change)))
        case, scope = self._prepare(asked)
        self._number, self._robot = self._number + 1, None
        for found in case.list_plans(scope):
            self.asked, self._found = asked, found
            if not (asked.start or asked.end):
                self._whole = found.line
            seconds = time.perf_counter() - begin
            yield self._show(found, seconds, final=found.final)
        robot, moving = self.job.robot, self.job.moving
        if robot is None or found.plan.status != "complete":
            return
        if moving is None:
            yield self._show(found, seconds, robot=self._follow(found, progress))
        else:  # beside the motion of the tract: see `follow`
            work = self._beside.submit(self._follow, found, self._make_end())
            self._robot = work, lambda: self._show(found, seconds, robot=work.result())

    def _make_end(self) -> Progress:
        """Return a progress for work beside, which ends once another plan is asked for."""
        number = self._number

        def go_on(stage: str, fraction: float) -> None:
            if number != self._number:
                raise Superseded

        return go_on

    def take_robot(self) -> ShownPlan | None:
        """Return the plan with the robot that follows it, once it is known; else None."""
        if self._robot is None or not self._robot[0].done():
            return None
        (_, show), self._robot = self._robot, None
        return show()

    def explain_rest(self) -> str:
        """Return why a tract that could move does not; empty if it does, or cannot."""
        if self.job.moving is None or self._found is None or self._completes:
            return ""
        return "the tract does not move: the scope does not reach its goal"

    @property
    def _completes(self) -> bool:
        return self._found is not None and self._found.plan.status == "complete"

    def follow(self) -> Iterator[tuple[ShownPlan, Floats]]:
        """Keep the scope clear while the tissue moves; give the body and the wall's vertices.

        Nothing is given if there is no motion, or no plan to the goal. What a robot does is found
        out meanwhile, see `take_robot`: that takes long.
        """
        from ..anatomy.tract import SurfaceTract
        from ..motion.live import LiveOptions, follow_tissue

        found, self._moved = self._found, None
        if self.job.moving is None or found is None or not self._completes:
            return
        plan, field = found.plan, found.field
        motion = make_motion(self.job.moving, found.line, found.case)
        surface = self.tract if isinstance(self.tract, SurfaceTract) else None
        rest = self.view_wall(field).surfaces[0].vertices
        options = LiveOptions(rate=FRAME_RATE, duration=1e5)
        begin = time.monotonic()
        for frame in follow_tissue(
            plan,
            field,
            motion=motion,
            surface=surface,
            options=options,
        ):
            inside = frame.head - plan.get_scope().link_length * np.arange(plan.links) > 0.0
            known = np.nan if frame.clearance is None else frame.clearance
            proved = "" if frame.clearance is None else f", {frame.clearance:.2f} mm proved"
            info = {
                "status": frame.status,
                "reason": frame.reason,
                "proved_mm": frame.clearance,
                "words": f"The tract moves: {MOVED[frame.status]}{proved}.",
            }
            body = ShownPlan(
                view=b"",
                joints=frame.body[None].astype(np.float32),
                clearance=np.where(inside, known, np.nan)[None].astype(np.float32),
                travel=np.array([frame.head]),
                radius=plan.get_scope().radius,
                info=info,
            )
            shift = motion.at(frame.time)(rest)
            self._moved = rest + shift, shift
            yield body, self._moved[0]
            time.sleep(max(begin + frame.time - time.monotonic(), 0.0))

    def _find_case(self, asked: Change) -> Case:
        """Return the case with what is asked for; an end that was not moved stays."""
        wanted = (asked.inflate, asked.start, asked.end)
        if self._case_for != wanted:
            case, options = self._inflate(asked.inflate), self.job.options
            if asked.start or asked.end:
                whole = (self._whole or case.line).points
                case = case.change(
                    start=asked.start or whole[0],
                    end=asked.end or whole[-1],
                    via=options.via[::-1] if options.reverse else options.via,
                    reverse=False,
                )
            self._case, self._case_for = case, wanted
        return self._case

    def _inflate(self, inflation: float | None) -> Case:
        """Return the case with the wall moved outwards; the last few are kept."""
        inflation = check_number("inflation", inflation or 0.0, low=0.0, high=self.most, unit="mm")
        if inflation == 0.0:
            return self.rest
        if inflation not in self._inflated:
            if len(self._inflated) == MOST_WALLS:
                del self._inflated[next(iter(self._inflated))]
            self._inflated[inflation] = self.rest.change(inflate=inflation)
        return self._inflated[inflation]

    def _settle(self, change: Change) -> Change:
        """Return a change whose ends are in the lumen, beside the wall that was clicked."""
        inflation = self.asked.inflate if change.inflate is None else change.inflate
        inflation = min(inflation or 0.0, self.most)  # more is refused later

        def settle(place: tuple[float, ...] | None) -> tuple[float, ...] | None:
            if place is None:
                return None
            case, click = self._inflate(inflation), np.array(place)
            field = case.field
            if self._moved is not None:  # the wall was seen where the tissue had moved it to
                seen, shift = self._moved
                click -= shift[int(np.argmin(np.linalg.norm(seen - click, axis=1)))]
            if abs(float(field.signed_distance(click))) <= CLICK_REACH + field.spacing.max():
                click = find_beside(field, self._whole or case.line, click)
            return tuple(click.tolist())

        return replace(change, start=settle(change.start), end=settle(change.end))

    def _follow(self, found: CasePlan, progress: Progress) -> Json:
        """Return what a robot's tendons do along a plan."""
        from ..motion.actuate.actuate import actuate_plan

        robot = self.job.robot
        if robot is None:
            return {}
        plan = found.plan
        moved = actuate_plan(plan, robot, found.duct, progress=progress)
        moves = [
            np.interp(plan.head_arc_length, moved.head_arc_length, column)
            for column in moved.displacements.T
        ]
        return {
            "name": robot.name,
            "fits": moved.fits,
            "reason": moved.reason,
            "tendons": list(robot.tendon_names),
            "moves": np.stack(moves, axis=1),
        }

    def _show(
        self,
        found: CasePlan,
        seconds: float,
        *,
        final: bool = True,
        robot: Json | None = None,
    ) -> ShownPlan:
        """Return a plan as the windows need it."""
        robot = robot or {}
        line, field = found.line, found.field
        plan = replace(found.plan, centreline=line)
        moves = robot.pop("moves", np.zeros((plan.steps, 0)))
        inflation = field.inflation
        wall = field if self._sent != inflation else None
        self._sent = inflation
        joints = plan.joints.astype(np.float32)
        known = np.isfinite(plan.clearance)
        info = _describe(plan, self.asked, seconds) | {
            "final": final,
            "entry_mm": line.points[0].round(2).tolist(),
            "goal_mm": line.points[-1].round(2).tolist(),
            "centreline_mm": round(line.length, 1),
            "inflate_most_mm": self.most,
            "robot": robot or None,
            "verdict": self._judge(found) if plan.status == "complete" else {},
        }
        frame = getattr(self.tract, "frame", None)
        shown = ShownPlan(
            view=self._encode(plan, field),
            joints=joints,
            clearance=np.where(known, plan.clearance, np.nan).astype(np.float32),
            travel=np.r_[0.0, np.cumsum(np.abs(np.diff(plan.head_arc_length)))],
            radius=plan.get_scope().radius,
            wall=wall,
            tendons=moves,
            info=info | put_into_words(info),
            outline=self._outline(found),
            up=find_axis(frame or "RAS", "A"),
            is_mirrored=frame is not None and _is_mirrored(frame),
        )
        _ = shown.frames  # made here, not in the server's event loop
        return shown

    def _outline(self, found: CasePlan) -> Outline:
        wall = self.view_wall(found.field).surfaces[0]
        frame = getattr(self.tract, "frame", None)
        return Outline(
            vertices=wall.vertices, faces=wall.faces, line=found.line.points, frame=frame
        )

    def _judge(self, found: CasePlan) -> Json:
        """Return the verdict on a plan, as reports and commands state it."""
        from ..report.verdict import judge_plan

        ends = found.centreline
        summary = {
            "unreached": [part.describe() for part in found.unreached],
            "unreached_share": found.unreached_share,
            "goal": {"name": ends.goal, "given": ends.given, "chosen": ends.goal_given},
            "wall_error_mm": found.field.wall_error,
            "source_error_mm": getattr(self.tract, "source_error", None),
            "findings": [asdict(item) for item in self.tract.findings],
        }
        verdict = judge_plan(found.plan, summary)
        return {"tone": verdict.tone, "label": verdict.label}

    def view_wall(self, field: SampledField | None = None) -> View:
        """Return the wall to look at, as it is inflated in a field."""
        from ..anatomy.tract import SurfaceTract
        from ..scene.make_view import make_view

        field = self.rest.field if field is None else field
        inflation = field.inflation
        if inflation not in self._walls:
            is_surface = isinstance(self.tract, SurfaceTract) and inflation == 0.0
            if len(self._walls) == MOST_WALLS:
                del self._walls[next(iter(self._walls))]
            self._walls[inflation] = make_view(self.tract if is_surface else field)
        return self._walls[inflation]

    def _encode(self, plan: Plan, field: SampledField) -> bytes:
        """Return what the page draws: the plan, in the wall."""
        from ..scene.make_view import view_plan
        from ..scene.view import encode_view

        view = view_plan(plan, self.view_wall(field), title=self.title)
        return encode_view(replace(view, axes=getattr(self.tract, "frame", None)))


def find_beside(field: SampledField, line: Centreline, click: Floats) -> Floats:
    """Return the place in the lumen beside a place of its wall.

    It is the nearest of the line that is seen from the middle of the ball that touches the wall
    there; that middle, away from the line.

    Parameters
    ----------
    field : SampledField
        The lumen.
    line : Centreline
    click : (3,) float
        On the wall, or near it [mm].
    """
    step = float(field.spacing.min())
    along = np.arange(0.0, 2.0 * float(line.radius.max()), 0.25 * step)[:, None]
    ray = click - along * field.gradient(click)
    depth = -field.signed_distance(ray)
    falls = np.flatnonzero(depth < np.maximum.accumulate(depth) - 0.5 * step)
    middle = ray[int(np.argmax(depth[: falls[0]] if len(falls) else depth))]
    gaps = np.linalg.norm(line.points - click, axis=1)
    near = line.points[gaps <= 2.0 * line.radius]
    way = np.linspace(0.0, 1.0, 33)[:, None, None] * (near - middle)
    seen = near[(field.signed_distance(middle + way) < 0.0).all(axis=0)]
    if not len(seen):
        return np.asarray(middle)
    return np.asarray(seen[int(np.argmin(np.linalg.norm(seen - click, axis=1)))])


def make_motion(name: str, line: Centreline, case: Case) -> TissueMotion:
    """Return a motion of the tissue by its name, or from a file (.npz).

    Raises
    ------
    InputError
        If it is none, or the file cannot be read.
    """
    from ..anatomy.tissue import Breathing, Peristalsis, RecordedMotion

    if name == "breathing":
        low, high = case.field.bounds
        return Breathing.of_organ(case.tract.organ, (float(low[2]), float(high[2])))
    if name == "peristalsis":
        return Peristalsis(line=line.points)
    return RecordedMotion.load(name)


def merge(asked: Change, change: Change) -> Change:
    """Return what is asked for after a change."""
    return replace(asked, **_list_given(change))


def _list_given(change: Change) -> Json:
    """Return what a change gives, by its name."""
    given = {f.name: getattr(change, f.name) for f in fields(change)}
    return {name: value for name, value in given.items() if value is not None}


def _describe(plan: Plan, asked: Change, seconds: float) -> Json:
    """Return what the page says of a plan."""
    refusal = plan.refusal
    fits = {
        name: getattr(refusal, name)
        for name in ("diameter_max", "link_max", "inflate")
        if getattr(refusal, name, None) is not None
    }
    return {
        "status": plan.status,
        "certified": plan.certified,
        "proved_mm": plan.proved,
        "reason": plan.reason,
        "reason_code": plan.reason_code,
        "would_fit_mm": fits,
        "diameter_mm": asked.diameter,
        "link_mm": asked.link,
        "inflate_mm": asked.inflate,
        "start_mm": asked.start,
        "end_mm": asked.end,
        "inserted_mm": round(plan.inserted, 1),
        "links": plan.links,
        "method": plan.method,
        "seconds": round(seconds, 2),
    }


def put_into_words(info: Json) -> dict[str, str]:
    """Return the words of what is known of a plan, and their tone."""
    if info["status"] == "stopped":
        reason = info["reason"]
        return {"words": f"{reason[0].upper()}{reason[1:]}.", "tone": "stopped"}
    if not info["certified"]:
        return {"words": "Reaches the goal; no clearance is proved.", "tone": "open"}
    label = info["verdict"].get("label", "Fits")
    words = (
        f"{label}: {floor_mm(info['proved_mm'])} mm of clearance proved over "
        f"{info['inserted_mm']} mm, in {info['seconds']} s."
    )
    return {"words": words, "tone": "fits" if info["verdict"].get("tone") == "green" else "open"}


def _is_mirrored(frame: str) -> bool:
    """Return whether axes in the patient are left-handed."""
    right, front, top = (find_axis(frame, side) for side in "RAS")
    return bool(np.cross(right, front) @ top < 0.0)


def work(pipe: Connection, job: PlanningRequest, first: Change) -> None:
    """Plan whatever comes through a pipe, until it is closed: the process's main function."""
    from ..scene.view import encode_view

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server ends it
    last = [0.0]

    def report(stage: str, fraction: float) -> None:
        if pipe.poll():
            raise Superseded
        if time.monotonic() - last[0] > 0.1:
            last[0] = time.monotonic()
            pipe.send(("progress", stage))

    def tell_robot(bench: Bench) -> None:
        try:
            if shown := bench.take_robot():
                pipe.send(("plan", shown))
        except BozziniError as error:
            pipe.send(("refused", str(error)))

    def take() -> Change:
        change: Change = pipe.recv()
        pipe.send(("taken", ""))
        return change

    try:
        pending = first
        bench = None
        while True:
            try:
                if bench is None:
                    bench = Bench(job, report)
                    wall = replace(bench.view_wall(), title=bench.title)
                    pipe.send(("scene", encode_view(wall)))
                try:
                    for shown in bench.plan(pending, report):
                        pipe.send(("plan", shown))
                    refused = "; ".join(bench.refused)
                except BozziniError as error:
                    refused = str(error)
                pipe.send(("refused", refused) if refused else ("done", bench.explain_rest()))
                pending = Change()
                for moved in bench.follow():
                    tell_robot(bench)
                    pipe.send(("moved", moved))
                    if pipe.poll():
                        break
            except Superseded:
                pass
            except BozziniError as error:
                pipe.send(("refused", str(error)))
                pending = Change()
            pending = merge(pending, take())
            while pipe.poll():
                pending = merge(pending, take())
    except (EOFError, BrokenPipeError, ConnectionResetError):  # the server has gone
        return


class Planning:
    """The server's end: the process, and a thread that hears what it says.

    A change is sent once the one before was taken, and until then added to what waits: so sending
    never blocks, even if the process does not read.

    Parameters
    ----------
    job : PlanningRequest
    hear : callable
        Is given each message, in the thread: its kind and what belongs to it. ``"lost"`` is the
        last one of a process that has ended; the next change starts another.
    """

    def __init__(self, job: PlanningRequest, hear: Callable[[str, Any], None]) -> None:
        self._job, self._hear = job, hear
        self._lock = threading.Lock()
        self._waiting: Change | None = None
        self._sent: Change | None = None
        self._shown = Change()
        self._closing = False
        self._start(Change())

    def _start(self, first: Change) -> None:
        """Start a process, which plans for `first`, and a thread that hears it."""
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=work, args=(other, self._job, first), daemon=True)
        # An interrupt of the terminal reaches the process before it could ignore it.
        before = None
        if threading.current_thread() is threading.main_thread():
            before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            self._process.start()
        finally:
            if before is not None:
                signal.signal(signal.SIGINT, before)
        other.close()
        self._is_lost = False
        self._thread = threading.Thread(target=self._listen, name="planning", daemon=True)
        self._thread.start()

    def ask(self, change: Change) -> bool:
        """Let something else be planned; return whether by another process, as one has ended."""
        with self._lock:
            self._waiting = merge(self._waiting or Change(), change)
            if not self._is_lost:
                self._send()
                return False
        return self.start_again()

    def start_again(self) -> bool:
        """Start another process if the last one has ended and a change waits."""
        with self._lock:
            if self._closing or not self._is_lost or self._waiting is None:
                return False
            first, self._waiting = merge(self._shown, self._waiting), None
            self._pipe.close()
            self._start(first)
            return True

    def _send(self) -> None:
        """Send what waits, unless what was sent before is not taken yet."""
        if self._sent is None and self._waiting is not None:
            self._sent, self._waiting = self._waiting, None
            with suppress(OSError):  # the thread hears that it has ended
                self._pipe.send(self._sent)

    def close(self) -> None:
        """End the process."""
        self._closing = True
        self._process.terminate()
        self._process.join(1.0)
        if self._process.is_alive():  # it is stopped
            self._process.kill()
            self._process.join(1.0)
        self._thread.join(1.0)
        self._pipe.close()

    def _listen(self) -> None:
        pipe = self._pipe
        while True:
            try:
                kind, what = pipe.recv()
            except (EOFError, OSError):
                break
            if kind == "plan":
                self._shown = _recall(what.info)
            if kind == "taken":
                with self._lock:
                    self._sent = None
                    self._send()
            else:
                self._hear(kind, what)
        if self._closing:
            return
        self._process.join(1.0)
        with self._lock:  # what it has not taken has not ended it
            if self._sent is not None:
                self._waiting = merge(self._sent, self._waiting or Change())
            self._is_lost, self._sent = True, None
        self._hear("lost", _explain_end(self._process.exitcode))


def _recall(info: Json) -> Change:
    """Return what a plan was asked for with."""
    return Change(**{f.name: info[f"{f.name}_mm"] for f in fields(Change)})


def _explain_end(code: int | None) -> str:
    """Return that the planning process has ended, and how."""
    how = "" if code is None else f" (exit code {code})"
    if code is not None and code < 0:
        how = f" (signal {-code}: {signal.strsignal(-code)})"
    return f"the planning process has ended{how}"
