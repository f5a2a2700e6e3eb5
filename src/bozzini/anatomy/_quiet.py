"""Keep the readers of other libraries from writing on stderr: what matters becomes a finding."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["quiet_libraries"]

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
