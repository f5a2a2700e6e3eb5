"""The report stands alone, tells the plan's numbers, and trusts no text from outside."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from bozzini.anatomy.findings import Finding
from bozzini.errors import InputError, OutputError
from bozzini.view.report import write_report
from bozzini.view.verdict import judge_plan
from tests.view.fake_motion import make_field, make_plan, make_summary

VOID = {"meta", "link", "img", "input", "br", "hr"}


class Page(HTMLParser):
    """Read a page strictly: every element is closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
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
        elif self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))

    @property
    def motion(self):
        return json.loads(self.scripts[0])


def read_report(tmp_path, plan, *, summary=None, findings=(), field=None):
    path = write_report(
        tmp_path / "report.html",
        plan=plan,
        field=make_field() if field is None else field,
        summary=make_summary(plan) if summary is None else summary,
        findings=findings,
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


def test_no_placeholder_is_left_and_every_picture_is_one(page):
    assert "{{" not in page.text
    images = [attributes for tag, attributes in page.tags if tag == "img"]
    assert len(images) == 4 and all(image["alt"] for image in images)
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


def test_slider_holds_the_plan(page):
    plan, motion = make_plan(dent=5.25), page.motion
    assert motion["count"] == plan.steps and motion["joints"] == plan.links + 1
    assert motion["insertion"][-1] == 80.0
    assert min(v for v in motion["smallest"] if v is not None) == -1.25
    clearance = np.frombuffer(base64.b64decode(motion["clearance"]), "<i2").reshape(41, 10)
    waiting = ~np.isfinite(plan.clearance)
    assert (clearance[waiting] == -32768).all()
    np.testing.assert_allclose(0.01 * clearance[~waiting], plan.clearance[~waiting], atol=0.006)
    for view in motion["views"]:
        joints = 0.1 * np.frombuffer(base64.b64decode(view["joints"]), "<i2").reshape(41, 11, 2)
        length = np.linalg.norm(np.diff(joints, axis=1), axis=-1)
        np.testing.assert_allclose(length, 8.0, atol=0.15)  # the tract lies in both pictures
        assert (np.diff(joints[:, 0, 1]) > 0).all()  # and the head goes down in them
        assert 0 < joints[-1, 0, 1] < view["height"]
    # The head stands where the tract ends: its round end is one radius and the margin further.
    assert motion["views"][0]["height"] - joints[-1, 0, 1] == pytest.approx(16.0, abs=3.0)


@pytest.mark.parametrize(
    ("changes", "label", "tone", "words"),
    [
        ({}, "Fits", "green", "4.0 mm scope reaches the far end (80 mm) and keeps 4.00 mm"),
        ({"dent": 4.4}, "Through the wall", "red", "passes through the wall at 40 mm by 0.40 mm"),
        ({"dent": 3.9}, "Too close to call", "amber", "within 0.10 mm of the wall at 40 mm"),
        (
            {"reach": 61.0, "status": "stopped"},
            "Stopped",
            "red",
            "stops at 61 mm of 80 mm: link 3 is locked. Up to there it keeps 4.00 mm",
        ),
        (
            {"reach": 61.0, "status": "stopped", "dent": 5.0},
            "Stopped",
            "red",
            "Before that its body passes through the wall at 40 mm by 1.00 mm",
        ),
    ],
)
def test_verdict(changes, label, tone, words):
    plan = make_plan(**changes)
    verdict = judge_plan(plan, make_summary(plan), error=0.5)
    assert (verdict.label, verdict.tone) == (label, tone)
    assert words in verdict.sentence
    # Without a summary the plan itself gives the same verdict.
    assert judge_plan(plan, {}, error=0.5).tone == tone


def test_a_certified_clearance_needs_no_error_margin(tmp_path):
    plan = make_plan(dent=3.9, meta={"certified": True})
    summary = {**make_summary(plan), "certified": True}
    assert judge_plan(plan, summary, error=0.5).tone == "green"
    text = read_report(tmp_path, plan, summary=summary).text
    assert "certified for the whole body" in text and "estimate" not in text.split("Numbers")[0]


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
    assert page.motion["count"] == plan.steps
    assert "Nothing unusual was found" in page.text


def test_a_bare_plan_and_summary_are_enough(tmp_path):
    plan = dataclasses.replace(make_plan(), meta={})
    assert "The scope reaches the far end" in read_report(tmp_path, plan, summary={}).text


def test_long_plans_stay_small(tmp_path):
    plan = make_plan(steps=5000, links=150, link_length=1.0)
    page = read_report(tmp_path, plan)
    assert page.motion["count"] <= 301
    assert (tmp_path / "report.html").stat().st_size < 4_000_000


def test_what_does_not_belong_together_is_refused(tmp_path):
    plan, path = make_plan(), tmp_path / "report.html"
    with pytest.raises(InputError, match="steps is 7 in the summary and 41 in the plan"):
        write_report(path, plan=plan, field=make_field(), summary={"steps": 7})
    with pytest.raises(InputError, match="summary is a list"):
        write_report(path, plan=plan, field=make_field(), summary=[])
    far = make_field(start=np.array([500.0, 0, 0]), end=np.array([540.0, 0, 0]))
    with pytest.raises(InputError, match="81 of 81 path points lie outside"):
        write_report(path, plan=plan, field=far, summary=make_summary(plan))
    short = dataclasses.replace(plan, path_radius=np.ones(5))
    with pytest.raises(InputError, match="path_radius has shape"):
        write_report(path, plan=short, field=make_field(), summary=make_summary(plan))
    with pytest.raises(OutputError):
        write_report(
            tmp_path / "no" / "report.html",
            plan=plan,
            field=make_field(),
            summary=make_summary(plan),
        )
    assert not list(tmp_path.iterdir())
