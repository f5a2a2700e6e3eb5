"""Compiled small linear algebra and rotations against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from bozzini.numeric.kernels.linear_algebra import (
    factor_cholesky,
    invert_three,
    solve_bounded,
    solve_complementary,
    solve_lower,
    solve_three,
    solve_upper,
)
from bozzini.numeric.kernels.rotations import fill_quaternion_rotation, find_turn, turn_quaternion

seeds = st.integers(0, 10**6)


def draw(seed: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A symmetric positive matrix and a vector."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size), random.normal(size=size)


@given(seed=seeds, size=st.integers(1, 8), shift=st.floats(0.0, 1.0))
def test_cholesky_solves_in_place_too(seed: int, size: int, shift: float) -> None:
    matrix, vector = draw(seed, size)
    wanted = np.linalg.solve(matrix + shift * np.eye(size), vector)
    factor = matrix.copy()
    assert factor_cholesky(factor, size, shift, 1e-14, factor)
    solve_lower(factor, vector, size)
    solve_upper(factor, vector, size)
    assert vector == pytest.approx(wanted, rel=1e-8, abs=1e-9)


@given(seed=seeds)
def test_three_by_three_is_solved_and_inverted(seed: int) -> None:
    matrix, vector = draw(seed, 3)
    found, inverse = np.empty(3), np.empty((3, 3))
    assert solve_three(matrix, vector, np.zeros(3), found)
    assert invert_three(matrix, np.zeros(3), inverse)
    assert found == pytest.approx(np.linalg.solve(matrix, vector), rel=1e-9, abs=1e-11)
    assert inverse == pytest.approx(np.linalg.inv(matrix), rel=1e-9, abs=1e-11)


def test_what_is_not_positive_is_refused() -> None:
    matrix = np.diag([1.0, -1.0, 1.0])
    assert not factor_cholesky(matrix, 3, 0.0, 0.0, np.zeros((3, 3)))
    assert not solve_three(matrix, np.ones(3), np.zeros(3), np.empty(3))
    assert not invert_three(np.eye(3), np.array([0.0, 0.0, 2.0]), np.empty((3, 3)))


@given(seed=seeds, size=st.integers(1, 6))
def test_bounded_problem_has_the_minimum_of_scipy(seed: int, size: int) -> None:
    matrix, vector = draw(seed, size)
    random = np.random.default_rng(seed + 1)
    low, high = -random.uniform(0.0, 1.0, size), random.uniform(0.1, 1.0, size)
    root = np.linalg.cholesky(matrix).T
    wanted = lsq_linear(root, -np.linalg.solve(root.T, vector), (low, high), tol=1e-14).x
    found = np.zeros(size)
    assert solve_bounded(matrix, vector, low, high, found)
    cost = [0.5 * x @ matrix @ x + vector @ x for x in (found, wanted)]
    assert cost[0] <= cost[1] + 1e-9 * (1.0 + abs(cost[1]))
    assert np.all((found >= low) & (found <= high))


@given(seed=seeds, size=st.integers(1, 8), odd=st.floats(0.0, 10.0))
def test_what_is_not_symmetric_is_solved_between_bounds(seed: int, size: int, odd: float) -> None:
    matrix, vector = draw(seed, size)
    random = np.random.default_rng(seed + 1)
    part = random.normal(size=(size, size))
    matrix = matrix + odd * (part - part.T)
    low, high = -random.uniform(0.0, 1.0, size), random.uniform(0.0, 1.0, size)
    # There is one answer, wherever it starts.
    found, other = low.copy(), high.copy()
    assert solve_complementary(matrix, vector, low, high, found)
    assert solve_complementary(matrix, vector, low, high, other)
    assert found == pytest.approx(other, abs=1e-9)
    rest = matrix @ found + vector
    assert np.all((found >= low) & (found <= high))
    assert np.all(rest[found > low] <= 1e-9) and np.all(rest[found < high] >= -1e-9)


@given(seed=seeds)
def test_quaternions_turn_as_scipy_does(seed: int) -> None:
    one, other = Rotation.random(2, random_state=seed)
    first, second = (np.roll(turn.as_quat(), 1) for turn in (one, other))
    matrix, turn, back = np.empty((3, 3)), np.empty(3), np.empty(4)
    fill_quaternion_rotation(*first, matrix)
    assert matrix == pytest.approx(one.as_matrix(), abs=1e-12)
    find_turn(first, second, turn)
    assert turn == pytest.approx((one.inv() * other).as_rotvec(), abs=1e-9)
    turn_quaternion(first, turn, back)
    assert abs(back @ second) == pytest.approx(1.0, abs=1e-12)
