"""``bozzini doctor``: what is installed and found here, to paste into a report of a fault."""

from __future__ import annotations

import importlib
import os
import platform
import re
import shutil
from collections import defaultdict
from importlib import metadata
from pathlib import Path

import click

from .. import __version__
from ..results import Json
from .common import (
    EXIT_NEGATIVE,
    Answer,
    CheckedCommand,
    answer_options,
    run_exit,
)

VARIABLES = (
    *("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_CACHE_DIR"),
    *("NUMBA_DISABLE_JIT", "MPLCONFIGDIR", "MPLBACKEND", "MUJOCO_GL"),
)
"""What in the environment changes how Bozzini works."""

DEVELOPMENT = ("all", "dev", "docs")
"""Extras that add nothing to the commands."""


@click.command("doctor", cls=CheckedCommand)
@click.option(
    "--compile", is_flag=True, help="Compile all kernels now, on all cores, and keep them."
)
@answer_options()
def command(compile: bool, answer: Answer) -> None:
    """Tell versions, extras, threads, compiled code and programs found, for a report of a fault.

    Each kernel is compiled where it is first needed, and kept; --compile does that at once for all.

    Exit code 0: the core has all that it needs; 1: a package of it is missing or cannot be loaded,
    or compiled code cannot be kept.
    """
    if compile:
        from ..numeric.signatures import compile_kernels

        with answer.show_progress() as progress:
            compile_kernels(progress=progress)
    found = examine()
    answer.give(found, format_findings(found))
    if found["faults"] or not found["compiled_code"] or None in found["packages"].values():
        run_exit(EXIT_NEGATIVE)


def examine() -> Json:
    """Return what is installed and found, as plain values; what is missing is None."""
    from ..io.files import find_compiled_code

    faults: list[str] = []

    def ask(module: str, name: str) -> object:
        """Return what a function finds; what it imports may be what is wrong here."""
        try:
            return getattr(importlib.import_module(f"bozzini.{module}"), name)()
        except Exception as error:
            words = " ".join(str(error).split())
            faults.append(f"bozzini.{module} fails: {type(error).__name__}: {words}")
            return None

    needed = list_requirements()
    core = needed.pop("", [])
    usable = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return {
        "bozzini": __version__,
        "place": _shorten(str(Path(__file__).parents[1])),
        "python": f"{platform.python_version()} {platform.python_implementation()}",
        "system": platform.platform(),
        "cores": os.cpu_count(),
        "cores_usable": len(usable) or None,
        "environment": {name: os.environ[name] for name in VARIABLES if name in os.environ},
        "compiled_code": _shorten(find_compiled_code()),
        "packages": {name: find_version(name) for name in core},
        "extras": {
            extra: {name: find_version(name) for name in names} for extra, names in needed.items()
        },
        "programs": {
            "chromium": ask("scene.film", "find_browser"),
            "ffmpeg": shutil.which("ffmpeg"),
            "make": shutil.which("make"),
            "cc": shutil.which("cc"),
            "avr-gcc": shutil.which("avr-gcc"),
        },
        "firmware_lacks": ask("rig.firmware", "find_missing_tools"),
        "faults": faults,
    }


def list_requirements() -> dict[str, list[str]]:
    """Return the packages that each extra needs, by its name; those of the core by ``""``."""
    found: dict[str, list[str]] = defaultdict(list)
    try:
        stated = metadata.requires("bozzini") or []
    except metadata.PackageNotFoundError:  # it runs from its sources
        stated = []
    for line in stated:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"""extra == ["']([\w-]+)["']""", line)
        key = extra[1] if extra else ""
        if key not in DEVELOPMENT:
            found[key].append(name)
    return found


def find_version(package: str) -> str | None:
    """Return the version of an installed package, None where it is missing."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def format_findings(found: Json) -> str:
    """Return what `examine` found as lines for people."""
    cores = f"{found['cores']} cores"
    if found["cores_usable"] is not None:
        cores += f", {found['cores_usable']} of them for this process"
    compiled = found["compiled_code"] or "nowhere: set NUMBA_CACHE_DIR to a directory to write to"
    lines = [
        f"Bozzini {found['bozzini']} in {found['place']}",
        f"Python {found['python']}, {found['system']}",
        f"{cores}; compiled code is kept in {compiled}",
        *(f"  {name}={value}" for name, value in found["environment"].items()),
        "packages: " + (_format_versions(found["packages"]) or "not known, it is not installed"),
    ]
    for extra, packages in found["extras"].items():
        lacking = None in packages.values()
        hint = f"  (pip install 'bozzini[{extra}]')" if lacking else ""
        lines.append(f"extra {extra}: {_format_versions(packages)}{hint}")
    for program, place in found["programs"].items():
        more = ", with playwright" if program == "chromium" else ""
        lines.append(f"{program}{more}: {place or 'not found'}")
    lacks = found["firmware_lacks"]
    if lacks is not None:
        missing = f"lacks {', '.join(lacks)} (apt-get install {' '.join(lacks.values())})"
        lines.append(f"firmware and emulator: {missing if lacks else 'all tools found'}")
    return "\n".join([*lines, *found["faults"]])


def _format_versions(packages: Json) -> str:
    return ", ".join(f"{name} {version or 'missing'}" for name, version in packages.items())


def _shorten(path: str | None) -> str | None:
    """Return a path with ``~`` for the home directory, whose name is nobody's business."""
    home = str(Path.home())
    return path.replace(home, "~", 1) if path and len(home) > 1 and path.startswith(home) else path
