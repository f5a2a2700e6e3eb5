"""``bozzini record``: a plan as a film."""

from __future__ import annotations

from pathlib import Path

import click

from ..scene.film import SUFFIXES, FilmOptions
from .common import (
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    options_of,
)
from .routing import read_plan, rebuild_lumen

__all__ = ["command"]


@click.command("record", cls=CheckedCommand)
@click.argument("source", metavar="PLAN", type=INPUT)
@click.argument("tract", metavar="[INPUT]", required=False, type=INPUT)
@options_of(FilmOptions, "options")
@answer_options(*SUFFIXES, required=True, help="The film: .mp4 (needs the extra 'film') or .gif.")
def command(source: Path, tract: Path | None, options: FilmOptions, answer: Answer) -> None:
    """Film the motion of PLAN, in the tract of the file INPUT that it was made from.

    Without INPUT the widest tube round the plan's centreline stands for the wall. The page in 3-D
    is filmed where Chromium and the package playwright are there; otherwise X-ray pictures are
    drawn.
    """
    plan = read_plan(source)
    from ..scene.film import record_plan

    wall = None if tract is None else rebuild_lumen(plan, tract, answer)
    with answer.show_progress() as progress:
        film = record_plan(plan, answer.target, wall=wall, options=options, progress=progress)
    result = {"file": str(film.path), "style": film.style, "pictures": film.pictures}
    answer.give(result, f"{film.path}: {film.pictures} pictures, {film.style}")
