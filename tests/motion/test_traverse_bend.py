"""Longest links in a bend: closed forms, brute force, limits, and the thesis's hypothesis."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.motion.bends import bend_room, link_passes, pull_joints
from validation.thesis.traverse_bend import Bend, limit_by_turning
from validation.thesis.traverse_curvature import find_rolling_radius, measure_curve

bends = st.builds(
    lambda radius, wide, body: Bend(
        radius=radius, half_width=wide * radius, body_radius=body * wide * radius
    ),
    st.floats(1.0, 100.0),
    st.floats(0.02, 0.95),
    st.floats(0.0, 0.95),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius", "half_width", "body", "degrees"),
    [(3, 1, 0.0, 180), (3, 1, 0.4, 180), (30, 13, 5, 180), (2, 1.5, 0.5, 180)]
    + [(3, 1, 0.0, 90), (3, 1, 0.0, 60)],
)
def test_rigid_limit_against_a_search_of_all_poses(radius, half_width, body, degrees) -> None:
    bend = Bend(radius=radius, half_width=half_width, body_radius=body, angle=math.radians(degrees))
    search = {"bend": bend, "pad": 0.0, "nodes": 24, "turns": 240}
    assert link_passes(0.98 * bend.limit_rigid(), **search)
    assert not link_passes(1.02 * bend.limit_rigid(), **search)


def test_known_values() -> None:
    plain, human = Bend(radius=3, half_width=1), Bend(radius=30, half_width=13, body_radius=5)
    assert plain.limit_rigid() == pytest.approx(4 * math.sqrt(3))
    assert human.limit_rigid() == pytest.approx(61.97, abs=0.005)
    assert plain.limit_on_centreline() == pytest.approx(4.472, abs=5e-4)
    assert human.limit_on_centreline() == pytest.approx(40.8, abs=0.05)
    assert plain.limit_with_head_at(3.0) == pytest.approx(5.700, abs=5e-4)
    assert plain.limit_with_head_at(3.95) == pytest.approx(6.870, abs=5e-4)
    assert plain.limit_of_tractrix() == pytest.approx(math.sqrt(5))


@given(bends)
def test_the_limits_are_in_order_and_meet(bend: Bend) -> None:
    rigid = bend.limit_rigid()
    head = bend.limit_with_head_at(bend.radius)
    assert bend.limit_on_centreline() <= head * (1 + 1e-12)
    assert bend.limit_of_tractrix() <= head <= rigid * (1 + 1e-12)
    assert bend.limit_with_head_at(bend.outer) == pytest.approx(rigid, rel=1e-9)
    # Both walls tangent or touched: the chord's own distance says so.
    half = 0.5 * rigid
    assert math.hypot(bend.inner, half) == pytest.approx(bend.outer, rel=1e-9)


@given(bends, st.floats(0.01, 0.999))
def test_smaller_bends_allow_more_and_join_smoothly(bend: Bend, share: float) -> None:
    least = 2 * math.acos(bend.inner / bend.outer)

    def at(angle: float) -> float:
        return Bend(
            radius=bend.radius,
            half_width=bend.half_width,
            body_radius=bend.body_radius,
            angle=min(angle, math.pi),
        ).limit_rigid()

    assert at(share * least) >= bend.limit_rigid() * (1 - 1e-12)
    assert at(least * (1 - 1e-7)) == pytest.approx(bend.limit_rigid(), rel=1e-5)


@pytest.mark.parametrize("degrees", [20, 60, 110, 180])
def test_rigid_pose_touches_and_does_not_cut(degrees: int) -> None:
    bend = Bend(radius=5, half_width=2, body_radius=0.5, angle=math.radians(degrees))
    half, middle = 0.5 * bend.limit_rigid(), 0.5 * bend.angle
    out = np.array([-math.cos(middle), math.sin(middle)])
    along = np.array([math.sin(middle), math.cos(middle)])
    room = [
        bend_room(*(bend.inner * out + t * along), 3.0, 7.0, bend.angle)
        for t in np.linspace(-half, half, 401)
    ]
    assert min(room) == pytest.approx(0.5, abs=1e-9)
    assert room[0] == pytest.approx(0.5, abs=1e-9)
    assert room[200] == pytest.approx(0.5, abs=1e-9)


def test_flat_ends() -> None:
    thin = Bend(radius=30, half_width=13, body_radius=1e-9)
    assert thin.limit_rigid(flat_ends=True) == pytest.approx(thin.limit_rigid(), rel=1e-6)
    bend = Bend(radius=30, half_width=13, body_radius=5)
    half = 0.5 * bend.limit_rigid(flat_ends=True)
    assert math.hypot(17 + 10, half) == pytest.approx(43)  # its outer corner is on the wall


def test_no_inner_wall() -> None:
    bend = Bend(radius=1, half_width=3, body_radius=0.5)
    assert bend.limit_rigid() == 2 * 3.5
    assert bend.limit_on_centreline() == 2.0


@pytest.mark.parametrize(("radius", "half_width"), [(15, 3), (3, 1)])
@pytest.mark.parametrize("links", [1, 2])
def test_first_lock_of_joints_alone(radius: float, half_width: float, links: int) -> None:
    bend = Bend(radius=radius, half_width=half_width)
    lock = bend.first_joint_lock(links)
    walk = {"bend": bend, "links": links, "step": 0.005 * radius, "jump": 0.1 * radius}
    assert pull_joints(0.98 * lock, **walk)[0]
    assert not pull_joints(1.02 * lock, **walk)[0]


@pytest.mark.slow
def test_two_links_lock_before_one_does() -> None:
    bend = Bend(radius=15, half_width=3)
    assert bend.first_joint_lock() == 27.0
    walk = {"bend": bend, "step": 0.05, "jump": 1.5}
    locked = [n for n in range(20, 29) if not pull_joints(n, links=2, **walk)[0]]
    assert locked[0] == 25
    assert [n for n in range(20, 29) if not pull_joints(n, **walk)[0]][0] == 27


@pytest.mark.parametrize("length", [3.0, 4.0, 4.5, 4.9])
def test_links_that_pass_by_joints_alone_cut_the_wall(length: float) -> None:
    bend = Bend(radius=3, half_width=1)
    passed, depth = pull_joints(length, bend=bend)
    assert passed
    assert depth == pytest.approx(bend.measure_joint_only_depth(length), abs=1e-6)


@pytest.mark.parametrize("share", [0.98, 1.02])
def test_a_tractrix_pulled_round_for_long_settles_at_its_limit(share: float) -> None:
    bend = Bend(radius=3, half_width=1)
    length = share * bend.limit_of_tractrix()
    tail, nearest = np.array([-3.0, -length]), []
    for turn in np.arange(0.0, 30.0, 2e-3):
        head = 3.0 * np.array([-math.cos(turn), math.sin(turn)])
        tail = head + length * (tail - head) / np.linalg.norm(tail - head)
        along = tail - head
        u = min(max(-(head @ along) / length**2, 0.0), 1.0)
        nearest.append(float(np.linalg.norm(head + u * along)))
    assert nearest[-1] == pytest.approx(math.sqrt(9 - length**2), rel=5e-3)
    assert (min(nearest) >= bend.inner) is (share < 1.0)


@pytest.mark.parametrize("length", [1.99, 2.01])
def test_schur_bound_on_a_u_turn(length: float) -> None:
    def curve(s: np.ndarray) -> np.ndarray:  # radius 1
        turn = np.clip(s, 0.0, math.pi)
        rest = np.minimum(s, 0.0) - np.maximum(s - math.pi, 0.0)
        return np.stack([-np.cos(turn), np.sin(turn) + rest], axis=-1)

    heads = np.linspace(0.0, math.pi + 3.0, 1201)
    behind = np.linspace(0.0, 6.0, 6001)
    tails = []
    for head in heads:
        chord = np.linalg.norm(curve(head - behind) - curve(np.array(head)), axis=-1)
        first = int(np.argmax(chord >= length))  # the nearest one along the curve
        tails.append(head - behind[first] if chord[first] >= length else -np.inf)
    steps = np.diff(tails)
    steady = bool(np.all(steps > -2e-3) and steps.max() < 0.3)
    assert steady is (length < limit_by_turning(1.0))


def test_a_sine_lets_longer_links_pass_than_schur_says() -> None:
    # Sufficient, not necessary: chords of 3 times the radius keep less than 90 degrees.
    x = np.linspace(0.0, 6 * math.pi, 6001)
    curve = np.stack([x, np.sin(x)], axis=1)  # smallest radius 1
    tangent = np.stack([np.ones_like(x), np.cos(x)], axis=1)
    gaps = np.linalg.norm(curve[:, None, :] - curve[None, ::10, :], axis=-1)
    i, j = np.nonzero(abs(gaps - 3.0) < 5e-3)
    chord = curve[10 * j] - curve[i]
    chord *= np.sign(10 * j - i)[:, None]
    assert np.sum(chord * tangent[i], axis=1).min() > 0.0
    assert limit_by_turning(1.0) < 3.0


@pytest.mark.slow
def test_the_thesis_hypothesis_is_refuted_for_ducts() -> None:
    # Both walls of the ring 9..10 let circles of radius up to 10 roll; links of 20 do not fit.
    bend = Bend(radius=9.5, half_width=0.5, angle=math.pi / 3)
    assert limit_by_turning(1 / 10) == 20.0
    assert limit_by_turning(0.0) == math.inf
    assert bend.limit_rigid() == pytest.approx(2 * math.sqrt(19))
    search = {"bend": bend, "pad": 0.0, "nodes": 14, "turns": 240}
    assert link_passes(8.5, **search)
    assert not link_passes(8.9, **search)
    assert not link_passes(20.0, **search)


def test_under_one_curve_the_link_rides_in_the_rolling_circle() -> None:
    # The circle that fits the troughs of a sine rolls along all of it, from above; so does any
    # diameter of it, whatever way it is turned.
    x = np.linspace(-40.0, 40.0, 8001)
    height, slope = 2.0 * np.sin(0.2 * x), 0.4 * np.cos(0.2 * x)
    first, second = np.stack([np.ones_like(x), slope]), np.stack([0.0 * x, -0.08 * np.sin(0.2 * x)])
    radius = find_rolling_radius(measure_curve(first.T, second.T))
    assert radius == pytest.approx(12.5, rel=1e-3)
    normal = np.stack([-slope, np.ones_like(x)]) / np.hypot(slope, 1.0)
    centres = np.stack([x, height]) + 0.999 * radius * normal
    turn, along = np.meshgrid(np.linspace(0.0, math.pi, 37), np.linspace(-1.0, 1.0, 41))
    for k in range(2000, 6001, 100):
        u = centres[0, k] + 0.999 * radius * along * np.cos(turn)
        v = centres[1, k] + 0.999 * radius * along * np.sin(turn)
        assert (v - 2.0 * np.sin(0.2 * u)).min() > -1e-6
