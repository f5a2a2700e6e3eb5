"""Places along the tract are told on the centreline, however the head's path is bent."""

from __future__ import annotations

import dataclasses
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bozzini.duct import Centreline
from bozzini.errors import InputError
from bozzini.plot.plan_data import find_refusal, read_centreline, sample_motion, share_centreline
from tests.plot.fake_motion import make_line, make_plan, make_stopped


def follow(path, line, **known):
    """Return a plan whose path is `path` and whose centreline is `line`, both (n, 3)."""
    arcs = [
        np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
        for p in (path, line)
    ]
    record = np.full(len(line), 6.0)
    return dataclasses.replace(
        make_plan(),
        path=path,
        path_arc_length=arcs[0],
        path_radius=np.full(len(path), 6.0),
        **{"centreline": Centreline(points=line, arc_length=arcs[1], radius=record), **known},
    )


def test_without_a_centreline_the_path_is_the_way():
    plan = make_plan()
    centreline = read_centreline(plan)
    assert not centreline.is_centreline and centreline.length == 80.0
    arc = np.array([-12.0, 0.0, 3.3, 80.0])
    np.testing.assert_allclose(centreline.to_centreline(arc), arc)


@given(wave=st.floats(0.0, 2.0), share=st.floats(0.2, 1.0))
def test_a_bent_path_is_placed_beside_the_line(wave, share):
    line = np.stack([np.linspace(0.0, 100.0, 201), np.zeros(201), np.zeros(201)], axis=-1)
    path = line[: int(200 * share) + 1].copy()
    path[:, 1] = wave * np.sin(path[:, 0] / 3.0)
    plan = follow(path, line)
    centreline = read_centreline(plan)
    places = centreline.to_centreline(plan.path_arc_length)
    assert (np.diff(places) >= 0.0).all()
    np.testing.assert_allclose(places, path[:, 0], atol=0.3 + 0.7 * wave)
    assert centreline.to_centreline(-7.0) == pytest.approx(-7.0)
    rest = centreline.points_beyond(float(places[-1]))
    length = np.linalg.norm(np.diff(rest, axis=0), axis=-1).sum() if len(rest) else 0.0
    assert places[-1] + length == pytest.approx(centreline.length)


def test_a_path_beside_the_other_limb_does_not_jump_to_it():
    turn = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 20)
    along = np.linspace(0.0, 60.0, 121)
    line = np.concatenate(
        [
            np.stack([along, np.full(121, -2.0)], axis=-1),
            np.stack([60.0 + 2.0 * np.cos(turn), 2.0 * np.sin(turn)], axis=-1)[1:-1],
            np.stack([along[::-1], np.full(121, 2.0)], axis=-1),
        ]
    )
    line = np.pad(line, ((0, 0), (0, 1)))
    path = line.copy()
    middle = (path[:, 0] > 20.0) & (path[:, 0] < 40.0)
    path[middle, 1] *= -0.5  # nearer to the other limb than to its own
    centreline = read_centreline(follow(path, line))
    back = centreline.to_centreline(follow(path, line).path_arc_length)
    np.testing.assert_allclose(back, centreline.arc_length, atol=4.5)


def test_long_paths_are_matched_in_parts():
    line = np.stack([np.linspace(0.0, 900.0, 5001), np.zeros(5001), np.zeros(5001)], axis=-1)
    plan = follow(line[:3001], line)
    assert read_centreline(plan).to_centreline(540.0) == pytest.approx(540.0, abs=1.5)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda line: None,
        lambda line: {},
        lambda line: {**line, "radius_mm": [1.0]},
        lambda line: {**line, "points_mm": "here"},
        lambda line: {**line, "points_mm": [[1.0, 2.0]] * 81},
        lambda line: {**line, "arc_length_mm": [0.0] * 81},
        lambda line: {**line, "radius_mm": [float("nan")] * 81},
        lambda line: {**line, "radius_mm": [None] * 81},
    ],
)
def test_a_spoilt_centreline_is_refused_or_left_aside(spoil):
    assert read_centreline(make_plan(meta={"centreline": make_line()})).is_centreline
    with suppress(InputError):
        plan = make_plan(meta={"centreline": spoil(make_line())})
        assert not read_centreline(plan).is_centreline


def test_joints_stand_on_the_centreline_too():
    line = np.array([10.0, -20.0, 60.0]) - np.linspace(0.0, 80.0, 161)[:, None] * [0, 0, 1]
    sides = 1.5 * np.sin(np.linspace(0.0, 80.0, 161) / 4.0)
    plan = follow(line + sides[:, None] * [1.0, 0.0, 0.0], line)
    plan = dataclasses.replace(plan, head_arc_length=plan.head_arc_length * 1.01)
    sample = sample_motion(plan, count=50)
    # The chain itself is straight: the height of a joint is its place.
    inside = sample.places[:, 1:] > 0.0
    height = 60.0 - sample.joints[:, 1:, 2]
    assert inside.any()
    np.testing.assert_allclose(sample.places[:, 1:][inside], height[inside], atol=2.0)


def test_plans_without_a_centreline_take_that_of_the_others():
    bare, full = make_plan(), make_plan(meta={"centreline": make_line(70.0)})
    assert [read_centreline(plan).length for plan in share_centreline([bare, full])] == [70.0, 70.0]
    assert share_centreline([bare]) == [bare] and bare.centreline is None


def test_the_refusal_is_that_of_the_summary_else_of_the_plan():
    plan = make_stopped()
    mark = find_refusal(plan)
    assert (mark.code, mark.at, mark.needs, mark.offers) == ("NO_PASSAGE", 70.0, 2.0, 1.0)
    other = find_refusal(plan, {"refusal": {"at_mm": 30.0, "needs_mm": 2.0, "offers_mm": 1.999}})
    assert other.text == "refused at 30 mm: needs 2.00, offers 1.99 mm"  # never reads alike
    assert find_refusal(plan, {"refusal": {"at_mm": 30.0}}).text == "refused at 30 mm"
    assert find_refusal(plan, {"refusal": None}) == mark
    assert find_refusal(make_plan(meta=plan.meta)) is None  # complete
    assert find_refusal(make_plan(status="stopped")) is None
