"""The centreline: in the middle, inside everywhere, between the right ends."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree
from skimage.graph import MCP_Geometric

from benchmarks.line_ends import FAR, SCALES, VOXELS, measure_miss
from bozzini.anatomy import make_phantom
from bozzini.duct import build_field, field_from_mask, find_centreline, fit, load
from bozzini.duct.centreline import LumenGraph
from bozzini.errors import GeometryError, InputError
from bozzini.numeric.polylines import measure_arc_length, resample_polyline
from tests.human import load_human
from tests.shapes import ball_distance, bend_curve, curve_distance, sample_field, tube_lumen

ANGLES = (1.5, 3.6, 5.7)
"""Directions of the legs of a fork [rad]."""


@pytest.fixture(scope="module")
def bend():
    curve = bend_curve(25.0, np.pi, 30.0)
    field, _ = tube_lumen(curve, 7.0)
    return curve, field


def test_a_tube_gives_back_its_axis(bend):
    curve, field = bend
    line = find_centreline(field)
    # The ends are found one radius or less inside the caps; the axis goes on to the caps' centres.
    off = cKDTree(resample_polyline(curve, 0.1)).query(line.points)[0]
    assert off.max() < 1.5 and off.mean() < 0.7
    missing = cKDTree(line.points).query(curve)[0]
    assert missing.max() < 7.0
    assert line.radius.min() > 5.0
    assert line.radius == pytest.approx(-field.signed_distance(line.points))


def test_points_are_ordered_evenly_spaced_and_inside(bend):
    line = find_centreline(bend[1])
    steps = np.diff(line.arc_length)
    assert np.all(steps > 0.0)
    assert steps.max() / steps.min() < 1.2
    assert line.arc_length == pytest.approx(measure_arc_length(line.points))
    assert np.all(bend[1].signed_distance(line.points) < 0.0)
    turned = line.reverse()
    assert turned.points[::-1] == pytest.approx(line.points)
    assert turned.arc_length == pytest.approx(measure_arc_length(turned.points))


def test_given_ends_are_kept_exactly(bend):
    start, end = [0.0, 1.0, -20.0], [50.0, -1.0, -10.0]
    line = find_centreline(bend[1], (start, end))
    assert line.points[0] == pytest.approx(start)
    assert line.points[-1] == pytest.approx(end)


def test_the_higher_found_end_is_the_start():
    curve = bend_curve(30.0, np.pi / 2, 25.0)[:, [0, 1, 2]]
    for flip in (1.0, -1.0):
        field, _ = tube_lumen(curve * [1, 1, flip], 6.0)
        line = find_centreline(field)
        assert line.points[0, 2] > line.points[-1, 2]


@pytest.mark.slow
def test_a_pouch_is_not_taken_for_the_far_end():
    # A wide tube bent by 180 degrees with a blind pouch on the outside of the bend: the taut way
    # to the pouch's tip is longer than to the end, the middle way is not.
    curve = bend_curve(20.0, np.pi, 25.0)
    pouch = np.array([[20.0, 0.0, 20.0], [20.0, 0.0, 52.0]])
    tube, blind = curve_distance(curve, 12.0), curve_distance(pouch, 8.0)
    field = sample_field(
        lambda points: np.minimum(tube(points), blind(points)),
        curve.min(axis=0) - 16.0,
        [60.0, 16.0, 66.0],
        1.0,
    )
    line = find_centreline(field)
    ends = line.points[[0, -1]]
    gap = np.linalg.norm(ends[:, None] - curve[[0, -1]], axis=2)
    assert min(gap[0, 0] + gap[1, 1], gap[0, 1] + gap[1, 0]) < 16.0


def test_inflation_opens_no_short_cut_between_neighbouring_limbs():
    # Limbs 14 mm apart, wall to wall 2 mm: inflated by 3 mm they merge.
    curve = bend_curve(7.0, np.pi, 60.0)
    field, _ = tube_lumen(curve, 6.0, voxel=0.7)
    merged = field.inflate(3.0)
    assert merged.signed_distance([7.0, 0.0, -30.0]) < 0.0
    line = find_centreline(merged)
    assert line.length > 110.0


def test_an_end_outside_or_in_another_lumen_is_refused(bend):
    _, field = bend
    with pytest.raises(GeometryError, match=r"start \(25, 0, -30\) mm lies outside the lumen by"):
        find_centreline(field, ([25.0, 0.0, -30.0], None))
    with pytest.raises(InputError, match="end has 1 point"):
        find_centreline(field, (None, [np.nan, 0.0, 0.0]))
    two = [np.array([[x, 0.0, 0.0], [x, 0.0, 20.0]]) for x in (0.0, 20.0)]
    first, second = (curve_distance(curve, 5.0) for curve in two)
    apart = sample_field(
        lambda points: np.minimum(first(points), second(points)), (-8, -8, -8), (28, 8, 28), 1
    )
    with pytest.raises(GeometryError, match=r"not connected.* a wall closes it") as caught:
        find_centreline(apart, ([0.0, 0.0, 5.0], [20.0, 0.0, 5.0]))
    assert read_place(caught.value)[0] == pytest.approx(10.0, abs=1.0)
    assert "--voxel" not in str(caught.value)


def read_place(error):
    return np.array(
        [float(v) for v in str(error).split("nearest at (")[1].split(")")[0].split(",")]
    )


def test_a_septum_between_two_ends_is_named():
    tube = curve_distance(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 60.0]]), 6.0)

    def closed(points):
        return np.maximum(tube(points), 0.6 - np.abs(points[..., 2] - 22.3))

    field = sample_field(closed, (-8, -8, -8), (8, 8, 68), 1)
    for ends in (([0, 0, 5.0], [0, 0, 50.0]), ([0, 0, 50.0], [0, 0, 5.0])):
        with pytest.raises(GeometryError, match="a wall closes it between them") as caught:
            find_centreline(field, ends)
        assert read_place(caught.value)[2] == pytest.approx(22.3, abs=1.0)
        assert "narrower than 1 mm may be found with a smaller --voxel" in str(caught.value)


@pytest.mark.slow
def test_human_upper_gi_against_the_published_midline(upper_gi_dir):
    _, field, line = load_human(upper_gi_dir, "labels")
    with (upper_gi_dir / "upper_gi_axis.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    axis = np.array([[float(row[key]) for key in ("x_mm", "y_mm", "z_mm")] for row in rows])
    assert np.all(field.signed_distance(line.points) < 0.0)
    assert cKDTree(axis).query(line.points)[0].mean() < 4.0
    assert cKDTree(line.points).query(axis)[0].mean() < 4.0
    order = cKDTree(axis).query(line.points)[1]
    assert np.corrcoef(order, np.arange(len(order)))[0, 1] > 0.99


@pytest.fixture(scope="module")
def labelled():
    """A straight tube, 117 mm long, in three parts along z: 0 to 50, to 95, to 117 mm."""
    axis = np.array([[0.0, 0.0, 8.0], [0.0, 0.0, 109.0]])
    field = sample_field(curve_distance(axis, 8.0), (-12, -12, -4), (12, 12, 121), 1.5)
    nodes = np.argwhere(field.values < 0.0) * field.spacing + field.origin
    cuts = (-1.0, 50.0, 95.0, 200.0)
    parts = [nodes[(nodes[:, 2] >= a) & (nodes[:, 2] < b)] for a, b in pairwise(cuts)]
    return field, dict(enumerate(parts, start=1)), cuts


@pytest.mark.parametrize(
    ("start", "end"),
    [(1, 3), (3, 1), (1, None), (None, 3), (None, 1), (3, None), (2, None), (None, 2), (1, 2)],
)
@pytest.mark.parametrize("voxel", [1.5, 1.1])
def test_ends_in_labels_lie_in_them_and_keep_their_order(labelled, start, end, voxel):
    field, parts, cuts = labelled
    if voxel != 1.5:
        axis = np.array([[0.0, 0.0, 8.0], [0.0, 0.0, 109.0]])
        field = sample_field(curve_distance(axis, 8.0), (-12, -12, -4), (12, 12, 121), voxel)
    line = find_centreline(field, regions=(parts.get(start), parts.get(end)))
    for label, point in ((start, line.points[0]), (end, line.points[-1])):
        if label is not None:
            gap = np.abs(parts[label] - point).max(axis=1).min()
            assert gap <= 0.75, (label, point)
    # The end that is open is the one far from the label: nearly all of the way is made.
    low, high = sorted(line.points[[0, -1], 2])
    assert high - low > (75.0 if 2 in (start, end) else 95.0)
    if {start, end} & {1, 3}:
        assert (line.points[0, 2] < line.points[-1, 2]) == (start == 1 or end == 3)


def test_a_label_of_the_whole_lumen_says_nothing(labelled):
    field, parts, _ = labelled
    everything = np.concatenate(list(parts.values()))
    free = find_centreline(field)
    assert find_centreline(field, regions=(everything, None)).points == pytest.approx(free.points)
    assert free.points[0, 2] > free.points[-1, 2]


def test_a_ball_is_no_tube():
    field = sample_field(ball_distance((0, 0, 0), 28.0), (-32,) * 3, (32,) * 3, 2.0)
    with pytest.raises(GeometryError, match=r"no tube was found.*--start and --end"):
        find_centreline(field)
    line = find_centreline(field, ([-20.0, 0, 0], [20.0, 0, 0]))
    assert line.length == pytest.approx(40.0, abs=1.0)
    with pytest.raises(GeometryError, match="same point"):
        find_centreline(field, ([1.0, 0, 0], [1.0, 0, 0]))


def test_a_fork_is_told_and_a_single_tube_is_not(bend):
    legs = [np.array([[0.0, 0, 0], 80.0 * np.array([np.cos(a), 0, np.sin(a)])]) for a in ANGLES]
    parts = [curve_distance(leg, 6.0) for leg in legs]
    field = sample_field(
        lambda points: np.minimum.reduce([part(points) for part in parts]),
        (-90, -10, -90),
        (90, 10, 90),
        2.0,
    )
    tips = np.array([leg[1] for leg in legs])
    line = find_centreline(field)
    taken = [int(np.argmin(np.linalg.norm(tips - p, axis=1))) for p in line.points[[0, -1]]]
    (left,) = set(range(3)) - set(taken)
    (other,) = line.other_ends
    assert np.linalg.norm(tips[left] - other.point) < 8.0
    assert other.distance == pytest.approx(line.length, rel=0.2)
    assert [o.end for o in line.reverse().other_ends] != [other.end]
    # It can be given as the end, and ends that are given are not doubted.
    again = find_centreline(field, (line.points[0], other.point))
    assert again.other_ends == ()
    assert find_centreline(bend[1]).other_ends == ()


Y = np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [100.0, 20.0, 0.0], [70.0, -50.0, 0.0]])
"""Trunk, fork, and the tips of two branches; a pouch on the fork makes ways through it dearer."""


def make_y(scale, voxel):
    """Return a Y of a wider trunk and two branches at right angles, `scale` times as large."""
    trunk, fork, one, other = scale * Y
    parts = [
        curve_distance(np.array([trunk, fork]), 11.0 * scale),
        curve_distance(np.array([fork, one]), 9.0 * scale),
        curve_distance(np.array([fork, other]), 9.0 * scale),
        ball_distance(scale * np.array([50.0, 0.0, 10.0]), 16.0 * scale),
    ]
    return sample_field(
        lambda points: np.minimum.reduce([part(points) for part in parts]),
        scale * np.array([-15.0, -63.0, -20.0]),
        scale * np.array([113.0, 33.0, 30.0]),
        voxel * scale,
    )


@pytest.mark.parametrize("scale", [1.0, 0.1])
@pytest.mark.parametrize("voxel", [1.0, 1.25, 1.6])
def test_a_fork_has_the_same_ends_at_every_voxel_and_scale(scale, voxel):
    line = find_centreline(make_y(scale, voxel))
    ends = line.points[[0, -1]] / scale
    gaps = np.linalg.norm(ends[:, None] - Y[[0, 2]], axis=2)
    # From the trunk to the branch that goes on nearly straight: longer than across the fork.
    assert min(gaps[0, 0] + gaps[1, 1], gaps[0, 1] + gaps[1, 0]) < 2.0 * np.sqrt(3.0) * voxel
    assert line.length / scale == pytest.approx(103.5, abs=2.0 * voxel)
    (other,) = line.other_ends
    assert np.linalg.norm(np.array(other.point) / scale - Y[3]) < 2.0 * voxel + 1.0
    # Its way is measured as the line is, and is not longer.
    assert other.distance < line.length


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("voxel", "scale"), [(0.15, 0.1), (0.35, 4.0)])
def test_ends_lie_in_the_middle_of_the_cap_within_a_voxel(seed, voxel, scale):
    assert measure_miss(seed, voxel, scale)[0] < 1.0


@pytest.mark.slow
def test_ends_of_sixty_tubes_and_forks_are_those_of_the_longest_way():
    misses = []
    for seed in range(60):  # each of them at two voxels and two scales
        for turn in (seed, seed + 3):
            voxel, scale = VOXELS[turn % len(VOXELS)], SCALES[(turn + seed) % len(SCALES)]
            miss = measure_miss(seed, voxel, scale)[0]
            assert miss * np.sqrt(3.0) * voxel < max(FAR, np.sqrt(3.0) * voxel)
            misses.append(miss)
    assert np.mean(np.array(misses) <= 1.0) > 0.95


def test_the_way_to_another_end_is_that_of_the_line_to_it():
    field = make_y(1.0, 1.25)
    line = find_centreline(field)
    (other,) = line.other_ends
    opposite = line.points[0 if other.end == "end" else -1]
    way = find_centreline(field, (opposite, other.point))
    assert other.distance == pytest.approx(way.length, abs=1.5)


class PlainSearch:
    def __init__(self, mcp, costs):
        self.mcp, self.costs = mcp, costs

    def __getitem__(self, node):
        return self.costs[tuple(node)]

    def traceback(self, node):
        return np.array(self.mcp.traceback(tuple(node)))


class PlainGraph(LumenGraph):
    """The same over the whole grid, by scikit-image: the reference."""

    def search(self, source, near=None):
        mcp = MCP_Geometric(self._dense(), sampling=tuple(self.field.spacing), fully_connected=True)
        costs = mcp.find_costs([tuple(node) for node in np.atleast_2d(source)])[0]
        return PlainSearch(mcp, costs)

    def measure_lengths(self, source):
        ones = np.where(self.inside, 1.0, -1.0)
        mcp = MCP_Geometric(ones, sampling=tuple(self.field.spacing), fully_connected=True)
        costs = mcp.find_costs([tuple(node) for node in np.atleast_2d(source)])[0]
        return costs[self.inside]

    def _dense(self):
        dense = np.full(self.number.shape, -1.0)
        dense[self.inside] = self.weights
        return dense


def odd_lumen():
    """Anisotropic voxels, two pieces, a side branch."""
    index = np.indices((16, 30, 40)) - np.array([7.5, 15.0, 0.0])[:, None, None, None]
    mask = np.hypot(index[0], index[1] - 8.0 * np.sin(index[2] / 9.0)) < 5.0
    mask |= (np.hypot(index[0], index[2] - 20.0) < 2.5) & (index[1] < 0.0)
    mask[:, :, 37] = False
    return field_from_mask(mask, np.diag([0.7, 1.3, 1.0, 1.0]))


def test_costs_and_lengths_are_those_of_a_plain_search():
    field = odd_lumen()
    sparse, plain = LumenGraph(field), PlainGraph(field)
    places = sparse.places()
    assert np.array_equal(np.argwhere(plain.inside), places)
    for source in (places[5], places[[0, 200, -1]]):
        costs = plain.search(source).costs
        found = sparse.search(source)
        finite = np.isfinite(found.costs)
        assert np.array_equal(finite, np.isfinite(costs[plain.inside]))
        assert found.costs[finite] == pytest.approx(costs[plain.inside][finite], rel=1e-12)
        lengths, expected = sparse.measure_lengths(source), plain.measure_lengths(source)
        assert np.array_equal(np.isinf(lengths), np.isinf(expected))
        assert lengths[finite] == pytest.approx(expected[finite], rel=1e-12)
    assert not np.isfinite(sparse.search(places[5]).costs).all()  # the other piece
    way = sparse.search(places[5]).traceback(places[-2000])
    steps = np.linalg.norm(np.diff(way * field.spacing, axis=0), axis=1)
    weights = sparse.weights[sparse.number[tuple(way.T)]]
    middle = 0.5 * (weights[1:] + weights[:-1])
    assert (steps * middle).sum() == pytest.approx(sparse.search(places[5])[way[-1]])


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_line_is_that_of_a_plain_search(monkeypatch, seed):
    field = build_field(make_phantom(seed=seed).to_labels(voxel=2.0), voxel=2.0)
    # Voxels leave ways of equal cost, and which is taken is chance: make them differ a little.
    noise = np.random.default_rng(0).uniform(0.999, 1.0, field.values.shape)
    field = replace(field, values=(field.values * noise).astype(np.float32))
    line = find_centreline(field)
    monkeypatch.setattr("bozzini.duct.centreline.LumenGraph", PlainGraph)
    plain = find_centreline(field)
    assert line.points == pytest.approx(plain.points, abs=1e-3)
    assert len(line.other_ends) == len(plain.other_ends)


def test_the_picture_has_the_clearance_over_the_arc_length(bend):
    line = find_centreline(bend[1])
    ax = line.plot()
    drawn = ax.lines[-1].get_xydata()
    assert np.array_equal(drawn, np.column_stack([line.arc_length, line.radius]))
    assert line.plot(ax) is ax and len(ax.lines) == 2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: find_centreline(None), "field is a NoneType: it must be a SampledField"),
        (lambda: build_field("x.nii.gz"), "tract is 'x.nii.gz': read the file by read_tract"),
        (lambda: build_field(None), "tract is a NoneType: it must be a LabelTract or"),
        (lambda: fit(None), "source is a NoneType: it must be a LabelTract, a SurfaceTract or a"),
        (lambda: load(None), "path is None: it must be the path of a file"),
    ],
)
def test_what_is_none_of_the_kind_is_refused(call, words):
    with pytest.raises(InputError, match=f"^{words}"):
        call()
