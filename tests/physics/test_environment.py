"""The environment: Gymnasium's own checks, baselines in their order, rewards as documented."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from bozzini.errors import InputError
from bozzini.physics import environment
from bozzini.physics.environment import NAME, POLICIES, Insertion, Lumen, rate_policy
from bozzini.physics.options import WallOptions
from bozzini.physics.study import Scenery
from tests.shapes import bend_curve, tube_lumen


@pytest.fixture(scope="module")
def lumen(clear: Scenery) -> Lumen:
    """The bend, wide enough for the environment's scope."""
    import math

    from bozzini.motion import FreeSpace

    field, line = tube_lumen(bend_curve(60.0, 0.5 * math.pi, 40.0), 12.0)
    space = FreeSpace.at_entry(field, line, along=10.0)
    return Lumen(duct=field, line=line.points, path=line.points, introducer=space.tube)


@pytest.mark.parametrize("robot", ["leader", "pushed"])
def test_gymnasium_takes_it(lumen: Lumen, robot: str) -> None:
    env = gymnasium.make(NAME, lumen=lumen, robot=robot)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_two_at_once(lumen: Lumen, mode: str) -> None:
    envs = gymnasium.make_vec(NAME, num_envs=2, vectorization_mode=mode, lumen=lumen)
    observed, _ = envs.reset(seed=3)
    assert observed.shape == (2, environment.OBSERVED)
    assert not np.array_equal(observed[0], observed[1])
    _, rewards, *_ = envs.step(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    assert rewards[0] > rewards[1]
    envs.close()


def test_those_who_look_ahead_come_through_and_chance_does_not(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    rated = {
        name: rate_policy(env, policy, episodes=1)
        for name, policy in POLICIES.items()
        if name != "random"
    }
    assert all(each["complete"] == 1.0 for each in rated.values())
    env.reset(seed=0)
    for _ in range(int(max(each["steps"] for each in rated.values()))):
        *_, info = env.step(POLICIES["random"](env))
    assert not info["complete"]


def test_the_reward_is_what_is_documented(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    env.reset(seed=1)
    for _ in range(20):
        before = env.progress
        _, reward, over, _, info = env.step(np.array([0.0, 0.0, 1.0]))
        wanted = 0.1 * (env.progress - before) - 0.02 * info["force_N"]
        assert reward == pytest.approx(wanted)
        assert not over


def test_straight_ahead_a_soft_wall_is_left_and_that_ends_it(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen, wall=WallOptions(stiffness=0.001))
    env.reset(seed=0)
    for _ in range(200):
        _, reward, over, _, info = env.step(np.array([0.0, 0.0, 1.0]))
        if over:
            break
    assert info["outside"]
    assert reward < -5.0


def test_pulling_back_goes_back_the_same_way(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    env.reset(seed=0)
    for _ in range(20):
        env.step(POLICIES["centre"](env))
    there = env.simulation.joints
    for push in (1.0, 1.0, -1.0, -1.0):
        env.step(np.array([0.0, 0.0, push]))
    assert env.simulation.joints == pytest.approx(there, abs=0.5)


def test_a_seed_gives_the_same_episode(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    ends = []
    for _ in range(2):
        env.reset(seed=5)
        for _ in range(15):
            observed, *_ = env.step(POLICIES["random"](env))
        ends.append(observed)
    assert np.array_equal(*ends)


def test_a_phantom_and_a_lumen_exclude_each_other(lumen: Lumen) -> None:
    with pytest.raises(InputError, match="phantom is 3: leave it out"):
        Insertion(3, lumen=lumen)


def test_a_step_before_the_start_is_refused(lumen: Lumen) -> None:
    with pytest.raises(InputError, match="reset it first"):
        Insertion(lumen=lumen).step(np.zeros(3))
