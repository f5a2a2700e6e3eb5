"""Studies: whole jobs from input to written result."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .definition import Study
    from .factors import Factor, Limit, Sampling, Search, StudySpec
    from .insertion import InsertionStudy, run_insertion
    from .jobs import JOBS, Job, RowJob, Rows
    from .options import InsertionOptions, PathOptions, ReadOptions, TractFitOptions
    from .population import Population, count_fits
    from .run import Engine, StudyResult, read_rows, run_study
    from .sensitivity import StudySpread, analyse_rows, analyse_study
    from .shapes import FitStudy, SectionStudy, run_fit, run_sections
    from .tip import TipError, effector_tip_error, robot_tip_error
    from .traverse import LimitsStudy, run_limits

__all__ = [
    "JOBS",
    "Engine",
    "Factor",
    "Job",
    "Limit",
    "RowJob",
    "Rows",
    "Sampling",
    "Search",
    "Study",
    "StudyResult",
    "StudySpec",
    "TractFitOptions",
    "FitStudy",
    "InsertionOptions",
    "InsertionStudy",
    "LimitsStudy",
    "PathOptions",
    "Population",
    "ReadOptions",
    "SectionStudy",
    "StudySpread",
    "TipError",
    "analyse_rows",
    "analyse_study",
    "count_fits",
    "effector_tip_error",
    "robot_tip_error",
    "run_fit",
    "run_insertion",
    "run_limits",
    "run_sections",
    "run_study",
    "read_rows",
]

_MODULES = {
    "definition": ("Study",),
    "factors": ("Factor", "Limit", "Sampling", "Search", "StudySpec"),
    "insertion": ("InsertionStudy", "run_insertion"),
    "jobs": ("JOBS", "Job", "RowJob", "Rows"),
    "options": ("TractFitOptions", "InsertionOptions", "PathOptions", "ReadOptions"),
    "population": ("Population", "count_fits"),
    "run": ("Engine", "StudyResult", "read_rows", "run_study"),
    "sensitivity": ("StudySpread", "analyse_rows", "analyse_study"),
    "shapes": ("FitStudy", "SectionStudy", "run_fit", "run_sections"),
    "tip": ("TipError", "effector_tip_error", "robot_tip_error"),
    "traverse": ("LimitsStudy", "run_limits"),
}


def __getattr__(name: str) -> Any:
    """Load a study when it is first asked for: the options alone are cheap (PEP 562)."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
