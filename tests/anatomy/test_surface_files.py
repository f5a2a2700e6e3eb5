"""Files of triangles: VTK in its forms, STL, GLB; damaged ones are refused in one line."""

from __future__ import annotations

import base64
import json
import struct
import zipfile
import zlib

import numpy as np
import pytest
import trimesh
from PIL import Image

from bozzini.anatomy import read_surface, write_tract
from bozzini.errors import BozziniError, FileFormatError

CORNERS = np.array([(x, y, z) for x in (0, 20) for y in (0, 30) for z in (0, 40)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
VOLUME = 24_000.0


def legacy(version="3.0", *, binary=True, kind="float"):
    dtype = {"float": ">f4", "double": ">f8"}[kind]
    form = b"BINARY" if binary else b"ASCII"
    head = b"# vtk DataFile Version %s\nmade here\n%s\nDATASET POLYDATA\n" % (
        version.encode(),
        form,
    )
    head += b"POINTS 8 %s\n" % kind.encode()

    def pack(values, kind):
        if binary:
            return np.asarray(values).astype(kind).tobytes() + b"\n"
        return " ".join(map(str, np.ravel(values))).encode() + b"\n"

    head += pack(CORNERS, dtype)
    if version.startswith("5"):
        head += b"METADATA\nINFORMATION 0\n\nPOLYGONS 7 24\nOFFSETS vtktypeint64\n"
        head += pack(np.arange(0, 28, 4), ">i8") + b"CONNECTIVITY vtktypeint64\n"
        head += pack(np.ravel(QUADS), ">i8")
    else:
        head += b"POLYGONS 6 30\n" + pack([(4, *quad) for quad in QUADS], ">i4")
    return head + b"CELL_DATA 6\nSCALARS x float\nLOOKUP_TABLE default\n"


def vtp(form, *, packed=False, coded=True, header="UInt32"):
    arrays = [
        (CORNERS.astype("<f4"), "Float32", 'NumberOfComponents="3"'),
        (np.ravel(QUADS).astype("<i8"), "Int64", 'Name="connectivity"'),
        (np.arange(4, 28, 4).astype("<i4"), "Int32", 'Name="offsets"'),
    ]
    word = {"UInt32": "<u4", "UInt64": "<u8"}[header]
    appended, texts = b"", []
    for values, kind, extra in arrays:
        raw = values.tobytes()
        if packed:
            parts = [raw[:100], raw[100:]]
            blocks = [zlib.compress(part) for part in parts if part]
            last = len(parts[-1])
            numbers = [len(blocks), 100, last, *map(len, blocks)]
            head, body = np.array(numbers, word).tobytes(), b"".join(blocks)
        else:
            head, body = np.array([len(raw)], word).tobytes(), raw
        if form == "ascii":
            data = " ".join(map(str, values.ravel()))
            texts.append(f'<DataArray type="{kind}" {extra} format="ascii">{data}</DataArray>')
            continue
        if coded:
            whole = (
                base64.b64encode(head) + base64.b64encode(body)
                if packed
                else base64.b64encode(head + body)
            )
        else:
            whole = head + body
        if form == "binary":
            texts.append(
                f'<DataArray type="{kind}" {extra} format="binary">{whole.decode()}</DataArray>'
            )
        else:
            texts.append(
                f'<DataArray type="{kind}" {extra} format="appended" offset="{len(appended)}"/>'
            )
            appended += whole
    packer = 'compressor="vtkZLibDataCompressor"' if packed else ""
    text = (
        f'<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
        f'header_type="{header}" {packer}><PolyData><Piece NumberOfPoints="8" NumberOfPolys="6">'
        f"<Points>{texts[0]}</Points><Polys>{texts[1]}{texts[2]}</Polys></Piece></PolyData>"
    )
    if form == "appended":
        encoding = "base64" if coded else "raw"
        return text.encode() + (
            f'<AppendedData encoding="{encoding}">_'.encode()
            + appended
            + b"</AppendedData></VTKFile>"
        )
    return text.encode() + b"</VTKFile>"


FILES = {
    "ascii.vtk": legacy(binary=False),
    "binary.vtk": legacy(),
    "double.vtk": legacy(kind="double"),
    "five.vtk": legacy("5.1"),
    "five_ascii.vtk": legacy("5.1", binary=False),
    "ascii.vtp": vtp("ascii"),
    "binary.vtp": vtp("binary", header="UInt64"),
    "zlib.vtp": vtp("binary", packed=True),
    "raw.vtp": vtp("appended", coded=False),
    "raw_zlib.vtp": vtp("appended", packed=True, coded=False),
    "coded.vtp": vtp("appended"),
    "coded_zlib.vtp": vtp("appended", packed=True, header="UInt64"),
}


@pytest.mark.parametrize("name", list(FILES))
def test_every_form_of_vtk_gives_the_same_surface(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    tract = read_surface(tmp_path / name)
    assert tract.volume == pytest.approx(VOLUME)
    assert len(tract.vertices) == 8


def vtu(points, cells, kinds):
    """An unstructured grid in text."""
    ends = np.cumsum([len(cell) for cell in cells])
    arrays = {"connectivity": np.concatenate(cells), "offsets": ends, "types": kinds}
    texts = [
        f'<DataArray type="Int64" Name="{name}" format="ascii">{" ".join(map(str, values))}'
        "</DataArray>"
        for name, values in arrays.items()
    ]
    return (
        '<VTKFile type="UnstructuredGrid" version="1.0"><UnstructuredGrid><Piece><Points>'
        '<DataArray type="Float64" NumberOfComponents="3" format="ascii">'
        f"{' '.join(map(str, np.ravel(points)))}</DataArray></Points>"
        f"<Cells>{''.join(texts)}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )


HEXAHEDRON = (0, 4, 6, 2, 1, 5, 7, 3)
"""The corners of the box in VTK's order."""
TETRAHEDRA = [
    [HEXAHEDRON[k] for k in row]
    for row in ((0, 1, 2, 5), (0, 2, 3, 7), (0, 5, 7, 4), (2, 7, 5, 6), (0, 2, 7, 5))
]
WEDGES = ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))
MIDDLE = np.vstack((CORNERS, CORNERS.mean(axis=0)))


@pytest.mark.parametrize(
    ("points", "cells", "kinds"),
    [
        (CORNERS, QUADS, [9] * 6),
        (CORNERS, [HEXAHEDRON], [12]),
        (CORNERS, [HEXAHEDRON, *QUADS], [12] + [9] * 6),  # its faces beside it, as Gmsh writes
        (CORNERS, TETRAHEDRA, [10] * 5),
        (CORNERS, [[HEXAHEDRON[k] for k in row] for row in WEDGES],
         [13, 13]),
        (MIDDLE, [[*reversed(quad), 8] for quad in QUADS], [14] * 6),
    ],
    ids=["flat", "hexahedron", "with-faces", "tetrahedra", "wedges", "pyramids"],
)  # fmt: skip
def test_a_grid_of_cells_gives_its_boundary(tmp_path, points, cells, kinds):
    (tmp_path / "box.vtu").write_text(vtu(points, cells, kinds))
    tract = read_surface(tmp_path / "box.vtu")
    assert tract.volume == pytest.approx(VOLUME)


@pytest.mark.parametrize(
    ("cells", "kinds", "said"),
    [
        ([range(8)], [24], "VTK's type 24"),
        ([range(4)], [12], "damaged"),
        ([[0, 1, 99]], [5], "99|open|vertices"),
    ],
)
def test_a_grid_of_other_cells_is_refused(tmp_path, cells, kinds, said):
    (tmp_path / "odd.vtu").write_text(vtu(CORNERS, cells, kinds))
    with pytest.raises(BozziniError, match=said):
        read_surface(tmp_path / "odd.vtu")


def surfaces():
    box = trimesh.creation.box((20.0, 30.0, 40.0)).subdivide()
    exported = {f"box.{kind}": box.export(file_type=kind) for kind in ("stl", "ply", "glb", "off")}
    exported["ascii.stl"] = box.export(file_type="stl_ascii")
    encoded = {k: v.encode() if isinstance(v, str) else v for k, v in exported.items()}
    return {**FILES, **encoded}


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    random = np.random.default_rng(0)
    refused = 0
    for name, data in surfaces().items():
        for trial in range(12):
            damaged = bytearray(data)
            if trial < 4:
                damaged = damaged[: int(random.integers(1, len(data)))]
            else:
                for _ in range(1 + trial % 4):
                    at = int(random.integers(0, min(len(data), 400 if trial % 2 else len(data))))
                    damaged[at] ^= 1 << int(random.integers(0, 8))
            path = tmp_path / name
            path.write_bytes(bytes(damaged))
            try:
                read_surface(path)
            except BozziniError as error:
                refused += 1
                assert "\n" not in str(error), (name, trial)
                assert len(str(error)) < 500 + len(str(tmp_path)), (name, trial)
    assert refused > 60


@pytest.mark.parametrize("name", ["binary.vtk", "raw.vtp", "box.stl", "box.ply"])
def test_a_file_cut_short_is_refused(tmp_path, name):
    data = surfaces()[name]
    for share in (0.3, 0.5, 0.65):
        (tmp_path / name).write_bytes(data[: int(share * len(data))])
        with pytest.raises(FileFormatError):
            read_surface(tmp_path / name)


def test_huge_counts_are_refused_before_they_are_allocated(tmp_path):
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    glb = box.export(file_type="glb")
    length = struct.unpack("<I", glb[12:16])[0]
    tree = json.loads(glb[20 : 20 + length])
    tree["accessors"][0]["count"] = 10**12
    del tree["accessors"][0]["bufferView"]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    size = 20 + len(text) + len(rest)
    head = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON")
    files = {
        "huge.glb": head + text + rest,
        "huge.stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 100,
        "huge.vtk": legacy().replace(b"POINTS 8 ", b"POINTS 999999999999 "),
        "cells.vtk": legacy().replace(b"POLYGONS 6 30", b"POLYGONS 999999999 30"),
        "minus.vtk": legacy().replace(b"POINTS 8 ", b"POINTS -8 "),
        "huge.vtp": vtp("appended", coded=False, header="UInt64").replace(
            np.array([96], "<u8").tobytes(), np.array([2**60], "<u8").tobytes()
        ),
        "bomb.vtp": b'<!DOCTYPE x [<!ENTITY a "b">]><VTKFile type="PolyData"/>',
    }
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(FileFormatError) as caught:
            read_surface(tmp_path / name)
        assert name in str(caught.value)


def test_glb_is_written_in_metres_and_comes_back_with_its_frame(tmp_path):
    (tmp_path / "box.vtk").write_bytes(FILES["binary.vtk"])
    tract = read_surface(tmp_path / "box.vtk", frame="LPS")
    path = write_tract(tmp_path / "box.glb", tract)
    assert trimesh.load(path).extents == pytest.approx((0.02, 0.03, 0.04))
    back = read_surface(path)
    assert back.findings == ()
    assert back.frame == "LPS"
    assert back.volume == pytest.approx(VOLUME, rel=1e-5)
    assert np.sort(back.vertices, axis=0) == pytest.approx(
        np.sort(tract.vertices, axis=0), abs=1e-4
    )


@pytest.mark.parametrize("kind", ["obj", "off"])
def test_text_that_is_not_utf8_is_read_as_far_as_it_is_numbers(tmp_path, kind):
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    lines = box.export(file_type=kind).splitlines()
    path = tmp_path / f"box.{kind}"
    path.write_bytes("\n".join([lines[0], "# Gef\u00e4\u00df", *lines[1:]]).encode("latin-1"))
    assert read_surface(path).volume == pytest.approx(VOLUME)
    lines[3] = lines[3].replace("0", "\u00e4")
    path.write_bytes("\n".join(lines).encode("latin-1"))
    with pytest.raises(FileFormatError) as caught:
        read_surface(path)
    assert f"is not {kind.upper()} triangles" in str(caught.value)
    assert "charset" not in str(caught.value)


def write_lines(path, lines):
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("kind", ["obj", "off"])
def test_text_that_is_cut_short_or_damaged_is_refused(tmp_path, kind):
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    lines = [line for line in box.export(file_type=kind).splitlines() if line[:1] not in ("#", "")]
    path = tmp_path / f"box.{kind}"
    first = next(k for k, line in enumerate(lines) if line[:2] in ("f ", "3 "))
    assert read_surface(write_lines(path, lines)).volume == pytest.approx(VOLUME)
    remark = [*lines[:first], "", "# faces", *lines[first:]]
    assert read_surface(write_lines(path, remark)).volume == pytest.approx(VOLUME)
    broken = [
        [*lines[:-1], lines[-1].rsplit(" ", 1)[0]],
        [*lines[:-1], lines[-1].rsplit(" ", 1)[0] + " 900"],
        [*lines[:2], lines[2].rsplit(" ", 1)[0], *lines[3:]],
        [*lines[:5], *lines[6:]],  # a vertex less
    ]
    if kind == "off":
        broken += [lines[:-3], [*lines, "3 0 1 2"], [*lines, "junk"], lines[:1], lines[:first]]
        broken.append([lines[0], "8 -12 0", *lines[2:]])
    for text in broken:
        with pytest.raises(FileFormatError) as caught:
            read_surface(write_lines(path, text))
        assert f"is not {kind.upper()} triangles" in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("kind", "face"), [("obj", "f 1 2"), ("obj", "f 3"), ("off", "2 0 1")])
def test_faces_of_two_corners_are_dropped_by_repair_and_counted(tmp_path, kind, face):
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    lines = [line for line in box.export(file_type=kind).splitlines() if line[:1] not in ("#", "")]
    if kind == "off":
        lines[1] = "8 14 0"
    at = next(k for k, line in enumerate(lines) if line[:2] in ("f ", "3 "))
    path = write_lines(tmp_path / f"box.{kind}", [*lines[:at], face, *lines[at:], face])
    with pytest.raises(FileFormatError) as caught:
        read_surface(path)
    assert f"the face '{face}' has " in str(caught.value)
    assert "--repair" in str(caught.value)
    tract = read_surface(path, repair=True)
    assert tract.volume == pytest.approx(VOLUME)
    assert [(item.code, item.message) for item in tract.findings] == [
        ("faces-dropped", "2 faces of one or two corners dropped")
    ]
    cut = write_lines(path, [*lines[:2], lines[2].rsplit(" ", 1)[0], *lines[3:], face, face])
    with pytest.raises(FileFormatError):  # half a vertex is damage
        read_surface(cut, repair=True)


def with_pictures(folder):
    """Write a box in every format with pictures that are lacking, damaged or odd."""
    box = trimesh.creation.box((20.0, 30.0, 40.0))
    points = [" ".join(map(str, point)) for point in box.vertices]
    rows = [" ".join(map(str, face)) for face in box.faces]
    ply = ["ply", "format ascii 1.0", "comment TextureFile skin.png", "element vertex 8"]
    ply += [f"property float {axis}" for axis in "xyz"]
    ply += [f"element face {len(rows)}", "property list uchar int vertex_indices"]
    head = "\n".join([*ply, "property list uchar float texcoord", "end_header", *points, ""])
    (folder / "lacking.ply").write_text(head + "".join(f"3 {r} 6 0 0 1 0 1 1\n" for r in rows))
    faces = ["f " + " ".join(f"{k + 1}/1" for k in face) for face in box.faces]
    text = ["mtllib none.mtl", *(f"v {p} 1 0 0" for p in points), "vt 0 0", "usemtl skin", *faces]
    write_lines(folder / "lacking.obj", text)
    off = ["COFF", "8 12 0", *(f"{point} 255 0 0 255" for point in points)]
    write_lines(folder / "coloured.off", [*off, *(f"3 {row}" for row in rows)])
    box.visual = trimesh.visual.TextureVisuals(uv=np.zeros((8, 2)), image=Image.new("RGB", (4, 4)))
    glb = box.apply_scale(1e-3).export(file_type="glb")
    (folder / "whole.glb").write_bytes(glb)
    at = glb.find(b"\x89PNG")
    (folder / "damaged.glb").write_bytes(glb[:at] + b"x" * 40 + glb[at + 40 :])
    end = 20 + int.from_bytes(glb[12:16], "little")
    for name, images in (("outside", [{"uri": "skin.png"}]), ("none", [])):
        tree = json.dumps({**json.loads(glb[20:end]), "images": images}).encode()
        tree += b" " * (-len(tree) % 4)
        body = len(tree).to_bytes(4, "little") + b"JSON" + tree + glb[end:]
        size = (12 + len(body)).to_bytes(4, "little")
        (folder / f"{name}.glb").write_bytes(glb[:8] + size + body)
    return sorted(folder.iterdir())


def test_pictures_and_colours_on_a_surface_are_passed_over_in_silence(tmp_path, capfd):
    files = with_pictures(tmp_path)
    assert len(files) == 7
    for path in files:
        tract = read_surface(path)
        assert tract.volume == pytest.approx(VOLUME, rel=1e-5), path.name
        assert {item.severity for item in tract.findings} <= {"note"}
    assert capfd.readouterr() == ("", "")


MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


def write_3mf(path, model, **others):
    """Write an archive of models as slicers of printers do: the first is the one to begin with."""
    link = f'<Relationships><Relationship Type="{MODEL}" Target="/3D/a.model"/></Relationships>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {"_rels/.rels": link, "3D/a.model": model, **others}.items():
            archive.writestr(name, text)
    return path


def box_object(number):
    triangles = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]
    return (
        f'<object id="{number}" name="box {number}"><mesh><vertices>'
        + "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in CORNERS)
        + "</vertices><triangles>"
        + "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles)
        + "</triangles></mesh></object>"
    )


CORE = 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"'
OTHER = 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
# By rows: x goes to y, y to -x, all twice as long.
TURN = "0 2 0 -2 0 0 0 0 2 1 0 0"


def test_a_3mf_is_put_where_its_build_says_in_its_unit(tmp_path):
    model = (
        f'<model {CORE} {OTHER} unit="centimeter"><resources>{{}}'
        '<object id="5"><components><component objectid="1" {} transform="{}"/></components>'
        '</object></resources><build><item objectid="5" transform="1 0 0 0 1 0 0 0 1 0 10 0"/>'
        "</build></model>"
    )
    whole = write_3mf(tmp_path / "a.3mf", model.format(box_object(1), "", TURN))
    apart = write_3mf(
        tmp_path / "b.3mf", model.format("", 'p:path="/3D/b.model"', TURN),
        **{"3D/b.model": f"<model {CORE}><resources>{box_object(1)}</resources></model>"},
    )  # fmt: skip
    turned = 2.0 * CORNERS[:, [1, 0, 2]] * [-1.0, 1.0, 1.0] + [1.0, 10.0, 0.0]
    for path in (whole, apart):
        tract = read_surface(path)
        assert tract.volume == pytest.approx(8.0 * 1000.0 * VOLUME)
        low, high = tract.vertices.min(axis=0), tract.vertices.max(axis=0)
        np.testing.assert_allclose(low, 10.0 * turned.min(axis=0), atol=1e-9)
        np.testing.assert_allclose(high, 10.0 * turned.max(axis=0), atol=1e-9)
    assert read_surface(whole, unit="mm").volume == pytest.approx(8.0 * VOLUME)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (f'<model {CORE} unit="yard"/>', "its unit is 'yard'"),
        (f"<model {CORE}><build/></model>", "holds no triangles"),
        (f'<model {CORE}><build><item objectid="3"/></build></model>', "it has no object 3"),
        ("<!DOCTYPE x><model/>", "declares XML entities"),
        ("<model", "is not 3MF triangles"),
        (
            f'<model {CORE}><resources><object id="1"><components><component objectid="1"/>'
            '</components></object></resources><build><item objectid="1"/></build></model>',
            "more than 20 deep",
        ),
    ],
)
def test_a_broken_3mf_is_one_line(tmp_path, model, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        read_surface(write_3mf(tmp_path / "a.3mf", model))
    assert "\n" not in str(caught.value)
    whole = (tmp_path / "a.3mf").read_bytes()
    (tmp_path / "a.3mf").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match="is not 3MF triangles"):
        read_surface(tmp_path / "a.3mf")
