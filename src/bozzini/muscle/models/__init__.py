"""The muscle models by name: of this package, and of others that are installed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points

from ...errors import InputError
from ..model import MuscleModel
from . import correction, elastic, empirical, energy, ideal, miniature, structure, thesis
from .base import CatalogueModel
from .card import Card, Choice, Law, Parameter, count_statuses, describe_card

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
]

MODULES = (energy, thesis, ideal, correction, elastic, structure, miniature, empirical)
"""Where the models of this package are; a new module is named here."""

GROUP = "bozzini.muscles"
"""Entry points by which other packages add models."""


class ModelRegistry(Mapping[str, type[MuscleModel]]):
    """Classes of muscle models by name: those of `MODULES`, and those of other packages.

    Another package names its models in its metadata, in ``pyproject.toml`` for example::

        [project.entry-points."bozzini.muscles"]
        spring = "my_package.models:SpringMuscle"

    They are imported when they are first asked for. A name that this package has already stays
    with it.
    """

    @cached_property
    def own(self) -> dict[str, type[MuscleModel]]:
        """The models of this package."""
        found = (item for module in MODULES for item in vars(module).values())
        kinds = [
            kind
            for kind in dict.fromkeys(item for item in found if isinstance(item, type))
            if issubclass(kind, MuscleModel) and isinstance(vars(kind).get("name"), str)
        ]
        return {kind.name: kind for kind in kinds}

    @cached_property
    def plugins(self) -> dict[str, EntryPoint]:
        """The models of other packages by name, not imported yet."""
        found = entry_points(group=GROUP)
        return {point.name: point for point in found if point.name not in self.own}

    @property
    def cards(self) -> dict[str, Card]:
        """The cards of this package's models of the literature."""
        return {name: kind.card for name, kind in self.own.items() if kind.card is not None}

    def __getitem__(self, name: str) -> type[MuscleModel]:
        if name in self.own:
            return self.own[name]
        point = self.plugins[name]
        try:
            kind = point.load()
        except Exception as error:  # the other package's: it may raise anything
            raise InputError(
                f"the model {name} of {point.value} cannot be imported: {error}"
            ) from error
        if not (isinstance(kind, type) and issubclass(kind, MuscleModel)):
            raise InputError(f"the model {name} is {point.value}: it must be a MuscleModel")
        return kind

    def __iter__(self) -> Iterator[str]:
        yield from self.own
        yield from self.plugins

    def __len__(self) -> int:
        return len(self.own) + len(self.plugins)


MODELS = ModelRegistry()
"""All muscle models by name."""
