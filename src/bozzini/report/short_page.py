"""A short page: a verdict, pictures, a table and notes, in one file that loads nothing."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from ..io.files import write_text
from ..scene.page import allow_only
from .report import encode_figure, read_package_text
from .text import render_notes, render_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class ShortPage:
    """What a short page says.

    Parameters
    ----------
    title : str
    label, sentence : str
        The verdict, in a word or two and in a sentence.
    tone : {"green", "amber", "red"}
    notes : sequence of str
        What belongs to the verdict.
    figures : sequence of (Figure, str)
        Pictures, and what each shows.
    rows : sequence of (str, str)
        Names and values.
    limitations : sequence of str
        What the reader must know before believing the numbers.
    """

    title: str
    label: str
    sentence: str
    tone: str = "green"
    notes: Sequence[str] = ()
    figures: Sequence[tuple[Figure, str]] = ()
    rows: Sequence[tuple[str, str]] = ()
    limitations: Sequence[str] = ()

    def render(self) -> str:
        """Return the page as HTML; every text is escaped."""
        style = read_package_text("report.css")
        pictures = "".join(
            f'<figure><img src="{encode_figure(figure, dpi=130.0)}" alt="{escape(text)}">'
            f"<figcaption>{escape(text)}</figcaption></figure>"
            for figure, text in self.figures
        )
        limits = "".join(f"<li>{escape(text)}</li>" for text in self.limitations)
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{allow_only((), (style,))}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            '<meta name="generator" content="Bozzini">\n'
            f"<title>{escape(self.title)}</title>\n<style>{style}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{escape(self.title)}</h1>\n"
            f'<section class="verdict {self.tone}" aria-label="Verdict">'
            f'<span class="label">{escape(self.label)}</span><p>{escape(self.sentence)}</p>'
            f"{render_notes(self.notes)}</section>\n{pictures}\n"
            f"<h2>Numbers</h2>\n<table>{render_table(self.rows)}</table>\n"
            f"<h2>What this does and does not say</h2>\n<ul>{limits}</ul>\n"
            "</main>\n</body>\n</html>\n"
        )

    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the page and return its path."""
        return write_text(path, self.render())
