"""Boards to calibrate by and to measure in front of: their description, print and detection.

The frame of a board has its origin at the upper left corner of the print, x to the right and y
down as one reads it, and z away from the reader: what stands in front of a board has z < 0.
"""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity, show_value
from ..errors import FileFormatError, InputError
from ..io.files import write_bytes, write_text
from ..io.records import load_data, read_record, write_record
from ..numeric.arrays import Floats
from ..results import Shown
from .pictures import Grey, Picture, import_opencv

MARKER_SHARE = 0.65
"""Side of a marker as a share of its square: the gap between is what a corner is refined in."""

CHECK_LINE = 100.0
"""Nominal length of the bar that is printed below a board [mm]."""

BORDER = 8.0
"""Corners nearer to the border of the picture than this are left out [px]."""

A4 = (210.0, 297.0)
"""Width and height of a sheet [mm]."""

_MARGIN = 12.0
_POINTS = 72.0 / 25.4
_LIMIT = 40

_BARE_MARKER_MODULES = {"4x4": 4, "5x5": 5}
_DICTIONARIES = {"4x4": "DICT_4X4_100", "5x5": "DICT_5X5_100"}
_MARKERS = 100


@dataclass(frozen=True, eq=False)
class Detection(Shown):
    """The corners of a board that were found in a picture.

    Attributes
    ----------
    corners : ndarray, shape (n, 2)
        Where they are in the picture [px].
    points : ndarray, shape (n, 3)
        Where they are on the board, as measured [mm].
    ids : ndarray of int, shape (n,)
        Their numbers on the board.
    size : tuple of int
        Width and height of the picture [px].
    reason : str
        Why there are none or few; empty otherwise.
    """

    corners: Floats
    points: Floats
    ids: NDArray[np.int64]
    size: tuple[int, int]
    reason: str = ""

    @property
    def found(self) -> bool:
        """Whether there are corners."""
        return len(self.ids) > 0


@dataclass(frozen=True, kw_only=True)
class Board(Shown, ABC):
    """What all boards share: what was measured of the print, and how corners are refined.

    Parameters
    ----------
    check_line : float
        Length of the printed bar of 100 mm by the caliper [mm].
    check_line_uncertainty : float
        Its standard uncertainty [mm].
    flatness : float
        Standard deviation of the surface from a plane [mm].
    """

    check_line: float = quantity(
        "length", "The printed bar of 100 mm, by the caliper.", default=CHECK_LINE, low=50, high=200
    )
    check_line_uncertainty: float = quantity(
        "length", "Standard uncertainty of that.", default=0.03, low=0.0, high=10.0
    )
    flatness: float = quantity(
        "length", "Standard deviation of the surface from a plane.", default=0.1, low=0.0, high=10.0
    )

    kind: ClassVar[str]

    @property
    def scale(self) -> float:
        """Measured lengths over nominal ones."""
        return self.check_line / CHECK_LINE

    @property
    def scale_uncertainty(self) -> float:
        """Standard uncertainty of lengths, as a share of them."""
        return self.check_line_uncertainty / CHECK_LINE

    @property
    @abstractmethod
    def extent(self) -> tuple[float, float]:
        """Nominal width and height of the print [mm]."""

    @property
    @abstractmethod
    def nominal_corners(self) -> Floats:
        """Corners of the chess pattern as drawn, shape (n, 3) [mm]."""

    @property
    @abstractmethod
    def rectangles(self) -> Floats:
        """What is black, as drawn: x and y of the upper left and lower right, shape (m, 4) [mm]."""

    @abstractmethod
    def _find(self, picture: Picture) -> tuple[Floats, NDArray[np.int64], str]:
        """Return unrefined corners, their numbers, and the reason if there are none."""

    @property
    def _gap(self) -> float:
        """White around a corner that is free of markers, as a share of the square."""
        return 0.5 * (1.0 - MARKER_SHARE)

    @property
    def corners(self) -> Floats:
        """Corners of the chess pattern as measured, shape (n, 3) [mm]."""
        return self.scale * self.nominal_corners

    def detect(self, picture: Picture) -> Detection:
        """Find the board's corners in a picture, and refine them.

        Corners are always refined on the grey values (`cv2.cornerSubPix`): those of OpenCV's
        ChArUco detector are shifted by half a pixel before version 4.14 (its issue 25539).
        Corners near the border of the picture, and those that do not fit a plane, are left out.
        """
        corners, ids, reason = self._find(picture)
        if len(ids) >= 4:
            corners = _refine(picture, corners, self._gap)
            keep = _select(corners, self.nominal_corners[ids], picture.size)
            corners, ids = corners[keep], ids[keep]
            reason = reason if keep.any() else "no corners of the board lie on a plane"
        else:
            corners, ids = np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
            reason = reason or "fewer than 4 corners of the board are seen"
        return Detection(corners, self.corners[ids], ids, picture.size, reason)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the description and what was measured to a file (.yaml, .json)."""
        data = {"kind": self.kind, **write_record(self)}
        if Path(path).suffix.lower() == ".json":
            return write_text(path, json.dumps(data, indent=2) + "\n")
        lines = [f"{name}: {json.dumps(value)}\n" for name, value in data.items()]
        return write_text(path, "# A board; lengths in mm\n" + "".join(lines))

    def write_pdf(self, path: str | os.PathLike[str]) -> Path:
        """Write the board at its true scale as a vector PDF, with a bar of 100 mm to measure."""
        return write_bytes(Path(path), _format_pdf(self))


def _inner_corners(columns: int, rows: int, square: float) -> Floats:
    """Return the corners between squares, row by row."""
    x, y = np.meshgrid(np.arange(1, columns) * square, np.arange(1, rows) * square)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def _black_squares(columns: int, rows: int, square: float) -> Floats:
    """Return the black squares of a chess pattern whose upper left one is black."""
    y, x = np.nonzero((np.add.outer(np.arange(rows), np.arange(columns))) % 2 == 0)
    return square * np.stack([x, y, x + 1, y + 1], axis=1).astype(float)


def _marker_rectangles(name: str, numbers: NDArray[np.int64], side: float) -> list[Floats]:
    """Return what is black of markers, each with its upper left corner at the origin."""
    cv2 = import_opencv()
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _DICTIONARIES[name]))
    modules = _BARE_MARKER_MODULES[name] + 2
    module = side / modules
    found = []
    for number in numbers.tolist():
        black = dictionary.generateImageMarker(number, modules, borderBits=1) < 128
        padded = np.pad(black.astype(np.int8), ((0, 0), (1, 1)))
        steps = np.diff(padded, axis=1)
        row, start = np.nonzero(steps == 1)
        end = np.nonzero(steps == -1)[1]
        found.append(module * np.stack([start, row, end, row + 1], axis=1).astype(float))
    return found


@dataclass(frozen=True)
class _Strip:
    """A ChArUco pattern of its own, as part of a board."""

    columns: int
    rows: int
    square: float
    left: float
    first: int
    dictionary: str

    @property
    def count(self) -> int:
        """Number of markers."""
        return self.columns * self.rows // 2

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The numbers of its markers."""
        return np.arange(self.first, self.first + self.count)

    @property
    def corners(self) -> Floats:
        """Nominal corners, shape (n, 3) [mm]."""
        inner = _inner_corners(self.columns, self.rows, self.square)
        return np.asarray(inner + np.array([self.left, 0.0, 0.0]))

    @property
    def rectangles(self) -> Floats:
        """What is black, shape (m, 4) [mm]."""
        squares = _black_squares(self.columns, self.rows, self.square)
        parts = [squares + np.array([self.left, 0.0, self.left, 0.0])]
        side = MARKER_SHARE * self.square
        drawn = _marker_rectangles(self.dictionary, self.numbers, side)
        for marker, place in zip(drawn, self.marker_places, strict=True):
            parts.append(marker + np.tile(place, 2))
        return np.concatenate(parts)

    @property
    def marker_places(self) -> Floats:
        """Upper left corner of each marker, shape (count, 2) [mm]."""
        y, x = np.nonzero((np.add.outer(np.arange(self.rows), np.arange(self.columns))) % 2 == 1)
        gap = 0.5 * (1.0 - MARKER_SHARE) * self.square
        start = np.array([self.left + gap, gap])
        return np.asarray(self.square * np.stack([x, y], axis=1) + start)

    def find(
        self, picture: Picture, markers: Sequence[Grey], numbers: NDArray[np.int32]
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return corners and their numbers from the markers of a picture."""
        cv2 = import_opencv()
        mine = np.isin(np.ravel(numbers), self.numbers)
        if not mine.any():
            return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
        board = cv2.aruco.CharucoBoard(
            (self.columns, self.rows),
            self.square,
            MARKER_SHARE * self.square,
            _get_dictionary(self.dictionary),
            self.numbers.astype(np.int32),
        )
        corners, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(
            picture.bytes,
            markerCorners=[marker for marker, own in zip(markers, mine, strict=True) if own],
            markerIds=np.reshape(numbers, (-1, 1))[mine],
        )
        if ids is None or len(ids) == 0:
            return np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
        return np.asarray(corners, float).reshape(-1, 2), np.ravel(ids).astype(np.int64)


def _get_dictionary(name: str) -> object:
    cv2 = import_opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _DICTIONARIES[name]))


def _find_markers(
    values: NDArray[np.uint8], dictionary: str
) -> tuple[Sequence[Grey], NDArray[np.int32]]:
    """Return the corners and numbers of the markers in a picture."""
    cv2 = import_opencv()
    parameters = cv2.aruco.DetectorParameters()
    # For small and blurred markers: more samples a module, and all the correction of the code.
    parameters.minMarkerPerimeterRate = 0.01
    parameters.perspectiveRemovePixelPerCell = 8
    parameters.errorCorrectionRate = 1.0
    detector = cv2.aruco.ArucoDetector(_get_dictionary(dictionary), parameters)
    corners, numbers, *_ = detector.detectMarkers(values)
    return corners, np.zeros((0, 1), np.int32) if numbers is None else np.asarray(numbers)


@dataclass(frozen=True, kw_only=True)
class _Charuco(Board):
    """Boards of chess patterns with markers in their white squares."""

    @property
    @abstractmethod
    def _strips(self) -> tuple[_Strip, ...]:
        """The patterns."""

    @cached_property
    def rectangles(self) -> Floats:
        """What is black, as drawn: x and y of the upper left and lower right, shape (m, 4) [mm]."""
        return np.concatenate([strip.rectangles for strip in self._strips])

    @cached_property
    def nominal_corners(self) -> Floats:
        """Corners of the chess pattern as drawn, shape (n, 3) [mm]."""
        return np.concatenate([strip.corners for strip in self._strips])

    def _find(self, picture: Picture) -> tuple[Floats, NDArray[np.int64], str]:
        strips = self._strips
        markers, numbers = _find_markers(picture.bytes, strips[0].dictionary)
        sound = self._find_sound(markers, np.ravel(numbers))
        taken, names = [markers[i] for i in sound], numbers[sound]
        corners, ids, first = [], [], 0
        for strip in strips:
            part, which = strip.find(picture, taken, names)
            corners.append(part)
            ids.append(which + first)
            first += len(strip.corners)
        reason = ""
        if sum(map(len, ids)) < 4:
            own = np.concatenate([strip.numbers for strip in strips])
            known = int(np.isin(numbers, own).sum())
            mirrored = np.ascontiguousarray(picture.bytes[:, ::-1])
            seen = np.isin(_find_markers(mirrored, strips[0].dictionary)[1], own)
            if seen.sum() > max(known, 3):
                reason = "the board is mirrored"
            elif not known:
                words = "markers of another board" if len(numbers) else "no marker of the board"
                reason = f"{words} found"
        return np.concatenate(corners), np.concatenate(ids), reason

    def _find_sound(self, markers: Sequence[Grey], numbers: NDArray[np.int32]) -> NDArray[np.int64]:
        """Return which markers of the board lie where its plane has them.

        OpenCV's detector drops a whole board for one marker that was read wrongly.
        """
        cv2 = import_opencv()
        strips = self._strips
        side = MARKER_SHARE * strips[0].square
        places = np.concatenate([strip.marker_places for strip in strips])
        first = strips[0].first
        own = np.flatnonzero((numbers >= first) & (numbers < first + len(places)))
        if len(own) < 3:
            return own
        round_it = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        drawn = (places[numbers[own] - first][:, None] + round_it).reshape(-1, 1, 2)
        seen = np.concatenate([np.reshape(markers[i], (4, 2)) for i in own.tolist()]).astype(float)
        size = float(np.median(np.linalg.norm(seen[1::4] - seen[::4], axis=1)))
        plane, _ = cv2.findHomography(drawn, seen, cv2.RANSAC, 0.3 * size)
        if plane is None:
            return own
        off = np.linalg.norm(cv2.perspectiveTransform(drawn, plane).reshape(-1, 2) - seen, axis=1)
        return np.asarray(own[off.reshape(-1, 4).max(axis=1) < 0.5 * size])


@dataclass(frozen=True, kw_only=True)
class CharucoBoard(_Charuco):
    """A chess board with markers in its white squares, for the calibration of cameras.

    Any part of it in the picture will do.

    Parameters
    ----------
    columns, rows : int
        Squares across and down.
    square : float
        Side of a square as drawn [mm].
    first_marker : int
        Number of the first marker; boards seen together need their own numbers.
    """

    columns: int = quantity(help="Squares across.", default=11, low=3, high=_LIMIT, whole=True)
    rows: int = quantity(help="Squares down.", default=8, low=3, high=_LIMIT, whole=True)
    square: float = quantity("length", "Side of a square.", default=6.0, low=0.5, high=200.0)
    first_marker: int = quantity(
        "dimensionless",
        "Number of the first marker.",
        default=0,
        low=0,
        high=_MARKERS - 1,
        whole=True,
    )
    kind: ClassVar[str] = "charuco"

    def __post_init__(self) -> None:
        check_fields(self, "the board's ")
        last = self.first_marker + self._strips[0].count - 1
        if last >= _MARKERS:
            raise InputError(
                f"the board's last marker is {last}: {self.columns} x {self.rows} squares from "
                f"marker {self.first_marker} on must end within [0, {_MARKERS - 1}]"
            )

    @property
    def extent(self) -> tuple[float, float]:
        """Nominal width and height of the print [mm]."""
        return self.columns * self.square, self.rows * self.square

    @property
    def _strips(self) -> tuple[_Strip, ...]:
        return (_Strip(self.columns, self.rows, self.square, 0.0, self.first_marker, "5x5"),)


@dataclass(frozen=True, kw_only=True)
class StripBoard(_Charuco):
    """Two upright strips of markers either side of a plain window in which a muscle hangs.

    Parameters
    ----------
    columns, rows : int
        Squares across and down of each strip.
    square : float
        Side of a square as drawn [mm].
    gap : float
        Width of the window as drawn [mm].
    """

    columns: int = quantity(help="Squares across a strip.", default=3, low=2, high=7, whole=True)
    rows: int = quantity(help="Squares down a strip.", default=14, low=3, high=33, whole=True)
    square: float = quantity("length", "Side of a square.", default=5.0, low=0.5, high=50.0)
    gap: float = quantity("length", "Width of the window.", default=30.0, low=5.0, high=300.0)
    kind: ClassVar[str] = "strips"

    def __post_init__(self) -> None:
        check_fields(self, "the board's ")
        count = sum(strip.count for strip in self._strips)
        if count > _MARKERS:
            raise InputError(
                f"the board has {count} markers: {self.columns} x {self.rows} squares a strip must "
                f"need at most {_MARKERS}"
            )

    @property
    def extent(self) -> tuple[float, float]:
        """Nominal width and height of the print [mm]."""
        return 2.0 * self.columns * self.square + self.gap, self.rows * self.square

    @property
    def window(self) -> tuple[float, float, float, float]:
        """Left, upper, right and lower edge of the window as measured [mm]."""
        left, height = self.columns * self.square, self.rows * self.square
        return self.scale * left, 0.0, self.scale * (left + self.gap), self.scale * height

    @property
    def _strips(self) -> tuple[_Strip, ...]:
        left = _Strip(self.columns, self.rows, self.square, 0.0, 0, "4x4")
        right = self.columns * self.square + self.gap
        return left, _Strip(self.columns, self.rows, self.square, right, left.count, "4x4")


@dataclass(frozen=True, kw_only=True)
class Checkerboard(Board):
    """A plain chess board; a picture must show it whole.

    Parameters
    ----------
    columns, rows : int
        Inner corners across and down: one less than squares. One of them must be even and the
        other odd, as the board else looks the same upside down.
    square : float
        Side of a square as drawn [mm].
    """

    columns: int = quantity(help="Inner corners across.", default=9, low=3, high=_LIMIT, whole=True)
    rows: int = quantity(help="Inner corners down.", default=6, low=3, high=_LIMIT, whole=True)
    square: float = quantity("length", "Side of a square.", default=6.0, low=0.5, high=200.0)
    kind: ClassVar[str] = "checkerboard"

    def __post_init__(self) -> None:
        check_fields(self, "the board's ")
        if (self.columns + self.rows) % 2 == 0:
            raise InputError(
                f"the board has {self.columns} x {self.rows} inner corners: one number must be "
                "even and the other odd, else it looks the same upside down"
            )

    @property
    def extent(self) -> tuple[float, float]:
        """Nominal width and height of the print [mm]."""
        return (self.columns + 1) * self.square, (self.rows + 1) * self.square

    @property
    def nominal_corners(self) -> Floats:
        """Corners of the chess pattern as drawn, shape (n, 3) [mm]."""
        return _inner_corners(self.columns + 1, self.rows + 1, self.square)

    @property
    def rectangles(self) -> Floats:
        """What is black, as drawn: x and y of the upper left and lower right, shape (m, 4) [mm]."""
        return _black_squares(self.columns + 1, self.rows + 1, self.square)

    @property
    def _gap(self) -> float:
        return 0.4

    def _find(self, picture: Picture) -> tuple[Floats, NDArray[np.int64], str]:
        cv2 = import_opencv()
        found, corners = cv2.findChessboardCornersSB(picture.bytes, (self.columns, self.rows), None)
        if not found:
            words = f"no chess board of {self.columns} x {self.rows} inner corners found"
            return np.zeros((0, 2)), np.zeros(0, np.int64), words
        grid = np.asarray(corners, float).reshape(self.rows, self.columns, 2)
        grid = _turn_upright(grid, picture)
        return grid.reshape(-1, 2), np.arange(self.columns * self.rows), ""


def _turn_upright(grid: Floats, picture: Picture) -> Floats:
    """Return a grid of corners (rows, columns, 2) so that the square at its start is black."""
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0.0:  # seen as in a mirror
        grid = grid[:, ::-1]
    # Squares within the corners: as the one at the start of the print, or of the other colour.
    middles = 0.25 * (grid[1:, 1:] + grid[:-1, 1:] + grid[1:, :-1] + grid[:-1, :-1])
    column, row = np.round(middles).astype(int).reshape(-1, 2).T
    width, height = picture.size
    grey = picture.values[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    same = np.add.outer(np.arange(len(grid) - 1), np.arange(grid.shape[1] - 1)).ravel() % 2 == 0
    return grid if grey[same].mean() < grey[~same].mean() else grid[::-1, ::-1]


def _refine(picture: Picture, corners: Floats, gap: float) -> Floats:
    """Refine corners inside the white around them that is free of markers."""
    cv2 = import_opencv()
    apart = np.linalg.norm(corners[:, None] - corners[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    nearest = float(np.percentile(apart.min(axis=1), 10))
    half = int(np.clip(0.9 * gap * nearest, 2, 12))
    values = np.asarray(255.0 * picture.values, dtype=np.float32)
    start = np.ascontiguousarray(corners.reshape(-1, 1, 2), dtype=np.float32)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    return np.asarray(
        cv2.cornerSubPix(values, start, (half, half), (-1, -1), stop), dtype=float
    ).reshape(-1, 2)


def _select(corners: Floats, points: Floats, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Tell which corners are away from the border and near the image of a plane."""
    cv2 = import_opencv()
    inside = np.all((corners > BORDER) & (corners < np.array(size) - 1.0 - BORDER), axis=1)
    if inside.sum() < 4:
        return np.zeros(len(corners), bool)
    plane, _ = cv2.findHomography(points[inside, :2], corners[inside], cv2.RANSAC, 3.0)
    if plane is None:
        return np.zeros(len(corners), bool)
    mapped = cv2.perspectiveTransform(points[:, None, :2], plane).reshape(-1, 2)
    off = np.linalg.norm(mapped - corners, axis=1)
    return np.asarray(inside & (off <= max(5.0 * float(np.median(off[inside])), 0.5)))


KINDS: dict[str, type[Board]] = {
    "charuco": CharucoBoard,
    "strips": StripBoard,
    "checkerboard": Checkerboard,
}
"""The boards by the names that files give them."""


def load_board(path: str | os.PathLike[str]) -> Board:
    """Read the description of a board from a file (.yaml, .json).

    Raises
    ------
    FileFormatError
        One line that names the file and the field.
    """
    data = load_data(path)
    kinds = ", ".join(KINDS)
    if not isinstance(data, dict) or "kind" not in data:
        raise FileFormatError(f"{path}: not a board: it must hold 'kind', one of {kinds}")
    kind = data.pop("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise FileFormatError(f"{path}: kind is {show_value(kind)}: choose one of {kinds}")
    try:
        return read_record(data, KINDS[kind], name="the board")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from None


def load_strips(path: str | os.PathLike[str]) -> StripBoard:
    """Return the board in a file, which must be strips.

    Raises
    ------
    InputError
        If it is another one.
    """
    board = load_board(path)
    if not isinstance(board, StripBoard):
        raise InputError(f"{path}: the board is {board.kind}: lengths are measured before strips")
    return board


def _format_pdf(board: Board) -> bytes:
    """Return a PDF of one page with the board in its middle and a bar to measure below it."""
    width, height = board.extent
    page = (
        max(A4[0], max(width, CHECK_LINE) + 2.0 * _MARGIN),
        max(A4[1], height + 5.0 * _MARGIN),
    )
    left, foot = 0.5 * (page[0] - width), 0.5 * (page[1] - height) + _MARGIN
    x0, y0, x1, y1 = board.rectangles.T
    boxes = np.stack([left + x0, foot + height - y1, left + x1, foot + height - y0], axis=1)
    bar = 0.5 * (page[0] - CHECK_LINE), foot - 1.5 * _MARGIN
    boxes = np.vstack([boxes, [*bar, bar[0] + CHECK_LINE, bar[1] + 3.0]])
    corners = _POINTS * np.column_stack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
    drawn = "\n".join("{:.4f} {:.4f} {:.4f} {:.4f} re".format(*box) for box in corners)
    words = (
        f"{board.kind}: {width:g} x {height:g} mm. Print at 100 %. Measure this bar by a caliper: "
        "it is 100 mm. Write what it measures as check_line in the file of the board."
    )
    text = f"BT /F1 7 Tf {_POINTS * _MARGIN:.2f} {_POINTS * (bar[1] - 5.0):.2f} Td ({words}) Tj ET"
    content = f"{drawn}\nf\n{text}\n".encode("ascii")
    size = f"{_POINTS * page[0]:.4f} {_POINTS * page[1]:.4f}"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {size}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode("ascii"),
        b"<< /Length %d >>\nstream\n%sendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    written = b"%PDF-1.6\n"
    places = []
    for number, item in enumerate(objects, start=1):
        places.append(len(written))
        written += b"%d 0 obj\n%s\nendobj\n" % (number, item)
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    end = (
        f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}"
        f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(written)}\n%%EOF\n"
    )
    return written + end.encode("ascii")
