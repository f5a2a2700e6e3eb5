"""Forms of tasks: what a page asks for, and the command that a filled one stands for."""

from __future__ import annotations

import asyncio
import json
import shlex
import sys
from collections.abc import Mapping
from dataclasses import MISSING

from ..checks import spell_option
from ..errors import InputError
from ..results import Json
from ..study.tasks import TASKS
from ..task import is_argument


def list_forms() -> list[Json]:
    """Return the forms of all tasks: the name, what it does, and its fields."""
    return [
        {
            "name": name,
            "about": (kind.__doc__ or "").strip().splitlines()[0],
            "fields": [
                {
                    "name": field,
                    "about": known.describe(),
                    "words": known.words,
                    "flag": known.kind == "flag",
                    "needed": item.default is MISSING,
                    "shown": known.example or _spell(item.default, known.unit),
                }
                for field, item in kind.list_fields().items()
                for known in [item.metadata["quantity"]]
            ],
        }
        for name, kind in ((name, TASKS[name]) for name in TASKS if name not in TASKS.broken)
    ]


def _spell(default: object, unit: str) -> str:
    if default is MISSING or default is None:
        return ""
    return f"{default:g} {unit}".rstrip() if isinstance(default, float) else str(default)


def list_words(name: str, values: Mapping[str, str]) -> list[str]:
    """Return the words of the command that a filled form stands for, without the program's name.

    Raises
    ------
    InputError
        If there is no such task.
    """
    kind = TASKS.choose(name)
    options, files = [], []
    for field, item in kind.list_fields().items():
        value = values.get(field, "")
        if value and is_argument(item):
            files.append(value)
        elif value:
            flag = spell_option(item)
            is_flag = item.metadata["quantity"].kind == "flag"
            options.append(flag if is_flag else f"{flag}={value}")
    return [*kind.command.split(), *options, *(["--", *files] if files else [])]


async def fill_form(name: str, values: Mapping[str, str]) -> Json:
    """Return what the command of a form answers, and the command itself.

    It runs in a process of its own: nothing that it does can hold up a rig.
    """
    try:
        words = list_words(name, values)
    except InputError as error:
        return {"command": "", "answer": {"error": {"message": str(error)}}}
    count = len(TASKS[name].command.split())
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bozzini", *words[:count], "--json", *words[count:]),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        answer, _ = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
    found = json.loads(answer) if answer else {"error": {"message": "it ended without an answer"}}
    return {"command": shlex.join(["bozzini", *words]), "answer": found}
