"""The environment: Gymnasium's own checks, baselines in their order, rewards as documented."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from scipy.spatial.transform import Rotation

from bozzini.cli.main import main
from bozzini.errors import InputError
from bozzini.physics import environment
from bozzini.physics.environment import NAME, POLICIES, Insertion, Lumen, rate_policy
from bozzini.physics.evaluating import PolicyEvaluation, evaluate_policy
from bozzini.physics.options import WallOptions
from bozzini.physics.simulate import Simulation
from bozzini.physics.study import Scenery
from bozzini.physics.vector import InsertionVector
from tests.shapes import bend_curve, tube_lumen

SPAWNED = {"context": "spawn"}


@pytest.fixture(scope="module")
def lumen(clear: Scenery) -> Lumen:
    """The bend, wide enough for the environment's scope."""
    from bozzini.motion import FreeSpace

    field, line = tube_lumen(bend_curve(60.0, 0.5 * math.pi, 40.0), 12.0)
    space = FreeSpace.at_entry(field, line, along=10.0)
    return Lumen(duct=field, line=line.points, path=line.points, introducer=space.tube)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "observe"), [("leader", "clearance"), ("leader", "camera"), ("pushed", "clearance")]
)
def test_gymnasium_takes_it(lumen: Lumen, robot: str, observe: str) -> None:
    env = gymnasium.make(NAME, lumen=lumen, robot=robot, observe=observe, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


@pytest.mark.parametrize(
    ("mode", "vector"),
    [("sync", {}), ("async", {}), pytest.param("async", SPAWNED, marks=pytest.mark.slow)],
)
def test_two_at_once(lumen: Lumen, mode: str, vector: dict[str, str]) -> None:
    envs = gymnasium.make_vec(
        NAME, num_envs=2, vectorization_mode=mode, vector_kwargs=vector, lumen=lumen
    )
    observed, _ = envs.reset(seed=3)
    assert observed.shape == (2, environment.OBSERVED)
    assert not np.array_equal(observed[0], observed[1])
    _, rewards, *_ = envs.step(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))
    assert rewards[0] > rewards[1]
    envs.close()


@pytest.mark.parametrize("observe", ["clearance", "camera"])
def test_a_batch_is_its_environments_one_by_one(lumen: Lumen, observe: str) -> None:
    """Gymnasium's own loop gives the same, beginnings anew and what is noted included."""
    random = np.random.default_rng(0)
    made = [
        gymnasium.make_vec(
            NAME, 3, mode, lumen=lumen, robot="pushed", observe=observe, max_episode_steps=4
        )
        for mode in (None, "sync")
    ]
    assert isinstance(made[0], InsertionVector)
    assert made[0].metadata["autoreset_mode"] == made[1].metadata["autoreset_mode"]
    rows = [envs.reset(seed=7) for envs in made]
    for step in range(10):
        assert made[0].observation_space.contains(rows[0][0])
        for one, other in zip(*rows, strict=True):
            assert data_equivalence(one, other, exact=True), step
        actions = random.uniform(-1.0, 1.0, (3, 3))
        rows = [envs.step(actions) for envs in made]
        assert rows[0][3].all() == (step % 5 == 3)
    for envs in made:
        envs.close()


@pytest.mark.parametrize("robot", ["leader", "pushed"])
def test_compiled_steps_are_mujocos(lumen: Lumen, robot: str, monkeypatch) -> None:
    """Forces and motions are those of MuJoCo's own steps, until small things have grown."""
    ends = []
    for compiled in (True, False):
        monkeypatch.setattr(Simulation, "is_compiled", compiled)
        env = Insertion(lumen=lumen, robot=robot)
        env.reset(seed=0)
        taken = [env.step(np.array([0.5, -0.3, 1.0])) for _ in range(25)]
        simulation = env.simulation
        ends.append((taken, simulation.data.qpos.copy(), simulation.work, simulation.joints))
    (ours, *motion), (theirs, *wanted) = ends
    assert max(each[4]["force_N"] for each in ours) > 0.1
    for one, other in zip(ours, theirs, strict=True):
        assert one[0] == pytest.approx(other[0], abs=1e-4)
        assert one[1:3] == pytest.approx(other[1:3], abs=1e-4)
    for one, other in zip(motion, wanted, strict=True):
        assert one == pytest.approx(other, rel=1e-4, abs=1e-4)


def test_an_episode_is_filmed(lumen: Lumen, tmp_path) -> None:
    pytest.importorskip("moviepy", reason="Gymnasium's films need moviepy")
    import imageio_ffmpeg

    env = gymnasium.make(NAME, lumen=lumen, render_mode="rgb_array", max_episode_steps=3)
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path), disable_logger=True)
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.array([0.0, 0.0, 1.0]))
    env.close()
    (film,) = tmp_path.glob("*.mp4")
    assert imageio_ffmpeg.count_frames_and_secs(str(film))[0] == 4


def test_a_rating_says_who_comes_through_and_who_stays_in_the_limits(
    lumen: Lumen, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(environment, "find_phantom", lambda seed: lumen)
    protocol = PolicyEvaluation(phantoms=1, starts=2)
    expert = evaluate_policy(POLICIES["plan"], protocol)
    assert expert.success == expert.safe_success == 1.0
    pressing = evaluate_policy(POLICIES["straight"], protocol)
    assert pressing.force_most > expert.force_most
    for share in (0.5, 2.0):
        limit = share * float(pressing.force.min())
        found = evaluate_policy(POLICIES["straight"], dataclasses.replace(protocol, limit=limit))
        assert found.force == pytest.approx(pressing.force)
        assert found.pressed == float(np.mean(found.force > limit))
        assert (found.excess > 0.0).any() == (found.contacts_outside > 0.0) == (share < 1.0)
    words = ["--policy", "straight", "--phantoms", "1", "--starts", "2", "--json"]
    assert main(["evaluate", *words]) == 0
    assert json.loads(capsys.readouterr().out)["force_most_N"] == pressing.force_most


def test_those_who_look_ahead_come_through_and_chance_does_not(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    rated = {
        name: rate_policy(env, policy, episodes=1)
        for name, policy in POLICIES.items()
        if name in ("centre", "plan")
    }
    assert all(each["complete"] == 1.0 for each in rated.values())
    env.reset(seed=0)
    for _ in range(int(max(each["steps"] for each in rated.values()))):
        *_, info = env.step(POLICIES["random"](env))
    assert not info["complete"]


def test_the_camera_sees_the_lumen_go_on_where_it_does(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen, observe="camera")
    env.reset(seed=0)
    for _ in range(15):
        observed, *_ = env.step(POLICIES["centre"](env))
    assert np.array_equal(observed["image"][..., 0], env.see())
    rays = math.tan(environment.LENS[0]) * (2.0 * (np.arange(64) + 0.5) / 64 - 1.0)
    before, seen, there = env.heading, [], []
    for turn in ([0.0, 0.0], [0.3, 0.0], [-0.3, 0.0], [0.0, 0.3], [0.2, -0.2]):
        env.heading = before @ Rotation.from_rotvec([*turn, 0.0]).as_matrix()
        image = env.see()
        rows, columns = np.nonzero(image <= np.percentile(image, 5.0))
        seen.append([rays[columns].mean(), rays[rows].mean()])
        ahead = env.aim(lumen.line, 40.0)
        there.append(ahead[:2] / ahead[2])
    # A bend ahead is darkest where it goes on beyond the place 40 mm ahead, to the bend's side.
    angles = np.arctan(np.hypot(*np.subtract(seen, there).T))
    assert angles.max() < math.radians(10.0)
    assert np.diff(seen, axis=0)[:, 1] == pytest.approx(np.diff(there, axis=0)[:, 1], abs=0.1)


def test_a_camera_in_a_ball_sees_its_wall_as_bright_all_round() -> None:
    from bozzini.motion.scope import Introducer
    from bozzini.physics.simulate import Chain, Simulation
    from bozzini.physics.walls import LumenWall
    from tests.shapes import ball_distance, sample_field

    field = sample_field(ball_distance([0.0, 0.0, 0.0], 20.0), [-24.0] * 3, [24.0] * 3, 1.0)
    tube = Introducer(
        entry=np.array([0.0, 0.0, -20.0]), outward=np.array([0.0, 0.0, -1.0]), bore=3.0
    )
    frame = np.eye(4)
    frame[2, 3] = -10.0
    chain = Chain(
        lengths=np.array([10.0]), radius=2.0, frame=frame, springs=np.zeros(1), servos=np.ones(1)
    )
    simulation = Simulation(chain, LumenWall(duct=field, introducer=tube))
    image = simulation.look(np.eye(3), pixels=16, lens=(0.5, 5.0, 100.0))
    assert image == pytest.approx(5.0 / 20.0, abs=0.01)  # by one over the distance
    dark = simulation.look(np.eye(3), pixels=16, lens=(0.5, 5.0, 15.0))
    assert not dark.any()  # its light does not reach the wall


def test_a_ray_past_the_entry_plane_meets_the_wall_beside_the_introducer() -> None:
    from bozzini.motion.scope import Introducer
    from bozzini.physics.simulate import Chain, Simulation
    from bozzini.physics.walls import LumenWall
    from tests.shapes import ball_distance, sample_field

    # An eye in a ball that lies across the introducer's straight continuation, 60 mm out.
    field = sample_field(ball_distance([0.0, 0.0, 0.0], 20.0), [-24.0] * 3, [24.0] * 3, 1.0)
    frame = np.eye(4)
    frame[0, 3], frame[2, 3] = 8.0, -10.0
    chain = Chain(
        lengths=np.array([10.0]), radius=2.0, frame=frame, springs=np.zeros(1), servos=np.ones(1)
    )
    tube = Introducer(
        entry=np.array([0.0, 0.0, -60.0]), outward=np.array([0.0, 0.0, 1.0]), bore=3.0
    )
    images = [
        Simulation(chain, LumenWall(duct=field, introducer=each)).look(
            np.eye(3), pixels=16, lens=(0.9, 5.0, 100.0)
        )
        for each in (None, tube)
    ]
    assert np.array_equal(images[0], images[1])


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


def test_each_reset_draws_one_of_the_phantoms_by_the_seed(lumen: Lumen, monkeypatch) -> None:
    drawn = []
    monkeypatch.setattr(environment, "find_phantom", lambda seed: drawn.append(seed) or lumen)
    for _ in range(2):
        env = Insertion(range(3, 9))
        for k in range(12):
            env.reset(seed=None if k else 5)
    assert drawn[:12] == drawn[12:]
    assert 1 < len(set(drawn)) and set(drawn) <= set(range(3, 9))
    Insertion(7).reset()
    Insertion().reset()
    assert drawn[24:] == [7, 0]


def test_a_leader_shows_how_its_tip_is_bent(lumen: Lumen) -> None:
    env = Insertion(lumen=lumen)
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.array([0.0, 0.0, 1.0]))
    for _ in range(5):
        observed, *_ = env.step(np.array([0.6, -0.3, 1.0]))
    last = env.simulation.data.qpos[-2:]
    assert np.abs(last).min() > 0.01
    assert observed[7:9] == pytest.approx(last, abs=0.05)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"phantom": -1}, "phantom is -1: it must lie in"),
        ({"phantom": "a"}, "phantom is 'a': it must be a seed"),
        ({"phantom": ()}, "it must be a seed, or one seed or more"),
        ({"phantom": 1.5}, "phantom is 1.5: it must be a whole number"),
        ({"lumen": "plan.npz"}, "lumen is 'plan.npz': it must be a Lumen, or"),
        ({"wall": 3.0}, "wall is 3.0: it must be a WallOptions"),
        ({"render_mode": "human"}, "render_mode is 'human': it must be one of rgb_array"),
        ({"robot": "snake"}, "robot is 'snake': it must be one of leader, pushed"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Insertion(**arguments)


def test_a_tract_that_is_not_the_plans_is_refused(clear: Scenery, tmp_path) -> None:
    from bozzini.anatomy.read import hash_input
    from bozzini.motion.plan import TractInput

    files = [tmp_path / name for name in ("one.stl", "other.stl")]
    for file in files:
        file.write_text(file.name)
    stated = TractInput(sha256=hash_input(files[0]))
    dataclasses.replace(clear.plan, input=stated).save(tmp_path / "plan.npz")
    with pytest.raises(InputError, match="other.stl is not the file that the plan was made from"):
        Insertion(lumen=(tmp_path / "plan.npz", files[1])).reset()


@pytest.mark.parametrize("action", [[0.0, 0.0], [math.nan, 0.0, 1.0]])
def test_a_wrong_action_is_named(lumen: Lumen, action: list[float]) -> None:
    env = gymnasium.make(NAME, lumen=lumen, render_mode=None).unwrapped
    env.reset(seed=0)
    with pytest.raises(InputError, match="it must be 3 numbers in"):
        env.step(np.array(action))


def test_pictures_are_those_that_stable_baselines_asks_for(lumen: Lumen) -> None:
    """What `make_vec_env` makes: a picture in colours, of what is in front of the tip."""
    env = gymnasium.make(NAME, lumen=lumen, render_mode="rgb_array")
    assert env.metadata["render_fps"] == 10
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (256, 256, 3) and picture.dtype == np.uint8
    assert picture.min() < picture.max()
    seen = env.unwrapped.see()  # every fourth ray or so: the same picture, coarser
    assert np.corrcoef(picture[2::4, 2::4, 0].ravel(), seen.ravel())[0, 1] > 0.95
    with pytest.raises(InputError, match="pictures need render_mode='rgb_array'"):
        Insertion(lumen=lumen).render()
    with pytest.raises(InputError, match="reset it first"):
        Insertion(lumen=lumen, render_mode="rgb_array").render()


@pytest.mark.slow
def test_its_name_with_the_module_needs_no_import() -> None:
    """In a new process, without a lumen: nothing is planned before a reset."""
    code = (
        "import gymnasium; "
        f"env = gymnasium.make({environment.__name__ + ':' + NAME!r}, render_mode='rgb_array'); "
        "print(type(env.unwrapped).__name__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "Insertion\n", done.stderr


@pytest.mark.slow
def test_stable_baselines_takes_it_by_name(lumen: Lumen) -> None:
    baselines = pytest.importorskip("stable_baselines3", reason="needs Stable-Baselines3")
    from stable_baselines3.common.env_util import make_vec_env

    envs = make_vec_env(NAME, n_envs=2, env_kwargs={"lumen": lumen})
    assert envs.render_mode == "rgb_array"
    baselines.PPO("MlpPolicy", envs, n_steps=8, batch_size=8).learn(16)
    assert baselines.PPO("MlpPolicy", NAME).get_env().render_mode == "rgb_array"


def test_a_phantom_and_a_lumen_exclude_each_other(lumen: Lumen) -> None:
    with pytest.raises(InputError, match="phantom is 3: leave it out"):
        Insertion(3, lumen=lumen)


def test_a_step_before_the_start_is_refused(lumen: Lumen) -> None:
    with pytest.raises(InputError, match="reset it first"):
        Insertion(lumen=lumen).step(np.zeros(3))
