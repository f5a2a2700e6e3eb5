"""``bozzini reach``: how far scopes come into every branch of a lumen."""

from __future__ import annotations

from ..study.reaching import TreeReaching
from .task import make_command

__all__ = ["command"]

command = make_command(TreeReaching)
