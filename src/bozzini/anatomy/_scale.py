"""Whether a tract's size can be that of a body's."""

from __future__ import annotations

from ..errors import GeometryError
from .findings import Finding

__all__ = ["check_scale"]

SMALLEST = 10.0
LARGEST = 3000.0
"""Longest side of the box around a plausible tract [mm]."""

LEAST = 1.0
MOST = 10_000.0
"""Longest side of the box around what is taken for a tract at all [mm]."""


def check_scale(longest: float, *, hint: str) -> list[Finding]:
    """Warn if the longest side of the box around a tract is implausible, refuse an absurd one.

    Parameters
    ----------
    longest : float
        Longest side [mm].
    hint : str
        What to try.

    Raises
    ------
    GeometryError
        If it is below `LEAST` or above `MOST`.
    """
    if SMALLEST <= longest <= LARGEST:
        return []
    word = "small" if longest < SMALLEST else "large"
    said = f"the tract is implausibly {word}: its longest side is {longest:.3g} mm"
    if not LEAST <= longest <= MOST:
        raise GeometryError(f"{said}, it must be {LEAST:g} to {MOST:g} mm; {hint}")
    message = f"{said}, expected {SMALLEST:g} to {LARGEST:g} mm; {hint}"
    return [Finding("scale", "warning", message)]
