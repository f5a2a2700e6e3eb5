"""The cockpit in Chromium: what its page shows, and what its stick does to an emulated rig."""

from __future__ import annotations

import asyncio
import io
import json
import math
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from bozzini.cockpit.drive import EffectorDrive
from bozzini.cockpit.guard import Access
from bozzini.cockpit.head import HeadDrive
from bozzini.cockpit.page import WEB, render_cockpit
from bozzini.cockpit.planning import put_into_words
from bozzini.cockpit.server import bind, make_server, run_server
from bozzini.cockpit.session import Session
from bozzini.effector import Effector
from bozzini.head import Head, PlacedEffector, list_touches, stand_head
from bozzini.head.operate import TargetTask, look_from_tip
from bozzini.rig.firmware import find_missing_tools
from bozzini.scene.view import Body, Surface, View, encode_view
from tests.browser.conftest import wait_for
from tests.cli.plan_cases import write_tracts
from tests.cockpit.conftest import make_plan
from tests.head.test_reach import SHIFT, make_tube

READY = "() => window.cockpit?.viewer?.paints > 0 && document.querySelector('.drive:not([hidden])')"
# Words of a plan come before what is drawn of it: until then there is no step to go to.
PLANNED = (
    f"{READY} && cockpit.status?.plan && !cockpit.status.planning.busy"
    " && cockpit.viewer.data.steps > 1"
)
FIRST_PAINT, RECONNECTION = 9.0, 15.0
"""Three times what a computer with nothing else to do may take [s]."""


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> Iterator[str]:
    """Give the address of a cockpit with an emulated rig, in a small tract."""
    if missing := find_missing_tools():
        pytest.skip(f"no {', '.join(missing)}")
    tract = write_tracts(tmp_path_factory.mktemp("tract")).surface
    size = ("--diameter", "5mm", "--link", "8mm", "--rig", "demo", "--board", "native")
    command = [sys.executable, "-m", "bozzini", "cockpit", str(tract), "--port", "0", *size]
    with subprocess.Popen([*command, "--no-browser"], stdout=-1, text=True) as process:
        yield process.stdout.readline().strip()
        process.terminate()


@pytest.fixture
def visit(browser):
    """Give what opens a cockpit; no error, and no request to elsewhere, may come meanwhile."""
    wrong: list[str] = []
    pages = []

    def visit(address, *, width=800, height=440, scheme="light", script=""):
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        pages.append(page)
        host = address.split("/")[2]
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda m: wrong.append(m.text) if "Error:" in m.text else None)
        page.on("request", lambda request: wrong.append(request.url) if host not in request.url
                and not request.url.startswith("data:") else None)  # fmt: skip
        if script:
            page.add_init_script(script)
        page.goto(address)
        return page

    yield visit
    for page in pages:
        page.close()
    assert not wrong


def read_state(page) -> dict:
    return json.loads(page.evaluate("() => fetch('/state').then((answer) => answer.text())"))


def wait_until(page, is_so, *, seconds=20.0) -> dict:
    end = time.monotonic() + seconds
    while not is_so(state := read_state(page)):
        assert time.monotonic() < end, state
        time.sleep(0.02)
    return state


def look(page, selector) -> np.ndarray:
    picture = page.locator(selector).first.screenshot()
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), dtype=float)


def find_pad(page) -> tuple[float, float, float]:
    """Return the middle of the pad and its full travel, in pixels."""
    page.locator(".pad").scroll_into_view_if_needed()
    box = page.locator(".pad").bounding_box()
    half = 0.5 * box["width"]
    return box["x"] + half, box["y"] + half, half / 1.12


def seek(page, step) -> None:
    page.evaluate(
        "(step) => { const s = document.querySelector('.timeline input'); s.value = step;"
        "s.dispatchEvent(new Event('input')); }",
        step,
    )


def test_page_paints_soon_and_shows_scope_and_tip_camera(visit, address) -> None:
    begin = time.monotonic()
    page = visit(address)
    assert "token" not in page.url
    wait_for(page, "() => document.body.innerText.length > 0")
    assert time.monotonic() - begin < FIRST_PAINT
    wait_for(page, PLANNED, seconds=60.0)
    steps = read_state(page)["steps"]
    seek(page, steps // 2)
    wait_until(page, lambda state: state["step"] == steps // 2)
    wait_for(page, f"() => cockpit.frame.step === {steps // 2}")
    before = look(page, ".stage")
    assert before.std() > 8.0
    assert look(page, ".inset").std() > 8.0
    seek(page, steps - 1)
    wait_for(page, f"() => cockpit.frame.step === {steps - 1}")
    page.wait_for_timeout(300)
    assert (np.abs(look(page, ".stage") - before).max(axis=2) > 20.0).mean() > 0.002
    assert "Fits" in page.locator(".verdict").inner_text()


@pytest.mark.slow
def test_two_windows_are_in_step_and_the_head_plays(visit, address) -> None:
    first, second = visit(address), visit(address, width=420, scheme="dark")
    for page in (first, second):
        wait_for(page, PLANNED)
    seek(first, 3)
    for page in (first, second):
        wait_for(page, "() => cockpit.frame.step === 3")
    second.locator(".play").click()
    wait_for(first, "() => cockpit.frame.playing && cockpit.frame.step > 5")
    first.locator(".play").click()
    wait_for(second, "() => !cockpit.frame.playing")
    end = read_state(first)["step"]
    for page in (first, second):
        wait_for(page, f"() => cockpit.frame.step === {end}")


@pytest.mark.slow
def test_controller_is_chosen_on_the_page_while_disarmed(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    wait_until(page, lambda state: state["rig"] == "DISARMED")
    chosen = page.get_by_label("Controller")
    assert chosen.input_value() == "static"
    chosen.select_option("predictive")
    wait_until(page, lambda state: state["controller"] == "predictive")
    page.get_by_role("button", name="Arm", exact=True).click()
    wait_until(page, lambda state: state["rig"] == "ARMED")
    wait_for(page, "() => document.querySelector('.drive select').disabled")
    page.keyboard.press("Escape")
    wait_until(page, lambda state: state["rig"] == "DISARMED")
    wait_for(page, "() => !document.querySelector('.drive select').disabled")
    chosen.select_option("static")
    wait_until(page, lambda state: state["controller"] == "static")


@pytest.mark.slow
def test_stick_of_the_page_drives_the_rig(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    wait_until(page, lambda state: state["rig"] == "DISARMED")
    x, y, full = find_pad(page)
    page.get_by_role("button", name="Arm", exact=True).click()
    wait_until(page, lambda state: state["rig"] == "ARMED")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.3 * full, y)
    state = wait_until(page, lambda state: state["stick"][0] > 0.25)
    assert state["stick"] == pytest.approx([0.3, 0.0], abs=0.02)
    wait_until(page, lambda state: math.dist(state["tip_mm"], state["target_mm"]) < 0.6)
    wait_for(page, "() => [...document.querySelectorAll('.bar i')].some((b) => b.offsetWidth > 9)")
    page.mouse.move(x + 0.9 * full, y)
    state = wait_until(page, lambda state: not state["reached"])
    wait_for(page, "() => document.querySelector('.why').textContent.includes('Saturated')")
    assert math.hypot(*state["delivered_mm"]) < math.hypot(*state["target_mm"])
    page.mouse.up()
    wait_until(page, lambda state: max(state["setpoints_MPa"]) == 0.0)
    wait_until(page, lambda state: max(state["pressures_MPa"]) < 0.03)
    page.keyboard.press("Escape")
    wait_until(page, lambda state: state["rig"] == "DISARMED")


@pytest.mark.slow
def test_keys_and_blur(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    page.locator(".pad").focus()
    page.keyboard.down("ArrowUp")
    wait_until(page, lambda state: state["stick"][1] > 0.3)
    page.keyboard.up("ArrowUp")
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])
    page.keyboard.down("a")
    wait_until(page, lambda state: state["stick"][0] < -0.3)
    page.evaluate("() => window.dispatchEvent(new Event('blur'))")
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])
    page.keyboard.up("a")
    page.keyboard.down("d")
    wait_until(page, lambda state: state["stick"][0] > 0.3)
    page.close()  # a window that goes away lets go
    page = visit(address)
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])


def test_gamepad(visit, address) -> None:
    stub = """
      window.axes = [0, 0];
      document.hasFocus = () => true;
      navigator.getGamepads = () => [null, {connected: true, axes: window.axes, buttons: []}];
    """
    page = visit(address, script=stub)
    wait_for(page, PLANNED)
    for axes, wanted in (([0.05, -0.05], [0, 0]), ([0, -1], [0, 1]), ([0.56, 0], [0.5, 0])):
        page.evaluate("(axes) => (window.axes = axes)", axes)
        wait_until(page, lambda state, w=wanted: np.allclose(state["stick"], w, atol=1e-6))
    page.evaluate("() => (window.axes = [0, 0])")
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])


@pytest.mark.slow
def test_plan_is_made_anew_in_the_page(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    views = read_state(page)["view"]
    size = page.locator(".planning").get_by_label("Diameter")
    for value, words in (("6", "Fits"), ("17", "oes not fit")):
        size.fill(value)
        size.press("Enter")
        wait_for(page, f"() => document.querySelector('.verdict').textContent.includes('{words}')")
    assert "needs" in page.locator(".verdict").inner_text()
    offer = page.get_by_role("button", name=re.compile("fits")).first
    offer.wait_for()
    assert "Diameter" in offer.inner_text()
    offer.click()
    wait_for(page, "() => document.querySelector('.verdict').textContent.includes('Fits')")
    assert read_state(page)["view"] > views
    wait_for(page, "() => cockpit.viewer.frames > 0 && cockpit.frame.links > 0")


def is_settled(state) -> bool:
    return not state["planning"]["busy"]


@pytest.mark.slow
def test_ends_are_moved_by_clicks_on_the_wall_and_by_keys(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    button = page.get_by_role("button", name="Move the end")
    box, before = page.locator(".stage > canvas").bounding_box(), read_state(page)["plan"]
    seen = [before["goal_mm"]]
    # The scope, which is seen through the wall, is not in the way, nor is a place beside the wall.
    for x, y in [(0.02, 0.5), *((x, y) for x in (0.22, 0.4, 0.5) for y in (0.3, 0.5, 0.7))]:
        if button.get_attribute("aria-pressed") == "false":
            button.click()
        asked = read_state(page)["planning"]["asked"]
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        if button.get_attribute("aria-pressed") == "true":
            assert "no wall" in page.locator(".said").inner_text()
            continue
        state = wait_until(
            page, lambda s, n=asked: s["planning"]["asked"] > n and is_settled(s), seconds=60.0
        )
        # Beside the start there is no way to go, and that is said.
        assert "same point" in (state["planning"]["message"] or "same point")
        assert state["plan"]["entry_mm"] == before["entry_mm"]
        seen.append(state["plan"]["goal_mm"])
    assert len({tuple(goal) for goal in seen}) > 2
    # By keys: the cross is in the middle of the picture.
    page.keyboard.press("Escape")
    assert button.get_attribute("aria-pressed") == "false"
    button.focus()
    page.keyboard.press("Enter")
    wait_for(page, "() => getComputedStyle(document.querySelector('.cross')).display === 'block'")
    asked = read_state(page)["planning"]["asked"]
    for _ in range(12):
        page.keyboard.press("Shift+ArrowRight")
        page.keyboard.press("Enter")
        if button.get_attribute("aria-pressed") == "false":
            break
    state = wait_until(page, lambda s: s["planning"]["asked"] > asked and is_settled(s), seconds=60)
    assert "same point" in (state["planning"]["message"] or "same point")
    page.wait_for_timeout(100)
    assert not page.locator(".cross").is_visible()


@pytest.mark.slow
def test_size_that_is_refused_is_not_shown_as_in_force(visit, address) -> None:
    page = visit(address)
    wait_for(page, PLANNED)
    size, line = page.locator(".planning").get_by_label("Link"), page.locator(".busy")
    value = size.input_value()
    for _ in range(2):  # the second time nothing else changes
        size.fill("5000")
        assert size.input_value() == "5000"
        size.press("Enter")
        wait_for(page, "() => document.querySelector('.busy').textContent.includes('5000')")
        wait_for(page, f"() => document.querySelector('[name=link]').value === '{value}'")
    # What is out of range for any plan is the planning's business, too, not the drive's.
    page.evaluate("() => (document.querySelector('[name=link]').max = '')")
    size.fill("20000")
    size.press("Enter")
    wait_for(page, "() => document.querySelector('.busy').textContent.includes('20000')")
    wait_for(page, f"() => document.querySelector('[name=link]').value === '{value}'")
    assert "20000" not in page.locator(".drive").inner_text()
    size.fill("7")
    size.press("Enter")
    wait_for(page, f"{PLANNED} && cockpit.status.plan.link_mm === 7")
    wait_for(page, "() => !document.querySelector('.busy').textContent")
    assert not line.is_visible() and size.input_value() == "7"
    # What is typed and not confirmed stays while it is typed, and goes with the focus.
    size.fill("6")
    page.evaluate("() => cockpit.viewer.say('')")
    assert size.input_value() == "6"
    page.evaluate("() => (document.querySelector('[name=link]').onchange = null)")
    size.blur()
    assert size.input_value() == "7"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_names_contrast_and_width(visit, address, scheme) -> None:
    page = visit(address, width=420, scheme=scheme)
    wait_for(page, PLANNED)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 420
    nameless = page.evaluate("""() => [...document.querySelectorAll(
      '.drive button, .planning button, .planning input, .pad')].filter((item) =>
        !(item.getAttribute('aria-label') || item.closest('label')?.textContent.trim()
          || item.textContent.trim())).length""")
    assert nameless == 0
    poor = page.evaluate("""() => {
      const light = (text) => { const c = text.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255)
        .map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
        return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
      const paper = light(getComputedStyle(document.getElementById('viewer')).backgroundColor);
      return [...document.querySelectorAll('.drive p, .drive b, .drive td, .drive th, .planning p,'
        + '.planning label')].filter((item) => item.textContent.trim()).map((item) => {
          const ink = light(getComputedStyle(item).color);
          const ratio = (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
          return ratio < 4.5 ? item.textContent.slice(0, 40) + ratio : ''; }).filter(Boolean);
    }""")
    assert poor == []
    order = page.evaluate("""() => [...document.querySelectorAll('.pad, .sizes input')]
      .map((item) => item.tabIndex)""")
    assert set(order) == {0}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["line", "circle"])
def test_figure_is_drawn_with_the_stick_of_the_page(visit, address, kind) -> None:
    """Page, inverse kinematics, emulated rig, forward kinematics: the tip draws the figure."""
    page = visit(address)
    wait_for(page, PLANNED)
    scale = page.evaluate("() => fetch('/info.json').then((answer) => answer.json())")["drive"][
        "full_stick_mm"
    ]
    # The picture is not drawn: where a program draws it, the page has no time for the stick.
    page.evaluate("() => (document.querySelector('.stage').hidden = true)")
    x, y, full = find_pad(page)
    page.get_by_role("button", name="Arm", exact=True).click()
    wait_until(page, lambda state: state["rig"] == "ARMED")
    radius, turns = 6.0, 60
    tips, wanted = [], []
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(turns + 1):
        angle = 2.0 * math.pi * k / turns
        goal = radius * np.array([math.cos(angle), math.sin(angle) if kind == "circle" else 0.0])
        page.mouse.move(x + goal[0] / scale * full, y - goal[1] / scale * full)
        page.wait_for_timeout(150 if k else 1500)
        tips.append(read_state(page)["tip_mm"])
        wanted.append(goal * [-1.0, 1.0])  # the model's +x is the camera's left
    page.mouse.up()
    page.get_by_role("button", name="Disarm").click()
    wait_until(page, lambda state: state["rig"] == "DISARMED")
    error = np.linalg.norm(np.array(tips) - wanted, axis=1)
    assert np.sqrt((error**2).mean()) < 0.5
    assert np.array(tips)[:, 0].min() < -0.9 * radius and np.array(tips)[:, 0].max() > 0.9 * radius


class Running:
    """A cockpit without rig, planning or token, that can be stopped and begun again."""

    def __init__(self) -> None:
        self.session = Session()
        self.session.drive = EffectorDrive(Effector.from_preset("prototype"))
        plan = make_plan()
        wall = Surface(
            vertices=9.0 * np.array([[1.0, 0, -1], [-1, 1, 0], [-1, -1, 0], [0, 0, 4]]),
            faces=np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]),
        )
        body = Body(joints=plan.joints.astype(float), radius=plan.radius)
        view = View(title="a tetrahedron", surfaces=(wall,), bodies=(body,))
        info = {"status": "complete", "certified": True, "proved_mm": 1.0, "reason": ""}
        info |= {"would_fit_mm": {}, "inserted_mm": 40.0, "seconds": 0.1, "robot": None}
        info |= {"diameter_mm": 4.0, "link_mm": 10.0, "inflate_mm": 0.0, "inflate_most_mm": 0.0}
        info |= put_into_words({**info, "verdict": {}})
        self.session.show(replace(plan, view=encode_view(view), info=info))
        self.session.planning = {"busy": False, "stage": "", "message": ""}
        self.port = 0

    def start(self) -> None:
        listener = bind("127.0.0.1", self.port)
        self.port = listener.getsockname()[1]
        self.server = make_server(
            self.session, Access(port=self.port), page=render_cockpit(), folders=WEB
        )
        ready = threading.Event()
        run = run_server(self.server, listener, session=self.session, when_ready=ready.set)
        self.thread = threading.Thread(target=lambda: asyncio.run(run), daemon=True)
        self.thread.start()
        assert ready.wait(10)

    def stop(self) -> None:
        self.server.should_exit = True
        self.thread.join(10)


@pytest.mark.slow
def test_form_of_a_task_gives_what_its_command_gives(visit, address) -> None:
    page = visit(address)
    wait_for(page, "() => document.querySelector('.tasks:not([hidden])')")
    page.locator(".tasks summary").click()
    for name, value in (("height", "2.8mm"), ("diameter", "1.6mm"), ("ring", "-2mm")):
        page.locator(f".tasks [name={name}]").fill(value)
    run, told = page.get_by_role("button", name="Run", exact=True), page.locator(".tasks")
    run.click()
    wait_for(page, "() => document.querySelector('.tasks').innerText.includes('ring is -2 mm')")
    page.locator(".tasks [name=ring]").fill("2mm")
    run.click()
    wait_for(page, "() => document.querySelector('.tasks').innerText.includes('u_mm')")
    words = "vision plan-setup --height=2.8mm --diameter=1.6mm --ring=2mm"
    assert f"bozzini {words}" in told.inner_text()
    command = [sys.executable, "-m", "bozzini", *words.split(), "--json"]
    found = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    assert f"u_mm\t{found['u_mm']:.6g}" in told.inner_text()


def test_own_scripts_are_small() -> None:
    assert sum(file.stat().st_size for folder in WEB for file in folder.glob("*.js")) <= 68_000


@pytest.mark.slow
def test_page_connects_again(visit) -> None:
    running = Running()
    running.start()
    try:
        page = visit(f"http://127.0.0.1:{running.port}/")
        wait_for(page, f"{READY} && document.querySelector('.tasks:not([hidden])')")
        running.stop()
        wait_for(page, "() => !document.querySelector('.banner').hidden")
        running.start()
        begin = time.monotonic()
        wait_for(page, "() => cockpit.connections > 1 && document.querySelector('.banner').hidden")
        assert time.monotonic() - begin < RECONNECTION
        running.session.go_to(7)
        wait_for(page, "() => cockpit.frame.step === 7")
        # Another server, which has nothing to show yet, does not leave the plan before on the page.
        assert page.locator(".verdict").inner_text().startswith("Fits")
        running.stop()
        running.session = Session()
        running.start()
        page.get_by_text("Reading the tract: starting").wait_for()
        assert page.locator(".verdict").inner_text() == ""
    finally:
        running.stop()


class HeadRunning(Running):
    """A head in a round tube of 40 mm radius, without planning."""

    def __init__(self, head: Head) -> None:
        super().__init__()
        duct, plan = make_tube()
        self.drive = self.session.drive = HeadDrive(head, targets=2)
        angle, along = np.meshgrid(2.0 * math.pi * np.arange(48) / 48, np.linspace(0.0, 200.0, 41))
        rings = [40.0 * np.cos(angle), 40.0 * np.sin(angle), along]
        tube = np.stack(rings, axis=-1).reshape(-1, 3) + SHIFT
        i = np.arange(40 * 48)
        j, up = i - i % 48 + (i + 1) % 48, i + 48
        faces = np.concatenate([np.stack([i, j, up]).T, np.stack([j, j + 48, up]).T])
        view = View(
            title="a tube",
            surfaces=(Surface(vertices=tube, faces=faces),),
            bodies=(
                Body(
                    joints=plan.joints,
                    radius=6.0,
                    clearance=plan.clearance,
                    insertion=plan.head_arc_length,
                ),
            ),
        )
        shown = replace(
            self.session.plan,
            view=encode_view(view),
            joints=plan.joints.astype(np.float32),
            clearance=plan.clearance.astype(np.float32),
            travel=plan.head_arc_length,
            radius=6.0,
            wall=duct,
        )
        self.session.show(shown)
        self.session.go_to(10)


@pytest.fixture
def head(visit, request):
    running = HeadRunning(getattr(request, "param", Head()))
    running.start()
    page = visit(f"http://127.0.0.1:{running.port}/", width=1100, height=560)
    wait_for(page, f"{READY} && cockpit.head && cockpit.frame.links > 0")
    yield running, page
    running.stop()


COVERED = """() => {
  const label = '.stage h2, .readout span, .legend span, .legend i';
  const button = '.tools button, :not(.twin) > .stage > .inset';
  const boxes = (what) => [...document.querySelectorAll(what)]
    .map((item) => [item.textContent || item.className, item.getBoundingClientRect()])
    .filter(([, box]) => box.width);
  return boxes(label).flatMap(([words, a]) => boxes(button).filter(([, b]) =>
    a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1
  ).map(([name]) => [words, name])); }"""


def test_first_minutes_typing_before_the_plan_keys_and_labels(visit) -> None:
    running = HeadRunning(Head())
    session, shown, asked = running.session, running.session.plan, []
    session.plan, session.ask_plan = None, asked.append
    session.planning = {"busy": True, "stage": "plan", "message": ""}
    running.start()
    try:
        page = visit(f"http://127.0.0.1:{running.port}/", width=500, height=700)
        wait_for(page, f"{READY} && cockpit.head")
        page.evaluate("() => (document.querySelector('.stage').hidden = true)")
        size = page.locator(".planning [name=diameter]")
        size.fill("6")
        size.press("Enter")
        wait_until(page, lambda state: state["planning"]["asked"] == 1)
        session.show(shown)
        session.planning = {"busy": True, "stage": "plan", "message": ""}
        wait_for(page, "() => document.querySelector('.verdict').textContent")
        assert size.input_value() == "6" and [one.diameter for one in asked] == [6.0]
        session.planning = {"busy": False, "stage": "", "message": ""}
        wait_for(page, "() => document.querySelector('[name=diameter]').value === '4'")
        # R goes on and F back while they are held.
        wait_for(page, "() => document.querySelector('.gap').textContent.includes('Tip clearance')")
        page.locator(".pad").focus()
        for key, is_there in (("r", lambda state: state["step"] > 13),
                              ("f", lambda state: state["step"] < 7)):  # fmt: skip
            page.keyboard.down(key)
            wait_until(page, is_there)
            page.keyboard.up(key)
        assert read_state(page)["stick"] == [0.0, 0.0]
        page.evaluate("() => (document.querySelector('.stage').hidden = false)")
        for is_twin in (True, False):
            page.evaluate("(on) => document.querySelector('#viewer').classList.toggle('twin', on)",
                          is_twin)  # fmt: skip
            for width in (420, 500, 761, 961, 1100):
                page.set_viewport_size({"width": width, "height": 700})
                assert page.evaluate(COVERED) == [], (is_twin, width)
    finally:
        running.stop()


def look_at_head(page) -> np.ndarray:
    """Return the picture of the head's camera once all is drawn, without the words over it."""
    page.wait_for_timeout(600)
    return look(page, ".inset")[4:-40, 4:-6]


def mask_bodies(drive, pose, picture) -> np.ndarray:
    """Return where end-effector and instrument are in the still camera's picture, by geometry."""
    height, width = picture.shape[0] + 44, picture.shape[1] + 10
    camera = drive.head.look(min(height, width))
    rows, columns = np.mgrid[4 : height - 40, 4 : width - 6]
    shift = 0.5 * (np.array([width, height]) - min(height, width))
    mask = np.zeros(picture.shape[:2], dtype=bool)
    for part in drive.list_parts([pose])[2:]:
        share = np.linspace(0.0, len(part.line) - 1.0, 200)
        own = np.arange(len(part.line))
        line = np.stack([np.interp(share, own, column) for column in part.line.T], axis=1)
        depth = (line @ camera.rotation.T + camera.translation)[:, 2]
        spots = camera.project(line) + shift
        for (x, y), far in zip(spots, depth, strict=True):
            if far > 1.5 * part.radius:
                # A ball off the picture's middle is drawn longer than it is wide.
                off = math.hypot(x - 0.5 * width, y - 0.5 * height) / camera.focal
                size = (1.0 + off * off) * camera.focal * part.radius / (far - part.radius) + 3.0
                mask |= (columns - x) ** 2 + (rows - y) ** 2 <= size**2
    return mask


@pytest.mark.slow
def test_wall_stands_still_in_the_picture_of_the_head_s_camera(head) -> None:
    running, page = head
    drive, session = running.drive, running.session
    x, y, full = find_pad(page)
    ways = [(0.0, 0.0), *((0.55 * math.cos(k), 0.55 * math.sin(k)) for k in range(0, 6, 2))]

    def steer(way, out) -> None:
        page.mouse.move(x + full * way[0], y - full * way[1])
        page.evaluate("(out) => { const s = document.querySelector('.out'); s.value = out;"
                      " s.dispatchEvent(new Event('input')); }", out)  # fmt: skip
        wait_until(page, lambda state: math.dist(state["stick"], way) < 0.02)

    def show(on) -> None:
        for name in ("end-effector", "instrument", "trace"):
            page.get_by_label(name, exact=True).evaluate("(box, on) => box.checked === on"
                                                         " || box.click()", on)  # fmt: skip

    page.mouse.move(x, y)
    page.mouse.down()
    show(False)
    wall = []
    for k, way in enumerate(ways):
        steer(way, k / 3)
        wall.append(look_at_head(page))
    assert wall[0].std() > 8.0
    for picture in wall[1:]:
        assert np.array_equal(picture, wall[0])
    show(True)
    page.get_by_label("trace", exact=True).evaluate("(box) => box.click()")
    moved = 0
    for k, way in enumerate(ways):
        steer(way, k / 3)
        picture = look_at_head(page)
        pose = drive.placed.shape((drive.turn @ drive.state.tip)[None])
        pose = replace(pose, tip=pose.holder_tip + drive.wanted * pose.direction)
        mask = mask_bodies(drive, pose, picture)
        changed = np.abs(picture - wall[0]).max(axis=2) > 0.0
        assert not (changed & ~mask).any()
        assert (changed & mask).sum() > 500
        moved += (changed & mask).sum()
    page.mouse.up()
    assert moved and session.drive.camera == "still"


TWO = Head(diameter=24.0, effectors=(PlacedEffector(x=-5.0), PlacedEffector(x=5.0, turn=1.0)))


@pytest.mark.slow
@pytest.mark.parametrize("head", [TWO], indirect=True)
def test_second_end_effector_moves_by_keys_and_the_first_stays(head) -> None:
    running, page = head
    drive, plan = running.drive, running.session.plan
    chosen, pad = page.locator(".which"), page.locator(".pad")
    spaces = []

    def place() -> tuple[np.ndarray, np.ndarray]:
        """Return the two end-effectors, each with its instrument."""
        parts = drive.describe()["head"]["parts"]
        ends = np.cumsum([part["points"] for part in parts])
        lines = np.split(drive.place(plan, 10).tip, ends[:-1])
        spaces.append(page.locator(".pad polygon").get_attribute("points"))
        return np.concatenate(lines[2:4]), np.concatenate(lines[4:6])

    def press(key, is_so) -> None:
        page.keyboard.down(key)
        wait_until(page, is_so)

    camera = "() => [cockpit.frame.camera].map(({ place, way, up }) => [place, way, up])"
    still = page.evaluate(camera)
    pad.focus()
    press("ArrowLeft", lambda state: state["stick"][0] < -0.4)
    press("e", lambda state: state["head"]["out"] > 0.2)
    page.keyboard.up("e")
    page.keyboard.press("2")
    wait_until(page, lambda state: state["head"]["effector"] == 2)
    page.keyboard.up("ArrowLeft")
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])
    wait_for(page, "() => document.querySelector('.which').value === '2'")
    assert float(page.locator(".out").input_value()) == 0.0
    first, second = place()
    assert np.ptp(first[:, :2], axis=0).max() > 5.0  # the tube is along z
    press("ArrowRight", lambda state: state["stick"][0] > 0.4)
    press("e", lambda state: state["head"]["out"] > 0.2)
    page.keyboard.up("e")
    stayed, moved = place()
    assert np.abs(stayed - first).max() < 1e-9
    assert np.abs(moved - second).max() > 5.0
    page.keyboard.up("ArrowRight")
    wait_until(page, lambda state: state["stick"] == [0.0, 0.0])
    chosen.select_option("1")
    wait_until(page, lambda state: state["head"]["effector"] == 1)
    wait_for(page, "() => Number(document.querySelector('.out').value) > 0.2")
    points = "document.querySelector('.pad polygon').getAttribute('points')"
    wait_for(page, f"() => {points} !== '{spaces[1]}'")  # the page follows a frame later
    assert np.abs(place()[0] - first).max() < 1e-9
    assert spaces[0] == spaces[1] != spaces[2]  # the workspace is that of the one which is steered
    assert page.evaluate(camera) == still


@pytest.mark.slow
def test_picture_of_a_conventional_scope_turns_with_the_tip(head) -> None:
    running, page = head
    drive = running.drive
    plan, ahead = running.session.plan, np.array([[4.0, 3.0, 100.0]])  # of the face
    drive.task = TargetTask(plan.joints[10, 0] + ahead @ plan.frames[10])
    x, y, full = find_pad(page)
    page.locator(".eye").select_option("tip")
    wait_for(page, "() => document.querySelector('#viewer').dataset.camera === 'tip'")
    page.locator(".pad").scroll_into_view_if_needed()
    page.mouse.move(x, y)
    page.mouse.down()
    spots, ways = [], []
    for way in ((0.0, 0.0), (0.2, 0.0), (0.0, -0.25), (-0.15, 0.2)):
        page.mouse.move(x + full * way[0], y - full * way[1])
        wait_until(page, lambda state, w=way: math.dist(state["stick"], w) < 0.02)
        page.wait_for_timeout(600)
        picture = look(page, ".inset")
        # The target is the only thing that is green.
        green = (picture[..., 1] > 1.3 * picture[..., 0]) & (picture[..., 1] > picture[..., 2])
        assert green.sum() > 20
        spot = np.argwhere(green).mean(axis=0)[::-1]
        height, width = picture.shape[:2]
        poses = drive.placed.shape((drive.turn @ drive.state.tip)[None])
        size = min(height, width)
        camera = look_from_tip(drive.head, poses, 0)
        seen = (camera.project(ahead[0]) - 239.5) * size / 480.0
        assert spot == pytest.approx(seen + [0.5 * width - 0.5, 0.5 * height - 0.5], abs=3.0)
        spots.append(spot)
        ways.append(page.evaluate("() => cockpit.frame.camera.way"))
        lean = math.acos(float(poses.direction[0, 2]))
        assert math.acos(min(1.0, np.dot(ways[-1], ways[0]))) == pytest.approx(lean, abs=1e-3)
    page.mouse.up()
    assert min(np.linalg.norm(np.array(spots[1:]) - spots[0], axis=1)) > 30.0


@pytest.mark.slow
def test_targets_are_set_and_touched_by_stick_and_slide(head) -> None:
    running, page = head
    drive = running.drive
    page.get_by_role("button", name="Set targets").click()
    wait_for(page, "() => document.querySelector('.touches').textContent.startsWith('0 of 2')")
    plan = running.session.plan
    stand = replace(stand_head(make_tube()[1], 100.0), frame=plan.frames[10].T)
    chosen = list_touches(Head(), stand, duct=make_tube()[0]).choose(2)
    assert chosen.place == pytest.approx(drive.task.targets, abs=1e-3)
    x, y, full = find_pad(page)
    # No picture is drawn: without a graphics processor that takes most of the time.
    page.evaluate("() => (document.querySelector('.stage').hidden = true)")
    page.mouse.move(x, y)
    page.mouse.down()
    for k, bend in enumerate(chosen.bends):
        place = bend @ drive.turn / drive.scale
        page.mouse.move(x - full * place[0], y - full * place[1])
        wait_until(page, lambda state, p=place: math.dist(state["stick"], p * [-1.0, 1.0]) < 0.02)
        touched = f"document.querySelector('.touches').textContent.startsWith('{k + 1} of 2')"
        for key, is_so in (
            ("e", f"() => {touched}"),
            ("q", "() => cockpit.status.head.out === 0"),
        ):
            page.keyboard.down(key)
            wait_for(page, is_so)
            page.keyboard.up(key)
    page.mouse.up()
    found = drive.sum_up()
    assert found.converged and found.error < 2.0 and found.camera == "still"
    assert found.path >= chosen.out.sum() and found.time > 0.0
    assert list(found.list_columns()) == ["target", "time_s", "path_mm", "error_mm"]
