"""End-effectors fitted to tables: what comes back, what is said, what is refused."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bozzini.effector import (
    Effector,
    EffectorDesign,
    EffectorFile,
    EffectorFitOptions,
    EffectorMeasurements,
    EffectorMotion,
    MusclePull,
    PlacedMuscle,
    TipView,
    effector_preset,
    fit_effector,
    read_effector,
    read_effector_measurements,
    write_effector,
)
from bozzini.effector.rest import Baseline
from bozzini.effector.section import find_bends
from bozzini.errors import FileFormatError, InputError
from bozzini.muscle import Muscle

TABLES = np.array([
    (7.6, 22.8, 1.69), (6.9, 20.4, 1.51), (6.5, 18.9, 1.40), (6.7, 19.7, 1.46), (6.6, 19.3, 1.43),
    (7.1, 21.2, 1.57), (6.4, 18.5, 1.37), (6.2, 17.9, 1.32), (5.6, 15.2, 1.13), (5.7, 15.8, 1.17),
])  # fmt: skip
"""Contraction [mm], deflection [mm] and pull [N] of Tables 4.1 to 4.4."""

MEASURED = ((0.6894, 20.4), (0.5516, 18.5), (0.4136, 15.8))
"""Pressure [MPa] and deflection [mm] of the thesis's section."""

FREE = (
    "muscles.each.area", "muscles.each.stiffening", "muscles.each.angle", "board.x", "board.y",
    "motion.fill_lag", "motion.bleed_lag", "motion.play_weights", "motion.creep_share",
)  # fmt: skip


def make_arm() -> Effector:
    muscle = Muscle(length=340.0, outer_radius=10.0)
    placed = tuple(
        PlacedMuscle(name=name, muscle=muscle, angle=math.radians(angle))
        for name, angle in (("1", -125.0), ("2", 118.0), ("3", 5.0))
    )
    design = EffectorDesign(
        muscles=placed, offset=20.0, backbone_length=340.0, flexural_rigidity=1e5
    )
    motion = EffectorMotion(
        fill_lag=0.45, bleed_lag=0.38, play_radii=(0.05,), play_weights=(0.4,), creep_share=0.15,
        creep_time=8.0,
    )  # fmt: skip
    pulls = tuple(MusclePull(area=a, stiffening=s)
                  for a, s in ((3.0, 0.2), (2.6, 0.1), (3.3, 0.3)))  # fmt: skip
    return Effector(design, motion=motion, pulls=pulls)


def record(
    arm: Effector, view: TipView, random: np.random.Generator, *, noise: float, runs: int = 6
) -> EffectorMeasurements:
    times = np.arange(240) / 12.0
    commands, seen = [], []
    for _ in range(runs):
        knots = random.uniform(0.0, 0.7, (11, 3)) * (np.arange(3) != random.integers(3))
        own = np.stack([np.interp(times, 2.0 * np.arange(11), k) for k in knots.T], axis=1)
        track = arm.simulate(times, own)
        spot = view.observe(arm, track.bends, channels=["spot x", "spot y"])
        commands.append(own)
        seen.append(spot + noise * random.normal(size=spot.shape))
    return EffectorMeasurements(
        muscles=("1", "2", "3"),
        commands=np.concatenate(commands),
        channels=("spot x", "spot y"),
        seen=np.concatenate(seen),
        times=np.tile(times, runs),
        runs=np.repeat([f"run{k}" for k in range(runs)], len(times)),
    )


VIEW = TipView(board_distance=340.0, board_x=4.0, board_y=9.0)


def test_offset_and_rigidity_of_the_thesis_come_back():
    design = effector_preset("prototype", offset=3.6, flexural_rigidity=150.0)
    data = EffectorMeasurements(
        muscles=("R",), commands=TABLES[:, :1], channels=("lateral", "R force"),
        seen=TABLES[:, 1:], command="contraction",
    )  # fmt: skip
    found = Effector(design).fit(data, free=["offset", "flexural_rigidity"])
    offset, rigidity = found.estimates
    assert offset.value == pytest.approx(4.0, abs=0.005)
    assert rigidity.value == pytest.approx(200.0, abs=0.5)
    assert offset.low < 4.0 < offset.high < offset.low + 0.05
    assert rigidity.low < 200.0 < rigidity.high < rigidity.low + 4.0


def test_the_default_is_fitted_to_the_measured_deflections():
    """The preset is what the command finds from the untuned muscle, rounded."""
    measured = effector_preset("measured")
    effector = Effector(measured)
    found = effector.forward({"R": [pressure for pressure, _ in MEASURED]})
    assert found.lateral == pytest.approx([deflection for _, deflection in MEASURED], abs=0.05)
    begin = measured.replace(muscles=tuple(
        dataclasses.replace(one, muscle=one.muscle.replace(modulus=0.35, braid_angle=0.628))
        for one in measured.muscles
    ))  # fmt: skip
    table = np.array(MEASURED)
    data = EffectorMeasurements(
        muscles=("R",), commands=table[:, :1], channels=("lateral",), seen=table[:, 1:]
    )
    fit = Effector(begin).fit(data, free=["muscles.*.modulus", "muscles.*.braid_angle"])
    modulus, angle = (one.value for one in fit.estimates)
    assert modulus == pytest.approx(measured.muscles[0].muscle.modulus, abs=5e-4)
    assert math.degrees(angle) == pytest.approx(35.05, abs=0.01)


def test_an_arm_comes_back_and_its_file_reads_back(tmp_path):
    arm, random = make_arm(), np.random.default_rng(5)
    data = record(arm, VIEW, random, noise=0.3)
    begin = dataclasses.replace(
        arm,
        pulls=(MusclePull(area=2.0),) * 3,
        motion=dataclasses.replace(arm.motion, fill_lag=0.6, bleed_lag=0.6, play_weights=(0.1,),
                                   creep_share=0.05),
    )  # fmt: skip
    fit = fit_effector(
        begin, data, free=FREE, view=dataclasses.replace(VIEW, board_x=0.0, board_y=0.0),
        options=EffectorFitOptions(rest="polynomial"),
    )  # fmt: skip
    assert fit.converged and not fit.undetermined
    assert fit.rms == pytest.approx(0.3 * math.sqrt(2.0), rel=0.05)
    assert fit.left_out is not None and fit.left_out.rms < 1.1 * fit.rms
    truth = {f"muscles.each.area[{k + 1}]": law.area for k, law in enumerate(arm.pulls)}
    truth |= {"motion.fill_lag": 0.45, "motion.creep_share": 0.15, "board.y": 9.0}
    known = {one.name: one for one in fit.estimates}
    for name, value in truth.items():
        one = known[name]
        assert abs(one.value - value) < 4.0 * one.standard_error
    # black boxes beside it know less, and a rest has little left to learn
    errors = fit.prediction.errors["run0"]
    assert errors["fit"] < errors["linear, two past samples"] < errors["constant"]
    assert errors["fit and rest"] == pytest.approx(errors["fit"], rel=0.05)
    other = record(arm, VIEW, random, noise=0.3, runs=1)
    there = fit.predict(other)
    assert there.rms == pytest.approx(0.3 * math.sqrt(2.0), rel=0.15)
    assert 0.9 < there.measure_coverage(fit.band) < 1.0
    file = EffectorFile.of(fit, per_volt=0.1)
    write_effector(tmp_path / "fit.yaml", file)
    again = read_effector(tmp_path / "fit.yaml")
    times = np.arange(40) / 12.0
    assert np.array_equal(
        again.build().simulate(times, data.commands[:40]).tip,
        fit.effector.simulate(times, data.commands[:40]).tip,
    )


def test_what_the_data_do_not_determine_is_named():
    arm = make_arm()
    data = record(arm, VIEW, np.random.default_rng(6), noise=0.3, runs=2)
    fit = fit_effector(
        arm, data, free=[*FREE, "flexural_rigidity"], view=VIEW,
        options=EffectorFitOptions(leave_out=False),
    )  # fmt: skip
    assert any("flexural_rigidity" in text for text in fit.undetermined)


def test_lost_values_are_left_out_and_their_commands_kept():
    arm = make_arm()
    data = record(arm, VIEW, np.random.default_rng(7), noise=0.0, runs=2)
    seen = data.seen.copy()
    seen[50:90] = np.nan
    lossy = dataclasses.replace(data, seen=seen)
    begin = dataclasses.replace(
        arm, motion=dataclasses.replace(arm.motion, fill_lag=0.6, bleed_lag=0.6)
    )
    fit = fit_effector(begin, lossy, free=["motion.fill_lag", "motion.bleed_lag"], view=VIEW)
    assert [one.value for one in fit.estimates] == pytest.approx([0.45, 0.38], abs=1e-5)


def test_a_quadratic_of_past_samples_comes_back():
    random = np.random.default_rng(8)
    truth = Baseline(2, 0.02 * random.normal(size=(28, 1)), (1.0, 1.0))
    weights = truth.weights.copy()
    weights[1] += 0.6
    truth = Baseline(2, weights, (1.0, 1.0))
    runs = []
    for _ in range(3):
        commands = random.uniform(-1.0, 1.0, (400, 2))
        runs.append((commands, truth.predict(commands, np.zeros((400, 1)))))
    found = Baseline.learn(2, runs)
    assert found.count == 28
    commands = random.uniform(-1.0, 1.0, (50, 2))
    begin = np.zeros((50, 1))
    assert found.predict(commands, begin) == pytest.approx(truth.predict(commands, begin))


def write_table(path, rows):
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_titles_are_read_with_their_units(tmp_path):
    table = write_table(tmp_path / "t.csv", [
        "run,time_s,command_1_V,2 pressure [kPa],dot_x_cm,dot y [mm],note",
        "a,0.0,1.0,100,1.5,2,x", "a,0.1,2.0,200,,2,x", "b,0.0,0.0,0,1,2,x",
    ])  # fmt: skip
    data = read_effector_measurements(table, per_volt=0.1)
    assert data.muscles == ("1", "2") and data.channels == ("spot x", "spot y")
    assert data.commands == pytest.approx(np.array([[0.1, 0.1], [0.2, 0.2], [0.0, 0.0]]))
    assert data.seen[0] == pytest.approx([15.0, 2.0]) and np.isnan(data.seen[1, 0])
    assert len(data.parts) == 2
    assert "1 row(s) lack" in data.notes[0] and "note" in data.notes[1]


def test_a_column_that_is_not_there_is_refused_and_a_run_of_a_table_without(tmp_path):
    table = write_table(tmp_path / "t.csv", ["R pressure [kPa],tip x [mm]", "100,1", "200,2"])
    with pytest.raises(FileFormatError, match="there is no column 'eye' to read as 'tip y"):
        read_effector_measurements(table, columns={"eye": "tip y [mm]"})
    data = read_effector_measurements(table, columns={"eye": "tip x [mm]"})  # as it is titled
    with pytest.raises(InputError, match="no run 'a': the table has no column 'run'"):
        data.select(["a"])


def test_an_azimuth_may_be_read_over_a_turn():
    arm, random = Effector(effector_preset("measured")), np.random.default_rng(2)
    commands = random.uniform(0.1, 0.7, (12, 3)) * (1.0, 1.0, 0.0)
    seen = TipView().observe(arm, find_bends(arm, commands), channels=("bend", "azimuth"))
    seen[:, 1] %= 2.0 * math.pi
    data = EffectorMeasurements(
        muscles=("R", "G", "B"), commands=commands, channels=("bend", "azimuth"), seen=seen
    )
    begin = effector_preset("measured")
    begin = begin.replace(muscles=tuple(
        dataclasses.replace(one, muscle=one.muscle.replace(modulus=0.2)) for one in begin.muscles
    ))  # fmt: skip
    found = Effector(begin).fit(data, free=["muscles.*.modulus"])
    assert found.estimates[0].value == pytest.approx(0.152, rel=1e-5)
    assert found.prediction.predicted == pytest.approx(seen, abs=1e-6)


def test_a_pull_in_time_lags_as_its_pressure_does():
    arm = Effector(effector_preset("measured"), motion=EffectorMotion(fill_lag=0.2, bleed_lag=0.2))
    times = 0.05 * np.arange(40.0)
    commands = np.where(times < 0.5, 0.1, 0.5)[:, None]
    acting = arm.simulate(times, {"R": commands[:, 0]}).effective
    data = EffectorMeasurements(
        muscles=("R",), commands=commands, channels=("R force",),
        seen=arm.forward(acting).force[:, :1], times=times,
    )  # fmt: skip
    begin = dataclasses.replace(arm, motion=EffectorMotion(fill_lag=0.5, bleed_lag=0.2))
    found = begin.fit(data, free=["motion.fill_lag"])
    assert found.estimates[0].value == pytest.approx(0.2, rel=1e-4)


def test_the_order_of_rows_at_rest_tells_a_rest_nothing():
    arm, random = Effector(effector_preset("measured")), np.random.default_rng(4)
    commands = random.uniform(0.0, 0.7, (40, 3)) * (1.0, 1.0, 0.0)
    seen = TipView().observe(arm, find_bends(arm, commands), channels=("tip x", "tip y"))
    seen += 3.0 * commands[:, :2] ** 2

    def fit(rows):
        data = EffectorMeasurements(
            muscles=("R", "G", "B"), commands=commands[rows], channels=("tip x", "tip y"),
            seen=seen[rows], runs=np.array([f"r{k % 4}" for k in rows]),
        )  # fmt: skip
        found = arm.fit(data, free=["base.x"], options=EffectorFitOptions(rest="polynomial"))
        assert "40 rows of 4 run(s)" in found.format_table()
        return found.prediction.rest

    one, order = fit(np.arange(40)), random.permutation(40)
    assert fit(order) == pytest.approx(one[order], abs=1e-4)


def test_a_pointer_that_is_turned_away_has_no_spot():
    spots = VIEW.observe(
        make_arm(), np.array([[0.1, 0.0], [1.5, 0.0], [1.7, 0.0]]), channels=("spot x", "spot y")
    )
    assert np.isfinite(spots[:2]).all() and np.isnan(spots[2]).all()


def test_what_was_not_seen_does_not_make_the_band_narrow():
    arm, random = make_arm(), np.random.default_rng(6)
    data = record(arm, VIEW, random, noise=2.0, runs=3)
    seen = np.array(data.seen)
    seen[np.arange(len(seen)) % 10 > 0, 1] = math.nan
    found = fit_effector(
        arm, dataclasses.replace(data, seen=seen), free=["muscles.each.area"], view=VIEW
    )
    assert found.band is not None and found.band[1] == pytest.approx(1.96 * 2.0, rel=0.4)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["time_s,command_1_V,dot_x_cm", "0,1,1", "0.1,1,1", "0.05,1,1"],
         "stands at row 3 of the data: 0.05 s after 0.1 s; if a run begins there"),
        (["run,time_s,command_1_V,dot_x_cm", "a,0,1,1", "b,0,1,1", "a,1,1,1"],
         "rows of run 'a' are in two places"),
        (["run,time_s,command_1_V,dot_x_cm", "a,0,1,1", ",0,1,1"], "row 3: the run has no name"),
        (["time_s,command_1_V,dot_x_cm", "0,1,", "0.1,1,nan"], "nothing was seen"),
        (["time_s,command_1_V", "0,1"], "no column with what was seen"),
        (["time_s,dot_x_cm", "0,1"], "no column with a command"),
        (["time_s,command_1_V,dot_x", "0,1,1"], "column 'dot_x' has no unit"),
        (["time_s,time_ms,command_1_V,dot_x_cm", "0,0,1,1"], "'time_ms' is a second time"),
    ],
)  # fmt: skip
def test_bad_tables_are_refused(tmp_path, rows, said):
    table = write_table(tmp_path / "t.csv", rows)
    with pytest.raises((InputError, FileFormatError), match=said):
        read_effector_measurements(table, per_volt=0.1)


@pytest.mark.parametrize(
    ("free", "change", "said"),
    [
        (["motion.speed"], {}, "'motion.speed' cannot be fitted"),
        (["muscles.each.modulus"], {}, "of these muscles angle, area"),
        (["board.x", "board.x"], {}, "'board.x' is free twice"),
        (["muscles.*.area", "muscles.each.area"], {}, "'muscles.each.area' is free for all"),
        (FREE, {"seen": np.array([[1.0, math.nan]] * 6)}, "nothing was seen of 'spot y'"),
        (FREE, {"commands": np.full((6, 3), 2.0)}, "pressure of muscle 1 is 2 MPa"),
        (FREE, {}, r"12 misfit\(s\) are too few for 15 unknown\(s\)"),
        (FREE, {"muscles": ("1", "2", "Q")}, "there is no muscle 'Q'"),
        (FREE, {"channels": ("eye x", "spot y")}, "'eye x' is nothing that is seen"),
        ([], {}, "no parameter is free"),
    ],
)  # fmt: skip
def test_bad_fits_are_refused(free, change, said):
    data = EffectorMeasurements(**{
        "muscles": ("1", "2", "3"), "commands": np.full((6, 3), 0.1),
        "channels": ("spot x", "spot y"), "seen": np.arange(12.0).reshape(6, 2),
        "times": np.arange(6.0), **change,
    })  # fmt: skip
    with pytest.raises(InputError, match=said):
        fit_effector(make_arm(), data, free=free, view=VIEW)
