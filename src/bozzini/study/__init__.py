"""Studies: whole jobs from input to written result."""

from __future__ import annotations

from .insertion import InsertionStudy, run_insertion

__all__ = ["InsertionStudy", "run_insertion"]
