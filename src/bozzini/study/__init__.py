"""Studies: whole jobs from input to written result."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .contact import ContactRisk, study_contact
    from .definition import Study
    from .factors import Factor, Limit, Sampling, Search, StudySpec
    from .insertion import InsertionStudy, run_insertion
    from .jobs import JOBS, Job, RowJob, Rows
    from .options import (
        ContactOptions,
        InsertionOptions,
        PathOptions,
        ReadOptions,
        TractFitOptions,
    )
    from .population import Population, count_fits
    from .run import Engine, StudyResult, read_rows, run_study
    from .sensitivity import StudySpread, analyse_rows, analyse_study
    from .shapes import FitStudy, SectionStudy, run_fit, run_sections
    from .tip import TipError, effector_tip_error, robot_tip_error
    from .traverse import LimitsStudy, run_limits
    from .wall import WallError, bound_contact

__all__ = [
    "ContactOptions",
    "ContactRisk",
    "Engine",
    "Factor",
    "FitStudy",
    "InsertionOptions",
    "InsertionStudy",
    "JOBS",
    "Job",
    "Limit",
    "LimitsStudy",
    "PathOptions",
    "Population",
    "ReadOptions",
    "RowJob",
    "Rows",
    "Sampling",
    "Search",
    "SectionStudy",
    "Study",
    "StudyResult",
    "StudySpec",
    "StudySpread",
    "TipError",
    "TractFitOptions",
    "WallError",
    "analyse_rows",
    "analyse_study",
    "bound_contact",
    "count_fits",
    "effector_tip_error",
    "read_rows",
    "robot_tip_error",
    "run_fit",
    "run_insertion",
    "run_limits",
    "run_sections",
    "run_study",
    "study_contact",
]

_MODULES = {
    "contact": ("ContactRisk", "study_contact"),
    "definition": ("Study",),
    "factors": ("Factor", "Limit", "Sampling", "Search", "StudySpec"),
    "insertion": ("InsertionStudy", "run_insertion"),
    "jobs": ("JOBS", "Job", "RowJob", "Rows"),
    "options": (
        "ContactOptions",
        "InsertionOptions",
        "PathOptions",
        "ReadOptions",
        "TractFitOptions",
    ),
    "population": ("Population", "count_fits"),
    "run": ("Engine", "StudyResult", "read_rows", "run_study"),
    "sensitivity": ("StudySpread", "analyse_rows", "analyse_study"),
    "shapes": ("FitStudy", "SectionStudy", "run_fit", "run_sections"),
    "tip": ("TipError", "effector_tip_error", "robot_tip_error"),
    "traverse": ("LimitsStudy", "run_limits"),
    "wall": ("WallError", "bound_contact"),
}


def __getattr__(name: str) -> Any:
    """Load a study when it is first asked for: the options alone are cheap (PEP 562)."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
