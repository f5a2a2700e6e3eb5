"""Writing files so that no half-written one is ever seen."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import OutputError

__all__ = [
    "check_new_directory",
    "check_new_file",
    "new_directory",
    "write_atomically",
    "write_text",
]


def write_atomically(path: str | os.PathLike[str], write: Callable[[Path], None]) -> Path:
    """Let `write` fill a temporary file beside `path`, then rename it to `path`.

    Raises
    ------
    OutputError
        If the place cannot be written; nothing is left behind.
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.name}.", suffix=target.suffix
        )
        os.close(handle)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from None
    except ValueError as error:  # a null byte in the name
        raise OutputError(f"cannot write {target}: {error}") from None
    temporary = Path(name)
    try:
        write(temporary)
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        temporary.unlink(missing_ok=True)
    return target


def check_new_file(
    path: str | os.PathLike[str], suffixes: tuple[str, ...], *, force: bool = False
) -> None:
    """Raise `OutputError` at once if a file could not be written later, before any work is done.

    Parameters
    ----------
    path : path-like
        The file to write.
    suffixes : tuple of str
        What it may end in, in small letters.
    force : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    OutputError
        If it ends otherwise, is a directory, exists and may not be replaced, or its place takes
        no new file.
    """
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise OutputError(
            f"{target} ends in '{target.suffix}': it must end in {', '.join(suffixes)}"
        )
    try:
        if not target.parent.is_dir():
            raise OutputError(f"cannot write {target}: {target.parent} is not a directory")
        if target.is_dir():
            raise OutputError(f"{target} is a directory: choose a file")
        if target.exists() and not force:
            raise OutputError(f"{target} exists already: choose another file or give --force")
        # Whether a place takes a file is only known by trying: permissions do not tell all.
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        os.close(handle)
        Path(name).unlink(missing_ok=True)
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, a null byte
        problem = getattr(error, "strerror", None) or error
        raise OutputError(f"cannot write {target}: {problem}") from None


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write UTF-8 text atomically."""
    return write_atomically(path, lambda temporary: _put_text(temporary, text))


def _put_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


@contextmanager
def new_directory(path: str | os.PathLike[str], *, force: bool = False) -> Iterator[Path]:
    """Give a temporary directory that becomes `path` only if the block ends well.

    Parameters
    ----------
    path : path-like
        The directory to make.
    force : bool
        Replace a directory that exists; without it that is an error.

    Raises
    ------
    OutputError
        If `path` exists (and `force` is not given), is a file, or cannot be made.
    """
    target = Path(path)
    check_new_directory(target, force=force)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
        temporary.chmod(0o755)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from None
    try:
        yield temporary
        _replace_directory(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_new_directory(path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Raise `OutputError` at once if `new_directory` would refuse this path later."""
    target = Path(path)
    try:
        _check_place(target, force=force)
    except OutputError:
        raise
    except (OSError, ValueError) as error:  # a name that is too long, a null byte
        raise OutputError(f"cannot write {target}: {error}") from None


def _check_place(target: Path, *, force: bool) -> None:
    if "\0" in str(target):
        raise ValueError("the name holds a null byte")
    if target.is_dir() and not force:
        raise OutputError(f"{target} exists already: choose another directory or give --force")
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target} is a file: choose a directory")
    ancestor = target if target.exists() else target.parent
    while not ancestor.exists() and ancestor != ancestor.parent:
        ancestor = ancestor.parent
    if not ancestor.is_dir():
        raise OutputError(f"cannot write {target}: {ancestor} is not a directory")
    if not os.access(ancestor, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {target}: no permission in {ancestor}")


def _replace_directory(temporary: Path, target: Path) -> None:
    try:
        if not target.exists():
            temporary.rename(target)
            return
        # A directory of the user's own: replace the files of the same name, keep the rest.
        _merge_directory(temporary, target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from None


def _merge_directory(source: Path, target: Path) -> None:
    for item in source.iterdir():
        place = target / item.name
        if item.is_dir() and place.is_dir():
            _merge_directory(item, place)
        else:
            item.replace(place)
