"""Hook of mkdocs: the reference of the command line, from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import click

MARK = "<!-- commands -->"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with the reference in the place of its mark; mkdocs calls this for each."""
    return markdown.replace(MARK, format_commands()) if MARK in markdown else markdown


def format_commands() -> str:
    """Return the reference of all commands, as Markdown."""
    from bozzini.cli.main import root

    return "\n".join(_describe(root, click.Context(root, info_name="bozzini")))


def _describe(command: click.Command, context: click.Context) -> Iterator[str]:
    level = context.command_path.count(" ") + 1
    if context.parent is not None:
        yield f"{'#' * level} {context.command_path}\n"
        yield "\n\n".join(map(_escape, re.split(r"\n\s*\n", (command.help or "").strip()))) + "\n"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            if found is not None:
                yield from _describe(found, click.Context(found, context, name))
        return
    usage = " ".join(command.collect_usage_pieces(context))
    yield f"    {context.command_path} {usage}\n"
    options = [item for item in command.params if isinstance(item, click.Option)]
    records = [item.get_help_record(context) for item in options]
    yield "\n".join(f"- `{names}`: {_escape(text)}" for names, text in filter(None, records))
    yield ""


def _escape(text: str) -> str:
    """Return text in which nothing is markup, on one line."""
    return re.sub(r"([\\`*_<>\[\]#|])", r"\\\1", " ".join(text.split()))
