"""Many environments of `bozzini.physics.environment` that one call steps, in threads.

What `gymnasium.make_vec("bozzini/Insertion-v0", num_envs=8)` makes. A step is nearly all compiled
and does not hold Python's lock, so that threads share the cores without pipes between processes.
"""

from __future__ import annotations

import functools
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer
from ..numeric.arrays import Floats
from ..results import Json
from .environment import MOST_STEPS, Insertion, Observation

Flags = NDArray[np.bool_]


class InsertionVector(gymnasium.vector.SyncVectorEnv):
    """Environments side by side, all stepped at once.

    An episode that has ended is begun anew by the next step, whose action counts for nothing, as in
    Gymnasium's own vector environments.

    Parameters
    ----------
    num_envs : int
    max_episode_steps : int
        After so many an episode is cut off.
    **options
        As of `Insertion`, of all.

    Raises
    ------
    InputError
        If an argument is none of these.
    """

    def __init__(
        self, num_envs: int = 1, *, max_episode_steps: int = MOST_STEPS, **options: Any
    ) -> None:
        count = check_integer("num_envs", num_envs, low=1)
        self.limit = check_integer("max_episode_steps", max_episode_steps, low=1)
        super().__init__([functools.partial(Insertion, **options)] * count)
        self._ages = np.zeros(count, dtype=np.int64)
        threads = min(count, os.cpu_count() or 1)
        self._shares = [range(k, count, threads) for k in range(threads)]
        self._pool = ThreadPoolExecutor(threads)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: Json | None = None
    ) -> tuple[Observation, Json]:
        """Begin all anew, the first with the seed, the next with the one after it."""
        mask = None if options is None else options.get("reset_mask")
        self._ages[slice(None) if mask is None else mask] = 0
        return super().reset(seed=seed, options=options)

    def step(self, actions: Floats) -> tuple[Observation, Floats, Flags, Flags, Json]:
        """Step all by their actions (n, 3), or begin anew those that have ended."""
        infos: list[Json] = [{}] * self.num_envs

        def advance(share: range) -> None:
            for k in share:
                env = self.envs[k]
                if self._autoreset_envs[k]:
                    self._env_obs[k], infos[k] = env.reset()
                    self._rewards[k], self._terminations[k], self._ages[k] = 0.0, False, 0
                else:
                    self._env_obs[k], self._rewards[k], self._terminations[k], _, infos[k] = (
                        env.step(actions[k])
                    )
                    self._ages[k] += 1
                self._truncations[k] = self._ages[k] >= self.limit

        list(self._pool.map(advance, self._shares))
        whole: Json = {}
        for name, value in next(filter(None, infos), {}).items():
            whole[name] = np.array([info.get(name, type(value)()) for info in infos])
            whole[f"_{name}"] = np.array([name in info for info in infos])
        self._autoreset_envs = self._terminations | self._truncations
        joined = gymnasium.vector.utils.concatenate(
            self.single_observation_space, self._env_obs, self._observations
        )
        seen = cast("Observation", joined)
        self._observations = seen
        return (
            seen.copy() if isinstance(seen, np.ndarray) else {k: v.copy() for k, v in seen.items()},
            self._rewards.copy(),
            self._terminations.copy(),
            self._truncations.copy(),
            whole,
        )

    def close_extras(self, **kwargs: object) -> None:
        """Let the threads go."""
        self._pool.shutdown()
        super().close_extras(**kwargs)
