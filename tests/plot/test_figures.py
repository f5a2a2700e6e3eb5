"""Figures are made from any plan, and show the plan's own numbers."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from bozzini.plot.clearance import draw_clearance, map_clearance
from bozzini.plot.figures import draw_depths, draw_overview, write_figure
from bozzini.plot.plan_data import place_tightest, sample_motion
from bozzini.plot.scope import choose_bar_length, find_violations
from bozzini.plot.style import ClearanceScale, choose_clearance_scale, list_clearance_colors
from tests.plot.fake_motion import make_field, make_line, make_plan, make_stopped

PLANS = {
    "clear": {},
    "violating": {"dent": 5.0},
    "all through": {"radius": 9.0},
    "stopped": {"reach": 33.0, "status": "stopped"},
    "one step": {"steps": 1},
    "one step, nothing in yet": {"steps": 1, "reach": 0.0},
    "two joints": {"links": 1},
    "one step, two joints": {"links": 1, "steps": 1},
    "in and out": {"first": 80.0, "reach": 10.0},
    "with centreline": {"meta": {"centreline": make_line()}},
}


@pytest.mark.parametrize("name", PLANS)
def test_every_plan_can_be_drawn(name, tmp_path):
    plan, field = make_plan(**PLANS[name]), make_field()
    for figure in (
        draw_overview(plan, field),
        draw_depths(plan, field, depths=2),
        draw_clearance(plan),
    ):
        path = write_figure(figure, tmp_path / "figure.png", dpi=30)
        assert path.read_bytes().startswith(b"\x89PNG")


def test_overview_is_written_and_wide(tmp_path):
    from PIL import Image

    draw_overview(make_plan(), make_field(), path=tmp_path / "overview.png")
    with Image.open(tmp_path / "overview.png") as image:
        assert image.size == (1600, 900)


def test_overview_tells_back_and_forth_by_steps():
    there_and_back = draw_overview(make_plan(first=80.0, reach=10.0), make_field())
    labels = [axes.get_xlabel() for axes in there_and_back.axes]
    assert "step" in labels and "insertion [mm]" not in labels
    assert "insertion [mm]" in [
        axes.get_xlabel() for axes in draw_overview(make_plan(), make_field()).axes
    ]


def test_global_plotting_state_is_left_alone():
    code = "import sys, bozzini.plot.figures; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def _texts(figure):
    return [text.get_text() for text in figure.findobj(lambda o: hasattr(o, "get_text"))]


def test_the_tightest_value_and_the_depths_are_written():
    plan, field = make_plan(dent=5.25), make_field()
    assert plan.clearance_min == pytest.approx(-1.25)
    assert any("−1.25" in text for text in _texts(draw_clearance(plan)))
    texts = _texts(draw_overview(plan, field, depths=2))
    assert {"40 mm inserted", "80 mm inserted", "10 mm"} <= set(texts)


def test_a_stopped_plan_shows_the_whole_way_and_the_refusal(tmp_path):
    plan, field = make_stopped(), make_field()
    assert plan.path_arc_length[-1] == 50.0
    figure = draw_clearance(plan, summary={"passage_mm": 1.0})
    texts = _texts(figure)
    refused = "refused at 70 mm: needs 2.00, offers 1.00 mm"
    assert any(refused in text for text in texts) and "goal, 80 mm" in texts
    assert any(text.startswith("passage, at most 1.00") for text in texts)
    maps = [axes for axes in figure.axes if axes.images]
    assert maps[0].get_ylim()[0] == 0.0 and maps[0].get_ylim()[1] >= 80.0
    for draw in (draw_depths, draw_overview):
        assert any(refused in text for text in _texts(draw(plan, field)))
        assert not any("not reached" in text for text in _texts(draw(make_plan(), field)))


REFUSED = {"code": "NO_PASSAGE", "at_mm": 44.0, "needs_mm": 2.0, "offers_mm": 3.0}


@pytest.mark.slow
def test_text_stands_clear_of_text():
    for plan in (make_stopped(), make_plan(), make_stopped(refusal=REFUSED)):
        for figure in (draw_clearance(plan), draw_depths(plan, make_field())):
            figure.draw_without_rendering()
            texts = [text for axes in figure.axes for text in axes.texts] + figure.texts
            boxes = [text.get_window_extent() for text in texts if text.get_text()]
            for k, box in enumerate(boxes):
                assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_map_shows_each_place_at_its_clearance():
    sample = sample_motion(make_plan(dent=5.0), count=50)
    image = map_clearance(sample, over=sample.insertion, length=80.0)
    middles = (np.arange(len(image)) + 0.5) * 80.0 / len(image)
    last = image[:, -1]
    low = middles[last < 0.0]
    # At the end the link that lies across 40 mm reaches from 32 to 40 mm.
    assert low.min() == pytest.approx(32.0, abs=0.9) and low.max() == pytest.approx(40.0, abs=0.9)
    assert np.isnan(image[middles > 45.0, image.shape[1] // 2]).all()
    assert np.nanmin(image) == pytest.approx(-1.0)


def test_thinning_keeps_first_last_and_tightest_step():
    plan = make_plan(steps=4001)
    plan.clearance[1234, 0] = -0.7
    sample = sample_motion(plan, count=40)
    assert {0, 1234, 4000} <= set(sample.steps.tolist()) and len(sample.steps) <= 41
    assert sample.smallest.min() == -0.7
    between = sample_motion(plan, count=7, worst_between=True)
    everything = np.where(np.isfinite(plan.clearance), plan.clearance, 99.0)
    assert between.smallest.min() == everything.min()


def test_joints_are_placed_where_they_stand():
    plan = make_plan(steps=33)
    sample = sample_motion(plan, count=100)
    expected = plan.head_arc_length[:, None] - 8.0 * np.arange(plan.links + 1)
    np.testing.assert_allclose(sample.places, expected, atol=0.9)
    assert not sample.in_tract[0].any() and sample.in_tract[-1].all()


def test_the_tightest_place_is_found_on_the_link():
    # The middle of the capsule is its widest; a scope pushed off the axis is tightest there.
    plan = make_plan(dent=1.0)
    joints = plan.joints.copy()
    joints[-1, 4] += [3.0, 0.0, 0.0]
    object.__setattr__(plan, "joints", joints)
    plan.clearance[-1] = 4.0
    plan.clearance[-1, 3] = 1.0
    sample = sample_motion(plan, count=100)
    assert place_tightest(sample, make_field())[-1] == pytest.approx(80.0 - 32.0, abs=1.0)


def test_colour_scale_breaks_at_zero_and_keeps_its_order():
    scale = ClearanceScale(low=-2.0, high=4.0)
    below, above = scale.color(-1e-9), scale.color(0.0)
    assert np.abs(below - above).max() > 0.3
    np.testing.assert_allclose(scale.color(99.0), scale.color(4.0))
    np.testing.assert_allclose(scale.color(-99.0), scale.color(-2.0))
    colors = list_clearance_colors(scale, 60)
    red = [int(color[1:3], 16) > int(color[5:7], 16) + 60 for color in colors]
    assert red[:20] == [True] * 20 and not any(red[40:])
    for values in ([], [np.inf], [3.0, 3.0], [-5.0, -4.0], [0.0]):
        chosen = choose_clearance_scale(values)
        assert chosen.low < 0.0 < chosen.high


def test_one_mark_per_run_of_violations():
    clearance = np.array([1.0, -0.1, -0.5, -0.2, 2.0, np.inf, -0.3])
    assert find_violations(clearance) == [2, 6]
    assert find_violations(np.array([1.0, np.inf])) == []


@pytest.mark.parametrize("width", [0.3, 4.0, 79.0, 100.0, 499.0, 900.0])
def test_scale_bar_fits(width):
    assert 0.1 * width <= choose_bar_length(width) <= 0.65 * width
