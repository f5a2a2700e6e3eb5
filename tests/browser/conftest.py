"""A Chromium for the tests of pages, and what they ask of a page."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    # Not for the whole session: while the driver runs, no other test may run an event loop.
    program = shutil.which("chromium")
    if program is None and not os.environ.get("CI"):
        pytest.skip("no Chromium on this machine")
    with sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=program, args=FLAGS)
        yield found
        found.close()


def wait_for(page, question: str, *, seconds: float = 30.0) -> None:
    """Ask until it is so; `wait_for_function` is not allowed by the pages' policy."""
    end = time.monotonic() + seconds
    while not page.evaluate(question):
        assert time.monotonic() < end, question
        time.sleep(0.02)
