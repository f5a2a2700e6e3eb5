"""The gallery runs as it stands; its page is made of what runs."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread

DOCS = Path(__file__).resolve().parents[1] / "docs"
SCRIPTS = sorted((DOCS / "gallery").glob("*.py"))

_spec = importlib.util.spec_from_file_location("make_gallery", DOCS / "make_gallery.py")
assert _spec is not None and _spec.loader is not None
gallery = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(gallery)


def measure_change(path: Path, other: Path) -> float:
    """Return the largest change of two pictures' grey in blocks of 20 pixels."""
    greys = []
    for file in (path, other):
        grey = imread(file)[..., :3].mean(axis=2)
        high, wide = (side // 20 for side in grey.shape)
        grey = grey[: 20 * high, : 20 * wide]
        greys.append(grey.reshape(high, 20, wide, 20).mean(axis=(1, 3)))
    assert greys[0].shape == greys[1].shape
    return float(np.abs(greys[0] - greys[1]).max())


def test_page_shows_every_file_with_its_code() -> None:
    page = "\n\n".join(gallery.format_page())
    for script in SCRIPTS:
        title, text, code = gallery.split_script(script)
        section = page.partition(f"### {title}\n\n")[2].partition("\n\n<a id=")[0]
        assert section.startswith(f"{text}\n\n![{title}](images/gallery/{script.stem}.png)")
        assert f"```python\n{code}\n```" in section


def test_every_file_is_shown_once_with_its_picture() -> None:
    assert sorted(gallery.list_scripts()) == SCRIPTS
    assert len(SCRIPTS) >= 24
    pictures = {path.stem for path in gallery.PICTURES.glob("*.png")}
    assert pictures == {path.stem for path in SCRIPTS}


def test_the_front_page_shows_twelve() -> None:
    page = "\n".join(gallery.format_front())
    link = r"\[!\[([^]]+)\]\(images/gallery/(\w+)\.png\)<br>\1\]\(gallery\.md#(\w+)\)"
    shown = re.findall(link, page)
    assert len({name for _, name, _ in shown}) == len(shown) == 12
    for title, name, anchor in shown:
        assert gallery.split_script(DOCS / "gallery" / f"{name}.py")[0] == title
        assert anchor == name
    assert "<!-- made: pictures -->" in (DOCS / "index.md").read_text("utf-8")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_examples_have_ten_to_forty_lines(script: Path) -> None:
    title, text, code = gallery.split_script(script)
    assert title and text
    assert code
    assert 10 <= len(script.read_text("utf-8").splitlines()) <= 40


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_pictures_are_made(script: Path, tmp_path: Path) -> None:
    matplotlib.use("Agg")
    path = gallery.make_picture(script, folder=tmp_path)
    pixels = imread(path)
    assert pixels.shape[1] == gallery.WIDTH
    assert np.std(pixels[..., :3]) > 0.02  # something is drawn
    # That which is shown is made by the lines beside it; fonts may differ.
    assert measure_change(path, gallery.PICTURES / path.name) < 0.15
