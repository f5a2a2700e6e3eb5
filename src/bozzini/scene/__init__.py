"""What can be turned: a plan as an animated scene (GLB), and pages that show anything in 3-D."""

from __future__ import annotations

from .page import Page, render_page, show
from .scene import SceneInfo, SceneOptions, write_scene
from .view import View

__all__ = [
    "Page",
    "SceneInfo",
    "SceneOptions",
    "View",
    "render_page",
    "show",
    "write_scene",
]


def __dir__() -> list[str]:
    return sorted(__all__)
