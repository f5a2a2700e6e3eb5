"""Whether a tract's size can be that of a body's."""

from __future__ import annotations

from .findings import Finding

__all__ = ["check_scale"]

SMALLEST = 10.0
LARGEST = 3000.0
"""Longest side of the box around a plausible tract [mm]."""


def check_scale(longest: float, *, hint: str) -> list[Finding]:
    """Warn if the longest side of the box around a tract is implausible.

    Parameters
    ----------
    longest : float
        Longest side [mm].
    hint : str
        What to try.
    """
    if SMALLEST <= longest <= LARGEST:
        return []
    word = "small" if longest < SMALLEST else "large"
    message = (
        f"the tract is implausibly {word}: its longest side is {longest:.3g} mm, expected "
        f"{SMALLEST:g} to {LARGEST:g} mm; {hint}"
    )
    return [Finding("scale", "warning", message)]
