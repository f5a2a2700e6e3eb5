"""Connected cylinders: the closed-form inverse, and the wall by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.duct.base import Duct
from bozzini.duct.shapes.cylinders import ConnectedCylinders, CylinderCoordinates
from bozzini.errors import GeometryError, InputError


def draw(seed, count=None):
    """A chain that winds, tapers and has normals of free sign, off its way by a little."""
    random = np.random.default_rng(seed)
    count = count or int(random.integers(2, 9))
    while True:
        way = np.array([0.0, 0.0, 1.0])
        centres, normals = [random.normal(size=3)], [way]
        for _ in range(count - 1):
            way = way + random.normal(size=3) * 0.3
            way /= np.linalg.norm(way)
            centres.append(centres[-1] + way * random.uniform(3.0, 9.0))
            normals.append(way + random.normal(size=3) * 0.15)
        signs = random.choice([-2.0, 1.0], (count, 1))
        try:
            radii = random.uniform(1.0, 4.0, count)
            return random, ConnectedCylinders(centres, np.array(normals) * signs, radii)
        except GeometryError:
            continue


def scatter(random, duct, count):
    low, high = duct.bounds
    return random.uniform(low - 2.0, high + 2.0, (count, 3))


def rulings(duct, segment, count):
    """Both ends (count, 3) of rulings of a segment."""
    theta = np.linspace(-np.pi, np.pi, count, endpoint=False)
    return [
        duct.place(
            CylinderCoordinates(np.full(count, segment), np.full(count, t), np.ones(count), theta)
        )
        for t in (0.0, 1.0)
    ]


def wall_distance(duct, points, count=720):
    """The least distance to many rulings and the two discs; too large by the pitch at most."""
    best = np.full(len(points), np.inf)
    for segment in range(len(duct.centres) - 1):
        start, stop = rulings(duct, segment, count)
        along = stop - start
        away = points[:, None] - start
        t = np.einsum("ijk,jk->ij", away, along) / np.einsum("jk,jk->j", along, along)
        gap = away - np.clip(t, 0.0, 1.0)[..., None] * along
        best = np.minimum(best, np.linalg.norm(gap, axis=-1).min(axis=1))
    for end in (0, -1):
        away = points - duct.centres[end]
        height = away @ duct.normals[end]
        off = np.linalg.norm(away - height[:, None] * duct.normals[end], axis=1)
        best = np.minimum(best, np.hypot(height, np.maximum(off - duct.radii[end], 0.0)))
    return best


@given(seed=st.integers(0, 10**6))
def test_coordinates_come_back(seed):
    random, duct = draw(seed)
    count = 200
    asked = CylinderCoordinates(
        random.integers(0, len(duct.centres) - 1, count),
        random.uniform(0.01, 0.99, count),
        random.uniform(0.01, 0.99, count),
        random.uniform(-np.pi, np.pi, count),
    )
    points = duct.place(asked)
    found = duct.locate(points)
    # Where segments overlap a point has several: the found ones lead to it all the same.
    assert duct.place(found) == pytest.approx(points, abs=1e-10)
    assert np.all(found.u <= asked.u + 1e-9)
    same = found.segments == asked.segments
    assert same.mean() > 0.5
    assert found.t[same] == pytest.approx(asked.t[same], abs=1e-9)
    assert found.u[same] == pytest.approx(asked.u[same], abs=1e-9)
    turn = np.abs(np.angle(np.exp(1j * (found.theta - asked.theta)))[same])
    assert np.all(turn * asked.u[same] < 1e-9)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_distance_is_that_to_the_wall(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 150)
    value = duct.signed_distance(points)
    gap = wall_distance(duct, points) - np.abs(value)
    widest = duct.radii.max()
    pitch = np.pi / 720 * widest
    assert gap.min() >= -1e-12
    assert gap.max() <= pitch + 1e-7 * widest
    far = np.abs(value) > 0.5
    assert gap[far].max(initial=0.0) <= pitch**2 + 1.01e-7 * widest
    inside = duct.locate(points).u <= 1.0
    assert np.array_equal(inside[gap < np.abs(value)], value[gap < np.abs(value)] < 0.0)


def test_a_straight_cylinder_is_exact():
    duct = ConnectedCylinders([(0, 0, 0), (0, 0, 4), (0, 0, 10)], [(0, 0, 1)] * 3, [2.0] * 3)
    random = np.random.default_rng(2)
    points = scatter(random, duct, 20_000)
    off = np.hypot(points[:, 0], points[:, 1]) - 2.0
    end = np.abs(points[:, 2] - 5.0) - 5.0
    corner = np.hypot(np.maximum(off, 0.0), np.maximum(end, 0.0))
    exact = corner + np.minimum(np.maximum(off, end), 0.0)
    assert np.abs(duct.signed_distance(points) - exact).max() <= 2.0e-7 + 1e-12
    assert float(duct.signed_distance([0.0, 0.0, 4.0])) == pytest.approx(-2.0, abs=3e-7)


def test_a_cone_without_its_tip_is_exact_at_its_wall():
    duct = ConnectedCylinders([(0, 0, 0), (0, 0, 10)], [(0, 0, 1)] * 2, [4.0, 2.0])
    random = np.random.default_rng(3)
    z = random.uniform(2.0, 8.0, 2000)
    off = random.uniform(2.5, 4.0, 2000)
    turn = random.uniform(0, 2 * np.pi, 2000)
    points = np.stack([off * np.cos(turn), off * np.sin(turn), z], axis=1)
    exact = (off - 4.0 + 0.2 * z) / np.hypot(1.0, 0.2)
    near = np.abs(exact) < 0.9
    value = duct.signed_distance(points)
    assert np.abs(np.abs(value) - np.abs(exact))[near].max() <= 4.1e-7
    assert np.array_equal((value < 0.0)[near], (exact < 0.0)[near])


@pytest.mark.slow
def test_sign_is_that_of_a_fine_mesh_of_the_wall():
    from bozzini.duct.shapes.mesh import TriangleMesh

    random, duct = draw(4, count=6)
    points = scatter(random, duct, 100_000)
    value = duct.signed_distance(points)
    count = 240
    rings = [rulings(duct, 0, count)[0]] + [rulings(duct, k, count)[1] for k in range(5)]
    vertices = np.concatenate([*rings, duct.centres[[0, -1]]])
    a = np.arange(count)
    b = (a + 1) % count
    faces = [np.stack([b, a, np.full(count, len(vertices) - 2)], 1)]
    for k in range(5):
        low, high = k * count, (k + 1) * count
        faces += [np.stack([low + a, low + b, high + b], 1)]
        faces += [np.stack([low + a, high + b, high + a], 1)]
    faces += [np.stack([5 * count + a, 5 * count + b, np.full(count, len(vertices) - 1)], 1)]
    mesh = TriangleMesh(vertices, np.concatenate(faces))
    # Off the wall: the chords of its circles, and half of each quadrilateral's warp.
    chords = [np.roll(ring, -1, axis=0) - ring for ring in rings]
    warp = max(
        np.linalg.norm(after - before, axis=1).max()
        for before, after in zip(chords[:-1], chords[1:], strict=True)
    )
    off = 0.5 * duct.radii.max() * (np.pi / count) ** 2 + 0.25 * warp + 1e-6
    clear = np.abs(value) > off
    assert clear.mean() > 0.99
    assert np.array_equal((mesh.signed_distance(points) < 0.0)[clear], (value < 0.0)[clear])
    assert (value < 0.0).sum() > 2000
    # No segment meets another but its neighbours here, so the distance is exact.
    assert np.abs(mesh.signed_distance(points) - value).max() <= off


@given(seed=st.integers(0, 10**6))
def test_distance_changes_no_faster_than_the_point(seed):
    random, duct = draw(seed)
    a = scatter(random, duct, 150)
    b = a + random.normal(size=a.shape) * random.choice([1e-3, 0.3, 3.0], (150, 1))
    change = np.abs(duct.signed_distance(a) - duct.signed_distance(b))
    slack = 2e-7 * duct.radii.max()
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + slack)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_the_ball_that_is_promised_lies_inside(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 300)
    room = duct.clearance_bound(points)
    inside = room > 0.0
    turn = random.normal(size=(60, 1, 3))
    turn /= np.linalg.norm(turn, axis=-1, keepdims=True)
    around = points[inside] + room[inside][:, None] * turn
    assert np.all(duct.locate(around).u <= 1.0 + 1e-9)


def test_a_chain_through_itself_has_less_room_never_more():
    turn = np.linspace(0.0, 2.2 * np.pi, 40)  # past its own start, on the same circle
    centres = np.stack([10.0 * np.cos(turn), 10.0 * np.sin(turn), 0.0 * turn], axis=1)
    normals = np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=1)
    duct = ConnectedCylinders(centres, normals, np.where(turn < 2.0, 3.0, 2.0))
    points = scatter(np.random.default_rng(0), duct, 5000)
    assert np.array_equal(duct.signed_distance(points) < 0.0, duct.locate(points).u < 1.0 - 1e-6)
    at_end = centres[-1] + [0.1, 0.0, 0.0]  # in the wide part, beside a disc within it
    assert 0.0 < -float(duct.signed_distance(at_end)) < 0.2


@given(seed=st.integers(0, 10**6))
def test_the_gradient_leads_to_the_wall(seed):
    random, duct = draw(seed)
    points = scatter(random, duct, 100)
    value = duct.signed_distance(points)
    gradient = duct.gradient(points)
    assert np.linalg.norm(gradient, axis=1) == pytest.approx(1.0, abs=1e-9)
    foot = points - value[:, None] * gradient
    assert np.abs(duct.signed_distance(foot)).max() <= 3e-7 * duct.radii.max()


def test_circles_between_segments_are_no_wall_and_leave_no_gap():
    _, duct = draw(8, count=7)
    random = np.random.default_rng(0)
    for k in range(1, 6):
        share = np.sqrt(random.uniform(0.0, 0.98, 200)) * duct.radii[k]
        turn = random.uniform(0.0, 2.0 * np.pi, 200)
        frame = duct.frames[k]
        points = duct.centres[k] + share[:, None] * (
            np.cos(turn)[:, None] * frame[:, 0] + np.sin(turn)[:, None] * frame[:, 1]
        )
        assert np.all(duct.signed_distance(points) < 0.0)
        assert float(duct.signed_distance(duct.centres[k])) < -0.5 * duct.radii[k]


@given(seed=st.integers(0, 10**6))
def test_frames_are_orthonormal_and_carried_without_twist(seed):
    _, duct = draw(seed)
    frames = duct.frames
    assert frames.transpose(0, 2, 1) @ frames == pytest.approx(
        np.broadcast_to(np.eye(3), frames.shape), abs=1e-12
    )
    assert np.linalg.det(frames) == pytest.approx(1.0)
    for before, after in zip(frames[:-1], frames[1:], strict=True):
        turn = Rotation.from_matrix(after @ before.T).as_rotvec()
        # The smallest rotation between the normals: its axis lies across both.
        assert abs(turn @ before[:, 2]) < 1e-9 and abs(turn @ after[:, 2]) < 1e-9


def test_between_tilted_circles_the_section_is_narrower_by_half_the_angle():
    half = np.radians(20.0)
    normals = [(np.sin(-half), 0.0, np.cos(half)), (np.sin(half), 0.0, np.cos(half))]
    duct = ConnectedCylinders([(0, 0, -3), (0, 0, 3)], normals, [1.0, 1.0])
    in_plane = -float(duct.signed_distance([0.0, 0.0, 0.0]))
    assert float(duct.locate([np.cos(half), 0.0, 0.0]).u) == pytest.approx(1.0, abs=1e-9)
    assert float(duct.locate([0.0, 1.0, 0.0]).u) == pytest.approx(1.0, abs=1e-9)
    assert np.cos(half) == pytest.approx(0.93969, abs=1e-5)
    assert in_plane == pytest.approx(np.cos(half), abs=0.02)


def test_a_smaller_radius_is_no_clearance_where_the_chain_tapers():
    steep = ConnectedCylinders([(0, 0, 0), (0, 0, 6)], [(0, 0, 1)] * 2, [8.0, 2.0])
    thinner = ConnectedCylinders(steep.centres, steep.normals, steep.radii - 1.0)
    wall = thinner.place(
        CylinderCoordinates(np.array([0]), np.array([0.5]), np.array([1.0]), np.array([0.3]))
    )
    assert -float(steep.signed_distance(wall)[0]) == pytest.approx(np.sqrt(0.5), abs=1e-5)
    eroded = steep.erode(1.0)
    assert float(eroded.signed_distance(wall)[0]) > 0.0


@given(seed=st.integers(0, 10**6))
def test_bounds_hold_the_wall_and_touch_it(seed):
    _, duct = draw(seed)
    low, high = duct.bounds
    wall = np.concatenate(
        [side for k in range(len(duct.centres) - 1) for side in rulings(duct, k, 360)]
    )
    assert np.all(wall >= low - 1e-9) and np.all(wall <= high + 1e-9)
    assert wall.min(axis=0) == pytest.approx(low, abs=1e-3)
    assert wall.max(axis=0) == pytest.approx(high, abs=1e-3)


def test_points_beside_the_chain_have_no_segment():
    duct = ConnectedCylinders([(0, 0, 0), (0, 0, 4)], [(0, 0, 1)] * 2, [1.0, 1.0])
    found = duct.locate([(0, 0, -1), (0, 0, 2), (3, 0, 2)])
    assert found.segments.tolist() == [-1, 0, 0]
    assert found.u.tolist() == [np.inf, 0.0, 3.0]
    with pytest.raises(InputError, match=r"segments lie in \[-1, 0\]: they must lie in \[0, 0\]"):
        duct.place(found)


def test_inflation_moves_the_wall_by_no_more_than_its_amount():
    random, duct = draw(3)
    points = scatter(random, duct, 300)
    change = duct.signed_distance(points) - duct.inflate(0.4).signed_distance(points)
    assert change == pytest.approx(0.4, abs=2e-6)
    assert change.max() <= 0.4


def test_it_is_a_duct():
    _, duct = draw(1)
    assert isinstance(duct, Duct)
    assert (duct.kind, duct.error, duct.wall_error) == ("bound", 0.0, 0.0)
    with pytest.raises(ValueError, match="read-only"):
        duct.normals[0] = 0.0
