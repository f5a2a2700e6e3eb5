"""Motions driven in MuJoCo: forces of a plan, of a pushed scope, files for simulators, learning.

Needs the extra ``physics``, but for the options.
"""

from __future__ import annotations

import importlib

__all__ = [
    "Chain",
    "Dynamics",
    "ExecuteOptions",
    "Execution",
    "ExecutionStudy",
    "Insertion",
    "Lumen",
    "LumenWall",
    "PlanDrive",
    "PushDrive",
    "Scenery",
    "ScopeOptions",
    "Simulation",
    "TendonDrive",
    "Trials",
    "WallOptions",
    "build_prisms",
    "build_tendon_chain",
    "execute",
    "format_mjcf",
    "format_trajectory",
    "format_urdf",
    "rate_policy",
    "run_trials",
    "study_execution",
]

_MODULES = {
    name: module
    for module, names in {
        "environment": ("Insertion", "Lumen", "rate_policy"),
        "execute": ("Execution", "execute"),
        "export": ("format_mjcf", "format_trajectory", "format_urdf"),
        "options": ("ExecuteOptions", "ScopeOptions", "WallOptions"),
        "robots": ("PlanDrive", "PushDrive", "TendonDrive", "build_tendon_chain"),
        "simulate": ("Chain", "Dynamics", "Simulation"),
        "study": ("ExecutionStudy", "Scenery", "Trials", "run_trials", "study_execution"),
        "walls": ("LumenWall", "build_prisms"),
    }.items()
    for name in names
}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
