"""``bozzini tree``: the branches of a lumen."""

from __future__ import annotations

from ..study.reaching import TreeListing
from .task import make_command

__all__ = ["command"]

command = make_command(TreeListing)
