"""The projection shows the lumen where it is, whatever the grid's frame."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.anatomy.frame import find_axis
from bozzini.plot.fluoroscopy import VIEWS, render_fluoroscopy
from tests.plot.fake_motion import END, START, make_field

SIGNED_PERMUTATIONS = [
    np.eye(3)[:, order] * signs
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]


def find_pixel(picture, points):
    """Return row and column of the pixel under each point."""
    place = picture.project(points)
    rows, columns = picture.image.shape
    left, _, _, top = picture.extent
    column = np.floor((place[..., 0] - left) * columns / picture.width)
    row = np.floor((top - place[..., 1]) * rows / picture.height)
    return np.stack([row, column], axis=-1).astype(np.int64)


@pytest.mark.parametrize("axis", VIEWS)
@given(data=st.data())
@settings(max_examples=25)
def test_points_of_the_lumen_are_bright_and_points_beside_it_dark(axis, data):
    rotation = data.draw(st.sampled_from(SIGNED_PERMUTATIONS))
    spacing = data.draw(st.tuples(*[st.floats(0.7, 2.5)] * 3))
    start = np.array([30.0, -20.0, 25.0])
    end = np.array([10.0, -45.0, 0.0])
    field = make_field(start=start, end=end, radius=5.0, rotation=rotation, spacing=spacing)
    picture = render_fluoroscopy(field, axis=axis)
    inside = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
    row, column = find_pixel(picture, inside).T
    assert (picture.image[row, column] > 0.5).all()
    across = np.cross(end - start, np.eye(3)[VIEWS[axis][0]])
    across *= (5.0 + 2.0 * max(spacing)) / np.linalg.norm(across)
    middle = 0.5 * (start + end)
    for point in (middle + across, middle - across):
        row, column = find_pixel(picture, point)
        assert picture.image[row, column] == 0.0


@pytest.mark.parametrize("axis", VIEWS)
@pytest.mark.parametrize("rotation", SIGNED_PERMUTATIONS[::5])
def test_the_picture_does_not_depend_on_the_grid_it_came_from(axis, rotation):
    plain = render_fluoroscopy(make_field(), axis=axis)
    other = render_fluoroscopy(make_field(rotation=rotation), axis=axis)
    points = START + np.random.default_rng(0).normal(size=(50, 3)) * 20.0
    np.testing.assert_allclose(plain.project(points), other.project(points), atol=1e-9)
    assert other.labels == plain.labels
    assert other.tilt == pytest.approx(0.0, abs=1e-7)
    assert other.thickness.sum() * 2.25 == pytest.approx(plain.thickness.sum() * 2.25, rel=0.02)


@pytest.mark.parametrize("axis", VIEWS)
@pytest.mark.parametrize("frame", ["RAS", "LPS", "LSA", "IRP"])
def test_one_patient_looks_the_same_in_every_frame(axis, frame):
    turn = np.stack([find_axis(frame, side) for side in "RAS"]).T  # from RAS into the frame
    plain = make_field()
    other = replace(plain, origin=turn @ plain.origin, rotation=turn @ plain.rotation, frame=frame)
    one, two = render_fluoroscopy(plain, axis=axis), render_fluoroscopy(other, axis=axis)
    np.testing.assert_allclose(two.thickness, one.thickness, atol=1e-6)
    points = START + np.random.default_rng(0).normal(size=(50, 3)) * 20.0
    np.testing.assert_allclose(two.project(points @ turn.T), one.project(points), atol=1e-9)
    assert two.labels == one.labels


def test_thickness_is_the_lumens_own_and_its_sum_the_volume():
    field = make_field(spacing=(0.8, 1.3, 1.0))
    picture = render_fluoroscopy(field, axis="coronal")
    assert float(picture.thickness.max()) == pytest.approx(12.0, rel=0.06)
    rows, columns = picture.thickness.shape
    pixel = picture.width / columns * picture.height / rows
    exact = np.pi * 6.0**2 * 80.0 + 4.0 / 3.0 * np.pi * 6.0**3
    assert float(picture.thickness.sum()) * pixel == pytest.approx(exact, rel=0.02)


def test_directions_follow_radiological_custom():
    steps = {"R": (1, 0, 0), "L": (-1, 0, 0), "A": (0, 1, 0), "P": (0, -1, 0), "S": (0, 0, 1)}
    steps["I"] = (0, 0, -1)
    field = make_field()
    for axis, expected in (("coronal", "RLIS"), ("sagittal", "APIS"), ("axial", "RLPA")):
        picture = render_fluoroscopy(field, axis=axis)
        assert "".join(picture.labels) == expected
        toward = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1)}
        for letter, direction in zip(picture.labels, toward.values(), strict=True):
            np.testing.assert_allclose(picture.project(np.array(steps[letter])), direction)


def test_an_oblique_grid_is_projected_along_its_own_axis_and_says_so():
    angle = np.deg2rad(12.0)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    picture = render_fluoroscopy(make_field(rotation=turn), axis="coronal")
    assert picture.tilt == pytest.approx(angle)
    row, column = find_pixel(picture, np.stack([START, END])).T
    assert (picture.image[row, column] > 0.5).all()


def test_inflation_widens_the_shadow():
    plain = render_fluoroscopy(make_field(), axis="axial")
    wide = render_fluoroscopy(make_field(inflation=3.0), axis="axial")
    assert wide.width == pytest.approx(plain.width + 6.0, abs=3.1)
    assert (wide.image > 0).sum() > (plain.image > 0).sum()


def test_the_margin_is_empty():
    picture = render_fluoroscopy(make_field(), axis="coronal", margin=7.0)
    edge = 4  # 7 mm are at least 4 pixels of 1.5 mm
    for border in (picture.image[:edge], picture.image[-edge:]):
        assert not border.any()
    assert picture.image[:, :edge].max() == picture.image[:, -edge:].max() == 0.0
    assert picture.image.max() == pytest.approx(1.0)
