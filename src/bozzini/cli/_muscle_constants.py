"""``--set [MODEL.]NAME=VALUE``: constants and choices of a model of the catalogue, from text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from ._muscle_options import list_kinds

if TYPE_CHECKING:
    from ..muscle.model import StaticModel
    from ..muscle.models import Card, Parameter

__all__ = ["describe_constants", "find_card", "parse_constant", "parse_settings", "set_option"]

_KINDS = {"mm": "length", "MPa": "pressure", "N": "force", "rad": "angle"}

_Function = Callable[..., Any]


def set_option(function: _Function) -> _Function:
    """Add ``--set``, which can be repeated."""
    return click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="[MODEL.]NAME=VALUE",
        help="A constant of a model of the catalogue, see 'bozzini muscle models NAME'; can be "
        "repeated. MODEL says whose it is, where several have one of that name.",
    )(function)


def find_card(name: str) -> Card | None:
    """Return the card of a model; None for those of this package, which have none."""
    card: Card | None = getattr(list_kinds()[name], "card", None)
    return card


def parse_settings(names: Sequence[str], texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return what is set in each model.

    Raises
    ------
    InputError
        If a text is no [MODEL.]NAME=VALUE, or names a law, nothing that the models take, or what
        several of them have without saying which; or if a value is not legal in its model.
    """
    from ..errors import InputError

    found: dict[str, dict[str, Any]] = {name: {} for name in names}
    for text in texts:
        place, mark, value = (part.strip() for part in text.partition("="))
        model, dot, key = (part.strip() for part in place.rpartition("."))
        key = key.replace("-", "_")
        if not (key and mark and value) or bool(dot) != bool(model):
            raise InputError(
                f"--set is '{text}': it must be NAME=VALUE or MODEL.NAME=VALUE, such as kappa1=0.5"
            )
        card = _find_owner([model] if model in names else names, model, key)
        if key in found[card.name]:
            raise InputError(f"--set names {place} more than once: give it once")
        found[card.name][key] = _parse_value(card, key, value)
    return found


def _find_owner(names: Sequence[str], model: str, key: str) -> Card:
    """Return the card of the one model of some that takes a constant."""
    from ..errors import InputError

    if model and model not in names:
        known = "not among those taken" if model in list_kinds() else "not known"
        raise InputError(
            f"--set names the model '{model}', which is {known}: it must be "
            f"{_list_some(list(names))}"
        )
    cards = [card for card in map(find_card, names) if card is not None and key in card.keywords]
    if not cards:
        raise InputError(f"--set names '{key}': {_say_legal(names)}")
    if len(cards) > 1:
        raise InputError(
            f"--set names '{key}', which several models have: say of which, as in "
            f"{cards[0].name}.{key}=VALUE; they are {_list_some([card.name for card in cards])}"
        )
    return cards[0]


def _list_some(names: list[str]) -> str:
    shown = ", ".join(names[:8])
    return shown if len(names) <= 8 else f"{shown} or one of {len(names) - 8} more"


def parse_constant(item: Parameter, text: str) -> float:
    """Return the value of a constant: a number in its unit, or a quantity where that is simple.

    Raises
    ------
    InputError
        If it is neither.
    """
    from ..errors import InputError
    from ..units import parse_quantity

    try:
        return float(text)
    except ValueError:
        pass
    if item.unit in _KINDS:
        return parse_quantity(text, _KINDS[item.unit])
    raise InputError(f"{item.name} is '{text}': it must be a number, in {item.unit or 'no unit'}")


def describe_constants(model: StaticModel) -> dict[str, Any]:
    """Return the constants and choices of a model of the catalogue; none of the others."""
    given: Mapping[str, Any] = getattr(model, "keywords", {})
    return {name: value for name, value in given.items() if not callable(value)}


def _parse_value(card: Card, key: str, text: str) -> float | str:
    from ..errors import InputError

    for item in card.parameters:
        if item.name == key:
            return card.check_parameter(key, parse_constant(item, text))
    for law in card.laws:
        if law.name == key:
            raise InputError(
                f"{key} of the model {card.name} is a law, a function of "
                f"{', '.join(law.arguments)}: it cannot be set here, give it in Python"
            )
    return card.check_choice(key, text)


def _say_legal(names: Sequence[str]) -> str:
    parts = []
    for name in names:
        card = find_card(name)
        legal: list[str] = []
        if card is not None:
            laws = {law.name for law in card.laws}
            legal = [word for word in card.keywords if word not in laws]
        parts.append(f"{name} takes {', '.join(legal) or 'no constants'}")
    if len(parts) > 3:
        return "none of these models takes it"
    return f"the model {' and '.join(parts)}"
