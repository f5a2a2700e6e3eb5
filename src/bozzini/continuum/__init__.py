"""Continuum robots: from tendon displacements to the shape and back (thesis 5.2)."""

from __future__ import annotations

from .arc import ArcModel, arc_frames, bend_vectors, displacements_for, jacobian
from .energy import EnergyModel
from .inverse import (
    ContinuumInverse,
    InverseOptions,
    solve_curve,
    solve_pose,
    solve_section,
    solve_tip,
)
from .kinematics import ContinuumRobot
from .linkage import LinkageModel
from .model import ContinuumModel
from .models import CONTINUUM_MODELS
from .rod import RodModel
from .section import Helix, Section, Tendon
from .shape import Shape
from .workspace import (
    ContinuumWorkspace,
    manipulability,
    measure_dexterity,
    measure_workspace,
    sample_workspace,
)

__all__ = [
    "CONTINUUM_MODELS",
    "ArcModel",
    "ContinuumInverse",
    "ContinuumModel",
    "ContinuumRobot",
    "ContinuumWorkspace",
    "EnergyModel",
    "Helix",
    "InverseOptions",
    "LinkageModel",
    "RodModel",
    "Section",
    "Shape",
    "Tendon",
    "arc_frames",
    "bend_vectors",
    "displacements_for",
    "jacobian",
    "manipulability",
    "measure_dexterity",
    "measure_workspace",
    "sample_workspace",
    "solve_curve",
    "solve_pose",
    "solve_section",
    "solve_tip",
]
