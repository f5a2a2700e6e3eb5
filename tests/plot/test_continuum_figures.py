"""Figures of continuum robots show the shape's own points, at true scale."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from bozzini.continuum import ArcModel, ContinuumRobot, LinkageModel, RodModel, Section, Tendon
from bozzini.continuum.arc import displacements_for
from bozzini.continuum.workspace import map_dexterity, sample_workspace
from bozzini.plot import write_figure
from bozzini.plot.continuum import draw_comparison, draw_shape, draw_workspace


def make_robot(sections=2, tendons=3):
    return ContinuumRobot(
        tuple(
            Section(
                length=40.0,
                radius=4.0 - 0.5 * i,
                discs=4,
                tendons=tuple(
                    Tendon(name=f"t{i}{k}", offset=2.0, angle=2.0 * math.pi * k / tendons)
                    for k in range(tendons)
                ),
            )
            for i in range(sections)
        )
    )


ROBOT = make_robot()
PULLED = displacements_for(ROBOT, [[0.5, 0.4], [-0.2, 0.9]])


@cache
def arc_shape():
    return ArcModel(ROBOT).shape(PULLED)


def lines(axes, label):
    return [line for line in axes.lines if line.get_label() == label]


def data(line):
    got = line.get_data_3d() if hasattr(line, "get_data_3d") else line.get_data()
    return np.asarray(got, dtype=float)


def test_shape_is_drawn_point_by_point(tmp_path):
    figure = draw_shape(arc_shape())
    space, side, top = figure.axes
    (backbone,) = lines(space, "backbone")
    assert data(backbone).T == pytest.approx(arc_shape().points)
    for k, name in enumerate(ROBOT.tendon_names):
        (line,) = lines(space, name)
        assert data(line).T == pytest.approx(arc_shape().tendon_points[k])
        assert line.get_linestyle() == "-"
    drawn = [data(line) for line in top.lines]
    assert any(d.shape[1] == len(arc_shape().points) and np.allclose(d.T, arc_shape().points[:, :2])
               for d in drawn)  # fmt: skip
    heights = [data(line)[1] for line in side.lines]
    assert any(
        len(h) == len(arc_shape().points) and np.allclose(h, arc_shape().points[:, 2])
        for h in heights
    )
    out = tmp_path / "shape.png"
    write_figure(figure, out)
    assert out.stat().st_size > 10_000


def test_scales_are_true():
    figure = draw_shape(arc_shape())
    space, *flat = figure.axes
    for axes in flat:
        assert axes.get_aspect() == 1.0
    sides = np.array([np.ptp(getattr(space, f"get_{name}lim")()) for name in "xyz"])
    box = np.asarray(space._box_aspect)
    assert box / box[0] == pytest.approx(sides / sides[0], rel=1e-9)
    low = np.array([getattr(space, f"get_{name}lim")()[0] for name in "xyz"])
    assert np.all(arc_shape().points >= low)
    assert np.all(arc_shape().points <= low + sides)


def test_discs_stand_where_they_are_and_are_as_wide_as_the_body():
    space = draw_shape(arc_shape()).axes[0]
    rings = [data(line).T for line in space.lines if data(line).shape[1] == 49]
    centres = np.concatenate([[[0.0, 0.0, 0.0]], arc_shape().disc_frames[:, :3, 3]])
    tangents = np.concatenate([[[0.0, 0.0, 1.0]], arc_shape().disc_frames[:, :3, 2]])
    assert len(rings) == len(centres) == 9
    for ring, centre, tangent, radius in zip(
        rings, centres, tangents, [4.0] * 5 + [3.5] * 4, strict=True
    ):
        assert np.linalg.norm(ring - centre, axis=1) == pytest.approx(np.full(49, radius))
        assert (ring - centre) @ tangent == pytest.approx(np.zeros(49), abs=1e-9)


def test_the_side_view_is_the_plane_of_a_planar_bend():
    bent = ArcModel(ROBOT).shape(displacements_for(ROBOT, [[0.5, 0.5], [0.4, 0.4]]))
    side = draw_shape(bent).axes[1]
    backbone = data(side.lines[-1])
    assert backbone[1] == pytest.approx(bent.points[:, 2])
    assert backbone[0] == pytest.approx(np.hypot(*bent.points[:, :2].T), abs=1e-9)
    assert side.get_xlabel() == "towards 45° [mm]"


def test_slack_tendons_are_dotted_and_named():
    loose = PULLED - np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    shape = ArcModel(ROBOT).shape(loose)
    assert shape.converged
    assert shape.slack.any()
    figure = draw_shape(shape)
    for name, slack in zip(ROBOT.tendon_names, shape.slack, strict=True):
        (line,) = lines(figure.axes[0], name)
        assert (line.get_linestyle() != "-") == slack
        assert (name in figure.get_suptitle()) == slack


def test_target_and_direction_are_marked():
    top = draw_shape(arc_shape(), target=[20.0, 5.0, 60.0], direction=[0.0, 3.0, 0.0]).axes[2]
    (mark,) = lines(top, "target")
    assert data(mark).ravel() == pytest.approx([20.0, 5.0])
    arrow = data(top.lines[-1])
    assert arrow[:, 1] - arrow[:, 0] == pytest.approx([0.0, 0.15 * ROBOT.length])


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_the_length_of_a_direction_does_not_matter(scale):
    top = draw_shape(arc_shape(), direction=[0.0, scale, scale]).axes[2]
    arrow = data(top.lines[-1])
    assert np.hypot(*(arrow[:, 1] - arrow[:, 0])) == pytest.approx(
        0.15 * ROBOT.length * math.sqrt(0.5)
    )


def test_many_tendons_get_no_legend():
    robot = make_robot(sections=4)
    figure = draw_shape(ArcModel(robot).shape(np.zeros(12)))
    assert not figure.legends
    assert draw_shape(arc_shape()).legends


def test_comparison_draws_every_model_and_its_distance():
    shapes = {"linkage": LinkageModel(ROBOT).shape(PULLED), "arc": arc_shape(),
              "rod": RodModel(ROBOT).shape(PULLED)}  # fmt: skip
    figure = draw_comparison(shapes)
    side, front, apart = figure.axes
    assert side.get_aspect() == front.get_aspect() == 1.0
    for name, shape in shapes.items():
        for axes in (side, front):
            (line,) = lines(axes, name)
            assert data(line)[1] == pytest.approx(shape.points[:, 2])
        u, v = (data(lines(axes, name)[0])[0] for axes in (side, front))
        assert np.hypot(u, v) == pytest.approx(np.hypot(*shape.points[:, :2].T), abs=1e-9)
    (line,) = lines(apart, "linkage")
    off = np.linalg.norm(shapes["linkage"].tip - shapes["rod"].tip)
    assert data(line)[:, -1] == pytest.approx([ROBOT.length, off])
    assert not lines(apart, "rod")


def test_comparison_of_one_has_no_distances():
    assert len(draw_comparison({"arc": arc_shape()}, reference=None).axes) == 2
    assert len(draw_comparison({"rod": arc_shape()}).axes) == 2


@cache
def sample():
    return sample_workspace(ROBOT, 2000)


@cache
def half_plane_map():
    return map_dexterity(sample(), cell=6.0, half_plane=True)


def test_map_has_each_cell_at_its_place():
    figure = draw_workspace(half_plane_map(), length=ROBOT.length)
    panels = [axes for axes in figure.axes if axes.get_xlabel().startswith("distance")]
    assert len(panels) == 2
    found = half_plane_map()
    for axes, values in zip(panels, (found.direction_share, found.manipulability), strict=True):
        assert axes.get_aspect() == 1.0
        (mesh,) = axes.collections
        corners = mesh.get_coordinates()
        middles = 0.5 * (corners[:-1, :-1] + corners[1:, 1:])
        shown = mesh.get_array()
        assert shown.count() == len(values)
        for centre, value in zip(found.centres, values, strict=True):
            near = np.linalg.norm(middles - centre[[0, 2]], axis=-1)
            assert near.min() < 1e-9
            assert shown.reshape(near.shape)[np.unravel_index(near.argmin(), near.shape)] == value


def test_map_in_space_has_a_point_for_each_cell():
    cubes = map_dexterity(sample(), cell=10.0)
    figure = draw_workspace(cubes)
    space = figure.axes[0]
    assert space.name == "3d"
    assert len(space.collections[0].get_array()) == len(cubes.centres)


@pytest.mark.parametrize(("sections", "unit"), [(1, "mm²/rad²"), (2, "mm³/rad³")])
def test_manipulability_has_its_unit(sections, unit):
    few = sample_workspace(make_robot(sections), 50)
    figure = draw_workspace(map_dexterity(few, cell=8.0, half_plane=True))
    assert f"mean manipulability [{unit}]" in [axes.get_ylabel() for axes in figure.axes]
