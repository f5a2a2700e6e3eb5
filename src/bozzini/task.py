"""A job that is declared once: its inputs, what it does, its result.

From a `Task` follow a command with its help, JSON, table and picture; the schema and a template of
its file of options; a job of studies; a form in the cockpit; and its part of the page of commands.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, Self, get_type_hints

import numpy as np

from .checks import Quantity, check_fields, list_fields, spell_option
from .errors import InputError
from .progress import Progress, no_progress
from .results import Json, Result, Shown
from .units import add_unit

Inputs = dict[str, dataclasses.Field[object]]
"""Fields by name, each with the `Quantity` that it is."""

_NUMBERS = (float, int, float | None, int | None, "float", "int", "float | None", "int | None")

_TAKEN = ("as_json", "debug", "force", "help", "json", "options", "out", "quiet")
"""Options of every command."""


class Task(Shown, ABC):
    """A job. A subclass is a frozen dataclass whose fields, the inputs, are made by `quantity`.

    A field whose type is such a dataclass itself stands for all fields of that; their names must
    differ, also from those of the options of every command. A flag is false by default. Another
    package adds a task by an entry point of the group ``bozzini.tasks``; it has no `group`.

    Attributes
    ----------
    name : str
        By which it is chosen.
    group : str
        The command that it is under, such as ``vision``; empty for a command by itself.
    result : type of Result
        What `run` returns. Its single numbers made by `measured` or `tabulated` are the outputs of
        a study; with a method `plot` it has a picture.
    formats : mapping
        What writes its result in other formats, by the ending of a file.
    has_page : bool
        Whether `bozzini.scene.show` shows its result: its command writes that page, too.
    streamed : str
        The file that may be ``-``: rows of stdin then, which `stream` answers.
    command, key : str
        The words of its command, made of `group` and `name`, with blanks and with hyphens; files,
        studies and forms know the task by the second.
    """

    name: ClassVar[str]
    group: ClassVar[str] = ""
    result: ClassVar[type[Result]]
    formats: ClassVar[Mapping[str, Callable[..., object]]] = {}
    has_page: ClassVar[bool] = False
    streamed: ClassVar[str] = ""
    command: ClassVar[str]
    key: ClassVar[str]

    def __init_subclass__(cls) -> None:
        """Join the words of the command."""
        super().__init_subclass__()
        if "name" in vars(cls):
            cls.command = f"{cls.group} {cls.name}".strip()
            cls.key = cls.command.replace(" ", "-")

    def __post_init__(self) -> None:
        check_fields(self)

    @abstractmethod
    def run(self, progress: Progress = no_progress) -> Result:
        """Return the result.

        Raises
        ------
        InputError
            If the inputs are not legal together.
        """

    def stream(self, lines: Iterable[str]) -> Iterator[tuple[str, bool]]:
        """Return text for lines that come one by one, as soon as it can be, and if it is an answer.

        Raises
        ------
        InputError
            If a line is not legal, or the task takes no lines.
        """
        raise InputError(f"'{self.command}' takes no rows of stdin")

    def describe(self, found: Any) -> str:
        """Return what people read: the numbers of the result with their units, or why not."""
        lines = [
            f"{name.replace('_', ' ')} {getattr(found, name):.6g} {unit}".rstrip()
            for name, unit in list_numbers(type(found)).items()
            if getattr(found, name) is not None
        ]
        return "\n".join([*lines, *filter(None, [str(found.reason)])])

    @classmethod
    def list_fields(cls) -> Inputs:
        """Return the inputs by name, those of parts too.

        Raises
        ------
        TypeError
            If they cannot be options of one command.
        """
        found: Inputs = {}
        for kind in (cls, *_list_parts(cls).values()):
            own = list_fields(kind)
            if twice := found.keys() & own.keys():
                raise TypeError(f"{cls.__name__} has the input '{twice.pop()}' twice")
            found |= own
        for name, item in found.items():
            if not {name, spell_option(item).removeprefix("--")}.isdisjoint(_TAKEN):
                raise TypeError(f"{cls.__name__} has the input '{name}': every command has one")
            if item.metadata["quantity"].kind == "flag" and item.default is not False:
                raise TypeError(
                    f"{cls.__name__} has the flag '{name}': it must be false by default"
                )
        return found

    @classmethod
    def list_options(cls) -> Inputs:
        """Return the inputs that are options, and may stand in a file of these."""
        return {name: item for name, item in cls.list_fields().items() if not is_argument(item)}

    @classmethod
    def list_inputs(cls) -> dict[str, Quantity]:
        """Return what is known of the inputs by name."""
        return {name: item.metadata["quantity"] for name, item in cls.list_fields().items()}

    @classmethod
    def from_inputs(cls, values: Mapping[str, object]) -> Self:
        """Return the task of inputs by name, in Bozzini's units.

        Raises
        ------
        InputError
            If one is not legal.
        """
        left = dict(values)
        made = {
            name: kind(**{key: left.pop(key) for key in [*left] if key in _list_names(kind)})
            for name, kind in _list_parts(cls).items()
        }
        return cls(**left, **made)

    @property
    def inputs(self) -> Json:
        """The inputs, with their units in the names."""
        owners = [self, *(getattr(self, name) for name in _list_parts(type(self)))]
        return {
            add_unit(name, item.metadata["quantity"].unit): getattr(owner, name)
            for owner in owners
            for name, item in list_fields(type(owner)).items()
        }


def list_numbers(kind: type[Result]) -> dict[str, str]:
    """Return the single numbers of a result that have been given units, and these."""
    return {
        item.name: item.metadata["unit"]
        for item in dataclasses.fields(kind)  # type: ignore[arg-type]
        if "unit" in item.metadata and item.type in _NUMBERS
    }


def has_converged(found: Result) -> bool:
    """Whether all of a result has."""
    return bool(np.all(found.converged))


def is_argument(item: dataclasses.Field[object]) -> bool:
    """Whether an input stands on the command line without its name: a file that is needed."""
    return item.metadata["quantity"].kind == "file" and item.default is dataclasses.MISSING


def _list_names(kind: type) -> set[str]:
    return {item.name for item in dataclasses.fields(kind)}


def _list_parts(kind: type) -> dict[str, type]:
    """Return the fields of a dataclass that are dataclasses of inputs."""
    hints = get_type_hints(kind)
    return {
        item.name: hints[item.name]
        for item in dataclasses.fields(kind)
        if "quantity" not in item.metadata and dataclasses.is_dataclass(hints[item.name])
    }
