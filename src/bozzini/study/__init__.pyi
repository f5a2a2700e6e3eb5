from .case import Case, CasePlan, open_phantom
from .contact_risk import ContactRisk, study_contact
from .definition import Study
from .factors import Factor, Limit, Sampling, Search, StudySpec
from .insertion import InsertionStudy, run_insertion
from .jobs import JOBS, Job, RowJob, Rows
from .options import ContactRiskOptions, InsertionOptions, PathOptions, ReadOptions, TractFitOptions
from .population import Population, count_fits
from .run import Engine, StudyResult, read_rows, run_study
from .sensitivity import StudySpread, analyse_rows, analyse_study
from .shapes import FitStudy, SectionStudy, run_fit, run_sections
from .tip import TipError, effector_tip_error, robot_tip_error
from .traverse import LimitsStudy, run_limits
from .wall import WallError, bound_contact

__all__ = [
    "Case",
    "CasePlan",
    "ContactRisk",
    "ContactRiskOptions",
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
    "open_phantom",
    "read_rows",
    "robot_tip_error",
    "run_fit",
    "run_insertion",
    "run_limits",
    "run_sections",
    "run_study",
    "study_contact",
]
