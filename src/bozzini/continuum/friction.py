"""Friction of tendons in their channels: tensions along them, which depend on the history.

Where a tendon slides in its channel, normal force and friction of a piece of it balance its
tension, the capstan law along any curve (Euler 1769)::

    d ln T / ds = - mu |dt/ds| sigma

with the tendon's unit tangent ``t`` in space, ``mu`` its coefficient, and ``sigma = 1`` where it
slides towards the base, ``-1`` where it slides towards the tip, in between where it sticks. At the
tip the tendon is fixed: a point slides by what the channel beyond it gets shorter::

    slip(s) = ell_before(s) - ell(s) ,   ell(s) = integral from s to the end of (|dx/ds| - T/EA)

Cut off what lies beyond a cross-section, tendons and all: their friction in the channels is inside
of it. So the rod's law stays ``K u + sum T_k r_k x t_k(u) = R^T M``, with the tensions that are
there; the force of a tendon on the rod per length is ``d(T t)/ds``, along the rod too.

Sticking is regularised as the bristles of a Dahl model without rate are: ``sigma = clip(memory +
slip / delta)`` with a slip ``delta`` of a millionth of the robot's length. So the answer depends on
the order of commands, never on their rate. A command is one step: where several tendons change at
once and one of them would slide to and fro on the way, commands between change the answer. The
memory is ``sigma`` at the command before.

Each step of Newton's method linearises slip and tensions and eliminates them from the tip on; the
angles ``|dt/ds| ds`` are those of the iterate before. Angles and slips are of second order in the
steps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..numeric.arrays import Floats
from ..numeric.kernels.linear_algebra import solve_bounded, solve_complementary
from ..results import Shown
from .kernels.friction import measure_tendons, move_tensions, reduce_slip
from .rod_grid import measure_rest_rates


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionState(Shown):
    """What tendons with friction remember, for ``initial=`` of the next command.

    ``...`` is the batch, ``n`` counts the rod's steps, of each of which there are start, middle and
    end, ``t`` tendons.

    Parameters
    ----------
    places : (n + 1,) ndarray
        Ends of the steps [mm].
    tensions : (..., n, 3, t) ndarray
        Tensions [N].
    shares : (..., n, 3, t) ndarray
        Share of the largest friction that acts before each point: 1 where the tendon slides
        towards the base, -1 towards the tip, between them where it sticks.
    lengths : (..., n, 3, t) ndarray
        Length of the tendon, without tension, to its end [mm]: from the base at the first point,
        else from the middle of the interval that ends at the point, which is a step's half or, at
        the start of one, the kink between two.
    """

    places: Floats
    tensions: Floats
    shares: Floats
    lengths: Floats

    def pick(self, index: tuple[int, ...]) -> FrictionState:
        """Return that of one place of the batch."""
        parts = {name: getattr(self, name)[index] for name in ("tensions", "shares", "lengths")}
        return dataclasses.replace(self, **parts)

    @classmethod
    def join(cls, states: Sequence[FrictionState], batch: tuple[int, ...]) -> FrictionState:
        """Return states, at least one, as a batch."""
        one = states[0]
        parts = {
            name: np.stack([getattr(state, name) for state in states]).reshape(
                *batch, *one.tensions.shape
            )
            for name in ("tensions", "shares", "lengths")
        }
        return dataclasses.replace(one, **parts)

    def tensions_at(self, arc_length: Floats) -> Floats:
        """Return the tensions at arc lengths that are ends of steps [N], shape (..., t, k)."""
        ends = np.concatenate([self.tensions[..., :1, 0, :], self.tensions[..., 2, :]], axis=-2)
        index = np.abs(self.places[:, None] - arc_length).argmin(axis=0)
        return np.swapaxes(ends[..., index, :], -1, -2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Channels:
    """Channels of a robot in steps, and what holds the tendons in them.

    Parameters
    ----------
    grid : tuple of ndarray
        Steps' ends, stiffness, curvature, places of tendons, and where they run, see
        `integrate_rod`.
    friction : (t,) ndarray
        Coefficients of friction.
    flexibility : (t,) ndarray
        1/EA of the tendons [1/N].
    """

    grid: tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]
    friction: Floats
    flexibility: Floats

    @cached_property
    def spans(self) -> Floats:
        """Lengths of the steps [mm], shape (n,)."""
        return np.diff(self.grid[0])

    @cached_property
    def rest_rates(self) -> Floats:
        """Length of tendons per length of the backbone at rest, shape (n, 3, t)."""
        return measure_rest_rates(self.grid)

    @cached_property
    def presliding(self) -> float:
        """Slip at which friction acts in full [mm]."""
        return PRESLIDING * float(self.grid[0][-1])

    def rest(self) -> FrictionState:
        """Return the state of the robot at rest, without tensions."""
        none = np.zeros(self.rest_rates.shape)
        lengths = self.measure_lengths(self.rest_rates, none)
        return FrictionState(places=self.grid[0], tensions=none, shares=none, lengths=lengths)

    def measure_lengths(self, rates: Floats, tensions: Floats) -> Floats:
        """Return lengths without tension to the end, as of `FrictionState` [mm], (n, 3, t)."""
        free = rates - self.flexibility * tensions * self.rest_rates
        parts = 0.25 * self.spans[:, None, None] * free[:, [0, 1, 1, 2]]
        beyond = np.cumsum(parts.reshape(-1, free.shape[2])[::-1], axis=0)[::-1]
        beyond = beyond.reshape(parts.shape)
        lengths = np.stack([beyond[:, 0], beyond[:, 1], beyond[:, 3]], axis=1)
        lengths[0, 0] = self.spans / 6.0 @ (free[:, 0] + 4.0 * free[:, 1] + free[:, 2])
        return lengths

    def stretch(self, tensions: Floats) -> Floats:
        """Return by how much tendons stretch [mm], shape (t,)."""
        return np.asarray(self.measure_lengths(np.zeros(tensions.shape), -tensions)[0, 0])


PRESLIDING = 1e-6
"""Slip at which friction acts in full, as a share of the robot's length."""

LEVELS = 10.0 ** np.arange(4, -1, -1), 10.0 ** (0.25 * np.arange(20, -1, -1))
"""Slips at which it does on the way to the solution, against the last one: at first, and further
ones where that does not settle."""

STEPS_PER_LEVEL = 3, 8
"""Newton steps at each of them but the last."""

WHOLE_STEPS = 12
"""Newton steps in full at the last one; further ones are halved, against cycles."""

MOST_STEPS = 60
"""Newton steps at the last one."""

MOST_ITERATIONS = 1000
"""Newton steps for a command, those in the part at hand not counted."""

MOST_PARTS = 32
"""Parts into which a command is cut at most."""

STUCK = 1.0 - 1e-9
"""Share of the friction that acts, and that a tendon may still be taken to stick at first."""

TOLERANCE = 1e-12
"""Change of tensions in a step at which they are found, as a share of the largest."""

NO_FORCE_N = 1e-9
"""Change of a tension that is round-off of a tendon's length [N]."""

ROUGH = 1e-9
"""The same where steps do not get smaller any more."""

MISFIT = 1e-6
"""Difference between friction and that of the slip that is let through, by the largest tension."""

RIDGE = 1e-9
"""Added to the tendons' own flexibility, so that redundant tendons have one answer."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bending:
    """A rod under tensions: moments over the cross-sections (n, 3, 3), or why there are none.

    `lengths` (t,) are those of the tendons [mm], where they are known better than by `Channels`.
    """

    moments: Floats = field(default_factory=lambda: np.zeros((0, 3, 3)))
    lengths: Floats | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class DriveCommand:
    """What is asked of the tendons at the base.

    Parameters
    ----------
    tensions : (t,) ndarray or None
        Tensions at the base [N], or
    limits : (t,) ndarray
        lengths of tendons without tension [mm].
    low, high : (t,) ndarray
        Bounds of tensions that follow from lengths [N]; equal where a tension is given.
    tolerance : float
        Error of a length [mm].
    """

    tensions: Floats | None
    limits: Floats
    low: Floats
    high: Floats
    tolerance: float

    def find_residuals(self, lengths: Floats, tensions: Floats) -> Floats:
        """Return how far lengths are from what is asked [mm]; 0 for slack cables."""
        if self.tensions is not None:
            return np.zeros(len(tensions))
        residuals = np.where(self.low < self.high, lengths - self.limits, 0.0)
        return np.where(
            (self.low == 0.0) & (tensions == 0.0), np.maximum(residuals, 0.0), residuals
        )

    def go_part(self, state: FrictionState, part: float) -> DriveCommand:
        """Return what is part of the way from a state to what is asked."""
        if part == 1.0:
            return self
        first, lengths = state.tensions[0, 0], state.lengths[0, 0]
        tensions = None if self.tensions is None else first + part * (self.tensions - first)
        limits = lengths + part * (self.limits - lengths)
        return dataclasses.replace(self, tensions=tensions, limits=limits)

    def solve_tensions(
        self, lengths: Floats, tensions: Floats, slip_by_tension: Floats, slip_offset: Floats
    ) -> Floats:
        """Return tensions at the base, given how slip there follows from them."""
        if self.tensions is not None:
            return self.tensions
        ridge = RIDGE * float(np.abs(np.diag(slip_by_tension)).max(initial=0.0))
        vector = self.limits - lengths + slip_offset - slip_by_tension @ tensions
        exact, wanted = slip_by_tension + ridge * np.eye(len(tensions)), tensions.copy()
        solve_bounded(0.5 * (exact + exact.T), vector, self.low, self.high, wanted)
        # With friction a tendon does not do to another what that does to it.
        held = self.low < self.high
        right = vector[held] + slip_by_tension[np.ix_(held, ~held)] @ wanted[~held]
        trial = wanted[held]
        matrix = exact[np.ix_(held, held)]
        if solve_complementary(matrix, right, self.low[held], self.high[held], trial):
            wanted[held] = trial
        return wanted


@dataclass(frozen=True, kw_only=True)
class NewtonStep:
    """What a step of Newton's method did, or why it could not.

    Parameters
    ----------
    size, scale : float
        Largest change of a tension, and largest tension [N].
    gap : float
        Largest error of a tendon's length [mm].
    misfit : float
        Largest difference between friction and that of the slip [N].
    """

    size: float = 0.0
    scale: float = 0.0
    residual: float = 0.0
    misfit: float = 0.0
    reason: str = ""


@dataclass(kw_only=True, eq=False)
class Sliding:
    """Newton's method for the tensions along tendons, from one state to the next.

    ``bend`` is the rod under tensions (n, 3, t), roughly if so asked. `pulled` are the tensions at
    the base where it was last, `acting` the shares of friction that its slips ask for.
    """

    channels: Channels
    before: FrictionState
    bend: Callable[[Floats, bool], Bending]
    iterations: int = 0
    pulled: Floats = field(default_factory=lambda: np.zeros(0))
    acting: Floats = field(default_factory=lambda: np.zeros(0))

    def follow(self, drive: DriveCommand) -> tuple[FrictionState, str]:
        """Return the state under a command, or why there is none.

        If need be it is approached over more slips, and then in ever more parts.
        """
        start, parts, fine = self.before, 1, False
        while True:
            self.before, reason = start, ""
            for part in range(1, parts + 1):
                reason = self.settle(drive.go_part(start, part / parts), fine)
                if reason:
                    break
            held = drive.tensions is None and bool(np.any(np.abs(self.pulled) >= drive.high))
            parts *= 1 + fine
            fine = True
            if not reason or held or parts > MOST_PARTS or self.iterations >= MOST_ITERATIONS:
                return self.before, reason

    def settle(self, drive: DriveCommand, fine: bool) -> str:
        """Go to the state under a command at once, and return why there is none; else nothing."""
        old = self.before
        profile, shares, lengths = old.tensions.copy(), STUCK * old.shares, old.lengths.copy()
        curvatures = np.zeros((*profile.shape[:2], 3))
        for level in LEVELS[fine]:
            size, most = np.inf, MOST_STEPS if level == 1.0 else STEPS_PER_LEVEL[fine]
            for count in range(most):
                part = 1.0 if count < WHOLE_STEPS else 0.5
                step = self._step(drive, (profile, shares, lengths, curvatures), level, part)
                if step.reason:
                    return step.reason
                before, size = size, step.size
                rest = size <= ROUGH * step.scale and size > 0.5 * before
                rest = rest or size <= max(TOLERANCE * step.scale, NO_FORCE_N)
                right = step.misfit <= MISFIT * step.scale + NO_FORCE_N
                if rest and right and step.residual <= drive.tolerance:
                    break
                if rest and not right:
                    # The step that is wanted does not change anything: from the slip itself on.
                    shares[:] = self.acting
            else:
                if level == 1.0:
                    return (
                        f"tensions along tendons did not settle in {self.iterations} steps: they "
                        f"change by {step.size:.2g} N, friction is off by {step.misfit:.2g} N, and "
                        f"a tendon misses its length by {step.residual:.2g} mm"
                    )
        self.before = dataclasses.replace(old, tensions=profile, shares=shares, lengths=lengths)
        return ""

    def _step(
        self,
        drive: DriveCommand,
        state: tuple[Floats, Floats, Floats, Floats],
        level: float,
        part: float,
    ) -> NewtonStep:
        """Improve tensions, shares, lengths and curvatures by one step."""
        channels, old = self.channels, self.before
        profile, shares, lengths, curvatures = state
        shape, presliding = profile.shape, level * channels.presliding
        self.iterations += 1
        bent = self.bend(profile, level > 1.0)
        if bent.reason:
            return NewtonStep(reason=bent.reason)
        rates, wrap_angles, flexibility = (
            np.empty(shape),
            np.empty(shape),
            np.empty((*shape, shape[2])),
        )
        if not measure_tendons(
            channels.grid, profile, bent.moments, curvatures, rates, flexibility, wrap_angles
        ):
            return NewtonStep(reason="no curvature was found")
        flexibility += (channels.flexibility * channels.rest_rates)[..., None] * np.eye(shape[2])
        lengths[:] = channels.measure_lengths(rates, profile)
        whole = lengths[0, 0]
        if bent.lengths is not None:
            whole = bent.lengths - channels.stretch(profile)
        slips = old.lengths - lengths
        self.acting = np.clip(old.shares + slips / presliding, -1.0, 1.0)
        misfits = channels.friction * wrap_angles * np.abs(profile * (self.acting - shares))
        now = profile, slips, old.shares, shares
        parts = (
            np.empty(flexibility.shape),
            np.empty(shape),
            np.empty(flexibility.shape),
            np.empty(shape),
        )
        geometry = wrap_angles, flexibility
        if not reduce_slip(channels.spans, channels.friction, now, geometry, presliding, *parts):
            return NewtonStep(reason="tensions do not fix the slip of tendons")
        kept = profile.copy()
        self.pulled = drive.solve_tensions(whole, kept[0, 0], parts[2][0, 0], parts[3][0, 0])
        move_tensions(channels.friction, now, wrap_angles, (presliding, part), parts, self.pulled)
        return NewtonStep(
            size=float(np.abs(profile - kept).max(initial=0.0)),
            scale=float(np.abs(profile).max(initial=0.0)),
            residual=float(np.abs(drive.find_residuals(whole, kept[0, 0])).max(initial=0.0)),
            misfit=float(misfits.max(initial=0.0)),
        )
