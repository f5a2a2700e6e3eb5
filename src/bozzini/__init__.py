"""Bozzini: open tools for endoscopic robots, from a CT scan to a scope's motion.

Lengths are in mm, forces in N, pressures in MPa, angles in rad and times in s everywhere.
Importing this package is cheap: a room such as `bozzini.motion` is loaded when it is first used.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import (
        anatomy,
        continuum,
        duct,
        effector,
        errors,
        motion,
        muscle,
        plot,
        report,
        scene,
        study,
        units,
    )
    from .errors import BozziniError
    from .motion.plan import Plan
    from .motion.scope import Scope

__version__ = "0.1.0"

__all__ = [
    "BozziniError",
    "Plan",
    "Scope",
    "__version__",
    "anatomy",
    "continuum",
    "duct",
    "effector",
    "errors",
    "motion",
    "muscle",
    "study",
    "units",
    "plot",
    "report",
    "scene",
]

_ROOMS = frozenset(
    {
        "anatomy",
        "continuum",
        "duct",
        "effector",
        "errors",
        "motion",
        "muscle",
        "study",
        "units",
        "plot",
        "report",
        "scene",
    }
)
_NAMES = {
    "BozziniError": ".errors",
    "Plan": ".motion.plan",
    "Scope": ".motion.scope",
}

# Before Numba is loaded: it reads the variable then. Asking costs less than a millisecond.
if not all(os.access(place, os.W_OK) for place in (*__path__, os.path.expanduser("~"))):
    from .io.files import provide_caches

    provide_caches()


def __getattr__(name: str) -> Any:
    """Load a room or a public name when it is first asked for (PEP 562)."""
    if name in _ROOMS:
        return importlib.import_module(f".{name}", __name__)
    if name in _NAMES:
        value = getattr(importlib.import_module(_NAMES[name], __name__), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
