"""The environment of an elastic robot: Gymnasium's own checks, many at once, baselines."""

from __future__ import annotations

import dataclasses
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bozzini.continuum import ContinuumRobot, Section
from bozzini.errors import InputError
from bozzini.physics.environment import Lumen, rate_policy
from bozzini.physics.study import Scenery
from bozzini.physics.tendon_environment import (
    HIGHEST_N,
    MOTION,
    PERIOD_S,
    RATE_N_S,
    TENDON_NAME,
    TENDON_POLICIES,
    TendonInsertion,
    build_steered,
)
from tests.shapes import bend_curve, tube_lumen


@pytest.fixture(scope="module")
def lumen(clear: Scenery) -> Lumen:
    from bozzini.motion import FreeSpace

    field, line = tube_lumen(bend_curve(60.0, 0.5 * np.pi, 40.0), 12.0)
    space = FreeSpace.at_entry(field, line, along=10.0)
    return Lumen(duct=field, line=line.points, path=line.points, introducer=space.tube)


def test_gymnasium_takes_it(lumen: Lumen) -> None:
    env = gymnasium.make(TENDON_NAME, lumen=lumen)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("mode", ["sync", pytest.param("async", marks=pytest.mark.slow)])
def test_many_are_stepped_in_one_call_each_as_by_itself(lumen: Lumen, mode: str) -> None:
    envs = gymnasium.make_vec(TENDON_NAME, num_envs=3, vectorization_mode=mode, lumen=lumen)
    first, _ = envs.reset(seed=3)
    actions = np.array([[0.0, 0.0, 0.0, 1.0], [0.5, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    for _ in range(5):
        seen, rewards, *_ = envs.step(actions)
    envs.close()
    assert first.shape == (3, 17) and not np.array_equal(first[0], first[1])
    assert rewards[0] > rewards[2] and rewards[1] > rewards[2]
    alone = TendonInsertion(lumen=lumen)
    alone.reset(seed=4)
    for _ in range(5):
        own, *_ = alone.step(actions[1])
    np.testing.assert_array_equal(seen[1], own)


@pytest.mark.slow(30)
def test_those_who_look_ahead_come_through_and_chance_does_not(lumen: Lumen) -> None:
    env = TendonInsertion(lumen=lumen)
    rated = rate_policy(env, TENDON_POLICIES["centre"], episodes=1)
    assert rated["complete"] == 1.0
    env.reset(seed=0)
    for _ in range(int(rated["steps"])):
        *_, info = env.step(TENDON_POLICIES["random"](env))
    assert not info["complete"]


def test_rewards_and_states_are_as_documented(lumen: Lumen) -> None:
    env = TendonInsertion(lumen=lumen)
    seen, _ = env.reset(seed=0)
    began = env.tensions.copy()
    total, forces = 0.0, 0.0
    for _ in range(30):
        seen, reward, *_, info = env.step(np.array([0.1, 0.0, -1.0, 1.0]))
        total, forces = total + reward, forces + info["force_N"]
    assert total == pytest.approx(0.1 * env.progress - 0.02 * forces)
    assert env.inserted == pytest.approx(30.0) and 25.0 < env.progress < 35.0
    wanted = [began[0] + 30 * 0.1 * PERIOD_S * RATE_N_S, began[1], 0.0]
    np.testing.assert_allclose(env.tensions, wanted)
    np.testing.assert_allclose(seen[-3:], env.tensions / HIGHEST_N)
    np.testing.assert_allclose(seen[10:12], [env.progress / env.arc[-1], 30.0 / env.arc[-1]])
    np.testing.assert_allclose(env.history.tensions[-1], env.tensions)
    tip = env.pose[1]
    assert seen[0] == pytest.approx(-0.1 * (lumen.duct.signed_distance(tip[None])[0] + 3.0))
    # The first tendon bends the tip to its side, +x.
    before = env.pose[0]
    for _ in range(10):
        seen, *_ = env.step(np.array([1.0, -1.0, -1.0, 0.0]))
    assert (before.T @ env.pose[0])[0, 2] > 0.05


def test_a_robot_that_is_pulled_hard_stays_in_its_introducer(lumen: Lumen) -> None:
    # Long steps, at which a light body could be thrown across its play many times over.
    robot = build_steered(174.0)
    options = dataclasses.replace(MOTION, max_step=0.01, drag=0.0)
    env = TendonInsertion(lumen=lumen, robot=robot, options=options)
    env.reset(seed=0)
    for k in range(40):
        env.step(np.array([1.0, 0.2 * (k % 3), 0.5, 0.0]))
    inside = env.history.points[-1][:-1, :2]
    assert env.tensions.max() == HIGHEST_N and np.abs(inside).max() < 1.0


def test_a_robot_that_is_pressed_out_ends_the_episode(lumen: Lumen) -> None:
    env = TendonInsertion(lumen=lumen, options=dataclasses.replace(MOTION, max_step=PERIOD_S))
    env.reset(seed=0)
    env.history = dataclasses.replace(env.history, gaps=env.history.gaps - 5.0)
    env._move = lambda *_: env.history
    _, reward, over, cut, info = env.step(np.zeros(4))
    assert over and not cut and info["outside"] and reward == pytest.approx(-10.0, abs=0.5)


def test_what_does_not_fit_is_refused(lumen: Lumen) -> None:
    bare = ContinuumRobot((Section(length=100.0, radius=3.0, line_weight=1e-4),))
    with pytest.raises(InputError, match="no tendons"):
        TendonInsertion(lumen=lumen, robot=bare)
    with pytest.raises(InputError, match="must be a DynamicsOptions"):
        TendonInsertion(lumen=lumen, options=3)
    env = TendonInsertion(lumen=lumen, robot=build_steered(120.0))
    with pytest.raises(InputError, match="reset it first"):
        env.step(np.zeros(4))
    env.reset(seed=0)
    with pytest.raises(InputError, match="4 numbers"):
        env.step(np.zeros(3))
