"""Forms of tasks: what a page asks for, and the command that a filled one stands for."""

from __future__ import annotations

import asyncio
import json
import shlex
import sys
from collections.abc import Mapping
from dataclasses import MISSING, Field

from ..checks import show_value, spell_option
from ..errors import BozziniError, InputError
from ..results import Json
from ..study.tasks import TASKS
from ..task import is_argument

LONGEST = 4096
"""Characters of a value, as of a path."""


def list_forms() -> list[Json]:
    """Return the forms of all tasks: the name, what it does, and its fields."""
    broken = TASKS.broken
    return [
        {
            "name": name,
            "about": (kind.__doc__ or "").strip().partition("\n")[0],
            "fields": [
                {
                    "name": field,
                    "about": known.describe(),
                    "words": known.words,
                    "flag": known.kind == "flag",
                    "needed": item.default is MISSING,
                    "shown": _show(item),
                }
                for field, item in kind.list_fields().items()
                for known in [item.metadata["quantity"]]
            ],
        }
        for name, kind in ((name, TASKS[name]) for name in TASKS if name not in broken)
    ]


def _show(item: Field[object]) -> str:
    """Return an example of a value, or the default; of words always that, as it is chosen."""
    known, default = item.metadata["quantity"], item.default
    if known.example and not known.words:
        return str(known.example)
    if default is MISSING or default is None:
        return ""
    return f"{default:g} {known.unit}".rstrip() if isinstance(default, float) else str(default)


def list_words(name: str, values: Mapping[str, str]) -> list[str]:
    """Return the words of the command that a filled form stands for, without the program's name.

    Raises
    ------
    InputError
        If there is no such task, or a value is no word of a command.
    PluginError
        If it is a task of another package that cannot be used.
    """
    kind = TASKS.choose(name)
    options, files = [], []
    for field, item in kind.list_fields().items():
        value = values.get(field, "")
        if "\0" in value or len(value) > LONGEST:
            raise InputError(f"{field} is {show_value(value)}: it must be a text of one command")
        if value and is_argument(item):
            files.append(value)
        elif value:
            flag = spell_option(item)
            is_flag = item.metadata["quantity"].kind == "flag"
            options.append(flag if is_flag else f"{flag}={value}")
    return [*kind.command.split(), *options, *(["--", *files] if files else [])]


TIME_LIMIT = 1800.0
"""Time that the command of a form may take [s]."""


async def fill_form(name: str, values: Mapping[str, str]) -> Json:
    """Return what the command of a form answers, and the command itself.

    It runs in a process of its own: nothing that it does can hold up a rig.
    """
    try:
        words = list_words(name, values)
    except BozziniError as error:
        return {"command": "", "answer": {"error": {"message": str(error)}}}
    count = len(TASKS[name].command.split())
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bozzini", *words[:count], "--json", *words[count:]),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        answer, _ = await asyncio.wait_for(process.communicate(), TIME_LIMIT)
    except TimeoutError:
        message = f"the command was ended after {TIME_LIMIT / 60.0:g} minutes: run it in a terminal"
        found = {"error": {"message": message}}
        return {"command": shlex.join(["bozzini", *words]), "answer": found}
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    try:
        found = json.loads(answer)
    except ValueError:
        ends = "wrote something else than its answer" if answer else "ended without an answer"
        found = {"error": {"message": f"the command {ends}"}}
    return {"command": shlex.join(["bozzini", *words]), "answer": found}
