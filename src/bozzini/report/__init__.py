"""The report of a plan: one HTML page."""

from __future__ import annotations

from .report import write_report

__all__ = [
    "write_report",
]


def __dir__() -> list[str]:
    return sorted(__all__)
