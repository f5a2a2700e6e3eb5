"""The end-effector: muscles round a backbone, a pressure each, and where the tip goes (ch. 4)."""

from __future__ import annotations

from .design import (
    BEAM_FACTORS,
    EFFECTOR_PRESETS,
    EffectorDesign,
    PlacedMuscle,
    effector_preset,
    rigidity_from_test,
)
from .effector import Effector
from .equilibrium import BALANCE_METHODS, Balance, balance
from .inverse import (
    INVERSE_OUTCOMES,
    EffectorInverse,
    ProjectedInverse,
    Reach,
    Sectors,
    find_reach,
    find_sectors,
    project_inverse,
    solve_inverse,
)
from .linkage import (
    LinkageBend,
    Peak,
    bend,
    contraction_for_lateral,
    find_conflicts,
    find_peak,
    lateral_deflection,
    lateral_slope,
    place_curve,
)
from .model import EffectorModel
from .pose import POSE_METHODS, EffectorPose, find_resultant, pose
from .steering import (
    CubicFit,
    Stick,
    Trace,
    find_stick_scale,
    fit_cubic,
    look_up_pressures,
    steer,
    trace_circle,
    trace_line,
    trace_path,
)
from .study import (
    Optimum,
    Sweep,
    SweepRow,
    change_design,
    find_needed_pressure,
    optimise_design,
    sweep,
)
from .workspace import (
    TipForce,
    Workspace,
    passive_stiffness,
    place_tips,
    tip_force,
    tip_stiffness,
    workspace,
)

__all__ = [
    "BALANCE_METHODS",
    "BEAM_FACTORS",
    "INVERSE_OUTCOMES",
    "POSE_METHODS",
    "EFFECTOR_PRESETS",
    "Balance",
    "LinkageBend",
    "CubicFit",
    "Effector",
    "EffectorDesign",
    "EffectorPose",
    "EffectorInverse",
    "Optimum",
    "Peak",
    "PlacedMuscle",
    "ProjectedInverse",
    "Reach",
    "EffectorModel",
    "Sectors",
    "Stick",
    "Sweep",
    "SweepRow",
    "TipForce",
    "Trace",
    "Workspace",
    "balance",
    "bend",
    "change_design",
    "contraction_for_lateral",
    "find_conflicts",
    "find_needed_pressure",
    "find_peak",
    "find_reach",
    "find_resultant",
    "find_sectors",
    "find_stick_scale",
    "fit_cubic",
    "lateral_deflection",
    "lateral_slope",
    "look_up_pressures",
    "optimise_design",
    "passive_stiffness",
    "place_curve",
    "place_tips",
    "pose",
    "effector_preset",
    "project_inverse",
    "rigidity_from_test",
    "solve_inverse",
    "steer",
    "sweep",
    "tip_force",
    "tip_stiffness",
    "trace_circle",
    "trace_line",
    "trace_path",
    "workspace",
]


def __dir__() -> list[str]:
    return sorted(__all__)
