"""Point markers in calibrated pictures: found, matched between cameras, and placed in space.

Markers come from a table of pixels, or are found in pictures as round spots. In each row those of
the cameras are matched so that their rays meet best, and are named so that they move least from the
row before: a table in which two markers have changed places is put right, and flagged.
"""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity
from ..errors import FileFormatError, GeometryError, InputError
from ..io.files import new_directory
from ..io.sheets import write_table
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, Result, take_axes, to_plain
from .camera import Camera, CameraSet, triangulate
from .pictures import (
    Manifest,
    Picture,
    Stroke,
    measure_each,
    read_picture,
    write_overlay,
    write_summary,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FLAGGED, REFUSED = 5.0, 20.0
"""Residuals, in standard uncertainties of a pixel, above which a point is flagged, and refused."""

COARSE = 10.0
"""How far rays may miss each other throughout a series, in least uncertainties of a pixel."""

MOST_MARKERS = 6
"""Markers that are matched at the same time."""

_LEAST_CONTRAST = 6.0
"""Height of a spot over the noise."""
_AMBIGUOUS = 0.7
"""A further spot that is this high, as a share of the lowest taken, makes the choice unsure."""


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """How markers are found and placed.

    Parameters
    ----------
    pixel_uncertainty : float
        Least standard uncertainty of a marker's pixel [px]; it is larger where the rays of a series
        miss each other by more.
    markers : int
        How many there are in each picture; not used with a table of pixels.
    diameter : float
        Of a marker in the pictures [px].
    shade : str
        Whether markers are "bright" or "dark" against what is around them.
    """

    pixel_uncertainty: float = quantity(
        help="Least uncertainty of a pixel [px].", default=0.3, low=0.001, high=100.0, by_name=True
    )
    markers: int = quantity(
        help="Markers in each picture.", default=2, low=1, high=MOST_MARKERS, whole=True
    )
    diameter: float = quantity(
        help="Of a marker in the pictures [px].", default=12.0, low=3.0, high=500.0
    )
    shade: str = quantity(
        "text",
        "Markers against their surroundings.",
        default="bright",
        words=("bright", "dark"),
        by_name=True,
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Track(Result):
    """Points of markers in space, row by row.

    Attributes
    ----------
    markers : tuple of str
        Their names.
    points : ndarray, shape (n, m, 3)
        In the world of the cameras [mm]; NaN where there is none.
    covariance : ndarray, shape (n, m, 3, 3)
        Of a point, from pixels and calibration [mm^2].
    misses : ndarray, shape (n, m)
        Root mean square of a point's residuals in the pictures [px].
    pixels : ndarray, shape (c, n, m, 2)
        Where each camera sees them, in the order of the markers [px].
    pixel_uncertainty : float
        Standard uncertainty of a pixel that was used [px].
    status : tuple of str
        "ok", "flagged" or "failed", for the markers of the first row, then of the next.
    flags : tuple of str
        What was noticed, in the same order; words with ``;`` between.
    reasons : tuple of str
        Why there is no point, in the same order.
    options : TrackOptions
        What was asked for.
    world : str
        What the frame of the points is.
    copied : dict
        Other columns of the table.
    """

    markers: tuple[str, ...]
    points: Floats
    covariance: Floats
    misses: Floats
    pixels: Floats
    pixel_uncertainty: float
    status: tuple[str, ...]
    flags: tuple[str, ...]
    reasons: tuple[str, ...]
    options: TrackOptions = TrackOptions()
    world: str = ""
    copied: dict[str, list[str]] = field(default_factory=dict)

    @property
    def converged(self) -> bool:
        """Whether there are all points."""
        return "failed" not in self.status

    @property
    def reason(self) -> str:
        """Why not; empty if none failed."""
        count = self.status.count("failed")
        if not count:
            return ""
        first = self.status.index("failed")
        row, marker = divmod(first, len(self.markers))
        where = f"row {row + 1}, marker {self.markers[marker]}: {self.reasons[first]}"
        return f"{count} of {len(self.status)} points failed ({where})"

    @property
    def residual(self) -> float:
        """Root mean square of the residuals of the points there are [px]."""
        known = self.misses[np.isfinite(self.points[..., 0])]
        return float(np.sqrt(np.mean(np.square(known)))) if known.size else math.nan

    @property
    def _any(self) -> bool:
        return bool(np.isfinite(self.points).any())

    @property
    def uncertainty(self) -> Floats:
        """Standard uncertainty of each coordinate, shape (n, m, 3) [mm]."""
        return np.asarray(np.sqrt(np.einsum("...ii->...i", self.covariance)))

    def to_dict(self) -> Json:
        """Return a summary as plain values with units in their names."""
        spread = self.uncertainty
        typical = np.nanmedian(spread, axis=(0, 1)).tolist() if self._any else None
        return {
            "converged": self.converged,
            "reason": self.reason,
            "rows": len(self.points),
            "markers": list(self.markers),
            "ok": self.status.count("ok"),
            "flagged": self.status.count("flagged"),
            "failed": self.status.count("failed"),
            "rms_px": self.residual,
            "pixel_uncertainty_px": self.pixel_uncertainty,
            "median_uncertainty_mm": typical,
            "world": self.world,
        }

    def list_columns(self) -> Json:
        """Return a row for each marker of each row: position, uncertainty, residual, status."""
        rows, count = self.points.shape[:2]
        twice = partial(_repeat, count=count)
        flat, spread = self.points.reshape(-1, 3), self.uncertainty.reshape(-1, 3)
        mixed = self.covariance.reshape(-1, 3, 3)
        return {
            "row": twice(list(range(1, rows + 1))),
            **{name: twice(values) for name, values in self.copied.items()},
            "marker": list(self.markers) * rows,
            **{f"{axis}_mm": to_plain(flat[:, k]) for k, axis in enumerate("xyz")},
            **{f"u_{axis}_mm": to_plain(spread[:, k]) for k, axis in enumerate("xyz")},
            **{
                f"cov_{'xyz'[i]}{'xyz'[j]}_mm2": to_plain(mixed[:, i, j])
                for i, j in itertools.combinations(range(3), 2)
            },
            "residual_px": to_plain(self.misses.ravel()),
            "status": list(self.status),
            "flags": list(self.flags),
            "reason": list(self.reasons),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the ways of the markers in the two axes they move in most; return the axes."""
        flat = self.points.reshape(-1, 3)
        spread = np.nanmax(flat, axis=0) - np.nanmin(flat, axis=0) if self._any else np.ones(3)
        i, j = sorted(np.argsort(spread)[1:].tolist())
        ax = take_axes(ax, x=f"{'xyz'[i]} [mm]", y=f"{'xyz'[j]} [mm]", equal=True)
        for k, name in enumerate(self.markers):
            points, error = self.points[:, k], self.uncertainty[:, k]
            ax.errorbar(
                points[:, i],
                points[:, j],
                xerr=2.0 * error[:, i],
                yerr=2.0 * error[:, j],
                marker=".",
                markersize=4,
                linewidth=0.8,
                label=f"marker {name}",
            )
        ax.legend(loc="best", title="bars: 2 standard uncertainties")
        return ax


def _repeat(values: Sequence[object], count: int) -> list[object]:
    return [value for value in values for _ in range(count)]


# Where the pixels come from.

_COLUMN = re.compile(r"(?P<camera>.*?)[ _]?(?P<axis>[xy])[ _]?(?P<marker>[0-9A-Za-z]+)")


@dataclass(frozen=True, eq=False)
class PixelTable:
    """Pixels of markers in each camera.

    Attributes
    ----------
    pixels : ndarray, shape (c, n, m, 2)
        NaN where a cell is empty.
    markers : tuple of str
    copied : dict
        Other columns.
    reasons : tuple of str
        Why a row has no pixels; empty if it has.
    notes : tuple of str
        What was noticed when they were found, a row each.
    named : bool
        Whether the order of the markers means which is which; else they are named by their order
        from left to right in the first camera's first picture.
    """

    pixels: Floats
    markers: tuple[str, ...]
    copied: dict[str, list[str]]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    named: bool = True


def read_pixels(manifest: Manifest, cameras: CameraSet) -> PixelTable:
    """Read the pixels of markers from a table with columns such as ``Lx1`` or ``cam0_x_tip``.

    Column names are a camera (its name or how it begins), x or y, and a marker.

    Raises
    ------
    FileFormatError
        If a column is missing or a cell is no number.
    """
    places: dict[tuple[int, str, str], str] = {}
    for column in manifest.columns:
        match = _COLUMN.fullmatch(column)
        owners = [
            i
            for i, name in enumerate(cameras.names)
            if match and match["camera"] and name.lower().startswith(match["camera"].lower())
        ]
        if match and len(owners) == 1:
            places[owners[0], match["axis"], match["marker"]] = column
    markers = tuple(dict.fromkeys(marker for _, _, marker in places))
    if not 1 <= len(markers) <= MOST_MARKERS:
        raise FileFormatError(
            f"{manifest.path}: {len(markers)} markers in its columns: 1 to {MOST_MARKERS} are "
            f"needed, in columns such as {cameras.names[0]}_x_1 and {cameras.names[0]}_y_1"
        )
    pixels = np.full((len(cameras.names), len(manifest.rows), len(markers), 2), np.nan)
    for i, name in enumerate(cameras.names):
        for k, marker in enumerate(markers):
            for axis in "xy":
                if (i, axis, marker) not in places:
                    words = f"marker {marker} has no column of {axis} for camera {name}"
                    raise FileFormatError(f"{manifest.path}: {words}")
                column = places[i, axis, marker]
                pixels[i, :, k, "xy".index(axis)] = _read_column(manifest, column)
    return PixelTable(
        pixels,
        markers,
        {
            name: [row[name] for row in manifest.rows]
            for name in manifest.columns
            if name not in places.values()
        },
        ("",) * len(manifest.rows),
        ("",) * len(manifest.rows),
    )


def _read_column(manifest: Manifest, column: str) -> list[float]:
    numbers = []
    for number, row in enumerate(manifest.rows, start=1):
        text = row[column]
        try:
            value = float(text) if text else math.nan
        except ValueError:
            value = math.inf
        if math.isinf(value):
            words = (
                f"row {number}, column '{column}' is '{text[:40]}': it must be a number or empty"
            )
            raise FileFormatError(f"{manifest.path}: {words}")
        numbers.append(value)
    return numbers


def find_pixels(
    manifest: Manifest,
    cameras: CameraSet,
    options: TrackOptions,
    *,
    jobs: int = 1,
    progress: Progress = no_progress,
) -> PixelTable:
    """Find the markers in the pictures of a table that has a column named as each camera.

    A row whose pictures are missing, cannot be read, or do not show the markers has its reason.
    """
    work = partial(_find_row, options=options)
    items = [
        [
            (manifest.find_picture(row, name), camera.size)
            for name, camera in zip(cameras.names, cameras.cameras, strict=True)
        ]
        for row in manifest.rows
    ]
    rows = measure_each(items, work, jobs=jobs, stage="find markers", progress=progress)
    nothing = np.full((len(cameras.names), options.markers, 2), np.nan)
    return PixelTable(
        np.stack([row.get("pixels", nothing) for row in rows], axis=1),
        tuple(str(k + 1) for k in range(options.markers)),
        {name: [row[name] for row in manifest.rows] for name in manifest.columns},
        tuple(row["reason"] for row in rows),
        tuple(row.get("note", "") for row in rows),
        named=False,
    )


def _find_row(items: Sequence[tuple[Path, tuple[int, int]]], options: TrackOptions) -> Json:
    """Return the pixels (c, m, 2) of one row."""
    found, notes = [], set()
    for path, size in items:
        picture = read_picture(path)
        if picture.size != size:
            have, need = (f"{width} x {height}" for width, height in (picture.size, size))
            raise FileFormatError(f"{path}: the picture has {have} px, its camera has {need}")
        pixels, note = find_spots(picture, options)
        found.append(pixels)
        notes |= {*picture.flags, note} - {"", "colour"}
    return {"pixels": np.stack(found), "note": ";".join(sorted(notes))}


def find_spots(picture: Picture, options: TrackOptions) -> tuple[Floats, str]:
    """Find round spots of a given size in a picture.

    They are the highest peaks of the picture's Laplacian at the scale of the diameter; the middle
    is the centroid of what stands out above half the spot's height.

    Returns
    -------
    pixels : ndarray, shape (m, 2)
        From left to right [px].
    note : str
        "ambiguous_markers" if further spots are nearly as high; empty otherwise.

    Raises
    ------
    GeometryError
        If there are fewer spots than markers.

    References
    ----------
    T. Lindeberg, International Journal of Computer Vision 30 (1998) 79-116.
    """
    from scipy.ndimage import gaussian_laplace, maximum_filter

    values = picture.values.astype(float) * (1.0 if options.shade == "bright" else -1.0)
    scale = options.diameter / (2.0 * math.sqrt(2.0))
    response = -(scale**2) * gaussian_laplace(values, scale, mode="nearest")
    noise = 1.4826 * float(np.median(np.abs(response - np.median(response))))
    peaks = response == maximum_filter(response, size=2 * math.ceil(options.diameter / 2) + 1)
    edge = math.ceil(options.diameter)
    border = np.ones_like(peaks)
    border[edge:-edge, edge:-edge] = False
    peaks &= ~border & (response > max(_LEAST_CONTRAST * noise, 0.02))
    row, column = np.nonzero(peaks)
    height = response[row, column]
    order = np.argsort(-height)
    if len(order) < options.markers:
        raise GeometryError(
            f"{picture.name}: {len(order)} {options.shade} spots of {options.diameter:g} px found, "
            f"{options.markers} are needed"
        )
    taken = order[: options.markers]
    further = height[order[options.markers]] if len(order) > options.markers else 0.0
    note = "ambiguous_markers" if further > _AMBIGUOUS * height[taken].min() else ""
    starts = np.stack([column[taken], row[taken]], axis=1).astype(float)
    middles = np.stack([_centre_spot(values, start, options.diameter) for start in starts])
    return middles[np.argsort(middles[:, 0])], note


def _centre_spot(values: Floats, start: Floats, diameter: float) -> Floats:
    """Return the centroid of what lies above half the height of a spot."""
    half = math.ceil(diameter)
    middle = start
    for _ in range(3):
        column = int(np.clip(round(middle[0]), half, values.shape[1] - 1 - half))
        row = int(np.clip(round(middle[1]), half, values.shape[0] - 1 - half))
        patch = values[row - half : row + half + 1, column - half : column + half + 1]
        y, x = np.mgrid[-half : half + 1, -half : half + 1]
        away = np.hypot(x + column - middle[0], y + row - middle[1])
        ground = np.median(patch[away > 0.8 * diameter])
        peak = np.percentile(patch[away < 0.3 * diameter], 75)
        weight = np.clip(patch - 0.5 * (ground + peak), 0.0, None) * (away < 0.8 * diameter)
        weight = np.minimum(weight, 0.5 * abs(peak - ground))
        total = weight.sum()
        if total <= 0.0:
            break
        middle = np.array([column + (weight * x).sum() / total, row + (weight * y).sum() / total])
    return middle


# Points.


def track_markers(
    table: PixelTable, cameras: CameraSet, *, options: TrackOptions = TrackOptions()
) -> Track:
    """Match the markers of two cameras or more and place them in space.

    Parameters
    ----------
    table : PixelTable
        From `read_pixels` or `find_pixels`.
    cameras : CameraSet
        Two or more.
    options : TrackOptions

    Returns
    -------
    Track
        The uncertainty of a point is that of its pixels, through the triangulation, and that of
        the calibration. A marker whose rays miss each other by more than 20 standard uncertainties
        of a pixel has no point.
    """
    if len(cameras.cameras) < 2:
        raise InputError("one camera is given: points in space need two")
    pixels, swapped = _match_markers(table.pixels, cameras, options.pixel_uncertainty)
    points = cameras.triangulate(pixels)
    free = 2 * len(cameras.cameras) - 3
    squares = _square_misses(cameras.cameras, pixels, points) / free
    known = squares[np.isfinite(squares)]
    # The median of chi-square with one degree of freedom is 0.455.
    seen = math.sqrt(float(np.median(known)) / 0.455) if known.size > 5 else 0.0
    uncertainty = max(options.pixel_uncertainty, seen)
    misses = np.sqrt(squares)
    refused = misses > REFUSED * uncertainty
    # A point behind a camera has no residual.
    lost = refused | ~np.isfinite(misses)
    points = np.where(lost[..., None], np.nan, points)
    covariance = _propagate(points, cameras, uncertainty) + cameras.calibration_covariance(pixels)
    covariance = np.where(lost[..., None, None], np.nan, covariance)
    coarse = uncertainty > COARSE * options.pixel_uncertainty
    inside = cameras.covers(pixels)
    rows = []
    for k, (why, note) in enumerate(zip(table.reasons, table.notes, strict=True)):
        for i in range(len(table.markers)):
            words = [note] if note else []
            words += ["markers_swapped"] if table.named and swapped[k] else []
            far = misses[k, i] > FLAGGED * uncertainty
            words += ["rays_miss"] if far or (coarse and not lost[k, i]) else []
            words += ["outside_calibrated_area"] if misses[k, i] >= 0.0 and not inside[k, i] else []
            reason = why
            if not why and math.isnan(misses[k, i]):
                reason = _explain_nothing(pixels[:, k, i], cameras)
            elif not why and refused[k, i]:
                reason = f"rays miss each other by {misses[k, i]:.1f} px"
            verdict = "failed" if reason else "flagged" if words else "ok"
            rows.append((verdict, ";".join(words), reason))
    return Track(
        markers=table.markers,
        points=points,
        covariance=covariance,
        misses=misses,
        pixels=pixels,
        pixel_uncertainty=uncertainty,
        status=tuple(verdict for verdict, _, _ in rows),
        flags=tuple(words for _, words, _ in rows),
        reasons=tuple(reason for _, _, reason in rows),
        options=options,
        world=cameras.world,
        copied=table.copied,
    )


def _explain_nothing(pixels: Floats, cameras: CameraSet) -> str:
    """Return why the pixels (c, 2) of a marker give no point."""
    for pixel, name, camera in zip(pixels, cameras.names, cameras.cameras, strict=True):
        if np.any(pixel < -0.5) or np.any(pixel > np.array(camera.size) - 0.5):
            x, y = pixel.tolist()
            width, height = camera.size
            return f"({x:g}, {y:g}) is outside the {width} x {height} px of camera {name}"
    if np.isfinite(pixels).all(axis=1).sum() < 2:
        return "not seen by two cameras"
    return "its rays do not meet in front of the cameras: are the cameras confused?"


def write_track(
    found: Track,
    directory: str | os.PathLike[str],
    *,
    manifest: Manifest,
    cameras: CameraSet,
    inputs: Sequence[Path] = (),
    force: bool = False,
) -> Json:
    """Write a track into a new directory and return its summary.

    It holds ``points.csv`` (a row for each marker of each row of the table: place, standard
    uncertainty and covariance with units in the names of the columns, status and reason),
    ``picture.png``, ``summary.json``, and ``overlays`` of the pictures where there are any.

    Raises
    ------
    OutputError
        If the directory exists (without `force`) or cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 5.5))
    found.plot(figure.add_subplot())
    with new_directory(directory, force=force) as folder:
        write_table(folder / "points.csv", found.list_table(), digits=9)
        figure.savefig(folder / "picture.png", dpi=150.0)
        names = [name for name in cameras.names if name in found.copied]
        pictures = [
            (manifest.find_picture(row, name), i, k)
            for i, name in enumerate(names)
            for k, row in enumerate(manifest.rows)
        ]
        for path, i, k in pictures:
            _write_overlay(folder / "overlays" / f"{k + 1:04d}_{names[i]}.jpg", path, found, i, k)
        return write_summary(
            folder,
            settings=found.options,
            inputs=[*inputs, *(path for path, _, _ in pictures)],
            result=found.to_dict(),
        )


def _write_overlay(target: Path, path: Path, found: Track, camera: int, row: int) -> None:
    """Draw the markers of a row over the picture of a camera, if there is one."""
    try:
        picture = read_picture(path)
    except FileFormatError:
        return
    target.parent.mkdir(exist_ok=True)
    count = len(found.markers)
    status = found.status[row * count : (row + 1) * count]
    reasons = sorted({text for text in found.reasons[row * count : (row + 1) * count] if text})
    strokes = [Stroke(found.pixels[camera, row], crosses=True)]
    write_overlay(target, picture, strokes, reasons, refused="failed" in status)


def _square_misses(cameras: Sequence[Camera], pixels: Floats, points: Floats) -> Floats:
    """Return the sum of squares of the residuals of each point [px^2]."""
    off = [own - camera.project(points) for own, camera in zip(pixels, cameras, strict=True)]
    return np.asarray(np.sum(np.square(off), axis=(0, -1)))


def _match_markers(
    pixels: Floats, cameras: CameraSet, uncertainty: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return pixels with markers that belong together, and in which rows that changed their order.

    An order other than the table's is taken where with it more rays meet, or markers move less.
    """
    count = pixels.shape[2]
    orders = [np.array(order) for order in itertools.permutations(range(count))]
    matched = pixels.copy()
    most = (REFUSED * uncertainty) ** 2
    for i in range(1, len(cameras.cameras)):
        pair = [cameras.cameras[0], cameras.cameras[i]]
        own, other = np.broadcast_arrays(pixels[0][:, :, None], pixels[i][:, None])
        both = np.stack([own, other])
        squares = _square_misses(pair, both, triangulate(pair, both))
        squares = np.minimum(np.where(np.isnan(squares), most, squares), most)
        costs = np.stack([squares[:, range(count), order].sum(axis=1) for order in orders])
        best = np.where(costs[0] - costs.min(axis=0) > 0.5 * most, costs.argmin(axis=0), 0)
        for k in np.flatnonzero(best).tolist():
            matched[i, k] = pixels[i, k, orders[best[k]]]
    points = cameras.triangulate(matched)
    good = _square_misses(cameras.cameras, matched, points) < most
    points = np.where(good[..., None], points, np.nan)
    before = points[0].copy()
    for k in range(len(points)):
        moves = [np.linalg.norm(points[k, order] - before, axis=1) for order in orders]
        costs = np.array([np.nansum(move**2) for move in moves])
        if np.isfinite(before).all() and costs.min() < 0.25 * costs[0]:
            order = orders[int(costs.argmin())]
            matched[:, k], points[k] = matched[:, k, order], points[k, order]
        before = np.where(np.isnan(points[k]), before, points[k])
    changed = (matched != pixels) & np.isfinite(pixels)
    return matched, np.asarray(changed.any(axis=(0, 2, 3)))


def _propagate(points: Floats, cameras: CameraSet, uncertainty: float) -> Floats:
    """Return the covariance of points (..., 3, 3) from that of their pixels [mm^2]."""
    step = 1e-3
    information = np.zeros((*points.shape, 3))
    for camera in cameras.cameras:
        slope = np.stack(
            [
                (camera.project(points + step * axis) - camera.project(points - step * axis))
                / (2.0 * step)
                for axis in np.eye(3)
            ],
            axis=-1,
        )
        information += np.einsum("...ki,...kj->...ij", slope, slope)
    whole = np.isfinite(information).all(axis=(-2, -1))
    covariance = np.full_like(information, np.nan)
    covariance[whole] = uncertainty**2 * np.linalg.inv(information[whole])
    return covariance
