"""``bozzini vision``: from pictures to measured lengths, shapes and points."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..vision.calibrate import CalibrationOptions
from ..vision.track import TrackOptions
from .common import (
    EXIT_NEGATIVE,
    Answer,
    QuantityType,
    answer_options,
    format_rows,
    options_of,
    run_exit,
)

if TYPE_CHECKING:
    from ..vision.calibrate import Calibration
    from ..vision.track import Track


@click.group("vision")
def command() -> None:
    """Measure lengths, shapes and points in pictures."""


jobs_option = click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    default=max(1, min(4, os.cpu_count() or 1)),
    show_default="up to 4",
    help="Pictures read at the same time.",
)
strict_option = click.option("--strict", is_flag=True, help="Exit code 1 for what is flagged, too.")


@command.command("board")
@click.argument("kind", type=click.Choice(["charuco", "strips", "checkerboard"]))
@click.option("--columns", type=int, help="Squares across; of a checkerboard, inner corners.")
@click.option("--rows", type=int, help="Squares down; of a checkerboard, inner corners.")
@click.option("--square", type=QuantityType("length"), help="Side of a square.")
@click.option("--gap", type=QuantityType("length"), help="Width of the window between strips.")
@click.option("--first-marker", type=int, help="Number of the first marker of a charuco board.")
@click.option(
    "--check-line", type=QuantityType("length"), help="The printed bar of 100 mm, by the caliper."
)
@answer_options(
    quiet=False, required=True, help="The page (.pdf); the description (.yaml) is put beside it."
)
def board_command(kind: str, answer: Answer, **given: float | None) -> None:
    """Write a board to print at its true scale, and the file that describes it.

    A charuco board and a checkerboard are for calibration, strips for muscles that hang between
    them. Below the board is a bar of 100 mm: write what it measures on the print as check_line in
    the description (.yaml), and all lengths are put right by it. For a board that is printed
    already only the description counts.
    """
    from ..io.files import check_new_file
    from ..vision.board import KINDS

    known = KINDS[kind]
    values = {name: value for name, value in given.items() if value is not None}
    for name in values:
        if name not in known.__dataclass_fields__:
            raise InputError(f"--{name.replace('_', '-')} has no effect on a {kind} board")
    board = known(**values)
    check_new_file(answer.target, (".pdf",), force=answer.force)
    beside = answer.target.with_suffix(".yaml")
    check_new_file(beside, (".yaml",), force=answer.force)
    board.write_pdf(answer.target)
    board.save(beside)
    width, height = board.extent
    answer.give(
        {
            "file": answer.target,
            "description": beside,
            "kind": kind,
            "width_mm": width,
            "height_mm": height,
            "corners": len(board.nominal_corners),
        },
        f"{answer.target}: {kind}, {width:g} x {height:g} mm; print it at 100 %, measure the bar "
        f"and write its length into {beside}",
    )


@command.command("calibrate")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path))
@click.option(
    "--board",
    "board_file",
    metavar="BOARD.yaml",
    type=click.Path(path_type=Path),
    required=True,
    help="The description of the board.",
)
@options_of(CalibrationOptions, "options")
@jobs_option
@answer_options(
    required=True, help="The cameras (.yaml, .json); a picture of the corners is put beside it."
)
def calibrate_command(
    folder: Path, board_file: Path, options: CalibrationOptions, jobs: int, answer: Answer
) -> None:
    """Calibrate one camera or two from the pictures of a board in FOLDER.

    Pictures are named by camera and view, such as cam0_01.png and cam1_01.png; 8 views or more,
    the board tilted in them. Exit code 0: the cameras are written; 1: the calibration is refused,
    and only the picture is written; 2: bad input.
    """
    from ..io.files import check_new_file
    from ..plot.figures import write_figure
    from ..vision.board import load_board
    from ..vision.calibrate import calibrate_cameras, detect_views

    board = load_board(board_file)
    check_new_file(answer.target, (".yaml", ".yml", ".json"), force=answer.force)
    picture = answer.target.with_suffix(".png")
    check_new_file(picture, (".png",), force=answer.force)
    with answer.show_progress() as progress:
        names, views = detect_views(folder, board, jobs=jobs, progress=progress)
        found = calibrate_cameras(views, board, names, options=options, progress=progress)
    write_figure(found.plot(), picture, dpi=150.0)
    if found.converged:
        found.cameras.save(answer.target)
    file = answer.target if found.converged else None
    result = found.to_dict() | {"file": file, "picture": picture}
    answer.give(result, _describe_calibration(found, answer.target))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _describe_calibration(found: Calibration, target: Path) -> str:
    rows = [
        [
            name,
            f"{camera.focal:.1f}",
            f"{spread:.1f}",
            f"{100.0 * covered:.0f} %",
        ]
        for name, camera, spread, covered in zip(
            found.cameras.names,
            found.cameras.cameras,
            found.focal_uncertainty,
            found.coverage,
            strict=True,
        )
    ]
    used = sum(not view.reason for view in found.views)
    lines = [
        f"{used} of {len(found.views)} views; residuals {found.residual:.3f} px rms",
        format_rows(["camera", "focal length [px]", "u [px]", "coverage"], rows),
    ]
    if len(found.cameras.names) > 1:
        lines.append(
            f"The cameras are {found.cameras.baseline:.2f} mm apart, standard uncertainty "
            f"{found.baseline_uncertainty:.2f} mm"
        )
    held = found.hold_out
    if held.views:
        line = f"In {held.views} views that were left out: {held.rms:.3f} px rms"
        if len(found.cameras.names) > 1:
            line += f", distances of corners {1000.0 * held.length_rms:.0f} um rms"
        lines.append(line)
    lines += [f"Not used: view {view.name}: {view.reason}" for view in found.views if view.reason]
    lines += [f"Note: {flag}" for flag in found.flags]
    verdict = f"Refused: {found.reason}" if found.reason else f"Cameras: {target}"
    return "\n".join([*lines, verdict])


@command.command("track")
@click.argument("table", metavar="TABLE.csv", type=click.Path(path_type=Path))
@click.option(
    "--cameras",
    "cameras_file",
    metavar="CAMERAS.yaml",
    type=click.Path(path_type=Path),
    required=True,
    help="The calibrated cameras.",
)
@options_of(TrackOptions, "options")
@jobs_option
@strict_option
@answer_options(
    required=True, metavar="DIR", help="Directory to make: points.csv, picture.png, overlays."
)
def track_command(
    table: Path,
    cameras_file: Path,
    options: TrackOptions,
    jobs: int,
    strict: bool,
    answer: Answer,
) -> None:
    """Place the markers of TABLE in space, with their uncertainty.

    TABLE has a row for each moment. Its columns are pixels of markers, such as Lx1, Ly1, Rx1, Ry1
    (a camera's name or how it begins, x or y, the marker), or the names of the cameras, with
    pictures relative to the table. Exit code 0: all points are there; 1: some are not, and have
    the reason in their row; 2: bad input.
    """
    from ..io.files import reserve_directory
    from ..vision.camera import load_cameras
    from ..vision.pictures import read_manifest
    from ..vision.track import find_pixels, read_pixels, track_markers, write_track

    cameras = load_cameras(cameras_file)
    manifest = read_manifest(table, ())
    with reserve_directory(answer.target, force=answer.force):
        with answer.show_progress() as progress:
            pictures = set(cameras.names) <= set(manifest.columns)
            if pictures:
                pixels = find_pixels(manifest, cameras, options, jobs=jobs, progress=progress)
            else:
                pixels = read_pixels(manifest, cameras)
            found = track_markers(pixels, cameras, options=options)
        summary = write_track(
            found,
            answer.target,
            manifest=manifest,
            cameras=cameras,
            inputs=(table, cameras_file),
            force=answer.force,
        )
    answer.give(summary | {"directory": answer.target}, _describe_track(found, answer.target))
    if not found.converged or (strict and "flagged" in found.status):
        run_exit(EXIT_NEGATIVE)


def _describe_track(found: Track, target: Path) -> str:
    counts = {word: found.status.count(word) for word in ("ok", "flagged", "failed")}
    lines = [
        f"{len(found.status)} points of {len(found.markers)} markers: "
        + ", ".join(f"{count} {word}" for word, count in counts.items()),
        f"In {found.world}; a pixel is uncertain by {found.pixel_uncertainty:.2f} px",
    ]
    typical = found.to_dict()["median_uncertainty_mm"]
    if typical:
        parts = ", ".join(
            f"{axis} {value:.3f} mm" for axis, value in zip("xyz", typical, strict=True)
        )
        lines.append(f"Standard uncertainty (median): {parts}")
    lines += [f"Failed: {found.reason}"] if found.reason else []
    return "\n".join([*lines, f"Results: {target}"])
