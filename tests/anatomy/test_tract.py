from __future__ import annotations

import numpy as np
import pytest

from bozzini.anatomy import Finding, LabelTract, SurfaceTract

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


def test_a_surface_tract_measures_a_tetrahedron_wherever_it_is():
    tract = SurfaceTract(vertices=TETRAHEDRON + 1000.0, faces=FACES, source="test")
    assert tract.kind == "surface"
    assert tract.volume == pytest.approx(3 * 4 * 5 / 6)
    inward = SurfaceTract(vertices=TETRAHEDRON, faces=FACES[:, ::-1], source="test")
    assert inward.volume == pytest.approx(-10.0)


def test_a_finding_is_one_line():
    assert str(Finding("x", "note", "all is well")) == "note: all is well"
