"""A robot of three sections, nine tendons: tips of a recording, each quarter from the others."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from section import Bound, Section, draw_axes, format_rows

from bozzini.continuum import (
    ContinuumRobot,
    RobotFit,
    RobotFitOptions,
    RobotMeasurements,
    Tendon,
    fit_robot,
    read_robot_measurements,
)
from bozzini.continuum import Section as RobotSection

LENGTHS_MM = (60.0, 62.5, 64.0)
CLOCKING_RAD = (-3.06, -2.56, -2.05)
TENDONS = (("T4", "T3", "T9"), ("T5", "T2", "T8"), ("T6", "T1", "T7"))
"""Tendons by section, in the order of the table's columns."""
OFFSET_MM = 4.5
MODULUS_MPA = 50e3
"""The source's effective value for a wire of 0.5 mm radius."""
DRIVE_N_PER_MM = 10.0
"""Stiffness of a tendon with its drive, where the fit begins."""

COLUMNS = {f"servo_{k}_mm": f"T{k} displacement [mm]" for k in range(1, 10)} | {
    f"tip_{axis}": f"tip {axis} [mm]" for axis in "xyz"
}

SHARED = (
    "tendons.*.stiffness", "sections.each.tendons.zero", "base.position.z", "base.rotation.x",
    "tendons.*.offset",
)  # fmt: skip
FORMS = {
    "stiffness of a tendon, one zero, all of the base": (
        "tendons.*.stiffness", "tendons.*.zero", "base",
    ),
    "the same, zero per section, of the base height and tilt": SHARED[:4],
    "and distance of the tendons": SHARED,
    "and backlash": (*SHARED, "commands.backlash"),
    "and clocking, EI of each section, all of the base": (
        "tendons.*.stiffness", "sections.each.tendons.zero", "tendons.*.offset",
        "commands.backlash", "sections.each.tendons.angle", "sections.2.bending_stiffness",
        "sections.3.bending_stiffness", "base.position", "base.rotation.x", "base.rotation.y",
    ),
}  # fmt: skip
"""What is fitted."""
CHOSEN = "and backlash"
HEAD = ("fitted", "constants", "left out", "by quarter", "in the fit")
SAME_COMMAND_MM = 0.2
"""Largest difference of a tendon between two rows of the same command."""


def make_robot(*, even_compliance: bool = True) -> ContinuumRobot:
    """Return the robot as the source describes it, one segment for each section.

    With even compliance all tendons give way alike, whatever their length: what gives is the drive.
    """
    rigidity = MODULUS_MPA * math.pi / 4.0 * 0.5**4
    sections = []
    for k, (length, clocking, names) in enumerate(
        zip(LENGTHS_MM, CLOCKING_RAD, TENDONS, strict=True)
    ):
        long = sum(LENGTHS_MM[: k + 1]) if even_compliance else 100.0
        tendons = tuple(
            Tendon(
                name=name,
                offset=OFFSET_MM,
                angle=clocking + 2.0 * math.pi / 3.0 * j,
                stiffness=DRIVE_N_PER_MM * long,
            )
            for j, name in enumerate(names)
        )
        sections.append(
            RobotSection(
                length=length, radius=6.0, discs=1, bending_stiffness=rigidity, tendons=tendons
            )
        )
    return ContinuumRobot(tuple(sections), name="three sections")


def read_rows(folder: Path, robot: ContinuumRobot) -> RobotMeasurements:
    """Return the recording."""
    return read_robot_measurements(folder / "train.csv", robot=robot, columns=COLUMNS)


def fit_form(data: RobotMeasurements, robot: ContinuumRobot, form: str) -> RobotFit:
    """Fit a form to all rows, and to all but a quarter of the recording in turn."""
    options = RobotFitOptions(smaller=False)
    return fit_robot(robot, data, free=FORMS[form], options=options)


def validate(folder: Path, images: Path) -> Section:
    """Return the section, and draw the errors over the rows."""
    robot = make_robot()
    data = read_rows(folder, robot)
    found = {form: fit_form(data, robot, form) for form in FORMS}
    by_length = fit_form(data, make_robot(even_compliance=False), CHOSEN)
    rows = []
    named = {**found, "the same, tendons that stretch by their length": by_length}
    for form, fit in named.items():
        assert fit.validation is not None
        quarters = ", ".join(f"{value:.1f}" for value in fit.validation.blocks)
        left_out = f"{fit.validation.rms:.2f}"
        rows.append([form, str(len(fit.estimates)), left_out, quarters, f"{fit.rms:.2f}"])
    best = found[CHOSEN]
    assert best.validation is not None and by_length.validation is not None
    draw_errors(best, images)
    return Section(
        title="Robot of three sections, tip under nine tendons",
        source="ContinuumRoboticsLab/opencr-mujoco, commit 17fff8b.",
        licence="MIT.",
        text=(
            *describe(data, best),
            "",
            *format_rows(HEAD, rows),
            "",
            describe_limits(data, found),
            "",
            *COMMANDS,
        ),
        bounds=(
            Bound(
                f"tip, each quarter from the others, {len(best.estimates)} constants",
                best.validation.rms,
                5.5,
                "mm",
            ),
            Bound("fitted in that form", len(best.estimates), 15, "constants"),
            Bound(
                "its error over that with tendons that stretch by their length",
                best.validation.rms / by_length.validation.rms,
                1.0,
                "times",
            ),
        ),
    )


def describe(data: RobotMeasurements, best: RobotFit) -> list[str]:
    """Return what was measured and fitted."""
    known = {one.name: one for one in best.estimates}
    stiffness = DRIVE_N_PER_MM * known["tendons.*.stiffness"].value
    zeros = [one.value for one in best.estimates if one.name.endswith("zero")]
    return [
        f"{len(data)} rows in the order of time, every tendon alone and sections together. Fitted "
        "is the tip; lengths, clocking, and the wire are the source's. Each quarter of the "
        "recording is left out in turn and predicted by a fit to the others; a random split would "
        "have neighbours of each row in the fit, and is refused. Errors are root mean square "
        "distances [mm].",
        "",
        f"The form '{CHOSEN}', {len(best.estimates)} constants, on all rows: {stiffness:.1f} N/mm "
        f"for a tendon with its drive, zeros of {min(zeros):.2f} to {max(zeros):.2f} mm from base "
        f"to tip, tendons {known['tendons.*.offset'].value:.2f} mm off the axis (the source: "
        f"{OFFSET_MM} mm), a base tilted by "
        f"{abs(math.degrees(known['base.rotation.x'].value)):.1f} deg, and "
        f"{known['commands.backlash'].value:.3f} mm of backlash.",
        "",
        "![Error over the rows](images/validation_three_section_robot.png)",
    ]


def measure_scatter(data: RobotMeasurements) -> tuple[float, int]:
    """Return the scatter of one tip [mm], by pairs of rows of the same command, and the pairs.

    The second row is the nearest one of another quarter of the recording.
    """
    from scipy.spatial.distance import cdist

    quarter = np.arange(len(data)) * 4 // len(data)
    apart = cdist(data.commands, data.commands, "chebyshev")
    apart[quarter[:, None] == quarter] = np.inf
    other = np.argmin(apart, axis=1)
    same = apart[np.arange(len(data)), other] <= SAME_COMMAND_MM
    tips = data.points[:, 0]
    missed = np.linalg.norm(tips[same] - tips[other[same]], axis=-1)
    return float(np.sqrt(np.mean(missed**2) / 2.0)), int(same.sum())


def describe_limits(data: RobotMeasurements, found: dict[str, RobotFit]) -> str:
    """Return what the errors are made of."""
    errors = [fit.validation.rms for fit in found.values() if fit.validation is not None]
    few, many = (len(found[form].estimates) for form in (CHOSEN, list(FORMS)[-1]))
    scatter, pairs = measure_scatter(data)
    return (
        "The stiffness of a tendon is taken as that of its drive, which does not fall with its "
        f"length. {many} constants in place of {few} change the error of rows left out by "
        f"{errors[-1] - errors[-2]:+.2f} mm, and backlash changes it by "
        f"{errors[-2] - errors[-3]:+.2f} mm. What limits: {pairs} rows have another one in another "
        f"quarter with all tendons within {SAME_COMMAND_MM} mm of theirs; by such pairs one tip "
        f"scatters by {scatter:.1f} mm rms. Forms were compared by the very errors of the "
        "table, on one recording of one robot: on others expect more, and sooner the error of few "
        "constants than that of many."
    )


COMMANDS = (
    "The chosen form, with robot.yaml as above and a table whose titles are those of the command; "
    "`fitted.yaml` has the zeros and the backlash as well, and `pose fitted.yaml` heeds them:",
    "",
    "    bozzini continuum fit robot.yaml recording.csv --out fitted.yaml \\",
    "      --check other_recording.csv --free 'tendons.*.stiffness,\\",
    "      sections.each.tendons.zero,base.position.z,base.rotation.x,tendons.*.offset,\\",
    "      commands.backlash'",
)


def draw_errors(fit: RobotFit, images: Path) -> None:
    """Draw the distance of each row, fitted, and the quarters left out."""
    assert fit.validation is not None
    ends = np.linspace(0.0, len(fit.data), len(fit.validation.blocks) + 1)
    with draw_axes(images / "validation_three_section_robot.png") as axes:
        fit.plot(axes)
        for error, begin, end in zip(fit.validation.blocks, ends[:-1], ends[1:], strict=True):
            axes.hlines(error, begin, end, color="tab:red", label="left out, rms")
