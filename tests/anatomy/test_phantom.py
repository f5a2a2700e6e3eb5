from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.anatomy import make_phantom, tract_from_labels, tract_from_surface
from bozzini.anatomy.kernels.meshes import fill_distance, measure_distance
from bozzini.anatomy.phantom import (
    BEND_GAP_MM,
    DIMENSIONS,
    LIMB_GAP_MM,
    Leg,
    draw_dimensions,
    trace_line,
)

SEEDS = st.integers(0, 100_000)


@pytest.fixture(scope="module")
def phantom():
    return make_phantom()


def distance_reference(points, centres, radii, parts=400):
    """Take the least over very many balls on each piece."""
    t = np.linspace(0.0, 1.0, parts)[:, None, None]
    balls = (centres[:-1] + t * (centres[1:] - centres[:-1])).reshape(-1, 3)
    sizes = (radii[:-1] + t[..., 0] * (radii[1:] - radii[:-1])).reshape(-1)
    gaps = np.linalg.norm(points[:, None] - balls[None], axis=2) - sizes
    return gaps.min(axis=1)


@settings(max_examples=30)
@given(seed=SEEDS, pieces=st.integers(1, 4))
def test_the_distance_is_that_of_very_many_balls(seed, pieces):
    random = np.random.default_rng(seed)
    centres = random.uniform(-20, 20, (pieces + 1, 3))
    radii = random.uniform(0.5, 25.0, pieces + 1)  # often one ball holds its neighbour
    points = random.uniform(-60, 60, (40, 3))
    exact = measure_distance(points, centres, radii)
    reference = distance_reference(points, centres, radii)
    assert (exact <= reference + 1e-9).all()
    np.testing.assert_allclose(exact, reference, atol=0.03)


def test_the_distance_of_one_ball_and_of_a_capsule_is_known():
    points = np.random.default_rng(2).uniform(-30, 30, (50, 3))
    same = np.zeros((2, 3))
    ball = measure_distance(points, same, np.array([5.0, 5.0]))
    np.testing.assert_allclose(ball, np.linalg.norm(points, axis=1) - 5.0)
    ends = np.array([[0.0, 0, -10], [0, 0, 10]])
    nearest = np.clip(points[:, 2], -10, 10)
    gap = np.hypot(np.hypot(points[:, 0], points[:, 1]), points[:, 2] - nearest) - 4.0
    np.testing.assert_allclose(measure_distance(points, ends, np.array([4.0, 4.0])), gap)


def test_the_grid_holds_the_same_distance_within_its_reach(phantom):
    centres, radii = phantom.centreline[100:130], phantom.radii[100:130]
    origin = centres.min(axis=0) - 50.0
    field, owner = fill_distance((30, 30, 40), origin, 4.0, centres, radii, 6.0)
    nodes = origin + 4.0 * np.moveaxis(np.indices(field.shape), 0, -1)
    exact = measure_distance(nodes.reshape(-1, 3), centres, radii).reshape(field.shape)
    near = exact < 6.0
    np.testing.assert_allclose(field[near], exact[near], atol=1e-4)
    assert (field[~near] == 6.0).all()
    assert np.array_equal(owner >= 0, near)


def test_a_line_of_two_legs_has_the_lengths_asked_for():
    legs = [
        Leg(heading=(0, 0, 1), bend=0.0, straight=10.0),
        Leg(heading=(3, 0, 0), bend=20.0, straight=5.0),
    ]
    points, bends, breaks = trace_line(legs, step=0.5)
    np.testing.assert_allclose(breaks, [0.0, 10.0, 10.0 + 10.0 * np.pi + 5.0])
    np.testing.assert_allclose(points[-1], (25.0, 0.0, 30.0), atol=1e-12)
    arc = points[bends == 20.0]
    np.testing.assert_allclose(np.linalg.norm(arc - (20.0, 0.0, 10.0), axis=1), 20.0)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.5 + 1e-12


def test_the_standard_phantom_has_the_published_lengths(phantom):
    lengths = phantom.region_lengths()
    size = {item.name: item.value for item in DIMENSIONS}
    assert lengths["oesophagus"] == pytest.approx(size["oesophagus_length"], abs=1.0)
    assert lengths["stomach"] == pytest.approx(size["stomach_length"], abs=1.0)
    parts = ("superior", "descending", "horizontal", "ascending")
    total = sum(size[f"{part}_length"] for part in parts)
    assert lengths["duodenum"] == pytest.approx(total, abs=1.0)
    assert sum(lengths.values()) == pytest.approx(phantom.length)
    assert dict(phantom.dimensions) == size


def test_the_standard_phantom_looks_like_the_anatomy(phantom):
    line, radius, region = phantom.centreline, phantom.radii, phantom.region
    assert np.abs(line[np.argmax(region == 2)]).max() < 1e-9  # origin at the junction
    assert line[0, 2] > 200.0  # the oesophagus comes from above
    stomach, duodenum = line[region == 2], line[region == 3]
    lowest = int(stomach[:, 2].argmin())
    # A J: down on the left, the bend, then up to the right, and the pylorus is narrow.
    assert stomach[: lowest + 1, 0].min() < -10.0
    assert stomach[-1, 0] > stomach[lowest, 0] + 30.0
    assert stomach[-1, 2] > stomach[lowest, 2] + 10.0
    assert radius[region == 2].max() > 2.5 * radius[region == 1].max()
    assert 2 * radius.min() == pytest.approx(14.3, abs=0.01)
    assert 2 * radius.min() > 12.0  # a 9 to 10 mm scope passes everywhere
    # A C that opens to the left, not in one plane, and back again near where it began.
    assert duodenum[:, 0].max() > duodenum[[0, -1], 0].max() + 20.0
    centred = duodenum - duodenum.mean(axis=0)
    assert np.linalg.svd(centred, compute_uv=False)[2] / np.sqrt(len(centred)) > 2.0
    assert np.linalg.norm(duodenum[-1] - duodenum[0]) < 0.5 * phantom.region_lengths()["duodenum"]


@pytest.mark.slow
def test_labels_and_surface_are_the_same_lumen(phantom):
    labels, surface = phantom.to_labels(2.0), phantom.to_surface(2.0)
    assert labels.volume == pytest.approx(surface.volume, rel=0.01)
    index = np.argwhere(labels.mask)
    centres = index @ labels.affine[:3, :3].T + labels.affine[:3, 3]
    assert phantom.signed_distance(centres).max() < 0.0
    assert np.abs(phantom.signed_distance(surface.vertices)).max() < 2.0**2 / 7.0
    outside = np.argwhere(~labels.mask)[::7]
    centres = outside @ labels.affine[:3, :3].T + labels.affine[:3, 3]
    assert phantom.signed_distance(centres).min() >= -1e-6


def test_the_surface_converges_to_the_wall(phantom):
    error = [np.abs(phantom.signed_distance(phantom.to_surface(h).vertices)).max() for h in (4, 2)]
    assert error[1] < error[0] / 2.0


def test_each_voxel_has_the_label_of_its_part(phantom):
    labels = phantom.to_labels(2.0)
    assert labels.label_values == (1, 2, 3)
    to_index = np.linalg.inv(labels.affine)
    index = phantom.centreline @ to_index[:3, :3].T + to_index[:3, 3]
    index = np.rint(index).astype(int)
    got = labels.labels[tuple(index.T)]
    same = got == phantom.region
    assert same.mean() > 0.97  # all but the samples beside a border between two parts
    assert (got > 0).all()


@settings(max_examples=25)
@given(seed=SEEDS)
def test_every_seed_is_valid(seed):
    phantom = make_phantom(seed=seed)
    for item in DIMENSIONS:
        assert item.low <= phantom.dimensions[item.name] <= item.high
    points, radii = phantom.centreline, phantom.radii
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    between = np.linalg.norm(points[:, None] - points[None], axis=2) - radii[:, None] - radii
    reach = radii[:, None] + radii + LIMB_GAP_MM
    far = np.abs(along[:, None] - along) > 1.6 * reach
    assert between[far].min() >= LIMB_GAP_MM - 0.01
    # The bend radius, from three samples in a row, is wider than the lumen.
    one, two, three = points[:-2], points[1:-1], points[2:]
    a, b, c = (np.linalg.norm(q - p, axis=1) for p, q in ((one, two), (two, three), (one, three)))
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1) / 2.0
    bend = a * b * c / np.maximum(4.0 * area, 1e-12)
    assert (bend - radii[1:-1]).min() > BEND_GAP_MM - 1.0
    assert radii.min() > 6.0


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=SEEDS)
def test_every_seed_is_one_closed_part_without_handles(seed):
    phantom = make_phantom(seed=seed)
    surface = phantom.to_surface(3.0)
    checked = tract_from_surface(surface.vertices, surface.faces)
    assert [item.code for item in checked.findings] == ["voxel-surface"]
    assert checked.volume == pytest.approx(surface.volume)
    labels = phantom.to_labels(4.0)  # the coarsest that is legal
    checked = tract_from_labels(labels.labels, labels.affine)
    assert {item.code for item in checked.findings} <= {"voxels-coarse"}


def test_a_seed_repeats_and_differs():
    assert np.array_equal(make_phantom(seed=5).centreline, make_phantom(seed=5).centreline)
    assert not np.allclose(make_phantom(seed=5).radii[:50], make_phantom(seed=6).radii[:50])
    assert draw_dimensions(None)["pylorus_diameter"] == 14.3


def test_distances_keep_the_shape_of_the_points(phantom):
    points = np.random.default_rng(0).uniform(-50, 50, (4, 5, 3))
    assert phantom.signed_distance(points).shape == (4, 5)
    assert phantom.signed_distance(points[0, 0]).shape == ()
    assert phantom.signed_distance(phantom.centreline).max() <= -phantom.radii.min() + 1e-9


def test_the_page_shows_every_dimension():
    guide = Path(__file__).resolve().parents[2] / "docs" / "theory" / "anatomy.md"
    rows = [line for line in guide.read_text(encoding="utf-8").splitlines() if line[:3] == "| `"]
    shown = {tuple(cell.strip(" `") for cell in row.split("|")[1:4]) for row in rows}
    for item in DIMENSIONS:
        row = (item.name, f"{item.value:g}", f"{item.low:g}\N{EN DASH}{item.high:g}")
        assert row in shown, row
