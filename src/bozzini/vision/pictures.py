"""Pictures: reading them, lists of them (manifests), and the record of a run.

A picture is read as its sensor gave it: an EXIF note that asks a viewer to turn it is not obeyed,
as a camera is calibrated in the pixels of its sensor; the note is kept in `Picture.flags`.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import platform
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..errors import BozziniError, FileFormatError, InputError, MissingExtraError
from ..io.files import write_atomically, write_bytes, write_text
from ..io.inputs import note_input
from ..io.sheets import Sheet, refuse_untitled, write_table
from ..numeric.processes import open_processes
from ..progress import Progress, no_progress
from ..results import Json, Shown, to_plain

Grey = NDArray[np.float32]
Item = TypeVar("Item")

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
"""Endings of pictures that a folder is searched for."""

_EXIF_ORIENTATION = 274
_LUMA = np.array([0.299, 0.587, 0.114], dtype=np.float32)
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""


@dataclass(frozen=True, eq=False)
class Picture(Shown):
    """A grey picture.

    Attributes
    ----------
    values : ndarray of float32, shape (h, w)
        Grey values as stored, from 0 to 1.
    bits : int
        Bits a value had in the file.
    name : str
        Name of its file, for messages.
    flags : tuple of str
        What is to be known of it: ``exif_rotated``, ``colour``.
    """

    values: Grey
    bits: int = 8
    name: str = "the picture"
    flags: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.values.shape[1], self.values.shape[0]

    @cached_property
    def bytes(self) -> NDArray[np.uint8]:
        """The values as whole numbers from 0 to 255, shape (h, w)."""
        return np.asarray(np.round(255.0 * self.values), dtype=np.uint8)

    @property
    def saturated(self) -> float:
        """Share of the values that are the largest possible."""
        return float(np.mean(self.values >= 1.0 - 0.5 / (2**self.bits - 1)))


def read_picture(path: str | os.PathLike[str]) -> Picture:
    """Read a picture of 8 or 16 bits, grey or in colour, as grey values.

    Raises
    ------
    FileFormatError
        If there is no such file, it is no picture, is cut short, or has another number of bits.
    """
    from PIL import Image, UnidentifiedImageError

    source = Path(path)
    note_input(source)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # damaged notes in a picture that is whole
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(source) as file:
                turned = file.getexif().get(_EXIF_ORIENTATION, 1) not in (0, 1)
                file.load()
                image, mode = file.copy(), file.mode
                if mode in ("1", "P", "PA", "CMYK", "YCbCr", "LAB", "HSV", "RGBA", "RGBX"):
                    image, mode = image.convert("RGB"), "RGB"
                values = np.asarray(image)
    except FileNotFoundError:
        raise FileFormatError(f"{source}: there is no such picture") from None
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise FileFormatError(f"{source}: the picture has more pixels than are read") from None
    except UnidentifiedImageError:
        raise FileFormatError(f"{source}: not a picture of a known format") from None
    except (OSError, ValueError, SyntaxError, EOFError, IndexError) as error:
        words = " ".join(str(error).split())[:100] or type(error).__name__
        raise FileFormatError(f"{source}: the picture cannot be read: {words}") from None
    flags: tuple[str, ...] = ("exif_rotated",) if turned else ()
    if values.ndim == 3 and mode in ("RGB", "LA"):
        values = values[..., 0] if mode == "LA" else np.asarray(values, np.float32) @ _LUMA
        flags += ("colour",) if mode == "RGB" else ()
    bits = 16 if mode.startswith("I") else 8
    if values.ndim != 2 or mode == "F" or values.size == 0 or values.min() < 0:
        raise FileFormatError(
            f"{source}: grey values of kind '{mode}' are not read: give 8 or 16 bits"
        )
    if values.max() > 2**bits - 1:
        raise FileFormatError(f"{source}: grey values above 65535 are not read: give 8 or 16 bits")
    grey = np.asarray(values, dtype=np.float32) / np.float32(2**bits - 1)
    return Picture(grey, bits=bits, name=source.name, flags=flags)


def write_picture(picture: Picture, path: str | os.PathLike[str], *, quality: int = 95) -> Path:
    """Write a picture as 8 or 16 bits (.png, .tif) or with losses (.jpg of a `quality`)."""
    from PIL import Image

    target = Path(path)
    lossy = target.suffix.lower() in (".jpg", ".jpeg")
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(f"{target}: pictures are written as {', '.join(SUFFIXES)}")
    deep = picture.bits == 16 and not lossy
    values = np.round(65535.0 * picture.values).astype(np.uint16) if deep else picture.bytes
    return write_atomically(
        target, lambda path: Image.fromarray(values).save(path, quality=quality)
    )


def import_opencv() -> ModuleType:
    """Return OpenCV, or raise `MissingExtraError`."""
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("opencv-python-headless", "vision") from None
    return cv2


@dataclass(frozen=True)
class Manifest:
    """A table of pictures: a row for each measurement, its cells as text.

    Attributes
    ----------
    path : Path
        The file; pictures are named relative to its folder.
    columns : tuple of str
    rows : tuple of dict
        Cells by column.
    """

    path: Path
    columns: tuple[str, ...]
    rows: tuple[dict[str, str], ...]

    def find_picture(self, row: Mapping[str, str], column: str) -> Path:
        """Return the path of a row's picture."""
        return self.path.parent / row[column]


def read_manifest(path: str | os.PathLike[str], required: Sequence[str]) -> Manifest:
    """Read a table of pictures (CSV, UTF-8, the first row names the columns).

    Lines that begin with ``#`` are left out, and so are empty ones.

    Parameters
    ----------
    path : path-like
    required : sequence of str
        Columns that must be there. Others are kept as they are.

    Raises
    ------
    FileFormatError
        One line that names the file and what is wrong.
    """
    source = Path(path)
    note_input(source)
    try:
        text = source.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileFormatError(f"cannot read {source}: {error.strerror or error}") from None
    except ValueError as error:
        raise FileFormatError(f"cannot read {source}: it is not UTF-8 text ({error})") from None
    try:
        lines = [
            [cell.strip() for cell in line]
            for line in csv.reader(io.StringIO(text), strict=True)
            if any(cell.strip() for cell in line) and not line[0].lstrip().startswith("#")
        ]
    except csv.Error as error:
        raise FileFormatError(f"{source}: not a table of comma-separated values: {error}") from None
    if len(lines) < 2:
        raise FileFormatError(f"{source}: there are no rows below the names of the columns")
    sheet = Sheet(lines[0], lines[1:], range(1, len(lines)))
    try:
        sheet = refuse_untitled(sheet)
    except FileFormatError as error:
        raise FileFormatError(f"{source}: {error}") from None
    head = tuple(sheet.titles)
    for name in required:
        if head.count(name) != 1:
            found = ", ".join(head)[:200]
            raise FileFormatError(f"{source}: needs one column '{name}', it has: {found}")
    if len(set(head)) < len(head):
        raise FileFormatError(f"{source}: two columns have the same name")
    for number, line in enumerate(lines[1:], start=1):
        if len(line) != len(head):
            words = f"row {number} has {len(line)} cells, the first row names {len(head)}"
            raise FileFormatError(f"{source}: {words}")
    return Manifest(source, head, tuple(dict(zip(head, line, strict=True)) for line in lines[1:]))


def measure_each(
    items: Sequence[Item],
    measure: Callable[[Item], Json],
    *,
    jobs: int = 1,
    stage: str = "measure",
    progress: Progress = no_progress,
) -> list[Json]:
    """Measure pictures one by one; one that fails is a row with its reason.

    Parameters
    ----------
    items : sequence
        What `measure` takes, a row each.
    measure : callable
        Returns a row; its ``status`` is "ok" where it sets none. With more than one job it and the
        items must be picklable.
    jobs : int
        Processes at the same time.
    stage : str
        What progress calls it.
    progress : callable

    Returns
    -------
    list of dict
        In the order of the items. A failed row has ``status`` "failed" and the ``reason``.
    """
    work = partial(_measure_one, measure)
    rows = []
    if jobs > 1 and len(items) > 1:
        with open_processes(min(jobs, len(items)), "measure_each") as pool:
            for row in pool.map(work, items):
                rows.append(row)
                progress(stage, len(rows) / len(items))
        return rows
    for item in items:
        rows.append(work(item))
        progress(stage, len(rows) / len(items))
    return rows


def _measure_one(measure: Callable[[Item], Json], item: Item) -> Json:
    try:
        return {"status": "ok", "reason": "", **measure(item)}
    except MissingExtraError:
        raise
    except BozziniError as error:
        return {"status": "failed", "reason": str(error)}


Color = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

GREEN, RED, BLUE, YELLOW = (0, 200, 0), (230, 0, 0), (60, 120, 255), (255, 210, 0)

_FRACTION_BITS = 4


@dataclass(frozen=True, eq=False)
class Stroke:
    """A line drawn over a picture, or a cross at each of its points.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        [px]; those that are not finite are left out.
    color : tuple of int
    crosses : bool
        Whether the points are marked by crosses instead of joined.
    """

    points: NDArray[np.float64]
    color: Color = GREEN
    crosses: bool = False


def write_overlay(
    path: str | os.PathLike[str],
    picture: Picture,
    strokes: Iterable[Stroke],
    text: Sequence[str] = (),
    *,
    refused: bool = False,
) -> Path:
    """Write a picture with what was found in it (.jpg, .png); a red frame if it was refused."""
    from PIL import Image

    cv2 = import_opencv()
    canvas = np.repeat(picture.bytes[..., None], 3, axis=2)
    for stroke in strokes:
        points = stroke.points[np.isfinite(stroke.points).all(axis=1)]
        if stroke.crosses:
            arms = 6.0 * np.array([[[-1, 0], [1, 0]], [[0, -1], [0, 1]]])
            lines = [*(points[:, None, None] + arms).reshape(-1, 2, 2)]
        else:
            lines = [points] if len(points) > 1 else []
        fixed = [np.round(line * 2**_FRACTION_BITS).astype(np.int32) for line in lines]
        cv2.polylines(canvas, fixed, False, stroke.color, 1, cv2.LINE_AA, _FRACTION_BITS)
    color = RED if refused else GREEN
    for k, line in enumerate(text):
        words = line.encode("ascii", "replace").decode("ascii")
        cv2.putText(canvas, words, (12, 26 + 22 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.6, color, 2)
    if refused:
        width, height = picture.size
        cv2.rectangle(canvas, (0, 0), (width - 1, height - 1), RED, 8)
    packed = io.BytesIO()
    kind = "png" if Path(path).suffix.lower() == ".png" else "jpeg"
    Image.fromarray(canvas).save(packed, kind)
    return write_bytes(Path(path), packed.getvalue())


def write_tables(
    folder: Path, tables: Mapping[str, Mapping[str, object]], *, parquet: bool = False
) -> None:
    """Write tables into a directory, as text (.csv) or as .parquet."""
    for name, columns in tables.items():
        write_table(folder / f"{name}.{'parquet' if parquet else 'csv'}", columns, digits=9)


def write_summary(
    folder: Path,
    *,
    settings: object,
    inputs: Iterable[str | os.PathLike[str]],
    result: Mapping[str, object],
) -> Json:
    """Write what a directory of results was made from, as its ``summary.json``, and return it.

    Parameters
    ----------
    folder : Path
        Of `bozzini.io.files.new_directory`, with all other files in it.
    settings : dataclass or mapping
    inputs : iterable of path-like
        Files that were read, of which the SHA-256 is written; null for one that is missing.
    result : mapping
        Further entries.
    """
    cv2 = import_opencv()
    sums: dict[str, str | None] = {}
    for source in map(Path, inputs):
        try:
            sums[str(source)] = hashlib.sha256(source.read_bytes()).hexdigest()
        except OSError:
            sums[str(source)] = None
    # The names are what --force may remove later, see `bozzini.io.files.new_directory`.
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    summary: Json = {
        **result,
        "settings": settings,
        "inputs": sums,
        "versions": {
            "bozzini": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "opencv": cv2.__version__,
        },
        "pixels": "the centre of the first pixel is (0, 0)",
        "files": sorted([*files, "summary.json"]),
    }
    summary = dict(to_plain(summary))
    write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
    return summary
