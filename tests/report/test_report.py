"""The report stands alone, tells the plan's numbers, and trusts no text from outside."""

from __future__ import annotations

import base64
import dataclasses
import gzip
import hashlib
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from bozzini.anatomy.tract import Finding
from bozzini.errors import InputError, OutputError
from bozzini.report.report import write_report
from tests.plot.fake_motion import END, make_field, make_plan, make_stopped, make_summary
from tests.scene.decode_view import decode_view

VOID = {"meta", "link", "img", "input", "br", "hr"}


class Page(HTMLParser):
    """Read a page strictly: every element is closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self.style = ""
        self.feed(text)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)
        elif self.open and self.open[-1] == "style":
            self.style += data
        elif self.open:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    @property
    def view(self):
        """What the page shows in 3-D."""
        return decode_view(gzip.decompress(base64.b64decode(self.scripts[0], validate=True)))


def read_report(tmp_path, plan, *, summary=None, findings=(), field=None, comparison=()):
    path = write_report(
        tmp_path / "report.html",
        plan=plan,
        field=make_field() if field is None else field,
        summary=make_summary(plan) if summary is None else summary,
        findings=findings,
        comparison=comparison,
    )
    return Page(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    plan = make_plan(dent=5.25, meta={"input": {"source": "/data/scan.nii.gz"}})
    findings = [Finding("unit-unknown", "note", "no unit"), Finding("open", "warning", "a hole")]
    return read_report(tmp_path_factory.mktemp("report"), plan, findings=findings)


def test_nothing_is_loaded_from_anywhere(page):
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        for key in ("src", "href", "srcset", "data", "action"):
            value = attributes.get(key)
            assert value is None or value.startswith("data:image/png;base64,"), (tag, key)
    script = page.scripts[1]
    assert not re.search(r"https?:|fetch\(|import\b|XMLHttpRequest|innerHTML|eval\(", script)


def test_the_policy_allows_the_one_script_and_the_one_style_alone(page):
    metas = [attributes for tag, attributes in page.tags if tag == "meta"]
    policy = next(meta["content"] for meta in metas if "http-equiv" in meta)
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy
    for text in (page.scripts[1], page.style):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy
    assert len(page.scripts) == 2
    assert not any("style" in attributes or "onclick" in attributes for _, attributes in page.tags)


def test_no_placeholder_is_left_and_every_picture_is_one(page):
    assert "{{" not in page.text
    images = [attributes for tag, attributes in page.tags if tag == "img"]
    assert len(images) == 2 and all(image["alt"] for image in images)
    for image in images:
        raw = base64.b64decode(image["src"].partition(",")[2], validate=True)
        assert raw.startswith(b"\x89PNG")


def test_numbers_are_those_of_plan_and_summary(page):
    text = page.text
    for expected in (
        "−1.25 mm", "−1.250 mm", "80.0 mm", "28.6°", "1.75×", "0.437 mm", "0.250 mm", "scan.nii.gz",
        "a drawn capsule", "4.00 mm", "8.00 mm", "1.5 × 1.5 × 1.5 mm", "read 0.25, plan 1.50",
        "no: estimated",
    ):  # fmt: skip
        assert expected in text, expected
    assert text.index("a hole") < text.index("no unit")
    assert "/data/" not in text.split("Numbers")[0]


def test_the_view_holds_the_plan(page):
    plan, view = make_plan(dent=5.25), page.view
    scope = view["bodies"][0]
    assert scope["joints"].shape == plan.joints.shape
    assert scope["insertion"][-1] == 80.0 and scope["radius"] == plan.scope.radius
    np.testing.assert_allclose(scope["joints"], plan.joints, atol=0.011)
    waiting = ~np.isfinite(plan.clearance)
    assert np.isnan(scope["clearance"][waiting]).all()
    np.testing.assert_allclose(scope["clearance"][~waiting], plan.clearance[~waiting], atol=0.006)
    least = view["charts"][0]["values"]
    assert min(v for v in least if v is not None) == -1.25
    # The wall is where the field's distance is 0, and all of the tract is there.
    wall = next(item for item in view["surfaces"] if item["name"] == "wall")
    assert np.abs(make_field().signed_distance(wall["vertices"])).max() < 0.3
    low, high = wall["vertices"].min(axis=0), wall["vertices"].max(axis=0)
    np.testing.assert_allclose([low[2], high[2]], [END[2] - 6.0, 66.0], atol=0.5)


def count(page, tag):
    return sum(name == tag for name, _ in page.tags)


def test_a_certified_plan_says_what_is_proved_and_for_which_wall(tmp_path):
    plan = make_plan(dent=3.9, meta={"certified": True, "certificate": {"clearance_mm": 0.0789}})
    summary = {**make_summary(plan), "certified": True, "passage_mm": 5.001}
    text = read_report(tmp_path, plan, summary=summary).text
    before, _, after = text.partition("Numbers")
    assert "estimate" not in before and "Certified for the whole body" in before
    assert "0.07 mm proved clearance" in before  # a lower bound is rounded down
    assert "Proved clearance, at least 0.07 mm" in after
    assert "stays at least 0.07 mm from it" in after and "a drawn capsule" in after
    assert "Not proved" in after and "between them" in after
    assert "radius above 5.01 mm" in after  # an upper bound is rounded up
    estimated = read_report(tmp_path, make_plan(dent=3.9)).text
    assert "It is not a proof" in estimated and "Not proved" not in estimated


def test_a_refusal_is_shown_where_it_is_and_in_numbers(tmp_path):
    plan = make_stopped()
    summary = {**make_summary(plan), "certified": True}
    summary["refusal"] = {**plan.meta["refusal"], "diameter_max_mm": 1.999, "inflate_mm": 1.01}
    page = read_report(tmp_path, plan, summary=summary)
    for words in (
        "Refused at this place of the centreline 70.0 mm", "diameter of at most 1.99 mm",
        "inflated by about 1.1 mm", "The orange line is the centreline not reached",
    ):  # fmt: skip
        assert words in page.text
    view = page.view
    rest = next(body for body in view["bodies"] if body["name"] == "not reached")["joints"][0]
    # The line begins at the head's last place and goes on for the missing 30 mm.
    np.testing.assert_allclose(rest[0], view["bodies"][0]["joints"][-1, 0], atol=0.03)
    assert np.linalg.norm(rest[-1] - rest[0]) == pytest.approx(30.0, abs=0.1)
    mark = next(mark for mark in view["marks"] if mark["kind"] == "refused")
    assert np.linalg.norm(np.array(mark["place"]) - rest[-1]) == pytest.approx(10.0, abs=0.1)
    whole = read_report(tmp_path, make_plan()).view
    assert len(whole["bodies"]) == 2 and all(m["kind"] != "refused" for m in whole["marks"])


@pytest.mark.slow
def test_methods_stand_side_by_side_when_there_are_any(tmp_path, page):
    assert "side by side" not in page.text
    plan = make_plan()
    other = dataclasses.replace(make_plan(dent=5.25), method="<b>new</b>")
    two = read_report(tmp_path, plan, comparison=[plan, other])
    assert "Methods side by side" in two.text and "<b>new</b>" in two.text
    assert count(two, "img") == count(page, "img") + 1
    assert "−1.25 mm , through the wall" in two.text and "4.00 mm, estimated" in two.text
    same = read_report(tmp_path, plan, comparison=[dataclasses.replace(plan), other])
    assert same.text.count("thesis, section 5.3") == 1  # the plan itself is not put there twice
    records = [{"method": "tube", "status": "stopped", "inserted_mm": 12.0, "reason_code": "FOLD"}]
    table = read_report(tmp_path, plan, summary={**make_summary(plan), "comparison": records})
    assert "stops at 12 mm FOLD" in table.text and count(table, "img") == count(page, "img")


def test_contact_is_shown_for_a_soft_wall_only(tmp_path, page):
    soft = {"allowed_mm": 4.0, "used_mm": 2.0, "contact_max_mm": 1.25, "contact_where_mm": 40.0}
    plan = make_plan(dent=5.25, meta={"certified": True, "soft_wall": soft})
    plan = dataclasses.replace(plan, method="tube")
    summary = {**make_summary(plan), "certified": True}
    pushed = read_report(tmp_path, plan, summary=summary)
    assert "Contact" in pushed.text and count(pushed, "img") == count(page, "img") + 1
    assert "1.25 mm deepest contact" in pushed.text and "through the wall" not in pushed.text
    rigid = {**soft, "used_mm": 0.0, "contact_max_mm": 0.0}
    text = read_report(tmp_path, plan, summary={**summary, "soft_wall": rigid}).text
    assert "Contact" not in text


def test_text_from_outside_is_escaped(tmp_path):
    evil = "</script><script>alert('x')</script>{{script}}"
    plan = make_plan(
        status="stopped",
        reach=60.0,
        meta={
            "input": {"source": f"{evil}.stl", evil: evil},
            "command": evil,
            "attribution": evil,
            "wall": evil,
            "versions": {evil: evil},
        },
    )
    plan = dataclasses.replace(plan, reason=evil)
    summary = {**make_summary(plan), "more": evil}
    page = read_report(tmp_path, plan, summary=summary, findings=[Finding(evil, "note", evil)])
    assert sum(tag == "script" for tag, _ in page.tags) == 2
    assert page.text.count("alert('x')") >= 9
    assert not any("alert" in script for script in page.scripts)


@pytest.mark.parametrize(
    "changes",
    [
        {"steps": 1},
        {"links": 1},
        {"steps": 1, "reach": 0.0, "status": "stopped"},
        {"radius": 9.0},
        {"first": 80.0, "reach": 10.0},
    ],
    ids=["one step", "two joints", "not in yet", "all through", "in and out"],
)
def test_extreme_plans_make_a_page(tmp_path, changes):
    plan = make_plan(**changes)
    summary = {k: v for k, v in make_summary(plan).items() if v != np.inf}
    page = read_report(tmp_path, plan, summary=summary)
    assert page.view["bodies"][0]["joints"].shape[0] == plan.steps
    assert "Nothing unusual was found" in page.text


def test_a_bare_plan_and_summary_are_enough(tmp_path):
    plan = dataclasses.replace(make_plan(), scope=None)
    assert "The scope reaches the far end" in read_report(tmp_path, plan, summary={}).text


@pytest.mark.slow
def test_long_plans_stay_small(tmp_path):
    plan = make_plan(steps=5000, links=150, link_length=1.0)
    page = read_report(tmp_path, plan)
    assert page.view["bodies"][0]["joints"].shape == plan.joints.shape  # no step is left out
    assert (tmp_path / "report.html").stat().st_size < 2_000_000


def test_what_does_not_belong_together_is_refused(tmp_path):
    plan, path = make_plan(), tmp_path / "report.html"
    with pytest.raises(InputError, match="steps is 7 in the summary and 41 in the plan"):
        write_report(path, plan=plan, field=make_field(), summary={"steps": 7})
    with pytest.raises(InputError, match="summary is a list"):
        write_report(path, plan=plan, field=make_field(), summary=[])
    far = make_field(start=np.array([500.0, 0, 0]), end=np.array([540.0, 0, 0]))
    with pytest.raises(InputError, match="81 of 81 path points lie outside"):
        write_report(path, plan=plan, field=far, summary=make_summary(plan))
    with pytest.raises(InputError, match="path_radius has shape"):
        dataclasses.replace(plan, path_radius=np.ones(5))
    with pytest.raises(OutputError):
        write_report(
            tmp_path / "no" / "report.html",
            plan=plan,
            field=make_field(),
            summary=make_summary(plan),
        )
    assert not list(tmp_path.iterdir())
