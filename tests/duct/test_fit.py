"""Fitting shapes: synthetic ones come back, what is proved holds, real tracts stay inside."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.anatomy import read_tract
from bozzini.duct import (
    Centreline,
    Polygon,
    RoundCones,
    ShapeFitOptions,
    build_field,
    find_centreline,
    fit,
)
from bozzini.duct.fitting import blocks as candidates
from bozzini.duct.fitting.chain import fit_cone_chain, measure_cone_chain
from bozzini.duct.fitting.fit import fit_duct, mesh_from_mask
from bozzini.duct.fitting.measure import (
    PERCENTS,
    cast_rays,
    find_outside,
    measure_fit,
)
from bozzini.duct.fitting.points import fit_circle, fit_super_ellipse, fit_super_ellipsoid
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.errors import GeometryError, InputError
from bozzini.numeric.vectors import spread_directions
from tests.shapes import bend_curve

BEND = bend_curve(30.0, 2.0, 15.0)


def tube(radius=8.0):
    """A bent tube, round everywhere, and its axis."""
    duct = RoundCones(BEND, np.full(len(BEND), radius))
    return duct, Centreline.from_points(BEND, duct)


def lumen_points(duct, count, seed=0):
    points = np.random.default_rng(seed).uniform(*duct.bounds, (40 * count, 3))
    return points[duct.signed_distance(points) < 0.0][:count]


# Points to single shapes


@given(
    centre=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    radius=st.floats(0.5, 60.0),
    first=st.floats(-3.0, 3.0),
    arc=st.floats(1.2, 6.2),
)
def test_circle_comes_back(centre, radius, first, arc):
    angles = first + np.linspace(0.0, arc, 40)
    points = np.array(centre) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    found = fit_circle(points)
    assert found.centre == pytest.approx(np.array(centre), abs=1e-6)
    assert found.radius == pytest.approx(radius, abs=1e-6)
    assert found.residual < 1e-6


def test_circle_of_a_short_arc_is_not_biased_as_the_algebraic_one_is():
    angles = np.linspace(0.0, np.pi / 2, 60)
    random = np.random.default_rng(3)
    errors = []
    for _ in range(60):
        sizes = 5.0 + random.normal(0.0, 0.25, len(angles))
        points = sizes[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        table = np.concatenate([2 * points, np.ones((len(points), 1))], axis=1)
        x, y, c = np.linalg.lstsq(table, (points**2).sum(axis=1), rcond=None)[0]
        errors.append((np.sqrt(c + x * x + y * y) - 5.0, fit_circle(points).radius - 5.0))
    algebraic, geometric = np.mean(errors, axis=0)
    assert algebraic < -0.5
    assert abs(geometric) < 0.3 * abs(algebraic)


def test_circle_around_a_slit_stays_in_it():
    """A slit that bends a little: the best circle of all is large and goes along it."""
    across = np.linspace(-10.0, 10.0, 40)
    bend = 0.05 * across**2
    slit = np.concatenate([np.stack([across, bend], 1), np.stack([across, bend + 0.5], 1)[::-1]])
    assert fit_circle(slit).radius > 8.0
    found = fit_circle(slit, around=True)
    assert (found.centre >= slit.min(axis=0)).all() and (found.centre <= slit.max(axis=0)).all()
    angles = np.linspace(0.0, 6.0, 30)
    ring = 4.0 + 3.0 * np.stack([np.cos(angles), np.sin(angles)], 1)
    assert fit_circle(ring, around=True).radius == pytest.approx(3.0, abs=1e-6)


def planar_points(centre, half, power, angle, count=80):
    turn = 2.0 * np.pi * np.arange(count) / count
    ray = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    gauge = (np.abs(ray / half) ** power).sum(axis=1) ** (1.0 / power)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.array(centre) + (ray / gauge[:, None]) @ matrix.T


@settings(max_examples=15)
@given(
    short=st.floats(0.4, 0.85),
    power=st.floats(1.3, 12.0),
    angle=st.floats(-1.4, 1.4),
    size=st.floats(2.0, 40.0),
)
def test_super_ellipse_comes_back(short, power, angle, size):
    points = planar_points((3.0, -7.0), np.array([size, short * size]), power, angle)
    found = fit_super_ellipse(points)
    # A power near 2 and another angle is the same curve only where it is: compare curves.
    again = found.to_duct()
    assert found.residual < 1e-6
    assert np.abs(again.signed_distance(points)).max() < 1e-5 * size
    assert sorted(found.half_axes) == pytest.approx([short * size, size], rel=1e-5)


def solid_points(centre, half, e1, e2, rotation, count=700):
    ray = spread_directions(count)
    scaled = np.abs(ray) / half
    flat = (scaled[:, 0] ** (2 / e2) + scaled[:, 1] ** (2 / e2)) ** (e2 / 2)
    gauge = (flat ** (2 / e1) + scaled[:, 2] ** (2 / e1)) ** (e1 / 2)
    return np.array(centre) + (ray / gauge[:, None]) @ rotation.T


@pytest.mark.parametrize(("e1", "e2"), [(1.0, 1.0), (0.4, 0.6), (0.8, 1.4)])
def test_super_ellipsoid_comes_back(e1, e2):
    half, rotation = np.array([6.0, 9.0, 14.0]), Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    points = solid_points((1.0, 2.0, 3.0), half, e1, e2, rotation)
    found = fit_super_ellipsoid(points)
    assert found.residual < 1e-6
    assert found.centre == pytest.approx([1.0, 2.0, 3.0], abs=1e-6)
    assert sorted(found.half_axes) == pytest.approx(sorted(half), abs=1e-5)
    if e1 != e2:
        assert (found.e1, found.e2) == pytest.approx((e1, e2), abs=1e-5)
    assert np.abs(found.to_duct().signed_distance(points)).max() < 1e-5


def test_piece_without_ends_comes_back_when_its_length_is_given():
    half, rotation = np.array([6.0, 9.0, 10.0]), Rotation.from_rotvec([0.05, 0.1, 0.2]).as_matrix()
    points = solid_points((1.0, 2.0, 3.0), half, 0.5, 0.8, rotation, 600)
    along = (points - [1.0, 2.0, 3.0]) @ rotation[:, 2]
    wall = points[np.abs(along) < 6.0]
    found = fit_super_ellipsoid(
        wall, frame=np.eye(3), half_length=10.0, centre=np.array([1.0, 2.0, 3.0])
    )
    assert found.residual < 1e-6
    assert found.half_axes == pytest.approx(half, abs=1e-4)
    assert (found.e1, found.e2) == pytest.approx((0.5, 0.8), abs=1e-4)
    # Another length is fitted nearly as well: the wall does not tell it.
    other = fit_super_ellipsoid(
        wall, frame=np.eye(3), half_length=12.0, centre=np.array([1.0, 2.0, 3.0])
    )
    assert other.residual < 0.05


def test_cone_chain_comes_back():
    random = np.random.default_rng(2)
    centres = np.array([[0, 0, 0], [2, 1, 12], [6, 0, 24], [12, 2, 33]], dtype=float)
    radii = np.array([5.0, 6.5, 4.0, 5.5])
    chain = RoundCones(centres, radii)
    rays = spread_directions(900)
    t = random.uniform(0.0, 1.0, 900)
    k = random.integers(0, 3, 900)
    starts = centres[k] + t[:, None] * (centres[k + 1] - centres[k])
    points = starts + cast_rays(chain, starts, rays, reach=100.0)[:, None] * rays
    start = centres + np.array([[0.5, -0.4, 0], [-0.5, 0.3, 0.0], [0.4, 0.4, 0], [0, 0.5, 0.0]])
    found = fit_cone_chain(points, start, radii * 0.9)
    assert np.abs(measure_cone_chain(points, found.centres, found.radii)[0]).max() < 1e-6
    assert found.centres == pytest.approx(centres, abs=1e-5)
    assert found.radii == pytest.approx(radii, abs=1e-5)


def test_cone_chain_distance_is_that_of_the_duct():
    random = np.random.default_rng(5)
    centres, radii = random.normal(0.0, 10.0, (6, 3)), random.uniform(1.0, 6.0, 6)
    points = random.uniform(-30.0, 30.0, (4000, 3))
    distance, index, t = measure_cone_chain(points, centres, radii)
    assert distance == pytest.approx(RoundCones(centres, radii).signed_distance(points), abs=1e-9)
    ball = (1 - t)[:, None] * centres[index] + t[:, None] * centres[index + 1]
    radius = (1 - t) * radii[index] + t * radii[index + 1]
    assert np.linalg.norm(points - ball, axis=1) - radius == pytest.approx(distance, abs=1e-9)


# What is measured


@settings(max_examples=15)
@given(
    shift=st.floats(0.5, 12.0),
    radius=st.floats(1.0, 9.0),
    way=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 1)),
)
def test_outside_of_two_balls(shift, radius, way):
    direction = np.array(way) / np.linalg.norm(way)
    true = RoundCones(np.zeros((1, 3)), np.array([8.0]))
    fitted = RoundCones((shift * direction)[None], np.array([radius]))
    expected = shift + radius - 8.0
    found = find_outside(fitted, true, max_error=0.0)
    assert found.value <= expected + 1e-9
    assert found.bound >= max(expected, found.value) - 1e-9
    if expected > 0.05:
        # Where nearly all of the wall is about as far outside, the cubes run out before.
        assert found.bound - found.value <= (0.02 if shift > 2.0 else 0.2) + 1e-9


def test_volumes_of_two_balls():
    true = RoundCones(np.zeros((1, 3)), np.array([10.0]))
    fitted = RoundCones(np.array([[6.0, 0.0, 0.0]]), np.array([10.0]))
    line = Centreline.from_points([[0, 0, -5], [0, 0, 5]], true)
    report = measure_fit(fitted, true, line)
    ball = 4.0 / 3.0 * np.pi * 1000.0
    lens = np.pi * (40.0 + 6.0) * (20.0 - 6.0) ** 2 / 12.0
    error = 2.0 * report.volume_error
    assert error < 0.01 * ball
    assert report.volume_true == pytest.approx(ball, abs=error)
    assert report.volume_fitted == pytest.approx(ball, abs=error)
    assert report.volume_kept == pytest.approx(lens, abs=error)
    assert report.volume_gained == pytest.approx(ball - lens, abs=error)
    assert report.outside == pytest.approx(6.0, abs=0.03)
    assert report.kept == report.volume_kept / report.volume_true


def test_a_duct_stands_for_itself():
    duct, line = tube()
    report = measure_fit(duct, duct, line)
    assert report.outside == 0.0
    assert report.outside_bound < 0.3
    assert report.volume_lost == report.volume_gained == 0.0
    assert report.wall == pytest.approx(np.zeros(len(PERCENTS)), abs=1e-6)
    assert report.clearance_loss == pytest.approx(np.zeros(len(PERCENTS)), abs=1e-9)


def test_rays_end_at_the_wall():
    duct, _ = tube()
    starts = np.repeat(BEND[::10], 50, axis=0)
    rays = np.tile(spread_directions(50), (len(BEND[::10]), 1))
    lengths = cast_rays(duct, starts, rays, reach=500.0)
    ends = starts + lengths[:, None] * rays
    assert np.abs(duct.signed_distance(ends)).max() < 1e-9
    between = starts[:, None] + np.linspace(0, 0.999, 60)[None, :, None] * (ends - starts)[:, None]
    assert duct.signed_distance(between).max() < 0.0
    assert cast_rays(duct, starts, rays, reach=3.0).max() == 3.0
    assert (cast_rays(duct, starts + 500.0, rays, reach=3.0) == 0.0).all()


# Ducts to shapes


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cones", "cylinders", "superellipsoids"])
def test_shapes_stay_inside(kind, monkeypatch):
    monkeypatch.setattr(candidates, "OTHERS", 10)
    duct, line = tube()
    fitted = fit(duct, kind, centreline=line, max_error=0.5)
    assert fitted.converged, fitted.reason
    assert fitted.report.outside_bound <= 0.5
    points = lumen_points(fitted.duct, 4000)
    assert duct.signed_distance(points).max() <= fitted.report.outside_bound
    # Not a trivial answer: most is kept, and a way goes through.
    assert fitted.report.kept > 0.85
    middle = line.points[10:-10]
    assert fitted.duct.signed_distance(middle).max() < -1.0
    assert fitted.report.clearance_loss[-1] <= 0.5 + 1e-6


@pytest.mark.slow
def test_super_ellipsoids_lose_no_more_room_than_allowed_where_large_ones_would(monkeypatch):
    """A tight bend: large ones cut the corner, and their number is free."""
    monkeypatch.setattr(candidates, "OTHERS", 4)
    monkeypatch.setattr(candidates, "STRETCH_MM", 12.0)
    duct, line = tube(12.0)
    counts = []
    for error in (0.4, 2.0):
        fitted = fit(duct, "superellipsoids", centreline=line, max_error=error)
        assert fitted.converged, fitted.reason
        assert fitted.report.clearance_loss[-1] <= error + 1e-6
        counts.append(fitted.report.pieces)
    assert counts[0] > counts[1]


@pytest.mark.slow
def test_super_ellipsoids_that_lose_too_much_room_have_not_reached_it(monkeypatch):
    monkeypatch.setattr(candidates, "OTHERS", 4)
    monkeypatch.setattr(candidates, "STRETCH_MM", 12.0)
    monkeypatch.setattr("bozzini.duct.fitting.fit.add_balls", lambda shapes, *_, **__: shapes)
    monkeypatch.setattr("bozzini.duct.fitting.fit.LINE_SHARE", 20.0)
    duct, line = tube()
    fitted = fit(duct, "superellipsoids", centreline=line, max_error=0.2)
    assert not fitted.converged
    assert "of the clearance on the centreline is lost" in fitted.reason
    few = fit(duct, "superellipsoids", centreline=line, max_error=0.2, pieces=12)
    assert few.converged, few.reason


def test_number_of_cones_follows_from_the_bend():
    """A chord of a bend of radius R leaves it by s^2 / 8R: so many pieces for so large an error."""
    duct, line = tube()
    counts = []
    for error in (0.25, 1.0):
        fitted = fit(duct, "cones", centreline=line, max_error=error)
        counts.append(fitted.report.pieces)
        # Cones may leave the way outwards by 0.8 of the error, and lose room by the whole of it.
        chord = np.sqrt(8.0 * 30.0 * 0.8 * error)
        assert 60.0 / chord <= counts[-1] <= 60.0 / (0.6 * chord) + 4
    assert counts[0] > counts[1]


def test_more_pieces_lose_less():
    duct, line = tube()
    losses = []
    for pieces in (6, 9, 18):
        fitted = fit(duct, "cones", centreline=line, max_error=1.0, pieces=pieces)
        assert fitted.report.pieces <= pieces
        losses.append(fitted.report.clearance_loss[-1])
    assert losses[0] > losses[1] > losses[2]


@pytest.mark.slow
def test_least_squares_goes_through_the_wall_of_a_duct_that_is_not_round():
    oval = SuperEllipsoids(
        np.zeros((1, 3)), np.array([[10.0, 6.0, 40.0]]),
        e1=np.array([0.2]), e2=np.array([1.0]), rotations=np.eye(3)[None],
    )  # fmt: skip
    line = Centreline.from_points([[0, 0, -30.0], [0, 0, 30.0]], oval)
    inner = fit(oval, "cylinders", centreline=line, max_error=0.5)
    outer = fit(oval, "cylinders", centreline=line, max_error=0.5, inside=False)
    assert inner.converged and isinstance(inner.duct, ConnectedCylinders)
    assert inner.duct.radii == pytest.approx(np.full(len(inner.duct.radii), 6.0), abs=0.1)
    assert not outer.converged and "outside" in outer.reason
    assert outer.duct.radii.min() > 7.5
    assert outer.report.volume_gained > 0.1 * outer.report.volume_true
    blocks = fit(oval, "superellipsoids", centreline=line, max_error=0.5, inside=False, pieces=6)
    assert blocks.report.pieces == 6
    assert np.percentile(np.abs(blocks.report.wall), 50) < 0.3


def test_what_cannot_be_fitted_is_said():
    duct, line = tube()
    with pytest.raises(InputError, match="kind is 'boxes'.*cones, cylinders, superellipsoids"):
        fit(duct, "boxes", centreline=line)
    with pytest.raises(InputError, match=r"pieces is 0.*\[1, "):
        fit(duct, "cones", centreline=line, pieces=0)
    with pytest.raises(InputError, match=r"max error is 0 mm.*\(0, inf\)"):
        fit(duct, "cones", centreline=line, max_error=0.0)
    with pytest.raises(GeometryError, match="1 pieces cannot follow.*it takes [0-9]+ at least"):
        fit(duct, "cones", centreline=line, pieces=1, max_error=0.5)
    with pytest.raises(InputError, match="2 dimensions"):
        fit(Polygon([[0, 0], [50, 0], [50, 50], [0, 50]]), "cones", centreline=line)


def test_voxel_faces_are_the_wall_of_the_sampled_field():
    random = np.random.default_rng(4)
    mask = random.random((7, 6, 5)) < 0.6
    affine = np.eye(4)
    affine[:3, :3] = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix() @ np.diag([1.0, 2.0, -1.5])
    affine[:3, 3] = (5.0, -3.0, 8.0)
    mesh = mesh_from_mask(mask, affine)
    assert mesh.volume == pytest.approx(mask.sum() * 3.0)
    places = np.array(np.meshgrid(*[np.arange(n) for n in mask.shape], indexing="ij"))
    centres = places.reshape(3, -1).T @ affine[:3, :3].T + affine[:3, 3]
    inside = mesh.signed_distance(centres) < 0.0
    assert (inside == mask.reshape(-1)).all()


# The real tract


@pytest.fixture(scope="module")
def stomach(upper_gi_dir):
    tract = read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels="all")
    field = build_field(tract, voxel=1.5)
    return mesh_from_mask(tract.mask, tract.affine), field, find_centreline(field)


@pytest.mark.slow
def test_cones_of_the_real_tract_stay_inside(stomach):
    mesh, field, line = stomach
    fitted = fit_duct(mesh, line, ShapeFitOptions(max_error=0.5, pieces=60), draft=field)
    assert fitted.converged, fitted.reason
    assert fitted.report.pieces <= 60
    assert fitted.report.outside_bound <= 0.5
    assert mesh.signed_distance(lumen_points(fitted.duct, 5000)).max() <= 0.5
    # A stomach is not round.
    assert 0.35 < fitted.report.kept < 0.6


@pytest.mark.slow
def test_super_ellipsoids_of_the_real_tract_keep_more(stomach, monkeypatch):
    monkeypatch.setattr(candidates, "OTHERS", 12)
    monkeypatch.setattr(candidates, "STRETCH_MM", 10.0)
    mesh, field, line = stomach
    options = ShapeFitOptions(kind="superellipsoids", max_error=0.5, pieces=40)
    fitted = fit_duct(mesh, line, options, draft=field)
    assert fitted.converged, fitted.reason
    assert fitted.report.pieces <= 60
    assert mesh.signed_distance(lumen_points(fitted.duct, 5000)).max() <= 0.5
    assert fitted.report.kept > 0.7
