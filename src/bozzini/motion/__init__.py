"""Motion: how a scope moves through a duct (thesis 5.3)."""

from __future__ import annotations

from .insertion import METHODS, plan_insertion
from .introducer import Introducer
from .plan import Plan
from .scope import Scope

__all__ = ["METHODS", "Introducer", "Plan", "Scope", "plan_insertion"]
