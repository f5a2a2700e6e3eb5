"""A model's card in words, for its docstring and the command line."""

from __future__ import annotations

from .card import Card

__all__ = ["describe_card"]


def describe_card(card: Card) -> str:
    """Return source, equation, constants, laws and errata of a model as lines of text."""
    lines = [
        f"{card.name}: {card.title}",
        f"  {card.authors}; thesis {card.equation}; {card.status}",
        f"  {card.reference}",
        f"  {card.latex}",
    ]
    if card.latex_printed is not None:
        lines.append(f"  as printed: {card.latex_printed}")
    for item in card.parameters:
        value = "must be given or fitted" if item.default is None else f"default {item.default:g}"
        if item.only_with:
            value = f"with {item.only_with} only" if item.default is None else value
        unit = f" [{item.unit}]" if item.unit else ""
        lines.append(f"  {item.name}{unit}: {item.what}; {item.source}; {value}")
    lines += [f"  {item.name}: {item.what}: {', '.join(item.words)}" for item in card.choices]
    for law in card.laws:
        need = "needed" if law.required else "may be left out"
        if law.only_with:
            need += f" with {law.only_with} only"
        lines.append(
            f"  law {law.name}({', '.join(law.arguments)}) [{law.unit}]: {law.what}; "
            f"{need}; it is in {law.paper}"
        )
    lines.append(f"  of the muscle: {', '.join(card.uses)}")
    lines += [f"  note: {text}" for text in card.errata]
    if card.unprintable:
        lines.append(f"  cannot be evaluated as printed: {card.unprintable}")
    if card.missing:
        lines.append(f"  missing: {card.missing}")
    return "\n".join(lines)
