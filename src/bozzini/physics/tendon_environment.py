"""A Gymnasium environment: bring an elastic tendon robot into a lumen by its tensions and a push.

It is registered by importing this module, as ``bozzini/TendonInsertion-v0``; Gymnasium imports it
itself for ``bozzini.physics.tendon_environment:bozzini/TendonInsertion-v0``. ``gymnasium.make_vec``
steps many robots in one call.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_array, check_kind
from ..continuum import (
    ContactModel,
    ContactOptions,
    ContinuumRobot,
    DynamicsOptions,
    Section,
    Tendon,
    push_in,
    simulate,
)
from ..errors import InputError, MissingExtraError
from ..numeric.arrays import Floats
from ..numeric.polylines import follow_way, measure_arc_length
from ..results import Json
from .environment import (
    END_REWARD,
    FORCE_REWARD,
    LOOK_AHEAD,
    MOST_STEPS,
    PROGRESS_REWARD,
    PUSHED_SHARE,
    SPEED,
    Lumen,
    LumenChoice,
    aim_ahead,
)

try:
    import gymnasium
except ImportError as error:
    raise MissingExtraError((error.name or "gymnasium").partition(".")[0], "physics") from None

if TYPE_CHECKING:
    from ..continuum import RobotDesign, ShapeHistory

TENDON_NAME = "bozzini/TendonInsertion-v0"

PERIOD_S = 0.05
"""Time between actions [s]."""
HIGHEST_N, RATE_N_S = 10.0, 20.0
"""Largest tension, and its rate of a full action."""
START_N = 0.5
"""Largest tension at the start."""
REACH_MM = 15.0
"""From the end of the way, where a robot counts as come through."""

GAIN = 3.0
"""Of the baseline: share of a full action by the sine of how far off it looks."""

MOTION = DynamicsOptions(
    segment="chord",
    damping_time=0.02,
    gravity=(0.0, 0.0, 0.0),
    drag=1e-5,
    max_step=5e-3,
    spectral_radius=0.5,
)
"""Without gravity, as the robot lies straight before the entry at the start; in a fluid."""
SOFT_WALL = ContactOptions(wall_stiffness=0.5, friction=0.1)

_TIP_MM, _TIP_EI, _SHAFT_EI, _RADIUS = 50.0, 400.0, 5000.0, 3.0
_PIECE_MM = 20.0


def build_steered(way: float) -> ContinuumRobot:
    """Return a robot for a way of so many mm: a shaft, and a tip that three tendons bend."""
    shaft = max(PUSHED_SHARE * way - _TIP_MM, _PIECE_MM)
    tendons = tuple(
        Tendon(name=f"T{k + 1}", offset=2.0, angle=2.0 * math.pi * k / 3.0) for k in range(3)
    )
    return ContinuumRobot(
        (
            Section(
                length=shaft, radius=_RADIUS, discs=math.ceil(shaft / _PIECE_MM),
                bending_stiffness=_SHAFT_EI, torsional_stiffness=_SHAFT_EI, line_weight=3e-4,
            ),
            Section(
                length=_TIP_MM, radius=_RADIUS, discs=5,
                bending_stiffness=_TIP_EI, torsional_stiffness=_TIP_EI, line_weight=3e-4,
                tendons=tendons,
            ),
        ),
        name="steered",
    )  # fmt: skip


class TendonInsertion(gymnasium.Env[Floats, Floats]):
    """Bring the tip of an elastic tendon robot to the end of a lumen; its motion is `simulate`'s.

    **Action** (t + 1,), each in [-1, 1]: rates of the tensions, then the push. A full action is
    20 N/s and 20 mm/s; tensions stay in [0, 10] N.

    **Observation** (t + 14,): clearance of the tip over 10 mm; directions in the tip's frame to the
    middle of the lumen 15 and 40 mm ahead (3 each); velocity of the tip in its frame over 20 mm/s
    (3); share of the way; what is pushed in over the way; normal and friction forces of the walls
    [N] as tanh; least clearance over 10 mm; tensions over 10 N (t).

    **Reward**: 0.1 for each mm that the tip goes on along the way, -0.02 for each N of the walls,
    10 at the end of the way; -10 where it is pressed out of the lumen or folds over. It ends there.

    Parameters
    ----------
    phantom, lumen
        As of `Insertion`.
    robot : ContinuumRobot or path-like, optional
        With tendons, and weights; as long as the way unless given.
    options : DynamicsOptions
    contact : ContactOptions
        Of the walls.

    Raises
    ------
    InputError
        If an argument is none of these, or the robot has no tendons.
    """

    metadata: Json = {"render_modes": [], "render_fps": round(1.0 / PERIOD_S)}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(
        self,
        phantom: int | Sequence[int] | None = None,
        *,
        lumen: Lumen | tuple[str | os.PathLike[str], str | os.PathLike[str]] | None = None,
        robot: ContinuumRobot | str | os.PathLike[str] | None = None,
        options: DynamicsOptions = MOTION,
        contact: ContactOptions = SOFT_WALL,
    ) -> None:
        self.lumens = LumenChoice(phantom, lumen)
        if isinstance(robot, (str, os.PathLike)):
            robot = ContinuumRobot.from_yaml(robot)
        design = build_steered(2.0 * _TIP_MM) if robot is None else robot
        check_kind("robot", design, ContinuumRobot)
        if not design.tendons:
            raise InputError(f"robot '{design.name}' has no tendons: nothing can steer it")
        check_kind("options", options, DynamicsOptions)
        check_kind("contact", contact, ContactOptions)
        self.given, self.options, self.contact = robot, options, contact
        self.count = len(design.tendons)
        self.observation_space = gymnasium.spaces.Box(-100.0, 100.0, (self.count + 14,), np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.count + 1,), np.float64)
        self.lumen: Lumen | None = None
        self._placed: tuple[Lumen, RobotDesign] | None = None

    def reset(self, *, seed: int | None = None, options: Json | None = None) -> tuple[Floats, Json]:
        """Begin anew: the tip stands at the entry, its tendons pulled a little."""
        super().reset(seed=seed)
        lumen = self.lumens.draw(self.np_random)
        self.arc = measure_arc_length(lumen.line)
        if self._placed is None or self._placed[0] is not lumen:
            robot = build_steered(float(self.arc[-1])) if self.given is None else self.given
            model = ContactModel(robot, lumen.duct)
            placed, _ = push_in(model, lumen.line, times=[0.0, 1.0], speed=SPEED)
            self._placed = lumen, placed
        self.lumen, self.robot = self._placed
        self.inserted, self.progress = 0.0, 0.0
        self.tensions = np.zeros(self.count)
        drawn = START_N * self.np_random.uniform(0.0, 1.0, self.count)
        self.history, self.tensions = self._move(drawn, 0.0, None), drawn
        return self._observe(lumen), {}

    def _move(self, tensions: Floats, push: float, initial: ShapeHistory | None) -> ShapeHistory:
        """Return the motion of a period, in which tensions and base go evenly to their ends."""
        lumen, base = self.lumen, np.tile(np.eye(4), (2, 1, 1))
        base[:, 2, 3] = self.inserted, self.inserted + push
        return simulate(
            self.robot,
            [0.0, PERIOD_S],
            tensions=np.stack([self.tensions, tensions]),
            base=base,
            duct=None if lumen is None else lumen.duct,
            contact=self.contact,
            introducer=self.robot.length,
            initial=initial,
            options=self.options,
        )

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, Json]:
        """Pull and push for a twentieth of a second."""
        lumen = self.lumen
        if lumen is None:
            raise InputError("the environment has not begun: reset it first")
        given = check_array("action", action)
        if given.shape != (self.count + 1,) or np.isnan(given).any():
            raise InputError(
                f"action is {given.tolist()}: it must be {self.count + 1} numbers in [-1, 1]"
            )
        given = np.clip(given, -1.0, 1.0)
        tensions = self.tensions + PERIOD_S * RATE_N_S * given[:-1]
        tensions = np.clip(tensions, np.where(self.robot.pushes, -HIGHEST_N, 0.0), HIGHEST_N)
        after = self.inserted + PERIOD_S * SPEED * float(given[-1])
        after = min(max(after, 0.0), self.robot.length)
        history = self._move(tensions, after - self.inserted, self.history)
        self.tensions, self.inserted, before = tensions, after, self.progress
        if history.converged:
            self.history = history
        tip = self.pose[1]
        self.progress = follow_way(lumen.line, self.arc, tip, before=before)
        force, least = self.force, float(self.history.gaps[-1].min())
        complete = float(np.linalg.norm(tip - lumen.line[-1])) <= REACH_MM
        outside = not history.converged or least < -self.robot.sections[-1].radius
        reward = PROGRESS_REWARD * (self.progress - before) + FORCE_REWARD * force
        reward += END_REWARD * (float(complete) - float(outside))
        info = {"complete": complete, "outside": outside, "force_N": force}
        return self._observe(lumen), reward, complete or outside, False, info

    @property
    def pose(self) -> tuple[Floats, Floats]:
        """The tip's x, y and way ahead as columns (3, 3), and its place [mm], in the world."""
        frame = self.robot.base_frame @ self.history.tip_frames[-1]
        return frame[:3, :3], frame[:3, 3]

    @property
    def force(self) -> float:
        """Sum of the forces of the walls beyond the introducer [N]."""
        inside = self.history.points[-1, :, 2] > self.robot.length
        return float(np.linalg.norm(self.history.wall_forces[-1][inside], axis=1).sum())

    def aim(self, ahead: float) -> Floats:
        """Return the direction (3,) in the tip's frame to the lumen's middle ahead [mm]."""
        if self.lumen is None:
            raise InputError("the environment has not begun: reset it first")
        return aim_ahead(self.lumen.line, self.pose, before=self.progress, ahead=ahead)

    def _observe(self, lumen: Lumen) -> Floats:
        axes, tip = self.pose
        clear = -float(lumen.duct.signed_distance(tip[None])[0]) - self.robot.sections[-1].radius
        least = min(float(self.history.gaps[-1].min()), clear)
        speed = axes.T @ self.robot.base_frame[:3, :3] @ self.history.velocities[-1, -1] / SPEED
        length = float(self.arc[-1])
        seen = np.concatenate(
            [
                [0.1 * clear],
                *(self.aim(ahead) for ahead in LOOK_AHEAD),
                speed,
                [self.progress / length, self.inserted / length],
                [math.tanh(self.force), 0.1 * least],
                self.tensions / HIGHEST_N,
            ]
        )
        return np.asarray(np.clip(seen, -100.0, 100.0))


# What a policy is measured against.


def pull_at_random(env: TendonInsertion) -> Floats:
    """Pull and push by chance, from the environment's own generator."""
    return np.asarray(env.np_random.uniform(-1.0, 1.0, env.count + 1))


def push_only(env: TendonInsertion) -> Floats:
    """Push, and leave the tendons as they are."""
    return np.append(np.zeros(env.count), 1.0)


def steer_to_centre(env: TendonInsertion) -> Floats:
    """Bend the tip towards the middle of the lumen ahead by its own tendons, and push."""
    local = env.aim(LOOK_AHEAD[0])
    ends = zip(env.robot.tendons, env.robot.tendon_ends.tolist(), strict=True)
    angles = np.array([float(tendon.angle_at(np.array([end]))[0]) for tendon, end in ends])
    wanted = GAIN * (local[0] * np.cos(angles) + local[1] * np.sin(angles))
    push = 1.0 if local[2] > 0.9 else 0.3
    return np.asarray(np.append(np.clip(wanted, -1.0, 1.0), push))


TENDON_POLICIES: dict[str, Callable[[TendonInsertion], Floats]] = {
    "random": pull_at_random,
    "push": push_only,
    "centre": steer_to_centre,
}
"""Baselines by name."""

gymnasium.register(
    id=TENDON_NAME, entry_point=f"{__name__}:TendonInsertion", max_episode_steps=MOST_STEPS
)
