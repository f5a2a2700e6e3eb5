"""What every command shares: options, one JSON object, tables, progress, exit codes."""

from __future__ import annotations

import copy
import dataclasses
import difflib
import json
import os
import re
import shlex
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from ..checks import Quantity, choose, list_fields, restate_typed, show_value, spell_option
from ..errors import BozziniError, FileFormatError, InputError
from ..io.inputs import check_no_input, note_input
from ..progress import Progress, no_progress
from ..registry import Registry
from ..results import Json, Result, format_rows, to_plain
from ..units import INTERNAL_UNITS, parse_quantity, parse_vector

# Tables and files of results: for people, as CSV, and whether a file may be written.

PICTURES = (".png", ".svg", ".pdf")
"""Endings of a picture's file."""


def check_target(out: Path | None, suffixes: tuple[str, ...], *, force: bool) -> None:
    """Refuse a file that could not be written later, before any work is done.

    Raises
    ------
    OutputError
        If it ends otherwise than in `suffixes`, is a directory, exists and may not be replaced,
        or its place takes no new file.
    MissingExtraError
        If it is Parquet, which cannot be written here.
    """
    from ..io.files import check_new_file, check_parquet

    if out is not None:
        check_new_file(out, suffixes, force=force)
        if out.suffix.lower() == ".parquet":
            check_parquet()


def format_csv(columns: Mapping[str, Any]) -> str:
    """Return columns of one length as the text of a CSV file; None is an empty cell."""
    import csv
    import io

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([_format_cell(cell) for cell in row])
    return text.getvalue()


def format_parts(summary: Json, directory: Path) -> str:
    """Return the table of the parts in a summary of `bozzini.fabricate` for people."""
    rows = [
        [
            part["name"],
            str(part["count"]),
            f"{part['diameter_mm']:.3g} x {part['height_mm']:.4g}",
            str(len(part["channels"])),
            f"{part['volume_mm3']:.4g}",
        ]
        for part in summary["parts"]
    ]
    head = ["part", "pieces", "size [mm]", "channels", "volume [mm^3]"]
    return f"{format_rows(head, rows)}\n{directory}: {len(summary['files'])} files"


def describe_classes(registry: Registry[Any]) -> tuple[dict[str, dict[str, str]], str]:
    """Return the first line of each class's docstring and its package, by its name; and as text.

    Of a class that cannot be used the reason stands in its place.
    """
    rows, broken = {}, registry.broken
    for name in registry:
        point = registry.plugins.get(name)
        about = f"broken: {broken[name]}" if name in broken else registry[name].__doc__ or ""
        rows[name] = {
            "summary": next(iter(about.strip().splitlines()), ""),
            "package": "bozzini" if point is None else point.value,
        }
    for name in (word for word in broken if word not in rows):
        rows[name] = {"summary": f"broken: {broken[name]}", "package": name.rpartition(" ")[2]}
    width = max(map(len, rows))
    lines = [
        f"{name.ljust(width)}  {row['summary']} ({row['package']})" for name, row in rows.items()
    ]
    return rows, "\n".join(lines)


def _format_cell(cell: Any) -> str:
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    number = cell.item() if hasattr(cell, "item") else cell
    return str(int(number)) if isinstance(number, (bool, int)) else f"{float(number):.9g}"


EXIT_DONE = 0
"""The work is done."""
EXIT_NEGATIVE = 1
"""An honest negative answer, for example: the scope does not fit."""
EXIT_BAD_INPUT = 2
"""The input or the usage is wrong; one line on stderr names it."""

Command = Callable[..., Any]
"""A function that click runs, with what it takes as keywords."""
_Function = TypeVar("_Function", bound=Command)
_Value = TypeVar("_Value")

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

if TYPE_CHECKING:  # generic in newer versions of click only
    _AnyType = click.ParamType[Any]
else:
    _AnyType = click.ParamType


OLD_OPTIONS = {
    "--muscle-preset": "--muscle",
    "--beam": "--beam-factor",
    "--plot": "--figure",
}
"""Names that options had, each with that of today; commands take both."""


class FieldOption(click.Option):
    """An option that the help leaves out, as ``--set NAME=VALUE`` gives it by the field's name."""

    known: Quantity


class OldOption(click.Option):
    """An option of before: its value is that of an argument, whose name is in `fills`."""

    fills: str


class Description(click.Argument):
    """A description that may be left out: it stands before all files, wherever it is declared."""

    about: str


class CheckedCommand(click.Command):
    """A command that loses no value of an option that was given more than once.

    An option that takes a list, as its metavar ``NAME,...`` shows, takes the values together. Of
    others that may not be repeated, two values that differ are an error of usage; click would
    keep the last one.

    A description that may be left out stands before the files that are needed, and options that
    are fields have the one option ``--set``.
    """

    def __init__(self, *given: object, **more: object) -> None:
        super().__init__(*given, **more)  # type: ignore[arg-type]
        self.params.sort(key=lambda item: not isinstance(item, Description))
        fields = [item for item in self.params if isinstance(item, FieldOption)]
        if not fields:
            return
        names = ", ".join(str(item.name) for item in fields)
        own = next((item for item in self.params if "--set" in item.opts), None)
        if own is None:
            own = click.Option(["--set", "_set"], multiple=True, expose_value=False)
            own.metavar, own.help = "NAME=VALUE", "Can be repeated."
            self.params.insert(self.params.index(fields[0]), own)
        self._set = own
        own.help = f"{own.help} Fields: {names}; NAME alone tells its unit and range."

    def make_parser(self, ctx: click.Context) -> Any:
        """Return click's parser, its options without such losses."""
        once = {
            item.name: item
            for item in self.get_params(ctx)
            if isinstance(item, click.Option)
            and not (item.multiple or item.is_flag or item.count or item.nargs != 1)
        }
        twin = copy.copy(self)
        twin.params = [_collect(item) if item.name in once else item for item in self.params]
        parser: Any = click.Command.make_parser(twin, ctx)
        for old, name in OLD_OPTIONS.items():
            if name in parser._long_opt:
                parser._long_opt.setdefault(old, parser._long_opt[name])
        parse = parser.parse_args
        own = dict(zip(map(id, twin.params), self.params, strict=True))

        def parse_args(args: list[str]) -> tuple[Json, list[str], list[click.Parameter]]:
            given, rest, order = parse(args)
            for name, item in once.items():
                if name in given:
                    given[name] = _join_values(item, given[name], ctx)
            self._take_fields(given, ctx)
            self._place_arguments(given, ctx)
            return given, rest, [own.get(id(item), item) for item in order]

        parser.parse_args = parse_args
        return parser

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what may stand first, then the options."""
        first = [item for item in self.params if isinstance(item, Description)]
        for item in first:
            with formatter.section("File" if item.metavar == "[FILE]" else "Description"):
                formatter.write_dl([(str(item.metavar), item.about)])
        super().format_options(ctx, formatter)

    def _take_fields(self, given: Json, ctx: click.Context) -> None:
        """Give the values of ``--set`` to the fields that they name."""
        fields = {str(item.name): item for item in self.params if isinstance(item, FieldOption)}
        if not fields or not given.get(str(self._set.name)):
            return
        spelled = {
            item.opts[0].removeprefix("--").replace("-", "_"): item for item in fields.values()
        }
        left = []
        for text in given[str(self._set.name)]:
            name, mark, value = (part.strip() for part in text.partition("="))
            key = name.replace("-", "_")
            item = fields.get(key) or spelled.get(key)
            if item is None:
                left.append(text)
                continue
            if not (mark and value):
                raise click.UsageError(f"--set {name} needs a value: {item.known.describe()}", ctx)
            before = given.get(str(item.name))
            if isinstance(before, str) and before != value:
                raise click.UsageError(f"{name} is given more than once: give it once", ctx)
            given[str(item.name)] = value
        if left and not self._set.expose_value:
            name = left[0].partition("=")[0].strip()
            near = difflib.get_close_matches(name.replace("-", "_"), fields, n=1)
            meant = f", did you mean '{near[0]}'?" if near else f": {', '.join(fields)}"
            raise click.UsageError(f"--set names '{name}', which is none of the fields{meant}", ctx)
        given[str(self._set.name)] = left

    def _place_arguments(self, given: Json, ctx: click.Context) -> None:
        """Give files that are needed before descriptions that may be left out."""
        places = [item for item in self.params if isinstance(item, click.Argument)]
        if any(item.nargs != 1 for item in places) or ctx.resilient_parsing:
            return
        typed = [given.get(str(item.name)) for item in places]
        texts = [text for text in typed if isinstance(text, str)]
        missing = next((text for text in typed if not isinstance(text, str)), None)
        needed = [item.required for item in places]
        for k, item in enumerate(places):
            optional = not item.required and any(needed[k:])
            has_place = not optional or len(texts) > sum(needed[k:])
            given[str(item.name)] = texts.pop(0) if texts and has_place else missing
        for old in (item for item in self.params if isinstance(item, OldOption)):
            value = given.pop(str(old.name), None)
            if not isinstance(value, str):
                continue
            if isinstance(given[old.fills], str):
                both = f"'{given[old.fills]}' and '{value}'"
                noun = old.fills.removesuffix("_file")
                raise click.UsageError(f"{noun} is given more than once, as {both}", ctx)
            given[old.fills] = value


def description(
    name: str,
    *old: str,
    about: str,
    shown: str = "",
    kind: _AnyType | None = None,
    default: str | Path | None = None,
) -> Callable[[Command], Command]:
    """Return the argument of a description that may be left out, and its options of before."""
    options = [
        click.option(flag, f"_{flag[2:]}", cls=OldOption, hidden=True, expose_value=False, type=str)
        for flag in old
    ]
    metavar = f"[{shown or name.upper()}]"

    def decorate(function: Command) -> Command:
        for each in options:
            function = each(function)
            function.__click_params__[-1].fills = name  # type: ignore[attr-defined]
        argument = click.argument(
            name, cls=Description, metavar=metavar, required=False, type=kind, default=default
        )
        function = argument(function)
        function.__click_params__[-1].about = about  # type: ignore[attr-defined]
        return function

    return decorate


class CheckedGroup(click.Group):
    """A group of such commands."""

    command_class = CheckedCommand
    group_class = type


def _collect(item: click.Parameter) -> click.Parameter:
    """Return an option that keeps all its values."""
    item = copy.copy(item)
    item.multiple = True
    return item


def _join_values(item: click.Option, values: list[str], context: click.Context) -> str:
    """Return the one value of an option that was given once or more."""
    if isinstance(item.type, LabelsType) or (item.metavar or "").endswith(",..."):
        return ",".join(values)
    if len(set(values)) > 1:
        shown = " and ".join(f"'{value}'" for value in dict.fromkeys(values))
        raise click.UsageError(
            f"{item.opts[0]} is given more than once, as {shown}: give it once", context
        )
    return values[0]


def json_option(function: _Function) -> _Function:
    """Add ``--json`` as the argument ``as_json``: one object on stdout, nothing else."""
    return click.option(
        "--json", "as_json", is_flag=True, help="Write one JSON object on stdout, nothing else."
    )(function)


def quiet_option(function: _Function) -> _Function:
    """Add ``--quiet`` as the argument ``quiet``: no progress on stderr."""
    return click.option("--quiet", is_flag=True, help="Show no progress.")(function)


def force_option(function: _Function) -> _Function:
    """Add ``--force`` as the argument ``force``: replace what is there."""
    return click.option("--force", is_flag=True, help="Replace an output that exists.")(function)


def step_option(function: _Function) -> _Function:
    """Add ``--step`` as the argument ``step``: parts as STEP files too."""
    return click.option(
        "--step", is_flag=True, help="Write STEP files too; needs the extra 'cad'."
    )(function)


class _Parsed(_AnyType):
    """A value that a function reads from text; its `BozziniError` is an error of usage."""

    def __init__(self, name: str, parse: Callable[[str], object]) -> None:
        self.name = name
        self.parse = parse

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> object:
        """Return what the text stands for; a default that is no text is returned as it is."""
        if not isinstance(value, str):
            return value
        try:
            return self.parse(value)
        except BozziniError as error:
            self.fail(str(error), param, ctx)


class _InputType(click.Path):
    """The path of what a command reads; no output of the command may take its place."""

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        """Return the path, and note it."""
        note_input(value)
        return super().convert(value, param, ctx)


INPUT = _InputType(path_type=Path)
"""A file or directory that a command reads."""
OUTPUT = click.Path(path_type=Path)
"""A file or directory that it writes."""

_TYPED = "bozzini.typed"


def _parse_typed(text: str, kind: str) -> float:
    """Return a quantity, and keep how it was typed for the message of an error."""
    value = parse_quantity(text, kind)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(_TYPED, []).append((text, kind))
    return value


def add_typed(message: str, context: click.Context | None) -> str:
    """Return the message of an error with the value as it was typed, in another unit than ours."""
    for text, kind in [] if context is None else context.meta.get(_TYPED, []):
        more = restate_typed(message, text, kind)
        if more != message:
            return more
    return message


class QuantityType(_Parsed):
    """A number with a unit, such as ``5mm`` or ``100psi``, passed on in the internal unit.

    Parameters
    ----------
    kind : str
        A key of `bozzini.units.INTERNAL_UNITS`, for example ``"length"``.
    """

    def __init__(self, kind: str) -> None:
        name = "number" if kind == "dimensionless" else kind  # as the help shows it
        super().__init__(name, lambda text: _parse_typed(text, kind))


class NameType(_AnyType):
    """The name of one of several things that are known by names.

    Parameters
    ----------
    noun : str
        What one of them is called.
    find : callable
        Returns them by name; called when one is asked for.
    show : bool
        Whether the help text lists the names.
    """

    name = "name"

    def __init__(
        self, noun: str, find: Callable[[], Mapping[str, object]], show: bool = False
    ) -> None:
        self.noun, self.find, self.show = noun, find, show

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str | None:
        """Return the names for the help."""
        return f"[{'|'.join(self.find())}]" if self.show else None

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        """Return the name if there is such a thing."""
        try:
            choose(self.noun, str(value), self.find())
        except BozziniError as error:
            self.fail(str(error), param, ctx)
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin so."""
        return [CompletionItem(name) for name in self.find() if name.startswith(incomplete)]


class VectorType(_Parsed):
    """Comma-separated quantities, such as ``12mm,-5mm,0``, passed on as a tuple of floats.

    Parameters
    ----------
    kind : str
        A key of `bozzini.units.INTERNAL_UNITS`.
    size : int
        How many there must be.
    """

    def __init__(self, kind: str, *, size: int = 3) -> None:
        name = "x,y,z" if size == 3 else ",".join([kind] * size)
        super().__init__(name, lambda text: parse_vector(text, kind, size=size))


def _parse_labels(text: str) -> tuple[int | str, ...]:
    """Return labels, numbers or names such as ``1,2`` or ``stomach,duodenum``, each once."""
    parts = [part.strip() for part in text.split(",")]
    labels = [int(part) if part.isascii() and part.isdigit() else part for part in parts]
    for label in labels:
        if not (1 <= label <= 65535 if isinstance(label, int) else re.search(r"[^\W\d_]", label)):
            raise InputError(
                f"'{text}' is not a list of labels: give names, or whole numbers in [1, 65535], "
                "separated by commas, such as 1,2,3 (0 is the background), or all"
            )
    return tuple(dict.fromkeys(labels))


def _parse_end(text: str) -> tuple[float, ...] | int | str:
    """Return an end of the centreline: a point [mm], the number of a label, or a name."""
    text = text.strip()
    if text.isascii() and text.isdigit():
        return int(text)
    # A name has a letter first; what begins like a number is a point.
    if text[:1].isalpha() and text.partition(",")[0].lower() not in ("nan", "inf"):
        return text
    try:
        return parse_vector(text, "length")
    except BozziniError as error:
        raise InputError(f"{error} (or give the number or name of a label or place)") from None


class LabelsType(_Parsed):
    """Comma-separated labels, passed on as a tuple of ints and strings."""

    def __init__(self) -> None:
        super().__init__("labels", _parse_labels)


class EndType(_Parsed):
    """An end of the centreline: ``x,y,z`` with units, a label (number or name), or a place."""

    def __init__(self) -> None:
        super().__init__("x,y,z|label|name", _parse_end)


def parse_pairs(
    option: str,
    text: str | Sequence[str],
    kind: str,
    *,
    example: str,
    names: Sequence[str] | None = None,
    owner: str = "",
) -> dict[str, float]:
    """Return ``NAME=QUANTITY,NAME=QUANTITY`` as a mapping, in the internal unit.

    Parameters
    ----------
    option : str
        The option that has the text.
    text : str or sequence of str
        The text, or those of an option that was repeated.
    kind : str
        A key of `bozzini.units.INTERNAL_UNITS`.
    example : str
        A legal text.
    names : sequence of str, optional
        The legal names; any unless given.
    owner : str
        What has these names.

    Raises
    ------
    InputError
        If a part is no pair, or a name is not legal or given twice.
    UnitError
        If a quantity is none of its kind.
    """
    found: dict[str, float] = {}
    texts = [text] if isinstance(text, str) else text
    for part in ",".join(texts).split(","):
        name, mark, value = (word.strip() for word in part.partition("="))
        if not (name and mark and value):
            raise InputError(
                f"{option} has the part '{part.strip()}': it must be NAME={kind.upper()}, such as "
                f"{example}"
            )
        if names is not None and name not in names:
            raise InputError(f"{option} names '{name}': {owner} are {', '.join(names) or 'none'}")
        if name in found:
            raise InputError(f"{option} names '{name}' more than once: give each once")
        found[name] = _parse_typed(value, kind)
    return found


def split_setting(option: str, text: str, form: str) -> tuple[str, str]:
    """Return name and value of ``NAME=VALUE``, or raise `InputError`; `form` is what is legal."""
    name, mark, value = (part.strip() for part in text.partition("="))
    if not (name and mark and value):
        raise InputError(f"{option} is '{text}': it must be {form}")
    return name.replace("-", "_"), value


def gather_once(option: str, pairs: Iterable[tuple[str, _Value]]) -> dict[str, _Value]:
    """Return pairs as a mapping, or raise `InputError` if a name is there twice."""
    found: dict[str, _Value] = {}
    for name, value in pairs:
        if name in found:
            raise InputError(f"{option} names '{name}' more than once: give it once")
        found[name] = value
    return found


# Options that arrive together, as one object: those of a dataclass, and where the answer goes.


def gather(
    argument: str, make: Command, *options: Callable[[Command], Command]
) -> Callable[[Command], Command]:
    """Return a decorator that adds options whose values arrive together, as one argument.

    Parameters
    ----------
    argument : str
        Name of the argument.
    make : callable
        Makes it from the values, which are keywords.
    *options : callable
        Decorators of click, in the order of the help text.
    """

    def decorate(function: Command) -> Command:
        def probe() -> None: ...

        for option in options:
            option(probe)
        taken: list[click.Parameter] = getattr(probe, "__click_params__", [])
        names = [str(item.name) for item in taken if item.expose_value]

        @wraps(function)
        def run(**values: object) -> object:
            return function(
                **{argument: make(**{name: values.pop(name) for name in names})}, **values
            )

        for option in reversed(options):
            option(run)
        return run

    return decorate


def options_of(
    kind: type, argument: str, *, leave_out: Sequence[str] = ()
) -> Callable[[Command], Command]:
    """Return a decorator that adds an option for each field of a dataclass.

    Type, unit, legal words, default and help of an option are those of the field: of the
    `bozzini.checks.Quantity` in its metadata. Fields without one get no option. The values arrive
    as one object of the dataclass.

    Parameters
    ----------
    kind : type
        The dataclass.
    argument : str
        Name of the argument.
    leave_out : sequence of str
        Fields that get no option, and keep their defaults.
    """
    fields = list_fields(kind)
    options = [make_option(item) for name, item in fields.items() if name not in leave_out]
    return gather(argument, kind, *options)


def options_file(
    fields: Mapping[str, dataclasses.Field[object]], example: str
) -> Callable[[Command], Command]:
    """Return a decorator that adds ``--options``, a file of values for options by name.

    Those on the command line go before. A file that the file names is sought beside it. `example`
    is the command that writes one.
    """

    def take(context: click.Context, _: click.Parameter, path: Path | None) -> None:
        if path is None:
            return
        from ..io.records import load_data

        given = load_data(path)
        if given is None:  # remarks alone, as `bozzini new` writes them
            return
        if not isinstance(given, Mapping):
            raise FileFormatError(f"{path} is {show_value(given)}: it must hold options by name")
        try:
            context.default_map = {
                name: _spell_value(value, choose("option", name, fields), path.parent)
                for name, value in given.items()
            }
        except InputError as error:
            raise FileFormatError(f"{path}: {error}") from None

    return click.option(
        "--options",
        type=INPUT,
        metavar="FILE",
        is_eager=True,
        expose_value=False,
        callback=take,
        help=f"These options from a file, as '{example}' writes one; those given here go before.",
    )


def _spell_value(value: object, item: dataclasses.Field[object], folder: Path) -> object:
    """Return a value of a file of options as it is typed on the command line."""
    kind = item.metadata["quantity"].kind
    if kind == "flag":
        if not isinstance(value, bool):
            raise InputError(f"{item.name} is {show_value(value)}: it must be true or false")
        return value

    def spell(part: object) -> str:
        if isinstance(part, list) and part:
            return ",".join(map(spell, part))
        if isinstance(part, bool) or not isinstance(part, (int, float, str)):
            raise InputError(f"{item.name} is {show_value(part)}: it must be a number or text")
        return str(folder / str(part)) if kind == "file" else str(part)

    if isinstance(item.default, tuple):
        return [spell(part) for part in (value if isinstance(value, list) else [value])]
    return spell(value)


def spell_command() -> str:
    """Return the command line that makes this answer again: files by name, options spelled out.

    It is that of a command which stands in `COMMANDS` of `bozzini.cli.main`, not of one in a group.
    """
    context = click.get_current_context()
    parser = context.command.make_parser(context)
    given, *_ = parser.parse_args(args=list(context.meta[ARGUMENTS]))
    values = {**(context.default_map or {}), **given}
    words = context.command_path.split()
    for item in context.command.params:
        value = values.get(item.name or "")
        names = item.secondary_opts if value is False else item.opts
        if item.name in _NO_CONTENT or value is None or not names:
            continue
        for part in value if isinstance(value, list) else [value]:
            words += [] if isinstance(item, click.Argument) else [names[0]]
            if isinstance(part, str):
                words.append(Path(part).name if isinstance(item.type, click.Path) else part)
    return shlex.join(words)


ARGUMENTS = "bozzini.arguments"
"""Where a context keeps what was typed after the name of the command."""
_NO_CONTENT = ("out", "force", "as_json", "quiet", "options", "igtl")
"""Options that change where the answer goes, or whose values are spelled out."""


def refuse_options(names: Sequence[str], where: str) -> None:
    """Refuse options that were given but have no effect, such as "with --port"."""
    context = click.get_current_context()
    for item in context.command.params:
        given = context.get_parameter_source(item.name or "") is ParameterSource.COMMANDLINE
        if item.name in names and given:
            is_option = isinstance(item, click.Option)
            shown = item.opts[0] if is_option else (item.metavar or "").strip("[]")
            raise InputError(f"{shown} has no effect {where}: leave it out")


def make_option(
    item: dataclasses.Field[Any], *, flag: str = "", **other: Any
) -> Callable[[Command], Command]:
    """Return the option of a dataclass's field that carries a `Quantity`.

    `flag` is its name on the command line, if that is another one than the field's; `other` is for
    `click.option`, instead of what the field gives.
    """
    known: Quantity = item.metadata["quantity"]
    default = item.default
    given: Json = {"help": known.help}
    name = flag or spell_option(item)
    if known.kind == "flag":
        given |= {"is_flag": True, "default": default}
        name = f"{name}/--no-{name.removeprefix('--')}" if default else name
    else:
        given["type"] = choose_type(known)
        if isinstance(default, tuple):
            given["multiple"] = True
        elif default is dataclasses.MISSING:
            given["required"] = "default" not in other
        elif default is not None:
            given |= {"default": default, "show_default": True}
            if isinstance(given["type"], QuantityType) and "default" not in other:
                shown = f"{default:g}{known.unit}"
                is_exact = float(f"{default:g}") == default
                given |= {"default": shown} if is_exact else {"show_default": shown}
    if not known.by_name:
        return click.option(name, item.name, **(given | other))
    given |= {"cls": FieldOption, "hidden": True}

    def add(function: Command) -> Command:
        function = click.option(name, item.name, **(given | other))(function)
        function.__click_params__[-1].known = known  # type: ignore[attr-defined]
        return function

    return add


def option(
    declaration: str, help: str, kind: object = None, **more: Any
) -> Callable[[_Function], _Function]:
    """Return an option of a command.

    Parameters
    ----------
    declaration : str
        Its name, that of its argument if that is another, and what stands for its value in the help
        text, in capitals: ``"--to target X,Y"``.
    help : str
    kind : object
        A type of click, a kind of quantity, or a tuple of words to choose from.
    **more
        For `click.option`; a default is shown.
    """
    flag, *words = declaration.split()
    names = [word for word in words if word.islower()]
    metavar = next((word for word in words if not word.islower()), None)
    taken: object = QuantityType(kind) if isinstance(kind, str) else kind
    taken = click.Choice(kind) if isinstance(kind, tuple) else taken
    shown = "default" in more
    return click.option(
        flag, *names, type=taken, metavar=metavar, help=help, show_default=shown, **more
    )


def choose_type(known: Quantity) -> _AnyType | type:
    """Return click's type for a field that carries a `Quantity`."""
    if known.words:
        return click.Choice(known.words)
    if known.whole:
        return int
    return QuantityType(known.kind) if known.kind in INTERNAL_UNITS else _TYPES[known.kind]


_TYPES: dict[str, _AnyType | type] = {
    "text": str,
    "labels": LabelsType(),
    "end": EndType(),
    "file": INPUT,
}


@dataclasses.dataclass(frozen=True)
class Answer:
    """Where the answer of a command goes: stdout as text or JSON, perhaps files and 3D Slicer."""

    as_json: bool
    quiet: bool = True
    out: Path | None = None
    force: bool = False
    igtl: str | None = None

    @property
    def target(self) -> Path:
        """The file or directory to write, which a command needs that has no other output."""
        return self.out or Path()

    def show_progress(self) -> AbstractContextManager[Progress]:
        """Return a progress bar, or nothing to see if ``--quiet`` was given."""
        return progress_bar(quiet=self.quiet)

    def give(self, result: Mapping[str, object] | Result, text: str) -> None:
        """Write the answer on stdout."""
        emit(result, as_json=self.as_json, text=text)

    @property
    def is_table(self) -> bool:
        """Whether the file is a table."""
        return self.out is not None and self.out.suffix.lower() == ".csv"

    @property
    def is_page(self) -> bool:
        """Whether the file is a page."""
        return self.out is not None and self.out.suffix.lower() == ".html"

    def write(self, columns: Mapping[str, object], draw: Callable[[], Figure | Axes]) -> None:
        """Write the file that is asked for: a table of columns, or the picture `draw` makes."""
        if self.out is not None and self.is_table:
            from ..io.files import write_text

            write_text(self.out, format_csv(columns))
        else:
            self.draw(draw)

    def draw(self, draw: Callable[[], Figure | Axes]) -> None:
        """Write a figure to ``--out``, if that was given."""
        if self.out is not None:
            from ..plot import write_figure

            write_figure(draw(), self.out)


_IGTL = "Show it in 3D Slicer (OpenIGTLinkIF), and take its points start, end, target."


def answer_options(
    *suffixes: str,
    quiet: bool = True,
    name: str = "--out",
    igtl: bool = False,
    positional: bool = False,
    **out: Any,
) -> Callable[[Command], Command]:
    """Return a decorator that adds ``--json`` and the other options of an answer.

    It arrives as the argument ``answer``.

    Parameters
    ----------
    *suffixes : str
        What the file of ``--out`` may end in: it is refused before any work if it could not be
        written later. Without suffixes that is left to the command.
    quiet : bool
        Whether to add ``--quiet``.
    name : str
        Another name of the option ``--out``.
    igtl : bool
        Whether to add ``--igtl``: see `bozzini.cli._slicer`.
    positional : bool
        Whether the file is an argument, as what is asked for is the file.
    **out
        Of the option ``--out``, for `click.option`; without suffixes and these there is none.
    """

    def make(**values: Any) -> Answer:
        answer = Answer(**values)
        if answer.out is not None and not os.path.isdir(answer.out):
            check_no_input(answer.out)
        if suffixes:
            check_target(answer.out, suffixes, force=answer.force)
        return answer

    options: list[Callable[[Command], Command]] = []
    if suffixes:
        out.setdefault("help", "A picture.")
    if positional:
        about = f"To write, ending in {' or '.join(suffixes)} (default: {out['default']})."
        options += [description("out", name, about=about, shown="FILE", kind=OUTPUT,
                                default=out["default"]), force_option]  # fmt: skip
    elif out:
        given = {"type": OUTPUT, "metavar": "FILE", **out}
        options += [click.option(name, "out", **given), force_option]
    if igtl:
        options.append(option("--igtl HOST:PORT", _IGTL))
    options += [json_option, quiet_option] if quiet else [json_option]
    return gather("answer", make, *options)


def clean_json(value: object) -> object:
    """Return `value` made of plain JSON types; a number that is not finite becomes None.

    Raises
    ------
    TypeError
        If something inside `value` has no JSON form.
    """
    return to_plain(value, unknown=_refuse_json)


def _refuse_json(value: object) -> NoReturn:
    raise TypeError(f"a {type(value).__name__} has no JSON form")


def write_json(result: Mapping[str, object] | Result) -> None:
    """Write `result` on stdout as one JSON object.

    It is ASCII where stdout is not UTF-8, and where the name of a file is not: a byte of it is
    then a lone surrogate from U+DC80 to U+DCFF, as in Python.
    """
    plain = clean_json(result)
    text = json.dumps(plain, indent=2, allow_nan=False, ensure_ascii=False)
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(plain, indent=2, allow_nan=False)
    click.echo(text)


def emit(result: Mapping[str, object] | Result, *, as_json: bool, text: str) -> None:
    """Write a command's result on stdout: one JSON object, or text for people.

    Parameters
    ----------
    result : mapping or Result
        The result; numbers that are not finite become ``null``.
    as_json : bool
        Whether ``--json`` was given.
    text : str
        The same for people.
    """
    if not as_json:
        click.echo(text)
        return
    write_json(result)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta["bozzini.emitted"] = True


def run_exit(code: int) -> NoReturn:
    """End the command with exit code `code`; what it wrote before stays written."""
    raise click.exceptions.Exit(code)


@contextmanager
def progress_bar(*, quiet: bool = False, delay: float = 0.5) -> Iterator[Progress]:
    """Give a callback that shows progress on stderr.

    On a terminal this is a bar, shown if the work lasts longer than `delay` and wiped away at
    the end; elsewhere it is a line at most every ten seconds.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    delay : float
        Time before anything is shown [s].
    """
    if quiet:
        yield no_progress
    elif sys.stderr.isatty():
        yield from _show_bar(delay)
    else:
        yield LineProgress()


def _show_bar(delay: float) -> Iterator[Progress]:
    from tqdm import tqdm

    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}"
    start = time.monotonic()
    with tqdm(total=1.0, file=sys.stderr, leave=False, delay=delay, bar_format=form) as bar:

        def show(stage: str, fraction: float) -> None:
            if bar.desc != stage:
                bar.set_description_str(stage, refresh=False)
                bar.n = 0.0
                bar.last_print_n = 0.0
            bar.update(min(max(fraction, 0.0), 1.0) - bar.n)
            if fraction >= 1.0 and time.monotonic() - start > delay:
                bar.refresh()

        yield show


class LineProgress:
    """Progress for a log file: a line at most every `interval` seconds."""

    interval = 10.0

    def __init__(self) -> None:
        self.last = time.monotonic()

    def __call__(self, stage: str, fraction: float) -> None:
        """Write a line if the last one is old."""
        now = time.monotonic()
        if now - self.last >= self.interval:
            self.last = now
            click.echo(f"bozzini: {stage} {100.0 * fraction:.0f} %", err=True)
