"""Models of the catalogue with constants to test them, and muscles and lengths to test them on."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from bozzini.errors import InputError
from bozzini.muscle import Muscle, preset
from bozzini.muscle.models import MODELS, CatalogueModel

SURVEY = {name: MODELS[name] for name in MODELS.cards}
"""The models of the literature by name."""
OWN = ("energy", "thesis")
"""The models that are of no paper."""

MUSCLE = preset("effector-45", inner_radius=0.4, gap=0.05, dead_length=3.0)


def differentiate(function: Any, at: Any, *, step: float = 1e-3) -> Any:
    """Slope by a difference of fourth order."""
    near, far = (function(at + k * step) - function(at - k * step) for k in (1.0, 2.0))
    return (8.0 * near - far) / (12.0 * step)


def find_lengths(model: CatalogueModel, count: int = 9, *, edge: float = 0.02) -> np.ndarray:
    """Lengths all over the legal ones, clear of the ends."""
    low, high = (model.braid.length - x for x in model.contraction_limits[::-1])
    return np.linspace(low + edge * (high - low), high - edge * (high - low), count)


def build(name: str, muscle: Muscle = MUSCLE, **changes: Any) -> CatalogueModel:
    """A model of the catalogue with the constants that a fit would start from."""
    kind = MODELS[name]
    return kind(muscle, **{**kind.guess_parameters(muscle), **changes})


@st.composite
def built(draw: Any, name: str, muscle: Muscle) -> CatalogueModel | None:
    """A model with any legal constants, or None where muscle and constants do not go together."""
    kind = MODELS[name]
    guess = kind.guess_parameters(muscle)
    given: dict[str, Any] = {}
    for item in kind.card.parameters:
        low, high = item.bounds
        near = min(max(guess.get(item.name, low), low), high)
        small = min(max(near * draw(st.floats(0.5, 1.5)), low), high)
        given[item.name] = draw(st.sampled_from([near, small, small, low, high]))
    for choice in kind.card.choices:
        given[choice.name] = draw(st.sampled_from(choice.words))
    for law in kind.card.laws:
        given[law.name] = lambda *arguments: 0.1 * arguments[0]
    printed = draw(st.booleans()) and not kind.card.unprintable
    try:
        return kind(muscle, as_printed=printed, **given)
    except InputError:
        return None
