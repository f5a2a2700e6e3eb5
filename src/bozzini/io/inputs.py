"""What a command reads: nothing that it writes may take its place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import OutputError

_Identity = tuple[int, int]

_kept: list[dict[_Identity, Path]] = []
"""The files that the block of `keep_inputs` has read, by device and number; at most one entry."""


@contextmanager
def keep_inputs() -> Iterator[None]:
    """Refuse, while the block runs, to write over what `note_input` names in it.

    The command line runs in such a block. From Python a file may be replaced by what it became.
    """
    before = _kept.copy()
    _kept[:] = [{}]
    try:
        yield
    finally:
        _kept[:] = before


def note_input(path: str | os.PathLike[str]) -> None:
    """Tell that a file or directory is read; one that is not there is left out."""
    if _kept:
        identity = _identify(path)
        if identity is not None:
            _kept[0].setdefault(identity, Path(path))


def find_input(path: str | os.PathLike[str]) -> Path | None:
    """Return the input that a path leads to, by whatever name or link; None if it is none."""
    identity = _identify(path) if _kept and _kept[0] else None
    found = None if identity is None else _kept[0].get(identity)
    # Another file may have the number of one that is no more.
    return found if found is not None and _identify(found) == identity else None


def check_no_input(path: str | os.PathLike[str]) -> None:
    """Raise `OutputError` if a file to write is one that is read."""
    found = find_input(path)
    if found is not None:
        other = "" if os.fspath(found) == os.fspath(path) else f" ({found})"
        raise OutputError(
            f"{path} is an input of this command{other}, which would be lost: choose another file"
        )


def _identify(path: str | os.PathLike[str]) -> _Identity | None:
    try:
        found = os.stat(path)
    except (OSError, ValueError):  # not there, a null byte
        return None
    return found.st_dev, found.st_ino
