"""The planners by name, this package's own and those of others; none is imported to list them.

Another package adds one in its ``pyproject.toml``::

    [project.entry-points."bozzini.planners"]
    straight = "my_package.planners:StraightPlanner"
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import EntryPoint

from ..registry import Registry

GROUP = "bozzini.planners"


class _OwnPlanners(Mapping[str, type[object]]):
    """The planners of this package, each imported when it is asked for."""

    places = {
        "best": "bozzini.motion.insertion:BestPlanner",
        "tube": "bozzini.motion.insertion:TubePlanner",
        "follow": "bozzini.motion.insertion:FollowPlanner",
        "thesis": "bozzini.motion.thesis:ThesisPlanner",
    }

    def __getitem__(self, name: str) -> type[object]:
        kind: type[object] = EntryPoint(name, self.places[name], GROUP).load()
        return kind

    def __iter__(self) -> Iterator[str]:
        return iter(self.places)

    def __len__(self) -> int:
        return len(self.places)


PLANNERS: Registry[object] = Registry(GROUP, object, _OwnPlanners, noun="planner")
"""Subclasses of `bozzini.motion.Planner` by name: ``"best"``, ``"tube"``, ``"follow"``,
``"thesis"``, and those that other installed packages add."""
