"""Views: pictures, the report and the animated scene of a plan."""

from __future__ import annotations

from .clearance_plot import draw_clearance
from .comparison_plot import draw_comparison
from .contact_plot import draw_contact
from .figures import draw_depths, draw_overview, write_figure
from .fluoroscopy import Projection, render_fluoroscopy
from .report import write_report
from .robot_motion_plot import draw_robot_motion
from .scene import SceneInfo, write_scene

__all__ = [
    "Projection",
    "SceneInfo",
    "draw_clearance",
    "draw_comparison",
    "draw_contact",
    "draw_depths",
    "draw_overview",
    "draw_robot_motion",
    "render_fluoroscopy",
    "write_figure",
    "write_report",
    "write_scene",
]
