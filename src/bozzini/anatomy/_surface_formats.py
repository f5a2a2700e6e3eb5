"""Triangles of VTK files: legacy PolyData, ASCII and binary, and VTP, read with NumPy alone."""

from __future__ import annotations

import base64
import json
import math
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ..errors import FileFormatError
from .tract import Finding, LabelTract, Organ, Point, SurfaceTract

# Models of the Gut Cell Atlas (GCA-Models): voxel size, landmarks and organ from their JSON.

MOST_BYTES_GCA = 20_000_000
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
    file : str
        Name of the JSON.
    voxel : (3,) float
        Voxel size: coordinates times it are mm.
    organ : {"upper-tract", "small-bowel", "colon"} or None
    landmarks : mapping of str to (3,) float
        By name and abbreviation, in the model's coordinates.
    """

    file: str
    voxel: NDArray[np.float64]
    organ: Organ | None
    landmarks: Mapping[str, NDArray[np.float64]]

    def describe(
        self,
        tract: SurfaceTract | LabelTract,
        corners: NDArray[np.float64],
        sizes: NDArray[np.float64],
        *,
        found_unit: bool,
    ) -> SurfaceTract | LabelTract:
        """Add landmarks, organ and frame to a tract whose coordinates were scaled by `sizes`."""
        low, high = corners.min(axis=0), corners.max(axis=0)
        slack = 0.05 * float((high - low).max())
        places = {name: point * sizes for name, point in self.landmarks.items()}

        def count(points: Iterable[NDArray[np.float64]]) -> int:
            return sum(bool(((p >= low - slack) & (p <= high + slack)).all()) for p in points)

        # Some models have the mid-line in mm already.
        if count(self.landmarks.values()) > count(places.values()):
            places = dict(self.landmarks)
        kept = {
            name: (float(p[0]), float(p[1]), float(p[2]))
            for name, p in places.items()
            if count([p])
        }
        frame = _prove_frame(kept) if self.organ == "colon" else None
        said = [f"{len(kept)} names of landmarks" if kept else "no landmark"]
        if found_unit:
            said.insert(0, "voxel size " + " x ".join(f"{value:g}" for value in self.voxel) + " mm")
        if self.organ:
            said.append(f"organ {self.organ}")
        if frame:
            said.append(f"frame {frame}, as anus and flexures lie")
        message = f"read from the model's {self.file}: {', '.join(said)}"
        return replace(
            tract,
            organ=self.organ,
            landmarks=kept,
            frame=frame,
            findings=(*tract.findings, Finding("model-read", "note", message)),
        )


def find_model(surface: Path) -> Model | None:
    """Return what the JSON of a GCA model beside a surface, or one folder up, states on it."""
    for folder in (surface.parent, surface.parent.parent):
        try:
            files = sorted(folder.glob("*.json"))[:MOST_FILES]
        except OSError:
            continue
        for file in files:
            tree = _load(file)
            if not isinstance(tree, dict) or not isinstance(tree.get("model_objects"), list):
                continue
            try:
                model = _read_model(tree, file, surface)
            except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError):
                continue
            if model is not None:
                return model
    return None


def _load(file: Path) -> Any:
    try:
        if file.stat().st_size > MOST_BYTES_GCA:
            return None
        return json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None


def _read_model(tree: dict[str, Any], file: Path, surface: Path) -> Model | None:
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
    organ = _find_organ(f"{_simplify(surface.stem)} {text}".lower())
    landmarks = {}
    for path in tree.get("paths", []):
        if organ is not None and organ != _find_organ(_describe(path)):
            continue
        points = _read_path(str(path.get("spline_filename", "")), file, surface)
        if points is None:
            continue
        for mark in tree.get("landmarks", []):
            if path["id"] not in mark.get("paths", []):
                continue
            at = int(mark["position"][0])
            if 0 <= at < len(points):
                for anatomy in mark["anatomy"]:
                    for key in ("text", "abbreviated_name"):
                        if anatomy.get(key):
                            landmarks[str(anatomy[key])] = points[at]
    return Model(file=file.name, voxel=voxel, organ=organ, landmarks=landmarks)


def _describe(path: Mapping[str, Any]) -> str:
    text = str(path.get("anatomy", {}).get("text", ""))
    return f"{text} {_simplify(Path(str(path.get('spline_filename', ''))).stem)}".lower()


def _simplify(name: str) -> str:
    return name.lower().replace("_", " ").replace("-", " ")


def _find_organ(text: str) -> Organ | None:
    """Return the organ of the first word found; that of a part of it comes after the whole."""
    words = f" {text} "
    hits = [
        (words.find(word), organ) for organ, names in _ORGANS for word in names if word in words
    ]
    parts = [
        organ
        for organ, names in _ORGANS
        if organ == "upper-tract" and any(w in words for w in names)
    ]
    if parts:  # duodenum and stomach are parts of files named after the small intestine
        return parts[0]
    return min(hits)[1] if hits else None


def _read_path(name: str, file: Path, surface: Path) -> NDArray[np.float64] | None:
    if not name or Path(name).name != name:
        return None
    for folder in (
        surface.parent,
        file.parent,
        file.parent / "Paths",
        surface.parent.parent / "Paths",
    ):
        tree = _load(folder / name)
        if isinstance(tree, dict) and isinstance(tree.get("points"), list):
            points = np.array(tree["points"], dtype=np.float64)
            if points.ndim == 2 and points.shape[1] == 3 and np.isfinite(points).all():
                return points
    return None


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


# Triangles of STL files, binary and ASCII.

HEAD = 84
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


def read_stl(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read the triangles of an STL file, each with its own corners.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    vertices : ndarray, shape (3 m, 3)
        In the file's unit.
    faces : ndarray, shape (m, 3)

    Raises
    ------
    FileFormatError
        If it is no STL file, or its size is not that of the triangles that it states.
    """
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


Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]

_LEGACY_TYPES = {
    "char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4",
    "unsigned_int": "u4", "long": "i8", "unsigned_long": "u8", "float": "f4", "double": "f8",
    "vtktypeint32": "i4", "vtktypeint64": "i8", "vtkidtype": "i8",
}  # fmt: skip

_XML_TYPES = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip

MOST_BYTES = 1 << 31
"""Largest array that is unpacked from a compressed file."""


def read_vtk(path: Path) -> Mesh:
    """Read the points and triangles of a legacy VTK PolyData file, ASCII or binary.

    Polygons of more than three corners are split into fans, strips into triangles; lines and
    attributes are not read.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
        In the file's unit.
    faces : ndarray, shape (m, 3)

    Raises
    ------
    FileFormatError
        If it is not such a file, or it is cut short.
    """
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
            f"{path} is {_show(body.split(chr(10).encode(), 1)[0])}: only DATASET POLYDATA is read"
        )
    try:
        return _read_legacy(body[kind.end() :], binary=form == b"BINARY")
    except (ValueError, IndexError, KeyError, OverflowError, MemoryError):
        raise FileFormatError(
            f"{path} is cut short or damaged: its numbers do not add up"
        ) from None


def _show(line: bytes) -> str:
    return "".join(c if c.isprintable() else "?" for c in line.decode("ascii", "replace"))[
        :60
    ].strip()


def _read_legacy(body: bytes, *, binary: bool) -> Mesh:
    points = None
    faces: list[NDArray[np.int64]] = []
    take = _take_binary if binary else _take_ascii
    while True:
        line = re.compile(rb"\s*([A-Za-z_]+)[ \t]*([^\n]*)(\n|$)").match(body)
        if line is None:
            break
        word, rest = line[1].upper(), line[2].split()
        body = body[line.end() :]
        if word == b"POINTS":
            values, body = take(body, 3 * int(rest[0]), _LEGACY_TYPES[rest[1].decode().lower()])
            with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN
                points = values.astype(np.float64).reshape(-1, 3)
        elif word in (b"POLYGONS", b"TRIANGLE_STRIPS", b"VERTICES", b"LINES"):
            table, body = _take_cells(body, rest, take)
            if word == b"POLYGONS":
                faces.append(_split_polygons(*table))
            elif word == b"TRIANGLE_STRIPS":
                faces.append(_split_strips(*table))
        elif word == b"METADATA":  # runs to the next empty line
            body = body[body.index(b"\n\n") + 2 :] if b"\n\n" in body else b""
        else:  # attributes follow the cells
            break
    if points is None:
        raise ValueError("no points")
    return points, _join(faces)


def _take_ascii(body: bytes, number: int, kind: str) -> tuple[NDArray[Any], bytes]:
    if number < 0 or number > len(body):
        raise ValueError("too few numbers")
    words = body.split(maxsplit=number)
    rest = words[number] if len(words) > number else b""
    if len(words) < number:
        raise ValueError("too few numbers")
    return np.array(words[:number], dtype=np.float64 if kind[0] == "f" else np.int64), rest


def _take_binary(body: bytes, number: int, kind: str) -> tuple[NDArray[Any], bytes]:
    size = number * int(kind[1])
    if number < 0 or size > len(body):
        raise ValueError("too few bytes")
    return np.frombuffer(body[:size], dtype=">" + kind), body[size:]


def _take_cells(body: bytes, rest: list[bytes], take: Any) -> tuple[Any, bytes]:
    """Read a table of cells as connectivity and offsets."""
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
    table, body = take(body, second, "i4")
    table = table.astype(np.int64)
    if second == 4 * first and (table[::4] == 3).all():
        return (table.reshape(-1, 4)[:, 1:].reshape(-1), np.arange(0, 3 * first + 1, 3)), body
    starts = np.zeros(first + 1, dtype=np.int64) if first <= second else None
    if starts is None:
        raise ValueError("more cells than numbers")
    keep = np.ones(second, dtype=bool)
    place = 0
    for k in range(first):
        keep[place] = False
        length = int(table[place])
        if length < 0:
            raise ValueError("negative length")
        starts[k + 1] = starts[k] + length
        place += length + 1
    if place != second:
        raise ValueError("cells do not add up")
    return (table[keep], starts), body


def _check_offsets(corners: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    sizes = np.diff(starts)
    if len(starts) and (starts[0] != 0 or (sizes < 0).any() or starts[-1] > len(corners)):
        raise ValueError("offsets do not add up")
    return sizes


def _split_polygons(corners: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    sizes = _check_offsets(corners, starts)
    faces = []
    for size in np.unique(sizes[sizes > 2]):
        rows = corners[starts[:-1][sizes == size][:, None] + np.arange(size)]
        faces += [rows[:, (0, k, k + 1)] for k in range(1, int(size) - 1)]
    return _join(faces)


def _split_strips(corners: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    sizes = _check_offsets(corners, starts)
    faces = []
    for start, size in zip(starts[:-1], sizes, strict=True):
        strip = corners[start : start + size]
        rows = np.stack((strip[:-2], strip[1:-1], strip[2:]), axis=1) if size > 2 else None
        if rows is not None:
            rows[1::2] = rows[1::2, ::-1]
            faces.append(rows)
    return _join(faces)


def _join(faces: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    if not faces:
        return np.zeros((0, 3), dtype=np.int64)
    return np.concatenate(faces).astype(np.int64)


def read_vtp(path: Path) -> Mesh:
    """Read the points and triangles of a VTK XML PolyData file, with inline or appended data.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    vertices : ndarray, shape (n, 3)
    faces : ndarray, shape (m, 3)

    Raises
    ------
    FileFormatError
        If it is not such a file, it is damaged, or it is packed otherwise than with zlib.
    """
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
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise FileFormatError(f"{path} is not a VTP file: it declares XML entities")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as error:
        raise FileFormatError(f"{path} is not a VTP file: {error}") from None
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise FileFormatError(f"{path} is not a VTP file: it is no VTKFile of type PolyData")
    packer = root.get("compressor", "")
    if packer not in ("", "vtkZLibDataCompressor"):
        raise FileFormatError(
            f"{path} is packed by {packer[:40]}: only vtkZLibDataCompressor is read"
        )
    coded = encoding is not None and encoding[1] == b"base64"
    try:
        reader = _XmlArrays(root, appended, coded=coded)
        pieces = [_read_piece(piece, reader) for piece in root.iter("Piece")]
        starts = np.cumsum([0] + [len(points) for points, _ in pieces[:-1]])
        if not pieces:
            raise ValueError("no piece")
        return (
            np.concatenate([points for points, _ in pieces]),
            np.concatenate([faces + at for (_, faces), at in zip(pieces, starts, strict=True)]),
        )
    except (ValueError, IndexError, KeyError, OverflowError, MemoryError, zlib.error):
        raise FileFormatError(
            f"{path} is cut short or damaged: its numbers do not add up"
        ) from None


def _read_piece(piece: ElementTree.Element, reader: _XmlArrays) -> Mesh:
    points = reader.read(piece.find("Points/DataArray")).astype(np.float64).reshape(-1, 3)
    faces = []
    for name, split in (("Polys", _split_polygons), ("Strips", _split_strips)):
        arrays = {item.get("Name"): item for item in piece.findall(f"{name}/DataArray")}
        if {"connectivity", "offsets"} <= set(arrays):
            corners = reader.read(arrays["connectivity"]).astype(np.int64)
            ends = reader.read(arrays["offsets"]).astype(np.int64)
            faces.append(split(corners, np.concatenate(([0], ends))))
    return points, _join(faces)


class _XmlArrays:
    """Decodes the arrays of a VTK XML file."""

    def __init__(self, root: ElementTree.Element, appended: bytes, *, coded: bool) -> None:
        self.order = ">" if root.get("byte_order") == "BigEndian" else "<"
        self.header = self.order + _XML_TYPES[root.get("header_type", "UInt32")]
        self.packed = bool(root.get("compressor"))
        self.appended = appended
        self.coded = coded

    def read(self, item: ElementTree.Element | None) -> NDArray[Any]:
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
            size = int(self._take(data, 0, 1, coded=coded)[0][0])
            return self._cut(data, width, size, coded=coded)
        (blocks, _, _), _ = self._take(data, 0, 3, coded=coded)
        count = int(blocks)
        if count > len(data):
            raise ValueError("more blocks than bytes")
        head, used = self._take(data, 0, 3 + count, coded=coded)
        sizes = [int(size) for size in head[3:]]
        # The header is coded for itself, the blocks together.
        body = self._cut(data[used:], 0, sum(sizes), coded=coded)
        whole, place = [], 0
        for size in sizes:
            unpacker = zlib.decompressobj()
            whole.append(unpacker.decompress(body[place : place + size], MOST_BYTES))
            if not unpacker.eof:
                raise ValueError("a block does not end")
            place += size
        return b"".join(whole)

    def _take(
        self, data: bytes, start: int, number: int, *, coded: bool
    ) -> tuple[NDArray[Any], int]:
        """Read numbers of the header; return them and how many bytes they take."""
        size = number * int(self.header[-1])
        if coded:
            used = 4 * ((size + 2) // 3)
            raw = base64.b64decode(data[start : start + used], validate=True)
        else:
            used, raw = size, data[start : start + size]
        if len(raw) < size:
            raise ValueError("too few bytes")
        return np.frombuffer(raw[:size], dtype=self.header), used

    @staticmethod
    def _cut(data: bytes, skip: int, size: int, *, coded: bool) -> bytes:
        if coded:
            data = base64.b64decode(data[: 4 * ((skip + size + 2) // 3)], validate=True)
        if skip + size > len(data):
            raise ValueError("too few bytes")
        return data[skip : skip + size]
