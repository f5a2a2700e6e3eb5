"""One constrained link: the nearest feasible tail, against closed form, brute force and SLSQP."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from bozzini.motion import FreeSpace
from bozzini.motion.kernels.chain import place_tail
from tests.shapes import bend_curve, curve_distance, sample_field


@pytest.fixture(scope="module")
def tube():
    curve = bend_curve(14.0, 2.0, 25.0)
    return sample_field(
        curve_distance(curve, 6.0), curve.min(axis=0) - 9.0, curve.max(axis=0) + 9.0, 1.0
    )


def solve(field, head, old, length, room):
    tail = np.empty(3)
    code, best = place_tail(
        FreeSpace(field).pack(),
        field.to_grid(head),
        field.to_grid(old),
        length,
        room,
        3**0.5,
        False,
        np.empty((6, 5)),
        tail,
    )
    return code, best, field.to_world(tail)


def draw_link(field, random, length):
    """A head inside the tube, and an old tail about a link away."""
    while True:
        head = random.uniform(*field.bounds)
        if field.signed_distance(head) < -1.5:
            break
    old = head + random.normal(size=3)
    unit = (old - head) / np.linalg.norm(old - head)
    return head, head + unit * length * random.uniform(0.9, 1.1)


def test_free_link_is_the_tractrix_step(tube):
    head, old = np.array([0.5, 0.3, -19.0]), np.array([0.1, 0.2, -23.0])
    code, _, tail = solve(tube, head, old, 4.1, 1.0)
    expected = head + 4.1 * (old - head) / np.linalg.norm(old - head)
    assert code == 0
    assert tail == pytest.approx(expected, abs=1e-12)


def sphere_points(count=200_000):
    """Directions spread evenly over the sphere (Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1
    )


DIRECTIONS = sphere_points()


@settings(max_examples=60)
@given(
    seed=st.integers(0, 100_000),
    length=st.floats(2.0, 20.0),
    room=st.floats(0.0, 3.0),
    head_step=st.floats(0.01, 0.5),
)
def test_after_a_head_step_no_feasible_tail_is_nearer(tube, seed, length, room, head_step):
    random = np.random.default_rng(seed)
    head, old = draw_link(tube, random, length)
    code, _, old = solve(tube, head, old, length, room)
    if code == 3:
        return
    turn = random.normal(size=3)
    moved = head + head_step * turn / np.linalg.norm(turn)
    code, _, tail = solve(tube, moved, old, length, room)
    if code == 3:
        return
    assert np.linalg.norm(tail - moved) == pytest.approx(length, abs=1e-9)
    assert tube.signed_distance(tail) + room <= 2e-9
    assert _is_local_minimum(tube, moved, old, tail, length, room)


@settings(max_examples=60)
@given(seed=st.integers(0, 100_000), length=st.floats(2.0, 20.0), room=st.floats(0.0, 3.0))
def test_from_anywhere_the_tail_is_feasible_or_none_is(tube, seed, length, room):
    random = np.random.default_rng(seed)
    head, old = draw_link(tube, random, length)
    code, best, tail = solve(tube, head, old, length, room)
    scan = head + length * DIRECTIONS
    value = tube.signed_distance(scan) + room
    if code == 3:
        # Nothing feasible was found: nor does the scan find anything, and the best is the best.
        assert value.min() > -0.05
        assert best == pytest.approx(value.min(), abs=0.15)
        return
    assert np.linalg.norm(tail - head) == pytest.approx(length, abs=1e-9)
    assert tube.signed_distance(tail) + room <= 2e-9


def _is_local_minimum(field, head, old, tail, length, room):
    """Whether no feasible point near `tail` on the sphere is nearer to `old`."""
    away = np.linalg.norm(DIRECTIONS - (tail - head) / length, axis=1) < 0.12
    near = head + length * DIRECTIONS[away]
    feasible = field.signed_distance(near) + room <= 0.0
    if not feasible.any():
        return True
    gap = np.linalg.norm(near[feasible] - old, axis=1).min()
    return np.linalg.norm(tail - old) <= gap + 1e-6


def test_agrees_with_slsqp_on_the_printed_problem_for_small_head_steps(tube):
    random = np.random.default_rng(5)
    length, room, compared = 8.0, 2.0, 0
    while compared < 25:
        head, old = draw_link(tube, random, length)
        _, _, start = solve(tube, head, old, length, room)
        if tube.signed_distance(start) + room > 1e-8:
            continue
        moved = head + 0.25 * random.normal(size=3) / 3**0.5
        code, _, tail = solve(tube, moved, start, length, room)
        if code != 1:
            continue
        result = minimize(
            lambda x, old=start: ((x - old) ** 2).sum(),
            start,
            constraints=[
                {"type": "eq", "fun": lambda x, head=moved: np.linalg.norm(x - head) - length},
                {"type": "ineq", "fun": lambda x: -room - tube.signed_distance(x)},
            ],
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 200},
        )
        if not result.success or tube.signed_distance(result.x) + room > 1e-6:
            continue
        compared += 1
        assert np.linalg.norm(tail - start) <= np.linalg.norm(result.x - start) + 1e-5


def test_no_direction_feasible_is_said_with_the_best_one(tube):
    head = np.array([14.0, 0.0, 14.0])
    code, best, tail = solve(tube, head, head + [0.0, 30.0, 0.0], 60.0, 1.0)
    assert code == 3
    assert best > 0.0
    assert tube.signed_distance(tail) + 1.0 == pytest.approx(best)
