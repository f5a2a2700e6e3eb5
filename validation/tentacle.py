"""A tapered tentacle under tensions and its weight, by a rod that stretches and shears."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from estimates import Seen, see_markers
from numpy.typing import NDArray
from section import Bound, Section, describe_baselines, draw_axes, format_rows

from bozzini.continuum import (
    ContinuumRobot,
    Marker,
    ModelError,
    RobotFit,
    RobotFitOptions,
    RobotMeasurements,
    RobotSetup,
    Tendon,
    fit_robot,
    predict_points,
    read_robot_measurements,
)
from bozzini.continuum import Section as RobotSection
from bozzini.continuum.wire import Wire

START_MPA, IDENTIFIED_MPA = 0.505, 0.315
"""Young's moduli of the source: where it began, and what it identified."""
POISSON_RATIO, DENSITY_KG_PER_M3 = 0.45, 1318.0
END_MM, LENGTH_MM = 305.0, 360.0
"""Where the tendons end, and the robot."""
RADII_MM = (15.41, 6.42, 4.80)
"""At the base, where the tendons end, and at the tip."""
OFFSET_MM, SLOPE = 11.4, -0.0295
ANGLES_DEG = (30.0, 150.0)
DISCS = (20, 4)
"""Stations of the two parts, one of which is where the tendons end."""

MARKERS = (
    Marker(name="marker_1", arc_length=129.1, offset=(0.0, 25.0, 0.0)),
    Marker(name="marker_2", arc_length=219.5, offset=(0.0, -21.0, 0.0)),
    Marker(name="marker_3", arc_length=280.0, offset=(0.0, 20.0, 0.0)),
    Marker(name="marker_4", arc_length=360.0, offset=(0.0, 0.0, 8.0)),
)
COLUMNS = {f"tension_{k} [N]": f"T{k} tension [N]" for k in (1, 2)}
HANGING: Any = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""Axes of the base in the world, a column each: z down, y along world x."""

BEGIN = ModelError(twist=2e-4, reach=80.0, stiffness=0.1, position=2.0, rotation=0.02, memory=1.0)
"""Where sizes of the model's errors begin."""
FORMS = (
    ("sections.*.modulus",),
    ("sections.*.modulus", "commands.scale"),
    ("sections.*.modulus", "commands.scale", "base.rotation.x"),
    ("sections.*.modulus", "commands.scale", "markers.marker_1.arc_length"),
)
CHOSEN = FORMS[-1]
OTHER_FOLDS = 4
"""Blocks of poses that are left out in turn of forms that are not chosen; of that one four."""


def make_robot(modulus: float = IDENTIFIED_MPA) -> ContinuumRobot:
    """Return the robot as the source describes it."""
    tendons = tuple(
        Tendon(
            name=f"T{k}",
            offset=((0.0, OFFSET_MM), (END_MM, OFFSET_MM + SLOPE * END_MM)),
            angle=math.radians(angle),
        )
        for k, angle in enumerate(ANGLES_DEG, start=1)
    )
    sections = []
    for k, length in enumerate((END_MM, LENGTH_MM - END_MM)):
        wire = Wire(
            diameter=((0.0, 2.0 * RADII_MM[k]), (length, 2.0 * RADII_MM[k + 1])),
            modulus=modulus,
            poisson_ratio=POISSON_RATIO,
            density=DENSITY_KG_PER_M3,
        )
        sections.append(
            RobotSection(
                length=length, radius=RADII_MM[k] + 0.01, discs=DISCS[k], wire=wire,
                tendons=() if k else tendons,
            )
        )  # fmt: skip
    return ContinuumRobot(tuple(sections), name="tentacle", base_rotation=HANGING)


def read_poses(folder: Path, robot: ContinuumRobot) -> RobotMeasurements:
    """Return the static poses."""
    return read_robot_measurements(
        folder / "static_shapes.csv", robot=robot, markers=MARKERS, columns=COLUMNS
    )


def fit_form(
    data: RobotMeasurements, robot: ContinuumRobot, form: tuple[str, ...], *, stretches: bool = True
) -> RobotFit:
    """Fit a form to all poses, and to those outside of each block."""
    options = RobotFitOptions(
        model="rod",
        model_options={"stretches": stretches},
        loss="linear",
        smaller=False,
        folds=4 if form == CHOSEN else OTHER_FOLDS,
    )
    return fit_robot(robot, data, free=form, options=options)


def validate(folder: Path, images: Path) -> Section:
    """Return the section."""
    robot = make_robot()
    data = read_poses(folder, robot)
    found = {form: fit_form(data, robot, form) for form in FORMS}
    stiff = fit_form(data, robot, CHOSEN[:2], stretches=False)
    begun = predict_points(
        RobotSetup(make_robot(START_MPA), MARKERS), data, model="rod",
        model_options={"stretches": True},
    )  # fmt: skip
    rows = [[f"nothing, {START_MPA} MPa", "0", "-", f"{begun.rms:.1f}"]]
    for form, fit in (*found.items(), ((*CHOSEN[:2], "no stretch or shear"), stiff)):
        words = ", ".join(f"`{name}`" if "." in name else name for name in form)
        left_out = "-" if fit.validation is None else f"{fit.validation.rms:.1f}"
        rows.append([words, str(len(fit.estimates)), left_out, f"{fit.rms:.1f}"])
    best = found[CHOSEN]
    assert best.validation is not None
    draw_errors(best, images)
    seen = see_others(data, robot)
    return Section(
        title="Tapered tentacle, shape under tensions",
        source="tud-phi/soromox, commit 4f03054.",
        licence="MIT.",
        text=(
            *describe(data, best),
            "",
            *format_rows(("fitted", "constants", "left out", "in the fit"), rows),
            "",
            describe_baselines(best),
            "",
            describe_limits(best, found[CHOSEN[:2]]),
            "",
            describe_estimates(seen),
        ),
        bounds=(
            Bound(f"all markers, {len(best.estimates)} constants", best.rms, 12.5, "mm"),
            Bound("the same, poses left out", best.validation.rms, 15.0, "mm"),
            Bound("fitted in that form", len(best.estimates), 3, "constants"),
            Bound(
                "error with two constants over that of a rod that cannot stretch or shear",
                found[CHOSEN[:2]].rms / stiff.rms,
                1.0,
                "times",
            ),
            *(
                Bound(
                    f"{name}, by the error of the model alone", one.rms / one.alone, most, "times"
                )
                for name, one, most in zip(
                    ("middle markers from the tip", "tip from the others"),
                    seen,
                    (0.9, 0.6),
                    strict=True,
                )
            ),
        ),
    )


def describe(data: RobotMeasurements, best: RobotFit) -> list[str]:
    """Return what was measured and fitted."""
    known = {one.name: one.value for one in best.estimates}
    return [
        f"{len(data)} static poses of a cone of silicone that hangs under its weight, bent by the "
        "tensions of two converging tendons; four markers on short arms. The rod shears and "
        "stretches; its sizes, density and Poisson's ratio are the source's. "
        "Fitted are all markers; poses are left out in four blocks. "
        "Errors are root mean square distances [mm]. The source's own model: 36.8 mm with nothing "
        "fitted, 15.8 mm with three constants, 6.1 to 6.4 mm with a network for the rest.",
        "",
        f"The last form: {known['sections.*.modulus']:.3f} MPa, tensions "
        f"{known['commands.scale']:.2f} times those stated, and the first marker at "
        f"{known['markers.marker_1.arc_length']:.1f} mm in place of {MARKERS[0].arc_length} mm.",
        "",
        "![Error over the poses](images/validation_tentacle.png)",
    ]


def describe_limits(best: RobotFit, two: RobotFit) -> str:
    """Return what the errors are made of, by the fit of two constants and the best one."""
    missed = two.prediction.predicted[:, 0] - two.prediction.measured[:, 0]
    mean = np.linalg.norm(np.nanmean(missed, axis=0))
    return (
        "What limits: the marker at the tip, up to "
        f"{np.nanmax(best.prediction.distances[:, 3]):.0f} mm. The first marker, near the "
        "base where little bends, is missed by "
        f"{two.prediction.rms_by_marker['marker_1']:.0f} mm with two constants, of which "
        f"{mean:.0f} mm are the same in all poses: so the third constant moves it."
    )


def see_others(data: RobotMeasurements, robot: ContinuumRobot) -> list[Seen]:
    """Return the middle markers from that at the tip, and that from those, of poses left out."""
    options = RobotFitOptions(
        model="energy", model_options={"segment": "channel"}, loss="linear", smaller=False, folds=0
    )

    def fit(rows: NDArray[np.bool_]) -> RobotSetup:
        points = np.where(rows[:, None, None], data.points, np.nan)
        kept = dataclasses.replace(data, points=points)
        return fit_robot(robot, kept, free=CHOSEN, options=options).setup

    free = ("curvature", "twist", "stiffness", "pull", "position", "rotation", "noise")
    return see_markers(data, fit, ((0, 1, 2), (3,)), error=BEGIN, free=free, blocks=4)


def describe_estimates(seen: list[Seen]) -> str:
    """Return how well markers are known from others."""
    parts = [
        f"{name} by {one.rms:.1f} mm (model alone {one.alone:.1f}), {100.0 * one.coverage:.0f} %"
        for name, one in zip(
            ("the middle ones from the tip's", "the tip's from those"), seen, strict=True
        )
    ]
    return (
        "Of poses left out, markers are missed from others (`ShapeEstimator`, no shear): "
        f"{'; '.join(parts)} in 95 % intervals."
    )


def draw_errors(fit: RobotFit, images: Path) -> None:
    """Draw the distance of each marker over the poses."""
    with draw_axes(images / "validation_tentacle.png") as axes:
        fit.plot(axes)
        for line in axes.lines:
            line.set_markersize(6)
