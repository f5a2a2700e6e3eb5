"""Run what is validated on measured data, and write ``docs/validation.md``.

python validation/report.py [SET ...]

The data are no part of the project: ``BOZZINI_DATA`` names their folder, otherwise they are looked
for beside the checkout. The section of a set that is absent stays as it is in the page. Exit code 1
if a bound is not kept.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path

from section import Section

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "validation.md"
IMAGES = ROOT / "docs" / "images"
DATA = Path(os.environ.get("BOZZINI_DATA", ROOT.parent / "shared" / "data"))

SETS = (
    "festo10",
    "three_section_robot",
    "three_cable_robot",
    "tentacle",
    "helical_robot",
    "three_muscle_arm",
    "sorosim_statics",
    "sorosim_dynamics",
)
"""Folders of the sets, and modules here: each has `validate(folder, images)`, a `Section`.

A set is added by its module, its name here and a pair of marks in the page.
"""


def format_section(section: Section) -> str:
    """Return a section of the page."""
    lines = [
        f"## {section.title}",
        "",
        f"Source: {section.source}\\",
        f"Licence: {section.licence}",
        "",
        *section.text,
    ]
    return "\n".join(lines)


def put_section(page: str, name: str, text: str) -> str:
    """Return the page with the section of a set between its marks."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    marked = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.S)
    return marked.sub(lambda _: f"{begin}\n\n{text}\n\n{end}", page, count=1)


def main(names: list[str]) -> int:
    """Run the sets named, or all of them, and return the exit code."""
    unknown = [name for name in names if name not in SETS]
    if unknown:
        raise SystemExit(f"no set '{unknown[0]}': there are {', '.join(SETS)}")
    missed = 0
    for name in names or SETS:
        folder = DATA / name
        if not folder.is_dir():
            print(f"{name}: left out, no data at {folder} (set BOZZINI_DATA to its parent)")
            continue
        IMAGES.mkdir(parents=True, exist_ok=True)
        section = importlib.import_module(name).validate(folder, IMAGES)
        page = PAGE.read_text("utf-8")
        PAGE.write_text(put_section(page, name, format_section(section)), "utf-8")
        for bound in section.bounds:
            missed += not bound.is_kept
            word = "" if bound.is_kept else "   NOT KEPT"
            print(
                f"{name}: {bound.what}: {bound.measured:.3g} {bound.unit} "
                f"(at most {bound.required:g}){word}"
            )
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
