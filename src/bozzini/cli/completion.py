"""``bozzini completion``: the script with which a shell completes commands and options."""

from __future__ import annotations

import click
from click.shell_completion import BashComplete, FishComplete, ZshComplete

from .common import (
    Answer,
    CheckedCommand,
    answer_options,
)

SHELLS = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}


@click.command("completion", cls=CheckedCommand)
@click.argument("shell", metavar="|".join(SHELLS), type=click.Choice(tuple(SHELLS)))
@answer_options(quiet=False)
def command(shell: str, answer: Answer) -> None:
    """Write the script that completes commands, options and words in a shell.

    Save it as ~/.local/share/bash-completion/completions/bozzini for bash, as _bozzini in a
    directory of $fpath for zsh, and as ~/.config/fish/completions/bozzini.fish for fish.
    """
    from .main import COMPLETE, root

    script = SHELLS[shell](root, {}, "bozzini", COMPLETE).source()
    answer.give({"shell": shell, "script": script}, script)
