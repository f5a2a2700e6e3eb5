"""The planners of joints in a tube around a shaped path: tube, follow, and the best of both."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from ..progress import Progress, no_progress
from .largest import find_advice
from .planner import Planner
from .planners import PlannerOptions
from .refusal import Refusal
from .scope import Scope
from .space import FreeSpace
from .tube import Style, TubeMotion, TubeProblem, plan_in_tube


class TubePlanner(Planner):
    """The whole body stays inside, proved, and joints move little."""

    name: ClassVar[str] = "tube"
    help: ClassVar[str] = "whole body, proved"
    style: ClassVar[Style] = Style()

    def move(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> TubeMotion:
        """Return a certified motion as far as it goes."""
        return plan_in_tube(TubeProblem(space, scope, options, self.style), progress=progress)

    def advise(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        refusal: Refusal,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> Refusal:
        """Return a refusal with what a certified plan of the whole way is found for."""
        job = TubeProblem(space, scope, options, self.style)
        return find_advice(job, refusal, progress=progress)


class FollowPlanner(TubePlanner):
    """As `TubePlanner`, with every joint on the head's path."""

    name = "follow"
    style = Style(freedom=0.0)


class BestPlanner(TubePlanner):
    """The best of `TubePlanner`, `FollowPlanner` and some between."""

    name = "best"
    style = Style(compare=True)

    def move(
        self,
        space: FreeSpace,
        scope: Scope,
        *,
        options: PlannerOptions,
        progress: Progress = no_progress,
    ) -> TubeMotion:
        """Return the motion with the most certified clearance, and name its planner."""
        motion = super().move(space, scope, options=options, progress=progress)
        return replace(motion, method="follow" if motion.freedom == 0.0 else "tube")
