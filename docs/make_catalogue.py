"""The table and the sections of the catalogue of muscle models, from the models' own cards."""

from __future__ import annotations

from collections.abc import Sequence

from bozzini.muscle.models import MODELS, Card, Parameter, count_statuses
from bozzini.muscle.models.card import BRAID_FIELDS, SHAPE_FIELDS, WALL_FIELDS

GROUPS = {"strain": SHAPE_FIELDS, "braid": BRAID_FIELDS, "wall": WALL_FIELDS}
"""Fields of a `Muscle` that most models use together, by the name that the page gives them."""

_STATUS = {
    "self-contained": "complete, right as printed",
    "corrected": "complete, with errors of the print mended",
    "fitted": "the form, with constants that have to be fitted",
    "partial": "something essential is in the cited paper only: a law to be given",
}


def format_counts(cards: Sequence[Card] | None = None) -> str:
    """Return a table of how many models there are of each status, and which.

    Parameters
    ----------
    cards : sequence of Card, optional
        Those of `MODELS` by default.
    """
    taken = _take(cards)
    lines = ["| status | what it means | models | with equation |", "|---|---|---|---|"]
    for status, count in count_statuses(taken).items():
        names = ", ".join(
            f"[`{card.name}`](#{card.name}) {card.equation}"
            for card in taken
            if card.status == status
        )
        lines.append(f"| {status} | {_STATUS[status]} | {count} | {names} |")
    lines.append(f"| | | **{len(taken)}** | |")
    return "\n".join(lines)


def format_catalogue(cards: Sequence[Card] | None = None) -> str:
    """Return a table of all models, and a section for each.

    Parameters
    ----------
    cards : sequence of Card, optional
        Those of `MODELS` by default.
    """
    taken = _take(cards)
    lines = [format_counts(taken)]
    for card in taken:
        lines += ["", *_format_section(card)]
    return "\n".join(lines)


def _format_section(card: Card) -> list[str]:
    lines = [f"## {card.name}", "", f"{card.title}. {_capitalise(card.place)}, {card.status}.", ""]
    lines += [f"{card.reference}.".replace("..", "."), "", *_format_latex(card.latex)]
    if card.latex_printed is not None:
        lines += ["", "As printed:", "", *_format_latex(card.latex_printed)]
    lines += ["", *map(_format_constant, card.parameters)]
    lines += [
        f"- `{item.name}`, {item.what}: {', '.join(f'`{word}`' for word in item.words)}."
        for item in card.choices
    ]
    for law in card.laws:
        need = "needed" if law.required else "may be left out"
        if law.only_with:
            need += f", with `{law.only_with}` only"
        unit = f" in {law.unit}" if law.unit else ""
        lines.append(f"- Law `{law.name}({', '.join(law.arguments)})`{unit}, {law.what}; {need}.")
    lines.append(f"- Of the muscle: {', '.join(_name_fields(card.uses))}.")
    lines += [f"- {text}" for text in card.errata]
    if card.unprintable:
        lines.append(f"- It cannot be evaluated as printed: {card.unprintable}.")
    if card.missing:
        lines.append(f"- Missing: {card.missing}")
    return lines


def _name_fields(uses: tuple[str, ...]) -> list[str]:
    """Return the fields that a model uses, those of the largest group by the group's name."""
    groups = [name for name, fields in GROUPS.items() if set(fields) <= set(uses)]
    group = max(groups, key=lambda name: len(GROUPS[name]))
    return [group, *(f"`{name}`" for name in uses if name not in GROUPS[group])]


def _format_constant(item: Parameter) -> str:
    unit = f" [{item.unit}]" if item.unit else ""
    source = "" if item.source == "fitted" else f", {item.source}"
    value = f" (default {item.default:g})" if item.default is not None else ""
    need = f"; with `{item.only_with}` only" if item.only_with and not value else ""
    return f"- `{item.name}`{unit}{source}: {item.what}{value}{need}."


def _capitalise(text: str) -> str:
    return text[0].upper() + text[1:]


def _format_latex(text: str) -> list[str]:
    return ["```math", text, "```"]


def _take(cards: Sequence[Card] | None) -> tuple[Card, ...]:
    return tuple(MODELS.cards.values()) if cards is None else tuple(cards)
