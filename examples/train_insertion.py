"""Train a policy for bozzini/Insertion-v0 by PPO of Stable-Baselines3, and draw how it learns.

    python examples/train_insertion.py --steps 150000 --out trained

trains in phantoms 1 to 8 and tries the policy in others, 101 to 110. Writes `policy.zip`,
`curve.csv` and `curve.png`, and with `--film` a film of the first trial. Needs the extra `physics`,
stable-baselines3, and for the film moviepy.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from matplotlib.figure import Figure
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

from bozzini.physics.environment import NAME

LONGEST = 600
"""Steps of an episode: 1,200 mm at full speed."""


class Curve(BaseCallback):
    """Note of each episode that ends: steps so far, its reward, whether it came through, its force.

    Its force is the largest in one step.
    """

    def _on_training_start(self):
        self.rows, self.most = [], np.zeros(self.training_env.num_envs)

    def _on_step(self):
        for k, info in enumerate(self.locals["infos"]):
            self.most[k] = max(self.most[k], info["force_N"])
            if "episode" in info:
                self.rows.append(
                    (self.num_timesteps, info["episode"]["r"], info["complete"], self.most[k])
                )
                self.most[k] = 0.0
        return True


def draw_curve(rows, path, *, span=40):
    """Draw means over the last episodes."""
    steps, reward, complete, force = np.array(rows, dtype=float).T
    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    panels = figure.subplots(1, 3)
    names = ("reward", "share that comes through", "largest force [N]")
    for axes, values, name in zip(panels, (reward, complete, force), names, strict=True):
        whole = np.cumsum(np.insert(values, 0, 0.0))
        first = np.maximum(np.arange(len(values)) + 1 - span, 0)
        axes.plot(steps, (whole[1:] - whole[first]) / (np.arange(len(values)) + 1 - first))
        axes.set_xlabel("steps")
        axes.set_title(name, fontsize=9)
        axes.set_ylim(bottom=min(0.0, *axes.get_ylim()))
    figure.savefig(path, dpi=80)


def main(arguments=None):
    """Train, try out, write, and return the share that comes through."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=150_000)
    parser.add_argument("--phantoms", type=int, default=8)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--film", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("trained"))
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    wanted = {"phantom": range(1, 1 + given.phantoms), "max_episode_steps": LONGEST}
    envs = make_vec_env(NAME, n_envs=8, seed=0, env_kwargs=wanted)
    policy = PPO(
        "MlpPolicy", envs, n_steps=256, batch_size=256, learning_rate=1e-3, seed=0, device="cpu"
    )
    curve = Curve()
    policy.learn(given.steps, callback=curve)
    policy.save(given.out / "policy.zip")
    np.savetxt(
        given.out / "curve.csv", np.array(curve.rows, dtype=float), "%.6g", ",",
        header="steps,reward,complete,force_N", comments="",
    )  # fmt: skip
    draw_curve(curve.rows, given.out / "curve.png")
    ends = []
    for seed in range(101, 101 + given.trials):
        env = gymnasium.make(NAME, phantom=seed, render_mode="rgb_array", max_episode_steps=LONGEST)
        if given.film and seed == 101:
            env = gymnasium.wrappers.RecordVideo(env, str(given.out), name_prefix="trial")
        seen, _ = env.reset(seed=seed)
        over = cut = False
        while not (over or cut):
            action, _ = policy.predict(seen, deterministic=True)
            seen, _, over, cut, info = env.step(action)
        ends.append(info["complete"])
        env.close()
    print(f"comes through {sum(ends)} of {len(ends)} phantoms that it has not seen")
    return np.mean(ends)


if __name__ == "__main__":
    main()
