from .clearance import draw_clearance
from .comparison import draw_comparison
from .contact import draw_contact
from .continuum import draw_bode, draw_robot_motion
from .figures import draw_depths, draw_overview, write_figure
from .fluoroscopy import Projection, render_fluoroscopy

__all__ = [
    "Projection",
    "draw_bode",
    "draw_clearance",
    "draw_comparison",
    "draw_contact",
    "draw_depths",
    "draw_overview",
    "draw_robot_motion",
    "render_fluoroscopy",
    "write_figure",
]
