"""``bozzini data``: list and fetch public anatomy."""

from __future__ import annotations

from dataclasses import asdict

import click

from .common import (
    Answer,
    CheckedGroup,
    answer_options,
)

__all__ = ["command"]


@click.group("data", cls=CheckedGroup)
def command() -> None:
    """List and fetch public anatomy, with its licence and citation."""


@command.command("list")
@answer_options(quiet=False)
def list_command(answer: Answer) -> None:
    """List the data sets that can be fetched."""
    from ..anatomy.fetch import CATALOGUE

    lines = []
    for entry in CATALOGUE:
        size = f", {entry.size / 1e9:.1f} GB" if entry.size else ""
        lines.append(f"{entry.name}  ({entry.licence}{size})\n    {entry.what}")
    answer.give({"data": [asdict(entry) for entry in CATALOGUE]}, "\n".join(lines))


@command.command("fetch")
@click.argument("name")
@answer_options(
    name="--to",
    required=True,
    metavar="DIR",
    help="Directory to put it in; made if it does not exist.",
)
def fetch_command(name: str, answer: Answer) -> None:
    """Fetch the data set NAME, with a file of its licence and citation beside it."""
    from ..anatomy.fetch import fetch_data, find_data

    entry = find_data(name)
    with answer.show_progress() as progress:
        done = fetch_data(entry, answer.target, force=answer.force, progress=progress)
    result = {
        "name": entry.name,
        "file": str(done.path),
        "citation_file": str(done.citation_path),
        "sha256": done.sha256,
        "verified": done.verified,
        "size": done.size,
        "licence": entry.licence,
        "citation": entry.citation,
        "url": entry.url,
    }
    proof = "verified" if done.verified else "not verified: the catalogue has none to compare with"
    answer.give(
        result,
        f"{done.path}: {done.size} bytes, {entry.licence}\nSHA-256 {done.sha256} ({proof})\n"
        f"Cite as: {entry.citation}",
    )
