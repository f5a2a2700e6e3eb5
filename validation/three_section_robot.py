"""A robot of three sections, nine tendons: tips of a recording, by quarters and kinds of motion."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
from pathlib import Path

import numpy as np
from estimates import predict_ahead
from loops import compare_loops, make_runs
from numpy.typing import NDArray
from section import Bound, Section, draw_axes, format_rows, name_baselines

from bozzini.continuum import (
    AheadPrediction,
    ContinuumRobot,
    ModelError,
    RobotCheck,
    RobotFit,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Tendon,
    fit_robot,
    read_robot_measurements,
)
from bozzini.continuum import Section as RobotSection
from bozzini.hysteresis import LoopRuns

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
KINDS = {
    "tendon": "one tendon",
    "seg1": "section 1",
    "seg2": "section 2",
    "seg3": "section 3",
    "pair12": "sections 1 and 2",
    "pair13": "sections 1 and 3",
    "pair23": "sections 2 and 3",
}
"""Kinds of motion, as the labels of the table begin after the number of the repeat."""
PAIR = "pair"
"""So begin the kinds of two sections at the same time, which come after the others."""
QUARTERS = (0, 1, 2, 3)
"""Of the recording, those that are predicted from the tips before."""
AHEAD_MM = (1.6, 3.5, 4.6)
"""Largest errors 1, 5 and 20 rows ahead [mm]."""
BEGIN = ModelError(
    curvature=6e-4, twist=6e-4, reach=40.0, zero=0.2, coupling=0.05, position=0.5, rotation=0.01,
    memory=20.0, drift=1e-4,
)  # fmt: skip
"""Where sizes of the model's errors begin."""
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


def read_kinds(folder: Path) -> NDArray[np.str_]:
    """Return the kind of motion of each row."""
    with (folder / "train.csv").open(newline="", encoding="utf-8") as file:
        labels = [row["pattern_label"] for row in csv.DictReader(file)]
    parts = [re.match(rf"rep\d+_({'|'.join(KINDS)})", label) for label in labels]
    return np.array([part[1] if part else "" for part in parts])


def keep_points(data: RobotMeasurements, rows: NDArray[np.bool_]) -> RobotMeasurements:
    """Return the recording with the points of some rows; the others stay as its history."""
    points = np.where(rows[:, None, None], data.points, np.nan)
    return dataclasses.replace(data, points=points)


def fit_form(
    data: RobotMeasurements, robot: ContinuumRobot, form: str, *, folds: int = 4
) -> RobotFit:
    """Fit a form to all rows, and to all but a block of them in turn: quarters, or by labels."""
    options = RobotFitOptions(smaller=False, folds=folds)
    return fit_robot(robot, data, free=FORMS[form], options=options)


@dataclasses.dataclass(frozen=True)
class Motions:
    """What the chosen form comes to on motions that it was not fitted to."""

    by_kind: dict[str, tuple[int, float]]
    """Rows of each kind, and their error, fitted on the other kinds [mm]."""
    whole: float
    """Over all rows, each left out with its kind [mm]."""
    pairs: RobotCheck
    """Of two sections at the same time, fitted on one tendon or section at a time."""
    early: RobotFit
    late: RobotFit
    """Fits of the first three quarters of the rows and of the last."""

    @property
    def outside(self) -> list[str]:
        """Constants of the last quarter that the intervals of the first three do not hold."""
        both = zip(self.early.estimates, self.late.estimates, strict=True)
        return [one.name for one, two in both if not one.low <= two.value <= one.high]


def leave_motions_out(data: RobotMeasurements, robot: ContinuumRobot, folder: Path) -> Motions:
    """Fit without each kind of motion in turn, without pairs of sections, and on parts in time."""
    kinds = read_kinds(folder)
    labelled = fit_form(dataclasses.replace(data, blocks=kinds), robot, CHOSEN)
    assert labelled.validation is not None
    errors = dict(zip(np.unique(kinds).tolist(), labelled.validation.blocks, strict=True))
    pairs = np.char.startswith(kinds, PAIR)
    single = fit_robot(
        robot,
        keep_points(data, ~pairs),
        free=FORMS[CHOSEN],
        options=RobotFitOptions(smaller=False, residual=True, split="kinds"),
    )
    first = np.arange(len(data)) < 3 * len(data) // 4
    return Motions(
        by_kind={kind: (int(np.sum(kinds == kind)), errors[kind]) for kind in KINDS},
        whole=labelled.validation.rms,
        pairs=single.check(keep_points(data, pairs)),
        early=fit_form(keep_points(data, first), robot, CHOSEN, folds=0),
        late=fit_form(keep_points(data, ~first), robot, CHOSEN, folds=0),
    )


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
    motions = leave_motions_out(data, robot, folder)
    ahead = fit_errors(data, robot, folder)
    loops = compare_loops(list_loops(data, robot, folder))
    words = "a section to and fro, the last quarter held out"
    worst = max(error for _, error in motions.by_kind.values())
    return Section(
        title="Robot of three sections, tip under nine tendons",
        source="ContinuumRoboticsLab/opencr-mujoco, commit 17fff8b.",
        licence="MIT.",
        text=(
            *describe(data, best),
            "",
            *format_rows(HEAD, rows),
            "",
            *describe_motions(motions),
            "",
            describe_limits(data),
            "",
            loops.describe(words, "mm"),
            "",
            describe_estimates(ahead),
        ),
        bounds=(
            Bound(
                f"tip, each quarter from the others, {len(best.estimates)} constants",
                best.validation.rms,
                5.5,
                "mm",
            ),
            Bound("tip, the kind of motion that is missed most, from the others", worst, 9.5, "mm"),
            Bound(
                "tip, two sections at the same time, from one at a time",
                motions.pairs.prediction.rms,
                5.8,
                "mm",
            ),
            Bound(
                "the same with a residual learned on one at a time",
                motions.pairs.residual,
                4.5,
                "mm",
            ),
            Bound(
                "the same outside the band of 95 %",
                100.0 * (1.0 - motions.pairs.coverage),
                7.0,
                "%",
            ),
            Bound("fitted in that form", len(best.estimates), 15, "constants"),
            *loops.list_bounds(words),
            Bound(
                "its error over that with tendons that stretch by their length",
                best.validation.rms / by_length.validation.rms,
                1.0,
                "times",
            ),
            *(
                Bound(f"tip, {rows} row(s) ahead, with the tips before", one[0].rms, most, "mm")
                for (rows, one), most in zip(ahead.items(), AHEAD_MM, strict=True)
            ),
            *(
                Bound(
                    f"{rows} row(s) ahead, share in 95 % intervals, off 95 %",
                    100.0 * abs(one[1] - 0.95),
                    2.0,
                    "%",
                )
                for rows, one in ahead.items()
            ),
        ),
    )


LOOPS = [(section, angle) for section in range(3) for angle in (0, 60, 120)]
"""Sections, and directions in which they bend to and fro [deg]."""
STILL_MM = 0.2
"""Largest displacement of other tendons before the section."""


def list_loops(
    data: RobotMeasurements, robot: ContinuumRobot, folder: Path
) -> list[tuple[LoopRuns, float]]:
    """Return loops of a section that bends to and fro, and the share that is held out.

    The input is how far its tendons are pulled in the direction that is pulled most, the output the
    tip along the direction in which it moves most.
    """
    with (folder / "train.csv").open(newline="", encoding="utf-8") as file:
        labels = [row["pattern_label"].removesuffix("_hold") for row in csv.DictReader(file)]
    loops = []
    for section, angle in LOOPS:
        names = [f"rep1_seg{section + 1}_dir{turn}" for turn in (angle, angle + 180)]
        before = [robot.tendon_names.index(name) for part in TENDONS[:section] for name in part]
        still = np.abs(data.commands[:, before]).max(axis=1, initial=0.0) < STILL_MM
        rows = np.concatenate(
            [np.flatnonzero(still & (np.array(labels) == name)) for name in names]
        )
        own = [robot.tendon_names.index(name) for name in TENDONS[section]]
        turns = CLOCKING_RAD[section] + 2.0 * math.pi / 3.0 * np.arange(3)
        pulls = 2.0 / 3.0 * data.commands[rows][:, own] @ np.exp(1j * turns)
        most = pulls[np.argmax(np.abs(pulls))]
        pull = (pulls * most.conj()).real / abs(most)
        places = data.points[rows, 0, :2] - data.points[rows, 0, :2].mean(axis=0)
        moved = places @ np.linalg.svd(places)[2][0]
        runs = make_runs([("", pull, moved)], ("pull [mm]", "tip [mm]"))
        loops.append((runs, 0.25))
    return loops


def fit_errors(
    data: RobotMeasurements, robot: ContinuumRobot, folder: Path
) -> dict[int, tuple[AheadPrediction, float]]:
    """Return the tip rows ahead from commands and tips before, each quarter from the others."""
    with (folder / "train.csv").open(newline="", encoding="utf-8") as file:
        times = np.array([float(row["timestamp"]) for row in csv.DictReader(file)])

    def fit(rows: NDArray[np.bool_]) -> RobotSetup:
        return fit_form(keep_points(data, rows), robot, CHOSEN, folds=0).setup

    return predict_ahead(data, times - times[0], fit, error=BEGIN, blocks=4, wanted=QUARTERS)


def describe_estimates(ahead: dict[int, tuple[AheadPrediction, float]]) -> str:
    """Return how well the tip is predicted from those before."""
    rows = ", ".join(str(steps) for steps in ahead)
    errors = ", ".join(f"{one.rms:.2f}" for one, _ in ahead.values())
    bare = ", ".join(f"{100.0 * one.measure_coverage():.1f}" for one, _ in ahead.values())
    wide = ", ".join(f"{100.0 * share:.1f}" for _, share in ahead.values())
    return (
        "With the tips before (`ShapeEstimator`, fitted to the other quarters) the tip "
        f"{rows} rows ahead is missed by {errors} mm; 95 % intervals hold {bare} %, corrected by "
        f"the other quarters {wide} %."
    )


def describe(data: RobotMeasurements, best: RobotFit) -> list[str]:
    """Return what was measured and fitted."""
    known = {one.name: one for one in best.estimates}
    stiffness = DRIVE_N_PER_MM * known["tendons.*.stiffness"].value
    zeros = [one.value for one in best.estimates if one.name.endswith("zero")]
    return [
        f"{len(data)} rows in the order of time, every tendon alone and sections together. Fitted "
        "is the tip; lengths, clocking, and the wire are the source's. Each quarter of the "
        "recording is left out in turn and predicted by a fit to the others. Errors are root mean "
        "square distances [mm].",
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


def describe_motions(motions: Motions) -> list[str]:
    """Return the errors by kind of motion, and how constants fitted later in time lie."""
    worst = max(motions.by_kind, key=lambda kind: motions.by_kind[kind][1])
    rows = [
        [KINDS[kind], str(count), f"{error:.2f}"]
        for kind, (count, error) in motions.by_kind.items()
    ]
    name = "tendons.*.stiffness"
    one, two = (
        next(each for each in fit.estimates if each.name == name)
        for fit in (motions.early, motions.late)
    )
    count = len(motions.early.estimates)
    return [
        f"Each kind of motion, predicted by a fit of the form '{CHOSEN}' to the others, is missed "
        f"by {motions.whole:.2f} mm over all rows and {motions.by_kind[worst][1]:.2f} mm for "
        f"{KINDS[worst]}; two sections at the same time, from one tendon or section at a time, by "
        f"{motions.pairs.prediction.rms:.2f} mm, and {motions.pairs.residual:.2f} mm with a "
        "residual; "
        f"{100.0 * motions.pairs.coverage:.1f} % of them are within the widest radius of that "
        "fit's band of 95 %. Commands alone miss them by "
        f"{name_baselines(motions.pairs.baselines, 'mm')}.",
        "",
        *format_rows(("moved", "rows", "left out, fitted on the other kinds"), rows),
        "",
        f"Constants change with the motions as well. Of the first three quarters `{name}` is "
        f"{one.value:.2f} times where the fit begins, 95 % {one.low:.2f} to {one.high:.2f}; of the "
        f"last it is {two.value:.2f} ({two.low:.2f} to {two.high:.2f}). Of {count} constants "
        f"{len(motions.outside)} of the last quarter lie outside the intervals of the first "
        "three.",
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


def describe_limits(data: RobotMeasurements) -> str:
    """Return what the errors are made of."""
    scatter, pairs = measure_scatter(data)
    return (
        f"What limits: {pairs} rows have another one in another quarter with all tendons "
        f"within {SAME_COMMAND_MM} mm of theirs; by such pairs one tip scatters by {scatter:.1f} "
        "mm rms."
    )


def draw_errors(fit: RobotFit, images: Path) -> None:
    """Draw the distance of each row, fitted, and the quarters left out."""
    assert fit.validation is not None
    ends = np.linspace(0.0, len(fit.data), len(fit.validation.blocks) + 1)
    with draw_axes(images / "validation_three_section_robot.png") as axes:
        fit.plot(axes)
        for error, begin, end in zip(fit.validation.blocks, ends[:-1], ends[1:], strict=True):
            axes.hlines(error, begin, end, color="tab:red", label="left out, rms")
