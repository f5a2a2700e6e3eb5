"""Bounds of the link along a duct: against closed forms, brute force, and chains that move."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.duct import Centreline, Polygon, RoundCones, SampledField, TriangleMesh
from bozzini.motion.traverse import (
    SegmentSearch,
    find_diameter_limits,
    find_link_limits,
    make_ceiling,
)
from tests.motion.bends import bend_duct
from tests.shapes import bend_curve, curve_distance, sample_field
from validation.thesis.traverse_bend import Bend


@pytest.fixture(scope="module", params=[(3.0, 1.0, 0.4, 180), (3.0, 1.0, 0.0, 90), (30, 13, 5, 60)])
def planar(request):
    radius, half_width, body, degrees = request.param
    bend = Bend(radius=radius, half_width=half_width, body_radius=body, angle=math.radians(degrees))
    limb = 4.0 * radius
    duct, line = bend_duct(radius, half_width, bend.angle, limb, inset=1.2 * half_width)
    return bend, duct, line, find_link_limits(duct, line, diameter=2 * body, stations=25)


def test_planar_bends_give_the_closed_forms(planar) -> None:
    bend, _, line, limits = planar
    assert bend.limit_rigid() <= limits.link_high <= 1.02 * bend.limit_rigid()
    if bend.angle == math.pi:
        assert 0.97 * bend.limit_on_centreline() <= limits.link_low <= bend.limit_on_centreline()
        head = bend.limit_with_head_at(bend.radius)
        assert head <= limits.link_head <= 1.02 * head
    assert limits.link_high_at == pytest.approx(0.5 * line.length, abs=0.05 * line.length)
    assert limits.link_low_by == "wall"


def test_limits_are_in_order_everywhere(planar) -> None:
    *_, limits = planar
    assert limits.link_low <= limits.link_head <= limits.link_high
    assert np.all(limits.on_line <= limits.head_on_line)
    assert np.all(limits.head_on_line <= limits.rigid)
    assert limits.on_line.min() >= limits.link_low
    assert limits.rigid.min() == limits.link_high
    assert np.all(limits.radius > 0.0)


def test_the_pose_is_free_and_about_as_long(planar) -> None:
    bend, duct, _, limits = planar
    along = limits.pose[1] - limits.pose[0]
    assert 0.97 * limits.link_high <= np.linalg.norm(along) <= limits.link_high
    points = limits.pose[0] + np.linspace(0.0, 1.0, 301)[:, None] * along
    # By upper bounds of the clearance, so through the wall by no more than the grid.
    assert -duct.signed_distance(points).min() >= bend.body_radius - 0.02 * bend.half_width


def test_chords_shorter_than_the_lower_bound_are_free(planar) -> None:
    bend, duct, line, limits = planar
    random = np.random.default_rng(1)
    arc = random.uniform(0.0, line.length, (20_000, 2))
    ends = np.stack([np.interp(arc, line.arc_length, c) for c in line.points.T], axis=-1)
    keep = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) < limits.link_low
    ends = ends[keep]
    # Only chords along the line; none of the other limb is that near.
    u = random.uniform(0.0, 1.0, (len(ends), 1))
    points = ends[:, 0] + u * (ends[:, 1] - ends[:, 0])
    assert len(points) > 500
    assert -duct.signed_distance(points).max() >= bend.body_radius - 1e-9


def test_a_straight_duct_limits_nothing() -> None:
    duct = Polygon([[0, 0], [40, 0], [40, 6], [0, 6]])
    line = Centreline.from_points([[3, 3], [37, 3]], duct)
    limits = find_link_limits(duct, line, diameter=4.0, stations=9)
    assert limits.link_low == pytest.approx(34.0)
    assert limits.link_low_by == "length"
    assert limits.link_high == limits.link_high_at == math.inf
    assert limits.judge(30.0) == "passes"
    assert limits.judge(60.0) == "undecided"


@pytest.mark.slow
@pytest.mark.parametrize("as_field", [False, True])
def test_a_tube_round_a_bend_gives_the_ring_s_values(as_field: bool) -> None:
    curve = bend_curve(30.0, math.pi, 90.0)
    bend = Bend(radius=30, half_width=13, body_radius=5)
    duct = RoundCones(curve[::3], np.full(len(curve[::3]), 13.0))
    if as_field:
        duct = sample_field(
            curve_distance(curve[::3], 13.0), curve.min(0) - 16, curve.max(0) + 16, 2.0
        )
    line = Centreline.from_points(curve, duct)
    limits = find_link_limits(duct, line, diameter=10.0, stations=12)
    assert bend.limit_rigid() * 0.995 <= limits.link_high <= 1.05 * bend.limit_rigid()
    assert 0.95 * bend.limit_on_centreline() <= limits.link_low <= bend.limit_on_centreline() * 1.01
    assert limits.judge(limits.link_high + 1e-6) == "too long"


@pytest.mark.slow
def test_a_neck_is_named() -> None:
    curve = np.stack([np.linspace(0.0, 100.0, 101), np.zeros(101), np.zeros(101)], axis=1)
    radii = 10.0 - 7.0 * np.exp(-(((curve[:, 0] - 40.0) / 15.0) ** 2))
    duct = RoundCones(curve, radii)
    line = Centreline.from_points(curve[5:-5], duct)
    wide = find_link_limits(duct, line, diameter=7.0, stations=15)
    assert wide.link_low == 0.0
    assert wide.link_low_at == pytest.approx(40.0 - 5.0, abs=3.0)
    assert wide.link_high == 0.0
    assert wide.judge(5.0) == "too long"
    slim = find_link_limits(duct, line, diameter=5.5, stations=15)
    assert slim.link_low == pytest.approx(line.length)


def test_a_fold_back_is_a_turn() -> None:
    # A hairpin of the line in a wide room: no wall in the way, but a tail would go backwards.
    duct = Polygon([[0, 0], [60, 0], [60, 60], [0, 60]])
    turn = np.linspace(0.0, math.pi, 60)
    arc = np.stack([30 - 5 * np.cos(turn), 35 + 5 * np.sin(turn)], axis=1)
    line = Centreline.from_points(np.concatenate([[[25, 10]], arc, [[35, 10]]]), duct)
    limits = find_link_limits(duct, line, diameter=1.0, stations=4)
    assert limits.link_low_by == "turn"
    assert 0.95 * 10.0 <= limits.link_low <= 10.0  # Schur: twice the radius


@pytest.mark.slow
@settings(max_examples=8)
@given(
    radius=st.floats(1.2, 6.0),
    body=st.floats(0.0, 0.7),
    degrees=st.floats(20.0, 180.0),
    scale=st.floats(0.5, 40.0),
)
def test_the_true_limit_is_in_the_bracket(radius, body, degrees, scale) -> None:
    bend = Bend(
        radius=radius * scale,
        half_width=scale,
        body_radius=body * scale,
        angle=math.radians(degrees),
    )
    limb = 3.0 * bend.limit_rigid()
    duct, line = bend_duct(
        bend.radius, scale, bend.angle, limb, inset=1.5 * scale, count=60, spacing=0.2 * scale
    )
    limits = find_link_limits(duct, line, diameter=2 * bend.body_radius, stations=9)
    # The inner polygon cuts its arc by 60^-2 / 2: room that the circle does not give.
    assert limits.link_low <= bend.limit_rigid()
    assert bend.limit_rigid() <= limits.link_high <= 1.06 * bend.limit_rigid()


def test_bounds_of_the_clearance_from_above() -> None:
    random = np.random.default_rng(0)
    curve = bend_curve(12.0, 2.0, 10.0)
    cones = RoundCones(curve, np.full(len(curve), 4.0))
    exact = curve_distance(curve, 4.0)
    low, high = cones.bounds
    points = random.uniform(low - 3.0, high + 3.0, (20_000, 3))
    field = cones.sample(0.8)
    for duct, truth in (
        (cones, exact(points)),
        (field, exact(points)),
        (field.inflate(1.5), curve_distance(curve, 5.5)(points)),
    ):
        ceiling = make_ceiling(duct)
        above = ceiling.measure(np.ascontiguousarray(ceiling.to_local(points)))
        # The distance to the wall of a tube with a bend is at least this, inside and outside.
        assert np.all(above >= -truth - 1e-5)
        inside = truth < -1.0
        assert np.median(above[inside] + truth[inside]) < 0.8


@pytest.mark.slow
def test_sheets_of_a_mesh_that_cross_prove_nothing() -> None:
    # Two capsules that overlap are one straight tube, but their triangles are inside it too.
    first = trimesh.creation.capsule(height=40, radius=6, count=[24, 24])
    second = first.copy()
    second.apply_translation([0, 0, 36])
    both = trimesh.util.concatenate([first, second])
    mesh = TriangleMesh(both.vertices, both.faces)
    assert mesh.kind == "bound"
    low, high = mesh.bounds[:, 2]
    axis = np.stack([np.zeros(40), np.zeros(40), np.linspace(low + 6, high - 6, 40)], axis=1)
    tube = RoundCones(axis[[0, -1]], [6.0, 6.0])
    ceiling = make_ceiling(mesh)
    points = np.random.default_rng(0).uniform(*mesh.bounds, (20_000, 3))
    above = ceiling.measure(np.ascontiguousarray(ceiling.to_local(points)))
    room = -tube.signed_distance(points)
    # The capsules of triangles are narrower than round ones by their sagitta.
    assert np.all(above[room > 0.0] >= room[room > 0.0] - 0.1)
    limits = find_link_limits(mesh, Centreline.from_points(axis, tube), diameter=8.0, stations=5)
    assert limits.link_high > 40.0


def test_a_turned_duct_has_the_same_limits() -> None:
    duct, line = bend_duct(10.0, 3.0, 2.0, 30.0, inset=4.0, count=60)
    turn = 0.7
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    turned = Polygon(duct.vertices @ matrix.T + [5.0, -80.0])
    moved = Centreline.from_points(line.points @ matrix.T + [5.0, -80.0], turned, spacing=10.0)
    one = find_link_limits(duct, line, diameter=2.0, stations=9)
    other = find_link_limits(turned, moved, diameter=2.0, stations=9)
    assert other.link_low == pytest.approx(one.link_low, rel=1e-3)
    assert other.link_high == pytest.approx(one.link_high, rel=0.03)


def test_a_dense_line_gives_the_same_bound() -> None:
    # More segments than are kept in the table of chords.
    duct, line = bend_duct(10.0, 3.0, 2.0, 20.0, inset=4.0, count=60, spacing=0.02)
    assert len(line.points) > 2500
    dense = find_link_limits(duct, line, diameter=2.0, stations=3)
    plain = find_link_limits(
        duct, Centreline.from_points(line.points[::20], duct), diameter=2.0, stations=3
    )
    assert plain.link_low == pytest.approx(dense.link_low, rel=0.02)


def test_side_loops_are_not_taken_for_sections() -> None:
    # The line crosses this plane twice in one component: no statement there, not a wrong one.
    duct = Polygon([[0, 0], [60, 0], [60, 60], [0, 60]])
    line = Centreline.from_points([[10, 10], [50, 10], [50, 50], [10, 50]], duct)
    limits = find_link_limits(duct, line, diameter=2.0, stations=7)
    assert limits.link_high == math.inf or limits.link_high >= 40.0


@pytest.mark.slow
def test_the_human_tract(upper_gi_dir: Path) -> None:
    from bozzini.anatomy import read_tract
    from bozzini.duct import build_field, find_centreline

    field = build_field(
        read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels="all"), voxel=2.0
    )
    assert isinstance(field, SampledField)
    line = find_centreline(field)
    limits = find_link_limits(field, line, diameter=5.0, stations=25)
    assert 0.0 <= limits.link_low <= limits.link_head <= limits.link_high
    assert 0.0 <= limits.link_high_at <= line.length
    assert np.all(limits.on_line <= limits.head_on_line)
    slim = find_link_limits(field, line, diameter=3.0, stations=25)
    assert slim.link_low >= limits.link_low
    assert slim.link_high >= limits.link_high * 0.98


@pytest.mark.slow
def test_diameters_are_bracketed() -> None:
    bend = Bend(radius=30, half_width=13, body_radius=5)
    duct, line = bend_duct(30.0, 13.0, math.pi, 120.0, inset=16.0)
    short = find_diameter_limits(duct, line)
    assert short.low == pytest.approx(26.0, rel=0.03)
    assert short.low <= 26.0 <= short.high
    # The link that is the limit for a body of 10 mm; the diameter for that link.
    rigid = find_diameter_limits(duct, line, link=bend.limit_rigid())
    assert 10.0 <= rigid.high <= 11.0
    assert rigid.high_at == pytest.approx(0.5 * line.length, abs=10.0)
    easy = find_diameter_limits(duct, line, link=bend.limit_on_centreline())
    assert 9.0 <= easy.low <= 10.0
    assert easy.low <= rigid.high <= short.high


def test_a_search_that_cannot_come_nearer_ends() -> None:
    # At the end of a tube just wider than the body rays along its rim stay free at all sizes.
    duct = RoundCones(np.linspace([0.0, 0.0, 0.0], [24.0, 0.0, 0.0], 7), np.full(7, 6.0))
    ceiling = make_ceiling(duct)
    line = ceiling.to_local(np.linspace([0.0, 0.0, 0.0], [24.0, 0.0, 0.0], 97))
    search = SegmentSearch(ceiling=ceiling, line=line, radius=5.98125, limit=79.6)
    assert 0.0 <= search.bound_behind(0, 6.0).bound < 0.5
