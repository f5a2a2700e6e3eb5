"""The keywords of a model of the catalogue, checked against its card."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...errors import InputError, MissingLawError
from .card import Card

__all__ = ["take_keywords"]


def take_keywords(card: Card, given: Mapping[str, Any], *, as_printed: bool) -> dict[str, Any]:
    """Return parameters, choices and laws in the order of the card, defaults put in.

    Raises
    ------
    MissingLawError
        If a law is needed and not given.
    InputError
        If a keyword is unknown, needed and not given, or not legal.
    """
    for name in given:
        if name not in card.keywords:
            legal = ", ".join(card.keywords) or "none beside the muscle"
            raise InputError(f"the model {card.name} takes no '{name}': it takes {legal}")
    taken: dict[str, Any] = {}
    for item in card.parameters:
        value = given.get(item.name)
        if value is None:
            value = item.default
        if value is not None:
            taken[item.name] = card.check_parameter(item.name, value)
    absent = [
        item.name
        for item in card.parameters
        if item.name not in taken and _is_needed(item.only_with, taken)
    ]
    if absent:
        raise InputError(
            f"the model {card.name} must be given {', '.join(absent)}: the survey has no values"
        )
    for choice in card.choices:
        default = choice.printed if as_printed and choice.printed else choice.words[0]
        word = given.get(choice.name)
        taken[choice.name] = card.check_choice(choice.name, default if word is None else word)
    for law in card.laws:
        function = given.get(law.name)
        if function is not None:
            if not callable(function):
                raise InputError(
                    f"{law.name} of the model {card.name} is {function!r:.60}: it must be a "
                    f"function of {', '.join(law.arguments)}"
                )
            taken[law.name] = function
        elif law.required and _is_needed(law.only_with, taken):
            raise MissingLawError(
                f"the model {card.name} must be given the law {law.name}({', '.join(law.arguments)}"
                f"), {law.what}: it is in {law.paper}"
            )
    return taken


def _is_needed(only_with: str, taken: Mapping[str, Any]) -> bool:
    return not only_with or taken.get(only_with, 0.0) != 0.0
