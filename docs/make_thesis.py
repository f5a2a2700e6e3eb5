"""Draw the figures of the thesis anew from the package, and keep pictures and values.

    python docs/make_thesis.py               all
    python docs/make_thesis.py 5_03 5_11     these only, by the number of their first figure

A figure is a function `fig_...` in docs/thesis_figures. It returns what it has drawn and one line
of values; its docstring has what the thesis prints, what is ours, and how both go together.
"""

from __future__ import annotations

import inspect
import json
import re
import runpy
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path.append(str(DOCS.parent))  # for validation.thesis
PICTURES = DOCS / "images" / "thesis"
VALUES = PICTURES / "values.json"
SCRIPTS = ("muscles", "effector", "robots", "ducts")
WIDTH = 700.0  # of a picture [px]
NOTES = ("Printed", "Ours", "Beside the print")

Draw = Callable[[], tuple[object, str]]

NOT_DRAWN = {
    "1.1 to 1.6": "photographs and drawings of instruments and robots that others made",
    "3.1, 3.2": "photographs of the muscles",
    "3.3": "a layout; [the rig](rig/plant.md) computes the circuit and marks what is assumed",
    "3.4": "a photograph of the bench",
    "3.7, 3.8": "sketches of forces without numbers; the balance is `ThesisMuscle`",
    "3.9, 3.10": "pictures of the contact and of an end; the area (3.22) is in `ThesisMuscle`",
    "4.1": "a concept of a camera assembly and an end cap, without dimensions",
    "4.2, 4.3": "drawings of the holders, with four dimensions; "
    "[Fabrication](guide/fabricate.md) makes holders that can be built",
    "4.4": "a photograph",
    "4.8": "photographs and a profile found in them, whose points are not printed",
    "4.15": "a photograph; its 22.4 mm are compared in "
    "[Effector](theory/effector.md#beside-the-measurement)",
}
"""Figures that cannot be had, and why."""


@cache
def list_figures() -> dict[str, Draw]:
    """Return the functions that draw, by what their pictures are called, in order."""
    found = {}
    for script in SCRIPTS:
        for name, value in runpy.run_path(str(DOCS / "thesis_figures" / f"{script}.py")).items():
            if name.startswith("fig_"):
                found[name.removeprefix("fig_")] = value
    return found


def read_notes(draw: Draw) -> tuple[str, dict[str, str]]:
    """Return the title of a figure and its notes, from the docstring."""
    title, *parts = (inspect.getdoc(draw) or "").split("\n\n")
    notes = dict(" ".join(part.split()).split(": ", 1) for part in parts)
    return title.rstrip("."), notes


def list_numbers(title: str) -> list[str]:
    """Return the numbers of the thesis's figures that a title or a row names, spans filled."""
    numbers = []
    head = title.split(":")[0]
    for first, last in re.findall(r"\b([\dABC]\.\d+)(?: to ([\dABC]\.\d+))?", head):
        chapter, start = first.split(".")
        end = (last or first).split(".")[1]
        numbers += [f"{chapter}.{k}" for k in range(int(start), int(end) + 1)]
    return numbers


def make_picture(name: str, *, folder: Path = PICTURES) -> tuple[Path, str]:
    """Draw a figure, write it, and return its path and its line of values."""
    from bozzini.plot import write_figure

    drawn, value = list_figures()[name]()
    figure = getattr(drawn, "get_figure", lambda **_: drawn)(root=True)
    folder.mkdir(parents=True, exist_ok=True)
    path = write_figure(figure, folder / f"fig_{name}.png", dpi=WIDTH / figure.get_figwidth())
    return path, value.replace("e-0", "e-")


def format_page(values: dict[str, str]) -> Iterator[str]:
    """Yield the paragraphs that the page has below its title."""
    for name, draw in list_figures().items():
        title, notes = read_notes(draw)
        yield f'<a id="fig_{name}"></a>'
        yield f"## {title}"
        yield f"![{title}](images/thesis/fig_{name}.png)"
        rows = [f"- **{head}**: {notes[head]}" for head in NOTES]
        yield "\n".join([*rows, f"- **Value**: {values[name]}"])
    yield "## Not drawn"
    table = ["| figure | why |", "|---|---|"]
    yield "\n".join([*table, *(f"| {figure} | {why} |" for figure, why in NOT_DRAWN.items())])


def main(names: list[str]) -> None:
    """Draw all figures, or those named."""
    figures = list_figures()
    wrong = [name for name in names if not any(key.startswith(name) for key in figures)]
    if wrong:
        sys.exit(f"there is no figure {', '.join(wrong)}: there are {', '.join(figures)}")
    values = json.loads(VALUES.read_text("utf-8")) if VALUES.exists() else {}
    for name in figures:
        if not names or name.startswith(tuple(names)):
            path, values[name] = make_picture(name)
            print(path.relative_to(DOCS), values[name], sep=": ")
    values = {name: values.get(name, "") for name in figures}
    VALUES.write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
