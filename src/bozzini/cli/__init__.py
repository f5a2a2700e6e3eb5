"""The command line: one file per command, loaded only when that command is used."""

from __future__ import annotations

__all__: list[str] = []
