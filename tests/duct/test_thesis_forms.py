"""The thesis's planar constraint functions: the printed forms' counterexamples, the right forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import fsolve

from bozzini.duct import Circles, StitchedQuads, SuperEllipses
from bozzini.errors import InputError
from validation.thesis import ducts as forms

SEEDS = st.integers(0, 10**6)

FOOTNOTE = (np.array([[0.0, 15.0], [10.0, 10.0]]), np.array([[0.0, 0.0], [4.0, 1.0]]))


def u_turn():
    """Two limbs joined by half a ring: what a tract does at a flexure."""
    turn = np.linspace(0.0, np.pi, 9)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    limb = np.linspace(-12.0, 0.0, 7)[:-1]
    sides = []
    for radius in (3.0, 5.0):
        down = np.stack([np.full(6, radius), limb], axis=1)
        up = np.stack([np.full(6, -radius), limb[::-1]], axis=1)
        sides.append(np.concatenate([down, radius * ring, up]))
    return StitchedQuads(sides[1], sides[0])


def convex_quad(seed):
    random = np.random.default_rng(seed)
    turn = np.sort(random.uniform(0.0, 2.0 * np.pi, 4))
    while np.diff(np.concatenate([turn, [turn[0] + 2.0 * np.pi]])).min() < 0.3:
        turn = np.sort(random.uniform(0.0, 2.0 * np.pi, 4))
    corners = random.uniform(-9.0, 9.0, 2) + 7.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return random, corners[:2], corners[[3, 2]]


def test_5_14_is_an_area():
    small, large = Circles([(0.0, 0.0)], [1.0]), Circles([(0.0, 0.0)], [100.0])
    points = np.array([[2.0, 0.0], [100.015, 0.0]])
    values = [
        forms.circle_5_14(p, (0.0, 0.0), r) for p, r in zip(points, (1.0, 100.0), strict=True)
    ]
    assert values == pytest.approx([3.0, 3.0], abs=1e-2)
    away = [small.signed_distance(points[0]), large.signed_distance(points[1])]
    assert away == pytest.approx([1.0, 0.015])


@given(seed=SEEDS)
def test_5_16_and_the_gauge_have_the_same_sign(seed):
    random = np.random.default_rng(seed)
    centre, half_axes = random.uniform(-5.0, 5.0, 2), random.uniform(0.5, 6.0, 2)
    power = random.uniform(1.0, 9.0)
    duct = SuperEllipses([centre], [half_axes], powers=[power], angles=[0.0])
    points = random.uniform(-15.0, 15.0, (200, 2))
    value = forms.super_ellipse_5_16(points, centre, half_axes, power)
    assert np.array_equal(value < 0.0, duct.evaluate_gauge(points)[:, 0] < 1.0)
    assert value == pytest.approx(duct.evaluate_gauge(points)[:, 0] ** power - 1.0, rel=1e-9)


def test_5_16_is_no_distance():
    # At the same 0.1 mm from the wall of a 2 x 1 shape the values differ thirty times.
    axes, power = (2.0, 1.0), 8.0
    flat = forms.super_ellipse_5_16((0.0, 1.1), (0.0, 0.0), axes, power)
    tip = forms.super_ellipse_5_16((2.1, 0.0), (0.0, 0.0), axes, power)
    assert flat > 2.0 * tip > 8.0 * 0.1


@given(seed=SEEDS)
def test_the_transpose_of_a_frame_is_not_its_inverse(seed):
    random = np.random.default_rng(seed)
    angle, centre = random.uniform(-3.0, 3.0), random.uniform(1.0, 5.0, 2)
    duct = SuperEllipses([centre], [(3.0, 1.0)], powers=[2.0], angles=[angle])
    frame = forms.frame_5_17(angle, centre)
    points = duct.outline(0, count=50)
    local = forms.to_shape(points, frame)
    assert local[:, 3] == pytest.approx(1.0)
    value = forms.super_ellipse_5_16(local[:, :2], (0.0, 0.0), (3.0, 1.0), 2.0)
    assert value == pytest.approx(0.0, abs=1e-9)
    printed = forms.to_shape_printed(points, frame)
    # Turned alike, but the centre is never taken off: it lands in the fourth slot.
    turn = frame[:2, :2]
    assert printed[:, :2] - local[:, :2] == pytest.approx(np.tile(centre @ turn, (50, 1)))
    assert printed[:, 3] == pytest.approx(1.0 + points @ centre)


def test_the_minimum_of_5_18_is_inside_the_union():
    centres = np.array([(0.0, 0.0), (2.0, 0.0)])
    duct = SuperEllipses(centres, [(1.5, 1.0)] * 2, powers=[4.0] * 2, angles=[0.0] * 2)
    points = np.random.default_rng(0).uniform(-3.0, 5.0, (2000, 2))
    each = [forms.super_ellipse_5_16(points, c, (1.5, 1.0), 4.0) for c in centres]
    value = forms.minimum_5_18(np.stack(each, axis=-1))
    assert np.array_equal(value < 0.0, duct.signed_distance(points) < 0.0)


@given(seed=SEEDS)
def test_half_planes_hold_in_one_quad_where_the_outline_does(seed):
    duct = u_turn()
    points = np.random.default_rng(seed).uniform((-6.0, -13.0), (6.0, 6.0), (300, 2))
    value = forms.half_planes_5_20(points, duct.left, duct.right)
    inside = (value < 0.0).all(axis=-1).any(axis=-1)
    held = duct.signed_distance(points) < 0.0
    # A point on a rung is on the border of two quads and in neither's inside.
    assert np.mean(inside == held) == 1.0


def test_the_weights_of_5_21_do_not_sum_to_one():
    left, right = FOOTNOTE
    shift = np.array([100.0, -40.0])
    for u, v in ((0.0, 0.0), (0.3, 0.6), (1.0, 0.5)):
        moved = forms.quad_5_21(left + shift, right + shift, u, v)
        assert moved == pytest.approx(forms.quad_5_21(left, right, u, v) + shift)
        printed = forms.quad_5_21_printed(left + shift, right + shift, u, v)
        wrong = printed - forms.quad_5_21_printed(left, right, u, v) - shift
        assert wrong == pytest.approx((1.0 - u) * shift)


@given(seed=SEEDS)
def test_5_21_runs_backwards_along_the_quads(seed):
    random, left, right = convex_quad(seed)
    duct = StitchedQuads(left, right)
    u, v = random.uniform(0.0, 1.0, (2, 20))
    points = forms.quad_5_21(left, right, u, v)
    assert points == pytest.approx(duct.locate(np.zeros(20, dtype=int), 1.0 - u, across=v))


@given(seed=SEEDS)
def test_6_1_needs_the_factor_b1(seed):
    random, left, right = convex_quad(seed)
    duct = StitchedQuads(left, right)
    across, along = random.uniform(0.1, 0.9, 2)
    point = duct.locate(0, along, across=across)
    solved = forms.solve_6_1(point, left, right)
    error = np.abs(solved - [across, along]).sum(axis=1)
    assert error.min() < 1e-6
    printed = forms.solve_6_1_printed(point, left, right)
    k = int(error.argmin())
    assert printed[k, 1] == pytest.approx(along, abs=1e-6)  # v is right
    b1 = left[0, 0] - left[1, 0]
    if abs(b1 - 1.0) > 0.01:
        assert abs(printed[k, 0] - across) > 1e-6


def test_6_1_with_parallel_walls_and_with_a_vanishing_row():
    left, right = np.array([[0.0, 1.0], [4.0, 1.0]]), np.array([[0.0, -1.0], [4.0, -1.0]])
    solved = forms.solve_6_1((1.0, 0.5), left, right)  # k3 = 0, and a2 + v a3 = 0
    assert solved == pytest.approx(np.tile([0.25, 0.25], (2, 1)))


def test_6_2_adds_a_length_to_an_area():
    left, right = np.array([[0.0, 0.0], [0.0, 4.0]]), np.array([[3.0, -1.0], [3.0, 6.0]])
    point = StitchedQuads(left, right).locate(0, 0.3, across=0.6)
    assert forms.solve_6_2(point, left, right) == pytest.approx([0.6, 0.3])
    assert abs(forms.solve_6_2_printed(point, left, right)[1] - 0.3) > 0.1
    # In another unit of length the right form answers the same, the printed one does not.
    scaled = [10.0 * a for a in (point, left, right)]
    assert forms.solve_6_2(*scaled) == pytest.approx([0.6, 0.3])
    change = forms.solve_6_2_printed(*scaled)[1] - forms.solve_6_2_printed(point, left, right)[1]
    assert abs(change) > 0.01
    with pytest.raises(InputError, match="both must be 0"):
        forms.solve_6_2(point, *FOOTNOTE)


def test_the_footnotes_point_has_other_complex_solutions_than_printed():
    left, right = FOOTNOTE
    point = np.array([10.0, -5.0])
    solved = forms.solve_6_1(point, left, right)
    wanted = np.array([[1.1667 + 0.5528j, 1.5 + 1.6583j], [1.1667 - 0.5528j, 1.5 - 1.6583j]])
    assert solved == pytest.approx(wanted, abs=1e-4)
    assert np.abs(solved[:, 0] - (1.0 + 0.6j)).min() > 0.15
    assert np.abs(solved[:, 1] - (2.0 + 1.9j)).min() > 0.5
    # They do solve the bilinear map, and eq. 5.21 as printed has real solutions instead.
    for across, along in solved:
        back = (1 - across) * ((1 - along) * left[0] + along * left[1])
        back = back + across * ((1 - along) * right[0] + along * right[1])
        assert back == pytest.approx(point.astype(complex), abs=1e-9)
    for start, root in (((-2, 1), (-2.449, 1.184)), ((2, 3), (2.449, 2.816))):
        found = fsolve(lambda w: forms.quad_5_21_printed(left, right, *w) - point, start)
        assert found == pytest.approx(root, abs=1e-3)


@given(seed=SEEDS)
def test_h_of_5_23_is_the_chord_and_the_share(seed):
    random = np.random.default_rng(seed)
    duct = u_turn()
    quad = random.integers(0, len(duct.left) - 1, 50)
    along, across = random.uniform(0.01, 0.99, 50), random.uniform(-0.4, 1.4, 50)
    points = duct.locate(quad, along, across=across)
    u, h = forms.quad_values_5_23(points, duct.left, duct.right)
    row = np.arange(50)
    chord = np.linalg.norm(
        duct.locate(quad, along, across=np.zeros(50))
        - duct.locate(quad, along, across=np.ones(50)),
        axis=1,
    )
    assert u[row, quad] == pytest.approx(1.0 - along, abs=1e-9)
    assert h[row, quad] == pytest.approx(-2.0 * chord**2 * across * (1.0 - across), abs=1e-8)


def test_h_alone_is_negative_outside_the_quads():
    # On the continuation of the first quad along the way: the strip is open there without chi.
    duct = u_turn()
    beyond = np.array([4.0, -13.0])
    _, h = forms.quad_values_5_23(beyond, duct.left, duct.right)
    assert np.nanmin(h) < 0.0 < duct.signed_distance(beyond)
    assert forms.quads_5_25(beyond, duct.left, duct.right) >= 0.0


def test_the_sum_of_5_25_rejects_half_of_a_u_turn_and_the_minimum_nothing():
    duct = u_turn()
    points = np.random.default_rng(0).uniform((-6.0, -13.0), (6.0, 6.0), (4000, 2))
    inside = duct.signed_distance(points) < 0.0
    printed = forms.quads_5_25_printed(points, duct.left, duct.right) < 0.0
    right = forms.quads_5_25(points, duct.left, duct.right) < 0.0
    assert np.array_equal(right, inside)
    assert not np.any(printed & ~inside)
    assert np.mean(printed[inside]) < 0.7  # much of the inside is rejected


def test_chi_is_one_inside_and_drops_at_once():
    t = np.array([-1e-9, 0.0, 0.5, 1.0, 1.0 + 1e-9])
    assert forms.step_5_24(t).tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]
    assert forms.membership_5_22([0.0, 1.0, 0.5], [0.5, 0.0, 1.0]).tolist() == [True, False, False]


@given(x=st.floats(-9.0, 9.0), v=st.floats(-0.5, 1.5))
def test_the_example_of_5_27_is_solved_in_closed_form(x, v):
    y = np.sin(x) * (1.0 - v) + (np.sin(x + np.pi / 8.0) + 1.0) * v
    assert forms.curves_5_27((x, y)) == pytest.approx([x, v], abs=1e-9)
