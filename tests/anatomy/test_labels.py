from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from skimage import measure

from bozzini.anatomy import tract_from_labels
from bozzini.errors import InputError


def codes(tract):
    return {finding.code: finding for finding in tract.findings}


def tube(shape=(12, 13, 40), label=1):
    array = np.zeros(shape, dtype=np.uint8)
    array[4:8, 5:9, 3:35] = label
    return array


def rotation(angles):
    a, b, c = angles
    one = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    two = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    three = np.array([[np.cos(c), 0, np.sin(c)], [0, 1, 0], [-np.sin(c), 0, np.cos(c)]])
    return one @ two @ three


def world_of(labels, affine, value):
    index = np.argwhere(labels == value)
    return index @ affine[:3, :3].T + affine[:3, 3]


@settings(max_examples=30)
@given(
    angles=st.tuples(*[st.floats(-3.1, 3.1)] * 3),
    size=st.tuples(*[st.floats(1.0, 4.0)] * 3),
    shift=st.tuples(*[st.floats(-500, 500)] * 3),
    flip=st.booleans(),
    seed=st.integers(0, 10_000),
)
def test_cropping_does_not_move_a_voxel_in_the_world(angles, size, shift, flip, seed):
    random = np.random.default_rng(seed)
    array = np.zeros(random.integers(5, 12, 3), dtype=np.int16)
    start = [random.integers(0, length) for length in array.shape]
    array[tuple(slice(at, at + random.integers(1, 5)) for at in start)] = 7
    array[tuple(start)] = 9
    affine = np.eye(4)
    affine[:3, :3] = rotation(angles) * size * (-1 if flip else 1)
    affine[:3, 3] = shift
    tract = tract_from_labels(array, affine)
    for value in np.unique(array[array > 0]):
        np.testing.assert_allclose(
            world_of(tract.labels, tract.affine, value),
            world_of(array, affine, value),
            atol=1e-9,
        )
    np.testing.assert_allclose(tract.spacing, size)


def test_the_crop_leaves_two_voxels_on_every_side():
    labels = tract_from_labels(tube(), np.eye(4)).labels
    assert labels.shape == (8, 8, 36)
    assert labels[2:-2, 2:-2, 2:-2].all()


def test_only_the_labels_asked_for_are_lumen():
    array = tube()
    array[4:8, 5:9, 20:35] = 2
    array[0, 0, 0] = 5
    tract = tract_from_labels(array, np.eye(4), labels=[2])
    assert tract.label_values == (2,)
    assert tract.mask.sum() == 4 * 4 * 15
    assert "1, 5" in codes(tract)["labels-left-out"].message
    assert tract_from_labels(array, np.eye(4), labels=[1, 2]).label_values == (1, 2)


def test_a_lumen_that_meets_only_at_an_edge_or_corner_is_two_components():
    array = np.zeros((20, 20, 30), dtype=np.uint8)
    array[2:10, 2:10, 2:20] = 1
    array[10:14, 10:14, 2:20] = 2  # meets the first along an edge
    array[14, 14, 20] = 3  # meets the second in a corner
    tract = tract_from_labels(array, np.diag([2.0, 1.0, 1.0, 1.0]))
    assert tract.label_values == (1,)
    dropped = codes(tract)["components-dropped"]
    assert dropped.severity == "warning"
    assert "3 components" in dropped.message
    assert f"{4 * 4 * 18 + 1} voxels" in dropped.message
    assert f"{(4 * 4 * 18 + 1) * 2 / 1000:.3g} mL" in dropped.message
    assert "2, 3" in codes(tract)["label-dropped"].message


def test_a_septum_leaves_the_rest_of_the_lumen_in_what_is_not_reached():
    array = np.zeros((12, 12, 60), dtype=np.uint8)
    array[3:9, 3:9, 3:30] = 4
    array[3:9, 3:9, 31:57] = 4  # one voxel of wall between
    array[3:9, 3:9, 50:57] = 5
    affine = np.diag([2.0, 1.0, 1.5, 1.0])
    affine[:3, 3] = 10.0, 20.0, 30.0
    tract = tract_from_labels(array, affine, names={4: "colon"})
    assert tract.volume == pytest.approx(6 * 6 * 27 * 3.0)
    (part,) = tract.not_reached
    assert part.volume == pytest.approx(6 * 6 * 26 * 3.0)
    assert part.label_names == ("colon", "label 5")
    index = np.rint((np.array(part.point) - affine[:3, 3]) / np.diag(affine)[:3]).astype(int)
    assert array[tuple(index)] in (4, 5)
    assert abs(index[2] - 43.5) <= 1 and abs(index[0] - 5.5) <= 1  # its middle
    dropped = codes(tract)["components-dropped"]
    assert dropped.severity == "warning"
    assert f"{6 * 6 * 26 * 3 / 1000:.3g} mL near (" in dropped.message
    array[5, 5, 30] = 4  # a hole of one voxel joins them
    assert tract_from_labels(array, affine).not_reached == ()


def test_every_voxel_is_kept_or_not_reached():
    random = np.random.default_rng(5)
    for _ in range(20):
        array = (random.random((9, 8, 10)) < 0.4).astype(np.uint8) * random.integers(1, 4)
        for order in "CF":
            tract = tract_from_labels(np.asarray(array, order=order), np.eye(4))
            assert tract.volume + sum(part.volume for part in tract.not_reached) == (
                np.count_nonzero(array)
            )
            numbers, count = ndimage.label(array)
            assert len(tract.not_reached) == count - 1
            sizes = np.sort(np.bincount(numbers.ravel())[1:])[::-1]
            assert [part.volume for part in tract.not_reached] == sizes[1:].tolist()
            for part in tract.not_reached:
                at = numbers[tuple(np.rint(part.point).astype(int))]
                assert np.count_nonzero(numbers == at) == part.volume


def test_handles_and_cavities_agree_with_another_count():
    random = np.random.default_rng(6)
    for density in (0.5, 0.7, 0.9):
        block = random.random((9, 10, 11)) < density
        kept = tract_from_labels(block.astype(np.uint8), np.eye(4)).mask
        found = codes(tract_from_labels(block.astype(np.uint8), np.eye(4)))
        number = [
            int(found[code].message.split()[0]) if code in found else 0
            for code in ("handles", "cavities")
        ]
        assert 1 - number[0] + number[1] == measure.euler_number(kept, connectivity=1)
        outside = ndimage.label(~np.pad(kept, 1), structure=np.ones((3, 3, 3)))[1]
        assert number[1] == outside - 1


def test_a_part_that_meets_the_lumen_along_an_edge_is_named():
    array = np.zeros((20, 20, 30), dtype=np.uint8)
    array[2:10, 2:10, 2:20] = 1
    array[10:14, 10:14, 2:20] = 1  # meets the first along an edge
    array[16:18, 2:4, 2:4] = 1  # stands alone
    message = codes(tract_from_labels(array, np.eye(4)))["components-dropped"].message
    assert "1 of them meets the lumen along an edge or in a corner only" in message


def test_a_label_inside_the_lumen_is_wall_and_is_named():
    array = tube()
    array[5:7, 6:8, 10:14] = 2
    array[8:10, 5:9, 3:35] = 3  # beside it
    for order in "CF":
        shuffled = np.asarray(array, order=order)
        tract = tract_from_labels(shuffled, np.eye(4), labels=[1], names={2: "polyp"})
        message = codes(tract)["label-inside"].message
        assert message.startswith("polyp (0.016 mL near (")
        assert "is not selected and lies inside the lumen" in message
        assert tract.mask.sum() == np.count_nonzero(array == 1)
        assert "0.016 mL" in codes(tract)["cavities"].message
        assert "label-inside" not in codes(tract_from_labels(shuffled, np.eye(4), labels=[1, 2]))


def test_labels_are_asked_for_where_there_are_several():
    array = tube()
    array[4:8, 5:9, 20:35] = 2
    with pytest.raises(InputError):
        tract_from_labels(array, np.eye(4), labels=None)
    assert tract_from_labels(tube(), np.eye(4), labels=None).label_values == (1,)


def test_handles_and_cavities_are_counted():
    ring = np.zeros((20, 20, 9), dtype=np.uint8)
    ring[2:18, 2:18, 2:7] = 1
    ring[6:8, 6:8, :] = 0
    ring[12:14, 12:14, :] = 0
    ring[15, 15, 4] = 0
    found = codes(tract_from_labels(ring, np.eye(4)))
    assert found["handles"].message.startswith("2 handles")
    assert found["cavities"].message.startswith("1 closed cavity")
    assert not {"handles", "cavities"} & set(codes(tract_from_labels(tube(), np.eye(4))))


def test_a_cavity_open_only_through_a_corner_is_no_cavity():
    # The background joins through corners where the lumen joins through faces only.
    block = np.zeros((9, 9, 9), dtype=np.uint8)
    block[2:7, 2:7, 2:7] = 1
    block[3, 3, 3] = 0
    assert "cavities" in codes(tract_from_labels(block, np.eye(4)))
    block[2, 2, 2] = 0
    assert "cavities" not in codes(tract_from_labels(block, np.eye(4)))


def test_a_ring_closed_only_along_an_edge_has_no_handle():
    ring = np.zeros((14, 14, 14), dtype=np.uint8)
    ring[2:12, 2:12, 2:12] = 1
    ring[3:11, 3:11, :] = 0
    assert "1 handle " in codes(tract_from_labels(ring, np.eye(4)))["handles"].message
    ring[2, 2, :] = 0  # its neighbours now meet along an edge
    assert "handles" not in codes(tract_from_labels(ring, np.eye(4)))


def test_a_lumen_at_the_border_is_said_to_be_cut():
    array = tube()
    array[4:8, 5:9, :3] = 1
    found = codes(tract_from_labels(array, np.eye(4)))["lumen-cut"]
    assert found.severity == "note"
    assert "low k" in found.message
    assert "high k" not in found.message


@pytest.mark.parametrize(
    ("size", "code"),
    [
        ((1, 1, 3), "voxels-anisotropic"),
        ((4, 4, 4), "voxels-coarse"),
        ((0.2, 0.2, 0.2), "scale"),
        ((300, 300, 300), "scale"),
    ],
)
def test_odd_voxels_are_warned_of(size, code):
    assert codes(tract_from_labels(tube(), np.diag([*size, 1.0])))[code].severity == "warning"
    assert tract_from_labels(tube(), np.eye(4)).findings == ()


def test_trailing_axes_of_one_and_whole_floats_are_taken():
    plain = tract_from_labels(tube(), np.eye(4))
    other = tract_from_labels(tube()[..., None, None].astype(float), np.eye(4))
    assert np.array_equal(plain.labels, other.labels)


@pytest.mark.parametrize(
    ("single", "said"),
    [
        ([1], ("1 other is not reached and counted as wall, 1 voxel (0.001 mL)",
               "label 1 lies wholly in the component not")),
        ([1, 2], ("2 others are not reached and counted as wall, 2 voxels (0.002 mL)",
                  "labels 1, 2 lie wholly in the components not")),
    ],
)  # fmt: skip
def test_what_is_dropped_is_counted_in_good_grammar(single, said):
    array = np.zeros((12, 12, 12), dtype=np.uint8)
    array[2:6, 2:6, 2:6] = 9
    for place, value in zip((8, 10), single, strict=False):
        array[place, place, place] = value
    found = codes(tract_from_labels(array, np.eye(4)))
    assert said[0] in found["components-dropped"].message
    assert found["label-dropped"].message.startswith(said[1])


def test_axes_not_quite_square_are_noted_only_where_it_moves_the_wall():
    array = np.zeros((12, 12, 12), dtype=np.uint8)
    array[1:-1, 1:-1, 1:-1] = 1
    affine = np.diag([20.0, 20.0, 20.0, 1.0])
    assert "axes-squared" not in codes(tract_from_labels(array, affine))
    affine[0, 1] = 20.0 * 3e-6
    assert "axes-squared" not in codes(tract_from_labels(array, affine))
    affine[0, 1] = 20.0 * 9e-4
    assert "wall by up to 0.0" in codes(tract_from_labels(array, affine))["axes-squared"].message


@pytest.mark.parametrize("limit", [1e6, 2e4])
def test_a_wall_is_told_from_a_lumen(limit, monkeypatch):
    """A bent tube, open at its ends, as lumen and as wall; a solid ring; two tubes that touch."""
    monkeypatch.setattr("bozzini.anatomy.labels.HOLLOW_VOXELS", limit)
    x, y, z = np.mgrid[-30:31, -30:31, 0:70].astype(float)
    away = np.hypot(x - 8.0 * np.sin(z / 20.0), y)
    ring = np.hypot(np.hypot(x, y) - 20.0, z - 35.0) < 7.0
    told = {
        name: [f.message for f in tract_from_labels(mask.astype(np.uint8), np.eye(4)).findings
               if f.code == "hollow"]
        for name, mask in {
            "lumen": away < 8.0,
            "wall": (away >= 8.0) & (away < 10.0),
            "ring": ring,
            "pair": (away < 8.0) | (np.hypot(x + 14.0, y - 4.0) < 8.0),
        }.items()
    }  # fmt: skip
    assert len(told.pop("wall")) == 1
    assert not any(told.values())
