"""``bozzini hysteresis``: loops of any input and output, fitted and predicted."""

from __future__ import annotations

import click

from ..hysteresis.tasks import LoopFitting, LoopPredicting
from .common import CheckedGroup
from .task import make_command

__all__ = ["command"]


@click.group("hysteresis", cls=CheckedGroup)
def command() -> None:
    """Fit laws with memory to loops of any input and output, and predict."""


for kind in (LoopFitting, LoopPredicting):
    command.add_command(make_command(kind))
