"""Whether a tract's size can be that of a body's."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import BozziniError, FileFormatError, GeometryError
from .tract import Finding

# What all readers of files share: whether a file is there, its name, its suffix.


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


# Keep the readers of other libraries from writing on stderr: what matters becomes a finding.

_LOGGERS = ("nibabel", "nibabel.global", "trimesh")


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Silence the loggers and warnings of nibabel and trimesh for a while."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, state in zip(loggers, before, strict=True):
            logger.disabled = state


SMALLEST = 10.0
LARGEST = 3000.0
"""Longest side of the box around a plausible tract [mm]."""

LEAST = 1.0
MOST = 10_000.0
"""Longest side of the box around what is taken for a tract at all [mm]."""


def check_scale(longest: float, *, hint: str) -> list[Finding]:
    """Warn if the longest side of the box around a tract is implausible, refuse an absurd one.

    Parameters
    ----------
    longest : float
        Longest side [mm].
    hint : str
        What to try.

    Raises
    ------
    GeometryError
        If it is below `LEAST` or above `MOST`.
    """
    if SMALLEST <= longest <= LARGEST:
        return []
    word = "small" if longest < SMALLEST else "large"
    said = f"the tract is implausibly {word}: its longest side is {longest:.3g} mm"
    if not LEAST <= longest <= MOST:
        raise GeometryError(f"{said}, it must be {LEAST:g} to {MOST:g} mm; {hint}")
    message = f"{said}, expected {SMALLEST:g} to {LARGEST:g} mm; {hint}"
    return [Finding("scale", "warning", message)]
