"""The shaped path: every chord of a link clear, ends kept, and a word where it cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from bozzini.duct import field_from_mask
from bozzini.duct.centreline import Centreline
from bozzini.motion import FreeSpace, Introducer
from bozzini.motion.shape import (
    SHORTEST_MM,
    Band,
    ShapedPath,
    cut_path,
    measure_folds,
)
from bozzini.numeric.polylines import measure_arc_length
from tests.exact import VoxelWall, voxelise
from tests.shapes import bend_curve


@pytest.fixture(scope="module")
def bend():
    mask, affine = voxelise(bend_curve(11.0, 2.6, 30.0), 5.5)
    field = field_from_mask(mask, affine)
    return (
        field,
        VoxelWall(mask, affine),
        Centreline.from_points(bend_curve(11.0, 2.6, 30.0)[7:-7], field),
    )


def shape(case, length, clearance, shaper=Band.shape, lead=60.0, **options):
    field, _, line = case
    introducer = Introducer.at_start(
        line, bore=float(field.clearance_bound(line.points[0])), along=length
    )
    path = np.ascontiguousarray(field.to_grid(line.points))
    space = FreeSpace(field, line, introducer)
    band = Band(space=space, length=length, clearance=clearance, lead=lead)
    return shaper(band, path, **options)


def walk_chords(path, length, first):
    """Chords from points of a polyline to the first point behind at `length`, by search."""
    arc = measure_arc_length(path)
    fine = np.arange(0.0, arc[-1], 0.05)
    dense = np.stack([np.interp(fine, arc, column) for column in path.T], axis=1)
    chords = []
    for head in range(np.searchsorted(fine, arc[first]), len(dense), 20):
        gaps = np.linalg.norm(dense[:head] - dense[head], axis=1)
        behind = np.flatnonzero(gaps >= length)
        if len(behind):
            chords.append((dense[head], dense[behind[-1]]))
    return np.array(chords)


@pytest.mark.parametrize("length", [4.0, 9.0, 14.0])
def test_every_chord_of_the_shaped_path_is_clear(bend, length):
    field, wall, line = bend
    shaped = shape(bend, length, 2.5)
    assert shaped.clear
    assert shaped.clear_until == pytest.approx(shaped.length)
    world = field.to_world(shaped.points)
    chords = walk_chords(world, length, shaped.first)
    u = np.linspace(0.0, 1.0, 30)[:, None, None]
    points = (chords[:, 0] + u * (chords[:, 1] - chords[:, 0])).reshape(-1, 3)
    outward = (world[0] - world[shaped.first]) / np.linalg.norm(world[0] - world[shaped.first])
    inside = (points - world[shaped.first]) @ outward < 0.0
    # Between its vertices, half a millimetre apart, a chord may lose a little.
    assert wall.clearance(points[inside]).min() >= 2.5 - 0.05
    assert wall.clearance(points[inside]).min() >= shaped.clearance - 0.05


def test_ends_and_introducer_stay(bend):
    field, _, line = bend
    shaped = shape(bend, 9.0, 2.5)
    world = field.to_world(shaped.points)
    assert world[shaped.first] == pytest.approx(line.points[0], abs=1e-9)
    assert world[-1] == pytest.approx(line.points[-1], abs=1e-9)
    assert shaped.arc_length[shaped.first] == 0.0
    assert np.all(np.diff(shaped.arc_length) > 0.0)
    turns = np.cross(world[0] - world[shaped.first], world[: shaped.first] - world[shaped.first])
    assert np.abs(turns).max() < 1e-6


def test_the_shape_turns_with_the_lumen():
    curve = bend_curve(13.0, 2.0, 25.0)
    mask, affine = voxelise(curve, 5.5)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    results = []
    for frame in (np.eye(3), turn):
        matrix = affine.copy()
        matrix[:3] = frame @ affine[:3]
        field = field_from_mask(mask, matrix)
        line = Centreline.from_points(curve[6:-6] @ frame.T, field)
        shaped = shape((field, None, line), 9.0, 2.5)
        results.append(field.to_world(shaped.points) @ frame)
    assert results[0] == pytest.approx(results[1], abs=1e-5)


def test_what_does_not_fit_is_said_and_cut(bend):
    field, wall, _ = bend
    shaped = shape(bend, 9.0, 5.4)
    assert not shaped.clear
    assert shaped.clearance < 5.4
    assert 0.0 <= shaped.clear_until < shaped.length
    # The part before it is clear for as much as was asked.
    easier = shape(bend, 30.0, 3.0, thorough=False)
    assert not easier.clear
    cut = cut_path(easier, easier.clear_until)
    assert isinstance(cut, ShapedPath) and cut.clear
    assert cut.length <= easier.clear_until + 1e-9
    chords = walk_chords(field.to_world(cut.points), 30.0, cut.first)
    u = np.linspace(0.0, 1.0, 30)[:, None, None]
    points = (chords[:, 0] + u * (chords[:, 1] - chords[:, 0])).reshape(-1, 3)
    entry = field.to_world(cut.points[cut.first])
    outward = field.to_world(cut.points[0]) - entry
    inside = (points - entry) @ outward < 0.0
    assert wall.clearance(points[inside]).min() >= 3.0 - 0.1


def test_growing_the_link_ends_at_the_length_or_at_the_largest_that_fits(bend):
    whole, largest = shape(bend, 9.0, 2.5, Band.grow_link)
    assert whole is not None and whole.clear and largest == 9.0
    none, largest = shape(bend, 40.0, 3.5, Band.grow_link)
    assert none is None and SHORTEST_MM <= largest < 40.0
    assert shape(bend, largest, 3.5, Band.grow_link)[0] is not None
    none, largest = shape(bend, 9.0, 5.4, Band.grow_link)
    assert none is None and largest == 0.0


def test_folds_of_a_line_and_of_a_circle():
    for radius, length in ((np.inf, 10.0), (20.0, 10.0), (12.0, 18.0)):
        if np.isinf(radius):
            points = np.arange(0.0, 100.0, 0.5)[:, None] * np.array([0.0, 0.0, 1.0])
            expected = 1.0
        else:
            angle = np.arange(0.0, 3.0, 0.02)
            points = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            # Tangent and chord of a circle.
            expected = np.sqrt(1.0 - (length / (2.0 * radius)) ** 2)
        arc = measure_arc_length(points)
        path = ShapedPath(
            points=points,
            arc_length=arc,
            first=0,
            clearance=1.0,
            tightest=0.0,
            clear=True,
            clear_until=float(arc[-1]),
        )
        cosines = measure_folds(path, length)
        assert cosines[arc > 2.0 * length] == pytest.approx(expected, abs=0.02)
