"""The animated scene of a plan: one GLB file."""

from __future__ import annotations

from .scene import SceneInfo, SceneOptions, write_scene

__all__ = [
    "SceneInfo",
    "SceneOptions",
    "write_scene",
]


def __dir__() -> list[str]:
    return sorted(__all__)
