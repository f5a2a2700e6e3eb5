"""Progress of long work: the library reports fractions, whoever calls decides how to show them."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Progress", "no_progress"]

Progress = Callable[[str, float], None]
"""Called as ``progress(stage, fraction)`` with a fraction from 0 to 1."""


def no_progress(stage: str, fraction: float) -> None:
    """Show nothing: the default of every library function."""
