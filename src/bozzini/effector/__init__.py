"""The end-effector: muscles round a backbone, a pressure each, and where the tip goes (ch. 4)."""

from __future__ import annotations

from .amplitudes import Reach, find_reach
from .combine import find_resultant
from .conflicts import find_conflicts
from .cubic import CubicFit, fit_cubic, look_up_pressures
from .design import BEAM_FACTORS, EffectorDesign, PlacedMuscle, rigidity_from_test
from .effector import Effector
from .equilibrium import BALANCE_METHODS, Balance, balance
from .forward import (
    Bend,
    Peak,
    bend,
    contraction_for_lateral,
    find_peak,
    lateral_deflection,
    lateral_slope,
    place_curve,
)
from .inverse import InverseResult, solve_inverse
from .optimise import Optimum, optimise_design
from .pose import POSE_METHODS, EffectorPose, pose
from .presets import PRESETS, preset
from .projected import INVERSE_OUTCOMES, ProjectedInverse, project_inverse
from .sectors import Sectors, find_sectors
from .stick import Stick, find_stick_scale, steer
from .study import Sweep, SweepRow, change_design, find_needed_pressure, sweep
from .tip_force import TipForce, passive_stiffness, tip_force, tip_stiffness
from .trace import Trace, trace_circle, trace_line, trace_path
from .workspace import Workspace, place_tips, workspace

__all__ = [
    "BALANCE_METHODS",
    "BEAM_FACTORS",
    "INVERSE_OUTCOMES",
    "POSE_METHODS",
    "PRESETS",
    "Balance",
    "Bend",
    "CubicFit",
    "Effector",
    "EffectorDesign",
    "EffectorPose",
    "InverseResult",
    "Optimum",
    "Peak",
    "PlacedMuscle",
    "ProjectedInverse",
    "Reach",
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
    "preset",
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
