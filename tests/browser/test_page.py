"""The page in Chromium, from a file and without a network: what it shows and how it is used.

Every picture is a screenshot, so it does not matter how the page draws.
"""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page

from bozzini.report import write_report
from bozzini.scene.make_view import view_plan
from bozzini.scene.page import render_page
from tests.browser.conftest import wait_for
from tests.plot.fake_motion import make_field, make_plan, make_stopped, make_summary

PLAN, FIELD = make_plan(dent=5.25), make_field()
NAMED = "button, input, select, canvas, summary, [role=toolbar], aside"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    (folder / "view.html").write_text(render_page(view_plan(PLAN, FIELD)), encoding="utf-8")
    stopped = view_plan(make_stopped(), FIELD)
    (folder / "stopped.html").write_text(render_page(stopped), encoding="utf-8")
    write_report(folder / "report.html", plan=PLAN, field=FIELD, summary=make_summary(PLAN))
    return folder


@pytest.fixture(scope="module")
def context(browser):
    """One for all pages, which keep nothing: each new one would begin a process."""
    with browser.new_context(offline=True) as context:
        yield context


@pytest.fixture
def visit(context, files):
    """Give what opens a page and returns it once it has painted; nothing may go wrong meanwhile."""
    wrong: list[str] = []
    pages: list[Page] = []

    def visit(name="view.html", *, width=900, height=600, scheme="dark", script=""):
        page = context.new_page()
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=scheme)
        pages.append(page)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda words: wrong.append(words.text) if words.type == "error" else 0)
        page.on("request", lambda request: wrong.append(request.url) if _goes_out(request) else 0)
        if script:
            page.add_init_script(script)
        page.goto((files / name).as_uri())
        wait_for(page, "() => window.viewer && viewer.paints > 0")
        return page

    yield visit
    for page in pages:
        page.close()
    assert not wrong


def _goes_out(request) -> bool:
    return not request.url.startswith(("file:", "data:", "blob:"))


def settle(page):
    page.evaluate("() => new Promise(d => requestAnimationFrame(() => requestAnimationFrame(d)))")


def take(page, selector=".stage > canvas"):
    """Return the picture of an element as numbers."""
    settle(page)
    image = Image.open(io.BytesIO(page.locator(selector).screenshot())).convert("RGB")
    picture = np.asarray(image, dtype=float)
    # Of the stage the part without controls, which change when they have the focus.
    return picture[90:-70, 20 : int(0.6 * picture.shape[1])] if "canvas" in selector else picture


def share_changed(one, other):
    return (np.abs(one - other).max(axis=-1) > 12).mean()


def get_step(page):
    return page.evaluate("() => viewer.frame.step")


@pytest.mark.slow
def test_the_page_decodes_what_was_encoded(visit):
    page = visit()
    for step in (0, 17, PLAN.steps - 1):
        page.evaluate("step => viewer.seek(step)", step)
        joints = page.evaluate("() => Array.from(viewer.frame.joints)")
        np.testing.assert_allclose(np.reshape(joints, (-1, 3)), PLAN.joints[step], atol=0.012)
        clearance = page.evaluate("() => Array.from(viewer.frame.clearance)")
        known = np.isfinite(PLAN.clearance[step])
        assert [value == value for value in clearance] == known.tolist()
        np.testing.assert_allclose(
            np.array(clearance)[known], PLAN.clearance[step][known], atol=0.006
        )
    wall = page.evaluate("() => Array.from(viewer.data.surfaces.at(-1).vertices)")
    assert np.abs(FIELD.signed_distance(np.reshape(wall, (-1, 3)))).max() < 0.3


@pytest.mark.slow
def test_it_begins_at_the_tightest_place_and_shows_something(visit):
    page = visit()
    least = PLAN.clearance.min(axis=1)
    assert least[get_step(page)] == least.min()
    assert "\u22121.25 mm" in page.locator(".readout").inner_text()
    picture = take(page)
    assert picture.std() > 8.0
    page.keyboard.press("Home")
    assert get_step(page) == 0 and share_changed(picture, take(page)) > 0.002
    page.keyboard.press("n")
    assert share_changed(picture, take(page)) < 0.001


def test_slider_keys_and_charts_show_one_step(visit):
    page = visit()
    slider, cursor = page.locator(".timeline input"), page.locator(".cursor").first
    page.keyboard.press("End")
    assert get_step(page) == PLAN.steps - 1 == int(slider.input_value())
    right = cursor.bounding_box()["x"]
    page.keyboard.press(",")
    assert get_step(page) == PLAN.steps - 2 and cursor.bounding_box()["x"] < right
    slider.focus()
    page.keyboard.press("ArrowLeft")
    assert get_step(page) == PLAN.steps - 3
    chart = page.locator("figure canvas").first
    box = chart.bounding_box()
    chart.click(position={"x": 0.5 * box["width"], "y": 40})
    assert abs(get_step(page) - PLAN.steps / 2) < 0.1 * PLAN.steps
    inside = cursor.bounding_box()["x"] - box["x"]
    assert inside == pytest.approx(0.5 * box["width"], abs=0.04 * box["width"])


def test_it_plays_and_pauses(visit):
    page = visit()
    page.keyboard.press("Home")
    page.locator(".timeline select").select_option("4")
    page.get_by_role("button", name="Play").click()
    wait_for(page, "() => viewer.frame.step > 2")
    page.get_by_role("button", name="Pause").click()
    here = get_step(page)
    settle(page)
    assert get_step(page) == here
    page.keyboard.press("End")
    page.locator(".stage > canvas").focus()
    page.keyboard.press(" ")  # from the end it begins again
    wait_for(page, f"() => viewer.frame.step < {PLAN.steps - 5}")
    page.keyboard.press(" ")


@pytest.mark.slow
def test_the_picture_turns_zooms_and_comes_back(visit):
    page = visit()
    page.keyboard.press("3")
    page.wait_for_timeout(500)
    first = take(page)
    box = page.locator(".stage > canvas").bounding_box()
    x, y = box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 150, y + 60, steps=3)
    page.mouse.up()
    turned = take(page)
    assert share_changed(first, turned) > 0.01
    page.mouse.wheel(0, -400)
    assert share_changed(turned, take(page)) > 0.01
    page.keyboard.press("3")
    page.wait_for_timeout(500)
    assert share_changed(first, take(page)) < 0.002


@pytest.mark.slow
def test_the_tip_sees_the_wall_small_and_large(visit):
    page = visit()
    page.evaluate("() => viewer.seek(20)")
    small = take(page, "button.inset")
    assert small[8:-30, 8:-8].std() > 8.0
    outside = take(page)
    page.locator("button.inset").click()
    large = take(page)
    assert share_changed(outside, large) > 0.3 and large.std() > 8.0
    page.keyboard.press("t")
    assert share_changed(outside, take(page)) < 0.002


def test_measuring_a_round_tube_gives_its_radius_and_lengths(visit):
    page = visit()
    page.evaluate("() => viewer.seek(0)")
    page.get_by_role("button", name="Measure").click()
    box = page.locator(".stage > canvas").bounding_box()
    for share in (0.55, 0.72):
        page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + share * box["height"])
    words = page.locator(".measured").inner_text().split("\n")
    pairs = zip(words[::2], words[1::2], strict=True)
    found = {name: float(value.split()[0]) for name, value in pairs}
    assert found["Radius at A"] == pytest.approx(6.0, abs=0.5)
    assert found["Radius at B"] == pytest.approx(6.0, abs=0.5)
    # The tube is straight: along its middle it is as far as straight on.
    assert found["Arc length A to B"] == pytest.approx(found["Distance A to B"], rel=0.05)
    gap = abs(found["Arc length of A"] - found["Arc length of B"])
    assert gap == pytest.approx(found["Arc length A to B"], abs=0.11)
    page.keyboard.press("Escape")
    assert page.locator(".measured").inner_text() == ""


def test_measuring_works_by_keys(visit):
    page = visit()
    page.keyboard.press("m")
    page.locator(".stage > canvas").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    assert "Distance A to B" in page.locator(".measured").inner_text()
    assert "Distance A to B" in page.locator(".said").inner_text()


@pytest.mark.slow
def test_a_section_opens_the_wall_and_closes_again(visit):
    page = visit()
    whole = take(page)
    page.get_by_label("Section", exact=True).select_option(label="without front")
    cut = take(page)
    assert share_changed(whole, cut) > 0.005
    page.get_by_label("Place of the section").fill("0.9")
    assert share_changed(cut, take(page)) > 0.002
    page.keyboard.press("Escape")
    page.get_by_label("Section", exact=True).select_option(label="none")
    assert share_changed(whole, take(page)) < 0.001


@pytest.mark.slow
def test_a_link_is_found_from_its_bar_and_a_place_from_its_button(visit):
    page = visit("stopped.html")
    page.evaluate(f"() => viewer.seek({PLAN.steps - 1})")
    chart = page.locator("figure canvas").last
    box = chart.bounding_box()
    chart.click(position={"x": 38 + 0.05 * (box["width"] - 46), "y": 40})
    assert page.locator(".said").inner_text().startswith("Link 1 from the head: clearance")
    before = take(page)
    page.get_by_role("button", name=re.compile("refused at 70 mm")).click()
    page.wait_for_timeout(500)
    assert share_changed(before, take(page)) > 0.01


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_words_stand_out_and_everything_has_a_name(visit, scheme):
    page = visit(scheme=scheme)
    nameless = page.evaluate(
        """named => [...document.querySelectorAll(named)].filter(e => e.offsetParent && !(
            e.ariaLabel || e.getAttribute("aria-label") || e.title || e.textContent.trim() ||
            e.labels?.[0]?.textContent.trim())).map(e => e.outerHTML)""",
        NAMED,
    )
    assert nameless == []
    assert page.evaluate(
        "() => [...document.querySelectorAll('[tabindex]')].every(e => e.tabIndex <= 0)"
    )
    low = page.evaluate(
        """() => {
            const light = text => text.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)
                .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
                .reduce((s, v, i) => s + v * [0.2126, 0.7152, 0.0722][i], 0);
            const ground = e => { for (; e; e = e.parentElement) {
                const c = getComputedStyle(e).backgroundColor, a = c.match(/[\\d.]+/g)[3];
                if (a === undefined || a > 0.7) return c; } };
            return [...document.querySelectorAll(
                ".panel p, h3, figcaption, dt, dd, label, button, option, .readout span, summary")]
                .filter(e => e.offsetParent && e.textContent.trim() && !e.matches(".inset"))
                .map(e => [light(getComputedStyle(e).color), light(ground(e)), e.textContent])
                .filter(([a, b]) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) < 4.5)
                .map(row => row[2]);
        }"""
    )
    assert low == []
    # The tabulator goes through the page in the order in which it is read.
    page.locator(".stage > canvas").focus()
    seen = []
    for _ in range(12):
        page.keyboard.press("Tab")
        seen.append(
            page.evaluate(
                """() => [...document.querySelectorAll("*")].indexOf(document.activeElement)"""
            )
        )
    assert seen == sorted(seen) and len(set(seen)) == len(seen)


def test_light_and_dark_by_a_key(visit):
    page = visit(scheme="light")
    light = take(page)
    page.keyboard.press("b")
    dark = take(page)
    assert light.mean() > 150 > 80 > dark.mean()


def test_a_narrow_window_has_no_side_scroll_and_keeps_everything(visit):
    page = visit(width=420, height=800)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 420
    for name in ("Measure", "Play", "Fit"):
        box = page.get_by_role("button", name=name).first.bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 420 and box["height"] >= 24


def test_without_webgl_the_page_says_so_and_goes_on(visit):
    script = """const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, more) {
            return kind === "webgl2" ? null : get.call(this, kind, more); };"""
    page = visit(script=script)
    assert "no WebGL 2" in page.locator(".trouble").inner_text()
    page.keyboard.press("Home")
    assert get_step(page) == 0 and "step 1 of" in page.locator(".readout").inner_text()


@pytest.mark.slow
def test_a_lost_context_is_told_and_the_picture_comes_back(visit):
    page = visit()
    picture = take(page)
    page.evaluate(
        """() => { window.lost = document.querySelector(".stage > canvas").getContext("webgl2")
            .getExtension("WEBGL_lose_context"); lost.loseContext(); }"""
    )
    wait_for(page, "() => !document.querySelector('.trouble').hidden")
    page.keyboard.press("Home")
    page.keyboard.press("n")
    page.evaluate("() => lost.restoreContext()")
    wait_for(page, "() => document.querySelector('.trouble').hidden")
    assert share_changed(picture, take(page)) < 0.002


@pytest.mark.slow
def test_the_report_turns_and_prints_on_two_pages(visit):
    page = visit("report.html")
    page.locator("#viewer").scroll_into_view_if_needed()
    assert take(page).std() > 8.0
    page.locator(".stage > canvas").focus()
    page.keyboard.press("Home")
    assert get_step(page) == 0
    paper = page.pdf(format="A4", print_background=True)
    assert len(re.findall(rb"/Type\s*/Page\b", paper)) == 2


@pytest.mark.parametrize(("width", "height"), [(1000, 640), (820, 500), (420, 800)])
def test_what_is_over_the_picture_does_not_overlap(visit, width, height):
    page = visit(width=width, height=height)
    boxes = [page.locator(name).bounding_box() for name in (".head", ".tools", "button.inset")]
    for k, one in enumerate(boxes):
        for other in boxes[:k]:
            across = one["x"] < other["x"] + other["width"] and other["x"] < one["x"] + one["width"]
            along = (
                one["y"] < other["y"] + other["height"] and other["y"] < one["y"] + one["height"]
            )
            assert not (across and along)
