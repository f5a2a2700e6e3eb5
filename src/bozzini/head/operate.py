"""Targets on the wall to touch, and what two cameras see meanwhile: on the tip, or still."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_kind, check_number, check_points, quantity
from ..duct.base import Duct
from ..effector.inverse import solve_inverse
from ..effector.section import find_bends
from ..motion.plan import Plan
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import ReasonedResult, Shown, format_rows, measured, rows_of, tabulated, take_axes
from ..task import Task
from ..vision.camera import Camera, aim_camera
from .anchor import Stand, Touches, list_insertions, list_touches, read_lumen, stand_head
from .check import ResultOfRows, head_field
from .choices import CAMERAS
from .design import Head, SectionPoses, read_head
from .shape import ROUND_OFF, make_camera_chains, make_chains, measure_gaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TOLERANCE = 5.0
"""A touch farther from the target than this is of something else [mm]."""
_SIZE = 480  # width and height of both pictures [px]
_APART = 10.0  # mm from one insertion that is looked at to the next
_CONTACT = 0.05  # a tip this near to the wall touches it [mm]
_STEP = 0.25  # mm of the tip from one picture to the next


@dataclass(frozen=True, kw_only=True)
class TouchRow:
    """A target that was touched.

    Parameters
    ----------
    target : int
        Which, from 1.
    time, path : float
        Since the one before [s], and what the instrument's tip has gone meanwhile [mm].
    error : float
        Distance of the tip from the target [mm].
    """

    target: int = tabulated()
    time: float = tabulated("s")
    path: float = tabulated("mm")
    error: float = tabulated("mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetRun(ResultOfRows, ReasonedResult):
    """Targets, and how they were touched.

    Attributes
    ----------
    targets : (n, 3) float
        World [mm].
    rows : tuple of TouchRow
    camera : str
        What was looked through, one of ``still`` and ``tip``; both if it was changed.
    time, path, error : float
        Of all touches: time [s], path of the tip, and the largest error [mm].
    reason : str
        What is left; empty if all are touched.
    """

    targets: Floats = measured("mm")
    rows: tuple[TouchRow, ...] = rows_of(TouchRow)
    camera: str
    time: float = measured("s")
    path: float = measured("mm")
    error: float = measured("mm")
    reason: str

    @property
    def residual(self) -> float:
        """The largest error at a touch [mm]."""
        return self.error

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the error at each touch, and return the axes."""
        axes = take_axes(ax, x="target", y="error at touch [mm]")
        axes.bar([row.target for row in self.rows], [row.error for row in self.rows])
        return axes

    def describe(self) -> str:
        """Return what people read of it."""
        words = (
            f"{len(self.rows)} of {len(self.targets)} targets touched in {self.time:.1f} s by a "
            f"way of {self.path:.0f} mm, to {self.error:.1f} mm at most; camera: {self.camera}"
        )
        return f"{words}\n{self.reason}" if self.reason else words


class TargetTask:
    """Targets that are touched one after the other: time, path and error.

    Time and path begin with the first move.

    Parameters
    ----------
    targets : (n, 3) float
        World [mm].
    """

    def __init__(self, targets: Floats) -> None:
        self.targets = check_points("targets", targets)
        self.rows: list[TouchRow] = []
        self._begin = self._path = 0.0
        self._tip: Floats | None = None
        self._touched = True

    @property
    def is_done(self) -> bool:
        """Whether all are touched."""
        return len(self.rows) == len(self.targets)

    def sum_up(self, camera: str) -> TargetRun:
        """Return how far it is, looked at through a camera."""
        rows, count = self.rows, len(self.targets)
        return TargetRun(
            targets=self.targets,
            rows=tuple(rows),
            camera=camera,
            time=sum(row.time for row in rows),
            path=sum(row.path for row in rows),
            error=max((row.error for row in rows), default=0.0),
            reason="" if self.is_done else f"{count - len(rows)} of {count} targets are left",
        )

    def change_instrument(self) -> None:
        """Go on with another tip: the way from tip to tip is none, nor a touch that lasts."""
        self._tip, self._touched = None, True

    def take(self, time: float, tip: Floats, *, touches: bool) -> None:
        """Take where the tip is at a time [s], and whether it touches the wall.

        A touch counts for the target of the turn, once, if it is within `TOLERANCE`.
        """
        if self._tip is not None:
            self._path += float(np.linalg.norm(tip - self._tip))
        if not self.rows and not self._path:
            self._begin = time
        self._tip = tip
        is_new, self._touched = touches and not self._touched, touches
        if not is_new or self.is_done:
            return
        error = float(np.linalg.norm(tip - self.targets[len(self.rows)]))
        if error <= TOLERANCE:
            self.rows.append(
                TouchRow(
                    target=len(self.rows) + 1,
                    time=time - self._begin,
                    path=self._path,
                    error=error,
                )
            )
            self._begin, self._path = time, 0.0


def look_from_tip(head: Head, poses: SectionPoses, index: int) -> Camera:
    """Return a conventional scope's camera in one of poses: at the first holder's end, in its way.

    View angle and size of the picture are those of `Head.look`.
    """
    eye, way = poses.holder_tip[index], poses.direction[index]
    focal = 0.5 * _SIZE / math.tan(0.5 * head.camera.view)
    down = -find_up(head, way)
    return aim_camera(eye, eye + way, focal=focal, size=(_SIZE, _SIZE), down=down)


def find_up(head: Head, way: Floats) -> Floats:
    """Return where up is for a camera on a tip that points in a way (3,).

    It is towards the head's arm where the section is straight, and is carried along as it bends.
    """
    out = np.array([math.cos(head.camera.azimuth), math.sin(head.camera.azimuth), 0.0])
    across = np.array([-way[1], way[0], 0.0])  # the axis about which +z turns into the way
    turned = np.cross(across, out) + across * (across @ out) / (1.0 + way[2])
    return np.asarray(way[2] * out + turned)  # Rodrigues' formula


@dataclass(frozen=True, kw_only=True)
class CameraRow(Shown):
    """What a camera's picture did while a scripted operator touched targets.

    Parameters
    ----------
    camera : str
        ``"still"``: the head's on its arm; ``"tip"``: at the end of the holder, as `look_from_tip`.
    time, path : float
        Of all [s], and what the instrument's tip has gone [mm]. The same for all cameras: the
        operator knows where the targets are and does not need the picture.
    turn_most, turn : float
        Farthest angle of the camera's axis from where it is at rest, and all that it turned [rad].
    shift : float
        Way that the target of the turn went in the picture, as far as it was in it [px].
    share_in_view : float
        Share of the time in which the target of the turn was in the camera's cone.
    """

    camera: str = tabulated()
    time: float = tabulated("s")
    path: float = tabulated("mm")
    turn_most: float = tabulated("rad")
    turn: float = tabulated("rad")
    shift: float = tabulated("px")
    share_in_view: float = tabulated()


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadComparison(ResultOfRows, ReasonedResult):
    """A scripted operator touches targets, seen by a still camera and by one on the tip.

    Attributes
    ----------
    head : Head
    stand : Stand
    insertion : float
        Where the head stands [mm].
    targets : (n, 3) float
        World [mm].
    tip : (k, 3) float
        Of the instrument, world [mm].
    rows : tuple of CameraRow
    touches : tuple of TouchRow
    error : float
        The largest at a touch [mm].
    camera_gap : float
        The least between the end-effector and the still camera on its arm [mm].
    reason : str
        Which target is not touched, or that the still camera is; empty if all is well.
    """

    head: Head
    stand: Stand
    insertion: float = measured("mm")
    targets: Floats = measured("mm")
    tip: Floats = field(repr=False)
    rows: tuple[CameraRow, ...] = rows_of(CameraRow)
    touches: tuple[TouchRow, ...]
    error: float = measured("mm")
    camera_gap: float = measured("mm")
    reason: str

    @property
    def residual(self) -> float:
        """The largest error at a touch [mm]."""
        return self.error

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the tip's way and the targets as the still camera's picture shows them."""
        axes = take_axes(ax, x="picture, to the right [px]", y="picture, down [px]", equal=True)
        camera = self.head.look(_SIZE)
        for places, look, label in (
            (self.tip, "-", "instrument's tip"), (self.targets, "o", "targets"),
        ):  # fmt: skip
            seen = camera.project((places - self.stand.origin) @ self.stand.frame)
            axes.plot(*seen.T, look, label=label)
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlim(0.0, _SIZE)
        axes.set_ylim(_SIZE, 0.0)
        axes.legend(fontsize="x-small")
        return axes


def compare_cameras(
    head: Head, stand: Stand, *, touches: Touches, duct: Duct, speed: float = 10.0
) -> HeadComparison:
    """Let a scripted operator touch targets; tell what a still camera and one on the tip see.

    From target to target he draws the instrument in, bends the section straight across, and slides
    the instrument out until it meets the wall, always at one speed of the tip. He knows the
    places: he neither waits nor searches, so time and path are those of the kinematics, and equal.

    Parameters
    ----------
    head : Head
        Its first end-effector is moved, the others rest.
    stand : Stand
    touches : Touches
        The targets; see `list_touches`.
    duct : Duct
        The lumen.
    speed : float
        Of the instrument's tip [mm/s].

    Raises
    ------
    InputError
        If the speed is not legal.
    """
    check_kind("head", head, Head)
    speed = check_number("speed", speed, low=0.1, high=1000.0, unit="mm/s")
    placed = head.effectors[0]
    bends, outs = _list_moves(touches, head)
    held = solve_inverse(placed.effector, bends)
    poses = placed.shape(find_bends(placed.effector, held.pressures))
    tips = poses.holder_tip + outs[:, None] * poses.direction
    world = stand.origin + tips @ stand.frame.T
    times = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(world, axis=0), axis=1))) / speed
    run, turn = TargetTask(touches.place), np.empty(len(world), dtype=np.int64)
    near = duct.signed_distance(world) >= -_CONTACT
    for k, (time, tip) in enumerate(zip(times, world, strict=True)):
        turn[k] = min(len(run.rows), len(run.targets) - 1)
        run.take(float(time), tip, touches=bool(near[k] and outs[k] > 0.0))
    own = make_chains(placed, poses)[:1]
    gap = float(measure_gaps(own, make_camera_chains(head)).min())
    seen = (run.targets[turn] - stand.origin) @ stand.frame
    still = head.look(_SIZE)
    cameras = {"still": [still] * len(world)}
    cameras["tip"] = [look_from_tip(head, poses, k) for k in range(len(world))]
    rows = []
    for name in CAMERAS:
        watched = _watch(cameras[name], seen, turn, view=head.camera.view)
        time = float(times[-1])
        rows.append(CameraRow(camera=name, time=time, path=speed * time, **watched))
    reason = ""
    if not run.is_done:
        reason = f"target {len(run.rows) + 1} is not touched"
    elif gap < -ROUND_OFF:
        reason = f"the end-effector and the still camera overlap by {-gap:.2f} mm on the way"
    return HeadComparison(
        head=head,
        stand=stand,
        insertion=stand.insertion,
        targets=run.targets,
        tip=world,
        rows=tuple(rows),
        touches=tuple(run.rows),
        error=max((row.error for row in run.rows), default=math.inf),
        camera_gap=gap,
        reason=reason,
    )


def _list_moves(touches: Touches, head: Head) -> tuple[Floats, Floats]:
    """Return bends (k, 2) of the backbone's end and ways out (k,), a picture each.

    To each target the section bends with the instrument drawn in; then that slides out and in.
    """
    placed = head.effectors[0]
    bends, outs = [np.zeros((1, 2))], [np.zeros(1)]
    for bend, out in zip(touches.bends, touches.out, strict=True):
        before = bends[-1][-1]
        ends = placed.shape(np.stack([before, bend])).holder_tip
        count = max(2, math.ceil(float(np.linalg.norm(ends[1] - ends[0])) / _STEP) + 1)
        bends.append(before + np.linspace(0.0, 1.0, count)[:, None] * (bend - before))
        outs.append(np.zeros(count))
        slide = np.linspace(0.0, out, max(2, math.ceil(out / _STEP) + 1))
        slide = np.concatenate([slide, slide[::-1]])
        bends.append(np.broadcast_to(bend, (len(slide), 2)))
        outs.append(slide)
    return np.concatenate(bends), np.concatenate(outs)


def _watch(
    cameras: Sequence[Camera], places: Floats, turn: NDArray[np.int64], *, view: float
) -> dict[str, float]:
    """Return how cameras (k) turn, and how a place (k, 3) of the turn goes in their pictures."""
    axes = np.array([camera.rotation for camera in cameras])
    away = np.einsum("kij,kj->ki", axes, places) + [camera.translation for camera in cameras]
    is_seen = away[:, 2] >= math.cos(0.5 * view) * np.linalg.norm(away, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = cameras[0].matrix[0, 0] * away[:, :2] / away[:, 2:]
    both = is_seen[1:] & is_seen[:-1] & (turn[1:] == turn[:-1])
    ahead = axes[:, 2]
    return {
        "turn_most": float(_measure_angles(ahead, ahead[:1]).max()),
        "turn": float(_measure_angles(ahead[1:], ahead[:-1]).sum()),
        "shift": float(np.linalg.norm(np.diff(pixels, axis=0)[both], axis=1).sum()),
        "share_in_view": float(is_seen.mean()),
    }


def _measure_angles(one: Floats, other: Floats) -> Floats:
    """Return angles between unit vectors (n, 3), exact for small ones [rad]."""
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(one - other, axis=1), 0.0, 1.0)))


@dataclass(frozen=True, kw_only=True)
class HeadComparing(Task):
    """Let a script touch targets on the wall; compare a still camera with one on the tip.

    PLAN is a plan's .npz, TRACT the file that it was made from. The targets are places that the
    instrument touches with nothing in the way, far from each other. The same moves are seen by the
    head's still camera, and by a camera of the same view at the end of the holder, which turns with
    it as on a conventional scope. The script knows the places and needs no picture: time and path
    are the same for both, and say nothing of how well people would do.

    Exit code 0: all targets are touched; 1: not, or the still camera is; 2: bad input.
    """

    name = "compare"
    group = "head"
    result = HeadComparison

    plan: str = quantity("file", "A plan (.npz).")
    tract: str = quantity("file", "The file that it was made from.")
    head: str | None = head_field()
    at: float | None = quantity(
        "length", "How far the scope is inserted; by default where most of the wall is touched.",
        default=None, low=0.0, high=1e6, example="275 mm",
    )  # fmt: skip
    targets: int = quantity(help="How many.", default=5, low=1, high=100, whole=True)
    speed: float = quantity("speed", "Of the instrument's tip.", default=10.0, low=0.1, high=1000.0)
    samples: int = quantity(
        help="Places of the backbone's end that are tried.", default=400, low=10, high=100_000,
        whole=True,
    )  # fmt: skip

    def run(self, progress: Progress = no_progress) -> HeadComparison:
        """Return what both cameras saw."""
        head, plan = read_head(self.head), Plan.load(self.plan)
        duct = read_lumen(plan, self.tract, progress)
        every = list_insertions(plan, step=_APART) if self.at is None else [self.at]
        stands = [stand_head(plan, at) for at in every]
        tried = []
        for k, stand in enumerate(stands):
            tried.append((stand, list_touches(head, stand, duct=duct, samples=self.samples)))
            progress("insertions", (k + 1) / len(stands))
        stand, found = max(tried, key=lambda pair: len(pair[1].place))
        chosen = found.choose(self.targets)
        return compare_cameras(head, stand, touches=chosen, duct=duct, speed=self.speed)

    def describe(self, found: HeadComparison) -> str:
        """Return what both cameras saw, as a table."""
        head = ["camera", "time [s]", "path [mm]", "turned at most [deg]", "in all [deg]",
                "target moved [px]", "target in view"]  # fmt: skip
        rows = [
            [row.camera, f"{row.time:.1f}", f"{row.path:.0f}", f"{math.degrees(row.turn_most):.1f}",
             f"{math.degrees(row.turn):.0f}", f"{row.shift:.0f}",
             f"{100.0 * row.share_in_view:.0f} %"]
            for row in found.rows
        ]  # fmt: skip
        return "\n".join(
            [
                f"{len(found.touches)} of {len(found.targets)} targets touched at "
                f"{found.insertion:.1f} mm of insertion, to {found.error:.2f} mm; pictures of "
                f"{_SIZE} x {_SIZE} px",
                format_rows(head, rows),
                "Time and path are those of the same moves; they say nothing of people",
                *filter(None, [found.reason]),
            ]
        )
