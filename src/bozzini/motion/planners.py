"""The planners by name, and their options; no planner is imported to list them.

Another package adds one in its ``pyproject.toml``::

    [project.entry-points."bozzini.planners"]
    straight = "my_package.planners:StraightPlanner"
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import EntryPoint

from ..checks import check_fields, check_kind, check_number, quantity, show_value
from ..errors import InputError
from ..registry import Registry
from ..results import Shown

GROUP = "bozzini.planners"

HEAD_STEP_MIN_MM, HEAD_STEP_MAX_MM = 1e-3, 10_000.0
"""Least step of the head, and the largest: the longest link that a scope can have."""


class _OwnPlanners(Mapping[str, type[object]]):
    """The planners of this package, each imported when it is asked for."""

    places = {
        "best": "insertion:BestPlanner",
        "tube": "insertion:TubePlanner",
        "follow": "insertion:FollowPlanner",
        "thesis": "thesis:ThesisPlanner",
    }

    def __getitem__(self, name: str) -> type[object]:
        return _load(self.places[name])

    def __contains__(self, name: object) -> bool:  # without importing it
        return name in self.places

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


def _load(place: str) -> type[object]:
    kind: type[object] = EntryPoint("", f"bozzini.motion.{place}", GROUP).load()
    return kind


PLANNERS: Registry[object] = Registry(
    GROUP, lambda: _load("planner:Planner"), _OwnPlanners, noun="planner"
)
"""Subclasses of `bozzini.motion.Planner` by name: ``"best"``, ``"tube"``, ``"follow"``,
``"thesis"``, and those that other installed packages add."""


@dataclass(frozen=True, kw_only=True)
class PlannerOptions(Shown):
    """Options that all planners share.

    Parameters
    ----------
    head_step : float
        How far the head moves per step, at least 0.001 mm [mm]; when a scope is planned, at most a
        link.
    slip : float
        Thesis Appendix C, corrected: 0 tractrix ... 1 the tail moves like the head.
    angle_limit : float, optional
        Largest angle between neighbouring links, in (0, pi] [rad]; the motion stops before it.
    route : sequence of float
        Fractions of the way that the head goes to in turn: ``(1,)`` in, ``(1, 0)`` in and out,
        ``(1, 0, 1)`` in, out, in.
    advise : bool
        Whether to seek what would fit where the scope does not; that takes a few seconds.
    reach : bool
        Whether to seek how far a scope gets that does not come through; else it stays at the
        entry, with the reason.

    Raises
    ------
    InputError
        If a value is outside its range, or the route has no fraction above 0.
    """

    head_step: float = quantity(
        "length",
        "How far the head moves per step.",
        low=HEAD_STEP_MIN_MM,
        high=HEAD_STEP_MAX_MM,
        default=0.25,
    )
    slip: float = quantity(
        help="0: tails are pulled; 1: they move like the head (thesis App. C).",
        low=0.0,
        high=1.0,
        default=0.0,
    )
    angle_limit: float | None = quantity(
        "angle",
        "Largest angle between links, e.g. 45deg.",
        low=0.0,
        high=math.pi,
        low_open=True,
        default=None,
        example="45 deg",
    )
    route: tuple[float, ...] = field(
        default=(1.0,), metadata={"help": "Advance only, or also retract, or go in again."}
    )
    advise: bool = quantity(
        "flag",
        "Seek what would fit, where the scope does not: takes seconds.",
        default=True,
        option="advice",
    )
    reach: bool = True

    def __post_init__(self) -> None:
        check_fields(self)
        check_kind("advise", self.advise, bool)
        check_kind("reach", self.reach, bool)
        object.__setattr__(self, "route", check_route(self.route))


def check_route(route: object) -> tuple[float, ...]:
    """Return the fractions of a route, any sequence of numbers, or raise `InputError`."""
    if isinstance(route, (str, bytes)) or not isinstance(route, Iterable):
        raise InputError(f"route is {show_value(route)}: it must be a sequence of fractions")
    shares = tuple(check_number("route", share, low=0.0, high=1.0) for share in route)
    if max(shares, default=0.0) <= 0.0:
        raise InputError(f"route is {shares}: one of its fractions must lie in (0, 1]")
    return shares
