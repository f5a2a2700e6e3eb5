"""Figures of shapes: outlines lie on the walls and reach as far, panels show what was given."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from scipy.spatial.transform import Rotation

from bozzini.duct import Centreline, RoundCones
from bozzini.duct.fitting.measure import cut_sections
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.plot import write_figure
from bozzini.plot.duct import draw_sections, draw_shapes, outline_shapes
from tests.shapes import bend_curve, tube_lumen

CENTRES = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 15.0], [10.0, 0.0, 27.0]])
SHAPES = {
    "cones": RoundCones(CENTRES, [5.0, 7.0, 4.0]),
    "cylinders": ConnectedCylinders(
        CENTRES, [[0.1, 0, 1.0], [0.3, 0, 1.0], [0.5, 0, 0.9]], [5.0, 7.0, 4.0]
    ),
    "superellipsoids": SuperEllipsoids(
        CENTRES,
        [[9.0, 10.0, 13.0]] * 3,
        e1=np.array([0.1, 1.0, 2.0]),
        e2=np.array([0.2, 1.0, 1.5]),
        rotations=Rotation.from_rotvec(
            np.array([[0, 0, 0], [0.1, 0, 0.3], [0.4, 0.2, 0]])
        ).as_matrix(),
    ),
}


@pytest.fixture(scope="module")
def lumen():
    return tube_lumen(bend_curve(30.0, 1.0, 15.0), 8.0, voxel=2.0)


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_outlines_reach_as_far_as_the_shapes(kind):
    shapes = SHAPES[kind]
    points = outline_shapes(shapes).reshape(-1, 3)
    assert shapes.signed_distance(points).max() < 1e-6
    low, high = shapes.bounds
    assert points.min(axis=0) == pytest.approx(low, abs=0.02 * np.ptp(shapes.bounds))
    assert points.max(axis=0) == pytest.approx(high, abs=0.02 * np.ptp(shapes.bounds))
    assert (points >= low - 1e-9).all() and (points <= high + 1e-9).all()


def test_outlines_of_super_ellipsoids_lie_on_their_walls():
    shapes = SHAPES["superellipsoids"]
    for index, points in enumerate(outline_shapes(shapes)):
        assert shapes.evaluate_gauge(points)[:, index] == pytest.approx(1.0, abs=1e-9)


def test_inflation_counts():
    bare = outline_shapes(SHAPES["cones"]).reshape(-1, 3)
    more = outline_shapes(SHAPES["cones"].inflate(2.0)).reshape(-1, 3)
    assert more.max(axis=0) == pytest.approx(bare.max(axis=0) + 2.0, abs=0.05)


def _outlines(axes):
    return [item for item in axes.collections if isinstance(item, PolyCollection)]


@pytest.mark.parametrize("kind", sorted(SHAPES))
def test_each_view_has_an_outline_for_each_shape(kind, tmp_path):
    figure = draw_shapes(SHAPES[kind], title=kind)
    assert len(figure.axes) == 2
    count = len(outline_shapes(SHAPES[kind]))
    for axes in figure.axes:
        (group,) = _outlines(axes)
        assert len(group.get_paths()) == count
        assert axes.get_aspect() == 1.0
    path = write_figure(figure, tmp_path / "a.png", dpi=40)
    assert path.stat().st_size > 1000


def test_third_panel_compares_the_room(lumen):
    field, line = lumen
    shapes = RoundCones(line.points[::5], np.full(len(line.points[::5]), 6.0))
    figure = draw_shapes(shapes, field=field, line=line)
    assert len(figure.axes) == 3
    true, kept = figure.axes[2].get_lines()
    assert true.get_ydata() == pytest.approx(-field.signed_distance(line.points))
    assert kept.get_ydata() == pytest.approx(-shapes.signed_distance(line.points))


def test_sections_show_every_kind_of_circle(lumen):
    field, line = lumen
    sections = cut_sections(field, line, spacing=10.0, rays=24)
    circles = {"inscribed": sections.inscribe_circles(), "fitted": sections.fit_circles()}
    figure = draw_sections(field, line, sections, circles)
    labels = [item.get_label() for item in figure.axes[2].get_lines()]
    assert labels == ["clearance on the centreline", "inscribed", "fitted"]


def test_a_short_line_is_drawn_too(lumen):
    field, line = lumen
    short = Centreline.from_points(line.points[:5], field)
    assert len(draw_shapes(SHAPES["cones"], field=field, line=short).axes) == 3
