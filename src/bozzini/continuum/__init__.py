"""Continuum robots: from tendon displacements to the shape and back (thesis 5.2)."""

from __future__ import annotations

from .arc import ArcModel
from .energy import EnergyModel
from .inverse import InverseResult, solve_curve, solve_pose, solve_tip
from .linkage import LinkageModel
from .models import MODELS
from .robot import ContinuumRobot
from .rod import RodModel
from .section import Section, Tendon
from .section_inverse import solve_section
from .shape import Shape, ShapeModel
from .workspace import sample_workspace

__all__ = [
    "MODELS",
    "ArcModel",
    "ContinuumRobot",
    "EnergyModel",
    "InverseResult",
    "LinkageModel",
    "RodModel",
    "Section",
    "Shape",
    "ShapeModel",
    "Tendon",
    "sample_workspace",
    "solve_curve",
    "solve_pose",
    "solve_section",
    "solve_tip",
]
