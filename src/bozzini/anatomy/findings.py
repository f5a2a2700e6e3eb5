"""What a check found in an input: not an error, but something its user should know."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ..errors import InputError

__all__ = ["Finding", "name_place"]

SEVERITIES = ("note", "warning")


@dataclass(frozen=True)
class Finding:
    """One thing that a check of an input found.

    Attributes
    ----------
    code : str
        A short, stable name such as ``"components-dropped"``, for programs.
    severity : str
        ``"note"`` (said for the record) or ``"warning"`` (look at it before trusting the result).
    message : str
        One line for people.

    Raises
    ------
    InputError
        If the severity is neither of the two.
    """

    code: str
    severity: str
    message: str

    def __post_init__(self) -> None:
        if self.severity not in SEVERITIES:
            raise InputError(
                f"severity is {self.severity!r}: it must be one of {', '.join(SEVERITIES)}"
            )

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"


def name_place(point: Iterable[float]) -> str:
    """Return a place of the world as text, ``"(12.0, -3.5, 80.1)"``."""
    return "(" + ", ".join(f"{float(value):.1f}" for value in point) + ")"
