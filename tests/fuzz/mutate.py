"""Damage to files and to values, all from one generator of random numbers."""

from __future__ import annotations

import gzip
import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

NUMBERS = [
    "0", "-0", "-1", "1", "2", "0.5", "1e-300", "1e-9", "1e9", "1e30", "1e308", "-1e308", "1e999",
    "nan", "NaN", "inf", "-inf", "0x10", "1_000", "1,5", "१", "999999999999999999999", "-7",
    "65536", "2147483648", "9223372036854775808", "", " ", ".", "-", "--", "1e", "True", "null",
]  # fmt: skip
UNITS = [
    "mm", "cm", "m", "um", "nm", "in", "km", "parsec", "lightyear", "deg", "rad", "turn", "N", "kN",
    "gf", "psi", "kPa", "MPa", "s", "N/mm", "Nmm", "Nmm^2", "mm^2", "foobar", "%", "°", "µm", "K",
]  # fmt: skip
WORDS = [
    "", " ", "-", "--", "/", ".", "..", "a b", "é", "日本", "\udcff", "a\nb", "'", '"', "`", "${x}",
    "%s", "{}", "[]", "null", "None", "True", "nan", "x" * 300, "x" * 5000, "\u202e", "\x01", "1:2",
    "=", "a=", "=a", "a=1=2", "0:1:2:3", ",", ",,", ":", "::", "energy", "thesis", "largest",
]  # fmt: skip
LENGTHS = [
    "1e308mm", "5parsec", "1nm", "-5mm", "nanmm", "99mm", "1e9mm", "1e6mm", "0mm", "0.001mm",
    "0.1mm", "1mm", "3mm", "5mm", "9mm", "30mm", "200mm", "1km", "1um", "5 psi", "5,0mm",
]  # fmt: skip


UNIT_WORDS = [
    "in %", "in mm", "in kPa", "in", "at", "a", "h", "min", "mPa", "MPa", "psig", "barg", "bar(g)",
    "kPa gauge", "psia", "kPa abs", "PSI", "Bar", "N/mm2", "kg/cm2", "lbs", "Newtons", "mm/mm",
    "in mm/mm", "% of length", "mm mm", "1/mm", "mm at end", "kg", "g", "deg", "%", "-", "1", "x",
]  # fmt: skip
UNTITLED = "untitled"
"""The damage that takes the title from a column of numbers: no command may go on without it."""


def make_number(rng: random.Random) -> str:
    """Return a number, or what is near one."""
    if rng.random() < 0.5:
        return rng.choice(NUMBERS)
    return f"{rng.choice([-1, 1]) * 10 ** rng.uniform(-6, 9):.{rng.randint(1, 9)}g}"


def make_value(rng: random.Random, unit: str = "") -> str:
    """Return a value for an option whose own unit is `unit`."""
    kind = rng.random()
    if kind < 0.35 and unit == "mm":
        return rng.choice(LENGTHS)
    if kind < 0.5:
        return f"{10 ** rng.uniform(-2, 3):.4g}{unit}"
    if kind < 0.65:
        return f"{rng.choice([-1, 1]) * 10 ** rng.uniform(-9, 9):.4g}{unit}"
    if kind < 0.75:
        return make_number(rng) + unit
    if kind < 0.85:
        return make_number(rng) + rng.choice(UNITS)
    if kind < 0.9:
        return ",".join(make_value(rng, unit) for _ in range(rng.randint(2, 4)))
    return rng.choice(WORDS)


def damage(path: Path, rng: random.Random) -> str:
    """Damage one file in place in a way that suits it, and say how."""
    ways: list[Callable[[bytes, random.Random], bytes]] = [_bytes, _bytes, _replace]
    content = path.read_bytes()
    name = path.name
    if name.endswith((".yaml", ".json")):
        ways += [_text, _text, _tree, _tree, _tree, _scale, _scale, _scale, _nest]
    elif name.endswith((".csv", ".obj")) or content[:5] in (b"# vtk", b"solid"):
        ways += [_text] * 4 + [_scale] * 2
        ways += [_units, _row_of_units, _swap, _gaps, _untitled] if name.endswith(".csv") else []
    elif name.endswith(".nii.gz"):
        ways += [_unzipped, _nifti, _nifti, _nifti, _contradict_zipped]
    elif name.endswith(".nii"):
        ways += [_nifti_plain, _nifti_plain, _contradict]
    elif name.endswith(".stl"):
        ways += [_stl] * 4
    elif name.endswith(".npz"):
        ways += [*[_arrays] * 5, _nest_in_array]
    way = rng.choice(ways)
    try:
        changed = way(content, rng)
    except (ValueError, IndexError, struct.error, zlib.error, zipfile.BadZipFile, yaml.YAMLError):
        way, changed = _bytes, _bytes(content, rng)
    path.write_bytes(changed)
    return f"{name}: {way.__name__.strip('_')}"


def _bytes(content: bytes, rng: random.Random) -> bytes:
    """Flip bits, cut, double, swap or overwrite."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 8, 50])):
        if not data:
            break
        at = rng.randrange(len(data))
        size = rng.choice([1, 4, 16, 256])
        kind = rng.randrange(6)
        if kind <= 1:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 2:
            data[at : at + size] = rng.randbytes(size)
        elif kind == 3:
            data[at : at + size] = rng.choice([b"\0", b"\xff"]) * size
        elif kind == 4:
            data[at:at] = data[at : at + size]
        else:
            del data[at : at + size]
    return bytes(data)


def _replace(content: bytes, rng: random.Random) -> bytes:
    """Put something else in its place: nothing, a part, noise, another format."""
    kind = rng.randrange(6)
    if kind == 0:
        return b""
    if kind <= 2:
        return content[: rng.randrange(max(len(content), 1))]
    if kind == 3:
        return rng.randbytes(rng.choice([1, 100, 10_000]))
    if kind == 4:
        return b"\0" * len(content)
    return rng.choice([b"{}", b"[]", b"null", b"a: &x [*x]", b"\xff\xfe", b"PK\3\4", b"\x1f\x8b"])


def _text(content: bytes, rng: random.Random) -> bytes:
    """Change numbers, words and lines."""
    text = content.decode("utf-8", "surrogateescape")
    for _ in range(rng.choice([1, 1, 2, 5])):
        kind = rng.randrange(5)
        if kind <= 2:
            form = r"[-+0-9.eE]*[0-9]" if kind < 2 else r"\w+"
            found = list(re.finditer(form, text))
            if not found:
                continue
            match = rng.choice(found)
            word = make_number(rng) if kind < 2 else rng.choice(WORDS)
            text = text[: match.start()] + word + text[match.end() :]
        else:
            lines = text.splitlines(keepends=True)
            if not lines:
                continue
            at = rng.randrange(len(lines))
            if kind == 3:
                del lines[at]
            else:
                lines.insert(rng.randrange(len(lines)), lines[at])
            text = "".join(lines)
    return text.encode("utf-8", "surrogateescape")


def _scale(content: bytes, rng: random.Random) -> bytes:
    """Multiply a few numbers, units kept: most are legal still, and odd."""
    text = content.decode("utf-8", "surrogateescape")
    for _ in range(rng.choice([1, 1, 2, 4])):
        found = list(re.finditer(r"(?<![\w.])-?[0-9]+\.?[0-9]*(?![\w.])", text))
        match = rng.choice(found)
        factor = rng.choice([-1.0, 0.0, 0.5, 0.9, 1.1, 2.0, 10.0 ** rng.uniform(-6.0, 6.0)])
        text = f"{text[: match.start()]}{float(match.group()) * factor:.6g}{text[match.end() :]}"
    return text.encode("utf-8", "surrogateescape")


def _read_table(content: bytes) -> list[list[str]]:
    text = content.decode("utf-8", "surrogateescape")
    return [line.split(",") for line in text.splitlines()]


def _write_table(rows: list[list[str]]) -> bytes:
    text = "".join(",".join(row) + "\n" for row in rows)
    return text.encode("utf-8", "surrogateescape")


def _units(content: bytes, rng: random.Random) -> bytes:
    """Give titles other units, and words that could be taken for units."""
    head, *rows = _read_table(content)
    for _ in range(rng.choice([1, 1, 2, len(head)])):
        at, word = rng.randrange(len(head)), rng.choice([*UNIT_WORDS, *UNITS])
        stem = re.sub(r"\s*[\[(].*|_(mm|kpa|MPa|s)$", "", head[at])
        head[at] = stem + rng.choice([f" [{word}]", f" ({word})", f" (in {word})", f"_{word}", ""])
    return _write_table([head, *rows])


def _row_of_units(content: bytes, rng: random.Random) -> bytes:
    """Put a row of units under the titles, which mostly lose theirs."""
    head, *rows = _read_table(content)
    found = [re.search(r"[\[(](.*)[\])]|_(mm|MPa|s)$", title) for title in head]
    units = [(match[1] or match[2]) if match else "" for match in found]
    if rng.random() < 0.8:
        head = [re.sub(r"\s*[\[(].*|_(mm|MPa|s)$", "", title) for title in head]
    if rng.random() < 0.5:
        units[rng.randrange(len(units))] = rng.choice(UNIT_WORDS)
    form = rng.choice(["({})", "[{}]", "{}"])
    return _write_table([head, [form.format(unit) if unit else "" for unit in units], *rows])


def _swap(content: bytes, rng: random.Random) -> bytes:
    """Swap titles between columns."""
    head, *rows = _read_table(content)
    one, two = rng.randrange(len(head)), rng.randrange(len(head))
    head[one], head[two] = head[two], head[one]
    return _write_table([head, *rows])


def _gaps(content: bytes, rng: random.Random) -> bytes:
    """Empty cells, rows, columns and titles, and cells at the ends of rows."""
    rows = _read_table(content)
    for _ in range(rng.choice([1, 1, 2, 4])):
        row, kind = rng.choice(rows), rng.randrange(5)
        at = rng.randrange(len(row)) if row else 0
        if kind == 0 and row:
            row[at] = rng.choice(["", " ", "nan", "NaN", "-", "None"])
        elif kind == 1:
            row[:] = [""] * len(row)
        elif kind == 2:
            for other in rows[rng.choice([0, 1]) :]:
                other[at : at + 1] = [""]
        elif kind == 3:
            for other in rows:
                other.append("")
        else:
            row.append(rng.choice(["", "7"]))
    return _write_table(rows)


def _untitled(content: bytes, rng: random.Random) -> bytes:
    """Take the title from a column of numbers."""
    head, *rows = _read_table(content)
    cells = list(zip(*rows, strict=True))
    columns = [k for k, own in enumerate(cells) if all(re.fullmatch(r"-?[0-9.]+", c) for c in own)]
    head[rng.choice(columns)] = rng.choice(["", " "])
    return _write_table([head, *rows])


def repeat_option(words: list[str], flag: str, rng: random.Random, unit: str) -> bool:
    """Give an option once more; return whether it has two values then that differ."""
    given = [words[k + 1] for k in range(len(words) - 1) if words[k] == flag]
    given += [word.partition("=")[2] for word in words if word.startswith(f"{flag}=")]
    more = rng.choice([*given, make_value(rng, unit)])
    words += rng.choice([[flag, more], [f"{flag}={more}"]])
    return any(value != more for value in given)


def _tree(content: bytes, rng: random.Random) -> bytes:
    """Change nodes of a YAML or JSON tree to another type or value, or remove them."""
    tree = yaml.safe_load(content)
    for _ in range(rng.choice([1, 1, 2, 4])):
        places = list(_find_places(tree))
        if not places:
            break
        holder, key = rng.choice(places)
        kind = rng.randrange(8)
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, dict):
            holder[rng.choice(WORDS)] = holder[key]
        elif kind == 2:
            holder[key] = [holder[key]] * rng.choice([0, 1, 2, 3])
        elif kind == 3:
            holder[key] = {"x": holder[key]}
        else:
            values: list[Any] = [
                None, True, 0, -1, 1e308, float("nan"), float("inf"), 10**400, "", "nan", [], {},
                make_value(rng, "mm"), make_number(rng), rng.choice(WORDS), 1e-300, 3, 0.5,
                *[rng.uniform(-100.0, 100.0)] * 6,
            ]  # fmt: skip
            holder[key] = rng.choice(values)
    return yaml.safe_dump(tree, allow_unicode=False).encode()


def _find_places(tree: Any) -> Any:
    keys = tree.keys() if isinstance(tree, dict) else range(len(tree))
    for key in list(keys):
        yield tree, key
        if isinstance(tree[key], (dict, list)):
            yield from _find_places(tree[key])


def _nest(content: bytes, rng: random.Random) -> bytes:
    """Put a node of a YAML or JSON tree into many lists or objects; the result is both."""
    tree = yaml.safe_load(content)
    places = list(_find_places(tree))
    if not places:
        raise ValueError("nothing to nest")
    holder, key = rng.choice(places)
    depth = rng.choice([1, 10, 40, 60, 300, 900, 3000])
    before, after = rng.choice([("[", "]"), ('{"x": ', "}"), ('[{"x": ', "}]")])
    inside = json.dumps(holder[key], default=str)
    holder[key] = mark = "the node"
    text = json.dumps(tree, default=str)
    return text.replace(json.dumps(mark), before * depth + inside + after * depth, 1).encode()


def _nest_in_array(content: bytes, rng: random.Random) -> bytes:
    """Do the same to the JSON in an array of an .npz file."""
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        arrays = dict(file.items())
    name = rng.choice([name for name, array in arrays.items() if array.dtype.kind == "U"])
    arrays[name] = np.array(_nest(str(arrays[name]).encode(), rng).decode())
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _contradict_zipped(content: bytes, rng: random.Random) -> bytes:
    return gzip.compress(_contradict(gzip.decompress(content), rng), mtime=0)


def _contradict(content: bytes, rng: random.Random) -> bytes:
    """Let the header of a NIfTI file say two things, each of them legal by itself.

    Its two places of the grid (qform, sform), its spacing and its unit can each be another.
    """
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 3])):
        kind = rng.randrange(5)
        if kind == 0:  # another spacing than the sform's columns have
            struct.pack_into("<f", data, 80 + 4 * rng.randrange(3), rng.choice([0.5, 2, 3.7, 1000]))
        elif kind == 1:  # a qform beside the sform: turned, moved, mirrored
            quaternion = [rng.choice([0.0, 0.5, 0.70710678, rng.uniform(-0.5, 0.5)]), 0.0, 0.0]
            rng.shuffle(quaternion)
            offset = [rng.choice([0.0, rng.gauss(0.0, 100.0)]) for _ in range(3)]
            struct.pack_into("<f", data, 76, rng.choice([1.0, -1.0, 0.0]))
            struct.pack_into("<6f", data, 256, *quaternion, *offset)
        elif kind == 2:  # an sform whose axes are swapped, skew or mirrored
            rows = np.frombuffer(bytes(data[280:328]), dtype="<f4").reshape(3, 4).copy()
            rows = rows[rng.sample(range(3), 3)] * np.float32(rng.choice([1.0, -1.0, 0.1]))
            rows[0, 1] += np.float32(rng.choice([0.0, 0.3, 2.0]))
            data[280:328] = rows.tobytes()
        elif kind == 3:
            data[123] = rng.choice([0, 1, 2, 3, 10, 8 + 1, 16 + 3])  # m, mm, um, with and without s
        struct.pack_into("<2h", data, 252, *rng.choice([(1, 1), (1, 2), (2, 0), (0, 1), (0, 0)]))
    return bytes(data)


def _unzipped(content: bytes, rng: random.Random) -> bytes:
    return gzip.compress(_bytes(gzip.decompress(content), rng), mtime=0)


def _nifti(content: bytes, rng: random.Random) -> bytes:
    return gzip.compress(_nifti_plain(gzip.decompress(content), rng), mtime=0)


_FIELDS = {
    "h": [40, 42, 44, 46, 48, 70, 72, 252, 254],  # dim, datatype, bitpix, qform and sform codes
    "f": [76, 80, 84, 88, 108, 112, 116, 256, 260, 264, 268, 272, 280, 284, 296, 300, 320, 324],
    "b": [0, 39, 123, 344, 345],  # size, dim_info, units, magic
}


def _nifti_plain(content: bytes, rng: random.Random) -> bytes:
    """Change a field of the header, or voxels."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 2, 3])):
        form = rng.choice("hfffbv")
        if form == "v":
            at = rng.randrange(352, len(data))
            value = rng.choice([0, 1, 2, 255])
            size = rng.choice([1, 100, 5000])
            data[at : at + size] = bytes([value]) * len(data[at : at + size])
            continue
        at = rng.choice(_FIELDS[form])
        if form == "f":
            numbers = [0.0, -1.0, 1e-30, 1e30, np.nan, np.inf, -np.inf, 1e-3, 1e3, rng.gauss(0, 5)]
            struct.pack_into("<f", data, at, rng.choice(numbers))
        elif form == "h":
            struct.pack_into("<h", data, at, rng.choice([0, -1, 1, 2, 4, 7, 16, 512, 2000, 32767]))
        else:
            data[at] = rng.randrange(256)
    return bytes(data)


def _stl(content: bytes, rng: random.Random) -> bytes:
    """Change coordinates, or which triangles there are."""
    count = (len(content) - 84) // 50
    faces = np.frombuffer(content[84 : 84 + 50 * count], dtype=np.uint8).reshape(count, 50).copy()
    corners = faces[:, 12:48].copy().view("<f4").reshape(count, 3, 3)
    kind = rng.randrange(7)
    some = np.array([rng.randrange(count) for _ in range(rng.choice([1, 3, 100]))])
    if kind == 0:
        numbers = [np.nan, np.inf, 1e30, -1e30, 0.0, 1e10, 1e-40]
        corners[some, rng.randrange(3), rng.randrange(3)] = rng.choice(numbers)
    elif kind == 1:
        corners *= np.float32(rng.choice([0.0, 1e-6, 1e-3, -1.0, 1e3, 1e6, 1e15, 1e30]))
    elif kind == 2:
        corners[some] = corners[some][:, ::-1]
    elif kind == 3:
        corners[some] += np.float32(rng.choice([0.1, 1.0, 5.0, 100.0]))
    faces[:, 12:48] = corners.reshape(count, 9).view(np.uint8).reshape(count, 36)
    if kind == 4:
        faces = np.delete(faces, some, axis=0)
    elif kind == 5:
        faces = np.concatenate([faces, faces[some]])
    elif kind == 6:
        faces = faces[: rng.choice([0, 1, 2, 3, 4, count // 2])]
    return content[:80] + struct.pack("<I", len(faces)) + faces.tobytes()


def _arrays(content: bytes, rng: random.Random) -> bytes:
    """Change, reshape or remove an array of an .npz file."""
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        arrays = dict(file.items())
    name = rng.choice(sorted(arrays))
    array = arrays[name].copy()
    kind = rng.randrange(6)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = array.ravel()[: rng.choice([0, 1, max(array.size - 1, 0)])]
    elif kind == 2:
        arrays[name] = array[None]
    elif array.dtype.kind == "f" and array.size:
        numbers = [np.nan, np.inf, 1e300, -1.0, 0.0, 1e6, rng.gauss(0.0, 10.0)]
        array.ravel()[rng.randrange(array.size)] = rng.choice(numbers)
        arrays[name] = array
    elif array.dtype.kind == "U":
        arrays[name] = np.array(_text(str(array).encode(), rng).decode("utf-8", "replace"))
    else:
        arrays[name] = np.array(rng.choice([np.nan, 1e308, -1, 0]))
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()
