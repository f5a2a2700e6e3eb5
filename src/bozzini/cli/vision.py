"""``bozzini vision``: from pictures to measured lengths, shapes and points."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..results import format_rows
from ..vision.calibrate import CalibrationOptions
from ..vision.length import LengthOptions
from ..vision.planning import DemoOptions, SetupPlanning
from ..vision.shape import ShapeOptions
from ..vision.shape_series import ALIGNMENTS
from ..vision.track import TrackOptions
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    CheckedGroup,
    Command,
    QuantityType,
    answer_options,
    gather,
    option,
    options_of,
    run_exit,
)
from .task import make_command

if TYPE_CHECKING:
    from ..results import Json
    from ..vision.board import StripBoard
    from ..vision.calibrate import CameraCalibration
    from ..vision.camera import Camera
    from ..vision.series import LengthSeries
    from ..vision.shape_series import ShapeSeries
    from ..vision.track import Track


@click.group("vision", cls=CheckedGroup)
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
table_argument = click.argument("table", metavar="TABLE.csv", type=INPUT)


def board_option(help: str, *, required: bool = True) -> Callable[[Command], Command]:
    """Return the option ``--board``, the file that describes a board."""
    return option("--board board_file BOARD.yaml", help, INPUT, required=required)


def cameras_option(help: str, *, required: bool = True) -> Callable[[Command], Command]:
    """Return the option ``--cameras``, a file of calibrated cameras."""
    return option("--cameras cameras_file CAMERAS.yaml", help, INPUT, required=required)


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
@click.argument("folder", metavar="FOLDER", type=INPUT)
@board_option("The description of the board.")
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


def _describe_calibration(found: CameraCalibration, target: Path) -> str:
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
@table_argument
@cameras_option("The calibrated cameras.")
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


length_options = options_of(LengthOptions, "options")


@dataclasses.dataclass(frozen=True)
class LengthFiles:
    """Files of the board, and of the camera if it is calibrated."""

    board_file: Path
    cameras_file: Path | None

    def load(self) -> tuple[StripBoard, Camera | None]:
        """Return both, or raise `InputError`."""
        from ..vision.board import load_strips
        from ..vision.camera import load_cameras

        board = load_strips(self.board_file)
        if self.cameras_file is None:
            return board, None
        cameras = load_cameras(self.cameras_file).cameras
        if len(cameras) != 1:
            raise InputError(f"{self.cameras_file} has {len(cameras)} cameras: lengths need one")
        return board, cameras[0]


file_options = gather(
    "files",
    LengthFiles,
    board_option("The description of the board of strips."),
    cameras_option("The calibrated camera; without it --distance is needed.", required=False),
)


@command.command("length")
@table_argument
@file_options
@length_options
@jobs_option
@strict_option
@answer_options(
    required=True,
    metavar="DIR",
    help="Directory to make: lengths.csv, summary.csv, contractions.csv, overlays.",
)
def length_command(
    table: Path,
    files: LengthFiles,
    options: LengthOptions,
    jobs: int,
    strict: bool,
    answer: Answer,
) -> None:
    """Measure the length between two ring marks of a muscle in the pictures of TABLE.

    TABLE has a row for each picture, with the columns image (relative to the table) and
    pressure_kpa and, if there, specimen, direction (inflate, deflate, none), load_n, setpoint_kpa
    (by which repeats belong together where the pressure is a measured one), and override_x1,
    override_y1, override_x2, override_y2 for marks that a person sets. Other columns are kept.
    Contractions are from the rows without pressure; contractions.csv is what 'bozzini muscle fit'
    reads. Exit code 0: all lengths are there; 1: some are not, and have the reason in their row;
    2: bad input.
    """
    from ..io.files import reserve_directory
    from ..vision.pictures import read_manifest
    from ..vision.series import measure_series, write_series

    board, camera = files.load()
    inputs = [table, files.board_file, *([files.cameras_file] if files.cameras_file else [])]
    manifest = read_manifest(table, ("image", "pressure_kpa"))
    with reserve_directory(answer.target, force=answer.force):
        with answer.show_progress() as progress:
            found = measure_series(
                manifest, board, options=options, camera=camera, jobs=jobs, progress=progress
            )
        summary = write_series(found, answer.target, inputs=inputs, force=answer.force)
    answer.give(summary | {"directory": answer.target}, _describe_lengths(found, answer.target))
    if not found.converged or (strict and "flagged" in found.status):
        run_exit(EXIT_NEGATIVE)


def _describe_lengths(found: LengthSeries, target: Path) -> str:
    counts = {word: found.status.count(word) for word in ("ok", "flagged", "failed")}
    listed = ", ".join(f"{count} {word}" for word, count in counts.items())

    def show(value: float | None) -> str:
        return "" if value is None else f"{value:.3f}"

    rows = [
        [
            item["specimen"],
            f"{item['load_n']:g}",
            f"{item['pressure_kpa']:g}",
            item["direction"],
            str(item["n"]),
            *(
                show(item[name])
                for name in ("length_mm", "U95_mm", "contraction_mm", "U95_contraction_mm")
            ),
        ]
        for item in found.summarise()
    ]
    head = ["specimen", "load [N]", "p [kPa]", "direction", "n"]
    head += ["length [mm]", "U95", "contraction [mm]", "U95"]
    lines = [f"{len(found.rows)} pictures: {listed}", format_rows(head, rows)]
    lines += [f"Failed: {found.reason}"] if found.reason else []
    return "\n".join([*lines, f"Results: {target}"])


@command.command("demo")
@options_of(DemoOptions, "options")
@answer_options(required=True, metavar="DIR", help="Directory to make.")
def demo_command(options: DemoOptions, answer: Answer) -> None:
    """Render the pictures of an inflating muscle of known model, with all files to measure them.

    The directory holds manifest.csv, pictures, board.yaml, board.pdf, cameras.yaml, and the truth:
    truth.csv and summary.json.
    """
    from ..io.files import reserve_directory
    from ..vision.planning import DEMO_LENGTH, write_demo

    with reserve_directory(answer.target, force=answer.force):
        with answer.show_progress() as progress:
            summary = write_demo(
                answer.target, options=options, force=answer.force, progress=progress
            )
    known = DEMO_LENGTH
    target = answer.target
    text = (
        f"{summary['pictures']} pictures. Measure them, and fit a model to their contractions, by\n"
        f"  bozzini vision length {target}/manifest.csv --board {target}/board.yaml "
        f"--cameras {target}/cameras.yaml --height {known.height:g}mm "
        f"--diameter {known.diameter:g}mm --ring {known.ring:g}mm "
        f"--height-uncertainty {known.height_uncertainty:g}mm "
        f"--tilt-uncertainty {known.tilt_uncertainty:g}rad --out lengths\n"
        "  bozzini muscle fit lengths/contractions.csv --preset effector-45"
    )
    answer.give(summary | {"directory": target}, text)


command.add_command(make_command(SetupPlanning))


@command.command("shape")
@table_argument
@cameras_option("The two calibrated cameras.")
@options_of(ShapeOptions, "options")
@click.option(
    "--model",
    "model_file",
    metavar="MODEL.csv",
    type=INPUT,
    help="Curves to compare with: columns pose, x_mm, y_mm, z_mm, in order from the base. Without "
    "pose it is one curve for all rows.",
)
@click.option(
    "--alignment",
    type=click.Choice(ALIGNMENTS),
    default="base",
    show_default=True,
    help="Frame of these: of the base, +z along the tube, or the cameras' world.",
)
@click.option("--parquet", is_flag=True, help="Write the tables as .parquet instead of .csv.")
@jobs_option
@strict_option
@answer_options(
    required=True,
    metavar="DIR",
    help="Directory to make: shape_points.csv, shape_summary.csv, overlays.",
)
def shape_command(
    table: Path,
    cameras_file: Path,
    options: ShapeOptions,
    jobs: int,
    strict: bool,
    answer: Answer,
    **given: Path | str | bool | None,
) -> None:
    """Measure the shape of a tube in pairs of pictures, with its uncertainty.

    TABLE has a row for each pair, a column with the name of each camera for the pictures, and
    perhaps a column pose; other columns are copied. The tube is bright on a dark ground, with a
    dark ring near its base and its tip. Exit code 0: all shapes are there; 1: some are refused or
    failed, and have the reason in their row; 2: bad input.
    """
    from ..io.files import check_parquet, reserve_directory
    from ..vision.camera import load_cameras
    from ..vision.pictures import read_manifest
    from ..vision.shape_series import compare_shapes, measure_shapes, read_model, write_shapes

    cameras = load_cameras(cameras_file)
    if len(cameras.names) != 2:
        raise InputError(f"{cameras_file}: {len(cameras.names)} cameras: a shape needs two")
    manifest = read_manifest(table, cameras.names)
    numbers = [row.get("pose", str(k + 1)) for k, row in enumerate(manifest.rows)]
    file = given["model_file"]
    curves = read_model(str(file), numbers) if file else []
    if given["parquet"]:
        check_parquet()
    with reserve_directory(answer.target, force=answer.force):
        with answer.show_progress() as progress:
            found = measure_shapes(manifest, cameras, options=options, jobs=jobs, progress=progress)
        known = [k for k, shape in enumerate(found.shapes) if shape is not None]
        comparison = None
        if curves and known:
            comparison = compare_shapes(
                [shape for shape in found.shapes if shape is not None],
                [curves[k] for k in known],
                names=[numbers[k] for k in known],
                alignment=str(given["alignment"]),
            )
        summary = write_shapes(
            found,
            answer.target,
            cameras=cameras,
            comparison=comparison,
            inputs=(table, cameras_file, *([Path(str(file))] if file else [])),
            parquet=bool(given["parquet"]),
            force=answer.force,
        )
    answer.give(summary | {"directory": answer.target}, _describe_shapes(found, summary))
    if not found.converged or (strict and summary["flagged"]):
        run_exit(EXIT_NEGATIVE)


def _describe_shapes(found: ShapeSeries, summary: Json) -> str:
    rows = [
        [name, row["status"]]
        + (
            [
                ", ".join(f"{row[f'tip_{axis}_mm']:.2f}" for axis in "xyz"),
                f"{row['u_tip_mm']:.3f}",
                row["flags"],
            ]
            if row["status"] != "failed"
            else ["-", "-", row["reason"]]
        )
        for name, row in zip(found.names, found.rows, strict=True)
    ]
    text = format_rows(["pose", "status", "tip [mm]", "u [mm]", "flags or reason"], rows)
    if "comparison" in summary and summary["comparison"]["converged"]:
        far = summary["comparison"]
        text += (
            f"\nModel: {far['rms_mm']:.2f} mm rms from the measured shapes, "
            f"{far['tip_greatest_mm']:.2f} mm at most at the tip"
        )
    return text
