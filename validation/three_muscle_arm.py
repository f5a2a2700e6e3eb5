"""A soft arm of three muscles in time, seen by the spot of a pointer on a board."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from section import Bound, Section, draw_axes, format_rows

from bozzini.effector import (
    Effector,
    EffectorDesign,
    EffectorFile,
    EffectorFit,
    EffectorFitOptions,
    EffectorMeasurements,
    EffectorMotion,
    EffectorPrediction,
    MusclePull,
    PlacedMuscle,
    TipView,
    Tracking,
    compare_controllers,
    draw_plant,
    fit_effector,
    read_effector_measurements,
)
from bozzini.effector.control import PERIOD
from bozzini.muscle import Muscle
from bozzini.tracking import trace_places

MPA_PER_VOLT = 0.1
LENGTH_MM, OFFSET_MM, RIGIDITY = 340.0, 20.0, 1e5
"""Assumed, as is the pressure of a volt: the file has none of them, and only ratios matter."""
ANGLES_DEG = (-120.0, 120.0, 0.0)
"""Where the search begins."""
RADII_MPA = (0.01, 0.08, 0.3)

FREE = (
    "muscles.each.area", "muscles.each.area_slope", "muscles.each.area_curve",
    "muscles.each.stiffening", "muscles.each.angle", "board.x", "board.y", "motion.fill_lag",
    "motion.bleed_lag", "motion.creep_share", "motion.creep_time", "motion.play_weights",
)  # fmt: skip
CHECKED = ("val01", "val02")
FORMS = {
    "no plays, no creep": (("motion.play_weights", "motion.creep_share", "motion.creep_time"), ()),
    "no creep": (("motion.creep_share", "motion.creep_time"), RADII_MPA),
    "one muscle does not hinder another": (("muscles.each.stiffening",), RADII_MPA),
    "all": ((), RADII_MPA),
}
"""What is left out of the model, and the radii of its plays."""

RADIUS_MM, LIMIT_MPA, PLANTS = 8.0, 0.7, 10
"""What is tracked, the largest command of the record, and arms whose constants are off."""
FREQUENCIES = 0.1, 0.5
"""Of what is tracked [Hz]; the last has bounds."""
ARMS, RUNS, SECONDS = 50, 10, 30.0
"""Simulated arms, and what is recorded of each at 12 Hz."""
NOISE_MM = 2.0


def read_runs(folder: Path) -> EffectorMeasurements:
    """Return all runs."""
    return read_effector_measurements(folder / "runs.csv.gz", per_volt=MPA_PER_VOLT)


def make_arm(radii: tuple[float, ...] = RADII_MPA) -> Effector:
    """Return the arm where the search begins."""
    muscle = Muscle(length=LENGTH_MM, outer_radius=10.0)
    placed = tuple(
        PlacedMuscle(name=str(k + 1), muscle=muscle, angle=math.radians(angle))
        for k, angle in enumerate(ANGLES_DEG)
    )
    design = EffectorDesign(
        muscles=placed, offset=OFFSET_MM, backbone_length=LENGTH_MM, flexural_rigidity=RIGIDITY
    )
    motion = EffectorMotion(
        fill_lag=0.5, bleed_lag=0.5, play_radii=radii, play_weights=(0.1,) * len(radii),
        creep_share=0.1,
    )  # fmt: skip
    return Effector(design, motion=motion, pulls=(MusclePull(),) * 3)


VIEW = TipView(board_distance=340.0)


def fit_form(data: EffectorMeasurements, form: str, *, rest: str = "") -> EffectorFit:
    """Fit a form to runs."""
    import dataclasses

    without, radii = FORMS[form]
    arm = make_arm(radii)
    if "motion.creep_share" in without:
        arm = dataclasses.replace(arm, motion=dataclasses.replace(arm.motion, creep_share=0.0))
    free = [name for name in FREE if name not in without]
    return fit_effector(arm, data, free=free, view=VIEW, options=EffectorFitOptions(rest=rest))


def split_runs(data: EffectorMeasurements) -> tuple[EffectorMeasurements, EffectorMeasurements]:
    """Return the runs that are fitted, and those that are not."""
    names = list(dict.fromkeys(data.runs.tolist()))
    return data.select([name for name in names if name not in CHECKED]), data.select(CHECKED)


def count_held(arms: int, *, seed: int = 1) -> tuple[int, int]:
    """Return how many 95 % intervals held the truth, and how many there were.

    Arms with numbers about those of the fitted one are recorded with noise, and fitted.
    """
    random = np.random.default_rng(seed)
    held = total = 0
    for _ in range(arms):
        truth, view = draw_arm(random)
        data = record_arm(truth, view, random)
        free = [
            "muscles.each.area", "muscles.each.area_slope", "muscles.each.stiffening",
            "muscles.each.angle", "board.x", "board.y", "motion.fill_lag", "motion.bleed_lag",
            "motion.creep_share", "motion.creep_time", "motion.play_weights",
        ]  # fmt: skip
        found = fit_effector(
            truth, data, free=free, view=view, options=EffectorFitOptions(leave_out=False)
        )
        true = [law.area for law in truth.pulls or ()]
        true += [law.area_slope for law in truth.pulls or ()]
        true += [law.stiffening for law in truth.pulls or ()]
        motion = truth.motion
        true += [*truth.design.angles, view.board_x, view.board_y, motion.fill_lag]
        true += [motion.bleed_lag, motion.creep_share, motion.creep_time, *motion.play_weights]
        for one, value in zip(found.estimates, true, strict=True):
            held += one.low <= value <= one.high
            total += 1
    return held, total


def draw_arm(random: np.random.Generator) -> tuple[Effector, TipView]:
    """Return an arm, and how it is seen."""
    import dataclasses

    arm = make_arm(RADII_MPA[1:])
    placed = tuple(
        dataclasses.replace(one, angle=one.angle + random.normal(0.0, 0.1))
        for one in arm.design.muscles
    )
    pulls = tuple(
        MusclePull(
            area=random.uniform(2.0, 3.5),
            area_slope=random.uniform(0.0, 3.0),
            stiffening=random.uniform(0.1, 0.6),
        )
        for _ in placed
    )
    motion = dataclasses.replace(
        arm.motion,
        fill_lag=random.uniform(0.3, 0.6),
        bleed_lag=random.uniform(0.3, 0.6),
        play_weights=(random.uniform(0.1, 0.3), random.uniform(0.1, 0.2)),
        creep_share=random.uniform(0.1, 0.2),
        creep_time=random.uniform(5.0, 9.0),
    )
    truth = Effector(arm.design.replace(muscles=placed), motion=motion, pulls=pulls)
    place = random.normal(0.0, 5.0, 2)
    return truth, TipView(board_distance=340.0, board_x=place[0], board_y=place[1])


def record_arm(arm: Effector, view: TipView, random: np.random.Generator) -> EffectorMeasurements:
    """Return runs of ramps between random commands, two muscles at a time, seen with noise."""
    times = np.arange(0.0, SECONDS, 1.0 / 12.0)
    commands, seen = [], []
    for run in range(RUNS):
        knots = random.uniform(0.0, 0.7, (16, 3)) * (np.arange(3) != run % 3)
        at = np.linspace(0.0, SECONDS, 16)
        own = np.stack([np.interp(times, at, column) for column in knots.T], axis=1)
        bends = arm.simulate(times, own).bends
        spot = view.observe(arm, bends, channels=["spot x", "spot y"])
        commands.append(own)
        seen.append(spot + NOISE_MM * random.normal(size=spot.shape))
    return EffectorMeasurements(
        muscles=("1", "2", "3"),
        commands=np.concatenate(commands),
        channels=("spot x", "spot y"),
        seen=np.concatenate(seen),
        times=np.tile(times, RUNS),
        runs=np.repeat([f"run{k}" for k in range(RUNS)], len(times)),
    )


def track_fitted(fit: EffectorFit) -> dict[str, Tracking]:
    """Return how controllers of the fitted arm track a circle and a line in simulation."""
    import dataclasses

    file = EffectorFile.of(fit)
    file = dataclasses.replace(file, section={**file.section, "pressure_limit": LIMIT_MPA})
    random = np.random.default_rng(1)
    off = [draw_plant(file, random) for _ in range(PLANTS)]
    return {
        f"{kind}, {frequency:g} Hz": compare_controllers(
            file.build(),
            trace_places(kind, radius=RADIUS_MM, frequency=frequency, period=PERIOD),
            off=off,
        )
        for kind in ("circle", "line")
        for frequency in FREQUENCIES
    }


def list_tracking(tracked: dict[str, Tracking]) -> list[str]:
    """Return the lines of the page on control."""
    names = [row.controller for row in next(iter(tracked.values())).rows]
    return [
        f"Control in simulation: the tip of the fitted arm goes round {RADIUS_MM:g} mm, or along a "
        "line of twice that, at 50 Hz with commands up to 0.7 MPa that change by at most 3 MPa/s. "
        f"Root mean square misses [mm] of the second turn; in brackets on {PLANTS} arms whose "
        "constants are off by normal errors of the size of their standard errors, independent of "
        "each other. None but the last sees the tip. A step of predictive control takes "
        f"{find_slowest(tracked):.2f} ms of the processor, 99 % below. No arm was moved.",
        "",
        *format_rows(
            ("controller", *tracked),
            [
                [
                    name,
                    *(
                        f"{one.rows[k].rms:.3f} ({one.rows[k].rms_off:.2f})"
                        for one in tracked.values()
                    ),
                ]
                for k, name in enumerate(names)
            ],
        ),
    ]


def find_slowest(tracked: dict[str, Tracking]) -> float:
    """Return the processor time that 99 % of the steps of predictive control are below [ms]."""
    rows = [row for found in tracked.values() for row in found.rows]
    return max(1e3 * row.step_p99 for row in rows if row.controller.startswith("predictive"))


def bound_tracking(tracked: dict[str, Tracking]) -> list[Bound]:
    """Return what predictive control must keep to."""
    bounds = []
    for trace, found in tracked.items():
        rows = {row.controller: row for row in found.rows}
        if not trace.endswith(f"{FREQUENCIES[-1]:g} Hz"):
            continue
        best, static = rows["predictive"], rows["static inverse"]
        share, off = best.rms / static.rms, best.rms_off / static.rms_off
        bounds += [
            Bound(f"{trace}: miss of predictive control over that of the static inverse",
                  share, 0.5, ""),
            Bound(f"{trace}: the same with constants off", off, 0.5, ""),
        ]  # fmt: skip
    words = "processor time of a step of predictive control, 99 % below"
    return [*bounds, Bound(words, find_slowest(tracked), 10.0, "ms")]


def validate(folder: Path, images: Path) -> Section:
    """Return the section, and draw a run."""
    fitted, checked = split_runs(read_runs(folder))
    found = {form: fit_form(fitted, form) for form in FORMS if form != "all"}
    best = found["all"] = fit_form(fitted, "all", rest="polynomial")
    there = best.predict(checked)
    draw_errors(there, images)
    with_rest = there.predicted + (0.0 if there.rest is None else there.rest)
    cm = {name: 0.1 * there.measure_error(there.predicted, name) for name in CHECKED}
    rest_cm = {name: 0.1 * there.measure_error(with_rest, name) for name in CHECKED}
    assert best.band is not None
    share = 100.0 * there.measure_coverage(best.band)
    held, total = count_held(ARMS)
    count = len(best.estimates)
    tracked = track_fitted(best)
    return Section(
        title="Arm of three muscles in time, spot of a pointer",
        source="ramvasudevan/soft-robot-koopman, commit 4b989a2; Bruder et al., T-RO, 2021.",
        licence="none is stated: errors only, no measured value is shown here.",
        text=(
            f"{len(fitted.parts)} runs of 288 s at 12 Hz are fitted; `val01` (10 s) and `val02` "
            "(240 s) are not; forms were compared by runs left out. Errors are root mean square "
            "distances of the spot over whole runs [cm], from the commands alone; the polynomials "
            "are given the first two samples of each run. The spot moves over 13 by 11 cm. Length, "
            "offset, rigidity, the board's distance and the pressure of a volt are assumed "
            "(340 mm, 20 mm, 0.1 N m², 340 mm, 100 kPa): they scale the areas.",
            "",
            "![Errors over time of the runs not fitted](images/validation_three_muscle_arm.png)",
            "",
            *format_rows(
                ("form", "constants", "fitted", "runs left out", *CHECKED),
                [
                    *(_list_form(form, fit, fit.predict(checked)) for form, fit in found.items()),
                    [
                        "all, and a polynomial rest", f"{count} + {_count_rest(best)}",
                        f"{0.1 * _measure_rest(best):.3f}", "",
                        *(f"{rest_cm[name]:.3f}" for name in CHECKED),
                    ],
                    *(
                        [
                            one.name, str(one.count),
                            f"{0.1 * best.prediction.measure_error(own):.3f}", "",
                            *(f"{0.1 * there.measure_error(other, n):.3f}" for n in CHECKED),
                        ]
                        for (one, own), (_, other) in zip(
                            best.prediction.baselines, there.baselines, strict=True
                        )
                    ),
                ],
            ),
            "",
            f"The band that held 95 % of what runs left out showed holds {share:.1f} % of what the "
            f"runs not fitted show. Of {ARMS} simulated arms of {total // ARMS} constants, "
            f"{RUNS} runs of {SECONDS:g} s each and {NOISE_MM:g} mm of noise, {held} of {total} "
            f"95 % intervals hold the truth ({100.0 * held / total:.1f} %).",
            "",
            "What limits: the place of the spot drifts by up to 0.3 cm from run to run, which no "
            "command tells. Areas that change with pressure, and a stiffening below 0 of muscle 2, "
            "say what the section does as a whole, not one muscle on a bench.",
            "",
            *list_tracking(tracked),
            "",
            *COMMANDS,
        ),
        bounds=(
            Bound("val01", cm["val01"], 0.20, "cm"),
            Bound("val02", cm["val02"], 0.30, "cm"),
            Bound("val02, with a rest", rest_cm["val02"], 0.27, "cm"),
            Bound("val01, with a rest", rest_cm["val01"], 0.22, "cm"),
            Bound("fitted in that form", count, 30, "constants"),
            Bound("simulated arms: intervals that hold the truth, off 95 %",
                  abs(100.0 * held / total - 95.0), 2.0, "%"),
            *bound_tracking(tracked),
        ),
    )  # fmt: skip


def draw_errors(there: EffectorPrediction, images: Path) -> None:
    """Draw the errors of the runs not fitted over time: the data themselves are not shown."""
    assert there.data.times is not None
    off = 0.1 * np.linalg.norm(there.predicted - there.data.seen, axis=1)
    with draw_axes(images / "validation_three_muscle_arm.png") as axes:
        for name, part in zip(CHECKED, there.data.parts, strict=True):
            axes.plot(there.data.times[part], off[part], linewidth=0.8, label=name)
        axes.set(xlabel="time [s]", ylabel="spot off by [cm]", ylim=(0.0, None))
        axes.legend()


def _list_form(form: str, fit: EffectorFit, there: EffectorPrediction) -> list[str]:
    left_out = math.nan if fit.left_out is None else fit.left_out.rms
    errors = (there.measure_error(there.predicted, name) for name in CHECKED)
    return [
        form, str(len(fit.estimates)), f"{0.1 * fit.rms:.3f}", f"{0.1 * left_out:.3f}",
        *(f"{0.1 * error:.3f}" for error in errors),
    ]  # fmt: skip


def _measure_rest(fit: EffectorFit) -> float:
    assert fit.prediction.rest is not None
    return fit.prediction.measure_error(fit.prediction.predicted + fit.prediction.rest)


def _count_rest(fit: EffectorFit) -> int:
    return int(fit.rest.weights.size)  # type: ignore[union-attr]


COMMANDS = (
    "By the command line:",
    "",
    "    bozzini effector fit runs.csv.gz --hold val01,val02 --pulls --per-volt 100kPa \\",
    "      --plays 10kPa,80kPa,300kPa --angles 1=-120deg,2=120deg,3=0deg \\",
    "      --backbone-length 340mm --offset 20mm --rigidity 0.1Nm^2 \\",
    "      --set board.distance=340mm --rest polynomial --out arm.yaml --figure arm.png",
    "    bozzini effector simulate arm.yaml runs.csv.gz --out tips.csv",
    "    bozzini effector track arm.yaml --radius 8mm --plants 10",
)
