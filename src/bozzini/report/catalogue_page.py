"""The catalogue of muscle models as a page of Markdown, made from the models' own cards."""

from __future__ import annotations

from collections.abc import Sequence

from ..muscle.models import MODELS, Card, count_statuses

_HEAD = """# Catalogue of muscle models

The static models of pneumatic artificial muscles that the thesis surveys in its chapter 2, and
`ogden`, which it does not have, each as an explicit law of the pull at a pressure and a length.
This page is made from the models' own cards, and so is what `bozzini muscle models` lists;
`bozzini muscle models NAME` shows one.

    bozzini muscle models
    bozzini muscle solve --model kothera-balance --pressure 0.5MPa --load 0.2N
    bozzini muscle curve --model tondu-lopez --set kappa1=-0.5 --set kappa2=1.2
    bozzini muscle fit data.csv --model sangian
    bozzini muscle compare data.csv --out ranking.png

The last fits every model that can be fitted and ranks them, see
[Muscles](../guide/muscle.md#comparing-models).
Symbols: `P` pressure, `F` pull, `l` length, `r` radius of
the braid, `t` thickness of the wall, the index 0 for rest; `theta` angle between strands and axis,
`b` length of a strand, `N` its turns; `epsilon = (l_0 - l) / l_0`; `q_1 = 3 / tan(theta_0)**2`,
`q_2 = 1 / sin(theta_0)**2`; `V_b` volume of the wall, `E` its modulus. Equations stand as they are
implemented, and as printed in the thesis where that differs; `as_printed=True` evaluates the print.
Where they have two signs of friction, the upper one is of the way up, inflating; in a print it may
be of either.
"""

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
    lines = ["| status | what it means | models | |", "|---|---|---|---|"]
    for status, count in count_statuses(taken).items():
        names = ", ".join(f"`{card.name}`" for card in taken if card.status == status)
        lines.append(f"| {status} | {_STATUS[status]} | {count} | {names} |")
    lines.append(f"| | | **{len(taken)}** | |")
    return "\n".join(lines)


def format_catalogue(cards: Sequence[Card] | None = None) -> str:
    """Return the page: a table of all models, and a section for each.

    Parameters
    ----------
    cards : sequence of Card, optional
        Those of `MODELS` by default.
    """
    taken = _take(cards)
    lines = [_HEAD, format_counts(taken), "", "## All models", ""]
    lines += ["| model | equation | authors | what | status |", "|---|---|---|---|---|"]
    lines += [
        f"| [`{card.name}`](#{card.name}) | {card.equation} | {card.authors} | {card.title} "
        f"| {card.status} |"
        for card in taken
    ]
    for card in taken:
        lines += ["", *_format_section(card)]
    return "\n".join(lines) + "\n"


def _format_section(card: Card) -> list[str]:
    lines = [f"## {card.name}", "", f"{card.title}. {_capitalise(card.place)}, {card.status}.", ""]
    lines += [f"{card.reference}.".replace("..", "."), "", *_format_latex(card.latex)]
    if card.latex_printed is not None:
        lines += ["", "As printed:", "", *_format_latex(card.latex_printed)]
    if card.parameters:
        lines += ["", "| constant | unit | what | from | value |", "|---|---|---|---|---|"]
        for item in card.parameters:
            if item.default is not None:
                value = f"{item.default:g} by default"
            elif item.only_with:
                value = f"with `{item.only_with}` only"
            else:
                value = "to be given or fitted"
            lines.append(f"| `{item.name}` | {item.unit} | {item.what} | {item.source} | {value} |")
    lines.append("")
    lines += [
        f"- `{item.name}`, {item.what}: {', '.join(f'`{word}`' for word in item.words)}."
        for item in card.choices
    ]
    for law in card.laws:
        need = "needed" if law.required else "may be left out"
        if law.only_with:
            need += f", with `{law.only_with}` only"
        unit = f" in {law.unit}" if law.unit else ""
        lines.append(
            f"- Law `{law.name}({', '.join(law.arguments)})`{unit}, {law.what}; {need}. "
            f"It is in {law.paper}."
        )
    lines.append(f"- Of the muscle: {', '.join(f'`{name}`' for name in card.uses)}.")
    lines += [f"- {text}" for text in card.errata]
    if card.unprintable:
        lines.append(f"- It cannot be evaluated as printed: {card.unprintable}.")
    if card.missing:
        lines.append(f"- Missing: {card.missing}")
    return lines


def _capitalise(text: str) -> str:
    return text[0].upper() + text[1:]


def _format_latex(text: str) -> list[str]:
    return ["```math", text, "```"]


def _take(cards: Sequence[Card] | None) -> tuple[Card, ...]:
    return tuple(MODELS.cards.values()) if cards is None else tuple(cards)
