"""The free chain: closed form against the equation, limits, orders, and slip's independence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bozzini.motion import move_free_chain


def random_chain(rng, joints=6, dim=3, length=1.0):
    links = rng.normal(size=(joints - 1, dim))
    links *= length / np.linalg.norm(links, axis=1, keepdims=True)
    return np.concatenate([np.zeros((1, dim)), np.cumsum(links, axis=0)]) + rng.normal(size=dim)


def link_lengths(chains):
    return np.linalg.norm(np.diff(chains, axis=-2), axis=-1)


def random_walk(rng, start, steps, size):
    moves = rng.normal(size=(steps, len(start)))
    moves *= size / np.linalg.norm(moves, axis=1, keepdims=True)
    return start + np.cumsum(moves, axis=0)


def angle_to(link, way):
    """Angle between tail-to-head and the way of the head."""
    return np.arctan2(np.linalg.norm(np.cross(-link, way)), -link @ way)


@pytest.mark.parametrize("length", [1.0, 7.5])
def test_a_tail_pulled_at_right_angles_runs_on_the_tractrix(length):
    # Thesis eq. 5.12: head along x from the origin, tail from (0, L):
    # x = s - L tanh(s/L), y = L / cosh(s/L)
    heads = np.stack([np.linspace(0.0, 5.0 * length, 41), np.zeros(41)], axis=1)
    moved = move_free_chain([[0.0, 0.0], [0.0, length]], heads)
    s = heads[:, 0] / length
    curve = length * np.stack([s - np.tanh(s), 1.0 / np.cosh(s)], axis=1)
    assert moved[:, 1] == pytest.approx(curve, abs=1e-12 * length)


@given(seed=st.integers(0, 10_000), size=st.floats(1e-3, 0.9), slip=st.floats(0.0, 1.0))
def test_two_half_steps_make_a_whole_one_and_a_step_back_undoes_it(seed, size, slip):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, joints=2)
    goal = random_walk(rng, chain[0], 1, size)[0]
    middle = 0.5 * (chain[0] + goal)
    options = {"slip": slip, "substep": 0.95}
    whole = move_free_chain(chain, [goal], **options)[-1]
    halves = move_free_chain(chain, [middle, goal], **options)[-1]
    back = move_free_chain(whole, [chain[0]], **options)[-1]
    assert halves == pytest.approx(whole, abs=1e-12)
    assert back == pytest.approx(chain, abs=1e-12)


@given(seed=st.integers(0, 10_000), slip=st.floats(0.0, 1.0))
def test_half_the_angle_to_the_way_shrinks_as_an_exponential(seed, slip):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, joints=2)
    way = random_walk(rng, np.zeros(3), 1, 1.0)[0]
    heads = chain[0] + np.linspace(0.0, 3.0, 10)[:, None] * way
    before = np.tan(0.5 * angle_to(chain[1] - chain[0], way))
    assume(before < 50.0)  # pushed head on, the angle is hardly known
    for head, moved in zip(heads, move_free_chain(chain, heads, slip=slip), strict=True):
        travel = np.linalg.norm(head - chain[0])
        after = np.tan(0.5 * angle_to(moved[1] - moved[0], way))
        assert after == pytest.approx(before * np.exp(-(1.0 - slip) * travel), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("slip", [0.0, 0.6])
def test_the_least_move_is_first_order_in_the_head_step(slip):
    chain = np.array([[0.0, 0.0], [0.6, 0.8]])
    goal = np.array([1.0, 0.0])
    exact = move_free_chain(chain, [goal], slip=slip)[-1, 1]
    errors = []
    for steps in (20, 40, 80, 160):
        heads = np.linspace(0.0, 1.0, steps + 1)[1:, None] * goal
        moved = move_free_chain(chain, heads, slip=slip, scheme="least")
        errors.append(np.linalg.norm(moved[-1, 1] - exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 1.9) & (ratios < 2.1))


def test_a_chain_is_second_order_in_the_substep():
    # Heads of later links run on curves, which are taken as straight over a substep.
    chain = random_chain(np.random.default_rng(3), joints=8, dim=2)
    heads = [chain[0] + [2.0, 0.5]]
    ends = [move_free_chain(chain, heads, substep=0.2 / 2**power)[-1] for power in (0, 1, 2, 3, 8)]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 3.5) & (ratios < 4.5))


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    slip=st.floats(0.0, 1.0),
    scheme=st.sampled_from(["exact", "least"]),
    dim=st.sampled_from([2, 3]),
)
def test_no_joint_moves_farther_than_the_one_before_it(seed, slip, scheme, dim):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, joints=12, dim=dim)
    # one straight step at a time: of at most the default substep
    heads = random_walk(rng, chain[0], 80, 0.1)
    moved = np.concatenate([chain[None], move_free_chain(chain, heads, slip=slip, scheme=scheme)])
    moves = np.linalg.norm(np.diff(moved, axis=0), axis=2)
    assert np.all(np.diff(moves, axis=1) <= 1e-12)
    assert link_lengths(moved) == pytest.approx(np.broadcast_to(1.0, (81, 11)), abs=1e-12)


def test_joints_towed_in_a_circle_settle_on_smaller_circles():
    # Steady state: each link is tangent to its tail's circle, R_k^2 = R^2 - k L^2.
    radius, links = 5.0, 8
    turns = np.linspace(0.0, 2.0 * np.pi * 15, 15 * 400 + 1)
    heads = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    chain = np.array([radius, 0.0]) + np.arange(links + 1)[:, None] * [0.0, -1.0]
    last = move_free_chain(chain, heads)[-1]
    expected = np.sqrt(radius**2 - np.arange(links + 1))
    assert np.linalg.norm(last, axis=1) == pytest.approx(expected, rel=1e-2)


@pytest.mark.parametrize("scheme", ["exact", "least"])
def test_slip_one_shifts_and_slip_zero_is_the_tractrix(scheme):
    rng = np.random.default_rng(5)
    chain = random_chain(rng)
    heads = random_walk(rng, chain[0], 30, 0.07)
    shifted = move_free_chain(chain, heads, slip=1.0, scheme=scheme)
    assert shifted == pytest.approx((heads - chain[0])[:, None] + chain, abs=1e-12)
    one = move_free_chain(chain, heads[:1], slip=1.0, scheme=scheme)[0]
    assert one == pytest.approx(heads[0] - chain[0] + chain, abs=2e-15)
    # nu = 0 by hand: the tail goes straight towards the head's new place (eq. 5.13)
    least = move_free_chain(chain, heads[:1], scheme="least")[0]
    way = chain[1] - heads[0]
    assert least[1] == pytest.approx(heads[0] + way / np.linalg.norm(way), abs=1e-14)


@given(seed=st.integers(0, 10_000), slip=st.floats(0.0, 1.0), shift=st.floats(-1000.0, 1000.0))
def test_slip_does_not_depend_on_where_the_origin_is(seed, slip, shift):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    heads = random_walk(rng, chain[0], 5, 0.3)
    there = move_free_chain(chain + shift, heads + shift, slip=slip)
    assert there - shift == pytest.approx(move_free_chain(chain, heads, slip=slip), abs=1e-9)


def test_the_printed_slip_vector_does_depend_on_it():
    # Appendix C prints s = nu X_h: the same move, seen from two origins, ends in two places,
    # and nu = 1 does not shift the link.
    def printed(chain, head, slip):
        way = chain[1] + slip * chain[0] - head
        return head + way / np.linalg.norm(way)

    chain = np.array([[0.5, 0.2, 0.1], [0.5, 1.2, 0.1]])
    move, origin = np.array([0.2, 0.1, -0.3]), np.array([3.0, 0.0, 0.0])
    here = printed(chain, chain[0] + move, 0.86)
    there = printed(chain + origin, chain[0] + origin + move, 0.86) - origin
    assert np.linalg.norm(here - there) > 0.1
    assert np.linalg.norm(printed(chain, chain[0] + move, 1.0) - chain[1] - move) > 0.1
    ours = move_free_chain(chain, [chain[0] + move], slip=1.0)[0]
    assert ours[1] == pytest.approx(chain[1] + move, abs=1e-14)


@given(seed=st.integers(0, 10_000), slip=st.floats(0.0, 0.99))
def test_slip_is_a_longer_link(seed, slip):
    # nu turns the direction as a tractrix of length L / (1 - nu) does.
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, joints=2)
    heads = random_walk(rng, chain[0], 1, 0.5)
    longer = chain[0] + (chain - chain[0]) / (1.0 - slip)
    slipped = move_free_chain(chain, heads, slip=slip)[0]
    pulled = move_free_chain(longer, heads, substep=0.95)[0]
    ours, theirs = slipped[1] - slipped[0], (pulled[1] - pulled[0]) * (1.0 - slip)
    assert ours == pytest.approx(theirs, abs=1e-11)


def test_planar_chain_in_space_stays_in_its_plane():
    rng = np.random.default_rng(8)
    flat = random_chain(rng, dim=2)
    heads = random_walk(rng, flat[0], 20, 0.2)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    assert move_free_chain(flat @ frame, heads @ frame) == pytest.approx(
        move_free_chain(flat, heads) @ frame, abs=1e-12
    )
