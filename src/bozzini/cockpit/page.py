"""The cockpit's page: the parts of the viewer's, with the sections that drive and plan."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
WEB = _PACKAGE / "scene" / "web", _PACKAGE / "cockpit" / "web"
"""Folders of scripts and styles: of the viewer, and of the cockpit. The viewer's package is not
imported: that would take as long as all else until the page is served."""

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Bozzini cockpit</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="/web/view.css">
<link rel="stylesheet" href="/web/cockpit.css">
</head>
<body class="cockpit">
<main id="viewer">{parts}</main>
<p class="waiting" role="status">Connecting…</p>
<p class="banner" role="alert" hidden>The server does not answer: the stick is let go. Trying
again…</p>
<noscript>The cockpit needs JavaScript.</noscript>
<script type="module" src="/web/cockpit.js"></script>
</body>
</html>
"""


def render_cockpit() -> str:
    """Return the page: the cockpit's sections come first in the viewer's panel."""
    viewer, sections = (
        (folder / name).read_text(encoding="utf-8")
        for folder, name in zip(WEB, ("view.html", "cockpit.html"), strict=True)
    )
    before, panel, after = viewer.partition('<section class="charts"')
    return _PAGE.format(parts=before + sections + panel + after)
