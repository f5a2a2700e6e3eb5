"""A wall that moves: bounds and nodes never promise more than the moved mesh, and say so if not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bozzini.anatomy import Peristalsis, SurfaceTract, make_phantom
from bozzini.duct import MovingField, build_field, carry_tissue, find_centreline, trace_back
from bozzini.errors import BozziniError, DeformationError, InputError
from tests.exact import MeshWall
from tests.human import load_human
from tests.waves import Waves

RADIUS = 3.0


def make_tube(radius=6.0, length=60.0, spacing=1.0, bend=45.0):
    """Return a closed tube along an arc as a surface, and its middle line."""
    angle = np.linspace(0.0, length / bend, round(length / spacing) + 1)
    line = bend * np.stack([1.0 - np.cos(angle), 0.0 * angle, np.sin(angle)], axis=1)
    across = np.stack([np.cos(angle), 0.0 * angle, -np.sin(angle)], axis=1)
    return sweep_tube(line, across, radius=radius, spacing=spacing), line


def sweep_tube(line, across, *, radius, spacing=1.0):
    """Return a closed tube round a line (n, 3), on which `across` (n, 3) stands upright."""
    turns = max(12, round(2.0 * np.pi * radius / spacing))
    rings = len(line)
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(turns) / turns
    ring = (
        line[:, None]
        + radius * np.cos(turn)[None, :, None] * across[:, None]
        + radius * np.sin(turn)[None, :, None] * np.cross(ahead, across)[:, None]
    )
    vertices = [*ring.reshape(-1, 3)]
    index = np.arange(rings * turns).reshape(rings, turns)
    a, b = index[:-1], np.roll(index[:-1], -1, axis=1)
    c, d = index[1:], np.roll(index[1:], -1, axis=1)
    faces = [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)]
    # Caps of rings, so that no side is long.
    for end, out in ((0, False), (rings - 1, True)):
        outer = index[end]
        for share in np.arange(1.0 - spacing / radius, 0.0, -spacing / radius):
            first = len(vertices)
            vertices += [*(line[end] + share * (ring[end] - line[end]))]
            inner = first + np.arange(turns)
            p, q = np.roll(outer, -1), np.roll(inner, -1)
            cap = np.concatenate([np.stack([outer, p, inner], -1), np.stack([p, q, inner], -1)])
            faces.append(cap if not out else cap[:, ::-1])
            outer = inner
        vertices.append(line[end])
        tip = np.stack([outer, np.roll(outer, -1), np.full(turns, len(vertices) - 1)], -1)
        faces.append(tip if not out else tip[:, ::-1])
    return SurfaceTract(
        vertices=np.array(vertices), faces=np.concatenate(faces)[:, ::-1], source="tube"
    )


@pytest.fixture(scope="module")
def tube():
    surface, line = make_tube()
    return surface, build_field(surface, voxel=1.0), line


def move_mesh(surface, displacement):
    return MeshWall(surface.vertices + displacement(surface.vertices), surface.faces)


def list_nodes(field):
    """Return the nodes that promise something, and what, world frame [mm]."""
    index = np.argwhere(field.values < 0.0)
    return field.to_world(index * field.spacing), -field.values[tuple(index.T)]


def bound_by_hand(field, waves, points):
    """The integral of the least singular value, from the field at rest, in plain NumPy."""
    stretch = np.linalg.svd(np.eye(3) + waves.gradient(points), compute_uv=False)[:, -1]
    depth, bend = np.maximum(field.clearance_bound(points), 0.0), waves.second_bound
    depth = np.minimum(depth, stretch / bend)
    return depth * (stretch - 0.5 * bend * depth)


def check_bound(field, wall, points, waves):
    exact = wall.clearance(points + waves(points))
    proved = bound_by_hand(field, waves, points)
    inside = field.clearance_bound(points) > 0.0
    # Between its corners a triangle is flat, the deformed wall is not: that is what 0.01 mm is for.
    assert (proved - exact)[inside].max() <= 0.01
    assert np.median((proved / exact)[inside]) > 0.5
    return int(inside.sum())


def check_band(tract, field, line, waves, *, exact=True):
    moving = MovingField(field, tract if exact else None)
    path = line + waves(line)
    found = moving.update(waves, **waves.bounds, path=path, radius=RADIUS)
    nodes, promised = list_nodes(found)
    wall = move_mesh(tract, waves)
    true = wall.clearance(nodes)
    assert (promised - true).max() <= 1e-5
    return found, promised, true


@pytest.mark.parametrize("steepness", [0.05, 0.2])
def test_the_bound_is_below_the_distance_to_the_moved_mesh(tube, steepness):
    surface, field, _ = tube
    random = np.random.default_rng(3)
    waves = Waves(random, steepness, shortest=40.0)
    points = random.uniform(*field.bounds, (4000, 3))
    assert check_bound(field, move_mesh(surface, waves), points, waves) > 200


@pytest.mark.parametrize("exact", [True, False])
def test_nodes_of_the_band_are_below_the_distance_to_the_moved_mesh(tube, exact):
    surface, field, line = tube
    waves = Waves(np.random.default_rng(5), 0.2, shortest=40.0)
    found, promised, true = check_band(surface, field, line, waves, exact=exact)
    assert found.band > len(promised) > 1000
    assert (found.measured > 100) == exact
    near = (true > RADIUS - 0.5) & (true < RADIUS + 0.5)
    lost = np.median((true - promised)[near])
    # What is measured is exact up to rounding, what is bounded is not.
    assert (lost < 1e-5) == exact


def test_where_nothing_moves_the_field_is_as_at_rest(tube):
    surface, field, line = tube
    moving = MovingField(field, surface)
    found = moving.update(
        np.zeros_like, gradient_bound=0.0, second_bound=0.0, path=line, radius=RADIUS
    )
    nodes, promised = list_nodes(found)
    still = -field.signed_distance(nodes)
    assert np.all(promised <= still + 1e-5)
    near = np.abs(still - RADIUS) < 0.5
    assert promised[near] == pytest.approx(still[near], abs=1e-5)
    # In the field's own bound, which holds between nodes too.
    inner = line[5:-5]
    with pytest.raises(InputError, match="distance is 1 mm: it must be 0 mm"):
        found.inflate(1.0)
    assert np.all(found.clearance_bound(inner) <= field.clearance_bound(inner) + 1e-5)
    assert found.clearance_bound(inner).min() > RADIUS


def test_a_rigid_move_moves_the_distances(tube):
    surface, field, line = tube
    shift = np.array([3.0, -2.0, 4.0])  # whole cells
    found = MovingField(field, surface).update(
        lambda points: np.broadcast_to(shift, points.shape),
        gradient_bound=0.0,
        second_bound=0.0,
        path=line + shift,
        radius=RADIUS,
    )
    rest = MovingField(field, surface).update(
        np.zeros_like, gradient_bound=0.0, second_bound=0.0, path=line, radius=RADIUS
    )
    assert found.clearance_bound(line + shift) == pytest.approx(
        rest.clearance_bound(line), abs=1e-5
    )


def test_a_second_frame_does_not_depend_on_the_first(tube):
    # Searches begin at the triangle that was nearest in the last frame; the answer is the same.
    surface, field, line = tube
    random = np.random.default_rng(11)
    first, second = (Waves(random, 0.15, shortest=40.0) for _ in range(2))
    moving = MovingField(field, surface)
    moving.update(first, **first.bounds, path=line + first(line), radius=RADIUS)
    after = moving.update(second, **second.bounds, path=line + second(line), radius=RADIUS)
    fresh, *_ = check_band(surface, field, line, second)
    assert np.array_equal(after.values, fresh.values)
    assert after.values is not fresh.values


@pytest.mark.parametrize("share", [0.95, 0.5, 0.0])
@pytest.mark.parametrize("which", ["gradient_bound", "second_bound"])
@pytest.mark.parametrize("seed", range(4))
def test_a_frame_that_breaks_its_bounds_is_refused(tube, which, share, seed):
    surface, field, line = tube
    # One wave in any direction: its bounds are reached. With them it is taken, with less not.
    waves = Waves(np.random.default_rng(seed), 0.3, count=1, shortest=15.0)
    moving = MovingField(field, surface)
    path = line + waves(line)
    moving.update(waves, **waves.bounds, path=path, radius=RADIUS)
    broken = {**waves.bounds, which: share * waves.bounds[which]}
    with pytest.raises(DeformationError, match="stated"):
        moving.update(waves, **broken, path=path, radius=RADIUS)


@pytest.mark.parametrize("width", [1.0, 3.0])
def test_a_bump_in_the_lumen_that_breaks_the_bounds_is_refused(tube, width):
    surface, field, line = tube
    random = np.random.default_rng(8)
    waves = Waves(random, 0.1, shortest=40.0)
    # Twice as steep as stated, in one place within the lumen; the wall hardly moves with it.
    height = 0.2 * width / np.exp(-0.5)
    for middle in line[10:-10:9] + random.uniform(-1.5, 1.5, 3):

        def bump(points, middle=middle):
            away = ((points - middle) ** 2).sum(axis=1)
            return waves(points) + height * np.exp(-away / (2.0 * width**2))[:, None] * [
                0,
                0.6,
                0.8,
            ]

        for moving in (MovingField(field, surface), MovingField(field)):
            with pytest.raises(DeformationError, match="stated"):
                moving.update(bump, **waves.bounds, path=line + waves(line), radius=RADIUS)


def test_vertices_of_another_frame_are_refused(tube):
    surface, field, line = tube
    waves = Waves(np.random.default_rng(1), 0.1)
    moving = MovingField(field, surface)
    given = {**waves.bounds, "path": line + waves(line), "radius": RADIUS}
    moved = surface.vertices + waves(surface.vertices)
    same = moving.update(waves, vertices=moved, **given)
    assert np.array_equal(same.values, moving.update(waves, **given).values)
    # One vertex is enough, in any frame.
    for which in np.random.default_rng(0).integers(0, len(moved), 5):
        other = moved.copy()
        other[which] += 0.01
        with pytest.raises(DeformationError, match=f"vertex {which} is 0.0173 mm.*of one frame"):
            moving.update(waves, vertices=other, **given)
    with pytest.raises(InputError, match="vertices have shape"):
        moving.update(waves, vertices=moved[:-1], **given)
    with pytest.raises(InputError, match="no surface"):
        MovingField(field).update(waves, vertices=moved, **given)


def test_vertices_alone_give_the_exact_distance_at_all_nodes(tube):
    surface, field, line = tube
    moving = MovingField(field, surface)
    for waves in (Waves(np.random.default_rng(6), 0.2, shortest=40.0), np.zeros_like):
        moved, path = surface.vertices + waves(surface.vertices), line + waves(line)
        found = moving.update(vertices=moved, path=path, radius=RADIUS)
        nodes, promised = list_nodes(found)
        true = MeshWall(moved, surface.faces).clearance(nodes)
        # Measured up to 2.1 mm more than the radius.
        assert promised == pytest.approx(np.minimum(true, RADIUS + 2.1), abs=1e-5)
        assert (promised - true).max() <= 1e-5
        assert found.measured >= len(promised) > 1000
        if isinstance(waves, Waves):
            both = moving.update(waves, **waves.bounds, path=path, radius=RADIUS)
            near = np.abs(promised - RADIUS) < 0.5
            again = -both.signed_distance(nodes[near])
            assert again == pytest.approx(promised[near], abs=1e-5)
    # Turned by a right angle no displacement would be steep enough to be taken; the mesh is.
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = moving.update(vertices=surface.vertices @ quarter, path=line @ quarter, radius=RADIUS)
    assert turned.clearance_bound(line @ quarter)[5:-5].min() > RADIUS
    with pytest.raises(DeformationError, match="a side of the wall"):
        moving.update(
            vertices=surface.vertices @ quarter, gradient_bound=0.9, path=line, radius=RADIUS
        )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"displacement": None}, "nothing was given that moves"),
        ({"displacement": 3.0}, "the displacement is a float: it must be a function"),
        ({"second_bound": None}, "give its gradient_bound and second_bound"),
        ({"displacement": None, "vertices": np.full((3, 3), np.nan)}, "vertices"),
        ({"gradient_bound": 1.0}, "gradient bound is 1: it must lie in"),
        ({"second_bound": -1.0}, "second bound is -1"),
        ({"radius": np.nan}, "radius is nan"),
        ({"path": np.zeros((1, 3))}, "path has shape"),
        ({"displacement": lambda points: points[1:]}, "they must agree"),
        ({"displacement": lambda points: np.nan * points}, "displacement of the tissue.*finite"),
        ({"path": [[0.0, 0.0, 0.0], [1e6, 1e6, 1e6]]}, r"path spans 1e\+06 mm"),
    ],
)
def test_a_wrong_argument_is_one_line(tube, changed, message):
    surface, field, line = tube
    given = {
        "displacement": np.zeros_like,
        "gradient_bound": 0.1,
        "second_bound": 0.1,
        "path": line,
        "radius": RADIUS,
    }
    with pytest.raises(BozziniError, match=message):
        MovingField(field, surface).update(**{**given, **changed})


def test_an_inflated_field_is_refused():
    surface, _ = make_tube(length=20.0)
    field = build_field(surface, voxel=1.0, inflate=1.0)
    with pytest.raises(InputError, match="inflated by 1 mm"):
        MovingField(field, surface)
    other, _ = make_tube(radius=9.0, length=20.0)
    with pytest.raises(InputError, match="do not belong together"):
        MovingField(field.inflate(-1.0), other)
    with pytest.raises(InputError, match="must be a SampledField"):
        MovingField(surface)
    with pytest.raises(InputError, match="the surface is a str: it must be a SurfaceTract"):
        MovingField(field.inflate(-1.0), "tube.stl")


def test_tissue_is_carried_there_and_back():
    random = np.random.default_rng(4)
    one, other = Waves(random, 0.3), Waves(random, 0.4)
    points = random.uniform(-50.0, 50.0, (200, 3))
    assert trace_back(points + one(points), one) == pytest.approx(points, abs=1e-6)
    there = carry_tissue(points, one, now=other)
    assert carry_tissue(there, other, now=one) == pytest.approx(points, abs=1e-6)
    with pytest.raises(DeformationError, match="could not be traced back.*gradient is 2, it must"):
        trace_back(points, lambda places: -2.0 * places)


@pytest.mark.parametrize("depth", [0.5, 0.95])
def test_tissue_is_carried_through_a_deep_wave(depth):
    line = np.stack([np.zeros(40), 10.0 * np.sin(np.linspace(0, 2, 40)), np.arange(40.0)], axis=1)
    ring = Peristalsis(line=line, depth=depth, width=3.0, wave_speed=5.0).at(4.0)
    points = np.random.default_rng(2).uniform([-9.0, -5.0, -5.0], [9.0, 15.0, 45.0], (500, 3))
    assert np.abs(ring(points)).max() > 0.5
    assert trace_back(points + ring(points), ring) == pytest.approx(points, abs=1e-5)


@pytest.mark.slow
def test_no_bound_is_too_large_in_a_phantom_and_a_human_tract(upper_gi_dir):
    # 6 random fields, and 6e4 points in all.
    random = np.random.default_rng(7)
    checked = 0
    phantom = make_phantom().to_surface(1.5)
    made = build_field(phantom, voxel=1.0)
    for (surface, field, line), steepnesses in (
        ((phantom, made, find_centreline(made)), (0.05, 0.15, 0.3)),
        (load_human(upper_gi_dir, "surface", 1.0), (0.1, 0.2, 0.4)),
    ):
        inner, line = np.argwhere(field.values < -0.5), line.points
        for steepness in steepnesses:
            waves = Waves(random, steepness)
            index = inner[random.integers(0, len(inner), 10_000)]
            points = field.to_world(
                (index + random.uniform(-0.5, 0.5, (10_000, 3))) * field.spacing
            )
            wall = move_mesh(surface, waves)
            checked += check_bound(field, wall, points, waves)
            given = {**waves.bounds, "path": line + waves(line), "radius": RADIUS}
            exact, bounded = (
                MovingField(field, tract).update(waves, **given) for tract in (surface, None)
            )
            # Both promise at nodes of one grid: the more is measured.
            assert np.array_equal(exact.origin, bounded.origin)
            most = replace(exact, values=np.minimum(exact.values, bounded.values))
            nodes, promised = list_nodes(most)
            assert (promised - wall.clearance(nodes)).max() <= 1e-5
    assert checked >= 50_000
