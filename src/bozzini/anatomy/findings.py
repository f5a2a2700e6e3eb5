"""What a check found in an input: not an error, but something its user should know."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError

__all__ = ["Finding"]

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
