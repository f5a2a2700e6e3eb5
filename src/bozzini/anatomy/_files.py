"""What all readers of files share: whether a file is there, its name, its suffix."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import BozziniError, FileFormatError

__all__ = ["check_file", "explain", "has_suffix", "name_file"]


def has_suffix(path: str | os.PathLike[str], known: tuple[str, ...]) -> bool:
    return os.fspath(path).lower().endswith(known)


def name_file(path: str | os.PathLike[str]) -> str:
    return Path(path).name


def check_file(path: str | os.PathLike[str]) -> None:
    file = Path(path)
    try:
        if not file.exists():
            raise FileFormatError(f"{path}: no such file")
        if not file.is_file():
            raise FileFormatError(f"{path} is not a file")
        if file.stat().st_size == 0:
            raise FileFormatError(f"{path} is empty (0 bytes)")
        with file.open("rb") as handle:
            handle.read(1)
    except (OSError, ValueError) as error:
        if isinstance(error, BozziniError):
            raise
        raise FileFormatError(f"{path} cannot be read: {explain(error)}") from None


def explain(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())
    return text[:160] if text else type(error).__name__
