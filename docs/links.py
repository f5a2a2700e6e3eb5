"""Hook of mkdocs: links of the tutorials lead to pages, and all links of the site are checked.

A page that is made from a notebook keeps its links as they are written, to the sources of pages;
mkdocs looks neither at those nor at what the hooks and the API reference write.
"""

from __future__ import annotations

import logging
import posixpath
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

LINK = re.compile(r'href="(?!\w+:)([^"#]+\.(?:md|py))(#[^"]*)?"')
LOG = logging.getLogger("mkdocs.hooks.links")


def on_page_content(html: str, *, page: Any, files: Any, **_: Any) -> str:
    """Return a page with its links to sources as links to pages; mkdocs calls this for each."""
    folder = posixpath.dirname(page.file.src_uri)

    def lead(link: re.Match[str]) -> str:
        found = files.get_file_from_path(posixpath.normpath(posixpath.join(folder, link[1])))
        if found is None:
            return link[0]
        return f'href="{found.url_relative_to(page.file)}{link[2] or ""}"'

    return LINK.sub(lead, html)


def on_post_build(*, config: Any, **_: Any) -> None:
    """Warn of every link that leads nowhere, which ends a strict build; mkdocs calls this last."""
    for page, link in find_broken(Path(config["site_dir"])):
        LOG.warning("%s links to '%s', which is not there", page, link)


def find_broken(site: Path) -> list[tuple[str, str]]:
    """Return pages (from the site's root) and their links inside the site that lead nowhere."""
    pages = {path: _Page(path.read_text("utf-8")) for path in sorted(site.rglob("*.html"))}
    return [
        (path.relative_to(site).as_posix(), link)
        for path, page in pages.items()
        for link in page.links
        if not _leads(link, path, pages)
    ]


class _Page(HTMLParser):
    """The links of a page, and what they can lead to in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in ("id", "name"):
                self.places.add(value)
            elif value and name in ("href", "src"):
                self.links.append(value)


def _leads(link: str, path: Path, pages: dict[Path, _Page]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc or parts.path.startswith("/"):
        return True  # of another site, or of the whole of this one (404.html)
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if target.is_dir():
        target /= "index.html"
    place = unquote(parts.fragment)
    return target.exists() and (not place or target not in pages or place in pages[target].places)
