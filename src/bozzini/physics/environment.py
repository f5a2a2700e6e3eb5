"""A Gymnasium environment: bring a scope in by bending its tip and pushing.

It is registered by importing this module, as ``bozzini/Insertion-v0``; Gymnasium imports it itself
for ``bozzini.physics.environment:bozzini/Insertion-v0``.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from ..checks import check_array, check_integer, check_kind, check_path, check_word
from ..errors import InputError, MissingExtraError
from ..motion.scope import Introducer, Scope
from ..numeric.arrays import Floats
from ..numeric.polylines import NEAR_MM, follow_way, interpolate_polyline, measure_arc_length
from ..results import Json, Shown
from .options import ScopeOptions, WallOptions
from .robots import PushDrive, stand_outside
from .simulate import Chain, Dynamics, Simulation
from .walls import LumenWall

try:
    import gymnasium
except ImportError as error:
    raise MissingExtraError((error.name or "gymnasium").partition(".")[0], "physics") from None

if TYPE_CHECKING:
    from ..duct.base import Duct
    from ..motion.plan import Plan

NAME = "bozzini/Insertion-v0"
MOST_STEPS = 1500

CONTROL_S = 0.1
"""Time between actions [s]."""

DYNAMICS = Dynamics(step=0.01, spacing=5.0, tolerance=1e-3)
"""Coarser than a motion that is executed."""

SPEED, TURN_RATE = 20.0, 1.0
"""Of a full action: the push [mm/s], and the tip [rad/s]."""

LOOK_AHEAD = (15.0, 40.0)
"""How far ahead along the lumen the two directions of an observation are [mm]."""

DIAMETER, LINK, SLACK = 9.0, 20.0, 0.5
"""Of the scope, its links, and between it and the introducer [mm]."""

PROGRESS_REWARD, FORCE_REWARD, END_REWARD = 0.1, -0.02, 10.0
"""For each mm on the way; for each N of normal force at an action's end; for the end of the way,
and negative for a link that leaves the lumen."""

OBSERVED = 13

PIXELS, LENS = 64, (math.radians(50.0), 5.0, 100.0)
"""Of the camera: half its angle of view [rad], and up to where its light is full and reaches at all
[mm]."""

RENDERED = 256
"""Pixels of a picture for people."""

START_RAD = 0.02
"""Standard deviation of the tip's direction at the start [rad]."""

PURSUIT_MM = 12.0
"""How far ahead the baselines look [mm]."""

PUSHED = ScopeOptions(rigidity=5000.0)
PUSHED_SHARE = 1.2
"""Of an elastic scope, and its length over the way's."""

Robot = Literal["leader", "pushed"]
Observe = Literal["clearance", "camera"]
RenderMode = Literal["rgb_array"]
Observation = Floats | Json
Policy = Callable[["Insertion"], Floats]
Scene = TypeVar("Scene", bound="gymnasium.Env[Observation, Floats]")


@dataclass(frozen=True, kw_only=True, eq=False)
class Lumen(Shown):
    """A lumen to go into.

    Parameters
    ----------
    duct : Duct
    line : (m, 3) float
        The centreline, the entry first [mm].
    path : (k, 3) float
        The head's path of the plan [mm].
    introducer : Introducer
    """

    duct: Duct
    line: Floats
    path: Floats
    introducer: Introducer

    @classmethod
    def of_plan(cls, plan: Plan, duct: Duct) -> Lumen:
        """Return the lumen that a plan was made in."""
        line = plan.path if plan.centreline is None else plan.centreline.points
        return cls(duct=duct, line=line, path=plan.path, introducer=plan.get_introducer())


@functools.lru_cache(maxsize=8)
def find_phantom(seed: int) -> Lumen:
    """Return the lumen of a phantom and its centreline."""
    from .study import plan_phantom

    plan, duct = plan_phantom(seed, Scope(diameter=DIAMETER, link_length=10.0))
    return Lumen.of_plan(plan, duct)


class LumenChoice:
    """Lumens of which an environment takes one at each reset.

    Parameters
    ----------
    phantom : int or sequence of int, optional
        Seeds of phantoms, of which one is drawn; 0 unless given.
    lumen : Lumen or (path-like, path-like), optional
        Any tract, or a plan and the file that it was made from.
    """

    def __init__(
        self,
        phantom: int | Sequence[int] | None,
        lumen: Lumen | tuple[str | os.PathLike[str], str | os.PathLike[str]] | None,
    ) -> None:
        if phantom is not None and lumen is not None:
            raise InputError(f"phantom is {phantom}: leave it out with a lumen")
        if not (lumen is None or isinstance(lumen, Lumen)):
            if not isinstance(lumen, tuple) or len(lumen) != 2:
                raise InputError(
                    f"lumen is {lumen!r}: it must be a Lumen, or a plan's file and its tract's"
                )
            for path in lumen:
                check_path("lumen", path)
        seeds = phantom if isinstance(phantom, Sequence) else (0 if phantom is None else phantom,)
        if isinstance(phantom, str) or not len(seeds):
            raise InputError(f"phantom is {phantom!r}: it must be a seed, or one seed or more")
        self.seeds = tuple(check_integer("phantom", seed, low=0) for seed in seeds)
        self.given = lumen

    def draw(self, generator: np.random.Generator) -> Lumen:
        """Return one of them."""
        if isinstance(self.given, Lumen):
            return self.given
        if self.given is not None:
            plan, tract = self.given
            return _read_lumen(os.fspath(plan), os.fspath(tract))
        one = 0 if len(self.seeds) == 1 else int(generator.integers(len(self.seeds)))
        return find_phantom(self.seeds[one])


def aim_ahead(way: Floats, pose: tuple[Floats, Floats], *, before: float, ahead: float) -> Floats:
    """Return the direction (3,) in the tip's frame to a place on a way that lies ahead [mm].

    `pose` is the tip's axes as columns (3, 3), and its place; `before` is how far along the way it
    was last.
    """
    axes, tip = pose
    arcs = measure_arc_length(way)
    place = follow_way(way, arcs, tip, before=before)
    target = interpolate_polyline(way, arcs, np.array([place + ahead]))[0]
    local = axes.T @ (target - tip)
    return np.asarray(local / max(float(np.linalg.norm(local)), 1e-9))


class Insertion(gymnasium.Env[Observation, Floats]):
    """Bring a scope to the end of a lumen.

    **Action** (3,), each in [-1, 1]: turn the tip about its x and its y, push.

    **Observation** (13,): clearance of the tip over 10 mm; directions in the tip's frame to the
    middle of the lumen 15 and 40 mm ahead (3 each); the tip's bend about x and y [rad], of a leader
    that of its last joint; share of the way; what is pushed in over the way; normal force [N] as
    tanh; least clearance over 10 mm.

    With a camera it is a dict instead: `image` (64, 64, 1), what is seen from the tip, lit from
    there, x to the right and y down, 100 degrees wide; `body` (3,), the tip's bend and what is
    pushed in over the way. Nothing in it says where the lumen goes on but the image.

    **Reward**: 0.1 for each mm that the tip goes on along the way, -0.02 for each N that presses on
    the wall, 10 at the end of the way, -10 where a link leaves the lumen. It ends there too.

    Parameters
    ----------
    phantom : int or sequence of int, optional
        Seed of the phantom, or seeds of which each reset draws one; by default 0.
    lumen : Lumen or (path-like, path-like), optional
        Any tract, or a plan and the file that it was made from.
    robot : {"leader", "pushed"}
        A chain whose links follow the tip's way, or an elastic scope that is bent at its tip.
    observe : {"clearance", "camera"}
    wall : WallOptions, optional
    render_mode : {"rgb_array"}, optional
        With it `render` gives what is seen from the tip.

    Raises
    ------
    InputError
        If an argument is none of these.
    """

    metadata: Json = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / CONTROL_S)}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(
        self,
        phantom: int | Sequence[int] | None = None,
        *,
        lumen: Lumen | tuple[str | os.PathLike[str], str | os.PathLike[str]] | None = None,
        robot: Robot = "leader",
        observe: Observe = "clearance",
        wall: WallOptions | None = None,
        render_mode: RenderMode | None = None,
    ) -> None:
        check_word("robot", robot, get_args(Robot))
        check_word("observe", observe, get_args(Observe))
        self.lumens = LumenChoice(phantom, lumen)
        if render_mode is not None:
            check_word("render_mode", render_mode, get_args(RenderMode))
        wall = WallOptions(stiffness=1.0) if wall is None else wall
        check_kind("wall", wall, WallOptions)
        self.robot, self.render_mode, self.options = robot, render_mode, wall
        self.observe = observe
        self.observation_space = gymnasium.spaces.Box(-100.0, 100.0, (OBSERVED,), np.float64)
        if observe == "camera":
            self.observation_space = gymnasium.spaces.Dict(
                image=gymnasium.spaces.Box(0, 255, (PIXELS, PIXELS, 1), np.uint8),
                body=gymnasium.spaces.Box(-100.0, 100.0, (3,), np.float64),
            )
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
        self.lumen: Lumen | None = None
        self._built: tuple[Lumen, Simulation] | None = None

    def reset(
        self, *, seed: int | None = None, options: Json | None = None
    ) -> tuple[Observation, Json]:
        """Begin anew: the tip stands at the entry, a little off its axis."""
        super().reset(seed=seed)
        lumen = self.lumens.draw(self.np_random)
        if self._built is None or self._built[0] is not lumen:
            self._built = lumen, self._build(lumen)
        self.lumen, self.simulation = self._built
        simulation, tube = self.simulation, lumen.introducer
        length = float(simulation.chain.lengths.sum())
        self.arc = measure_arc_length(lumen.line)
        self.inserted, self.progress = 0.0, 0.0
        self.turn = np.zeros(2)
        self.heading = stand_outside(tube, length)[:3, :3].copy()
        self._base = self.heading.copy()
        self._trail, self._arcs = np.zeros((MOST_STEPS + 2, 3)), np.zeros(MOST_STEPS + 2)
        self._trail[0], self._trail[1] = tube.entry + length * tube.outward, tube.entry
        self._arcs[1], self._rows = length, 2
        simulation.place(np.zeros(simulation.model.nv))
        self._held = np.zeros(simulation.model.nu)
        self._steer(START_RAD * self.np_random.standard_normal(2))
        return self._observe(lumen), {}

    def _build(self, lumen: Lumen) -> Simulation:
        length = float(measure_arc_length(lumen.line)[-1]) + 2.0 * LINK
        count = math.ceil(length / LINK)
        chain = Chain(
            lengths=np.full(count, LINK),
            radius=0.5 * DIAMETER,
            frame=stand_outside(lumen.introducer, count * LINK),
            springs=np.zeros(count),
            servos=np.full(count, 200.0),
        )
        if self.robot == "pushed":
            chain = PushDrive(
                line=lumen.line, introducer=lumen.introducer, diameter=DIAMETER,
                length=PUSHED_SHARE * length, link=LINK, options=PUSHED,
            ).chain  # fmt: skip
        self.tip = int(np.count_nonzero(chain.servos))
        wall = LumenWall(
            duct=lumen.duct,
            introducer=lumen.introducer,
            guide=0.5 * DIAMETER + SLACK if self.robot == "pushed" else None,
            options=self.options,
        )
        return Simulation(chain, wall, DYNAMICS)

    def _steer(self, turn: Floats) -> None:
        """Turn the leader's heading about its own x and y, or bend the tip of an elastic scope."""
        if self.robot == "leader":
            from .kernels.steering import turn_axes

            turn_axes(self.heading, float(turn[0]), float(turn[1]))
            return
        self.turn = self.turn + turn
        size = float(np.linalg.norm(self.turn))
        self.turn *= min(1.0, PUSHED.tip_bend / max(size, 1e-9))

    def step(self, action: Floats) -> tuple[Observation, float, bool, bool, Json]:
        """Turn and push for a tenth of a second."""
        lumen = self.lumen
        if lumen is None:
            raise InputError("the environment has not begun: reset it first")
        simulation = self.simulation
        given = check_array("action", action)
        if given.shape != (3,) or np.isnan(given).any():
            raise InputError(f"action is {given.tolist()}: it must be 3 numbers in [-1, 1]")
        given = np.clip(given, -1.0, 1.0)
        most = float(simulation.chain.lengths.sum()) - LINK
        after = min(max(self.inserted + CONTROL_S * SPEED * float(given[2]), 0.0), most)
        advance, self.inserted = after - self.inserted, after
        self._steer(CONTROL_S * TURN_RATE * given[:2])
        start, goal = self._held, self._command(advance)
        if self.robot == "leader":
            self.turn = goal[-2:].copy()
        force = simulation.advance(start, goal, count=round(CONTROL_S / DYNAMICS.step))
        self._held = goal
        return self._judge(lumen, force)

    def _command(self, advance: float) -> Floats:
        """Return where the drives are to be: the links on the leader's way, or the tip bent."""
        if self.robot == "pushed":
            return np.concatenate([[self.inserted], np.tile(self.turn / self.tip, self.tip)])
        from .kernels.steering import lead_chain

        if self._rows == len(self._arcs):
            self._trail, self._arcs = np.tile(self._trail, (2, 1)), np.tile(self._arcs, 2)
        goal = np.empty(self.simulation.model.nu)
        self._rows = lead_chain(
            self._trail, self._arcs, self._rows, advance, self.heading, self._base, self.inserted,
            self.simulation.chain.lengths, goal,
        )  # fmt: skip
        return goal

    def aim(self, way: Floats, ahead: float) -> Floats:
        """Return the direction (3,) in the tip's frame to a place on a way that lies ahead [mm]."""
        pose = self.axes, self.simulation.joints[0]
        return aim_ahead(way, pose, before=self.progress, ahead=ahead)

    @property
    def axes(self) -> Floats:
        """The tip's x, y and way ahead as columns (3, 3)."""
        return self.heading if self.robot == "leader" else self.simulation.tip_frame

    def see(self) -> NDArray[np.uint8]:
        """Return what the camera at the tip sees, (64, 64)."""
        return self._look(PIXELS)

    def _look(self, pixels: int) -> NDArray[np.uint8]:
        image = self.simulation.look(self.axes, pixels=pixels, lens=LENS)
        return np.round(255.0 * image).astype(np.uint8)

    def render(self) -> NDArray[np.uint8]:
        """Return what the camera at the tip sees, as a picture in colours (256, 256, 3).

        Raises
        ------
        InputError
            If the environment was made without ``render_mode="rgb_array"``, or has not begun.
        """
        if self.render_mode is None:
            raise InputError("render_mode is None: pictures need render_mode='rgb_array'")
        if self.lumen is None:
            raise InputError("the environment has not begun: reset it first")
        return np.repeat(self._look(RENDERED)[..., None], 3, axis=2)

    def _judge(self, lumen: Lumen, force: float) -> tuple[Observation, float, bool, bool, Json]:
        simulation, before = self.simulation, self.progress
        observed = self._observe(lumen, force)
        complete = math.dist(simulation.tip, lumen.line[-1]) <= DIAMETER
        outside = simulation.least + simulation.chain.radius < 0.0
        reward = PROGRESS_REWARD * (self.progress - before) + FORCE_REWARD * force
        reward += END_REWARD * (float(complete) - float(outside))
        info = {"complete": complete, "outside": outside, "force_N": force}
        return observed, reward, complete or outside, False, info

    def _observe(self, lumen: Lumen, force: float = 0.0) -> Observation:
        """Find where the tip is along the way, and return what is seen from there."""
        from .kernels.steering import watch_tip

        simulation, length = self.simulation, float(self.arc[-1])
        aims = np.empty((len(LOOK_AHEAD), 3))
        self.progress, clear = watch_tip(
            simulation.packed_wall, lumen.line, self.arc, simulation.tip, self.axes,
            (self.progress, NEAR_MM), np.array(LOOK_AHEAD), aims,
        )  # fmt: skip
        if self.observe == "camera":
            body = np.append(self.turn, self.inserted / length)
            return {"image": self.see()[..., None], "body": body}
        clear -= 0.5 * DIAMETER
        least = min(simulation.least, clear)
        return np.array(
            [
                0.1 * clear, *aims.ravel(), *self.turn, self.progress / length,
                self.inserted / length, math.tanh(force), 0.1 * least,
            ]
        )  # fmt: skip


@functools.lru_cache(maxsize=4)
def _read_lumen(plan: str, tract: str) -> Lumen:
    from ..motion.plan import Plan
    from ..motion.verify import is_made_from, read_input, rebuild_field

    read = Plan.load(plan)
    if is_made_from(read, tract) is False:
        raise InputError(f"{tract} is not the file that the plan was made from")
    return Lumen.of_plan(read, rebuild_field(read, read_input(read, tract)))


# What a policy is measured against: chance, straight on, the middle of the lumen, a certified plan.


def act_at_random(env: Insertion) -> Floats:
    """Turn and push by chance, from the environment's own generator."""
    return env.np_random.uniform(-1.0, 1.0, 3)


def go_straight(env: Insertion) -> Floats:
    """Push, and turn nowhere."""
    return np.array([0.0, 0.0, 1.0])


def follow_centre(env: Insertion) -> Floats:
    """Turn towards the middle of the lumen ahead, and push the slower the more is to be turned."""
    if env.lumen is None:
        raise InputError("the environment has not begun: reset it first")
    return _pursue(env, env.lumen.line)


def follow_plan(env: Insertion) -> Floats:
    """Turn towards the head's path of the certified plan ahead: the expert."""
    if env.lumen is None:
        raise InputError("the environment has not begun: reset it first")
    return _pursue(env, env.lumen.path)


def _pursue(env: Insertion, way: Floats) -> Floats:
    local = env.aim(way, PURSUIT_MM)
    angle = math.atan2(math.hypot(local[0], local[1]), local[2])
    across = np.array([-local[1], local[0]]) / max(math.hypot(local[0], local[1]), 1e-9)
    turn = np.clip(angle / (CONTROL_S * TURN_RATE), 0.0, 1.0) * across
    return np.append(turn, 1.0 if angle < 0.3 else 0.3)


POLICIES: dict[str, Policy] = {
    "random": act_at_random,
    "straight": go_straight,
    "centre": follow_centre,
    "plan": follow_plan,
}
"""Baselines by name."""


def run_episode(
    env: Scene, policy: Callable[[Scene], Floats], *, seed: int, limit: float = math.inf
) -> Floats:
    """Return what becomes of an episode (6,).

    Whether it came through, whether a link left the lumen, the largest force [N], after how many
    actions it was above the limit [N], the reward, and how many actions were taken.
    """
    found = np.zeros(6)
    env.reset(seed=seed)
    while found[5] < MOST_STEPS:
        _, reward, over, _, info = env.step(policy(env))
        force = info["force_N"]
        found[:2] = info["complete"], info["outside"]
        found[2] = max(found[2], force)
        found[3:] += [force > limit, float(reward), 1.0]
        if over:
            break
    return found


def rate_policy(
    env: Scene, policy: Callable[[Scene], Floats], *, episodes: int, seed: int = 0
) -> dict[str, float]:
    """Return the share of episodes that come through, and means over all of them.

    Parameters
    ----------
    env : Insertion or TendonInsertion
    policy : callable
        Takes the environment, returns an action.
    episodes, seed : int
        The first is reset with this seed.
    """
    found = np.mean([run_episode(env, policy, seed=seed + k) for k in range(episodes)], axis=0)
    names = ("complete", "force_N", "reward", "steps")
    return dict(zip(names, found[[0, 2, 4, 5]].tolist(), strict=True))


gymnasium.register(
    id=NAME,
    entry_point=f"{__name__}:Insertion",
    vector_entry_point="bozzini.physics.vector:InsertionVector",
    max_episode_steps=MOST_STEPS,
)
