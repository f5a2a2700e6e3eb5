"""Set-ups to measure a muscle's length: predicted before they are built, and rendered.

A planned camera has a predicted uncertainty, from the error budget of a length; rendered pictures
of the same set-up test that prediction. `write_demo` renders a whole series of a muscle of known
model, with the files that a laboratory would have, and the truth.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_fields, check_integer, check_number, quantity
from ..errors import BozziniError
from ..io.files import new_directory, write_text
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import Json, Result, Shown, format_rows, measured, take_axes
from ..task import Task
from .board import StripBoard, load_strips
from .camera import Camera, CameraSet, aim_camera
from .length import LengthOptions, measure_length, predict_budget
from .pictures import Picture, write_picture, write_summary
from .render import HungMuscle, Sensor, render_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SEED_STEP = 100_003


@dataclass(frozen=True, kw_only=True)
class LengthSetup(Shown):
    """A camera in front of a board of strips.

    Parameters
    ----------
    away : float
        Distance of the camera from the middle of the window [mm].
    pitch : float
        Size of a pixel there [mm].
    columns, rows : int
        Of the picture [px]; the window is upright in it if there are more rows than columns.
    oblique : float
        Angle of the line of sight against the normal of the board [rad], along the muscle.
    blur : float
        Standard deviation of the point spread [px].
    noise : float
        Of white, as a share of the full range.
    """

    away: float = quantity("length", "Camera to board.", default=300.0, low=20.0, high=1e4)
    pitch: float = quantity(
        "length", "Size of a pixel on the board.", default=0.057, low=1e-3, high=1.0
    )
    columns: int = quantity(help="Of the picture.", default=1300, low=64, high=2e4, whole=True)
    rows: int = quantity(help="Of the picture.", default=1120, low=64, high=2e4, whole=True)
    oblique: float = quantity(
        "angle", "Line of sight against the board's normal.", default=0.0, low=-1.2, high=1.2
    )
    blur: float = quantity(help="Point spread [px].", default=0.8, low=0.0, high=50.0)
    noise: float = quantity(help="Noise of white.", default=0.012, low=0.0, high=1.0)

    def __post_init__(self) -> None:
        check_fields(self)

    def make_camera(self, board: StripBoard) -> Camera:
        """Return the camera, which looks at the middle of the window."""
        left, top, right, foot = board.window
        target = np.array([0.5 * (left + right), 0.5 * (top + foot), 0.0])
        sight = np.array([0.0, -math.sin(self.oblique), -math.cos(self.oblique)])
        return aim_camera(
            target + self.away * sight,
            target,
            focal=self.away / self.pitch,
            size=(self.columns, self.rows),
            distortion=(-0.12, 0.05, 4e-4, -3e-4, 0.0),
            down=(0.0, 1.0, 0.0) if self.rows > self.columns else (1.0, 0.0, 0.0),
        )

    @property
    def sensor(self) -> Sensor:
        """The camera's sensor."""
        return Sensor(blur=self.blur, noise=self.noise)


@dataclass(frozen=True, kw_only=True, eq=False)
class SetupPlan(Result):
    """The predicted uncertainty of a length, and the errors of rendered pictures.

    Attributes
    ----------
    length : float
        The length that is planned for [mm].
    uncertainty : float
        Predicted standard uncertainty of one length [mm].
    relative : float
        That over the length.
    budget : dict
        Predicted standard uncertainty by cause, see `MuscleLength.budget` [mm].
    corners : int
        Corners of the board in the picture.
    errors : ndarray, shape (n,)
        Measured less true length of the rendered pictures [mm]; NaN where one failed.
    claimed : ndarray, shape (n,)
        Their own standard uncertainty [mm].
    failures : tuple of str
        Why pictures failed.
    """

    length: float = measured("mm")
    uncertainty: float = measured("mm")
    relative: float = measured("")
    budget: dict[str, float]
    corners: int = measured("")
    errors: Floats
    claimed: Floats
    failures: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether no rendered picture failed."""
        return not self.failures

    @property
    def reason(self) -> str:
        """Why one did; empty otherwise."""
        return self.failures[0] if self.failures else ""

    @property
    def residual(self) -> float:
        """Errors over the predicted uncertainty, rms."""
        known = self.errors[np.isfinite(self.errors)]
        return float(np.sqrt(np.mean(known**2))) / self.uncertainty if known.size else math.nan

    def to_dict(self) -> Json:
        """Return plain values with units in their names."""
        known = self.errors[np.isfinite(self.errors)]
        rms = float(np.sqrt(np.mean(known**2))) if known.size else None
        return {
            "converged": self.converged,
            "reason": self.reason,
            "length_mm": self.length,
            "corners": self.corners,
            "u_mm": self.uncertainty,
            "u_relative": self.relative,
            **{f"u_{name}_mm": value for name, value in self.budget.items()},
            "pictures": len(self.errors),
            "failed": len(self.failures),
            "error_rms_mm": rms,
            "claimed_mm": float(np.nanmedian(self.claimed)) if known.size else None,
            "error_over_predicted": self.residual if known.size else None,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the predicted budget as bars; return the axes."""
        ax = take_axes(ax, x="standard uncertainty [mm]", y="")
        ax.barh([*self.budget, "combined"], [*self.budget.values(), self.uncertainty])
        ax.invert_yaxis()
        return ax


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedSetup(Shown):
    """A set-up as it truly is, off by its standard uncertainties: who measures does not know it.

    Attributes
    ----------
    setup : LengthSetup
        The camera and its sensor.
    options : LengthOptions
        What is known of the muscle.
    camera : Camera
        As it is calibrated.
    board : StripBoard
        As it was printed.
    height, tilt : float
        Of the muscle's axis over the board [mm], and out of its plane [rad].
    """

    setup: LengthSetup
    options: LengthOptions
    camera: Camera
    board: StripBoard
    height: float
    tilt: float

    @classmethod
    def draw(
        cls,
        setup: LengthSetup,
        board: StripBoard,
        *,
        options: LengthOptions,
        random: np.random.Generator,
    ) -> RenderedSetup:
        """Return a set-up that is off by errors drawn at random."""
        line, height, tilt = random.standard_normal(3).tolist()
        check_line = board.check_line + board.check_line_uncertainty * line
        above = options.height + options.height_uncertainty * height
        return cls(
            setup=setup,
            options=options,
            camera=setup.make_camera(board),
            board=dataclasses.replace(board, check_line=check_line),
            height=max(above, 0.5 * options.diameter),
            tilt=options.tilt_uncertainty * tilt,
        )

    def render(self, length: float, *, seed: int) -> Picture:
        """Return a picture of a muscle of a length, hung with small differences each time."""
        draw = np.random.default_rng(seed)
        aside, along, lean = (draw.uniform(-1.0, 1.0, 3) * [1.5, 1.0, math.radians(1.0)]).tolist()
        muscle = HungMuscle(
            length=length,
            diameter=self.options.diameter,
            ring=self.options.ring,
            height=self.height,
            tilt=self.tilt,
            angle=lean,
            offset=(aside, along),
        )
        scene = muscle.make_scene(self.board)
        return render_picture(scene, self.camera, sensor=self.setup.sensor, seed=seed)


def plan_setup(
    setup: LengthSetup,
    board: StripBoard,
    *,
    options: LengthOptions,
    length: float = 40.0,
    pictures: int = 0,
    progress: Progress = no_progress,
) -> SetupPlan:
    """Predict the uncertainty of lengths from a planned camera, and test that on rendered pictures.

    Without `LengthOptions.distance` the camera is taken for calibrated.

    Parameters
    ----------
    setup : LengthSetup
    board : StripBoard
    options : LengthOptions
        Its uncertainties go into the budget, and rendered set-ups are off by them, each anew.
    length : float
        Of the muscle between the rings, above 0 [mm].
    pictures : int
        How many to render.
    progress : callable

    Raises
    ------
    GeometryError
        If the board is not enough in the picture.
    InputError
        If the length is not above 0.
    """
    length = check_number("length", length, low=0.0, low_open=True, unit="mm")
    count = check_integer("pictures", pictures, low=0, high=10_000)
    camera = setup.make_camera(board)
    budget, corners = predict_budget(camera, board, options, length=length, sensor=setup.sensor)
    errors, claimed = np.full(count, np.nan), np.full(count, np.nan)
    failures = []
    known = None if options.distance else camera
    for k in range(count):
        random = np.random.default_rng(k)
        truth = RenderedSetup.draw(setup, board, options=options, random=random)
        picture = truth.render(length, seed=k)
        try:
            found = measure_length(picture, board, options=options, camera=known)
            errors[k], claimed[k] = found.length - length, found.uncertainty
        except BozziniError as error:
            failures.append(f"picture {k + 1}: {error}")
        progress("pictures", (k + 1) / count)
    uncertainty = math.hypot(*budget.values())
    return SetupPlan(
        length=length,
        uncertainty=uncertainty,
        relative=uncertainty / length,
        budget=budget,
        corners=corners,
        errors=errors,
        claimed=claimed,
        failures=tuple(failures),
    )


@dataclass(frozen=True, kw_only=True)
class SetupPlanning(Task):
    """Predict the uncertainty of a muscle's length from a planned camera position.

    Without --distance the camera is taken for calibrated. Exit code 0: predicted; 1: a rendered
    picture could not be measured; 2: bad input, or the view does not hold the board.
    """

    name = "plan-setup"
    group = "vision"
    result = SetupPlan

    setup: LengthSetup = LengthSetup()
    options: LengthOptions
    board: str | None = quantity(
        "file", "The description of the board of strips, if it is not the usual one.", default=None
    )
    length: float = quantity(
        "length", "Of the muscle between its rings.", default=40.0, low=0.0, low_open=True
    )
    pictures: int = quantity(
        help="Pictures to render, as a test of the prediction.",
        default=0,
        low=0,
        high=10_000,
        whole=True,
    )

    def run(self, progress: Progress = no_progress) -> SetupPlan:
        """Return the prediction; see `plan_setup`."""
        board = StripBoard() if self.board is None else load_strips(self.board)
        return plan_setup(
            self.setup, board, options=self.options, length=self.length, pictures=self.pictures,
            progress=progress,
        )  # fmt: skip

    def describe(self, found: SetupPlan) -> str:
        """Return the budget as a table, and how pictures bear it out."""
        rows = [[name, f"{1e3 * value:.1f}"] for name, value in found.budget.items()]
        rows.append(["combined", f"{1e3 * found.uncertainty:.1f}"])
        head = f"{found.corners} corners of the board are in view"
        lines = [head, format_rows(["cause", "u [um]"], rows)]
        if self.pictures:
            tested = (
                f"{len(found.failures)} failed; errors over the predicted uncertainty: "
                f"{found.residual:.2f} rms"
            )
            failed = len(found.failures) == self.pictures
            tested = f"all failed: {found.reason}" if failed else tested
            lines.append(f"{self.pictures} rendered pictures, {tested}")
        return "\n".join(lines)


@dataclass(frozen=True, kw_only=True)
class DemoOptions(Shown):
    """A series of an inflating muscle.

    Parameters
    ----------
    repeats : int
        Pictures at each pressure.
    steps : int
        Pressures, the first of which is none.
    pressure : float
        The largest [MPa].
    modulus, dead_length : float
        Of the muscle, which is else the preset ``effector-45`` [MPa], [mm].
    scatter : float
        Standard deviation of the true length between repeats under pressure [mm].
    deflation : bool
        Whether the way back is rendered as well.
    seed : int
    """

    repeats: int = quantity(
        help="Pictures at each pressure.", default=5, low=1, high=99, whole=True
    )
    steps: int = quantity(help="Pressures, with none.", default=6, low=2, high=99, whole=True)
    pressure: float = quantity("pressure", "The largest.", default=0.5, low=0.01, high=5.0)
    modulus: float = quantity("pressure", "Of the muscle's tube.", default=0.35, low=0.01, high=9.0)
    dead_length: float = quantity(
        "length",
        "Of the muscle that does not contract.",
        default=4.0,
        low=0.0,
        high=20.0,
        by_name=True,
    )
    scatter: float = quantity(
        "length", "Between repeats under pressure.", default=0.03, low=0.0, high=1.0, by_name=True
    )
    deflation: bool = quantity("flag", "Render the way back, too.", default=False)
    seed: int = quantity(help="Of all that is random.", default=0, low=0, high=9999, whole=True)

    def __post_init__(self) -> None:
        check_fields(self)


DEMO_LENGTH = LengthOptions(
    height=2.8, diameter=1.6, ring=2.0, height_uncertainty=0.1, tilt_uncertainty=0.005
)
"""What is known of the muscle of the demonstration."""
DEMO_SETUP = LengthSetup(pitch=0.086, columns=960, rows=760)
"""Its camera."""


def write_demo(
    directory: str | os.PathLike[str],
    *,
    options: DemoOptions = DemoOptions(),
    setup: LengthSetup = DEMO_SETUP,
    force: bool = False,
    progress: Progress = no_progress,
) -> Json:
    """Render the pictures of an inflating muscle of known model into a new directory.

    It holds ``manifest.csv`` and the pictures, ``board.yaml`` and ``board.pdf``, ``cameras.yaml``,
    ``truth.csv`` (the true length of each picture), and ``summary.json`` with the truth of the
    set-up and of the muscle. The set-up is off by its standard uncertainties, as a real one is.

    Raises
    ------
    OutputError
        If the directory exists (without `force`) or cannot be written.
    """
    from ..muscle import EnergyMuscle, preset

    muscle = dataclasses.replace(
        preset("effector-45"), modulus=options.modulus, dead_length=options.dead_length
    )
    board = StripBoard()
    draw = np.random.default_rng([options.seed, 7])
    truth = RenderedSetup.draw(setup, board, options=DEMO_LENGTH, random=draw)
    pressures = np.linspace(0.0, options.pressure, options.steps)
    lengths = muscle.length - np.asarray(EnergyMuscle(muscle).contraction(pressures, 0.0))
    states = [("inflate", k) for k in range(options.steps)]
    states += [("deflate", k) for k in reversed(range(options.steps))] if options.deflation else []
    rows = [(word, k, repeat) for repeat in range(options.repeats) for word, k in states]
    manifest, true = [], []
    with new_directory(directory, force=force) as folder:
        (folder / "pictures").mkdir()
        for number, (word, k, repeat) in enumerate(rows):
            off = options.scatter * draw.standard_normal() if pressures[k] > 0.0 else 0.0
            length = float(lengths[k]) + off
            name = f"pictures/{number + 1:03d}.jpg"
            picture = truth.render(length, seed=options.seed * _SEED_STEP + number)
            write_picture(picture, folder / name)
            kpa = f"{1e3 * pressures[k]:.6g}"
            manifest.append((name, "muscle-1", kpa, word, repeat + 1, 0))
            true.append((name, kpa, word, repeat + 1, f"{length:.6f}"))
            progress("pictures", (number + 1) / len(rows))
        states_head = ("image", "specimen", "pressure_kpa", "direction", "repeat", "load_n")
        _write_rows(folder / "manifest.csv", [states_head, *manifest])
        truth_head = ("image", "pressure_kpa", "direction", "repeat", "length_mm")
        _write_rows(folder / "truth.csv", [truth_head, *true])
        board.save(folder / "board.yaml")
        board.write_pdf(folder / "board.pdf")
        cameras = CameraSet(names=("cam0",), cameras=(truth.camera,), world="the board")
        cameras.save(folder / "cameras.yaml")
        result = {
            "pictures": len(rows),
            "muscle": muscle,
            "length": DEMO_LENGTH,
            "setup": setup,
            "true_check_line_mm": truth.board.check_line,
            "true_height_mm": truth.height,
            "true_tilt_rad": truth.tilt,
        }
        return write_summary(folder, settings=options, inputs=(), result=result)


def _write_rows(path: Path, rows: Sequence[Sequence[object]]) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())
