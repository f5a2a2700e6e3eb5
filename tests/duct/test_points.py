"""A cloud of wall samples: what it encloses for certain, and what it says when it is open."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from bozzini.duct.base import Duct
from bozzini.duct.shapes.points import PointCloud
from bozzini.errors import GeometryError, InputError

RADIUS = 10.0


def sphere(subdivisions=3):
    """Samples of a sphere, and how far from one of them a place of it can be."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=RADIUS)
    corners = mesh.triangles
    sides = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2)
    # Of a small triangle on the sphere the farthest place is the middle of its circle.
    circle = sides.prod(axis=1) / (4.0 * mesh.area_faces)
    sagitta = RADIUS - np.sqrt(RADIUS**2 - circle.max() ** 2)
    return np.asarray(mesh.vertices), float(np.hypot(circle.max(), sagitta))


def scatter(random, count, reach=13.0):
    return random.uniform(-reach, reach, (count, 3))


def test_it_never_promises_more_room_than_the_wall_it_was_taken_from():
    points, spacing = sphere()
    duct = PointCloud(points, spacing, seeds=[(0, 0, 0)])
    places = scatter(np.random.default_rng(0), 100_000)
    true = np.linalg.norm(places, axis=1) - RADIUS
    value = duct.signed_distance(places)
    inside = value < 0.0
    assert np.all(value[inside] >= true[inside])
    assert np.all(value[inside] <= true[inside] + 2.0 * spacing)
    assert np.all(inside[true < -2.0 * spacing])
    assert not inside[true > 0.0].any()


def test_inside_it_is_the_distance_to_the_balls():
    points, spacing = sphere()
    duct = PointCloud(points, spacing, seeds=[(0, 0, 0)])
    random = np.random.default_rng(1)
    places = scatter(random, 3000)
    nearest = np.linalg.norm(places[:, None] - points, axis=-1).min(axis=1)
    value = duct.signed_distance(places)
    assert np.abs(value) == pytest.approx(np.abs(nearest - spacing), abs=1e-5 * spacing)
    other = places + random.normal(size=places.shape) * random.choice([1e-3, 0.4], (3000, 1))
    change = np.abs(duct.signed_distance(other) - value)
    assert np.all(change <= np.linalg.norm(other - places, axis=1) + 1e-11)
    foot = places - value[:, None] * duct.gradient(places)
    clear = value < 0.0
    assert np.abs(duct.signed_distance(foot[clear])).max() < 1e-9


def leaky_box(random):
    """A box of two chambers, its walls and the one between sampled so sparsely that some leak."""
    walls = random.uniform(-4.0, 4.0, (900, 3))
    walls[np.arange(900), random.integers(0, 3, 900)] = random.choice([-4.0, 4.0], 900)
    between = random.uniform(-4.0, 4.0, (140, 3))
    between[:, 0] = 0.0
    points = np.concatenate([walls, between])
    return points + 0.1 * random.normal(size=points.shape)


def count_what_balls_part(seed, spacing, step=0.25):
    """Ask a seed in every space that a grid finds; return how many were closed, and open."""
    from scipy import ndimage
    from scipy.spatial import cKDTree

    points = leaky_box(np.random.default_rng(seed))
    nodes = np.arange(-7.0, 7.0, step)
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1)
    far = cKDTree(points).query(grid)[0]
    # Joined for certain: neighbours whose free balls meet. Parted: not even by wider passages.
    joined, _ = ndimage.label(far > spacing + step)
    loose, _ = ndimage.label(far > spacing - step)
    closed = opened = 0
    for label in range(1, joined.max() + 1):
        places = np.argwhere(joined == label)
        first = tuple(places[0])
        if label == joined[0, 0, 0]:
            with pytest.raises(GeometryError, match="outside"):
                PointCloud(points, spacing, seeds=[grid[tuple(places[-1])]])
            opened += len(places)
        elif loose[first] != loose[0, 0, 0]:
            duct = PointCloud(points, spacing, seeds=[grid[first]])
            assert np.all(duct.signed_distance(grid[tuple(places.T)]) < 0.0)
            others = np.argwhere((joined > 0) & (loose != loose[first]))
            assert not np.any(duct.signed_distance(grid[tuple(others.T)]) < 0.0)
            closed += 1
    return closed, opened


def test_what_the_balls_part_is_what_a_fine_grid_finds():
    counts = [count_what_balls_part(k, spacing) for k in range(2) for spacing in (1.1, 1.4)]
    assert sum(closed for closed, _ in counts) >= 4
    assert max(closed for closed, _ in counts) >= 2  # both chambers, apart
    assert all(opened > 0 for _, opened in counts)


def test_seeds_and_normals_find_the_same_lumen():
    outer, spacing = sphere()
    inner = 0.5 * outer  # a body in the middle: the lumen is the shell between
    points = np.concatenate([outer, inner])
    normals = np.concatenate([outer, -inner])
    places = scatter(np.random.default_rng(2), 4000)
    by_seeds = PointCloud(points, spacing, seeds=[(7.5, 0, 0)])
    by_normals = PointCloud(points, spacing, normals=normals)
    value = by_seeds.signed_distance(places)
    assert np.array_equal(value, by_normals.signed_distance(places))
    assert float(by_seeds.signed_distance([0.0, 0.0, 0.0])) > 0.0
    assert (value < 0.0).sum() > 300
    with_both = PointCloud(points, spacing, seeds=[(7.5, 0, 0), (0, 0, 0)])
    assert float(with_both.signed_distance([0.0, 0.0, 0.0])) < 0.0


def test_an_opening_is_named_with_the_spacing_that_closes_it():
    points, spacing = sphere()
    hole = np.array([0.0, RADIUS, 0.0])
    cut = points[np.linalg.norm(points - hole, axis=1) > 2.5]
    with pytest.raises(
        GeometryError, match=r"seeds\[0\] .* is connected with the outside"
    ) as caught:
        PointCloud(cut, spacing, seeds=[(0, 0, 0)])
    text = str(caught.value)
    place = np.array(text.split("near (")[1].split(")")[0].split(","), dtype=float)
    assert np.linalg.norm(place - hole) < 3.5
    needed = float(text.split("must be at least ")[1].split(" mm")[0])
    assert 2.0 < needed < 3.5
    closed = PointCloud(cut, needed * 1.001, seeds=[(0, 0, 0)])
    assert float(closed.signed_distance([0.0, 0.0, 0.0])) < 0.0
    with pytest.raises(GeometryError, match="connected with the outside"):
        PointCloud(cut, needed * 0.999, seeds=[(0, 0, 0)])


def test_flat_walls_sampled_on_a_lattice_are_closed():
    side = np.linspace(-3.0, 3.0, 7)
    lattice = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1).reshape(-1, 3)
    points = lattice[np.abs(lattice).max(axis=1) == 3.0]
    duct = PointCloud(points, np.sqrt(0.5) * 1.001, seeds=[(0.1, 0.2, 0.3)])
    assert float(duct.signed_distance([0.0, 0.0, 0.0])) == pytest.approx(-3.0 + 0.7078, abs=1e-3)
    with pytest.raises(GeometryError, match=r"at least 0\.7071 mm"):
        PointCloud(points, np.sqrt(0.5) * 0.99, seeds=[(0.1, 0.2, 0.3)])


def test_kernels_get_a_rigorous_bound():
    points, spacing = sphere()
    duct = PointCloud(points, spacing, seeds=[(0, 0, 0)])
    places = scatter(np.random.default_rng(3), 20_000)
    field = duct.sample(0.7)
    assert np.all(field.clearance_bound(places) <= -duct.signed_distance(places) + 1e-6)
    assert field.wall_error == spacing == duct.wall_error
    assert (field.clearance_bound(places) > 0.0).sum() > 1000
    assert duct.to_world(duct.to_grid(places)) == pytest.approx(places, abs=1e-9)
    assert (field.exact_outside, field.reach) == (False, 0.0)
    with pytest.raises(InputError, match=r"voxel is 0\.01 mm: the grid would have 8"):
        duct.sample(0.01)
    with pytest.raises(InputError, match=r"voxel is 1e-300 mm: .* at least about 0\.0"):
        duct.sample(1e-300)


def test_it_is_a_duct():
    points, spacing = sphere(2)
    duct = PointCloud(points, spacing, seeds=[(0, 0, 0)])
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error) == ("bound", 0.0)
    assert duct.wall == f"balls of {spacing:g} mm about {len(points)} samples"
