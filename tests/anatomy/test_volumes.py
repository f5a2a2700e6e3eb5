"""Volumes from files: damage is refused, formats agree with other readers, names are found."""

from __future__ import annotations

import gzip
import itertools

import highdicom as hd
import nibabel
import numpy as np
import pydicom
import pytest

from bozzini.anatomy import read_labels, read_tract, read_volume, write_tract
from bozzini.anatomy.frame import convert_frame, find_axis
from bozzini.anatomy.read import hash_input
from bozzini.anatomy.tract import LabelTract
from bozzini.errors import BozziniError, FileFormatError, InputError

FRAMES = [
    "".join(letters)
    for axes in itertools.permutations(("RL", "AP", "SI"))
    for letters in itertools.product(*axes)
]


def codes(tract):
    return {finding.code: finding for finding in tract.findings}


def noise(shape=(9, 8, 11), most=3):
    return np.random.default_rng(1).integers(0, most, shape).astype(np.uint8)


def save(path, array, affine=None, names="", dtype=None):
    image = nibabel.Nifti1Image(array if dtype is None else array.astype(dtype), affine)
    if affine is None:
        image = nibabel.Nifti1Image(image.dataobj, np.eye(4))
    image.header.set_xyzt_units("mm")
    if names:
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, names.encode()))
    nibabel.save(image, path)
    return path


def check_flips(path, array, random, *, every=1):
    """Flip one bit of a byte: the file is refused, or its voxels are what they were."""
    whole = path.read_bytes()
    refused = 0
    for at in range(0, len(whole), every):
        bad = bytearray(whole)
        bad[at] ^= 1 << int(random.integers(8))
        path.write_bytes(bad)
        try:
            found = read_volume(path).array
        except BozziniError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            assert found.shape == array.shape and (found == array).all(), at
    path.write_bytes(whole)
    assert (read_volume(path).array == array).all()
    return refused * every / len(whole)


def test_a_flipped_bit_is_refused_or_harmless(tmp_path):
    array = noise()
    path = save(tmp_path / "scan.nii.gz", array)
    assert check_flips(path, array, np.random.default_rng(0)) > 0.9


def test_a_flipped_bit_in_other_formats_is_refused_or_harmless(tmp_path):
    itk = pytest.importorskip("SimpleITK")
    array = noise()
    image = itk.GetImageFromArray(array.T)
    for name in ("scan.nrrd", "scan.mha"):
        itk.WriteImage(image, str(tmp_path / name), True)
        assert check_flips(tmp_path / name, array, np.random.default_rng(0), every=3) > 0.5


def test_every_truncation_and_every_tail_is_refused(tmp_path):
    array = noise((5, 6, 7))
    for name in ("scan.nii", "scan.nii.gz"):
        path = save(tmp_path / name, array)
        whole = path.read_bytes()
        for length in range(1, len(whole), 7):
            path.write_bytes(whole[:length])
            with pytest.raises(FileFormatError):
                read_volume(path)
        for tail in (b"x", b"tail" * 40):
            path.write_bytes(whole + tail)
            with pytest.raises(FileFormatError, match="damaged"):
                read_volume(path)
    plain = save(tmp_path / "scan.nii", array).read_bytes()
    path.write_bytes(gzip.compress(plain) + gzip.compress(b"more"))
    with pytest.raises(FileFormatError, match="goes on"):
        read_volume(path)
    # A stream may come in several members, each with its checksum, and be padded with zeros.
    path.write_bytes(gzip.compress(plain[:400]) + gzip.compress(plain[400:]) + bytes(512))
    assert (read_volume(path).array == array).all()


@pytest.mark.parametrize("shape", [(32000, 32000, 32000), (3000, 3000, 3000), (400, 400, 400)])
def test_a_header_is_compared_with_the_file_before_memory_is_taken(tmp_path, shape):
    import resource

    header = nibabel.Nifti1Header()
    header.set_data_dtype(np.float64)
    header.set_data_shape(shape)
    header["vox_offset"] = 352
    header["magic"] = b"n+1"
    content = header.binaryblock + bytes(4) + bytes(1000)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name, data in (("big.nii", content), ("big.nii.gz", gzip.compress(content))):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(FileFormatError, match="states"):
            read_volume(tmp_path / name)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


def test_scaled_and_big_endian_volumes_are_what_nibabel_reads(tmp_path):
    array = noise()
    image = nibabel.Nifti1Image(array.astype(">i2"), np.diag([1, 2, 3, 1.0]))
    image.header.set_slope_inter(2.0, 1.0)
    nibabel.save(image, tmp_path / "scaled.nii.gz")
    expected = nibabel.load(tmp_path / "scaled.nii.gz").get_fdata()
    assert (read_volume(tmp_path / "scaled.nii.gz").array == expected).all()
    nibabel.save(nibabel.Nifti2Image(array, np.eye(4)), tmp_path / "two.nii.gz")
    assert (read_volume(tmp_path / "two.nii.gz").array == array).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, np.int32, np.float32, np.float64])
@pytest.mark.parametrize("name", ["a.nrrd", "a.nhdr", "a.mha", "a.mhd", "a.nii.gz"])
def test_every_format_is_read_as_by_another_reader(tmp_path, name, dtype):
    itk = pytest.importorskip("SimpleITK")
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    image = itk.GetImageFromArray(noise().T.astype(dtype))
    image.SetDirection(turn.ravel())
    image.SetSpacing((0.7, 1.1, 2.3))
    image.SetOrigin((10.0, -200.0, 33.0))
    for compressed in (False, True):
        itk.WriteImage(image, str(tmp_path / name), compressed)
        volume = read_volume(tmp_path / name)
        assert (volume.array == noise()).all()
        assert volume.frame == ("RAS" if name == "a.nii.gz" else "LPS")
        ours = convert_frame(volume.affine, volume.frame, "LPS")
        for index in ((0, 0, 0), (8, 0, 0), (0, 7, 0), (3, 4, 10)):
            np.testing.assert_allclose(
                (ours @ (*index, 1.0))[:3], image.TransformIndexToPhysicalPoint(index), atol=1e-4
            )


def write_nrrd(path, array, *fields):
    header = ["NRRD0004", "# made by a test", "type: uint8", "encoding: raw", *fields]
    path.write_bytes("\n".join([*header, "", ""]).encode() + array.tobytes(order="F"))
    return path


def test_a_nrrd_keeps_the_coordinates_of_its_own_space(tmp_path):
    array = noise((4, 5, 6))
    fields = ["dimension: 3", "sizes: 4 5 6", "space directions: (0,2,0) (1,0,0) (0,0,3)"]
    for space, frame in (("right-anterior-superior", "RAS"), ("LPS", "LPS"), ("scanner-xyz", None)):
        origin = "space origin: (7,8,9)"
        path = write_nrrd(tmp_path / "a.nrrd", array, f"space: {space}", origin, *fields)
        volume = read_volume(path)
        assert volume.frame == frame
        np.testing.assert_allclose((volume.affine @ (1, 1, 1, 1))[:3], (8, 10, 12))
        assert (volume.array == array).all()


def tubes():
    """Return a tube of label 1 with a polyp of label 2 in it, and label 3 beside it."""
    array = np.zeros((14, 14, 30), dtype=np.uint8)
    array[2:10, 2:10, 2:28] = 1
    array[5:7, 5:7, 14:17] = 2
    array[11:13, 2:10, 2:28] = 3
    return array


def test_segments_of_slicer_are_named_in_one_layer_or_several(tmp_path):
    itk = pytest.importorskip("SimpleITK")
    image = itk.GetImageFromArray(tubes().T)
    for k, (name, value) in enumerate((("Colon", 1), ("polyp", 2), ("liver", 3))):
        image.SetMetaData(f"Segment{k}_Name", name)
        image.SetMetaData(f"Segment{k}_LabelValue", str(value))
    itk.WriteImage(image, str(tmp_path / "one.seg.nrrd"), True)
    one = read_tract(tmp_path / "one.seg.nrrd", labels=["colon"])
    assert one.organ == "colon"
    assert one.label_names == {1: "Colon"}
    assert "polyp" in codes(one)["label-inside"].message
    with pytest.raises(
        InputError, match=r"1 Colon \(1.65 mL\), 2 polyp .*--labels all|--labels all.*"
    ):
        read_tract(tmp_path / "one.seg.nrrd")

    array = tubes()
    layers = np.stack([(array == 1) | (array == 2), array == 2], axis=0).astype(np.uint8)
    layers[0][array == 3] = 2
    body = np.ones_like(layers[:1])
    path = write_nrrd(
        tmp_path / "many.seg.nrrd", np.concatenate([layers, body]),
        "dimension: 4", "sizes: 3 14 14 30", "space: LPS", "kinds: list domain domain domain",
        "space directions: none (1,0,0) (0,1,0) (0,0,1)", "space origin: (0,0,0)",
        "Segment0_Name:=Colon", "Segment0_LabelValue:=1", "Segment0_Layer:=0",
        "Segment1_Name:=polyp", "Segment1_LabelValue:=1", "Segment1_Layer:=1",
        "Segment2_Name:=liver", "Segment2_LabelValue:=2", "Segment2_Layer:=0",
        "Segment3_Name:=body", "Segment3_LabelValue:=1", "Segment3_Layer:=2",
    )  # fmt: skip
    many = read_tract(path, labels="COLON")
    # The polyp, drawn over the colon, is wall; the body, drawn over everything, is not.
    assert (many.mask == one.mask).all()
    assert codes(many)["segment-overlap"].severity in ("warning", "note")
    assert read_tract(path, labels=["colon", "polyp"]).volume > many.volume


def table(names):
    rows = "".join(f'<Label Key="{k}"><![CDATA[{name}]]></Label>\n' for k, name in names.items())
    return f'<?xml version="1.0"?> <CaretExtension><LabelTable>{rows}</LabelTable></CaretExtension>'


def test_names_in_a_nifti_choose_labels_and_organ(tmp_path):
    names = table({1: "small_bowel", 2: "polyp", 3: "colon", 9: "not there"})
    path = save(tmp_path / "scan.nii.gz", tubes(), names=names)
    tract = read_tract(path, labels=["Colon"])
    assert tract.label_values == (3,) and tract.organ == "colon" and tract.frame == "RAS"
    assert read_tract(path, labels=["small bowel", 2]).organ == "small-bowel"
    assert read_tract(path, labels="all").label_values == (1, 2)
    assert [part.label_names for part in read_tract(path, labels="all").not_reached] == [("colon",)]


def test_a_file_of_totalsegmentator_without_names_is_not_guessed(tmp_path):
    array = tubes()
    array[array == 3] = 57
    path = save(tmp_path / "scan.nii.gz", array)
    assert read_tract(path, labels=["totalsegmentator-v1:colon"]).label_values == (57,)
    for name in ("colon", "totalsegmentator-v2:colon"):
        with pytest.raises(InputError):
            read_tract(path, labels=[name])


def test_a_mask_is_named_by_its_file_and_masks_by_theirs(tmp_path):
    array = tubes()
    folder = tmp_path / "segmentations"
    folder.mkdir()
    for name, value in (("colon", 1), ("liver", 3), ("small_bowel", 2)):
        save(folder / f"{name}.nii.gz", (array == value).astype(np.uint8))
    assert read_tract(folder / "colon.nii.gz").organ == "colon"
    tract = read_tract(folder, labels=["colon"])
    assert tract.organ == "colon" and tract.volume == np.count_nonzero(array == 1)
    both = read_tract(folder, labels=["colon", "Small-Bowel"])
    assert set(both.label_names.values()) == {"colon", "small_bowel"}
    assert both.volume == np.count_nonzero((array == 1) | (array == 2))
    with pytest.raises(InputError, match=r"3 masks.*colon \(1.65 mL\), small_bowel .*and 1 more"):
        read_tract(folder)
    save(folder / "small_bowel.nii.gz", array[:-1])
    with pytest.raises(FileFormatError, match="same voxels"):
        read_tract(folder, labels=["colon", "small_bowel"])
    assert len(hash_input(folder)) == 64 and hash_input(folder) != hash_input(
        folder / "colon.nii.gz"
    )


def test_names_and_frame_come_back_from_a_written_file(tmp_path):
    labels = np.pad(tubes().astype(np.uint16), 2)
    affine = np.diag([1.0, 2.0, 3.0, 1.0])
    affine[:3, 3] = 5.0, 6.0, 7.0
    names = {1: "colon & <rectum>", 2: "polyp"}
    tract = LabelTract(labels=labels, affine=affine, source="x", frame="LPS", label_names=names)
    back = read_labels(write_tract(tmp_path / "a.nii.gz", tract), labels=["colon & <rectum>"])
    assert back.frame == "RAS" and back.label_names == {1: "colon & <rectum>"}
    ours = convert_frame(back.affine, "RAS", "LPS")
    there = np.argwhere(back.mask) @ ours[:3, :3].T + ours[:3, 3]
    expected = np.argwhere(labels == 1) @ affine[:3, :3].T + affine[:3, 3]
    key = np.lexsort(there.T), np.lexsort(expected.T)
    np.testing.assert_allclose(there[key[0]], expected[key[1]], atol=1e-4)


@pytest.mark.parametrize("frame", FRAMES)
def test_sides_of_every_frame_are_a_set_of_axes(frame):
    axes = np.stack([find_axis(frame, side) for side in "RAS"])
    np.testing.assert_allclose(axes @ axes.T, np.eye(3))
    for k, side in enumerate(frame):  # +x of the world is the side of the first letter
        assert find_axis(frame, side)[k] == 1.0
    for one, other in ("RL", "AP", "SI"):
        np.testing.assert_allclose(find_axis(frame, one), -find_axis(frame, other))
    there = convert_frame(convert_frame(np.eye(4), frame, "RAS"), "RAS", frame)
    np.testing.assert_allclose(there, np.eye(4))


def test_a_frame_given_wins_over_the_file_and_says_so(tmp_path):
    names = table({1: "stomach", 2: "esophagus", 3: "liver"})
    array = np.zeros((30, 20, 30), dtype=np.uint8)
    array[2:12, 2:10, 2:12] = 1
    array[2:5, 2:5, 12:28] = 2
    array[18:28, 2:10, 2:12] = 3
    path = save(tmp_path / "scan.nii.gz", array, names=names)
    plain = read_tract(path, labels=["stomach", "esophagus"])
    assert plain.frame == "RAS" and "frame-overridden" not in codes(plain)
    assert "frame-doubtful" not in codes(plain)  # the stomach is left of the liver
    other = read_tract(path, labels=["stomach", "esophagus"], frame="lps")
    assert other.frame == "LPS"
    assert "RAS" in codes(other)["frame-overridden"].message
    assert "left" in codes(other)["frame-doubtful"].message
    upside = read_tract(path, labels=["stomach", "esophagus"], frame="RAI")
    assert "above" in codes(upside)["frame-doubtful"].message
    np.testing.assert_allclose(other.affine, plain.affine)


def write_series(folder, array, positions, itk, *, series=4):
    folder.mkdir(exist_ok=True)
    for k, position in enumerate(positions):
        image = itk.GetImageFromArray(array[..., k].T[None].astype(np.int16))
        image.SetSpacing((0.8, 0.9, 2.5))
        tags = {
            "0008|0060": "CT", "0020|000d": "1.2.3", "0020|000e": f"1.2.3.{series}",
            "0008|0018": f"1.2.3.{series}.{k + 1}", "0020|0013": str(k + 1),
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2", "0008|103e": f"body {series}",
            "0020|0052": "1.2.3.9", "0018|0050": "2.5", "0010|0010": "no^body", "0010|0020": "1",
            "0020|0032": f"-50\\20\\{position}", "0020|0037": "1\\0\\0\\0\\1\\0",
            "0028|1052": "-1024", "0028|1053": "1",
        }  # fmt: skip
        for tag, value in tags.items():
            image.SetMetaData(tag, value)
        image.SetOrigin((-50.0, 20.0, float(position)))
        writer = itk.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(
            str(folder / f"slice{series}{(7 * k) % 100:03d}.dcm")
        )  # not in their order
        writer.Execute(image)
    return folder


def test_a_dicom_series_is_read_in_its_frame(tmp_path, capfd):
    itk = pytest.importorskip("SimpleITK")
    array = np.random.default_rng(0).integers(-1000, 500, (10, 12, 8))
    positions = [100.0 + 2.5 * k for k in range(8)]
    volume = read_volume(write_series(tmp_path / "scan", array, positions, itk))
    assert volume.frame == "LPS"
    assert (volume.array == array).all()
    np.testing.assert_allclose((volume.affine @ (2, 3, 4, 1))[:3], (-48.4, 22.7, 110.0), atol=1e-6)
    with pytest.raises(InputError, match="bozzini segment"):
        read_tract(tmp_path / "scan")
    gap = [*positions[:4], *(place + 2.5 for place in positions[4:])]
    with pytest.raises(FileFormatError, match="not evenly spaced, 2.5 to 5 mm"):
        read_volume(write_series(tmp_path / "gap", array, gap, itk))
    write_series(tmp_path / "scan", array[..., :3], positions[:3], itk, series=5)
    both = read_volume(tmp_path / "scan")
    assert (both.array == array).all()
    left = codes(both)["series-left-out"]
    assert left.severity == "warning" and "'body 5' (slice5000.dcm and 2 more)" in left.message
    write_series(tmp_path / "scan", array, positions, itk, series=6)
    with pytest.raises(FileFormatError, match="3 series, 'body 4' .*'body 6' .*'body 5' "):
        read_volume(tmp_path / "scan")
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileFormatError, match="DICOM series"):
        read_volume(tmp_path / "empty")
    assert capfd.readouterr() == ("", "")


def write_segments(path, masks, slices):
    """Write masks (nx, ny, nz, segments) of a series by highdicom, named ``stomach``, ``colon``."""
    code = ("123037004", "SCT", "Anatomical structure")
    described = [
        hd.seg.SegmentDescription(
            segment_number=k + 1, segment_label=name, algorithm_type="MANUAL",
            segmented_property_category=hd.sr.CodedConcept(*code),
            segmented_property_type=hd.sr.CodedConcept(*code),
        )
        for k, name in enumerate(("stomach", "colon"))
    ]  # fmt: skip
    hd.seg.Segmentation(
        source_images=[pydicom.dcmread(file) for file in slices],
        pixel_array=np.moveaxis(masks, (2, 1, 0), (0, 1, 2)).astype(np.uint8),
        segmentation_type="BINARY", segment_descriptions=described,
        series_instance_uid="1.2.3.7", series_number=7, sop_instance_uid="1.2.3.7.1",
        instance_number=1, manufacturer="none", manufacturer_model_name="none",
        software_versions="1", device_serial_number="1",
    ).save_as(path)  # fmt: skip
    return path


@pytest.mark.parametrize("overlap", [False, True])
def test_a_dicom_segmentation_has_names_and_the_places_of_its_series(tmp_path, overlap):
    itk = pytest.importorskip("SimpleITK")
    scan = np.zeros((10, 12, 8))
    folder = write_series(tmp_path / "scan", scan, [100.0 + 2.5 * k for k in range(8)], itk)
    masks = np.zeros((10, 12, 8, 2), dtype=bool)
    masks[2:5, 3:6, 2:6, 0] = masks[(4 if overlap else 5) : 8, 3:8, 2:6, 1] = True
    files = sorted(folder.iterdir(), key=lambda file: pydicom.dcmread(file).InstanceNumber)
    path = write_segments(tmp_path / "organs.dcm", masks, files)
    for k, name in enumerate(("stomach", "colon")):
        tract = read_tract(path, labels=[name])
        assert tract.label_names == {k + 1: name} and tract.organ == ("upper-tract", "colon")[k]
        assert tract.frame == "LPS"
        index = np.argwhere(tract.mask) @ tract.affine[:3, :3].T + tract.affine[:3, 3]
        series = read_volume(folder).affine
        places = np.argwhere(masks[..., k]) @ series[:3, :3].T + series[:3, 3]
        order = [rows[np.lexsort(rows.round(3).T)] for rows in (index, places)]
        np.testing.assert_allclose(*order, atol=1e-4)
    path.rename(folder / "organs.dcm")
    assert "organs.dcm" in codes(read_volume(folder))["series-left-out"].message
    with pytest.raises(FileFormatError, match="a slice: give the folder"):
        read_tract(files[0])


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("skip", [0, 7, -1])
def test_bytes_before_the_voxels_of_a_nrrd_are_skipped(tmp_path, encoding, skip):
    array = noise((5, 6, 7))
    data = array.tobytes(order="F")
    body = bytes(max(skip, 0) or 9 * (skip < 0)) + data
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 6 7\nspace: RAS\nspace units: "
        '"m" "m" "m"\nspace directions: (0.001,0,0) (0,0.001,0) (0,0,0.002)\n'
        f"encoding: {encoding}\nbyte skip: {skip}\ndata file: x.bin\n"
    )
    (tmp_path / "x.nhdr").write_text(header)
    (tmp_path / "x.bin").write_bytes(body if encoding == "raw" else gzip.compress(body))
    if encoding == "gzip" and skip < 0:
        with pytest.raises(FileFormatError, match="'byte skip' is '-1'"):
            read_volume(tmp_path / "x.nhdr")
        return
    volume = read_volume(tmp_path / "x.nhdr")
    assert (volume.array == array).all()
    np.testing.assert_allclose(np.diag(volume.affine), [1.0, 1.0, 2.0, 1.0])
    (tmp_path / "x.bin").write_bytes(body[:5])
    with pytest.raises(FileFormatError, match="truncated"):
        read_volume(tmp_path / "x.nhdr")


def test_without_simpleitk_the_extra_is_named(tmp_path, monkeypatch):
    import sys

    (tmp_path / "a.dcm").write_bytes(bytes(128) + b"DICM")
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    with pytest.raises(BozziniError, match=r"bozzini\[ct\]"):
        read_volume(tmp_path)
