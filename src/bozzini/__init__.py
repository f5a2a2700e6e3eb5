"""Bozzini: open tools for endoscopic robots, from a CT scan to a scope's motion.

Lengths are in mm, forces in N, pressures in MPa, angles in rad and times in s everywhere.
Importing this package is cheap: what it names is loaded when it is first used.
"""

from __future__ import annotations

import importlib as _importlib
import os as _os
from typing import TYPE_CHECKING as _TYPE_CHECKING

from .views import load_views_by as _load_views_by

if _TYPE_CHECKING:
    from . import anatomy, continuum, duct, effector, motion, muscle, plot, study
    from .anatomy import make_phantom, read_tract
    from .continuum import ContinuumRobot
    from .duct import build_field, find_centreline
    from .effector import Effector
    from .errors import BozziniError
    from .motion import Plan, Scope, plan_insertion
    from .scene import show

__version__ = "0.1.0"

__all__ = [
    "BozziniError",
    "ContinuumRobot",
    "Effector",
    "Plan",
    "Scope",
    "__version__",
    "anatomy",
    "build_field",
    "continuum",
    "duct",
    "effector",
    "find_centreline",
    "make_phantom",
    "motion",
    "muscle",
    "plan_insertion",
    "plot",
    "read_tract",
    "show",
    "study",
]

_PLACES = {
    "BozziniError": "errors",
    "ContinuumRobot": "continuum",
    "Effector": "effector",
    "Plan": "motion",
    "Scope": "motion",
    "build_field": "duct",
    "find_centreline": "duct",
    "make_phantom": "anatomy",
    "plan_insertion": "motion",
    "read_tract": "anatomy",
    "show": "scene",
}

# Before Numba is loaded: it reads the variable then. Asking costs less than a millisecond.
if not all(_os.access(place, _os.W_OK) for place in (*__path__, _os.path.expanduser("~"))):
    from .io.files import provide_caches

    provide_caches()


def _load_views() -> None:
    from .scene import page  # noqa: F401  # it registers itself


_load_views_by(_load_views)  # here, where all packages are known


def __getattr__(name: str) -> object:
    """Load a package or a public name when it is first asked for (PEP 562)."""
    if name in _PLACES:
        value = getattr(_importlib.import_module(f".{_PLACES[name]}", __name__), name)
        globals()[name] = value
        return value
    if not name.startswith("_"):
        try:
            return _importlib.import_module(f".{name}", __name__)
        except ModuleNotFoundError as error:
            if error.name != f"{__name__}.{name}":
                raise
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
