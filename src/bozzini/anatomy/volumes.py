"""Label volumes from files: NIfTI, NRRD, MetaImage, folders of one mask per organ, DICOM series.

nibabel interprets the headers of NIfTI, and SimpleITK reads DICOM. The voxels are read here, since
nibabel does not read a compressed stream to its end, and so misses a wrong checksum.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import re
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import BozziniError, FileFormatError, InputError, UnitError
from ..io.inputs import note_input
from ..units import parse_quantity
from ._dicom import read_dicom, read_segmentation
from ._statements import compare_places, compare_spacing, report_unit
from .files import (
    PathLike,
    check_file,
    explain,
    has_suffix,
    quiet_libraries,
    read_label_table,
    read_number,
)
from .frame import check_frame, compare_affines, find_axis, fit_frame
from .labels import (
    MOST_LISTED,
    Labels,
    Volume,
    Voxels,
    measure_voxel,
    override_frame,
    select_labels,
    tract_from_volume,
    wants_all,
)
from .names import (
    find_organ,
    is_digestive,
    match_name,
    normalise,
    read_json,
    read_sidecar,
)
from .tract import Finding, LabelTract, count_noun, show_volume

if TYPE_CHECKING:
    from nibabel.nifti1 import Nifti1Header

# Volumes from files of one or two pieces: NIfTI, NRRD and MetaImage, every byte accounted for.
#
# No header is believed: the voxels that it states are compared with what the file can hold before
# memory is taken for them, a compressed stream is read to its end so that its checksum is verified,
# and a byte too many is an error like a byte too few.

Compression = Literal["gzip", "zlib"] | None

MOST_VOXELS = 1 << 31
MOST_HEADER_BYTES = 1 << 24
"""Bytes of a header with all its extensions."""

LARGEST_INFLATION = 1040
"""A deflate stream grows at most by this factor (1032 by its format)."""

_NIFTI_UNITS = {0: ("unknown", 1.0), 1: ("meter", 1000.0), 2: ("mm", 1.0), 3: ("micron", 0.001)}
"""Units of length by the lowest three bits of xyzt_units, and each in mm."""

_CODES = {1: "scanner", 2: "aligned", 3: "Talairach", 4: "MNI 152"}
"""What the codes of qform and sform mean."""


def read_nifti(path: PathLike) -> Volume:
    """Read a NIfTI-1 or NIfTI-2 file (.nii, .nii.gz), in its world frame (RAS+) in mm."""
    with _open(path, "NIfTI") as handle:
        compression: Compression = "gzip" if has_suffix(path, (".gz",)) else None
        stream = _inflate(handle, compression)
        header, extensions = _read_nifti_header(stream, path)
        with quiet_libraries():
            unit, scale = _read_nifti_unit(header, path)
            framed = int(header["qform_code"]) > 0 or int(header["sform_code"]) > 0
            affine = np.array(header.get_best_affine(), dtype=np.float64)
            by_code = {name: int(header[f"{name}_code"]) for name in ("qform", "sform")}
            zooms = np.array(header.get_zooms()[:3], dtype=np.float64)
            slope, shift = header.get_slope_inter()
            shape = tuple(int(length) for length in header.get_data_shape())
            dtype = header.get_data_dtype()
        if len(shape) < 3 or any(length != 1 for length in shape[3:]):
            raise FileFormatError(
                f"{path} has {len(shape)} dimensions, shape {shape}: a label volume has 3"
            )
        array = _Layout(path, shape, dtype, compression).read(handle, stream)
    if slope not in (None, 1.0) or shift not in (None, 0.0):
        array = array * np.float32(slope) + np.float32(shift)
    found = report_unit(unit, scale)
    affine[:3] *= scale
    if by_code["sform"] > 0 and by_code["qform"] > 0:
        with quiet_libraries():
            quaternion = _read_qform(header)
        quaternion[:3] *= scale
        names = {name: f"{name} ({_CODES.get(code, code)})" for name, code in by_code.items()}
        what = f"the {names['qform']} and the {names['sform']} of the file"
        found += compare_places(what, affine, quaternion, shape, "RAS", taken="the sform")
    elif by_code["sform"] > 0:
        found += compare_spacing("pixdim", "the sform", affine, scale * zooms, shape)
    if not framed:
        message = (
            "the file states no world frame (qform and sform codes are 0): the origin is the "
            "middle of the volume, left and right are by NIfTI's default"
        )
        found.append(Finding("frame-unknown", "warning", message))
    return Volume(
        array=array,
        affine=affine,
        source=Path(path).name,
        names=read_label_table(extensions.decode("utf-8", "replace")),
        frame="RAS" if framed else None,
        findings=tuple(found),
    )


def _read_nifti_unit(header: Nifti1Header, path: PathLike) -> tuple[str, float]:
    """Return the unit of length, and it in mm."""
    code = int(header["xyzt_units"]) & 7
    if code not in _NIFTI_UNITS:
        raise FileFormatError(
            f"{path} has the unit of length {code}: known are 0 (none), 1 (m), 2 (mm), 3 (micron)"
        )
    return _NIFTI_UNITS[code]


def _check_pixdim(header: Nifti1Header, path: PathLike) -> None:
    """Refuse voxel sizes that are none, where no sform states others; nibabel takes 1 mm for 0."""
    sizes = np.array(header["pixdim"][1:4], dtype=np.float64)
    if int(header["sform_code"]) <= 0 and not (sizes > 0.0).all():
        words = " x ".join(f"{size:g}" for size in sizes)
        raise FileFormatError(
            f"{path} states no voxel size: pixdim is {words}, and there is no sform; each must be "
            "above 0"
        )


def _read_qform(header: Nifti1Header) -> NDArray[np.float64]:
    """Return the qform, NaN where its numbers are none."""
    try:
        return np.array(header.get_qform(), dtype=np.float64)
    except Exception:  # nibabel raises several kinds
        return np.full((4, 4), np.nan)


def _read_nifti_header(stream: BinaryIO, path: PathLike) -> tuple[Nifti1Header, bytes]:
    """Return the header, and the bytes between it and the voxels."""
    from nibabel.nifti1 import Nifti1Header
    from nibabel.nifti2 import Nifti2Header

    start = stream.read(4)
    size = next(
        (n for n in (348, 540) if start in (n.to_bytes(4, "little"), n.to_bytes(4, "big"))), 0
    )
    if not size:
        raise FileFormatError(f"{path} is not a NIfTI volume: its header has no known size")
    block = start + stream.read(size - 4)
    kind: type = Nifti1Header if size == 348 else Nifti2Header
    with quiet_libraries():
        header = kind(block)
        _check_pixdim(kind(block, check=False), path)
    if bytes(header["magic"].tobytes())[:3] not in (b"n+1", b"n+2"):
        raise FileFormatError(f"{path} is not a NIfTI volume: it is not of one file (.nii)")
    offset = float(header["vox_offset"])
    if not (size + 4 <= offset <= MOST_HEADER_BYTES and offset == int(offset)):
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


def read_nrrd(path: PathLike) -> Volume:
    """Read a NRRD file (.nrrd, .nhdr, Slicer's .seg.nrrd), coordinates in its own space.

    A segmentation of several layers comes back with a fourth axis, one entry per layer.
    """
    with _open(path, "NRRD") as handle:
        if not re.fullmatch(rb"NRRD000\d\r?\n", handle.readline(64)):
            raise FileFormatError(f"{path} is not a NRRD volume: it does not begin with NRRD000")
        fields, pairs = _read_nrrd_header(handle, path)
        sizes = _split_numbers(fields, "sizes", path, integer=True)
        _check_count(fields, "dimension", len(sizes), path)
        dtype = _find_type(fields, path)
        encoding = fields.get("encoding", "").lower()
        if encoding not in ("raw", "gzip", "gz"):
            raise FileFormatError(f"{path} has the encoding '{encoding}': known are raw and gzip")
        if fields.get("line skip", "0") != "0":
            raise FileFormatError(f"{path} asks for a line skip: not read")
        spatial, affine, frame, found = _read_nrrd_space(fields, len(sizes), path)
        shape = tuple(int(size) for size in sizes)
        detached = fields.get("data file")
        with _open_data(handle, path, detached) as data:
            packed: Compression = None if encoding == "raw" else "gzip"
            layout = _Layout(path, shape, dtype, packed)
            array = layout.read(data, _skip_bytes(data, fields.get("byte skip", "0"), layout))
    array = np.moveaxis(array, spatial, (0, 1, 2))
    segments = _list_segments(pairs, path)
    return Volume(
        array=array,
        affine=affine,
        source=Path(path).name,
        names={label: name for name, label, _ in segments},
        frame=frame,
        findings=tuple(found),
        segments=segments if array.ndim > 3 and array.shape[3] > 1 else (),
    )


def _skip_bytes(data: BinaryIO, text: str, layout: _Layout) -> BinaryIO:
    """Return the stream of the voxels after so many bytes; after -1 they are the last ones."""
    if not re.fullmatch(r"\d{1,9}" if layout.packed else r"-1|\d{1,9}", text):
        raise FileFormatError(f"{layout.path} is damaged: 'byte skip' is '{text[:60]}'")
    skip = int(text)
    if layout.packed:  # those of what was compressed
        stream = _inflate(data, layout.packed)
        while skip > 0 and (piece := stream.read(min(1 << 22, skip))):
            skip -= len(piece)
        return stream
    begin = data.tell()
    if skip < 0:
        skip = max(os.fstat(data.fileno()).st_size - layout.size - begin, 0)
    data.seek(begin + skip)
    return data


_NRRD_ALIASES = {
    "datafile": "data file", "lineskip": "line skip", "byteskip": "byte skip",
    "axismins": "axis mins", "axismaxs": "axis maxs", "centers": "centerings",
}  # fmt: skip


def _set_field(fields: dict[str, str], key: str, value: str, path: PathLike) -> None:
    """Set a field; refuse one that is stated twice, otherwise than before."""
    if fields.setdefault(key, value) != value:
        raise FileFormatError(
            f"{path} contradicts itself: {key} is '{fields[key][:60]}' and '{value[:60]}'"
        )


def _check_count(fields: dict[str, str], key: str, count: int, path: PathLike) -> None:
    """Refuse a number of dimensions that is not that of the sizes."""
    stated = fields.get(key, str(count))
    if stated != str(count):
        raise FileFormatError(
            f"{path} contradicts itself: {key} is {stated[:60]}, but it has {count} sizes"
        )


def _read_nrrd_header(handle: BinaryIO, path: PathLike) -> tuple[dict[str, str], dict[str, str]]:
    """Return the fields (``key: value``) and the key/value pairs (``key:=value``)."""
    fields: dict[str, str] = {}
    pairs: dict[str, str] = {}
    while line := handle.readline(MOST_HEADER_BYTES):
        text = line.decode("utf-8", "replace").rstrip("\r\n")
        if not text:
            return fields, pairs
        key, sign, value = text.partition(":=")
        if sign:
            _set_field(pairs, key, value, path)
        elif not text.startswith("#"):
            key, sign, value = text.partition(":")
            if not sign:
                raise FileFormatError(f"{path} is not a NRRD volume: header line '{text[:40]}'")
            key = key.strip().lower()
            _set_field(fields, _NRRD_ALIASES.get(key, key), value.strip(), path)
    if "data file" in fields:
        return fields, pairs
    raise FileFormatError(f"{path} is truncated: its NRRD header has no end")


def _find_type(fields: dict[str, str], path: PathLike) -> np.dtype[np.generic]:
    word = fields.get("type", "").lower()
    kind = next((name for name, words in _NRRD_TYPES.items() if word in words), None)
    if kind is None:
        raise FileFormatError(f"{path} holds voxels of type '{word}': not read")
    order = fields.get("endian", "little").lower()
    return np.dtype(kind).newbyteorder(">" if order == "big" else "<")


def _read_nrrd_space(
    fields: dict[str, str], dimension: int, path: PathLike
) -> tuple[list[int], NDArray[np.float64], str | None, list[Finding]]:
    """Return which axes are those of space, the affine, the frame, and what was found."""
    scale, found = _read_nrrd_unit(fields, path)
    affine = np.eye(4)
    sizes = [int(float(word)) for word in fields["sizes"].split()]
    spacings = [read_number(word) for word in fields.get("spacings", "").split()]
    taken = "space directions"
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
        spatial, taken = [0, 1, 2], "spacings"
        spacing = _split_numbers(fields, "spacings", path)
        if len(spacing) != 3:
            raise FileFormatError(f"{path} has {len(spacing)} spacings: a volume has 3")
        affine[:3, :3] = np.diag(spacing)
    affine[:3] *= scale
    size = tuple(sizes[at] for at in spatial)
    for what, stated in (("spacings", spacings), ("axis mins and maxs", _span_nrrd(fields, sizes))):
        if len(stated) == dimension and what != taken:
            each = scale * np.array(stated)[spatial]
            found += compare_spacing(what, taken, affine, each, size)
    frame = _NRRD_SPACES.get(fields.get("space", "").lower())
    if frame is None:
        message = "the file does not state where its axes point in the patient"
        found.append(Finding("frame-unknown", "warning", message))
    return spatial, affine, frame, found


def _read_nrrd_unit(fields: dict[str, str], path: PathLike) -> tuple[float, list[Finding]]:
    """Return the unit of length in mm, and a note where it is another."""
    text = f"{fields.get('space units', '')} {fields.get('units', '')}"
    stated = set(re.findall(r'"([^"]*)"', text)) - {""}
    if len(stated) > 1:
        raise FileFormatError(
            f"{path} states the units {' and '.join(sorted(stated))}: one is read"
        )
    return _scale_unit(stated.pop(), path) if stated else (1.0, [])


def _scale_unit(unit: str, path: PathLike) -> tuple[float, list[Finding]]:
    try:
        scale = parse_quantity(f"1 {unit}", "length")
    except UnitError:
        raise FileFormatError(f"{path} is in '{unit}': it must be a unit of length") from None
    return scale, report_unit(unit, scale)


def _span_nrrd(fields: dict[str, str], sizes: list[int]) -> list[float]:
    """Return the voxel sizes by the ends of the axes, those of cells unless nodes are stated."""
    ends = [fields.get(f"axis {word}", "").split() for word in ("mins", "maxs")]
    centres = fields.get("centerings", "").lower().split()
    if not len(ends[0]) == len(ends[1]) == len(sizes):
        return []
    nodes = [at < len(centres) and centres[at] == "node" for at in range(len(sizes))]
    return [
        (read_number(high) - read_number(low)) / max(size - node, 1)
        for low, high, size, node in zip(*ends, sizes, nodes, strict=True)
    ]


def _list_segments(pairs: dict[str, str], path: PathLike) -> tuple[tuple[str, int, int], ...]:
    """Return name, label and layer of each segment of a Slicer segmentation."""
    found: list[tuple[str, int, int]] = []
    for number in range(MOST_HEADER_BYTES):
        name = pairs.get(f"Segment{number}_Name", pairs.get(f"Segment{number}_ID"))
        if name is None:
            break
        try:
            label = int(pairs.get(f"Segment{number}_LabelValue", number + 1))
            layer = int(pairs.get(f"Segment{number}_Layer", 0))
        except ValueError:
            continue
        if label > 0 and layer >= 0:
            same = [other for other, *place in found if place == [label, layer]]
            if same:
                raise FileFormatError(
                    f"{path} has label {label} for two segments, {same[0]} and {name.strip()}: "
                    "each must have its own"
                )
            found.append((name.strip(), label, layer))
    return tuple(found)


_META_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4",
    "MET_UINT": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip


def read_metaimage(path: PathLike) -> Volume:
    """Read a MetaImage (.mha, .mhd), in its world frame, which is LPS, in mm."""
    with _open(path, "MetaImage") as handle:
        fields: dict[str, str] = {}
        while "elementdatafile" not in fields:
            line = handle.readline(MOST_HEADER_BYTES)
            key, sign, value = line.decode("utf-8", "replace").partition("=")
            if not sign:
                raise FileFormatError(f"{path} is not a MetaImage volume: no ElementDataFile")
            _set_field(fields, key.strip().lower(), value.strip(), path)
        shape = tuple(int(v) for v in _split_numbers(fields, "dimsize", path, integer=True))
        if fields.get("elementnumberofchannels", "1") != "1" or len(shape) != 3:
            raise FileFormatError(f"{path} has the shape {shape}: a label volume has 3 dimensions")
        _check_count(fields, "ndims", len(shape), path)
        kind = fields.get("elementtype", "").upper()
        if kind not in _META_TYPES:
            raise FileFormatError(f"{path} holds voxels of type '{kind}': not read")
        if fields.get("headersize", "0") != "0" or fields.get("binarydata", "True") != "True":
            raise FileFormatError(
                f"{path} is a MetaImage of text or with a header to skip: not read"
            )
        orders = {
            word: fields[word].lower() == "true"
            for word in ("binarydatabyteordermsb", "elementbyteordermsb")
            if word in fields
        }
        if len(set(orders.values())) > 1:
            words = " and ".join(f"{word} is {fields[word]}" for word in orders)
            raise FileFormatError(f"{path} contradicts itself: {words}")
        dtype = np.dtype(_META_TYPES[kind]).newbyteorder(">" if any(orders.values()) else "<")
        spacing = _split_numbers(fields, "elementspacing", path)
        packed: Compression = "zlib" if fields.get("compresseddata") == "True" else None
        name = fields["elementdatafile"]
        with _open_data(handle, path, None if name == "LOCAL" else name) as data:
            array = _Layout(path, shape, dtype, packed).read(data)
    turn = _find_synonym(fields, ("transformmatrix", "orientation", "rotation"), path)
    turn = np.eye(3).ravel() if turn is None else turn
    origin = _find_synonym(fields, ("offset", "position", "origin"), path)
    origin = np.zeros(3) if origin is None else origin
    if len(spacing) != 3 or len(turn) != 9 or len(origin) != 3:
        raise FileFormatError(f"{path} is damaged: spacing, axes or offset are not those of 3-D")
    unit = fields.get("distanceunits", "?")
    scale, found = (1.0, []) if unit in ("?", "") else _scale_unit(unit, path)
    axes = np.reshape(turn, (3, 3)).T  # a line of the matrix is an axis
    lengths = np.linalg.norm(axes, axis=0)
    if not (lengths > 0.0).all():
        raise FileFormatError(f"{path} is damaged: an axis of its TransformMatrix is 0")
    affine = np.eye(4)
    affine[:3, :3] = axes / lengths * spacing * scale
    affine[:3, 3] = origin * scale
    what = "TransformMatrix times ElementSpacing"
    found += compare_spacing(what, "ElementSpacing", affine, lengths * spacing * scale, shape)
    found += _compare_anatomy(fields.get("anatomicalorientation", ""), affine, shape)
    if "elementsize" in fields:
        size = _split_numbers(fields, "elementsize", path)
        if size.shape == (3,):
            found += compare_spacing("ElementSize", "ElementSpacing", affine, scale * size, shape)
    name = Path(path).name
    return Volume(array=array, affine=affine, source=name, frame="LPS", findings=tuple(found))


def _find_synonym(
    fields: dict[str, str], words: tuple[str, ...], path: PathLike
) -> NDArray[np.float64] | None:
    """Return the numbers of a field of several names; refuse names that disagree."""
    values = {word: _split_numbers(fields, word, path) for word in words if word in fields}
    first = next(iter(values.values()), None)
    for word, other in values.items():
        if first is not None and (other.shape != first.shape or not np.allclose(other, first)):
            raise FileFormatError(
                f"{path} contradicts itself: {next(iter(values))} is "
                f"'{fields[next(iter(values))]}', {word} is '{fields[word]}'"
            )
    return first


def _compare_anatomy(
    stated: str, affine: NDArray[np.float64], shape: tuple[int, ...]
) -> list[Finding]:
    """Compare a MetaImage's letters, from where each axis comes, with its matrix."""
    try:
        come = check_frame(stated)
        near = np.rint(fit_frame(affine)[0])
        axes = np.stack([-find_axis("LPS", letter) for letter in come], axis=1)
    except (InputError, np.linalg.LinAlgError):
        return []  # '???' states nothing; a singular matrix is refused later
    sizes = np.linalg.norm(affine[:3, :3], axis=0)
    one, other = affine.copy(), affine.copy()
    one[:3, :3], other[:3, :3] = near * sizes, axes * sizes
    what = f"AnatomicalOrientation {come} and TransformMatrix"
    return compare_places(what, one, other, shape, "LPS", taken="TransformMatrix")


def _split_numbers(
    fields: dict[str, str], key: str, path: PathLike, *, integer: bool = False
) -> NDArray[np.float64]:
    values = _read_floats(fields.get(key, "").split())
    if not len(values) or (integer and ((values < 1) | (values != np.rint(values))).any()):
        raise FileFormatError(f"{path} is damaged: '{key}' is '{fields.get(key, '')[:60]}'")
    return values


def _split_vector(text: str, path: PathLike) -> NDArray[np.float64]:
    values = _read_floats(text.strip("() ").split(","))
    if values.shape != (3,):
        raise FileFormatError(f"{path} is damaged: '{text[:60]}' is not a vector of 3 numbers")
    return values


def _read_floats(words: list[str]) -> NDArray[np.float64]:
    """Return words as finite numbers, none where one is not."""
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        return np.zeros(0)
    return values if np.isfinite(values).all() else np.zeros(0)


@contextmanager
def _open(path: PathLike, kind: str) -> Iterator[BinaryIO]:
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
def _open_data(handle: BinaryIO, path: PathLike, detached: str | None) -> Iterator[BinaryIO]:
    """Give the file that holds the voxels: this one, or another in the same folder."""
    if detached is None:
        yield handle
        return
    other = Path(path).parent / detached
    if detached.upper().startswith("LIST") or "%" in detached or other.parent != Path(path).parent:
        raise FileFormatError(
            f"{path} has its voxels in '{detached}': only one file beside it is read"
        )
    if not os.path.isfile(other):
        raise FileFormatError(f"{path} has its voxels in '{detached}', which is not beside it")
    note_input(other)
    with other.open("rb") as data:
        yield data


@dataclass(frozen=True)
class _Layout:
    """How voxels lie in a file: their shape, type, and compression."""

    path: PathLike
    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    packed: Compression

    @property
    def size(self) -> int:
        """Bytes of all voxels."""
        return math.prod(self.shape) * self.dtype.itemsize

    def read(self, handle: BinaryIO, stream: BinaryIO | None = None) -> Voxels:
        """Return the voxels, first axis fastest, after which the file must end."""
        path, size, count = self.path, self.size, math.prod(self.shape)
        length = os.fstat(handle.fileno()).st_size
        if not 0 < count <= MOST_VOXELS:
            raise FileFormatError(
                f"{path} states the shape {self.shape}: {count:.3g} voxels, at most "
                f"{MOST_VOXELS:.3g} are read"
            )
        if size > (LARGEST_INFLATION * length + 1024 if self.packed else length):
            raise FileFormatError(
                f"{path} is truncated or damaged: its header states {size} bytes of voxels, the "
                f"file has {length} bytes{' compressed' if self.packed else ''}"
            )
        if self.dtype.hasobject or self.dtype.kind not in "iuf":
            raise FileFormatError(f"{path} holds {self.dtype} voxels: labels are whole numbers")
        stream = _inflate(handle, self.packed, size) if stream is None else stream
        array = np.empty(count, self.dtype)
        view = array.view(np.uint8).data
        at = 0
        while at < size:
            piece = stream.read(min(1 << 22, size - at))
            if not piece:
                raise FileFormatError(
                    f"{path} is truncated or damaged: its header states {size} bytes of voxels, "
                    f"the file holds {at}"
                )
            view[at : at + len(piece)] = piece
            at += len(piece)
        if stream.read(1):  # ... which also verifies the checksum of a compressed stream
            raise FileFormatError(
                f"{path} is damaged: it goes on after the {size} bytes of voxels that its header "
                f"states"
            )
        return array.reshape(self.shape, order="F")


def _inflate(handle: BinaryIO, compression: Compression, size: int = 0) -> BinaryIO:
    """Return a stream of the bytes that follow; one of zlib holds at most `size` and one more."""
    if compression == "gzip":
        return gzip.GzipFile(fileobj=handle, mode="rb")  # type: ignore[return-value]
    if compression is None:
        return handle
    inflater = zlib.decompressobj(47)  # the header states whether it is zlib or gzip
    data = inflater.decompress(handle.read(), size + 1)
    if not inflater.eof or inflater.unused_data:
        raise EOFError("the compressed stream does not end where the file does")
    return io.BytesIO(data)


_READERS: dict[tuple[str, ...], Callable[[PathLike], Volume]] = {
    (".nii", ".nii.gz"): read_nifti,
    (".nrrd", ".nhdr"): read_nrrd,
    (".mha", ".mhd"): read_metaimage,
}

LABEL_SUFFIXES = tuple(suffix for suffixes in _READERS for suffix in suffixes)

_SEVERAL = ("labels-left-out", "label-dropped")
"""Findings that say that a volume has several labels."""

SAME_PLACE_MM = 1e-3
"""Largest difference of the places of two masks' voxels [mm]."""


def is_volume(path: PathLike) -> bool:
    """Whether a path is one that `read_labels` takes: by its suffix, or a folder."""
    return has_suffix(path, (*LABEL_SUFFIXES, ".dcm")) or os.path.isdir(path)


def read_labels(
    path: PathLike,
    *,
    labels: Labels | None = None,
    frame: str | None = None,
) -> LabelTract:
    """Read a lumen from a label volume, in the file's own world frame in mm.

    Parameters
    ----------
    path : path-like
        A ``.nii``, ``.nii.gz``, ``.nrrd``, ``.nhdr``, ``.mha`` or ``.mhd`` file, a DICOM
        segmentation (``.dcm``), or a folder of such files, one mask per organ, named by it.
    labels : sequence of int or str, optional
        The labels that make up the lumen, by number or by name (small and capital letters are
        alike), or ``"all"``. A name is that of the file, or for a file of TotalSegmentator
        without names such as ``"totalsegmentator-v1:colon"``. None takes the only label there is.
    frame : str, optional
        Where the world axes point in the patient, such as ``"LPS"``, instead of what the file
        states. Coordinates are not changed.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, truncated, damaged (a checksum disagrees, bytes are missing
        or left over) or of another kind.
    InputError, GeometryError
        As `tract_from_labels` does.
    """
    if os.path.isdir(path) and (masks := _list_masks(Path(path))):
        volume = _read_masks(Path(path), masks, labels)
        labels = "all"
    else:
        volume = read_volume(path)
        if volume.segments:
            volume = _merge_segments(volume, labels)
            labels = "all"
    volume = override_frame(volume, frame)
    tract = tract_from_volume(volume, labels=labels)
    stem = Path(path).name.split(".")[0]
    organ = None if tract.label_names or len(tract.label_values) > 1 else find_organ([stem])
    if organ is not None and not any(item.code in _SEVERAL for item in tract.findings):
        # The file has one label, and is named after it.
        return replace(tract, label_names={tract.label_values[0]: stem}, organ=organ)
    return tract


def read_volume(path: PathLike) -> Volume:
    """Read a volume, labels or image, from a file or a folder with a DICOM series.

    Raises
    ------
    FileFormatError
        As `read_labels` does.
    MissingExtraError
        If it is DICOM, and SimpleITK or highdicom is not installed.
    """
    if os.path.isdir(path):
        return read_dicom(Path(path), LABEL_SUFFIXES)
    check_file(path)
    for suffixes, reader in _READERS.items():
        if has_suffix(path, suffixes):
            return _add_sidecar(Path(path), reader(path))
    if has_suffix(path, (".dcm",)):
        return read_segmentation(Path(path))
    raise FileFormatError(f"{path} is not named {', '.join(LABEL_SUFFIXES)}")


def find_sidecars(path: PathLike) -> tuple[dict[int, str], list[Path]]:
    """Return the names of labels that files beside a volume state, and these files."""
    file = Path(path)
    suffixes = [suffix for suffix in LABEL_SUFFIXES if file.name.lower().endswith(suffix)]
    return read_sidecar(file, max(suffixes, key=len)) if suffixes else ({}, [])


def _add_sidecar(path: Path, volume: Volume) -> Volume:
    """Compare a volume with what files beside it state, and take the names that it lacks."""
    names, files = find_sidecars(path)
    found = list(volume.findings)
    differ = [
        f"label {label} is {volume.names[label]} and {name}"
        for label, name in sorted(names.items())
        if label in volume.names and normalise(volume.names[label]) != normalise(name)
    ]
    if differ:
        message = (
            f"{volume.source} and {files[0].name} beside it give other names: "
            f"{', '.join(differ[:MOST_LISTED])}; those of {volume.source} are taken"
        )
        found.append(Finding("names-differ", "warning", message))
    elif files and not volume.names:
        message = f"names of labels read from {', '.join(file.name for file in files)}"
        found.append(Finding("names-read", "note", message))
    if volume.names:
        names = {}
    suffix = max((s for s in LABEL_SUFFIXES if path.name.lower().endswith(s)), key=len)
    notes = path.with_name(f"{path.name[: -len(suffix)]}.json")
    step = read_json(notes).get("SpacingBetweenSlices")
    if isinstance(step, (int, float)) and step > 0:
        sizes = np.linalg.norm(volume.affine[:3, :3], axis=0)
        stated = np.array([sizes[0], sizes[1], float(step)])
        what = f"SpacingBetweenSlices of {notes.name}"
        found += compare_spacing(
            what, "the volume's header", volume.affine, stated, volume.array.shape
        )
    return replace(volume, names={**names, **volume.names}, findings=tuple(found))


def _list_masks(folder: Path) -> dict[str, Path]:
    """Return the volumes in a folder by their names without suffix."""
    found = {}
    for file in sorted(folder.iterdir()):
        suffix = max(
            (s for s in LABEL_SUFFIXES if file.name.lower().endswith(s)), key=len, default=""
        )
        if suffix and file.is_file() and not file.name.startswith("."):
            found[file.name[: -len(suffix)]] = file
    return found


def _read_masks(folder: Path, masks: dict[str, Path], labels: Labels | None) -> Volume:
    """Join the masks that are asked for into one volume, numbered in the order of their names."""
    names = list(masks)
    if labels is None and len(names) > 1:
        shown = [name for name in names if is_digestive(name)] or names
        listed = [f"{name} ({_measure_mask(masks[name])})" for name in shown[:MOST_LISTED]]
        raise InputError(
            f"{folder} has {len(names)} masks: choose those that are lumen by name (--labels), or "
            f"all of them (--labels all): {_list_some(listed, len(names))}"
        )
    wanted = names if labels is None or wants_all(labels) else _find_masks(folder, names, labels)
    volumes = (read_volume(masks[name]) for name in wanted)
    joined = next(volumes, None)
    if joined is None:
        raise InputError("no labels were given: name at least one, or 'all'")
    array = np.zeros(joined.array.shape[:3], dtype=np.uint16, order="F")
    found: list[Finding] = []
    for name, volume in zip(wanted, (joined, *volumes), strict=True):
        _check_same_grid(joined, volume, folder)
        found += volume.findings
        mask = volume.array.reshape(array.shape, order="F") != 0
        np.copyto(array, np.uint16(names.index(name) + 1), where=mask & (array == 0))
    findings = tuple(dict.fromkeys(found))
    left = len(names) - len(wanted)
    if left:
        what = ("other mask of the folder is", "other masks of the folder are")
        message = f"{count_noun(left, *what)} not compared"
        findings += (Finding("masks-left-out", "note", message),)
    return replace(
        joined,
        array=array,
        source=folder.name,
        names={number: name for number, name in enumerate(names, start=1) if name in wanted},
        findings=findings,
    )


def _find_masks(folder: Path, names: list[str], labels: Labels) -> list[str]:
    wanted: list[str] = []
    for label in [labels] if isinstance(labels, str) else labels:
        same = match_name(str(label), names, str(folder))
        if not same:
            shown = sorted(names, key=lambda name: not is_digestive(name))[:MOST_LISTED]
            raise InputError(
                f"{folder} has no mask named '{label}': it has {_list_some(shown, len(names))}"
            )
        wanted += same
    return list(dict.fromkeys(wanted))


def _list_some(shown: list[str], number: int) -> str:
    """Return items as text, and how many of `number` are not shown."""
    return ", ".join(shown) + (f" and {number - len(shown)} more" if number > len(shown) else "")


def _measure_mask(path: Path) -> str:
    volume = read_volume(path)
    return show_volume(np.count_nonzero(volume.array) * measure_voxel(volume.affine))


def _check_same_grid(one: Volume, other: Volume, folder: Path) -> None:
    if one.frame != other.frame and None not in (one.frame, other.frame):
        raise FileFormatError(
            f"{folder}: {one.source} has the frame {one.frame}, {other.source} {other.frame}"
        )
    apart = compare_affines(one.affine, other.affine, one.array.shape).farthest
    if other.array.shape[:3] != one.array.shape[:3] or apart > SAME_PLACE_MM:
        raise FileFormatError(
            f"{folder}: {one.source} and {other.source} do not have the same voxels: shapes "
            f"{one.array.shape} and {other.array.shape}, up to {apart:.3g} mm apart"
        )


def _merge_segments(volume: Volume, labels: Labels | None) -> Volume:
    """Select segments of a layered segmentation, which may overlap, into one volume of labels.

    Segments are numbered from 1 in the order of the file. Where one that is not selected lies
    mostly inside the selection (a polyp), it is taken out of it.
    """
    masks = []
    for name, label, layer in volume.segments:
        if layer >= volume.array.shape[3]:
            raise FileFormatError(
                f"{volume.source} states layer {layer} for segment {name}, but has "
                f"{volume.array.shape[3]}"
            )
        masks.append(volume.array[..., layer] == label)
    names = {number: name for number, (name, _, _) in enumerate(volume.segments, start=1)}
    sizes = np.array([0, *(int(np.count_nonzero(mask)) for mask in masks)], dtype=np.int64)
    voxel = measure_voxel(volume.affine)
    wanted = select_labels(sizes, labels, names, volume.source, voxel)
    array = np.zeros(volume.array.shape[:3], dtype=np.uint16, order="F")
    for number in wanted:
        np.copyto(array, np.uint16(number), where=masks[number - 1] & (array == 0))
    findings = list(volume.findings)
    lumen = array != 0
    for number, mask in enumerate(masks, start=1):
        overlap = 0 if number in wanted else int(np.count_nonzero(mask & lumen))
        if overlap == 0:
            continue
        inside = overlap > 0.5 * sizes[number]
        message = (
            f"segment {names[number]} is not selected and shares {show_volume(overlap * voxel)} "
            f"with the lumen: {'taken as wall' if inside else 'left in the lumen'}"
        )
        findings.append(Finding("segment-overlap", "warning" if inside else "note", message))
        if inside:
            array[mask] = 0
    chosen = {number: names[number] for number in wanted}
    return replace(volume, array=array, names=chosen, findings=tuple(findings), segments=())
