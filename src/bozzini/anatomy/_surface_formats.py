"""Triangles of files: STL, PLY, OBJ, GLB, OFF, 3MF and VTK, refused where they are damaged.

trimesh reads PLY, OBJ, GLB and OFF. VTK is read here: meshio 5.3 reads neither PolyData of legacy
VTK files nor VTP. STL is read here too, since trimesh reads files that are cut short.
"""

from __future__ import annotations

import base64
import io
import itertools
import json
import math
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, cast
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from ..io.inputs import note_input
from ..io.records import check_depth
from ..results import Json
from ._threemf import read_3mf
from .files import FRAME_KEY, declares_entities, explain, has_suffix, quiet_libraries
from .tract import Finding, Organ, Point, Tract, count_noun, to_point

SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".glb", ".off", ".3mf", ".vtk", ".vtp", ".vtu")

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]
Mesh = tuple[Vertices, Faces]


class SurfaceFile(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    parts : list of (str, (n, 3) float, (m, 3) int)
        Name, corners in the file's unit, and triangles.
    marked : bool
        Whether Bozzini wrote the file, and noted the frame in it.
    frame : object
        What it noted, unchecked.
    short : int
        Faces of one or two corners that were dropped.
    unit : float, optional
        Of the corners, as far as the file states it [mm].
    """

    parts: list[tuple[str, Vertices, Faces]]
    marked: bool = False
    frame: object = None
    short: int = 0
    unit: float | None = None


def read_parts(file: Path, *, repair: bool = False) -> SurfaceFile:
    """Read the meshes of a file, each where its node puts it; of pictures on them nothing.

    With `repair` faces of one or two corners in text (OBJ, OFF) are dropped: else they are taken
    for lines cut short.

    Raises
    ------
    FileFormatError
        If the file is broken.
    """
    readers = {".stl": _read_stl, ".vtk": _read_vtk, ".vtp": _read_vtp, ".vtu": _read_vtu}
    for suffix, reader in readers.items():
        if has_suffix(file, (suffix,)):
            return SurfaceFile([("1", *reader(file))])
    if has_suffix(file, (".3mf",)):
        found, unit = read_3mf(file)
        return SurfaceFile(found, unit=unit)
    short = 0
    import trimesh

    kind = file.suffix.lower().lstrip(".")
    data = file.read_bytes()
    mark = _check_glb(file, data) if kind == "glb" else {}
    with quiet_libraries():
        try:
            if kind == "off":
                text, short = _check_off(data.decode("latin-1"), repair=repair)
                data = text.encode()
            elif kind == "obj":
                text, short = _check_obj(_to_text(data), repair=repair)
                data = text.encode()
            scene = trimesh.load(
                io.BytesIO(data), file_type=kind, process=False, skip_materials=True
            )
            if not isinstance(scene, trimesh.Scene):
                scene = trimesh.Scene({"1": scene})
            parts = []
            for node in scene.graph.nodes_geometry:
                transform, name = scene.graph[node]
                mesh = scene.geometry[name]
                if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                    vertices = np.asarray(mesh.vertices, dtype=np.float64).reshape(-1, 3)
                    vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
                    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
                    parts.append((str(node), vertices, faces))
        except Exception as error:  # trimesh's loaders raise many kinds on a broken file
            raise FileFormatError(
                f"{file} is not {kind.upper()} triangles: {explain(error)}"
            ) from None
    return SurfaceFile(parts, marked="frame" in mark, frame=mark.get("frame"), short=short)


def _to_text(data: bytes) -> str:
    """Return text; what is not UTF-8 has names and remarks of Latin-1, its numbers are ASCII."""
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _tell_short(face: str, corners: int) -> str:
    return f"the face '{face[:60]}' has {count_noun(corners, 'corner')}: --repair drops such faces"


def _check_off(text: str, *, repair: bool) -> tuple[str, int]:
    """Return an OFF file without remarks, and how many faces of one or two corners it had.

    `ValueError` unless it has the lines that it states.
    """
    lines = [line.split("#")[0].split() for line in text.splitlines()]
    lines = [line for line in lines if line]
    if not lines or not lines[0][0].endswith("OFF"):
        raise ValueError("it does not begin with OFF")
    if len(lines[0]) > 1:  # the counts may stand on the same line
        lines[:1] = [lines[0][:1], lines[0][1:]]
    counts, rest = (lines[1] if len(lines) > 1 else []), lines[2:]
    if len(counts) < 2:
        raise ValueError("it states no numbers of vertices and faces")
    corners, faces = int(counts[0]), int(counts[1])
    if min(corners, faces) < 0 or len(rest) != corners + faces:
        raise ValueError(
            f"its header states {corners} vertices and {faces} faces, it has {len(rest)} lines "
            "of them: it is cut short or damaged"
        )
    for line in rest[:corners]:
        if len(line) < 3:
            raise ValueError(f"the vertex '{' '.join(line)}' has {len(line)} numbers, not 3")
    for line in rest[corners:]:
        if len(line) < 1 + int(line[0]):
            raise ValueError(f"the face '{' '.join(line)[:60]}' is cut short")
        if int(line[0]) < 3 and not repair:
            raise ValueError(_tell_short(" ".join(line), int(line[0])))
        if not all(0 <= int(word) < corners for word in line[1 : 1 + int(line[0])]):
            raise ValueError(
                f"the face '{' '.join(line)[:60]}' has vertices that are not in [0, {corners - 1}]"
            )
    whole = [line for line in rest[corners:] if int(line[0]) > 2]
    short = faces - len(whole)
    kept = [lines[0], [str(corners), str(faces - short), *counts[2:]], *rest[:corners], *whole]
    return "\n".join(" ".join(line) for line in kept), short


def _check_obj(text: str, *, repair: bool) -> tuple[str, int]:
    """Return an OBJ file without faces of one or two corners, and how many it had.

    `ValueError` for half a line, or a face of vertices not there.
    """
    corners, highest, kept, short = 0, 0, [], 0
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        key, *words = line.split("#")[0].split() or [""]
        if key == "f" and len(words) < 3:
            if not repair:
                raise ValueError(_tell_short(line.strip(), len(words)))
            short += 1
            continue
        kept.append(line)
        if key not in ("v", "f"):
            continue
        if len(words) < 3:
            raise ValueError(f"the line '{line.strip()[:60]}' is cut short")
        if key == "v":
            corners += 1
            continue
        for word in words:
            index = int(word.split("/")[0])
            if index == 0 or index < -corners:
                raise ValueError(f"the face '{line.strip()[:60]}' names no vertex {index}")
            highest = max(highest, index)
    if highest > corners:
        raise ValueError(f"a face names vertex {highest}, but it has {corners} vertices")
    return "\n".join(kept), short


def _check_glb(file: Path, data: bytes) -> dict[str, object]:
    """Refuse a GLB whose counts cannot be in the file; return what `write_tract` noted in it."""
    length = int.from_bytes(data[12:16], "little")
    if data[:4] != b"glTF" or int.from_bytes(data[8:12], "little") != len(data):
        raise FileFormatError(f"{file} is not GLB triangles: it is cut short or damaged")
    try:
        tree = cast(Json, check_depth(json.loads(data[20 : 20 + length])))
        counts = [int(item["count"]) for item in tree.get("accessors", [])]
        mark = tree.get("asset", {}).get("extras", {}).get(FRAME_KEY)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise FileFormatError(f"{file} is not GLB triangles: its JSON is damaged") from None
    packed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"} & set(
        map(str, tree.get("extensionsRequired", []))
    )
    if packed:
        raise FileFormatError(f"{file} is packed by {packed.pop()}: save it without compression")
    if counts and not 0 <= min(counts) <= max(counts) <= len(data):
        raise FileFormatError(
            f"{file} is not GLB triangles: {max(counts)} numbers stated, {len(data)} bytes there"
        )
    return {"frame": None, **mark} if isinstance(mark, dict) else {}


HEAD = 84
"""Bytes of a binary STL before its triangles."""

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


def _read_stl(path: Path) -> Mesh:
    """Read the triangles of an STL file, binary or ASCII, each with its own corners."""
    data = path.read_bytes()
    number = int.from_bytes(data[80:HEAD], "little") if len(data) >= HEAD else -1
    if number >= 0 and len(data) == HEAD + _TRIANGLE.itemsize * number:
        table = np.frombuffer(data, dtype=_TRIANGLE, offset=HEAD, count=number)
        corners = table["corners"].astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        words = _VERTEX.findall(data)
        facets = len(re.findall(rb"\bendfacet\b", data))
        ended = re.search(rb"\bendsolid\b", data) is not None
        if len(words) != 3 * facets or not ended:
            raise FileFormatError(f"{path} is not STL triangles: it is cut short or damaged")
        try:
            corners = np.array(words, dtype=np.float64).reshape(-1, 3, 3)
        except ValueError:
            raise FileFormatError(f"{path} is not STL triangles: a vertex is no number") from None
    else:
        stated = f": {number} triangles stated, {len(data)} bytes there" if number >= 0 else ""
        raise FileFormatError(f"{path} is not STL triangles{stated}")
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


_LEGACY_TYPES = {
    "char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4",
    "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8", "float": "f4", "double": "f8",
    "vtktypeint32": "i4", "vtktypeint64": "i8", "vtkidtype": "i8",
}  # fmt: skip

_XML_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8", "String": "u1",
}  # fmt: skip

MOST_BYTES = 1 << 31
"""Largest array that is unpacked from a compressed file."""


def _read_vtk(path: Path) -> Mesh:
    """Read a legacy VTK PolyData file; polygons and strips become triangles."""
    found = load_legacy(path)
    return found.points, found.faces


class LegacyData(NamedTuple):
    """What a legacy VTK PolyData file holds.

    Attributes
    ----------
    points : (n, 3) float
    faces : (m, 3) int
    lines : list of (k,) int
        Numbers of the points of each.
    title : str
        Its second line.
    rest : bytes
        What follows the cells, not read yet: its attributes.
    take : callable
        What reads numbers of that.
    """

    points: Vertices
    faces: Faces
    lines: list[Faces]
    title: str
    rest: bytes
    take: Taker


def load_legacy(path: Path) -> LegacyData:
    """Read a legacy VTK PolyData file, but for its attributes."""
    data = path.read_bytes()
    head = data.split(b"\n", 3)
    if not head[0].startswith(b"# vtk DataFile") or len(head) < 4:
        raise FileFormatError(f"{path} is not a legacy VTK file")
    form = head[2].strip().upper()
    if form not in (b"ASCII", b"BINARY"):
        raise FileFormatError(f"{path} is {_show(head[2])}: a legacy VTK file is ASCII or BINARY")
    body = head[3]
    kind = re.match(rb"\s*DATASET\s+(\S+)", body)
    if kind is None or kind[1].upper() != b"POLYDATA":
        raise FileFormatError(
            f"{path} is {_show(body.partition(bytes([10]))[0])}: only DATASET POLYDATA is read"
        )
    take = _take_binary if form == b"BINARY" else _take_ascii
    with tell_damage(path):
        return _read_legacy(body[kind.end() :], take, _show(head[1]))


@contextmanager
def tell_damage(path: Path) -> Iterator[None]:
    """Refuse a file in which numbers do not add up."""
    try:
        yield
    except FileFormatError:
        raise
    except _DAMAGE:
        raise FileFormatError(f"{path} is cut short or damaged: {_COUNTS}") from None


_DAMAGE = (ValueError, IndexError, KeyError, OverflowError, MemoryError, zlib.error)
_COUNTS = "its numbers do not add up"


def _show(line: bytes) -> str:
    text = line.decode("ascii", "replace")[:60]
    return "".join(c if c.isprintable() else "?" for c in text).strip()


Numbers = NDArray[np.float64] | NDArray[np.int64] | NDArray[np.number[Any]]
Taker = Callable[[bytes, int, str], tuple[Numbers, bytes]]
"""Reads numbers of a type from the beginning of bytes; returns them and the bytes that follow."""


_WORDS = re.compile(rb"\s*([A-Za-z_]+)[ \t]*([^\n]*)(\n|$)")
"""A line that begins with a word."""


def _read_legacy(body: bytes, take: Taker, title: str) -> LegacyData:
    points = None
    faces: list[Faces] = []
    lines: list[Faces] = []
    while (line := _WORDS.match(body)) is not None:
        word, rest = line[1].upper(), line[2].split()
        if word in (b"POINT_DATA", b"CELL_DATA"):
            break
        body = body[line.end() :]
        if word == b"POINTS":
            values, body = take(body, 3 * int(rest[0]), _LEGACY_TYPES[rest[1].decode().lower()])
            points = _to_points(values)
        elif word in (b"POLYGONS", b"TRIANGLE_STRIPS", b"VERTICES", b"LINES"):
            table, body = _take_cells(body, rest, take)
            if word == b"POLYGONS":
                faces.append(_split_polygons(*table))
            elif word == b"TRIANGLE_STRIPS":
                faces.append(_split_strips(*table))
            elif word == b"LINES":
                lines += split_lines(*table)
        elif word == b"METADATA":
            body = _skip_metadata(body)
        elif word == b"FIELD":
            _, body = _take_fields(body, int(rest[1]), take)
        else:
            break
    if points is None:
        raise ValueError("no points")
    return LegacyData(points, _join(faces), lines, title, body, take)


def _skip_metadata(body: bytes) -> bytes:
    """Return what follows the next empty line."""
    return body[body.index(b"\n\n") + 2 :] if b"\n\n" in body else b""


def _take_fields(body: bytes, count: int, take: Taker) -> tuple[dict[str, Numbers], bytes]:
    """Read so many named arrays."""
    found = {}
    for _ in range(count):
        if re.match(rb"\s*METADATA", body):
            body = _skip_metadata(body)
        line = re.match(rb"\s*(\S+)[ \t]+(\d+)[ \t]+(\d+)[ \t]+(\w+)[^\n]*\n", body)
        if line is None:
            raise ValueError("no array")
        kind = _LEGACY_TYPES[line[4].decode().lower()]
        values, body = take(body[line.end() :], int(line[2]) * int(line[3]), kind)
        found[unquote(line[1].decode("utf-8", "replace"))] = values
    return found, body


def read_point_data(body: bytes, take: Taker) -> dict[str, Numbers]:
    """Return the arrays of the points among the attributes of a legacy VTK file."""
    found: dict[str, Numbers] = {}
    of_points, count = False, 0
    while (line := _WORDS.match(body)) is not None:
        word, rest = line[1].upper(), line[2].split()
        body = body[line.end() :]
        arrays: dict[str, Numbers] = {}
        if word in (b"POINT_DATA", b"CELL_DATA"):
            of_points, count = word == b"POINT_DATA", int(rest[0])
        elif word in (b"SCALARS", b"VECTORS", b"NORMALS"):
            parts = (int(rest[2]) if len(rest) > 2 else 1) if word == b"SCALARS" else 3
            table = re.match(rb"\s*LOOKUP_TABLE[^\n]*\n", body)
            body = body if table is None else body[table.end() :]
            values, body = take(body, parts * count, _LEGACY_TYPES[rest[1].decode().lower()])
            arrays = {unquote(rest[0].decode("utf-8", "replace")): values}
        elif word == b"FIELD":
            arrays, body = _take_fields(body, int(rest[1]), take)
        elif word == b"METADATA":
            body = _skip_metadata(body)
        else:
            break
        found |= arrays if of_points else {}
    return found


def _take_ascii(body: bytes, number: int, kind: str) -> tuple[Numbers, bytes]:
    words = body.split(maxsplit=number) if 0 <= number <= len(body) else []
    if number < 0 or len(words) < number:
        raise ValueError("too few numbers")
    rest = words[number] if len(words) > number else b""
    return np.array(words[:number], dtype=np.float64 if kind[0] == "f" else np.int64), rest


def _take_binary(body: bytes, number: int, kind: str) -> tuple[Numbers, bytes]:
    size = number * int(kind[1])
    if not 0 <= size <= len(body):
        raise ValueError("too few bytes")
    return np.frombuffer(body[:size], dtype=">" + kind), body[size:]


def _to_points(values: Numbers) -> Vertices:
    with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN
        return values.astype(np.float64).reshape(-1, 3)


def _take_cells(body: bytes, rest: list[bytes], take: Taker) -> tuple[tuple[Faces, Faces], bytes]:
    """Read a table of cells as corners, and the offset of each cell in them, 0 first."""
    first, second = int(rest[0]), int(rest[1])
    if re.match(rb"\s*OFFSETS", body):  # version 5: numbers of offsets and of corners
        arrays = []
        for count in (first, second):
            line = re.match(rb"\s*[A-Z]+[ \t]+(\w+)[ \t]*\n", body)
            if line is None:
                raise ValueError("no type")
            values, body = take(body[line.end() :], count, _LEGACY_TYPES[line[1].decode().lower()])
            arrays.append(values.astype(np.int64))
        return (arrays[1], arrays[0]), body
    values, body = take(body, second, "i4")
    table = values.astype(np.int64)
    if second == 4 * first and (table[::4] == 3).all():
        return (table.reshape(-1, 4)[:, 1:].reshape(-1), np.arange(0, 3 * first + 1, 3)), body
    sizes, place = [0], 0
    for _ in range(min(first, second + 1)):
        sizes.append(int(table[place]))
        place += sizes[-1] + 1
        if sizes[-1] < 0:
            raise ValueError("negative length")
    if place != second:
        raise ValueError("cells do not add up")
    starts = np.cumsum(sizes)
    return (np.delete(table, starts[:-1] + np.arange(len(starts) - 1)), starts), body


def _check_offsets(corners: Faces, starts: Faces) -> Faces:
    sizes = np.diff(starts)
    if len(starts) and (starts[0] != 0 or (sizes < 0).any() or starts[-1] > len(corners)):
        raise ValueError("offsets do not add up")
    return sizes


def _split_polygons(corners: Faces, starts: Faces) -> Faces:
    sizes = _check_offsets(corners, starts)
    faces = []
    for size in np.unique(sizes[sizes > 2]):
        rows = corners[starts[:-1][sizes == size][:, None] + np.arange(size)]
        faces += [rows[:, (0, k, k + 1)] for k in range(1, int(size) - 1)]
    return _join(faces)


def _split_strips(corners: Faces, starts: Faces) -> Faces:
    faces = []
    for start, size in zip(starts[:-1], _check_offsets(corners, starts), strict=True):
        strip = corners[start : start + max(size, 2)]
        rows = np.stack((strip[:-2], strip[1:-1], strip[2:]), axis=1)
        rows[1::2] = rows[1::2, ::-1]
        faces.append(rows)
    return _join(faces)


def split_lines(corners: Faces, starts: Faces) -> list[Faces]:
    """Return the numbers of the points of each line."""
    _check_offsets(corners, starts)
    return [corners[a:b] for a, b in itertools.pairwise(starts.tolist())]


def _join(faces: list[Faces]) -> Faces:
    return np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces])


def _read_vtp(path: Path) -> Mesh:
    """Read the triangles of a VTK XML PolyData file."""
    root, reader = open_xml(path)
    with tell_damage(path):
        return join_meshes([_read_piece(piece, reader) for piece in root.iter("Piece")])


def _read_vtu(path: Path) -> Mesh:
    """Read the boundary of a VTK XML UnstructuredGrid."""
    root, reader = open_xml(path, "UnstructuredGrid")
    with tell_damage(path):
        return join_meshes([_read_grid(path, piece, reader) for piece in root.iter("Piece")])


def open_xml(path: Path, kind: str = "PolyData") -> tuple[ElementTree.Element, XmlArrays]:
    """Open a VTK XML file of a kind with inline or appended data, plain or packed with zlib."""
    name = path.suffix[1:].upper()
    data = path.read_bytes()
    appended = b""
    start = data.find(b"<AppendedData")
    if start >= 0:
        begin, end = data.find(b"_", start) + 1, data.rfind(b"</AppendedData>")
        encoding = re.search(rb"encoding\s*=\s*[\"'](\w+)", data[start:begin])
        if begin == 0 or end < begin or encoding is None:
            raise FileFormatError(f"{path} is cut short or damaged: its appended data do not end")
        appended = data[begin:end]
        data = data[:start] + b"</VTKFile>"
    else:
        encoding = None
    if declares_entities(data):
        raise FileFormatError(f"{path} is not a {name} file: it declares XML entities")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise FileFormatError(f"{path} is not a {name} file: {error}") from None
    if root.tag != "VTKFile" or root.get("type") != kind:
        raise FileFormatError(f"{path} is not a {name} file: it is no VTKFile of type {kind}")
    packer = root.get("compressor", "")
    if packer not in ("", "vtkZLibDataCompressor"):
        raise FileFormatError(
            f"{path} is packed by {packer[:40]}: only vtkZLibDataCompressor is read"
        )
    coded = encoding is not None and encoding[1] == b"base64"
    with tell_damage(path):
        return root, XmlArrays(root, appended, coded=coded)


def join_meshes(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one."""
    starts = np.cumsum([0] + [len(points) for points, _ in meshes])
    return (
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([faces + at for (_, faces), at in zip(meshes, starts, strict=False)]),
    )


def _read_piece(piece: ElementTree.Element, reader: XmlArrays) -> Mesh:
    faces = []
    for name, split in (("Polys", _split_polygons), ("Strips", _split_strips)):
        table = reader.read_cells(piece, name)
        if table is not None:
            faces.append(split(*table))
    return reader.read_points(piece), _join(faces)


_FLAT = (5, 7, 9)
"""Numbers of VTK's triangle, polygon and quadrilateral."""

_SOLID = {
    10: ((0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)),
    12: ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    13: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    14: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""The faces, seen from outside, of VTK's tetrahedron, hexahedron, wedge and pyramid."""

_NO_AREA = (1, 2, 3, 4)
"""Points and lines, which are left out."""


def _read_grid(path: Path, piece: ElementTree.Element, reader: XmlArrays) -> Mesh:
    """Read the faces that no two solid cells share; without solid cells the flat ones."""
    table = reader.read_cells(piece, "Cells")
    items = {item.get("Name"): item for item in piece.findall("Cells/DataArray")}
    if table is None or "types" not in items:
        raise ValueError("no cells")
    corners, starts = table
    kinds = reader.read(items["types"]).astype(np.int64)
    sizes = _check_offsets(corners, starts)
    if len(kinds) != len(sizes):
        raise ValueError("types do not add up")
    foreign = np.setdiff1d(kinds, (*_FLAT, *_SOLID, *_NO_AREA))
    if foreign.size:
        raise FileFormatError(
            f"{path} has cells of VTK's type {foreign[0]}: triangles, quadrilaterals, polygons, "
            "tetrahedra, hexahedra, wedges and pyramids with straight edges are read"
        )
    points = reader.read_points(piece)
    if not np.isin(kinds, tuple(_SOLID)).any():
        flat = np.flatnonzero(np.isin(kinds, _FLAT))
        rows = [corners[starts[k] : starts[k + 1]] for k in flat]
        ends = np.cumsum([0, *map(len, rows)])
        return points, _split_polygons(np.concatenate([np.zeros(0, np.int64), *rows]), ends)
    faces: dict[int, list[Faces]] = {3: [], 4: []}
    for kind, sides in _SOLID.items():
        chosen = starts[:-1][kinds == kind, None]
        if (sizes[kinds == kind] != max(map(max, sides)) + 1).any():
            raise ValueError("a solid cell has other corners than its type")
        for side in sides:
            faces[len(side)].append(corners[chosen + np.array(side)])
    triangles, quads = (_find_single(np.concatenate(found)) for found in faces.values())
    return points, _join([triangles, quads[:, :3], quads[:, (0, 2, 3)]])


def _find_single(faces: Faces) -> Faces:
    """Return the faces whose corners no other face has."""
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    single: Faces = faces[first[count == 1]]
    return single


class XmlArrays:
    """Decodes the arrays of a VTK XML file."""

    def __init__(self, root: ElementTree.Element, appended: bytes, *, coded: bool) -> None:
        self.order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self.header = self.order + _XML_TYPES[root.get("header_type", "UInt32")]
        self.packed = bool(root.get("compressor"))
        self.appended = appended
        self.coded = coded

    def read_points(self, piece: ElementTree.Element) -> Vertices:
        """Return the points (n, 3) of a piece."""
        return _to_points(self.read(piece.find("Points/DataArray")))

    def read_cells(self, piece: ElementTree.Element, name: str) -> tuple[Faces, Faces] | None:
        """Return cells of a piece as corners, and the offset of each cell in them, 0 first."""
        arrays = {item.get("Name"): item for item in piece.findall(f"{name}/DataArray")}
        if not {"connectivity", "offsets"} <= set(arrays):
            return None
        corners = self.read(arrays["connectivity"]).astype(np.int64)
        ends = self.read(arrays["offsets"]).astype(np.int64)
        return corners, np.concatenate(([0], ends))

    def read(self, item: ElementTree.Element | None) -> Numbers:
        """Return the numbers of an array, one after the other."""
        if item is None:
            raise ValueError("an array is missing")
        kind = _XML_TYPES[item.get("type", "")]
        form = item.get("format", "ascii")
        if form == "ascii":
            dtype = np.float64 if kind[0] == "f" else np.int64
            return np.array((item.text or "").split(), dtype=dtype)
        coded = True
        if form == "appended":
            offset = int(item.get("offset", ""))
            if not 0 <= offset <= len(self.appended):
                raise ValueError("an offset lies beyond the data")
            data, coded = self.appended[offset:], self.coded
        else:
            data = (item.text or "").strip().encode("ascii", "strict")
        return np.frombuffer(self._unpack(data, coded=coded), dtype=self.order + kind)

    def _unpack(self, data: bytes, *, coded: bool) -> bytes:
        width = int(self.header[-1])
        if not self.packed:
            (size,), _ = self._take_header(data, 1, coded=coded)
            return _cut(data, width, size, coded=coded)
        (count, _, _), _ = self._take_header(data, 3, coded=coded)
        if count > len(data):
            raise ValueError("more blocks than bytes")
        head, used = self._take_header(data, 3 + count, coded=coded)
        # The header is coded for itself, the blocks together.
        body = _cut(data[used:], 0, sum(head[3:]), coded=coded)
        whole, place = [], 0
        for size in head[3:]:
            unpacker = zlib.decompressobj()
            whole.append(unpacker.decompress(body[place : place + size], MOST_BYTES))
            if not unpacker.eof:
                raise ValueError("a block does not end")
            place += size
        return b"".join(whole)

    def _take_header(self, data: bytes, number: int, *, coded: bool) -> tuple[list[int], int]:
        """Read numbers of the header; return them and how many bytes of the file they take."""
        size = number * int(self.header[-1])
        raw = _cut(data, 0, size, coded=coded)
        used = 4 * ((size + 2) // 3) if coded else size
        return [int(value) for value in np.frombuffer(raw, dtype=self.header)], used


def _cut(data: bytes, skip: int, size: int, *, coded: bool) -> bytes:
    """Return bytes of data that may be coded as base64."""
    if coded:
        data = base64.b64decode(data[: 4 * ((skip + size + 2) // 3)], validate=True)
    if skip + size > len(data):
        raise ValueError("too few bytes")
    return data[skip : skip + size]


# Models of the Gut Cell Atlas (GCA-Models): voxel size, landmarks and organ from their JSON.

MOST_BYTES_JSON = 20_000_000
"""Largest JSON that is opened."""

MOST_FILES = 50
"""Files of a folder that are opened, at most."""

UPRIGHT = 2.0
"""How much longer a way must be along its main axis than along the others to prove the axis."""

_ORGANS: tuple[tuple[Organ, tuple[str, ...]], ...] = (
    ("small-bowel", ("small intestine", "small bowel", "jejunum", "ileum")),
    ("upper-tract", ("oesophagus", "esophagus", "stomach", "duodenum", "ogl", "gdj", "pol")),
    ("colon", ("large intestine", "large bowel", "colon", "rectum", "sigmoid", "hepatic flexure",
               "splenic flexure", "caecum", "cecum", "transverse")),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Model:
    """What the JSON of a model states on one of its surfaces.

    Attributes
    ----------
    files : tuple of Path
        The JSON, and the mid-lines that were read with it.
    voxel : (3,) float
        Voxel size: coordinates times it are mm.
    organ : {"upper-tract", "small-bowel", "colon"} or None
    landmarks : mapping of str to (3,) float
        By name and abbreviation, in the model's coordinates.
    """

    files: tuple[Path, ...]
    voxel: NDArray[np.float64]
    organ: Organ | None
    landmarks: Mapping[str, NDArray[np.float64]]

    def annotate(
        self, tract: Tract, corners: Vertices, sizes: NDArray[np.float64], *, found_unit: bool
    ) -> Tract:
        """Add landmarks, organ and frame to a tract whose coordinates were scaled by `sizes`."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        slack = 0.05 * float((high - low).max())

        def keep(scale: NDArray[np.float64]) -> dict[str, Point]:
            places = {name: point * scale for name, point in self.landmarks.items()}
            return {
                name: to_point(p)
                for name, p in places.items()
                if ((p >= low - slack) & (p <= high + slack)).all()
            }

        # Some models have the mid-line in mm already.
        kept = max(keep(sizes), keep(np.ones(3)), key=len)
        frame = _prove_frame(kept) if self.organ == "colon" else None
        read = [f"{len(kept)} names of landmarks" if kept else "no landmark"]
        if found_unit:
            read.insert(0, "voxel size " + " x ".join(f"{value:g}" for value in self.voxel) + " mm")
        if self.organ:
            read.append(f"organ {self.organ}")
        if frame:
            read.append(f"frame {frame}, as anus and flexures lie")
        message = f"read from the model's {self.files[0].name}: {', '.join(read)}"
        found = (*tract.findings, Finding("model-read", "note", message))
        return replace(tract, organ=self.organ, landmarks=kept, frame=frame, findings=found)


def find_model(surface: Path) -> Model | None:
    """Return what the JSON of a GCA model beside a .vtk file, or one folder up, states on it."""
    if not has_suffix(surface, (".vtk",)):
        return None
    for folder in (surface.parent, surface.parent.parent):
        try:
            files = sorted(folder.glob("*.json"))[:MOST_FILES]
        except OSError:
            continue
        for file in files:
            try:
                model = _read_model(file, surface)
            except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError):
                continue
            if model is not None:
                for used in model.files:
                    note_input(used)
                return model
    return None


def _load(file: Path) -> Json:
    try:
        if file.stat().st_size <= MOST_BYTES_JSON:
            tree = check_depth(json.loads(file.read_bytes()))
            return tree if isinstance(tree, dict) else {}
    except (OSError, ValueError, RecursionError):
        pass
    return {}


def _read_model(file: Path, surface: Path) -> Model | None:
    tree = _load(file)
    objects = [item for item in tree["model_objects"] if isinstance(item, dict)]
    name = _simplify(surface.stem)
    own = [item for item in objects if _simplify(Path(str(item.get("filename", ""))).stem) == name]
    if not own:
        return None
    voxel = np.ones(3)
    for item in objects:
        if "voxel_size" in item:
            voxel = np.array([float(value) for value in item["voxel_size"]])
    if voxel.shape != (3,) or not ((voxel > 1e-3) & (voxel < 1e2)).all():
        return None
    text = " ".join(str(item.get("display_props", {}).get("text", "")) for item in own)
    organ = _find_organ(f"{name} {text}")
    files, landmarks = [file], {}
    for path in tree.get("paths", []):
        line = str(path.get("spline_filename", ""))
        words = f"{path.get('anatomy', {}).get('text', '')} {_simplify(Path(line).stem)}"
        place = _find_path(line, file, surface)
        if place is None or organ not in (None, _find_organ(words)):
            continue
        points = np.array(_load(place)["points"], dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            continue
        files.append(place)
        for mark in tree.get("landmarks", []):
            at = int(mark["position"][0]) if path["id"] in mark.get("paths", []) else -1
            if 0 <= at < len(points):
                for anatomy in mark["anatomy"]:
                    for key in ("text", "abbreviated_name"):
                        if anatomy.get(key):
                            landmarks[str(anatomy[key])] = points[at]
    return Model(files=tuple(files), voxel=voxel, organ=organ, landmarks=landmarks)


def _simplify(name: str) -> str:
    return name.lower().replace("_", " ").replace("-", " ")


def _find_organ(text: str) -> Organ | None:
    """Return the organ of the first word found; that of a part of it comes after the whole."""
    words = f" {text.lower()} "
    hits = [
        (words.find(word), organ) for organ, names in _ORGANS for word in names if word in words
    ]
    # Duodenum and stomach are parts of files named after the small intestine.
    if any(organ == "upper-tract" for _, organ in hits):
        return "upper-tract"
    return min(hits)[1] if hits else None


def _find_path(name: str, file: Path, surface: Path) -> Path | None:
    """Return where the mid-line of a model lies, which has points."""
    folders = (surface.parent, file.parent, file.parent / "Paths", surface.parent.parent / "Paths")
    if not name or Path(name).name != name:
        return None
    places = (folder / name for folder in folders)
    return next((place for place in places if isinstance(_load(place).get("points"), list)), None)


def _prove_frame(landmarks: Mapping[str, Point]) -> str | None:
    """Return the frame that the anus and the two flexures of a colon prove, if they do.

    Both flexures lie above the anus, the hepatic one to the right of the splenic one, and the anus
    behind the middle of the flexures' height; a frame that is not right-handed proves nothing.
    """
    try:
        anus, liver, spleen = (np.array(landmarks[name]) for name in ("anus", "HF", "SF"))
    except KeyError:
        return None
    letters = ["", "", ""]
    axes = []
    for way, pair in ((0.5 * (liver + spleen) - anus, "SI"), (liver - spleen, "RL")):
        axis = int(np.abs(way).argmax())
        others = np.delete(np.abs(way), axis)
        if abs(way[axis]) < UPRIGHT * others.max() or letters[axis]:
            return None
        letters[axis] = pair[0] if way[axis] > 0 else pair[1]
        axes.append(np.eye(3)[axis] * math.copysign(1.0, way[axis]))
    front = np.cross(axes[0], axes[1])  # head x right
    axis = int(np.abs(front).argmax())
    if float(front @ (anus - 0.5 * (liver + spleen))) >= 0.0:
        return None
    letters[axis] = "A" if front[axis] > 0 else "P"
    return "".join(letters)
