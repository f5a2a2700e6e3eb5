"""The models by name. A family of models is a module beside, with its classes in ``FAMILY``."""

from __future__ import annotations

from ..energy import EnergyMuscle
from ..thesis import ThesisMuscle
from . import (
    correction,
    correction_force,
    correction_friction,
    detailed,
    elastic,
    empirical,
    empirical_polynomials,
    ends,
    hyperelastic,
    hyperelastic_tube,
    ideal,
    layers,
    miniature,
    miniature_fit,
    miniature_hocking,
    miniature_stress,
)
from ._describe import describe_card
from .base import CatalogueModel
from .card import Card, Choice, Law, Parameter, count_statuses

__all__ = [
    "CATALOGUE",
    "MODELS",
    "Card",
    "CatalogueModel",
    "Choice",
    "Law",
    "Parameter",
    "count_statuses",
    "describe_card",
]

_FAMILIES = (
    ideal.FAMILY,
    correction.FAMILY,
    correction_friction.FAMILY,
    correction_force.FAMILY,
    elastic.FAMILY,
    hyperelastic.FAMILY,
    hyperelastic_tube.FAMILY,
    ends.FAMILY,
    layers.FAMILY,
    detailed.FAMILY,
    miniature.FAMILY,
    miniature_hocking.FAMILY,
    miniature_stress.FAMILY,
    miniature_fit.FAMILY,
    empirical.FAMILY,
    empirical_polynomials.FAMILY,
)

CATALOGUE: dict[str, type[CatalogueModel]] = {
    kind.card.name: kind for family in _FAMILIES for kind in family
}
"""Models of the survey (thesis chapter 2) by name; each has a `Card`."""

MODELS: dict[str, type[EnergyMuscle] | type[ThesisMuscle]] = {
    "energy": EnergyMuscle,
    "thesis": ThesisMuscle,
}
"""This package's own models by name, of a `Muscle` alone; `CATALOGUE` has those of the survey."""
