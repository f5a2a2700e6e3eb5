"""A robot of helical tendons: stereo pictures calibrated, two markers triangulated, and fitted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from section import Bound, Section, describe_baselines, format_rows

from bozzini.continuum import (
    ContinuumRobot,
    Helix,
    Marker,
    RobotFit,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Tendon,
    fit_robot,
)
from bozzini.continuum import Section as RobotSection
from bozzini.vision import Checkerboard, triangulate
from bozzini.vision.calibrate import CalibrationOptions, calibrate_cameras, detect_views

LENGTH_MM, RADIUS_MM, OFFSET_MM = 245.0, 2.0, 21.0
YOUNG_MPA, SHEAR_MPA = 2310.0, 849.0
STEP_MM = 0.75
"""Pull of a step: not stated, an inference from where the source's scripts end."""
LET_OUT_MM = 30.0
"""How far the tendons that are not pulled are let out, so that they are slack."""
APART_MM = 22.0
"""Distance of the markers on their disc."""
BASELINE_MM = 72.99
"""Distance of the cameras as the source has it."""
BARE = ("base", "markers.b.x", "markers.b.y")
FORMS = (BARE, (*BARE, "commands.scale"))
HEAD = ("tendons turn", "fitted", "constants", "left out", "in the fit")


def read_points(path: Path, cameras: tuple[object, ...]) -> NDArray[np.float64]:
    """Return both markers of each row (n, 2, 3) [mm]."""
    lines = [line for line in path.read_text("utf-8").splitlines() if line[:1].isdigit()]
    table = np.genfromtxt(lines, delimiter=",")
    left, right = table[:, :4].reshape(-1, 2, 2), table[:, 4:].reshape(-1, 2, 2)
    return triangulate(cameras, np.stack([left, right]))  # type: ignore[arg-type]


def make_robot(turns: float) -> ContinuumRobot:
    """Return the robot, its tendons turning once round in so many lengths."""
    tendons = tuple(
        Tendon(name=f"T{k + 1}", offset=OFFSET_MM, angle=Helix(start=2.0943951 * k, turns=turns))
        for k in range(3)
    )
    section = RobotSection(
        length=LENGTH_MM,
        radius=24.0,
        discs=8,
        bending_stiffness=YOUNG_MPA * math.pi / 4.0 * RADIUS_MM**4,
        torsional_stiffness=SHEAR_MPA * math.pi / 2.0 * RADIUS_MM**4,
        tendons=tendons,
    )
    return ContinuumRobot((section,), name="helical")


def fit_points(points: NDArray[np.float64], turns: float, free: tuple[str, ...]) -> RobotFit:
    """Fit the steps, tendon 1 pulled by the same at each."""
    robot = make_robot(turns)
    commands = np.full((len(points), 3), -LET_OUT_MM)
    commands[:, 0] = STEP_MM * np.arange(len(points))
    data = RobotMeasurements(
        command="displacement",
        tendons=robot.tendon_names,
        commands=commands,
        markers=(
            Marker(name="a", arc_length=LENGTH_MM),
            Marker(name="b", arc_length=LENGTH_MM, offset=(APART_MM, 0.0, 0.0)),
        ),
        points=points,
    )
    options = RobotFitOptions(loss="linear", smaller=False, folds=3)
    return fit_robot(RobotSetup(robot), data, free=free, options=options)


def validate(folder: Path, images: Path) -> Section:
    """Return the section."""
    board = Checkerboard(columns=9, rows=6, square=5.5)
    names, views = detect_views(folder / "stereo", board)
    found = calibrate_cameras(views, board, names, options=CalibrationOptions(resamples=0))
    cameras, baseline = found.cameras.cameras, found.cameras.baseline
    steps = read_points(folder / "steps_tendon_1.csv", cameras)
    own = np.linalg.norm(steps[:, 0] - steps[:, 1], axis=-1)
    rows = []
    best: RobotFit | None = None
    for turns in (1.0 / 3.0, -1.0 / 3.0):
        for free in FORMS:
            fit = fit_points(steps, turns, free)
            assert fit.validation is not None
            words = ", ".join(f"`{name}`" for name in free)
            errors = f"{fit.validation.rms:.2f}", f"{fit.rms:.2f}"
            rows.append([f"{360.0 * turns:+.0f} deg", words, str(len(fit.estimates)), *errors])
            best = fit if best is None or fit.rms < best.rms else best
    assert best is not None
    pull = STEP_MM * best.setup.scale
    assert best.validation is not None
    least = best.validation.rms
    return Section(
        title="Robot of helical tendons, tip disc by stereo",
        source="rasdm, A Quantitative Comparison of Helical Tendon-Driven Continuum Robots, commit "
        "9de9eeb.",
        licence="Apache-2.0.",
        text=(
            f"{len(views)} pairs of pictures of a checkerboard calibrate two cameras: "
            f"{found.cameras.rms:.2f} px, {baseline:.2f} mm apart (the source has {BASELINE_MM} "
            f"mm, {100.0 * (baseline / BASELINE_MM - 1.0):+.1f} %). Two markers of the tip "
            f"disc are triangulated at {len(steps)} steps of one tendon; they are "
            f"{own.min():.1f} to {own.max():.1f} mm apart in all of them. "
            "Errors are root mean square distances [mm].",
            "",
            *format_rows(HEAD, rows),
            "",
            describe_baselines(best),
            "",
            f"The pull of a step is not stated. If it was {STEP_MM} mm, as the source's scripts "
            f"suggest, the least error is with {pull:.2f} mm; friction, weight, and discs in place "
            "of channels are left out, and any of them could be what the factor stands for. Nor "
            "are the pulls of the loop, whose time is all that its table has: friction is not "
            "fitted. One tendon hardly determines the base, as the fit warns: "
            f"{least:.2f} mm is the error of a pull repeated at its place, not of another motion.",
        ),
        bounds=(Bound(f"two markers, {len(best.estimates)} constants", best.rms, 1.0, "mm"),),
    )
