"""The sampled field: interpolation, gradient, frames, what lies beyond the grid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from bozzini.duct import Duct
from tests.shapes import ball_distance, sample_field


@pytest.fixture(scope="module")
def ball():
    return sample_field(ball_distance((0, 0, 0), 6.0), (-8, -8, -8), (8, 8, 8), 1.0)


def test_value_is_the_trilinear_interpolant(ball):
    random = np.random.default_rng(0)
    points = random.uniform(-8, 8, (500, 3))
    index = ((points - ball.origin) / ball.spacing).T
    reference = map_coordinates(ball.values.astype(float), index, order=1)
    assert ball.signed_distance(points) == pytest.approx(reference, abs=1e-9)


def test_gradient_is_the_slope_of_the_interpolant(ball):
    random = np.random.default_rng(1)
    cell = random.integers(0, 15, (300, 3)) + random.uniform(0.1, 0.9, (300, 3))
    points = ball.to_world(cell)
    step = 1e-5
    for axis in range(3):
        shift = np.zeros(3)
        shift[axis] = step
        slope = ball.signed_distance(points + shift) - ball.signed_distance(points - shift)
        assert ball.gradient(points)[:, axis] == pytest.approx(slope / (2 * step), abs=1e-6)


def test_beyond_the_grid_the_answer_stays_an_upper_bound_and_continuous(ball):
    random = np.random.default_rng(2)
    points = random.uniform(-30, 30, (2000, 3))
    exact = np.linalg.norm(points, axis=1) - 6.0
    assert np.all(ball.signed_distance(points) >= exact - ball.error)
    edge = np.array([8.0, 1.3, -2.2])
    outside, inside = ball.signed_distance([edge + [1e-9, 0, 0], edge - [1e-9, 0, 0]])
    assert outside == pytest.approx(inside, abs=1e-7)


def test_beyond_the_grid_the_distance_is_over_by_no_more_than_either_part(ball):
    points = np.random.default_rng(5).uniform(-30, 30, (2000, 3))
    exact = np.linalg.norm(points, axis=1) - 6.0
    nearest = np.clip(points, -8.0, 8.0)
    away, there = np.linalg.norm(points - nearest, axis=1), ball.signed_distance(nearest)
    over = ball.signed_distance(points) - exact
    assert np.all(over <= np.minimum(away, np.maximum(there, 0.0)) + ball.error)
    assert np.all(ball.clearance_bound(points) <= -exact)
    # And the gradient is the slope there too, off the planes between cells.
    step = 1e-6
    cell = np.abs(nearest - np.rint(nearest))
    good = np.all((cell > 1e-3) | (np.abs(nearest) == 8.0), axis=1)
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        slope = ball.signed_distance(points + shift) - ball.signed_distance(points - shift)
        assert ball.gradient(points)[good, axis] == pytest.approx(
            slope[good] / (2.0 * step), abs=1e-5
        )


def test_frames_are_inverse_and_batches_equal_single_points(ball):
    random = np.random.default_rng(3)
    points = random.uniform(-7, 7, (4, 5, 3))
    assert ball.to_world(ball.to_grid(points)) == pytest.approx(points)
    batch = ball.signed_distance(points)
    assert batch.shape == (4, 5)
    assert batch[2, 3] == ball.signed_distance(points[2, 3])
    assert ball.gradient(points).shape == (4, 5, 3)


def test_inflation_moves_the_wall_and_adds_up(ball):
    points = np.random.default_rng(4).uniform(-7, 7, (50, 3))
    twice = ball.inflate(1.0).inflate(0.5)
    assert twice.inflation == 1.5
    assert twice.signed_distance(points) == pytest.approx(ball.signed_distance(points) - 1.5)


def test_bounds_hold_the_lumen_and_it_is_a_duct(ball):
    assert isinstance(ball, Duct)
    assert np.all(ball.bounds[0] <= -6.0) and np.all(ball.bounds[1] >= 6.0)
    assert 0.866 < ball.error < 0.867
