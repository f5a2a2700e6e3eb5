"""Control of the tip of a tendon robot in time by its tensions: four ways, and the bare inverse.

Commands are tensions, as drives with load cells hold them: limits of tension are limits of the
command, and a wrong stiffness moves the tip in full, which stiff tendons at commanded displacements
would hide. They hold for a period and act some periods after. The tip is wanted, and seen, across
the axis of the base; how far along it is left free.

All but resolved rates choose an aim, the place of the tip at rest by the model that the controller
believes in; the smallest tensions in the limits that hold it there are commanded. So what is left
to control from aim to tip is close to linear: the oscillation about the aim. `LinearDynamics` has
it, of which the slowest modes are kept, and what the others yield at rest.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_array, check_fields, check_kind, check_points, quantity
from ..errors import GeometryError, InputError
from ..numeric.arrays import Floats
from ..numeric.knots import Knots
from ..numeric.limited import solve_limited
from ..results import Shown
from .dynamics import DEFAULT_OPTIONS, DynamicsOptions, LinearDynamics, MovingRod, linearise
from .equilibrium import Equilibrium
from .robot import RobotDesign, check_robot

_LEVEL = 1e-3
"""What a tension counts beside a miss of the tip, by the largest slope of the tip."""
_ITERATIONS, _SETTLED = 20, 1e-6
"""Most steps of the inverse at rest, and the miss at which it ends, by the robot's length."""
_STRIDE = 0.1
"""Most that the inverse moves the tip in a step, by the robot's length."""
_TRUST, _HALVINGS = 0.7, 6
"""Most that a stride may miss what its slopes say, and how often it is halved; a fold jumps."""
_OUT_OF_REACH = 1e-3
"""Miss of the first place, by the robot's length, from which on it counts as out of reach."""
_DAMPING = 1e-9
"""Noise by the sensor's that keeps the Riccati equation of the filter regular."""


class HeldTip(NamedTuple):
    """The tip at rest under tensions.

    Attributes
    ----------
    tensions : ndarray, shape (t,)
        Of the tendons [N].
    place : ndarray, shape (2,)
        Lateral place of the tip [mm].
    by_tension : ndarray, shape (2, t)
        Its derivatives [mm/N].
    found : Equilibrium
        Of the rod.
    """

    tensions: Floats
    place: Floats
    by_tension: Floats
    found: Equilibrium


class TendonState(NamedTuple):
    """What a controller knows.

    Attributes
    ----------
    given : ndarray, shape (d + 1, t)
        The last commands [N], the newest last; the others do not act yet.
    held : HeldTip
        That of the newest one, at rest.
    estimate : ndarray
        What the controller remembers.
    ahead : tuple of HeldTip
        The tip at places that are wanted later.
    """

    given: Floats
    held: HeldTip
    estimate: Floats
    ahead: tuple[HeldTip, ...] = ()


class TendonChoice(NamedTuple):
    """What a controller chooses.

    Attributes
    ----------
    tensions : ndarray, shape (t,)
        The command [N].
    estimate, ahead
        What it remembers, as of `TendonState`.
    """

    tensions: Floats
    estimate: Floats
    ahead: tuple[HeldTip, ...] = ()


@dataclass(frozen=True, kw_only=True)
class TendonController(Shown, ABC):
    """Tensions, within limits of their size and rate, that lead the tip of a tendon robot.

    One of your own has `choose`, and `remember` and `remember_command` if it remembers more than
    two numbers.

    Parameters
    ----------
    robot : RobotDesign
        What the controller believes in.
    options : DynamicsOptions
        As of `simulate`.
    period : float
        Between commands [s].
    delay : int
        Periods after which a command acts.
    highest : float
        Largest tension [N]; the smallest is 0, of tendons that push ``-highest``.
    rate : float
        Largest change of a tension [N/s].

    Raises
    ------
    InputError
        If a value is not legal.
    """

    robot: RobotDesign
    options: DynamicsOptions = DEFAULT_OPTIONS
    period: float = quantity("time", "Between commands.", default=0.01, low=1e-4, high=10.0)
    delay: int = quantity(
        help="Periods after which a command acts.", default=1, low=0, high=100, whole=True
    )
    highest: float = quantity("force", "Largest tension.", default=20.0, low=1e-6, high=1e6)
    rate: float = quantity(
        help="Largest change of a tension [N/s].", default=200.0, low=1e-3, high=1e9
    )

    def __post_init__(self) -> None:
        check_robot(self.robot)
        check_kind("options", self.options, DynamicsOptions)
        check_fields(self)
        if not self.robot.tendons:
            raise GeometryError(f"robot '{self.robot.name}' has no tendons: nothing can move it")

    @cached_property
    def _rod(self) -> MovingRod:
        return MovingRod(self.robot, self.options, ())

    @cached_property
    def linear(self) -> LinearDynamics:
        """Small oscillations of the robot about its rest without tensions."""
        none = np.zeros(len(self.robot.tendons))
        return linearise(self.robot, tensions=none, options=self.options)

    @cached_property
    def _decay(self) -> tuple[float, float]:
        """Damping ratio of the slowest mode, and the rate at which it decays [1/s]."""
        ratio = float(self.linear.damping_ratio[0])
        return ratio, 2.0 * math.pi * ratio * float(self.linear.frequency[0])

    @property
    def lowest(self) -> Floats:
        """Smallest tensions [N], shape (t,)."""
        return np.where(self.robot.pushes, -self.highest, 0.0)

    def hold(self, tensions: Floats, start: HeldTip | None = None) -> HeldTip:
        """Return the tip at rest under tensions (t,), found from another one."""
        initial = None if start is None else (start.found.rotation_vectors, tensions)
        found = self._rod.find_equilibrium(
            tensions, held=False, factors=np.empty(0), turned=np.eye(3), initial=initial
        )
        place, slopes = self._rod.differentiate_tip(found)
        return HeldTip(tensions, place[:2], slopes[:2], found)

    def reach(self, place: Floats, start: HeldTip) -> HeldTip:
        """Return the tip at rest nearest to a place (2,), under the smallest tensions in limits."""
        eye = np.eye(len(start.tensions))
        sides, held = np.concatenate([eye, -eye]), start
        for _ in range(_ITERATIONS):
            miss, stride = place - held.place, _STRIDE * self.robot.length
            miss *= min(1.0, stride / max(float(np.hypot(*miss)), stride))
            level = _LEVEL * np.abs(held.by_tension).max()
            tensions = held.tensions
            change = solve_limited(
                np.concatenate([held.by_tension, level * eye]),
                np.concatenate([miss, -level * tensions]),
                sides,
                np.concatenate([self.lowest - tensions, tensions - self.highest]),
            )
            change = np.clip(tensions + change, self.lowest, self.highest) - tensions
            found = self._move_held(held, change)
            if found is None:
                break
            before, held = held.place, found
            if np.hypot(*(held.place - before)) <= _SETTLED * self.robot.length:
                break
        return held

    def _move_held(self, held: HeldTip, change: Floats) -> HeldTip | None:
        """Return the tip after a change of tensions, or a part of it; None across a fold."""
        for _ in range(_HALVINGS):
            expected = held.by_tension @ change
            try:
                found = self.hold(held.tensions + change, held)
            except GeometryError:
                found = None
            least = max(float(np.hypot(*expected)), _SETTLED * self.robot.length)
            if found and np.hypot(*(found.place - held.place - expected)) <= _TRUST * least:
                return found
            change = 0.5 * change
        return None

    def begin(self, place: ArrayLike) -> TendonState:
        """Return the state of a robot whose model rests with its tip at a place (2,).

        Raises
        ------
        InputError
            If the place is out of reach.
        """
        at = self._take_place("place", place)
        held = self.reach(at, self.hold(np.zeros(len(self.lowest))))
        miss = float(np.hypot(*(at - held.place)))
        if miss > _OUT_OF_REACH * self.robot.length:
            raise InputError(
                f"the tip is wanted at {at[0]:g}, {at[1]:g} mm: tensions up to {self.highest:g} N "
                f"hold it {miss:.3g} mm from there at best"
            )
        given = np.tile(held.tensions, (self.delay + 1, 1))
        return TendonState(given, held, self.remember(held))

    def step(
        self, state: TendonState, wanted: ArrayLike, *, seen: ArrayLike
    ) -> tuple[Floats, TendonState]:
        """Return the tensions (t,) commanded now [N], and the state at the next sample.

        Parameters
        ----------
        state : TendonState
            Now.
        wanted : array_like, shape (h, 2)
            Lateral places of the tip now and at the next samples [mm]; the last one holds on.
        seen : array_like, shape (2,)
            Where the tip is now [mm].

        Raises
        ------
        InputError
            If a place is not finite.
        """
        places = check_points("wanted", check_array("wanted", wanted), dim=2)
        if places.ndim != 2 or not places.size:
            raise InputError(f"wanted has shape {places.shape}: it must be (h, 2)")
        last = state.given[-1]
        change = self.rate * self.period
        low = np.maximum(self.lowest, last - change)
        high = np.minimum(self.highest, last + change)
        choice = self.choose(
            state, wanted=places, seen=self._take_place("seen", seen), limits=(low, high)
        )
        tensions = np.clip(choice.tensions, low, high)
        held = self.hold(tensions, state.held)
        given = np.concatenate([state.given[1:], tensions[None]])
        estimate = self.remember_command(choice.estimate, held)
        return tensions, TendonState(given, held, estimate, choice.ahead)

    def _take_place(self, name: str, place: ArrayLike) -> Floats:
        at = check_points(name, check_array(name, place), dim=2)
        if at.shape != (2,):
            raise InputError(f"{name} has shape {at.shape}: it must be (2,)")
        return at

    def _at(self, wanted: Floats, sample: int) -> Floats:
        return np.asarray(wanted[min(sample, len(wanted) - 1)])

    def remember(self, held: HeldTip) -> Floats:
        """Return what a controller remembers at first."""
        return np.zeros(2)

    def remember_command(self, estimate: Floats, held: HeldTip) -> Floats:
        """Return what it remembers with the command that it has given."""
        return estimate

    @abstractmethod
    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command, which is brought within limits afterwards.

        Parameters
        ----------
        state : TendonState
            Now.
        wanted : ndarray, shape (h, 2)
            Places of the tip now and at the next samples [mm]; the last one holds on.
        seen : ndarray, shape (2,)
            Where it is now [mm].
        limits : tuple of ndarray, shape (t,)
            Smallest and largest tensions that are legal now [N].
        """


@dataclass(frozen=True, kw_only=True)
class StaticTensions(TendonController):
    """The tensions that bring the tip there at rest; what is seen is left aside."""

    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command; see `TendonController.choose`."""
        aim = self._at(wanted, self.delay + 1)
        return TendonChoice(self.reach(aim, state.held).tensions, state.estimate)


@dataclass(frozen=True, kw_only=True)
class ResolvedRates(TendonController):
    """The tip goes at the wanted speed, and back where it is off, by the Jacobian at rest.

    Parameters
    ----------
    gain : float
        Speed back by the distance that the tip is off [1/s]; unless given 0.7 of the rate at which
        the slowest mode decays, as a higher one makes it grow.
    """

    gain: float | None = quantity(help="Of the way back [1/s].", default=None, low=0.0, high=1e4)

    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command; see `TendonController.choose`."""
        ahead = self._at(wanted, self.delay + 1) - self._at(wanted, self.delay)
        gain = 0.7 * self._decay[1] if self.gain is None else self.gain
        change = ahead + gain * self.period * (wanted[0] - seen)
        slopes, tensions = state.held.by_tension, state.given[-1]
        eye, level = np.eye(len(tensions)), _LEVEL * np.abs(slopes).max()
        more = solve_limited(
            np.concatenate([slopes, level * eye]),
            np.concatenate([change, -level * tensions]),
            np.concatenate([eye, -eye]),
            np.concatenate([limits[0] - tensions, tensions - limits[1]]),
        )
        return TendonChoice(tensions + more, state.estimate)


@dataclass(frozen=True, kw_only=True)
class ProportionalIntegral(TendonController):
    """The wanted place is the aim, moved by how far the tip is off and by the sum of that.

    Parameters
    ----------
    proportional, integral : float
        Change of the aim by the distance, and by its integral [1/s]; unless given 0.7 of the
        slowest mode's damping ratio, and 0.5 of the rate at which it decays. The sum stops where
        tensions are at limits.
    """

    proportional: float | None = quantity(
        help="By the distance.", default=None, low=0.0, high=100.0
    )
    integral: float | None = quantity(
        help="By its integral [1/s].", default=None, low=0.0, high=1e4
    )

    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command; see `TendonController.choose`."""
        off = wanted[0] - seen
        total = state.estimate + self.period * off
        ratio, decay = self._decay
        proportional = 0.7 * ratio if self.proportional is None else self.proportional
        integral = 0.5 * decay if self.integral is None else self.integral
        aim = self._at(wanted, self.delay + 1) + proportional * off + integral * total
        tensions = self.reach(aim, state.held).tensions
        cut = np.any((tensions < limits[0]) | (tensions > limits[1]) | (tensions >= self.highest))
        return TendonChoice(tensions, state.estimate if cut else total)


@dataclass(frozen=True)
class AimedTip(Shown):
    """How the tip moves after an aim, from sample to sample: x' = A x + B aim, tip = C x.

    The state is the modes and their rates, what the other modes yield at once, and an offset that
    stays.

    Parameters
    ----------
    a, b, c : ndarray, shapes (n, n), (n, 2) and (2, n)
    """

    a: Floats
    b: Floats
    c: Floats

    @classmethod
    def of(cls, controller: TendonController, modes: int) -> AimedTip:
        """Return that of the robot in which a controller believes, about its rest."""
        from scipy.signal import cont2discrete

        linear = controller.linear
        system = linear.state_space(min(modes, len(linear.frequency)))
        slopes = controller.hold(np.zeros(len(controller.lowest))).by_tension
        tensions = np.linalg.pinv(slopes)
        inputs, outputs = system.B @ tensions, system.C[:2]
        own, driven, *_ = cont2discrete(
            (system.A, inputs, outputs, np.zeros((2, 2))), controller.period
        )
        rest = np.eye(2) + outputs @ np.linalg.solve(system.A, inputs)
        count = len(own)
        a = np.zeros((count + 4, count + 4))
        a[:count, :count], a[count + 2 :, count + 2 :] = own, np.eye(2)
        b = np.concatenate([driven, rest, np.zeros((2, 2))])
        return cls(a, b, np.concatenate([outputs, np.eye(2), np.eye(2)], axis=1))

    @cached_property
    def at_rest(self) -> Floats:
        """State (n, 2) at rest by the aim, without an offset."""
        own = len(self.a) - 2
        found = np.zeros((len(self.a), 2))
        found[:own] = np.linalg.solve(np.eye(own) - self.a[:own, :own], self.b[:own])
        return found

    def find_filter(self, *, noise: float, drift: float) -> Floats:
        """Return the gain (n, 2) of the Kalman filter.

        `noise` is the standard deviation of what is seen, `drift` that of the aim and of the change
        of the offset in a period [mm].
        """
        from scipy.linalg import solve_discrete_are

        inputs = self.b @ self.b.T
        inputs[-2:, -2:] = np.eye(2)
        seen = max(noise, _DAMPING * drift) ** 2 * np.eye(2)
        spread = solve_discrete_are(self.a.T, self.c.T, drift**2 * inputs, seen)
        return np.asarray(spread @ self.c.T @ np.linalg.inv(self.c @ spread @ self.c.T + seen))

    def find_feedback(self, effort: float) -> Floats:
        """Return the gain (2, n) of the linear quadratic regulator, 0 by the offset.

        `effort` is what a change of the aim counts beside a miss of the tip.
        """
        from scipy.linalg import solve_discrete_are

        own = len(self.a) - 2
        a, b, c = self.a[:own, :own], self.b[:own], self.c[:, :own]
        weight = effort**2 * np.eye(2)
        cost = solve_discrete_are(a, b, c.T @ c, weight)
        gain = np.linalg.solve(weight + b.T @ cost @ b, b.T @ cost @ a)
        return np.concatenate([gain, np.zeros((2, 2))], axis=1)


@dataclass(frozen=True, kw_only=True)
class EstimatingController(TendonController):
    """What `LinearQuadratic` and `TensionPrediction` share: a Kalman filter of the slowest modes.

    Its memory is the state, and the aims that have been given, the newest last.
    """

    effort: float = quantity(
        help="Of the aim's way off the wanted one, beside a miss.", default=0.1, low=1e-6, high=1e6
    )
    noise: float = quantity("length", "Of what is seen.", default=0.1, low=0.0, high=1e3)
    drift: float = quantity("length", "In a period.", default=0.2, low=1e-9, high=1e3)
    modes: int = quantity(help="That are kept.", default=6, low=1, high=1000, whole=True)

    @cached_property
    def model(self) -> AimedTip:
        """How the tip moves after its aim."""
        return AimedTip.of(self, self.modes)

    @cached_property
    def _filter(self) -> Floats:
        return self.model.find_filter(noise=self.noise, drift=self.drift)

    def remember(self, held: HeldTip) -> Floats:
        """Return the state at rest by the model, and the aims."""
        rest = self.model.at_rest @ held.place
        return np.concatenate([rest, np.tile(held.place, self.delay)])

    def remember_command(self, estimate: Floats, held: HeldTip) -> Floats:
        """Return the state at the next sample, and the aims."""
        state, aims = self._split(np.concatenate([estimate, held.place]))
        state = self.model.a @ state + self.model.b @ aims[0]
        return np.concatenate([state, aims[1:].ravel()])

    def _split(self, estimate: Floats) -> tuple[Floats, Floats]:
        count = len(self.model.a)
        return estimate[:count], estimate[count:].reshape(-1, 2)

    def _correct(self, estimate: Floats, seen: Floats) -> tuple[Floats, Floats]:
        """Return memory with what is seen, and the state when a command given now acts."""
        state, aims = self._split(estimate)
        state = state + self._filter @ (seen - self.model.c @ state)
        then = state
        for aim in aims:
            then = self.model.a @ then + self.model.b @ aim
        return np.concatenate([state, aims.ravel()]), then


@dataclass(frozen=True, kw_only=True)
class LinearQuadratic(EstimatingController):
    """Linear quadratic regulator about the wanted motion, of a state from a Kalman filter.

    Parameters
    ----------
    effort : float
        What the aim's way off the wanted one counts beside a miss of the tip.
    noise : float
        Standard deviation of what is seen [mm].
    drift : float
        Standard deviation of the aim, and of how the tip's offset changes, in a period [mm].
    modes : int
        Modes that are kept, the slowest.
    """

    @cached_property
    def feedback(self) -> Floats:
        """Aim by the state, shape (2, n)."""
        return self.model.find_feedback(self.effort)

    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command; see `TendonController.choose`."""
        estimate, then = self._correct(state.estimate, seen)
        offset = then[-2:]
        now, after = (self._at(wanted, self.delay + k) - offset for k in (0, 1))
        moving = self.model.at_rest @ now
        half = (len(moving) - 4) // 2
        moving[half : 2 * half] = self.model.at_rest[:half] @ (after - now) / self.period
        aim = after - self.feedback @ (then - moving)
        return TendonChoice(self.reach(aim, state.held).tensions, estimate)


@dataclass(frozen=True, kw_only=True)
class TensionPrediction(EstimatingController):
    """Tensions that bring the tip nearest to where it is wanted over a horizon, within limits.

    The linear least squares of a plan, with the limits of tension and rate, are solved exactly. The
    tip's place at rest is linear in the tensions about those that hold it where it is wanted.

    Parameters
    ----------
    effort, noise, drift, modes
        As of `LinearQuadratic`.
    knots : tuple of int
        Samples ahead at which a plan has knots, from 0 up to its horizon; between them tensions
        go straight.
    """

    knots: tuple[int, ...] = field(default=(0, 1, 2, 4, 7, 11, 16))

    def __post_init__(self) -> None:
        super().__post_init__()
        Knots(self.knots, self.period)

    @cached_property
    def _course(self) -> Knots:
        return Knots(self.knots, self.period)

    @cached_property
    def _response(self) -> tuple[Floats, Floats]:
        """The tip (h, 2) by the state now (h, 2, n), and by the aims (h, 2, h, 2)."""
        count, a = self.knots[-1] + 1, self.model.a
        powers = [np.eye(len(a))]
        for _ in range(count):
            powers.append(a @ powers[-1])
        free = np.stack([self.model.c @ power for power in powers[1:]])
        pulses = np.stack([self.model.c @ power @ self.model.b for power in powers[:-1]])
        driven = np.zeros((count, 2, count, 2))
        for k in range(count):
            driven[k, :, : k + 1] = pulses[k::-1].transpose(1, 0, 2)
        return free, driven

    def choose(
        self, state: TendonState, *, wanted: Floats, seen: Floats, limits: tuple[Floats, Floats]
    ) -> TendonChoice:
        """Return a command; see `TendonController.choose`."""
        estimate, then = self._correct(state.estimate, seen)
        count, strings = self.knots[-1] + 1, len(self.lowest)
        ahead = list(state.ahead[1:])
        for k in range(len(ahead), count):
            start = ahead[-1] if ahead else state.held
            ahead.append(self.reach(self._at(wanted, self.delay + 1 + k), start))
        free, driven = self._response
        slopes = np.stack([held.by_tension for held in ahead])
        fixed = np.stack([h.place - h.by_tension @ h.tensions for h in ahead])
        goals = np.stack([self._at(wanted, self.delay + 1 + k) for k in range(count)])
        # The aims by the tensions at the knots: (h, 2, k, t).
        aims = slopes[:, :, None, :] * self._course.spread[:, None, :, None]
        flat = aims.reshape(2 * count, -1)
        steer = driven.reshape(2 * count, 2 * count)
        size = flat.shape[1]
        eye = np.eye(size)
        level = _LEVEL * np.abs(slopes).max()
        matrix = np.concatenate([steer @ flat, self.effort * flat, level * eye])
        target = np.concatenate([
            goals.ravel() - (free @ then).ravel() - steer @ fixed.ravel(),
            self.effort * (goals - then[-2:] - fixed).ravel(),
            np.zeros(size),
        ])  # fmt: skip
        rates = np.kron(self._course.rates, np.eye(strings))
        begin = np.zeros(size)
        begin[:strings] = state.given[-1] / self.period
        plan = solve_limited(
            matrix,
            target,
            np.concatenate([eye, -eye, rates, -rates]),
            np.concatenate([
                np.tile(self.lowest, len(self.knots)), np.full(size, -self.highest),
                begin - self.rate, -begin - self.rate,
            ]),
        )  # fmt: skip
        return TendonChoice(plan[:strings], estimate, tuple(ahead))
