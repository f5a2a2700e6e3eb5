"""Completion in the shell: every command and option is offered."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.shell_completion import ShellComplete

from bozzini.anatomy.tract import ORGANS
from bozzini.cli.main import COMMANDS, COMPLETE, main, root
from tests.fuzz.__main__ import find_commands


class _Shell(ShellComplete):
    name = "test"
    source_template = ""


def _complete(words: list[str], beginning: str = "") -> set[str]:
    shell = _Shell(root, {}, "bozzini", COMPLETE)
    return {str(item.value) for item in shell.get_completions(words, beginning)}


def test_every_command_is_offered_where_it_stands() -> None:
    assert _complete([]) == set(COMMANDS)
    assert _complete([], "co") == {name for name in COMMANDS if name.startswith("co")}
    for name in find_commands():
        *before, last = name.split()
        assert last in _complete(before), name


@pytest.mark.parametrize("name", ["plan", "new robot", "continuum pose", "doctor"])
def test_every_option_is_offered(name: str) -> None:
    options = {
        word
        for item in find_commands()[name].params
        if isinstance(item, click.Option) and not item.hidden
        for word in item.opts
    }
    assert _complete(name.split(), "--") >= options


def test_words_of_an_option_are_offered() -> None:
    assert _complete(["plan", "--organ"]) == set(ORGANS)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_script_asks_the_program(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert f"{COMPLETE}={shell}_complete" in script and "bozzini" in script


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", "powershell"]) == 2
    assert "'bash', 'zsh', 'fish'" in capsys.readouterr().err


def test_bash_completes_by_the_script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bash = shutil.which("bash")
    assert bash is not None
    program = tmp_path / "bozzini"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m bozzini "$@"\n')
    program.chmod(0o755)
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    ask = "COMP_WORDS=(bozzini co); COMP_CWORD=1; _bozzini_completion bozzini; echo ${COMPREPLY[@]}"
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    done = subprocess.run(
        [bash, "-c", f"{script}\n{ask}"], capture_output=True, text=True, timeout=120
    )
    assert set(done.stdout.split()) == {name for name in COMMANDS if name.startswith("co")}


def test_the_first_word_is_completed_without_importing_commands() -> None:
    code = (
        "import sys; from click.shell_completion import ShellComplete; "
        "from bozzini.cli.main import root; "
        "root.shell_complete(root.make_context('bozzini', [], resilient_parsing=True), ''); "
        "print(*[name for name in sys.modules if name.startswith('bozzini.cli.')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert set(done.stdout.split()) == {"bozzini.cli.main", "bozzini.cli.common"}
