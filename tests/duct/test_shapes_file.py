"""Files of shapes: what is written is what is read, and a wrong one is told in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bozzini.duct import Polygon, RoundCones
from bozzini.duct.shape_files import (
    FITS,
    load_shapes,
    load_shapes_file,
    read_shapes,
    save_shapes,
    write_shapes,
)
from bozzini.duct.shapes.cylinders import ConnectedCylinders
from bozzini.duct.shapes.super_ellipses import SuperEllipsoids
from bozzini.errors import FileFormatError, InputError, OutputError

FORMS = {
    "cones": ("centres", "radii"),
    "cylinders": ("centres", "normals", "radii"),
    "superellipsoids": ("centres", "half_axes", "e1", "e2", "rotations"),
}


def make_shapes(kind, seed, **options):
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 6))
    centres = np.cumsum(random.uniform(-1.0, 1.0, (count, 3)) + [0, 0, 12.0], axis=0)
    radii = random.uniform(2.0, 5.0, count)
    if kind == "cones":
        return RoundCones(centres, radii, **options)
    if kind == "cylinders":
        return ConnectedCylinders(centres, np.tile([0.0, 0.1, 1.0], (count, 1)), radii, **options)
    turns = Rotation.from_rotvec(random.normal(0.0, 0.1, (count, 3))).as_matrix()
    half = random.uniform(8.0, 10.0, (count, 3))
    e1, e2 = random.uniform(0.1, 2.0, (2, count))
    return SuperEllipsoids(centres, half, e1=e1, e2=e2, rotations=turns, connected=False, **options)


def same(kind, one, other):
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in FORMS[kind])


@settings(max_examples=20)
@given(kind=st.sampled_from(sorted(FORMS)), seed=st.integers(0, 10_000))
def test_round_trip_is_exact(kind, seed, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes")
    try:
        shapes = make_shapes(kind, seed, inflation=0.1 + 0.2, wall_error=1e-17, wall="a wåll: 'x'")
        again = read_shapes(write_shapes(shapes))
    except InputError:
        # Super-ellipsoids at random need not overlap; a file of such is refused as they are.
        return
    assert same(kind, shapes, again)
    for name in ("s.json", "s.yaml"):
        back = load_shapes(save_shapes(shapes, folder / name, note="of a test"))
        assert type(back) is type(shapes)
        assert (back.wall, back.wall_error, back.inflation) == ("a wåll: 'x'", 1e-17, 0.1 + 0.2)
        for field in FORMS[kind]:
            # A normal is made of unit length when read, which rounds once.
            close = 1e-15 if field == "normals" else 0.0
            assert getattr(back, field) == pytest.approx(getattr(shapes, field), rel=0, abs=close)


def test_file_is_readable(tmp_path):
    shapes = make_shapes("cones", 1)
    text = save_shapes(shapes, tmp_path / "s.json").read_text(encoding="utf-8")
    data = json.loads(text)
    assert (data["format"], data["version"], data["units"]) == ("bozzini shapes", 1, "mm")
    # One shape a line.
    assert sum('"radius"' in line for line in text.splitlines()) == len(shapes.radii)
    assert max(len(line) for line in text.splitlines()) < 200


def change(**fields):
    data = write_shapes(make_shapes("cones", 1))
    return data | fields


def change_shape(index, **fields):
    data = write_shapes(make_shapes("cones", 1))
    data["shapes"][index] |= fields
    return data


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (change_shape(1, radius=-2.5), r"shapes\[1\]\.radius is -2.5 mm: .*\[1e-06, 1e\+06\]"),
        (change_shape(1, radius="4 kg"), r"shapes\[1\]\.radius: '4 kg'"),
        (change_shape(1, radius=True), r"shapes\[1\]\.radius is True"),
        (change_shape(0, centre=[1.0, 2.0]), r"shapes\[0\]\.centre is \[1.0, 2.0\].*a list of 3"),
        (change_shape(0, centre=[1, 2, float("nan")]), r"shapes\[0\]\.centre\[2\]: .*finite"),
        (change_shape(0, centre=[1, 2, 10**400]), r"shapes\[0\]\.centre\[2\]: a number above"),
        (change_shape(0, colour="red"), r"shapes\[0\] has an unknown field 'colour'"),
        (change(shapes=[]), "shapes is .*1 or more"),
        (change(shapes=[{"centre": [0, 0, 0]}]), r"shapes\[0\] has no 'radius'"),
        (change(shapes={"a": 1}), "it must be a list"),
        (change(version=2), r"version is 2: it must lie in \[1, 1\]"),
        (change(version=True), "version is True"),
        (change(kind="boxes"), "kind is 'boxes': it must be one of .*cones"),
        (change(kind=["cones"]), "kind is .*it must be text"),
        (change(format="other"), "format is 'other'"),
        (change(units="m"), "units is 'm': choose one of mm"),
        (change(wall=3), "wall is 3: it must be text"),
        (change(fit="tight"), "fit is 'tight': it must be one of inscribed, least squares"),
        (change(note=["x"]), "note is .*it must be text"),
        (change(wall_error=None), "wall_error is None"),
        (change(extra=1), "unknown field 'extra'"),
        ([1, 2], r"the file is \[1, 2\]"),
        (None, "the file is None"),
    ],
)
def test_wrong_data_is_told_in_one_line(data, message, tmp_path):
    with pytest.raises(InputError, match=message) as caught:
        read_shapes(data)
    assert "\n" not in str(caught.value)


def test_text_with_a_unit_is_a_length():
    """YAML reads 4e0 as text."""
    for text in ("0.4 cm", "4e0"):
        assert read_shapes(change_shape(1, radius=text)).radii[1] == 4.0


def test_wrong_super_ellipsoid_names_its_number():
    data = write_shapes(make_shapes("superellipsoids", 3))
    data["shapes"][1]["e1"] = 2.5
    with pytest.raises(InputError, match=r"^shapes\[1\]\.e1 is 2.5: it must lie in \[0.1, 2\]"):
        read_shapes(data)
    data["shapes"][1]["e1"] = 1.0
    data["shapes"][1]["axes"][0] = [1.0, 1.0, 0.0]
    with pytest.raises(InputError, match=r"^shapes\[1\]\.axes is no rotation"):
        read_shapes(data)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.json", "{", "a.json: not JSON"),
        ("a.json", '{"kind": "cones", "kind": "cones"}', "the field 'kind' is given twice"),
        ("a.json", "[" * 100_000, "a.json: it is nested more than 50 lists or objects deep"),
        ("a.yaml", "a: [1", "a.yaml: not YAML in line"),
        ("a.yaml", "kind: cones\nkind: cones\n", "the field 'kind' is given twice"),
        ("a.yaml", "", "the file is None"),
        ("a.yaml", "? [1, 2]\n: 3\n", "a.yaml: not YAML"),
        ("a.txt", "{}", "ends in '.txt'"),
        ("a.yaml", "shapes: &s [*s]\n", "line 1 refers to '&s': write it out"),
        ("a.json", '{"%s": 1}' % ("k" * 5000), "unknown field 'kkk"),
    ],
)
def test_wrong_files_are_told_in_one_line(name, text, message, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(FileFormatError, match=message) as caught:
        load_shapes(path)
    assert "\n" not in str(caught.value)


@pytest.mark.timeout(60)
def test_references_that_grow_are_refused(tmp_path):
    """A few hundred bytes that stand for 10^10 numbers: neither built nor shown."""
    rows = ["wall:", "  - &a0 [1,1,1,1,1,1,1,1,1,1]"]
    rows += [f"  - &a{k} [{','.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]
    path = tmp_path / "grows.yaml"
    path.write_text("\n".join(rows))
    with pytest.raises(FileFormatError, match="line 3 refers to '&a0'"):
        load_shapes(path)


@pytest.mark.timeout(60)
def test_much_data_is_not_written_out_to_be_shown():
    many = [1.0] * 10
    for _ in range(9):
        many = [many] * 10
    with pytest.raises(InputError, match="wall is .*it must be text") as caught:
        read_shapes(change(wall=many))
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        ("cylinders", "normal", [0.0, 0.0, 0.0]),
        ("superellipsoids", "e2", 0.05),
        ("superellipsoids", "half_axes", [5.0, -1.0, 5.0]),
        ("superellipsoids", "axes", [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    ],
)
def test_what_a_constructor_refuses_is_named_as_in_the_file(kind, field, value):
    data = write_shapes(make_shapes(kind, 3))
    data["shapes"][1][field] = value
    with pytest.raises(InputError, match=rf"^shapes\[1\]\.{field} is "):
        read_shapes(data)


def test_one_circle_is_no_cylinder():
    data = write_shapes(make_shapes("cylinders", 3))
    with pytest.raises(InputError, match=r"^centres has shape \(1, 3\): .* at least 2"):
        read_shapes(data | {"shapes": data["shapes"][:1]})


@pytest.mark.parametrize("fit", ["", *FITS])
@pytest.mark.parametrize("name", ["s.json", "s.yaml"])
def test_the_file_says_how_shapes_were_fitted(fit, name, tmp_path):
    shapes = make_shapes("cones", 1)
    file = load_shapes_file(save_shapes(shapes, tmp_path / name, fit=fit, note="for a test"))
    assert (file.fit, file.note) == (fit, "for a test")
    assert same("cones", file.shapes, shapes)
    with pytest.raises(InputError, match="fit is 'tight'"):
        save_shapes(shapes, tmp_path / "t.json", fit="tight")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FileFormatError, match="No such file"):
        load_shapes(tmp_path / "none.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match="not UTF-8"):
        load_shapes(tmp_path / "b.json")


def test_writing_replaces_nothing_unasked(tmp_path):
    shapes = make_shapes("cones", 1)
    path = save_shapes(shapes, tmp_path / "s.json")
    before = path.read_text(encoding="utf-8")
    with pytest.raises(OutputError, match="exists already"):
        save_shapes(make_shapes("cones", 2), path)
    assert path.read_text(encoding="utf-8") == before
    save_shapes(make_shapes("cones", 2), path, force=True)
    assert path.read_text(encoding="utf-8") != before
    with pytest.raises(OutputError, match="ends in '.txt'"):
        save_shapes(shapes, tmp_path / "s.txt")
    with pytest.raises(OutputError, match="not a directory"):
        save_shapes(shapes, tmp_path / "no" / "s.json")
    (tmp_path / "d.json").mkdir()
    with pytest.raises(OutputError, match=r"d\.json is a directory"):
        save_shapes(shapes, tmp_path / "d.json", force=True)
    (tmp_path / "d.json").rmdir()
    field = Polygon([[0, 0], [1, 0], [0, 1]]).sample(0.1)
    with pytest.raises(InputError, match="a PlanarField has no file form"):
        save_shapes(field, tmp_path / "p.json")
    assert sorted(item.name for item in tmp_path.iterdir()) == ["s.json"]
