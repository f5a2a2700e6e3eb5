"""Make the gallery: run each file of docs/gallery and keep its picture.

    python docs/make_gallery.py             all
    python docs/make_gallery.py plan force  these pictures only

A file of the gallery is a title, a text and 10 to 40 lines that leave `figure` or `axes` behind.
"""

from __future__ import annotations

import ast
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "images" / "gallery"
WIDTH = 800.0  # of a picture [px]
GROUPS = {
    "From a tract to a motion": [
        "plan", "depths", "clearance", "methods", "breathing", "centreline", "link_limits",
        "duct_fit", "shapes",
    ],
    "Muscles": ["contraction", "force", "ranking", "calibration", "hysteresis", "loop_fit"],
    "Catheter tips": ["effector", "effector_workspace", "circle", "tip_force", "head_cameras"],
    "Tendon robots": [
        "continuum", "rod_models", "robot_workspace", "contact", "push_force", "routing",
        "fabricate",
    ],
    "The rig and the camera": ["plant", "board", "tube_shape"],
    "Forces": ["forces"],
    "Studies, and how sure an answer is": ["study", "indices", "contact_risk", "tip_error"],
}  # fmt: skip
FRONT = (
    "plan", "depths", "breathing", "contraction", "loop_fit", "effector_workspace", "circle",
    "rod_models", "robot_workspace", "contact", "tube_shape", "study",
)  # fmt: skip
"""The pictures on the front page, three in a row."""


def list_scripts() -> list[Path]:
    """Return the files of the gallery in the order of the page."""
    return [DOCS / "gallery" / f"{name}.py" for names in GROUPS.values() for name in names]


def split_script(script: Path) -> tuple[str, str, str]:
    """Return the title, the text and the code of a file."""
    source = script.read_text("utf-8")
    title, _, text = (ast.get_docstring(ast.parse(source)) or "").partition("\n")
    code = source.split('"""', 2)[2].strip()
    return title.rstrip("."), text.strip(), code


def make_picture(script: Path, *, folder: Path = PICTURES) -> Path:
    """Run a file and write its picture."""
    from bozzini.plot import write_figure

    left = runpy.run_path(str(script))
    figure = left.get("figure") or left["axes"].get_figure(root=True)
    folder.mkdir(parents=True, exist_ok=True)
    dpi = WIDTH / figure.get_figwidth()
    return write_figure(figure, folder / f"{script.stem}.png", dpi=dpi)


def format_page() -> Iterator[str]:
    """Yield the paragraphs that the page has below its title."""
    for group, names in GROUPS.items():
        yield f"## {group}"
        for name in names:
            title, text, code = split_script(DOCS / "gallery" / f"{name}.py")
            yield f'<a id="{name}"></a>'
            yield f"### {title}"
            yield text
            yield f"![{title}](images/gallery/{name}.png)"
            yield f"```python\n{code}\n```"


def format_front() -> Iterator[str]:
    """Yield the lines of the front page's table of pictures, which lead to the gallery."""
    yield from ("| | | |", "|---|---|---|")
    for start in range(0, len(FRONT), 3):
        cells = []
        for name in FRONT[start : start + 3]:
            title = split_script(DOCS / "gallery" / f"{name}.py")[0]
            cells.append(f"[![{title}](images/gallery/{name}.png)<br>{title}](gallery.md#{name})")
        yield f"| {' | '.join(cells)} |"


def main(names: list[str]) -> None:
    """Make the pictures of all files or of those named."""
    for script in list_scripts():
        if not names or script.stem in names:
            print(make_picture(script).relative_to(DOCS))


if __name__ == "__main__":
    main(sys.argv[1:])
