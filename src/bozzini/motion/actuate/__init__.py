"""From a plan to the tendon motions of a continuum robot."""

from __future__ import annotations

from .actuate import actuate_plan
from .actuation import Actuation

__all__ = ["Actuation", "actuate_plan"]
