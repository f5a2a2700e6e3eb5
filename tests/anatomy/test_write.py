from __future__ import annotations

import nibabel
import numpy as np
import pytest
import trimesh

from bozzini.anatomy import make_phantom, read_tract, write_tract
from bozzini.errors import InputError, OutputError


@pytest.fixture(scope="module")
def labels():
    return make_phantom().to_labels(4.0)


@pytest.fixture(scope="module")
def surface():
    return make_phantom().to_surface(4.0)


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb"])
def test_a_surface_comes_back(tmp_path, surface, suffix):
    path = write_tract(tmp_path / f"tract.{suffix}", surface)
    back = read_tract(path)
    # The phantom's surface is of marching cubes.
    assert [item.code for item in back.findings] == ["voxel-surface"]
    assert len(back.faces) == len(surface.faces)
    assert back.volume == pytest.approx(surface.volume, rel=1e-5)
    np.testing.assert_allclose(back.vertices.min(axis=0), surface.vertices.min(axis=0), atol=1e-4)


@pytest.mark.parametrize("suffix", ["nii", "nii.gz"])
def test_labels_come_back(tmp_path, labels, suffix):
    path = write_tract(tmp_path / f"tract.{suffix}", labels)
    back = read_tract(path, labels="all")
    assert {item.code for item in back.findings} <= {"voxels-coarse"}
    assert back.label_values == (1, 2, 3)
    index = np.argwhere(labels.mask) @ labels.affine[:3, :3].T + labels.affine[:3, 3]
    again = np.argwhere(back.mask) @ back.affine[:3, :3].T + back.affine[:3, 3]
    np.testing.assert_allclose(again, index, atol=1e-4)
    header = nibabel.load(path).header
    assert header.get_xyzt_units()[0] == "mm"
    np.testing.assert_allclose(header.get_qform(), header.get_sform(), atol=1e-4)


def test_the_same_tract_gives_the_same_bytes(tmp_path, labels, surface):
    for suffix, tract in (("nii.gz", labels), ("stl", surface), ("glb", surface)):
        one = write_tract(tmp_path / f"a.{suffix}", tract).read_bytes()
        assert write_tract(tmp_path / f"b.{suffix}", tract).read_bytes() == one


def test_what_does_not_go_is_refused_and_nothing_is_left(tmp_path, labels, surface):
    path = write_tract(tmp_path / "tract.stl", surface)
    before = path.read_bytes()
    with pytest.raises(OutputError):
        write_tract(path, surface)
    with pytest.raises(InputError):
        write_tract(tmp_path / "other.stl", labels)
    assert [item.name for item in tmp_path.iterdir()] == ["tract.stl"]
    assert path.read_bytes() == before
    write_tract(path, make_phantom(seed=3).to_surface(4.0), force=True)
    assert trimesh.load(path).volume != pytest.approx(surface.volume, rel=1e-3)
