"""A robot of three cables with unknown geometry: tips of commands that nothing was fitted to."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from section import Bound, Section, format_rows

from bozzini.continuum import (
    ContinuumRobot,
    RobotFit,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Tendon,
    fit_robot,
    read_robot_measurements,
)
from bozzini.continuum import Section as RobotSection

TITLES = (
    *(f"T{k} displacement [0.1 mm]" for k in (1, 2, 3)),
    *(f"tip {axis} [mm]" for axis in "xyz"),
)
FITTED, CHECKED = 400, 2000
"""Rows that are fitted, and others that are predicted; drawn at random."""
TAUT_MM = 10.0
"""Zero of the cables: they stay taut, so that the mean of a command makes no difference."""

BASE_LENGTH = ("base", "sections.1.length")
FORMS = {
    "an even bend": ("channel", (*BASE_LENGTH, "tendons.*.offset")),
    "a straight link on half the bend at each end": ("chord", (*BASE_LENGTH, "tendons.*.offset")),
    "an even bend, and scale of the command": (
        "channel", (*BASE_LENGTH, "tendons.*.offset", "commands.scale"),
    ),
}  # fmt: skip
CHOSEN = "a straight link on half the bend at each end"
DEGENERATE = "an even bend, and scale of the command"


def make_setup() -> RobotSetup:
    """Return a robot of one section with cables clockwise, its geometry a guess."""
    tendons = tuple(
        Tendon(name=f"T{k + 1}", offset=4.0, angle=-2.0 * math.pi / 3.0 * k, stiffness=100.0)
        for k in range(3)
    )
    section = RobotSection(
        length=100.0, radius=12.0, discs=1, bending_stiffness=100.0, tendons=tendons
    )
    return RobotSetup(ContinuumRobot((section,), name="three cables"), zeros=(TAUT_MM,) * 3)


def read_rows(folder: Path, robot: ContinuumRobot) -> tuple[RobotMeasurements, RobotMeasurements]:
    """Return the rows that are fitted, and those that are predicted."""
    import pandas

    table = np.loadtxt(folder / "tips.csv.gz", delimiter=",")
    order = np.random.default_rng(0).permutation(len(table))
    frames = [
        pandas.DataFrame(table[order[rows]], columns=TITLES)
        for rows in (slice(0, FITTED), slice(FITTED, FITTED + CHECKED))
    ]
    first, second = (read_robot_measurements(frame, robot=robot) for frame in frames)
    return first, second


def fit_form(data: RobotMeasurements, setup: RobotSetup, form: str) -> RobotFit:
    """Fit a form."""
    segment, free = FORMS[form]
    options = RobotFitOptions(
        split="random", residual=True, smaller=False, model_options={"segment": segment}
    )
    return fit_robot(setup, data, free=free, options=options)


def validate(folder: Path, images: Path) -> Section:
    """Return the section."""
    setup = make_setup()
    data, others = read_rows(folder, setup.robot)
    found = {form: fit_form(data, setup, form) for form in FORMS}
    checks = {form: fit.check(others) for form, fit in found.items()}
    rows = [
        [
            form, str(len(fit.estimates)), f"{checks[form].prediction.rms:.2f}",
            f"{checks[form].residual:.2f}", f"{100.0 * checks[form].coverage:.1f}",
            f"{fit.rms:.2f}",
        ]
        for form, fit in found.items()
    ]  # fmt: skip
    rows += [
        [name, "", f"{error:.2f}", "", "", ""] for name, error in checks[CHOSEN].baselines.items()
    ]
    best = found[CHOSEN]
    known = {one.name: one.value for one in best.estimates}
    return Section(
        title="Robot of three cables, tip",
        source="ARM-Lab, Learning-Based Position Control for Continuum Robots, commit 00b2d76; "
        "Sincak et al., 2025.",
        licence="MIT.",
        text=(
            f"{FITTED} of 5000 commands, drawn at random, are fitted and {CHECKED} others "
            "predicted; commands do not follow each other in time. Nothing of the robot is stated: "
            "fitted are the pose of its base, the length, and the distance of the cables, which "
            "are taken as taut; in the order of the columns they stand clockwise. Errors are root "
            "mean square distances [mm].",
            "",
            *format_rows(
                (
                    "form",
                    "constants",
                    "not fitted",
                    "with residual",
                    "in its band of 95 % [%]",
                    "in the fit",
                ),
                rows,
            ),
            "",
            f"The second form: a link of {known['sections.1.length']:.0f} mm, and cables "
            f"{known['tendons.*.offset']:.2f} mm off the axis, if commands are what they say.",
            "",
            f"What is degenerate, as the fit says it of the last form: "
            f"{'; '.join(found[DEGENERATE].undetermined)}. Length and place of the base along "
            "the robot are determined by the curvature of the surface that the tip moves on alone, "
            "and hardly: the fit warns of it.",
        ),
        bounds=(
            Bound(
                f"tip, rows not fitted, {len(known)} constants",
                checks[CHOSEN].prediction.rms,
                3.2,
                "mm",
            ),
            Bound("the same with a residual on top", checks[CHOSEN].residual, 1.1, "mm"),
            Bound(
                "rows not fitted that the band of 95 % holds, off 95 %",
                abs(100.0 * checks[CHOSEN].coverage - 95.0),
                2.0,
                "%",
            ),
            Bound("fitted in that form", len(known), 9, "constants"),
            Bound("not determined by the rows", len(best.undetermined), 0, "combinations"),
        ),
    )
