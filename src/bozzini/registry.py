"""Registries of classes by name: this package's own, and those of other installed packages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TypeVar

from .checks import choose
from .errors import PluginError

__all__ = ["Registry", "collect_named"]

T = TypeVar("T")


class Registry(Mapping[str, type[T]]):
    """Classes by name: this package's own, then those that other packages add by entry points.

    Another package names its classes in its metadata, in ``pyproject.toml`` for example::

        [project.entry-points."bozzini.muscles"]
        spring = "my_package.models:SpringMuscle"

    They are imported when they are first asked for. A name that this package has already stays with
    it; one that two packages use is refused. Both are listed in `broken`.

    Parameters
    ----------
    group : str
        Entry points by which other packages add classes.
    find_base : callable
        Returns the class that all must derive from; called when another package's is loaded.
    find_own : callable
        Returns this package's own classes by name; called when they are first asked for.
    noun : str
        What one of them is called in messages.
    """

    def __init__(
        self,
        group: str,
        find_base: Callable[[], type[T]],
        find_own: Callable[[], Mapping[str, type[T]]],
        *,
        noun: str = "model",
    ) -> None:
        self.group = group
        self.noun = noun
        self._find_base = find_base
        self._find_own = find_own
        self._loaded: dict[EntryPoint, type[T]] = {}

    @cached_property
    def own(self) -> Mapping[str, type[T]]:
        """The classes of this package."""
        return self._find_own()

    @cached_property
    def plugins(self) -> dict[str, EntryPoint]:
        """The classes of other packages by name, not imported yet."""
        found = entry_points(group=self.group)
        return {point.name: point for point in found if point.name not in self.own}

    @property
    def broken(self) -> dict[str, str]:
        """The names whose classes cannot be used, and why. This imports other packages.

        Where this package has the name, the key is the name and the other package's.
        """
        found = {
            f"{point.name} of {_name_package(point)}": f"'{point.name}' of {_name_place(point)} is "
            f"not used: Bozzini has a {self.noun} of that name"
            for point in entry_points(group=self.group)
            if point.name in self.own
        }
        for name in self.plugins:
            try:
                self[name]
            except PluginError as error:
                found[name] = str(error)
        return found

    def choose(self, name: str) -> type[T]:
        """Return the class of a name.

        Raises
        ------
        InputError
            If there is no such name; the message has those that there are.
        PluginError
            If it is a class of another package that cannot be used.
        """
        choose(self.noun, name, self)
        return self[name]

    def __getitem__(self, name: str) -> type[T]:
        if name in self.own:
            return self.own[name]
        point = self.plugins[name]
        if point not in self._loaded:
            self._loaded[point] = self._load(point)
        return self._loaded[point]

    def _load(self, point: EntryPoint) -> type[T]:
        """Return the class of another package."""
        same = [other for other in entry_points(group=self.group) if other.name == point.name]
        if len(same) > 1:
            raise PluginError(
                f"the {self.noun} '{point.name}' cannot be used: "
                f"{' and '.join(sorted(map(_name_place, same)))} have one of that name; uninstall "
                "all but one"
            )
        label = f"the {self.noun} '{point.name}' of {_name_place(point)}"
        try:
            kind = point.load()
        except (Exception, SystemExit) as error:  # another package may raise anything
            raise PluginError(
                f"{label} cannot be imported: {type(error).__name__}: {error}"
            ) from error
        base = self._find_base()
        if not (isinstance(kind, type) and issubclass(kind, base)):
            raise PluginError(f"{label} cannot be used: it must be a {base.__name__}")
        return kind

    def __contains__(self, name: object) -> bool:  # without importing it
        return name in self.own or name in self.plugins

    def __iter__(self) -> Iterator[str]:
        yield from self.own
        yield from self.plugins

    def __len__(self) -> int:
        return len(self.own) + len(self.plugins)


def _name_package(point: EntryPoint) -> str:
    """Return the name of the package that an entry point is of, or its module's without one."""
    return point.dist.name if point.dist else point.module


def _name_place(point: EntryPoint) -> str:
    """Return the package and the class of an entry point."""
    return f"{point.dist.name} ({point.value})" if point.dist else point.value


def collect_named(modules: Iterable[ModuleType], base: type[T]) -> dict[str, type[T]]:
    """Return the subclasses of `base` in modules that have a `name` of their own, by it."""
    found = (item for module in modules for item in vars(module).values())
    kinds = dict.fromkeys(item for item in found if isinstance(item, type))
    return {
        vars(kind)["name"]: kind
        for kind in kinds
        if issubclass(kind, base) and isinstance(vars(kind).get("name"), str)
    }
