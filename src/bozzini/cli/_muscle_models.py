"""``bozzini muscle models``: what models there are, and the card of one."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import click

from ._muscle_options import OWN_MODELS, list_kinds
from .common import emit, json_option

if TYPE_CHECKING:
    from ..muscle.models import Card

__all__ = ["models_command"]


@click.command("models")
@click.argument("name", required=False)
@json_option
def models_command(name: str | None, as_json: bool) -> None:
    """List the models of a muscle, or show all that is known of one.

    The status says how much of a model the survey holds: self-contained; corrected, with errata
    mended; fitted, with constants to fit; partial, with a law missing that the paper named has.
    """
    from ..errors import InputError
    from ..muscle import CATALOGUE
    from ..muscle.models import count_statuses, describe_card

    if name is None:
        cards = [kind.card for kind in CATALOGUE.values()]
        counts = count_statuses(cards)
        said = ", ".join(f"{count} {status}" for status, count in counts.items())
        text = f"{_format_table(cards)}\n{len(cards)} models of the survey: {said}; and {{}}"
        emit(
            {
                "own": OWN_MODELS,
                "counts": counts,
                "models": [dataclasses.asdict(card) for card in cards],
            },
            as_json=as_json,
            text=text.format(f"{' and '.join(OWN_MODELS)}, this package's own"),
        )
        return
    if name not in list_kinds():
        raise InputError(f"there is no model '{name}': choose one of {', '.join(list_kinds())}")
    if name not in CATALOGUE:
        raise InputError(f"the model {name} is this package's own and has no card: see the guide")
    card = CATALOGUE[name].card
    emit(dataclasses.asdict(card), as_json=as_json, text=describe_card(card))


def _format_table(cards: list[Card]) -> str:
    rows = [("model", "equation", "status", "")]
    rows += [(card.name, card.equation, card.status, card.title) for card in cards]
    wide = [max(len(row[i]) for row in rows) for i in range(3)]
    return "\n".join(
        "  ".join(
            [*(cell.ljust(w) for cell, w in zip(row[:3], wide, strict=True)), row[3]]
        ).rstrip()
        for row in rows
    )
