"""Figures 5.13 to 5.32, B.1, C.2 and C.3: ducts, motion in them, and what gets through."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

import bozzini as bz
from bozzini.duct import Centreline, Circles, Polygon, fit
from bozzini.duct.compose import without
from bozzini.duct.shapes.curves import BetweenCurves
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.points import PointCloud
from bozzini.duct.shapes.quads import StitchedQuads
from bozzini.duct.shapes.super_ellipses import SuperEllipses, SuperEllipsoids
from bozzini.motion import PlannerOptions, Scope, move_free_chain, place_tail, plan_insertion
from bozzini.plot.duct import draw_shapes
from bozzini.plot.figures import draw_depths
from bozzini.plot.style import AMBER, BLUE, GREEN, INK, LUMEN, RED, make_figure, make_panels
from validation.thesis.ducts import (
    curves_5_27,
    frame_5_17,
    minimum_5_18,
    quads_5_25,
    quads_5_25_printed,
    super_ellipse_5_16,
    to_shape,
)
from validation.thesis.solids import PrintedCircle, cylinder_point, measure_pinch
from validation.thesis.traverse_bend import Bend
from validation.thesis.traverse_curvature import (
    find_rolling_radius,
    measure_curve,
    printed_curve,
    relative_curvature,
)

LINK = 20.0  # of the single link [mm]
OPTIONS = PlannerOptions(head_step=1.0, advise=False)
THIN = 0.2  # diameter of bodies that are to be lines [mm]


def _follow_wave(x, *, height=10.0):
    """Return points (n, 2) of the middle line of our planar duct, and the unit normals there."""
    middle = np.stack([x, height * np.sin(x / 20.0)], axis=-1)
    slope = height / 20.0 * np.cos(x / 20.0)
    normal = np.stack([-slope, np.ones_like(slope)], axis=-1)
    return middle, normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _draw_duct(axes, duct, *, margin=6.0):
    """Fill a planar duct."""
    (left, low), (right, high) = duct.bounds + [[-margin], [margin]]
    x, y = np.meshgrid(np.linspace(left, right, 361), np.linspace(low, high, 241))
    value = duct.signed_distance(np.stack([x, y], axis=-1))
    axes.contourf(x, y, value, [-999.0, 0.0], colors=[LUMEN])
    axes.contour(x, y, value, [0.0], colors=[INK], linewidths=0.8)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes.grid(visible=False)


def _draw_chains(axes, plan, *, count=4):
    """Draw a chain on its way in; what is still in the introducer is cut off."""
    limits = axes.get_xlim(), axes.get_ylim()
    for k in np.linspace(0, plan.steps - 1, count + 1).astype(int)[1:]:
        shade = 0.3 + 0.7 * k / (plan.steps - 1)
        axes.plot(*plan.joints[k].T, ".-", color=GREEN, markersize=3.5, linewidth=1.0, alpha=shade)
    axes.set(xlim=limits[0], ylim=limits[1])


def _drag_link(duct, heads, tail):
    """Return tails (n, 2) of a link that is moved in a duct, and of one that is free."""
    tails = [tail]
    for head in heads[1:]:
        tails.append(place_tail(duct, head, old_tail=tails[-1], length=LINK).tail)
    free = move_free_chain([heads[0], tail], heads)[:, 1]
    return np.array(tails), free


def _plan(duct, points, *, links):
    """Plan a chain of so many links that reaches to the end of the path, by (5.15)."""
    line = Centreline.from_points(points, duct)
    scope = Scope(diameter=THIN, link_length=1.0001 * line.length / links)
    return plan_insertion(duct, line, scope=scope, method="thesis", options=OPTIONS)


def _describe(plan, duct):
    """Return what came of a chain, and how its links lie where both their joints are inside."""
    inside = duct.signed_distance(plan.joints) <= 1e-6
    both = inside[:, 1:] & inside[:, :-1]
    share = np.linspace(0.0, 1.0, 9)[:, None, None, None]
    body = (1.0 - share) * plan.joints[None, :, :-1] + share * plan.joints[None, :, 1:]
    deepest = float(duct.signed_distance(body[:, both]).max())
    side = f"cut the wall by up to {deepest:.2f} mm" if deepest > 0.005 else "do not cut the wall"
    word = "complete" if plan.status == "complete" else plan.reason_code
    return f"{plan.links} links of {plan.scope.link_length:.2f} mm, {word}; they {side}"


def _draw_pull(axes, duct, heads, tail, form):
    """Draw a link whose tail begins outside a duct, and the slope of a constraint function."""
    _draw_duct(axes, duct)
    tails, free = _drag_link(duct, heads, tail)
    for ends, color, name in ((tails, GREEN, "constrained"), (free, RED, "tractrix")):
        axes.plot(*ends.T, color=color, linewidth=1.8, label=f"tail, {name}")
    for k in range(0, len(heads), 12):
        axes.plot(*np.stack([heads[k], tails[k]]).T, ".-", color=GREEN, linewidth=0.9)
    (left, low), (right, high) = duct.bounds + [[-6.0], [6.0]]
    grid = np.stack(np.meshgrid(np.linspace(left, right, 24), np.linspace(low, high, 13)), axis=-1)
    step = 1e-3 * np.eye(2)
    slope = np.stack([form(grid + s) - form(grid - s) for s in step], axis=-1)
    size = np.linalg.norm(slope, axis=-1, keepdims=True)
    arrows = -slope / np.where(size > 0.0, size, np.inf)
    outside = duct.signed_distance(grid) > 0.0
    axes.quiver(*grid[outside].T, *arrows[outside].T, color="#8a97a5", width=0.002, scale=40)
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=2)
    still = float(np.mean(size[outside] == 0.0))
    first = int(np.argmax(duct.signed_distance(tails) < 1e-6))
    return tails, still, first


def fig_5_13():
    """Figure 5.13: a chain that avoids two circles in a plane.

    Printed: two circles; no dimensions.

    Ours: circles of 14 mm radius in a field of 200 by 110 mm, 30 links.

    Beside the print: the joints stay out of both circles. The links between them may cut into
    these: (5.14) looks at joints only.
    """
    space = without(
        Polygon([[0.0, -55.0], [200.0, -55.0], [200.0, 55.0], [0.0, 55.0]]),
        Circles(np.array([[75.0, -8.0], [125.0, 8.0]]), np.array([14.0, 14.0])),
    )
    x = np.arange(10.0, 191.0, 2.0)
    path = np.stack(
        [x, 22.0 * np.sin((x - 50.0) / 100.0 * math.tau) * (np.abs(x - 100.0) < 50.0)], 1
    )
    plan = _plan(space, path, links=30)
    figure, (axes,) = make_panels(size=(7.0, 4.0))
    _draw_duct(axes, space)
    axes.plot(*path.T, ":", color=BLUE)
    _draw_chains(axes, plan)
    return figure, _describe(plan, space)


@cache
def _make_ellipses():
    """Return five super-ellipses along the wave, and the head's path."""
    middle, normal = _follow_wave(np.linspace(12.0, 112.0, 5))
    angles = np.arctan2(-normal[:, 0], normal[:, 1])
    duct = SuperEllipses(
        middle, np.tile([17.0, 8.0], (5, 1)), powers=np.full(5, 4.0), angles=angles
    )
    return duct, _follow_wave(np.arange(0.0, 121.0, 1.0))[0]


def _evaluate_5_18(points):
    duct, _ = _make_ellipses()
    rows = zip(duct.centres, duct.half_axes, duct.powers, duct.angles, strict=True)
    return minimum_5_18(
        np.stack(
            [
                super_ellipse_5_16(to_shape(points, frame_5_17(t, c))[..., :2], [0, 0], a, n)
                for c, a, n, t in rows
            ],
            axis=-1,
        )
    )


def fig_5_14():
    """Figures 5.14, 5.15: super-ellipses, and a duct of five of them.

    Printed: five shapes, a to e, and the head's path; neither powers nor half axes.

    Ours: powers of 1, 2, 4 and 10 for half axes a = 1.5 b; of 17 and 8 mm with power 4, along a
    sine.

    Beside the print: the sign of (5.18) is that of the exact duct everywhere. Its value is no
    distance: the errata have how.
    """
    figure, (left, right) = make_panels(1, 2, size=(8.6, 3.4), width_ratios=(1.0, 2.2))
    for power, color in ((1.0, AMBER), (2.0, BLUE), (4.0, GREEN), (10.0, RED)):
        one = SuperEllipses([[0.0, 0.0]], [[1.5, 1.0]], powers=[power], angles=[0.0])
        ring = one.outline(0)
        left.plot(*np.concatenate([ring, ring[:1]]).T, color=color, label=f"n = {power:g}")
    left.legend(frameon=False, fontsize=9, loc="center")
    left.set(aspect="equal", xlabel="x / b", ylabel="y / b")
    duct, path = _make_ellipses()
    _draw_duct(right, duct)
    for k, name in enumerate("abcde"):
        ring = duct.outline(k)
        right.plot(*np.concatenate([ring, ring[:1]]).T, color=RED, linewidth=0.8)
        right.text(*(duct.centres[k] + [0.0, 2.0]), name, color=RED)
    right.plot(*path.T, color=BLUE)
    rng = np.random.default_rng(0)
    points = duct.bounds[0] + np.ptp(duct.bounds, axis=0) * rng.random((2000, 2))
    same = (_evaluate_5_18(points) < 0.0) == (duct.signed_distance(points) < 0.0)
    return figure, f"(5.18) and the duct agree on the side of {same.sum()} of {len(same)} places"


def fig_5_16():
    """Figures 5.16, 5.17: a link and a chain through super-ellipses, and a tail that is pulled in.

    Printed: a unit link and a chain; no dimensions.

    Ours: the duct of Fig. 5.15; a link of 20 mm, 20 links; the tail begins outside.

    Beside the print: the tail is pulled in at once and stays. The slope of (5.18), as arrows,
    points towards one of the shapes everywhere.
    """
    duct, path = _make_ellipses()
    figure, (upper, lower) = make_panels(2, 1, size=(7.0, 5.2))
    _draw_duct(upper, duct)
    plan = _plan(duct, path, links=20)
    upper.plot(*path.T, ":", color=BLUE)
    _draw_chains(upper, plan)
    heads = path[16:]
    start = heads[0] + LINK * np.array([math.cos(2.2), math.sin(2.2)])
    tails, still, first = _draw_pull(lower, duct, heads, start, _evaluate_5_18)
    inside = float(duct.signed_distance(tails[first:]).max())
    return figure, (
        f"chain: {_describe(plan, duct)}; tail inside after {first} step(s) of the head, "
        f"then never more than {max(inside, 1e-9):.0e} mm outside"
    )


@cache
def _make_quads():
    middle, normal = _follow_wave(np.linspace(0.0, 120.0, 7), height=14.0)
    wide = np.array([8.0, 6.0, 9.0, 7.0, 6.0, 9.0, 8.0])[:, None]
    return StitchedQuads(middle + wide * normal, middle - 1.2 * wide[::-1] * normal)


def fig_5_18():
    """Figure 5.18: a duct of six stitched quadrilaterals.

    Printed: six of them, A1 to A6; no corners.

    Ours: corners along a sine, 13 to 20 mm apart.

    Beside the print: here the sum (5.25) has the right side, as the least of chi h has. In a U
    turn, where strips of quadrilaterals cross other ones, the sum rejects places that are inside:
    see the errata.
    """
    duct = _make_quads()
    figure, (axes,) = make_panels(size=(7.0, 3.6))
    _draw_duct(axes, duct)
    for k, rung in enumerate(zip(duct.left, duct.right, strict=True)):
        axes.plot(*np.stack(rung).T, ".-", color=BLUE, linewidth=0.9)
        if k:
            corners = np.stack([duct.left[k - 1 : k + 1], duct.right[k - 1 : k + 1]])
            axes.text(*corners.mean(axis=(0, 1)), f"A{k}", ha="center", color=BLUE)
    rng = np.random.default_rng(0)
    points = duct.bounds[0] + np.ptp(duct.bounds, axis=0) * rng.random((3000, 2))
    inside = duct.signed_distance(points) < 0.0
    least = quads_5_25(points, duct.left, duct.right) < 0.0
    total = quads_5_25_printed(points, duct.left, duct.right) < 0.0
    return figure, (
        f"of {inside.sum()} places inside the least rejects {np.sum(inside & ~least)}, the sum "
        f"{np.sum(inside & ~total)}; outside both accept {np.sum(~inside & (least | total))}"
    )


def fig_5_19():
    """Figures 5.19, 5.20: a chain of 40 links through quadrilaterals, and a tail pulled in.

    Printed: 40 links; a unit link; no dimensions.

    Ours: the duct of Fig. 5.18; a link of 20 mm.

    Beside the print: chain and tail stay inside. The slope of the printed sum is zero where no
    strip of a quadrilateral is beside the place, so it cannot pull a tail in from everywhere.
    """
    duct = _make_quads()
    path = 0.5 * (duct.left + duct.right)
    along = np.linspace(0.0, 6.0, 121)
    path = np.stack([np.interp(along, np.arange(7.0), path[:, k]) for k in range(2)], axis=1)[2:-2]
    figure, (upper, lower) = make_panels(2, 1, size=(7.0, 5.6))
    _draw_duct(upper, duct)
    plan = _plan(duct, path, links=40)
    upper.plot(*path.T, ":", color=BLUE)
    _draw_chains(upper, plan)
    heads = path[18:]
    start = heads[0] + LINK * np.array([math.cos(2.4), math.sin(2.4)])
    tails, still, first = _draw_pull(
        lower, duct, heads, start, lambda at: quads_5_25_printed(at, duct.left, duct.right)
    )
    inside = float(duct.signed_distance(tails[first:]).max())
    return figure, (
        f"chain: {_describe(plan, duct)}; tail inside after {first} step(s), then never more than "
        f"{max(inside, 1e-9):.0e} mm outside; no slope at "
        f"{100.0 * still:.0f} % of the places outside"
    )


def fig_5_21():
    """Figures 5.21, 5.22: a duct between two sine curves, and a chain in it.

    Printed: both curves, and the path midway between them; neither links nor unit.

    Ours: the unit is 10 mm; 30 links.

    Beside the print: u and v are the printed closed form. Midway is half the share and not half the
    width, so the path comes nearer to one wall.
    """
    unit = 10.0
    duct = BetweenCurves(
        lambda u: unit * np.stack([u, np.sin(u)], axis=1),
        lambda u: unit * np.stack([u, np.sin(u + math.pi / 8.0) + 1.0], axis=1),
        span=(0.0, 4.0 * math.pi),
        tolerance=0.05,
    )
    u = np.linspace(0.4, 4.0 * math.pi - 0.4, 241)
    path = unit * np.stack([u, 0.5 * (np.sin(u) + np.sin(u + math.pi / 8.0) + 1.0)], axis=1)
    plan = _plan(duct, path, links=30)
    figure, (axes,) = make_panels(size=(7.0, 2.8))
    _draw_duct(axes, duct)
    axes.plot(*path.T, ":", color=BLUE)
    _draw_chains(axes, plan)
    share = curves_5_27(path / unit)
    off = np.abs(share - np.stack([u, 0.0 * u + 0.5], axis=1)).max()
    low, high = -duct.signed_distance(path).max(), -duct.signed_distance(path).min()
    return figure, (
        f"(5.27) inverted within {max(off, 1e-9):.0e}; on the path {low:.2f} to {high:.2f} mm "
        f"from the wall, "
        f"half the least gap is {5.0 * (1.0 - 2.0 * math.sin(math.pi / 16.0)):.2f} mm; "
        f"{_describe(plan, duct)}"
    )


def _surface(half_axes, e1, e2, *, count=25):
    """Return the surface (count, 2 count, 3) of a super-ellipsoid about the origin."""

    def power(value, exponent):
        return np.sign(value) * np.abs(value) ** exponent

    tall = np.linspace(-0.5 * math.pi, 0.5 * math.pi, count)[:, None]
    wide = np.linspace(-math.pi, math.pi, 2 * count)[None]
    flat = power(np.cos(tall), e1)
    parts = (
        flat * power(np.cos(wide), e2),
        flat * power(np.sin(wide), e2),
        power(np.sin(tall), e1) + 0.0 * wide,
    )
    return np.stack(parts, axis=-1) * half_axes


def _draw_surface(space, points, color=BLUE):
    space.plot_surface(
        *np.moveaxis(points, -1, 0), color=color, alpha=0.35, linewidth=0.2, edgecolor=color,
        rstride=2, cstride=2,
    )  # fmt: skip


def fig_5_23():
    """Figure 5.23: super-ellipsoids.

    Printed: equation (5.30); no exponents.

    Ours: half axes of 1, 1 and 1.4; exponents as written above each.

    Beside the print: the drawn points are on (5.30). An ellipsoid has n = 1, where the plane's
    (5.16) has n = 2: see the errata.
    """
    figure = make_figure((8.4, 4.6))
    axes = np.array([1.0, 1.0, 1.4])
    worst = 0.0
    for k, (e, n) in enumerate(
        ((1.0, 1.0), (0.3, 0.3), (1.0, 0.3), (0.3, 1.0), (2.0, 2.0), (2.0, 0.3))
    ):
        points = _surface(axes, n, e)
        scaled = np.abs(points / axes)
        across = (scaled[..., 0] ** (2 / e) + scaled[..., 1] ** (2 / e)) ** (e / n)
        worst = max(worst, np.abs((across + scaled[..., 2] ** (2 / n)) ** (n / 2) - 1.0).max())
        space = figure.add_subplot(2, 3, k + 1, projection="3d")
        _draw_surface(space, points)
        space.set_title(f"e = {e:g}, n = {n:g}", fontsize=10)
        space.set_box_aspect(axes)
        space.set_axis_off()
    return figure, f"left side of (5.30) within {max(worst, 1e-9):.0e} of 0"


def fig_5_24():
    """Figures 5.24 to 5.26: a pipe as ellipsoids, as cylinders, and as points.

    Printed: a pipe in three representations; no dimensions.

    Ours: half a turn of 30 mm radius, 10 mm to the wall; 13 ellipsoids, 12 cylinders, 3600 points.

    Beside the print: cylinders and points keep most of the pipe, ellipsoids pinch it where two of
    them meet.
    """
    turn = np.linspace(0.0, math.pi, 13)
    middle = 30.0 * np.stack([-np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    along = np.stack([np.sin(turn), np.cos(turn), 0.0 * turn], axis=1)
    across = middle / 30.0
    up = np.broadcast_to([0.0, 0.0, 1.0], across.shape)
    frames = np.stack([across, -up, along], axis=2)
    frames *= np.linalg.det(frames)[:, None, None] ** np.array([0.0, 1.0, 0.0])
    blocks = SuperEllipsoids(
        middle,
        np.tile([10.0, 10.0, 9.0], (13, 1)),
        e1=np.ones(13),
        e2=np.ones(13),
        rotations=frames,
    )
    cylinders = ConnectedCylinders(middle, along, np.full(13, 10.0))
    fine = np.linspace(0.0, math.pi, 90)
    ring = np.linspace(0.0, math.tau, 41)[:-1]
    away = 30.0 + 10.0 * np.cos(ring)
    wall = np.stack(
        [
            -away * np.cos(fine)[:, None],
            away * np.sin(fine)[:, None],
            10.0 * np.sin(ring) + 0.0 * fine[:, None],
        ],
        axis=-1,
    )  # fmt: skip
    ends = [
        wall[k].mean(axis=0) + s * (wall[k] - wall[k].mean(axis=0))
        for k in (0, -1)
        for s in np.arange(0, 1, 0.1)
    ]
    samples = np.concatenate([wall.reshape(-1, 3), *ends])
    cloud = PointCloud(samples, 1.2, seeds=middle[6:7])
    figure = make_figure((9.0, 3.4))
    spaces = [figure.add_subplot(1, 3, k, projection="3d") for k in (1, 2, 3)]
    ball = _surface(np.array([10.0, 10.0, 9.0]), 1.0, 1.0, count=13)
    for centre, frame in zip(middle, frames, strict=True):
        _draw_surface(spaces[0], centre + ball @ frame.T)
    rims = cylinders.centres[:, None] + 10.0 * (
        np.cos(ring)[None, :, None] * cylinders.frames[:, None, :, 0]
        + np.sin(ring)[None, :, None] * cylinders.frames[:, None, :, 1]
    )
    _draw_surface(spaces[1], np.concatenate([rims, rims[:, :1]], axis=1))
    spaces[2].plot(*wall.reshape(-1, 3)[::2].T, ".", color=BLUE, markersize=1.0)
    for space, name in zip(
        spaces, ("5.24: ellipsoids", "5.25: cylinders", "5.26: points"), strict=True
    ):
        space.set_title(name, fontsize=10)
        space.set(xlim=(-40, 40), ylim=(-10, 40), zlim=(-10, 10))
        space.set_box_aspect((80, 50, 20))
        space.set_axis_off()
    at = np.linspace(0.3, math.pi - 0.3, 200)
    line = 30.0 * np.stack([-np.cos(at), np.sin(at), 0.0 * at], axis=1)
    kept = [-duct.signed_distance(line).max() for duct in (blocks, cylinders, cloud)]
    return figure, (
        f"of 10 mm on the middle line {kept[0]:.2f} (ellipsoids), {kept[1]:.2f} (cylinders) and "
        f"{kept[2]:.2f} mm (points) are left"
    )


@cache
def _make_tract():
    tract = bz.make_phantom(seed=0).to_labels(voxel=3.0)
    field = bz.build_field(tract, voxel=3.0)
    return tract, field, bz.find_centreline(field)


def _draw_fit(kind, pieces):
    tract, field, line = _make_tract()
    found = fit(field, kind, centreline=line, pieces=pieces, inside=False)
    figure = draw_shapes(found.duct, field=field)
    figure.set_size_inches(6.4, 4.8)
    report = found.report
    return figure, report, found


def fig_5_27():
    """Figure 5.27: a tract as super-ellipsoids, fitted by least squares.

    Printed: a tract from the Visible Human, its shapes chosen by hand; neither tract nor shapes.

    Ours: the phantom of the upper tract, at 3 mm, in 20 shapes.

    Beside the print: no number to compare. Fitted so, shapes cross the wall; `bozzini duct fit`
    keeps them inside.
    """
    figure, report, found = _draw_fit("superellipsoids", 20)
    return (
        figure,
        f"{len(found.duct.centres)} shapes, outside by up to {report.outside_bound:.1f} mm",
    )


def fig_5_28():
    """Figure 5.28: a tract as connected cylinders, circles fitted by least squares.

    Printed: the same tract, circles across its medial axis; no number.

    Ours: the phantom at 3 mm, 30 cylinders.

    Beside the print: no number to compare; as for Fig. 5.27.
    """
    figure, report, found = _draw_fit("cylinders", 30)
    return (
        figure,
        f"{len(found.duct.radii)} circles, outside by up to {report.outside_bound:.1f} mm",
    )


def fig_5_29():
    """Figure 5.29: a scope on its way through the tract.

    Printed: a tract and a scope as rendered pictures; no dimensions.

    Ours: the phantom at 3 mm, a scope of 6 mm with links of 12 mm, the `tube` planner.

    Beside the print: the whole body is certified, where the thesis's scheme looks at joints only.
    """
    tract, field, line = _make_tract()
    plan = bz.plan_insertion(
        field, line, scope=Scope(diameter=6.0, link_length=12.0), method="tube", options=OPTIONS
    )
    figure = draw_depths(plan, field, depths=4, views=("coronal",))
    proved = plan.certificate.clearance
    return (
        figure,
        f"{plan.inserted:.0f} mm in, body at least {proved:.2f} mm from the wall, certified",
    )


def _pull_through_u_turn(link, *, step=0.25):
    """Return a U turn, heads and tails (n, 2) of a link by (5.15), and whether it gets through."""
    turn = np.linspace(math.pi, 0.0, 61)
    arc = np.stack([np.cos(turn), -np.sin(turn)], axis=1)
    walls = []
    for radius in (18.0, 12.0, 15.0):
        ends = radius * arc[[0, -1]] + [0.0, 45.0]
        walls.append(np.concatenate([ends[:1], radius * arc, ends[1:]]))
    duct = Polygon(np.concatenate([walls[0], walls[1][::-1]]))
    line = Centreline.from_points(walls[2] * [1.0, 0.96], duct)
    along = np.arange(link, line.length, step)
    heads = np.stack([np.interp(along, line.arc_length, column) for column in line.points.T], 1)
    tails = [line.points[0]]
    for head in heads[1:]:
        placed = place_tail(duct, head, old_tail=tails[-1], length=link)
        if not placed.found:
            break
        tails.append(placed.tail)
    return duct, heads[: len(tails)], np.array(tails), bool(tails[-1][0] > 0.0)


def fig_5_30():
    """Figure 5.30: a link that is too long locks in a trough.

    Printed: eight places of the head; no dimensions.

    Ours: half a turn of 15 mm radius, 6 mm wide; a link of 28 mm.

    Beside the print: the tail stops at the inner wall and is dragged back on its own way, as there.
    The length at which that begins is known in closed form.
    """
    duct, heads, tails, _ = _pull_through_u_turn(28.0)
    figure, (axes,) = make_panels(size=(5.0, 5.0))
    _draw_duct(axes, duct)
    axes.plot(*tails.T, color=AMBER, linewidth=2.0, label="way of the tail")
    for number, k in enumerate(np.linspace(0, len(heads) - 1, 8).astype(int), start=1):
        axes.plot(*np.stack([heads[k], tails[k]]).T, ".-", color=GREEN, linewidth=1.0)
        axes.annotate(str(number), heads[k], (4, -8), textcoords="offset points", fontsize=9)
    axes.legend(frameon=False, fontsize=9, loc="upper center")
    ways = {link: _pull_through_u_turn(link)[3] for link in (26.0, 26.9, 27.1, 28.0)}
    rows = ", ".join(
        f"{link:g} mm {'gets through' if way else 'is dragged back'}" for link, way in ways.items()
    )
    begins = Bend(radius=15.0, half_width=3.0).first_joint_lock()
    return figure, f"{rows}; locking begins at {begins:g} mm"


def fig_5_31():
    """Figure 5.31: circles that roll along a curve, just do, and do not.

    Printed: three circles on a curve; no dimensions.

    Ours: the trough of y = -10 cos(x / 10), of radius 10 mm; circles of 6, 10 and 14 mm.

    Beside the print: the largest that rolls has the radius of the trough. The printed relative
    curvature has the opposite sign: see the errata.
    """
    x = np.linspace(-25.0, 25.0, 401)
    curve = np.stack([x, -10.0 * np.cos(x / 10.0)], axis=1)
    first = np.stack([np.ones_like(x), np.sin(x / 10.0)], axis=1)
    second = np.stack([np.zeros_like(x), 0.1 * np.cos(x / 10.0)], axis=1)
    figure, (axes,) = make_panels(size=(7.0, 4.0))
    axes.plot(*curve.T, color=INK, linewidth=2.0)
    turn = np.linspace(0.0, math.tau, 200)
    bends = measure_curve(first, second)
    rows = []
    for radius, color, name in (
        (6.0, GREEN, "rolls"),
        (10.0, AMBER, "just"),
        (14.0, RED, "does not"),
    ):
        centre = np.array([0.0, -10.0 + radius])
        axes.plot(*(centre[:, None] + radius * np.stack([np.cos(turn), np.sin(turn)])), color=color,
                  label=f"{radius:g} mm: {name}")  # fmt: skip
        right = relative_curvature(bends, radius).min()
        printed = float(printed_curve(np.sin(0.0), 0.1, radius))
        rows.append(f"{radius:g} mm {right:+.3f} (printed {printed:+.3f})")
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    rolls = find_rolling_radius(bends)
    return figure, f"rolling radius {rolls:.3f} mm; relative curvature {', '.join(rows)} per mm"


def fig_5_32():
    """Figure 5.32: the link that the hypothesis allows, and the one that fits.

    Printed: that a link as long as the diameter of a circle that rolls gets through; no
    dimensions.

    Ours: a ring between 9 and 10 mm.

    Beside the print: refuted for ducts, not for a curve alone. Every circle inside the outer wall
    rolls along it, and a link of its diameter crosses the inner wall, never the outer one.
    """
    bend = Bend(radius=9.5, half_width=0.5)
    longest = bend.limit_rigid()
    turn = np.linspace(0.0, math.tau, 400)
    ring = np.stack([np.cos(turn), np.sin(turn)])
    figure, (axes,) = make_panels(size=(5.0, 4.8))
    axes.fill(*(10.0 * ring), color=LUMEN)
    axes.fill(*(9.0 * ring), color="white")
    for radius in (9.0, 10.0):
        axes.plot(*(radius * ring), color=INK)
    axes.plot(*(np.array([[1.5], [0.0]]) + 8.5 * ring), color=AMBER, label="circle of 17 mm rolls")
    axes.plot([1.5, 1.5], [-8.5, 8.5], color=RED, linewidth=2.0, label="a link of 17 mm")
    axes.plot([-9.0, -9.0], [-0.5 * longest, 0.5 * longest], color=GREEN, linewidth=2.5,
              label=f"longest link, {longest:.2f} mm")  # fmt: skip
    axes.set(aspect="equal", xlim=(-12, 12), ylim=(-11, 17), xlabel="x [mm]")
    axes.legend(frameon=False, fontsize=9, loc="upper center")
    return figure, f"circles to {20.0:g} mm roll; no link above {longest:.2f} mm fits"


def fig_b_01():
    """Figure B.1: a cylinder between two circles, and the printed one whose frame is turned over.

    Printed: the parameters u, t and θ, in (6.3) to (6.5); no numbers.

    Ours: radii of 10 and 7 mm, 30 mm apart, tilted by 20° and -15°; the same circle with its normal
    turned over.

    Beside the print: right as printed while the frames go together. With one turned over the wall
    is pinched; between parallel circles it would cross its own axis.
    """
    start = PrintedCircle((0.0, 0.0, 0.0), 10.0, math.radians(20.0), 0.0)
    stops = [
        PrintedCircle((0.0, 5.0, 30.0), 7.0, math.radians(-15.0) + flip, 0.0)
        for flip in (0.0, math.pi)
    ]
    t, theta = np.meshgrid(np.linspace(0.0, 1.0, 15), np.linspace(0.0, math.tau, 41), indexing="ij")
    figure = make_figure((7.0, 3.8))
    pinch = []
    for k, stop in enumerate(stops):
        space = figure.add_subplot(1, 2, k + 1, projection="3d")
        _draw_surface(space, cylinder_point(start, stop, u=np.ones_like(t), t=t, theta=theta))
        space.set_title(("frames alike", "one normal turned over")[k], fontsize=10)
        space.set_box_aspect((20, 22, 32))
        space.set_axis_off()
        pinch.append(measure_pinch(start, stop))
    return figure, (
        f"least radius over that of the smaller circle {pinch[0]:.3f}; {pinch[1]:.3f} turned over"
    )


def fig_c_02():
    """Figures C.2, C.3: a bicycle chain that is pulled aside, on photo paper and on gravel.

    Printed: a chain along the horizontal, pulled along -y; ν = 0.95 and 0.86; neither its length
    nor the way.

    Ours: 40 links of 12.7 mm, pulled by 400 mm.

    Beside the print: the photographs cannot be had. On gravel more of the chain follows the head's
    way and the other end is dragged farther; on paper it is swept aside.
    """
    chain = np.stack([12.7 * np.arange(41), np.zeros(41)], axis=1)
    heads = np.stack([np.zeros(201), -np.linspace(0.0, 400.0, 201)], axis=1)
    figure, panels = make_panels(1, 2, size=(8.0, 4.2), sharex=True, sharey=True)
    value = []
    for axes, (slip, name) in zip(
        panels, ((0.95, "C.2: photo paper"), (0.86, "C.3: gravel")), strict=True
    ):
        poses = move_free_chain(chain, heads, slip=slip)
        for k in range(0, 201, 50):
            axes.plot(*poses[k].T, ".-", color=BLUE, markersize=2.5, alpha=0.25 + 0.75 * k / 200)
        axes.plot(*move_free_chain(chain, heads)[-1].T, ":", color=INK, label="ν = 0")
        axes.set(aspect="equal", xlabel="x [mm]")
        axes.set_title(f"{name}, ν = {slip}", fontsize=10, loc="left")
        axes.legend(frameon=False, fontsize=9, loc="lower right")
        end = np.linalg.norm(poses[-1, -1] - poses[0, -1])
        value.append(f"ν = {slip}: the other end is dragged by {end:.0f} mm")
    panels[0].set_ylabel("y [mm]")
    return figure, "; ".join(value)
