"""The animated scene of a plan: one GLB file."""

from __future__ import annotations

from .scene import SceneInfo, write_scene

__all__ = [
    "SceneInfo",
    "write_scene",
]
