"""Isometric forces of Festo muscles of several lengths: each length predicted from the others.

No licence is stated for these data: errors are shown, and no measured value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas
from loops import compare_loops, make_runs
from section import Bound, Section, draw_axes, format_rows, name_baselines

from bozzini.continuum.command_baselines import predict_by_commands
from bozzini.hysteresis import LoopRuns
from bozzini.muscle import (
    MODELS,
    FitOptions,
    Measurements,
    Muscle,
    MuscleModel,
    RankedModel,
    RankOptions,
    rank,
    read_measurements,
)

MUSCLE = Muscle(
    length=100.0,
    outer_radius=5.0,
    inner_radius=4.0,
    gap=0.0,
    dead_length=0.0,
    braid_angle=0.45,
    modulus=3.0,
)
"""The braid has the radius of the bore, over a wall of 1 mm: only modulus times area counts."""

ANGLE, WALL = ("braid_angle",), ("braid_angle", "modulus")
ENDS = ("compliance", "slack_force", "offset")


@dataclass(frozen=True)
class Form:
    """A model and what of it is fitted; `constants` counts what all lengths share.

    The zero offset of the contraction is none, taken from each muscle's free length at 620 kPa
    (`anchored`), or each muscle's own in the fit and their mean for one left out (`each`).
    """

    words: str
    constants: int
    model: Callable[..., MuscleModel]
    fields: tuple[str, ...]
    anchored: bool = False
    each: tuple[str, ...] = ()


WALLS: Mapping[str, Callable[..., MuscleModel]] = MODELS
NEO_HOOKEAN = partial(WALLS["ogden"], exponent=2.0, stretches="outer")
OGDEN = partial(WALLS["ogden"], stretches="outer")
MOONEY = partial(WALLS["delson"], stretches="outer")
ANCHORED = Form(
    "neo-Hookean wall, slack force; offset from the free length",
    3, NEO_HOOKEAN, (*WALL, "slack_force"), anchored=True,
)  # fmt: skip
MEAN = Form(
    "neo-Hookean wall, slack force, compliance; mean offset of the others",
    5, NEO_HOOKEAN, (*WALL, *ENDS), each=("offset",),
)  # fmt: skip
FORMS = (
    Form("ideal braid, dead length", 2, MODELS["gaylord-2"], (*ANGLE, "dead_length")),
    Form("`kothera-balance`, dead length", 3, MODELS["kothera-balance"], (*WALL, "dead_length")),
    Form("neo-Hookean wall, dead length", 3, NEO_HOOKEAN, (*WALL, "dead_length")),
    Form("ideal braid; offset from the free length", 1, MODELS["gaylord-2"], ANGLE, anchored=True),
    ANCHORED,
    Form(
        "Mooney-Rivlin wall, slack force; offset from the free length",
        4, MOONEY, (*ANGLE, "slack_force"), anchored=True,
    ),
    Form(
        "Ogden wall, slack force; offset from the free length",
        4, OGDEN, (*WALL, "slack_force"), anchored=True,
    ),
    Form(
        "neo-Hookean wall, slack force, compliance; offset from the free length",
        4, NEO_HOOKEAN, (*WALL, "slack_force", "compliance"), anchored=True,
    ),
    Form(
        "neo-Hookean wall, slack force, compliance, one offset",
        5, NEO_HOOKEAN, (*WALL, *ENDS),
    ),
    MEAN,
    Form(
        "Ogden wall, slack force, compliance; mean offset of the others",
        6, OGDEN, (*WALL, *ENDS), each=("offset",),
    ),
)  # fmt: skip


def measure_baselines(data: Measurements) -> dict[str, float]:
    """Return what pressure, contraction and rest length alone predict of lengths left out [N]."""
    lengths = data.geometry["length"]
    known = np.stack([data.pressure, data.contraction / lengths, lengths], axis=-1)
    missed: dict[str, list[float]] = {}
    for name in data.list_specimens():
        out = data.specimen == name
        found = predict_by_commands(known[~out], data.load[~out, None, None], known[out])
        for what, loads in found.items():
            missed.setdefault(what, []).extend((loads[:, 0, 0] - data.load[out]).tolist())
    return {what: float(np.sqrt(np.mean(np.square(each)))) for what, each in missed.items()}


LOOPS = 16
"""Loops of a muscle at a contraction that are compared, of the shortest muscle first."""


def list_loops(folder: Path) -> list[tuple[LoopRuns, tuple[str, ...]]]:
    """Return the loops of the force over the pressure, and the last of their three repeats."""
    rows = pandas.read_csv(folder / "plateaus.csv", comment="#").sort_values("time [s]")
    pressure, load = "pressure [kPa]", "load [N]"
    loops: list[tuple[LoopRuns, tuple[str, ...]]] = []
    for _, loop in rows.groupby(["rest length [mm]", "contraction [mm]"]):
        parts = [(str(name), one[pressure].to_numpy(), one[load].to_numpy())
                 for name, one in loop.groupby("test")]  # fmt: skip
        loops.append((make_runs(parts, (pressure, load)), (parts[-1][0],)))
    return loops[:LOOPS]


def leave_out(data: Measurements, form: Form) -> RankedModel:
    """Fit a form to all lengths, and again without each of them."""
    fit = FitOptions(response="force", anchored=form.anchored, each=form.each)
    options = RankOptions(fields=form.fields, leave_out="specimen", criterion="cv", fit=fit)
    return rank(data, MUSCLE, models={"form": form.model}, options=options).models[0]


def validate(folder: Path, images: Path) -> Section:
    """Return the section, and draw the errors of the two best forms over the length left out."""
    data = read_measurements(folder / "plateaus_taut.csv")
    lengths = [
        float(data.select(data.specimen == name).geometry["length"][0])
        for name in data.list_specimens()
    ]
    found = {
        form: (leave_out(data.select(data.direction == "inflating"), form), leave_out(data, form))
        for form in FORMS
    }
    head = ["form", "constants", "left out: inflating", "both", "in the fit: both"]
    rows = []
    for form, (inflating, both) in found.items():
        assert inflating.validation is not None and both.validation is not None
        cells = [
            form.words,
            str(form.constants),
            format_error(inflating.validation.error),
            format_error(both.validation.error),
            format_error(both.score.rmse),
        ]
        rows.append(cells)
    draw_errors(lengths, {form: found[form][1] for form in (ANCHORED, MEAN)}, images)
    bounds, gaps = [], 0
    for form in (ANCHORED, MEAN):
        for words, most, entry in zip(
            ("inflating", "both"), (20.0, 18.0), found[form], strict=True
        ):
            assert entry.validation is not None
            gaps += entry.validation.gaps
            bounds.append(
                Bound(f"{form.words}, left out, {words}", entry.validation.error, most, "N")
            )
    bounds.append(Bound("left out without an answer, all of these", gaps, 0.0, "rows"))
    loops = compare_loops(list_loops(folder))
    words = "force over pressure at a contraction, third repeat from two"
    bounds += loops.list_bounds(words)
    return Section(
        title="Festo muscles DMSP-10, force",
        source="Agile-and-Adaptive-Robotics/Muscle_Sensory, commit e3a8277; Bolen et al., "
        "Actuators, 2026.",
        licence="none is stated: errors only, no measured value is shown here.",
        text=(
            *format_text(data, lengths, found[MEAN][1]),
            "",
            *format_rows(head, rows),
            "",
            describe_baselines(data),
            "",
            loops.describe(words, "N"),
            "",
            LIMITS,
            "",
            TRUST,
            "",
            *COMMANDS,
        ),
        bounds=tuple(bounds),
    )


def format_text(data: Measurements, lengths: list[float], fitted: RankedModel) -> list[str]:
    """Return what was measured and fitted."""
    assert fitted.calibration is not None
    known = fitted.calibration.estimates
    offsets = np.array([value for name, value in known.items() if name.startswith("offset")])
    return [
        f"{len(data)} standing pressures of {len(lengths)} muscles, {min(lengths):.0f} to "
        f"{max(lengths):.0f} mm long, held at four contractions, three times, inflating and "
        "deflating. Each length is left out in turn and predicted by constants that the others "
        "share. Given of it are the rest length and, in the forms with an offset from the free "
        "length, its length without load at 620 kPa. Errors are root mean squares over all rows "
        "[N]. Published: 17 to 23 N for laws of three constants, and 63 to 144 N for earlier laws "
        "(Bolen et al.). `none`: no answer at a length left out.",
        "",
        "The last form but one predicts a length from its rest length alone. On all four lengths "
        f"it has a braid angle of {np.degrees(known['braid_angle']):.1f} deg, a modulus of "
        f"{known['modulus']:.2f} MPa with a wall of 1 mm, {1e3 * known['compliance']:.1f} mm/kN, a "
        f"slack force of {known['slack_force']:.1f} N and offsets of {offsets.min():.2f} to "
        f"{offsets.max():.2f} mm.",
        "",
        "![Error by length left out](images/validation_festo10.png)",
    ]


def describe_baselines(data: Measurements) -> str:
    """Return what is predicted without a law of muscles."""
    shown = name_baselines(measure_baselines(data), "N")
    return f"Pressure, strain and rest length alone, both directions: {shown}."


LIMITS = (
    "What limits: the specimens. Lengths are whole millimetres, and 1 mm is 30 to 50 N at 83 mm "
    "and 10 to 15 N at 281 mm. The muscle of 132 mm pulls about 30 N less than its neighbours "
    "would have it. A free surface with 80 constants leaves 12.8 N."
)
TRUST = (
    "The forms were compared by the very errors of the table; chosen from 50 without the length "
    "left out they had 21.6 N inflating and 20.9 N in both directions. Expect 10 to 18 N of a "
    "muscle like three of the four, and 30 N of one like that of 132 mm; its free length to 0.1 mm "
    "helps (20 N)."
)


COMMANDS = (
    "The last form but one as a file, and a length that was not measured, with its band:",
    "",
    "    bozzini muscle fit plateaus_taut.csv --model ogden --set exponent=2 \\",
    "      --set stretches=outer --length 100mm --outer-radius 5mm --inner-radius 4mm --gap 0mm \\",
    "      --dead-length 0mm --braid-angle 26deg --modulus 3MPa --each offset \\",
    "      --shared braid-angle,modulus,compliance,slack-force --out festo10.yaml",
    "    bozzini muscle predict festo10.yaml --rest-length 230mm --pressure 400kPa \\",
    "      --contraction 5mm",
)


def format_error(error: float) -> str:
    """Return an error [N], or that there is none: a row had no answer."""
    return f"{error:.1f}" if np.isfinite(error) else "none"


def draw_errors(lengths: list[float], found: dict[Form, RankedModel], images: Path) -> None:
    """Draw the error of each form over the length left out."""
    with draw_axes(images / "validation_festo10.png") as axes:
        for form, entry in found.items():
            assert entry.validation is not None
            words = "its free length" if form.anchored else "the mean of the others"
            label = f"offset from {words}, {form.constants} constants"
            axes.plot(lengths, entry.validation.errors, "o-", label=label)
        axes.set(xlabel="rest length left out [mm]", ylabel="rms error [N]", ylim=(0.0, None))
