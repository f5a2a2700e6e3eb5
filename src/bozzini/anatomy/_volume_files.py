"""Volumes from files of one or two pieces: NIfTI, NRRD and MetaImage, every byte accounted for.

No header is believed: the voxels that it states are compared with what the file can hold before
memory is taken for them, a compressed stream is read to its end so that its checksum is verified,
and a byte too many is an error like a byte too few.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, FileFormatError
from ._files import explain, has_suffix, name_file
from ._names import read_label_table
from ._quiet import quiet_libraries
from .findings import Finding
from .labels import Volume

__all__ = ["read_metaimage", "read_nifti", "read_nrrd"]

Path_ = str | os.PathLike[str]
Compression = Literal["gzip", "zlib"] | None

MOST_VOXELS = 1 << 31
MOST_HEADER = 1 << 24
"""Bytes of a header with all its extensions."""

INFLATION = 1040
"""A deflate stream grows at most by this factor (1032 by its format)."""

_SCALE_TO_MM = {"mm": 1.0, "meter": 1000.0, "micron": 0.001}


def read_nifti(path: Path_) -> Volume:
    """Read a NIfTI-1 or NIfTI-2 file (.nii, .nii.gz), in its world frame (RAS+) in mm."""
    with _open(path, "NIfTI") as handle:
        compression: Compression = "gzip" if has_suffix(path, (".gz",)) else None
        stream = _inflate(handle, compression)
        header, extensions = _read_nifti_header(stream, path)
        with quiet_libraries():
            unit = header.get_xyzt_units()[0]
            framed = int(header["qform_code"]) > 0 or int(header["sform_code"]) > 0
            affine = np.array(header.get_best_affine(), dtype=np.float64)
            slope, shift = header.get_slope_inter()
            shape = tuple(int(length) for length in header.get_data_shape())
            dtype = header.get_data_dtype()
        _check_dimensions(path, shape)
        array = _read_voxels(
            stream, handle, path, shape=shape, dtype=dtype, packed=bool(compression)
        )
    if slope not in (None, 1.0) or shift not in (None, 0.0):
        array = array * np.float32(slope) + np.float32(shift)
    found = []
    if unit in _SCALE_TO_MM:
        affine[:3] *= _SCALE_TO_MM[unit]
    if unit == "unknown":
        message = "the file states no unit of length: taken as mm"
        found.append(Finding("unit-unknown", "note", message))
    elif unit != "mm":
        message = f"the file is in {unit}: converted to mm"
        found.append(Finding("unit-converted", "note", message))
    if not framed:
        message = (
            "the file states no world frame (qform and sform codes are 0): the origin is the "
            "middle of the volume, left and right are by NIfTI's default"
        )
        found.append(Finding("frame-unknown", "warning", message))
    return Volume(
        array=array,
        affine=affine,
        source=name_file(path),
        names=read_label_table(extensions.decode("utf-8", "replace")),
        frame="RAS" if framed else None,
        findings=tuple(found),
    )


def _read_nifti_header(stream: BinaryIO, path: Path_) -> tuple[Any, bytes]:
    """Return the header, and the bytes between it and the voxels."""
    import nibabel

    nifti: Any = nibabel
    start = stream.read(4)
    kinds = {348: nifti.Nifti1Header, 540: nifti.Nifti2Header}
    orders: tuple[Literal["little", "big"], ...] = ("little", "big")
    size = next((n for n in kinds for order in orders if start == n.to_bytes(4, order)), 0)
    if not size:
        raise FileFormatError(f"{path} is not a NIfTI volume: its header has no known size")
    block = start + stream.read(size - 4)
    with quiet_libraries():
        header = kinds[size](block)
        header.get_xyzt_units()
    if bytes(header["magic"].tobytes())[:3] not in (b"n+1", b"n+2"):
        raise FileFormatError(f"{path} is not a NIfTI volume: it is not of one file (.nii)")
    offset = float(header["vox_offset"])
    if not (size + 4 <= offset <= MOST_HEADER and offset == int(offset)):
        raise FileFormatError(f"{path} is damaged: its voxels begin at byte {offset:g}")
    extensions = stream.read(int(offset) - size)
    if len(extensions) < int(offset) - size:
        raise FileFormatError(f"{path} is truncated: it ends inside its header")
    return header, extensions


_NRRD_TYPES = {
    "int8": ("signed char", "int8", "int8_t"),
    "uint8": ("uchar", "unsigned char", "uint8", "uint8_t"),
    "int16": ("short", "short int", "signed short", "signed short int", "int16", "int16_t"),
    "uint16": ("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"),
    "int32": ("int", "signed int", "int32", "int32_t"),
    "uint32": ("uint", "unsigned int", "uint32", "uint32_t"),
    "int64": ("longlong", "long long", "long long int", "signed long long",
              "signed long long int", "int64", "int64_t"),
    "uint64": ("ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"),
    "float32": ("float",),
    "float64": ("double",),
}  # fmt: skip

_NRRD_SPACES = {
    "right-anterior-superior": "RAS", "ras": "RAS",
    "left-anterior-superior": "LAS", "las": "LAS",
    "left-posterior-superior": "LPS", "lps": "LPS",
}  # fmt: skip


def read_nrrd(path: Path_) -> Volume:
    """Read a NRRD file (.nrrd, .nhdr, Slicer's .seg.nrrd), coordinates in its own space.

    A segmentation of several layers comes back with a fourth axis, one entry per layer.
    """
    with _open(path, "NRRD") as handle:
        if not re.fullmatch(rb"NRRD000\d\r?\n", handle.readline(64)):
            raise FileFormatError(f"{path} is not a NRRD volume: it does not begin with NRRD000")
        fields, pairs = _read_nrrd_header(handle, path)
        sizes = _split_numbers(fields, "sizes", path, integer=True)
        dtype = _find_type(fields, path)
        encoding = fields.get("encoding", "").lower()
        if encoding not in ("raw", "gzip", "gz"):
            raise FileFormatError(f"{path} has the encoding '{encoding}': known are raw and gzip")
        for word in ("line skip", "byte skip"):
            if fields.get(word, "0") != "0":
                raise FileFormatError(f"{path} asks for a {word}: not read")
        spatial, affine, frame, found = _read_nrrd_space(fields, len(sizes), path)
        shape = tuple(int(size) for size in sizes)
        detached = fields.get("data file", fields.get("datafile"))
        with _open_data(handle, path, detached) as data:
            packed: Compression = None if encoding == "raw" else "gzip"
            array = _read_voxels(
                _inflate(data, packed), data, path, shape=shape, dtype=dtype, packed=bool(packed)
            )
    array = np.moveaxis(array, spatial, (0, 1, 2))
    return Volume(
        array=array,
        affine=affine,
        source=name_file(path),
        names=_read_segments(pairs),
        frame=frame,
        findings=tuple(found),
        segments=_list_segments(pairs) if array.ndim > 3 and array.shape[3] > 1 else (),
    )


def _read_nrrd_header(handle: BinaryIO, path: Path_) -> tuple[dict[str, str], dict[str, str]]:
    """Return the fields (``key: value``) and the key/value pairs (``key:=value``)."""
    fields: dict[str, str] = {}
    pairs: dict[str, str] = {}
    while line := handle.readline(MOST_HEADER):
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if not text:
            return fields, pairs
        key, sign, value = text.partition(":=")
        if sign:
            pairs[key] = value
        elif not text.startswith("#"):
            key, sign, value = text.partition(":")
            if not sign:
                raise FileFormatError(f"{path} is not a NRRD volume: header line '{text[:40]}'")
            fields[key.strip().lower()] = value.strip()
    if "data file" in fields or "datafile" in fields:
        return fields, pairs
    raise FileFormatError(f"{path} is truncated: its NRRD header has no end")


def _find_type(fields: dict[str, str], path: Path_) -> np.dtype[Any]:
    word = fields.get("type", "").lower()
    kind = next((name for name, words in _NRRD_TYPES.items() if word in words), None)
    if kind is None:
        raise FileFormatError(f"{path} holds voxels of type '{word}': not read")
    order = fields.get("endian", "little").lower()
    return np.dtype(kind).newbyteorder(">" if order == "big" else "<")


def _read_nrrd_space(
    fields: dict[str, str], dimension: int, path: Path_
) -> tuple[list[int], NDArray[np.float64], str | None, list[Finding]]:
    """Return which axes are those of space, the affine, the frame, and what was found."""
    found: list[Finding] = []
    affine = np.eye(4)
    if "space directions" in fields:
        vectors = re.findall(r"none|\([^)]*\)", fields["space directions"].lower())
        spatial = [at for at, text in enumerate(vectors) if text != "none"]
        if len(vectors) != dimension or len(spatial) != 3:
            raise FileFormatError(
                f"{path} has {len(spatial)} axes of space among {dimension}: a volume has 3"
            )
        columns = [_split_vector(vectors[at], path) for at in spatial]
        affine[:3, :3] = np.stack(columns, axis=1)
        if "space origin" in fields:
            affine[:3, 3] = _split_vector(fields["space origin"], path)
    else:
        if dimension != 3:
            raise FileFormatError(f"{path} has {dimension} dimensions: a label volume has 3")
        spatial = [0, 1, 2]
        affine[:3, :3] = np.diag(_split_numbers(fields, "spacings", path))
    units = set(re.findall(r'"([^"]*)"', fields.get("space units", ""))) - {"", "mm"}
    if units:
        raise FileFormatError(f"{path} is in {', '.join(sorted(units))}: only mm is read")
    frame = _NRRD_SPACES.get(fields.get("space", "").lower())
    if frame is None:
        message = "the file does not state where its axes point in the patient"
        found.append(Finding("frame-unknown", "warning", message))
    return spatial, affine, frame, found


def _read_segments(pairs: dict[str, str]) -> dict[int, str]:
    """Return the names of a Slicer segmentation of one layer, by label."""
    return {label: name for name, label, _ in _list_segments(pairs)}


def _list_segments(pairs: dict[str, str]) -> tuple[tuple[str, int, int], ...]:
    """Return name, label and layer of each segment of a Slicer segmentation."""
    found = []
    for number in range(MOST_HEADER):
        name = pairs.get(f"Segment{number}_Name", pairs.get(f"Segment{number}_ID"))
        if name is None:
            break
        try:
            label = int(pairs.get(f"Segment{number}_LabelValue", number + 1))
            layer = int(pairs.get(f"Segment{number}_Layer", 0))
        except ValueError:
            continue
        if label > 0 and layer >= 0:
            found.append((name.strip(), label, layer))
    return tuple(found)


_META_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4",
    "MET_UINT": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip


def read_metaimage(path: Path_) -> Volume:
    """Read a MetaImage (.mha, .mhd), in its world frame, which is LPS, in mm."""
    with _open(path, "MetaImage") as handle:
        fields: dict[str, str] = {}
        while "elementdatafile" not in fields:
            line = handle.readline(MOST_HEADER)
            key, sign, value = line.decode("utf-8", "replace").partition("=")
            if not sign:
                raise FileFormatError(f"{path} is not a MetaImage volume: no ElementDataFile")
            fields[key.strip().lower()] = value.strip()
        shape = tuple(int(v) for v in _split_numbers(fields, "dimsize", path, integer=True))
        if fields.get("elementnumberofchannels", "1") != "1" or len(shape) != 3:
            raise FileFormatError(f"{path} has the shape {shape}: a label volume has 3 dimensions")
        kind = fields.get("elementtype", "").upper()
        if kind not in _META_TYPES:
            raise FileFormatError(f"{path} holds voxels of type '{kind}': not read")
        if fields.get("headersize", "0") != "0" or fields.get("binarydata", "True") != "True":
            raise FileFormatError(
                f"{path} is a MetaImage of text or with a header to skip: not read"
            )
        big = fields.get("binarydatabyteordermsb", fields.get("elementbyteordermsb", "False"))
        dtype = np.dtype(_META_TYPES[kind]).newbyteorder(">" if big == "True" else "<")
        spacing = _split_numbers(fields, "elementspacing", path)
        packed = fields.get("compresseddata", "False") == "True"
        name = fields["elementdatafile"]
        with _open_data(handle, path, None if name == "LOCAL" else name) as data:
            size = math.prod(shape) * dtype.itemsize
            stream = _inflate(data, "zlib" if packed else None, size)
            array = _read_voxels(stream, data, path, shape=shape, dtype=dtype, packed=packed)
    turns = [word for word in ("transformmatrix", "orientation", "rotation") if word in fields]
    turn = _split_numbers(fields, turns[0], path) if turns else np.eye(3).ravel()
    places = [word for word in ("offset", "position", "origin") if word in fields]
    origin = _split_numbers(fields, places[0], path) if places else np.zeros(3)
    if len(spacing) != 3 or len(turn) != 9 or len(origin) != 3:
        raise FileFormatError(f"{path} is damaged: spacing, axes or offset are not those of 3-D")
    affine = np.eye(4)
    affine[:3, :3] = np.reshape(turn, (3, 3)).T * spacing  # a line of the matrix is an axis
    affine[:3, 3] = origin
    return Volume(array=array, affine=affine, source=name_file(path), frame="LPS")


def _split_numbers(
    fields: dict[str, str], key: str, path: Path_, *, integer: bool = False
) -> NDArray[np.float64]:
    try:
        values = np.array([float(word) for word in fields.get(key, "").split()])
    except ValueError:
        values = np.zeros(0)
    legal = len(values) > 0 and np.isfinite(values).all()
    if not legal or (integer and ((values < 1) | (values != np.rint(values))).any()):
        raise FileFormatError(f"{path} is damaged: '{key}' is '{fields.get(key, '')[:60]}'")
    return values


def _split_vector(text: str, path: Path_) -> NDArray[np.float64]:
    try:
        values = np.array([float(word) for word in text.strip("() ").split(",")])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise FileFormatError(f"{path} is damaged: '{text[:60]}' is not a vector of 3 numbers")
    return values


@contextmanager
def _open(path: Path_, kind: str) -> Iterator[BinaryIO]:
    """Open a file, and turn whatever goes wrong while it is read into one line."""
    try:
        with Path(path).open("rb") as handle:
            yield handle
    except BozziniError:
        raise
    except MemoryError:
        raise FileFormatError(f"{path} does not fit in memory") from None
    except (EOFError, OSError, zlib.error) as error:
        raise FileFormatError(
            f"{path} is truncated or damaged: its voxels cannot be read ({explain(error)})"
        ) from None
    except Exception as error:  # nibabel raises many kinds on a broken header
        raise FileFormatError(f"{path} is not a {kind} volume: {explain(error)}") from None


@contextmanager
def _open_data(handle: BinaryIO, path: Path_, detached: str | None) -> Iterator[BinaryIO]:
    """Give the file that holds the voxels: this one, or another in the same folder."""
    if detached is None:
        yield handle
        return
    other = Path(path).parent / detached
    if detached.upper().startswith("LIST") or "%" in detached or other.parent != Path(path).parent:
        raise FileFormatError(
            f"{path} has its voxels in '{detached}': only one file beside it is read"
        )
    if not other.is_file():
        raise FileFormatError(f"{path} has its voxels in '{detached}', which is not beside it")
    with other.open("rb") as data:
        yield data


def _inflate(handle: BinaryIO, compression: Compression, size: int = 0) -> BinaryIO:
    """Return a stream of the bytes that follow; one of zlib holds at most `size` and one more."""
    if compression == "gzip":
        return gzip.GzipFile(fileobj=handle, mode="rb")  # type: ignore[return-value]
    if compression is None:
        return handle
    content = handle.read()
    if size > INFLATION * len(content) + 1024:
        return io.BytesIO()  # ... which is refused as too short
    inflater = zlib.decompressobj(47)  # the header says whether it is zlib or gzip
    data = inflater.decompress(content, size + 1)
    if not inflater.eof or inflater.unused_data:
        raise EOFError("the compressed stream does not end where the file does")
    return io.BytesIO(data)


def _read_voxels(
    stream: BinaryIO,
    handle: BinaryIO,
    path: Path_,
    *,
    shape: Sequence[int],
    dtype: np.dtype[Any],
    packed: bool,
) -> NDArray[Any]:
    """Return the voxels, first axis fastest, after which the stream must end."""
    count = math.prod(shape)
    size = count * dtype.itemsize
    length = os.fstat(handle.fileno()).st_size
    if not 0 < count <= MOST_VOXELS:
        raise FileFormatError(
            f"{path} states the shape {tuple(shape)}: {count:.3g} voxels, at most "
            f"{MOST_VOXELS:.3g} are read"
        )
    if size > (INFLATION * length + 1024 if packed else length):
        raise FileFormatError(
            f"{path} is truncated or damaged: its header states {size} bytes of voxels, the file "
            f"has {length} bytes{' compressed' if packed else ''}"
        )
    if dtype.hasobject or dtype.kind not in "iuf":
        raise FileFormatError(f"{path} holds {dtype} voxels: labels are whole numbers")
    array = np.empty(count, dtype)
    view = array.view(np.uint8).data
    at = 0
    while at < size:
        piece = stream.read(min(1 << 22, size - at))
        if not piece:
            raise FileFormatError(
                f"{path} is truncated or damaged: its header states {size} bytes of voxels, the "
                f"file holds {at}"
            )
        view[at : at + len(piece)] = piece
        at += len(piece)
    if stream.read(1):  # ... which also verifies the checksum of a compressed stream
        raise FileFormatError(
            f"{path} is damaged: it goes on after the {size} bytes of voxels that its header states"
        )
    return array.reshape(tuple(shape), order="F")


def _check_dimensions(path: Path_, shape: tuple[int, ...]) -> None:
    """Refuse a series of volumes before its voxels are read."""
    extra = [length for length in shape[3:] if length != 1]
    if len(shape) < 3 or extra:
        raise FileFormatError(
            f"{path} has {len(shape)} dimensions, shape {shape}: a label volume has 3"
        )
