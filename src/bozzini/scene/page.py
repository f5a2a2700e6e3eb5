"""The standalone page: scripts, style and data of a `View` in one HTML file.

The scripts are ES modules, so that a server can serve each as it is. For one file they are joined:
in the order of `MODULES` each loses its lines ``import … from …;`` (whole statements at the start
of a line) and the word ``export`` at the start of a line, and all stand in one function. So no two
modules may use the same name at their top level. Nothing is loaded: the page's policy allows one
script and one style, by their hashes. The element that holds the viewer holds the parts of
``view.html``, which the scripts find by their classes.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import os
import re
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import get_args

from ..io.files import write_text
from ..views import register_view
from .make_view import Shown, Wall, make_view
from .view import View, encode_view

MODULES = (
    "math.js",
    "scene_data.js",
    "renderer.js",
    "camera.js",
    "charts.js",
    "measure.js",
    "view_page.js",
)
"""The modules of the viewer, each after those it imports."""


@cache
def read_web(name: str) -> str:
    """Return a script, the style or the parts (view.html) of the viewer."""
    return files(__package__).joinpath("web", name).read_text(encoding="utf-8")


@cache
def bundle_scripts(start: str = "startPage();") -> str:
    """Return the modules as one classic script that ends with a statement."""
    parts = []
    for name in MODULES:
        text = re.sub(r"(?ms)^import .*?;\n", "", read_web(name))
        parts.append(re.sub(r"(?m)^export ", "", text))
    return '(() => {\n"use strict";\n' + "\n".join(parts) + f"\n{start}\n}})();\n"


def pack_view(view: View) -> str:
    """Return a view as text for a page: its container, by gzip, in base64."""
    return base64.b64encode(gzip.compress(encode_view(view), 6, mtime=0)).decode("ascii")


def allow_only(scripts: tuple[str, ...], styles: tuple[str, ...]) -> str:
    """Return the policy of a page that loads nothing and runs these texts alone."""
    parts = ["default-src 'none'", "img-src data:", "base-uri 'none'", "form-action 'none'"]
    for name, texts in (("script-src", scripts), ("style-src", styles)):
        hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in texts]
        parts.append(" ".join([name, *(f"'sha256-{value.decode()}'" for value in hashes)]))
    return "; ".join(parts)


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="Bozzini">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main id="viewer">{parts}</main>
<noscript>This page needs JavaScript.</noscript>
<script type="application/octet-stream" id="view">{data}</script>
<script>{script}</script>
</body>
</html>
"""


def render_page(view: View, *, title: str = "") -> str:
    """Return a page that stands alone: the viewer over the whole window.

    Parameters
    ----------
    view : View
    title : str
        Of the page; that of the view unless given.
    """
    style = read_web("view.css") + "html, body { margin: 0; height: 100%; }\n"
    script = bundle_scripts()
    return _PAGE.format(
        policy=allow_only((script,), (style,)),
        title=escape(title or view.title),
        style=style,
        parts=read_web("view.html"),
        data=pack_view(view),
        script=script,
    )


class Page:
    """A page as a notebook shows it: inside the cell, and cut off from the notebook.

    Parameters
    ----------
    view : View
    height : int
        Of the cell [px].
    """

    def __init__(self, view: View, *, height: int = 640) -> None:
        self.view = view
        self.height = height

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{escape(render_page(self.view))}" title="{escape(self.view.title)}" '
            f'sandbox="allow-scripts" width="100%" height="{self.height}" style="border:0">'
            "</iframe>"
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page as one file and return its path.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        return write_text(path, render_page(self.view))


@register_view(*get_args(Shown))
def show(thing: Shown, wall: Wall | None = None) -> Page:
    """Return a page that shows anything that has a shape; see `make_view`.

    Parameters
    ----------
    thing : Plan, tract, duct, robot, shape, end-effector, pose, workspace or points
    wall : tract or duct, optional
        What is round it.

    Raises
    ------
    InputError
        If there is no view of it.
    """
    return Page(make_view(thing, wall))
