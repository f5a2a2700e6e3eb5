"""Control of the tip of an end-effector by its model in time: what it remembers is undone.

Each controller is told where the tip is wanted at the next samples, and returns the command that
holds until the next one. What it knows of the arm is in its state, which it is given and returns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_fields, check_kind, check_points, check_range, quantity
from ..errors import InputError
from ..muscle.hysteresis import HysteresisState
from ..numeric.arrays import Floats
from ..numeric.knots import Knots
from ..numeric.limited import solve_limited
from ..results import Shown
from .effector import Effector
from .motion import MotionState
from .section import find_bends
from .simulation import move_section

PERIOD = 0.02
"""Between commands, unless told [s]."""
_DIFFERENCE = 1e-4
"""Change of pressure over which slopes of the bend are taken [MPa]."""
_ITERATIONS, _SETTLED = 10, 1e-8
"""Most steps of the inverse at rest, and the step at which it ends [MPa]."""
_LEVEL = 1e-6
"""What a pressure counts beside a miss of the bend, where several pressures give it [rad/MPa]."""
_FARTHEST = 0.7
"""Largest lateral place of the tip that has an inverse, in lengths of the backbone."""
_SWING = 0.007
"""Share of the largest command over which slopes of the tip are taken: plays have kinks."""
_ONSET, _ONSET_STEPS = 0.01, 201
"""Share of its largest bend from which on a muscle counts as bending, and pressures tried."""
_SHARES = (0.0, 0.25, 0.5, 1.0)
"""Shares of a change of plan that are tried."""


@dataclass(frozen=True, eq=False)
class ControlState(Shown):
    """What a controller knows.

    Parameters
    ----------
    motion : MotionState
        Of the arm's model.
    command : ndarray, shape (m,)
        The last one [MPa].
    tip : ndarray, shape (2,)
        Where the model has the tip now [mm].
    miss : ndarray, shape (2,)
        By how much the tip was seen off that, smoothed [mm].
    plan : ndarray, shape (k, m), optional
        Commands at the knots ahead.
    """

    motion: MotionState
    command: Floats
    tip: Floats
    miss: Floats
    plan: Floats | None = None


@dataclass(frozen=True, kw_only=True)
class Controller(Shown, ABC):
    """Commands, within limits of pressure and rate, for an end-effector.

    Parameters
    ----------
    effector : Effector
        The model.
    rate : float
        Largest change of a command [MPa/s].
    period : float
        Between commands [s].
    trust : float
        Share of a new miss of a tip that is seen that is believed at once.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    effector: Effector
    rate: float = quantity(
        help="Largest change of a command [MPa/s].", default=3.0, low=1e-3, high=1e9
    )
    period: float = quantity("time", "Between commands.", default=PERIOD, low=1e-4, high=10.0)
    trust: float = quantity(help="Of a tip seen.", default=0.1, low=0.0, high=1.0)

    def __post_init__(self) -> None:
        check_kind("effector", self.effector, Effector)
        check_fields(self)

    @property
    def farthest(self) -> float:
        """Largest distance from the axis at which the tip may be wanted [mm]."""
        return _FARTHEST * self.effector.design.backbone_length

    @property
    def highest(self) -> float:
        """Largest command: the design's limit of pressure [MPa]; the smallest is 0."""
        return self.effector.design.pressure_limit

    def begin(self, pressures: ArrayLike | None = None) -> ControlState:
        """Return the state of an arm brought up to pressures (m,), by default 0, and left there."""
        count = len(self.effector.design.names)
        start = np.zeros(count) if pressures is None else check_array("pressures", pressures)
        if start.shape != (count,):
            raise InputError(f"pressures have shape {start.shape}: they must be ({count},)")
        check_range("pressures", start, 0.0, self.highest, "MPa")
        state = self.effector.motion.begin(start[None])
        tips, state = _roll(self.effector, np.zeros(1), start[None, None], state)
        return ControlState(state, start, tips[0, 0], np.zeros(2))

    def step(
        self, state: ControlState, wanted: ArrayLike, *, seen: ArrayLike | None = None
    ) -> tuple[Floats, ControlState]:
        """Return the command (m,) until the next sample [MPa], and the state there.

        Parameters
        ----------
        state : ControlState
            Now.
        wanted : array_like, shape (h, 2)
            Lateral places of the tip at the next samples [mm]; the last one holds on.
        seen : array_like, shape (2,), optional
            Where the tip is now [mm].

        Raises
        ------
        InputError
            If a place is not finite, or farther than the backbone can bend to.
        """
        places = check_points("wanted", check_array("wanted", wanted), dim=2)
        if places.ndim != 2 or not places.size:
            raise InputError(f"wanted has shape {places.shape}: it must be (h, 2)")
        self._check_reach(places)
        miss = state.miss
        if seen is not None:
            place = check_points("seen", seen, dim=2)
            miss = miss + self.trust * (place - state.tip - miss)
        command, plan = self._choose(state, places - miss)
        change = self.rate * self.period
        command = np.clip(command, state.command - change, state.command + change)
        command = np.clip(command, 0.0, self.highest)
        over = np.array([0.0, self.period])
        tips, motion = _roll(self.effector, over, np.stack([command, command])[None], state.motion)
        return command, ControlState(motion, command, tips[0, 1], miss, plan)

    def _check_reach(self, places: Floats) -> None:
        size = np.hypot(*places.T).max()
        if not size <= self.farthest:
            raise InputError(
                f"the tip is wanted {size:g} mm from the axis: it must be {self.farthest:g} mm at "
                "most"
            )

    @abstractmethod
    def _choose(self, state: ControlState, wanted: Floats) -> tuple[Floats, Floats | None]:
        """Return a command, which is brought within the limits afterwards, and a plan."""

    def rest_at(self, place: ArrayLike) -> Floats:
        """Return the pressures (m,) that bring the tip to a place (2,) at rest [MPa].

        As of the `StaticInverse`: hysteresis is left out.
        """
        at = check_array("place", place)
        if at.shape != (2,):
            raise InputError(f"place has shape {at.shape}: it must be (2,)")
        self._check_reach(at[None])
        return self._settle(at, np.full(len(self.effector.design.names), 0.5 * self.highest))

    def _settle(self, wanted: Floats, start: Floats) -> Floats:
        """Return pressures (m,) that bring the tip to a place (2,) at rest, without hysteresis."""
        if self.effector.pulls is None:
            return np.clip(self.effector.inverse(wanted).pressures, 0.0, self.highest)
        bend = _bend_to(self.effector, wanted)
        ends = np.zeros(len(start)), np.full(len(start), self.highest)
        return find_pressures(self.effector, bend, ends, start)

    def _lead(self, state: MotionState, pressures: Floats) -> Floats:
        """Return commands (m,) after which the pressures are those wanted at the next sample."""
        motion, now = self.effector.motion, state.pressures[0]
        lag = np.where(pressures > now, motion.fill_lag, motion.bleed_lag)
        with np.errstate(divide="ignore"):
            left = np.where(lag > 0.0, np.exp(-self.period / lag), 0.0)
        return np.asarray((pressures - left * now) / (1.0 - left))


@dataclass(frozen=True, kw_only=True)
class StaticInverse(Controller):
    """Commands are the pressures that bring the tip there at rest, without hysteresis."""

    def _choose(self, state: ControlState, wanted: Floats) -> tuple[Floats, Floats | None]:
        return self._settle(wanted[0], state.command), None


@dataclass(frozen=True, kw_only=True)
class LagFeedforward(Controller):
    """The pressures are those of `StaticInverse`: their lag is led, as the rig's valves are."""

    def _choose(self, state: ControlState, wanted: Floats) -> tuple[Floats, Floats | None]:
        pressures = self._settle(wanted[0], state.motion.pressures[0])
        return self._lead(state.motion, pressures), None


@dataclass(frozen=True, kw_only=True)
class InverseInTime(Controller):
    """All that the model remembers is undone, from sample to sample.

    Of the pressures that can act at the next sample, those are chosen that bend the section as it
    must, the smallest if there are several; creep, plays and lag give the command.

    Raises
    ------
    InputError
        If the end-effector has no pulls of its own, or a value is not legal.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.effector.pulls is None:
            raise InputError(
                "this end-effector has no pulls of its own: the inverse in time takes one that "
                "has, such as of 'bozzini effector fit --pulls'"
            )

    def _choose(self, state: ControlState, wanted: Floats) -> tuple[Floats, Floats | None]:
        effector, motion = self.effector, self.effector.motion
        bend = _bend_to(effector, wanted[0])
        if motion.body_lag > 0.0 and state.motion.bend is not None:
            left = np.exp(-self.period / motion.body_lag)
            bend = (bend - left * state.motion.bend[0]) / (1.0 - left)
        change = self.rate * self.period
        low = np.clip(state.command - change, 0.0, self.highest)
        high = np.clip(state.command + change, 0.0, self.highest)
        ends = np.stack([low, high])
        commands = np.repeat(ends[:, None], 2, axis=1)
        over = np.array([0.0, self.period])
        acting = motion.act(over, commands, initial=_repeat(state.motion, 2)).effective[:, 1]
        best = find_pressures(effector, bend, (acting[0], acting[1]), acting.mean(axis=0))
        return self._invert(state.motion, best), None

    def _invert(self, state: MotionState, effective: Floats) -> Floats:
        """Return commands (m,) after which pressures act as wanted at the next sample."""
        motion, pressures = self.effector.motion, effective
        if motion.creep_share > 0.0 and state.late is not None:
            left = np.exp(-self.period / motion.creep_time)
            late = motion.creep_share * left
            pressures = (effective - late * state.late[0]) / (1.0 - late)
        if motion.operator is not None:
            pressures = motion.operator.invert_history(
                pressures[None, :, None],
                between=(0.0, self.highest),
                initial=state.plays,
                clip=True,
            )[0, :, 0]
        return self._lead(state, pressures)


@dataclass(frozen=True, kw_only=True)
class PredictiveControl(Controller):
    """Commands that bring the tip nearest to where it is wanted over a horizon, within the limits.

    Each step moves the model on under the plan before, takes the slopes of the tip by the plan's
    knots, and solves the linear least squares with the limits of pressure and rate exactly.

    Parameters
    ----------
    level : float
        What a command counts beside a miss of the tip, where several give it [mm/MPa].
    smoothness : float
        What a change of a command counts [mm s/MPa].
    rounds : int
        Linearisations of a step.
    knots : tuple of int
        Samples ahead at which a plan has knots, from 0 up to its horizon; between them commands
        go straight.
    """

    level: float = quantity(help="Of a command.", default=0.03, low=1e-6, high=1e6)
    smoothness: float = quantity(help="Of its change.", default=0.01, low=0.0, high=1e6)
    rounds: int = quantity(help="Of a step.", default=1, low=1, high=50, whole=True)
    knots: tuple[int, ...] = (0, 1, 2, 4, 7, 11, 16)

    def __post_init__(self) -> None:
        super().__post_init__()
        Knots(self.knots, self.period)

    @cached_property
    def _onset(self) -> Floats:
        """Acting pressures (m,) from which on a muscle bends the section [MPa]; 0 of pulls."""
        count = len(self.effector.design.names)
        if self.effector.pulls is not None:
            return np.zeros(count)
        over = np.linspace(0.0, self.highest, _ONSET_STEPS)
        alone = over[None, :, None] * np.eye(count)[:, None]
        bends = find_bends(self.effector, alone.reshape(-1, count)).reshape(count, -1, 2)
        size = np.linalg.norm(bends, axis=-1)
        return np.asarray(over[np.argmax(size > _ONSET * size[:, -1:], axis=1)])

    def find_lowest(self, state: MotionState) -> Floats:
        """Return the smallest commands (m,) of a plan [MPa]: where muscles begin to bend.

        Below, the tip has no slope by which a plan could find out of there.
        """
        operator = self.effector.motion.operator
        if operator is None or not self._onset.any():
            return self._onset
        return operator.invert_history(
            self._onset[None, :, None], between=(0.0, self.highest), initial=state.plays, clip=True
        )[0, :, 0]

    @cached_property
    def _course(self) -> Knots:
        return Knots(self.knots, self.period)

    def _choose(self, state: ControlState, wanted: Floats) -> tuple[Floats, Floats | None]:
        knots, muscles = len(self.knots), len(state.command)
        plan = np.tile(state.command, (knots, 1)) if state.plan is None else state.plan
        last = self._course.spread.shape[0]
        goal = wanted[np.minimum(np.arange(last), len(wanted) - 1)]
        begin = np.zeros((knots, muscles))
        begin[0] = state.command / self.period
        # Limits of the change of plan: of pressures, and of rates.
        eye = np.eye(knots * muscles)
        rates = np.kron(self._course.rates, np.eye(muscles))
        sides = np.concatenate([eye, -eye, rates, -rates])
        changes = eye.reshape(-1, knots, muscles)
        swing = _SWING * self.highest
        trials = swing * np.concatenate([changes, -changes])
        share = np.sqrt(np.diff(self.knots, prepend=-1.0))[:, None]
        later = self.period * (np.array(self.knots)[:, None] + 1.0)
        low = np.minimum(self.find_lowest(state.motion), state.command + self.rate * later)
        plan = np.maximum(plan, low)
        for _ in range(self.rounds if state.plan is not None else max(self.rounds, 5)):
            tips = self._predict(state, np.concatenate([plan[None], plan + trials]))
            half = len(changes)
            slopes = (tips[1 : half + 1] - tips[half + 1 :]) / (2.0 * swing)
            speed = self._course.rates @ plan - begin
            level, smooth = self.level * share, self.smoothness * share
            matrix = np.concatenate([
                slopes.reshape(half, -1).T,
                np.repeat(level, muscles, axis=0) * eye,
                np.repeat(smooth, muscles, axis=0) * rates,
            ])  # fmt: skip
            miss = np.concatenate([
                (goal - tips[0]).ravel(), -(level * plan).ravel(), -(smooth * speed).ravel()
            ])  # fmt: skip
            floors = np.concatenate([
                (low - plan).ravel(),
                plan.ravel() - self.highest,
                -self.rate - speed.ravel(),
                speed.ravel() - self.rate,
            ])  # fmt: skip
            change = solve_limited(matrix, miss, sides, floors).reshape(knots, muscles)
            tried = plan + np.array(_SHARES)[:, None, None] * change
            off = np.square(self._predict(state, tried) - goal).sum(axis=(1, 2))
            off += np.square(level * tried).sum(axis=(1, 2))
            off += np.square(smooth * (self._course.rates @ tried - begin)).sum(axis=(1, 2))
            plan = tried[int(np.argmin(off))]
        return plan[0], np.clip(self._course.shift @ plan, 0.0, self.highest)

    def _predict(self, state: ControlState, plans: Floats) -> Floats:
        """Return lateral places (b, n, 2) of the tip at the next samples under plans (b, k, m)."""
        commands = self._course.spread @ plans
        commands = np.concatenate([commands, commands[:, -1:]], axis=1)
        times = np.multiply(self.period, np.arange(commands.shape[1]), dtype=np.float64)
        tips, _ = _roll(self.effector, times, commands, _repeat(state.motion, len(plans)))
        return tips[:, 1:]


def find_pressures(
    effector: Effector, bend: Floats, ends: tuple[Floats, Floats], start: Floats
) -> Floats:
    """Return pressures (m,) between ends that bend a section nearest to a bend (2,), unchecked.

    They are the smallest of those that do.
    """
    low, high = ends
    best, eye = np.clip(start, low, high), np.eye(len(low))
    trials = _DIFFERENCE * np.concatenate([0.0 * eye[:1], eye, -eye])
    sides = np.concatenate([eye, -eye])
    for _ in range(_ITERATIONS):
        bends = find_bends(effector, best + trials)
        slopes = (bends[1 : len(eye) + 1] - bends[len(eye) + 1 :]) / (2.0 * _DIFFERENCE)
        matrix = np.concatenate([slopes.T, _LEVEL * eye])
        target = np.concatenate([bend - bends[0], -_LEVEL * best])
        change = solve_limited(matrix, target, sides, np.concatenate([low - best, best - high]))
        best = np.clip(best + change, low, high)
        if np.abs(change).max() < _SETTLED:
            break
    return best


def _bend_to(effector: Effector, place: Floats) -> Floats:
    """Return the bend (2,) of an arc whose end is at a lateral place (2,), or nearest to it."""
    away = float(np.hypot(*place))
    share = min(away / effector.design.backbone_length, _FARTHEST)
    half = share  # half the angle: sin(half)**2 / half is the share
    for _ in range(50):
        sine, cosine = np.sin(half), np.cos(half)
        slope = 2.0 * sine * cosine - share
        change = (sine * sine - share * half) / slope if slope else 0.0
        half -= change
        if abs(change) < 1e-15:
            break
    return np.asarray(2.0 * half * place / (away or 1.0))


def _roll(
    effector: Effector, times: Floats, commands: Floats, state: MotionState
) -> tuple[Floats, MotionState]:
    """Return lateral places (b, n, 2) of the tip under commands (b, n, m), and the state after."""
    _, bends, shapes, after = move_section(effector, times, commands, initial=state)
    return shapes.points[:, 0, :2].reshape(bends.shape), after


def _repeat(state: MotionState, count: int) -> MotionState:
    """Return the state of one arm as that of many."""
    plays = state.plays

    def many(part: Floats) -> Floats:
        return np.repeat(part, count, axis=0)

    return replace(
        state,
        pressures=many(state.pressures),
        plays=None if plays is None else HysteresisState(many(plays.last), many(plays.memory)),
        late=None if state.late is None else many(state.late),
        bend=None if state.bend is None else many(state.bend),
    )
