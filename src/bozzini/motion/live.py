"""A closed loop: the tract moves, the scope stands in it, and its motion is planned in every frame.

In each frame the distance to the moved wall is made anew near the path, the body is moved with the
tissue, and the body and the next stretch of its way are certified. The rest of the way follows
where the frame leaves time for it. A frame's certificate is for the wall at the frame's time; up to
the next one the wall moves by at most its speed over the rate: the margin.

Between two frames that were not refused the scope is taken to move so. If the head moves on, it
follows the plan of the first of the two, and is there by half of the time. In the second half, or
in all of the time if the head stays, the joints move straight and at constant speed to where the
second frame finds them in the moved tissue. Compared with the wall of another time, the scope
loses the speed of the tissue times the time between.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..anatomy.tissue import TissueFrame, TissueMotion
from ..checks import check_fields, floor_beside, floor_mm, quantity
from ..duct.base import SampledField
from ..duct.deformation import Displacement, carry_tissue
from ..duct.moving import MovedField, MovingField
from ..errors import DeformationError, InputError
from ..numeric.arrays import Floats
from ..results import Json, Result, Shown, rows_of, tabulated, take_axes
from .certify import certify_motion, find_waiting
from .moving import ReplanOptions, cut_ahead, replan
from .plan import Plan
from .space import FreeSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..anatomy.tract import SurfaceTract


FrameStatus = Literal["held", "now", "lost", "refused"]
"""Certified until the next frame, the scope standing or on its plan; certified for the frame's time
alone; not certified; not planned, because the tissue moves otherwise than stated. How the tissue
carries the scope on is known in the next frame: see `LiveFrame.carried` and `LiveRun.collect`."""


@dataclass(frozen=True, kw_only=True)
class LiveOptions:
    """How fast the loop runs, and how the scope moves in it.

    Parameters
    ----------
    rate : float
        Frames per second [Hz].
    duration : float, optional
        By default one period of the tissue's motion [s].
    horizon : float
        The next stretch of the way, certified in every frame [mm].
    advance : float
        How fast the head moves on [mm/s].
    inserted : float
        Share of the way at which the head stands when the loop begins.
    """

    rate: float = quantity("frequency", "Frames per second.", low=0.1, high=1000.0, default=30.0)
    duration: float | None = quantity(
        "time", "How long.  [default: one period of the motion]", low=1e-3, high=1e5, default=None
    )
    horizon: float = quantity(
        "length",
        "Next stretch, certified in every frame.",
        low=0.0,
        high=1e4,
        default=30.0,
        by_name=True,
    )
    advance: float = quantity(
        "speed", "How fast the head moves on.", low=0.0, high=1e3, default=5.0, by_name=True
    )
    inserted: float = quantity(
        help="Share of the way at which the head begins.", low=0.0, high=1.0, default=0.5
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveFrame(Shown):
    """What came of one frame.

    Parameters
    ----------
    number : int
        0 for the first.
    time : float
        Since the loop began, of the tissue's motion [s].
    status : {"held", "now", "lost", "refused"}
        See `FrameStatus`.
    clearance : float or None
        Certified for the body and the next stretch, the wall standing as in this frame [mm].
    carried : float or None
        Certified at all times since the last frame that was not refused, while wall and body moved
        on to this one [mm]; None where there is none. Negative: contact is not excluded.
    margin : float
        What the wall may do until the next frame: its speed over the rate [mm]. Where frames were
        refused, what it may do from the last one that was not, whose plan is still valid.
    rest : float or None
        Certified for the whole way from the body to the goal, as `clearance` [mm]; None where
        the frame left no time for it, or it is not certified.
    head : float
        Arc length of the head along its path [mm].
    ahead : float
        How far ahead of the head the certificate reaches [mm]: 0 where the next stretch could not
        be planned, and only the body is kept clear.
    latency : float
        From the frame's displacement to the certificate [s].
    field_time, plan_time, rest_time : float
        Of it for the field and for the plan, and for the rest of the way afterwards [s].
    sweeps : int
        Of the elastic band.
    band, measured : int
        Nodes of the field, and how many of them were measured.
    tissue_move : float
        How far the path's tissue moved since the last frame [mm].
    reason : str
        Why it is not "held", or why nothing ahead is planned; empty otherwise.
    plan : Plan
        The plan that is valid now.
    step, next_step : int
        At which step of it the body stands, the first but where the frame was refused, and to which
        the head moves on until the next frame.
    field : SampledField or None
        The lumen it is certified in; None where the frame was refused, and in a `LiveRun`.
    """

    number: int = tabulated(name="frame")
    time: float = tabulated("s")
    status: FrameStatus = tabulated()
    clearance: float | None = tabulated("mm", default=None)
    carried: float | None = tabulated("mm", default=None)
    margin: float = tabulated("mm", default=0.0)
    rest: float | None = tabulated("mm", default=None)
    head: float = tabulated("mm", default=0.0)
    ahead: float = tabulated("mm", default=0.0)
    latency: float = tabulated("s", default=0.0)
    field_time: float = tabulated("s", "field", default=0.0)
    plan_time: float = tabulated("s", "plan", default=0.0)
    rest_time: float = tabulated("s", "rest", default=0.0)
    sweeps: int = tabulated(default=0)
    band: int = tabulated(name="band_nodes", default=0)
    measured: int = tabulated(name="measured_nodes", default=0)
    tissue_move: float = tabulated("mm", default=0.0)
    reason: str = tabulated(default="")
    plan: Plan = dataclass_field(repr=False)
    step: int = 0
    next_step: int = 0
    field: SampledField | None = dataclass_field(default=None, repr=False)

    @property
    def body(self) -> Floats:
        """The joints as they stand after the tissue has moved (joints, 3), world frame [mm]."""
        return np.asarray(self.plan.joints[self.step])


@dataclass(frozen=True, kw_only=True, eq=False)
class LiveRun(Result):
    """All frames of a loop.

    Parameters
    ----------
    frames : tuple of LiveFrame
    rate : float
        Frames per second [Hz].
    speed : float
        No tissue is faster than this [mm/s].
    """

    frames: tuple[LiveFrame, ...] = rows_of(LiveFrame)
    rate: float
    speed: float

    def __post_init__(self) -> None:
        if not self.frames:
            raise InputError("the run has no frame: give at least one")

    @classmethod
    def collect(cls, frames: Iterable[LiveFrame], *, rate: float, motion: TissueMotion) -> LiveRun:
        """Run a loop to its end, and keep its frames without their fields, which are large.

        A frame is no longer "held" where the next one could not certify how the scope came there.
        """
        kept: list[LiveFrame] = []
        for frame in frames:
            if frame.carried is not None and frame.carried < 0.0:
                status, reason = _judge_move(frame.carried)
                known = [k for k, one in enumerate(kept) if one.status != "refused"]
                for last in known[-1:]:
                    if kept[last].status == "held":
                        kept[last] = replace(kept[last], status=status, reason=reason)
            kept.append(replace(frame, field=None))
        return cls(frames=tuple(kept), rate=rate, speed=motion.speed)

    def count(self, status: FrameStatus) -> int:
        """Return how many frames have a status."""
        return sum(frame.status == status for frame in self.frames)

    @property
    def latencies(self) -> Floats:
        """Of all frames [s]."""
        return np.array([frame.latency for frame in self.frames])

    @property
    def worst(self) -> float | None:
        """The smallest clearance certified in a frame [mm]; None if one has none."""
        found = [frame.clearance for frame in self.frames]
        known = [value for value in found if value is not None]
        return min(known) if len(known) == len(found) else None

    @property
    def worst_between(self) -> float | None:
        """The smallest clearance certified from one frame to the next [mm]; None if there is none.

        Negative: contact between frames is not excluded.
        """
        return min((f.carried for f in self.frames if f.carried is not None), default=None)

    @property
    def converged(self) -> bool:
        """Whether every frame's certificate holds until the next frame."""
        return self.count("held") == len(self.frames)

    @property
    def reason(self) -> str:
        """Why not, from the first frame that is the worst."""
        for status in ("refused", "lost", "now"):
            for frame in self.frames:
                if frame.status == status:
                    return f"frame {frame.number} at {frame.time:.2f} s: {frame.reason}"
        return ""

    @property
    def residual(self) -> float:
        """Share of the frames whose certificate does not hold until the next one."""
        return 1.0 - self.count("held") / len(self.frames)

    def to_dict(self) -> Json:
        """Return a summary as plain values."""
        late = self.latencies > 1.0 / self.rate
        return {
            "frames": len(self.frames),
            **{f"frames_{name}": self.count(name) for name in ("held", "now", "lost", "refused")},
            "frames_late": int(late.sum()),
            "rate_Hz": self.rate,
            "speed_mm/s": self.speed,
            "margin_mm": self.speed / self.rate,
            "clearance_min_mm": self.worst,
            "carried_min_mm": self.worst_between,
            "latency_median_s": float(np.median(self.latencies)),
            "latency_p95_s": float(np.quantile(self.latencies, 0.95)),
            "latency_max_s": float(self.latencies.max()),
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the certified clearance over time, what is left of it after the margin, and gaps."""
        ax = take_axes(ax, x="time [s]", y="clearance [mm]")
        times = np.array([frame.time for frame in self.frames])
        values = np.array([np.nan if f.clearance is None else f.clearance for f in self.frames])
        margin = np.array([frame.margin for frame in self.frames])
        ax.plot(times, values, color="#0f7b6c", label="certified in the frame")
        ax.plot(times, values - margin, color="#2f7fd0", label="certified until the next frame")
        ax.axhline(0.0, color="#17212b", linewidth=0.8)
        missed = [frame.time for frame in self.frames if frame.status in ("lost", "refused")]
        if missed:
            ax.plot(missed, np.zeros(len(missed)), "x", color="#b3261e", label="not certified")
        ax.legend(frameon=False, fontsize=8)
        return ax

    def plot_latency(self, ax: Axes | None = None) -> Axes:
        """Draw how often a certificate took how long."""
        ax = take_axes(ax, x="latency [ms]", y="frames")
        # Bins over all that is shown: over the latencies alone, bars of a steady run are hairlines.
        most = max(float(self.latencies.max()), 1.0 / self.rate)
        ax.hist(1e3 * self.latencies, bins=40, range=(0.0, 1e3 * most), color="#2f7fd0")
        ax.axvline(1e3 / self.rate, color="#b3261e", linewidth=1.0, label=f"{self.rate:g} Hz")
        ax.legend(frameon=False, fontsize=8)
        return ax


def follow_tissue(
    plan: Plan,
    field: SampledField,
    *,
    motion: TissueMotion,
    surface: SurfaceTract | None = None,
    options: LiveOptions | None = None,
) -> Iterator[LiveFrame]:
    """Keep a scope clear in a tract that moves, and give every frame as it is done.

    Parameters
    ----------
    plan : Plan
        Of the tract at rest, to its goal, by method ``"tube"`` or ``"follow"``.
    field : SampledField
        Of the tract at rest.
    motion : TissueMotion
        How the tissue moves.
    surface : SurfaceTract, optional
        What the field was made of: see `MovingField`.
    options : LiveOptions, optional

    Yields
    ------
    LiveFrame
        One for each frame. Where a frame is refused, body and plan stay those of the frame before;
        where the body cannot be kept clear, it is carried along with the tissue, and the status is
        "lost".

    Raises
    ------
    InputError
        If the plan is not of the tract at rest, does not reach its goal, or is the thesis's, or
        leads where the motion is not known.
    """
    options = options or LiveOptions()
    for name, value, kind in (("plan", plan, Plan), ("motion", motion, TissueMotion)):
        if not isinstance(value, kind):
            raise InputError(f"{name} is a {type(value).__name__}: it must be a {kind.__name__}")
    if plan.status != "complete":
        raise InputError(f"the plan stopped ({plan.reason_code}): it must reach its goal")
    motion.check_reach(plan.path)
    loop = _Loop(plan, MovingField(field, surface), motion, options)
    duration = motion.period if options.duration is None else options.duration
    for number in range(max(1, round(duration * options.rate))):
        yield loop.run_frame(number)


@dataclass(frozen=True, kw_only=True, eq=False)
class _State:
    """The plan that is valid, at which step of it the scope stands, and the lumen it is for."""

    plan: Plan
    step: int
    displacement: Displacement
    time: float = 0.0
    field: MovedField | None = None


class _Loop:
    """The loop's state from frame to frame."""

    def __init__(
        self, plan: Plan, moving: MovingField, motion: TissueMotion, options: LiveOptions
    ) -> None:
        self.moving, self.motion, self.options = moving, motion, options
        wanted = options.inserted * float(plan.path_arc_length[-1])
        step = int(np.argmin(np.abs(plan.head_arc_length - wanted)))
        self.state = _State(plan=plan, step=step, displacement=np.zeros_like)
        self.due = 0.0
        self.rest_time = 0.0

    def run_frame(self, number: int) -> LiveFrame:
        """Plan one frame."""
        options, last = self.options, self.state
        now = number / options.rate
        begin = time.perf_counter()
        tissue = self.motion.at(now)
        ahead = ReplanOptions(step=last.step, horizon=options.horizon, measure=False)
        margin = self.motion.speed / options.rate
        blocked = ""
        try:
            path = carry_tissue(last.plan.path, last.displacement, now=tissue)
            lumen = self._update(tissue, cut_ahead(last.plan, path, ahead)[0])
            filled = time.perf_counter()
            plan = self._plan_ahead(lumen, tissue, ahead)
            if plan.reason_code == "NOT_CARRIED" and options.horizon > 0.0:
                # Whatever is ahead, the body may be kept clear where it is.
                blocked = f"the next stretch could not be planned: {plan.reason}"
                plan = self._plan_ahead(lumen, tissue, replace(ahead, horizon=0.0))
        except DeformationError as error:
            return LiveFrame(
                number=number,
                time=now,
                status="refused",
                reason=str(error),
                margin=margin + self.motion.speed * (now - last.time),
                head=float(last.plan.head_arc_length[last.step]),
                latency=time.perf_counter() - begin,
                plan=last.plan,
                step=last.step,
                next_step=last.step,
            )
        carried = None
        if last.field is not None:
            moved = self.motion.speed * (now - last.time)
            carried = _certify_move(last, plan, lumen, last.field, moved)
        done = time.perf_counter()
        step = self._move_on(plan)
        self.state = _State(plan=plan, step=step, displacement=tissue, time=now, field=lumen)
        rest = self._plan_rest(plan, tissue, 1.0 / options.rate - (done - begin))
        status, reason = _judge(plan, carried, margin)
        known = status != "lost"
        return LiveFrame(
            number=number,
            time=now,
            status=status,
            reason=reason or blocked,
            clearance=plan.proved if known else None,
            carried=carried,
            margin=margin,
            rest=rest,
            head=float(plan.head_arc_length[0]),
            ahead=float(plan.head_arc_length[-1] - plan.head_arc_length[0]) if known else 0.0,
            latency=done - begin,
            field_time=filled - begin,
            plan_time=done - filled,
            rest_time=time.perf_counter() - done,
            sweeps=0 if plan.replan is None else plan.replan.sweeps,
            band=lumen.band,
            measured=lumen.measured,
            tissue_move=0.0 if plan.replan is None else plan.replan.tissue_move,
            plan=plan,
            next_step=step,
            field=lumen,
        )

    def _plan_ahead(self, lumen: MovedField, tissue: TissueFrame, options: ReplanOptions) -> Plan:
        last = self.state
        return replan(
            last.plan,
            lumen,
            advect=lambda points: carry_tissue(points, last.displacement, now=tissue),
            options=options,
        )

    def _move_on(self, plan: Plan) -> int:
        """Return the step to which the head moves on; where the plan ends, what is due lapses."""
        self.due += self.options.advance / self.options.rate
        heads = plan.head_arc_length - plan.head_arc_length[0]
        step = int(np.searchsorted(heads, self.due, "right")) - 1
        self.due = 0.0 if step == len(heads) - 1 else self.due - float(heads[step])
        return step

    def _update(self, tissue: TissueFrame, path: Floats) -> MovedField:
        return self.moving.update(
            tissue,
            gradient_bound=tissue.gradient_bound,
            second_bound=tissue.second_bound,
            path=path,
            radius=self.state.plan.get_scope().radius,
        )

    def _plan_rest(self, plan: Plan, tissue: TissueFrame, left: float) -> float | None:
        """Certify the whole way to the goal, if it is not yet and there is time for it."""
        if plan.status == "complete":
            return plan.proved
        if plan.reason_code != "HORIZON" or left < self.rest_time:
            return None
        begin = time.perf_counter()
        try:
            lumen = self._update(tissue, plan.path)
        except DeformationError:
            return None
        whole = replan(plan, lumen, options=ReplanOptions(step=0, measure=False))
        self.rest_time = time.perf_counter() - begin
        return whole.proved if whole.status == "complete" else None


def _certify_move(
    last: _State, plan: Plan, lumen: MovedField, lumen_before: MovedField, moved: float
) -> float:
    """Certify the body from the last frame to this one, while the wall moves by up to `moved` mm.

    The first half of the joints' way is compared with the last lumen, the second with this one.
    """
    begin = 0.5 if last.step > 0 else 0.0  # share of the time in which the head moves on
    tubes = last.plan.get_introducer(), plan.get_introducer()
    here, there = last.plan.joints[last.step], plan.joints[0]
    radius = plan.get_scope().radius
    spaces = FreeSpace(lumen_before, None, tubes[0]), FreeSpace(lumen, None, tubes[1])
    # Joints that stand in the introducer move with it; the first of them ends a link inside.
    count = 1 + max(
        int(find_waiting(chain[None], space, radius=radius)[0])
        for chain, space in zip((here, there), spaces, strict=True)
    )
    here, there = here[: max(count, 2)], there[: max(count, 2)]
    middle, least = 0.5 * (here + there), np.inf
    if last.step > 0:
        least = (-np.inf if last.plan.proved is None else last.plan.proved) - begin * moved
    for one, other, space, late in (
        (here, middle, spaces[0], 0.5 * (1.0 + begin)),
        (middle, there, spaces[1], 0.5 * (1.0 - begin)),
    ):
        found = certify_motion(np.stack([one, other]), space, radius=radius).clearance
        least = min(least, found - late * moved)
    return float(least)


def _judge(plan: Plan, carried: float | None, margin: float) -> tuple[FrameStatus, str]:
    """Return a frame's status, and why it is not the best one."""
    if plan.reason_code == "NOT_CARRIED" or plan.proved is None:
        return "lost", plan.reason or "the body's clearance could not be certified"
    if carried is not None and carried < 0.0:
        return _judge_move(carried)
    if plan.proved < margin:
        shown = floor_beside(plan.proved, margin)
        return "now", (
            f"{shown[0]} mm are certified, the wall may move by {shown[1]} mm until the next frame"
        )
    return "held", ""


def _judge_move(carried: float) -> tuple[FrameStatus, str]:
    """Return the status of a frame next to a move that is not certified, and why."""
    shown = "nothing was" if math.isinf(carried) else f"{floor_mm(carried)} mm were"
    return "now", f"while the tissue moved on, {shown} certified: contact is not excluded"
