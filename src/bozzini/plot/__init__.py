"""Pictures of plans, ducts, robots and muscles."""

from __future__ import annotations

import sys

from .clearance import draw_clearance
from .comparison import draw_comparison
from .contact import draw_contact
from .continuum import draw_robot_motion
from .figures import draw_depths, draw_overview, write_figure
from .fluoroscopy import Projection, render_fluoroscopy

__all__ = [
    "Projection",
    "draw_clearance",
    "draw_comparison",
    "draw_contact",
    "draw_depths",
    "draw_overview",
    "draw_robot_motion",
    "render_fluoroscopy",
    "write_figure",
]


def __dir__() -> list[str]:
    return sorted(__all__)


def _let_notebooks_show_figures() -> None:
    """Have a notebook show figures that are not pyplot's: else it does so after one of pyplot's."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    if getattr(shell, "kernel", None) is not None:
        from matplotlib import get_backend, pyplot

        pyplot.switch_backend(get_backend())


_let_notebooks_show_figures()
