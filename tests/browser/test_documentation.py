"""The built documentation in a browser: what its search finds first, and that no code is cut."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.browser.conftest import wait_for

pytestmark = pytest.mark.slow
SITE = Path(__file__).resolve().parents[2] / "site"

ASKED = {
    "load a ct scan": "guide/anatomy tutorials/1-tract",
    "will my endoscope fit through the colon": "guide/traversability guide/motion",
    "drive with a game controller": "guide/cockpit tutorials/4-rig rig/control guide/effector",
    "export to ROS": "guide/motion guide/physics",
    "how much force presses on the wall": "guide/physics guide/contact",
    "3d print the parts": "guide/fabricate",
    "stiffness of the backbone from measurements": "guide/continuum-fit",
    "pressure needed for a contraction": "guide/muscle tutorials/2-muscle",
    "make a video": "guide/view",
    "how accurate is it": "trust validation",
    "install on windows": "install",
    "import an stl mesh": "guide/anatomy tutorials/1-tract",
    "bronchoscope airways": "guide/trees",
    "train a reinforcement learning agent": "guide/physics",
    "find the best tendon routing": "guide/routing",
    "camera calibration": "guide/vision",
    "run thousands of simulations in parallel": "guide/studies tutorials/5-study",
    "patient breathing during insertion": "guide/moving",
    "what units are used": "cli files",
    "error message exit code": "cli",
    "where do I start": ". install tutorials/1-tract",
    "open a nifti file": "guide/anatomy tutorials/1-tract files",
    "path through the stomach": "guide/motion tutorials/1-tract guide/planner",
    "inverse kinematics of a continuum robot": "guide/continuum tutorials/3-robot",
    "mckibben artificial muscle": "guide/muscle tutorials/2-muscle",
    "matlab": "coming-from",
    "connect an arduino": "rig/boards rig/firmware rig",
    "read an excel file": "files guide/measurements tutorials/2-muscle",
    "backlash of tendons": "guide/hysteresis",
    "shape sensing with fbg": "guide/continuum-fit",
}
"""Questions of newcomers, each with the pages that answer it."""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing of requests."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    if not (SITE / "index.html").exists() and not os.environ.get("CI"):
        pytest.skip("`make docs` has not been run")
    assert (SITE / "search" / "search_index.json").exists()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(SITE)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


HEAR = """
const Plain = window.Worker;
window.Worker = class extends Plain {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({data}) => { if (data?.type === 3) window.found = data.data })
  }
}
"""
"""Keeps what the search has found, as the page is told it."""


def _ask(page: Page, question: str) -> str:
    page.evaluate("window.found = null")
    box = page.locator(".md-search__input")
    box.fill(question)
    box.dispatch_event("keyup")
    wait_for(page, "window.found !== null")
    first = page.evaluate("window.found.items[0]?.[0].location")
    return "nothing" if first is None else first.partition("#")[0].rstrip("/") or "."


def test_a_search_finds_the_page_of_a_question_first(browser: Browser, address: str) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.add_init_script(HEAR)
    page.goto(address)
    page.locator(".md-search__input").click()
    wait_for(page, "document.querySelector('.md-search__input').placeholder === 'Search'")
    answers = {question: _ask(page, question) for question in ASKED}
    page.close()
    wrong = {asked: found for asked, found in answers.items() if found not in ASKED[asked].split()}
    assert len(wrong) <= len(ASKED) // 10, wrong


CUT = """() => [...document.querySelectorAll("pre > code")]
  .filter(e => e.scrollWidth > e.clientWidth + 1 || e.parentElement.scrollWidth > 1280)
  .map(e => e.innerText.slice(0, 80))"""


def test_no_code_is_cut_and_api_pages_begin_with_a_table(browser: Browser, address: str) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.route("**/*.{js,png,gif,svg,mp4}", lambda route: route.abort())
    cut = {}
    for path in sorted(SITE.rglob("index.html")):
        name = path.parent.relative_to(SITE).as_posix()
        page.goto(f"{address}{name}/", wait_until="domcontentloaded")
        if found := page.evaluate(CUT):
            cut[name] = found
        if name.startswith("api/"):
            first = "article h2, article table"
            assert page.evaluate(f"document.querySelector('{first}').tagName") == "TABLE", name
    page.close()
    assert not cut
