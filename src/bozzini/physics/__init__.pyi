from .environment import Insertion, Lumen, rate_policy
from .execute import Execution, execute
from .export import format_mjcf, format_trajectory, format_urdf
from .manoeuvre import Manoeuvre, Step, StepReport
from .options import ExecuteOptions, ScopeOptions, WallOptions
from .robots import ManoeuvreDrive, PlanDrive, PushDrive, TendonDrive, build_tendon_chain
from .simulate import Chain, Dynamics, Simulation
from .study import ExecutionStudy, Scenery, Trials, run_trials, study_execution
from .tendon_environment import TendonInsertion
from .walls import LumenWall, build_prisms

__all__ = [
    "Chain",
    "Dynamics",
    "ExecuteOptions",
    "Execution",
    "ExecutionStudy",
    "Insertion",
    "Lumen",
    "LumenWall",
    "Manoeuvre",
    "ManoeuvreDrive",
    "PlanDrive",
    "PushDrive",
    "Scenery",
    "ScopeOptions",
    "Simulation",
    "Step",
    "StepReport",
    "TendonDrive",
    "TendonInsertion",
    "Trials",
    "WallOptions",
    "build_prisms",
    "build_tendon_chain",
    "execute",
    "format_mjcf",
    "format_trajectory",
    "format_urdf",
    "rate_policy",
    "run_trials",
    "study_execution",
]
