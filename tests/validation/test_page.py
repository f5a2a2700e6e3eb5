"""The page of what was validated has a place for each set, and each set a section."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "validation.md").read_text("utf-8")
BEGIN = "import sys; sys.path.insert(0, 'validation'); import report\n"


def ask(code: str) -> str:
    command = [sys.executable, "-c", BEGIN + code]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def test_each_set_has_its_section_in_the_page():
    names = ask("print(*report.SETS)").split()
    assert names
    for name in names:
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        assert PAGE.count(begin) == PAGE.count(end) == 1
        section = PAGE[PAGE.index(begin) : PAGE.index(end)]
        assert "Source: " in section and "Licence: " in section


def test_a_section_replaces_its_own_alone():
    other = "b <!-- y: begin --> kept <!-- y: end -->"
    page = f"a <!-- x: begin --> old <!-- x: end --> {other}"
    found = ask(f"print(report.put_section({page!r}, 'x', {'new' + chr(92) + '1'!r}))")
    assert found.split() == f"a <!-- x: begin --> new\\1 <!-- x: end --> {other}".split()
