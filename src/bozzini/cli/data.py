"""``bozzini data``: list and fetch public anatomy."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from .common import emit, force_option, json_option, progress_bar, quiet_option

__all__ = ["command"]


@click.group("data")
def command() -> None:
    """List and fetch public anatomy, with its licence and citation."""


@command.command("list")
@json_option
def list_command(as_json: bool) -> None:
    """List the data sets that can be fetched."""
    from ..anatomy.fetch import CATALOGUE

    lines = []
    for entry in CATALOGUE:
        size = f", {entry.size / 1e9:.1f} GB" if entry.size else ""
        lines.append(f"{entry.name}  ({entry.licence}{size})\n    {entry.what}")
    emit(
        {"data": [asdict(entry) for entry in CATALOGUE]},
        as_json=as_json,
        text="\n".join(lines),
    )


@command.command("fetch")
@click.argument("name")
@click.option(
    "--to",
    "directory",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Directory to put it in; made if it does not exist.",
)
@force_option
@quiet_option
@json_option
def fetch_command(name: str, directory: Path, force: bool, quiet: bool, as_json: bool) -> None:
    """Fetch the data set NAME, with a file of its licence and citation beside it."""
    from ..anatomy.fetch import fetch_data, find_data

    entry = find_data(name)
    with progress_bar(quiet=quiet) as progress:
        done = fetch_data(entry, directory, force=force, progress=progress)
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
    said = "verified" if done.verified else "not verified: the catalogue has none to compare with"
    emit(
        result,
        as_json=as_json,
        text=f"{done.path}: {done.size} bytes, {entry.licence}\nSHA-256 {done.sha256} ({said})\n"
        f"Cite as: {entry.citation}",
    )
