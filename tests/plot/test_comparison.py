"""Methods side by side: records where there are any, the plans' own numbers where not."""

from __future__ import annotations

import dataclasses
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text

from bozzini.plot.comparison import draw_comparison, spread
from bozzini.plot.figures import write_figure
from bozzini.plot.plan_data import list_methods
from bozzini.report.text import render_methods
from tests.plot.fake_motion import make_plan, make_stopped

INTRODUCER_FREE = {"certified": True, "certificate": {"clearance_mm": 1.5}}


def plans():
    return [
        dataclasses.replace(make_plan(meta=INTRODUCER_FREE), method="tube"),
        make_plan(dent=5.25),
        dataclasses.replace(make_stopped(), method="new"),
        dataclasses.replace(make_plan(steps=1, reach=0.0, status="stopped"), method="outside"),
    ]


def test_rows_are_the_plans_own():
    rows = list_methods(plans())
    assert [row["method"] for row in rows] == ["tube", "thesis", "new", "outside"]
    for row, plan in zip(rows, plans(), strict=True):
        assert row["status"] == plan.status and row["inserted_mm"] == plan.inserted
    assert rows[0]["clearance_certified_mm"] == 1.5
    assert rows[1]["clearance_certified_mm"] is None
    assert rows[1]["clearance_min_mm"] == pytest.approx(-1.25)
    assert rows[3]["clearance_min_mm"] is None


def test_records_go_before_what_is_computed():
    record = {"method": "thesis", "seconds": 3.5, "clearance_min_mm": -9.0}
    rows = list_methods(plans(), [record])
    assert rows[0]["method"] == "thesis" and len(rows) == 4
    assert rows[0]["clearance_min_mm"] == -9.0 and rows[0]["status"] == "complete"
    assert record == {"method": "thesis", "seconds": 3.5, "clearance_min_mm": -9.0}


class Cells(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.rows, self.tags = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        self.rows[-1][-1] += data


def test_table_has_the_columns_that_are_known_and_trusts_no_text():
    evil = "<script>x</script>"
    rows = [{"method": evil, "status": "stopped", "reason": evil, "reason_code": evil}]
    table = Cells(render_methods(rows))
    assert "script" not in table.tags
    assert table.rows[0] == ["Method", "Result"]
    full = Cells(render_methods([*list_methods(plans()), {"method": "tube", "seconds": 2.0}]))
    assert {len(row) for row in full.rows} == {len(full.rows[0])}
    assert full.rows[0][-1] == "Seconds" and full.rows[-1][-1] == "2.00 s"
    assert full.rows[1][2] == "at least 1.50 mm, proved"
    assert full.rows[2][2] == "−1.25 mm, through the wall"
    assert full.rows[4][1] == "stops at 0 mm LOCKED" and full.rows[4][2] == "–"
    assert full.rows[3][1] == "stops at 50 mm LOCKED"


@pytest.mark.slow
def test_any_plans_can_be_drawn_together(tmp_path):
    there_and_back = make_plan(first=80.0, reach=10.0)
    for chosen in ([make_plan()], plans(), [make_plan(steps=1), there_and_back], plans()[3:]):
        figure = draw_comparison(chosen)
        path = write_figure(figure, tmp_path / "figure.png", dpi=30)
        assert path.read_bytes().startswith(b"\x89PNG")


def test_names_in_the_figure_do_not_overlap():
    same = [dataclasses.replace(make_plan(), method=name) for name in ("tube", "follow", "new")]
    figure = draw_comparison(same)
    figure.draw_without_rendering()
    # Without the lines that tie names to their ends, which an annotation counts as its own.
    boxes = [Text.get_window_extent(text) for text in figure.axes[0].texts]
    assert len(boxes) == 3
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=6))
def test_spreading_keeps_order_and_middle(values):
    start = np.array(values)
    moved = spread(start, gap=0.5)
    order = np.argsort(start, kind="stable")
    assert (np.diff(moved[order]) >= 0.5 - 1e-6).all()
    assert moved.mean() == pytest.approx(start.mean(), abs=1e-9)
    if (np.diff(start[order]) >= 0.5).all():
        np.testing.assert_array_equal(moved, start)
