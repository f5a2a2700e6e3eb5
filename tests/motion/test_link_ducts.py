"""One link in every duct: against closed forms and a scan, and what is said where none fits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bozzini.duct import Circles, Polygon, RoundCones
from bozzini.duct.compose import without
from bozzini.duct.kernels.clearance import evaluate_estimate
from bozzini.motion import FreeSpace, Introducer, place_tail
from bozzini.motion.kernels.chain import make_frame, search_sphere
from tests.motion.pipes import NAMES, make_pipes
from tests.motion.test_link import sphere_points

pytestmark = pytest.mark.slow  # links are compiled anew for ducts that are no fields

DIRECTIONS = sphere_points(20_000)
CIRCLE = np.stack([np.cos(t := np.linspace(0.0, 2.0 * np.pi, 20_000)), np.sin(t)], axis=1)


def angle_between(a, b):
    a, b = a / np.linalg.norm(a, axis=-1, keepdims=True), b / np.linalg.norm(b)
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))


def room_at(duct, points):
    """Clearance as the kernels see it, by another way than the solver's."""
    room = np.empty(len(points))
    evaluate_estimate(duct.pack(), np.array(duct.to_grid(points), order="C"), room)
    return room


def draw(duct, random, clearance):
    """A head with room in the duct, and an old tail about 20 mm away, anywhere."""
    while True:
        head = random.uniform(*duct.bounds)
        if room_at(duct, head[None])[0] > clearance:
            break
    away = random.normal(size=len(head))
    return head, head + random.uniform(10.0, 30.0) * away / np.linalg.norm(away)


@pytest.mark.parametrize("name", NAMES)
def test_no_nearer_direction_has_room(name):
    duct = make_pipes()[name]
    directions = CIRCLE if duct.bounds.shape[1] == 2 else DIRECTIONS
    random = np.random.default_rng(3)
    seen = set()
    for trial in range(12):
        clearance, length = random.uniform(0.5, 4.0), random.uniform(8.0, 24.0)
        if trial >= 9:
            length = 300.0 if trial == 9 else 220.0
        head, old = draw(duct, random, clearance)
        placed = place_tail(duct, head, old_tail=old, length=length, clearance=clearance)
        scan = head + length * directions
        room = room_at(duct, scan)
        turn = angle_between(directions, old - head)
        assert np.linalg.norm(placed.tail - head) == pytest.approx(length, abs=1e-9)
        assert placed.clearance == pytest.approx(room_at(duct, placed.tail[None])[0], abs=1e-9)
        assert np.all(turn[room >= clearance + placed.slack] >= placed.turn_bound)
        seen.add(placed.found)
        if placed.found:
            assert placed.clearance >= clearance - 2e-9
            assert angle_between(placed.tail - head, old - head) == pytest.approx(
                placed.turn, abs=1e-7
            )
            assert placed.turn - 1e-3 - 1e-12 <= placed.turn_bound <= placed.turn
            assert placed.move == pytest.approx(np.linalg.norm(placed.tail - old))
            assert placed.reason == ""
        else:
            assert room.max() <= placed.clearance_bound
            loose = max(0.01, 0.01 * (clearance - placed.clearance)) + 1e-9
            assert placed.clearance_bound <= placed.clearance + loose
            assert placed.clearance >= room.max() - loose
    assert seen == {True, False}


@settings(max_examples=60)
@given(
    centre=st.tuples(*[st.floats(-9.0, 9.0)] * 3),
    away=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    length=st.floats(2.0, 15.0),
)
def test_in_a_ball_the_free_directions_are_a_cap(centre, away, length):
    # |x - c| <= r on the sphere of radius L about the head at 0, |c| = D: a cap about c of half
    # angle acos((D^2 + L^2 - r^2) / (2 D L)); the nearest direction is on the way to its middle.
    centre, away, rest = np.array(centre), np.array(away), 10.0 - 1.5
    gap = np.linalg.norm(centre)
    assume(gap > 0.1 and np.linalg.norm(away) > 0.1)
    cosine = (gap**2 + length**2 - rest**2) / (2.0 * gap * length)
    assume(abs(abs(cosine) - 1.0) > 1e-3)
    duct = RoundCones(centre[None], np.array([10.0]))
    placed = place_tail(duct, np.zeros(3), old_tail=away, length=length, clearance=1.5)
    if cosine > 1.0:
        assert not placed.found
        most = 10.0 - abs(gap - length)
        assert placed.clearance == pytest.approx(most, abs=0.0101) and placed.clearance <= most
        assert most <= placed.clearance_bound
        return
    cap = math.acos(max(cosine, -1.0))
    expected = max(float(angle_between(centre, away)) - cap, 0.0)
    assert placed.turn == pytest.approx(expected, abs=1e-6)
    assert placed.status == ("free" if expected == 0.0 else placed.status)
    assert placed.turn_bound <= expected + 1e-9
    if expected == 0.0:
        return
    # The search alone, and coarse: its bound and its answer hold the truth between them.
    frame, place = np.empty((3, 3)), np.zeros(2)
    make_frame(np.zeros(3), away, False, frame)
    found, turn, bound, _ = search_sphere(
        FreeSpace(duct).pack(),
        np.zeros(3),
        frame,
        length,
        1.5,
        1.0,
        np.inf,
        0.05,
        1e-3,
        10**6,
        place,
    )
    assert found and np.hypot(*place) == pytest.approx(turn, abs=1e-12)
    assert turn - 0.05 - 1e-12 <= bound <= expected <= turn + 1e-9


@settings(max_examples=60)
@given(
    spots=st.lists(
        st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.floats(0.5, 4.0)),
        min_size=1,
        max_size=4,
    ),
    turn=st.floats(-3.1, 3.1),
)
def test_round_obstacles_block_arcs(spots, turn):
    # Thesis eq. 5.14: the directions blocked by a circle are an arc about the way to its middle,
    # half acos((D^2 + L^2 - r^2) / (2 D L)) wide. Candidates: the old direction, the arcs' ends.
    length, clearance = 8.0, 0.5
    arcs = []
    for x, y, radius in spots:
        gap, reach = math.hypot(x, y), radius + clearance
        assume(gap > reach + 0.1)
        cosine = (gap**2 + length**2 - reach**2) / (2.0 * gap * length)
        assume(abs(cosine - 1.0) > 1e-3)
        if cosine < 1.0:
            arcs.append((math.atan2(y, x), math.acos(cosine)))

    def depth(angle):
        """How deep an angle lies in an arc, negative outside all."""
        return max(
            (half - abs(math.remainder(angle - middle, 2.0 * math.pi)) for middle, half in arcs),
            default=-1.0,
        )

    ends = [middle + sign * half for middle, half in arcs for sign in (-1.0, 1.0)]
    free = [end for end in ends if depth(end) < 1e-9]
    assume(all(not -1e-3 < depth(end) < -1e-12 and not 1e-9 <= depth(end) < 1e-3 for end in ends))
    assume(abs(depth(turn)) > 1e-3)
    field = Polygon(np.array([(-50, -50), (50, -50), (50, 50), (-50, 50)], dtype=float))
    circles = Circles([spot[:2] for spot in spots], [spot[2] for spot in spots])
    duct = without(field, circles)
    old = 8.0 * np.array([math.cos(turn), math.sin(turn)])
    placed = place_tail(duct, (0.0, 0.0), old_tail=old, length=length, clearance=clearance)
    if depth(turn) < 0.0:
        assert placed.status == "free" and placed.tail == pytest.approx(old, abs=1e-9)
    elif not free:
        assert not placed.found
    else:
        least = min(abs(math.remainder(end - turn, 2.0 * math.pi)) for end in free)
        assert placed.turn == pytest.approx(least, abs=1e-7)


def test_a_straight_channel_has_a_closed_form():
    channel = Polygon(np.array([(-60, -5), (60, -5), (60, 5), (-60, 5)], dtype=float))
    placed = place_tail(channel, (0.0, 1.0), old_tail=(4.0, 9.0), length=10.0, clearance=2.0)
    height = 3.0 - 1.0
    assert placed.tail == pytest.approx((math.sqrt(100.0 - height**2), 3.0), abs=1e-8)
    assert placed.clearance == pytest.approx(2.0, abs=2e-9)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), angle=st.floats(-3.0, 3.0))
def test_a_link_is_carried_by_a_rigid_motion(seed, angle):
    duct = make_pipes()["round cones"]
    random = np.random.default_rng(seed)
    head, old = draw(duct, random, 3.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]]
    )
    moved = RoundCones(duct.centres @ turn.T + 5.0, duct.radii)
    a = place_tail(duct, head, old_tail=old, length=12.0, clearance=3.0)
    b = place_tail(moved, turn @ head + 5.0, old_tail=turn @ old + 5.0, length=12.0, clearance=3.0)
    assert a.found == b.found
    if a.found:
        # Both are within the gap of the least turn.
        assert a.turn == pytest.approx(b.turn, abs=1e-3)


def test_an_introducer_is_free_space_too():
    duct = RoundCones(np.array([(0, 0, 0), (0, 0, 50)], dtype=float), np.array([5.0, 5.0]))
    outside = Introducer(entry=np.zeros(3), outward=np.array([0.0, 0.0, -1.0]), bore=5.0)
    given = {"length": 20.0, "clearance": 2.0}
    free = place_tail(
        FreeSpace(duct, introducer=outside), (0.0, 0.0, 1.0), old_tail=(0.0, 0.0, -19.0), **given
    )
    assert free.status == "free" and free.turn == pytest.approx(0.0, abs=1e-9)
    held = place_tail(duct, (0.0, 0.0, 1.0), old_tail=(0.0, 0.0, -19.0), **given)
    assert held.found and held.turn > 0.5 * np.pi


def test_where_none_fits_it_says_all():
    duct = make_pipes()["polygon"]
    placed = place_tail(duct, (30.0, 0.0), old_tail=(10.0, 0.0), length=400.0, clearance=2.5)
    assert (placed.status, placed.found) == ("infeasible", False)
    assert "no tail at 400 mm from the head (30, 0) has 2.5 mm from the wall" in placed.reason
    lacks = float(placed.reason.split("lacks ")[1].split(" mm")[0])
    assert lacks == pytest.approx(2.5 - placed.clearance, rel=0.06)
    assert placed.turn_bound == math.inf
    assert not math.isfinite(
        place_tail(duct, (30, 0), old_tail=(10, 0), length=9.0).clearance_bound
    )


@settings(max_examples=80)
@given(
    planar=st.booleans(),
    spare=st.floats(-6.0, -1.0).map(lambda power: 10.0**power),
    short=st.booleans(),
    turn=st.floats(0.5, 3.0),
)
def test_a_narrow_place_is_found_or_nothing_is_claimed(planar, spare, short, turn):
    # The sphere about the head runs through the middle of a ball: there is 1 mm, at one place.
    if planar:
        duct, old = Circles([(10.0, 0.0)], [1.0]), np.array([np.cos(turn), np.sin(turn)])
    else:
        duct = RoundCones([(10.0, 0.0, 0.0)], [1.0])
        old = np.array([np.cos(turn), 0.6 * np.sin(turn), 0.8 * np.sin(turn)])
    clearance = 1.0 + spare if short else 1.0 - spare
    head = np.zeros(len(old))
    placed = place_tail(duct, head, old_tail=9.0 * old, length=10.0, clearance=clearance)
    if placed.found:
        assert not short and placed.clearance >= clearance - 2e-9
        # Of the cap |x - c| <= spare the nearest direction is found, but for the slack.
        cap, sure = (2.0 * math.asin(max(s, 0.0) / 20.0) for s in (spare, spare - placed.slack))
        assert turn - cap - 1e-9 <= placed.turn <= turn + cap + 1e-9
        assert placed.turn_bound <= placed.turn
        if sure > 0.0:
            assert placed.turn_bound <= turn - sure + 1e-9 and placed.turn <= turn - sure + 1e-3
        return
    assert 1.0 <= placed.clearance_bound < clearance + placed.slack
    assert short or spare < 0.02 * placed.slack
    claims_proof = "to spare" not in placed.reason
    assert claims_proof == (placed.clearance_bound < clearance)


def test_every_pipe_is_tested():
    assert set(make_pipes()) == set(NAMES)
