"""The tutorials run from nothing, as scripts and as notebooks."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.__main__ import find_commands

DOCS = Path(__file__).resolve().parents[1] / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.py"))


def test_there_are_six_of_at_most_150_lines_in_the_menu() -> None:
    menu = (DOCS.parent / "mkdocs.yml").read_text("utf-8")
    assert [path.name[0] for path in TUTORIALS] == list("123456")
    for path in TUTORIALS:
        assert len(path.read_text("utf-8").splitlines()) <= 150
        assert f"tutorials/{path.name}" in menu


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_links_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\((?!https?://)([^)#]+)", path.read_text("utf-8")):
        assert (path.parent / target).exists(), target


@pytest.mark.slow
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_runs(path: Path, tmp_path: Path) -> None:
    if path.stem.endswith("rig") and not os.environ.get("CI") and shutil.which("gcc") is None:
        pytest.skip("needs gcc")
    ran = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", str(path)],
        cwd=tmp_path,
        env=os.environ | {"MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    for words in _list_commands(path):
        given = [word for word in words[1:] if re.search(r"\w\.(nii|stl|csv|yaml|npz)", word)]
        target = words[words.index("--out") + 1] if "--out" in words else ""
        if all((tmp_path / word).exists() for word in given if word != target):
            done = subprocess.run(
                [sys.executable, "-m", *words],
                cwd=tmp_path,
                capture_output=True,
                text=True,
                timeout=600,
            )
            assert done.returncode == 0, (words, done.stderr)


def _list_commands(path: Path) -> list[list[str]]:
    """Return the commands that a tutorial shows, as words."""
    text = path.read_text("utf-8").replace("\\\n#", "")
    return [shlex.split(line) for line in re.findall(r"^#     (bozzini .*)$", text, re.M)]


def test_commands_are_found_and_options_known() -> None:
    shown = [words for path in TUTORIALS for words in _list_commands(path)]
    assert len(shown) >= 10
    for words in shown:
        names = " ".join(words[1:])
        known = find_commands()
        name = max((each for each in known if f"{names} ".startswith(f"{each} ")), key=len)
        options = {opt for item in known[name].params for opt in item.opts}
        assert {word for word in words if word.startswith("--")} <= options, words


@pytest.mark.slow
@pytest.mark.parametrize("name", ["2-muscle", "6-figure"])
def test_a_tutorial_runs_as_a_notebook(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells, texts and pictures survive the way into a notebook."""
    monkeypatch.delenv("MPLBACKEND", raising=False)  # a notebook has a backend of its own
    import jupytext
    from nbclient import NotebookClient

    book = jupytext.read(DOCS / "tutorials" / f"{name}.py")
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [out for cell in book.cells for out in cell.get("outputs", ())]
    assert sum("image/png" in out.get("data", {}) for out in shown) >= 2
    for out in shown:
        data = out.get("data", {})
        assert "image/png" in data or not data.get("text/plain", "").startswith("<Figure"), data
