"""Progress of long work: the library reports fractions, whoever calls decides how to show them."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Progress", "announce", "announce_by", "no_progress"]

Progress = Callable[[str, float], None]
"""Called as ``progress(stage, fraction)`` with a fraction from 0 to 1."""


def no_progress(stage: str, fraction: float) -> None:
    """Show nothing: the default of every library function."""


def announce(text: str) -> None:
    """Tell of something that takes long, or goes another way, though nobody asked for it."""
    for tell in _listeners:
        tell(text)


_listeners: list[Callable[[str], None]] = []


def announce_by(tell: Callable[[str], None] | None) -> None:
    """Choose who is told of what is announced; None for nobody, which is the default."""
    _listeners[:] = [] if tell is None else [tell]
