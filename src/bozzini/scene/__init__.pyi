from .page import Page, render_page, show
from .scene import SceneInfo, SceneOptions, write_scene
from .slicer import SlicerLink
from .view import View

__all__ = [
    "Page",
    "SceneInfo",
    "SceneOptions",
    "SlicerLink",
    "View",
    "render_page",
    "show",
    "write_scene",
]
