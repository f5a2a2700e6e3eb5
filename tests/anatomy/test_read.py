from __future__ import annotations

import gzip
import logging

import nibabel
import numpy as np
import pytest
import trimesh

from bozzini.anatomy import read_labels, read_surface, read_tract
from bozzini.errors import BozziniError, FileFormatError, InputError


def codes(tract):
    return {finding.code: finding for finding in tract.findings}


def tube():
    array = np.zeros((12, 13, 40), dtype=np.uint8)
    array[4:8, 5:9, 3:20] = 1
    array[4:8, 5:9, 20:35] = 2
    return array


def save(path, array, affine=None, unit="mm", code=1):
    affine = np.eye(4) if affine is None else affine
    image = nibabel.Nifti1Image(array, affine)
    image.header.set_xyzt_units(unit)
    image.set_sform(affine, code=code)
    image.set_qform(affine, code=0)
    nibabel.save(image, path)
    return path


def box():
    return trimesh.creation.box((20.0, 30.0, 40.0))


@pytest.fixture
def scan(tmp_path):
    return save(tmp_path / "scan.nii.gz", tube())


def test_a_label_file_keeps_its_world_frame(tmp_path):
    affine = np.array([[0, -0.8, 0, 40], [0.9, 0, 0, -7], [0, 0, 1.5, 300], [0, 0, 0, 1.0]])
    path = save(tmp_path / "scan.nii.gz", tube(), affine)
    tract = read_tract(path, labels=[2])
    index = np.argwhere(tract.labels == 2)
    there = index @ tract.affine[:3, :3].T + tract.affine[:3, 3]
    expected = np.argwhere(tube() == 2) @ affine[:3, :3].T + affine[:3, 3]
    np.testing.assert_allclose(there, expected, atol=1e-4)  # NIfTI keeps float32
    assert tract.source == "scan.nii.gz"


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("meter", 1e-3), ("micron", 1e3)])
def test_the_unit_of_the_header_is_obeyed(tmp_path, unit, scale):
    affine = np.diag([scale, scale, scale, 1.0])
    path = save(tmp_path / "scan.nii", tube(), affine, unit)
    tract = read_labels(path, labels="all")
    np.testing.assert_allclose(tract.spacing, 1.0, rtol=1e-6)
    assert ("unit-converted" in codes(tract)) == (unit != "mm")


def test_a_file_without_unit_or_frame_says_so(tmp_path):
    path = save(tmp_path / "scan.nii", tube(), unit="unknown", code=0)
    found = codes(read_labels(path, labels="all"))
    assert found["unit-unknown"].severity == "note"
    assert found["frame-unknown"].severity == "warning"


def test_a_series_of_one_volume_is_taken_and_of_two_refused(tmp_path):
    one = read_labels(save(tmp_path / "one.nii", tube()[..., None]), labels="all")
    assert one.mask.sum() == 16 * 32
    with pytest.raises(FileFormatError):
        read_labels(save(tmp_path / "two.nii", np.stack([tube()] * 2, axis=-1)))


def broken_files(folder):
    whole = save(folder / "whole.nii.gz", tube()).read_bytes()
    plain = gzip.decompress(whole)
    noise = np.random.default_rng(0).integers(0, 3, (30, 30, 30)).astype(np.uint8)
    long = save(folder / "noise.nii.gz", noise).read_bytes()
    stl = box().export(file_type="stl")
    files = {
        "missing.nii.gz": None,
        "missing.stl": None,
        "empty.nii.gz": b"",
        "empty.stl": b"",
        "cut.nii.gz": long[: len(long) // 2],
        "head.nii.gz": gzip.compress(plain[:400]),
        "cut.nii": plain[: len(plain) // 2],
        "text.nii": b"these are words, not voxels\n" * 40,
        "text.nii.gz": b"these are words, not voxels\n" * 40,
        "text.stl": b"these are words, not triangles\n" * 40,
        "solid.stl": b"solid nothing\nendsolid nothing\n",
        "cut.stl": stl[:300],
        "text.ply": b"these are words\n",
        "text.obj": b"these are words\n",
        "text.off": b"these are words\n",
        "text.glb": b"these are words\n",
        "cut.glb": box().export(file_type="glb")[:200],
        "text.vtk": b"these are words\n",
        "binary.vtk": bytes(range(256)),
        "scan.dcm": b"DICM",
        "scan": b"x",
    }
    for name, data in files.items():
        if data is not None:
            (folder / name).write_bytes(data)
    (folder / "folder.stl").mkdir()
    return [*files, "folder.stl"]


def test_every_broken_file_is_one_clear_line(tmp_path, capfd):
    for name in broken_files(tmp_path):
        with pytest.raises(FileFormatError) as caught:
            read_tract(tmp_path / name)
        said = str(caught.value)
        assert name in said, name
        assert "\n" not in said, name
        assert len(said) < 400 + len(str(tmp_path)), name
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_the_loggers_of_the_readers_are_given_back(tmp_path):
    save(tmp_path / "scan.nii", tube())
    read_labels(tmp_path / "scan.nii", labels="all")
    assert not logging.getLogger("nibabel.global").disabled
    assert not logging.getLogger("trimesh").disabled


@pytest.mark.parametrize("suffix", ["stl", "ply", "obj", "glb", "off"])
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("m", 1e-3), ("in", 1 / 25.4)])
def test_every_format_and_unit_gives_the_same_surface(tmp_path, suffix, unit, scale):
    mesh = box()
    mesh.apply_translation((100.0, -20.0, 5.0))
    low, high = mesh.bounds
    mesh.apply_scale(scale)
    path = tmp_path / f"box.{suffix}"
    mesh.export(path)
    tract = read_tract(path, unit=unit)
    np.testing.assert_allclose(tract.vertices.min(axis=0), low, atol=1e-4)
    np.testing.assert_allclose(tract.vertices.max(axis=0), high, atol=1e-4)
    assert tract.volume == pytest.approx(24_000.0, rel=1e-5)
    assert len(tract.vertices) == 8
    assert not {"corners-welded", "holes-filled"} & set(codes(tract))


def test_the_nodes_of_a_scene_are_put_in_their_places(tmp_path):
    scene = trimesh.Scene()
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[:3, 3] = 50.0, 60.0, 70.0
    scene.add_geometry(box(), transform=mirror)
    scene.add_geometry(trimesh.creation.box((2.0, 2.0, 2.0)))
    scene.export(tmp_path / "scene.glb")
    tract = read_surface(tmp_path / "scene.glb", unit="mm")
    np.testing.assert_allclose(tract.vertices.mean(axis=0), (50.0, 60.0, 70.0), atol=1e-4)
    assert tract.volume > 0
    assert "components-dropped" in codes(tract)


def write_vtk(path, vertices, polygons):
    size = sum(len(polygon) + 1 for polygon in polygons)
    lines = ["# vtk DataFile Version 1.0", "made here", "ASCII", "DATASET POLYDATA"]
    lines += [f"POINTS {len(vertices)} float", *(" ".join(map(str, p)) for p in vertices)]
    lines += [f"POLYGONS {len(polygons)} {size}"]
    lines += [" ".join(map(str, (len(polygon), *polygon))) for polygon in polygons]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_legacy_vtk_file_of_triangles_or_quads_is_read(tmp_path):
    mesh = box()
    path = write_vtk(tmp_path / "box.vtk", mesh.vertices, mesh.faces)
    assert read_tract(path).volume == pytest.approx(24_000.0)
    corners = [(x, y, z) for x in (0, 20) for y in (0, 30) for z in (0, 40)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    path = write_vtk(tmp_path / "quads.vtk", corners, quads)
    assert read_tract(path).volume == pytest.approx(24_000.0)
    text = path.read_text(encoding="utf-8")
    path.write_text(text[:-12])
    with pytest.raises(BozziniError):
        read_tract(path)


def test_real_labels_and_real_surface_are_the_same_tract(upper_gi_dir):
    labels = read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels=[1, 2, 3])
    surface = read_tract(upper_gi_dir / "upper_gi_mc1mm.stl")
    assert labels.volume == pytest.approx(surface.volume, rel=0.01)
    index = np.argwhere(labels.mask)
    there = index @ labels.affine[:3, :3].T + labels.affine[:3, 3]
    np.testing.assert_allclose(there.min(axis=0), surface.vertices.min(axis=0), atol=1.5)
    np.testing.assert_allclose(there.max(axis=0), surface.vertices.max(axis=0), atol=1.5)
    assert "handles" in codes(surface)
    assert "components-dropped" in codes(labels)
    with pytest.raises(InputError, match=r"it has 1 \(.* mL\), 2 .*, 3 "):
        read_tract(upper_gi_dir / "upper_gi_labels_1mm.nii.gz", labels=[4])
