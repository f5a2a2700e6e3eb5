"""What shows a result in 3-D: a view registers itself here, and no result needs to know one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from .errors import InputError

F = TypeVar("F", bound=Callable[..., object])

_views: dict[type, Callable[..., object]] = {}
_loaders: list[Callable[[], object]] = []


def register_view(*kinds: type) -> Callable[[F], F]:
    """Let a function show what is of these kinds; as a decorator."""

    def register(view: F) -> F:
        _views.update(dict.fromkeys(kinds, view))
        return view

    return register


def load_views_by(load: Callable[[], object]) -> None:
    """Call a function when a view is first looked for: it imports what registers itself."""
    _loaders.append(load)


def find_view(kind: type) -> Callable[..., object]:
    """Return what shows a kind, or one that it derives from.

    Raises
    ------
    InputError
        If nothing does.
    """
    while _loaders:
        _loaders[-1]()
        _loaders.pop()  # not before: one that lacks an extra says so again
    for each in kind.__mro__:
        if each in _views:
            return _views[each]
    raise InputError(f"there is no view of a {kind.__name__}")
