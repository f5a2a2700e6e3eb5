from __future__ import annotations

import numpy as np
import pytest

from bozzini.continuum.kernels import energy as kernels
from bozzini.continuum.kernels.loads import locate_stations, measure_loads

SEGMENTS = 4


def draw_grid(rng, segment):
    spans = rng.uniform(3.0, 8.0, SEGMENTS)
    none = np.zeros((0, SEGMENTS + 1, 2)), np.zeros((0, SEGMENTS, 3, 4))
    return spans, np.ones((SEGMENTS, 3)), *none, np.zeros(0, dtype=np.int64), segment


def draw_spots(rng):
    parts = np.array([1.0, 0.3, 0.0, 0.7, 1.0, 0.5])
    return np.array([3, 2, 1, 0, 1, 3]), parts, rng.normal(size=(6, 3))


def measure(grid, turns, spots, loads):
    gradient, hessian = np.empty((SEGMENTS, 3)), np.empty((3 * SEGMENTS, 3 * SEGMENTS))
    potential = measure_loads(grid, turns, spots, loads, gradient, hessian)
    return potential, gradient.ravel(), hessian


def place(grid, turns, spots):
    count = len(spots[0])
    places, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    jacobians = np.empty((count, 6, 3 * SEGMENTS))
    locate_stations(grid, turns, spots, places, rotations, jacobians)
    return places, rotations, jacobians


def differentiate(function, turns, step=1e-5):
    """Central differences of fourth order of what a function of the turns returns."""
    columns = []
    for index in range(turns.size):
        change = np.zeros(turns.size)
        change[index] = step
        change = change.reshape(turns.shape)
        near = function(turns + change) - function(turns - change)
        far = function(turns + 2.0 * change) - function(turns - 2.0 * change)
        columns.append((8.0 * near - far) / (12.0 * step))
    return np.stack(columns, axis=-1)


def agree(found, wanted):
    scale = np.abs(wanted).max()
    assert found == pytest.approx(wanted, rel=1e-6, abs=1e-6 * scale)


@pytest.mark.parametrize("size", [0.0, 1e-4, 0.4, 1.5])
@pytest.mark.parametrize("segment", [kernels.CHORD, kernels.ARC, kernels.CHANNEL])
def test_places_turn_and_move_as_differences(size, segment) -> None:
    rng = np.random.default_rng(5)
    grid, spots = draw_grid(rng, segment), draw_spots(rng)
    turns = size * rng.normal(size=(SEGMENTS, 3))
    places, rotations, jacobians = place(grid, turns, spots)
    assert spots[1][0] == 1.0
    stations = np.empty((SEGMENTS + 1, 3, 3)), np.empty((SEGMENTS + 1, 3))
    kernels.fill_frames(grid, turns, *stations)
    assert rotations[0] == pytest.approx(stations[0][-1], abs=1e-12)
    ends = places[0] - rotations[0] @ spots[2][0]
    assert ends == pytest.approx(stations[1][-1], abs=1e-12)
    agree(jacobians[:, 3:], differentiate(lambda t: place(grid, t, spots)[0], turns))
    changes = differentiate(lambda t: place(grid, t, spots)[1], turns)
    spins = np.einsum("pijm,pkj->pikm", changes, rotations)
    agree(jacobians[:, 0], spins[:, 2, 1])
    agree(jacobians[:, 1], spins[:, 0, 2])
    agree(jacobians[:, 2], spins[:, 1, 0])


@pytest.mark.parametrize("size", [0.0, 1e-4, 0.4, 1.5])
@pytest.mark.parametrize("segment", [kernels.CHORD, kernels.ARC])
@pytest.mark.parametrize("kind", ["forces", "moments", "following", "all"])
def test_loads_have_the_derivatives_of_differences(size, segment, kind) -> None:
    rng = np.random.default_rng(7)
    grid, spots = draw_grid(rng, segment), draw_spots(rng)
    turns = size * rng.normal(size=(SEGMENTS, 3))
    forces, moments = rng.normal(size=(2, 6, 3))
    if kind == "forces":
        moments[:] = 0.0
    elif kind == "moments":
        forces[:] = 0.0
    follows = np.zeros(6, dtype=np.bool_)
    follows[:] = {"following": True, "all": rng.random(6) < 0.5}.get(kind, False)
    loads = forces, moments, follows
    _, gradient, hessian = measure(grid, turns, spots, loads)
    agree(hessian, differentiate(lambda t: measure(grid, t, spots, loads)[1], turns))
    if kind == "forces":
        slope = differentiate(lambda t: np.asarray(measure(grid, t, spots, loads)[0]), turns)
        agree(gradient, slope)
        agree(hessian, hessian.T)
    # Virtual work: every load by the motion of its point.
    _, rotations, jacobians = place(grid, turns, spots)
    turned = np.where(follows[:, None, None], rotations, np.eye(3))
    wrenches = np.concatenate(
        [np.einsum("pij,pj->pi", turned, moments), np.einsum("pij,pj->pi", turned, forces)], axis=1
    )
    agree(-gradient, np.einsum("pim,pi->m", jacobians, wrenches))
