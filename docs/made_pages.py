"""Hook of mkdocs: what is made of code or of measured data takes the place of marks in pages.

A page keeps ``<!-- made: NAME -->`` where one of `MAKERS` writes; nothing that is made is kept.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import click

from bozzini.cli.common import OLD_OPTIONS, Description, FieldOption

DOCS = Path(__file__).resolve().parent
MARK = re.compile(r"<!-- made: (\w+) -->")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Return a page with what is made in the places of its marks; mkdocs calls this for each."""
    return MARK.sub(_make, markdown)


def _make(mark: re.Match[str]) -> str:
    # For the scripts beside this one and for `benchmarks`; mkdocs takes back what a hook adds
    # while it is loaded.
    sys.path += [str(path) for path in (DOCS, DOCS.parent) if str(path) not in sys.path]
    return MAKERS[mark[1]]()


def format_commands() -> str:
    """Return the reference of all commands, as Markdown."""
    from bozzini.cli.main import root

    return "\n".join(_describe(root, click.Context(root, info_name="bozzini")))


def format_overview() -> str:
    """Return a table of the commands, each with its line of ``bozzini --help``."""
    from bozzini.cli.main import COMMANDS

    rows = [f"| `bozzini {name}` | {_escape(line)} |" for name, line in COMMANDS.items()]
    return "\n".join(["| command | what it does |", "|---|---|", *rows])


def format_spellings() -> str:
    """Return a table of names that commands and options had, each with that of today."""
    from bozzini.cli.main import OTHER_NAMES

    rows = {f"`{old}`": f"`{name}`" for old, name in {**OTHER_NAMES, **OLD_OPTIONS}.items()}
    rows |= {
        "`muscle … --preset NAME`, `--muscle FILE`": "`muscle … NAME` or `FILE`, before the table",
        "`effector … --preset`, `rig … --preset`": "`effector … EFFECTOR`, `rig … EFFECTOR`",
        "`head … --head FILE`": "`head … FILE`, before plan and tract",
        "`new KIND --out FILE`": "`new KIND FILE`",
        "an option that `--help` has no more, `--braid-angle 36deg`": "`--set braid_angle=36deg`",
    }
    lines = [f"| {old} | {name} |" for old, name in rows.items()]
    return "\n".join(["| before | today |", "|---|---|", *lines])


def format_models() -> str:
    """Return the catalogue of muscle models, from their cards."""
    from make_catalogue import format_catalogue

    return format_catalogue()


def format_gallery() -> str:
    """Return all pictures of the gallery with the lines that make them."""
    from make_gallery import format_page

    return "\n\n".join(format_page())


def format_pictures() -> str:
    """Return the table of pictures on the front page."""
    from make_gallery import format_front

    return "\n".join(format_front())


def format_figures() -> str:
    """Return all figures of the thesis, with the values that were kept when they were drawn."""
    from make_thesis import VALUES, format_page

    return "\n\n".join(format_page(json.loads(VALUES.read_text("utf-8"))))


def format_benchmarks() -> str:
    """Return the table of all benchmarks that are kept."""
    from benchmarks.report import MEASURED, list_table

    return "\n".join(list_table(json.loads(MEASURED.read_text("utf-8"))["rows"]))


def format_headlines() -> str:
    """Return the short table of benchmarks."""
    from benchmarks.report import MEASURED, list_headlines

    return "\n".join(list_headlines(json.loads(MEASURED.read_text("utf-8"))["rows"]))


def format_peers() -> str:
    """Return the table of other packages on the same cases."""
    from benchmarks.report import MEASURED, list_peers

    return "\n".join(list_peers(json.loads(MEASURED.read_text("utf-8"))["peers"]))


def format_plant() -> str:
    """Return the table of the constants of the rig's plant, each with its source."""
    from bozzini.rig import PlantDesign

    return PlantDesign().format_provenance()


def format_shapes() -> str:
    """Return a table of the kinds of shapes that a file may hold, each with its fields."""
    from bozzini.duct import DUCT_SHAPES
    from bozzini.duct.shape_files import make_shapes_schema

    rows = []
    for part in make_shapes_schema()["allOf"]:
        name = part["if"]["properties"]["kind"]["const"]
        fields = part["then"]["properties"]["shapes"]["items"]["properties"]
        line = (DUCT_SHAPES[name].__doc__ or "").partition("\n")[0].replace("`", "")
        rows.append(
            f"| `{name}` | {_escape(line)} | {', '.join(f'`{field}`' for field in fields)} |"
        )
    return "\n".join(["| `kind` | what | fields of each shape |", "|---|---|---|", *rows])


def format_control(table: str) -> str:
    """Return a table of what `benchmarks/rig_control.py` measured and kept."""
    kept = json.loads((DOCS.parent / "benchmarks" / "rig_control.json").read_text("utf-8"))
    head, *rows = (f"| {' | '.join(cells)} |" for cells in kept[table])
    return "\n".join([head, "|---" * len(kept[table][0]) + "|", *rows])


CONTROL = (
    "steps", "plants_fast", "plants_slow", "slews", "runaway", "circle", "stick", "controllers",
)  # fmt: skip

MAKERS: dict[str, Callable[[], str]] = {
    "commands": format_commands,
    "overview": format_overview,
    "spellings": format_spellings,
    "models": format_models,
    "gallery": format_gallery,
    "pictures": format_pictures,
    "figures": format_figures,
    "benchmarks": format_benchmarks,
    "headlines": format_headlines,
    "peers": format_peers,
    "plant": format_plant,
    "shapes": format_shapes,
    **{table: partial(format_control, table) for table in CONTROL},
}
"""What writes in the place of a mark, by the mark's name."""


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
    first = [item for item in command.params if isinstance(item, Description)]
    records = [*((item.metavar or "", item.about) for item in first), *records]
    fields = [item for item in options if isinstance(item, FieldOption)]
    records += [(f"--set {item.name}=", item.known.describe()) for item in fields]
    yield "\n".join(f"- `{names}`: {_escape(text)}" for names, text in filter(None, records))
    yield ""


def _escape(text: str) -> str:
    """Return text in which nothing is markup, on one line."""
    return re.sub(r"([\\`*_<>\[\]#|])", r"\\\1", " ".join(text.split()))
