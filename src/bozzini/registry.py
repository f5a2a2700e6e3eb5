"""Registries of classes by name: this package's own, and those of other installed packages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TypeVar

from .errors import InputError

__all__ = ["Registry", "collect_named"]

T = TypeVar("T")


class Registry(Mapping[str, type[T]]):
    """Classes by name: this package's own, then those that other packages add by entry points.

    Another package names its classes in its metadata, in ``pyproject.toml`` for example::

        [project.entry-points."bozzini.muscles"]
        spring = "my_package.models:SpringMuscle"

    They are imported when they are first asked for. A name that this package has already stays
    with it.

    Parameters
    ----------
    group : str
        Entry points by which other packages add classes.
    base : type
        The class that all must derive from.
    find_own : callable
        Returns this package's own classes by name; called when they are first asked for.
    noun : str
        What one of them is called in messages.
    """

    def __init__(
        self,
        group: str,
        base: type[T],
        find_own: Callable[[], Mapping[str, type[T]]],
        *,
        noun: str = "model",
    ) -> None:
        self.group = group
        self.base = base
        self.noun = noun
        self._find_own = find_own

    @cached_property
    def own(self) -> Mapping[str, type[T]]:
        """The classes of this package."""
        return self._find_own()

    @cached_property
    def plugins(self) -> dict[str, EntryPoint]:
        """The classes of other packages by name, not imported yet."""
        found = entry_points(group=self.group)
        return {point.name: point for point in found if point.name not in self.own}

    def __getitem__(self, name: str) -> type[T]:
        if name in self.own:
            return self.own[name]
        point = self.plugins[name]
        try:
            kind = point.load()
        except Exception as error:  # the other package's: it may raise anything
            raise InputError(
                f"the {self.noun} {name} of {point.value} cannot be imported: {error}"
            ) from error
        if not (isinstance(kind, type) and issubclass(kind, self.base)):
            raise InputError(
                f"the {self.noun} {name} is {point.value}: it must be a {self.base.__name__}"
            )
        return kind

    def __contains__(self, name: object) -> bool:  # without importing it
        return name in self.own or name in self.plugins

    def __iter__(self) -> Iterator[str]:
        yield from self.own
        yield from self.plugins

    def __len__(self) -> int:
        return len(self.own) + len(self.plugins)


def collect_named(modules: Iterable[ModuleType], base: type[T]) -> dict[str, type[T]]:
    """Return the subclasses of `base` in modules that have a `name` of their own, by it."""
    found = (item for module in modules for item in vars(module).values())
    kinds = dict.fromkeys(item for item in found if isinstance(item, type))
    return {
        vars(kind)["name"]: kind
        for kind in kinds
        if issubclass(kind, base) and isinstance(vars(kind).get("name"), str)
    }
