"""The widest way: its bound is never below what some way has, and it names the pinch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from bozzini.duct import field_from_mask
from bozzini.motion.space import find_passage
from tests.exact import VoxelWall, voxelise

AXIS = np.arange(0.0, 60.5, 0.5)[:, None] * np.array([0.0, 0.0, 1.0])


def tube(radius, voxel=1.0, shift=(0.0, 0.0, 0.0), tilt=0.0):
    turn = np.array(
        [[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]]
    )
    curve = AXIS @ turn.T + np.asarray(shift)
    mask, affine = voxelise(curve, radius, voxel=voxel)
    return field_from_mask(mask, affine), VoxelWall(mask, affine), curve


@settings(max_examples=20)
@given(
    radius=st.floats(1.6, 5.0),
    shift=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    tilt=st.floats(-1.2, 1.2),
    voxel=st.sampled_from([0.7, 1.0]),
)
def test_no_way_has_more_than_the_bound(radius, shift, tilt, voxel):
    field, wall, curve = tube(radius, voxel, shift, tilt)
    way = curve[12:-12]
    room = wall.clearance(way).min()
    passage = find_passage(field, way[0], goal=way[-1])
    assert passage.bound >= room - 1e-6
    assert passage.level <= passage.bound
    # ... and the bound is near: the lumen has nowhere more than radius + half a diagonal.
    assert passage.bound <= radius + 2.0 * voxel


def test_the_pinch_is_found_and_bounded():
    z = AXIS[:, 2]
    for at in (20.0, 37.0):
        radius = 5.0 - 3.2 * np.exp(-(((z - at) / 4.0) ** 2))
        field, _, curve = tube(radius)
        passage = find_passage(field, curve[12], goal=curve[-12])
        assert passage.place[2] == pytest.approx(at, abs=2.5)
        assert passage.bound < 1.8 + 1.2
        assert find_passage(field, curve[12], goal=curve[24]).level > passage.level


def test_the_wider_of_two_ways_counts():
    around = np.array([[0, 0, 0], [14, 0, 0], [14, 0, 40], [0, 0, 40]], dtype=float)
    narrow, affine = voxelise(AXIS[:81], 2.5)
    wide, other = voxelise(around, 4.5)
    levels = []
    for masks in (((narrow, affine),), ((narrow, affine), (wide, other))):
        low = np.min([m[1][:3, 3] for m in masks], axis=0)
        high = np.max([m[1][:3, 3] + m[0].shape for m in masks], axis=0)
        joined = np.zeros(np.ceil(high - low).astype(int) + 1, dtype=bool)
        for mask, matrix in masks:
            place = np.argwhere(mask) + np.rint(matrix[:3, 3] - low).astype(int)
            joined[tuple(place.T)] = True
        matrix = np.eye(4)
        matrix[:3, 3] = low
        field = field_from_mask(joined, matrix)
        levels.append(find_passage(field, AXIS[2], goal=AXIS[78]).level)
    assert levels[0] < 2.6
    assert levels[1] > levels[0] + 0.7


def test_inflation_adds_its_distance():
    field, _, curve = tube(3.0)
    plain = find_passage(field, curve[10], goal=curve[-10])
    raised = find_passage(field.inflate(2.0), curve[10], goal=curve[-10])
    assert raised.level == pytest.approx(plain.level + 2.0, abs=1e-6)
    # The bound is for the moved wall itself, which may leave a little more than the sum.
    assert plain.bound + 2.0 - 1e-6 <= raised.bound <= plain.bound + 2.0 + 1.0


def test_a_fold_that_inflation_swallows_proves_nothing():
    # A diaphragm one voxel thick with a narrow hole: inflated by 2 mm nothing of it is left.
    lumen = np.zeros((21, 21, 80), dtype=bool)
    across = np.hypot(*np.mgrid[-10:11, -10:11])
    lumen[across <= 6.0] = True
    lumen[:, :, 40] = across <= 1.0
    field = field_from_mask(lumen, np.eye(4))
    ends = [10.0, 10.0, 8.0], [10.0, 10.0, 72.0]
    rigid, inflated = (find_passage(field.inflate(c), ends[0], goal=ends[1]) for c in (0.0, 2.0))
    assert rigid.bound < 3.0
    # A point on the axis in the diaphragm's plane: the nearest place 2 mm from all lumen.
    outside = np.argwhere(~lumen) - [10, 10, 40]
    far = [p for p in outside if min(np.hypot(p[0], p[1]) - 6.5, 99) > 2.0]
    truth = min(np.hypot(p[0], p[1]) for p in far) - 1.0
    assert inflated.bound >= truth > 6.0


def test_both_ways_round_are_the_same():
    field, _, curve = tube(3.3, shift=(0.3, -0.2, 0.1), tilt=0.4)
    there = find_passage(field, curve[10], goal=curve[-10])
    back = find_passage(field, curve[-10], goal=curve[10])
    assert there.level == back.level and there.bound == back.bound


def find_plainly(field, start, goal):
    """Return (level, bound) by dense arrays: thresholds bisected over labelled components."""
    shape = np.array(field.values.shape)
    ends = [
        tuple(np.clip(np.rint(field.to_grid(p) / field.spacing).astype(int), 0, shape - 1))
        for p in (start, goal)
    ]
    room = field.inflation - field.values.astype(float)
    half = 0.5 * np.linalg.norm(np.sort(field.spacing)[1:])
    above = room
    if field.inflation > 0.0:
        free = field.values < field.inflation
        above = ndimage.distance_transform_edt(free, sampling=field.spacing)
        above[~free] = -1.0
    limits = []
    for values in (room, above):
        raised = values.copy()
        for end in ends:
            raised[end] = values.max()
        levels = np.unique(raised[raised > 0.0])
        low, high = 0, len(levels)
        while high - low > 1:
            middle = (low + high) // 2
            marks, _ = ndimage.label(raised >= levels[middle], structure=np.ones((3, 3, 3)))
            joined = marks[ends[0]] == marks[ends[1]]
            low, high = (middle, high) if joined else (low, middle)
        limits.append(levels[low])
    return min(limits[0], *(room[end] for end in ends)), limits[1] + half


@pytest.mark.parametrize("inflation", [0.0, 1.3])
def test_level_and_bound_are_those_of_dense_arrays(inflation):
    random = np.random.default_rng(3)
    mask = ndimage.gaussian_filter(random.normal(size=(22, 24, 40)), 2.2) > 0.02
    mask[9:13, 9:14, 2:-2] = True
    mask[:, :, 20] &= np.hypot(*np.mgrid[-11:11, -12:12]) < 6.0
    field = field_from_mask(mask, np.diag([1.0, 0.8, 1.1, 1.0])).inflate(inflation)
    ends = [11.0, 9.0, 5.0], [11.0, 9.0, 36.0]
    passage = find_passage(field, ends[0], goal=ends[1])
    level, bound = find_plainly(field, *ends)
    assert passage.level == pytest.approx(level, abs=1e-6)
    assert passage.bound == pytest.approx(bound, abs=1e-5)
    assert find_passage(field, ends[0], goal=ends[1]) is passage  # computed once
    assert find_passage(field.inflate(0.5), ends[0], goal=ends[1]).level > passage.level
