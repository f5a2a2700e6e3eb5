"""What is stated twice: by a file of itself, by a file beside it, or by who names its labels."""

from __future__ import annotations

import functools
import itertools
import json
import re

import nibabel
import numpy as np
import pytest

from bozzini.anatomy import read_tract, read_volume, tract_from_labels
from bozzini.anatomy.frame import compare_affines, rescale
from bozzini.anatomy.read import hash_input
from bozzini.errors import FileFormatError, InputError
from tests.anatomy.test_volumes import table, write_nrrd


def codes(item):
    return {finding.code: finding for finding in item.findings}


def block(shape=(12, 10, 20)):
    array = np.zeros(shape, dtype=np.uint8)
    array[3:9, 3:7, 3:17] = 1
    return array


def turn(degrees):
    a = np.radians(degrees)
    matrix = np.eye(4)
    matrix[1:3, 1:3] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    return matrix


# Two affines.


def test_two_affines_differ_by_the_move_of_the_farthest_voxel_and_by_an_angle():
    one = np.diag([1.0, 1.5, 2.0, 1.0])
    shape = (11, 21, 31)
    same = compare_affines(one, one, shape)
    assert (same.farthest, same.turn, same.swapped) == (0.0, 0.0, ())
    moved = one.copy()
    moved[:3, 3] += (3.0, 4.0, 0.0)
    assert compare_affines(one, moved, shape).farthest == pytest.approx(5.0)
    gap = compare_affines(one, turn(15.0) @ one, shape)
    assert gap.turn == pytest.approx(15.0)
    corner = one @ (0, 20, 30, 1)
    assert gap.farthest == pytest.approx(np.linalg.norm((turn(15.0) @ corner - corner)[:3]))
    assert compare_affines(one, rescale(one, np.array([1.0, 1.5, 3.0])), shape) == pytest.approx(
        compare_affines(one, np.diag([1.0, 1.5, 3.0, 1.0]), shape)
    )


@pytest.mark.parametrize(
    ("signs", "frame", "swapped"),
    [
        ((-1, 1, 1), "RAS", ("left and right",)),
        ((1, -1, 1), "LPS", ("front and back",)),
        ((1, 1, -1), "RAS", ("head and feet",)),
        ((-1, -1, 1), "LPS", ("left and right", "front and back")),
        ((-1, 1, 1), "SLA", ("head and feet",)),
        ((-1, 1, 1), None, ("x and -x",)),
    ],
)
def test_sides_that_are_exchanged_are_named(signs, frame, swapped):
    one = turn(10.0) @ np.diag([1.0, 1.5, 2.0, 1.0])
    gap = compare_affines(one, np.diag([*signs, 1.0]) @ one, (10, 10, 10), frame=frame)
    assert gap.swapped == swapped
    assert gap.turn == pytest.approx(0.0, abs=1e-5)
    tilted = compare_affines(one, turn(8.0) @ np.diag([*signs, 1.0]) @ one, (10, 10, 10))
    assert tilted.turn == pytest.approx(8.0, abs=1e-5)


# qform and sform of NIfTI.


def save_both(path, qform, sform, codes=(1, 1), unit="mm", pixdim=None):
    image = nibabel.Nifti1Image(block(), None)
    image.set_qform(qform, code=codes[0])
    image.set_sform(sform, code=codes[1])
    image.header.set_xyzt_units(unit)
    if pixdim is not None:
        image.header["pixdim"][1:4] = pixdim
    nibabel.save(image, path)
    return path


BASE = np.array([[1.0, 0, 0, -50], [0, 1.5, 0, 20], [0, 0, 2.0, 300], [0, 0, 0, 1]])
FLIP = np.array([[-1.0, 0, 0, -50], [0, 1.5, 0, 20], [0, 0, 2.0, 300], [0, 0, 0, 1]])


def test_qform_and_sform_that_differ_are_told_with_millimetres_and_degrees(tmp_path):
    tilted = turn(15.0) @ BASE
    tilted[:3, 3] = -20.0, 0.0, 250.0
    tract = read_tract(save_both(tmp_path / "ne.nii.gz", BASE, tilted, (1, 2)))
    found = codes(tract)["affines-differ"]
    assert found.severity == "warning"
    corners = np.array([(i, j, k, 1) for i in (0, 11) for j in (0, 9) for k in (0, 19)])
    farthest = np.linalg.norm((corners @ (BASE - tilted).T)[:, :3], axis=1).max()
    assert f"by up to {farthest:.3g} mm and 15 degrees" in found.message
    assert "qform (scanner)" in found.message and "sform (aligned)" in found.message
    assert "the sform is taken" in found.message and "swapped" not in found.message
    np.testing.assert_allclose((tract.affine @ (2, 2, 2, 1))[:3], (tilted @ (3, 3, 3, 1))[:3])


def test_left_against_right_in_qform_and_sform_is_told(tmp_path):
    tract = read_tract(save_both(tmp_path / "flip.nii.gz", FLIP, BASE))
    message = codes(tract)["affines-differ"].message
    assert "by up to 22 mm; left and right are swapped" in message
    metres = np.diag([1e-3, 1e-3, 1e-3, 1.0])
    scaled = save_both(tmp_path / "m.nii", metres @ FLIP, metres @ BASE, unit="meter")
    assert codes(read_tract(scaled))["affines-differ"].message == message


def test_a_form_without_code_or_off_by_rounding_states_nothing(tmp_path):
    rounded = BASE + 1e-6
    rounded[3] = BASE[3]
    for number, (qform, sform, stated) in enumerate(
        [(BASE, BASE, (1, 1)), (BASE, rounded, (1, 1)), (FLIP, BASE, (0, 1)), (BASE, FLIP, (1, 0))]
    ):
        tract = read_tract(save_both(tmp_path / f"{number}.nii", qform, sform, stated))
        assert "affines-differ" not in codes(tract)


def test_a_damaged_qform_is_told_if_it_has_a_code(tmp_path):
    path = save_both(tmp_path / "a.nii", BASE, BASE)
    image = nibabel.load(path)
    image.header["quatern_b"], image.header["quatern_c"] = 3.0, 4.0
    image.header["vox_offset"] = 352
    for code in (0, 1):
        image.header["qform_code"] = code
        data = bytearray(path.read_bytes())
        data[:348] = image.header.binaryblock
        (tmp_path / "b.nii").write_bytes(data)
        found = codes(read_tract(tmp_path / "b.nii"))
        assert ("affines-differ" in found) == (code == 1)
        if code:
            assert "one of them is damaged; the sform is taken" in found["affines-differ"].message


def test_voxel_sizes_of_the_header_are_compared_with_the_sform(tmp_path):
    path = save_both(tmp_path / "a.nii", BASE, BASE, (0, 1), pixdim=(1.0, 1.5, 5.0))
    message = codes(read_tract(path))["affines-differ"].message
    assert "1 x 1.5 x 5 mm" in message and "1 x 1.5 x 2 mm" in message and "57 mm" in message


def test_a_unit_that_is_given_against_the_file_is_refused(tmp_path):
    metres = np.diag([1e-3, 1e-3, 1e-3, 1.0])
    path = save_both(tmp_path / "m.nii", metres @ BASE, metres @ BASE, unit="meter")
    assert read_tract(path).volume == pytest.approx(6 * 4 * 14 * 3.0)
    with pytest.raises(InputError, match="unit is 'mm', but the file is in meter"):
        read_tract(path, unit="mm")
    assert read_tract(save_both(tmp_path / "mm.nii", BASE, BASE), unit="mm").volume > 0.0


# NRRD, MetaImage, DICOM, folders of masks.

SPACE = ("dimension: 3", "sizes: 12 10 20", "space: LPS", "space origin: (0,0,0)")


def test_spacings_and_space_directions_of_a_nrrd_are_compared(tmp_path):
    directions = "space directions: (1,0,0) (0,1,0) (0,0,2)"
    good = write_nrrd(tmp_path / "a.nrrd", block(), *SPACE, directions, "spacings: 1 1 2")
    assert "affines-differ" not in codes(read_tract(good))
    bad = write_nrrd(tmp_path / "b.nrrd", block(), *SPACE, directions, "spacings: 1 1 5")
    assert "57 mm: space directions" in codes(read_tract(bad))["affines-differ"].message


def test_units_of_a_nrrd_are_converted_and_must_agree(tmp_path):
    directions = "space directions: (0.1,0,0) (0,0.1,0) (0,0,0.1)"
    units = 'space units: "cm" "cm" "cm"'
    tract = read_tract(write_nrrd(tmp_path / "a.nrrd", block(), *SPACE, directions, units))
    assert tract.volume == pytest.approx(6 * 4 * 14)
    assert "cm" in codes(tract)["unit-converted"].message
    for number, line in enumerate(('units: "mm" "mm" "mm"', 'units: "kg" "kg" "kg"')):
        fields = (directions, units) if number == 0 else (directions,)
        path = write_nrrd(tmp_path / f"{number}.nrrd", block(), *SPACE, *fields, line)
        with pytest.raises(FileFormatError, match=("cm and mm", "'kg'")[number]):
            read_tract(path)


def write_meta(path, *fields):
    head = ["ObjectType = Image", "NDims = 3", "DimSize = 12 10 20", "ElementType = MET_UCHAR"]
    text = "\n".join([*head, "ElementSpacing = 1 1 2", *fields, "ElementDataFile = LOCAL", ""])
    path.write_bytes(text.encode() + block().tobytes(order="F"))
    return path


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (("TransformMatrix = 1 0 0 0 1 0 0 0 1", "AnatomicalOrientation = RAI"), None),
        (("TransformMatrix = 1 0 0 0 0 -1 0 1 0", "AnatomicalOrientation = RSA"), None),
        (("TransformMatrix = 1 0 0 0 1 0 0 0 1", "AnatomicalOrientation = ???"), None),
        (("TransformMatrix = 1 0 0 0 1 0 0 0 1", "AnatomicalOrientation = LAI"), "left and right"),
        (("AnatomicalOrientation = RAS",), "head and feet"),
        (("ElementSize = 1 1 2",), None),
        (("ElementSize = 1 1 4",), "1 x 1 x 4 mm"),
    ],
)
def test_a_metaimage_is_compared_with_itself(tmp_path, fields, words):
    found = codes(read_tract(write_meta(tmp_path / "a.mha", *fields)))
    if words is None:
        assert "affines-differ" not in found
    else:
        assert words in found["affines-differ"].message


def test_two_names_of_one_field_of_a_metaimage_must_agree(tmp_path):
    read_tract(write_meta(tmp_path / "a.mha", "Offset = 1 2 3", "Position = 1 2 3"))
    with pytest.raises(FileFormatError, match=r"offset is '1 2 3', position is '1 2 4'"):
        read_tract(write_meta(tmp_path / "b.mha", "Offset = 1 2 3", "Position = 1 2 4"))


def write_slices(folder, itk, *, step=2.5, sides=None, **tags):
    folder.mkdir()
    for k in range(6):
        image = itk.GetImageFromArray(np.full((1, 10, 12), k, dtype=np.int16))
        image.SetSpacing((0.8, 0.9, float(tags.get("0018_0088", step))))
        place = 100.0 + step * k
        values = {
            "0008|0060": "CT", "0020|000d": "1.2.3", "0020|000e": "1.2.3.4",
            "0008|0018": f"1.2.3.4.{k + 1}", "0020|0013": str(k),
            "0008|0016": "1.2.840.10008.5.1.4.1.1.2", "0020|0032": f"0\\0\\{place}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
        }  # fmt: skip
        values |= {key.replace("_", "|"): value for key, value in tags.items()}
        for tag, value in values.items():
            image.SetMetaData(tag, value)
        image.SetOrigin((0.0, 0.0, place))
        if sides is not None and k == 3:
            image.SetSpacing(sides)
        writer = itk.ImageFileWriter()
        writer.KeepOriginalImageUIDOn()
        writer.SetFileName(str(folder / f"slice{k}.dcm"))
        writer.Execute(image)
    return folder


def test_what_slices_state_is_compared_with_where_they_are(tmp_path):
    itk = pytest.importorskip("SimpleITK")
    same = {"0018_0088": "2.5", "0018_0050": "2.5"}
    assert read_volume(write_slices(tmp_path / "same", itk, **same)).findings == ()
    spaced = read_volume(write_slices(tmp_path / "spaced", itk, **{**same, "0018_0088": "5"}))
    message = codes(spaced)["affines-differ"].message
    assert message.startswith("SpacingBetweenSlices (0.8 x 0.9 x 5 mm)")
    assert "12.5 mm: ImagePositionPatient is taken" in message
    np.testing.assert_allclose(np.linalg.norm(spaced.affine[:3, 2]), 2.5)
    for thick, severity, word in (("5", "note", "overlap"), ("1", "warning", "leave gaps")):
        tags = {**same, "0018_0050": thick}
        found = codes(read_volume(write_slices(tmp_path / word, itk, **tags)))["slices-apart"]
        assert found.severity == severity and word in found.message
    with pytest.raises(FileFormatError, match=r"slice0\.dcm and slice3\.dcm differ by up to"):
        read_volume(write_slices(tmp_path / "odd", itk, sides=(1.6, 0.9, 1.0), **same))


def test_masks_of_one_folder_keep_their_findings_and_have_one_frame(tmp_path):
    folder = tmp_path / "masks"
    folder.mkdir()
    save_both(folder / "colon.nii.gz", BASE, BASE)
    save_both(folder / "stomach.nii.gz", FLIP, BASE)
    assert "left and right" in codes(read_tract(folder, labels="all"))["affines-differ"].message
    assert "affines-differ" not in codes(read_tract(folder, labels=["colon"]))
    write_meta(folder / "liver.mha", "Offset = -50 20 300")
    with pytest.raises(FileFormatError, match="RAS.*LPS"):
        read_tract(folder, labels=["colon", "liver"])


# Names of labels.


def tube(array, begin, end, radius, label, step=4.0):
    """Give a label to all within a radius of a line [mm]."""
    places = step * np.stack(np.indices(array.shape), axis=-1) - np.array(begin)
    along = np.subtract(end, begin, dtype=float)
    share = np.clip(places @ along / max(along @ along, 1e-9), 0.0, 1.0)
    array[np.linalg.norm(places - share[..., None] * along, axis=-1) < radius] = label


def ball(array, centre, radius, label):
    tube(array, centre, centre, radius, label)


@functools.cache
def abdomen(*, colon, first_vertebra, artery=None):
    """Return a colon, a stomach and seven vertebrae, each with its number; voxels of 4 mm."""
    array = np.zeros((62, 40, 66), dtype=np.uint8)
    places = [(40, 60, 60), (40, 60, 220), (200, 60, 220), (200, 60, 60)]
    for begin, end in itertools.pairwise(places):
        tube(array, begin, end, 18.0, colon)
    if artery is not None:
        tube(array, (120, 20, 60), (120, 20, 220), 4.5, artery)
    for k in range(7):
        ball(array, (120, 110, 40 + 32 * k), 15.0, first_vertebra + k)
    ball(array, (170, 110, 170), 25.0, 6)
    array.flags.writeable = False
    return array


SCALE = np.diag([4.0, 4.0, 4.0, 1.0])
VERSION_1 = {"colon": 57, "first_vertebra": 18}
VERSION_2 = {"colon": 20, "first_vertebra": 27, "artery": 57}


def save_labels(path, array, names=None):
    image = nibabel.Nifti1Image(array, SCALE)
    image.header.set_xyzt_units("mm")
    if names:
        text = table(names).encode()
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, text))
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize(
    ("version", "number", "layout"), [("v1", 57, VERSION_1), ("v2", 20, VERSION_2)]
)
def test_a_named_version_gives_names_and_organ(tmp_path, version, number, layout):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**layout))
    tract = read_tract(path, labels=f"totalsegmentator-{version}:colon")
    assert tract.label_names == {number: "colon"} and tract.organ == "colon"
    assert {i.code for i in tract.findings if i.severity == "warning"} == {"voxels-coarse"}
    left = codes(tract)["labels-left-out"].message
    assert "6 stomach" in left
    stomach = read_tract(path, labels=[f"TotalSegmentator-{version}:Stomach"])
    assert stomach.label_names == {6: "stomach"} and stomach.organ == "upper-tract"


@pytest.mark.parametrize(
    ("version", "number", "layout"), [("v1", 57, VERSION_1), ("v2", 20, VERSION_2)]
)
def test_a_version_that_alone_fits_is_found(tmp_path, version, number, layout):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**layout))
    tract = read_tract(path, labels=["Colon"])
    assert (tract.label_names, tract.organ) == ({number: "colon"}, "colon")
    said = codes(tract)["version-assumed"].message
    assert f"totalsegmentator-{version}, which alone fits: colon is label {number}, " in said
    # Both have 6 for the stomach: there is nothing to choose.
    assert read_tract(path, labels="stomach").label_names == {6: "stomach"}
    with pytest.raises(InputError, match="states no names"):
        read_tract(path, labels=["duodenum"])  # it is not there


@pytest.mark.parametrize(("version", "layout"), [("v1", VERSION_1), ("v2", VERSION_2)])
def test_hollow_organs_are_listed_first_and_one_prefix_holds_for_all(tmp_path, version, layout):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**layout))
    with pytest.raises(InputError, match="choose those that are lumen") as caught:
        read_tract(path)
    prefix = f"totalsegmentator-{version}:"
    listed = str(caught.value).split("(--labels all): ")[1].split(", ")
    assert [f" {prefix}" in item for item in listed] == sorted(
        [f" {prefix}" in item for item in listed], reverse=True
    )
    names = [item.split()[1] for item in listed if prefix in item]
    assert {f"{prefix}stomach", f"{prefix}colon"} <= set(names)
    each = read_tract(path, labels=[f"{prefix}stomach", f"{prefix}colon"])
    once = read_tract(path, labels=[f"{prefix}stomach", "Colon"])
    np.testing.assert_array_equal(once.labels, each.labels)
    assert once.findings == each.findings
    # A number, or a name that is no organ of the version, is not taken for one.
    with pytest.raises(InputError, match="label is 'polyp'"):
        read_tract(path, labels=[f"{prefix}stomach", "polyp"])


def test_every_way_to_give_labels_keeps_names_and_organ(tmp_path):
    array = np.zeros((20, 20, 40), dtype=np.uint8)
    array[4:8, 4:8, 4:36] = 20
    alone = save_labels(tmp_path / "colon.nii.gz", array)
    for labels in (None, "all", ["all"], 20, [20], ["20"], "totalsegmentator-v2:colon"):
        wanted = [labels] if isinstance(labels, int) else labels
        tract = read_tract(alone, labels=wanted)
        assert (tract.label_names, tract.organ) == ({20: "colon"}, "colon"), labels
    named = save_labels(tmp_path / "scan.nii.gz", array, {20: "colon"})
    for labels in (None, "all", [20], ["colon"], "totalsegmentator-v2:colon"):
        tract = read_tract(named, labels=labels)
        assert (tract.label_names, tract.organ) == ({20: "colon"}, "colon"), labels
    made = tract_from_labels(array, SCALE, labels="totalsegmentator-v2:colon")
    assert (made.label_names, made.organ) == ({20: "colon"}, "colon")
    array[12:16, 4:8, 4:36] = 3  # of several labels the file's name is none
    several = save_labels(tmp_path / "colon.nii.gz", array)
    assert read_tract(several, labels=[3]).organ is None


@pytest.mark.parametrize(
    ("layout", "wrong", "right", "why"),
    [
        (VERSION_1, "v2:colon", "v1:colon", "labels 19 to 21 lie in a row like vertebrae"),
        (VERSION_2, "v1:colon", "v2:colon", "expected 100 to 6000 mL"),
    ],
)
def test_the_other_version_is_refused_and_the_one_that_fits_named(
    tmp_path, layout, wrong, right, why
):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**layout))
    with pytest.raises(InputError) as caught:
        read_tract(path, labels=f"totalsegmentator-{wrong}")
    said = str(caught.value)
    assert "\n" not in said and why in said
    assert f"totalsegmentator-{right} fits (label {layout['colon']}, " in said
    number = {"v1:colon": 57, "v2:colon": 20}[wrong]
    assert f"give {number}" in said
    assert read_tract(path, labels=[number]).organ is None  # a number names nothing


def test_one_vertebra_alone_is_no_tube(tmp_path):
    array = abdomen(**VERSION_1).copy()
    for label in range(18, 25):
        array[array == label] = 0
    ball(array, (120, 110, 100), 25.0, 20)  # 60 mL
    path = save_labels(tmp_path / "scan.nii.gz", array)
    with pytest.raises(InputError, match=r"compact body, no tube.*totalsegmentator-v1:colon fits"):
        read_tract(path, labels=["totalsegmentator-v2:colon"])
    array[array == 57] = 0
    save_labels(tmp_path / "scan.nii.gz", array)
    with pytest.raises(InputError, match="no other version fits"):
        read_tract(path, labels=["totalsegmentator-v2:colon"])


def test_a_label_of_the_wrong_size_is_doubted_where_no_version_fits(tmp_path):
    array = np.zeros((20, 20, 40), dtype=np.uint8)
    array[8:10, 8:10, 4:36] = 57
    path = save_labels(tmp_path / "scan.nii.gz", array)
    found = codes(read_tract(path, labels="totalsegmentator-v1:colon"))["version-doubtful"]
    assert found.severity == "warning" and "expected 100 to 6000 mL" in found.message


def test_two_versions_and_a_file_of_more_labels_than_version_1_are_refused(tmp_path):
    array = abdomen(**VERSION_1).copy()
    path = save_labels(tmp_path / "scan.nii.gz", array)
    both = ["totalsegmentator-v1:colon", "totalsegmentator-v2:stomach"]
    with pytest.raises(InputError, match="a file has one version"):
        read_tract(path, labels=both)
    array[0:2, 0:2, 0:2] = 110
    with pytest.raises(InputError, match="label 110, and version 1 ends at 104"):
        read_tract(save_labels(path, array), labels=both[:1])


def test_names_of_the_file_win_over_a_version_that_contradicts_them(tmp_path):
    names = {20: "vertebrae_L3", 57: "colon", 6: "stomach"}
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**VERSION_1), names)
    with pytest.raises(InputError, match="label 20 is vertebrae_L3 and colon is label 57"):
        read_tract(path, labels="totalsegmentator-v2:colon")
    assert read_tract(path, labels="totalsegmentator-v1:colon").organ == "colon"
    lines = ["space directions: (1,0,0) (0,1,0) (0,0,1)", "Segment0_Name:=vertebra"]
    lines += ["Segment0_LabelValue:=20", "Segment1_Name:=Colon", "Segment1_LabelValue:=1"]
    array = block()
    array[0:2, 0:2, 0:2] = 20
    segments = write_nrrd(tmp_path / "a.seg.nrrd", array, *SPACE, *lines)
    with pytest.raises(InputError, match="label 20 is vertebra and colon is label 1"):
        read_tract(segments, labels="totalsegmentator-v2:colon")


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".json", json.dumps({"0": "background", "20": "vertebrae_L3", "57": "colon"})),
        (".json", json.dumps({"labels": {"background": 0, "vertebrae_L3": 20, "colon": 57}})),
        (".ctbl", "# Color\n0 none 0 0 0 0\n20 vertebrae_L3 1 2 3 255\n57 colon 9 9 9 255\n"),
        (".label", '    0  0 0 0  0  0  0  "Clear"\n   20  9 9 9  1  1  1  "vertebrae_L3"\n'
                   '   57  9 9 9  1  1  1  "colon"\n'),
    ],
)  # fmt: skip
def test_names_beside_a_volume_are_read_compared_and_hashed(tmp_path, suffix, text):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**VERSION_1))
    before = hash_input(path)
    beside = tmp_path / f"scan{suffix}"
    beside.write_text(text)
    tract = read_tract(path, labels=["colon"])
    assert tract.label_values == (57,) and tract.organ == "colon"
    assert beside.name in codes(tract)["names-read"].message
    assert hash_input(path) != before
    with pytest.raises(InputError, match="label 20 is vertebrae_L3"):
        read_tract(path, labels="totalsegmentator-v2:colon")
    save_labels(path, abdomen(**VERSION_1), {20: "colon", 57: "colon"})
    found = codes(read_tract(path, labels=[57]))["names-differ"]
    assert found.severity == "warning" and "label 20 is colon and vertebrae_L3" in found.message


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"SeriesNumber": 3}', "1 2 3 4 5 6\n", "\0" * 9])
def test_a_file_beside_a_volume_that_states_no_names_is_left_alone(tmp_path, text):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**VERSION_1))
    before = hash_input(path)
    for suffix in (".json", ".txt", ".ctbl", ".label"):
        (tmp_path / f"scan{suffix}").write_text(text)
    tract = read_tract(path, labels=[57])
    assert not {"names-read", "names-differ"} & set(codes(tract)) and hash_input(path) == before


def test_a_sidecar_is_compared_with_the_header(tmp_path):
    path = save_labels(tmp_path / "scan.nii.gz", abdomen(**VERSION_1))
    notes = tmp_path / "scan.json"
    notes.write_text(json.dumps({"Modality": "CT", "SpacingBetweenSlices": 4.0}))
    assert "affines-differ" not in codes(read_tract(path, labels=[57]))
    notes.write_text(json.dumps({"Modality": "CT", "SpacingBetweenSlices": 2.0}))
    message = codes(read_tract(path, labels=[57]))["affines-differ"].message
    assert "SpacingBetweenSlices of scan.json (4 x 4 x 2 mm)" in message and "130 mm" in message


# What one header states twice.


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (("ElementSpacing = 1 1 4",), "elementspacing is '1 1 2' and '1 1 4'"),
        (("NDims = 4",), "ndims is '3' and '4'"),
        (("ElementByteOrderMSB = False", "BinaryDataByteOrderMSB = True"), "contradicts itself"),
        (("TransformMatrix = 1 0 0 0 0 0 0 0 1",), "an axis of its TransformMatrix is 0"),
        (("DistanceUnits = kg",), "'kg': it must be a unit of length"),
    ],
)
def test_a_metaimage_that_contradicts_itself_is_refused(tmp_path, fields, words):
    with pytest.raises(FileFormatError, match=re.escape(words)):
        read_volume(write_meta(tmp_path / "a.mha", *fields))


def test_the_number_of_dimensions_of_a_metaimage_is_that_of_its_sizes(tmp_path):
    path = write_meta(tmp_path / "a.mha")
    path.write_bytes(path.read_bytes().replace(b"NDims = 3", b"NDims = 2"))
    with pytest.raises(FileFormatError, match="ndims is 2, but it has 3 sizes"):
        read_volume(path)


def test_the_unit_of_a_metaimage_is_read(tmp_path):
    fields = ("ElementSize = 1 1 2", "Offset = 1 2 3")
    plain = read_volume(write_meta(tmp_path / "a.mha", *fields))
    for unit, scale in (("mm", 1.0), ("?", 1.0), ("cm", 10.0), ("um", 1e-3)):
        volume = read_volume(write_meta(tmp_path / "b.mha", *fields, f"DistanceUnits = {unit}"))
        np.testing.assert_allclose(volume.affine[:3], scale * plain.affine[:3])
        assert ("unit-converted" in codes(volume)) == (scale != 1.0)
        assert "affines-differ" not in codes(volume)


def test_axes_of_a_metaimage_longer_than_1_are_told_beside_its_spacing(tmp_path):
    axes = "TransformMatrix = 2 0 0 0 2 0 0 0 2"
    volume = read_volume(write_meta(tmp_path / "a.mha", axes))
    assert "2 x 2 x 4 mm" in codes(volume)["affines-differ"].message
    np.testing.assert_allclose(np.diag(volume.affine), (1, 1, 2, 1))


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (("spacings: 1 1 1", "spacings: 1 1 2"), "spacings is '1 1 1' and '1 1 2'"),
        (("spacings: 1 1 1", "type: uint8", "type: int8"), "type is 'uint8' and 'int8'"),
        (("spacings: 1 1 1", "dimension: 4"), "dimension is 4, but it has 3 sizes"),
        (("spacings: 1 1",), "has 2 spacings: a volume has 3"),
        (
            ("spacings: 1 1 1", "Segment0_Name:=aorta", "Segment0_LabelValue:=1",
             "Segment1_Name:=colon", "Segment1_LabelValue:=1"),
            "label 1 for two segments, aorta and colon",
        ),
    ],
)  # fmt: skip
def test_a_nrrd_that_contradicts_itself_is_refused(tmp_path, fields, words):
    with pytest.raises(FileFormatError, match=re.escape(words)):
        read_volume(write_nrrd(tmp_path / "a.nrrd", block(), "sizes: 12 10 20", *fields))


@pytest.mark.parametrize(("most", "centering", "differ"), [
    (40, "cell", False), (38, "node", False), (20, "cell", True), (40, "???", False),
])  # fmt: skip
def test_the_ends_of_a_nrrd_are_compared_with_its_spacings(tmp_path, most, centering, differ):
    nodes = centering == "node"
    maxs = f"axis maxs: {11 if nodes else 12} {9 if nodes else 10} {most}"
    fields = ("spacings: 1 1 2", "axis mins: 0 0 0", maxs, f"centerings:{3 * f' {centering}'}")
    volume = read_volume(write_nrrd(tmp_path / "a.nrrd", block(), "sizes: 12 10 20", *fields))
    assert ("affines-differ" in codes(volume)) == differ


@pytest.mark.parametrize("size", [0.0, -1.5])
def test_a_nifti_without_a_voxel_size_is_refused(tmp_path, size):
    save_both(tmp_path / "a.nii", np.eye(4), np.eye(4), codes=(0, 0))
    data = bytearray((tmp_path / "a.nii").read_bytes())
    data[84:88] = np.float32(size).tobytes()  # pixdim[2]
    (tmp_path / "a.nii").write_bytes(data)
    with pytest.raises(FileFormatError, match="states no voxel size: pixdim is 1 x"):
        read_volume(tmp_path / "a.nii")


def test_an_unknown_unit_of_a_nifti_is_named_by_its_code(tmp_path):
    save_both(tmp_path / "a.nii", np.eye(4), np.eye(4))
    data = bytearray((tmp_path / "a.nii").read_bytes())
    data[123] = 7  # xyzt_units
    (tmp_path / "a.nii").write_bytes(data)
    with pytest.raises(FileFormatError, match="has the unit of length 7: known are 0"):
        read_volume(tmp_path / "a.nii")


def test_names_that_differ_by_capitals_are_told_apart():
    array = block()
    array[3:9, 3:7, 12:17] = 2
    names = {1: "colon", 2: "Colon"}
    for name, label in (("colon", 1), ("Colon", 2)):
        tract = tract_from_labels(array, np.eye(4), labels=name, names=names)
        assert tract.label_values == (label,)
    with pytest.raises(InputError, match="'COLON', but array has Colon and colon"):
        tract_from_labels(array, np.eye(4), labels="COLON", names=names)
