"""The muscle models by name: of this package, and of others that are installed."""

from __future__ import annotations

from ...registry import Registry, collect_named
from ..model import MuscleModel
from . import correction, elastic, empirical, energy, ideal, miniature, structure, thesis
from .base import CatalogueModel
from .card import Card, Choice, Law, Parameter, count_statuses, describe_card, describe_parameter

__all__ = [
    "MODELS",
    "Card",
    "CatalogueModel",
    "Choice",
    "Law",
    "ModelRegistry",
    "Parameter",
    "count_statuses",
    "describe_card",
    "describe_parameter",
]

MODULES = (energy, thesis, ideal, correction, elastic, structure, miniature, empirical)
"""Where the models of this package are; a new module is named here."""


class ModelRegistry(Registry[MuscleModel]):
    """Classes of muscle models by name: those of `MODULES`, and of group `bozzini.muscles`."""

    def __init__(self) -> None:
        super().__init__(
            "bozzini.muscles",
            lambda: MuscleModel,
            lambda: collect_named(MODULES, MuscleModel),  # type: ignore[type-abstract]
        )

    @property
    def cards(self) -> dict[str, Card]:
        """The cards of this package's models of the literature."""
        return {name: kind.card for name, kind in self.own.items() if kind.card is not None}


MODELS = ModelRegistry()
"""All muscle models by name."""
