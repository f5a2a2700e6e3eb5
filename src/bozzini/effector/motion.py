"""An end-effector in time: regulators that lag, braids that rub, walls that creep, a viscous body.

From the pressure that is commanded to the pose there are four steps, each with a memory of its own
(`MotionState`): the pressure follows the command with a lag; plays make of it what the muscle
contracts by; a share of that comes late, by creep of the wall; and the bend may follow with a lag.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..checks import check_fields, quantity
from ..errors import InputError
from ..muscle.hysteresis import HysteresisState, PrandtlIshlinskii
from ..numeric.arrays import Floats
from ..results import Shown
from .kernels import motion as kernels

LAGS = {"scale": 0.1, "low": 0.0, "high": 1e4}


@dataclass(frozen=True, kw_only=True)
class EffectorMotion(Shown):
    """How an end-effector follows its commands in time; by default at once.

    Parameters
    ----------
    fill_lag, bleed_lag : float
        Time constants of the regulators, and of the lines, on the way up and down [s].
    play_radii : tuple of float
        Half widths of the plays from the pressure to what the muscle contracts by [MPa],
        increasing: the friction of the braid.
    play_weights : tuple of float
        Shares that go through each play; what is left acts at once.
    creep_share, creep_time : float
        Share of what acts that comes late, and its time constant [s]: creep of the wall.
    body_lag : float
        Time constant by which the bend follows [s]: viscosity of the body.

    Raises
    ------
    InputError
        If a value is not legal, or there are not as many radii as weights.
    """

    fill_lag: float = quantity("time", "Lag of the regulators on the way up.", default=0.0, **LAGS)
    bleed_lag: float = quantity(
        "time", "Lag of the regulators on the way down.", default=0.0, **LAGS
    )
    play_radii: tuple[float, ...] = ()
    play_weights: tuple[float, ...] = ()
    creep_share: float = quantity(
        help="Share of what acts that comes late.", default=0.0, scale=0.05, low=0.0, high=0.95
    )
    creep_time: float = quantity(
        "time", "Time constant of the creep.", default=10.0, scale=2.0, low=1e-3, high=1e5
    )
    body_lag: float = quantity("time", "Lag of the body.", default=0.0, **LAGS)

    def __post_init__(self) -> None:
        check_fields(self)
        radii, weights = self.play_radii, self.play_weights
        if len(radii) != len(weights):
            raise InputError(
                f"there are {len(radii)} radii of plays and {len(weights)} weights: give as many"
            )
        if radii and radii[0] <= 0.0:
            raise InputError(f"the first radius of the plays is {radii[0]:g}: it must be above 0")
        _ = self.operator

    @cached_property
    def operator(self) -> PrandtlIshlinskii | None:
        """The plays, from the pressure to the effective one; None without any."""
        if not self.play_radii:
            return None
        rest = 1.0 - sum(self.play_weights)
        return PrandtlIshlinskii((0.0, *self.play_radii), (rest, *self.play_weights))

    def begin(self, pressures: Floats) -> MotionState:
        """Return the state of muscles that were brought up to pressures (b, m) and stayed there."""
        return MotionState(pressures=np.array(pressures), plays=None, late=None, bend=None)

    def act(self, times: Floats, commands: Floats, *, initial: MotionState | None) -> Acting:
        """Return what acts in the muscles under commands (b, n, m) at times (n,), unchecked.

        A command holds from its time to the next. Without a state the muscles were brought up to
        the first commands, and stayed there.
        """
        state = self.begin(commands[:, 0]) if initial is None else initial
        many = np.ones(commands.shape[2])
        pressures, end = np.empty(commands.shape), np.array(state.pressures)
        kernels.follow(
            times, commands, self.fill_lag * many, self.bleed_lag * many, True, end, pressures
        )
        acting, plays = pressures, state.plays
        if self.operator is not None:
            histories = np.ascontiguousarray(np.moveaxis(pressures, 1, 2))
            given, plays = self.operator.run(histories, initial=plays)
            acting = np.ascontiguousarray(np.moveaxis(given, 2, 1))
        late = None
        if self.creep_share > 0.0:
            late = np.array(acting[:, 0] if state.late is None else state.late)
            slow, lag = np.empty(acting.shape), self.creep_time * many
            kernels.follow(times, acting, lag, lag, False, late, slow)
            acting = (1.0 - self.creep_share) * acting + self.creep_share * slow
        state = MotionState(pressures=end, plays=plays, late=late, bend=state.bend)
        return Acting(pressures, np.maximum(acting, 0.0), state)

    def move(
        self, times: Floats, bends: Floats, *, state: MotionState
    ) -> tuple[Floats, MotionState]:
        """Return the bends (b, n, 2) of the body that follows those at rest, and the state."""
        last = np.array(bends[:, 0] if state.bend is None else state.bend)
        moved, lag = np.empty(bends.shape), np.full(2, self.body_lag)
        kernels.follow(times, np.ascontiguousarray(bends), lag, lag, False, last, moved)
        return moved, MotionState(
            pressures=state.pressures, plays=state.plays, late=state.late, bend=last
        )


@dataclass(frozen=True, eq=False)
class MotionState(Shown):
    """What b end-effectors remember at a time.

    Parameters
    ----------
    pressures : ndarray, shape (b, m)
        In the muscles [MPa].
    plays : HysteresisState, optional
        Memory of the plays.
    late : ndarray, shape (b, m), optional
        What has come of the late share [MPa].
    bend : ndarray, shape (b, 2), optional
        Of the body: bend [rad] of a section with pulls of its own, lateral deflection [mm] else.
    """

    pressures: Floats
    plays: HysteresisState | None = None
    late: Floats | None = None
    bend: Floats | None = None


@dataclass(frozen=True, eq=False)
class Acting:
    """Pressures in the muscles, what they contract by, (b, n, m) [MPa], and the state after."""

    pressures: Floats
    effective: Floats
    state: MotionState
