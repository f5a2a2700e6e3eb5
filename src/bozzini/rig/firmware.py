"""The board's firmware: where its sources are, what builds them, and the built files.

Files are built once for each state of the sources and kept in the user's cache directory.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Literal, get_args

from ..errors import BozziniError
from ..io.files import find_cache

__all__ = ["Part", "ToolchainError", "build", "find_build_id", "find_missing_tools", "find_sources"]

Part = Literal[
    "firmware.elf",
    "firmware-test.elf",
    "firmware.hex",
    "native.so",
    "native-test.so",
    "emulator.so",
    "fuzz-parser",
    "fuzz-control",
]
"""What can be built: programs of the board, libraries of the boards here, and fuzz programs."""

_PACKAGES = {
    "make": "make",
    "cc": "gcc",
    "avr-gcc": "gcc-avr",
    "avr/io.h": "avr-libc",
    "simavr/sim_avr.h": "libsimavr-dev",
    "libelf.h": "libelf-dev",
}


class ToolchainError(BozziniError, RuntimeError):
    """The firmware cannot be built: a tool is missing, or a compiler reports an error."""


def find_sources() -> Path:
    """Return the directory of the firmware's sources: in the installed package or the checkout.

    Raises
    ------
    ToolchainError
        If there are none.
    """
    here = Path(__file__).resolve()
    for place in (here.parent / "firmware", here.parents[3] / "firmware"):
        if (place / "Makefile").is_file():
            return place
    raise ToolchainError("the sources of the firmware are missing from this installation")


def find_build_id(sources: Path | None = None) -> int:
    """Return the first 32 bits of the SHA-256 of the board's sources, as the board reports it."""
    files = sorted(((sources or find_sources()) / "src").glob("*.[ch]"))
    return int(hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:8], 16)


def find_missing_tools(parts: Iterable[Part] = get_args(Part)) -> dict[str, str]:
    """Return what is missing to build parts of the firmware, with the Debian package of each."""
    needed = {"make"}
    for part in parts:
        needed |= {"avr-gcc", "avr/io.h"} if part.startswith("firmware") else {"cc"}
        needed |= {"simavr/sim_avr.h", "libelf.h"} if part == "emulator.so" else set()
    return {tool: package for tool, package in _list_missing().items() if tool in needed}


@cache
def _list_missing() -> dict[str, str]:
    found = {tool for tool in _PACKAGES if "." not in tool and shutil.which(tool)}
    for compiler, header in (
        ("avr-gcc", "avr/io.h"),
        ("cc", "simavr/sim_avr.h"),
        ("cc", "libelf.h"),
    ):
        options = ["-mmcu=atmega2560"] if compiler == "avr-gcc" else []
        command = [compiler, *options, "-E", "-x", "c", "-include", header, os.devnull]
        if compiler in found and not subprocess.run(command, capture_output=True).returncode:
            found.add(header)
    return {tool: package for tool, package in _PACKAGES.items() if tool not in found}


def build(part: Part, sources: Path | None = None) -> Path:
    """Build a part of the firmware, unless it is there already, and return its file.

    Parameters
    ----------
    part : str
        One of `Part`.
    sources : Path, optional
        Directory with the sources, by default Bozzini's own.

    Raises
    ------
    ToolchainError
        If a tool is missing, with its Debian package, or if the sources do not compile.
    """
    place = sources or find_sources()
    target = find_cache("firmware") / _find_digest(place) / part
    if target.exists():
        return target
    missing = find_missing_tools([part])
    if missing:
        raise ToolchainError(
            f"building {part} needs {', '.join(missing)}, not found here; "
            f"on Debian: apt-get install {' '.join(missing.values())}"
        )
    # Several processes may build the same: each does it in a directory of its own, and the
    # finished file is put in place at once.
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".build-") as temporary:
        shutil.copytree(
            place, temporary, dirs_exist_ok=True, ignore=shutil.ignore_patterns("build")
        )
        command = ["make", f"out/{part}", "BUILD=out", f"BUILD_ID={find_build_id(place):08x}"]
        # Another compiler may warn of more than those that the tests use.
        done = subprocess.run(
            [*command, "WERROR="], cwd=temporary, capture_output=True, text=True, errors="replace"
        )
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line.lower()]
            raise ToolchainError(f"{part} does not build: {[*lines, 'make failed'][0].strip()}")
        (Path(temporary) / "out" / part).replace(target)
    return target


def _find_digest(sources: Path) -> str:
    """Return what tells builds apart: sources and compilers."""
    digest = hashlib.sha256()
    for file in sorted(sources.rglob("*")):
        relative = file.relative_to(sources)
        if file.is_file() and "build" not in relative.parts:
            digest.update(f"{relative.as_posix()} {file.stat().st_size}\n".encode())
            digest.update(file.read_bytes())
    for compiler in ("cc", "avr-gcc"):
        path = os.path.realpath(shutil.which(compiler) or "")
        stamp = os.stat(path).st_mtime_ns if os.path.isfile(path) else 0
        digest.update(f"{compiler} {path} {stamp}\n".encode())
    return digest.hexdigest()[:24]
