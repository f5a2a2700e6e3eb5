from __future__ import annotations

import numpy as np
import pytest

from bozzini.anatomy import Finding, LabelTract, SurfaceTract
from bozzini.errors import GeometryError, InputError

TETRAHEDRON = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [0, 0, 5]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def block(fill=3, border=2):
    return np.pad(np.full((4, 5, 6), fill, dtype=np.uint16), border)


def test_a_label_tract_knows_its_voxels_and_volume():
    affine = np.diag([2.0, 0.5, 1.0, 1.0])
    tract = LabelTract(labels=block(), affine=affine, source="test")
    assert tract.kind == "labels"
    assert tract.spacing.tolist() == [2.0, 0.5, 1.0]
    assert tract.volume == pytest.approx(4 * 5 * 6 * 1.0)
    assert tract.label_values == (3,)
    assert tract.mask.sum() == 120


@pytest.mark.parametrize(
    ("labels", "affine", "error", "said"),
    [
        (block().astype(int), np.eye(4), InputError, "int64"),
        (block()[0], np.eye(4), InputError, "3 dimensions"),
        (block(fill=0), np.eye(4), GeometryError, "no lumen"),
        (block(border=1), np.eye(4), GeometryError, "two voxels"),
        (block(), np.eye(3), InputError, "(3, 3)"),
        (block(), np.full((4, 4), np.nan), InputError, "not finite"),
    ],
)
def test_a_label_tract_refuses(labels, affine, error, said):
    with pytest.raises(error) as caught:
        LabelTract(labels=labels, affine=affine, source="test")
    assert said in str(caught.value)


def test_a_surface_tract_measures_a_tetrahedron_wherever_it_is():
    tract = SurfaceTract(vertices=TETRAHEDRON + 1000.0, faces=FACES, source="test")
    assert tract.kind == "surface"
    assert tract.volume == pytest.approx(3 * 4 * 5 / 6)
    inward = SurfaceTract(vertices=TETRAHEDRON, faces=FACES[:, ::-1], source="test")
    assert inward.volume == pytest.approx(-10.0)


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        (FACES + 1, "1 to 4"),
        (FACES.astype(float), "integers"),
        (FACES[:0], "no faces"),
        (FACES[:, :2], "(m, 3)"),
    ],
)
def test_a_surface_tract_refuses(faces, said):
    with pytest.raises(InputError) as caught:
        SurfaceTract(vertices=TETRAHEDRON, faces=faces, source="test")
    assert said in str(caught.value)


def test_a_finding_has_one_of_two_severities():
    assert str(Finding("x", "note", "all is well")) == "note: all is well"
    with pytest.raises(InputError, match="'error'"):
        Finding("x", "error", "no")
