"""``bozzini head``: the distal head with its camera, what it sees and what it reaches."""

from __future__ import annotations

import click

from ..head.anchor import HeadReaching
from ..head.check import HeadChecking, HeadShow, HeadViewing
from ..head.operate import HeadComparing
from .common import CheckedGroup
from .task import make_command

__all__ = ["command"]


@click.group("head", cls=CheckedGroup)
def command() -> None:
    """Look down on a catheter tip: a distal head's sizes, view and reach."""


for kind in (HeadShow, HeadChecking, HeadViewing, HeadReaching, HeadComparing):
    command.add_command(make_command(kind))
