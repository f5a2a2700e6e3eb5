"""How good a policy is: how often it comes through phantoms, and with what forces."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import quantity
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Result, measured, tabulated
from ..task import Task

if TYPE_CHECKING:
    from .environment import Insertion

BASELINES = ("plan", "centre", "straight", "random")


@dataclass(frozen=True, kw_only=True, eq=False)
class PolicyRating(Result):
    """What became of a policy's episodes.

    Attributes
    ----------
    success, safe_success : float
        Share of the episodes that came through; and without leaving the limits.
    outside, pressed : float
        Share in which a link left the lumen; and in which the wall was pressed too much.
    contacts_outside : float
        Share of all actions after which the wall was pressed too much.
    force_median, force_most : float
        Of the largest forces of the episodes.
    phantom, seed : (n,) int ndarray
        Of each episode.
    complete, left, force, excess, reward, actions : (n,) ndarray
        Whether it came through, whether a link left the lumen, its largest force, the share of its
        actions with more than the limit, its reward and how many actions it took.
    """

    success: float = measured("")
    safe_success: float = measured("")
    outside: float = measured("")
    pressed: float = measured("")
    contacts_outside: float = measured("")
    force_median: float = measured("N")
    force_most: float = measured("N")
    phantom: NDArray[np.int64] = tabulated()
    seed: NDArray[np.int64] = tabulated()
    complete: Floats = tabulated()
    left: Floats = tabulated()
    force: Floats = tabulated("N")
    excess: Floats = tabulated()
    reward: Floats = tabulated()
    actions: Floats = tabulated()
    converged: bool = True
    reason: str = ""

    @property
    def residual(self) -> float:
        """Share of the episodes that were no safe success."""
        return 1.0 - self.safe_success


def evaluate_policy(
    policy: Callable[[Insertion], Floats],
    protocol: PolicyEvaluation | None = None,
    *,
    progress: Progress = no_progress,
) -> PolicyRating:
    """Return what becomes of a policy in phantoms; several starts of one run in threads.

    Parameters
    ----------
    policy : callable
        Takes an `Insertion`, returns its action.
    protocol : PolicyEvaluation, optional
        Phantoms, starts and the limit; its own policy is not used.
    progress : Progress
    """
    from .environment import Insertion, find_phantom, run_episode

    protocol = PolicyEvaluation() if protocol is None else protocol
    phantoms = protocol.first + np.arange(protocol.phantoms)
    seeds = protocol.seed + np.arange(protocol.starts)
    rows: list[Floats] = []
    with ThreadPoolExecutor(min(protocol.starts, os.cpu_count() or 1)) as pool:
        for k, phantom in enumerate(phantoms.tolist()):
            progress("phantoms", k / protocol.phantoms)
            find_phantom(phantom)  # once, not by each thread

            def run(seed: int, phantom: int = phantom) -> Floats:
                env = Insertion(phantom, robot=protocol.robot)  # type: ignore[arg-type]
                return run_episode(env, policy, seed=seed, limit=protocol.limit)

            rows += pool.map(run, seeds.tolist())
    complete, left, forces, excess, reward, taken = np.array(rows).T
    safe = (complete > 0.0) & (left == 0.0) & (excess == 0.0)
    return PolicyRating(
        success=float(complete.mean()),
        safe_success=float(safe.mean()),
        outside=float(left.mean()),
        pressed=float((excess > 0.0).mean()),
        contacts_outside=float(excess.sum() / taken.sum()),
        force_median=float(np.median(forces)),
        force_most=float(forces.max()),
        phantom=np.repeat(phantoms, len(seeds)),
        seed=np.tile(seeds, len(phantoms)),
        complete=complete,
        left=left,
        force=forces,
        excess=excess / taken,
        reward=reward,
        actions=taken,
    )


@dataclass(frozen=True, kw_only=True)
class PolicyEvaluation(Task):
    """Rate a baseline of the environment bozzini/Insertion-v0 in phantoms, from several starts.

    An episode is a safe success if it comes through, no link leaves the lumen, and the wall is
    never pressed with more than --limit in sum. Policies: towards the head's path of a certified
    plan, towards the middle of the lumen, straight on, by chance.

    Exit code 0: done; 2: bad input.
    """

    name = "evaluate"
    result = PolicyRating

    policy: str = quantity("text", "What acts.", default="plan", words=BASELINES)
    robot: str = quantity(
        "text", "A chain whose links follow its tip's way, or an elastic scope.", default="leader",
        words=("leader", "pushed"),
    )  # fmt: skip
    phantoms: int = quantity(help="How many.", default=80, low=1, high=10_000, whole=True)
    first: int = quantity(help="Seed of the first phantom.", default=1, low=0, whole=True)
    starts: int = quantity(help="Starts in each.", default=5, low=1, high=1000, whole=True)
    seed: int = quantity(help="Of the first start.", default=0, low=0, whole=True)
    limit: float = quantity(
        "force", "Of all normal forces on the wall after an action, in sum; assumed.", default=2.0,
        low=1e-6, high=1e6,
    )  # fmt: skip

    def run(self, progress: Progress = no_progress) -> PolicyRating:
        """Return what became of it."""
        from .environment import POLICIES

        return evaluate_policy(POLICIES[self.policy], self, progress=progress)
