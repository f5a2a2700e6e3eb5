"""How often random actions, the middle of the lumen and a certified plan come through phantoms.

    python examples/insertion_baselines.py 20            phantoms of seeds 1 to 20
    python examples/insertion_baselines.py 8 pushed      an elastic scope instead of a leader

Needs the extra ``physics``.
"""

from __future__ import annotations

import argparse

import numpy as np

from bozzini.physics.environment import POLICIES, Insertion, rate_policy


def main(arguments=None):
    """Rate each policy in each phantom, print a table, and return the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("count", type=int, nargs="?", default=2)
    parser.add_argument("robot", nargs="?", default="leader", choices=["leader", "pushed"])
    given = parser.parse_args(arguments)
    rated = {name: [] for name in POLICIES}
    for seed in range(1, given.count + 1):
        env = Insertion(seed, robot=given.robot)
        for name, policy in POLICIES.items():
            rated[name].append(rate_policy(env, policy, episodes=1, seed=seed))
    print("policy   comes through  reward: mean, least  steps, mean  largest force: median, most")
    for name, rows in rated.items():
        complete, reward, force, steps = (
            np.array([row[key] for row in rows])
            for key in ("complete", "reward", "force_N", "steps")
        )
        print(
            f"{name:8} {complete.sum():6.0f} of {len(rows):<4}  "
            f"{reward.mean():10.1f} {reward.min():10.1f}  {steps.mean():11.0f}  "
            f"{np.median(force):14.3g} N {force.max():9.3g} N"
        )
    return rated


if __name__ == "__main__":
    main()
