"""What a set of measured data contributes to the page."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """An error that was measured, and the largest that is allowed."""

    what: str
    measured: float
    required: float
    unit: str

    @property
    def is_kept(self) -> bool:
        """Whether it is not above what is allowed; a NaN is."""
        return self.measured <= self.required


@dataclass(frozen=True)
class Section:
    """Title, source with its reference, licence, lines of Markdown, and bounds."""

    title: str
    source: str
    licence: str
    text: tuple[str, ...]
    bounds: tuple[Bound, ...] = ()
