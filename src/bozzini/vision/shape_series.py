"""Shapes of a tube in many pairs of pictures, their files, and how far a model is from them."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_points, check_word
from ..errors import BozziniError, FileFormatError, InputError
from ..io.files import new_directory
from ..numeric.arrays import Floats
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from ..progress import Progress, no_progress
from ..results import DRAWN_LIMIT, Json, ReasonedResult, Result, take_axes, to_plain
from .camera import CameraSet
from .pictures import (
    BLUE,
    GREEN,
    RED,
    YELLOW,
    Manifest,
    Stroke,
    measure_each,
    read_manifest,
    read_picture,
    write_overlay,
    write_summary,
    write_tables,
)
from .shape import BackboneShape, ShapeOptions, find_plane, measure_shape

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ALIGNMENTS = ("base", "world")
"""Where a model's curves are: in a frame of their own with the base at its origin and +z along the
tube there, or in the world of the cameras."""

_NAMED = 12
"""Poses that a figure names."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeComparison(ReasonedResult):
    """How far curves of a model are from measured shapes.

    Attributes
    ----------
    names : tuple of str
        Of the poses that have both.
    arc_length : ndarray, shape (p, n)
        From the base [mm].
    measured, predicted : ndarray, shape (p, n, 3)
        In the world of the cameras [mm]; a model that is shorter is taken at its end.
    uncertainty : ndarray, shape (p, n)
        Standard uncertainty of a measured point along its distance from the model [mm].
    reason : str
        Why there is nothing to compare.
    """

    names: tuple[str, ...]
    arc_length: Floats
    measured: Floats
    predicted: Floats
    uncertainty: Floats
    reason: str = ""

    @property
    def distances(self) -> Floats:
        """Distance of each point from the model's at the same arc length, shape (p, n) [mm]."""
        return np.asarray(np.linalg.norm(self.measured - self.predicted, axis=2))

    @property
    def residual(self) -> float:
        """Root mean square of the distances [mm]."""
        return math.sqrt(float(np.mean(self.distances**2))) if self.names else math.nan

    def to_dict(self) -> Json:
        """Return a summary as plain values with units in their names."""
        tips = self.distances[:, -1] if self.names else np.full(1, np.nan)
        values = {
            "rms_mm": self.residual,
            "greatest_mm": float(self.distances.max()) if self.names else math.nan,
            "tip_rms_mm": math.sqrt(float(np.mean(tips**2))),
            "tip_greatest_mm": float(tips.max()),
        }
        return {
            "converged": self.converged,
            "reason": self.reason,
            "poses": len(self.names),
            **to_plain(values),
        }

    def list_columns(self) -> Json:
        """Return a row for each point of each pose."""
        n = self.arc_length.shape[1] if self.names else 0
        columns: Json = {"pose": np.repeat(self.names, n), "s_mm": self.arc_length.ravel()}
        for word, curves in (("measured", self.measured), ("model", self.predicted)):
            for k, axis in enumerate("xyz"):
                columns[f"{word}_{axis}_mm"] = curves[..., k].ravel()
        return columns | {
            "distance_mm": self.distances.ravel(),
            "u_distance_mm": self.uncertainty.ravel(),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw measured shapes and the model in the plane they bend in most; return the axes."""
        ax = take_axes(ax, x="across the base [mm]", y="along the base [mm]", equal=True)
        base = self.measured[:, 0].mean(axis=0)
        measured, predicted = self.measured - base, self.predicted - base
        up = _find_mean(measured[:, 1] - measured[:, 0])
        plane = find_plane(np.concatenate([measured, predicted]).reshape(-1, 3), up)
        for p, name in enumerate(self.names[:DRAWN_LIMIT]):
            (dots,) = ax.plot(*(plane @ measured[p].T), "o", markersize=3, label=name)
            ax.plot(*(plane @ predicted[p].T), color=dots.get_color(), linewidth=1.2)
        ax.plot([], [], "o", color="0.3", markersize=3, label="measured")
        ax.plot([], [], color="0.3", linewidth=1.2, label="model")
        if len(self.names) <= _NAMED:
            ax.legend(loc="best", fontsize="small")
        return ax

    def plot_distances(self, ax: Axes | None = None) -> Axes:
        """Draw how far each point is from the model, with its uncertainty; return the axes."""
        ax = take_axes(ax, x="arc length from the base [mm]", y="measured from model [mm]")
        for p in range(len(self.names[:DRAWN_LIMIT])):
            s, off, wide = self.arc_length[p], self.distances[p], 2.0 * self.uncertainty[p]
            (line,) = ax.plot(s, off, "o-", markersize=3, linewidth=0.8)
            ax.fill_between(s, off - wide, off + wide, color=line.get_color(), alpha=0.12, lw=0.0)
        ax.set_ylim(bottom=0.0)
        ax.set_title("bands: 2 standard uncertainties", fontsize="small")
        return ax


def _find_mean(directions: Floats) -> Floats:
    """Return the mean direction (3,) of vectors (p, 3)."""
    mean = np.sum(directions / np.linalg.norm(directions, axis=1)[:, None], axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def compare_shapes(
    shapes: Sequence[BackboneShape],
    curves: Sequence[Floats],
    *,
    names: Sequence[str] = (),
    alignment: str = "base",
) -> ShapeComparison:
    """Compare measured shapes with the curves of a model, such as of an end-effector or a robot.

    Parameters
    ----------
    shapes : sequence of BackboneShape
        Those that were refused are left out.
    curves : sequence of array_like, shape (k, 3)
        Points along the model's axis from the base on, one curve a shape [mm].
    names : sequence of str
        Of the poses; by default their numbers from 1.
    alignment : str
        "base": the model's frame has its origin at the base and +z along the tube there; it is put
        at the mean of the measured bases, and turned about the tube there, once for all shapes, so
        that both are nearest. "world": the curves are in the world of the cameras.

    Returns
    -------
    ShapeComparison
    """
    check_word("alignment", alignment, ALIGNMENTS)
    if len(shapes) != len(curves) or not shapes:
        raise InputError(f"{len(shapes)} shapes and {len(curves)} curves: give one curve a shape")
    words = tuple(names) or tuple(str(k + 1) for k in range(len(shapes)))
    paths = [check_points(f"curve {word}", path) for word, path in zip(words, curves, strict=True)]
    for word, path in zip(words, paths, strict=True):
        if path.ndim != 2 or len(path) < 2:
            raise InputError(f"curve {word} must be (k, 3) points, two or more")
    kept = [k for k, shape in enumerate(shapes) if shape.converged]
    if not kept:
        empty = np.zeros((0, 0, 3))
        return ShapeComparison(
            names=(),
            arc_length=empty[..., 0],
            measured=empty,
            predicted=empty,
            uncertainty=empty[..., 0],
            reason="all shapes were refused",
        )
    measured = np.stack([shapes[k].points for k in kept])
    stations = np.stack([shapes[k].arc_length for k in kept])
    predicted = np.stack(
        [
            interpolate_polyline(paths[k], measure_arc_length(paths[k]), own)
            for k, own in zip(kept, stations, strict=True)
        ]
    )
    if alignment == "base":
        starts = np.stack([shapes[k].tangents[0] for k in kept])
        predicted = _place_at_base(predicted, measured, _find_mean(starts))
    off = measured - predicted
    size = np.linalg.norm(off, axis=2)
    ahead = off / np.maximum(size, 1e-12)[..., None]
    covariance = np.stack([shapes[k].covariance for k in kept])
    along = np.einsum("pni,pnij,pnj->pn", ahead, covariance, ahead)
    return ShapeComparison(
        names=tuple(words[k] for k in kept),
        arc_length=stations,
        measured=measured,
        predicted=predicted,
        uncertainty=np.sqrt(along),
    )


def _place_at_base(predicted: Floats, measured: Floats, up: Floats) -> Floats:
    """Return curves of a model turned about +z and put at the mean base of measured ones."""
    base = measured[:, 0].mean(axis=0)
    aside = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = np.cross(aside, up) / np.linalg.norm(np.cross(aside, up))
    axes = np.stack([first, np.cross(up, first), up])
    own = (measured - base) @ axes.T
    # Only what lies across the base decides on the turn about it.
    flat = [curves.reshape(-1, 3) * (1.0, 1.0, 0.0) for curves in (predicted, own)]
    mixed = flat[0].T @ flat[1]
    angle = math.atan2(mixed[0, 1] - mixed[1, 0], mixed[0, 0] + mixed[1, 1])
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(predicted @ turn.T @ axes + base)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeSeries(Result):
    """Shapes of a table of pairs of pictures, row by row.

    Attributes
    ----------
    manifest : Manifest
        The table.
    names : tuple of str
        Of the poses: its column ``pose``, or the numbers of its rows.
    rows : tuple of dict
        A summary of each shape, with status, flags and reason.
    shapes : tuple of BackboneShape or None
        None where a picture could not be read.
    """

    manifest: Manifest
    names: tuple[str, ...]
    rows: tuple[Json, ...]
    shapes: tuple[BackboneShape | None, ...]

    @property
    def converged(self) -> bool:
        """Whether all shapes were measured."""
        return all(row["status"] != "failed" for row in self.rows)

    @property
    def reason(self) -> str:
        """Why not; empty if none failed."""
        failed = [k for k, row in enumerate(self.rows) if row["status"] == "failed"]
        if not failed:
            return ""
        first = failed[0]
        words = f"pose {self.names[first]}: {self.rows[first]['reason']}"
        return f"{len(failed)} of {len(self.rows)} shapes failed ({words})"

    @property
    def residual(self) -> float:
        """The largest residual of a shape that was measured [px]."""
        return max((s.residual for s in self.shapes if s is not None and s.converged), default=0.0)

    def to_dict(self) -> Json:
        """Return a summary as plain values."""
        counts = {
            word: sum(row["status"] == word for row in self.rows)
            for word in ("ok", "flagged", "failed")
        }
        return {"converged": self.converged, "reason": self.reason, **counts}

    def list_columns(self) -> Json:
        """Return a row for each pair of pictures: the table's cells, then the shape's summary."""
        known = next((row for row in self.rows if len(row) > 2), {})
        names = [*known, *(name for name in ("status", "reason") if name not in known)]
        copied = {name: [row[name] for row in self.manifest.rows] for name in self.manifest.columns}
        return copied | {name: [row.get(name) for row in self.rows] for name in names}

    def list_points(self) -> Json:
        """Return columns with a row for each point of each shape that was measured."""
        tables = [
            {"pose": np.full(len(shape.points), name), **shape.list_columns()}
            for name, shape in zip(self.names, self.shapes, strict=True)
            if shape is not None and shape.converged
        ]
        names = tables[0] if tables else ("pose", "s_mm")
        return {name: [cell for table in tables for cell in table[name]] for name in names}


def measure_shapes(
    manifest: Manifest,
    cameras: CameraSet,
    *,
    options: ShapeOptions = ShapeOptions(),
    jobs: int = 1,
    progress: Progress = no_progress,
) -> ShapeSeries:
    """Measure the shapes of a table with a column of pictures for each of two cameras.

    A row whose pictures are missing or cannot be read, or whose shape is refused, has its reason.
    """
    items = [
        tuple(manifest.find_picture(row, name) for name in cameras.names) for row in manifest.rows
    ]
    work = partial(_measure_row, cameras=cameras, options=options)
    rows = measure_each(items, work, jobs=jobs, stage="measure shapes", progress=progress)
    shapes = tuple(row.pop("shape", None) for row in rows)
    named = "pose" in manifest.columns
    names = [row["pose"] if named else str(k + 1) for k, row in enumerate(manifest.rows)]
    return ShapeSeries(manifest=manifest, names=tuple(names), rows=tuple(rows), shapes=shapes)


def _measure_row(paths: Sequence[Path], cameras: CameraSet, options: ShapeOptions) -> Json:
    for name, path in zip(cameras.names, paths, strict=True):
        if os.path.isdir(path):  # an empty cell is the table's own folder
            raise FileFormatError(f"{path}: no picture of camera '{name}'")
    pictures = [read_picture(path) for path in paths]
    shape = measure_shape(pictures, cameras, options=options)
    return {**shape.list_summary(), "shape": shape}


def read_model(path: str | os.PathLike[str], names: Sequence[str]) -> list[Floats]:
    """Read a model's curves from a table with columns pose, x_mm, y_mm, z_mm, in order of `names`.

    Without the column pose the table is one curve, that of all names: so do ``bozzini effector
    pose`` and ``bozzini continuum pose`` write it.

    Raises
    ------
    FileFormatError
        If a pose has fewer than two points, or a cell is no number.
    """
    table = read_manifest(path, ("x_mm", "y_mm", "z_mm"))
    points: dict[str, list[list[float]]] = {}
    for number, row in enumerate(table.rows, start=1):
        try:
            place = [float(row[f"{axis}_mm"]) for axis in "xyz"]
        except ValueError:
            place = [math.nan]
        if not np.isfinite(place).all():
            raise FileFormatError(f"{table.path}: row {number} must have numbers as x, y and z")
        points.setdefault(row.get("pose", ""), []).append(place)
    poses = names if "pose" in table.columns else [""] * len(names)
    for pose in poses:
        if len(points.get(pose, [])) < 2:
            where = f"pose '{pose}'" if pose else "a curve"
            raise FileFormatError(f"{table.path}: {where} needs two points or more")
    return [np.array(points[pose]) for pose in poses]


def write_shapes(
    found: ShapeSeries,
    directory: str | os.PathLike[str],
    *,
    cameras: CameraSet,
    comparison: ShapeComparison | None = None,
    inputs: Sequence[Path] = (),
    parquet: bool = False,
    force: bool = False,
) -> Json:
    """Write a series into a new directory and return its summary.

    It holds ``shape_points.csv``, ``shape_summary.csv``, ``summary.json``, ``overlays`` of the
    pictures, and with a comparison ``comparison.csv`` and ``comparison.png``. Tables are .parquet
    files if that is asked for.

    Raises
    ------
    OutputError
        If the directory exists (without `force`) or cannot be written.
    """
    from matplotlib.figure import Figure

    result = found.to_dict()
    options = next((s.options for s in found.shapes if s is not None), None)
    with new_directory(directory, force=force) as folder:
        tables = {"shape_points": found.list_points(), "shape_summary": found.list_table()}
        if comparison is not None:
            result["comparison"] = comparison.to_dict()
            tables["comparison"] = comparison.list_table()
            if comparison.converged:
                figure = Figure(figsize=(10.0, 4.5), layout="constrained")
                for draw, ax in zip(
                    (comparison.plot, comparison.plot_distances), figure.subplots(1, 2), strict=True
                ):
                    draw(ax)
                figure.savefig(folder / "comparison.png", dpi=150.0)
        write_tables(folder, tables, parquet=parquet)
        paths = []
        for k, row in enumerate(found.manifest.rows):
            for i, name in enumerate(cameras.names):
                paths.append(found.manifest.find_picture(row, name))
                _write_overlay(
                    folder / "overlays" / f"{k + 1:04d}_{name}.jpg", paths[-1], found, k, i
                )
        return write_summary(folder, settings=options, inputs=[*inputs, *paths], result=result)


def _write_overlay(target: Path, path: Path, found: ShapeSeries, row: int, camera: int) -> None:
    """Draw what was found in a picture over it, if it can be read."""
    try:
        picture = read_picture(path)
    except BozziniError:
        return
    target.parent.mkdir(exist_ok=True)
    shape, summary = found.shapes[row], found.rows[row]
    strokes: list[Stroke] = []
    text = [summary["reason"]] if summary["reason"] else []
    if shape is not None:
        strokes += [Stroke(shape.centrelines[camera], BLUE)] if shape.centrelines else []
        color = RED if shape.reason else GREEN
        strokes += [Stroke(limb, color) for limb in shape.limbs[camera]] if shape.limbs else []
        strokes.append(Stroke(shape.ring_pixels[camera], YELLOW, crosses=True))
        if shape.converged:
            place = ", ".join(f"{value:.2f}" for value in shape.tip)
            text.append(f"tip ({place}) mm, u {shape.tip_uncertainty:.3f} mm")
        text += [";".join(shape.flags)] if shape.flags else []
    write_overlay(target, picture, strokes, text, refused=summary["status"] == "failed")
