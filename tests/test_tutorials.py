"""The tutorials run from nothing, as scripts and as notebooks."""

from __future__ import annotations

import ast
import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bozzini.cli.main import main
from tests.fuzz.__main__ import find_commands
from tests.test_extras import CORE, EXTRAS, PACKAGES, _name

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


BARE = """
import runpy, sys
for name in sys.argv[1].split(","):
    sys.modules[name] = None
sys.argv = sys.argv[2:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
"""Runs a file without the modules that are named: with what the extra `docs` brings."""


def _list_modules(extra: str) -> set[str]:
    """Return the modules that an extra brings beyond the core."""
    within = re.findall(r"\w+", EXTRAS["all"][0])[1:] if extra == "all" else [extra]
    names = [_name(item) for one in within for item in EXTRAS[one]]
    modules = {package: module for module, package in PACKAGES.items()}
    return {modules.get(name, name.replace("-", "_")) for name in names}


def test_the_extra_docs_has_what_the_tutorials_say_they_need() -> None:
    asked = {
        extra
        for path in TUTORIALS
        for extra in re.findall(r"bozzini\[(\w+)\]", path.read_text("utf-8"))
    }
    assert asked and all(set(EXTRAS[extra]) <= set(EXTRAS["docs"]) for extra in asked)


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_a_tutorial_imports_the_core_and_the_extra_docs_alone(path: Path) -> None:
    trees = ast.walk(ast.parse(path.read_text("utf-8")))
    names = {alias.name for tree in trees if isinstance(tree, ast.Import) for alias in tree.names}
    trees = ast.walk(ast.parse(path.read_text("utf-8")))
    names |= {tree.module or "" for tree in trees if isinstance(tree, ast.ImportFrom)}
    found = {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"bozzini"}
    assert found <= _list_modules("docs") | {_name(item) for item in CORE}


@pytest.mark.slow(20)
@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial_runs(path: Path, tmp_path: Path) -> None:
    if path.stem.endswith("rig") and not os.environ.get("CI") and shutil.which("gcc") is None:
        pytest.skip("needs gcc")
    missing = ",".join(sorted(_list_modules("all") - _list_modules("docs")))
    ran = subprocess.run(
        [
            sys.executable,
            "-W",
            "error::DeprecationWarning:__main__",
            "-c",
            BARE,
            missing,
            str(path),
        ],
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
            with contextlib.chdir(tmp_path):
                assert main(words[1:]) == 0, words


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
def test_a_tutorial_runs_as_a_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells, texts and pictures survive the way into a notebook."""
    monkeypatch.delenv("MPLBACKEND", raising=False)  # a notebook has a backend of its own
    import jupytext
    from nbclient import NotebookClient

    book = jupytext.read(DOCS / "tutorials" / "6-figure.py")
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [out for cell in book.cells for out in cell.get("outputs", ())]
    assert sum("image/png" in out.get("data", {}) for out in shown) >= 2
    for out in shown:
        data = out.get("data", {})
        assert "image/png" in data or not data.get("text/plain", "").startswith("<Figure"), data
