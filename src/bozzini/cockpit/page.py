"""The cockpit's page: its frame of HTML, and where its scripts and styles are."""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).resolve().parent
WEB = (HERE.parent / "scene" / "web", HERE / "web")
"""Folders of scripts and styles: of the viewer, and of the cockpit."""

PAGE = """<!doctype html>
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
<div id="viewer"></div>
<noscript>The cockpit needs JavaScript.</noscript>
<script type="module" src="/web/cockpit.js"></script>
</body>
</html>
"""
